/* test_drive_push.c - the push drive: what the base does arrives at the tip, a pre-bent end is steered,
 * limits of speed hold in every step, the base draws the device back, and what cannot be driven is refused.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "catnav/vec3.h"
#include "polar.h"
#include "run_parts.h"

static char file[] = "test-push-XXXXXX";
static const double pi = 3.14159265358979323846;

/* In the open, from the origin along z. */
static const char open_space[] = "step: 0.01\ntime_limit: 8\n"
                                 "bodies:\n- name: wire\n"
                                 "  shape: {catheter: {length: 0.2, diameter: 1.0e-3, stations: 101, sides: "
                                 "6, sheath: on, inserted: 0.02,\n"
                                 "    direction: [0, 0, 1]}}\n"
                                 "  model: rod\n"
                                 "  material: {young: 5.0e+7, poisson: 0.3, density: 1100, damping: 5}\n"
                                 "  drive: {mode: push, speed: 0.02, advance_max: 0.015, twist_max: 2, "
                                 "tip_bend: {length: 0.01, curvature: 20}}\n"
                                 "  waypoint_tolerance: 1.0e-3\n";

/* A tube of 4 mm radius, straight or with a quarter bend of 30 mm radius behind 40 mm. */
#define WIRE(model)                                                                                          \
    "bodies:\n- name: wire\n"                                                                                \
    "  shape: {catheter: {length: 0.16, diameter: 1.5e-3, stations: 81, sides: 6, direction: [0, 0, 1]}}\n"  \
    "  model: " model "\n"                                                                                   \
    "  material: {young: 2.0e+7, poisson: 0.3, density: 1100}\n"                                             \
    "  waypoint_tolerance: 3.0e-3\n"
static const char straight_tube[] =
    "step: 0.01\ntime_limit: 8\n"
    "vessels:\n- {name: tube, shape: {tube: {axis: [[0, 0, -0.01], [0, 0, 0.04], [0, 0, 0.09]], radius: "
    "4.0e-3}}}\n" WIRE(
        "rod") "  drive: {mode: push, speed: 0.05, advance_max: 0.03}\n  waypoints: [[0, 0, 0.06]]\n";
static const char bent_tube[] =
    "step: 0.015\ntime_limit: 12\n"
    "vessels:\n- name: tube\n  shape:\n    tube:\n      radius: 4.0e-3\n      axis: [[0, 0, -0.01], [0, 0, "
    "0.015],\n"
    "        [0, 0, 0.04], [1.022225e-3, 0, 0.04776457], [4.019238e-3, 0, 0.055], [8.786797e-3, 0, "
    "0.0612132],\n"
    "        [0.015, 0, 0.06598076], [0.02223543, 0, 0.06897777], [0.03, 0, 0.07], [0.05, 0, 0.07], [0.07, "
    "0, "
    "0.07]]\n" WIRE("rod") "  drive: {mode: push, speed: 0.03, tip_bend: {length: 0.01, curvature: 60}}\n"
                           "  waypoints: [[0.055, 0, 0.07]]\n"
                           "  limits: [{quantity: wall_force, limit: 1}]\n";

/* Waypoint after waypoint along the bent tube's axis, or straight. */
static cn_status planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const double *to = query->point + 3 * (query->npoint - 1);
    const int bend = to[0] > 0.04 ? 9 : 0, n = query->npoint + bend;
    (void)error;
    memset(roadmap, 0, sizeof *roadmap);
    roadmap->reproducible = true, roadmap->npoint = n;
    roadmap->x = malloc(3 * (size_t)n * sizeof(double)), roadmap->leg = malloc((size_t)n * sizeof(int));
    if (!roadmap->x || !roadmap->leg) return CN_ERR_MEMORY;
    memcpy(roadmap->x, query->point, 3 * sizeof(double));
    roadmap->leg[0] = 0;
    for (int i = 0; i < bend; i++) {
        const double angle = 0.5 * pi * i / (bend - 1);
        const double x[3] = {0.03 * (1 - cos(angle)), 0, 0.04 + 0.03 * sin(angle)};
        memcpy(roadmap->x + 3 * (i + 1), x, sizeof x), roadmap->leg[i + 1] = 0;
    }
    for (int i = 1; i < query->npoint; i++)
        memcpy(roadmap->x + 3 * (bend + i), query->point + 3 * i, 3 * sizeof(double)),
            roadmap->leg[bend + i] = i;
    return CN_OK;
}

/* What is seen of the base and the tip, step by step. */
typedef struct {
    double dt, scale;           /* lengths times scale are metres */
    int step, back_at, stop_at; /* at this step: the base is told to go back to `back_to`; the run ends */
    double back_to, least_after;
    double inserted, twist, time;
    double fastest, quickest; /* advance [m/s], turn [rad/s] */
    double uneven;            /* base advance against the tip's along z, most */
    double lag;               /* of the tip's frame behind the base's turn, most */
    double lag_now, tip[3], n[3];
    bool drew_in;
    int nfree;
    cn_report report;
} watch;

static bool see(void *user, cn_run_data *run)
{
    watch *w = user;
    cn_body_state *state = &run->state->body[0];
    const cn_model_body *body = &run->model->body[0];
    const double dt = run->state->time - w->time;
    w->fastest = fmax(w->fastest, fabs(state->inserted - w->inserted) / dt);
    w->quickest = fmax(w->quickest, fabs(state->twist - w->twist) / dt);
    w->inserted = state->inserted, w->twist = state->twist, w->time = run->state->time;
    w->uneven = fmax(w->uneven, fabs(state->x[2] - state->inserted));
    cn_copy3(state->x, w->tip);
    if (body->body->model == CN_BODY_ROD) {
        double r[9];
        cn_quaternion_matrix(state->rotation, r);
        for (int k = 0; k < 3; k++)
            w->n[k] = r[3 * k];
        w->lag_now = fabs(remainder(
            atan2(cn_dot(w->n, body->binormal), cn_dot(w->n, body->normal)) - state->twist, 2 * pi));
        w->lag = fmax(w->lag, w->lag_now);
    }
    assert_true(state->nfree <= cn_sheath_out(body, state->inserted));
    w->drew_in |= state->nfree < w->nfree;
    w->nfree = state->nfree;
    w->step = run->state->step;
    if (w->step == w->back_at) cn_push_back(state, w->back_to);
    if (w->back_at > 0 && w->step > w->back_at) w->least_after = fmin(w->least_after, state->inserted);
    return w->step != w->stop_at;
}

static watch drive(const char *text, const char *more, int nsetting, const cn_setting *setting, int threads,
                   watch w)
{
    cn_scene *scene;
    cn_world *world;
    cn_error error = {0};
    FILE *out = fopen(file, "wb");
    assert_non_null(out);
    fprintf(out, "%s%s", text, more);
    fclose(out);
    if (cn_scene_read(&scene, file, nsetting, setting, &error) != CN_OK) fail_msg("%s", error.message);
    if (cn_world_new(&world, scene, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
    w.inserted = scene->body[0].shape.catheter.inserted, w.least_after = INFINITY;
    assert_int_equal(cn_run_visited(world, NULL, planner, threads, NULL, see, &w, &w.report, &error), CN_OK);
    cn_world_free(world);
    cn_scene_free(scene);
    return w;
}

static void is_reached(const watch *w)
{
    if (w->report.verdict.code != CN_VERDICT_REACHED) fail_msg("%s", w->report.verdict.message);
    assert_int_equal(w->report.contact.intersections + w->report.contact.outside_nodes, 0);
    assert_true(w->report.solver.residual_max <= 1e-2);
}

static void in_a_straight_tube_the_tip_goes_as_far_as_the_base(void **state)
{
    (void)state;
    watch w = drive(straight_tube, "", 0, NULL, 1, (watch){0});
    is_reached(&w);
    assert_true(w.inserted > 0.05);
    assert_true(w.uneven <= 1e-6 * w.inserted);
    assert_true(w.fastest <= 0.03 * (1 + 1e-9) && w.fastest > 0.029); /* advance_max, below the speed */
    assert_true(w.twist == 0);                                        /* nothing to steer */
    assert_true(w.report.body[0].energy < 1e-12);
    cn_report_clear(&w.report);
}

static void the_bases_turn_arrives_at_the_tip(void **state)
{
    (void)state;
    /* the way leads on to one side: the base turns the bent end there, at its greatest rate at first */
    for (int side = 0; side < 6; side++) {
        char more[128];
        const double angle = 1.1 * side + 0.3, to[2] = {0.05 * cos(angle), 0.05 * sin(angle)};
        snprintf(more, sizeof more, "  waypoints: [[%g, %g, 0.07]]\n", to[0], to[1]);
        watch w = drive(open_space, more, 0, NULL, 1, (watch){.stop_at = 300});
        const double across = hypot(w.n[0], w.n[1]);
        assert_true(across > 0.5);
        assert_true((w.n[0] * to[0] + w.n[1] * to[1]) / (across * 0.05) > cos(0.05));
        assert_true(w.lag_now < 1e-3 && w.lag < 0.05);
        assert_true(w.quickest <= 2 * (1 + 1e-9) && w.fastest <= 0.015 * (1 + 1e-9));
        assert_true(fabs(w.twist) < pi + 0.2); /* the shorter way round */
        cn_report_clear(&w.report);
    }
}

static void a_bent_end_at_rest_has_its_curvature(void **state)
{
    (void)state;
    static const struct {
        const char *model;
        double length, curvature, tolerance;
    } cases[] = {{"rod", 0.01, 20, 2e-3},
                 {"rod", 0.01, 100, 2e-3},
                 {"rod", 0.0155, 60, 2e-3},
                 {"tet4", 0.01, 20, 1e-5},
                 {"tet10", 0.01, 100, 1e-5}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const double length = cases[i].length, k = cases[i].curvature;
        char words[2][32];
        snprintf(words[0], sizeof words[0], "%g", length), snprintf(words[1], sizeof words[1], "%g", k);
        const cn_setting setting[] = {{"bodies.0.model", cases[i].model},
                                      {"bodies.0.drive.tip_bend.length", words[0]},
                                      {"bodies.0.drive.tip_bend.curvature", words[1]},
                                      {"bodies.0.material.damping", "200"},
                                      {"solver.tolerance", "1e-8"},
                                      {"step", "0.05"}};
        watch w = drive(open_space, "", 6, setting, 1, (watch){0});
        assert_int_equal(w.report.verdict.code, CN_VERDICT_RAN);
        /* an arc from its root, 0.02 - length past the entry, towards the model's normal */
        double normal[3], arc[3] = {0, 0, 0.02 - length + sin(k * length) / k};
        cn_any_normal((double[3]){0, 0, 1}, normal);
        cn_axpy((1 - cos(k * length)) / k, normal, arc);
        assert_true(cn_distance(w.tip, arc) <= cases[i].tolerance * length);
        assert_true(w.inserted == 0.02 && w.twist == 0);
        cn_report_clear(&w.report);
    }
}

static void a_steered_end_bends_to_the_side_where_the_way_is(void **state)
{
    (void)state;
    static const double angles[] = {0.4, 2.8, -1.9};
    const double length = 0.01, k = 60, ei = 5e7 * pi * pow(1e-3, 4) / 64;
    for (size_t i = 0; i < sizeof angles / sizeof *angles; i++) {
        const double side[3] = {cos(angles[i]), sin(angles[i]), 0};
        char waypoint[128];
        snprintf(waypoint, sizeof waypoint, "  waypoints: [[%g, %g, 0.02]]\n", 0.05 * side[0],
                 0.05 * side[1]);
        const cn_setting setting[] = {
            {"bodies.0.drive.tip_bend.steered", "on"}, {"bodies.0.drive.tip_bend.curvature", "60"},
            {"bodies.0.drive.speed", "1e-3"},          {"bodies.0.waypoint_tolerance", "1e-4"},
            {"bodies.0.material.damping", "200"},      {"solver.tolerance", "1e-8"}};
        watch w = drive(open_space, waypoint, 6, setting, 1, (watch){.stop_at = 300});
        const cn_insertion *list = w.report.drive.insertion;
        const int n = w.report.drive.ninsertion;
        double arc[3] = {0, 0, w.inserted - length + sin(k * length) / k};
        cn_axpy((1 - cos(k * length)) / k, side, arc);
        assert_true(cn_distance(w.tip, arc) <= 2e-3 * length);
        assert_true(fabs(w.twist) < 0.6 * pi); /* to the nearer side of the two it can bend to */
        assert_true(fabs(fabs(list[n - 1].curvature) - k) < 2e-3 * k && list[0].curvature == 0);
        for (int j = 1; j < n; j++) /* fully bent in half a second */
            assert_true(fabs(list[j].curvature - list[j - 1].curvature) <=
                        2 * k * (list[j].time - list[j - 1].time) * (1 + 1e-9));
        assert_true(w.report.body[0].energy < 1e-5 * 0.5 * ei * k * k * length); /* at rest, so bent */
        assert_true(w.report.solver.residual_max < 1e-3);
        cn_report_clear(&w.report);
    }
}

static void a_bend_is_passed_and_its_wall_pushes_back(void **state)
{
    (void)state;
    watch w = drive(bent_tube, "", 0, NULL, 1, (watch){0});
    is_reached(&w);
    assert_true(w.report.contact.gap_min > 0 && w.report.contact.force_max > 0);
    assert_true(w.report.drive.force_max > 0 && w.report.drive.work > 0);
    assert_true(w.inserted >= 0.04 + 0.025 * 0.5 * pi);
    assert_true(w.fastest <= 0.03 * (1 + 1e-9) && w.quickest <= 3.14 * (1 + 1e-9));
    /* a straight wire of EI bent to the tube's radius would hold EI L / 2 R^2 */
    const double ei = 2e7 * pi * pow(1.5e-3, 4) / 64;
    assert_true(w.report.body[0].energy < 0.5 * ei * 0.5 * pi / 0.025);
    cn_report_clear(&w.report);
}

static void all_models_pass_it(void **state)
{
    (void)state;
    static const char *const models[] = {"tet4", "tet10"};
    for (int i = 0; i < 2; i++) {
        const cn_setting setting[] = {{"bodies.0.model", models[i]},
                                      {"bodies.0.shape.catheter.stations", "33"}};
        watch w = drive(bent_tube, "", 2, setting, 1, (watch){0});
        is_reached(&w);
        assert_true(w.twist != 0);
        cn_report_clear(&w.report);
    }
}

static void insertion_lists_what_a_robot_would_run(void **state)
{
    (void)state;
    const cn_setting fine[] = {{"step", "0.003"}};
    for (int i = 0; i < 2; i++) {
        watch w = drive(bent_tube, "", i, fine, 1, (watch){0});
        const cn_insertion *list = w.report.drive.insertion;
        const int n = w.report.drive.ninsertion;
        is_reached(&w);
        assert_true(n > 200 && n <= 1000);
        assert_true(list[0].step == 0 && list[0].time == 0 && list[0].advance == 0 && list[0].twist == 0);
        assert_true(list[n - 1].step == w.report.steps && list[n - 1].advance == w.inserted);
        assert_true(list[n - 1].twist == w.twist && list[n - 1].time == w.time);
        for (int k = 1; k < n; k++) {
            const double dt = list[k].time - list[k - 1].time;
            assert_true(list[k].step > list[k - 1].step && list[k].body == 0);
            assert_true(fabs(list[k].advance - list[k - 1].advance) <= 0.05 * dt * (1 + 1e-9));
            assert_true(fabs(list[k].twist - list[k - 1].twist) <= 3.14 * dt * (1 + 1e-9));
        }
        char *json = cn_report_json(&w.report);
        assert_non_null(json);
        assert_non_null(strstr(json, "\"insertion\""));
        assert_non_null(strstr(json, "\"twist\""));
        free(json);
        cn_report_clear(&w.report);
    }
}

static void two_threads_drive_it_bit_for_bit_the_same(void **state)
{
    (void)state;
    watch a = drive(bent_tube, "", 0, NULL, 1, (watch){0}), b = drive(bent_tube, "", 0, NULL, 2, (watch){0});
    assert_int_equal(a.report.steps, b.report.steps);
    assert_memory_equal(a.report.body[0].tip, b.report.body[0].tip, sizeof a.tip);
    assert_int_equal(a.report.drive.ninsertion, b.report.drive.ninsertion);
    assert_memory_equal(a.report.drive.insertion, b.report.drive.insertion,
                        (size_t)a.report.drive.ninsertion * sizeof(cn_insertion));
    cn_report_clear(&a.report), cn_report_clear(&b.report);
}

static void in_millimetres_it_is_the_same(void **state)
{
    (void)state;
    /* kg, mm, s: E [kg / mm s^2] a thousandth, density a thousand-millionth */
    static const char in_mm[] =
        "step: 0.01\ntime_limit: 8\n"
        "bodies:\n- name: wire\n"
        "  shape: {catheter: {length: 200, diameter: 1, stations: 101, sides: 6, sheath: on, inserted: 20,\n"
        "    direction: [0, 0, 1]}}\n"
        "  model: rod\n"
        "  material: {young: 5.0e+4, poisson: 0.3, density: 1.1e-6, damping: 5}\n"
        "  drive: {mode: push, speed: 20, advance_max: 15, twist_max: 2, path_distance: 1,\n"
        "    tip_bend: {length: 10, curvature: 0.02}}\n"
        "  waypoint_tolerance: 1\n  waypoints: [[-30, 20, 80]]\n";
    watch a = drive(open_space, "  waypoints: [[-0.03, 0.02, 0.08]]\n", 0, NULL, 1, (watch){.stop_at = 200});
    watch b = drive(in_mm, "", 0, NULL, 1, (watch){.stop_at = 200});
    for (int k = 0; k < 3; k++)
        assert_true(fabs(a.tip[k] - 1e-3 * b.tip[k]) <= 1e-6 * 0.05);
    assert_true(fabs(a.twist - b.twist) <= 1e-5 && fabs(a.inserted - 1e-3 * b.inserted) <= 1e-6 * a.inserted);
    assert_true(a.twist != 0);
    cn_report_clear(&a.report), cn_report_clear(&b.report);
}

static void the_base_draws_it_back_and_goes_on(void **state)
{
    (void)state;
    watch w = drive(straight_tube, "", 0, NULL, 1, (watch){.back_at = 100, .back_to = 0.012});
    is_reached(&w);
    assert_true(w.drew_in);
    assert_true(w.least_after <= 0.012 && w.least_after > 0.012 - 0.03 * 0.01 * (1 + 1e-9));
    assert_true(w.fastest <= 0.03 * (1 + 1e-9));
    assert_true(fabs(w.tip[2] - w.inserted) <= 1e-6 * w.inserted); /* drawn in as it came out */
    cn_report_clear(&w.report);

    w = drive(bent_tube, "", 0, NULL, 1, (watch){.back_at = 200, .back_to = 0.03});
    is_reached(&w);
    assert_true(w.drew_in && w.least_after <= 0.03);
    assert_true(w.fastest <= 0.05 * (1 + 1e-9)); /* advance_max by default */
    cn_report_clear(&w.report);
}

static void a_limit_on_the_wall_force_is_kept_to_the_end(void **state)
{
    (void)state;
    watch whole = drive(bent_tube, "", 0, NULL, 1, (watch){0});
    char limit[32];
    snprintf(limit, sizeof limit, "%.17g", 0.6 * whole.report.limit[0].worst);
    const cn_setting setting[] = {
        {"bodies.0.limits.0.limit", limit}, {"time_limit", "60"}, {"planner.replans", "0"}};
    watch w = drive(bent_tube, "", 3, setting, 1, (watch){0});
    assert_int_equal(w.report.verdict.code, CN_VERDICT_LIMIT_BROKEN);
    assert_true(w.report.limit[0].worst <= 0.6 * whole.report.limit[0].worst);
    assert_true(w.drew_in); /* near it, it tried again */
    cn_report_clear(&whole.report), cn_report_clear(&w.report);
}

static void what_it_cannot_reach_ends_in_words(void **state)
{
    (void)state;
    /* a waypoint at the wall of the bend, out of reach for a straight end */
    const cn_setting setting[] = {{"bodies.0.waypoints", "[[0.055, 0.0025, 0.07]]"},
                                  {"bodies.0.waypoint_tolerance", "2e-4"},
                                  {"bodies.0.drive.tip_bend.length", "0"},
                                  {"bodies.0.drive.tip_bend.curvature", "0"},
                                  {"planner.replans", "0"},
                                  {"time_limit", "200"}};
    watch w = drive(bent_tube, "", 6, setting, 1, (watch){0});
    assert_int_equal(w.report.verdict.code, CN_VERDICT_LIMIT_BROKEN);
    assert_int_equal(w.report.verdict.quantity, CN_QUANTITY_PROGRESS);
    assert_non_null(strstr(w.report.verdict.message, "stuck"));
    cn_report_clear(&w.report);
}

static void what_cannot_be_pushed_is_refused_in_words(void **state)
{
    (void)state;
    static const struct {
        const char *key, *value, *word;
    } cases[] = {{"bodies.0.shape.catheter.sheath", "off", "sheath"},
                 {"bodies.0.drive.tip_bend.length", "0", "both"},
                 {"bodies.0.drive.tip_bend.curvature", "0", "both"},
                 {"bodies.0.drive.tip_bend.length", "0.3", "0.3 m long"},
                 {"bodies.0.drive.tip_bend.curvature", "400", "half a circle"},
                 {"bodies.0.shape.catheter.stations", "5", "stations"},
                 {"bodies.0.shape.catheter.diameter", "0.06", "radius"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const cn_setting setting[] = {{cases[i].key, cases[i].value}};
        watch w = drive(open_space, "  waypoints: [[0, 0, 0.05]]\n", 1, setting, 1, (watch){0});
        assert_int_equal(w.report.verdict.code, CN_VERDICT_BAD_INPUT);
        if (!strstr(w.report.verdict.message, cases[i].word)) fail_msg("%s", w.report.verdict.message);
        assert_int_equal(w.report.steps, 0);
        cn_report_clear(&w.report);
    }
    const cn_setting steered[] = {{"bodies.0.drive.tip_bend.steered", "on"}, {"bodies.0.model", "tet4"}};
    watch w = drive(open_space, "  waypoints: [[0, 0, 0.05]]\n", 2, steered, 1, (watch){0});
    assert_int_equal(w.report.verdict.code, CN_VERDICT_BAD_INPUT);
    assert_non_null(strstr(w.report.verdict.message, "model rod"));
    cn_report_clear(&w.report);
    w = drive("step: 0.01\ntime_limit: 1\nbodies:\n- name: bar\n"
              "  shape: {beam: {size: [0.1, 0.01, 0.01], cells: [10, 1, 1]}}\n"
              "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n  drive: {mode: push}\n",
              "", 0, NULL, 1, (watch){0});
    assert_int_equal(w.report.verdict.code, CN_VERDICT_BAD_INPUT);
    assert_non_null(strstr(w.report.verdict.message, "catheter"));
    cn_report_clear(&w.report);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(in_a_straight_tube_the_tip_goes_as_far_as_the_base),
        cmocka_unit_test(the_bases_turn_arrives_at_the_tip),
        cmocka_unit_test(a_bent_end_at_rest_has_its_curvature),
        cmocka_unit_test(a_steered_end_bends_to_the_side_where_the_way_is),
        cmocka_unit_test(a_bend_is_passed_and_its_wall_pushes_back),
        cmocka_unit_test(all_models_pass_it),
        cmocka_unit_test(insertion_lists_what_a_robot_would_run),
        cmocka_unit_test(two_threads_drive_it_bit_for_bit_the_same),
        cmocka_unit_test(in_millimetres_it_is_the_same),
        cmocka_unit_test(the_base_draws_it_back_and_goes_on),
        cmocka_unit_test(a_limit_on_the_wall_force_is_kept_to_the_end),
        cmocka_unit_test(what_it_cannot_reach_ends_in_words),
        cmocka_unit_test(what_cannot_be_pushed_is_refused_in_words),
    };
    const int handle = mkstemp(file);
    if (handle < 0) return 1;
    close(handle);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    remove(file);
    return failed;
}
