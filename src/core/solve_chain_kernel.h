/* solve_chain_kernel.h - dense kernels of the chain solver, included once for each vector width (no guard):
 * KERNEL(name) names them, TARGET sets the instruction set, TILE is how many 8-vectors a row of accumulators
 * has.
 *
 * A panel is one level's block row [U | W] of the factor: m rows, of stride s (a multiple of 8, rows aligned
 * to 64 bytes), columns [0, p) the level's own unknowns, [p, w) the next level's. A' = U'U row by row, in
 * groups of three: U, W of a group are the rows of A less the products of all rows above (own and of the
 * panels before), divided by the group's 3x3 Cholesky factor. Entries up to and with the diagonal are stored
 * as 0, so that the solves run over whole vectors; the diagonal's inverse stands apart. */

typedef double VECTOR __attribute__((vector_size(8 * LANES), may_alias));
typedef long long KERNEL(mask) __attribute__((vector_size(8 * LANES), may_alias));

/* c[0..2] -= x' y over K rows of a panel of stride s: three rows of nv vectors. */
TARGET static inline __attribute__((always_inline)) void
KERNEL(tile)(double *c, int cs, const double *x, const double *y, int s, int K, const int nv)
{
    VECTOR acc0[TILE], acc1[TILE], acc2[TILE];

#pragma GCC unroll 8
    for (int v = 0; v < nv; v++) {
        acc0[v] = *(const VECTOR *)(c + LANES * v);
        acc1[v] = *(const VECTOR *)(c + cs + LANES * v);
        acc2[v] = *(const VECTOR *)(c + 2 * cs + LANES * v);
    }
    for (int j = 0; j < K; j++, x += s, y += s) {
        const double x0 = x[0], x1 = x[1], x2 = x[2];
#pragma GCC unroll 8
        for (int v = 0; v < nv; v++) {
            VECTOR yv = *(const VECTOR *)(y + LANES * v);
            KEEP(yv);
            acc0[v] -= x0 * yv;
            acc1[v] -= x1 * yv;
            acc2[v] -= x2 * yv;
        }
    }
#pragma GCC unroll 8
    for (int v = 0; v < nv; v++) {
        *(VECTOR *)(c + LANES * v) = acc0[v];
        *(VECTOR *)(c + cs + LANES * v) = acc1[v];
        *(VECTOR *)(c + 2 * cs + LANES * v) = acc2[v];
    }
}

/* The same for any number of columns (a multiple of 8). */
TARGET static inline void KERNEL(update)(double *c, int cs, const double *x, const double *y, int s, int K,
                                         int columns)
{
    int nv = columns / LANES;

    for (; nv >= TILE; nv -= TILE, c += LANES * TILE, y += LANES * TILE)
        KERNEL(tile)(c, cs, x, y, s, K, TILE);
    switch (nv) { /* fewer than TILE are left, and no tile wider than TILE is made */
    case 7:
        KERNEL(tile)(c, cs, x, y, s, K, 7 < TILE ? 7 : 1);
        break;
    case 6:
        KERNEL(tile)(c, cs, x, y, s, K, 6 < TILE ? 6 : 1);
        break;
    case 5:
        KERNEL(tile)(c, cs, x, y, s, K, 5 < TILE ? 5 : 1);
        break;
    case 4:
        KERNEL(tile)(c, cs, x, y, s, K, 4 < TILE ? 4 : 1);
        break;
    case 3:
        KERNEL(tile)(c, cs, x, y, s, K, 3 < TILE ? 3 : 1);
        break;
    case 2:
        KERNEL(tile)(c, cs, x, y, s, K, 2 < TILE ? 2 : 1);
        break;
    case 1:
        KERNEL(tile)(c, cs, x, y, s, K, 1);
        break;
    default:
        break;
    }
}

/* Factors a panel that holds [A | B] in its upper part; `before` are the panels that couple to it. */
TARGET static bool KERNEL(factor)(panel *to, int width, int nbefore, panel *const *before)
{
    const int s = to->s;
    KERNEL(mask) lane = {0};

    for (int v = 0; v < LANES; v++)
        lane[v] = v;

    for (int i = 0; i < to->m; i += 3) {
        const int c0 = i & ~7;
        double *r0 = to->a + (size_t)i * s, *r1 = r0 + s, *r2 = r1 + s, *inverse = to->inverse + i;
        const double least0 = CN_PIVOT_MIN * r0[i], least1 = CN_PIVOT_MIN * r1[i + 1];
        const double least2 = CN_PIVOT_MIN * r2[i + 2];

        for (int k = 0; k < nbefore; k++) {
            const double *w = before[k]->a + before[k]->p;
            KERNEL(update)(r0 + c0, s, w + i, w + c0, before[k]->s, before[k]->m, to->p - c0);
        }
        KERNEL(update)(r0 + c0, s, to->a + i, to->a + c0, s, i, width - c0);

        /* 3x3 Cholesky; written so that NaN fails */
        const double d0 = r0[i];
        if (!(d0 > least0 && d0 > 0 && d0 <= DBL_MAX)) return false;
        const double q0 = 1 / sqrt(d0), u01 = r0[i + 1] * q0, u02 = r0[i + 2] * q0;
        const double d1 = r1[i + 1] - u01 * u01;
        if (!(d1 > least1 && d1 > 0 && d1 <= DBL_MAX)) return false;
        const double q1 = 1 / sqrt(d1), u12 = (r1[i + 2] - u01 * u02) * q1;
        const double d2 = r2[i + 2] - u02 * u02 - u12 * u12;
        if (!(d2 > least2 && d2 > 0 && d2 <= DBL_MAX)) return false;
        const double q2 = 1 / sqrt(d2);
        inverse[0] = q0, inverse[1] = q1, inverse[2] = q2;

        for (int c = c0; c < width; c += LANES) {
            VECTOR a0 = *(VECTOR *)(r0 + c) * q0;
            VECTOR a1 = (*(VECTOR *)(r1 + c) - u01 * a0) * q1;
            VECTOR a2 = (*(VECTOR *)(r2 + c) - u02 * a0 - u12 * a1) * q2;
            if (c <= i + 2) { /* nothing up to and with the diagonal */
                a0 = (VECTOR)((KERNEL(mask))a0 & (lane + c > i));
                a1 = (VECTOR)((KERNEL(mask))a1 & (lane + c > i + 1));
                a2 = (VECTOR)((KERNEL(mask))a2 & (lane + c > i + 2));
            }
            *(VECTOR *)(r0 + c) = a0;
            *(VECTOR *)(r1 + c) = a1;
            *(VECTOR *)(r2 + c) = a2;
        }
    }
    return true;
}

/* y = U^-T t for the panel's own part of t (own | next unknowns); the next level's part of t becomes t - W'
 * y. */
TARGET static void KERNEL(forward)(const panel *from, int width, double *t, double *y)
{
    const int s = from->s;

    for (int i = 0; i < from->m; i += 3) {
        const double *r0 = from->a + (size_t)i * s, *r1 = r0 + s, *r2 = r1 + s, *inverse = from->inverse + i;
        const double y0 = t[i] * inverse[0];
        const double y1 = (t[i + 1] - r0[i + 1] * y0) * inverse[1];
        const double y2 = (t[i + 2] - r0[i + 2] * y0 - r1[i + 2] * y1) * inverse[2];
        y[i] = y0, y[i + 1] = y1, y[i + 2] = y2;
        for (int c = i & ~7; c < width; c += LANES)
            *(VECTOR *)(t + c) -= y0 * *(const VECTOR *)(r0 + c) + y1 * *(const VECTOR *)(r1 + c) +
                                  y2 * *(const VECTOR *)(r2 + c);
    }
}

TARGET static inline __attribute__((always_inline)) double KERNEL(sum)(const VECTOR *v)
{
    const v2 *part = (const v2 *)v;
    v2 half = part[0];

    if (LANES == 8)
        half = (part[0] + part[1]) + (part[LANES / 2 - 2] + part[LANES / 2 - 1]);
    else if (LANES == 4)
        half = part[0] + part[LANES / 2 - 1];
    return half[0] + half[1];
}

/* Own part of x = U^-1 (y - W x_next); the own part of x is 0 when called. */
TARGET static void KERNEL(backward)(const panel *from, int width, const double *y, double *x)
{
    const int s = from->s;

    for (int i = from->m - 3; i >= 0; i -= 3) {
        const double *r0 = from->a + (size_t)i * s, *r1 = r0 + s, *r2 = r1 + s, *inverse = from->inverse + i;
        VECTOR s0 = {0}, s1 = {0}, s2 = {0};
        for (int c = width - LANES; c >= (i & ~7); c -= LANES) { /* the newest x last */
            const VECTOR xv = *(const VECTOR *)(x + c);
            s0 += *(const VECTOR *)(r0 + c) * xv;
            s1 += *(const VECTOR *)(r1 + c) * xv;
            s2 += *(const VECTOR *)(r2 + c) * xv;
        }
        x[i + 2] = (y[i + 2] - KERNEL(sum)(&s2)) * inverse[2];
        x[i + 1] = (y[i + 1] - KERNEL(sum)(&s1) - r1[i + 2] * x[i + 2]) * inverse[1];
        x[i] = (y[i] - KERNEL(sum)(&s0) - r0[i + 1] * x[i + 1] - r0[i + 2] * x[i + 2]) * inverse[0];
    }
}

#undef KERNEL
#undef TARGET
#undef TILE
#undef LANES
#undef VECTOR
