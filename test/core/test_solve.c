#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <suitesparse/SuiteSparse_config.h>

#include "fail_alloc.h"
#include "solve_cases.h"
#include "solve_parts.h"

static double noise(unsigned *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (double)(*seed >> 8) / (1 << 23) - 1;
}

static cn_matrix *pattern_of(const cn_body *body)
{
    const cn_body *const bodies[] = {body};
    cn_matrix *a;
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_OK);
    return a;
}

/* Symmetric noise off the diagonal, and a diagonal that outweighs it. */
static void fill_dominant(cn_matrix *a, unsigned seed)
{
    for (int i = 0; i < a->n; i++)
        for (int k = a->row[i]; k < a->row[i + 1]; k++)
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) {
                    const int j = a->col[k];
                    if (3 * j + c > 3 * i + r) continue;
                    const double v =
                        3 * i + r == 3 * j + c ? 3.0 * (a->row[i + 1] - a->row[i]) : noise(&seed);
                    a->value[9 * k + 3 * r + c] = v;
                    a->value[9 * cn_matrix_find(a, j, i) + 3 * c + r] = v;
                }
}

static double steel(const cn_body *body, int e)
{
    (void)body, (void)e;
    return 200e9;
}

/* 200 GPa in one half, 20 kPa in the other. */
static double contrast(const cn_body *body, int e)
{
    return e < body->ntet / 2 ? 200e9 : 20e3;
}

/* x of A x = b by dense Cholesky over nodes that are active and not fixed; others 0. */
static void solve_dense(const cn_matrix *a, int nactive, const unsigned char *fixed, const double *b,
                        double *x)
{
    const int n = 3 * a->n;
    double *u = calloc((size_t)n * (size_t)n, sizeof *u);
    for (int i = 0; i < n; i++) {
        const bool held = i / 3 >= nactive || (fixed && fixed[i / 3]);
        for (int k = a->row[i / 3]; k < a->row[i / 3 + 1]; k++)
            for (int c = 0; c < 3; c++)
                if (!held && a->col[k] < nactive && !(fixed && fixed[a->col[k]]))
                    u[i * n + 3 * a->col[k] + c] = a->value[9 * k + 3 * (i % 3) + c];
        if (held) u[i * n + i] = 1;
        x[i] = held ? 0 : b[i];
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            for (int j = i; j < n && u[k * n + i] != 0; j++)
                u[i * n + j] -= u[k * n + i] * u[k * n + j];
        const double pivot = sqrt(u[i * n + i]);
        assert_true(pivot > 0);
        for (int j = i; j < n; j++)
            u[i * n + j] /= pivot;
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            x[i] -= u[k * n + i] * x[k];
        x[i] /= u[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            x[i] -= u[i * n + j] * x[j];
        x[i] /= u[i * n + i];
    }
    free(u);
}

enum { NSHAPE = 5 };

/* A rod, a grid, a random heap, a short rod of odd sections, two rods apart: nodes shuffled in every second.
 */
static cn_body shape(int which, unsigned seed)
{
    cn_body body = which == 0   ? body_sweep(section_disc(6, 1), 23, 9)
                   : which == 1 ? body_sweep(section_square(3, 1), 6, 1)
                   : which == 3 ? body_sweep(section_disc(3, 1), 2, 1)
                                : body_sweep(section_disc(4, 1), 16, 5);
    if (which == 2)
        for (int c = 0; c < 4 * 20;
             c++) /* 80 corners anywhere: some nodes stay alone with those of the rod */
            body.tet[c] = (int)(fabs(noise(&seed)) * (body.nnode - 1));
    if (which == 4)
        for (int t = 0; t < body.ntet; t++) /* cut between stations 7 and 8 */
            for (int c = 0; c < 4; c++)
                if (body.tet[4 * t] / 5 == 7) body.tet[4 * t + c] = body.tet[4 * t];
    for (int i = body.nnode - 1; which % 2 == 0 && i > 0; i--) {
        const int j = (int)(fabs(noise(&seed)) * i);
        for (int c = 0; c < 4 * body.ntet; c++)
            body.tet[c] = body.tet[c] == i ? j : body.tet[c] == j ? i : body.tet[c];
    }
    return body;
}

static void every_solver_agrees_with_dense_elimination(void **state)
{
    (void)state;
    for (int which = 0; which < NSHAPE; which++)
        for (int variant = 0; variant < 6; variant++) {
            cn_body body = shape(which, 7);
            cn_matrix *a = pattern_of(&body);
            const int n = a->n, nactive = variant == 5 ? 0 : variant % 2 ? n - n / 3 : n;
            unsigned seed = 3;
            unsigned char *fixed = calloc((size_t)n, 1);
            double *b = malloc(3 * sizeof *b * (size_t)n), *x = malloc(3 * sizeof *b * (size_t)n);
            double *reference = malloc(3 * sizeof *b * (size_t)n);
            fill_dominant(a, 5);
            for (int i = 0; i < n; i++)
                fixed[i] = variant / 2 && (variant == 4 ? true : noise(&seed) > 0.5);
            for (int c = 0; c < 3 * n; c++)
                b[c] = noise(&seed);
            solve_dense(a, nactive, variant / 2 ? fixed : NULL, b, reference);
            for (int kind = CN_LINEAR_AUTO; kind <= CN_LINEAR_PCG; kind++) {
                cn_solver *solver;
                double residual = 1;
                for (int c = 0; c < 3 * n; c++)
                    x[c] = c < 3 * nactive ? 1 : 7;
                assert_int_equal(cn_solver_new(&solver, a, kind, NULL, NULL), CN_OK);
                assert_int_equal(cn_solver_factor(solver, a, nactive, variant / 2 ? fixed : NULL, NULL),
                                 CN_OK);
                assert_int_equal(cn_solver_solve(solver, b, x, 1e-14, 1000, NULL, &residual, NULL), CN_OK);
                assert_true(residual <= 1e-14);
                for (int c = 0; c < 3 * n; c++)
                    assert_true(c < 3 * nactive ? fabs(x[c] - reference[c]) < 1e-13 : x[c] == 7);
                cn_solver_free(solver);
            }
            free(fixed), free(b), free(x), free(reference);
            cn_matrix_free(a);
            body_drop(&body);
        }
}

static void every_vector_width_gives_the_same_chain(void **state)
{
    (void)state;
    for (int width = 2; width <= 8; width *= 2)
        for (int sides = 3; sides < 40; sides += 5) { /* levels of 12 to 120 unknowns */
            cn_body body = body_sweep(section_disc(sides, 1), 7, 3);
            cn_matrix *a = pattern_of(&body);
            const int n = a->n;
            int *level = malloc(sizeof *level * (size_t)n);
            unsigned char *held = calloc((size_t)n, 1);
            double *b = malloc(3 * sizeof *b * (size_t)n), *x = malloc(3 * sizeof *b * (size_t)n);
            double *ax = malloc(3 * sizeof *b * (size_t)n);
            cn_chain *chain;
            fill_dominant(a, 5);
            for (int i = 0; i < n; i++)
                level[i] = i / (sides + 1);
            for (int c = 0; c < 3 * n; c++)
                b[c] = cos(c);
            assert_int_equal(cn_chain_new(&chain, a, level, width), CN_OK);
            assert_int_equal(cn_chain_factor(chain, a, held, NULL), CN_OK);
            cn_chain_solve(chain, b, x, NULL);
            cn_matrix_multiply(a, n, x, ax, NULL);
            for (int c = 0; c < 3 * n; c++)
                assert_true(fabs(ax[c] - b[c]) < 1e-14);
            cn_chain_free(chain);
            free(level), free(held), free(b), free(x), free(ax);
            cn_matrix_free(a);
            body_drop(&body);
        }
}

/* The catheter of the papers with its tip free and its end held, and what is done with it. */
typedef struct {
    cn_body body;
    cn_matrix *a;
    int level[455 * 7];
    unsigned char fixed[455 * 7];
    double b[3 * 455 * 7], x[3 * 455 * 7], y[3 * 455 * 7];
} catheter;

static catheter *catheter_new(double (*young)(const cn_body *, int), double inertia)
{
    catheter *c = calloc(1, sizeof *c);
    c->body = body_sweep(section_disc(6, 0.675e-3), 455, 1);
    c->a = pattern_of(&c->body);
    add_elastic(c->a, &c->body, young, 0.45, 1100, inertia);
    for (int i = 0; i < c->a->n; i++) {
        c->level[i] = i / 7;
        c->fixed[i] = i >= 454 * 7;
    }
    for (int i = 0; i < 3 * c->a->n; i++)
        c->b[i] = 1e-6 * cos(0.1 * i);
    return c;
}

static void catheter_free(catheter *c)
{
    cn_matrix_free(c->a);
    body_drop(&c->body);
    free(c);
}

/* Largest |b - A x| against |A||x| + |b|, row by row (Oettli and Prager 1964), rows not fixed. */
static double backward_error(const catheter *c, int nactive)
{
    double worst = 0;
    for (int i = 0; i < 3 * nactive; i++) {
        double sum = c->b[i], scale = fabs(c->b[i]);
        for (int k = c->a->row[i / 3]; k < c->a->row[i / 3 + 1]; k++)
            for (int j = 0; j < 3 && c->a->col[k] < nactive; j++) {
                const double term = c->a->value[9 * k + 3 * (i % 3) + j] * c->x[3 * c->a->col[k] + j];
                sum -= term;
                scale += fabs(term);
            }
        if (!c->fixed[i / 3] && !(fabs(sum) <= worst * scale)) worst = fabs(sum) / scale;
    }
    return worst;
}

static void a_stiff_catheter_is_solved_to_rounding(void **state)
{
    (void)state;
    for (int soft = 0; soft < 2; soft++)
        for (int quasistatic = 0; quasistatic < 2 - soft; quasistatic++) {
            catheter *c = catheter_new(soft ? contrast : steel, quasistatic ? 0 : 1e4);
            for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_CHAIN;
                 kind += CN_LINEAR_CHAIN - CN_LINEAR_CHOLESKY)
                for (int nactive = c->a->n; nactive > 0; nactive -= quasistatic ? c->a->n : 7 * 200) {
                    cn_solver *solver;
                    assert_int_equal(cn_solver_new(&solver, c->a, kind, c->level, NULL), CN_OK);
                    assert_int_equal(cn_solver_factor(solver, c->a, nactive, c->fixed, NULL), CN_OK);
                    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 0, 0, NULL, NULL, NULL), CN_OK);
                    assert_true(backward_error(c, nactive) < 1e-14);
                    cn_solver_free(solver);
                }
            catheter_free(c);
        }
}

static void threads_change_no_bit(void **state)
{
    catheter *c = catheter_new(steel, 1e8);
    cn_pool *pool;
    double residual[2];

    (void)state;
    assert_int_equal(cn_pool_new(&pool, 2), CN_OK);
    for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_PCG; kind++)
        for (int nactive = 70; nactive <= c->a->n; nactive += c->a->n - 70) {
            cn_solver *solver;
            memset(c->x, 0, sizeof c->x);
            memset(c->y, 0, sizeof c->y);
            assert_int_equal(cn_solver_new(&solver, c->a, kind, NULL, NULL), CN_OK);
            assert_int_equal(cn_solver_factor(solver, c->a, nactive, c->fixed, NULL), CN_OK);
            cn_solver_solve(solver, c->b, c->x, 1e-3, 50, NULL, &residual[0], NULL);
            assert_int_equal(cn_solver_factor(solver, c->a, nactive, c->fixed, pool), CN_OK);
            cn_solver_solve(solver, c->b, c->y, 1e-3, 50, NULL, &residual[1], pool);
            assert_memory_equal(c->x, c->y, sizeof c->x);
            assert_true(residual[0] == residual[1]);
            cn_solver_free(solver);
        }
    cn_pool_free(pool);
    catheter_free(c);
}

static void units_change_nothing_but_the_scale(void **state)
{
    catheter *c = catheter_new(steel, 1e4);
    const double scale = 0x1p-60;

    (void)state;
    for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_PCG; kind++) {
        cn_solver *solver;
        memset(c->x, 0, sizeof c->x);
        memset(c->y, 0, sizeof c->y);
        assert_int_equal(cn_solver_new(&solver, c->a, kind, c->level, NULL), CN_OK);
        assert_int_equal(cn_solver_factor(solver, c->a, c->a->n, c->fixed, NULL), CN_OK);
        cn_solver_solve(solver, c->b, c->x, 1e-3, 20, NULL, NULL, NULL);
        for (int k = 0; k < 9 * c->a->nblock; k++)
            c->a->value[k] *= scale;
        assert_int_equal(cn_solver_factor(solver, c->a, c->a->n, c->fixed, NULL), CN_OK);
        cn_solver_solve(solver, c->b, c->y, 1e-3, 20, NULL, NULL, NULL);
        for (int k = 0; k < 9 * c->a->nblock; k++)
            c->a->value[k] /= scale;
        for (int i = 0; i < 3 * c->a->n; i++)
            assert_true(c->x[i] == c->y[i] * scale);
        cn_solver_free(solver);
    }
    catheter_free(c);
}

static void an_indefinite_matrix_is_refused_and_the_next_one_taken(void **state)
{
    cn_body body = body_sweep(section_disc(6, 1), 40, 20);
    cn_matrix *a = pattern_of(&body);
    double b[3 * 280], x[3 * 280] = {0};

    (void)state;
    for (int i = 0; i < 3 * 280; i++)
        b[i] = 1;
    for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_PCG; kind++) {
        cn_solver *solver;
        fill_dominant(a, 1);
        assert_int_equal(cn_solver_new(&solver, a, kind, NULL, NULL), CN_OK);
        for (int node = 0; node < 280; node += 93) {
            double *v = a->value + 9 * a->diagonal[node] + 4;
            const double good = *v, bad[] = {-1, 0, NAN, INFINITY, -INFINITY};
            for (int k = 0; k < 5; k++) {
                *v = bad[k];
                assert_int_equal(cn_solver_factor(solver, a, 280, NULL, NULL), CN_ERR_SINGULAR);
                assert_int_equal(cn_solver_solve(solver, b, x, 1e-3, 10, NULL, NULL, NULL), CN_ERR_ARG);
            }
            *v = good;
            assert_int_equal(cn_solver_factor(solver, a, 280, NULL, NULL), CN_OK);
            assert_int_equal(cn_solver_solve(solver, b, x, 1e-3, 100, NULL, NULL, NULL), CN_OK);
        }
        cn_solver_free(solver);
    }
    cn_matrix_free(a);
    body_drop(&body);
}

static void cg_meets_negative_curvature_and_says_so(void **state)
{
    cn_body body = body_sweep(section_disc(6, 1), 10, 5);
    cn_matrix *a = pattern_of(&body);
    cn_solver *solver;
    double b[3 * 70], x[3 * 70] = {0};

    (void)state;
    for (int i = 0; i < a->n; i++) /* 1 on the diagonal, -1 beside it: eigenvalue 1 - 6 for the constant */
        for (int k = a->row[i]; k < a->row[i + 1]; k++)
            for (int c = 0; c < 3; c++)
                a->value[9 * k + 4 * c] = a->col[k] == i ? 1 : -1;
    for (int i = 0; i < 3 * 70; i++)
        b[i] = 1;
    assert_int_equal(cn_solver_new(&solver, a, CN_LINEAR_CG, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_factor(solver, a, 70, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_solve(solver, b, x, 1e-3, 100, NULL, NULL, NULL), CN_ERR_SINGULAR);
    cn_solver_free(solver);
    cn_matrix_free(a);
    body_drop(&body);
}

static void a_free_body_without_mass_is_singular(void **state)
{
    cn_body body = body_sweep(section_disc(6, 1e-3), 20, 0.04);
    cn_matrix *a = pattern_of(&body);

    (void)state;
    add_elastic(a, &body, steel, 0.3, 0, 0);
    for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_CHAIN;
         kind += CN_LINEAR_CHAIN - CN_LINEAR_CHOLESKY) {
        cn_solver *solver;
        unsigned char fixed[20 * 7] = {1, 1, 1};
        assert_int_equal(cn_solver_new(&solver, a, kind, NULL, NULL), CN_OK);
        assert_int_equal(cn_solver_factor(solver, a, a->n, NULL, NULL), CN_ERR_SINGULAR);
        assert_int_equal(cn_solver_factor(solver, a, a->n, fixed, NULL), CN_OK); /* three nodes hold it */
        cn_solver_free(solver);
    }
    cn_matrix_free(a);
    body_drop(&body);
}

static void cg_starts_warm_stops_at_its_tolerance_and_counts(void **state)
{
    catheter *c = catheter_new(steel, 1e14);
    cn_solver *solver;
    int cold = 0, warm = 0, one = 0;
    double residual;

    (void)state;
    assert_int_equal(cn_solver_new(&solver, c->a, CN_LINEAR_CG, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_factor(solver, c->a, c->a->n, c->fixed, NULL), CN_OK);
    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 1e-6, 5000, &cold, &residual, NULL), CN_OK);
    assert_true(cold > 1 && residual > 0 && residual <= 1e-6);
    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 1e-6, 5000, &warm, &residual, NULL), CN_OK);
    assert_int_equal(warm, 0);
    memset(c->x, 0, sizeof c->x);
    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 1e-6, 1, &one, &residual, NULL), CN_ERR_CONVERGENCE);
    assert_int_equal(one, 1);
    assert_true(residual > 1e-6);
    memset(c->b, 0, sizeof c->b);
    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 1e-6, 5000, &one, &residual, NULL), CN_OK);
    for (int i = 0; i < 3 * c->a->n; i++)
        assert_true(c->x[i] == 0);
    c->b[30] = NAN;
    assert_int_equal(cn_solver_solve(solver, c->b, c->x, 1e-6, 5000, &one, &residual, NULL),
                     CN_ERR_NOT_FINITE);
    cn_solver_free(solver);
    catheter_free(c);
}

static void auto_takes_what_the_shape_asks_for(void **state)
{
    cn_body rod = shape(0, 11), cube = body_sweep(section_square(12, 1), 13, 1);
    cn_body small = body_sweep(section_square(6, 1), 7, 1);
    const cn_body *const shapes[] = {&rod, &small, &cube};
    const cn_linear expected[] = {CN_LINEAR_CHAIN, CN_LINEAR_CHOLESKY, CN_LINEAR_PCG};

    (void)state;
    for (int s = 0; s < 3; s++) {
        cn_matrix *a = pattern_of(shapes[s]);
        cn_solver *solver;
        assert_int_equal(cn_solver_new(&solver, a, CN_LINEAR_AUTO, NULL, NULL), CN_OK);
        assert_int_equal(cn_solver_kind(solver), expected[s]);
        cn_solver_free(solver);
        cn_matrix_free(a);
    }
    body_drop(&rod);
    body_drop(&small);
    body_drop(&cube);
}

static void levels_that_do_not_fit_are_refused(void **state)
{
    catheter *c = catheter_new(steel, 1);
    cn_solver *solver;
    cn_error error = {0};

    (void)state;
    c->level[700] += 2;
    assert_int_equal(cn_solver_new(&solver, c->a, CN_LINEAR_CHAIN, c->level, &error), CN_ERR_ARG);
    assert_null(solver);
    assert_true(error.message[0]);
    c->level[700] = -1;
    assert_int_equal(cn_solver_new(&solver, c->a, CN_LINEAR_CHAIN, c->level, NULL), CN_ERR_ARG);
    c->level[700] = 100;
    assert_int_equal(cn_solver_new(&solver, c->a, CN_LINEAR_CHAIN, c->level, NULL), CN_OK);
    assert_int_equal(cn_solver_factor(solver, c->a, c->a->n + 1, NULL, NULL), CN_ERR_ARG);
    assert_int_equal(cn_solver_factor(solver, c->a, -1, NULL, NULL), CN_ERR_ARG);
    cn_solver_free(solver);
    cn_solver_free(NULL);
    catheter_free(c);
}

/* SuiteSparse's own allocations, counted and failing at will. */
static long suite_count, suite_fail = -1;
static bool suite_fired;

static bool suite_fails(void)
{
    const bool now = suite_count++ == suite_fail;
    suite_fired = suite_fired || now;
    return now;
}

void *__real_malloc(size_t size);
void *__real_calloc(size_t n, size_t size);
void *__real_realloc(void *old, size_t size);

static void *suite_malloc(size_t size)
{
    return suite_fails() ? NULL : __real_malloc(size);
}

static void *suite_calloc(size_t n, size_t size)
{
    return suite_fails() ? NULL : __real_calloc(n, size);
}

static void *suite_realloc(void *old, size_t size)
{
    return suite_fails() ? NULL : __real_realloc(old, size);
}

static void suite_fail_at(long n)
{
    SuiteSparse_config.malloc_func = suite_malloc;
    SuiteSparse_config.calloc_func = suite_calloc;
    SuiteSparse_config.realloc_func = suite_realloc;
    suite_fail = n;
    suite_count = 0;
    suite_fired = false;
}

static void factor_and_solve_allocate_nothing(void **state)
{
    catheter *c = catheter_new(steel, 1e8);

    (void)state;
    for (int kind = CN_LINEAR_CHOLESKY; kind <= CN_LINEAR_CHAIN; kind++) {
        cn_solver *solver;
        double residual;
        assert_int_equal(cn_solver_new(&solver, c->a, kind, NULL, NULL), CN_OK);
        fail_alloc_at(-1);
        suite_fail_at(-1);
        for (int run = 0; run < 3; run++) {
            assert_int_equal(cn_solver_factor(solver, c->a, c->a->n - 7 * run, c->fixed, NULL), CN_OK);
            cn_solver_solve(solver, c->b, c->x, 1e-3, 5, NULL, &residual, NULL);
        }
        assert_int_equal(suite_count, 0); /* CHOLMOD's simplicial refactor and its solve */
        assert_int_equal(fail_alloc_count(), 0);
        cn_solver_free(solver);
    }
    catheter_free(c);
}

static void a_supernodal_refactor_allocates_two_blocks(void **state)
{
    cn_body body = body_sweep(section_square(10, 1), 11, 1);
    cn_matrix *a = pattern_of(&body);
    cn_solver *solver;
    double *b = calloc(3 * (size_t)a->n, sizeof *b);

    (void)state;
    fill_dominant(a, 1);
    assert_int_equal(cn_solver_new(&solver, a, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    assert_int_equal(cn_solver_factor(solver, a, a->n, NULL, NULL), CN_OK);
    suite_fail_at(-1);
    assert_int_equal(cn_solver_factor(solver, a, a->n, NULL, NULL), CN_OK);
    assert_int_equal(suite_count, 2);
    suite_fail_at(-1);
    assert_int_equal(cn_solver_solve(solver, b, b, 0, 0, NULL, NULL, NULL), CN_OK);
    assert_int_equal(suite_count, 0);
    for (long n = 0; n < 2; n++) {
        suite_fail_at(n);
        assert_int_equal(cn_solver_factor(solver, a, a->n, NULL, NULL), CN_ERR_MEMORY);
    }
    suite_fail_at(-1);
    assert_int_equal(cn_solver_factor(solver, a, a->n, NULL, NULL), CN_OK);
    cn_solver_free(solver);
    free(b);
    cn_matrix_free(a);
    body_drop(&body);
}

static void every_failing_allocation_is_reported(void **state)
{
    cn_body rod = shape(0, 1), cube = body_sweep(section_square(6, 1), 7, 1);
    cn_matrix *const a[] = {pattern_of(&rod), pattern_of(&cube)};

    (void)state;
    for (int s = 0; s < 2; s++)
        for (int kind = CN_LINEAR_AUTO; kind <= CN_LINEAR_PCG; kind++)
            for (int own = 0; own < 2; own++) {
                bool fired = true;
                for (long n = 0; fired; n++) {
                    cn_solver *solver;
                    cn_error error = {0};
                    suite_fail_at(own ? -1 : n);
                    fail_alloc_at(own ? n : -1);
                    const cn_status status = cn_solver_new(&solver, a[s], kind, NULL, &error);
                    fired = own ? fail_alloc_fired() : suite_fired;
                    fail_alloc_at(-1);
                    if (own || !fired) {
                        assert_int_equal(status, fired ? CN_ERR_MEMORY : CN_OK);
                    } else { /* an ordering that finds no memory may be made up for by the other */
                        assert_true(status == CN_ERR_MEMORY || status == CN_OK);
                    }
                    assert_true((status == CN_OK) == !!solver);
                    assert_int_equal(error.status, status);
                    cn_solver_free(solver);
                }
            }
    suite_fail_at(-1);
    cn_matrix_free(a[0]);
    cn_matrix_free(a[1]);
    body_drop(&rod);
    body_drop(&cube);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_solver_agrees_with_dense_elimination),
        cmocka_unit_test(every_vector_width_gives_the_same_chain),
        cmocka_unit_test(a_stiff_catheter_is_solved_to_rounding),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(units_change_nothing_but_the_scale),
        cmocka_unit_test(an_indefinite_matrix_is_refused_and_the_next_one_taken),
        cmocka_unit_test(cg_meets_negative_curvature_and_says_so),
        cmocka_unit_test(a_free_body_without_mass_is_singular),
        cmocka_unit_test(cg_starts_warm_stops_at_its_tolerance_and_counts),
        cmocka_unit_test(auto_takes_what_the_shape_asks_for),
        cmocka_unit_test(levels_that_do_not_fit_are_refused),
        cmocka_unit_test(factor_and_solve_allocate_nothing),
        cmocka_unit_test(a_supernodal_refactor_allocates_two_blocks),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
