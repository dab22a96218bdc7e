/* Springs between molecules: energy, force and tangent, a bar's stiffness, points on the molecules, the
 * solver's and the explicit step. LINK: wrap */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_fixture.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "molecules.h"
#include "solve.h"
#include "stepper.h"

static const cn_material soft = {.young = 1e5, .poisson = 0.25, .density = 1000};

/* A box of these sizes, turned by w, filled. */
static cn_body *box_body(double x, double y, double z, const double w[3], double radius, bool jittered,
                         const cn_material *material)
{
    const double min[3] = {0, 0, 0}, max[3] = {x, y, z};
    const cn_placement place = {1, {w[0], w[1], w[2]}, {0, 0, 0}};
    const cn_molecules_spec spec = {radius, jittered, NULL};
    cn_surface *surface;
    cn_body *body;
    cn_error error = {0};
    assert_int_equal(cn_surface_box(&surface, min, max), CN_OK);
    cn_place_points(&place, surface->nvert, surface->vert);
    const cn_status status = cn_body_new_molecules(&body, surface, &spec, 1, material, &error);
    if (status != CN_OK) fail_msg("%s", error.message);
    cn_surface_free(surface);
    return body;
}

static const double straight[3] = {0, 0, 0};

/* The fixture of a body; takes the body over. */
static fixture hold_body(cn_body *body)
{
    fixture s = {.body = body};
    const int first = 0;
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    s.x = numbers(3 * body->nnode), s.f = numbers(3 * body->nnode), s.rotation = numbers(4);
    memcpy(s.x, body->rest, 3 * (size_t)body->nnode * sizeof *s.x);
    return s;
}

static double energy_of(const fixture *s)
{
    return cn_body_energy(s->body, s->body->nnode, s->x, s->rotation, NULL);
}

static void force_is_minus_the_gradient_of_the_energy_and_the_tangent_its_derivative(void **state)
{
    (void)state;
    const double scales[3] = {1, 1e3, 1e-6}; /* m, mm, um of the same body */
    for (int u = 0; u < 3; u++) {
        const double unit = scales[u], h = 1e-6 * 0.01 * unit;
        fixture s =
            hold_body(box_body(0.05 * unit, 0.04 * unit, 0.04 * unit, straight, 0.01 * unit, true, &soft));
        const int n = 3 * s.body->nnode;
        double *f0 = numbers(n), *up = numbers(n);
        fixture_shake(&s, 3, 0.002 * unit);
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        memcpy(f0, s.f, (size_t)n * sizeof *f0);
        double *value = numbers(9 * s.matrix->nblock);
        memcpy(value, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *value);
        const double force = largest(f0, n), stiff = s.body->spring;
        for (int i = 0; i < n; i += 7) {
            const double at = s.x[i];
            s.x[i] = at + h;
            const double above = fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            memcpy(up, s.f, (size_t)n * sizeof *up);
            s.x[i] = at - h;
            const double below = fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            s.x[i] = at;
            assert_true(fabs(f0[i] + (above - below) / (2 * h)) < 1e-6 * force);
            for (int j = 0; j < n; j++) {
                const double slope = -(up[j] - s.f[j]) / (2 * h);
                const int block = cn_matrix_find(s.matrix, j / 3, i / 3);
                const double k = block < 0 ? 0 : value[9 * block + 3 * (j % 3) + i % 3];
                assert_true(fabs(slope - k) < 1e-6 * stiff);
            }
        }
        free(f0), free(up), free(value);
        fixture_free(&s);
    }
}

static void
the_projected_tangent_has_no_negative_direction_and_is_exact_where_nothing_is_compressed(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.05, 0.04, 0.04, straight, 0.01, false, &soft));
    const int n = 3 * s.body->nnode;
    double *y = numbers(n), *dx = numbers(n), *exact = numbers(9 * s.matrix->nblock);
    unsigned seed = 5;
    for (int trial = 0; trial < 40; trial++) {
        fixture_shake(&s, 7 + (unsigned)trial, 0.01);
        for (int tangent = CN_TANGENT_WARPED; tangent <= CN_TANGENT_PROJECTED; tangent += 2) {
            fixture_force(&s, (cn_tangent)tangent, s.scatter, NULL);
            double along = 0;
            for (int i = 0; i < n; i++)
                dx[i] = shape_random(&seed);
            cn_matrix_multiply(s.matrix, s.matrix->n, dx, y, NULL);
            for (int i = 0; i < n; i++)
                along += dx[i] * y[i];
            assert_true(along > -1e-12 * s.body->spring * n);
        }
    }
    for (int i = 0; i < n; i++)
        s.x[i] = 1.02 * s.body->rest[i];
    fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
    memcpy(exact, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *exact);
    fixture_force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL);
    assert_memory_equal(exact, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *exact);
    free(y), free(dx), free(exact);
    fixture_free(&s);
}

static void inner_forces_have_no_sum_and_no_moment_and_rest_has_no_force(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.08, 0.05, 0.06, straight, 0.01, true, &soft));
    assert_true(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) < 1e-25);
    assert_true(largest(s.f, 3 * s.body->nnode) < 1e-13 * s.body->spring * 0.01);
    fixture_shake(&s, 11, 0.004);
    fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
    double sum[3] = {0}, moment[3] = {0}, size = 0;
    for (int i = 0; i < s.body->nnode; i++) {
        double m[3];
        cn_add(sum, s.f + 3 * i, sum);
        cn_cross(s.x + 3 * i, s.f + 3 * i, m);
        cn_add(moment, m, moment);
        size += cn_norm(s.f + 3 * i);
    }
    assert_true(cn_norm(sum) < 1e-14 * size);
    assert_true(cn_norm(moment) < 1e-14 * size * 0.1);
    fixture_free(&s);
}

static void a_rigid_motion_costs_nothing_and_turns_the_forces(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.06, 0.05, 0.05, straight, 0.01, false, &soft));
    const int n = s.body->nnode;
    const double w[3] = {1, -2, 0.5}, shift[3] = {10, -20, 5};
    double r[9], *f0 = numbers(3 * n);
    cn_rotation(w, r);
    fixture_shake(&s, 2, 0);
    assert_true(energy_of(&s) < 1e-25);
    fixture_shake(&s, 2, 0.003);
    const double e0 = fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
    memcpy(f0, s.f, 3 * (size_t)n * sizeof *f0);
    for (int i = 0; i < n; i++) {
        double p[3];
        cn_mat_vec(r, s.x + 3 * i, p);
        cn_add(p, shift, s.x + 3 * i);
    }
    const double e1 = fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
    assert_true(fabs(e1 - e0) < 1e-11 * e0);
    for (int i = 0; i < n; i++) {
        double turned[3];
        cn_mat_vec(r, f0 + 3 * i, turned);
        assert_true(cn_distance(turned, s.f + 3 * i) < 1e-10 * s.body->spring * 0.01);
    }
    free(f0);
    fixture_free(&s);
}

static void results_do_not_depend_on_threads_or_instruction_set(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.16, 0.12, 0.12, straight, 0.006, true, &soft));
    cn_molecules *own = s.body->own;
    const int n = 3 * s.body->nnode;
    assert_true(s.body->nnode > 1500);
    double *f = numbers(n), *value = numbers(9 * s.matrix->nblock), energy = 0;
    cn_measures first = {0};
    fixture_shake(&s, 2, 0.001);
    for (int run = 0; run < 6; run++) {
        cn_pool *pool;
        cn_measures m;
        assert_int_equal(cn_pool_new(&pool, 1 + run % 3), CN_OK);
        own->kernels = cn_molecule_kernels_pick(run < 3 ? 2 : run - 3);
        const double e = fixture_force(&s, CN_TANGENT_EXACT, s.scatter, pool);
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, pool);
        if (run == 0) {
            memcpy(f, s.f, (size_t)n * sizeof *f), energy = e, first = m;
            memcpy(value, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *value);
        }
        assert_true(e == energy && m.energy == first.energy && m.volume_max == first.volume_max &&
                    m.stress_max == first.stress_max && m.stress_element == first.stress_element &&
                    m.volume == first.volume && m.stress_mean == first.stress_mean);
        assert_memory_equal(f, s.f, (size_t)n * sizeof *f);
        assert_memory_equal(value, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *value);
        assert_true(fabs(m.energy - energy) < 1e-12 * energy);
        cn_pool_free(pool);
    }
    free(f), free(value);
    fixture_free(&s);
}

/* Forces that pull a bar along `along` by f [N], on the molecules of a slice at each end by their shares,
 * less what would move the bar as a whole. */
static void pull_bar(const cn_body *body, const double along[3], double length, double slice, double f,
                     double *force)
{
    const cn_molecules *own = body->own;
    double sum[2] = {0, 0}, centre[3] = {0}, total[3] = {0}, moment[3] = {0}, inertia[9] = {0}, w[3],
           volume = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < body->nnode; i++) {
            const double at = cn_dot(body->rest + 3 * i, along);
            const int end = at < slice ? 0 : at > length - slice ? 1 : -1;
            if (end < 0) continue;
            if (pass == 0)
                sum[end] += own->share[i];
            else
                cn_axpy((end ? f : -f) * own->share[i] / sum[end], along, force + 3 * i);
        }
    for (int i = 0; i < body->nnode; i++)
        cn_axpy(own->share[i], body->rest + 3 * i, centre), volume += own->share[i];
    for (int k = 0; k < 3; k++)
        centre[k] /= volume;
    for (int i = 0; i < body->nnode; i++) {
        double r[3], m[3];
        cn_sub(body->rest + 3 * i, centre, r);
        cn_cross(r, force + 3 * i, m);
        cn_add(moment, m, moment), cn_add(total, force + 3 * i, total);
        for (int k = 0; k < 9; k++)
            inertia[k] += own->share[i] * ((k % 4 ? 0 : cn_norm2(r)) - r[k / 3] * r[k % 3]);
    }
    for (int k = 0; k < 3; k++) {
        double m[9];
        for (int j = 0; j < 9; j++)
            m[j] = j % 3 == k ? moment[j / 3] : inertia[j];
        w[k] = cn_det(m) / cn_det(inertia);
    }
    for (int i = 0; i < body->nnode; i++) {
        double r[3], m[3];
        cn_sub(body->rest + 3 * i, centre, r);
        cn_cross(w, r, m);
        cn_axpy(-own->share[i], m, force + 3 * i);
        cn_axpy(-own->share[i] / volume, total, force + 3 * i);
    }
}

/* Slope of u.across over X.across of the molecules in the bar's middle half. */
static double middle_strain(const cn_body *body, const double *u, const double along[3],
                            const double across[3], double length)
{
    double s[5] = {0};
    for (int i = 0; i < body->nnode; i++) {
        const double at = cn_dot(body->rest + 3 * i, along), x = cn_dot(body->rest + 3 * i, across),
                     d = cn_dot(u + 3 * i, across);
        if (at < 0.25 * length || at > 0.75 * length) continue;
        s[0]++, s[1] += x, s[2] += d, s[3] += x * x, s[4] += x * d;
    }
    return (s[4] - s[1] * s[2] / s[0]) / (s[3] - s[1] * s[1] / s[0]);
}

typedef struct {
    double stiffness, poisson, stress; /* over EA; -across/along; mean of the middle over F/A */
} stretched;

/* A bar of width d stretched by 1e-4. */
static stretched stretch(double d, const double w[3], bool jittered)
{
    const double radius = 0.01, length = 4 * d + 0.1, area = d * d, f = 1e-4 * soft.young * area;
    fixture s = hold_body(box_body(length, d, d, w, radius, jittered, &soft));
    const int n = s.body->nnode;
    double r[9], *force = numbers(3 * n), *u = numbers(3 * n);
    unsigned char *none = flags(3 * n);
    cn_solver *solver;
    cn_rotation(w, r);
    const double along[3] = {r[0], r[3], r[6]}, across[3] = {r[1], r[4], r[7]};
    pull_bar(s.body, along, length, 0.02, f, force);
    fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
    for (int i = 0; i < n; i++) /* holds what no strain resists */
        for (int k = 0; k < 3; k++)
            s.matrix->value[9 * s.matrix->diagonal[i] + 4 * k] += 1e-9 * s.body->spring;
    assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_factor(solver, s.matrix, n, NULL, NULL), CN_OK);
    fixture_solve(solver, 3 * n, force, none, u);
    stretched out;
    const double strain = middle_strain(s.body, u, along, along, length);
    out.stiffness = f / (soft.young * area * strain);
    out.poisson = -middle_strain(s.body, u, along, across, length) / strain;
    for (int i = 0; i < 3 * n; i++)
        s.x[i] += u[i];
    cn_measures m;
    cn_body_measure(s.body, n, s.x, s.rotation, true, &m, NULL, NULL);
    out.stress = m.stress_mean / (f / area) * length / (length - 0.04); /* nearly none within the ends */
    assert_int_equal(m.inverted, 0);
    cn_solver_free(solver);
    free(force), free(u), free(none);
    fixture_free(&s);
    return out;
}

/* Bars of 8 and 12 radii in width, four directions against the lattice: axis, face and space diagonal, none.
 */
static void a_stretched_bar_is_as_stiff_as_its_youngs_modulus_says(void **state)
{
    (void)state;
    const double quarter = acos(-1) / 4;
    const double turn[4][3] = {{0, 0, 0}, {0, 0, quarter}, {0.3, -0.5, 0.9}, {0, -0.61547970867, quarter}};
    for (int wide = 0; wide < 2; wide++)
        for (int t = 0; t < 4; t++) {
            const stretched s = stretch(wide ? 0.12 : 0.08, turn[t], false),
                            j = stretch(wide ? 0.12 : 0.08, turn[t], true);
            print_message(
                "%d radii, direction %d: EA %+.1f %% (jittered %+.1f %%), Poisson %.3f, stress %+.1f %%\n",
                wide ? 12 : 8, t, 100 * (s.stiffness - 1), 100 * (j.stiffness - 1), s.poisson,
                100 * (s.stress - 1));
            assert_true(fabs(s.stiffness - 1) < (wide ? 0.035 : 0.05));
            assert_true(fabs(j.stiffness - 1) < (wide ? 0.06 : 0.08));
            assert_true(fabs(s.poisson - 0.25) < (wide ? 0.03 : 0.05));
            assert_true(fabs(s.stress - 1) < 0.08);
        }
}

/* Inside a regular body the lattice is Cauchy's isotropic solid: energy density mu (e:e) + lambda/2 tr(e)^2
 * with mu = lambda = 2 E / 5; the fit to shares carries that to the surface. */
static void energy_of_a_uniform_strain_is_that_of_the_isotropic_solid(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.2, 0.2, 0.2, straight, 0.0125, false, &soft));
    unsigned seed = 4;
    for (int trial = 0; trial < 8; trial++) {
        double e[9], square = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j <= i; j++)
                e[3 * i + j] = e[3 * j + i] = 1e-5 * shape_random(&seed);
        for (int i = 0; i < 9; i++)
            square += e[i] * e[i];
        const double trace = e[0] + e[4] + e[8], mu = 0.4 * soft.young;
        const double exact = 0.008 * (mu * square + 0.5 * mu * trace * trace);
        for (int i = 0; i < s.body->nnode; i++) {
            double d[3];
            cn_mat_vec(e, s.body->rest + 3 * i, d);
            cn_add(s.body->rest + 3 * i, d, s.x + 3 * i);
        }
        assert_true(fabs(energy_of(&s) / exact - 1) < 0.03);
    }
    fixture_free(&s);
}

static void measures_are_those_of_a_uniform_stretch(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.1, 0.1, 0.1, straight, 0.01, false, &soft));
    const int n = s.body->nnode;
    cn_measures m;
    for (int i = 0; i < 3 * n; i++)
        s.x[i] = 1.01 * s.body->rest[i];
    cn_body_measure(s.body, n, s.x, s.rotation, true, &m, NULL, NULL);
    assert_true(fabs(m.volume_max - 0.01) < 1e-13 && fabs(m.volume_mean - 0.01) < 1e-13);
    assert_true(fabs(m.volume / m.energy - 1.03e-3 / energy_of(&s)) < 1e-9 * m.volume / m.energy);
    assert_true(m.inverted == 0 && m.volume_element >= 0 && m.volume_element < s.body->nelement);
    for (int i = 0; i < n; i++) /* inside out */
        s.x[3 * i] = -s.body->rest[3 * i], s.x[3 * i + 1] = s.body->rest[3 * i + 1],
                s.x[3 * i + 2] = s.body->rest[3 * i + 2];
    cn_body_measure(s.body, n, s.x, s.rotation, true, &m, NULL, NULL);
    assert_true(m.inverted > 0.9 * n && m.volume_max < 1e-12);
    /* stretched as a bar is: the mean over molecules is near E strain, at the surface somewhat above */
    double *stress = numbers(cn_body_cells(s.body)), mean = 0;
    for (int i = 0; i < 3 * n; i++)
        s.x[i] = (i % 3 ? 1 - 0.25e-4 : 1 + 1e-4) * s.body->rest[i];
    cn_body_measure(s.body, n, s.x, s.rotation, true, &m, stress, NULL);
    assert_int_equal(cn_body_cells(s.body), s.body->boundary->ntri);
    for (int t = 0; t < cn_body_cells(s.body); t++)
        mean += stress[t] / cn_body_cells(s.body);
    assert_true(fabs(mean / (soft.young * 1e-4) - 1) < 0.25);
    assert_true(fabs(m.stress_mean / (soft.young * 1e-4) - 1) < 0.12);

    free(stress);
    /* one molecule moved: the link stretched most is one of its own */
    memcpy(s.x, s.body->rest, 3 * (size_t)n * sizeof *s.x);
    s.x[3 * (n / 2)] += 0.004;
    cn_body_measure(s.body, n, s.x, s.rotation, true, &m, NULL, NULL);
    const int *end = s.body->connect + 2 * m.volume_element;
    double centre[3];
    cn_body_element_centre(s.body, s.x, m.volume_element, centre);
    assert_true(end[0] == n / 2 || end[1] == n / 2);
    assert_true(cn_distance(centre, s.x + 3 * (n / 2)) < 0.02);
    fixture_free(&s);
}

static void what_is_not_a_number_makes_energy_and_measures_none(void **state)
{
    (void)state;
    fixture s = hold_body(box_body(0.05, 0.05, 0.05, straight, 0.01, false, &soft));
    const double bad[2] = {NAN, INFINITY};
    for (int i = 0; i < 2; i++) {
        cn_measures m;
        s.x[7] = bad[i];
        assert_false(isfinite(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL)));
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
        assert_false(isfinite(m.volume_max) || isfinite(m.stress_max) || isfinite(m.energy));
    }
    /* two molecules in one place: finite */
    memcpy(s.x, s.body->rest, 3 * (size_t)s.body->nnode * sizeof *s.x);
    memcpy(s.x + 3 * s.body->connect[0], s.x + 3 * s.body->connect[1], 3 * sizeof *s.x);
    assert_true(isfinite(fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL)));
    assert_true(isfinite(largest(s.matrix->value, 9 * s.matrix->nblock)));
    fixture_free(&s);
}

/* --- points --- */

static void points_follow_any_affine_motion_and_start_where_the_surface_is(void **state)
{
    (void)state;
    const double centre[3] = {0.3, -0.2, 0.1}, shift[3] = {3, 1, -2};
    const cn_molecules_spec spec = {0.012, true, NULL};
    cn_surface *surface;
    cn_body *body;
    assert_int_equal(cn_surface_sphere(&surface, centre, 0.1), CN_OK);
    assert_int_equal(cn_body_new_molecules(&body, surface, &spec, 3, &soft, NULL), CN_OK);
    assert_int_equal(body->npoint, surface->nvert);
    assert_int_equal(body->boundary->ntri, surface->ntri);
    assert_int_equal(cn_body_points_of(body, body->nnode), body->npoint);
    double *x = numbers(3 * body->nnode), *points = numbers(3 * body->npoint), most = 0;
    double a[9] = {1.5, 0.3, -0.2, 0.1, -0.8, 0.7, 0.4, 0.2, 1.1};
    assert_ptr_equal(cn_body_points(body, body->nnode, body->rest, NULL, points), points);
    for (int i = 0; i < body->npoint; i++)
        assert_true(cn_distance(points + 3 * i, surface->vert + 3 * i) < 1e-14);
    for (int i = 0; i < body->nnode; i++) {
        cn_mat_vec(a, body->rest + 3 * i, x + 3 * i);
        cn_add(x + 3 * i, shift, x + 3 * i);
    }
    cn_body_points(body, body->nnode, x, NULL, points);
    for (int i = 0; i < body->npoint; i++) {
        double p[3];
        cn_mat_vec(a, surface->vert + 3 * i, p);
        cn_add(p, shift, p);
        assert_true(cn_distance(points + 3 * i, p) < 1e-14);
    }
    for (int i = 0; i < body->npoint; i++) {
        double sum = 0;
        assert_int_equal(cn_body_node_of(body, i), body->anchor[body->nanchor * i]);
        for (int k = 0; k < body->nanchor; k++) {
            sum += body->weight[body->nanchor * i + k];
            most = fmax(most, fabs(body->weight[body->nanchor * i + k]));
        }
        assert_true(fabs(sum - 1) < 1e-14);
    }
    assert_true(most < 4);
    cn_surface_free(surface);
    cn_body_free(body);
    free(x), free(points);
}

/* Virtual work: what the points' forces do is what their pull on the molecules does; sums and moments stay.
 */
static void forces_on_points_do_the_same_work_on_the_molecules(void **state)
{
    (void)state;
    cn_body *body = box_body(0.06, 0.05, 0.05, straight, 0.01, false, &soft);
    const int n = 3 * body->nnode, np = 3 * body->npoint;
    double *x = numbers(n), *d = numbers(n), *p0 = numbers(np), *p1 = numbers(np), *force = numbers(np),
           *f = numbers(n), work = 0, same = 0;
    unsigned seed = 9;
    cn_carry *carry;
    assert_int_equal(cn_carry_new(&carry, body), CN_OK);
    assert_int_equal(carry->nper, 4);
    for (int i = 0; i < n; i++)
        d[i] = shape_random(&seed), x[i] = body->rest[i] + d[i];
    for (int i = 0; i < np; i++)
        force[i] = shape_random(&seed);
    cn_body_points(body, body->nnode, body->rest, NULL, p0), cn_body_points(body, body->nnode, x, NULL, p1);
    cn_body_carry(body, body->nnode, x, NULL, carry);
    cn_body_pull(body, body->nnode, x, NULL, carry, force, f, 1, NULL);
    for (int i = 0; i < np; i++)
        work += force[i] * (p1[i] - p0[i]);
    for (int i = 0; i < n; i++)
        same += f[i] * d[i];
    assert_true(fabs(work - same) < 1e-13 * np);
    cn_carry_free(carry);
    free(x), free(d), free(p0), free(p1), free(force), free(f);
    cn_body_free(body);
}

/* --- explicit steps --- */

static void explicit_steps_keep_momentum_and_energy(void **state)
{
    (void)state;
    cn_body *body = box_body(0.08, 0.06, 0.06, straight, 0.01, false, &soft);
    const int n = body->nnode;
    double *x = numbers(3 * n), *v = numbers(3 * n), *work = numbers(3 * n), p0[3] = {0}, p1[3] = {0};
    double e0 = 0, least = INFINITY, most = 0;
    int substeps;
    memcpy(x, body->rest, 3 * (size_t)n * sizeof *x);
    for (int i = 0; i < 3 * n; i++) {
        v[i] = 0.1 + 3 * (body->rest[i / 3 * 3 + (i + 1) % 3] - (i % 3 ? 1 : 2) * body->rest[i]);
        p0[i % 3] += body->mass[i / 3] * v[i], e0 += 0.5 * body->mass[i / 3] * v[i] * v[i];
    }
    for (int step = 0; step < 200; step++) {
        double e = 0;
        assert_int_equal(cn_molecules_explicit(body, 1e-3, NULL, NULL, NULL, x, v, work, &substeps, NULL),
                         CN_OK);
        for (int i = 0; i < 3 * n; i++)
            e += 0.5 * body->mass[i / 3] * v[i] * v[i];
        e += cn_body_energy(body, n, x, NULL, NULL);
        least = fmin(least, e), most = fmax(most, e);
    }
    for (int i = 0; i < 3 * n; i++)
        p1[i % 3] += body->mass[i / 3] * v[i];
    assert_true(cn_distance(p0, p1) < 1e-12 * cn_norm(p0));
    assert_true(least > 0.8 * e0 && most < 1.25 * e0); /* symplectic: bounded, no drift */
    free(x), free(v), free(work);
    cn_body_free(body);
}

/* M x'' = -K x - (alpha M + beta K) x' - and a force, by implicit Euler of tiny steps of the same equations.
 */
static void explicit_and_implicit_steps_agree_as_steps_shrink(void **state)
{
    (void)state;
    cn_material m = soft;
    m.damping = 3, m.damping_stiffness = 1e-4;
    fixture s = hold_body(box_body(0.08, 0.04, 0.04, straight, 0.01, false, &m));
    const int n = s.body->nnode, steps = 400;
    const double dt = 1e-4;
    double *x = numbers(3 * n), *v = numbers(3 * n), *work = numbers(3 * n), *force = numbers(3 * n),
           *u = numbers(3 * n), *dx = numbers(3 * n), *b = numbers(3 * n);
    unsigned char *held = flags(n), *fixed = flags(3 * n);
    cn_solver *solver;
    int substeps;
    for (int i = 0; i < n; i++) {
        const double *p = s.body->rest + 3 * i;
        held[i] = p[0] < 0.01;
        for (int k = 0; k < 3; k++)
            fixed[3 * i + k] = held[i];
        force[3 * i + 1] = 0.5 * s.body->mass[i], force[3 * i] = 0.3 * s.body->mass[i];
    }
    memcpy(x, s.body->rest, 3 * (size_t)n * sizeof *x);
    assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    for (int step = 0; step < steps; step++) {
        assert_int_equal(cn_molecules_explicit(s.body, dt, force, NULL, held, x, v, work, &substeps, NULL),
                         CN_OK);
        /* (M/dt^2 + alpha M/dt + (1 + beta/dt) K) dx = M u/dt + f + beta K 0 */
        fixture_force(&s, CN_TANGENT_WARPED, s.scatter, NULL);
        for (int i = 0; i < 9 * s.matrix->nblock; i++)
            s.matrix->value[i] *= 1 + m.damping_stiffness / dt;
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 3; k++) {
                s.matrix->value[9 * s.matrix->diagonal[i] + 4 * k] +=
                    s.body->mass[i] * (1 / (dt * dt) + m.damping / dt) + (held[i] ? 1e15 : 0);
                b[3 * i + k] = s.f[3 * i + k] + force[3 * i + k] + s.body->mass[i] * u[3 * i + k] / dt;
            }
        assert_int_equal(cn_solver_factor(solver, s.matrix, n, NULL, NULL), CN_OK);
        fixture_solve(solver, 3 * n, b, fixed, dx);
        for (int i = 0; i < 3 * n; i++)
            s.x[i] += dx[i], u[i] = dx[i] / dt;
    }
    double apart = 0, moved = 0;
    for (int i = 0; i < n; i++) {
        apart = fmax(apart, cn_distance(x + 3 * i, s.x + 3 * i));
        moved = fmax(moved, cn_distance(x + 3 * i, s.body->rest + 3 * i));
    }
    assert_true(moved > 1e-5 && apart < 0.02 * moved);
    free(x), free(v), free(work), free(force), free(u), free(dx), free(b), free(held), free(fixed);
    cn_solver_free(solver);
    fixture_free(&s);
}

/* Largest distance between where `steps` steps of the package's implicit Euler and of the explicit one take a
 * swinging block in 0.02 s, over what it moved. */
static double apart(int steps)
{
    const double dt = 0.02 / steps;
    cn_tets *mesh = shape_tet(0.01);
    stepper s;
    cn_material m = soft;
    m.damping = 2, m.damping_stiffness = 5e-5;
    stepper_set(&s, m, dt);
    s.spec.model = CN_BODY_MOLECULES, s.spec.molecule_radius = 0.007;
    s.spec.shape.kind = CN_SHAPE_BOX; /* the stepper's mesh is not looked at */
    s.spec.shape.box.max[0] = 0.08, s.spec.shape.box.max[1] = s.spec.shape.box.max[2] = 0.04;
    if (stepper_make(&s, mesh) != CN_OK) fail_msg("%s", s.error.message);
    const int n = s.body->nnode;
    double *x = numbers(3 * n), *v = numbers(3 * n), *work = numbers(3 * n), far = 0, moved = 0;
    int substeps;
    for (int i = 0; i < n; i++) {
        const double *p = s.body->rest + 3 * i;
        s.held[i] = p[0] < 0.01;
        if (!s.held[i]) s.now->v[3 * i + 1] = 2 * p[0], s.now->v[3 * i] = p[0];
    }
    memcpy(x, s.body->rest, 3 * (size_t)n * sizeof *x), memcpy(v, s.now->v, 3 * (size_t)n * sizeof *v);
    for (int i = 0; i < steps; i++) {
        stepper_step(&s);
        assert_int_equal(cn_molecules_explicit(s.body, dt, NULL, NULL, s.held, x, v, work, &substeps, NULL),
                         CN_OK);
    }
    for (int i = 0; i < n; i++) {
        far = fmax(far, cn_distance(x + 3 * i, s.now->x + 3 * i));
        moved = fmax(moved, cn_distance(x + 3 * i, s.body->rest + 3 * i));
    }
    free(x), free(v), free(work);
    stepper_free(&s);
    cn_tets_free(mesh);
    return far / moved;
}

static void the_step_of_a_run_and_the_explicit_one_meet_as_steps_shrink(void **state)
{
    (void)state;
    const double coarse = apart(100), fine = apart(200);
    assert_true(coarse < 0.05);
    assert_true(fine / coarse > 0.4 && fine / coarse < 0.6); /* both are of first order */
}

static void the_stable_step_is_stable_and_not_far_from_the_limit(void **state)
{
    (void)state;
    for (int damped = 0; damped < 2; damped++) {
        cn_material m = soft;
        m.damping_stiffness = damped ? 1e-3 : 0;
        fixture s = hold_body(box_body(0.06, 0.06, 0.06, straight, 0.01, false, &m));
        const int n = 3 * s.body->nnode;
        double *y = numbers(n), *z = numbers(n), square = 0;
        unsigned seed = 1;
        for (int i = 0; i < n; i++)
            y[i] = shape_random(&seed);
        fixture_force(&s, CN_TANGENT_WARPED, s.scatter, NULL);
        for (int it = 0; it < 300; it++) { /* power iteration of K over M */
            double size = 0;
            cn_matrix_multiply(s.matrix, s.matrix->n, y, z, NULL);
            for (int i = 0; i < n; i++)
                z[i] /= s.body->mass[i / 3], size += z[i] * z[i];
            square = sqrt(size);
            for (int i = 0; i < n; i++)
                y[i] = z[i] / square;
        }
        const double c = m.damping_stiffness * square;
        const double limit = (sqrt(c * c + 4 * square) - c) / square;
        const double step = cn_molecules_stable_step(s.body, s.x, NULL);
        assert_true(step <= limit && step > 0.7 * limit);
        free(y), free(z);
        fixture_free(&s);
    }
}

static void explicit_steps_refuse_what_they_cannot_do(void **state)
{
    (void)state;
    cn_body *body = box_body(0.05, 0.05, 0.05, straight, 0.01, false, &soft);
    double *x = numbers(3 * body->nnode), *v = numbers(3 * body->nnode), *work = numbers(3 * body->nnode);
    int k;
    memcpy(x, body->rest, 3 * (size_t)body->nnode * sizeof *x);
    assert_int_equal(cn_molecules_explicit(body, 0, NULL, NULL, NULL, x, v, work, &k, NULL), CN_ERR_ARG);
    assert_int_equal(cn_molecules_explicit(body, NAN, NULL, NULL, NULL, x, v, work, &k, NULL), CN_ERR_ARG);
    assert_int_equal(cn_molecules_explicit(body, 1e9, NULL, NULL, NULL, x, v, work, &k, NULL), CN_ERR_ARG);
    v[4] = NAN;
    assert_int_equal(cn_molecules_explicit(body, 1e-3, NULL, NULL, NULL, x, v, work, &k, NULL),
                     CN_ERR_NOT_FINITE);
    body->mass[3] = 0;
    assert_int_equal(cn_molecules_explicit(body, 1e-3, NULL, NULL, NULL, x, v, work, &k, NULL), CN_ERR_ARG);
    free(x), free(v), free(work);
    cn_body_free(body);
}

/* --- refusals and memory --- */

static void bad_materials_and_missing_shapes_are_refused(void **state)
{
    (void)state;
    const double min[3] = {0, 0, 0}, max[3] = {0.1, 0.1, 0.1};
    const cn_molecules_spec spec = {0.01, false, NULL};
    cn_surface *surface;
    cn_body *body;
    cn_error error = {0};
    cn_material m = soft;
    assert_int_equal(cn_surface_box(&surface, min, max), CN_OK);
    m.young = -1;
    assert_int_equal(cn_body_new_molecules(&body, surface, &spec, 1, &m, &error), CN_ERR_ARG);
    assert_non_null(strstr(error.message, "-1"));
    assert_null(body);
    m = soft, m.density = NAN;
    assert_int_equal(cn_body_new_molecules(&body, surface, &spec, 1, &m, NULL), CN_ERR_ARG);
    assert_int_equal(cn_body_new_molecules(&body, NULL, &spec, 1, &soft, NULL), CN_ERR_ARG);
    surface->ntri--; /* open */
    error = (cn_error){0};
    assert_int_equal(cn_body_new_molecules(&body, surface, &spec, 1, &soft, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "open"));
    cn_surface_free(surface);
}

static void every_failed_allocation_is_reported_and_nothing_leaks(void **state)
{
    (void)state;
    const double min[3] = {0, 0, 0}, max[3] = {0.05, 0.05, 0.05};
    const cn_molecules_spec spec = {0.012, true, NULL};
    cn_surface *surface;
    int failures = 0;
    assert_int_equal(cn_surface_box(&surface, min, max), CN_OK);
    for (FAIL_EACH_ALLOC) {
        cn_body *body;
        cn_carry *carry = NULL;
        cn_error error = {0};
        cn_status status = cn_body_new_molecules(&body, surface, &spec, 1, &soft, &error);
        if (status == CN_OK) status = cn_carry_new(&carry, body);
        /* a tree that cannot be made smaller is as good */
        assert_true(status == CN_ERR_MEMORY ? fail_alloc_fired() : status == CN_OK && body && carry);
        failures += status != CN_OK;

        cn_carry_free(carry);
        cn_body_free(body);
    }
    assert_true(failures > 50);
    cn_surface_free(surface);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_is_minus_the_gradient_of_the_energy_and_the_tangent_its_derivative),
        cmocka_unit_test(
            the_projected_tangent_has_no_negative_direction_and_is_exact_where_nothing_is_compressed),
        cmocka_unit_test(inner_forces_have_no_sum_and_no_moment_and_rest_has_no_force),
        cmocka_unit_test(a_rigid_motion_costs_nothing_and_turns_the_forces),
        cmocka_unit_test(results_do_not_depend_on_threads_or_instruction_set),
        cmocka_unit_test(a_stretched_bar_is_as_stiff_as_its_youngs_modulus_says),
        cmocka_unit_test(energy_of_a_uniform_strain_is_that_of_the_isotropic_solid),
        cmocka_unit_test(measures_are_those_of_a_uniform_stretch),
        cmocka_unit_test(what_is_not_a_number_makes_energy_and_measures_none),
        cmocka_unit_test(points_follow_any_affine_motion_and_start_where_the_surface_is),
        cmocka_unit_test(forces_on_points_do_the_same_work_on_the_molecules),
        cmocka_unit_test(explicit_steps_keep_momentum_and_energy),
        cmocka_unit_test(explicit_and_implicit_steps_agree_as_steps_shrink),
        cmocka_unit_test(the_step_of_a_run_and_the_explicit_one_meet_as_steps_shrink),
        cmocka_unit_test(the_stable_step_is_stable_and_not_far_from_the_limit),
        cmocka_unit_test(explicit_steps_refuse_what_they_cannot_do),
        cmocka_unit_test(bad_materials_and_missing_shapes_are_refused),
        cmocka_unit_test(every_failed_allocation_is_reported_and_nothing_leaks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
