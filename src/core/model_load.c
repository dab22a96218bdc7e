/* model_load.c - a load of the scene as nodal forces: uniform traction on the outer faces wholly in its box;
 * without any, by mass over the nodes in it. A moment is the field of forces w x r about the loaded nodes'
 * centre with that resultant; a rod's frames take it as it is. */
#include "model_load.h"

#include <math.h>
#include <stdlib.h>
#include "catnav/vec3.h"

/* Shares of nodes in the box, their sum. */
static cn_status shares(const cn_body *body, const double box[2][3], double *share, double *total)
{
    double *at_point = calloc((size_t)body->npoint, sizeof *at_point);
    unsigned char *inside = calloc((size_t)body->npoint, 1);
    *total = 0;
    if (!at_point || !inside) {
        free(at_point), free(inside);
        return CN_ERR_MEMORY;
    }
    for (int p = 0; p < body->npoint; p++)
        inside[p] = cn_in_box(box, body->point + 3 * p);
    cn_body_face_shares(body, inside, at_point);
    for (int p = 0; p < body->npoint; p++)
        share[cn_body_node_of(body, p)] += at_point[p], *total += at_point[p];
    for (int i = 0; *total == 0 && i < body->nnode; i++)
        if (cn_in_box(box, body->rest + 3 * i)) share[i] = body->mass[i] > 0 ? body->mass[i] : 1;
    for (int i = 0; *total == 0 && i < body->nnode; i++)
        at_point[0] += share[i];
    if (*total == 0) *total = at_point[0];
    free(at_point), free(inside);
    return CN_OK;
}

/* Adds the forces of a moment: share_i w x r_i, where w solves (sum share (r.r I - r r')) w = moment. False:
 * the nodes lie on a line, or are one. */
static bool add_moment(const cn_body *body, const double *share, double total, const double moment[3],
                       double *force)
{
    double centre[3] = {0, 0, 0}, inertia[9] = {0}, w[3], size = 0;
    for (int i = 0; i < body->nnode; i++)
        cn_axpy(share[i] / total, body->rest + 3 * i, centre);
    for (int i = 0; i < body->nnode; i++) {
        double r[3];
        cn_sub(body->rest + 3 * i, centre, r);
        for (int k = 0; k < 9; k++)
            inertia[k] += share[i] / total * ((k % 4 ? 0 : cn_norm2(r)) - r[k / 3] * r[k % 3]);
    }
    size = inertia[0] + inertia[4] + inertia[8];
    const double det = cn_det(inertia);
    if (!(det > 1e-12 * size * size * size)) return false;
    for (int k = 0; k < 3; k++) { /* Cramer */
        double m[9];
        for (int j = 0; j < 9; j++)
            m[j] = j % 3 == k ? moment[j / 3] : inertia[j];
        w[k] = cn_det(m) / det;
    }
    for (int i = 0; i < body->nnode; i++) {
        double r[3], f[3];
        cn_sub(body->rest + 3 * i, centre, r);
        cn_cross(w, r, f);
        cn_axpy(share[i] / total, f, force + 3 * i);
    }
    return true;
}

cn_status cn_model_load(const cn_model_body *out, const cn_load *load, cn_nodal_load *nodal, cn_error *error)
{
    const cn_body *body = out->body;
    const double *low = load->box[0], *high = load->box[1];
    double *share = calloc((size_t)body->nnode, sizeof *share), total = 0;
    cn_status status = CN_ERR_MEMORY;
    nodal->from = load->from, nodal->until = load->until;
    nodal->force = calloc(3 * (size_t)body->nblock, sizeof *nodal->force);
    if (!share || !nodal->force) goto done;
    if ((status = shares(body, load->box, share, &total)) != CN_OK) goto done;
    if (!(total > 0)) {
        status = cn_fail(error, CN_ERR_SCENE, NULL, 0,
                         "body %s: the load's box [%g %g %g] to [%g %g %g] holds no node: move or widen it",
                         out->spec->name, low[0], low[1], low[2], high[0], high[1], high[2]);
        goto done;
    }
    for (int i = 0; i < body->nnode; i++)
        cn_axpy(share[i] / total, load->force, nodal->force + 3 * i);
    if (body->nblock > body->nnode) {
        for (int i = 0; i < body->nnode; i++)
            cn_axpy(share[i] / total, load->moment, nodal->force + 3 * (body->nnode + i));
    } else if (cn_norm2(load->moment) > 0 && !add_moment(body, share, total, load->moment, nodal->force)) {
        status =
            cn_fail(error, CN_ERR_SCENE, NULL, 0,
                    "body %s: the nodes in the load's box [%g %g %g] to [%g %g %g] lie on a line and cannot "
                    "take a moment: widen it",
                    out->spec->name, low[0], low[1], low[2], high[0], high[1], high[2]);
    }
done:
    free(share);
    return status;
}
