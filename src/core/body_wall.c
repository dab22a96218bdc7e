/* body_wall.c - membranes, and what shells share with them: memory, stiffness, force. */
#include "body_wall.h"

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "polar.h"

/* --- rest shape --- */

void cn_sheet_plane(const cn_body *body, int t, double axis[3][3], double place[3][2])
{
    const int *c = body->boundary->tri + 3 * (size_t)t;
    double side[3];
    cn_sub(body->rest + 3 * (size_t)c[1], body->rest + 3 * (size_t)c[0], axis[0]);
    cn_sub(body->rest + 3 * (size_t)c[2], body->rest + 3 * (size_t)c[0], side);
    cn_cross(axis[0], side, axis[2]);
    place[0][0] = place[0][1] = place[1][1] = 0;
    place[1][0] = cn_normalise(axis[0]);
    cn_normalise(axis[2]);
    cn_cross(axis[2], axis[0], axis[1]);
    place[2][0] = cn_dot(side, axis[0]), place[2][1] = cn_dot(side, axis[1]);
}

double cn_flat_gradients(const double p[3][2], double grad[3][2])
{
    const double twice =
        (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
    for (int a = 0; a < 3; a++) {
        const double *from = p[(a + 1) % 3], *to = p[(a + 2) % 3];
        grad[a][0] = (from[1] - to[1]) / twice;
        grad[a][1] = (to[0] - from[0]) / twice;
    }
    return twice;
}

static cn_status check_spec(const cn_wall_spec *w, cn_error *error)
{
    const cn_material material = {.young = w->young, .poisson = w->poisson, .density = w->density};
    if (!(w->thickness > 0 && w->thickness <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "thickness of the wall is %g m; it must be positive",
                       w->thickness);
    if (w->model == CN_WALL_MEMBRANE && !(w->foundation > 0 && w->foundation <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0,
                       "foundation of the wall is %g Pa/m; a membrane has no other stiffness across itself "
                       "and needs one above 0",
                       w->foundation);
    if (!(w->foundation >= 0 && w->foundation <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0,
                       "foundation of the wall is %g Pa/m; it must not be negative", w->foundation);
    return cn_body_check_material(&material, false, error);
}

static cn_status check_surface(const cn_surface *s, cn_error *error)
{
    if (s->nvert < 3 || s->ntri < 1 || s->ntri > INT_MAX / CN_SHELL_NODES)
        return cn_fail(error, CN_FAULT_NO_PARTS, "", 0,
                       "surface has %d vertices and %d triangles: no wall can be built of it", s->nvert,
                       s->ntri);
    for (int i = 0; i < 3 * s->nvert; i++)
        if (!isfinite(s->vert[i]))
            return cn_fail(error, CN_ERR_MESH, "", 0, "vertex %d lies at %g, which is no place", i / 3,
                           s->vert[i]);
    for (int i = 0; i < 3 * s->ntri; i++)
        if (s->tri[i] < 0 || s->tri[i] >= s->nvert)
            return cn_fail(error, CN_FAULT_NO_VERTEX, "", 0, "triangle %d names vertex %d of %d", i / 3,
                           s->tri[i], s->nvert);
    return CN_OK;
}

/* What lies across each edge. */
static cn_status find_across(const cn_body *body, int *across)
{
    const int n = 3 * body->nelement, *tri = body->boundary->tri;
    cn_facet *edge = cn_array((size_t)n, sizeof *edge);
    cn_status status = edge ? CN_OK : CN_ERR_MEMORY;
    for (int i = 0; edge && i < n; i++)
        edge[i] = cn_facet_edge(tri[i], tri[i % 3 == 2 ? i - 2 : i + 1], i);
    if (status == CN_OK) status = cn_facet_sort(body->nnode, n, edge);
    for (int i = 0, j; status == CN_OK && i < n; i = j) {
        j = cn_facet_run(n, edge, i);
        for (int k = i; k < j; k++)
            across[edge[k].item] = j - i > 2 ? -2 : j - i < 2 ? -1 : edge[i + j - 1 - k].item;
    }
    free(edge);
    return status;
}

/* Areas, strains, masses, foundation; refuses what has no area. */
static cn_status rest_shape(cn_body *body, const cn_wall_spec *spec, cn_error *error)
{
    cn_sheet *sheet = body->own;
    double sum = 0;
    for (int t = 0; t < body->nelement; t++) {
        double axis[3][3], p[3][2], grad[3][2], *b = sheet->strain + 27 * (size_t)t;
        double *plane = sheet->plane + 12 * (size_t)t;
        cn_sheet_plane(body, t, axis, p);
        sheet->area[t] = cn_flat_gradients((const double(*)[2])p, grad) / 2;
        sum += sheet->area[t];
        memcpy(plane, axis, 6 * sizeof *plane), memcpy(plane + 6, grad, 6 * sizeof *plane);
        for (int a = 0; a < 3; a++)
            for (int k = 0; k < 3; k++) {
                b[3 * a + k] = grad[a][0] * axis[0][k];
                b[9 + 3 * a + k] = grad[a][1] * axis[1][k];
                b[18 + 3 * a + k] = grad[a][1] * axis[0][k] + grad[a][0] * axis[1][k];
            }
    }
    for (int t = 0; t < body->nelement; t++) {
        const int *c = body->boundary->tri + 3 * (size_t)t;
        const double area = sheet->area[t], h = spec->thickness;
        if (!(area > 1e-14 * sum / body->nelement))
            return cn_fail(
                error, CN_FAULT_DEGENERATE, "", 0,
                "triangle %d has an area of %g m^2 where the mean is %g m^2: a wall needs triangles "
                "with an area, remove it",
                t, area == area ? area : 0, sum / body->nelement);
        for (int a = 0; a < 3; a++) {
            body->mass[c[a]] += spec->density * h * area / 3;
            sheet->foundation[c[a]] += spec->foundation * area / 3;
        }
        body->rest_volume += area * h;
    }
    return CN_OK;
}

/* A colour for each triangle, greedy in their order; the last one is of those for which no other is left. */
static cn_status colour_triangles(const cn_body *body, unsigned char *colour)
{
    uint64_t *seen = calloc((size_t)body->nnode, sizeof *seen); /* colours at each node */
    if (!seen) return CN_ERR_MEMORY;
    for (int t = 0; t < body->nelement; t++) {
        const int *node = body->connect + (size_t)body->nper * (size_t)t;
        uint64_t near = 0;
        for (int a = 0; a < body->nper; a++)
            near |= seen[node[a]];
        while (colour[t] < CN_SHEET_COLOURS - 1 && near >> colour[t] & 1)
            colour[t]++;
        for (int a = 0; a < body->nper && colour[t] < CN_SHEET_COLOURS - 1; a++)
            seen[node[a]] |= (uint64_t)1 << colour[t];
    }
    free(seen);
    return CN_OK;
}

static void put_triangle(const cn_body *body, int t, cn_sheet_batch *batch, int lane)
{
    const cn_sheet *sheet = body->own;
    const double nu = sheet->poisson, *grad = sheet->plane + 12 * (size_t)t + 6;
    for (int i = 0; i < 4; i++)
        batch->grad[i][lane] = grad[2 + i];
    for (int a = 0; a < 3; a++)
        batch->node[lane][a] = body->boundary->tri[3 * (size_t)t + (size_t)a];
    batch->size[lane] = sheet->young / (1 - nu * nu) * sheet->thickness * sheet->area[t];
    batch->triangle[lane] = t;
}

static cn_status pack_triangles(cn_body *body)
{
    cn_sheet *sheet = body->own;
    const int most = body->nelement / CN_SHEET_LANES + CN_SHEET_COLOURS;
    unsigned char *colour = calloc((size_t)body->nelement, 1);
    sheet->batch = aligned_alloc(64, (size_t)most * sizeof *sheet->batch);
    sheet->kernel = cn_sheet_kernel_pick(2);
    cn_status status = colour && sheet->batch ? colour_triangles(body, colour) : CN_ERR_MEMORY;
    for (int c = 0, k = 0; status == CN_OK && c < CN_SHEET_COLOURS; sheet->colour[++c] = k) {
        int lane = 0;
        for (int t = 0; t < body->nelement; t++) {
            if (colour[t] != c) continue;
            cn_sheet_batch *batch = sheet->batch + k;
            if (lane == 0)
                for (int i = 0; i < CN_SHEET_LANES; i++)
                    put_triangle(body, t, batch, i), batch->size[i] = 0;
            put_triangle(body, t, batch, lane);
            batch->n = ++lane;
            if (lane == CN_SHEET_LANES) lane = 0, k++;
        }
        k += lane > 0;
    }
    free(colour);
    return status;
}

/* --- stiffness --- */

/* Root R of the plane-stress law for E / (1 - nu^2) = 1: stress = R'R strain. */
static void root_law(double nu, double root[3][3])
{
    memset(root, 0, 9 * sizeof(double));
    root[0][0] = 1, root[0][1] = nu;
    root[1][1] = sqrt(1 - nu * nu);
    root[2][2] = sqrt((1 - nu) / 2);
}

/* Adds B' R'R B times scale^2 for n nodes, B (3 x 3n), turned by `turn` (NULL: not): symmetric to the last
 * bit. block: where blocks of the pattern k lie in `to` (NULL: there). */
static void add_element(const cn_matrix *k, const int *block, double *to, const int *node, int n,
                        const double *b, const double *turn, double scale, double nu)
{
    double root[3][3], v[3][3 * CN_SHELL_NODES];
    root_law(nu, root);
    for (int r = 0; r < 3; r++)
        for (int i = 0; i < 3 * n; i++)
            v[r][i] = scale * (root[r][0] * b[i] + root[r][1] * b[3 * n + i] + root[r][2] * b[6 * n + i]);
    for (int r = 0; turn && r < 3; r++)
        for (int i = 0; i < n; i++) {
            double before[3];
            cn_copy3(v[r] + 3 * i, before);
            cn_mat_vec(turn, before, v[r] + 3 * i);
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            if ((i > 2 && node[i] == node[0]) || (j > 2 && node[j] == node[0])) continue; /* missing ones */
            const int at = cn_matrix_find(k, node[i], node[j]);
            double *value = to + 9 * (size_t)(block ? block[at] : at);
            for (int p = 0; p < 3; p++)
                for (int q = 0; q < 3; q++)
                    for (int r = 0; r < 3; r++)
                        value[3 * p + q] += v[r][3 * i + p] * v[r][3 * j + q];
        }
}

/* The elements' share of the matrix, times `times`; rotation NULL: at rest. */
static void add_elements(const cn_body *body, const double *rotation, double times, const int *block,
                         double *to)
{
    const cn_sheet *sheet = body->own;
    const double nu = sheet->poisson, h = sheet->thickness, plate = sheet->young / (1 - nu * nu) * h;
    for (int t = 0; t < body->nelement; t++) {
        const int *node = body->connect + (size_t)body->nper * (size_t)t;
        const double scale = sqrt(times * plate * sheet->area[t]);
        double turn[9];
        if (rotation) cn_quaternion_matrix(rotation + 4 * (size_t)t, turn);
        add_element(sheet->stiffness, block, to, node, 3, sheet->strain + 27 * (size_t)t,
                    rotation ? turn : NULL, scale, nu);
        if (sheet->curvature)
            add_element(sheet->stiffness, block, to, node, CN_SHELL_NODES,
                        sheet->curvature + 9 * CN_SHELL_NODES * (size_t)t, rotation ? turn : NULL,
                        scale * h / sqrt(12), nu);
    }
}

/* Out of their planes drawn triangles are held by their tension, as in the strains that the rotations have.
 */
static void add_tension(const cn_body *body, const double *rotation, double times, const int *block,
                        double *to)
{
    const cn_sheet *sheet = body->own;
    for (int t = 0; t < body->nelement; t++) {
        const double *plane = sheet->plane + 12 * (size_t)t, *g = plane + 6;
        const int *node = body->boundary->tri + 3 * (size_t)t;
        double s[3], turn[9], rest[3], n[3];
        cn_sheet_tension(sheet, cn_sheet_strains(body, rotation) + 4 * (size_t)t, s);
        cn_quaternion_matrix(rotation + 4 * (size_t)t, turn);
        cn_cross(plane, plane + 3, rest);
        cn_mat_vec(turn, rest, n);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                const double *p = g + 2 * a, *q = g + 2 * b;
                const double held =
                    times * sheet->area[t] *
                    (s[0] * (p[0] * q[0]) + s[1] * (p[1] * q[1]) + s[2] * (p[0] * q[1] + q[0] * p[1]));
                double *value = to + 9 * (size_t)block[cn_matrix_find(sheet->stiffness, node[a], node[b])];
                for (int k = 0; k < 9; k++)
                    value[k] += held * (n[k / 3] * n[k % 3]);
            }
    }
}

static cn_status assemble(cn_body *body)
{
    cn_sheet *sheet = body->own;
    const int first = 0;
    const cn_status status = cn_matrix_new(&sheet->stiffness, 1, (const cn_body *const *)&body, &first);
    if (status != CN_OK) return status;
    add_elements(body, NULL, 1, NULL, sheet->stiffness->value);
    double sum = 0;
    for (int i = 0; i < body->nnode; i++) {
        double *value = sheet->stiffness->value + 9 * (size_t)sheet->stiffness->diagonal[i];
        double most = 0;
        for (int k = 0; k < 9; k += 4)
            most = fmax(most, value[k] += sheet->foundation[i]);
        sum += most * most;
    }
    body->spring = sqrt(sum / body->nnode);
    for (int i = 0; i < body->nnode; i++) { /* of no triangle: it stays, on a spring of its own */
        double *value = sheet->stiffness->value + 9 * (size_t)sheet->stiffness->diagonal[i];
        if (!(value[0] + value[4] + value[8] > 0))
            value[0] = value[4] = value[8] = sheet->foundation[i] = body->spring;
    }
    return CN_OK;
}

/* --- memory --- */

static cn_status allocate(cn_body *body, const cn_surface *surface, const cn_wall_spec *spec)
{
    const size_t n = (size_t)surface->nvert, ntri = (size_t)surface->ntri;
    const bool shell = spec->model == CN_WALL_SHELL;
    cn_sheet *sheet = calloc(1, sizeof *sheet);
    if (!sheet) return CN_ERR_MEMORY;
    body->own = sheet, body->methods = &cn_body_wall;
    body->model = shell ? CN_BODY_SHELL : CN_BODY_MEMBRANE;
    body->nnode = body->nblock = body->npoint = surface->nvert, body->nelement = surface->ntri;
    body->nper = shell ? CN_SHELL_NODES : 3, body->lever = 1, body->nturn = 2 * surface->ntri + 1;
    sheet->thickness = spec->thickness, sheet->young = spec->young, sheet->poisson = spec->poisson;
    body->connect = calloc(ntri, (size_t)body->nper * sizeof *body->connect);
    body->rest = body->point = calloc(n, 3 * sizeof *body->rest);
    body->mass = calloc(n, sizeof *body->mass);
    body->boundary = calloc(1, sizeof *body->boundary);
    sheet->foundation = calloc(n, sizeof *sheet->foundation);
    sheet->area = calloc(ntri, sizeof *sheet->area);
    sheet->strain = calloc(ntri, 27 * sizeof *sheet->strain);
    sheet->plane = calloc(ntri, 12 * sizeof *sheet->plane);
    sheet->across = calloc(ntri, 3 * sizeof *sheet->across);
    if (shell) sheet->curvature = calloc(ntri, 9 * CN_SHELL_NODES * sizeof *sheet->curvature);
    if (!body->connect || !body->rest || !body->mass || !body->boundary || !sheet->foundation ||
        !sheet->area || !sheet->strain || !sheet->plane || !sheet->across || (shell && !sheet->curvature))
        return CN_ERR_MEMORY;
    body->boundary->nvert = surface->nvert, body->boundary->ntri = surface->ntri;
    if (!(body->boundary->tri = calloc(ntri, 3 * sizeof *surface->tri))) return CN_ERR_MEMORY;
    memcpy(body->boundary->tri, surface->tri, 3 * ntri * sizeof *surface->tri);
    memcpy(body->rest, surface->vert, 3 * n * sizeof *surface->vert);
    if (!shell) memcpy(body->connect, surface->tri, 3 * ntri * sizeof *surface->tri);
    return CN_OK;
}

cn_status cn_body_new_wall(cn_body **out, const cn_surface *surface, const cn_wall_spec *spec,
                           cn_error *error)
{
    cn_body *body = NULL;
    cn_status status;
    *out = NULL;
    if (spec->model != CN_WALL_MEMBRANE && spec->model != CN_WALL_SHELL)
        return cn_fail(error, CN_ERR_ARG, "", 0, "a rigid wall has no body: give it model membrane or shell");
    if ((status = check_spec(spec, error)) != CN_OK) return status;
    if ((status = check_surface(surface, error)) != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (!(body = calloc(1, sizeof *body))) goto fail;
    if ((status = allocate(body, surface, spec)) != CN_OK) goto fail;
    if ((status = rest_shape(body, spec, error)) != CN_OK) goto fail;
    if ((status = find_across(body, ((cn_sheet *)body->own)->across)) != CN_OK) goto fail;
    if (spec->model == CN_WALL_SHELL && (status = cn_shell_rest(body, error)) != CN_OK) goto fail;
    if ((status = pack_triangles(body)) != CN_OK) goto fail;
    if ((status = assemble(body)) != CN_OK) goto fail;
    *out = body;
    return CN_OK;
fail:
    if (status == CN_ERR_MEMORY)
        cn_fail(error, status, "", 0, "out of memory for a wall of %d triangles", surface->ntri);
    cn_body_free(body);
    return status;
}

static void wall_free(cn_body *body)
{
    cn_sheet *sheet = body->own;
    if (!sheet) return;
    cn_matrix_free(sheet->stiffness);
    free(sheet->foundation);
    free(sheet->area);
    free(sheet->strain);
    free(sheet->plane);
    free(sheet->batch);
    free(sheet->curvature);
    free(sheet->across);
    free(sheet);
}

void cn_body_wall_rims(const cn_body *body, unsigned char *on_rim)
{
    const int *across = ((const cn_sheet *)body->own)->across, *tri = body->boundary->tri;
    memset(on_rim, 0, (size_t)body->nnode);
    for (int i = 0; i < 3 * body->nelement; i++)
        if (across[i] == -1) on_rim[tri[i]] = on_rim[tri[i % 3 == 2 ? i - 2 : i + 1]] = 1;
}

/* --- force and stiffness: rows of a constant matrix, while triangles do not turn --- */

static cn_status wall_bind(cn_scatter *scatter, int first)
{
    const cn_matrix *k = ((const cn_sheet *)scatter->body->own)->stiffness;
    if (!(scatter->block = calloc((size_t)k->nblock + 1, sizeof *scatter->block))) return CN_ERR_MEMORY;
    for (int i = 0; i < k->n; i++)
        for (int b = k->row[i]; b < k->row[i + 1]; b++)
            if ((scatter->block[b] = cn_matrix_find(scatter->matrix, first + i, first + k->col[b])) < 0)
                return CN_ERR_ARG;
    return CN_OK;
}

typedef struct {
    const cn_body *body;
    const double *x;
    double *f; /* NULL: energy alone */
    double scale;
    const cn_scatter *stiffness;
    double energy[CN_SHEET_TASKS];
} elastic_job;

/* f_i = -sum K_ij (u_j - u_i) - k_i u_i: of a shift nothing but the foundation feels anything. */
static void elastic_task(void *user, int task)
{
    elastic_job *job = user;
    const cn_sheet *sheet = job->body->own;
    const cn_matrix *k = sheet->stiffness;
    const double *x = job->x, *rest = job->body->rest;
    const int begin = (int)((long long)k->n * task / CN_SHEET_TASKS),
              end = (int)((long long)k->n * (task + 1) / CN_SHEET_TASKS);
    double energy = 0;
    for (int i = begin; i < end; i++) {
        double u[3], g[3];
        cn_sub(x + 3 * (size_t)i, rest + 3 * (size_t)i, u);
        for (int c = 0; c < 3; c++)
            g[c] = sheet->foundation[i] * u[c];
        for (int b = k->row[i]; b < k->row[i + 1]; b++) {
            const size_t j = 3 * (size_t)k->col[b];
            const double *v = k->value + 9 * (size_t)b;
            const double d[3] = {x[j] - rest[j] - u[0], x[j + 1] - rest[j + 1] - u[1],
                                 x[j + 2] - rest[j + 2] - u[2]};
            for (int c = 0; c < 3; c++)
                g[c] += v[3 * c] * d[0] + v[3 * c + 1] * d[1] + v[3 * c + 2] * d[2];
        }
        energy += cn_dot(u, g);
        if (job->f) cn_axpy(-1, g, job->f + 3 * (size_t)i);
    }
    job->energy[task] = energy / 2;
    for (int b = k->row[begin]; job->stiffness && b < k->row[end]; b++) {
        double *to = job->stiffness->matrix->value + 9 * (size_t)job->stiffness->block[b];
        for (int c = 0; c < 9; c++)
            to[c] += job->scale * k->value[9 * (size_t)b + (size_t)c];
    }
}

/* The matrix of a wall whose triangles turn: as the rotations have them. */
static void add_turned_stiffness(const cn_body *body, const double *rotation, double scale,
                                 const cn_scatter *stiffness)
{
    const cn_sheet *sheet = body->own;
    const cn_matrix *k = sheet->stiffness;
    add_elements(body, rotation, scale, stiffness->block, stiffness->matrix->value);
    add_tension(body, rotation, scale, stiffness->block, stiffness->matrix->value);
    for (int i = 0; i < body->nnode; i++)
        for (int c = 0; c < 9; c += 4)
            stiffness->matrix->value[9 * (size_t)stiffness->block[k->diagonal[i]] + (size_t)c] +=
                scale * sheet->foundation[i];
}

static double wall_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                               cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool)
{
    elastic_job job = {.body = body, .x = x, .f = f, .scale = scale, .stiffness = stiffness};
    double energy = 0;
    (void)nactive, (void)tangent;
    if (cn_sheet_turns(body, rotation)) {
        if (stiffness) add_turned_stiffness(body, rotation, scale, stiffness);
        return cn_sheet_add_turned(body, x, f, pool);
    }
    cn_pool_run(pool, CN_SHEET_TASKS, elastic_task, &job);
    for (int i = 0; i < CN_SHEET_TASKS; i++)
        energy += job.energy[i];
    return energy;
}

double cn_sheet_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool)
{
    return wall_add_elastic(body, nactive, x, rotation, NULL, CN_TANGENT_EXACT, 1, NULL, pool);
}

static void wall_start(const cn_body *body, double *rotation)
{
    memset(rotation, 0, 4 * (size_t)body->nturn * sizeof *rotation);
    for (int t = 0; t < body->nelement; t++)
        rotation[4 * (size_t)t] = 1;
    rotation[8 * (size_t)body->nelement] = 1;
}

static void wall_centre(const cn_body *body, const double *x, int element, double centre[3])
{
    centre[0] = centre[1] = centre[2] = 0;
    for (int a = 0; a < 3; a++)
        cn_axpy(1.0 / 3, x + 3 * (size_t)body->boundary->tri[3 * (size_t)element + (size_t)a], centre);
}

const cn_body_methods cn_body_wall = {.bind = wall_bind,
                                      .add_elastic = wall_add_elastic,
                                      .energy = cn_sheet_energy,
                                      .measure = cn_sheet_measure,
                                      .element_centre = wall_centre,
                                      .rotation_start = wall_start,
                                      .free_own = wall_free};
