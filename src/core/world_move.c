/* world_move.c - rigid obstacles that go along a path. */
#include "catnav/world.h"

#include <math.h>
#include "catnav/vec3.h"

bool cn_wall_moves(const cn_wall *wall)
{
    return wall->spec && wall->spec->npath > 0;
}

void cn_wall_shift(const cn_wall *wall, double time, double shift[3])
{
    double min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY}, at[3];
    const cn_surface *surface = wall->surface;
    for (int i = 0; i < 3 * surface->nvert; i++) {
        min[i % 3] = fmin(min[i % 3], surface->vert[i]);
        max[i % 3] = fmax(max[i % 3], surface->vert[i]);
    }
    for (int k = 0; k < 3; k++)
        at[k] = 0.5 * (min[k] + max[k]), shift[k] = -at[k];
    double left = fmax(0, time) * (wall->spec ? wall->spec->path_speed : 0);
    for (int i = 0; cn_wall_moves(wall) && i < wall->spec->npath; i++) {
        const double *to = wall->spec->path + 3 * i, way = cn_distance(at, to);
        if (way > left) {
            for (int k = 0; k < 3; k++)
                at[k] += left / way * (to[k] - at[k]);
            break;
        }
        cn_copy3(to, at), left -= way;
    }
    for (int k = 0; k < 3; k++)
        shift[k] += at[k];
}
