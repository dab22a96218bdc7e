/* matrix.h - symmetric sparse matrix of 3x3 blocks, both triangles stored by block rows, fixed pattern.
 * What is assembled: A = M/dt^2 + ... + K; what is solved: A x = b by CHOLMOD, CG or the chain solver. */
#ifndef CN_MATRIX_H
#define CN_MATRIX_H

#include "catnav/body.h"
#include "pool.h"

typedef struct cn_matrix {
    int n;         /* block rows (nodes) */
    int nblock;    /* blocks, both triangles and diagonal */
    int *row;      /* row starts                                      (n + 1)      */
    int *col;      /* column of each block, ascending within a row    (nblock)     */
    int *diagonal; /* index of the diagonal block of each row         (n)          */
    double *value; /* blocks, row-major                               (nblock x 9) */
} cn_matrix;

/* Pattern: nodes joined by a tetrahedron of one of the bodies (body b's nodes start at first[b]; only nnode,
 * ntet and tet are read). n = max over b of first[b] + nnode; a node without tetrahedra has its diagonal
 * block alone. *out is NULL on failure; CN_ERR_ARG: an index out of range, or more than 2^31 / 9 blocks. */
cn_status cn_matrix_new(cn_matrix **out, int nbody, const cn_body *const *body, const int *first);
void cn_matrix_free(cn_matrix *matrix);
void cn_matrix_clear(cn_matrix *matrix, int nactive); /* zeroes block rows [0, nactive) */
/* Index of block (i, j), -1 if not in the pattern. Binary search. */
int cn_matrix_find(const cn_matrix *matrix, int i, int j);
/* y = A x over the leading nactive block rows and columns; y beyond them is left. Bit-identical for any
 * number of threads. Allocates nothing; x and y must not overlap. */
void cn_matrix_multiply(const cn_matrix *matrix, int nactive, const double *x, double *y, cn_pool *pool);
/* Its rows [begin, end) on the caller's thread, for who fuses the product with more; rows in slices of 256.
 */
#define CN_MATRIX_SLICE 256
void cn_matrix_multiply_rows(const cn_matrix *matrix, int nactive, int begin, int end, const double *x,
                             double *y);

#endif
