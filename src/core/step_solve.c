/* step_solve.c - a direction from the gradient: each body's own matrix by its own solver; where contact links
 * bodies, or two places of one, conjugate gradients over those, preconditioned by the solvers in turn. */
#include "step_parts.h"

#include <math.h>
#include <string.h>

/* Frozen stiffness: an earlier factor serves while no element has turned by more than about 0.02 rad since
 * and nothing but the body's own elasticity and inertia is in the matrix. A chain is refactored faster than
 * it is iterated. */
static bool factor_serves(const cn_stage *s)
{
    const cn_part *part = s->part;
    const cn_switch refactor = part->model->scene->leave_out.refactor; /* ON: left out */
    if (refactor == CN_OFF || !part->factored || part->carry || part->factored_nfree != s->nfree ||
        part->factored_h != s->h)
        return false;
    if (part->model->single ? refactor != CN_ON
                            : refactor == CN_AUTO && cn_solver_kind(part->solver) != CN_LINEAR_CHOLESKY)
        return false;
    for (int i = 0; i < s->nfree; i++)
        if (part->drive.weight[i] > 0) return false;
    for (int e = 0; e < part->body->body->nturn; e++) {
        const double *p = part->factored_turn + 4 * e, *q = s->rotation + 4 * e;
        if (!(fabs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]) > 1 - 5e-5)) return false;
    }
    return true;
}

bool cn_stage_keeps(const cn_group *g)
{
    if (g->pressed && g->work->penalty->nspring) return false;
    if (g->strict && (g->work->contact->nrub || cn_contact_touches(g->work->contact))) return false;
    EACH_STAGE(g, s)
    if (!factor_serves(s)) return false;
    return true;
}

cn_status cn_stage_factor(const cn_group *g)
{
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        if (part->settled) continue;
        if (part->sheet) {
            const cn_status status = cn_wall_factor(s);
            if (status != CN_OK) return status;
            continue;
        }
        cn_solver_place(part->solver, s->x);
        const cn_status status =
            cn_solver_factor(part->solver, part->matrix, s->rows, part->held, part->pool);
        part->factored = status == CN_OK && cn_solver_kind(part->solver) != CN_LINEAR_CG;
        part->factored_nfree = s->nfree, part->factored_h = s->h;
        memcpy(part->factored_turn, s->rotation, 4 * (size_t)part->body->body->nturn * sizeof(double));
        if (status != CN_OK) return status;
    }
    return CN_OK;
}

static bool iterative(const cn_part *part)
{
    const cn_linear kind = cn_solver_kind(part->solver);
    return kind == CN_LINEAR_CG || kind == CN_LINEAR_PCG;
}

bool cn_stage_iterative(const cn_group *g)
{
    EACH_STAGE(g, s)
    if (iterative(s->part)) return true;
    return (g->strict && g->work->contact->nlink > 0) || (g->pressed && g->work->penalty->nlink > 0);
}

/* What joins bodies, or places of one. */
static int links_of(const cn_group *g, const cn_link **link)
{
    const cn_work *work = g->work;
    *link = g->strict ? work->contact->link : g->pressed ? work->penalty->link : NULL;
    return g->strict ? work->contact->nlink : g->pressed ? work->penalty->nlink : 0;
}

/* One body by its own solver. */
static cn_status solve_alone(const cn_stage *s, double forcing, cn_step_figures *figures)
{
    cn_part *part = s->part;
    if (part->settled) {
        memset(part->dx, 0, 3 * (size_t)s->rows * sizeof *part->dx);
        return CN_OK;
    }
    const bool warm = iterative(part) && part->model->single; /* from the last step's motion */
    const double least = part->model->scene->solver.linear_tolerance;
    const double tolerance = iterative(part) && !warm ? fmax(least, forcing) : least;
    int iterations = 0;
    double residual = 0;
    for (int i = 0; i < 3 * s->rows; i++)
        part->trial[i] = part->dx[i] = 0;
    EACH_FREE(s, i)
    {
        cn_axpy(-1, part->gradient + 3 * i, part->trial + 3 * i);
        if (warm) memcpy(part->dx + 3 * i, part->ahead + 3 * i, 3 * sizeof(double));
    }
    const bool checked = cn_solver_kind(part->solver) != CN_LINEAR_CHAIN; /* a chain's is round-off */
    cn_status status = cn_solver_solve(part->solver, part->trial, part->dx, tolerance, 1000, &iterations,
                                       checked ? &residual : NULL, part->pool);
    if (iterations > figures->linear) figures->linear = iterations;
    if (status == CN_ERR_CONVERGENCE) {
        CN_LOG(CN_LOG_WARNING, "linear solver not converged: relative residual %.2e after %d iterations",
               residual, iterations);
        figures->unconverged++;
        figures->linear_residual = fmax(figures->linear_residual, residual);
        status = CN_OK;
    }
    return status;
}

enum { R, Z, P, Q };

/* Notes which bodies contact links to others, or to themselves. */
static void note_links(const cn_group *g)
{
    const cn_work *work = g->work;
    const cn_link *link;
    const int nlink = links_of(g, &link);
    for (int p = 0; p < work->npart; p++)
        work->part[p].linked = false;
    for (int l = 0; l < nlink; l++)
        for (int side = 0; side < 2; side++)
            if (link[l].surface[side] < work->npart) work->part[link[l].surface[side]].linked = true;
}

void cn_point_motion(const cn_part *part, int point, const double *v, double out[3])
{
    const cn_carry *carry = part->carry;
    if (!carry) {
        cn_copy3(v + 3 * (size_t)point, out);
        return;
    }
    out[0] = out[1] = out[2] = 0;
    for (int k = 0; k < carry->nper; k++) {
        const size_t at = (size_t)point * (size_t)carry->nper + (size_t)k;
        cn_axpy(carry->weight[at], v + 3 * (size_t)carry->anchor[at], out);
        if (!carry->arm) continue;
        double turned[3];
        cn_mat_vec(carry->arm + 9 * at, v + 3 * (size_t)(carry->turn + carry->anchor[at]), turned);
        cn_axpy(1, turned, out);
    }
    if (carry->nper > 0) return;
    const int node = carry->node[point];
    cn_mat_vec(carry->arm + 9 * (size_t)point, v + 3 * (size_t)(carry->turn + node), out);
    cn_axpy(1, v + 3 * (size_t)node, out);
}

void cn_point_force(const cn_part *part, int point, const double force[3], double *f)
{
    const cn_carry *carry = part->carry;
    double moment[3];
    if (!carry) {
        cn_axpy(1, force, f + 3 * (size_t)point);
        return;
    }
    for (int k = 0; k < carry->nper; k++) {
        const size_t at = (size_t)point * (size_t)carry->nper + (size_t)k;
        cn_axpy(carry->weight[at], force, f + 3 * (size_t)carry->anchor[at]);
        if (!carry->arm) continue;
        cn_mat_vec_transposed(carry->arm + 9 * at, force, moment);
        cn_axpy(1, moment, f + 3 * (size_t)(carry->turn + carry->anchor[at]));
    }
    if (carry->nper > 0) return;
    const int node = carry->node[point];
    cn_mat_vec_transposed(carry->arm + 9 * (size_t)point, force, moment);
    cn_axpy(1, force, f + 3 * (size_t)node);
    cn_axpy(1, moment, f + 3 * (size_t)(carry->turn + node));
}

double cn_link_along(const cn_work *work, const cn_link *link, int side, const double *v)
{
    const int surface = link->surface[side], first = work->surfaces->surface[surface].first;
    int begin, end;
    double sum = 0;
    cn_link_points(link, side, &begin, &end);
    for (int i = begin; i < end; i++) {
        double d[3];
        cn_point_motion(&work->part[surface], link->p[i] - first, v, d);
        sum += link->w[i] * cn_dot(link->n, d);
    }
    return sum;
}

void cn_link_push(const cn_work *work, const cn_link *link, int side, double y, double *f)
{
    const int surface = link->surface[side], first = work->surfaces->surface[surface].first;
    int begin, end;
    cn_link_points(link, side, &begin, &end);
    for (int i = begin; i < end; i++) {
        double force[3] = {0, 0, 0};
        cn_axpy(y * link->w[i], link->n, force);
        cn_point_force(&work->part[surface], link->p[i] - first, force, f);
    }
}

/* q += the links' part of A p, their bend too (`bent`). Of those with the part that is condensed (-1: none)
 * only how they bend where that part lies still. */
static void add_links(const cn_group *g, int condensed, bool bent)
{
    const cn_work *work = g->work;
    const cn_link *links;
    const int nlink = links_of(g, &links);
    for (int l = 0; l < nlink; l++) {
        cn_link link = links[l];
        bool takes[2] = {link.surface[0] < work->npart, link.surface[1] < work->npart};
        double v[4][3], f[4][3], along[2] = {0, 0}; /* of either side */
        const bool another = link.surface[0] == condensed || link.surface[1] == condensed;
        if (!bent) link.bend = 0;
        if (another && link.bend == 0) continue;
        if (another) link.k = 0, takes[link.surface[1] == condensed] = false;
        for (int i = 0; i < 4; i++) {
            const int side = i >= link.nside, surface = link.surface[side];
            v[i][0] = v[i][1] = v[i][2] = 0;
            if (takes[side])
                cn_point_motion(&work->part[surface], link.p[i] - work->surfaces->surface[surface].first,
                                work->part[surface].cg[P], v[i]);
            along[side] += link.w[i] * cn_dot(link.n, v[i]);
        }
        cn_link_multiply(&link, (const double(*)[3])v, f);
        for (int i = 0; i < 4; i++) {
            const int side = i >= link.nside, surface = link.surface[side];
            if (!takes[side]) continue;
            if (link.own[side]) cn_axpy(-link.k * link.w[i] * along[side], link.n, f[i]);
            cn_point_force(&work->part[surface], link.p[i] - work->surfaces->surface[surface].first, f[i],
                           work->part[surface].cg[Q]);
        }
    }
}

static double dot(const cn_group *g, int a, int b)
{
    double sum = 0;
    EACH_STAGE(g, s)
    {
        if (!s->part->linked) continue;
        double own = 0;
        EACH_FREE(s, i)
        if (!s->part->held[i]) own += cn_dot(s->part->cg[a] + 3 * i, s->part->cg[b] + 3 * i);
        sum += own;
    }
    return sum;
}

/* Takes from part's r what links with those before it in the order (behind: after it) make of their z; false
 * where there are none. */
static bool take_others(const cn_group *g, const cn_part *part, bool behind, double *r)
{
    const cn_work *work = g->work;
    const int p = (int)(part - work->part);
    const cn_link *link;
    bool any = false;
    for (int nlink = links_of(g, &link); nlink > 0; nlink--, link++) {
        const int side = link->surface[1] == p, other = link->surface[1 - side];
        if (link->surface[side] != p || other == p || other >= work->npart) continue;
        const cn_part *from = &work->part[other];
        if (!from->linked || (from->rank > part->rank) != behind) continue;
        cn_link_push(work, link, side, -link->k * cn_link_along(work, link, 1 - side, from->cg[Z]), r);
        any = true;
    }
    for (int i = 0; any && i < part->body->body->nblock; i++)
        if (part->held[i]) memset(r + 3 * i, 0, 3 * sizeof *r);
    return any;
}

/* z = P^-1 r, P = (D + L) D^-1 (D + L'), with L the links between bodies and D the bodies' matrices in the
 * work's order: of two that stick the softer one's holds the link, to which the other is as fixed; it gives
 * way to that one's matrix without. However stiff the links, P differs from A by no more than the softer body
 * adds to the other (Dirichlet-Neumann; Bjorstad and Widlund 1986). */
static cn_status precondition(const cn_group *g)
{
    cn_work *work = g->work;
    cn_status status = CN_OK;
    for (int i = 0; i < 2 * work->npart && status == CN_OK; i++) {
        const bool back = i >= work->npart;
        cn_part *part = &work->part[work->order[back ? 2 * work->npart - 1 - i : i]];
        const size_t all = 3 * (size_t)part->body->body->nblock;
        double *r = part->cg[Q], *z = part->trial;
        if (!part->linked) continue;
        if (back)
            memset(r, 0, all * sizeof *r), memset(z, 0, all * sizeof *z);
        else
            memcpy(r, part->cg[R], all * sizeof *r);
        if (!take_others(g, part, back, r) && back) continue;
        status = cn_solver_apply(part->solver, r, back ? z : part->cg[Z], work->pool);
        for (size_t k = 0; back && k < all; k++)
            part->cg[Z][k] += z[k];
    }
    return status;
}

/* All linked bodies at once. */
static cn_status solve_linked(const cn_group *g, cn_step_figures *figures)
{
    cn_work *work = g->work;
    double tolerance = fmax(work->model->scene->solver.linear_tolerance, work->forcing);
    cn_status status = CN_OK;
    double rz = 0;
    EACH_STAGE(g, s)
    {
        memset(s->part->dx, 0, 3 * (size_t)s->rows * sizeof(double));
        for (int k = 0; k < 4; k++)
            memset(s->part->cg[k], 0, 3 * (size_t)s->part->body->body->nblock * sizeof(double));
        EACH_FREE(s, i)
        if (!s->part->held[i]) cn_axpy(-1, s->part->gradient + 3 * i, s->part->cg[R] + 3 * i);
    }
    const int condensed = g->strict && cn_wall_take(g) ? cn_wall_part(work->wall) : -1;
    if (condensed >= 0) {
        work->part[condensed].linked = false;
        if ((status = cn_wall_begin(g)) != CN_OK) return status;
    }
    const double bb = dot(g, R, R);
    double rr = bb;
    int done = 0;
    bool bent = true;
    for (; rr > tolerance * tolerance * bb && done < 1000; done++) {
        if ((status = precondition(g)) != CN_OK) return status;
        const double next = dot(g, R, Z), beta = rz > 0 ? next / rz : 0;
        rz = next;
        EACH_STAGE(g, s)
        if (s->part->linked) {
            cn_part *part = s->part;
            for (int i = 0; i < 3 * s->rows; i++)
                part->cg[P][i] = part->cg[Z][i] + beta * part->cg[P][i];
            cn_matrix_multiply(part->matrix, s->rows, part->cg[P], part->cg[Q], work->pool);
        }
        add_links(g, condensed, bent);
        if (condensed >= 0) cn_wall_add(g);
        const double pq = dot(g, P, Q);
        if (!(pq > 0)) {
            if (isnan(pq)) return CN_ERR_NOT_FINITE;
            if (done > 0) { /* as far as it is convex: a descent all the same */
                tolerance = INFINITY;
                break;
            }
            if (!bent) return CN_ERR_SINGULAR;
            bent = false, rz = 0, done = -1;
            continue;
        }
        EACH_STAGE(g, s)
        if (s->part->linked) EACH_FREE(s, i)
            {
                if (s->part->held[i]) continue;
                cn_axpy(rz / pq, s->part->cg[P] + 3 * i, s->part->dx + 3 * i);
                cn_axpy(-rz / pq, s->part->cg[Q] + 3 * i, s->part->cg[R] + 3 * i);
            }
        rr = dot(g, R, R);
    }
    if (condensed >= 0) {
        cn_wall_end(g);
        work->part[condensed].linked = true; /* solved with them */
    }
    figures->linear = done > figures->linear ? done : figures->linear;
    if (rr > tolerance * tolerance * bb) {
        const double residual = sqrt(rr / bb);
        CN_LOG(CN_LOG_WARNING, "bodies in contact: relative residual %.2e after %d iterations", residual,
               done);
        figures->unconverged++, figures->linear_residual = fmax(figures->linear_residual, residual);
    }
    return CN_OK;
}

cn_status cn_stage_solve(const cn_group *g, double *slope, cn_step_figures *figures)
{
    cn_status status = CN_OK;
    const cn_link *link;
    note_links(g);
    if (links_of(g, &link) > 0 && (status = solve_linked(g, figures)) != CN_OK) return status;
    *slope = 0;
    EACH_STAGE(g, s)
    {
        if (!s->part->linked && (status = solve_alone(s, g->work->forcing, figures)) != CN_OK) return status;
        EACH_FREE(s, i)
        *slope += cn_dot(s->part->gradient + 3 * i, s->part->dx + 3 * i);
    }
    return isfinite(*slope) ? CN_OK : CN_ERR_NOT_FINITE;
}
