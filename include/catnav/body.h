/* body.h - a deformable body of tetrahedra: elastic energy, force, stiffness, and what limits measure.
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

typedef struct {
    cn_body_model model;
    int nnode, ntet;
    int *tet;                          /* node indices, positive volume          (ntet x 4)     */
    double *rest;                      /* rest positions [m]                     (nnode x 3)    */
    double *shape_grad;                /* gradients of the shape functions [1/m] (ntet x 4 x 3) */
    double *volume;                    /* rest volumes [m^3]                     (ntet)         */
    double *mu, *lambda;               /* Lame constants [Pa]                    (ntet)         */
    double *mass;                      /* lumped node masses [kg]                (nnode)        */
    double damping, damping_stiffness; /* [1/s], [s] */
    double rest_volume;                /* [m^3] */
    cn_surface *boundary;              /* outward triangles over the nodes (vert is NULL) */
    struct cn_element_data *element;   /* packed per-element constants for the kernels (private) */
} cn_body;

/* Builds a body. The mesh is copied. `along` (ntet, distance of the element's centre from the tip, may be
 * NULL) is for regions given along the axis. CN_ERR_MESH: a tetrahedron without volume (<= 1e-14 of the
 * mean); CN_ERR_ARG: young <= 0, poisson outside (-1, 0.5), density < 0, with the value named. */
cn_status cn_body_new(cn_body **out, const cn_tets *mesh, const cn_material *material, const double *along,
                      cn_error *error);
void cn_body_free(cn_body *body); /* NULL is fine */

/* All elements whose four nodes have index < nactive take part (a catheter's sheathed end does not: its nodes
 * come last). `rotation` (ntet x 4 unit quaternions w x y z) is the warm start of the polar decompositions
 * and is updated; start it with cn_body_rotation_start. */
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
    int inverted;  /* elements with V <= 0 */
    double volume; /* now [m^3] */
} cn_measures;
/* von_mises (ntet, may be NULL) [Pa]. Inactive elements count as at rest. Allocates nothing. */
void cn_body_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                     cn_measures *measures, double *von_mises, struct cn_pool *pool);

/* Bending, torsion and axial stiffness of the mesh over beam theory of the true section, minus one (of the
 * two bending directions the one further off; a catheter's core, which the mesh does not have, belongs to the
 * truth). Made by static solves on a clamped piece of the chain, about 1 ms for a catheter; NAN where it is
 * no beam. A beam of many cells is solved coarser and its error scaled with the square of the cell.
 * `polygon_*`: the part of it that the polygonal section alone would give with exact elements (torsion: NAN
 * for a hollow one). */
typedef struct {
    double bending, torsion, axial;
    double polygon_bending, polygon_torsion, polygon_axial;
} cn_beam_error;
cn_status cn_beam_error_catheter(const cn_shape *shape, const cn_material *material, cn_beam_error *out);
cn_status cn_beam_error_beam(const cn_shape *shape, const cn_material *material, cn_beam_error *out);

#ifdef __cplusplus
}
#endif
#endif
