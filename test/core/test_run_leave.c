/* test_run_leave.c - work left out: on and off give the same motion, measuring changes nothing, and a scene
 * that comes to need the work has it again. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "catnav/vec3.h"
#include "run_parts.h"

static char file[] = "test-leave-XXXXXX";

/* A soft bar, held at one end, that sags in a tube it does not touch. */
static const char bar[] =
    "step: 0.01\ntime_limit: 1.2\ngravity: [0, -9.81, 0]\n"
    "vessels:\n- {name: tube, shape: {tube: {axis: [[-0.1, 0, 0], [0.3, 0, 0]], radius: 0.1}}}\n"
    "bodies:\n- name: bar\n  shape: {beam: {size: [0.1, 0.01, 0.01], cells: [10, 2, 2]}}\n"
    "  model: tet4\n"
    "  material: {young: 1.0e+7, poisson: 0.3, density: 1000, damping: 20}\n"
    "  fixed: {box: [[-1, -1, -1], [0, 1, 1]]}\n"
    "solver: {linear: cholesky}\n";

/* A slack rod without weight, held at one end, that a moment at the other winds up. */
static const char coil[] =
    "step: 0.01\ntime_limit: 0.2\n"
    "bodies:\n- name: snake\n"
    "  shape: {catheter: {length: 0.3, diameter: 0.004, stations: 61, sides: 6, sheath: off}}\n"
    "  model: rod\n"
    "  material: {young: 2.0e+5, poisson: 0.3, density: 1000, damping: 5}\n"
    "  fixed: {box: [[-1, -1, -0.3001], [1, 1, -0.294]]}\n"
    "  load: [{box: [[-1, -1, -0.011], [1, 1, 0.001]], force: [0, 0, 0], moment: [0, 2.0e-4, 0]}]\n";

typedef struct {
    double *x; /* of the last frame's nodes */
    int n, every;
    long newton, kept;
    cn_report report;
} outcome;

static void keep(void *user, const cn_frame *frame)
{
    outcome *o = user;
    o->n = frame->body[0].body->npoint;
    o->x = realloc(o->x, 3 * (size_t)o->n * sizeof *o->x);
    memcpy(o->x, frame->body[0].x, 3 * (size_t)o->n * sizeof *o->x);
}

static bool sampled(void *user, cn_run_data *run)
{
    outcome *o = user;
    run->leave.every = o->every;
    o->newton = run->newton, o->kept = run->kept;
    return true;
}

static outcome run_with(const char *text, int every, int nsetting, const cn_setting *setting)
{
    outcome o = {.every = every};
    const cn_run_hooks hooks = {.user = &o, .frame = keep};
    cn_scene *scene;
    cn_world *world;
    cn_error error = {0};
    FILE *out = fopen(file, "wb");
    assert_non_null(out);
    fputs(text, out);
    fclose(out);
    if (cn_scene_read(&scene, file, nsetting, setting, &error) != CN_OK) fail_msg("%s", error.message);
    if (cn_world_new(&world, scene, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(cn_run_visited(world, NULL, NULL, 1, &hooks, sampled, &o, &o.report, &error), CN_OK);
    if (o.report.verdict.code != CN_VERDICT_RAN) fail_msg("%s", o.report.verdict.message);
    cn_world_free(world);
    cn_scene_free(scene);
    return o;
}

static void put_away(outcome *o)
{
    free(o->x);
    cn_report_clear(&o->report);
}

static const cn_left_out *entry(const outcome *o, const char *what)
{
    for (int i = 0; i < o->report.nleft_out; i++)
        if (!strcmp(o->report.left_out[i].what, what)) return &o->report.left_out[i];
    return NULL;
}

static double apart(const outcome *a, const outcome *b, double size)
{
    double most = 0;
    assert_int_equal(a->n, b->n);
    for (int i = 0; i < a->n; i++)
        most = fmax(most, cn_distance(a->x + 3 * i, b->x + 3 * i));
    return most / size;
}

static void each_part_left_out_or_done_moves_the_same_body_the_same_way(void **state)
{
    (void)state;
    /* `most`: of the size. A kept factor ends its iterations elsewhere within the tolerance; without inertia
     * the bar hangs still, where the damped one has nearly come to rest. */
    static const struct {
        const char *what;
        double most;
        bool measured;
    } part[] = {{"self_contact", 0, true}, {"refit", 0, true},       {"wall_solve", 0, false},
                {"stress", 0, true},       {"refactor", 1e-4, true}, {"inertia", 5e-3, true}};
    for (size_t i = 0; i < sizeof part / sizeof *part; i++) {
        char key[64];
        snprintf(key, sizeof key, "leave_out.%s", part[i].what);
        const cn_setting on = {key, "on"}, off = {key, "off"};
        outcome a = run_with(bar, 50, 1, &on), b = run_with(bar, 50, 1, &off);
        const double d = apart(&a, &b, sqrt(0.0102));
        if (!(d <= part[i].most)) fail_msg("%s: %g of the size", part[i].what, d);
        const cn_left_out *e = entry(&a, part[i].what);
        if (!e) fail_msg("%s is not listed", part[i].what);
        assert_true(e->error >= 0 && e->error <= part[i].most);
        assert_true(part[i].measured ? isfinite(e->time_saved_s) : isnan(e->time_saved_s));
        if (entry(&b, part[i].what)) fail_msg("%s is done, and listed", part[i].what);
        put_away(&a), put_away(&b);
    }
}

static void what_inertia_would_have_done_is_measured_from_the_start(void **state)
{
    (void)state;
    /* soft and undamped the bar falls far past its equilibrium, which a step from that does not show */
    const cn_setting on[] = {{"bodies.0.material.young", "1e6"},
                             {"bodies.0.material.damping", "0"},
                             {"time_limit", "0.2"},
                             {"leave_out.inertia", "on"}};
    outcome a = run_with(bar, 5, 4, on), b = run_with(bar, 5, 3, on);
    const double d = apart(&a, &b, sqrt(0.0102));
    const cn_left_out *e = entry(&a, "inertia");
    assert_non_null(e);
    assert_true(d > 5e-3 && e->error > 0.5 * d && e->error < 10 * d); /* at other steps than the last */
    put_away(&a), put_away(&b);
}

static void measuring_changes_nothing_at_any_density(void **state)
{
    (void)state;
    outcome none = run_with(bar, 0, 0, NULL);
    for (int every = 1; every <= 64; every *= 4) {
        outcome o = run_with(bar, every, 0, NULL);
        assert_memory_equal(o.x, none.x, 3 * (size_t)o.n * sizeof *o.x);
        assert_memory_equal(&o.report.body[0].energy, &none.report.body[0].energy, sizeof(double));
        assert_memory_equal(&o.report.solver, &none.report.solver, sizeof o.report.solver);
        put_away(&o);
    }
    put_away(&none);
}

static void a_stress_limit_brings_stress_back_although_it_is_left_out(void **state)
{
    (void)state;
    const cn_setting setting[] = {{"leave_out.stress", "on"},
                                  {"bodies.0.limits", "[{quantity: stress, limit: 1.0e+9}]"}};
    outcome o = run_with(bar, 50, 2, setting);
    assert_null(entry(&o, "stress"));
    assert_true(o.report.limit[0].worst > 0);
    put_away(&o);
}

static void a_body_at_rest_keeps_its_factor_and_one_that_turns_gets_new_ones(void **state)
{
    (void)state;
    const cn_setting still[] = {{"gravity", "[0, -1.0e-2, 0]"}, {"time_limit", "0.5"}};
    const cn_setting turning[] = {
        {"bodies.0.fixed", "{}"},           {"bodies.0.start", "{spin: [0, 0, 10]}"},
        {"bodies.0.material.damping", "0"}, {"vessels", "[]"},
        {"gravity", "[0, 0, 0]"},           {"time_limit", "0.5"}};
    outcome rest = run_with(bar, 50, 2, still), turn = run_with(bar, 50, 6, turning);
    const cn_setting shorter[] = {{"gravity", "[0, -1.0e-2, 0]"}, {"time_limit", "0.02"}};
    outcome first = run_with(bar, 50, 2, shorter); /* a new factor in the first steps, and none later */
    assert_int_equal(rest.newton - rest.kept, first.newton - first.kept);
    put_away(&first);
    assert_true(rest.kept > 10);
    /* 0.1 rad a step, five times what a factor serves for: a new one at least once a step */
    if (turn.newton - turn.kept < turn.report.steps)
        fail_msg("turning: %ld kept of %ld", turn.kept, turn.newton);
    long kept, newton;
    assert_int_equal(sscanf(entry(&rest, "refactor")->why, "%ld of %ld solves", &kept, &newton), 2);
    assert_true(kept == rest.kept && newton == rest.newton);
    put_away(&rest), put_away(&turn);
}

static void a_snake_that_coils_meets_itself_from_the_step_on_where_it_could(void **state)
{
    (void)state;
    const cn_setting straight = {"bodies.0.load", "[]"}, done = {"leave_out.self_contact", "off"},
                     left = {"leave_out.self_contact", "on"};
    outcome still = run_with(coil, 10, 1, &straight), coiled = run_with(coil, 1, 0, NULL),
            always = run_with(coil, 10, 1, &done), never = run_with(coil, 10, 1, &left);
    const cn_left_out *a = entry(&still, "self_contact"), *b = entry(&coiled, "self_contact");
    assert_non_null(a), assert_non_null(b);
    assert_non_null(strstr(a->why, "no body turned by more than 180 degrees"));
    assert_true(a->error == 0 && b->error == 0);
    int step;
    if (sscanf(b->why, "up to step %d alone", &step) != 1) fail_msg("%s", b->why);
    assert_true(step > 1 && step < coiled.report.steps);
    assert_null(entry(&always, "self_contact"));
    assert_int_equal(coiled.report.contact.intersections, 0);
    assert_int_equal(always.report.contact.intersections, 0);
    assert_non_null(entry(&never, "self_contact"));
    for (int i = 0; i < 3 * coiled.n; i++) /* before it could meet itself nothing was different */
        assert_true(fabs(coiled.x[i] - always.x[i]) <= 1e-4 * 0.3);
    put_away(&still), put_away(&coiled), put_away(&always), put_away(&never);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_part_left_out_or_done_moves_the_same_body_the_same_way),
        cmocka_unit_test(what_inertia_would_have_done_is_measured_from_the_start),
        cmocka_unit_test(measuring_changes_nothing_at_any_density),
        cmocka_unit_test(a_stress_limit_brings_stress_back_although_it_is_left_out),
        cmocka_unit_test(a_body_at_rest_keeps_its_factor_and_one_that_turns_gets_new_ones),
        cmocka_unit_test(a_snake_that_coils_meets_itself_from_the_step_on_where_it_could),
    };
    const int made = mkstemp(file);
    if (made < 0) return 1;
    close(made);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    unlink(file);
    return failed;
}
