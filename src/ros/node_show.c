/* node_show.c - what is seen while a plan runs: frames at most at ~frame_rate, and diagnostics. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "node_parts.h"

double wall_clock(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

bool wants_frame(cn_node *node, int step)
{
    const double t = wall_clock();
    const bool wanted = step == 0 || t - node->last_frame >= node->frame_period;
    if (wanted) node->last_frame = t;
    pthread_mutex_lock(&node->lock);
    if (wanted)
        node->frames_sent++;
    else
        node->frames_dropped++;
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

/* Largest von Mises stress of each vertex's tetrahedra: what breaks a limit is never averaged away. */
static void vertex_stress(shown *s, const double *von_mises)
{
    const cn_body *b = s->body;
    memset(s->stress, 0, (size_t)b->npoint * sizeof(float));
    for (int e = 0; von_mises && e < b->ntet; e++) {
        const float stress = (float)von_mises[e];
        if (von_mises[e] > s->highest) s->highest = von_mises[e];
        for (int k = 0; k < (b->mid ? 10 : 4); k++) {
            float *at = s->stress + (k < 4 ? b->tet[4 * e + k] : b->mid[6 * e + k - 4]);
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
                         b->worn->x, s->skin_stress, full);
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
                                 b->body->boundary->ntri, b->body->boundary->tri, b->x, s->stress, full);
    }
}

void on_tick(void *user)
{
    static const char *const stages[] = {"mesh check", "map", "roadmap", "motion"};
    cn_node *node = user;
    cn_ros_figure figure[9];
    char message[1024];
    int n = 0;

#define FIGURE(name, ...)                                                                                    \
    figure[n].key = name, snprintf(figure[n].value, sizeof figure[n].value, __VA_ARGS__), n++
    pthread_mutex_lock(&node->lock);
    const cn_progress *p = &node->progress;
    FIGURE("frame rate [Hz]", "%d", node->frames_sent - node->frames_tick);
    FIGURE("frames sent", "%d", node->frames_sent);
    FIGURE("frames dropped", "%d", node->frames_dropped);
    FIGURE("last verdict", "%s", node->verdict[0] ? node->verdict : "none");
    FIGURE("steps per second", "%.3g", node->open ? p->steps_per_s : 0.);
    FIGURE("step", "%d", p->step);
    FIGURE("waypoint", "%d of %d", p->waypoint, p->nwaypoint);
    FIGURE("simulated time [s]", "%.6g", p->time);
    FIGURE("replans", "%d", p->replans);
    node->frames_tick = node->frames_sent;
    const bool ok = !node->refusal[0];
    if (!ok)
        snprintf(message, sizeof message, "%s", node->refusal);
    else
        snprintf(message, sizeof message, "%s",
                 node->open    ? stages[p->stage]
                 : node->stage ? "ready"
                               : "no artery mesh yet");
    pthread_mutex_unlock(&node->lock);
#undef FIGURE
    cn_ros_send_diagnostics(node->ros, ok, message, n, figure);
}
