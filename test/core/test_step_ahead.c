/* test_step_ahead.c - where a step's iteration begins: what turns is led along its circle. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "shapes.h"
#include "step_parts.h"
#include "stepper.h"

/* A chain of stations of four nodes each, or with rod of one node and its rotation; seen as slices of `per`
 * nodes. */
enum { STATIONS = 9, FOUR = 4, NODES = STATIONS * FOUR };

typedef struct {
    cn_model model;
    cn_body body;
    cn_model_body of_model;
    cn_body_state from;
    cn_part part;
    cn_stage stage;
    cn_group group;
    double x[6 * NODES], dx[6 * NODES], mass[NODES];
    unsigned char fixed[2 * NODES];
    int node[NODES], slice[STATIONS + 1];
    cn_slice led[STATIONS];
} chain;

static void make(chain *c, bool rod, bool slender)
{
    const int per = rod ? 1 : FOUR, nnode = STATIONS * per;
    unsigned seed = 3;
    memset(c, 0, sizeof *c);
    c->body = (cn_body){.model = rod ? CN_BODY_ROD : CN_BODY_TET4,
                        .nnode = nnode,
                        .nblock = rod ? 2 * nnode : nnode,
                        .mass = c->mass};
    for (int i = 0; i < nnode; i++) {
        c->x[3 * i] = 0.1 * (i / per) + 0.02 * shape_random(&seed);
        for (int k = 1; k < 3; k++)
            c->x[3 * i + k] = 0.05 * shape_random(&seed);
        c->mass[i] = 1.5 + shape_random(&seed), c->node[i] = i;
    }
    c->part.nslice = slender ? STATIONS : 1;
    for (int l = 0; l <= c->part.nslice; l++)
        c->slice[l] = slender ? per * l : nnode * l;
    c->of_model.body = &c->body, c->of_model.fixed = c->fixed, c->from.x = c->x;
    c->part.model = &c->model, c->part.body = &c->of_model;
    c->part.dx = c->dx, c->part.node = c->node, c->part.slice = c->slice, c->part.led = c->led;
    c->stage = (cn_stage){.part = &c->part, .from = &c->from, .x = c->x, .nfree = nnode};
    c->group = (cn_group){.n = 1, .stage = &c->stage};
}

/* What a turn by w [rad] about `pivot` and a shift did in the last step (chord), or does by its velocities.
 */
static void move(chain *c, const double w[3], const double pivot[3], const double shift[3], bool chord)
{
    double back[9], less[3];
    for (int k = 0; k < 3; k++)
        less[k] = -w[k];
    cn_rotation(less, back);
    for (int i = 0; i < c->body.nnode; i++) {
        double arm[3], to[3];
        cn_sub(c->x + 3 * i, pivot, arm);
        if (chord)
            cn_mat_vec(back, arm, to), cn_sub(arm, to, c->dx + 3 * i);
        else
            cn_cross(w, arm, c->dx + 3 * i);
        cn_axpy(1, shift, c->dx + 3 * i);
        if (c->body.nblock > c->body.nnode) cn_copy3(w, c->dx + 3 * (c->body.nnode + i));
    }
}

/* Largest distance of where nodes are led from where the turn takes them. */
static double missed(const chain *c, const double w[3], const double pivot[3], const double shift[3])
{
    double r[9], most = 0;
    cn_rotation(w, r);
    for (int i = 0; i < c->body.nnode; i++) {
        double arm[3], to[3], led[3];
        cn_sub(c->x + 3 * i, pivot, arm);
        cn_mat_vec(r, arm, to);
        cn_add(to, shift, to), cn_add(arm, c->dx + 3 * i, led);
        most = fmax(most, cn_distance(to, led));
    }
    return most;
}

static void mass_centre(const chain *c, double centre[3])
{
    double mass = 0;
    memset(centre, 0, 3 * sizeof *centre);
    for (int i = 0; i < c->body.nnode; i++)
        cn_axpy(c->mass[i], c->x + 3 * i, centre), mass += c->mass[i];
    for (int k = 0; k < 3; k++)
        centre[k] /= mass;
}

static const double none[3] = {0, 0, 0};

static void what_turned_goes_on_turning(void **state)
{
    const double w[3] = {0.25, -0.15, 0.35}, shift[3] = {0.2, 0.1, -0.4};
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        chain c;
        double centre[3];
        make(&c, kind == 2, kind > 0);
        mass_centre(&c, centre);
        move(&c, w, centre, shift, true);
        cn_stage_lead(&c.group, true);
        assert_true(missed(&c, w, centre, shift) < 1e-14);

        if (kind == 0) continue;
        make(&c, kind == 2, true); /* and about a station that is held, at the one end, or amid */
        for (int at = 0; at < STATIONS; at += 4) {
            const int per = c.body.nnode / STATIONS;
            memset(c.fixed, 0, sizeof c.fixed);
            memset(c.fixed + per * at, 1, (size_t)per);
            move(&c, w, c.x + 3 * per * at, none, true);
            memset(c.dx + 3 * per * at, 0, 3 * (size_t)per * sizeof(double));
            const double far = missed(&c, w, c.x + 3 * per * at, none);
            cn_stage_lead(&c.group, true);
            /* only the joints of the station that does not turn are led by half of the angle */
            assert_true(missed(&c, w, c.x + 3 * per * at, none) < 0.6 * far);
        }
    }
}

static void a_tangent_is_led_to_third_order(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        double last = 0;
        for (double angle = 0.2; angle > 0.04; angle *= 0.5) {
            const double w[3] = {0, 0.6 * angle, 0.8 * angle};
            chain c;
            double centre[3];
            make(&c, kind == 2, kind > 0);
            mass_centre(&c, centre);
            move(&c, w, centre, none, false);
            cn_stage_lead(&c.group, false);
            const double error = missed(&c, w, centre, none);
            if (last > 0) assert_true(last / error > 7.5); /* 8: third order; a straight line's is second */
            last = error;
        }
    }
}

static void a_free_body_keeps_its_momentum_and_a_straight_motion_is_kept(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        chain c;
        unsigned seed = 7;
        double before[3] = {0}, after[3] = {0};
        make(&c, kind == 2, kind > 0);
        for (int i = 0; i < 6 * NODES; i++)
            c.dx[i] = 0.03 * shape_random(&seed);
        for (int i = 0; i < c.body.nnode; i++)
            cn_axpy(c.mass[i], c.dx + 3 * i, before);
        cn_stage_lead(&c.group, true);
        for (int i = 0; i < c.body.nnode; i++)
            cn_axpy(c.mass[i], c.dx + 3 * i, after);
        assert_true(cn_distance(before, after) < 1e-13);

        const double shift[3] = {1, 2, 3};
        move(&c, none, none, shift, true);
        cn_stage_lead(&c.group, true);
        for (int i = 0; i < c.body.nnode; i++)
            assert_true(cn_distance(c.dx + 3 * i, shift) < 1e-14);
    }
}

/* Stiff bodies that spin by a third of a radian a step: no iteration is spent on a straight line's stretch.
 */
static void a_spinning_body_is_solved_in_few_iterations(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        cn_tets *mesh = kind == 0   ? shape_box(3, 3, 3, 0.1)
                        : kind == 1 ? shape_box(40, 2, 2, 0.1)
                                    : shape_chain(40, 6, 2e-3, 1e-3);
        const double spin = kind == 1 ? 5 : 30;
        int newton = 0;
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e8, .poisson = 0.3, .density = 1000}, 0.01);
        s.scene.solver.tolerance = 1e-3;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        for (int i = 0; i < mesh->nnode; i++) {
            s.now->v[3 * i] = -spin * s.now->x[3 * i + 2];
            s.now->v[3 * i + 2] = spin * s.now->x[3 * i];
        }
        for (int i = 0; i < 10; i++) {
            stepper_step(&s);
            newton += s.figure.newton;
        }
        print_message("%d iterations in 10 steps\n", newton);
        assert_true(newton <= 25); /* 40, 39 and 28 along straight lines */
        stepper_free(&s);
        cn_tets_free(mesh);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_turned_goes_on_turning),
        cmocka_unit_test(a_tangent_is_led_to_third_order),
        cmocka_unit_test(a_free_body_keeps_its_momentum_and_a_straight_motion_is_kept),
        cmocka_unit_test(a_spinning_body_is_solved_in_few_iterations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
