/* skin_surface.c - a closed surface about spheres: the level set of a sum of kernels.
 *
 * Cells are cut into six tetrahedra about their diagonal (Kuhn): corners 0, a, a + b, a + b + c for the six
 * orders of the axes, which fit those of the cells beside them. An edge runs from a corner to one beyond it
 * along some of the axes, so a point and a number 1..7 name it; a vertex belongs to each edge between inside
 * and outside, and what a tetrahedron contributes meets its neighbours' along such edges: the surface is
 * closed and manifold whatever the field is. Then vertices move half way to their neighbours' mean, and back
 * to the level by Newton steps along the gradient: triangles get even, and the surface stays where it is. */
#include "catnav/skin.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"

#define REACH 2.5                            /* of a sphere's kernel, over its radius */
#define LEVEL (0.84 * 0.84 * 0.84)           /* (1 - 1 / REACH^2)^3 */
#define MOST  ((double)((long long)1 << 25)) /* points of a grid */
enum { PASSES = 6, EDGES = 7 };

typedef struct {
    int n;
    const double *centre, *radius;
    /* those whose centres lie in bucket b: sphere[first[b]] .. */
    int size[3], *first, *sphere;
    double min[3], width; /* of a bucket: the largest reach [m] */
} field;

typedef struct {
    int size[3]; /* points */
    double min[3], cell;
    double *value;
    unsigned char *inside; /* 2: outside and found from the border */
} grid;

/* --- the field --- */
static int bucket_of(const field *f, double x, int axis)
{
    const double at = floor((x - f->min[axis]) / f->width);
    return at < 0 ? 0 : at >= f->size[axis] ? f->size[axis] - 1 : (int)at;
}

/* One sphere's kernel at x; its gradient is added. */
static double kernel(const double centre[3], double radius, const double x[3], double gradient[3])
{
    double d[3];
    cn_sub(x, centre, d);
    const double reach = REACH * radius, s = 1 - cn_norm2(d) / (reach * reach);
    if (!(s > 0)) return 0;
    if (gradient) cn_axpy(-6 * s * s / (reach * reach), d, gradient);
    return s * s * s;
}

static double value_at(const field *f, const double x[3], double gradient[3])
{
    int low[3], high[3];
    double sum = 0;
    gradient[0] = gradient[1] = gradient[2] = 0;
    for (int k = 0; k < 3; k++)
        low[k] = bucket_of(f, x[k] - f->width, k), high[k] = bucket_of(f, x[k] + f->width, k);
    for (int c = low[2]; c <= high[2]; c++)
        for (int b = low[1]; b <= high[1]; b++)
            for (int a = low[0]; a <= high[0]; a++) {
                const size_t at =
                    (size_t)a + (size_t)f->size[0] * ((size_t)b + (size_t)f->size[1] * (size_t)c);
                for (int i = f->first[at]; i < f->first[at + 1]; i++)
                    sum += kernel(f->centre + 3 * (size_t)f->sphere[i], f->radius[f->sphere[i]], x, gradient);
            }
    return sum;
}

static cn_status check_spheres(int n, const double *centre, const double *radius, cn_error *error)
{
    if (n < 1) return cn_fail(error, CN_ERR_ARG, "", 0, "a surface about spheres needs a sphere");
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++)
            if (!isfinite(centre[3 * (size_t)i + (size_t)k]))
                return cn_fail(error, CN_ERR_NOT_FINITE, "", 0, "the centre of sphere %d is not finite", i);
        if (!(radius[i] > 0 && isfinite(radius[i])))
            return cn_fail(error, CN_ERR_ARG, "", 0, "sphere %d has radius %g: give a positive one", i,
                           radius[i]);
    }
    return CN_OK;
}

/* Buckets as wide as the largest reach, or wider: not more of them than spheres, about. */
static cn_status make_field(field *f, grid *g, double cell, cn_error *error)
{
    double least = INFINITY, most = 0, max[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int k = 0; k < 3; k++)
        f->min[k] = INFINITY;
    for (int i = 0; i < f->n; i++) {
        least = fmin(least, f->radius[i]), most = fmax(most, f->radius[i]);
        for (int k = 0; k < 3; k++) {
            const double x = f->centre[3 * (size_t)i + (size_t)k];
            f->min[k] = fmin(f->min[k], x - REACH * f->radius[i]);
            max[k] = fmax(max[k], x + REACH * f->radius[i]);
        }
    }
    g->cell = cell > 0 ? cell : least / 2;
    f->width = REACH * most;
    double points = 1, buckets = 1;
    for (int k = 0; k < 3; k++)
        points *= ceil((max[k] - f->min[k]) / g->cell) + 3;
    if (!(points <= MOST))
        return cn_fail(
            error, CN_ERR_ARG, "", 0,
            "a surface about spheres in cells of %g m would take a grid of %.3g points: give larger "
            "cells (at most %.3g points)",
            g->cell, points, MOST);
    if (!(g->cell <= 2 * least))
        return cn_fail(
            error, CN_ERR_ARG, "", 0,
            "cells of %g m are too coarse for a sphere of radius %g m: give at most twice the radius",
            g->cell, least);
    for (int k = 0; k < 3; k++) {
        g->size[k] = (int)ceil((max[k] - f->min[k]) / g->cell) + 3;
        g->min[k] = f->min[k] - g->cell; /* the border lies beyond all kernels */
        f->size[k] = (int)ceil((max[k] - f->min[k]) / f->width);
        buckets *= f->size[k];
    }
    f->first = cn_array((size_t)buckets + 1, sizeof *f->first);
    f->sphere = cn_array((size_t)f->n, sizeof *f->sphere);
    if (!f->first || !f->sphere) return CN_ERR_MEMORY;
    for (int pass = 0; pass < 2; pass++) {
        for (int i = f->n - 1; i >= 0; i--) {
            const double *x = f->centre + 3 * (size_t)i;
            const size_t at = (size_t)bucket_of(f, x[0], 0) +
                              (size_t)f->size[0] * ((size_t)bucket_of(f, x[1], 1) +
                                                    (size_t)f->size[1] * (size_t)bucket_of(f, x[2], 2));
            if (pass == 0)
                f->first[at]++;
            else
                f->sphere[--f->first[at]] = i;
        }
        for (size_t b = 0; pass == 0 && b < (size_t)buckets; b++)
            f->first[b + 1] += f->first[b];
    }
    return CN_OK;
}

/* --- the grid --- */
static size_t point_of(const grid *g, int i, int j, int k)
{
    return (size_t)i + (size_t)g->size[0] * ((size_t)j + (size_t)g->size[1] * (size_t)k);
}

/* How far on corner b of a cell lies: bit k means one along axis k. */
static size_t step_of(const grid *g, int b)
{
    return point_of(g, b & 1, b >> 1 & 1, b >> 2);
}

static void splat(const field *f, grid *g)
{
    for (int s = 0; s < f->n; s++) {
        const double *centre = f->centre + 3 * (size_t)s, reach = REACH * f->radius[s];
        int low[3], high[3];
        for (int k = 0; k < 3; k++) {
            low[k] = (int)fmax(0, ceil((centre[k] - reach - g->min[k]) / g->cell));
            high[k] = (int)fmin(g->size[k] - 1, floor((centre[k] + reach - g->min[k]) / g->cell));
        }
        for (int k = low[2]; k <= high[2]; k++)
            for (int j = low[1]; j <= high[1]; j++)
                for (int i = low[0]; i <= high[0]; i++) {
                    const double x[3] = {g->min[0] + i * g->cell, g->min[1] + j * g->cell,
                                         g->min[2] + k * g->cell};
                    g->value[point_of(g, i, j, k)] += kernel(centre, f->radius[s], x, NULL);
                }
    }
}

/* Inside is what is above the level, and what cannot be reached from the border along edges. */
static cn_status find_inside(grid *g, size_t n)
{
    size_t *stack = cn_array(n, sizeof *stack), top = 0;
    if (!stack) return CN_ERR_MEMORY;
    for (size_t p = 0; p < n; p++)
        g->inside[p] = g->value[p] > LEVEL;
    stack[top++] = 0, g->inside[0] = 2;
    while (top) {
        const size_t p = stack[--top];
        const int at[3] = {(int)(p % (size_t)g->size[0]), (int)(p / (size_t)g->size[0] % (size_t)g->size[1]),
                           (int)(p / (size_t)g->size[0] / (size_t)g->size[1])};
        for (int e = -EDGES; e <= EDGES; e++) {
            const int b = e < 0 ? -e : e, way = e < 0 ? -1 : 1;
            bool out = b == 0;
            for (int k = 0; k < 3; k++) {
                const int to = at[k] + way * (b >> k & 1);
                out = out || to < 0 || to >= g->size[k];
            }
            if (out) continue;
            const size_t next = way > 0 ? p + step_of(g, b) : p - step_of(g, b);
            if (g->inside[next]) continue;
            g->inside[next] = 2;
            stack[top++] = next;
        }
    }
    for (size_t p = 0; p < n; p++)
        g->inside[p] = g->inside[p] != 2;
    free(stack);
    return CN_OK;
}

/* --- marching tetrahedra --- */
static const int kuhn[6][4] = {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7},  /* positive */
                               {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 4, 6, 7}}; /* negative */

typedef struct {
    const grid *g;
    cn_surface *surface; /* NULL: counted alone */
    int nvert, ntri;
    int *id[2]; /* vertices on the edges from points of this layer and the next, -1: none yet */
} march;

/* The vertex between a point inside and one outside, the corners a and b of the cell at (i, j, k). */
static int vertex_on(march *m, int i, int j, int k, int a, int b)
{
    const grid *g = m->g;
    const int low = a & b, edge = a ^ b; /* one holds the other */
    const int at[3] = {i + (low & 1), j + (low >> 1 & 1), k + (low >> 2)};
    int *id = m->id[at[2] & 1] + EDGES * ((size_t)at[0] + (size_t)g->size[0] * (size_t)at[1]) + edge - 1;
    if (*id >= 0) return *id;
    *id = m->nvert++;
    if (!m->surface) return *id;
    const size_t from = point_of(g, at[0], at[1], at[2]), to = from + step_of(g, edge);
    const double t = (LEVEL - g->value[from]) / (g->value[to] - g->value[from]);
    const double kept = fmin(fmax(t, 0.05), 0.95); /* apart from those of other edges */
    double *x = m->surface->vert + 3 * (size_t)*id;
    for (int axis = 0; axis < 3; axis++)
        x[axis] = g->min[axis] + g->cell * (at[axis] + (edge >> axis & 1 ? kept : 0));
    return *id;
}

static void add_triangle(march *m, int a, int b, int c, bool flip)
{
    const size_t at = 3 * (size_t)m->ntri++;
    if (!m->surface) return;
    int *tri = m->surface->tri + at;
    tri[0] = a, tri[1] = flip ? c : b, tri[2] = flip ? b : c;
}

/* Corners in even order with those inside first: 1 of 4 or 3 of 4 a triangle, 2 of 4 two. */
static void cut(march *m, int i, int j, int k, const int corner[4], int mask, bool negative)
{
    static const int pair[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                   {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};
    const int count = (mask & 1) + (mask >> 1 & 1) + (mask >> 2 & 1) + (mask >> 3);
    if (count == 1 || count == 3) {
        int one = 0;
        while ((mask >> one & 1) != (count == 1))
            one++;
        const int a = vertex_on(m, i, j, k, corner[one], corner[one ^ 1]),
                  b = vertex_on(m, i, j, k, corner[one], corner[one ^ 2]),
                  c = vertex_on(m, i, j, k, corner[one], corner[one ^ 3]);
        add_triangle(m, a, b, c, negative != (count == 3));
    } else if (count == 2) {
        int p = 0;
        while ((1 << pair[p][0] | 1 << pair[p][1]) != mask)
            p++;
        const int *c = pair[p];
        const int a = vertex_on(m, i, j, k, corner[c[0]], corner[c[2]]),
                  b = vertex_on(m, i, j, k, corner[c[0]], corner[c[3]]),
                  d = vertex_on(m, i, j, k, corner[c[1]], corner[c[3]]),
                  e = vertex_on(m, i, j, k, corner[c[1]], corner[c[2]]);
        add_triangle(m, a, b, d, negative);
        add_triangle(m, a, d, e, negative);
    }
}

static void walk(march *m)
{
    const grid *g = m->g;
    const size_t layer = (size_t)EDGES * (size_t)g->size[0] * (size_t)g->size[1] * sizeof(int);
    m->nvert = m->ntri = 0;
    memset(m->id[0], -1, layer);
    for (int k = 0; k + 1 < g->size[2]; k++) {
        memset(m->id[(k + 1) & 1], -1, layer);
        for (int j = 0; j + 1 < g->size[1]; j++)
            for (int i = 0; i + 1 < g->size[0]; i++) {
                const unsigned char *inside = g->inside + point_of(g, i, j, k);
                int cell = 0;
                for (int b = 0; b < 8; b++)
                    cell |= inside[step_of(g, b)] << b;
                for (int t = 0; t < 6 && cell != 0 && cell != 255; t++) {
                    int mask = 0;
                    for (int c = 0; c < 4; c++)
                        mask |= (cell >> kuhn[t][c] & 1) << c;
                    cut(m, i, j, k, kuhn[t], mask, t >= 3);
                }
            }
    }
}

/* --- evening out --- */
static void to_level(const field *f, double most, double x[3])
{
    double gradient[3];
    const double excess = value_at(f, x, gradient) - LEVEL, square = cn_norm2(gradient);
    if (!(square > 0)) return;
    const double way = fmin(fabs(excess) / sqrt(square), most);
    cn_axpy((excess > 0 ? -way : way) / sqrt(square), gradient, x);
}

static cn_status even_out(const field *f, double cell, cn_surface *s)
{
    const size_t n = (size_t)s->nvert;
    double *sum = cn_array(3 * n, sizeof *sum);
    int *count = cn_array(n, sizeof *count);
    if (sum && count)
        for (int pass = 0; pass < PASSES; pass++) {
            memset(sum, 0, 3 * n * sizeof *sum);
            memset(count, 0, n * sizeof *count);
            for (size_t c = 0; c < 3 * (size_t)s->ntri; c++) { /* closed: each neighbour comes once */
                const size_t a = (size_t)s->tri[c], b = (size_t)s->tri[c % 3 == 2 ? c - 2 : c + 1];
                cn_axpy(1, s->vert + 3 * b, sum + 3 * a);
                count[a]++;
            }
            for (size_t v = 0; v < n; v++) {
                double *x = s->vert + 3 * v;
                for (int k = 0; k < 3; k++)
                    x[k] += 0.5 * (sum[3 * v + (size_t)k] / count[v] - x[k]);
                to_level(f, cell / 2, x);
                to_level(f, cell / 2, x);
            }
        }
    const cn_status status = sum && count ? CN_OK : CN_ERR_MEMORY;
    free(sum);
    free(count);
    return status;
}

static cn_status make_surface(cn_surface **out, const field *f, const grid *g)
{
    const size_t layer = EDGES * (size_t)g->size[0] * (size_t)g->size[1];
    march m = {.g = g, .id = {cn_array(layer, sizeof(int)), cn_array(layer, sizeof(int))}};
    cn_status status = CN_ERR_MEMORY;
    if (!m.id[0] || !m.id[1]) goto done;
    walk(&m);
    if ((status = cn_surface_new(&m.surface, m.nvert, m.ntri)) != CN_OK) goto done;
    walk(&m);
    if ((status = even_out(f, g->cell, m.surface)) != CN_OK) goto done;
    *out = m.surface, m.surface = NULL;
done:
    cn_surface_free(m.surface);
    free(m.id[0]);
    free(m.id[1]);
    return status;
}

cn_status cn_surface_about_spheres(cn_surface **out, int n, const double *centre, const double *radius,
                                   double cell, cn_error *error)
{
    field f = {.n = n, .centre = centre, .radius = radius};
    grid g = {0};
    cn_status status;

    *out = NULL;
    if ((status = check_spheres(n, centre, radius, error)) != CN_OK) return status;
    if (!(cell >= 0 && isfinite(cell)))
        return cn_fail(error, CN_ERR_ARG, "", 0, "cells of %g m: give a size, or 0 for half the least radius",
                       cell);
    if ((status = make_field(&f, &g, cell, error)) != CN_OK) goto done;
    const size_t points = (size_t)g.size[0] * (size_t)g.size[1] * (size_t)g.size[2];
    g.value = cn_array(points, sizeof *g.value), g.inside = cn_array(points, 1);
    status = CN_ERR_MEMORY;
    if (!g.value || !g.inside) goto done;
    splat(&f, &g);
    if ((status = find_inside(&g, points)) != CN_OK) goto done;
    status = make_surface(out, &f, &g);
done:
    free(f.first);
    free(f.sphere);
    free(g.value);
    free(g.inside);
    return status == CN_ERR_MEMORY
               ? cn_fail(error, status, "", 0, "out of memory for a surface about %d spheres", n)
               : status;
}
