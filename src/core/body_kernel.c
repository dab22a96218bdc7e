/* body_kernel.c - linear tetrahedra, eight at a time: one point of body_kernel_law.h each. */
#include "body_kernel_law.h"

static const int upper[10] = {0, 1, 2, 3, 5, 6, 7, 10, 11, 15}, /* of the 16 node pairs, row-major */
    lower[10] = {-1, 4, 8, 12, -1, 9, 13, -1, 14, -1};

/* Lanes that take part, as bits. */
INLINE int active_lanes(const cn_batch *e, int nactive)
{
    int active = 0;
    for (int lane = 0; lane < CN_LANES; lane++) {
        const int *n = e->node[lane];
        if (e->element[lane] >= 0 && n[0] < nactive && n[1] < nactive && n[2] < nactive && n[3] < nactive)
            active |= 1 << lane;
    }
    return active;
}

/* F and the warm start of each lane; lanes that take no part are at rest. */
INLINE void gather(const cn_batch *e, const cn_body *body, const double *x, const double *rotation,
                   int active, v8 f[9], v8 q[4])
{
    double at[12][CN_LANES] __attribute__((aligned(64))), start[4][CN_LANES] __attribute__((aligned(64)));
    for (int lane = 0; lane < CN_LANES; lane++) {
        const int on = active >> lane & 1;
        const double *from = on ? x : body->rest;
        static const double rest[4] = {1, 0, 0, 0};
        const double *turn = on ? rotation + 4 * (size_t)e->element[lane] : rest;
        for (int a = 0; a < 4; a++) {
            const double *p = from + 3 * (size_t)e->node[lane][a];
            at[3 * a][lane] = p[0], at[3 * a + 1][lane] = p[1], at[3 * a + 2][lane] = p[2];
            start[a][lane] = turn[a];
        }
    }
    for (int i = 0; i < 4; i++)
        q[i] = ((const v8 *)start)[i];
    deformation((const v8 *)at, (const v8 *)e->grad, f);
}

INLINE void keep_rotation(const cn_batch *e, const v8 q[4], double *rotation, int active)
{
    for (int lane = 0; lane < CN_LANES; lane++)
        for (int i = 0; active >> lane & 1 && i < 4; i++)
            rotation[4 * (size_t)e->element[lane] + i] = q[i][lane];
}

INLINE void add_forces(const cn_batch *e, const v8 r[9], const v8 stress[6], double *f, int active)
{
    double out[12][CN_LANES] __attribute__((aligned(64)));
    corner_forces(r, stress, (const v8 *)e->grad, (v8 *)out);
    for (int lane = 0; lane < CN_LANES; lane++)
        for (int a = 0; active >> lane & 1 && a < 4; a++) {
            double *to = f + 3 * (size_t)e->node[lane][a];
            to[0] += out[3 * a][lane], to[1] += out[3 * a + 1][lane], to[2] += out[3 * a + 2][lane];
        }
}

INLINE void elastic(const cn_elastic_job *job, int chunk)
{
    const struct cn_element_data *data = job->body->element;
    const int first = chunk * data->chunk_batches;
    const int last = first + data->chunk_batches < data->nbatch ? first + data->chunk_batches : data->nbatch;
    v8 sum = {0};
    for (int k = first; k < last; k++) {
        const cn_batch *e = data->batch + k;
        if (e->top_min >= job->nactive) continue;
        const int active = active_lanes(e, job->nactive);
        v8 f[9], q[4], r[9], b[9], eps[6], trace;
        gather(e, job->body, job->x, job->rotation, active, f, q);
        polar(f, q, r, b);
        keep_rotation(e, q, job->rotation, active);
        const material m = {*(const v8 *)e->volume, *(const v8 *)e->mu, *(const v8 *)e->lambda};
        sum += strain(b, &m, eps, &trace);
        if (!job->f) continue;
        v8 stress[6];
        stress_of(eps, &trace, &m, stress);
        add_forces(e, r, stress, job->f, active);
        if (!job->stiffness) continue;
        v8 block[10][9];
        stiffness_blocks(r, b, (const v8 *)e->grad, &m, job->tangent, block);
        scatter_blocks((const v8(*)[9])block, 10, job->scale, job->stiffness->matrix->value,
                       job->stiffness->block + 16 * CN_LANES * (size_t)k, 16, upper, lower, active);
    }
    job->energy[chunk] = sum_lanes(&sum);
}

INLINE void measure(const cn_measure_job *job, int chunk)
{
    const struct cn_element_data *data = job->body->element;
    const int first = chunk * data->chunk_batches;
    const int last = first + data->chunk_batches < data->nbatch ? first + data->chunk_batches : data->nbatch;
    cn_chunk_measures *out = job->chunk + chunk;
    measure_sums sums = {0};
    *out = nothing_measured;
    for (int k = first; k < last; k++) {
        const cn_batch *e = data->batch + k;
        if (e->top_min >= job->nactive) continue;
        const int active = active_lanes(e, job->nactive);
        v8 f[9], q[4], r[9], b[9], eps[6], trace, stress = {0};
        gather(e, job->body, job->x, job->rotation, active, f, q);
        const material m = {*(const v8 *)e->volume, *(const v8 *)e->mu, *(const v8 *)e->lambda};
        const v8 ratio = determinant(f);
        sums.growth -= (1.0 - ratio) * m.volume;
        polar(f, q, r, b);
        keep_rotation(e, q, job->rotation, active);
        sums.energy += strain(b, &m, eps, &trace);
        if (job->with_stress) stress = von_mises(eps, &m);
        keep_lanes(job, e->element, active, &ratio, &ratio, &stress, &sums, out);
    }
    sum_measures(&sums, out);
}

CN_KERNEL_SETS(KERNELS, const cn_kernels *, cn_kernels_pick)
