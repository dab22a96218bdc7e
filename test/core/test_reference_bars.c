/* Bars of linear tetrahedra: what the plain element reaches in bending (p1_convergence.json), two materials,
 * own weight, stretching, and first frequencies (vibration.json). */
#include <complex.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "shapes.h"
#include "stepper.h"

static const double pi = 3.14159265358979323846;

/* --- the reference's meshes, whose inner nodes are shaken by the generator its scripts draw from: PCG-XSL-RR
 * 128/64 (O'Neill, HMC-CS-2014-0905) seeded with 1 through a hashed pool of four words --- */

typedef unsigned __int128 wide;
typedef struct {
    wide state, inc;
} pcg;

static uint64_t pcg_next(pcg *g)
{
    const wide factor = (wide)2549297995355413924u << 64 | 4865540595714422341u;
    g->state = g->state * factor + g->inc;
    const uint64_t high = (uint64_t)(g->state >> 64), value = high ^ (uint64_t)g->state;
    const int turn = (int)(high >> 58);
    return value >> turn | value << (-turn & 63);
}

static uint32_t hash(uint32_t value, uint32_t *with, uint32_t factor)
{
    value ^= *with, *with *= factor, value *= *with;
    return value ^ value >> 16;
}

static pcg pcg_new(uint32_t seed)
{
    uint32_t with = 0x43b0d7e5, pool[4] = {seed, 0, 0, 0};
    uint64_t word[4];
    for (int i = 0; i < 4; i++)
        pool[i] = hash(pool[i], &with, 0x931e8875);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            if (k != i) {
                const uint32_t mixed = 0xca01f9ddu * pool[k] - 0x4973f715u * hash(pool[i], &with, 0x931e8875);
                pool[k] = mixed ^ mixed >> 16;
            }
    with = 0x8b51f9dd;
    for (int i = 0; i < 4; i++) {
        word[i] = hash(pool[2 * i % 4], &with, 0x58f38ded);
        word[i] |= (uint64_t)hash(pool[(2 * i + 1) % 4], &with, 0x58f38ded) << 32;
    }
    pcg g = {0, ((wide)word[2] << 64 | word[3]) << 1 | 1};
    pcg_next(&g);
    g.state += (wide)word[0] << 64 | word[1];
    pcg_next(&g);
    return g;
}

/* A box of Kuhn cells, its inner nodes within a fifth of a cell of their places. */
static cn_tets *reference_bar(int nx, int n, double cell)
{
    cn_tets *mesh = shape_box(nx, n, n, cell);
    pcg g = pcg_new(1);
    for (int i = 0; i < mesh->nnode; i++) {
        const int at[3] = {i / ((n + 1) * (n + 1)), i / (n + 1) % (n + 1), i % (n + 1)}, end[3] = {nx, n, n};
        bool inside = true;
        for (int k = 0; k < 3; k++)
            inside = inside && at[k] > 0 && at[k] < end[k];
        for (int k = 0; k < 3; k++) {
            const double shake = -0.2 + 0.4 * (double)(pcg_next(&g) >> 11) * 0x1p-53;
            mesh->node[3 * i + k] = cell * (at[k] + (inside ? shake : 0));
        }
    }
    return mesh;
}

/* Nodes with x = `at`, as near as a mesh says so. */
static bool on_section(const double *x, double at, double length)
{
    return fabs(x[0] - at) < 1e-9 * length;
}

static void hold_root(stepper *s, double length)
{
    for (int i = 0; i < s->body->nnode; i++)
        s->held[i] = on_section(s->body->rest + 3 * i, 0, length);
}

/* Uniform traction of total `force` [N] on the end face x = length. */
static void pull_end(stepper *s, double length, const double force[3])
{
    const cn_surface *b = s->body->boundary;
    double *share = calloc((size_t)s->body->nnode, sizeof *share), total = 0;
    assert_non_null(share);
    for (int t = 0; t < b->ntri; t++) {
        const double *x[3];
        double e1[3], e2[3], n[3];
        for (int k = 0; k < 3; k++)
            x[k] = s->body->rest + 3 * b->tri[3 * t + k];
        if (!on_section(x[0], length, length) || !on_section(x[1], length, length) ||
            !on_section(x[2], length, length))
            continue;
        cn_sub(x[1], x[0], e1), cn_sub(x[2], x[0], e2), cn_cross(e1, e2, n);
        for (int k = 0; k < 3; k++)
            share[b->tri[3 * t + k]] += cn_norm(n) / 6;
        total += cn_norm(n) / 2;
    }
    for (int i = 0; i < s->body->nnode; i++)
        cn_axpy(share[i] / total, force, s->force + 3 * i);
    free(share);
}

/* Mean displacement of the nodes with x = at. */
static double mean_shift(const stepper *s, double at, double length, int axis)
{
    double sum = 0;
    int n = 0;
    for (int i = 0; i < s->body->nnode; i++)
        if (on_section(s->body->rest + 3 * i, at, length))
            sum += s->now->x[3 * i + axis] - s->body->rest[3 * i + axis], n++;
    return sum / n;
}

/* Deflection of a square bar of n cells over its depth, over Timoshenko's with Cowper's coefficient. */
static double bar_ratio(double length, double depth, int n, const cn_material *material)
{
    const double young = material->young, nu = material->poisson, k = 10 * (1 + nu) / (12 + 11 * nu);
    const double area = depth * depth, inertia = area * area / 12, shear = young / (2 * (1 + nu));
    const double compliance = pow(length, 3) / (3 * young * inertia) + length / (k * shear * area);
    const double force[3] = {0, 0, 1e-2 * length / compliance};
    cn_tets *mesh = reference_bar((int)lround(n * length / depth), n, depth / n);
    stepper s;
    stepper_set(&s, *material, 1);
    s.scene.solver.tolerance = 1e-5;
    assert_int_equal(stepper_make(&s, mesh), CN_OK);
    hold_root(&s, length);
    pull_end(&s, length, force);
    stepper_step(&s);
    const double ratio = mean_shift(&s, length, length, 2) / (1e-2 * length);
    stepper_free(&s);
    cn_tets_free(mesh);
    return ratio;
}

static void bending_is_as_stiff_as_plain_linear_tetrahedra_are(void **state)
{
    (void)state;
    json_t *json = reference_json("data/p1_convergence.json"), *item;
    if (!json) skip();
    double worst = 0, coarse = 0, nu_before = NAN, limit = NAN;
    size_t i;
    json_array_foreach(json_object_get(json, "cases"), i, item)
    {
        const cn_material material = {.young = 1e5, .poisson = json_number(item, "nu")};
        const int n = (int)json_number(item, "elements_over_depth");
        const double want = json_number(item, "linear_over_timoshenko");
        const double ratio = bar_ratio(json_number(item, "length"), json_number(item, "depth"), n, &material);
        if (!(fabs(ratio / want - 1) <= 0.02))
            fail_msg("nu %g, %d over depth: %g, reference %g", material.poisson, n, ratio, want);
        worst = fmax(worst, fabs(ratio / want - 1));
        /* order towards the clamped solid, from half as many cells */
        limit = want / json_number(item, "linear_over_solid_limit");
        if (n % 2 == 0 && material.poisson == nu_before && coarse > 0 && n == 8)
            print_message("nu %g: observed order %.2f from 4 to 8 cells over the depth\n", material.poisson,
                          log2((1 / coarse - 1 / limit) / (1 / ratio - 1 / limit)));
        if (n == 4) coarse = ratio, nu_before = material.poisson;
    }
    print_message("bending of linear tetrahedra: within %.1e of the reference\n", worst);
    json_decref(json);
}

/* --- closed forms --- */

/* Nu 0 and plane sections: each slice of the series stretches by F dx / (E A), also beyond small strain,
 * since the law is linear in the stretch. */
static void two_materials_in_a_row_stretch_as_springs_in_series(void **state)
{
    (void)state;
    const double length = 1, depth = 0.1, young[2] = {1e6, 4e7}, force[3] = {3e3, 0, 0};
    cn_region stiff = {.by_box = true, .box = {{0.4, -1, -1}, {2, 1, 1}}, .young = young[1]};
    cn_tets *mesh = shape_box(20, 2, 2, 0.05);
    stepper s;
    for (int i = 0; i < mesh->nnode; i++) /* plane sections, also inside */
        mesh->node[3 * i] = 0.05 * round(mesh->node[3 * i] / 0.05);
    stepper_set(&s, (cn_material){.young = young[0], .nregion = 1, .region = &stiff}, 1);
    assert_int_equal(stepper_make(&s, mesh), CN_OK);
    hold_root(&s, length);
    pull_end(&s, length, force);
    stepper_step(&s);
    const double strain = force[0] / (young[0] * depth * depth), share = young[0] / young[1];
    const double want = strain * (0.4 + 0.6 * share);
    double worst = 0;
    for (int i = 0; i < mesh->nnode; i++) {
        const double x = mesh->node[3 * i], u = strain * (fmin(x, 0.4) + share * fmax(x - 0.4, 0));
        worst = fmax(worst, fabs(s.now->x[3 * i] - x - u));
    }
    print_message("two materials in a row: tip %.6f m, off by at most %.1e of it\n", want, worst / want);
    assert_true(worst <= 1e-9 * want);
    stepper_free(&s);
    cn_tets_free(mesh);
}

/* Stiff faces about a soft core: EI = sum E I about the middle. The cell's error goes with its square, so the
 * stiffness at 8 and 4 layers extrapolates to the beam's. */
static void a_beam_of_two_materials_bends_as_its_section_says(void **state)
{
    (void)state;
    const double length = 1, depth = 0.1, soft = 1e5, hard = 5e5, force = 1e-3;
    const double inertia = pow(depth, 4) / 12, core = inertia / 8; /* the middle half */
    const double ei = hard * (inertia - core) + soft * core;
    double stiffness[2];
    for (int k = 0; k < 2; k++) {
        const int n = k ? 8 : 4;
        cn_region faces[2] = {{.by_box = true, .box = {{-1, -1, -1}, {2, 1, 0.025}}, .young = hard},
                              {.by_box = true, .box = {{-1, -1, 0.075}, {2, 1, 1}}, .young = hard}};
        cn_tets *mesh = shape_box(10 * n, n, n, depth / n);
        for (int i = 0; i < 3 * mesh->nnode; i++) /* layers end where the materials do */
            mesh->node[i] = depth / n * round(mesh->node[i] * n / depth);
        stepper s;
        stepper_set(&s, (cn_material){.young = soft, .nregion = 2, .region = faces}, 1);
        s.scene.solver.tolerance = 1e-6;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_root(&s, length);
        pull_end(&s, length, (const double[3]){0, 0, force});
        stepper_step(&s);
        stiffness[k] = force / mean_shift(&s, length, length, 2);
        stepper_free(&s);
        cn_tets_free(mesh);
    }
    const double best = (4 * stiffness[1] - stiffness[0]) / 3, want = 3 * ei / pow(length, 3);
    print_message("two materials in layers: %.3f and %.3f of the beam's stiffness, extrapolated %.4f\n",
                  stiffness[0] / want, stiffness[1] / want, best / want);
    assert_true(fabs(best / want - 1) < 0.03); /* the beam's own shear is 1 to 2 % of it */
}

/* By reciprocity with uniform tension the end moves by g M L / (2 E A) in the mean over its traction's
 * shares, which on a section of equal cells are those of the load itself. */
static void a_bar_hangs_by_its_own_weight(void **state)
{
    (void)state;
    const double length = 1, depth = 0.1, young = 1e6, density = 1000, gravity = 0.01;
    cn_tets *mesh = shape_box(20, 2, 2, 0.05);
    stepper s;
    stepper_set(&s, (cn_material){.young = young, .density = density}, 1);
    s.scene.leave_out.inertia = CN_ON; /* a static equilibrium with weight */
    s.scene.gravity[0] = gravity;
    assert_int_equal(stepper_make(&s, mesh), CN_OK);
    hold_root(&s, length);
    const double unit[3] = {1, 0, 0};
    pull_end(&s, length, unit);
    double *share = calloc(3 * (size_t)mesh->nnode, sizeof *share), moved = 0;
    assert_non_null(share);
    memcpy(share, s.force, 3 * (size_t)mesh->nnode * sizeof *share);
    memset(s.force, 0, 3 * (size_t)mesh->nnode * sizeof *share);
    stepper_step(&s);
    for (int i = 0; i < mesh->nnode; i++)
        moved += share[3 * i] * (s.now->x[3 * i] - mesh->node[3 * i]);
    const double want = density * gravity * length * length / (2 * young);
    print_message("hanging bar: end moves by %.9f of rho g L^2 / 2E\n", moved / want);
    assert_true(fabs(moved / want - 1) < 1e-4);
    (void)depth;
    free(share);
    stepper_free(&s);
    cn_tets_free(mesh);
}

/* Both ends held, one of them farther away: force E A e at any stretch. */
static void a_bar_pulled_to_many_times_its_length_is_a_linear_spring(void **state)
{
    (void)state;
    const double length = 1, young = 1e6;
    cn_tets *mesh = shape_box(10, 1, 1, 0.1);
    for (double stretch = 1.5; stretch <= 13; stretch *= 2) {
        stepper s;
        double *f = calloc(3 * (size_t)mesh->nnode, sizeof *f), pulled = 0;
        assert_non_null(f);
        stepper_set(&s, (cn_material){.young = young}, 1);
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_root(&s, length);
        for (int i = 0; i < mesh->nnode; i++)
            if (on_section(mesh->node + 3 * i, length, length))
                s.held[i] = 1, s.now->x[3 * i] = stretch * length;
            else
                s.now->x[3 * i] *= 1 + 0.5 * (stretch - 1);
        stepper_step(&s);
        cn_body_add_elastic(s.body, mesh->nnode, s.now->x, s.now->rotation, f, CN_TANGENT_WARPED, 1, NULL,
                            NULL);
        for (int i = 0; i < mesh->nnode; i++)
            if (s.held[i] && mesh->node[3 * i] > 0.5) pulled -= f[3 * i];
        assert_true(fabs(pulled - young * 0.01 * (stretch - 1)) <= 1e-9 * young * 0.01);
        for (int i = 0; i < mesh->nnode; i++)
            assert_true(fabs(s.now->x[3 * i] - stretch * mesh->node[3 * i]) <= 1e-9 * length);
        free(f);
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

/* --- frequencies (vibration.json) --- */

/* The two lowest frequencies [Hz] of the held body at rest, by inverse iteration. */
static void lowest_frequencies(stepper *s, double hz[2])
{
    const int n = 3 * s->body->nnode, first = 0;
    double *mode[2], *b = calloc((size_t)n, sizeof *b);
    unsigned seed = 11;
    cn_matrix *matrix;
    cn_scatter *scatter;
    cn_solver *solver;
    assert_int_equal(cn_matrix_new(&matrix, 1, &s->body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&scatter, s->body, matrix, 0), CN_OK);
    assert_int_equal(cn_solver_new(&solver, matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    cn_body_add_elastic(s->body, s->body->nnode, s->now->x, s->now->rotation, b, CN_TANGENT_EXACT, 1, scatter,
                        NULL);
    assert_int_equal(cn_solver_factor(solver, matrix, s->body->nnode, s->held, NULL), CN_OK);
    for (int m = 0; m < 2; m++) {
        double *x = mode[m] = calloc((size_t)n, sizeof *x), value = 0;
        assert_true(x && b);
        for (int i = 0; i < n; i++)
            x[i] = shape_random(&seed);
        for (int pass = 0; pass < 40; pass++) {
            double up = 0, down = 0, along = 0;
            for (int i = 0; i < n; i++)
                b[i] = s->body->mass[i / 3] * x[i];
            assert_int_equal(cn_solver_solve(solver, b, x, 1e-12, 1, NULL, NULL, NULL), CN_OK);
            for (int i = 0; m && i < n; i++)
                along += s->body->mass[i / 3] * x[i] * mode[0][i];
            for (int i = 0; i < n; i++)
                x[i] -= m ? along * mode[0][i] : 0;
            for (int i = 0; i < n; i++)
                up += x[i] * b[i], down += s->body->mass[i / 3] * x[i] * x[i];
            value = up / down; /* x'Kx / x'Mx of the new x, since K x = b */
            for (int i = 0; i < n; i++)
                x[i] /= sqrt(down);
        }
        hz[m] = sqrt(value) / (2 * pi);
    }
    cn_solver_free(solver), cn_scatter_free(scatter), cn_matrix_free(matrix);
    free(mode[0]), free(mode[1]), free(b);
}

/* The cells' diagonals make the bar softer across one of its own: a force along an edge meets the mean of the
 * two compliances, and so does 1/f^2. */
static void bending_frequency_is_as_high_as_the_root_of_the_stiffness(void **state)
{
    (void)state;
    json_t *json = reference_json("data/vibration.json"), *bars = reference_json("data/p1_convergence.json");
    if (!json || !bars) {
        json_decref(json), json_decref(bars);
        skip();
    }
    size_t i, k;
    json_t *item, *bar;
    json_array_foreach(json_object_get(json, "cases"), i, item)
    {
        const double length = json_number(item, "length"), depth = json_number(item, "size");
        const double nu = json_number(item, "nu");
        double beam[16];
        if (strcmp(json_string_value(json_object_get(item, "section")), "square") != 0) continue;
        json_numbers(item, "bending_cantilever_Hz_timoshenko", beam);
        json_array_foreach(json_object_get(bars, "cases"), k, bar)
        {
            const int n = (int)json_number(bar, "elements_over_depth");
            if (json_number(bar, "nu") != nu || n > 4 ||
                fabs(json_number(bar, "length") / json_number(bar, "depth") - length / depth) > 1e-9)
                continue;
            cn_tets *mesh = reference_bar((int)lround(n * length / depth), n, depth / n);
            stepper s;
            stepper_set(
                &s, (cn_material){json_number(item, "E"), nu, json_number(item, "density"), 0, 0, 0, NULL},
                1);
            assert_int_equal(stepper_make(&s, mesh), CN_OK);
            hold_root(&s, length);
            double hz[2];
            lowest_frequencies(&s, hz);
            const double ratio = 1 / (beam[0] * sqrt(0.5 / (hz[0] * hz[0]) + 0.5 / (hz[1] * hz[1])));
            const double want = sqrt(json_number(bar, "linear_over_timoshenko"));
            print_message("first bending frequency, %d over depth: %.4f of Timoshenko's; 1/root of the "
                          "deflection ratio %.4f\n",
                          n, ratio, 1 / want);
            assert_true(fabs(ratio * want - 1) < 0.02);
            stepper_free(&s);
            cn_tets_free(mesh);
        }
    }
    json_decref(json), json_decref(bars);
}

/* Modulus and phase per step of a mode, from a(n+1) = t a(n) - d a(n-1) in the least squares. */
static void mode_of(int n, const double *a, double *modulus, double *phase)
{
    double pp = 0, pq = 0, qq = 0, pr = 0, qr = 0;
    for (int i = 1; i + 1 < n; i++) {
        pp += a[i] * a[i], pq -= a[i] * a[i - 1], qq += a[i - 1] * a[i - 1];
        pr += a[i] * a[i + 1], qr -= a[i - 1] * a[i + 1];
    }
    const double det = pp * qq - pq * pq, t = (pr * qq - qr * pq) / det, d = (pp * qr - pq * pr) / det;
    *modulus = sqrt(d), *phase = acos(t / (2 * sqrt(d)));
}

/* Amplification of a mode in a step w dt = a: implicit Euler 1 / (1 - i a), midpoint (1 + i a/2) / (1 - i
 * a/2), TR-BDF2 the trapezoid over g dt, g = 2 - sqrt(2), and BDF2 over its end: (y / (g (2 - g)) - (1 - g)^2
 * / (g (2
 * - g))) / (1 - i a (1 - g)/(2 - g)). */
static double complex amplified(int scheme, double a)
{
    if (scheme == CN_INTEGRATOR_EULER) return 1 / (1 - I * a);
    if (scheme == CN_INTEGRATOR_MIDPOINT) return (1 + 0.5 * I * a) / (1 - 0.5 * I * a);
    const double g = 2 - sqrt(2);
    const double complex y = (1 + 0.5 * I * g * a) / (1 - 0.5 * I * g * a);
    return (y - (1 - g) * (1 - g)) / (g * (2 - g)) / (1 - I * a * (1 - g) / (2 - g));
}

/* w dt of a phase in a step: the root of a scheme's own. */
static double omega_of(int scheme, double phase)
{
    double a = phase;
    for (int k = 0; k < 50; k++)
        a += phase - carg(amplified(scheme, a));
    return a;
}

/* A held section cannot contract: the slice behind it is stiffer than the bar, by much near nu 1/2, so slices
 * are to be short against the length. */
static void axial_waves_have_each_schemes_frequency_and_damping(void **state)
{
    (void)state;
    json_t *json = reference_json("data/vibration.json"), *item;
    if (!json) skip();
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        const double length = json_number(item, "length"), size = json_number(item, "size");
        const bool square = !strcmp(json_string_value(json_object_get(item, "section")), "square");
        cn_tets *mesh =
            square ? shape_box(20, 2, 2, length / 20) : shape_chain(101, 6, length / 100, 0.5 * size);
        const int axis = square ? 0 : 2;
        if (square) assert_true(fabs(size - length / 10) < 1e-12 * length);
        for (int run = 0; run < 6; run++) {
            const int held = run / 3, scheme = run % 3;
            enum { STEPS = 120, SETTLED = 30 }; /* sections first find their lateral strain */
            double hz[16], a[STEPS], modulus, phase;
            json_numbers(item, held ? "axial_fixed_free_Hz" : "axial_free_free_Hz", hz);
            stepper s;
            stepper_set(&s,
                        (cn_material){json_number(item, "E"), json_number(item, "nu"),
                                      json_number(item, "density"), 0, 0, 0, NULL},
                        0.1 / (2 * pi * hz[0]));
            s.scene.solver.tolerance = 1e-10, s.scene.solver.integrator = (cn_integrator)scheme;
            assert_int_equal(stepper_make(&s, mesh), CN_OK);
            double *mode = calloc((size_t)mesh->nnode, sizeof *mode);
            assert_non_null(mode);
            for (int i = 0; i < mesh->nnode; i++) {
                const double at = fabs(mesh->node[3 * i + axis]) / length;
                s.held[i] = held && at < 1e-9;
                mode[i] = held ? sin(0.5 * pi * at) : cos(pi * at);
                s.now->x[3 * i + axis] += 1e-4 * length * mode[i];
            }
            for (int k = 0; k < STEPS; k++) {
                stepper_step(&s);
                a[k] = 0;
                for (int i = 0; i < mesh->nnode; i++)
                    a[k] += mode[i] * s.body->mass[i] * (s.now->x[3 * i + axis] - mesh->node[3 * i + axis]);
            }
            mode_of(STEPS - SETTLED, a + SETTLED, &modulus, &phase);
            const double omega = omega_of(scheme, phase), want = cabs(amplified(scheme, omega));
            print_message(
                "axial mode, %s, %s, scheme %d: frequency %.4f of the bar's, modulus per step off by "
                "%.1e\n",
                square ? "square bar" : "catheter chain", held ? "held" : "free", scheme, omega / 0.1,
                modulus - want);
            assert_true(fabs(omega / 0.1 - 1) < 0.01);
            /* Euler's loss to 3 % of it; the other schemes have none to speak of */
            assert_true(fabs(modulus - want) < (scheme == CN_INTEGRATOR_EULER ? 0.03 * (1 - want) : 1e-4));
            free(mode);
            stepper_free(&s);
        }
        cn_tets_free(mesh);
    }
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bending_is_as_stiff_as_plain_linear_tetrahedra_are),
        cmocka_unit_test(two_materials_in_a_row_stretch_as_springs_in_series),
        cmocka_unit_test(a_beam_of_two_materials_bends_as_its_section_says),
        cmocka_unit_test(a_bar_hangs_by_its_own_weight),
        cmocka_unit_test(a_bar_pulled_to_many_times_its_length_is_a_linear_spring),
        cmocka_unit_test(bending_frequency_is_as_high_as_the_root_of_the_stiffness),
        cmocka_unit_test(axial_waves_have_each_schemes_frequency_and_damping),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
