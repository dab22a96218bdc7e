/* solve_parts.h - the solvers that solve.c chooses from. Each takes the held nodes (n, nonzero: row and
 * column are identity: fixed or not active) apart from the matrix, and is analysed once, factored and solved
 * many times; factor and solve allocate nothing of their own. The matrix given to factor must live until the
 * last solve. */
#ifndef CN_SOLVE_PARTS_H
#define CN_SOLVE_PARTS_H

#include "solve.h"

/* A pivot that is not above this part of its row's own diagonal entry is rounding: not positive definite. */
#define CN_PIVOT_MIN 4e-15

/* Whether `level` (n, >= 0) is such a structure. */
bool cn_levels_check(const cn_matrix *pattern, const int *level);
/* Eliminating a level of m unknowns with `next` in the next one [multiplications and additions]. */
static inline double cn_level_flops(double m, double next)
{
    return m * m * m / 3 + m * m * next + m * next * next;
}
/* Flops of one factorisation by levels [multiplications and additions], and the factor's doubles. */
cn_status cn_levels_cost(const cn_matrix *pattern, const int *level, double *flops, double *size);

/* Block-tridiagonal Cholesky from both ends of the levels to a fixed meeting level. `width`: widest vector to
 * use in doubles (8: AVX-512, 4: AVX2, 2), 0: the machine's best. */
typedef struct cn_chain cn_chain;
cn_status cn_chain_new(cn_chain **out, const cn_matrix *pattern, const int *level, int width);
void cn_chain_free(cn_chain *chain);
cn_status cn_chain_factor(cn_chain *chain, const cn_matrix *a, const unsigned char *held, cn_pool *pool);
void cn_chain_solve(cn_chain *chain, const double *b, double *x,
                    cn_pool *pool); /* held x: left as they are */

/* Block-tridiagonal Cholesky of 6x6 blocks, on one thread: levels of two block rows each, as a rod's stations
 * have (position and rotation; 80 ns a station, factor and solve). *out is NULL with CN_OK where levels are
 * others. width as above. */
typedef struct cn_ladder cn_ladder;
cn_status cn_ladder_new(cn_ladder **out, const cn_matrix *pattern, const int *level, int width);
void cn_ladder_free(cn_ladder *ladder);
cn_status cn_ladder_factor(cn_ladder *ladder, const cn_matrix *a, const unsigned char *held);
void cn_ladder_solve(cn_ladder *ladder, const double *b, double *x); /* held x: left as they are */

/* CHOLMOD, analysed over the whole pattern: held nodes are eliminated as identity rows and save no time. */
typedef struct cn_sparse cn_sparse;
cn_status cn_sparse_new(cn_sparse **out, const cn_matrix *pattern);
void cn_sparse_free(cn_sparse *sparse);
void cn_sparse_cost(const cn_sparse *sparse, double *flops, double *size, bool *supernodal);
cn_status cn_sparse_factor(cn_sparse *sparse, const cn_matrix *a, const unsigned char *held);
cn_status cn_sparse_solve(cn_sparse *sparse, const unsigned char *held, const double *b, double *x);
/* Its factor L, A = L L' of the rows and columns in the order of `node`: blocks of columns with one pattern,
 * column by column, their rows beginning with the columns themselves. Valid until the next factor. */
typedef struct {
    int n, nblock;
    const int *node;          /* at a place in the order (n) */
    const int *first;         /* column with which a block begins (nblock + 1); NULL: block b is column b */
    const int *row_at, *nrow; /* where its rows begin, and how many; nrow NULL: up to the next one's */
    const int *value_at;      /* where its first column begins; each has nrow values */
    const int *row;
    const double *value;
} cn_factor_view;
cn_factor_view cn_sparse_view(const cn_sparse *sparse);

/* Columns of A^-1 for the unknowns of a few nodes at once, as far as they reach (solve_columns.c): blocks of
 * L whose rows further on are negligible are passed over, so that time goes with what there is to see. */
enum { CN_COLUMN_NODES = 8, CN_COLUMNS = 3 * CN_COLUMN_NODES };
typedef struct {
    double *x;          /* column 3 k + c of place q's component r: x[(3 q + r) CN_COLUMNS + 3 k + c] */
    int nplace, *place; /* places in the order of which x holds rows; the others are negligible */
    const int *node;    /* at each place (n) */
    /* private */
    void *memory;
    int n, *place_of, *block_of;  /* of a node (n), of a column (3 n) */
    unsigned char *seen, *active; /* (n), (blocks) */
    void (*solve)(const cn_factor_view *l, const int *block_of, double drop, unsigned char *active,
                  double *x);
} cn_columns;
/* Workspace; `most`: of the instruction sets, as cn_kernels_pick. */
cn_status cn_columns_new(cn_columns **out, const cn_sparse *sparse, int most);
void cn_columns_free(cn_columns *columns); /* NULL is fine */
/* For `count` nodes with the last factor, for which `held` were held (their columns are zero). Negligible is
 * below drop times the column's diagonal entry in every column. Allocates nothing. */
void cn_columns_solve(cn_columns *columns, const cn_sparse *sparse, const unsigned char *held, int count,
                      const int *node, double drop);

/* Aggregates of nodes, each moved as a rigid body: the coarse space Z of a two-level preconditioner. */
typedef struct cn_coarse cn_coarse;
cn_status cn_coarse_new(cn_coarse **out, const cn_matrix *pattern);
void cn_coarse_free(cn_coarse *coarse);
/* Factors Z'AZ. x: where the nodes are (n x 3), NULL: not known, aggregates do not turn. held must live until
 * the last solve. */
cn_status cn_coarse_factor(cn_coarse *coarse, const cn_matrix *a, const unsigned char *held, const double *x,
                           cn_pool *pool);
/* Takes Z' r, solves; *dot = Z'r . (Z'AZ)^-1 Z'r. Then cn_coarse_add adds node i's part of Z (Z'AZ)^-1 Z' r.
 */
cn_status cn_coarse_solve(cn_coarse *coarse, const double *r, double *dot, cn_pool *pool);
void cn_coarse_add(const cn_coarse *coarse, int i, double z[3]);

/* Conjugate gradients with the inverted 3x3 diagonal blocks as preconditioner, and with two levels the coarse
 * space's correction, which knows where the nodes are (x, as above). */
typedef struct cn_cg cn_cg;
cn_status cn_cg_new(cn_cg **out, const cn_matrix *pattern, bool two_levels);
void cn_cg_free(cn_cg *cg);
cn_status cn_cg_factor(cn_cg *cg, const cn_matrix *a, int nactive, const unsigned char *held, const double *x,
                       cn_pool *pool);
cn_status cn_cg_apply(cn_cg *cg, const double *r, double *z, cn_pool *pool); /* z = M^-1 r */
cn_status cn_cg_solve(cn_cg *cg, const double *b, double *x, double tolerance, int max_iterations,
                      int *iterations, double *residual, cn_pool *pool);

#endif
