/* body_wall.h - deformable walls: triangles on an elastic foundation.
 *
 * A triangle of thickness h lies in plane stress; a shell's also bends (body_shell.c). Strain and curvature
 * are linear in the displacements u of the element's nodes (body->connect): rows xx, yy, 2xy in a frame of
 * the triangle's own. A wall begins as one that hardly turns: its stiffness is constant, and by an angle a
 * shows a strain of 1 - cos a, about a^2 / 2, that is none. Once that counts its triangles turn
 * (body_wall_turn.c), and the matrix stays constant between places to which it is turned anew. */
#ifndef CN_BODY_WALL_H
#define CN_BODY_WALL_H

#include <stddef.h>
#include "body_methods.h"

enum { CN_SHEET_TASKS = 64 }; /* ranges of nodes or triangles, whatever the number of threads */
enum { CN_SHEET_COLOURS = 65 };
enum { CN_SHELL_NODES = 12 }; /* own three, those across the edges, those across the neighbours' edges */

/* Eight triangles, one a lane; empty lanes are copies of the first without a size. */
enum { CN_SHEET_LANES = 8 };
typedef struct {
    double grad[4][CN_SHEET_LANES]; /* of barycentric coordinates 1, 2 along the two axes [1/m] */
    double size[CN_SHEET_LANES];    /* E h / (1 - nu^2) times the area [N m] */
    int node[CN_SHEET_LANES][3], triangle[CN_SHEET_LANES];
    int n, unused[15]; /* to a multiple of 64 bytes */
} cn_sheet_batch;
/* Membrane part of batches [begin, end): energy [J]; adds the forces to f (may be NULL). */
typedef double (*cn_sheet_kernel)(const cn_body *body, const double *x, double *f, int begin, int end);

/* A wall as a body; cn_wall is what contact knows of it. */
typedef struct {
    cn_matrix *stiffness; /* of the elements; the foundation on the diagonal besides */
    double *foundation;   /* of each node [N/m]                             (nnode)              */
    double *area;         /* of each triangle [m^2]                         (nelement)           */
    double *strain;       /* per displacement of the corners [1/m]          (nelement x 3 x 9)   */
    double *curvature;    /* shell: of the element's nodes [1/m^2], or NULL (nelement x 3 x 36)  */
    double *plane; /* two axes at rest; of each corner the gradients of its barycentric coordinate along
                      them [1/m]                                     (nelement x 6 + 6)      */
    cn_sheet_batch *batch; /* triangles by colours: those of one share no node, but for the last's */
    int colour[CN_SHEET_COLOURS + 1]; /* the batch with which they begin */
    cn_sheet_kernel kernel;           /* for this processor */
    int *across; /* on edge k of triangle t: other side's 3 t + k; -1: a rim, -2: of more than two
                    triangles                                      (nelement x 3)       */
    double thickness, young, poisson;
} cn_sheet;

/* Unit axes of triangle t: along its first edge, across in its plane, normal; its corners' places [m]. */
void cn_sheet_plane(const cn_body *body, int t, double axis[3][3], double place[3][2]);
/* Gradients of the barycentric coordinates in the plane [1/m], from the corners' places there; returns twice
 * the signed area. */
double cn_flat_gradients(const double p[3][2], double grad[3][2]);

/* most: 2 AVX-512, 1 AVX2, 0 neither. */
cn_sheet_kernel cn_sheet_kernel_pick(int most);

/* --- body_wall_turn.c --- */

/* A triangle's axes at rest and now, the third across it (rows); U of F = R U in its plane, and its inverse:
 * 00, 11, 01. */
typedef struct {
    double rest[9], now[9], u[3], inverse[3];
} cn_sheet_frame;
void cn_sheet_polar(const cn_body *body, int t, const double *x, cn_sheet_frame *out);
/* Strain U - 1, and the curvature [1/m] of displacements rotated back (0 of a membrane): xx, yy, 2xy. */
void cn_sheet_strain(const cn_body *body, int t, const double *x, const cn_sheet_frame *frame,
                     double strain[3], double curvature[3]);
/* Adds the force of a wall whose triangles turn to f (may be NULL); returns its energy. */
double cn_sheet_add_turned(const cn_body *body, const double *x, double *f, cn_pool *pool);
/* The rotations of a wall: the quaternions and the strains (U - 1: 00, 11, 01) of its triangles to which the
 * matrix belongs (nelement x 4 each), and last whether triangles turn. */
static inline const double *cn_sheet_strains(const cn_body *body, const double *rotation)
{
    return rotation + 4 * (size_t)body->nelement;
}
static inline bool cn_sheet_turns(const cn_body *body, const double *rotation)
{
    return rotation && rotation[8 * (size_t)body->nelement] == 0;
}
static inline bool cn_is_sheet(cn_body_model model)
{
    return model == CN_BODY_MEMBRANE || model == CN_BODY_SHELL;
}
/* Triangles turn once one has turned by so much [rad]. The matrix follows at the end of a step when a
 * triangle's turn [rad] or strain has changed by so much since it did last; and at once, by less, where
 * iterations with it converge slowly. */
#define CN_SHEET_TURNS   0.1
#define CN_SHEET_FOLLOWS 0.2
#define CN_SHEET_SLOW    0.05
/* Largest angle of a triangle from where the rotations have it [rad]. */
double cn_sheet_turn(const cn_body *body, const double *x, const double *rotation, cn_pool *pool);
/* What of a strain's stress S holds a triangle in its plane, [N/m] 00, 11, 01: energy of a slope g is g S g /
 * 2 an area, where pressure counts for none. */
void cn_sheet_tension(const cn_sheet *sheet, const double strain[3], double tension[3]);
/* From now on triangles turn, and the matrix is that of where they are: if one has changed by more than this,
 * its turn, or its strain where they turn already; below 0 in any case. */
void cn_sheet_follow(const cn_body *body, const double *x, double *rotation, double change, cn_pool *pool);

double cn_sheet_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool);

/* body_wall_measure.c */
void cn_sheet_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                      cn_measures *measures, double *von_mises, cn_pool *pool);

/* body_shell.c: fills connect (own corners first; what is missing repeats the first) and sheet->curvature.
 * CN_ERR_MESH: an edge of more than two triangles. */
cn_status cn_shell_rest(cn_body *body, cn_error *error);

#endif
