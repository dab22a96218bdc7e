/* The element against the reference folder: every case of each file. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <jansson.h>

#include "body_element.h"
#include "catnav/vec3.h"
#include "polar.h"
#include "shapes.h"
#include "solve.h"

static json_t *read_json(const char *name)
{
    FILE *file = reference_open(name);
    if (!file) return NULL;
    json_t *json = json_loadf(file, 0, NULL);
    fclose(file);
    assert_non_null(json);
    return json;
}

static double number(const json_t *json, const char *key)
{
    const json_t *value = json_object_get(json, key);
    assert_true(json_is_number(value));
    return json_number_value(value);
}

/* Numbers of a nested array, row by row; returns how many. */
static int flatten(const json_t *json, double *out)
{
    if (!json_is_array(json)) return out[0] = json_number_value(json), 1;
    int n = 0;
    for (size_t i = 0; i < json_array_size(json); i++)
        n += flatten(json_array_get(json, i), out + n);
    return n;
}

static int array(const json_t *json, const char *key, double *out)
{
    assert_true(json_is_array(json_object_get(json, key)));
    return flatten(json_object_get(json, key), out);
}

static double *numbers(int n)
{
    double *a = calloc((size_t)n, sizeof *a);
    assert_non_null(a);
    return a;
}

typedef struct {
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    double *x, *rotation, *f;
} fixture;

static fixture setup(const cn_tets *mesh, double young, double poisson)
{
    const cn_material m = {.young = young, .poisson = poisson, .density = 1000};
    const int first = 0;
    fixture s;
    assert_int_equal(cn_body_new(&s.body, mesh, &m, NULL, NULL), CN_OK);
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    s.x = numbers(3 * s.body->nnode), s.f = numbers(3 * s.body->nnode),
    s.rotation = numbers(4 * s.body->ntet);
    cn_body_rotation_start(s.body, s.rotation);
    return s;
}

static void teardown(fixture *s)
{
    cn_scatter_free(s->scatter);
    cn_matrix_free(s->matrix);
    cn_body_free(s->body);
    free(s->x);
    free(s->f);
    free(s->rotation);
}

static double force(fixture *s, cn_tangent tangent, const cn_scatter *scatter)
{
    memset(s->f, 0, 3 * (size_t)s->body->nnode * sizeof *s->f);
    if (scatter) cn_matrix_clear(s->matrix, s->matrix->n);
    return cn_body_add_elastic(s->body, s->body->nnode, s->x, s->rotation, s->f, tangent, 1, scatter, NULL);
}

static double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

static double worst_difference(const double *a, const double *b, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i] - b[i]));
    return max;
}

/* A corner tetrahedron of side 1 has F = [x1 x2 x3] and the gradients e1, e2, e3: f_a = -V P e_a, so force
 * and stiffness are P and dP/dF but for V = 1/6. */
static void stress_energy_and_tangent_of_single_gradients(void **state)
{
    (void)state;
    json_t *json = read_json("data/corotational_law.json");
    if (!json) skip();
    const json_t *cases = json_object_get(json, "cases");
    cn_tets *mesh = shape_tet(1);
    for (size_t c = 0; c < json_array_size(cases); c++) {
        const json_t *item = json_array_get(cases, c);
        fixture s = setup(mesh, number(item, "E"), number(item, "nu"));
        double f[9], p[9], r[9], got[9], k[81], gotk[81], v[9];
        array(item, "F", f), array(item, "first_piola", p), array(item, "rotation", r);
        array(item, "tangent_9x9_rowmajor", k);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                s.x[3 * (1 + j) + i] = f[3 * i + j];

        const double energy = 6 * force(&s, CN_TANGENT_EXACT, s.scatter);
        assert_true(fabs(energy - number(item, "energy_density")) <= 1e-10 * fabs(energy));
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                got[3 * i + j] = -6 * s.f[3 * (1 + j) + i];
        assert_true(worst_difference(got, p, 9) <= 1e-10 * largest(p, 9));
        cn_quaternion_matrix(s.rotation, got);
        assert_true(worst_difference(got, r, 9) <= 1e-12);

        for (int i = 0; i < 9; i++) /* entries of P and F row by row; blocks by node */
            for (int j = 0; j < 9; j++) {
                const int block = cn_matrix_find(s.matrix, 1 + i % 3, 1 + j % 3);
                gotk[9 * i + j] = 6 * s.matrix->value[9 * block + 3 * (i / 3) + j / 3];
            }
        assert_true(worst_difference(gotk, k, 81) <= 1e-8 * largest(k, 81));

        force(&s, CN_TANGENT_PROJECTED, s.scatter);
        unsigned seed = 3;
        for (int trial = 0; trial < 1000; trial++) { /* the projected one pulls back nowhere */
            double form = 0;
            for (int i = 0; i < 9; i++)
                v[i] = shape_random(&seed);
            for (int i = 0; i < 9; i++)
                for (int j = 0; j < 9; j++) {
                    const int block = cn_matrix_find(s.matrix, 1 + i % 3, 1 + j % 3);
                    form += v[i] * v[j] * 6 * s.matrix->value[9 * block + 3 * (i / 3) + j / 3];
                }
            assert_true(form >= -1e-13 * largest(k, 81));
        }
        teardown(&s);
    }
    cn_tets_free(mesh);
    json_decref(json);
}

static void measures_of_a_bent_and_turned_body(void **state)
{
    (void)state;
    json_t *json = read_json("data/constraint_quantities.json");
    cn_tets *mesh = reference_mesh("constraint_mesh");
    if (!json || !mesh) {
        json_decref(json), cn_tets_free(mesh);
        skip();
    }
    const json_t *cases = json_object_get(json, "cases");
    for (size_t c = 0; c < json_array_size(cases); c++) {
        const json_t *item = json_array_get(cases, c);
        const double nu = number(item, "nu"), tolerance = nu > 0.499 ? 1e-7 : 1e-10;
        fixture s = setup(mesh, number(item, "E"), nu);
        cn_measures m;
        double *want = numbers(mesh->ntet), *got = numbers(mesh->ntet);
        assert_int_equal(array(item, "deformed_positions", s.x), 3 * mesh->nnode);
        assert_int_equal(array(item, "von_mises", want), mesh->ntet);
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, got, NULL);
        for (int e = 0; e < mesh->ntet; e++)
            assert_true(fabs(got[e] - want[e]) <= tolerance * want[e]);
        const double max = number(item, "max_von_mises"), mean = number(item, "mean_von_mises");
        assert_true(fabs(m.stress_max - max) <= tolerance * max && want[m.stress_element] == max);
        assert_true(fabs(m.stress_mean - mean) <= tolerance * mean);
        assert_true(fabs(m.volume_max - number(item, "max_abs_volume_change")) <= tolerance * m.volume_max);
        assert_true(fabs(m.volume_mean - fabs(number(item, "mean_volume_change"))) <=
                    tolerance * m.volume_mean);
        assert_true(fabs(m.energy - number(item, "body_energy")) <= tolerance * m.energy);
        array(item, "seed_volume_change_per_element", want);
        assert_true(fabs(m.volume_max - fabs(want[m.volume_element])) <= tolerance * m.volume_max);
        free(want), free(got);
        teardown(&s);
    }
    cn_tets_free(mesh);
    json_decref(json);
}

/* At F X nothing pulls at inner nodes. Where that equilibrium is stable (strong compression near
 * incompressibility is not), inner nodes put elsewhere come back to it by Newton's method. */
static void an_affine_field_is_an_equilibrium(void **state)
{
    (void)state;
    json_t *json = read_json("data/patch_test.json");
    cn_tets *mesh = reference_mesh("patch");
    if (!json || !mesh) {
        json_decref(json), cn_tets_free(mesh);
        skip();
    }
    const json_t *cases = json_object_get(json, "cases");
    unsigned char *fixed = calloc((size_t)mesh->nnode, 1);
    double *list = numbers(mesh->nnode);
    assert_non_null(fixed);
    for (int n = array(json, "boundary_nodes", list), i = 0; i < n; i++)
        fixed[(int)list[i]] = 1;
    for (size_t c = 0; c < json_array_size(cases); c++) {
        const json_t *item = json_array_get(cases, c);
        const double nu = number(item, "nu");
        fixture s = setup(mesh, number(item, "E"), nu);
        cn_solver *solver;
        double f[9], p[9], r[9], worst = 0, *dx = numbers(3 * mesh->nnode);
        unsigned seed = 5;
        array(item, "F", f), array(item, "corotational_first_piola", p);
        const double size = largest(mesh->node, 3 * mesh->nnode);
        for (int i = 0; i < mesh->nnode; i++)
            cn_mat_vec(f, mesh->node + 3 * i, s.x + 3 * i);
        assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
        force(&s, CN_TANGENT_EXACT, s.scatter);
        for (int i = 0; i < mesh->nnode; i++)
            if (!fixed[i]) worst = fmax(worst, largest(s.f + 3 * i, 3));
        assert_true(worst <= 1e-14 * largest(s.matrix->value, 9 * s.matrix->nblock) * size);
        const bool stable = cn_solver_factor(solver, s.matrix, s.body->nnode, fixed, NULL) == CN_OK;
        for (int i = 0; i < mesh->nnode; i++)
            for (int k = 0; stable && !fixed[i] && k < 3; k++)
                s.x[3 * i + k] += 0.01 * size * shape_random(&seed);
        for (int pass = 0; stable && pass < 20; pass++) { /* the exact tangent where it is positive */
            force(&s, CN_TANGENT_EXACT, s.scatter);
            if (pass < 3 || cn_solver_factor(solver, s.matrix, s.body->nnode, fixed, NULL) != CN_OK) {
                force(&s, CN_TANGENT_PROJECTED, s.scatter);
                assert_int_equal(cn_solver_factor(solver, s.matrix, s.body->nnode, fixed, NULL), CN_OK);
            }
            assert_int_equal(cn_solver_solve(solver, s.f, dx, 1e-14, 1, NULL, NULL, NULL), CN_OK);
            for (int i = 0; i < 3 * mesh->nnode; i++)
                s.x[i] += dx[i];
        }
        worst = 0;
        for (int i = 0; i < mesh->nnode; i++) {
            double want[3];
            cn_mat_vec(f, mesh->node + 3 * i, want);
            worst = fmax(worst, cn_distance(want, s.x + 3 * i));
        }
        assert_true(worst <= 1e-10 * size);

        /* stress of each element as the closed form's; energy of the whole */
        double strain = 0, one[9], frame[9], q[4], want_stress, piola2 = 0;
        cn_measures m;
        cn_polar(f, q);
        cn_quaternion_matrix(q, r);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                frame[3 * i + j] = r[i] * p[j] + r[3 + i] * p[3 + j] + r[6 + i] * p[6 + j];
        const double mean = (frame[0] + frame[4] + frame[8]) / 3;
        for (int i = 0; i < 9; i++) {
            one[i] = frame[i] - (i % 4 == 0 ? mean : 0);
            piola2 += one[i] * one[i];
            strain = fmax(strain, fabs(f[i] - r[i]));
        }
        want_stress = sqrt(1.5 * piola2);
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
        const double scale = largest(p, 9), rounding = 64 * DBL_EPSILON / strain; /* of F itself */
        const double tolerance = (nu > 0.499 ? 1e-7 : 1e-9) + rounding;
        assert_true(fabs(m.stress_max - want_stress) <= tolerance * scale);
        assert_true(fabs(m.stress_mean - want_stress) <= tolerance * scale);
        const double energy = number(item, "corotational_energy");
        assert_true(fabs(m.energy - energy) <= (1e-10 + rounding) * energy);
        assert_true(fabs(m.volume / s.body->rest_volume - number(item, "volume_ratio")) <= 1e-12);
        cn_solver_free(solver);
        free(dx);
        teardown(&s);
    }
    free(fixed), free(list);
    cn_tets_free(mesh);
    json_decref(json);
}

static void rigid_motions_make_no_force(void **state)
{
    (void)state;
    char line[1024];
    FILE *file = reference_open("data/rigid_motions.csv");
    cn_tets *mesh = reference_mesh("rotation");
    if (!file || !mesh) {
        if (file) fclose(file);
        cn_tets_free(mesh);
        skip();
    }
    const double material[3][2] = {{1e5, 0.3}, {8.7e6, 0.45}, {2e11, 0.4999}};
    for (int k = 0; k < 3; k++) {
        fixture s = setup(mesh, material[k][0], material[k][1]);
        const double modulus = s.body->mu[0] + s.body->lambda[0];
        rewind(file);
        assert_non_null(fgets(line, sizeof line, file));
        while (fgets(line, sizeof line, file)) {
            double v[12];
            char *at = strchr(line, ',');
            cn_measures m;
            for (int i = 0; i < 12; i++)
                v[i] = strtod(at + 1, &at);
            for (int i = 0; i < mesh->nnode; i++) {
                cn_mat_vec(v, mesh->node + 3 * i, s.x + 3 * i);
                cn_add(s.x + 3 * i, v + 9, s.x + 3 * i);
            }
            const double size = largest(s.x, 3 * mesh->nnode), limit = 200 * modulus * DBL_EPSILON * size;
            assert_true(force(&s, CN_TANGENT_EXACT, NULL) <= 1e-24 * modulus * size * size);
            assert_true(largest(s.f, 3 * mesh->nnode) <= limit);
            cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
            assert_true(m.stress_max <= limit);
        }
        teardown(&s);
    }
    fclose(file);
    cn_tets_free(mesh);
}

/* One damped Newton step of the projected tangent, mass-regularised by step^2; halves until the energy falls.
 * Returns the new energy. */
static double descend(fixture *s, cn_solver *solver, double *dx, double *from, double *step2)
{
    const int n = 3 * s->body->nnode;
    const double energy = force(s, CN_TANGENT_PROJECTED, s->scatter);
    double slope = 0, length = 1, now;
    for (int i = 0; i < s->body->nnode; i++)
        for (int k = 0; k < 3; k++)
            s->matrix->value[9 * s->matrix->diagonal[i] + 4 * k] += s->body->mass[i] / *step2;
    assert_int_equal(cn_solver_factor(solver, s->matrix, s->body->nnode, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_solve(solver, s->f, dx, 1e-9, 1, NULL, NULL, NULL), CN_OK);
    memcpy(from, s->x, (size_t)n * sizeof *from);
    for (int i = 0; i < n; i++)
        slope -= s->f[i] * dx[i];
    for (;; length /= 2) {
        for (int i = 0; i < n; i++)
            s->x[i] = from[i] + length * dx[i];
        now = cn_body_energy(s->body, s->body->nnode, s->x, s->rotation, NULL);
        assert_true(isfinite(now));
        if (now <= energy + 1e-4 * length * slope || length < 1e-8) break;
    }
    assert_true(now <= energy * (1 + 1e-14) + 1e-25 * s->body->mu[0]);
    *step2 = length == 1 ? fmin(2 * *step2, 1e6 / s->body->mu[0]) : 0.7 * *step2;
    return now;
}

static void scrambled_and_reflected_bodies_come_back(void **state)
{
    (void)state;
    json_t *json = read_json("data/scramble.json");
    if (!json) skip();
    const json_t *cases = json_object_get(json, "cases");
    for (size_t c = 0; c < json_array_size(cases); c++) {
        const json_t *item = json_array_get(cases, c);
        cn_tets *mesh = reference_mesh(json_string_value(json_object_get(item, "mesh")));
        assert_non_null(mesh);
        fixture s = setup(mesh, number(item, "E"), number(item, "nu"));
        double *dx = numbers(3 * mesh->nnode), *from = numbers(3 * mesh->nnode), step2 = 10 / s.body->mu[0];
        cn_solver *solver;
        cn_measures m;
        unsigned seed = 1;
        assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
        array(item, "start_positions", s.x);
        const double start = cn_body_energy(s.body, mesh->nnode, s.x, s.rotation, NULL);
        assert_true(fabs(start - number(item, "start_energy")) <= 1e-7 * start);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            s.x[i] += 1e-9 * shape_random(&seed); /* off the exactly degenerate ones */
        double energy = start;
        for (int k = 0; k < 500 && energy > 1e-12 * start; k++)
            energy = descend(&s, solver, dx, from, &step2);
        cn_body_measure(s.body, mesh->nnode, s.x, s.rotation, false, &m, NULL, NULL);
        if (json_is_true(json_object_get(item, "recovered_by_reference_method")))
            assert_true(energy < 1e-10 * start && m.inverted == 0);
        cn_solver_free(solver);
        free(dx), free(from);
        teardown(&s);
        cn_tets_free(mesh);
    }
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stress_energy_and_tangent_of_single_gradients),
        cmocka_unit_test(measures_of_a_bent_and_turned_body),
        cmocka_unit_test(an_affine_field_is_an_equilibrium),
        cmocka_unit_test(rigid_motions_make_no_force),
        cmocka_unit_test(scrambled_and_reflected_bodies_come_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
