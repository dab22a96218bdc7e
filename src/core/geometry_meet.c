/* geometry_meet.c - do two triangles meet? Decided by signs of exact determinants alone.
 *
 * General position: the triangles cut the common line of their planes in two intervals, whose ends are
 * ordered by the orientation of an edge of one with an edge of the other (Guigue and Devillers, Fast and
 * Robust Triangle-Triangle Overlap Test Using Orientation Predicates, JGT 2003). Everything else (an edge or
 * a vertex in the other's plane, coplanar, zero area) goes through closed tests of edge against triangle.
 *
 * Convex sets that no plane separates weakly are those whose relative interiors meet and which do not share a
 * plane: hence two proper triangles cross exactly when both have vertices strictly on both sides of the
 * other's plane and the open intervals overlap. */
#include "geometry.h"

static void drop(const double p[3], int axis, double q[2]) /* projection along an axis */
{
    q[0] = p[(axis + 1) % 3], q[1] = p[(axis + 2) % 3];
}

static int turn(const double a[3], const double b[3], const double c[3], int axis)
{
    double p[2], q[2], r[2];
    drop(a, axis, p), drop(b, axis, q), drop(c, axis, r);
    return cn_orient2d(p, q, r);
}

/* An axis along which the plane of a b c projects one to one; -1 if they are collinear. */
static int projection(const double a[3], const double b[3], const double c[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (turn(a, b, c, axis)) return axis;
    return -1;
}

static bool between(double x, double a, double b)
{
    return (a <= x && x <= b) || (b <= x && x <= a);
}

/* Boxes of the segments pq and ab meet; for collinear points this is the segments meeting. */
static bool boxes_meet(const double p[3], const double q[3], const double a[3], const double b[3])
{
    for (int k = 0; k < 3; k++)
        if (!between(p[k], a[k], b[k]) && !between(q[k], a[k], b[k]) && !between(a[k], p[k], q[k]))
            return false;
    return true;
}

/* Coplanar, not all collinear; the axis projects their plane one to one. */
static bool coplanar_segments_meet(const double p[3], const double q[3], const double a[3], const double b[3],
                                   int axis)
{
    const int sp = turn(a, b, p, axis), sq = turn(a, b, q, axis), sa = turn(p, q, a, axis);
    const int sb = turn(p, q, b, axis);
    if (sp * sq > 0 || sa * sb > 0) return false;
    return (sp || sq || sa || sb) || boxes_meet(p, q, a, b);
}

static bool segments_meet(const double p[3], const double q[3], const double a[3], const double b[3])
{
    const double *const point[4] = {p, q, a, b};
    if (!boxes_meet(p, q, a, b) || cn_orient3d(p, q, a, b) != 0) return false;
    for (int i = 0; i < 4; i++) { /* any three that span the plane */
        const int axis = projection(point[i], point[(i + 1) % 4], point[(i + 2) % 4]);
        if (axis >= 0) return coplanar_segments_meet(p, q, a, b, axis);
    }
    return true; /* collinear */
}

/* Closed segment pq against closed triangle t; cross: pq goes through its interior from one side to the
 * other. */
static cn_tri_meet segment_triangle(const double p[3], const double q[3], const double t[3][3])
{
    const int axis = projection(t[0], t[1], t[2]);
    if (axis < 0) {
        for (int i = 0; i < 3; i++)
            if (segments_meet(p, q, t[i], t[(i + 1) % 3])) return CN_TRI_TOUCH;
        return CN_TRI_APART;
    }
    const int sp = cn_orient3d(t[0], t[1], t[2], p), sq = cn_orient3d(t[0], t[1], t[2], q);
    if (sp * sq > 0) return CN_TRI_APART;
    if (sp || sq) { /* one point in the plane: where does the line pass the three edges? */
        const int s0 = cn_orient3d(p, q, t[0], t[1]), s1 = cn_orient3d(p, q, t[1], t[2]);
        const int s2 = cn_orient3d(p, q, t[2], t[0]);
        if ((s0 < 0 || s1 < 0 || s2 < 0) && (s0 > 0 || s1 > 0 || s2 > 0)) return CN_TRI_APART;
        return sp && sq && s0 && s1 && s2 ? CN_TRI_CROSS : CN_TRI_TOUCH;
    }
    const int s0 = turn(t[0], t[1], p, axis), s1 = turn(t[1], t[2], p, axis), s2 = turn(t[2], t[0], p, axis);
    if ((s0 >= 0 && s1 >= 0 && s2 >= 0) || (s0 <= 0 && s1 <= 0 && s2 <= 0))
        return CN_TRI_TOUCH; /* p inside */
    for (int i = 0; i < 3; i++)
        if (coplanar_segments_meet(p, q, t[i], t[(i + 1) % 3], axis)) return CN_TRI_TOUCH;
    return CN_TRI_APART;
}

/* Closed triangles in special position. Only a zero-area one can cross here: as a segment. */
static cn_tri_meet special(const double a[3][3], const double b[3][3])
{
    const bool a_thin = projection(a[0], a[1], a[2]) < 0, b_thin = projection(b[0], b[1], b[2]) < 0;
    cn_tri_meet meet = CN_TRI_APART;
    for (int i = 0; i < 3; i++) {
        const cn_tri_meet ab = segment_triangle(a[i], a[(i + 1) % 3], b);
        const cn_tri_meet ba = segment_triangle(b[i], b[(i + 1) % 3], a);
        if ((a_thin && ab == CN_TRI_CROSS) || (b_thin && ba == CN_TRI_CROSS)) return CN_TRI_CROSS;
        if (ab != CN_TRI_APART || ba != CN_TRI_APART) meet = CN_TRI_TOUCH;
    }
    return meet;
}

static bool one_side(const int s[3])
{
    return (s[0] > 0 && s[1] > 0 && s[2] > 0) || (s[0] < 0 && s[1] < 0 && s[2] < 0);
}
static bool both_sides(const int s[3])
{
    return (s[0] > 0 || s[1] > 0 || s[2] > 0) && (s[0] < 0 || s[1] < 0 || s[2] < 0);
}

/* The vertex of a triangle strictly alone on its side of the other's plane (s: signs of all three). */
static int lone_vertex(const int s[3])
{
    for (int i = 0; i < 3; i++)
        if (s[i] && s[i] * s[(i + 1) % 3] <= 0 && s[i] * s[(i + 2) % 3] <= 0) return i;
    return 0;
}

cn_tri_meet cn_tri_tri(const double a[3][3], const double b[3][3])
{
    int sa[3], sb[3];
    for (int i = 0; i < 3; i++)
        sb[i] = cn_orient3d(a[0], a[1], a[2], b[i]);
    if (one_side(sb)) return CN_TRI_APART;
    for (int i = 0; i < 3; i++)
        sa[i] = cn_orient3d(b[0], b[1], b[2], a[i]);
    if (one_side(sa)) return CN_TRI_APART;
    if (!both_sides(sa) || !both_sides(sb)) return special(a, b);

    /* lone vertices p of a and u of b, both seen as on the positive side: swapping the other two turns a
     * plane over */
    const int i = lone_vertex(sa), j = lone_vertex(sb);
    const double *p = a[i], *q = a[(i + 1) % 3], *r = a[(i + 2) % 3];
    const double *u = b[j], *v = b[(j + 1) % 3], *w = b[(j + 2) % 3];
    const double *swap;
    if (sa[i] < 0) swap = v, v = w, w = swap;
    if (sb[j] < 0) swap = q, q = r, r = swap;
    const int first = cn_orient3d(p, q, u, v), last = cn_orient3d(p, r, w, u);
    if (first > 0 || last > 0) return CN_TRI_APART;
    return first && last ? CN_TRI_CROSS : CN_TRI_TOUCH;
}
