/* Free cells: scan conversion by parity along rows of cells, for each wall on its own, then union and
 * difference. */
#include "map.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "geometry.h"

typedef struct {
    int row, cell, wall;
} crossing; /* cells >= cell lie on the other side */
typedef struct {
    int row, from, to;
} run; /* free cells [from, to) of a row */
typedef struct {
    int ncrossing, crossing_room, nrun, run_room;
    crossing *crossing;
    run *run;
    bool failed;
} slab; /* one layer of bricks; row = (z & 7) size y + y */

typedef struct {
    int wall;
    const double *corner[3];
} face;

typedef struct {
    cn_map *map;
    const cn_world *world;
    int nface, nslab;
    face *face;
    int *start, *item; /* faces that meet the rows of each slab */
    slab *slab;
} job;

/* Side of q on the directed line a b, with q moved by (e, e^2) for an infinitely small e: never on it. Both
 * triangles at an edge get the same answer up to sign, so no row slips between them. */
static int side(const double a[2], const double b[2], const double q[2], double *weight)
{
    const bool swapped = a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);
    const double *u = swapped ? b : a, *v = swapped ? a : b;
    const double left = (u[0] - q[0]) * (v[1] - q[1]), right = (u[1] - q[1]) * (v[0] - q[0]);
    const double det = left - right;
    int sign = det > 0 ? 1 : -1;
    if (!(fabs(det) > 1e-15 * (fabs(left) + fabs(right)))) {
        sign = cn_orient2d(u, v, q);
        if (!sign) sign = (u[1] > v[1]) - (u[1] < v[1]);
        if (!sign) sign = (v[0] > u[0]) - (v[0] < u[0]);
    }
    *weight = fabs(det);
    return swapped ? -sign : sign;
}

static bool add_crossing(slab *s, int row, int cell, int wall)
{
    if (s->ncrossing == s->crossing_room) {
        const int room = s->crossing_room ? 2 * s->crossing_room : 1024;
        crossing *more = realloc(s->crossing, (size_t)room * sizeof *more);
        if (!more) return false;
        s->crossing = more, s->crossing_room = room;
    }
    s->crossing[s->ncrossing++] = (crossing){row, cell, wall};
    return true;
}

static bool add_run(slab *s, int row, int from, int to)
{
    if (s->nrun == s->run_room) {
        const int room = s->run_room ? 2 * s->run_room : 1024;
        run *more = realloc(s->run, (size_t)room * sizeof *more);
        if (!more) return false;
        s->run = more, s->run_room = room;
    }
    s->run[s->nrun++] = (run){row, from, to};
    return true;
}

static int clamped(double v, int low, int high)
{
    return v > low ? v < high ? (int)v : high : low;
}

static void to_cells(const cn_map *map, const double v[3], double x[3])
{
    for (int k = 0; k < 3; k++)
        x[k] = (v[k] - map->origin[k]) / map->cell;
}

/* First and last row of cell centres within the face's range on one axis. */
static void rows_of(const double x[3][3], int axis, int count, int rows[2])
{
    const double low = fmin(fmin(x[0][axis], x[1][axis]), x[2][axis]);
    const double high = fmax(fmax(x[0][axis], x[1][axis]), x[2][axis]);
    rows[0] = clamped(ceil(low - 0.5), 0, count);
    rows[1] = clamped(floor(high - 0.5), -1, count - 1);
}

static bool scan_face(const job *j, slab *s, int islab, const face *f)
{
    const int *size = j->map->size;
    double x[3][3];
    int ys[2], zs[2];
    for (int k = 0; k < 3; k++)
        to_cells(j->map, f->corner[k], x[k]);
    rows_of(x, 1, size[1], ys), rows_of(x, 2, size[2], zs);
    if (zs[0] < 8 * islab) zs[0] = 8 * islab;
    if (zs[1] > 8 * islab + 7) zs[1] = 8 * islab + 7;
    for (int z = zs[0]; z <= zs[1]; z++)
        for (int y = ys[0]; y <= ys[1]; y++) {
            const double q[2] = {y + 0.5, z + 0.5};
            double w[3];
            const int first = side(x[1] + 1, x[2] + 1, q, w);
            if (!first || side(x[2] + 1, x[0] + 1, q, w + 1) != first ||
                side(x[0] + 1, x[1] + 1, q, w + 2) != first)
                continue;
            const double sum = w[0] + w[1] + w[2];
            const double at = sum > 0 ? (w[0] * x[0][0] + w[1] * x[1][0] + w[2] * x[2][0]) / sum : x[0][0];
            if (!add_crossing(s, (z & 7) * size[1] + y, clamped(ceil(at - 0.5), 0, size[0]), f->wall))
                return false;
        }
    return true;
}

/* Cells of the corridor beyond cap `icap`: beyond its plane, within its radius. */
static bool scan_corridor(const job *j, slab *s, int islab, int icap)
{
    const double *cap = j->map->cap[icap], radius = cap[6], depth = fmin(j->map->corridor, radius);
    const double reach = sqrt(radius * radius + depth * depth);
    const int *size = j->map->size, wall = j->world->nwall + icap;
    int low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = clamped(floor(cap[k] - reach), 0, size[k]);
        high[k] = clamped(ceil(cap[k] + reach), -1, size[k] - 1);
    }
    if (low[2] < 8 * islab) low[2] = 8 * islab;
    if (high[2] > 8 * islab + 7) high[2] = 8 * islab + 7;
    for (int z = low[2]; z <= high[2]; z++)
        for (int y = low[1]; y <= high[1]; y++) {
            bool was = false;
            for (int x = low[0]; x <= high[0] + 1; x++) {
                const double d[3] = {x + 0.5 - cap[0], y + 0.5 - cap[1], z + 0.5 - cap[2]};
                const double along = cn_dot(d, cap + 3), across = cn_norm2(d) - along * along;
                const bool in = x <= high[0] && along >= 0 && along <= depth && across <= radius * radius;
                if (in != was && !add_crossing(s, (z & 7) * size[1] + y, x, wall)) return false;
                was = in;
            }
        }
    return true;
}

/* Cells behind a plane: one end of each row. */
static bool scan_half_space(const job *j, slab *s, int islab, int iwall)
{
    const int *size = j->map->size;
    const double *normal = j->world->wall[iwall].plane + 3;
    double at[3];
    to_cells(j->map, j->world->wall[iwall].plane, at);
    for (int row = 0; row < 8 * size[1]; row++) {
        const double y = row % size[1] + 0.5, z = 8 * islab + row / size[1] + 0.5;
        const double rest = (y - at[1]) * normal[1] + (z - at[2]) * normal[2];
        const double turn = ceil(at[0] - rest / normal[0] - 0.5); /* first cell centre past the plane */
        int from = 0, to = normal[0] > 0 ? clamped(turn, 0, size[0]) : size[0];
        if (normal[0] < 0) from = clamped(turn, 0, size[0]);
        if (normal[0] == 0 && rest > 0) continue;
        if (from < to && !(add_crossing(s, row, from, iwall) && add_crossing(s, row, to, iwall)))
            return false;
    }
    return true;
}

static int by_place(const void *left, const void *right)
{
    const crossing *a = left, *b = right;
    if (a->row != b->row) return a->row < b->row ? -1 : 1;
    if (a->cell != b->cell) return a->cell < b->cell ? -1 : 1;
    return (a->wall > b->wall) - (a->wall < b->wall);
}

/* Free runs of one row from its sorted crossings. A wall that does not close along the row counts for
 * nothing. */
static bool sweep_row(const job *j, slab *s, int row, const crossing *c, int n, int *parity, int *total)
{
    const cn_world *world = j->world;
    const int nx = j->map->size[0];
    int vessels = 0, obstacles = 0, from = world->nvessel ? -1 : 0;

    for (int i = 0; i < n; i++)
        parity[c[i].wall] = total[c[i].wall] = 0;
    for (int i = 0; i < n; i++)
        total[c[i].wall]++;
    for (int i = 0; i < n; i++) {
        const int wall = c[i].wall, now = parity[wall] ^= 1;
        if (total[wall] & 1) continue;
        if (wall < world->nvessel || wall >= world->nwall)
            vessels += now ? 1 : -1;
        else
            obstacles += now ? 1 : -1;
        if (i + 1 < n && c[i + 1].cell == c[i].cell) continue; /* after the last change at this cell */
        const bool in = (world->nvessel == 0 || vessels) && !obstacles;
        if (in && from < 0) from = c[i].cell;
        if (!in && from >= 0) {
            if (c[i].cell > from && !add_run(s, row, from, c[i].cell)) return false;
            from = -1;
        }
    }
    return from < 0 || from >= nx || add_run(s, row, from, nx);
}

static void scan_slab(void *user, int islab)
{
    const job *j = user;
    slab *s = j->slab + islab;
    const int nwall = j->world->nwall + j->map->ncap, rows = 8 * j->map->size[1];
    int *parity = calloc(2 * (size_t)nwall + 2, sizeof *parity);
    s->failed = true;
    if (!parity) return;
    for (int i = j->start[islab]; i < j->start[islab + 1]; i++)
        if (!scan_face(j, s, islab, j->face + j->item[i])) goto done;
    for (int i = 0; i < j->map->ncap; i++)
        if (!scan_corridor(j, s, islab, i)) goto done;
    for (int i = 0; i < j->world->nwall; i++)
        if (j->world->wall[i].half_space && !cn_wall_moves(&j->world->wall[i]) &&
            !scan_half_space(j, s, islab, i))
            goto done;
    if (s->ncrossing) qsort(s->crossing, (size_t)s->ncrossing, sizeof *s->crossing, by_place);
    for (int i = 0, row = 0; row < rows; row++) {
        int end = i;
        while (end < s->ncrossing && s->crossing[end].row == row)
            end++;
        if ((end > i || !j->world->nvessel) &&
            !sweep_row(j, s, row, s->crossing + i, end - i, parity, parity + nwall))
            goto done;
        i = end;
    }
    s->failed = false;
done:
    free(parity), free(s->crossing);
    s->crossing = NULL;
}

static void set_cells(void *user, int islab)
{
    const job *j = user;
    const slab *s = j->slab + islab;
    cn_map_level *level = j->map->level;
    for (int i = 0; i < s->nrun; i++) {
        const run *r = s->run + i;
        const int y = r->row % j->map->size[1], z = r->row / j->map->size[1];
        for (int x = r->from; x < r->to; x = (x | 7) + 1) {
            const int place[3] = {(x >> 3) + 1, (y >> 3) + 1, islab + 1};
            const int end = r->to < (x | 7) + 1 ? r->to : (x | 7) + 1;
            const uint64_t bits = ((1u << (end - x)) - 1u) << (x & 7);
            level->mask[8 * (int64_t)cn_map_brick_at(level, place) + z] |= bits << 8 * (y & 7);
        }
    }
}

/* Bricks of a run and of the cells next to it. */
static void mark_bricks(const job *j, const run *r, int islab)
{
    cn_map_level *level = j->map->level;
    const int y = r->row % j->map->size[1], z = 8 * islab + r->row / j->map->size[1];
    for (int pz = ((z - 1) >> 3) + 1; pz <= ((z + 1) >> 3) + 1; pz++)
        for (int py = ((y - 1) >> 3) + 1; py <= ((y + 1) >> 3) + 1; py++) {
            const int64_t row = ((int64_t)pz * level->size[1] + py) * level->size[0];
            for (int px = ((r->from - 1) >> 3) + 1; px <= (r->to >> 3) + 1; px++)
                level->brick[row + px] = 0;
        }
}

/* The faces that close a wall, and which slabs' rows they may meet. */
static cn_status list_faces(job *j)
{
    const cn_world *world = j->world;
    size_t room = 0;
    for (int w = 0; w < world->nwall; w++) {
        room += (size_t)world->wall[w].surface->ntri +
                (world->wall[w].caps ? (size_t)world->wall[w].caps->ntri : 0);
        j->map->ncap += world->wall[w].ncap;
    }
    j->face = malloc((room + 1) * sizeof *j->face);
    j->map->cap = malloc(((size_t)j->map->ncap + 1) * sizeof *j->map->cap);
    j->start = calloc((size_t)j->nslab + 2, sizeof *j->start);
    if (!j->face || !j->map->cap || !j->start) return CN_ERR_MEMORY;
    for (int w = 0, icap = 0; w < world->nwall; w++) {
        const cn_wall *wall = world->wall + w;
        const cn_surface *part[2] = {wall->surface, wall->caps};
        if ((!wall->vessel && !wall->closed) || cn_wall_moves(wall)) continue;
        for (int p = 0; p < 2 && part[p]; p++)
            for (int t = 0; t < part[p]->ntri; t++) {
                face *f = j->face + j->nface++;
                f->wall = w;
                for (int k = 0; k < 3; k++)
                    f->corner[k] = part[p]->vert + 3 * (size_t)part[p]->tri[3 * t + k];
            }
        for (int i = 0; i < wall->ncap; i++, icap++) {
            memcpy(j->map->cap[icap], wall->cap[i], sizeof *j->map->cap);
            to_cells(j->map, wall->cap[i], j->map->cap[icap]);
            j->map->cap[icap][6] = wall->cap[i][6] / j->map->cell;
        }
    }
    for (int pass = 0; pass < 2; pass++) { /* count, then list */
        for (int i = 0; i < j->nface; i++) {
            double x[3][3];
            int rows[2];
            for (int k = 0; k < 3; k++)
                to_cells(j->map, j->face[i].corner[k], x[k]);
            rows_of(x, 2, j->map->size[2], rows);
            for (int s = rows[0] >> 3; s <= rows[1] >> 3 && rows[0] <= rows[1]; s++) {
                if (pass)
                    j->item[j->start[s + 1]++] = i;
                else
                    j->start[s + 2]++;
            }
        }
        if (pass) break;
        for (int s = 2; s <= j->nslab + 1; s++)
            j->start[s] += j->start[s - 1];
        if (!(j->item = malloc(((size_t)j->start[j->nslab + 1] + 1) * sizeof *j->item))) return CN_ERR_MEMORY;
    }
    return CN_OK;
}

cn_status cn_map_fill(cn_map *map, const cn_world *world, cn_pool *pool)
{
    job j = {.map = map, .world = world, .nslab = map->size[2] / 8};
    cn_status status = CN_ERR_MEMORY;
    if (!(j.slab = calloc((size_t)j.nslab, sizeof *j.slab))) return status;
    if ((status = list_faces(&j)) != CN_OK) goto done;
    cn_pool_run(pool, j.nslab, scan_slab, &j);

    status = CN_ERR_MEMORY;
    for (int s = 0; s < j.nslab; s++)
        if (j.slab[s].failed) goto done;
    if ((status = cn_map_level_new(map->level, map->size)) != CN_OK) goto done;
    map->nlevel = 1;
    for (int s = 0; s < j.nslab; s++)
        for (int i = 0; i < j.slab[s].nrun; i++) {
            mark_bricks(&j, j.slab[s].run + i, s);
            map->nfree += j.slab[s].run[i].to - j.slab[s].run[i].from;
        }
    if ((status = cn_map_level_number(map->level)) != CN_OK) goto done;
    cn_pool_run(pool, j.nslab, set_cells, &j);
done:
    for (int s = 0; s < j.nslab; s++)
        free(j.slab[s].crossing), free(j.slab[s].run);
    free(j.slab), free(j.face), free(j.start), free(j.item);
    return status;
}
