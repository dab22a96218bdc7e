/* predicates.c - exact signs of small determinants.
 *
 * A floating-point filter with Shewchuk's error bounds (Adaptive Precision Floating-Point Arithmetic and Fast
 * Robust Geometric Predicates, DCG 1997) decides nearly always. What it leaves open is summed without any
 * rounding in a fixed-point register that is as wide as every product of three doubles (Kulisch, Computer
 * Arithmetic and Validity, 2013): unlike expansions it neither overflows nor underflows, so the sign holds
 * for all finite doubles. */
#include "geometry.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#define UNIT_ROUNDOFF 0x1p-53
#define BOUND_2D      ((3 + 16 * UNIT_ROUNDOFF) * UNIT_ROUNDOFF)
#define BOUND_3D      ((7 + 56 * UNIT_ROUNDOFF) * UNIT_ROUNDOFF)
#define UNDERFLOW     1e-300 /* far above what gradual underflow can take from a sum of these products */

enum { NDIGIT = 208 }; /* 32 bits each: (3 * 2098 + 53 + carries) / 32, rounded up */

/* Value: sum of digit[i] * 2^(32 i - 3222); digits are signed and carried only at the end. */
typedef struct {
    int64_t digit[NDIGIT];
    int low, high; /* digits in use: low .. high - 1 */
} fixed_sum;

/* |x| = mantissa * 2^(exponent - 1074), both integers, exponent >= 0. */
static uint64_t split(double x, int *exponent, int *negative)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int field = (int)(bits >> 52 & 0x7ff);
    *negative ^= (int)(bits >> 63);
    *exponent += field ? field - 1 : 0;
    return (bits & 0xfffffffffffffULL) | (uint64_t)(field != 0) << 52;
}

/* sum += sign * x * y * z */
static void add_product(fixed_sum *sum, int sign, double x, double y, double z)
{
    int exponent = 0, negative = sign < 0;
    const uint64_t mx = split(x, &exponent, &negative), my = split(y, &exponent, &negative);
    const uint64_t mz = split(z, &exponent, &negative);
    if (!mx || !my || !mz) return;

    /* m = mx my mz, 159 bits in three words */
    const unsigned __int128 xy = (unsigned __int128)mx * my;
    const unsigned __int128 m0 = (unsigned __int128)(uint64_t)xy * mz;
    const unsigned __int128 m1 = (unsigned __int128)(uint64_t)(xy >> 64) * mz + (uint64_t)(m0 >> 64);
    const uint64_t word[4] = {(uint64_t)m0, (uint64_t)m1, (uint64_t)(m1 >> 64), 0};

    const int first = exponent / 32, shift = exponent % 32;
    uint64_t carry = 0;
    for (int i = 0; i < 6; i++) {
        const uint64_t piece = (word[i / 2] >> (i % 2 ? 32 : 0) & 0xffffffffu) << shift | carry;
        const int64_t digit = (int64_t)(piece & 0xffffffffu);
        sum->digit[first + i] += negative ? -digit : digit;
        carry = piece >> 32;
    }
    if (first < sum->low) sum->low = first;
    if (first + 6 > sum->high) sum->high = first + 6;
}

static void clear(fixed_sum *sum)
{
    memset(sum->digit, 0, sizeof sum->digit);
    sum->low = NDIGIT, sum->high = 0;
}

static int sign_of(const fixed_sum *sum)
{
    int64_t carry = 0, any = 0;
    for (int i = sum->low; i < sum->high; i++) {
        const int64_t value = sum->digit[i] + carry, rest = value & 0xffffffff;
        any |= rest;
        carry = (value - rest) / 4294967296;
    }
    return carry < 0 ? -1 : carry > 0 || any;
}

static bool all_finite(const double *const *p, int n, int dim)
{
    double zero = 0; /* 0 * x is 0 for finite x, NaN otherwise */
    for (int i = 0; i < n; i++)
        for (int j = 0; j < dim; j++)
            zero += 0 * p[i][j];
    return zero == 0;
}

/* sum += sign * det(a, b, c) */
static void add_det3(fixed_sum *sum, int sign, const double *a, const double *b, const double *c)
{
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        add_product(sum, sign, a[i], b[j], c[k]);
        add_product(sum, -sign, a[i], b[k], c[j]);
    }
}

/* det(a - d, b - d, c - d) = det(a, b, c) - det(d, b, c) - det(a, d, c) - det(a, b, d) */
static __attribute__((noinline)) int exact_3d(const double *a, const double *b, const double *c,
                                              const double *d)
{
    fixed_sum sum;
    if (!all_finite((const double *const[]){a, b, c, d}, 4, 3)) return 0;
    clear(&sum);
    add_det3(&sum, 1, a, b, c);
    add_det3(&sum, -1, d, b, c);
    add_det3(&sum, -1, a, d, c);
    add_det3(&sum, -1, a, b, d);
    return sign_of(&sum);
}

/* (b - a) x (d - c) */
static __attribute__((noinline)) int exact_2d(const double *a, const double *b, const double *c,
                                              const double *d)
{
    fixed_sum sum;
    if (!all_finite((const double *const[]){a, b, c, d}, 4, 2)) return 0;
    clear(&sum);
    for (int k = 0; k < 2; k++) {
        const int sign = k ? -1 : 1;
        add_product(&sum, sign, b[k], d[1 - k], 1);
        add_product(&sum, -sign, b[k], c[1 - k], 1);
        add_product(&sum, -sign, a[k], d[1 - k], 1);
        add_product(&sum, sign, a[k], c[1 - k], 1);
    }
    return sign_of(&sum);
}

int cn_orient3d(const double a[3], const double b[3], const double c[3], const double d[3])
{
    const double adx = a[0] - d[0], ady = a[1] - d[1], adz = a[2] - d[2];
    const double bdx = b[0] - d[0], bdy = b[1] - d[1], bdz = b[2] - d[2];
    const double cdx = c[0] - d[0], cdy = c[1] - d[1], cdz = c[2] - d[2];
    const double bc = bdx * cdy, cb = cdx * bdy, ca = cdx * ady, ac = adx * cdy, ab = adx * bdy,
                 ba = bdx * ady;
    const double det = adz * (bc - cb) + bdz * (ca - ac) + cdz * (ab - ba);
    const double permanent = (fabs(bc) + fabs(cb)) * fabs(adz) + (fabs(ca) + fabs(ac)) * fabs(bdz) +
                             (fabs(ab) + fabs(ba)) * fabs(cdz);
    const double bound = BOUND_3D * permanent + UNDERFLOW * (fabs(adz) + fabs(bdz) + fabs(cdz) + 1);
    if (det > bound) return 1;
    if (-det > bound) return -1;
    return exact_3d(a, b, c, d);
}

int cn_cross2d(const double a[2], const double b[2], const double c[2], const double d[2])
{
    const double left = (b[0] - a[0]) * (d[1] - c[1]), right = (b[1] - a[1]) * (d[0] - c[0]);
    const double det = left - right, bound = BOUND_2D * (fabs(left) + fabs(right)) + UNDERFLOW;
    if (det > bound) return 1;
    if (-det > bound) return -1;
    return exact_2d(a, b, c, d);
}

int cn_orient2d(const double a[2], const double b[2], const double c[2])
{
    return cn_cross2d(a, b, a, c);
}
