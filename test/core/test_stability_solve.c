/* Hard cases of the factorisation: scales from 1e-150 to 1e150, contrasts within one matrix, nearly singular
 * and indefinite ones, numbers that are none; every direct solver. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "shapes.h"
#include "solve.h"

static const cn_linear kinds[] = {CN_LINEAR_AUTO, CN_LINEAR_CHOLESKY, CN_LINEAR_CHAIN};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* A slender bar's stiffness at rest; young beyond x = 0.5: `far`. */
typedef struct {
    cn_tets *mesh;
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    unsigned char *fixed;
    double *b, *x, *rotation;
} bar;

static bar bar_new(double young, double far, double poisson)
{
    cn_region region = {.by_box = true, .box = {{0.5, -9, -9}, {9, 9, 9}}, .young = far};
    const cn_material m = {.young = young, .poisson = poisson, .density = 1, .nregion = 1, .region = &region};
    const int first = 0;
    bar s = {.mesh = shape_box(10, 1, 1, 0.1)};
    assert_int_equal(cn_body_new(&s.body, s.mesh, &m, NULL, NULL), CN_OK);
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    const size_t n = 3 * (size_t)s.body->nnode;
    s.fixed = calloc(n, 1), s.b = calloc(n, sizeof *s.b), s.x = calloc(n, sizeof *s.x);
    s.rotation = calloc(4 * (size_t)s.body->nturn, sizeof *s.rotation);
    assert_true(s.fixed && s.b && s.x && s.rotation);
    cn_body_rotation_start(s.body, s.rotation);
    cn_body_add_elastic(s.body, s.body->nnode, s.body->rest, s.rotation, s.b, CN_TANGENT_EXACT, 1, s.scatter,
                        NULL);
    return s;
}

static void bar_free(bar *s)
{
    cn_scatter_free(s->scatter), cn_matrix_free(s->matrix), cn_body_free(s->body), cn_tets_free(s->mesh);
    free(s->fixed), free(s->b), free(s->x), free(s->rotation);
}

static void hold_root(bar *s)
{
    for (int i = 0; i < s->body->nnode; i++)
        s->fixed[i] = s->mesh->node[3 * i] == 0;
}

static double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

/* *residual: |b - A x| / |b|; *backward: over |A| |x| instead, which no condition spoils. */
static cn_status factor_and_solve(bar *s, cn_linear kind, double scale, double *residual, double *backward)
{
    cn_solver *solver;
    unsigned seed = 4;
    assert_int_equal(cn_solver_new(&solver, s->matrix, kind, NULL, NULL), CN_OK);
    cn_status status = cn_solver_factor(solver, s->matrix, s->body->nnode, s->fixed, NULL);
    for (int i = 0; i < 3 * s->body->nnode; i++)
        s->b[i] = s->fixed[i / 3] ? 0 : scale * shape_random(&seed), s->x[i] = 0;
    if (status == CN_OK) status = cn_solver_solve(solver, s->b, s->x, 1e-13, 10, NULL, residual, NULL);
    if (status == CN_OK)
        *backward = *residual * largest(s->b, 3 * s->body->nnode) / largest(s->x, 3 * s->body->nnode) /
                    largest(s->matrix->value, 9 * s->matrix->nblock);
    cn_solver_free(solver);
    return status;
}

static void any_scale_and_any_contrast_is_solved(void **state)
{
    (void)state;
    const double young[][2] = {{1e-150, 1e-150}, {1e-20, 1e-20}, {1, 1},   {1e20, 1e20}, {1e150, 1e150},
                               {2e4, 2e11},      {2e11, 2e4},    {1, 1e9}, {1e9, 1}};
    double worst = 0, stated = 0;
    for (size_t y = 0; y < sizeof young / sizeof *young; y++)
        for (int k = 0; k < KINDS; k++)
            for (int nu = 0; nu < 2; nu++) {
                double residual = NAN, backward = NAN;
                bar s = bar_new(young[y][0], young[y][1], nu ? 0.4999 : 0.3);
                hold_root(&s);
                const double scale = fmin(young[y][0], young[y][1]) * 1e-3;
                assert_int_equal(factor_and_solve(&s, kinds[k], scale, &residual, &backward), CN_OK);
                for (int i = 0; i < 3 * s.body->nnode; i++)
                    assert_true(isfinite(s.x[i]));
                worst = fmax(worst, backward),
                stated = fmax(stated, young[y][0] >= young[y][1] ? residual : 0);
                assert_true(backward <= 1e-14);
                /* stiff at the root: what it holds back is soft, and the system well scaled */
                if (young[y][0] >= young[y][1]) assert_true(residual <= 1e-8);
                bar_free(&s);
            }
    print_message("scales 1e-150 to 1e150, contrasts to 1e9: |b - Ax| at most %.1e |A||x|; soft beyond stiff "
                  "%.1e |b|\n",
                  worst, stated);
}

/* Free, the bar has six motions that cost nothing: refused; 1e-9 of its stiffness on the diagonal makes it
 * definite, and it is solved. */
static void singular_is_refused_and_nearly_singular_is_solved(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++) {
        double residual = NAN, backward = NAN;
        bar s = bar_new(1e5, 1e5, 0.3);
        assert_int_equal(factor_and_solve(&s, kinds[k], 1, &residual, &backward), CN_ERR_SINGULAR);
        s.fixed[0] = 1; /* one node alone: three turns are left */
        assert_int_equal(factor_and_solve(&s, kinds[k], 1, &residual, &backward), CN_ERR_SINGULAR);
        s.fixed[0] = 0;
        for (int i = 0; i < s.body->nnode; i++)
            for (int d = 0; d < 3; d++)
                s.matrix->value[9 * (size_t)s.matrix->diagonal[i] + 4 * (size_t)d] += 1e-9 * 1e4;
        assert_int_equal(factor_and_solve(&s, kinds[k], 1e-5, &residual, &backward), CN_OK);
        print_message("solver %d, nearly singular (1e-9): residual %.1e, %.1e of |A||x|\n", k, residual,
                      backward);
        assert_true(backward <= 1e-14);
        bar_free(&s);
    }
}

static void indefinite_and_what_is_no_number_is_refused(void **state)
{
    (void)state;
    const double wrong[] = {NAN, INFINITY, -INFINITY, -1e3, -1e300};
    for (int k = 0; k < KINDS; k++)
        for (size_t w = 0; w < sizeof wrong / sizeof *wrong; w++)
            for (int at = 4; at < 44; at += 13) {
                double residual, backward;
                bar s = bar_new(1e5, 1e5, 0.3);
                hold_root(&s);
                s.matrix->value[9 * (size_t)s.matrix->diagonal[at]] = wrong[w];
                assert_int_not_equal(factor_and_solve(&s, kinds[k], 1, &residual, &backward), CN_OK);
                bar_free(&s);
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_scale_and_any_contrast_is_solved),
        cmocka_unit_test(singular_is_refused_and_nearly_singular_is_solved),
        cmocka_unit_test(indefinite_and_what_is_no_number_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
