/* node_show.c - what is seen while a plan runs: frames at most at ~frame_rate, and diagnostics. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "node_parts.h"

double wall_clock(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int marker_stride(cn_node *node, int ntri)
{
    const int stride = ntri <= node->triangles ? 1 : (ntri - 1) / node->triangles + 1;
    if (stride > 1) {
        pthread_mutex_lock(&node->lock);
        node->triangles_left_out += ntri - ((ntri - 1) / stride + 1);
        pthread_mutex_unlock(&node->lock);
    }
    return stride;
}

bool wants_frame(cn_node *node, int step)
{
    const double t = wall_clock();
    pthread_mutex_lock(&node->lock);
    const bool wanted = step == 0 || t - node->last_frame >= node->frame_period;
    if (wanted) node->last_frame = t;
    if (wanted)
        node->frames_sent++;
    else
        node->frames_dropped++;
    node->preparing = false; /* it moves: a cancel is answered with what was reached */
    pthread_mutex_unlock(&node->lock);
    return wanted;
}

/* Announces the skin of a body that is met first, as NAME_skin. */
static bool announce_skin(cn_node *node, const cn_frame_body *b, shown *s)
{
    char name[80];
    const size_t nvert = (size_t)b->skin->nvert;
    s->skin_stress = calloc(nvert, sizeof *s->skin_stress);
    s->scratch = calloc((size_t)b->body->nnode + nvert, sizeof *s->scratch);
    s->hangs_on = calloc(nvert, sizeof *s->hangs_on);
    s->skin_tri = calloc(3 * (size_t)b->skin->ntri, sizeof *s->skin_tri);
    if (!s->skin_stress || !s->scratch || !s->hangs_on || !s->skin_tri) return false;
    for (size_t r = 0; r < nvert; r++)
        s->hangs_on[b->skin->vertex[r]] = b->skin->anchor[r * (size_t)b->skin->nper];
    s->skin_id = ++node->last_id;
    snprintf(name, sizeof name, "%s_skin", b->name);
    cn_ros_send_topology(node->ros, node->run_frame, name, s->skin_id, 0, NULL, b->skin->ntri, b->skin->tri);
    return true;
}

static void clear_shown(shown *s)
{
    free(s->stress), free(s->skin_stress), free(s->scratch), free(s->hangs_on), free(s->skin_tri);
}

/* The body's place among those shown; a body met first is announced with its topology. */
static shown *find_shown(cn_node *node, const cn_frame_body *b)
{
    for (int i = 0; i < node->nshown; i++)
        if (node->shown[i].body == b->body) return &node->shown[i];

    shown *list = realloc(node->shown, (size_t)(node->nshown + 1) * sizeof *list);
    if (!list) return NULL;
    node->shown = list;
    shown *s = &list[node->nshown];
    *s = (shown){.body = b->body, .stress = calloc((size_t)b->body->npoint, sizeof(float))};
    if (!s->stress || (b->skin && !announce_skin(node, b, s))) {
        clear_shown(s);
        return NULL;
    }
    s->id = ++node->last_id;
    node->nshown++;
    snprintf(s->name, sizeof s->name, "%s", b->name);
    s->npoint = b->body->npoint, s->ntet = b->body->ntet;
    s->sum = checksum(s->npoint, b->body->point, 4 * s->ntet, b->body->tet);
    cn_ros_send_topology(node->ros, node->run_frame, b->name, s->id, b->body->ntet, b->body->tet,
                         b->body->boundary->ntri, b->body->boundary->tri);
    return s;
}

void forget_shown(cn_node *node)
{
    for (int i = 0; i < node->nshown; i++)
        clear_shown(&node->shown[i]);
    free(node->shown);
    node->shown = NULL, node->nshown = 0;
}

/* Largest von Mises stress of each vertex's cells: what breaks a limit is never averaged away. */
static void vertex_stress(shown *s, const double *von_mises)
{
    const cn_body *b = s->body;
    memset(s->stress, 0, (size_t)b->npoint * sizeof(float));
    for (int e = 0; von_mises && e < cn_body_cells(b); e++) {
        const float stress = (float)von_mises[e];
        if (von_mises[e] > s->highest) s->highest = von_mises[e];
        for (int k = 0; k < (b->mid ? 10 : b->ntet ? 4 : 3); k++) {
            float *at = s->stress + (!b->ntet ? b->boundary->tri[3 * e + k]
                                     : k < 4  ? b->tet[4 * e + k]
                                              : b->mid[6 * e + k - 4]);
            if (stress > *at) *at = stress;
        }
    }
}

/* In rviz the skin stands in the body's place; what hangs on nodes in the sheath is not shown. */
static void show_skin(cn_node *node, const cn_frame *frame, const cn_frame_body *b, shown *s, double full)
{
    const cn_skin *skin = b->skin;
    const int out = b->nactive < 1                  ? 0
                    : b->nactive >= b->body->npoint ? b->body->nnode
                                                    : cn_body_node_of(b->body, b->nactive - 1) + 1;
    int ntri = 0;
    for (int t = 0; t < skin->ntri; t++) {
        const int *corner = skin->tri + 3 * t;
        if (s->hangs_on[corner[0]] < out && s->hangs_on[corner[1]] < out && s->hangs_on[corner[2]] < out)
            memcpy(s->skin_tri + 3 * ntri++, corner, 3 * sizeof *corner);
    }
    double *const stress = s->scratch + b->body->nnode;
    cn_skin_stress(skin, b->body, b->von_mises, s->scratch, stress);
    for (int v = 0; v < skin->nvert; v++)
        s->skin_stress[v] = (float)stress[v];
    cn_ros_send_state(node->ros, node->run_frame, s->skin_id, frame->step, frame->time, skin->nvert,
                      b->worn->x, s->skin_stress);
    cn_ros_send_catheter(node->ros, node->run_frame, b->name, s->id, skin->nvert, ntri, s->skin_tri,
                         marker_stride(node, ntri), b->worn->x, s->skin_stress, full);
}

void show_frame(cn_node *node, const cn_frame *frame)
{
    for (int i = 0; i < frame->nbody; i++) {
        const cn_frame_body *b = &frame->body[i];
        shown *s = find_shown(node, b);
        if (!s) continue; /* out of memory: the plan goes on unseen */
        vertex_stress(s, b->von_mises);
        const double full = isfinite(b->stress_limit) ? b->stress_limit : s->highest;
        cn_ros_send_state(node->ros, node->run_frame, s->id, frame->step, frame->time, b->body->npoint, b->x,
                          s->stress);
        if (b->skin && s->skin_tri)
            show_skin(node, frame, b, s, full);
        else
            cn_ros_send_catheter(node->ros, node->run_frame, b->name, s->id, b->nactive,
                                 b->body->boundary->ntri, b->body->boundary->tri,
                                 marker_stride(node, b->body->boundary->ntri), b->x, s->stress, full);
    }
}

void on_status(void *user, cn_ros_status *status)
{
    static const char *const stages[] = {"mesh check", "map", "roadmap", "motion"};
    cn_node *node = user;
    char message[1024];
    double resident = NAN;
    unsigned long pages;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file) {
        if (fscanf(file, "%*u %lu", &pages) == 1) resident = (double)pages * (double)sysconf(_SC_PAGESIZE);
        fclose(file);
    }
    const double t = wall_clock();
    unsigned long came, lost, missing;
    cn_ros_traffic(node->ros, &came, &lost, &missing);

    pthread_mutex_lock(&node->lock);
    const cn_progress p = node->progress;
    const bool open = node->open, ok = !node->refusal[0];
    const int sent = node->frames_sent, dropped = node->frames_dropped;
    const long thinned = node->triangles_left_out;
    const double rate = (node->frames_sent - node->frames_told) / fmax(t - node->told, 1e-3);
    const double factor = node->real_time_factor;
    const int waiting = node->nqueue, meshes_dropped = node->meshes_dropped, refused = node->calls_refused;
    char verdict[sizeof node->verdict];
    memcpy(verdict, node->verdict, sizeof verdict);
    node->frames_told = sent, node->told = t;
    snprintf(message, sizeof message, "%s",
             !ok           ? node->refusal
             : open        ? stages[p.stage]
             : node->stage ? "ready"
                           : "no artery mesh yet");
    pthread_mutex_unlock(&node->lock);

    cn_ros_summary(status, ok ? CN_ROS_OK : CN_ROS_WARN, message);
    cn_ros_figure(status, "last verdict", "%s", verdict[0] ? verdict : "none");
    cn_ros_figure(status, "steps per second", "%.3g", open ? p.steps_per_s : 0.);
    cn_ros_figure(status, "real-time factor", "%.3g", open ? factor : 0.);
    cn_ros_figure(status, "step", "%d", p.step);
    cn_ros_figure(status, "waypoint", "%d of %d", p.waypoint, p.nwaypoint);
    cn_ros_figure(status, "simulated time [s]", "%.6g", p.time);
    cn_ros_figure(status, "replans", "%d", p.replans);
    cn_ros_figure(status, "margin to the nearest limit", "%.3g", isfinite(p.margin) ? p.margin : 1.);
    cn_ros_figure(status, "frame rate [Hz]", "%.3g", rate);
    cn_ros_figure(status, "frames sent", "%d", sent);
    cn_ros_figure(status, "frames dropped", "%d", dropped);
    cn_ros_figure(status, "triangles left out of markers", "%ld", thinned);
    cn_ros_figure(status, "calls waiting", "%d", waiting);
    cn_ros_figure(status, "calls refused as busy", "%d", refused);
    cn_ros_figure(status, "meshes dropped", "%d", meshes_dropped);
    cn_ros_figure(status, "messages received", "%lu", came);
    cn_ros_figure(status, "messages dropped", "%lu", lost);
    cn_ros_figure(status, "messages missing by their numbers", "%lu", missing);
    cn_ros_figure(status, "memory [MB]", "%.1f", resident / 1e6);
    cn_ros_figure(status, "memory, highest [MB]", "%.1f", (double)cn_memory_peak() / 1e6);
}
