/* run_limits.c - hard limits on the trial state of a step; a jam is one of them. */
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "catnav/vec3.h"
#include "tree.h"

static const char *const limit_units[] = {"", " Pa", " J", " N", " m", " m"};

int cn_run_waypoint(const cn_run_data *run, const cn_state *state, int b)
{
    return state->body[b].waypoint - (b == 0 && run->waypoint ? 0 : 1);
}

typedef struct {
    double value;
    int element;
    double where[3];
    bool measured;
} reading;

static reading read_quantity(const cn_run_data *run, int b, const cn_limit *limit, const cn_state *trial,
                             const cn_step_figures *figures)
{
    const cn_body *body = run->model->body[b].body;
    const cn_measures *m = &run->body[b].measures;
    const double *x = trial->body[b].x;
    const bool mean = limit->reduce == CN_REDUCE_MEAN;
    reading r = {.element = -1, .where = {NAN, NAN, NAN}, .measured = true};
    switch (limit->quantity) {
    case CN_QUANTITY_VOLUME:
        r.value = mean ? m->volume_mean : m->volume_max;
        r.element = mean ? -1 : m->volume_element;
        break;
    case CN_QUANTITY_STRESS:
        r.value = mean ? m->stress_mean : m->stress_max;
        r.element = mean ? -1 : m->stress_element;
        break;
    case CN_QUANTITY_ENERGY:
        r.value = m->energy;
        break;
    case CN_QUANTITY_WALL_FORCE:
        r.value = figures->wall_force;
        cn_copy3(figures->wall_where, r.where);
        return r;
    case CN_QUANTITY_CLEARANCE:
        r.value = figures->gap;
        r.measured = isfinite(figures->gap);
        break;
    default:
        r.measured = false;
    }
    cn_body_element_centre(body, x, r.element, r.where);
    if (r.element < 0) cn_copy3(x + 3 * run->model->body[b].goal_node, r.where);
    return r;
}

static void fill(cn_run_data *run, cn_verdict *verdict, int b, const cn_limit *limit, const reading *r,
                 const cn_state *trial)
{
    const char *unit = limit_units[limit->quantity];
    *verdict =
        (cn_verdict){.code = CN_VERDICT_LIMIT_BROKEN, .has_quantity = true, .quantity = limit->quantity};
    verdict->value = r->value, verdict->limit = limit->limit, verdict->element = r->element;
    cn_copy3(r->where, verdict->position);
    verdict->step = trial->step, verdict->time = trial->time;
    verdict->waypoint = cn_run_waypoint(run, trial, b);
    snprintf(verdict->body, sizeof verdict->body, "%s", run->spec[b].name);
    char element[40] = "";
    if (r->element >= 0) snprintf(element, sizeof element, " in element %d", r->element);
    snprintf(verdict->message, sizeof verdict->message,
             "%s %s of %s is %.4g%s, limit %.4g%s%s, at [%.4f %.4f %.4f] m, step %d, t = %.3f s",
             limit->reduce == CN_REDUCE_MEAN            ? "mean"
             : limit->quantity == CN_QUANTITY_CLEARANCE ? "least"
                                                        : "largest",
             cn_quantity_name(limit->quantity), verdict->body, r->value, unit, limit->limit, unit, element,
             r->where[0], r->where[1], r->where[2], trial->step, trial->time);
}

/* Goal progress below a tenth of the waypoint tolerance in one simulated second. */
static bool jammed(cn_run_data *run, int b, cn_state *trial, cn_verdict *broken)
{
    cn_body_state *state = &trial->body[b];
    const double least = 0.1 * run->spec[b].waypoint_tolerance;
    if (!run->body[b].path || cn_drive_arrived(&run->model->body[b], state)) return false;
    if (cn_push_busy(&run->model->body[b], state) || state->until < INFINITY) { /* anew when it goes on */
        state->progress = -INFINITY, state->progress_time = trial->time;
        return false;
    }
    if (!(state->s_goal < state->progress + least)) {
        state->progress = state->s_goal, state->progress_time = trial->time;
        return false;
    }
    if (trial->time - state->progress_time <= 1) return false;
    const cn_limit limit = {.quantity = CN_QUANTITY_PROGRESS, .reduce = CN_REDUCE_MAX, .limit = least};
    reading r = {.value = state->s_goal - state->progress, .element = -1};
    cn_copy3(state->x + 3 * run->model->body[b].goal_node, r.where);
    fill(run, broken, b, &limit, &r, trial);
    snprintf(broken->message, sizeof broken->message,
             "%s is stuck: its goal node advanced %.3g m in the last second (less than %.3g m), at [%.4f "
             "%.4f %.4f] m, "
             "%.4f m along the path, step %d, t = %.3f s",
             broken->body, r.value, least, r.where[0], r.where[1], r.where[2], state->s_goal, trial->step,
             trial->time);
    return true;
}

/* What a push drive asks before its next move; the margin is then narrowed by each limit. */
static void look_around(const cn_run_data *run, int b, cn_body_state *state)
{
    cn_place place;
    state->push.margin = 1, state->push.hidden = false;
    if (!run->body[b].path || run->spec[b].drive.mode != CN_DRIVE_PUSH) return;
    cn_path_at(run->body[b].path, state->s_goal, &place);
    for (int w = 0; w < run->world->nwall && !state->push.hidden; w++)
        state->push.hidden = cn_tree_crossings(run->world->wall[w].tree,
                                               state->x + 3 * run->model->body[b].goal_node, place.x) > 0;
}

bool cn_run_limits(cn_run_data *run, int b, cn_state *trial, const cn_step_figures *figures,
                   cn_verdict *broken)
{
    cn_run_body *body = &run->body[b];
    const cn_body_spec *spec = &run->spec[b];
    const cn_body_state *state = &trial->body[b];
    bool stress = false;

    for (int i = 0; i < spec->nlimit; i++)
        stress |= spec->limit[i].quantity == CN_QUANTITY_STRESS;
    if (run->scene->leave_out.stress == CN_OFF) stress = true;
    const cn_model_body *m = &run->model->body[b];
    const size_t all = 3 * (size_t)m->body->nblock * sizeof *state->x;
    if (memcmp(body->measured, state->x, all) || m->body->nblock > m->body->nnode) { /* it has moved */
        memcpy(body->measured, state->x, all);
        cn_body_measure(m->body, cn_run_active(m, state), state->x, trial->body[b].rotation, stress,
                        &body->measures, stress ? body->von_mises : NULL, run->pool);
    }
    if (body->measures.inverted > run->report->solver.inverted_max)
        run->report->solver.inverted_max = body->measures.inverted;
    look_around(run, b, &trial->body[b]);
    for (int i = 0; i < spec->nlimit; i++) {
        const cn_limit *limit = &spec->limit[i];
        const reading r = read_quantity(run, b, limit, trial, figures);
        const bool least = limit->quantity == CN_QUANTITY_CLEARANCE;
        if (!r.measured) continue;
        if (least ? !(r.value >= limit->limit) : !(r.value <= limit->limit)) {
            fill(run, broken, b, limit, &r, trial);
            return true;
        }
        const double part = least ? limit->limit / r.value : r.value / limit->limit;
        if (limit->limit > 0) trial->body[b].push.margin = fmin(trial->body[b].push.margin, 1 - part);
        cn_limit_report *worst = &run->report->limit[body->first_limit + i];
        if (worst->step < 0 || (least ? r.value < worst->worst : r.value > worst->worst)) {
            worst->worst = r.value, worst->step = trial->step, worst->time = trial->time,
            worst->element = r.element;
            cn_copy3(r.where, worst->position);
        }
    }
    return jammed(run, b, trial, broken);
}

double cn_run_margin(const cn_run_data *run, const char **of)
{
    double margin = INFINITY;
    *of = "";
    for (int i = 0; i < run->report->nlimit; i++) {
        const cn_limit_report *l = &run->report->limit[i];
        if (l->step < 0 || l->limit.quantity == CN_QUANTITY_CLEARANCE) continue;
        const double m = l->limit.limit > 0 ? 1 - l->worst / l->limit.limit : 0;
        if (m < margin) margin = m, *of = cn_quantity_name(l->limit.quantity);
    }
    return margin;
}
