#include "rod_cases.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "polar.h"

static double *numbers(int n)
{
    double *a = calloc((size_t)n, sizeof *a);
    assert_non_null(a);
    return a;
}

rod_case rod_case_new(int nnode, const double *axis, const double normal[3], const cn_section *section,
                      const cn_tets *skin)
{
    const cn_material material = {.young = 1, .poisson = 0.3};
    const int first = 0;
    rod_case s;
    cn_error error = {0};
    if (cn_body_new_rod(&s.body, nnode, axis, normal, section, skin, NULL, &material, &error) != CN_OK)
        fail_msg("%s", error.message);
    const int n = s.body->nblock;
    int *level = calloc((size_t)n, sizeof *level);
    assert_non_null(level);
    for (int i = 0; i < n; i++)
        level[i] = i % nnode;
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    assert_int_equal(cn_solver_new(&s.solver, s.matrix, CN_LINEAR_CHOLESKY, level, NULL), CN_OK);
    free(level);
    s.x = numbers(3 * n), s.f = numbers(3 * n), s.load = numbers(3 * n), s.dx = numbers(3 * n);
    s.rotation = numbers(4 * s.body->nturn);
    s.spring = numbers(3 * n);
    s.fixed = calloc((size_t)n, 1);
    assert_non_null(s.fixed);
    memcpy(s.x, s.body->rest, 3 * (size_t)nnode * sizeof *s.x);
    cn_body_rotation_start(s.body, s.rotation);
    return s;
}

rod_case rod_case_straight(int nsegment, double length, const cn_section *section)
{
    double *axis = numbers(3 * (nsegment + 1));
    cn_section *sections = calloc((size_t)nsegment, sizeof *sections);
    assert_non_null(sections);
    for (int i = 0; i <= nsegment; i++)
        axis[3 * i] = length * i / nsegment;
    for (int i = 0; i < nsegment; i++)
        sections[i] = *section;
    const rod_case s = rod_case_new(nsegment + 1, axis, (const double[3]){0, 1, 0}, sections, NULL);
    free(axis), free(sections);
    return s;
}

void rod_case_free(rod_case *s)
{
    cn_solver_free(s->solver);
    cn_scatter_free(s->scatter);
    cn_matrix_free(s->matrix);
    cn_body_free(s->body);
    free(s->x), free(s->f), free(s->load), free(s->dx), free(s->rotation);
    free(s->spring), free(s->fixed);
}

double rod_case_force(rod_case *s, cn_tangent tangent, const cn_scatter *scatter)
{
    memset(s->f, 0, 3 * (size_t)s->body->nblock * sizeof *s->f);
    if (scatter) cn_matrix_clear(s->matrix, s->matrix->n);
    return cn_body_add_elastic(s->body, s->body->nnode, s->x, s->rotation, s->f, tangent, 1, scatter, NULL);
}

void rod_case_dense(const rod_case *s, double *dense)
{
    const int n = 3 * s->matrix->n;
    memset(dense, 0, (size_t)n * (size_t)n * sizeof *dense);
    for (int i = 0; i < s->matrix->n; i++)
        for (int b = s->matrix->row[i]; b < s->matrix->row[i + 1]; b++)
            for (int k = 0; k < 9; k++)
                dense[(3 * i + k / 3) * n + 3 * s->matrix->col[b] + k % 3] = s->matrix->value[9 * b + k];
}

void rod_case_add_springs(rod_case *s)
{
    for (int i = 0; i < 3 * s->body->nblock; i++)
        s->matrix->value[9 * (size_t)s->matrix->diagonal[i / 3] + (size_t)(i % 3 * 4)] += s->spring[i];
}

/* The rest of the balance of forces into f. */
static void balance(rod_case *s)
{
    for (int i = 0; i < 3 * s->body->nblock; i++) {
        const double u = i < 3 * s->body->nnode ? s->x[i] - s->body->rest[i] : 0;
        s->f[i] += s->load[i] - s->spring[i] * u;
        if (s->fixed[i / 3]) s->f[i] = 0;
    }
}

int rod_case_solve(rod_case *s)
{
    const int n = 3 * s->body->nblock, nnode = s->body->nnode;
    double least = INFINITY;
    for (int k = 0; k < 200; k++) {
        for (cn_tangent tangent = CN_TANGENT_EXACT;; tangent = CN_TANGENT_PROJECTED) {
            rod_case_force(s, tangent, s->scatter);
            balance(s);
            rod_case_add_springs(s);
            const cn_status status = cn_solver_factor(s->solver, s->matrix, s->matrix->n, s->fixed, NULL);
            if (status == CN_OK) break;
            if (tangent == CN_TANGENT_PROJECTED) return -1;
        }
        if (cn_solver_solve(s->solver, s->f, s->dx, 0, 1, NULL, NULL, NULL) != CN_OK) return -1;
        double turn = 0, move = 0;
        for (int i = 0; i < 3 * nnode; i++) {
            turn = fmax(turn, fabs(s->dx[3 * nnode + i]));
            move = fmax(move, fabs(s->dx[i]) / (s->body->lever * nnode));
        }
        move = fmax(move, turn);
        if (!(move < INFINITY)) return -1;
        const double step = turn > 0.5 ? 0.5 / turn : 1;
        for (int i = 0; i < n; i++)
            s->x[i] += step * s->dx[i];
        cn_body_turn(s->body, nnode, s->x, s->rotation);
        if (move < 1e-11 || (move < 1e-7 && move >= least)) return k + 1;
        least = fmin(least, move);
    }
    return -1;
}

void rod_case_move(rod_case *s, const double r[9], const double c[3])
{
    double q[4], p[3];
    const int n = s->body->nnode;
    cn_polar(r, q);
    cn_body_turn(s->body, n, s->x, s->rotation);
    for (int i = 0; i < n; i++) {
        double *f = s->rotation + 4 * i, v[3], was[4] = {f[0], f[1], f[2], f[3]};
        cn_mat_vec(r, s->x + 3 * i, p);
        cn_add(p, c, s->x + 3 * i);
        cn_cross(q + 1, was + 1, v);
        f[0] = q[0] * was[0] - cn_dot(q + 1, was + 1);
        for (int k = 0; k < 3; k++)
            f[1 + k] = q[0] * was[1 + k] + was[0] * q[1 + k] + v[k];
    }
}
