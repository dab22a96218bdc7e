/* The doctor: what it merges, turns, counts and refuses. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <jansson.h>
#include <math.h>
#include <string.h>

#include "catnav/mesh.h"
#include "mesh_files.h"

static const double zero[3] = {0, 0, 0}, one[3] = {1, 1, 1};

static cn_surface *box(void)
{
    cn_surface *s = NULL;
    assert_int_equal(cn_surface_box(&s, zero, one), CN_OK);
    return s;
}

/* Both surfaces as one, the second turned inside out where asked; frees them. */
static cn_surface *join(cn_surface *a, cn_surface *b, bool inside_out)
{
    cn_surface *s = NULL;
    assert_int_equal(cn_surface_new(&s, a->nvert + b->nvert, a->ntri + b->ntri), CN_OK);
    memcpy(s->vert, a->vert, 3 * (size_t)a->nvert * sizeof(double));
    memcpy(s->vert + 3 * a->nvert, b->vert, 3 * (size_t)b->nvert * sizeof(double));
    memcpy(s->tri, a->tri, 3 * (size_t)a->ntri * sizeof(int));
    for (int i = 0; i < b->ntri; i++)
        for (int k = 0; k < 3; k++)
            s->tri[3 * (a->ntri + i) + k] = a->nvert + b->tri[3 * i + (inside_out ? 2 - k : k)];
    cn_surface_free(a);
    cn_surface_free(b);
    return s;
}

static cn_surface *sphere(double x, double radius)
{
    cn_surface *s = NULL;
    assert_int_equal(cn_surface_sphere(&s, (const double[]){x, 0, 0}, radius), CN_OK);
    return s;
}

static cn_doctor check(cn_surface *s, bool turn)
{
    cn_doctor doctor;
    cn_error error = {0};
    if (cn_surface_check(s, turn, &doctor, &error) != CN_OK) fail_msg("%s", error.message);
    return doctor;
}

/* Checks, expects both refusals (NULL: none) to say so, frees. */
static void expect(cn_surface *s, const char *wall, const char *solid)
{
    const cn_doctor doctor = check(s, true);
    cn_error as_wall = {0}, as_solid = {0};
    const cn_status w = cn_doctor_wall(&doctor, "mesh", &as_wall),
                    v = cn_doctor_solid(&doctor, "mesh", &as_solid);
    if (wall ? w != CN_ERR_MESH || !strstr(as_wall.message, wall) : w != CN_OK)
        fail_msg("wall: %s", as_wall.message);
    if (solid ? v != CN_ERR_MESH || !strstr(as_solid.message, solid) : v != CN_OK)
        fail_msg("solid: %s", as_solid.message);
    assert_true(!wall || !strncmp(as_wall.message, "mesh: ", 6));
    cn_surface_free(s);
}

static void equal_vertices_become_one_also_minus_zero(void **state)
{
    cn_surface *s = box(), *soup = NULL;
    (void)state;

    assert_int_equal(cn_surface_new(&soup, 36, 12), CN_OK);
    for (int i = 0; i < 36; i++) {
        memcpy(soup->vert + 3 * i, s->vert + 3 * s->tri[i], 3 * sizeof(double));
        for (int k = 0; k < 3 && i % 2; k++)
            if (soup->vert[3 * i + k] == 0) soup->vert[3 * i + k] = -0.0;
        soup->tri[i] = i;
    }
    const cn_doctor d = check(soup, true);
    assert_int_equal(d.merged, 28);
    assert_int_equal(d.nvert, 8);
    assert_int_equal(soup->nvert, 8);
    assert_true(d.closed && d.manifold && d.oriented && !d.turned && d.genus == 0 && d.components == 1);
    assert_true(fabs(d.volume - 1) < 1e-15);
    cn_surface_free(soup);
    cn_surface_free(s);
}

static void nearly_equal_vertices_stay_apart(void **state)
{
    cn_surface *s = NULL;
    (void)state;
    assert_int_equal(cn_surface_new(&s, 6, 2), CN_OK);
    memcpy(s->vert, (const double[18]){0, 0, 0, 1, 0, 0, 0, 1, 0, 1 + 3e-16, 0, 0, 0, 1, 0, 1, 1, 0},
           18 * sizeof(double));
    memcpy(s->tri, (const int[6]){0, 1, 2, 3, 5, 4}, 6 * sizeof(int));
    assert_int_equal(check(s, false).merged, 1);
    cn_surface_free(s);
}

static void inward_surfaces_are_turned_outward_and_counted(void **state)
{
    (void)state;
    for (int turn = 0; turn < 2; turn++) {
        cn_surface *s = box();
        for (int i = 0; i < 12; i++) {
            const int swap = s->tri[3 * i];
            s->tri[3 * i] = s->tri[3 * i + 1], s->tri[3 * i + 1] = swap;
        }
        const cn_doctor d = check(s, turn);
        assert_int_equal(d.turned, turn);
        assert_true(fabs(d.volume - (turn ? 1 : -1)) < 1e-15);
        const cn_doctor again = check(s, true);
        assert_int_equal(again.turned, !turn);
        cn_surface_free(s);
    }
}

static void an_open_tube_is_measured_with_its_ends_capped(void **state)
{
    cn_surface *s = NULL;
    const double axis[6] = {0, 0, 0, 0, 0, 3}, radius[2] = {1, 1};
    (void)state;

    assert_int_equal(cn_surface_tube(&s, 2, axis, radius, 0, 64), CN_OK);
    for (int i = 0; i < s->ntri; i++) { /* inside out */
        const int swap = s->tri[3 * i];
        s->tri[3 * i] = s->tri[3 * i + 1], s->tri[3 * i + 1] = swap;
    }
    const cn_doctor d = check(s, true);
    const double side = 2 * sin(3.14159265358979323846 / 64);
    assert_int_equal(d.loops, 2);
    assert_true(d.turned && !d.closed && d.manifold && d.oriented && d.genus == -1);
    assert_true(fabs(d.loop_diameter[0] - 64 * side / 3.14159265358979323846) < 1e-12);
    assert_int_equal(d.loop_edges[1], 64);
    assert_true(fabs(d.loop_centre[0][2]) < 1e-15 && fabs(d.loop_centre[1][2] - 3) < 1e-15);
    assert_true(fabs(d.volume - 3 * 32 * sin(3.14159265358979323846 / 32)) < 1e-12);
    expect(s, NULL, "2 boundary loops");
}

static void a_flat_sheet_has_no_inside_and_is_not_turned(void **state)
{
    cn_surface *s = NULL;
    (void)state;
    for (int sign = -1; sign <= 1; sign += 2) {
        const double normal[3] = {0.3 * sign, 0.1 * sign, 0.7 * sign};
        assert_int_equal(cn_surface_plane(&s, one, normal, 7), CN_OK);
        assert_false(check(s, true).turned);
        expect(s, NULL, "open");
    }
}

static void genus_counts_handles(void **state)
{
    cn_surface *s = NULL;
    const double axis[6] = {0, 0, 0, 0, 0, 3}, radius[2] = {1, 1};
    (void)state;
    assert_int_equal(cn_surface_tube(&s, 2, axis, radius, 0.5, 9), CN_OK);
    assert_int_equal(check(s, false).genus, 1);
    cn_surface_free(s);
}

static void what_is_broken_is_refused_with_its_place(void **state)
{
    cn_surface *s;
    (void)state;

    s = box(), s->tri[3 * 4 + 1] = s->tri[3 * 4];
    expect(s, "the first is triangle 4", "the first is triangle 4");
    s = box(), memcpy(s->tri + 9, s->tri, 3 * sizeof(int));
    expect(s, "0 and 3", "0 and 3");
    s = box(), s->tri[3] = 0, s->tri[4] = 2, s->tri[5] = 6; /* triangle 1 turned */
    expect(s, "mixed orientation over 3 edges, the first between triangles", "mixed orientation");
    s = join(sphere(0, 1), sphere(5, 1), true);
    expect(s, "mixed orientation, 1 of its 2 parts", "mixed orientation");
    s = join(sphere(0, 1), sphere(5, 1), false);
    expect(s, NULL, NULL);
    s = join(sphere(0, 2), sphere(0, 1), true); /* a hollow: the inner shell looks into it */
    expect(s, NULL, NULL);
    s = join(sphere(0, 2), sphere(0, 1), false);
    expect(s, "mixed orientation", "mixed orientation");
    s = join(sphere(0, 1), sphere(1.5, 1), false); /* two that overlap: a union of lumens, no solid */
    expect(s, NULL, "pairs of triangles cross");
    s = box(), s->ntri = 11;
    expect(s, NULL, "1 boundary loop");
}

static void three_sheets_on_an_edge_and_two_boxes_at_a_corner_are_named(void **state)
{
    cn_surface *s = NULL, *far = NULL;
    cn_doctor d;
    (void)state;

    assert_int_equal(cn_surface_new(&s, 5, 3), CN_OK);
    memcpy(s->vert, (const double[15]){0, 0, 0, 0, 0, 1, 1, 0, 0, -1, 1, 0, -1, -1, 0}, 15 * sizeof(double));
    memcpy(s->tri, (const int[9]){0, 1, 2, 0, 1, 3, 0, 1, 4}, 9 * sizeof(int));
    d = check(s, false);
    assert_true(d.nonmanifold_edges == 1 && !d.manifold && d.first_nonmanifold[0] == 0 &&
                d.first_nonmanifold[1] == 1);
    expect(s, "joins vertices 0 and 1", "joins vertices 0 and 1");
    assert_int_equal(cn_surface_box(&far, one, (const double[]){2, 2, 2}), CN_OK);
    s = join(box(), far, false);
    d = check(s, false);
    assert_int_equal(d.nonmanifold_vertices, 1);
    assert_int_equal(d.components, 2);
    expect(s, NULL, "meet in a point, the first is vertex 7");
}

static void crossing_pairs_are_counted_once_and_listed_in_order(void **state)
{
    cn_surface *s = NULL;
    (void)state;

    /* a needle through a plate of two triangles, then one through its common edge */
    assert_int_equal(cn_surface_new(&s, 10, 4), CN_OK);
    memcpy(s->vert, (const double[30]){0, 0, 0, 4, 0,   0, 4, 4, 0,  0, 4, 0, 3, 1,   -1,
                                       3, 1, 1, 3, 1.5, 1, 2, 2, -1, 2, 2, 1, 2, 2.5, 1},
           30 * sizeof(double));
    memcpy(s->tri, (const int[12]){0, 1, 2, 0, 2, 3, 4, 5, 6, 7, 8, 9}, 12 * sizeof(int));
    cn_doctor d = check(s, false);
    assert_int_equal(d.crossing_pairs, 3);
    assert_memory_equal(d.crossing, ((const int[3][2]){{0, 2}, {0, 3}, {1, 3}}), 6 * sizeof(int));
    /* the first needle hung on to a corner of the plate still pierces it */
    s->tri[6] = 2;
    s->vert[3 * 5 + 2] = -1;
    d = check(s, false);
    assert_int_equal(d.crossing_pairs, 3);
    /* neighbours over an edge cross only where folded flat */
    s->ntri = 2;
    assert_int_equal(check(s, false).crossing_pairs, 0);
    s->vert[9] = 3, s->vert[10] = 1;
    assert_int_equal(check(s, false).crossing_pairs, 1);
    s->vert[11] = 1e-300;
    assert_int_equal(check(s, false).crossing_pairs, 0);
    cn_surface_free(s);
}

static void figures_do_not_depend_on_the_unit(void **state)
{
    const double rough[3] = {0.5, 0.25, 0.125};
    cn_doctor first = {0};
    (void)state;
    for (int e = -40; e <= 40; e += 20) {
        cn_surface *s = join(sphere(0, 1), sphere(1.5, 1), false);
        for (int i = 0; i < 3 * s->nvert; i++)
            s->vert[i] = ldexp(s->vert[i] + rough[i % 3], e);
        const cn_doctor d = check(s, true);
        if (e == -40) first = d;
        assert_true(d.crossing_pairs > 100 && d.crossing_pairs == first.crossing_pairs);
        assert_memory_equal(d.crossing, first.crossing, sizeof d.crossing);
        assert_true(ldexp(d.volume, -3 * (e + 40)) == first.volume);
        cn_surface_free(s);
    }
}

static void the_unit_is_guessed_from_the_size(void **state)
{
    static const struct {
        double size;
        const char *guess;
    } cases[] = {{0.6, "metres"}, {600, "0.001"}, {6e5, "1e-6"}, {6e-4, "twice"}};
    (void)state;
    for (size_t i = 0; i < 4; i++) {
        cn_surface *s = sphere(0, cases[i].size / 2);
        assert_non_null(strstr(check(s, true).unit_guess, cases[i].guess));
        cn_surface_free(s);
    }
}

static void what_is_not_finite_or_empty_is_refused(void **state)
{
    cn_surface *s;
    cn_doctor d;
    cn_error error = {0};
    (void)state;

    s = box(), s->vert[4] = NAN;
    assert_int_equal(cn_surface_check(s, true, &d, &error), CN_ERR_NOT_FINITE);
    assert_non_null(strstr(error.message, "vertex 1 has y = nan"));
    cn_surface_free(s);
    s = box(), s->tri[7] = 8, error = (cn_error){0};
    assert_int_equal(cn_surface_check(s, true, &d, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "triangle 2 names vertex 8"));
    s->ntri = 0;
    assert_int_equal(cn_surface_check(s, true, &d, NULL), CN_ERR_MESH);
    cn_surface_free(s);
}

static void the_table_and_the_json_say_the_same(void **state)
{
    cn_surface *s = box();
    s->ntri = 11;
    const cn_doctor d = check(s, true);
    char *text = cn_doctor_text(&d, "box.stl"), *json = cn_doctor_json(&d, "box.stl");
    json_t *object = json_loads(json, 0, NULL);
    (void)state;

    assert_non_null(strstr(text, "boundary loops         1"));
    assert_non_null(strstr(text, "as a body to fill      refused"));
    assert_int_equal(json_integer_value(json_object_get(object, "loops")), 1);
    assert_string_equal(json_string_value(json_object_get(object, "check")), "usable");
    assert_true(json_is_false(json_object_get(object, "closed")));
    assert_true(json_is_null(json_object_get(object, "genus")));
    assert_non_null(strstr(json_string_value(json_object_get(object, "solid")), "refused: "));
    json_decref(object);
    free(text), free(json);
    cn_surface_free(s);
}

/* Without memory there is no table, never half of one. */
static void tables_survive_every_failing_allocation(void **state)
{
    (void)state;
    cn_doctor d = {.nvert = 8, .ntri = 12, .closed = true};
    char *const whole = cn_doctor_text(&d, "box.stl");
    assert_non_null(whole);
    for (FAIL_EACH_ALLOC) {
        char *text = cn_doctor_text(&d, "box.stl");
        if (text) assert_string_equal(text, whole);
        assert_true(text || fail_alloc_fired());
        free(text);
    }
    free(whole);
}

static void the_doctor_of_tetrahedra_reports_what_is_refused(void **state)
{
    cn_tets *t = NULL;
    cn_tets_doctor d;
    cn_error refusal = {0};
    (void)state;

    assert_int_equal(cn_tets_beam(&t, one, (const int[]){2, 1, 1}, NULL), CN_OK);
    t->tet[0] = t->tet[4], t->tet[1] = t->tet[5], t->tet[2] = t->tet[6], t->tet[3] = t->tet[7];
    assert_int_equal(cn_tets_measure(t, &d, NULL), CN_OK);
    assert_int_equal(cn_tets_check(t, NULL, &refusal), CN_ERR_MESH);
    char *text = cn_tets_doctor_text(&d, "beam.msh", &refusal),
         *json = cn_tets_doctor_json(&d, "beam.msh", &refusal);
    json_t *object = json_loads(json, 0, NULL);
    assert_non_null(strstr(text, refusal.message));
    assert_string_equal(json_string_value(json_object_get(object, "check")), "refused");
    assert_int_equal(json_integer_value(json_object_get(object, "tetrahedra")), 12);
    json_decref(object);
    free(text), free(json);
    cn_tets_free(t);
}

static void a_heap_of_nested_parts_ends_in_time(void **state)
{
    enum { N = 6000 };
    cn_surface *s = NULL;
    (void)state;

    assert_int_equal(cn_surface_new(&s, 8 * N, 12 * N), CN_OK);
    for (int i = 0; i < N; i++) { /* boxes within boxes, every other one inside out: well nested */
        cn_surface *b = NULL;
        const double low[3] = {i, i, i}, high[3] = {2 * N - i, 2 * N - i, 2 * N - i};
        assert_int_equal(cn_surface_box(&b, low, high), CN_OK);
        memcpy(s->vert + 24 * i, b->vert, 24 * sizeof(double));
        for (int k = 0; k < 36; k++)
            s->tri[36 * i + k] = 8 * i + b->tri[i % 2 ? k - k % 3 + 2 - k % 3 : k];
        cn_surface_free(b);
    }
    s->ntri = 12 * 100, s->nvert = 8 * 100;
    assert_int_equal(check(s, true).mixed_components, 0);
    s->ntri = 12 * N, s->nvert = 8 * N;
    assert_int_equal(check(s, true).components, N);
    cn_surface_free(s);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    bool fired = true;
    for (long n = 0; fired; n++) {
        cn_surface *s = join(sphere(0, 1), sphere(5, 1), false);
        cn_doctor d;
        fail_alloc_at(n);
        const cn_status status = cn_surface_check(s, true, &d, NULL);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_true(status == CN_OK ||
                    (fired && status == CN_ERR_MEMORY)); /* giving memory back may fail too */
        if (status == CN_OK) assert_int_equal(d.components, 2);
        cn_surface_free(s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_vertices_become_one_also_minus_zero),
        cmocka_unit_test(nearly_equal_vertices_stay_apart),
        cmocka_unit_test(inward_surfaces_are_turned_outward_and_counted),
        cmocka_unit_test(an_open_tube_is_measured_with_its_ends_capped),
        cmocka_unit_test(a_flat_sheet_has_no_inside_and_is_not_turned),
        cmocka_unit_test(genus_counts_handles),
        cmocka_unit_test(what_is_broken_is_refused_with_its_place),
        cmocka_unit_test(three_sheets_on_an_edge_and_two_boxes_at_a_corner_are_named),
        cmocka_unit_test(crossing_pairs_are_counted_once_and_listed_in_order),
        cmocka_unit_test(figures_do_not_depend_on_the_unit),
        cmocka_unit_test(the_unit_is_guessed_from_the_size),
        cmocka_unit_test(what_is_not_finite_or_empty_is_refused),
        cmocka_unit_test(the_table_and_the_json_say_the_same),
        cmocka_unit_test(tables_survive_every_failing_allocation),
        cmocka_unit_test(the_doctor_of_tetrahedra_reports_what_is_refused),
        cmocka_unit_test(a_heap_of_nested_parts_ends_in_time),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("mesh_check", tests, NULL, NULL);
}
