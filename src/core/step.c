/* step.c - one step of all bodies that are solved together: stages of the integrator, each a minimum
 * (step_parts.h), h its own step:
 *
 *   euler      h = dt: ahead = dt v0, lag = 0.
 *   midpoint   h = dt/2 to the middle: ahead = h v0, lag = 0; the end is as far again, v1 = 2 v_mid - v0.
 *   trbdf2     g = 2 - sqrt 2, h = g dt/2 (Bank et al. 1985; Hosea and Shampine 1996). Trapezoid to g dt:
 * ahead = 2 h v0, lag = h v0, the start's force in `constant`. Then BDF2 to dt, with a = 1 / (g (2 - g)), b =
 * a - 1: lag = a u_g, ahead = lag + h (a v_g - b v0). Both have one matrix.
 *
 * `explicit` seeks no minimum: step_explicit.c.
 */
#include "step_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "body_wall.h"
#include "polar.h"
#include "rod_spin.h"

static const double trbdf2_gamma = 0.58578643762690495; /* 2 - sqrt 2 */

void cn_stage_external(const cn_stage *s, double time)
{
    cn_part *part = s->part;
    const double late = 1e-6 * s->h; /* a load's window counts whole steps */
    const cn_model_body *body = part->body;
    EACH_FREE(s, i)
    for (int k = 0; k < 3; k++)
        part->external[3 * i + k] = i < body->body->nnode ? body->body->mass[i] * part->model->gravity[k] +
                                                                part->drive.force[3 * i + k]
                                                          : 0;
    for (int l = 0; l < body->nload; l++)
        if (time > body->load[l].from + late && time <= body->load[l].until + late) EACH_FREE(s, i)
    cn_axpy(1, body->load[l].force + 3 * i, part->external + 3 * i);
}

/* A rod's inertia in world axes: R diag(inertia) R' of its frames at the step's start. */
static void turn_inertia(const cn_stage *s)
{
    const cn_body *b = s->part->body->body;
    for (int i = 0; b->nblock > b->nnode && i < s->nfree; i++) {
        double *j = s->part->spin + 9 * (size_t)i, r[9];
        cn_quaternion_matrix(s->rotation + 4 * (size_t)i, r);
        const double *d = b->inertia + 3 * i;
        for (int p = 0; p < 3; p++)
            for (int q = 0; q <= p; q++)
                j[3 * p + q] = j[3 * q + p] = r[3 * p] * d[0] * r[3 * q] +
                                              r[3 * p + 1] * d[1] * r[3 * q + 1] +
                                              r[3 * p + 2] * d[2] * r[3 * q + 2];
    }
}

/* A body in the first stage. */
static void set_up(cn_stage *s, cn_part *part, const cn_body_state *from, double *x, double *rotation,
                   const cn_path *path, double dt)
{
    const cn_model *model = part->model;
    const cn_model_body *body = part->body;
    const cn_body *b = body->body;
    cn_drive_prepare(body, from, path, dt, &part->drive);
    const int nfree = part->drive.nfree;
    const bool rod = b->nblock > b->nnode;
    *s = (cn_stage){
        .part = part, .from = from, .h = dt, .nfree = nfree, .x = x, .rotation = rotation, .path = path};
    s->nactive = nfree + body->per_station < b->nnode ? nfree + body->per_station : b->nnode;
    s->again = rod ? b->nnode : nfree;
    s->last = nfree == 0 ? 0 : rod ? b->nnode + nfree : nfree;
    s->rows = rod ? b->nblock : nfree;
    s->free_flight = model->inertia && !model->single && !part->anchored && !path && nfree == b->nnode;
    memset(part->held, 1, (size_t)b->nblock);
    EACH_FREE(s, i)
    part->held[i] = body->fixed[i];
    turn_inertia(s);
    memset(part->lag, 0, 3 * (size_t)b->nblock * sizeof(double));
    memset(part->ahead, 0, 3 * (size_t)b->nblock * sizeof(double));
    memset(part->constant, 0, 3 * (size_t)b->nblock * sizeof(double));
}

/* The body has room enough to go on for a step, and faster than it does now, without meeting itself. */
static bool stays_unfolded(cn_part *part, const cn_body_state *state, double dt)
{
    double fast = 0;
    part->room = cn_fold_room(part->body, state, part->axis);
    for (int i = 0; i < state->nfree; i++)
        fast = fmax(fast, cn_norm2(state->v + 3 * i));
    return part->room > part->body->diameter + 4 * dt * sqrt(fast);
}

/* What both the step and its recomputed residual begin with. */
static void group_up(cn_group *g, cn_work *work, const cn_state *state, cn_state *trial,
                     const cn_path *const *path, double dt)
{
    *g = (cn_group){.work = work, .n = work->npart, .stage = work->stage};
    bool near = work->surfaces && work->surfaces->nsurface > 1;
    for (int p = 0; work->surfaces && p < work->npart; p++)
        near |= work->surfaces->surface[p].self =
            work->part[p].body->self && (work->part[p].body->self_always ||
                                         !stays_unfolded(&work->part[p], &state->body[work->first + p], dt));
    g->strict = near && work->model->touches && work->model->scene->contact.method == CN_CONTACT_STRICT;
    g->pressed = work->penalty && near && work->model->touches;
    for (int p = 0; p < work->npart; p++) {
        cn_part *part = &work->part[p];
        const cn_body_state *from = &state->body[part->index];
        cn_body_state *to = &trial->body[part->index];
        set_up(&g->stage[p], part, from, to->x, to->rotation, path ? path[part->index] : NULL, dt);
        g->stage[p].free_flight &= !g->strict && !g->pressed;
    }
}

/* ahead = a v + b w of what is not fixed. */
static void set_ahead(const cn_stage *s, double a, const double *v, double b, const double *w)
{
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++)
        s->part->ahead[k] = s->part->body->fixed[i] ? 0 : a * v[k] + (w ? b * w[k] : 0);
}

/* Sum of nodal drive forces and the base's push; their work over the step. */
static void drive_figures(const cn_stage *s, cn_step_figures *figures)
{
    const cn_part *part = s->part;
    const int nnode = part->body->body->nnode;
    double push = 0, torque = 0;
    for (int i = 0; i < s->nfree; i++) {
        double f[3];
        for (int k = 0; k < 3; k++)
            f[k] = part->drive.force[3 * i + k] + part->path[3 * i + k];
        figures->force += cn_norm(f);
        for (int k = 0; k < 3; k++)
            figures->work += f[k] * (s->x[3 * i + k] - s->from->x[3 * i + k]);
    }
    for (int i = s->nfree; i < s->nactive; i++) {
        double arm[3], moment[3];
        push -= cn_dot(part->elastic + 3 * i, part->body->direction);
        cn_sub(s->x + 3 * i, part->body->entry, arm);
        cn_cross(arm, part->elastic + 3 * i, moment);
        torque -= cn_dot(nnode < part->body->body->nblock ? part->elastic + 3 * (nnode + i) : moment,
                         part->body->direction);
    }
    figures->force += fabs(push);
    figures->work += push * part->drive.advance + torque * part->drive.turn;
}

/* The force at the start of the step, without inertia, into part->constant. */
static cn_status force_at_start(const cn_group *g)
{
    cn_status status;
    EACH_STAGE(g, s)
    memset(s->part->touch, 0, 3 * (size_t)s->part->body->body->nblock * sizeof(double));
    if (g->strict) {
        if ((status = cn_stage_start(g, false)) != CN_OK) return status;
        cn_touch(g, CN_AT_STATE, false, false);
    }
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = part->body->body;
        memset(part->elastic, 0, 3 * (size_t)b->nblock * sizeof(double));
        cn_body_add_elastic(b, s->nactive, s->x, s->rotation, part->elastic, CN_TANGENT_WARPED, 1, NULL,
                            part->pool);
        if (part->damping.value)
            cn_matrix_multiply(&part->damping, s->rows, s->from->v, part->damped, part->pool);
        EACH_FREE(s, i)
        {
            double pull[3];
            cn_stage_mass(s, i, s->from->v + 3 * i, pull);
            for (int k = 0; k < 3; k++)
                part->constant[3 * i + k] = part->elastic[3 * i + k] + part->touch[3 * i + k] +
                                            part->external[3 * i + k] - b->damping * pull[k];
            if (part->damping.value)
                cn_axpy(-b->damping_stiffness, part->damped + 3 * i, part->constant + 3 * i);
        }
    }
    return CN_OK;
}

/* The motion to begin with. */
static void go_ahead(const cn_group *g, bool chord)
{
    EACH_STAGE(g, s)
    EACH_FREE(s, i)
    cn_copy3(s->part->ahead + 3 * i, s->part->dx + 3 * i);
    cn_stage_lead(g, chord);
}

static cn_status step_euler(const cn_group *g, double time, cn_step_figures *figures)
{
    cn_status status;
    EACH_STAGE(g, s)
    {
        cn_stage_external(s, time + s->h);
        set_ahead(s, s->h, s->from->v, 0, NULL);
    }
    go_ahead(g, true);
    if ((status = cn_stage_start(g, !g->work->model->single)) != CN_OK) return status;
    status = cn_stage_minimise(g, figures);
    if ((status != CN_ERR_CONVERGENCE && status != CN_ERR_NOT_FINITE) || g->work->moving) return status;
    g->work->straight = true;
    EACH_STAGE(g, s)
    EACH_FREE(s, i)
    { /* or at rest, where that leads too far */
        memset(s->part->u + 3 * i, 0, 3 * sizeof(double));
        memcpy(s->x + 3 * i, s->from->x + 3 * i, 3 * sizeof(double));
    }
    if ((status = cn_stage_start(g, false)) != CN_OK) return status;
    return cn_stage_minimise(g, figures);
}

static cn_status step_midpoint(const cn_group *g, double time, cn_step_figures *figures)
{
    cn_status status;
    EACH_STAGE(g, s)
    {
        s->h *= 0.5;
        cn_stage_external(s, time + s->h);
        set_ahead(s, s->h, s->from->v, 0, NULL);
    }
    go_ahead(g, false);
    if ((status = cn_stage_start(g, true)) != CN_OK) return status;
    if ((status = cn_stage_minimise(g, figures)) != CN_OK) return status;
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        s->h *= 2;
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            part->u[k] *= 2;
            s->x[k] = s->from->x[k] + part->u[k];
            part->lag[k] =
                part->body->fixed[i] ? 0 : s->h * s->from->v[k] - part->u[k]; /* v1 = 2 u / dt - v0 */
        }
    }
    return CN_OK;
}

static cn_status step_trbdf2(const cn_group *g, double time, double dt, cn_step_figures *figures)
{
    const double c = trbdf2_gamma, a = 1 / (c * (2 - c));
    cn_status status;
    EACH_STAGE(g, s)
    {
        s->h = 0.5 * c * dt;
        cn_stage_external(s, time + 1e-5 * dt); /* loads that begin now are on */
    }
    if ((status = force_at_start(g)) != CN_OK) return status;
    EACH_STAGE(g, s)
    {
        cn_stage_external(s, time + c * dt);
        set_ahead(s, 2 * s->h, s->from->v, 0, NULL);
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++)
            s->part->lag[k] = 0.5 * s->part->ahead[k];
    }
    go_ahead(g, false);
    if ((status = cn_stage_start(g, true)) != CN_OK) return status;
    if ((status = cn_stage_minimise(g, figures)) != CN_OK) return status;

    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        memset(part->constant, 0, 3 * (size_t)part->body->body->nblock * sizeof(double));
        cn_stage_external(s, time + dt);
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            const double vg = (part->u[k] - part->lag[k]) / s->h;
            part->lag[k] = a * part->u[k];
            part->ahead[k] =
                part->body->fixed[i] ? 0 : part->lag[k] + s->h * (a * vg - (a - 1) * s->from->v[k]);
            part->dx[k] = (1 - c) * dt * vg;
        }
    }
    if ((status = cn_stage_start(g, true)) != CN_OK) return status;
    return cn_stage_minimise(g, figures);
}

/* Where moving walls are at the step's start, and where they go. */
static void place_walls(cn_work *work, double from, double to)
{
    const cn_contact_model *surfaces = work->surfaces;
    work->way_left = 1;
    for (int w = work->npart; work->moving && w < surfaces->nsurface; w++) {
        const cn_contact_surface *wall = &surfaces->surface[w];
        double start[3], end[3];
        if (!wall->moving) continue;
        cn_wall_shift(&work->model->world->wall[wall->wall], from, start);
        cn_wall_shift(&work->model->world->wall[wall->wall], to, end);
        for (int i = 0; i < 3 * wall->npoint; i++) {
            const size_t at = 3 * (size_t)wall->first + (size_t)i;
            work->points[at] = wall->rest[i] + start[i % 3];
            work->goal[at] = wall->rest[i] + end[i % 3];
        }
    }
}

/* Below this a sliding in a step is the creep of what sticks: at a 1e-5th of the speed that gravity gives in
 * a step or a thousandth of what a drive asks for; without either, by a 1e-4th of contact's gap. */
static double slip_of(const cn_work *work, double dt)
{
    const cn_model *model = work->model;
    double speed = 1e-5 * cn_norm(model->gravity) * model->dt;
    for (int p = 0; p < work->npart; p++) {
        const cn_body_spec *spec = work->part[p].body->spec;
        if (spec->nwaypoint || spec->drive.mode != CN_DRIVE_FOLLOW)
            speed = fmax(speed, 1e-3 * spec->drive.speed);
    }
    if (!(model->scene->contact.friction > 0)) return 0;
    return speed > 0 ? speed * dt : 1e-4 * work->surfaces->gap * dt / model->dt;
}

static bool bounces(const cn_model *model)
{
    return model->scene->contact.response == CN_RESPONSE_ELASTIC;
}

/* For friction and restitution: where everything is at the step's start. */
static void begin(const cn_group *g, double dt)
{
    cn_work *work = g->work;
    work->slip = slip_of(work, dt);
    work->contact->nrub = 0;
    if (!(work->slip > 0) && !bounces(work->model)) return;
    memcpy(work->begin, work->points, 3 * (size_t)work->surfaces->npoint * sizeof *work->begin); /* walls */
    cn_touch_points(g, CN_AT_STATE, work->begin);
}

static void follow_wall(const cn_stage *s, cn_body_state *to)
{
    const cn_body *b = s->part->body->body;
    if (!memcmp(to->x, s->from->x, 3 * (size_t)b->nnode * sizeof(double))) return;
    cn_sheet_follow(b, to->x, to->rotation,
                    cn_sheet_turns(b, to->rotation) ? CN_SHEET_FOLLOWS : CN_SHEET_TURNS, s->part->pool);
}

cn_status cn_step(const cn_model *model, const cn_state *state, cn_state *trial, const cn_path *const *path,
                  double dt, cn_work *work, cn_step_figures *figures)
{
    const double start = cn_step_seconds();
    const bool explicit = model->integrator == CN_INTEGRATOR_EXPLICIT;
    cn_group g;
    cn_status status;

    for (int p = 0; p < work->npart; p++)
        cn_state_copy_body(&trial->body[work->first + p], &state->body[work->first + p], work->part[p].body);
    group_up(&g, work, state, trial, path, dt);
    work->needed = state->body[work->first].needed;
    work->stale = state->step % 16 ? state->body[work->first].stale : 0; /* now and then it is tried again */
    work->collision_s = 0, work->added = 0, work->straight = false;
    EACH_STAGE(&g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = part->body->body;
        figures[s - g.stage] = (cn_step_figures){.gap = INFINITY};
        cn_sheath_advance(part->body, &trial->body[part->index], part->drive.advance, part->drive.turn,
                          s->nfree, dt);
        cn_push_bend(part->body, &trial->body[part->index], part->drive.bend);
        memset(part->u, 0, 3 * (size_t)b->nblock * sizeof(double));
        if (!part->damping.value || explicit) continue;
        cn_matrix_clear(part->matrix, s->rows < b->nblock ? s->nactive : b->nblock);
        cn_body_add_elastic(b, s->nactive, s->from->x, s->rotation, part->elastic, CN_TANGENT_PROJECTED, 1,
                            part->scatter, part->pool);
        memcpy(part->damping.value, part->matrix->value, 9 * (size_t)part->matrix->nblock * sizeof(double));
    }
    if (work->surfaces) place_walls(work, state->time, state->time + dt);
    if (g.strict) begin(&g, dt);
    if (!g.strict && work->surfaces) { /* what does not meet walls on the way sees where they go to */
        place_walls(work, state->time + dt, state->time + dt);
        work->way_left = 0;
        if (g.pressed && (status = cn_stage_penetrations(&g)) != CN_OK) return status;
    }
    status = model->integrator == CN_INTEGRATOR_MIDPOINT ? step_midpoint(&g, state->time, figures)
             : model->integrator == CN_INTEGRATOR_TRBDF2 ? step_trbdf2(&g, state->time, dt, figures)
             : explicit                                  ? cn_step_explicit(&g, trial, state->time, dt)
                                                         : step_euler(&g, state->time, figures);
    if (status != CN_OK) return status;
    trial->body[work->first].needed = work->needed, trial->body[work->first].stale = work->stale;
    const bool gives_back = g.strict && bounces(model);
    if (gives_back && (status = cn_stage_bounce(&g)) != CN_OK) return status;

    EACH_STAGE(&g, s)
    {
        cn_body_state *to = &trial->body[s->part->index];
        drive_figures(s, &figures[s - g.stage]);
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3 && !explicit; k++)
            to->v[k] = (s->part->u[k] - s->part->lag[k]) / s->h + (gives_back ? s->part->ahead[k] : 0);
        cn_body_turn(s->part->body->body, s->nactive, to->x, to->rotation);
        if (s->part->sheet) follow_wall(s, to);
        cn_sheath_release(s->part->body, to);
        cn_drive_progress(s->part->body, to, s->path);
    }
    const double contact_start = cn_step_seconds();
    if (work->surfaces && model->touches) status = cn_stage_meet(&g, trial, dt, figures);
    work->collision_s += cn_step_seconds() - contact_start;
    figures->collision_s = work->collision_s;
    figures->fem_s = cn_step_seconds() - start - work->collision_s;
    EACH_STAGE(&g, s)
    {
        const cn_body_state *to = &trial->body[s->part->index];
        for (int i = 0; i < 3 * s->part->body->body->nblock; i++)
            if (!isfinite(to->x[i]) || !isfinite(to->v[i])) return CN_ERR_NOT_FINITE;
    }
    return status;
}

/* Positions x (part->trial), velocities (trial_u) and accelerations (dx) of the step's last stage from its
 * two ends, and its time. A rod's x is in the chart of the start: rotation vectors since then. */
static double last_stage(const cn_stage *s, const cn_body_state *to, double time, double dt)
{
    cn_part *part = s->part;
    const int nnode = part->body->body->nnode;
    const cn_integrator integrator = part->model->integrator;
    /* nodes or velocities were changed after the solve */
    const bool moved = part->model->scene->contact.method == CN_CONTACT_PROJECT ||
                       (part->model->scene->contact.method == CN_CONTACT_STRICT && bounces(part->model));
    const double g = trbdf2_gamma, a = 1 / (g * (2 - g)), h = 0.5 * g * dt;
    memset(part->trial_u, 0, 3 * (size_t)part->body->body->nblock * sizeof(double));
    memcpy(part->trial, to->x, 3 * (size_t)part->body->body->nblock * sizeof(double));
    EACH_FREE(s, i)
    {
        const double *v0 = s->from->v + 3 * i, *x0 = s->from->x + 3 * i, *v1 = to->v + 3 * i;
        double *x = part->trial + 3 * i, *v = part->trial_u + 3 * i, *acceleration = part->dx + 3 * i;
        if (i >= nnode && (integrator == CN_INTEGRATOR_TRBDF2 || moved))
            cn_spin_between(s->from->rotation + 4 * (i - nnode), to->rotation + 4 * (i - nnode), x);
        for (int k = 0; k < 3; k++)
            if (integrator == CN_INTEGRATOR_TRBDF2) {
                const double vg = (x[k] - x0[k] - h * v1[k]) / (a * h) - v0[k];
                v[k] = v1[k], acceleration[k] = (v1[k] - a * vg + (a - 1) * v0[k]) / h;
            } else if (integrator == CN_INTEGRATOR_MIDPOINT) {
                v[k] = 0.5 * (v0[k] + v1[k]), acceleration[k] = (v1[k] - v0[k]) / dt;
                x[k] = x0[k] + 0.5 * dt * v[k];
            } else {
                v[k] = moved ? (x[k] - x0[k]) / dt : v1[k], acceleration[k] = (v[k] - v0[k]) / dt;
                if (i >= nnode) x[k] = dt * v[k];
            }
    }
    for (int i = s->nfree; nnode < part->body->body->nblock && i < s->nactive; i++) /* turned by the base */
        cn_spin_between(s->from->rotation + 4 * i, to->rotation + 4 * i, part->trial + 3 * (nnode + i));
    return integrator == CN_INTEGRATOR_MIDPOINT ? time + 0.5 * dt : time + dt;
}

/* Of one body: |inertial + damping - elastic - external - drive - contact| over the largest of the norms. */
static double residual_of(cn_stage *s)
{
    const cn_part *part = s->part;
    const cn_model *model = part->model;
    const cn_body *b = part->body->body;
    double sums[4] = {0, 0, 0, 0}; /* squares: residual, inertial, internal, external */
    EACH_FREE(s, i)
    {
        const double over = i < b->nnode ? 1 : 1 / (b->lever * b->lever);
        double inertial[3], pull[3], left[3];
        if (part->body->fixed[i]) continue;
        cn_stage_mass(s, i, part->dx + 3 * i, inertial), cn_stage_mass(s, i, part->trial_u + 3 * i, pull);
        for (int k = 0; k < 3; k++) {
            inertial[k] = (model->inertia ? inertial[k] : 0) + b->damping * pull[k];
            left[k] = inertial[k] + b->damping_stiffness * part->damped[3 * i + k] -
                      part->elastic[3 * i + k] - part->external[3 * i + k] - part->path[3 * i + k] -
                      part->touch[3 * i + k];
        }
        sums[0] += over * cn_norm2(left), sums[1] += over * cn_norm2(inertial);
        sums[2] += over * cn_norm2(part->elastic + 3 * i), sums[3] += over * cn_norm2(part->external + 3 * i);
    }
    const double scale = sqrt(fmax(sums[1], fmax(sums[2], sums[3]))), floor = cn_stage_floor(s);
    const double rest = sqrt(sums[0]);
    return rest > floor ? rest / fmax(scale, floor) : 0;
}

/* A body that lies where it lay, and nothing moves it. */
static bool lies_still(const cn_stage *s, const cn_body_state *to)
{
    const cn_part *part = s->part;
    const cn_body *b = part->body->body;
    const size_t all = 3 * (size_t)b->nblock * sizeof(double);
    if (memcmp(to->x, s->from->x, all) || cn_stage_touched(s) || s->nfree < b->nnode) return false;
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++)
        if (to->v[k] != 0 || s->from->v[k] != 0 || part->external[k] != 0 || part->path[k] != 0) return false;
    return true;
}

/* A rod's frames; with a steered end as it was bent in the step. */
static double *frames_at_start(const cn_part *part, const cn_body_state *from, const cn_body_state *to)
{
    const size_t last = 4 * (size_t)part->body->body->nnode;
    if (from->rotation[last] == to->rotation[last]) return from->rotation;
    memcpy(part->bent, from->rotation, last * sizeof *part->bent);
    memcpy(part->bent + last, to->rotation + last, 4 * sizeof *part->bent);
    return part->bent;
}

double cn_step_residual(const cn_model *model, const cn_state *state, const cn_state *trial,
                        const cn_path *const *path, double dt, cn_work *work)
{
    double most = 0;
    cn_group g;
    if (model->integrator == CN_INTEGRATOR_EXPLICIT) return 0; /* nothing was solved for */
    group_up(&g, work, state, (cn_state *)trial, path, dt);
    if (work->surfaces) {
        const double then = g.pressed ? state->time + dt : state->time;
        place_walls(work, then, then);
        EACH_STAGE(&g, s)
        s->x = s->from->x, s->rotation = s->from->rotation;
        if (g.strict) begin(&g, dt);
        if (g.pressed) cn_stage_penetrations(&g);
    }
    EACH_STAGE(&g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = part->body->body;
        const cn_body_state *to = &trial->body[part->index];
        const size_t all = 3 * (size_t)b->nblock * sizeof(double);
        s->rotation = b->nblock > b->nnode ? frames_at_start(part, s->from, to)
                      : part->sheet        ? s->from->rotation
                                           : to->rotation;
        cn_stage_external(s, last_stage(s, to, state->time, dt));
        memset(part->elastic, 0, all), memset(part->path, 0, all), memset(part->touch, 0, all);
        memset(part->damped, 0, all);
        cn_drive_add(&part->drive, s->nfree, part->trial, part->path, 1, NULL);
        s->x = part->trial;
    }
    if (g.strict) {
        place_walls(work, state->time + dt, state->time + dt);
        if (cn_touch_find(&g, false) == CN_OK) {
            if (work->slip > 0) cn_touch_note(&g, model->scene->contact.friction);
            cn_touch(&g, CN_AT_STATE, false, false);
        }
    }
    if (g.pressed) cn_stage_add_penalty(&g, CN_AT_STATE, false);
    EACH_STAGE(&g, s)
    {
        cn_part *part = s->part;
        if (lies_still(s, &trial->body[part->index])) continue;
        cn_body_add_elastic(part->body->body, s->nactive, part->trial, s->rotation, part->elastic,
                            CN_TANGENT_WARPED, 1, NULL, part->pool);
        if (part->damping.value) /* of the tangent at the step's start, as in the step */
            cn_matrix_multiply(&part->damping, s->rows, part->trial_u, part->damped, part->pool);
        most = fmax(most, residual_of(s));
    }
    return most;
}

cn_status cn_work_check(const cn_state *state, cn_work *work, cn_findings *findings)
{
    *findings = (cn_findings){.surface = {-1, -1}, .triangle = {-1, -1}};
    if (!work->surfaces) return CN_OK;
    place_walls(work, state->time, state->time);
    return cn_stage_check(work, state, findings);
}
