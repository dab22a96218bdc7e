#include "polar.h"

#include <float.h>
#include <stdbool.h>
#include "catnav/vec3.h"

/* Unit quaternion of a rotation matrix: the largest component first (Shepperd 1978). */
static void quaternion(const double r[9], double q[4])
{
    const double trace = r[0] + r[4] + r[8];
    const double square[4] = {trace, r[0], r[4], r[8]};
    int k = 0;
    for (int i = 1; i < 4; i++)
        if (square[i] > square[k]) k = i;
    if (k == 0) {
        q[0] = 1 + trace, q[1] = r[7] - r[5], q[2] = r[2] - r[6], q[3] = r[3] - r[1];
    } else {
        const int a = k - 1, b = (a + 1) % 3, c = (a + 2) % 3;
        q[0] = r[3 * c + b] - r[3 * b + c];
        q[1 + a] = 1 + 2 * r[4 * a] - trace;
        q[1 + b] = r[3 * a + b] + r[3 * b + a];
        q[1 + c] = r[3 * a + c] + r[3 * c + a];
    }
    const double n = 1 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] *= n;
}

/* Turns columns a, b of A and V until A's are orthogonal; false when they were. Vectors are rows here. */
static bool turn(double a[3], double b[3], double va[3], double vb[3])
{
    const double aa = cn_norm2(a), bb = cn_norm2(b), ab = cn_dot(a, b);
    if (!(fabs(ab) > DBL_EPSILON * sqrt(aa) * sqrt(bb))) return false;
    const double zeta = (bb - aa) / (2 * ab);
    const double t = (zeta < 0 ? -1 : 1) / (fabs(zeta) + sqrt(1 + zeta * zeta));
    const double c = 1 / sqrt(1 + t * t), s = c * t;
    for (int i = 0; i < 3; i++) {
        const double ai = a[i], vi = va[i];
        a[i] = c * ai - s * b[i], b[i] = s * ai + c * b[i];
        va[i] = c * vi - s * vb[i], vb[i] = s * vi + c * vb[i];
    }
    return t != 0;
}

/* Unit vector along a less its part along the unit vector u; any normal to u where nothing is left. */
static void unit_normal_to(const double u[3], double a[3])
{
    for (int pass = 0; pass < 2; pass++) { /* the second removes the first one's rounding */
        const double size = fmax(fmax(fabs(a[0]), fabs(a[1])), fabs(a[2]));
        for (int i = 0; size > 0 && i < 3; i++)
            a[i] /= size;
        cn_axpy(-cn_dot(u, a), u, a);
        cn_normalise(a);
    }
    if (!(cn_norm2(a) > 0.5)) cn_any_normal(u, a);
}

void cn_polar_values(const double f[9], double q[4], double s[3])
{
    double size = 0;
    for (int i = 0; i < 9; i++)
        size = size < fabs(f[i]) || isnan(f[i]) ? fabs(f[i]) : size;
    q[0] = 1, q[1] = q[2] = q[3] = s[0] = s[1] = s[2] = 0;
    if (!(size > 0 && size <= DBL_MAX)) return;

    /* columns of F V and of V, held as rows */
    double a[3][3], v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            a[j][i] = f[3 * i + j] / size;
    for (int sweep = 0; sweep < 30; sweep++) {
        const bool first = turn(a[0], a[1], v[0], v[1]);
        const bool second = turn(a[0], a[2], v[0], v[2]);
        if (!(turn(a[1], a[2], v[1], v[2]) || first || second)) break;
    }

    /* the two longest make U's first columns, its third is their cross product: U and V are proper */
    int order[3] = {0, 1, 2};
    const double length[3] = {cn_norm(a[0]), cn_norm(a[1]), cn_norm(a[2])};
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            if (length[order[j]] < length[order[j + 1]]) {
                const int swap = order[j];
                order[j] = order[j + 1], order[j + 1] = swap;
            }
    const double odd =
        (order[1] - order[0] + 3) % 3 == 1 ? 1 : -1; /* of the permutation: turns the third v */
    double u[3][3], w[3];
    cn_copy3(a[order[0]], u[0]);
    cn_normalise(u[0]);
    cn_copy3(a[order[1]], u[1]);
    unit_normal_to(u[0], u[1]);
    cn_cross(u[0], u[1], u[2]);
    for (int i = 0; i < 3; i++)
        w[i] = odd * v[order[2]][i];

    double r[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            r[3 * i + j] = u[0][i] * v[order[0]][j] + u[1][i] * v[order[1]][j] + u[2][i] * w[j];
    quaternion(r, q);
    s[0] = size * length[order[0]];
    s[1] = size * length[order[1]];
    s[2] = size * odd * cn_dot(u[2], a[order[2]]);
}

void cn_polar(const double f[9], double q[4])
{
    double s[3];
    cn_polar_values(f, q, s);
}
