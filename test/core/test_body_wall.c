/* Deformable walls: membranes and shells against closed forms, published values and the reference. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <jansson.h>

#include "body_wall.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "frames_vtk.h"
#include "wall_cases.h"

static const double pi = 3.14159265358979323846;

/* --- the membrane --- */

static void a_membrane_is_the_papers_layer_with_its_apexes_condensed(void **state)
{
    (void)state;
    FILE *file = reference_open("data/artery_single_tet_layer.json");
    if (!file) skip();
    json_t *json = json_loadf(file, 0, NULL);
    fclose(file);
    const json_t *cases = json_object_get(json, "cases");
    assert_true(json_array_size(cases) > 0);
    for (size_t i = 0; i < json_array_size(cases); i++) {
        const json_t *c = json_array_get(cases, i), *want = json_object_get(c, "condensed_stiffness_9x9");
        cn_wall_spec spec = plain_wall[0];
        cn_surface *surface;
        double size = 0;
        spec.young = json_number_value(json_object_get(c, "E"));
        spec.poisson = json_number_value(json_object_get(c, "nu"));
        spec.thickness = json_number_value(json_object_get(c, "membrane_thickness"));
        assert_int_equal(cn_surface_new(&surface, 3, 1), CN_OK);
        for (int k = 0; k < 9; k++) {
            surface->tri[k / 3] = k / 3;
            surface->vert[k] = json_number_value(
                json_array_get(json_array_get(json_object_get(c, "X"), (size_t)k / 3), (size_t)k % 3));
        }
        fixture s = wall_of(surface, spec);
        const double area = json_number_value(json_object_get(c, "base_area"));
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        for (int k = 0; k < 81; k++)
            size = fmax(size, fabs(json_number_value(
                                  json_array_get(json_array_get(want, (size_t)k / 9), (size_t)k % 9))));
        for (int k = 0; k < 81; k++) {
            const int row = k / 9, col = k % 9, block = cn_matrix_find(s.matrix, row / 3, col / 3);
            const double got = s.matrix->value[9 * block + 3 * (row % 3) + col % 3];
            const double held = row == col ? spec.foundation * area / 3 : 0;
            const double k_want =
                json_number_value(json_array_get(json_array_get(want, (size_t)row), (size_t)col));
            assert_true(fabs(got - held - k_want) < 1e-8 * size);
        }
        fixture_free(&s);
    }
    json_decref(json);
}

/* Lame's tube between held ends: displacement at r over p. */
static double lame(double a, double b, double young, double nu, double r)
{
    const double c = a * a / (b * b - a * a);
    return (1 + nu) / young * c * ((1 - 2 * nu) * r + b * b / r);
}

static void a_thin_tube_widens_as_lames_does_alone_and_on_its_foundation(void **state)
{
    (void)state;
    FILE *file = reference_open("data/thick_cylinder.json");
    if (!file) skip();
    json_t *json = json_loadf(file, 0, NULL);
    fclose(file);
    const json_t *cases = json_object_get(json, "cases");
    assert_true(json_array_size(cases) > 0);
    for (size_t i = 0; i < json_array_size(cases); i++) {
        const json_t *c = json_array_get(cases, i);
        const double a = json_number_value(json_object_get(c, "a")),
                     b = json_number_value(json_object_get(c, "b"));
        const double young = json_number_value(json_object_get(c, "E")),
                     p = json_number_value(json_object_get(c, "p"));
        const double nu = json_number_value(json_object_get(c, "nu"));
        const json_t *held = json_object_get(json_object_get(c, "ends"), "plane_strain");
        const double given = json_number_value(json_object_get(held, "u_inner"));
        assert_true(fabs(p * lame(a, b, young, nu, a) - given) < 1e-10 * given);
        const double h = 0.005 * a, r = a + h / 2; /* the same tube, its wall thinner */
        for (int shell = 0; shell < 2; shell++)
            for (int firm = 0; firm < 2; firm++) {
                cn_wall_spec spec = plain_wall[shell];
                cn_surface *surface = wall_grid(60, 12, 0, true, wall_tube);
                const double hoop = young * h / ((1 - nu * nu) * r * r);
                spec.young = young, spec.poisson = nu, spec.thickness = h;
                spec.foundation = (firm ? 1 : 1e-9) * hoop;
                for (int k = 0; k < 3 * surface->nvert; k++)
                    surface->vert[k] *= r;
                fixture s = wall_of(surface, spec);
                const int n = s.body->nnode;
                double *load = numbers(3 * n), *u = numbers(3 * n), mean = 0, most = 0;
                unsigned char *fixed = flags(3 * n);
                for (int k = 0; k < n; k++)
                    fixed[3 * k + 2] = 1;
                wall_press(s.body, p * a / r, NULL, load); /* it acts on the inner face */
                wall_solve(&s, load, fixed, u);
                for (int k = 0; k < n; k++) {
                    const double out = cn_dot(u + 3 * k, s.body->rest + 3 * k) / r;
                    mean += out / n, most = fmax(most, out);
                }
                const double want = firm ? p * a / r / (2 * hoop) : p * lame(a, a + h, young, nu, r);
                if (i == 0)
                    printf("  tube, %s, %s: radial displacement %.4f of the closed form\n",
                           shell ? "shell" : "membrane", firm ? "on a foundation" : "alone", mean / want);
                assert_true(fabs(mean / want - 1) < 0.01 && fabs(most / want - 1) < 0.03);
                cn_measures m;
                for (int k = 0; k < 3 * n; k++)
                    s.x[k] = s.body->rest[k] + u[k];
                cn_body_measure(s.body, n, s.x, NULL, true, &m, NULL, NULL);
                const double strain = want / r, plane = young / (1 - nu * nu) * strain;
                const double mises = plane * sqrt(1 - nu + nu * nu);
                assert_true(fabs(m.stress_mean / mises - 1) < 0.01);
                assert_true(fabs(m.volume_mean / ((1 - 2 * nu) / (1 - nu) * strain) - 1) < 0.01);
                free(load), free(u), free(fixed);
                fixture_free(&s);
            }
    }
    json_decref(json);
}

/* In-plane linear field: strain and stress exact, no force on inner vertices. */
static void a_linear_field_is_exact_on_any_mesh(void **state)
{
    (void)state;
    const double g[9] = {1e-3, 1e-4, 0, 1e-4, 7e-4, 0, 0, 0, 0}; /* du/dx in the plane, without a turn */
    const double w[3] = {0.4, -0.9, 0.3};
    double r[9];
    cn_rotation(w, r);
    for (int shell = 0; shell < 2; shell++) {
        cn_wall_spec spec = plain_wall[shell];
        fixture s = wall_of(wall_grid(9, 7, 0.3, false, wall_tilted_square), spec);
        const double nu = spec.poisson, plane = spec.young / (1 - nu * nu);
        for (int i = 0; i < s.body->nnode; i++) {
            double flat[3], moved[3], back[3], rt[9];
            for (int k = 0; k < 9; k++)
                rt[k] = r[3 * (k % 3) + k / 3];
            cn_mat_vec(rt, s.body->rest + 3 * i, flat);
            cn_mat_vec(g, flat, moved);
            cn_mat_vec(r, moved, back);
            cn_axpy(1, back, s.x + 3 * i);
        }
        const double sx = plane * (g[0] + nu * g[4]), sy = plane * (g[4] + nu * g[0]);
        const double t = plane * (1 - nu) / 2 * (g[1] + g[3]);
        const double mises = sqrt(sx * sx - sx * sy + sy * sy + 3 * t * t);
        double *got = numbers(s.body->nelement);
        cn_measures m;
        cn_body_measure(s.body, s.body->nnode, s.x, NULL, true, &m, got, NULL);
        for (int e = 0; e < s.body->nelement; e++)
            assert_true(fabs(got[e] / mises - 1) < 1e-11);
        const double change = (1 - 2 * nu) / (1 - nu) * (g[0] + g[4]);
        assert_true(fabs(m.volume_max / change - 1) < 1e-11 && fabs(m.volume_mean / change - 1) < 1e-11);
        assert_true(fabs(m.volume / (spec.thickness * (1 + change)) - 1) < 1e-12 && m.inverted == 0);
        fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
        const double typical = spec.young * spec.thickness * 1e-3 / 8;
        for (int i = 0; i < s.body->nnode; i++) {
            const int column = i % 10, row = i / 10;
            double f[3];
            cn_sub(s.x + 3 * i, s.body->rest + 3 * i, f); /* the foundation's part, of a membrane */
            for (int k = 0; k < 3; k++)
                f[k] = s.f[3 * i + k] + ((const cn_sheet *)s.body->own)->foundation[i] * f[k];
            if (column > 0 && column < 9 && row > 0 && row < 7) assert_true(cn_norm(f) < 1e-11 * typical);
        }
        free(got);
        fixture_free(&s);
    }
}

/* --- what holds for both --- */

static void stir(fixture *s, unsigned seed, double size)
{
    for (int i = 0; i < 3 * s->body->nnode; i++)
        s->x[i] = s->body->rest[i] + size * shape_random(&seed);
}

static void force_is_minus_the_energy_gradient_and_stiffness_its_derivative(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        cn_wall_spec spec = plain_wall[shell];
        spec.foundation = 1e4, spec.thickness = 0.1;
        fixture s = wall_of(wall_grid(5, 4, 0.2, false, wall_bent), spec);
        const int n = 3 * s.body->nnode;
        double *u = numbers(n), *ku = numbers(n), *f = numbers(n);
        stir(&s, 3, 0.01);
        const double energy = fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        memcpy(f, s.f, (size_t)n * sizeof *f);
        const double size = largest(f, n);
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i], h = 1e-3;
            s.x[i] = xi + h;
            const double up = cn_body_energy(s.body, s.body->nnode, s.x, NULL, NULL);
            s.x[i] = xi - h;
            const double down = cn_body_energy(s.body, s.body->nnode, s.x, NULL, NULL);
            s.x[i] = xi;
            assert_true(fabs(f[i] + (up - down) / (2 * h)) < 1e-9 * size);
            u[i] = s.x[i] - s.body->rest[i];
        }
        cn_matrix_multiply(s.matrix, s.body->nnode, u, ku, NULL);
        double half = 0;
        for (int i = 0; i < n; i++) {
            half += u[i] * ku[i] / 2;
            assert_true(fabs(f[i] + ku[i]) < 1e-12 * size);
        }
        assert_true(fabs(energy / half - 1) < 1e-12);
        for (int i = 0; i < s.matrix->n; i++) /* symmetric to the last bit */
            for (int k = s.matrix->row[i]; k < s.matrix->row[i + 1]; k++)
                for (int e = 0; e < 9; e++)
                    assert_true(s.matrix->value[9 * k + e] ==
                                s.matrix->value[9 * cn_matrix_find(s.matrix, s.matrix->col[k], i) +
                                                3 * (e % 3) + e / 3]);
        free(u), free(ku), free(f);
        fixture_free(&s);
    }
}

static void the_way_triangles_are_wound_does_not_matter(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        cn_surface *surface = wall_grid(6, 6, 0.25, false, wall_bent);
        double *f = numbers(3 * surface->nvert);
        for (int turned = 0; turned < 2; turned++) {
            cn_surface *copy;
            unsigned seed = 11;
            assert_int_equal(cn_surface_copy(&copy, surface), CN_OK);
            for (int t = 0; turned && t < copy->ntri; t++)
                if (shape_random(&seed) > 0) {
                    const int c = copy->tri[3 * t];
                    copy->tri[3 * t] = copy->tri[3 * t + 1], copy->tri[3 * t + 1] = c;
                }
            fixture s = wall_of(copy, plain_wall[shell]);
            stir(&s, 9, 0.02);
            fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            const double size = largest(s.f, 3 * s.body->nnode);
            for (int i = 0; i < 3 * s.body->nnode; i++)
                if (turned)
                    assert_true(fabs(f[i] - s.f[i]) < 1e-11 * size);
                else
                    f[i] = s.f[i];
            fixture_free(&s);
        }
        free(f);
        cn_surface_free(surface);
    }
}

/* x = R rest + by */
static void carry_off(fixture *s, const double turn[3], const double by[3])
{
    double r[9];
    cn_rotation(turn, r);
    for (int i = 0; i < s->body->nnode; i++) {
        cn_mat_vec(r, s->body->rest + 3 * i, s->x + 3 * i);
        cn_add(s->x + 3 * i, by, s->x + 3 * i);
    }
}

static void a_turn_changes_no_measure_and_without_turning_triangles_shows_its_frozen_strain(void **state)
{
    (void)state;
    const double by[3] = {4, -8, 16}, none[3] = {0, 0, 0};
    for (int shell = 0; shell < 2; shell++) {
        fixture s = wall_of(wall_grid(8, 8, 0, false, wall_square), plain_wall[shell]);
        const double stress = 1e-11 * plain_wall[shell].young, plate = stress * s.body->rest_volume;
        double *rotation = s.rotation;
        cn_measures m;
        carry_off(&s, none, by);
        cn_body_measure(s.body, s.body->nnode, s.x, rotation, true, &m, NULL, NULL);
        assert_true(m.volume_max < 1e-11 && m.stress_max < stress && m.inverted == 0);
        assert_true(fabs(m.volume / s.body->rest_volume - 1) < 1e-11);
        if (shell) assert_true(m.energy == 0);
        for (int k = 0; k < 3; k++) {
            const double a = 0.4 / (1 << k),
                         turn[3] = {0, a, 0}; /* out of its plane: one direction shortens */
            const double nu = plain_wall[shell].poisson, h = plain_wall[shell].thickness, e = 1 - cos(a);
            const double frozen = plain_wall[shell].young / (1 - nu * nu) * h * e * e / 2;
            carry_off(&s, turn, none);
            cn_body_measure(s.body, s.body->nnode, s.x, rotation, true, &m, NULL, NULL);
            assert_true(m.volume_max < 1e-11 && m.stress_max < stress);
            if (shell) assert_true(fabs(m.energy / frozen - 1) < 1e-9);
            assert_true(fabs(cn_sheet_turn(s.body, s.x, rotation, NULL) - a) < 1e-7);
        }
        cn_sheet_follow(s.body, s.x, rotation, -1, NULL);
        assert_true(cn_sheet_turns(s.body, rotation) && cn_sheet_turn(s.body, s.x, rotation, NULL) < 1e-7);
        for (int k = 0; k < 4; k++) {
            const double turn[4][3] = {{2.9, 0, 0}, {0, 3.1, 0.1}, {0.2, -0.1, -3}, {1, -0.7, 0.4}};
            carry_off(&s, turn[k], none);
            cn_body_measure(s.body, s.body->nnode, s.x, rotation, true, &m, NULL, NULL);
            assert_true(m.volume_max < 1e-11 && m.stress_max < stress);
            if (shell) assert_true(m.energy < 1e-9 * plate);
            cn_body_rotation_start(s.body, rotation);
            assert_true(fabs(cn_sheet_turn(s.body, s.x, rotation, NULL) - cn_norm(turn[k])) < 1e-7);
            cn_sheet_follow(s.body, s.x, rotation, -1, NULL);
            assert_true(cn_sheet_turn(s.body, s.x, rotation, NULL) < 1e-7);
        }
        fixture_free(&s);
    }
}

static void a_turned_walls_force_is_minus_the_gradient_of_its_energy_however_it_lies(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++)
        for (int large = 0; large < 2; large++) {
            cn_wall_spec spec = plain_wall[shell];
            spec.foundation = 1e4, spec.thickness = 0.1;
            fixture s = wall_of(wall_grid(5, 4, 0.2, false, wall_bent), spec);
            const int n = 3 * s.body->nnode;
            const double turn[3] = {1.1, -0.4, 0.7};
            double *f = numbers(n), *rotation = s.rotation;
            stir(&s, 3, large ? 0.08 : 0.01);
            double r[9], x[3];
            cn_rotation(turn, r);
            for (int i = 0; i < s.body->nnode; i++)
                cn_copy3(s.x + 3 * i, x), cn_mat_vec(r, x, s.x + 3 * i);
            cn_sheet_follow(s.body, s.x, rotation, -1, NULL);
            cn_body_add_elastic(s.body, s.body->nnode, s.x, rotation, f, CN_TANGENT_EXACT, 1, NULL, NULL);
            double net[3] = {0, 0, 0}, force = 0;
            const double size = largest(f, n);
            for (int i = 0; i < n; i++) {
                const double xi = s.x[i], h = 1e-4;
                double e[4];
                for (int k = 0; k < 4; k++) { /* to fourth order */
                    s.x[i] = xi + (k < 2 ? k - 2 : k - 1) * h;
                    e[k] = cn_body_energy(s.body, s.body->nnode, s.x, rotation, NULL);
                }
                s.x[i] = xi;
                const double slope = (e[0] - 8 * e[1] + 8 * e[2] - e[3]) / (12 * h);
                assert_true(fabs(f[i] + slope) < 1e-7 * size);
            }
            spec.foundation = shell ? 0 : 1e-9; /* free, it pushes and turns itself nowhere */
            fixture alone = wall_of(wall_grid(5, 4, 0.2, false, wall_bent), spec);
            memset(f, 0, (size_t)n * sizeof *f);
            cn_body_add_elastic(alone.body, s.body->nnode, s.x, rotation, f, CN_TANGENT_EXACT, 1, NULL, NULL);
            double moment[3] = {0, 0, 0};
            for (int i = 0; i < s.body->nnode; i++) {
                double arm[3];
                cn_cross(s.x + 3 * i, f + 3 * i, arm);
                cn_add(net, f + 3 * i, net), cn_add(moment, arm, moment), force += cn_norm(f + 3 * i);
            }
            assert_true(cn_norm(net) < 1e-11 * force && cn_norm(moment) < 1e-10 * force);
            free(f);
            fixture_free(&s), fixture_free(&alone);
        }
}

static void the_stiffness_of_a_turned_wall_is_that_of_rest_turned(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        cn_wall_spec spec = plain_wall[shell];
        spec.foundation = 1e4, spec.thickness = 0.1;
        fixture s = wall_of(wall_grid(5, 4, 0.2, false, wall_bent), spec);
        const int n = 3 * s.body->nnode;
        const double turn[3] = {1.1, -0.4, 0.7}, none[3] = {0, 0, 0};
        double *rotation = s.rotation, *f[2] = {numbers(n), numbers(n)}, *ku = numbers(n);
        double *place = numbers(n);
        carry_off(&s, turn, none);
        cn_sheet_follow(s.body, s.x, rotation, -1, NULL);
        memcpy(place, s.x, (size_t)n * sizeof *place);
        stir(&s, 5, 1); /* a direction */
        for (int sign = 0; sign < 2; sign++) {
            for (int i = 0; i < n; i++)
                ku[i] = place[i] + (sign ? -1e-5 : 1e-5) * (s.x[i] - s.body->rest[i]);
            cn_body_add_elastic(s.body, s.body->nnode, ku, rotation, f[sign], CN_TANGENT_EXACT, 1,
                                sign ? NULL : s.scatter, NULL);
        }
        double *u = numbers(n);
        for (int i = 0; i < n; i++)
            u[i] = s.x[i] - s.body->rest[i];
        cn_matrix_multiply(s.matrix, s.body->nnode, u, ku, NULL);
        const double size = largest(ku, n);
        for (int i = 0; i < n; i++)
            assert_true(fabs((f[1][i] - f[0][i]) / 2e-5 - ku[i]) < 1e-6 * size);
        free(f[0]), free(f[1]), free(ku), free(u), free(place);
        fixture_free(&s);
    }
}

static void results_are_the_same_for_any_number_of_threads(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        fixture s = wall_of(wall_grid(40, 30, 0.2, false, wall_bent), plain_wall[shell]);
        const int n = s.body->nnode;
        double *f = numbers(3 * n), *k = numbers(9 * s.matrix->nblock), *stress = numbers(s.body->nelement);
        double *again = numbers(s.body->nelement), energy = 0;
        const cn_sheet_kernel kernel = ((cn_sheet *)s.body->own)->kernel;
        cn_measures m[2];
        stir(&s, 21, 0.01);
        for (int run = 0; run < 6; run++) { /* as at rest, and turned */
            const int threads = 1 + run % 3;
            cn_pool *pool;
            if (run == 3) cn_sheet_follow(s.body, s.x, s.rotation, -1, NULL);
            assert_int_equal(cn_pool_new(&pool, threads), CN_OK);
            const double e = fixture_force(&s, CN_TANGENT_EXACT, s.scatter, pool);
            cn_body_measure(s.body, n, s.x, NULL, true, &m[threads > 1], threads > 1 ? again : stress, pool);
            cn_pool_free(pool);
            if (threads == 1) {
                energy = e, memcpy(f, s.f, 3 * (size_t)n * sizeof *f);
                memcpy(k, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *k);
                continue;
            }
            assert_true(e == energy && !memcmp(f, s.f, 3 * (size_t)n * sizeof *f));
            assert_memory_equal(k, s.matrix->value, 9 * (size_t)s.matrix->nblock * sizeof *k);
            assert_memory_equal(stress, again, (size_t)s.body->nelement * sizeof *stress);
            assert_memory_equal(m, m + 1, sizeof *m);
        }
        for (int most = 0; most < 2; most++) { /* nor does it matter how many numbers an instruction takes */
            ((cn_sheet *)s.body->own)->kernel = cn_sheet_kernel_pick(most);
            assert_true(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) == energy);
            assert_memory_equal(f, s.f, 3 * (size_t)n * sizeof *f);
        }
        ((cn_sheet *)s.body->own)->kernel = kernel;
        free(f), free(k), free(stress), free(again);
        fixture_free(&s);
    }
}

static void masses_rims_and_fields_are_as_the_header_says(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        const cn_wall_spec *spec = plain_wall + shell;
        fixture s = wall_of(wall_grid(12, 3, 0, true, wall_tube), *spec);
        const cn_body *b = s.body;
        unsigned char *rim = flags(b->nnode);
        double mass = 0, centre[3];
        cn_body_wall_rims(b, rim);
        for (int i = 0; i < b->nnode; i++) {
            mass += b->mass[i];
            assert_int_equal(rim[i], i < 12 || i >= 36);
        }
        const double area = 12 * 2 * sin(pi / 12);
        assert_true(fabs(mass / (area * spec->thickness * spec->density) - 1) < 1e-12);
        assert_true(fabs(b->rest_volume / (area * spec->thickness) - 1) < 1e-12 && b->spring > 0);
        assert_int_equal(b->model, shell ? CN_BODY_SHELL : CN_BODY_MEMBRANE);
        assert_true(b->nblock == b->nnode && b->npoint == b->nnode && b->ntet == 0 &&
                    b->nturn == 2 * b->nelement + 1);
        assert_true(b->point == b->rest && b->lever == 1 && b->boundary->ntri == b->nelement);
        assert_true(cn_body_points(b, b->nnode, s.x, NULL, NULL) == s.x);
        cn_body_element_centre(b, s.x, 5, centre);
        assert_true(hypot(centre[0], centre[1]) < 1);
        cn_body_element_centre(b, s.x, b->nelement, centre);
        assert_true(isnan(centre[0]));
        s.x[7] = NAN;
        cn_measures m;
        cn_body_measure(b, b->nnode, s.x, NULL, true, &m, NULL, NULL);
        assert_true(isnan(m.energy) && isnan(m.stress_max) && isnan(m.volume_max) && m.inverted > 0);
        assert_true(isnan(fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL)));
        free(rim);
        fixture_free(&s);
    }
    const double zero[3] = {0};
    cn_surface *ball;
    assert_int_equal(cn_surface_sphere(&ball, zero, 1), CN_OK);
    fixture s = wall_of(ball, plain_wall[1]);
    unsigned char *rim = flags(s.body->nnode);
    cn_body_wall_rims(s.body, rim);
    for (int i = 0; i < s.body->nnode; i++)
        assert_int_equal(rim[i], 0);
    free(rim);
    fixture_free(&s);
}

static void a_vertex_of_no_triangle_stays_where_it_is(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        cn_surface *with, *without = wall_grid(3, 3, 0, false, wall_bent);
        assert_int_equal(cn_surface_new(&with, without->nvert + 1, without->ntri), CN_OK);
        memcpy(with->vert, without->vert, 3 * (size_t)without->nvert * sizeof(double));
        memcpy(with->tri, without->tri, 3 * (size_t)without->ntri * sizeof(int));
        fixture s = wall_of(with, plain_wall[shell]), other = wall_of(without, plain_wall[shell]);
        const int n = s.body->nnode;
        cn_solver *solver;
        stir(&other, 6, 0.1);
        memcpy(s.x, other.x, 3 * (size_t)(n - 1) * sizeof(double));
        const double energy = fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        assert_true(fabs(energy / fixture_force(&other, CN_TANGENT_EXACT, NULL, NULL) - 1) < 1e-12);
        assert_true(s.body->mass[n - 1] == 0 && s.f[3 * n - 1] == 0);
        assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
        unsigned char *held = flags(n);
        held[0] = held[3] = held[n - 2] = 1;
        assert_int_equal(cn_solver_factor(solver, s.matrix, n, held, NULL), CN_OK);
        cn_solver_free(solver);
        free(held);
        fixture_free(&s), fixture_free(&other);
    }
}

static void refused(const cn_surface *surface, cn_wall_spec spec, cn_status status, const char *says)
{
    cn_error error = {0};
    cn_body *body = (cn_body *)&error;
    assert_int_equal(cn_body_new_wall(&body, surface, &spec, &error), status);
    assert_null(body);
    assert_non_null(strstr(error.message, says));
}

static void what_is_no_wall_is_refused_in_a_sentence(void **state)
{
    (void)state;
    cn_surface *s = wall_grid(3, 3, 0, false, wall_square), *few;
    const double bad[] = {0, -1, NAN, INFINITY};
    for (int i = 0; i < 4; i++) {
        cn_wall_spec spec = plain_wall[0];
        spec.thickness = bad[i];
        refused(s, spec, CN_ERR_ARG, "thickness");
        spec = plain_wall[0], spec.foundation = bad[i];
        refused(s, spec, CN_ERR_ARG, "foundation");
        spec = plain_wall[1], spec.young = bad[i];
        refused(s, spec, CN_ERR_ARG, "Young");
        if (i == 0) continue;
        spec = plain_wall[1], spec.foundation = bad[i];
        refused(s, spec, CN_ERR_ARG, "foundation");
        spec = plain_wall[1], spec.density = bad[i];
        refused(s, spec, CN_ERR_ARG, "density");
        spec = plain_wall[1], spec.poisson = i == 1 ? 0.5 : bad[i];
        refused(s, spec, CN_ERR_ARG, "Poisson");
    }
    cn_wall_spec rigid = plain_wall[0];
    rigid.model = CN_WALL_RIGID;
    refused(s, rigid, CN_ERR_ARG, "rigid");
    assert_int_equal(cn_surface_new(&few, 3, 0), CN_OK);
    refused(few, plain_wall[0], CN_ERR_MESH, "0 triangles");
    cn_surface_free(few);
    s->vert[17] = NAN;
    refused(s, plain_wall[0], CN_ERR_MESH, "vertex 5");
    s->vert[17] = 0;
    const int kept = s->tri[4];
    s->tri[4] = 16;
    refused(s, plain_wall[0], CN_ERR_MESH, "vertex 16 of 16");
    s->tri[4] = s->tri[3];
    refused(s, plain_wall[1], CN_ERR_MESH, "triangle 1 has an area of 0");
    s->tri[4] = kept;
    cn_surface *fin;
    assert_int_equal(cn_surface_new(&fin, 5, 3), CN_OK);
    const double place[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1};
    const int tri[9] = {0, 1, 2, 0, 3, 1, 0, 1, 4};
    memcpy(fin->vert, place, sizeof place), memcpy(fin->tri, tri, sizeof tri);
    refused(fin, plain_wall[1], CN_ERR_MESH, "edge 0-1");
    fixture f = wall_of(fin, plain_wall[0]); /* a membrane takes it */
    fixture_free(&f);
    cn_surface_free(s);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    cn_surface *s = wall_grid(4, 3, 0.2, false, wall_bent);
    cn_body *body = NULL;
    cn_scatter *scatter = NULL;
    cn_matrix *matrix = NULL;
    const int first = 0;
    cn_status status = CN_ERR_MEMORY;
    for (FAIL_EACH_ALLOC) {
        cn_error error = {0};
        status = cn_body_new_wall(&body, s, plain_wall + 1, &error);
        if (status != CN_OK) assert_true(!body && strstr(error.message, "memory"));
        if (status == CN_OK) status = cn_matrix_new(&matrix, 1, (const cn_body *const *)&body, &first);
        if (status == CN_OK) status = cn_body_bind(&scatter, body, matrix, 0);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        cn_scatter_free(scatter), cn_matrix_free(matrix), cn_body_free(body);
        scatter = NULL, matrix = NULL, body = NULL;
    }
    assert_int_equal(status, CN_OK);
    cn_surface_free(s);
}

static void a_frame_of_a_wall_has_its_triangles_and_their_stress(void **state)
{
    (void)state;
    const char *path = "wall_frame.vtu";
    fixture s = wall_of(wall_grid(4, 3, 0, false, wall_bent), plain_wall[0]);
    double *stress = numbers(s.body->nelement);
    cn_measures m;
    stir(&s, 4, 0.01);
    cn_body_measure(s.body, s.body->nnode, s.x, NULL, true, &m, stress, NULL);
    const cn_frame_body frame = {"wall", s.body, s.body->nnode, s.x, stress, INFINITY, NULL, NULL};
    cn_error error = {0};
    char text[2048] = "";
    assert_int_equal(cn_vtu_write(&frame, path, &error), CN_OK);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t n = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    remove(path);
    assert_true(n > 0 && strstr(text, "NumberOfPoints=\"20\" NumberOfCells=\"24\"") &&
                strstr(text, "stress"));
    free(stress);
    fixture_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_membrane_is_the_papers_layer_with_its_apexes_condensed),
        cmocka_unit_test(a_thin_tube_widens_as_lames_does_alone_and_on_its_foundation),
        cmocka_unit_test(a_linear_field_is_exact_on_any_mesh),
        cmocka_unit_test(force_is_minus_the_energy_gradient_and_stiffness_its_derivative),
        cmocka_unit_test(the_way_triangles_are_wound_does_not_matter),
        cmocka_unit_test(a_turn_changes_no_measure_and_without_turning_triangles_shows_its_frozen_strain),
        cmocka_unit_test(a_turned_walls_force_is_minus_the_gradient_of_its_energy_however_it_lies),
        cmocka_unit_test(the_stiffness_of_a_turned_wall_is_that_of_rest_turned),
        cmocka_unit_test(results_are_the_same_for_any_number_of_threads),
        cmocka_unit_test(masses_rims_and_fields_are_as_the_header_says),
        cmocka_unit_test(a_frame_of_a_wall_has_its_triangles_and_their_stress),
        cmocka_unit_test(a_vertex_of_no_triangle_stays_where_it_is),
        cmocka_unit_test(what_is_no_wall_is_refused_in_a_sentence),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
