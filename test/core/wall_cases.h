/* wall_cases.h - surfaces of deformable walls, and static solves with them, for tests. */
#ifndef WALL_CASES_H
#define WALL_CASES_H

#include "body_fixture.h"

extern const cn_wall_spec plain_wall[2]; /* a membrane, a shell */

/* A wall with a matrix of its own, at rest; takes the surface. */
fixture wall_of(cn_surface *surface, cn_wall_spec spec);

/* Grid of nx x ny cells over [0,1] x [0,1], vertices row by row, the inner ones shaken by `shake` cells;
 * `place` puts it into space. Diagonals all one way, or (shake > 0) either way at random. `wrap`: column nx
 * is column 0. */
typedef void (*wall_placing)(const double uv[2], double x[3]);
cn_surface *wall_grid(int nx, int ny, double shake, bool wrap, wall_placing place);
void wall_square(const double uv[2], double x[3]);
void wall_tilted_square(const double uv[2], double x[3]); /* turned by the rotation vector 0.4 -0.9 0.3 */
void wall_strip(const double uv[2], double x[3]);         /* 10 long, 1 wide */
void wall_tube(const double uv[2], double x[3]);          /* radius 1, length 1 */
void wall_bent(const double uv[2], double x[3]);          /* curved both ways */
void wall_roof(const double uv[2], double x[3]);          /* of Scordelis and Lo: z along the axis */

/* Displacements u under `load`, the components `fixed` (3 nnode) held; returns the work load . u. */
double wall_solve(fixture *s, const double *load, const unsigned char *fixed, double *u);
/* Adds pressure times a third of each triangle's area to its corners, along `along` or (NULL) its normal. */
void wall_press(const cn_body *body, double pressure, const double *along, double *load);

#endif
