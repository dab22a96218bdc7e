/* test_contact.c - barrier forces, the motion that contact allows, and what the independent check sees. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "contact.h"
#include "shapes.h"

/* A body of `mesh` inside a box-shaped vessel [-1, 1]^3 times `half`, or above a box obstacle. */
typedef struct {
    cn_scene scene;
    cn_surface_spec wall;
    cn_world *world;
    cn_body *body;
    cn_contact_model *model;
    cn_contact *contact;
    double *x;
} place;

static void set_up(place *p, const cn_tets *mesh, double half, double gap)
{
    const cn_material material = {.young = 1e6, .poisson = 0.3, .density = 1000};
    cn_error error = {0};
    memset(p, 0, sizeof *p);
    p->wall.name = "box", p->wall.shape.kind = CN_SHAPE_BOX, p->wall.shape.placement.scale = 1;
    for (int k = 0; k < 3; k++)
        p->wall.shape.box.min[k] = -half, p->wall.shape.box.max[k] = half;
    p->scene.nvessel = 1, p->scene.vessel = &p->wall;
    if (cn_world_new(&p->world, &p->scene, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(cn_body_new(&p->body, mesh, &material, NULL, &error), CN_OK);
    assert_int_equal(cn_contact_model_new(&p->model, p->body, p->world, gap, 1e3), CN_OK);
    assert_int_equal(cn_contact_new(&p->contact, p->model), CN_OK);
    p->x = malloc(3 * (size_t)mesh->nnode * sizeof *p->x);
    memcpy(p->x, p->body->rest, 3 * (size_t)mesh->nnode * sizeof *p->x);
}

static void put_away(place *p)
{
    free(p->x);
    cn_contact_free(p->contact), cn_contact_model_free(p->model), cn_body_free(p->body),
        cn_world_free(p->world);
}

static void shift(place *p, double dx, double dy, double dz)
{
    const double d[3] = {dx, dy, dz};
    for (int i = 0; i < p->body->nnode; i++)
        cn_axpy(1, d, p->x + 3 * i);
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    double f[3 * 27] = {0};
    const double h = 1e-7;
    set_up(&p, mesh, 0.25, 0.05);
    shift(&p, 0.03, 0.02, 0.025); /* near three walls at once */
    assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 10 * h, 0, NULL), CN_OK);
    assert_true(p.contact->npair > 0);
    assert_true(cn_contact_add(p.model, p.contact, p.x, f, NULL, NULL, false, NULL) > 0);
    for (int i = 0; i < 3 * mesh->nnode; i++) {
        const double xi = p.x[i];
        p.x[i] = xi + h;
        const double up = cn_contact_add(p.model, p.contact, p.x, NULL, NULL, NULL, false, NULL);
        p.x[i] = xi - h;
        const double down = cn_contact_add(p.model, p.contact, p.x, NULL, NULL, NULL, false, NULL);
        p.x[i] = xi;
        assert_true(fabs(f[i] + (up - down) / (2 * h)) < 1e-5 * (1 + fabs(f[i])));
    }
    put_away(&p);
    cn_tets_free(mesh);
}

/* The exact stiffness is minus the derivative of the force, but for what the mollifier of near-parallel edges
 * adds: a box turned against the walls has none. */
static void stiffness_is_minus_the_force_gradient(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    const double axis[3] = {0.5, 0.4, 0.3}, h = 1e-7;
    double turn[9], up[24], down[24];
    place p;
    cn_matrix *a = NULL;
    set_up(&p, mesh, 0.25, 0.05);
    cn_rotation(axis, turn);
    for (int i = 0; i < mesh->nnode; i++) {
        double y[3];
        cn_mat_vec(turn, p.x + 3 * i, y);
        cn_copy3(y, p.x + 3 * i);
    }
    double most[3] = {-1, -1, -1};
    for (int i = 0; i < 3 * mesh->nnode; i++)
        most[i % 3] = fmax(most[i % 3], p.x[i]);
    shift(&p, 0.225 - most[0], 0.22 - most[1], 0.23 - most[2]); /* into the corner */
    const cn_body *const bodies[1] = {p.body};
    const int first[1] = {0};
    assert_int_equal(cn_matrix_new(&a, 1, bodies, first), CN_OK);
    assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 10 * h, 0, NULL), CN_OK);
    cn_matrix_clear(a, mesh->nnode);
    cn_contact_add(p.model, p.contact, p.x, NULL, NULL, a, true, NULL);
    double largest = 0;
    for (int i = 0; i < 9 * a->nblock; i++)
        largest = fmax(largest, fabs(a->value[i]));
    assert_true(largest > 0);
    for (int j = 0; j < 3 * mesh->nnode; j++) {
        const double xj = p.x[j];
        memset(up, 0, sizeof up), memset(down, 0, sizeof down);
        p.x[j] = xj + h;
        cn_contact_add(p.model, p.contact, p.x, up, NULL, NULL, false, NULL);
        p.x[j] = xj - h;
        cn_contact_add(p.model, p.contact, p.x, down, NULL, NULL, false, NULL);
        p.x[j] = xj;
        for (int i = 0; i < 3 * mesh->nnode; i++) {
            const int block = cn_matrix_find(a, i / 3, j / 3);
            const double k = block < 0 ? 0 : a->value[9 * block + 3 * (i % 3) + j % 3];
            assert_true(fabs(k + (up[i] - down[i]) / (2 * h)) < 1e-4 * largest);
        }
    }
    cn_matrix_free(a);
    put_away(&p);
    cn_tets_free(mesh);
}

static void pushing_against_a_wall_is_answered_away_from_it(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    place p;
    double f[3 * 8] = {0}, sum[3] = {0, 0, 0};
    set_up(&p, mesh, 0.5, 0.01);
    shift(&p, 0, 0, 0.395);
    assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 0, 0, NULL), CN_OK);
    cn_contact_add(p.model, p.contact, p.x, f, NULL, NULL, false, NULL);
    for (int i = 0; i < mesh->nnode; i++)
        cn_add(sum, f + 3 * i, sum);
    assert_true(sum[2] < 0 && fabs(sum[0]) < 1e-9 * -sum[2] && fabs(sum[1]) < 1e-9 * -sum[2]);
    double where[3];
    int wall;
    const double patch = cn_contact_patch_force(p.model, p.contact, p.x, where, &wall);
    assert_int_equal(wall, 0);
    assert_true(fabs(patch + sum[2]) < 1e-9 * patch && fabs(where[2] - 0.5) < 1e-12);
    put_away(&p);
    cn_tets_free(mesh);
}

/* Shots of up to 1e4 body sizes in one step: nothing gets through, nothing crosses. */
static void no_motion_passes_a_wall(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    place p;
    unsigned seed = 7;
    set_up(&p, mesh, 0.5, 0.01);
    double *dx = malloc(3 * (size_t)mesh->nnode * sizeof *dx);
    for (int shot = 0; shot < 2000; shot++) {
        const double speed = pow(10, -2 + 6 * (shot % 100) / 99.0);
        double turn[9], aim[3];
        cn_findings found;
        shape_rotation(&seed, turn);
        memcpy(p.x, p.body->rest, 3 * (size_t)mesh->nnode * sizeof *p.x);
        for (int i = 0; i < mesh->nnode; i++) {
            double y[3];
            cn_mat_vec(turn, p.x + 3 * i, y);
            cn_copy3(y, p.x + 3 * i);
        }
        for (int k = 0; k < 3; k++)
            aim[k] = shape_random(&seed);
        for (int i = 0; i < mesh->nnode; i++)
            for (int k = 0; k < 3; k++)
                dx[3 * i + k] = speed * (aim[k] + 0.3 * shape_random(&seed));
        double most = 0;
        for (int i = 0; i < mesh->nnode; i++)
            most = fmax(most, cn_norm(dx + 3 * i));
        assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, dx, 0.02, 0, NULL), CN_OK);
        const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL);
        assert_true(fraction > 0);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            p.x[i] += fraction * dx[i];
        assert_int_equal(cn_contact_check(p.model, p.contact, mesh->nnode, p.x, 0, NULL, &found, NULL),
                         CN_OK);
        assert_int_equal(found.intersections, 0);
        assert_int_equal(found.outside, 0);
    }
    free(dx);
    put_away(&p);
    cn_tets_free(mesh);
}

static void every_near_pair_is_listed(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(3, 2, 2, 0.1);
    place p;
    set_up(&p, mesh, 0.5, 0.02);
    shift(&p, 0.188, 0.29, 0.29);
    assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 0.05, 0, NULL), CN_OK);
    /* a node is listed with the plane at x = 0.5 as often as it lies over a triangle of it */
    int expected = 0, listed = 0;
    for (int i = 0; i < p.model->collider->ntri; i++)
        for (int k = 0; k < 3; k++)
            if (p.model->collider->owns[i] >> k & 1)
                expected += p.x[3 * p.model->collider->tri[3 * i + k]] > 0.5 - 0.07;
    for (int i = 0; i < p.contact->npair; i++)
        if (p.contact->pair[i].kind == CN_PAIR_NODE_TRIANGLE && p.contact->pair[i].found < 0.07) {
            const double *x = p.x + 3 * p.contact->pair[i].a[0];
            listed += fabs(0.5 - x[0] - p.contact->pair[i].found) < 1e-12;
        }
    assert_true(expected > 0 && listed >= expected);
    put_away(&p);
    cn_tets_free(mesh);
}

static void crossings_and_outside_points_are_seen(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    place p;
    cn_findings found;
    set_up(&p, mesh, 0.5, 0.01);
    assert_int_equal(cn_contact_check(p.model, p.contact, mesh->nnode, p.x, 0, NULL, &found, NULL), CN_OK);
    assert_int_equal(found.intersections + found.outside, 0);
    shift(&p, 0.43, 0, 0);
    assert_int_equal(cn_contact_check(p.model, p.contact, mesh->nnode, p.x, 0, NULL, &found, NULL), CN_OK);
    assert_true(found.intersections > 0 && found.outside >= 4 && found.depth > 0.1 && found.depth < 0.16);
    put_away(&p);
    cn_tets_free(mesh);
}

static void projection_ends_without_crossing_or_says_how_many_are_left(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    cn_findings found;
    double v[3 * 27];
    set_up(&p, mesh, 0.5, 0.01);
    shift(&p, 0.305, 0.1, 0.1);
    for (int i = 0; i < 27; i++)
        v[3 * i] = 1, v[3 * i + 1] = v[3 * i + 2] = 0;
    const int left =
        cn_contact_project(p.model, p.contact, mesh->nnode, p.x, v, CN_RESPONSE_INELASTIC, 1, 20);
    assert_int_equal(left, 0);
    assert_int_equal(cn_contact_check(p.model, p.contact, mesh->nnode, p.x, 0, NULL, &found, NULL), CN_OK);
    assert_int_equal(found.intersections, 0);
    for (int i = 0; i < 27; i++)
        assert_true(v[3 * i] == 1 ||
                    fabs(v[3 * i]) < 1e-12); /* touched nodes have lost their normal velocity */
    put_away(&p);
    cn_tets_free(mesh);
}

static void a_full_list_is_an_error_and_can_be_grown(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    set_up(&p, mesh, 0.3, 0.05);
    p.contact->part[0].capacity = 8;
    assert_int_equal(cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 1, 0, NULL), CN_ERR_CONTACT);
    for (int i = 0; i < 20 && p.contact->part[0].capacity < 1 << 20; i++) {
        assert_int_equal(cn_contact_grow(p.contact), CN_OK);
        if (cn_contact_find(p.model, p.contact, mesh->nnode, p.x, NULL, 1, 0, NULL) == CN_OK) break;
    }
    assert_true(p.contact->part[0].npair < p.contact->part[0].capacity);
    put_away(&p);
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(stiffness_is_minus_the_force_gradient),
        cmocka_unit_test(pushing_against_a_wall_is_answered_away_from_it),
        cmocka_unit_test(no_motion_passes_a_wall),
        cmocka_unit_test(every_near_pair_is_listed),
        cmocka_unit_test(crossings_and_outside_points_are_seen),
        cmocka_unit_test(projection_ends_without_crossing_or_says_how_many_are_left),
        cmocka_unit_test(a_full_list_is_an_error_and_can_be_grown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
