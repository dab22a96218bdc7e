/* body_fixture.h - a body with a state and a matrix of its own, for tests. */
#ifndef BODY_FIXTURE_H
#define BODY_FIXTURE_H

#include <math.h>
#include <stdlib.h>
#include "body_element.h"
#include "shapes.h"
#include "solve.h"

typedef struct {
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    double *x, *rotation, *f; /* x starts at rest, rotation at its start */
} fixture;

static inline double *numbers(int n) /* zeroed; free */
{
    double *a = calloc((size_t)n, sizeof *a);
    if (!a) abort();
    return a;
}

static inline unsigned char *flags(int n)
{
    unsigned char *a = calloc((size_t)n, 1);
    if (!a) abort();
    return a;
}

static inline double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

fixture fixture_of(const cn_tets *mesh, const cn_material *material); /* the mesh stays the caller's */
void fixture_free(fixture *s);
/* f and, with scatter, the matrix, cleared before; returns the energy. */
double fixture_force(fixture *s, cn_tangent tangent, const cn_scatter *scatter, cn_pool *pool);
/* x = R (rest + random of size `shake`); R by the seed. */
void fixture_shake(fixture *s, unsigned seed, double shake);

/* The tangent at s->x without the components `fixed` (3 nnode), factored. */
cn_status fixture_factor(fixture *s, cn_solver *solver, cn_tangent tangent, const unsigned char *fixed);
/* x = A^-1 b with that factor, n numbers; 0 where fixed. */
void fixture_solve(cn_solver *solver, int n, const double *b, const unsigned char *fixed, double *x);

/* The last n numbers of each line below the header of a reference table; NULL, 0 without the file. Returns
 * how many lines. */
int reference_table(const char *name, int n, double **out);

/* A second-order mesh of a linear one, which it frees; `curve` > 0 bends it, so that no edge stays straight:
 * by that share of `size`. */
cn_tets *shape_raised(cn_tets *linear, double curve, double size);

#endif
