/* test_contact_bodies.c - contact between bodies, and of a body with itself. LINK: wrap */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "contact_place.h"
#include "fail_alloc.h"

static const double GAP = 0.02;

/* Takes the second body from far off towards the first until they are nearly as close as `left` of a gap;
 * false where it passes by. */
static bool approach(place *p, unsigned *seed, double left)
{
    const int n = p->model->npoint;
    double r[9], from[3], *dx = calloc(3 * (size_t)n, sizeof *dx);
    for (int s = 0; s < 2; s++) {
        memcpy(place_points(p, s), p->body[s]->rest, 3 * (size_t)p->nfree[s] * sizeof *p->x);
        shape_rotation(seed, r);
        place_turn(p, s, r);
    }
    for (int k = 0; k < 3; k++)
        from[k] = shape_random(seed);
    cn_normalise(from);
    place_shift(p, 1, from[0], from[1], from[2]);
    for (int i = 0; i < p->nfree[1]; i++)
        cn_axpy(-1.5, from, dx + 3 * (p->model->surface[1].first + i));
    double fraction = 0;
    for (int tries = 0; tries < 40 && fraction < 1; tries++) { /* each leaves 0.3 of the distance */
        place_find(p, dx, 0);
        fraction = cn_contact_motion(p->model, p->contact, p->x, dx, 0.3, NULL);
        for (int i = 0; i < 3 * n; i++)
            p->x[i] += fraction * dx[i];
        place_find(p, NULL, 0);
        if (cn_contact_least(p->contact, -1) < left * GAP) break;
    }
    free(dx);
    return fraction < 1;
}

/* Net force, and moment about the origin. */
static void resultant(const place *p, const double *f, double force[3], double moment[3])
{
    memset(force, 0, 3 * sizeof *force), memset(moment, 0, 3 * sizeof *moment);
    for (int i = 0; i < p->model->npoint; i++) {
        double m[3];
        cn_cross(p->x + 3 * i, f + 3 * i, m);
        cn_add(force, f + 3 * i, force), cn_add(moment, m, moment);
    }
}

static double largest_of(int n, const double *f)
{
    double most = 0;
    for (int i = 0; i < n; i++)
        most = fmax(most, fabs(f[i]));
    return most;
}

static void two_cubes(place *p, double half)
{
    cn_tets *mesh[2] = {shape_box(2, 2, 2, 0.1), shape_box(1, 1, 1, 0.15)};
    place_make(p, 2, mesh, half, GAP, false);
    cn_tets_free(mesh[0]), cn_tets_free(mesh[1]);
}

static void force_between_bodies_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    place p;
    unsigned seed = 3;
    int done = 0;
    two_cubes(&p, 0);
    for (int i = 0; i < 60; i++) {
        if (!approach(&p, &seed, 0.7)) continue;
        place_gradient_is_right(&p, 1e-8, 1e-5);
        done++;
    }
    assert_true(done > 10);
    place_free(&p);
}

/* Parallel faces and edges, where the mollifier works. */
static void force_between_parallel_cubes_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    place p;
    const double tilt[3] = {0.01, -0.013, 0.007};
    double r[9];
    two_cubes(&p, 0);
    cn_rotation(tilt, r);
    place_turn(&p, 1, r);
    place_shift(&p, 1, 0.05, 0.06, 0.209); /* above a face, its edges along the face's */
    place_gradient_is_right(&p, 1e-8, 1e-5);
    place_shift(&p, 1, 0.155, 0, 0); /* edge beside edge */
    place_gradient_is_right(&p, 1e-8, 1e-5);
    place_free(&p);
}

static void bodies_push_each_other_equally_without_a_moment(void **state)
{
    (void)state;
    place p;
    unsigned seed = 11;
    int done = 0;
    two_cubes(&p, 0);
    double *f = malloc(3 * (size_t)p.model->npoint * sizeof *f);
    for (int i = 0; i < 100; i++) {
        double force[3], moment[3];
        if (!approach(&p, &seed, 0.7)) continue;
        memset(f, 0, 3 * (size_t)p.model->npoint * sizeof *f);
        place_find(&p, NULL, 0);
        assert_true(place_add(&p, f) > 0);
        resultant(&p, f, force, moment);
        const double most = largest_of(3 * p.model->npoint, f);
        assert_true(cn_norm(force) < 1e-12 * most && cn_norm(moment) < 1e-12 * most);
        done++;
    }
    assert_true(done > 20);
    free(f);
    place_free(&p);
}

/* One cube on another, all of it one patch. */
static void the_patch_force_is_the_same_seen_from_both_sides(void **state)
{
    (void)state;
    place p;
    double f[3 * 35] = {0}, on[3] = {0, 0, 0};
    two_cubes(&p, 0);
    place_shift(&p, 1, 0.04, 0.02, 0.2 + 0.5 * GAP);
    place_find(&p, NULL, 0);
    place_add(&p, f);
    for (int i = 0; i < p.nfree[0]; i++)
        cn_add(on, f + 3 * i, on);
    for (int s = 0; s < 2; s++) {
        double where[3];
        int other;
        const double size = cn_contact_patch_force(p.model, p.contact, s, p.x, where, &other);
        assert_int_equal(other, 1 - s);
        assert_true(on[2] < 0 && fabs(size - cn_norm(on)) < 1e-9 * size);
        assert_true(fabs(where[2] - (s ? 0.2 : 0.2 + 0.5 * GAP)) < 1e-12);
    }
    place_free(&p);
}

static void the_frame_and_the_order_of_surfaces_do_not_matter(void **state)
{
    (void)state;
    cn_tets *mesh[2] = {shape_box(2, 2, 2, 0.1), shape_box(1, 1, 1, 0.15)};
    place p, q;
    unsigned seed = 5;
    int done = 0;
    place_make(&p, 2, mesh, 0, GAP, false);
    memset(&q, 0, sizeof q);
    place_world(&q, NULL);
    place_bodies(&q, 2, mesh);
    const cn_contact_body swapped[2] = {{q.body[1], -1, false, 0.8 * GAP, 2e3},
                                        {q.body[0], -1, false, GAP, 1e3}};
    place_contact(&q, 2, swapped, NULL);
    double f[3 * 35], g[3 * 35];
    assert_int_equal(p.model->npoint, 35);
    for (int i = 0; i < 40; i++) {
        const double shift[3] = {shape_random(&seed), shape_random(&seed), shape_random(&seed)};
        double r[9];
        if (!approach(&p, &seed, 0.7)) continue;
        memset(f, 0, sizeof f), memset(g, 0, sizeof g);
        place_find(&p, NULL, 0);
        const double energy = place_add(&p, f), most = largest_of(3 * 35, f);
        shape_rotation(&seed, r);
        for (int s = 0; s < 2; s++)
            memcpy(place_points(&q, 1 - s), place_points(&p, s), 3 * (size_t)p.nfree[s] * sizeof *q.x);
        for (int s = 0; s < 2; s++)
            place_turn(&q, s, r), place_shift(&q, s, shift[0], shift[1], shift[2]);
        place_find(&q, NULL, 0);
        assert_int_equal(p.contact->npair, q.contact->npair);
        assert_true(fabs(place_add(&q, g) - energy) < 1e-9 * energy);
        for (int s = 0; s < 2; s++)
            for (int k = 0; k < p.nfree[s]; k++) {
                double turned[3];
                cn_mat_vec(r, f + 3 * (p.model->surface[s].first + k), turned);
                const double *there = g + 3 * (q.model->surface[1 - s].first + k);
                assert_true(cn_distance(turned, there) < 1e-8 * most);
            }
        done++;
    }
    assert_true(done > 10);
    place_free(&p), place_free(&q);
    cn_tets_free(mesh[0]), cn_tets_free(mesh[1]);
}

/* Matrices of the bodies, zero. */
static void matrices(const place *p, cn_matrix *a[2])
{
    const int first[1] = {0};
    for (int s = 0; s < p->nbody; s++) {
        const cn_body *const one[1] = {p->body[s]};
        assert_int_equal(cn_matrix_new(&a[s], 1, one, first), CN_OK);
        cn_matrix_clear(a[s], a[s]->n);
    }
}

static double entry(const cn_matrix *a, int i, int j)
{
    const int block = cn_matrix_find(a, i / 3, j / 3);
    return block < 0 ? 0 : a->value[9 * block + 3 * (i % 3) + j % 3];
}

/* Against a body that does not give way, corners, edges and faces of both in turn; no edges are parallel. */
static void stiffness_of_one_side_is_minus_the_force_gradient(void **state)
{
    (void)state;
    place p;
    unsigned seed = 17;
    int done = 0;
    const double h = 1e-8;
    cn_matrix *a[2];
    two_cubes(&p, 0);
    matrices(&p, a);
    for (int i = 0; i < 60; i++) {
        const int side = i % 2;
        if (!approach(&p, &seed, 0.7)) continue;
        cn_hang hang[2] = {{.matrix = NULL}, {.matrix = NULL}};
        hang[side].matrix = a[side];
        cn_matrix_clear(a[side], a[side]->n);
        place_find(&p, NULL, 10 * h);
        cn_contact_add(p.model, p.contact, p.x, NULL, hang, true, NULL);
        assert_int_equal(p.contact->nlink, 0);
        const double largest = largest_of(9 * a[side]->nblock, a[side]->value);
        double *x = place_points(&p, side), up[3 * 35], down[3 * 35];
        const int first = 3 * p.model->surface[side].first;
        assert_true(largest > 0);
        for (int j = 0; j < 3 * p.nfree[side]; j++) {
            const double xj = x[j];
            memset(up, 0, sizeof up), memset(down, 0, sizeof down);
            x[j] = xj + h, place_add(&p, up);
            x[j] = xj - h, place_add(&p, down);
            x[j] = xj;
            for (int k = 0; k < 3 * p.nfree[side]; k++)
                assert_true(fabs(entry(a[side], k, j) + (up[first + k] - down[first + k]) / (2 * h)) <
                            1e-4 * largest);
        }
        done++;
    }
    assert_true(done > 10);
    cn_matrix_free(a[0]), cn_matrix_free(a[1]);
    place_free(&p);
}

/* Each link is k j j'; what is in the matrices is its part within a side. */
static void matrices_and_links_make_the_gauss_newton_stiffness(void **state)
{
    (void)state;
    place p;
    unsigned seed = 23;
    int done = 0;
    cn_matrix *a[2];
    two_cubes(&p, 0);
    matrices(&p, a);
    const int n = 3 * p.model->npoint;
    double *want = malloc((size_t)n * (size_t)n * sizeof *want);
    for (int i = 0; i < 40; i++) {
        /* the second body's pattern does not take its own blocks; or its rank is the higher */
        const bool linked = i % 3 == 0, without = i % 3 < 2;
        if (!approach(&p, &seed, 0.7)) continue;
        const cn_hang hang[2] = {{.matrix = a[0]}, {.matrix = a[1], .linked = linked, .rank = i % 3 == 1}};
        cn_matrix_clear(a[0], a[0]->n), cn_matrix_clear(a[1], a[1]->n);
        memset(want, 0, (size_t)n * (size_t)n * sizeof *want);
        place_find(&p, NULL, 0);
        cn_contact_add(p.model, p.contact, p.x, NULL, hang, i % 2, NULL);
        assert_true(p.contact->nlink > 0);
        for (int l = 0; l < p.contact->nlink; l++) {
            const cn_link *link = &p.contact->link[l];
            assert_true(link->own[0] == !(without && link->surface[0] == 1));
            assert_true(link->own[1] == !(without && link->surface[1] == 1));
            assert_true(link->k >= 0 && fabs(cn_norm(link->n) - 1) < 1e-12);
            assert_true(fabs(link->w[0] + link->w[1] + link->w[2] + link->w[3]) < 1e-12);
            for (int r = 0; r < 12; r++)
                for (int c = 0; c < 12; c++)
                    want[(size_t)(3 * link->p[r / 3] + r % 3) * (size_t)n +
                         (size_t)(3 * link->p[c / 3] + c % 3)] +=
                        link->k * link->w[r / 3] * link->n[r % 3] * link->w[c / 3] * link->n[c % 3];
        }
        const double largest = largest_of(n * n, want);
        for (int s = 0; s < 2; s++)
            for (int r = 0; r < 3 * p.nfree[s]; r++)
                for (int c = 0; c < 3 * p.nfree[s]; c++) {
                    const int first = 3 * p.model->surface[s].first;
                    const double there =
                        s && without ? 0 : want[(size_t)(first + r) * (size_t)n + (size_t)(first + c)];
                    assert_true(fabs(entry(a[s], r, c) - there) < 1e-12 * largest);
                }
        done++;
    }
    assert_true(done > 10);
    free(want);
    cn_matrix_free(a[0]), cn_matrix_free(a[1]);
    place_free(&p);
}

/* What presses on the soft one is the stiff one: by the soft one's barrier alone it came 4 times as near. */
static void between_soft_and_stiff_the_barrier_is_their_geometric_mean(void **state)
{
    (void)state;
    place p;
    unsigned seed = 31;
    int done = 0;
    two_cubes(&p, 0);
    p.model->surface[0].kappa = 4, p.model->surface[1].kappa = 9e4;
    for (int i = 0; i < 20; i++) {
        if (!approach(&p, &seed, 0.7)) continue;
        place_find(&p, NULL, 0);
        for (int k = 0; k < p.contact->npair; k++, done++)
            assert_true(fabs(p.contact->pair[k].kappa - 600) < 1e-9);
    }
    assert_true(done > 10);
    place_free(&p);
}

/* A pair of edges so near to parallel that the mollifier, whose second derivative is left out, acts. */
static bool mollified(const place *p)
{
    for (int i = 0; i < p->contact->npair; i++) {
        const cn_pair *pair = &p->contact->pair[i];
        double e[2][3], n[3];
        if (pair->kind != CN_PAIR_EDGES || !(p->contact->distance[i] < pair->gap)) continue;
        for (int k = 0; k < 2; k++)
            cn_sub(p->x + 3 * (size_t)pair->p[2 * k + 1], p->x + 3 * (size_t)pair->p[2 * k], e[k]);
        cn_cross(e[0], e[1], n);
        if (cn_norm2(n) < pair->mollify) return true;
    }
    return false;
}

static void exact_links_are_the_forces_derivative_in_any_direction(void **state)
{
    (void)state;
    place p;
    unsigned seed = 29;
    int done = 0;
    cn_matrix *a[2];
    const double h = 1e-8;
    two_cubes(&p, 0);
    matrices(&p, a);
    const int n = 3 * p.model->npoint;
    double *v = malloc((size_t)n * sizeof *v), *f[2], *got = malloc((size_t)n * sizeof *got);
    for (int k = 0; k < 2; k++)
        f[k] = malloc((size_t)n * sizeof *f[k]);
    for (int i = 0; i < 80; i++) {
        if (!approach(&p, &seed, 0.7)) continue;
        const cn_hang hang[2] = {{.matrix = a[0]}, {.matrix = a[1]}};
        place_find(&p, NULL, 100 * h);
        cn_contact_add(p.model, p.contact, p.x, NULL, hang, true, NULL);
        if (mollified(&p)) continue;
        for (int k = 0; k < n; k++)
            v[k] = shape_random(&seed);
        memset(got, 0, (size_t)n * sizeof *got);
        for (int l = 0; l < p.contact->nlink; l++) {
            const cn_link *link = &p.contact->link[l];
            double move[4][3], pull[4][3];
            for (int k = 0; k < 4; k++)
                cn_copy3(v + 3 * link->p[k], move[k]);
            cn_link_multiply(link, (const double(*)[3])move, pull);
            for (int k = 0; k < 4; k++)
                cn_axpy(1, pull[k], got + 3 * link->p[k]);
        }
        for (int k = 0; k < 2; k++) {
            for (int j = 0; j < n; j++)
                p.x[j] += (k ? -2 : 1) * h * v[j];
            memset(f[k], 0, (size_t)n * sizeof *f[k]);
            place_add(&p, f[k]);
        }
        const double largest = largest_of(n, got);
        for (int j = 0; j < n; j++)
            assert_true(fabs(got[j] - (f[1][j] - f[0][j]) / (2 * h)) < 1e-4 * largest);
        done++;
    }
    assert_true(done > 10);
    for (int k = 0; k < 2; k++)
        free(f[k]), cn_matrix_free(a[k]);
    free(v), free(got);
    place_free(&p);
}

/* Plane faces, moved along their common normal: nothing bends, so links give the second derivative. */
static void links_resist_an_approach_as_the_energy_does(void **state)
{
    (void)state;
    place p;
    cn_matrix *a[2];
    const double h = 1e-6;
    two_cubes(&p, 0);
    matrices(&p, a);
    place_shift(&p, 1, 0.04, 0.02, 0.2 + 0.75 * GAP); /* each node above the midst of a triangle */
    place_find(&p, NULL, 10 * h);
    const cn_hang hang[2] = {{.matrix = a[0]}, {.matrix = a[1]}};
    const double energy = cn_contact_add(p.model, p.contact, p.x, NULL, hang, true, NULL);
    double stiff = 0;
    for (int l = 0; l < p.contact->nlink; l++) {
        assert_true(fabs(fabs(p.contact->link[l].n[2]) - 1) < 1e-12);
        stiff += p.contact->link[l].k;
    }
    place_shift(&p, 1, 0, 0, h);
    const double up = place_add(&p, NULL);
    place_shift(&p, 1, 0, 0, -2 * h);
    const double down = place_add(&p, NULL), second = (up - 2 * energy + down) / (h * h);
    assert_true(stiff > 0 && fabs(second - stiff) < 1e-4 * stiff);
    cn_matrix_free(a[0]), cn_matrix_free(a[1]);
    place_free(&p);
}

/* A body that gives way and whose pattern is unfit, against a wall: all by links. */
static void a_linked_body_leaves_its_matrix_alone(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    place p;
    cn_matrix *a[2];
    place_make(&p, 1, &mesh, 0.5, GAP, false);
    matrices(&p, a);
    place_shift(&p, 0, 0, 0, 0.395);
    place_find(&p, NULL, 0);
    const cn_hang hang[2] = {{.matrix = a[0], .linked = true}};
    cn_contact_add(p.model, p.contact, p.x, NULL, hang, true, NULL);
    assert_true(p.contact->nlink > 0 && !p.contact->link[0].own[0] && !p.contact->link[0].own[1]);
    assert_true(largest_of(9 * a[0]->nblock, a[0]->value) == 0);
    cn_matrix_free(a[0]);
    place_free(&p);
    cn_tets_free(mesh);
}

/* Two cubes shot at and past each other, both bending on the way, up to 1e4 of their sizes in a step. */
static void no_body_passes_another_however_fast(void **state)
{
    (void)state;
    place p;
    unsigned seed = 29;
    int stopped = 0;
    two_cubes(&p, 0);
    const int n = 3 * p.model->npoint;
    double *dx = calloc((size_t)n, sizeof *dx), *start = malloc((size_t)n * sizeof *start);
    for (int shot = 0; shot < 1500; shot++) {
        const double speed = pow(10, -2 + 5 * (shot % 100) / 99.0);
        double r[9], from[3], together[3];
        for (int k = 0; k < 3; k++)
            from[k] = shape_random(&seed), together[k] = shape_random(&seed);
        cn_normalise(from);
        for (int s = 0; s < 2; s++) {
            memcpy(place_points(&p, s), p.body[s]->rest, 3 * (size_t)p.nfree[s] * sizeof *p.x);
            shape_rotation(&seed, r);
            place_turn(&p, s, r);
            for (int i = 0; i < 3 * p.nfree[s]; i++)
                dx[3 * p.model->surface[s].first + i] =
                    speed * (together[i % 3] + (s ? -0.5 : 0.5) * from[i % 3] + 0.1 * shape_random(&seed));
        }
        place_shift(&p, 1, 0.8 * from[0], 0.8 * from[1], 0.8 * from[2]);
        memcpy(start, p.x, (size_t)n * sizeof *start);
        assert_int_equal(place_check(&p).intersections, 0);
        place_find(&p, dx, 0.02);
        const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL);
        assert_true(fraction > 0);
        stopped += fraction < 1;
        for (int part = 1; part <= 10; part++) {
            for (int i = 0; i < n; i++)
                p.x[i] = start[i] + 0.1 * part * fraction * dx[i];
            assert_int_equal(place_check(&p).intersections, 0);
        }
    }
    assert_true(stopped > 300);
    free(dx), free(start);
    place_free(&p);
}

/* Cubes that fly together keep their distance, and nothing holds them up. */
static void a_common_motion_is_free(void **state)
{
    (void)state;
    place p;
    unsigned seed = 31;
    two_cubes(&p, 0);
    double *dx = malloc(3 * (size_t)p.model->npoint * sizeof *dx);
    assert_true(approach(&p, &seed, 0.7));
    for (int i = 0; i < 3 * p.model->npoint; i++)
        dx[i] = 100 * (1 + i % 3);
    place_find(&p, dx, 0.02);
    assert_true(p.contact->npair > 0);
    assert_true(cn_contact_motion(p.model, p.contact, p.x, dx, 0.2, NULL) == 1);
    free(dx);
    place_free(&p);
}

/* A strip bent through half a turn: its arms lie `apart` from each other. */
static cn_tets *strip(void)
{
    return shape_box(24, 2, 1, 0.05);
}

static void fold(place *p, double apart)
{
    const double radius = 0.5 * (0.05 + apart), half = 0.5 * 3.14159265358979 * radius;
    for (int i = 0; i < p->nfree[0]; i++) {
        const double *rest = p->body[0]->rest + 3 * i;
        const double s = rest[0] - 0.6, out = radius + rest[2] - 0.025;
        const double angle = fmax(-half, fmin(half, s)) / radius, along = s - angle * radius;
        p->x[3 * i] = out * cos(angle) - fabs(along), p->x[3 * i + 1] = rest[1];
        p->x[3 * i + 2] = out * sin(angle);
    }
}

static void a_folded_strip_touches_itself_and_its_neighbours_do_not_count(void **state)
{
    (void)state;
    cn_tets *mesh = strip();
    place p;
    double force[3], moment[3];
    place_make(&p, 1, &mesh, 0, GAP, true);
    double *f = calloc(3 * (size_t)p.model->npoint, sizeof *f);
    assert_true(p.contact->npart > 1); /* pairs within a part and between parts */
    place_find(&p, NULL, 0.02);
    assert_true(p.contact->npair > 0 && place_add(&p, f) == 0); /* flat: near, but at rest */
    for (int i = 0; i < p.contact->npair; i++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++)
                assert_true(p.contact->pair[i].p[a] != p.contact->pair[i].p[b]);
    assert_int_equal(place_check(&p).intersections, 0);

    fold(&p, 0.6 * GAP);
    assert_int_equal(place_check(&p).intersections, 0);
    place_gradient_is_right(&p, 1e-8, 1e-5);
    assert_true(place_add(&p, f) > 0);
    resultant(&p, f, force, moment);
    const double most = largest_of(3 * p.model->npoint, f);
    assert_true(cn_norm(force) < 1e-11 * most && cn_norm(moment) < 1e-11 * most);

    double *dx = calloc(3 * (size_t)p.model->npoint, sizeof *dx); /* the upper arm down through the lower */
    for (int i = 0; i < p.nfree[0]; i++)
        if (p.x[3 * i + 2] > 0 && p.x[3 * i] < -0.1) dx[3 * i + 2] = -0.04;
    place_find(&p, dx, 0);
    const double fraction = cn_contact_motion(p.model, p.contact, p.x, dx, 0.2, NULL);
    assert_true(fraction > 0 && fraction < 0.6 * GAP / 0.04);
    for (int i = 0; i < 3 * p.model->npoint; i++)
        p.x[i] += dx[i];
    assert_true(place_check(&p).intersections > 0);
    free(f), free(dx);
    place_free(&p);
    cn_tets_free(mesh);
}

static void the_same_pairs_for_any_number_of_threads(void **state)
{
    (void)state;
    cn_tets *mesh[2] = {strip(), shape_box(8, 4, 4, 0.05)};
    place p, q;
    cn_pool *pool;
    assert_int_equal(cn_pool_new(&pool, 2), CN_OK);
    place_make(&p, 2, mesh, 1.3, GAP, true), place_make(&q, 2, mesh, 1.3, GAP, true);
    fold(&p, 0.6 * GAP);
    place_shift(&p, 1, -0.5, 0, 0.5 * 0.05 * 2 + 0.3 * GAP + 0.55 * GAP);
    memcpy(q.x, p.x, 3 * (size_t)p.model->npoint * sizeof *p.x);
    double *f = calloc(3 * (size_t)p.model->npoint, sizeof *f),
           *g = calloc(3 * (size_t)p.model->npoint, sizeof *g);
    double *dx = calloc(3 * (size_t)p.model->npoint, sizeof *dx);
    for (int i = 0; i < 3 * (p.nfree[0] + p.nfree[1]); i++)
        dx[i] = 1e-3 * (i % 7 - 3);
    place_find(&p, dx, 0.01), place_find(&q, dx, 0.01);
    assert_int_equal(cn_contact_find(q.model, q.contact, q.nfree, q.x, dx, 0.01, 0, pool), CN_OK);
    assert_int_equal(p.contact->npair, q.contact->npair);
    int between = 0, own = 0;
    for (int i = 0; i < p.contact->npair; i++) {
        const cn_pair *a = &p.contact->pair[i], *b = &q.contact->pair[i];
        assert_true(a->kind == b->kind && !memcmp(a->p, b->p, sizeof a->p) && a->found == b->found);
        between += a->surface[0] != a->surface[1], own += a->surface[0] == a->surface[1];
    }
    assert_true(between > 0 && own > 0);
    assert_true(cn_contact_motion(p.model, p.contact, p.x, dx, 0.1, NULL) ==
                cn_contact_motion(q.model, q.contact, q.x, dx, 0.1, pool));
    assert_true(cn_contact_add(p.model, p.contact, p.x, f, NULL, false, NULL) ==
                cn_contact_add(q.model, q.contact, q.x, g, NULL, false, pool));
    assert_memory_equal(f, g, 3 * (size_t)p.model->npoint * sizeof *f);
    free(f), free(g), free(dx);
    place_free(&p), place_free(&q);
    cn_pool_free(pool);
    cn_tets_free(mesh[0]), cn_tets_free(mesh[1]);
}

/* A node in the sheath, and triangles that have one, take no part. */
static void what_is_in_the_sheath_meets_nothing(void **state)
{
    (void)state;
    place p;
    unsigned seed = 37;
    two_cubes(&p, 0);
    assert_true(approach(&p, &seed, 0.7));
    p.nfree[1] = 0;
    place_find(&p, NULL, 1);
    assert_int_equal(p.contact->npair, 0);
    p.nfree[1] = 5, p.nfree[0] = 20;
    place_find(&p, NULL, 1);
    assert_true(p.contact->npair > 0);
    for (int i = 0; i < p.contact->npair; i++)
        for (int k = 0; k < 4; k++) {
            const int at = p.contact->pair[i].p[k];
            assert_true(at < p.model->surface[1].first ? at < 20 : at < p.model->surface[1].first + 5);
        }
    place_free(&p);
}

static void two_bodies_that_cross_are_moved_apart_and_keep_their_momentum(void **state)
{
    (void)state;
    for (int elastic = 0; elastic < 2; elastic++) {
        place p;
        double mass[35], v[3 * 35], before[2][3] = {{0}}, after[2][3] = {{0}}, kinetic[2] = {0, 0};
        two_cubes(&p, 0);
        place_shift(&p, 1, 0.03, 0.02, 0.198);
        assert_true(place_check(&p).intersections > 0);
        for (int i = 0; i < 35; i++) {
            mass[i] = i < 27 ? p.body[0]->mass[i] : p.body[1]->mass[i - 27];
            v[3 * i] = 0.3, v[3 * i + 1] = 0, v[3 * i + 2] = i < 27 ? 1 : -1;
            cn_axpy(mass[i], p.x + 3 * i, before[0]), cn_axpy(mass[i], v + 3 * i, before[1]);
            kinetic[0] += mass[i] * cn_norm2(v + 3 * i);
        }
        assert_int_equal(cn_contact_project(p.model, p.contact, p.nfree, mass, p.x, v,
                                            elastic ? CN_RESPONSE_ELASTIC : CN_RESPONSE_INELASTIC, 1, 20),
                         0);
        assert_int_equal(place_check(&p).intersections, 0);
        for (int i = 0; i < 35; i++) {
            cn_axpy(mass[i], p.x + 3 * i, after[0]), cn_axpy(mass[i], v + 3 * i, after[1]);
            kinetic[1] += mass[i] * cn_norm2(v + 3 * i);
        }
        assert_true(cn_distance(before[0], after[0]) < 1e-12 * cn_norm(before[0]));
        assert_true(cn_distance(before[1], after[1]) < 1e-12 * sqrt(kinetic[0]));
        if (elastic)
            assert_true(fabs(kinetic[1] - kinetic[0]) < 1e-9 * kinetic[0]);
        else
            assert_true(kinetic[1] < kinetic[0]);
        place_free(&p);
    }
}

static void a_body_inside_another_is_seen_though_nothing_crosses(void **state)
{
    (void)state;
    cn_tets *mesh[2] = {shape_box(2, 2, 2, 0.1), shape_box(1, 1, 1, 0.02)};
    place p;
    place_make(&p, 2, mesh, 0.5, GAP, false);
    place_shift(&p, 1, 0.06, 0.07, 0.08);
    const cn_findings found = place_check(&p);
    assert_int_equal(found.intersections, 0);
    assert_true(found.outside == 1 && fabs(found.depth - 0.06) < 1e-12 && found.where[2] == 0.08);
    place_shift(&p, 1, 0.2, 0, 0);
    assert_int_equal(place_check(&p).outside, 0);
    place_free(&p);
    cn_tets_free(mesh[0]), cn_tets_free(mesh[1]);
}

static void what_lacks_a_gap_or_a_stiffness_is_refused(void **state)
{
    (void)state;
    place p;
    two_cubes(&p, 0.7);
    cn_contact_model *model;
    const cn_contact_body good = {p.body[0], -1, false, GAP, 1e3}, other = {p.body[1], -1, false, GAP, 1e3};
    for (int i = 0; i < 8; i++) {
        cn_contact_body body[2] = {good, other};
        const unsigned char moving[1] = {i == 7};
        if (i == 0) body[0].gap = 0;
        if (i == 1) body[0].gap = NAN;
        if (i == 2) body[1].kappa = NAN;
        if (i == 3) body[1].kappa = INFINITY; /* the wall has none either */
        if (i == 4) body[0].wall = 1;
        if (i == 5) body[0].wall = -2;
        if (i == 6) body[0].wall = body[1].wall = 0;
        if (i == 7) body[0].wall = 0;
        assert_int_equal(cn_contact_model_new(&model, p.world, 2, body, moving), CN_ERR_ARG);
        assert_null(model);
    }
    place_free(&p);
}

static void every_allocation_that_fails_is_told_and_leaves_nothing_behind(void **state)
{
    (void)state;
    place p;
    two_cubes(&p, 0.7);
    const unsigned char moves[1] = {1};
    for (int kind = 0; kind < 2; kind++) {
        const cn_contact_body body[2] = {{p.body[0], kind ? 0 : -1, true, GAP, 1e3},
                                         {p.body[1], -1, false, GAP, 1e3}};
        int failed = 0;
        bool fired = true;
        for (long n = 0; fired; n++) {
            cn_contact_model *model = NULL;
            cn_contact *contact = NULL;
            fail_alloc_at(n);
            cn_status status = cn_contact_model_new(&model, p.world, 2, body, kind ? NULL : moves);
            if (status == CN_OK) status = cn_contact_new(&contact, model);
            if (status == CN_OK) {
                contact->npair = contact->capacity, contact->part[0].npair = contact->part[0].capacity;
                status = cn_contact_grow(contact);
            }
            fired = fail_alloc_fired();
            fail_alloc_at(-1);
            assert_true(fired || status == CN_OK);
            failed += status != CN_OK;
            assert_true(status == CN_OK || status == CN_ERR_MEMORY);
            cn_contact_free(contact), cn_contact_model_free(model);
        }
        assert_true(failed > 20);
    }
    place_free(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_between_bodies_is_minus_the_energy_gradient),
        cmocka_unit_test(force_between_parallel_cubes_is_minus_the_energy_gradient),
        cmocka_unit_test(bodies_push_each_other_equally_without_a_moment),
        cmocka_unit_test(the_patch_force_is_the_same_seen_from_both_sides),
        cmocka_unit_test(the_frame_and_the_order_of_surfaces_do_not_matter),
        cmocka_unit_test(stiffness_of_one_side_is_minus_the_force_gradient),
        cmocka_unit_test(matrices_and_links_make_the_gauss_newton_stiffness),
        cmocka_unit_test(between_soft_and_stiff_the_barrier_is_their_geometric_mean),
        cmocka_unit_test(exact_links_are_the_forces_derivative_in_any_direction),
        cmocka_unit_test(links_resist_an_approach_as_the_energy_does),
        cmocka_unit_test(a_linked_body_leaves_its_matrix_alone),
        cmocka_unit_test(no_body_passes_another_however_fast),
        cmocka_unit_test(a_common_motion_is_free),
        cmocka_unit_test(a_folded_strip_touches_itself_and_its_neighbours_do_not_count),
        cmocka_unit_test(the_same_pairs_for_any_number_of_threads),
        cmocka_unit_test(what_is_in_the_sheath_meets_nothing),
        cmocka_unit_test(two_bodies_that_cross_are_moved_apart_and_keep_their_momentum),
        cmocka_unit_test(a_body_inside_another_is_seen_though_nothing_crosses),
        cmocka_unit_test(what_lacks_a_gap_or_a_stiffness_is_refused),
        cmocka_unit_test(every_allocation_that_fails_is_told_and_leaves_nothing_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
