/* Where the free space is: exact answers from the triangles, quick ones from the map where it is sure. */
#include <stdlib.h>
#include <time.h>
#include "catnav/vec3.h"
#include "map.h"
#include "tree.h"
#include "world.h"

static bool behind_plane(const cn_world *world, const double p[3])
{
    for (int i = world->nvessel; i < world->nwall; i++) {
        const cn_wall *wall = world->wall + i;
        double d[3];
        if (!wall->half_space || cn_wall_moves(wall)) continue;
        cn_sub(p, wall->plane, d);
        if (!(cn_dot(d, wall->plane + 3) > 0)) return true;
    }
    return false;
}

bool cn_world_free_at(const cn_world *world, const double p[3])
{
    if (!isfinite(cn_norm2(p))) return false;
    bool inside = world->nvessel == 0;
    for (int i = 0; i < world->nvessel && !inside; i++) {
        const cn_wall *wall = world->wall + i;
        inside = cn_cap_corridor(wall->ncap, wall->cap, p) || cn_tree_inside(wall->tree, wall->cap_tree, p);
    }
    if (!inside || behind_plane(world, p)) return false;
    for (int i = world->nvessel; i < world->nwall; i++)
        if (world->wall[i].closed && !cn_wall_moves(&world->wall[i]) &&
            cn_tree_inside(world->wall[i].tree, NULL, p))
            return false;
    return true;
}

double cn_world_distance(const cn_world *world, const double p[3], int *iwall, int *itri, double nearest[3])
{
    double best = INFINITY, at[3];
    if (iwall) *iwall = -1;
    if (itri) *itri = -1;
    for (int i = 0; i < world->nwall; i++) {
        int tri;
        if (cn_wall_moves(&world->wall[i])) continue;
        const double d = cn_tree_nearest(world->wall[i].tree, p, best, &tri, at);
        if (tri < 0 || !(d < best)) continue;
        best = d;
        if (iwall) *iwall = i;
        if (itri) *itri = tri;
        if (nearest) cn_copy3(at, nearest);
    }
    return best;
}

/* True when p is so near a cap that a short segment from it may pass through the cap or lie in its corridor.
 */
static bool near_cap(const cn_world *world, const double p[3])
{
    const double slack = 4 * world->map->cell;
    for (int i = 0; i < world->nvessel; i++)
        for (int c = 0; c < world->wall[i].ncap; c++) {
            const double *cap = world->wall[i].cap[c], reach = 1.5 * cap[6] + slack;
            double d[3];
            cn_sub(p, cap, d);
            if (cn_norm2(d) <= reach * reach) return true;
        }
    return false;
}

/* Does the short segment from p to a free cell's centre end on the same side of every wall? */
static bool joined(const cn_world *world, const double p[3], const double centre[3])
{
    for (int i = 0; i < world->nwall; i++) {
        const cn_wall *wall = world->wall + i;
        if ((wall->vessel || wall->closed) && !cn_wall_moves(wall) &&
            (cn_tree_crossings(wall->tree, p, centre) & 1))
            return false;
    }
    return true;
}

bool cn_world_free_fast(const cn_world *world, const double p[3])
{
    const cn_map *map = world->map;
    double x[3], centre[3];
    int i[3], best[3] = {0, 0, 0}, brick, offset, most = 0;
    if (!map || map->bare) return cn_world_free_at(world, p);
    for (int k = 0; k < 3; k++) {
        x[k] = (p[k] - map->origin[k]) / map->cell;
        if (!(x[k] >= 0 && x[k] <= map->size[k])) return cn_world_free_at(world, p);
        i[k] = (int)x[k];
    }
    if (near_cap(world, p)) return cn_world_free_at(world, p);
    for (int n = 0; n < 27; n++) { /* the cell itself, then those around it */
        const int m = n == 0 ? 13 : n <= 13 ? n - 1 : n;
        const int c[3] = {i[0] + m % 3 - 1, i[1] + m / 3 % 3 - 1, i[2] + m / 9 - 1};
        if (!cn_map_find(map->level, c, &brick, &offset) || !cn_map_bit(map->level->mask, brick, offset))
            continue;
        const int code = map->level->value[(int64_t)brick * CN_MAP_CELLS + offset];
        double away = 0;
        for (int k = 0; k < 3; k++)
            away += (x[k] - c[k] - 0.5) * (x[k] - c[k] - 0.5);
        const double sure = code * CN_MAP_QUANTUM - 1e-6;
        if (sure > 0 && away < sure * sure) return !behind_plane(world, p);
        if (code > most) most = code, best[0] = c[0], best[1] = c[1], best[2] = c[2];
    }
    if (most == 0) return cn_world_free_at(world, p);
    for (int k = 0; k < 3; k++)
        centre[k] = map->origin[k] + (best[k] + 0.5) * map->cell;
    if (joined(world, p, centre)) return !behind_plane(world, p);
    return cn_world_free_at(world, p);
}

/* --- making the map --- */

#ifndef CN_WORLD_CELLS
#define CN_WORLD_CELLS 40000000 /* fuzzers make do with fewer */
#endif
enum { MOST_CELLS = CN_WORLD_CELLS, MOST_BRICKS = 16000000, MOST_SIDE = 1 << 20 };

static double bricks_of(const double min[3], const double max[3], double cell)
{
    double bricks = 1;
    for (int k = 0; k < 3; k++)
        bricks *= ceil((max[k] - min[k]) / cell / 8) + 2;
    return bricks;
}

/* Cell the device asks for: fine enough for itself and for the vessels. */
static double wanted_cell(const cn_world *world, const double size[3], double radius)
{
    const double asked = world->scene->planner.resolution, side = fmax(fmax(size[0], size[1]), size[2]);
    double volume = 0, area = 0;
    if (asked > 0) return asked;
    if (!world->nvessel) return radius > 0 ? fmin(side / 128, radius) : side / 128;
    for (int i = 0; i < world->nvessel; i++) {
        const cn_surface *s = world->wall[i].surface;
        volume += world->wall[i].doctor.volume;
        for (int t = 0; t < s->ntri; t++) {
            double u[3], v[3], n[3];
            cn_sub(s->vert + 3 * (size_t)s->tri[3 * t + 1], s->vert + 3 * (size_t)s->tri[3 * t], u);
            cn_sub(s->vert + 3 * (size_t)s->tri[3 * t + 2], s->vert + 3 * (size_t)s->tri[3 * t], v);
            cn_cross(u, v, n);
            area += 0.5 * cn_norm(n);
        }
    }
    const double bore = 2 * volume / area; /* mean radius, were it all tubes */
    return radius > 0 ? fmin(radius / 2.7, bore / 8) : bore / 16;
}

cn_status cn_world_map(cn_world *world, double device_radius, int threads, cn_error *error)
{
    struct timespec begin, end;
    double min[3], max[3], size[3], volume = 0;
    cn_pool *pool = NULL;
    if (!(device_radius >= 0 && device_radius < INFINITY) || threads < 1)
        return cn_fail(error, CN_ERR_ARG, NULL, 0,
                       "a map needs a device radius >= 0 and a thread, not %g and %d", device_radius,
                       threads);
    clock_gettime(CLOCK_MONOTONIC, &begin);
    cn_map_free(world->map);
    world->map = NULL;

    for (int k = 0; k < 3; k++)
        min[k] = world->nvessel ? INFINITY : world->min[k],
        max[k] = world->nvessel ? -INFINITY : world->max[k];
    for (int i = 0; i < world->nvessel; i++) { /* the rest of the world is not free anyway */
        const cn_wall *wall = world->wall + i;
        volume += wall->doctor.volume;
        for (int v = 0; v < wall->surface->nvert; v++)
            for (int k = 0; k < 3; k++) {
                min[k] = fmin(min[k], wall->surface->vert[3 * (size_t)v + k]);
                max[k] = fmax(max[k], wall->surface->vert[3 * (size_t)v + k]);
            }
    }
    for (int k = 0; k < 3; k++)
        size[k] = max[k] - min[k];
    double side = fmax(fmax(size[0], size[1]), size[2]);
    if (!(side > 0)) side = device_radius > 0 ? device_radius : 1;
    if (!world->nvessel)
        for (int k = 0; k < 3; k++) {
            min[k] -= 0.25 * side + 4 * device_radius, max[k] += 0.25 * side + 4 * device_radius;
            size[k] = max[k] - min[k];
        }
    const double wanted = wanted_cell(world, size, device_radius), corridor = 2 * device_radius + 4 * wanted;
    for (int i = 0; i < world->nvessel; i++)
        for (int c = 0; c < world->wall[i].ncap; c++) {
            const double *cap = world->wall[i].cap[c], depth = fmin(corridor, cap[6]);
            for (int k = 0; k < 3; k++) {
                const double low = cap[k] + fmin(0, depth * cap[3 + k]),
                             high = cap[k] + fmax(0, depth * cap[3 + k]);
                const double wide = cap[6] * sqrt(fmax(0, 1 - cap[3 + k] * cap[3 + k]));
                min[k] = fmin(min[k], low - wide), max[k] = fmax(max[k], high + wide);
            }
        }
    double cell = wanted;
    if (!world->nvessel) volume = size[0] * size[1] * size[2];
    cell = fmax(cell, cbrt(volume / MOST_CELLS));
    while (bricks_of(min, max, cell) > MOST_BRICKS || side / cell > MOST_SIDE)
        cell *= 1.1;
    if (!(cell > 0 && cell < INFINITY))
        return cn_fail(error, CN_ERR_ARG, NULL, 0, "the walls have no size that a map could be made of");
    const bool coarse = world->nvessel && device_radius > 0 && cell > 2 * device_radius;
    if (coarse && world->scene->planner.resolution > 2 * device_radius)
        return cn_fail(
            error, CN_FAULT_AT_ODDS, NULL, 0,
            "planner.resolution: cells of %g m are wider than the device of %g m: make them no wider",
            world->scene->planner.resolution, 2 * device_radius);
    if (coarse)
        return cn_fail(error, CN_FAULT_UNIT, NULL, 0,
                       "the walls enclose %.3g m^3 in %.3g m, too much for a map as fine as a device of %.3g "
                       "m: are they "
                       "in metres? (scale: 0.001 makes them of millimetres)",
                       volume, side, 2 * device_radius);
    if (cell > wanted)
        CN_LOG(CN_LOG_WARNING, "map: cells of %.3g m instead of %.3g m, to keep their number in bounds", cell,
               wanted);

    cn_status status = cn_pool_new(&pool, threads);
    if (status == CN_OK) status = cn_map_new(&world->map, world, min, max, cell, corridor, pool);
    cn_pool_free(pool);
    clock_gettime(CLOCK_MONOTONIC, &end);
    world->map_s = (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
    if (status != CN_OK)
        return cn_fail(error, status, NULL, 0, "the map cannot be made: %s", cn_status_text(status));
    return CN_OK;
}
