/* molecules.h - a body of molecules: spheres joined by springs to their neighbours (Egger, Skinning for a
 * molecule deformation model, 2004).
 *
 * Packing: a body-centred cubic lattice of side a = 4 r / sqrt 3 (neighbours touch), cut by the surface;
 * links to the 8 first and 6 second neighbours. Springs along the links alone give Cauchy's solid, lambda =
 * mu: an isotropic one has Poisson's ratio 1/4, whatever the material's, and Young's modulus E when sum_links
 * k L^2 n n n n = V (2 E / 5) (dd + dd + dd),   so that   sum_links k L^2 = 6 E V. Link constants are fitted
 * so that each molecule's half of its links has this tensor for the molecule's share of the volume: inside
 * the lattice k1 = 0.6 E a, k2 = 0.4 E a; at the surface what is missing is made up. */
#ifndef CN_MOLECULES_H
#define CN_MOLECULES_H

#include <math.h>
#include "body_element.h"
#include "tree.h"

enum { CN_MOLECULES_MAX = 2000000, CN_MOLECULE_ANCHORS = 4 };

/* What a packing or a file gives: molecules, their shares of the volume, and the links. */
typedef struct {
    int n, nlink;
    double spacing; /* of neighbours, 2 r (a file: of the mean radius) [m] */
    double *place;  /* [m]                           (n x 3)     */
    double *share;  /* of the body's volume [m^3]    (n)         */
    int *link;      /* pairs, the lesser first       (nlink x 2) */
} cn_packing;
/* Fills a closed surface, as the doctor leaves it, of this volume. Each molecule is inside; jitter moves it
 * by at most 0.1 r from its lattice site. Sites that their links do not hold (they do not span space), and
 * those apart from the largest group, are left out and counted in a log message; their volume goes to the
 * nearest others. CN_ERR_ARG: radius not positive, or more than CN_MOLECULES_MAX; CN_ERR_MESH: none fits, or
 * what fits falls apart. */
cn_status cn_packing_fill(cn_packing **out, const cn_surface *surface, double volume, double radius,
                          bool jittered, unsigned seed, cn_error *error);
/* Reads a file: a molecule a line, x y z [m] or x y z r, all lines alike; without r `radius` is meant; '#'
 * begins a comment. Links join molecules nearer than 1.5 times the sum of their radii. Shares are of the
 * surface's volume, without one (NULL) the spheres' own. CN_ERR_PARSE, with the line; CN_ERR_MESH: molecules
 * in one place, or not all joined. */
cn_status cn_packing_read(cn_packing **out, const char *path, double radius, const cn_surface *surface,
                          double volume, cn_error *error);
cn_status cn_packing_new(cn_packing **out, int n); /* place and share zeroed, no links yet */
void cn_packing_free(cn_packing *packing);         /* NULL is fine */

/* Molecules nearest to samples of the walls' inside get the volume: samples at origin + (i + 1/2) cell,
 * shares that sum to volume, none below a tenth of the mean; a molecule with `whole` samples (0: none such)
 * is within and has their cells, the others the rest. The nearest is asked of `nearest`, or of a tree where
 * it returns -1 (or is NULL). */
typedef int (*cn_nearest)(const void *user, const double p[3]);
cn_status cn_packing_share(cn_packing *packing, const cn_tree *walls, double volume, const double origin[3],
                           double cell, int whole, cn_nearest nearest, const void *user);
/* A tree over points, as triangles without size; *corner (n x 3) is due to free after it. */
cn_status cn_point_tree_new(cn_tree **out, int **corner, int n, const double *point);

/* Link constants k at E = 1 Pa [m] (nlink), by the fit above. */
cn_status cn_molecules_fit(const cn_packing *packing, double *constant);

/* The three most orthogonal of a molecule's linked neighbours, those whose directions span the largest volume
 * (of equal ones the least indices; of more than 16 neighbours the nearest), and the directions to them at
 * rest. A molecule whose links lie in a plane keeps two, one whose links lie on a line one, -1 for the
 * rest. */
typedef struct {
    int n;
    int *neighbour; /* (n x 3) */
    double *rest;   /* directions over their length [1] (n x 9) */
    double *over;   /* 1 / length at rest [1/m]         (n x 3) */
} cn_molecule_frames;
cn_status cn_molecule_frames_new(cn_molecule_frames **out, const cn_body *body);
void cn_molecule_frames_free(cn_molecule_frames *frames); /* NULL is fine */
/* Rotation of each molecule's frame from rest to x (n x 3): unit quaternions w x y z (n x 4), the nearest
 * proper rotation (polar.h). Two neighbours: their plane's normal is the third direction; one: the least turn
 * that takes it along; none: the identity. Allocates nothing; bit-identical for any thread count. */
void cn_molecule_rotations(const cn_molecule_frames *frames, const double *x, double *rotation,
                           cn_pool *pool);

/* Advances x, v (nnode x 3) by dt with the forces `force` [N] (nnode x 3, NULL: none) on the molecules, those
 * `held` (nnode, NULL: none) staying: symplectic Euler, v += h a(x, v), x += h v, with the springs, a damper
 * c = damping_stiffness k along each link, and friction `damping` m v. It takes equal substeps h, the fewest
 * below 0.9 of the stable step at its start. `work` (nnode x 3) is scratch; nothing is allocated;
 * bit-identical for any thread count. `press` (NULL: none) adds at each substep. CN_ERR_ARG: no such body, dt
 * not positive, a molecule without mass, or more than CN_SUBSTEPS_MAX substeps; CN_ERR_NOT_FINITE: x and v
 * are what was left. */
typedef struct cn_press {
    void *user;
    void (*add)(void *user, const double *x, const double *v, double *f); /* forces [N] of where they are */
    double square, friction; /* bounds of their stiffness [1/s^2] and damping [1/s] over mass */
} cn_press;
enum { CN_SUBSTEPS_MAX = 10000000 };
cn_status cn_molecules_explicit(const cn_body *body, double dt, const double *force, const cn_press *press,
                                const unsigned char *held, double *x, double *v, double *work, int *substeps,
                                cn_pool *pool);
/* h [s] with h w <= 2 (sqrt(1 + z^2) - z), z = c / (2 w), c = damping + damping_stiffness w^2: what
 * symplectic Euler bears. w^2 <= max_i 2 |sum_j K_ij| / m_i, K_ij <= k n n' + k max(0, 1 - L/l) (I - n n') at
 * x, as (u_i - u_j)'K (u_i - u_j) <= 2 u_i'K u_i + 2 u_j'K u_j. 0 where a molecule has no mass, or x is not
 * finite. */
double cn_molecules_stable_step(const cn_body *body, const double *x, cn_pool *pool);

/* --- the model's own --- */

/* Molecules eight in a row, one a lane, and their links by slots: a molecule meets each of its links itself,
 * so that tasks write what is theirs alone. Empty slots: no stiffness, the molecule itself as other end. */
enum { CN_MOLECULE_LANES = 8, CN_MOLECULE_CHUNK = 16, CN_MOLECULE_TASKS = 256 }; /* groups a chunk; tasks */
typedef struct {
    int ngroup, nslot, nchunk;
    int *start;     /* slots of a group                            (ngroup + 1) */
    double *stiff;  /* k [N/m]                                     (nslot x 8)  */
    double *length; /* at rest [m]                                 (nslot x 8)  */
    int *other;     /* the molecule at the other end               (nslot x 8)  */
    int *link;      /* link, -1                                    (nslot x 8)  */
    double *share;  /* volume [m^3]                                (nnode)      */
    cn_molecule_frames *frames;
    const cn_kernels *kernels; /* for this processor; their `user` is a cn_molecule_job, `i` a task */
} cn_molecules;

/* Von Mises [Pa] of the virial stress w / (2 V), w = sum_j k (l - L) d d' / l as xx xy xz yy yz zz. */
static inline double cn_virial_stress(const double w[6], double share)
{
    const double p = w[0] - w[3], q = w[3] - w[5], r = w[5] - w[0];
    return sqrt(0.5 * (p * p + q * q + r * r) + 3 * (w[1] * w[1] + w[2] * w[2] + w[4] * w[4])) / (2 * share);
}

typedef struct {
    const cn_body *body;
    int nactive;
    const double *x;
    const double *v; /* with friction along links, else NULL */
    double *f;       /* NULL: energy alone */
    cn_tangent tangent;
    double scale;
    const cn_scatter *stiffness; /* its blocks: one a slot and lane, then the diagonal ones */
    cn_measures *measures;       /* of each task; NULL: not measured */
    double *bound;               /* of each task: of the square of frequencies [1/s^2]; NULL: not wanted */
    double *strain_sum, *growth; /* of each task: sum over molecules' links; volume gained */
    bool with_stress;
    int per; /* chunks a task */
    double energy[CN_MOLECULE_TASKS];
} cn_molecule_job;
const cn_kernels *cn_molecule_kernels_pick(int most); /* as cn_kernels_pick */
/* Runs one of the two over all tasks; returns their number. */
int cn_molecules_run(cn_molecule_job *job, cn_task task, cn_pool *pool);

/* Anchors and weights (npoint x CN_MOLECULE_ANCHORS) of points on molecules at rest, nearest first, by
 * weights that carry any affine motion exactly. CN_ERR_MESH: the molecules near one lie in a plane. */
cn_status cn_molecules_hang(int nnode, const double *rest, double spacing, int npoint, const double *point,
                            int *anchor, double *weight, cn_error *error);
/* Anchors and weights of the body's points (body.h). CN_ERR_MESH: the molecules near one lie in a plane. */
cn_status cn_molecules_anchor(cn_body *body, double spacing, cn_error *error);
void cn_molecules_points(const cn_body *body, int nactive, const double *x, const double *rotation,
                         double *points);
void cn_molecules_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                       const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a);

#endif
