/* shapes.h - small meshes for tests, made in code or read from the reference folder; files of that folder. */
#ifndef SHAPES_H
#define SHAPES_H

#include <stdio.h>
#include "catnav/mesh.h"

/* The caller frees with cn_tets_free. A mesh that cannot be made ends the test. */
cn_tets *shape_tet(double size);                      /* corner tetrahedron: nodes 0, x, y, z */
cn_tets *shape_box(int nx, int ny, int nz, double h); /* Kuhn cells of size h, inner nodes shaken by h/5 */
/* Prism chain along z: `stations` sections of an axis node and `sides` nodes on the circle, the tip (z = 0)
 * first, each prism cut by the lowest-index rule: 455, 6 is the paper's catheter. */
cn_tets *shape_chain(int stations, int sides, double spacing, double radius);

/* Tetrahedron i of nodes that are placed, turned where its volume would be negative. */
void shape_put(cn_tets *tets, int i, int a, int b, int c, int d);

/* NULL where the reference folder (CATNAV_REFERENCE, else the repo's copy) does not hold the file. */
FILE *reference_open(const char *name);    /* such as "data/patch_test.json" */
cn_tets *reference_mesh(const char *name); /* such as "patch": meshes/patch.txt */

/* Repeatable numbers in [-1, 1). */
double shape_random(unsigned *seed);
void shape_rotation(unsigned *seed, double r[9]); /* a proper rotation */

#endif
