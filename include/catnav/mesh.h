/* mesh.h - surface and tetrahedral meshes: memory, readers, the doctor, filling, swept shapes.
 * Nothing is merged, dropped, split or repaired silently: what a call changes, it counts. */
#ifndef CN_MESH_H
#define CN_MESH_H

#include <stdbool.h>
#include "catnav/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    int nvert;    /* number of vertices */
    int ntri;     /* number of triangles */
    double *vert; /* positions [m]                                  (nvert x 3) */
    int *tri;     /* vertex indices, counter-clockwise from outside (ntri x 3)  */
} cn_surface;

typedef struct {
    int nnode;    /* number of nodes */
    int ntet;     /* number of tetrahedra */
    double *node; /* positions [m]                     (nnode x 3) */
    int *tet;     /* node indices, positive volume     (ntet x 4)  */
    int *mid; /* nodes amid edges 01 12 20 03 13 23 (as VTK) of second-order ones (ntet x 6), NULL: linear */
} cn_tets;

/* Memory. _new leaves the arrays zeroed; _free copes with NULL and half-built. */
cn_status cn_surface_new(cn_surface **out, int nvert, int ntri);
cn_status cn_surface_copy(cn_surface **out, const cn_surface *surface);
void cn_surface_free(cn_surface *surface);
cn_status cn_tets_new(cn_tets **out, int nnode, int ntet);
void cn_tets_free(cn_tets *tets);

/* Reads a surface by its extension and content: .stl (ASCII, binary), .obj, .ply (ASCII, binary),
 * .msh (its triangles). STL facets keep their own corners (3 per facet): merging is the doctor's. Flat convex
 * polygons of OBJ and PLY become fans; fans, lines, points and lower elements left aside are counted in a log
 * message; whatever else cannot be kept (quadrangles of .msh, curves, strips) is refused.
 * Coordinates in the file's unit, double; NaN, Inf, an index out of range, a truncated file, trailing
 * rubbish: CN_ERR_PARSE with file and line (or byte offset). Memory at most 10 x file + 16 MiB. */
cn_status cn_surface_read(cn_surface **out, const char *path, cn_error *error);
/* Reads tetrahedra: .node (with .ele beside it) or .msh (Gmsh 2.2, 4.1, ASCII, binary). */
cn_status cn_tets_read(cn_tets **out, const char *path, cn_error *error);
/* Writes ASCII STL, for tests and tools. */
cn_status cn_surface_write_stl(const cn_surface *surface, const char *path, cn_error *error);

/* The same shape with no edge longer than `longest` [m]: longer ones are halved until none is. The vertices
 * that were there come first. CN_ERR_ARG: not positive, or there would be millions of triangles. */
cn_status cn_surface_cut(cn_surface **out, const cn_surface *surface, double longest);

/* x = R(rotate) (scale X) + translate, in place. */
typedef struct {
    double scale;        /* metres per file unit */
    double rotate[3];    /* rotation vector [rad] */
    double translate[3]; /* [m] */
} cn_placement;
void cn_place_points(const cn_placement *placement, int n, double *points);

/* What a surface is like. Indices are into the merged surface. */
#define CN_DOCTOR_LISTED 16
typedef struct {
    int nvert, ntri;                        /* after merging */
    int merged;                             /* duplicate vertices merged (exactly equal positions) */
    int degenerate;                         /* triangles with a repeated vertex or no area */
    int duplicate;                          /* triangles present twice */
    int unused;                             /* vertices no triangle uses */
    int nonmanifold_edges;                  /* edges of more than two triangles */
    int mixed_edges;                        /* edges both of whose triangles run the same way */
    int loops;                              /* boundary loops */
    double loop_diameter[CN_DOCTOR_LISTED]; /* equal-perimeter circle [m] of the first loops */
    int components;
    int genus; /* of a closed manifold single component, else -1 */
    bool closed, manifold, oriented;
    double volume;                     /* signed [m^3], loops capped by fans; negative: inward */
    bool turned;                       /* uniformly inward orientation was turned outward */
    int crossing_pairs;                /* self-crossing triangle pairs (not sharing a vertex) */
    int crossing[CN_DOCTOR_LISTED][2]; /* the first of them */
    int slivers;                       /* triangles with an angle below 0.5 degrees */
    double min[3], max[3], size;       /* bounding box and its diagonal [m] */
    char unit_guess[64];               /* e.g. "metres", "looks like millimetres: try scale 0.001" */
    int nonmanifold_vertices;          /* vertices whose triangles form more than one fan */
    int mixed_components;              /* closed components whose orientation contradicts their nesting */
    /* the first of each, for the sentences; -1: none */
    int first_degenerate, first_duplicate[2], first_nonmanifold[2], first_mixed[2], first_mixed_component;
    int first_nonmanifold_vertex;
    int loop_edges[CN_DOCTOR_LISTED];        /* edges of the first loops */
    double loop_centre[CN_DOCTOR_LISTED][3]; /* mean of their edges' midpoints, weighted by length [m] */
} cn_doctor;

/* Merges exactly equal vertices (counted), turns uniformly inward orientation (counted), measures the
 * rest. `turn` false leaves inward orientation as it is. The surface is changed in place. Refusals are
 * the caller's: this returns CN_OK for any finite mesh with triangles, CN_ERR_MESH for an empty one. */
cn_status cn_surface_check(cn_surface *surface, bool turn, cn_doctor *doctor, cn_error *error);
/* The refusals of a vessel wall (open allowed, mixed orientation, non-finite, degenerate refused ...) and of
 * a surface to be filled (closed, manifold, no crossing). `name` heads the sentence. */
cn_status cn_doctor_wall(const cn_doctor *doctor, const char *name, cn_error *error);
cn_status cn_doctor_solid(const cn_doctor *doctor, const char *name, cn_error *error);
/* What `catnav check` decides: a closed surface must be fillable, an open one usable as a wall. */
cn_status cn_doctor_usable(const cn_doctor *doctor, const char *name, cn_error *error);
/* One aligned table, or one JSON object; the caller frees. NULL: out of memory. */
char *cn_doctor_text(const cn_doctor *doctor, const char *name);
char *cn_doctor_json(const cn_doctor *doctor, const char *name);

/* Fills a closed surface by the `tetgen` command (temporary folder, time and memory limit), after the
 * crossing test; `max_volume` of one tetrahedron [m^3], 0: the mesher's choice (the surface is kept as it is,
 * so beside large triangles tetrahedra stay larger). Its vertices come first, in the surface's order without
 * the unused ones, exactly where they were. CN_ERR_MESH: refused before; CN_ERR_MESHER: the mesher failed. */
cn_status cn_tets_fill(cn_tets **out, const cn_surface *surface, double max_volume, cn_error *error);
/* Refuses what FEM cannot use (index, zero or negative volume, duplicate, unused node, non-manifold face);
 * negatively oriented tetrahedra are turned and counted in *turned. */
cn_status cn_tets_check(cn_tets *tets, int *turned, cn_error *error);
/* What a tetrahedral mesh is like; indices are the mesh's. */
typedef struct {
    int nnode, ntet, unused;
    int inverted, flat;                    /* negative volume; none (|V| <= 1e-14 of the mean) */
    int nonmanifold_faces;                 /* faces of more than two tetrahedra */
    int components, boundary;              /* joined by faces; outer triangles */
    double volume, volume_min, volume_max; /* total; of one tetrahedron [m^3] */
    double dihedral_min, dihedral_max;
    int dihedral_min_tet, dihedral_max_tet; /* [degrees] */
    double quality_min, quality_mean;
    int quality_min_tet; /* mean ratio, 12 (3 V)^(2/3) / sum of edge^2: 1 regular, 0 flat */
    double aspect_max;
    int aspect_max_tet; /* longest edge / (2 sqrt(6) inscribed radius): 1 regular */
    int slivers;        /* tetrahedra with a dihedral angle below 1 degree */
    double min[3], max[3], size;
    char unit_guess[64];
} cn_tets_doctor;
/* CN_OK for any finite mesh with valid indices. The mesh is not changed. */
cn_status cn_tets_measure(const cn_tets *tets, cn_tets_doctor *doctor, cn_error *error);
char *cn_tets_doctor_text(const cn_tets_doctor *doctor, const char *name, const cn_error *refusal);
char *cn_tets_doctor_json(const cn_tets_doctor *doctor, const char *name, const cn_error *refusal);
/* Outer surface of a tetrahedral mesh: triangles index the same nodes; *out->vert is NULL, nvert = nnode.
 * Outward. */
cn_status cn_tets_boundary(cn_surface **out, const cn_tets *tets);

/* Prism chain of a catheter in its own frame: axis along -z from the tip at the origin (station 0) to the
 * base at z = -length; station j has its axis node first, then `sides` nodes on the circle of `diameter`
 * (hollow: `sides` inner then `sides` outer nodes, no axis node): node = j * per_station + k. Diagonals
 * alternate by a rule that does not favour a bending direction. */
cn_status cn_tets_catheter(cn_tets **out, double length, double diameter, double inner_diameter, int stations,
                           int sides, cn_error *error);
/* The same with a node amid each edge: sections of stations, and between them sections of the edges that join
 * them, 2 stations - 1 in all, of 3 sides + 1 nodes each (hollow: 6 sides), from the tip; node = section *
 * per_section + k, the corner nodes of a station first. All edges are straight, so that every linear strain
 * field is represented however far apart the stations are (curved rims stiffen long elements severalfold),
 * and the rings are wider than the circle by what makes the polygon's second moment the circle's (6
 * sides: 1.098). */
cn_status cn_tets_catheter10(cn_tets **out, double length, double diameter, double inner_diameter,
                             int stations, int sides, cn_error *error);
/* A linear mesh with a node amid each edge (straight); the corner nodes keep their numbers. */
cn_status cn_tets_raise(cn_tets **out, const cn_tets *linear);
/* Box [0,size] cut into cells, six (Kuhn) tetrahedra each, mirrored in odd cells. */
cn_status cn_tets_beam(cn_tets **out, const double size[3], const int cells[3], cn_error *error);
/* Shapes for obstacles and tests; outward. The sphere is an icosphere with its vertices on the radius (the
 * faces lie at most 0.2 % of it inside); the plane one open triangle whose inscribed circle about the point
 * has radius extent. */
cn_status cn_surface_sphere(cn_surface **out, const double centre[3], double radius);
cn_status cn_surface_box(cn_surface **out, const double min[3], const double max[3]);
cn_status cn_surface_plane(cn_surface **out, const double point[3], const double normal[3], double extent);
/* Tube wall swept along axis points (naxis x 3) with inner radius per point: outer (radius + thickness) minus
 * inner when thickness > 0 (closed solid), else one open surface of that radius, oriented outward. Rings
 * stand across the axis, twist-free. */
cn_status cn_surface_tube(cn_surface **out, int naxis, const double *axis, const double *radius,
                          double thickness, int sides);

#ifdef __cplusplus
}
#endif
#endif
