/* mesh.c - surfaces and tetrahedral meshes: memory, placement, outer surface, what FEM can use. */
#include "mesh_parts.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"

void *cn_array(size_t n, size_t size)
{
    return n > SIZE_MAX / size ? NULL : calloc(n ? n : 1, size);
}

cn_status cn_surface_new(cn_surface **out, int nvert, int ntri)
{
    cn_surface *surface;

    if (nvert < 0 || ntri < 0) return CN_ERR_ARG;
    if (!(surface = calloc(1, sizeof *surface))) return CN_ERR_MEMORY;
    surface->nvert = nvert;
    surface->ntri = ntri;
    surface->vert = cn_array((size_t)nvert, 3 * sizeof *surface->vert);
    surface->tri = cn_array((size_t)ntri, 3 * sizeof *surface->tri);
    if (!surface->vert || !surface->tri) goto fail;
    *out = surface;
    return CN_OK;
fail:
    cn_surface_free(surface);
    return CN_ERR_MEMORY;
}

cn_status cn_surface_copy(cn_surface **out, const cn_surface *surface)
{
    cn_surface *copy;
    const cn_status status = cn_surface_new(&copy, surface->nvert, surface->ntri);

    if (status != CN_OK) return status;
    memcpy(copy->vert, surface->vert, 3 * (size_t)surface->nvert * sizeof *copy->vert);
    memcpy(copy->tri, surface->tri, 3 * (size_t)surface->ntri * sizeof *copy->tri);
    *out = copy;
    return CN_OK;
}

void cn_surface_free(cn_surface *surface)
{
    if (!surface) return;
    free(surface->vert);
    free(surface->tri);
    free(surface);
}

cn_status cn_tets_new(cn_tets **out, int nnode, int ntet)
{
    cn_tets *tets;

    if (nnode < 0 || ntet < 0) return CN_ERR_ARG;
    if (!(tets = calloc(1, sizeof *tets))) return CN_ERR_MEMORY;
    tets->nnode = nnode;
    tets->ntet = ntet;
    tets->node = cn_array((size_t)nnode, 3 * sizeof *tets->node);
    tets->tet = cn_array((size_t)ntet, 4 * sizeof *tets->tet);
    if (!tets->node || !tets->tet) goto fail;
    *out = tets;
    return CN_OK;
fail:
    cn_tets_free(tets);
    return CN_ERR_MEMORY;
}

void cn_tets_free(cn_tets *tets)
{
    if (!tets) return;
    free(tets->node);
    free(tets->tet);
    free(tets->mid);
    free(tets);
}

void cn_place_points(const cn_placement *placement, int n, double *points)
{
    double r[9];

    cn_rotation(placement->rotate, r);
    for (int i = 0; i < n; i++) {
        double *x = points + 3 * (size_t)i;
        const double scaled[3] = {placement->scale * x[0], placement->scale * x[1], placement->scale * x[2]};
        cn_mat_vec(r, scaled, x);
        cn_add(x, placement->translate, x);
    }
}

/* --- sorted facets and disjoint sets --- */

cn_facet cn_facet_edge(int a, int b, int item)
{
    return a < b ? (cn_facet){{a, b, 0}, item} : (cn_facet){{b, a, 0}, item};
}

cn_facet cn_facet_face(int a, int b, int c, int item)
{
    int t;
    if (a > b) t = a, a = b, b = t;
    if (b > c) t = b, b = c, c = t;
    if (a > b) t = a, a = b, b = t;
    return (cn_facet){{a, b, c}, item};
}

static int compare(const void *pa, const void *pb)
{
    const cn_facet *a = pa, *b = pb;
    for (int i = 0; i < 3; i++)
        if (a->key[i] != b->key[i]) return a->key[i] < b->key[i] ? -1 : 1;
    return (a->item > b->item) - (a->item < b->item);
}

cn_status cn_facet_sort(int nvert, int n, cn_facet *facet)
{
    int *end = cn_array((size_t)nvert + 1, sizeof *end);
    cn_facet *sorted = cn_array((size_t)n, sizeof *sorted);
    cn_status status = CN_ERR_MEMORY;

    if (!end || !sorted) goto done;
    for (int i = 0; i < n; i++) /* a bucket for each first vertex ... */
        end[facet[i].key[0] + 1]++;
    for (int i = 0; i < nvert; i++)
        end[i + 1] += end[i];
    for (int i = 0; i < n; i++)
        sorted[end[facet[i].key[0]]++] = facet[i];
    for (int v = 0, first = 0; v < nvert; first = end[v++]) { /* ... then within it */
        const int count = end[v] - first;
        cn_facet *const bucket = sorted + first;
        if (count > 32) qsort(bucket, (size_t)count, sizeof *bucket, compare);
        for (int i = 1; i < count && count <= 32; i++) {
            const cn_facet f = bucket[i];
            int j = i;
            for (; j > 0 && compare(bucket + j - 1, &f) > 0; j--)
                bucket[j] = bucket[j - 1];
            bucket[j] = f;
        }
    }
    memcpy(facet, sorted, (size_t)n * sizeof *facet);
    status = CN_OK;
done:
    free(end);
    free(sorted);
    return status;
}

int cn_facet_run(int n, const cn_facet *facet, int i)
{
    int j = i + 1;
    while (j < n && !memcmp(facet[j].key, facet[i].key, sizeof facet[i].key))
        j++;
    return j;
}

int cn_set_find(int *parent, int i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

void cn_set_join(int *parent, int a, int b)
{
    a = cn_set_find(parent, a);
    b = cn_set_find(parent, b);
    if (a < b) parent[b] = a;
    if (b < a) parent[a] = b;
}

/* --- tetrahedra --- */

/* Outward faces of a positive tetrahedron. */
static const int face_of[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
/* Which of mid's six nodes lies between two corners. */
static const int edge_of[4][4] = {{-1, 0, 2, 3}, {0, -1, 1, 4}, {2, 1, -1, 5}, {3, 4, 5, -1}};

double cn_tet_volume6(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3], n[3];
    cn_sub(b, a, u);
    cn_sub(c, a, v);
    cn_sub(d, a, w);
    cn_cross(u, v, n);
    return cn_dot(n, w);
}

static double volume6(const cn_tets *tets, int i)
{
    const int *t = tets->tet + 4 * (size_t)i;
    const double *x = tets->node;
    return cn_tet_volume6(x + 3 * (size_t)t[0], x + 3 * (size_t)t[1], x + 3 * (size_t)t[2],
                          x + 3 * (size_t)t[3]);
}

/* Every face of every tetrahedron, sorted; item = 4 * tetrahedron + face. */
static cn_status sorted_faces(const cn_tets *tets, cn_facet **out)
{
    cn_facet *face;

    if (tets->ntet > INT32_MAX / 4) return CN_ERR_MEMORY;
    if (!(face = cn_array((size_t)tets->ntet * 4, sizeof *face))) return CN_ERR_MEMORY;
    for (int i = 0; i < 4 * tets->ntet; i++) {
        const int *t = tets->tet + (i & ~3), *f = face_of[i & 3];
        face[i] = cn_facet_face(t[f[0]], t[f[1]], t[f[2]], i);
    }
    const cn_status status = cn_facet_sort(tets->nnode, 4 * tets->ntet, face);
    if (status == CN_OK)
        *out = face;
    else
        free(face);
    return status;
}

/* Finite nodes, valid and distinct indices. */
static cn_status check_numbers(const cn_tets *tets, cn_error *error)
{
    if (tets->ntet < 1 || tets->nnode < 4)
        return cn_fail(error, CN_FAULT_NO_PARTS, NULL, 0,
                       "the mesh has %d nodes and %d tetrahedra: nothing to simulate", tets->nnode,
                       tets->ntet);
    for (int i = 0; i < 3 * tets->nnode; i++)
        if (!isfinite(tets->node[i]))
            return cn_fail(error, CN_ERR_NOT_FINITE, NULL, 0,
                           "node %d has coordinate %g: give a finite number", i / 3, tets->node[i]);
    for (int i = 0; i < 4 * tets->ntet; i++)
        if (tets->tet[i] < 0 || tets->tet[i] >= tets->nnode)
            return cn_fail(error, CN_FAULT_NO_VERTEX, NULL, 0,
                           "tetrahedron %d names node %d, but nodes run from 0 to %d", i / 4, tets->tet[i],
                           tets->nnode - 1);
    for (int i = 0; i < tets->ntet; i++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++)
                if (tets->tet[4 * i + a] == tets->tet[4 * i + b])
                    return cn_fail(error, CN_FAULT_DEGENERATE, NULL, 0,
                                   "tetrahedron %d names node %d twice: it has no volume; remove it", i,
                                   tets->tet[4 * i + a]);
    return CN_OK;
}

static cn_status check_volumes(const cn_tets *tets, cn_error *error)
{
    double sum = 0;

    for (int i = 0; i < tets->ntet; i++)
        sum += fabs(volume6(tets, i));
    for (int i = 0; i < tets->ntet; i++) {
        const double v = volume6(tets, i);
        if (!(fabs(v) > 1e-14 * sum / tets->ntet))
            return cn_fail(
                error, CN_FAULT_DEGENERATE, NULL, 0,
                "tetrahedron %d (nodes %d %d %d %d) has volume %g, the mean is %g: it is flat; remesh", i,
                tets->tet[4 * i], tets->tet[4 * i + 1], tets->tet[4 * i + 2], tets->tet[4 * i + 3], v / 6,
                sum / 6 / tets->ntet);
    }
    return CN_OK;
}

/* Each node used, no tetrahedron twice, no face of three. */
static cn_status check_topology(const cn_tets *tets, cn_error *error)
{
    char *used = cn_array((size_t)tets->nnode, 1);
    cn_facet *face = NULL;
    cn_status status = CN_ERR_MEMORY;

    if (!used || (status = sorted_faces(tets, &face)) != CN_OK) goto done;
    for (int i = 0; i < 4 * tets->ntet; i++)
        used[tets->tet[i]] = 1;
    for (int i = 0; i < tets->nnode; i++)
        if (!used[i]) {
            status = cn_fail(error, CN_FAULT_UNUSED, NULL, 0,
                             "node %d belongs to no tetrahedron: it would have no mass; remove it", i);
            goto done;
        }
    const int n = 4 * tets->ntet;
    for (int i = 0, j; i < n; i = j) {
        j = cn_facet_run(n, face, i);
        if (j - i < 2) continue;
        const int a = face[i].item, b = face[i + 1].item;
        if (j - i > 2) {
            status = cn_fail(
                error, CN_FAULT_NON_MANIFOLD, NULL, 0,
                "face %d %d %d belongs to %d tetrahedra (%d, %d, %d ...): at most two may share one; "
                "remesh, or remove the duplicate",
                face[i].key[0], face[i].key[1], face[i].key[2], j - i, a / 4, b / 4, face[i + 2].item / 4);
            goto done;
        }
        int same = 0;
        for (int k = 0; k < 16; k++)
            same += tets->tet[(a & ~3) + k / 4] == tets->tet[(b & ~3) + k % 4];
        if (same == 4) {
            status = cn_fail(error, CN_FAULT_DUPLICATE, NULL, 0,
                             "tetrahedra %d and %d have the same four nodes: remove one", a / 4, b / 4);
            goto done;
        }
    }
done:
    free(face);
    free(used);
    return status;
}

cn_status cn_tets_check(cn_tets *tets, int *turned, cn_error *error)
{
    cn_status status;
    int count = 0;

    if ((status = check_numbers(tets, error)) != CN_OK) return status;
    if ((status = check_volumes(tets, error)) != CN_OK) return status;
    if ((status = check_topology(tets, error)) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory checking %d tetrahedra", tets->ntet);
    for (int i = 0; i < tets->ntet; i++)
        if (volume6(tets, i) < 0) {
            int *t = tets->tet + 4 * (size_t)i;
            const int swap = t[2];
            t[2] = t[3], t[3] = swap;
            count++;
        }
    if (turned) *turned = count;
    return CN_OK;
}

cn_status cn_tets_boundary(cn_surface **out, const cn_tets *tets)
{
    cn_facet *face = NULL;
    cn_surface *surface = NULL;
    const int n = 4 * tets->ntet;
    int count = 0;
    cn_status status = sorted_faces(tets, &face);

    if (status != CN_OK) return status;
    for (int i = 0, j; i < n; i = j) { /* faces of one tetrahedron, packed in front in the mesh's order */
        j = cn_facet_run(n, face, i);
        if (j - i == 1) face[count++] = face[i];
    }
    if ((status = cn_surface_new(&surface, 0, tets->mid ? 4 * count : count)) != CN_OK) goto done;
    free(surface->vert);
    surface->vert = NULL;
    surface->nvert = tets->nnode;
    for (int i = 0; i < count; i++) {
        const int *t = tets->tet + (face[i].item & ~3), *f = face_of[face[i].item & 3];
        if (tets->mid) {
            const int *mid = tets->mid + 6 * (size_t)(face[i].item / 4);
            const int a = t[f[0]], b = t[f[1]], c = t[f[2]];
            const int ab = mid[edge_of[f[0]][f[1]]], bc = mid[edge_of[f[1]][f[2]]],
                      ca = mid[edge_of[f[2]][f[0]]];
            const int four[12] = {a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca};
            memcpy(surface->tri + 12 * (size_t)i, four, sizeof four);
            continue;
        }
        for (int k = 0; k < 3; k++)
            surface->tri[3 * i + k] = t[f[k]];
    }
    *out = surface;
done:
    free(face);
    return status;
}
