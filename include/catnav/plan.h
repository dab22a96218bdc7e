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

/* True once a thread or a signal handler has set *cancel (NULL: never). */
static inline bool cn_cancelled(const volatile sig_atomic_t *cancel)
{
    return cancel && __atomic_load_n(cancel, __ATOMIC_RELAXED) != 0;
}

typedef struct {
    double centre[3], radius;
} cn_ball;

typedef struct {
    const cn_world *world;    /* with its map */
    const cn_path_spec *spec; /* sampling, turn, clearance, cost, region, deviation */
    double radius;            /* device radius [m]: the centre keeps radius + spec->clearance from walls */
    double device_diameter;   /* for the turn's chord: max(2 device diameters, 4 map cells) */
    int npoint;               /* start, then waypoints, in order (at least 2) */
    const double *point;      /* (npoint x 3) */
    const double *direction;  /* unit direction at the start, NULL: free */
    int nrefused;             /* balls no edge may pass through (limits broken there) */
    const cn_ball *refused;
    unsigned seed;
    int seeds; /* tried side by side, as many at a time as threads, the best kept; 0: one, the query's own */
    int samples;   /* -1: auto */
    double budget; /* emergency stop [s] */
    int threads;
    const volatile sig_atomic_t *cancel; /* NULL: cannot be cancelled */
} cn_plan_query;

typedef struct {
    int npoint;     /* polyline through the roadmap, point by point */
    double *x;      /* (npoint x 3) */
    int *leg;       /* index in query->point of the point each leads to; 0: start (npoint) */
    int nvertex;    /* roadmap, for pictures */
    double *vertex; /* (nvertex x 3) */
    int nedge;
    int *edge;         /* (nedge x 2) */
    unsigned seed;     /* of the path kept */
    bool reproducible; /* false where the emergency budget stopped a search */
    double pinch[3];   /* on CN_ERR_NO_PATH: where, and how wide (radius) */
    double pinch_radius;
    int failed_leg;
} cn_roadmap;
void cn_roadmap_clear(cn_roadmap *roadmap);

/* A roadmap planner: fills *roadmap with a polyline from point 0 through all points. CN_ERR_NO_PATH when
 * samples are used up (pinch filled), CN_ERR_TIMEOUT, CN_ERR_CANCELLED. Only an exact solution counts. */
typedef cn_status (*cn_planner)(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error);

/* --- what every planner asks the core --- */
/* True distance from p to the walls [m], 0 outside the free space: the map's lower bound where that is at
 * least `enough`, else exact against the triangles. */
double cn_plan_clearance(const cn_plan_query *query, const double p[3], double enough);
/* True when the centre may go straight from a to b: clearance at least `need` all along (marched by the
 * clearance itself, finest step need/100), no refused ball met, region kept within `slack`. */
bool cn_plan_edge_free(const cn_plan_query *query, const double a[3], const double b[3], double need,
                       double slack);
/* How far p lies outside the spec's region [m]; 0 in it, or without one. toward (may be NULL): unit vector
 * back into it. A plane is a region to lie on, a box to lie in, a band to keep a distance from its surface
 * in. */
double cn_plan_region(const cn_plan_query *query, const double p[3], double toward[3]);
/* The region is soft: a planner allows what the farthest of the query's own points needs, at least a cell. */
double cn_plan_region_slack(const cn_plan_query *query);

/* Plans with `planner` (which several threads call at once where there are seeds), then shortens, centres and
 * smooths within clearance, turn limit and region, adds the deviations, and measures. Of several seeds' paths
 * the gentlest is kept, where all turn little enough the one of least cost, of equal ones the first: the same
 * for any number of threads. *roadmap is kept for pictures and cleared by the caller. */
cn_status cn_plan_path(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error);

/* The planner over OMPL (src/ompl) with validity from the octree (src/octomap). */
cn_status cn_ompl_planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
