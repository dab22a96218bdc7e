/* world.h - what the files of the world's room share. */
#ifndef CN_CORE_WORLD_H
#define CN_CORE_WORLD_H

#include "catnav/world.h"

/* Closes each boundary loop of an outward surface by a fan about its centroid: fills caps, cap_of, cap, ncap
 * and cap_tree of the wall. The surface stays as it is. */
cn_status cn_wall_cap(cn_wall *wall);
/* Apexes of the fans [in vert] and the caps' measures where the rims lie as vert (as the wall's caps) has
 * them.
 */
void cn_wall_measure_caps(const cn_wall *wall, double *vert, double (*cap)[7]);
/* True when p lies in the corridor beyond a cap. */
bool cn_cap_corridor(int ncap, double (*cap)[7], const double p[3]);
void cn_map_free(cn_map *map); /* NULL is fine */

#endif
