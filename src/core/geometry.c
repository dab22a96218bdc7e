/* geometry.c - distances and continuous tests of point against triangle and edge against edge.
 *
 * Both are one problem: the differences of the points of the two pieces fill a flat patch r(s, t) = r0 + s e1
 * + t e2 (a triangle s, t >= 0, s + t <= 1, or a parallelogram 0 <= s, t <= 1), and the distance is that of
 * the patch from the origin. Under straight motion r0, e1 and e2 are linear in time. */
#include "geometry.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include "catnav/vec3.h"

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

/* Below this share of |e2|^2 left after taking e1 out of e2, rounding rules the inner solution. */
#define FLAT 1e-10

typedef enum { TRIANGLE = 3, PARALLELOGRAM = 4 } patch_kind; /* number of corners */

typedef struct {
    double r0[3], e1[3], e2[3];
} patch;

typedef enum { CORNER, ALONG_E1, ALONG_E2, ALONG_DIAGONAL, INNER } feature; /* diagonal: e2 - e1 */

typedef struct {
    double s, t, r[3], square; /* parameters, place and its squared distance from the origin */
    feature where;
} nearest;

static inline double lesser(double a, double b)
{
    return a < b ? a : b;
}
static inline double greater(double a, double b)
{
    return a > b ? a : b;
}

static inline void keep_nearer(nearest *best, const patch *p, double s, double t, feature where)
{
    double r[3];
    for (int k = 0; k < 3; k++)
        r[k] = p->r0[k] + s * p->e1[k] + t * p->e2[k];
    const double square = cn_norm2(r);
    if (!(square < best->square)) return;
    best->s = s, best->t = t, best->square = square, best->where = where;
    cn_copy3(r, best->r);
}

/* The same for the edge from (s, t) by (ds, dt) with direction e and first point a. */
static inline void keep_nearer_edge(nearest *best, const patch *p, const double a[3], const double e[3],
                                    const double st[4], feature where)
{
    const double dot = -cn_dot(a, e), square = cn_norm2(e);
    const bool first = !(dot > 0), last = dot >= square;
    const double u = first ? 0 : last ? 1 : dot / square;
    keep_nearer(best, p, st[0] + u * st[2], st[1] + u * st[3], first || last ? CORNER : where);
}

/* Nearest point of the patch to the origin. The inner solution splits e2 into parts along and across e1,
 * which keeps slivers accurate; outside, only edges that the inner solution lies beyond can be nearest. */
static inline nearest nearest_on(const patch *p, patch_kind kind)
{
    nearest best = {.square = INFINITY, .r = {p->r0[0], p->r0[1], p->r0[2]}};
    const double e11 = cn_norm2(p->e1), e22 = cn_norm2(p->e2);
    double across[3], end[3], e[3], s = -1, t = -1;
    bool flat = true;

    if (e11 > 0) {
        const double along = cn_dot(p->e1, p->e2) / e11;
        for (int k = 0; k < 3; k++)
            across[k] = p->e2[k] - along * p->e1[k];
        const double height = cn_norm2(across);
        if (height > 0) {
            flat = !(height > FLAT * e22);
            t = -cn_dot(p->r0, across) / height;
            s = -cn_dot(p->r0, p->e1) / e11 - along * t;
        }
    }
    const bool over_s = kind == TRIANGLE ? s + t > 1 : s > 1, over_t = kind == PARALLELOGRAM && t > 1;
    if (s >= 0 && t >= 0 && !over_s && !over_t) {
        keep_nearer(&best, p, s, t, flat ? CORNER : INNER);
        if (!flat) return best;
    }
    if (!(s >= 0) || flat) keep_nearer_edge(&best, p, p->r0, p->e2, (double[]){0, 0, 0, 1}, ALONG_E2);
    if (!(t >= 0) || flat) keep_nearer_edge(&best, p, p->r0, p->e1, (double[]){0, 0, 1, 0}, ALONG_E1);
    if (over_s || flat) {
        cn_add(p->r0, p->e1, end);
        if (kind == TRIANGLE) {
            cn_sub(p->e2, p->e1, e);
            keep_nearer_edge(&best, p, end, e, (double[]){1, 0, -1, 1}, ALONG_DIAGONAL);
        } else
            keep_nearer_edge(&best, p, end, p->e2, (double[]){1, 0, 0, 1}, ALONG_E2);
    }
    if (over_t || (flat && kind == PARALLELOGRAM)) {
        cn_add(p->r0, p->e2, end);
        keep_nearer_edge(&best, p, end, p->e1, (double[]){0, 1, 1, 0}, ALONG_E1);
    }
    return best;
}

double cn_point_triangle(const double p[3], const double a[3], const double b[3], const double c[3],
                         double bary[3])
{
    patch difference;
    cn_sub(a, p, difference.r0), cn_sub(b, a, difference.e1), cn_sub(c, a, difference.e2);
    const nearest n = nearest_on(&difference, TRIANGLE);
    if (bary) bary[0] = n.where == ALONG_DIAGONAL ? 0 : 1 - n.s - n.t, bary[1] = n.s, bary[2] = n.t;
    return sqrt(n.square);
}

double cn_edge_edge(const double a0[3], const double a1[3], const double b0[3], const double b1[3], double *s,
                    double *t)
{
    patch difference;
    cn_sub(a0, b0, difference.r0), cn_sub(a1, a0, difference.e1), cn_sub(b0, b1, difference.e2);
    const nearest n = nearest_on(&difference, PARALLELOGRAM);
    if (s) *s = n.s;
    if (t) *t = n.t;
    return sqrt(n.square);
}

double cn_tri_tri_distance(const double a[3][3], const double b[3][3])
{
    double least = INFINITY;
    if (cn_tri_tri(a, b) != CN_TRI_APART) return 0;
    for (int i = 0; i < 3; i++) {
        least = lesser(least, cn_point_triangle(a[i], b[0], b[1], b[2], NULL));
        least = lesser(least, cn_point_triangle(b[i], a[0], a[1], a[2], NULL));
        for (int j = 0; j < 3; j++)
            least = lesser(least, cn_edge_edge(a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3], NULL, NULL));
    }
    return least;
}

/* Conservative advancement. At time t let d be the distance, r* the nearest point of the patch, n = r* / d.
 * Three bounds say how far time may run with the distance staying above the gap; each alone is safe, the
 * longest is taken.
 *  - speed: no point of the patch is faster than its fastest corner, so (d - gap) / speed
 *    (additive advancement as in Li et al., Codimensional Incremental Potential Contact, 2021);
 *  - plane: n . r is linear in time at each corner, and the patch is clear while all corners are beyond gap
 *    (Mirtich, Impulse-based Dynamic Simulation of Rigid Body Systems, 1996);
 *  - near part: split r = h n + y with y square to n, so that h >= d on the whole convex patch. With v = n .
 * v(r*) and slope the gradient of n . v over the patch's plane, after tau <= 1 / slope a point has come no
 * nearer along n than d + tau v - tau slope |y|, and across no nearer than |y| - tau speed. It is within gap
 * of the origin only if the former is below gap - (|y| - tau speed)^2 / (2 gap); over all |y| that is
 * impossible while d - gap + tau v - tau^2 (slope speed + gap slope^2 / 2) >= 0. As d falls to the gap the
 * last tends to Newton's method on the distance itself, also where the patch turns, and halves what is left
 * where the distance only grazes the gap. Rounding is bounded by eps = 16 u (longest corner + longest way),
 * added to the gap. */
enum { ADVANCES = 128 }; /* 12 are the most seen in the reference motions */

typedef struct {
    patch at, speed; /* at time 0; per step */
    patch_kind kind;
} motion;

static inline void corners_of(const patch *p, double r[4][3])
{
    cn_copy3(p->r0, r[0]);
    cn_add(p->r0, p->e1, r[1]);
    cn_add(p->r0, p->e2, r[2]);
    cn_add(r[1], p->e2, r[3]);
}

/* Gradient of n . v over the patch's plane, INFINITY where the patch has no area to speak of. */
static double slope_of(const patch *p, const patch *speed, const double n[3])
{
    const double e11 = cn_norm2(p->e1), along = cn_dot(p->e1, p->e2) / e11;
    const double g1 = cn_dot(n, speed->e1), g2 = cn_dot(n, speed->e2) - along * g1;
    double across[3];
    for (int k = 0; k < 3; k++)
        across[k] = p->e2[k] - along * p->e1[k];
    const double height = cn_norm2(across);
    if (!(height > FLAT * cn_norm2(p->e2))) return INFINITY;
    return 1.001 * sqrt(g1 * g1 / e11 + g2 * g2 / height);
}

/* Unit vector from the origin to the nearest point; square to the edge or the plane it lies in, which the
 * point itself no longer tells once it is close. */
static inline void direction(const patch *p, const nearest *near, double n[3])
{
    double e[3];
    cn_copy3(near->r, n);
    if (near->where == INNER) {
        cn_cross(p->e1, p->e2, e);
        const double side = cn_dot(e, n) < 0 ? -1 : 1;
        for (int k = 0; k < 3; k++)
            n[k] = side * e[k];
    } else if (near->where != CORNER) {
        cn_copy3(near->where == ALONG_E1 ? p->e1 : p->e2, e);
        if (near->where == ALONG_DIAGONAL) cn_sub(p->e2, p->e1, e);
        cn_axpy(-cn_dot(n, e) / cn_norm2(e), e, n);
    }
    cn_normalise(n);
}

static double advance(const motion *m, double gap)
{
    double corners[4][3], ways[4][3], size = 0, speed = 0, sum = 0, t = 0;
    bool clear = false;

    corners_of(&m->at, corners), corners_of(&m->speed, ways);
    for (int i = 0; i < (int)m->kind; i++) {
        const double r2 = cn_norm2(corners[i]), v2 = cn_norm2(ways[i]);
        size = greater(size, r2), speed = greater(speed, v2), sum += r2 + v2;
    }
    if (!(gap >= 0 && sum < INFINITY)) return 0; /* also when something is NaN */
    size = sqrt(size), speed = sqrt(speed);
    gap += 16 * DBL_EPSILON * (size + speed);

    /* boxes swept over the whole step stay apart */
    for (int k = 0; k < 3 && !clear; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < (int)m->kind; i++) {
            const double x = corners[i][k], y = x + ways[i][k];
            low = lesser(low, lesser(x, y)), high = greater(high, greater(x, y));
        }
        clear = low > gap || high < -gap;
    }
    if (clear) return INFINITY;

    for (int count = 0; count < ADVANCES; count++) {
        patch now;
        for (int k = 0; k < 3; k++) {
            now.r0[k] = m->at.r0[k] + t * m->speed.r0[k];
            now.e1[k] = m->at.e1[k] + t * m->speed.e1[k];
            now.e2[k] = m->at.e2[k] + t * m->speed.e2[k];
        }
        const nearest near = nearest_on(&now, m->kind);
        const double d = sqrt(near.square), left = 1 - t;
        if (!(d > gap)) return t;
        if (d - gap > left * speed) return INFINITY;
        double n[3];
        direction(&now, &near, n);

        double step = (d - gap) / speed, plane = INFINITY, support = INFINITY;
        for (int i = 0; i < (int)m->kind; i++) {
            const double v = cn_dot(n, ways[i]), h = cn_dot(n, corners[i]) + t * v;
            support = lesser(support, h);
            if (h - gap < -v * left) plane = lesser(plane, (h - gap) / -v);
        }
        const double room = support < d ? 2 * support - d - gap : d - gap;
        if (room > 0) {
            if (plane > left) return INFINITY;
            step = greater(step, plane);
        }

        const double slope = room > 0 ? slope_of(&now, &m->speed, n) : INFINITY;
        if (slope < INFINITY) {
            double v = cn_dot(n, m->speed.r0);
            v += near.s * cn_dot(n, m->speed.e1) + near.t * cn_dot(n, m->speed.e2);
            const double curve = slope * (speed + 0.5 * gap * slope);
            const double root = sqrt(v * v + 4 * curve * room);
            const double reach = v > 0 ? (v + root) / (2 * curve) : 2 * room / (root - v);
            step = greater(step, slope * reach < 1 ? reach : 1 / slope);
        }
        t += step;
        if (t > 1) return INFINITY;
        if (!(step > 1e-11)) return t;
    }
    return t;
}

/* The patch of x (or of d, its speed): point minus triangle turned round, or edge 0 1 minus edge 2 3. */
static inline void difference(const double x[4][3], patch_kind kind, patch *p)
{
    if (kind == TRIANGLE)
        cn_sub(x[1], x[0], p->r0), cn_sub(x[2], x[1], p->e1), cn_sub(x[3], x[1], p->e2);
    else
        cn_sub(x[0], x[2], p->r0), cn_sub(x[1], x[0], p->e1), cn_sub(x[2], x[3], p->e2);
}

static double first_time(const double x[4][3], const double d[4][3], double gap, patch_kind kind)
{
    motion m = {.kind = kind};
    difference(x, kind, &m.at), difference(d, kind, &m.speed);
    return advance(&m, gap);
}

double cn_ccd_point_triangle(const double x[4][3], const double d[4][3], double gap)
{
    return first_time(x, d, gap, TRIANGLE);
}

double cn_ccd_edge_edge(const double x[4][3], const double d[4][3], double gap)
{
    return first_time(x, d, gap, PARALLELOGRAM);
}
