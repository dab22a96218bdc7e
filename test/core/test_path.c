#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "catnav/path.h"
#include "catnav/vec3.h"

static const double pi = 3.14159265358979323846;

/* A helix of radius r and pitch 2 pi c, n points over `turns` turns. */
static cn_path *helix(int n, double r, double c, double turns, const double *normal)
{
    double *x = malloc(3 * (size_t)n * sizeof *x);
    for (int i = 0; i < n; i++) {
        const double a = 2 * pi * turns * i / (n - 1);
        x[3 * i] = r * cos(a), x[3 * i + 1] = r * sin(a), x[3 * i + 2] = c * a;
    }
    cn_path *path;
    const int waypoint[2] = {0, n - 1};
    assert_int_equal(cn_path_new(&path, n, x, 2, waypoint, normal), CN_OK);
    free(x);
    return path;
}

static void a_straight_path_keeps_its_frame_and_goes_on_beyond_its_ends(void **state)
{
    (void)state;
    const double x[9] = {0, 0, 0, 0, 0, 1, 0, 0, 3}, normal[3] = {2, 0, 5};
    cn_path *path;
    cn_place place;
    assert_int_equal(cn_path_new(&path, 3, x, 0, NULL, normal), CN_OK);
    assert_true(cn_path_length(path) == 3);
    const double s[4] = {-2, 0.5, 3, 7};
    for (int i = 0; i < 4; i++) {
        cn_path_at(path, s[i], &place);
        assert_true(fabs(place.x[2] - s[i]) < 1e-15 && place.x[0] == 0 && place.t[2] == 1);
        assert_true(place.n[0] == 1 && place.b[1] == 1 && place.curvature == 0);
        assert_true(fabs(cn_path_project(path, (double[3]){4, -1, s[i]}, -10, 10) - s[i]) < 1e-14);
    }
    assert_true(cn_path_project(path, (double[3]){0, 0, 2}, -1, 0.25) == 0.25); /* held by the window */
    assert_true(cn_path_turn(path, 0.5, NULL) < 1e-15);
    cn_path_free(path);
}

static void a_circle_has_its_radius_and_the_turn_of_its_chords(void **state)
{
    (void)state;
    const double r = 0.02;
    double where;
    cn_path *path = helix(401, r, 0, 0.5, NULL);
    cn_place place;
    cn_path_at(path, 0.3 * cn_path_length(path), &place);
    assert_true(fabs(place.curvature * r - 1) < 1e-9);
    assert_true(fabs(cn_dot(place.t, place.x)) < 1e-5 * r);
    /* chords over an arc s turn by s / r */
    assert_true(fabs(cn_path_turn(path, 0.1 * r, &where) - 0.1) < 1e-3);
    cn_path_free(path);
}

static void a_frame_turns_about_a_helix_by_its_total_torsion(void **state)
{
    (void)state;
    /* the rotation-minimising normal lags the Frenet normal by the integral of the torsion,
     * c / (r^2 + c^2) times the length (Bishop 1975); the error falls with the fourth power of the step */
    const double r = 1, c = 0.4, turns = 1.25, normal[3] = {-1, 0, 0};
    double error[2];
    for (int k = 0; k < 2; k++) {
        cn_path *path = helix(k ? 801 : 401, r, c, turns, normal);
        const int mid = path->n / 5, end = path->n - 1 - mid;
        double angle[2];
        for (int e = 0; e < 2; e++) {
            const int i = e ? end : mid;
            const double a = 2 * pi * turns * i / (path->n - 1), main[3] = {-cos(a), -sin(a), 0};
            double side[3];
            cn_cross(path->tangent + 3 * i, main, side);
            angle[e] = atan2(cn_dot(path->normal + 3 * i, side), cn_dot(path->normal + 3 * i, main));
        }
        const double arc = 2 * pi * turns * (end - mid) / (path->n - 1);
        const double torsion = c / sqrt(r * r + c * c) * arc;
        error[k] = fabs(remainder(angle[1] - angle[0] + torsion, 2 * pi));
        cn_path_free(path);
    }
    assert_true(error[0] < 2e-4 && error[1] < 0.3 * error[0] + 1e-9);
}

static void frames_stay_orthonormal_and_follow_a_rigid_motion(void **state)
{
    (void)state;
    const double normal[3] = {0, 0, 1}, w[3] = {0.3, -1.1, 0.7};
    double rotation[9], turned[3], y[3 * 60], n0[3];
    cn_rotation(w, rotation);
    cn_path *path = helix(60, 0.01, 0.004, 2, normal), *moved;
    for (int i = 0; i < 60; i++)
        cn_mat_vec(rotation, path->x + 3 * i, y + 3 * i);
    cn_mat_vec(rotation, normal, n0);
    assert_int_equal(cn_path_new(&moved, 60, y, 0, NULL, n0), CN_OK);
    for (double s = -0.01; s < cn_path_length(path) + 0.01; s += 0.0013) {
        cn_place a, b;
        cn_path_at(path, s, &a), cn_path_at(moved, s, &b);
        assert_true(fabs(cn_dot(a.t, a.n)) + fabs(cn_dot(a.t, a.b)) + fabs(cn_dot(a.n, a.b)) < 1e-14);
        assert_true(fabs(cn_norm(a.t) - 1) + fabs(cn_norm(a.n) - 1) + fabs(cn_norm(a.b) - 1) < 1e-14);
        cn_mat_vec(rotation, a.n, turned);
        assert_true(cn_distance(turned, b.n) < 1e-12);
        assert_true(fabs(a.curvature - b.curvature) < 1e-9 * a.curvature + 1e-12);
    }
    cn_path_free(path), cn_path_free(moved);
}

static void a_corner_turns_by_its_angle_wherever_its_points_lie(void **state)
{
    (void)state;
    const double a = pi / 3, c = cos(a), s = sin(a);
    const double x[15] = {-2, 0, 0, -0.3, 0, 0, 0, 0, 0, 0.1 * c, 0.1 * s, 0, 2 * c, 2 * s, 0};
    cn_path *path;
    double where;
    assert_int_equal(cn_path_new(&path, 5, x, 0, NULL, NULL), CN_OK);
    assert_true(fabs(cn_path_turn(path, 0.37, &where) - a) < 1e-12);
    assert_true(fabs(where - 2) < 1e-12);
    assert_true(fabs(cn_path_turn(path, 100, NULL) - a) < 1e-12); /* a chord too long is half the path */
    cn_path_free(path);
}

static void two_close_corners_add_up_and_far_ones_do_not(void **state)
{
    (void)state;
    const double d = 0.1, x[12] = {-2, 0, 0, 0, 0, 0, 0, d, 0, -2, d, 0}; /* a hairpin of width d */
    cn_path *path;
    assert_int_equal(cn_path_new(&path, 4, x, 0, NULL, NULL), CN_OK);
    assert_true(cn_path_turn(path, 1, NULL) > 0.9 * pi);
    assert_true(fabs(cn_path_turn(path, 0.01, NULL) - pi / 2) < 1e-9);
    cn_path_free(path);
}

static void results_do_not_depend_on_the_unit(void **state)
{
    (void)state;
    cn_path *m = helix(50, 0.01, 0.003, 1, NULL), *mm = helix(50, 10, 3, 1, NULL);
    assert_true(fabs(cn_path_turn(m, 0.004, NULL) - cn_path_turn(mm, 4, NULL)) < 1e-10);
    const double p[3] = {0.004, 0.009, 0.002}, q[3] = {4, 9, 2};
    assert_true(fabs(1000 * cn_path_project(m, p, 0, 1) - cn_path_project(mm, q, 0, 1000)) < 1e-9);
    cn_path_free(m), cn_path_free(mm);
}

static void repeated_points_do_no_harm(void **state)
{
    (void)state;
    const double x[18] = {0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1, 1, 0, 1, 1, 0};
    cn_path *path;
    assert_int_equal(cn_path_new(&path, 6, x, 0, NULL, NULL), CN_OK);
    for (int i = 0; i < 6; i++) {
        assert_true(fabs(cn_norm(path->tangent + 3 * i) - 1) < 1e-14);
        assert_true(fabs(cn_norm(path->normal + 3 * i) - 1) < 1e-14);
        assert_true(fabs(cn_dot(path->normal + 3 * i, path->tangent + 3 * i)) < 1e-14);
    }
    assert_true(fabs(cn_path_turn(path, 0.5, NULL) - pi / 2) < 1e-12);
    cn_path_free(path);
}

static void a_copy_is_equal_and_its_own(void **state)
{
    (void)state;
    cn_path *path = helix(20, 1, 0.2, 1, NULL), *copy;
    path->turn_max = 0.25, path->clearance[3] = 7;
    assert_int_equal(cn_path_copy(&copy, path), CN_OK);
    assert_true(copy->turn_max == 0.25 && copy->clearance[3] == 7 && copy->waypoint[1] == 19);
    assert_memory_equal(copy->normal, path->normal, 60 * sizeof(double));
    assert_ptr_not_equal(copy->x, path->x);
    cn_path_free(path), cn_path_free(copy), cn_path_free(NULL);
}

static void what_is_no_path_is_refused(void **state)
{
    (void)state;
    double x[6] = {0, 0, 0, 1, 0, 0};
    const int waypoint = 2;
    cn_path *path;
    assert_int_equal(cn_path_new(&path, 1, x, 0, NULL, NULL), CN_ERR_ARG);
    assert_int_equal(cn_path_new(&path, 2, x, 1, &waypoint, NULL), CN_ERR_ARG);
    x[3] = NAN;
    assert_int_equal(cn_path_new(&path, 2, x, 0, NULL, NULL), CN_ERR_NOT_FINITE);
    x[3] = 0; /* no length */
    assert_int_equal(cn_path_new(&path, 2, x, 0, NULL, NULL), CN_ERR_ARG);
    assert_null(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_straight_path_keeps_its_frame_and_goes_on_beyond_its_ends),
        cmocka_unit_test(a_circle_has_its_radius_and_the_turn_of_its_chords),
        cmocka_unit_test(a_frame_turns_about_a_helix_by_its_total_torsion),
        cmocka_unit_test(frames_stay_orthonormal_and_follow_a_rigid_motion),
        cmocka_unit_test(a_corner_turns_by_its_angle_wherever_its_points_lie),
        cmocka_unit_test(two_close_corners_add_up_and_far_ones_do_not),
        cmocka_unit_test(results_do_not_depend_on_the_unit),
        cmocka_unit_test(repeated_points_do_no_harm),
        cmocka_unit_test(a_copy_is_equal_and_its_own),
        cmocka_unit_test(what_is_no_path_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
