/* rod.c - a rod's memory, rest shape and frames, and the calls that spread over its chunks. */
#include "rod.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "polar.h"
#include "rod_spin.h"

static cn_status check_section(const cn_section *s, int segment, cn_error *error)
{
    const struct {
        const char *name;
        double value;
    } stiffness[] = {{"axial", s->axial},        {"shear", s->shear[0]},     {"shear", s->shear[1]},
                     {"bending", s->bending[0]}, {"bending", s->bending[1]}, {"torsional", s->torsion}};
    for (size_t i = 0; i < sizeof stiffness / sizeof *stiffness; i++)
        if (!(stiffness[i].value > 0 && stiffness[i].value <= 1e300))
            return cn_fail(error, CN_ERR_ARG, "", 0,
                           "%s stiffness of segment %d is %g: a rod needs one above 0", stiffness[i].name,
                           segment, stiffness[i].value);
    if (!(s->line_mass >= 0 && s->line_inertia[0] >= 0 && s->line_inertia[1] >= 0 &&
          s->line_inertia[2] >= 0 && s->area >= 0 && s->half[0] > 0 && s->half[1] > 0 &&
          s->twist_stress >= 0 && isfinite(s->bend)))
        return cn_fail(
            error, CN_ERR_ARG, "", 0,
            "section of segment %d has a mass of %g kg/m, an area of %g m^2, half widths of %g and "
            "%g m: none may be negative",
            segment, s->line_mass, s->area, s->half[0], s->half[1]);
    return CN_OK;
}

/* The mirror image of a direction u in the plane across d. */
static void reflect(const double d[3], const double u[3], double out[3])
{
    const double f = -2 * cn_dot(d, u) / cn_norm2(d);
    cn_copy3(u, out);
    cn_axpy(f, d, out);
}

static void quaternion_of(const double n[3], const double b[3], const double t[3], double q[4])
{
    const double r[9] = {n[0], b[0], t[0], n[1], b[1], t[1], n[2], b[2], t[2]};
    cn_polar(r, q);
}

/* Frames along a line of points p. Tangents are the mean of the two segments' directions, at the ends
 * mirrored in the last segment, so that an arc's are its own; normals follow by double reflection (Wang and
 * others 2008), without twist. */
static void line_frames(int nnode, const double *p, const double normal[3], double *frame)
{
    const int last = nnode - 1;
    double n[3], b[3], t[3] = {0};
    for (int i = 0; i <= last; i++) {
        double before[3], after[3], next[3];
        cn_sub(p + 3 * (size_t)(i > 0 ? i : 1), p + 3 * (size_t)(i > 0 ? i - 1 : 0), before);
        cn_sub(p + 3 * (size_t)(i < last ? i + 1 : i), p + 3 * (size_t)(i < last ? i : i - 1), after);
        cn_normalise(before), cn_normalise(after);
        cn_add(before, after, next);
        if (!(cn_normalise(next) > 1e-6)) cn_copy3(after, next); /* it turns back on itself */
        if ((i == 0 || i == last) && last > 1) {                 /* mirrored: see above */
            const double *const inner = i == 0 ? p + 3 : p + 3 * (size_t)(last - 1);
            double far[3], mean[3];
            if (i == 0)
                cn_sub(inner + 3, inner, far);
            else
                cn_sub(inner, inner - 3, far);
            cn_normalise(far);
            cn_add(far, before, mean);
            if (cn_normalise(mean) > 1e-6) {
                reflect(before, mean, next);
                for (int k = 0; k < 3; k++)
                    next[k] = -next[k];
            }
        }
        if (i == 0) {
            cn_copy3(normal, n);
        } else {
            double edge[3], seen[3], turned[3], d[3];
            cn_sub(p + 3 * (size_t)i, p + 3 * (size_t)(i - 1), edge);
            reflect(edge, n, seen);
            reflect(edge, t, turned);
            cn_sub(next, turned, d);
            if (cn_norm2(d) > 0)
                reflect(d, seen, n);
            else
                cn_copy3(seen, n);
        }
        cn_copy3(next, t);
        cn_axpy(-cn_dot(n, t), t, n);
        cn_normalise(n);
        cn_cross(t, n, b);
        quaternion_of(n, b, t, frame + 4 * (size_t)i);
    }
}

/* Constants of segments; rest strains are what the kernel finds in the rest shape. */
static void spread_sections(cn_body *body, double *x)
{
    cn_rod *rod = body->own;
    const size_t stride = (size_t)rod->stride;
    double length = 0;
    for (int s = 0; s < body->nelement; s++) {
        const cn_section *section = rod->section + s;
        const double l = cn_distance(body->rest + 3 * (size_t)s, body->rest + 3 * (size_t)(s + 1));
        double *c = rod->constant + 1 + s;
        for (int i = 0; i < 2; i++) {
            c[(CN_ROD_FORCE + (size_t)i) * stride] = section->shear[i];
            c[(CN_ROD_MOMENT + (size_t)i) * stride] = section->bending[i];
        }
        c[(CN_ROD_FORCE + 2) * stride] = section->axial;
        c[(CN_ROD_MOMENT + 2) * stride] = section->torsion;
        c[CN_ROD_LENGTH * stride] = l, c[CN_ROD_INVERSE * stride] = 1 / l;
        for (int end = 0; end < 2; end++) {
            body->mass[s + end] += section->line_mass * l / 2;
            for (int k = 0; k < 3; k++)
                body->inertia[3 * (size_t)(s + end) + (size_t)k] += section->line_inertia[k] * l / 2;
        }
        body->rest_volume += section->area * l;
        body->spring = fmax(body->spring, section->axial / l);
        length += l;
    }
    body->lever = length / body->nelement;

    memcpy(x, body->rest, 3 * (size_t)body->nnode * sizeof *x);
    const cn_rod_job job = {.body = body, .nactive = body->nnode, .x = x, .rotation = rod->frame};
    for (int chunk = 0; chunk < cn_rod_chunks(body->nnode); chunk++) {
        cn_rod_strains strain;
        rod->kernel(&job, chunk, &strain);
        for (int i = 0; i < CN_ROD_CHUNK; i++) {
            const int s = chunk * CN_ROD_CHUNK + i;
            for (int k = 0; s < body->nelement && k < 6; k++)
                rod->constant[(CN_ROD_STRETCH + (size_t)k) * stride + 1 + (size_t)s] =
                    strain[k][1 + i] + (k == 4 ? rod->section[s].bend : 0);
        }
    }
}

static cn_status allocate(cn_body *body, int nnode)
{
    const size_t n = (size_t)nnode;
    cn_rod *rod = calloc(1, sizeof *rod);
    if (!rod) return CN_ERR_MEMORY;
    body->own = rod, body->methods = &cn_body_rod, body->model = CN_BODY_ROD;
    body->nnode = nnode, body->nturn = nnode + 1, body->nblock = 2 * nnode, body->nelement = nnode - 1,
    body->nper = 4;
    body->connect = calloc(n, 4 * sizeof *body->connect);
    body->rest = calloc(n, 3 * sizeof *body->rest);
    body->mass = calloc(n, sizeof *body->mass);
    body->inertia = calloc(n, 3 * sizeof *body->inertia);
    rod->stride = nnode + 2 * CN_ROD_CHUNK;
    rod->constant = calloc((size_t)rod->stride, CN_ROD_CONSTANTS * sizeof *rod->constant);
    rod->section = calloc(n, sizeof *rod->section);
    rod->frame = calloc(n + 1, 4 * sizeof *rod->frame);
    if (rod->frame) rod->frame[4 * n] = 1;
    rod->kernel = cn_rod_kernel_pick(2);
    return body->connect && body->rest && body->mass && body->inertia && rod->constant && rod->section &&
                   rod->frame
               ? CN_OK
               : CN_ERR_MEMORY;
}

static cn_status check(int nnode, const double *axis, const double normal[3], const cn_section *section,
                       const cn_material *material, cn_error *error)
{
    cn_status status = cn_body_check_material(material, true, error);
    if (status != CN_OK) return status;
    if (!(nnode >= 2 && nnode <= 100000000))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "a rod has %d nodes: 2 to 100000000 are needed", nnode);
    double first[3];
    for (int s = 0; s + 1 < nnode; s++) {
        const double length = cn_distance(axis + 3 * (size_t)s, axis + 3 * (size_t)(s + 1));
        if (!(length > 0 && length <= 1e300 && 1 / length <= 1e300))
            return cn_fail(error, CN_ERR_ARG, "", 0, "segment %d of a rod has the length %g m", s, length);
        if ((status = check_section(section + s, s, error)) != CN_OK) return status;
    }
    cn_sub(axis + 3, axis, first);
    double across[3];
    cn_cross(first, normal, across);
    if (!(cn_norm(across) > 1e-6 * cn_norm(first) * cn_norm(normal)))
        return cn_fail(error, CN_ERR_ARG, "", 0,
                       "the normal (%g, %g, %g) of a rod's first frame lies along its axis", normal[0],
                       normal[1], normal[2]);
    return CN_OK;
}

cn_status cn_body_new_rod(cn_body **out, int nnode, const double *axis, const double normal[3],
                          const cn_section *section, const cn_tets *skin, const int *ride,
                          const cn_material *material, cn_error *error)
{
    cn_body *body = NULL;
    double *x = NULL;
    *out = NULL;
    cn_status status = check(nnode, axis, normal, section, material, error);
    if (status != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto done;
    if ((status = allocate(body, nnode)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    if (!(x = calloc((size_t)nnode, 6 * sizeof *x))) goto done;
    cn_rod *rod = body->own;
    memcpy(body->rest, axis, 3 * (size_t)nnode * sizeof *axis);
    memcpy(rod->section, section, (size_t)body->nelement * sizeof *section);
    for (int s = 0; s < body->nelement; s++) {
        const int blocks[4] = {s, s + 1, nnode + s, nnode + s + 1};
        memcpy(body->connect + 4 * (size_t)s, blocks, sizeof blocks);
    }
    body->damping = material->damping, body->damping_stiffness = material->damping_stiffness;
    line_frames(body->nnode, body->rest, normal, rod->frame);
    spread_sections(body, x);
    status = cn_rod_skin(body, skin, ride, error);
done:
    free(x);
    if (status == CN_OK) {
        *out = body;
        return CN_OK;
    }
    if (status == CN_ERR_MEMORY) cn_fail(error, status, "", 0, "out of memory for a rod of %d nodes", nnode);
    cn_body_free(body);
    return status;
}

static void rod_free(cn_body *body)
{
    cn_rod *rod = body->own;
    if (!rod) return;
    free(rod->constant), free(rod->section), free(rod->frame);
    free(rod->offset), free(rod->start), free(rod->riding), free(rod->fibre);
    free(rod);
}

static void rod_rotation_start(const cn_body *body, double *rotation)
{
    const cn_rod *rod = body->own;
    memcpy(rotation, rod->frame, 4 * (size_t)body->nturn * sizeof *rotation);
}

/* A line that turns by more than a right angle between two segments is no curve. */
static bool is_curve(int nnode, const double *p)
{
    double before[3], after[3] = {0, 0, 0};
    for (int i = 1; i < nnode; i++) {
        cn_copy3(after, before);
        cn_sub(p + 3 * (size_t)i, p + 3 * (size_t)(i - 1), after);
        if (!(cn_norm2(after) > 0) || !(i == 1 || cn_dot(before, after) >= 0)) return false;
    }
    return true;
}

void cn_rod_follow(const cn_body *body, const double *x, double *rotation)
{
    const cn_rod *rod = body->own;
    double r[9], before[3], after[3], normal[3];
    if (!is_curve(body->nnode, x)) return;
    cn_quaternion_matrix(rod->frame, r);
    for (int k = 0; k < 3; k++)
        normal[k] = r[3 * k], before[k] = r[3 * k + 2];
    cn_sub(x + 3, x, after);
    cn_normalise(after);
    cn_add(before, after,
           before); /* the least rotation of tangents takes the normal to its image across this */
    if (cn_norm2(before) > 1e-12) reflect(before, normal, normal);
    line_frames(body->nnode, x, normal, rotation);
}

static cn_status rod_bind(cn_scatter *scatter, int first)
{
    const int n = scatter->body->nnode;
    if (!(scatter->block = calloc((size_t)n, CN_ROD_BLOCKS * sizeof *scatter->block))) return CN_ERR_MEMORY;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < (i + 1 < n ? CN_ROD_BLOCKS : 4); k++) {
            const int node[3][2] = {{i, i}, {i, i + 1}, {i + 1, i}}, *pair = node[k / 4];
            const int at = cn_matrix_find(scatter->matrix, first + pair[0] + (k & 2 ? n : 0),
                                          first + pair[1] + (k & 1 ? n : 0));
            if (at < 0) return CN_ERR_ARG;
            scatter->block[CN_ROD_BLOCKS * (size_t)i + (size_t)k] = at;
        }
    return CN_OK;
}

/* A run over chunks: each task takes as many of them in a row. */
typedef struct {
    cn_rod_job job;
    int nchunk, per;
    double energy[CN_ROD_TASKS];
} run;

static void run_task(void *user, int i)
{
    run *r = user;
    const cn_rod *rod = r->job.body->own;
    const int end = (i + 1) * r->per < r->nchunk ? (i + 1) * r->per : r->nchunk;
    double energy = 0;
    for (int chunk = i * r->per; chunk < end; chunk++)
        energy += rod->kernel(&r->job, chunk, NULL);
    r->energy[i] = energy;
}

/* The pool is called where its work outweighs the call: some 300 segments of stiffness. */
enum { POOL_CHUNKS = 5 };

static double rod_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                              cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool)
{
    run r = {.job = {body, nactive, x, rotation, f, tangent, scale, stiffness},
             .nchunk = cn_rod_chunks(nactive)};
    double energy = 0;
    r.per = (r.nchunk + CN_ROD_TASKS - 1) / CN_ROD_TASKS;
    if (r.nchunk == 0) return 0;
    const int ntask = (r.nchunk + r.per - 1) / r.per;
    cn_pool_run(r.nchunk >= POOL_CHUNKS && f ? pool : NULL, ntask, run_task, &r);
    for (int i = 0; i < ntask; i++)
        energy += r.energy[i];
    return energy;
}

static double rod_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    return rod_add_elastic(body, nactive, x, rotation, NULL, CN_TANGENT_EXACT, 1, NULL, pool);
}

static void rod_turn(const cn_body *body, int nactive, double *x, double *rotation)
{
    double *theta = x + 3 * (size_t)body->nnode;
    for (int i = 0; i < nactive; i++, theta += 3) {
        double *q = rotation + 4 * (size_t)i;
        cn_spin spin;
        cn_spin_at(cn_norm2(theta), &spin);
        cn_spin_frame(&spin, theta, q, q);
        const double size = sqrt(q[0] * q[0] + cn_norm2(q + 1));
        for (int k = 0; k < 4; k++)
            q[k] /= size;
        theta[0] = theta[1] = theta[2] = 0;
    }
}

static void rod_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    (void)body;
    cn_add(x + 3 * (size_t)element, x + 3 * (size_t)(element + 1), centre);
    for (int k = 0; k < 3; k++)
        centre[k] *= 0.5;
}

const cn_body_methods cn_body_rod = {.bind = rod_bind,
                                     .add_elastic = rod_add_elastic,
                                     .energy = rod_energy,
                                     .measure = cn_rod_measure,
                                     .element_centre = rod_centre,
                                     .rotation_start = rod_rotation_start,
                                     .points = cn_rod_points,
                                     .carry = cn_rod_carry,
                                     .pull = cn_rod_pull,
                                     .turn = rod_turn,
                                     .free_own = rod_free};
