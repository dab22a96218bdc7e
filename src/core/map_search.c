/* The widest route through the free cells: cells are taken in the order of their distance to the wall, the
 * widest first, so that the least distance met so far is the best bottleneck (Dijkstra with buckets). */
#include "map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

typedef struct {
    int n[256], room[256];
    uint32_t *cell[256]; /* brick * 512 + offset */
} buckets;

static bool push(buckets *b, int code, uint32_t cell)
{
    if (b->n[code] == b->room[code]) {
        const int room = b->room[code] ? 2 * b->room[code] : 256;
        uint32_t *more = realloc(b->cell[code], (size_t)room * sizeof *more);
        if (!more) return false;
        b->cell[code] = more, b->room[code] = room;
    }
    b->cell[code][b->n[code]++] = cell;
    return true;
}

/* The free cell nearest to p within a few cells, -1 if none. */
static int64_t free_cell_near(const cn_map *map, const double p[3])
{
    enum { REACH = 3 };
    double x[3], best = INFINITY;
    int64_t found = -1;
    int i[3], d[3], brick, offset;
    for (int k = 0; k < 3; k++) {
        x[k] = (p[k] - map->origin[k]) / map->cell;
        if (!(x[k] >= -REACH && x[k] <= map->size[k] + REACH)) return -1;
    }
    for (d[2] = -REACH; d[2] <= REACH; d[2]++)
        for (d[1] = -REACH; d[1] <= REACH; d[1]++)
            for (d[0] = -REACH; d[0] <= REACH; d[0]++) {
                double away = 0;
                for (int k = 0; k < 3; k++) {
                    i[k] = (int)floor(x[k]) + d[k];
                    away += (i[k] + 0.5 - x[k]) * (i[k] + 0.5 - x[k]);
                }
                if (away >= best || !cn_map_find(map->level, i, &brick, &offset)) continue;
                if (!cn_map_bit(map->level->mask, brick, offset)) continue;
                best = away, found = (int64_t)brick * CN_MAP_CELLS + offset;
            }
    return found;
}

static void cell_centre(const cn_map *map, uint32_t cell, double x[3]) /* [m] */
{
    const int *place = map->level->place[cell / CN_MAP_CELLS], o = cell % CN_MAP_CELLS;
    const int i[3] = {8 * (place[0] - 1) + (o & 7), 8 * (place[1] - 1) + (o >> 3 & 7),
                      8 * (place[2] - 1) + (o >> 6)};
    for (int k = 0; k < 3; k++)
        x[k] = map->origin[k] + (i[k] + 0.5) * map->cell;
}

/* The cell across face f (x- x+ y- y+ z- z+), -1 where there is no brick. */
static int64_t across(const cn_map_level *level, uint32_t cell, int f)
{
    const int from = (int)(cell / CN_MAP_CELLS), o = cell % CN_MAP_CELLS;
    const int shift = 3 * (f >> 1), at = o >> shift & 7, to = f & 1 ? at + 1 : at - 1;
    int brick = from;
    if (to & 8) {
        int place[3] = {level->place[from][0], level->place[from][1], level->place[from][2]};
        place[f >> 1] += f & 1 ? 1 : -1;
        if ((brick = cn_map_brick_at(level, place)) < 0) return -1;
    }
    return (int64_t)brick * CN_MAP_CELLS + ((o & ~(7 << shift)) | (to & 7) << shift);
}

/* Puts the free neighbours that were not seen before into their buckets; `by` keeps the face they were met
 * through, plus one. */
static bool spread(const cn_map *map, uint8_t *by, buckets *b, uint32_t cell, int *top)
{
    const cn_map_level *level = map->level;
    for (int f = 0; f < 6; f++) {
        const int64_t to = across(level, cell, f);
        if (to < 0 || by[to] || !(level->mask[to >> 6] >> (to & 63) & 1)) continue;
        by[to] = (uint8_t)(f + 1);
        if (level->value[to] > *top) *top = level->value[to];
        if (!push(b, level->value[to], (uint32_t)to)) return false;
    }
    return true;
}

/* The narrowest cell on the way back from the goal to the start. */
static uint32_t narrowest(const cn_map_level *level, const uint8_t *by, uint32_t start, uint32_t goal)
{
    uint32_t found = goal;
    for (uint32_t cell = goal; cell != start; cell = (uint32_t)across(level, cell, (by[cell] - 1) ^ 1))
        if (level->value[cell] < level->value[found]) found = cell;
    return level->value[start] < level->value[found] ? start : found;
}

/* Where the reached part comes nearest to p. */
static void end_nearest(const cn_map *map, const uint8_t *by, const double p[3], double where[3])
{
    double best = INFINITY, x[3];
    for (int64_t cell = 0; cell < (int64_t)map->level->nbrick * CN_MAP_CELLS; cell++) {
        if (!by[cell]) continue;
        cell_centre(map, (uint32_t)cell, x);
        if (cn_distance(x, p) < best) best = cn_distance(x, p), cn_copy3(x, where);
    }
}

double cn_map_pinch(const cn_map *map, const double a[3], const double b[3], double where[3])
{
    const int64_t start = free_cell_near(map, a), goal = free_cell_near(map, b);
    double radius = 0, x[3];
    cn_copy3(a, where);
    if (start < 0) return 0;
    buckets *queue = calloc(1, sizeof *queue);
    uint8_t *by = calloc((size_t)map->level->nbrick, CN_MAP_CELLS);
    if (!queue || !by) goto done;

    int top = map->level->value[start];
    by[start] = 7;
    if (!push(queue, top, (uint32_t)start)) goto done;
    while (top >= 0) {
        if (!queue->n[top]) {
            top--;
            continue;
        }
        const uint32_t cell = queue->cell[top][--queue->n[top]];
        if ((int64_t)cell == goal) {
            cell_centre(map, narrowest(map->level, by, (uint32_t)start, cell), where);
            for (int k = 0; k < 3; k++)
                x[k] = (where[k] - map->origin[k]) / map->cell;
            radius = map->bare ? INFINITY : map->cell * cn_map_lower(map, x, NULL);
            goto done;
        }
        if (!spread(map, by, queue, cell, &top)) goto done;
    }
    end_nearest(map, by, b, where);
done:
    for (int k = 0; queue && k < 256; k++)
        free(queue->cell[k]);
    free(queue), free(by);
    return radius;
}
