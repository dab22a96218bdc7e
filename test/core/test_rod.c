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

/* E(x), and its gradient and Hessian by central differences of sixth order of the energy and the force. */
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(exact_tangent_is_the_derivative_of_the_force_and_symmetric),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
