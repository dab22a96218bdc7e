/* rod.h - a rod's own data and its kernel.
 *
 * Node i has a place p and a frame R (axes n, b, t; t runs from node i to node i + 1, a catheter's from its
 * tip to its base). A segment has the strains of one point, between its nodes:
 *     Gamma = R_m' (p_j - p_i) / L - Gamma_0,    kappa = 2 sigma(|b|^2) b / L - w kappa_0,
 * R_m half way from R_i to R_j, b the vector part of conj(q_i) q_j, sigma(s^2) the series of asin(s) / s:
 * w the share of the rest curvature in force, the last of the rotations (1, but of a steered end), and kappa
 * is the rotation vector over L (Simo 1985; one point per element: Simo and Vu-Quoc 1986, no locking).
 * Energy L/2 (Gamma' diag(kGA, kGA, EA) Gamma + kappa' diag(EI_n, EI_b, GJ) kappa). */
#ifndef CN_ROD_H
#define CN_ROD_H

#include "body_methods.h"

enum {
    CN_ROD_LANES = 8,
    CN_ROD_CHUNK = 63, /* nodes; with the segment before its first one whole batches of lanes */
    CN_ROD_TASKS = 64  /* at most: sums of energy a call keeps on the stack */
};

/* Numbers of a segment, by columns: column k of segment s at constant[k * stride + 1 + s]; zero stiffness
 * before the first and behind the last. */
enum {
    CN_ROD_FORCE = 0,   /* kGA n, kGA b, EA [N] */
    CN_ROD_MOMENT = 3,  /* EI n, EI b, GJ [N m^2] */
    CN_ROD_STRETCH = 6, /* Gamma_0 */
    CN_ROD_BEND = 9,    /* kappa_0 [1/m] */
    CN_ROD_LENGTH = 12, /* L [m] */
    CN_ROD_INVERSE = 13,
    CN_ROD_CONSTANTS = 14
};

/* What a chunk's segments have, by columns as above: Gamma, kappa, both elastic, and the energy. Segment s of
 * chunk c stands at 1 + s - c * CN_ROD_CHUNK. */
typedef double cn_rod_strains[7][CN_ROD_CHUNK + 1];

/* Blocks of the matrix that a node's row and the segment behind it fill: of node i and its frame i*, and of
 * the next node j. */
enum { CN_ROD_II = 0, CN_ROD_IJ = 4, CN_ROD_JI = 8, CN_ROD_BLOCKS = 12 }; /* each: pp, p*, *p, ** */

typedef struct {
    const cn_body *body;
    int nactive;
    const double *x, *rotation;
    double *f; /* NULL: energy alone */
    cn_tangent tangent;
    double scale;
    const cn_scatter *stiffness; /* NULL: none */
} cn_rod_job;

/* Forces and matrix rows of a chunk's nodes, and the energy of its segments, which it returns; strains may be
 * NULL. */
typedef double (*cn_rod_kernel)(const cn_rod_job *job, int chunk, cn_rod_strains *strains);
cn_rod_kernel cn_rod_kernel_pick(int most); /* 0 base, 1 AVX2, 2 AVX-512, as far as the machine has it */

typedef struct cn_rod {
    double *constant;
    int stride;
    cn_section *section; /* (nelement) */
    double *frame;       /* at rest, unit quaternions, and (1 0 0 0) (nnode + 1 x 4) */
    double *offset;      /* of points in their frames [m] (npoint x 3) */
    int *start, *riding; /* tetrahedra of segment s: riding[start[s]] .. (nelement + 1), (ntet) */
    double *fibre; /* of riding[k]: centre along n and b [m], twist's shear there per its rate [Pa m] (x 3) */
    cn_rod_kernel kernel;
} cn_rod;

static inline int cn_rod_chunks(int nactive)
{
    return (nactive + CN_ROD_CHUNK - 1) / CN_ROD_CHUNK;
}

/* rod_section.c: shear stress along n and b per twist rate [Pa m] at a place of the section. */
void cn_section_twist_stress(const cn_section *section, const double place[2], double shear[2]);
/* J of a rectangle a x b (Saint-Venant's series) [m^4]. */
double cn_rectangle_torsion(double a, double b);

/* Frames (nnode x 4) of a rod that starts along the line of its nodes x (nnode x 3): tangent to it, without
 * twist, the first turned from rest as little as may be. Left as they are where the line is no curve. */
void cn_rod_follow(const cn_body *body, const double *x, double *rotation);

/* rod_skin.c */
cn_status cn_rod_skin(cn_body *body, const cn_tets *skin, const int *ride, cn_error *error);
/* R of node i now, and T: its rotation vector's change turns it by T times that. */
void cn_rod_frame(const cn_body *body, int i, const double *x, const double *rotation, double r[9],
                  double t[9]);
void cn_rod_points(const cn_body *body, int nactive, const double *x, const double *rotation, double *points);
void cn_rod_carry(const cn_body *body, int nactive, const double *x, const double *rotation, cn_carry *carry);
void cn_rod_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                 const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a);
/* rod_measure.c */
void cn_rod_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                    cn_measures *measures, double *von_mises, cn_pool *pool);

#endif
