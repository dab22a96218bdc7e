/* body_element.c - bodies of tetrahedra of either order: construction, and the calls that spread over the
 * kernels' chunks. */
#include "body_element.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static cn_status allocate(cn_body *body, const cn_tets *mesh)
{
    const size_t nnode = (size_t)mesh->nnode, ntet = (size_t)mesh->ntet;
    body->model = mesh->mid ? CN_BODY_TET10 : CN_BODY_TET4;
    body->methods = mesh->mid ? &cn_body_tet10 : &cn_body_tet4;
    body->nnode = body->nblock = body->npoint = mesh->nnode;
    body->ntet = body->nelement = body->nturn = mesh->ntet;
    body->lever = 1;
    body->tet = calloc(ntet, 4 * sizeof *body->tet);
    body->mid = mesh->mid ? calloc(ntet, 6 * sizeof *body->mid) : NULL;
    body->rest = body->point = calloc(nnode, 3 * sizeof *body->rest);
    body->volume = calloc(ntet, sizeof *body->volume);
    body->mu = calloc(ntet, sizeof *body->mu);
    body->lambda = calloc(ntet, sizeof *body->lambda);
    body->mass = calloc(nnode, sizeof *body->mass);
    if (!body->tet || (mesh->mid && !body->mid) || !body->rest || !body->volume || !body->mu ||
        !body->lambda || !body->mass)
        return CN_ERR_MEMORY;
    memcpy(body->tet, mesh->tet, ntet * 4 * sizeof *body->tet);
    if (mesh->mid) memcpy(body->mid, mesh->mid, ntet * 6 * sizeof *body->mid);
    memcpy(body->rest, mesh->node, nnode * 3 * sizeof *body->rest);
    return CN_OK;
}

/* Stiffness of an element against moving a corner [N/m]: (la + 2 mu) V |g|^2, g the steepest gradient of a
 * shape function: the area of a face over three times the volume. */
static double element_spring(const cn_body *body, int e)
{
    const int *n = body->tet + 4 * (size_t)e;
    double most = 0;
    for (int a = 0; a < 4; a++) {
        const double *x = body->rest + 3 * (size_t)n[(a + 1) % 4];
        double p[3], q[3], normal[3];
        cn_sub(body->rest + 3 * (size_t)n[(a + 2) % 4], x, p);
        cn_sub(body->rest + 3 * (size_t)n[(a + 3) % 4], x, q);
        cn_cross(p, q, normal);
        most = fmax(most, cn_norm2(normal) / 4);
    }
    return (body->lambda[e] + 2 * body->mu[e]) * most / (9 * body->volume[e]);
}

/* Lame constants by element (the last region that holds its centre counts). */
static void spread_material(cn_body *body, const cn_material *m, const double *along)
{
    for (int e = 0; e < body->ntet; e++) {
        double centre[3];
        cn_body_element_centre(body, body->rest, e, centre);
        const double young = cn_material_young(m, centre, along ? along[e] : NAN);
        body->mu[e] = young / (2 * (1 + m->poisson));
        body->lambda[e] = young * m->poisson / ((1 + m->poisson) * (1 - 2 * m->poisson));
    }
    double sum = 0;
    for (int e = 0; e < body->ntet; e++) {
        const double k = (body->mid ? 4 : 1) * element_spring(body, e);
        sum += k * k;
    }
    body->spring = sqrt(sum / body->nnode);
    body->damping = m->damping, body->damping_stiffness = m->damping_stiffness;
}

cn_status cn_body_new(cn_body **out, const cn_tets *mesh, const cn_material *material, const double *along,
                      cn_error *error)
{
    cn_status status;
    cn_body *body = NULL;
    *out = NULL;
    if ((status = cn_body_check_material(material, along != NULL, error)) != CN_OK) return status;
    if ((status = cn_body_check_mesh(mesh, error)) != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto fail;
    if ((status = allocate(body, mesh)) != CN_OK) goto fail;
    if ((status = (mesh->mid ? cn_tet10_rest : cn_tet4_rest)(body, error)) != CN_OK) goto fail;
    (mesh->mid ? cn_tet10_mass : cn_tet4_mass)(body, material->density);
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

void cn_element_free(cn_body *body)
{
    free(body->shape_grad);
    cn_element_data_free(body->element);
}

cn_status cn_element_bind(cn_scatter *scatter, int first)
{
    const cn_body *body = scatter->body;
    const int nper = body->nper, lanes = body->element->nbatch * CN_LANES;
    int *block = calloc((size_t)lanes, (size_t)(nper * nper) * sizeof *block);
    if (!(scatter->block = block)) return CN_ERR_MEMORY;
    for (int i = 0; i < lanes; i++) {
        const int from = i < body->ntet ? i : i / CN_LANES * CN_LANES; /* empty lanes copy a full one */
        const int *n = body->connect + (size_t)nper * (size_t)body->element->order[from];
        for (int a = 0; a < nper * nper; a++, block++)
            if ((*block = cn_matrix_find(scatter->matrix, first + n[a / nper], first + n[a % nper])) < 0)
                return CN_ERR_ARG;
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

double cn_element_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
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

double cn_element_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    double energy[CN_CHUNKS_MAX];
    cn_elastic_job job = {.body = body, .nactive = nactive, .x = x, .rotation = rotation, .energy = energy};
    cn_pool_run(pool, body->element->nchunk, body->element->kernels->elastic, &job);
    return sum_energy(&job);
}

void cn_element_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
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

void cn_element_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    centre[0] = centre[1] = centre[2] = 0;
    for (int a = 0; a < 4; a++)
        cn_axpy(0.25, x + 3 * (size_t)body->tet[4 * (size_t)element + (size_t)a], centre);
}
