/* body.c - what all body models share: refusals, materials by element, memory, and the way to the model. */
#include "body_methods.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

cn_status cn_body_check_material(const cn_material *m, bool has_along, cn_error *error)
{
    if (!(m->young > 0 && m->young <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "Young's modulus is %g Pa; it must be positive",
                       m->young);
    if (!(m->poisson > -1 && m->poisson < 0.5))
        return cn_fail(error, CN_FAULT_VALUE, "", 0,
                       "Poisson's ratio is %.15g; it must lie between -1 and 0.5, both excluded", m->poisson);
    if (!(m->density >= 0 && m->density <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "density is %g kg/m^3; it must not be negative",
                       m->density);
    if (!(m->damping >= 0 && m->damping <= 1e300 && m->damping_stiffness >= 0 &&
          m->damping_stiffness <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "damping is %g 1/s and %g s; neither may be negative",
                       m->damping, m->damping_stiffness);
    for (int i = 0; i < m->nregion; i++) {
        if (!(m->region[i].young > 0 && m->region[i].young <= 1e300))
            return cn_fail(error, CN_FAULT_VALUE, "", 0,
                           "Young's modulus of region %d is %g Pa; it must be positive", i,
                           m->region[i].young);
        if (!m->region[i].by_box && !has_along)
            return cn_fail(error, CN_ERR_ARG, "", 0,
                           "region %d is given along the axis, but this shape has none: give it as a box", i);
    }
    return CN_OK;
}

cn_status cn_body_check_mesh(const cn_tets *mesh, cn_error *error)
{
    if (mesh->nnode < 4 || mesh->ntet < 1)
        return cn_fail(error, CN_FAULT_NO_PARTS, "", 0,
                       "mesh has %d nodes and %d tetrahedra: nothing to build a body of", mesh->nnode,
                       mesh->ntet);
    for (int e = 0; e < mesh->ntet; e++)
        for (int a = 0; a < 4; a++) {
            const int n = mesh->tet[4 * (size_t)e + a];
            if (n < 0 || n >= mesh->nnode)
                return cn_fail(error, CN_FAULT_NO_VERTEX, "", 0, "tetrahedron %d names node %d of %d", e, n,
                               mesh->nnode);
        }
    return CN_OK;
}

double cn_material_young(const cn_material *m, const double centre[3], double along)
{
    double young = m->young;
    for (int i = 0; i < m->nregion; i++) {
        const cn_region *r = m->region + i;
        if (r->by_box ? cn_in_box(r->box, centre) : along >= r->along[0] && along <= r->along[1])
            young = r->young;
    }
    return young;
}

/* A maximum once not a number stays so; of equal ones the element with the least index counts. */
void cn_keep_largest(double value, int element, double *max, int *at)
{
    if (element < 0 || *max != *max) return;
    if (!(value <= *max) || (value == *max && element < *at)) *max = value, *at = element;
}

void cn_body_free(cn_body *body)
{
    if (!body) return;
    if (body->methods && body->methods->free_own) body->methods->free_own(body);
    if (body->connect != body->tet) free(body->connect);
    if (body->point != body->rest) free(body->point);
    free(body->tet);
    free(body->mid);
    free(body->rest);
    free(body->mass);
    free(body->inertia);
    free(body->anchor), free(body->weight), free(body->upto);
    free(body->volume);
    free(body->mu);
    free(body->lambda);
    cn_surface_free(body->boundary);
    free(body);
}

void cn_body_rotation_start(const cn_body *body, double *rotation)
{
    if (body->methods->rotation_start) {
        body->methods->rotation_start(body, rotation);
        return;
    }
    for (size_t i = 0; i < 4 * (size_t)body->nturn; i++)
        rotation[i] = i % 4 == 0;
}

cn_status cn_body_bind(cn_scatter **out, const cn_body *body, cn_matrix *matrix, int first_block)
{
    cn_status status = CN_ERR_ARG;
    cn_scatter *scatter = calloc(1, sizeof *scatter);
    *out = NULL;
    if (!scatter) return CN_ERR_MEMORY;
    scatter->matrix = matrix, scatter->body = body;
    if (first_block < 0 || first_block > matrix->n - body->nblock) goto fail;
    if ((status = body->methods->bind(scatter, first_block)) != CN_OK) goto fail;
    *out = scatter;
    return CN_OK;
fail:
    cn_scatter_free(scatter);
    return status;
}

void cn_scatter_free(cn_scatter *scatter)
{
    if (!scatter) return;
    free(scatter->block);
    free(scatter);
}

double cn_body_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                           cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool)
{
    return body->methods->add_elastic(body, nactive, x, rotation, f, tangent, scale, stiffness, pool);
}

double cn_body_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    return body->methods->energy(body, nactive, x, rotation, pool);
}

void cn_body_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                     cn_measures *measures, double *von_mises, cn_pool *pool)
{
    body->methods->measure(body, nactive, x, rotation, with_stress, measures, von_mises, pool);
}

void cn_body_element_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    centre[0] = centre[1] = centre[2] = NAN;
    if (element >= 0 && element < body->nelement) body->methods->element_centre(body, x, element, centre);
}

const double *cn_body_points(const cn_body *body, int nactive, const double *x, const double *rotation,
                             double *points)
{
    if (!body->methods->points) return x;
    body->methods->points(body, nactive, x, rotation, points);
    return points;
}

int cn_body_points_of(const cn_body *body, int n)
{
    return body->upto ? body->upto[n] : (int)((long long)n * body->npoint / body->nnode);
}

int cn_body_node_of(const cn_body *body, int point)
{
    if (body->nanchor > 0) return body->anchor[(size_t)point * (size_t)body->nanchor];
    return (int)((long long)point * body->nnode / body->npoint);
}

int cn_body_cells(const cn_body *body)
{
    return body->ntet > 0 ? body->ntet : body->boundary->ntri;
}

cn_status cn_carry_new(cn_carry **out, const cn_body *body)
{
    *out = NULL;
    if (!body->methods->carry) return CN_OK;
    cn_carry *carry = calloc(1, sizeof *carry);
    int *node = calloc((size_t)body->npoint + 1, sizeof *node);
    const bool turns = body->nblock > body->nnode; /* a rod's */
    const size_t per = body->nanchor > 0 ? 9 * (size_t)body->nanchor : 9;
    double *arm = turns ? calloc((size_t)body->npoint + 1, per * sizeof *arm) : NULL;
    if (!carry || !node || (turns && !arm)) {
        free(carry), free(node), free(arm);
        return CN_ERR_MEMORY;
    }
    for (int p = 0; p < body->npoint; p++)
        node[p] = cn_body_node_of(body, p);
    *carry = (cn_carry){node, arm, body->nnode, body->nanchor, body->anchor, body->weight};
    *out = carry;
    return CN_OK;
}

void cn_carry_free(cn_carry *carry)
{
    if (!carry) return;
    free((int *)carry->node);
    free(carry->arm);
    free(carry);
}

void cn_body_carry(const cn_body *body, int nactive, const double *x, const double *rotation, cn_carry *carry)
{
    if (body->methods->carry) body->methods->carry(body, nactive, x, rotation, carry);
}

void cn_body_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                  const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a)
{
    if (body->methods->pull) {
        body->methods->pull(body, nactive, x, rotation, carry, force, f, scale, a);
        return;
    }
    for (int i = 0; i < 3 * nactive; i++)
        f[i] += force[i];
}

void cn_body_turn(const cn_body *body, int nactive, double *x, double *rotation)
{
    if (body->methods->turn) body->methods->turn(body, nactive, x, rotation);
}

void cn_body_face_shares(const cn_body *body, const unsigned char *inside, double *share)
{
    if (body->methods->face_shares) {
        body->methods->face_shares(body, inside, share);
        return;
    }
    for (int t = 0; t < body->boundary->ntri; t++) {
        const int *c = body->boundary->tri + 3 * (size_t)t;
        double e1[3], e2[3], n[3];
        if (!inside[c[0]] || !inside[c[1]] || !inside[c[2]]) continue;
        cn_sub(body->point + 3 * (size_t)c[1], body->point + 3 * (size_t)c[0], e1);
        cn_sub(body->point + 3 * (size_t)c[2], body->point + 3 * (size_t)c[0], e2);
        cn_cross(e1, e2, n);
        for (int k = 0; k < 3; k++)
            share[c[k]] += cn_norm(n) / 6;
    }
}
