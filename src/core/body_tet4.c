/* body_tet4.c - linear tetrahedra: constants by element. */
#include "body_element.h"

#include <stdlib.h>
#include "catnav/vec3.h"

/* Volumes and shape function gradients: rows of the inverse of the edge matrix; refuses slivers without
 * volume. */
cn_status cn_tet4_rest(cn_body *body, cn_error *error)
{
    double sum = 0;
    body->nper = 4, body->connect = body->tet;
    if (!(body->shape_grad = calloc((size_t)body->ntet, 12 * sizeof *body->shape_grad))) return CN_ERR_MEMORY;
    for (int e = 0; e < body->ntet; e++) {
        const int *n = body->tet + 4 * (size_t)e;
        double edge[3][3], *g = body->shape_grad + 12 * (size_t)e;
        for (int a = 0; a < 3; a++)
            cn_sub(body->rest + 3 * (size_t)n[1 + a], body->rest + 3 * (size_t)n[0], edge[a]);
        cn_cross(edge[1], edge[2], g + 3);
        cn_cross(edge[2], edge[0], g + 6);
        cn_cross(edge[0], edge[1], g + 9);
        const double six = cn_dot(edge[0], g + 3);
        for (int i = 0; i < 3; i++) {
            g[3 + i] /= six, g[6 + i] /= six, g[9 + i] /= six;
            g[i] = -(g[3 + i] + g[6 + i] + g[9 + i]);
        }
        body->volume[e] = six / 6;
        sum += fabs(six / 6);
        body->rest_volume += six / 6;
    }
    for (int e = 0; e < body->ntet; e++) {
        const int *n = body->tet + 4 * (size_t)e;
        if (!(body->volume[e] > 1e-14 * (sum / body->ntet)))
            return cn_fail(error, CN_FAULT_DEGENERATE, "", 0,
                           "tetrahedron %d (nodes %d %d %d %d) has the volume %g m^3; the mean is %g m^3", e,
                           n[0], n[1], n[2], n[3], body->volume[e], sum / body->ntet);
    }
    return CN_OK;
}

void cn_tet4_mass(cn_body *body, double density)
{
    for (int i = 0; i < 4 * body->ntet; i++)
        body->mass[body->tet[i]] += density * body->volume[i / 4] / 4;
}

const cn_body_methods cn_body_tet4 = {.bind = cn_element_bind,
                                      .add_elastic = cn_element_add_elastic,
                                      .energy = cn_element_energy,
                                      .measure = cn_element_measure,
                                      .element_centre = cn_element_centre,
                                      .free_own = cn_element_free};
