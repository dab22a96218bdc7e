/* step_newton.c - the minimum of a stage by Newton with the exact tangent (projected where that is not
 * positive definite) and line search. With strict contact each motion is cut by the continuous test before it
 * is taken, so that every iterate is free. */
#include "step_parts.h"

#include <math.h>
#include <string.h>
#include <time.h>
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
    const cn_body *b = s->work->body->body;
    const double lever = 1 / (b->lever * b->lever);
    double sum = 0;
    EACH_FREE(s, i)
    if (!s->work->body->fixed[i]) sum += (i < b->nnode ? 1 : lever) * cn_norm2(f + 3 * i);
    return sqrt(sum);
}

/* Contact's energy at x, its force in work->touch. */
static double touch(const cn_stage *s, const double *x, cn_matrix *a, bool exact)
{
    cn_work *work = s->work;
    const cn_body *b = work->body->body;
    const double start = cn_step_seconds();
    double energy, *force = work->carry ? work->points_force : work->touch;
    const double *points = cn_body_points(b, s->nactive, x, s->rotation, work->points_trial);
    if (work->carry) {
        memset(force, 0, 3 * (size_t)b->npoint * sizeof *force);
        cn_body_carry(b, s->nactive, x, s->rotation, work->carry);
    }
    energy =
        cn_contact_add(work->body->contact, work->contact, points, force, work->carry, a, exact, work->pool);
    if (work->carry)
        cn_body_pull(b, s->nactive, x, s->rotation, work->carry, force, work->touch, 1, exact ? a : NULL);
    work->collision_s += cn_step_seconds() - start;
    return energy;
}

void cn_stage_touch(const cn_stage *s, const double *x)
{
    touch(s, x, NULL, false);
}

/* The inertia's and the damping's share: energy, force into `pull`; with a also their stiffness. */
static double inertia_of(const cn_stage *s, int i, const double *u, double pull[3], cn_matrix *a)
{
    const cn_work *work = s->work;
    const cn_body *b = work->body->body;
    const double over = work->model->inertia ? 1 / (s->h * s->h) : 0, damp = b->damping / s->h;
    double ahead[3], behind[3], mass_ahead[3], mass_behind[3];
    for (int k = 0; k < 3; k++)
        ahead[k] = u[3 * i + k] - work->ahead[3 * i + k], behind[k] = u[3 * i + k] - work->lag[3 * i + k];
    cn_stage_mass(s, i, ahead, mass_ahead), cn_stage_mass(s, i, behind, mass_behind);
    for (int k = 0; k < 3; k++)
        pull[k] = over * mass_ahead[k] + damp * mass_behind[k];
    for (int k = 0; a && k < 9; k++)
        a->value[9 * (size_t)a->diagonal[i] + (size_t)k] +=
            (over + damp) * (i >= b->nnode ? work->spin[9 * (size_t)(i - b->nnode) + (size_t)k]
                             : k % 4 == 0  ? b->mass[i]
                                           : 0);
    return 0.5 * (over * cn_dot(ahead, mass_ahead) + damp * cn_dot(behind, mass_behind));
}

/* The potential at x = x0 + u and its gradient; with `tangent` >= 0 also the matrix. */
static double evaluate(const cn_stage *s, const double *x, const double *u, int tangent)
{
    cn_work *work = s->work;
    const cn_body *b = work->body->body;
    const size_t all = 3 * (size_t)(b->nblock > b->nnode ? b->nblock : s->nactive) * sizeof(double);
    cn_matrix *a = tangent >= 0 ? work->matrix : NULL;
    double inertia = 0, load = 0, inertia_norm = 0, contact = 0;

    if (a) cn_matrix_clear(work->matrix, s->rows < b->nblock ? s->nactive : b->nblock);
    memset(work->elastic, 0, all), memset(work->path, 0, all), memset(work->touch, 0, all);
    const double elastic = cn_body_add_elastic(b, s->nactive, x, s->rotation, work->elastic,
                                               a ? (cn_tangent)tangent : CN_TANGENT_WARPED, 1,
                                               a ? work->scatter : NULL, work->pool);
    const double path = cn_drive_add(&work->drive, s->nfree, x, work->path, 1, a);
    if (s->strict) contact = touch(s, x, a, tangent == CN_TANGENT_EXACT);
    EACH_FREE(s, i)
    {
        const double over = i < b->nnode ? 1 : 1 / b->lever;
        double pull[3];
        inertia += inertia_of(s, i, u, pull, a);
        inertia_norm += over * over * cn_norm2(pull);
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            const double given = work->external[k] + work->constant[k];
            load += given * u[k];
            work->gradient[k] = pull[k - 3 * i] - work->elastic[k] - given - work->path[k] - work->touch[k];
        }
    }
    if (work->damping.value) {
        const double beta = b->damping_stiffness / s->h;
        memset(work->moved, 0, all);
        EACH_FREE(s, i)
        cn_sub(u + 3 * i, work->lag + 3 * i, work->moved + 3 * i);
        cn_matrix_multiply(&work->damping, s->rows, work->moved, work->damped, work->pool);
        EACH_FREE(s, i)
        {
            cn_axpy(beta, work->damped + 3 * i, work->gradient + 3 * i);
            inertia += 0.5 * beta * cn_dot(work->damped + 3 * i, work->moved + 3 * i);
        }
        for (int i = 0; a && i < 9 * work->matrix->row[s->rows]; i++)
            work->matrix->value[i] += beta * work->damping.value[i];
    }
    const double internal = norm_free(s, work->elastic), external = norm_free(s, work->external);
    work->residual_scale = fmax(sqrt(inertia_norm), fmax(internal, external));
    work->energy_size = inertia + fabs(elastic) + fabs(path) + fabs(contact) + fabs(load);
    EACH_FREE(s, i)
    if (work->body->fixed[i]) memset(work->gradient + 3 * i, 0, 3 * sizeof(double));
    return inertia + elastic + path + contact - load;
}

double cn_stage_floor(const cn_stage *s)
{
    const cn_model_body *body = s->work->body;
    double far = 0;
    for (int i = 0; i < s->nfree; i++)
        far = fmax(far, fabs(s->x[3 * i]) + fabs(s->x[3 * i + 1]) + fabs(s->x[3 * i + 2]));
    return 4e-15 * body->body->spring * (far + body->size) * sqrt((double)s->nfree);
}

static double longest(int n, const double *dx)
{
    double most = 0;
    for (int i = 0; i < n; i++) {
        const double d = cn_norm2(dx + 3 * i);
        if (!(d <= most)) most = d; /* keeps a NaN */
    }
    return sqrt(most);
}

/* How the points move when the blocks go from x to x + fraction dx; from: the points at x. A rod's do not go
 * straight: between two states that are accepted they are taken to. */
static const double *motion_of(const cn_stage *s, const double *x, const double *dx, double fraction,
                               const double *from)
{
    cn_work *work = s->work;
    if (!work->carry && fraction == 1) return dx;
    double *to = work->carry ? work->points_trial : work->motion;
    if (work->carry) {
        memcpy(work->trial, x, 3 * (size_t)work->body->body->nblock * sizeof *x);
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++)
            work->trial[k] = x[k] + fraction * dx[k];
        cn_body_points(work->body->body, s->nactive, work->trial, s->rotation, to);
        for (int i = 0; i < 3 * cn_body_points_of(work->body->body, s->nfree); i++)
            work->motion[i] = to[i] - from[i];
    } else {
        for (int i = 0; i < 3 * s->nfree; i++)
            to[i] = fraction * dx[i];
    }
    return work->motion;
}

/* Lists the pairs along a motion of the points, and a little more for what the solver adds. */
static cn_status find_contacts(const cn_stage *s, const double *points, const double *motion)
{
    const cn_contact_model *contact = s->work->body->contact;
    return cn_contact_find(contact, s->work->contact, cn_body_points_of(s->work->body->body, s->nfree),
                           points, motion, 2 * contact->gap, 0, s->work->pool);
}

/* Largest fraction of dx that strict contact allows; pairs are listed anew when the motion leaves their
 * reach, or at once (`anew`). A rod's motion is tested as a whole, and again when it is shortened. */
static cn_status allowed(const cn_stage *s, const double *x, const double *dx, bool anew, double *fraction)
{
    cn_work *work = s->work;
    cn_contact *contact = work->contact;
    const cn_contact_model *model = work->body->contact;
    if (!s->strict) return CN_OK;
    const int n = cn_body_points_of(work->body->body, s->nfree);
    const double start = cn_step_seconds();
    const double *from = cn_body_points(work->body->body, s->nactive, x, s->rotation, work->points);
    cn_status status = CN_OK;
    if (!anew && !contact->anchored) cn_contact_anchor(model, contact, from, work->pool);
    for (int tries = 0;; tries++) {
        const double *motion = motion_of(s, x, dx, *fraction, from);
        double far = 0;
        for (int i = 0; i < n && !anew; i++) {
            double to[3];
            for (int k = 0; k < 3; k++)
                to[k] = from[3 * i + k] + motion[3 * i + k] - contact->from[3 * i + k];
            far = fmax(far, cn_norm2(to));
        }
        if (anew || sqrt(far) > contact->reach) {
            const double most = longest(n, motion),
                         cap = fmax(20 * model->gap, 2 * s->h * longest(s->nfree, s->from->v));
            if (!anew && most > cap) *fraction *= cap / most, motion = motion_of(s, x, dx, *fraction, from);
            if ((status = find_contacts(s, from, motion)) != CN_OK) break;
        }
        const double most = cn_contact_motion(model, contact, from, motion, 0.2, work->pool);
        if (!work->carry) *fraction *= most;
        if (!work->carry || most >= 1) break;
        *fraction = tries < 40 ? 0.9 * most * *fraction : 0;
        if (*fraction == 0) break;
    }
    work->collision_s += cn_step_seconds() - start;
    return status;
}

cn_status cn_stage_start(const cn_stage *s, const double *dx)
{
    cn_work *work = s->work;
    double fraction = dx ? 1 : 0;
    cn_status status = CN_OK;
    if (s->strict && !dx) {
        status = find_contacts(
            s, cn_body_points(work->body->body, s->nactive, s->x, s->rotation, work->points), NULL);
    } else if (s->strict) {
        status = allowed(s, s->x, dx, true, &fraction);
    }
    if (status != CN_OK || !dx) return status;
    EACH_FREE(s, i)
    for (int k = 3 * i; k < 3 * i + 3; k++) {
        work->u[k] += fraction * dx[k];
        s->x[k] = s->from->x[k] + work->u[k];
    }
    return CN_OK;
}

/* Frozen stiffness: an earlier factor serves while no element has turned by more than about 0.02 rad since
 * and nothing but the body's own elasticity and inertia is in the matrix. A chain is refactored faster than
 * it is iterated. */
static bool factor_serves(const cn_stage *s)
{
    const cn_work *work = s->work;
    const cn_switch refactor = work->model->scene->leave_out.refactor; /* ON: left out */
    if (refactor == CN_OFF || !work->factored || work->carry || work->factored_nfree != s->nfree ||
        work->factored_h != s->h)
        return false;
    if (work->model->single ? refactor != CN_ON
                            : refactor == CN_AUTO && cn_solver_kind(work->solver) != CN_LINEAR_CHOLESKY)
        return false;
    for (int i = 0; i < s->nfree; i++)
        if (work->drive.weight[i] > 0) return false;
    if (s->strict && cn_contact_least(work->contact) < work->body->contact->gap) return false;
    for (int e = 0; e < work->body->body->nturn; e++) {
        const double *p = work->factored_turn + 4 * e, *q = s->rotation + 4 * e;
        if (!(fabs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]) > 1 - 5e-5)) return false;
    }
    return true;
}

static cn_status factor(const cn_stage *s)
{
    cn_work *work = s->work;
    cn_solver_place(work->solver, s->x);
    const cn_status status = cn_solver_factor(work->solver, work->matrix, s->rows, work->held, work->pool);
    work->factored = status == CN_OK && cn_solver_kind(work->solver) != CN_LINEAR_CG;
    work->factored_nfree = s->nfree, work->factored_h = s->h;
    memcpy(work->factored_turn, s->rotation, 4 * (size_t)work->body->body->nturn * sizeof(double));
    return status;
}

static bool iterative(const cn_stage *s)
{
    const cn_linear kind = cn_solver_kind(s->work->solver);
    return kind == CN_LINEAR_CG || kind == CN_LINEAR_PCG;
}

/* Part of the residual that an iterative solver may leave. */
static const double FORCING = 0.05;

/* How far an iterative solver has to go: no further than the iteration's own error, of second order
 * (Eisenstat and Walker 1996, choice 2), nor than what is asked of the step. */
static double forcing(double residual, double before, double aim)
{
    const double ratio = residual / before; /* 0 at first */
    const double own = ratio > 0 ? fmin(FORCING, 0.5 * ratio * ratio) : FORCING;
    return fmin(0.5, fmax(own, 0.5 * aim / residual));
}

/* dx = - H^-1 g with the factor at hand, and its slope g . dx. */
static cn_status solve(const cn_stage *s, double *slope, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const bool warm = iterative(s) && work->model->single; /* from the last step's motion */
    const double least = work->model->scene->solver.linear_tolerance;
    const double tolerance = iterative(s) && !warm ? fmax(least, work->forcing) : least;
    int iterations = 0;
    double residual = 0;
    for (int i = 0; i < 3 * s->rows; i++)
        work->trial[i] = work->dx[i] = 0;
    EACH_FREE(s, i)
    {
        cn_axpy(-1, work->gradient + 3 * i, work->trial + 3 * i);
        if (warm) memcpy(work->dx + 3 * i, work->ahead + 3 * i, 3 * sizeof(double));
    }
    const bool checked = cn_solver_kind(work->solver) != CN_LINEAR_CHAIN; /* a chain's is round-off */
    cn_status status = cn_solver_solve(work->solver, work->trial, work->dx, tolerance, 1000, &iterations,
                                       checked ? &residual : NULL, work->pool);
    if (iterations > figures->linear) figures->linear = iterations;
    if (status == CN_ERR_CONVERGENCE) {
        CN_LOG(CN_LOG_WARNING, "linear solver not converged: relative residual %.2e after %d iterations",
               residual, iterations);
        figures->unconverged++;
        figures->linear_residual = fmax(figures->linear_residual, residual);
        status = CN_OK;
    }
    *slope = 0;
    EACH_FREE(s, i)
    *slope += cn_dot(work->gradient + 3 * i, work->dx + 3 * i);
    return status == CN_OK && !isfinite(*slope) ? CN_ERR_NOT_FINITE : status;
}

/* Adds share * M/h^2 to the matrix; a rotation counts by its node's mass at the lever. */
static void stiffen(const cn_stage *s, double share)
{
    cn_matrix *a = s->work->matrix;
    const cn_body *b = s->work->body->body;
    const double each = share / (s->h * s->h);
    EACH_FREE(s, i)
    for (int k = 0; k < 3; k++)
        a->value[9 * (size_t)a->diagonal[i] + 4 * (size_t)k] +=
            each * (i < b->nnode ? b->mass[i] : b->mass[i - b->nnode] * b->lever * b->lever);
}

/* The first paper's: whatever the one solve gives. */
static cn_status single_direction(const cn_stage *s, bool keep, double *slope, cn_step_figures *figures)
{
    cn_status status = CN_OK;
    figures->kept += keep;
    if (!keep) status = factor(s);
    return status == CN_OK ? solve(s, slope, figures) : status;
}

/* A direction of descent: by an earlier factor (keep), the exact tangent, the exact tangent with ever more
 * inertia where it is not positive definite (a body about to snap), at last the projected one. */
static cn_status newton_direction(const cn_stage *s, bool keep, double *slope, cn_step_figures *figures)
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
        /* begins with a tenth of what last sufficed: a long way down wants less and less */
        const double more = added > 0 ? 10 * added : work->added > 0 ? work->added : 10;
        stiffen(s, more - added);
        added = more;
    }
    evaluate(s, s->x, work->u, CN_TANGENT_PROJECTED);
    status = factor(s);
    return status == CN_OK ? solve(s, slope, figures) : status;
}

/* True where a shorter motion of the line search is free too: a rod's is not a part of the longer one. */
static bool still_free(const cn_stage *s, double fraction, cn_status *status)
{
    double most = fraction;
    if (!s->strict || !s->work->carry) return true;
    *status = allowed(s, s->x, s->work->dx, false, &most);
    return most == fraction;
}

/* The shift of a body in free flight that takes the net force left to nothing: its momentum is kept to
 * rounding, however stiff it is and however far it flies. No strain knows of it. */
static void balance(const cn_stage *s)
{
    cn_work *work = s->work;
    const cn_body *b = work->body->body;
    double net[3] = {0, 0, 0}, mass = 0;
    for (int i = 0; i < b->nnode; i++) {
        cn_axpy(1, work->gradient + 3 * i, net);
        mass += b->mass[i];
    }
    if (!(mass > 0)) return;
    const double share = mass * (1 / (s->h * s->h) + b->damping / s->h);
    for (int i = 0; i < b->nnode; i++) {
        cn_axpy(-1 / share, net, work->u + 3 * i);
        cn_add(s->from->x + 3 * i, work->u + 3 * i, s->x + 3 * i);
    }
}

cn_status cn_stage_minimise(const cn_stage *s, cn_step_figures *figures)
{
    cn_work *work = s->work;
    const cn_model *model = work->model;
    const double tolerance = model->scene->solver.tolerance, floor = cn_stage_floor(s);
    const int tangent = model->single ? CN_TANGENT_WARPED : CN_TANGENT_EXACT;
    bool keep = factor_serves(s), assembled = !keep;
    double energy = evaluate(s, s->x, work->u, keep ? -1 : tangent), slope = 0, before = INFINITY;
    cn_status status = CN_OK;

    for (int done = 0;; done++) {
        if (!isfinite(energy)) return CN_ERR_NOT_FINITE;
        const double residual = norm_free(s, work->gradient),
                     aim = fmax(tolerance * work->residual_scale, floor);
        if (residual <= (done ? aim : floor)) {
            if (s->free_flight) balance(s);
            return CN_OK;
        }
        if (done == model->newton) return model->single ? CN_OK : CN_ERR_CONVERGENCE;
        if (keep && done && residual > 0.2 * before) keep = false; /* too stale to gain by */
        if (!keep && !assembled) energy = evaluate(s, s->x, work->u, tangent);
        work->forcing = forcing(residual, before, aim);
        status = (model->single ? single_direction : newton_direction)(s, keep, &slope, figures);
        if (status != CN_OK) return status;
        figures->newton++;
        /* an iterate that is expected to be the last is seen without the matrix */
        double expected = isfinite(before) ? residual * fmin(1, residual / before) : residual;
        if (done && iterative(s)) expected = fmin(expected, work->forcing * residual);
        const bool last = done + 1 == model->newton || expected <= aim;
        const int then = keep || last ? -1 : tangent;
        before = residual;
        double fraction = 1;
        if ((status = allowed(s, s->x, work->dx, false, &fraction)) != CN_OK) return status;

        /* Where the promised decrease is lost in the energy's round-off the gradient decides. */
        const bool lost = -slope <= 1e-11 * work->energy_size;
        for (int half = 0;; half++, fraction *= 0.5) {
            if (half == 40) return lost ? CN_OK : CN_ERR_CONVERGENCE;
            if (half && !still_free(s, fraction, &status)) {
                if (status != CN_OK) return status;
                continue;
            }
            memcpy(work->trial, s->x, 3 * (size_t)work->body->body->nblock * sizeof(double));
            EACH_FREE(s, i)
            for (int k = 3 * i; k < 3 * i + 3; k++) {
                work->trial_u[k] = work->u[k] + fraction * work->dx[k];
                work->trial[k] = s->from->x[k] + work->trial_u[k];
            }
            const double next = evaluate(s, work->trial, work->trial_u, half ? -1 : then);
            const bool better =
                lost ? norm_free(s, work->gradient) < residual : next <= energy + 1e-4 * fraction * slope;
            if (model->single || better) {
                assembled = then >= 0;
                energy = half && assembled ? evaluate(s, work->trial, work->trial_u, then) : next;
                break;
            }
            if (lost && half == 3) { /* converged as far as round-off lets it */
                evaluate(s, s->x, work->u, -1);
                return CN_OK;
            }
        }
        EACH_FREE(s, i)
        {
            memcpy(s->x + 3 * i, work->trial + 3 * i, 3 * sizeof(double));
            memcpy(work->u + 3 * i, work->trial_u + 3 * i, 3 * sizeof(double));
        }
    }
}
