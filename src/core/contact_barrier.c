/* contact_barrier.c - barrier energy, force and stiffness of the listed pairs, and the motion they allow. */
#include "contact.h"

#include <math.h>
#include <stddef.h>
#include <string.h>
#include "catnav/vec3.h"
#include "geometry.h"

enum { CHUNK = 64 }; /* pairs a task; fixed, so that results do not depend on the threads */

/* Where two primitives are nearest: weights of the body's nodes, unit direction from wall to body. */
typedef struct {
    int n;               /* body nodes */
    double weight[3];    /* of them, sum 1 */
    double direction[3]; /* d distance / d node = weight * direction */
    double wall[3];      /* nearest point of the wall */
    double distance;
    double bary[3]; /* of the wall's nearest point, nodes against triangles only */
    /* where the nearest points are free to slide: how body minus wall point changes, and the body's weights
     * with it */
    int nslide;
    double slide[2][3], shift[2][3];
} nearest;

/* Notes the free parameters of a nearest point within a triangle: none at a corner, one on an edge, two
 * inside. */
static void slide_in_triangle(nearest *out, const double bary[3], const double *const corner[3], double sign)
{
    int in[3], n = 0;
    for (int k = 0; k < 3; k++)
        if (bary[k] > 0) in[n++] = k;
    for (int j = 1; j < n; j++) {
        double *g = out->slide[out->nslide], *w = out->shift[out->nslide++];
        cn_sub(corner[in[j]], corner[in[0]], g);
        for (int k = 0; k < 3; k++)
            g[k] *= sign, w[k] = 0;
        if (sign > 0) w[in[j]] = 1, w[in[0]] = -1;
    }
}

static void slide_on_edge(nearest *out, double s, const double *from, const double *to, double sign)
{
    if (!(s > 0 && s < 1)) return;
    double *g = out->slide[out->nslide], *w = out->shift[out->nslide++];
    cn_sub(to, from, g);
    for (int k = 0; k < 3; k++)
        g[k] *= sign, w[k] = 0;
    if (sign > 0) w[0] = -1, w[1] = 1;
}

static void nearest_of(const cn_pair *pair, const double *x, const double *y, nearest *out)
{
    const int *a = pair->a, *b = pair->b;
    double body[3] = {0, 0, 0}, *bary = out->bary, s, t;

    out->nslide = 0;
    if (pair->kind == CN_PAIR_NODE_TRIANGLE) {
        const double *const corner[3] = {y + 3 * b[0], y + 3 * b[1], y + 3 * b[2]};
        out->n = 1, out->weight[0] = 1;
        cn_copy3(x + 3 * a[0], body);
        out->distance = cn_point_triangle(body, corner[0], corner[1], corner[2], bary);
        for (int k = 0; k < 3; k++)
            out->wall[k] = bary[0] * corner[0][k] + bary[1] * corner[1][k] + bary[2] * corner[2][k];
        slide_in_triangle(out, bary, corner, -1);
    } else if (pair->kind == CN_PAIR_TRIANGLE_VERTEX) {
        const double *const corner[3] = {x + 3 * a[0], x + 3 * a[1], x + 3 * a[2]};
        out->n = 3;
        out->distance = cn_point_triangle(y + 3 * b[0], corner[0], corner[1], corner[2], out->weight);
        for (int k = 0; k < 3; k++)
            cn_axpy(out->weight[k], corner[k], body);
        cn_copy3(y + 3 * b[0], out->wall);
        slide_in_triangle(out, out->weight, corner, 1);
    } else {
        const double *a0 = x + 3 * a[0], *a1 = x + 3 * a[1], *b0 = y + 3 * b[0], *b1 = y + 3 * b[1];
        out->n = 2;
        out->distance = cn_edge_edge(a0, a1, b0, b1, &s, &t);
        out->weight[0] = 1 - s, out->weight[1] = s;
        for (int k = 0; k < 3; k++) {
            body[k] = (1 - s) * a0[k] + s * a1[k];
            out->wall[k] = (1 - t) * b0[k] + t * b1[k];
        }
        slide_on_edge(out, s, a0, a1, 1);
        slide_on_edge(out, t, b0, b1, -1);
    }
    cn_sub(body, out->wall, out->direction);
    cn_normalise(out->direction);
}

/* True where the neighbours across a flat edge or corner answer for this pair: the node lies over one of
 * them, or right above the edge and another triangle counts for it. So a flat wall pushes along its normal
 * however it is cut into triangles. */
static bool passed_over(const cn_contact_model *model, const cn_pair *pair, const double *x,
                        const nearest *at)
{
    if (pair->kind != CN_PAIR_NODE_TRIANGLE) return false;
    const cn_collider *wall = model->wall_collider[pair->wall];
    int zero = 0, bit = 0;
    for (int k = 0; k < 3; k++)
        if (!(at->bary[k] > 0)) zero++, bit = 8 << (k + 1) % 3;
    if (zero == 2)
        for (int k = 0; k < 3; k++)
            if (at->bary[k] > 0) bit = 1 << k;
    if (zero == 0 || !(wall->flat[pair->triangle] & bit)) return false;
    const double *plane = model->wall_plane[pair->wall] + 4 * pair->triangle;
    const double height = fabs(cn_dot(plane, x + 3 * pair->a[0]) - plane[3]);
    return at->distance > height * (1 + 1e-9) || !(wall->above[pair->triangle] & bit);
}

/* Second derivative of d^2/2 by nodes k and l: the nearest points slide so that it stays least, hence
 * D_xx - D_xt D_tt^-1 D_tx over the sliding parameters t. */
static void half_square_hessian(const nearest *at, int k, int l, double h[9])
{
    double inverse[2][2] = {{0, 0}, {0, 0}};
    const double g11 = at->nslide > 0 ? cn_norm2(at->slide[0]) : 0;
    for (int i = 0; i < 9; i++)
        h[i] = i % 4 == 0 ? at->weight[k] * at->weight[l] : 0;
    if (at->nslide == 1) inverse[0][0] = 1 / g11;
    if (at->nslide == 2) {
        const double g12 = cn_dot(at->slide[0], at->slide[1]), g22 = cn_norm2(at->slide[1]);
        const double det = g11 * g22 - g12 * g12;
        if (!(det > 1e-12 * g11 * g22)) return; /* parallel: the mollifier's ground */
        inverse[0][0] = g22 / det, inverse[1][1] = g11 / det, inverse[0][1] = inverse[1][0] = -g12 / det;
    }
    for (int p = 0; p < at->nslide; p++)
        for (int q = 0; q < at->nslide; q++)
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    h[3 * r + c] -=
                        inverse[p][q] *
                        (at->weight[k] * at->slide[p][r] +
                         at->shift[p][k] * at->distance * at->direction[r]) *
                        (at->weight[l] * at->slide[q][c] + at->shift[q][l] * at->distance * at->direction[c]);
}

/* m(c) of near-parallel edges, c = |ea x eb|^2; its derivative by ea in dm. */
static double mollifier(const cn_pair *pair, const double *x, const double *y, double dm[3])
{
    double ea[3], eb[3], n[3];
    dm[0] = dm[1] = dm[2] = 0;
    if (pair->kind != CN_PAIR_EDGES) return 1;
    cn_sub(x + 3 * pair->a[1], x + 3 * pair->a[0], ea);
    cn_sub(y + 3 * pair->b[1], y + 3 * pair->b[0], eb);
    cn_cross(ea, eb, n);
    const double c = cn_norm2(n), e = pair->mollify;
    if (c >= e) return 1;
    const double slope = 2 / e * (1 - c / e), bb = cn_norm2(eb), ab = cn_dot(ea, eb);
    for (int k = 0; k < 3; k++)
        dm[k] = slope * 2 * (bb * ea[k] - ab * eb[k]);
    return c / e * (2 - c / e);
}

/* b, b', b'' of -(d - g)^2 ln(d / g). */
static void barrier(double d, double g, double *b, double *b1, double *b2)
{
    const double l = log(d / g), h = d - g;
    *b = -h * h * l;
    *b1 = -2 * h * l - h * h / d;
    *b2 = -2 * l - 4 * h / d + h * h / (d * d);
}

static double moved(const cn_contact *contact, const cn_pair *pair, const double *x)
{
    const int n = pair->kind == CN_PAIR_NODE_TRIANGLE ? 1 : pair->kind == CN_PAIR_EDGES ? 2 : 3;
    double most = 0;
    for (int k = 0; k < n; k++) {
        const double d = cn_distance(x + 3 * pair->a[k], contact->from + 3 * pair->a[k]);
        most = d > most ? d : most;
    }
    return most;
}

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const double *x, *dx;
    double keep;
    bool all; /* measure every pair, however far */
} pass;

static void measure_chunk(void *user, int chunk)
{
    const pass *p = user;
    cn_contact *contact = p->contact;
    const int end = chunk * CHUNK + CHUNK < contact->npair ? chunk * CHUNK + CHUNK : contact->npair;
    for (int i = chunk * CHUNK; i < end; i++) {
        const cn_pair *pair = &contact->pair[i];
        const double lower = pair->found - moved(contact, pair, p->x);
        if (!p->all && lower > contact->gap_listed) {
            contact->distance[i] = lower;
            continue;
        }
        nearest at;
        nearest_of(pair, p->x, p->model->world->wall[pair->wall].surface->vert, &at);
        contact->distance[i] = at.distance;
    }
}

static int chunks(const cn_contact *contact)
{
    return (contact->npair + CHUNK - 1) / CHUNK;
}

static void add_block(cn_matrix *a, int i, int j, const double h[9])
{
    double *block = a->value + 9 * (size_t)cn_matrix_find(a, i, j);
    for (int k = 0; k < 9; k++)
        block[k] += h[k];
}

/* Adds the stiffness h between points i and j: J' h J by the blocks they hang on, J = (I, arm). */
static void add_stiffness(cn_matrix *a, const cn_carry *carry, int i, int j, const double h[9])
{
    if (!carry) {
        add_block(a, i, j, h);
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
    add_block(a, p, q, h);
    add_block(a, p, turn + q, right);
    add_block(a, turn + p, q, left);
    add_block(a, turn + p, turn + q, both);
}

double cn_contact_add(const cn_contact_model *model, cn_contact *contact, const double *x, double *f,
                      const cn_carry *carry, cn_matrix *a, bool exact, cn_pool *pool)
{
    pass p = {.model = model, .contact = contact, .x = x};
    double energy = 0;

    cn_pool_run(pool, chunks(contact), measure_chunk, &p);
    for (int i = 0; i < contact->npair; i++) {
        const cn_pair *pair = &contact->pair[i];
        if (!(contact->distance[i] < model->gap)) continue;
        if (!(contact->distance[i] > 0)) return INFINITY;
        const double *y = model->world->wall[pair->wall].surface->vert;
        double b, b1, b2, dm[3];
        nearest at;
        nearest_of(pair, x, y, &at);
        if (passed_over(model, pair, x, &at)) continue;
        barrier(at.distance, model->gap, &b, &b1, &b2);
        const double m = mollifier(pair, x, y, dm);
        energy += model->kappa * m * b;
        for (int k = 0; f && k < at.n; k++) {
            cn_axpy(-model->kappa * m * b1 * at.weight[k], at.direction, f + 3 * pair->a[k]);
            if (pair->kind == CN_PAIR_EDGES) cn_axpy((k ? -1 : 1) * model->kappa * b, dm, f + 3 * pair->a[k]);
        }
        for (int k = 0; a && k < at.n; k++)
            for (int l = 0; l < at.n; l++) {
                double h[9];
                const double bend = exact ? model->kappa * m * b1 / at.distance : 0;
                const double s = (model->kappa * m * b2 - bend) * at.weight[k] * at.weight[l];
                if (exact) half_square_hessian(&at, k, l, h);
                for (int r = 0; r < 9; r++)
                    h[r] = s * at.direction[r / 3] * at.direction[r % 3] + (exact ? bend * h[r] : 0);
                add_stiffness(a, carry, pair->a[k], pair->a[l], h);
            }
    }
    return energy;
}

void cn_contact_anchor(const cn_contact_model *model, cn_contact *contact, const double *x, cn_pool *pool)
{
    pass p = {.model = model, .contact = contact, .x = x, .all = true};
    cn_pool_run(pool, chunks(contact), measure_chunk, &p);
    for (int i = 0; i < contact->npair; i++)
        contact->pair[i].found = contact->distance[i];
    memcpy(contact->from, x, 3 * (size_t)model->body->npoint * sizeof *x);
    contact->anchored = true;
}

double cn_contact_least(const cn_contact *contact)
{
    double least = INFINITY;
    for (int i = 0; i < contact->npair; i++)
        least = contact->distance[i] < least ? contact->distance[i] : least;
    return least;
}

/* Each chunk notes the largest fraction its pairs allow. */
static void motion_chunk(void *user, int chunk)
{
    const pass *p = user;
    cn_contact *contact = p->contact;
    const int end = chunk * CHUNK + CHUNK < contact->npair ? chunk * CHUNK + CHUNK : contact->npair;
    double most = 1;
    for (int i = chunk * CHUNK; i < end; i++) {
        const cn_pair *pair = &contact->pair[i];
        const double *y = p->model->world->wall[pair->wall].surface->vert;
        const int na = pair->kind == CN_PAIR_NODE_TRIANGLE ? 1 : pair->kind == CN_PAIR_EDGES ? 2 : 3;
        const int nb = 4 - na, first = pair->kind == CN_PAIR_TRIANGLE_VERTEX ? 1 : 0;
        double q[4][3], dq[4][3] = {{0}}, travel = 0;
        for (int k = 0; k < na; k++) {
            const double step = cn_norm(p->dx + 3 * pair->a[k]);
            travel = step > travel ? step : travel;
        }
        if (contact->distance[i] * (1 - p->keep) > travel) continue;
        for (int k = 0; k < na; k++) {
            cn_copy3(p->x + 3 * pair->a[k], q[first + k]);
            cn_copy3(p->dx + 3 * pair->a[k], dq[first + k]);
        }
        for (int k = 0; k < nb; k++)
            cn_copy3(y + 3 * pair->b[k], q[first ? 0 : na + k]);
        const double gap = p->keep * contact->distance[i];
        const double time = pair->kind == CN_PAIR_EDGES
                                ? cn_ccd_edge_edge((const double(*)[3])q, (const double(*)[3])dq, gap)
                                : cn_ccd_point_triangle((const double(*)[3])q, (const double(*)[3])dq, gap);
        most = time < most ? time : most;
    }
    contact->limit[chunk] = most;
}

double cn_contact_motion(const cn_contact_model *model, cn_contact *contact, const double *x,
                         const double *dx, double keep, cn_pool *pool)
{
    pass p = {.model = model, .contact = contact, .x = x, .dx = dx, .keep = keep};
    double most = 1;
    cn_pool_run(pool, chunks(contact), measure_chunk, &p);
    cn_pool_run(pool, chunks(contact), motion_chunk, &p);
    for (int c = 0; c < chunks(contact); c++)
        most = contact->limit[c] < most ? contact->limit[c] : most;
    return most;
}

static int root_of(int *parent, int i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

double cn_contact_patch_force(const cn_contact_model *model, cn_contact *contact, const double *x,
                              double where[3], int *wall)
{
    double largest = 0;
    where[0] = where[1] = where[2] = NAN;
    *wall = -1;
    /* first pass: join the wall vertices of each touching pair; second: sum forces; third: the largest */
    for (int round = 0; round < 4; round++)
        for (int i = 0; i < contact->npair; i++) {
            const cn_pair *pair = &contact->pair[i];
            if (!(contact->distance[i] < model->gap)) continue;
            const int nb = pair->kind == CN_PAIR_NODE_TRIANGLE ? 3 : pair->kind == CN_PAIR_EDGES ? 2 : 1;
            const int base = contact->patch_of[pair->wall];
            if (round == 0) {
                for (int k = 0; k < nb; k++) {
                    contact->patch[base + pair->b[k]] = base + pair->b[k];
                    for (int c = 0; c < 6; c++)
                        contact->patch_force[6 * (base + pair->b[k]) + c] = 0;
                }
            } else if (round == 1) {
                for (int k = 1; k < nb; k++)
                    contact->patch[root_of(contact->patch, base + pair->b[k])] =
                        root_of(contact->patch, base + pair->b[0]);
            } else if (round == 2) {
                const double *y = model->world->wall[pair->wall].surface->vert;
                double b, b1, b2, dm[3];
                nearest at;
                nearest_of(pair, x, y, &at);
                if (passed_over(model, pair, x, &at)) continue;
                barrier(at.distance, model->gap, &b, &b1, &b2);
                const double size = -model->kappa * mollifier(pair, x, y, dm) * b1;
                double *force = contact->patch_force + 6 * root_of(contact->patch, base + pair->b[0]);
                cn_axpy(size, at.direction, force);
                cn_copy3(at.wall, force + 3);
            } else {
                const double *force = contact->patch_force + 6 * root_of(contact->patch, base + pair->b[0]);
                const double size = cn_norm(force);
                if (size > largest) largest = size, cn_copy3(force + 3, where), *wall = pair->wall;
            }
        }
    return largest;
}
