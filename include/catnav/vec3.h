/* vec3.h - inline 3-vectors and 3x3 matrices (row-major double[9]). */
#ifndef CN_VEC3_H
#define CN_VEC3_H

#include <math.h>
#include <stdbool.h>

static inline double cn_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline void cn_sub(const double a[3], const double b[3], double c[3]) /* c = a - b */
{
    c[0] = a[0] - b[0], c[1] = a[1] - b[1], c[2] = a[2] - b[2];
}
static inline void cn_add(const double a[3], const double b[3], double c[3]) /* c = a + b */
{
    c[0] = a[0] + b[0], c[1] = a[1] + b[1], c[2] = a[2] + b[2];
}
static inline void cn_axpy(double s, const double a[3], double b[3]) /* b += s a */
{
    b[0] += s * a[0], b[1] += s * a[1], b[2] += s * a[2];
}
static inline void cn_copy3(const double a[3], double b[3])
{
    b[0] = a[0], b[1] = a[1], b[2] = a[2];
}
static inline void cn_cross(const double a[3], const double b[3], double c[3]) /* c != a, b */
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
static inline double cn_norm2(const double a[3])
{
    return cn_dot(a, a);
}
static inline double cn_norm(const double a[3])
{
    return sqrt(cn_dot(a, a));
}
static inline double cn_distance(const double a[3], const double b[3])
{
    double d[3];
    cn_sub(a, b, d);
    return cn_norm(d);
}
static inline double cn_normalise(double a[3]) /* returns the old length; zero stays zero */
{
    const double n = cn_norm(a);
    if (n > 0) a[0] /= n, a[1] /= n, a[2] /= n;
    return n;
}
static inline void cn_mat_vec(const double m[9], const double a[3], double b[3]) /* b = M a, b != a */
{
    for (int i = 0; i < 3; i++)
        b[i] = m[3 * i] * a[0] + m[3 * i + 1] * a[1] + m[3 * i + 2] * a[2];
}
static inline void cn_mat_vec_transposed(const double m[9], const double a[3], double b[3]) /* b = M' a */
{
    for (int k = 0; k < 3; k++)
        b[k] = m[k] * a[0] + m[3 + k] * a[1] + m[6 + k] * a[2];
}
static inline void cn_mat_mul(const double a[9], const double b[9], double c[9]) /* C = A B, C != A, B */
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}
static inline double cn_det(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}
/* Rotation matrix of a rotation vector [rad] (Rodrigues). */
static inline void cn_rotation(const double w[3], double r[9])
{
    const double t = cn_norm(w), s = t > 1e-8 ? sin(t) / t : 1 - t * t / 6;
    const double c = t > 1e-4 ? (1 - cos(t)) / (t * t) : 0.5 - t * t / 24;
    const double x = w[0], y = w[1], z = w[2];
    r[0] = 1 - c * (y * y + z * z), r[1] = -s * z + c * x * y, r[2] = s * y + c * x * z;
    r[3] = s * z + c * x * y, r[4] = 1 - c * (x * x + z * z), r[5] = -s * x + c * y * z;
    r[6] = -s * y + c * x * z, r[7] = s * x + c * y * z, r[8] = 1 - c * (x * x + y * y);
}
/* A unit vector normal to the unit vector t. */
static inline void cn_any_normal(const double t[3], double n[3])
{
    const int k =
        fabs(t[0]) < fabs(t[1]) ? (fabs(t[0]) < fabs(t[2]) ? 0 : 2) : (fabs(t[1]) < fabs(t[2]) ? 1 : 2);
    double e[3] = {0, 0, 0};
    e[k] = 1;
    cn_cross(t, e, n);
    cn_normalise(n);
}
/* Boxes of a scene are closed, with a tolerance of 1e-9 of their size. */
static inline bool cn_in_box(const double box[2][3], const double p[3])
{
    const double slack = 1e-9 * cn_distance(box[0], box[1]);
    for (int k = 0; k < 3; k++)
        if (!(p[k] >= box[0][k] - slack && p[k] <= box[1][k] + slack)) return false;
    return true;
}
#endif
