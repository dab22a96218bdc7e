/* wall_compliance.h - how a wall gives way where it is touched: columns of A^-1 for touched vertices.
 *
 * A (such as M/dt^2 + K of a wall, constant) is factored once; a vertex's three columns are found when it is
 * first touched, with those of its group of neighbours, which cost little more and are touched next. They are
 * kept as long as they fit the memory; those unused for longest make room. Of a vertex's columns the nodes
 * are dropped where no entry is above CN_COMPLIANCE_DROP of its column's largest: a component of a
 * displacement is off by less than about CN_COMPLIANCE_DROP times the sum over all components of force of |f|
 * times the largest entry of their columns. C_TT is symmetric to the last bit, and results do not depend on
 * what was asked for before. One thread. */
#ifndef CN_WALL_COMPLIANCE_H
#define CN_WALL_COMPLIANCE_H

#include <stddef.h>
#include "matrix.h"

#define CN_COMPLIANCE_DROP 1e-6

typedef struct cn_compliance cn_compliance;

/* Factors `a` by CHOLMOD, with the nodes `held` (n, NULL: none) taken out; neither is needed afterwards.
 * `bytes`: memory for columns, taken here (at least for one vertex whose columns reach all nodes); later
 * calls allocate nothing. CN_ERR_SINGULAR: not positive definite; CN_ERR_ARG: too few bytes. */
cn_status cn_compliance_new(cn_compliance **out, const cn_matrix *a, const unsigned char *held, size_t bytes,
                            cn_error *error);
/* Another matrix of the same pattern, with the same nodes held: its factor, and no columns yet. */
cn_status cn_compliance_refactor(cn_compliance *compliance, const cn_matrix *a);
void cn_compliance_free(cn_compliance *compliance); /* NULL is fine */

/* Makes sure of the columns of these vertices; they stay until the next call. CN_ERR_ARG: an index out of
 * range or given twice; CN_ERR_MEMORY: they do not fit all together. */
cn_status cn_compliance_ensure(cn_compliance *compliance, int n, const int *vertex);

/* Of forces f (n x 3) [N] on vertices that the last ensure had (each once): their displacements y (n x 3) [m]
 * under all of them, y = C_TT f. */
void cn_compliance_apply(cn_compliance *compliance, int n, const int *vertex, const double *f, double *y);
/* C_TT itself, dense (3n x 3n). */
void cn_compliance_gather(cn_compliance *compliance, int n, const int *vertex, double *dense);
/* Adds the displacements of all nodes to u (nodes x 3). */
void cn_compliance_spread(const cn_compliance *compliance, int n, const int *vertex, const double *f,
                          double *u);

typedef struct {
    long solves;  /* groups solved for */
    long dropped; /* vertices whose columns made room, or were of an earlier matrix */
    int kept;     /* vertices whose columns are here */
    long nodes;   /* in the columns of all these, */
    size_t bytes; /* and the memory that they take */
} cn_compliance_counts;
cn_compliance_counts cn_compliance_count(const cn_compliance *compliance);

#endif
