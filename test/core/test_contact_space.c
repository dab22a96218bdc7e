/* test_contact_space.c - walls that move along a path and walls that bend: contact with them, and what is
 * free beside them. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "contact_place.h"

static const double GAP = 0.02;

/* A cube of 0.2 about the origin and a box obstacle of `size` at `low` that moves; `inside` a box vessel. */
static void with_obstacle(place *p, double low, double size, bool inside)
{
    const unsigned char moving[2] = {!inside, inside}; /* of a vessel, if there is one, and the obstacle */
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    memset(p, 0, sizeof *p);
    p->scene.nobstacle = 1, p->scene.nvessel = inside;
    p->vessel.shape.kind = p->obstacle.shape.kind = CN_SHAPE_BOX;
    for (int k = 0; k < 3; k++) {
        p->vessel.shape.box.min[k] = -2, p->vessel.shape.box.max[k] = 2;
        p->obstacle.shape.box.min[k] = low, p->obstacle.shape.box.max[k] = low + size;
    }
    place_world(p, NULL);
    place_bodies(p, 1, &mesh);
    const cn_contact_body body = {p->body[0], -1, false, GAP, 1e3};
    place_contact(p, 1, &body, moving);
    place_shift(p, 0, -0.1, -0.1, -0.1);
    cn_tets_free(mesh);
}

static int outside_at(place *p, const double at[3])
{
    cn_findings found;
    assert_int_equal(cn_contact_check(p->model, p->contact, p->nfree, p->x, 1, at, &found, NULL), CN_OK);
    return found.outside;
}

static void a_moving_obstacle_pushes_and_is_not_passed(void **state)
{
    (void)state;
    place p;
    unsigned seed = 3;
    int stopped = 0;
    with_obstacle(&p, 0.3, 0.3, false);
    const int n = 3 * p.model->npoint;
    double *dx = calloc((size_t)n, sizeof *dx), *start = malloc((size_t)n * sizeof *start);
    memcpy(start, p.x, (size_t)n * sizeof *start);
    assert_true(p.model->surface[1].moving && p.contact->npart == 2);
    for (int shot = 0; shot < 300; shot++) {
        const double speed = pow(10, -1 + 4 * (shot % 50) / 49.0);
        double r[9], way[3];
        shape_rotation(&seed, r);
        memcpy(p.x, start, (size_t)n * sizeof *start);
        place_turn(&p, 0, r);
        for (int k = 0; k < 3; k++)
            way[k] = -speed * (1 + 0.3 * shape_random(&seed));
        for (int i = 0; i < n; i++)
            dx[i] = i / 3 >= p.model->surface[1].first ? way[i % 3] : 0.1 * speed * shape_random(&seed);
        place_find(&p, dx, 0.02);
        const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL);
        assert_true(fraction > 0);
        stopped += fraction < 1;
        for (int i = 0; i < n; i++)
            p.x[i] += fraction * dx[i];
        const cn_findings found = place_check(&p);
        assert_int_equal(found.intersections + found.outside, 0);
    }
    assert_true(stopped > 250);

    memcpy(p.x, start, (size_t)n * sizeof *start);
    place_shift(&p, 1, -0.19, -0.45, -0.45); /* flat beside the cube */
    place_gradient_is_right(&p, 1e-8, 1e-5);
    double *f = calloc((size_t)n, sizeof *f), on[3] = {0, 0, 0};
    place_add(&p, f);
    for (int i = 0; i < p.nfree[0]; i++)
        cn_add(on, f + 3 * i, on);
    assert_true(on[0] < 0 && fabs(on[1]) < 1e-6 * -on[0] && fabs(on[2]) < 1e-6 * -on[0]);
    for (int i = 3 * p.nfree[0]; i < n; i++)
        assert_true(f[i] == 0); /* nothing gives way there */
    free(dx), free(start), free(f);
    place_free(&p);
}

/* The obstacle's inside goes with it, with and without a map that knows where it was. */
static void what_a_moving_obstacle_leaves_is_free_and_what_it_takes_is_not(void **state)
{
    (void)state;
    for (int map = 0; map < 2; map++) {
        place p;
        const double was[3] = {0.8, 0.8, 0.8}, is[3] = {-0.8, 0.8, 0.8}, far[3] = {0, -1.5, -1};
        cn_error error;
        with_obstacle(&p, 0.6, 0.4, true);
        if (map) assert_int_equal(cn_world_map(p.world, 0.1, 1, &error), CN_OK);
        assert_int_equal(outside_at(&p, was), 1);
        assert_int_equal(outside_at(&p, is), 0);
        place_shift(&p, 2, -1.6, 0, 0);
        assert_int_equal(outside_at(&p, was), 0);
        assert_int_equal(outside_at(&p, is), 1);
        assert_int_equal(outside_at(&p, far), 0);
        place_shift(&p, 0, -0.75, 0.8, 0.7); /* the cube into it, part of the way */
        const cn_findings found = place_check(&p);
        assert_true(found.intersections > 0 && found.outside > 0 && found.depth > 0.01);
        place_free(&p);
    }
}

/* An open tube as vessel that a body of its own stands for, with the cube inside. */
static void bent_vessel(place *p, cn_body *wall, double radius)
{
    const double axis[6] = {0, 0, -1, 0, 0, 1}, radii[2] = {radius, radius};
    cn_surface *tube;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    memset(p, 0, sizeof *p), memset(wall, 0, sizeof *wall);
    p->scene.nvessel = 1;
    p->vessel.shape.kind = CN_SHAPE_BOX;
    assert_int_equal(cn_surface_tube(&tube, 2, axis, radii, 0, 24), CN_OK);
    place_world(p, tube);
    cn_surface_free(tube);
    place_bodies(p, 1, &mesh);
    const cn_surface *surface = p->world->wall[0].surface;
    wall->npoint = surface->nvert, wall->point = surface->vert, wall->boundary = (cn_surface *)surface;
    const cn_contact_body body[2] = {{p->body[0], -1, false, GAP, 1e3}, {wall, 0, false, INFINITY, INFINITY}};
    place_contact(p, 2, body, NULL);
    assert_int_equal(p->model->nsurface, 2); /* the wall is no rigid surface any more */
    place_shift(p, 0, -0.05, -0.05, -0.05);
    cn_tets_free(mesh);
}

static void a_vessel_that_bends_takes_its_lumen_and_corridors_with_it(void **state)
{
    (void)state;
    for (int map = 0; map < 2; map++) {
        place p;
        cn_body wall;
        cn_error error;
        const double axis[3] = {0, 0, 0}, beyond[3] = {0.1, 0, 1.7}, beside[3] = {0.4, 0, 0.2};
        const double shifted[3] = {1, 0, 0}, shifted_beyond[3] = {1, 0.1, -1.5};
        bent_vessel(&p, &wall, 0.3);
        if (map) assert_int_equal(cn_world_map(p.world, 0.05, 1, &error), CN_OK);
        assert_int_equal(outside_at(&p, axis), 0);
        assert_int_equal(outside_at(&p, beyond), 0);
        assert_int_equal(outside_at(&p, beside), 1);

        for (int i = 0; i < p.nfree[1]; i++) /* wider */
            for (int k = 0; k < 2; k++)
                place_points(&p, 1)[3 * i + k] *= 1.5;
        assert_int_equal(outside_at(&p, beside), 0);
        assert_int_equal(outside_at(&p, axis), 0);

        place_shift(&p, 1, 1, 0, 0), place_shift(&p, 0, 1, 0, 0); /* and elsewhere, with the cube */
        assert_int_equal(outside_at(&p, shifted), 0);
        assert_int_equal(outside_at(&p, shifted_beyond), 0);
        assert_int_equal(outside_at(&p, axis), 1);
        assert_int_equal(outside_at(&p, beyond), 1);

        place_shift(&p, 0, -1, 0, 0); /* the cube left behind, 0.55 from the wall */
        const cn_findings found = place_check(&p);
        assert_int_equal(found.intersections, 0);
        assert_int_equal(found.outside, 8);
        assert_true(found.depth > 0.55 && found.depth < 0.7);
        place_free(&p);
    }
}

static void a_bending_wall_and_a_body_push_each_other(void **state)
{
    (void)state;
    place p;
    cn_body wall;
    double sum[3] = {0, 0, 0}, moment[3] = {0, 0, 0};
    bent_vessel(&p, &wall, 0.1);
    place_shift(&p, 0, 0.02, 0.01, 0.3);
    double *f = calloc(3 * (size_t)p.model->npoint, sizeof *f), largest = 0;
    place_find(&p, NULL, 0);
    assert_true(place_add(&p, f) > 0);
    for (int i = 0; i < p.model->npoint; i++) {
        double m[3];
        cn_cross(p.x + 3 * i, f + 3 * i, m);
        cn_add(sum, f + 3 * i, sum), cn_add(moment, m, moment);
        largest = fmax(largest, cn_norm(f + 3 * i));
    }
    assert_true(largest > 0 && cn_norm(sum) < 1e-12 * largest && cn_norm(moment) < 1e-12 * largest);
    place_gradient_is_right(&p, 1e-8, 1e-5);
    double where[3];
    int other;
    assert_true(cn_contact_patch_force(p.model, p.contact, 0, p.x, where, &other) > 0 && other == 1);
    free(f);
    place_free(&p);
}

static void a_body_that_crosses_a_bending_vessel_is_brought_inside(void **state)
{
    (void)state;
    place p;
    cn_body wall;
    bent_vessel(&p, &wall, 0.3);
    place_shift(&p, 0, 0.25, 0.003, 0.3); /* its outer face beyond the wall */
    assert_true(place_check(&p).intersections > 0);
    const int n = p.model->npoint;
    double *mass = malloc((size_t)n * sizeof *mass), *v = calloc(3 * (size_t)n, sizeof *v);
    for (int i = 0; i < n; i++)
        mass[i] = 1;
    assert_int_equal(
        cn_contact_project(p.model, p.contact, p.nfree, mass, p.x, v, CN_RESPONSE_INELASTIC, 1, 50), 0);
    const cn_findings found = place_check(&p);
    assert_int_equal(found.intersections + found.outside, 0);
    free(mass), free(v);
    place_free(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_moving_obstacle_pushes_and_is_not_passed),
        cmocka_unit_test(what_a_moving_obstacle_leaves_is_free_and_what_it_takes_is_not),
        cmocka_unit_test(a_vessel_that_bends_takes_its_lumen_and_corridors_with_it),
        cmocka_unit_test(a_bending_wall_and_a_body_push_each_other),
        cmocka_unit_test(a_body_that_crosses_a_bending_vessel_is_brought_inside),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
