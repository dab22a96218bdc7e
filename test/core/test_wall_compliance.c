/* The wall's compliance against full solves. */
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
#include "solve_parts.h"
#include "wall_cases.h"
#include "wall_compliance.h"

enum { ROOM = 1 << 24 };

/* A tube's wall with K + m / dt^2 in its matrix; its rims into `held` (flags, freed by the caller). */
static fixture tube(bool shell, unsigned char **held)
{
    cn_wall_spec spec = plain_wall[shell];
    spec.thickness = 0.02, spec.foundation = 5e4;
    fixture s = wall_of(wall_grid(24, 16, 0, true, wall_tube), spec);
    fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
    for (int i = 0; i < s.body->nnode; i++)
        for (int k = 0; k < 9; k += 4)
            s.matrix->value[9 * s.matrix->diagonal[i] + k] += s.body->mass[i] * 1e2;
    *held = flags(s.body->nnode);
    cn_body_wall_rims(s.body, *held);
    return s;
}

static cn_compliance *compliance_of(const fixture *s, const unsigned char *held, size_t bytes)
{
    cn_compliance *c;
    assert_int_equal(cn_compliance_new(&c, s->matrix, held, bytes, NULL), CN_OK);
    return c;
}

/* 3 n numbers in [-1, 1). */
static double *forces(int n, unsigned seed)
{
    double *f = numbers(3 * n);
    for (int i = 0; i < 3 * n; i++)
        f[i] = shape_random(&seed);
    return f;
}

enum { TOUCHED = 40 };
static void touch(int *vertex, int nnode, int stride)
{
    for (int i = 0; i < TOUCHED; i++)
        vertex[i] = (i * stride + 30) % nnode;
}

static void touched_vertices_give_way_as_a_full_solve_says(void **state)
{
    (void)state;
    for (int shell = 0; shell < 2; shell++) {
        unsigned char *held;
        fixture s = tube(shell, &held);
        const int n = s.body->nnode;
        cn_compliance *c = compliance_of(&s, held, ROOM);
        cn_solver *solver;
        int vertex[TOUCHED];
        touch(vertex, n, 7);
        double *f = forces(TOUCHED, 5), *full = numbers(3 * n), *u = numbers(3 * n), *w = numbers(3 * n);
        double y[3 * TOUCHED], largest_c = 0, sum = 0;
        for (int i = 0; i < TOUCHED; i++)
            cn_copy3(f + 3 * i, full + 3 * vertex[i]);
        for (int i = 0; i < 3 * TOUCHED; i++)
            sum += fabs(f[i]);
        assert_int_equal(cn_solver_new(&solver, s.matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
        assert_int_equal(cn_solver_factor(solver, s.matrix, n, held, NULL), CN_OK);
        assert_int_equal(cn_solver_solve(solver, full, u, 1e-10, 1, NULL, NULL, NULL), CN_OK);
        cn_solver_free(solver);

        assert_int_equal(cn_compliance_ensure(c, TOUCHED, vertex), CN_OK);
        cn_compliance_apply(c, TOUCHED, vertex, f, y);
        cn_compliance_spread(c, TOUCHED, vertex, f, w);
        double *dense = numbers(9 * TOUCHED * TOUCHED), off = 0, off_w = 0;
        cn_compliance_gather(c, TOUCHED, vertex, dense);
        for (int i = 0; i < 3 * TOUCHED; i++) {
            double row = 0;
            largest_c = fmax(largest_c, dense[3 * TOUCHED * i + i]);
            for (int j = 0; j < 3 * TOUCHED; j++) {
                row += dense[3 * TOUCHED * i + j] * f[j];
                assert_true(dense[3 * TOUCHED * i + j] == dense[3 * TOUCHED * j + i]);
            }
            assert_true(fabs(row - y[i]) <= 1e-14 * largest_c * sum);
            off = fmax(off, fabs(y[i] - u[3 * vertex[i / 3] + i % 3]));
        }
        for (int i = 0; i < 3 * n; i++)
            off_w = fmax(off_w, fabs(w[i] - u[i]));
        const cn_compliance_counts count = cn_compliance_count(c);
        printf(
            "  %s: off by %.1e at touched vertices, %.1e elsewhere, of the largest displacement; %ld of %d "
            "nodes in a column\n",
            shell ? "shell" : "membrane", off / largest(u, 3 * n), off_w / largest(u, 3 * n),
            count.nodes / count.kept, n);
        assert_true(off < CN_COMPLIANCE_DROP * largest_c * sum &&
                    off_w < CN_COMPLIANCE_DROP * largest_c * sum);
        for (int i = 0; i < n; i++)
            for (int k = 0; held[i] && k < 3; k++)
                assert_true(w[3 * i + k] == 0);
        free(f), free(full), free(u), free(w), free(dense), free(held);
        cn_compliance_free(c);
        fixture_free(&s);
    }
}

static void columns_are_those_of_full_solves_for_any_instruction_set(void **state)
{
    (void)state;
    int super = 0, simple = 0;
    for (int wide = 0; wide < 2; wide++) { /* CHOLMOD takes the membrane column by column */
        cn_wall_spec spec = plain_wall[wide];
        spec.foundation = 1e4;
        fixture s = wall_of(wall_grid(24, 16, 0.2, false, wall_bent), spec);
        const int n = s.body->nnode, node[5] = {n / 2, 0, n / 3, 5, n - 1};
        unsigned char *held = flags(n);
        cn_sparse *sparse;
        held[5] = held[7] = 1;
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        assert_int_equal(cn_sparse_new(&sparse, s.matrix), CN_OK);
        assert_int_equal(cn_sparse_factor(sparse, s.matrix, held), CN_OK);
        super += cn_sparse_view(sparse).nrow == NULL, simple += cn_sparse_view(sparse).nrow != NULL;
        cn_columns *c[3];
        for (int most = 0; most < 3; most++) {
            assert_int_equal(cn_columns_new(&c[most], sparse, most), CN_OK);
            cn_columns_solve(c[most], sparse, held, 5, node, 1e-3); /* what it leaves is cleared away */
            cn_columns_solve(c[most], sparse, held, 5, node, 0);
            assert_memory_equal(c[most]->x, c[0]->x, 3 * (size_t)n * CN_COLUMNS * sizeof(double));
        }
        double *b = numbers(3 * n), *x = numbers(3 * n), *seen = numbers(n);
        for (int p = 0; p < c[0]->nplace; p++)
            seen[c[0]->node[c[0]->place[p]]] += 1;
        for (int k = 0; k < 15; k++) {
            memset(b, 0, 3 * (size_t)n * sizeof *b), memset(x, 0, 3 * (size_t)n * sizeof *x);
            b[3 * node[k / 3] + k % 3] = 1;
            assert_int_equal(cn_sparse_solve(sparse, held, b, x), CN_OK);
            const double size = largest(x, 3 * n);
            for (int q = 0; q < n; q++)
                for (int r = 0; r < 3; r++)
                    assert_true(fabs(c[0]->x[(3 * q + r) * CN_COLUMNS + k] - x[3 * c[0]->node[q] + r]) <=
                                1e-12 * size);
            for (int i = 0; i < n; i++)
                assert_true(seen[i] == 1 || (seen[i] == 0 && x[3 * i] == 0));
        }
        for (int most = 0; most < 3; most++)
            cn_columns_free(c[most]);
        cn_sparse_free(sparse);
        free(b), free(x), free(seen), free(held);
        fixture_free(&s);
    }
    assert_true(super == 1 && simple == 1);
}

static void work_of_forces_on_it_is_positive(void **state)
{
    (void)state;
    unsigned char *held;
    fixture s = tube(true, &held);
    cn_compliance *c = compliance_of(&s, NULL, ROOM);
    int vertex[TOUCHED];
    touch(vertex, s.body->nnode, 1);
    assert_int_equal(cn_compliance_ensure(c, TOUCHED, vertex), CN_OK);
    for (unsigned seed = 1; seed < 20; seed++) {
        double *f = forces(TOUCHED, seed), y[3 * TOUCHED], work = 0;
        cn_compliance_apply(c, TOUCHED, vertex, f, y);
        for (int i = 0; i < 3 * TOUCHED; i++)
            work += f[i] * y[i];
        assert_true(work > 0);
        free(f);
    }
    free(held);
    cn_compliance_free(c);
    fixture_free(&s);
}

static void a_small_memory_makes_room_and_changes_no_bit(void **state)
{
    (void)state;
    unsigned char *held;
    fixture s = tube(false, &held);
    const int n = s.body->nnode;
    cn_compliance *wide = compliance_of(&s, held, ROOM), *tight;
    int vertex[TOUCHED];
    touch(vertex, n, 3);
    assert_int_equal(cn_compliance_ensure(wide, TOUCHED, vertex), CN_OK);
    const cn_compliance_counts all = cn_compliance_count(wide);
    tight = compliance_of(&s, held, all.bytes / (size_t)all.kept * (TOUCHED + TOUCHED / 2));
    double *f = forces(TOUCHED, 3), a[3 * TOUCHED], b[3 * TOUCHED];
    for (int round = 0; round < 12; round++) {
        touch(vertex, n, 1 + 2 * (round % 4));
        assert_int_equal(cn_compliance_ensure(wide, TOUCHED, vertex), CN_OK);
        assert_int_equal(cn_compliance_ensure(tight, TOUCHED, vertex), CN_OK);
        const long solves = cn_compliance_count(tight).solves;
        assert_int_equal(cn_compliance_ensure(tight, TOUCHED, vertex), CN_OK); /* they are there now */
        assert_int_equal(cn_compliance_count(tight).solves, solves);
        cn_compliance_apply(wide, TOUCHED, vertex, f, a);
        cn_compliance_apply(tight, TOUCHED, vertex, f, b);
        assert_memory_equal(a, b, sizeof a);
    }
    assert_true(cn_compliance_count(tight).dropped > 0 && cn_compliance_count(wide).dropped == 0);
    assert_true(cn_compliance_count(tight).bytes <= all.bytes / (size_t)all.kept * (TOUCHED + TOUCHED / 2));
    assert_true(cn_compliance_count(wide).solves < 200 && cn_compliance_count(wide).solves > 0);

    int *every = calloc((size_t)n, sizeof *every); /* all together do not fit, fewer then still do */
    for (int i = 0; i < n; i++)
        every[i] = i;
    assert_int_equal(cn_compliance_ensure(tight, n, every), CN_ERR_MEMORY);
    assert_int_equal(cn_compliance_ensure(tight, TOUCHED, vertex), CN_OK);
    cn_compliance_apply(tight, TOUCHED, vertex, f, b);
    assert_memory_equal(a, b, sizeof a);
    free(every), free(f), free(held);
    cn_compliance_free(wide), cn_compliance_free(tight);
    fixture_free(&s);
}

static void what_cannot_be_is_refused(void **state)
{
    (void)state;
    unsigned char *held;
    fixture s = tube(false, &held);
    cn_compliance *c = compliance_of(&s, held, ROOM);
    const int beyond[] = {3, s.body->nnode}, below[] = {-1}, twice[] = {30, 31, 30}, good[] = {30, 31};
    double f[6] = {1, 2, 3, 4, 5, 6}, y[6];
    assert_int_equal(cn_compliance_ensure(c, 2, beyond), CN_ERR_ARG);
    assert_int_equal(cn_compliance_ensure(c, 1, below), CN_ERR_ARG);
    assert_int_equal(cn_compliance_ensure(c, 3, twice), CN_ERR_ARG);
    assert_int_equal(cn_compliance_ensure(c, 2, good), CN_OK);
    cn_compliance_apply(c, 2, good, f, y);
    assert_true(y[0] * f[0] > 0);
    assert_int_equal(cn_compliance_ensure(c, 0, NULL), CN_OK);
    const int fixed[] = {2, 30}; /* a held vertex does not move, and is not solved for again */
    assert_true(held[2]);
    assert_int_equal(cn_compliance_ensure(c, 2, fixed), CN_OK);
    cn_compliance_apply(c, 2, fixed, f, y);
    assert_true(y[0] == 0 && y[1] == 0 && y[2] == 0 && cn_norm(y + 3) > 0);
    const long solves = cn_compliance_count(c).solves;
    assert_int_equal(cn_compliance_ensure(c, 2, fixed), CN_OK);
    assert_int_equal(cn_compliance_count(c).solves, solves);
    cn_compliance_free(c);
    cn_error error = {0};
    assert_int_equal(cn_compliance_new(&c, s.matrix, held, 1000, &error), CN_ERR_ARG);
    assert_true(!c && strstr(error.message, "1000 bytes"));
    s.matrix->value[9 * s.matrix->diagonal[100]] = NAN;
    memset(&error, 0, sizeof error);
    assert_int_equal(cn_compliance_new(&c, s.matrix, held, ROOM, &error), CN_ERR_SINGULAR);
    assert_true(!c && strstr(error.message, "positive definite"));
    s.matrix->value[9 * s.matrix->diagonal[100]] = -1;
    assert_int_equal(cn_compliance_new(&c, s.matrix, held, ROOM, NULL), CN_ERR_SINGULAR);
    free(held);
    fixture_free(&s);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    unsigned char *held;
    fixture s = tube(false, &held);
    cn_compliance *c = NULL;
    cn_status status = CN_ERR_MEMORY;
    const int vertex[] = {50, 60, 70};
    for (FAIL_EACH_ALLOC) {
        status = cn_compliance_new(&c, s.matrix, held, ROOM, NULL);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        const long before = fail_alloc_count();
        if (status == CN_OK) assert_int_equal(cn_compliance_ensure(c, 3, vertex), CN_OK);
        assert_int_equal(fail_alloc_count(), before);
        cn_compliance_free(c);
        c = NULL;
    }
    assert_int_equal(status, CN_OK);
    free(held);
    fixture_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(touched_vertices_give_way_as_a_full_solve_says),
        cmocka_unit_test(columns_are_those_of_full_solves_for_any_instruction_set),
        cmocka_unit_test(work_of_forces_on_it_is_positive),
        cmocka_unit_test(a_small_memory_makes_room_and_changes_no_bit),
        cmocka_unit_test(what_cannot_be_is_refused),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
