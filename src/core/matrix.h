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

/* Pattern: nodes joined by a tetrahedron of one of the bodies (body b's nodes start at first[b]). */
cn_status cn_matrix_new(cn_matrix **out, int nbody, const cn_body *const *body, const int *first);
void cn_matrix_free(cn_matrix *matrix);
void cn_matrix_clear(cn_matrix *matrix, int nactive); /* zeroes block rows [0, nactive) */
/* Index of block (i, j), -1 if not in the pattern. Binary search. */
int cn_matrix_find(const cn_matrix *matrix, int i, int j);
/* y = A x over the leading nactive block rows and columns. */
void cn_matrix_multiply(const cn_matrix *matrix, int nactive, const double *x, double *y, cn_pool *pool);

#endif
