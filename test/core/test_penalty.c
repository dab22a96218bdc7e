/* test_penalty.c - Egger's penetration springs: faces found, pushes blended, what rests and what is kept. */
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
#include "contact.h"
#include "fail_alloc.h"
#include "geometry.h"
#include "scene_steps.h"
#include "shapes.h"

#define FLOOR  "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, 0], normal: [0, 0, 1]}}}\n"
#define RUBBER "  model: tet4\n  material: {young: 1.0e+6, poisson: 0.3, density: 1000, damping: 5}\n"

/* Contact of a scene's bodies, apart from any step. */
typedef struct {
    scene_steps scene;
    cn_contact_model *model;
    cn_contact *contact;
    cn_penalty *penalty;
    double *x;
    int nfree[4];
} place;

static void set_up(place *p, const char *text)
{
    cn_contact_body body[2];
    scene_steps_new(&p->scene, text, 0, NULL);
    for (int b = 0; b < p->scene.model->nbody; b++)
        body[b] = (cn_contact_body){p->scene.model->body[b].body, -1, false, 1e-3, 1};
    assert_int_equal(cn_contact_model_new(&p->model, p->scene.world, p->scene.model->nbody, body, NULL),
                     CN_OK);
    assert_int_equal(cn_contact_new(&p->contact, p->model), CN_OK);
    assert_int_equal(cn_penalty_new(&p->penalty, p->model, p->contact), CN_OK);
    p->x = malloc(3 * (size_t)p->model->npoint * sizeof *p->x);
    for (int s = 0; s < p->model->nsurface; s++) {
        const cn_contact_surface *surface = &p->model->surface[s];
        p->nfree[s] = surface->npoint;
        memcpy(p->x + 3 * surface->first, surface->rest, 3 * (size_t)surface->npoint * sizeof *p->x);
    }
}

static void put_away(place *p)
{
    free(p->x);
    cn_penalty_free(p->penalty), cn_contact_free(p->contact), cn_contact_model_free(p->model);
    scene_steps_free(&p->scene);
}

static void corners(const place *p, int surface, int t, double q[3][3])
{
    const cn_contact_surface *s = &p->model->surface[surface];
    for (int k = 0; k < 3; k++)
        cn_copy3(p->x + 3 * (s->first + s->tri[3 * t + k]), q[k]);
}

static bool crosses(const place *p, int a, int t, int b)
{
    double qa[3][3], qb[3][3];
    corners(p, a, t, qa);
    for (int u = 0; u < p->model->surface[b].ntri; u++) {
        corners(p, b, u, qb);
        if (cn_tri_tri((const double(*)[3])qa, (const double(*)[3])qb) != CN_TRI_APART) return true;
    }
    return false;
}

/* Convex surface b: inside is below all its faces. */
static bool convex_holds(const place *p, int b, const double c[3])
{
    double q[3][3], e1[3], e2[3], n[3], d[3];
    for (int u = 0; u < p->model->surface[b].ntri; u++) {
        corners(p, b, u, q);
        cn_sub(q[1], q[0], e1), cn_sub(q[2], q[0], e2), cn_cross(e1, e2, n), cn_sub(c, q[0], d);
        if (cn_dot(n, d) > 0) return false;
    }
    return true;
}

static const char two_boxes[] =
    "bodies:\n"
    "- name: one\n  shape: {beam: {size: [1, 0.8, 0.6], cells: [5, 4, 3]}}\n" RUBBER
    "- name: two\n  shape: {beam: {size: [0.9, 0.7, 0.8], cells: [4, 5, 3]}}\n" RUBBER;

static void the_flood_finds_what_a_test_of_all_faces_finds(void **state)
{
    place p;
    unsigned seed = 3;
    int immersed = 0;
    (void)state;
    set_up(&p, two_boxes);
    const cn_contact_surface *two = &p.model->surface[1];
    for (int pose = 0; pose < 25; pose++) {
        double r[9], d[3];
        shape_rotation(&seed, r);
        for (int k = 0; k < 3; k++)
            d[k] = 0.6 * shape_random(&seed) + 0.5;
        for (int i = 0; i < two->npoint; i++) {
            double from[3] = {two->rest[3 * i] - 0.45, two->rest[3 * i + 1] - 0.35,
                              two->rest[3 * i + 2] - 0.4};
            cn_mat_vec(r, from, p.x + 3 * (two->first + i));
            cn_add(p.x + 3 * (two->first + i), d, p.x + 3 * (two->first + i));
        }
        for (int a = 0; a < 2; a++) {
            const int *face, b = 1 - a, ntri = p.model->surface[a].ntri;
            int ncross, nface, due = 0;
            assert_int_equal(cn_penalty_faces(p.penalty, p.nfree, p.x, a, b, &ncross, &nface, &face), CN_OK);
            unsigned char *found = calloc((size_t)ntri, 1);
            for (int i = 0; i < nface; i++)
                assert_int_equal(found[face[i]]++, 0);
            for (int t = 0; t < ntri; t++) {
                double q[3][3], c[3];
                corners(&p, a, t, q);
                for (int k = 0; k < 3; k++)
                    c[k] = (q[0][k] + q[1][k] + q[2][k]) / 3;
                const bool crossing = crosses(&p, a, t, b);
                assert_int_equal(found[t], crossing || convex_holds(&p, b, c));
                due += crossing;
            }
            assert_int_equal(ncross, due);
            immersed += nface - ncross;
            free(found);
        }
    }
    assert_true(immersed > 100);
    put_away(&p);
}

/* A box that went into a floor with most of its faces: each of them but those left above pushes. */
static void what_went_deep_in_one_step_is_pushed_as_a_whole(void **state)
{
    place p;
    (void)state;
    set_up(&p, FLOOR "bodies:\n- name: box\n  shape: {beam: {size: [0.1, 0.1, 0.1], cells: [4, 4, 4]}, "
                     "translate: [0, 0, -0.08]}\n" RUBBER);
    const cn_contact_surface *box = &p.model->surface[0];
    unsigned char *outer = calloc((size_t)box->npoint, 1);
    int due = 0;
    assert_int_equal(cn_penalty_find(p.penalty, p.nfree, p.x, NULL), CN_OK);
    for (int c = 0; c < 3 * box->ntri; c++)
        if (!outer[box->tri[c]]++) due += box->rest[3 * box->tri[c] + 2] < 0;
    assert_int_equal(p.penalty->nspring, due);
    for (int i = 0; i < due; i++) {
        const cn_penalty_spring *s = &p.penalty->spring[i];
        assert_true(fabs(s->depth + box->rest[3 * s->node + 2]) < 1e-12 && fabs(s->n[2] - 1) < 1e-12);
    }
    free(outer);
    put_away(&p);
}

/* Points of a tilted bar hang on its nodes, nine a node at least: the deepest of each counts. */
static void an_anchor_is_pushed_along_the_sum_as_deep_as_the_deepest(void **state)
{
    place p;
    (void)state;
    set_up(&p, FLOOR "bodies:\n- name: bar\n  shape: {beam: {size: [0.4, 0.1, 0.1], cells: [8, 2, 2]}, "
                     "rotate: [0.4, 0.1, 0.3], translate: [0, 0, -0.03]}\n"
                     "  model: rod\n  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n");
    const cn_body *body = p.scene.model->body[0].body;
    double *deepest = calloc((size_t)body->nnode, sizeof *deepest);
    int due = 0;
    assert_int_equal(cn_penalty_find(p.penalty, p.nfree, p.x, NULL), CN_OK);
    for (int i = 0; i < body->npoint; i++) {
        const int node = cn_body_node_of(body, i);
        deepest[node] = fmax(deepest[node], -p.x[3 * i + 2]);
    }
    for (int i = 0; i < body->nnode; i++)
        due += deepest[i] > 0;
    assert_int_equal(p.penalty->nspring, due);
    for (int i = 0; i < due; i++) {
        const cn_penalty_spring *s = &p.penalty->spring[i];
        assert_true(fabs(s->depth - deepest[s->node]) < 1e-12);
        assert_true(fabs(cn_norm(s->n) - 1) < 1e-12 && fabs(s->n[2] - 1) < 1e-12);
    }
    free(deepest);
    put_away(&p);
}

/* Where faces disagree the blend lies between them: a box's edge inside a corner of another. */
static void pushes_by_several_faces_blend(void **state)
{
    place p;
    bool blended = false;
    (void)state;
    set_up(&p, two_boxes);
    const cn_contact_surface *two = &p.model->surface[1];
    for (int i = 0; i < two->npoint; i++) {
        p.x[3 * (two->first + i)] += 0.75, p.x[3 * (two->first + i) + 1] += 0.1;
        p.x[3 * (two->first + i) + 2] += 0.4;
    }
    assert_int_equal(cn_penalty_find(p.penalty, p.nfree, p.x, NULL), CN_OK);
    assert_true(p.penalty->nspring > 0);
    for (int i = 0; i < p.penalty->nspring; i++) {
        const cn_penalty_spring *s = &p.penalty->spring[i];
        assert_true(fabs(cn_norm(s->n) - 1) < 1e-12 && s->depth > 0 && s->depth <= 0.25 + 1e-12);
        blended |= fabs(s->n[0]) > 0.05 && fabs(s->n[2]) > 0.05;
    }
    assert_true(blended);
    put_away(&p);
}

static void what_passed_an_open_sheet_goes_back_to_its_own_side(void **state)
{
    char file[64], text[1024];
    place p;
    (void)state;
    snprintf(file, sizeof file, "/tmp/catnav_sheet_%ld.obj", (long)getpid());
    for (int side = 0; side < 2; side++) { /* whichever way its faces are wound */
        FILE *f = fopen(file, "w");
        assert_non_null(f);
        fprintf(f, "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n%s\n",
                side ? "f 1 2 3\nf 1 3 4" : "f 1 3 2\nf 1 4 3");
        fclose(f);
        snprintf(text, sizeof text,
                 "obstacles:\n- {name: sheet, shape: {file: %s}}\n"
                 "bodies:\n- name: box\n  shape: {beam: {size: [0.1, 0.1, 0.1], cells: [3, 3, 3]}, "
                 "translate: [0, 0, -0.04]}\n" RUBBER,
                 file);
        set_up(&p, text);
        assert_int_equal(cn_penalty_find(p.penalty, p.nfree, p.x, NULL), CN_OK);
        assert_int_equal(p.penalty->nspring, 16 + 12); /* two layers of nodes, one with its inner ones */
        for (int i = 0; i < p.penalty->nspring; i++) {
            const cn_penalty_spring *s = &p.penalty->spring[i];
            const double z = p.model->surface[0].rest[3 * s->node + 2];
            assert_true(z < 0 && fabs(s->depth + z) < 1e-12 && fabs(s->n[2] - 1) < 1e-12);
        }
        put_away(&p);
    }
    remove(file);
}

static void a_body_rests_as_deep_as_its_weight_asks_of_its_springs(void **state)
{
    static const char *const models[] = {"tet4", "rod"};
    const int touching[] = {16, 4}; /* nodes below */
    (void)state;
    for (int k = 0; k < 2; k++) {
        char text[1024];
        scene_steps s;
        double low = 0;
        snprintf(
            text, sizeof text,
            "step: 0.005\ngravity: [0, 0, -9.81]\n" FLOOR
            "bodies:\n- name: block\n  shape: {beam: {size: [0.1, 0.02, 0.02], cells: [3, 3, 3]}, translate: "
            "[0, 0, 0.005]}\n"
            "  model: %s\n  material: {young: 1.0e+9, poisson: 0.3, density: 1000, damping: 10}\n"
            "contact: {method: penalty, stiffness: 200}\n",
            models[k]);
        scene_steps_new(&s, text, 0, NULL);
        scene_steps_go(&s, 400);
        const scene_motion m = scene_steps_motion(&s, 0);
        const double *x = s.state->body[0].x;
        for (int i = 0; i < s.model->body[0].body->nnode; i++)
            low = fmin(low, x[3 * i + 2] - (k ? 0.01 : 0));
        /* a rod's ends have half the mass, its stiff axis holds all of them level */
        const double due = m.mass * 9.81 / (200.0 * touching[k]);
        if (!(fabs(-low / due - 1) < 0.01)) fail_msg("%s rests %g m deep, not %g", models[k], -low, due);
        assert_true(fabs(m.velocity[2]) < 1e-6);
        assert_true(fabs(s.figures->wall_force / (m.mass * 9.81) - 1) < 1e-3);
        assert_true(s.figures->residual < 2e-3);
        scene_steps_free(&s);
    }
}

/* Its own stiffness: what comes fast leaves no faster, and what is left to itself rests. */
static void the_stiffness_of_its_own_is_stable_at_any_speed_and_step(void **state)
{
    static const double speed[] = {0.1, 10, 100}, step[] = {1e-4, 1e-2};
    (void)state;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 2; j++) {
            char text[1024];
            scene_steps s;
            snprintf(text, sizeof text,
                     "step: %g\n" FLOOR "bodies:\n- name: block\n  shape: {beam: {size: [0.1, 0.1, 0.1], "
                     "cells: [2, 2, 2]}, translate: "
                     "[0, 0, %g]}\n" RUBBER "  start: {velocity: [0, 0, %g]}\n"
                     "contact: {method: penalty}\n",
                     step[j], 1e-3, -fmin(speed[i], 0.05 / step[j]));
            scene_steps_new(&s, text, 0, NULL);
            const double energy = scene_steps_motion(&s, 0).kinetic;
            for (int n = 0; n < 60; n++) {
                scene_steps_go(&s, 1);
                const double now = scene_steps_motion(&s, 0).kinetic;
                if (!(now <= 1.05 * energy))
                    fail_msg("%g m/s, step %g: %g of %g", speed[i], step[j], now, energy);
            }
            assert_true(scene_steps_motion(&s, 0).centre[2] > 0);
            scene_steps_free(&s);
        }
}

static void the_momentum_it_makes_up_is_reported(void **state)
{
    static const char text[] =
        "step: 0.002\n"
        "bodies:\n"
        "- name: low\n  shape: {beam: {size: [0.1, 0.1, 0.05], cells: [2, 2, 1]}}\n" RUBBER
        "- name: high\n  shape: {beam: {size: [0.06, 0.06, 0.05], cells: [3, 3, 2]}, translate: [0.03, 0.01, "
        "0.051]}\n"
        "  model: tet4\n  material: {young: 1.0e+6, poisson: 0.3, density: 2000}\n"
        "  start: {velocity: [0, 0, -1]}\n"
        "contact: {method: penalty}\n"
        "solver: {tolerance: 1.0e-8, linear_tolerance: 1.0e-12}\n";
    scene_steps s;
    double sum = 0, before[3] = {0, 0, 0}, after[3] = {0, 0, 0};
    (void)state;
    scene_steps_new(&s, text, 0, NULL);
    s.model->body[0].body->damping = 0;
    for (int b = 0; b < 2; b++)
        cn_axpy(scene_steps_motion(&s, b).mass, scene_steps_motion(&s, b).velocity, before);
    for (int n = 0; n < 20; n++) {
        scene_steps_go(&s, 1);
        sum += s.figures->momentum_error;
    }
    for (int b = 0; b < 2; b++)
        cn_axpy(scene_steps_motion(&s, b).mass, scene_steps_motion(&s, b).velocity, after);
    assert_true(scene_steps_motion(&s, 1).velocity[2] > -0.9); /* they did meet */
    assert_true(sum > 0 && cn_distance(before, after) <= sum * (1 + 1e-6));
    scene_steps_free(&s);
}

static void without_memory_nothing_is_left(void **state)
{
    place p;
    cn_penalty *penalty;
    cn_status status;
    (void)state;
    set_up(&p, two_boxes);
    for (FAIL_EACH_ALLOC) {
        status = cn_penalty_new(&penalty, p.model, p.contact);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((penalty == NULL) == (status != CN_OK));
        cn_penalty_free(penalty);
    }
    put_away(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_flood_finds_what_a_test_of_all_faces_finds),
        cmocka_unit_test(what_went_deep_in_one_step_is_pushed_as_a_whole),
        cmocka_unit_test(an_anchor_is_pushed_along_the_sum_as_deep_as_the_deepest),
        cmocka_unit_test(pushes_by_several_faces_blend),
        cmocka_unit_test(what_passed_an_open_sheet_goes_back_to_its_own_side),
        cmocka_unit_test(a_body_rests_as_deep_as_its_weight_asks_of_its_springs),
        cmocka_unit_test(the_stiffness_of_its_own_is_stable_at_any_speed_and_step),
        cmocka_unit_test(the_momentum_it_makes_up_is_reported),
        cmocka_unit_test(without_memory_nothing_is_left),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
