/* The pyramid of distances: at each level every brick takes the least distance of its samples to the
 * triangles of its own and the neighbouring bricks, eight samples at a time. */
#include "map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 8, ROWS = CN_MAP_CELLS / LANES }; /* the samples of a row, along x */
#pragma GCC diagnostic ignored "-Wpsabi"         /* vectors are returned by inlined functions only */
typedef float lanes __attribute__((vector_size(4 * LANES)));
typedef int flags __attribute__((vector_size(4 * LANES)));
typedef long long halves __attribute__((vector_size(4 * LANES)));
#define PICK(mask, yes, no) ((lanes)(((mask) & (flags)(yes)) | (~(mask) & (flags)(no))))
#define LEAST(a, b)         ((a) < (b) ? (a) : (b))
#define MOST(a, b)          ((a) > (b) ? (a) : (b))
#define LANE_BY_LANE        static inline __attribute__((always_inline))

/* Written so that compilers see the one instruction that does it. */
LANE_BY_LANE lanes each_least(lanes a, lanes b)
{
    lanes c;
    for (int i = 0; i < LANES; i++)
        c[i] = LEAST(a[i], b[i]);
    return c;
}
LANE_BY_LANE lanes each_most(lanes a, lanes b)
{
    lanes c;
    for (int i = 0; i < LANES; i++)
        c[i] = MOST(a[i], b[i]);
    return c;
}
LANE_BY_LANE uint64_t any_lane(flags f)
{
    const halves h = (halves)f;
    return (uint64_t)((h[0] | h[1]) | (h[2] | h[3]));
}

enum { CHUNK = 32 }; /* bricks a task */

cn_status cn_map_level_new(cn_map_level *level, const int size[3])
{
    int64_t count = 1;
    for (int k = 0; k < 3; k++)
        count *= level->size[k] = (size[k] + 7) / 8 + 2;
    if (!(level->brick = malloc((size_t)count * sizeof *level->brick))) return CN_ERR_MEMORY;
    for (int64_t i = 0; i < count; i++)
        level->brick[i] = -1;
    return CN_OK;
}

cn_status cn_map_level_number(cn_map_level *level)
{
    const int64_t count = (int64_t)level->size[0] * level->size[1] * level->size[2];
    int n = 0;
    for (int64_t i = 0; i < count; i++)
        if (level->brick[i] >= 0) level->brick[i] = n++;
    level->nbrick = n;
    level->place = malloc(((size_t)n + 1) * sizeof *level->place);
    level->value = malloc(((size_t)n + 1) * CN_MAP_CELLS);
    level->mask = calloc((size_t)n + 1, 8 * sizeof *level->mask);
    if (!level->place || !level->value || !level->mask) return CN_ERR_MEMORY;
    for (int64_t i = 0; i < count; i++)
        if (level->brick[i] >= 0) {
            int *place = level->place[level->brick[i]];
            place[0] = (int)(i % level->size[0]);
            place[1] = (int)(i / level->size[0] % level->size[1]);
            place[2] = (int)(i / level->size[0] / level->size[1]);
        }
    return CN_OK;
}

typedef struct {
    cn_map_level *level;
    const cn_map_walls *walls;
    double scale;     /* samples per cell: 1 / 2^level */
    float margin;     /* rounding of the float distances [samples] */
    float (*box)[6];  /* of each triangle: low, high [samples] */
    int (*low)[3];    /* the first place that each box meets */
    uint64_t *beyond; /* per brick, 2 x 2 x 2 samples a bit: some that counts lies beyond the band */
    int *start;       /* triangles that meet each place, by place */
    int *item;
    bool *failed; /* per task */
} job;

/* Places that a triangle's box meets, clamped to those there are. */
static void box_places(const job *j, const float box[6], int low[3], int high[3])
{
    for (int k = 0; k < 3; k++) {
        const int last = j->level->size[k] - 1;
        low[k] = box[k] <= 0 ? 0 : (int)(box[k] / 8) + 1;
        high[k] = box[3 + k] <= 0 ? 0 : (int)(box[3 + k] / 8) + 1;
        low[k] = LEAST(low[k], last), high[k] = LEAST(high[k], last);
    }
}

static cn_status sort_triangles(job *j)
{
    const cn_map_level *level = j->level;
    const int64_t count = (int64_t)level->size[0] * level->size[1] * level->size[2];
    int low[3], high[3];
    j->start = calloc((size_t)count + 2, sizeof *j->start);
    j->box = malloc(((size_t)j->walls->ntri + 1) * sizeof *j->box);
    j->low = malloc(((size_t)j->walls->ntri + 1) * sizeof *j->low);
    if (!j->start || !j->box || !j->low) return CN_ERR_MEMORY;
    for (int t = 0; t < j->walls->ntri; t++)
        for (int k = 0; k < 3; k++) {
            const double *v = j->walls->tri[t] + k;
            const double most = MOST(MOST(v[0], v[3]), v[6]), least = LEAST(LEAST(v[0], v[3]), v[6]);
            j->box[t][k] = (float)(least * j->scale) - j->margin;
            j->box[t][3 + k] = (float)(most * j->scale) + j->margin;
        }
    for (int pass = 0; pass < 2; pass++) {
        for (int t = 0; t < j->walls->ntri; t++) {
            box_places(j, j->box[t], low, high);
            memcpy(j->low[t], low, sizeof low);
            for (int z = low[2]; z <= high[2]; z++)
                for (int y = low[1]; y <= high[1]; y++)
                    for (int x = low[0]; x <= high[0]; x++) {
                        const int64_t place = ((int64_t)z * level->size[1] + y) * level->size[0] + x;
                        if (pass)
                            j->item[j->start[place + 1]++] = t;
                        else
                            j->start[place + 2]++;
                    }
        }
        if (pass) break;
        for (int64_t i = 2; i <= count + 1; i++)
            j->start[i] += j->start[i - 1];
        if (!(j->item = malloc(((size_t)j->start[count + 1] + 1) * sizeof *j->item))) return CN_ERR_MEMORY;
    }
    return CN_OK;
}

typedef struct {
    lanes best[ROWS]; /* squared distances of the rows' samples [samples^2] */
    float most[ROWS]; /* a bound on each row's largest */
} rows;

#ifdef __SANITIZE_THREAD__
#define CLONES /* the loader picks clones before that sanitizer is awake */
#else
#define CLONES __attribute__((target_clones("default", "avx2", "arch=x86-64-v4")))
#endif

/* The larger of each two lanes of a, then of b. */
LANE_BY_LANE lanes pairs(lanes a, lanes b)
{
    return each_most(__builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14),
                     __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15));
}

/* Tightens the rows' bounds; returns the largest. */
CLONES static float largest(rows *field)
{
    lanes all = {0};
    float most = 0;
    for (int r = 0; r < ROWS; r += LANES) {
        const lanes *f = field->best + r;
        const lanes four[2] = {pairs(pairs(f[0], f[1]), pairs(f[2], f[3])),
                               pairs(pairs(f[4], f[5]), pairs(f[6], f[7]))};
        const lanes eight = pairs(four[0], four[1]);
        memcpy(field->most + r, &eight, sizeof eight);
        all = each_most(all, eight);
    }
    for (int i = 0; i < LANES; i++)
        most = MOST(all[i], most);
    return most;
}

/* A triangle, in samples from the brick's. */
typedef struct {
    float corner[3][3], along[3][3]; /* the edge from each corner ... */
    float over[3], in[3][3];         /* ... 1 / its length squared, its normal in the plane, inward */
    float normal[3], low[3], high[3];
    bool flat; /* nothing is inside a triangle without area */
} facet;

CLONES static void facet_new(facet *f, const double v[3][3])
{
    double n[3], e[3][3];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            e[k][i] = v[(k + 1) % 3][i] - v[k][i];
    n[0] = e[0][1] * e[1][2] - e[0][2] * e[1][1];
    n[1] = e[0][2] * e[1][0] - e[0][0] * e[1][2];
    n[2] = e[0][0] * e[1][1] - e[0][1] * e[1][0];
    const double area2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2], inverse = area2 > 0 ? 1 / sqrt(area2) : 0;
    for (int i = 0; i < 3; i++)
        n[i] *= inverse;
    for (int k = 0; k < 3; k++) {
        const double length2 = e[k][0] * e[k][0] + e[k][1] * e[k][1] + e[k][2] * e[k][2];
        f->over[k] = length2 > 0 ? (float)(1 / length2) : 0;
        f->in[k][0] = (float)(n[1] * e[k][2] - n[2] * e[k][1]);
        f->in[k][1] = (float)(n[2] * e[k][0] - n[0] * e[k][2]);
        f->in[k][2] = (float)(n[0] * e[k][1] - n[1] * e[k][0]);
        for (int i = 0; i < 3; i++)
            f->corner[k][i] = (float)v[k][i], f->along[k][i] = (float)e[k][i];
        f->low[k] = (float)LEAST(LEAST(v[0][k], v[1][k]), v[2][k]);
        f->high[k] = (float)MOST(MOST(v[0][k], v[1][k]), v[2][k]);
        f->normal[k] = (float)n[k];
    }
    f->flat = !(area2 > 0);
}

#define EACH_EDGE(k) _Pragma("GCC unroll 3") for (int k = 0; k < 3; k++)

/* Lanes of a row that lie inside the triangle, seen along its normal. */
LANE_BY_LANE flags inside_facet(const facet *f, lanes x, float y, float z)
{
    const lanes zero = {0};
    flags inside = zero == zero + (f->flat ? 1.0f : 0.0f);
    EACH_EDGE(k)
    {
        const float wy = y - f->corner[k][1], wz = z - f->corner[k][2];
        inside &= (x - f->corner[k][0]) * f->in[k][0] + (wy * f->in[k][1] + wz * f->in[k][2]) >= zero;
    }
    return inside;
}

/* Squared distances to its edges, at most `most`. */
LANE_BY_LANE lanes nearest_edge(const facet *f, lanes x, float y, float z, lanes most)
{
    const lanes zero = {0}, one = zero + 1;
    EACH_EDGE(k)
    {
        const float *along = f->along[k], wy = y - f->corner[k][1], wz = z - f->corner[k][2];
        const lanes wx = x - f->corner[k][0];
        const lanes foot = (wx * along[0] + (wy * along[1] + wz * along[2])) * f->over[k];
        const lanes t = each_least(each_most(foot, zero), one);
        const lanes dx = wx - t * along[0], dy = wy - t * along[1], dz = wz - t * along[2];
        most = each_least(dx * dx + dy * dy + dz * dz, most);
    }
    return most;
}

/* Lowers the distances of a brick's samples to those of one triangle. Most samples are nearer to another one
 * already, by its box or its plane: SLACK keeps those that rounding leaves in doubt. */
#define SLACK 1e-3f
CLONES static void splat(rows *restrict field, const facet *restrict f)
{
    const lanes zero = {0}, at = {0.5f, 1.5f, 2.5f, 3.5f, 4.5f, 5.5f, 6.5f, 7.5f}; /* on each axis */
    const flags bit = {1, 2, 4, 8, 16, 32, 64, 128};
    lanes out[3]; /* of the box, squared */
    for (int k = 0; k < 3; k++) {
        out[k] = each_most(each_most(f->low[k] - at, at - f->high[k]), zero);
        out[k] *= out[k];
    }
    const float gap_x = f->low[0] > 7.5f ? f->low[0] - 7.5f : f->high[0] < 0.5f ? 0.5f - f->high[0] : 0;
    const lanes gap_xy = gap_x * gap_x + out[1];
    for (int iz = 0; iz < 8; iz++) {
        lanes most;
        memcpy(&most, field->most + 8 * iz, sizeof most);
        const uint64_t near = any_lane((gap_xy + out[2][iz] < most) & bit);
        for (unsigned left = (unsigned)(near | near >> 32); left; left &= left - 1) {
            const int iy = __builtin_ctz(left);
            const float y = (float)iy + 0.5f, z = (float)iz + 0.5f;
            const float dy = y - f->corner[0][1], dz = z - f->corner[0][2];
            lanes *best = field->best + 8 * iz + iy;
            const lanes h = (at - f->corner[0][0]) * f->normal[0] + (dy * f->normal[1] + dz * f->normal[2]);
            const lanes open = *best + SLACK;
            const flags hope = (h * h < open) & (out[0] + (out[1][iy] + out[2][iz]) < open);
            if (!any_lane(hope)) continue;
            const flags inside = inside_facet(f, at, y, z);
            const lanes edge = any_lane(hope & ~inside) ? nearest_edge(f, at, y, z, *best) : *best;
            *best = each_least(PICK(inside, h * h, edge), *best);
        }
    }
}

typedef struct {
    float gap2;
    int tri;
} near;

/* Triangles within the band of a brick, the nearest shell first. Returns their number, -1 without memory. */
static int near_triangles(const job *j, const int place[3], near **list, int *room,
                          int shells[CN_MAP_SIDE + 2])
{
    const cn_map_level *level = j->level;
    int low[3], high[3], n = 0, at[3];
    float corner[3];
    for (int k = 0; k < 3; k++) {
        corner[k] = (float)(8 * (place[k] - 1));
        low[k] = place[k] > 0 ? place[k] - 1 : 0;
        high[k] = place[k] < level->size[k] - 1 ? place[k] + 1 : place[k];
    }
    memset(shells, 0, (CN_MAP_SIDE + 2) * sizeof *shells);
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                const int64_t p = ((int64_t)at[2] * level->size[1] + at[1]) * level->size[0] + at[0];
                for (int i = j->start[p]; i < j->start[p + 1]; i++) {
                    const int *tlow = j->low[j->item[i]];
                    int later = 0; /* than the first of the places in which this triangle is listed */
                    for (int k = 0; k < 3; k++)
                        later |= at[k] ^ MOST(tlow[k], low[k]);
                    if (later) continue;
                    const float *box = j->box[j->item[i]];
                    float gap2 = 0;
                    for (int k = 0; k < 3; k++) {
                        const float a = box[k] - corner[k] - 7.5f, b = corner[k] + 0.5f - box[3 + k];
                        const float most = MOST(a, b), gap = MOST(most, 0);
                        gap2 += gap * gap;
                    }
                    if (gap2 > (float)(CN_MAP_BAND * CN_MAP_BAND)) continue;
                    if (n == *room) {
                        near *more = realloc(*list, (size_t)(*room + 512) * 2 * sizeof *more);
                        if (!more) return -1;
                        *list = more, *room = (*room + 512) * 2;
                    }
                    (*list)[n] = (near){gap2, j->item[i]};
                    shells[(int)sqrtf((*list)[n++].gap2) + 1]++;
                }
            }
    for (int s = 1; s < CN_MAP_SIDE + 2; s++)
        shells[s] += shells[s - 1];
    return n;
}

/* Which 2 x 2 x 2 samples of a brick hold one that counts and lies beyond the band. */
static uint64_t beyond_band(const uint8_t *value, const uint64_t mask[8])
{
    uint64_t all = 0;
    if (!memchr(value, CN_MAP_FAR, CN_MAP_CELLS)) return 0;
    for (int z = 0; z < 8; z += 2) {
        uint64_t far = 0;
        for (int i = 0; i < 64; i++)
            far |= (uint64_t)(value[64 * z + i] == CN_MAP_FAR && mask[z] >> i & 1) << i |
                   (uint64_t)(value[64 * z + 64 + i] == CN_MAP_FAR && mask[z + 1] >> i & 1) << i;
        far |= far >> 1, far |= far >> 8;
        for (int i = 0; i < 16; i++)
            all |= (far >> (16 * (i >> 2) + 2 * (i & 3)) & 1) << (8 * z + i);
    }
    return all;
}

static void measure_brick(const job *j, int brick, const near *list, const int *order, int n)
{
    const int *place = j->level->place[brick];
    if (n == 0) {
        memset(j->level->value + (int64_t)brick * CN_MAP_CELLS, CN_MAP_FAR, CN_MAP_CELLS);
        return;
    }
    rows field;
    float most = 66; /* a little more than the band squared */
    for (int r = 0; r < ROWS; r++)
        field.best[r] = (lanes){0} + most, field.most[r] = most;
    for (int i = 0; i < n; i++) {
        const near *candidate = list + order[i];
        if (i % 2 == 1) most = largest(&field);
        if (candidate->gap2 >= most) continue;
        double v[3][3];
        facet f;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++)
                v[c][k] = j->walls->tri[candidate->tri][3 * c + k] * j->scale - 8.0 * (place[k] - 1);
        facet_new(&f, v);
        splat(&field, &f);
    }
    uint8_t *value = j->level->value + (int64_t)brick * CN_MAP_CELLS;
    const float *best = (const float *)field.best;
    for (int i = 0; i < CN_MAP_CELLS; i++) {
        const float d = sqrtf(best[i]) - j->margin;
        value[i] = d >= (float)CN_MAP_BAND ? CN_MAP_FAR
                   : d > 0                 ? (uint8_t)(d * (float)(1 / CN_MAP_QUANTUM))
                                           : 0;
    }
}

static void measure_chunk(void *user, int task)
{
    const job *j = user;
    near *list = NULL;
    int *order = NULL, room = 0, ordered = 0, shells[CN_MAP_SIDE + 2];
    const int end = (task + 1) * CHUNK < j->level->nbrick ? (task + 1) * CHUNK : j->level->nbrick;
    j->failed[task] = true;
    for (int brick = task * CHUNK; brick < end; brick++) {
        const int n = near_triangles(j, j->level->place[brick], &list, &room, shells);
        if (n < 0) goto done;
        if (ordered < room) {
            int *more = realloc(order, (size_t)room * sizeof *more);
            if (!more) goto done;
            order = more, ordered = room;
        }
        for (int i = 0; i < n; i++)
            order[shells[(int)sqrtf(list[i].gap2)]++] = i;
        measure_brick(j, brick, list, order, n);
        j->beyond[brick] =
            beyond_band(j->level->value + (int64_t)brick * CN_MAP_CELLS, j->level->mask + 8 * (int64_t)brick);
    }
    j->failed[task] = false;
done:
    free(list), free(order);
}

/* The samples of the next level around those of a brick that lie beyond the band: rows of 6, 6 rows a layer,
 * 6 layers, the brick's own 4 x 4 x 4 in the middle. */
static void wanted_samples(uint64_t beyond, uint64_t layer[6])
{
    memset(layer, 0, 6 * sizeof *layer);
    for (int z = 0; z < 4; z++) {
        uint64_t wide = 0;
        for (int y = 0; y < 4; y++) {
            const uint64_t row = beyond >> (16 * z + 4 * y) & 15, three = row | row << 1 | row << 2;
            wide |= three << 6 * y | three << (6 * y + 6) | three << (6 * y + 12);
        }
        layer[z] |= wide, layer[z + 1] |= wide, layer[z + 2] |= wide;
    }
}

/* Marks what level l + 1 needs: the samples around those of level l that lie beyond its band. */
static cn_status next_level(cn_map *map, int l, const uint64_t *beyond, bool *any)
{
    const cn_map_level *fine = map->level + l;
    cn_map_level *coarse = map->level + l + 1;
    const int side = 1 << (l + 1);
    const int size[3] = {(map->size[0] + side - 1) / side, (map->size[1] + side - 1) / side,
                         (map->size[2] + side - 1) / side};
    cn_status status = cn_map_level_new(coarse, size);
    if (status != CN_OK) return status;
    map->nlevel = l + 2;
    *any = false;
    for (int pass = 0; pass < 2; pass++) { /* places, then samples */
        for (int b = 0; b < fine->nbrick; b++) {
            const int *place = fine->place[b], first = 4 * (place[0] - 1) - 1; /* sample of each row */
            uint64_t layer[6];
            if (!beyond[b]) continue;
            *any = true;
            wanted_samples(beyond[b], layer);
            for (int i = 0; i < 36; i++) {
                const uint64_t row = (layer[i / 6] >> 6 * (i % 6) & 63) << (first & 7);
                const int y = 4 * (place[1] - 1) + i % 6 - 1, z = 4 * (place[2] - 1) + i / 6 - 1;
                for (int part = 0; part < 2; part++) { /* a row lies in two bricks */
                    const uint64_t bits = row >> 8 * part & 255;
                    const int at[3] = {(first >> 3) + 1 + part, (y >> 3) + 1, (z >> 3) + 1};
                    if (!bits || at[0] < 0 || at[1] < 0 || at[2] < 0 || at[0] >= coarse->size[0] ||
                        at[1] >= coarse->size[1] || at[2] >= coarse->size[2])
                        continue;
                    int *brick =
                        coarse->brick + ((int64_t)at[2] * coarse->size[1] + at[1]) * coarse->size[0] + at[0];
                    if (!pass)
                        *brick = 0;
                    else
                        coarse->mask[8 * (int64_t)*brick + (z & 7)] |= bits << 8 * (y & 7);
                }
            }
        }
        if (!pass && (status = cn_map_level_number(coarse)) != CN_OK) return status;
    }
    return CN_OK;
}

cn_status cn_map_measure(cn_map *map, const cn_map_walls *walls, cn_pool *pool)
{
    for (int l = 0; l < map->nlevel; l++) {
        job j = {.level = map->level + l, .walls = walls, .scale = 1.0 / (1 << l)};
        const int ntask = (j.level->nbrick + CHUNK - 1) / CHUNK;
        bool any = false;
        j.margin = (float)(1e-4 + 1e-6 * (walls->extent * j.scale + 24));
        cn_status status = sort_triangles(&j);
        j.failed = calloc((size_t)ntask + 1, sizeof *j.failed);
        j.beyond = malloc(((size_t)j.level->nbrick + 1) * sizeof *j.beyond);
        if (!j.failed || !j.beyond) status = CN_ERR_MEMORY;
        if (status == CN_OK) {
            cn_pool_run(pool, ntask, measure_chunk, &j);
            for (int t = 0; t < ntask; t++)
                if (j.failed[t]) status = CN_ERR_MEMORY;
        }
        if (status == CN_OK && l + 1 < CN_MAP_LEVELS && walls->ntri)
            status = next_level(map, l, j.beyond, &any);
        free(j.box), free(j.low), free(j.start), free(j.item), free(j.failed), free(j.beyond);
        if (status != CN_OK) return status;
        if (!any && map->nlevel == l + 2) { /* nothing left for the coarser one */
            cn_map_level *last = map->level + l + 1;
            free(last->brick), free(last->place), free(last->value), free(last->mask);
            memset(last, 0, sizeof *last);
            map->nlevel = l + 1;
        }
    }
    return CN_OK;
}
