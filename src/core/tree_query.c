/* tree_query.c - nearest triangle, crossings of a segment, inside by parity.
 *
 * Crossings are decided by exact signs. Where one is zero, the segment is thought of as displaced by
 * (e, e^2, e^3) with e > 0 smaller than anything (Edelsbrunner and Muecke, Simulation of Simplicity, ACM TOG
 * 1990): the first non-zero derivative decides, so that a segment through an edge or a vertex crosses the
 * triangles around it just as its displaced neighbour does, and parity holds on every closed surface. */
#include "tree.h"

#include <math.h>
#include <stddef.h>
#include "catnav/vec3.h"
#include "geometry.h"
#include "tree_node.h"

static double square_to_box(const box *b, const double p[3])
{
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        const double low = b->min[k] - p[k], high = p[k] - b->max[k];
        const double out = low > high ? low : high;
        if (out > 0) sum += out * out;
    }
    return sum * (1 - 0x1p-50); /* not above the true one */
}

double cn_tree_nearest(const cn_tree *tree, const double p[3], double limit, int *itri, double nearest[3])
{
    struct {
        double square;
        int node;
    } stack[STACK];
    double best = limit, best_square = limit * limit * (1 + 0x1p-50);
    int top = 0, found = -1;

    if (tree->nnode) stack[top].square = square_to_box(&tree->node->box, p), stack[top++].node = 0;
    while (top) {
        const double square = stack[--top].square;
        const int i = stack[top].node;
        const node *const at = tree->node + i;
        if (square > best_square) continue;
        for (int j = at->first; j < at->first + at->count; j++) {
            const double *corner[3];
            double bary[3];
            if (square_to_box(&tree->box[j], p) > best_square) continue;
            for (int k = 0; k < 3; k++)
                corner[k] = tree->vert + 3 * (size_t)tree->corner[3 * (size_t)j + (size_t)k];
            const double d = cn_point_triangle(p, corner[0], corner[1], corner[2], bary);
            /* of equally near ones the first by number, whatever the tree looks like */
            if (!(d < best || (d == best && (found < 0 || tree->order[j] < found)))) continue;
            best = d, best_square = d * d * (1 + 0x1p-50), found = tree->order[j];
            for (int k = 0; k < 3 && nearest; k++)
                nearest[k] = bary[0] * corner[0][k] + bary[1] * corner[1][k] + bary[2] * corner[2][k];
        }
        if (at->count) continue;
        const double left = square_to_box(&at[1].box, p),
                     right = square_to_box(&tree->node[at->first].box, p);
        const bool left_first = left <= right;
        stack[top].square = left_first ? right : left, stack[top++].node = left_first ? at->first : i + 1;
        stack[top].square = left_first ? left : right, stack[top++].node = left_first ? i + 1 : at->first;
    }
    if (itri) *itri = found;
    return best;
}

/* Sign of component k of (b - a) x (d - c). */
static int cross_sign(int k, const double a[3], const double b[3], const double c[3], const double d[3])
{
    const int u = (k + 1) % 3, v = (k + 2) % 3;
    return cn_cross2d((double[]){a[u], a[v]}, (double[]){b[u], b[v]}, (double[]){c[u], c[v]},
                      (double[]){d[u], d[v]});
}

/* Orientation of the displaced p with a triangle; 0 only when it has no area. */
static int side(const double *const t[3], const double p[3])
{
    int sign = cn_orient3d(t[0], t[1], t[2], p);
    for (int k = 0; k < 3 && !sign; k++)
        sign = -cross_sign(k, t[0], t[1], t[0], t[2]);
    return sign;
}

/* Orientation of the displaced a b with u v; 0 only when they are parallel and in one plane. */
static int passes(const double a[3], const double b[3], const double u[3], const double v[3])
{
    int sign = cn_orient3d(a, b, u, v);
    for (int k = 0; k < 3 && !sign; k++)
        sign = -cross_sign(k, a, b, u, v);
    return sign;
}

static void corners(const cn_tree *tree, int slot, const double *t[3])
{
    for (int k = 0; k < 3; k++)
        t[k] = tree->vert + 3 * (size_t)tree->corner[3 * (size_t)slot + (size_t)k];
}

static bool crosses(const double *const t[3], const double a[3], const double b[3])
{
    const int from = side(t, a), to = side(t, b);
    if (!from || from == to) return false;
    const int sign = passes(a, b, t[0], t[1]);
    return sign && passes(a, b, t[1], t[2]) == sign && passes(a, b, t[2], t[0]) == sign;
}

/* Segment a, a + e misses the box: separating axes with slack for rounding. */
static bool misses(const box *b, const box *segment, const double a[3], const double e[3])
{
    double mid[3], half[3];
    if (boxes_apart(b, segment, 0)) return true;
    for (int k = 0; k < 3; k++)
        mid[k] = 0.5 * ((b->min[k] - a[k]) + (b->max[k] - a[k])), half[k] = 0.5 * (b->max[k] - b->min[k]);
    for (int k = 0; k < 3; k++) {
        const int u = (k + 1) % 3, v = (k + 2) % 3;
        const double eu = fabs(e[u]), ev = fabs(e[v]), radius = half[u] * ev + half[v] * eu;
        const double slack = 0x1p-48 * (radius + fabs(mid[u]) * ev + fabs(mid[v]) * eu);
        if (fabs(mid[u] * e[v] - mid[v] * e[u]) > radius + slack) return true;
    }
    return false;
}

int cn_tree_crossings(const cn_tree *tree, const double a[3], const double b[3])
{
    int stack[STACK], top = 0, count = 0;
    double e[3];
    box segment;
    cn_sub(b, a, e);
    for (int k = 0; k < 3; k++)
        segment.min[k] = a[k] < b[k] ? a[k] : b[k], segment.max[k] = a[k] > b[k] ? a[k] : b[k];
    if (tree->nnode) stack[top++] = 0;
    while (top) {
        const int i = stack[--top];
        const node *const at = tree->node + i;
        if (misses(&at->box, &segment, a, e)) continue;
        for (int j = at->first; j < at->first + at->count; j++) {
            const double *t[3];
            if (boxes_apart(&tree->box[j], &segment, 0)) continue;
            corners(tree, j, t);
            count += crosses(t, a, b);
        }
        if (!at->count) stack[top++] = at->first, stack[top++] = i + 1;
    }
    return count;
}

/* Orientation, seen along axis k, of the displaced p with the edge u v; 0 only when the edge is parallel to
 * k. */
static int turns(int k, const double p[3], const double u[3], const double v[3])
{
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const int sign = cn_orient2d((double[]){p[i], p[j]}, (double[]){u[i], u[j]}, (double[]){v[i], v[j]});
    if (sign) return sign;
    const int along_i = (v[j] < u[j]) - (v[j] > u[j]), along_j = (v[i] > u[i]) - (v[i] < u[i]);
    const int first = k == 1 ? along_j : along_i,
              second = k == 1 ? along_i : along_j; /* x before y before z */
    return first ? first : second;
}

/* Crossings of the ray from p along axis k, upwards or downwards. */
static int ray_crossings(const cn_tree *tree, const double p[3], int k, bool up)
{
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    int stack[STACK], top = 0, count = 0;
    if (tree->nnode) stack[top++] = 0;
    while (top) {
        const int inode = stack[--top];
        const node *const at = tree->node + inode;
        const box *b = &at->box;
        if (p[i] < b->min[i] || p[i] > b->max[i] || p[j] < b->min[j] || p[j] > b->max[j]) continue;
        if (up ? b->max[k] < p[k] : b->min[k] > p[k]) continue;
        for (int slot = at->first; slot < at->first + at->count; slot++) {
            const double *t[3];
            b = &tree->box[slot];
            if (p[i] < b->min[i] || p[i] > b->max[i] || p[j] < b->min[j] || p[j] > b->max[j]) continue;
            if (up ? b->max[k] < p[k] : b->min[k] > p[k]) continue;
            corners(tree, slot, t);
            const int sign =
                turns(k, p, t[0], t[1]); /* that of the normal's component along k, if p is inside */
            if (!sign || turns(k, p, t[1], t[2]) != sign || turns(k, p, t[2], t[0]) != sign) continue;
            count += side(t, p) == (up ? sign : -sign);
        }
        if (!at->count) stack[top++] = at->first, stack[top++] = inode + 1;
    }
    return count;
}

bool cn_tree_inside_all(int ntree, const cn_tree *const *tree, const cn_tree *caps, const double p[3])
{
    double min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY};
    double low[3], high[3], least = INFINITY;
    int axis = 0, count = 0;
    bool up = true;

    for (int i = 0; i < ntree + (caps ? 1 : 0); i++) {
        cn_tree_box(i < ntree ? tree[i] : caps, low, high);
        for (int k = 0; k < 3; k++)
            min[k] = fmin(min[k], low[k]), max[k] = fmax(max[k], high[k]);
    }
    for (int k = 0; k < 3; k++) { /* the shortest way out of the box */
        if (!(p[k] >= min[k] && p[k] <= max[k])) return false;
        if (p[k] - min[k] < least) least = p[k] - min[k], axis = k, up = false;
        if (max[k] - p[k] < least) least = max[k] - p[k], axis = k, up = true;
    }
    for (int i = 0; i < ntree; i++)
        count += ray_crossings(tree[i], p, axis, up);
    if (caps) count += ray_crossings(caps, p, axis, up);
    return count % 2 == 1;
}

bool cn_tree_inside(const cn_tree *tree, const cn_tree *caps, const double p[3])
{
    return cn_tree_inside_all(1, &tree, caps, p);
}
