/* mesh_check.c - the doctor of surfaces: merges equal vertices, turns what is inside out, measures the rest.
 */
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "geometry.h"
#include "mesh_parts.h"

/* Scratch of one check. Triangles with a repeated vertex take no part in the topology. */
typedef struct {
    cn_surface *surface;
    cn_doctor *doctor;
    int nedge;      /* half-edges                                                    */
    cn_facet *edge; /* sorted; item = 3 * triangle + corner it starts at (3 x ntri)  */
    int *component; /* disjoint sets of triangles joined by edges (ntri)             */
    int *corner;    /* disjoint sets of corners joined by edges at a vertex (3 ntri) */
    int *loop;      /* disjoint sets of vertices joined by boundary edges (nvert)    */
    double *rim;    /* of each loop's root: perimeter, edges, centre (nvert x RIM)   */
} scratch;
enum { RIM = 5 };

static const double *vertex(const cn_surface *s, int i, int k)
{
    return s->vert + 3 * (size_t)s->tri[3 * (size_t)i + k];
}

static bool repeated(const cn_surface *s, int i)
{
    const int *t = s->tri + 3 * (size_t)i;
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

/* --- vertices --- */

static cn_status check_numbers(const cn_surface *s, cn_error *error)
{
    if (s->ntri < 1 || s->nvert < 3)
        return cn_fail(error, CN_FAULT_NO_PARTS, NULL, 0,
                       "the surface has %d vertices and %d triangles: it is empty", s->nvert, s->ntri);
    if (s->ntri > INT_MAX / 3)
        return cn_fail(error, CN_ERR_MESH, NULL, 0, "the surface has %d triangles: at most %d are taken",
                       s->ntri, INT_MAX / 3);
    for (int i = 0; i < s->nvert; i++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(s->vert[3 * (size_t)i + k]))
                return cn_fail(error, CN_ERR_NOT_FINITE, NULL, 0,
                               "vertex %d has %c = %g: give a finite number", i, "xyz"[k],
                               s -> vert[3 * (size_t)i + k]);
    for (int i = 0; i < s->ntri; i++)
        for (int k = 0; k < 3; k++)
            if (s->tri[3 * (size_t)i + k] < 0 || s->tri[3 * (size_t)i + k] >= s->nvert)
                return cn_fail(error, CN_FAULT_NO_VERTEX, NULL, 0,
                               "triangle %d names vertex %d, but vertices run from 0 to %d", i,
                               s->tri[3 * (size_t)i + k], s->nvert - 1);
    return CN_OK;
}

static uint64_t hash(const double x[3])
{
    uint64_t h = 0;
    for (int k = 0; k < 3; k++) {
        const double value = x[k] + 0.0; /* -0 becomes 0: they are equal */
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        h = (h ^ bits) * 0x9E3779B97F4A7C15u;
        h ^= h >> 29;
    }
    return h * 0xBF58476D1CE4E5B9u >> 20;
}

static bool equal(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Exactly equal positions become one vertex, the first of them. */
static cn_status merge(cn_surface *s, int *merged)
{
    size_t size = 16;
    while (size < 2 * (size_t)s->nvert)
        size *= 2;
    int *table = cn_array(size, sizeof *table), *map = cn_array((size_t)s->nvert, sizeof *map), n = 0;
    cn_status status = CN_ERR_MEMORY;

    if (!table || !map) goto done;
    for (int i = 0; i < s->nvert; i++) {
        const double *x = s->vert + 3 * (size_t)i;
        size_t slot = (size_t)hash(x) & (size - 1);
        while (table[slot] && !equal(s->vert + 3 * (size_t)(table[slot] - 1), x))
            slot = (slot + 1) & (size - 1);
        if (!table[slot]) {
            memmove(s->vert + 3 * (size_t)n, x, 3 * sizeof *x);
            table[slot] = ++n;
        }
        map[i] = table[slot] - 1;
    }
    for (size_t i = 0; i < 3 * (size_t)s->ntri; i++)
        s->tri[i] = map[s->tri[i]];
    *merged = s->nvert - n;
    s->nvert = n;
    status = CN_OK;
done:
    free(table);
    free(map);
    return status;
}

/* --- single triangles --- */

/* Exactly collinear: no area in any of the three projections. */
static bool flat(const cn_surface *s, int i)
{
    for (int k = 0; k < 3; k++) {
        double p[3][2];
        for (int j = 0; j < 3; j++)
            p[j][0] = vertex(s, i, j)[k], p[j][1] = vertex(s, i, j)[(k + 1) % 3];
        if (cn_orient2d(p[0], p[1], p[2])) return false;
    }
    return true;
}

/* Least angle below half a degree: |u x v| < tan(0.5 deg) u.v for the sides u, v beside it. */
static bool is_sliver(const cn_surface *s, int i)
{
    for (int k = 0; k < 3; k++) {
        double u[3], v[3], n[3];
        cn_sub(vertex(s, i, (k + 1) % 3), vertex(s, i, k), u);
        cn_sub(vertex(s, i, (k + 2) % 3), vertex(s, i, k), v);
        cn_cross(u, v, n);
        if (cn_norm(n) < 0.008726867790758789 * cn_dot(u, v)) return true;
    }
    return false;
}

static cn_status check_triangles(scratch *c)
{
    const cn_surface *s = c->surface;
    cn_doctor *d = c->doctor;
    char *used = cn_array((size_t)s->nvert, 1);
    cn_facet *face = cn_array((size_t)s->ntri, sizeof *face);
    cn_status status = CN_ERR_MEMORY;

    if (!used || !face) goto done;
    for (int i = 0; i < s->ntri; i++) {
        const int *t = s->tri + 3 * (size_t)i;
        const bool degenerate = repeated(s, i) || flat(s, i);
        face[i] = cn_facet_face(t[0], t[1], t[2], i);
        used[t[0]] = used[t[1]] = used[t[2]] = 1;
        if (degenerate && !d->degenerate++) d->first_degenerate = i;
        d->slivers += !degenerate && is_sliver(s, i);
    }
    for (int i = 0; i < s->nvert; i++)
        d->unused += !used[i];
    if ((status = cn_facet_sort(s->nvert, s->ntri, face)) != CN_OK) goto done;
    for (int i = 0, j; i < s->ntri; i = j) {
        j = cn_facet_run(s->ntri, face, i);
        if (j - i == 1 || repeated(s, face[i].item)) continue;
        if (!d->duplicate) d->first_duplicate[0] = face[i].item, d->first_duplicate[1] = face[i + 1].item;
        d->duplicate += j - i - 1;
    }
done:
    free(used);
    free(face);
    return status;
}

/* --- edges, loops, components --- */

static cn_status new_scratch(scratch *c)
{
    const size_t ntri = (size_t)c->surface->ntri, nvert = (size_t)c->surface->nvert;

    c->edge = cn_array(3 * ntri, sizeof *c->edge);
    c->component = cn_array(ntri, sizeof *c->component);
    c->corner = cn_array(3 * ntri, sizeof *c->corner);
    c->loop = cn_array(nvert, sizeof *c->loop);
    c->rim = cn_array(nvert, RIM * sizeof *c->rim);
    if (!c->edge || !c->component || !c->corner || !c->loop || !c->rim) return CN_ERR_MEMORY;
    for (size_t i = 0; i < 3 * ntri; i++)
        c->corner[i] = (int)i;
    for (size_t i = 0; i < ntri; i++)
        c->component[i] = (int)i;
    for (size_t i = 0; i < nvert; i++)
        c->loop[i] = (int)i;
    return CN_OK;
}

static void free_scratch(scratch *c)
{
    free(c->edge);
    free(c->component);
    free(c->corner);
    free(c->loop);
    free(c->rim);
}

static int next(int item)
{
    return item % 3 == 2 ? item - 2 : item + 1;
}

/* Corner at the lower vertex of the edge that starts at `item`. */
static int low_corner(const scratch *c, int item)
{
    return c->surface->tri[item] < c->surface->tri[next(item)] ? item : next(item);
}

static cn_status check_edges(scratch *c)
{
    const cn_surface *s = c->surface;
    cn_doctor *d = c->doctor;
    int n = 0;
    cn_status status;

    for (int i = 0; i < 3 * s->ntri; i++)
        if (!repeated(s, i / 3)) c->edge[n++] = cn_facet_edge(s->tri[i], s->tri[next(i)], i);
    c->nedge = n;
    if ((status = cn_facet_sort(s->nvert, n, c->edge)) != CN_OK) return status;
    for (int i = 0, j; i < n; i = j) {
        const cn_facet *e = c->edge + i;
        j = cn_facet_run(n, c->edge, i);
        if (j - i == 1) cn_set_join(c->loop, e->key[0], e->key[1]);
        if (j - i > 2 && !d->nonmanifold_edges++)
            memcpy(d->first_nonmanifold, e->key, sizeof d->first_nonmanifold);
        if (j - i == 2 && s->tri[e[0].item] == s->tri[e[1].item] && !d->mixed_edges++)
            d->first_mixed[0] = e[0].item / 3, d->first_mixed[1] = e[1].item / 3;
        for (int k = 1; k < j - i; k++) { /* joined across the edge, and around both its ends */
            const int a = low_corner(c, e->item), b = low_corner(c, e[k].item);
            cn_set_join(c->component, e->item / 3, e[k].item / 3);
            cn_set_join(c->corner, a, b);
            cn_set_join(c->corner, a == e->item ? next(e->item) : e->item,
                        b == e[k].item ? next(e[k].item) : e[k].item);
        }
    }
    return CN_OK;
}

/* Vertices whose corners form more than one fan. */
static cn_status check_fans(scratch *c)
{
    const cn_surface *s = c->surface;
    int *root = cn_array((size_t)s->nvert, sizeof *root);

    if (!root) return CN_ERR_MEMORY;
    for (int i = 0; i < 3 * s->ntri; i++) {
        const int v = s->tri[i], r = cn_set_find(c->corner, i) + 1;
        if (repeated(s, i / 3) || root[v] == r || root[v] < 0) continue;
        if (root[v] && !c->doctor->nonmanifold_vertices++) c->doctor->first_nonmanifold_vertex = v;
        root[v] = root[v] ? -1 : r;
    }
    free(root);
    return CN_OK;
}

/* Boundary edges belong to one triangle; loops are what they join to. A loop's root is its least vertex. */
static void check_loops(scratch *c)
{
    const cn_surface *s = c->surface;
    cn_doctor *d = c->doctor;

    for (int i = 0, j; i < c->nedge; i = j) {
        const cn_facet *e = c->edge + i;
        j = cn_facet_run(c->nedge, c->edge, i);
        if (j - i != 1) continue;
        double *rim = c->rim + RIM * (size_t)cn_set_find(c->loop, e->key[0]);
        const double *a = s->vert + 3 * (size_t)e->key[0], *b = s->vert + 3 * (size_t)e->key[1];
        const double length = cn_distance(a, b);
        rim[0] += length;
        rim[1] += 1;
        for (int k = 0; k < 3; k++)
            rim[2 + k] += length * (0.5 * a[k] + 0.5 * b[k]);
    }
    for (int i = 0; i < s->nvert; i++) {
        double *rim = c->rim + RIM * (size_t)i;
        if (!(rim[1] > 0)) continue;
        for (int k = 0; k < 3; k++)
            rim[2 + k] = rim[0] > 0 ? rim[2 + k] / rim[0] : s->vert[3 * (size_t)i + k];
        if (d->loops < CN_DOCTOR_LISTED) {
            d->loop_diameter[d->loops] = rim[0] / 3.14159265358979323846;
            d->loop_edges[d->loops] = (int)rim[1];
            memcpy(d->loop_centre[d->loops], rim + 2, 3 * sizeof *rim);
        }
        d->loops++;
    }
}

/* Signed volume of each component, loops closed by fans from their centres, into `volume` at its root. The
 * box's centre is the origin, so that the figure does not suffer far away from zero. */
static void measure_volumes(const scratch *c, double *volume)
{
    const cn_surface *s = c->surface;
    double centre[3];

    for (int k = 0; k < 3; k++)
        centre[k] = 0.5 * c->doctor->min[k] + 0.5 * c->doctor->max[k];
    for (int i = 0; i < s->ntri; i++)
        volume[cn_set_find(c->component, i)] +=
            cn_tet_volume6(centre, vertex(s, i, 0), vertex(s, i, 1), vertex(s, i, 2)) / 6;
    for (int i = 0, j; i < c->nedge; i = j) {
        j = cn_facet_run(c->nedge, c->edge, i);
        if (j - i != 1) continue;
        const int item = c->edge[i].item;
        const double *apex = c->rim + RIM * (size_t)cn_set_find(c->loop, s->tri[item]) + 2;
        volume[cn_set_find(c->component, item / 3)] +=
            cn_tet_volume6(centre, s->vert + 3 * (size_t)s->tri[next(item)],
                           s->vert + 3 * (size_t)s->tri[item], apex) /
            6;
    }
}

/* Solid angle over 4 pi under which p sees a component: 1 inside when outward, -1 inside when inward, else 0
 * (Van Oosterom and Strackee 1983). */
static double winding(const scratch *c, const int *triangle, int n, const double p[3])
{
    double sum = 0;
    for (int i = 0; i < n; i++) {
        double x[3][3], r[3], cross[3];
        for (int k = 0; k < 3; k++) {
            cn_sub(vertex(c->surface, triangle[i], k), p, x[k]);
            r[k] = cn_norm(x[k]);
        }
        cn_cross(x[1], x[2], cross);
        sum += atan2(cn_dot(x[0], cross), r[0] * r[1] * r[2] + cn_dot(x[0], x[1]) * r[2] +
                                              cn_dot(x[1], x[2]) * r[0] + cn_dot(x[2], x[0]) * r[1]);
    }
    return sum / (2 * 3.14159265358979323846);
}

typedef struct {
    int first, n; /* its triangles in the list by component */
    int sign;     /* of its volume */
    double min[3], max[3];
} part;

static void bound_part(const scratch *c, const int *triangle, part *p)
{
    cn_copy3(vertex(c->surface, triangle[0], 0), p->min);
    cn_copy3(p->min, p->max);
    for (int i = 0; i < 3 * p->n; i++)
        for (int k = 0; k < 3; k++) {
            const double x = vertex(c->surface, triangle[i / 3], i % 3)[k];
            p->min[k] = fmin(p->min[k], x), p->max[k] = fmax(p->max[k], x);
        }
}

/* Parts of a closed surface that do not cross: an outward shell inside another is as wrong as an inward one
 * outside (a shell within an even number of others must be outward, else inward), unless all are the other
 * way round. Counts the minority. A work limit keeps hostile heaps of nested parts from taking O(n^2): those
 * beyond it are taken as lying free. */
static void check_nesting(scratch *c, int nparts, const part *parts, const int *triangle)
{
    double work = 2e7;
    int wrong = 0, right = 0, first_wrong = -1, first_right = -1;

    for (int a = 0; a < nparts; a++) {
        const double *p = vertex(c->surface, triangle[parts[a].first], 0);
        int depth = 0;
        for (int b = 0; b < nparts && work > 0; b++) {
            bool within = a != b;
            work -= 1;
            for (int k = 0; k < 3; k++)
                within = within && p[k] >= parts[b].min[k] && p[k] <= parts[b].max[k];
            if (!within) continue;
            work -= parts[b].n;
            depth += fabs(winding(c, triangle + parts[b].first, parts[b].n, p)) > 0.5;
        }
        const bool outward = (depth % 2 ? -1 : 1) * parts[a].sign > 0;
        if (outward && right++ == 0) first_right = triangle[parts[a].first];
        if (!outward && wrong++ == 0) first_wrong = triangle[parts[a].first];
    }
    if (!right || !wrong) return;
    c->doctor->mixed_components = wrong <= right ? wrong : right;
    c->doctor->first_mixed_component = wrong <= right ? first_wrong : first_right;
}

/* Components, their volumes and, where the surface is closed and crosses nowhere, their nesting. */
static cn_status check_components(scratch *c)
{
    const cn_surface *s = c->surface;
    cn_doctor *d = c->doctor;
    double *volume = cn_array((size_t)s->ntri, sizeof *volume);
    int *part_of = cn_array((size_t)s->ntri, sizeof *part_of);
    int *triangle = cn_array((size_t)s->ntri, sizeof *triangle);
    part *parts = NULL;
    cn_status status = CN_ERR_MEMORY;

    if (!volume || !part_of || !triangle) goto done;
    measure_volumes(c, volume);
    for (int i = 0; i < s->ntri; i++) {
        const int root = cn_set_find(c->component, i);
        if (root == i)
            part_of[i] = d->components++, d->volume += volume[i];
        else
            part_of[i] = part_of[root];
    }
    if (!(parts = cn_array((size_t)d->components, sizeof *parts))) goto done;
    for (int i = 0; i < s->ntri; i++) {
        parts[part_of[i]].n++;
        if (cn_set_find(c->component, i) == i) parts[part_of[i]].sign = (volume[i] > 0) - (volume[i] < 0);
    }
    for (int i = 1; i < d->components; i++)
        parts[i].first = parts[i - 1].first + parts[i - 1].n;
    for (int i = 0; i < d->components; i++)
        parts[i].n = 0;
    for (int i = 0; i < s->ntri; i++) {
        part *p = parts + part_of[i];
        triangle[p->first + p->n++] = i;
    }
    for (int i = 0; i < d->components; i++)
        bound_part(c, triangle + parts[i].first, parts + i);
    if (d->components > 1 && d->closed && d->oriented && !d->crossing_pairs)
        check_nesting(c, d->components, parts, triangle);
    status = CN_OK;
done:
    free(volume);
    free(part_of);
    free(triangle);
    free(parts);
    return status;
}

/* Genus of one closed manifold: 2 - 2 g = V - E + F over what its triangles use. */
static void measure_genus(const scratch *c)
{
    cn_doctor *d = c->doctor;
    int edges = 0;

    d->genus = -1;
    if (!d->closed || !d->manifold || d->components != 1 || d->degenerate) return;
    for (int i = 0; i < c->nedge; i = cn_facet_run(c->nedge, c->edge, i))
        edges++;
    d->genus = (2 - (d->nvert - d->unused - edges + d->ntri)) / 2;
}

/* --- all of it --- */

static void measure_box(const cn_surface *s, cn_doctor *d)
{
    double diagonal[3];

    cn_copy3(s->vert, d->min);
    cn_copy3(s->vert, d->max);
    for (size_t i = 0; i < 3 * (size_t)s->nvert; i++) {
        d->min[i % 3] = fmin(d->min[i % 3], s->vert[i]);
        d->max[i % 3] = fmax(d->max[i % 3], s->vert[i]);
    }
    cn_sub(d->max, d->min, diagonal);
    d->size = cn_norm(diagonal);
    cn_guess_unit(d->size, d->unit_guess);
}

/* Inward as a whole: the volume is negative beyond what rounding makes of a flat sheet. */
static void turn_outward(cn_surface *s, cn_doctor *d)
{
    if (!d->oriented || d->nonmanifold_edges || d->mixed_components) return;
    if (!(d->volume < -1e-13 * d->size * d->size * d->size)) return;
    for (int i = 0; i < s->ntri; i++) {
        int *t = s->tri + 3 * (size_t)i;
        const int swap = t[1];
        t[1] = t[2], t[2] = swap;
    }
    d->volume = -d->volume;
    d->turned = true;
}

static cn_status examine(scratch *c)
{
    cn_surface *s = c->surface;
    cn_doctor *d = c->doctor;
    cn_status status;

    if ((status = merge(s, &d->merged)) != CN_OK) return status;
    d->nvert = s->nvert;
    d->ntri = s->ntri;
    measure_box(s, d);
    if ((status = new_scratch(c)) != CN_OK) return status;
    if ((status = check_triangles(c)) != CN_OK) return status;
    if ((status = check_edges(c)) != CN_OK) return status;
    if ((status = check_fans(c)) != CN_OK) return status;
    if ((status = cn_surface_crossings(s, d)) != CN_OK) return status;
    check_loops(c);
    d->closed = d->loops == 0;
    d->manifold = !d->nonmanifold_edges && !d->nonmanifold_vertices;
    d->oriented = !d->mixed_edges;
    if ((status = check_components(c)) != CN_OK) return status;
    measure_genus(c);
    return CN_OK;
}

cn_status cn_surface_check(cn_surface *surface, bool turn, cn_doctor *doctor, cn_error *error)
{
    scratch c = {.surface = surface, .doctor = doctor};
    cn_status status;

    *doctor = (cn_doctor){.genus = -1,
                          .first_degenerate = -1,
                          .first_duplicate = {-1, -1},
                          .first_nonmanifold = {-1, -1},
                          .first_mixed = {-1, -1},
                          .first_mixed_component = -1,
                          .first_nonmanifold_vertex = -1};
    if ((status = check_numbers(surface, error)) != CN_OK) return status;
    status = examine(&c);
    free_scratch(&c);
    if (status != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory checking %d triangles", surface->ntri);
    if (turn) turn_outward(surface, doctor);
    return CN_OK;
}
