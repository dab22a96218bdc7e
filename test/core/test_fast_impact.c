/* Shots at 100 m/s from within a room of single-layer walls: whatever the step, nothing is ever beyond a
 * wall, told by the room's own bounds. CATNAV_SHOTS: how many, at first 120. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include "scene_steps.h"

static const char room[] =
    "scene: shots\n"
    "step: 1.0e-3\n"
    "vessels:\n"
    "- {name: room, shape: {box: {min: [0, 0, 0], max: [0.02, 0.02, 0.02]}}, wall: {model: rigid}}\n"
    "bodies:\n"
    "- name: shot\n"
    "  shape: {beam: {size: [1.0e-3, 1.0e-3, 1.0e-3], cells: [1, 1, 1]},\n"
    "          translate: [9.5e-3, 9.5e-3, 9.5e-3]}\n"
    "  model: tet4\n"
    "  material: {young: 1.0e+7, poisson: 0.3, density: 1000}\n";
static const double SIDE = 0.02, SPEED = 100; /* [m], [m/s] */

static double drawn(uint64_t *seed) /* in [-1, 1) */
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(*seed >> 11) / 4503599627370496.0 - 1;
}

/* Shots of which every one flies for three steps, 5 to 50 sides of the room long but for the walls. */
static void shoot(const char *young, const char *step, int nshot)
{
    const cn_setting setting[] = {{"bodies.0.material.young", young}, {"step", step}};
    scene_steps s;
    uint64_t seed = 7;
    int refused = 0, beyond = 0, crossed = 0;

    scene_steps_new(&s, room, 2, setting);
    const cn_body *body = s.model->body[0].body;
    cn_body_state *now = &s.state->body[0];
    const size_t n = 3 * (size_t)body->nnode;
    double *start = malloc(n * sizeof *start), *turn = malloc(4 * (size_t)body->nturn * sizeof *turn);
    assert_non_null(start);
    assert_non_null(turn);
    memcpy(start, now->x, n * sizeof *start);
    memcpy(turn, now->rotation, 4 * (size_t)body->nturn * sizeof *turn);
    for (int shot = 0; shot < nshot; shot++) {
        double shift[3], way[3], length = 0;
        for (int k = 0; k < 3; k++) {
            shift[k] = 0.4 * SIDE * drawn(&seed), way[k] = drawn(&seed);
            length += way[k] * way[k];
        }
        now = &s.state->body[0];
        for (size_t i = 0; i < n; i++) {
            now->x[i] = start[i] + shift[i % 3];
            now->v[i] = SPEED * way[i % 3] / sqrt(length) + 0.1 * SPEED * drawn(&seed);
        }
        memcpy(now->rotation, turn, 4 * (size_t)body->nturn * sizeof *turn);
        for (int k = 0; k < 3; k++) {
            if (scene_steps_try(&s) != CN_OK) { /* the state is as before */
                refused++;
                break;
            }
            crossed += s.figures[0].findings.intersections + s.figures[0].findings.outside;
            now = &s.state->body[0];
            for (size_t i = 0; i < n; i++)
                beyond += !(now->x[i] > 0 && now->x[i] < SIDE);
        }
    }
    printf("young %s step %s: %d shots, %d with a step refused, %d nodes beyond, %d crossings\n", young, step,
           nshot, refused, beyond, crossed);
    assert_int_equal(beyond, 0);
    assert_int_equal(crossed, 0);
    assert_true(2 * refused < nshot);
    free(start), free(turn);
    scene_steps_free(&s);
}

static void nothing_shot_at_a_wall_gets_through(void **fixture)
{
    static const char *const young[] = {"1.0e+4", "1.0e+7", "1.6e+11"}, *const step[] = {"1.0e-3", "1.0e-2"};
    const char *asked = getenv("CATNAV_SHOTS");
    const int nshot = asked ? atoi(asked) : 120;
    (void)fixture;
    for (int i = 0; i < 6; i++)
        shoot(young[i / 2], step[i % 2], nshot / 6 + (i < nshot % 6));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(nothing_shot_at_a_wall_gets_through)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
