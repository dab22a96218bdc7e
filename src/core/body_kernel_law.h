/* body_kernel_law.h - the corotational law for eight points at a time (GCC vector extensions, one a lane):
 * what the kernels of linear and of second-order tetrahedra share. A point is that of a linear tetrahedron of
 * corners y with the gradients g of the shape functions of its corners 1..3.
 *
 * F = sum_a (y_a - y_0) g_a', F = R S (polar.h), B = R'F = S.
 *   psi = mu |S - I|^2 + la/2 tr(S - I)^2,   P = R (2 mu (S - I) + la tr(S - I) I),   f_a = -V P g_a.
 * Stiffness (Chao 2010, McAdams 2011): with dF = R Z, R'dR = [w], (tr(S) I - S) w = axial of Z's
 * antisymmetric part, twice; so dP = R (2 mu Z + la tr(Z) I - (2 mu - la tr(S - I)) [w]). In S's eigenframe
 * the twist about axis k has the eigenvalue c_k = 2 mu - (2 mu - la tr(S - I)) 2 / (s_i + s_j); all others
 * are 2 mu, or 2 mu + 3 la for Z = I, which are positive. With D = sum_k (c_k - 2 mu) e_k e_k' in world axes
 * and h_a = R g_a, a block of K is K_ab = V (la h_a h_b' + 2 mu (h_a.h_b) I + [h_a]' D [h_b] / 2). EXACT:
 * that. PROJECTED: max(0, c_k) (Smith 2019). WARPED: c_k = 0, which is R K0 R' (Mueller and Gross 2004). */
#ifndef CN_BODY_KERNEL_LAW_H
#define CN_BODY_KERNEL_LAW_H

#include "body_element.h"
#include "kernel_sets.h"

#include <stddef.h>
#include "polar.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are returned by inlined functions only */

typedef double v8 __attribute__((vector_size(64), may_alias));
typedef long long m8 __attribute__((vector_size(64), may_alias)); /* -1: true */
typedef double v4 __attribute__((vector_size(32), may_alias, aligned(8)));
typedef long long m4 __attribute__((vector_size(32)));
#define INLINE static inline __attribute__((always_inline))

enum { NEWTON_MAX = 8 };   /* a warm start a radian off needs 5 */
#define NEWTON_STEP2 1e-16 /* |w|^2 of the last step: the next one would be below rounding */
#define PAIR_MIN     1e-8  /* s_i + s_j is taken as at least this in the tangent */
#define PAIR_REGULAR 1e-3  /* above this no eigenvectors are needed to bound it */

#define PICK(mask, a, b) ((v8)(((mask) & (m8)(a)) | (~(mask) & (m8)(b))))
#define LARGER(a, b)     PICK((a) > (b), a, b)

typedef struct {
    v8 volume, mu, lambda;
} material;

INLINE int all(const m8 *mask)
{
    const m8 a = *mask;
    return (a[0] & a[1] & a[2] & a[3] & a[4] & a[5] & a[6] & a[7]) != 0;
}

/* 1/sqrt(a) to rounding, a > 0 and normal; finite for a = 0. */
INLINE v8 rsqrt(const v8 *a)
{
    v8 y = (v8)(0x5fe6eb50c7b537a9LL - ((m8)*a >> 1));
    for (int i = 0; i < 4; i++)
        y = y * (1.5 - 0.5 * *a * y * y);
    return y;
}

INLINE void quaternion_matrix(const v8 q[4], v8 r[9])
{
    const v8 t = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const v8 x = t * q[1], y = t * q[2], z = t * q[3];
    const v8 wx = x * q[0], wy = y * q[0], wz = z * q[0], xx = x * q[1], xy = x * q[2], xz = x * q[3],
             yy = y * q[2], yz = y * q[3], zz = z * q[3];
    r[0] = 1.0 - (yy + zz), r[1] = xy - wz, r[2] = xz + wy;
    r[3] = xy + wz, r[4] = 1.0 - (xx + zz), r[5] = yz - wx;
    r[6] = xz - wy, r[7] = yz + wx, r[8] = 1.0 - (xx + yy);
}

/* C = A'B */
INLINE void transposed_times(const v8 a[9], const v8 b[9], v8 c[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[3 * i + j] = a[i] * b[j] + a[3 + i] * b[3 + j] + a[6 + i] * b[6 + j];
}

/* Symmetric 3x3 as xx xy xz yy yz zz; returns the determinant, the adjugate in adj. */
INLINE v8 adjugate(const v8 g[6], v8 adj[6])
{
    adj[0] = g[3] * g[5] - g[4] * g[4];
    adj[1] = g[2] * g[4] - g[1] * g[5];
    adj[2] = g[1] * g[4] - g[2] * g[3];
    adj[3] = g[0] * g[5] - g[2] * g[2];
    adj[4] = g[1] * g[2] - g[0] * g[4];
    adj[5] = g[0] * g[3] - g[1] * g[1];
    return g[0] * adj[0] + g[1] * adj[1] + g[2] * adj[2];
}

/* R, B = R'F from the warm start q, which becomes R's. Newton's method for the stationary point of tr(R'F),
 * where G = tr(B) I - sym(B) positive definite makes it the largest; lanes that miss it go through the SVD.
 */
INLINE void polar(const v8 f[9], v8 q[4], v8 r[9], v8 b[9])
{
    m8 good = {0};
    for (int k = 0; k < NEWTON_MAX && !all(&good); k++) {
        quaternion_matrix(q, r);
        transposed_times(r, f, b);
        const v8 g[6] = {b[4] + b[8], -0.5 * (b[1] + b[3]), -0.5 * (b[2] + b[6]),
                         b[0] + b[8], -0.5 * (b[5] + b[7]), b[0] + b[4]};
        const v8 a[3] = {b[7] - b[5], b[2] - b[6], b[3] - b[1]};
        v8 adj[6];
        const v8 det = adjugate(g, adj), inverse = 0.5 / det;
        const v8 w[3] = {(adj[0] * a[0] + adj[1] * a[1] + adj[2] * a[2]) * inverse,
                         (adj[1] * a[0] + adj[3] * a[1] + adj[4] * a[2]) * inverse,
                         (adj[2] * a[0] + adj[4] * a[1] + adj[5] * a[2]) * inverse};
        good = (4.0 * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) <= NEWTON_STEP2) & (det > 0.0) &
               (adj[5] > 0.0) & (g[0] > 0.0);
        const v8 p[4] = {q[0], q[1], q[2], q[3]};
        q[0] = p[0] - p[1] * w[0] - p[2] * w[1] - p[3] * w[2];
        q[1] = p[1] + p[0] * w[0] + p[2] * w[2] - p[3] * w[1];
        q[2] = p[2] + p[0] * w[1] + p[3] * w[0] - p[1] * w[2];
        q[3] = p[3] + p[0] * w[2] + p[1] * w[1] - p[2] * w[0];
    }
    if (!all(&good))
        for (int lane = 0; lane < CN_LANES; lane++) {
            if (good[lane]) continue;
            double fl[9], ql[4];
            for (int i = 0; i < 9; i++)
                fl[i] = f[i][lane];
            cn_polar(fl, ql);
            for (int i = 0; i < 4; i++)
                q[i][lane] = ql[i];
        }
    const v8 n2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], n = rsqrt(&n2);
    for (int i = 0; i < 4; i++)
        q[i] *= n;
    quaternion_matrix(q, r);
    transposed_times(r, f, b);
}

/* One Jacobi rotation of symmetric A (full 3x3) about the axis other than i, j; columns of E follow. */
INLINE void jacobi(v8 a[9], v8 e[9], int i, int j)
{
    const int k = 3 - i - j;
    const v8 zero = {0}, off = a[3 * i + j], d = a[4 * j] - a[4 * i], sum = d * d + 4.0 * off * off;
    const v8 root = sum * rsqrt(&sum), below = PICK(d < zero, d - root, d + root);
    const v8 t = PICK(sum > zero, 2.0 * off / below, zero), length2 = 1.0 + t * t;
    const v8 c = rsqrt(&length2), s = c * t;
    const v8 aki = a[3 * k + i], akj = a[3 * k + j];
    a[4 * i] -= t * off, a[4 * j] += t * off;
    a[3 * i + j] = a[3 * j + i] = zero;
    a[3 * k + i] = a[3 * i + k] = c * aki - s * akj;
    a[3 * k + j] = a[3 * j + k] = s * aki + c * akj;
    for (int row = 0; row < 3; row++) {
        const v8 ei = e[3 * row + i], ej = e[3 * row + j];
        e[3 * row + i] = c * ei - s * ej;
        e[3 * row + j] = s * ei + c * ej;
    }
}

/* D of the head of this file from the left stretch (F R', symmetric), by eigenvectors. */
INLINE void twist_by_eigenvectors(const v8 stretch[6], const v8 *mu, const v8 *pull, int projected, v8 d[6])
{
    const v8 zero = {0};
    v8 a[9] = {stretch[0], stretch[1], stretch[2], stretch[1], stretch[3],
               stretch[4], stretch[2], stretch[4], stretch[5]};
    v8 e[9] = {zero + 1.0, zero, zero, zero, zero + 1.0, zero, zero, zero, zero + 1.0};
    const v8 enough = 1e-30 * (a[0] * a[0] + a[4] * a[4] + a[8] * a[8]);
    for (int sweep = 0; sweep < 6; sweep++) {
        const m8 done = a[1] * a[1] + a[2] * a[2] + a[5] * a[5] <= enough;
        if (all(&done)) break;
        jacobi(a, e, 0, 1);
        jacobi(a, e, 0, 2);
        jacobi(a, e, 1, 2);
    }
    v8 c[3];
    for (int k = 0; k < 3; k++) {
        const v8 pair = a[4 * ((k + 1) % 3)] + a[4 * ((k + 2) % 3)], least = zero + PAIR_MIN;
        c[k] = -2.0 * *pull / LARGER(pair, least);
        if (projected) c[k] = LARGER(c[k], -2.0 * *mu);
    }
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            d[k] = c[0] * e[3 * i] * e[3 * j] + c[1] * e[3 * i + 1] * e[3 * j + 1] +
                   c[2] * e[3 * i + 2] * e[3 * j + 2];
}

/* D of the head of this file. */
INLINE void twist(const v8 r[9], const v8 b[9], const material *m, cn_tangent tangent, v8 d[6])
{
    const v8 zero = {0};
    if (tangent == CN_TANGENT_WARPED) {
        d[0] = d[3] = d[5] = -2.0 * m->mu;
        d[1] = d[2] = d[4] = zero;
        return;
    }
    v8 rb[9], u[6]; /* left stretch R S R' */
    for (int i = 0; i < 3; i++) {
        const v8 *ri = r + 3 * i;
        rb[3 * i] = ri[0] * b[0] + ri[1] * b[3] + ri[2] * b[6];
        rb[3 * i + 1] = ri[0] * b[1] + ri[1] * b[4] + ri[2] * b[7];
        rb[3 * i + 2] = ri[0] * b[2] + ri[1] * b[5] + ri[2] * b[8];
    }
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            u[k] = rb[3 * i] * r[3 * j] + rb[3 * i + 1] * r[3 * j + 1] + rb[3 * i + 2] * r[3 * j + 2];
    const v8 trace = u[0] + u[3] + u[5], pull = 2.0 * m->mu - m->lambda * (trace - 3.0);
    if (tangent == CN_TANGENT_EXACT) {
        const v8 g[6] = {trace - u[0], -u[1], -u[2], trace - u[3], -u[4], trace - u[5]};
        const v8 det = adjugate(g, d);
        const m8 regular = det > PAIR_REGULAR * trace * trace;
        if (all(&regular)) {
            const v8 factor = -2.0 * pull / det;
            for (int k = 0; k < 6; k++)
                d[k] *= factor;
            return;
        }
    }
    twist_by_eigenvectors(u, &m->mu, &pull, tangent == CN_TANGENT_PROJECTED, d);
}

/* The ten blocks of the upper triangle, 00 01 02 03 11 12 13 22 23 33: node 0's from those of the others, as
 * no translation makes a force. */
INLINE void stiffness_blocks(const v8 r[9], const v8 b[9], const v8 g[9], const material *m,
                             cn_tangent tangent, v8 block[10][9])
{
    static const int at[3][3] = {{4, 5, 6}, {5, 7, 8}, {6, 8, 9}};
    v8 d[6], h[3][3];
    twist(r, b, m, tangent, d);
    for (int k = 0; k < 6; k++)
        d[k] *= 0.5 * m->volume;
    const v8 la = m->volume * m->lambda, mu2 = 2.0 * m->volume * m->mu;
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 3; i++)
            h[a][i] = r[3 * i] * g[3 * a] + r[3 * i + 1] * g[3 * a + 1] + r[3 * i + 2] * g[3 * a + 2];
    for (int n = 0; n < 3; n++) {
        const v8 x = h[n][0], y = h[n][1], z = h[n][2];
        const v8 dh[3][3] = {/* columns of D [h_n] */
                             {d[1] * z - d[2] * y, d[3] * z - d[4] * y, d[4] * z - d[5] * y},
                             {d[2] * x - d[0] * z, d[4] * x - d[1] * z, d[5] * x - d[2] * z},
                             {d[0] * y - d[1] * x, d[1] * y - d[3] * x, d[2] * y - d[4] * x}};
        for (int a = 0; a <= n; a++) {
            v8 *k = block[at[a][n]];
            const v8 *u = h[a], dot = mu2 * (u[0] * x + u[1] * y + u[2] * z);
            for (int j = 0; j < 3; j++) {
                const v8 lh = la * h[n][j], *c = dh[j];
                k[j] = lh * u[0] + (c[1] * u[2] - c[2] * u[1]);
                k[3 + j] = lh * u[1] + (c[2] * u[0] - c[0] * u[2]);
                k[6 + j] = lh * u[2] + (c[0] * u[1] - c[1] * u[0]);
                k[4 * j] += dot;
            }
        }
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int ij = 3 * i + j, ji = 3 * j + i;
            block[1][ij] = -(block[4][ij] + block[5][ji] + block[6][ji]);
            block[2][ij] = -(block[5][ij] + block[7][ij] + block[8][ji]);
            block[3][ij] = -(block[6][ij] + block[8][ij] + block[9][ij]);
        }
    for (int i = 0; i < 9; i++)
        block[0][i] = -(block[1][i] + block[2][i] + block[3][i]);
}

/* Strain S - I as xx xy xz yy yz zz, its trace, and V psi. */
INLINE v8 strain(const v8 b[9], const material *m, v8 e[6], v8 *trace)
{
    e[0] = b[0] - 1.0, e[3] = b[4] - 1.0, e[5] = b[8] - 1.0;
    e[1] = 0.5 * (b[1] + b[3]), e[2] = 0.5 * (b[2] + b[6]), e[4] = 0.5 * (b[5] + b[7]);
    *trace = e[0] + e[3] + e[5];
    const v8 square =
        e[0] * e[0] + e[3] * e[3] + e[5] * e[5] + 2.0 * (e[1] * e[1] + e[2] * e[2] + e[4] * e[4]);
    return m->volume * (m->mu * square + 0.5 * m->lambda * *trace * *trace);
}

/* Stress of the point times its volume, in R's axes, as xx xy xz yy yz zz. */
INLINE void stress_of(const v8 eps[6], const v8 *trace, const material *m, v8 stress[6])
{
    const v8 mu2 = 2.0 * m->volume * m->mu, pressure = m->volume * m->lambda * *trace;
    for (int i = 0; i < 6; i++)
        stress[i] = mu2 * eps[i];
    stress[0] += pressure, stress[3] += pressure, stress[5] += pressure;
}

INLINE v8 von_mises(const v8 eps[6], const material *m)
{
    const v8 xy = eps[0] - eps[3], yz = eps[3] - eps[5], zx = eps[5] - eps[0];
    const v8 square =
        0.5 * (xy * xy + yz * yz + zx * zx) + 3.0 * (eps[1] * eps[1] + eps[2] * eps[2] + eps[4] * eps[4]);
    return 2.0 * m->mu * square * rsqrt(&square);
}

/* F from the corners y (x y z of each). */
INLINE void deformation(const v8 y[12], const v8 g[9], v8 f[9])
{
    for (int i = 0; i < 3; i++) {
        const v8 a = y[3 + i] - y[i], b = y[6 + i] - y[i], c = y[9 + i] - y[i];
        for (int j = 0; j < 3; j++)
            f[3 * i + j] = a * g[j] + b * g[3 + j] + c * g[6 + j];
    }
}

INLINE v8 determinant(const v8 f[9])
{
    return f[0] * (f[4] * f[8] - f[5] * f[7]) - f[1] * (f[3] * f[8] - f[5] * f[6]) +
           f[2] * (f[3] * f[7] - f[4] * f[6]);
}

/* Forces on the corners: -V R (S-stress g_a), and what balances them on corner 0. */
INLINE void corner_forces(const v8 r[9], const v8 s[6], const v8 g[9], v8 o[12])
{
    for (int a = 0; a < 3; a++) {
        const v8 *ga = g + 3 * a;
        const v8 t[3] = {s[0] * ga[0] + s[1] * ga[1] + s[2] * ga[2],
                         s[1] * ga[0] + s[3] * ga[1] + s[4] * ga[2],
                         s[2] * ga[0] + s[4] * ga[1] + s[5] * ga[2]};
        for (int i = 0; i < 3; i++)
            o[3 + 3 * a + i] = -(r[3 * i] * t[0] + r[3 * i + 1] * t[1] + r[3 * i + 2] * t[2]);
    }
    for (int i = 0; i < 3; i++)
        o[i] = -(o[3 + i] + o[6 + i] + o[9 + i]);
}

/* From lanes side by side to one lane's numbers side by side: m[i][k] and m[k][i] change places. */
INLINE void transpose(v4 *m0, v4 *m1, v4 *m2, v4 *m3)
{
    const v4 a = __builtin_shuffle(*m0, *m1, (m4){0, 4, 2, 6}),
             b = __builtin_shuffle(*m0, *m1, (m4){1, 5, 3, 7});
    const v4 c = __builtin_shuffle(*m2, *m3, (m4){0, 4, 2, 6}),
             d = __builtin_shuffle(*m2, *m3, (m4){1, 5, 3, 7});
    *m0 = __builtin_shuffle(a, c, (m4){0, 1, 4, 5}), *m2 = __builtin_shuffle(a, c, (m4){2, 3, 6, 7});
    *m1 = __builtin_shuffle(b, d, (m4){0, 1, 4, 5}), *m3 = __builtin_shuffle(b, d, (m4){2, 3, 6, 7});
}

/* Adds a block, row-major, its last number apart. */
INLINE void add_block(double *to, const v4 *low, const v4 *high, double last)
{
    *(v4 *)to += *low, *(v4 *)(to + 4) += *high, to[8] += last;
}

/* Adds n blocks of each active lane to the matrix: block k where index (of each lane `stride` numbers) says
 * at upper[k], and its transpose where it says at lower[k] (negative: nowhere). */
INLINE void scatter_blocks(const v8 (*block)[9], int n, double scale, double *value, const int *index,
                           int stride, const int *upper, const int *lower, int active)
{
    for (int k = 0; k < n; k++)
        for (int half = 0; half < 2; half++) { /* four lanes at a time */
            v4 m[8];
#pragma GCC unroll 8
            for (int i = 0; i < 8; i++)
                m[i] = scale * ((const v4 *)&block[k][i])[half];
            transpose(m, m + 1, m + 2, m + 3);
            transpose(m + 4, m + 5, m + 6, m + 7);
#pragma GCC unroll 4
            for (int i = 0; i < 4; i++) {
                const int lane = 4 * half + i;
                if (!(active >> lane & 1)) continue;
                const double last = scale * block[k][8][lane];
                add_block(value + 9 * (size_t)index[lane * stride + upper[k]], m + i, m + 4 + i, last);
                if (lower[k] < 0) continue;
                const v4 low = __builtin_shuffle(m[i], m[4 + i], (m4){0, 3, 6, 1});
                const v4 high = __builtin_shuffle(m[i], m[4 + i], (m4){4, 7, 2, 5});
                add_block(value + 9 * (size_t)index[lane * stride + lower[k]], &low, &high, last);
            }
        }
}

INLINE double sum_lanes(const v8 *a)
{
    const v8 s = *a;
    return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

/* Once a maximum is not a number it stays so, and no limit holds. Of equal ones the least element counts. */
INLINE void keep_largest(double value, int element, double *max, int *at)
{
    if (*max == *max && (!(value <= *max) || (value == *max && element < *at))) *max = value, *at = element;
}

typedef struct {
    v8 energy, growth, loss, stress; /* by lanes; growth: of the volume [m^3] */
} measure_sums;

static const cn_chunk_measures nothing_measured = {
    .volume_element = -1, .stress_element = -1, .volume_max = -1, .stress_max = -1};

/* Takes in the active lanes' V / V0, least det F and von Mises stress. */
INLINE void keep_lanes(const cn_measure_job *job, const int *elements, int active, const v8 *ratio,
                       const v8 *least, const v8 *stress, measure_sums *sums, cn_chunk_measures *out)
{
    const v8 loss = 1.0 - *ratio;
    for (int lane = 0; lane < CN_LANES; lane++) {
        if (!(active >> lane & 1)) continue;
        const int element = elements[lane];
        const double change = loss[lane];
        sums->loss[lane] += change;
        sums->stress[lane] += (*stress)[lane];
        out->inverted += !((*least)[lane] > 0);
        keep_largest(change < 0 ? -change : change, element, &out->volume_max, &out->volume_element);
        keep_largest((*stress)[lane], element, &out->stress_max, &out->stress_element);
        if (job->von_mises) job->von_mises[element] = (*stress)[lane];
    }
}

INLINE void sum_measures(const measure_sums *sums, cn_chunk_measures *out)
{
    for (int lane = 0; lane < CN_LANES; lane++) {
        out->energy += sums->energy[lane], out->growth += sums->growth[lane];
        out->volume_sum += sums->loss[lane], out->stress_sum += sums->stress[lane];
    }
}

/* For CN_KERNEL_SETS: a pair of functions, of elastic and measure of the file that includes this. */
#define KERNELS(name, attribute)                                                                             \
    attribute static void name##_elastic(void *user, int i)                                                  \
    {                                                                                                        \
        elastic(user, i);                                                                                    \
    }                                                                                                        \
    attribute static void name##_measure(void *user, int i)                                                  \
    {                                                                                                        \
        measure(user, i);                                                                                    \
    }                                                                                                        \
    static const cn_kernels name = {name##_elastic, name##_measure};

#endif
