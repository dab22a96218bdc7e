/* mesh_cut.c - a surface with short edges: every edge that is too long is halved, and the triangles next to
 * it cut accordingly, until none is. Both triangles of an edge see the same middle, so that a closed surface
 * stays closed; the shape is the same. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

enum { CUT_MOST = 1 << 23 }; /* triangles */

/* middle (3 ntri): of edge k, from corner k to the next, its new vertex, -1: short enough. */
static cn_status halve(const cn_surface *from, double longest, int *middle, double **vert, int *nvert,
                       int *ntri)
{
    const int n = 3 * from->ntri;
    cn_facet *edge = cn_array((size_t)n, sizeof *edge);
    cn_status status = CN_ERR_MEMORY;
    *vert = NULL, *nvert = from->nvert, *ntri = from->ntri;
    if (!edge) return status;
    for (int i = 0; i < n; i++)
        edge[i] = cn_facet_edge(from->tri[i], from->tri[i - i % 3 + (i + 1) % 3], i);
    if ((status = cn_facet_sort(from->nvert, n, edge)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    if (!(*vert = cn_array((size_t)from->nvert + (size_t)n, 3 * sizeof **vert))) goto done;
    memcpy(*vert, from->vert, 3 * (size_t)from->nvert * sizeof **vert);
    for (int i = 0, j; i < n; i = j) {
        const double *a = from->vert + 3 * (size_t)edge[i].key[0],
                     *b = from->vert + 3 * (size_t)edge[i].key[1];
        const bool is_long = cn_distance(a, b) > longest;
        j = cn_facet_run(n, edge, i);
        for (int k = 0; is_long && k < 3; k++)
            (*vert)[3 * (size_t)*nvert + (size_t)k] = 0.5 * a[k] + 0.5 * b[k];
        for (int m = i; m < j; m++)
            middle[edge[m].item] = is_long ? *nvert : -1, *ntri += is_long;
        *nvert += is_long;
    }
    status = CN_OK;
done:
    free(edge);
    return status;
}

static void put(int **to, int a, int b, int c)
{
    (*to)[0] = a, (*to)[1] = b, (*to)[2] = c, *to += 3;
}

/* The one to four triangles of a cut one. */
static void cut(const int corner[3], const int middle[3], const double *vert, int **to)
{
    const int n = (middle[0] >= 0) + (middle[1] >= 0) + (middle[2] >= 0);
    int k = 0; /* n 1: the edge that is cut; 2: that is not */
    while (n % 3 && (middle[k] >= 0) != (n == 1))
        k++;
    const int a = corner[k], b = corner[(k + 1) % 3], c = corner[(k + 2) % 3];
    const int ab = middle[k], bc = middle[(k + 1) % 3], ca = middle[(k + 2) % 3];
    if (n == 0) {
        put(to, a, b, c);
    } else if (n == 1) {
        put(to, a, ab, c), put(to, ab, b, c);
    } else if (n == 2) { /* the shorter way across the rest */
        const bool from_a = cn_distance(vert + 3 * (size_t)a, vert + 3 * (size_t)bc) <=
                            cn_distance(vert + 3 * (size_t)b, vert + 3 * (size_t)ca);
        put(to, ca, bc, c), put(to, a, b, from_a ? bc : ca);
        put(to, from_a ? a : b, bc, ca);
    } else {
        put(to, a, ab, ca), put(to, ab, b, bc), put(to, ca, bc, c), put(to, ab, bc, ca);
    }
}

cn_status cn_surface_cut(cn_surface **out, const cn_surface *surface, double longest)
{
    cn_surface *now = NULL;
    *out = NULL;
    if (!(longest > 0)) return CN_ERR_ARG;
    cn_status status = cn_surface_copy(&now, surface);
    for (bool any = true; status == CN_OK && any;) {
        double *vert = NULL;
        int nvert, ntri;
        cn_surface *next = NULL;
        if (now->ntri > CUT_MOST / 4) {
            status = CN_ERR_ARG;
            break;
        }
        int *middle = cn_array(3 * (size_t)now->ntri, sizeof *middle);
        status = middle ? halve(now, longest, middle, &vert, &nvert, &ntri) : CN_ERR_MEMORY;
        any = status == CN_OK && ntri > now->ntri;
        if (any && (status = cn_surface_new(&next, nvert, ntri)) == CN_OK) {
            int *to = next->tri;
            memcpy(next->vert, vert, 3 * (size_t)nvert * sizeof *vert);
            for (int t = 0; t < now->ntri; t++)
                cut(now->tri + 3 * (size_t)t, middle + 3 * (size_t)t, vert, &to);
            cn_surface_free(now);
            now = next;
        }
        free(middle), free(vert);
    }
    if (status == CN_OK)
        *out = now;
    else
        cn_surface_free(now);
    return status;
}
