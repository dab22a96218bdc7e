#include "map.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

void cn_map_free(cn_map *map)
{
    if (!map) return;
    for (int l = 0; l < CN_MAP_LEVELS; l++) {
        cn_map_level *level = map->level + l;
        free(level->brick), free(level->place), free(level->value), free(level->mask);
    }
    for (int k = 0; k < map->nfill; k++)
        free(map->fill[k]);
    free(map->cap), free(map->ridge_x), free(map->ridge_clearance), free(map);
}

/* All triangles in cells. */
static cn_status walls_new(cn_map_walls *walls, const cn_map *map, const cn_world *world)
{
    size_t room = 0;
    for (int w = 0; w < world->nwall; w++)
        room += (size_t)world->wall[w].surface->ntri;
    if (!(walls->tri = malloc((room + 1) * sizeof *walls->tri))) return CN_ERR_MEMORY;
    for (int w = 0; w < world->nwall; w++) {
        const cn_surface *surface = world->wall[w].surface;
        if (cn_wall_moves(&world->wall[w])) continue;
        for (int t = 0; t < surface->ntri; t++) {
            double *tri = walls->tri[walls->ntri++];
            for (int c = 0; c < 3; c++)
                for (int k = 0; k < 3; k++) {
                    const double v = surface->vert[3 * (size_t)surface->tri[3 * t + c] + k];
                    tri[3 * c + k] = (v - map->origin[k]) / map->cell;
                }
            for (int k = 0; k < 3; k++)
                walls->extent =
                    fmax(walls->extent, fmax(fmax(fabs(tri[k] - tri[3 + k]), fabs(tri[k] - tri[6 + k])),
                                             fabs(tri[3 + k] - tri[6 + k])));
        }
    }
    return CN_OK;
}

cn_status cn_map_new(cn_map **out, const cn_world *world, const double min[3], const double max[3],
                     double cell, double corridor, cn_pool *pool)
{
    cn_map *map = calloc(1, sizeof *map);
    cn_map_walls walls = {0};
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!map) return status;
    map->cell = cell;
    map->corridor = corridor / cell;
    for (int k = 0; k < 3; k++) {
        map->size[k] = 8 * (int)ceil((max[k] - min[k]) / cell / 8);
        if (map->size[k] < 8) map->size[k] = 8;
        map->origin[k] = 0.5 * (min[k] + max[k]) - 0.5 * cell * map->size[k];
    }
    if ((status = walls_new(&walls, map, world)) != CN_OK) goto done;
    map->bare = walls.ntri == 0;
    if ((status = cn_map_fill(map, world, pool)) != CN_OK) goto done;
    if ((status = cn_map_measure(map, &walls, pool)) != CN_OK) goto done;
    if ((status = cn_map_find_fill(map)) != CN_OK) goto done;
    status = cn_map_find_ridge(map, world, pool);
done:
    free(walls.tri);
    if (status == CN_OK)
        *out = map;
    else
        cn_map_free(map);
    return status;
}

double cn_map_lower(const cn_map *map, const double x[3], bool *certain)
{
    double best = 0;
    if (certain) *certain = false;
    for (int k = 0; k < 3; k++)
        if (!(x[k] >= 0 && x[k] <= map->size[k])) return 0;
    for (int l = 0; l < map->nlevel; l++) {
        const cn_map_level *level = map->level + l;
        const double spacing = 1 << l;
        double t[3], sum = 0, spread = 0;
        int i[3], brick, offset;
        bool whole = true;
        for (int k = 0; k < 3; k++) {
            const double f = x[k] / spacing - 0.5;
            i[k] = (int)floor(f), t[k] = f - i[k];
            spread += t[k] * (1 - t[k]);
        }
        for (int c = 0; c < 8; c++) {
            const int s[3] = {i[0] + (c & 1), i[1] + (c >> 1 & 1), i[2] + (c >> 2)};
            if (!cn_map_find(level, s, &brick, &offset)) {
                whole = false;
                continue;
            }
            const uint8_t code = level->value[(int64_t)brick * CN_MAP_CELLS + offset];
            const double value = code == CN_MAP_FAR ? CN_MAP_BAND : code * CN_MAP_QUANTUM;
            double weight = 1, away = 0;
            for (int k = 0; k < 3; k++) {
                const double d = c >> k & 1 ? 1 - t[k] : t[k];
                weight *= 1 - d, away += d * d;
            }
            const double left = value - sqrt(away); /* no wall within this of x */
            if (left * spacing > best) best = left * spacing;
            if (certain && l == 0 && left > 0 && cn_map_bit(level->mask, brick, offset)) *certain = true;
            whole = whole && code != CN_MAP_FAR;
            sum += weight * value * value;
        }
        if (whole) { /* the concave bound between the samples */
            const double between = sum > spread ? spacing * sqrt(sum - spread) : 0;
            return between > best ? between : best;
        }
    }
    return best;
}

/* True when x [cells] lies beside a corridor, less than a cell away: no wall parts it from the free space. */
static bool beside_corridor(const cn_map *map, const double x[3])
{
    for (int i = 0; i < map->ncap; i++) {
        const double *cap = map->cap[i], wide = cap[6] + 1;
        double d[3];
        cn_sub(x, cap, d);
        const double along = cn_dot(d, cap + 3), across = cn_norm2(d) - along * along;
        if (along >= 0 && along <= fmin(map->corridor, cap[6]) + 1 && across >= cap[6] * cap[6] &&
            across <= wide * wide)
            return true;
    }
    return false;
}

double cn_map_cell(const cn_map *map)
{
    return map->cell;
}

double cn_map_clearance(const cn_map *map, const double p[3])
{
    double x[3];
    int i[3];
    bool certain;
    for (int k = 0; k < 3; k++) {
        x[k] = (p[k] - map->origin[k]) / map->cell;
        if (!(x[k] >= 0 && x[k] <= map->size[k])) return 0;
        i[k] = (int)x[k];
    }
    if (!cn_map_free_cell(map, i) || beside_corridor(map, x)) return 0;
    const double clearance = map->cell * cn_map_lower(map, x, &certain);
    return !certain ? 0 : map->bare ? INFINITY : clearance;
}

int cn_map_ridge(const cn_map *map, const double **x, const double **clearance)
{
    *x = map->ridge_x, *clearance = map->ridge_clearance;
    return map->nridge;
}

void cn_map_frame(const cn_map *map, double origin[3], int size[3])
{
    memcpy(origin, map->origin, sizeof map->origin);
    memcpy(size, map->size, sizeof map->size);
}

/* How full the cubes of 8, 16, 32 ... cells a side are, up to one that holds all. */
cn_status cn_map_find_fill(cn_map *map)
{
    int size[3] = {map->size[0] / 8, map->size[1] / 8, map->size[2] / 8};
    for (int k = 0;; k++) {
        uint8_t *fill = calloc((size_t)size[0] * size[1] * size[2], 1);
        if (!fill) return CN_ERR_MEMORY;
        map->fill[k] = fill, map->nfill = k + 1;
        memcpy(map->fill_size[k], size, sizeof size);
        const int *below = k ? map->fill_size[k - 1] : NULL;
        int64_t i = 0;
        int p[3];
        for (p[2] = 0; p[2] < size[2]; p[2]++)
            for (p[1] = 0; p[1] < size[1]; p[1]++)
                for (p[0] = 0; p[0] < size[0]; p[0]++, i++) {
                    int some = 0, all = 0;
                    if (k == 0) {
                        const int brick = cn_map_brick_at(map->level, (int[3]){p[0] + 1, p[1] + 1, p[2] + 1});
                        for (int w = 0; w < 8 && brick >= 0; w++) {
                            const uint64_t bits = map->level->mask[8 * (int64_t)brick + w];
                            some |= bits != 0, all += bits == ~0ull;
                        }
                    } else {
                        for (int c = 0; c < 8; c++) {
                            const int q[3] = {2 * p[0] + (c & 1), 2 * p[1] + (c >> 1 & 1),
                                              2 * p[2] + (c >> 2)};
                            if (q[0] >= below[0] || q[1] >= below[1] || q[2] >= below[2]) continue;
                            const uint8_t f =
                                map->fill[k - 1][((int64_t)q[2] * below[1] + q[1]) * below[0] + q[0]];
                            some |= f != 0, all += f == 2;
                        }
                    }
                    fill[i] = all == 8 ? 2 : some ? 1 : 0;
                }
        if (size[0] == 1 && size[1] == 1 && size[2] == 1) return CN_OK;
        for (int d = 0; d < 3; d++)
            size[d] = (size[d] + 1) / 2;
    }
}

/* A cube of `side` cells within a brick, at (x, y, z) of it. */
static void visit_cells(const uint64_t *mask, const int at[3], int x, int y, int z, int level,
                        cn_map_visit visit, void *user)
{
    const int side = 1 << level;
    uint64_t rows = 0, all = ~0ull, any = 0;
    for (int r = 0; r < side; r++)
        rows |= (uint64_t)((1u << side) - 1u) << 8 * r;
    rows <<= 8 * y + x;
    for (int w = z; w < z + side; w++)
        all &= mask[w], any |= mask[w] & rows;
    if (!any) return;
    if ((all & rows) == rows) {
        visit(user, (int[3]){at[0] + x, at[1] + y, at[2] + z}, level);
        return;
    }
    const int half = side / 2;
    for (int c = 0; c < 8; c++)
        visit_cells(mask, at, x + half * (c & 1), y + half * (c >> 1 & 1), z + half * (c >> 2), level - 1,
                    visit, user);
}

static void visit_cube(const cn_map *map, int k, const int p[3], cn_map_visit visit, void *user)
{
    const int *size = map->fill_size[k];
    if (p[0] >= size[0] || p[1] >= size[1] || p[2] >= size[2]) return;
    const uint8_t fill = map->fill[k][((int64_t)p[2] * size[1] + p[1]) * size[0] + p[0]];
    const int at[3] = {p[0] * (8 << k), p[1] * (8 << k), p[2] * (8 << k)};
    if (!fill) return;
    if (fill == 2) {
        visit(user, at, 3 + k);
        return;
    }
    if (k == 0) {
        const int brick = cn_map_brick_at(map->level, (int[3]){p[0] + 1, p[1] + 1, p[2] + 1});
        for (int c = 0; c < 8; c++)
            visit_cells(map->level->mask + 8 * (int64_t)brick, at, 4 * (c & 1), 4 * (c >> 1 & 1),
                        4 * (c >> 2), 2, visit, user);
        return;
    }
    for (int c = 0; c < 8; c++)
        visit_cube(map, k - 1, (int[3]){2 * p[0] + (c & 1), 2 * p[1] + (c >> 1 & 1), 2 * p[2] + (c >> 2)},
                   visit, user);
}

void cn_map_visit_cubes(const cn_map *map, cn_map_visit visit, void *user)
{
    visit_cube(map, map->nfill - 1, (int[3]){0, 0, 0}, visit, user);
}
