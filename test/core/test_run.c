/* test_run.c - whole runs by a planner that knows one way: doors, verdicts, hooks, limits, the same twice. */
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
#include "catnav/run.h"
#include "catnav/vec3.h"

typedef struct {
    cn_scene *scene;
    cn_world *world;
} place;

static int plans;             /* calls of the planner */
static cn_status plan_answer; /* CN_OK: straight through all points, refused or not */
static volatile sig_atomic_t stop;

static cn_status straight(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const size_t n = (size_t)query->npoint;
    plans++;
    memset(roadmap, 0, sizeof *roadmap);
    roadmap->reproducible = true;
    if (plan_answer != CN_OK) return cn_fail(error, plan_answer, NULL, 0, "the planner said so");
    roadmap->x = malloc(3 * n * sizeof(double));
    roadmap->leg = malloc(n * sizeof(int));
    if (!roadmap->x || !roadmap->leg) return CN_ERR_MEMORY;
    roadmap->npoint = query->npoint;
    memcpy(roadmap->x, query->point, 3 * n * sizeof(double));
    for (int i = 0; i < query->npoint; i++)
        roadmap->leg[i] = i;
    return CN_OK;
}

static int set_up(void **state)
{
    static place p;
    cn_error error = {0};
    plans = 0, plan_answer = CN_OK, stop = 0;
    p = (place){0};
    *state = &p;
    if (cn_scene_read(&p.scene, CATNAV_TEST_DATA "/scenes/control_run.yaml", 0, NULL, &error) != CN_OK ||
        cn_world_new(&p.world, p.scene, 0, NULL, &error) != CN_OK)
        print_message("%s\n", error.message);
    return p.world ? 0 : 1;
}

static int put_away(void **state)
{
    const place *p = *state;
    cn_world_free(p->world);
    cn_scene_free(p->scene);
    return 0;
}

static cn_report run(const place *p, const cn_request *request, int threads, const cn_run_hooks *hooks)
{
    cn_report report;
    cn_error error = {0};
    assert_int_equal(cn_run(p->world, request, straight, threads, hooks, &report, &error), CN_OK);
    assert_true(report.verdict.message[0] != 0);
    return report;
}

typedef struct {
    int n, least_step, greatest_step, stop_at;
    double tip[3], stress; /* of the last frame; largest of all */
} watch;

static void see(void *user, const cn_frame *frame)
{
    watch *w = user;
    w->n++;
    w->greatest_step = frame->step > w->greatest_step ? frame->step : w->greatest_step;
    w->least_step = frame->step < w->least_step ? frame->step : w->least_step;
    cn_copy3(frame->body[0].x, w->tip);
    for (int e = 0; e < frame->body[0].body->ntet; e++)
        w->stress = fmax(w->stress, frame->body[0].von_mises[e]);
    if (frame->step == w->stop_at) stop = 1;
}

static void a_run_reaches_and_shows_every_accepted_state(void **state)
{
    watch w = {.stop_at = -1};
    const cn_run_hooks hooks = {.user = &w, .frame = see};
    cn_report report = run(*state, NULL, 1, &hooks);
    assert_int_equal(report.verdict.code, CN_VERDICT_REACHED);
    assert_int_equal(plans, 1);
    assert_int_equal(w.n, report.steps + 1);
    assert_int_equal(w.least_step, 0);
    assert_int_equal(w.greatest_step, report.verdict.step);
    assert_memory_equal(w.tip, report.body[0].tip, sizeof w.tip);
    assert_true(report.body[0].goal_distance <= 2e-3);
    assert_true(fabs(w.stress - report.limit[0].worst) <= 1e-9 * w.stress);
    assert_int_equal(report.contact.intersections + report.contact.outside_nodes, 0);
    /* what is stored came from the drive, or left the sheath with the drive's speed: m v^2 / 2 */
    const double mass = 1100 * report.body[0].rest_volume, speed = 0.05;
    assert_true(report.body[0].energy > 0);
    assert_true(report.body[0].energy + report.body[0].kinetic <=
                report.drive.work + 0.5 * mass * speed * speed);
    cn_report_clear(&report);
}

static void two_runs_in_one_world_are_the_same_bit_for_bit(void **state)
{
    cn_report a = run(*state, NULL, 1, NULL), b = run(*state, NULL, 2, NULL);
    assert_memory_equal(a.body[0].tip, b.body[0].tip, sizeof a.body[0].tip);
    assert_memory_equal(&a.body[0].energy, &b.body[0].energy, sizeof(double));
    assert_memory_equal(&a.drive, &b.drive, sizeof a.drive);
    assert_memory_equal(&a.contact.gap_min, &b.contact.gap_min, sizeof(double));
    assert_memory_equal(&a.limit[0].worst, &b.limit[0].worst, sizeof(double));
    assert_memory_equal(&a.solver.residual_max, &b.solver.residual_max, sizeof(double));
    assert_int_equal(a.steps, b.steps);
    cn_report_clear(&a), cn_report_clear(&b);
}

static void a_request_that_means_nothing_is_refused_in_words(void **state)
{
    const double good[6] = {0, 0, 0, 0, 0, 0.03}, bad[6] = {0, 0, 0, 0, NAN, 0.03},
                 out[6] = {0, 0, 0, 0.005, 0, 0.03};
    const cn_limit negative = {.quantity = CN_QUANTITY_STRESS, .limit = -1};
    const cn_limit undefined = {.quantity = CN_QUANTITY_ENERGY, .limit = NAN};
    const cn_request request[] = {{.nwaypoint = 1, .waypoint = good},
                                  {.nwaypoint = 2, .waypoint = bad},
                                  {.nwaypoint = 2, .waypoint = out},
                                  {.nlimit = 1, .limit = &negative},
                                  {.nlimit = 1, .limit = &undefined}};
    const int fault[] = {CN_FAULT_TOO_FEW, CN_FAULT_VALUE, CN_FAULT_PLACE, CN_FAULT_VALUE, CN_FAULT_VALUE};
    for (size_t i = 0; i < sizeof request / sizeof *request; i++) {
        cn_report report = run(*state, &request[i], 1, NULL);
        assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
        assert_int_equal(report.verdict.fault, fault[i]);
        assert_int_equal(report.steps, 0);
        cn_report_clear(&report);
    }
    assert_int_equal(plans, 0);
}

static void the_planners_answer_is_the_verdict(void **state)
{
    const struct {
        cn_status answer;
        cn_verdict_code code;
    } cases[] = {{CN_ERR_NO_PATH, CN_VERDICT_NO_PATH},
                 {CN_ERR_TIMEOUT, CN_VERDICT_TIMEOUT},
                 {CN_ERR_CANCELLED, CN_VERDICT_CANCELLED},
                 {CN_ERR_MEMORY, CN_VERDICT_NUMERICS}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        plan_answer = cases[i].answer;
        cn_report report = run(*state, NULL, 1, NULL);
        assert_int_equal(report.verdict.code, cases[i].code);
        assert_int_equal(report.reproducible, cases[i].answer != CN_ERR_TIMEOUT);
        assert_int_equal(report.steps, 0);
        cn_report_clear(&report);
    }
}

static void a_broken_limit_leaves_the_last_state_that_kept_it(void **state)
{
    watch w = {.stop_at = -1};
    const cn_run_hooks hooks = {.user = &w, .frame = see};
    cn_report whole = run(*state, NULL, 1, NULL);
    const cn_limit half = {.quantity = CN_QUANTITY_STRESS, .limit = 0.5 * whole.limit[0].worst};
    const cn_request request = {.nlimit = 1, .limit = &half};
    plans = 0;
    cn_report report = run(*state, &request, 1, &hooks);
    assert_int_equal(report.nlimit, 1); /* the request's takes the scene's place */
    assert_int_equal(report.verdict.code, CN_VERDICT_LIMIT_BROKEN);
    assert_int_equal(report.verdict.quantity, CN_QUANTITY_STRESS);
    assert_true(report.verdict.value > half.limit && report.verdict.limit == half.limit);
    assert_true(report.verdict.element >= 0 && isfinite(cn_norm(report.verdict.position)));
    assert_true(report.limit[0].worst <= half.limit && w.stress <= half.limit);
    assert_memory_equal(w.tip, report.body[0].tip, sizeof w.tip);
    assert_true(report.rejected_steps > report.replans);
    assert_in_range(plans, 1, 4); /* the first and at most `replans` more */
    cn_report_clear(&whole), cn_report_clear(&report);
}

static void a_run_stops_within_a_step_of_being_told(void **state)
{
    watch w = {.stop_at = 7};
    const cn_run_hooks hooks = {.user = &w, .frame = see, .cancel = &stop};
    cn_report report = run(*state, NULL, 1, &hooks);
    assert_int_equal(report.verdict.code, CN_VERDICT_CANCELLED);
    assert_int_equal(report.steps, 7);
    assert_int_equal(w.greatest_step, 7);
    cn_report_clear(&report);
}

/* Two tetrahedra apart, the first held: nothing holds the second where it has no mass. */
static void a_part_that_nothing_holds_has_no_equilibrium(void **state)
{
    (void)state;
    static const char node[] =
        "8 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n4 5 0 0\n5 6 0 0\n6 5 1 0\n7 5 0 1\n",
                      ele[] = "2 4 0\n0 0 1 2 3\n1 4 5 6 7\n";
    const char *const ends[] = {".node", ".ele", ".yaml"};
    for (int held = 1; held <= 2; held++) {
        char stem[64], name[80], text[512];
        cn_scene *scene;
        cn_world *world;
        cn_report report;
        cn_error error = {0};
        snprintf(stem, sizeof stem, "/tmp/catnav_run_%ld", (long)getpid());
        snprintf(text, sizeof text,
                 "scene: parts\ngravity: [0, 0, -1]\nstep: 0.01\ntime_limit: 0.05\ncontact: {method: none}\n"
                 "bodies:\n  - name: twins\n    shape: {file: %s.node}\n    model: tet4\n"
                 "    material: {young: 1e6, poisson: 0.3, density: 0}\n"
                 "    fixed: {box: [[-1, -1, -1], [%d, 2, 2]]}\n",
                 stem, held == 1 ? 2 : 9);
        const char *const texts[] = {node, ele, text};
        for (int i = 0; i < 3; i++) {
            snprintf(name, sizeof name, "%s%s", stem, ends[i]);
            FILE *file = fopen(name, "w");
            assert_non_null(file);
            fputs(texts[i], file);
            fclose(file);
        }
        if (cn_scene_read(&scene, name, 0, NULL, &error) != CN_OK ||
            cn_world_new(&world, scene, 0, NULL, &error) != CN_OK)
            fail_msg("%s", error.message);
        assert_int_equal(cn_run(world, NULL, straight, 1, NULL, &report, &error), CN_OK);
        if (held == 1) {
            assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
            assert_int_equal(report.steps, 0);
            assert_non_null(strstr(report.verdict.message, "part 2 of 2"));
        } else
            assert_int_equal(report.verdict.code, CN_VERDICT_RAN);
        cn_report_clear(&report), cn_world_free(world), cn_scene_free(scene);
        for (int i = 0; i < 3; i++) {
            snprintf(name, sizeof name, "%s%s", stem, ends[i]);
            remove(name);
        }
    }
}

#define RUN(test) cmocka_unit_test_setup_teardown(test, set_up, put_away)
int main(void)
{
    const struct CMUnitTest tests[] = {
        RUN(a_run_reaches_and_shows_every_accepted_state),
        RUN(two_runs_in_one_world_are_the_same_bit_for_bit),
        RUN(a_request_that_means_nothing_is_refused_in_words),
        RUN(the_planners_answer_is_the_verdict),
        RUN(a_broken_limit_leaves_the_last_state_that_kept_it),
        RUN(a_run_stops_within_a_step_of_being_told),
        cmocka_unit_test(a_part_that_nothing_holds_has_no_equilibrium),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
