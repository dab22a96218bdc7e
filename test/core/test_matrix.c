#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "fail_alloc.h"
#include "solve_cases.h"

static double noise(unsigned *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (double)(*seed >> 8) / (1 << 23) - 1;
}

static void one_tetrahedron_couples_all_its_nodes(void **state)
{
    int tet[4] = {3, 0, 2, 1};
    const cn_body body = {.nblock = 4, .nelement = 1, .nper = 4, .connect = tet}, *const bodies[] = {&body};
    cn_matrix *a;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_OK);
    assert_int_equal(a->n, 4);
    assert_int_equal(a->nblock, 16);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            assert_int_equal(cn_matrix_find(a, i, j), 4 * i + j);
    cn_matrix_free(a);
}

static void bodies_stand_side_by_side_and_lone_nodes_keep_their_diagonal(void **state)
{
    int tet[4] = {0, 1, 2, 3};
    const cn_body body = {.nblock = 4, .nelement = 1, .nper = 4, .connect = tet},
                  lone = {.nblock = 2, .nper = 4};
    const cn_body *const bodies[] = {&body, &lone, &body};
    cn_matrix *a;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 3, bodies, (int[]){6, 4, 0}), CN_OK);
    assert_int_equal(a->n, 10);
    assert_int_equal(a->nblock, 34);
    assert_int_equal(cn_matrix_find(a, 3, 6), -1);
    assert_int_equal(cn_matrix_find(a, 9, 4), -1);
    assert_true(cn_matrix_find(a, 9, 6) >= 0);
    for (int i = 0; i < 10; i++) {
        assert_int_equal(a->col[a->diagonal[i]], i);
        for (int k = a->row[i]; k + 1 < a->row[i + 1]; k++)
            assert_true(a->col[k] < a->col[k + 1]);
    }
    assert_int_equal(a->row[5] - a->row[4], 1);
    cn_matrix_free(a);
}

static void an_empty_set_of_bodies_gives_an_empty_matrix(void **state)
{
    cn_matrix *a;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 0, NULL, NULL), CN_OK);
    assert_int_equal(a->n, 0);
    cn_matrix_multiply(a, 0, NULL, NULL, NULL);
    cn_matrix_free(a);
    cn_matrix_free(NULL);
}

static void indices_out_of_range_are_refused(void **state)
{
    int tet[4] = {0, 1, 2, 3};
    cn_body body = {.nblock = 4, .nelement = 1, .nper = 4, .connect = tet};
    const cn_body *const bodies[] = {&body};
    cn_matrix *a;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){-1}), CN_ERR_ARG);
    tet[2] = 4;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_ERR_ARG);
    tet[2] = -1;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_ERR_ARG);
    tet[2] = 2, body.nblock = -4;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_ERR_ARG);
    assert_null(a);
}

static void product_equals_the_dense_one_over_the_active_rows_for_any_thread_count(void **state)
{
    cn_body body = body_sweep(section_disc(6, 1), 120, 60);
    const cn_body *const bodies[] = {&body};
    cn_matrix *a;
    cn_pool *pool;
    unsigned seed = 1;
    const int n = body.nnode;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_OK);
    assert_int_equal(cn_pool_new(&pool, 2), CN_OK);
    double *x = malloc(3 * (size_t)n * sizeof *x), *y = malloc(3 * (size_t)n * sizeof *y),
           *z = malloc(3 * (size_t)n * sizeof *z);
    for (int k = 0; k < 9 * a->nblock; k++)
        a->value[k] = noise(&seed);
    for (int k = 0; k < 3 * n; k++)
        x[k] = noise(&seed), y[k] = z[k] = 7;
    for (int nactive = n; nactive > 0; nactive -= 307) {
        cn_matrix_multiply(a, nactive, x, y, NULL);
        cn_matrix_multiply(a, nactive, x, z, pool);
        assert_memory_equal(y, z, 3 * (size_t)n * sizeof *y);
        for (int i = 0; i < 3 * nactive; i++) {
            double sum = 0;
            for (int j = 0; j < nactive; j++) {
                const int k = cn_matrix_find(a, i / 3, j);
                for (int c = 0; c < 3 && k >= 0; c++)
                    sum += a->value[9 * k + 3 * (i % 3) + c] * x[3 * j + c];
            }
            assert_true(fabs(sum - y[i]) < 1e-13);
        }
    }
    free(x), free(y), free(z);
    cn_pool_free(pool);
    cn_matrix_free(a);
    body_drop(&body);
}

static void clear_zeroes_the_leading_rows_alone(void **state)
{
    int tet[4] = {0, 1, 2, 3};
    const cn_body body = {.nblock = 4, .nelement = 1, .nper = 4, .connect = tet}, *const bodies[] = {&body};
    cn_matrix *a;

    (void)state;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_OK);
    for (int k = 0; k < 9 * a->nblock; k++)
        a->value[k] = 1;
    cn_matrix_clear(a, 3);
    for (int k = 0; k < 9 * a->nblock; k++)
        assert_true(a->value[k] == (k >= 9 * 12));
    cn_matrix_free(a);
}

static void every_failing_allocation_is_reported(void **state)
{
    cn_body body = body_sweep(section_disc(6, 1), 3, 1);
    const cn_body *const bodies[] = {&body};
    cn_matrix *a = NULL;
    bool fired = true;
    long n = 0;

    (void)state;
    for (; fired; n++) {
        fail_alloc_at(n);
        const cn_status status = cn_matrix_new(&a, 1, bodies, (int[]){0});
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_int_equal(status, fired ? CN_ERR_MEMORY : CN_OK);
        assert_true(fired == !a);
    }
    assert_true(n > 4);
    cn_matrix_free(a);
    body_drop(&body);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_tetrahedron_couples_all_its_nodes),
        cmocka_unit_test(bodies_stand_side_by_side_and_lone_nodes_keep_their_diagonal),
        cmocka_unit_test(an_empty_set_of_bodies_gives_an_empty_matrix),
        cmocka_unit_test(indices_out_of_range_are_refused),
        cmocka_unit_test(product_equals_the_dense_one_over_the_active_rows_for_any_thread_count),
        cmocka_unit_test(clear_zeroes_the_leading_rows_alone),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
