/* plan_avoid.h - when a body may go where on its path, past obstacles that go along paths of their own. */
#ifndef CN_PLAN_AVOID_H
#define CN_PLAN_AVOID_H

#include "catnav/plan.h"
#include "sim.h"

typedef struct cn_avoid cn_avoid;

/* Where a body and an obstacle would come too near each other, were the body to go straight on. */
typedef struct {
    int wall;        /* of the world; -1: none does */
    double time;     /* when they are nearest [s] */
    double distance; /* then [m] */
    double least;    /* that they are to keep [m] */
    double x[3];     /* the goal node's place then [m] */
    cn_ball ball;    /* the obstacle then, and what to keep from it: no other path should enter it */
} cn_meeting;

/* *out is NULL where no wall moves. keep [m]: at least between the surfaces, more where the path's clearance
 * leaves the body more. World and body must outlive it. */
cn_status cn_avoid_new(cn_avoid **out, const cn_world *world, const cn_model_body *body, double keep);
void cn_avoid_free(cn_avoid *avoid);
/* Time for which an answer holds [s]. */
double cn_avoid_tick(const cn_avoid *avoid);
/* From where `state` is at `time`: *until is the arc length to which the drive may aim now: INFINITY to go
 * on, where the body is to wait, less to turn back. *meeting.wall is -1 where it may go straight on. The
 * answer CN_ERR_NO_PATH: however it waits or turns back on this path, it comes too near. */
cn_status cn_avoid_look(cn_avoid *avoid, const cn_body_state *state, const cn_path *path, double time,
                        double *until, cn_meeting *meeting);

#endif
