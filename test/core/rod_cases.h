/* rod_cases.h - a rod with its state, matrix and solver, for tests; static equilibria by Newton's method. */
#ifndef ROD_CASES_H
#define ROD_CASES_H

#include "rod.h"
#include "solve.h"

typedef struct {
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    cn_solver *solver;
    double *x, *rotation, *f, *dx;
    double *load, *spring; /* dead forces and moments; springs to places at rest and frames as they are */
    unsigned char *fixed;  /* (nblock) */
} rod_case;

/* A rod at rest; anything that fails ends the test. skin may be NULL; poisson 0.3. */
rod_case rod_case_new(int nnode, const double *axis, const double normal[3], const cn_section *section,
                      const cn_tets *skin);
/* n equal segments along +x from the origin, n of frames along +y. */
rod_case rod_case_straight(int nsegment, double length, const cn_section *section);
void rod_case_free(rod_case *s);
/* Turns and moves the whole state by R and c: places, frames (the turn since the start of the step is taken
 * into the frames first). */
void rod_case_move(rod_case *s, const double r[9], const double c[3]);

/* f, with a scatter also the matrix, at x; returns the energy. */
double rod_case_force(rod_case *s, cn_tangent tangent, const cn_scatter *scatter);
/* The matrix as (n x n) numbers, n = 3 nblock. */
void rod_case_dense(const rod_case *s, double *dense);

/* Equilibrium under `load` by Newton's method, at most half a radian an iteration, after which frames are
 * turned, so a moment keeps its direction in space. Blocks of `fixed` are held; springs hold single
 * components of places. Returns iterations, -1 where it fails. */
int rod_case_solve(rod_case *s);
/* Adds the springs to the matrix. */
void rod_case_add_springs(rod_case *s);

#endif
