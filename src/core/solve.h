/* solve.h - linear solvers behind one face. CHOLMOD appears in solve_cholesky.c alone. */
#ifndef CN_SOLVE_H
#define CN_SOLVE_H

#include <stdbool.h>
#include "matrix.h"

typedef struct cn_solver cn_solver;

/* kind CN_LINEAR_AUTO picks from the structure: CHAIN where the pattern has a narrow level structure
 * (`level` given: nodes of level l couple to l-1, l, l+1 only, ascending with the node index; e.g. a catheter's
 * stations; NULL: it is looked for), else CHOLESKY. Symbolic analysis once, here. Allocates all it needs. */
cn_status cn_solver_new(cn_solver **out, const cn_matrix *pattern, cn_linear kind, const int *level, cn_error *error);
void cn_solver_free(cn_solver *solver);
cn_linear cn_solver_kind(const cn_solver *solver);

/* Factors the leading nactive block rows of A. `fixed` (n, nonzero: the node is held, its row and column are
 * taken as identity; NULL: none). CN_ERR_SINGULAR when not positive definite: the caller may try another A. For
 * CG this prepares the block-Jacobi preconditioner. */
cn_status cn_solver_factor(cn_solver *solver, const cn_matrix *a, int nactive, const unsigned char *fixed, cn_pool *pool);
/* Solves A x = b with the last factor (fixed entries of x become 0). CG: x holds the warm start, stops at
 * |r| <= tolerance |b| or max_iterations; *iterations and *residual (relative) may be NULL. */
cn_status cn_solver_solve(cn_solver *solver, const double *b, double *x, double tolerance, int max_iterations,
                          int *iterations, double *residual, cn_pool *pool);
#endif
