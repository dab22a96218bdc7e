/* The rod against the reference folder (every case of each file), and against published rods. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <jansson.h>

#include "catnav/vec3.h"
#include "read_csv.h"
#include "rod_cases.h"
#include "scene_steps.h"

static const double pi = 3.14159265358979323846;

static json_t *read_json(const char *name)
{
    char path[1024];
    FILE *file = fopen(reference_path(path, name), "rb");
    if (!file) return NULL;
    json_t *json = json_loadf(file, 0, NULL);
    fclose(file);
    assert_non_null(json);
    return json;
}

static double number(const json_t *json, const char *key)
{
    const json_t *value = json_object_get(json, key);
    return json_is_number(value) ? json_number_value(value) : 0;
}

static bool near(double a, double b, double relative)
{
    return fabs(a - b) <= relative * fabs(b);
}

/* Section of a case: round by "d" or "size" (and "inner", "core"), or a square. */
static cn_section section_of(const json_t *c, double density)
{
    const char *kind = json_string_value(json_object_get(c, "section"));
    const json_t *core = json_object_get(c, "core");
    const cn_material m = {.young = number(c, "E"), .poisson = number(c, "nu"), .density = density};
    cn_shape shape = {.kind = kind && !strcmp(kind, "square") ? CN_SHAPE_BEAM : CN_SHAPE_CATHETER};
    cn_section s;
    shape.beam.size[1] = shape.beam.size[2] = number(c, "size");
    shape.catheter.diameter = kind ? number(c, "size") : number(c, "d");
    shape.catheter.inner_diameter = number(c, "inner");
    if (core) {
        shape.catheter.has_core = true;
        shape.catheter.core_diameter = number(core, "d"), shape.catheter.core_young = number(core, "E");
        shape.catheter.core_poisson = number(core, "nu"),
        shape.catheter.core_density = number(core, "density");
    }
    assert_int_equal(cn_section_of(&s, &shape, &m, m.young, NULL), CN_OK);
    return s;
}

/* A slender section of EI = 1: as good as inextensible and unshearable at length 1. */
static cn_section slender(void)
{
    const double stiff = 1e7;
    return (cn_section){.axial = stiff,
                        .shear = {stiff, stiff},
                        .bending = {1, 1},
                        .torsion = 1,
                        .half = {1e-3, 1e-3},
                        .round = true,
                        .young = 1,
                        .poisson = 0.3};
}

static void hold(rod_case *s, int node)
{
    s->fixed[node] = s->fixed[s->body->nnode + node] = 1;
}

/* Turn of the last frame's t from +x about z. */
static double end_slope(const rod_case *s)
{
    const double *q = s->rotation + 4 * (s->body->nnode - 1); /* t = R e_z */
    const double x = 2 * (q[1] * q[3] + q[0] * q[2]), y = 2 * (q[2] * q[3] - q[0] * q[1]);
    return atan2(y, x);
}

static void sections_are_those_of_the_catheters(void **state)
{
    (void)state;
    json_t *file = read_json("data/catheter_rod.json");
    if (!file) skip();
    size_t i;
    json_t *c;
    json_array_foreach(json_object_get(file, "cases"), i, c)
    {
        const cn_section s = section_of(c, number(c, "density"));
        for (int k = 0; k < 2; k++)
            assert_true(near(s.bending[k], number(c, "EI"), 1e-12));
        assert_true(near(s.axial, number(c, "EA"), 1e-12) && near(s.torsion, number(c, "GJ"), 1e-12));
        assert_true(near(s.line_mass, number(c, "mass_per_length"), 1e-12));
    }
    json_decref(file);
}

/* Whether the straight rod holds under the axial load P: ends as `held` says. */
static bool is_stable(const cn_section *section, double length, double load, int held)
{
    enum { N = 100 };
    rod_case s = rod_case_straight(N, length, section);
    const double spring = 1e3 * section->axial / (length / N);
    if (held == 1) { /* pinned at both ends: free to turn but about the axis */
        for (int k = 0; k < 3; k++)
            s.spring[k] = spring;
        s.spring[3 * (N + 1)] = 1e6 * section->torsion / length;
    } else
        hold(&s, 0);
    if (held > 0) s.spring[3 * N + 1] = s.spring[3 * N + 2] = spring;
    if (held == 3)
        for (int k = 0; k < 3; k++)
            s.spring[3 * (2 * N + 1) + k] = 1e6 * section->bending[0] / length;
    for (int i = 0; i <= N; i++) /* its shortened equilibrium */
        s.x[3 * i] *= 1 - load / section->axial;
    rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    rod_case_add_springs(&s);
    const bool stable = cn_solver_factor(s.solver, s.matrix, s.matrix->n, s.fixed, NULL) == CN_OK;
    rod_case_free(&s);
    return stable;
}

static void a_rod_buckles_at_eulers_load(void **state)
{
    (void)state;
    static const char *const name[4] = {"buckling_fixed_free", "buckling_pinned", "buckling_fixed_pinned",
                                        "buckling_fixed_fixed"};
    json_t *file = read_json("data/catheter_rod.json");
    if (!file) skip();
    size_t i;
    json_t *c;
    json_array_foreach(json_object_get(file, "cases"), i, c)
    {
        const cn_section s = section_of(c, 0);
        for (int held = 0; held < 4; held++) {
            const double load = number(c, name[held]), length = number(c, "length");
            if (!is_stable(&s, length, 0.995 * load, held) || is_stable(&s, length, 1.005 * load, held))
                fail_msg("%s, %s", json_string_value(json_object_get(c, "name")), name[held]);
        }
    }
    json_decref(file);
}

/* Tip deflection of n segments under the case's loads, by one linear solve at rest. */
static double deflection(const json_t *c, int n)
{
    const cn_section section = section_of(c, 0);
    const double length = number(c, "length");
    rod_case s = rod_case_straight(n, length, &section);
    hold(&s, 0);
    for (int i = 0; i <= n; i++)
        s.f[3 * i + 1] = number(c, "line_load") * length / n * (i == n ? 0.5 : 1);
    s.f[3 * n + 1] += number(c, "tip_force");
    memcpy(s.load, s.f, 6 * (size_t)(n + 1) * sizeof *s.f);
    rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    assert_int_equal(cn_solver_factor(s.solver, s.matrix, s.matrix->n, s.fixed, NULL), CN_OK);
    assert_int_equal(cn_solver_solve(s.solver, s.load, s.dx, 0, 1, NULL, NULL, NULL), CN_OK);
    const double tip = s.dx[3 * n + 1];
    rod_case_free(&s);
    return tip;
}

static void cantilevers_are_timoshenkos_and_converge_with_the_square(void **state)
{
    (void)state;
    json_t *file = read_json("data/cantilever.json");
    if (!file) skip();
    size_t i;
    json_t *c;
    json_array_foreach(json_object_get(file, "cases"), i, c)
    {
        const cn_section s = section_of(c, 0);
        const double truth = number(c, "tip_timoshenko"), nu = number(c, "nu");
        assert_true(near(s.bending[0], number(c, "EI"), 1e-12) && near(s.torsion, number(c, "GJ"), 1e-12));
        assert_true(
            near(s.shear[0], number(c, "cowper") * number(c, "E") / (2 * (1 + nu)) * number(c, "A"), 1e-12));
        const double coarse = deflection(c, 10) / truth - 1, fine = deflection(c, 20) / truth - 1;
        const double error = deflection(c, 100) / truth - 1, order = log2(fabs(coarse / fine));
        print_message("cantilever %zu: error %.1e at 100 segments, order %.3f\n", i, error, order);
        assert_true(fabs(error) < 1e-4 && fabs(order - 2) < 0.05);
    }
    json_decref(file);
}

/* Greatest distance from the table over its rows up to the load `most`, in lengths; `solve` gives x, y and
 * slope of the tip. */
typedef void (*elastica)(int n, double load, double tip[3]);
static double elastica_error(const char *name, const char *load, double most, int n, elastica solve)
{
    csv table;
    double worst = 0;
    if (!csv_read(&table, name)) return NAN;
    for (int row = 0; row < table.nrow; row++) {
        double tip[3];
        if (csv_number(&table, row, load) > most) continue;
        solve(n, csv_number(&table, row, load), tip);
        const double x = tip[0] - csv_number(&table, row, "x_tip/L"),
                     y = tip[1] - csv_number(&table, row, "deflection/L");
        const double slope = remainder(tip[2] - csv_number(&table, row, "tip_slope_rad"), 2 * pi);
        worst = fmax(worst, fmax(hypot(x, y), fabs(slope)));
    }
    csv_free(&table);
    return worst;
}

static void finish(rod_case *s, double tip[3])
{
    const int last = s->body->nnode - 1;
    tip[0] = s->x[3 * last], tip[1] = s->x[3 * last + 1], tip[2] = end_slope(s);
    rod_case_free(s);
}

/* Equilibrium under the loads of s, raised in parts. */
static void raise_load(rod_case *s, int parts)
{
    const int n = 3 * s->body->nblock;
    double *full = malloc((size_t)n * sizeof *full);
    assert_non_null(full);
    memcpy(full, s->load, (size_t)n * sizeof *full);
    for (int k = 1; k <= parts; k++) {
        for (int i = 0; i < n; i++)
            s->load[i] = full[i] * k / parts;
        assert_true(rod_case_solve(s) > 0);
    }
    free(full);
}

static void by_tip_load(int n, double load, double tip[3])
{
    const cn_section section = slender();
    rod_case s = rod_case_straight(n, 1, &section);
    hold(&s, 0);
    s.load[3 * n + 1] = load;
    raise_load(&s, 1 + (int)(2 * load));
    finish(&s, tip);
}

static void by_own_weight(int n, double load, double tip[3])
{
    const cn_section section = slender();
    rod_case s = rod_case_straight(n, 1, &section);
    hold(&s, 0);
    for (int i = 0; i <= n; i++)
        s.load[3 * i + 1] = load / n * (i == n ? 0.5 : 1);
    raise_load(&s, 1 + (int)(2 * load));
    finish(&s, tip);
}

static void by_end_moment(int n, double load, double tip[3])
{
    const cn_section section = slender();
    rod_case s = rod_case_straight(n, 1, &section);
    hold(&s, 0);
    s.load[3 * (2 * n + 1) + 2] = load;
    raise_load(&s, 1 + (int)load);
    finish(&s, tip);
}

static void elasticas_are_those_of_the_tables(void **state)
{
    (void)state;
    const struct {
        const char *name, *load;
        elastica solve;
    } table[3] = {{"data/elastica_tip_load.csv", "alpha=P*L^2/(E*I)", by_tip_load},
                  {"data/elastica_own_weight.csv", "beta=w*L^3/(E*I)", by_own_weight},
                  {"data/elastica_end_moment.csv", "M*L/(E*I)", by_end_moment}};
    for (int i = 0; i < 3; i++) {
        const double coarse = elastica_error(table[i].name, table[i].load, INFINITY, 50, table[i].solve);
        if (isnan(coarse)) skip();
        const double fine = elastica_error(table[i].name, table[i].load, INFINITY, 100, table[i].solve);
        print_message("%s: error %.1e L at 100 segments, order %.3f\n", table[i].name, fine,
                      log2(coarse / fine));
        assert_true(fine < 1e-3);
        if (i > 0) continue; /* 20 segments up to alpha 10 */
        const double few = elastica_error(table[i].name, table[i].load, 10, 20, table[i].solve);
        print_message("20 segments: %.1e L\n", few);
        assert_true(few < 1e-3);
    }
}

/* One turn by an end moment: one-point segments of one curvature form a regular polygon, which closes. */
static void an_end_moment_rolls_the_rod_into_a_closed_circle(void **state)
{
    (void)state;
    for (int n = 10; n <= 100; n *= 10) {
        double tip[3];
        by_end_moment(n, 2 * pi, tip);
        print_message("roll-up of %d segments: gap %.1e L\n", n, hypot(tip[0], tip[1]));
        assert_true(hypot(tip[0], tip[1]) < (n == 10 ? 1e-4 : 1e-6));
    }
}

/* Half of the pinned rod, held at its middle, its end brought nearer by a stiff spring: by the load the place
 * near the bifurcation would hang on its last digits. */
static void a_buckled_rod_takes_the_shape_and_load_of_the_table(void **state)
{
    (void)state;
    enum { N = 100 };
    csv table;
    const cn_section section = slender();
    const double spring = 1e8;
    double worst = 0, worst_load = 0;
    if (!csv_read(&table, "data/elastica_pinned_postbuckling.csv")) skip();
    for (int row = 0; row < table.nrow; row++) {
        const double nearer = csv_number(&table, row, "shortening/L") / 2;
        rod_case s = rod_case_straight(N, 0.5, &section);
        hold(&s, 0);
        s.spring[3 * N] = spring, s.load[3 * N] = -spring * nearer;
        s.load[3 * N + 1] = 1; /* to one side, and then without what pushed it there */
        raise_load(&s, 20);
        for (int k = 0; k <= 20; k++) {
            s.load[3 * N + 1] = k < 20 ? ldexp(1, -k) : 0;
            assert_true(rod_case_solve(&s) > 0);
        }
        const double dx = 0.5 - s.x[3 * N] - nearer, load = spring * -dx / (pi * pi);
        const double dy = fabs(s.x[3 * N + 1]) - csv_number(&table, row, "midpoint_deflection/L");
        worst = fmax(worst, fabs(dy));
        worst_load = fmax(worst_load, fabs(fabs(load) / csv_number(&table, row, "P/P_euler") - 1));
        rod_case_free(&s);
    }
    print_message("post-buckling: place within %.1e L, load within %.1e\n", worst, worst_load);
    assert_true(worst < 1e-3 && worst_load < 1e-3);
    csv_free(&table);
}

/* Bathe and Bolourchi, IJNME 14 (1979): arc of 45 degrees, radius 100, section 1 x 1, E 1e7, nu 0, a force
 * of 600 across its plane at the tip. Published tips: (15.9, 47.2, 53.4) there; Simo and Vu-Quoc (1986)
 * (15.79, 47.23, 53.37), both with 8 elements. */
static void the_bend_of_45_degrees_is_bathes_and_bolourchis(void **state)
{
    (void)state;
    const double published[3] = {15.79, 47.23, 53.37};
    double tip[2][3], axis[3 * 101];
    cn_section section[100];
    for (int level = 0; level < 2; level++) {
        const int n = level ? 100 : 8;
        for (int i = 0; i < n; i++)
            section[i] = (cn_section){.axial = 1e7,
                                      .shear = {5e6, 5e6},
                                      .bending = {1e7 / 12, 1e7 / 12},
                                      .torsion = 5e6 / 6,
                                      .half = {0.5, 0.5},
                                      .young = 1e7};
        for (int i = 0; i <= n; i++) {
            const double a = pi / 4 * i / n;
            axis[3 * i] = 100 * (1 - cos(a)), axis[3 * i + 1] = 100 * sin(a), axis[3 * i + 2] = 0;
        }
        rod_case s = rod_case_new(n + 1, axis, (const double[3]){0, 0, 1}, section, NULL);
        hold(&s, 0);
        s.load[3 * n + 2] = 600;
        raise_load(&s, 3);
        cn_copy3(s.x + 3 * n, tip[level]);
        rod_case_free(&s);
        print_message("bend, %d segments: tip (%.3f, %.3f, %.3f)\n", n, tip[level][0], tip[level][1],
                      tip[level][2]);
    }
    assert_true(cn_distance(tip[0], published) < 0.5); /* 0.5 % of the radius */
    assert_true(cn_distance(tip[1], tip[0]) < 0.5);
}

static void torsion_is_exact_for_any_number_of_turns(void **state)
{
    (void)state;
    enum { N = 100 };
    cn_section section = slender();
    section.torsion = 0.25, section.bending[0] = section.bending[1] = 100; /* or it leaves its line */
    rod_case s = rod_case_straight(N, 2, &section);
    hold(&s, 0);
    double turned = 0;
    for (int k = 1; k <= 8; k++) { /* 0.16 rad a segment in the end */
        s.load[3 * (2 * N + 1)] = 0.25 * k;
        assert_true(rod_case_solve(&s) > 0);
        const double *q = s.rotation + 4 * N, *q0 = s.rotation;
        const double w = q[0] * q0[0] + cn_dot(q + 1, q0 + 1);
        const double angle = 2 * acos(fmin(1, fabs(w)));
        turned = 0.25 * k * 2 / 0.25;
        assert_true(fabs(remainder(angle - turned, 2 * pi)) < 1e-7 ||
                    fabs(remainder(angle + turned, 2 * pi)) < 1e-7);
    }
    assert_true(turned > 4 * pi);
    rod_case_free(&s);
}

/* --- vibration --- */

enum { BAR = 200, UNKNOWNS = 6 * (BAR + 1), MODES = 6 };

/* Lowest frequencies [Hz] of motions in the two components given (of places, of turns; -1: none), by inverse
 * iteration with deflation on K + shift M and the lumped M. */
static void frequencies(rod_case *s, const int component[2], double shift, int nmode, double *hz)
{
    static double m[UNKNOWNS], mode[MODES][UNKNOWNS];
    memset(m, 0, sizeof m);
    for (int i = 0; i <= BAR; i++)
        for (int k = 0; k < 3; k++) { /* frames: n along y, b along z, t along x */
            static const int axis[3] = {2, 0, 1};
            m[3 * i + k] = s->body->mass[i];
            m[3 * (BAR + 1 + i) + k] = s->body->inertia[3 * i + axis[k]];
        }
    rod_case_force(s, CN_TANGENT_EXACT, s->scatter);
    for (int i = 0; i < UNKNOWNS; i++)
        s->matrix->value[9 * s->matrix->diagonal[i / 3] + 4 * (i % 3)] += shift * m[i];
    assert_int_equal(cn_solver_factor(s->solver, s->matrix, s->matrix->n, s->fixed, NULL), CN_OK);
    for (int k = 0; k < nmode; k++) {
        double *u = mode[k], value = 0;
        for (int i = 0; i < UNKNOWNS; i++)
            u[i] = cos(1.7 * i * i + k);
        for (int it = 0; it < 80; it++) {
            double b[UNKNOWNS], size = 0;
            for (int i = 0; i < UNKNOWNS; i++)
                if (i % 3 != component[i >= 3 * (BAR + 1)] || s->fixed[i / 3]) u[i] = 0;
            for (int l = 0; l < k; l++) {
                double along = 0;
                for (int i = 0; i < UNKNOWNS; i++)
                    along += mode[l][i] * m[i] * u[i];
                for (int i = 0; i < UNKNOWNS; i++)
                    u[i] -= along * mode[l][i];
            }
            for (int i = 0; i < UNKNOWNS; i++)
                size += m[i] * u[i] * u[i];
            for (int i = 0; i < UNKNOWNS; i++)
                u[i] /= sqrt(size), b[i] = m[i] * u[i];
            value = 1 / sqrt(size); /* 1 / |K^-1 M u| of the unit u before */
            if (it < 79) assert_int_equal(cn_solver_solve(s->solver, b, u, 0, 1, NULL, NULL, NULL), CN_OK);
        }
        hz[k] = sqrt(fmax(value - shift, 0)) / (2 * pi);
    }
}

static void frequencies_are_those_of_the_table(void **state)
{
    (void)state;
    const struct {
        const char *name;
        int component[2];
        bool held;
        int rigid; /* motions without frequency, which come first */
    } kind[] = {{"axial_fixed_free_Hz", {0, -1}, true, 0},
                {"axial_free_free_Hz", {0, -1}, false, 1},
                {"bending_cantilever_Hz_timoshenko", {1, 2}, true, 0},
                {"torsion_fixed_free_Hz", {-1, 0}, true, 0}};
    json_t *file = read_json("data/vibration.json");
    if (!file) skip();
    size_t i;
    json_t *c;
    json_array_foreach(json_object_get(file, "cases"), i, c)
    {
        const cn_section section = section_of(c, number(c, "density"));
        double worst = 0;
        for (size_t k = 0; k < sizeof kind / sizeof *kind; k++) {
            const json_t *table = json_object_get(c, kind[k].name);
            const int n = (int)json_array_size(table);
            double hz[MODES];
            assert_in_range(n + kind[k].rigid, 1, MODES);
            rod_case s = rod_case_straight(BAR, number(c, "length"), &section);
            if (kind[k].held) hold(&s, 0);
            const double first = 2 * pi * json_number_value(json_array_get(table, 0));
            frequencies(&s, kind[k].component, kind[k].held ? 0 : 0.1 * first * first, n + kind[k].rigid, hz);
            rod_case_free(&s);
            for (int l = 0; l < n; l++) {
                const double truth = json_number_value(json_array_get(table, (size_t)l));
                worst = fmax(worst, fabs(hz[l + kind[k].rigid] / truth - 1));
                if (!near(hz[l + kind[k].rigid], truth, 2e-3))
                    fail_msg("case %zu, %s %d: %g Hz, not %g", i, kind[k].name, l, hz[l + kind[k].rigid],
                             truth);
            }
        }
        print_message("vibration %zu: frequencies within %.1e at %d segments\n", i, worst, BAR);
    }
    json_decref(file);
}

/* Laid along an arc of any plane, more than a whole turn, a straight rod has that curvature's energy and no
 * other; at rest its frames stay; along a line that folds back they stay, too. */
static void frames_follow_the_line_that_a_rod_starts_along(void **state)
{
    enum { N = 200 };
    const double length = 2, turn = 7, radius = length / turn;
    const cn_section section = {.axial = 1e6,
                                .shear = {1e6, 1e6},
                                .bending = {3, 3},
                                .torsion = 5,
                                .line_mass = 1,
                                .line_inertia = {1, 1, 1},
                                .area = 1,
                                .half = {0.01, 0.01}};
    rod_case s = rod_case_straight(N, length, &section);
    double *frame = malloc(4 * (N + 1) * sizeof *frame);
    (void)state;
    assert_non_null(frame);
    cn_rod_follow(s.body, s.x, s.rotation);
    assert_true(rod_case_force(&s, CN_TANGENT_EXACT, NULL) < 1e-20);
    for (int plane = 0; plane < 8; plane++) {
        const double c = cos(2 * pi * plane / 8), d = sin(2 * pi * plane / 8);
        for (int i = 0; i <= N; i++) {
            const double a = turn * (i / (double)N - 0.3); /* chords as long as the rod's segments */
            const double chord = radius * (turn / N) / (2 * sin(0.5 * turn / N));
            s.x[3 * i] = chord * sin(a), s.x[3 * i + 1] = c * chord * cos(a),
                    s.x[3 * i + 2] = d * chord * cos(a);
        }
        cn_body_rotation_start(s.body, s.rotation);
        cn_rod_follow(s.body, s.x, s.rotation);
        const double energy = rod_case_force(&s, CN_TANGENT_EXACT, NULL);
        const double beam = 0.5 * section.bending[0] * length / (radius * radius);
        if (!(fabs(energy / beam - 1) < 1e-3)) fail_msg("plane %d: %g, not %g", plane, energy, beam);
    }
    memcpy(frame, s.rotation, 4 * (N + 1) * sizeof *frame);
    for (int k = 0; k < 3; k++)
        s.x[3 * 50 + k] = s.x[3 * 48 + k];
    cn_rod_follow(s.body, s.x, s.rotation);
    assert_memory_equal(frame, s.rotation, 4 * (N + 1) * sizeof *frame);
    free(frame);
    rod_case_free(&s);
}

/* --- from a scene: what a solve finds of a device's stiffness --- */

/* A catheter along +x, held at its start, after one static step under a load at its tip; `more` ends its
 * shape, `material` its material. */
static scene_steps loaded(double length, double diameter, int stations, const char *more, double young,
                          double poisson, const char *material, const char *load)
{
    char text[1024];
    scene_steps s;
    snprintf(
        text, sizeof text,
        "scene: loaded\ngravity: [0, 0, 0]\nstep: 1\ntime_limit: 1\ncontact: {method: none}\n"
        "solver: {tolerance: 1e-10}\nbodies:\n  - name: device\n    model: rod\n"
        "    shape: {catheter: {length: %.17g, diameter: %.17g, entry: [%.17g, 0, 0], direction: [1, 0, 0], "
        "stations: %d, sides: 6, sheath: off%s}}\n"
        "    material: {young: %.17g, poisson: %.17g, density: 0%s}\n"
        "    fixed: {box: [[%g, -1, -1], [%g, 1, 1]]}\n"
        "    load: [{box: [[%.17g, -1, -1], [%.17g, 1, 1]], %s}]\n",
        length, diameter, length, stations, more, young, poisson, material, -1e-6 * length, 1e-6 * length,
        length * (1 - 1e-6), length * (1 + 1e-6), load);
    scene_steps_new(&s, text, 0, NULL);
    scene_steps_go(&s, 1);
    return s;
}

static int tip_of(const cn_body *body)
{
    int tip = 0;
    for (int i = 0; i < body->nnode; i++)
        if (body->rest[3 * i] > body->rest[3 * tip]) tip = i;
    return tip;
}

static double tip_moved(const scene_steps *s, int axis)
{
    const cn_body *body = s->model->body[0].body;
    const int at = 3 * tip_of(body) + axis;
    return s->state->body[0].x[at] - body->rest[at];
}

/* Angle of the tip's frame from where it started. */
static double tip_turned(const scene_steps *s)
{
    const cn_body *body = s->model->body[0].body;
    const int tip = tip_of(body);
    double *start = calloc(4 * (size_t)body->nturn, sizeof *start), dot = 0;
    assert_non_null(start);
    cn_body_rotation_start(body, start);
    cn_body_turn(body, body->nnode, s->state->body[0].x, s->state->body[0].rotation);
    for (int k = 0; k < 4; k++)
        dot += start[4 * tip + k] * s->state->body[0].rotation[4 * tip + k];
    free(start);
    return 2 * acos(fmin(1, fabs(dot)));
}

static void a_device_of_a_scene_has_the_stiffness_of_its_section(void **state)
{
    (void)state;
    json_t *file = read_json("data/catheter_rod.json");
    if (!file) skip();
    size_t i;
    json_t *c;
    json_array_foreach(json_object_get(file, "cases"), i, c)
    {
        const double length = number(c, "length");
        const json_t *core = json_object_get(c, "core");
        char more[256] = "", load[128];
        int at = 0;
        if (number(c, "inner") > 0)
            at = snprintf(more, sizeof more, ", inner_diameter: %.17g", number(c, "inner"));
        if (core)
            snprintf(more + at, sizeof more - (size_t)at,
                     ", core: {diameter: %.17g, young: %.17g, poisson: %.17g, density: 0}", number(core, "d"),
                     number(core, "E"), number(core, "nu"));
        double off[2]; /* a moment about z, about x bends, twists by 0.02 */
        for (int k = 0; k < 2; k++) {
            snprintf(load, sizeof load, k ? "moment: [%.17g, 0, 0]" : "moment: [0, 0, %.17g]",
                     0.02 * number(c, k ? "GJ" : "EI") / length);
            scene_steps s =
                loaded(length, number(c, "d"), 455, more, number(c, "E"), number(c, "nu"), "", load);
            off[k] = 0.02 / tip_turned(&s) - 1;
            scene_steps_free(&s);
        }
        print_message("%s, 455 stations: EI of a solve off by %.1e, GJ by %.1e\n",
                      json_string_value(json_object_get(c, "name")), off[0], off[1]);
        assert_true(fabs(off[0]) < 1e-3 && fabs(off[1]) < 1e-3);
    }
    json_decref(file);
}

/* Stiff shaft, soft end: each part turns and shifts the tip by its own moments. */
static void a_stiff_shaft_with_a_soft_tip_bends_as_its_parts_do(void **state)
{
    (void)state;
    const double length = 1, soft = 0.3, diameter = 2e-3, hard_young = 2e9, soft_young = 1e7;
    const double moment = pi / 64 * pow(diameter, 4), rest = pow(length, 3) - pow(soft, 3);
    const double compliance = (rest / hard_young + pow(soft, 3) / soft_young) / (3 * moment);
    char material[128], load[128];
    snprintf(material, sizeof material, ", regions: [{along: [0, %.17g], young: %.17g}]", soft, soft_young);
    snprintf(load, sizeof load, "force: [0, 0, %.17g]", 1e-3 * length / compliance);
    scene_steps s = loaded(length, diameter, 201, "", hard_young, 0.3, material, load);
    const double off = tip_moved(&s, 2) / (1e-3 * length) - 1;
    print_message("a soft tip on a stiff shaft: deflection off by %.1e\n", off);
    assert_true(fabs(off) < 1e-3);
    scene_steps_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sections_are_those_of_the_catheters),
        cmocka_unit_test(a_rod_buckles_at_eulers_load),
        cmocka_unit_test(cantilevers_are_timoshenkos_and_converge_with_the_square),
        cmocka_unit_test(elasticas_are_those_of_the_tables),
        cmocka_unit_test(an_end_moment_rolls_the_rod_into_a_closed_circle),
        cmocka_unit_test(a_buckled_rod_takes_the_shape_and_load_of_the_table),
        cmocka_unit_test(the_bend_of_45_degrees_is_bathes_and_bolourchis),
        cmocka_unit_test(torsion_is_exact_for_any_number_of_turns),
        cmocka_unit_test(frequencies_are_those_of_the_table),
        cmocka_unit_test(a_device_of_a_scene_has_the_stiffness_of_its_section),
        cmocka_unit_test(a_stiff_shaft_with_a_soft_tip_bends_as_its_parts_do),
        cmocka_unit_test(frames_follow_the_line_that_a_rod_starts_along),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
