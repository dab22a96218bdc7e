/* step_ahead.c - motions along circles: where a stage's iteration begins, as far as the velocity leads, and
 * its directions; a straight line would stretch what turns. */
#include "polar.h"
#include "rod_spin.h"
#include "step_parts.h"

#include <math.h>
#include <string.h>

/* A slice of a body, which turns as one. */
typedef struct {
    const int *node, *end;
    double way[3], turn[3]; /* by dx: of its centre; a rotation vector */
    double mass;
} slice;

/* What turns farther goes straight on [rad]: no series reaches so far, and what seems to turn may be torn. */
static const double FAR = 0.5;

/* The rotation nearest to what took the slice from x - dx to x (Kabsch 1976, by masses); of a rod's station
 * its own. A chord goes on by all of it, a tangent by half. */
static bool slice_of(const cn_stage *s, int index, bool chord, slice *p)
{
    const cn_body *b = s->part->body->body;
    const double *dx = s->part->dx;
    const double one[4] = {1, 0, 0, 0};
    double centre[3] = {0, 0, 0}, both[9] = {0}, q[4], size[3];
    *p = (slice){.node = s->part->node + s->part->slice[index],
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
static void lead(const slice *p, const double way[3], double *dx)
{
    double r[9];
    cn_rotation(p->turn, r);
    for (const int *i = p->node; i < p->end; i++) {
        double apart[3], turned[3];
        cn_sub(dx + 3 * *i, p->way, apart);
        cn_mat_vec(r, apart, turned);
        cn_add(way, turned, dx + 3 * *i);
    }
}

/* Slices from `last`, which goes as it does, to the end on one side, each joint turned along with both of its
 * slices; adds momentum gained and mass. */
static void lead_side(const cn_stage *s, slice last, int from, int side, int n, bool chord, double gained[3],
                      double *mass)
{
    double way[3];
    cn_copy3(last.way, way);
    for (int j = from + side; j >= 0 && j < n; j += side) {
        slice next;
        double joint[3], middle[3], r[9], turned[3];
        slice_of(s, j, chord, &next);
        cn_sub(next.way, last.way, joint);
        for (int k = 0; k < 3; k++)
            middle[k] = 0.5 * (last.turn[k] + next.turn[k]);
        cn_rotation(middle, r);
        cn_mat_vec(r, joint, turned);
        cn_axpy(1, turned, way);
        lead(&next, way, s->part->dx);
        for (int k = 0; k < 3; k++)
            gained[k] += next.mass * (way[k] - next.way[k]);
        *mass += next.mass;
        last = next;
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

    slice start;
    for (int j = 0; j < n; j++)
        if (!slice_of(s, j, chord, &start)) return; /* all of it or nothing */
    double gained[3] = {0, 0, 0}, mass = 0;
    slice_of(s, low, chord, &start);
    lead_side(s, start, low, -1, n, chord, gained, &mass);
    if (!nheld) lead(&start, start.way, part->dx);
    mass += start.mass;
    if (high > low) slice_of(s, high, chord, &start);
    lead_side(s, start, high, 1, n, chord, gained, &mass);
    for (int i = 0; loose && i < s->nfree; i++)
        cn_axpy(-1 / mass, gained, part->dx + 3 * i);
}

void cn_stage_lead(const cn_group *g, bool chord)
{
    EACH_STAGE(g, s)
    if (!s->part->model->single && !s->part->sheet) lead_body(s, chord);
}
