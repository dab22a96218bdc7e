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

enum { CHUNK = 64, ASCENT_MOST = 4096, PRUNINGS = 3, ROOTS = 3 * 15 * 15 + 1, AHEAD = 16 };

typedef struct {
    cn_map *map;
    uint64_t *candidate[CN_MAP_LEVELS]; /* samples on the ridge (nbrick x 8) */
    int level;
    uint64_t *ridge;   /* cells, then an empty brick (nbrick + 1, x 8) */
    int (*beside)[27]; /* the bricks around each of level 0 and itself, the empty one where there is none */
    double root[ROOTS];
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

/* Steepest rise of the stored distances from a sample to a neighbour; *to is that neighbour. INFINITY where a
 * neighbour lies beyond the band: the next level sees to that. */
static double rise(const cn_map_level *level, int brick, int offset, int *to)
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
    }
    return most;
}

typedef uint8_t values __attribute__((vector_size(8))); /* of a brick's samples, along x */

static values larger(values a, values b)
{
    const values first = (values)(a > b);
    return (a & first) | (b & ~first);
}

/* Lanes of b that are no less than a + rise, or beyond the band. */
static values reaches(values b, values a, int rise)
{
    const values sum = a + (uint8_t)rise, most = sum | (values)(sum < a);
    return (values)(b >= most);
}

/* The samples of a brick and of those around it, one deep, 0 where there are none: each values as it is, and
 * the larger of its two neighbours along x. */
static void read_rows(const cn_map_level *level, int brick, values own[10][10], values beside[10][10])
{
    const uint8_t *part[27];
    for (int n = 0; n < 27; n++) {
        int q[3];
        neighbour(level->place[brick], n, q);
        const int b = cn_map_brick_at(level, q);
        part[n] = b < 0 ? NULL : level->value + (int64_t)b * CN_MAP_CELLS;
    }
    for (int z = 0; z < 10; z++)
        for (int y = 0; y < 10; y++) {
            const int at = 64 * ((z + 7) & 7) + 8 * ((y + 7) & 7);
            const uint8_t *const *three = part + 9 * ((z + 7) >> 3) + 3 * ((y + 7) >> 3);
            uint8_t line[10] = {0};
            values below, above;
            if (three[0]) line[0] = three[0][at + 7];
            if (three[1]) memcpy(line + 1, three[1] + at, 8);
            if (three[2]) line[9] = three[2][at];
            memcpy(&below, line, 8), memcpy(own[z] + y, line + 1, 8), memcpy(&above, line + 2, 8);
            beside[z][y] = larger(below, above);
        }
}

/* Samples from which the distance rises towards no neighbour by RISE_MOST of the way there. */
static void find_candidates(void *user, int task)
{
    const job *j = user;
    const cn_map_level *level = j->map->level + j->level;
    const int least = (int)ceil((j->level ? 2 : 1) / CN_MAP_QUANTUM); /* what is nearer to the wall: finer */
    const int end = (task + 1) * CHUNK < level->nbrick ? (task + 1) * CHUNK : level->nbrick;
    int enough[3] = {0, 0, 0}; /* least rise to a neighbour across a face, an edge, a corner [quanta] */
    for (int k = 0; k < 3; k++)
        while (enough[k] * CN_MAP_QUANTUM / neighbour_distance(k == 0 ? 4 : k == 1 ? 1 : 0) < RISE_MOST)
            enough[k]++;
    for (int b = task * CHUNK; b < end; b++) {
        values own[10][10], beside[10][10];
        uint64_t any = 0;
        for (int w = 0; w < 8; w++)
            any |= level->mask[8 * (int64_t)b + w];
        if (!any) continue;
        read_rows(level, b, own, beside);
        for (int z = 1; z < 9; z++)
            for (int y = 1; y < 9; y++) {
                const values at = own[z][y];
                values face = beside[z][y], edge = {0}, corner = {0};
                for (int s = -1; s <= 1; s += 2) {
                    face = larger(face, larger(own[z + s][y], own[z][y + s]));
                    edge = larger(edge, larger(beside[z + s][y], beside[z][y + s]));
                    edge = larger(edge, larger(own[z + s][y - 1], own[z + s][y + 1]));
                    corner = larger(corner, larger(beside[z + s][y - 1], beside[z + s][y + 1]));
                }
                const values none = reaches(face, at, enough[0]) | reaches(edge, at, enough[1]) |
                                    reaches(corner, at, enough[2]);
                const values found = ~none & (values)(at >= (uint8_t)least) & (values)(at != CN_MAP_FAR);
                if (!((uint64_t)found)) continue;
                uint64_t bits = 0;
                for (int x = 0; x < 8; x++)
                    bits |= (uint64_t)(found[x] & 1) << (8 * (y - 1) + x);
                j->candidate[j->level][8 * (int64_t)b + z - 1] |= bits & level->mask[8 * (int64_t)b + z - 1];
            }
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
        const double slope = far ? INFINITY : rise(level, brick, offset, &to);
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
        for (int w = 0; w < 8 * level->nbrick; w++)
            for (uint64_t bits = j->candidate[l][w]; bits; bits &= bits - 1) {
                const int b = w / 8, o = 64 * (w % 8) + __builtin_ctzll(bits);
                int i[3], to, q[3], brick, offset;
                coordinates(level, b, o, i);
                if (rise(level, b, o, &to) < 2 * CN_MAP_QUANTUM) continue;
                neighbour(i, to, q);
                if (cn_map_find(level, q, &brick, &offset) && cn_map_bit(j->candidate[l], brick, offset))
                    continue;
                ascend(j, l, q);
            }
    }
}

/* --- thinning --- */

/* Rows y - 1, y, y + 1 of a layer of three bricks along y (each 3 entries after the last), a byte each. */
static uint32_t three_rows(const uint64_t *layer, const int *brick, int y)
{
    const uint64_t own = layer[8 * (int64_t)brick[3]];
    if (y == 0) return (uint32_t)(own << 8 | layer[8 * (int64_t)brick[0]] >> 56);
    if (y == 7) return (uint32_t)(own >> 48 | layer[8 * (int64_t)brick[6]] << 16);
    return (uint32_t)(own >> 8 * (y - 1));
}

/* The ridge among the 26 neighbours of a cell, as bits. */
static uint32_t around(const job *j, int id)
{
    const int x = id & 7, y = id >> 3 & 7, z = id >> 6 & 7, *beside = j->beside[id / CN_MAP_CELLS];
    uint32_t bits = 0;
    for (int k = 0; k < 3; k++) {
        const int *nine = beside + 9 * (((z + k - 1) >> 3) + 1);
        const uint64_t *layer = j->ridge + ((z + k - 1) & 7);
        const uint32_t rows = three_rows(layer, nine + 1, y);
        uint32_t set;
        if (x == 0)
            set = (rows << 1 & 0x060606) | (three_rows(layer, nine, y) >> 7 & 0x010101);
        else if (x == 7)
            set = (rows >> 6 & 0x030303) | (three_rows(layer, nine + 2, y) << 2 & 0x040404);
        else
            set = rows >> (x - 1) & 0x070707;
        bits |= ((set & 7) | (set >> 5 & 070) | (set >> 10 & 0700)) << 9 * k;
    }
    return bits & ~(1u << 13);
}

/* Bits of a 3 x 3 x 3 block: x = 0, x = 2, y = 0, y = 2. */
enum { X0 = 0x1249249, X2 = X0 << 2, Y0 = 0x1c0e07, Y2 = Y0 << 6 };

/* The part of set joined to the seed across faces, edges and corners. */
static uint32_t flood26(uint32_t set, uint32_t seed)
{
    for (uint32_t done = seed;; seed = done) {
        done |= (done & ~X2) << 1 | (done & ~X0) >> 1;
        done |= (done & ~Y2) << 3 | (done & ~Y0) >> 3;
        done = (done | done << 9 | done >> 9) & set;
        if (done == seed) return done;
    }
}

/* The same across faces. */
static uint32_t flood6(uint32_t set, uint32_t seed)
{
    for (uint32_t done = seed;; seed = done) {
        done |= ((done & ~X2) << 1 | (done & ~X0) >> 1 | (done & ~Y2) << 3 | (done & ~Y0) >> 3 | done << 9 |
                 done >> 9) &
                set;
        if (done == seed) return done;
    }
}

enum {
    FACES = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22,
    NO_CORNERS =
        0x7ffffff & ~(1 << 0 | 1 << 2 | 1 << 6 | 1 << 8 | 1 << 13 | 1 << 18 | 1 << 20 | 1 << 24 | 1 << 26)
};

/* Its removal changes no topology: one piece of ridge around it and one of the rest (Bertrand and Malandain
 * 1994). */
static bool simple(uint32_t set)
{
    const uint32_t rest = ~set & NO_CORNERS, open = rest & FACES;
    if (!set || !open) return false;
    return flood26(set, set & -set) == set && !(open & ~flood6(rest, open & -open));
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
            if (c + AHEAD < j->ncell) {
                const int next = j->cell[c + AHEAD].id / CN_MAP_CELLS;
                __builtin_prefetch(j->ridge + 8 * (int64_t)next), __builtin_prefetch(j->beside + next);
            }
            if (!present(j, j->cell[c].id)) continue;
            const uint32_t set = around(j, j->cell[c].id);
            if ((set & (set - 1)) && simple(set))
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
 * on the axis of a tube and so without a preference for the lattice. Lengths |x - x_i| are roots of whole
 * numbers in units of half a cell. */
static double upper(const job *j, int id, corners around[CN_MAP_LEVELS])
{
    const cn_map *map = j->map;
    int i[3];
    if (map->level->value[id] != CN_MAP_FAR) return map->level->value[id] * CN_MAP_QUANTUM;
    coordinates(map->level, id / CN_MAP_CELLS, id % CN_MAP_CELLS, i);
    for (int l = 1; l < map->nlevel; l++) {
        corners *c = around + l;
        const int spacing = 2 << l; /* [half cells] */
        int s[3], square[3][2];
        double best = INFINITY;
        for (int k = 0; k < 3; k++) {
            const int x = 2 * i[k] + 1 - spacing / 2, low = x & (spacing - 1), high = spacing - low;
            s[k] = x >> (l + 1), square[k][0] = low * low, square[k][1] = high * high;
        }
        if (!c->known || memcmp(s, c->first, sizeof s)) read_corners(map->level + l, s, c);
        for (int n = 0; n < 8 && c->whole; n++) {
            const int away = square[0][n & 1] + square[1][n >> 1 & 1] + square[2][n >> 2];
            const double through = c->distance[n] + (away < ROOTS ? j->root[away] : sqrt(away)) / spacing;
            best = through < best ? through : best;
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
        j->cell[c].distance = (float)upper(j, j->cell[c].id, around);
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

static bool find_beside(job *j)
{
    const cn_map_level *level = j->map->level;
    if (!(j->beside = malloc(((size_t)level->nbrick + 1) * sizeof *j->beside))) return false;
    for (int b = 0; b < level->nbrick; b++)
        for (int n = 0; n < 27; n++) {
            int q[3];
            neighbour(level->place[b], n, q);
            const int beside = cn_map_brick_at(level, q);
            j->beside[b][n] = beside < 0 ? level->nbrick : beside;
        }
    return true;
}

cn_status cn_map_find_ridge(cn_map *map, const cn_world *world, cn_pool *pool)
{
    job j = {.map = map, .world = world};
    cn_status status = CN_ERR_MEMORY;
    int *twig = NULL;
    if (map->bare) return CN_OK;
    for (int i = 0; i < ROOTS; i++)
        j.root[i] = sqrt(i);
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
