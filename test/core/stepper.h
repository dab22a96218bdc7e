/* stepper.h - one body under the step without a scene file: statics and dynamics of meshes made in code. */
#ifndef STEPPER_H
#define STEPPER_H

#include <jansson.h>
#include "shapes.h"
#include "sim.h"

typedef struct {
    cn_scene scene; /* what to change before stepper_make */
    cn_body_spec spec;
    cn_load load; /* none yet: its nodal forces are `force` */
    cn_world world;
    cn_model *model;
    cn_state *state, *trial;
    cn_work *work;
    cn_pool *pool;
    const cn_body *body;
    cn_body_state *now;     /* of `state` */
    double *force;          /* further force on the nodes [N] (nnode x 3); set it as you like */
    unsigned char *held;    /* nodes that stay where they are (nnode) */
    cn_step_figures figure; /* of the last step; its residual is recomputed apart */
    cn_error error;
    char file[80];
} stepper;

/* Fills scene and spec: no gravity, Newton's method to 1e-13, implicit Euler steps of dt [s]. */
void stepper_set(stepper *s, cn_material material, double dt);
/* Model and state at rest, of the mesh, or (NULL) of the shape that is in spec. What is refused leaves
 * s->error; stepper_free is due in any case. */
cn_status stepper_make(stepper *s, const cn_tets *mesh);
/* One step; on failure the state is as before. */
cn_status stepper_try(stepper *s);
void stepper_step(stepper *s); /* fails the test where it fails */
void stepper_free(stepper *s);

/* What a body holds: momentum [kg m/s] and, about the centre of mass, angular momentum [kg m^2/s]. */
typedef struct {
    double mass, centre[3], linear[3], angular[3], kinetic, elastic;
} stepper_motion;
stepper_motion stepper_moves(const stepper *s);

/* Files of the reference folder; NULL where it does not hold the file. */
json_t *reference_json(const char *name);
double json_number(const json_t *object, const char *key); /* must be there */
int json_numbers(const json_t *object, const char *key,
                 double *out); /* of nested arrays in a row; how many */

#endif
