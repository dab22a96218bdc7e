/* Shells: bending against plates, beams, rings and published values. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "body_wall.h"
#include "catnav/vec3.h"
#include "wall_cases.h"

static const double pi = 3.14159265358979323846;

/* Von Mises stress of a triangle's curvature alone, linear in the displacements. */
static double bending_stress(const fixture *s, const cn_wall_spec *spec, int t)
{
    const cn_sheet *sheet = s->body->own;
    const double *b = sheet->curvature + 9 * CN_SHELL_NODES * t, nu = spec->poisson;
    double k[3] = {0, 0, 0};
    for (int a = 0; a < CN_SHELL_NODES; a++) {
        const int node = s->body->connect[CN_SHELL_NODES * t + a];
        double u[3];
        cn_sub(s->x + 3 * node, s->body->rest + 3 * node, u);
        for (int r = 0; r < 3; r++)
            k[r] += cn_dot(b + 3 * CN_SHELL_NODES * r + 3 * a, u);
    }
    const double x = k[0] + nu * k[1], y = k[1] + nu * k[0], shear = (1 - nu) / 2 * k[2];
    return spec->young / (1 - nu * nu) * spec->thickness / 2 *
           sqrt(x * x - x * y + y * y + 3 * shear * shear);
}

static void constant_curvature_is_exact_and_in_balance_on_any_mesh(void **state)
{
    (void)state;
    enum { N = 14 };
    cn_wall_spec spec = plain_wall[1];
    const double h[3] = {0.03, -0.05, 0.02}; /* w,xx w,yy w,xy */
    fixture s = wall_of(wall_grid(N, N, 0.3, false, wall_square), spec);
    const double nu = spec.poisson, plane = spec.young / (1 - nu * nu) * spec.thickness / 2;
    for (int i = 0; i < s.body->nnode; i++) {
        const double *p = s.body->rest + 3 * i;
        s.x[3 * i + 2] += h[0] * p[0] * p[0] / 2 + h[1] * p[1] * p[1] / 2 + h[2] * p[0] * p[1];
    }
    const double sx = plane * (h[0] + nu * h[1]), sy = plane * (h[1] + nu * h[0]),
                 t = plane * (1 - nu) * h[2];
    const double mises = sqrt(sx * sx - sx * sy + sy * sy + 3 * t * t);
    double worst = 0;
    for (int j = 2; j < N - 2; j++) /* away from rims, whose moment is none */
        for (int i = 2; i < N - 2; i++)
            for (int e = 2 * (j * N + i); e < 2 * (j * N + i) + 2; e++)
                worst = fmax(worst, fabs(bending_stress(&s, &spec, e) / mises - 1));
    printf("  constant curvature, irregular mesh: stress within %.1e\n", worst);
    assert_true(worst < 1e-9);
    fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
    const double moment = mises * spec.thickness * spec.thickness / 6;
    worst = 0;
    for (int j = 4; j <= N - 4; j++)
        for (int i = 4; i <= N - 4; i++)
            worst = fmax(worst, cn_norm(s.f + 3 * (j * (N + 1) + i)) / (moment * N));
    assert_true(worst < 1e-9);
    fixture_free(&s);
}

/* Work of a unit pressure on a supported unit square of stiffness D = 1: Navier's series. */
static double navier(void)
{
    double sum = 0;
    for (int i = 199; i > 0; i -= 2)
        for (int j = 199; j > 0; j -= 2)
            sum += 64 / (pow(pi, 8) * i * i * j * j * pow((double)i * i + (double)j * j, 2));
    return sum;
}

static double plate_error(int n, double shake)
{
    cn_wall_spec spec = {.model = CN_WALL_SHELL, .thickness = 0.01, .poisson = 0.3, .density = 1};
    spec.young = 12 * (1 - spec.poisson * spec.poisson) / pow(spec.thickness, 3);
    fixture s = wall_of(wall_grid(n, n, shake, false, wall_square), spec);
    const int nnode = s.body->nnode;
    const double up[3] = {0, 0, 1};
    double *load = numbers(3 * nnode), *u = numbers(3 * nnode);
    unsigned char *rim = flags(nnode), *fixed = flags(3 * nnode);
    cn_body_wall_rims(s.body, rim);
    for (int i = 0; i < 3 * nnode; i++)
        fixed[i] = i % 3 < 2 || rim[i / 3];
    wall_press(s.body, 1, up, load);
    const double error = wall_solve(&s, load, fixed, u) / navier() - 1;
    free(load), free(u), free(rim), free(fixed);
    fixture_free(&s);
    return error;
}

static void a_supported_plate_gives_way_as_naviers_on_regular_and_irregular_meshes(void **state)
{
    (void)state;
    for (int irregular = 0; irregular < 2; irregular++) {
        double error[3];
        for (int k = 0; k < 3; k++)
            error[k] = plate_error(8 << k, irregular ? 0.3 : 0);
        printf("  supported plate, %s, 8 16 32 cells: compliance %+.4f %+.4f %+.4f, order %.2f\n",
               irregular ? "irregular" : "regular", error[0], error[1], error[2],
               log2(fabs(error[0] / error[2])) / 2);
        assert_true(fabs(error[2]) < (irregular ? 0.01 : 0.001));
        assert_true(fabs(error[0]) < 0.03);
    }
}

/* A strip on knife edges at both ends, pressed amid its length: two cantilevers back to back, P L^3 / 48 EI.
 */
static double strip_error(int n, double shake, double nu)
{
    cn_wall_spec spec = {
        .model = CN_WALL_SHELL, .thickness = 0.05, .young = 1e6, .poisson = nu, .density = 1};
    fixture s = wall_of(wall_grid(10 * n, n, shake, false, wall_strip), spec);
    const int nnode = s.body->nnode, columns = 10 * n + 1;
    double *load = numbers(3 * nnode), *u = numbers(3 * nnode);
    unsigned char *fixed = flags(3 * nnode);
    for (int i = 0; i < nnode; i++)
        fixed[3 * i + 2] = i % columns == 0 || i % columns == columns - 1;
    fixed[0] = fixed[1] = fixed[3 * n * columns] = 1;
    for (int j = 0; j <= n; j++) {
        const double share = (j == 0 || j == n ? 0.5 : 1.0) / n;
        load[3 * (j * columns + 5 * n) + 2] = share;
    }
    const double work = wall_solve(&s, load, fixed, u), inertia = pow(spec.thickness, 3) / 12;
    free(load), free(u), free(fixed);
    fixture_free(&s);
    return work * 48 * spec.young * inertia / 1000 - 1;
}

static void a_free_strip_bends_as_a_beam_its_rims_without_moment(void **state)
{
    (void)state;
    for (int irregular = 0; irregular < 2; irregular++)
        for (int soft = 0; soft < 2; soft++) {
            double error[3];
            for (int k = 0; k < 3; k++)
                error[k] = strip_error(2 << k, irregular ? 0.25 : 0, soft ? 0 : 0.3);
            printf("  strip, %s, nu %.1f, 2 4 8 cells across: deflection %+.4f %+.4f %+.4f, order %.2f\n",
                   irregular ? "irregular" : "regular", soft ? 0 : 0.3, error[0], error[1], error[2],
                   log2(fabs(error[0] / error[2])) / 2);
            assert_true(fabs(error[2]) < 0.02 && fabs(error[2]) < fabs(error[0]));
        }
}

/* A ring pressed between two lines: its diameter shortens by (pi/4 - 2/pi) q R^3 / D, nu 0 (Timoshenko). */
static void a_cylinder_pinched_along_two_lines_is_a_ring(void **state)
{
    (void)state;
    for (int k = 0; k < 3; k++) {
        const int sides = 32 << k, rows = 4 << k;
        cn_wall_spec spec = {.model = CN_WALL_SHELL, .thickness = 0.01, .young = 1e6, .density = 1};
        fixture s = wall_of(wall_grid(sides, rows, 0, true, wall_tube), spec);
        const int n = s.body->nnode, half = sides / 2;
        double *load = numbers(3 * n), *u = numbers(3 * n), closer = 0;
        unsigned char *fixed = flags(3 * n);
        fixed[2] = fixed[1] = fixed[3 * half + 1] = fixed[3 * half + 2] = 1; /* two opposite, on the x axis */
        fixed[3 * (sides / 4) + 2] = fixed[3 * (sides / 4)] = 1;
        for (int j = 0; j <= rows; j++) {
            const double share = (j == 0 || j == rows ? 0.5 : 1.0) / rows;
            load[3 * j * sides] = -share, load[3 * (j * sides + half)] = share;
        }
        wall_solve(&s, load, fixed, u);
        for (int j = 0; j <= rows; j++)
            closer +=
                (u[3 * (j * sides + half)] - u[3 * j * sides]) * (j == 0 || j == rows ? 0.5 : 1.0) / rows;
        const double d = spec.young * pow(spec.thickness, 3) / 12, error = closer * d / (pi / 4 - 2 / pi) - 1;
        printf("  pinched ring, %d sides: %+.4f\n", sides, error);
        if (k == 2) assert_true(fabs(error) < 0.01);
        free(load), free(u), free(fixed);
        fixture_free(&s);
    }
}

/* Roof of Scordelis and Lo 1964: a free edge's middle sinks by 0.3024 (MacNeal and Harder 1985). */
static void the_roof_of_scordelis_and_lo_sinks_as_published(void **state)
{
    (void)state;
    for (int k = 0; k < 3; k++) {
        const int n = 16 << k;
        const cn_wall_spec spec = {
            .model = CN_WALL_SHELL, .thickness = 0.25, .young = 4.32e8, .poisson = 0, .density = 1};
        fixture s = wall_of(wall_grid(n, n, k == 2 ? 0.2 : 0, false, wall_roof), spec);
        const int nnode = s.body->nnode;
        const double down[3] = {0, -1, 0};
        double *load = numbers(3 * nnode), *u = numbers(3 * nnode);
        unsigned char *fixed = flags(3 * nnode);
        for (int i = 0; i <= n; i++) /* diaphragms at both ends */
            for (int c = 0; c < 2; c++)
                fixed[3 * i + c] = fixed[3 * (n * (n + 1) + i) + c] = 1;
        fixed[2] = 1;
        wall_press(s.body, 90, down, load);
        wall_solve(&s, load, fixed, u);
        const double sag = -u[3 * (n / 2 * (n + 1)) + 1];
        printf("  roof, %d cells%s: %.4f\n", n, k == 2 ? " irregular" : "", sag);
        if (k == 2) assert_true(fabs(sag / 0.3024 - 1) < 0.02);
        free(load), free(u), free(fixed);
        fixture_free(&s);
    }
}

static void stir(fixture *s, unsigned seed, double size)
{
    for (int i = 0; i < 3 * s->body->nnode; i++)
        s->x[i] = s->body->rest[i] + size * shape_random(&seed);
}

/* A clamped strip under a force at its end, P L^2 / EI = 1 and 5: tip of the elastica (Mattiasson 1981). */
static void a_strip_whose_triangles_turn_bends_as_the_elastica(void **state)
{
    (void)state;
    const double want[2][3] = {{1, 0.30172, 0.05643}, {5, 0.71379, 0.38763}}; /* down, back, over L */
    cn_wall_spec spec = {.model = CN_WALL_SHELL, .thickness = 0.05, .young = 1e6, .density = 1};
    fixture s = wall_of(wall_grid(60, 4, 0, false, wall_strip), spec);
    const int n = s.body->nnode;
    const double length = 10, stiffness = spec.young * pow(spec.thickness, 3) / 12;
    double *load = numbers(3 * n), *u = numbers(3 * n);
    unsigned char *fixed = flags(3 * n);
    for (int i = 0; i < n; i++) /* clamped: the ends of the first row of triangles */
        if (s.body->rest[3 * i] < 1.5 * length / 60) memset(fixed + 3 * i, 1, 3);
    const double free_length = length - 0.5 * length / 60; /* an edge bends half a cell to either side */
    for (int c = 0; c < 2; c++) { /* the matrix knows of no tension, so half of each correction is taken */
        double back = 0, down = 0, left = INFINITY;
        int ends = 0;
        for (int i = 0; i < n; i++)
            ends += s.body->rest[3 * i] > length - 1e-9;
        for (int round = 0; round < 600 && left > 1e-9; round++) {
            const double p =
                want[c][0] * stiffness / (free_length * free_length) * fmin(1, (round + 1) / 100.0);
            cn_sheet_follow(s.body, s.x, s.rotation, -1, NULL);
            fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
            for (int i = 0; i < 3 * n; i++) {
                const bool end = s.body->rest[3 * (i / 3)] > length - 1e-9;
                load[i] = fixed[i] ? 0 : s.f[i] - (i % 3 == 2 && end ? p / ends : 0);
            }
            left = round < 100 ? INFINITY : largest(load, 3 * n) / p;
            wall_solve(&s, load, fixed, u);
            for (int i = 0; i < 3 * n; i++)
                s.x[i] += 0.5 * u[i];
        }
        for (int i = 0; i < n; i++)
            if (s.body->rest[3 * i] > length - 1e-9) {
                back += (s.body->rest[3 * i] - s.x[3 * i]) / ends;
                down += (s.body->rest[3 * i + 2] - s.x[3 * i + 2]) / ends;
            }
        printf("  strip, P L^2 / EI = %g: down %.5f L (%.5f), back %.5f L (%.5f), left %.1e\n", want[c][0],
               down / free_length, want[c][1], back / free_length, want[c][2], left);
        assert_true(left < 1e-8);
        assert_true(fabs(down / free_length / want[c][1] - 1) < 1e-3);
        assert_true(fabs(back / free_length / want[c][2] - 1) < 2e-3);
    }
    free(load), free(u), free(fixed);
    fixture_free(&s);
}

static void nothing_but_a_rigid_motion_goes_without_energy_in_a_shell(void **state)
{
    (void)state;
    cn_wall_spec spec = plain_wall[1];
    spec.thickness = 0.05;
    for (int kind = 0; kind < 3; kind++) {
        cn_surface *surface;
        const double zero[3] = {0};
        if (kind == 0)
            surface = wall_grid(7, 6, 0.3, false, wall_bent);
        else if (kind == 1)
            surface = wall_grid(9, 5, 0, true, wall_tube);
        else
            assert_int_equal(cn_surface_sphere(&surface, zero, 1), CN_OK);
        fixture s = wall_of(surface, spec);
        const int n = s.body->nnode;
        unsigned char *fixed = flags(3 * n);
        cn_solver *solver;
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        const double stiff = largest(s.matrix->value, 9 * s.matrix->nblock);
        for (int k = 0; k < 6; k++) { /* small motions: K is frozen */
            double sum[3] = {0}, turn[3] = {k == 3, k == 4, k == 5};
            for (int i = 0; i < n; i++) {
                double u[3] = {k == 0, k == 1, k == 2};
                if (k > 2) cn_cross(turn, s.body->rest + 3 * i, u);
                cn_add(s.body->rest + 3 * i, u, s.x + 3 * i);
            }
            fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            for (int i = 0; i < n; i++)
                cn_axpy(1, s.f + 3 * i, sum);
            assert_true(largest(s.f, 3 * n) < 1e-13 * stiff && cn_norm(sum) < 1e-12 * stiff);
        }
        stir(&s, 5, 0.1); /* forces of any motion leave momentum alone */
        fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
        double sum[3] = {0}, moment[3] = {0};
        for (int i = 0; i < n; i++) {
            double m[3];
            cn_cross(s.body->rest + 3 * i, s.f + 3 * i, m);
            cn_axpy(1, s.f + 3 * i, sum), cn_axpy(1, m, moment);
        }
        assert_true(cn_norm(sum) < 1e-12 * stiff && cn_norm(moment) < 1e-12 * stiff);
        const int held[6] = {0, 1, 2, 3 * (n - 1), 3 * (n - 1) + 1, 3 * (n / 2) + 2};
        for (int k = 0; k < 6; k++) /* a statically determinate hold is all it needs */
            fixed[held[k]] = 1;
        if (kind == 1) fixed[held[4]] = 0, fixed[3 * (n - 1) + 2] = 1;
        assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
        assert_int_equal(fixture_factor(&s, solver, CN_TANGENT_PROJECTED, fixed), CN_OK);
        cn_solver_free(solver);
        free(fixed);
        fixture_free(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(constant_curvature_is_exact_and_in_balance_on_any_mesh),
        cmocka_unit_test(a_supported_plate_gives_way_as_naviers_on_regular_and_irregular_meshes),
        cmocka_unit_test(a_free_strip_bends_as_a_beam_its_rims_without_moment),
        cmocka_unit_test(a_cylinder_pinched_along_two_lines_is_a_ring),
        cmocka_unit_test(the_roof_of_scordelis_and_lo_sinks_as_published),
        cmocka_unit_test(a_strip_whose_triangles_turn_bends_as_the_elastica),
        cmocka_unit_test(nothing_but_a_rigid_motion_goes_without_energy_in_a_shell),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
