/* step_newton.c - the minimum of a stage by Newton with the exact tangent (projected where that is not
 * positive definite) and line search, over all bodies at once. With strict contact each motion is cut by the
 * continuous test before it is taken, so that every iterate is free. */
#include "step_parts.h"

#include <math.h>
#include <string.h>
#include <time.h>
#include "body_wall.h"
#include "catnav/plan.h"
#include "catnav/vec3.h"

double cn_step_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Norm over free blocks; moments count by the body's lever. */
static double norm_free(const cn_stage *s, const double *f)
{
    const cn_body *b = s->part->body->body;
    const double lever = 1 / (b->lever * b->lever);
    double sum = 0;
    EACH_FREE(s, i)
    if (!s->part->body->fixed[i]) sum += (i < b->nnode ? 1 : lever) * cn_norm2(f + 3 * i);
    return sqrt(sum);
}

/* The inertia's and the damping's share: energy, force into `pull`; with a also their stiffness. */
static double inertia_of(const cn_stage *s, int i, const double *u, double pull[3], cn_matrix *a)
{
    const cn_part *part = s->part;
    const cn_body *b = part->body->body;
    const double over = part->model->inertia ? 1 / (s->h * s->h) : 0, damp = b->damping / s->h;
    double ahead[3], behind[3], mass_ahead[3], mass_behind[3];
    for (int k = 0; k < 3; k++)
        ahead[k] = u[3 * i + k] - part->ahead[3 * i + k], behind[k] = u[3 * i + k] - part->lag[3 * i + k];
    cn_stage_mass(s, i, ahead, mass_ahead), cn_stage_mass(s, i, behind, mass_behind);
    for (int k = 0; k < 3; k++)
        pull[k] = over * mass_ahead[k] + damp * mass_behind[k];
    for (int k = 0; a && k < 9; k++)
        a->value[9 * (size_t)a->diagonal[i] + (size_t)k] +=
            (over + damp) * (i >= b->nnode ? part->spin[9 * (size_t)(i - b->nnode) + (size_t)k]
                             : k % 4 == 0  ? b->mass[i]
                                           : 0);
    return 0.5 * (over * cn_dot(ahead, mass_ahead) + damp * cn_dot(behind, mass_behind));
}

double cn_stage_floor(const cn_stage *s)
{
    const cn_model_body *body = s->part->body;
    double far = 0;
    for (int i = 0; i < s->nfree; i++)
        far = fmax(far, fabs(s->x[3 * i]) + fabs(s->x[3 * i + 1]) + fabs(s->x[3 * i + 2]));
    return 4e-15 * body->body->spring * (far + body->size) * sqrt((double)s->nfree);
}

/* One body's potential at x = x0 + u without contact, and its gradient with contact's force (part->touch);
 * with `tangent` >= 0 also the matrix, added to what contact left there. */
static double evaluate_body(const cn_stage *s, const double *x, const double *u, int tangent)
{
    cn_part *part = s->part;
    const cn_body *b = part->body->body;
    const size_t all = 3 * (size_t)(b->nblock > b->nnode ? b->nblock : s->nactive) * sizeof(double);
    cn_matrix *a = tangent >= 0 && !part->sheet ? part->matrix : NULL;
    double inertia = 0, load = 0, inertia_norm = 0;

    memset(part->elastic, 0, all), memset(part->path, 0, all);
    const double elastic = cn_body_add_elastic(b, s->nactive, x, s->rotation, part->elastic,
                                               a ? (cn_tangent)tangent : CN_TANGENT_WARPED, 1,
                                               a ? part->scatter : NULL, part->pool);
    const double path = cn_drive_add(&part->drive, s->nfree, x, part->path, 1, a);
    EACH_FREE(s, i)
    {
        const double over = i < b->nnode ? 1 : 1 / b->lever;
        double pull[3];
        inertia += inertia_of(s, i, u, pull, a);
        inertia_norm += over * over * cn_norm2(pull);
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            const double given = part->external[k] + part->constant[k];
            load += given * u[k];
            part->gradient[k] = pull[k - 3 * i] - part->elastic[k] - given - part->path[k] - part->touch[k];
        }
    }
    if (part->damping.value) {
        const double beta = b->damping_stiffness / s->h;
        memset(part->moved, 0, all);
        EACH_FREE(s, i)
        cn_sub(u + 3 * i, part->lag + 3 * i, part->moved + 3 * i);
        cn_matrix_multiply(&part->damping, s->rows, part->moved, part->damped, part->pool);
        EACH_FREE(s, i)
        {
            cn_axpy(beta, part->damped + 3 * i, part->gradient + 3 * i);
            inertia += 0.5 * beta * cn_dot(part->damped + 3 * i, part->moved + 3 * i);
        }
        for (int i = 0; a && i < 9 * part->matrix->row[s->rows]; i++)
            part->matrix->value[i] += beta * part->damping.value[i];
    }
    const double internal = norm_free(s, part->elastic), external = norm_free(s, part->external);
    part->residual_scale = fmax(sqrt(inertia_norm), fmax(internal, external));
    part->energy_size = inertia + fabs(elastic) + fabs(path) + fabs(load);
    EACH_FREE(s, i)
    if (part->body->fixed[i]) memset(part->gradient + 3 * i, 0, 3 * sizeof(double));
    return inertia + elastic + path - load;
}

bool cn_stage_touched(const cn_stage *s)
{
    EACH_FREE(s, i)
    if (cn_norm2(s->part->touch + 3 * i) != 0) return true;
    return false;
}

/* The potential of all bodies, gradients, and with `tangent` >= 0 the matrices. */
static double evaluate(const cn_group *g, cn_where at, int tangent)
{
    double energy = 0;
    bool again = false;
    EACH_STAGE(g, s)
    {
        const cn_body *b = s->part->body->body;
        if (tangent >= 0 && !s->part->sheet && !s->part->settled)
            cn_matrix_clear(s->part->matrix, s->rows < b->nblock ? s->nactive : b->nblock);
        memset(s->part->touch, 0,
               3 * (size_t)(b->nblock > b->nnode ? b->nblock : s->nactive) * sizeof(double));
    }
    if (g->strict) energy = cn_touch(g, at, tangent >= 0, tangent == CN_TANGENT_EXACT);
    if (g->pressed) energy = cn_stage_add_penalty(g, at, tangent >= 0);
    EACH_STAGE(g, s)
    if (s->part->settled && cn_stage_touched(s)) s->part->settled = false, again = true;
    if (again) return evaluate(g, at, tangent);
    g->work->energy_size = fabs(energy);
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        if (!part->settled)
            part->energy = at == CN_AT_STATE ? evaluate_body(s, s->x, part->u, tangent)
                                             : evaluate_body(s, part->trial, part->trial_u, tangent);
        energy += part->energy;
        g->work->energy_size += part->energy_size;
    }
    return energy;
}

void cn_stage_assemble(const cn_group *g)
{
    cn_group alone = *g;
    alone.strict = alone.pressed = false;
    evaluate(&alone, CN_AT_STATE, CN_TANGENT_PROJECTED);
}

/* How far a body's residual is above what is asked, 1: just there. converged: what is asked is the tolerance,
 * else the round-off alone. */
static double excess_of(const cn_stage *s, bool converged)
{
    const double floor = cn_stage_floor(s), tolerance = s->part->model->scene->solver.tolerance;
    const double residual = norm_free(s, s->part->gradient);
    return residual > 0 ? residual / (converged ? fmax(tolerance * s->part->residual_scale, floor) : floor)
                        : 0;
}

/* Of the body for which it is farthest. */
static double excess(const cn_group *g, bool converged)
{
    double most = 0;
    EACH_STAGE(g, s)
    most = fmax(most, excess_of(s, converged));
    return most;
}

/* Bodies in balance are left out, until something touches them. */
static void settle(const cn_group *g, bool converged)
{
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        if (!part->settled && !part->model->single)
            part->settled = excess_of(s, converged) <= 1 && !cn_stage_touched(s);
    }
}

/* Where iterations converge slowly: walls whose triangles have changed since their matrix was made get
 * another. */
static const double SLOW = 0.5;
enum { PATIENCE = 6 }; /* iterations: a factor costs as much as some of them */

static void follow_walls(const cn_group *g)
{
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = part->body->body;
        if (part->sheet && !part->settled && cn_sheet_turns(b, s->rotation))
            cn_sheet_follow(b, s->x, s->rotation, CN_SHEET_SLOW, part->pool);
    }
}

static bool rubs(const cn_group *g)
{
    return g->strict && g->work->slip > 0;
}

static void shift(const cn_group *g, double fraction)
{
    EACH_STAGE(g, s)
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++) {
        s->part->u[k] += fraction * s->part->dx[k];
        s->x[k] = s->from->x[k] + s->part->u[k];
    }
}

cn_status cn_stage_start(const cn_group *g, bool moved)
{
    double fraction = moved ? 1 : 0, still = 0;
    cn_status status = CN_OK;
    if (g->strict && !moved)
        status = cn_touch_find(g, true);
    else if (g->strict)
        status = cn_touch_allowed(g, true, &fraction);
    if (status != CN_OK) return status;
    if (rubs(g)) cn_touch_note(g, g->work->model->scene->contact.friction);
    if (!moved) return CN_OK;
    if (rubs(g)) still = evaluate(g, CN_AT_STATE, -1);
    if (g->strict) cn_touch_walls_taken(g->work, fraction);
    shift(g, fraction);
    /* what friction is about to stop is better begun at rest */
    if (rubs(g) && !g->work->moving && still < evaluate(g, CN_AT_STATE, -1)) shift(g, -fraction);
    return CN_OK;
}

/* Part of the residual that an iterative solver may leave; less of what sticks, by far the stiffest. */
static const double FORCING = 0.05, STICKING = 0.002;

/* How far an iterative solver has to go: no further than the iteration's own error, of second order
 * (Eisenstat and Walker 1996, choice 2), of first with matrices that are kept, nor than what is asked of the
 * step. */
static double forcing(double over, double before, bool keep)
{
    const double ratio = over / before; /* 0 at first */
    const double own = ratio > 0 ? fmin(FORCING, 0.5 * ratio * (keep ? 0.5 : ratio)) : FORCING;
    return fmin(0.5, fmax(own, 0.5 / over));
}

/* Contact acts. */
static bool pushed(const cn_group *g)
{
    return (g->pressed && g->work->penalty->nspring) ||
           (g->strict && (g->work->contact->nrub || cn_contact_touches(g->work->contact)));
}

/* Matrices serve another iteration where the last one left no more than this part of the residual: what they
 * do not know of is less still. */
static const double NEAR_LINEAR = 0.1;
/* ... and are made anew once they leave more than this. */
static const double STALE = 0.2;

/* Contact's stiffness changes too fast to be kept; and what is asked down to round-off gets there best by an
 * iteration of second order. */
static bool may_keep(const cn_group *g)
{
    if (g->work->model->scene->leave_out.refactor == CN_OFF || pushed(g)) return false;
    EACH_STAGE(g, s)
    if (!s->part->settled &&
        !(s->part->model->scene->solver.tolerance * s->part->residual_scale > cn_stage_floor(s)))
        return false;
    return true;
}

/* Adds share * M/h^2 to the matrices; a rotation counts by its node's mass at the lever. */
static void stiffen(const cn_group *g, double share)
{
    EACH_STAGE(g, s)
    {
        cn_matrix *a = s->part->matrix;
        const cn_body *b = s->part->body->body;
        if (s->part->sheet || s->part->settled) continue;
        const double each = share / (s->h * s->h);
        EACH_FREE(s, i)
        for (int k = 0; k < 3; k++)
            a->value[9 * (size_t)a->diagonal[i] + 4 * (size_t)k] +=
                each * (i < b->nnode ? b->mass[i] : b->mass[i - b->nnode] * b->lever * b->lever);
    }
}

/* The first paper's: whatever the one solve gives. */
static cn_status single_direction(const cn_group *g, bool keep, double *slope, cn_step_figures *figures)
{
    cn_status status = CN_OK;
    figures->kept += keep;
    if (!keep) status = cn_stage_factor(g);
    return status == CN_OK ? cn_stage_solve(g, slope, figures) : status;
}

/* A direction of descent: by an earlier factor (keep), the exact tangent, the exact tangent with ever more
 * inertia where it is not positive definite (a body about to snap), at last the projected one. */
static cn_status newton_direction(const cn_group *g, bool keep, double *slope, cn_step_figures *figures)
{
    cn_work *work = g->work;
    cn_status status;
    if (keep) {
        figures->kept++;
        if ((status = cn_stage_solve(g, slope, figures)) != CN_OK || *slope < 0) return status;
        evaluate(g, CN_AT_STATE, CN_TANGENT_EXACT);
    }
    double added = 0;
    for (int attempt = 0; attempt < 6; attempt++) {
        if ((status = cn_stage_factor(g)) == CN_OK && (status = cn_stage_solve(g, slope, figures)) == CN_OK &&
            *slope < 0) {
            work->added = added / 10;
            return CN_OK;
        }
        if (status != CN_OK && status != CN_ERR_SINGULAR) return status;
        /* begins with a tenth of what last sufficed: a long way down wants less and less */
        const double more = added > 0 ? 10 * added : work->added > 0 ? work->added : 10;
        stiffen(g, more - added);
        added = more;
    }
    evaluate(g, CN_AT_STATE, CN_TANGENT_PROJECTED);
    status = cn_stage_factor(g);
    return status == CN_OK ? cn_stage_solve(g, slope, figures) : status;
}

/* True where a shorter motion of the line search is free too: a rod's is not a part of the longer one. */
static bool still_free(const cn_group *g, double fraction, cn_status *status)
{
    double most = fraction;
    bool curved = false;
    EACH_STAGE(g, s)
    curved |= s->part->carry != NULL;
    if (!g->strict || !curved) return true;
    *status = cn_touch_allowed(g, false, &most);
    return most == fraction;
}

/* The shift of a body in free flight that takes the net force left to nothing: its momentum is kept to
 * rounding, however stiff it is and however far it flies. No strain knows of it. */
static void balance(const cn_stage *s)
{
    cn_part *part = s->part;
    const cn_body *b = part->body->body;
    double net[3] = {0, 0, 0}, mass = 0;
    if (!s->free_flight) return;
    for (int i = 0; i < b->nnode; i++) {
        cn_axpy(1, part->gradient + 3 * i, net);
        mass += b->mass[i];
    }
    if (!(mass > 0)) return;
    const double share = mass * (1 / (s->h * s->h) + b->damping / s->h);
    for (int i = 0; i < b->nnode; i++) {
        cn_axpy(-1 / share, net, part->u + 3 * i);
        cn_add(s->from->x + 3 * i, part->u + 3 * i, s->x + 3 * i);
    }
}

/* Trial states: the part `fraction` of dx; walls too. */
static void try_part(const cn_group *g, double fraction)
{
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        memcpy(part->trial, s->x, 3 * (size_t)part->body->body->nblock * sizeof(double));
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            part->trial_u[k] = part->u[k] + fraction * part->dx[k];
            part->trial[k] = s->from->x[k] + part->trial_u[k];
        }
    }
    if (g->strict) cn_touch_walls(g->work, fraction);
}

static void take_trial(const cn_group *g, double fraction)
{
    EACH_STAGE(g, s)
    EACH_FREE(s, i)
    {
        memcpy(s->x + 3 * i, s->part->trial + 3 * i, 3 * sizeof(double));
        memcpy(s->part->u + 3 * i, s->part->trial_u + 3 * i, 3 * sizeof(double));
    }
    if (g->strict) cn_touch_walls_taken(g->work, fraction);
}

/* Friction as last noted is solved for only so far before it is noted anew, at most so often. */
enum { FRICTION_LAGS = 8 };
static const double LAGGED = 0.01;

/* Friction by what presses now, not when it was last noted: true where that is out of balance. */
static bool rubs_otherwise(const cn_group *g, int *lag, int tangent, double *energy)
{
    if (!rubs(g) || ++*lag > FRICTION_LAGS) return false;
    cn_touch_note(g, g->work->model->scene->contact.friction);
    *energy = evaluate(g, CN_AT_STATE, tangent);
    return excess(g, true) > 1;
}

/* Of an iterate in the state's masks. */
static unsigned bit(int iterate)
{
    return iterate >= 0 && iterate < 32 ? 1u << iterate : 0;
}

/* Notes for the next step whether the iterate was asked for its matrix. That saves evaluations; it is part of
 * the state, since with and without a matrix forces may differ by round-off. */
static void expect(cn_work *work, int iterate, bool needed)
{
    work->needed = needed ? work->needed | bit(iterate) : work->needed & ~bit(iterate);
}

cn_status cn_stage_minimise(const cn_group *g, cn_step_figures *figures)
{
    cn_work *work = g->work;
    const cn_model *model = work->model;
    const int tangent = model->single ? CN_TANGENT_WARPED : CN_TANGENT_EXACT;
    bool keep = cn_stage_keeps(g), assembled = !keep;
    EACH_STAGE(g, s)
    s->part->settled = false;
    double energy = evaluate(g, CN_AT_STATE, keep ? -1 : tangent), slope = 0, before = INFINITY;
    cn_status status = CN_OK;
    double enough = 1; /* of the residual, while friction is as last noted */
    int lag = 0;

    for (int done = 0;; done++) {
        if (!isfinite(energy)) return CN_ERR_NOT_FINITE;
        if (cn_cancelled(work->cancel)) return CN_ERR_CANCELLED;
        const bool arrived = !(work->moving && work->way_left > 1e-9); /* walls that move */
        double over = excess(g, true);
        if (done == 0 && rubs(g)) enough = fmax(1, LAGGED * over);
        if (arrived && (done ? over / enough : excess(g, false)) <= 1) {
            if (!rubs_otherwise(g, &lag, tangent, &energy)) {
                expect(work, done - 1, false);
                EACH_STAGE(g, s)
                balance(s);
                return CN_OK;
            }
            over = excess(g, true), before = INFINITY, assembled = true, keep = false;
            enough = lag < FRICTION_LAGS ? fmax(1, LAGGED * over) : 1;
        }
        settle(g, done > 0);
        if (done && done % PATIENCE == 0 && over > SLOW * before) follow_walls(g);
        if (done == model->newton) return model->single ? CN_OK : CN_ERR_CONVERGENCE;
        if (keep && done > 0 && over > STALE * before) work->stale |= bit(done - 1);
        if (done)
            keep = isfinite(before) && over <= (keep ? STALE : NEAR_LINEAR) * before &&
                   !(work->stale & bit(done)) && (keep || may_keep(g));
        expect(work, done - 1, !keep);
        if (!keep && !assembled) energy = evaluate(g, CN_AT_STATE, tangent);
        work->forcing = forcing(over, before, keep);
        if (rubs(g) && work->contact->nrub) work->forcing = fmin(work->forcing, STICKING);
        status = (model->single ? single_direction : newton_direction)(g, keep, &slope, figures);
        if (status != CN_OK) return status;
        if (!work->straight && !pushed(g)) cn_stage_lead(g, false);
        figures->newton++;
        /* an iterate that is expected to be the last, or was so in the step before, is seen without the
         * matrix */
        double expected = isfinite(before) ? over * fmin(1, over / before) : over;
        if (done && cn_stage_iterative(g)) expected = fmin(expected, work->forcing * over);
        const bool last = done + 1 == model->newton || (expected <= 1 && arrived);
        const int then = keep || last || !(work->needed & bit(done)) ? -1 : tangent;
        before = over;
        double fraction = 1;
        if (g->strict && (status = cn_touch_allowed(g, false, &fraction)) != CN_OK) return status;

        /* Where the promised decrease is lost in the energy's round-off the gradient decides. */
        const bool lost = -slope <= 1e-11 * work->energy_size;
        bool other = false; /* direction */
        for (int half = 0;; half++, fraction *= 0.5) {
            if (half == 4 && g->strict && (other = cn_contact_friction_gently(work->contact))) break;
            if (half == 40) return lost ? CN_OK : CN_ERR_CONVERGENCE;
            if (half && !still_free(g, fraction, &status)) {
                if (status != CN_OK) return status;
                continue;
            }
            try_part(g, fraction);
            const double next = evaluate(g, CN_AT_TRIAL, half ? -1 : then);
            const bool better = !arrived ? isfinite(next) /* what they push is another potential */
                                : lost   ? excess(g, true) < over
                                         : next <= energy + 1e-4 * fraction * slope;
            if (!better && half == 0) cn_touch_overshot(g);
            if (better && half == 0 && g->strict) cn_contact_friction_served(work->contact);
            if (model->single || better) {
                assembled = then >= 0;
                energy = half && assembled ? evaluate(g, CN_AT_TRIAL, then) : next;
                break;
            }
            if (lost && half == 3) { /* converged as far as round-off lets it */
                evaluate(g, CN_AT_STATE, -1);
                return CN_OK;
            }
        }
        if (other)
            energy = evaluate(g, CN_AT_STATE, tangent), assembled = true, keep = false;
        else
            take_trial(g, fraction);
    }
}
