/* contact_motion.c - distances of the listed pairs, and the motion they allow. */
#include "contact_parts.h"

#include <math.h>
#include <stddef.h>
#include "geometry.h"

enum { CHUNK = 64 }; /* pairs a task; fixed, so that results do not depend on the threads */

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const double *x, *dx;
    double keep;
    bool all; /* measure every pair, however far */
} pass;

static int chunks(const cn_contact *contact)
{
    return (contact->npair + CHUNK - 1) / CHUNK;
}

static void points_of(const cn_pair *pair, const double *x, double q[4][3])
{
    for (int i = 0; i < 4; i++)
        cn_copy3(x + 3 * (size_t)pair->p[i], q[i]);
}

static void measure_chunk(void *user, int chunk)
{
    const pass *p = user;
    cn_contact *contact = p->contact;
    const int end = chunk * CHUNK + CHUNK < contact->npair ? chunk * CHUNK + CHUNK : contact->npair;
    for (int i = chunk * CHUNK; i < end; i++) {
        const cn_pair *pair = &contact->pair[i];
        double q[4][3];
        const double lower = pair->found - cn_pair_motion(p->model, pair, p->x, contact->from, q);
        if (!p->all && lower > contact->gap_listed) {
            contact->distance[i] = lower;
            continue;
        }
        points_of(pair, p->x, q);
        contact->distance[i] = pair->kind == CN_PAIR_EDGES ? cn_edge_edge(q[0], q[1], q[2], q[3], NULL, NULL)
                                                           : cn_point_triangle(q[0], q[1], q[2], q[3], NULL);
    }
}

void cn_contact_measure(const cn_contact_model *model, cn_contact *contact, const double *x, bool all,
                        cn_pool *pool)
{
    pass p = {.model = model, .contact = contact, .x = x, .all = all};
    cn_pool_run(pool, chunks(contact), measure_chunk, &p);
}

void cn_contact_anchor(const cn_contact_model *model, cn_contact *contact, const double *x, cn_pool *pool)
{
    cn_contact_measure(model, contact, x, true, pool);
    for (int i = 0; i < contact->npair; i++)
        contact->pair[i].found = contact->distance[i];
    cn_contact_note(model, contact->from, x);
    contact->anchored = true;
}

double cn_contact_least(const cn_contact *contact, int surface)
{
    double least = INFINITY;
    for (int i = 0; i < contact->npair; i++) {
        const cn_pair *pair = &contact->pair[i];
        if (surface >= 0 && pair->surface[0] != surface && pair->surface[1] != surface) continue;
        if (pair->surface[0] == pair->surface[1] && !(contact->distance[i] < pair->gap)) continue;
        least = contact->distance[i] < least ? contact->distance[i] : least;
    }
    return least;
}

bool cn_contact_touches(const cn_contact *contact)
{
    for (int i = 0; i < contact->npair; i++)
        if (contact->distance[i] < contact->pair[i].gap) return true;
    return false;
}

/* Each chunk notes the largest fraction its pairs allow. */
static void motion_chunk(void *user, int chunk)
{
    const pass *p = user;
    cn_contact *contact = p->contact;
    const int end = chunk * CHUNK + CHUNK < contact->npair ? chunk * CHUNK + CHUNK : contact->npair;
    double most = 1;
    for (int i = chunk * CHUNK; i < end; i++) {
        const cn_pair *pair = &contact->pair[i];
        double q[4][3], dq[4][3];
        const double travel = cn_pair_motion(p->model, pair, p->dx, NULL, dq);
        if (contact->distance[i] * (1 - p->keep) > travel) continue;
        points_of(pair, p->x, q);
        const double gap = p->keep * contact->distance[i];
        const double time = pair->kind == CN_PAIR_EDGES
                                ? cn_ccd_edge_edge((const double(*)[3])q, (const double(*)[3])dq, gap)
                                : cn_ccd_point_triangle((const double(*)[3])q, (const double(*)[3])dq, gap);
        most = time < most ? time : most;
    }
    contact->limit[chunk] = most;
}

double cn_contact_motion(const cn_contact_model *model, cn_contact *contact, const double *x,
                         const double *dx, double keep, cn_pool *pool)
{
    pass p = {.model = model, .contact = contact, .x = x, .dx = dx, .keep = keep};
    double most = 1;
    cn_contact_measure(model, contact, x, false, pool);
    cn_pool_run(pool, chunks(contact), motion_chunk, &p);
    for (int c = 0; c < chunks(contact); c++)
        most = contact->limit[c] < most ? contact->limit[c] : most;
    return most;
}
