/* contact_place.h - surfaces in contact, without a step: bodies of meshes made in code, walls of a scene. */
#ifndef CONTACT_PLACE_H
#define CONTACT_PLACE_H

#include "contact.h"
#include "shapes.h"

/* x and nfree as contact takes them: bodies first, then rigid walls. */
typedef struct {
    cn_scene scene; /* what to change before place_world */
    cn_surface_spec vessel, obstacle;
    cn_world *world;
    int nbody;
    cn_body *body[2];
    cn_contact_model *model;
    cn_contact *contact;
    double *x;
    int nfree[4];
} place;

/* Bodies inside a box-shaped vessel [-1, 1]^3 times `half` (0: none), at rest; barriers from `gap` on, of the
 * second from 0.8 of it. */
void place_make(place *p, int nbody, cn_tets *const *mesh, double half, double gap, bool self);
/* The same in three parts, of a zeroed place. A vessel or obstacle of the scene is what its spec says;
 * `given` (NULL: none) takes the vessel's place. */
void place_world(place *p, const cn_surface *given);
void place_bodies(place *p, int nbody, cn_tets *const *mesh);
void place_contact(place *p, int nbody, const cn_contact_body *body, const unsigned char *moving);
void place_free(place *p);

double *place_points(place *p, int surface);
void place_shift(place *p, int surface, double dx, double dy, double dz);
void place_turn(place *p, int surface, const double r[9]); /* about the origin */
void place_find(place *p, const double *dx, double reach); /* with room for all pairs */
double place_add(place *p, double *f);                     /* energy and force */
cn_findings place_check(place *p);
/* The force at all points of bodies against differences of the energy by h. */
void place_gradient_is_right(place *p, double h, double tolerance);

#endif
