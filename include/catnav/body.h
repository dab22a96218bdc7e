/* body.h - a deformable body of tetrahedra, a rod, or molecules: elastic energy, force, stiffness, and what
 * limits measure.
 *
 * cn_body does not change in a run; every later call takes it const, so threads share it. What changes is
 * the caller's x. SI units; node i lies at x[3*i .. 3*i+2]; forces act ON the nodes: f = -dE/dx.
 * Corotational linear elasticity, psi = mu |F-R|^2 + la/2 (tr(R'F) - 3)^2, R the nearest proper rotation
 * (signed): Mueller and Gross, Interactive Virtual Materials, GI 2004; exact tangent: Chao et al. 2010,
 * McAdams et al. 2011, eigen-analysis Smith et al. 2019. */
#ifndef CN_BODY_H
#define CN_BODY_H

#include <stdbool.h>
#include "catnav/mesh.h"
#include "catnav/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

struct cn_pool;   /* worker threads: src/core/pool.h */
struct cn_matrix; /* symmetric 3x3-block sparse matrix: src/core/matrix.h */

/* Where a body's element stiffnesses go in one matrix: block indices looked up once. */
typedef struct cn_scatter cn_scatter;

/* Unknowns come in blocks of three: block i < nnode is the position of node i; a rod has as many again, block
 * nnode + i being the rotation vector of node i's frame since the start of the step: x holds it behind the
 * positions, (nblock x 3) in all, and it is zero between steps. `rotation` (nturn x 4 unit quaternions w x y
 * z) is a tetrahedron's warm start of the polar decomposition (tet10: one for each integration point), which
 * calls update; a rod's are its frames at the start of the step (axes n, b, t: t along the rod) and behind
 * them (w 0 0 0), w the share of its rest curvature that is in force (1, but of a steered end); a wall's are
 * the turns and, as many again, the strains of its triangles to which its stiffness belongs, and behind them
 * (1 0 0 0) while triangles count as not turned, (0 1 0 0) since; calls leave them.
 *
 * What walls, frames and rviz see are the points: the nodes themselves, or of a rod the nodes of the
 * tetrahedra that ride on its frames, as many for each node, in the order of the nodes. */
typedef struct {
    cn_body_model model;
    int nnode, nblock, nturn;
    int nelement;       /* what limits name: tetrahedra, a rod's segments, links, a wall's triangles */
    int nper, *connect; /* blocks that each element couples               (nelement x nper) */
    double *rest;       /* rest positions of nodes [m]                    (nnode x 3)    */
    double *mass;       /* lumped node masses [kg]                        (nnode)        */
    double *inertia;    /* rod: of a node about its frame's axes [kg m^2] (nnode x 3)    */
    double damping, damping_stiffness; /* [1/s], [s] */
    double rest_volume;                /* [m^3] */
    double spring;        /* stiffness of elements [N/m], root of the mean square over nodes: for round-off */
    double lever;         /* rod: length that makes moments forces [m]: its mean segment; else 1 */
    int npoint, ntet;     /* points (tetrahedra: nnode), and the tetrahedra over them (walls: none) */
    double *point;        /* their rest positions [m]; tetrahedra: `rest`   (npoint x 3)   */
    int *tet;             /* point indices, positive volume                 (ntet x 4)     */
    int *mid;             /* tet10: amid 01 12 20 03 13 23 (as VTK)         (ntet x 6)     */
    cn_surface *boundary; /* outward triangles over the points (vert is NULL); tet10: four a face */
    int nanchor;          /* molecules: anchors of a point, which lies at sum weight x(anchor); else 0 */
    int *upto;            /* points of the first n nodes, NULL: as many for each node (nnode + 1) */
    int *anchor;          /* the nearest to the point first             (npoint x nanchor) */
    double *weight;       /* their sum 1                                (npoint x nanchor) */
    const struct cn_body_methods *methods; /* of the model (private) */
    /* of tetrahedra */
    double *shape_grad;              /* tet4: gradients of the shape functions [1/m] (ntet x 4 x 3) */
    double *volume;                  /* rest volumes [m^3]                           (ntet)         */
    double *mu, *lambda;             /* Lame constants [Pa]                          (ntet)         */
    struct cn_element_data *element; /* packed per-element constants for the kernels (private) */
    void *own;                       /* what else the model keeps (private) */
} cn_body;

/* Builds a body: tet4, or tet10 where the mesh has `mid`. The mesh is copied. `along` (ntet, distance of the
 * element's centre from the tip, may be NULL) is for regions given along the axis. CN_ERR_MESH: a tetrahedron
 * without volume (<= 1e-14 of the mean); CN_ERR_ARG: young <= 0, poisson outside (-1, 0.5), density < 0, with
 * the value named. */
cn_status cn_body_new(cn_body **out, const cn_tets *mesh, const cn_material *material, const double *along,
                      cn_error *error);
void cn_body_free(cn_body *body); /* NULL is fine */

/* Section of a rod's segment, about its frame's axes n and b; t is along the rod. */
typedef struct {
    double axial;           /* EA [N] */
    double shear[2];        /* k G A against n and b [N] */
    double bending[2];      /* EI of curvature about n and about b [N m^2] */
    double torsion;         /* GJ [N m^2] */
    double line_mass;       /* [kg/m] */
    double line_inertia[3]; /* rho I about n, b and t [kg m] */
    double area;            /* of its wall, without lumen and core: its volume over its length [m^2] */
    bool round;             /* else a rectangle */
    double half[2];         /* half width along n and b [m]; round: both the outer radius */
    double young, poisson;  /* of the outer material: stress and volume change of fibres */
    double bend; /* rest curvature about b [1/m]: going against t it turns towards n; 0: as the axis lies */
    double twist_stress; /* largest shear stress per twist rate [Pa m]: G r, of a rectangle Saint-Venant's */
} cn_section;
/* Of a catheter's circular section (core added by sum; mass of its lumen none) or a beam's rectangle, with
 * Cowper's shear coefficient and Saint-Venant's torsion. young replaces the material's (a region's). */
cn_status cn_section_of(cn_section *out, const cn_shape *shape, const cn_material *material, double young,
                        cn_error *error);
/* A rod along `axis` (nnode >= 2, x 3; its rest shape, straight or bent); t points from node to node as they
 * are numbered: a catheter's from the tip to the base. `normal`: n of the first frame (what of it is across
 * t), the others twist-free. section (nnode - 1). skin: tetrahedra that ride on it, copied, as many nodes for
 * each of the rod's, those of node i in a row (a catheter's stations), or with ride (skin->nnode) the node of
 * each: then points are the skin's nodes sorted by it, in their order otherwise. NULL: the points are the
 * nodes, without tetrahedra. CN_ERR_ARG: a segment without length, a stiffness that is not positive, with its
 * number and value. */
cn_status cn_body_new_rod(cn_body **out, int nnode, const double *axis, const double normal[3],
                          const cn_section *section, const cn_tets *skin, const int *ride,
                          const cn_material *material, cn_error *error);

/* How molecules fill a shape: on a lattice in which neighbours touch, or from a file (molecules.h). */
typedef struct {
    double radius;    /* [m] */
    bool jittered;    /* moved at random from their sites, by at most 0.1 radius */
    const char *file; /* a molecule a line, x y z [m] or x y z r; NULL: packed */
} cn_molecules_spec;
/* Molecules, joined to their neighbours by springs, in a closed surface, which is checked, copied and becomes
 * the boundary, its vertices the points: each hangs on four near molecules, by weights that carry any affine
 * motion exactly. Mass is density times the surface's volume, shared out. surface NULL, with a file: the
 * spheres' own volume, and the points are the molecules, without triangles. Springs along links give Young's
 * modulus as asked and Poisson's ratio 1/4, whatever the material's (said in a log message). Errors as of
 * cn_body_new; also of the surface (mesh.h), the file, a radius that is too large or too small. */
cn_status cn_body_new_molecules(cn_body **out, const cn_surface *surface, const cn_molecules_spec *spec,
                                unsigned seed, const cn_material *material, cn_error *error);

/* A deformable vessel wall (spec->model membrane or shell): nodes are the surface's vertices, elements its
 * triangles, of uniform thickness, each node on springs foundation * area in all three directions. While its
 * triangles count as not turned, or with rotation NULL, strain is small and about the rest shape, the
 * stiffness its derivative; a part that turns by an angle a then shows a strain of 1 - cos a, about a^2 / 2.
 * Once they count as turned, strain is that of each triangle's own axes, and the stiffness the one of rest,
 * turned as the rotations say, with the tension of the strains there. Either way it does not change with x,
 * is the same for every cn_tangent and positive semidefinite, and a wall is active as a whole (nactive is not
 * read). A membrane has plane stress alone; a shell bends too, without rotational unknowns: rims turn freely,
 * also where their positions are held. The surface is copied, its vertices merged by the caller
 * (cn_surface_check), wound either way; a vertex of no triangle stays where it is. CN_ERR_ARG: thickness,
 * young, poisson, density or foundation out of range, the value named; CN_ERR_MESH: a triangle without area
 * (<= 1e-14 of the mean), a vertex that is not finite, in a shell an edge of three triangles. */
cn_status cn_body_new_wall(cn_body **out, const cn_surface *surface, const cn_wall_spec *spec,
                           cn_error *error);
/* Which of a wall's vertices lie on rims: edges of one triangle. on_rim (nnode) becomes 1 or 0. */
void cn_body_wall_rims(const cn_body *body, unsigned char *on_rim);

/* All elements whose nodes have index < nactive take part (a catheter's sheathed end does not: its nodes come
 * last). `rotation` (nturn x 4) starts as cn_body_rotation_start leaves it: identities, a rod's rest frames.
 */
void cn_body_rotation_start(const cn_body *body, double *rotation);

typedef enum { CN_TANGENT_WARPED, CN_TANGENT_EXACT, CN_TANGENT_PROJECTED } cn_tangent;

/* Looks up the body's blocks in a matrix where its node i is block row first_node + i. CN_ERR_ARG: a block is
 * missing from the pattern. The matrix stays the caller's and must outlive the scatter, which writes to it.
 */
cn_status cn_body_bind(cn_scatter **out, const cn_body *body, struct cn_matrix *matrix, int first_node);
void cn_scatter_free(cn_scatter *scatter); /* NULL is fine */

/* Adds the elastic force [N] to f and returns the elastic energy [J]. With `stiffness` not NULL also adds
 * scale * K (K = d2E/dx2 [N/m], positive semidefinite unless EXACT; where two singular values of F sum to
 * nothing the tangent is bounded) to the matrix it was bound to. x, f and nactive are the body's own: in a
 * system of several bodies pass x + 3 * first_node. Pool NULL: one thread; the result is bit-identical for
 * any thread count: the elements lie in fixed chunks, coloured so that those of a colour share no node, and
 * colours follow each other. Allocates nothing. Non-finite x gives a non-finite energy. */
double cn_body_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                           cn_tangent tangent, double scale, const cn_scatter *stiffness,
                           struct cn_pool *pool);
double cn_body_energy(const cn_body *body, int nactive, const double *x, double *rotation,
                      struct cn_pool *pool);

/* What limits measure, from the rotated-back displacement. */
typedef struct {
    double volume_max;
    int volume_element; /* max |1 - V/V0| */
    double volume_mean; /* |mean(1 - V/V0)| */
    double stress_max;
    int stress_element; /* max von Mises [Pa] */
    double stress_mean;
    double energy; /* elastic [J] */
    int inverted;  /* elements with V <= 0 (tet10: at any integration point) */
    double volume; /* now [m^3] */
} cn_measures;
/* Of molecules: `volume` is the strain |l / L - 1| of links (the largest, and |mean(l/L - 1)|: a uniform
 * change of volume is three times as large), the volume now by the trace of strain that links show at each
 * molecule; stress is a molecule's, von Mises of the virial sum_j f d' / (2 V), named by its most stretched
 * link (mean: of molecules); inverted: whose frame neighbours span the other way round. Of an element: tet4
 * its own; tet10 volume by integration, the largest stress of its integration points; rod by its section
 * strains: volume (1 - 2 nu) |strain| of the outermost fibre (mean: of the axis), von Mises of fibre stress
 * and twist's shear; wall volume change (1 - 2 nu) / (1 - nu) (e_xx + e_yy) in its plane, the thickness
 * following in plane stress, von Mises of plane stress, both at the worse face where a shell bends (mean
 * volume: amid its thickness), energy with the foundation's. von_mises (ntet, may be NULL) [Pa]: of a rod,
 * what its section has at each tetrahedron's centre; of a wall (nelement). Inactive elements count as at
 * rest. Allocates nothing. */
void cn_body_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                     cn_measures *measures, double *von_mises, struct cn_pool *pool);

/* Points at x [m]: tetrahedra return x itself; a rod fills `points` (npoint x 3), those of nodes < nactive,
 * and returns it. */
const double *cn_body_points(const cn_body *body, int nactive, const double *x, const double *rotation,
                             double *points);
/* Points that belong to the first n nodes, and the node of a point. */
int cn_body_points_of(const cn_body *body, int n);
int cn_body_node_of(const cn_body *body, int point);
/* Cells that frames show and von_mises is of: the tetrahedra, or of a body without any its boundary's
 * triangles. */
int cn_body_cells(const cn_body *body);
/* How points hang on blocks at x: point p moves by d x(block node) + arm d x(block node + nnode), or, with
 * nper > 0, by sum_k weight d x(anchor), of a rod besides arm_k d x(anchor + nnode). */
typedef struct {
    const int *node;   /* (npoint) */
    double *arm;       /* 3x3 row-major [m] (npoint x max(nper, 1) x 9), filled by cn_body_carry, or NULL */
    int turn;          /* first rotation block: nnode */
    int nper;          /* 0: one node and its arm */
    const int *anchor; /* the body's (npoint x nper) */
    const double *weight; /* the body's (npoint x nper) */
} cn_carry;
cn_status cn_carry_new(cn_carry **out, const cn_body *body); /* *out NULL where the points are the nodes */
void cn_carry_free(cn_carry *carry);
void cn_body_carry(const cn_body *body, int nactive, const double *x, const double *rotation,
                   cn_carry *carry);
/* Adds forces on the points (npoint x 3) [N] to those on blocks, f (nblock x 3); with `a` also the part of
 * minus their derivative that comes from the turning of arms, times scale, to its diagonal blocks. */
void cn_body_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                  const cn_carry *carry, const double *force, double *f, double scale, struct cn_matrix *a);
/* Takes x's rotation vectors into the frames, and sets them to zero: the end of a step. */
void cn_body_turn(const cn_body *body, int nactive, double *x, double *rotation);
/* Adds to each point its share of a uniform traction [m^2 at 1 Pa] on the outer faces whose points are all
 * inside (npoint): consistent loads. */
void cn_body_face_shares(const cn_body *body, const unsigned char *inside, double *share);
/* Centre of an element; NAN for a negative index. */
void cn_body_element_centre(const cn_body *body, const double *x, int element, double centre[3]);

/* Bending, torsion and axial stiffness of the mesh over beam theory of the true section, minus one (of the
 * two bending directions the one further off; a catheter's core, which the mesh does not have, belongs to the
 * truth). Made by static solves on a clamped piece of the chain, a few ms for a catheter; NAN where it is
 * no beam. A beam of many cells is solved coarser and its error scaled with the square of the cell (tet10:
 * the fourth power). A rod has its section by construction: zeros. `polygon_*`: the part of it that the
 * polygonal section alone would give with exact elements (torsion: NAN for a hollow one). */
typedef struct {
    double bending, torsion, axial;
    double polygon_bending, polygon_torsion, polygon_axial;
} cn_beam_error;
cn_status cn_beam_error_catheter(const cn_shape *shape, const cn_material *material, cn_body_model model,
                                 cn_beam_error *out);
cn_status cn_beam_error_beam(const cn_shape *shape, const cn_material *material, cn_body_model model,
                             cn_beam_error *out);

#ifdef __cplusplus
}
#endif
#endif
