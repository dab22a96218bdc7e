/* run_record.c - what a run leaves behind: verdict, samples, frames, the report's figures. */
#include "run_parts.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "catnav/vec3.h"
#include "polar.h"
#include "tree.h"

double cn_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void cn_run_verdict(cn_run_data *run, cn_verdict_code code, const char *format, ...)
{
    cn_verdict *verdict = &run->report->verdict;
    va_list arguments;
    verdict->code = code;
    va_start(arguments, format);
    vsnprintf(verdict->message, sizeof verdict->message, format, arguments);
    va_end(arguments);
}

/* Where body b's base is; before the first step where it began. */
static cn_insertion insertion_at(const cn_run_data *run, int b, bool begin)
{
    const cn_body_state *now = &run->state->body[b];
    const cn_drive_spec *drive = &run->spec[b].drive;
    cn_insertion at = {.body = b, .advance = run->spec[b].shape.catheter.inserted};
    if (!begin) at = (cn_insertion){b, run->state->step, run->state->time, now->inserted, now->twist, 0};
    at.curvature = drive->bend_curvature;
    if (drive->bend_steered) at.curvature *= begin ? 0 : cn_push_bent(&run->model->body[b], now);
    return at;
}

/* Notes where the bases of push drives are; when all places are taken, every second note is let go. What lies
 * ahead of this step was taken back. */
static cn_status note_insertion(cn_run_data *run, bool last)
{
    cn_report *report = run->report;
    int npush = 0, kept = 0;
    for (int b = 0; b < run->nbody; b++)
        npush += run->spec[b].drive.mode == CN_DRIVE_PUSH;
    const size_t most = 1000 * (size_t)npush;
    if (npush == 0) return CN_OK;
    const int step = run->state->step;
    if (!report->drive.insertion) {
        if (!(report->drive.insertion = calloc(most, sizeof(cn_insertion)))) return CN_ERR_MEMORY;
        run->insertion_stride = 1;
        for (int b = 0; b < run->nbody; b++) /* where they began */
            if (run->spec[b].drive.mode == CN_DRIVE_PUSH)
                report->drive.insertion[report->drive.ninsertion++] = insertion_at(run, b, true);
    }
    cn_insertion *list = report->drive.insertion;
    while (report->drive.ninsertion > 0 && list[report->drive.ninsertion - 1].step >= step)
        report->drive.ninsertion--;
    if (!last && (size_t)(report->drive.ninsertion + 2 * npush) > most) { /* room for the last one stays */
        run->insertion_stride *= 2;
        for (int i = 0; i < report->drive.ninsertion; i++)
            if (list[i].step % run->insertion_stride == 0) list[kept++] = list[i];
        report->drive.ninsertion = kept;
    }
    if (!last && step % run->insertion_stride != 0) return CN_OK;
    for (int b = 0; b < run->nbody; b++)
        if (run->spec[b].drive.mode == CN_DRIVE_PUSH)
            list[report->drive.ninsertion++] = insertion_at(run, b, false);
    return CN_OK;
}

/* Holds the times of a step; a long run holds those of every 2nd, 4th, ... step, so that it ends with the
 * memory it began with. */
static cn_status hold_times(cn_run_data *run, const double ms[3])
{
    enum { MOST = 1 << 15 };
    double **const lists[] = {&run->fem_ms, &run->collision_ms, &run->step_ms};
    if (run->sample_stride == 0) run->sample_stride = 1;
    if (run->nsample % run->sample_stride != 0) return CN_OK;
    if (run->nheld == MOST) {
        run->sample_stride *= 2, run->nheld /= 2;
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < run->nheld; k++)
                (*lists[i])[k] = (*lists[i])[2 * k];
    }
    if (run->nheld == run->sample_capacity) {
        const int capacity = run->sample_capacity ? 2 * run->sample_capacity : 1024;
        for (int i = 0; i < 3; i++) {
            double *more = realloc(*lists[i], (size_t)capacity * sizeof *more);
            if (!more) return CN_ERR_MEMORY;
            *lists[i] = more;
        }
        run->sample_capacity = capacity;
    }
    for (int i = 0; i < 3; i++)
        (*lists[i])[run->nheld] = ms[i];
    run->nheld++;
    return CN_OK;
}

cn_status cn_run_sample(cn_run_data *run, const cn_step_figures *figures, double step_s)
{
    const double ms[] = {1e3 * figures->fem_s, 1e3 * figures->collision_s, 1e3 * step_s};
    const cn_status status = hold_times(run, ms);
    if (status != CN_OK) return status;
    for (int i = 0; i < 3; i++)
        run->worst_ms[i] = fmax(run->worst_ms[i], ms[i]);
    run->last_ms[run->nsample++ % CN_LAST_STEPS] = ms[2];

    cn_report *report = run->report;
    run->kept += figures->kept;
    report->time.simulation_s += step_s - figures->collision_s;
    report->time.collision_s += figures->collision_s;
    report->solver.newton_max =
        figures->newton > report->solver.newton_max ? figures->newton : report->solver.newton_max;
    report->solver.linear_max =
        figures->linear > report->solver.linear_max ? figures->linear : report->solver.linear_max;
    report->solver.residual_max = fmax(report->solver.residual_max, figures->residual);
    report->drive.force_max = fmax(report->drive.force_max, figures->force);
    report->drive.work += figures->work;
    report->contact.force_max = fmax(report->contact.force_max, figures->wall_force);
    if (isfinite(figures->gap) && !(report->contact.gap_min <= figures->gap))
        report->contact.gap_min = figures->gap;
    if (run->scene->contact.method == CN_CONTACT_PENALTY)
        report->contact.momentum_error = fmax(0, report->contact.momentum_error) + figures->momentum_error;
    report->contact.intersections += figures->findings.intersections;
    report->contact.outside_nodes += figures->findings.outside;
    return note_insertion(run, false);
}

int cn_run_active(const cn_model_body *body, const cn_body_state *state)
{
    const int nnode = body->body->nnode, held = state->nfree < nnode ? body->per_station : 0;
    return state->nfree + held < nnode ? state->nfree + held : nnode;
}

const double *cn_run_points(const cn_run_data *run, int b, const cn_state *state, int nactive)
{
    return cn_body_points(run->model->body[b].body, nactive, state->body[b].x, state->body[b].rotation,
                          run->body[b].points);
}

const double *cn_run_met(const cn_run_data *run, int b, const cn_state *state, int nactive)
{
    return cn_body_points(cn_touch_body(&run->model->body[b]), nactive, state->body[b].x,
                          state->body[b].rotation, run->body[b].points);
}

double cn_run_far_gap(const cn_run_data *run, int b, const cn_state *state)
{
    double least = isfinite(run->report->contact.gap_min) ? run->report->contact.gap_min : INFINITY;
    for (int w = 0; w < run->world->nwall; w++) /* only what rests can be asked at its rest */
        if (cn_gives_way(run->world->wall[w].spec) || cn_wall_moves(&run->world->wall[w])) return INFINITY;
    const double before = least, *x = cn_run_met(run, b, state, state->body[b].nfree);
    const int npoint = cn_body_points_of(cn_touch_body(&run->model->body[b]), state->body[b].nfree);
    for (int w = 0; w < run->world->nwall; w++)
        for (int i = 0; i < npoint; i++) {
            int tri;
            double nearest[3];
            least = fmin(least, cn_tree_nearest(run->world->wall[w].tree, x + 3 * i, least, &tri, nearest));
        }
    return least < before ? least : INFINITY;
}

static void mean_point(int n, const double *x, double mean[3])
{
    mean[0] = mean[1] = mean[2] = 0;
    for (int i = 0; i < n; i++)
        cn_axpy(1.0 / n, x + 3 * i, mean);
}

double cn_shape_error(int n, const double *x, const double *rest, double size)
{
    double to[3], from[3], covariance[9] = {0}, q[4], r[9], most = 0;
    mean_point(n, x, to), mean_point(n, rest, from);
    for (int i = 0; i < n; i++) /* in units of the size: no under- or overflow */
        for (int k = 0; k < 9; k++)
            covariance[k] +=
                (x[3 * i + k / 3] - to[k / 3]) / size * ((rest[3 * i + k % 3] - from[k % 3]) / size);
    cn_polar(covariance, q);
    cn_quaternion_matrix(q, r);
    for (int i = 0; i < n; i++) {
        double arm[3], laid[3], now[3];
        cn_sub(rest + 3 * i, from, arm);
        cn_mat_vec(r, arm, laid);
        cn_sub(x + 3 * i, to, now);
        const double d = cn_distance(now, laid);
        if (!(d <= most)) most = d; /* keeps a NaN */
    }
    return isfinite(most / size) ? most / size : NAN;
}

static void body_figures(cn_run_data *run, int b, cn_body_report *out)
{
    const cn_model_body *model = &run->model->body[b];
    const cn_body *body = model->body;
    const cn_body_state *state = &run->state->body[b];
    double mass = 0;
    cn_measures m;

    cn_body_measure(body, cn_run_active(model, state), state->x, run->state->body[b].rotation, false, &m,
                    NULL, run->pool);
    out->model = body->model;
    out->rest_volume = body->rest_volume, out->volume = m.volume, out->energy = m.energy;
    cn_copy3(state->x + 3 * model->goal_node, out->goal);
    cn_copy3(out->goal, out->tip);
    if (model->catheter) cn_copy3(state->x, out->tip);
    if (model->ntip > 0) out->tip[0] = out->tip[1] = out->tip[2] = 0;
    const double *end = body->nanchor > 0 ? cn_run_points(run, b, run->state, body->nnode) : state->x;
    for (int i = 0; i < model->ntip; i++)
        cn_axpy(1.0 / model->ntip, end + 3 * model->tip[i], out->tip);
    out->goal_distance = NAN;
    if (run->spec[b].nwaypoint > 0)
        out->goal_distance = cn_distance(out->goal, run->spec[b].waypoint + 3 * (run->spec[b].nwaypoint - 1));
    for (int i = 0; i < body->nnode; i++) {
        mass += body->mass[i];
        cn_axpy(body->mass[i], state->x + 3 * i, out->com);
        cn_axpy(body->mass[i], state->v + 3 * i, out->momentum);
        out->kinetic += 0.5 * body->mass[i] * cn_norm2(state->v + 3 * i);
    }
    for (int k = 0; k < 3; k++)
        out->com[k] = mass > 0 ? out->com[k] / mass : NAN;
    for (int i = 0; mass > 0 && i < body->nnode; i++) {
        double r[3], l[3];
        cn_sub(state->x + 3 * i, out->com, r);
        cn_cross(r, state->v + 3 * i, l);
        cn_axpy(body->mass[i], l, out->angular_momentum);
    }
    for (int i = 0; body->inertia && i < body->nnode; i++) { /* a rod's frames: L = R I R' w */
        const double *w = state->v + 3 * (body->nnode + i);
        double r[9], about[3], l[3];
        cn_quaternion_matrix(state->rotation + 4 * i, r);
        for (int k = 0; k < 3; k++)
            about[k] = body->inertia[3 * i + k] * (r[k] * w[0] + r[3 + k] * w[1] + r[6 + k] * w[2]);
        cn_mat_vec(r, about, l);
        cn_axpy(1, l, out->angular_momentum);
        out->kinetic += 0.5 * cn_dot(l, w);
    }
    out->shape_error = cn_shape_error(body->npoint, cn_run_points(run, b, run->state, body->nnode),
                                      body->point, model->size);
    cn_beam_error e = {NAN, NAN, NAN, NAN, NAN, NAN};
    if (run->spec[b].shape.kind == CN_SHAPE_CATHETER)
        cn_beam_error_catheter(&run->spec[b].shape, &run->spec[b].material, body->model, &e);
    if (run->spec[b].shape.kind == CN_SHAPE_BEAM)
        cn_beam_error_beam(&run->spec[b].shape, &run->spec[b].material, body->model, &e);
    out->error_bending = e.bending, out->error_torsion = e.torsion, out->error_axial = e.axial;
    out->polygon_bending = e.polygon_bending, out->polygon_torsion = e.polygon_torsion,
    out->polygon_axial = e.polygon_axial;
}

void cn_run_finish(cn_run_data *run)
{
    cn_report *report = run->report;
    for (int w = 0; w < run->world->nwall; w++) {
        const cn_surface_spec *spec = run->world->wall[w].spec;
        report->counts.wall_triangles += run->world->wall[w].surface->ntri;
        if (run->scene->leave_out.wall_solve != CN_ON && cn_gives_way(spec)) continue; /* a body */
        report->counts.rigid_nodes += run->world->wall[w].surface->nvert;
    }
    report->time.map_s = run->world->map_s;
    if (run->model && run->state) {
        report->nbody = run->model->nbody;
        for (int b = 0; b < run->model->nbody; b++) {
            const cn_body *body = run->model->body[b].body;
            report->counts.deformable_nodes += body->nanchor > 0 ? body->nnode : body->npoint;
            report->counts.dof += 3 * body->nblock;
            report->counts.tets += body->ntet;
            body_figures(run, b, &report->body[b]);
        }
        if (report->drive.insertion) note_insertion(run, true);
        report->counts.nodes = report->counts.deformable_nodes + report->counts.rigid_nodes;
        cn_run_left_out(run);
        report->time.simulated_s = run->state->time;
        report->steps = run->state->step > report->steps ? run->state->step : report->steps;
    }
    const int last = run->nsample < CN_LAST_STEPS ? run->nsample : CN_LAST_STEPS;
    report->time.step_ms_last100 = cn_spread_of(last, run->last_ms);
    report->time.step_ms = cn_spread_of(run->nheld, run->step_ms);
    report->time.fem_ms = cn_spread_of(run->nheld, run->fem_ms);
    report->time.collision_ms = cn_spread_of(run->nheld, run->collision_ms);
    cn_spread *const spread[] = {&report->time.fem_ms, &report->time.collision_ms, &report->time.step_ms};
    for (int i = 0; i < 3 && run->nheld > 0; i++)
        spread[i]->max = run->worst_ms[i];
    const double busy = report->time.simulation_s + report->time.collision_s;
    report->time.real_time_factor = busy > 0 ? report->time.simulated_s / busy : NAN;
    report->memory_peak_bytes = cn_memory_peak();
}

void cn_run_frame(cn_run_data *run, const cn_state *state, bool wanted)
{
    const cn_run_hooks *hooks = run->hooks;
    cn_frame frame = {.step = state->step, .time = state->time, .nbody = run->model->nbody};
    if (!hooks || !hooks->frame) return;
    if (!wanted && hooks->wants_frame && !hooks->wants_frame(hooks->user, state->step)) return;
    run->shown_step = state->step;
    cn_frame_body *bodies = calloc((size_t)run->model->nbody, sizeof *bodies);
    if (!bodies) return; /* a frame less */
    for (int b = 0; b < run->model->nbody; b++) {
        const cn_model_body *model = &run->model->body[b];
        const cn_body_state *at = &state->body[b];
        cn_measures unused;
        memcpy(run->body[b].turn, at->rotation, 4 * (size_t)model->body->nturn * sizeof(double));
        cn_body_measure(model->body, cn_run_active(model, at), at->x, run->body[b].turn, true, &unused,
                        run->body[b].von_mises, run->pool);
        bodies[b] = (cn_frame_body){.name = run->spec[b].name,
                                    .body = model->body,
                                    .nactive = cn_body_points_of(model->body, at->nfree),
                                    .x = cn_run_points(run, b, state, model->body->nnode),
                                    .von_mises = run->body[b].von_mises,
                                    .stress_limit = INFINITY};
        if (cn_run_skin_bring(run, b, at))
            bodies[b].skin = run->body[b].skin, bodies[b].worn = run->body[b].worn;
        for (int i = 0; i < run->spec[b].nlimit; i++)
            if (run->spec[b].limit[i].quantity == CN_QUANTITY_STRESS &&
                run->spec[b].limit[i].reduce == CN_REDUCE_MAX)
                bodies[b].stress_limit = run->spec[b].limit[i].limit;
    }
    frame.body = bodies;
    hooks->frame(hooks->user, &frame);
    free(bodies);
}

void cn_report_refused(cn_report *report, const cn_scene *scene, const cn_error *error)
{
    memset(report, 0, sizeof *report);
    report->reproducible = true;
    if (scene) snprintf(report->scene, sizeof report->scene, "%s", scene->name ? scene->name : "");
    if (scene) report->seed = scene->seed;
    report->threads = 1;
    report->contact.gap_min = report->contact.momentum_error = NAN;
    report->path.length = report->path.clearance_min = report->path.turn_max = NAN;
    report->time.real_time_factor = NAN;
    const cn_spread none = {NAN, NAN, NAN, NAN};
    report->time.fem_ms = report->time.collision_ms = report->time.step_ms = report->time.step_ms_last100 =
        none;
    cn_verdict *verdict = &report->verdict;
    *verdict = (cn_verdict){.code = CN_VERDICT_BAD_INPUT,
                            .element = -1,
                            .step = -1,
                            .waypoint = -1,
                            .value = NAN,
                            .limit = NAN,
                            .time = NAN,
                            .position = {NAN, NAN, NAN}};
    if (error) verdict->fault = error->fault;
    if (error && error->file[0] && error->line > 0)
        snprintf(verdict->message, sizeof verdict->message, "%s:%d: %s", error->file, error->line,
                 error->message);
    else if (error && error->file[0])
        snprintf(verdict->message, sizeof verdict->message, "%s: %s", error->file, error->message);
    else
        snprintf(verdict->message, sizeof verdict->message, "%s", error ? error->message : "refused");
}
