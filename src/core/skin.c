/* skin.c - a surface on its nearest anchors, and what all skins have.
 *
 * With A_j = R_j R0_j' and places from the centre, w_j (p_j + R_j r_j) = w_j (A_j X + b_j),
 * b_j = p_j - A_j p0_j: the maps [A_j b_j] are blended, and the vertex is read once however many anchors it
 * has. Rigid anchors share one map: the skin is moved by it to rounding. */
#include "skin_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "nearest.h"
#include "polar.h"
#include "pool.h"

#define TIE 1e-6 /* the anchor that takes over is thought of as this much farther */

static cn_status out_of_memory(cn_error *error)
{
    return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory for a skin");
}

/* --- building --- */
static cn_status check_surface(const cn_surface *s, cn_error *error)
{
    if (!s || s->nvert < 1 || s->ntri < 1)
        return cn_fail(error, CN_FAULT_NO_PARTS, "", 0, "a skin needs triangles, and this surface has none");
    for (size_t i = 0; i < 3 * (size_t)s->nvert; i++)
        if (!isfinite(s->vert[i]))
            return cn_fail(error, CN_ERR_NOT_FINITE, "", 0,
                           "vertex %zu of the skin has coordinate %g: give finite metres", i / 3, s->vert[i]);
    for (size_t i = 0; i < 3 * (size_t)s->ntri; i++)
        if (s->tri[i] < 0 || s->tri[i] >= s->nvert)
            return cn_fail(error, CN_FAULT_NO_VERTEX, "", 0,
                           "triangle %zu of the skin names vertex %d, but vertices run from 0 to %d", i / 3,
                           s->tri[i], s->nvert - 1);
    return CN_OK;
}

/* Triangles around each vertex, ascending. */
static void list_around(cn_skin *skin)
{
    const size_t n = 3 * (size_t)skin->ntri;
    for (size_t c = 0; c < n; c++)
        skin->first[skin->tri[c] + 1]++;
    for (int v = 0; v < skin->nvert; v++)
        skin->first[v + 1] += skin->first[v];
    for (size_t c = n; c-- > 0;) /* from behind: starts end up at their own place, one further */
        skin->around[--skin->first[skin->tri[c] + 1]] = (int)(c / 3);
    memmove(skin->first, skin->first + 1, (size_t)skin->nvert * sizeof *skin->first);
    skin->first[skin->nvert] = (int)n;
}

cn_status cn_skin_begin(cn_skin **out, const cn_surface *surface, int nanchor, int nper, cn_error *error)
{
    cn_skin *skin;
    cn_status status;

    *out = NULL;
    if ((status = check_surface(surface, error)) != CN_OK) return status;
    const size_t n = (size_t)surface->nvert, per = (size_t)nper, corners = 3 * (size_t)surface->ntri;
    if (!(skin = calloc(1, sizeof *skin))) return out_of_memory(error);
    skin->nvert = surface->nvert, skin->ntri = surface->ntri, skin->nanchor = nanchor, skin->nper = nper;
    skin->tri = cn_array(corners, sizeof *skin->tri);
    skin->vertex = cn_array(n, sizeof *skin->vertex);
    skin->rest = cn_array(3 * n, sizeof *skin->rest);
    skin->anchor = cn_array(n * per, sizeof *skin->anchor);
    skin->weight = cn_array(n * per, sizeof *skin->weight);
    skin->first = cn_array(n + 1, sizeof *skin->first);
    skin->around = cn_array(corners, sizeof *skin->around);
    if (!skin->tri || !skin->vertex || !skin->rest || !skin->anchor || !skin->weight || !skin->first ||
        !skin->around) {
        cn_skin_free(skin);
        return out_of_memory(error);
    }
    memcpy(skin->tri, surface->tri, corners * sizeof *skin->tri);
    list_around(skin);
    for (size_t v = 0; v < n; v++) {
        skin->vertex[v] = (int)v;
        cn_axpy(1 / (double)n, surface->vert + 3 * v, skin->centre);
    }
    for (size_t v = 0; v < n; v++)
        cn_sub(surface->vert + 3 * v, skin->centre, skin->rest + 3 * v);
    *out = skin;
    return CN_OK;
}

void cn_skin_free(cn_skin *skin)
{
    if (!skin) return;
    free(skin->tri);
    free(skin->vertex);
    free(skin->rest);
    free(skin->anchor);
    free(skin->weight);
    free(skin->place);
    free(skin->rotation);
    free(skin->first);
    free(skin->around);
    free(skin);
}

cn_status cn_skin_sort(cn_skin *skin)
{
    const size_t n = (size_t)skin->nvert, per = (size_t)skin->nper;
    int *to = cn_array(n, sizeof *to), *start = cn_array((size_t)skin->nanchor + 1, sizeof *start);
    int *anchor = cn_array(n * per, sizeof *anchor);
    double *weight = cn_array(n * per, sizeof *weight), *rest = cn_array(3 * n, sizeof *rest);
    cn_status status = CN_ERR_MEMORY;
    if (!to || !start || !anchor || !weight || !rest) goto done;
    for (size_t v = 0; v < n; v++)
        start[skin->anchor[v * per] + 1]++;
    for (int a = 0; a < skin->nanchor; a++)
        start[a + 1] += start[a];
    for (size_t v = 0; v < n; v++) {
        const size_t r = (size_t)start[skin->anchor[v * per]]++;
        skin->vertex[r] = (int)v;
        memcpy(anchor + r * per, skin->anchor + v * per, per * sizeof *anchor);
        memcpy(weight + r * per, skin->weight + v * per, per * sizeof *weight);
        cn_copy3(skin->rest + 3 * v, rest + 3 * r);
    }
    memcpy(skin->anchor, anchor, n * per * sizeof *anchor);
    memcpy(skin->weight, weight, n * per * sizeof *weight);
    memcpy(skin->rest, rest, 3 * n * sizeof *rest);
    status = CN_OK;
done:
    free(to), free(start), free(anchor), free(weight), free(rest);
    return status;
}

/* The formula of skin.h, times d_1^2 so that nothing overflows; n of them, `next` the square of D, INFINITY
 * where there is none. */
static void weights_of(int n, const double *square, double next, double *weight)
{
    const double nearest = sqrt(square[0]), reach = (1 + TIE) * sqrt(next);
    double sum = 0;
    for (int j = 0; j < n; j++) {
        const double d = sqrt(square[j]);
        const double w = nearest > 0 ? nearest / d * (isfinite(reach) ? (reach - d) / reach : 1) : d == 0;
        weight[j] = w * w;
        sum += weight[j];
    }
    for (int j = 0; j < n; j++)
        weight[j] /= sum;
}

static cn_status check_anchors(int nanchor, const double *place, const double *rotation, int n,
                               cn_error *error)
{
    if (nanchor < 1) return cn_fail(error, CN_ERR_ARG, "", 0, "a skin needs an anchor, and there is none");
    if (n < 1 || n > CN_SKIN_ANCHORS)
        return cn_fail(error, CN_ERR_ARG, "", 0, "a vertex of a skin hangs on 1 to %d anchors, %d are asked",
                       CN_SKIN_ANCHORS, n);
    for (size_t i = 0; i < 3 * (size_t)nanchor; i++)
        if (!isfinite(place[i]))
            return cn_fail(error, CN_ERR_NOT_FINITE, "", 0, "anchor %zu of the skin lies at %g: give metres",
                           i / 3, place[i]);
    for (int i = 0; rotation && i < nanchor; i++) {
        const double *q = rotation + 4 * (size_t)i, square = q[0] * q[0] + cn_norm2(q + 1);
        if (!isfinite(square))
            return cn_fail(error, CN_ERR_NOT_FINITE, "", 0, "the rotation of anchor %d is not finite", i);
        if (!(square > 0))
            return cn_fail(error, CN_ERR_ARG, "", 0,
                           "the rotation of anchor %d is a quaternion of zeros: give a unit one", i);
    }
    return CN_OK;
}

/* Hangs each vertex on its anchors; the one after them sets where their weights end. */
static cn_status hang(cn_skin *skin, const cn_nearest_tree *tree, cn_error *error)
{
    const int n = skin->nper;
    for (int v = 0; v < skin->nvert; v++) {
        int index[CN_SKIN_ANCHORS + 1];
        double square[CN_SKIN_ANCHORS + 1], *weight = skin->weight + (size_t)n * (size_t)v, sum = 0;
        const int found = cn_nearest_find(tree, skin->rest + 3 * (size_t)v, n + 1, index, square);
        weights_of(n, square, found > n ? square[n] : INFINITY, weight);
        memcpy(skin->anchor + (size_t)n * (size_t)v, index, (size_t)n * sizeof *index);
        skin->reach = fmax(skin->reach, sqrt(square[0]));
        for (int j = 0; j < n; j++)
            sum += weight[j];
        if (!isfinite(sum))
            return cn_fail(error, CN_ERR_NOT_FINITE, "", 0,
                           "vertex %d of the skin is too far from its anchors to tell their distances", v);
    }
    return CN_OK;
}

cn_status cn_skin_new(cn_skin **out, const cn_surface *surface, int nanchor, const double *place,
                      const double *rotation, int n, cn_error *error)
{
    cn_skin *skin = NULL;
    cn_nearest_tree *tree = NULL;
    cn_status status;

    *out = NULL;
    if ((status = check_anchors(nanchor, place, rotation, n, error)) != CN_OK) return status;
    if ((status = cn_skin_begin(&skin, surface, nanchor, n < nanchor ? n : nanchor, error)) != CN_OK)
        return status;
    skin->kind = CN_SKIN_BLEND;
    skin->place = cn_array(3 * (size_t)nanchor, sizeof *skin->place);
    skin->rotation = cn_array(9 * (size_t)nanchor, sizeof *skin->rotation);
    status = CN_ERR_MEMORY;
    if (!skin->place || !skin->rotation) goto done;
    for (size_t i = 0; i < (size_t)nanchor; i++) {
        static const double identity[4] = {1, 0, 0, 0};
        double r[9];
        cn_quaternion_matrix(rotation ? rotation + 4 * i : identity, r);
        for (int k = 0; k < 9; k++)
            skin->rotation[9 * i + (size_t)k] = r[k % 3 * 3 + k / 3];
        cn_sub(place + 3 * i, skin->centre, skin->place + 3 * i);
    }
    if ((status = cn_nearest_new(&tree, nanchor, skin->place)) != CN_OK) goto done;
    if ((status = hang(skin, tree, error)) != CN_OK) goto done;
    status = cn_skin_sort(skin);
done:
    cn_nearest_free(tree);
    if (status == CN_OK)
        *out = skin;
    else
        cn_skin_free(skin);
    return status == CN_ERR_MEMORY ? out_of_memory(error) : status;
}

/* --- state --- */
cn_status cn_skin_state_new(cn_skin_state **out, const cn_skin *skin, cn_error *error)
{
    cn_skin_state *state = calloc(1, sizeof *state);
    *out = NULL;
    if (!state) return out_of_memory(error);
    state->x = cn_array(3 * (size_t)skin->nvert, sizeof *state->x);
    state->face = cn_array(4 * (size_t)skin->ntri, sizeof *state->face);
    state->normal = cn_array(3 * (size_t)skin->nvert, sizeof *state->normal);
    state->frame =
        cn_array(skin->kind == CN_SKIN_BLEND ? 16 * (size_t)skin->nanchor : 0, sizeof *state->frame);
    if (!state->x || !state->face || !state->normal || !state->frame) {
        cn_skin_state_free(state);
        return out_of_memory(error);
    }
    *out = state;
    return CN_OK;
}

void cn_skin_state_free(cn_skin_state *state)
{
    if (!state) return;
    free(state->x);
    free(state->face);
    free(state->normal);
    free(state->frame);
    free(state);
}

/* --- update --- */
typedef double v4 __attribute__((vector_size(32), may_alias, aligned(8)));

typedef struct {
    const cn_skin *skin;
    const double *place, *rotation;
    cn_skin_state *state;
} update;

/* Column k of A_j and b_j at frame + 16 j + 4 k. */
static void frames(void *user, int chunk)
{
    const update *job = user;
    const cn_skin *skin = job->skin;
    const int last =
        (chunk + 1) * CN_SKIN_CHUNK < skin->nanchor ? (chunk + 1) * CN_SKIN_CHUNK : skin->nanchor;
    for (size_t j = (size_t)chunk * CN_SKIN_CHUNK; j < (size_t)last; j++) {
        static const double identity[4] = {1, 0, 0, 0};
        double r[9], a[9], shift[3], *out = job->state->frame + 16 * j;
        cn_quaternion_matrix(job->rotation ? job->rotation + 4 * j : identity, r);
        cn_mat_mul(r, skin->rotation + 9 * j, a);
        cn_mat_vec(a, skin->place + 3 * j, shift);
        for (int k = 0; k < 3; k++) {
            out[k] = a[3 * k], out[4 + k] = a[3 * k + 1], out[8 + k] = a[3 * k + 2];
            out[12 + k] = job->place[3 * j + (size_t)k] - shift[k];
        }
    }
}

static inline __attribute__((always_inline)) void blend(const update *job, size_t from, size_t to)
{
    const cn_skin *skin = job->skin;
    const size_t n = (size_t)skin->nper;
    for (size_t r = from; r < to; r++) {
        const double *weight = skin->weight + n * r, *rest = skin->rest + 3 * r;
        const int *anchor = skin->anchor + n * r;
        v4 c0 = {0}, c1 = {0}, c2 = {0}, shift = {0};
        for (size_t j = 0; j < n; j++) {
            const v4 *frame = (const v4 *)(job->state->frame + 16 * (size_t)anchor[j]);
            c0 += weight[j] * frame[0], c1 += weight[j] * frame[1], c2 += weight[j] * frame[2];
            shift += weight[j] * frame[3];
        }
        const v4 x = rest[0] * c0 + rest[1] * c1 + rest[2] * c2 + shift;
        double *out = job->state->x + 3 * (size_t)skin->vertex[r];
        out[0] = x[0], out[1] = x[1], out[2] = x[2];
    }
}

static void blend_base(const update *job, size_t from, size_t to)
{
    blend(job, from, to);
}

#ifdef __x86_64__
static __attribute__((target("avx2"))) void blend_avx2(const update *job, size_t from, size_t to)
{
    blend(job, from, to);
}
#endif

static void embed(const update *job, size_t from, size_t to)
{
    const cn_skin *skin = job->skin;
    const size_t n = (size_t)skin->nper;
    for (size_t r = from; r < to; r++) {
        double *out = job->state->x + 3 * (size_t)skin->vertex[r], x[3] = {0};
        for (size_t j = n * r; j < n * (r + 1); j++)
            cn_axpy(skin->weight[j], job->place + 3 * (size_t)skin->anchor[j], x);
        cn_copy3(x, out);
    }
}

static void place_rows(void *user, int chunk)
{
    const update *job = user;
    const size_t from = (size_t)chunk * CN_SKIN_CHUNK, n = (size_t)job->skin->nvert;
    const size_t to = from + CN_SKIN_CHUNK < n ? from + CN_SKIN_CHUNK : n;
    if (job->skin->kind == CN_SKIN_EMBED) {
        embed(job, from, to);
        return;
    }
#ifdef __x86_64__
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2")) {
        blend_avx2(job, from, to);
        return;
    }
#endif
    blend_base(job, from, to);
}

static bool all_finite(size_t n, const double *values)
{
    double sum = 0; /* x - x is zero for finite numbers alone */
    for (size_t i = 0; i < n; i++)
        sum += values[i] - values[i];
    return sum == 0;
}

cn_status cn_skin_update(const cn_skin *skin, const double *place, const double *rotation,
                         cn_skin_state *state, cn_pool *pool)
{
    update job = {skin, place, rotation, state};
    if (!all_finite(3 * (size_t)skin->nanchor, place)) return CN_ERR_NOT_FINITE;
    if (skin->kind == CN_SKIN_BLEND) {
        cn_pool_run(pool, (skin->nanchor + CN_SKIN_CHUNK - 1) / CN_SKIN_CHUNK, frames, &job);
        if (!all_finite(16 * (size_t)skin->nanchor, state->frame)) return CN_ERR_NOT_FINITE;
    }
    cn_pool_run(pool, (skin->nvert + CN_SKIN_CHUNK - 1) / CN_SKIN_CHUNK, place_rows, &job);
    cn_skin_normals(skin, state, pool);
    return CN_OK;
}

/* --- the way back --- */
void cn_skin_pull(const cn_skin *skin, const cn_skin_state *state, const double *place, const double *force,
                  double *to, double *moment)
{
    const size_t n = (size_t)skin->nper;
    for (size_t r = 0; r < (size_t)skin->nvert; r++) {
        const double *f = force + 3 * (size_t)skin->vertex[r], *rest = skin->rest + 3 * r;
        if (f[0] == 0 && f[1] == 0 && f[2] == 0) continue;
        for (size_t i = n * r; i < n * (r + 1); i++) {
            const size_t j = (size_t)skin->anchor[i];
            cn_axpy(skin->weight[i], f, to + 3 * j);
            if (!moment || skin->kind == CN_SKIN_EMBED) continue;
            const double *frame = state->frame + 16 * j;
            double arm[3], m[3]; /* R_j r_j = A_j X + b_j - p_j */
            for (int k = 0; k < 3; k++)
                arm[k] = rest[0] * frame[k] + rest[1] * frame[4 + k] + rest[2] * frame[8 + k] +
                         (frame[12 + k] - place[3 * j + (size_t)k]);
            cn_cross(arm, f, m);
            cn_axpy(skin->weight[i], m, moment + 3 * j);
        }
    }
}
