/* rod_spin.h - what a rotation vector does: with exp(theta + d) = exp(w) exp(theta),
 *
 *     w = T d + d'(dT)d / 2 + ...,    T = c1 I + c2 [theta] + c3 theta theta'    (left Jacobian of SO(3)),
 *
 * and for a spin gradient g the Hessian in theta has besides T'H T the part sym(d(T'g)/dtheta) =
 *     c3 (theta.g) I + sym(theta y'),   y = -c3 g + b1 ((theta.g) theta - t^2 g) + a1 g x theta,
 * a1 = 2 c4 - c3, b1 = 3 c5 - c4. c_k are Stumpff's functions, c_k(x) = 1/k! - x c_{k+2}(x), x = t^2 =
 * |theta|^2: c0 = cos t, c1 = sin t / t (Danby, Fundamentals of Celestial Mechanics, for the doubling of t).
 */
#ifndef CN_ROD_SPIN_H
#define CN_ROD_SPIN_H

/* Series of c4 and c5 at y (double or vector), to rounding for 0 <= y <= CN_SPIN_SERIES. */
#define CN_SPIN_SERIES 1.0
#define CN_SPIN_C4(y)                                                                                        \
    (1.0 / 24 -                                                                                              \
     (y) * (1.0 / 720 -                                                                                      \
            (y) * (1.0 / 40320 -                                                                             \
                   (y) * (1.0 / 3628800 -                                                                    \
                          (y) * (1.0 / 479001600 -                                                           \
                                 (y) * (1.0 / 87178291200 -                                                  \
                                        (y) * (1.0 / 20922789888000 - (y) * (1.0 / 6402373705728000))))))))
#define CN_SPIN_C5(y)                                                                                        \
    (1.0 / 120 -                                                                                             \
     (y) * (1.0 / 5040 -                                                                                     \
            (y) * (1.0 / 362880 -                                                                            \
                   (y) * (1.0 / 39916800 -                                                                   \
                          (y) * (1.0 / 6227020800 -                                                          \
                                 (y) * (1.0 / 1307674368000 - (y) * (1.0 / 355687428096000 -                 \
                                                                     (y) * (1.0 / 121645100408832000))))))))

/* From C4 and C5 at y = t^2 / 4: half (cos(t/2)), vector (sin(t/2) / t, the factor of theta in the
 * quaternion), c1, c2, c3, a1, b1 at t. Works on doubles and vectors. */
#define CN_SPIN_DOUBLE(y, s, C4, C5)                                                                         \
    do {                                                                                                     \
        (s)->c3 = 1.0 / 6 - (y) * (C5), (s)->c2 = 0.5 - (y) * (C4), (s)->c1 = 1.0 - (y) * (s)->c3;           \
        (s)->half = 1.0 - (y) * (s)->c2, (s)->vector = 0.5 * (s)->c1;                                        \
        (s)->b1 = 0.1875 * ((C5) + (C4) + (s)->c2 * (s)->c3) - 0.125 * ((s)->c3 + (s)->c1 * (s)->c3);        \
        (s)->a1 = 0.25 * ((s)->c3 + (s)->c1 * (s)->c3) - 0.25 * ((s)->c2 + (s)->half * (s)->c3);             \
        (s)->c3 = 0.25 * ((s)->c2 + (s)->half * (s)->c3);                                                    \
        (s)->c2 = 0.5 * (s)->c1 * (s)->c1, (s)->c1 = (s)->half * (s)->c1;                                    \
    } while (0)

typedef struct {
    double half, vector, c1, c2, c3, a1, b1;
} cn_spin;

/* At t2 = |theta|^2 [rad^2]. */
void cn_spin_at(double t2, cn_spin *s);
/* q = exp(theta) q0, unit; q may be q0. */
void cn_spin_frame(const cn_spin *s, const double theta[3], const double q0[4], double q[4]);
/* Rotation vector from unit frame p to q: q = exp(theta) p. */
void cn_spin_between(const double p[4], const double q[4], double theta[3]);
/* T, row-major. */
void cn_spin_jacobian(const cn_spin *s, const double theta[3], double t[9]);
/* Adds sym(d(T'g)/dtheta) to h. */
void cn_spin_add_second(const cn_spin *s, const double theta[3], const double g[3], double h[9]);

#endif
