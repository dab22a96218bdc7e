/* test_contact.c - barrier forces, the motion that contact allows, and what the independent check sees. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "contact_place.h"

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    place_make(&p, 1, &mesh, 0.25, 0.05, false);
    place_shift(&p, 0, 0.03, 0.02, 0.025); /* near three walls at once */
    place_gradient_is_right(&p, 1e-7, 1e-5);
    place_free(&p);
    cn_tets_free(mesh);
}

/* The exact stiffness is minus the derivative of the force, but for what the mollifier of near-parallel edges
 * adds: a box turned against the walls has none. */
static void stiffness_is_minus_the_force_gradient(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    const double axis[3] = {0.5, 0.4, 0.3}, h = 1e-7;
    double r[9], up[48], down[48];
    place p;
    cn_matrix *a = NULL;
    place_make(&p, 1, &mesh, 0.25, 0.05, false);
    cn_rotation(axis, r);
    place_turn(&p, 0, r);
    double most[3] = {-1, -1, -1};
    for (int i = 0; i < 3 * mesh->nnode; i++)
        most[i % 3] = fmax(most[i % 3], p.x[i]);
    place_shift(&p, 0, 0.225 - most[0], 0.22 - most[1], 0.23 - most[2]); /* into the corner */
    const cn_body *const bodies[1] = {p.body[0]};
    const int first[1] = {0};
    assert_int_equal(cn_matrix_new(&a, 1, bodies, first), CN_OK);
    place_find(&p, NULL, 10 * h);
    cn_matrix_clear(a, mesh->nnode);
    const cn_hang hang[2] = {{.matrix = a}};
    cn_contact_add(p.model, p.contact, p.x, NULL, hang, true, NULL);
    assert_int_equal(p.contact->nlink, 0);
    double largest = 0;
    for (int i = 0; i < 9 * a->nblock; i++)
        largest = fmax(largest, fabs(a->value[i]));
    assert_true(largest > 0);
    for (int j = 0; j < 3 * mesh->nnode; j++) {
        const double xj = p.x[j];
        memset(up, 0, sizeof up), memset(down, 0, sizeof down);
        p.x[j] = xj + h;
        place_add(&p, up);
        p.x[j] = xj - h;
        place_add(&p, down);
        p.x[j] = xj;
        for (int i = 0; i < 3 * mesh->nnode; i++) {
            const int block = cn_matrix_find(a, i / 3, j / 3);
            const double k = block < 0 ? 0 : a->value[9 * block + 3 * (i % 3) + j % 3];
            assert_true(fabs(k + (up[i] - down[i]) / (2 * h)) < 1e-4 * largest);
        }
    }
    cn_matrix_free(a);
    place_free(&p);
    cn_tets_free(mesh);
}

static void pushing_against_a_wall_is_answered_away_from_it(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    place p;
    double f[48] = {0}, sum[3] = {0, 0, 0};
    place_make(&p, 1, &mesh, 0.5, 0.01, false);
    place_shift(&p, 0, 0, 0, 0.395);
    place_find(&p, NULL, 0);
    place_add(&p, f);
    for (int i = 0; i < mesh->nnode; i++)
        cn_add(sum, f + 3 * i, sum);
    assert_true(sum[2] < 0 && fabs(sum[0]) < 1e-9 * -sum[2] && fabs(sum[1]) < 1e-9 * -sum[2]);
    double where[3];
    int wall;
    const double patch = cn_contact_patch_force(p.model, p.contact, 0, p.x, where, &wall);
    assert_int_equal(wall, 1);
    assert_true(fabs(patch + sum[2]) < 1e-9 * patch && fabs(where[2] - 0.5) < 1e-12);
    assert_true(cn_contact_touches(p.contact) && cn_contact_least(p.contact, 0) < 0.01);
    place_free(&p);
    cn_tets_free(mesh);
}

/* However near to an edge between two triangles of a plane: one of the two counts, never both or none. */
static void a_flat_wall_pushes_the_same_beside_its_edges(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    place p;
    double before = 0;
    place_make(&p, 1, &mesh, 0.5, 0.01, false);
    place_shift(&p, 0, 0, 0, 0.395); /* two of its corners above the diagonal of the wall's face */
    for (int i = -17; i <= 17; i++) {
        const double off = i == 0 ? 0 : copysign(pow(10, -abs(i)), i);
        place_shift(&p, 0, off, 0, 0);
        place_find(&p, NULL, 0);
        const double energy = place_add(&p, NULL);
        if (i > -17) assert_true(fabs(energy - before) < 1e-9 * energy);
        before = energy;
        for (int k = 0; k < mesh->nnode; k++)
            p.x[3 * k] = p.body[0]->rest[3 * k];
    }
    place_free(&p);
    cn_tets_free(mesh);
}

/* Shots of up to 1e4 body sizes in one step: nothing gets through, nothing crosses. */
static void no_motion_passes_a_wall(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    place p;
    unsigned seed = 7;
    place_make(&p, 1, &mesh, 0.5, 0.01, false);
    double *dx = calloc(3 * (size_t)p.model->npoint, sizeof *dx);
    for (int shot = 0; shot < 2000; shot++) {
        const double speed = pow(10, -2 + 6 * (shot % 100) / 99.0);
        double r[9], aim[3];
        shape_rotation(&seed, r);
        memcpy(p.x, p.body[0]->rest, 3 * (size_t)mesh->nnode * sizeof *p.x);
        place_turn(&p, 0, r);
        for (int k = 0; k < 3; k++)
            aim[k] = shape_random(&seed);
        for (int i = 0; i < mesh->nnode; i++)
            for (int k = 0; k < 3; k++)
                dx[3 * i + k] = speed * (aim[k] + 0.3 * shape_random(&seed));
        place_find(&p, dx, 0.02);
        const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL);
        assert_true(fraction > 0);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            p.x[i] += fraction * dx[i];
        const cn_findings found = place_check(&p);
        assert_int_equal(found.intersections, 0);
        assert_int_equal(found.outside, 0);
    }
    free(dx);
    place_free(&p);
    cn_tets_free(mesh);
}

static void every_near_pair_is_listed(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(3, 2, 2, 0.1);
    place p;
    place_make(&p, 1, &mesh, 0.5, 0.02, false);
    place_shift(&p, 0, 0.188, 0.29, 0.29);
    place_find(&p, NULL, 0.05);
    /* a node is listed with the plane at x = 0.5 as often as it lies over a triangle of it */
    const cn_collider *collider = p.model->surface[0].collider;
    int expected = 0, listed = 0;
    for (int i = 0; i < collider->ntri; i++)
        for (int k = 0; k < 3; k++)
            if (collider->owns[i] >> k & 1) expected += p.x[3 * collider->tri[3 * i + k]] > 0.5 - 0.07;
    for (int i = 0; i < p.contact->npair; i++) {
        const cn_pair *pair = &p.contact->pair[i];
        if (pair->kind != CN_PAIR_NODE_TRIANGLE || pair->surface[0] != 0 || pair->found >= 0.07) continue;
        listed += fabs(0.5 - p.x[3 * pair->p[0]] - pair->found) < 1e-12;
    }
    assert_true(expected > 0 && listed >= expected);
    place_free(&p);
    cn_tets_free(mesh);
}

static void crossings_and_outside_points_are_seen(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    place p;
    place_make(&p, 1, &mesh, 0.5, 0.01, false);
    cn_findings found = place_check(&p);
    assert_int_equal(found.intersections + found.outside, 0);
    place_shift(&p, 0, 0.43, 0, 0);
    found = place_check(&p);
    assert_true(found.intersections > 0 && found.outside >= 4 && found.depth > 0.1 && found.depth < 0.16);
    assert_true(found.surface[0] == 0 && found.surface[1] == 1);
    place_free(&p);
    cn_tets_free(mesh);
}

static void projection_ends_without_crossing_or_says_how_many_are_left(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    double v[3 * 35] = {0}, mass[35];
    place_make(&p, 1, &mesh, 0.5, 0.01, false);
    place_shift(&p, 0, 0.305, 0.1, 0.1);
    for (int i = 0; i < 35; i++)
        mass[i] = i < 27 ? p.body[0]->mass[i] : INFINITY, v[3 * i] = i < 27;
    assert_int_equal(p.model->npoint, 35);
    const int left =
        cn_contact_project(p.model, p.contact, p.nfree, mass, p.x, v, CN_RESPONSE_INELASTIC, 1, 20);
    assert_int_equal(left, 0);
    assert_int_equal(place_check(&p).intersections, 0);
    for (int i = 0; i < 27; i++) /* touched nodes have lost their normal velocity */
        assert_true(v[3 * i] == 1 || fabs(v[3 * i]) < 1e-12);
    place_free(&p);
    cn_tets_free(mesh);
}

static void a_full_list_is_an_error_and_can_be_grown(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    place_make(&p, 1, &mesh, 0.3, 0.05, false);
    p.contact->part[0].capacity = 8;
    cn_status status = cn_contact_find(p.model, p.contact, p.nfree, p.x, NULL, 1, 0, NULL);
    assert_int_equal(status, CN_ERR_CONTACT);
    for (int i = 0; i < 20 && status != CN_OK; i++) {
        assert_int_equal(cn_contact_grow(p.contact), CN_OK);
        status = cn_contact_find(p.model, p.contact, p.nfree, p.x, NULL, 1, 0, NULL);
    }
    assert_true(p.contact->part[0].npair < p.contact->part[0].capacity);
    place_free(&p);
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(stiffness_is_minus_the_force_gradient),
        cmocka_unit_test(pushing_against_a_wall_is_answered_away_from_it),
        cmocka_unit_test(a_flat_wall_pushes_the_same_beside_its_edges),
        cmocka_unit_test(no_motion_passes_a_wall),
        cmocka_unit_test(every_near_pair_is_listed),
        cmocka_unit_test(crossings_and_outside_points_are_seen),
        cmocka_unit_test(projection_ends_without_crossing_or_says_how_many_are_left),
        cmocka_unit_test(a_full_list_is_an_error_and_can_be_grown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
