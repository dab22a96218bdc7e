/* Virtual caps: the boundary loops of an open vessel, each closed by a fan of triangles. */
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "tree.h"
#include "world.h"

typedef struct {
    int low, high, from, to;
} edge; /* from -> to as its triangle runs */

static int by_ends(const void *left, const void *right)
{
    const edge *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return (a->from > b->from) - (a->from < b->from);
}

static int by_start(const void *left, const void *right)
{
    const edge *a = left, *b = right;
    if (a->from != b->from) return a->from < b->from ? -1 : 1;
    return (a->to > b->to) - (a->to < b->to);
}

/* Edges that lack a partner running the other way, sorted by their start; *n of them. */
static edge *boundary(const cn_surface *surface, int *n)
{
    const size_t count = 3 * (size_t)surface->ntri;
    edge *list = malloc((count + 1) * sizeof *list);
    if (!list) return NULL;
    for (size_t i = 0; i < count; i++) {
        const int a = surface->tri[i], b = surface->tri[i % 3 == 2 ? i - 2 : i + 1];
        list[i] = (edge){a < b ? a : b, a < b ? b : a, a, b};
    }
    qsort(list, count, sizeof *list, by_ends);
    *n = 0;
    for (size_t i = 0, end; i < count; i = end) {
        int excess = 0; /* of low -> high over high -> low */
        for (end = i; end < count && list[end].low == list[i].low && list[end].high == list[i].high; end++)
            excess += list[end].from == list[end].low ? 1 : -1;
        const edge e = list[i];
        for (int k = 0; k < abs(excess); k++)
            list[(*n)++] =
                excess > 0 ? (edge){e.low, e.high, e.low, e.high} : (edge){e.low, e.high, e.high, e.low};
    }
    qsort(list, (size_t)*n, sizeof *list, by_start);
    return list;
}

/* An edge that starts at vertex v and is not used yet, -1 if none. */
static int next_edge(const edge *list, int n, const bool *used, int v)
{
    int low = 0, high = n;
    while (low < high) {
        const int mid = (low + high) / 2;
        if (list[mid].from < v)
            low = mid + 1;
        else
            high = mid;
    }
    for (; low < n && list[low].from == v; low++)
        if (!used[low]) return low;
    return -1;
}

/* Of one loop's fan (its triangles run apex, to, from): the apex goes to the centroid of the loop's edges [by
 * length]; vector area of the fan, and how far it reaches. */
static void measure_loop(double *vert, const int *fan, int n, double cap[7])
{
    double *apex = vert + 3 * (size_t)fan[0];
    double length = 0, area[3] = {0, 0, 0}, u[3], w[3], c[3], level = INFINITY, radius2 = 0;
    apex[0] = apex[1] = apex[2] = 0;
    for (int i = 0; i < n; i++) {
        const double *a = vert + 3 * (size_t)fan[3 * i + 2], *b = vert + 3 * (size_t)fan[3 * i + 1];
        const double l = cn_distance(a, b);
        cn_axpy(l / 2, a, apex), cn_axpy(l / 2, b, apex), length += l;
    }
    for (int k = 0; k < 3; k++)
        apex[k] = length > 0 ? apex[k] / length : vert[3 * (size_t)fan[2] + (size_t)k];
    for (int i = 0; i < n; i++) {
        cn_sub(vert + 3 * (size_t)fan[3 * i + 1], apex, u),
            cn_sub(vert + 3 * (size_t)fan[3 * i + 2], apex, w);
        cn_cross(u, w, c);
        cn_add(area, c, area);
    }
    cn_normalise(area);
    for (int i = 0; i < n; i++) {
        cn_sub(vert + 3 * (size_t)fan[3 * i + 2], apex, u);
        const double along = cn_dot(u, area);
        level = fmin(level, along), radius2 = fmax(radius2, cn_norm2(u) - along * along);
    }
    cn_copy3(apex, cap), cn_axpy(level, area, cap), cn_copy3(area, cap + 3);
    cap[6] = sqrt(radius2);
}

void cn_wall_measure_caps(const cn_wall *wall, double *vert, double (*cap)[7])
{
    const int ntri = wall->caps ? wall->caps->ntri : 0;
    for (int begin = 0, end; begin < ntri; begin = end) {
        for (end = begin; end < ntri && wall->cap_of[end] == wall->cap_of[begin];)
            end++;
        measure_loop(vert, wall->caps->tri + 3 * begin, end - begin, cap[wall->cap_of[begin]]);
    }
}

cn_status cn_wall_cap(cn_wall *wall)
{
    const cn_surface *surface = wall->surface;
    int n = 0;
    edge *list = boundary(surface, &n);
    bool *used = calloc((size_t)n + 1, sizeof *used);
    int *loop = malloc(((size_t)n + 1) * sizeof *loop);
    cn_status status = CN_ERR_MEMORY;
    if (!list || !used || !loop || n == 0) {
        if (list && used && loop) status = CN_OK;
        goto done;
    }
    wall->cap_of = malloc((size_t)n * sizeof *wall->cap_of);
    wall->cap = malloc((size_t)n * sizeof *wall->cap);
    if (!wall->cap_of || !wall->cap) goto done;
    /* the fans index the surface's vertices, then one apex a loop */
    if ((status = cn_surface_new(&wall->caps, surface->nvert + n, n)) != CN_OK) goto done;
    memcpy(wall->caps->vert, surface->vert, 3 * (size_t)surface->nvert * sizeof *surface->vert);
    for (int start = 0, ntri = 0; start < n; start++) {
        int count = 0;
        for (int e = start; e >= 0 && !used[e]; e = next_edge(list, n, used, list[e].to))
            used[e] = true, loop[count++] = e;
        if (!count) continue;
        const int apex = surface->nvert + wall->ncap;
        for (int i = 0; i < count; i++, ntri++) {
            wall->cap_of[ntri] = wall->ncap;
            wall->caps->tri[3 * ntri] = apex;
            wall->caps->tri[3 * ntri + 1] = list[loop[i]].to,
                                       wall->caps->tri[3 * ntri + 2] = list[loop[i]].from;
        }
        wall->ncap++;
    }
    wall->caps->nvert = surface->nvert + wall->ncap;
    cn_wall_measure_caps(wall, wall->caps->vert, wall->cap);
    status = cn_tree_new(&wall->cap_tree, wall->caps->ntri, wall->caps->tri, wall->caps->vert);
done:
    free(list), free(used), free(loop);
    return status;
}

bool cn_cap_corridor(int ncap, double (*cap)[7], const double p[3])
{
    for (int i = 0; i < ncap; i++) {
        double d[3];
        cn_sub(p, cap[i], d);
        const double along = cn_dot(d, cap[i] + 3);
        if (along >= 0 && cn_norm2(d) - along * along <= cap[i][6] * cap[i][6]) return true;
    }
    return false;
}
