/* test_step_rejected.c - a step that is taken back leaves nothing behind: the state is as it was, bit for
 * bit, and the run goes on as if the step had never been tried. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include "body_wall.h"
#include "scene_steps.h"

/* A block slides on a floor with friction, a rod falls across it: contact, links, warm starts. */
static const char text[] =
    "step: 0.004\ngravity: [1, 0, -9.81]\n"
    "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, 0], normal: [0, 0, 1]}}}\n"
    "bodies:\n"
    "- name: block\n  shape: {beam: {size: [0.1, 0.1, 0.05], cells: [3, 3, 2]}, translate: [0, 0, 0.001]}\n  "
    "model: tet4\n"
    "  material: {young: 1.0e+5, poisson: 0.3, density: 1000}\n"
    "- name: wire\n  shape: {beam: {size: [0.3, 0.004, 0.004], cells: [20, 1, 1]}, translate: [-0.1, 0.05, "
    "0.054]}\n"
    "  model: rod\n  material: {young: 1.0e+8, poisson: 0.3, density: 1000}\n"
    "contact: {friction: 0.3, self: off}\n";

/* A heavy rod sinks into an artery that gives way, whose triangles turn by it. */
static const char soft[] =
    "step: 0.004\ngravity: [0, 0, -20]\n"
    "vessels:\n- name: artery\n  shape: {tube: {axis: [[0, 0, 0], [0.01, 0, 0], [0.02, 0, 0], [0.03, 0, 0], "
    "[0.04, 0, 0], [0.05, 0, 0], [0.06, 0, 0]], radius: 0.01, thickness: 0}}\n"
    "  wall: {model: membrane, thickness: 1.0e-3, young: 1.0e+4, poisson: 0.4, density: 1000, foundation: "
    "2.0e+4, "
    "rims: held}\n"
    "bodies:\n"
    "- name: wire\n  shape: {beam: {size: [0.03, 0.002, 0.002], cells: [6, 1, 1]}, translate: [0.015, 0, "
    "-0.0085]}\n"
    "  model: rod\n  material: {young: 1.0e+8, poisson: 0.3, density: 7800}\n";

static void same_bits(const scene_steps *a, const cn_state *b)
{
    for (int i = 0; i < a->state->nbody; i++) {
        const cn_body *body = a->model->body[i].body;
        const cn_body_state *s = &a->state->body[i], *t = &b->body[i];
        assert_memory_equal(s->x, t->x, 3 * (size_t)body->nblock * sizeof *s->x);
        assert_memory_equal(s->v, t->v, 3 * (size_t)body->nblock * sizeof *s->v);
        assert_memory_equal(s->rotation, t->rotation, 4 * (size_t)body->nturn * sizeof *s->rotation);
    }
}

/* Many steps tried and taken back between those that are kept, some too long to be computed well. */
static void take_back(const char *text, int many, scene_steps *last)
{
    enum { KEPT = 50 };
    scene_steps straight, often;
    cn_state *kept;
    scene_steps_new(&straight, text, 0, NULL), scene_steps_new(&often, text, 0, NULL);
    assert_int_equal(cn_state_new(&kept, often.model), CN_OK);
    for (int i = 0; i < KEPT; i++) {
        cn_state_copy(kept, often.state);
        for (int k = 0; k < many; k++) { /* shorter ones, and some of a hundred times the length */
            const double dt = often.scene->step * (k % 10 == 9 ? 100 : 0.3 + 0.1 * k);
            cn_step(often.model, often.state, often.trial, NULL, dt, often.work, often.figures);
            same_bits(&often, kept);
        }
        scene_steps_go(&straight, 1), scene_steps_go(&often, 1);
        same_bits(&often, straight.state);
    }
    assert_true(often.figures->findings.intersections + often.figures->findings.outside == 0);
    cn_state_free(kept);
    scene_steps_free(&straight);
    *last = often;
}

static void a_thousand_steps_taken_back_change_nothing(void **state)
{
    scene_steps last;
    (void)state;
    take_back(text, 20, &last);
    scene_steps_free(&last);
}

static void nor_do_steps_of_a_wall_whose_triangles_turn(void **state)
{
    scene_steps last;
    (void)state;
    take_back(soft, 6, &last);
    const int wall = 1;
    const cn_body *body = last.model->body[wall].body;
    assert_int_equal(body->model, CN_BODY_MEMBRANE);
    assert_true(cn_sheet_turns(body, last.state->body[wall].rotation));
    const size_t turns = 4 * (size_t)body->nturn * sizeof(double); /* and its matrix is near to where it is */
    double *rotation = last.state->body[wall].rotation, *as_it_was = malloc(turns);
    memcpy(as_it_was, rotation, turns);
    cn_sheet_follow(body, last.state->body[wall].x, rotation, CN_SHEET_FOLLOWS, NULL);
    assert_memory_equal(rotation, as_it_was, turns);
    free(as_it_was);
    scene_steps_free(&last);
}

static void a_step_that_is_called_off_ends_at_once_and_changes_nothing(void **state)
{
    volatile sig_atomic_t off = 0;
    scene_steps straight, watched;
    (void)state;
    scene_steps_new(&straight, text, 0, NULL), scene_steps_new(&watched, text, 0, NULL);
    cn_work_watch(watched.work, &off);
    for (int i = 0; i < 5; i++) {
        off = 1;
        assert_int_equal(scene_steps_try(&watched), CN_ERR_CANCELLED);
        same_bits(&watched, straight.state);
        off = 0;
        scene_steps_go(&watched, 1), scene_steps_go(&straight, 1);
        same_bits(&watched, straight.state);
    }
    scene_steps_free(&straight), scene_steps_free(&watched);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_thousand_steps_taken_back_change_nothing),
        cmocka_unit_test(nor_do_steps_of_a_wall_whose_triangles_turn),
        cmocka_unit_test(a_step_that_is_called_off_ends_at_once_and_changes_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
