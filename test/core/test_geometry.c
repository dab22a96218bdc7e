/* Tests of geometry.c, geometry_meet.c and predicates.c: exact reference tables, symmetries, units, closed
 * forms. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include "catnav/vec3.h"
#include "geometry.h"
#include "read_csv.h"

#define EACH(table, file, row)                                                                               \
    csv table;                                                                                               \
    if (!csv_read(&table, file)) skip();                                                                     \
    for (int row = 0; row < table.nrow; row++)

#define at(x, k) x[(k) / 3][(k) % 3] /* k-th coordinate of a list of points */

static const int order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
static const double unit[] = {1, 1e-3, 1e6, 1e-9}; /* the same place in other units */
enum { NUNIT = sizeof unit / sizeof *unit };

static uint64_t seed = 1;
static double uniform(void) /* (-1, 1), the same in every run */
{
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(int64_t)(seed >> 11 << 11) / 9223372036854775808.0;
}

static double extent(const double *x, int n) /* longest side of the box of n points, 1 for none */
{
    double side = 0;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                side = fmax(side, x[3 * i + k] - x[3 * j + k]);
    return side > 0 ? side : 1;
}

static void orientation_is_that_of_a_right_handed_frame(void **state)
{
    const double o[3] = {0, 0, 0}, x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, below[3] = {0, 0, -1},
                 above[3] = {0, 0, 1};
    const double p[2] = {0, 0}, q[2] = {1, 0}, r[2] = {0, 1};
    (void)state;
    assert_int_equal(cn_orient3d(o, x, y, below), 1);
    assert_int_equal(cn_orient3d(o, x, y, above), -1);
    assert_int_equal(cn_orient3d(o, x, y, o), 0);
    assert_int_equal(cn_orient2d(p, q, r), 1);
    assert_int_equal(cn_orient2d(p, r, q), -1);
}

static void a_point_one_ulp_off_a_tilted_plane_is_seen_on_its_side(void **state)
{
    (void)state;
    for (int i = 0; i < 20000; i++) { /* plane z = x + y, exact on the grid of 2^-20 */
        double p[4][3];
        for (int j = 0; j < 4; j++) {
            p[j][0] = ldexp(floor(ldexp(uniform(), 20)), -20) + 3,
            p[j][1] = ldexp(floor(ldexp(uniform(), 20)), -20);
            p[j][2] = p[j][0] + p[j][1];
        }
        const int area = cn_orient2d(p[0], p[1], p[2]);
        assert_int_equal(cn_orient3d(p[0], p[1], p[2], p[3]), 0);
        p[3][2] = nextafter(p[3][2], -INFINITY);
        assert_int_equal(cn_orient3d(p[0], p[1], p[2], p[3]), area);
        p[3][2] = nextafter(nextafter(p[3][2], INFINITY), INFINITY);
        assert_int_equal(cn_orient3d(p[0], p[1], p[2], p[3]), -area);
    }
}

static void orientation_changes_sign_with_every_swap(void **state)
{
    (void)state;
    for (int i = 0; i < 5000; i++) {
        double p[4][3]; /* on a coarse grid, some with a hair added: many zeros and many close calls */
        for (int j = 0; j < 12; j++)
            p[j / 3][j % 3] = floor(4 * uniform()) + (uniform() > 0.5 ? ldexp(uniform(), -60) : 0);
        const int sign = cn_orient3d(p[0], p[1], p[2], p[3]), flat = cn_orient2d(p[0], p[1], p[2]);
        assert_int_equal(cn_orient3d(p[1], p[0], p[2], p[3]), -sign);
        assert_int_equal(cn_orient3d(p[3], p[1], p[2], p[0]), -sign);
        assert_int_equal(cn_orient3d(p[0], p[3], p[2], p[1]), -sign);
        assert_int_equal(cn_orient3d(p[2], p[3], p[0], p[1]), sign);
        assert_int_equal(cn_orient2d(p[1], p[2], p[0]), flat);
        assert_int_equal(cn_orient2d(p[1], p[0], p[2]), -flat);
    }
}

static void neither_the_smallest_nor_the_largest_doubles_lose_the_sign(void **state)
{
    const double scale[] = {1, 5e-324, 1e-200, 1e-120, 1e120, 1e200, 4e307};
    (void)state;
    for (int i = 0; i < (int)(sizeof scale / sizeof *scale); i++)
        for (int j = 0; j < (int)(sizeof scale / sizeof *scale); j++) {
            const double s = scale[i], h = scale[j];
            const double a[3] = {-s, -s, 0}, b[3] = {s, -s, 0}, c[3] = {0, s, 0}, up[3] = {0, 0, h};
            const double down[3] = {0, 0, -h};
            assert_int_equal(cn_orient3d(a, b, c, up), -1);
            assert_int_equal(cn_orient3d(a, b, c, down), 1);
            assert_int_equal(cn_orient2d(a, b, c), 1);
        }
}

static void what_is_not_finite_has_no_sign(void **state)
{
    const double bad[] = {NAN, INFINITY, -INFINITY};
    (void)state;
    for (int i = 0; i < 3; i++) {
        const double a[3] = {bad[i], 0, 0}, b[3] = {1, 0, 0}, c[3] = {0, 1, 0}, d[3] = {0, 0, 1};
        assert_int_equal(cn_orient3d(a, b, c, d), 0);
        assert_int_equal(cn_orient2d(a, b, c), 0);
    }
}

static cn_tri_meet wanted_meet(const char *text)
{
    return !strcmp(text, "cross") ? CN_TRI_CROSS : !strcmp(text, "touch") ? CN_TRI_TOUCH : CN_TRI_APART;
}

static void triangle_pairs_meet_as_exact_arithmetic_says_in_every_order(void **state)
{
    (void)state;
    EACH(table, "data/triangle_pairs.csv", row)
    {
        double x[6][3];
        csv_numbers(&table, row, "a0x", 18, x[0]);
        const cn_tri_meet want = wanted_meet(csv_text(&table, row, "separation"));
        for (int i = 0; i < 36; i++) {
            double a[3][3], b[3][3];
            for (int k = 0; k < 3; k++)
                cn_copy3(x[order[i / 6][k]], a[k]), cn_copy3(x[3 + order[i % 6][k]], b[k]);
            assert_int_equal(cn_tri_tri(a, b), want);
            assert_int_equal(cn_tri_tri(b, a), want);
        }
        const double near = cn_tri_tri_distance((const double(*)[3])x, (const double(*)[3])(x + 3));
        const double far = csv_number(&table, row, "distance"),
                     bar = strcmp(csv_text(&table, row, "family"), "sliver");
        assert_true(fabs(near - far) <= (bar ? 1e-12 : 1e-9) * extent(x[0], 6));
    }
    csv_free(&table);
}

static void triangle_pairs_meet_alike_in_every_unit(void **state)
{
    (void)state;
    EACH(table, "data/triangle_pairs.csv", row)
    {
        const double size = csv_number(&table, row, "distance");
        double x[6][3], y[6][3];
        csv_numbers(&table, row, "a0x", 18, x[0]);
        const cn_tri_meet want = wanted_meet(csv_text(&table, row, "separation"));
        for (int i = -40; i <= 40; i += 8) { /* powers of two are exact: the very same answer */
            bool same = true;                /* but where hairs sink below the least double */
            for (int k = 0; k < 18; k++)
                at(y, k) = ldexp(at(x, k), i), same = same && ldexp(at(y, k), -i) == at(x, k);
            if (same) assert_int_equal(cn_tri_tri((const double(*)[3])y, (const double(*)[3])(y + 3)), want);
        }
        for (int i = 1; i < NUNIT; i++) { /* others round the input: what is clear stays clear */
            for (int k = 0; k < 18; k++)
                at(y, k) = at(x, k) * unit[i];
            const cn_tri_meet got = cn_tri_tri((const double(*)[3])y, (const double(*)[3])(y + 3));
            if (want == CN_TRI_APART && size > 1e-9 * extent(x[0], 6)) assert_int_equal(got, CN_TRI_APART);
            if (want == CN_TRI_CROSS && !strcmp(csv_text(&table, row, "family"), "random"))
                assert_int_equal(got, CN_TRI_CROSS);
        }
    }
    csv_free(&table);
}

static void closest_points_of_triangles_are_the_exact_ones(void **state)
{
    (void)state;
    EACH(table, "data/point_triangle_closest.csv", row)
    {
        double x[4][3], q[3], bary[3];
        csv_numbers(&table, row, "t0x", 12, x[0]), csv_numbers(&table, row, "qx", 3, q);
        const double want = csv_number(&table, row, "distance"), size = extent(x[0], 4);
        const double bar = strcmp(csv_text(&table, row, "family"), "sliver") ? 1e-12 : 1e-9;
        for (int i = 0; i < 6; i++)
            for (int u = 0; u < NUNIT; u++) {
                double y[4][3];
                for (int j = 0; j < 4; j++)
                    for (int k = 0; k < 3; k++)
                        y[j][k] = unit[u] * x[j < 3 ? order[i][j] : 3][k];
                const double got = cn_point_triangle(y[3], y[0], y[1], y[2], bary) / unit[u];
                const double rounding = u ? 4e-16 * cn_norm(x[3]) : 0; /* of the coordinates in other units */
                assert_true(fabs(got - want) <= bar * size + rounding);
                assert_true(bary[0] >= -1e-15 && bary[1] >= 0 && bary[2] >= 0);
                for (int k = 0; k < 3; k++) {
                    const double place = bary[0] * y[0][k] + bary[1] * y[1][k] + bary[2] * y[2][k];
                    assert_true(fabs(place / unit[u] - q[k]) <= sqrt(bar) * size + 4e-15 * cn_norm(x[3]));
                }
            }
    }
    csv_free(&table);
}

static void distances_of_edges_are_the_exact_ones(void **state)
{
    (void)state;
    EACH(table, "data/edge_edge_distance.csv", row)
    {
        double x[4][3], s, t;
        csv_numbers(&table, row, "px", 12, x[0]);
        const double want = csv_number(&table, row, "distance"), size = extent(x[0], 4);
        for (int i = 0; i < 8; i++)
            for (int u = 0; u < NUNIT; u++) {
                const int swap = i & 1, turn_a = i >> 1 & 1, turn_b = i >> 2 & 1;
                double y[4][3];
                for (int k = 0; k < 3; k++) {
                    y[0][k] = unit[u] * x[2 * swap + turn_a][k], y[1][k] = unit[u] * x[2 * swap + !turn_a][k];
                    y[2][k] = unit[u] * x[2 * !swap + turn_b][k],
                    y[3][k] = unit[u] * x[2 * !swap + !turn_b][k];
                }
                const double got = cn_edge_edge(y[0], y[1], y[2], y[3], &s, &t);
                assert_true(fabs(got / unit[u] - want) <= 1e-12 * size);
                assert_true(s >= 0 && s <= 1 && t >= 0 && t <= 1);
                for (int k = 0; k < 3; k++) /* the parameters give that distance */
                    y[0][k] += s * (y[1][k] - y[0][k]) - (y[2][k] + t * (y[3][k] - y[2][k]));
                assert_true(fabs(cn_norm(y[0]) - got) <= 1e-14 * size * unit[u]);
            }
    }
    csv_free(&table);
}

static void motions_meet_never_late_and_hardly_early(void **state)
{
    (void)state;
    EACH(table, "data/ccd.csv", row)
    {
        double x[8][3], d[4][3];
        csv_numbers(&table, row, "s0x", 24, x[0]);
        const bool vf = !strcmp(csv_text(&table, row, "kind"), "vf"),
                   hit = csv_number(&table, row, "hit") != 0;
        const char *family = csv_text(&table, row, "family");
        const double first = csv_number(&table, row, "first_time"), size = extent(x[0], 8);
        const double least = csv_number(&table, row, "least_sampled_distance_if_miss");
        for (int u = 0; u < NUNIT; u++) {
            double y[4][3];
            for (int k = 0; k < 12; k++)
                at(y, k) = unit[u] * at(x, k), at(d, k) = unit[u] * at(x, 12 + k) - at(y, k);
            if (u && !strncmp(family, "ends in", 7))
                continue; /* other units round the end away from the contact */
            const double t = (vf ? cn_ccd_point_triangle : cn_ccd_edge_edge)((const double(*)[3])y,
                                                                             (const double(*)[3])d, 0);
            if (hit) {
                if (!(t <= first + 1e-12) || !(t >= first - 1e-6 || !strcmp(family, "no motion")))
                    fail_msg("row %d, %s: %.17g instead of %.17g", row, family, t, first);
            } else if (least > 1e-6 * size && !(t > 1))
                fail_msg("row %d, %s: false hit at %.17g", row, family, t);
        }
    }
    csv_free(&table);
}

/* Distance of the moving pieces at time t. */
static double distance_at(const double x[4][3], const double d[4][3], double t, bool vf)
{
    double y[4][3];
    for (int k = 0; k < 12; k++)
        y[k / 3][k % 3] = x[k / 3][k % 3] + t * d[k / 3][k % 3];
    return vf ? cn_point_triangle(y[0], y[1], y[2], y[3], NULL)
              : cn_edge_edge(y[0], y[1], y[2], y[3], NULL, NULL);
}

static void random_motions_keep_the_gap_until_the_time_given_and_reach_it_there(void **state)
{
    (void)state;
    seed = 7;
    for (int i = 0; i < 20000; i++) {
        double x[4][3], d[4][3];
        const bool vf = i % 2;
        const double gap = i % 3 ? 0.3 * fabs(uniform()) : 1e-3, near = i % 5 ? 1 : 0.05;
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 3; k++)
                x[j][k] = uniform() * (i % 7 || k != 2 ? 1 : 1e-5), d[j][k] = near * 2 * uniform();
        const double t = vf ? cn_ccd_point_triangle(x, d, gap) : cn_ccd_edge_edge(x, d, gap),
                     end = fmin(t, 1);
        for (int k = 0; k <= 20 && t > 0; k++)
            assert_true(distance_at(x, d, end * k / 20, vf) >= gap);
        if (t > 1) continue;
        double later = INFINITY; /* no later than 1e-6 the gap is reached, up to rounding */
        for (int k = 0; k <= 20; k++)
            later = fmin(later, distance_at(x, d, t + 1e-6 * k / 20, vf));
        assert_true(later <= gap + 1e-14);
    }
}

static void a_way_that_all_but_grazes_the_gap_is_told_from_one_that_does(void **state)
{
    (void)state;
    for (int i = 0; i < 200; i++) { /* a point passes the corner of a turning triangle at height 1 */
        const double gap = 0.5 + 0.4 * i / 200, miss = i % 2 ? 1e-9 : -1e-9;
        const double x[4][3] = {{-1, 0, gap + miss}, {0}, {1, 1, -2}, {1, -1, -2}};
        const double d[4][3] = {{2, 0, 0}, {0}, {-0.1, 0, 0.2}, {0.2, 0, 0.1}};
        const double t = cn_ccd_point_triangle(x, d, gap), first = 0.5 - 0.5 * sqrt(2 * gap * 1e-9);
        if (miss > 0)
            assert_true(isinf(t));
        else
            assert_true(t <= first + 1e-9 && t >= first - 1e-6);
    }
}

static void a_point_falling_on_a_triangle_arrives_when_it_should(void **state)
{
    (void)state;
    for (int u = 0; u < NUNIT; u++) { /* height 2, way 4, gap 0.5: t = 1.5 / 4 */
        const double m = unit[u], x[4][3] = {{0.2 * m, 0.2 * m, 2 * m}, {0}, {m, 0, 0}, {0, m, 0}};
        const double down[4][3] = {{0, 0, -4 * m}}, aside[4][3] = {{4 * m, 0, 0}};
        const double t = cn_ccd_point_triangle(x, down, 0.5 * m);
        assert_true(t <= 0.375 && t > 0.375 - 1e-12);
        assert_true(isinf(cn_ccd_point_triangle(x, aside, 0.5 * m)));
        assert_true(cn_ccd_point_triangle(x, aside, 2 * m) == 0); /* starts within the gap */
    }
}

static void crossed_edges_turning_towards_each_other_arrive_when_they_should(void **state)
{
    /* edge 2 3 sinks from z = 1 at one end only: it meets edge 0 1 below its middle when the middle is at 0
     */
    const double x[4][3] = {{-1, 0, 0}, {1, 0, 0}, {0, -1, 1}, {0, 1, 1}}, d[4][3] = {[3] = {0, 0, -4}};
    const double t = cn_ccd_edge_edge(x, d, 0);
    (void)state;
    assert_true(t <= 0.5 && t > 0.5 - 1e-12);
}

static void parallel_edges_and_points_as_triangles_are_no_trouble(void **state)
{
    const double x[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {1, 0, 1}},
                 fall[4][3] = {[2] = {0, 0, -2}, {0, 0, -2}};
    const double p[4][3] = {{0, 0, 1}}, down[4][3] = {{0, 0, -2}}, still[4][3] = {{0}};
    (void)state;
    assert_true(fabs(cn_ccd_edge_edge(x, fall, 0) - 0.5) < 1e-12);
    assert_true(fabs(cn_ccd_point_triangle(p, down, 0) - 0.5) < 1e-12);
    assert_true(isinf(cn_ccd_point_triangle(p, still, 0)));
    assert_true(cn_ccd_point_triangle(still, down, 0) == 0);
    assert_true(cn_point_triangle(p[0], p[1], p[2], p[3], NULL) == 1);
    assert_true(cn_edge_edge(p[0], p[0], p[1], p[1], NULL, NULL) == 1);
}

static void motions_that_are_not_finite_are_never_called_free(void **state)
{
    const double bad[] = {NAN, INFINITY, -INFINITY};
    (void)state;
    for (int i = 0; i < 24; i++)
        for (int j = 0; j < 3; j++) {
            double x[4][3] = {{5, 5, 5}, {0}, {1, 0, 0}, {0, 1, 0}}, d[4][3] = {{0, 0, 0.1}};
            (i < 12 ? x : d)[i % 12 / 3][i % 3] = bad[j];
            assert_true(cn_ccd_point_triangle(x, d, 0) == 0 && cn_ccd_edge_edge(x, d, 0) == 0);
        }
    const double x[4][3] = {{5, 5, 5}, {0}, {1, 0, 0}, {0, 1, 0}}, d[4][3] = {{0}};
    assert_true(cn_ccd_point_triangle(x, d, NAN) == 0 && cn_ccd_point_triangle(x, d, -1) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(orientation_is_that_of_a_right_handed_frame),
        cmocka_unit_test(a_point_one_ulp_off_a_tilted_plane_is_seen_on_its_side),
        cmocka_unit_test(orientation_changes_sign_with_every_swap),
        cmocka_unit_test(neither_the_smallest_nor_the_largest_doubles_lose_the_sign),
        cmocka_unit_test(what_is_not_finite_has_no_sign),
        cmocka_unit_test(triangle_pairs_meet_as_exact_arithmetic_says_in_every_order),
        cmocka_unit_test(triangle_pairs_meet_alike_in_every_unit),
        cmocka_unit_test(closest_points_of_triangles_are_the_exact_ones),
        cmocka_unit_test(distances_of_edges_are_the_exact_ones),
        cmocka_unit_test(motions_meet_never_late_and_hardly_early),
        cmocka_unit_test(random_motions_keep_the_gap_until_the_time_given_and_reach_it_there),
        cmocka_unit_test(a_way_that_all_but_grazes_the_gap_is_told_from_one_that_does),
        cmocka_unit_test(a_point_falling_on_a_triangle_arrives_when_it_should),
        cmocka_unit_test(crossed_edges_turning_towards_each_other_arrive_when_they_should),
        cmocka_unit_test(parallel_edges_and_points_as_triangles_are_no_trouble),
        cmocka_unit_test(motions_that_are_not_finite_are_never_called_free),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
