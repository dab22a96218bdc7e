/* geometry.h - exact predicates, distances and continuous tests between points, edges and triangles. */
#ifndef CN_GEOMETRY_H
#define CN_GEOMETRY_H

#include <stdbool.h>

/* Sign of the volume of a b c d: > 0 when d lies below the plane of a b c seen counter-clockwise from above.
 * Signs are exact for all finite doubles (floating-point filter of Shewchuk 1997, then a sum without
 * rounding); 0 for what is not finite. */
int cn_orient3d(const double a[3], const double b[3], const double c[3], const double d[3]);
int cn_orient2d(const double a[2], const double b[2], const double c[2]); /* > 0: counter-clockwise */
int cn_cross2d(const double a[2], const double b[2], const double c[2],
               const double d[2]); /* of (b - a) x (d - c) */

/* Closed intersection of two triangles (Moeller 1997, decided by exact predicates; coplanar and degenerate
 * triangles included). */
typedef enum {
    CN_TRI_APART,
    CN_TRI_TOUCH,
    CN_TRI_CROSS
} cn_tri_meet; /* cross: no plane separates them weakly */
cn_tri_meet cn_tri_tri(const double a[3][3], const double b[3][3]);

/* Nearest point of triangle abc to p: distance; bary (3, may be NULL) of it. 1e-12 relative. */
double cn_point_triangle(const double p[3], const double a[3], const double b[3], const double c[3],
                         double bary[3]);
/* Nearest points of segments a0a1 and b0b1: distance; parameters s, t in [0,1] (may be NULL). Parallel and
 * degenerate segments included. */
double cn_edge_edge(const double a0[3], const double a1[3], const double b0[3], const double b1[3], double *s,
                    double *t);
double cn_tri_tri_distance(const double a[3][3], const double b[3][3]);

/* Conservative first time in [0, 1] at which the distance falls to `gap` (>= 0) under straight motion x -> x
 * + d of the four points; INFINITY when it never does. Never late: conservative advancement with rounding
 * bounded (geometry_ccd.c); at most 1e-6 early unless the points start within the gap (then 0). x, d: point
 * then triangle, or edge 0 1 then edge 2 3. Ends after a bounded number of advances. Not finite or gap < 0:
 * 0. */
double cn_ccd_point_triangle(const double x[4][3], const double d[4][3], double gap);
double cn_ccd_edge_edge(const double x[4][3], const double d[4][3], double gap);

#endif
