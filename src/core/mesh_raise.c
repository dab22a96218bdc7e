/* mesh_raise.c - second-order meshes of linear ones: a node amid each edge, by the edge alone for any mesh,
 * by sections for a catheter. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

static const double two_pi = 6.28318530717958647692;
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

/* Raises a mesh of so many stations, each with as many nodes in a row, whose edges join one or two
 * neighbours: its nodes lie section by section, `per` in each, stations and between them what their edges
 * have amid. Of one station: corners first, edges behind them. */
static cn_status raise(cn_tets **out, const cn_tets *linear, int stations, int per)
{
    const int few = linear->nnode / stations;
    cn_facet *edge = NULL;
    cn_tets *mesh = NULL;
    int nedge = 0, *next = NULL;
    cn_status status = sorted_edges(linear, &edge, &nedge);

    *out = NULL;
    if (status != CN_OK) return status;
    status = CN_ERR_MEMORY;
    if (nedge > INT_MAX - linear->nnode || !(next = cn_array((size_t)(2 * stations - 1), sizeof *next)))
        goto done;
    if ((status = cn_tets_new(&mesh, linear->nnode + nedge, linear->ntet)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    if (!(mesh->mid = cn_array((size_t)linear->ntet, 6 * sizeof *mesh->mid))) goto done;
    for (int s = 0; s < 2 * stations - 1; s++)
        next[s] = s * per + (s % 2 ? 0 : few);
    for (int i = 0; i < linear->nnode; i++)
        cn_copy3(linear->node + 3 * (size_t)i, mesh->node + 3 * (size_t)(i / few * 2 * per + i % few));
    for (int i = 0; i < 4 * linear->ntet; i++)
        mesh->tet[i] = linear->tet[i] / few * 2 * per + linear->tet[i] % few;
    for (int i = 0, j; i < 6 * linear->ntet; i = j) {
        const int *key = edge[i].key, node = next[key[0] / few + key[1] / few]++;
        const double *a = linear->node + 3 * (size_t)key[0], *b = linear->node + 3 * (size_t)key[1];
        for (int k = 0; k < 3; k++) /* halves first: their sum may overflow */
            mesh->node[3 * (size_t)node + (size_t)k] = 0.5 * a[k] + 0.5 * b[k];
        j = cn_facet_run(6 * linear->ntet, edge, i);
        for (int m = i; m < j; m++)
            mesh->mid[edge[m].item] = node;
    }
    status = CN_OK;
done:
    free(edge);
    free(next);
    if (status != CN_OK)
        cn_tets_free(mesh);
    else
        *out = mesh;
    return status;
}

cn_status cn_tets_raise(cn_tets **out, const cn_tets *linear)
{
    *out = NULL;
    return linear->mid ? CN_ERR_ARG : raise(out, linear, 1, 0);
}

cn_status cn_tets_catheter10(cn_tets **out, double length, double diameter, double inner_diameter,
                             int stations, int sides, cn_error *error)
{
    cn_tets *linear = NULL;
    cn_status status = cn_tets_catheter(&linear, length, diameter, inner_diameter, stations, sides, error);

    *out = NULL;
    if (status != CN_OK) return status;
    /* I of a regular polygon: sides r^4 sin a (2 + cos a) / 24 */
    const double angle = two_pi / sides,
                 wider = pow(3 * two_pi / (sides * sin(angle) * (2 + cos(angle))), 0.25);
    for (int i = 0; i < 3 * linear->nnode; i++)
        if (i % 3 < 2) linear->node[i] *= wider;
    status = raise(out, linear, stations, inner_diameter > 0 ? 6 * sides : 3 * sides + 1);
    cn_tets_free(linear);
    if (status == CN_OK) return CN_OK;
    return cn_fail(error, status, NULL, 0, "out of memory for a catheter of %d stations", stations);
}
