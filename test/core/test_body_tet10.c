#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_face.h"
#include "body_fixture.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"

static const cn_material rubber = {.young = 1e5, .poisson = 0.3, .density = 1000};

static fixture setup(cn_tets *mesh, const cn_material *material)
{
    const fixture s = fixture_of(mesh, material);
    cn_tets_free(mesh);
    return s;
}

/* Cells of 0.1 m; curved: by a third of a cell over the body. */
static cn_tets *box(int n, bool curved)
{
    return shape_raised(shape_box(n, n, n, 0.1), curved ? 0.15 : 0, 0.1 * n);
}

static void a_turned_body_stores_nothing_and_pulls_at_nothing(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(2, curved), &rubber);
        for (unsigned seed = 1; seed < 30; seed++) {
            fixture_shake(&s, seed, 0);
            assert_true(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) < 1e-28 * 1e5);
            assert_true(largest(s.f, 3 * s.body->nnode) <
                        1e5 * 0.1 * 0.3 * 100 * DBL_EPSILON); /* E h |x| eps */
        }
        fixture_free(&s);
    }
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(1, curved), &rubber);
        const double h = 1e-7; /* [m] */
        fixture_shake(&s, 3, 0.015);
        fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
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
        fixture_free(&s);
    }
}

/* Columns of K against differences of the force, for a shake that leaves some points inverted too. */
static void exact_stiffness_is_minus_the_force_gradient(void **state)
{
    (void)state;
    for (int hard = 0; hard < 2; hard++) {
        fixture s = setup(box(1, hard), &rubber);
        const int n = 3 * s.body->nnode;
        double *up = numbers(n), *unit = numbers(n), *column = numbers(n);
        const double h = 1e-7; /* [m] */
        double worst = 0;
        fixture_shake(&s, 5, hard ? 0.03 : 0.01);
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        const double scale = largest(s.matrix->value, 9 * s.matrix->nblock);
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i];
            unit[i] = 1;
            cn_matrix_multiply(s.matrix, s.matrix->n, unit, column, NULL);
            unit[i] = 0;
            s.x[i] = xi + h;
            fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            memcpy(up, s.f, (size_t)n * sizeof *up);
            s.x[i] = xi - h;
            fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
            s.x[i] = xi;
            for (int k = 0; k < n; k++)
                worst = fmax(worst, fabs(column[k] + (up[k] - s.f[k]) / (2 * h)));
        }
        assert_true(worst < (hard ? 1e-4 : 1e-6) * scale);
        free(up), free(unit), free(column);
        fixture_free(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_turned_body_stores_nothing_and_pulls_at_nothing),
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(exact_stiffness_is_minus_the_force_gradient),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
