/* step_penalty.c - springs of `penalty` in a step. What penetrates is found where the step begins (walls that
 * move where they go to), and each push is a spring on its node that acts as long as the node is still
 * inside, k/2 max(0, depth - n . (x - x0))^2 , solved with the rest of the step: stable for any k. Left to
 * itself a node comes out by k / (k + m/h^2) of its depth in a step, so at no more than depth / h, the speed
 * it came in with. k is the scene's, or m/h^2 + a tenth of the stiffness of the body's elements: the first
 * lets what is free out, by half in a step, the second holds against a body that is pressed on. */
#include "step_parts.h"

#include <math.h>
#include <string.h>

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
    for (int p = 0; p < g->n; p++)
        work->nfree[p] = cn_body_points_of(g->stage[p].part->body->body, g->stage[p].nfree);
    const cn_status status = cn_penalty_find(work->penalty, work->nfree, work->points, work->pool);
    work->collision_s += cn_step_seconds() - start;
    return status;
}

/* What is left of a spring's depth. */
static double left_of(const cn_stage *s, const cn_penalty_spring *spring, cn_where at)
{
    double u[3];
    cn_sub((at == CN_AT_STATE ? s->x : s->part->trial) + 3 * spring->node, s->from->x + 3 * spring->node, u);
    return fmax(0, spring->depth - cn_dot(spring->n, u));
}

double cn_stage_add_penalty(const cn_group *g, cn_where at, bool stiff)
{
    const cn_penalty *penalty = g->work->penalty;
    double energy = 0;
    for (int i = 0; i < penalty->nspring; i++) {
        const cn_penalty_spring *spring = &penalty->spring[i];
        const cn_stage *s = &g->stage[spring->surface];
        const double left = left_of(s, spring, at), k = stiffness_of(s, spring->node);
        if (!(left > 0)) continue;
        energy += 0.5 * k * left * left;
        cn_axpy(k * left, spring->n, s->part->touch + 3 * spring->node);
        double *block = s->part->matrix->value + 9 * (size_t)s->part->matrix->diagonal[spring->node];
        for (int r = 0; stiff && r < 9; r++)
            block[r] += k * spring->n[r / 3] * spring->n[r % 3];
    }
    return energy;
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
