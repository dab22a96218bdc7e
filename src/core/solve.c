/* solve.c - picks the solver and hands on; residual and refinement of the direct ones. */
#include "solve_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct cn_solver {
    cn_linear kind;
    int n, nactive;
    bool factored;
    unsigned char *held;     /* fixed or not active (n) */
    const cn_matrix *matrix; /* of the last factor */
    cn_ladder *ladder;       /* in place of the chain where levels have two nodes each */
    cn_chain *chain;
    cn_sparse *sparse;
    cn_cg *cg;
    bool direct;              /* CHAIN, CHOLESKY, or PCG that has fallen back on CHOLESKY ... */
    int direct_left, pause;   /* ... for so many factors more, of this many since it did */
    const double *place;      /* (n x 3), NULL: not known */
    double *product, *change; /* for the residual of the direct solvers (3 n each) */
};

/* Seconds for a factorisation and three solves, by rates that were measured on one core with AVX-512 (tubes,
 * bars and cubes of 700 to 8,000 nodes; right within a factor of 2): the chain's panels run at 25 Gflop/s
 * while one fits into the cache of 1 MiB, else at 8; CHOLMOD at 25 Gflop/s and 16 ns an entry of the factor
 * (its supernodes are narrow), or 1.5 Gflop/s without supernodes; solves pass twice over the factor, at 20
 * and 7 GB/s. */
static double chain_seconds(double flops, double size, int nlevel)
{
    const bool cached = 8 * size < (double)nlevel * (1 << 20);

    return flops / (cached ? 25e9 : 8e9) + 3 * 16 * size / 20e9;
}

static double sparse_seconds(double flops, double size, bool supernodal)
{
    return (supernodal ? flops / 25e9 + 16e-9 * size : flops / 1.5e9) + 3 * 16 * size / 7e9;
}

/* Some 60 products, each twice the matrix's way from L3, and the preconditioner. */
static double pcg_seconds(const cn_matrix *pattern)
{
    return 60 * 8e-9 * pattern->nblock;
}

enum { ANALYSED = 12000, PATIENCE = 250, PAUSE = 16 };

/* The cheapest of chain, CHOLMOD and PCG; solver->sparse is kept when CHOLMOD is, and to fall back on.
 * CHOLMOD is not asked where its factor would not fit: compact bodies of many nodes. */
static cn_status choose(cn_solver *solver, const cn_matrix *pattern, const int *level, cn_linear *kind)
{
    double flops, size, sparse_flops, sparse_size;
    bool supernodal;
    int nlevel = 0;
    cn_status status = cn_levels_cost(pattern, level, &flops, &size);

    if (status != CN_OK) return status;
    for (int i = 0; i < pattern->n; i++)
        if (level[i] >= nlevel) nlevel = level[i] + 1;
    *kind = CN_LINEAR_CHAIN;
    if (size <= 96.0 * 3 * pattern->n) return CN_OK; /* levels of 48 unknowns or fewer: no need to ask */
    const double chain = chain_seconds(flops, size, nlevel), pcg = pcg_seconds(pattern);
    if (pattern->n > ANALYSED) {
        if (pcg < chain) *kind = CN_LINEAR_PCG;
        return CN_OK;
    }
    if ((status = cn_sparse_new(&solver->sparse, pattern)) != CN_OK) return status;
    cn_sparse_cost(solver->sparse, &sparse_flops, &sparse_size, &supernodal);
    const double sparse = sparse_seconds(sparse_flops, sparse_size, supernodal);
    if (chain <= sparse && chain <= pcg) {
        cn_sparse_free(solver->sparse);
        solver->sparse = NULL;
        return CN_OK;
    }
    *kind = 2 * pcg < sparse ? CN_LINEAR_PCG : CN_LINEAR_CHOLESKY;
    return CN_OK;
}

cn_status cn_solver_new(cn_solver **out, const cn_matrix *pattern, cn_linear kind, const int *level,
                        cn_error *error)
{
    const size_t n = (size_t)pattern->n;
    cn_status status = CN_ERR_MEMORY;
    int *found = NULL;
    cn_solver *solver = calloc(1, sizeof *solver);

    *out = NULL;
    if (!solver) goto fail;
    solver->n = pattern->n;
    solver->held = calloc(n + 1, 1);
    if (!solver->held) goto fail;
    if (kind == CN_LINEAR_AUTO || kind == CN_LINEAR_CHAIN) {
        if (level && !cn_levels_check(pattern, level)) {
            cn_solver_free(solver);
            return cn_fail(error, CN_ERR_ARG, NULL, 0,
                           "the levels given do not fit the mesh: a node couples beyond the next level");
        }
        if (!level) {
            if (!(found = malloc((n + 1) * sizeof *found))) goto fail;
            if ((status = cn_levels_find(pattern, found)) != CN_OK) goto fail;
            level = found;
        }
    }
    if (kind == CN_LINEAR_AUTO && (status = choose(solver, pattern, level, &kind)) != CN_OK) goto fail;
    solver->kind = kind;
    solver->direct = kind == CN_LINEAR_CHAIN || kind == CN_LINEAR_CHOLESKY;
    if (!solver->direct && (status = cn_cg_new(&solver->cg, pattern, kind == CN_LINEAR_PCG)) != CN_OK)
        goto fail;
    if (solver->direct || solver->sparse) {
        status = CN_ERR_MEMORY;
        if (!(solver->product = calloc(3 * n + 1, sizeof(double)))) goto fail;
        if (!(solver->change = calloc(3 * n + 1, sizeof(double)))) goto fail;
        if (kind == CN_LINEAR_CHAIN) {
            status = cn_ladder_new(&solver->ladder, pattern, level, 0);
            if (status == CN_OK && !solver->ladder) status = cn_chain_new(&solver->chain, pattern, level, 0);
        } else {
            status = solver->sparse ? CN_OK : cn_sparse_new(&solver->sparse, pattern);
        }
        if (status != CN_OK) goto fail;
    }
    free(found);
    *out = solver;
    return CN_OK;
fail:
    free(found);
    cn_solver_free(solver);
    return cn_fail(error, status, NULL, 0, "no linear solver for %d nodes: %s", pattern->n,
                   cn_status_text(status));
}

void cn_solver_free(cn_solver *solver)
{
    if (!solver) return;
    cn_ladder_free(solver->ladder);
    cn_chain_free(solver->chain);
    cn_sparse_free(solver->sparse);
    cn_cg_free(solver->cg);
    free(solver->held);
    free(solver->product);
    free(solver->change);
    free(solver);
}

cn_linear cn_solver_kind(const cn_solver *solver)
{
    return solver->kind;
}

void cn_solver_place(cn_solver *solver, const double *x)
{
    solver->place = x;
}

cn_status cn_solver_factor(cn_solver *solver, const cn_matrix *a, int nactive, const unsigned char *fixed,
                           cn_pool *pool)
{
    cn_status status;

    solver->factored = false;
    if (a->n != solver->n || nactive < 0 || nactive > solver->n) return CN_ERR_ARG;
    for (int i = 0; i < solver->n; i++)
        solver->held[i] = i >= nactive || (fixed && fixed[i]);
    solver->matrix = a;
    solver->nactive = nactive;
    if (solver->ladder)
        status = cn_ladder_factor(solver->ladder, a, solver->held);
    else if (solver->kind == CN_LINEAR_CHAIN)
        status = cn_chain_factor(solver->chain, a, solver->held, pool);
    else if (solver->cg && solver->direct_left == 0)
        status = cn_cg_factor(solver->cg, a, nactive, solver->held, solver->place, pool);
    else
        status = cn_sparse_factor(solver->sparse, a, solver->held);
    if (solver->cg) {
        solver->direct = solver->direct_left > 0;
        if (solver->direct) solver->direct_left--;
    }
    solver->factored = status == CN_OK;
    return status;
}

static cn_status solve_direct(cn_solver *solver, const double *b, double *x, cn_pool *pool)
{
    if (solver->kind != CN_LINEAR_CHAIN) return cn_sparse_solve(solver->sparse, solver->held, b, x);
    if (solver->ladder)
        cn_ladder_solve(solver->ladder, b, x);
    else
        cn_chain_solve(solver->chain, b, x, pool);
    return CN_OK;
}

cn_status cn_solver_apply(cn_solver *solver, const double *r, double *z, cn_pool *pool)
{
    if (!solver->factored) return CN_ERR_ARG;
    if (!solver->direct) return cn_cg_apply(solver->cg, r, z, pool);
    return solve_direct(solver, r, z, pool);
}

/* |b - A x| / |b| over the rows not held; product becomes b - A x. */
static double residual_of(cn_solver *solver, const double *b, const double *x, cn_pool *pool)
{
    double *r = solver->product, rr = 0, bb = 0;

    cn_matrix_multiply(solver->matrix, solver->nactive, x, r, pool);
    for (int i = 0; i < solver->nactive; i++)
        for (int c = 3 * i; c < 3 * i + 3; c++) {
            r[c] = solver->held[i] ? 0 : b[c] - r[c];
            rr += r[c] * r[c];
            bb += solver->held[i] ? 0 : b[c] * b[c];
        }
    return rr == 0 ? 0 : sqrt(rr / bb);
}

/* PCG; where it is slow and there is CHOLESKY that takes over, for longer each time. */
static cn_status solve_cg(cn_solver *solver, const double *b, double *x, double tolerance, int max_iterations,
                          int *iterations, double *residual, cn_pool *pool)
{
    const bool bounded = solver->sparse && max_iterations > PATIENCE;
    cn_status status = cn_cg_solve(solver->cg, b, x, tolerance, bounded ? PATIENCE : max_iterations,
                                   iterations, residual, pool);

    if (status == CN_OK) solver->pause = solver->pause / 2;
    if (status != CN_ERR_CONVERGENCE || !bounded) return status;
    solver->factored = false;
    if ((status = cn_sparse_factor(solver->sparse, solver->matrix, solver->held)) != CN_OK) return status;
    solver->factored = solver->direct = true;
    solver->pause = solver->pause < PAUSE        ? PAUSE
                    : solver->pause < 64 * PAUSE ? 2 * solver->pause
                                                 : solver->pause;
    solver->direct_left = solver->pause;
    return CN_OK;
}

enum { REFINEMENTS = 3 };

cn_status cn_solver_solve(cn_solver *solver, const double *b, double *x, double tolerance, int max_iterations,
                          int *iterations, double *residual, cn_pool *pool)
{
    const int nactive = solver->nactive;
    cn_status status;

    if (iterations) *iterations = 0;
    if (residual) *residual = INFINITY;
    if (!solver->factored) return CN_ERR_ARG;
    for (int i = 0; i < nactive; i++)
        if (solver->held[i]) x[3 * (size_t)i] = x[3 * (size_t)i + 1] = x[3 * (size_t)i + 2] = 0;
    if (!solver->direct) {
        status = solve_cg(solver, b, x, tolerance, max_iterations, iterations, residual, pool);
        if (status != CN_OK || !solver->direct) return status;
    }
    if ((status = solve_direct(solver, b, x, pool)) != CN_OK) return status;
    if (iterations) ++*iterations;
    if (!residual) return CN_OK;
    *residual = residual_of(solver, b, x, pool);
    for (int k = 0; k<REFINEMENTS && * residual> tolerance; k++) {
        double *d = solver->change;
        memset(d, 0, 3 * (size_t)nactive * sizeof *d);
        if ((status = solve_direct(solver, solver->product, d, pool)) != CN_OK) return status;
        for (int c = 0; c < 3 * nactive; c++)
            d[c] += x[c];
        const double refined = residual_of(solver, b, d, pool);
        if (!(refined < *residual)) break;
        memcpy(x, d, 3 * (size_t)nactive * sizeof *d);
        *residual = refined;
        if (iterations) ++*iterations;
    }
    return CN_OK;
}
