/* body_wall_measure.c - what limits measure of a wall, from its triangles' strains and curvatures rotated
 * back. */
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
        const int *corner = body->boundary->tri + 3 * (size_t)t;
        double strain[3], bend[3], side[2][3];
        cn_sheet_frame frame;
        cn_sheet_polar(body, t, job->x, &frame);
        cn_sheet_strain(body, t, job->x, &frame, strain, bend);
        for (int k = 0; k < 3; k++) {
            side[0][k] = strain[k] + sheet->thickness / 2 * bend[k];
            side[1][k] = strain[k] - sheet->thickness / 2 * bend[k];
        }
        const double change = shrink * (strain[0] + strain[1]);
        const double worst = fabs(change) + shrink * sheet->thickness / 2 * fabs(bend[0] + bend[1]);
        cn_keep_largest(worst, t, &job->part[task].volume_max, &job->part[task].volume_element);
        job->part[task].change += change;
        job->part[task].growth += change * sheet->area[t] * sheet->thickness;
        job->part[task].inverted += turned_over(body, job->x, corner);
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
