#include "rod_spin.h"

#include <math.h>
#include "catnav/vec3.h"

void cn_spin_at(double t2, cn_spin *s)
{
    if (t2 <= 4 * CN_SPIN_SERIES) {
        const double y = 0.25 * t2, c4 = CN_SPIN_C4(y), c5 = CN_SPIN_C5(y);
        CN_SPIN_DOUBLE(y, s, c4, c5);
        return;
    }
    const double t = sqrt(t2);
    s->half = cos(0.5 * t), s->vector = sin(0.5 * t) / t;
    s->c1 = sin(t) / t, s->c2 = 2 * s->vector * s->vector, s->c3 = (1 - s->c1) / t2;
    const double c4 = (0.5 - s->c2) / t2, c5 = (1.0 / 6 - s->c3) / t2;
    s->a1 = 2 * c4 - s->c3, s->b1 = 3 * c5 - c4;
}

void cn_spin_frame(const cn_spin *s, const double theta[3], const double q0[4], double q[4])
{
    const double w = s->half, v[3] = {s->vector * theta[0], s->vector * theta[1], s->vector * theta[2]};
    const double p[4] = {q0[0], q0[1], q0[2], q0[3]};
    q[0] = w * p[0] - cn_dot(v, p + 1);
    cn_cross(v, p + 1, q + 1);
    cn_axpy(w, p + 1, q + 1);
    cn_axpy(p[0], v, q + 1);
}

void cn_spin_between(const double p[4], const double q[4], double theta[3])
{
    double d[3], w = 0;
    for (int k = 0; k < 4; k++)
        w += p[k] * q[k];
    const double *a = p + 1, *b = q + 1;
    cn_cross(a, b, d);
    for (int k = 0; k < 3; k++)
        theta[k] = p[0] * b[k] - q[0] * a[k] + d[k];
    const double sine = cn_norm(theta), angle = 2 * atan2(w < 0 ? -sine : sine, fabs(w));
    for (int k = 0; k < 3; k++)
        theta[k] *= sine > 0 ? angle / sine : 2;
}

void cn_spin_jacobian(const cn_spin *s, const double theta[3], double t[9])
{
    const double x = theta[0], y = theta[1], z = theta[2];
    t[0] = s->c1 + s->c3 * x * x, t[1] = s->c3 * x * y - s->c2 * z, t[2] = s->c3 * x * z + s->c2 * y;
    t[3] = s->c3 * x * y + s->c2 * z, t[4] = s->c1 + s->c3 * y * y, t[5] = s->c3 * y * z - s->c2 * x;
    t[6] = s->c3 * x * z - s->c2 * y, t[7] = s->c3 * y * z + s->c2 * x, t[8] = s->c1 + s->c3 * z * z;
}

void cn_spin_add_second(const cn_spin *s, const double theta[3], const double g[3], double h[9])
{
    const double along = cn_dot(theta, g), t2 = cn_norm2(theta);
    double y[3];
    cn_cross(g, theta, y);
    for (int i = 0; i < 3; i++)
        y[i] = s->a1 * y[i] - s->c3 * g[i] + s->b1 * (along * theta[i] - t2 * g[i]);
    for (int i = 0; i < 3; i++) {
        h[4 * i] += s->c3 * along;
        for (int j = 0; j < 3; j++)
            h[3 * i + j] += 0.5 * (theta[i] * y[j] + y[i] * theta[j]);
    }
}
