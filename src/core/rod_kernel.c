/* rod_kernel.c - a rod's energy, forces and stiffness, eight segments at a time (GCC vector extensions).
 *
 * Spins w_i, w_j of the two frames (q -> exp(w/2) q), s = w_i + w_j, d = w_j - w_i, all vectors in space.
 * With c, b the scalar and vector part of conj(q_i) q_j (c >= 0 by the sign of q_j), b turned by the middle
 * frame R, tau = b / (1 + c) = tan(phi/4) n and e = p_j - p_i, the middle frame turns by mu = (s + d x tau) /
 * 2 + (d x (s x tau) + (d x tau)(d.tau)) / 8, and b changes, in the middle frame, by A d / 2 - b |d|^2 / 8 -
 * A (w_i x w_j) / 4, A = I - b b' / (1 + c). (From the product of quaternions; exact to second order.) With
 * section force n and moment M, a = n x e, g = tau x a, m = Y M, Y = sigma I + rho b b', rho = 2 c sigma' -
 * sigma / (1 + c): dE/dw_i = (a - g)/2 - m,   dE/dw_j = (a + g)/2 + m,   dE/dp_j = n, and the Hessian in (e,
 * s, d), C the section's stiffness in space, ee C/L,  es B/2,  ed -B[tau]/2,  ss D/4,  sd -D[tau]/4 + (a tau'
 * - (a.tau) I)/8 + [m]/4, dd [tau]'D[tau]/4 + (g tau' + tau g')/8 + K, B = C/L [e] - [n],  D = [e]'C/L [e] +
 * (n e' + e n')/2 - (n.e) I,  [v] u = v x u, K = Y E Y / L + c sigma' (b M' + M b') + (2 c^2 sigma'' - sigma'
 * (1 + 2c/(1+c))) (b.M) b b'
 *         + (b.M) (c^2 sigma' - sigma/2) I.
 * EXACT: that, taken from spins to rotation vectors by rod_spin.h. PROJECTED and WARPED: its part in C and E
 * (B'CB of the strains, positive semidefinite), without n, a, g, m, M.
 *
 * A chunk's tasks write the matrix rows and forces of their own nodes, but blocks between two nodes by the
 * segment's: each number by one task alone. */
#include "kernel_sets.h"
#include "rod.h"

#include <limits.h>
#include <string.h>
#include "rod_spin.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are returned by inlined functions only */
#pragma GCC optimize("O3")               /* small loops over axes are to be unrolled */

typedef double v8 __attribute__((vector_size(64), may_alias));
typedef double u8 __attribute__((vector_size(64), may_alias, aligned(8)));
typedef long long m8 __attribute__((vector_size(64), may_alias)); /* -1: true */
typedef double v4 __attribute__((vector_size(32), may_alias, aligned(8)));
typedef long long m4 __attribute__((vector_size(32)));
#define INLINE static inline __attribute__((always_inline))

/* a chunk's nodes by columns, the one before its first at 0 */
enum { COLUMNS = CN_ROD_CHUNK + 1 + 2 * CN_ROD_LANES };
typedef struct {
    double place[3][COLUMNS], theta[3][COLUMNS], frame[4][COLUMNS], jacobian[9][COLUMNS];
    double c3[COLUMNS], a1[COLUMNS], b1[COLUMNS];
} nodes;

INLINE int all(const m8 *mask)
{
    const m8 a = *mask;
    return (a[0] & a[1] & a[2] & a[3] & a[4] & a[5] & a[6] & a[7]) != 0;
}
INLINE v8 dot(const v8 a[3], const v8 b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
INLINE void cross(const v8 a[3], const v8 b[3], v8 c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
INLINE void times(const v8 m[9], const v8 a[3], v8 b[3])
{
    for (int i = 0; i < 3; i++)
        b[i] = m[3 * i] * a[0] + m[3 * i + 1] * a[1] + m[3 * i + 2] * a[2];
}
INLINE void transposed(const v8 m[9], const v8 a[3], v8 b[3])
{
    for (int i = 0; i < 3; i++)
        b[i] = m[i] * a[0] + m[3 + i] * a[1] + m[6 + i] * a[2];
}
INLINE void product(const v8 a[9], const v8 b[9], v8 c[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}
INLINE void transposed_product(const v8 a[9], const v8 b[9], v8 c[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[3 * i + j] = a[i] * b[j] + a[3 + i] * b[3 + j] + a[6 + i] * b[6 + j];
}

/* Symmetric matrices are xx xy xz yy yz zz. */
static const int full_of[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};

/* R diag(c) R' */
INLINE void turned_diagonal(const v8 r[9], const v8 c[3], v8 m[6])
{
    for (int i = 0, k = 0; i < 3; i++) {
        const v8 x = r[3 * i] * c[0], y = r[3 * i + 1] * c[1], z = r[3 * i + 2] * c[2];
        for (int j = i; j < 3; j++, k++)
            m[k] = x * r[3 * j] + y * r[3 * j + 1] + z * r[3 * j + 2];
    }
}
/* M += a b' + b a' */
INLINE void add_pair(const v8 a[3], const v8 b[3], v8 m[6])
{
    for (int i = 0, k = 0; i < 3; i++)
        for (int j = i; j < 3; j++, k++)
            m[k] += a[i] * b[j] + b[i] * a[j];
}
INLINE void add_identity(const v8 *s, v8 m[6])
{
    m[0] += *s, m[3] += *s, m[5] += *s;
}

/* Places, frames and Jacobians of n nodes from `first` on; where there is none, numbers that give no force
 * (segments there have no stiffness). */
INLINE void load_nodes(const cn_rod_job *job, int first, int n, nodes *node)
{
    const double *theta = job->x + 3 * (size_t)job->body->nnode;
    for (int k = 0; k < n; k++) {
        const int i = first + k, there = i >= 0 && i < job->nactive;
        static const double none[4] = {1, 0, 0, 0};
        const double *p = there ? job->x + 3 * (size_t)i : none + 1,
                     *w = there ? theta + 3 * (size_t)i : none + 1;
        const double *q = there ? job->rotation + 4 * (size_t)i : none;
        for (int j = 0; j < 3; j++)
            node->place[j][k] = p[j], node->theta[j][k] = w[j];
        for (int j = 0; j < 4; j++)
            node->frame[j][k] = q[j];
    }
    for (int k = 0; k < n; k += CN_ROD_LANES) {
        struct {
            v8 half, vector, c1, c2, c3, a1, b1;
        } s;
        v8 t[3], p[4], v[3];
        for (int j = 0; j < 3; j++)
            t[j] = *(const u8 *)(node->theta[j] + k);
        for (int j = 0; j < 4; j++)
            p[j] = *(const u8 *)(node->frame[j] + k);
        const v8 t2 = dot(t, t), y = 0.25 * t2, c4 = CN_SPIN_C4(y), c5 = CN_SPIN_C5(y);
        CN_SPIN_DOUBLE(y, &s, c4, c5);
        const m8 small = y <= CN_SPIN_SERIES;
        for (int lane = 0; !all(&small) && lane < CN_ROD_LANES; lane++)
            if (!small[lane]) {
                cn_spin one;
                cn_spin_at(t2[lane], &one);
                s.half[lane] = one.half, s.vector[lane] = one.vector, s.c1[lane] = one.c1;
                s.c2[lane] = one.c2, s.c3[lane] = one.c3, s.a1[lane] = one.a1, s.b1[lane] = one.b1;
            }
        for (int j = 0; j < 3; j++)
            v[j] = s.vector * t[j];
        *(u8 *)(node->frame[0] + k) = s.half * p[0] - dot(v, p + 1);
        v8 vp[3];
        cross(v, p + 1, vp);
        for (int j = 0; j < 3; j++)
            *(u8 *)(node->frame[1 + j] + k) = s.half * p[1 + j] + p[0] * v[j] + vp[j];
        if (!job->f) continue;
        *(u8 *)(node->c3 + k) = s.c3, *(u8 *)(node->a1 + k) = s.a1, *(u8 *)(node->b1 + k) = s.b1;
        for (int i = 0; i < 3; i++) {
            const int l = (i + 1) % 3, m = (i + 2) % 3;
            const v8 off = s.c3 * t[l] * t[m], turn = s.c2 * t[i];
            *(u8 *)(node->jacobian[4 * i] + k) = s.c1 + s.c3 * t[i] * t[i];
            *(u8 *)(node->jacobian[3 * l + m] + k) = off - turn;
            *(u8 *)(node->jacobian[3 * m + l] + k) = off + turn;
        }
    }
}

/* A batch of segments. */
typedef struct {
    v8 r[9], e[3], b[3], c, inverse; /* middle frame; b in it */
    v8 force[3], moment[3];          /* in it */
    v8 sigma, slope, bend;           /* sigma and its derivatives by z */
    v8 stiff[3], stiff_bend[3];      /* diagonals of C and E */
    v8 strain[6], energy;
} segments;

/* bent: the share of kappa_0 in force. */
INLINE void strains(const cn_rod *rod, double bent, int first, const nodes *node, int k, segments *s)
{
    const double *constant = rod->constant + 1 + first + k;
    v8 c[CN_ROD_CONSTANTS], p[4], q[4], v[3], pq[3], m[4];
    for (int i = 0; i < CN_ROD_CONSTANTS; i++)
        c[i] = *(const u8 *)(constant + (size_t)i * (size_t)rod->stride);
    for (int i = 0; i < 4; i++)
        p[i] = *(const u8 *)(node->frame[i] + k), q[i] = *(const u8 *)(node->frame[i] + k + 1);
    const v8 inner = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
    const m8 sign = (m8)inner & ((m8){0} + LLONG_MIN); /* -q is the same frame */
    for (int i = 0; i < 4; i++)
        q[i] = (v8)((m8)q[i] ^ sign), m[i] = p[i] + q[i];
    s->c = (v8)((m8)inner ^ sign);
    cross(p + 1, q + 1, pq);
    for (int i = 0; i < 3; i++) {
        s->b[i] = p[0] * q[1 + i] - q[0] * p[1 + i] - pq[i];
        s->e[i] = *(const u8 *)(node->place[i] + k + 1) - *(const u8 *)(node->place[i] + k);
    }
    const v8 t = 2.0 / (m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + m[3] * m[3]);
    const v8 x = t * m[1], y = t * m[2], w = t * m[3];
    const v8 wx = x * m[0], wy = y * m[0], wz = w * m[0], xx = x * m[1], xy = x * m[2], xz = x * m[3],
             yy = y * m[2], yz = y * m[3], zz = w * m[3];
    v8 *r = s->r;
    r[0] = 1.0 - (yy + zz), r[1] = xy - wz, r[2] = xz + wy;
    r[3] = xy + wz, r[4] = 1.0 - (xx + zz), r[5] = yz - wx;
    r[6] = xz - wy, r[7] = yz + wx, r[8] = 1.0 - (xx + yy);

    const v8 z = dot(s->b, s->b), inverse = c[CN_ROD_INVERSE];
    s->sigma = 1.0 + z * (1.0 / 6 + z * (3.0 / 40 + z * (5.0 / 112 + z * (35.0 / 1152 + z * (63.0 / 2816)))));
    s->slope = 1.0 / 6 + z * (3.0 / 20 + z * (15.0 / 112 + z * (35.0 / 288 + z * (315.0 / 2816))));
    s->bend = 3.0 / 20 + z * (15.0 / 56 + z * (35.0 / 96 + z * (315.0 / 704)));
    /* the rest of the series as a geometric one: below 1e-5 up to 60 degrees a segment, and without end
     * before it would fold right over, where the middle frame has no sense */
    const v8 over = 1.0 - z, least = over * 0.0 + 1e-16; /* c^2; empty lanes have no frame, and c = 0 */
    const m8 above = over > least;
    const v8 pole = 1.0 / (v8)((above & (m8)over) | (~above & (m8)least)), z4 = z * z * z * z,
             last = 231.0 / 13312 * z4 * pole;
    s->sigma += last * z * z;
    s->slope += last * z * (6.0 + z * pole);
    s->bend += last * (30.0 + z * pole * (12.0 + 2.0 * z * pole));
    s->inverse = inverse;
    transposed(r, s->e, v);
    const v8 twice = 2.0 * s->sigma * inverse;
    for (int i = 0; i < 3; i++) {
        s->stiff[i] = c[CN_ROD_FORCE + i], s->stiff_bend[i] = c[CN_ROD_MOMENT + i];
        s->strain[i] = v[i] * inverse - c[CN_ROD_STRETCH + i];
        s->strain[3 + i] = twice * s->b[i] - bent * c[CN_ROD_BEND + i];
        s->force[i] = s->stiff[i] * s->strain[i];
        s->moment[i] = s->stiff_bend[i] * s->strain[3 + i];
    }
    s->energy = 0.5 * c[CN_ROD_LENGTH] * (dot(s->strain, s->force) + dot(s->strain + 3, s->moment));
}

/* What a batch of segments gives to its nodes, in spins. */
typedef struct {
    v8 n[3], left[3], right[3];                  /* dE/dp_j, dE/dw_i, dE/dw_j */
    v8 ee[6], ei[9], ej[9], ii[6], jj[6], ij[9]; /* Hessian in e = p_j - p_i, w_i, w_j */
} pieces;

INLINE void forces(const segments *s, v8 tau[3], v8 a[3], v8 g[3], v8 m[3], pieces *out)
{
    v8 local[3];
    const v8 share = 1.0 / (1.0 + s->c), along = dot(s->b, s->moment);
    const v8 rho = 2.0 * s->c * s->slope - s->sigma * share;
    for (int i = 0; i < 3; i++)
        local[i] = s->sigma * s->moment[i] + rho * along * s->b[i];
    times(s->r, local, m);
    times(s->r, s->b, tau);
    for (int i = 0; i < 3; i++)
        tau[i] *= share;
    times(s->r, s->force, out->n);
    cross(out->n, s->e, a);
    cross(tau, a, g);
    for (int i = 0; i < 3; i++) {
        out->left[i] = 0.5 * (a[i] - g[i]) - m[i];
        out->right[i] = 0.5 * (a[i] + g[i]) + m[i];
    }
}

/* `exact` 1, or 0 for the part in C and E. */
INLINE void hessian(const segments *s, const v8 tau[3], const v8 a0[3], const v8 g0[3], const v8 m0[3],
                    double exact, pieces *out)
{
    const v8 share = 1.0 / (1.0 + s->c), rho = 2.0 * s->c * s->slope - s->sigma * share;
    const v8 c2 = s->c * s->c, along = exact * dot(s->b, s->moment);
    const v8 along_stiff = s->b[0] * s->b[0] * s->stiff_bend[0] + s->b[1] * s->b[1] * s->stiff_bend[1] +
                           s->b[2] * s->b[2] * s->stiff_bend[2];
    v8 n[3], a[3], g[3], m[3], k[6], stiff[3], y[3], turned[3], b[3], x[9], d[6], dt[9], nt[9], sd[9];
    for (int i = 0; i < 3; i++)
        n[i] = exact * out->n[i], a[i] = exact * a0[i], g[i] = exact * g0[i], m[i] = exact * m0[i];

    /* K in space */
    const v8 y_stiff = s->sigma * rho * s->inverse, y_moment = exact * s->c * s->slope;
    const v8 y_b =
        0.5 * rho * rho * along_stiff * s->inverse + along * (c2 * s->bend - s->slope * (0.5 + s->c * share));
    const v8 sigma2 = s->sigma * s->sigma * s->inverse;
    for (int i = 0; i < 3; i++) {
        stiff[i] = sigma2 * s->stiff_bend[i];
        y[i] = y_stiff * s->stiff_bend[i] * s->b[i] + y_moment * s->moment[i] + y_b * s->b[i];
        b[i] = tau[i] * (1.0 + s->c);
    }
    turned_diagonal(s->r, stiff, k);
    times(s->r, y, turned);
    add_pair(b, turned, k);
    const v8 isotropic = along * (c2 * s->slope - 0.5 * s->sigma);
    add_identity(&isotropic, k);

    for (int i = 0; i < 3; i++)
        stiff[i] = s->inverse * s->stiff[i];
    turned_diagonal(s->r, stiff, out->ee);
    for (int i = 0; i < 3; i++) { /* x = C/L [e]: a row of M [e] is that of M times e */
        const v8 row[3] = {out->ee[full_of[3 * i]], out->ee[full_of[3 * i + 1]], out->ee[full_of[3 * i + 2]]};
        cross(row, s->e, x + 3 * i);
    }
    v8 column[3][3];
    for (int j = 0; j < 3; j++) { /* a column of [e]' M is that of M times e */
        const v8 xj[3] = {x[j], x[3 + j], x[6 + j]};
        cross(xj, s->e, column[j]);
    }
    for (int i = 0, l = 0; i < 3; i++)
        for (int j = i; j < 3; j++, l++)
            d[l] = column[j][i] + 0.5 * (n[i] * s->e[j] + s->e[i] * n[j]);
    const v8 tension = -dot(n, s->e);
    add_identity(&tension, d);
    x[1] += n[2], x[2] -= n[1], x[3] -= n[2], x[5] += n[0], x[6] += n[1], x[7] -= n[0];

    const v8 trace = 0.125 * dot(a, tau);
    for (int i = 0; i < 3; i++) {
        const v8 row[3] = {d[full_of[3 * i]], d[full_of[3 * i + 1]], d[full_of[3 * i + 2]]};
        cross(x + 3 * i, tau, nt + 3 * i);
        cross(row, tau, dt + 3 * i);
    }
    for (int i = 0; i < 9; i++) {
        out->ei[i] = 0.5 * (x[i] + nt[i]), out->ej[i] = 0.5 * (x[i] - nt[i]);
        sd[i] = 0.125 * a[i / 3] * tau[i % 3] - 0.25 * dt[i];
    }
    sd[0] -= trace, sd[4] -= trace, sd[8] -= trace;
    sd[1] -= 0.25 * m[2], sd[2] += 0.25 * m[1], sd[3] += 0.25 * m[2];
    sd[5] -= 0.25 * m[0], sd[6] -= 0.25 * m[1], sd[7] += 0.25 * m[0];
    for (int j = 0; j < 3; j++) {
        const v8 dtj[3] = {dt[j], dt[3 + j], dt[6 + j]};
        cross(dtj, tau, column[j]);
    }
    for (int i = 0, l = 0; i < 3; i++)
        for (int j = i; j < 3; j++, l++) {
            const v8 dd = k[l] + 0.25 * column[j][i] + 0.125 * (g[i] * tau[j] + tau[i] * g[j]);
            const v8 ss = 0.25 * d[l], upper = sd[3 * i + j], lower = sd[3 * j + i];
            out->ii[l] = (ss + dd) - (upper + lower);
            out->jj[l] = (ss + dd) + (upper + lower);
            out->ij[3 * i + j] = (ss - dd) + (upper - lower);
            out->ij[3 * j + i] = (ss - dd) + (lower - upper);
        }
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

/* Adds a block of each lane in [begin, end) to the matrix at index[lane][at], and its transpose at
 * index[lane][mirror] (mirror < 0: it has none). */
INLINE void add_block(const v8 block[9], double *value, const int (*index)[CN_ROD_BLOCKS], int begin, int end,
                      int at, int mirror)
{
    for (int half = 0; half < 2; half++) {
        v4 m[8];
        for (int i = 0; i < 8; i++)
            m[i] = ((const v4 *)&block[i])[half];
        transpose(m, m + 1, m + 2, m + 3);
        transpose(m + 4, m + 5, m + 6, m + 7);
        for (int i = 0; i < 4; i++) {
            const int lane = 4 * half + i;
            if (lane < begin || lane >= end) continue;
            double *to = value + 9 * (size_t)index[lane][at];
            *(v4 *)to += m[i], *(v4 *)(to + 4) += m[4 + i], to[8] += block[8][lane];
            if (mirror < 0) continue;
            to = value + 9 * (size_t)index[lane][mirror];
            *(v4 *)to += __builtin_shuffle(m[i], m[4 + i], (m4){0, 3, 6, 1});
            *(v4 *)(to + 4) += __builtin_shuffle(m[i], m[4 + i], (m4){4, 7, 2, 5});
            to[8] += block[8][lane];
        }
    }
}

/* The numbers of the segments before these: `last` is the batch before. */
INLINE v8 before(const v8 *last, const v8 *now)
{
    return __builtin_shuffle(*last, *now, (m8){7, 8, 9, 10, 11, 12, 13, 14});
}

INLINE void load_jacobian(const nodes *node, int k, v8 t[9])
{
    for (int i = 0; i < 9; i++)
        t[i] = *(const u8 *)(node->jacobian[i] + k);
}

/* Forces on the nodes at the near end of a batch's segments, lanes [begin, end). */
INLINE void add_forces(const cn_rod_job *job, const pieces *now, const pieces *last, const v8 ti[9],
                       v8 spin[3], int node0, int begin, int end)
{
    double push[6][CN_ROD_LANES] __attribute__((aligned(64)));
    double *turn = job->f + 3 * (size_t)job->body->nnode;
    v8 theta[3];
    for (int i = 0; i < 3; i++) {
        spin[i] = now->left[i] + before(last->right + i, now->right + i);
        *(v8 *)push[i] = now->n[i] - before(last->n + i, now->n + i);
    }
    transposed(ti, spin, theta);
    for (int i = 0; i < 3; i++)
        *(v8 *)push[3 + i] = -theta[i];
    for (int lane = begin; lane < end; lane++) {
        const size_t at = 3 * (size_t)(node0 + lane);
        for (int i = 0; i < 3; i++)
            job->f[at + (size_t)i] += push[i][lane], turn[at + (size_t)i] += push[3 + i][lane];
    }
}

INLINE void expand(const v8 m[6], const v8 *scale, v8 full[9])
{
    for (int i = 0; i < 9; i++)
        full[i] = *scale * m[full_of[i]];
}

/* Blocks of those nodes' rows, lanes [begin, end), and of the segments' themselves, lanes [begin, whole). ej
 * of both batches is already times T_j. */
INLINE void add_stiffness(const cn_rod_job *job, const pieces *now, const pieces *last, const nodes *node,
                          int k, const v8 ti[9], const v8 tj[9], const v8 spin[3], int node0, int begin,
                          int end, int whole)
{
    double *value = job->stiffness->matrix->value;
    const int(*index)[CN_ROD_BLOCKS] = (const int(*)[CN_ROD_BLOCKS])job->stiffness->block + node0;
    const v8 scale = job->scale - (v8){0}, minus = -scale;
    v8 block[9], work[9], eit[9], half[6];

    for (int i = 0; i < 6; i++)
        half[i] = now->ee[i] + before(last->ee + i, now->ee + i);
    expand(half, &scale, block);
    add_block(block, value, index, begin, end, CN_ROD_II, -1);
    expand(now->ee, &minus, block);
    add_block(block, value, index, begin, whole, CN_ROD_IJ, CN_ROD_JI);

    product(now->ei, ti, eit);
    for (int i = 0; i < 9; i++)
        block[i] = scale * (before(last->ej + i, now->ej + i) - eit[i]);
    add_block(block, value, index, begin, end, CN_ROD_II + 1, CN_ROD_II + 2);
    for (int i = 0; i < 9; i++)
        block[i] = minus * now->ej[i];
    add_block(block, value, index, begin, whole, CN_ROD_IJ + 1, CN_ROD_JI + 2);
    for (int i = 0; i < 9; i++)
        block[i] = scale * eit[i];
    add_block(block, value, index, begin, whole, CN_ROD_JI + 1, CN_ROD_IJ + 2);

    for (int i = 0; i < 6; i++)
        half[i] = now->ii[i] + before(last->jj + i, now->jj + i);
    v8 full[9];
    expand(half, &scale, full);
    product(full, ti, work);
    transposed_product(ti, work, block);
    if (job->tangent == CN_TANGENT_EXACT) {
        v8 t[3], y[3], g[3];
        for (int i = 0; i < 3; i++)
            t[i] = *(const u8 *)(node->theta[i] + k), g[i] = scale * spin[i];
        const v8 c3 = *(const u8 *)(node->c3 + k), a1 = *(const u8 *)(node->a1 + k),
                 b1 = *(const u8 *)(node->b1 + k), along = dot(t, g), t2 = dot(t, t);
        cross(g, t, y);
        for (int i = 0; i < 3; i++)
            y[i] = 0.5 * (a1 * y[i] - c3 * g[i] + b1 * (along * t[i] - t2 * g[i]));
        for (int i = 0; i < 3; i++) {
            block[4 * i] += c3 * along;
            for (int j = 0; j < 3; j++)
                block[3 * i + j] += t[i] * y[j] + y[i] * t[j];
        }
    }
    for (int i = 0; i < 3; i++) /* symmetric to the last bit */
        for (int j = 0; j < i; j++)
            block[3 * i + j] = block[3 * j + i];
    add_block(block, value, index, begin, end, CN_ROD_II + 3, -1);
    product(now->ij, tj, work);
    transposed_product(ti, work, block);
    for (int i = 0; i < 9; i++)
        block[i] *= scale;
    add_block(block, value, index, begin, whole, CN_ROD_IJ + 3, CN_ROD_JI + 3);
}

INLINE double chunk_elastic(const cn_rod_job *job, int chunk, cn_rod_strains *strain)
{
    const cn_rod *rod = job->body->own;
    const int first = chunk * CN_ROD_CHUNK - 1; /* segment and node at column 0 */
    const int stop = first + 1 + CN_ROD_CHUNK < job->nactive ? first + 1 + CN_ROD_CHUNK : job->nactive;
    nodes node;
    pieces piece[2];
    v8 energy = {0};
    const int columns = (stop - first + CN_ROD_LANES - 1) / CN_ROD_LANES * CN_ROD_LANES;
    load_nodes(job, first, columns + CN_ROD_LANES, &node);
    memset(&piece[1], 0, sizeof piece[1]);
    for (int k = 0; k < columns; k += CN_ROD_LANES) {
        pieces *now = &piece[k / CN_ROD_LANES % 2], *last = &piece[1 - k / CN_ROD_LANES % 2];
        segments s;
        strains(rod, job->rotation[4 * (size_t)job->body->nnode], first, &node, k, &s);
        /* segment `first` is the chunk's before; a segment behind the last active node is none */
        const int begin = k == 0, end = stop - first - k < CN_ROD_LANES ? stop - first - k : CN_ROD_LANES;
        const int whole = job->nactive - 1 - (first + k) < end ? job->nactive - 1 - (first + k) : end;
        m8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
        const m8 counts = (lane >= begin) & (lane < whole);
        energy += (v8)(counts & (m8)s.energy);
        if (strain) {
            for (int i = 0; i < 6; i++)
                *(u8 *)((*strain)[i] + k) = s.strain[i];
            *(u8 *)((*strain)[6] + k) = s.energy;
        }
        if (!job->f) continue;
        const m8 there = lane < whole; /* the rest has no stiffness but in the body that is longer */
        for (int i = 0; i < 3; i++) {
            s.force[i] = (v8)(there & (m8)s.force[i]), s.moment[i] = (v8)(there & (m8)s.moment[i]);
            s.stiff[i] = (v8)(there & (m8)s.stiff[i]);
            s.stiff_bend[i] = (v8)(there & (m8)s.stiff_bend[i]);
        }
        v8 tau[3], a[3], g[3], m[3], ti[9], tj[9], spin[3];
        forces(&s, tau, a, g, m, now);
        load_jacobian(&node, k, ti);
        add_forces(job, now, last, ti, spin, first + k, begin, end);
        if (!job->stiffness) continue;
        hessian(&s, tau, a, g, m, job->tangent == CN_TANGENT_EXACT, now);
        load_jacobian(&node, k + 1, tj);
        v8 ejt[9];
        product(now->ej, tj, ejt);
        memcpy(now->ej, ejt, sizeof ejt);
        add_stiffness(job, now, last, &node, k, ti, tj, spin, first + k, begin, end, whole);
    }
    return ((energy[0] + energy[1]) + (energy[2] + energy[3])) +
           ((energy[4] + energy[5]) + (energy[6] + energy[7]));
}

/* One function an instruction set. */
#define KERNEL(name, attribute)                                                                              \
    attribute static double name(const cn_rod_job *job, int chunk, cn_rod_strains *strain)                   \
    {                                                                                                        \
        return chunk_elastic(job, chunk, strain);                                                            \
    }

CN_KERNEL_SETS(KERNEL, cn_rod_kernel, cn_rod_kernel_pick)
