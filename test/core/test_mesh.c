/* Memory, placement, what FEM can use, the outer surface. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "catnav/mesh.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "mesh_files.h"
#include "mesh_parts.h"

static void new_meshes_are_zeroed_and_free_copes_with_nothing(void **state)
{
    cn_surface *surface = NULL;
    cn_tets *tets = NULL;

    (void)state;
    assert_int_equal(cn_surface_new(&surface, 2, 3), CN_OK);
    for (int i = 0; i < 6; i++)
        assert_true(surface->vert[i] == 0);
    cn_surface_free(surface);
    assert_int_equal(cn_tets_new(&tets, 0, 0), CN_OK);
    cn_tets_free(tets);
    assert_int_equal(cn_surface_new(&surface, -1, 0), CN_ERR_ARG);
    assert_int_equal(cn_tets_new(&tets, 0, -1), CN_ERR_ARG);
    cn_surface_free(NULL);
    cn_tets_free(NULL);
}

static void placement_scales_then_turns_then_moves(void **state)
{
    const cn_placement placement = {0.001, {0, 0, 1.57079632679489662}, {1, 2, 3}};
    double x[6] = {1000, 0, 0, 0, 500, 250};

    (void)state;
    cn_place_points(&placement, 2, x);
    assert_true(cn_distance(x, (const double[]){1, 3, 3}) < 1e-15);
    assert_true(cn_distance(x + 3, (const double[]){0.5, 2, 3.25}) < 1e-15);
}

/* A unit cube of 6 tetrahedra, spoilt one way. */
static cn_tets *cube(void)
{
    cn_tets *tets = NULL;
    assert_int_equal(cn_tets_beam(&tets, (const double[]){1, 1, 1}, (const int[]){1, 1, 1}, NULL), CN_OK);
    return tets;
}

static void refused(cn_tets *tets, cn_status status, const char *says)
{
    cn_error error = {0};
    int turned = -1;
    assert_int_equal(cn_tets_check(tets, &turned, &error), status);
    if (!strstr(error.message, says)) fail_msg("'%s' does not say '%s'", error.message, says);
    assert_int_equal(turned, -1);
    cn_tets_free(tets);
}

static void what_fem_cannot_use_is_refused_with_its_element(void **state)
{
    cn_tets *t;
    (void)state;

    t = cube(), t->tet[4 * 3 + 1] = 8;
    refused(t, CN_ERR_MESH, "tetrahedron 3 names node 8");
    t = cube(), t->tet[4 * 2] = -1;
    refused(t, CN_ERR_MESH, "tetrahedron 2 names node -1");
    t = cube(), t->tet[4 * 5 + 1] = t->tet[4 * 5];
    refused(t, CN_ERR_MESH, "tetrahedron 5 names node");
    t = cube(), t->node[3 * 4 + 2] = NAN;
    refused(t, CN_ERR_NOT_FINITE, "node 4 has coordinate nan");
    t = cube(), t->node[0] = INFINITY;
    refused(t, CN_ERR_NOT_FINITE, "node 0");
    t = cube(), memcpy(t->tet + 4, t->tet, 4 * sizeof(int));
    refused(t, CN_ERR_MESH, "tetrahedra 0 and 1 have the same four nodes");
    t = cube(), memcpy(t->tet + 4, t->tet, 4 * sizeof(int)), memcpy(t->tet + 8, t->tet, 4 * sizeof(int));
    refused(t, CN_ERR_MESH, "belongs to");
    t = cube(), t->ntet = 0;
    refused(t, CN_ERR_MESH, "0 tetrahedra");
    t = cube(), t->ntet = 1;
    refused(t, CN_ERR_MESH, "belongs to no tetrahedron");
    t = cube(); /* a corner pushed into the opposite face's plane */
    for (int k = 0; k < 3; k++)
        t->node[3 * t->tet[0] + k] =
            (t->node[3 * t->tet[1] + k] + t->node[3 * t->tet[2] + k] + t->node[3 * t->tet[3] + k]) / 3;
    refused(t, CN_ERR_MESH, "is flat");
}

static void flatness_does_not_depend_on_the_unit(void **state)
{
    (void)state;
    for (int e = -60; e <= 60; e += 20) {
        cn_tets *t = cube();
        for (int i = 0; i < 3 * t->nnode; i++)
            t->node[i] = ldexp(t->node[i], e);
        assert_int_equal(cn_tets_check(t, NULL, NULL), CN_OK);
        cn_tets_free(t);
    }
}

static void negative_tetrahedra_are_turned_and_counted(void **state)
{
    cn_tets *t = cube();
    int turned = 0;
    (void)state;

    for (int i = 0; i < 4; i++) {
        const int swap = t->tet[4 * i];
        t->tet[4 * i] = t->tet[4 * i + 1], t->tet[4 * i + 1] = swap;
    }
    assert_int_equal(cn_tets_check(t, &turned, NULL), CN_OK);
    assert_int_equal(turned, 4);
    assert_int_equal(cn_tets_check(t, &turned, NULL), CN_OK);
    assert_int_equal(turned, 0);
    cn_tets_free(t);
}

static void the_boundary_of_a_box_is_closed_outward_and_encloses_its_volume(void **state)
{
    cn_tets *t = NULL;
    cn_surface *s = NULL;
    cn_doctor doctor;
    (void)state;

    assert_int_equal(cn_tets_beam(&t, (const double[]){3, 2, 1}, (const int[]){3, 4, 2}, NULL), CN_OK);
    assert_int_equal(cn_tets_boundary(&s, t), CN_OK);
    assert_null(s->vert);
    assert_int_equal(s->nvert, t->nnode);
    assert_int_equal(s->ntri, 4 * (3 * 4 + 4 * 2 + 2 * 3));
    s->vert = t->node;
    cn_surface *copy = NULL;
    assert_int_equal(cn_surface_copy(&copy, s), CN_OK);
    s->vert = NULL;
    assert_int_equal(cn_surface_check(copy, false, &doctor, NULL), CN_OK);
    assert_true(doctor.closed && doctor.manifold && doctor.oriented && doctor.genus == 0);
    assert_true(fabs(doctor.volume - 6) < 1e-14);
    assert_int_equal(doctor.unused, 2 * 3 * 1);
    cn_surface_free(copy);
    cn_surface_free(s);
    cn_tets_free(t);
}

/* Regular tetrahedron: dihedral angles acos(1/3), quality and aspect 1. */
static void a_regular_tetrahedron_measures_as_such_in_any_unit(void **state)
{
    (void)state;
    for (int e = -40; e <= 40; e += 40) {
        const double h = ldexp(1, e);
        double node[12] = {h, h, h, -h, -h, h, -h, h, -h, h, -h, -h};
        int tet[4] = {0, 2, 1, 3};
        const cn_tets tets = {4, 1, node, tet, NULL};
        cn_tets_doctor d;
        assert_int_equal(cn_tets_measure(&tets, &d, NULL), CN_OK);
        assert_true(fabs(d.dihedral_min - 70.528779365509308) < 1e-12 &&
                    fabs(d.dihedral_max - d.dihedral_min) < 1e-12);
        assert_true(fabs(fabs(d.quality_min) - 1) < 1e-14 && fabs(d.aspect_max - 1) < 1e-14);
        assert_int_equal(d.boundary, 4);
        assert_int_equal(d.components, 1);
        assert_int_equal(d.inverted, d.volume < 0);
    }
}

static void sorted_facets_are_sorted_however_many_share_a_vertex(void **state)
{
    enum { N = 500 };
    cn_facet facet[N];
    (void)state;

    for (int i = 0; i < N; i++) /* all share vertex 0 */
        facet[i] = cn_facet_face(1 + i * 7 % 50, 0, 60 + i * 11 % 30, i);
    assert_int_equal(cn_facet_sort(100, N, facet), CN_OK);
    for (int i = 1; i < N; i++) {
        const int *a = facet[i - 1].key, *b = facet[i].key;
        const bool same = a[1] == b[1] && a[2] == b[2];
        assert_true(a[1] < b[1] ||
                    (a[1] == b[1] && (a[2] < b[2] || (same && facet[i - 1].item < facet[i].item))));
    }
}

static void every_allocation_may_fail(void **state)
{
    cn_tets *t = cube();
    (void)state;

    for (long n = 0; allocation_fails(&n);) {
        cn_surface *s = NULL;
        const cn_status status = cn_tets_boundary(&s, t);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        cn_surface_free(s);
    }
    for (long n = 0; allocation_fails(&n);) {
        cn_error error = {0};
        const cn_status status = cn_tets_check(t, NULL, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
    }
    for (long n = 0; allocation_fails(&n);) {
        cn_tets_doctor d;
        const cn_status status = cn_tets_measure(t, &d, NULL);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
    }
    cn_tets_free(t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(new_meshes_are_zeroed_and_free_copes_with_nothing),
        cmocka_unit_test(placement_scales_then_turns_then_moves),
        cmocka_unit_test(what_fem_cannot_use_is_refused_with_its_element),
        cmocka_unit_test(flatness_does_not_depend_on_the_unit),
        cmocka_unit_test(negative_tetrahedra_are_turned_and_counted),
        cmocka_unit_test(the_boundary_of_a_box_is_closed_outward_and_encloses_its_volume),
        cmocka_unit_test(a_regular_tetrahedron_measures_as_such_in_any_unit),
        cmocka_unit_test(sorted_facets_are_sorted_however_many_share_a_vertex),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("mesh", tests, NULL, NULL);
}
