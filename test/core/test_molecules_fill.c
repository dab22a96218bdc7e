/* Packing a shape with molecules and reading them from a file. LINK: wrap */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "body_fixture.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "mesh_parts.h"
#include "molecules.h"

static const double ball_centre[3] = {1, 2, -1};

static cn_surface *box_of(double x, double y, double z)
{
    const double min[3] = {0, 0, 0}, max[3] = {x, y, z};
    cn_surface *surface;
    assert_int_equal(cn_surface_box(&surface, min, max), CN_OK);
    return surface;
}

static cn_surface *ball_of(double radius)
{
    cn_surface *surface;
    assert_int_equal(cn_surface_sphere(&surface, ball_centre, radius), CN_OK);
    return surface;
}

static cn_packing *fill(const cn_surface *surface, double volume, double radius, bool jittered, unsigned seed)
{
    cn_packing *p;
    cn_error error = {0};
    const cn_status status = cn_packing_fill(&p, surface, volume, radius, jittered, seed, &error);
    if (status != CN_OK) fail_msg("%s", error.message);
    return p;
}

static double volume_of(const cn_packing *p, double centre[3])
{
    double sum = 0;
    centre[0] = centre[1] = centre[2] = 0;
    for (int i = 0; i < p->n; i++)
        sum += p->share[i], cn_axpy(p->share[i], p->place + 3 * i, centre);
    for (int k = 0; k < 3; k++)
        centre[k] /= sum;
    return sum;
}

static bool one_group(const cn_packing *p)
{
    int *parent = calloc((size_t)p->n, sizeof *parent);
    bool one = true;
    for (int i = 0; i < p->n; i++)
        parent[i] = i;
    for (int b = 0; b < p->nlink; b++)
        cn_set_join(parent, p->link[2 * b], p->link[2 * b + 1]);
    for (int i = 0; i < p->n; i++)
        one = one && cn_set_find(parent, i) == cn_set_find(parent, 0);
    free(parent);
    return one;
}

static void a_ball_is_filled_with_its_volume_and_nothing_outside(void **state)
{
    (void)state;
    const double radius = 0.1, volume = 4.0 / 3 * acos(-1) * radius * radius * radius;
    for (int jittered = 0; jittered < 2; jittered++) {
        cn_surface *ball = ball_of(radius);
        const double r = 0.01, cell = 32 * r * r * r / (3 * sqrt(3)); /* a^3 / 2, a = 4 r / sqrt 3 */
        cn_packing *p = fill(ball, volume, r, jittered, 1);
        double centre[3];
        assert_true(fabs(volume_of(p, centre) / volume - 1) < 1e-12);
        assert_true(cn_distance(centre, ball_centre) < 0.002 * radius);
        assert_true(fabs(p->n * cell / volume - 1) < 0.08);
        assert_true(one_group(p));
        for (int i = 0; i < p->n; i++) {
            assert_true(cn_distance(p->place + 3 * i, ball_centre) <= radius);
            assert_true(p->share[i] > 0.09 * cell && p->share[i] < 2.5 * cell);
        }
        cn_packing_free(p);
        cn_surface_free(ball);
    }
}

static void a_box_is_filled_evenly_inside_with_fourteen_links_each(void **state)
{
    (void)state;
    cn_surface *box = box_of(0.12, 0.09, 0.1);
    cn_packing *p = fill(box, 0.12 * 0.09 * 0.1, 0.006, false, 1);
    const double side = 4 * 0.006 / sqrt(3), cell = side * side * side / 2;
    int *count = calloc((size_t)p->n, sizeof *count), inner = 0;
    for (int b = 0; b < p->nlink; b++) {
        const int i = p->link[2 * b], j = p->link[2 * b + 1];
        const double length = cn_distance(p->place + 3 * i, p->place + 3 * j);
        assert_true(i < j);
        assert_true(fabs(length / 0.012 - 1) < 1e-12 || fabs(length / side - 1) < 1e-12);
        count[i]++, count[j]++;
    }
    for (int i = 0; i < p->n; i++) {
        const double *x = p->place + 3 * i, edge[3] = {0.12, 0.09, 0.1};
        bool deep = true;
        for (int k = 0; k < 3; k++) {
            assert_true(x[k] > 0 && x[k] < edge[k]);
            deep = deep && x[k] > 1.5 * side && x[k] < edge[k] - 1.5 * side;
        }
        if (!deep) continue;
        inner++;
        assert_int_equal(count[i], 14);
        assert_true(fabs(p->share[i] / cell - 1) < 0.02);
    }
    assert_true(inner > 50);
    free(count);
    cn_packing_free(p);
    cn_surface_free(box);
}

static void a_seed_gives_one_packing_and_another_seed_another(void **state)
{
    (void)state;
    cn_surface *ball = ball_of(0.1);
    cn_packing *regular = fill(ball, 4.18e-3, 0.012, false, 7), *p = fill(ball, 4.18e-3, 0.012, true, 7),
               *same = fill(ball, 4.18e-3, 0.012, true, 7), *other = fill(ball, 4.18e-3, 0.012, true, 8);
    double most = 0, least = INFINITY, mean[3] = {0};
    assert_int_equal(p->n, regular->n);
    assert_memory_equal(p->place, same->place, 3 * (size_t)p->n * sizeof *p->place);
    assert_memory_equal(p->link, same->link, 2 * (size_t)p->nlink * sizeof *p->link);
    assert_true(memcmp(p->place, other->place, 3 * (size_t)p->n * sizeof *p->place) != 0);
    for (int i = 0; i < p->n; i++) {
        double d[3];
        cn_sub(p->place + 3 * i, regular->place + 3 * i, d);
        most = fmax(most, cn_norm(d)), least = fmin(least, cn_norm(d));
        cn_add(mean, d, mean);
    }
    assert_true(most <= 0.1 * 0.012 * (1 + 1e-12) && most > 0.08 * 0.012);
    assert_true(cn_norm(mean) / p->n < 0.01 * 0.012); /* to no side */
    cn_packing_free(regular), cn_packing_free(p), cn_packing_free(same), cn_packing_free(other);
    cn_surface_free(ball);
}

static void the_unit_of_length_does_not_matter(void **state)
{
    (void)state;
    const double unit[2] = {1e3, 1e-6};
    cn_surface *box = box_of(0.1, 0.05, 0.07);
    cn_packing *metres = fill(box, 3.5e-4, 0.006, true, 3);
    for (int u = 0; u < 2; u++) {
        cn_surface *scaled = box_of(0.1 * unit[u], 0.05 * unit[u], 0.07 * unit[u]);
        cn_packing *p = fill(scaled, 3.5e-4 * pow(unit[u], 3), 0.006 * unit[u], true, 3);
        assert_int_equal(p->n, metres->n);
        assert_int_equal(p->nlink, metres->nlink);
        for (int i = 0; i < 3 * p->n; i++)
            assert_true(fabs(p->place[i] / unit[u] - metres->place[i]) < 1e-12);
        cn_packing_free(p);
        cn_surface_free(scaled);
    }
    cn_packing_free(metres);
    cn_surface_free(box);
}

static void refusals_name_the_radius(void **state)
{
    (void)state;
    const struct {
        double radius;
        cn_status status;
        const char *words;
    } cases[] = {{0, CN_ERR_ARG, "positive"},    {-1, CN_ERR_ARG, "positive"},
                 {NAN, CN_ERR_ARG, "positive"},  {INFINITY, CN_ERR_ARG, "positive"},
                 {1e-5, CN_ERR_ARG, "at least"}, {1e-300, CN_ERR_ARG, "at least"},
                 {0.06, CN_ERR_MESH, "or less"}, {10, CN_ERR_MESH, "or less"}};
    cn_surface *box = box_of(0.1, 0.1, 0.1);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_packing *p;
        cn_error error = {0};
        const cn_status status = cn_packing_fill(&p, box, 1e-3, cases[i].radius, false, 1, &error);
        assert_int_equal(status, cases[i].status);
        assert_null(p);
        assert_non_null(strstr(error.message, cases[i].words));
    }
    cn_surface_free(box);
}

/* Two balls that hardly touch the lattice between them. */
static void a_shape_whose_molecules_fall_apart_is_refused(void **state)
{
    (void)state;
    const double far[3] = {5, 2, -1};
    cn_surface *a = ball_of(0.1), *b, *both;
    cn_packing *p;
    cn_error error = {0};
    assert_int_equal(cn_surface_sphere(&b, far, 0.1), CN_OK);
    assert_int_equal(cn_surface_new(&both, a->nvert + b->nvert, a->ntri + b->ntri), CN_OK);
    memcpy(both->vert, a->vert, 3 * (size_t)a->nvert * sizeof *a->vert);
    memcpy(both->vert + 3 * a->nvert, b->vert, 3 * (size_t)b->nvert * sizeof *b->vert);
    memcpy(both->tri, a->tri, 3 * (size_t)a->ntri * sizeof *a->tri);
    for (int c = 0; c < 3 * b->ntri; c++)
        both->tri[3 * a->ntri + c] = b->tri[c] + a->nvert;
    assert_int_equal(cn_packing_fill(&p, both, 8.4e-3, 0.02, false, 1, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "groups"));
    cn_surface_free(a), cn_surface_free(b), cn_surface_free(both);
}

/* --- files --- */

static const char *write_file(const char *text)
{
    static char name[64];
    snprintf(name, sizeof name, "/tmp/catnav_molecules_%ld.txt", (long)getpid());
    FILE *f = fopen(name, "w");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
    return name;
}

static void a_file_gives_molecules_as_written_and_links_within_reach(void **state)
{
    (void)state;
    cn_packing *p;
    cn_error error = {0};
    const char *file = write_file("# a sheet\n0 0 0\n0.02 0 0 # beside\n\n0 0.02 0\n0.05 0.0 0\n");
    assert_int_equal(cn_packing_read(&p, file, 0.0101, NULL, 0, &error), CN_OK);
    assert_int_equal(p->n, 4);
    assert_true(p->place[3] == 0.02 && p->place[7] == 0.02 && p->place[9] == 0.05);
    assert_int_equal(p->nlink, 4); /* 0-1, 0-2, 1-2 (0.028), 1-3 (0.03 < 0.0303) */
    assert_true(fabs(p->share[2] - 4 * acos(-1) / 3 * pow(0.0101, 3)) < 1e-18);
    cn_packing_free(p);
    file = write_file("0 0 0 0.01\n0.02 0 0 0.012\n");
    assert_int_equal(cn_packing_read(&p, file, 1, NULL, 0, &error), CN_OK);
    assert_true(fabs(p->share[1] - 4 * acos(-1) / 3 * pow(0.012, 3)) < 1e-18 && p->nlink == 1);
    cn_packing_free(p);
    unlink(file);
}

static void a_body_from_a_file_has_its_molecules_as_points(void **state)
{
    (void)state;
    const cn_material soft = {.young = 1e5, .poisson = 0.3, .density = 1000};
    const char *file = write_file("0 0 0\n0.02 0 0\n0 0.02 0\n0 0 0.02\n");
    const cn_molecules_spec spec = {0.01, false, file};
    cn_body *body;
    cn_carry *carry;
    cn_surface *box = box_of(0.02, 0.02, 0.02);
    assert_int_equal(cn_body_new_molecules(&body, NULL, &spec, 1, &soft, NULL), CN_OK);
    assert_true(body->npoint == 4 && body->ntet == 0 && body->boundary->ntri == 0 && body->nanchor == 0);
    assert_ptr_equal(cn_body_points(body, 4, body->rest, NULL, NULL), body->rest);
    assert_int_equal(cn_body_node_of(body, 2), 2);
    assert_int_equal(cn_carry_new(&carry, body), CN_OK);
    assert_null(carry);
    assert_true(fabs(body->rest_volume - 16 * acos(-1) / 3 * 1e-6) < 1e-18);
    cn_body_free(body);
    /* in a surface: its volume, and its vertices are the points */
    assert_int_equal(cn_body_new_molecules(&body, box, &spec, 1, &soft, NULL), CN_OK);
    assert_true(body->npoint == 8 && body->boundary->ntri == 12 && fabs(body->rest_volume - 8e-6) < 1e-18);
    cn_body_free(body);
    cn_surface_free(box);
    unlink(file);
}

static void malformed_files_are_refused_with_their_line(void **state)
{
    (void)state;
    const struct {
        const char *text;
        cn_status status;
        int line;
        const char *words;
    } cases[] = {
        {"0 0 0\n0.02 0 nan\n", CN_ERR_PARSE, 2, "nan"},
        {"0 0 0\n0.02 0 0x1\n", CN_ERR_PARSE, 2, "0x1"},
        {"0 0 0\n\n0.02 0\n", CN_ERR_PARSE, 3, "z"},
        {"0 0 0\n0.02 0 0 0.01\n", CN_ERR_PARSE, 2, "no radius"},
        {"0 0 0 0.01\n0.02 0 0\n", CN_ERR_PARSE, 2, "radius"},
        {"0 0 0 0.01\n0.02 0 0 0\n", CN_ERR_PARSE, 2, "positive"},
        {"0 0 0 0.01\n0.02 0 0 -1\n", CN_ERR_PARSE, 2, "positive"},
        {"0 0 0 0.01 7\n0.02 0 0 1 7\n", CN_ERR_PARSE, 1, "7"},
        {"0 0 0\n", CN_ERR_PARSE, 1, "at least 2"},
        {"", CN_ERR_PARSE, 0, "empty"},
        {"# none\n", CN_ERR_PARSE, 1, "at least 2"},
        {"0 0 0\n0.02 0 0\n0.5 0 0\n", CN_ERR_MESH, 3, "joins"},
        {"0 0 0\n0.02 0 0\n0.02 0 0\n", CN_ERR_MESH, 3, "line 2"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_packing *p;
        cn_error error = {0};
        const char *file = write_file(cases[i].text);
        const cn_status status = cn_packing_read(&p, file, 0.01, NULL, 0, &error);
        if (status != cases[i].status || !strstr(error.message, cases[i].words) ||
            (cases[i].line && error.line != cases[i].line))
            fail_msg("case %zu: %d, line %d: %s", i, status, error.line, error.message);
        assert_null(p);
        unlink(file);
    }
    cn_packing *p;
    assert_int_equal(cn_packing_read(&p, "/nowhere/at/all", 0.01, NULL, 0, NULL), CN_ERR_FILE);
    assert_int_equal(cn_packing_read(&p, "/nowhere/at/all", -1, NULL, 0, NULL), CN_ERR_ARG);
}

/* All at one heap would have a link each with each. */
static void molecules_heaped_on_each_other_are_refused(void **state)
{
    (void)state;
    char *text = malloc(400 * 60), *at = text;
    cn_packing *p;
    cn_error error = {0};
    for (int i = 0; i < 400; i++)
        at += sprintf(at, "%g %g %g\n", 1e-3 * (i % 10), 1e-3 * (i / 10 % 10), 1e-3 * (i / 100));
    const char *file = write_file(text);
    assert_int_equal(cn_packing_read(&p, file, 1, NULL, 0, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "smaller radii"));
    unlink(file);
    free(text);
}

/* A simple cubic lattice is not isotropic with equal constants: the fit makes it so, k1 = k2 = 0.4 E a
 * inside. */
static void the_fit_finds_the_constants_of_another_lattice(void **state)
{
    (void)state;
    enum { N = 9 };
    char *text = malloc(N * N * N * 60), *at = text;
    cn_packing *p;
    for (int i = 0; i < N * N * N; i++)
        at += sprintf(at, "%g %g %g\n", 0.02 * (i % N), 0.02 * (i / N % N), 0.02 * (i / N / N));
    const char *file = write_file(text);
    cn_surface *box = box_of(0.02 * N, 0.02 * N, 0.02 * N);
    for (int i = 0; i < 3 * box->nvert; i++)
        box->vert[i] -= 0.01;
    assert_int_equal(cn_packing_read(&p, file, 0.01, box, pow(0.02 * N, 3), NULL), CN_OK);
    double *k = numbers(p->nlink);
    int seen = 0;
    assert_int_equal(cn_molecules_fit(p, k), CN_OK);
    for (int b = 0; b < p->nlink; b++) {
        const double *x = p->place + 3 * p->link[2 * b], *y = p->place + 3 * p->link[2 * b + 1];
        bool deep = true;
        for (int c = 0; c < 3; c++)
            deep = deep && fmin(x[c], y[c]) > 0.055 && fmax(x[c], y[c]) < 0.02 * N - 0.075;
        if (!deep) continue;
        seen++;
        assert_true(fabs(k[b] / (0.4 * 0.02) - 1) < 0.05);
    }
    assert_true(seen > 20);
    free(k), free(text);
    cn_packing_free(p);
    cn_surface_free(box);
    unlink(file);
}

static void every_failed_allocation_of_a_file_is_reported(void **state)
{
    (void)state;
    const char *file = write_file("0 0 0\n0.02 0 0\n0 0.02 0\n0 0 0.02\n");
    cn_surface *box = box_of(0.02, 0.02, 0.02);
    int failures = 0;
    for (FAIL_EACH_ALLOC) {
        cn_packing *p;
        const cn_status status = cn_packing_read(&p, file, 0.01, box, 8e-6, NULL);
        assert_true(status == CN_ERR_MEMORY ? fail_alloc_fired() : status == CN_OK && p);
        failures += status != CN_OK;
        cn_packing_free(p);
    }
    assert_true(failures > 8);
    cn_surface_free(box);
    unlink(file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_is_filled_with_its_volume_and_nothing_outside),
        cmocka_unit_test(a_box_is_filled_evenly_inside_with_fourteen_links_each),
        cmocka_unit_test(a_seed_gives_one_packing_and_another_seed_another),
        cmocka_unit_test(the_unit_of_length_does_not_matter),
        cmocka_unit_test(refusals_name_the_radius),
        cmocka_unit_test(a_shape_whose_molecules_fall_apart_is_refused),
        cmocka_unit_test(a_file_gives_molecules_as_written_and_links_within_reach),
        cmocka_unit_test(a_body_from_a_file_has_its_molecules_as_points),
        cmocka_unit_test(malformed_files_are_refused_with_their_line),
        cmocka_unit_test(molecules_heaped_on_each_other_are_refused),
        cmocka_unit_test(the_fit_finds_the_constants_of_another_lattice),
        cmocka_unit_test(every_failed_allocation_of_a_file_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
