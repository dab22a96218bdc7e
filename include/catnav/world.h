/* world.h - what does not depend on the request: checked walls with their trees, and the map of the free
 * space. Built once per scene and mesh, then const: threads share it. */
#ifndef CN_WORLD_H
#define CN_WORLD_H

#include <stdbool.h>
#include "catnav/mesh.h"
#include "catnav/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

struct cn_tree;   /* AABB tree over triangles: src/core/tree.h */
struct cn_octree; /* pruned octree of the free space: include/catnav/octree.h */

typedef struct {
    const cn_surface_spec *spec; /* the scene's, not owned */
    char *name;
    bool vessel;          /* free space inside, else outside */
    bool closed;          /* an open obstacle is a two-sided wall, tested for crossing only */
    cn_surface *surface;  /* merged, outward, metres; vessels: caps are not part of it */
    struct cn_tree *tree; /* over surface */
    int ncap;             /* virtual caps of a vessel's loops, for inside tests only */
    cn_surface *caps;     /* NULL if none; outward normals */
    int *cap_of;          /* loop of each cap triangle (caps->ntri) */
    double (*cap)[7]; /* centre, unit normal (outward), radius of each cap (ncap); the radius reaches all of
                         the loop, the centre lies level with its innermost vertex */
    struct cn_tree *cap_tree; /* over caps, NULL if none */
    bool half_space;          /* a plane: what lies behind it is not free either */
    double plane[6];          /* its point and unit normal */
    double middle[3];         /* of the surface's box */
    cn_doctor doctor;
} cn_wall;

/* The map of the free space: cells of the lumen, clearance, ridge. Opaque: src/core/map.c. */
typedef struct cn_map cn_map;

typedef struct cn_world {
    const cn_scene *scene; /* not owned */
    int nwall;
    cn_wall *wall; /* vessels first, then obstacles, in scene order */
    int nvessel;
    double min[3], max[3];    /* box of everything, walls and bodies' waypoints */
    cn_map *map;              /* NULL until cn_world_map */
    double map_s;             /* wall time its making took [s] */
    struct cn_octree *octree; /* attached by cn_octree_attach, NULL before */
    void (*octree_free)(struct cn_octree *octree);
    /* Set by a program that has the octree room (cn_octree_attach): a run calls it once the map is made. */
    cn_status (*octree_attach)(struct cn_world *world, cn_error *error);
} cn_world;

/* A surface that takes the place of the scene's vessel of that name (or of its only one when "" ). */
typedef struct {
    const char *name;
    const cn_surface *surface;
} cn_replacement;

/* Reads, places, checks every vessel and obstacle. The scene must outlive the world. */
cn_status cn_world_new(cn_world **out, const cn_scene *scene, int nreplacement,
                       const cn_replacement *replacement, cn_error *error);
void cn_world_free(cn_world *world);

/* A rigid obstacle that goes along a path: its box's centre goes from where it is through the waypoints, at
 * their speed, and stays at the last. shift [m]: from the surface as it is at t = 0. What follows here knows
 * only walls that rest: no free place, distance or map depends on where one that moves begins. */
bool cn_wall_moves(const cn_wall *wall);
void cn_wall_shift(const cn_wall *wall, double time, double shift[3]);
double cn_wall_arrives(const cn_wall *wall); /* time from which on it rests [s] */

/* Makes the map for a device of this radius (cell: scene's planner.resolution, or auto: a fraction of the
 * radius, at most 0.25 mm for a vessel of the demo's size). At most `threads` threads; same result for any.
 */
cn_status cn_world_map(cn_world *world, double device_radius, int threads, cn_error *error);

/* Refuses a lumen whose median diameter is not 0.5 to 200 times the device's: a mesh in the wrong unit. CN_OK
 * without vessels or map. */
cn_status cn_world_fits(const cn_world *world, double diameter, cn_error *error);

/* Exact tests against the triangles (not the map). */
/* True when p is in the free space: inside the union of vessels (caps close open ends; beyond a cap lies the
 * corridor along its normal within its radius) and outside every closed obstacle. Robust: exact predicates.
 */
bool cn_world_free_at(const cn_world *world, const double p[3]);
/* The same answer, quickly where the map knows it: for many points a step. */
bool cn_world_free_fast(const cn_world *world, const double p[3]);
/* Distance to the nearest wall triangle [m]; *iwall, *itri, nearest[3] may be NULL. INFINITY without walls.
 */
double cn_world_distance(const cn_world *world, const double p[3], int *iwall, int *itri, double nearest[3]);

/* --- the map, for planner and pictures --- */
double cn_map_cell(const cn_map *map); /* [m] */
/* Lower bound on the clearance [m] at p, never above the true one: a sixth of a cell below on average, at
 * most two cells within six cells of a wall, a tenth on the axis of a wide vessel. 0 outside the free space
 * and the map. */
double cn_map_clearance(const cn_map *map, const double p[3]);
/* Cells on the ridge of the distance field (the medial axis): n, positions (n x 3), clearances (n). Sorted,
 * the same for any thread count. Owned by the map. */
int cn_map_ridge(const cn_map *map, const double **x, const double **clearance);
/* Free cells as maximal axis-aligned cubes of 2^level cells, depth first: what an octree is built from.
 * Calls visit(user, corner index[3], level) for each. */
typedef void (*cn_map_visit)(void *user, const int corner[3], int level);
void cn_map_visit_cubes(const cn_map *map, cn_map_visit visit, void *user);
void cn_map_frame(const cn_map *map, double origin[3], int size[3]); /* corner of cell 0 0 0; cells a side */
/* Narrowest place on the widest route through the free space between a and b: its radius [m] and position;
 * 0 when the map does not join them at all (position: where the reachable part ends nearest to b). */
double cn_map_pinch(const cn_map *map, const double a[3], const double b[3], double where[3]);

#ifdef __cplusplus
}
#endif
#endif
