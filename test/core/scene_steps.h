/* scene_steps.h - a scene given as text, stepped without a run around it. */
#ifndef SCENE_STEPS_H
#define SCENE_STEPS_H

#include "catnav/scene.h"
#include "sim.h"

typedef struct {
    cn_scene *scene;
    cn_world *world;
    cn_body_spec *spec; /* the scene's bodies, and its walls that give way */
    cn_model *model;
    cn_state *state, *trial;
    cn_pool *pool;
    cn_work *work;
    cn_step_figures figures[8]; /* of the last step, by bodies; the first's residual is recomputed */
} scene_steps;

/* Fails the test where the scene is refused. All bodies are solved together. */
void scene_steps_new(scene_steps *s, const char *text, int nsetting, const cn_setting *setting);
cn_status scene_steps_try(scene_steps *s);  /* on failure the state is as before */
void scene_steps_go(scene_steps *s, int n); /* n steps; fails the test where one fails */
void scene_steps_free(scene_steps *s);

/* Of body b as it is now: mass [kg], centre [m], velocity of the centre [m/s], kinetic energy [J]. */
typedef struct {
    double mass, centre[3], velocity[3], kinetic;
} scene_motion;
scene_motion scene_steps_motion(const scene_steps *s, int b);

#endif
