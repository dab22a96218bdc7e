/* step_touch.c - what a step asks of contact: forces and stiffness where the bodies are, and how far a motion
 * may go. */
#include "step_parts.h"

#include <math.h>
#include <string.h>

static double *body_points(const cn_work *work, int part, double *points)
{
    return points + 3 * (size_t)work->surfaces->surface[part].first;
}

/* Points of a stage's free nodes. */
static int free_points(const cn_stage *s)
{
    return cn_body_points_of(cn_touch_body(s->part->body), s->nfree);
}

void cn_touch_points(const cn_group *g, cn_where at, double *points)
{
    EACH_STAGE(g, s)
    {
        const cn_body *b = cn_touch_body(s->part->body);
        double *own = body_points(g->work, (int)(s - g->stage), points);
        const double *x =
            cn_body_points(b, s->nactive, at == CN_AT_STATE ? s->x : s->part->trial, s->rotation, own);
        if (x != own) memcpy(own, x, 3 * (size_t)b->npoint * sizeof *own);
    }
}

double cn_touch(const cn_group *g, cn_where at, bool stiff, bool exact)
{
    cn_work *work = g->work;
    const double start = cn_step_seconds();
    double *points = at == CN_AT_STATE ? work->points : work->trial;
    cn_touch_points(g, at, points);
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = cn_touch_body(part->body);
        memset(body_points(work, (int)(s - g->stage), work->force), 0,
               3 * (size_t)b->npoint * sizeof *work->force);
        if (part->carry)
            cn_body_carry(b, s->nactive, at == CN_AT_STATE ? s->x : part->trial, s->rotation, part->carry);
    }
    const double energy =
        cn_contact_add(work->surfaces, work->contact, points, work->force, stiff ? work->hang : NULL, exact,
                       work->pool) +
        (work->slip > 0 ? cn_contact_add_friction(work->surfaces, work->contact, points, work->begin,
                                                  work->slip, work->force, stiff ? work->hang : NULL)
                        : 0);
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = cn_touch_body(part->body);
        const double *force = body_points(work, (int)(s - g->stage), work->force);
        if (part->carry)
            cn_body_pull(b, s->nactive, at == CN_AT_STATE ? s->x : part->trial, s->rotation, part->carry,
                         force, part->touch, 1, stiff && exact ? part->matrix : NULL);
        else
            for (int i = 0; i < 3 * s->nfree; i++)
                part->touch[i] += force[i];
    }
    work->collision_s += cn_step_seconds() - start;
    return energy;
}

void cn_touch_note(const cn_group *g, double friction)
{
    cn_work *work = g->work;
    cn_touch_points(g, CN_AT_STATE, work->points);
    cn_contact_note_friction(work->surfaces, work->contact, work->points, friction, work->pool);
}

void cn_touch_overshot(const cn_group *g)
{
    const cn_work *work = g->work;
    if (g->strict && work->slip > 0)
        cn_contact_friction_overshot(work->contact, work->points, work->trial, work->begin, work->slip);
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

void cn_touch_walls(cn_work *work, double fraction)
{
    for (int w = work->npart; work->moving && w < work->surfaces->nsurface; w++) {
        const cn_contact_surface *wall = &work->surfaces->surface[w];
        for (int i = 3 * wall->first; wall->moving && i < 3 * (wall->first + wall->npoint); i++)
            work->trial[i] = work->points[i] + fraction * (work->goal[i] - work->points[i]);
    }
}

void cn_touch_walls_taken(cn_work *work, double fraction)
{
    if (!work->moving) return;
    cn_touch_walls(work, fraction);
    for (int w = work->npart; w < work->surfaces->nsurface; w++) {
        const cn_contact_surface *wall = &work->surfaces->surface[w];
        if (wall->moving)
            memcpy(work->points + 3 * (size_t)wall->first, work->trial + 3 * (size_t)wall->first,
                   3 * (size_t)wall->npoint * sizeof *work->trial);
    }
    work->way_left *= 1 - fraction;
}

/* How the points move when the blocks go from x to x + fraction dx, into work->motion. What a body carries
 * (rods) does not go straight: between two states that are accepted it is taken to. */
static void motion_of(const cn_group *g, double fraction)
{
    cn_work *work = g->work;
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        const cn_body *b = cn_touch_body(part->body);
        const int p = (int)(s - g->stage), n = free_points(s);
        double *motion = body_points(work, p, work->motion);
        if (!part->carry) {
            for (int i = 0; i < 3 * n; i++)
                motion[i] = fraction * part->dx[i];
            continue;
        }
        double *to = body_points(work, p, work->trial);
        const double *from = body_points(work, p, work->points);
        memcpy(part->trial, s->x, 3 * (size_t)b->nblock * sizeof *s->x);
        EACH_FREE(s, i)
        for (int k = 3 * i; k < 3 * i + 3; k++)
            part->trial[k] = s->x[k] + fraction * part->dx[k];
        cn_body_points(b, s->nactive, part->trial, s->rotation, to);
        for (int i = 0; i < 3 * n; i++)
            motion[i] = to[i] - from[i];
    }
    for (int w = work->npart; work->moving && w < work->surfaces->nsurface; w++) {
        const cn_contact_surface *wall = &work->surfaces->surface[w];
        for (int i = 3 * wall->first; wall->moving && i < 3 * (wall->first + wall->npoint); i++)
            work->motion[i] = fraction * (work->goal[i] - work->points[i]);
    }
}

/* Points that take part in the step: the bodies' free ones, then each moving wall's. */
static int point_range(const cn_group *g, int surface)
{
    const cn_contact_surface *own = &g->work->surfaces->surface[surface];
    return surface < g->n ? free_points(&g->stage[surface]) : own->moving ? own->npoint : 0;
}

/* Longest way of a point in the motion; beyond: farthest that one gets from where the pairs were listed. */
static double motion_length(const cn_group *g, double *beyond)
{
    const cn_work *work = g->work;
    double most = 0, far = 0;
    for (int w = 0; w < work->surfaces->nsurface; w++) {
        const size_t first = 3 * (size_t)work->surfaces->surface[w].first;
        const int n = point_range(g, w);
        most = fmax(most, longest(n, work->motion + first));
        for (int i = 0; beyond && i < n; i++) {
            double to[3];
            for (int k = 0; k < 3; k++)
                to[k] = work->points[first + 3 * (size_t)i + (size_t)k] +
                        work->motion[first + 3 * (size_t)i + (size_t)k] -
                        work->contact->from[first + 3 * (size_t)i + (size_t)k];
            far = fmax(far, cn_norm2(to));
        }
    }
    if (beyond) *beyond = sqrt(far);
    return most;
}

static cn_status find(const cn_group *g, const double *motion, double reach)
{
    cn_work *work = g->work;
    for (int p = 0; p < g->n; p++)
        work->nfree[p] = free_points(&g->stage[p]);
    return cn_contact_find(work->surfaces, work->contact, work->nfree, work->points, motion, reach, 0,
                           work->pool);
}

/* A little more is listed, for what the solver adds. */
static double solver_reach(const cn_group *g)
{
    return 2 * g->work->surfaces->gap;
}

cn_status cn_touch_find(const cn_group *g, bool moves)
{
    cn_touch_points(g, CN_AT_STATE, g->work->points);
    return find(g, NULL, moves ? solver_reach(g) : 0);
}

cn_status cn_touch_allowed(const cn_group *g, bool anew, double *fraction)
{
    cn_work *work = g->work;
    cn_contact *contact = work->contact;
    const cn_contact_model *model = work->surfaces;
    const double start = cn_step_seconds();
    cn_status status = CN_OK;
    bool curved = false;
    double fast = 0;
    EACH_STAGE(g, s)
    {
        curved |= s->part->carry != NULL;
        fast = fmax(fast, s->h * longest(s->nfree, s->from->v));
    }
    cn_touch_points(g, CN_AT_STATE, work->points);
    if (!anew && !contact->anchored) cn_contact_anchor(model, contact, work->points, work->pool);
    for (int tries = 0;; tries++) {
        double far = 0;
        motion_of(g, *fraction);
        double most = motion_length(g, anew ? NULL : &far);
        if (anew || far > contact->reach) {
            const double cap = fmax(20 * model->gap, 2 * fast);
            if (!anew && most > cap) *fraction *= cap / most, motion_of(g, *fraction);
            if ((status = find(g, work->motion, solver_reach(g))) != CN_OK) break;
        }
        most = cn_contact_motion(model, contact, work->points, work->motion, 0.2, work->pool);
        if (!curved) *fraction *= most;
        if (!curved || most >= 1) break;
        *fraction = tries < 40 ? 0.9 * most * *fraction : 0;
        if (*fraction == 0) break;
    }
    work->collision_s += cn_step_seconds() - start;
    return status;
}

enum { SLICES = 16 };

/* Middles of a slender body's slices across its longest side at rest, as they lie now; 0 where a slice
 * reaches out at rest by more than the body is thick: it is bent already, or has limbs. */
static int slices(const cn_model_body *body, const double *x, double middle[SLICES][3])
{
    const cn_body *b = body->body;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double rest[SLICES][3] = {{0}};
    int count[SLICES] = {0}, along = 0, n = 0;
    for (int i = 0; i < 3 * b->nnode; i++)
        low[i % 3] = fmin(low[i % 3], b->rest[i]), high[i % 3] = fmax(high[i % 3], b->rest[i]);
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[along] - low[along]) along = k;
    const double each = SLICES / (high[along] - low[along]);
    memset(middle, 0, SLICES * sizeof *middle);
    for (int round = 0; round < 2; round++)
        for (int i = 0; i < b->nnode; i++) {
            const int at = (int)(each * (b->rest[3 * i + along] - low[along])),
                      slice = at < SLICES ? at : at - 1;
            if (round) {
                if (cn_distance(b->rest + 3 * i, rest[slice]) > 0.125 * body->size) return 0;
                continue;
            }
            count[slice]++;
            for (int k = 0; k < 3; k++) { /* running means */
                rest[slice][k] += (b->rest[3 * i + k] - rest[slice][k]) / count[slice];
                middle[slice][k] += (x[3 * i + k] - middle[slice][k]) / count[slice];
            }
        }
    for (int i = 0; i < SLICES; i++)
        if (count[i]) cn_copy3(middle[i], middle[n++]);
    return n;
}

/* By how much a line of points turns at point i. */
static double turn_at(const double *x, int i)
{
    double before[3], ahead[3], cross[3];
    cn_sub(x + 3 * i, x + 3 * i - 3, before), cn_sub(x + 3 * i + 3, x + 3 * i, ahead);
    cn_cross(before, ahead, cross);
    return atan2(cn_norm(cross), cn_dot(before, ahead));
}

/* Least distance of places between which the line turns by three quarters of half a circle. */
static double bend_distance(int n, const double *x, double longest_side)
{
    const double most = 0.75 * acos(-1.0);
    double least = INFINITY, sum = 0; /* between i and j */
    for (int i = 0, j = 1; i < n; i++) {
        if (j <= i) j = i + 1, sum = 0;
        while (sum < most && ++j < n)
            sum += turn_at(x, j - 1);
        if (j >= n) break;
        for (int k = j; k < n;) {
            const double d = cn_distance(x + 3 * i, x + 3 * k);
            least = fmin(least, d);
            k += d - least > longest_side ? (int)((d - least) / longest_side) : 1;
        }
        if (j > i + 1) sum -= turn_at(x, i + 1);
    }
    return least;
}

double cn_fold_room(const cn_model_body *body, const cn_body_state *state, double *axis)
{
    const double *x = state->x;
    const bool slender = body->catheter || body->body->model == CN_BODY_ROD;
    double turn = 0, side = 0, middle[SLICES][3];
    int n = state->nfree;
    if (body->catheter) {
        cn_axis_points(body, state, &n, axis);
        x = axis;
    } else if (!slender) {
        if (!body->self || (n = slices(body, state->x, middle)) < 3) return 0;
        x = middle[0];
    }
    for (int i = 1; i < n; i++) {
        const double before = cn_distance(x + 3 * i, x + 3 * i - 3);
        side = fmax(side, before);
        if (i + 1 == n) break;
        const double angle = turn_at(x, i);
        if (!(angle * body->diameter < fmin(before, cn_distance(x + 3 * i + 3, x + 3 * i)))) return 0;
        turn += angle;
    }
    if (turn <= acos(-1.0)) return INFINITY;
    return slender ? fmax(0, bend_distance(n, x, side) - side - 2 * body->diameter) : 0;
}
