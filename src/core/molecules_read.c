/* molecules_read.c - molecules from a file: a line each, x y z [m], or x y z and the radius. */
#include "molecules.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "mesh_read.h"

static const double REACH = 1.5;      /* links: of the sum of the radii */
static const double APART_MIN = 1e-6; /* least distance, of the sum of the radii */
enum { LINKS_MOST = 64 };             /* of a molecule on the average */

typedef struct {
    int n, room;
    double *place, *radius; /* [m] (room x 3), (room) */
    int *line;
} list;

static cn_status grow(list *l)
{
    const int room = l->room ? 2 * l->room : 1024;
    double *place = realloc(l->place, (size_t)room * 3 * sizeof *place);
    if (place) l->place = place;
    double *radius = realloc(l->radius, (size_t)room * sizeof *radius);
    if (radius) l->radius = radius;
    int *line = realloc(l->line, (size_t)room * sizeof *line);
    if (line) l->line = line;
    if (!place || !radius || !line) return CN_ERR_MEMORY;
    l->room = room;
    return CN_OK;
}

static cn_status read_line(cn_scan *scan, list *l, bool *own, double radius)
{
    static const char *const axis[3] = {"x", "y", "z"};
    cn_status status = CN_OK;
    double *x = l->place + 3 * (size_t)l->n;
    const char *token;
    size_t length;
    for (int k = 0; k < 3; k++)
        if ((status = cn_scan_number(scan, axis[k], x + k)) != CN_OK) return status;
    const char *const rest = scan->cursor;
    const bool more = cn_scan_token(scan, &token, &length);
    if (l->n == 0) *own = more;
    scan->cursor = rest;
    if (*own) {
        if ((status = cn_scan_number(scan, "the radius", &radius)) != CN_OK) return status;
        if (!(radius > 0 && radius <= 1e300))
            return cn_scan_fail(scan, CN_FAULT_RANGE, "the radius is %g m: it must be positive", radius);
    }
    l->radius[l->n] = radius, l->line[l->n++] = scan->line;
    return cn_scan_no_more(scan, *own ? "the radius" : "z (the first line has no radius)");
}

static cn_status read_list(cn_scan *scan, list *l, double radius)
{
    bool own = false;
    cn_status status;
    scan->comment = '#';
    while (cn_scan_line(scan)) {
        if (l->n == CN_MOLECULES_MAX)
            return cn_scan_fail(scan, CN_FAULT_TOO_MANY, "more than %d molecules", CN_MOLECULES_MAX);
        if (l->n == l->room && (status = grow(l)) != CN_OK) return status;
        if ((status = read_line(scan, l, &own, radius)) != CN_OK) return status;
    }
    return l->n >= 2 ? CN_OK
                     : cn_scan_fail(scan, CN_FAULT_NO_MESH, "%d molecule(s): a body needs at least 2", l->n);
}

cn_status cn_point_tree_new(cn_tree **out, int **corner, int n, const double *point)
{
    *out = NULL;
    if (!(*corner = malloc(((size_t)n + 1) * 3 * sizeof **corner))) return CN_ERR_MEMORY;
    for (int i = 0; i < 3 * n; i++)
        (*corner)[i] = i / 3;
    return cn_tree_new(out, n, *corner, point);
}

static int ascending(const void *a, const void *b)
{
    return *(const int *)a - *(const int *)b;
}

/* Links of each molecule to those after it, in order. */
static cn_status join(cn_packing *p, const list *l, const cn_tree *tree, const char *path, cn_error *error)
{
    const long long most = (long long)LINKS_MOST * l->n;
    int room = 64, capacity = 16 * l->n + 64, *found = malloc((size_t)room * sizeof *found);
    double largest = 0;
    cn_status status = CN_ERR_MEMORY;
    if (!found || !(p->link = malloc((size_t)capacity * 2 * sizeof *p->link))) goto done;
    for (int i = 0; i < l->n; i++)
        largest = fmax(largest, l->radius[i]);
    for (int i = 0; i < l->n; i++) {
        const double *x = l->place + 3 * (size_t)i, reach = REACH * (l->radius[i] + largest);
        const double min[3] = {x[0] - reach, x[1] - reach, x[2] - reach},
                     max[3] = {x[0] + reach, x[1] + reach, x[2] + reach};
        int n;
        while ((n = cn_tree_query_box(tree, min, max, room, found)) > room) {
            int *larger = realloc(found, (size_t)n * sizeof *found);
            if (!larger) goto done;
            found = larger, room = n;
        }
        qsort(found, (size_t)n, sizeof *found, ascending);
        for (int f = 0; f < n; f++) {
            const int j = found[f];
            if (j <= i) continue;
            const double sum = l->radius[i] + l->radius[j], apart = cn_distance(x, l->place + 3 * (size_t)j);
            if (!(apart < REACH * sum)) continue;
            if (!(apart > APART_MIN * sum)) {
                status =
                    cn_fail(error, CN_FAULT_OVERLAP, path, l->line[j],
                            "the molecule lies where that of line %d does: move or remove it", l->line[i]);
                goto done;
            }
            if (p->nlink >= most) {
                status = cn_fail(error, CN_FAULT_OVERLAP, path, l->line[i],
                                 "molecules overlap so far that each has more than %d neighbours within 1.5 "
                                 "times the sum of their radii: give smaller radii",
                                 2 * LINKS_MOST);
                goto done;
            }
            if (p->nlink == capacity) {
                int *link = realloc(p->link, (size_t)capacity * 4 * sizeof *link);
                if (!link) goto done;
                p->link = link, capacity *= 2;
            }
            p->link[2 * (size_t)p->nlink] = i, p->link[2 * (size_t)p->nlink + 1] = j;
            p->nlink++;
        }
    }
    status = CN_OK;
done:
    free(found);
    return status;
}

static cn_status all_joined(const cn_packing *p, const list *l, const char *path, cn_error *error)
{
    int *parent = malloc((size_t)p->n * sizeof *parent);
    cn_status status = CN_OK;
    if (!parent) return CN_ERR_MEMORY;
    for (int i = 0; i < p->n; i++)
        parent[i] = i;
    for (int b = 0; b < p->nlink; b++)
        cn_set_join(parent, p->link[2 * (size_t)b], p->link[2 * (size_t)b + 1]);
    for (int i = 1; i < p->n && status == CN_OK; i++)
        if (cn_set_find(parent, i) != cn_set_find(parent, 0))
            status = cn_fail(error, CN_FAULT_APART, path, l->line[i],
                             "no link joins the molecule to that of line %d: links reach 1.5 times the sum "
                             "of two radii; give larger radii or a body of its own",
                             l->line[0]);
    free(parent);
    return status;
}

cn_status cn_packing_read(cn_packing **out, const char *path, double radius, const cn_surface *surface,
                          double volume, cn_error *error)
{
    list l = {0};
    cn_scan scan = {0};
    cn_packing *p = NULL;
    cn_tree *tree = NULL, *walls = NULL;
    int *corner = NULL;
    double mean = 0;
    *out = NULL;
    if (!(radius > 0 && radius <= 1e300))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "the radius of molecules is %g m; it must be positive",
                       radius);
    cn_status status = cn_scan_open(&scan, path, error);
    if (status != CN_OK) return status;
    if ((status = read_list(&scan, &l, radius)) != CN_OK) goto done;
    if ((status = cn_packing_new(&p, l.n)) != CN_OK) goto done;
    memcpy(p->place, l.place, 3 * (size_t)l.n * sizeof *p->place);
    for (int i = 0; i < l.n; i++) {
        p->share[i] = 4 * acos(-1) / 3 * l.radius[i] * l.radius[i] * l.radius[i];
        mean += l.radius[i] / l.n;
    }
    p->spacing = 2 * mean;
    if ((status = cn_point_tree_new(&tree, &corner, p->n, p->place)) != CN_OK) goto done;
    if ((status = join(p, &l, tree, path, error)) != CN_OK) goto done;
    if ((status = all_joined(p, &l, path, error)) != CN_OK) goto done;
    if (surface && (status = cn_tree_new(&walls, surface->ntri, surface->tri, surface->vert)) == CN_OK)
        status = cn_packing_share(p, walls, volume, l.place, 0.25 * cbrt(volume / p->n), 0, NULL, NULL);
done:
    cn_scan_close(&scan);
    cn_tree_free(tree), cn_tree_free(walls);
    free(corner), free(l.place), free(l.radius), free(l.line);
    if (status == CN_OK)
        *out = p;
    else
        cn_packing_free(p);
    return status;
}
