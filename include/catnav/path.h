/* path.h - a polyline through the free space with arc length, clearance and a twist-free frame. */
#ifndef CN_PATH_H
#define CN_PATH_H

#include "catnav/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    int n;             /* points */
    double *x;         /* positions [m]                                  (n x 3) */
    double *s;         /* arc length from the start [m]                  (n)     */
    double *clearance; /* distance to the nearest wall [m]               (n)     */
    double *tangent;   /* unit tangents                                  (n x 3) */
    double *normal;    /* rotation-minimising frame: first normal        (n x 3) */
    int nwaypoint;
    int *waypoint;   /* index of the point at which each waypoint lies (nwaypoint) */
    double turn_max; /* largest turn between sliding chords [rad]      */
} cn_path;

/* Copies `n` points, computes s, tangents and frame (double reflection, Wang et al. 2008, seeded by
 * `normal`, or any when NULL). Clearance is zeroed; waypoint indices are copied. */
cn_status cn_path_new(cn_path **out, int n, const double *x, int nwaypoint, const int *waypoint,
                      const double *normal);
cn_status cn_path_copy(cn_path **out, const cn_path *path);
void cn_path_free(cn_path *path);

/* A place on the path. s < 0 and s > length continue straight along the end tangents. */
typedef struct {
    double x[3], t[3], n[3], b[3]; /* position [m], frame b = t x n */
    double curvature;              /* [1/m] */
} cn_place;
void cn_path_at(const cn_path *path, double s, cn_place *place);
double cn_path_length(const cn_path *path);
/* Arc length of the point of the path nearest to x within [s_low, s_high]. */
double cn_path_project(const cn_path *path, const double x[3], double s_low, double s_high);
/* Largest turn [rad] between consecutive chords of the given length sliding along the path; *where (may be
 * NULL) gets its arc length. */
double cn_path_turn(const cn_path *path, double chord, double *where);

#ifdef __cplusplus
}
#endif
#endif
