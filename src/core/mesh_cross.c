/* mesh_cross.c - where a surface crosses itself, decided by exact predicates. Triangles that share a vertex
 * cross where the edge opposite to it meets the other triangle; those that share an edge where they lie
 * folded flat. */
#include <string.h>

#include "catnav/vec3.h"
#include "geometry.h"
#include "mesh_parts.h"
#include "tree.h"

static const double *vertex(const cn_surface *s, int i, int k)
{
    return s->vert + 3 * (size_t)s->tri[3 * (size_t)i + k];
}

static bool repeated(const cn_surface *s, int i)
{
    const int *t = s->tri + 3 * (size_t)i;
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

typedef struct {
    const cn_surface *surface;
    cn_doctor *doctor;
} crossing_search;

/* Does the edge p q meet triangle b, both closed? */
static bool edge_meets(const double *p, const double *q, const double b[3][3])
{
    const int above = cn_orient3d(b[0], b[1], b[2], p), below = cn_orient3d(b[0], b[1], b[2], q);
    double edge[3][3];
    int turns = 0, against = 0;

    if (above * below > 0) return false;
    if (above || below) { /* it meets the plane in one point: on the same side of all three sides? */
        for (int k = 0; k < 3; k++) {
            const int side = cn_orient3d(p, q, b[k], b[(k + 1) % 3]);
            turns += side > 0, against += side < 0;
        }
        return !turns || !against;
    }
    cn_copy3(p, edge[0]), cn_copy3(q, edge[1]), cn_copy3(q, edge[2]); /* in the plane */
    return cn_tri_tri(edge, b) != CN_TRI_APART;
}

/* Triangles on one edge, p and q, with third corners a and b, folded flat onto each other. */
static bool folded(const double *p, const double *q, const double *a, const double *b)
{
    if (cn_orient3d(p, q, a, b)) return false;
    for (int k = 0; k < 3; k++) {
        const int l = (k + 1) % 3;
        const double p2[2] = {p[k], p[l]}, q2[2] = {q[k], q[l]}, a2[2] = {a[k], a[l]}, b2[2] = {b[k], b[l]};
        const int side = cn_orient2d(p2, q2, a2);
        if (side) return side == cn_orient2d(p2, q2, b2);
    }
    return false;
}

/* Apart from the vertices they share, do triangles i and j meet? */
static bool crosses(const cn_surface *s, int i, int j)
{
    const int *ti = s->tri + 3 * (size_t)i, *tj = s->tri + 3 * (size_t)j;
    double a[3][3], b[3][3];
    int shared = 0, ia = 0, jb = 0, ei = 0, ej = 0;

    for (int k = 0; k < 9; k++)
        if (ti[k / 3] == tj[k % 3]) shared++, ia = k / 3, jb = k % 3, ei += k / 3, ej += k % 3;
    if (shared == 3 || repeated(s, i) || repeated(s, j)) return false;
    if (shared == 2) /* ei, ej: sums of the corners on the edge, so 3 - sum is the one off it */
        return folded(vertex(s, i, ia), vertex(s, i, ei - ia), vertex(s, i, 3 - ei), vertex(s, j, 3 - ej));
    for (int k = 0; k < 3; k++)
        cn_copy3(vertex(s, i, k), a[k]), cn_copy3(vertex(s, j, k), b[k]);
    if (shared == 0) return cn_tri_tri(a, b) != CN_TRI_APART;
    return edge_meets(a[(ia + 1) % 3], a[(ia + 2) % 3], b) || edge_meets(b[(jb + 1) % 3], b[(jb + 2) % 3], a);
}

/* Keeps the least pairs in order, so that the list does not depend on the tree. */
static bool visit_pair(void *user, int ia, int ib)
{
    crossing_search *search = user;
    cn_doctor *d = search->doctor;
    const int a = ia < ib ? ia : ib, b = ia < ib ? ib : ia;

    if (!crosses(search->surface, a, b)) return true;
    int n = d->crossing_pairs < CN_DOCTOR_LISTED ? d->crossing_pairs : CN_DOCTOR_LISTED;
    d->crossing_pairs++;
    for (; n > 0 && (d->crossing[n - 1][0] > a || (d->crossing[n - 1][0] == a && d->crossing[n - 1][1] > b));
         n--)
        if (n < CN_DOCTOR_LISTED) memcpy(d->crossing[n], d->crossing[n - 1], sizeof *d->crossing);
    if (n < CN_DOCTOR_LISTED) d->crossing[n][0] = a, d->crossing[n][1] = b;
    return d->crossing_pairs < 1000000; /* a heap of triangles need not be counted to its end */
}

cn_status cn_surface_crossings(const cn_surface *surface, cn_doctor *doctor)
{
    crossing_search search = {surface, doctor};
    cn_tree *tree = NULL;
    const cn_status status = cn_tree_new(&tree, surface->ntri, surface->tri, surface->vert);

    if (status == CN_OK) cn_tree_query_self(tree, 0, visit_pair, &search);
    cn_tree_free(tree);
    return status;
}
