/* map.h - the inside of cn_map: the free cells in sparse bricks, and the distance to the wall as a pyramid.
 *
 * Level l samples the distance on a lattice of spacing H = 2^l cells, held only within CN_MAP_BAND H of the
 * wall and only where a finer level ran out of its band: fine near the wall, coarse in the open. Distances in
 * between follow from a bound that cannot err upwards: d^2(x) - |x|^2 is the least of linear functions (one
 * per wall point), hence concave, so its linear interpolation lies below it. Lengths here are in cells from
 * the map's origin; cell i of an axis spans [i, i + 1]. */
#ifndef CN_MAP_H
#define CN_MAP_H

#include <stdint.h>
#include "catnav/world.h"
#include "pool.h"

enum { CN_MAP_LEVELS = 12, CN_MAP_SIDE = 8, CN_MAP_CELLS = 512, CN_MAP_FAR = 255 };
#define CN_MAP_BAND    8.0                 /* reach of a level [its spacing]; at most CN_MAP_SIDE */
#define CN_MAP_QUANTUM (CN_MAP_BAND / 254) /* step of the stored distances [its spacing] */

typedef struct {
    int size[3]; /* bricks a side, one of margin on each end included */
    int nbrick;
    int *brick;      /* index of the brick at each place, -1: none, x fastest     (size[0] size[1] size[2]) */
    int (*place)[3]; /* where each brick is                                       (nbrick)       */
    uint8_t
        *value; /* distance, rounded down [quanta]; CN_MAP_FAR: the band or more, x fastest (nbrick x 512) */
    uint64_t
        *mask; /* samples that count; level 0: the free cells; word z, bit x + 8 y         (nbrick x 8)   */
} cn_map_level;

struct cn_map {
    double cell, origin[3]; /* [m] */
    int size[3];            /* cells a side, multiples of CN_MAP_SIDE */
    int64_t nfree;          /* free cells */
    bool bare;              /* no wall at all: clearance is infinite */
    int ncap;
    double (*cap)[7]; /* corridors beyond the vessels' caps: centre, normal, radius [cells] */
    double corridor;  /* how deep they are mapped, at most a radius [cells] */
    int nlevel;
    cn_map_level level[CN_MAP_LEVELS];
    uint8_t *fill[32]; /* per scale: 0 none, 1 some, 2 all cells of a cube of 8 2^k cells are free */
    int fill_size[32][3], nfill;
    int nridge;
    double *ridge_x, *ridge_clearance; /* [m] (nridge x 3), (nridge) */
};

/* Triangles of all walls in cells, and whose they are. */
typedef struct {
    int ntri;
    double (*tri)[9];
    double extent; /* longest side of a triangle's box */
} cn_map_walls;

static inline int cn_map_brick_at(const cn_map_level *level, const int place[3])
{
    for (int k = 0; k < 3; k++)
        if (place[k] < 0 || place[k] >= level->size[k]) return -1;
    return level->brick[((int64_t)place[2] * level->size[1] + place[1]) * level->size[0] + place[0]];
}

/* Brick and offset in it of a sample; false where there is none. */
static inline bool cn_map_find(const cn_map_level *level, const int i[3], int *brick, int *offset)
{
    const int place[3] = {(i[0] >> 3) + 1, (i[1] >> 3) + 1, (i[2] >> 3) + 1};
    *offset = (i[2] & 7) << 6 | (i[1] & 7) << 3 | (i[0] & 7);
    return (*brick = cn_map_brick_at(level, place)) >= 0;
}
static inline bool cn_map_bit(const uint64_t *mask, int brick, int offset)
{
    return mask[8 * (int64_t)brick + (offset >> 6)] >> (offset & 63) & 1;
}
static inline bool cn_map_free_cell(const cn_map *map, const int i[3])
{
    int brick, offset;
    return cn_map_find(map->level, i, &brick, &offset) && cn_map_bit(map->level->mask, brick, offset);
}

/* Lower bound on the distance to the wall at x [cells], whichever side of it; *certain (may be NULL): x is
 * known to be free. */
double cn_map_lower(const cn_map *map, const double x[3], bool *certain);

/* The rooms of the map, in the order in which they are made. */
cn_status cn_map_level_new(cn_map_level *level, const int size[3]); /* sets size, clears the places */
cn_status cn_map_level_number(cn_map_level *level);                 /* places marked 0 become bricks */
cn_status cn_map_fill(cn_map *map, const cn_world *world, cn_pool *pool);
cn_status cn_map_measure(cn_map *map, const cn_map_walls *walls, cn_pool *pool);
cn_status cn_map_find_ridge(cn_map *map, const cn_world *world, cn_pool *pool);
cn_status cn_map_find_fill(cn_map *map);
/* origin, cell and size are set; the map is made from the world's walls. */
cn_status cn_map_new(cn_map **out, const cn_world *world, const double min[3], const double max[3],
                     double cell, double corridor, cn_pool *pool);
void cn_map_free(cn_map *map);

#endif
