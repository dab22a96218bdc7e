/* contact_friction.c - Coulomb friction, lagged (Li et al., Incremental Potential Contact, 2020): where the
 * barrier presses with N at the points' weights w and normal n, all held as last noted, the pair's sliding
 *     u = (1 - n n') sum w_i (x_i - start_i)
 * since the start of the step has the potential mu N f0(|u|), f0' = f1: 2 y / slip - (y / slip)^2 up to slip,
 * 1 beyond. Its force is at most mu N, against the sliding, and sums to nothing over the pair. */
#include "contact_parts.h"

#include <stddef.h>

/* One that is to stop is led there: its force rises in proportion to what is left, from this times its bound,
 * in place of being constant. From once its bound the force is the true one, and the parabola bounds the
 * potential from above: slow, but never uphill. */
static const double LEAD = 100;

void cn_contact_note_friction(const cn_contact_model *model, cn_contact *contact, const double *x,
                              double friction, cn_pool *pool)
{
    cn_contact_measure(model, contact, x, false, pool);
    contact->nrub = 0, contact->lead = LEAD;
    for (int i = 0; i < contact->npair; i++) {
        const cn_pair *pair = &contact->pair[i];
        cn_rub *rub = &contact->rub[contact->nrub];
        cn_link *link = &rub->link;
        if (!(contact->distance[i] < pair->gap) || !cn_pair_press(model, pair, x, link->w, link->n, &link->k))
            continue;
        rub->stops = false;
        link->bend = 0;
        link->k *= friction, link->nside = cn_pair_nside(pair);
        memcpy(link->p, pair->p, sizeof link->p);
        memcpy(link->surface, pair->surface, sizeof link->surface);
        contact->nrub++;
    }
}

static void sliding(const cn_link *link, const double *x, const double *start, double u[3])
{
    u[0] = u[1] = u[2] = 0;
    for (int k = 0; k < 4; k++) {
        double moved[3];
        cn_sub(x + 3 * (size_t)link->p[k], start + 3 * (size_t)link->p[k], moved);
        cn_axpy(link->w[k], moved, u);
    }
    cn_axpy(-cn_dot(u, link->n), link->n, u);
}

void cn_contact_friction_overshot(cn_contact *contact, const double *x, const double *to, const double *start,
                                  double slip)
{
    for (int i = 0; i < contact->nrub; i++) {
        double before[3], after[3];
        sliding(&contact->rub[i].link, x, start, before), sliding(&contact->rub[i].link, to, start, after);
        contact->rub[i].stops |= cn_dot(before, after) < 0 && cn_norm(before) > slip;
    }
}

bool cn_contact_friction_gently(cn_contact *contact)
{
    bool any = false;
    for (int i = 0; i < contact->nrub; i++)
        any |= contact->rub[i].stops;
    if (!any || contact->lead <= 1) return false;
    contact->lead = fmax(1, 0.1 * contact->lead);
    return true;
}

void cn_contact_friction_served(cn_contact *contact)
{
    for (int i = 0; i < contact->nrub && contact->lead <= 1; i++)
        contact->rub[i].stops = false;
}

static void stiffen(const cn_contact_model *model, cn_contact *contact, const cn_link *rub, const double n[3],
                    double k, const cn_hang *hang)
{
    cn_link link = *rub;
    if (!(k > 0)) return;
    link.k = k;
    cn_copy3(n, link.n);
    cn_contact_join(model, contact, &link, hang);
}

double cn_contact_add_friction(const cn_contact_model *model, cn_contact *contact, const double *x,
                               const double *start, double slip, double *f, const cn_hang *hang)
{
    double energy = 0;
    for (int i = 0; i < contact->nrub; i++) {
        cn_rub *rub = &contact->rub[i];
        const cn_link *link = &rub->link;
        double u[3], across[3];
        sliding(link, x, start, u);
        const double y = cn_norm(u), z = y / slip;
        /* f1 / y is the stiffness across the sliding, f1' along it */
        double over = z < 1 ? (2 - z) / slip : 1 / y, along = z < 1 ? 2 * (1 - z) / slip : 0;
        energy += link->k * (z < 1 ? slip * (z * z * (1 - z / 3) + 1.0 / 3) : y);
        if (hang && rub->stops && z >= 1) over = along = contact->lead / y;
        if (hang && z < 1) rub->stops = false;
        for (int k = 0; k < 4; k++)
            if (model->surface[link->surface[k >= link->nside]].body)
                cn_axpy(-link->k * over * link->w[k], u, f + 3 * (size_t)link->p[k]);
        if (!hang) continue;
        if (!(cn_normalise(u) > 0)) cn_any_normal(link->n, u);
        cn_cross(link->n, u, across);
        stiffen(model, contact, link, u, link->k * along, hang);
        stiffen(model, contact, link, across, link->k * over, hang);
    }
    return energy;
}
