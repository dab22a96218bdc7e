/* study_cook.c - Cook's membrane: a tapered panel held at its left edge, sheared at its right one. */
#include "catnav/study.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "catnav/mesh.h"
#include "sim.h"
#include "solve.h"

static const double width = 48, left = 44, right_low = 44, right_high = 60;

/* Takes the components `fixed` (3 n) out of the matrix. */
static void hold(cn_matrix *a, const unsigned char *fixed)
{
    for (int i = 0; i < a->n; i++)
        for (int k = a->row[i]; k < a->row[i + 1]; k++)
            for (int e = 0; e < 9; e++) {
                const int row = 3 * i + e / 3, col = 3 * a->col[k] + e % 3;
                if (row != col && (fixed[row] || fixed[col])) a->value[9 * k + e] = 0;
            }
}

/* The panel, `cells` a side and one through its thickness of 1. */
static cn_status panel(cn_tets **out, int cells, bool quadratic)
{
    cn_tets *linear = NULL;
    cn_status status =
        cn_tets_beam(&linear, (const double[3]){1, 1, 1}, (const int[3]){cells, cells, 1}, NULL);
    *out = NULL;
    if (status != CN_OK) return status;
    for (int i = 0; i < linear->nnode; i++) {
        double *x = linear->node + 3 * i;
        const double a = x[0], b = x[1];
        x[0] = width * a, x[1] = (1 - b) * right_low * a + b * (left + (right_high - left) * a);
    }
    if (!quadratic) {
        *out = linear;
        return CN_OK;
    }
    status = cn_tets_raise(out, linear);
    cn_tets_free(linear);
    return status;
}

cn_status cn_study_cook(int cells, bool quadratic, bool strain, double poisson, cn_cook *cook)
{
    const cn_material material = {.young = 1, .poisson = poisson};
    const int first = 0;
    cn_tets *mesh = NULL;
    cn_body *body = NULL;
    cn_matrix *matrix = NULL;
    cn_scatter *scatter = NULL;
    cn_solver *solver = NULL;
    double *load = NULL, *share = NULL, *rotation = NULL, *x = NULL, area = 0;
    unsigned char *fixed = NULL, *edge = NULL;
    cn_status status;

    *cook = (cn_cook){.corner = NAN, .middle = NAN};
    if (!(cells >= 2 && cells <= 256 && cells % 2 == 0)) return CN_ERR_ARG;
    if ((status = panel(&mesh, cells, quadratic)) != CN_OK) goto done;
    const clock_t begun = clock();
    if ((status = cn_body_new(&body, mesh, &material, NULL, NULL)) != CN_OK ||
        (status = cn_matrix_new(&matrix, 1, (const cn_body *const *)&body, &first)) != CN_OK ||
        (status = cn_body_bind(&scatter, body, matrix, 0)) != CN_OK ||
        (status = cn_solver_new(&solver, matrix, CN_LINEAR_CHOLESKY, NULL, NULL)) != CN_OK)
        goto done;
    const size_t n = (size_t)body->nnode;
    status = CN_ERR_MEMORY;
    load = calloc(3 * n, sizeof *load), share = calloc(n, sizeof *share), x = calloc(3 * n, sizeof *x);
    rotation = calloc(4 * (size_t)body->nturn + 1, sizeof *rotation);
    fixed = calloc(3 * n, 1), edge = calloc(n, 1);
    if (!load || !share || !x || !rotation || !fixed || !edge) goto done;

    for (size_t i = 0; i < n; i++) {
        const double *rest = body->rest + 3 * i;
        for (int k = 0; k < 3; k++)
            x[3 * i + (size_t)k] = rest[k];
        fixed[3 * i] = fixed[3 * i + 1] = rest[0] < 1e-9 * width;
        fixed[3 * i + 2] = strain || rest[2] == 0; /* stress: half a plate above its middle plane */
        edge[i] = rest[0] > (1 - 1e-9) * width;
        cook->dof += 3 - fixed[3 * i] - fixed[3 * i + 1] - fixed[3 * i + 2];
    }
    cn_body_face_shares(body, edge, share);
    for (size_t i = 0; i < n; i++)
        area += share[i];
    cn_body_rotation_start(body, rotation);
    cn_body_add_elastic(body, body->nnode, x, rotation, load, CN_TANGENT_WARPED, 1, scatter, NULL);
    hold(matrix, fixed);
    for (size_t i = 0; i < 3 * n; i++) /* at rest nothing pulls: the load alone; force and E are 1 */
        load[i] = i % 3 == 1 && !fixed[i] ? share[i / 3] / area : 0;
    if ((status = cn_solver_factor(solver, matrix, body->nnode, NULL, NULL)) != CN_OK) goto done;
    status = cn_solver_solve(solver, load, x, 1e-10, 1, NULL, NULL, NULL);
    cook->seconds = (double)(clock() - begun) / CLOCKS_PER_SEC;
    cook->nodes = body->nnode;
    for (size_t i = 0; i < n; i++) {
        const double *rest = body->rest + 3 * i;
        if (!edge[i] || rest[2] > 0) continue;
        if (fabs(rest[1] - right_high) < 1e-9 * width) cook->corner = x[3 * i + 1];
        if (fabs(rest[1] - 0.5 * (right_low + right_high)) < 1e-9 * width) cook->middle = x[3 * i + 1];
    }
done:
    free(load), free(share), free(rotation), free(x), free(fixed), free(edge);
    cn_solver_free(solver), cn_scatter_free(scatter), cn_matrix_free(matrix);
    cn_body_free(body), cn_tets_free(mesh);
    return status;
}
