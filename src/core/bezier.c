#include "catnav/bezier.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"

void cn_bezier_basis(int count, double u, double *basis)
{
    basis[0] = 1;
    for (int n = 1; n < count; n++) { /* from degree n - 1 to n */
        double before = 0;
        for (int k = 0; k <= n; k++) {
            const double here = k < n ? basis[k] : 0;
            basis[k] = (1 - u) * here + u * before;
            before = here;
        }
    }
}

/* x += s (p1 - p0): derivatives are sums over differences of control points, so that those of points that
 * coincide are exactly zero. */
static void add_difference(double s, const double p1[3], const double p0[3], double x[3])
{
    for (int c = 0; c < 3; c++)
        x[c] += s * (p1[c] - p0[c]);
}

void cn_bezier_curve(int count, const double *control, double u, double x[3], double tangent[3])
{
    double basis[CN_BEZIER_POINTS], lower[CN_BEZIER_POINTS], at[3] = {0}, slope[3] = {0};
    cn_bezier_basis(count, u, basis);
    cn_bezier_basis(count - 1, u, lower);
    for (int k = 0; k < count; k++) {
        cn_axpy(basis[k], control + 3 * k, at);
        if (k + 1 < count)
            add_difference((count - 1) * lower[k], control + 3 * (k + 1), control + 3 * k, slope);
    }
    cn_copy3(at, x);
    if (tangent) cn_copy3(slope, tangent);
}

/* Unit normal along a x b, a = dB/du and b = dB/dv at (u, v). Where one of them vanishes at the end of the
 * other's parameter, near it it is the mixed derivative times the way from that end. */
static void normal_of(const double a[3], const double b[3], const double mixed[3], double u, double v,
                      double normal[3])
{
    cn_cross(a, b, normal);
    if (cn_norm2(normal) == 0 && (v == 0 || v == 1) && cn_norm2(a) == 0) {
        cn_cross(mixed, b, normal);
        for (int c = 0; v == 1 && c < 3; c++)
            normal[c] = -normal[c];
    } else if (cn_norm2(normal) == 0 && (u == 0 || u == 1) && cn_norm2(b) == 0) {
        cn_cross(a, mixed, normal);
        for (int c = 0; u == 1 && c < 3; c++)
            normal[c] = -normal[c];
    }
    cn_normalise(normal);
}

void cn_bezier_point(int nu, int nv, const double *control, double u, double v, double x[3], double normal[3])
{
    double bu[CN_BEZIER_POINTS], bv[CN_BEZIER_POINTS], lu[CN_BEZIER_POINTS], lv[CN_BEZIER_POINTS];
    double at[3] = {0}, a[3] = {0}, b[3] = {0}, mixed[3] = {0};
    const size_t row = 3 * (size_t)nv;
    cn_bezier_basis(nu, u, bu), cn_bezier_basis(nu - 1, u, lu);
    cn_bezier_basis(nv, v, bv), cn_bezier_basis(nv - 1, v, lv);
    for (int i = 0; i < nu; i++)
        for (int j = 0; j < nv; j++) {
            const double *p = control + row * (size_t)i + 3 * j;
            cn_axpy(bu[i] * bv[j], p, at);
            if (!normal) continue;
            if (i + 1 < nu) add_difference(lu[i] * bv[j], p + row, p, a);
            if (j + 1 < nv) add_difference(bu[i] * lv[j], p + 3, p, b);
            if (i + 1 == nu || j + 1 == nv) continue;
            add_difference(lu[i] * lv[j], p + row + 3, p + row, mixed);
            add_difference(-lu[i] * lv[j], p + 3, p, mixed);
        }
    cn_copy3(at, x);
    if (normal) normal_of(a, b, mixed, u, v, normal);
}

cn_status cn_bezier_new(cn_bezier **out, int nu, int nv, int mu, int mv, cn_error *error)
{
    cn_bezier *z;
    *out = NULL;
    if (!(nu >= 2 && nv >= 2 && nu <= CN_BEZIER_POINTS && nv <= CN_BEZIER_POINTS))
        return cn_fail(error, CN_ERR_ARG, "", 0,
                       "a Bezier surface of %d x %d control points: give 2 to %d in a direction", nu, nv,
                       CN_BEZIER_POINTS);
    if (!(mu >= 1 && mv >= 1 && (mu + 1.0) * (mv + 1.0) <= 1 << 28))
        return cn_fail(error, CN_ERR_ARG, "", 0,
                       "a Bezier surface seen at %d x %d intervals: give at least one in a direction, and at "
                       "most 2^28 places",
                       mu, mv);
    const size_t n = (size_t)(mu + 1) * (size_t)nu + (size_t)(mv + 1) * (size_t)nv;
    if (!(z = calloc(1, sizeof *z))) goto fail;
    *z = (cn_bezier){
        .nu = nu, .nv = nv, .mu = mu, .mv = mv, .nvert = (mu + 1) * (mv + 1), .ntri = 2 * mu * mv};
    z->tri = cn_array(3 * (size_t)z->ntri, sizeof *z->tri);
    z->basis = cn_array(n, sizeof *z->basis);
    z->lower = cn_array(n, sizeof *z->lower);
    z->row = cn_array(6 * (size_t)(mu + 1) * (size_t)nv, sizeof *z->row);
    if (!z->tri || !z->basis || !z->lower || !z->row) goto fail;
    for (int i = 0; i <= mu + mv + 1; i++) { /* u's places, then v's */
        const bool of_u = i <= mu;
        const size_t at =
            of_u ? (size_t)i * (size_t)nu : (size_t)(mu + 1) * (size_t)nu + (size_t)(i - mu - 1) * (size_t)nv;
        const double place = of_u ? (double)i / mu : (double)(i - mu - 1) / mv;
        cn_bezier_basis(of_u ? nu : nv, place, z->basis + at);
        cn_bezier_basis((of_u ? nu : nv) - 1, place, z->lower + at);
    }
    int *tri = z->tri;
    for (int i = 0; i < mu; i++)
        for (int j = 0; j < mv; j++) {
            const int a = i * (mv + 1) + j, b = a + mv + 1;
            *tri++ = a, *tri++ = b, *tri++ = b + 1;
            *tri++ = a, *tri++ = b + 1, *tri++ = a + 1;
        }
    *out = z;
    return CN_OK;
fail:
    cn_bezier_free(z);
    return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory for a Bezier surface");
}

void cn_bezier_free(cn_bezier *bezier)
{
    if (!bezier) return;
    free(bezier->tri);
    free(bezier->basis);
    free(bezier->lower);
    free(bezier->row);
    free(bezier);
}

void cn_bezier_update(cn_bezier *z, const double *control, double *x, double *normal)
{
    const size_t nu = (size_t)z->nu, nv = (size_t)z->nv, row = 3 * nv, half = row * (size_t)(z->mu + 1);
    memset(z->row, 0, 2 * half * sizeof *z->row);
    for (size_t i = 0; i <= (size_t)z->mu; i++)
        for (size_t k = 0; k < nu; k++) {
            const double b = z->basis[i * nu + k], d = k + 1 < nu ? z->lower[i * nu + k] : 0,
                         *p = control + row * k, *next = k + 1 < nu ? p + row : p;
            double *sum = z->row + row * i, *slope = sum + half;
            for (size_t c = 0; c < row; c++)
                sum[c] += b * p[c], slope[c] += d * (next[c] - p[c]);
        }
    for (size_t i = 0; i <= (size_t)z->mu; i++)
        for (size_t j = 0; j <= (size_t)z->mv; j++) {
            const size_t of_v = (size_t)(z->mu + 1) * nu + j * nv;
            const size_t at = 3 * (i * (size_t)(z->mv + 1) + j);
            double sum[3] = {0}, along[3] = {0}, across[3] = {0}, mixed[3] = {0};
            for (size_t k = 0; k < nv; k++) {
                const double b = z->basis[of_v + k], d = z->lower[of_v + k], *p = z->row + row * i + 3 * k;
                cn_axpy(b, p, sum), cn_axpy(b, p + half, along);
                if (k + 1 == nv) continue;
                add_difference(d, p + 3, p, across);
                add_difference(d, p + half + 3, p + half, mixed);
            }
            cn_copy3(sum, x + at);
            normal_of(along, across, mixed, (double)i / z->mu, (double)j / z->mv, normal + at);
        }
}
