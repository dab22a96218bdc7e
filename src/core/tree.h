/* tree.h - AABB tree over triangles: built top-down in O(n log n), refitted bottom-up in O(n)
 * (van den Bergen, Efficient Collision Detection of Complex Deformable Models using AABB Trees, JGT 1997). */
#ifndef CN_TREE_H
#define CN_TREE_H

#include <stdbool.h>
#include "catnav/status.h"

typedef struct cn_tree cn_tree;

/* Triangles (ntri x 3) index vert (x 3), which is not copied and must outlive the tree or its next refit. No
 * triangle at all is fine. *out is NULL on failure: CN_ERR_ARG (negative count or index), CN_ERR_NOT_FINITE,
 * CN_ERR_MEMORY. Queries allocate nothing and are thread-safe. */
cn_status cn_tree_new(cn_tree **out, int ntri, const int *tri, const double *vert);
void cn_tree_free(cn_tree *tree);
void cn_tree_refit(cn_tree *tree, const double *vert); /* new positions, same triangles */
/* Boxes swept over the motion vert -> vert_end and inflated by margin; other queries then see vert. */
void cn_tree_refit_swept(cn_tree *tree, const double *vert, const double *vert_end, double margin);
/* The same, and more: boxes that hold as long as each vertex stays within slack of this motion, along each
 * axis. Where the last such call's still hold, for no more margin, nothing is done: other queries see vert.
 */
void cn_tree_refit_loose(cn_tree *tree, const double *vert, const double *vert_end, double margin,
                         double slack);

/* Triangles whose boxes meet [min, max], at most `capacity` written, ascending order not promised but fixed;
 * returns the number found (may exceed capacity: the caller's list was too short). */
int cn_tree_query_box(const cn_tree *tree, const double min[3], const double max[3], int capacity, int *out);
/* All pairs of triangles of two trees whose boxes, the first's inflated by margin, meet: visit returns false
 * to stop. Self: each unordered pair once. */
typedef bool (*cn_pair_visit)(void *user, int ia, int ib);
bool cn_tree_query_pairs(const cn_tree *a, const cn_tree *b, double margin, cn_pair_visit visit, void *user);
bool cn_tree_query_self(const cn_tree *tree, double margin, cn_pair_visit visit, void *user);
/* Nearest triangle to p no farther than `limit`: returns the distance (limit if none), *itri (-1 if none; the
 * least index of equally near ones) and the nearest point (untouched if none); both may be NULL. */
double cn_tree_nearest(const cn_tree *tree, const double p[3], double limit, int *itri, double nearest[3]);
/* Crossings of the open segment a-b with the triangles, decided by exact predicates with symbolic
 * perturbation: returns the number of crossings (parity decides inside). */
int cn_tree_crossings(const cn_tree *tree, const double a[3], const double b[3]);
/* True when p is inside the closed surface (and its caps, may be NULL) by exact ray parity. Points exactly on
 * the surface may go either way, always the same. */
bool cn_tree_inside(const cn_tree *tree, const cn_tree *caps, const double p[3]);
/* The same of a closed surface whose triangles lie in several trees. */
bool cn_tree_inside_all(int ntree, const cn_tree *const *tree, const cn_tree *caps, const double p[3]);
void cn_tree_box(const cn_tree *tree, double min[3], double max[3]);

#endif
