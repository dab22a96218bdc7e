#include <limits.h>
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
#include "shapes.h"

static const double pi = 3.14159265358979323846;
static const int edge_of[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

/* Each node amid an edge lies half way, belongs to that edge alone, and no two are one. */
static void check_mids(const cn_tets *mesh)
{
    int(*edge)[2] = calloc((size_t)mesh->nnode, sizeof *edge);
    assert_non_null(edge);
    for (int i = 0; i < 6 * mesh->ntet; i++) {
        const int *e = edge_of[i % 6], *t = mesh->tet + 4 * (i / 6), mid = mesh->mid[i];
        const int low = t[e[0]] < t[e[1]] ? t[e[0]] : t[e[1]], high = t[e[0]] + t[e[1]] - low;
        assert_true(mid >= 0 && mid < mesh->nnode);
        if (edge[mid][1] == 0) edge[mid][0] = low, edge[mid][1] = high;
        assert_true(edge[mid][0] == low && edge[mid][1] == high);
        for (int k = 0; k < 3; k++)
            assert_true(mesh->node[3 * mid + k] ==
                        0.5 * mesh->node[3 * low + k] + 0.5 * mesh->node[3 * high + k]);
    }
    free(edge);
}

static void a_raised_box_has_its_corners_and_a_node_on_every_edge(void **state)
{
    (void)state;
    cn_tets *linear = shape_box(3, 2, 4, 0.1), *mesh;
    assert_int_equal(cn_tets_raise(&mesh, linear), CN_OK);
    assert_int_equal(mesh->nnode, 7 * 5 * 9); /* the grid of half the size */
    assert_int_equal(mesh->ntet, linear->ntet);
    assert_memory_equal(mesh->tet, linear->tet, 4 * (size_t)mesh->ntet * sizeof *mesh->tet);
    assert_memory_equal(mesh->node, linear->node, 3 * (size_t)linear->nnode * sizeof *mesh->node);
    check_mids(mesh);
    for (int i = 0; i < 6 * mesh->ntet; i++)
        assert_true(mesh->mid[i] >= linear->nnode);
    cn_tets *twice = NULL;
    assert_int_equal(cn_tets_raise(&twice, mesh), CN_ERR_ARG);
    assert_null(twice);
    cn_tets_free(mesh);
    cn_tets_free(linear);
}

/* Sections of equal size in order along -z, each plane; an element spans three of them, a station first. */
static void a_catheter_lies_section_by_section(void **state)
{
    (void)state;
    for (int hollow = 0; hollow < 2; hollow++)
        for (int sides = 3; sides < 10; sides++) {
            const int stations = 7, per = hollow ? 6 * sides : 3 * sides + 1,
                      few = hollow ? 2 * sides : sides + 1;
            cn_tets *mesh;
            assert_int_equal(cn_tets_catheter10(&mesh, 0.6, 0.1, hollow ? 0.06 : 0, stations, sides, NULL),
                             CN_OK);
            assert_int_equal(mesh->nnode, (2 * stations - 1) * per);
            check_mids(mesh);
            for (int i = 0; i < mesh->nnode; i++)
                assert_true(fabs(mesh->node[3 * i + 2] + 0.05 * (i / per)) < 1e-15);
            for (int i = 0; i < 4 * mesh->ntet; i++) {
                assert_true(mesh->tet[i] / per % 2 == 0 && mesh->tet[i] % per < few);
                assert_true(mesh->tet[i] / per >= i / 4 / (mesh->ntet / (stations - 1)) * 2);
                assert_true(mesh->tet[i] / per <= i / 4 / (mesh->ntet / (stations - 1)) * 2 + 2);
            }
            cn_tets_free(mesh);
        }
}

/* The section's second moment, by the outer and inner polygon, is the circle's or the tube's. */
static void the_rings_have_the_second_moment_of_the_circle(void **state)
{
    (void)state;
    for (int hollow = 0; hollow < 2; hollow++)
        for (int sides = 3; sides <= 12; sides++) {
            const double inner = hollow ? 0.06 : 0;
            cn_tets *mesh;
            double moment = 0;
            assert_int_equal(cn_tets_catheter10(&mesh, 0.6, 0.1, inner, 4, sides, NULL), CN_OK);
            for (int ring = 0; ring <= hollow; ring++) {
                const int first = hollow ? ring * sides : 1, sign = hollow && ring == 0 ? -1 : 1;
                for (int k = 0; k < sides; k++) {
                    const double *a = mesh->node + 3 * (first + k),
                                 *b = mesh->node + 3 * (first + (k + 1) % sides);
                    const double twice = a[0] * b[1] - a[1] * b[0];
                    moment += sign * twice / 12 * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]);
                }
            }
            assert_true(fabs(moment / (pi / 64 * (1e-4 - pow(inner, 4))) - 1) < 1e-13);
            cn_tets_free(mesh);
        }
}

static void catheters_out_of_range_are_refused_with_the_value_as_given(void **state)
{
    (void)state;
    cn_error error = {0};
    cn_tets *mesh = (cn_tets *)1;
    assert_int_equal(cn_tets_catheter10(&mesh, 1, -0.25, 0, 5, 6, &error), CN_ERR_ARG);
    assert_non_null(strstr(error.message, "-0.25"));
    assert_null(mesh);
    assert_int_equal(cn_tets_catheter10(&mesh, NAN, 1, 0, 5, 6, NULL), CN_ERR_ARG);
    assert_int_equal(cn_tets_catheter10(&mesh, 1, 1, 1, 5, 6, NULL), CN_ERR_ARG);
    assert_int_equal(cn_tets_catheter10(&mesh, 1, 1, 0, 1, 6, NULL), CN_ERR_ARG);
    assert_int_equal(cn_tets_catheter10(&mesh, 1, 1, 0, 5, 2, NULL), CN_ERR_ARG);
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    cn_tets *linear = shape_box(1, 2, 1, 1), *mesh;
    for (FAIL_EACH_ALLOC) {
        const cn_status status = cn_tets_raise(&mesh, linear);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_true((mesh != NULL) == (status == CN_OK));
        cn_tets_free(mesh);
    }
    for (FAIL_EACH_ALLOC) {
        cn_error error = {0};
        const cn_status status = cn_tets_catheter10(&mesh, 1, 0.1, 0.05, 3, 4, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_int_equal(error.status, status);
        cn_tets_free(mesh);
    }
    fail_alloc_at(-1);
    cn_tets_free(linear);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_raised_box_has_its_corners_and_a_node_on_every_edge),
        cmocka_unit_test(a_catheter_lies_section_by_section),
        cmocka_unit_test(the_rings_have_the_second_moment_of_the_circle),
        cmocka_unit_test(catheters_out_of_range_are_refused_with_the_value_as_given),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
