/* solve.h - linear solvers behind one face. CHOLMOD appears in solve_cholesky.c alone. */
#ifndef CN_SOLVE_H
#define CN_SOLVE_H

#include <stdbool.h>
#include "matrix.h"

typedef struct cn_solver cn_solver;

/* Finds levels so that nodes of level l couple to l-1, l, l+1 only: breadth first from a node far from the
 * others, component after component. level (n). CN_ERR_MEMORY. */
cn_status cn_levels_find(const cn_matrix *pattern, int *level);

/* kind CN_LINEAR_AUTO picks from the structure: CHAIN where the pattern has a narrow level structure
 * (`level` given: nodes of level l couple to l-1, l, l+1 only, best ascending with the node index; e.g. a
 * catheter's stations; NULL: it is looked for), else CHOLESKY, or for a compact body PCG: CG with
 * block-Jacobi and a coarse space of aggregates that move as rigid bodies; the cheapest by predicted
 * arithmetic. AUTO's PCG has CHOLESKY to fall back on where that fits (up to 12,000 nodes).
 * `level` (n) matters to AUTO and CHAIN alone. Symbolic analysis once, here; allocates all that factor and
 * solve need (but two blocks that CHOLMOD's supernodal module takes in a refactor). *out is NULL on failure.
 * CN_ERR_ARG: levels do not fit. */
cn_status cn_solver_new(cn_solver **out, const cn_matrix *pattern, cn_linear kind, const int *level,
                        cn_error *error);
void cn_solver_free(cn_solver *solver); /* NULL is fine */
cn_linear cn_solver_kind(const cn_solver *solver);

/* Where the nodes are (n x 3), read by later factors: PCG's aggregates turn about their centres. NULL, as at
 * first: they only shift, and more iterations are needed. */
void cn_solver_place(cn_solver *solver, const double *x);

/* Factors the leading nactive block rows of A. `fixed` (n, nonzero: the node is held, its row and column are
 * taken as identity; NULL: none). CN_ERR_SINGULAR when not positive definite (a pivot that is not above 4e-15
 * of its own diagonal entry, or not finite): the caller may try another A. For CG and PCG this prepares
 * the preconditioner, and an indefinite A may show in the solve only. `fixed` is copied; A must stay
 * unchanged until the last solve with it. CHAIN skips what is not active; CHOLESKY eliminates it as identity
 * and saves no time. */
cn_status cn_solver_factor(cn_solver *solver, const cn_matrix *a, int nactive, const unsigned char *fixed,
                           cn_pool *pool);

/* Solves A x = b with the last factor (fixed entries of x become 0; b and x beyond nactive are not touched; x
 * may be b unless by CG, PCG or with `residual`). Bit-identical for any number of threads. CG, PCG: x holds
 * the warm start; stops at |b - A x| <= tolerance |b|, recomputed; CN_ERR_CONVERGENCE after max_iterations
 * and CN_ERR_SINGULAR at negative curvature, both with the last x; CN_ERR_NOT_FINITE. AUTO's PCG that needs
 * more than 250 iterations has CHOLESKY finish, and do the next factors. CHAIN, CHOLESKY: tolerance counts
 * only if `residual` is asked for: above it, up to three steps of iterative refinement are kept as long as
 * they help. What can be reached is about 1e-16 |A||x| / |b|. *iterations (CG's, or solves with the factor)
 * and *residual (|b - A x| / |b|) may be NULL. CN_ERR_ARG: no factor. */
cn_status cn_solver_solve(cn_solver *solver, const double *b, double *x, double tolerance, int max_iterations,
                          int *iterations, double *residual, cn_pool *pool);

/* z = M^-1 r, symmetric positive definite: the direct solvers' solution, of CG and PCG the preconditioner
 * alone (held entries of z become 0). For who iterates over more than one matrix. */
cn_status cn_solver_apply(cn_solver *solver, const double *r, double *z, cn_pool *pool);
#endif
