/* LINK: wrap */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/bezier.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "shapes.h"

static void basis_functions_are_positive_and_sum_to_one(void **state)
{
    (void)state;
    static double basis[CN_BEZIER_POINTS];
    for (int count = 1; count <= CN_BEZIER_POINTS; count = count * 2 + (count == 1 ? 2 : 0))
        for (int i = 0; i <= 20; i++) {
            double sum = 0, mean = 0;
            cn_bezier_basis(count, i / 20.0, basis);
            for (int k = 0; k < count; k++) {
                assert_true(basis[k] >= 0);
                sum += basis[k], mean += k * basis[k];
            }
            assert_true(fabs(sum - 1) < 1e-13);
            assert_true(fabs(mean - (count - 1) * i / 20.0) < 1e-12 * count); /* linear functions are kept */
        }
    cn_bezier_basis(4, 0.25, basis);
    const double cubic[4] = {0.421875, 0.421875, 0.140625, 0.015625};
    for (int k = 0; k < 4; k++)
        assert_true(basis[k] == cubic[k]);
}

/* The paper's printed sum starts at k = 1: a curve then begins at the origin. */
static void a_curve_begins_and_ends_in_its_end_points(void **state)
{
    (void)state;
    double p[3 * 12], x[3], tangent[3];
    unsigned seed = 1;
    for (int i = 0; i < 36; i++)
        p[i] = 5 + shape_random(&seed);
    for (int count = 1; count <= 12; count++) {
        cn_bezier_curve(count, p, 0, x, tangent);
        assert_memory_equal(x, p, sizeof x);
        for (int k = 0; k < 3 && count > 1; k++)
            assert_true(fabs(tangent[k] - (count - 1) * (p[3 + k] - p[k])) < 1e-13);
        cn_bezier_curve(count, p, 1, x, NULL);
        assert_memory_equal(x, p + 3 * (count - 1), sizeof x);
    }
}

static void control_points_on_a_line_give_the_line(void **state)
{
    (void)state;
    double p[3 * 9], x[3], tangent[3];
    for (int i = 0; i < 9; i++)
        p[3 * i] = 1 + i, p[3 * i + 1] = 2 - 3 * i, p[3 * i + 2] = 0.5 * i;
    for (int i = 0; i <= 10; i++) {
        const double at = 0.8 * i;
        cn_bezier_curve(9, p, i / 10.0, x, tangent);
        assert_true(fabs(x[0] - (1 + at)) < 1e-13 && fabs(x[1] - (2 - 3 * at)) < 1e-13 &&
                    fabs(x[2] - 0.5 * at) < 1e-13);
        assert_true(fabs(tangent[0] - 8) < 1e-12 && fabs(tangent[1] + 24) < 1e-12);
    }
}

static void control_net(int nu, int nv, double *p)
{
    unsigned seed = 9;
    for (int i = 0; i < nu; i++)
        for (int j = 0; j < nv; j++, p += 3)
            p[0] = i + 0.2 * shape_random(&seed), p[1] = j + 0.2 * shape_random(&seed),
            p[2] = shape_random(&seed);
}

static void a_surface_passes_through_its_corners(void **state)
{
    (void)state;
    double p[3 * 20], x[3];
    control_net(5, 4, p);
    for (int corner = 0; corner < 4; corner++) {
        cn_bezier_point(5, 4, p, corner & 1, corner >> 1, x, NULL);
        assert_memory_equal(x, p + 3 * ((corner & 1) * 16 + (corner >> 1) * 3), sizeof x);
    }
}

static void normals_are_those_of_differences(void **state)
{
    (void)state;
    double p[3 * 30], x[4][3], a[3], b[3], n[3], normal[3];
    const double h = 1e-5;
    control_net(6, 5, p);
    for (int i = 1; i < 8; i++)
        for (int j = 1; j < 8; j++) {
            const double u = i / 8.0, v = j / 8.0;
            for (int k = 0; k < 4; k++)
                cn_bezier_point(6, 5, p, u + (k < 2 ? (k ? h : -h) : 0), v + (k > 1 ? (k > 2 ? h : -h) : 0),
                                x[k], NULL);
            cn_sub(x[1], x[0], a), cn_sub(x[3], x[2], b);
            cn_cross(a, b, n);
            cn_normalise(n);
            cn_bezier_point(6, 5, p, u, v, x[0], normal);
            assert_true(cn_distance(n, normal) < 1e-8);
        }
}

static void a_flat_net_has_one_normal_and_a_linear_one_its_plane(void **state)
{
    (void)state;
    double p[3 * 12];
    cn_bezier *z;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 3; j++)
            p[3 * (3 * i + j)] = 2 * i, p[3 * (3 * i + j) + 1] = j, p[3 * (3 * i + j) + 2] = 1 + i - 2 * j;
    assert_int_equal(cn_bezier_new(&z, 4, 3, 7, 5, NULL), CN_OK);
    double *x = malloc(3 * (size_t)z->nvert * sizeof *x), *normal = malloc(3 * (size_t)z->nvert * sizeof *x);
    cn_bezier_update(z, p, x, normal);
    double across[3] = {-0.5, 2, 1};
    cn_normalise(across);
    for (int v = 0; v < z->nvert; v++) {
        assert_true(fabs(x[3 * v] - 6.0 * (v / 6) / 7) < 1e-14 &&
                    fabs(x[3 * v + 1] - 2.0 * (v % 6) / 5) < 1e-14);
        assert_true(fabs(x[3 * v + 2] - (1 + x[3 * v] / 2 - 2 * x[3 * v + 1])) < 1e-14);
        assert_true(cn_distance(normal + 3 * v, across) < 1e-14);
    }
    free(x), free(normal);
    cn_bezier_free(z);
}

/* One sum after the other gives what the double sum does; triangles run about the normals. */
static void the_grid_is_the_double_sum(void **state)
{
    (void)state;
    enum { NU = 7, NV = 4 };
    double p[3 * NU * NV], y[3], n[3], a[3], b[3];
    cn_bezier *z;
    control_net(NU, NV, p);
    assert_int_equal(cn_bezier_new(&z, NU, NV, 30, 20, NULL), CN_OK);
    assert_int_equal(z->nvert, 31 * 21);
    assert_int_equal(z->ntri, 2 * 30 * 20);
    double *x = malloc(3 * (size_t)z->nvert * sizeof *x), *normal = malloc(3 * (size_t)z->nvert * sizeof *x);
    fail_alloc_at(-1);
    cn_bezier_update(z, p, x, normal);
    assert_int_equal(fail_alloc_count(), 0);
    for (int i = 0; i <= 30; i++)
        for (int j = 0; j <= 20; j++) {
            const int v = 21 * i + j;
            cn_bezier_point(NU, NV, p, i / 30.0, j / 20.0, y, n);
            assert_true(cn_distance(y, x + 3 * v) < 1e-14 * NU);
            assert_true(cn_distance(n, normal + 3 * v) < 1e-13);
        }
    for (int t = 0; t < z->ntri; t++) {
        const int *c = z->tri + 3 * t;
        cn_sub(x + 3 * c[1], x + 3 * c[0], a), cn_sub(x + 3 * c[2], x + 3 * c[0], b);
        cn_cross(a, b, n);
        assert_true(cn_dot(n, normal + 3 * c[0]) > 0);
    }
    free(x), free(normal);
    cn_bezier_free(z);
}

/* A row of one place is a pole: the normal is the limit from beside it. */
static void a_pole_has_the_normal_beside_it(void **state)
{
    (void)state;
    for (int side = 0; side < 4; side++) {
        double p[3 * 16], at[3], near[3], x[3];
        control_net(4, 4, p);
        for (int i = 0; i < 4; i++) /* row u = 0 or 1, column v = 0 or 1 */
            memcpy(p + 3 * (side < 2 ? 12 * side + i : 4 * i + 3 * (side - 2)), (double[]){1.5, 1.4, 2.3},
                   3 * sizeof *p);
        const double end = side % 2, beside = end ? 1 - 1e-6 : 1e-6;
        cn_bezier_point(4, 4, p, side < 2 ? end : 0.4, side < 2 ? 0.4 : end, x, at);
        cn_bezier_point(4, 4, p, side < 2 ? beside : 0.4, side < 2 ? 0.4 : beside, x, near);
        assert_true(fabs(cn_norm(at) - 1) < 1e-14);
        assert_true(cn_distance(at, near) < 1e-4);
    }
}

static void control_points_that_coincide_have_no_normal(void **state)
{
    (void)state;
    double p[3 * 9], x[3], n[3];
    for (int i = 0; i < 9; i++) /* all on a line: no area anywhere */
        p[3 * i] = i / 3, p[3 * i + 1] = 2 * (i / 3), p[3 * i + 2] = 1;
    for (int i = 0; i <= 4; i++) {
        cn_bezier_point(3, 3, p, i / 4.0, 0.3, x, n);
        assert_true(cn_norm(n) == 0);
        assert_true(fabs(x[1] - 2 * x[0]) < 1e-15);
    }
    for (int i = 0; i < 27; i++)
        p[i] = 0.1;
    cn_bezier_point(3, 3, p, 0.3, 0.3, x, n);
    assert_true(cn_norm(n) == 0);
    assert_true(fabs(x[0] - 0.1) < 1e-16);
}

static void nets_and_grids_out_of_range_are_refused(void **state)
{
    (void)state;
    const int bad[6][4] = {{1, 4, 3, 3}, {4, 0, 3, 3},  {4, 257, 3, 3},
                           {4, 4, 0, 3}, {4, 4, 3, -1}, {4, 4, 1 << 20, 1 << 20}};
    for (int i = 0; i < 6; i++) {
        cn_bezier *z = (cn_bezier *)&z;
        cn_error error = {0};
        assert_int_equal(cn_bezier_new(&z, bad[i][0], bad[i][1], bad[i][2], bad[i][3], &error), CN_ERR_ARG);
        assert_null(z);
        assert_non_null(strstr(error.message, "give"));
    }
    cn_bezier_free(NULL);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    for (FAIL_EACH_ALLOC) {
        cn_bezier *z;
        const cn_status status = cn_bezier_new(&z, 4, 5, 6, 7, NULL);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((z == NULL) == fail_alloc_fired());
        cn_bezier_free(z);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(basis_functions_are_positive_and_sum_to_one),
        cmocka_unit_test(a_curve_begins_and_ends_in_its_end_points),
        cmocka_unit_test(control_points_on_a_line_give_the_line),
        cmocka_unit_test(a_surface_passes_through_its_corners),
        cmocka_unit_test(normals_are_those_of_differences),
        cmocka_unit_test(a_flat_net_has_one_normal_and_a_linear_one_its_plane),
        cmocka_unit_test(the_grid_is_the_double_sum),
        cmocka_unit_test(a_pole_has_the_normal_beside_it),
        cmocka_unit_test(control_points_that_coincide_have_no_normal),
        cmocka_unit_test(nets_and_grids_out_of_range_are_refused),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
