/* body_beam.c - how stiff a chain of tetrahedra is against beam theory: pure bending, torsion and tension of
 * a clamped piece by linear static solves, read between its quarter points, where the ends no longer show. */
#include "body_element.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "body_beam.h"
#include "body_face.h"
#include "solve.h"

static const double pi = 3.14159265358979323846;

/* A piece of nsection sections along `axis`, the first that of node 0; held at the last one, loaded at the
 * first. u and v are the section's axes from its centroid, in the cyclic order axis, u, v. */
typedef struct {
    cn_body *body;
    cn_matrix *matrix;
    cn_scatter *scatter;
    cn_solver *solver;
    int nsection, axis;
    double area, moment[2], centre[2]; /* of the meshed section: A, integrals of u^2 and v^2 */
    double *rotation, *f, *x;
    int *section, *level; /* of each node; levels for the solver: what an element spans lies in two */
    unsigned char *fixed;
} piece;

static void piece_free(piece *p)
{
    cn_solver_free(p->solver);
    cn_scatter_free(p->scatter);
    cn_matrix_free(p->matrix);
    cn_body_free(p->body);
    free(p->rotation);
    free(p->f);
    free(p->x);
    free(p->section);
    free(p->level);
    free(p->fixed);
}

static void section_place(const piece *p, const double *x, double uv[2])
{
    uv[0] = x[(p->axis + 1) % 3] - p->centre[0];
    uv[1] = x[(p->axis + 2) % 3] - p->centre[1];
}

/* A point of integration on the loaded end: its place in the section, the area it stands for, and the shape
 * functions of the face's n nodes there. */
typedef struct {
    double uv[2], area, shape[CN_FACE_NODES];
    int n, node[CN_FACE_NODES];
} end_point;

typedef void (*visit_point)(piece *p, const end_point *at, void *user);
static void each_end_point(piece *p, visit_point visit, void *user)
{
    end_point at;
    for (int face = 0; (at.n = cn_body_face(p->body, face, at.node)) > 0; face++) {
        bool end = true;
        for (int a = 0; a < at.n; a++)
            end = end && p->section[at.node[a]] == 0;
        for (int k = 0; end && k < CN_FACE_POINTS; k++) {
            double x[3], normal[3];
            cn_body_face_at(p->body, face, k, at.shape, x, normal);
            section_place(p, x, at.uv);
            at.area = cn_norm(normal);
            visit(p, &at, user);
        }
    }
}

static void add_centre(piece *p, const end_point *at, void *user)
{
    double *sum = user;
    p->area += at->area;
    for (int k = 0; k < 2; k++)
        sum[k] += at->area * at->uv[k];
}

static void add_moment(piece *p, const end_point *at, void *user)
{
    (void)user;
    for (int k = 0; k < 2; k++)
        p->moment[k] += at->area * at->uv[k] * at->uv[k];
}

/* Traction of a load at a point of the section, as axis, u, v. */
static void traction(int load, const double uv[2], double t[3])
{
    t[0] = load == CN_BEAM_AXIAL ? 1 : load == CN_BEAM_TORSION ? 0 : uv[load - CN_BEAM_BENDING_U];
    t[1] = load == CN_BEAM_TORSION ? -uv[1] : 0;
    t[2] = load == CN_BEAM_TORSION ? uv[0] : 0;
}

static void add_load(piece *p, const end_point *at, void *user)
{
    double t[3];
    traction(*(const int *)user, at->uv, t);
    for (int a = 0; a < at->n; a++)
        for (int k = 0; k < 3; k++)
            p->f[3 * at->node[a] + (p->axis + k) % 3] += at->area * at->shape[a] * t[k];
}

/* What the displacement u does to a section that goes with the load: mean advance, slope about v or u (least
 * squares), or turn. */
static double response(const piece *p, int load, const double *u, int section)
{
    double m[9] = {0}, b[3] = {0}, turn = 0, square = 0;
    int count = 0;
    for (int n = 0; n < p->body->nnode; n++) {
        if (p->section[n] != section) continue;
        const double *un = u + 3 * (size_t)n;
        double uv[2];
        count++;
        section_place(p, p->body->rest + 3 * (size_t)n, uv);
        const double row[3] = {1, uv[0], uv[1]}, *along = un + p->axis;
        for (int i = 0; i < 3; i++) {
            b[i] += row[i] * *along;
            for (int j = 0; j < 3; j++)
                m[3 * i + j] += row[i] * row[j];
        }
        turn += uv[0] * un[(p->axis + 2) % 3] - uv[1] * un[(p->axis + 1) % 3];
        square += uv[0] * uv[0] + uv[1] * uv[1];
    }
    if (load == CN_BEAM_TORSION) return turn / square;
    if (load == CN_BEAM_AXIAL) return b[0] / count;
    const double det = cn_det(m);
    for (int i = 0; i < 3; i++)
        m[3 * i + load] = b[i]; /* Cramer: column 1 for u, 2 for v */
    return cn_det(m) / det;
}

/* Place of a node along the axis, from node 0. */
static double ahead(const piece *p, int node)
{
    return p->body->rest[3 * (size_t)node + (size_t)p->axis] - p->body->rest[p->axis];
}

/* Sections, by place; the last one is held. */
static void find_sections(piece *p)
{
    const int n = p->body->nnode, order = p->body->model == CN_BODY_TET10 ? 2 : 1;
    double end = 0;
    for (int i = 0; i < n; i++)
        if (fabs(ahead(p, i)) > fabs(end)) end = ahead(p, i);
    for (int i = 0; i < n; i++) {
        p->section[i] = (int)lround(ahead(p, i) / end * (p->nsection - 1));
        p->level[i] = p->section[i] / order;
        p->fixed[i] = p->section[i] == p->nsection - 1;
    }
}

enum { CHAIN_NODES = 64 }; /* up to so many a section, elimination section by section is the fastest */

static cn_status piece_new(piece *p, const cn_tets *mesh, int nsection, int axis, const cn_material *given)
{
    cn_status status;
    const cn_material material = {.young = given->young, .poisson = given->poisson};
    const int first = 0, n = mesh->nnode;
    double sum[2] = {0};
    *p = (piece){.nsection = nsection, .axis = axis};
    if ((status = cn_body_new(&p->body, mesh, &material, NULL, NULL)) != CN_OK) return status;
    if ((status = cn_matrix_new(&p->matrix, 1, (const cn_body *const *)&p->body, &first)) != CN_OK)
        return status;
    if ((status = cn_body_bind(&p->scatter, p->body, p->matrix, 0)) != CN_OK) return status;
    p->rotation = calloc((size_t)p->body->nturn, 4 * sizeof *p->rotation);
    p->f = calloc((size_t)n, 3 * sizeof *p->f);
    p->x = calloc((size_t)n, 3 * sizeof *p->x);
    p->section = calloc((size_t)n, sizeof *p->section);
    p->level = calloc((size_t)n, sizeof *p->level);
    p->fixed = calloc((size_t)n, 1);
    if (!p->rotation || !p->f || !p->x || !p->section || !p->level || !p->fixed) return CN_ERR_MEMORY;
    find_sections(p);
    const cn_linear kind = n / nsection <= CHAIN_NODES ? CN_LINEAR_CHAIN : CN_LINEAR_CHOLESKY;
    if ((status = cn_solver_new(&p->solver, p->matrix, kind, p->level, NULL)) != CN_OK) return status;
    cn_body_rotation_start(p->body, p->rotation);
    cn_matrix_clear(p->matrix, n);
    cn_body_add_elastic(p->body, n, p->body->rest, p->rotation, p->f, CN_TANGENT_WARPED, 1, p->scatter, NULL);
    each_end_point(p, add_centre, sum);
    p->centre[0] = sum[0] / p->area, p->centre[1] = sum[1] / p->area;
    each_end_point(p, add_moment, NULL);
    return cn_solver_factor(p->solver, p->matrix, n, p->fixed, NULL);
}

/* The force or moment of p->f: its work on the motion that goes with the load. */
static double resultant(const piece *p, int load)
{
    double sum = 0;
    for (int i = 0; i < p->body->nnode; i++) {
        double uv[2], t[3];
        section_place(p, p->body->rest + 3 * (size_t)i, uv);
        traction(load, uv, t);
        for (int k = 0; k < 3; k++)
            sum += p->f[3 * i + (p->axis + k) % 3] * t[k];
    }
    return sum;
}

/* EA, EI against u and v, GJ of the piece. */
static cn_status piece_stiffness(piece *p, double stiffness[CN_BEAM_LOADS])
{
    const int order = p->body->model == CN_BODY_TET10 ? 2 : 1; /* read where the corners are */
    const int low = p->nsection / 4 / order * order, high = 3 * p->nsection / 4 / order * order;
    const size_t n = 3 * (size_t)p->body->nnode;
    double end = 0;
    for (int i = 0; i < p->body->nnode; i++)
        if (p->section[i] == p->nsection - 1) end = ahead(p, i);
    const double length = fabs(end) * (high - low) / (p->nsection - 1);
    for (int load = 0; load < CN_BEAM_LOADS; load++) {
        memset(p->f, 0, n * sizeof *p->f);
        memset(p->x, 0, n * sizeof *p->x);
        each_end_point(p, add_load, &load);
        const cn_status status = cn_solver_solve(p->solver, p->f, p->x, 1e-9, 1, NULL, NULL, NULL);
        if (status != CN_OK) return status;
        stiffness[load] =
            resultant(p, load) * length / fabs(response(p, load, p->x, high) - response(p, load, p->x, low));
    }
    return CN_OK;
}

enum { POLYGON_TERMS = 1000, NODES_MAX = 6000 };

/* J over the polar moment of a regular polygon. With w = f(z) = sum a_j z^(jn+1), f' = (1 - z^n)^(-2/n), from
 * the unit disc, |f|^2 = sum c_k cos(k n t) on its rim, and J = I_p - pi sum_k k n (c_k / 2)^2
 * (Saint-Venant's torsion by the harmonic conjugate of the warping). */
static double polygon_torsion_sum(int sides, int terms)
{
    const double n = sides, power = 2 / n;
    double a[POLYGON_TERMS], binomial = 1, lost = 0;
    for (int j = 0; j < terms; j++) {
        a[j] = binomial / (j * n + 1);
        binomial *= (power + j) / (j + 1);
    }
    for (int k = 1; k < terms; k++) {
        double c = 0;
        for (int j = 0; j + k < terms; j++)
            c += 2 * a[j] * a[j + k];
        lost += pi * k * n * c * c / 4;
    }
    const double radius = tgamma(1 / n) * tgamma(1 - power) / (n * tgamma(1 - 1 / n)); /* |f(1)| */
    const double area = n / 2 * radius * radius * sin(2 * pi / n);
    return 1 - lost / (area * radius * radius / 6 * (2 + cos(2 * pi / n)));
}

/* Its limit for many terms: they fall like a power of their number, which Aitken's process takes out. */
static double polygon_torsion(int sides)
{
    const double a = polygon_torsion_sum(sides, POLYGON_TERMS / 4),
                 b = polygon_torsion_sum(sides, POLYGON_TERMS / 2);
    const double c = polygon_torsion_sum(sides, POLYGON_TERMS), bend = c - 2 * b + a;
    return bend != 0 ? c - (c - b) * (c - b) / bend : c;
}

static double worse_bending(const double got[CN_BEAM_LOADS], const double truth[CN_BEAM_LOADS])
{
    const double u = got[CN_BEAM_BENDING_U] / truth[CN_BEAM_BENDING_U] - 1;
    const double v = got[CN_BEAM_BENDING_V] / truth[CN_BEAM_BENDING_V] - 1;
    return fabs(u) > fabs(v) ? u : v;
}

/* Sections a piece needs: at least `least` and four depths long, but no more than the device has. */
static int sections_of(double depth, double spacing, int least, int most)
{
    const double want = fmin(4 * depth / spacing, 1e6) + 1;
    const int n = want > least ? (int)want : least;
    return n < most ? n : most;
}

cn_status cn_beam_stiffness(const cn_tets *mesh, int nsection, int axis, const cn_material *material,
                            double mesh_stiffness[CN_BEAM_LOADS], double section[CN_BEAM_LOADS])
{
    piece p;
    cn_status status = piece_new(&p, mesh, nsection, axis, material);
    if (status == CN_OK) status = piece_stiffness(&p, mesh_stiffness);
    const double shear = material->young / (2 * (1 + material->poisson));
    section[CN_BEAM_AXIAL] = material->young * p.area;
    section[CN_BEAM_BENDING_U] = material->young * p.moment[0];
    section[CN_BEAM_BENDING_V] = material->young * p.moment[1];
    section[CN_BEAM_TORSION] = shear * (p.moment[0] + p.moment[1]);
    piece_free(&p);
    return status;
}

/* Stiffness of the shape's own section, a catheter's core included. */
static cn_status truth_of(const cn_shape *shape, const cn_material *material, double truth[CN_BEAM_LOADS])
{
    cn_section s;
    const cn_status status = cn_section_of(&s, shape, material, material->young, NULL);
    if (status != CN_OK) return status;
    truth[CN_BEAM_AXIAL] = s.axial, truth[CN_BEAM_TORSION] = s.torsion;
    truth[CN_BEAM_BENDING_U] = s.bending[1], truth[CN_BEAM_BENDING_V] = s.bending[0]; /* n is u */
    return CN_OK;
}

/* torsion_ratio: J over the polar moment of the meshed section. */
static cn_status beam_error(const cn_tets *mesh, int nsection, int axis, const cn_material *m,
                            const double truth[CN_BEAM_LOADS], double torsion_ratio, cn_beam_error *out)
{
    double got[CN_BEAM_LOADS], section[CN_BEAM_LOADS];
    const cn_status status = cn_beam_stiffness(mesh, nsection, axis, m, got, section);
    if (status != CN_OK) return status;
    section[CN_BEAM_TORSION] *= torsion_ratio;
    out->bending = worse_bending(got, truth), out->polygon_bending = worse_bending(section, truth);
    out->torsion = got[CN_BEAM_TORSION] / truth[CN_BEAM_TORSION] - 1;
    out->polygon_torsion = section[CN_BEAM_TORSION] / truth[CN_BEAM_TORSION] - 1;
    out->axial = got[CN_BEAM_AXIAL] / truth[CN_BEAM_AXIAL] - 1;
    out->polygon_axial = section[CN_BEAM_AXIAL] / truth[CN_BEAM_AXIAL] - 1;
    return CN_OK;
}

cn_status cn_beam_error_catheter(const cn_shape *shape, const cn_material *material, cn_body_model model,
                                 cn_beam_error *out)
{
    cn_tets *mesh = NULL;
    const double d = shape->catheter.diameter, inner = shape->catheter.inner_diameter;
    const int stations = shape->catheter.stations, sides = shape->catheter.sides;
    const double spacing = shape->catheter.length / (stations - 1);
    const bool second = model == CN_BODY_TET10;
    double truth[CN_BEAM_LOADS];
    *out = (cn_beam_error){0};
    if (model == CN_BODY_ROD) return CN_OK;
    *out = (cn_beam_error){NAN, NAN, NAN, NAN, NAN, NAN};
    if (stations < 8 || !(shape->catheter.length >= 3 * d)) return CN_OK;
    cn_status status = truth_of(shape, material, truth);
    if (status != CN_OK) return status;
    const int n = sections_of(d, spacing, second ? 21 : 41, stations);
    status =
        (second ? cn_tets_catheter10 : cn_tets_catheter)(&mesh, spacing * (n - 1), d, inner, n, sides, NULL);
    if (status != CN_OK) return status;

    status = beam_error(mesh, second ? 2 * n - 1 : n, 2, material, truth,
                        inner > 0 ? NAN : polygon_torsion(sides), out);
    cn_tets_free(mesh);
    return status;
}

/* The mesh of a beam's piece; second: of second-order tetrahedra. */
static cn_status beam_mesh(cn_tets **out, const double size[3], const int cells[3], bool second)
{
    cn_tets *linear = NULL;
    cn_status status = cn_tets_beam(&linear, size, cells, NULL);
    *out = linear;
    if (status != CN_OK || !second) return status;
    status = cn_tets_raise(out, linear);
    cn_tets_free(linear);
    return status;
}

cn_status cn_beam_error_beam(const cn_shape *shape, const cn_material *material, cn_body_model model,
                             cn_beam_error *out)
{
    cn_tets *mesh = NULL;
    const double *size = shape->beam.size, depth = fmax(size[1], size[2]);
    const bool second = model == CN_BODY_TET10;
    const int order = second ? 2 : 1; /* sections a cell */
    double truth[CN_BEAM_LOADS];
    *out = (cn_beam_error){0};
    if (model == CN_BODY_ROD) return CN_OK;
    *out = (cn_beam_error){NAN, NAN, NAN, NAN, NAN, NAN};
    int cells[3] = {shape->beam.cells[0], shape->beam.cells[1], shape->beam.cells[2]};
    if (cells[0] < 7 || !(size[0] >= 3 * depth)) return CN_OK;
    cn_status status = truth_of(shape, material, truth);
    if (status != CN_OK) return status;

    /* a piece of a fine mesh is solved coarser: the error falls with the square of the cell, of second-order
     * tetrahedra with its fourth power */
    int n = sections_of(depth, size[0] / cells[0], 17, cells[0] + 1);
    double finer = 1;
    while ((double)n * order * (order * cells[1] + 1) * (order * cells[2] + 1) > NODES_MAX &&
           cells[1] + cells[2] > 8 / order) {
        for (int k = 0; k < 3; k++)
            cells[k] = (cells[k] + 1) / 2;
        n = sections_of(depth, size[0] / cells[0], 17, cells[0] + 1);
        finer /= second ? 16 : 4;
    }
    const int part[3] = {n - 1, cells[1], cells[2]};
    const double piece_size[3] = {size[0] / cells[0] * (n - 1), size[1], size[2]};
    if ((status = beam_mesh(&mesh, piece_size, part, second)) != CN_OK) return status;
    const double shear = material->young / (2 * (1 + material->poisson));
    const double polar = size[1] * size[2] * (size[1] * size[1] + size[2] * size[2]) / 12;
    status = beam_error(mesh, order * (n - 1) + 1, 0, material, truth,
                        truth[CN_BEAM_TORSION] / (shear * polar), out);
    out->bending *= finer, out->torsion *= finer, out->axial *= finer;
    cn_tets_free(mesh);
    return status;
}
