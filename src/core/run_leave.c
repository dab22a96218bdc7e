/* run_leave.c - what a run leaves out, and what that saves and costs. While the run goes, states are copied
 * aside at fixed numbers of accepted steps; when it is over, the work left out is done at them beside what
 * was done, timed, and taken for all steps. So measuring changes no result. */
#include "run_parts.h"

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "body_wall.h"
#include "catnav/vec3.h"
#include "geometry.h"
#include "tree.h"

/* --- samples --- */
static cn_status keep_shot(cn_run_data *run, cn_shot *shot, const cn_step_figures *figures)
{
    cn_status status = CN_OK;
    if (!shot->before && (status = cn_state_new(&shot->before, run->model)) != CN_OK) return status;
    if (!shot->after && (status = cn_state_new(&shot->after, run->model)) != CN_OK) return status;
    cn_state_copy(shot->before, run->trial), cn_state_copy(shot->after, run->state);
    shot->kept = figures->kept, shot->fem_s = figures->fem_s;
    return status;
}

/* Every other shot goes when all places are taken, and from then on they lie twice as far apart. */
static void thin_out(cn_leave *leave)
{
    for (int i = 1; i < CN_SHOTS / 2; i++) {
        const cn_shot kept = leave->shot[2 * i];
        leave->shot[2 * i] = leave->shot[i];
        leave->shot[i] = kept;
    }
    leave->nshot = CN_SHOTS / 2, leave->stride *= 2;
}

void cn_run_shoot(cn_run_data *run, const cn_step_figures *figures, bool whole)
{
    cn_leave *leave = &run->leave;
    const int steps = run->report->steps;
    leave->kept_steps += figures->kept > 0;
    if (leave->every <= 0 || !whole) return;
    if (leave->next == 0) leave->next = 1, leave->stride = leave->every;
    /* where factors are kept at times, such a step is waited for */
    if (steps < leave->next ||
        (figures->kept == 0 && run->kept > 0 && steps < leave->next + leave->every - 1))
        return;
    if (leave->short_run) leave->nshot = 0; /* what a short run has to show gives way to a later step */
    if (leave->nshot == CN_SHOTS) thin_out(leave);
    if (keep_shot(run, &leave->shot[leave->nshot], figures) == CN_OK) leave->nshot++; /* else one fewer */
    leave->short_run = steps < leave->every;
    leave->next = leave->short_run ? (int)fmin(7 * leave->next, leave->every)
                                   : (steps / leave->stride + 1) * leave->stride;
}

void cn_run_forget_shots(cn_run_data *run)
{
    run->leave.nshot = 0;
}

void cn_leave_clear(cn_leave *leave, int nbody)
{
    for (int i = 0; i < CN_SHOTS; i++)
        cn_state_free(leave->shot[i].before), cn_state_free(leave->shot[i].after);
    for (int b = 0; leave->self && b < nbody; b++)
        cn_tree_free(leave->self[b].tree);
    free(leave->self);
}

/* --- a body against itself --- */
typedef struct {
    const cn_body *body;
    const double *x;
    double gap, least;
    int a, b;         /* triangles, -1: none */
    long pairs, most; /* seen; to be seen */
} meeting;

static void corners(const cn_body *body, const double *x, int triangle, double out[3][3])
{
    for (int k = 0; k < 3; k++)
        cn_copy3(x + 3 * body->boundary->tri[3 * triangle + k], out[k]);
}

/* Square of the longest edge, and the middle. */
static double longest_edge(const double t[3][3], double middle[3])
{
    double most = 0;
    for (int k = 0; k < 3; k++) {
        double edge[3];
        cn_sub(t[(k + 1) % 3], t[k], edge);
        most = fmax(most, cn_norm2(edge));
        middle[k] = (t[0][k] + t[1][k] + t[2][k]) / 3;
    }
    return most;
}

/* Of triangles nearer than the gap those count that were more than two edges apart at rest: neighbours are
 * passed over by their middles, which are no nearer than they. */
static bool meet(void *user, int ia, int ib)
{
    meeting *m = user;
    if (m->pairs++ == m->most) return false;
    double t[2][3][3], middle[2][3], between[3];
    const double(*const a)[3] = (const double(*)[3])t[0], (*const b)[3] = (const double(*)[3])t[1];
    corners(m->body, m->body->point, ia, t[0]), corners(m->body, m->body->point, ib, t[1]);
    const double ea = longest_edge(a, middle[0]), eb = longest_edge(b, middle[1]);
    cn_sub(middle[0], middle[1], between);
    const double far = 2 * sqrt(fmax(ea, eb)) + m->gap;
    if (cn_norm2(between) <= far * far || cn_tri_tri_distance(a, b) <= far) return true;
    corners(m->body, m->x, ia, t[0]), corners(m->body, m->x, ib, t[1]);
    const double d = cn_tri_tri_distance(a, b);
    if (d < m->gap && d < m->least) m->least = d, m->a = ia, m->b = ib;
    return true;
}

static double gap_of(const cn_run_data *run, int b)
{
    const cn_body *body = cn_touch_body(&run->model->body[b]);
    double edges = 0;
    if (run->model->body[b].gap > 0) return run->model->body[b].gap;
    if (!isnan(run->scene->contact.gap)) return run->scene->contact.gap;
    for (int t = 0; t < body->boundary->ntri; t++)
        edges += cn_distance(body->point + 3 * body->boundary->tri[3 * t],
                             body->point + 3 * body->boundary->tri[3 * t + 1]);
    return 0.075 * edges / body->boundary->ntri;
}

/* The body's surface against itself: refit, query. False where there is no memory for the tree, or more than
 * `most` pairs of boxes meet. */
static bool meets_itself(cn_run_data *run, int b, const cn_state *state, long most, meeting *m)
{
    cn_tree **tree = &run->leave.self[b].tree;
    const cn_body *body = cn_touch_body(&run->model->body[b]);
    *m = (meeting){.body = body, .gap = gap_of(run, b), .least = INFINITY, .a = -1, .b = -1, .most = most};
    m->x = cn_run_met(run, b, state, body->nnode);
    if (*tree)
        cn_tree_refit(*tree, m->x);
    else if (cn_tree_new(tree, body->boundary->ntri, body->boundary->tri, m->x) != CN_OK)
        return false;
    cn_tree_query_self(*tree, m->gap, meet, m);
    return m->pairs <= m->most;
}

void cn_run_watch(cn_run_data *run)
{
    cn_leave *leave = &run->leave;
    const cn_switch left_out = run->scene->leave_out.self_contact;
    meeting m;
    for (int b = 0; b < run->nbody && !leave->turned; b++) {
        const cn_body *body = run->model->body[b].body;
        if (cn_is_sheet(body->model) && cn_sheet_turns(body, run->state->body[b].rotation))
            leave->turned = run->state->step;
    }
    if (left_out == CN_ON || !leave->self) return;
    if (left_out != CN_OFF && (leave->every <= 0 || run->report->steps % leave->every)) return;
    for (int b = 0; b < run->nbody; b++) {
        cn_self *self = &leave->self[b];
        const bool folds =
            !(cn_fold_room(&run->model->body[b], &run->state->body[b], run->body[b].points) > 0);
        if (run->model->body[b].self) { /* the step sees to it */
            if (folds && !self->done) self->done = run->state->step;
            continue;
        }
        if (run->spec[b].wall || self->needed || (left_out == CN_AUTO && !folds) ||
            !meets_itself(run, b, run->state, LONG_MAX, &m))
            continue;
        if (!self->tested) self->tested = run->state->step;
        if (m.a < 0) continue;
        self->needed = run->state->step, self->a = m.a, self->b = m.b, self->distance = m.least;
        CN_LOG(CN_LOG_WARNING, "%s touches itself at step %d (triangles %d and %d are %.3g m apart)",
               run->spec[b].name, self->needed, m.a, m.b, m.least);
    }
}

void cn_run_refit(cn_run_data *run)
{
    for (int w = 0; run->scene->leave_out.refit == CN_OFF && w < run->world->nwall; w++)
        cn_tree_refit(run->world->wall[w].tree, run->world->wall[w].surface->vert);
}

/* --- what is left out --- */
static cn_left_out *entry_of(cn_run_data *run, const char *what, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
static cn_left_out *entry_of(cn_run_data *run, const char *what, const char *format, ...)
{
    cn_left_out *entry = &run->report->left_out[run->report->nleft_out++];
    va_list arguments;
    entry->what = what, entry->time_saved_s = NAN, entry->error = NAN;
    va_start(arguments, format);
    vsnprintf(entry->why, sizeof entry->why, format, arguments);
    va_end(arguments);
    return entry;
}

/* Largest distance between the nodes of two states, over the size of their body. */
static double apart(const cn_run_data *run, const cn_state *a, const cn_state *b)
{
    double most = 0;
    for (int i = 0; i < run->nbody; i++)
        for (int k = 0; k < run->model->body[i].body->nnode; k++)
            most = fmax(most,
                        cn_distance(a->body[i].x + 3 * k, b->body[i].x + 3 * k) / run->model->body[i].size);
    return most;
}

/* All bodies' step from `from` into run->spare; its time [s], NAN where it fails. */
static double step_again(cn_run_data *run, const cn_state *from, bool driven)
{
    double spent = 0;
    cn_state_copy(run->spare, from);
    for (int w = 0; w < run->nwork; w++) {
        if (cn_step(run->model, from, run->spare, driven ? cn_run_paths(run) : NULL, run->model->dt,
                    run->work[w], run->figures) != CN_OK)
            return NAN;
        spent += run->figures->fem_s;
    }
    return spent;
}

/* Steps that do the work (as the model and its scene now say) against those that left it out. */
static void against_shots(cn_run_data *run, cn_left_out *entry, int most, bool kept_only, int steps)
{
    double saved = 0, error = 0;
    int n = 0;
    for (int i = 0; i < run->leave.nshot && n < most; i++) {
        const cn_shot *shot = &run->leave.shot[i];
        if (kept_only && shot->kept == 0) continue;
        const double spent = step_again(run, shot->before, true);
        if (!isfinite(spent)) continue;
        saved += spent - shot->fem_s, error = fmax(error, apart(run, run->spare, shot->after));
        n++;
    }
    if (n > 0) entry->time_saved_s = saved / n * steps, entry->error = error;
}

static void refactor(cn_run_data *run)
{
    if (run->kept == 0) return;
    cn_left_out *entry = entry_of(
        run, "refactor", "%ld of %ld solves used an earlier factor: no element had turned by 0.02 rad",
        run->kept, run->newton);
    cn_scene scene = *run->scene;
    scene.leave_out.refactor = CN_OFF;
    run->model->scene = &scene;
    against_shots(run, entry, 1 + run->nsample / 1000, true,
                  run->leave.kept_steps); /* a factor may take many steps' time */
    run->model->scene = run->scene;
}

/* The run's first steps anew with inertia, since a step that starts from an equilibrium without speed shows
 * nothing of it. What is led along a path would need the whole run again: not measured. */
static void inertia(cn_run_data *run)
{
    enum { MOST = 100 };
    if (run->model->inertia) return;
    cn_left_out *entry =
        entry_of(run, "inertia", "asked for: each step is an equilibrium; error within %d steps",
                 run->report->steps < MOST ? run->report->steps : MOST);
    cn_state *now = NULL;
    double spent = 0, saved = 0, error = NAN;
    int shot = 0;
    for (int b = 0; b < run->nbody; b++)
        if (cn_run_paths(run)[b]) return;
    if (cn_state_new(&now, run->model) != CN_OK) return;
    run->model->inertia = true;
    while (shot < run->leave.nshot && now->step < MOST) {
        const cn_shot *next = &run->leave.shot[shot];
        const double took = step_again(run, now, false);
        if (!isfinite(took)) break;
        cn_state_copy(now, run->spare);
        now->step++, now->time += run->model->dt;
        spent += took;
        if (now->step < next->after->step) continue;
        if (fabs(now->time - next->after->time) > 0.5 * run->model->dt) break; /* a step was parted */
        error = fmax(error, apart(run, now, next->after));
        saved = (spent / now->step - next->fem_s) * run->nsample;
        shot++;
    }
    run->model->inertia = false;
    if (error >= 0) entry->error = error, entry->time_saved_s = saved;
    cn_state_free(now);
}

static double measure_time(cn_run_data *run, const cn_state *state, bool with_stress)
{
    double least = INFINITY;
    for (int again = 0; again < 5; again++) {
        const double start = cn_seconds();
        for (int b = 0; b < run->nbody; b++) {
            const cn_model_body *model = &run->model->body[b];
            const cn_body_state *at = &state->body[b];
            cn_measures m;
            memcpy(run->body[b].turn, at->rotation, 4 * (size_t)model->body->nturn * sizeof(double));
            cn_body_measure(model->body, cn_run_active(model, at), at->x, run->body[b].turn, with_stress, &m,
                            with_stress ? run->body[b].von_mises : NULL, run->pool);
        }
        least = fmin(least, cn_seconds() - start);
    }
    return least;
}

static void stress(cn_run_data *run)
{
    double saved = 0;
    for (int b = 0; b < run->nbody; b++)
        for (int i = 0; i < run->spec[b].nlimit; i++)
            if (run->spec[b].limit[i].quantity == CN_QUANTITY_STRESS) return;
    if (run->scene->leave_out.stress == CN_OFF) return;
    cn_left_out *entry =
        entry_of(run, "stress", "no limit asks for it, and nothing moves by it; frames have their own");
    for (int i = 0; i < run->leave.nshot; i++)
        saved += measure_time(run, run->leave.shot[i].after, true) -
                 measure_time(run, run->leave.shot[i].after, false);
    if (run->leave.nshot > 0) entry->time_saved_s = saved / run->leave.nshot * run->nsample;
    entry->error = 0;
}

static void refit(cn_run_data *run)
{
    double spent = 0;
    bool same = true;
    if (run->world->nwall == 0 || run->scene->leave_out.refit == CN_OFF) return;
    cn_left_out *entry = entry_of(run, "refit", "the walls do not move");
    for (int w = 0; w < run->world->nwall; w++) { /* of copies: runs share the world */
        const cn_surface *surface = run->world->wall[w].surface;
        double box[4][3];
        cn_tree *tree;
        if (cn_tree_new(&tree, surface->ntri, surface->tri, surface->vert) != CN_OK) return;
        const double start = cn_seconds();
        cn_tree_refit(tree, surface->vert);
        spent += cn_seconds() - start;
        cn_tree_box(run->world->wall[w].tree, box[0], box[1]), cn_tree_box(tree, box[2], box[3]);
        same &= !memcmp(box[0], box[2], 2 * sizeof box[0]);
        cn_tree_free(tree);
    }
    entry->time_saved_s = spent * run->nsample;
    if (same) entry->error = 0;
}

/* By how much a triangle of the walls that give way had turned in what was kept of the run, most [rad]. */
static double wall_turn(const cn_run_data *run)
{
    double most = 0;
    for (int b = 0; b < run->nbody; b++)
        for (int i = 0; cn_is_sheet(run->model->body[b].body->model) && i < run->leave.nshot; i++) {
            const cn_body_state *at = &run->leave.shot[i].after->body[b];
            most = fmax(most, cn_sheet_turn(run->model->body[b].body, at->x, at->rotation, run->pool));
        }
    return most;
}

/* As long as a wall's stiffness is that of its rest shape, a part that has turned by an angle a shows a
 * strain of a^2 / 2, by which its nodes are off at most, in proportion to its size. */
static void frozen_wall(cn_run_data *run)
{
    const int turned = run->leave.turned;
    const double turn = turned ? 0 : wall_turn(run);
    cn_left_out *entry =
        turned ? entry_of(run, "wall_solve",
                          "the turning of walls that give way, until step %d: from there on a triangle had "
                          "turned by more than %.2g rad",
                          turned, CN_SHEET_TURNS)
               : entry_of(run, "wall_solve",
                          "walls that give way are factored once: none of their triangles was seen turned by "
                          "more than %.2g rad",
                          turn);
    const double most = turned ? CN_SHEET_TURNS : turn;
    if (turned || run->leave.nshot > 0) entry->error = 0.5 * most * most;
}

static void wall_solve(cn_run_data *run)
{
    if (run->world->nwall == 0 || run->scene->leave_out.wall_solve == CN_OFF) return;
    bool any = false;
    for (int w = 0; w < run->world->nwall; w++)
        any |= cn_gives_way(run->world->wall[w].spec);
    if (!any)
        entry_of(run, "wall_solve", "the walls are rigid: there is nothing to solve")->error = 0;
    else if (run->scene->leave_out.wall_solve == CN_ON)
        entry_of(run, "wall_solve", "asked for: walls that give way are taken as rigid");
    else
        frozen_wall(run);
}

static void self_contact(cn_run_data *run)
{
    const long most = 5000000; /* pairs: a second; needles by the hundred thousand are not measured */
    const cn_leave *leave = &run->leave;
    const cn_self *needed = NULL, *tested = NULL, *done = NULL;
    cn_left_out *entry;
    double spent = 0;
    bool near = false;
    for (int b = run->nbody - 1; leave->self && b >= 0; b--) {
        if (leave->self[b].tested) tested = &leave->self[b];
        if (leave->self[b].needed) needed = &leave->self[b];
        if (leave->self[b].done) done = &leave->self[b];
    }
    if (run->scene->leave_out.self_contact == CN_OFF && !needed) return;
    if (needed)
        entry = entry_of(run, "self_contact",
                         "needed from step %d on and not there: triangles %d and %d of %.40s came to %.3g m",
                         needed->needed, needed->a, needed->b, run->spec[needed - leave->self].name,
                         needed->distance);
    else if (run->scene->leave_out.self_contact == CN_ON)
        entry = entry_of(run, "self_contact", "asked for");
    else if (done && done->done > leave->every) {
        entry =
            entry_of(run, "self_contact",
                     "up to step %d alone: from then on %.40s could come to itself, and the step sees to it",
                     done->done - 1, run->spec[done - leave->self].name);
        entry->error = 0;
        return;
    } else if (done)
        return; /* all of it is done */
    else if (tested)
        entry = entry_of(run, "self_contact",
                         "no two parts of a body came near, tested at every %d steps from step %d on",
                         leave->every, tested->tested);
    else
        entry = entry_of(run, "self_contact", "no body turned by more than 180 degrees along its length");
    if (!leave->self) return;
    for (int i = 0; i < leave->nshot; i++)
        for (int b = 0; b < run->nbody; b++) {
            meeting m;
            if (!leave->self[b].tree && !meets_itself(run, b, leave->shot[i].after, most, &m)) return;
            const double start = cn_seconds();
            if (!meets_itself(run, b, leave->shot[i].after, most, &m)) return;
            spent += cn_seconds() - start;
            near |= m.a >= 0;
        }
    if (leave->nshot > 0) entry->time_saved_s = spent / leave->nshot * run->nsample;
    if (!needed && !near) entry->error = 0;
}

/* What a body's sheath saves in an undriven step without walls: time of the whole body's less the free
 * part's.
 */
static double sheath_time(cn_run_data *run, int w, int b, cn_state *from)
{
    const int nfree = from->body[b].nfree;
    double part = 0;
    run->model->touches = false;
    cn_status status =
        cn_step(run->model, from, run->spare, NULL, run->model->dt, run->work[w], run->figures);
    part = run->figures->fem_s;
    from->body[b].nfree = run->model->body[b].body->nnode;
    if (status == CN_OK)
        status = cn_step(run->model, from, run->spare, NULL, run->model->dt, run->work[w], run->figures);
    from->body[b].nfree = nfree, run->model->touches = true;
    return status == CN_OK ? run->figures->fem_s - part : NAN;
}

static void sheath(cn_run_data *run)
{
    double saved = 0;
    bool any = false;
    for (int b = 0; b < run->nbody; b++)
        any |= run->model->body[b].sheath;
    if (!any) return;
    cn_left_out *entry =
        entry_of(run, "sheath",
                 "what is in the introducer sheath moves along its axis, unsolved (timed without walls)");
    entry->error = 0; /* it is held on that axis */
    for (int i = 0; i < run->leave.nshot; i++)
        for (int b = 0; b < run->nbody; b++)
            if (run->model->body[b].sheath)
                saved += sheath_time(run, run->nwork > 1 ? b : 0, b, run->leave.shot[i].before);
    if (run->leave.nshot > 0) entry->time_saved_s = saved / run->leave.nshot * run->nsample;
}

void cn_run_left_out(cn_run_data *run)
{
    if (run->report->verdict.code == CN_VERDICT_CANCELLED) cn_run_forget_shots(run); /* no time for it */
    self_contact(run), refit(run), refactor(run), wall_solve(run), inertia(run), stress(run), sheath(run);
}
