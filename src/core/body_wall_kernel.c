/* body_wall_kernel.c - membrane part of a wall whose triangles turn, eight of them at a time: energy and
 * force of the strain U - 1 (body_wall_turn.c). */
#include "body_wall.h"

#include <float.h>
#include "body_kernel_law.h"

INLINE v8 root_of(const v8 *a)
{
    return *a * rsqrt(a);
}

INLINE double membrane(const cn_body *body, const double *x, double *f, int begin, int end)
{
    const cn_sheet *sheet = body->own;
    const double nu = sheet->poisson;
    v8 sum = {0};
    for (int k = begin; k < end; k++) {
        const cn_sheet_batch *e = sheet->batch + k;
        const v8 *g = (const v8 *)e->grad, size = *(const v8 *)e->size;
        double at[6][CN_LANES] __attribute__((aligned(64)));
        v8 d[2][3], pull[2][3];
        for (int lane = 0; lane < CN_LANES; lane++) {
            const double *p = x + 3 * (size_t)e->node[lane][0];
            for (int a = 0; a < 2; a++) {
                const double *q = x + 3 * (size_t)e->node[lane][a + 1];
                for (int i = 0; i < 3; i++)
                    at[3 * a + i][lane] = q[i] - p[i];
            }
        }
        const v8 *side = (const v8 *)at;
        for (int j = 0; j < 2; j++)
            for (int i = 0; i < 3; i++)
                d[j][i] = side[i] * g[j] + side[3 + i] * g[2 + j];
        const v8 c00 = d[0][0] * d[0][0] + d[0][1] * d[0][1] + d[0][2] * d[0][2];
        const v8 c11 = d[1][0] * d[1][0] + d[1][1] * d[1][1] + d[1][2] * d[1][2];
        const v8 c01 = d[0][0] * d[1][0] + d[0][1] * d[1][1] + d[0][2] * d[1][2];
        const v8 least = 1e-12 * (c00 + c11) * (c00 + c11) + DBL_MIN;
        const v8 flat = c00 * c11 - c01 * c01, det = PICK(flat < least, least, flat);
        const v8 root = root_of(&det), square = c00 + c11 + 2.0 * root, over = rsqrt(&square);
        const v8 u0 = (c00 + root) * over, u1 = (c11 + root) * over, u2 = c01 * over;
        const v8 e0 = u0 - 1.0, e1 = u1 - 1.0, e2 = 2.0 * u2;
        const v8 s0 = size * (e0 + nu * e1), s1 = size * (e1 + nu * e0), s2 = size * (0.5 * (1 - nu)) * e2;
        sum += 0.5 * (e0 * s0 + e1 * s1 + e2 * s2);
        if (!f) continue;
        const v8 shrink = 1.0 / (u0 * u1 - u2 * u2);
        for (int i = 0; i < 3; i++) {
            const v8 r0 = shrink * (d[0][i] * u1 - d[1][i] * u2), r1 = shrink * (d[1][i] * u0 - d[0][i] * u2);
            const v8 p0 = r0 * s0 + r1 * s2, p1 = r0 * s2 + r1 * s1;
            for (int a = 0; a < 2; a++)
                pull[a][i] = p0 * g[2 * a] + p1 * g[2 * a + 1];
        }
        for (int lane = 0; lane < e->n; lane++)
            for (int i = 0; i < 3; i++) {
                f[3 * (size_t)e->node[lane][0] + (size_t)i] += pull[0][i][lane] + pull[1][i][lane];
                f[3 * (size_t)e->node[lane][1] + (size_t)i] -= pull[0][i][lane];
                f[3 * (size_t)e->node[lane][2] + (size_t)i] -= pull[1][i][lane];
            }
    }
    return sum_lanes(&sum);
}

#define KERNEL(name, attribute)                                                                              \
    attribute static double name(const cn_body *body, const double *x, double *f, int begin, int end)        \
    {                                                                                                        \
        return membrane(body, x, f, begin, end);                                                             \
    }

CN_KERNEL_SETS(KERNEL, cn_sheet_kernel, cn_sheet_kernel_pick)
