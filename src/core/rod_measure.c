/* rod_measure.c - what limits measure of a rod, from its sections' strains. */
#include "rod.h"

#include <math.h>
#include <string.h>

/* Von Mises of a fibre's stress and a shear [Pa]. */
static double von_mises_of(double fibre, double shear)
{
    return sqrt(fibre * fibre + 3 * shear * shear);
}

void cn_rod_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                    cn_measures *measures, double *von_mises, cn_pool *pool)
{
    const cn_rod *rod = body->own;
    const cn_rod_job job = {.body = body, .nactive = nactive, .x = x, .rotation = rotation};
    cn_measures m = {.volume = body->rest_volume};
    double change = 0;
    (void)pool; /* less work than the call */
    if (von_mises) memset(von_mises, 0, (size_t)body->ntet * sizeof *von_mises);
    if (nactive > 1) m.volume_max = m.stress_max = -1;
    for (int chunk = 0; chunk < cn_rod_chunks(nactive); chunk++) {
        cn_rod_strains strain;
        m.energy += rod->kernel(&job, chunk, &strain);
        for (int i = 1; i <= CN_ROD_CHUNK; i++) {
            const int s = chunk * CN_ROD_CHUNK + i - 1;
            if (s >= nactive - 1) break;
            const cn_section *c = rod->section + s;
            const double axial = strain[2][i], bend[2] = {strain[3][i], strain[4][i]}, twist = strain[5][i];
            const double outer = c->round ? c->half[0] * hypot(bend[0], bend[1])
                                          : c->half[1] * fabs(bend[0]) + c->half[0] * fabs(bend[1]);
            const double worst = fabs(axial) + outer, shrink = 1 - 2 * c->poisson;
            const double length = rod->constant[CN_ROD_LENGTH * (size_t)rod->stride + 1 + (size_t)s];
            cn_keep_largest(shrink * worst, s, &m.volume_max, &m.volume_element);
            change += shrink * axial;
            m.volume += shrink * axial * c->area * length;
            /* the share of e that lies along t */
            const double rest = rod->constant[(CN_ROD_STRETCH + 2) * (size_t)rod->stride + 1 + (size_t)s];
            m.inverted += !(axial + rest > 0);
            if (with_stress) {
                const double stress = von_mises_of(c->young * worst, c->twist_stress * twist);
                cn_keep_largest(stress, s, &m.stress_max, &m.stress_element);
                m.stress_mean += stress / body->nelement;
            }
            for (int k = rod->start[s]; von_mises && k < rod->start[s + 1]; k++) {
                const double *fibre = rod->fibre + 3 * (size_t)k;
                const double stretch = axial + bend[0] * fibre[1] - bend[1] * fibre[0];
                von_mises[rod->riding[k]] = von_mises_of(c->young * stretch, fibre[2] * twist);
            }
        }
    }
    if (m.stress_max < 0) m.stress_max = 0;
    m.volume_mean = fabs(change / body->nelement);
    *measures = m;
}
