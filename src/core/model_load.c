/* model_load.c - a load of the scene as nodal forces: uniform traction on the outer faces wholly in its box,
 * on points that hang on several nodes handed to these by their weights; without any, by mass over the nodes
 * in it. A moment is the field of forces w x r about the loaded points' centre with that resultant; a rod's
 * frames take it as it is. */
#include "model_load.h"

#include <math.h>
#include <stdlib.h>
#include "catnav/vec3.h"

/* What carries a load: nodes, or points that hang on several. */
typedef struct {
    int n;
    bool hung;
    const double *place; /* (n x 3) */
    double *share;       /* (n) */
    double total;        /* their sum */
} carriers;

/* Carriers in the box. */
static cn_status find_carriers(carriers *c, const cn_body *body, const double box[2][3])
{
    double *at_point = calloc((size_t)body->npoint + 1, sizeof *at_point);
    unsigned char *inside = calloc((size_t)body->npoint + 1, 1);
    *c = (carriers){.n = body->nnode, .place = body->rest};
    c->share = calloc((size_t)body->nnode + 1, sizeof *c->share);
    if (!at_point || !inside || !c->share) {
        free(at_point), free(inside);
        return CN_ERR_MEMORY;
    }
    for (int p = 0; p < body->npoint; p++)
        inside[p] = cn_in_box(box, body->point + 3 * p);
    cn_body_face_shares(body, inside, at_point);
    for (int p = 0; p < body->npoint; p++)
        c->share[cn_body_node_of(body, p)] += at_point[p], c->total += at_point[p];
    c->hung = body->nanchor > 0 && c->total > 0;
    if (c->hung) {
        free(c->share);
        c->n = body->npoint, c->place = body->point, c->share = at_point, at_point = NULL;
    }
    const bool none = c->total == 0;
    for (int i = 0; none && i < body->nnode; i++) {
        if (!cn_in_box(box, body->rest + 3 * i)) continue;
        c->share[i] = body->mass[i] > 0 ? body->mass[i] : 1;
        c->total += c->share[i];
    }
    free(at_point), free(inside);
    return CN_OK;
}

/* Adds a force on carrier i to the nodes'. */
static void add_force(const carriers *c, const cn_body *body, int i, double scale, const double f[3],
                      double *force)
{
    if (!c->hung) cn_axpy(scale, f, force + 3 * i);
    for (int k = i * body->nanchor; c->hung && k < (i + 1) * body->nanchor; k++)
        cn_axpy(scale * body->weight[k], f, force + 3 * body->anchor[k]);
}

/* Adds the forces of a moment: share_i w x r_i, where w solves (sum share (r.r I - r r')) w = moment. False:
 * the carriers lie on a line, or are one. */
static bool add_moment(const carriers *c, const cn_body *body, const double moment[3], double *force)
{
    double centre[3] = {0, 0, 0}, inertia[9] = {0}, w[3], size = 0;
    for (int i = 0; i < c->n; i++)
        cn_axpy(c->share[i] / c->total, c->place + 3 * i, centre);
    for (int i = 0; i < c->n; i++) {
        double r[3];
        cn_sub(c->place + 3 * i, centre, r);
        for (int k = 0; k < 9; k++)
            inertia[k] += c->share[i] / c->total * ((k % 4 ? 0 : cn_norm2(r)) - r[k / 3] * r[k % 3]);
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
    for (int i = 0; i < c->n; i++) {
        double r[3], f[3];
        cn_sub(c->place + 3 * i, centre, r);
        cn_cross(w, r, f);
        add_force(c, body, i, c->share[i] / c->total, f, force);
    }
    return true;
}

cn_status cn_model_load(const cn_model_body *out, const cn_load *load, cn_nodal_load *nodal, cn_error *error)
{
    const cn_body *body = out->body;
    const double *low = load->box[0], *high = load->box[1];
    carriers c = {0};
    cn_status status = CN_ERR_MEMORY;
    nodal->from = load->from, nodal->until = load->until;
    nodal->force = calloc(3 * (size_t)body->nblock, sizeof *nodal->force);
    if (!nodal->force) goto done;
    if ((status = find_carriers(&c, body, load->box)) != CN_OK) goto done;
    if (!(c.total > 0)) {
        status = cn_fail(error, CN_FAULT_NOTHING, NULL, 0,
                         "body %s: the load's box [%g %g %g] to [%g %g %g] holds no node: move or widen it",
                         out->spec->name, low[0], low[1], low[2], high[0], high[1], high[2]);
        goto done;
    }
    for (int i = 0; i < c.n; i++)
        add_force(&c, body, i, c.share[i] / c.total, load->force, nodal->force);
    if (body->nblock > body->nnode) {
        for (int i = 0; i < body->nnode; i++)
            cn_axpy(c.share[i] / c.total, load->moment, nodal->force + 3 * (body->nnode + i));
    } else if (cn_norm2(load->moment) > 0 && !add_moment(&c, body, load->moment, nodal->force)) {
        status =
            cn_fail(error, CN_FAULT_NOTHING, NULL, 0,
                    "body %s: the nodes in the load's box [%g %g %g] to [%g %g %g] lie on a line and cannot "
                    "take a moment: widen it",
                    out->spec->name, low[0], low[1], low[2], high[0], high[1], high[2]);
    }
done:
    free(c.share);
    return status;
}
