#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "fail_alloc.h"
#include "pool.h"

enum { N = 1000 };

static void count_up(void *user, int i)
{
    ((int *)user)[i]++;
}

static void each_task_runs_once_for_any_number_of_threads_and_tasks(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 4; threads++) {
        cn_pool *pool;
        assert_int_equal(cn_pool_new(&pool, threads), CN_OK);
        assert_int_equal(cn_pool_threads(pool), threads);
        for (int n = 0; n <= N; n = 2 * n + 1) {
            int hits[N] = {0};
            cn_pool_run(pool, n, count_up, hits);
            for (int i = 0; i < N; i++)
                assert_int_equal(hits[i], i < n);
        }
        cn_pool_free(pool);
    }
}

static void short_runs_in_quick_succession_lose_nothing(void **state)
{
    (void)state;
    cn_pool *pool;
    int hits[3] = {0};
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    for (int run = 0; run < 5000; run++)
        cn_pool_run(pool, 3, count_up, hits);
    for (int i = 0; i < 3; i++)
        assert_int_equal(hits[i], 5000);
    cn_pool_free(pool);
}

static void append(void *user, int i)
{
    int *list = user;
    list[1 + list[0]++] = i;
}

static void without_a_pool_tasks_run_in_order(void **state)
{
    (void)state;
    int list[11] = {0};
    cn_pool_run(NULL, 10, append, list);
    for (int i = 0; i < 10; i++)
        assert_int_equal(list[1 + i], i);
    assert_int_equal(cn_pool_threads(NULL), 1);
    cn_pool_free(NULL);
}

static void no_thread_at_all_is_refused(void **state)
{
    (void)state;
    cn_pool *pool;
    assert_int_equal(cn_pool_new(&pool, 0), CN_ERR_ARG);
    assert_null(pool);
    assert_int_equal(cn_pool_new(&pool, -1), CN_ERR_ARG);
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    for (FAIL_EACH_ALLOC) {
        cn_pool *pool;
        const cn_status status = cn_pool_new(&pool, 2);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((pool != NULL) == (status == CN_OK));
        cn_pool_free(pool);
    }
    fail_alloc_at(-1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_task_runs_once_for_any_number_of_threads_and_tasks),
        cmocka_unit_test(short_runs_in_quick_succession_lose_nothing),
        cmocka_unit_test(without_a_pool_tasks_run_in_order),
        cmocka_unit_test(no_thread_at_all_is_refused),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
