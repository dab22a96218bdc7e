/* molecules_points.c - the surface's vertices on molecules: each is an affine combination of four near ones
 * that span space, p = sum_k w_k x_k with sum w_k = 1, so that every affine motion carries it exactly. Of all
 * fours among the nearest ten, that with the least sum |w_k| |x_k - p|^2 (equal ones: the first): what a
 * quadratic motion can put wrong is bounded by it, and weights stay small. */
#include "molecules.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

enum { NEAREST = 10, NEAREST_MOST = 40 };
static const double FLAT = 0.02; /* least volume of four, of the product of the edges at one */

typedef struct {
    int index;
    double distance;
} candidate;

static int by_distance(const void *a, const void *b)
{
    const candidate *p = a, *q = b;
    if (p->distance != q->distance) return p->distance < q->distance ? -1 : 1;
    return (p->index > q->index) - (p->index < q->index);
}

typedef struct {
    const cn_tree *tree;
    int n, room, *found; /* n: of molecules */
    candidate *near;     /* (room) */
    double spacing;
} search;

/* The molecules nearest to p, sorted, at least `want` of them or all; a negative number: out of memory. */
static int find_near(search *s, const double *place, const double p[3], int want)
{
    double reach = s->spacing, nearest[3];
    int i, n = 0;
    reach += cn_tree_nearest(s->tree, p, INFINITY, &i, nearest);
    for (;; reach *= 1.5) {
        const double min[3] = {p[0] - reach, p[1] - reach, p[2] - reach},
                     max[3] = {p[0] + reach, p[1] + reach, p[2] + reach};
        int kept = 0;
        while ((n = cn_tree_query_box(s->tree, min, max, s->room, s->found)) > s->room) {
            free(s->found), free(s->near);
            s->found = malloc((size_t)n * sizeof *s->found), s->near = malloc((size_t)n * sizeof *s->near);
            if (!s->found || !s->near) return -1;
            s->room = n;
        }
        for (int f = 0; f < n; f++) {
            const candidate c = {s->found[f], cn_distance(place + 3 * (size_t)s->found[f], p)};
            if (c.distance <= reach || n == s->n) s->near[kept++] = c;
        }
        if (kept < want && n < s->n) continue;
        qsort(s->near, (size_t)kept, sizeof *s->near, by_distance);
        return kept;
    }
}

/* Weights of p in four points; false where they are as good as flat. */
static bool weights_in(const double *const x[4], const double p[3], double w[4])
{
    double e[3][3], u[3], n[3];
    for (int k = 0; k < 3; k++)
        cn_sub(x[k + 1], x[0], e[k]);
    cn_sub(p, x[0], u);
    cn_cross(e[1], e[2], n);
    const double six = cn_dot(e[0], n);
    if (!(fabs(six) > FLAT * cn_norm(e[0]) * cn_norm(e[1]) * cn_norm(e[2]))) return false;
    w[1] = cn_dot(u, n) / six;
    cn_cross(e[2], e[0], n);
    w[2] = cn_dot(u, n) / six;
    cn_cross(e[0], e[1], n);
    w[3] = cn_dot(u, n) / six;
    w[0] = 1 - (w[1] + w[2] + w[3]);
    return true;
}

/* The best four of n candidates; false: no four span space. */
static bool best_four(const double *place, const candidate *near, int n, const double p[3], int *anchor,
                      double *weight)
{
    double least = INFINITY;
    int at[4];
    for (at[0] = 0; at[0] < n; at[0]++)
        for (at[1] = at[0] + 1; at[1] < n; at[1]++)
            for (at[2] = at[1] + 1; at[2] < n; at[2]++)
                for (at[3] = at[2] + 1; at[3] < n; at[3]++) {
                    const double *x[4];
                    double w[4], cost = 0;
                    for (int k = 0; k < 4; k++)
                        x[k] = place + 3 * (size_t)near[at[k]].index;
                    if (!weights_in(x, p, w)) continue;
                    for (int k = 0; k < 4; k++)
                        cost += fabs(w[k]) * near[at[k]].distance * near[at[k]].distance;
                    if (!(cost < least * (1 - 1e-9))) continue; /* rounding decides nothing */
                    least = cost;
                    for (int k = 0; k < 4; k++)
                        anchor[k] = near[at[k]].index, weight[k] = w[k];
                }
    return least < INFINITY;
}

enum { A = CN_MOLECULE_ANCHORS };

cn_status cn_molecules_hang(int nnode, const double *rest, double spacing, int npoint, const double *point,
                            int *anchor, double *weight, cn_error *error)
{
    search s = {.n = nnode, .room = 256, .spacing = spacing};
    cn_tree *tree = NULL;
    int *corner = NULL;
    cn_status status = cn_point_tree_new(&tree, &corner, nnode, rest);
    if (status != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    s.tree = tree;
    s.found = malloc((size_t)s.room * sizeof *s.found), s.near = malloc((size_t)s.room * sizeof *s.near);
    if (!s.found || !s.near) goto done;
    for (int i = 0; i < npoint; i++, anchor += A, weight += A) {
        const double *p = point + 3 * (size_t)i;
        bool found = false;
        for (int want = NEAREST; !found && want <= NEAREST_MOST; want *= 2) {
            const int n = find_near(&s, rest, p, want);
            if (n < 0) goto done;
            found = best_four(rest, s.near, n < want ? n : want, p, anchor, weight);
        }
        if (!found) {
            status =
                cn_fail(error, CN_FAULT_UNIT, "", 0,
                        "the molecules nearest to the surface's vertex %d at (%.4g, %.4g, %.4g) lie in a "
                        "plane, which cannot carry it: take a smaller radius, so that two layers fit",
                        i, p[0], p[1], p[2]);
            goto done;
        }
    }
    status = CN_OK;
done:
    cn_tree_free(tree);
    free(corner), free(s.found), free(s.near);
    return status;
}

cn_status cn_molecules_anchor(cn_body *body, double spacing, cn_error *error)
{
    body->anchor = calloc((size_t)body->npoint + 1, A * sizeof *body->anchor);
    body->weight = calloc((size_t)body->npoint + 1, A * sizeof *body->weight);
    if (!body->anchor || !body->weight) return CN_ERR_MEMORY;
    body->nanchor = A;
    return cn_molecules_hang(body->nnode, body->rest, spacing, body->npoint, body->point, body->anchor,
                             body->weight, error);
}

void cn_molecules_points(const cn_body *body, int nactive, const double *x, const double *rotation,
                         double *points)
{
    (void)nactive, (void)rotation;
    for (size_t i = 0; i < (size_t)body->npoint; i++) {
        const int *anchor = body->anchor + A * i;
        const double *w = body->weight + A * i, *p[A];
        for (int k = 0; k < A; k++)
            p[k] = x + 3 * (size_t)anchor[k];
        for (int c = 0; c < 3; c++) /* from the nearest on, to round less */
            points[3 * i + (size_t)c] = p[0][c] + w[1] * (p[1][c] - p[0][c]) + w[2] * (p[2][c] - p[0][c]) +
                                        w[3] * (p[3][c] - p[0][c]);
    }
}

void cn_molecules_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                       const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a)
{
    (void)nactive, (void)x, (void)rotation, (void)scale, (void)a;
    for (size_t i = 0; i < (size_t)body->npoint; i++) {
        const double *g = force + 3 * i;
        if (g[0] == 0 && g[1] == 0 && g[2] == 0) continue;
        for (int k = 0; k < carry->nper; k++) {
            const size_t at = (size_t)carry->nper * i + (size_t)k;
            cn_axpy(carry->weight[at], g, f + 3 * (size_t)carry->anchor[at]);
        }
    }
}
