/* step.c - one step of one body: stages of the integrator, each a minimum (step_parts.h), h its own step:
 *
 *   euler      h = dt: ahead = dt v0, lag = 0.
 *   midpoint   h = dt/2 to the middle: ahead = h v0, lag = 0; the end is as far again, v1 = 2 v_mid - v0.
 *   trbdf2     g = 2 - sqrt 2, h = g dt/2 (Bank et al. 1985; Hosea and Shampine 1996). Trapezoid to g dt:
 * ahead = 2 h v0, lag = h v0, the start's force in `constant`. Then BDF2 to dt, with a = 1 / (g (2 - g)), b =
 * a - 1: lag = a u_g, ahead = lag + h (a v_g - b v0). Both have one matrix.
 */
#include "step_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "polar.h"

static const double trbdf2_gamma = 0.58578643762690495; /* 2 - sqrt 2 */

/* Vectors out of the one block of memory. */
static void hand_out(cn_work *work, size_t blocks, size_t nodes, size_t points)
{
    double *next = work->memory,
           **const of_blocks[] = {&work->u,        &work->ahead,   &work->lag,      &work->constant,
                                  &work->trial,    &work->trial_u, &work->gradient, &work->elastic,
                                  &work->external, &work->path,    &work->touch,    &work->dx,
                                  &work->moved,    &work->damped,  &work->axis};
    double **const of_nodes[] = {&work->drive.force, &work->drive.centre, &work->drive.tangent,
                                 &work->drive.towards};
    double **const of_points[] = {&work->motion, &work->points, &work->points_trial, &work->points_force};
    for (size_t i = 0; i < sizeof of_blocks / sizeof *of_blocks; i++, next += 3 * blocks)
        *of_blocks[i] = next;
    for (size_t i = 0; i < sizeof of_nodes / sizeof *of_nodes; i++, next += 3 * nodes)
        *of_nodes[i] = next;
    for (size_t i = 0; i < sizeof of_points / sizeof *of_points; i++, next += 3 * points)
        *of_points[i] = next;
    work->drive.weight = next, work->drive.lead = next + nodes, work->drive.pull = next + 2 * nodes;
    work->drive.hold = next + 3 * nodes;
    work->spin = next + 4 * nodes;
    work->factored_turn = work->spin + (blocks > nodes ? 9 * nodes : 0);
}

/* Levels of a chain of stations, NULL: the solver looks for itself. */
static cn_status levels_of(const cn_model_body *body, int **level)
{
    const cn_body *b = body->body;
    *level = NULL;
    if (!body->catheter && b->model != CN_BODY_ROD) return CN_OK;
    if (!(*level = malloc((size_t)b->nblock * sizeof **level))) return CN_ERR_MEMORY;
    for (int i = 0; i < b->nblock; i++)
        (*level)[i] = i % b->nnode / body->per_station;
    return CN_OK;
}

cn_status cn_work_new(cn_work **out, const cn_model *model, int ibody, cn_pool *pool, cn_error *error)
{
    cn_work *work = calloc(1, sizeof *work);
    const cn_model_body *body = &model->body[ibody];
    const cn_body *b = body->body;
    const size_t blocks = (size_t)b->nblock, nodes = (size_t)b->nnode, points = (size_t)b->npoint;
    const cn_body *const bodies[1] = {b};
    const int first[1] = {0};
    cn_status status = CN_ERR_MEMORY;
    int *level = NULL;
    *out = NULL;
    if (!work) return CN_ERR_MEMORY;
    work->model = model, work->body = body, work->pool = pool;
    if (!(work->held = calloc(blocks, 1))) goto fail;
    if (!(work->memory =
              calloc(45 * blocks + 25 * nodes + 12 * points + 4 * (size_t)b->nturn, sizeof(double))))
        goto fail;
    hand_out(work, blocks, nodes, points);
    work->anchored = memchr(body->fixed, 1, blocks) != NULL;
    if ((status = cn_matrix_new(&work->matrix, 1, bodies, first)) != CN_OK) goto fail;
    work->damping = *work->matrix;
    work->damping.value = NULL;
    status = CN_ERR_MEMORY;
    if (b->damping_stiffness > 0 &&
        !(work->damping.value = calloc(9 * (size_t)work->matrix->nblock, sizeof(double))))
        goto fail;
    if ((status = cn_body_bind(&work->scatter, b, work->matrix, 0)) != CN_OK) goto fail;
    if ((status = cn_carry_new(&work->carry, b)) != CN_OK) goto fail;
    if ((status = levels_of(body, &level)) != CN_OK) goto fail;
    if ((status = cn_solver_new(&work->solver, work->matrix, model->scene->solver.linear, level, error)) !=
        CN_OK)
        goto fail;
    if (body->contact && (status = cn_contact_new(&work->contact, body->contact)) != CN_OK) goto fail;
    free(level);
    *out = work;
    return CN_OK;
fail:
    free(level);
    cn_work_free(work);
    return cn_fail(error, status, NULL, 0, "%s", cn_status_text(status));
}

void cn_work_free(cn_work *work)
{
    if (!work) return;
    cn_contact_free(work->contact);
    cn_carry_free(work->carry);
    cn_solver_free(work->solver);
    cn_scatter_free(work->scatter);
    free(work->damping.value);
    cn_matrix_free(work->matrix);
    free(work->held);
    free(work->memory);
    free(work);
}

cn_status cn_work_grow(cn_work *work)
{
    return work->contact ? cn_contact_grow(work->contact) : CN_OK;
}

cn_linear cn_work_linear(const cn_work *work)
{
    return cn_solver_kind(work->solver);
}

/* Gravity, loads that are on, and the drive's held part. */
static void external_force(const cn_stage *s, double time)
{
    cn_work *work = s->work;
    const double late = 1e-6 * s->h; /* a load's window counts whole steps */
    const cn_model_body *body = work->body;
    EACH_FREE(s, i)
    for (int k = 0; k < 3; k++)
        work->external[3 * i + k] = i < body->body->nnode ? body->body->mass[i] * work->model->gravity[k] +
                                                                work->drive.force[3 * i + k]
                                                          : 0;
    for (int l = 0; l < body->nload; l++)
        if (time > body->load[l].from + late && time <= body->load[l].until + late) EACH_FREE(s, i)
    cn_axpy(1, body->load[l].force + 3 * i, work->external + 3 * i);
}

/* A rod's inertia in world axes: R diag(inertia) R' of its frames at the step's start. */
static void turn_inertia(const cn_stage *s)
{
    const cn_body *b = s->work->body->body;
    for (int i = 0; b->nblock > b->nnode && i < s->nfree; i++) {
        double *j = s->work->spin + 9 * (size_t)i, r[9];
        cn_quaternion_matrix(s->rotation + 4 * (size_t)i, r);
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++) {
                j[3 * p + q] = 0;
                for (int k = 0; k < 3; k++)
                    j[3 * p + q] += r[3 * p + k] * b->inertia[3 * i + k] * r[3 * q + k];
            }
    }
}

/* What both the step and its recomputed residual begin with. nfree: of the state at the step's start. */
static void set_up(cn_stage *s, const cn_model *model, int ibody, const cn_body_state *from, int nfree,
                   double *x, double *rotation, const cn_path *path, double dt, cn_work *work)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body *b = body->body;
    const bool rod = b->nblock > b->nnode;
    *s = (cn_stage){.work = work, .from = from, .h = dt, .nfree = nfree, .x = x, .rotation = rotation};
    s->nactive = nfree + body->per_station < b->nnode ? nfree + body->per_station : b->nnode;
    s->again = rod ? b->nnode : nfree;
    s->last = nfree == 0 ? 0 : rod ? b->nnode + nfree : nfree;
    s->rows = rod ? b->nblock : nfree;
    s->strict = body->contact && model->scene->contact.method == CN_CONTACT_STRICT;
    s->free_flight =
        model->inertia && !model->single && !work->anchored && !path && !body->contact && nfree == b->nnode;
    memset(work->held, 1, (size_t)b->nblock);
    EACH_FREE(s, i)
    work->held[i] = body->fixed[i];
    cn_drive_prepare(body, from, path, dt, &work->drive);
    turn_inertia(s);
    memset(work->lag, 0, 3 * (size_t)b->nblock * sizeof(double));
    memset(work->ahead, 0, 3 * (size_t)b->nblock * sizeof(double));
    memset(work->constant, 0, 3 * (size_t)b->nblock * sizeof(double));
}

/* ahead = a v + b w of what is not fixed. */
static void set_ahead(const cn_stage *s, double a, const double *v, double b, const double *w)
{
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++)
        s->work->ahead[k] = s->work->body->fixed[i] ? 0 : a * v[k] + (w ? b * w[k] : 0);
}

/* Sum of nodal drive forces and the base's push; their work over the step. */
static void drive_figures(const cn_stage *s, cn_step_figures *figures)
{
    const cn_work *work = s->work;
    double push = 0;
    for (int i = 0; i < s->nfree; i++) {
        double f[3];
        for (int k = 0; k < 3; k++)
            f[k] = work->drive.force[3 * i + k] + work->path[3 * i + k];
        figures->force += cn_norm(f);
        for (int k = 0; k < 3; k++)
            figures->work += f[k] * (s->x[3 * i + k] - s->from->x[3 * i + k]);
    }
    for (int i = s->nfree; i < s->nactive; i++)
        push -= cn_dot(work->elastic + 3 * i, work->body->direction);
    figures->force += fabs(push);
    figures->work += push * work->drive.advance;
}

/* The force at the start of the step, without inertia, into work->constant. */
static cn_status force_at_start(const cn_stage *s)
{
    cn_work *work = s->work;
    const cn_body *b = work->body->body;
    const size_t all = 3 * (size_t)b->nblock * sizeof(double);
    memset(work->elastic, 0, all), memset(work->touch, 0, all);
    cn_body_add_elastic(b, s->nactive, s->x, s->rotation, work->elastic, CN_TANGENT_WARPED, 1, NULL,
                        work->pool);
    if (s->strict) {
        const cn_status status = cn_stage_start(s, NULL);
        if (status != CN_OK) return status;
        cn_stage_touch(s, s->x);
    }
    if (work->damping.value)
        cn_matrix_multiply(&work->damping, s->rows, s->from->v, work->damped, work->pool);
    EACH_FREE(s, i)
    {
        double pull[3];
        cn_stage_mass(s, i, s->from->v + 3 * i, pull);
        for (int k = 0; k < 3; k++)
            work->constant[3 * i + k] = work->elastic[3 * i + k] + work->touch[3 * i + k] +
                                        work->external[3 * i + k] - b->damping * pull[k];
        if (work->damping.value) cn_axpy(-b->damping_stiffness, work->damped + 3 * i, work->constant + 3 * i);
    }
    return CN_OK;
}

static cn_status step_euler(cn_stage *s, double time, cn_step_figures *figures)
{
    cn_work *work = s->work;
    cn_status status;
    external_force(s, time + s->h);
    set_ahead(s, s->h, s->from->v, 0, NULL);
    /* begin where the velocity leads */
    if ((status = cn_stage_start(s, work->model->single ? NULL : work->ahead)) != CN_OK) return status;
    status = cn_stage_minimise(s, figures);
    if (status != CN_ERR_CONVERGENCE && status != CN_ERR_NOT_FINITE) return status;
    EACH_FREE(s, i)
    { /* or at rest, where that leads too far */
        memset(work->u + 3 * i, 0, 3 * sizeof(double));
        memcpy(s->x + 3 * i, s->from->x + 3 * i, 3 * sizeof(double));
    }
    if ((status = cn_stage_start(s, NULL)) != CN_OK) return status;
    return cn_stage_minimise(s, figures);
}

static cn_status step_midpoint(cn_stage *s, double time, cn_step_figures *figures)
{
    cn_work *work = s->work;
    cn_status status;
    s->h *= 0.5;
    external_force(s, time + s->h);
    set_ahead(s, s->h, s->from->v, 0, NULL);
    if ((status = cn_stage_start(s, work->ahead)) != CN_OK) return status;
    if ((status = cn_stage_minimise(s, figures)) != CN_OK) return status;
    s->h *= 2;
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++) {
        work->u[k] *= 2;
        s->x[k] = s->from->x[k] + work->u[k];
        work->lag[k] = work->body->fixed[i] ? 0 : s->h * s->from->v[k] - work->u[k]; /* v1 = 2 u / dt - v0 */
    }
    return CN_OK;
}

static cn_status step_trbdf2(cn_stage *s, double time, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const double g = trbdf2_gamma, a = 1 / (g * (2 - g)), dt = s->h, *v0 = s->from->v;
    cn_status status;
    s->h = 0.5 * g * dt;
    external_force(s, time + 1e-5 * dt); /* loads that begin now are on */
    if ((status = force_at_start(s)) != CN_OK) return status;
    external_force(s, time + g * dt);
    set_ahead(s, 2 * s->h, v0, 0, NULL);
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++)
        work->lag[k] = 0.5 * work->ahead[k];
    if ((status = cn_stage_start(s, work->ahead)) != CN_OK) return status;
    if ((status = cn_stage_minimise(s, figures)) != CN_OK) return status;

    memset(work->constant, 0, 3 * (size_t)work->body->body->nblock * sizeof(double));
    external_force(s, time + dt);
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++) {
        const double vg = (work->u[k] - work->lag[k]) / s->h;
        work->lag[k] = a * work->u[k];
        work->ahead[k] = work->body->fixed[i] ? 0 : work->lag[k] + s->h * (a * vg - (a - 1) * v0[k]);
        work->dx[k] = (1 - g) * dt * vg;
    }
    if ((status = cn_stage_start(s, work->dx)) != CN_OK) return status;
    return cn_stage_minimise(s, figures);
}

/* What the contact's response makes of the new state, and the check that shares nothing with it. */
static cn_status meet_walls(const cn_stage *s, cn_body_state *to, double dt, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const cn_model_body *body = work->body;
    const cn_body *b = body->body;
    const cn_scene *scene = work->model->scene;
    int naxis, wall;
    if (s->strict) {
        const double *points = cn_body_points(b, s->nactive, to->x, to->rotation, work->points);
        figures->gap = cn_contact_least(work->contact);
        figures->wall_force =
            cn_contact_patch_force(body->contact, work->contact, points, figures->wall_where, &wall);
    } else if (scene->contact.method == CN_CONTACT_PROJECT && !work->carry) {
        double impulse[3] = {0, 0, 0};
        memcpy(work->trial, to->v, 3 * (size_t)s->nfree * sizeof(double));
        cn_contact_project(body->contact, work->contact, s->nfree, to->x, to->v, scene->contact.response,
                           scene->contact.restitution, 20);
        for (int i = 0; i < 3 * s->nfree; i++)
            impulse[i % 3] += b->mass[i / 3] * (to->v[i] - work->trial[i]);
        figures->wall_force = cn_norm(impulse) / dt;
    }
    cn_axis_points(body, to, &naxis, work->axis);
    const double *points = cn_body_points(b, to->nfree, to->x, to->rotation, work->points);
    const cn_status status = cn_contact_check(body->contact, work->contact, cn_body_points_of(b, to->nfree),
                                              points, naxis, work->axis, &figures->findings, work->pool);
    if (figures->findings.outside) figures->gap = fmin(figures->gap, -figures->findings.depth);
    /* never accepted, whatever the response made of it */
    return s->strict && status == CN_OK && figures->findings.intersections + figures->findings.outside > 0
               ? CN_ERR_NOT_FREE
               : status;
}

cn_status cn_step(const cn_model *model, int ibody, const cn_state *state, cn_state *trial,
                  const cn_path *path, double dt, cn_work *work, cn_step_figures *figures)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body *b = body->body;
    const cn_body_state *from = &state->body[ibody];
    cn_body_state *to = &trial->body[ibody];
    const double start = cn_step_seconds();
    cn_status status;
    cn_stage s;

    *figures = (cn_step_figures){.gap = INFINITY};
    cn_state_copy_body(to, from, body);
    set_up(&s, model, ibody, from, from->nfree, to->x, to->rotation, path, dt, work);
    work->collision_s = 0, work->added = 0;
    cn_sheath_advance(body, to, work->drive.advance, dt);
    memset(work->u, 0, 3 * (size_t)b->nblock * sizeof(double));
    if (work->damping.value) {
        cn_matrix_clear(work->matrix, s.rows < b->nblock ? s.nactive : b->nblock);
        cn_body_add_elastic(b, s.nactive, from->x, to->rotation, work->elastic, CN_TANGENT_PROJECTED, 1,
                            work->scatter, work->pool);
        memcpy(work->damping.value, work->matrix->value, 9 * (size_t)work->matrix->nblock * sizeof(double));
    }
    status = model->integrator == CN_INTEGRATOR_MIDPOINT ? step_midpoint(&s, state->time, figures)
             : model->integrator == CN_INTEGRATOR_TRBDF2 ? step_trbdf2(&s, state->time, figures)
                                                         : step_euler(&s, state->time, figures);
    if (status != CN_OK) return status;

    drive_figures(&s, figures);
    EACH_FREE(&s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++)
        to->v[k] = (work->u[k] - work->lag[k]) / s.h;
    cn_body_turn(b, s.nactive, to->x, to->rotation);
    cn_sheath_release(body, to);
    cn_drive_progress(body, to, path);
    const double contact_start = cn_step_seconds();
    if (body->contact) status = meet_walls(&s, to, dt, figures);
    work->collision_s += cn_step_seconds() - contact_start;
    figures->collision_s = work->collision_s;
    figures->fem_s = cn_step_seconds() - start - work->collision_s;
    for (int i = 0; i < 3 * b->nblock; i++)
        if (!isfinite(to->x[i]) || !isfinite(to->v[i])) return CN_ERR_NOT_FINITE;
    return status;
}

/* Rotation vector from frame p to q. */
static void turned(const double p[4], const double q[4], double theta[3])
{
    double d[3], w = 0;
    for (int k = 0; k < 4; k++)
        w += p[k] * q[k];
    const double *a = p + 1, *b = q + 1;
    cn_cross(a, b, d);
    for (int k = 0; k < 3; k++)
        theta[k] = p[0] * b[k] - q[0] * a[k] + d[k];
    const double sine = cn_norm(theta), angle = 2 * atan2(w < 0 ? -sine : sine, fabs(w));
    for (int k = 0; k < 3; k++)
        theta[k] *= sine > 0 ? angle / sine : 2;
}

/* Positions x (work->trial), velocities (trial_u) and accelerations (dx) of the step's last stage from its
 * two ends, and its time. A rod's x is in the chart of the start: rotation vectors since then. */
static double last_stage(const cn_stage *s, const cn_body_state *to, double time, double dt)
{
    cn_work *work = s->work;
    const int nnode = work->body->body->nnode;
    const cn_integrator integrator = work->model->integrator;
    const bool moved = work->model->scene->contact.method == CN_CONTACT_PROJECT; /* nodes, after the solve */
    const double g = trbdf2_gamma, a = 1 / (g * (2 - g)), h = 0.5 * g * dt;
    memset(work->trial_u, 0, 3 * (size_t)work->body->body->nblock * sizeof(double));
    memcpy(work->trial, to->x, 3 * (size_t)work->body->body->nblock * sizeof(double));
    EACH_FREE(s, i)
    {
        const double *v0 = s->from->v + 3 * i, *x0 = s->from->x + 3 * i, *v1 = to->v + 3 * i;
        double *x = work->trial + 3 * i, *v = work->trial_u + 3 * i, *acceleration = work->dx + 3 * i;
        if (i >= nnode && integrator == CN_INTEGRATOR_TRBDF2)
            turned(s->from->rotation + 4 * (i - nnode), to->rotation + 4 * (i - nnode), x);
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
    return integrator == CN_INTEGRATOR_MIDPOINT ? time + 0.5 * dt : time + dt;
}

double cn_step_residual(const cn_model *model, int ibody, const cn_state *state, const cn_state *trial,
                        const cn_path *path, double dt, cn_work *work)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body_state *from = &state->body[ibody], *to = &trial->body[ibody];
    const cn_body *b = body->body;
    const size_t all = 3 * (size_t)b->nblock * sizeof(double);
    double sums[4] = {0, 0, 0, 0}; /* squares: residual, inertial, internal, external */
    cn_stage s;

    set_up(&s, model, ibody, from, from->nfree, to->x, b->nblock > b->nnode ? from->rotation : to->rotation,
           path, dt, work);
    external_force(&s, last_stage(&s, to, state->time, dt));
    memset(work->elastic, 0, all), memset(work->path, 0, all), memset(work->touch, 0, all);
    memset(work->damped, 0, all);
    cn_body_add_elastic(b, s.nactive, work->trial, s.rotation, work->elastic, CN_TANGENT_WARPED, 1, NULL,
                        work->pool);
    cn_drive_add(&work->drive, s.nfree, work->trial, work->path, 1, NULL);
    if (s.strict) {
        s.x = work->trial;
        if (cn_stage_start(&s, NULL) == CN_OK) cn_stage_touch(&s, s.x);
        s.x = to->x;
    }
    if (work->damping.value) /* of the tangent at the step's start, as in the step */
        cn_matrix_multiply(&work->damping, s.rows, work->trial_u, work->damped, work->pool);
    EACH_FREE(&s, i)
    {
        const double over = i < b->nnode ? 1 : 1 / (b->lever * b->lever);
        double inertial[3], pull[3], left[3];
        if (body->fixed[i]) continue;
        cn_stage_mass(&s, i, work->dx + 3 * i, inertial), cn_stage_mass(&s, i, work->trial_u + 3 * i, pull);
        for (int k = 0; k < 3; k++) {
            inertial[k] = (model->inertia ? inertial[k] : 0) + b->damping * pull[k];
            left[k] = inertial[k] + b->damping_stiffness * work->damped[3 * i + k] -
                      work->elastic[3 * i + k] - work->external[3 * i + k] - work->path[3 * i + k] -
                      work->touch[3 * i + k];
        }
        sums[0] += over * cn_norm2(left), sums[1] += over * cn_norm2(inertial);
        sums[2] += over * cn_norm2(work->elastic + 3 * i), sums[3] += over * cn_norm2(work->external + 3 * i);
    }
    const double scale = sqrt(fmax(sums[1], fmax(sums[2], sums[3]))), floor = cn_stage_floor(&s);
    const double rest = sqrt(sums[0]);
    return rest > floor ? rest / fmax(scale, floor) : 0;
}

cn_status cn_work_check(const cn_model *model, int ibody, const cn_state *state, cn_work *work,
                        cn_findings *findings)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body_state *at = &state->body[ibody];
    int naxis;
    *findings = (cn_findings){.body_triangle = -1, .wall = -1, .wall_triangle = -1};
    if (!body->contact) return CN_OK;
    cn_axis_points(body, at, &naxis, work->axis);
    return cn_contact_check(body->contact, work->contact, cn_body_points_of(body->body, at->nfree),
                            cn_body_points(body->body, at->nfree, at->x, at->rotation, work->points), naxis,
                            work->axis, findings, work->pool);
}
