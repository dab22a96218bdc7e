/* LINK: wrap */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/skin.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "shapes.h"
#include "tree.h"

static double volume_of(const cn_surface *s)
{
    double sum = 0, n[3];
    for (int t = 0; t < s->ntri; t++) {
        const int *c = s->tri + 3 * t;
        cn_cross(s->vert + 3 * c[0], s->vert + 3 * c[1], n);
        sum += cn_dot(n, s->vert + 3 * c[2]) / 6;
    }
    return sum;
}

/* Closed, manifold, outward, of `parts` components (0: any), and around every centre. */
static cn_surface *made(int n, const double *centre, const double *radius, double cell, int parts)
{
    cn_surface *s, *copy;
    cn_doctor doctor;
    cn_tree *tree;
    assert_int_equal(cn_surface_about_spheres(&s, n, centre, radius, cell, NULL), CN_OK);
    assert_int_equal(cn_surface_copy(&copy, s), CN_OK);
    assert_int_equal(cn_surface_check(copy, false, &doctor, NULL), CN_OK);
    assert_true(doctor.closed && doctor.manifold && doctor.oriented);
    assert_int_equal(doctor.merged, 0);
    assert_int_equal(doctor.unused, 0);
    assert_int_equal(doctor.degenerate, 0);
    assert_int_equal(doctor.nonmanifold_vertices, 0);
    assert_int_equal(doctor.crossing_pairs, 0);
    if (parts) assert_int_equal(doctor.components, parts);
    assert_int_equal(doctor.slivers, 0);
    assert_true(doctor.volume > 0);
    cn_surface_free(copy);
    assert_int_equal(cn_tree_new(&tree, s->ntri, s->tri, s->vert), CN_OK);
    for (int i = 0; i < n; i++)
        assert_true(cn_tree_inside(tree, NULL, centre + 3 * i));
    cn_tree_free(tree);
    return s;
}

static double sharpest(const cn_surface *s)
{
    cn_skin *skin;
    cn_skin_state *now;
    double found;
    const double origin[3] = {0};
    assert_int_equal(cn_skin_new(&skin, s, 1, origin, NULL, 1, NULL), CN_OK);
    assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
    assert_int_equal(cn_skin_update(skin, origin, NULL, now, NULL), CN_OK);
    assert_int_equal(cn_skin_sharpest(skin, now, &found), CN_OK);
    cn_skin_state_free(now);
    cn_skin_free(skin);
    return found;
}

static void one_sphere_is_a_sphere(void **state)
{
    (void)state;
    const double centre[3] = {0.3, -0.2, 0.7}, radius = 0.01, ball = 4 * acos(-1.0) / 3 * pow(radius, 3);
    double error[3], angle[3];
    for (int i = 0; i < 3; i++) {
        const double cell = radius / (2 << i);
        cn_surface *s = made(1, centre, &radius, i ? cell : 0, 1);
        for (int v = 0; v < s->nvert; v++)
            assert_true(fabs(cn_distance(s->vert + 3 * v, centre) - radius) < 1e-6 * radius);
        error[i] = 1 - volume_of(s) / ball, angle[i] = sharpest(s);
        print_message("cells of r / %d: %d vertices, volume %.2f %% less, sharpest edge %.1f degrees\n",
                      2 << i, s->nvert, 100 * error[i], angle[i] * 45 / atan(1));
        assert_true(error[i] > 0 && error[i] < 0.15 * pow(cell / radius, 2));
        cn_surface_free(s);
    }
    assert_true(angle[2] < 0.5 * angle[0]);
}

static void two_spheres_join_when_they_are_near(void **state)
{
    (void)state;
    const double radius[2] = {1, 1};
    for (int apart = 0; apart < 2; apart++) {
        const double centre[6] = {0, 0, 0, apart ? 3 : 2.7, 0.1, 0.2};
        cn_surface *s = made(2, centre, radius, 0.25, 1 + apart);
        cn_surface_free(s);
    }
}

/* A regular packing, whole and without hollows, its sides flat to what the header says. */
static void a_packing_has_one_flat_surface(void **state)
{
    (void)state;
    enum { N = 5 };
    double centre[3 * N * N * N], radius[N * N * N], low = INFINITY, high = 0;
    for (int i = 0; i < N * N * N; i++) {
        centre[3 * i] = 2 * (i % N), centre[3 * i + 1] = 2 * (i / N % N), centre[3 * i + 2] = 2 * (i / N / N);
        radius[i] = 1;
    }
    cn_surface *s = made(N * N * N, centre, radius, 0, 1);
    for (int v = 0; v < s->nvert; v++) {
        const double *x = s->vert + 3 * v;
        if (x[0] < 2 || x[0] > 6 || x[1] < 2 || x[1] > 6 || x[2] < 4) continue;
        low = fmin(low, x[2] - 8), high = fmax(high, x[2] - 8);
    }
    print_message("above a square layer: %.3f to %.3f r\n", low, high);
    assert_true(low > 0.97 && high < 1.05);
    assert_true(sharpest(s) < 0.6);
    cn_surface_free(s);
}

static void a_hollow_without_a_way_out_is_filled(void **state)
{
    (void)state;
    enum { N = 5 };
    double centre[3 * N * N * N], radius[N * N * N];
    int n = 0;
    for (int i = 0; i < N * N * N; i++) { /* the shell of the packing */
        const int at[3] = {i % N, i / N % N, i / N / N};
        bool inner = true;
        for (int k = 0; k < 3; k++)
            inner = inner && at[k] > 0 && at[k] < N - 1;
        if (inner) continue;
        for (int k = 0; k < 3; k++)
            centre[3 * n + k] = 2 * at[k];
        radius[n++] = 1;
    }
    cn_surface *s = made(n, centre, radius, 0, 1);
    assert_true(volume_of(s) > 900);
    cn_surface_free(s);
}

static void spheres_of_several_sizes_at_random(void **state)
{
    (void)state;
    enum { N = 40 };
    double centre[3 * N], radius[N];
    unsigned seed = 21;
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            centre[3 * i + k] = 2.5e-6 * shape_random(&seed); /* micrometres */
        radius[i] = 1e-6 * (0.75 + 0.25 * shape_random(&seed));
    }
    cn_surface_free(made(N, centre, radius, 0, 0));
}

static void what_is_no_sphere_is_refused(void **state)
{
    (void)state;
    double centre[6] = {0, 0, 0, 1e6, 0, 0}, radius[2] = {1, 1};
    cn_surface *s;
    cn_error error = {0};
#define REFUSED(status, words, ...)                                                                          \
    memset(&error, 0, sizeof error);                                                                         \
    assert_int_equal(cn_surface_about_spheres(&s, __VA_ARGS__, &error), status);                             \
    assert_null(s);                                                                                          \
    assert_non_null(strstr(error.message, words))
    REFUSED(CN_ERR_ARG, "needs a sphere", 0, centre, radius, 0);
    REFUSED(CN_ERR_ARG, "larger cells", 2, (double[]){0, 0, 0, 1e3, 1e3, 1e3}, radius, 0);
    REFUSED(CN_ERR_ARG, "larger cells", 1, centre, radius, 1e-3);
    REFUSED(CN_ERR_ARG, "too coarse", 1, centre, radius, 2.5);
    REFUSED(CN_ERR_ARG, "give a size", 1, centre, radius, -1);
    REFUSED(CN_ERR_ARG, "give a size", 1, centre, radius, NAN);
    radius[1] = 0;
    REFUSED(CN_ERR_ARG, "sphere 1 has radius 0", 2, centre, radius, 0);
    radius[1] = NAN;
    REFUSED(CN_ERR_ARG, "sphere 1", 2, centre, radius, 0);
    centre[4] = INFINITY;
    REFUSED(CN_ERR_NOT_FINITE, "sphere 1", 2, centre, radius, 0);
#undef REFUSED
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    const double centre[3] = {0}, radius = 1;
    for (FAIL_EACH_ALLOC) {
        cn_surface *s;
        cn_error error = {0};
        const cn_status status = cn_surface_about_spheres(&s, 1, centre, &radius, 0, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((s == NULL) == fail_alloc_fired());
        cn_surface_free(s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_sphere_is_a_sphere),
        cmocka_unit_test(two_spheres_join_when_they_are_near),
        cmocka_unit_test(a_packing_has_one_flat_surface),
        cmocka_unit_test(a_hollow_without_a_way_out_is_filled),
        cmocka_unit_test(spheres_of_several_sizes_at_random),
        cmocka_unit_test(what_is_no_sphere_is_refused),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
