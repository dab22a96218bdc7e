/* LINK: wrap */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "polar.h"
#include "pool.h"
#include "shapes.h"
#include "skin_cases.h"

enum { AROUND = 64 };
static const int bar_size[3] = {2, 2, 9};
static const double spacing = 1, length = 8, angle = 2; /* the bar is bent by 2 rad */

/* A capsule over the bar, at rest and bent. */
typedef struct {
    cn_surface *surface;
    skin_bar bar;
    cn_skin *skin;
    cn_skin_state *state;
} fixture;

static fixture fixture_of(int n, bool embedded)
{
    fixture f = {.surface = skin_capsule(length, 1.1, AROUND)};
    f.bar = skin_bar_new(bar_size, spacing, length, angle);
    if (embedded) {
        cn_tets *tets = shape_box(3, 3, 11, 1);
        for (int i = 0; i < tets->nnode; i++)
            tets->node[3 * i] -= 1.5, tets->node[3 * i + 1] -= 1.5, tets->node[3 * i + 2] -= 1.5;
        skin_bar_free(&f.bar);
        f.bar.n = tets->nnode;
        f.bar.rest = malloc(3 * (size_t)tets->nnode * sizeof(double));
        f.bar.place = malloc(3 * (size_t)tets->nnode * sizeof(double));
        f.bar.rotation = malloc(4 * (size_t)tets->nnode * sizeof(double));
        memcpy(f.bar.rest, tets->node, 3 * (size_t)tets->nnode * sizeof(double));
        for (int i = 0; i < tets->nnode; i++)
            skin_bend(length, angle, tets->node + 3 * i, f.bar.place + 3 * i, f.bar.rotation + 4 * i);
        assert_int_equal(cn_skin_new_embedded(&f.skin, f.surface, tets, NULL), CN_OK);
        cn_tets_free(tets);
    } else
        assert_int_equal(cn_skin_new(&f.skin, f.surface, f.bar.n, f.bar.rest, NULL, n, NULL), CN_OK);
    assert_int_equal(cn_skin_state_new(&f.state, f.skin, NULL), CN_OK);
    return f;
}

static void drop(fixture *f)
{
    cn_skin_state_free(f->state);
    cn_skin_free(f->skin);
    skin_bar_free(&f->bar);
    cn_surface_free(f->surface);
}

static void update(fixture *f)
{
    assert_int_equal(cn_skin_update(f->skin, f->bar.place, f->bar.rotation, f->state, NULL), CN_OK);
}

/* --- weights --- */
static void weights_are_positive_and_sum_to_one(void **state)
{
    (void)state;
    for (int n = 1; n <= CN_SKIN_ANCHORS; n++) {
        fixture f = fixture_of(n, false);
        assert_int_equal(f.skin->nper, n);
        for (int r = 0; r < f.skin->nvert; r++) {
            const double *w = f.skin->weight + n * r;
            double sum = 0;
            for (int j = 0; j < n; j++) {
                assert_true(w[j] > 0);
                assert_true(j == 0 || w[j] <= w[j - 1]);
                sum += w[j];
            }
            assert_true(fabs(sum - 1) <= n * DBL_EPSILON);
            assert_true(r == 0 || f.skin->anchor[n * r] >= f.skin->anchor[n * (r - 1)]);
        }
        drop(&f);
    }
}

/* One vertex at (0.3, 0, 0) among four anchors on the x axis; the weights by hand. */
static void weights_are_those_of_the_formula(void **state)
{
    (void)state;
    double vert[9] = {0.3, 0, 0, 0.3, 0, 0, 0.3, 0, 0};
    int tri[3] = {0, 1, 2};
    const cn_surface surface = {.nvert = 3, .ntri = 1, .vert = vert, .tri = tri};
    const double place[12] = {0, 0, 0, 1, 0, 0, -1, 0, 0, 2, 0, 0};
    cn_skin *skin;
    assert_int_equal(cn_skin_new(&skin, &surface, 4, place, NULL, 2, NULL), CN_OK);
    const double a = (1.3 - 0.3) / (1.3 * 0.3), b = (1.3 - 0.7) / (1.3 * 0.7); /* D = 1.3 */
    assert_int_equal(skin->anchor[0], 0);
    assert_int_equal(skin->anchor[1], 1);
    assert_true(fabs(skin->weight[0] - a * a / (a * a + b * b)) < 1e-5);
    assert_true(fabs(skin->reach - 0.3) < 1e-15);
    cn_skin_free(skin);
    assert_int_equal(cn_skin_new(&skin, &surface, 4, place, NULL, 8, NULL), CN_OK); /* fewer than asked */
    assert_int_equal(skin->nper, 4);
    double sum = 0;
    for (int j = 0; j < 4; j++)
        sum += 1 / pow(0.3 - place[3 * j], 2);
    for (int j = 0; j < 4; j++)
        assert_true(fabs(skin->weight[j] - 1 / pow(0.3 - place[3 * skin->anchor[j]], 2) / sum) < 1e-14);
    cn_skin_free(skin);
}

static void a_vertex_on_an_anchor_hangs_on_it_alone(void **state)
{
    (void)state;
    double vert[9] = {0, 0, 0, 1, 0, 0, 0.5, 1, 0};
    int tri[3] = {0, 1, 2};
    const cn_surface surface = {.nvert = 3, .ntri = 1, .vert = vert, .tri = tri};
    const double place[15] = {0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 3, 3, 3}; /* two of them coincide */
    cn_skin *skin;
    cn_skin_state *now;
    assert_int_equal(cn_skin_new(&skin, &surface, 5, place, NULL, 3, NULL), CN_OK);
    for (int r = 0; r < 3; r++) {
        const double *w = skin->weight + 3 * r;
        if (skin->vertex[r] == 0) assert_true(w[0] == 1 && w[1] == 0 && w[2] == 0);
        if (skin->vertex[r] == 1) assert_true(w[0] == 0.5 && w[1] == 0.5 && w[2] == 0);
    }
    assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
    assert_int_equal(cn_skin_update(skin, place, NULL, now, NULL), CN_OK);
    for (int k = 0; k < 9; k++)
        assert_true(fabs(now->x[k] - vert[k]) < 4 * DBL_EPSILON);
    cn_skin_state_free(now);
    cn_skin_free(skin);
    const double same[6] = {0.2, 0.2, 0.2, 0.2, 0.2, 0.2}; /* nothing but one place */
    assert_int_equal(cn_skin_new(&skin, &surface, 2, same, NULL, 1, NULL), CN_OK);
    assert_true(skin->weight[0] == 1 && skin->weight[1] == 1 && skin->weight[2] == 1);
    cn_skin_free(skin);
}

/* Where an anchor takes another's place among the nearest n, the skin has no jump. */
static void the_skin_is_continuous_where_anchors_change(void **state)
{
    (void)state;
    const double axis[15] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 4, 0, 0};
    double rotation[20];
    unsigned seed = 5;
    for (int i = 0; i < 20; i++)
        rotation[i] = shape_random(&seed);
    for (int n = 2; n <= 4; n++) {
        const double step = 1e-7; /* vertices on both sides of x = 1.5 + n / 2 - floor(n / 2) */
        const double at = n % 2 ? 2 : 1.5;
        double vert[9] = {at - step, 0.4, 0, at + step, 0.4, 0, at, 0.5, 0};
        int tri[3] = {0, 1, 2};
        const cn_surface surface = {.nvert = 3, .ntri = 1, .vert = vert, .tri = tri};
        cn_skin *skin;
        cn_skin_state *now;
        assert_int_equal(cn_skin_new(&skin, &surface, 5, axis, NULL, n, NULL), CN_OK);
        assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
        assert_int_equal(cn_skin_update(skin, axis, rotation, now, NULL), CN_OK);
        assert_true(cn_distance(now->x, now->x + 3) < 50 * step);
        cn_skin_state_free(now);
        cn_skin_free(skin);
    }
}

/* --- motion --- */
static void a_rigid_motion_of_the_anchors_moves_the_skin_rigidly(void **state)
{
    (void)state;
    unsigned seed = 11;
    for (int n = 1; n <= CN_SKIN_ANCHORS + 1; n++) { /* the last one embedded */
        fixture f = fixture_of(n, n > CN_SKIN_ANCHORS);
        double turn[4], r[9], normal[3], worst = 0;
        for (int k = 0; k < 4; k++)
            turn[k] = shape_random(&seed);
        const double by = 1 / sqrt(turn[0] * turn[0] + cn_norm2(turn + 1));
        for (int k = 0; k < 4; k++)
            turn[k] *= by;
        cn_quaternion_matrix(turn, r);
        const double shift[3] = {3, -2, 5};
        for (int i = 0; i < f.bar.n; i++) {
            memcpy(f.bar.place + 3 * i, shift, sizeof shift);
            for (int k = 0; k < 3; k++)
                f.bar.place[3 * i + k] += cn_dot(r + 3 * k, f.bar.rest + 3 * i);
            memcpy(f.bar.rotation + 4 * i, turn, sizeof turn);
        }
        update(&f);
        for (int v = 0; v < f.surface->nvert; v++) {
            double x[3];
            cn_mat_vec(r, f.surface->vert + 3 * v, x);
            cn_axpy(1, shift, x);
            worst = fmax(worst, cn_distance(x, f.state->x + 3 * v));
            assert_true(fabs(cn_norm(f.state->normal + 3 * v) - 1) < 4 * DBL_EPSILON);
        }
        assert_true(worst < 32 * DBL_EPSILON * (length + 5));
        for (int t = 0; t < f.surface->ntri; t++) { /* normals turn along */
            const int *c = f.surface->tri + 3 * t;
            double u[3], w[3], rest[3];
            cn_sub(f.surface->vert + 3 * c[1], f.surface->vert + 3 * c[0], u);
            cn_sub(f.surface->vert + 3 * c[2], f.surface->vert + 3 * c[0], w);
            cn_cross(u, w, rest);
            const double area = cn_normalise(rest) / 2;
            cn_mat_vec(r, rest, normal);
            assert_true(cn_distance(normal, f.state->face + 4 * t) < 1e-12);
            assert_true(fabs(f.state->face[4 * t + 3] - area) < 1e-12 * area);
        }
        drop(&f);
    }
}

/* Rest rotations are where turning starts: all anchors and rotations turned from there. */
static void rest_rotations_are_where_turning_starts(void **state)
{
    (void)state;
    fixture f = fixture_of(4, false);
    cn_skin *skin;
    assert_int_equal(cn_skin_new(&skin, f.surface, f.bar.n, f.bar.place, f.bar.rotation, 4, NULL), CN_OK);
    assert_int_equal(cn_skin_update(skin, f.bar.place, f.bar.rotation, f.state, NULL), CN_OK);
    for (int v = 0; v < f.surface->nvert; v++)
        assert_true(cn_distance(f.state->x + 3 * v, f.surface->vert + 3 * v) < 1e-14 * length);
    cn_skin_free(skin);
    drop(&f);
}

/* --- smoothness --- */
static double sharpest(int n, bool embedded)
{
    double found;
    fixture f = fixture_of(n, embedded);
    update(&f);
    assert_int_equal(cn_skin_sharpest(f.skin, f.state, &found), CN_OK);
    drop(&f);
    return found;
}

/* Egger's figure 8 as a number: the largest angle between neighbouring faces of the bent capsule. */
static void four_anchors_are_smoother_than_one(void **state)
{
    (void)state;
    double found[CN_SKIN_ANCHORS + 1];
    fixture f = fixture_of(1, false);
    for (int v = 0; v < f.surface->nvert; v++)
        skin_bend(length, angle, f.surface->vert + 3 * v, f.state->x + 3 * v, NULL);
    cn_surface *bent = f.surface;
    memcpy(bent->vert, f.state->x, 3 * (size_t)bent->nvert * sizeof(double));
    cn_skin *skin;
    assert_int_equal(cn_skin_new(&skin, bent, 1, (double[3]){0}, NULL, 1, NULL), CN_OK);
    assert_int_equal(cn_skin_update(skin, (double[3]){0}, NULL, f.state, NULL), CN_OK);
    assert_int_equal(cn_skin_sharpest(skin, f.state, &found[0]), CN_OK);
    cn_skin_free(skin);
    drop(&f);
    printf("largest angle between neighbouring faces [degrees]: bent exactly %.2f\n",
           found[0] * 45 / atan(1));
    for (int n = 1; n <= CN_SKIN_ANCHORS; n++) {
        found[n] = sharpest(n, false);
        printf("  %d anchors %.2f\n", n, found[n] * 45 / atan(1));
    }
    printf("  embedded %.2f\n", sharpest(4, true) * 45 / atan(1));
    assert_true(found[4] < 0.5 * found[1]);
}

/* --- the way back --- */
static void forces_keep_their_sum_their_moment_and_their_work(void **state)
{
    (void)state;
    for (int embedded = 0; embedded < 2; embedded++) {
        unsigned seed = 7;
        fixture f = fixture_of(4, embedded);
        const size_t n = 3 * (size_t)f.surface->nvert, m = 3 * (size_t)f.bar.n;
        double *force = calloc(n, sizeof *force), *to = calloc(m, sizeof *to),
               *moment = calloc(m, sizeof *to), *old = malloc(n * sizeof *old);
        double sum[3] = {0}, about[3] = {0}, c[3];
        update(&f);
        memcpy(old, f.state->x, n * sizeof *old);
        for (size_t v = 0; v < n / 3; v++)
            for (size_t k = 0; k < 3 && v % 3; k++)
                force[3 * v + k] = shape_random(&seed);
        cn_skin_pull(f.skin, f.state, f.bar.place, force, to, moment);
        for (size_t v = 0; v < n / 3; v++) {
            cn_axpy(-1, force + 3 * v, sum);
            cn_cross(force + 3 * v, f.state->x + 3 * v, c);
            cn_axpy(1, c, about);
        }
        for (size_t i = 0; i < m / 3; i++) {
            cn_axpy(1, to + 3 * i, sum);
            cn_cross(f.bar.place + 3 * i, to + 3 * i, c);
            cn_axpy(1, c, about);
            cn_axpy(1, moment + 3 * i, about);
        }
        assert_true(cn_norm(sum) < 1e-11 && cn_norm(about) < 1e-10);
        /* virtual work: anchors move by d and turn by w */
        const double h = 1e-6;
        double work = 0, given = 0;
        for (size_t i = 0; i < m / 3; i++) {
            double d[3], w[3], q[4], *p = f.bar.rotation + 4 * i;
            for (int k = 0; k < 3; k++)
                d[k] = shape_random(&seed), w[k] = shape_random(&seed);
            given += cn_dot(to + 3 * i, d) + cn_dot(moment + 3 * i, w);
            cn_axpy(h, d, f.bar.place + 3 * i);
            memcpy(q, p, sizeof q);
            cn_cross(w, q + 1, c); /* q' = q + h/2 w q */
            p[0] -= h / 2 * cn_dot(w, q + 1);
            for (int k = 0; k < 3; k++)
                p[k + 1] += h / 2 * (q[0] * w[k] + c[k]);
        }
        update(&f);
        for (size_t k = 0; k < n; k++)
            work += force[k] * (f.state->x[k] - old[k]) / h;
        assert_true(fabs(work - given) < 1e-4 * sqrt((double)n));
        free(force), free(to), free(moment), free(old);
        drop(&f);
    }
}

/* --- the same for any thread count --- */
static void every_thread_count_gives_the_same_bits(void **state)
{
    (void)state;
    for (int embedded = 0; embedded < 2; embedded++) {
        fixture f = fixture_of(4, embedded);
        const size_t n = 3 * (size_t)f.surface->nvert;
        double *x = malloc(n * sizeof *x), *normal = malloc(n * sizeof *x);
        update(&f);
        memcpy(x, f.state->x, n * sizeof *x), memcpy(normal, f.state->normal, n * sizeof *x);
        for (int threads = 1; threads <= 4; threads++) {
            cn_pool *pool;
            assert_int_equal(cn_pool_new(&pool, threads), CN_OK);
            memset(f.state->x, 0, n * sizeof *x), memset(f.state->normal, 0, n * sizeof *x);
            fail_alloc_at(-1);
            assert_int_equal(cn_skin_update(f.skin, f.bar.place, f.bar.rotation, f.state, pool), CN_OK);
            assert_int_equal(fail_alloc_count(), 0);
            assert_memory_equal(x, f.state->x, n * sizeof *x);
            assert_memory_equal(normal, f.state->normal, n * sizeof *x);
            cn_pool_free(pool);
        }
        free(x), free(normal);
        drop(&f);
    }
}

/* Powers of two change no digit of a skin; other units none that counts. */
static void units_do_not_matter(void **state)
{
    (void)state;
    fixture f = fixture_of(4, false);
    update(&f);
    for (int exponent = -24; exponent <= 12; exponent += 12) {
        fixture g = fixture_of(4, false);
        for (int i = 0; i < 3 * g.bar.n; i++)
            g.bar.rest[i] = ldexp(g.bar.rest[i], exponent), g.bar.place[i] = ldexp(g.bar.place[i], exponent);
        for (int i = 0; i < 3 * g.surface->nvert; i++)
            g.surface->vert[i] = ldexp(g.surface->vert[i], exponent);
        cn_skin_free(g.skin);
        assert_int_equal(cn_skin_new(&g.skin, g.surface, g.bar.n, g.bar.rest, NULL, 4, NULL), CN_OK);
        update(&g);
        for (int i = 0; i < 3 * g.surface->nvert; i++) {
            assert_true(g.state->x[i] == ldexp(f.state->x[i], exponent));
            assert_true(g.state->normal[i] == f.state->normal[i]);
        }
        drop(&g);
    }
    drop(&f);
}

/* --- refusals --- */
static void faces_without_area_have_no_normal(void **state)
{
    (void)state;
    double vert[15] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 5, 5, 5, 0, 1, 0};
    int tri[12] = {0, 1, 2, 1, 1, 2, 3, 3, 3, 0, 1, 4};
    const cn_surface surface = {.nvert = 5, .ntri = 4, .vert = vert, .tri = tri};
    const double place[3] = {0}, zero[4] = {0}, up[3] = {0, 0, 1};
    cn_skin *skin;
    cn_skin_state *now;
    double most;
    assert_int_equal(cn_skin_new(&skin, &surface, 1, place, NULL, 4, NULL), CN_OK);
    assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
    assert_int_equal(cn_skin_update(skin, place, NULL, now, NULL), CN_OK);
    for (int t = 0; t < 3; t++)
        assert_memory_equal(now->face + 4 * t, zero, sizeof zero);
    assert_memory_equal(now->normal, up, sizeof up);
    assert_memory_equal(now->normal + 9, zero, 3 * sizeof *zero);
    assert_int_equal(cn_skin_sharpest(skin, now, &most), CN_OK);
    assert_true(most == 0);
    cn_skin_state_free(now);
    cn_skin_free(skin);
}

static void what_is_no_skin_is_refused(void **state)
{
    (void)state;
    fixture f = fixture_of(4, false);
    const double zeros[4] = {0};
    cn_skin *skin = f.skin;
    cn_error error = {0};
    const cn_surface none = {0};
    cn_tets *tets = shape_box(1, 1, 1, 1);
#define REFUSED(status, words, ...)                                                                          \
    memset(&error, 0, sizeof error);                                                                         \
    assert_int_equal(__VA_ARGS__, status);                                                                   \
    assert_null(skin);                                                                                       \
    assert_non_null(strstr(error.message, words))
    REFUSED(CN_ERR_ARG, "1 to 8", cn_skin_new(&skin, f.surface, f.bar.n, f.bar.rest, NULL, 0, &error));
    REFUSED(CN_ERR_ARG, "9 are asked", cn_skin_new(&skin, f.surface, f.bar.n, f.bar.rest, NULL, 9, &error));
    REFUSED(CN_ERR_ARG, "needs an anchor", cn_skin_new(&skin, f.surface, 0, f.bar.rest, NULL, 4, &error));
    REFUSED(CN_ERR_MESH, "needs triangles", cn_skin_new(&skin, &none, f.bar.n, f.bar.rest, NULL, 4, &error));
    REFUSED(CN_ERR_MESH, "needs triangles", cn_skin_new_embedded(&skin, &none, tets, &error));
    REFUSED(CN_ERR_ARG, "zeros", cn_skin_new(&skin, f.surface, 1, f.bar.rest, zeros, 4, &error));
    f.surface->tri[7] = f.surface->nvert;
    REFUSED(CN_ERR_MESH, "triangle 2", cn_skin_new(&skin, f.surface, f.bar.n, f.bar.rest, NULL, 4, &error));
    f.surface->tri[7] = 0;
    f.bar.rest[4] = NAN;
    REFUSED(CN_ERR_NOT_FINITE, "anchor 1",
            cn_skin_new(&skin, f.surface, f.bar.n, f.bar.rest, NULL, 4, &error));
    f.bar.rest[4] = 1e200;
    f.bar.rotation[6] = INFINITY;
    REFUSED(CN_ERR_NOT_FINITE, "rotation of anchor 1",
            cn_skin_new(&skin, f.surface, f.bar.n, f.bar.place, f.bar.rotation, 4, &error));
    REFUSED(CN_ERR_NOT_FINITE, "too far", cn_skin_new(&skin, f.surface, 1, f.bar.rest + 3, NULL, 1, &error));
    tets->node[5] = NAN;
    REFUSED(CN_ERR_NOT_FINITE, "node 1", cn_skin_new_embedded(&skin, f.surface, tets, &error));
    for (int i = 0; i < 3 * tets->nnode; i++)
        tets->node[i] = i % 3;
    REFUSED(CN_ERR_MESH, "has a volume", cn_skin_new_embedded(&skin, f.surface, tets, &error));
    tets->tet[3] = -1;
    REFUSED(CN_ERR_MESH, "names node -1", cn_skin_new_embedded(&skin, f.surface, tets, &error));
    f.surface->vert[3] = NAN;
    REFUSED(CN_ERR_NOT_FINITE, "vertex 1",
            cn_skin_new(&skin, f.surface, f.bar.n, f.bar.place, NULL, 4, &error));
#undef REFUSED
    cn_tets_free(tets);
    drop(&f);
}

static void numbers_that_are_none_leave_the_skin_as_it_was(void **state)
{
    (void)state;
    fixture f = fixture_of(4, false);
    const size_t n = 3 * (size_t)f.surface->nvert;
    double *x = malloc(n * sizeof *x);
    update(&f);
    memcpy(x, f.state->x, n * sizeof *x);
    double *const spoilt[2] = {&f.bar.place[7], &f.bar.rotation[9]};
    for (int which = 0; which < 2; which++) {
        const double kept = *spoilt[which];
        *spoilt[which] = which ? INFINITY : NAN;
        assert_int_equal(cn_skin_update(f.skin, f.bar.place, f.bar.rotation, f.state, NULL),
                         CN_ERR_NOT_FINITE);
        *spoilt[which] = kept;
    }
    memset(f.bar.rotation, 0, 4 * sizeof(double));
    assert_int_equal(cn_skin_update(f.skin, f.bar.place, f.bar.rotation, f.state, NULL), CN_ERR_NOT_FINITE);
    assert_memory_equal(x, f.state->x, n * sizeof *x);
    free(x);
    drop(&f);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    fixture f = fixture_of(4, false);
    cn_tets *tets = shape_box(3, 3, 11, 1);
    for (int embedded = 0; embedded < 2; embedded++) {
        cn_skin *skin;
        cn_skin_state *now;
        int spared = 0;
        for (FAIL_EACH_ALLOC) {
            cn_error error = {0};
            double most;
            cn_status status = embedded ? cn_skin_new_embedded(&skin, f.surface, tets, &error)
                                        : cn_skin_new(&skin, f.surface, f.bar.n, f.bar.rest, NULL, 4, &error);
            if (status == CN_OK) {
                status = cn_skin_state_new(&now, skin, &error);
                if (status == CN_OK) status = cn_skin_sharpest(skin, now, &most);
                if (now) cn_skin_state_free(now);
                cn_skin_free(skin);
            } else
                assert_null(skin);
            if (status == CN_OK && fail_alloc_fired() && embedded) /* the tree's list kept its length */
                assert_true(++spared == 1);
            else
                assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        }
    }
    cn_tets_free(tets);
    drop(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(weights_are_positive_and_sum_to_one),
        cmocka_unit_test(weights_are_those_of_the_formula),
        cmocka_unit_test(a_vertex_on_an_anchor_hangs_on_it_alone),
        cmocka_unit_test(the_skin_is_continuous_where_anchors_change),
        cmocka_unit_test(a_rigid_motion_of_the_anchors_moves_the_skin_rigidly),
        cmocka_unit_test(rest_rotations_are_where_turning_starts),
        cmocka_unit_test(four_anchors_are_smoother_than_one),
        cmocka_unit_test(forces_keep_their_sum_their_moment_and_their_work),
        cmocka_unit_test(every_thread_count_gives_the_same_bits),
        cmocka_unit_test(units_do_not_matter),
        cmocka_unit_test(faces_without_area_have_no_normal),
        cmocka_unit_test(what_is_no_skin_is_refused),
        cmocka_unit_test(numbers_that_are_none_leave_the_skin_as_it_was),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
