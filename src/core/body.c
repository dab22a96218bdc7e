#include "body_element.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static cn_status check_material(const cn_material *m, const double *along, cn_error *error)
{
    if (!(m->young > 0 && m->young <= 1e300))
        return cn_fail(error, CN_ERR_ARG, "", 0, "Young's modulus is %g Pa; it must be positive", m->young);
    if (!(m->poisson > -1 && m->poisson < 0.5))
        return cn_fail(error, CN_ERR_ARG, "", 0,
                       "Poisson's ratio is %.15g; it must lie between -1 and 0.5, both excluded", m->poisson);
    if (!(m->density >= 0 && m->density <= 1e300))
        return cn_fail(error, CN_ERR_ARG, "", 0, "density is %g kg/m^3; it must not be negative", m->density);
    if (!(m->damping >= 0 && m->damping <= 1e300 && m->damping_stiffness >= 0 &&
          m->damping_stiffness <= 1e300))
        return cn_fail(error, CN_ERR_ARG, "", 0, "damping is %g 1/s and %g s; neither may be negative",
                       m->damping, m->damping_stiffness);
    for (int i = 0; i < m->nregion; i++) {
        if (!(m->region[i].young > 0 && m->region[i].young <= 1e300))
            return cn_fail(error, CN_ERR_ARG, "", 0,
                           "Young's modulus of region %d is %g Pa; it must be positive", i,
                           m->region[i].young);
        if (!m->region[i].by_box && !along)
            return cn_fail(error, CN_ERR_ARG, "", 0,
                           "region %d is given along the axis, but this shape has none: give it as a box", i);
    }
    return CN_OK;
}

static cn_status allocate(cn_body *body, int nnode, int ntet)
{
    body->nnode = nnode, body->ntet = ntet;
    body->tet = calloc((size_t)ntet, 4 * sizeof *body->tet);
    body->rest = calloc((size_t)nnode, 3 * sizeof *body->rest);
    body->shape_grad = calloc((size_t)ntet, 12 * sizeof *body->shape_grad);
    body->volume = calloc((size_t)ntet, sizeof *body->volume);
    body->mu = calloc((size_t)ntet, sizeof *body->mu);
    body->lambda = calloc((size_t)ntet, sizeof *body->lambda);
    body->mass = calloc((size_t)nnode, sizeof *body->mass);
    return body->tet && body->rest && body->shape_grad && body->volume && body->mu && body->lambda &&
                   body->mass
               ? CN_OK
               : CN_ERR_MEMORY;
}

static cn_status check_mesh(const cn_tets *mesh, cn_error *error)
{
    if (mesh->nnode < 4 || mesh->ntet < 1)
        return cn_fail(error, CN_ERR_MESH, "", 0,
                       "mesh has %d nodes and %d tetrahedra: nothing to build a body of", mesh->nnode,
                       mesh->ntet);
    for (int e = 0; e < mesh->ntet; e++)
        for (int a = 0; a < 4; a++) {
            const int n = mesh->tet[4 * (size_t)e + a];
            if (n < 0 || n >= mesh->nnode)
                return cn_fail(error, CN_ERR_MESH, "", 0, "tetrahedron %d names node %d of %d", e, n,
                               mesh->nnode);
        }
    return CN_OK;
}

/* Volumes and shape function gradients: rows of the inverse of the edge matrix; refuses slivers without
 * volume. */
static cn_status measure_rest(cn_body *body, cn_error *error)
{
    double sum = 0;
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
            return cn_fail(error, CN_ERR_MESH, "", 0,
                           "tetrahedron %d (nodes %d %d %d %d) has the volume %g m^3; the mean is %g m^3", e,
                           n[0], n[1], n[2], n[3], body->volume[e], sum / body->ntet);
    }
    return CN_OK;
}

/* Boxes are closed, with a tolerance of 1e-9 of their size. */
static bool in_box(const double box[2][3], const double p[3])
{
    const double slack = 1e-9 * cn_distance(box[0], box[1]);
    for (int i = 0; i < 3; i++)
        if (!(p[i] >= box[0][i] - slack && p[i] <= box[1][i] + slack)) return false;
    return true;
}

/* Lame constants by element (the last region that holds its centre counts), lumped masses. */
static void spread_material(cn_body *body, const cn_material *m, const double *along)
{
    for (int e = 0; e < body->ntet; e++) {
        const int *n = body->tet + 4 * (size_t)e;
        double young = m->young, centre[3] = {0};
        for (int a = 0; a < 4; a++)
            cn_axpy(0.25, body->rest + 3 * (size_t)n[a], centre);
        for (int i = 0; i < m->nregion; i++) {
            const cn_region *r = m->region + i;
            if (r->by_box ? in_box(r->box, centre) : along[e] >= r->along[0] && along[e] <= r->along[1])
                young = r->young;
        }
        body->mu[e] = young / (2 * (1 + m->poisson));
        body->lambda[e] = young * m->poisson / ((1 + m->poisson) * (1 - 2 * m->poisson));
        for (int a = 0; a < 4; a++)
            body->mass[n[a]] += m->density * body->volume[e] / 4;
    }
    body->damping = m->damping, body->damping_stiffness = m->damping_stiffness;
}

cn_status cn_body_new(cn_body **out, const cn_tets *mesh, const cn_material *material, const double *along,
                      cn_error *error)
{
    cn_status status;
    cn_body *body = NULL;
    *out = NULL;
    if ((status = check_material(material, along, error)) != CN_OK) return status;
    if ((status = check_mesh(mesh, error)) != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto fail;
    if ((status = allocate(body, mesh->nnode, mesh->ntet)) != CN_OK) goto fail;
    memcpy(body->tet, mesh->tet, (size_t)mesh->ntet * 4 * sizeof *body->tet);
    memcpy(body->rest, mesh->node, (size_t)mesh->nnode * 3 * sizeof *body->rest);
    body->model = CN_BODY_TET4;
    if ((status = measure_rest(body, error)) != CN_OK) goto fail;
    spread_material(body, material, along);
    if ((status = cn_tets_boundary(&body->boundary, mesh)) != CN_OK) goto fail;
    if ((status = cn_element_data_new(&body->element, body)) != CN_OK) goto fail;
    *out = body;
    return CN_OK;
fail:
    if (status == CN_ERR_MEMORY)
        cn_fail(error, status, "", 0, "out of memory for a body of %d tetrahedra", mesh->ntet);
    cn_body_free(body);
    return status;
}

void cn_body_free(cn_body *body)
{
    if (!body) return;
    free(body->tet);
    free(body->rest);
    free(body->shape_grad);
    free(body->volume);
    free(body->mu);
    free(body->lambda);
    free(body->mass);
    cn_surface_free(body->boundary);
    cn_element_data_free(body->element);
    free(body);
}

void cn_body_rotation_start(const cn_body *body, double *rotation)
{
    for (size_t i = 0; i < 4 * (size_t)body->ntet; i++)
        rotation[i] = i % 4 == 0;
}

cn_status cn_body_bind(cn_scatter **out, const cn_body *body, cn_matrix *matrix, int first_node)
{
    cn_status status = CN_ERR_MEMORY;
    const struct cn_element_data *data = body->element;
    cn_scatter *scatter = calloc(1, sizeof *scatter);
    *out = NULL;
    if (!scatter) return CN_ERR_MEMORY;
    if (!(scatter->block = calloc((size_t)data->nbatch * CN_LANES, sizeof *scatter->block))) goto fail;
    scatter->matrix = matrix;
    status = CN_ERR_ARG;
    if (first_node < 0 || first_node > matrix->n - body->nnode) goto fail;
    for (size_t i = 0; i < (size_t)data->nbatch * CN_LANES; i++)
        for (int a = 0; a < 16; a++) {
            const int *n = data->batch[i / CN_LANES].node[i % CN_LANES];
            scatter->block[i][a] = cn_matrix_find(matrix, first_node + n[a / 4], first_node + n[a % 4]);
            if (scatter->block[i][a] < 0) goto fail;
        }
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

typedef struct {
    cn_elastic_job job;
    const int *chunk;
} coloured;

static void coloured_elastic(void *user, int i)
{
    coloured *c = user;
    c->job.body->element->kernels->elastic(&c->job, c->chunk[i]);
}

static double sum_energy(const cn_elastic_job *job)
{
    double sum = 0;
    for (int i = 0; i < job->body->element->nchunk; i++)
        sum += job->energy[i];
    return sum;
}

double cn_body_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                           cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool)
{
    const struct cn_element_data *data = body->element;
    double energy[CN_CHUNKS_MAX];
    coloured c = {{body, nactive, x, rotation, f, tangent, scale, stiffness, energy}, NULL};
    for (int k = 0; k < data->ncolour; k++) {
        c.chunk = data->chunk + data->colour_start[k];
        cn_pool_run(pool, data->colour_start[k + 1] - data->colour_start[k], coloured_elastic, &c);
    }
    return sum_energy(&c.job);
}

double cn_body_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    double energy[CN_CHUNKS_MAX];
    cn_elastic_job job = {.body = body, .nactive = nactive, .x = x, .rotation = rotation, .energy = energy};
    cn_pool_run(pool, body->element->nchunk, body->element->kernels->elastic, &job);
    return sum_energy(&job);
}

/* A maximum once not a number stays so; of equal ones the element with the least index counts. */
static void keep_largest(double value, int element, double *max, int *at)
{
    if (element < 0 || *max != *max) return;
    if (!(value <= *max) || (value == *max && element < *at)) *max = value, *at = element;
}

void cn_body_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                     cn_measures *measures, double *von_mises, cn_pool *pool)
{
    cn_chunk_measures chunk[CN_CHUNKS_MAX];
    cn_measure_job job = {body, nactive, x, rotation, with_stress, von_mises, chunk};
    double loss = 0, growth = 0;
    cn_measures m = {.volume_max = -1, .stress_max = -1};
    if (von_mises) memset(von_mises, 0, (size_t)body->ntet * sizeof *von_mises);
    cn_pool_run(pool, body->element->nchunk, body->element->kernels->measure, &job);
    for (int i = 0; i < body->element->nchunk; i++) {
        const cn_chunk_measures *c = chunk + i;
        keep_largest(c->volume_max, c->volume_element, &m.volume_max, &m.volume_element);
        keep_largest(c->stress_max, c->stress_element, &m.stress_max, &m.stress_element);
        loss += c->volume_sum, growth += c->growth;
        m.stress_mean += c->stress_sum / body->ntet;
        m.energy += c->energy;
        m.inverted += c->inverted;
    }
    if (m.volume_max < 0) m.volume_max = m.stress_max = 0; /* nothing is active */
    m.volume_mean = fabs(loss / body->ntet);
    m.volume = body->rest_volume + growth;
    *measures = m;
}
