/* step_ahead.c - motions along circles: where a stage's iteration begins, as far as the velocity leads, and
 * its directions; a straight line would stretch what turns. */
#include "polar.h"
#include "rod_spin.h"
#include "step_parts.h"

#include <math.h>
#include <string.h>

/* What turns farther goes straight on [rad]: no series reaches so far, and what seems to turn may be torn. */
static const double FAR = 0.5;

/* The rotation nearest to what took the slice from x - dx to x (Kabsch 1976, by masses); of a rod's station
 * its own. A chord goes on by all of it, a tangent by half. */
static bool slice_of(const cn_stage *s, int index, bool chord, cn_slice *p)
{
    const cn_body *b = s->part->body->body;
    const double *dx = s->part->dx;
    const double one[4] = {1, 0, 0, 0};
    double centre[3] = {0, 0, 0}, both[9] = {0}, q[4], size[3];
    *p = (cn_slice){.node = s->part->node + s->part->slice[index],
                    .end = s->part->node + s->part->slice[index + 1]};
    while (p->end > p->node && p->end[-1] >= s->nfree)
        p->end--;
    for (const int *i = p->node; i < p->end; i++) {
        cn_axpy(b->mass[*i], s->x + 3 * *i, centre), cn_axpy(b->mass[*i], dx + 3 * *i, p->way);
        p->mass += b->mass[*i];
    }
    if (!(p->mass > 0)) return false;
    for (int k = 0; k < 3; k++)
        centre[k] /= p->mass, p->way[k] /= p->mass;
    if (b->nblock > b->nnode) {
        cn_copy3(dx + 3 * (b->nnode + *p->node), p->turn);
    } else {
        for (const int *i = p->node; i < p->end; i++) {
            double now[3], before[3];
            cn_sub(s->x + 3 * *i, centre, now);
            for (int k = 0; k < 3; k++)
                before[k] = now[k] - (dx[3 * *i + k] - p->way[k]);
            for (int k = 0; k < 9; k++)
                both[k] += b->mass[*i] * now[k / 3] * before[k % 3];
        }
        cn_polar_values(both, q, size);
        if (size[1] > 1e-9 * size[0])
            cn_spin_between(one, q, p->turn); /* a line shows no turn about itself */
    }
    if (!(cn_norm(p->turn) < FAR)) return false;
    for (int k = 0; k < 3; k++)
        p->turn[k] *= chord ? 1 : 0.5;
    return true;
}

/* Its nodes go `way`, and turn about that. */
static void lead(const cn_slice *p, const double way[3], double *dx)
{
    double r[9];
    if (p->end - p->node == 1) {
        cn_copy3(way, dx + 3 * *p->node);
        return;
    }
    cn_rotation(p->turn, r);
    for (const int *i = p->node; i < p->end; i++) {
        double apart[3], turned[3];
        cn_sub(dx + 3 * *i, p->way, apart);
        cn_mat_vec(r, apart, turned);
        cn_add(way, turned, dx + 3 * *i);
    }
}

/* Slices beside `from`, which goes as it does, to the end on one side, each joint turned along with both of
 * its slices; adds momentum gained and mass. */
static void lead_side(const cn_part *part, int from, int side, int n, double gained[3], double *mass)
{
    double way[3];
    cn_copy3(part->led[from].way, way);
    for (int j = from + side; j >= 0 && j < n; j += side) {
        const cn_slice *next = &part->led[j], *last = next - side;
        double joint[3], middle[3], r[9], turned[3];
        cn_sub(next->way, last->way, joint);
        for (int k = 0; k < 3; k++)
            middle[k] = 0.5 * (last->turn[k] + next->turn[k]);
        cn_rotation(middle, r);
        cn_mat_vec(r, joint, turned);
        cn_axpy(1, turned, way);
        lead(next, way, part->dx);
        for (int k = 0; k < 3; k++)
            gained[k] += next->mass * (way[k] - next->way[k]);
        *mass += next->mass;
    }
}

/* Outwards from the slices that are held, or from a sheath; a body that nothing holds keeps its momentum. */
static void lead_body(const cn_stage *s, bool chord)
{
    const cn_part *part = s->part;
    int n = 0, low = -1, high = -1, nheld = 0;
    for (; n < part->nslice && part->node[part->slice[n]] < s->nfree; n++) {
        bool held = false;
        for (int i = part->slice[n]; i < part->slice[n + 1]; i++)
            held |= part->node[i] < s->nfree && part->body->fixed[part->node[i]];
        if (!held) continue;
        if (!nheld++) low = n;
        high = n;
    }
    const bool sheathed = s->nfree < part->body->body->nnode, loose = !nheld && !sheathed;
    if (n == 0 || (nheld && (sheathed || high - low + 1 != nheld))) return;
    if (!nheld) low = high = sheathed ? n - 1 : 0;

    for (int j = 0; j < n; j++)
        if (!slice_of(s, j, chord, &part->led[j])) return; /* all of it or nothing */
    double gained[3] = {0, 0, 0}, mass = part->led[low].mass;
    lead_side(part, low, -1, n, gained, &mass);
    if (!nheld) lead(&part->led[low], part->led[low].way, part->dx);
    lead_side(part, high, 1, n, gained, &mass);
    for (int i = 0; loose && i < s->nfree; i++)
        cn_axpy(-1 / mass, gained, part->dx + 3 * i);
}

void cn_stage_lead(const cn_group *g, bool chord)
{
    EACH_STAGE(g, s)
    if (!s->part->model->single && !s->part->sheet) lead_body(s, chord);
}
