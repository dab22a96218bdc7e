/* mesh_raise.c - second-order meshes of linear ones: a node amid each edge, by the edge alone for any mesh,
 * by sections for a catheter. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

static const int edge_of[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

/* Edges of all tetrahedra, sorted (ntet x 6; item = 6 * tetrahedron + edge), and how many there are. */
static cn_status sorted_edges(const cn_tets *mesh, cn_facet **out, int *nedge)
{
    const int n = mesh->ntet <= INT_MAX / 6 ? 6 * mesh->ntet : 0;
    cn_facet *edge = n == 6 * (long long)mesh->ntet ? cn_array((size_t)n, sizeof *edge) : NULL;
    cn_status status = CN_ERR_MEMORY;

    *nedge = 0;
    if (!edge) return status;
    for (int i = 0; i < n; i++) {
        const int *t = mesh->tet + 4 * (size_t)(i / 6), *e = edge_of[i % 6];
        edge[i] = cn_facet_edge(t[e[0]], t[e[1]], i);
    }
    if ((status = cn_facet_sort(mesh->nnode, n, edge)) != CN_OK) {
        free(edge);
        return status;
    }
    for (int i = 0; i < n; i = cn_facet_run(n, edge, i))
        ++*nedge;
    *out = edge;
    return CN_OK;
}

/* A mesh with as many tetrahedra as the linear one, which has nedge edges; its nodes stay to be placed. */
static cn_status raised_new(cn_tets **out, const cn_tets *linear, int nedge)
{
    cn_tets *mesh;
    const cn_status status = nedge <= INT_MAX - linear->nnode
                                 ? cn_tets_new(&mesh, linear->nnode + nedge, linear->ntet)
                                 : CN_ERR_ARG;

    if (status != CN_OK) return status;
    if (!(mesh->mid = cn_array((size_t)linear->ntet, 6 * sizeof *mesh->mid))) {
        cn_tets_free(mesh);
        return CN_ERR_MEMORY;
    }
    *out = mesh;
    return CN_OK;
}

cn_status cn_tets_raise(cn_tets **out, const cn_tets *linear)
{
    cn_facet *edge = NULL;
    cn_tets *mesh = NULL;
    int nedge = 0;
    cn_status status;

    *out = NULL;
    if (linear->mid) return CN_ERR_ARG;
    if ((status = sorted_edges(linear, &edge, &nedge)) != CN_OK) return status;
    if ((status = raised_new(&mesh, linear, nedge)) != CN_OK) goto done;
    memcpy(mesh->node, linear->node, 3 * (size_t)linear->nnode * sizeof *mesh->node);
    memcpy(mesh->tet, linear->tet, 4 * (size_t)linear->ntet * sizeof *mesh->tet);
    for (int i = 0, j, node = linear->nnode; i < 6 * linear->ntet; i = j, node++) {
        const double *a = linear->node + 3 * (size_t)edge[i].key[0],
                     *b = linear->node + 3 * (size_t)edge[i].key[1];
        for (int k = 0; k < 3; k++) /* halves first: their sum may overflow */
            mesh->node[3 * (size_t)node + (size_t)k] = 0.5 * a[k] + 0.5 * b[k];
        j = cn_facet_run(6 * linear->ntet, edge, i);
        for (int m = i; m < j; m++)
            mesh->mid[edge[m].item] = node;
    }
    *out = mesh;
done:
    free(edge);
    return status;
}

/* Amid a and b at the mean of their radii, angles (about z) and z. */
static void place_amid(const double *a, const double *b, double *x)
{
    const double ra = hypot(a[0], a[1]), rb = hypot(b[0], b[1]);
    double d[2] = {0, 0};
    for (int k = 0; k < 2; k++)
        d[k] = (ra > 0 ? a[k] / ra : 0) + (rb > 0 ? b[k] / rb : 0);
    const double length = hypot(d[0], d[1]), r = 0.5 * (ra + rb);
    x[0] = length > 0 ? r * d[0] / length : 0;
    x[1] = length > 0 ? r * d[1] / length : 0;
    x[2] = 0.5 * (a[2] + b[2]);
}

cn_status cn_tets_catheter10(cn_tets **out, double length, double diameter, double inner_diameter,
                             int stations, int sides, cn_error *error)
{
    cn_tets *linear = NULL, *mesh = NULL;
    cn_facet *edge = NULL;
    int nedge = 0, *next = NULL;
    cn_status status = cn_tets_catheter(&linear, length, diameter, inner_diameter, stations, sides, error);

    *out = NULL;
    if (status != CN_OK) return status;
    const int few = linear->nnode / stations, per = inner_diameter > 0 ? 6 * sides : 3 * sides + 1;
    if ((status = sorted_edges(linear, &edge, &nedge)) != CN_OK) goto done;
    if ((status = raised_new(&mesh, linear, nedge)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    if (!(next = cn_array((size_t)(2 * stations - 1), sizeof *next))) goto done;
    for (int s = 0; s < 2 * stations - 1; s++)
        next[s] = s * per + (s % 2 ? 0 : few);
    for (int i = 0; i < linear->nnode; i++)
        cn_copy3(linear->node + 3 * (size_t)i, mesh->node + 3 * (size_t)(i / few * 2 * per + i % few));
    for (int i = 0; i < 4 * linear->ntet; i++)
        mesh->tet[i] = linear->tet[i] / few * 2 * per + linear->tet[i] % few;
    for (int i = 0, j; i < 6 * linear->ntet; i = j) {
        const int *key = edge[i].key, node = next[key[0] / few + key[1] / few]++;
        place_amid(linear->node + 3 * (size_t)key[0], linear->node + 3 * (size_t)key[1],
                   mesh->node + 3 * (size_t)node);
        j = cn_facet_run(6 * linear->ntet, edge, i);
        for (int m = i; m < j; m++)
            mesh->mid[edge[m].item] = node;
    }
    status = CN_OK;
done:
    free(edge);
    free(next);
    cn_tets_free(linear);
    if (status != CN_OK) {
        cn_tets_free(mesh);
        return cn_fail(error, status, NULL, 0, "out of memory for a catheter of %d stations", stations);
    }
    *out = mesh;
    return CN_OK;
}
