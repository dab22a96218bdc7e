/* run.h - a whole run: plan, drive, limits, roll back and replan, verdict. The command and the node both call
 * this. */
#ifndef CN_RUN_H
#define CN_RUN_H

#include <signal.h>
#include "catnav/body.h"
#include "catnav/plan.h"
#include "catnav/report.h"
#include "catnav/skin.h"
#include "catnav/world.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A deforming body (or deformable wall) as it is now; all pointers are valid during the callback only. */
typedef struct {
    const char *name;
    const cn_body *body;       /* topology: npoint, point (at rest), tet, mid, boundary */
    int nactive;               /* points out of the sheath */
    const double *x;           /* positions of the points [m] (npoint x 3) */
    const double *von_mises;   /* as cn_body_measure fills it [Pa] */
    double stress_limit;       /* its limit [Pa], INFINITY: none */
    const cn_skin *skin;       /* that it wears, NULL: none */
    const cn_skin_state *worn; /* the skin as it is now */
} cn_frame_body;

typedef struct {
    int step;
    double time; /* [s] */
    int nbody;
    const cn_frame_body *body;
} cn_frame;

typedef enum { CN_STAGE_MESH, CN_STAGE_MAP, CN_STAGE_PLAN, CN_STAGE_MOTION } cn_stage;
typedef struct {
    cn_stage stage;
    int waypoint, nwaypoint; /* reached so far, in all */
    double time, time_limit; /* simulated [s] */
    int step, replans;
    double steps_per_s;
    double margin;         /* to the nearest limit: 1 - worst value/limit; INFINITY: no limit */
    const char *margin_of; /* name of that quantity, "" */
    int nlimit;            /* every limit with its worst value so far, valid during the callback */
    const cn_limit_report *limit;
} cn_progress;

typedef struct {
    void *user;
    /* After every accepted step, and once before the first (step 0). with_stress is asked first: stress is
     * computed only when some frame wants it or a limit needs it. */
    bool (*wants_frame)(void *user, int step);
    void (*frame)(void *user, const cn_frame *frame);
    void (*progress)(void *user, const cn_progress *progress); /* several times a second of wall time */
    void (*path)(void *user, int body, const cn_path *path, const cn_roadmap *roadmap); /* at each (re)plan */
    const volatile sig_atomic_t *cancel; /* non-zero: stop within a step */
} cn_run_hooks;                          /* any of them may be NULL */

/* What a request changes about the scene's first body (the device). */
typedef struct {
    int nwaypoint;
    const double *waypoint; /* (nwaypoint x 3); the first replaces the entry; NULL: the scene's */
    int nlimit;             /* added to the scene's; the same quantity and reduce replaces it */
    const cn_limit *limit;
    const cn_sampling *sampling; /* NULL: the scene's */
    double budget;               /* planning [s]; 0: the scene's */
    const unsigned *seed;        /* NULL: the scene's */
} cn_request;

/* Runs the scene in its world (the map is made if it is not there yet: then world must not be shared).
 * request NULL: as the scene says. *report is always filled, its verdict set; the return value is CN_OK
 * whenever the report holds the answer (also for infeasible or failed runs), else CN_ERR_MEMORY or
 * CN_ERR_ARG. */
cn_status cn_run(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                 const cn_run_hooks *hooks, cn_report *report, cn_error *error);
/* Fills the report for a scene that never ran: refused at a door. */
void cn_report_refused(cn_report *report, const cn_scene *scene, const cn_error *error);
/* Path alone, for `catnav plan`: of the first body with waypoints. */
cn_status cn_run_plan(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                      cn_path **path, cn_report *report, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
