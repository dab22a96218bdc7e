/* world_move.c - rigid obstacles that go along a path. */
#include "catnav/world.h"

#include <math.h>
#include "catnav/vec3.h"

bool cn_wall_moves(const cn_wall *wall)
{
    return wall->spec && wall->spec->npath > 0;
}

double cn_wall_arrives(const cn_wall *wall)
{
    const double *from = wall->middle;
    double way = 0;
    if (!cn_wall_moves(wall)) return 0;
    for (int i = 0; i < wall->spec->npath; from = wall->spec->path + 3 * i++)
        way += cn_distance(from, wall->spec->path + 3 * i);
    return way / wall->spec->path_speed;
}

void cn_wall_shift(const cn_wall *wall, double time, double shift[3])
{
    double at[3], left = fmax(0, time) * (wall->spec ? wall->spec->path_speed : 0);
    cn_copy3(wall->middle, at);
    for (int i = 0; cn_wall_moves(wall) && i < wall->spec->npath; i++) {
        const double *to = wall->spec->path + 3 * i, way = cn_distance(at, to);
        if (way > left) {
            for (int k = 0; k < 3; k++)
                at[k] += left / way * (to[k] - at[k]);
            break;
        }
        cn_copy3(to, at), left -= way;
    }
    cn_sub(at, wall->middle, shift);
}
