/* plan_smooth.h - the parts of planning below cn_plan_path, private to the core. */
#ifndef CN_PLAN_SMOOTH_H
#define CN_PLAN_SMOOTH_H

#include <stdio.h>
#include "catnav/plan.h"

/* cn_plan_path by the query's own seed alone, without a word where it turns too much. */
cn_status cn_plan_once(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error);

/* Turns the roadmap's polyline into a path of least bending that keeps its room: through every point of the
 * query, along its direction, refused balls and region kept. */
cn_status cn_plan_smooth(cn_path **out, const cn_plan_query *query, const cn_roadmap *roadmap,
                         cn_error *error);

/* Replaces *path by one with the spec's sinusoids added, faded at the query's points and shrunk where room
 * lacks. */
cn_status cn_plan_deviate(cn_path **path, const cn_plan_query *query, cn_error *error);

/* Exact clearance [m] of the n points x (n x 3) into `clearance` (n); true when the polyline keeps radius +
 * clearance from all walls and out of refused balls; broken (n - 1, may be NULL): the segments that do not.
 */
bool cn_plan_keeps(const cn_plan_query *query, int n, const double *x, double *clearance, bool *broken);

/* Length of the chords between which the turn is measured [m]. */
double cn_plan_chord(const cn_plan_query *query);

#endif
