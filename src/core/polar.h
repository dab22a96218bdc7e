/* polar.h - nearest proper rotation R of a deformation gradient F: tr(R'F) is largest, F = R S, S symmetric
 * with at most one negative eigenvalue, the smallest in size. Quaternions are unit, w x y z; matrices
 * row-major. */
#ifndef CN_POLAR_H
#define CN_POLAR_H

/* By one-sided Jacobi SVD. A function of F alone; where several rotations are nearest, one of them; identity
 * where F is zero or not finite. */
void cn_polar(const double f[9], double q[4]);
/* As above, with the signed singular values s[0] >= s[1] >= |s[2]|. */
void cn_polar_values(const double f[9], double q[4], double s[3]);

static inline void cn_quaternion_matrix(const double q[4], double r[9])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3], t = 2 / (w * w + x * x + y * y + z * z);
    r[0] = 1 - t * (y * y + z * z), r[1] = t * (x * y - w * z), r[2] = t * (x * z + w * y);
    r[3] = t * (x * y + w * z), r[4] = 1 - t * (x * x + z * z), r[5] = t * (y * z - w * x);
    r[6] = t * (x * z - w * y), r[7] = t * (y * z + w * x), r[8] = 1 - t * (x * x + y * y);
}

#endif
