/* plan.h - the planning problem, for any planner, and the path made from its answer. */
#ifndef CN_PLAN_H
#define CN_PLAN_H

#include <stdbool.h>
#include <signal.h>
#include "catnav/path.h"
#include "catnav/world.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct { double centre[3], radius; } cn_ball;

typedef struct {
    const cn_world *world;     /* with its map */
    const cn_path_spec *spec;  /* sampling, turn, clearance, cost, region, deviation */
    double radius;             /* device radius [m]: the centre keeps radius + spec->clearance from walls */
    double device_diameter;    /* for the turn's chord: max(2 device diameters, 4 map cells) */
    int npoint;                /* start, then waypoints, in order (at least 2) */
    const double *point;       /* (npoint x 3) */
    const double *direction;   /* unit direction at the start, NULL: free */
    int nrefused;              /* balls no edge may pass through (limits broken there) */
    const cn_ball *refused;
    unsigned seed;
    int samples;               /* -1: auto */
    double budget;             /* emergency stop [s] */
    int threads;
    const volatile sig_atomic_t *cancel; /* NULL: cannot be cancelled */
} cn_plan_query;

typedef struct {
    int npoint;       /* polyline through the roadmap, point by point */
    double *x;        /* (npoint x 3) */
    int *leg;         /* index of the waypoint each point leads to (npoint) */
    int nvertex;      /* roadmap, for pictures */
    double *vertex;   /* (nvertex x 3) */
    int nedge;
    int *edge;        /* (nedge x 2) */
    bool reproducible;/* false where the emergency budget stopped the search */
    double pinch[3];  /* on CN_ERR_NO_PATH: where, and how wide (radius) */
    double pinch_radius;
    int failed_leg;
} cn_roadmap;
void cn_roadmap_clear(cn_roadmap *roadmap);

/* A roadmap planner: fills *roadmap with a polyline from point 0 through all points. CN_ERR_NO_PATH when
 * samples are used up (pinch filled), CN_ERR_TIMEOUT, CN_ERR_CANCELLED. Only an exact solution counts. */
typedef cn_status (*cn_planner)(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error);

/* Plans with `planner`, then shortens, centres and smooths within clearance, turn limit and region, adds the
 * deviations, and measures. *roadmap is kept for pictures and cleared by the caller. */
cn_status cn_plan_path(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error);

/* The planner over OMPL (src/ompl) with validity from the octree (src/octomap). */
cn_status cn_ompl_planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
