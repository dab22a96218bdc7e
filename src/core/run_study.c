/* run_study.c - the paper's method against the scene's own, from states of the scene's own run. */
#include "catnav/study.h"
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static const double fractions[CN_STUDY_STATES] = {0.25, 0.5, 0.9};
enum { TURN = 10 }; /* steps of one method before the other's */

/* Samples of a step, in the order of the spreads in `add_up`. */
enum { STEP_MS, FEM_MS, COLLISION_MS, RESIDUAL, LINEAR, NEWTON, NSAMPLE };

/* One method on its way from a state: a run of its own, which shares specs, paths and threads with the run
 * it came from. */
typedef struct {
    cn_scene scene;
    cn_run_data run;
    cn_body_spec *spec;
    cn_report report;
    double sample[NSAMPLE][CN_STUDY_STEPS];
} walk;

typedef struct {
    const cn_study_hooks *hooks;
    cn_study *study;
    int mark[CN_STUDY_STATES]; /* accepted steps */
    const char *pass;
    cn_status status;
    cn_error error;
} studying;

static void say(const cn_study_hooks *hooks, const char *what)
{
    if (hooks && hooks->progress) hooks->progress(hooks->user, what);
}

static bool cancelled(const cn_study_hooks *hooks)
{
    return hooks && cn_cancelled(hooks->cancel);
}

const char *cn_study_method_name(int method)
{
    return method == CN_STUDY_OWN ? "own" : method == CN_STUDY_PAPER ? "paper" : "unknown";
}

static void walk_free(walk *w)
{
    if (!w) return;
    cn_run_works_clear(&w->run);
    free(w->run.body);
    cn_model_free(w->run.model);
    free(w->spec);
    free(w);
}

/* The paper's method knows linear tetrahedra: a rod's state as that of the mesh that rides on it. */
static void mesh_state(const cn_body *rod, const cn_body_state *from, const cn_body *mesh, cn_body_state *to)
{
    const cn_body_state own = *to;
    *to = *from;
    to->x = own.x, to->v = own.v, to->rotation = own.rotation;
    to->nfree = cn_body_points_of(rod, from->nfree);
    cn_body_points(rod, rod->nnode, from->x, from->rotation, to->x);
    for (int p = 0; p < rod->npoint; p++) {
        const int i = cn_body_node_of(rod, p);
        double arm[3];
        cn_sub(to->x + 3 * p, from->x + 3 * i, arm);
        cn_cross(from->v + 3 * (rod->nnode + i), arm, to->v + 3 * p);
        cn_axpy(1, from->v + 3 * i, to->v + 3 * p);
    }
    cn_body_rotation_start(mesh, to->rotation);
}

static cn_status walk_new(walk **out, const cn_run_data *from, cn_study_method method, cn_error *error)
{
    walk *w = calloc(1, sizeof *w);
    cn_status status = CN_ERR_MEMORY;
    *out = w;
    if (!w) return status;
    cn_run_data *run = &w->run;
    *run = (cn_run_data){.world = from->world,
                         .scene = &w->scene,
                         .report = &w->report,
                         .threads = from->threads,
                         .pool = from->pool,
                         .nbody = from->nbody,
                         .spec = w->spec};
    w->scene = *from->scene;
    if (!(w->spec = run->spec = malloc(((size_t)run->nbody + 1) * sizeof *w->spec))) return status;
    memcpy(w->spec, from->spec, (size_t)run->nbody * sizeof *w->spec);
    for (int b = 0; method == CN_STUDY_PAPER && b < run->nbody; b++)
        if (w->spec[b].model == CN_BODY_ROD) w->spec[b].model = CN_BODY_TET4;
    if (method == CN_STUDY_PAPER) {
        w->scene.contact.method = CN_CONTACT_PROJECT;
        w->scene.solver.newton = 1;
        w->scene.solver.linear = CN_LINEAR_CG;
        w->scene.solver.linear_tolerance = 1e-4;
    }
    if (!(run->body = calloc((size_t)run->nbody + 1, sizeof *run->body))) return status;
    if ((status = cn_model_new(&run->model, &w->scene, run->world, run->nbody, run->spec, error)) != CN_OK)
        return status;
    for (int b = 0; method != CN_STUDY_PAPER && b < run->nbody; b++)
        if (from->model->body[b].worn && (status = cn_model_wear(run->model, b, from->body[b].skin)) != CN_OK)
            return status;
    if ((status = cn_run_works(run, error)) != CN_OK) return status;
    for (int b = 0; b < run->nbody; b++)
        run->body[b].path = from->body[b].path;
    run->state->step = from->state->step, run->state->time = from->state->time;
    for (int b = 0; b < run->nbody; b++)
        if (w->spec[b].model == from->spec[b].model)
            cn_state_copy_body(&run->state->body[b], &from->state->body[b], &run->model->body[b]);
        else
            mesh_state(from->model->body[b].body, &from->state->body[b], run->model->body[b].body,
                       &run->state->body[b]);
    return CN_OK;
}

static cn_status walk_step(walk *w, cn_study_row *row)
{
    cn_run_data *run = &w->run;
    double sample[NSAMPLE] = {0};
    const double start = cn_seconds();
    cn_state_copy(run->trial, run->state);
    for (int k = 0; k < run->nwork; k++) {
        const cn_status status = cn_run_advance(run, k);
        int first, n;
        if (status != CN_OK) return status;
        cn_work_bodies(run->work[k], &first, &n);
        const cn_step_figures *one = &run->figures[first];
        sample[FEM_MS] += 1e3 * one->fem_s, sample[COLLISION_MS] += 1e3 * one->collision_s;
        sample[RESIDUAL] = fmax(sample[RESIDUAL], one->residual);
        sample[LINEAR] = fmax(sample[LINEAR], one->linear);
        sample[NEWTON] = fmax(sample[NEWTON], one->newton);
        row->unconverged += one->unconverged;
        row->linear_residual = fmax(row->linear_residual, one->linear_residual);
        row->intersections += one->findings.intersections;
        row->outside_nodes += one->findings.outside;
    }
    run->trial->step = run->state->step + 1, run->trial->time = run->state->time + run->model->dt;
    cn_state *accepted = run->trial;
    run->trial = run->state, run->state = accepted;
    sample[STEP_MS] = 1e3 * (cn_seconds() - start);
    for (int i = 0; i < NSAMPLE; i++)
        w->sample[i][row->steps] = sample[i];
    row->steps++;
    return CN_OK;
}

/* Farthest distance between two walks' tips: the end of a catheter, else the goal node. */
static double tips_apart(const walk *a, const walk *b)
{
    double apart = 0;
    for (int i = 0; i < a->run.nbody; i++) {
        const size_t ta = 3 * (size_t)a->run.model->body[i].goal_node,
                     tb = 3 * (size_t)b->run.model->body[i].goal_node;
        const bool catheter = a->run.model->body[i].catheter;
        apart = fmax(apart, cn_distance(a->run.state->body[i].x + (catheter ? 0 : ta),
                                        b->run.state->body[i].x + (catheter ? 0 : tb)));
    }
    return apart;
}

static void add_up(cn_study_row *row, walk *w)
{
    cn_spread *const spread[NSAMPLE] = {&row->step_ms,  &row->fem_ms, &row->collision_ms,
                                        &row->residual, &row->linear, &row->newton};
    for (int i = 0; i < NSAMPLE; i++)
        *spread[i] = cn_spread_of(row->steps, w->sample[i]);
    row->rejected = w->report.rejected_steps;
}

/* All steps of both methods from the run's state. A method that fails ends; that is a result. */
static cn_status compare(const studying *s, const cn_run_data *run, cn_study_state *out, cn_error *error)
{
    walk *w[CN_STUDY_METHODS] = {NULL};
    cn_status status = CN_OK;
    for (int m = 0; status == CN_OK && m < CN_STUDY_METHODS; m++)
        status = walk_new(&w[m], run, m, error);
    const int n = s->hooks && s->hooks->steps > 0 && s->hooks->steps < CN_STUDY_STEPS ? s->hooks->steps
                                                                                      : CN_STUDY_STEPS;
    for (int i = 0; status == CN_OK && i < n; i += TURN)
        for (int m = 0; status == CN_OK && m < CN_STUDY_METHODS; m++) {
            cn_study_row *row = &out->row[m];
            char what[96];
            snprintf(what, sizeof what, "%d steps from %.0f %% of the run: %s %d", n, 100 * out->fraction,
                     cn_study_method_name(m), i);
            say(s->hooks, what);
            for (int j = i; j < i + TURN && j < n && row->failure == CN_OK && status == CN_OK; j++) {
                row->failure = walk_step(w[m], row);
                if (row->failure == CN_ERR_MEMORY) status = CN_ERR_MEMORY;
                if (cancelled(s->hooks)) status = CN_ERR_CANCELLED;
            }
        }
    const cn_study_row *own = &out->row[CN_STUDY_OWN];
    for (int m = 0; status == CN_OK && m < CN_STUDY_METHODS; m++) {
        cn_study_row *row = &out->row[m];
        add_up(row, w[m]);
        row->ratio = row->step_ms.median / own->step_ms.median;
        const bool ended = row->failure == CN_OK && own->failure == CN_OK;
        row->tip_apart = ended ? tips_apart(w[m], w[CN_STUDY_OWN]) : NAN;
    }
    for (int m = 0; m < CN_STUDY_METHODS; m++)
        walk_free(w[m]);
    return status;
}

static bool visit(void *user, cn_run_data *run)
{
    studying *s = user;
    cn_study *study = s->study;
    while (study->nstate < CN_STUDY_STATES && run->report->steps == s->mark[study->nstate]) {
        cn_study_state *out = &study->state[study->nstate];
        *out = (cn_study_state){
            .fraction = fractions[study->nstate], .step = run->report->steps, .time = run->state->time};
        for (int b = 0; b < run->nbody; b++)
            out->free_nodes += run->state->body[b].nfree;
        if ((s->status = compare(s, run, out, &s->error)) != CN_OK) return false;
        study->nstate++;
    }
    return study->nstate < CN_STUDY_STATES;
}

static void tell_run(void *user, const cn_progress *p)
{
    const studying *s = user;
    char what[96];
    if (p->stage == CN_STAGE_MOTION)
        snprintf(what, sizeof what, "%s: step %d, %.2f s simulated", s->pass, p->step, p->time);
    else
        snprintf(what, sizeof what, "%s: preparing", s->pass);
    say(s->hooks, what);
}

cn_status cn_study_paper(cn_world *world, cn_planner planner, int threads, const cn_study_hooks *hooks,
                         cn_study *study, cn_error *error)
{
    if (!world || !study)
        return cn_fail(error, CN_ERR_ARG, NULL, 0, "cn_study_paper needs a world and a study");
    studying s = {.hooks = hooks, .study = study, .pass = "the run"};
    const cn_run_hooks run_hooks = {.user = &s, .progress = tell_run, .cancel = hooks ? hooks->cancel : NULL};
    cn_report again;
    memset(study, 0, sizeof *study);
    const int known = hooks && hooks->total > 0 ? hooks->total : 0;
    cn_status status = known ? CN_OK : cn_run(world, NULL, planner, threads, &run_hooks, &study->run, error);
    const int total = known ? known : study->run.steps;
    if (status != CN_OK || total == 0 || study->run.verdict.code == CN_VERDICT_CANCELLED) return status;
    for (int i = 0; i < CN_STUDY_STATES; i++)
        s.mark[i] = (int)fmax(1, round(fractions[i] * total));
    if (!known) s.pass = "the run again";
    status = cn_run_visited(world, NULL, planner, threads, &run_hooks, visit, &s,
                            known ? &study->run : &again, error);
    if (!known) cn_report_clear(&again);
    if (status != CN_OK) return status;
    if (s.status != CN_OK) {
        if (error) *error = s.error;
        return cn_fail(error, s.status, NULL, 0, "%s", cn_status_text(s.status));
    }
    if (study->nstate < CN_STUDY_STATES)
        return cancelled(hooks) ? cn_fail(error, CN_ERR_CANCELLED, NULL, 0, "cancelled")
                                : cn_fail(error, CN_ERR_CONVERGENCE, NULL, 0,
                                          "the run did not repeat itself: it met %d of its %d states",
                                          study->nstate, CN_STUDY_STATES);
    return CN_OK;
}

void cn_study_clear(cn_study *study)
{
    cn_report_clear(&study->run);
    memset(study, 0, sizeof *study);
}
