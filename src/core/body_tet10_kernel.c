/* body_tet10_kernel.c - second-order tetrahedra, eight at a time: four points of body_kernel_law.h each.
 *
 * At a point with barycentric coordinates l, dx = sum_k Y_k dl_k with Y_k = 4 sum_j l_j x_kj - x_k, where
 * x_kj is the node amid edge kj and x_kk corner k: the point is that of a linear tetrahedron with corners Y.
 * At point q, l_j = a + (j == q) b (b = 1 / sqrt 5), so Y_k = A_k + 4 b x_kq, A_k = 4 a sum_j x_kj - x_k.
 * Forces and stiffness go back by the transpose: node ij takes c of what belongs to corner i, and 4 b more of
 * point j; c = 4 a for a node amid an edge, for a corner 4 a - 1 (and the same of i and j in turn). */
#include "body_kernel_law.h"

#define FOUR_B 1.78885438199983175713 /* 4 / sqrt 5 */
#define MID    0.55278640450004206072 /* 4 a = 1 - 1 / sqrt 5 */
#define CORNER (MID - 1)

static const int amid[4][4] = {{0, 4, 6, 7}, {4, 1, 5, 8}, {6, 5, 2, 9}, {7, 8, 9, 3}};
static const int ends[10][2] = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {0, 1},
                                {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

/* Lanes that take part, as bits. */
INLINE int active_lanes(const cn_batch10 *e, int nactive)
{
    int active = 0;
    for (int lane = 0; lane < CN_LANES; lane++)
        if (e->element[lane] >= 0 && e->top[lane] < nactive) active |= 1 << lane;
    return active;
}

typedef struct {
    v8 at[30];     /* nodes from node 0 */
    v8 base[12];   /* A_k */
    v8 turn[4][4]; /* warm starts, then rotations, of the points */
} element;

/* Lanes that take no part are at rest. */
INLINE void gather(const cn_batch10 *e, const cn_body *body, const double *x, const double *rotation,
                   int active, element *el)
{
    double *at = (double *)el->at, *turn = (double *)el->turn;
    for (int lane = 0; lane < CN_LANES; lane++) {
        const int on = active >> lane & 1;
        const double *from = on ? x : body->rest;
        const double *q = rotation + 16 * (size_t)(on ? e->element[lane] : 0);
        for (int a = 0; a < 10; a++)
            for (int k = 0; k < 3; k++)
                at[CN_LANES * (3 * a + k) + lane] = from[3 * (size_t)e->node[lane][a] + (size_t)k];
        for (int i = 0; i < 16; i++)
            turn[CN_LANES * i + lane] = on ? q[i] : i % 4 == 0;
    }
    for (int i = 29; i >= 0; i--)
        el->at[i] -= el->at[i % 3];
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            el->base[3 * k + i] = MID * (el->at[3 * amid[k][0] + i] + el->at[3 * amid[k][1] + i] +
                                         el->at[3 * amid[k][2] + i] + el->at[3 * amid[k][3] + i]) -
                                  el->at[3 * k + i];
}

INLINE void keep_rotations(const cn_batch10 *e, const element *el, double *rotation, int active)
{
    const double *turn = (const double *)el->turn;
    for (int lane = 0; lane < CN_LANES; lane++)
        for (int i = 0; active >> lane & 1 && i < 16; i++)
            rotation[16 * (size_t)e->element[lane] + (size_t)i] = turn[CN_LANES * i + lane];
}

/* F at point q. */
INLINE void point_deformation(const cn_batch10 *e, const element *el, int q, v8 f[9])
{
    v8 y[12];
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            y[3 * k + i] = el->base[3 * k + i] + FOUR_B * el->at[3 * amid[k][q] + i];
    deformation(y, (const v8 *)e->grad[q], f);
}

INLINE material point_material(const cn_batch10 *e, int q)
{
    return (material){*(const v8 *)e->volume[q], *(const v8 *)e->mu, *(const v8 *)e->lambda};
}

/* out: forces on the nodes; its values before count for nothing. point[q]: those on the corners of point q.
 */
INLINE void node_forces(const v8 point[CN_TET10_POINTS][12], v8 out[30])
{
    v8 sum[12];
    for (int i = 0; i < 12; i++)
        sum[i] = point[0][i] + point[1][i] + point[2][i] + point[3][i];
    for (int a = 0; a < 10; a++)
        for (int k = 0; k < 3; k++) {
            const int i = 3 * ends[a][0] + k, j = 3 * ends[a][1] + k;
            out[3 * a + k] =
                a < 4 ? CORNER * sum[i] + FOUR_B * point[a][i]
                      : MID * (sum[i] + sum[j]) + FOUR_B * (point[ends[a][1]][i] + point[ends[a][0]][j]);
        }
}

INLINE void add_forces(const cn_batch10 *e, const v8 point[CN_TET10_POINTS][12], double *f, int active)
{
    double out[30][CN_LANES] __attribute__((aligned(64)));
    node_forces(point, (v8 *)out);
    for (int lane = 0; lane < CN_LANES; lane++)
        for (int a = 0; active >> lane & 1 && a < 10; a++)
            for (int k = 0; k < 3; k++)
                f[3 * (size_t)e->node[lane][a] + (size_t)k] += out[3 * a + k][lane];
}

/* Stiffness between corners m <= n (block_at), in place of that of point q, B_q, and of the sum over points,
 * S: E_q = 4a 4b B_q + H and H = (4a)^2 S / 2. What corner m, point o of node a and corner n, point p of node
 * b share, c_a c_b S + 4b c_a B_p + 4b c_b B_o + (4b)^2 B_o (where o is p), is then A E_p + (B + r) E_o + (2
 * A B - A - B - r) H with A = c_a / 4a, B = c_b / 4a and r = b / a where o is p. */
enum { NODE_PAIRS = 55, TERMS_MAX = 12, H = CN_TET10_POINTS };
typedef v8 corner_blocks[CN_TET10_POINTS + 1][10][9];
static const int block_at[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};

/* Terms of the block of two nodes: block `at` of corner_blocks, transposed or not, times `share`. */
typedef struct {
    double share;
    int at, turned;
} term;
typedef struct {
    int n;
    term term[TERMS_MAX];
} pair_terms;

static void add_term(pair_terms *pair, int which, int m, int n, double share)
{
    const int at = 10 * which + block_at[m][n], turned = m > n;
    for (int i = 0; i < pair->n; i++)
        if (pair->term[i].at == at && pair->term[i].turned == turned) {
            pair->term[i].share += share;
            return;
        }
    pair->term[pair->n++] = (term){share, at, turned};
}

/* The terms of all pairs of nodes a <= b, row by row. */
static void list_terms(pair_terms pair[NODE_PAIRS])
{
    for (int a = 0; a < 10; a++)
        for (int b = a; b < 10; b++, pair++) {
            const double ca = a < 4 ? CORNER / MID : 1, cb = b < 4 ? CORNER / MID : 1;
            pair->n = 0;
            for (int s = 0; s < (a < 4 ? 1 : 2); s++)
                for (int t = 0; t < (b < 4 ? 1 : 2); t++) {
                    const int m = ends[a][s], o = ends[a][1 - s], n = ends[b][t], p = ends[b][1 - t];
                    const double same = o == p ? FOUR_B / MID : 0, rest = 2 * ca * cb - ca - cb - same;
                    add_term(pair, p, m, n, ca);
                    add_term(pair, o, m, n, cb + same);
                    if (rest != 0) add_term(pair, H, m, n, rest);
                }
        }
}

INLINE void share_out(corner_blocks c)
{
    for (int k = 0; k < 10; k++)
        for (int i = 0; i < 9; i++) {
            c[H][k][i] = 0.5 * MID * MID * (c[0][k][i] + c[1][k][i] + c[2][k][i] + c[3][k][i]);
            for (int q = 0; q < CN_TET10_POINTS; q++)
                c[q][k][i] = MID * FOUR_B * c[q][k][i] + c[H][k][i];
        }
}

INLINE void sum_terms(const corner_blocks c, const pair_terms *pair, v8 out[9])
{
    v8 k[9] = {{0}};
    for (int t = 0; t < pair->n; t++) {
        const v8 *b = c[0][0] + 9 * pair->term[t].at, zero = {0}, share = zero + pair->term[t].share;
        if (pair->term[t].turned)
#pragma GCC unroll 9
            for (int i = 0; i < 9; i++)
                k[i] += share * b[3 * (i % 3) + i / 3];
        else
#pragma GCC unroll 9
            for (int i = 0; i < 9; i++)
                k[i] += share * b[i];
    }
#pragma GCC unroll 9
    for (int i = 0; i < 9; i++)
        out[i] = k[i];
}

/* Calls for the matrix blocks of row a before they are needed. */
INLINE void call_row(int a, const double *value, const int *index)
{
    for (int lane = 0; lane < CN_LANES; lane++)
        for (int b = a; b < 10; b++) {
            __builtin_prefetch(value + 9 * (size_t)index[100 * lane + 10 * a + b], 1);
            __builtin_prefetch(value + 9 * (size_t)index[100 * lane + 10 * b + a], 1);
        }
}

/* Adds row a of the element's blocks to the matrix, from its diagonal on, and what is symmetric to it. */
INLINE void add_row(const corner_blocks c, const pair_terms *pair, int a, double scale, double *value,
                    const int *index, int active)
{
    v8 block[10][9];
    int upper[10], lower[10];
    for (int b = a; b < 10; b++) {
        sum_terms(c, pair + b - a, block[b - a]);
        upper[b - a] = 10 * a + b, lower[b - a] = b == a ? -1 : 10 * b + a;
    }
    scatter_blocks((const v8(*)[9])block, 10 - a, scale, value, index, 100, upper, lower, active);
}

INLINE void elastic(const cn_elastic_job *job, int chunk)
{
    const struct cn_element_data *data = job->body->element;
    const int first = chunk * data->chunk_batches;
    const int last = first + data->chunk_batches < data->nbatch ? first + data->chunk_batches : data->nbatch;
    v8 sum = {0};
    pair_terms pair[NODE_PAIRS];
    if (job->stiffness) list_terms(pair);
    for (int n = first; n < last; n++) {
        const cn_batch10 *e = data->batch10 + n;
        if (e->top_min >= job->nactive) continue;
        const int active = active_lanes(e, job->nactive);
        element el;
        corner_blocks c;
        v8 force[CN_TET10_POINTS][12];
        gather(e, job->body, job->x, job->rotation, active, &el);
        for (int q = 0; q < CN_TET10_POINTS; q++) {
            const material m = point_material(e, q);
            v8 f[9], r[9], b[9], eps[6], trace, stress[6];
            point_deformation(e, &el, q, f);
            polar(f, el.turn[q], r, b);
            sum += strain(b, &m, eps, &trace);
            if (!job->f) continue;
            stress_of(eps, &trace, &m, stress);
            corner_forces(r, stress, (const v8 *)e->grad[q], force[q]);
            if (job->stiffness) stiffness_blocks(r, b, (const v8 *)e->grad[q], &m, job->tangent, c[q]);
        }
        keep_rotations(e, &el, job->rotation, active);
        if (!job->f) continue;
        add_forces(e, (const v8(*)[12])force, job->f, active);
        if (!job->stiffness) continue;
        share_out(c);
        const int *index = job->stiffness->block + 100 * CN_LANES * (size_t)n;
        double *value = job->stiffness->matrix->value;
        for (int a = 0, at = 0; a < 10; at += 10 - a++) {
            if (a < 9) call_row(a + 1, value, index);
            add_row(c, pair + at, a, job->scale, value, index, active);
        }
    }
    job->energy[chunk] = sum_lanes(&sum);
}

INLINE void measure(const cn_measure_job *job, int chunk)
{
    const struct cn_element_data *data = job->body->element;
    const int first = chunk * data->chunk_batches;
    const int last = first + data->chunk_batches < data->nbatch ? first + data->chunk_batches : data->nbatch;
    cn_chunk_measures *out = job->chunk + chunk;
    measure_sums sums = {0};
    *out = nothing_measured;
    for (int n = first; n < last; n++) {
        const cn_batch10 *e = data->batch10 + n;
        if (e->top_min >= job->nactive) continue;
        const int active = active_lanes(e, job->nactive);
        v8 now = {0}, rest = {0}, least, stress = {0};
        element el;
        gather(e, job->body, job->x, job->rotation, active, &el);
        for (int q = 0; q < CN_TET10_POINTS; q++) {
            const material m = point_material(e, q);
            v8 f[9], r[9], b[9], eps[6], trace;
            point_deformation(e, &el, q, f);
            const v8 ratio = determinant(f);
            now += ratio * m.volume, rest += m.volume;
            least = q == 0 ? ratio : PICK((ratio < least) | (ratio != ratio), ratio, least);
            polar(f, el.turn[q], r, b);
            sums.energy += strain(b, &m, eps, &trace);
            if (!job->with_stress) continue;
            const v8 here = von_mises(eps, &m);
            stress = q == 0 ? here : PICK((here > stress) | (here != here), here, stress);
        }
        keep_rotations(e, &el, job->rotation, active);
        sums.growth += now - rest;
        const v8 ratio = now / rest;
        keep_lanes(job, e->element, active, &ratio, &least, &stress, &sums, out);
    }
    sum_measures(&sums, out);
}

CN_KERNEL_SETS(KERNELS, const cn_kernels *, cn_kernels10_pick)
