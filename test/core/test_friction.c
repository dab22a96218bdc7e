/* test_friction.c - Coulomb friction in strict contact: stick and slip, stopping, capstan, what is kept. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/run.h"
#include "catnav/vec3.h"
#include "contact.h"
#include "scene_steps.h"
#include "stepper.h"

#define FLOOR "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, %g], normal: [0, 0, 1]}}}\n"

/* A block on a floor; the incline is in gravity's direction, downhill along +x. */
static void on_incline(scene_steps *s, const char *model, double mu, double degrees, double g, double v0,
                       double step)
{
    const double angle = degrees * acos(-1.0) / 180;
    char text[1024];
    snprintf(text, sizeof text,
             "step: %g\ngravity: [%.17g, 0, %.17g]\n" FLOOR
             "bodies:\n- name: block\n  shape: {beam: {size: [0.1, 0.1, 0.05], cells: [3, 3, 2]}}\n"
             "  model: %s\n  material: {young: 1.0e+7, poisson: 0.3, density: 1000, damping: 0}\n"
             "  start: {velocity: [%g, 0, 0]}\n"
             "contact: {friction: %g}\n",
             step, g * sin(angle), -g * cos(angle), -0.00248, model, v0, mu);
    scene_steps_new(s, text, 0, NULL);
}

/* Acceleration, creep and stopping distance of every case, with both kinds of body. */
static void a_block_on_an_incline_sticks_slides_and_stops_by_the_law(void **state)
{
    static const char *const models[] = {"tet4", "rod"};
    const double step = 0.005;
    json_t *json = reference_json("data/incline_friction.json"), *item;
    (void)state;
    if (!json) skip();
    for (int k = 0; k < 2; k++) {
        size_t i;
        json_array_foreach(json_object_get(json, "cases"), i, item)
        {
            const double mu = json_number(item, "mu"), v0 = json_number(item, "v0");
            const double slides = json_number(item, "acceleration_sliding_down");
            const bool sticks = json_is_true(json_object_get(item, "sticks_from_rest"));
            scene_steps s;
            on_incline(&s, models[k], mu, json_number(item, "incline_deg"), json_number(item, "g"), v0, step);
            const double x0 = scene_steps_motion(&s, 0).centre[0];
            scene_steps_go(&s, 40); /* settled */
            const scene_motion then = scene_steps_motion(&s, 0);
            if (v0 > 0) { /* slides to a stop */
                const double stop = json_number(item, "stop_distance");
                scene_steps_go(&s, 20);
                const double a = (scene_steps_motion(&s, 0).velocity[0] - then.velocity[0]) / (20 * step);
                if (!(fabs(a - slides) < 0.01 * fabs(slides)))
                    fail_msg("%s %zu: %g not %g", models[k], i, a, slides);
                scene_steps_go(&s, (int)(v0 / fabs(slides) / step) - 40);
                const double x = scene_steps_motion(&s, 0).centre[0];
                if (!(fabs(x - x0 - stop) < 0.01 * stop + v0 * step))
                    fail_msg("stops after %g, not %g", x - x0, stop);
                scene_steps_go(&s, 50);
                const double crept = scene_steps_motion(&s, 0).centre[0] - x;
                if (!(fabs(crept) < 1e-6)) fail_msg("creeps %g m", crept);
            } else if (sticks) {
                scene_steps_go(&s, 200);
                const double crept = scene_steps_motion(&s, 0).centre[0] - then.centre[0];
                if (!(crept > 0 && crept < 1e-6)) fail_msg("%s %zu: creeps %g m in 1 s", models[k], i, crept);
            } else {
                scene_steps_go(&s, 40);
                const double a = (scene_steps_motion(&s, 0).velocity[0] - then.velocity[0]) / (40 * step);
                if (!(fabs(a - slides) < 0.01 * slides))
                    fail_msg("%s %zu: %g not %g", models[k], i, a, slides);
            }
            scene_steps_free(&s);
        }
    }
    json_decref(json);
}

/* A thin rod over a drum, pulled at both ends: it hangs on up to T_low exp(mu angle), and slides beyond. */
typedef struct {
    double mu, wrap, low, high;
} rope;

enum { ARC = 60, TAIL = 4 }; /* segments */
static const double drum = 0.1, thick = 0.002;

/* Positions, frames and loads of the rod, bent from its straight rest shape round the top of the drum; after
 * a whole turn its ends pass each other. */
static void wind(scene_steps *s, const rope *r)
{
    const cn_body *b = s->model->body[0].body;
    cn_body_state *state = &s->state->body[0];
    double *force = s->model->body[0].load[0].force;
    const double radius = drum + 0.5 * thick + 1.9e-4, segment = radius * r->wrap / ARC;
    memset(force, 0, 3 * (size_t)b->nblock * sizeof *force);
    for (int i = 0; i < b->nnode; i++) {
        const int on = i < TAIL ? 0 : i > TAIL + ARC ? ARC : i - TAIL;
        const double at = r->wrap * (on / (double)ARC - 0.5), ahead = segment * (i - TAIL - on);
        const double t[3] = {cos(at), 0, -sin(at)}, *q = state->rotation + 4 * i;
        const double c = cos(0.5 * at), d = sin(0.5 * at), p[4] = {q[0], q[1], q[2], q[3]};
        double *turned = state->rotation + 4 * i;
        state->x[3 * i] = radius * sin(at) + ahead * t[0];
        state->x[3 * i + 1] = 0;
        state->x[3 * i + 2] = radius * cos(at) + ahead * t[2];
        turned[0] = c * p[0] - d * p[2], turned[1] = c * p[1] + d * p[3]; /* about y by `at` */
        turned[2] = c * p[2] + d * p[0], turned[3] = c * p[3] - d * p[1];
        if (i == 0) cn_axpy(-r->low, t, force);
        if (i == b->nnode - 1) cn_axpy(r->high, t, force + 3 * i);
    }
}

/* Speed of the pulled end after a while [m/s]. */
static double runs_at(const rope *r)
{
    const double segment = (drum + 0.5 * thick + 1.9e-4) * r->wrap / ARC, length = segment * (ARC + 2 * TAIL);
    char text[1024];
    scene_steps s;
    snprintf(text, sizeof text,
             "step: 0.001\n"
             "obstacles:\n- {name: drum, shape: {tube: {axis: [[0, -0.05, 0], [0, 0.05, 0]], radius: 0.08, "
             "thickness: 0.02}}}\n"
             "bodies:\n- name: rope\n  shape: {beam: {size: [%.17g, %g, %g], cells: [%d, 1, 1]}, "
             "translate: [0, %g, 1]}\n"
             "  model: rod\n  material: {young: %g, poisson: 0.3, density: 1000, damping: 50}\n"
             "  load: [{box: [[-1, -1, -1], [2, 2, 2]], force: [0, 0, 1]}]\n"
             "contact: {friction: %g, gap: 2.0e-4, self: off}\n",
             length, thick, thick, ARC + 2 * TAIL, -0.5 * thick,
             0.01 * drum * drum * r->low * 12 / pow(thick, 4), r->mu);
    scene_steps_new(&s, text, 0, NULL);
    wind(&s, r);
    const cn_body *b = s.model->body[0].body;
    for (int i = 1; i <= 60; i++) { /* pulled ever harder, then evenly */
        const double now = fmin(1, i / 30.0), before = i == 1 ? 1 : fmin(1, (i - 1) / 30.0);
        for (int k = 0; k < 3 * b->nblock; k++)
            s.model->body[0].load[0].force[k] *= now / before;
        scene_steps_go(&s, 1);
    }
    const double v = cn_norm(s.state->body[0].v + 3 * (b->nnode - 1));
    scene_steps_free(&s);
    return v;
}

/* Within 2 %, as 60 sections on the drum are due to hold. */
static void a_rope_holds_round_a_drum_up_to_the_capstan_ratio(void **state)
{
    json_t *json = reference_json("data/capstan.json"), *item;
    size_t i;
    (void)state;
    if (!json) skip();
    json_array_foreach(json_object_get(json, "cases"), i, item)
    {
        rope r = {json_number(item, "mu"), json_number(item, "wrap_rad"), json_number(item, "T_low"), 0};
        const double high = json_number(item, "T_high");
        r.high = 0.98 * high;
        const double holds = runs_at(&r);
        r.high = 1.02 * high;
        const double slides = runs_at(&r);
        if (!(holds < 1e-3 && slides > 0.05)) fail_msg("case %zu: %g m/s, %g m/s", i, holds, slides);
    }
    json_decref(json);
}

static void between_two_bodies_friction_keeps_their_momentum_and_takes_energy(void **state)
{
    static const char text[] =
        "step: 0.002\n"
        "bodies:\n"
        "- name: low\n  shape: {beam: {size: [0.2, 0.1, 0.05], cells: [4, 2, 1]}}\n  model: tet4\n"
        "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n"
        "- name: high\n  shape: {beam: {size: [0.1, 0.05, 0.05], cells: [2, 1, 1]}, translate: [-0.03, "
        "0.004, 0.0565]}\n"
        "  model: tet4\n  material: {young: 1.0e+6, poisson: 0.3, density: 2000}\n"
        "  start: {velocity: [0.5, 0.1, -0.3]}\n"
        "contact: {friction: 0.4}\n"
        "solver: {tolerance: 1.0e-9, linear_tolerance: 1.0e-12}\n";
    scene_steps s;
    double before[3], energy = INFINITY, sideways = 0;
    (void)state;
    scene_steps_new(&s, text, 0, NULL);
    for (int step = 0; step <= 40; step++) {
        const scene_motion low = scene_steps_motion(&s, 0), high = scene_steps_motion(&s, 1);
        double momentum[3], now = low.kinetic + high.kinetic;
        for (int k = 0; k < 3; k++) {
            momentum[k] = low.mass * low.velocity[k] + high.mass * high.velocity[k];
            if (step == 0) before[k] = momentum[k];
            assert_true(fabs(momentum[k] - before[k]) < 1e-8 * fabs(before[2]));
        }
        for (int b = 0; b < 2; b++)
            now += cn_body_energy(s.model->body[b].body, s.model->body[b].body->nnode, s.state->body[b].x,
                                  s.state->body[b].rotation, NULL);
        if (!(now < energy * (1 + 1e-9))) fail_msg("%d: %.12g %.12g", step, now, energy);
        energy = step > 5 ? now : INFINITY; /* once what the barrier lends is given back */
        sideways = low.velocity[0];
        if (step < 40) scene_steps_go(&s, 1);
    }
    assert_true(sideways > 0.01); /* carried along */
    scene_steps_free(&s);
}

/* Stuck to each other by friction that is far stiffer than they are: with all of it in both matrices, solved
 * for 25 times as roughly, it took 223 iterations. */
static void bodies_that_stick_to_each_other_are_solved_in_few_iterations(void **state)
{
    static const char text[] =
        "step: 0.002\ngravity: [1, 0.5, -9.81]\n"
        "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, -0.0025], normal: [0, 0, 1]}}}\n"
        "bodies:\n"
        "- name: low\n  shape: {beam: {size: [0.2, 0.1, 0.05], cells: [8, 4, 2]}}\n  model: tet4\n"
        "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n"
        "- name: high\n  shape: {beam: {size: [0.1, 0.08, 0.05], cells: [5, 4, 2]}, translate: [0.03, 0.004, "
        "0.0515]}\n"
        "  model: tet4\n  material: {young: 1.0e+8, poisson: 0.3, density: 2000}\n"
        "contact: {friction: 0.5}\n";
    scene_steps s;
    (void)state;
    scene_steps_new(&s, text, 0, NULL);
    for (int step = 0; step < 5; step++) {
        scene_steps_go(&s, 1);
        if (!(s.figures->linear < 110)) fail_msg("step %d: %d iterations", step, s.figures->linear);
        assert_int_equal(s.figures->unconverged, 0);
        assert_true(s.figures->residual < 1e-3);
    }
    scene_steps_free(&s);
}

/* Barrier and friction between a block and the one it lies on: force is minus the gradient, the blocks and
 * links together are its derivative. */
static void friction_is_the_gradient_of_its_potential_and_vanishes_over_a_pair(void **state)
{
    static const char text[] =
        "step: 0.002\ngravity: [0, 0, -10]\n"
        "bodies:\n"
        "- name: low\n  shape: {beam: {size: [0.2, 0.2, 0.1], cells: [2, 2, 1]}}\n  model: tet4\n"
        "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n"
        "- name: high\n  shape: {beam: {size: [0.1, 0.1, 0.1], cells: [1, 1, 1]}, translate: [0.03, 0.041, "
        "0.102]}\n"
        "  model: tet4\n  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n"
        "contact: {friction: 0.4}\n";
    scene_steps s;
    cn_contact_model *model;
    cn_contact *contact;
    int nfree[2];
    (void)state;
    scene_steps_new(&s, text, 0, NULL);
    cn_contact_body body[2];
    for (int b = 0; b < 2; b++) {
        body[b] = (cn_contact_body){
            .body = s.model->body[b].body, .wall = -1, .gap = s.model->body[b].gap, .kappa = 1e4};
        nfree[b] = body[b].body->npoint;
    }
    assert_int_equal(cn_contact_model_new(&model, s.world, 2, body, NULL), CN_OK);
    assert_int_equal(cn_contact_new(&contact, model), CN_OK);
    const int n = 3 * model->npoint;
    double *start = malloc((size_t)n * sizeof *start), *x = malloc((size_t)n * sizeof *x);
    double *f = calloc((size_t)n, sizeof *f), *g = malloc((size_t)n * sizeof *g);
    for (int b = 0; b < 2; b++)
        memcpy(start + 3 * model->surface[b].first, model->surface[b].rest, 3 * (size_t)nfree[b] * sizeof *x);
    assert_int_equal(cn_contact_find(model, contact, nfree, start, NULL, 0.01, 0, NULL), CN_OK);
    cn_contact_note_friction(model, contact, start, 0.4, NULL);
    assert_true(contact->nrub > 0);
    for (int regime = 0; regime < 2; regime++) {
        const double slip = regime ? 1e-4 : 1e-2, far = 1e-3, h = 1e-7; /* slides, sticks */
        double sum[3] = {0, 0, 0}, largest = 0;
        srand(7);
        for (int i = 0; i < n; i++)
            x[i] = start[i] + far * (rand() / (double)RAND_MAX + (i >= 3 * nfree[0]));
        memset(f, 0, (size_t)n * sizeof *f);
        const double energy = cn_contact_add_friction(model, contact, x, start, slip, f, NULL);
        assert_true(energy > 0);
        for (int i = 0; i < n; i++) {
            const double xi = x[i];
            x[i] = xi + h;
            const double up = cn_contact_add_friction(model, contact, x, start, slip, g, NULL);
            x[i] = xi - h;
            const double down = cn_contact_add_friction(model, contact, x, start, slip, g, NULL);
            x[i] = xi, sum[i % 3] += f[i], largest = fmax(largest, fabs(f[i]));
            assert_true(fabs(f[i] + (up - down) / (2 * h)) < 1e-6 * (1 + largest));
        }
        assert_true(largest > 0 && cn_norm(sum) < 1e-12 * largest);
        /* the derivative along a direction: own blocks and links */
        cn_hang hang[2];
        double *d = malloc((size_t)n * sizeof *d), *kd = calloc((size_t)n, sizeof *kd),
               *own = calloc((size_t)n, sizeof *own);
        const int zero = 0;
        for (int b = 0; b < 2; b++) {
            hang[b] = (cn_hang){0};
            assert_int_equal(cn_matrix_new(&hang[b].matrix, 1, &body[b].body, &zero), CN_OK);
            cn_matrix_clear(hang[b].matrix, nfree[b]);
        }
        contact->nlink = 0;
        memset(g, 0, (size_t)n * sizeof *g);
        cn_contact_add_friction(model, contact, x, start, slip, g, hang);
        for (int i = 0; i < n; i++)
            d[i] = rand() / (double)RAND_MAX - 0.5;
        for (int b = 0; b < 2; b++)
            cn_matrix_multiply(hang[b].matrix, nfree[b], d + 3 * model->surface[b].first,
                               own + 3 * model->surface[b].first, NULL);
        for (int l = 0; l < contact->nlink; l++) {
            const cn_link *link = &contact->link[l];
            for (int i = 0; i < 4; i++)
                for (int j = 0; j < 4; j++)
                    if ((i < link->nside) != (j < link->nside))
                        cn_axpy(link->k * link->w[i] * link->w[j] * cn_dot(link->n, d + 3 * link->p[j]),
                                link->n, own + 3 * link->p[i]);
        }
        for (int side = 0; side < 2; side++) {
            for (int i = 0; i < n; i++)
                g[i] = start[i] + (x[i] - start[i]) + (side ? -h : h) * d[i];
            memset(f, 0, (size_t)n * sizeof *f);
            cn_contact_add_friction(model, contact, g, start, slip, f, NULL);
            for (int i = 0; i < n; i++)
                kd[i] += (side ? 1 : -1) * f[i] / (2 * h);
        }
        double most = 0;
        for (int i = 0; i < n; i++)
            most = fmax(most, fabs(kd[i]));
        for (int i = 0; i < n; i++)
            if (!(fabs(own[i] - kd[i]) < 1e-5 * most)) fail_msg("%d: %g not %g", i, own[i], kd[i]);
        for (int b = 0; b < 2; b++)
            cn_matrix_free(hang[b].matrix);
        free(d), free(kd), free(own);
    }
    free(start), free(x), free(f), free(g);
    cn_contact_free(contact), cn_contact_model_free(model);
    scene_steps_free(&s);
}

static void without_a_coefficient_nothing_changes_bit_for_bit(void **state)
{
    scene_steps a, b;
    (void)state;
    on_incline(&a, "tet4", 0, 20, 9.81, 0.3, 0.005);
    on_incline(&b, "tet4", 0.5, 20, 9.81, 0.3, 0.005);
    b.scene->contact.friction = 0;
    scene_steps_go(&a, 20), scene_steps_go(&b, 20);
    assert_memory_equal(a.state->body->x, b.state->body->x,
                        3 * (size_t)a.model->body->body->nnode * sizeof(double));
    scene_steps_free(&a), scene_steps_free(&b);
}

static void a_wall_that_moves_carries_what_lies_on_it(void **state)
{
    static const char text[] =
        "step: 0.005\ngravity: [0, 0, -9.81]\n"
        "obstacles:\n"
        "- {name: belt, shape: {box: {min: [-0.5, -0.3, -0.1], max: [0.5, 0.4, -0.002]}},\n"
        "   path: {waypoints: [[0.5, 0.05, -0.051]], speed: 0.5}}\n"
        "bodies:\n- name: block\n  shape: {beam: {size: [0.1, 0.1, 0.05], cells: [2, 2, 1]}}\n  model: tet4\n"
        "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n"
        "contact: {friction: 0.4}\n";
    scene_steps s;
    (void)state;
    scene_steps_new(&s, text, 0, NULL);
    scene_steps_go(&s, 20);
    const double early = scene_steps_motion(&s, 0).velocity[0]; /* mu g t until it is as fast as the belt */
    assert_true(fabs(early - 0.4 * 9.81 * 0.1) < 0.1 * early);
    scene_steps_go(&s, 40); /* then with it, but for its own shear to and fro */
    assert_true(fabs(scene_steps_motion(&s, 0).velocity[0] - 0.5) < 1e-3);
    scene_steps_free(&s);
}

/* Friction, restitution and penalty are refused where they would not act. */
static void what_a_response_needs_is_said_before_anything_moves(void **state)
{
    static const cn_setting wants[][2] = {
        {{"contact.friction", "0.1"}, {"contact.method", "project"}},
        {{"contact.friction", "0.1"}, {"solver.integrator", "trbdf2"}},
        {{"contact.response", "elastic"}, {"solver.integrator", "trbdf2"}},
        {{"contact.method", "penalty"}, {"solver.integrator", "trbdf2"}},
    };
    static const char *const named[] = {"use method: strict", "use integrator: euler",
                                        "use integrator: euler", "use integrator: euler"};
    (void)state;
    for (int i = 0; i < 4; i++) {
        scene_steps s;
        cn_report report;
        cn_error error = {0};
        const cn_run_hooks hooks = {0};
        scene_steps_new(&s,
                        "step: 0.005\ntime_limit: 0.01\n"
                        "bodies:\n- name: block\n  shape: {beam: {size: [1, 1, 1], cells: [1, 1, 1]}}\n"
                        "  model: tet4\n  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n",
                        2, wants[i]);
        assert_int_equal(cn_run(s.world, NULL, NULL, 1, &hooks, &report, &error), CN_OK);
        assert_int_not_equal(report.verdict.code, CN_VERDICT_RAN);
        assert_int_equal(report.steps, 0);
        if (!strstr(report.verdict.message, named[i])) fail_msg("%s", report.verdict.message);
        cn_report_clear(&report);
        scene_steps_free(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_block_on_an_incline_sticks_slides_and_stops_by_the_law),
        cmocka_unit_test(a_rope_holds_round_a_drum_up_to_the_capstan_ratio),
        cmocka_unit_test(between_two_bodies_friction_keeps_their_momentum_and_takes_energy),
        cmocka_unit_test(bodies_that_stick_to_each_other_are_solved_in_few_iterations),
        cmocka_unit_test(friction_is_the_gradient_of_its_potential_and_vanishes_over_a_pair),
        cmocka_unit_test(without_a_coefficient_nothing_changes_bit_for_bit),
        cmocka_unit_test(a_wall_that_moves_carries_what_lies_on_it),
        cmocka_unit_test(what_a_response_needs_is_said_before_anything_moves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
