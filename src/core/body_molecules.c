/* body_molecules.c - the body model `molecules`: springs between neighbours (molecules.h). */
#include "molecules.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static const cn_body_methods bare; /* of a body whose points are its molecules */

static cn_status allocate(cn_body *body, const cn_packing *p, const cn_surface *surface)
{
    const size_t n = (size_t)p->n;
    cn_molecules *m = calloc(1, sizeof *m);
    if (!m) return CN_ERR_MEMORY;
    body->own = m, body->methods = surface ? &cn_body_molecules : &bare, body->model = CN_BODY_MOLECULES;
    body->nnode = body->nblock = p->n, body->nelement = p->nlink, body->nper = 2;
    body->lever = 1;
    body->connect = calloc((size_t)p->nlink + 1, 2 * sizeof *body->connect);
    body->rest = calloc(n, 3 * sizeof *body->rest);
    body->mass = calloc(n, sizeof *body->mass);
    body->tet = calloc(1, sizeof *body->tet);
    m->share = calloc(n, sizeof *m->share);
    if (!body->connect || !body->rest || !body->mass || !body->tet || !m->share) return CN_ERR_MEMORY;
    memcpy(body->connect, p->link, 2 * (size_t)p->nlink * sizeof *body->connect);
    memcpy(body->rest, p->place, 3 * n * sizeof *body->rest);
    memcpy(m->share, p->share, n * sizeof *m->share);
    return CN_OK;
}

/* The vertices that triangles use become the points. */
static cn_status take_surface(cn_body *body, const cn_surface *surface)
{
    cn_status status = cn_surface_new(&body->boundary, 0, surface ? surface->ntri : 0);
    if (status != CN_OK) return status;
    free(body->boundary->vert);
    body->boundary->vert = NULL; /* the points are the body's */
    if (!surface) {
        body->npoint = body->boundary->nvert = body->nnode, body->point = body->rest;
        return CN_OK;
    }
    int *place = malloc(((size_t)surface->nvert + 1) * sizeof *place);
    body->point = calloc((size_t)surface->nvert + 1, 3 * sizeof *body->point);
    if (!place || !body->point) {
        free(place);
        return CN_ERR_MEMORY;
    }
    for (int i = 0; i < surface->nvert; i++)
        place[i] = -1;
    for (int c = 0; c < 3 * surface->ntri; c++)
        place[surface->tri[c]] = 0;
    for (int i = 0; i < surface->nvert; i++)
        if (place[i] == 0) {
            cn_copy3(surface->vert + 3 * (size_t)i, body->point + 3 * (size_t)body->npoint);
            place[i] = body->npoint++;
        }
    for (int c = 0; c < 3 * surface->ntri; c++)
        body->boundary->tri[c] = place[surface->tri[c]];
    body->boundary->nvert = body->npoint;
    free(place);
    return CN_OK;
}

/* Slots of groups of eight: as many as the molecule of a group with the most links has. */
static cn_status pack_links(cn_body *body, const double *constant)
{
    cn_molecules *m = body->own;
    const int n = body->nnode, lanes = CN_MOLECULE_LANES;
    int *count = calloc((size_t)n, sizeof *count);
    if (!count) return CN_ERR_MEMORY;
    for (int c = 0; c < 2 * body->nelement; c++)
        count[body->connect[c]]++;
    m->ngroup = (n + lanes - 1) / lanes;
    m->nchunk = (m->ngroup + CN_MOLECULE_CHUNK - 1) / CN_MOLECULE_CHUNK;
    m->kernels = cn_molecule_kernels_pick(2);
    if (!(m->start = calloc((size_t)m->ngroup + 1, sizeof *m->start))) goto fail;
    for (int i = 0; i < n; i++)
        if (count[i] > m->start[i / lanes + 1]) m->start[i / lanes + 1] = count[i];
    for (int g = 0; g < m->ngroup; g++)
        m->start[g + 1] += m->start[g];
    m->nslot = m->start[m->ngroup];
    const size_t all = ((size_t)m->nslot + 1) * (size_t)lanes;
    m->stiff = aligned_alloc(64, all * sizeof *m->stiff);
    m->length = aligned_alloc(64, all * sizeof *m->length);
    m->other = malloc(all * sizeof *m->other), m->link = malloc(all * sizeof *m->link);
    if (!m->stiff || !m->length || !m->other || !m->link) goto fail;
    for (int g = 0; g < m->ngroup; g++)
        for (int at = m->start[g] * lanes; at < m->start[g + 1] * lanes; at++) {
            const int i = g * lanes + at % lanes;
            m->stiff[at] = 0, m->length[at] = 1, m->link[at] = -1, m->other[at] = i < n ? i : n - 1;
        }
    memset(count, 0, (size_t)n * sizeof *count);
    for (int c = 0; c < 2 * body->nelement; c++) {
        const int i = body->connect[c], j = body->connect[c ^ 1];
        const int at = (m->start[i / lanes] + count[i]++) * lanes + i % lanes;
        m->stiff[at] = constant[c / 2];
        m->length[at] = cn_distance(body->rest + 3 * (size_t)i, body->rest + 3 * (size_t)j);
        m->other[at] = j, m->link[at] = c / 2;
    }
    free(count);
    return CN_OK;
fail:
    free(count);
    return CN_ERR_MEMORY;
}

/* Young's modulus at a link's middle times its constant; masses; what the solver's rounding scales with. */
static cn_status spread_material(cn_body *body, const cn_packing *p, const cn_material *material)
{
    double sum = 0, *constant = malloc(((size_t)p->nlink + 1) * sizeof *constant);
    if (!constant) return CN_ERR_MEMORY;
    cn_status status = cn_molecules_fit(p, constant);
    for (int b = 0; b < p->nlink && status == CN_OK; b++) {
        double centre[3];
        cn_body_element_centre(body, body->rest, b, centre);
        constant[b] *= cn_material_young(material, centre, NAN);
        sum += 2 * constant[b] * constant[b];
    }
    for (int i = 0; i < p->n; i++) {
        body->mass[i] = material->density * p->share[i];
        body->rest_volume += p->share[i];
    }
    body->spring = sqrt(sum / p->n);
    body->damping = material->damping, body->damping_stiffness = material->damping_stiffness;
    if (status == CN_OK) status = pack_links(body, constant);
    free(constant);
    return status;
}

/* A copy of the surface as the doctor leaves it, its volume; refuses what is no solid. */
static cn_status clean_surface(cn_surface **out, const cn_surface *surface, double *volume, cn_error *error)
{
    cn_doctor doctor;
    cn_status status = cn_surface_copy(out, surface);
    if (status == CN_OK) status = cn_surface_check(*out, true, &doctor, error);
    if (status == CN_OK) status = cn_doctor_solid(&doctor, "the surface of molecules", error);
    if (status == CN_OK) *volume = doctor.volume;
    return status;
}

cn_status cn_body_new_molecules(cn_body **out, const cn_surface *surface, const cn_molecules_spec *spec,
                                unsigned seed, const cn_material *material, cn_error *error)
{
    cn_surface *solid = NULL;
    cn_packing *p = NULL;
    cn_body *body = NULL;
    double volume = 0;
    *out = NULL;
    cn_status status = cn_body_check_material(material, false, error);
    if (status != CN_OK) return status;
    if (!surface && !spec->file)
        return cn_fail(error, CN_ERR_ARG, "", 0, "molecules need a surface to fill, or a file");
    if (surface && (status = clean_surface(&solid, surface, &volume, error)) != CN_OK) goto done;
    status = spec->file ? cn_packing_read(&p, spec->file, spec->radius, solid, volume, error)
                        : cn_packing_fill(&p, solid, volume, spec->radius, spec->jittered, seed, error);
    if (status != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto done;
    if ((status = allocate(body, p, solid)) != CN_OK) goto done;
    if ((status = spread_material(body, p, material)) != CN_OK) goto done;
    if ((status = take_surface(body, solid)) != CN_OK) goto done;
    if (solid && (status = cn_molecules_anchor(body, p->spacing, error)) != CN_OK) goto done;
    cn_molecules *m = body->own;
    if ((status = cn_molecule_frames_new(&m->frames, body)) != CN_OK) goto done;
    if (fabs(material->poisson - 0.25) > 0.01)
        CN_LOG(CN_LOG_INFO,
               "molecules: springs along links have Poisson's ratio 0.25, not the material's %g; Young's "
               "modulus is kept",
               material->poisson);
done:
    cn_surface_free(solid);
    cn_packing_free(p);
    if (status == CN_OK) {
        *out = body;
        return CN_OK;
    }
    cn_body_free(body);
    return status == CN_ERR_MEMORY ? cn_fail(error, status, "", 0, "out of memory for a body of molecules")
                                   : status;
}

static void molecules_free(cn_body *body)
{
    cn_molecules *m = body->own;
    if (!m) return;
    free(m->start), free(m->stiff), free(m->length), free(m->other), free(m->link), free(m->share);
    cn_molecule_frames_free(m->frames);
    free(m);
}

static cn_status molecules_bind(cn_scatter *scatter, int first)
{
    const cn_body *body = scatter->body;
    const cn_molecules *m = body->own;
    const int all = m->nslot * CN_MOLECULE_LANES;
    if (!(scatter->block = calloc((size_t)all + (size_t)body->nnode, sizeof *scatter->block)))
        return CN_ERR_MEMORY;
    for (int g = 0; g < m->ngroup; g++)
        for (int at = m->start[g] * CN_MOLECULE_LANES; at < m->start[g + 1] * CN_MOLECULE_LANES; at++) {
            const int row = g * CN_MOLECULE_LANES + at % CN_MOLECULE_LANES;
            const int i = row < body->nnode ? row : body->nnode - 1;
            if ((scatter->block[at] = cn_matrix_find(scatter->matrix, first + i, first + m->other[at])) < 0)
                return CN_ERR_ARG;
        }
    for (int i = 0; i < body->nnode; i++)
        scatter->block[all + i] = scatter->matrix->diagonal[first + i];
    return CN_OK;
}

int cn_molecules_run(cn_molecule_job *job, cn_task task, cn_pool *pool)
{
    const cn_molecules *m = job->body->own;
    job->per = (m->nchunk + CN_MOLECULE_TASKS - 1) / CN_MOLECULE_TASKS;
    const int ntask = (m->nchunk + job->per - 1) / job->per;
    cn_pool_run(m->nchunk > 1 ? pool : NULL, ntask, task, job);
    return ntask;
}

static double molecules_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation,
                                    double *f, cn_tangent tangent, double scale, const cn_scatter *stiffness,
                                    cn_pool *pool)
{
    const cn_molecules *m = body->own;
    cn_molecule_job job = {.body = body,
                           .nactive = nactive,
                           .x = x,
                           .f = f,
                           .tangent = tangent,
                           .scale = scale,
                           .stiffness = stiffness};
    double energy = 0;
    (void)rotation;
    const int ntask = cn_molecules_run(&job, m->kernels->elastic, pool);
    for (int i = 0; i < ntask; i++)
        energy += job.energy[i];
    return energy;
}

static double molecules_energy(const cn_body *body, int nactive, const double *x, double *rotation,
                               cn_pool *pool)
{
    return molecules_add_elastic(body, nactive, x, rotation, NULL, CN_TANGENT_EXACT, 1, NULL, pool);
}

/* Molecules whose three frame neighbours span the other way round. */
static int inverted(const cn_body *body, int nactive, const double *x)
{
    const cn_molecule_frames *f = ((const cn_molecules *)body->own)->frames;
    int n = 0;
    for (int i = 0; i < nactive; i++) {
        const int *neighbour = f->neighbour + 3 * (size_t)i;
        double now[9];
        if (neighbour[2] < 0 || neighbour[0] >= nactive || neighbour[1] >= nactive || neighbour[2] >= nactive)
            continue;
        for (int k = 0; k < 3; k++)
            cn_sub(x + 3 * (size_t)neighbour[k], x + 3 * (size_t)i, now + 3 * k);
        n += !(cn_det(now) * cn_det(f->rest + 9 * (size_t)i) > 0);
    }
    return n;
}

static double molecule_stress(const cn_body *body, int nactive, const double *x, int i)
{
    const cn_molecules *m = body->own;
    const int group = i / CN_MOLECULE_LANES;
    double w[6] = {0};
    for (int slot = m->start[group]; slot < m->start[group + 1] && i < nactive; slot++) {
        const size_t at = (size_t)slot * CN_MOLECULE_LANES + (size_t)(i % CN_MOLECULE_LANES);
        double d[3];
        if (m->link[at] < 0 || m->other[at] >= nactive) continue;
        cn_sub(x + 3 * (size_t)i, x + 3 * (size_t)m->other[at], d);
        const double length = cn_norm(d), pull = m->stiff[at] * (length - m->length[at]);
        for (int a = 0, e = 0; a < 3; a++)
            for (int b = a; b < 3 && length > 0; b++, e++)
                w[e] += pull * d[a] * d[b] / length;
    }
    return cn_virial_stress(w, m->share[i]);
}

/* What the boundary shows: the mean of its corners' nearest molecules. */
typedef struct {
    const cn_body *body;
    int nactive;
    const double *x;
    double *stress; /* of triangles */
} shown;
enum { SHOWN_CHUNK = 128 };

static void show_chunk(void *user, int chunk)
{
    const shown *s = user;
    const cn_surface *surface = s->body->boundary;
    for (int t = chunk * SHOWN_CHUNK; t < surface->ntri && t < (chunk + 1) * SHOWN_CHUNK; t++) {
        s->stress[t] = 0;
        for (int c = 0; c < 3; c++)
            s->stress[t] +=
                molecule_stress(s->body, s->nactive, s->x,
                                cn_body_node_of(s->body, surface->tri[3 * (size_t)t + (size_t)c])) /
                3;
    }
}

static void molecules_measure(const cn_body *body, int nactive, const double *x, double *rotation,
                              bool with_stress, cn_measures *measures, double *von_mises, cn_pool *pool)
{
    const cn_molecules *m = body->own;
    cn_measures task[CN_MOLECULE_TASKS], all = {.volume_max = -1, .stress_max = -1};
    double strain_sum[CN_MOLECULE_TASKS], growth[CN_MOLECULE_TASKS], strains = 0;
    cn_molecule_job job = {.body = body,
                           .nactive = nactive,
                           .x = x,
                           .measures = task,
                           .strain_sum = strain_sum,
                           .growth = growth,
                           .with_stress = with_stress};
    shown show = {body, nactive, x, von_mises};
    (void)rotation;
    if (von_mises)
        cn_pool_run(pool, (body->boundary->ntri + SHOWN_CHUNK - 1) / SHOWN_CHUNK, show_chunk, &show);
    const int ntask = cn_molecules_run(&job, m->kernels->measure, pool);
    all.volume = body->rest_volume;
    for (int i = 0; i < ntask; i++) {
        cn_keep_largest(task[i].volume_max, task[i].volume_element, &all.volume_max, &all.volume_element);
        cn_keep_largest(task[i].stress_max, task[i].stress_element, &all.stress_max, &all.stress_element);
        strains += strain_sum[i], all.volume += growth[i];
        all.stress_mean += task[i].stress_mean / body->nnode, all.energy += job.energy[i];
    }
    if (all.volume_max < 0) all.volume_max = 0;
    if (all.stress_max < 0) all.stress_max = 0;
    if (body->nelement > 0) all.volume_mean = fabs(strains / body->nelement);
    all.inverted = inverted(body, nactive, x);
    *measures = all;
}

static void molecules_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    const int *end = body->connect + 2 * (size_t)element;
    cn_add(x + 3 * (size_t)end[0], x + 3 * (size_t)end[1], centre);
    for (int k = 0; k < 3; k++)
        centre[k] *= 0.5;
}

/* Weights stand since the constructor. */
static void molecules_carry(const cn_body *body, int nactive, const double *x, const double *rotation,
                            cn_carry *carry)
{
    (void)body, (void)nactive, (void)x, (void)rotation, (void)carry;
}

#define SPRINGS                                                                                              \
    .bind = molecules_bind, .add_elastic = molecules_add_elastic, .energy = molecules_energy,                \
    .measure = molecules_measure, .element_centre = molecules_centre, .free_own = molecules_free

static const cn_body_methods bare = {SPRINGS};
const cn_body_methods cn_body_molecules = {SPRINGS, .points = cn_molecules_points, .carry = molecules_carry,
                                           .pull = cn_molecules_pull};
