/* skin_touch.c - a skin as what contact meets of its body: points on several nodes each.
 *
 * EMBED: p = sum_k w_k x_k. On a rod's frames p = sum_k w_k (x_k + R_k o_k), o_k in the frame, so that with
 * R' = [T theta']x R
 *     dp = sum_k w_k (dx_k + (T_k dtheta_k) x (R_k o_k)).
 * On nodes without rotations of their own a blended skin has them from the nodes around: it is put where they
 * have it, and taken to move by sum_k w_k dx_k from there. */
#include "skin_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "body_methods.h"
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "rod.h"

typedef struct {
    const cn_body *on;
    const cn_skin *skin;
    double *offset;       /* a rod: o_k, else NULL (npoint x nanchor x 3) */
    int *place;           /* BLEND on other nodes: point of a vertex, else NULL (npoint) */
    cn_skin_state *state; /* and scratch */
    double *turn;         /* (nnode x 4) */
} touching;

static void points_of_rod(const cn_body *body, int nactive, const double *x, const double *rotation,
                          double *points)
{
    const touching *t = body->own;
    const int npoint = cn_body_points_of(body, nactive), n = body->nanchor;
    memset(points, 0, 3 * (size_t)npoint * sizeof *points);
    for (int p = 0; p < npoint; p++)
        for (size_t at = (size_t)n * (size_t)p; at < (size_t)n * (size_t)(p + 1); at++) {
            double r[9], turn[9], arm[3];
            cn_rod_frame(t->on, body->anchor[at], x, rotation, r, turn);
            cn_mat_vec(r, t->offset + 3 * at, arm);
            cn_axpy(body->weight[at], x + 3 * (size_t)body->anchor[at], points + 3 * (size_t)p);
            cn_axpy(body->weight[at], arm, points + 3 * (size_t)p);
        }
}

static void touch_points(const cn_body *body, int nactive, const double *x, const double *rotation,
                         double *points)
{
    const touching *t = body->own;
    const int npoint = cn_body_points_of(body, nactive), n = body->nanchor;
    if (t->offset) {
        points_of_rod(body, nactive, x, rotation, points);
    } else if (t->place) {
        cn_skin_rotations(t->on, x, rotation, t->turn, NULL);
        const bool there = cn_skin_update(t->skin, x, t->turn, t->state, NULL) == CN_OK;
        for (int v = 0; v < body->npoint; v++)
            for (int k = 0; k < 3; k++)
                points[3 * t->place[v] + k] = there ? t->state->x[3 * v + k] : NAN;
    } else {
        memset(points, 0, 3 * (size_t)npoint * sizeof *points);
        for (int p = 0; p < npoint; p++)
            for (size_t at = (size_t)n * (size_t)p; at < (size_t)n * (size_t)(p + 1); at++)
                cn_axpy(body->weight[at], x + 3 * (size_t)body->anchor[at], points + 3 * (size_t)p);
    }
}

static void touch_carry(const cn_body *body, int nactive, const double *x, const double *rotation,
                        cn_carry *carry)
{
    const touching *t = body->own;
    const int npoint = cn_body_points_of(body, nactive), n = body->nanchor;
    for (int p = 0; carry->arm && p < npoint; p++)
        for (size_t at = (size_t)n * (size_t)p; at < (size_t)n * (size_t)(p + 1); at++) {
            double r[9], turn[9], arm[3], column[3], *out = carry->arm + 9 * at;
            cn_rod_frame(t->on, body->anchor[at], x, rotation, r, turn);
            cn_mat_vec(r, t->offset + 3 * at, arm);
            for (int k = 0; k < 3; k++) {
                const double axis[3] = {turn[k], turn[3 + k], turn[6 + k]};
                cn_cross(axis, arm, column);
                for (int i = 0; i < 3; i++)
                    out[3 * i + k] = body->weight[at] * column[i];
            }
        }
}

static void touch_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                       const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a)
{
    const int npoint = cn_body_points_of(body, nactive), n = body->nanchor;
    (void)x, (void)rotation, (void)scale, (void)a;
    for (int p = 0; p < npoint; p++) {
        const double *g = force + 3 * (size_t)p;
        if (g[0] == 0 && g[1] == 0 && g[2] == 0) continue;
        for (size_t at = (size_t)n * (size_t)p; at < (size_t)n * (size_t)(p + 1); at++) {
            double moment[3];
            cn_axpy(carry->weight[at], g, f + 3 * (size_t)carry->anchor[at]);
            if (!carry->arm) continue;
            cn_mat_vec_transposed(carry->arm + 9 * at, g, moment);
            cn_axpy(1, moment, f + 3 * (size_t)(carry->turn + carry->anchor[at]));
        }
    }
}

static void touch_free(cn_body *body)
{
    touching *t = body->own;
    if (!t) return;
    cn_skin_state_free(t->state);
    free(t->offset), free(t->place), free(t->turn);
    free(t);
}

static const cn_body_methods methods = {
    .points = touch_points, .carry = touch_carry, .pull = touch_pull, .free_own = touch_free};

/* Vertices in the order of their last anchors, so that those of the leading nodes lead; *place (nvert) says
 * where each went. row (nvert): of each vertex. */
static cn_status order(cn_body *body, const cn_skin *skin, int **place, int *row)
{
    const int n = skin->nper;
    int *last = cn_array((size_t)skin->nvert, sizeof *last);
    body->upto = cn_array((size_t)body->nnode + 2, sizeof *body->upto);
    *place = cn_array((size_t)skin->nvert, sizeof **place);
    if (!last || !*place || !body->upto) {
        free(last);
        return CN_ERR_MEMORY;
    }
    for (int r = 0; r < skin->nvert; r++) {
        int *most = last + skin->vertex[r];
        row[skin->vertex[r]] = r;
        for (int k = n * r; k < n * (r + 1); k++)
            *most = skin->anchor[k] > *most ? skin->anchor[k] : *most;
    }
    for (int v = 0; v < skin->nvert; v++)
        body->upto[last[v] + 2]++;
    for (int i = 0; i <= body->nnode; i++)
        body->upto[i + 1] += body->upto[i];
    for (int v = 0; v < skin->nvert; v++)
        (*place)[v] = body->upto[last[v] + 1]++; /* leaves each count at its node's end */
    free(last);
    return CN_OK;
}

static cn_status take(cn_body *body, touching *t, const int *place, const int *row)
{
    const cn_skin *skin = t->skin;
    const size_t nvert = (size_t)skin->nvert, n = (size_t)skin->nper;
    cn_status status = cn_surface_new(&body->boundary, 0, skin->ntri);
    if (status != CN_OK) return status;
    free(body->boundary->vert);
    body->boundary->vert = NULL, body->boundary->nvert = skin->nvert;
    body->point = cn_array(3 * nvert, sizeof *body->point);
    body->anchor = cn_array(nvert * n, sizeof *body->anchor);
    body->weight = cn_array(nvert * n, sizeof *body->weight);
    if (t->on->model == CN_BODY_ROD) t->offset = cn_array(3 * nvert * n, sizeof *t->offset);
    if (!body->point || !body->anchor || !body->weight || (t->on->model == CN_BODY_ROD && !t->offset))
        return CN_ERR_MEMORY;
    for (int c = 0; c < 3 * skin->ntri; c++)
        body->boundary->tri[c] = place[skin->tri[c]];
    for (size_t v = 0; v < nvert; v++) {
        const size_t to = (size_t)place[v], r = (size_t)row[v];
        cn_add(skin->rest + 3 * r, skin->centre, body->point + 3 * to);
        memcpy(body->anchor + n * to, skin->anchor + n * r, n * sizeof *body->anchor);
        memcpy(body->weight + n * to, skin->weight + n * r, n * sizeof *body->weight);
        for (size_t k = 0; t->offset && k < n; k++) {
            const size_t j = (size_t)skin->anchor[n * r + k];
            double arm[3];
            cn_sub(skin->rest + 3 * r, skin->place + 3 * j, arm);
            cn_mat_vec(skin->rotation + 9 * j, arm, t->offset + 3 * (n * to + k));
        }
    }
    return CN_OK;
}

/* Triangles around vertex a that run from a to b. */
static int runs(const cn_skin *skin, int a, int b)
{
    int n = 0;
    for (int i = skin->first[a]; i < skin->first[a + 1]; i++) {
        const int *t = skin->tri + 3 * (size_t)skin->around[i];
        for (int k = 0; k < 3; k++)
            n += t[k] == a && t[(k + 1) % 3] == b;
    }
    return n;
}

/* The volume within, 0 where edges are open: such a skin holds nothing. */
static double volume_of(const cn_skin *skin, const cn_body *body)
{
    double volume = 0;
    for (int t = 0; t < skin->ntri; t++) {
        double e[3][3], across[3];
        for (int k = 0; k < 3; k++) {
            const int a = skin->tri[3 * t + k], b = skin->tri[3 * t + (k + 1) % 3];
            if (runs(skin, a, b) != 1 || runs(skin, b, a) != 1) return 0;
            cn_sub(body->point + 3 * (size_t)body->boundary->tri[3 * t + k], skin->centre, e[k]);
        }
        cn_cross(e[0], e[1], across);
        volume += cn_dot(across, e[2]) / 6;
    }
    return volume > 0 ? volume : 0;
}

bool cn_skin_moves_by_weights(const cn_skin *skin, const cn_body *on)
{
    return skin->kind == CN_SKIN_EMBED || on->model == CN_BODY_ROD;
}

cn_status cn_skin_touch(cn_body **out, const cn_skin *skin, const cn_body *on)
{
    cn_body *body = calloc(1, sizeof *body);
    touching *t = calloc(1, sizeof *t);
    int *place = NULL, *row = cn_array((size_t)skin->nvert, sizeof *row);
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!body || !t || !row) {
        free(body), free(t), free(row);
        return status;
    }
    *t = (touching){.on = on, .skin = skin};
    *body = (cn_body){.model = on->model,
                      .nnode = on->nnode,
                      .nblock = on->nblock,
                      .nturn = on->nturn,
                      .lever = on->lever,
                      .npoint = skin->nvert,
                      .nanchor = skin->nper,
                      .methods = &methods,
                      .own = t};
    if ((status = order(body, skin, &place, row)) != CN_OK) goto done;
    if ((status = take(body, t, place, row)) != CN_OK) goto done;
    body->rest_volume = volume_of(skin, body);
    if (cn_skin_moves_by_weights(skin, on)) goto done;
    t->place = place, place = NULL;
    status = CN_ERR_MEMORY;
    if (!(t->turn = cn_array(4 * ((size_t)on->nnode + 1), sizeof *t->turn))) goto done;
    status = cn_skin_state_new(&t->state, skin, NULL);
done:
    free(place), free(row);
    if (status == CN_OK)
        *out = body;
    else
        cn_body_free(body);
    return status;
}
