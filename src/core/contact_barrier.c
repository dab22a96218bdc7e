/* contact_barrier.c - barrier energy, force and stiffness of the listed pairs.
 *
 * The four points of a pair count with weights w of sum 0: r = sum w_i x_i points from the second side to the
 * first, and d = |r|. */
#include "contact_parts.h"

#include <math.h>
#include <stddef.h>
#include "geometry.h"

/* Where two primitives are nearest. */
typedef struct {
    double distance, direction[3]; /* r / d; d distance / d point i = weight[i] * direction */
    double weight[4];
    double bary[3];  /* of the triangle's nearest point, nodes against triangles only */
    double where[3]; /* nearest point of the second side */
    cn_slide slide;
} nearest;

/* Notes a free parameter that takes weight from point i to point j. */
static void slides(nearest *out, const double q[4][3], int i, int j, double sign)
{
    double *weight = out->slide.weight[out->slide.n], *along = out->slide.along[out->slide.n++];
    weight[0] = weight[1] = weight[2] = weight[3] = 0;
    weight[i] = -sign, weight[j] = sign;
    for (int k = 0; k < 3; k++)
        along[k] = sign * (q[j][k] - q[i][k]);
}

/* Parameters within a triangle: none at a corner, one on an edge, two inside. */
static void nearest_of(const cn_pair *pair, const double *x, nearest *out)
{
    double q[4][3], r[3] = {0, 0, 0}, *w = out->weight, s, t;
    const int second = cn_pair_nside(pair);
    for (int i = 0; i < 4; i++)
        cn_copy3(x + 3 * (size_t)pair->p[i], q[i]);
    const double(*const points)[3] = (const double(*)[3])q;
    out->slide.n = 0;
    if (pair->kind == CN_PAIR_NODE_TRIANGLE) {
        int in[3], n = 0;
        out->distance = cn_point_triangle(q[0], q[1], q[2], q[3], out->bary);
        w[0] = 1;
        for (int k = 0; k < 3; k++) {
            w[1 + k] = -out->bary[k];
            if (out->bary[k] > 0) in[n++] = 1 + k;
        }
        for (int j = 1; j < n; j++)
            slides(out, points, in[0], in[j], -1);
    } else {
        out->distance = cn_edge_edge(q[0], q[1], q[2], q[3], &s, &t);
        w[0] = 1 - s, w[1] = s, w[2] = -(1 - t), w[3] = -t;
        if (s > 0 && s < 1) slides(out, points, 0, 1, 1);
        if (t > 0 && t < 1) slides(out, points, 2, 3, -1);
    }
    out->where[0] = out->where[1] = out->where[2] = 0;
    for (int i = second; i < 4; i++)
        cn_axpy(-w[i], q[i], out->where);
    for (int i = 0; i < second; i++)
        cn_axpy(w[i], q[i], r);
    cn_sub(r, out->where, out->direction);
    cn_normalise(out->direction);
}

/* True where the neighbours across a flat edge or corner of a wall answer for this pair: the node lies over
 * one of them, or right above the edge and another triangle counts for it. So a flat wall pushes along its
 * normal however it is cut into triangles. Right above: within a band that is far wider than rounding and the
 * same on both sides of the edge. */
static bool passed_over(const cn_contact_model *model, const cn_pair *pair, const double *x,
                        const nearest *at)
{
    if (pair->kind != CN_PAIR_NODE_TRIANGLE) return false;
    const cn_collider *wall = model->surface[pair->surface[1]].collider;
    if (!wall->flat || !wall->flat[pair->triangle]) return false;
    double q[3][3], e[3][3], normal[3], across[3]; /* edge k is opposite to corner k */
    int count = 0, bit = 0, corner = 0;
    cn_corners(pair->p + 1, x, q);
    for (int k = 0; k < 3; k++)
        cn_sub(q[(k + 2) % 3], q[(k + 1) % 3], e[k]);
    cn_cross(e[2], e[0], normal);
    const double area = cn_normalise(normal), band = 1e-12;
    double length = 0;
    for (int k = 0; k < 3; k++) {
        const double square = cn_norm2(e[k]);
        if (at->bary[k] * area > band * square) {
            corner = 1 << k;
            continue;
        }
        count++, bit = 8 << (k + 1) % 3, length = fmax(length, sqrt(square));
    }
    if (count == 2) bit = corner;
    if (count == 0 || !(wall->flat[pair->triangle] & bit)) return false;
    /* from the nearest point to the node, less what is along the normal */
    cn_sub(x + 3 * (size_t)pair->p[0], q[0], across);
    cn_axpy(-at->bary[1], e[2], across), cn_axpy(at->bary[2], e[1], across);
    cn_axpy(-cn_dot(across, normal), normal, across);
    return cn_norm(across) > band * length || !(wall->above[pair->triangle] & bit);
}

/* The products of the sliding directions, inverted; parallel edges slide nowhere: the mollifier's ground. */
static void invert_slide(cn_slide *slide)
{
    double(*inverse)[2] = slide->inverse;
    const double g11 = slide->n > 0 ? cn_norm2(slide->along[0]) : 0;
    if (slide->n == 1) inverse[0][0] = 1 / g11;
    if (slide->n < 2) return;
    const double g12 = cn_dot(slide->along[0], slide->along[1]), g22 = cn_norm2(slide->along[1]);
    const double det = g11 * g22 - g12 * g12;
    if (!(det > 1e-12 * g11 * g22)) {
        slide->n = 0;
        return;
    }
    inverse[0][0] = g22 / det, inverse[1][1] = g11 / det, inverse[0][1] = inverse[1][0] = -g12 / det;
}

/* Stiffness of a pair: (stretch - bend) n n' + bend (second derivative of d^2/2), the latter by the nearest
 * points sliding so that d stays least: D_xx - D_xt D_tt^-1 D_tx over the sliding parameters t. */
void cn_link_multiply(const cn_link *link, const double v[4][3], double f[4][3])
{
    const cn_slide *slide = &link->slide;
    double r[3] = {0, 0, 0}, held[2] = {0, 0};
    for (int i = 0; i < 4; i++)
        cn_axpy(link->w[i], v[i], r);
    const double along = (link->k - link->bend) * cn_dot(link->n, r);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            f[i][k] = link->w[i] * (along * link->n[k] + link->bend * r[k]);
    if (link->bend == 0) return;
    for (int q = 0; q < slide->n; q++) {
        double by = cn_dot(slide->along[q], r);
        for (int i = 0; i < 4; i++)
            by += slide->weight[q][i] * link->distance * cn_dot(link->n, v[i]);
        for (int p = 0; p < slide->n; p++)
            held[p] += link->bend * slide->inverse[p][q] * by;
    }
    for (int p = 0; p < slide->n; p++)
        for (int i = 0; i < 4; i++) {
            cn_axpy(-held[p] * link->w[i], slide->along[p], f[i]);
            cn_axpy(-held[p] * slide->weight[p][i] * link->distance, link->n, f[i]);
        }
}

/* Its block by points k and l. */
static void link_block(const cn_link *link, int k, int l, double h[9])
{
    const cn_slide *slide = &link->slide;
    const double s = link->w[k] * link->w[l];
    for (int i = 0; i < 9; i++)
        h[i] = s * ((link->k - link->bend) * link->n[i / 3] * link->n[i % 3] + (i % 4 == 0 ? link->bend : 0));
    if (link->bend == 0) return;
    for (int p = 0; p < slide->n; p++)
        for (int q = 0; q < slide->n; q++)
            for (int i = 0; i < 9; i++)
                h[i] -= link->bend * slide->inverse[p][q] *
                        (link->w[k] * slide->along[p][i / 3] +
                         slide->weight[p][k] * link->distance * link->n[i / 3]) *
                        (link->w[l] * slide->along[q][i % 3] +
                         slide->weight[q][l] * link->distance * link->n[i % 3]);
}

/* m(c) of near-parallel edges, c = |ea x eb|^2; its derivative by ea and eb in dm, by c in slope. */
static double mollifier(const cn_pair *pair, const double *x, double dm[2][3], double *slope)
{
    double e[2][3], n[3];
    *slope = 0;
    for (int k = 0; k < 6; k++)
        dm[k / 3][k % 3] = 0;
    if (pair->kind != CN_PAIR_EDGES) return 1;
    for (int i = 0; i < 2; i++)
        cn_sub(x + 3 * (size_t)pair->p[2 * i + 1], x + 3 * (size_t)pair->p[2 * i], e[i]);
    cn_cross(e[0], e[1], n);
    const double c = cn_norm2(n), most = pair->mollify;
    if (c >= most) return 1;
    *slope = 2 / most * (1 - c / most);
    const double both = cn_dot(e[0], e[1]);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            dm[i][k] = *slope * 2 * (cn_norm2(e[1 - i]) * e[i][k] - both * e[1 - i][k]);
    return c / most * (2 - c / most);
}

/* b, b', b'' of -(d - g)^2 ln(d / g). */
static void barrier(double d, double g, double *b, double *b1, double *b2)
{
    const double l = log(d / g), h = d - g;
    *b = -h * h * l;
    *b1 = -2 * h * l - h * h / d;
    *b2 = -2 * l - 4 * h / d + h * h / (d * d);
}

static void add_block(cn_matrix *a, int i, int j, const double h[9])
{
    double *block = a->value + 9 * (size_t)cn_matrix_find(a, i, j);
    for (int k = 0; k < 9; k++)
        block[k] += h[k];
}

void cn_contact_stiffen(const cn_hang *hang, int i, int j, const double h[9])
{
    const cn_carry *carry = hang->carry;
    if (!carry) {
        add_block(hang->matrix, i, j, h);
        return;
    }
    const double *arm_i = carry->arm + 9 * (size_t)i, *arm_j = carry->arm + 9 * (size_t)j;
    const int p = carry->node[i], q = carry->node[j], turn = carry->turn;
    double right[9], left[9], both[9], turned[9]; /* arm_i' */
    for (int k = 0; k < 9; k++)
        turned[k] = arm_i[3 * (k % 3) + k / 3];
    cn_mat_mul(h, arm_j, right);
    cn_mat_mul(turned, h, left);
    cn_mat_mul(turned, right, both);
    add_block(hang->matrix, p, q, h);
    add_block(hang->matrix, p, turn + q, right);
    add_block(hang->matrix, turn + p, q, left);
    add_block(hang->matrix, turn + p, turn + q, both);
}

void cn_contact_join(const cn_contact_model *model, cn_contact *contact, const cn_link *joined,
                     const cn_hang *hang)
{
    cn_link link = *joined;
    bool gives[2];
    for (int k = 0; k < 2; k++) {
        gives[k] = hang[link.surface[k]].matrix;
        link.own[k] = gives[k] && !hang[link.surface[k]].linked &&
                      !(hang[link.surface[1 - k]].matrix &&
                        hang[link.surface[k]].rank > hang[link.surface[1 - k]].rank);
    }
    const bool whole = gives[0] != gives[1] && (link.own[0] || link.own[1]);
    if (!whole && (gives[0] || gives[1])) contact->link[contact->nlink++] = link;
    if (!whole) link.bend = 0;
    for (int k = 0; k < 4; k++)
        for (int l = k < link.nside ? 0 : link.nside; l < (k < link.nside ? link.nside : 4); l++) {
            const int side = k >= link.nside, first = model->surface[link.surface[side]].first;
            double h[9];
            if (!link.own[side]) break;
            link_block(&link, k, l, h);
            cn_contact_stiffen(&hang[link.surface[side]], link.p[k] - first, link.p[l] - first, h);
        }
}

static void add_pair_stiffness(const cn_contact_model *model, cn_contact *contact, const cn_pair *pair,
                               const nearest *at, double stretch, double bend, const cn_hang *hang)
{
    cn_link link = {.nside = cn_pair_nside(pair),
                    .k = stretch,
                    .bend = bend,
                    .distance = at->distance,
                    .slide = at->slide};
    cn_copy3(at->direction, link.n);
    memcpy(link.surface, pair->surface, sizeof link.surface);
    memcpy(link.p, pair->p, sizeof link.p), memcpy(link.w, at->weight, sizeof link.w);
    if (bend != 0) invert_slide(&link.slide);
    cn_contact_join(model, contact, &link, hang);
}

/* What the mollifier adds: as edges a and b part from parallel, c = |a x b|^2 grows with both turnings across
 * them, and the energy kappa b m(c) with it. The Gauss-Newton part, 2 kappa b m' |d(a x b)|^2. */
static void add_mollifier_stiffness(const cn_contact_model *model, cn_contact *contact, const cn_pair *pair,
                                    const double *x, double slope, const cn_hang *hang)
{
    cn_link link = {.nside = 2, .k = 2 * slope};
    double e[2][3], along[3], across[3];
    for (int i = 0; i < 2; i++)
        cn_sub(x + 3 * (size_t)pair->p[2 * i + 1], x + 3 * (size_t)pair->p[2 * i], e[i]);
    const double a = cn_norm(e[0]), b = cn_dot(e[0], e[1]) < 0 ? -cn_norm(e[1]) : cn_norm(e[1]);
    const double w[4] = {-b, b, a, -a};
    memcpy(link.surface, pair->surface, sizeof link.surface);
    memcpy(link.p, pair->p, sizeof link.p), memcpy(link.w, w, sizeof link.w);
    cn_copy3(e[0], along);
    cn_normalise(along);
    cn_any_normal(along, link.n);
    cn_cross(along, link.n, across);
    cn_contact_join(model, contact, &link, hang);
    cn_copy3(across, link.n);
    cn_contact_join(model, contact, &link, hang);
}

double cn_contact_add(const cn_contact_model *model, cn_contact *contact, const double *x, double *f,
                      const cn_hang *hang, bool exact, cn_pool *pool)
{
    double energy = 0;
    cn_contact_measure(model, contact, x, false, pool);
    if (hang) contact->nlink = 0;
    for (int i = 0; i < contact->npair; i++) {
        const cn_pair *pair = &contact->pair[i];
        if (!(contact->distance[i] > 0)) return INFINITY;
        if (!(contact->distance[i] < pair->gap)) continue;
        const int n = cn_pair_nside(pair);
        double b, b1, b2, dm[2][3], slope;
        nearest at;
        nearest_of(pair, x, &at);
        if (passed_over(model, pair, x, &at)) continue;
        barrier(at.distance, pair->gap, &b, &b1, &b2);
        const double m = mollifier(pair, x, dm, &slope), kappa = pair->kappa;
        energy += kappa * m * b;
        for (int k = 0; f && k < 4; k++) {
            double *force = f + 3 * (size_t)pair->p[k];
            if (!model->surface[pair->surface[k >= n]].body) continue;
            cn_axpy(-kappa * m * b1 * at.weight[k], at.direction, force);
            if (pair->kind == CN_PAIR_EDGES) cn_axpy((k % 2 ? -1 : 1) * kappa * b, dm[k / 2], force);
        }
        if (hang)
            add_pair_stiffness(model, contact, pair, &at, kappa * m * b2,
                               exact ? kappa * m * b1 / at.distance : 0, hang);
        if (hang && slope > 0) add_mollifier_stiffness(model, contact, pair, x, kappa * b * slope, hang);
    }
    return energy;
}

bool cn_pair_press(const cn_contact_model *model, const cn_pair *pair, const double *x, double w[4],
                   double n[3], double *force)
{
    double b, b1, b2, dm[2][3], slope;
    nearest at;
    nearest_of(pair, x, &at);
    if (!(at.distance > 0) || !(at.distance < pair->gap) || passed_over(model, pair, x, &at)) return false;
    barrier(at.distance, pair->gap, &b, &b1, &b2);
    memcpy(w, at.weight, sizeof at.weight);
    cn_copy3(at.direction, n);
    *force = -pair->kappa * mollifier(pair, x, dm, &slope) * b1;
    return true;
}

/* --- what pushes on a surface --- */

static int root_of(int *parent, int i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

double cn_contact_patch_force(const cn_contact_model *model, cn_contact *contact, int surface,
                              const double *x, double where[3], int *other)
{
    double largest = 0;
    where[0] = where[1] = where[2] = NAN;
    *other = -1;
    /* clear; join the other side's points of each touching pair; sum forces; find the largest */
    for (int round = 0; round < 4; round++)
        for (int i = 0; i < contact->npair; i++) {
            const cn_pair *pair = &contact->pair[i];
            if (!(contact->distance[i] < pair->gap)) continue;
            if (pair->surface[0] != surface && pair->surface[1] != surface) continue;
            const int n = cn_pair_nside(pair), far = pair->surface[0] == surface ? 1 : 0;
            const int begin = far ? n : 0, end = far ? 4 : n, *p = pair->p;
            if (round == 0) {
                for (int k = begin; k < end; k++) {
                    contact->patch[p[k]] = p[k];
                    memset(contact->patch_force + 6 * (size_t)p[k], 0, 6 * sizeof(double));
                }
                continue;
            }
            if (round == 1) {
                for (int k = begin + 1; k < end; k++)
                    contact->patch[root_of(contact->patch, p[k])] = root_of(contact->patch, p[begin]);
                continue;
            }
            double *force = contact->patch_force + 6 * (size_t)root_of(contact->patch, p[begin]);
            if (round == 2) {
                double b, b1, b2, dm[2][3], slope, *at_far = force + 3;
                nearest at;
                nearest_of(pair, x, &at);
                if (passed_over(model, pair, x, &at)) continue;
                barrier(at.distance, pair->gap, &b, &b1, &b2);
                cn_axpy((far ? -1 : 1) * pair->kappa * mollifier(pair, x, dm, &slope) * b1, at.direction,
                        force);
                cn_copy3(at.where, at_far);
                if (!far) cn_axpy(at.distance, at.direction, at_far);
            } else if (cn_norm(force) > largest) {
                largest = cn_norm(force), cn_copy3(force + 3, where), *other = pair->surface[far];
            }
        }
    return largest;
}
