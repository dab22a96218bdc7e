/* The ridge of the distance field. A sample is on it when the distance rises towards no neighbour nearly as
 * fast as it must towards the inside of a half space: its nearest wall points lie on opposite sides. Ends of
 * such pieces that point into a wider vessel are led uphill to its ridge; then the set is thinned to curves,
 * the cells nearest to the wall first, without changing its topology (Pudney, Distance-ordered homotopic
 * thinning, CVIU 1998), and twigs shorter than the clearance at their root are cut. */
#include "map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

#define RISE_MOST                                                                                            \
    0.6 /* of the distance on the ridge; 1 away from it: nearest points seen 106 degrees apart */

enum { CHUNK = 64, ASCENT_MOST = 4096, PRUNINGS = 3 };

typedef struct {
    cn_map *map;
    uint64_t *candidate[CN_MAP_LEVELS]; /* samples on the ridge (nbrick x 8) */
    int level;
    uint64_t *ridge;   /* cells (nbrick x 8) */
    int (*beside)[27]; /* the bricks around each of level 0 and itself, -1: none */
    uint32_t adjacent26[27], adjacent6[27];
    int ncell;
    struct cell {
        float distance;
        int id;
    } * cell; /* id = brick * 512 + offset */
    const cn_world *world;
} job;

static void coordinates(const cn_map_level *level, int brick, int offset, int i[3])
{
    i[0] = 8 * (level->place[brick][0] - 1) + (offset & 7);
    i[1] = 8 * (level->place[brick][1] - 1) + (offset >> 3 & 7);
    i[2] = 8 * (level->place[brick][2] - 1) + (offset >> 6);
}

static void neighbour(const int i[3], int n, int q[3])
{
    q[0] = i[0] + n % 3 - 1, q[1] = i[1] + n / 3 % 3 - 1, q[2] = i[2] + n / 9 - 1;
}

static double neighbour_distance(int n)
{
    static const double length[4] = {0, 1, 1.4142135623730951, 1.7320508075688772};
    return length[(n % 3 != 1) + (n / 3 % 3 != 1) + (n / 9 != 1)];
}

/* Steepest rise of the stored distances from a sample to a neighbour, or the first found that is `enough`;
 * *to is that neighbour. INFINITY where a neighbour lies beyond the band: the next level sees to that. */
static double rise(const cn_map_level *level, int brick, int offset, double enough, int *to)
{
    static const int order[26] = {4,  10, 12, 14, 16, 22, 1, 3, 5, 7,  9,  11, 15,
                                  17, 19, 21, 23, 25, 0,  2, 6, 8, 18, 20, 24, 26};
    const uint8_t *value = level->value + (int64_t)brick * CN_MAP_CELLS + offset;
    int i[3];
    double most = -1;
    coordinates(level, brick, offset, i);
    const bool within = ((i[0] + 1) & 7) > 1 && ((i[1] + 1) & 7) > 1 && ((i[2] + 1) & 7) > 1;
    for (int k = 0; k < 26; k++) {
        const int n = order[k];
        int q[3], code;
        if (within)
            code = value[64 * (n / 9 - 1) + 8 * (n / 3 % 3 - 1) + n % 3 - 1];
        else {
            int b, o;
            neighbour(i, n, q);
            if (!cn_map_find(level, q, &b, &o)) continue;
            code = level->value[(int64_t)b * CN_MAP_CELLS + o];
        }
        if (code == CN_MAP_FAR) return INFINITY;
        const double slope = (code - *value) * CN_MAP_QUANTUM / neighbour_distance(n);
        if (slope > most) most = slope, *to = n;
        if (most >= enough) break;
    }
    return most;
}

static void find_candidates(void *user, int task)
{
    const job *j = user;
    const cn_map_level *level = j->map->level + j->level;
    const double least =
        (j->level ? 2 : 1) / CN_MAP_QUANTUM; /* finer levels see to what is nearer to the wall */
    const int end = (task + 1) * CHUNK < level->nbrick ? (task + 1) * CHUNK : level->nbrick;
    for (int b = task * CHUNK; b < end; b++)
        for (int o = 0; o < CN_MAP_CELLS; o++) {
            const int code = level->value[(int64_t)b * CN_MAP_CELLS + o];
            int to;
            if (code == CN_MAP_FAR || code < least || !cn_map_bit(level->mask, b, o)) continue;
            if (rise(level, b, o, RISE_MOST, &to) < RISE_MOST)
                j->candidate[j->level][8 * (int64_t)b + (o >> 6)] |= 1ull << (o & 63);
        }
}

/* Adds the free cells of a sample to the ridge: a cube within a brick, or one of whole bricks. */
static void add_sample(job *j, int l, const int i[3])
{
    const cn_map_level *cells = j->map->level;
    const int side = l < 3 ? 1 << l : 8, bricks = l < 3 ? 1 : 1 << (l - 3);
    int corner[3];
    uint64_t rows = 0;
    for (int k = 0; k < 3; k++)
        corner[k] = i[k] * (1 << l);
    for (int y = 0; y < side; y++)
        rows |= (uint64_t)((1u << side) - 1u) << 8 * ((corner[1] & 7) + y) << (corner[0] & 7);
    for (int n = 0; n < bricks * bricks * bricks; n++) {
        const int at[3] = {(corner[0] >> 3) + n % bricks + 1, (corner[1] >> 3) + n / bricks % bricks + 1,
                           (corner[2] >> 3) + n / bricks / bricks + 1};
        const int brick = cn_map_brick_at(cells, at), first = corner[2] & 7;
        for (int z = first; brick >= 0 && z < first + side; z++)
            j->ridge[8 * (int64_t)brick + z] |= cells->mask[8 * (int64_t)brick + z] & rows;
    }
}

static double cell_distance(const cn_map *map, const int i[3])
{
    return cn_map_lower(map, (double[3]){i[0] + 0.5, i[1] + 0.5, i[2] + 0.5}, NULL);
}

/* The candidates of a level with the samples around them: thick enough to have no holes of their own. */
static bool add_candidates(job *j)
{
    const cn_map_level *level = j->map->level + j->level;
    uint64_t *thick = calloc((size_t)level->nbrick + 1, 8 * sizeof *thick);
    if (!thick) return false;
    for (int pass = 0; pass < 2; pass++)
        for (int w = 0; w < 8 * level->nbrick; w++)
            for (uint64_t bits = pass ? thick[w] : j->candidate[j->level][w]; bits; bits &= bits - 1) {
                int i[3], q[3], brick, offset;
                const int bit = __builtin_ctzll(bits), x = bit & 7, y = bit >> 3, z = w % 8;
                coordinates(level, w / 8, 64 * z + bit, i);
                if (pass) {
                    add_sample(j, j->level, i);
                    continue;
                }
                if (x > 0 && x < 7 && y > 0 && y < 7 && z > 0 && z < 7) {
                    const uint64_t block = 0x070707ull << (bit - 9);
                    thick[w - 1] |= block, thick[w] |= block, thick[w + 1] |= block;
                    continue;
                }
                for (int n = 0; n < 27; n++) {
                    neighbour(i, n, q);
                    if (cn_map_find(level, q, &brick, &offset))
                        thick[8 * (int64_t)brick + (offset >> 6)] |= 1ull << (offset & 63);
                }
            }
    free(thick);
    return true;
}

/* Uphill from a sample until the ridge is met, on coarser levels where the finer ones end. */
static void ascend(job *j, int l, const int from[3])
{
    int i[3] = {from[0], from[1], from[2]}, q[3], brick, offset;
    for (int step = 0; step < ASCENT_MOST; step++) {
        const cn_map_level *level = j->map->level + l;
        add_sample(j, l, i);
        if (!cn_map_find(level, i, &brick, &offset) || cn_map_bit(j->candidate[l], brick, offset)) return;
        int to = 13;
        const bool far = level->value[(int64_t)brick * CN_MAP_CELLS + offset] == CN_MAP_FAR;
        const double slope = far ? INFINITY : rise(level, brick, offset, INFINITY, &to);
        if (slope <= 0) return;
        if (slope == INFINITY) {
            if (++l == j->map->nlevel) return;
            for (int k = 0; k < 3; k++)
                i[k] >>= 1;
        } else {
            neighbour(i, to, q);
            memcpy(i, q, sizeof i);
        }
    }
}

static void join_pieces(job *j)
{
    for (int l = 0; l < j->map->nlevel; l++) {
        const cn_map_level *level = j->map->level + l;
        for (int b = 0; b < level->nbrick; b++)
            for (int o = 0; o < CN_MAP_CELLS; o++) {
                if (!cn_map_bit(j->candidate[l], b, o)) continue;
                int i[3], to, q[3], brick, offset;
                coordinates(level, b, o, i);
                if (rise(level, b, o, INFINITY, &to) < 2 * CN_MAP_QUANTUM) continue;
                neighbour(i, to, q);
                if (cn_map_find(level, q, &brick, &offset) && cn_map_bit(j->candidate[l], brick, offset))
                    continue;
                ascend(j, l, q);
            }
    }
}

/* --- thinning --- */

/* The ridge among the 26 neighbours of a cell, as bits. */
static uint32_t around(const job *j, int id)
{
    const int x = id & 7, y = id >> 3 & 7, z = id >> 6 & 7, *beside = j->beside[id / CN_MAP_CELLS];
    uint32_t bits = 0;
    for (int k = 0; k < 9; k++) {
        const int row = y + k % 3 - 1, layer = z + k / 3 - 1;
        const int *three = beside + 9 * ((layer >> 3) + 1) + 3 * ((row >> 3) + 1);
        const int64_t word = layer & 7, shift = 8 * (row & 7);
        uint32_t set = 0;
        if (x == 0 && three[0] >= 0) set |= j->ridge[8 * (int64_t)three[0] + word] >> shift >> 7 & 1;
        if (three[1] >= 0) set |= (uint32_t)(j->ridge[8 * (int64_t)three[1] + word] >> shift & 255) << 1;
        if (x == 7 && three[2] >= 0)
            set |= (uint32_t)(j->ridge[8 * (int64_t)three[2] + word] >> shift & 1) << 9;
        bits |= (set >> x & 7) << 3 * k;
    }
    return bits & ~(1u << 13);
}

static uint32_t flood(uint32_t set, uint32_t seed, const uint32_t adjacent[27])
{
    uint32_t done = 0, front = seed;
    while (front) {
        const int n = __builtin_ctz(front);
        done |= 1u << n;
        front = (front | (adjacent[n] & set)) & ~done;
    }
    return done;
}

enum {
    FACES = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22,
    NO_CORNERS =
        0x7ffffff & ~(1 << 0 | 1 << 2 | 1 << 6 | 1 << 8 | 1 << 13 | 1 << 18 | 1 << 20 | 1 << 24 | 1 << 26)
};

/* Its removal changes no topology: one piece of ridge around it and one of the rest (Bertrand and Malandain
 * 1994). */
static bool simple(const job *j, uint32_t set)
{
    const uint32_t rest = ~set & NO_CORNERS, open = rest & FACES;
    if (!set || !open) return false;
    if (flood(set, set & -set, j->adjacent26) != set) return false;
    return !(open & ~flood(rest, open & -open, j->adjacent6));
}

static void remove_cell(job *j, int id)
{
    const int o = id % CN_MAP_CELLS;
    j->ridge[8 * (int64_t)(id / CN_MAP_CELLS) + (o >> 6)] &= ~(1ull << (o & 63));
}

static bool present(const job *j, int id)
{
    return cn_map_bit(j->ridge, id / CN_MAP_CELLS, id % CN_MAP_CELLS);
}

static void thin(job *j)
{
    for (bool changed = true; changed;) {
        int n = 0;
        changed = false;
        for (int c = 0; c < j->ncell; c++) {
            if (!present(j, j->cell[c].id)) continue;
            const uint32_t set = around(j, j->cell[c].id);
            if (__builtin_popcount(set) > 1 && simple(j, set))
                remove_cell(j, j->cell[c].id), changed = true;
            else
                j->cell[n++] = j->cell[c];
        }
        j->ncell = n;
    }
}

/* Cuts the twig that ends at cell `id`, where it is shorter than the clearance at its root. */
static bool cut_twig(job *j, int id, int *twig, int room)
{
    int n = 0, at = id, before = -1;
    double length = 0;
    for (;;) {
        int i[3], q[3], brick, offset, next = -1, how = 13;
        uint32_t set = around(j, at);
        coordinates(j->map->level, at / CN_MAP_CELLS, at % CN_MAP_CELLS, i);
        if (__builtin_popcount(set) > 2) { /* the root */
            if (length > cell_distance(j->map, i) + 2) return false;
            for (int k = 0; k < n; k++)
                remove_cell(j, twig[k]);
            return n > 0;
        }
        if (n == room) return false;
        twig[n++] = at;
        for (; set; set &= set - 1) {
            const int m = __builtin_ctz(set);
            neighbour(i, m, q);
            if (cn_map_find(j->map->level, q, &brick, &offset) && brick * CN_MAP_CELLS + offset != before)
                next = brick * CN_MAP_CELLS + offset, how = m;
        }
        if (next < 0) return false; /* a piece of its own */
        length += neighbour_distance(how);
        before = at, at = next;
    }
}

static int by_id(const void *left, const void *right)
{
    const struct cell *a = left, *b = right;
    return (a->id > b->id) - (a->id < b->id);
}

static void centre(const cn_map *map, int id, double x[3])
{
    int i[3];
    coordinates(map->level, id / CN_MAP_CELLS, id % CN_MAP_CELLS, i);
    for (int k = 0; k < 3; k++)
        x[k] = map->origin[k] + (i[k] + 0.5) * map->cell;
}

/* The eight samples around a place, those from `first` on; whole: all are there and within the band. */
typedef struct {
    bool known, whole;
    int first[3];
    double distance[8]; /* [their spacing] */
} corners;

static void read_corners(const cn_map_level *level, const int first[3], corners *c)
{
    memcpy(c->first, first, sizeof c->first);
    c->known = c->whole = true;
    for (int n = 0; n < 8 && c->whole; n++) {
        const int s[3] = {first[0] + (n & 1), first[1] + (n >> 1 & 1), first[2] + (n >> 2)};
        int brick, offset;
        c->whole = cn_map_find(level, s, &brick, &offset);
        const int code = c->whole ? level->value[(int64_t)brick * CN_MAP_CELLS + offset] : CN_MAP_FAR;
        c->whole = c->whole && code != CN_MAP_FAR;
        c->distance[n] = code * CN_MAP_QUANTUM;
    }
}

/* Upper bound on the distance of a cell's centre: the least d_i + |x - x_i| over the samples around it, exact
 * on the axis of a tube and so without a preference for the lattice. */
static double upper(const cn_map *map, int id, corners around[CN_MAP_LEVELS])
{
    int i[3];
    if (map->level->value[id] != CN_MAP_FAR) return map->level->value[id] * CN_MAP_QUANTUM;
    coordinates(map->level, id / CN_MAP_CELLS, id % CN_MAP_CELLS, i);
    for (int l = 1; l < map->nlevel; l++) {
        corners *c = around + l;
        int s[3];
        double x[3], best = INFINITY;
        for (int k = 0; k < 3; k++)
            x[k] = (i[k] + 0.5) / (1 << l) - 0.5, s[k] = (int)floor(x[k]);
        if (!c->known || memcmp(s, c->first, sizeof s)) read_corners(map->level + l, s, c);
        for (int n = 0; n < 8 && c->whole; n++) {
            double away = 0;
            for (int k = 0; k < 3; k++) {
                const double d = x[k] - (s[k] + (n >> k & 1));
                away += d * d;
            }
            best = fmin(best, c->distance[n] + sqrt(away));
        }
        if (c->whole) return best * (1 << l);
    }
    return cell_distance(map, i);
}

static void order_cells(void *user, int task)
{
    const job *j = user;
    const int end = (task + 1) * CHUNK < j->ncell ? (task + 1) * CHUNK : j->ncell;
    corners around[CN_MAP_LEVELS] = {0}; /* cells side by side have the same */
    for (int c = task * CHUNK; c < end; c++)
        j->cell[c].distance = (float)upper(j->map, j->cell[c].id, around);
}

static void measure_cells(void *user, int task)
{
    const job *j = user;
    const int end = (task + 1) * CHUNK < j->ncell ? (task + 1) * CHUNK : j->ncell;
    for (int c = task * CHUNK; c < end; c++) {
        centre(j->map, j->cell[c].id, j->map->ridge_x + 3 * c);
        j->map->ridge_clearance[c] = cn_world_distance(j->world, j->map->ridge_x + 3 * c, NULL, NULL, NULL);
    }
}

static cn_status list_cells(job *j)
{
    const cn_map_level *level = j->map->level;
    for (int pass = 0; pass < 2; pass++) {
        j->ncell = 0;
        for (int w = 0; w < 8 * level->nbrick; w++)
            for (uint64_t bits = j->ridge[w]; bits; bits &= bits - 1) {
                if (pass) j->cell[j->ncell].id = 64 * w + __builtin_ctzll(bits);
                j->ncell++;
            }
        if (!pass && !(j->cell = malloc(((size_t)j->ncell + 1) * sizeof *j->cell))) return CN_ERR_MEMORY;
    }
    return CN_OK;
}

/* By distance in steps of 1/32 cell, equal ones as they are listed. */
static cn_status sort_cells(job *j)
{
    enum { STEPS = 32, MOST = 1 << 20 };
    struct cell *sorted = malloc(((size_t)j->ncell + 1) * sizeof *sorted);
    int *start = calloc(MOST + 2, sizeof *start);
    if (!sorted || !start) {
        free(sorted), free(start);
        return CN_ERR_MEMORY;
    }
    for (int pass = 0; pass < 2; pass++) {
        for (int c = 0; c < j->ncell; c++) {
            const int key = (int)fminf(STEPS * j->cell[c].distance, MOST - 1);
            if (pass)
                sorted[start[key + 1]++] = j->cell[c];
            else
                start[key + 2]++;
        }
        for (int k = 2; k < MOST + 2 && !pass; k++)
            start[k] += start[k - 1];
    }
    free(j->cell), free(start);
    j->cell = sorted;
    return CN_OK;
}

static void find_adjacent(job *j)
{
    for (int a = 0; a < 27; a++)
        for (int b = 0; b < 27; b++) {
            const int dx = abs(a % 3 - b % 3), dy = abs(a / 3 % 3 - b / 3 % 3), dz = abs(a / 9 - b / 9);
            if (a == b || a == 13 || b == 13) continue;
            if (dx <= 1 && dy <= 1 && dz <= 1) j->adjacent26[a] |= 1u << b;
            if (dx + dy + dz == 1) j->adjacent6[a] |= 1u << b;
        }
}

static bool find_beside(job *j)
{
    const cn_map_level *level = j->map->level;
    if (!(j->beside = malloc(((size_t)level->nbrick + 1) * sizeof *j->beside))) return false;
    for (int b = 0; b < level->nbrick; b++)
        for (int n = 0; n < 27; n++) {
            int q[3];
            neighbour(level->place[b], n, q);
            j->beside[b][n] = cn_map_brick_at(level, q);
        }
    return true;
}

cn_status cn_map_find_ridge(cn_map *map, const cn_world *world, cn_pool *pool)
{
    job j = {.map = map, .world = world};
    cn_status status = CN_ERR_MEMORY;
    int *twig = NULL;
    if (map->bare) return CN_OK;
    find_adjacent(&j);
    if (!(j.ridge = calloc((size_t)map->level->nbrick + 1, 8 * sizeof *j.ridge)) || !find_beside(&j))
        goto done;
    for (j.level = 0; j.level < map->nlevel; j.level++) {
        const cn_map_level *level = map->level + j.level;
        if (!(j.candidate[j.level] = calloc((size_t)level->nbrick + 1, 8 * sizeof *j.ridge))) goto done;
        cn_pool_run(pool, (level->nbrick + CHUNK - 1) / CHUNK, find_candidates, &j);
        if (!add_candidates(&j)) goto done;
    }
    join_pieces(&j);
    if ((status = list_cells(&j)) != CN_OK) goto done;
    cn_pool_run(pool, (j.ncell + CHUNK - 1) / CHUNK, order_cells, &j);
    if ((status = sort_cells(&j)) != CN_OK) goto done;
    thin(&j);
    status = CN_ERR_MEMORY;
    if (!(twig = malloc(((size_t)j.ncell + 1) * sizeof *twig))) goto done;
    for (int k = 0; k < PRUNINGS; k++) {
        bool cut = false;
        for (int c = 0; c < j.ncell; c++)
            if (present(&j, j.cell[c].id) && __builtin_popcount(around(&j, j.cell[c].id)) == 1)
                cut |= cut_twig(&j, j.cell[c].id, twig, j.ncell);
        if (!cut) break;
        thin(&j);
    }
    qsort(j.cell, (size_t)j.ncell, sizeof *j.cell, by_id);
    map->ridge_x = malloc(3 * ((size_t)j.ncell + 1) * sizeof *map->ridge_x);
    map->ridge_clearance = malloc(((size_t)j.ncell + 1) * sizeof *map->ridge_clearance);
    if (!map->ridge_x || !map->ridge_clearance) goto done;
    map->nridge = j.ncell;
    cn_pool_run(pool, (j.ncell + CHUNK - 1) / CHUNK, measure_cells, &j);
    status = CN_OK;
done:
    for (int l = 0; l < CN_MAP_LEVELS; l++)
        free(j.candidate[l]);
    free(j.ridge), free(j.beside), free(j.cell), free(twig);
    return status;
}
