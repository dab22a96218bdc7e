/* body_wall.h - deformable walls: triangles on an elastic foundation, their stiffness constant.
 *
 * A triangle of thickness h lies in plane stress, its small strain measured about the rest shape; a shell's
 * also bends (body_shell.c). Strain and curvature are linear in the displacements u of the element's nodes
 * (body->connect): rows xx, yy, 2xy in a frame of the triangle's own. Nothing is rotated back: a wall that
 * turns by an angle a shows a strain of 1 - cos a, about a^2 / 2, which is the error of it. */
#ifndef CN_BODY_WALL_H
#define CN_BODY_WALL_H

#include "body_methods.h"

enum { CN_SHEET_TASKS = 64 }; /* ranges of nodes or triangles, whatever the number of threads */
enum { CN_SHELL_NODES = 12 }; /* own three, those across the edges, those across the neighbours' edges */

/* A wall as a body; cn_wall is what contact knows of it. */
typedef struct {
    cn_matrix *stiffness; /* of the elements; the foundation on the diagonal besides */
    double *foundation;   /* of each node [N/m]                             (nnode)              */
    double *area;         /* of each triangle [m^2]                         (nelement)           */
    double *strain;       /* per displacement of the corners [1/m]          (nelement x 3 x 9)   */
    double *curvature;    /* shell: of the element's nodes [1/m^2], or NULL (nelement x 3 x 36)  */
    int *across;          /* on edge k of triangle t: other side's 3 t + k; -1: a rim, -2: of more than two
                             triangles                                      (nelement x 3)       */
    double thickness, young, poisson;
} cn_sheet;

/* Unit axes of triangle t: along its first edge, across in its plane, normal; its corners' places [m]. */
void cn_sheet_plane(const cn_body *body, int t, double axis[3][3], double place[3][2]);
/* Gradients of the barycentric coordinates in the plane [1/m], from the corners' places there; returns twice
 * the signed area. */
double cn_flat_gradients(const double p[3][2], double grad[3][2]);

double cn_sheet_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool);

/* body_wall_measure.c */
void cn_sheet_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                      cn_measures *measures, double *von_mises, cn_pool *pool);

/* body_shell.c: fills connect (own corners first; what is missing repeats the first) and sheet->curvature.
 * CN_ERR_MESH: an edge of more than two triangles. */
cn_status cn_shell_rest(cn_body *body, cn_error *error);

#endif
