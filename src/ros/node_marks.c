/* node_marks.c - waypoints set by mouse: added where rviz was clicked, moved, inserted, deleted, judged,
 * planned through, saved and loaded. Theirs is the node's frame; the first is the entry. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "node_parts.h"

/* Why a waypoint may not stand there, "" where it may. */
static void judge(const stage *s, const double p[3], char *why, size_t size)
{
    why[0] = 0;
    if (!s) {
        snprintf(why, size, "no artery mesh yet");
        return;
    }
    const double d = cn_world_distance(s->world, p, NULL, NULL, NULL);
    const bool catheter = s->scene->nbody > 0 && s->scene->body[0].shape.kind == CN_SHAPE_CATHETER;
    const double radius = catheter ? s->scene->body[0].shape.catheter.diameter / 2 : 0;
    if (!cn_world_free_at(s->world, p))
        snprintf(why, size, "outside the lumen, %.3g mm from its wall", 1e3 * d);
    else if (d < radius)
        snprintf(why, size, "%.3g mm from the wall, the device's radius is %.3g mm", 1e3 * d, 1e3 * radius);
}

/* Moves p onto the medial axis of the lumen it lies in or on: the nearest point of the ridge whose ball holds
 * it, else the one whose ball comes nearest. False: there is no map. */
static bool snap(const stage *s, double p[3])
{
    const double *x, *clearance;
    double best = INFINITY;
    bool held = false;
    int found = -1;
    const int n = s && s->world->map ? cn_map_ridge(s->world->map, &x, &clearance) : 0;
    for (int i = 0; i < n; i++) {
        const double d = cn_distance(p, x + 3 * i);
        const bool holds = d <= clearance[i];
        const double away = holds ? d : d - clearance[i];
        if (holds < held || (holds == held && !(away < best))) continue;
        held = holds, best = away, found = i;
    }
    if (found >= 0) cn_copy3(x + 3 * found, p);
    return found >= 0;
}

static void changed(cn_node *node) /* the lock is held */
{
    node->marks_changed = true;
}

/* Puts p in as waypoint number `at`; false: the list is full. */
static bool put_in(cn_node *node, int at, const double p[3])
{
    if (node->nmark == MARKS_MOST) return false;
    memmove(node->mark + 3 * (at + 1), node->mark + 3 * at, 3 * (size_t)(node->nmark - at) * sizeof(double));
    cn_copy3(p, node->mark + 3 * at);
    node->nmark++;
    changed(node);
    return true;
}

/* True when p, given in `frame`, is finite and now in the node's own. */
static bool to_own_frame(cn_node *node, const char *frame, double p[3])
{
    cn_error error = {0};
    cn_ros_motion motion;
    if (!isfinite(p[0] + p[1] + p[2])) return false;
    if (frames_join(node, frame, node->frame, 0, &motion, &error) != CN_OK) {
        CN_LOG(CN_LOG_ERROR, "waypoint: %s", error.message);
        return false;
    }
    frames_move(&motion, 1, p);
    return true;
}

void on_click(void *user, const char *frame, const double point[3])
{
    cn_node *node = user;
    double p[3] = {point[0], point[1], point[2]};
    if (!to_own_frame(node, frame, p)) return;
    stage *s = stage_take(node);
    snap(s, p);
    stage_drop(node, s);
    pthread_mutex_lock(&node->lock);
    const bool full = !put_in(node, node->nmark, p);
    pthread_mutex_unlock(&node->lock);
    if (full) CN_LOG(CN_LOG_WARNING, "waypoint not added: there are %d, as many as may be", MARKS_MOST);
}

/* A call with the waypoints as they are, from nobody: its answer goes to the log. */
static void plan_marks(cn_node *node)
{
    pthread_mutex_lock(&node->lock);
    const bool busy = node->own_open;
    if (!busy) {
        memcpy(node->own_point, node->mark, 3 * (size_t)node->nmark * sizeof(double));
        node->own = (cn_ros_request){.frame = node->frame,
                                     .nwaypoint = node->nmark,
                                     .waypoint = node->own_point,
                                     .sampling = "",
                                     .scene = "",
                                     .scene_seed = true};
        node->own_open = true;
    }
    pthread_mutex_unlock(&node->lock);
    if (busy)
        CN_LOG(CN_LOG_WARNING, "the plan through the waypoints is under way already");
    else
        on_plan(node, OWN_CALL, &node->own);
}

void on_mark(void *user, cn_ros_mark_event event, int at, const char *frame, const double point[3])
{
    cn_node *node = user;
    double p[3] = {0};
    if (point) {
        cn_copy3(point, p);
        if (!to_own_frame(node, frame, p)) return;
    }
    if (event == CN_ROS_MARK_PLAN) {
        plan_marks(node);
        return;
    }
    stage *s = stage_take(node);
    pthread_mutex_lock(&node->lock);
    if (event == CN_ROS_MARK_CLEAR) {
        node->nmark = 0;
        changed(node);
    } else if (at >= 0 && at < node->nmark) {
        double *mark = node->mark + 3 * at;
        switch (event) {
        case CN_ROS_MARK_DRAGGED: /* shown when it is dropped: a mark that is replaced slips out of the hand
                                   */
            cn_copy3(p, mark);
            break;
        case CN_ROS_MARK_DROPPED:
            if (point) cn_copy3(p, mark);
            changed(node);
            break;
        case CN_ROS_MARK_SNAP:
            snap(s, mark);
            changed(node);
            break;
        case CN_ROS_MARK_DELETE:
            memmove(mark, mark + 3, 3 * (size_t)(node->nmark - at - 1) * sizeof(double));
            node->nmark--;
            changed(node);
            break;
        default: /* CN_ROS_MARK_INSERT: amid this one and the next, the last one and the one before */
            if (node->nmark < 2) break;
            if (at == node->nmark - 1) at--, mark -= 3;
            for (int k = 0; k < 3; k++)
                p[k] = 0.5 * (mark[k] + mark[k + 3]);
            snap(s, p);
            put_in(node, at + 1, p);
        }
    }
    pthread_mutex_unlock(&node->lock);
    stage_drop(node, s);
}

void marks_show(cn_node *node)
{
    static const char *const none = "";
    double x[3 * MARKS_MOST];
    char why[MARKS_MOST][96];
    const char *reason[MARKS_MOST];

    pthread_mutex_lock(&node->lock);
    const bool wanted = node->marks_changed;
    const int n = node->nmark;
    memcpy(x, node->mark, 3 * (size_t)n * sizeof(double));
    node->marks_changed = false;
    pthread_mutex_unlock(&node->lock);
    if (!wanted) return;
    stage *s = stage_take(node);
    double size = 2e-3;
    if (s && s->scene->nbody > 0 && s->scene->body[0].shape.kind == CN_SHAPE_CATHETER)
        size = 1.5 * s->scene->body[0].shape.catheter.diameter;
    for (int i = 0; i < n; i++) {
        judge(s, x + 3 * i, why[i], sizeof why[i]);
        reason[i] = why[i][0] ? why[i] : none;
    }
    stage_drop(node, s);
    cn_ros_send_marks(node->ros, node->frame, n, x, reason, size);
}

/* --- files --- */
static void reply(cn_node *node, cn_ros_file_reply *out, bool success, const cn_error *error,
                  const char *done)
{
    out->success = success;
    snprintf(out->message, sizeof out->message, "%.1000s", success ? done : error->message);
    pthread_mutex_lock(&node->lock);
    out->nwaypoint = node->nmark;
    memcpy(out->waypoint, node->mark, 3 * (size_t)node->nmark * sizeof(double));
    pthread_mutex_unlock(&node->lock);
}

/* Where a scene of that name is to be written, and the file its text comes from: itself, or the node's scene,
 * from whose folder the files that it names are looked for. */
static cn_status scene_to_write(const cn_node *node, const char *scene, char to[PATH_MAX], const char **from,
                                cn_error *error)
{
    char folder[PATH_MAX], own[PATH_MAX];
    const char *const slash = strrchr(scene, '/'), *const base = slash ? slash + 1 : scene;
    const char *const dot = strrchr(base, '.');
    cn_status status;

    if (!dot || dot == base || (strcmp(dot, ".yaml") && strcmp(dot, ".yml")))
        return cn_fail(error, CN_FAULT_OPTION, "", 0, "scene '%s': expected a name that ends in .yaml",
                       scene);
    if (scene_inside(node, scene, to, NULL) == CN_OK) {
        *from = to;
        return CN_OK;
    }
    if ((status = folder_inside(node, scene, folder, error)) != CN_OK) return status;
    if (snprintf(to, PATH_MAX, "%s/%s", folder, base) >= PATH_MAX)
        return cn_fail(error, CN_FAULT_OPTION, "", 0, "scene '%.60s...': the path is too long", scene);
    *from = node->scene_file;
    if (!realpath(node->scene_file, own))
        return cn_fail(error, CN_FAULT_MISSING_FILE, "", 0, "the node has no scene");
    *strrchr(own, '/') = 0;
    if (strcmp(own, folder))
        return cn_fail(error, CN_FAULT_OUTSIDE, "", 0,
                       "scene '%s' is not there yet, and a copy of %s outside its folder would not find its "
                       "files: save beside it, or over a scene",
                       scene, node->scene_file);
    return CN_OK;
}

void on_save(void *user, const char *scene, cn_ros_file_reply *out)
{
    cn_node *node = user;
    cn_error error = {0};
    char to[PATH_MAX], done[PATH_MAX + 32];
    double x[3 * MARKS_MOST];
    const char *from = NULL;

    pthread_mutex_lock(&node->lock);
    const int n = node->nmark;
    memcpy(x, node->mark, 3 * (size_t)n * sizeof(double));
    pthread_mutex_unlock(&node->lock);
    cn_status status = scene_to_write(node, scene, to, &from, &error);
    if (status == CN_OK) status = cn_scene_write_waypoints(from, to, n, x, &error);
    snprintf(done, sizeof done, "%d waypoints saved to %s", n, to);
    reply(node, out, status == CN_OK, &error, done);
}

void on_load(void *user, const char *name, cn_ros_file_reply *out)
{
    cn_node *node = user;
    cn_error error = {0};
    cn_scene *scene = NULL;
    char file[PATH_MAX], done[PATH_MAX + 32] = "";

    cn_status status = scene_inside(node, name, file, &error);
    if (status == CN_OK) status = cn_scene_read(&scene, file, 0, NULL, &error);
    if (status == CN_OK && scene->nbody == 0)
        status = cn_fail(&error, CN_FAULT_NEEDED, file, 0, "the scene has no body");
    if (status == CN_OK && scene->body[0].nwaypoint >= MARKS_MOST)
        status = cn_fail(&error, CN_FAULT_TOO_LARGE, file, 0, "the scene has %d waypoints, more than %d",
                         scene->body[0].nwaypoint, MARKS_MOST - 1);
    if (status == CN_OK) {
        const cn_body_spec *body = &scene->body[0];
        const bool catheter = body->shape.kind == CN_SHAPE_CATHETER;
        pthread_mutex_lock(&node->lock);
        cn_copy3(catheter ? body->shape.catheter.entry : body->shape.placement.translate, node->mark);
        memcpy(node->mark + 3, body->waypoint, 3 * (size_t)body->nwaypoint * sizeof(double));
        node->nmark = body->nwaypoint + 1;
        changed(node);
        pthread_mutex_unlock(&node->lock);
        snprintf(done, sizeof done, "%d waypoints from %s", body->nwaypoint + 1, file);
    }
    cn_scene_free(scene);
    reply(node, out, status == CN_OK, &error, done);
}
