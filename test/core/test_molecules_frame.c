/* Local frames of molecules: choice of neighbours, rotations, degenerate neighbourhoods. LINK: wrap */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_fixture.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "molecules.h"
#include "polar.h"

/* Molecules in these places with these links; nothing else of a body is looked at. */
static cn_body linked(int n, double *place, int nlink, int *link)
{
    return (cn_body){.nnode = n, .rest = place, .nelement = nlink, .nper = 2, .connect = link};
}

static cn_molecule_frames *frames_of(const cn_body *body)
{
    cn_molecule_frames *frames;
    assert_int_equal(cn_molecule_frames_new(&frames, body), CN_OK);
    return frames;
}

static cn_body *block(bool jittered)
{
    const double min[3] = {0, 0, 0}, max[3] = {0.08, 0.06, 0.07};
    const cn_molecules_spec spec = {0.008, jittered, NULL};
    const cn_material soft = {.young = 1e5, .poisson = 0.25, .density = 1000};
    cn_surface *box;
    cn_body *body;
    assert_int_equal(cn_surface_box(&box, min, max), CN_OK);
    assert_int_equal(cn_body_new_molecules(&body, box, &spec, 1, &soft, NULL), CN_OK);
    cn_surface_free(box);
    return body;
}

/* The rotation r x, to `tolerance`. */
static void assert_turned(const double q[4], const double r[9], double tolerance)
{
    double m[9];
    cn_quaternion_matrix(q, m);
    for (int k = 0; k < 9; k++)
        assert_true(fabs(m[k] - r[k]) < tolerance);
    assert_true(fabs(q[0] * q[0] + cn_norm2(q + 1) - 1) < 1e-14);
}

static void neighbours_are_the_most_orthogonal_and_equal_ones_go_by_index(void **state)
{
    (void)state;
    /* 1, 2, 3 orthogonal; 4 as good as 1 (behind); 5, 6 aslant */
    double place[] = {0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 1, -1, 0, 0, 1, 1, 0, 1, 1, 1};
    int link[] = {6, 0, 5, 0, 0, 4, 3, 0, 2, 0, 0, 1};
    const cn_body body = linked(7, place, 6, link);
    cn_molecule_frames *frames = frames_of(&body);
    assert_int_equal(frames->neighbour[0], 1);
    assert_int_equal(frames->neighbour[1], 2);
    assert_int_equal(frames->neighbour[2], 3);
    cn_molecule_frames_free(frames);
    /* within the lattice the three are second neighbours, along the axes */
    cn_body *body2 = block(false);
    const cn_molecules *own = body2->own;
    int orthogonal = 0;
    for (int i = 0; i < body2->nnode; i++)
        orthogonal += fabs(fabs(cn_det(own->frames->rest + 9 * i)) - 1) < 1e-12;
    assert_true(orthogonal > 0.9 * body2->nnode);
    cn_body_free(body2);
}

static void rigid_motions_of_any_angle_are_recovered(void **state)
{
    (void)state;
    const double pi = acos(-1), angle[] = {0, 1e-9, 1e-4, 0.3, 1.5, 3, pi - 1e-7, pi, 4, 2 * pi - 1e-3};
    unsigned seed = 3;
    cn_body *body = block(true);
    const cn_molecules *own = body->own;
    double *x = numbers(3 * body->nnode), *q = numbers(4 * body->nnode);
    for (size_t a = 0; a < sizeof angle / sizeof *angle; a++) {
        double w[3], r[9];
        for (int k = 0; k < 3; k++)
            w[k] = shape_random(&seed);
        cn_normalise(w);
        for (int k = 0; k < 3; k++)
            w[k] *= angle[a];
        cn_rotation(w, r);
        for (int i = 0; i < body->nnode; i++) {
            cn_mat_vec(r, body->rest + 3 * i, x + 3 * i);
            x[3 * i] += 0.5, x[3 * i + 2] -= 0.25;
        }
        cn_molecule_rotations(own->frames, x, q, NULL);
        for (int i = 0; i < body->nnode; i++)
            assert_turned(q + 4 * i, r, 1e-12);
    }
    free(x), free(q);
    cn_body_free(body);
}

static void a_stretch_does_not_turn_and_threads_do_not_matter(void **state)
{
    (void)state;
    cn_body *body = block(false);
    const cn_molecules *own = body->own;
    const int n = body->nnode;
    double *x = numbers(3 * n), *q = numbers(4 * n), *same = numbers(4 * n);
    const double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    cn_pool *pool;
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    for (int i = 0; i < 3 * n; i++)
        x[i] = (i % 3 == 0 ? 1.3 : i % 3 == 1 ? 0.8 : 1) * body->rest[i];
    cn_molecule_rotations(own->frames, x, q, NULL);
    for (int i = 0; i < n; i++)
        if (fabs(fabs(cn_det(own->frames->rest + 9 * i)) - 1) < 1e-12) assert_turned(q + 4 * i, r, 1e-12);
    cn_molecule_rotations(own->frames, x, same, pool);
    assert_memory_equal(q, same, 4 * (size_t)n * sizeof *q);
    cn_pool_free(pool);
    free(x), free(q), free(same);
    cn_body_free(body);
}

static void a_sheet_of_one_layer_follows_any_rotation(void **state)
{
    (void)state;
    double place[27];
    int link[24], n = 0;
    for (int i = 0; i < 9; i++)
        place[3 * i] = i % 3, place[3 * i + 1] = i / 3, place[3 * i + 2] = 0;
    for (int i = 0; i < 9; i++) {
        if (i % 3 < 2) link[2 * n] = i, link[2 * n++ + 1] = i + 1;
        if (i < 6) link[2 * n] = i, link[2 * n++ + 1] = i + 3;
    }
    const cn_body body = linked(9, place, n, link);
    cn_molecule_frames *frames = frames_of(&body);
    unsigned seed = 8;
    for (int trial = 0; trial < 50; trial++) {
        double r[9], x[27], q[36];
        shape_rotation(&seed, r);
        for (int i = 0; i < 9; i++)
            cn_mat_vec(r, place + 3 * i, x + 3 * i);
        cn_molecule_rotations(frames, x, q, NULL);
        for (int i = 0; i < 9; i++) {
            assert_int_equal(frames->neighbour[3 * i + 2], -1);
            assert_true(frames->neighbour[3 * i + 1] >= 0);
            assert_turned(q + 4 * i, r, 1e-12);
        }
    }
    cn_molecule_frames_free(frames);
}

static void links_on_a_line_turn_by_the_least_rotation(void **state)
{
    (void)state;
    double place[] = {-1, 0, 0, 0, 0, 0, 2, 0, 0}, q[12];
    int link[] = {0, 1, 1, 2};
    const cn_body body = linked(3, place, 2, link);
    cn_molecule_frames *frames = frames_of(&body);
    const double to[][3] = {{0, 1, 0}, {1, 0, 0}, {-1, 0, 0}, {0.6, 0, -0.8}, {-1, 1e-9, 0}};
    for (size_t t = 0; t < sizeof to / sizeof *to; t++) {
        double x[9], r[9], turned[3], axis[3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                x[3 * i + k] = place[3 * i] * to[t][k];
        cn_molecule_rotations(frames, x, q, NULL);
        for (int i = 0; i < 3; i++) {
            assert_int_equal(frames->neighbour[3 * i + 1], -1);
            cn_quaternion_matrix(q + 4 * i, r);
            cn_mat_vec(r, place + 6, turned);
            for (int k = 0; k < 3; k++)
                assert_true(fabs(turned[k] - 2 * to[t][k] / cn_norm(to[t])) < 1e-8);
            /* the axis is across both: least */
            cn_copy3(q + 4 * i + 1, axis);
            assert_true(fabs(cn_dot(axis, place + 6)) < 1e-12);
        }
    }
    cn_molecule_frames_free(frames);
}

static void a_molecule_alone_and_what_is_not_finite_keep_a_unit_rotation(void **state)
{
    (void)state;
    double place[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 5, 5, 5}, x[15], q[20];
    int link[] = {0, 1, 0, 2, 0, 3};
    const double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const cn_body body = linked(5, place, 3, link);
    cn_molecule_frames *frames = frames_of(&body);
    memcpy(x, place, sizeof x);
    x[12] = 9;
    cn_molecule_rotations(frames, x, q, NULL);
    assert_turned(q + 16, r, 1e-15);
    const double bad[3] = {NAN, INFINITY, 0};
    for (int b = 0; b < 3; b++) {
        for (int i = 0; i < 15; i++)
            x[i] = bad[b]; /* the last: all in one place */
        cn_molecule_rotations(frames, x, q, NULL);
        for (int i = 0; i < 5; i++)
            assert_true(fabs(q[4 * i] * q[4 * i] + cn_norm2(q + 4 * i + 1) - 1) < 1e-12);
    }
    cn_molecule_frames_free(frames);
}

static void many_neighbours_are_cut_to_the_nearest(void **state)
{
    (void)state;
    enum { N = 41 };
    double place[3 * N] = {0};
    int link[2 * N];
    unsigned seed = 5;
    for (int i = 1; i < N; i++) {
        double *p = place + 3 * i;
        for (int k = 0; k < 3; k++)
            p[k] = shape_random(&seed);
        cn_normalise(p);
        for (int k = 0; k < 3; k++)
            p[k] *= N - i; /* the last are the nearest */
        link[2 * (i - 1)] = 0, link[2 * (i - 1) + 1] = i;
    }
    const cn_body body = linked(N, place, N - 1, link);
    cn_molecule_frames *frames = frames_of(&body);
    for (int k = 0; k < 3; k++)
        assert_true(frames->neighbour[k] >= N - 16);
    cn_molecule_frames_free(frames);
}

static void every_failed_allocation_of_frames_is_reported(void **state)
{
    (void)state;
    double place[] = {-1, 0, 0, 0, 0, 0, 2, 0, 0};
    int link[] = {0, 1, 1, 2}, failures = 0;
    const cn_body body = linked(3, place, 2, link);
    for (FAIL_EACH_ALLOC) {
        cn_molecule_frames *frames;
        const cn_status status = cn_molecule_frames_new(&frames, &body);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        failures += status != CN_OK;
        cn_molecule_frames_free(frames);
    }
    assert_int_equal(failures, 6);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(neighbours_are_the_most_orthogonal_and_equal_ones_go_by_index),
        cmocka_unit_test(rigid_motions_of_any_angle_are_recovered),
        cmocka_unit_test(a_stretch_does_not_turn_and_threads_do_not_matter),
        cmocka_unit_test(a_sheet_of_one_layer_follows_any_rotation),
        cmocka_unit_test(links_on_a_line_turn_by_the_least_rotation),
        cmocka_unit_test(a_molecule_alone_and_what_is_not_finite_keep_a_unit_rotation),
        cmocka_unit_test(many_neighbours_are_cut_to_the_nearest),
        cmocka_unit_test(every_failed_allocation_of_frames_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
