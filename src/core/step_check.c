/* step_check.c - the new state of a step before its walls: what a response that came after the solve makes of
 * it, and the check that shares nothing with any response. */
#include "step_parts.h"

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"

/* Everything where `state` has it: points, those that take part (what the sheath guides past the entry too),
 * axes; how many axis points. */
static int gather(cn_work *work, const cn_state *state)
{
    int naxis = 0;
    for (int p = 0; p < work->npart; p++) {
        const cn_part *part = &work->part[p];
        const cn_body *b = cn_touch_body(part->body);
        cn_body_state at = state->body[part->index];
        double *own = work->points + 3 * (size_t)work->surfaces->surface[p].first;
        const double *x = cn_body_points(b, at.nfree, at.x, at.rotation, own);
        int n;
        if (x != own) memcpy(own, x, 3 * (size_t)b->npoint * sizeof *own);
        at.nfree = cn_sheath_past(part->body, &at);
        work->nfree[p] = cn_body_points_of(b, at.nfree);
        cn_axis_points(part->body, &at, &n, part->axis);
        memcpy(work->axis + 3 * (size_t)naxis, part->axis, 3 * (size_t)n * sizeof *own);
        naxis += n;
    }
    return naxis;
}

/* The paper's response to the new state: points moved apart, velocities adjusted. */
static void project(const cn_group *g, cn_state *trial, double dt, cn_step_figures *figures)
{
    cn_work *work = g->work;
    const cn_scene *scene = work->model->scene;
    double *v = work->force; /* velocities of the points */
    for (int i = 0; i < work->surfaces->npoint; i++)
        work->mass[i] = INFINITY;
    memset(v, 0, 3 * (size_t)work->surfaces->npoint * sizeof *v);
    EACH_STAGE(g, s)
    {
        const int first = work->surfaces->surface[s - g->stage].first;
        const cn_body_state *to = &trial->body[s->part->index];
        for (int i = 0; i < s->nfree; i++)
            if (!s->part->body->fixed[i]) work->mass[first + i] = s->part->body->body->mass[i];
        memcpy(v + 3 * (size_t)first, to->v, 3 * (size_t)s->nfree * sizeof *v);
    }
    gather(work, trial);
    for (int p = 0; p < g->n; p++)
        work->nfree[p] = g->stage[p].nfree;
    cn_contact_project(work->surfaces, work->contact, work->nfree, work->mass, work->points, v,
                       scene->contact.response, scene->contact.restitution, 20);
    EACH_STAGE(g, s)
    {
        const size_t first = 3 * (size_t)work->surfaces->surface[s - g->stage].first;
        cn_body_state *to = &trial->body[s->part->index];
        double impulse[3] = {0, 0, 0};
        for (int i = 0; i < 3 * s->nfree; i++)
            impulse[i % 3] += s->part->body->body->mass[i / 3] * (v[first + (size_t)i] - to->v[i]);
        memcpy(to->x, work->points + first, 3 * (size_t)s->nfree * sizeof *v);
        memcpy(to->v, v + first, 3 * (size_t)s->nfree * sizeof *v);
        figures[s - g->stage].wall_force = cn_norm(impulse) / dt;
    }
}

cn_status cn_stage_check(cn_work *work, const cn_state *state, cn_findings *findings)
{
    const int naxis = gather(work, state);
    return cn_contact_check(work->surfaces, work->contact, work->nfree, work->points, naxis, work->axis,
                            findings, work->pool);
}

static bool inside_out(const double *x, const int node[4])
{
    double e[3][3], across[3];
    for (int k = 0; k < 3; k++)
        cn_sub(x + 3 * node[k + 1], x + 3 * node[0], e[k]);
    cn_cross(e[0], e[1], across);
    return !(cn_dot(across, e[2]) > 0);
}

/* Tetrahedron t, or of second order one of the eight that its nodes part it into: it has the faces that
 * contact sees. One that lies in the sheath, its nodes from npoint on, is left out. */
static bool turns_out(const cn_body *b, const double *x, int npoint, int t)
{
    static const int eight[8][4] = {{0, 4, 6, 7}, {4, 1, 5, 8}, {6, 5, 2, 9}, {7, 8, 9, 3},
                                    {4, 9, 5, 6}, {4, 9, 6, 7}, {4, 9, 7, 8}, {4, 9, 8, 5}};
    int node[10];
    memcpy(node, b->tet + 4 * t, 4 * sizeof *node);
    if (b->mid) memcpy(node + 4, b->mid + 6 * t, 6 * sizeof *node);
    bool out = false;
    for (int i = 0; i < (b->mid ? 10 : 4); i++)
        out |= node[i] < npoint;
    if (!out) return false;
    if (!b->mid) return inside_out(x, node);
    for (int k = 0; k < 8; k++) {
        const int part[4] = {node[eight[k][0]], node[eight[k][1]], node[eight[k][2]], node[eight[k][3]]};
        if (inside_out(x, part)) return true;
    }
    return false;
}

/* Could the body cross itself now: by its axis, or by a tetrahedron that is inside out? */
static bool folds(const cn_group *g, int p, const cn_state *trial)
{
    cn_work *work = g->work;
    const cn_part *part = g->stage[p].part;
    const cn_body *b = part->body->body;
    const cn_body_state *to = &trial->body[part->index];
    const int npoint = cn_body_points_of(b, to->nfree);
    if (!(cn_fold_room(part->body, to, part->axis) > 0)) return true;
    if (part->body->worn && b->model == CN_BODY_ROD) return false; /* tetrahedra that only ride on it */
    gather(work, trial);
    const double *x = part->body->worn ? to->x : work->points + 3 * (size_t)work->surfaces->surface[p].first;
    for (int t = 0; t < b->ntet; t++)
        if (turns_out(b, x, npoint, t)) return true;
    return false;
}

/* Longest way of a node in the step. */
static double farthest(const cn_stage *s, const cn_body_state *to)
{
    double most = 0;
    for (int i = 0; i < s->nfree; i++) {
        double way[3];
        cn_sub(to->x + 3 * i, s->from->x + 3 * i, way);
        most = fmax(most, cn_norm2(way));
    }
    return sqrt(most);
}

cn_status cn_stage_meet(const cn_group *g, cn_state *trial, double dt, cn_step_figures *figures)
{
    cn_work *work = g->work;
    if (g->strict) {
        gather(work, trial);
        for (int p = 0; p < g->n; p++) {
            int other;
            figures[p].gap = cn_contact_least(work->contact, p);
            figures[p].wall_force = cn_contact_patch_force(work->surfaces, work->contact, p, work->points,
                                                           figures[p].wall_where, &other);
        }
    } else if (g->pressed) {
        cn_stage_penalty_figures(g, dt, figures);
    } else if (work->model->scene->contact.method == CN_CONTACT_PROJECT) {
        project(g, trial, dt, figures);
    }
    const bool strict = work->model->scene->contact.method == CN_CONTACT_STRICT;
    for (int p = 0; g->strict && p < g->n; p++) /* farther than it had room for without being looked after */
        if (work->part[p].body->self && !work->surfaces->surface[p].self &&
            !(2 * farthest(&g->stage[p], &trial->body[work->part[p].index]) < work->part[p].room))
            return CN_ERR_NOT_FREE;
    for (int p = 0; strict && p < g->n; p++) /* left out by how it lay at the start, and it may have folded */
        if (work->part[p].body->self && !work->surfaces->surface[p].self)
            work->surfaces->surface[p].self = folds(g, p, trial);
    const cn_status status = cn_stage_check(work, trial, &figures->findings);
    if (figures->findings.outside) figures->gap = fmin(figures->gap, -figures->findings.depth);
    /* never accepted, whatever the response made of it */
    return strict && status == CN_OK && figures->findings.intersections + figures->findings.outside > 0
               ? CN_ERR_NOT_FREE
               : status;
}
