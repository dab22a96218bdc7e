#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <jansson.h>

#include "body_beam.h"
#include "fail_alloc.h"
#include "shapes.h"

static const double pi = 3.14159265358979323846;

static double number(const json_t *json, const char *key)
{
    assert_true(json_is_number(json_object_get(json, key)));
    return json_number_value(json_object_get(json, key));
}

/* Triangulated disc of the reference: a centre and `rings` circles of per_ring * k nodes, or (rings 0) the
 * polygon alone as a fan. Returns the triangles; their corners ascending. */
static int disc(int rings, int per_ring, double radius, double (*place)[2], int (*tri)[3], int *nnode)
{
    int n = 0, ntri = 0, start[16] = {0};
    if (rings == 0) {
        for (int i = 0; i < per_ring; i++, n++)
            place[n][0] = radius * cos(2 * pi * i / per_ring),
            place[n][1] = radius * sin(2 * pi * i / per_ring);
        for (int i = 1; i + 1 < per_ring; i++, ntri++)
            tri[ntri][0] = 0, tri[ntri][1] = i, tri[ntri][2] = i + 1;
        *nnode = n;
        return ntri;
    }
    place[n][0] = place[n][1] = 0, n++;
    for (int k = 1; k <= rings; k++) {
        const int m = per_ring * k;
        start[k] = n;
        for (int i = 0; i < m; i++, n++) {
            place[n][0] = radius * k / rings * cos(2 * pi * i / m);
            place[n][1] = radius * k / rings * sin(2 * pi * i / m);
        }
    }
    for (int k = 1; k <= rings; k++) {
        const int inner = k == 1 ? 1 : per_ring * (k - 1), outer = per_ring * k;
        int i = k == 1 ? inner : 0, j = 0;
        while (i < inner || j < outer) {
            int *t = tri[ntri++];
            const int a = start[k - 1] + (k == 1 ? 0 : i % inner), b = start[k] + j % outer;
            const bool out = i >= inner || (j < outer && (j + 1) * inner <= (i + 1) * outer);
            t[0] = a, t[1] = b;
            t[2] = out ? start[k] + (j + 1) % outer : start[k - 1] + (i + 1) % inner;
            if (out)
                j++;
            else
                i++;
        }
    }
    for (int t = 0; t < ntri; t++)
        for (int pass = 0; pass < 2; pass++)
            for (int c = 0; c < 2; c++)
                if (tri[t][c] > tri[t][c + 1]) {
                    const int swap = tri[t][c];
                    tri[t][c] = tri[t][c + 1], tri[t][c + 1] = swap;
                }
    *nnode = n;
    return ntri;
}

/* Prisms over the triangles, each in three by the lowest-index rule, as in the reference. */
static cn_tets *extrude(int n, double (*place)[2], int ntri, int (*tri)[3], int sections, double spacing)
{
    cn_tets *mesh;
    int e = 0;
    assert_int_equal(cn_tets_new(&mesh, n * sections, 3 * ntri * (sections - 1)), CN_OK);
    for (int s = 0; s < sections; s++)
        for (int i = 0; i < n; i++) {
            double *x = mesh->node + 3 * (s * n + i);
            x[0] = place[i][0], x[1] = place[i][1], x[2] = s * spacing;
        }
    for (int s = 0; s + 1 < sections; s++)
        for (int t = 0; t < ntri; t++) {
            const int a = tri[t][0] + s * n, b = tri[t][1] + s * n, c = tri[t][2] + s * n;
            shape_put(mesh, e++, a, b, c, c + n);
            shape_put(mesh, e++, a, b, b + n, c + n);
            shape_put(mesh, e++, a, a + n, b + n, c + n);
        }
    return mesh;
}

static void near(double got, double want, double share)
{
    assert_true(fabs(got - want) <= share * fabs(want));
}

/* The reference clamps the other end; the same meshes, turned end for end, have the same stiffness. */
static void catheter_meshes_are_as_stiff_as_the_reference_found(void **state)
{
    (void)state;
    json_error_t error;
    FILE *file = reference_open("data/p1_catheter_stiffness.json");
    if (!file) skip();
    json_t *json = json_loadf(file, 0, &error);
    fclose(file);
    const json_t *cases = json_object_get(json, "cases");
    for (size_t i = 0; i < json_array_size(cases); i++) {
        const json_t *c = json_array_get(cases, i), *linear = json_object_get(c, "linear");
        const double d = number(c, "d"), young = number(c, "E"), nu = number(c, "nu");
        const double circle = pi * pow(d, 4) / 64, shear = young / (2 * (1 + nu));
        const cn_material material = {.young = young, .poisson = nu};
        const int rings = (int)number(c, "rings"), per_ring = (int)number(c, "per_ring");
        const int sections = (int)number(c, "sections");
        double place[400][2], got[CN_BEAM_LOADS], section[CN_BEAM_LOADS];
        int tri[800][3], n;
        const int ntri = disc(rings, per_ring, d / 2, place, tri, &n);
        cn_tets *mesh = extrude(n, place, ntri, tri, sections, number(c, "spacing"));
        assert_int_equal(cn_beam_stiffness(mesh, sections, 2, &material, got, section), CN_OK);
        near(section[CN_BEAM_AXIAL], young * pi * d * d / 4 * number(c, "polygon_area_over_circle"), 1e-12);
        near(section[CN_BEAM_BENDING_U], young * circle * number(c, "polygon_I_over_circle"), 1e-12);
        near(section[CN_BEAM_BENDING_V], young * circle * number(c, "polygon_I_over_circle"), 1e-12);
        near(got[CN_BEAM_AXIAL], section[CN_BEAM_AXIAL] * number(linear, "EA_over_polygon"), 0.03);
        near(got[CN_BEAM_BENDING_U], young * circle * number(linear, "EI_x_over_circle"), 0.03);
        near(got[CN_BEAM_BENDING_V], young * circle * number(linear, "EI_y_over_circle"), 0.03);
        near(got[CN_BEAM_TORSION], shear * 2 * circle * number(linear, "GJ_over_circle"), 0.03);

        const json_t *quadratic = json_object_get(c, "quadratic");
        cn_tets *raised = NULL;
        if (!quadratic) {
            cn_tets_free(mesh);
            continue;
        }
        assert_int_equal(cn_tets_raise(&raised, mesh), CN_OK);
        assert_int_equal(cn_beam_stiffness(raised, 2 * sections - 1, 2, &material, got, section), CN_OK);
        near(section[CN_BEAM_BENDING_U], young * circle * number(c, "polygon_I_over_circle"), 1e-12);
        near(got[CN_BEAM_AXIAL], section[CN_BEAM_AXIAL] * number(quadratic, "EA_over_polygon"), 1e-4);
        near(got[CN_BEAM_BENDING_U], young * circle * number(quadratic, "EI_x_over_circle"), 1e-3);
        near(got[CN_BEAM_BENDING_V], young * circle * number(quadratic, "EI_y_over_circle"), 1e-3);
        near(got[CN_BEAM_TORSION], shear * 2 * circle * number(quadratic, "GJ_over_circle"), 1e-2);
        cn_tets_free(raised);
        cn_tets_free(mesh);
    }
    json_decref(json);
}

static cn_shape catheter(void)
{
    cn_shape shape = {.kind = CN_SHAPE_CATHETER};
    shape.catheter.length = 1, shape.catheter.diameter = 1.35e-3;
    shape.catheter.stations = 455, shape.catheter.sides = 6;
    return shape;
}

static const cn_material silicone = {.young = 8.7e6, .poisson = 0.45};

/* A hexagon in a circle has 0.827 of its area, 0.689 of I, and (J = 1.0350 s^4) 0.659 of J. */
static void the_paper_s_catheter_is_several_times_too_stiff(void **state)
{
    (void)state;
    const cn_shape shape = catheter();
    cn_beam_error e;
    assert_int_equal(cn_beam_error_catheter(&shape, &silicone, CN_BODY_TET4, &e), CN_OK);
    near(e.polygon_axial, -0.17300666, 1e-6);
    near(e.polygon_bending, -0.31083888, 1e-6);
    near(1 + e.polygon_torsion, 1.0350 / (pi / 2), 5e-4);
    near(e.axial, e.polygon_axial, 1e-3); /* tension does not lock */
    assert_true(e.bending > 2 && e.bending < 12 && e.torsion > 5 && e.torsion < 36);
}

/* Twice and four times as many cells: the excess falls with the square, towards the exact section. */
static void a_beam_s_error_falls_with_the_square_of_its_cells(void **state)
{
    (void)state;
    const cn_material steel = {.young = 2e11, .poisson = 0.3};
    double last = 0;
    for (int k = 2; k <= 16; k *= 2) {
        const cn_shape shape = {.kind = CN_SHAPE_BEAM, .beam = {{1, 0.1, 0.1}, {10 * k, k, k}}};
        cn_beam_error e;
        assert_int_equal(cn_beam_error_beam(&shape, &steel, CN_BODY_TET4, &e), CN_OK);
        assert_true(fabs(e.polygon_bending) + fabs(e.polygon_axial) + fabs(e.polygon_torsion) < 1e-12);
        assert_true(fabs(e.axial) < 1e-3 && e.bending > 0 && e.torsion > 0);
        if (k > 2) near(last / e.bending, 4, 0.05);
        last = e.bending;
    }
}

/* Within 5 % of the circle at no more than 20,000 unknowns a metre: EI, GJ and EA, solid and hollow. */
static void a_second_order_catheter_is_as_stiff_as_the_circle(void **state)
{
    (void)state;
    const double poisson[3] = {0.3, 0.45, 0.4999};
    for (int k = 0; k < 3; k++)
        for (int hollow = 0; hollow < (k < 2 ? 2 : 1); hollow++)
            for (int sides = hollow ? 6 : 4; sides <= 8; sides += 2) {
                const cn_material m = {.young = 8.7e6, .poisson = poisson[k]};
                cn_shape shape = catheter();
                cn_beam_error e;
                const int per = hollow ? 6 * sides : 3 * sides + 1;
                shape.catheter.sides = sides, shape.catheter.stations = 20000 / 3 / per / 2;
                shape.catheter.inner_diameter = hollow ? 0.9e-3 : 0;
                assert_int_equal(cn_beam_error_catheter(&shape, &m, CN_BODY_TET10, &e), CN_OK);
                assert_true(fabs(e.bending) < 0.05 && fabs(e.torsion) < 0.05 && fabs(e.axial) < 0.05);
                near(e.polygon_axial + 1, e.axial + 1, 1e-3);
                assert_true(fabs(e.polygon_bending) < 1e-12);
                print_message("%s nu %-6g %d sides %3d stations %5d dof: EI %+.4f GJ %+.4f EA %+.4f\n",
                              hollow ? "hollow" : "solid ", poisson[k], sides, shape.catheter.stations,
                              3 * per * (2 * shape.catheter.stations - 1), e.bending, e.torsion, e.axial);
            }
}

/* Bending and tension are linear strain fields; torsion of a square warps. */
static void second_order_beams_have_the_torsion_of_their_cells_alone(void **state)
{
    (void)state;
    const cn_material steel = {.young = 2e11, .poisson = 0.3};
    double last = 0;
    for (int k = 1; k <= 4; k *= 2) {
        const cn_shape shape = {.kind = CN_SHAPE_BEAM, .beam = {{1, 0.1, 0.1}, {10 * k, k, k}}};
        cn_beam_error e;
        assert_int_equal(cn_beam_error_beam(&shape, &steel, CN_BODY_TET10, &e), CN_OK);
        assert_true(fabs(e.bending) < 1e-3 && fabs(e.axial) < 1e-3);
        assert_true(e.torsion > 0 && (k == 1 || last / e.torsion > 4));
        last = e.torsion;
    }
    assert_true(last < 0.01);
}

/* A rod has its section by construction. */
static void a_rod_has_no_error(void **state)
{
    (void)state;
    const cn_shape shape = catheter();
    cn_beam_error e;
    assert_int_equal(cn_beam_error_catheter(&shape, &silicone, CN_BODY_ROD, &e), CN_OK);
    assert_true(e.bending == 0 && e.torsion == 0 && e.axial == 0 && e.polygon_bending == 0);
}

static void units_do_not_matter(void **state)
{
    (void)state;
    cn_shape metres = catheter(), micrometres = catheter();
    cn_beam_error a, b;
    micrometres.catheter.length *= 1e6, micrometres.catheter.diameter *= 1e6;
    assert_int_equal(cn_beam_error_catheter(&metres, &silicone, CN_BODY_TET4, &a), CN_OK);
    assert_int_equal(cn_beam_error_catheter(&micrometres, &silicone, CN_BODY_TET4, &b), CN_OK);
    near(a.bending, b.bending, 1e-7);
    near(a.torsion, b.torsion, 1e-7);
}

/* A steel wire of 0.35 mm inside is a hundred times as stiff in bending as the silicone. */
static void a_core_the_mesh_does_not_have_counts_as_missing(void **state)
{
    (void)state;
    cn_shape shape = catheter();
    cn_beam_error without, with;
    assert_int_equal(cn_beam_error_catheter(&shape, &silicone, CN_BODY_TET4, &without), CN_OK);
    shape.catheter.has_core = true, shape.catheter.core_diameter = 0.35e-3;
    shape.catheter.core_young = 2e11, shape.catheter.core_poisson = 0.3;
    assert_int_equal(cn_beam_error_catheter(&shape, &silicone, CN_BODY_TET4, &with), CN_OK);
    const double own = 8.7e6 / 1.45 * pow(1.35e-3, 4), core = 2e11 / 1.3 * pow(0.35e-3, 4);
    near(1 + with.torsion, (1 + without.torsion) * own / (own + core), 1e-12);
    assert_true(with.bending < -0.9 && with.axial < -0.9);
}

static void what_is_no_beam_has_no_error(void **state)
{
    (void)state;
    const cn_shape cube = {.kind = CN_SHAPE_BEAM, .beam = {{1, 1, 1}, {8, 2, 2}}};
    cn_shape piece = catheter();
    cn_beam_error e = {0};
    piece.catheter.length = 3e-3;
    assert_int_equal(cn_beam_error_beam(&cube, &silicone, CN_BODY_TET4, &e), CN_OK);
    assert_true(isnan(e.bending) && isnan(e.torsion) && isnan(e.axial) && isnan(e.polygon_bending));
    assert_int_equal(cn_beam_error_catheter(&piece, &silicone, CN_BODY_TET4, &e), CN_OK);
    assert_true(isnan(e.bending));
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    cn_shape shape = catheter();
    shape.catheter.stations = 9, shape.catheter.length = 0.02;
    for (int model = CN_BODY_TET4; model <= CN_BODY_TET10; model++)
        for (FAIL_EACH_ALLOC) {
            cn_beam_error e;
            const cn_status status = cn_beam_error_catheter(&shape, &silicone, (cn_body_model)model, &e);
            assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
            assert_int_equal(isnan(e.bending), status != CN_OK);
        }
    fail_alloc_at(-1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(catheter_meshes_are_as_stiff_as_the_reference_found),
        cmocka_unit_test(the_paper_s_catheter_is_several_times_too_stiff),
        cmocka_unit_test(a_beam_s_error_falls_with_the_square_of_its_cells),
        cmocka_unit_test(a_second_order_catheter_is_as_stiff_as_the_circle),
        cmocka_unit_test(second_order_beams_have_the_torsion_of_their_cells_alone),
        cmocka_unit_test(a_rod_has_no_error),
        cmocka_unit_test(units_do_not_matter),
        cmocka_unit_test(a_core_the_mesh_does_not_have_counts_as_missing),
        cmocka_unit_test(what_is_no_beam_has_no_error),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
