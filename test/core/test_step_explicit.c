/* test_step_explicit.c - `solver.integrator: explicit` for molecules: against the implicit ones, on springs
 * of contact, along a path, and what is refused. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "catnav/run.h"
#include "catnav/vec3.h"
#include "scene_steps.h"

#define HEAD "step: 0.005\ntime_limit: 1\ngravity: [0, 0, -9.81]\n"
#define BAR                                                                                                  \
    "bodies:\n- name: bar\n  shape: {beam: {size: [0.3, 0.06, 0.06], cells: [3, 1, 1]}}\n"                   \
    "  model: molecules\n  molecules: {radius: 0.01}\n"

static void explicit_and_implicit_steps_swing_alike(void **state)
{
    static const char text[] = HEAD BAR
        "  material: {young: 2.0e+5, poisson: 0.25, density: 1000, damping: 1, damping_stiffness: 1.0e-4}\n"
        "  fixed: {box: [[-1, -1, -1], [0.03, 1, 1]]}\n";
    double end[2];
    (void)state;
    for (int k = 0; k < 2; k++) {
        scene_steps s;
        scene_steps_new(
            &s, text, 2,
            (cn_setting[]){{"solver.integrator", k ? "explicit" : "trbdf2"}, {"step", k ? "0.01" : "0.002"}});
        scene_steps_go(&s, k ? 20 : 100);
        const cn_body *body = s.model->body[0].body;
        int far = 0;
        for (int i = 0; i < body->nnode; i++)
            if (body->rest[3 * i] > body->rest[3 * far]) far = i;
        end[k] = s.state->body[0].x[3 * far + 2] - body->rest[3 * far + 2];
        for (int i = 0; i < body->nnode; i++) /* what is held stays to the bit */
            if (s.model->body[0].fixed[i])
                assert_memory_equal(s.state->body[0].x + 3 * i, body->rest + 3 * i, 3 * sizeof(double));
        scene_steps_free(&s);
    }
    assert_true(end[0] < -0.005 && fabs(end[1] - end[0]) < 0.02 * fabs(end[0]));
}

#define SOFT  "  material: {young: 1.0e+5, poisson: 0.25, density: 1000, damping: 20}\n"
#define FLOOR "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, -0.01], normal: [0, 0, 1]}}}\n"

/* It comes to lie about where the implicit steps leave it. */
static void springs_of_contact_act_in_every_substep(void **state)
{
    double rests[2];
    (void)state;
    for (int k = 0; k < 2; k++) {
        scene_steps s;
        scene_steps_new(
            &s, HEAD FLOOR BAR SOFT, 2,
            (cn_setting[]){{"solver.integrator", k ? "explicit" : "euler"}, {"contact.method", "penalty"}});
        scene_steps_go(&s, 400);
        const scene_motion m = scene_steps_motion(&s, 0);
        rests[k] = m.centre[2];
        if (!(cn_norm(m.velocity) < 5e-3)) fail_msg("still moves at %g m/s", cn_norm(m.velocity));
        assert_true(k == 0 || s.figures->newton == 0);
        scene_steps_free(&s);
    }
    if (!(rests[1] > 0.01 && rests[1] < 0.021 && fabs(rests[1] - rests[0]) < 0.003))
        fail_msg("rests at %g, not %g m", rests[1], rests[0]);
}

static void two_bodies_fall_on_each_other(void **state)
{
    (void)state;
    scene_steps s;
    scene_steps_new(
        &s,
        HEAD FLOOR BAR SOFT
        "- name: over\n  shape: {beam: {size: [0.1, 0.06, 0.06], cells: [1, 1, 1]}, translate: [0.1, 0, "
        "0.07]}\n  model: molecules\n  molecules: {radius: 0.01}\n" SOFT,
        2, (cn_setting[]){{"solver.integrator", "explicit"}, {"contact.method", "penalty"}});
    scene_steps_go(&s, 300);
    const scene_motion low = scene_steps_motion(&s, 0), high = scene_steps_motion(&s, 1);
    assert_true(high.centre[2] - low.centre[2] > 0.03 && high.centre[2] < 0.1);
    assert_true(cn_norm(high.velocity) < 0.02);
    scene_steps_free(&s);
}

static cn_status run(const char *text, int n, const cn_setting *setting, int threads, cn_report *report)
{
    char file[] = "/tmp/test-step-explicit-XXXXXX";
    cn_scene *scene;
    cn_world *world;
    cn_error error = {0};
    const int made = mkstemp(file);
    assert_int_equal(write(made, text, strlen(text)), strlen(text));
    close(made);
    cn_status status = cn_scene_read(&scene, file, n, setting, &error);
    remove(file);
    cn_report_refused(report, NULL, &error);
    if (status != CN_OK) return status;
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    status = cn_run(world, NULL, NULL, threads, NULL, report, &error);
    cn_world_free(world);
    cn_scene_free(scene);
    return status;
}

static void a_run_follows_its_path_the_same_on_any_threads(void **state)
{
    (void)state;
    double goal[2][3];
    for (int k = 0; k < 2; k++) {
        cn_report report;
        assert_int_equal(run("step: 0.01\ntime_limit: 5\n" BAR SOFT
                             "  drive: {nodes: uniform, control: all, speed: 0.1}\n  waypoints: [[0.4, 0.05, "
                             "0.03]]\n  waypoint_tolerance: 0.01\n",
                             1, (cn_setting[]){{"solver.integrator", "explicit"}}, k + 1, &report),
                         CN_OK);
        if (report.verdict.code != CN_VERDICT_REACHED) fail_msg("%s", report.verdict.message);
        cn_copy3(report.body[0].goal, goal[k]);
        cn_report_clear(&report);
    }
    assert_memory_equal(goal[0], goal[1], sizeof goal[0]);
}

static void what_explicit_steps_cannot_do_is_refused_in_words(void **state)
{
    (void)state;
    static const struct {
        const char *key, *value, *said;
    } cases[] = {{"contact.method", "strict", "contact.method: penalty"},
                 {"contact.method", "project", "contact.method: penalty"},
                 {"bodies.0.model", "tet4", "model: molecules"},
                 {"bodies.0.model", "rod", "model: molecules"},
                 {"bodies.0.material.density", "0", "use euler"},
                 {"leave_out.inertia", "on", "use euler"},
                 {"solver.newton", "1", "explicit"},
                 {"bodies.0.material.young", "1.0e+22", "use integrator: euler"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_report report;
        run(HEAD FLOOR BAR SOFT, 3,
            (cn_setting[]){{"contact.method", "penalty"},
                           {"solver.integrator", "explicit"},
                           {cases[i].key, cases[i].value}},
            1, &report);
        assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
        if (!strstr(report.verdict.message, cases[i].said)) fail_msg("%s", report.verdict.message);
        cn_report_clear(&report);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(explicit_and_implicit_steps_swing_alike),
        cmocka_unit_test(springs_of_contact_act_in_every_substep),
        cmocka_unit_test(two_bodies_fall_on_each_other),
        cmocka_unit_test(a_run_follows_its_path_the_same_on_any_threads),
        cmocka_unit_test(what_explicit_steps_cannot_do_is_refused_in_words),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
