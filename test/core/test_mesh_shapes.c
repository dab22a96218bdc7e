/* Catheters, beams and obstacles made in code. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "catnav/mesh.h"
#include "catnav/vec3.h"
#include "mesh_files.h"
#include "mesh_parts.h"

static const double pi = 3.14159265358979323846;

/* Conforming: no face of three, and the boundary one closed manifold around exactly the volume. */
static void check_solid(const cn_tets *tets, double volume, int genus)
{
    cn_surface *boundary = NULL, *copy = NULL;
    cn_doctor doctor;
    cn_tets_doctor measured;
    cn_error error = {0};

    assert_int_equal(cn_tets_measure(tets, &measured, NULL), CN_OK);
    assert_true(measured.volume_min > 0);
    assert_int_equal(measured.nonmanifold_faces + measured.unused + measured.flat, 0);
    assert_int_equal(measured.components, 1);
    assert_true(fabs(measured.volume - volume) < 1e-12 * volume);
    assert_int_equal(cn_tets_boundary(&boundary, tets), CN_OK);
    boundary->vert = tets->node;
    assert_int_equal(cn_surface_copy(&copy, boundary), CN_OK);
    boundary->vert = NULL;
    assert_int_equal(cn_surface_check(copy, false, &doctor, NULL), CN_OK);
    if (cn_doctor_solid(&doctor, "boundary", &error) != CN_OK) fail_msg("%s", error.message);
    assert_true(fabs(doctor.volume - volume) < 1e-12 * volume);
    assert_int_equal(doctor.genus, genus);
    cn_surface_free(boundary);
    cn_surface_free(copy);
}

static double polygon_area(double diameter, int sides)
{
    return 0.5 * sides * sin(2 * pi / sides) * 0.25 * diameter * diameter;
}

static void the_papers_catheter_has_its_3185_nodes(void **state)
{
    cn_tets *t = NULL;
    (void)state;

    assert_int_equal(cn_tets_catheter(&t, 1.0, 1.35e-3, 0, 455, 6, NULL), CN_OK);
    assert_int_equal(t->nnode, 3185);
    assert_int_equal(t->ntet, 8172);
    assert_true(cn_norm(t->node) == 0);
    assert_true(t->node[3 * 7 * 454 + 2] == -1.0);
    for (int j = 0; j < 455; j++)
        for (int k = 0; k < 7; k++) {
            const double *x = t->node + 3 * (7 * j + k);
            assert_true(fabs(hypot(x[0], x[1]) - (k ? 0.675e-3 : 0)) < 1e-18);
            assert_true(x[2] == -1.0 * j / 454);
        }
    check_solid(t, polygon_area(1.35e-3, 6), 0);
    cn_tets_free(t);
}

static void catheters_of_any_sides_full_or_hollow_conform(void **state)
{
    (void)state;
    for (int sides = 3; sides <= 12; sides++)
        for (int hollow = 0; hollow < 2; hollow++)
            for (int stations = 2; stations < 6; stations++) {
                cn_tets *t = NULL;
                const double inner = hollow ? 1e-3 : 0;
                assert_int_equal(cn_tets_catheter(&t, 0.01, 2e-3, inner, stations, sides, NULL), CN_OK);
                assert_int_equal(t->nnode, stations * (hollow ? 2 * sides : sides + 1));
                check_solid(t, 0.01 * (polygon_area(2e-3, sides) - polygon_area(inner, sides)), hollow);
                cn_tets_free(t);
            }
}

/* Lumped quarter volumes, and the sums of x x', over the nodes of one station inside the chain: the same in
 * every direction of the section. */
static void no_direction_of_the_section_is_preferred(void **state)
{
    cn_tets *t = NULL;
    double second[3] = {0, 0, 0}, edges[3] = {0, 0, 0};
    (void)state;

    assert_int_equal(cn_tets_catheter(&t, 0.02, 2e-3, 0, 21, 6, NULL), CN_OK);
    for (int i = 0; i < t->ntet; i++) {
        const int *n = t->tet + 4 * i;
        const double v =
            cn_tet_volume6(t->node + 3 * n[0], t->node + 3 * n[1], t->node + 3 * n[2], t->node + 3 * n[3]);
        for (int a = 0; a < 4; a++) {
            const double *x = t->node + 3 * n[a];
            second[0] += v * x[0] * x[0], second[1] += v * x[1] * x[1], second[2] += v * x[0] * x[1];
            for (int b = 0; b < a; b++) { /* directions of the edges, weighted by volume */
                double e[3];
                cn_sub(x, t->node + 3 * n[b], e);
                edges[0] += v * e[0] * e[0], edges[1] += v * e[1] * e[1], edges[2] += v * e[0] * e[1];
            }
        }
    }
    assert_true(fabs(second[0] - second[1]) < 1e-12 * second[0] && fabs(second[2]) < 1e-12 * second[0]);
    assert_true(fabs(edges[0] - edges[1]) < 1e-12 * edges[0] && fabs(edges[2]) < 1e-12 * edges[0]);
    cn_tets_free(t);
}

static void catheter_arguments_out_of_range_are_refused_with_their_value(void **state)
{
    static const struct {
        double length, diameter, inner;
        int stations, sides;
        const char *says;
    } wrong[] = {{0, 1, 0, 2, 6, "length is 0"},          {NAN, 1, 0, 2, 6, "length is nan"},
                 {INFINITY, 1, 0, 2, 6, "length is inf"}, {1, -1, 0, 2, 6, "diameter is -1"},
                 {1, 1, 1, 2, 6, "inner diameter is 1"},  {1, 1, NAN, 2, 6, "inner diameter is nan"},
                 {1, 1, 0, 1, 6, "1 stations"},           {1, 1, 0, 2, 2, "2 sides"},
                 {1, 1, 0, 2, 1000, "1000 sides"},        {1, 1, 0, 2000000000, 6, "2000000000 stations"},
                 {1, 1, 0.5, 1000000, 256, "too many"}};
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        cn_tets *t = NULL;
        cn_error error = {0};
        assert_int_equal(cn_tets_catheter(&t, wrong[i].length, wrong[i].diameter, wrong[i].inner,
                                          wrong[i].stations, wrong[i].sides, &error),
                         CN_ERR_ARG);
        if (!strstr(error.message, wrong[i].says)) fail_msg("%s", error.message);
        assert_null(t);
    }
}

static void beams_conform_and_fill_their_box(void **state)
{
    const double size[3] = {0.3, 0.02, 0.1};
    (void)state;
    for (int nx = 1; nx <= 4; nx++)
        for (int ny = 1; ny <= 3; ny++)
            for (int nz = 1; nz <= 3; nz++) {
                cn_tets *t = NULL;
                assert_int_equal(cn_tets_beam(&t, size, (const int[]){nx, ny, nz}, NULL), CN_OK);
                assert_int_equal(t->nnode, (nx + 1) * (ny + 1) * (nz + 1));
                assert_int_equal(t->ntet, 6 * nx * ny * nz);
                assert_true(t->node[3 * (t->nnode - 1)] == 0.3 && t->node[3 * t->nnode - 1] == 0.1);
                check_solid(t, 0.3 * 0.02 * 0.1, 0);
                cn_tets_free(t);
            }
}

static void beam_arguments_out_of_range_are_refused(void **state)
{
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)state;
    assert_int_equal(cn_tets_beam(&t, (const double[]){1, 0, 1}, (const int[]){1, 1, 1}, &error), CN_ERR_ARG);
    assert_non_null(strstr(error.message, "size along y is 0"));
    assert_int_equal(cn_tets_beam(&t, (const double[]){1, 1, NAN}, (const int[]){1, 1, 1}, NULL), CN_ERR_ARG);
    assert_int_equal(cn_tets_beam(&t, (const double[]){1, 1, 1}, (const int[]){1, 1, 0}, NULL), CN_ERR_ARG);
    assert_int_equal(cn_tets_beam(&t, (const double[]){1, 1, 1}, (const int[]){9999, 9999, 9999}, NULL),
                     CN_ERR_ARG);
}

static void check_surface(cn_surface *s, double volume, double tolerance, int genus)
{
    cn_doctor doctor;
    cn_error error = {0};
    assert_int_equal(cn_surface_check(s, false, &doctor, NULL), CN_OK);
    assert_int_equal(doctor.merged + doctor.unused + doctor.degenerate, 0);
    if (cn_doctor_solid(&doctor, "shape", &error) != CN_OK) fail_msg("%s", error.message);
    assert_true(fabs(doctor.volume - volume) <= tolerance * volume);
    assert_int_equal(doctor.genus, genus);
    cn_surface_free(s);
}

static void spheres_and_boxes_are_closed_and_outward(void **state)
{
    const double centre[3] = {1, -2, 3}, radius = 0.25;
    cn_surface *s = NULL;
    (void)state;

    assert_int_equal(cn_surface_sphere(&s, centre, radius), CN_OK);
    for (int i = 0; i < s->nvert; i++)
        assert_true(fabs(cn_distance(s->vert + 3 * i, centre) - radius) < 1e-14);
    for (int i = 0; i < s->ntri; i++) { /* how far the faces lie inside */
        double m[3] = {0, 0, 0};
        for (int k = 0; k < 3; k++)
            cn_axpy(1.0 / 3, s->vert + 3 * s->tri[3 * i + k], m);
        assert_true(cn_distance(m, centre) > radius * (1 - 2e-3));
    }
    check_surface(s, 4 * pi / 3 * radius * radius * radius, 4e-3, 0);
    assert_int_equal(cn_surface_box(&s, (const double[]){-1, 0, 2}, (const double[]){1, 3, 4}), CN_OK);
    check_surface(s, 12, 1e-15, 0);
}

static void a_plane_looks_along_its_normal(void **state)
{
    const double point[3] = {1, 2, 3}, normal[3] = {2, -1, 0.5};
    cn_surface *s = NULL;
    double u[3], v[3], n[3];
    (void)state;

    assert_int_equal(cn_surface_plane(&s, point, normal, 10), CN_OK);
    cn_sub(s->vert + 3 * s->tri[1], s->vert + 3 * s->tri[0], u);
    cn_sub(s->vert + 3 * s->tri[2], s->vert + 3 * s->tri[0], v);
    cn_cross(u, v, n);
    /* 3 sqrt(3) r^2 is the area about an inscribed circle of radius r */
    assert_true(fabs(cn_dot(n, normal) - 600 * sqrt(3) * cn_norm(normal)) < 1e-9 * cn_dot(n, normal));
    for (int i = 0; i < 3; i++) {
        cn_sub(s->vert + 3 * i, point, u);
        assert_true(fabs(cn_dot(u, normal)) < 1e-12);
    }
    cn_surface_free(s);
}

static void a_straight_tube_is_a_prism_and_a_bent_one_closes(void **state)
{
    const double straight[6] = {0, 0, 0, 0, 0, 2}, radius[2] = {0.5, 0.5};
    double axis[3 * 41], radii[41];
    cn_surface *s = NULL;
    cn_doctor doctor;
    (void)state;

    assert_int_equal(cn_surface_tube(&s, 2, straight, radius, 0, 8), CN_OK);
    assert_int_equal(cn_surface_check(s, false, &doctor, NULL), CN_OK);
    assert_int_equal(doctor.loops, 2);
    assert_true(fabs(doctor.volume - 2 * polygon_area(1, 8)) < 1e-14);
    cn_surface_free(s);
    assert_int_equal(cn_surface_tube(&s, 2, straight, radius, 0.1, 8), CN_OK);
    check_surface(s, 2 * (polygon_area(1.2, 8) - polygon_area(1, 8)), 1e-14, 1);
    for (int i = 0; i <= 40; i++) { /* a helix of one and a half turns, its bore growing */
        const double a = 3 * pi * i / 40;
        axis[3 * i] = cos(a), axis[3 * i + 1] = sin(a), axis[3 * i + 2] = 0.2 * a;
        radii[i] = 0.1 + 0.002 * i;
    }
    assert_int_equal(cn_surface_tube(&s, 41, axis, radii, 0, 12), CN_OK);
    for (int i = 0; i <= 40; i++) /* rings stand around their own point */
        for (int k = 0; k < 12; k++)
            assert_true(fabs(cn_distance(s->vert + 3 * (12 * i + k), axis + 3 * i) - radii[i]) < 1e-14);
    assert_int_equal(cn_surface_check(s, false, &doctor, NULL), CN_OK);
    assert_true(doctor.loops == 2 && doctor.volume > 0 && doctor.crossing_pairs == 0);
    cn_surface_free(s);
    assert_int_equal(cn_surface_tube(&s, 41, axis, radii, 0.05, 12), CN_OK);
    /* Pappus: length times the mean section */
    check_surface(s, 3 * pi * sqrt(1.04) * (polygon_area(0.38, 12) - polygon_area(0.28, 12)), 2e-2, 1);
}

/* Twist-free: along a straight axis all rings have the same directions, also where it has many points. */
static void rings_do_not_twist(void **state)
{
    double axis[30], radius[10];
    cn_surface *s = NULL;
    (void)state;

    for (int i = 0; i < 10; i++)
        axis[3 * i] = 0.3 * i, axis[3 * i + 1] = 0.1 * i, axis[3 * i + 2] = -0.2 * i, radius[i] = 0.05;
    assert_int_equal(cn_surface_tube(&s, 10, axis, radius, 0, 5), CN_OK);
    for (int i = 1; i < 10; i++)
        for (int k = 0; k < 15; k++)
            assert_true(fabs(s->vert[15 * i + k] - axis[3 * i + k % 3] - s->vert[k]) < 1e-14);
    cn_surface_free(s);
}

static void surface_arguments_out_of_range_are_refused(void **state)
{
    const double zero[3] = {0, 0, 0}, one[3] = {1, 1, 1}, bad[3] = {0, NAN, 0};
    const double back[9] = {0, 0, 0, 1, 0, 0, 0, 0, 0}, twice[6] = {0, 0, 0, 0, 0, 0},
                 line[6] = {0, 0, 0, 1, 0, 0};
    const double radii[3] = {0.1, 0.1, 0.1}, none[2] = {0, 1};
    cn_surface *s = NULL;
    (void)state;

    assert_int_equal(cn_surface_sphere(&s, zero, 0), CN_ERR_ARG);
    assert_int_equal(cn_surface_sphere(&s, bad, 1), CN_ERR_ARG);
    assert_int_equal(cn_surface_sphere(&s, zero, NAN), CN_ERR_ARG);
    assert_int_equal(cn_surface_box(&s, one, zero), CN_ERR_ARG);
    assert_int_equal(cn_surface_box(&s, bad, one), CN_ERR_ARG);
    assert_int_equal(cn_surface_plane(&s, zero, zero, 1), CN_ERR_ARG);
    assert_int_equal(cn_surface_plane(&s, zero, one, -1), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 3, back, radii, 0, 6), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 2, twice, radii, 0, 6), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 2, line, none, 0, 6), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 2, line, radii, -1, 6), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 2, line, radii, 0, 2), CN_ERR_ARG);
    assert_int_equal(cn_surface_tube(&s, 1, line, radii, 0, 6), CN_ERR_ARG);
    assert_null(s);
}

static void every_allocation_may_fail(void **state)
{
    const double line[6] = {0, 0, 0, 1, 0, 0}, radii[2] = {0.1, 0.1};
    (void)state;
    for (int what = 0; what < 4; what++)
        for (long n = 0; allocation_fails(&n);) {
            cn_surface *s = NULL;
            cn_tets *t = NULL;
            cn_status status = CN_OK;
            if (what == 0) status = cn_surface_sphere(&s, line, 1);
            if (what == 1) status = cn_surface_tube(&s, 2, line, radii, 0.1, 6);
            if (what == 2) status = cn_tets_catheter(&t, 1, 0.1, 0, 3, 6, NULL);
            if (what == 3) status = cn_tets_beam(&t, (const double[]){1, 1, 1}, (const int[]){1, 1, 1}, NULL);
            assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
            cn_surface_free(s);
            cn_tets_free(t);
        }
}

/* No long edge is left, every vertex lies where the surface was, and what is closed stays so. */
static void a_cut_surface_is_the_same_shape_with_short_edges(void **state)
{
    (void)state;
    for (int c = 0; c < 12; c++) {
        const double size[3] = {1, 0.3 + 0.1 * c, 0.07 * (1 + c)}, longest = c % 3 ? 0.11 : 0.5;
        cn_surface *box, *cut;
        cn_doctor doctor;
        assert_int_equal(cn_surface_box(&box, (double[]){0, 0, 0}, size), CN_OK);
        assert_int_equal(cn_surface_cut(&cut, box, longest), CN_OK);
        for (int v = 0; v < cut->nvert; v++) {
            int on = 0;
            for (int k = 0; k < 3; k++) {
                const double x = cut->vert[3 * v + k];
                assert_true(x >= 0 && x <= size[k]);
                on += x == 0 || x == size[k];
            }
            assert_true(on > 0);
        }
        for (int e = 0; e < 3 * cut->ntri; e++)
            assert_true(cn_distance(cut->vert + 3 * cut->tri[e],
                                    cut->vert + 3 * cut->tri[e - e % 3 + (e + 1) % 3]) <= longest);
        assert_memory_equal(cut->vert, box->vert, 3 * (size_t)box->nvert * sizeof *box->vert);
        assert_int_equal(cn_surface_check(cut, true, &doctor, NULL), CN_OK);
        assert_true(doctor.closed && doctor.manifold && doctor.merged == 0 && doctor.degenerate == 0);
        assert_true(fabs(doctor.volume - size[0] * size[1] * size[2]) < 1e-12);
        cn_surface_free(cut);
        assert_int_equal(cn_surface_cut(&cut, box, 10), CN_OK); /* nothing to do */
        assert_int_equal(cut->ntri, box->ntri);
        cn_surface_free(cut);
        assert_int_equal(cn_surface_cut(&cut, box, c % 2 ? 0 : NAN), CN_ERR_ARG);
        assert_int_equal(cn_surface_cut(&cut, box, 1e-6), CN_ERR_ARG);
        assert_null(cut);
        cn_surface_free(box);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_papers_catheter_has_its_3185_nodes),
        cmocka_unit_test(catheters_of_any_sides_full_or_hollow_conform),
        cmocka_unit_test(no_direction_of_the_section_is_preferred),
        cmocka_unit_test(catheter_arguments_out_of_range_are_refused_with_their_value),
        cmocka_unit_test(beams_conform_and_fill_their_box),
        cmocka_unit_test(beam_arguments_out_of_range_are_refused),
        cmocka_unit_test(spheres_and_boxes_are_closed_and_outward),
        cmocka_unit_test(a_plane_looks_along_its_normal),
        cmocka_unit_test(a_straight_tube_is_a_prism_and_a_bent_one_closes),
        cmocka_unit_test(rings_do_not_twist),
        cmocka_unit_test(surface_arguments_out_of_range_are_refused),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(a_cut_surface_is_the_same_shape_with_short_edges),
    };
    return cmocka_run_group_tests_name("mesh_shapes", tests, NULL, NULL);
}
