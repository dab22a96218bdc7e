/* body_wall_measure.c - what limits measure of a wall, from its triangles' strains and curvatures. */
#include "body_wall.h"

#include <math.h>
#include <stddef.h>
#include "catnav/vec3.h"

typedef struct {
    const cn_body *body;
    const double *x;
    bool with_stress;
    double *von_mises;
    struct {
        double volume_max, stress_max, change, growth, stress;
        int volume_element, stress_element, inverted;
    } part[CN_SHEET_TASKS];
} measure_job;

/* out = B u for the first n nodes of an element, u counted from its first node's: a shift gives zero. */
static void strain_of(const cn_body *body, const double *x, const int *node, int n, const double *b,
                      double out[3])
{
    double first[3];
    cn_sub(x + 3 * (size_t)node[0], body->rest + 3 * (size_t)node[0], first);
    out[0] = out[1] = out[2] = 0;
    for (int a = 1; a < n; a++)
        for (int k = 0; k < 3; k++) {
            const size_t i = 3 * (size_t)node[a] + (size_t)k;
            const double u = x[i] - body->rest[i] - first[k];
            for (int r = 0; r < 3; r++)
                out[r] += b[3 * n * r + 3 * a + k] * u;
        }
}

/* Von Mises of plane stress. */
static double von_mises_of(const cn_sheet *sheet, const double strain[3])
{
    const double nu = sheet->poisson, plane = sheet->young / (1 - nu * nu);
    const double s = plane * (strain[0] + nu * strain[1]), t = plane * (strain[1] + nu * strain[0]);
    const double shear = plane * (1 - nu) / 2 * strain[2];
    return sqrt(s * s - s * t + t * t + 3 * shear * shear);
}

static bool turned_over(const cn_body *body, const double *x, const int *node)
{
    double normal[2][3];
    for (int now = 0; now < 2; now++) {
        const double *p = now ? x : body->rest;
        double u[3], v[3];
        cn_sub(p + 3 * (size_t)node[1], p + 3 * (size_t)node[0], u);
        cn_sub(p + 3 * (size_t)node[2], p + 3 * (size_t)node[0], v);
        cn_cross(u, v, normal[now]);
    }
    return !(cn_dot(normal[0], normal[1]) > 0);
}

static void measure_task(void *user, int task)
{
    measure_job *job = user;
    const cn_body *body = job->body;
    const cn_sheet *sheet = body->own;
    const int begin = (int)((long long)body->nelement * task / CN_SHEET_TASKS);
    const int end = (int)((long long)body->nelement * (task + 1) / CN_SHEET_TASKS);
    const double shrink = (1 - 2 * sheet->poisson) / (1 - sheet->poisson);
    job->part[task].volume_max = job->part[task].stress_max = -1;
    for (int t = begin; t < end; t++) {
        const int *node = body->connect + (size_t)body->nper * (size_t)t;
        double strain[3], bend[3] = {0}, side[2][3];
        strain_of(body, job->x, node, 3, sheet->strain + 27 * (size_t)t, strain);
        if (sheet->curvature)
            strain_of(body, job->x, node, CN_SHELL_NODES, sheet->curvature + 9 * CN_SHELL_NODES * (size_t)t,
                      bend);
        for (int k = 0; k < 3; k++) {
            side[0][k] = strain[k] + sheet->thickness / 2 * bend[k];
            side[1][k] = strain[k] - sheet->thickness / 2 * bend[k];
        }
        const double change = shrink * (strain[0] + strain[1]);
        const double worst = fabs(change) + shrink * sheet->thickness / 2 * fabs(bend[0] + bend[1]);
        cn_keep_largest(worst, t, &job->part[task].volume_max, &job->part[task].volume_element);
        job->part[task].change += change;
        job->part[task].growth += change * sheet->area[t] * sheet->thickness;
        job->part[task].inverted += turned_over(body, job->x, node);
        if (!job->with_stress && !job->von_mises) continue;
        const double a = von_mises_of(sheet, side[0]), b = von_mises_of(sheet, side[1]);
        const double stress = a >= b || a != a ? a : b;
        if (job->von_mises) job->von_mises[t] = stress;
        if (!job->with_stress) continue;
        cn_keep_largest(stress, t, &job->part[task].stress_max, &job->part[task].stress_element);
        job->part[task].stress += stress;
    }
}

void cn_sheet_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                      cn_measures *measures, double *von_mises, cn_pool *pool)
{
    measure_job job = {.body = body, .x = x, .with_stress = with_stress, .von_mises = von_mises};
    cn_measures m = {.volume_max = -1, .stress_max = -1, .volume = body->rest_volume};
    double change = 0;
    cn_pool_run(pool, CN_SHEET_TASKS, measure_task, &job);
    for (int i = 0; i < CN_SHEET_TASKS; i++) {
        if (job.part[i].volume_max == -1) continue; /* no triangle here */
        cn_keep_largest(job.part[i].volume_max, job.part[i].volume_element, &m.volume_max, &m.volume_element);
        cn_keep_largest(job.part[i].stress_max, job.part[i].stress_element, &m.stress_max, &m.stress_element);
        change += job.part[i].change;
        m.volume += job.part[i].growth;
        m.stress_mean += job.part[i].stress / body->nelement;
        m.inverted += job.part[i].inverted;
    }
    if (m.stress_max < 0) m.stress_max = 0;
    m.volume_mean = fabs(change / body->nelement);
    m.energy = cn_sheet_energy(body, nactive, x, rotation, pool);
    *measures = m;
}
