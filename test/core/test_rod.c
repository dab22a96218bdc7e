#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "polar.h"
#include "rod.h"
#include "rod_cases.h"
#include "rod_spin.h"
#include "shapes.h"

static double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

/* Places shaken by `shake` segments, rotation vectors of random size up to `turn`. */
static void disturb(rod_case *s, unsigned seed, double shake, double turn)
{
    const int n = s->body->nnode;
    for (int i = 0; i < 3 * n; i++)
        s->x[i] += shake * s->body->lever * shape_random(&seed);
    for (int i = 0; i < n; i++) {
        double *theta = s->x + 3 * (n + i);
        for (int k = 0; k < 3; k++)
            theta[k] = shape_random(&seed);
        cn_normalise(theta);
        const double size = turn * fabs(shape_random(&seed));
        for (int k = 0; k < 3; k++)
            theta[k] *= size;
    }
}

/* A bent, twisted rest shape with a section that differs by direction and segment. */
static rod_case crooked(int n, double size)
{
    double axis[3 * 200], normal[3] = {0.1, 1, 0.2};
    cn_section section[200];
    for (int i = 0; i < n; i++) {
        const double s = 0.3 * i;
        axis[3 * i] = size * cos(s), axis[3 * i + 1] = size * sin(s), axis[3 * i + 2] = size * 0.2 * s;
        section[i] = (cn_section){.axial = 50,
                                  .shear = {20, 14 + i % 3},
                                  .bending = {2 * size * size, (1 + 0.1 * (i % 5)) * size * size},
                                  .torsion = 1.5 * size * size,
                                  .line_mass = 1 / size,
                                  .line_inertia = {size, 2 * size, 3 * size},
                                  .area = 1e-2 * size * size,
                                  .half = {0.05 * size, 0.05 * size},
                                  .round = true,
                                  .young = 1e3,
                                  .poisson = 0.3};
    }
    return rod_case_new(n, axis, normal, section, NULL);
}

static double energy_at(rod_case *s)
{
    return cn_body_energy(s->body, s->body->nnode, s->x, s->rotation, NULL);
}

/* Sixth-order central difference of values at -3h .. 3h. */
static double difference(const double v[7], double h)
{
    return (45 * (v[4] - v[2]) - 9 * (v[5] - v[1]) + (v[6] - v[0])) / (60 * h);
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    for (int mode = 0; mode < 4; mode++) {
        rod_case s = crooked(mode == 3 ? 70 : 9, 1);
        disturb(&s, 7 + (unsigned)mode, mode == 2 ? 2 : 0.3, mode == 1 ? 2 : mode == 2 ? 6 : 0.5);
        const int n = 3 * s.body->nblock;
        const double e = rod_case_force(&s, CN_TANGENT_EXACT, NULL);
        assert_true(fabs(e - energy_at(&s)) <= 1e-14 * e);
        const double scale = largest(s.f, n), h = 2e-3;
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i];
            double v[7];
            for (int k = 0; k < 7; k++)
                s.x[i] = xi + (k - 3) * h, v[k] = energy_at(&s);
            s.x[i] = xi;
            if (!(fabs(difference(v, h) + s.f[i]) < 2e-9 * scale))
                fail_msg("mode %d: unknown %d: force %.15g, difference %.15g", mode, i, s.f[i],
                         -difference(v, h));
        }
        rod_case_free(&s);
    }
}

static void exact_tangent_is_the_derivative_of_the_force_and_symmetric(void **state)
{
    (void)state;
    for (int mode = 0; mode < 4; mode++) {
        rod_case s = crooked(mode == 3 ? 70 : 9, 1);
        disturb(&s, 7 + (unsigned)mode, mode == 2 ? 2 : 0.3, mode == 1 ? 2 : mode == 2 ? 6 : 0.5);
        const int n = 3 * s.body->nblock;
        double *k = calloc((size_t)n * (size_t)n, sizeof *k), *column = calloc(7 * (size_t)n, sizeof *column);
        assert_true(k && column);
        rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
        rod_case_dense(&s, k);
        const double scale = largest(k, n * n), h = 2e-3;
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i];
            for (int l = 0; l < 7; l++) {
                s.x[i] = xi + (l - 3) * h;
                rod_case_force(&s, CN_TANGENT_EXACT, NULL);
                memcpy(column + l * n, s.f, (size_t)n * sizeof *s.f);
            }
            s.x[i] = xi;
            for (int j = 0; j < n; j++) {
                double v[7];
                for (int l = 0; l < 7; l++)
                    v[l] = -column[l * n + j];
                assert_true(k[i * n + j] == k[j * n + i]);
                if (!(fabs(difference(v, h) - k[j * n + i]) < 3e-9 * scale))
                    fail_msg("mode %d: (%d, %d): %.15g, difference %.15g", mode, j, i, k[j * n + i],
                             difference(v, h));
            }
        }
        free(k), free(column);
        rod_case_free(&s);
    }
}

static void a_rigid_motion_costs_nothing_and_turns_the_forces(void **state)
{
    (void)state;
    unsigned seed = 3;
    for (int turn = 0; turn < 10; turn++) {
        rod_case rest = crooked(70, 1), bent = crooked(70, 1);
        const double c[3] = {shape_random(&seed), shape_random(&seed), shape_random(&seed)};
        double r[9], was[6 * 70 * 3], v[3];
        shape_rotation(&seed, r);
        cn_body_turn(rest.body, 70, rest.x, rest.rotation);
        rod_case_move(&rest, r, c);
        const double e = rod_case_force(&rest, CN_TANGENT_EXACT, NULL);
        assert_true(e < 1e-18 * 50 && largest(rest.f, 6 * 70) < 1e-9 * 50);

        disturb(&bent, seed, 0.2, 1);
        cn_body_turn(bent.body, 70, bent.x, bent.rotation);
        const double e0 = rod_case_force(&bent, CN_TANGENT_EXACT, NULL);
        memcpy(was, bent.f, sizeof(double) * 6 * 70);
        rod_case_move(&bent, r, c);
        assert_true(fabs(rod_case_force(&bent, CN_TANGENT_EXACT, NULL) - e0) < 1e-12 * e0);
        for (int i = 0; i < 140; i++) {
            cn_mat_vec(r, was + 3 * i, v);
            assert_true(cn_distance(v, bent.f + 3 * i) < 1e-11 * largest(was, 420));
        }
        rod_case_free(&rest), rod_case_free(&bent);
    }
}

static void inner_forces_and_moments_sum_to_nothing(void **state)
{
    (void)state;
    rod_case s = crooked(70, 1);
    double force[3] = {0}, moment[3] = {0};
    disturb(&s, 5, 0.3, 1);
    cn_body_turn(s.body, 70, s.x, s.rotation); /* where moments are those of space */
    rod_case_force(&s, CN_TANGENT_EXACT, NULL);
    const double scale = largest(s.f, 6 * 70);
    for (int i = 0; i < 70; i++) {
        double m[3];
        cn_cross(s.x + 3 * i, s.f + 3 * i, m);
        cn_add(force, s.f + 3 * i, force);
        cn_add(moment, m, moment);
        cn_add(moment, s.f + 3 * (70 + i), moment);
    }
    assert_true(cn_norm(force) < 1e-13 * scale && cn_norm(moment) < 1e-12 * scale);
    rod_case_free(&s);
}

/* The energy of one segment by another way: rotation matrices, the angle by atan2. */
static void energy_is_that_of_the_strains_by_rotation_matrices(void **state)
{
    (void)state;
    const cn_section section = {.axial = 7,
                                .shear = {3, 2},
                                .bending = {1.5, 0.8},
                                .torsion = 0.6,
                                .half = {0.1, 0.1},
                                .round = true,
                                .young = 1,
                                .poisson = 0.3};
    for (int k = 0; k < 50; k++) {
        rod_case s = rod_case_straight(1, 0.7, &section);
        double r[2][9], relative[9], axis[3], half[3], turn[9], mid[9], e[3], strain[6], sum = 0;
        disturb(&s, 100 + (unsigned)k, 0.4, 0.25);
        cn_body_turn(s.body, 2, s.x, s.rotation);
        for (int i = 0; i < 2; i++)
            cn_quaternion_matrix(s.rotation + 4 * i, r[i]);
        for (int i = 0; i < 9; i++) /* R_j R_i' */
            relative[i] = cn_dot(r[1] + 3 * (i / 3), r[0] + 3 * (i % 3));
        const double a[3] = {relative[7] - relative[5], relative[2] - relative[6], relative[3] - relative[1]};
        const double angle = atan2(cn_norm(a), relative[0] + relative[4] + relative[8] - 1);
        for (int i = 0; i < 3; i++)
            axis[i] = a[i] / cn_norm(a) * angle, half[i] = axis[i] / 2;
        cn_rotation(half, turn);
        cn_mat_mul(turn, r[0], mid);
        cn_sub(s.x + 3, s.x, e);
        for (int i = 0; i < 3; i++) {
            const double column[3] = {mid[i], mid[3 + i], mid[6 + i]};
            strain[i] = cn_dot(column, e) / 0.7 - (i == 2), strain[3 + i] = cn_dot(column, axis) / 0.7;
        }
        const double stiff[6] = {3, 2, 7, 1.5, 0.8, 0.6};
        for (int i = 0; i < 6; i++)
            sum += 0.35 * stiff[i] * strain[i] * strain[i];
        assert_true(fabs(energy_at(&s) - sum) < 2e-8 * sum); /* the series of the angle ends: 0.5 rad */
        rod_case_free(&s);
    }
}

static void projected_and_warped_tangents_are_positive_and_exact_at_rest(void **state)
{
    (void)state;
    enum { N = 9, M = 6 * N };
    static double exact[M * M], k[M * M];
    rod_case s = crooked(N, 1);
    rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    rod_case_dense(&s, exact);
    for (cn_tangent t = CN_TANGENT_WARPED; t <= CN_TANGENT_PROJECTED; t++) {
        rod_case_force(&s, t, s.scatter);
        rod_case_dense(&s, k);
        for (int i = 0; i < M * M; i++)
            assert_true(fabs(k[i] - exact[i]) < 1e-12 * largest(exact, M * M));
    }
    for (unsigned seed = 1; seed < 20; seed++) { /* a little more than it on the diagonal has a factor */
        memcpy(s.x, s.body->rest, 3 * N * sizeof *s.x);
        disturb(&s, seed, 2, 3);
        for (cn_tangent t = CN_TANGENT_WARPED; t <= CN_TANGENT_PROJECTED; t += 2) {
            rod_case_force(&s, t, s.scatter);
            rod_case_dense(&s, k);
            const double scale = largest(k, M * M);
            for (int i = 0; i < 2 * N; i++)
                for (int c = 0; c < 3; c++)
                    s.matrix->value[9 * s.matrix->diagonal[i] + 4 * c] += 1e-9 * scale;
            assert_int_equal(cn_solver_factor(s.solver, s.matrix, s.matrix->n, NULL, NULL), CN_OK);
        }
    }
    rod_case_free(&s);
}

static void every_instruction_set_and_thread_count_gives_the_same(void **state)
{
    (void)state;
    enum { N = 200, M = 6 * N };
    rod_case s = crooked(N, 1);
    cn_pool *pool;
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    disturb(&s, 9, 0.3, 2.5);
    double f[M];
    const int nvalue = 9 * s.matrix->nblock;
    double *value = calloc((size_t)nvalue, sizeof *value);
    const double e = rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    memcpy(f, s.f, sizeof f), memcpy(value, s.matrix->value, (size_t)nvalue * sizeof *value);
    for (int level = 0; level < 3; level++) {
        ((cn_rod *)s.body->own)->kernel = cn_rod_kernel_pick(level);
        assert_true(fabs(rod_case_force(&s, CN_TANGENT_EXACT, s.scatter) - e) <= 1e-14 * e);
        for (int i = 0; i < M; i++)
            assert_true(fabs(s.f[i] - f[i]) <= 1e-13 * largest(f, M));
        for (int i = 0; i < nvalue; i++)
            assert_true(fabs(s.matrix->value[i] - value[i]) <= 1e-13 * largest(value, nvalue));
    }
    const double single = rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    memcpy(f, s.f, sizeof f), memcpy(value, s.matrix->value, (size_t)nvalue * sizeof *value);
    memset(s.f, 0, sizeof f);
    cn_matrix_clear(s.matrix, s.matrix->n);
    assert_true(cn_body_add_elastic(s.body, N, s.x, s.rotation, s.f, CN_TANGENT_EXACT, 1, s.scatter, pool) ==
                single);
    assert_memory_equal(f, s.f, sizeof f);
    assert_memory_equal(value, s.matrix->value, (size_t)nvalue * sizeof *value);
    free(value);
    cn_pool_free(pool);
    rod_case_free(&s);
}

/* What is not active neither pulls nor is read: the part of the rod alone gives the same. */
static void nodes_behind_the_active_ones_take_no_part(void **state)
{
    (void)state;
    for (int active = 1; active < 70; active += 17) {
        rod_case s = crooked(70, 1);
        disturb(&s, 4, 0.3, 1);
        for (int i = 3 * active; i < 3 * 70; i++)
            s.x[i] = s.x[210 + i] = NAN;
        cn_matrix_clear(s.matrix, s.matrix->n);
        const double e =
            cn_body_add_elastic(s.body, active, s.x, s.rotation, s.f, CN_TANGENT_EXACT, 2, s.scatter, NULL);
        assert_true(e >= 0 && (active > 1) == (e > 0));
        double sum[3] = {0};
        for (int i = 0; i < 70; i++)
            cn_add(sum, s.f + 3 * i, sum);
        assert_true(cn_norm(sum) < 1e-12 * (largest(s.f, 420) + 1));
        for (int i = 3 * active; i < 210; i++)
            assert_true(s.f[i] == 0 && s.f[210 + i] == 0);
        for (int i = 0; i < 9 * s.matrix->nblock; i++)
            assert_true(isfinite(s.matrix->value[i]));
        for (int i = active; i < 70; i++)
            assert_true(s.matrix->value[9 * s.matrix->diagonal[i]] == 0);
        rod_case_free(&s);
    }
}

/* The same rod in metres, millimetres and micrometres: energies go with the scale, strains do not. */
static void units_do_not_matter(void **state)
{
    (void)state;
    double energy[3];
    for (int u = 0; u < 3; u++) {
        const double size = u == 0 ? 1 : u == 1 ? 1e-3 : 1e-6;
        rod_case s = crooked(20, size);
        disturb(&s, 6, 0.3, 1);
        energy[u] = rod_case_force(&s, CN_TANGENT_EXACT, NULL) / size;
        rod_case_free(&s);
    }
    assert_true(fabs(energy[1] / energy[0] - 1) < 1e-12 && fabs(energy[2] / energy[0] - 1) < 1e-12);
}

static void not_a_number_shows_in_the_energy_and_the_measures(void **state)
{
    (void)state;
    rod_case s = crooked(9, 1);
    for (int i = 0; i < 54; i += 7) {
        const double was = s.x[i];
        cn_measures m;
        s.x[i] = NAN;
        assert_true(isnan(energy_at(&s)));
        cn_body_measure(s.body, 9, s.x, s.rotation, true, &m, NULL, NULL);
        assert_true(isnan(m.energy) && isnan(m.volume_max) && isnan(m.stress_max));
        s.x[i] = was;
    }
    rod_case_free(&s);
}

/* --- skin --- */

static const cn_section tube = {.axial = 12,
                                .shear = {4, 4},
                                .bending = {1.4e-6, 1.4e-6},
                                .torsion = 1e-6,
                                .area = 1e-6,
                                .half = {6e-4, 6e-4},
                                .round = true,
                                .young = 8e6,
                                .poisson = 0.4,
                                .twist_stress = 8e6 / 2.8 * 6e-4};

/* A catheter with its skin, along -z as the mesh is. */
static rod_case skinned(int stations)
{
    cn_tets *skin;
    double *axis = calloc((size_t)stations, 3 * sizeof *axis);
    cn_section *section = calloc((size_t)stations, sizeof *section);
    assert_true(axis && section);
    assert_int_equal(cn_tets_catheter(&skin, 0.002 * (stations - 1), 0.0012, 0, stations, 6, NULL), CN_OK);
    for (int i = 0; i < stations; i++)
        axis[3 * i + 2] = -0.002 * i, section[i] = tube;
    const rod_case s = rod_case_new(stations, axis, (const double[3]){1, 0, 0}, section, skin);
    cn_tets_free(skin);
    free(axis), free(section);
    return s;
}

static void points_follow_their_frames_rigidly(void **state)
{
    (void)state;
    unsigned seed = 8;
    rod_case s = skinned(12);
    double *points = calloc((size_t)s.body->npoint, 3 * sizeof *points), r[9], p[3];
    const double c[3] = {1, 2, 3};
    assert_ptr_equal(cn_body_points(s.body, 12, s.x, s.rotation, points), points);
    for (int i = 0; i < 3 * s.body->npoint; i++)
        assert_true(fabs(points[i] - s.body->point[i]) < 1e-17);
    assert_int_equal(cn_body_points_of(s.body, 5), 35);
    assert_int_equal(s.body->boundary->nvert, s.body->npoint);
    shape_rotation(&seed, r);
    rod_case_move(&s, r, c);
    cn_body_points(s.body, 12, s.x, s.rotation, points);
    for (int i = 0; i < s.body->npoint; i++) {
        cn_mat_vec(r, s.body->point + 3 * i, p);
        cn_add(p, c, p);
        assert_true(cn_distance(p, points + 3 * i) < 1e-14);
    }
    free(points);
    rod_case_free(&s);
}

static void arms_and_pull_are_derivatives_of_the_points(void **state)
{
    (void)state;
    rod_case s = skinned(5);
    enum { N = 30 };
    const int np = 3 * s.body->npoint;
    unsigned seed = 2;
    cn_carry *carry;
    double *p[2], *force = calloc((size_t)np, sizeof *force), f0[N] = {0}, f[2][N], dense[N * N];
    for (int k = 0; k < 2; k++)
        p[k] = calloc((size_t)np, sizeof *p[k]);
    assert_int_equal(cn_carry_new(&carry, s.body), CN_OK);
    disturb(&s, 3, 0.2, 2.2);
    for (int i = 0; i < np; i++)
        force[i] = shape_random(&seed);
    cn_body_carry(s.body, 5, s.x, s.rotation, carry);
    cn_matrix_clear(s.matrix, s.matrix->n);
    cn_body_pull(s.body, 5, s.x, s.rotation, carry, force, f0, 2, s.matrix);
    rod_case_dense(&s, dense);
    for (int i = 0; i < N; i++) {
        const double xi = s.x[i], h = 1e-5;
        for (int k = 0; k < 2; k++) {
            s.x[i] = xi + (k ? h : -h);
            cn_body_points(s.body, 5, s.x, s.rotation, p[k]);
            cn_body_carry(s.body, 5, s.x, s.rotation, carry);
            memset(f[k], 0, sizeof f[k]);
            cn_body_pull(s.body, 5, s.x, s.rotation, carry, force, f[k], 1, NULL);
        }
        s.x[i] = xi;
        double work = 0;
        cn_body_carry(s.body, 5, s.x, s.rotation, carry);
        for (int j = 0; j < np; j++) {
            const int node = carry->node[j / 3], block = i / 3, c = i % 3;
            const double got = block == node                 ? j % 3 == c
                               : block == carry->turn + node ? carry->arm[9 * (j / 3) + 3 * (j % 3) + c]
                                                             : 0;
            assert_true(fabs((p[1][j] - p[0][j]) / (2 * h) - got) < 1e-9);
            work += (p[1][j] - p[0][j]) / (2 * h) * force[j];
        }
        assert_true(fabs(work - f0[i]) < 1e-8);
        for (int j = 0; j < N; j++)
            assert_true(fabs(-2 * (f[1][j] - f[0][j]) / (2 * h) - dense[N * j + i]) < 1e-9);
    }
    for (int k = 0; k < 2; k++)
        free(p[k]);
    free(force);
    cn_carry_free(carry);
    rod_case_free(&s);
}

/* A skin in any order, with the node that each of its nodes rides on, is the sorted one. */
static void a_skin_in_any_order_is_sorted(void **state)
{
    (void)state;
    cn_tets *skin;
    cn_body *body, *other;
    int ride[28], back[28];
    const double axis[12] = {0, 0, 0, 0, 0, -0.002, 0, 0, -0.004, 0, 0, -0.006}, normal[3] = {1, 0, 0};
    const cn_section section[3] = {tube, tube, tube};
    const cn_material m = {.young = 1, .poisson = 0.3};
    cn_error error = {0};
    assert_int_equal(cn_tets_catheter(&skin, 0.006, 0.0012, 0, 4, 6, NULL), CN_OK);
    assert_int_equal(cn_body_new_rod(&body, 4, axis, normal, section, skin, NULL, &m, NULL), CN_OK);
    double node[84];
    memcpy(node, skin->node, sizeof node);
    for (int p = 0; p < 28; p++) { /* station by station becomes side by side */
        back[p] = p % 7 * 4 + p / 7;
        ride[back[p]] = p / 7;
        cn_copy3(node + 3 * p, skin->node + 3 * back[p]);
    }
    for (int c = 0; c < 4 * skin->ntet; c++)
        skin->tet[c] = back[skin->tet[c]];
    assert_int_equal(cn_body_new_rod(&other, 4, axis, normal, section, skin, ride, &m, NULL), CN_OK);
    assert_memory_equal(body->tet, other->tet, 4 * (size_t)body->ntet * sizeof *body->tet);
    assert_memory_equal(body->point, other->point, sizeof node);
    cn_body_free(other);
    ride[3] = ride[3] == 0 ? 1 : 0;
    assert_int_equal(cn_body_new_rod(&other, 4, axis, normal, section, skin, ride, &m, &error), CN_ERR_ARG);
    assert_non_null(strstr(error.message, "each needs 7"));
    cn_body_free(body);
    cn_tets_free(skin);
}

/* --- measures --- */

/* Puts the rod along z into a state of constant strain: axial, curvature about n (x), twist. */
static void strained(rod_case *s, double axial, double bend, double twist)
{
    const int n = s->body->nnode;
    for (int i = 0; i < n; i++) { /* t points along -z, b along -y where n is along x */
        const double length = 0.002 * i, angle = bend * length;
        double *p = s->x + 3 * i, *theta = s->x + 3 * (n + i);
        p[0] = 0;
        p[1] = bend == 0 ? 0 : (1 + axial) * (1 - cos(angle)) / bend;
        p[2] = bend == 0 ? -(1 + axial) * length : -(1 + axial) * sin(angle) / bend;
        theta[0] = angle, theta[1] = 0, theta[2] = -twist * length;
    }
}

static void measures_are_those_of_beam_theory(void **state)
{
    (void)state;
    rod_case s = skinned(21);
    cn_measures m;
    double *stress = calloc((size_t)s.body->ntet, sizeof *stress);
    const double length = 0.04, r = 6e-4;
    strained(&s, 0.01, 0, 0);
    cn_body_measure(s.body, 21, s.x, s.rotation, true, &m, stress, NULL);
    assert_true(fabs(m.energy - 0.5 * 12 * 1e-4 * length) < 1e-12);
    assert_true(fabs(m.volume_max - 0.2 * 0.01) < 1e-12 && fabs(m.volume_mean - 0.2 * 0.01) < 1e-12);
    assert_true(fabs(m.volume - 1e-6 * length * 1.002) < 1e-18 && m.inverted == 0);
    assert_true(fabs(m.stress_max - 8e4) < 1e-5 && fabs(m.stress_mean - 8e4) < 1e-5);
    for (int e = 0; e < s.body->ntet; e++)
        assert_true(fabs(stress[e] - 8e4) < 1e-5);

    const double bend =
        3; /* the chord of a segment is shorter than its arc by (k h)^2 / 24 = 1.5e-6, which costs 2e-6 */
    strained(&s, 0, bend, 0);
    cn_body_measure(s.body, 21, s.x, s.rotation, true, &m, stress, NULL);
    assert_true(fabs(m.stress_max / (8e6 * bend * r) - 1) < 1e-3);
    assert_true(fabs(m.volume_max / (0.2 * bend * r) - 1) < 1e-3 && m.volume_mean < 1e-6);
    assert_true(fabs(m.energy / (0.5 * 1.4e-6 * bend * bend * length) - 1) < 3e-6);
    for (int e = 0; e < s.body->ntet; e++) { /* by the distance of its centre from the neutral plane */
        double centre = 0;
        for (int a = 0; a < 4; a++)
            centre += s.body->point[3 * s.body->tet[4 * e + a] + 1] / 4;
        assert_true(fabs(stress[e] - 8e6 * bend * fabs(centre)) < 20);
    }

    const double twist = 20;
    strained(&s, 0, 0, twist);
    cn_body_measure(s.body, 21, s.x, s.rotation, true, &m, stress, NULL);
    assert_true(fabs(m.stress_max / (sqrt(3) * 8e6 / 2.8 * r * twist) - 1) < 1e-9);
    assert_true(fabs(m.energy / (0.5 * 1e-6 * twist * twist * length) - 1) < 1e-9);
    assert_true(m.volume_max < 1e-12);
    for (int i = 0; i < 21; i++)
        s.x[3 * i + 2] *= -1; /* every segment against its frame */
    cn_body_measure(s.body, 21, s.x, s.rotation, true, &m, NULL, NULL);
    assert_int_equal(m.inverted, 20);
    free(stress);
    rod_case_free(&s);
}

/* The same with measures, of a skin's elements too. */
static void a_rotation_by_any_angle_changes_no_measure(void **state)
{
    (void)state;
    const double angles[] = {1e-9, 1e-4, 0.1, 1, 1.5707963267948966, 3, 3.141592653589793, 6}, none[3] = {0};
    double worst = 0;
    for (int kind = 0; kind < 2; kind++)
        for (size_t k = 0; k < sizeof angles / sizeof *angles; k++) {
            rod_case s = kind ? skinned(21) : crooked(70, 1);
            const int n = s.body->nnode, ntet = s.body->ntet;
            double *stress = calloc(2 * (size_t)ntet + 1, sizeof *stress), r[9];
            const double w[3] = {0.6 * angles[k], -0.48 * angles[k], 0.64 * angles[k]};
            cn_measures was, now;
            assert_non_null(stress);
            disturb(&s, 5, 0.2, 1);
            cn_body_measure(s.body, n, s.x, s.rotation, true, &was, ntet ? stress : NULL, NULL);
            cn_rotation(w, r);
            rod_case_move(&s, r, none);
            cn_body_measure(s.body, n, s.x, s.rotation, true, &now, ntet ? stress + ntet : NULL, NULL);
            assert_true(was.stress_mean > 0 && was.volume_max > 0 && was.energy > 0);
            worst = fmax(worst, fabs(now.stress_max - was.stress_max) / was.stress_max);
            worst = fmax(worst, fabs(now.stress_mean - was.stress_mean) / was.stress_mean);
            worst = fmax(worst, fabs(now.volume_max - was.volume_max) / was.volume_max);
            worst = fmax(worst, fabs(now.volume_mean - was.volume_mean) / was.volume_max);
            worst = fmax(worst, fabs(now.energy - was.energy) / was.energy);
            worst = fmax(worst, fabs(now.volume - was.volume) / was.volume);
            for (int e = 0; e < ntet; e++)
                worst = fmax(worst, fabs(stress[ntet + e] - stress[e]) / was.stress_max);
            free(stress);
            rod_case_free(&s);
        }
    print_message("rotations by 1e-9 to 6 rad: a rod's stress, volume and energy change by at most %.1e\n",
                  worst);
    assert_true(worst <= 1e-9);
}

/* --- refusals --- */

static void what_is_no_rod_is_refused_by_segment_and_value(void **state)
{
    (void)state;
    const cn_material m = {.young = 1, .poisson = 0.3};
    for (int i = 0; i < 14; i++) {
        double axis[9] = {0, 0, 0, 0, 0, 1, 0, 0, 2}, normal[3] = {1, 0, 0};
        cn_section section[2] = {tube, tube};
        double *const value[6] = {&section[1].axial,  section[1].shear,       section[1].shear + 1,
                                  section[1].bending, section[1].bending + 1, &section[1].torsion};
        cn_error error = {0};
        cn_body *body;
        if (i < 6)
            *value[i] = 0;
        else if (i < 12)
            *value[i - 6] = NAN;
        else if (i == 12)
            cn_copy3(axis + 3, axis + 6);
        else
            axis[8] = NAN;
        assert_int_equal(cn_body_new_rod(&body, 3, axis, normal, section, NULL, NULL, &m, &error),
                         CN_ERR_ARG);
        assert_null(body);
        assert_non_null(strstr(error.message, "segment 1"));
    }
    const double axis[9] = {0, 0, 0, 0, 0, 1, 0, 0, 2};
    const cn_section section[2] = {tube, tube};
    cn_body *body;
    assert_int_equal(cn_body_new_rod(&body, 3, axis, axis + 3, section, NULL, NULL, &m, NULL), CN_ERR_ARG);
    assert_int_equal(cn_body_new_rod(&body, 1, axis, axis + 3, section, NULL, NULL, &m, NULL), CN_ERR_ARG);
    cn_tets *skin = shape_tet(1);
    assert_int_equal(
        cn_body_new_rod(&body, 3, axis, (const double[3]){1, 0, 0}, section, skin, NULL, &m, NULL),
        CN_ERR_ARG);
    cn_tets_free(skin);
}

static void every_failing_allocation_is_reported_and_a_call_takes_none(void **state)
{
    (void)state;
    cn_tets *skin;
    const double axis[12] = {0, 0, 0, 0, 0, -0.002, 0, 0, -0.004, 0, 0, -0.006}, normal[3] = {1, 0, 0};
    const cn_section section[3] = {tube, tube, tube};
    const cn_material m = {.young = 1, .poisson = 0.3};
    assert_int_equal(cn_tets_catheter(&skin, 0.006, 0.0012, 0, 4, 6, NULL), CN_OK);
    rod_case s = skinned(12);
    for (FAIL_EACH_ALLOC) {
        cn_error error = {0};
        cn_body *body;
        const cn_status status = cn_body_new_rod(&body, 4, axis, normal, section, skin, NULL, &m, &error);
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
    cn_measures measures;
    rod_case_force(&s, CN_TANGENT_EXACT, s.scatter);
    cn_body_measure(s.body, 12, s.x, s.rotation, true, &measures, NULL, NULL);
    cn_body_turn(s.body, 12, s.x, s.rotation);
    assert_int_equal(fail_alloc_count(), 0);
    rod_case_free(&s);
    cn_tets_free(skin);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(exact_tangent_is_the_derivative_of_the_force_and_symmetric),
        cmocka_unit_test(a_rigid_motion_costs_nothing_and_turns_the_forces),
        cmocka_unit_test(inner_forces_and_moments_sum_to_nothing),
        cmocka_unit_test(energy_is_that_of_the_strains_by_rotation_matrices),
        cmocka_unit_test(projected_and_warped_tangents_are_positive_and_exact_at_rest),
        cmocka_unit_test(every_instruction_set_and_thread_count_gives_the_same),
        cmocka_unit_test(nodes_behind_the_active_ones_take_no_part),
        cmocka_unit_test(units_do_not_matter),
        cmocka_unit_test(not_a_number_shows_in_the_energy_and_the_measures),
        cmocka_unit_test(points_follow_their_frames_rigidly),
        cmocka_unit_test(arms_and_pull_are_derivatives_of_the_points),
        cmocka_unit_test(a_skin_in_any_order_is_sorted),
        cmocka_unit_test(measures_are_those_of_beam_theory),
        cmocka_unit_test(a_rotation_by_any_angle_changes_no_measure),
        cmocka_unit_test(what_is_no_rod_is_refused_by_segment_and_value),
        cmocka_unit_test(every_failing_allocation_is_reported_and_a_call_takes_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
