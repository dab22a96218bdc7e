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

/* Bodies inside a box-shaped vessel [-1, 1]^3 times `half` (0: none); x and nfree as contact takes them. */
typedef struct {
    cn_scene scene;
    cn_surface_spec wall;
    cn_world *world;
    int nbody;
    cn_body *body[2];
    cn_contact_model *model;
    cn_contact *contact;
    double *x;
    int nfree[4];
} place;

static void make_world(place *p, double half)
{
    cn_error error = {0};
    p->wall.name = "box", p->wall.shape.kind = CN_SHAPE_BOX, p->wall.shape.placement.scale = 1;
    for (int k = 0; k < 3; k++)
        p->wall.shape.box.min[k] = -half, p->wall.shape.box.max[k] = half;
    p->scene.nvessel = half > 0, p->scene.vessel = &p->wall;
    if (cn_world_new(&p->world, &p->scene, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
}

static void make_bodies(place *p, int nbody, cn_tets *const *mesh)
{
    const cn_material material = {.young = 1e6, .poisson = 0.3, .density = 1000};
    cn_error error = {0};
    for (; p->nbody < nbody; p->nbody++)
        assert_int_equal(cn_body_new(&p->body[p->nbody], mesh[p->nbody], &material, NULL, &error), CN_OK);
}

/* Surfaces at rest. */
static void make_contact(place *p, const cn_contact_body *given, const unsigned char *moving)
{
    assert_int_equal(cn_contact_model_new(&p->model, p->world, p->nbody, given, moving), CN_OK);
    assert_int_equal(cn_contact_new(&p->contact, p->model), CN_OK);
    p->x = malloc(3 * (size_t)p->model->npoint * sizeof *p->x);
    for (int s = 0; s < p->model->nsurface; s++) {
        const cn_contact_surface *surface = &p->model->surface[s];
        p->nfree[s] = surface->npoint;
        memcpy(p->x + 3 * surface->first, surface->rest, 3 * (size_t)surface->npoint * sizeof *p->x);
    }
}

static void set_up(place *p, int nbody, cn_tets *const *mesh, double half, double gap, bool self)
{
    memset(p, 0, sizeof *p);
    make_world(p, half);
    make_bodies(p, nbody, mesh);
    cn_contact_body given[2] = {{p->body[0], -1, self, gap, 1e3}, {p->body[1], -1, self, 0.8 * gap, 2e3}};
    make_contact(p, given, NULL);
}

static void put_away(place *p)
{
    free(p->x);
    cn_contact_free(p->contact), cn_contact_model_free(p->model);
    for (int b = 0; b < p->nbody; b++)
        cn_body_free(p->body[b]);
    cn_world_free(p->world);
}

static double *points(place *p, int surface)
{
    return p->x + 3 * p->model->surface[surface].first;
}

static void shift(place *p, int surface, double dx, double dy, double dz)
{
    const double d[3] = {dx, dy, dz};
    for (int i = 0; i < p->model->surface[surface].npoint; i++)
        cn_axpy(1, d, points(p, surface) + 3 * i);
}

static void turn(place *p, int surface, const double r[9])
{
    for (int i = 0; i < p->model->surface[surface].npoint; i++) {
        double y[3];
        cn_mat_vec(r, points(p, surface) + 3 * i, y);
        cn_copy3(y, points(p, surface) + 3 * i);
    }
}

static void find(place *p, const double *dx, double reach)
{
    assert_int_equal(cn_contact_find(p->model, p->contact, p->nfree, p->x, dx, reach, 0, NULL), CN_OK);
}

static double add(place *p, double *f)
{
    return cn_contact_add(p->model, p->contact, p->x, f, NULL, false, NULL);
}

static cn_findings check(place *p)
{
    cn_findings found;
    assert_int_equal(cn_contact_check(p->model, p->contact, p->nfree, p->x, 0, NULL, &found, NULL), CN_OK);
    return found;
}

/* Force against differences of the energy, at all points of bodies. */
static void gradient_is_right(place *p, double h, double tolerance)
{
    const int n = 3 * p->model->npoint;
    double *f = calloc((size_t)n, sizeof *f), largest = 0;
    find(p, NULL, 10 * h);
    assert_true(p->contact->npair > 0);
    assert_true(add(p, f) > 0);
    for (int i = 0; i < n; i++)
        largest = fmax(largest, fabs(f[i]));
    assert_true(largest > 0);
    for (int s = 0; s < p->nbody; s++)
        for (int i = 3 * p->model->surface[s].first; i < 3 * (p->model->surface[s].first + p->nfree[s]);
             i++) {
            const double xi = p->x[i];
            p->x[i] = xi + h;
            const double up = add(p, NULL);
            p->x[i] = xi - h;
            const double down = add(p, NULL);
            p->x[i] = xi;
            assert_true(fabs(f[i] + (up - down) / (2 * h)) < tolerance * largest);
        }
    free(f);
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    set_up(&p, 1, &mesh, 0.25, 0.05, false);
    shift(&p, 0, 0.03, 0.02, 0.025); /* near three walls at once */
    gradient_is_right(&p, 1e-7, 1e-5);
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
    double r[9], up[48], down[48];
    place p;
    cn_matrix *a = NULL;
    set_up(&p, 1, &mesh, 0.25, 0.05, false);
    cn_rotation(axis, r);
    turn(&p, 0, r);
    double most[3] = {-1, -1, -1};
    for (int i = 0; i < 3 * mesh->nnode; i++)
        most[i % 3] = fmax(most[i % 3], p.x[i]);
    shift(&p, 0, 0.225 - most[0], 0.22 - most[1], 0.23 - most[2]); /* into the corner */
    const cn_body *const bodies[1] = {p.body[0]};
    const int first[1] = {0};
    assert_int_equal(cn_matrix_new(&a, 1, bodies, first), CN_OK);
    find(&p, NULL, 10 * h);
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
        add(&p, up);
        p.x[j] = xj - h;
        add(&p, down);
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
    double f[48] = {0}, sum[3] = {0, 0, 0};
    set_up(&p, 1, &mesh, 0.5, 0.01, false);
    shift(&p, 0, 0, 0, 0.395);
    find(&p, NULL, 0);
    add(&p, f);
    for (int i = 0; i < mesh->nnode; i++)
        cn_add(sum, f + 3 * i, sum);
    assert_true(sum[2] < 0 && fabs(sum[0]) < 1e-9 * -sum[2] && fabs(sum[1]) < 1e-9 * -sum[2]);
    double where[3];
    int wall;
    const double patch = cn_contact_patch_force(p.model, p.contact, 0, p.x, where, &wall);
    assert_int_equal(wall, 1);
    assert_true(fabs(patch + sum[2]) < 1e-9 * patch && fabs(where[2] - 0.5) < 1e-12);
    assert_true(cn_contact_touches(p.contact) && cn_contact_least(p.contact, 0) < 0.01);
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
    set_up(&p, 1, &mesh, 0.5, 0.01, false);
    double *dx = calloc(3 * (size_t)p.model->npoint, sizeof *dx);
    for (int shot = 0; shot < 2000; shot++) {
        const double speed = pow(10, -2 + 6 * (shot % 100) / 99.0);
        double r[9], aim[3];
        shape_rotation(&seed, r);
        memcpy(p.x, p.body[0]->rest, 3 * (size_t)mesh->nnode * sizeof *p.x);
        turn(&p, 0, r);
        for (int k = 0; k < 3; k++)
            aim[k] = shape_random(&seed);
        for (int i = 0; i < mesh->nnode; i++)
            for (int k = 0; k < 3; k++)
                dx[3 * i + k] = speed * (aim[k] + 0.3 * shape_random(&seed));
        find(&p, dx, 0.02);
        const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL);
        assert_true(fraction > 0);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            p.x[i] += fraction * dx[i];
        const cn_findings found = check(&p);
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
    set_up(&p, 1, &mesh, 0.5, 0.02, false);
    shift(&p, 0, 0.188, 0.29, 0.29);
    find(&p, NULL, 0.05);
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
    put_away(&p);
    cn_tets_free(mesh);
}

static void crossings_and_outside_points_are_seen(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    place p;
    set_up(&p, 1, &mesh, 0.5, 0.01, false);
    cn_findings found = check(&p);
    assert_int_equal(found.intersections + found.outside, 0);
    shift(&p, 0, 0.43, 0, 0);
    found = check(&p);
    assert_true(found.intersections > 0 && found.outside >= 4 && found.depth > 0.1 && found.depth < 0.16);
    assert_true(found.surface[0] == 0 && found.surface[1] == 1);
    put_away(&p);
    cn_tets_free(mesh);
}

static void projection_ends_without_crossing_or_says_how_many_are_left(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    double v[3 * 35] = {0}, mass[35];
    set_up(&p, 1, &mesh, 0.5, 0.01, false);
    shift(&p, 0, 0.305, 0.1, 0.1);
    for (int i = 0; i < 35; i++)
        mass[i] = i < 27 ? p.body[0]->mass[i] : INFINITY, v[3 * i] = i < 27;
    assert_int_equal(p.model->npoint, 35);
    const int left =
        cn_contact_project(p.model, p.contact, p.nfree, mass, p.x, v, CN_RESPONSE_INELASTIC, 1, 20);
    assert_int_equal(left, 0);
    assert_int_equal(check(&p).intersections, 0);
    for (int i = 0; i < 27; i++) /* touched nodes have lost their normal velocity */
        assert_true(v[3 * i] == 1 || fabs(v[3 * i]) < 1e-12);
    put_away(&p);
    cn_tets_free(mesh);
}

static void a_full_list_is_an_error_and_can_be_grown(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    place p;
    set_up(&p, 1, &mesh, 0.3, 0.05, false);
    p.contact->part[0].capacity = 8;
    cn_status status = cn_contact_find(p.model, p.contact, p.nfree, p.x, NULL, 1, 0, NULL);
    assert_int_equal(status, CN_ERR_CONTACT);
    for (int i = 0; i < 20 && status != CN_OK; i++) {
        assert_int_equal(cn_contact_grow(p.contact), CN_OK);
        status = cn_contact_find(p.model, p.contact, p.nfree, p.x, NULL, 1, 0, NULL);
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
