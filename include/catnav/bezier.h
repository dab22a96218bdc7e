/* bezier.h - Bezier curves and tensor-product surfaces over a grid of control points, without segments:
 *     B(u, v) = sum_i sum_j P_ij b_i^n(u) b_j^m(v),   b_k^n(u) = n! / (k! (n - k)!) u^k (1 - u)^(n - k),
 * k from 0 to n, u and v in [0, 1] (Egger, Skinning a Deformation Model, EPFL 2004, 2.2.1, whose printed sum
 * over the curve leaves out k = 0). Control points: P_ij at control + 3 (i nv + j), i < nu, j < nv. */
#ifndef CN_BEZIER_H
#define CN_BEZIER_H

#include "catnav/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CN_BEZIER_POINTS 256 /* most control points in a direction */

/* All b_k^n(u) of n + 1 = count control points, by the recurrence b_k^n = (1 - u) b_k^(n-1) + u
 * b_(k-1)^(n-1), which has no large terms. */
void cn_bezier_basis(int count, double u, double *basis);
/* Point and tangent dB/du (may be NULL) of a curve of count control points (x 3), 1 .. CN_BEZIER_POINTS. */
void cn_bezier_curve(int count, const double *control, double u, double x[3], double tangent[3]);
/* Point and unit normal (along dB/du x dB/dv; may be NULL) of a surface, by the double sum. Where one
 * derivative vanishes at an end, as at a pole, the normal is its limit; zero where there is none. */
void cn_bezier_point(int nu, int nv, const double *control, double u, double v, double x[3],
                     double normal[3]);

/* A surface seen at a grid of (mu + 1) x (mv + 1) places, i / mu and j / mv: vertex i (mv + 1) + j. */
typedef struct {
    int nu, nv, mu, mv;
    int nvert, ntri;
    int *tri; /* counter-clockwise about the normal (ntri x 3) */
    double *basis,
        *lower;  /* at the places: u's (mu + 1) x nu, then v's (mv + 1) x nv; those of one degree less */
    double *row; /* scratch of an update: its sums over i (2 (mu + 1) x nv x 3) */
} cn_bezier;
/* CN_ERR_ARG: fewer than two or more than CN_BEZIER_POINTS control points in a direction, or no intervals. */
cn_status cn_bezier_new(cn_bezier **out, int nu, int nv, int mu, int mv, cn_error *error);
void cn_bezier_free(cn_bezier *bezier); /* NULL is fine */
/* Vertices and unit normals (nvert x 3) of control points (nu nv x 3), as cn_bezier_point has them, one sum
 * after the other: (mu nu + mu mv) nv operations in place of mu mv nu nv. Allocates nothing; one thread. */
void cn_bezier_update(cn_bezier *bezier, const double *control, double *x, double *normal);

#ifdef __cplusplus
}
#endif
#endif
