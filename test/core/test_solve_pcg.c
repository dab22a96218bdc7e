/* test_solve_pcg.c - CG with a coarse space of rigid aggregates: against CHOLMOD, iterations that size,
 * stiffness and bending leave bounded, contrasts, parts apart, held nodes, what it refuses and what it falls
 * back on. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "fail_alloc.h"
#include "solve_cases.h"
#include "solve_parts.h"

static double stiffness;

static double young(const cn_body *body, int e)
{
    (void)body, (void)e;
    return stiffness;
}

static double contrast(const cn_body *body, int e)
{
    return e < body->ntet / 2 ? 200e9 : 20e3;
}

/* A cube of cells (0.2 m), its matrix at dt 10 ms and a load that has long waves and short ones. */
typedef struct {
    cn_body body;
    cn_matrix *a;
    cn_solver *solver;
    double *b, *x;
    unsigned char *fixed;
} cube;

static cube cube_new(int cells, double (*law)(const cn_body *, int), double poisson)
{
    cube c = {.body = body_sweep(section_square(cells, 0.2), cells + 1, 0.2)};
    const cn_body *const bodies[] = {&c.body};
    const size_t n = (size_t)c.body.nnode;
    assert_int_equal(cn_matrix_new(&c.a, 1, bodies, (int[]){0}), CN_OK);
    add_elastic(c.a, &c.body, law, poisson, 1100, 1e4);
    c.b = malloc(3 * n * sizeof *c.b), c.x = calloc(3 * n, sizeof *c.x), c.fixed = calloc(n, 1);
    for (size_t i = 0; i < 3 * n; i++)
        c.b[i] = cos(7 * c.body.rest[i - i % 3 + (i + 1) % 3]) + 0.1 * cos((double)i);
    return c;
}

static void cube_drop(cube *c)
{
    cn_solver_free(c->solver);
    cn_matrix_free(c->a);
    body_drop(&c->body);
    free(c->b), free(c->x), free(c->fixed);
}

static void start(cube *c, cn_linear kind, bool placed)
{
    cn_solver_free(c->solver);
    assert_int_equal(cn_solver_new(&c->solver, c->a, kind, NULL, NULL), CN_OK);
    if (placed) cn_solver_place(c->solver, c->body.rest);
    assert_int_equal(cn_solver_factor(c->solver, c->a, c->a->n, c->fixed, NULL), CN_OK);
    memset(c->x, 0, 3 * (size_t)c->a->n * sizeof *c->x);
}

static int iterations_to(cube *c, double tolerance)
{
    int iterations;
    double residual;
    assert_int_equal(cn_solver_solve(c->solver, c->b, c->x, tolerance, 2000, &iterations, &residual, NULL),
                     CN_OK);
    assert_true(residual <= tolerance);
    return iterations;
}

static void it_agrees_with_elimination(void **state)
{
    (void)state;
    stiffness = 5e7;
    for (int variant = 0; variant < 4; variant++) {
        cube c = cube_new(6, variant == 3 ? contrast : young, 0.33);
        const int n = c.a->n;
        double *exact = malloc(3 * sizeof *exact * (size_t)n), most = 0, off = 0;
        for (int i = 0; i < n && variant; i++) /* a face, and some in the middle */
            c.fixed[i] = c.body.rest[3 * i + 2] == 0 || (variant == 2 && i % 11 == 0);
        start(&c, CN_LINEAR_CHOLESKY, false);
        iterations_to(&c, 1e-10);
        memcpy(exact, c.x, 3 * sizeof *exact * (size_t)n);
        start(&c, CN_LINEAR_PCG, variant != 1);
        iterations_to(&c, variant == 3 ? 1e-3 : 1e-10);
        for (int i = 0; i < 3 * n; i++) {
            most = fmax(most, fabs(exact[i])), off = fmax(off, fabs(exact[i] - c.x[i]));
            assert_true(!c.fixed[i / 3] || c.x[i] == 0);
        }

        assert_true(off <= (variant == 3 ? 1e-4 : 1e-8) * most); /* residual times condition */
        free(exact);
        cube_drop(&c);
    }
}

static void iterations_hardly_grow_with_size_and_stiffness(void **state)
{
    static const double modulus[] = {20e3, 5e7, 1.5e8, 158e9};
    (void)state;
    for (int k = 0; k < 4; k++)
        for (int cells = 8; cells <= 16; cells *= 2) {
            stiffness = modulus[k];
            cube c = cube_new(cells, young, 0.33);
            start(&c, CN_LINEAR_PCG, true);
            assert_in_range(iterations_to(&c, 1e-3), 1, 70);
            cube_drop(&c);
        }
}

static void turning_aggregates_are_worth_their_place(void **state)
{
    (void)state;
    stiffness = 158e9;
    cube c = cube_new(12, young, 0.33);
    start(&c, CN_LINEAR_PCG, true);
    const int placed = iterations_to(&c, 1e-3);
    start(&c, CN_LINEAR_PCG, false);
    const int shifted = iterations_to(&c, 1e-3);
    start(&c, CN_LINEAR_CG, false);
    const int plain = iterations_to(&c, 1e-3);
    assert_true(placed < shifted && shifted < plain && 3 * placed < plain);
    cube_drop(&c);
}

static void threads_change_no_bit(void **state)
{
    cn_pool *pool;
    (void)state;
    stiffness = 5e7;
    cube c = cube_new(10, young, 0.33);
    const size_t size = 3 * sizeof *c.x * (size_t)c.a->n;
    double *one = malloc(size), residual;
    start(&c, CN_LINEAR_PCG, true);
    cn_solver_solve(c.solver, c.b, c.x, 1e-6, 30, NULL, &residual, NULL);
    memcpy(one, c.x, size);
    memset(c.x, 0, size);
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    assert_int_equal(cn_solver_factor(c.solver, c.a, c.a->n, c.fixed, pool), CN_OK);
    cn_solver_solve(c.solver, c.b, c.x, 1e-6, 30, NULL, &residual, pool);
    assert_memory_equal(one, c.x, size);
    cn_pool_free(pool);
    free(one);
    cube_drop(&c);
}

static void where_it_is_slow_elimination_takes_over_and_hands_back(void **state)
{
    (void)state;
    cube c = cube_new(12, contrast, 0.4999);
    start(&c, CN_LINEAR_AUTO, true);
    assert_int_equal(cn_solver_kind(c.solver), CN_LINEAR_PCG);
    for (int run = 0; run < 3; run++) {
        memset(c.x, 0, 3 * (size_t)c.a->n * sizeof *c.x);
        assert_int_equal(cn_solver_factor(c.solver, c.a, c.a->n, c.fixed, NULL), CN_OK);
        const int iterations = iterations_to(&c, 1e-4);
        assert_true(run ? iterations <= 4 : iterations > 250);
    }
    cn_matrix_clear(c.a, c.a->n); /* an easy one, when its turn has come again */
    stiffness = 20e3;
    add_elastic(c.a, &c.body, young, 0.3, 1100, 1e4);
    int last = 0;
    for (int run = 0; run < 40; run++) {
        memset(c.x, 0, 3 * (size_t)c.a->n * sizeof *c.x);
        assert_int_equal(cn_solver_factor(c.solver, c.a, c.a->n, c.fixed, NULL), CN_OK);
        last = iterations_to(&c, 1e-3);
    }
    assert_in_range(last, 5, 60);
    cube_drop(&c);
}

static void negative_curvature_and_what_is_no_number_are_named(void **state)
{
    int iterations;
    (void)state;
    stiffness = 5e7;
    cube c = cube_new(6, young, 0.33);
    const int n = c.a->n;
    for (int i = 0; i < n; i++) /* inertia taken away five times over: diagonal blocks stay positive */
        for (int k = 0; k < 3; k++)
            c.a->value[9 * (size_t)c.a->diagonal[i] + 4 * (size_t)k] -= 5 * 1100 * 1e4 * 0.008 / n;
    cn_solver_free(c.solver);
    assert_int_equal(cn_solver_new(&c.solver, c.a, CN_LINEAR_PCG, NULL, NULL), CN_OK);
    cn_solver_place(c.solver, c.body.rest);
    cn_status status = cn_solver_factor(c.solver, c.a, n, NULL, NULL);
    if (status == CN_OK) status = cn_solver_solve(c.solver, c.b, c.x, 1e-6, 500, &iterations, NULL, NULL);
    assert_int_equal(status, CN_ERR_SINGULAR);
    for (int k = 0; k < 3; k++) {
        const double bad[] = {NAN, INFINITY, -1}, good = c.a->value[9 * (size_t)c.a->diagonal[100]];
        c.a->value[9 * (size_t)c.a->diagonal[100]] = bad[k];
        assert_int_equal(cn_solver_factor(c.solver, c.a, n, NULL, NULL), CN_ERR_SINGULAR);
        c.a->value[9 * (size_t)c.a->diagonal[100]] = good;
    }
    cn_matrix_clear(c.a, n);
    add_elastic(c.a, &c.body, young, 0.33, 1100, 1e4);
    start(&c, CN_LINEAR_PCG, true);
    c.b[30] = NAN;
    assert_int_equal(cn_solver_solve(c.solver, c.b, c.x, 1e-6, 500, NULL, NULL, NULL), CN_ERR_NOT_FINITE);
    c.b[30] = 1;
    double *where = malloc(3 * sizeof *where * (size_t)n); /* a place that is none: aggregates only shift */
    for (int i = 0; i < 3 * n; i++)
        where[i] = NAN;
    cn_solver_place(c.solver, where);
    memset(c.x, 0, 3 * sizeof *c.x * (size_t)n);
    assert_int_equal(cn_solver_factor(c.solver, c.a, n, NULL, NULL), CN_OK);
    iterations_to(&c, 1e-3);
    free(where);
    cube_drop(&c);
}

static void parts_apart_and_nodes_alone_are_solved_each(void **state)
{
    (void)state;
    stiffness = 5e7;
    cn_body body = body_sweep(section_square(4, 0.1), 30, 0.6);
    const cn_body *const bodies[] = {&body};
    cn_matrix *a;
    for (int t = 0; t < body.ntet; t++) { /* cut between stations 9 and 10, and leave station 29 alone */
        const int station = body.tet[4 * t] / 25;
        if (station == 9 || station == 28) memcpy(body.tet + 4 * t, body.tet, sizeof(int[4]));
    }
    assert_int_equal(cn_matrix_new(&a, 1, bodies, (int[]){0}), CN_OK);
    const size_t n = (size_t)a->n;
    add_elastic(a, &body, young, 0.33, 1100, 1e4);
    double *b = malloc(3 * n * sizeof *b), *x = calloc(3 * n, sizeof *x);
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++) {
            b[3 * i + k] = cos((double)(3 * i + k));
            if (i >= n - 25) a->value[9 * (size_t)a->diagonal[i] + 4 * k] = 2;
        }
    cn_solver *solver;
    double residual;
    assert_int_equal(cn_solver_new(&solver, a, CN_LINEAR_PCG, NULL, NULL), CN_OK);
    cn_solver_place(solver, body.rest);
    for (int nactive = (int)n; nactive > 0; nactive -= 150) { /* the rest is not touched */
        for (size_t i = 0; i < 3 * n; i++)
            x[i] = i < 3 * (size_t)nactive ? 0 : 7;
        assert_int_equal(cn_solver_factor(solver, a, nactive, NULL, NULL), CN_OK);
        assert_int_equal(cn_solver_solve(solver, b, x, 1e-9, 500, NULL, &residual, NULL), CN_OK);
        assert_true(residual <= 1e-9);
        for (size_t i = 3 * (size_t)nactive; i < 3 * n; i++)
            assert_true(x[i] == 7);
        for (size_t i = n - 25; i < (size_t)nactive; i++)
            assert_true(fabs(2 * x[3 * i] - b[3 * i]) < 1e-6);
    }
    cn_solver_free(solver);
    cn_matrix_free(a);
    free(b), free(x);
    body_drop(&body);
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    stiffness = 5e7;
    cube c = cube_new(5, young, 0.33);
    bool fired = true;
    for (long n = 0; fired; n++) {
        fail_alloc_at(n);
        const cn_status status = cn_solver_new(&c.solver, c.a, CN_LINEAR_PCG, NULL, NULL);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_int_equal(status, fired ? CN_ERR_MEMORY : CN_OK);
        assert_true(fired == !c.solver);
    }
    fail_alloc_at(-1);
    assert_int_equal(cn_solver_factor(c.solver, c.a, c.a->n, c.fixed, NULL), CN_OK);
    iterations_to(&c, 1e-3);
    assert_int_equal(fail_alloc_count(), 0);
    cube_drop(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_agrees_with_elimination),
        cmocka_unit_test(iterations_hardly_grow_with_size_and_stiffness),
        cmocka_unit_test(turning_aggregates_are_worth_their_place),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(where_it_is_slow_elimination_takes_over_and_hands_back),
        cmocka_unit_test(negative_curvature_and_what_is_no_number_are_named),
        cmocka_unit_test(parts_apart_and_nodes_alone_are_solved_each),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
