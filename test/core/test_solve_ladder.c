#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "fail_alloc.h"
#include "solve_parts.h"

/* A rod of n stations: block i its position, n + i its rotation; stations couple to their neighbours. */
typedef struct {
    int n;
    int *level;
    cn_matrix *a;
    unsigned char *held;
    double *b, *x, *y; /* (6 n) */
    unsigned seed;
} rod;

static double noise(rod *r)
{
    r->seed = r->seed * 1664525u + 1013904223u;
    return (double)(r->seed >> 8) / (1 << 23) - 1;
}

static rod rod_new(int n)
{
    rod r = {n, .seed = 1};
    int *connect = malloc(((size_t)n * 4 + 2) * sizeof *connect);
    cn_body body = {.nblock = 2 * n, .nelement = n > 1 ? n - 1 : 1, .nper = n > 1 ? 4 : 2};
    const cn_body *const bodies[] = {&body};

    body.connect = connect;
    if (n == 1) memcpy(connect, (int[]){0, 1}, sizeof(int[2]));
    for (int i = 0; i + 1 < n; i++)
        memcpy(connect + 4 * i, (int[]){i, i + 1, n + i, n + i + 1}, sizeof(int[4]));
    assert_int_equal(cn_matrix_new(&r.a, 1, bodies, (int[]){0}), CN_OK);
    free(connect);
    r.level = malloc(2 * (size_t)n * sizeof *r.level);
    r.held = calloc(2 * (size_t)n, 1);
    r.b = malloc(6 * (size_t)n * sizeof *r.b);
    r.x = calloc(6 * (size_t)n, sizeof *r.x);
    r.y = calloc(6 * (size_t)n, sizeof *r.y);
    for (int i = 0; i < 2 * n; i++)
        r.level[i] = i % n;
    for (int c = 0; c < 6 * n; c++)
        r.b[c] = noise(&r);
    return r;
}

static void rod_free(rod *r)
{
    cn_matrix_free(r->a);
    free(r->level), free(r->held), free(r->b), free(r->x), free(r->y);
}

/* Adds scale * v v' for v over the unknowns of stations s and s + 1 (positions, rotations, of each). */
static void add_strain(rod *r, int s, const double v[12], double scale)
{
    const int block[4] = {s, r->n + s, s + 1, r->n + s + 1};

    for (int p = 0; p < 4; p++)
        for (int q = 0; q < 4; q++)
            for (int c = 0; c < 9 && block[p] < 2 * r->n && block[q] < 2 * r->n; c++)
                r->a->value[9 * cn_matrix_find(r->a, block[p], block[q]) + c] +=
                    scale * v[3 * p + c / 3] * v[3 * q + c % 3];
}

/* Random and positive definite: a strain of noise in every direction of every segment, and a bit of mass.
 * Rotations are measured in units that make theirs `contrast` times weaker. */
static void fill_noise(rod *r, double contrast)
{
    cn_matrix_clear(r->a, r->a->n);
    for (int s = 0; s + 1 < r->n; s++)
        for (int k = 0; k < 12; k++) {
            double v[12];
            for (int c = 0; c < 12; c++)
                v[c] = noise(r) * (c / 3 % 2 ? sqrt(1 / contrast) : 1);
            add_strain(r, s, v, 1);
        }
    for (int i = 0; i < 2 * r->n; i++)
        for (int c = 0; c < 3; c++)
            r->a->value[9 * r->a->diagonal[i] + 4 * c] += 0.1 / (i < r->n ? 1 : contrast);
}

/* A shear-flexible beam (Timoshenko, linear shape functions, one point: Hughes, Taylor and Kanoknukulchai
 * 1977) of unit length along `axis`: strains (x2 - x1) / h - mean rotation x axis, curvature
 * (turn2 - turn1) / h. Stiffness EA, GA along and across, EI [m, N]. */
static void fill_beam(rod *r, const double axis[3], double ea, double ga, double ei, double mass)
{
    const double h = 1.0 / (r->n > 1 ? r->n - 1 : 1);
    double frame[3][3] = {{axis[0], axis[1], axis[2]}};
    const int least = fabs(axis[0]) < 0.5 ? 0 : 1;
    double norm = 0;

    for (int c = 0; c < 3; c++) {
        frame[1][c] = (c == least) - axis[least] * axis[c];
        norm += frame[1][c] * frame[1][c];
    }
    for (int c = 0; c < 3; c++)
        frame[1][c] /= sqrt(norm);
    for (int c = 0; c < 3; c++)
        frame[2][c] =
            frame[0][(c + 1) % 3] * frame[1][(c + 2) % 3] - frame[0][(c + 2) % 3] * frame[1][(c + 1) % 3];
    cn_matrix_clear(r->a, r->a->n);
    for (int s = 0; s + 1 < r->n; s++)
        for (int d = 0; d < 3; d++) {
            double strain[12], curve[12] = {0};
            for (int c = 0; c < 3; c++) {
                const double *f = frame[d];
                const int c1 = (c + 1) % 3, c2 = (c + 2) % 3;
                strain[c] = -(strain[6 + c] = f[c] / h);
                strain[3 + c] = strain[9 + c] = -0.5 * (axis[c1] * f[c2] - axis[c2] * f[c1]);
                curve[3 + c] = -(curve[9 + c] = f[c] / h);
            }
            add_strain(r, s, strain, (d ? ga : ea) * h);
            add_strain(r, s, curve, ei * h);
        }
    for (int i = 0; i < r->n; i++)
        for (int c = 0; c < 3; c++)
            r->a->value[9 * r->a->diagonal[i] + 4 * c] += mass;
}

/* Largest |b - A x| against |A||x| + |b|, row by row (Oettli and Prager 1964), rows not held. */
static double backward_error(const rod *r)
{
    const cn_matrix *a = r->a;
    double worst = 0;

    for (int i = 0; i < 3 * a->n; i++) {
        double sum = r->b[i], scale = fabs(r->b[i]);
        for (int k = a->row[i / 3]; k < a->row[i / 3 + 1]; k++)
            for (int j = 0; j < 3; j++) {
                const int c = 3 * a->col[k] + j;
                const double term = r->held[a->col[k]] ? 0 : a->value[9 * k + 3 * (i % 3) + j] * r->x[c];
                sum -= term;
                scale += fabs(term);
            }
        if (!r->held[i / 3] && !(fabs(sum) <= worst * scale)) worst = fabs(sum) / scale;
    }
    return worst;
}

/* By CHOLMOD, into y. */
static void solve_otherwise(rod *r)
{
    cn_sparse *sparse;

    assert_int_equal(cn_sparse_new(&sparse, r->a), CN_OK);
    assert_int_equal(cn_sparse_factor(sparse, r->a, r->held), CN_OK);
    memcpy(r->y, r->x, 6 * (size_t)r->n * sizeof *r->y);
    assert_int_equal(cn_sparse_solve(sparse, r->held, r->b, r->y), CN_OK);
    cn_sparse_free(sparse);
}

static void hold(rod *r, int how)
{
    for (int i = 0; i < 2 * r->n; i++) {
        const int s = i % r->n, turn = i / r->n;
        r->held[i] = how == 1   ? s < r->n / 3                   /* one end */
                     : how == 2 ? s >= r->n / 2 || s == 0        /* both */
                     : how == 3 ? s % 7 == 3                     /* stations between */
                     : how == 4 ? !turn && s % 5 == 0            /* positions */
                     : how == 5 ? turn && s % 3 < 2              /* rotations */
                     : how == 6 ? s == 0 ? !turn : s == r->n - 1 /* a hinge and a clamp */
                     : how == 7 ? s != r->n / 2 || turn          /* all but one position */
                                : how == 8;
    }
}

enum { HOW = 9 };

static void a_rod_is_solved_as_by_others_wherever_it_is_held(void **state)
{
    const int size[] = {1, 2, 3, 4, 50, 455};

    (void)state;
    for (int s = 0; s < 6; s++)
        for (int how = 0; how < HOW; how++)
            for (int width = 8; width >= 2; width /= 2) {
                rod r = rod_new(size[s]);
                cn_ladder *ladder;
                fill_noise(&r, 1);
                hold(&r, how);
                for (int c = 0; c < 6 * r.n; c++)
                    r.x[c] = r.held[c / 3] ? 7 : NAN;
                assert_int_equal(cn_ladder_new(&ladder, r.a, r.level, width), CN_OK);
                assert_non_null(ladder);
                assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
                cn_ladder_solve(ladder, r.b, r.x);
                solve_otherwise(&r);
                assert_true(backward_error(&r) < 1e-14);
                for (int c = 0; c < 6 * r.n; c++)
                    assert_true(r.held[c / 3] ? r.x[c] == 7 : fabs(r.x[c] - r.y[c]) < 1e-11);
                memcpy(r.y, r.b, 6 * (size_t)r.n * sizeof *r.y);
                cn_ladder_solve(ladder, r.y, r.y); /* in place */
                for (int c = 0; c < 6 * r.n; c++)
                    assert_true(r.y[c] == (r.held[c / 3] ? r.b[c] : r.x[c]));
                cn_ladder_free(ladder);
                rod_free(&r);
            }
}

static void stiff_rods_are_solved_to_rounding(void **state)
{
    const double axes[3][3] = {{1, 0, 0}, {0.6, 0, 0.8}, {1e-4, 0.8, 0.6}};

    (void)state;
    for (int kind = 0; kind < 8; kind++)
        for (int way = 0; way < 3; way++)
            for (int quasistatic = 0; quasistatic < 2; quasistatic++) {
                rod r = rod_new(kind < 4 ? 455 : 40);
                cn_ladder *ladder;
                if (kind % 4 == 0) /* a 1 m catheter: EA, EI of 1.35 mm at 8.7 MPa */
                    fill_beam(&r, axes[way], 12.5, 4, 1.4e-6, quasistatic ? 0 : 0.035);
                else if (kind % 4 == 3)
                    fill_noise(&r, 1e10);
                else /* ten orders apart, either way */
                    fill_beam(&r, axes[way], 1e4, 4e3, kind % 4 == 1 ? 1e-6 : 1e14, quasistatic ? 0 : 1e-3);
                hold(&r, kind % 4 == 3 ? 0 : 6);
                assert_int_equal(cn_ladder_new(&ladder, r.a, r.level, 0), CN_OK);
                assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
                cn_ladder_solve(ladder, r.b, r.x);
                assert_true(backward_error(&r) < 1e-13);
                cn_ladder_free(ladder);
                rod_free(&r);
            }
}

static void a_cantilever_bends_as_its_closed_form(void **state)
{
    const double length = 1, ea = 3e3, ga = 1e3, ei = 2, force = 0.7;
    rod r = rod_new(101);
    cn_ladder *ladder;

    (void)state;
    fill_beam(&r, (double[]){0, 0, 1}, ea, ga, ei, 0);
    memset(r.b, 0, 6 * (size_t)r.n * sizeof *r.b);
    r.held[0] = r.held[r.n] = 1;
    r.b[3 * (r.n - 1)] = force, r.b[3 * (r.n - 1) + 2] = 2 * force;
    assert_int_equal(cn_ladder_new(&ladder, r.a, r.level, 0), CN_OK);
    assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
    cn_ladder_solve(ladder, r.b, r.x);
    const double *tip = r.x + 3 * (r.n - 1);
    const double bent = force * pow(length, 3) / (3 * ei) * (1 - 0.25 / pow(r.n - 1, 2)); /* h^2 / 4 L^2 */
    assert_true(fabs(tip[0] - bent - force * length / ga) < 1e-9 * bent);
    assert_true(fabs(tip[1]) < 1e-12 * bent);
    assert_true(fabs(tip[2] - 2 * force * length / ea) < 1e-12);
    cn_ladder_free(ladder);
    rod_free(&r);
}

static void an_indefinite_rod_is_refused_and_the_next_one_taken(void **state)
{
    rod r = rod_new(41);

    (void)state;
    for (int width = 8; width >= 2; width /= 2) {
        cn_ladder *ladder;
        assert_int_equal(cn_ladder_new(&ladder, r.a, r.level, width), CN_OK);
        fill_noise(&r, 1);
        for (int i = 0; i < 2 * r.n; i += i == 0 ? 19 : 1)
            for (int c = 0; c < 9; c += 4) {
                double *v = r.a->value + 9 * r.a->diagonal[i] + c;
                const double good = *v, bad[] = {-1, 0, NAN, INFINITY, -INFINITY};
                for (int k = 0; k < 5; k++) {
                    *v = bad[k];
                    assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_ERR_SINGULAR);
                }
                r.held[i] = 1; /* held: not looked at */
                assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
                r.held[i] = 0;
                *v = good;
            }
        fill_beam(&r, (double[]){0.6, 0, 0.8}, 1e3, 1e3, 1, 0); /* free and without mass */
        assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_ERR_SINGULAR);
        r.held[7] = 1; /* turns about a point */
        assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_ERR_SINGULAR);
        r.held[r.n + 9] = 1;
        assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
        r.held[7] = r.held[r.n + 9] = 0;
        cn_ladder_free(ladder);
    }
    rod_free(&r);
}

static void units_change_nothing_but_the_scale(void **state)
{
    rod r = rod_new(60);
    const double unit[2] = {0x1p-40, 0x1p30}; /* of positions and of rotations */
    cn_ladder *ladder;

    (void)state;
    fill_noise(&r, 1);
    hold(&r, 6);
    assert_int_equal(cn_ladder_new(&ladder, r.a, r.level, 0), CN_OK);
    assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
    cn_ladder_solve(ladder, r.b, r.x);
    for (int i = 0; i < 2 * r.n; i++) {
        for (int k = r.a->row[i]; k < r.a->row[i + 1]; k++)
            for (int c = 0; c < 9; c++)
                r.a->value[9 * k + c] *= unit[i / r.n] * unit[r.a->col[k] / r.n];
        for (int c = 0; c < 3; c++)
            r.b[3 * i + c] *= unit[i / r.n];
    }
    assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
    cn_ladder_solve(ladder, r.b, r.y);
    for (int c = 0; c < 6 * r.n; c++)
        assert_true(r.x[c] == r.y[c] * unit[c / (3 * r.n)]);
    cn_ladder_free(ladder);
    rod_free(&r);
}

static void levels_of_two_rows_are_found_in_a_rod(void **state)
{
    (void)state;
    for (int n = 3; n < 100; n += 31) {
        rod r = rod_new(n);
        int *level = malloc(2 * (size_t)n * sizeof *level);
        cn_ladder *ladder;
        assert_int_equal(cn_levels_find(r.a, level), CN_OK);
        for (int i = 0; i < n; i++)
            assert_true(level[i] == level[n + i] && level[i] == (level[0] == 0 ? i : n - 1 - i));
        assert_int_equal(cn_ladder_new(&ladder, r.a, level, 0), CN_OK);
        assert_non_null(ladder);
        cn_ladder_free(ladder);
        level[0] = level[n] = level[1];
        assert_int_equal(cn_ladder_new(&ladder, r.a, level, 0), CN_OK);
        assert_null(ladder); /* four rows in a level */
        free(level);
        rod_free(&r);
    }
}

static void a_rod_goes_to_the_chain_and_is_refined_there(void **state)
{
    (void)state;
    for (int given = 0; given < 2; given++)
        for (int n = 1; n < 300; n += n < 4 ? 1 : 90)
            for (int kind = CN_LINEAR_AUTO; kind <= CN_LINEAR_CHAIN;
                 kind += CN_LINEAR_CHAIN - CN_LINEAR_AUTO) {
                rod r = rod_new(n);
                cn_solver *solver;
                cn_pool *pool;
                double residual[2];
                int count;
                fill_beam(&r, (double[]){0.6, 0, 0.8}, 1e4, 4e3, 10, 1);
                for (int i = 0; i < n; i++)
                    for (int c = 0; c < 3; c++)
                        r.a->value[9 * r.a->diagonal[n + i] + 4 * c] += 1e-3;
                assert_int_equal(cn_pool_new(&pool, 2), CN_OK);
                assert_int_equal(cn_solver_new(&solver, r.a, kind, given ? r.level : NULL, NULL), CN_OK);
                assert_int_equal(cn_solver_kind(solver), CN_LINEAR_CHAIN);
                for (int held = 0; held < 2; held++) {
                    r.held[n - 1] = r.held[2 * n - 1] = held;
                    assert_int_equal(cn_solver_factor(solver, r.a, 2 * n, r.held, NULL), CN_OK);
                    assert_int_equal(cn_solver_solve(solver, r.b, r.x, 0, 0, &count, &residual[0], NULL),
                                     CN_OK);
                    assert_true(residual[0] < 1e-10 && count <= 4 && backward_error(&r) < 1e-13);
                    assert_int_equal(cn_solver_factor(solver, r.a, 2 * n, r.held, pool), CN_OK);
                    assert_int_equal(cn_solver_solve(solver, r.b, r.y, 0, 0, NULL, &residual[1], pool),
                                     CN_OK);
                    assert_memory_equal(r.x, r.y, 6 * (size_t)n * sizeof *r.x);
                    assert_true(residual[0] == residual[1]);
                }
                assert_int_equal(cn_solver_factor(solver, r.a, 2 * n - 1, NULL, pool), CN_OK);
                r.x[6 * n - 1] = 7;
                assert_int_equal(cn_solver_solve(solver, r.b, r.x, 0, 0, NULL, NULL, pool), CN_OK);
                assert_true(r.x[6 * n - 1] == 7);
                r.a->value[9 * r.a->diagonal[0]] = NAN;
                assert_int_equal(cn_solver_factor(solver, r.a, 2 * n, NULL, pool), CN_ERR_SINGULAR);
                assert_int_equal(cn_solver_solve(solver, r.b, r.x, 0, 0, NULL, NULL, pool), CN_ERR_ARG);
                cn_solver_free(solver);
                cn_pool_free(pool);
                rod_free(&r);
            }
}

static void failing_allocations_are_reported_and_work_makes_none(void **state)
{
    rod r = rod_new(30);
    cn_ladder *ladder = NULL;
    cn_status status = CN_OK;

    (void)state;
    fill_noise(&r, 1);
    for (FAIL_EACH_ALLOC) {
        status = cn_ladder_new(&ladder, r.a, r.level, 0);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((status == CN_OK) == !!ladder);
    }
    fail_alloc_at(-1);
    assert_int_equal(cn_ladder_factor(ladder, r.a, r.held), CN_OK);
    cn_ladder_solve(ladder, r.b, r.x);
    assert_int_equal(fail_alloc_count(), 0);
    cn_ladder_free(ladder);
    rod_free(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_rod_is_solved_as_by_others_wherever_it_is_held),
        cmocka_unit_test(stiff_rods_are_solved_to_rounding),
        cmocka_unit_test(a_cantilever_bends_as_its_closed_form),
        cmocka_unit_test(an_indefinite_rod_is_refused_and_the_next_one_taken),
        cmocka_unit_test(units_change_nothing_but_the_scale),
        cmocka_unit_test(levels_of_two_rows_are_found_in_a_rod),
        cmocka_unit_test(a_rod_goes_to_the_chain_and_is_refined_there),
        cmocka_unit_test(failing_allocations_are_reported_and_work_makes_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
