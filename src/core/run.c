/* run.c - a whole run: doors, map, plan, then step { drive, solve, contact, limits } -> accept, or roll back
 * and replan, until every waypoint is reached, time is up or nothing leads on. */
#include "body_modes.h"
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static bool cancelled(const cn_run_data *run)
{
    return run->hooks && cn_cancelled(run->hooks->cancel);
}

static void stage(cn_run_data *run, cn_stage stage_now, double steps_per_s)
{
    if (!run->hooks || !run->hooks->progress) return;
    cn_progress p = {
        .stage = stage_now, .time_limit = run->scene->time_limit, .replans = run->report->replans};
    for (int b = 0; b < run->nbody; b++) {
        p.nwaypoint += run->spec[b].nwaypoint;
        if (run->state) p.waypoint += run->state->body[b].waypoint;
    }
    if (run->state) p.time = run->state->time, p.step = run->state->step;
    p.steps_per_s = steps_per_s;
    p.margin = cn_run_margin(run, &p.margin_of);
    p.nlimit = run->report->nlimit, p.limit = run->report->limit;
    run->hooks->progress(run->hooks->user, &p);
}

/* The verdict that a failed part of the preparation amounts to. */
static void refuse(cn_run_data *run, cn_status status)
{
    if (run->report->verdict.code != CN_VERDICT_UNKNOWN) return; /* said already */
    if (cancelled(run)) {
        cn_run_verdict(run, CN_VERDICT_CANCELLED, "cancelled before the first step");
        return;
    }
    const char *said = run->error.message[0] ? run->error.message : cn_status_text(status);
    const cn_verdict_code code =
        status == CN_ERR_NO_PATH     ? CN_VERDICT_NO_PATH
        : status == CN_ERR_TIMEOUT   ? CN_VERDICT_TIMEOUT
        : status == CN_ERR_CANCELLED ? CN_VERDICT_CANCELLED
        : status == CN_ERR_SINGULAR || status == CN_ERR_NOT_FINITE || status == CN_ERR_MEMORY
            ? CN_VERDICT_NUMERICS
            : CN_VERDICT_BAD_INPUT;
    if (status == CN_ERR_TIMEOUT) run->report->reproducible = false;
    if (code == CN_VERDICT_BAD_INPUT)
        run->report->verdict.fault = run->error.fault ? run->error.fault : 100 * (int)status;
    if (run->error.file[0] && run->error.line > 0)
        cn_run_verdict(run, code, "%s:%d: %s", run->error.file, run->error.line, said);
    else if (run->error.file[0])
        cn_run_verdict(run, code, "%s: %s", run->error.file, said);
    else
        cn_run_verdict(run, code, "%s", said);
}

static cn_status make_map(cn_run_data *run)
{
    double radius = 0;
    bool needed = run->world->nvessel > 0;
    cn_status status;
    for (int b = 0; b < run->nbody; b++)
        if (run->spec[b].shape.kind == CN_SHAPE_CATHETER)
            radius = fmax(radius, 0.5 * run->spec[b].shape.catheter.diameter);
    for (int b = 0; b < run->nbody; b++)
        needed |= run->spec[b].nwaypoint > 0;
    if (needed && !run->world->map && run->world->nwall > 0) { /* nothing is planned, nothing is mapped */
        stage(run, CN_STAGE_MAP, 0);
        const double start = cn_seconds();
        if ((status = cn_world_map(run->world, radius, run->threads, &run->error)) != CN_OK) return status;
        if (run->world->octree_attach && !run->world->octree &&
            (status = run->world->octree_attach(run->world, &run->error)) != CN_OK)
            return status;
        run->world->map_s = cn_seconds() - start;
    }
    return cancelled(run) ? CN_ERR_CANCELLED : CN_OK;
}

/* The rigid motion that nothing resists: a body without inertia, not held enough. "" where there is none. */
static void loose_motion(const cn_run_data *run, int b, size_t size, char *text)
{
    const cn_model_body *body = &run->model->body[b];
    cn_body_modes modes;
    text[0] = 0;
    if (run->model->inertia && run->spec[b].material.density > 0) return;
    if (cn_body_modes_find(body->body, body->fixed, &modes) == CN_OK) cn_body_modes_text(&modes, text, size);
}

/* Without drive and walls nothing else could hold such a body: it is refused before anything moves. */
static cn_status no_equilibrium(cn_run_data *run)
{
    for (int b = 0; b < run->nbody; b++) {
        char loose[512];
        loose_motion(run, b, sizeof loose, loose);
        if (!loose[0] || run->world->nwall > 0 || run->spec[b].nwaypoint > 0) continue;
        return cn_fail(&run->error, CN_FAULT_NEEDED, run->scene->path, 0,
                       "%s has no equilibrium: %s; hold it (`fixed`) or give it a density", run->spec[b].name,
                       loose);
    }
    return CN_OK;
}

/* What a body keeps between itself and moving obstacles: where contact begins, and its least clearance. */
static double keep_clear(const cn_run_data *run, int b)
{
    double keep = run->model->body[b].gap;
    for (int i = 0; i < run->spec[b].nlimit; i++)
        if (run->spec[b].limit[i].quantity == CN_QUANTITY_CLEARANCE)
            keep = fmax(keep, run->spec[b].limit[i].limit);
    return keep;
}

static cn_status prepare(cn_run_data *run)
{
    cn_status status;
    if ((status = cn_run_specs(run)) != CN_OK) return status;
    if ((status = cn_run_supported(run)) != CN_OK) return status;
    if (!(run->body = calloc((size_t)run->nbody + 1, sizeof *run->body))) return CN_ERR_MEMORY;
    if (!(run->leave.self = calloc((size_t)run->nbody + 1, sizeof *run->leave.self))) return CN_ERR_MEMORY;
    if (!(run->report->body = calloc((size_t)run->nbody + 1, sizeof *run->report->body)))
        return CN_ERR_MEMORY;
    int nlimit = 0;
    for (int b = 0; b < run->nbody; b++)
        nlimit += run->spec[b].nlimit;
    if (!(run->report->limit = calloc((size_t)nlimit + 1, sizeof *run->report->limit))) return CN_ERR_MEMORY;
    for (int b = 0; b < run->nbody; b++) {
        snprintf(run->report->body[b].name, sizeof run->report->body[b].name, "%s", run->spec[b].name);
        run->body[b].first_limit = run->report->nlimit;
        for (int i = 0; i < run->spec[b].nlimit; i++) {
            cn_limit_report *l = &run->report->limit[run->report->nlimit++];
            *l = (cn_limit_report){.limit = run->spec[b].limit[i],
                                   .worst = NAN,
                                   .step = -1,
                                   .element = -1,
                                   .time = NAN,
                                   .position = {NAN, NAN, NAN}};
            snprintf(l->body, sizeof l->body, "%s", run->spec[b].name);
        }
    }
    for (int b = 0; b < run->nbody; b++)
        if ((status = cn_run_skin_read(run, b)) != CN_OK) return status;
    if ((status = make_map(run)) != CN_OK) return status;
    if ((status = cn_run_places(run)) != CN_OK) return status;
    if ((status = cn_pool_new(&run->pool, run->threads)) != CN_OK) return status;
    /* a catheter without a direction takes the path's: it is planned before its mesh is laid */
    stage(run, CN_STAGE_PLAN, 0);
    for (int b = 0; b < run->nbody; b++)
        if (run->spec[b].shape.kind == CN_SHAPE_CATHETER && (status = cn_run_plan_body(run, b)) != CN_OK)
            return status;
    if ((status = cn_model_new(&run->model, run->scene, run->world, run->nbody, run->spec, &run->error)) !=
        CN_OK)
        return status;
    if ((status = no_equilibrium(run)) != CN_OK) return status;
    if ((status = cn_run_explicit(run)) != CN_OK) return status;
    for (int b = 0; b < run->nbody; b++)
        if ((status = cn_run_skin_hang(run, b)) != CN_OK) return status;
    for (int b = 0; b < run->nbody; b++)
        if (run->spec[b].shape.kind != CN_SHAPE_CATHETER && (status = cn_run_plan_body(run, b)) != CN_OK)
            return status;
    if ((status = cn_run_works(run, &run->error)) != CN_OK) return status;
    for (int b = 0; b < run->nbody; b++) {
        const cn_body *body = run->model->body[b].body;
        run->body[b].von_mises = calloc((size_t)cn_body_cells(body) + 1, sizeof(double));
        run->body[b].turn = calloc(4 * (size_t)body->nturn + 1, sizeof(double));
        const int met = cn_touch_body(&run->model->body[b])->npoint;
        run->body[b].points =
            calloc(3 * (size_t)(met > body->npoint ? met : body->npoint) + 1, sizeof(double));
        run->body[b].measured = malloc(3 * (size_t)body->nblock * sizeof(double));
        if (!run->body[b].von_mises || !run->body[b].turn || !run->body[b].points || !run->body[b].measured)
            return CN_ERR_MEMORY;
        run->body[b].measured[0] = NAN; /* nowhere */
        run->body[b].looked = -1;
        if (run->body[b].path && (status = cn_avoid_new(&run->body[b].avoid, run->world, &run->model->body[b],
                                                        keep_clear(run, b))) != CN_OK)
            return status;
        cn_drive_progress(&run->model->body[b], &run->state->body[b], run->body[b].path);
        run->state->body[b].progress = -INFINITY;
    }
    return CN_OK;
}

cn_status cn_run_works(cn_run_data *run, cn_error *error)
{
    const size_t n = (size_t)run->nbody;
    const bool coupled = run->model->coupled;
    cn_status status;
    if ((status = cn_state_new(&run->state, run->model)) != CN_OK) return status;
    if ((status = cn_state_new(&run->trial, run->model)) != CN_OK) return status;
    if ((status = cn_state_new(&run->spare, run->model)) != CN_OK) return status;
    run->path = calloc(n + 1, sizeof *run->path);
    run->figures = calloc(2 * n + 1, sizeof *run->figures);
    if (!(run->work = calloc(n + 1, sizeof *run->work)) || !run->path || !run->figures) return CN_ERR_MEMORY;
    for (int b = 0; b < run->nbody; b += coupled ? run->nbody : 1)
        if ((status = cn_work_new(&run->work[run->nwork++], run->model, b, coupled ? run->nbody : 1,
                                  run->pool, error)) != CN_OK)
            return status;
    for (int w = 0; run->hooks && w < run->nwork; w++)
        cn_work_watch(run->work[w], run->hooks->cancel);
    return CN_OK;
}

void cn_run_works_clear(cn_run_data *run)
{
    for (int w = 0; w < run->nwork; w++)
        cn_work_free(run->work[w]);
    free(run->work), free(run->path), free(run->figures);
    cn_state_free(run->state), cn_state_free(run->trial), cn_state_free(run->spare);
}

const cn_path *const *cn_run_paths(const cn_run_data *run)
{
    for (int b = 0; b < run->nbody; b++)
        run->path[b] = run->body[b].path;
    return run->path;
}

/* The name of surface s of work w: a body's or a wall's. */
static const char *surface_name(const cn_run_data *run, int w, int s)
{
    int first, n, wall = cn_work_wall(run->work[w], s);
    cn_work_bodies(run->work[w], &first, &n);
    return s < n ? run->spec[first + s].name : run->world->wall[wall].name;
}

/* True when a body begins inside a wall or another body: named, not shaken out. */
static bool bad_start(cn_run_data *run)
{
    if (run->scene->contact.method != CN_CONTACT_STRICT) return false;
    for (int b = 0; b < run->nbody; b++)
        if (cn_run_swallowed(run, b)) return true;
    for (int w = 0; w < run->nwork; w++) {
        cn_findings found;
        char pairs[320] = "";
        int first, n;
        if (cn_work_check(run->state, run->work[w], &found) != CN_OK) continue;
        cn_work_bodies(run->work[w], &first, &n);
        if (!found.intersections && !found.outside) continue;
        if (found.intersections)
            snprintf(pairs, sizeof pairs,
                     "%d crossing triangle pairs (first: triangle %d of %.60s and triangle %d of %.60s), ",
                     found.intersections, found.triangle[0], surface_name(run, w, found.surface[0]),
                     found.triangle[1], surface_name(run, w, found.surface[1]));
        cn_run_no_start(run, found.intersections ? first + found.surface[0] : first, found.depth, found.where,
                        "%s%d points outside the free space", pairs, found.outside);
        return true;
    }
    return false;
}

/* Adds what a part of a step did. */
static void add_part(cn_step_figures *all, const cn_step_figures *part)
{
    all->newton = part->newton > all->newton ? part->newton : all->newton;
    all->kept += part->kept;
    all->linear = part->linear > all->linear ? part->linear : all->linear;
    all->fem_s += part->fem_s, all->collision_s += part->collision_s;
    all->unconverged += part->unconverged, all->momentum_error += part->momentum_error;
    all->linear_residual = fmax(all->linear_residual, part->linear_residual);
}

static void add_end(cn_step_figures *all, const cn_step_figures *part)
{
    all->force = fmax(all->force, part->force), all->work += part->work;
    if (!(part->wall_force <= all->wall_force)) {
        all->wall_force = part->wall_force;
        cn_copy3(part->wall_where, all->wall_where);
    }
    all->gap = fmin(all->gap, part->gap), all->findings = part->findings;
}

cn_status cn_run_advance(cn_run_data *run, int w)
{
    cn_work *work = run->work[w];
    const double dt = run->model->dt;
    const cn_path *const *path = cn_run_paths(run);
    cn_status status = CN_ERR_CONVERGENCE;
    int first, n;
    cn_work_bodies(work, &first, &n);
    cn_step_figures *figures = run->figures + first, *part = run->figures + run->nbody;
    for (int parts = 1; parts <= 64; parts *= 4) {
        const cn_state *from = run->state;
        for (int b = 0; b < n; b++)
            figures[b] = (cn_step_figures){.gap = INFINITY};
        for (int i = 0; i < parts; i++) {
            status = cn_step(run->model, from, run->trial, path, dt / parts, work, part);
            for (int grown = 0; status == CN_ERR_CONTACT && grown < 6; grown++) {
                if (cn_work_grow(work) != CN_OK) return CN_ERR_MEMORY;
                status = cn_step(run->model, from, run->trial, path, dt / parts, work, part);
            }
            for (int b = 0; b < n; b++)
                add_part(&figures[b], &part[b]);
            if (status != CN_OK) break;
            figures->residual = fmax(figures->residual,
                                     cn_step_residual(run->model, from, run->trial, path, dt / parts, work));
            for (int b = 0; b < n; b++)
                add_end(&figures[b], &part[b]);
            if (i + 1 < parts) {
                run->trial->time = from->time + dt / parts;
                cn_state_copy(run->spare, run->trial);
                from = run->spare;
            }
        }
        if (status == CN_OK || status == CN_ERR_MEMORY || status == CN_ERR_CANCELLED || run->model->single)
            return status;
        run->report->rejected_steps++;
    }
    return status;
}

static void at_cancel(cn_run_data *run)
{
    cn_run_verdict(run, CN_VERDICT_CANCELLED, "cancelled at step %d, t = %.3f s", run->state->step,
                   run->state->time);
}

static void numerics(cn_run_data *run, int b, cn_status status)
{
    const cn_model_body *body = &run->model->body[b];
    char loose[512] = "";
    if (status == CN_ERR_SINGULAR) loose_motion(run, b, sizeof loose, loose);
    cn_run_verdict(run, CN_VERDICT_NUMERICS,
                   "%s: step %d at t = %.4f s cannot be computed (%s), also in 64 parts; the last good state "
                   "is kept: %s%s",
                   run->spec[b].name, run->state->step + 1, run->state->time, cn_status_text(status), loose,
                   loose[0] ? "; hold it (`fixed`) or give it a density" : "try a smaller step");
    snprintf(run->report->verdict.body, sizeof run->report->verdict.body, "%s", run->spec[b].name);
    run->report->verdict.step = run->state->step, run->report->verdict.time = run->state->time;
    cn_copy3(run->state->body[b].x + 3 * body->goal_node, run->report->verdict.position);
}

/* A limit broke: back to a checkpoint on another way, or the verdict. */
static bool go_another_way(cn_run_data *run, int b, const cn_ball *refused, const cn_verdict *broken)
{
    cn_report *report = run->report;
    char why[128] = "";
    if (run->body[b].path && report->replans < run->scene->planner.replans) {
        stage(run, CN_STAGE_PLAN, 0);
        run->error = (cn_error){0};
        const cn_status status = cn_run_replan(run, b, refused);
        if (status == CN_OK) {
            report->replans++;
            cn_run_forget_shots(run);
            CN_LOG(CN_LOG_INFO, "replan %d: %s", report->replans, broken->message);
            return true;
        }
        if (status == CN_ERR_CANCELLED || status == CN_ERR_TIMEOUT || status == CN_ERR_MEMORY) {
            refuse(run, status);
            return false;
        }
        snprintf(why, sizeof why, "; no other way leads on after %d replans", report->replans);
    } else if (run->body[b].path) {
        snprintf(why, sizeof why, "; all %d replans are used up", run->scene->planner.replans);
    }
    report->verdict = *broken;
    const size_t said = strlen(report->verdict.message);
    snprintf(report->verdict.message + said, sizeof report->verdict.message - said, "%s", why);
    return false;
}

static bool all_arrived(const cn_run_data *run)
{
    bool any = false;
    for (int b = 0; b < run->nbody; b++) {
        if (run->spec[b].nwaypoint == 0) continue;
        any = true;
        if (!cn_drive_arrived(&run->model->body[b], &run->state->body[b])) return false;
    }
    return any;
}

static void reached(cn_run_data *run)
{
    char turn[160] = "";
    const double degrees = 180 / acos(-1.0);
    for (int b = 0; b < run->nbody; b++)
        if (run->body[b].path && run->body[b].path->turn_max > run->spec[b].path.max_turn)
            snprintf(turn, sizeof turn, "; the path turns by %.3g degrees, more than max_turn_deg %.3g",
                     degrees * run->body[b].path->turn_max, degrees * run->spec[b].path.max_turn);
    cn_run_verdict(run, CN_VERDICT_REACHED, "every waypoint reached after %d steps, t = %.3f s, %d replans%s",
                   run->state->step, run->state->time, run->report->replans, turn);
}

/* True when a body has passed its deadline on the way. */
static bool late(cn_run_data *run)
{
    for (int b = 0; b < run->nbody; b++) {
        if (run->spec[b].nwaypoint == 0 || !(run->state->time > run->spec[b].deadline) ||
            cn_drive_arrived(&run->model->body[b], &run->state->body[b]))
            continue;
        cn_run_verdict(run, CN_VERDICT_TIMEOUT,
                       "%s has not reached its last waypoint by its deadline of %g s", run->spec[b].name,
                       run->spec[b].deadline);
        snprintf(run->report->verdict.body, sizeof run->report->verdict.body, "%s", run->spec[b].name);
        return true;
    }
    return false;
}

static void drive_on(cn_run_data *run)
{
    double shown = cn_seconds();
    int shown_step = 0;
    const double last = ceil(run->scene->time_limit / run->scene->step - 1e-9);

    for (int b = 0; b < run->nbody; b++)
        if (run->body[b].path) cn_run_checkpoint(run, b);
    cn_run_frame(run, run->state, false);
    while (run->state->step < last) {
        cn_verdict broken;
        int broken_body = -1;
        const double start = cn_seconds();
        cn_step_figures figures = {.gap = INFINITY};
        if (cancelled(run)) return at_cancel(run);
        cn_ball ahead;
        cn_status looked = CN_OK;
        int yielding = 0;
        while (yielding < run->nbody && cn_run_yield(run, yielding, &ahead, &broken, &looked))
            yielding++;
        if (looked != CN_OK) return refuse(run, looked);
        if (yielding < run->nbody) {
            if (!go_another_way(run, yielding, &ahead, &broken)) return;
            continue;
        }
        const int rejected = run->report->rejected_steps;
        int newton = 0;
        cn_state_copy(run->trial, run->state);
        cn_run_refit(run);
        for (int w = 0; w < run->nwork && broken_body < 0; w++) {
            const cn_status status = cn_run_advance(run, w);
            int first, n;
            cn_work_bodies(run->work[w], &first, &n);
            if (status == CN_ERR_CANCELLED) return at_cancel(run);
            if (status != CN_OK) {
                numerics(run, first, status);
                return;
            }
            run->trial->step = run->state->step + 1, run->trial->time = run->trial->step * run->model->dt;
            for (int b = first; b < first + n && broken_body < 0; b++) {
                cn_step_figures *one = &run->figures[b];
                if (isinf(one->gap)) one->gap = cn_run_far_gap(run, b, run->trial);
                if (cn_run_limits(run, b, run->trial, one, &broken)) broken_body = b;
                add_part(&figures, one), newton += one->newton;
                figures.residual = fmax(figures.residual, one->residual);
                figures.gap = fmin(figures.gap, one->gap);
                figures.force += one->force, figures.work += one->work;
                figures.wall_force = fmax(figures.wall_force, one->wall_force);
                figures.findings.intersections += one->findings.intersections;
                figures.findings.outside += one->findings.outside;
            }
        }
        if (broken_body >= 0) {
            const cn_ball here = cn_run_broken_at(run, broken_body);
            run->report->rejected_steps++;
            if (!go_another_way(run, broken_body, &here, &broken)) return;
            continue;
        }
        cn_state *accepted = run->trial;
        run->trial = run->state, run->state = accepted;
        run->report->steps++, run->newton += newton;
        const double watched = cn_seconds();
        cn_run_watch(run);
        figures.collision_s += cn_seconds() - watched;
        if (cn_run_sample(run, &figures, cn_seconds() - start) != CN_OK) {
            cn_run_verdict(run, CN_VERDICT_NUMERICS, "out of memory at step %d", run->state->step);
            return;
        }
        cn_run_shoot(run, &figures, run->report->rejected_steps == rejected);
        for (int b = 0; b < run->nbody; b++)
            if (run->body[b].path) cn_run_checkpoint(run, b);
        cn_run_frame(run, run->state, false);
        if (run->visit && !run->visit(run->visitor, run)) return;
        const double now = cn_seconds();
        if (now - shown > 0.1 || run->report->steps == 1) { /* a short run shows its bar too */
            stage(run, CN_STAGE_MOTION, (run->report->steps - shown_step) / (now - shown));
            shown = now, shown_step = run->report->steps;
        }
        if (all_arrived(run)) {
            reached(run);
            return;
        }
        if (late(run)) return;
    }
    bool asked = false;
    for (int b = 0; b < run->nbody; b++)
        asked |= run->spec[b].nwaypoint > 0;
    cn_run_verdict(run, asked ? CN_VERDICT_TIMEOUT : CN_VERDICT_RAN,
                   asked ? "the time limit of %g s simulated was reached before the last waypoint"
                         : "ran to the time limit of %g s",
                   run->scene->time_limit);
}

static void clear(cn_run_data *run)
{
    for (int b = 0; run->body && b < run->nbody; b++) {
        cn_run_body *body = &run->body[b];
        cn_path_free(body->path);
        cn_roadmap_clear(&body->roadmap);
        for (int i = 0; i < CN_CHECKPOINTS; i++)
            cn_state_free(body->checkpoint[i].state);
        free(body->vertex_s), free(body->refused);
        free(body->von_mises), free(body->measured), free(body->turn), free(body->points);
        cn_avoid_free(body->avoid);
        cn_run_skin_clear(body);
    }
    free(run->body);
    cn_leave_clear(&run->leave, run->nbody);
    cn_run_works_clear(run);
    cn_model_free(run->model);
    cn_pool_free(run->pool);
    free(run->spec), free(run->waypoint), free(run->limit);
    free(run->fem_ms), free(run->collision_ms), free(run->step_ms);
}

static void begin(cn_run_data *run, cn_world *world, const cn_request *request, cn_planner planner,
                  int threads, const cn_run_hooks *hooks, cn_report *report)
{
    *run = (cn_run_data){
        .world = world, .scene = world->scene, .request = request, .planner = planner, .hooks = hooks};
    run->shown_step = -1, run->leave.every = 50;
    run->report = report, run->threads = threads < 1 ? 1 : threads > 64 ? 64 : threads;
    cn_report_refused(report, world->scene, NULL);
    report->threads = run->threads;
    report->verdict.code = CN_VERDICT_UNKNOWN;
    if (request && request->seed) report->seed = *request->seed;
}

cn_status cn_run(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                 const cn_run_hooks *hooks, cn_report *report, cn_error *error)
{
    return cn_run_visited(world, request, planner, threads, hooks, NULL, NULL, report, error);
}

cn_status cn_run_visited(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                         const cn_run_hooks *hooks, cn_run_visit visit, void *visitor, cn_report *report,
                         cn_error *error)
{
    if (!world || !report) return cn_fail(error, CN_ERR_ARG, NULL, 0, "cn_run needs a world and a report");
    cn_run_data run;
    const double start = cn_seconds();
    begin(&run, world, request, planner, threads, hooks, report);
    run.visit = visit, run.visitor = visitor;
    const cn_status status = prepare(&run);
    if (status != CN_OK) {
        refuse(&run, status);
        cn_state_free(run.state); /* half prepared: nothing to be shown or measured */
        run.state = NULL;
    } else if (!bad_start(&run))
        drive_on(&run);
    if (run.state && run.shown_step != run.state->step) cn_run_frame(&run, run.state, true);
    if (run.state) {
        cn_verdict *verdict = &report->verdict;
        if (verdict->step < 0) verdict->step = run.state->step, verdict->time = run.state->time;
        for (int b = 0; b < run.nbody; b++)
            if (cn_run_waypoint(&run, run.state, b) > verdict->waypoint)
                verdict->waypoint = cn_run_waypoint(&run, run.state, b);
    }
    cn_run_finish(&run);
    report->time.wall_s = cn_seconds() - start;
    if (error) *error = run.error;
    clear(&run);
    return CN_OK;
}

cn_status cn_run_plan(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                      cn_path **path, cn_report *report, cn_error *error)
{
    cn_run_data run;
    const double start = cn_seconds();
    *path = NULL;
    begin(&run, world, request, planner, threads, NULL, report);
    cn_status status = prepare(&run);
    if (status != CN_OK) refuse(&run, status);
    for (int b = 0; status == CN_OK && !*path && b < run.nbody; b++)
        if (run.body[b].path) {
            *path = run.body[b].path, run.body[b].path = NULL;
            cn_run_verdict(&run, CN_VERDICT_REACHED, "path of %g m found for %s", cn_path_length(*path),
                           run.spec[b].name);
        }
    if (status == CN_OK && !*path)
        cn_run_verdict(&run, CN_VERDICT_BAD_INPUT, "the scene has no waypoints to plan a path through");
    cn_run_finish(&run);
    report->time.wall_s = cn_seconds() - start;
    if (error) *error = run.error;
    clear(&run);
    return status;
}
