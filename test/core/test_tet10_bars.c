/* Bars of second-order tetrahedra: frequencies, large deflections. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "body_face.h"
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
        assert_true(worst < 0.005 && twist < 0.005);
        free(fixed);
        fixture_free(&s);
        cn_tets_free(mesh);
    }
    json_decref(json);
}

/* --- large deflections --- */

/* A slender round bar from its clamp at z = -1 to its end at z = 0, of bending stiffness E I as the circle.
 */
typedef struct {
    fixture s;
    int n, per; /* nodes; of the end's section, which come first */
    unsigned char *fixed;
    double *end, *weight,
        *couple; /* shares (n): of a force on the end, of the weight; -x / I over its area */
    double *dx, ei;
    cn_solver *solver;
} bar;

static void scale_to(double sum, int n, double *share)
{
    double all = 0;
    for (int i = 0; i < n; i++)
        all += share[i];
    for (int i = 0; i < n; i++)
        share[i] *= sum / all;
}

static bar bar_new(void)
{
    const double diameter = 0.01, young = 1e6, moment = pi / 64 * pow(diameter, 4);
    const int stations = 51, sides = 6;
    const cn_material m = {.young = young, .poisson = 0.3, .density = 1};
    int point[CN_FACE_NODES];
    cn_tets *mesh;
    assert_int_equal(cn_tets_catheter10(&mesh, 1, diameter, 0, stations, sides, NULL), CN_OK);
    bar b = {.s = fixture_of(mesh, &m), .n = mesh->nnode, .ei = young * moment};
    const int n = b.n;
    b.per = n / (2 * stations - 1), b.fixed = flags(3 * n), b.dx = numbers(3 * n);
    b.end = numbers(n), b.weight = numbers(n), b.couple = numbers(n);
    unsigned char *end = flags(n);
    int *level = calloc((size_t)n, sizeof *level);
    assert_non_null(level);
    for (int i = 0; i < n; i++)
        end[i] = i < b.per, level[i] = i / b.per / 2, b.weight[i] = b.s.body->mass[i];
    clamp(b.s.body, 2, -1, b.fixed);
    for (int i = 0; i < n; i++) /* in its plane: a couple beyond pi/2 sqrt(E I G J) would turn it out */
        if (fabs(b.s.body->rest[3 * i + 1]) < 1e-9 * diameter) b.fixed[3 * i + 1] = 1;
    cn_body_face_shares(b.s.body, end, b.end);
    scale_to(1, n, b.end), scale_to(1, n, b.weight);
    for (int face = 0; cn_body_face(b.s.body, face, point) > 0; face++) {
        bool of_end = true;
        for (int a = 0; a < CN_FACE_NODES; a++)
            of_end = of_end && end[point[a]];
        for (int k = 0; of_end && k < CN_FACE_POINTS; k++) {
            double shape[CN_FACE_NODES], place[3], area[3];
            cn_body_face_at(b.s.body, face, k, shape, place, area);
            for (int a = 0; a < CN_FACE_NODES; a++)
                b.couple[point[a]] -= shape[a] * place[0] / moment * cn_norm(area);
        }
    }
    assert_int_equal(cn_solver_new(&b.solver, b.s.matrix, CN_LINEAR_CHAIN, level, NULL), CN_OK);
    free(end), free(level);
    cn_tets_free(mesh);
    return b;
}

static void bar_free(bar *b)
{
    cn_solver_free(b->solver);
    free(b->fixed), free(b->end), free(b->weight), free(b->couple), free(b->dx);
    fixture_free(&b->s);
}

/* Direction of the bar at its end, from its section's line along x. */
static void end_tangent(const bar *b, double t[3])
{
    double across[3] = {0};
    for (int i = 0; i < b->per; i++)
        cn_axpy(b->s.body->rest[3 * i], b->s.x + 3 * i, across);
    t[0] = -across[2], t[1] = 0, t[2] = across[0];
    cn_normalise(t);
}

/* Equilibrium under forces along x on the end and of the weight, one along z on the end, and a couple about y
 * that turns with the end. */
static void settle(bar *b, double end, double weight, double axial, double couple)
{
    double change = 1;
    for (int pass = 0; pass < 40 && change > 1e-10; pass++) {
        double t[3];
        if (fixture_factor(&b->s, b->solver, CN_TANGENT_EXACT, b->fixed) != CN_OK)
            assert_int_equal(fixture_factor(&b->s, b->solver, CN_TANGENT_PROJECTED, b->fixed), CN_OK);
        end_tangent(b, t);
        for (int i = 0; i < b->n; i++) {
            b->s.f[3 * i] += end * b->end[i] + weight * b->weight[i], b->s.f[3 * i + 2] += axial * b->end[i];
            cn_axpy(couple * b->couple[i], t, b->s.f + 3 * i);
        }
        fixture_solve(b->solver, 3 * b->n, b->s.f, b->fixed, b->dx);
        change = largest(b->dx, 3 * b->n);
        for (int i = 0; i < 3 * b->n; i++)
            b->s.x[i] += b->dx[i];
    }
    assert_true(change <= 1e-10);
}

/* Distance of the end's middle, which is its first node, from (deflection, along) of the root. */
static double end_off(const bar *b, double along, double deflection)
{
    return hypot(b->s.x[0] - deflection, b->s.x[2] + 1 - along);
}

/* The rows (load, end along the bar, its deflection, ...) of a table up to a load. */
static void elastica_of(const char *name, int columns, double most, int kind)
{
    static const char *const says[] = {"a tip load", "its own weight", "an end moment"};
    double *row, last = 0, worst = 0;
    const int rows = reference_table(name, columns, &row);
    if (rows == 0) {
        free(row);
        skip();
    }
    bar b = bar_new();
    for (int r = 0; r < rows && row[columns * r] <= most; r++) {
        const double *want = row + columns * r;
        const int steps = 1 + (int)((kind == 2 ? 4 : 1) * (want[0] - last));
        for (int k = 1; k <= steps; k++) {
            const double load = b.ei * (last + (want[0] - last) * k / steps);
            settle(&b, kind == 0 ? load : 0, kind == 1 ? load : 0, 0, kind == 2 ? load : 0);
        }
        last = want[0];
        worst = fmax(worst, end_off(&b, want[1], want[2]));
    }
    print_message("elastica under %s: tip to %.1e of the length\n", says[kind], worst);
    assert_true(last > 1 && worst < (kind == 2 ? 5e-3 : 1e-3)); /* a whole turn gathers the error of E I */
    bar_free(&b), free(row);
}

static void slender_bars_bend_as_the_elastica(void **state)
{
    (void)state;
    elastica_of("data/elastica_tip_load.csv", 5, 10, 0);
    elastica_of("data/elastica_own_weight.csv", 5, 10, 1);
}

static void an_end_moment_rolls_the_bar_into_a_circle(void **state)
{
    (void)state;
    elastica_of("data/elastica_end_moment.csv", 4, 2 * pi * (1 + 1e-9), 2);
}

/* Half of the pinned bar, clamped at its middle. By the load: nearer to the bifurcation the place hangs on
 * the last digits of E I. */
static void a_buckled_bar_takes_the_shape_of_the_table(void **state)
{
    (void)state;
    enum { COLUMNS = 5 };
    double *row, worst = 0;
    const int rows = reference_table("data/elastica_pinned_postbuckling.csv", COLUMNS, &row);
    if (rows == 0) {
        free(row);
        skip();
    }
    bar b = bar_new();
    bool buckled = false;
    for (int r = 0; r < rows; r++) {
        const double *want = row + COLUMNS * r, load = -want[1] * b.ei * pi * pi / 4;
        if (want[0] < 0.05) continue;
        for (int k = 0; k <= 8 && !buckled; k++) /* to one side, and then without what pushed it there */
            settle(&b, k < 8 ? b.ei * ldexp(1, -k) : 0, 0, load, 0);
        buckled = true;
        settle(&b, 0, 0, load, 0);
        worst = fmax(worst, end_off(&b, 1 - want[2], 2 * want[3]));
    }
    print_message("post-buckling: place within %.1e of the length\n", worst);
    assert_true(buckled && worst < 5e-3);
    bar_free(&b), free(row);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(clamped_bars_swing_at_their_frequencies),
        cmocka_unit_test(slender_bars_bend_as_the_elastica),
        cmocka_unit_test(an_end_moment_rolls_the_bar_into_a_circle),
        cmocka_unit_test(a_buckled_bar_takes_the_shape_of_the_table),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
