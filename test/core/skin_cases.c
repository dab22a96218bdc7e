#include "skin_cases.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "catnav/vec3.h"

static void *need(void *memory)
{
    if (memory) return memory;
    fputs("out of memory\n", stderr);
    exit(2);
}

cn_surface *skin_capsule(double length, double radius, int around)
{
    const double pi = acos(-1.0), edge = 2 * pi * radius / around;
    const int cap = (around + 3) / 4, side = (int)ceil(length / edge), ring = 2 * cap - 1 + side;
    cn_surface *s;
    if (cn_surface_new(&s, ring * around + 2, 2 * ring * around) != CN_OK) need(NULL);
    for (int i = 0; i < ring; i++) { /* rings from below; the poles come last */
        const int above = i - (cap - 1) - side;
        const double turn = i < cap ? (1 - (i + 1.0) / cap) * pi / 2 : above > 0 ? above * pi / 2 / cap : 0;
        const double z = i < cap     ? -radius * sin(turn)
                         : above > 0 ? length + radius * sin(turn)
                                     : length * (i - cap + 1) / side;
        for (int j = 0; j < around; j++) {
            double *x = s->vert + 3 * ((size_t)i * (size_t)around + (size_t)j);
            const double at = 2 * pi * (j + 0.5 * (i % 2)) / around;
            x[0] = radius * cos(turn) * cos(at), x[1] = radius * cos(turn) * sin(at), x[2] = z;
        }
    }
    s->vert[3 * (size_t)(ring * around) + 2] = -radius;
    s->vert[3 * (size_t)(ring * around) + 5] = length + radius;
    int *tri = s->tri;
    for (int i = 0; i + 1 < ring; i++)
        for (int j = 0; j < around; j++) {
            const int next = (j + 1) % around, a = i * around + j, b = i * around + next, c = a + around,
                      d = b + around;
            const int even[6] = {a, b, c, b, d, c}, odd[6] = {a, b, d, a, d, c};
            for (int k = 0; k < 6; k++)
                *tri++ = i % 2 ? odd[k] : even[k];
        }
    for (int j = 0; j < around; j++) {
        const int next = (j + 1) % around, top = (ring - 1) * around;
        *tri++ = ring * around, *tri++ = next, *tri++ = j;
        *tri++ = ring * around + 1, *tri++ = top + j, *tri++ = top + next;
    }
    return s;
}

void skin_bend(double length, double angle, const double p[3], double x[3], double q[4])
{
    const double curvature = angle / length, turn = curvature * p[2], arm = 1 / curvature - p[0];
    const double at[3] = {1 / curvature - arm * cos(turn), p[1], arm * sin(turn)};
    cn_copy3(at, x);
    if (q) q[0] = cos(turn / 2), q[1] = 0, q[2] = sin(turn / 2), q[3] = 0;
}

skin_bar skin_bar_new(const int n[3], double spacing, double length, double angle)
{
    skin_bar bar = {.n = n[0] * n[1] * n[2]};
    bar.rest = need(malloc(3 * (size_t)bar.n * sizeof(double)));
    bar.place = need(malloc(3 * (size_t)bar.n * sizeof(double)));
    bar.rotation = need(malloc(4 * (size_t)bar.n * sizeof(double)));
    for (int i = 0; i < bar.n; i++) {
        const int at[3] = {i % n[0], i / n[0] % n[1], i / n[0] / n[1]};
        double *p = bar.rest + 3 * i;
        p[0] = spacing * (at[0] - 0.5 * (n[0] - 1)), p[1] = spacing * (at[1] - 0.5 * (n[1] - 1));
        p[2] = spacing * at[2];
        skin_bend(length, angle, p, bar.place + 3 * i, bar.rotation + 4 * i);
    }
    return bar;
}

void skin_bar_free(skin_bar *bar)
{
    free(bar->rest);
    free(bar->place);
    free(bar->rotation);
    *bar = (skin_bar){0};
}
