/* step_penalty.c - springs of `penalty` in a step. What penetrates is found where the step begins (walls that
 * move where they go to), and each push is a spring on a node that acts as long as it is still inside,
 * k/2 max(0, depth - n . J (x - x0))^2 , J = I; of a point that hangs on several nodes J says how, where the
 * step begins, and the force returns to them by J'. It is solved with the rest of the step: stable for any k.
 * Left to itself a node comes out by k / (k + m/h^2) of its depth in a step, so at no more than depth / h,
 * the speed it came in with. k is the scene's, or m/h^2 + a tenth of the stiffness of the body's elements:
 * the first lets what is free out, by half in a step, the second holds against a body that is pressed on. */
#include "molecules.h"
#include "step_parts.h"

#include <math.h>
#include <string.h>

/* Whether a spring acts on what hangs on several nodes, else on its node. */
static bool hangs(const cn_part *part)
{
    return part->carry && part->carry->nper > 0;
}

static double stiffness_of(const cn_stage *s, int node)
{
    const cn_body *b = s->part->body->body;
    const double given = s->part->model->scene->contact.stiffness;
    return isnan(given) ? b->mass[node] / (s->h * s->h) + 0.1 * b->spring : given;
}

cn_status cn_stage_penetrations(const cn_group *g)
{
    cn_work *work = g->work;
    const double start = cn_step_seconds();
    cn_touch_points(g, CN_AT_STATE, work->points);
    EACH_STAGE(g, s)
    if (hangs(s->part))
        cn_body_carry(cn_touch_body(s->part->body), s->nactive, s->x, s->rotation, s->part->carry);
    for (int p = 0; p < g->n; p++)
        work->nfree[p] = cn_body_points_of(cn_touch_body(g->stage[p].part->body), g->stage[p].nfree);
    const cn_status status = cn_penalty_find(work->penalty, work->nfree, work->points, work->pool);
    work->collision_s += cn_step_seconds() - start;
    return status;
}

/* What is left of a spring's depth. */
static double left_of(const cn_stage *s, const cn_penalty_spring *spring, cn_where at)
{
    const double *x = at == CN_AT_STATE ? s->x : s->part->trial;
    double u[3], before[3];
    if (hangs(s->part)) {
        cn_point_motion(s->part, spring->point, x, u);
        cn_point_motion(s->part, spring->point, s->from->x, before);
        cn_axpy(-1, before, u);
    } else
        cn_sub(x + 3 * spring->node, s->from->x + 3 * spring->node, u);
    return fmax(0, spring->depth - cn_dot(spring->n, u));
}

/* k n n' of a spring: to its node's block, or as a link where the matrix does not take it. */
static void stiffen(const cn_group *g, const cn_penalty_spring *spring, double k)
{
    cn_penalty *penalty = g->work->penalty;
    const cn_part *part = g->stage[spring->surface].part;
    if (g->work->hang[spring->surface].linked) {
        cn_link *link = &penalty->link[penalty->nlink++];
        const int none = g->work->surfaces->nsurface; /* nothing that gives way */
        *link = (cn_link){.surface = {spring->surface, none}, .nside = 1, .w = {1}, .k = k};
        link->p[0] = g->work->surfaces->surface[spring->surface].first + spring->point;
        cn_copy3(spring->n, link->n);
        return;
    }
    double *block = part->matrix->value + 9 * (size_t)part->matrix->diagonal[spring->node];
    for (int r = 0; r < 9; r++)
        block[r] += k * spring->n[r / 3] * spring->n[r % 3];
}

static void push(const cn_stage *s, const cn_penalty_spring *spring, double by, double *f)
{
    double force[3] = {0, 0, 0};
    cn_axpy(by, spring->n, force);
    if (hangs(s->part))
        cn_point_force(s->part, spring->point, force, f);
    else
        cn_axpy(1, force, f + 3 * spring->node);
}

double cn_stage_add_penalty(const cn_group *g, cn_where at, bool stiff)
{
    cn_penalty *penalty = g->work->penalty;
    double energy = 0;
    if (stiff) penalty->nlink = 0;
    for (int i = 0; i < penalty->nspring; i++) {
        const cn_penalty_spring *spring = &penalty->spring[i];
        const cn_stage *s = &g->stage[spring->surface];
        const double left = left_of(s, spring, at), k = stiffness_of(s, spring->node);
        if (!(left > 0)) continue;
        energy += 0.5 * k * left * left;
        push(s, spring, k * left, s->part->touch);
        if (stiff) stiffen(g, spring, k);
    }
    return energy;
}

void cn_stage_press(const cn_group *g, int p, const double *v, double *f)
{
    const cn_penalty *penalty = g->work->penalty;
    const cn_stage *s = &g->stage[p];
    for (int i = 0; i < penalty->nspring; i++) {
        const cn_penalty_spring *spring = &penalty->spring[i];
        const double left = spring->surface == p ? left_of(s, spring, CN_AT_STATE) : 0;
        double speed[3];
        if (!(left > 0)) continue;
        const double k = stiffness_of(s, spring->node), m = s->part->body->body->mass[spring->node];
        if (hangs(s->part))
            cn_point_motion(s->part, spring->point, v, speed);
        else
            cn_copy3(v + 3 * spring->node, speed);
        push(s, spring, fmax(0, k * left - 2 * sqrt(k * m) * cn_dot(spring->n, speed)), f);
    }
}

void cn_stage_press_bound(const cn_group *g, int p, double *scratch, struct cn_press *press)
{
    const cn_penalty *penalty = g->work->penalty;
    const cn_stage *s = &g->stage[p];
    const cn_body *b = s->part->body->body;
    double *const stiff = scratch, *const damp = scratch + b->nnode;
    double square = 0, friction = 0;
    memset(scratch, 0, 2 * (size_t)b->nnode * sizeof *scratch);
    for (int i = 0; i < penalty->nspring; i++) { /* (sum w u)^2 <= sum |w| * sum |w| u^2 */
        const cn_penalty_spring *spring = &penalty->spring[i];
        if (spring->surface != p) continue;
        const cn_carry *carry = s->part->carry;
        const int per = hangs(s->part) ? carry->nper : 1;
        const size_t at = (size_t)spring->point * (size_t)per;
        const double k = stiffness_of(s, spring->node), c = 2 * sqrt(k * b->mass[spring->node]);
        double all = per > 1 ? 0 : 1;
        for (int j = 0; per > 1 && j < per; j++)
            all += fabs(carry->weight[at + (size_t)j]);
        for (int j = 0; j < per; j++) {
            const int node = per > 1 ? carry->anchor[at + (size_t)j] : spring->node;
            const double share = per > 1 ? all * fabs(carry->weight[at + (size_t)j]) : 1;
            stiff[node] += k * share, damp[node] += c * share;
        }
    }
    for (int i = 0; i < b->nnode; i++)
        square = fmax(square, stiff[i] / b->mass[i]), friction = fmax(friction, damp[i] / b->mass[i]);
    press->square += square, press->friction += friction;
}

/* Sum of the forces of surface b on body a. */
static void force_between(const cn_group *g, int a, int b, double force[3])
{
    const cn_penalty *penalty = g->work->penalty;
    for (int i = 0; i < penalty->nspring; i++) {
        const cn_penalty_spring *spring = &penalty->spring[i];
        const cn_stage *s = &g->stage[a];
        if (spring->surface != a || spring->other != b) continue;
        cn_axpy(stiffness_of(s, spring->node) * left_of(s, spring, CN_AT_STATE), spring->n, force);
    }
}

void cn_stage_penalty_figures(const cn_group *g, double dt, cn_step_figures *figures)
{
    for (int a = 0; a < g->n; a++)
        for (int b = 0; b < g->work->surfaces->nsurface; b++) {
            double force[3] = {0, 0, 0};
            if (a == b) continue;
            force_between(g, a, b, force);
            figures[a].wall_force = fmax(figures[a].wall_force, cn_norm(force));
            if (b <= a || b >= g->n) continue;
            force_between(g, b, a, force);
            figures->momentum_error += dt * cn_norm(force);
        }
}
