/* molecules_fill.c - packs a closed surface with molecules on a body-centred cubic lattice. */
#include "molecules.h"

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"

static const double JITTER = 0.1;      /* of the radius; 0.2 would soften by 12 % */
static const double HELD_MIN = 0.05;   /* least determinant of sum n n' over a molecule's links */
static const double LARGEST_MIN = 0.9; /* least part of the sites in the largest group */

/* Sites (i, j, k) h from the origin with i, j, k all even or all odd, h = a/2; centred in the bounding box.
 */
typedef struct {
    int count[3];
    double origin[3], h;
    int *id; /* of the molecule there, -1 (count[0] x count[1] x count[2], the first the fastest) */
} lattice;

cn_status cn_packing_new(cn_packing **out, int n)
{
    cn_packing *p = calloc(1, sizeof *p);
    *out = NULL;
    if (!p) return CN_ERR_MEMORY;
    p->n = n;
    p->place = calloc((size_t)n + 1, 3 * sizeof *p->place);
    p->share = calloc((size_t)n + 1, sizeof *p->share);
    if (!p->place || !p->share) {
        cn_packing_free(p);
        return CN_ERR_MEMORY;
    }
    *out = p;
    return CN_OK;
}

void cn_packing_free(cn_packing *p)
{
    if (!p) return;
    free(p->place), free(p->share), free(p->link);
    free(p);
}

static size_t site(const lattice *l, int i, int j, int k)
{
    return ((size_t)k * (size_t)l->count[1] + (size_t)j) * (size_t)l->count[0] + (size_t)i;
}

static void place_of(const lattice *l, size_t at, double p[3])
{
    const size_t nx = (size_t)l->count[0], ny = (size_t)l->count[1];
    const size_t index[3] = {at % nx, at / nx % ny, at / nx / ny};
    for (int k = 0; k < 3; k++)
        p[k] = l->origin[k] + l->h * (double)index[k];
}

static cn_status lay(lattice *l, const cn_tree *walls, double volume, double radius, cn_error *error)
{
    double min[3], max[3], sites = 1;
    cn_tree_box(walls, min, max);
    l->h = 2 * radius / sqrt(3);
    const double expected = volume / (4 * l->h * l->h * l->h);
    for (int k = 0; k < 3; k++)
        sites *= fmax(1, rint((max[k] - min[k]) / l->h));
    if (!(expected <= CN_MOLECULES_MAX && sites <= 16.0 * CN_MOLECULES_MAX))
        return cn_fail(error, CN_FAULT_VALUE, "", 0,
                       "molecules of radius %g m: about %.3g would fill the shape, %d are the most: take a "
                       "radius of at least %.3g m",
                       radius, expected, CN_MOLECULES_MAX,
                       radius * 1.01 *
                           cbrt(fmax(expected / CN_MOLECULES_MAX, sites / (16.0 * CN_MOLECULES_MAX))));
    for (int k = 0; k < 3; k++) {
        l->count[k] = (int)fmax(1, rint((max[k] - min[k]) / l->h));
        l->origin[k] = 0.5 * (min[k] + max[k] - (l->count[k] - 1) * l->h);
    }
    return (l->id = malloc((size_t)sites * sizeof *l->id)) ? CN_OK : CN_ERR_MEMORY;
}

/* Marks sites inside by 0, others by -1; returns how many. */
static int mark_inside(lattice *l, const cn_tree *walls)
{
    int n = 0;
    for (int k = 0; k < l->count[2]; k++)
        for (int j = 0; j < l->count[1]; j++)
            for (int i = 0; i < l->count[0]; i++) {
                const size_t at = site(l, i, j, k);
                double p[3];
                l->id[at] = -1;
                if ((i ^ j) & 1 || (i ^ k) & 1) continue;
                place_of(l, at, p);
                if (cn_tree_inside(walls, NULL, p)) l->id[at] = 0, n++;
            }
    return n;
}

/* Steps to the neighbours, the first half of them to sites after it. */
static const int step_of[14][3] = {{1, 1, 1},  {-1, 1, 1}, {1, -1, 1},   {-1, -1, 1}, {2, 0, 0},
                                   {0, 2, 0},  {0, 0, 2},  {-1, -1, -1}, {1, -1, -1}, {-1, 1, -1},
                                   {1, 1, -1}, {-2, 0, 0}, {0, -2, 0},   {0, 0, -2}};

/* The molecule a step away, -1. */
static int neighbour(const lattice *l, int i, int j, int k, int step)
{
    const int *s = step_of[step], a = i + s[0], b = j + s[1], c = k + s[2];
    if (a < 0 || b < 0 || c < 0 || a >= l->count[0] || b >= l->count[1] || c >= l->count[2]) return -1;
    return l->id[site(l, a, b, c)];
}

static bool held(const lattice *l, int i, int j, int k)
{
    double m[9] = {0};
    for (int s = 0; s < 14; s++) {
        if (neighbour(l, i, j, k, s) < 0) continue;
        const double size = s % 7 < 4 ? 3 : 4;
        for (int e = 0; e < 9; e++)
            m[e] += step_of[s][e / 3] * step_of[s][e % 3] / size;
    }
    return cn_det(m) > HELD_MIN;
}

#define EACH_SITE(l)                                                                                         \
    for (int k = 0; k < (l)->count[2]; k++)                                                                  \
        for (int j = 0; j < (l)->count[1]; j++)                                                              \
            for (int i = 0; i < (l)->count[0]; i++)

/* Leaves out what its links do not hold, until all are held; returns how many are left. */
static int prune(lattice *l, int n)
{
    for (int before = n + 1; before != n;) {
        before = n;
        EACH_SITE(l)
        {
            int *id = l->id + site(l, i, j, k);
            if (*id >= 0 && !held(l, i, j, k)) *id = -1, n--;
        }
    }
    return n;
}

static int number(lattice *l)
{
    int n = 0;
    EACH_SITE(l)
    {
        int *id = l->id + site(l, i, j, k);
        if (*id >= 0) *id = n++;
    }
    return n;
}

/* Leaves the largest group of joined sites (the first of equal ones), unless others hold much. */
static cn_status keep_largest(lattice *l, int *n, double radius, cn_error *error)
{
    int *parent = malloc(((size_t)*n + 1) * sizeof *parent), *size = calloc((size_t)*n + 1, sizeof *size);
    int most = 0, groups = 0;
    if (!parent || !size) {
        free(parent), free(size);
        return CN_ERR_MEMORY;
    }
    for (int i = 0; i < *n; i++)
        parent[i] = i;
    EACH_SITE(l)
    {
        const int id = l->id[site(l, i, j, k)];
        for (int s = 0; id >= 0 && s < 7; s++) {
            const int other = neighbour(l, i, j, k, s);
            if (other >= 0) cn_set_join(parent, id, other);
        }
    }
    for (int i = 0; i < *n; i++)
        size[cn_set_find(parent, i)]++;
    for (int i = 0; i < *n; i++) {
        groups += size[i] > 0;
        if (size[i] > size[most]) most = i;
    }
    cn_status status = CN_OK;
    if (size[most] < LARGEST_MIN * *n)
        status =
            cn_fail(error, CN_FAULT_APART, "", 0,
                    "the molecules of radius %g m fall into %d groups that no link joins, the largest of "
                    "%d out of %d: take a smaller radius, so that two layers fit everywhere",
                    radius, groups, size[most], *n);
    EACH_SITE(l)
    {
        int *id = l->id + site(l, i, j, k);
        if (*id >= 0 && cn_set_find(parent, *id) != most) *id = -1;
    }
    free(parent), free(size);
    *n = number(l);
    return status;
}

static cn_status take_sites(cn_packing *p, const lattice *l)
{
    if (!(p->link = malloc(((size_t)p->n + 1) * 14 * sizeof *p->link))) return CN_ERR_MEMORY;
    EACH_SITE(l)
    {
        const size_t at = site(l, i, j, k);
        const int id = l->id[at];
        if (id < 0) continue;
        place_of(l, at, p->place + 3 * (size_t)id);
        for (int s = 0; s < 7; s++) {
            const int other = neighbour(l, i, j, k, s);
            if (other < 0) continue;
            int *pair = p->link + 2 * (size_t)p->nlink++;
            pair[0] = id, pair[1] = other;
        }
    }
    return CN_OK;
}

/* The lattice's nearest site, -1 where it holds nothing. */
static int nearest_site(const void *user, const double p[3])
{
    const lattice *l = user;
    double u[3], least = INFINITY;
    int best = -1;
    for (int c = 0; c < 3; c++)
        u[c] = (p[c] - l->origin[c]) / l->h;
    for (int odd = 0; odd < 2; odd++) {
        int at[3];
        double square = 0;
        bool there = true;
        for (int c = 0; c < 3; c++) {
            at[c] = 2 * (int)rint((u[c] - odd) / 2) + odd;
            square += (u[c] - at[c]) * (u[c] - at[c]);
            there = there && at[c] >= 0 && at[c] < l->count[c];
        }
        if (square >= least) continue;
        least = square;
        best = there ? l->id[site(l, at[0], at[1], at[2])] : -1;
    }
    return best;
}

/* A number in [-1, 1) of seed and place in the sequence (splitmix64). */
static double random_of(unsigned seed, size_t at)
{
    uint64_t z = ((uint64_t)seed << 40) + 0x9e3779b97f4a7c15u * (uint64_t)(at + 1);
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (double)((z ^ z >> 31) >> 11) / 4503599627370496.0 - 1;
}

/* What would leave the surface moves half as far, and half again, or not at all. */
static void jitter(cn_packing *p, const cn_tree *walls, double radius, unsigned seed)
{
    for (int i = 0; i < p->n; i++) {
        double *x = p->place + 3 * (size_t)i, from[3];
        double size = JITTER * radius / sqrt(3);
        cn_copy3(x, from);
        for (int tries = 0; tries < 4; tries++, size *= 0.5) {
            for (int k = 0; k < 3; k++)
                x[k] = from[k] + size * random_of(seed, 3 * (size_t)i + (size_t)k);
            if (cn_tree_inside(walls, NULL, x)) break;
            cn_copy3(from, x);
        }
    }
}

cn_status cn_packing_fill(cn_packing **out, const cn_surface *surface, double volume, double radius,
                          bool jittered, unsigned seed, cn_error *error)
{
    lattice l = {.id = NULL};
    cn_tree *walls = NULL;
    cn_packing *p = NULL;
    *out = NULL;
    if (!(radius > 0 && radius <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "the radius of molecules is %g m; it must be positive",
                       radius);
    cn_status status = cn_tree_new(&walls, surface->ntri, surface->tri, surface->vert);
    if (status == CN_OK) status = lay(&l, walls, volume, radius, error);
    if (status != CN_OK) goto done;
    const int inside = mark_inside(&l, walls);
    int n = prune(&l, inside);
    if (n == 0) {
        status = cn_fail(error, CN_FAULT_UNIT, "", 0,
                         "molecules of radius %g m do not fill the shape: of %d inside none is held by its "
                         "neighbours: take a radius of %.3g m or less",
                         radius, inside, fmin(0.5 * radius, 0.2 * cbrt(volume)));
        goto done;
    }
    n = number(&l);
    if ((status = keep_largest(&l, &n, radius, error)) != CN_OK) goto done;
    if (n < inside)
        CN_LOG(CN_LOG_WARNING,
               "%d of %d molecules left out where the shape is too thin for the radius %g m: their "
               "neighbours would not hold them",
               inside - n, inside, radius);
    if ((status = cn_packing_new(&p, n)) != CN_OK) goto done;
    p->spacing = 2 * radius;
    if ((status = take_sites(p, &l)) != CN_OK) goto done;
    status = cn_packing_share(p, walls, volume, l.origin, 0.5 * l.h, 32, nearest_site, &l);
    if (status == CN_OK && jittered) jitter(p, walls, radius, seed);
done:
    cn_tree_free(walls);
    free(l.id);
    if (status == CN_OK)
        *out = p;
    else
        cn_packing_free(p);
    return status;
}
