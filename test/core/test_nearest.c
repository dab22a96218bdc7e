/* LINK: wrap */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "nearest.h"
#include "shapes.h"

static void nearest_points_are_those_of_a_search_through_all(void **state)
{
    (void)state;
    enum { N = 700, K = 9 };
    static double place[3 * N];
    unsigned seed = 3;
    for (int i = 0; i < 3 * N; i++) /* coarse: many ties, points that coincide */
        place[i] = i < 3 * N / 2 ? floor(4 * shape_random(&seed)) : shape_random(&seed);
    for (int n = 1; n <= N; n = 3 * n + 1) {
        cn_nearest_tree *tree;
        assert_int_equal(cn_nearest_new(&tree, n, place), CN_OK);
        for (int trial = 0; trial < 200; trial++) {
            double p[3], square[K];
            int index[K], chosen[N] = {0};
            for (int k = 0; k < 3; k++)
                p[k] = trial % 2 ? floor(4 * shape_random(&seed)) : 2 * shape_random(&seed);
            const int found = cn_nearest_find(tree, p, K, index, square);
            assert_int_equal(found, n < K ? n : K);
            for (int j = 0; j < found; j++) {
                int best = -1;
                double least = INFINITY, d[3];
                for (int i = 0; i < n; i++) {
                    cn_sub(place + 3 * i, p, d);
                    if (!chosen[i] && cn_norm2(d) < least) least = cn_norm2(d), best = i;
                }
                chosen[best] = 1;
                assert_int_equal(index[j], best);
                assert_true(square[j] == least);
            }
        }
        cn_nearest_free(tree);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    const double place[6] = {0, 0, 0, 1, 1, 1};
    for (FAIL_EACH_ALLOC) {
        cn_nearest_tree *tree;
        const cn_status status = cn_nearest_new(&tree, 2, place);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((tree == NULL) == fail_alloc_fired());
        cn_nearest_free(tree);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nearest_points_are_those_of_a_search_through_all),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
