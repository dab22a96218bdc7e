#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "polar.h"
#include "shapes.h"

static double trace_transposed_times(const double r[9], const double f[9])
{
    double sum = 0;
    for (int i = 0; i < 9; i++)
        sum += r[i] * f[i];
    return sum;
}

static void assert_proper(const double r[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double dot = r[i] * r[j] + r[3 + i] * r[3 + j] + r[6 + i] * r[6 + j];
            assert_true(fabs(dot - (i == j)) < 4e-15);
        }
    assert_true(cn_det(r) > 0);
}

/* Every row of the table; where several rotations are nearest, any whose trace reaches s1 + s2 + s3 will do.
 */
static void hard_matrices_have_their_nearest_rotation(void **state)
{
    (void)state;
    char line[2048];
    FILE *file = reference_open("data/polar_decomposition.csv");
    if (!file) skip();
    assert_non_null(fgets(line, sizeof line, file));
    while (fgets(line, sizeof line, file)) {
        double v[24], q[4], r[9], s[3], worst = 0;
        char *at = strchr(line, ',');
        for (int i = 0; i < 24; i++)
            v[i] = strtod(at + 1, &at);
        cn_polar_values(v, q, s);
        cn_quaternion_matrix(q, r);
        assert_proper(r);
        assert_true(fabs(trace_transposed_times(r, v) - (v[18] + v[19] + v[20])) <= 1e-12 * v[18]);
        for (int i = 0; i < 3; i++)
            assert_true(fabs(s[i] - v[18 + i]) <= 1e-14 * v[18]);
        for (int i = 0; i < 9; i++)
            worst = fmax(worst, fabs(r[i] - v[9 + i]));
        if (v[21] == 1) assert_true(worst <= v[23]);
    }
    fclose(file);
}

static void a_scaled_matrix_has_the_same_rotation(void **state)
{
    (void)state;
    const double f[9] = {1.2, 0.3, -0.1, 0.4, -0.8, 0.2, 0.1, 0.6, 0.9};
    double q[4], turned[4], g[9];
    cn_polar(f, q);
    for (int power = -1000; power <= 1000; power += 100) {
        for (int i = 0; i < 9; i++)
            g[i] = ldexp(f[i], power);
        cn_polar(g, turned);
        assert_memory_equal(q, turned, sizeof q);
    }
}

static void what_has_no_rotation_gives_the_identity(void **state)
{
    (void)state;
    double f[9] = {0}, q[4];
    cn_polar(f, q);
    assert_true(q[0] == 1 && q[1] == 0 && q[2] == 0 && q[3] == 0);
    for (int i = 0; i < 9; i++) {
        const double bad[] = {NAN, INFINITY, -INFINITY};
        for (int k = 0; k < 3; k++) {
            double g[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
            g[i] = bad[k];
            cn_polar(g, q);
            assert_true(q[0] == 1 && q[1] == 0 && q[2] == 0 && q[3] == 0);
        }
    }
}

static void any_matrix_of_small_integers_reaches_the_largest_trace(void **state)
{
    (void)state;
    for (int code = 0; code < 19683; code++) { /* 3^9: many of rank one and two, many reflections */
        double f[9], q[4], r[9], s[3];
        for (int i = 0, c = code; i < 9; i++, c /= 3)
            f[i] = c % 3 - 1;
        cn_polar_values(f, q, s);
        cn_quaternion_matrix(q, r);
        assert_proper(r);
        assert_true(fabs(trace_transposed_times(r, f) - (s[0] + s[1] + s[2])) <= 1e-14 * (1 + s[0]));
        assert_true(s[0] >= s[1] && s[1] >= fabs(s[2]) * (1 - 1e-14) - 1e-15);
        assert_true(fabs(s[0] * s[1] * s[2] - cn_det(f)) < 1e-13);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hard_matrices_have_their_nearest_rotation),
        cmocka_unit_test(a_scaled_matrix_has_the_same_rotation),
        cmocka_unit_test(what_has_no_rotation_gives_the_identity),
        cmocka_unit_test(any_matrix_of_small_integers_reaches_the_largest_trace),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
