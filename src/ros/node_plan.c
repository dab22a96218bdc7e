/* node_plan.c - one call, from its request to its answer. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "node_parts.h"

#define MESH_WAIT 2.0 /* a mesh whose sender is there may still be on its way this long [s] */

static void nap(double seconds)
{
    const struct timespec t = {.tv_nsec = (long)(seconds * 1e9)};
    nanosleep(&t, NULL);
}

/* What an answer needs from the plan under way. */
typedef struct {
    cn_node *node;
    cn_path *path; /* the device's last */
} run;

static bool run_wants_frame(void *user, int step)
{
    return wants_frame(((run *)user)->node, step);
}
static void run_frame(void *user, const cn_frame *frame)
{
    show_frame(((run *)user)->node, frame);
}

static void run_progress(void *user, const cn_progress *progress)
{
    cn_node *node = ((run *)user)->node;
    const double t = wall_clock();
    pthread_mutex_lock(&node->lock);
    const double past = t - node->progress_at, moved = progress->time - node->progress.time;
    node->real_time_factor = progress->stage == CN_STAGE_MOTION && past > 0 ? fmax(moved, 0) / past : 0;
    node->progress = *progress, node->progress_at = t;
    node->progress.limit = NULL; /* valid here only: copied */
    node->nmargin = progress->nlimit < MARGINS_MOST ? progress->nlimit : MARGINS_MOST;
    for (int i = 0; i < node->nmargin; i++) {
        const cn_limit_report *l = &progress->limit[i];
        node->margin[i] = (cn_ros_margin){.limit = l->limit, .worst = l->step < 0 ? NAN : l->worst};
        memcpy(node->margin[i].body, l->body, sizeof l->body);
    }
    pthread_mutex_unlock(&node->lock);
}

static void run_path(void *user, int body, const cn_path *path, const cn_roadmap *roadmap)
{
    run *r = user;
    if (roadmap) cn_ros_send_roadmap(r->node->ros, r->node->run_frame, (unsigned)body, roadmap);
    if (body != 0 || !path) return;
    cn_ros_send_path(r->node->ros, r->node->run_frame, path);
    cn_path_free(r->path);
    if (cn_path_copy(&r->path, path) != CN_OK) r->path = NULL;
}

void answer_with(cn_ros_answer *answer, const cn_scene *scene, cn_verdict_code code, const cn_error *error)
{
    cn_report_refused(&answer->report, scene, error);
    answer->report.verdict.code = code;
    if (code != CN_VERDICT_BAD_INPUT && code != CN_VERDICT_NO_ARTERY)
        answer->report.verdict.fault = CN_FAULT_NONE;
}

/* Answers one request in a stage that is this plan's. */
static void plan_in(cn_node *node, stage *s, const cn_ros_request *request, const cn_ros_tuning *tuning,
                    cn_ros_answer *answer)
{
    const cn_run_hooks base = {.wants_frame = run_wants_frame,
                               .frame = run_frame,
                               .progress = run_progress,
                               .path = run_path,
                               .cancel = &node->cancel};
    cn_report *report = &answer->report;
    cn_request ask = {.nwaypoint = request->nwaypoint,
                      .waypoint = request->waypoint,
                      .budget = request->budget,
                      .seed = request->scene_seed ? NULL : &request->seed};
    run r = {.node = node};
    cn_run_hooks hooks = base;
    cn_sampling sampling;
    cn_error error = {0};
    overlay limits = {0};

    hooks.user = &r;
    if (!(request->budget >= 0 && request->budget < INFINITY)) {
        cn_fail(&error, CN_FAULT_VALUE, "", 0, "budget is %g s: expected 0 or more", request->budget);
        goto refused;
    }
    if (s->scene->nbody == 0) {
        cn_fail(&error, CN_FAULT_NEEDED, s->scene->path, 0, "scene '%s' has no body to plan for",
                s->scene->name);
        goto refused;
    }
    const cn_body_spec *first = s->scene->body;
    const bool runs =
        request->nwaypoint == 0 && first->nwaypoint == 0 && first->shape.kind != CN_SHAPE_CATHETER;
    if (runs) ask.waypoint = NULL;         /* a scene that just moves under its loads */
    if (request->nwaypoint < 2 && !runs) { /* where they lie is cn_run's to judge */
        cn_fail(&error, CN_FAULT_TOO_FEW, "", 0,
                "%d waypoints: at least two are needed, the entry and a target", request->nwaypoint);
        goto refused;
    }
    if (request->sampling[0]) {
        if (sampling_of(request->sampling, &sampling, &error) != CN_OK) goto refused;
        ask.sampling = &sampling;
    }
    if (overlay_new(&limits, s->scene, tuning, request, &error) != CN_OK) goto refused;
    ask.nlimit = limits.ndevice, ask.limit = limits.device;

    cn_ros_forget_bodies(node->ros);
    if (cn_run(s->world, &ask, cn_ompl_planner, node->threads, &hooks, report, &error) != CN_OK &&
        report->verdict.code == CN_VERDICT_UNKNOWN)
        answer_with(answer, s->scene, error.status == CN_ERR_ARG ? CN_VERDICT_BAD_INPUT : CN_VERDICT_NUMERICS,
                    &error);
    answer->path = r.path;
    overlay_end(&limits);
    return;
refused:
    overlay_end(&limits);
    answer_with(answer, s->scene, CN_VERDICT_BAD_INPUT, &error);
}

/* The stage in force, after a mesh that is on its way has come and been checked; NULL: there is none. */
static stage *await_stage(cn_node *node)
{
    const double start = wall_clock();
    for (;;) {
        pthread_mutex_lock(&node->lock);
        const bool checking = node->checking, known = node->stage || node->refusal[0];
        pthread_mutex_unlock(&node->lock);
        const bool coming = !known && cn_ros_mesh_senders(node->ros) && wall_clock() - start < MESH_WAIT;
        if (cn_cancelled(&node->cancel) || (!checking && !coming)) return stage_take(node);
        nap(0.01);
    }
}

/* The stage of the last mesh that tf could not bring into the node's frame, if the call is in its frame. */
static stage *foreign_stage(cn_node *node, const char *frame)
{
    pthread_mutex_lock(&node->lock);
    stage *s = node->foreign;
    if (s && frames_same(s->frame, frame))
        s->refs++;
    else
        s = NULL;
    pthread_mutex_unlock(&node->lock);
    return s;
}

/* A stage for a request: the node's own, or a scene's inside ~scene_dir with its own vessels; and what brings
 * the request's points into its frame. */
static stage *stage_for(cn_node *node, const cn_ros_request *request, cn_ros_answer *answer,
                        cn_ros_motion *into)
{
    char file[PATH_MAX];
    cn_error error = {0};
    cn_verdict_code code = CN_VERDICT_BAD_INPUT;
    stage *s = NULL, *foreign;

    frames_join(node, "", "", 0, into, NULL);
    if (request->scene[0]) {
        if (scene_inside(node, request->scene, file, &error) == CN_OK)
            stage_new(&s, node, file, 0, NULL, "", true, &error);
    } else if (!(s = await_stage(node)) && !(s = foreign_stage(node, answer->frame))) {
        pthread_mutex_lock(&node->lock);
        if (node->refusal[0]) {
            cn_fail(&error, node->fault ? node->fault : CN_ERR_MESH, "", 0, "%s", node->refusal);
        } else {
            cn_fail(&error, CN_FAULT_NO_PARTS, "", 0, "no artery mesh yet: send one on ~artery_mesh");
            code = CN_VERDICT_NO_ARTERY;
        }
        pthread_mutex_unlock(&node->lock);
    }
    /* what came without a frame is in the node's where tf knows the call's, else in the call's */
    if (s && frames_join(node, answer->frame, s->frame[0] ? s->frame : node->frame, request->stamp, into,
                         &error) != CN_OK) {
        if (!s->frame[0]) {
            frames_join(node, "", "", 0, into, NULL);
        } else {
            foreign = foreign_stage(node, answer->frame);
            if (foreign) frames_join(node, "", "", 0, into, NULL);
            stage_drop(node, s);
            s = foreign;
        }
    }
    if (!s) answer_with(answer, NULL, code, &error);
    if (s)
        snprintf(node->run_frame, sizeof node->run_frame, "%s",
                 into->rest    ? answer->frame
                 : s->frame[0] ? s->frame
                               : node->frame);
    if (s && request->scene[0]) stage_show(node, s, node->run_frame);
    return s;
}

/* Sets whether the call's scene, map and path are still being made; true when it has been cancelled. */
static bool preparing(cn_node *node, bool now)
{
    pthread_mutex_lock(&node->lock);
    node->preparing = now;
    const bool cancelled = node->cancel;
    pthread_mutex_unlock(&node->lock);
    return cancelled;
}

/* Plans with the request's points brought into the stage's frame, and the answer's back. */
static void plan_moved(cn_node *node, stage *s, const cn_ros_request *request, const cn_ros_motion *into,
                       const cn_ros_tuning *tuning, cn_ros_answer *answer)
{
    const size_t size = 3 * (size_t)request->nwaypoint * sizeof(double);
    cn_ros_request moved = *request;
    cn_ros_motion back;
    double *points = malloc(size + 1);

    if (!points) {
        cn_error error = {0};
        cn_fail(&error, CN_ERR_MEMORY, "", 0, "out of memory");
        answer_with(answer, s->scene, CN_VERDICT_NUMERICS, &error);
        return;
    }
    if (request->nwaypoint > 0) memcpy(points, request->waypoint, size);
    frames_move(into, request->nwaypoint, points);
    moved.waypoint = points;
    plan_in(node, s, &moved, tuning, answer);
    frames_inverse(into, &back);
    frames_move_answer(&back, answer);
    free(points);
}

void plan_call(cn_node *node, const cn_ros_request *request, cn_ros_answer *answer)
{
    cn_verdict *verdict = &answer->report.verdict;
    cn_error error = {0};
    cn_ros_motion into;
    stage *s = NULL;

    snprintf(answer->frame, sizeof answer->frame, "%s", request->frame[0] ? request->frame : node->frame);
    snprintf(node->run_frame, sizeof node->run_frame, "%s", answer->frame);
    bool cancelled = preparing(node, true);
    if (!cancelled) s = stage_for(node, request, answer, &into);
    cancelled |= preparing(node, true);
    pthread_mutex_lock(&node->lock);
    const cn_ros_tuning tuning = node->tuning;
    pthread_mutex_unlock(&node->lock);
    if (cancelled) {
        cn_report_clear(&answer->report);
        cn_fail(&error, CN_ERR_CANCELLED, "", 0, "cancelled before the first step");
        answer_with(answer, NULL, CN_VERDICT_CANCELLED, &error);
    } else if (s) {
        plan_moved(node, s, request, &into, &tuning, answer);
    }
    preparing(node, false);

    pthread_mutex_lock(&node->lock);
    if (s && s != node->foreign && node->refusal[0] &&
        !request->scene[0]) { /* the answer is for an older mesh */
        const size_t used = strlen(verdict->message);
        snprintf(verdict->message + used, sizeof verdict->message - used,
                 " (on the last good artery mesh; later: %.400s)", node->refusal);
    }
    snprintf(node->verdict, sizeof node->verdict, "%s", cn_verdict_name(verdict->code));
    pthread_mutex_unlock(&node->lock);
    answer->json = answer_json(node, s, request, node->run_frame, &tuning, &answer->report);
    forget_shown(node);
    stage_drop(node, s);
    CN_LOG(CN_LOG_INFO, "%s: %s", cn_verdict_name(verdict->code), verdict->message);
}
