/* body_tet4.c - linear tetrahedra: constants by element, and the calls that spread over the kernels' chunks.
 */
#include "body_element.h"
#include "body_methods.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static cn_status allocate(cn_body *body, int nnode, int ntet)
{
    body->nnode = body->nblock = body->npoint = nnode, body->ntet = body->nelement = body->nturn = ntet;
    body->nper = 4;
    body->tet = calloc((size_t)ntet, 4 * sizeof *body->tet);
    body->rest = calloc((size_t)nnode, 3 * sizeof *body->rest);
    body->shape_grad = calloc((size_t)ntet, 12 * sizeof *body->shape_grad);
    body->volume = calloc((size_t)ntet, sizeof *body->volume);
    body->mu = calloc((size_t)ntet, sizeof *body->mu);
    body->lambda = calloc((size_t)ntet, sizeof *body->lambda);
    body->mass = calloc((size_t)nnode, sizeof *body->mass);
    body->connect = body->tet, body->point = body->rest;
    return body->tet && body->rest && body->shape_grad && body->volume && body->mu && body->lambda &&
                   body->mass
               ? CN_OK
               : CN_ERR_MEMORY;
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

/* Lame constants by element (the last region that holds its centre counts), lumped masses. */
static void spread_material(cn_body *body, const cn_material *m, const double *along)
{
    for (int e = 0; e < body->ntet; e++) {
        const int *n = body->tet + 4 * (size_t)e;
        double centre[3] = {0};
        for (int a = 0; a < 4; a++)
            cn_axpy(0.25, body->rest + 3 * (size_t)n[a], centre);
        const double young = cn_material_young(m, centre, along ? along[e] : NAN);
        body->mu[e] = young / (2 * (1 + m->poisson));
        body->lambda[e] = young * m->poisson / ((1 + m->poisson) * (1 - 2 * m->poisson));
        for (int a = 0; a < 4; a++)
            body->mass[n[a]] += m->density * body->volume[e] / 4;
    }
    body->spring =
        m->young * (1 + fmax(m->poisson, 0) / (1 - 2 * m->poisson)) * cbrt(body->rest_volume / body->ntet);
    body->damping = m->damping, body->damping_stiffness = m->damping_stiffness;
}

cn_status cn_body_new(cn_body **out, const cn_tets *mesh, const cn_material *material, const double *along,
                      cn_error *error)
{
    cn_status status;
    cn_body *body = NULL;
    *out = NULL;
    if (mesh->mid) return cn_fail(error, CN_ERR_ARG, "", 0, "second-order tetrahedra are not available yet");
    if ((status = cn_body_check_material(material, along != NULL, error)) != CN_OK) return status;
    if ((status = cn_body_check_mesh(mesh, error)) != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto fail;
    if ((status = allocate(body, mesh->nnode, mesh->ntet)) != CN_OK) goto fail;
    memcpy(body->tet, mesh->tet, (size_t)mesh->ntet * 4 * sizeof *body->tet);
    memcpy(body->rest, mesh->node, (size_t)mesh->nnode * 3 * sizeof *body->rest);
    body->model = CN_BODY_TET4, body->methods = &cn_body_tet4, body->lever = 1;
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

static void tet4_free(cn_body *body)
{
    free(body->shape_grad);
    cn_element_data_free(body->element);
}

static cn_status tet4_bind(cn_scatter *scatter, int first)
{
    const struct cn_element_data *data = scatter->body->element;
    const size_t lanes = (size_t)data->nbatch * CN_LANES;
    if (!(scatter->block = calloc(lanes, 16 * sizeof *scatter->block))) return CN_ERR_MEMORY;
    for (size_t i = 0; i < lanes; i++)
        for (int a = 0; a < 16; a++) {
            const int *n = data->batch[i / CN_LANES].node[i % CN_LANES];
            const int at = cn_matrix_find(scatter->matrix, first + n[a / 4], first + n[a % 4]);
            if (at < 0) return CN_ERR_ARG;
            scatter->block[16 * i + (size_t)a] = at;
        }
    return CN_OK;
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

static double tet4_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
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

static double tet4_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    double energy[CN_CHUNKS_MAX];
    cn_elastic_job job = {.body = body, .nactive = nactive, .x = x, .rotation = rotation, .energy = energy};
    cn_pool_run(pool, body->element->nchunk, body->element->kernels->elastic, &job);
    return sum_energy(&job);
}

static void tet4_measure(const cn_body *body, int nactive, const double *x, double *rotation,
                         bool with_stress, cn_measures *measures, double *von_mises, cn_pool *pool)
{
    cn_chunk_measures chunk[CN_CHUNKS_MAX];
    cn_measure_job job = {body, nactive, x, rotation, with_stress, von_mises, chunk};
    double loss = 0, growth = 0;
    cn_measures m = {.volume_max = -1, .stress_max = -1};
    if (von_mises) memset(von_mises, 0, (size_t)body->ntet * sizeof *von_mises);
    cn_pool_run(pool, body->element->nchunk, body->element->kernels->measure, &job);
    for (int i = 0; i < body->element->nchunk; i++) {
        const cn_chunk_measures *c = chunk + i;
        cn_keep_largest(c->volume_max, c->volume_element, &m.volume_max, &m.volume_element);
        cn_keep_largest(c->stress_max, c->stress_element, &m.stress_max, &m.stress_element);
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

static void tet4_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    centre[0] = centre[1] = centre[2] = 0;
    for (int a = 0; a < 4; a++)
        cn_axpy(0.25, x + 3 * (size_t)body->tet[4 * (size_t)element + (size_t)a], centre);
}

const cn_body_methods cn_body_tet4 = {.bind = tet4_bind,
                                      .add_elastic = tet4_add_elastic,
                                      .energy = tet4_energy,
                                      .measure = tet4_measure,
                                      .element_centre = tet4_centre,
                                      .free_own = tet4_free};
