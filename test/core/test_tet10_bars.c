/* Bars of second-order tetrahedra: frequencies, large deflections. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "body_fixture.h"
#include "catnav/vec3.h"
#include "stepper.h"

static const double pi = 3.14159265358979323846;

/* Clamps the section at x[axis] == place as beam theory does: its plane is held, but it may contract towards
 * its middle lines, along which nothing moves across. */
static void clamp(const cn_body *body, int axis, double place, unsigned char *fixed)
{
    double box[2][3] = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int i = 0; i < 3 * body->nnode; i++) {
        box[0][i % 3] = fmin(box[0][i % 3], body->rest[i]);
        box[1][i % 3] = fmax(box[1][i % 3], body->rest[i]);
    }
    for (int i = 0; i < body->nnode; i++)
        for (int k = 0; k < 3; k++) {
            const double *x = body->rest + 3 * i, slack = 1e-9 * (box[1][k] - box[0][k]);
            const double held = k == axis ? place : (box[0][k] + box[1][k]) / 2;
            fixed[3 * i + k] = fabs(x[axis] - place) < 1e-9 && fabs(x[k] - held) <= slack;
        }
}

/* --- frequencies --- */

enum { MODES = 12 };

/* Eigenvalues, ascending, and eigenvectors (columns) of a symmetric matrix, by Jacobi rotations. */
static void eigen(double a[MODES][MODES], double v[MODES][MODES])
{
    for (int i = 0; i < MODES * MODES; i++)
        v[i / MODES][i % MODES] = i / MODES == i % MODES;
    for (int sweep = 0; sweep < 40; sweep++)
        for (int p = 0; p < MODES; p++)
            for (int q = p + 1; q < MODES; q++) {
                if (a[p][q] == 0) continue;
                const double h = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                const double t = copysign(1, h) / (fabs(h) + sqrt(h * h + 1)), c = 1 / sqrt(t * t + 1),
                             s = t * c;
                for (int k = 0; k < MODES; k++) {
                    const double kp = a[k][p], kq = a[k][q];
                    a[k][p] = c * kp - s * kq, a[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < MODES; k++) {
                    const double pk = a[p][k], qk = a[q][k], vp = v[k][p], vq = v[k][q];
                    a[p][k] = c * pk - s * qk, a[q][k] = s * pk + c * qk;
                    v[k][p] = c * vp - s * vq, v[k][q] = s * vp + c * vq;
                }
            }
    for (int i = 0; i < MODES; i++)
        for (int j = i + 1; j < MODES; j++)
            if (a[j][j] < a[i][i]) {
                const double swap = a[i][i];
                a[i][i] = a[j][j], a[j][j] = swap;
                for (int k = 0; k < MODES; k++) {
                    const double other = v[k][i];
                    v[k][i] = v[k][j], v[k][j] = other;
                }
            }
}

/* Lowest frequencies [Hz] of a body without the components `fixed`, with its lumped masses: inverse iteration
 * of a subspace, M-orthonormal by Gram and Schmidt, in which 1 / w^2 are the eigenvalues of X' M K^-1 M X.
 * turning: modes that move no centre of mass, those of torsion. */
static void frequencies(fixture *s, const unsigned char *fixed, double hz[MODES], bool turning[MODES])
{
    const int n = 3 * s->body->nnode;
    cn_solver *solver;
    double *x = numbers(MODES * n), *y = numbers(MODES * n), *b = numbers(n), h[MODES][MODES],
           v[MODES][MODES];
    unsigned seed = 3;
    assert_int_equal(cn_solver_new(&solver, s->matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    assert_int_equal(fixture_factor(s, solver, CN_TANGENT_WARPED, fixed), CN_OK);
    for (int i = 0; i < MODES * n; i++)
        y[i] = fixed[i % n] ? 0 : shape_random(&seed);
    for (int pass = 0; pass < 8; pass++) {
        for (int k = 0; k < MODES; k++) { /* x: orthonormal basis of y */
            double *xk = x + k * n, norm = 0;
            memcpy(xk, y + k * n, (size_t)n * sizeof *x);
            for (int twice = 0; twice < 2; twice++)
                for (int j = 0; j < k; j++) {
                    double dot = 0;
                    for (int i = 0; i < n; i++)
                        dot += x[j * n + i] * s->body->mass[i / 3] * xk[i];
                    for (int i = 0; i < n; i++)
                        xk[i] -= dot * x[j * n + i];
                }
            for (int i = 0; i < n; i++)
                norm += s->body->mass[i / 3] * xk[i] * xk[i];
            for (int i = 0; i < n; i++)
                xk[i] /= sqrt(norm);
        }
        for (int k = 0; k < MODES; k++) {
            for (int i = 0; i < n; i++)
                b[i] = s->body->mass[i / 3] * x[k * n + i];
            fixture_solve(solver, n, b, fixed, y + k * n);
        }
    }
    for (int k = 0; k < MODES; k++)
        for (int j = 0; j < MODES; j++) {
            h[k][j] = 0;
            for (int i = 0; i < n; i++)
                h[k][j] += x[k * n + i] * s->body->mass[i / 3] * y[j * n + i];
        }
    for (int k = 0; k < MODES; k++) /* ascending frequencies are descending eigenvalues */
        for (int j = 0; j < MODES; j++)
            v[k][j] = -0.5 * (h[k][j] + h[j][k]);
    memcpy(h, v, sizeof h);
    eigen(h, v);
    for (int k = 0; k < MODES; k++) {
        double momentum[3] = {0}, mass = 0, square = 0;
        for (int i = 0; i < n; i++) {
            double u = 0;
            for (int j = 0; j < MODES; j++)
                u += v[j][k] * x[j * n + i];
            mass += s->body->mass[i / 3] / 3, momentum[i % 3] += s->body->mass[i / 3] * u;
            square += s->body->mass[i / 3] * u * u;
        }
        hz[k] = 1 / (2 * pi * sqrt(-h[k][k]));
        turning[k] = cn_norm(momentum) < 0.02 * sqrt(mass * square);
    }
    cn_solver_free(solver);
    free(x), free(y), free(b);
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* What a clamp of the whole root face, which also holds the contraction, makes of a square cantilever's tip
 * deflection over Timoshenko's; 1 where the folder does not say. */
static double solid_limit(double slenderness, double nu)
{
    json_t *json = reference_json("data/p1_convergence.json"), *item;
    double limit = 1;
    size_t c;
    json_array_foreach(json_object_get(json, "solid_limits"), c, item)
    {
        const double ratio = json_number(item, "length") / json_number(item, "depth");
        if (fabs(ratio / slenderness - 1) < 1e-9 && json_number(item, "nu") == nu)
            limit = json_number(item, "solid_limit_over_timoshenko");
    }
    json_decref(json);
    return limit;
}

/* Bending by Timoshenko (each twice), torsion, tension: the lowest modes in order. The square bar is clamped
 * on its whole root face. */
static void clamped_bars_swing_at_their_frequencies(void **state)
{
    (void)state;
    json_t *json = reference_json("data/vibration.json"), *item;
    if (!json) skip();
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        const bool square = !strcmp(json_string_value(json_object_get(item, "section")), "square");
        const double length = json_number(item, "length"), size = json_number(item, "size");
        const cn_material m = {.young = json_number(item, "E"),
                               .poisson = json_number(item, "nu"),
                               .density = json_number(item, "density")};
        cn_tets *linear, *mesh;
        const double limit = square ? solid_limit(length / size, m.poisson) : 1;
        double want[32], hz[MODES], worst = 0, twist = 0, polar = 0, torsion[8];
        bool turning[MODES];
        const double sizes[3] = {length, size, size}, middle = square ? size / 2 : 0;
        const int cells[3] = {28, 4, 4};
        if (square) {
            assert_int_equal(cn_tets_beam(&linear, sizes, cells, NULL), CN_OK);
            mesh = shape_raised(linear, 0, 1);
        } else {
            assert_int_equal(cn_tets_catheter10(&mesh, length, size, 0, 49, 8, NULL), CN_OK);
        }
        fixture s = fixture_of(mesh, &m);
        unsigned char *fixed = flags(3 * mesh->nnode);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            fixed[i] = square && mesh->node[i / 3 * 3] == 0;
        if (!square) clamp(s.body, 2, -length, fixed);
        frequencies(&s, fixed, hz, turning);
        int n = json_numbers(item, "bending_cantilever_Hz_timoshenko", want);
        memcpy(want + n, want, (size_t)n * sizeof *want), n *= 2;
        n += json_numbers(item, "axial_fixed_free_Hz", want + n);
        qsort(want, (size_t)n, sizeof *want, ascending);
        json_numbers(item, "torsion_fixed_free_Hz", torsion);
        for (int i = 0; i < mesh->nnode; i++) { /* lumped masses lie further out than the section's */
            const double *x = mesh->node + 3 * i,
                         r[2] = {x[square ? 1 : 0] - middle, x[square ? 2 : 1] - middle};
            polar += s.body->mass[i] * (r[0] * r[0] + r[1] * r[1]);
        }
        polar /= m.density * length * (square ? pow(size, 4) / 6 : pi / 32 * pow(size, 4));
        for (int k = 0, i = 0, turns = 0; k < MODES - 4; k++)
            if (turning[k])
                twist = fmax(twist, fabs(hz[k] / torsion[turns++] * sqrt(polar) - 1));
            else
                worst = fmax(worst, fabs(hz[k] / want[i++] * sqrt(limit) - 1));
        print_message(
            "%s bar, nu %g: bending and tension to %.3f %%, torsion to %.3f %% but for its lumped inertia, "
            "which is %.3f of the section's\n",
            square ? "square" : "round", m.poisson, 100 * worst, 100 * twist, polar);
        assert_true(worst < 0.005 && twist < 0.01);
        free(fixed);
        fixture_free(&s);
        cn_tets_free(mesh);
    }
    json_decref(json);
}

/* --- large deflections --- */

/* Deflects a slender round bar along -z by forces along x; returns the tip's place, through steps of the
 * load. */
static void elastica_of(bool weight, int rows, const double *row, int columns)
{
    const double length = 1, diameter = 0.01, young = 1e6, moment = pi / 64 * pow(diameter, 4);
    const int stations = 51, sides = 6;
    const cn_material m = {.young = young, .poisson = 0.3, .density = 1};
    cn_tets *mesh;
    double last = 0, worst = 0;
    assert_int_equal(cn_tets_catheter10(&mesh, length, diameter, 0, stations, sides, NULL), CN_OK);
    fixture s = fixture_of(mesh, &m);
    const int n = mesh->nnode, per = n / (2 * stations - 1);
    unsigned char *fixed = flags(3 * n), *end = flags(n);
    int *level = calloc((size_t)n, sizeof *level);
    double *share = numbers(n), sum = 0, *dx = numbers(3 * n);
    cn_solver *solver;
    assert_non_null(level);
    for (int i = 0; i < n; i++)
        end[i] = i < per, level[i] = i / per / 2;
    clamp(s.body, 2, -length, fixed);
    cn_body_face_shares(s.body, end, share);
    for (int i = 0; i < n && weight; i++)
        share[i] = s.body->mass[i];
    for (int i = 0; i < n; i++)
        sum += share[i];
    assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHAIN, level, NULL), CN_OK);
    for (int r = 0; r < rows; r++) {
        const double *want = row + columns * r, load = want[0] * young * moment / (length * length);
        if (want[0] > 10) break;
        const int steps = 1 + (int)(want[0] - last);
        for (int k = 1; k <= steps; k++) {
            const double part = load * (last + (want[0] - last) * k / steps) / want[0];
            double change = 1;
            for (int pass = 0; pass < 30 && change > 1e-10; pass++) {
                if (fixture_factor(&s, solver, CN_TANGENT_EXACT, fixed) != CN_OK)
                    assert_int_equal(fixture_factor(&s, solver, CN_TANGENT_PROJECTED, fixed), CN_OK);
                for (int i = 0; i < n; i++)
                    s.f[3 * i] += part * share[i] / sum;
                fixture_solve(solver, 3 * n, s.f, fixed, dx);
                change = largest(dx, 3 * n);
                for (int i = 0; i < 3 * n; i++)
                    s.x[i] += dx[i];
            }
            assert_true(change <= 1e-10);
        }
        last = want[0];
        worst = fmax(worst, hypot(s.x[0] - want[2], s.x[2] + length - want[1]));
    }
    print_message("elastica under %s: tip to %.1e of the length\n", weight ? "its own weight" : "a tip load",
                  worst);
    cn_solver_free(solver);
    free(fixed), free(end), free(level), free(share), free(dx);
    fixture_free(&s);
    cn_tets_free(mesh);
}

static void slender_bars_bend_as_the_elastica(void **state)
{
    (void)state;
    for (int weight = 0; weight < 2; weight++) {
        double *row;
        const int columns = 5;
        const int n = reference_table(weight ? "data/elastica_own_weight.csv" : "data/elastica_tip_load.csv",
                                      columns, &row);
        if (n > 0) elastica_of(weight, n, row, columns);
        free(row);
        if (n == 0) skip();
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(clamped_bars_swing_at_their_frequencies),
        cmocka_unit_test(slender_bars_bend_as_the_elastica),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
