/* skin_cases.h - a capsule as skin over a bar of anchors that is bent to an arc; for tests and bench. */
#ifndef SKIN_CASES_H
#define SKIN_CASES_H

#include "catnav/skin.h"

/* Closed, outward: a cylinder of `radius` along z from 0 to length with half spheres on its ends; about
 * `around` triangles' edges around it, and as long ones along it. The caller frees. A mesh that cannot be
 * made ends the program. */
cn_surface *skin_capsule(double length, double radius, int around);

/* A bar along z bent by `angle` in all over its length, towards +x: where a point goes, and its rotation. */
void skin_bend(double length, double angle, const double p[3], double x[3], double q[4]);

/* Anchors in a box about the bar, n[0] x n[1] x n[2] of them `spacing` apart (z from 0); places and rotations
 * when bent by angle over `length`. The caller frees both. */
typedef struct {
    int n;
    double *rest, *place, *rotation;
} skin_bar;
skin_bar skin_bar_new(const int n[3], double spacing, double length, double angle);
void skin_bar_free(skin_bar *bar);

#endif
