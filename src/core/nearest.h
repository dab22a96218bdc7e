/* nearest.h - the k nearest of many points: a kd tree (Bentley 1975). */
#ifndef CN_NEAREST_H
#define CN_NEAREST_H

#include "catnav/status.h"

typedef struct cn_nearest_tree cn_nearest_tree;

/* Points (n x 3, finite) are copied. O(n log n). CN_ERR_MEMORY. */
cn_status cn_nearest_new(cn_nearest_tree **out, int n, const double *place);
void cn_nearest_free(cn_nearest_tree *tree); /* NULL is fine */
/* The min(k, n) nearest points to p, nearest first and of equally near ones the first by number: their
 * indices and squared distances; returns how many. Thread-safe, allocates nothing. */
int cn_nearest_find(const cn_nearest_tree *tree, const double p[3], int k, int *index, double *square);

#endif
