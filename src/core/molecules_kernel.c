/* molecules_kernel.c - springs between molecules, eight molecules at a time, each with its own links.
 *
 * A link of length l along n from j to i, at rest L: energy k (l - L)^2 / 2, force on i -k (l - L) n, tangent
 * K_ii = k n n' + k (1 - L/l) (I - n n'), K_ij = -K_ii. EXACT: that, with L/l <= 1000 where a link has shrunk
 * to nothing; PROJECTED: without the second part in compression; WARPED: without it. */
#include "molecules.h"

#include <math.h>
#include "body_kernel_law.h"

#define SHRUNK_MOST 1e3

typedef struct {
    v8 d[3], l, inverse, k, rest, stretch; /* along the link from the other end; [m], [N/m] */
    const int *other;
} links;

INLINE double lanes_sum(const v8 *a)
{
    const v8 s = *a;
    return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

/* Positions of a group's molecules; beyond the last, the last one's. */
INLINE void load_places(int n, const double *x, int group, v8 place[3])
{
    for (int lane = 0; lane < CN_MOLECULE_LANES; lane++) {
        const int i = group * CN_MOLECULE_LANES + lane < n ? group * CN_MOLECULE_LANES + lane : n - 1;
        for (int c = 0; c < 3; c++)
            place[c][lane] = x[3 * (size_t)i + (size_t)c];
    }
}

INLINE void load_links(const cn_molecule_job *job, int group, int slot, const v8 place[3], links *s)
{
    const cn_molecules *m = job->body->own;
    const size_t at = (size_t)slot * CN_MOLECULE_LANES;
    s->other = m->other + at;
    s->k = *(const v8 *)(m->stiff + at), s->rest = *(const v8 *)(m->length + at);
    for (int lane = 0; lane < CN_MOLECULE_LANES; lane++) {
        const double *y = job->x + 3 * (size_t)s->other[lane];
        for (int c = 0; c < 3; c++)
            s->d[c][lane] = y[c];
    }
    for (int c = 0; c < 3; c++)
        s->d[c] = place[c] - s->d[c];
    if (job->nactive < job->body->nnode)
        for (int lane = 0; lane < CN_MOLECULE_LANES; lane++)
            if (s->other[lane] >= job->nactive || group * CN_MOLECULE_LANES + lane >= job->nactive)
                s->k[lane] = 0;
    const v8 square = s->d[0] * s->d[0] + s->d[1] * s->d[1] + s->d[2] * s->d[2];
    s->inverse = rsqrt(&square), s->l = square * s->inverse;
    s->stretch = s->l - s->rest;
}

/* The tangent K_ii of a slot's links. */
INLINE void tangent_of(const cn_molecule_job *job, const links *s, v8 h[6])
{
    const v8 zero = {0}, most = zero + SHRUNK_MOST, ratio = s->rest * s->inverse;
    const v8 open = 1.0 - PICK(ratio < most, ratio, most), k = s->k * job->scale;
    v8 n[3], across = zero;
    if (job->tangent == CN_TANGENT_EXACT) across = k * open;
    if (job->tangent == CN_TANGENT_PROJECTED) across = k * LARGER(open, zero);
    for (int c = 0; c < 3; c++)
        n[c] = s->d[c] * s->inverse;
    for (int i = 0, e = 0; i < 3; i++)
        for (int j = i; j < 3; j++, e++) {
            h[e] = (k - across) * n[i] * n[j];
            if (i == j) h[e] += across;
        }
}

/* Adds a slot's K_ij to the rows of its molecules. */
INLINE void add_coupling(const cn_molecule_job *job, int slot, const v8 h[6])
{
    const int *block = job->stiffness->block + (size_t)slot * CN_MOLECULE_LANES;
    double *value = job->stiffness->matrix->value;
    for (int lane = 0; lane < CN_MOLECULE_LANES; lane++) {
        double *b = value + 9 * (size_t)block[lane];
        const double xx = h[0][lane], xy = h[1][lane], xz = h[2][lane], yy = h[3][lane], yz = h[4][lane],
                     zz = h[5][lane];
        b[0] -= xx, b[1] -= xy, b[2] -= xz, b[3] -= xy, b[4] -= yy, b[5] -= yz, b[6] -= xz, b[7] -= yz,
            b[8] -= zz;
    }
}

/* Raises *bound to the largest of 2 |K_ii| / m_i of a group, by the norm of row sums. */
INLINE void raise_bound(const cn_molecule_job *job, int group, const v8 own[6], double *bound)
{
    for (int lane = 0, i = group * CN_MOLECULE_LANES; lane < CN_MOLECULE_LANES && i < job->nactive;
         lane++, i++) {
        const double xy = fabs(own[1][lane]), xz = fabs(own[2][lane]), yz = fabs(own[4][lane]);
        const double rows[3] = {own[0][lane] + xy + xz, own[3][lane] + xy + yz, own[5][lane] + xz + yz};
        for (int k = 0; k < 3; k++) {
            const double square = 2 * rows[k] / job->body->mass[i];
            if (!(square <= *bound) && *bound == *bound) *bound = square; /* keeps a NaN */
        }
    }
}

INLINE void add_diagonal(const cn_molecule_job *job, int group, const v8 own[6])
{
    const cn_molecules *m = job->body->own;
    const int *block = job->stiffness->block + (size_t)m->nslot * CN_MOLECULE_LANES;
    static const int full[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
    for (int lane = 0, i = group * CN_MOLECULE_LANES; lane < CN_MOLECULE_LANES && i < job->nactive;
         lane++, i++) {
        double *b = job->stiffness->matrix->value + 9 * (size_t)block[i];
        for (int e = 0; e < 9; e++)
            b[e] += own[full[e]][lane];
    }
}

/* Half of the energy of each molecule's links, its force, its rows of the matrix, its share in the bound. */
INLINE v8 group_elastic(const cn_molecule_job *job, int group, double *bound)
{
    const cn_molecules *m = job->body->own;
    v8 place[3], speed[3], force[3] = {{0}}, own[6] = {{0}}, energy = {0};
    const double damper = job->body->damping_stiffness;
    load_places(job->body->nnode, job->x, group, place);
    if (job->v) load_places(job->body->nnode, job->v, group, speed);
    for (int slot = m->start[group]; slot < m->start[group + 1]; slot++) {
        links s;
        load_links(job, group, slot, place, &s);
        v8 pull = s.k * s.stretch * s.inverse;
        energy += s.k * s.stretch * s.stretch;
        if (job->stiffness || job->bound) {
            v8 h[6];
            tangent_of(job, &s, h);
            for (int e = 0; e < 6; e++)
                own[e] += h[e];
            if (job->stiffness) add_coupling(job, slot, h);
        }
        if (!job->f) continue;
        if (job->v) {
            v8 rate = {0};
            for (int lane = 0; lane < CN_MOLECULE_LANES; lane++) {
                const double *u = job->v + 3 * (size_t)s.other[lane];
                rate[lane] = s.d[0][lane] * (speed[0][lane] - u[0]) + s.d[1][lane] * (speed[1][lane] - u[1]) +
                             s.d[2][lane] * (speed[2][lane] - u[2]);
            }
            pull += damper * s.k * rate * s.inverse * s.inverse;
        }
        for (int c = 0; c < 3; c++)
            force[c] -= pull * s.d[c];
    }
    for (int lane = 0, i = group * CN_MOLECULE_LANES; job->f && lane < CN_MOLECULE_LANES && i < job->nactive;
         lane++, i++)
        for (int c = 0; c < 3; c++)
            job->f[3 * (size_t)i + (size_t)c] += force[c][lane];
    if (job->stiffness) add_diagonal(job, group, own);
    if (job->bound) raise_bound(job, group, own, bound);
    return energy;
}

/* Groups of a task. */
INLINE void task_groups(const cn_molecule_job *job, int task, int *begin, int *end)
{
    const cn_molecules *m = job->body->own;
    *begin = task * job->per * CN_MOLECULE_CHUNK, *end = *begin + job->per * CN_MOLECULE_CHUNK;
    if (*end > m->ngroup) *end = m->ngroup;
}

/* A task: its groups in a row. */
INLINE void elastic(void *user, int task)
{
    cn_molecule_job *job = user;
    int begin, end;
    v8 energy = {0};
    double bound = 0;
    task_groups(job, task, &begin, &end);
    for (int group = begin; group < end; group++)
        energy += group_elastic(job, group, &bound);
    job->energy[task] = 0.25 * lanes_sum(&energy);
    if (job->bound) job->bound[task] = bound;
}

/* As at rest where it does not take part: of links without stiffness nothing counts. */
INLINE void measure(void *user, int task)
{
    cn_molecule_job *job = user;
    const cn_molecules *m = job->body->own;
    cn_measures *out = job->measures + task;
    const v8 zero = {0};
    v8 energy = {0}, strains = {0}, growth = {0};
    int begin, end;
    *out = (cn_measures){.volume_max = -1, .stress_max = -1};
    task_groups(job, task, &begin, &end);
    for (int group = begin; group < end; group++) {
        v8 place[3], most = zero - 1.0, virial[6] = {{0}}, stretched = {0}, stiff = {0}, share = zero + 1.0;
        m8 which = {-1, -1, -1, -1, -1, -1, -1, -1};
        const int first = group * CN_MOLECULE_LANES;
        const int left =
            job->body->nnode - first < CN_MOLECULE_LANES ? job->body->nnode - first : CN_MOLECULE_LANES;
        load_places(job->body->nnode, job->x, group, place);
        for (int lane = 0; lane < left; lane++)
            share[lane] = m->share[first + lane];
        for (int slot = m->start[group]; slot < m->start[group + 1]; slot++) {
            links s;
            m8 link;
            load_links(job, group, slot, place, &s);
            for (int lane = 0; lane < CN_MOLECULE_LANES; lane++)
                link[lane] = m->link[(size_t)slot * CN_MOLECULE_LANES + (size_t)lane];
            const m8 counts = s.k > zero;
            const v8 strain = (v8)(counts & (m8)(s.stretch / s.rest)),
                     size = PICK(counts, LARGER(strain, -strain), zero - 1.0);
            const m8 larger = ~(size <= most) & (most == most);
            most = PICK(larger, size, most), which = (larger & link) | (~larger & which);
            strains += strain;
            energy += s.k * s.stretch * s.stretch;
            const v8 weight = s.k * s.rest * s.rest;
            stretched += weight * strain, stiff += weight;
            if (!job->with_stress) continue;
            const v8 pull = s.k * s.stretch * s.inverse;
            for (int i = 0, e = 0; i < 3; i++)
                for (int j = i; j < 3; j++, e++)
                    virial[e] += pull * s.d[i] * s.d[j];
        }
        growth += PICK(stiff > zero, 3.0 * share * stretched / stiff, zero);
        for (int lane = 0; lane < left; lane++) {
            cn_keep_largest(most[lane], (int)which[lane], &out->volume_max, &out->volume_element);
            if (!job->with_stress || first + lane >= job->nactive || which[lane] < 0) continue;
            double w[6];
            for (int e = 0; e < 6; e++)
                w[e] = virial[e][lane];
            const double stress = cn_virial_stress(w, share[lane]);
            cn_keep_largest(stress, (int)which[lane], &out->stress_max, &out->stress_element);
            out->stress_mean += stress;
        }
    }
    job->energy[task] = 0.25 * lanes_sum(&energy);
    job->strain_sum[task] = 0.5 * lanes_sum(&strains), job->growth[task] = lanes_sum(&growth);
}

CN_KERNEL_SETS(KERNELS, const cn_kernels *, cn_molecule_kernels_pick)
