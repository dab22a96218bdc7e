/* step_bounce.c - restitution: what contact gives back of the speed at which it was met.
 *
 * Where a pair presses at the end of a step in whose beginning it approached at speed s, its normal velocity
 * becomes e s (Moss et al. 2008, 4.4). Impulses J >= 0 along the pairs' normals do it, equal and opposite on
 * the two sides, a rigid one's on the body alone; each body takes them as it takes forces in the step,
 *     (M + h^2 K) dv = W' J,  W (v + dv) = e s,
 * so that a stiff body bounces as a whole and in a soft one the nodes that touch. The J solve W (M + h^2
 * K)^-1 W' J = e s - W v, by conjugate gradients; those that would pull are left out. Positions stay as they
 * are. */
#include "step_parts.h"

#include <math.h>
#include <string.h>

enum { IMPULSE, LEFT, TOWARDS, BACK }; /* of cn_rub's scratch */

/* Relative velocity along the normal of a link, of blocks' velocities in cg[which] of each part. */
static double speed_of(const cn_work *work, const cn_link *link, int which)
{
    double speed = 0;
    for (int i = 0; i < 4; i++) {
        const int surface = link->surface[i >= link->nside];
        double v[3];
        if (surface >= work->npart) continue;
        cn_point_motion(&work->part[surface], link->p[i] - work->surfaces->surface[surface].first,
                        work->part[surface].cg[which], v);
        speed += link->w[i] * cn_dot(link->n, v);
    }
    return speed;
}

/* The same of walls that move. */
static double wall_speed(const cn_work *work, const cn_link *link, double h)
{
    double speed = 0;
    for (int i = 0; i < 4; i++) {
        const int surface = link->surface[i >= link->nside];
        double d[3];
        if (surface < work->npart) continue;
        cn_sub(work->points + 3 * (size_t)link->p[i], work->begin + 3 * (size_t)link->p[i], d);
        speed += link->w[i] * cn_dot(link->n, d) / h;
    }
    return speed;
}

/* cg[1] = (M/h^2 + K)^-1 W' (scratch `which` of the pairs), with the factors at hand. */
static cn_status answer(const cn_group *g, int which)
{
    const cn_work *work = g->work;
    EACH_STAGE(g, s)
    for (int k = 0; k < 2; k++)
        memset(s->part->cg[k], 0, 3 * (size_t)s->part->body->body->nblock * sizeof(double));
    for (int l = 0; l < work->contact->nrub; l++) {
        const cn_rub *rub = &work->contact->rub[l];
        for (int i = 0; i < 4 && rub->stops; i++) {
            const int surface = rub->link.surface[i >= rub->link.nside];
            double f[3] = {0, 0, 0};
            if (surface >= work->npart) continue;
            cn_axpy(rub->link.w[i] * rub->scratch[which], rub->link.n, f);
            cn_point_force(&work->part[surface], rub->link.p[i] - work->surfaces->surface[surface].first, f,
                           work->part[surface].cg[0]);
        }
    }
    EACH_STAGE(g, s)
    {
        const cn_status status = cn_solver_solve(s->part->solver, s->part->cg[0], s->part->cg[1], 1e-10, 1000,
                                                 NULL, NULL, s->part->pool);
        if (status != CN_OK && status != CN_ERR_CONVERGENCE) return status;
    }
    return CN_OK;
}

#define EACH_RUB(contact, r)                                                                                 \
    for (cn_rub *r = (contact)->rub; r < (contact)->rub + (contact)->nrub; r++)                              \
        if (r->stops)

/* Impulses of the pairs that take part (rub->stops), for the changes of speed in link.k. */
static cn_status impulses(const cn_group *g)
{
    cn_contact *contact = g->work->contact;
    cn_status status;
    double rr = 0, asked = 0;
    EACH_RUB(contact, r)
    {
        r->scratch[IMPULSE] = 0, r->scratch[LEFT] = r->scratch[TOWARDS] = r->link.k;
        rr += r->link.k * r->link.k;
    }
    asked = rr;
    for (int done = 0; rr > 1e-16 * asked && done < 500; done++) {
        double along = 0, next = 0;
        if ((status = answer(g, TOWARDS)) != CN_OK) return status;
        EACH_RUB(contact, r)
        {
            r->scratch[BACK] = speed_of(g->work, &r->link, 1);
            along += r->scratch[TOWARDS] * r->scratch[BACK];
        }
        if (!(along > 0)) return isnan(along) ? CN_ERR_NOT_FINITE : CN_OK;
        EACH_RUB(contact, r)
        {
            r->scratch[IMPULSE] += rr / along * r->scratch[TOWARDS];
            r->scratch[LEFT] -= rr / along * r->scratch[BACK];
            next += r->scratch[LEFT] * r->scratch[LEFT];
        }
        EACH_RUB(contact, r)
        r->scratch[TOWARDS] = r->scratch[LEFT] + next / rr * r->scratch[TOWARDS];
        rr = next;
    }
    return CN_OK;
}

/* Pairs that press and approached faster than gravity alone makes what rests: the change of speed each asks
 * for. */
static bool asks(const cn_group *g)
{
    const cn_work *work = g->work;
    const double h = g->stage->h, e = work->model->scene->contact.restitution;
    const double rests = cn_norm(work->model->gravity) * h;
    bool any = false;
    EACH_STAGE(g, s)
    {
        memcpy(s->part->cg[0], s->from->v, 3 * (size_t)s->part->body->body->nblock * sizeof(double));
        for (int i = 0; i < 3 * s->part->body->body->nblock; i++)
            s->part->cg[1][i] = s->part->u[i] / h;
    }
    for (int l = 0; l < work->contact->nrub; l++) {
        cn_rub *rub = &work->contact->rub[l];
        const double wall = wall_speed(work, &rub->link, h);
        const double before = speed_of(work, &rub->link, 0) + wall,
                     now = speed_of(work, &rub->link, 1) + wall;
        rub->link.k = -e * before - now;
        rub->stops = before < -rests && rub->link.k > 0;
        any |= rub->stops;
    }
    return any;
}

cn_status cn_stage_bounce(const cn_group *g)
{
    cn_work *work = g->work;
    cn_status status;
    bool pulls = true;
    EACH_STAGE(g, s)
    memset(s->part->ahead, 0, 3 * (size_t)s->part->body->body->nblock * sizeof(double));
    cn_touch_note(g, 1);
    if (!asks(g)) return CN_OK;
    cn_stage_assemble(g);
    if ((status = cn_stage_factor(g)) != CN_OK) return status;
    while (pulls) {
        if ((status = impulses(g)) != CN_OK) return status;
        pulls = false;
        EACH_RUB(work->contact, r)
        if (r->scratch[IMPULSE] < 0) pulls = true, r->stops = false;
    }
    if ((status = answer(g, IMPULSE)) != CN_OK) return status;
    EACH_STAGE(g, s)
    memcpy(s->part->ahead, s->part->cg[1], 3 * (size_t)s->part->body->body->nblock * sizeof(double));
    return CN_OK;
}
