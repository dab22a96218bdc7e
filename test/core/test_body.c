#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_element.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "shapes.h"

static const cn_material rubber = {.young = 1e5, .poisson = 0.3, .density = 1000};

/* A body with a state and a matrix of its own. */
typedef struct {
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    double *x, *rotation, *f;
} fixture;

static double *numbers(int n)
{
    double *a = calloc((size_t)n, sizeof *a);
    assert_non_null(a);
    return a;
}

static fixture setup(cn_tets *mesh, const cn_material *material)
{
    fixture s;
    const int first = 0;
    assert_int_equal(cn_body_new(&s.body, mesh, material, NULL, NULL), CN_OK);
    cn_tets_free(mesh);
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    s.x = numbers(3 * s.body->nnode), s.f = numbers(3 * s.body->nnode),
    s.rotation = numbers(4 * s.body->ntet);
    memcpy(s.x, s.body->rest, 3 * (size_t)s.body->nnode * sizeof *s.x);
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

/* x = R (scale X + bent) + random of size `shake`; R by the seed. */
static void deform(fixture *s, unsigned seed, double shake)
{
    double r[9], p[3];
    shape_rotation(&seed, r);
    for (int i = 0; i < s->body->nnode; i++) {
        for (int k = 0; k < 3; k++)
            p[k] = s->body->rest[3 * i + k] + shake * shape_random(&seed);
        cn_mat_vec(r, p, s->x + 3 * i);
    }
}

static double force(fixture *s, cn_tangent tangent, const cn_scatter *scatter, cn_pool *pool)
{
    memset(s->f, 0, 3 * (size_t)s->body->nnode * sizeof *s->f);
    cn_matrix_clear(s->matrix, s->matrix->n);
    return cn_body_add_elastic(s->body, s->body->nnode, s->x, s->rotation, s->f, tangent, 1, scatter, pool);
}

static double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

static void a_turned_body_stores_nothing_and_pulls_at_nothing(void **state)
{
    (void)state;
    fixture s = setup(shape_box(3, 2, 2, 0.1), &rubber);
    for (unsigned seed = 1; seed < 30; seed++) {
        deform(&s, seed, 0);
        assert_true(force(&s, CN_TANGENT_EXACT, NULL, NULL) < 1e-28 * 1e5);
        assert_true(largest(s.f, 3 * s.body->nnode) < 1e5 * 0.1 * 0.3 * 100 * DBL_EPSILON); /* E h |x| eps */
    }
    teardown(&s);
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
    const double h = 1e-7; /* [m] */
    deform(&s, 3, 0.02);
    force(&s, CN_TANGENT_EXACT, NULL, NULL);
    const double scale = largest(s.f, 3 * s.body->nnode);
    for (int i = 0; i < 3 * s.body->nnode; i++) {
        const double xi = s.x[i];
        s.x[i] = xi + h;
        const double up = cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL);
        s.x[i] = xi - h;
        const double down = cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL);
        s.x[i] = xi;
        assert_true(fabs(s.f[i] + (up - down) / (2 * h)) < 1e-7 * scale);
    }
    teardown(&s);
}

/* Columns of K against sixth-order differences of the force, for a shake that leaves some elements inverted
 * too: there the rotation turns fast, so the step is short. */
static void exact_stiffness_is_minus_the_force_gradient(void **state)
{
    (void)state;
    static const double weight[7] = {-1, 9, -45, 0, 45, -9, 1};
    for (int hard = 0; hard < 2; hard++) {
        fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
        const int n = 3 * s.body->nnode;
        double *slope = numbers(n), *unit = numbers(n), *column = numbers(n);
        const double h = 1e-6; /* [m] */
        double scale = 0, worst = 0;
        deform(&s, 5, hard ? 0.05 : 0.02);
        force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        scale = largest(s.matrix->value, 9 * s.matrix->nblock);
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i];
            unit[i] = 1;
            cn_matrix_multiply(s.matrix, s.matrix->n, unit, column, NULL);
            unit[i] = 0;
            memset(slope, 0, (size_t)n * sizeof *slope);
            for (int l = 0; l < 7; l++) {
                s.x[i] = xi + (l - 3) * h;
                memset(s.f, 0, (size_t)n * sizeof *s.f);
                cn_body_add_elastic(s.body, s.body->nnode, s.x, s.rotation, s.f, CN_TANGENT_EXACT, 1, NULL,
                                    NULL);
                for (int k = 0; k < n; k++)
                    slope[k] += weight[l] / (60 * h) * s.f[k];
            }
            s.x[i] = xi;
            for (int k = 0; k < n; k++)
                worst = fmax(worst, fabs(column[k] + slope[k]));
        }
        print_message("tangent%s: off by %.1e of the largest entry\n", hard ? ", some inverted" : "",
                      worst / scale);
        assert_true(worst < 1e-6 * scale);
        free(slope), free(unit), free(column);
        teardown(&s);
    }
}

static double quadratic_form(fixture *s, const double *v, double *kv)
{
    double sum = 0;
    cn_matrix_multiply(s->matrix, s->matrix->n, v, kv, NULL);
    for (int i = 0; i < 3 * s->body->nnode; i++)
        sum += v[i] * kv[i];
    return sum;
}

/* One element, so that nothing can be hidden by a neighbour: v'Kv over many v, and the translations. */
static void projected_and_warped_stiffness_never_pull_back(void **state)
{
    (void)state;
    for (unsigned seed = 1; seed < 200; seed++)
        for (int tangent = CN_TANGENT_WARPED; tangent <= CN_TANGENT_PROJECTED; tangent++) {
            fixture s = setup(shape_tet(0.1), &rubber);
            unsigned draw = seed;
            double v[12], kv[12], exact;
            deform(&s, seed, 0.05 * (seed % 4));
            force(&s, (cn_tangent)tangent, s.scatter, NULL);
            const double scale = largest(s.matrix->value, 9 * s.matrix->nblock);
            for (int trial = 0; trial < 100; trial++) {
                for (int i = 0; i < 12; i++)
                    v[i] = shape_random(&draw);
                exact = quadratic_form(&s, v, kv);
                if (tangent != CN_TANGENT_EXACT) assert_true(exact > -1e-13 * scale);
            }
            for (int i = 0; i < 12; i++)
                v[i] = 1 + i % 3;
            quadratic_form(&s, v, kv);
            assert_true(largest(kv, 12) < 1e-13 * scale);
            teardown(&s);
        }
}

static void at_rest_all_three_tangents_are_linear_elasticity(void **state)
{
    (void)state;
    fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
    const int n = 9 * s.matrix->nblock;
    double *warped = numbers(n);
    force(&s, CN_TANGENT_WARPED, s.scatter, NULL);
    memcpy(warped, s.matrix->value, (size_t)n * sizeof *warped);
    for (int tangent = CN_TANGENT_EXACT; tangent <= CN_TANGENT_PROJECTED; tangent++) {
        force(&s, (cn_tangent)tangent, s.scatter, NULL);
        for (int i = 0; i < n; i++)
            assert_true(fabs(warped[i] - s.matrix->value[i]) < 1e-13 * largest(warped, n));
    }
    free(warped);
    teardown(&s);
}

static void a_collapsed_or_reflected_element_has_finite_forces_and_stiffness(void **state)
{
    (void)state;
    const double squash[] = {0, 1e-300, 1e-12, -1e-12, -1, -2, 1};
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            for (int k = 0; k < 7; k++)
                for (int tangent = CN_TANGENT_WARPED; tangent <= CN_TANGENT_PROJECTED; tangent++) {
                    fixture s = setup(shape_tet(0.1), &rubber);
                    s.x[3] *= squash[i], s.x[7] *= squash[j], s.x[11] *= squash[k];
                    assert_true(isfinite(force(&s, (cn_tangent)tangent, s.scatter, NULL)));
                    for (int c = 0; c < 12; c++)
                        assert_true(isfinite(s.f[c]));
                    for (int c = 0; c < 9 * s.matrix->nblock; c++)
                        assert_true(isfinite(s.matrix->value[c]));
                    teardown(&s);
                }
}

/* Lengths times 1000^k: energy scales with volume, force with area, stiffness with length; the rest is the
 * same. */
static void metres_millimetres_and_micrometres_give_the_same(void **state)
{
    (void)state;
    double energy = 0, top = 0, stiff = 0, stress = 0;
    for (int k = 0; k < 3; k++) {
        const double unit = pow(1000, k);
        fixture s = setup(shape_box(2, 2, 2, 1e-3 * unit), &rubber);
        cn_measures m;
        deform(&s, 8, 2e-4 * unit);
        const double e = force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL) / (unit * unit * unit);
        const double f = largest(s.f, 3 * s.body->nnode) / (unit * unit);
        const double v = largest(s.matrix->value, 9 * s.matrix->nblock) / unit;
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
        if (k > 0) {
            assert_true(fabs(e / energy - 1) < 1e-12 && fabs(f / top - 1) < 1e-12);
            assert_true(fabs(v / stiff - 1) < 1e-12 && fabs(m.stress_max / stress - 1) < 1e-12);
        }
        energy = e, top = f, stiff = v, stress = m.stress_max;
        teardown(&s);
    }
}

/* Enough elements for many chunks; energies, forces, blocks, rotations and measures bit for bit. */
static void threads_change_no_bit(void **state)
{
    (void)state;
    fixture a = setup(shape_box(9, 9, 9, 0.1), &rubber), b = setup(shape_box(9, 9, 9, 0.1), &rubber);
    cn_pool *pool;
    cn_measures m, n;
    const size_t ndof = 3 * (size_t)a.body->nnode, ntet = (size_t)a.body->ntet;
    double *stress = numbers(2 * a.body->ntet);
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    assert_true(a.body->element->ncolour > 1 && a.body->element->nchunk > 8);
    for (unsigned seed = 1; seed < 5; seed++) {
        deform(&a, seed, 0.03);
        deform(&b, seed, 0.03);
        const double e = force(&a, CN_TANGENT_EXACT, a.scatter, NULL);
        assert_true(e == force(&b, CN_TANGENT_EXACT, b.scatter, pool));
        assert_memory_equal(a.f, b.f, ndof * sizeof *a.f);
        assert_memory_equal(a.rotation, b.rotation, 4 * ntet * sizeof *a.rotation);
        assert_memory_equal(a.matrix->value, b.matrix->value, 9 * (size_t)a.matrix->nblock * sizeof *a.x);
        cn_body_measure(a.body, a.body->nnode, a.x, a.rotation, true, &m, stress, NULL);
        cn_body_measure(b.body, b.body->nnode, b.x, b.rotation, true, &n, stress + ntet, pool);
        assert_memory_equal(stress, stress + ntet, ntet * sizeof *stress);
        assert_true(m.stress_max == n.stress_max && m.stress_element == n.stress_element &&
                    m.volume == n.volume);
        assert_true(m.energy == n.energy && m.volume_mean == n.volume_mean && m.inverted == n.inverted);
    }
    cn_pool_free(pool);
    free(stress);
    teardown(&a);
    teardown(&b);
}

static void instruction_sets_agree_to_rounding(void **state)
{
    (void)state;
    fixture a = setup(shape_box(3, 3, 3, 0.1), &rubber), b = setup(shape_box(3, 3, 3, 0.1), &rubber);
    for (int set = 0; set < 3; set++) {
        b.body->element->kernels = cn_kernels_pick(set);
        deform(&a, 4, 0.04);
        deform(&b, 4, 0.04);
        const double e = force(&a, CN_TANGENT_PROJECTED, a.scatter, NULL);
        assert_true(fabs(force(&b, CN_TANGENT_PROJECTED, b.scatter, NULL) - e) < 1e-13 * e);
        for (int i = 0; i < 9 * a.matrix->nblock; i++)
            assert_true(fabs(a.matrix->value[i] - b.matrix->value[i]) <
                        1e-11 * largest(a.matrix->value, 9 * a.matrix->nblock));
    }
    teardown(&a);
    teardown(&b);
}

/* Whatever rotation the iteration starts from, half turns and nonsense among them. */
static void the_warm_start_does_not_show(void **state)
{
    (void)state;
    fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
    const int n = 3 * s.body->nnode;
    double *want = numbers(n);
    unsigned seed = 12;
    deform(&s, 6, 0.03);
    cn_body_rotation_start(s.body, s.rotation);
    const double energy = force(&s, CN_TANGENT_EXACT, NULL, NULL);
    memcpy(want, s.f, (size_t)n * sizeof *want);
    for (int trial = 0; trial < 50; trial++) {
        for (int i = 0; i < 4 * s.body->ntet; i++)
            s.rotation[i] = trial == 0 ? 0 : trial == 1 ? NAN : shape_random(&seed);
        assert_true(fabs(force(&s, CN_TANGENT_EXACT, NULL, NULL) - energy) < 1e-13 * energy);
        for (int i = 0; i < n; i++)
            assert_true(fabs(s.f[i] - want[i]) < 1e-12 * largest(want, n));
        for (int i = 0; i < s.body->ntet; i++) {
            const double *q = s.rotation + 4 * i;
            assert_true(fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1) < 1e-15 * 8);
        }
    }
    free(want);
    teardown(&s);
}

/* The active part acts as a body of its own: same forces, and the rest is not read or written. */
static void inactive_elements_take_no_part(void **state)
{
    (void)state;
    fixture s = setup(shape_chain(40, 6, 0.1, 0.2), &rubber),
            part = setup(shape_chain(15, 6, 0.1, 0.2), &rubber);
    const int nactive = part.body->nnode;
    cn_measures m;
    double *stress = numbers(s.body->ntet);
    deform(&s, 2, 0.02);
    memcpy(part.x, s.x, 3 * (size_t)nactive * sizeof *s.x);
    for (int i = 3 * nactive; i < 3 * s.body->nnode; i++)
        s.x[i] = NAN;
    const double want = force(&part, CN_TANGENT_EXACT, part.scatter, NULL);
    memset(s.f, 0, 3 * (size_t)s.body->nnode * sizeof *s.f);
    cn_matrix_clear(s.matrix, s.matrix->n);
    const double got =
        cn_body_add_elastic(s.body, nactive, s.x, s.rotation, s.f, CN_TANGENT_EXACT, 1, s.scatter, NULL);
    assert_true(fabs(got - want) < 1e-13 * want);
    assert_true(fabs(cn_body_energy(s.body, nactive, s.x, s.rotation, NULL) - want) < 1e-13 * want);
    for (int i = 0; i < 3 * s.body->nnode; i++)
        assert_true(fabs(s.f[i] - (i < 3 * nactive ? part.f[i] : 0)) < 1e-13 * largest(part.f, 3 * nactive));
    for (int k = 0; k < s.matrix->row[s.matrix->n]; k++)
        if (s.matrix->col[k] >= nactive) assert_true(largest(s.matrix->value + 9 * k, 9) == 0);
    cn_body_measure(s.body, nactive, s.x, s.rotation, true, &m, stress, NULL);
    assert_true(fabs(m.energy - want) < 1e-13 * want);
    assert_true(isfinite(m.volume) && m.volume > 0 && isfinite(m.stress_max));
    assert_true(stress[s.body->ntet - 1] == 0);
    assert_true(cn_body_energy(s.body, 0, s.x, s.rotation, NULL) == 0);
    cn_body_measure(s.body, 0, s.x, s.rotation, true, &m, NULL, NULL);
    assert_true(m.volume_max == 0 && m.stress_max == 0 && m.volume == s.body->rest_volume);
    free(stress);
    teardown(&s);
    teardown(&part);
}

static void what_is_not_a_number_comes_out_as_such(void **state)
{
    (void)state;
    fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
    const double bad[] = {NAN, INFINITY, -INFINITY, 1e300};
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3 * s.body->nnode; i++) {
            cn_measures m;
            const double xi = s.x[i];
            s.x[i] = bad[k];
            assert_false(isfinite(cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL)));
            assert_false(isfinite(force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL)));
            cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
            assert_false(m.volume_max <= 0.5);
            assert_false(m.stress_max <= 1e9);
            assert_false(isfinite(m.energy));
            s.x[i] = xi;
        }
    assert_true(cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL) < 1e-25); /* and it recovers */
    teardown(&s);
}

/* Uniform stretch s of a cube: V/V0 = s^3, no shear, energy (9/2 K) (s - 1)^2 V with K the bulk modulus. */
static void a_blown_up_cube_measures_as_by_hand(void **state)
{
    (void)state;
    fixture s = setup(shape_box(2, 2, 2, 0.1), &rubber);
    const double stretch = 1.1, bulk = 1e5 / (3 * (1 - 0.6)), volume = 0.008;
    cn_measures m;
    for (int i = 0; i < 3 * s.body->nnode; i++)
        s.x[i] *= stretch;
    cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
    assert_true(fabs(m.volume_max - 0.331) < 1e-13 && fabs(m.volume_mean - 0.331) < 1e-13);
    assert_true(fabs(m.volume - 1.331 * volume) < 1e-15);
    assert_true(m.stress_max < 1e-6 && m.inverted == 0); /* [Pa]: rounding of 1e5 */
    assert_true(fabs(m.energy - 4.5 * bulk * 0.01 * volume) < 1e-11);
    for (int i = 0; i < s.body->nnode; i++)
        s.x[3 * i] = -s.x[3 * i];
    cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, false, &m, NULL, NULL);
    assert_int_equal(m.inverted, s.body->ntet);
    assert_true(fabs(m.volume + 1.331 * volume) < 1e-15 && m.stress_max == 0);
    teardown(&s);
}

static void masses_sum_to_density_times_volume(void **state)
{
    (void)state;
    fixture s = setup(shape_box(3, 2, 1, 0.1), &rubber);
    double mass = 0;
    for (int i = 0; i < s.body->nnode; i++)
        mass += s.body->mass[i];
    assert_true(fabs(mass - 6) < 1e-14 && fabs(s.body->rest_volume - 0.006) < 1e-17);
    assert_int_equal(s.body->boundary->ntri, 2 * 2 * (6 + 3 + 2));
    teardown(&s);
}

static void regions_have_their_own_modulus(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    cn_region region[2] = {{.by_box = true, .box = {{0, 0, 0}, {0.1, 0.1, 0.1}}, .young = 5},
                           {.along = {3, 4}, .young = 7}};
    cn_material m = rubber;
    double along[12] = {0};
    cn_body *body;
    m.poisson = 0, m.nregion = 2, m.region = region, along[11] = 3.5;
    assert_int_equal(cn_body_new(&body, mesh, &m, NULL, NULL), CN_ERR_ARG);
    assert_int_equal(cn_body_new(&body, mesh, &m, along, NULL), CN_OK);
    for (int e = 0; e < 12; e++)
        assert_true(body->mu[e] == (e < 6 ? 2.5 : e == 11 ? 3.5 : 5e4));
    cn_body_free(body);
    cn_tets_free(mesh);
}

static void values_out_of_range_are_refused_and_named(void **state)
{
    (void)state;
    cn_tets *mesh = shape_tet(1);
    const struct {
        cn_material material;
        const char *named;
    } bad[] = {{{.young = 0, .poisson = 0.3}, "Young"},
               {{.young = -1, .poisson = 0.3}, "-1"},
               {{.young = NAN, .poisson = 0.3}, "nan"},
               {{.young = INFINITY, .poisson = 0.3}, "inf"},
               {{.young = 1, .poisson = 0.5}, "0.5"},
               {{.young = 1, .poisson = -1}, "-1"},
               {{.young = 1, .poisson = NAN}, "nan"},
               {{.young = 1, .poisson = 0.6}, "0.6"},
               {{.young = 1, .poisson = 0.3, .density = -2}, "-2"},
               {{.young = 1, .poisson = 0.3, .density = NAN}, "nan"},
               {{.young = 1, .poisson = 0.3, .damping = NAN}, "nan"},
               {{.young = 1, .poisson = 0.3, .damping_stiffness = -3}, "-3"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        cn_error error = {0};
        cn_body *body = (cn_body *)1;
        assert_int_equal(cn_body_new(&body, mesh, &bad[i].material, NULL, &error), CN_ERR_ARG);
        assert_null(body);
        assert_int_equal(error.status, CN_ERR_ARG);
        assert_non_null(strstr(error.message, bad[i].named));
    }
    cn_tets_free(mesh);
}

static void extreme_but_legal_materials_are_taken(void **state)
{
    (void)state;
    const double poisson[] = {-0.999, 0, 0.4999, 0.4999999}, young[] = {1e-3, 2e11};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 2; k++) {
            const cn_material m = {.young = young[k], .poisson = poisson[i]};
            fixture s = setup(shape_box(1, 1, 1, 0.1), &m);
            deform(&s, 3, 0.02);
            assert_true(isfinite(force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL)));
            teardown(&s);
        }
}

static void meshes_without_sense_are_refused(void **state)
{
    (void)state;
    cn_error error = {0};
    cn_body *body;
    cn_tets *mesh = shape_box(1, 1, 1, 1);
    double *x = mesh->node;
    int *last = mesh->tet + 4 * 5;
    const int kept[4] = {last[0], last[1], last[2], last[3]};
    const double corner = x[0];

    last[2] = 8;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "tetrahedron 5"));
    last[2] = -1;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    last[2] = kept[3], last[3] = kept[2]; /* negative volume */
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    last[2] = kept[1], last[3] = kept[3]; /* no volume */
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    last[2] = kept[2];
    x[0] = NAN;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    x[0] = corner;
    const int ntet = mesh->ntet;
    mesh->ntet = 0;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    mesh->ntet = ntet;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_OK);
    cn_body_free(body);
    cn_body_free(NULL);
    cn_tets_free(mesh);
}

/* A thin tetrahedron beside one of volume 1/6: taken at 3e-14 of the mean, refused at 3e-15, in any unit. */
static void a_sliver_counts_by_its_share_of_the_mean(void **state)
{
    (void)state;
    const double height[] = {3e-14, 3e-15}, unit[] = {1, 1e-3, 1e-6};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            double node[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0.5, 0, 0};
            int tet[8] = {0, 1, 2, 3, 0, 2, 1, 4};
            node[12] = node[13] = 0.2, node[14] = -height[i] / 2; /* mean about half: a ratio of `height` */
            cn_tets mesh = {5, 2, node, tet, NULL};
            cn_body *body;
            for (int n = 0; n < 18; n++)
                node[n] *= unit[k];
            assert_int_equal(cn_body_new(&body, &mesh, &rubber, NULL, NULL), i ? CN_ERR_MESH : CN_OK);
            cn_body_free(body);
        }
}

static void a_matrix_without_the_blocks_is_refused(void **state)
{
    (void)state;
    fixture small = setup(shape_tet(0.1), &rubber), large = setup(shape_box(2, 2, 2, 0.1), &rubber);
    cn_scatter *scatter;
    assert_int_equal(cn_body_bind(&scatter, large.body, small.matrix, 0), CN_ERR_ARG);
    assert_null(scatter);
    assert_int_equal(cn_body_bind(&scatter, small.body, small.matrix, 1), CN_ERR_ARG);
    assert_int_equal(cn_body_bind(&scatter, small.body, small.matrix, -1), CN_ERR_ARG);
    teardown(&small);
    teardown(&large);
}

/* Two bodies in one matrix: each writes its own blocks. */
static void a_second_body_lies_behind_the_first(void **state)
{
    (void)state;
    fixture a = setup(shape_tet(0.1), &rubber), b = setup(shape_box(1, 1, 1, 0.1), &rubber);
    const cn_body *both[2] = {a.body, b.body};
    const int first[2] = {0, a.body->nnode};
    cn_matrix *matrix;
    cn_scatter *scatter;
    assert_int_equal(cn_matrix_new(&matrix, 2, both, first), CN_OK);
    assert_int_equal(cn_body_bind(&scatter, b.body, matrix, first[1]), CN_OK);
    cn_matrix_clear(matrix, matrix->n);
    deform(&b, 5, 0.02);
    force(&b, CN_TANGENT_EXACT, b.scatter, NULL);
    cn_body_add_elastic(b.body, b.body->nnode, b.x, b.rotation, b.f, CN_TANGENT_EXACT, 2, scatter, NULL);
    for (int i = 0; i < b.matrix->n; i++)
        for (int k = b.matrix->row[i]; k < b.matrix->row[i + 1]; k++) {
            const int at = cn_matrix_find(matrix, first[1] + i, first[1] + b.matrix->col[k]);
            for (int c = 0; c < 9; c++)
                assert_true(fabs(matrix->value[9 * at + c] - 2 * b.matrix->value[9 * k + c]) <
                            1e-13 * largest(b.matrix->value, 9 * b.matrix->nblock));
        }
    assert_true(largest(matrix->value, 9 * matrix->row[first[1]]) == 0);
    cn_scatter_free(scatter);
    cn_matrix_free(matrix);
    teardown(&a);
    teardown(&b);
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 1);
    fixture s = setup(shape_box(2, 2, 2, 1), &rubber);
    for (FAIL_EACH_ALLOC) {
        cn_error error = {0};
        cn_body *body;
        const cn_status status = cn_body_new(&body, mesh, &rubber, NULL, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_int_equal(error.status, status);
        assert_true((body != NULL) == (status == CN_OK));
        cn_body_free(body);
    }
    for (FAIL_EACH_ALLOC) {
        cn_scatter *scatter;
        const cn_status status = cn_body_bind(&scatter, s.body, s.matrix, 0);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        cn_scatter_free(scatter);
    }
    fail_alloc_at(-1);
    force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL);
    assert_int_equal(fail_alloc_count(), 0); /* assembly allocates nothing */
    teardown(&s);
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_turned_body_stores_nothing_and_pulls_at_nothing),
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(exact_stiffness_is_minus_the_force_gradient),
        cmocka_unit_test(projected_and_warped_stiffness_never_pull_back),
        cmocka_unit_test(at_rest_all_three_tangents_are_linear_elasticity),
        cmocka_unit_test(a_collapsed_or_reflected_element_has_finite_forces_and_stiffness),
        cmocka_unit_test(metres_millimetres_and_micrometres_give_the_same),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(instruction_sets_agree_to_rounding),
        cmocka_unit_test(the_warm_start_does_not_show),
        cmocka_unit_test(inactive_elements_take_no_part),
        cmocka_unit_test(what_is_not_a_number_comes_out_as_such),
        cmocka_unit_test(a_blown_up_cube_measures_as_by_hand),
        cmocka_unit_test(masses_sum_to_density_times_volume),
        cmocka_unit_test(regions_have_their_own_modulus),
        cmocka_unit_test(values_out_of_range_are_refused_and_named),
        cmocka_unit_test(extreme_but_legal_materials_are_taken),
        cmocka_unit_test(meshes_without_sense_are_refused),
        cmocka_unit_test(a_sliver_counts_by_its_share_of_the_mean),
        cmocka_unit_test(a_matrix_without_the_blocks_is_refused),
        cmocka_unit_test(a_second_body_lies_behind_the_first),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
