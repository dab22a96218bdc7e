/* plan_cases.h - small worlds for planning tests, as a scene would describe them: lengths in metres. */
#ifndef PLAN_CASES_H
#define PLAN_CASES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/octree.h"
#include "catnav/plan.h"

typedef struct {
    cn_scene scene;
    cn_surface_spec vessel, obstacle[3];
    cn_path_spec spec;
    cn_world *world;
    double radius;
} plan_case;

static char case_names[4][8] = {"vessel", "rock0", "rock1", "rock2"};

static inline void case_begin(plan_case *c, double radius)
{
    memset(c, 0, sizeof *c);
    c->radius = radius;
    c->scene.path = c->scene.name = case_names[0];
    c->scene.seed = 1;
    c->scene.step = 0.01;
    c->scene.time_limit = 1;
    c->scene.planner.samples = -1;
    c->scene.planner.budget = 60;
    c->scene.planner.resolution = NAN;
    c->scene.nvessel = 1;
    c->scene.vessel = &c->vessel;
    c->scene.obstacle = c->obstacle;
    c->vessel.name = case_names[0];
    c->vessel.shape.placement.scale = 1;
    c->spec.sampling = CN_SAMPLING_MEDIAL_AXIS;
    c->spec.max_turn = 0.785398163397448;
    c->spec.cost = CN_COST_LENGTH;
}

/* Returns 0 when the world and its map stand. */
static inline int case_end(plan_case *c, int threads)
{
    cn_error error = {0};
    if (cn_world_new(&c->world, &c->scene, 0, NULL, &error) != CN_OK) return 1;
    return cn_world_map(c->world, c->radius, threads, &error) != CN_OK;
}

static inline void case_free(plan_case *c)
{
    cn_world_free(c->world);
}

static inline int case_tube(plan_case *c, double radius, int n, double *axis, double *tube_radius)
{
    case_begin(c, radius);
    c->vessel.shape.kind = CN_SHAPE_TUBE;
    c->vessel.shape.tube.naxis = n;
    c->vessel.shape.tube.axis = axis;
    c->vessel.shape.tube.nradius = n;
    c->vessel.shape.tube.radius = tube_radius;
    return case_end(c, 1);
}

static inline void case_rock(plan_case *c, const double min[3], const double max[3])
{
    cn_surface_spec *rock = &c->obstacle[c->scene.nobstacle++];
    rock->name = case_names[c->scene.nobstacle];
    rock->shape.kind = CN_SHAPE_BOX;
    rock->shape.placement.scale = 1;
    memcpy(rock->shape.box.min, min, sizeof rock->shape.box.min);
    memcpy(rock->shape.box.max, max, sizeof rock->shape.box.max);
}

/* A room of 60 x 30 x 10 mm whose middle is blocked but for a wide arm (9 mm, at y = 0.0045) and a tight one
 * (3 mm, at y = 0.0285); the wide one is the longer way between points at large y. A plug closes the arms. */
static inline int case_fork(plan_case *c, double radius, int plug_wide, int plug_tight, int threads)
{
    case_begin(c, radius);
    c->vessel.shape.kind = CN_SHAPE_BOX;
    const double max[3] = {0.06, 0.03, 0.01};
    memcpy(c->vessel.shape.box.max, max, sizeof max);
    case_rock(c, (double[3]){0.02, 0.009, -0.001}, (double[3]){0.04, 0.027, 0.011});
    if (plug_wide) case_rock(c, (double[3]){0.025, -0.001, -0.001}, (double[3]){0.035, 0.0095, 0.011});
    if (plug_tight) case_rock(c, (double[3]){0.025, 0.0265, -0.001}, (double[3]){0.035, 0.031, 0.011});
    return case_end(c, threads);
}

static inline cn_plan_query case_query(const plan_case *c, int npoint, const double *point)
{
    const cn_plan_query query = {.world = c->world,
                                 .spec = &c->spec,
                                 .radius = c->radius,
                                 .device_diameter = 2 * c->radius,
                                 .npoint = npoint,
                                 .point = point,
                                 .seed = 1,
                                 .samples = -1,
                                 .budget = 60,
                                 .threads = 1};
    return query;
}

/* Axis of a bent tube: straight 20 mm along z, a quarter circle of radius 12 mm towards x, straight 20 mm. */
enum { BENT = 41 };
static inline void bent_axis(double axis[3 * BENT], double radius[BENT], double tube_radius)
{
    for (int i = 0; i < BENT; i++) {
        const double t = (i - 10) / 20.0 * 1.57079632679489662;
        double *a = axis + 3 * i;
        a[1] = 0;
        if (i < 10)
            a[0] = 0, a[2] = 0.002 * i;
        else if (i <= 30)
            a[0] = 0.012 * (1 - cos(t)), a[2] = 0.02 + 0.012 * sin(t);
        else
            a[0] = 0.012 + 0.002 * (i - 30), a[2] = 0.032;
        radius[i] = tube_radius;
    }
}

#endif
