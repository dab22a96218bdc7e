#include "body_fixture.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"

fixture fixture_of(const cn_tets *mesh, const cn_material *material)
{
    fixture s;
    const int first = 0;
    assert_int_equal(cn_body_new(&s.body, mesh, material, NULL, NULL), CN_OK);
    assert_int_equal(cn_matrix_new(&s.matrix, 1, (const cn_body *const *)&s.body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&s.scatter, s.body, s.matrix, 0), CN_OK);
    s.x = numbers(3 * s.body->nnode), s.f = numbers(3 * s.body->nnode);
    s.rotation = numbers(4 * s.body->nturn);
    memcpy(s.x, s.body->rest, 3 * (size_t)s.body->nnode * sizeof *s.x);
    cn_body_rotation_start(s.body, s.rotation);
    return s;
}

void fixture_free(fixture *s)
{
    cn_scatter_free(s->scatter);
    cn_matrix_free(s->matrix);
    cn_body_free(s->body);
    free(s->x);
    free(s->f);
    free(s->rotation);
}

double fixture_force(fixture *s, cn_tangent tangent, const cn_scatter *scatter, cn_pool *pool)
{
    memset(s->f, 0, 3 * (size_t)s->body->nnode * sizeof *s->f);
    if (scatter) cn_matrix_clear(s->matrix, s->matrix->n);
    return cn_body_add_elastic(s->body, s->body->nnode, s->x, s->rotation, s->f, tangent, 1, scatter, pool);
}

void fixture_shake(fixture *s, unsigned seed, double shake)
{
    double r[9], p[3];
    shape_rotation(&seed, r);
    for (int i = 0; i < s->body->nnode; i++) {
        for (int k = 0; k < 3; k++)
            p[k] = s->body->rest[3 * i + k] + shake * shape_random(&seed);
        cn_mat_vec(r, p, s->x + 3 * i);
    }
}

/* Takes the components `fixed` (3 nnode) out of the matrix. */
static void hold(cn_matrix *a, const unsigned char *fixed)
{
    const double scale = largest(a->value, 9 * a->nblock);
    for (int i = 0; i < a->n; i++)
        for (int k = a->row[i]; k < a->row[i + 1]; k++)
            for (int e = 0; e < 9; e++) {
                const int row = 3 * i + e / 3, col = 3 * a->col[k] + e % 3;
                if (fixed[row] || fixed[col]) a->value[9 * k + e] = row == col ? scale : 0;
            }
}

cn_status fixture_factor(fixture *s, cn_solver *solver, cn_tangent tangent, const unsigned char *fixed)
{
    fixture_force(s, tangent, s->scatter, NULL);
    hold(s->matrix, fixed);
    return cn_solver_factor(solver, s->matrix, s->body->nnode, NULL, NULL);
}

void fixture_solve(cn_solver *solver, int n, const double *b, const unsigned char *fixed, double *x)
{
    for (int i = 0; i < n; i++)
        x[i] = fixed[i] ? 0 : b[i];
    assert_int_equal(cn_solver_solve(solver, x, x, 1e-10, 1, NULL, NULL, NULL), CN_OK);
}

int reference_table(const char *name, int n, double **out)
{
    FILE *file = reference_open(name);
    char line[1024];
    int count = 0;
    *out = NULL;
    if (!file || !fgets(line, sizeof line, file)) return 0;
    for (; fgets(line, sizeof line, file); count++) {
        const char *at = line + strlen(line);
        assert_non_null(*out = realloc(*out, (size_t)(count + 1) * (size_t)n * sizeof **out));
        for (int k = n - 1; k >= 0; k--) {
            while (at > line && at[-1] != ',')
                at--;
            (*out)[count * n + k] = strtod(at, NULL);
            if (at > line) at--;
        }
    }
    fclose(file);
    return count;
}

cn_tets *shape_raised(cn_tets *linear, double curve, double size)
{
    cn_tets *mesh;
    assert_int_equal(cn_tets_raise(&mesh, linear), CN_OK);
    for (int i = 0; i < mesh->nnode; i++) {
        double *x = mesh->node + 3 * i;
        const double p[3] = {x[0] / size, x[1] / size, x[2] / size};
        x[0] += curve * size * (p[1] * p[1] + p[2] * p[0]);
        x[1] += curve * size * (p[2] * p[2] - p[0] * p[0]);
        x[2] += curve * size * (p[0] * p[1] - p[0] * p[0]);
    }
    cn_tets_free(linear);
    return mesh;
}
