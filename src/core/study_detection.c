/* study_detection.c - what collision detection costs against the number of triangles. */
#include "catnav/study.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "catnav/mesh.h"
#include "tree.h"

enum { AROUND = 48, TIMES = 5 };
static const double two_pi = 6.28318530717958647692;

/* Time of this thread alone [s]: other work on the machine does not count. */
static double spent(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* A tube of AROUND corners and nearly square cells about a wavy line along x that lies `low` below the
 * middle. */
static cn_status wavy_tube(cn_surface **out, int ntri, double radius, double low)
{
    const int rings = ntri / (2 * AROUND) + 1;
    cn_surface *s;
    const cn_status status = cn_surface_new(&s, rings * AROUND, 2 * (rings - 1) * AROUND);
    *out = NULL;
    if (status != CN_OK) return status;
    for (int i = 0; i < rings; i++)
        for (int k = 0; k < AROUND; k++) {
            const double x = i * two_pi / AROUND, angle = two_pi * k / AROUND, wave = sin(0.2 * x);
            double *v = s->vert + 3 * ((size_t)i * AROUND + (size_t)k);
            v[0] = x, v[1] = 2 * wave + radius * cos(angle), v[2] = radius * sin(angle) - low;
            if (i + 1 == rings) continue;
            const int next = i * AROUND + (k + 1) % AROUND, a = i * AROUND + k;
            int *t = s->tri + 6 * ((size_t)i * AROUND + (size_t)k);
            t[0] = a, t[1] = next, t[2] = next + AROUND;
            t[3] = a, t[4] = next + AROUND, t[5] = a + AROUND;
        }
    *out = s;
    return CN_OK;
}

static bool count(void *user, int a, int b)
{
    (void)a, (void)b;
    ++*(long *)user;
    return true;
}

cn_status cn_study_detection(int ntri, cn_detection_cost *cost)
{
    cn_surface *wall = NULL, *body = NULL;
    cn_tree *tree = NULL, *other = NULL;
    cn_status status;

    *cost = (cn_detection_cost){.build_ms = INFINITY, .refit_ms = INFINITY, .query_ms = INFINITY};
    if (!(ntri >= 2 * AROUND)) return CN_ERR_ARG;
    if ((status = wavy_tube(&wall, ntri, 1, 0)) != CN_OK ||
        (status = wavy_tube(&body, ntri, 0.5, 0.48)) != CN_OK)
        goto done;
    cost->ntri = wall->ntri;
    if ((status = cn_tree_new(&other, body->ntri, body->tri, body->vert)) != CN_OK) goto done;
    for (int i = 0; i < TIMES; i++) {
        cn_tree_free(tree);
        const double begun = spent();
        if ((status = cn_tree_new(&tree, wall->ntri, wall->tri, wall->vert)) != CN_OK) goto done;
        cost->build_ms = fmin(cost->build_ms, 1e3 * (spent() - begun));
    }
    for (int i = 0; i < TIMES; i++) {
        const double begun = spent();
        cn_tree_refit(tree, wall->vert);
        const double refitted = spent();
        cost->pairs = 0;
        cn_tree_query_pairs(tree, other, 0.05, count, &cost->pairs);
        cost->refit_ms = fmin(cost->refit_ms, 1e3 * (refitted - begun));
        cost->query_ms = fmin(cost->query_ms, 1e3 * (spent() - refitted));
    }
done:
    cn_tree_free(tree), cn_tree_free(other);
    cn_surface_free(wall), cn_surface_free(body);
    return status;
}
