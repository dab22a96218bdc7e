/* molecules_explicit.c - explicit steps of molecules: symplectic Euler in substeps below the stable one. */
#include "molecules.h"

#include <math.h>
#include <string.h>

static const double MARGIN = 0.9;

/* The stable step with this pressing on it. */
static double stable_step(const cn_body *body, const double *x, const cn_press *press, cn_pool *pool)
{
    const cn_molecules *m = body->own;
    double bound[CN_MOLECULE_TASKS], square = 0;
    cn_molecule_job job = {.body = body,
                           .nactive = body->nnode,
                           .x = x,
                           .tangent = CN_TANGENT_PROJECTED,
                           .scale = 1,
                           .bound = bound};
    const int ntask = cn_molecules_run(&job, m->kernels->elastic, pool);
    for (int i = 0; i < ntask; i++)
        if (!(bound[i] <= square) && square == square) square = bound[i];
    if (press) square += press->square;
    if (!(square > 0 && square <= 1e300)) return 0;
    const double friction = body->damping + body->damping_stiffness * square + (press ? press->friction : 0);
    const double w = sqrt(square), z = 0.5 * friction / w;
    return 2 / (w * (sqrt(1 + z * z) + z)); /* sqrt(1 + z^2) - z, without cancellation */
}

double cn_molecules_stable_step(const cn_body *body, const double *x, cn_pool *pool)
{
    return stable_step(body, x, NULL, pool);
}

typedef struct {
    const cn_body *body;
    const double *given;
    const unsigned char *held;
    double *x, *v, *f, h;
} motion;

enum { CHUNK = 1024 };

static void move_chunk(void *user, int chunk)
{
    const motion *m = user;
    for (int i = chunk * CHUNK; i < m->body->nnode && i < (chunk + 1) * CHUNK; i++) {
        const double over = m->h / m->body->mass[i];
        for (int k = 3 * i; k < 3 * i + 3; k++) {
            if (m->held && m->held[i])
                m->v[k] = 0;
            else
                m->v[k] +=
                    over * (m->f[k] + (m->given ? m->given[k] : 0)) - m->h * m->body->damping * m->v[k];
            m->x[k] += m->h * m->v[k];
            m->f[k] = 0;
        }
    }
}

cn_status cn_molecules_explicit(const cn_body *body, double dt, const double *force, const cn_press *press,
                                const unsigned char *held, double *x, double *v, double *work, int *substeps,
                                cn_pool *pool)
{
    const double stable = body->model == CN_BODY_MOLECULES ? MARGIN * stable_step(body, x, press, pool) : 0;
    if (!(stable > 0 && dt > 0 && dt <= CN_SUBSTEPS_MAX * stable)) return CN_ERR_ARG;
    const int n = (int)ceil(dt / stable), all = 3 * body->nnode;
    motion m = {body, force, held, x, v, work, dt / n};
    cn_molecule_job job = {.body = body, .nactive = body->nnode, .x = x, .f = work};
    if (body->damping_stiffness > 0) job.v = v;
    const cn_molecules *own = body->own;
    pool = body->nnode >= CHUNK ? pool : NULL;
    memset(work, 0, (size_t)all * sizeof *work);
    *substeps = n;
    for (int i = 0; i < n; i++) {
        cn_molecules_run(&job, own->kernels->elastic, pool);
        if (press) press->add(press->user, x, v, work);
        cn_pool_run(pool, (body->nnode + CHUNK - 1) / CHUNK, move_chunk, &m);
    }
    for (int i = 0; i < all; i++)
        if (!isfinite(x[i]) || !isfinite(v[i])) return CN_ERR_NOT_FINITE;
    return CN_OK;
}
