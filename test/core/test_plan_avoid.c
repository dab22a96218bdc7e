/* test_plan_avoid.c - past moving obstacles: a body waits for one that crosses its way, is told when no
 * timing helps, and whole runs keep clear of what they would otherwise touch. LINK: wrap */
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
#include "fail_alloc.h"
#include "run_parts.h"
#include "scene_steps.h"

/* A bar 0.3 x 0.1 x 0.1 about the origin, its way 2 m along x; a ball of 0.2 m with a path of its own. */
#define WATER                                                                                                \
    "step: 0.02\ntime_limit: 20\nobstacles:\n- {name: stone, shape: {box: {min: [1.2, 1.4, -0.2], max: "     \
    "[1.4, "                                                                                                 \
    "1.6, 0.2]}}}\n- name: predator\n  shape: {sphere: {centre: [%g, %g, 0], radius: 0.2}}\n"                \
    "  path: {waypoints: [[%g, %g, 0]], speed: %g}\nbodies:\n- name: fish\n"                                 \
    "  shape: {beam: {size: [0.3, 0.1, 0.1], cells: [6, 2, 2]}, translate: [-0.15, -0.05, -0.05]}\n"         \
    "  model: tet4\n  material: {young: 1.0e+5, poisson: 0.33, density: 1000}\n"                             \
    "  drive: {nodes: %s, speed: 0.5, path_distance: 0.01}\n  waypoints: [[2, 0, 0]]\n"                      \
    "  waypoint_tolerance: 0.03\n  path: {max_turn_deg: 120}\ncontact: {gap: 0.01}\n"
enum { SPEED = 5 }; /* tenths of a metre a second */

typedef struct {
    double from[2], to[2], speed;
} ball;
static const ball crosses = {{1, -1.4}, {1, 1.4}, 0.7}, heads_on = {{2.6, 0}, {-1.5, 0}, 0.4},
                  ends_there = {{2, -1}, {2, 0}, 0.3}, ends_beside = {{2, -1.6}, {2, -0.6}, 0.3};

static void text_of(char text[1200], const ball *b, const char *nodes)
{
    snprintf(text, 1200, WATER, b->from[0], b->from[1], b->to[0], b->to[1], b->speed, nodes);
}

static cn_path *straight_way(double length)
{
    cn_path *path;
    const double x[9] = {0, 0, 0, 0.5 * length, 0, 0, length, 0, 0};
    assert_int_equal(cn_path_new(&path, 3, x, 1, (int[]){2}, NULL), CN_OK);
    return path;
}

/* Between the bar with its middle at (x, 0, 0) and the ball of radius 0.2 about (p, q, 0). */
static double apart(double x, double p, double q)
{
    return hypot(fmax(0, fabs(p - x) - 0.15), fmax(0, fabs(q) - 0.05)) - 0.2;
}

typedef struct {
    cn_status status;
    double least, arrived; /* [m], [s] */
    bool waited, turned;
} outcome;

/* The bar goes as it is told, at its speed or not at all: what it needs, without a step's mechanics. */
static outcome go(const ball *b, const char *nodes, bool told)
{
    char text[1200];
    scene_steps s;
    text_of(text, b, nodes);
    scene_steps_new(&s, text, 0, NULL);
    cn_avoid *avoid;
    cn_path *path = straight_way(2);
    const cn_model_body *body = &s.model->body[0];
    cn_body_state *state = &s.state->body[0];
    outcome o = {.least = INFINITY, .arrived = -1};
    const double way = hypot(b->to[0] - b->from[0], b->to[1] - b->from[1]), dt = s.scene->step;
    assert_int_equal(cn_avoid_new(&avoid, s.world, body, 0.01), CN_OK);
    for (int step = 0; step * dt < 20 && o.arrived < 0; step++) {
        cn_meeting meeting;
        if (told) o.status = cn_avoid_look(avoid, state, path, step * dt, &state->until, &meeting);
        if (o.status != CN_OK) {
            assert_int_equal(meeting.wall, 1);
            assert_true(meeting.distance < meeting.least && meeting.ball.radius > 0.2);
            break;
        }
        const double left = fmin(2, state->until) - state->s_goal, most = 0.1 * SPEED * dt;
        const double ds = fmax(-most, fmin(most, left)), share = fmin(1, step * dt * b->speed / way);
        o.waited |= ds == 0, o.turned |= ds < 0;
        state->s_goal += ds;
        for (int i = 0; i < body->body->nnode; i++)
            state->x[3 * i] += ds;
        o.least = fmin(o.least, apart(state->s_goal, b->from[0] + share * (b->to[0] - b->from[0]),
                                      b->from[1] + share * (b->to[1] - b->from[1])));
        if (state->s_goal > 2 - 1e-9) o.arrived = (step + 1) * dt;
    }
    cn_avoid_free(avoid), cn_path_free(path), scene_steps_free(&s);
    return o;
}

static void a_body_waits_for_what_crosses_its_way_and_keeps_clear_of_it(void **state)
{
    (void)state;
    for (int uniform = 0; uniform < 2; uniform++) {
        const char *nodes = uniform ? "uniform" : "each";
        const outcome blind = go(&crosses, nodes, false), told = go(&crosses, nodes, true);
        assert_true(blind.least < 0 && fabs(blind.arrived - 4) < 0.05);
        assert_int_equal(told.status, CN_OK);
        assert_true(told.waited || told.turned);
        assert_true(told.least >= 0.01);
        assert_true(told.arrived > blind.arrived && told.arrived < 7);
    }
}

static void one_that_comes_along_the_way_itself_cannot_be_waited_for(void **state)
{
    (void)state;
    assert_int_equal(go(&heads_on, "each", true).status, CN_ERR_NO_PATH);
    assert_int_equal(go(&ends_there, "each", true).status, CN_ERR_NO_PATH);
    const outcome beside = go(&ends_beside, "each", true);
    assert_int_equal(beside.status, CN_OK);
    assert_true(beside.arrived > 0 && beside.least >= 0.01 && !beside.waited);
}

static void where_nothing_moves_nothing_is_looked_at(void **state)
{
    (void)state;
    char text[1200], *at;
    scene_steps s;
    cn_avoid *avoid;
    text_of(text, &crosses, "each");
    at = strstr(text, "  path: {way");
    memset(at, ' ', (size_t)(strchr(at, '\n') - at));
    scene_steps_new(&s, text, 0, NULL);
    assert_int_equal(cn_avoid_new(&avoid, s.world, &s.model->body[0], 0.01), CN_OK);
    assert_null(avoid);
    cn_avoid_free(avoid), scene_steps_free(&s);
}

static void a_failed_allocation_is_told_and_leaves_nothing_behind(void **state)
{
    (void)state;
    char text[1200];
    scene_steps s;
    cn_path *path = straight_way(2);
    text_of(text, &crosses, "each");
    scene_steps_new(&s, text, 0, NULL);
    cn_status status = CN_OK;
    for (FAIL_EACH_ALLOC) {
        cn_avoid *avoid;
        cn_meeting meeting;
        double until;
        status = cn_avoid_new(&avoid, s.world, &s.model->body[0], 0.01);
        if (status == CN_OK) status = cn_avoid_look(avoid, &s.state->body[0], path, 0, &until, &meeting);
        assert_true(status == CN_OK || status == CN_ERR_MEMORY);
        cn_avoid_free(avoid);
    }
    assert_int_equal(status, CN_OK);
    cn_path_free(path), scene_steps_free(&s);
}

/* --- whole runs --- */

/* Around refused balls by a point beside each, in y. */
static cn_status planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const int n = query->nrefused, last = query->npoint - 1;
    (void)error;
    memset(roadmap, 0, sizeof *roadmap);
    roadmap->reproducible = true, roadmap->npoint = 2 + 3 * (n > 0);
    roadmap->x = malloc(15 * sizeof(double)), roadmap->leg = malloc(5 * sizeof(int));
    if (!roadmap->x || !roadmap->leg) return CN_ERR_MEMORY;
    cn_copy3(query->point, roadmap->x), roadmap->leg[0] = 0;
    for (int i = 1; n > 0 && i < 4; i++) {
        const cn_ball *b = &query->refused[n - 1];
        const double x[3] = {b->centre[0] + (i - 2) * 1.2 * b->radius, -1.3 * b->radius, 0};
        cn_copy3(x, roadmap->x + 3 * i), roadmap->leg[i] = 1;
    }
    cn_copy3(query->point + 3 * last, roadmap->x + 3 * (roadmap->npoint - 1));
    roadmap->leg[roadmap->npoint - 1] = last;
    return CN_OK;
}

typedef struct {
    const ball *ball;
    bool blind;
    double least; /* distance between nodes and ball, at accepted steps [m] */
} watch;

static bool see(void *user, cn_run_data *run)
{
    watch *w = user;
    const ball *b = w->ball;
    const double way = hypot(b->to[0] - b->from[0], b->to[1] - b->from[1]);
    const double share = fmin(1, run->state->time * b->speed / way);
    const double at[3] = {b->from[0] + share * (b->to[0] - b->from[0]),
                          b->from[1] + share * (b->to[1] - b->from[1]), 0};
    for (int i = 0; i < run->model->body[0].body->nnode; i++)
        w->least = fmin(w->least, cn_distance(run->state->body[0].x + 3 * i, at) - 0.2);
    if (w->blind) run->state->body[0].until = INFINITY, run->body[0].looked = run->state->step;
    return true;
}

static cn_report swim(const ball *b, bool blind, double *least)
{
    char text[1200], file[] = "/tmp/catnav-avoid-XXXXXX";
    cn_scene *scene;
    cn_world *world;
    cn_report report;
    cn_error error = {0};
    watch w = {.ball = b, .blind = blind, .least = INFINITY};
    text_of(text, b, "each");
    const int descriptor = mkstemp(file);
    assert_true(descriptor >= 0 && write(descriptor, text, strlen(text)) == (ssize_t)strlen(text));
    close(descriptor);
    assert_int_equal(cn_scene_read(&scene, file, 0, NULL, &error), CN_OK);
    remove(file);
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    assert_int_equal(cn_run_visited(world, NULL, planner, 1, NULL, see, &w, &report, &error), CN_OK);
    *least = w.least;
    cn_world_free(world), cn_scene_free(scene);
    return report;
}

static void a_fish_that_would_touch_what_crosses_its_way_arrives_clear_of_it(void **state)
{
    (void)state;
    double blind, told;
    cn_report touched = swim(&crosses, true, &blind), report = swim(&crosses, false, &told);
    assert_true(blind < 0.01); /* as near as contact's gap */
    assert_int_equal(report.verdict.code, CN_VERDICT_REACHED);
    assert_true(told >= 0.01);
    assert_int_equal(report.replans, 0);
    cn_report_clear(&touched), cn_report_clear(&report);
}

static void one_that_comes_along_the_way_is_passed_on_another(void **state)
{
    (void)state;
    double told;
    cn_report report = swim(&heads_on, false, &told);
    assert_int_equal(report.verdict.code, CN_VERDICT_REACHED);
    assert_true(told >= 0.01 && report.replans >= 1);
    cn_report_clear(&report);
}

static void what_comes_to_rest_on_the_goal_is_said_to_and_does_not_loop(void **state)
{
    (void)state;
    double told;
    cn_report report = swim(&ends_there, false, &told);
    assert_int_equal(report.verdict.code, CN_VERDICT_LIMIT_BROKEN);
    assert_true(report.verdict.has_quantity && report.verdict.quantity == CN_QUANTITY_CLEARANCE);
    assert_true(report.verdict.value < report.verdict.limit && told >= 0.01);
    assert_non_null(strstr(report.verdict.message, "predator"));
    cn_report_clear(&report);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_body_waits_for_what_crosses_its_way_and_keeps_clear_of_it),
        cmocka_unit_test(one_that_comes_along_the_way_itself_cannot_be_waited_for),
        cmocka_unit_test(where_nothing_moves_nothing_is_looked_at),
        cmocka_unit_test(a_failed_allocation_is_told_and_leaves_nothing_behind),
        cmocka_unit_test(a_fish_that_would_touch_what_crosses_its_way_arrives_clear_of_it),
        cmocka_unit_test(one_that_comes_along_the_way_is_passed_on_another),
        cmocka_unit_test(what_comes_to_rest_on_the_goal_is_said_to_and_does_not_loop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
