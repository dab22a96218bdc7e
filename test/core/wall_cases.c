#include "wall_cases.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"

static const double pi = 3.14159265358979323846;

const cn_wall_spec plain_wall[2] = {
    {.model = CN_WALL_MEMBRANE,
     .thickness = 1e-3,
     .young = 2e4,
     .poisson = 0.3,
     .density = 1e3,
     .foundation = 1e4},
    {.model = CN_WALL_SHELL, .thickness = 1e-3, .young = 2e4, .poisson = 0.3, .density = 1e3}};

/* A wall with a matrix of its own; takes the surface. */
fixture wall_of(cn_surface *surface, cn_wall_spec spec)
{
    fixture s;
    const int first = 0;
    assert_int_equal(cn_body_new_wall(&s.body, surface, &spec, NULL), CN_OK);
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    s.x = numbers(3 * s.body->nnode), s.f = numbers(3 * s.body->nnode),
    s.rotation = numbers(4 * s.body->nturn);
    cn_body_rotation_start(s.body, s.rotation);
    memcpy(s.x, s.body->rest, 3 * (size_t)s.body->nnode * sizeof *s.x);
    cn_surface_free(surface);
    return s;
}

/* Grid of nx x ny cells over [0,1] x [0,1], inner vertices shaken by `shake` cells, `place` puts it into
 * space; diagonals all the same way, or (shake > 0) either way at random. `wrap`: column nx is column 0. */
cn_surface *wall_grid(int nx, int ny, double shake, bool wrap, wall_placing place)
{
    cn_surface *s;
    unsigned seed = 7;
    const int columns = wrap ? nx : nx + 1;
    int n = 0;
    assert_int_equal(cn_surface_new(&s, columns * (ny + 1), 2 * nx * ny), CN_OK);
    for (int j = 0; j <= ny; j++)
        for (int i = 0; i < columns; i++) {
            const bool inner = i > 0 && i < nx && j > 0 && j < ny;
            const double du = shape_random(&seed), dv = shape_random(&seed);
            const double uv[2] = {(i + (inner ? shake * du : 0)) / nx, (j + (inner ? shake * dv : 0)) / ny};
            place(uv, s->vert + 3 * (j * columns + i));
        }
    for (int j = 0; j < ny; j++)
        for (int i = 0; i < nx; i++) {
            const int a = j * columns + i, b = j * columns + (i + 1) % columns, c = a + columns,
                      d = b + columns;
            const bool other = shake > 0 && shape_random(&seed) > 0;
            const int quad[2][6] = {{a, b, d, a, d, c}, {a, b, c, b, d, c}};
            memcpy(s->tri + 3 * n, quad[other], sizeof quad[other]);
            n += 2;
        }
    return s;
}

void wall_square(const double uv[2], double x[3])
{
    x[0] = uv[0], x[1] = uv[1], x[2] = 0;
}

void wall_tilted_square(const double uv[2], double x[3])
{
    const double flat[3] = {uv[0], uv[1], 0}, w[3] = {0.4, -0.9, 0.3};
    double r[9];
    cn_rotation(w, r);
    cn_mat_vec(r, flat, x);
}

void wall_strip(const double uv[2], double x[3]) /* 10 long, 1 wide */
{
    x[0] = 10 * uv[0], x[1] = uv[1], x[2] = 0;
}

void wall_tube(const double uv[2], double x[3]) /* radius 1, length 1 */
{
    x[0] = cos(2 * pi * uv[0]), x[1] = sin(2 * pi * uv[0]), x[2] = uv[1];
}

void wall_bent(const double uv[2], double x[3]) /* curved both ways */
{
    x[0] = uv[0], x[1] = uv[1], x[2] = 0.3 * uv[0] * uv[0] - 0.5 * uv[0] * uv[1] + 0.2 * sin(3 * uv[1]);
}

void wall_roof(const double uv[2], double x[3]) /* Scordelis and Lo: z along the axis */
{
    const double a = (uv[0] - 0.5) * 80 * pi / 180;
    x[0] = 25 * sin(a), x[1] = 25 * cos(a), x[2] = 50 * uv[1];
}

/* Displacements under the forces in s->f, the components `fixed` held; into s->x as displacements. */
double wall_solve(fixture *s, const double *load, const unsigned char *fixed, double *u)
{
    cn_solver *solver;
    double work = 0;
    assert_int_equal(cn_solver_new(&solver, s->matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    assert_int_equal(fixture_factor(s, solver, CN_TANGENT_EXACT, fixed), CN_OK);
    fixture_solve(solver, 3 * s->body->nnode, load, fixed, u);
    for (int i = 0; i < 3 * s->body->nnode; i++)
        work += fixed[i] ? 0 : load[i] * u[i];
    cn_solver_free(solver);
    return work;
}

/* Adds pressure times a third of each triangle's area to its corners, along `along` or (NULL) its normal. */
void wall_press(const cn_body *body, double pressure, const double *along, double *load)
{
    for (int t = 0; t < body->nelement; t++) {
        const int *c = body->boundary->tri + 3 * t;
        double u[3], v[3], n[3];
        cn_sub(body->rest + 3 * c[1], body->rest + 3 * c[0], u);
        cn_sub(body->rest + 3 * c[2], body->rest + 3 * c[0], v);
        cn_cross(u, v, n);
        const double size = cn_norm(n);
        for (int a = 0; a < 3; a++)
            cn_axpy(pressure * (along ? size : 1) / 6, along ? along : n, load + 3 * c[a]);
    }
}
