/* solve_cg.c - conjugate gradients with block-Jacobi preconditioner (Hestenes and Stiefel 1952; the paper's
 * solver), to which the coarse space's correction may be added (two levels): z = D^-1 r + Z (Z'AZ)^-1 Z' r.
 * Three passes over slices of rows an iteration; each slice's share of a dot product stands apart and the
 * shares are added in order, so that the result does not depend on the number of threads. */
#include "solve_parts.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct cn_cg {
    int n, nactive, nslice;
    double *inverse;   /* of the diagonal blocks, upper part: xx xy xz yy yz zz (n x 6) */
    double *r, *p, *q; /* residual, direction, A p                              (3 n)   */
    double *z;         /* preconditioned residual                               (3 n)   */
    double *share;     /* of each slice in up to three sums                     (slices x 3) */
    const cn_matrix *matrix;
    const unsigned char *held;
    cn_coarse *coarse; /* NULL: one level */
    /* what the passes work on */
    const double *b;
    double *x;
    double alpha, beta;
};

cn_status cn_cg_new(cn_cg **out, const cn_matrix *pattern, bool two_levels)
{
    const size_t n = (size_t)pattern->n, slices = n / CN_MATRIX_SLICE + 1;
    cn_cg *cg = calloc(1, sizeof *cg);

    *out = NULL;
    if (!cg) return CN_ERR_MEMORY;
    cg->n = pattern->n;
    cn_status status = two_levels ? cn_coarse_new(&cg->coarse, pattern) : CN_OK;
    if (status == CN_OK && !(cg->inverse = calloc(18 * n + 3 * slices, sizeof(double))))
        status = CN_ERR_MEMORY;
    if (status != CN_OK) {
        cn_cg_free(cg);
        return status;
    }
    cg->r = cg->inverse + 6 * n;
    cg->p = cg->r + 3 * n;
    cg->q = cg->p + 3 * n;
    cg->z = cg->q + 3 * n;
    cg->share = cg->z + 3 * n;
    *out = cg;
    return CN_OK;
}

void cn_cg_free(cn_cg *cg)
{
    if (!cg) return;
    cn_coarse_free(cg->coarse);
    free(cg->inverse);
    free(cg);
}

/* Inverse of a symmetric positive definite block by its cofactors; false if it is not. */
static bool invert(const double *a, double *inverse)
{
    const double xx = a[4] * a[8] - a[5] * a[5], xy = a[2] * a[5] - a[1] * a[8],
                 xz = a[1] * a[5] - a[2] * a[4];
    const double minor = a[0] * a[4] - a[1] * a[1], det = a[0] * xx + a[1] * xy + a[2] * xz;
    const double least = CN_PIVOT_MIN * a[0] * a[4];

    if (!(a[0] > 0 && a[4] > 0 && a[8] > 0 && minor > least && det > least * a[8] && det <= DBL_MAX))
        return false;
    inverse[0] = xx / det, inverse[1] = xy / det, inverse[2] = xz / det;
    inverse[3] = (a[0] * a[8] - a[2] * a[2]) / det;
    inverse[4] = (a[1] * a[2] - a[0] * a[5]) / det;
    inverse[5] = minor / det;
    return true;
}

cn_status cn_cg_factor(cn_cg *cg, const cn_matrix *a, int nactive, const unsigned char *held, const double *x,
                       cn_pool *pool)
{
    cg->matrix = a;
    cg->held = held;
    cg->nactive = nactive;
    cg->nslice = (nactive + CN_MATRIX_SLICE - 1) / CN_MATRIX_SLICE;
    for (int i = 0; i < nactive; i++) {
        double *inverse = cg->inverse + 6 * (size_t)i;
        if (held[i])
            memset(inverse, 0, 6 * sizeof *inverse);
        else if (!invert(a->value + 9 * (size_t)a->diagonal[i], inverse))
            return CN_ERR_SINGULAR;
    }
    return cg->coarse ? cn_coarse_factor(cg->coarse, a, held, x, pool) : CN_OK;
}

static int slice_end(const cn_cg *cg, int slice)
{
    const int end = (slice + 1) * CN_MATRIX_SLICE;

    return end < cg->nactive ? end : cg->nactive;
}

/* z = M^-1 r at node i; returns r . z */
static double precondition(const cn_cg *cg, int i)
{
    const double *m = cg->inverse + 6 * (size_t)i, *r = cg->r + 3 * (size_t)i;
    double *z = cg->z + 3 * (size_t)i;

    z[0] = m[0] * r[0] + m[1] * r[1] + m[2] * r[2];
    z[1] = m[1] * r[0] + m[3] * r[1] + m[4] * r[2];
    z[2] = m[2] * r[0] + m[4] * r[1] + m[5] * r[2];
    return r[0] * z[0] + r[1] * z[1] + r[2] * z[2];
}

/* r = b - A x, z = D^-1 r; shares of r.z, r.r, b.b */
static void start_slice(void *user, int slice)
{
    cn_cg *cg = user;
    const int begin = slice * CN_MATRIX_SLICE, end = slice_end(cg, slice);
    double rz = 0, rr = 0, bb = 0;

    cn_matrix_multiply_rows(cg->matrix, cg->nactive, begin, end, cg->x, cg->r);
    for (int i = begin; i < end; i++) {
        for (int c = 3 * i; c < 3 * i + 3; c++) {
            const double b = cg->held[i] ? 0 : cg->b[c];
            cg->r[c] = cg->held[i] ? 0 : b - cg->r[c];
            rr += cg->r[c] * cg->r[c];
            bb += b * b;
        }
        rz += precondition(cg, i);
    }
    memcpy(cg->share + 3 * (size_t)slice, (double[3]){rz, rr, bb}, 3 * sizeof *cg->share);
}

/* q = A p; share of p.q (p is 0 at held nodes) */
static void product_slice(void *user, int slice)
{
    cn_cg *cg = user;
    const int begin = slice * CN_MATRIX_SLICE, end = slice_end(cg, slice);
    double pq = 0;

    cn_matrix_multiply_rows(cg->matrix, cg->nactive, begin, end, cg->p, cg->q);
    for (int c = 3 * begin; c < 3 * end; c++)
        pq += cg->p[c] * cg->q[c];
    cg->share[3 * (size_t)slice] = pq;
}

/* x += alpha p, r -= alpha q, z = D^-1 r; shares of r.z, r.r */
static void step_slice(void *user, int slice)
{
    cn_cg *cg = user;
    const int begin = slice * CN_MATRIX_SLICE, end = slice_end(cg, slice);
    double rz = 0, rr = 0;

    for (int i = begin; i < end; i++) {
        const double alpha = cg->held[i] ? 0 : cg->alpha;
        for (int c = 3 * i; c < 3 * i + 3; c++) {
            cg->x[c] += alpha * cg->p[c];
            cg->r[c] -= alpha * cg->q[c];
            rr += cg->r[c] * cg->r[c];
        }
        rz += precondition(cg, i);
    }
    memcpy(cg->share + 3 * (size_t)slice, (double[3]){rz, rr, 0}, 3 * sizeof *cg->share);
}

/* p = M^-1 r + beta p; beta 0: whatever p was */
static void turn_slice(void *user, int slice)
{
    cn_cg *cg = user;
    const int end = slice_end(cg, slice);

    for (int i = slice * CN_MATRIX_SLICE; i < end; i++) {
        double *z = cg->z + 3 * (size_t)i, *p = cg->p + 3 * (size_t)i;
        if (cg->coarse) cn_coarse_add(cg->coarse, i, z);
        for (int k = 0; k < 3; k++)
            p[k] = cg->beta == 0 ? z[k] : z[k] + cg->beta * p[k];
    }
}

static double sum_shares(const cn_cg *cg, int which)
{
    double sum = 0;

    for (int s = 0; s < cg->nslice; s++)
        sum += cg->share[3 * s + which];
    return sum;
}

/* r . M^-1 r, its coarse part solved for. */
static cn_status coarse_part(cn_cg *cg, double *rz, cn_pool *pool)
{
    double more = 0;
    const cn_status status = cg->coarse ? cn_coarse_solve(cg->coarse, cg->r, &more, pool) : CN_OK;

    *rz = sum_shares(cg, 0) + more;
    return status;
}

cn_status cn_cg_apply(cn_cg *cg, const double *r, double *z, cn_pool *pool)
{
    double more = 0;
    for (int i = 0; i < cg->nactive; i++) {
        for (int c = 3 * i; c < 3 * i + 3; c++)
            cg->r[c] = cg->held[i] ? 0 : r[c];
        precondition(cg, i);
    }
    const cn_status status = cg->coarse ? cn_coarse_solve(cg->coarse, cg->r, &more, pool) : CN_OK;
    for (int i = 0; status == CN_OK && i < cg->nactive; i++) {
        if (cg->coarse) cn_coarse_add(cg->coarse, i, cg->z + 3 * (size_t)i);
        memcpy(z + 3 * (size_t)i, cg->z + 3 * (size_t)i, 3 * sizeof *z);
    }
    return status;
}

cn_status cn_cg_solve(cn_cg *cg, const double *b, double *x, double tolerance, int max_iterations,
                      int *iterations, double *residual, cn_pool *pool)
{
    int *count = iterations ? iterations : &(int){0};
    double *reached = residual ? residual : &(double){0};
    cn_status status;

    cg->b = b, cg->x = x;
    for (*count = 0;;) { /* from the true residual, again when the updated one has drifted from it */
        cn_pool_run(pool, cg->nslice, start_slice, cg);
        double rz = 0, before = 0, rr = sum_shares(cg, 1);
        const double bb = sum_shares(cg, 2), goal = tolerance * tolerance * bb;
        *reached = rr == 0 ? 0 : sqrt(rr / bb);
        if (!isfinite(rr) || !isfinite(bb)) return CN_ERR_NOT_FINITE;
        if (rr <= goal) return CN_OK;
        if (bb == 0) { /* no relative residual to stop at, but the solution is known */
            for (int i = 0; i < cg->nactive; i++)
                memset(x + 3 * (size_t)i, 0, 3 * sizeof *x);
            *reached = 0;
            return CN_OK;
        }
        if (*count >= max_iterations) return CN_ERR_CONVERGENCE;
        for (; *count < max_iterations && rr > goal; ++*count) {
            if ((status = coarse_part(cg, &rz, pool)) != CN_OK) return status;
            cg->beta = before > 0 ? rz / before : 0;
            before = rz;
            cn_pool_run(pool, cg->nslice, turn_slice, cg);
            cn_pool_run(pool, cg->nslice, product_slice, cg);
            const double pq = sum_shares(cg, 0);
            if (!(pq > 0)) return isnan(pq) ? CN_ERR_NOT_FINITE : CN_ERR_SINGULAR;
            cg->alpha = rz / pq;
            cn_pool_run(pool, cg->nslice, step_slice, cg);
            rr = sum_shares(cg, 1);
        }
    }
}
