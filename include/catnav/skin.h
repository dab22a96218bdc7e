/* skin.h - a fine surface carried by a coarse body: positions, face normals and vertex normals follow what it
 * hangs on; forces on it go back.
 *
 * cn_skin does not change in a run; what changes is cn_skin_state. SI units. An anchor is a place with a
 * rotation: a rod's frame, a molecule's, a node of tetrahedra with the rotation of the elements around it.
 * Egger, Skinning a Deformation Model (EPFL 2004), 2.4.1: a vertex has places in the original frames of its n
 * nearest anchors that stay the same, and is where their average has it,
 *     x = sum_j w_j (p_j + R_j r_j),   r_j = R0_j' (X - p0_j).
 * Egger gives no weights, but that the nearer anchor counts more. Here (Franke and Nielson 1980; d_j rest
 * distance, D that of anchor n + 1)
 *     w_j ~ ((D - d_j) / (D d_j))^2,
 * normalised to sum 1: an anchor's weight is nothing where another takes its place, so that the skin has no
 * jump. D is taken 1e-6 farther, which settles ties; without an anchor n + 1 it is infinite; a vertex on an
 * anchor hangs on it alone. */
#ifndef CN_SKIN_H
#define CN_SKIN_H

#include "catnav/body.h"
#include "catnav/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CN_SKIN_ANCHORS 8 /* most of a vertex */

/* CN_SKIN_BLEND: on nearest anchors, as above. CN_SKIN_EMBED: on the nodes of its tetrahedron, by its shape
 * functions: x = sum_a N_a p_a. */
typedef struct {
    cn_skin_kind kind;
    int nvert, ntri, nanchor; /* anchors: of EMBED the nodes */
    int nper;                 /* anchors of a vertex; tetrahedra 4, of second order 10 */
    double centre[3];         /* mean of the vertices at rest [m] */
    double reach;             /* farthest vertex: from its nearest anchor, or outside its tetrahedron [m] */
    int *tri;                 /* (ntri x 3) */
    /* rows: vertices in the order of their first anchors; row r is vertex vertex[r] */
    int *vertex;    /* (nvert)         */
    double *rest;   /* from the centre [m] (nvert x 3) */
    int *anchor;    /* BLEND: nearest first (nvert x nper) */
    double *weight; /* sum 1 in a row (nvert x nper) */
    /* of BLEND */
    double *place;    /* anchors at rest from the centre [m] (nanchor x 3) */
    double *rotation; /* their matrices R0' (nanchor x 9) */
    /* triangles around vertex v: around[first[v]] .. around[first[v + 1] - 1], ascending */
    int *first, *around; /* (nvert + 1), (3 ntri) */
} cn_skin;

/* Hangs a surface on its n (1..CN_SKIN_ANCHORS) nearest anchors, or on all where there are fewer. place
 * (nanchor x 3) [m]; rotation (nanchor x 4 unit quaternions w x y z), NULL: identities. All is copied.
 * O((nvert + nanchor) log nanchor). CN_ERR_ARG: n out of range, no anchors, a quaternion without length;
 * CN_ERR_MESH: no triangles, an index out of range; CN_ERR_NOT_FINITE. *out is NULL on failure. */
cn_status cn_skin_new(cn_skin **out, const cn_surface *surface, int nanchor, const double *place,
                      const double *rotation, int n, cn_error *error);
/* Embeds a surface: each vertex in the tetrahedron it lies in, or the nearest one, from where its shape
 * functions are continued linearly. Any affine motion of the nodes is the skin's, to rounding (second order:
 * where the nodes amid edges lie there at rest). CN_ERR_MESH also: no tetrahedron with a volume. */
cn_status cn_skin_new_embedded(cn_skin **out, const cn_surface *surface, const cn_tets *tets,
                               cn_error *error);
void cn_skin_free(cn_skin *skin); /* NULL is fine */

/* Faces and vertices without area have zeros for normals. */
typedef struct {
    double *x;      /* vertices [m]                                          (nvert x 3)    */
    double *face;   /* unit normal and area [m^2]                            (ntri x 4)     */
    double *normal; /* unit, mean of the faces around weighted by their areas (nvert x 3)   */
    double *frame;  /* BLEND: columns of A and b in x = A X + b, padded by 0 (nanchor x 16) */
} cn_skin_state;
cn_status cn_skin_state_new(cn_skin_state **out, const cn_skin *skin, cn_error *error); /* all zero */
void cn_skin_state_free(cn_skin_state *state);                                          /* NULL is fine */

/* Takes the anchors' places now [m] (nanchor x 3) and, of BLEND, rotations (nanchor x 4; NULL: identities, as
 * at construction), which need not be unit. CN_ERR_NOT_FINITE: a number is not finite, or a quaternion has no
 * length; vertices and normals stay as they were. Pool NULL: one thread; bit-identical for any thread count.
 * Allocates nothing. */
cn_status cn_skin_update(const cn_skin *skin, const double *place, const double *rotation,
                         cn_skin_state *state, struct cn_pool *pool);

/* The transposed map: adds forces on the vertices (nvert x 3) [N] to those on the anchors (nanchor x 3), each
 * by its weight. moment (nanchor x 3) [N m], about each anchor, may be NULL and stays as it is for EMBED:
 * with it virtual work is kept, and so are the sums of force and of moment. `place` are the anchors' places
 * of the last update. Allocates nothing. */
void cn_skin_pull(const cn_skin *skin, const cn_skin_state *state, const double *place, const double *force,
                  double *to, double *moment);

/* What contact meets where it is the skin that it acts on: a body without elements whose points are the
 * skin's vertices, those first that hang on the leading nodes alone; its boundary is the skin, its volume
 * what that encloses (0: open), and cn_body_points, cn_carry_new, cn_body_carry, cn_body_pull are the map and
 * its transpose. They agree but for a blended skin on nodes that have no rotations: that lies where it is
 * shown, and is taken to move by the weights alone, which is no gradient of where it lies. `on` and the skin
 * must outlive it. cn_body_points uses scratch of its own: not for two threads at once. CN_ERR_MEMORY. */
cn_status cn_skin_touch(cn_body **out, const cn_skin *skin, const cn_body *on);
/* Whether they agree. */
bool cn_skin_moves_by_weights(const cn_skin *skin, const cn_body *on);
/* Embeds a surface in molecules: each vertex on four near ones, by weights that carry any affine motion
 * exactly. CN_ERR_ARG: no molecules; CN_ERR_MESH also: those near a vertex lie in a plane. */
cn_status cn_skin_new_molecules(cn_skin **out, const cn_surface *surface, const cn_body *body,
                                cn_error *error);

/* Rotations of a body's nodes as anchors at x (turn: nnode x 4 unit quaternions). A rod's are its frames at
 * the start of the step, which are those at x between steps (rest: cn_body_rotation_start); molecules' those
 * of their local frames. Tetrahedra: the normalised sum of the rotations (nturn x 4) of the elements around,
 * of second order of their integration points, each with the sign that points the way of the sum so far.
 * Nodes of no element keep the identity. */
void cn_skin_rotations(const cn_body *body, const double *x, const double *rotation, double *turn,
                       struct cn_pool *pool);

/* Von Mises stress at the vertices of a body's skin (nvert) [Pa]: a node has the largest of the cells (of
 * cn_body_cells) it belongs to, itself or with a point that hangs on it first (nodes: nnode, filled), a
 * vertex that of its anchors by their weights, not below zero. von_mises as cn_body_measure fills it; NULL:
 * zeros. Allocates nothing. */
void cn_skin_stress(const cn_skin *skin, const cn_body *body, const double *von_mises, double *nodes,
                    double *stress);

/* Largest angle [rad] between the normals of two triangles with a common edge; those without area are passed
 * over. 0 where there is no such edge. CN_ERR_MEMORY. */
cn_status cn_skin_sharpest(const cn_skin *skin, const cn_skin_state *state, double *angle);

/* A closed, smooth surface about spheres (centre (n x 3) [m], radius (n) [m]): where
 *     sum_i (1 - |x - c_i|^2 / (2.5 r_i)^2)^3 = (1 - 1 / 2.5^2)^3   (of terms within 2.5 r_i)
 * (Wyvill, McPheeters and Wyvill, Data structure for soft objects, 1986, with a simpler kernel), on a grid of
 * cells by marching tetrahedra, then evened out along the surface; hollows without a way out are filled. A
 * sphere by itself keeps its radius (the polyhedron has 0.14 (cell / r)^2 less volume); two of equal size
 * join where the centres are nearer than 2.88 r; on a square layer 2 r apart the surface lies 0.97 to 1.05 r
 * above it. Manifold, outward, without double or unused vertices. cell 0: half the least radius. CN_ERR_ARG:
 * no spheres, a radius or a cell out of range, a grid of more than 2^25 points, with numbers;
 * CN_ERR_NOT_FINITE. */
cn_status cn_surface_about_spheres(cn_surface **out, int n, const double *centre, const double *radius,
                                   double cell, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
