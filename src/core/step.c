/* step.c - one implicit Euler step of one body as the minimum of its incremental potential
 *
 *     E(x) = |x - x0 - dt v0|^2_M / (2 dt^2) + |x - x0|^2_C / (2 dt) + elastic + drive + contact - f_ext . (x
 * - x0)
 *
 * by Newton with the exact tangent (projected where that is not positive definite) and line search. With
 * strict contact each motion is cut by the continuous test before it is taken, so that every iterate is free.
 */
#include "sim.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "catnav/vec3.h"

struct cn_work {
    const cn_model *model;
    const cn_model_body *body;
    cn_pool *pool;
    cn_matrix *matrix, damping; /* damping shares the pattern; its values only with damping_stiffness */
    cn_scatter *scatter;
    cn_solver *solver;
    cn_contact *contact;
    cn_drive drive;
    double *memory;
    double *u; /* the unknown: x - x0, kept apart so that v = u / dt carries no round-off of x */
    double *trial, *trial_u; /* line search */
    double *gradient, *elastic, *external, *path, *touch, *dx, *axis;
    double *moved, *damped;             /* of damping_stiffness */
    double residual_scale, energy_size; /* largest force norm [N]; sum of the energies' sizes [J] */
    double collision_s;
    double added;          /* inertia that last made the exact tangent positive definite, over M/dt^2 */
    bool factored;         /* the solver holds a factor of an earlier iteration, made ... */
    int factored_nfree;    /* ... with this many free nodes */
    double factored_dt;    /* ... and this step */
    double *factored_turn; /* ... at these element rotations (ntet x 4) */
};

static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

cn_status cn_work_new(cn_work **out, const cn_model *model, int ibody, cn_pool *pool, cn_error *error)
{
    cn_work *work = calloc(1, sizeof *work);
    const cn_model_body *body = &model->body[ibody];
    const size_t n = 3 * (size_t)body->body->nnode;
    const cn_body *const bodies[1] = {body->body};
    const int first[1] = {0};
    cn_status status = CN_ERR_MEMORY;
    int *level = NULL;
    *out = NULL;
    if (!work) return CN_ERR_MEMORY;
    work->model = model, work->body = body, work->pool = pool;
    const size_t turn = 4 * (size_t)body->body->ntet;
    if (!(work->memory = calloc(18 * n + turn, sizeof *work->memory))) goto fail;
    double *next = work->memory,
           **const vectors[] = {
               &work->u,           &work->trial,        &work->trial_u,       &work->gradient,
               &work->elastic,     &work->external,     &work->path,          &work->touch,
               &work->dx,          &work->axis,         &work->moved,         &work->damped,
               &work->drive.force, &work->drive.centre, &work->drive.tangent, &work->drive.towards};
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++, next += n)
        *vectors[i] = next;
    work->drive.weight = next, work->drive.lead = next + n / 3, work->drive.pull = next + 2 * (n / 3);
    work->drive.hold = next + n;
    work->factored_turn = next + 2 * n;
    if ((status = cn_matrix_new(&work->matrix, 1, bodies, first)) != CN_OK) goto fail;
    work->damping = *work->matrix;
    work->damping.value = NULL;
    status = CN_ERR_MEMORY;
    if (body->body->damping_stiffness > 0 &&
        !(work->damping.value = calloc(9 * (size_t)work->matrix->nblock, sizeof(double))))
        goto fail;
    if ((status = cn_body_bind(&work->scatter, body->body, work->matrix, 0)) != CN_OK) goto fail;
    if (body->catheter) {
        status = CN_ERR_MEMORY;
        if (!(level = malloc((size_t)body->body->nnode * sizeof *level))) goto fail;
        for (int i = 0; i < body->body->nnode; i++)
            level[i] = i / body->per_station;
    }
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
    cn_solver_free(work->solver);
    cn_scatter_free(work->scatter);
    free(work->damping.value);
    cn_matrix_free(work->matrix);
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

/* One step's fixed data, handed down instead of a dozen arguments. */
typedef struct {
    cn_work *work;
    const cn_body_state *from; /* x0, v0 */
    double dt;
    int nfree, nactive;   /* nactive: one held station more than nfree */
    double *x, *rotation; /* of the trial */
    bool strict;
} stepping;

static double norm_free(const stepping *s, const double *f)
{
    double sum = 0;
    for (int i = 0; i < s->nfree; i++)
        if (!s->work->body->fixed[i]) sum += cn_norm2(f + 3 * i);
    return sqrt(sum);
}

/* Gravity, loads that are on, and the drive's held part. */
static void external_force(const stepping *s, double time)
{
    cn_work *work = s->work;
    const double late = 1e-6 * s->dt; /* a load's window counts whole steps */
    const cn_model_body *body = work->body;
    for (int i = 0; i < s->nfree; i++)
        for (int k = 0; k < 3; k++)
            work->external[3 * i + k] =
                body->body->mass[i] * work->model->gravity[k] + work->drive.force[3 * i + k];
    for (int l = 0; l < body->nload; l++)
        if (time > body->load[l].from + late && time <= body->load[l].until + late)
            for (int i = 0; i < 3 * s->nfree; i++)
                work->external[i] += body->load[l].force[i];
}

/* The potential at x = x0 + u and its gradient; with `tangent` >= 0 also the matrix. */
static double evaluate(const stepping *s, const double *x, const double *u, int tangent)
{
    cn_work *work = s->work;
    const cn_body *b = work->body->body;
    const double dt = s->dt;
    const bool assemble = tangent >= 0;
    const size_t active = 3 * (size_t)s->nactive * sizeof(double);
    cn_matrix *a = assemble ? work->matrix : NULL;
    double inertia = 0, load = 0, inertia_norm = 0, contact = 0;

    if (assemble) cn_matrix_clear(work->matrix, s->nactive);
    memset(work->elastic, 0, active), memset(work->path, 0, active), memset(work->touch, 0, active);
    const double elastic = cn_body_add_elastic(b, s->nactive, x, s->rotation, work->elastic,
                                               assemble ? (cn_tangent)tangent : CN_TANGENT_WARPED, 1,
                                               assemble ? work->scatter : NULL, work->pool);
    const double path = cn_drive_add(&work->drive, s->nfree, x, work->path, 1, a);
    if (s->strict) {
        const double start = seconds();
        contact = cn_contact_add(work->body->contact, work->contact, x, work->touch, a,
                                 tangent == CN_TANGENT_EXACT, work->pool);
        work->collision_s += seconds() - start;
    }
    for (int i = 0; i < s->nfree; i++) {
        const double m = work->model->inertia ? b->mass[i] : 0;
        const double over = m / (dt * dt), damp = b->damping * b->mass[i] / dt;
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            const double ahead = u[k] - (work->body->fixed[i] ? 0 : dt * s->from->v[k]), moved = u[k];
            const double pull = over * ahead + damp * moved;
            inertia += 0.5 * (over * ahead * ahead + damp * moved * moved);
            inertia_norm += pull * pull;
            load += work->external[k] * moved;
            work->gradient[k] = pull - work->elastic[k] - work->external[k] - work->path[k] - work->touch[k];
            if (assemble)
                work->matrix->value[9 * (size_t)work->matrix->diagonal[i] + 4 * (size_t)(k % 3)] +=
                    over + damp;
        }
    }
    if (work->damping.value) {
        const double beta = b->damping_stiffness / dt;
        for (int i = 0; i < 3 * s->nactive; i++)
            work->moved[i] = i < 3 * s->nfree ? u[i] : 0;
        cn_matrix_multiply(&work->damping, s->nfree, work->moved, work->damped, work->pool);
        for (int i = 0; i < 3 * s->nfree; i++) {
            work->gradient[i] += beta * work->damped[i];
            inertia += 0.5 * beta * work->damped[i] * work->moved[i];
        }
        for (int i = 0; assemble && i < 9 * work->matrix->row[s->nfree]; i++)
            work->matrix->value[i] += beta * work->damping.value[i];
    }
    const double internal = norm_free(s, work->elastic), external = norm_free(s, work->external);
    work->residual_scale = fmax(sqrt(inertia_norm), fmax(internal, external));
    work->energy_size = inertia + fabs(elastic) + fabs(path) + fabs(contact) + fabs(load);
    for (int i = 0; i < s->nfree; i++)
        if (work->body->fixed[i]) memset(work->gradient + 3 * i, 0, 3 * sizeof(double));
    return inertia + elastic + path + contact - load;
}

/* Below this the gradient is round-off of the elastic forces: strain carries the round-off of positions, over
 * the elements' size. */
static double gradient_floor(const stepping *s)
{
    const cn_model_body *body = s->work->body;
    const double h = cbrt(body->body->rest_volume / body->body->ntet), nu = body->spec->material.poisson;
    double far = 0;
    for (int i = 0; i < s->nfree; i++)
        far = fmax(far, fabs(s->x[3 * i]) + fabs(s->x[3 * i + 1]) + fabs(s->x[3 * i + 2]));
    const double stiff = body->spec->material.young * (1 + fmax(nu, 0) / (1 - 2 * nu));
    return 4e-15 * stiff * h * (far + body->size) * sqrt((double)s->nfree);
}

static double longest(const stepping *s, const double *dx)
{
    double most = 0;
    for (int i = 0; i < s->nfree; i++) {
        const double d = cn_norm2(dx + 3 * i);
        if (!(d <= most)) most = d; /* keeps a NaN */
    }
    return sqrt(most);
}

/* Lists the pairs along the motion dx from x, and a little more for what the solver adds. */
static cn_status find_contacts(const stepping *s, const double *x, const double *dx)
{
    const cn_contact_model *contact = s->work->body->contact;
    return cn_contact_find(contact, s->work->contact, s->nfree, x, dx, 2 * contact->gap, 0, s->work->pool);
}

/* Largest fraction of dx that strict contact allows; pairs are listed anew when the motion leaves their
 * reach. */
static cn_status allowed(const stepping *s, const double *x, double *dx, double *fraction)
{
    cn_work *work = s->work;
    cn_contact *contact = work->contact;
    cn_status status;
    *fraction = 1;
    if (!s->strict) return CN_OK;
    const double start = seconds();
    double far = 0, scale = 1;
    if (!contact->anchored) cn_contact_anchor(work->body->contact, contact, x, work->pool);
    for (int i = 0; i < s->nfree; i++) {
        double to[3];
        for (int k = 0; k < 3; k++)
            to[k] = x[3 * i + k] + dx[3 * i + k] - contact->from[3 * i + k];
        far = fmax(far, cn_norm2(to));
    }
    if (sqrt(far) > contact->reach) {
        const double most = longest(s, dx),
                     cap = fmax(20 * work->body->contact->gap, 2 * s->dt * longest(s, s->from->v));
        if (most > cap) scale = cap / most;
        for (int i = 0; i < 3 * s->nfree; i++)
            work->trial[i] = scale * dx[i];
        if ((status = find_contacts(s, x, work->trial)) != CN_OK) return status;
    }
    *fraction = scale * cn_contact_motion(work->body->contact, contact, x, scale < 1 ? work->trial : dx, 0.2,
                                          work->pool);
    work->collision_s += seconds() - start;
    return CN_OK;
}

/* Frozen stiffness: an earlier factor serves while no element has turned by more than about 0.02 rad since
 * and nothing but the body's own elasticity and inertia is in the matrix. A chain is refactored faster than
 * it is iterated. */
static bool factor_serves(const stepping *s)
{
    const cn_work *work = s->work;
    const cn_switch refactor = work->model->scene->leave_out.refactor; /* ON: left out */
    if (refactor == CN_OFF || !work->factored || work->factored_nfree != s->nfree ||
        work->factored_dt != s->dt)
        return false;
    if (work->model->single ? refactor != CN_ON
                            : refactor == CN_AUTO && cn_solver_kind(work->solver) != CN_LINEAR_CHOLESKY)
        return false;
    for (int i = 0; i < s->nfree; i++)
        if (work->drive.weight[i] > 0) return false;
    if (s->strict && cn_contact_least(work->contact) < work->body->contact->gap) return false;
    for (int e = 0; e < work->body->body->ntet; e++) {
        const double *p = work->factored_turn + 4 * e, *q = s->rotation + 4 * e;
        if (!(fabs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]) > 1 - 5e-5)) return false;
    }
    return true;
}

static cn_status factor(const stepping *s)
{
    cn_work *work = s->work;
    const cn_status status =
        cn_solver_factor(work->solver, work->matrix, s->nfree, work->body->fixed, work->pool);
    work->factored = status == CN_OK && cn_solver_kind(work->solver) != CN_LINEAR_CG;
    work->factored_nfree = s->nfree, work->factored_dt = s->dt;
    memcpy(work->factored_turn, s->rotation, 4 * (size_t)work->body->body->ntet * sizeof(double));
    return status;
}

/* dx = - H^-1 g with the factor at hand, and its slope g . dx. */
static cn_status solve(const stepping *s, double *slope, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const double tolerance = work->model->scene->solver.linear_tolerance;
    int iterations = 0;
    double residual = 0;
    for (int i = 0; i < 3 * s->nfree; i++)
        work->trial[i] = -work->gradient[i], work->dx[i] = 0;
    cn_status status = cn_solver_solve(work->solver, work->trial, work->dx, tolerance, 1000, &iterations,
                                       &residual, work->pool);
    if (iterations > figures->linear) figures->linear = iterations;
    if (status == CN_ERR_CONVERGENCE) {
        CN_LOG(CN_LOG_WARNING, "linear solver not converged: relative residual %.2e after %d iterations",
               residual, iterations);
        figures->unconverged++;
        figures->linear_residual = fmax(figures->linear_residual, residual);
        status = CN_OK;
    }
    *slope = 0;
    for (int i = 0; i < 3 * s->nfree; i++)
        *slope += work->gradient[i] * work->dx[i];
    return status == CN_OK && !isfinite(*slope) ? CN_ERR_NOT_FINITE : status;
}

/* Adds share * M/dt^2 to the matrix. */
static void stiffen(const stepping *s, double share)
{
    cn_matrix *a = s->work->matrix;
    for (int i = 0; i < s->nfree; i++)
        for (int k = 0; k < 3; k++)
            a->value[9 * (size_t)a->diagonal[i] + 4 * (size_t)k] +=
                share * s->work->body->body->mass[i] / (s->dt * s->dt);
}

/* A direction of descent: by an earlier factor (keep), the exact tangent, the exact tangent with ever more
 * inertia where it is not positive definite (a body about to snap), at last the projected one. */
static cn_status newton_direction(const stepping *s, bool keep, double *slope, cn_step_figures *figures)
{
    cn_work *work = s->work;
    cn_status status;
    if (keep) {
        figures->kept++;
        if ((status = solve(s, slope, figures)) != CN_OK || *slope < 0) return status;
        evaluate(s, s->x, work->u, CN_TANGENT_EXACT);
    }
    double added = 0;
    for (int attempt = 0; attempt < 6; attempt++) {
        if ((status = factor(s)) == CN_OK && (status = solve(s, slope, figures)) == CN_OK && *slope < 0) {
            work->added = added / 10;
            return CN_OK;
        }
        if (status != CN_OK && status != CN_ERR_SINGULAR) return status;
        const double more = fmax(10 * added, fmax(10, work->added));
        stiffen(s, more - added);
        added = more;
    }
    evaluate(s, s->x, work->u, CN_TANGENT_PROJECTED);
    status = factor(s);
    return status == CN_OK ? solve(s, slope, figures) : status;
}

static cn_status minimise(const stepping *s, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const cn_model *model = work->model;
    const double tolerance = model->scene->solver.tolerance;
    const int tangent = model->single ? CN_TANGENT_WARPED : CN_TANGENT_EXACT;
    bool keep = factor_serves(s);
    double energy = evaluate(s, s->x, work->u, keep ? -1 : tangent), slope = 0, fraction, before = INFINITY;
    cn_status status;

    for (figures->newton = 0;;) {
        if (!isfinite(energy)) return CN_ERR_NOT_FINITE;
        const double residual = norm_free(s, work->gradient);
        const double floor = gradient_floor(s);
        if (residual <= (figures->newton ? fmax(tolerance * work->residual_scale, floor) : floor))
            return CN_OK;
        if (figures->newton == model->newton) return model->single ? CN_OK : CN_ERR_CONVERGENCE;
        if (keep && figures->newton && residual > 0.2 * before) { /* too stale to gain by */
            keep = false;
            energy = evaluate(s, s->x, work->u, tangent);
        }
        before = residual;
        if ((status = newton_direction(s, keep, &slope, figures)) != CN_OK) return status;
        figures->newton++;
        const int then = keep || figures->newton == model->newton ? -1 : tangent;
        if ((status = allowed(s, s->x, work->dx, &fraction)) != CN_OK) return status;

        /* Where the promised decrease is lost in the energy's round-off the gradient decides. */
        const bool lost = -slope <= 1e-11 * work->energy_size;
        for (int half = 0;; half++, fraction *= 0.5) {
            if (half == 40) return lost ? CN_OK : CN_ERR_CONVERGENCE;
            for (int i = 0; i < 3 * s->nfree; i++) {
                work->trial_u[i] = work->u[i] + fraction * work->dx[i];
                work->trial[i] = s->from->x[i] + work->trial_u[i];
            }
            memcpy(work->trial + 3 * s->nfree, s->x + 3 * s->nfree,
                   3 * (size_t)(s->nactive - s->nfree) * sizeof(double));
            const double next = evaluate(s, work->trial, work->trial_u, half ? -1 : then);
            const bool better =
                lost ? norm_free(s, work->gradient) < residual : next <= energy + 1e-4 * fraction * slope;
            if (model->single || better) {
                energy = half && then >= 0 ? evaluate(s, work->trial, work->trial_u, then) : next;
                break;
            }
            if (lost && half == 3) { /* converged as far as round-off lets it */
                evaluate(s, s->x, work->u, -1);
                return CN_OK;
            }
        }
        memcpy(s->x, work->trial, 3 * (size_t)s->nfree * sizeof(double));
        memcpy(work->u, work->trial_u, 3 * (size_t)s->nfree * sizeof(double));
    }
}

static void setup(stepping *s, const cn_model *model, int ibody, const cn_body_state *from, cn_body_state *to,
                  const cn_path *path, double time, double dt, cn_work *work)
{
    const cn_model_body *body = &model->body[ibody];
    *s = (stepping){.work = work, .from = from, .dt = dt, .x = to->x, .rotation = to->rotation};
    s->nfree = to->nfree;
    s->nactive = s->nfree < body->body->nnode ? s->nfree + body->per_station : s->nfree;
    if (s->nactive > body->body->nnode) s->nactive = body->body->nnode;
    s->strict = body->contact && model->scene->contact.method == CN_CONTACT_STRICT;
    cn_drive_prepare(body, from, path, dt, &work->drive);
    external_force(s, time);
}

/* Sum of nodal drive forces and the base's push; their work over the step. */
static void drive_figures(const stepping *s, cn_step_figures *figures)
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

cn_status cn_step(const cn_model *model, int ibody, const cn_state *state, cn_state *trial,
                  const cn_path *path, double dt, cn_work *work, cn_step_figures *figures)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body_state *from = &state->body[ibody];
    cn_body_state *to = &trial->body[ibody];
    const double start = seconds(), tick = state->time + dt;
    cn_status status;
    stepping s;

    *figures = (cn_step_figures){.gap = INFINITY};
    cn_state_copy_body(to, from, body);
    setup(&s, model, ibody, from, to, path, tick, dt, work);
    work->collision_s = 0, work->added = 0;
    cn_sheath_advance(body, to, work->drive.advance, dt);

    /* begin where the velocity leads, as far as contact lets it */
    memset(work->u, 0, 3 * (size_t)s.nfree * sizeof(double));
    if (!model->single) {
        double fraction = 1;
        for (int i = 0; i < 3 * s.nfree; i++)
            work->dx[i] = body->fixed[i / 3] ? 0 : dt * from->v[i];
        if (s.strict) {
            const double begin = seconds();
            if ((status = find_contacts(&s, from->x, work->dx)) != CN_OK) return status;
            fraction = cn_contact_motion(body->contact, work->contact, from->x, work->dx, 0.2, work->pool);
            work->collision_s += seconds() - begin;
        }
        for (int i = 0; i < 3 * s.nfree; i++) {
            work->u[i] = fraction * work->dx[i];
            to->x[i] = from->x[i] + work->u[i];
        }
    } else if (s.strict && (status = find_contacts(&s, from->x, NULL)) != CN_OK) {
        return status;
    }
    if (work->damping.value) {
        cn_matrix_clear(work->matrix, s.nactive);
        cn_body_add_elastic(body->body, s.nactive, from->x, to->rotation, work->elastic, CN_TANGENT_PROJECTED,
                            1, work->scatter, work->pool);
        memcpy(work->damping.value, work->matrix->value, 9 * (size_t)work->matrix->nblock * sizeof(double));
    }
    status = minimise(&s, figures);
    if (status != CN_OK) return status;

    drive_figures(&s, figures);
    for (int i = 0; i < 3 * s.nfree; i++)
        to->v[i] = work->u[i] / dt;
    const double contact_start = seconds();
    if (s.strict) {
        int wall;
        figures->gap = cn_contact_least(work->contact);
        figures->wall_force =
            cn_contact_patch_force(body->contact, work->contact, to->x, figures->wall_where, &wall);
    } else if (body->contact && model->scene->contact.method == CN_CONTACT_PROJECT) {
        memcpy(work->trial, to->v, 3 * (size_t)s.nfree * sizeof(double));
        cn_contact_project(body->contact, work->contact, s.nfree, to->x, to->v,
                           model->scene->contact.response, model->scene->contact.restitution, 20);
        double impulse[3] = {0, 0, 0};
        for (int i = 0; i < 3 * s.nfree; i++)
            impulse[i % 3] += body->body->mass[i / 3] * (to->v[i] - work->trial[i]);
        figures->wall_force = cn_norm(impulse) / dt;
    }
    cn_sheath_release(body, to);
    cn_drive_progress(body, to, path);
    if (body->contact) {
        int naxis;
        cn_axis_points(body, to, &naxis, work->axis);
        status = cn_contact_check(body->contact, work->contact, to->nfree, to->x, naxis, work->axis,
                                  &figures->findings, work->pool);
        if (figures->findings.outside) figures->gap = fmin(figures->gap, -figures->findings.depth);
    }
    if (s.strict && status == CN_OK && figures->findings.intersections + figures->findings.outside > 0)
        status = CN_ERR_NOT_FREE; /* never accepted, whatever the response made of it */
    work->collision_s += seconds() - contact_start;
    figures->collision_s = work->collision_s;
    figures->fem_s = seconds() - start - work->collision_s;
    for (int i = 0; i < 3 * body->body->nnode; i++)
        if (!isfinite(to->x[i]) || !isfinite(to->v[i])) return CN_ERR_NOT_FINITE;
    return status;
}

double cn_step_residual(const cn_model *model, int ibody, const cn_state *state, const cn_state *trial,
                        const cn_path *path, double dt, cn_work *work)
{
    const cn_model_body *body = &model->body[ibody];
    const cn_body_state *from = &state->body[ibody], *to = &trial->body[ibody];
    const cn_body *b = body->body;
    double sums[4] = {0, 0, 0, 0}; /* squares: residual, inertial, internal, external */
    cn_body_state before = *to;
    stepping s;

    before.nfree = from->nfree;
    setup(&s, model, ibody, from, &before, path, state->time + dt, dt, work);
    const size_t active = 3 * (size_t)s.nactive * sizeof(double);
    memset(work->elastic, 0, active), memset(work->path, 0, active), memset(work->touch, 0, active);
    cn_body_add_elastic(b, s.nactive, to->x, to->rotation, work->elastic, CN_TANGENT_WARPED, 1, NULL,
                        work->pool);
    cn_drive_add(&work->drive, s.nfree, to->x, work->path, 1, NULL);
    if (s.strict &&
        cn_contact_find(body->contact, work->contact, s.nfree, to->x, NULL, 0, 0, work->pool) == CN_OK)
        cn_contact_add(body->contact, work->contact, to->x, work->touch, NULL, false, work->pool);
    /* projection moves nodes after the solve: what the step made of them is what counts */
    const bool moved = model->scene->contact.method == CN_CONTACT_PROJECT;
    memset(work->damped, 0, active);
    if (work->damping.value) { /* of the tangent at the step's start, as in the step */
        for (int i = 0; i < 3 * s.nactive; i++)
            work->moved[i] = i < 3 * s.nfree ? (to->x[i] - from->x[i]) * b->damping_stiffness / dt : 0;
        cn_matrix_multiply(&work->damping, s.nfree, work->moved, work->damped, work->pool);
    }
    for (int i = 0; i < 3 * s.nfree; i++) {
        if (body->fixed[i / 3]) continue;
        const double m = b->mass[i / 3], v1 = moved ? (to->x[i] - from->x[i]) / dt : to->v[i];
        const double inertial = (model->inertia ? m * (v1 - from->v[i]) / dt : 0) + b->damping * m * v1;
        const double left = inertial + work->damped[i] - work->elastic[i] - work->external[i] -
                            work->path[i] - work->touch[i];
        sums[0] += left * left, sums[1] += inertial * inertial;
        sums[2] += work->elastic[i] * work->elastic[i], sums[3] += work->external[i] * work->external[i];
    }
    const double scale = sqrt(fmax(sums[1], fmax(sums[2], sums[3]))), floor = gradient_floor(&s);
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
    return cn_contact_check(body->contact, work->contact, at->nfree, at->x, naxis, work->axis, findings,
                            work->pool);
}
