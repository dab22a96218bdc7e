/* octree.h - the free space as the leaves of a pruned octree, which the planner draws samples from and asks
 * for membership, and as an OctoMap tree beside one of its medial axis. src/octomap behind a C header: no
 * exception crosses it.
 *
 * Trees lie in the map's frame (cell 0 0 0 at OctoMap's origin, so that the map's cubes are the tree's own
 * leaves); every call here takes and gives points in the world's frame [m]. */
#ifndef CN_OCTREE_H
#define CN_OCTREE_H

#include <stdbool.h>
#include <stddef.h>
#include "catnav/world.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_octree cn_octree;

/* Lists the leaves of a map, which must outlive it; OctoMap's trees are made by the first call that needs
 * them (written, ridge and memory below). CN_ERR_ARG: more than 32,768 cells a side. Threads may share it. */
cn_status cn_octree_new(cn_octree **out, const cn_map *map, cn_error *error);
void cn_octree_free(cn_octree *octree); /* NULL is fine */

/* Builds the octree of the world's map and keeps it there (cn_world.octree), unless it has one. */
cn_status cn_octree_attach(cn_world *world, cn_error *error);

size_t cn_octree_leaves(const cn_octree *octree);       /* pruned leaves of the free space */
size_t cn_octree_ridge_leaves(const cn_octree *octree); /* cells of the medial axis */
size_t cn_octree_memory(const cn_octree *octree);       /* both trees and the sampling table [bytes] */
double cn_octree_volume(const cn_octree *octree);       /* of the free space [m^3] */
bool cn_octree_free_at(const cn_octree *octree, const double p[3]);
bool cn_octree_ridge_at(const cn_octree *octree, const double p[3]);
/* A point of the free space for u (4) in [0, 1): uniform by volume when u is uniform. */
void cn_octree_sample(const cn_octree *octree, const double u[4], double p[3]);

/* Writes a binary tree (.bt) that octovis opens: free space as free leaves, the medial axis as occupied ones.
 * In the map's frame. */
cn_status cn_octree_write(const cn_octree *octree, const char *path, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
