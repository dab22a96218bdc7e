/* test_run_record.c - the figures a run leaves behind, against closed forms. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <unistd.h>
#include "catnav/vec3.h"
#include "run_parts.h"

/* A box of edges 3 x 2 x 1 by its corners: its diagonal is its size. */
static double box[24], size;

static int set_up(void **state)
{
    (void)state;
    for (int i = 0; i < 8; i++)
        box[3 * i] = 3 * (i & 1), box[3 * i + 1] = 2 * (i >> 1 & 1), box[3 * i + 2] = i >> 2;
    size = sqrt(14);
    return 0;
}

static void a_rigid_motion_changes_no_shape_in_any_unit(void **state)
{
    (void)state;
    const double pi = acos(-1.0), shift[3] = {5, -7, 11};
    const double turn[][3] = {
        {0, 0, 0}, {0.3, -0.2, 0.9}, {0, pi, 0}, {pi / sqrt(3), pi / sqrt(3), pi / sqrt(3)}};
    for (size_t t = 0; t < sizeof turn / sizeof *turn; t++)
        for (int unit = -150; unit <= 150; unit += 50) {
            const double metres = pow(10, unit);
            double r[9], x[24], rest[24];
            cn_rotation(turn[t], r);
            for (int i = 0; i < 8; i++) {
                cn_mat_vec(r, box + 3 * i, x + 3 * i);
                cn_axpy(1, shift, x + 3 * i);
            }
            for (int i = 0; i < 24; i++)
                x[i] *= metres, rest[i] = metres * box[i];
            assert_true(cn_shape_error(8, x, rest, metres * size) < 32 * DBL_EPSILON * cn_norm(shift));
        }
}

static void growth_and_reflection_are_shape_errors_of_known_size(void **state)
{
    (void)state;
    double x[24];
    for (int i = 0; i < 24; i++)
        x[i] = 1.5 * box[i];
    assert_true(fabs(cn_shape_error(8, x, box, size) - 0.25) < 1e-15); /* half of half a diagonal */
    for (int i = 0; i < 24; i++) /* mirrored across its thinnest direction: corners are an edge apart */
        x[i] = i % 3 == 2 ? -box[i] : box[i];
    assert_true(fabs(cn_shape_error(8, x, box, size) - 1 / size) < 1e-15);
}

static void all_points_in_one_are_half_a_diagonal_off_and_what_is_not_finite_has_no_error(void **state)
{
    (void)state;
    double x[24] = {0};
    assert_true(fabs(cn_shape_error(8, x, box, size) - 0.5) < 1e-15);
    x[7] = NAN;
    assert_true(isnan(cn_shape_error(8, x, box, size)));
    x[7] = INFINITY;
    assert_true(isnan(cn_shape_error(8, x, box, size)));
}

static void a_rod_spun_about_its_own_axis_has_the_momentum_and_energy_of_its_sections(void **state)
{
    (void)state;
    static const char text[] =
        "step: 0.001\ntime_limit: 0.005\nbodies:\n- name: bar\n  model: rod\n"
        "  shape: {beam: {size: [0.1, 0.01, 0.02], cells: [10, 1, 1]}}\n"
        "  material: {young: 1.0e+7, poisson: 0.3, density: 1000}\n  start: {spin: [10, 0, 0]}\n";
    char file[] = "test-record-XXXXXX";
    cn_scene *scene;
    cn_world *world;
    cn_report report;
    cn_error error = {0};
    const int made = mkstemp(file);
    assert_true(made >= 0);
    assert_int_equal(write(made, text, sizeof text - 1), sizeof text - 1);
    close(made);
    if (cn_scene_read(&scene, file, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
    unlink(file);
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    assert_int_equal(cn_run(world, NULL, NULL, 1, NULL, &report, &error), CN_OK);
    assert_int_equal(report.verdict.code, CN_VERDICT_RAN);
    const cn_body_report *b = report.body;
    const double spin = 10, moment = 1000 * 0.1 * 0.01 * 0.02 * (1e-4 + 4e-4) / 12; /* rho L (I_y + I_z) */
    assert_int_equal(b->model, CN_BODY_ROD);
    assert_true(fabs(b->angular_momentum[0] / (moment * spin) - 1) < 1e-12);
    assert_true(fabs(b->kinetic / (0.5 * moment * spin * spin) - 1) < 1e-12);
    assert_true(fabs(b->angular_momentum[1]) + fabs(b->angular_momentum[2]) < 1e-12 * moment * spin);
    assert_true(b->shape_error < 1e-12 && cn_norm(b->momentum) < 1e-15);
    assert_int_equal(report.counts.dof, 6 * 11);
    cn_report_clear(&report);
    cn_world_free(world);
    cn_scene_free(scene);
}

/* A quarter of a million steps, each a millisecond longer than the one before, and one that took long. */
static void a_long_run_holds_no_more_times_than_a_short_one(void **state)
{
    (void)state;
    enum { STEPS = 250000, LONG = 77777 };
    cn_scene scene = {0};
    cn_world world = {0};
    cn_report report = {0};
    cn_run_data run = {.report = &report, .scene = &scene, .world = &world};
    int most = 0;
    for (int i = 0; i < STEPS; i++) {
        const cn_step_figures figures = {.gap = INFINITY, .fem_s = 1, .collision_s = 2};
        assert_int_equal(cn_run_sample(&run, &figures, i == LONG ? 1e6 : 1e-3 * i), CN_OK);
        most = run.sample_capacity > most ? run.sample_capacity : most;
    }
    cn_run_finish(&run);
    assert_int_equal(run.nsample, STEPS);
    assert_true(most <= 1 << 15);
    assert_true(fabs(report.time.step_ms.median / (0.5 * STEPS) - 1) < 1e-3);
    assert_true(fabs(report.time.step_ms.p95 / (0.95 * STEPS) - 1) < 1e-3);
    assert_true(report.time.step_ms.max == 1e9);
    assert_true(report.time.fem_ms.median == 1e3 && report.time.collision_ms.max == 2e3);
    assert_true(fabs(report.time.step_ms_last100.median - (STEPS - 50.5)) < 1e-9);
    assert_true(fabs(report.time.step_ms_last100.max - (STEPS - 1)) < 1e-9);
    free(run.fem_ms), free(run.collision_ms), free(run.step_ms);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_rigid_motion_changes_no_shape_in_any_unit),
        cmocka_unit_test(growth_and_reflection_are_shape_errors_of_known_size),
        cmocka_unit_test(a_rod_spun_about_its_own_axis_has_the_momentum_and_energy_of_its_sections),
        cmocka_unit_test(all_points_in_one_are_half_a_diagonal_off_and_what_is_not_finite_has_no_error),
        cmocka_unit_test(a_long_run_holds_no_more_times_than_a_short_one),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
