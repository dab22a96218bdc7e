/* solve_coarse.c - the coarse space of the two-level preconditioner: nodes joined to aggregates, each moved
 * as a rigid body (Bulgakov and Kuhn 1995; Vanek, Mandel and Brezina 1996, unsmoothed). What block-Jacobi is
 * slow at, long waves of bending and turning, is nearly rigid piece by piece.
 *
 * Node i of aggregate a moves by t_a + w_a x r_i / h, r_i from a's centre, h a mean distance: block rows 2a
 * and 2a + 1 of the coarse matrix Z'AZ are the translation t_a and the turn w_a. */
#include "solve_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { AGGREGATE = 20, AGGREGATE_UNTIL = 6000 }; /* nodes; above so many nodes aggregates grow with n^(1/2) */

struct cn_coarse {
    int n, naggregate;
    int *aggregate;      /* of each node                                                      (n)      */
    int *start, *member; /* nodes of aggregate a: member[start[a] .. start[a+1])              (n)      */
    int *place;          /* coarse block (2a, 2b) of a fine block, b >= a, else -1            (nblock) */
    double *arm;         /* r_i / h, 0 where not known                                        (n x 3)  */
    unsigned char
        *held;     /* coarse rows without a motion of their own                         (2 naggregate) */
    double *b, *c; /* right-hand side and solution                                      (6 naggregate) */
    cn_matrix *matrix;
    cn_sparse *sparse;
    const cn_matrix *fine;
    const unsigned char *fine_held;
    const double *r;
};

/* Grows aggregates breadth first, one after the other along the levels; what stays below half the size joins
 * its smallest neighbour. Returns their number. */
static int grow(const cn_matrix *a, const int *order, int size, int *aggregate, int *count, int *queue)
{
    int naggregate = 0;

    for (int i = 0; i < a->n; i++)
        aggregate[i] = -1;
    for (int q = 0; q < a->n; q++) {
        if (aggregate[order[q]] >= 0) continue;
        int n = 0, join = -1;
        queue[n++] = order[q];
        aggregate[order[q]] = naggregate;
        for (int head = 0; head < n; head++)
            for (int k = a->row[queue[head]]; k < a->row[queue[head] + 1]; k++) {
                const int j = a->col[k], other = aggregate[j];
                if (other < 0 && n < size) {
                    aggregate[j] = naggregate;
                    queue[n++] = j;
                } else if (other >= 0 && other != naggregate && (join < 0 || count[other] < count[join])) {
                    join = other;
                }
            }
        if (join < 0 || 2 * n >= size) {
            count[naggregate++] = n;
            continue;
        }
        count[join] += n;
        while (n > 0)
            aggregate[queue[--n]] = join;
    }
    return naggregate;
}

/* Nodes by levels, so that aggregates grow side by side. */
static cn_status order_by_levels(const cn_matrix *a, int *order, int *level, int *first)
{
    const cn_status status = cn_levels_find(a, level);

    if (status != CN_OK) return status;
    memset(first, 0, ((size_t)a->n + 1) * sizeof *first);
    for (int i = 0; i < a->n; i++)
        first[level[i] + 1]++;
    for (int l = 0; l < a->n; l++)
        first[l + 1] += first[l];
    for (int i = 0; i < a->n; i++)
        order[first[level[i]]++] = i;
    return CN_OK;
}

static cn_status make_aggregates(cn_coarse *coarse, const cn_matrix *a)
{
    const size_t n = (size_t)a->n;
    const int size =
        a->n <= AGGREGATE_UNTIL ? AGGREGATE : (int)(AGGREGATE * sqrt(a->n / (double)AGGREGATE_UNTIL));
    int *work = malloc((4 * n + 4) * sizeof *work);
    cn_status status = CN_ERR_MEMORY;

    coarse->aggregate = malloc((n + 1) * sizeof *coarse->aggregate);
    coarse->member = malloc((n + 1) * sizeof *coarse->member);
    if (!work || !coarse->aggregate || !coarse->member) goto done;
    int *order = work, *count = work + n + 1, *queue = count + n + 1;
    if ((status = order_by_levels(a, order, coarse->aggregate, count)) != CN_OK) goto done;
    coarse->naggregate = grow(a, order, size, coarse->aggregate, count, queue);
    status = CN_ERR_MEMORY;
    if (!(coarse->start = calloc((size_t)coarse->naggregate + 2, sizeof *coarse->start))) goto done;
    int *next = coarse->start + 1; /* while sorting, next[a] is where a's next node goes */
    for (int b = 0; b + 1 < coarse->naggregate; b++)
        next[b + 1] = next[b] + count[b];
    for (int i = 0; i < a->n; i++)
        coarse->member[next[coarse->aggregate[i]]++] = i;
    status = CN_OK;
done:
    free(work);
    return status;
}

/* The coarse pattern, through two blocks an aggregate and four an element, and where fine blocks go. */
static cn_status make_pattern(cn_coarse *coarse, const cn_matrix *a)
{
    int *connect = malloc(((size_t)a->nblock + 1) * 4 * sizeof *connect), *seen;
    cn_status status = CN_ERR_MEMORY;
    cn_body joined = {.nblock = 2 * coarse->naggregate, .nper = 4, .connect = connect};
    const cn_body *const bodies[] = {&joined};

    seen = malloc(((size_t)coarse->naggregate + 1) * sizeof *seen);
    coarse->place = malloc(((size_t)a->nblock + 1) * sizeof *coarse->place);
    if (!connect || !seen || !coarse->place) goto done;
    for (int b = 0; b < coarse->naggregate; b++)
        seen[b] = -1;
    for (int b = 0; b < coarse->naggregate; b++)
        for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++)
            for (int i = coarse->member[m], k = a->row[i]; k < a->row[i + 1]; k++) {
                const int other = coarse->aggregate[a->col[k]];
                if (other < b || seen[other] == b) continue;
                seen[other] = b;
                memcpy(connect + 4 * (size_t)joined.nelement++,
                       (int[4]){2 * b, 2 * b + 1, 2 * other, 2 * other + 1}, 4 * sizeof *connect);
            }
    if ((status = cn_matrix_new(&coarse->matrix, 1, bodies, (int[]){0})) != CN_OK) goto done;
    for (int i = 0; i < a->n; i++)
        for (int k = a->row[i]; k < a->row[i + 1]; k++) {
            const int b = coarse->aggregate[i], other = coarse->aggregate[a->col[k]];
            coarse->place[k] = other < b ? -1 : cn_matrix_find(coarse->matrix, 2 * b, 2 * other);
        }
    status = cn_sparse_new(&coarse->sparse, coarse->matrix);
done:
    free(connect);
    free(seen);
    return status;
}

cn_status cn_coarse_new(cn_coarse **out, const cn_matrix *pattern)
{
    cn_coarse *coarse = calloc(1, sizeof *coarse);
    cn_status status = CN_ERR_MEMORY;

    *out = NULL;
    if (!coarse) return CN_ERR_MEMORY;
    coarse->n = pattern->n;
    if ((status = make_aggregates(coarse, pattern)) != CN_OK) goto fail;
    if ((status = make_pattern(coarse, pattern)) != CN_OK) goto fail;
    status = CN_ERR_MEMORY;
    const size_t naggregate = (size_t)coarse->naggregate;
    if (!(coarse->arm = calloc(3 * (size_t)pattern->n + 1, sizeof(double)))) goto fail;
    if (!(coarse->held = calloc(2 * naggregate + 1, 1))) goto fail;
    if (!(coarse->b = calloc(12 * naggregate + 1, sizeof(double)))) goto fail;
    coarse->c = coarse->b + 6 * naggregate;
    *out = coarse;
    return CN_OK;
fail:
    cn_coarse_free(coarse);
    return status;
}

void cn_coarse_free(cn_coarse *coarse)
{
    if (!coarse) return;
    cn_matrix_free(coarse->matrix);
    cn_sparse_free(coarse->sparse);
    free(coarse->aggregate);
    free(coarse->start);
    free(coarse->member);
    free(coarse->place);
    free(coarse->arm);
    free(coarse->held);
    free(coarse->b);
    free(coarse);
}

/* Arms of an aggregate's moving nodes. Where they lie on a line, or are not known, it has no turn of its own:
 * the determinant of sum |r|^2 I - r r' is then nothing against its trace. */
static void set_arms(cn_coarse *coarse, int b, const double *x)
{
    double centre[3] = {0, 0, 0}, sum[6] = {0}, square = 0;
    int moving = 0;

    for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++) {
        const int i = coarse->member[m];
        if (coarse->fine_held[i]) continue;
        moving++;
        for (int k = 0; k < 3; k++)
            centre[k] += x ? x[3 * (size_t)i + (size_t)k] : 0;
    }
    coarse->held[2 * b] = moving == 0;
    for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++) {
        const int i = coarse->member[m];
        double *r = coarse->arm + 3 * (size_t)i;
        for (int k = 0; k < 3; k++)
            r[k] = coarse->fine_held[i] || !x ? 0 : x[3 * (size_t)i + (size_t)k] - centre[k] / moving;
        sum[0] += r[0] * r[0], sum[1] += r[0] * r[1], sum[2] += r[0] * r[2];
        sum[3] += r[1] * r[1], sum[4] += r[1] * r[2], sum[5] += r[2] * r[2];
    }
    square = sum[0] + sum[3] + sum[5];
    const double xx = square - sum[0], yy = square - sum[3], zz = square - sum[5];
    const double det = xx * (yy * zz - sum[4] * sum[4]) - sum[1] * (sum[1] * zz + sum[4] * sum[2]) -
                       sum[2] * (sum[1] * sum[4] + yy * sum[2]);
    const bool turns = det > 1e-4 * square * square * square; /* false for NaN, too */
    const double scale = turns ? sqrt(moving / square) : 0;
    coarse->held[2 * b + 1] = !turns;
    for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++)
        for (int k = 0; k < 3; k++) {
            double *r = coarse->arm + 3 * (size_t)coarse->member[m] + k;
            *r = turns ? *r * scale : 0;
        }
}

/* Adds T_i' v T_j, T = [I, -[r]x]: v, rows r_j x v, columns r_i x v, and both. `to`, `turn`: coarse blocks
 * (2a, 2b), (2a+1, 2b), each with its right neighbour behind it. */
static void add_block(const double *v, const double *ri, const double *rj, double *to, double *turn)
{
    double w[18]; /* rows of [v, v S_j] */

    for (int p = 0; p < 3; p++) {
        const double *row = v + 3 * p;
        double *out = w + 6 * p;
        out[0] = row[0], out[1] = row[1], out[2] = row[2];
        out[3] = rj[1] * row[2] - rj[2] * row[1];
        out[4] = rj[2] * row[0] - rj[0] * row[2];
        out[5] = rj[0] * row[1] - rj[1] * row[0];
    }
    for (int half = 0; half < 2; half++)
        for (int q = 0; q < 3; q++) {
            const double a = w[3 * half + q], b = w[6 + 3 * half + q], c = w[12 + 3 * half + q];
            double *t = to + 9 * half + q, *s = turn + 9 * half + q;
            t[0] += a, t[3] += b, t[6] += c;
            s[0] += ri[1] * c - ri[2] * b, s[3] += ri[2] * a - ri[0] * c, s[6] += ri[0] * b - ri[1] * a;
        }
}

/* Coarse rows of aggregate b from its nodes' rows, other aggregates >= b. */
static void gather_rows(void *user, int b)
{
    const cn_coarse *coarse = user;
    const cn_matrix *a = coarse->fine, *to = coarse->matrix;
    const int rows = to->row[2 * b + 1] - to->row[2 * b];

    memset(to->value + 9 * (size_t)to->row[2 * b], 0, 18 * (size_t)rows * sizeof *to->value);
    for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++) {
        const int i = coarse->member[m];
        if (coarse->fine_held[i]) continue;
        for (int k = a->row[i]; k < a->row[i + 1]; k++) {
            const int j = a->col[k], place = coarse->place[k];
            if (place < 0 || coarse->fine_held[j]) continue;
            add_block(a->value + 9 * (size_t)k, coarse->arm + 3 * (size_t)i, coarse->arm + 3 * (size_t)j,
                      to->value + 9 * (size_t)place, to->value + 9 * (size_t)(place + rows));
        }
    }
}

/* The blocks below the diagonal aggregates are those above transposed. */
static void mirror(cn_matrix *a)
{
    for (int i = 0; i < a->n; i++)
        for (int k = a->row[i]; k < a->row[i + 1] && a->col[k] / 2 < i / 2; k++) {
            const double *from = a->value + 9 * (size_t)cn_matrix_find(a, a->col[k], i);
            double *to = a->value + 9 * (size_t)k;
            for (int p = 0; p < 3; p++)
                for (int q = 0; q < 3; q++)
                    to[3 * p + q] = from[3 * q + p];
        }
}

cn_status cn_coarse_factor(cn_coarse *coarse, const cn_matrix *a, const unsigned char *held, const double *x,
                           cn_pool *pool)
{
    coarse->fine = a, coarse->fine_held = held;
    for (int b = 0; b < coarse->naggregate; b++)
        set_arms(coarse, b, x);
    cn_pool_run(pool, coarse->naggregate, gather_rows, coarse);
    mirror(coarse->matrix);
    return cn_sparse_factor(coarse->sparse, coarse->matrix, coarse->held);
}

/* b = Z' r of one aggregate */
static void restrict_one(void *user, int b)
{
    const cn_coarse *coarse = user;
    double *to = coarse->b + 6 * (size_t)b, sum[6] = {0};

    for (int m = coarse->start[b]; m < coarse->start[b + 1]; m++) {
        const int i = coarse->member[m];
        const double *v = coarse->r + 3 * (size_t)i, *r = coarse->arm + 3 * (size_t)i;
        if (coarse->fine_held[i]) continue;
        sum[0] += v[0], sum[1] += v[1], sum[2] += v[2];
        sum[3] += r[1] * v[2] - r[2] * v[1];
        sum[4] += r[2] * v[0] - r[0] * v[2];
        sum[5] += r[0] * v[1] - r[1] * v[0];
    }
    memcpy(to, sum, sizeof sum);
}

enum { RESTRICTED = 32 }; /* aggregates a task */

static void restrict_some(void *user, int task)
{
    const cn_coarse *coarse = user;
    const int end =
        (task + 1) * RESTRICTED < coarse->naggregate ? (task + 1) * RESTRICTED : coarse->naggregate;

    for (int b = task * RESTRICTED; b < end; b++)
        restrict_one(user, b);
}

cn_status cn_coarse_solve(cn_coarse *coarse, const double *r, double *dot, cn_pool *pool)
{
    coarse->r = r;
    cn_pool_run(pool, (coarse->naggregate + RESTRICTED - 1) / RESTRICTED, restrict_some, coarse);
    memset(coarse->c, 0, 6 * (size_t)coarse->naggregate * sizeof *coarse->c);
    const cn_status status = cn_sparse_solve(coarse->sparse, coarse->held, coarse->b, coarse->c);
    *dot = 0;
    for (int k = 0; k < 6 * coarse->naggregate; k++)
        *dot += coarse->b[k] * coarse->c[k];
    return status;
}

void cn_coarse_add(const cn_coarse *coarse, int i, double z[3])
{
    const double *t = coarse->c + 6 * (size_t)coarse->aggregate[i], *w = t + 3,
                 *r = coarse->arm + 3 * (size_t)i;

    if (coarse->fine_held[i]) return;
    z[0] += t[0] + w[1] * r[2] - w[2] * r[1];
    z[1] += t[1] + w[2] * r[0] - w[0] * r[2];
    z[2] += t[2] + w[0] * r[1] - w[1] * r[0];
}
