/* mesh_parts.h - what the files of the mesh room share: sorted facets and meshing limits. */
#ifndef CN_MESH_PARTS_H
#define CN_MESH_PARTS_H

#include <stddef.h>
#include "catnav/mesh.h"

/* An edge or a face by its vertex indices, and where it came from. */
typedef struct {
    int key[3]; /* ascending; edges leave key[2] = 0 */
    int item;
} cn_facet;

cn_facet cn_facet_edge(int a, int b, int item);
cn_facet cn_facet_face(int a, int b, int c, int item);
/* Sorts by key, then item; keys lie in [0, nvert). About O(n). CN_ERR_MEMORY leaves the order as it was. */
cn_status cn_facet_sort(int nvert, int n, cn_facet *facet);
/* End of the run of equal keys that starts at i. */
int cn_facet_run(int n, const cn_facet *facet, int i);

/* Disjoint sets: parent starts as 0..n-1. */
int cn_set_find(int *parent, int i);
void cn_set_join(int *parent, int a, int b); /* the smaller root stays */

/* n items of `size` bytes, zeroed, never 0 bytes; NULL when out of memory or overflowing. */
void *cn_array(size_t n, size_t size);

/* Counts and lists the self-crossing pairs of a merged surface: crossing_pairs, crossing. */
cn_status cn_surface_crossings(const cn_surface *surface, cn_doctor *doctor);

/* What the bounding box's diagonal [m] says about the unit. */
void cn_guess_unit(double size, char text[64]);

/* Six times the signed volume of a tetrahedron; positive when d sees a b c counter-clockwise from inside. */
double cn_tet_volume6(const double *a, const double *b, const double *c, const double *d);

/* cn_tets_fill under other limits, by another command. */
typedef struct {
    const char *command;
    double seconds; /* wall clock and processor time */
    double bytes;   /* address space */
} cn_fill_limits;
cn_status cn_tets_fill_by(cn_tets **out, const cn_surface *surface, double max_volume,
                          const cn_fill_limits *limits, cn_error *error);

#endif
