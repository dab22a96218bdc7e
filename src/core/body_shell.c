/* body_shell.c - bending of a wall without rotational unknowns, right in the plate limit on any mesh.
 *
 * The slope across each edge is one number for both its triangles, and a triangle's curvature is what the
 * slopes s on its edges, of lengths l and outward normals v, add to its own slope g (Morley's plate):
 *     area * curvature = sum over edges l (s - g.v) v v'.
 * With s as unknowns that is Morley's element, which converges on any mesh. Here s is found from the
 * displacements: s = sum a_k . g_k over the slopes g_k of the two triangles at the edge and the four beside
 * them. Half and half of the two (the BST triangle of Onate and Zarate 2000, hinges) does not see a quadratic
 * deflection right on irregular meshes and ends too stiff by tens of percent however fine they are; so the
 * a_k are those nearest to half and half that are right for all rigid motions and, on the patch unfolded into
 * a plane, for all quadratic deflections. Being one number for both sides constant moments are in balance,
 * being right for quadratics constant curvature is exact: both halves of the patch test. The energy is
 * Morley's at restricted slopes, never below his: no motion but a rigid one goes without.
 * A rim's slope is free: it takes the value of least energy, which leaves the rim without a moment. */
#include "body_wall.h"

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"

/* A triangle of the patch, unfolded: the plane's vector (a, b) is a axis[0] + b axis[1] in space. */
typedef struct {
    int tri;
    double place[3][2]; /* of its corners [m], the edge's middle at the origin, the edge along x */
    double axis[2][3], normal[3];
} flap;

enum { FLAPS = 6, ROWS = 6 };

static int next(int item)
{
    return item % 3 == 2 ? item - 2 : item + 1;
}

static const double *corner(const cn_body *body, int item)
{
    return body->rest + 3 * (size_t)body->boundary->tri[item];
}

/* Unfolds triangle t about an edge, given where its ends a and b lie and the side (+-1) of a to b that it
 * comes to lie on. */
static void unfold(const cn_body *body, int t, int a, int b, const double pa[2], const double pb[2],
                   double side, flap *out)
{
    const int *c = body->boundary->tri + 3 * (size_t)t;
    double along[3], up[3], d[2] = {pb[0] - pa[0], pb[1] - pa[1]};
    int apex = 0;
    while (c[apex] == a || c[apex] == b)
        apex++;
    cn_sub(body->rest + 3 * (size_t)b, body->rest + 3 * (size_t)a, along);
    cn_sub(body->rest + 3 * (size_t)c[apex], body->rest + 3 * (size_t)a, up);
    const double length = cn_normalise(along), foot = cn_dot(up, along);
    cn_axpy(-foot, along, up);
    const double height = cn_normalise(up);
    d[0] /= length, d[1] /= length;
    const double e[2] = {-side * d[1], side * d[0]};
    out->tri = t;
    for (int i = 0; i < 3; i++) {
        const double s = i == apex ? foot : c[i] == a ? 0 : length, h = i == apex ? height : 0;
        for (int k = 0; k < 2; k++)
            out->place[i][k] = pa[k] + s * d[k] + h * e[k];
    }
    for (int k = 0; k < 2; k++)
        for (int m = 0; m < 3; m++)
            out->axis[k][m] = d[k] * along[m] + e[k] * up[m];
    cn_cross(out->axis[0], out->axis[1], out->normal);
}

/* The patch of an inner edge, seen from `item`: the triangle left of it, that across, those beside both. */
static int patch_of(const cn_body *body, const int *across, int item, flap *patch)
{
    const int *tri = body->boundary->tri, a = tri[item], b = tri[next(item)];
    const double half = cn_distance(corner(body, item), corner(body, next(item))) / 2;
    const double pa[2] = {-half, 0}, pb[2] = {half, 0};
    int n = 2;
    unfold(body, item / 3, a, b, pa, pb, 1, patch);
    unfold(body, across[item] / 3, a, b, pa, pb, -1, patch + 1);
    for (int s = 0; s < 2; s++)
        for (int k = 0; k < 3; k++) {
            const flap *from = patch + s;
            const int edge = 3 * from->tri + k, other = across[edge] < 0 ? -1 : across[edge] / 3;
            const double *p = from->place[k], *q = from->place[(k + 1) % 3], *r = from->place[(k + 2) % 3];
            bool known = other < 0;
            for (int i = 0; i < n; i++)
                known = known || patch[i].tri == other;
            if (known) continue;
            const double left = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
            unfold(body, other, tri[edge], tri[next(edge)], p, q, left > 0 ? -1 : 1, patch + n++);
        }
    return n;
}

/* The weights a_k (n x 2) of the patch's slopes: least change from half and half, towards -y, that meets the
 * conditions; one that the patch can hardly tell from those before is left out. */
static void slope_weights(const flap *patch, double (*grad)[3][2], int n, double length, double *a)
{
    double row[ROWS][2 * FLAPS], want[ROWS] = {0};
    memset(a, 0, 2 * FLAPS * sizeof *a);
    a[1] = a[3] = -0.5;
    for (int k = 0; k < n; k++)
        for (int d = 0; d < 2; d++) {
            double turn[3];
            cn_cross(patch[k].axis[d], patch[k].normal, turn);
            for (int r = 0; r < 3; r++)
                row[r][2 * k + d] = turn[r]; /* half and half is right for rigid turns: keep their sum */
            for (int r = 3; r < 6; r++) {    /* slope of x^2/2, y^2/2, x y, which is 0 amid the edge */
                row[r][2 * k + d] = 0;
                for (int i = 0; i < 3; i++) {
                    const double x = patch[k].place[i][0], y = patch[k].place[i][1];
                    const double w = r == 3 ? x * x / 2 : r == 4 ? y * y / 2 : x * y;
                    row[r][2 * k + d] += w * grad[k][i][d] / length;
                }
            }
        }
    for (int r = 3; r < ROWS; r++)
        want[r] = (row[r][1] + row[r][3]) / 2;
    for (int r = 0; r < ROWS; r++) {
        double before = 0, after = 0;
        for (int i = 0; i < 2 * n; i++)
            before += row[r][i] * row[r][i];
        for (int p = 0; p < r; p++) {
            double dot = 0;
            for (int i = 0; i < 2 * n; i++)
                dot += row[p][i] * row[r][i];
            for (int i = 0; i < 2 * n; i++)
                row[r][i] -= dot * row[p][i];
            want[r] -= dot * want[p];
        }
        for (int i = 0; i < 2 * n; i++)
            after += row[r][i] * row[r][i];
        const double size = after > 0.0025 * before ? sqrt(after) : INFINITY;
        want[r] /= size;
        for (int i = 0; i < 2 * n; i++)
            row[r][i] /= size, a[i] += want[r] * row[r][i];
    }
}

/* The element being made: its nodes so far, its curvature per displacement of theirs. */
typedef struct {
    int n, *node; /* (CN_SHELL_NODES) */
    double (*row)[3][3 * CN_SHELL_NODES];
} element;

/* Adds col times weight times the normal displacement of a node. */
static void add_to(element *e, int node, const double col[3], double weight, const double normal[3])
{
    int at = 0;
    while (at < e->n && e->node[at] != node)
        at++;
    if (at == e->n) e->node[e->n++] = node;
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++)
            (*e->row)[r][3 * at + k] += col[r] * weight * normal[k];
}

/* Adds col times the slope across the edge `item`, outwards from its triangle. */
static void add_slope(const cn_body *body, const int *across, int item, const double col[3], element *e)
{
    const int *tri = body->boundary->tri, other = across[item];
    const bool mine = item < other; /* both sides read the same number */
    flap patch[FLAPS];
    double grad[FLAPS][3][2], a[2 * FLAPS];
    const int from = mine ? item : other, n = patch_of(body, across, from, patch);
    const double sign = mine || tri[item] == tri[other] ? 1 : -1;
    const double length = cn_distance(corner(body, item), corner(body, next(item)));
    for (int k = 0; k < n; k++)
        cn_flat_gradients((const double(*)[2])patch[k].place, grad[k]);
    slope_weights(patch, grad, n, length, a);
    for (int k = 0; k < n; k++)
        for (int i = 0; i < 3; i++)
            add_to(e, tri[3 * patch[k].tri + i], col,
                   sign * (a[2 * k] * grad[k][i][0] + a[2 * k + 1] * grad[k][i][1]), patch[k].normal);
}

/* Takes the best of col's multiples out of the curvature: what a free slope does to it. */
static void let_go(double nu, const double col[3], double (*row)[3 * CN_SHELL_NODES])
{
    const double d[3] = {col[0] + nu * col[1], col[1] + nu * col[0], (1 - nu) / 2 * col[2]};
    const double size = cn_dot(d, col);
    for (int i = 0; i < 3 * CN_SHELL_NODES; i++) {
        const double share = (d[0] * row[0][i] + d[1] * row[1][i] + d[2] * row[2][i]) / size;
        for (int r = 0; r < 3; r++)
            row[r][i] -= share * col[r];
    }
}

static void rest_element(const cn_body *body, int t)
{
    const cn_sheet *sheet = body->own;
    const int *c = body->boundary->tri + 3 * (size_t)t;
    const double nu = sheet->poisson;
    double axis[3][3], p[3][2], grad[3][2], free_col[3][3];
    int nfree = 0;
    element e = {3, body->connect + (size_t)CN_SHELL_NODES * (size_t)t,
                 (double(*)[3][3 * CN_SHELL_NODES])(sheet->curvature + 9 * CN_SHELL_NODES * (size_t)t)};
    cn_sheet_plane(body, t, axis, p);
    cn_flat_gradients((const double(*)[2])p, grad);
    for (int a = 0; a < CN_SHELL_NODES; a++)
        e.node[a] = c[a < 3 ? a : 0];
    for (int k = 0; k < 3; k++) {
        const double *from = p[k], *to = p[(k + 1) % 3], length = hypot(to[0] - from[0], to[1] - from[1]);
        const double v[2] = {(to[1] - from[1]) / length, (from[0] - to[0]) / length},
                     l = length / sheet->area[t];
        const double col[3] = {l * v[0] * v[0], l * v[1] * v[1], 2 * l * v[0] * v[1]};
        for (int i = 0; i < 3; i++)
            add_to(&e, c[i], col, -(grad[i][0] * v[0] + grad[i][1] * v[1]), axis[2]);
        if (sheet->across[3 * t + k] >= 0)
            add_slope(body, sheet->across, 3 * t + k, col, &e);
        else
            cn_copy3(col, free_col[nfree++]);
    }
    for (int i = 0; i < nfree; i++) { /* each made independent of those before, in the law's measure */
        double *f = free_col[i];
        for (int j = 0; j < i; j++) {
            const double *g = free_col[j];
            const double d[3] = {g[0] + nu * g[1], g[1] + nu * g[0], (1 - nu) / 2 * g[2]};
            cn_axpy(-cn_dot(d, f) / cn_dot(d, g), g, f);
        }
        let_go(nu, f, *e.row);
    }
}

cn_status cn_shell_rest(cn_body *body, cn_error *error)
{
    const int *across = ((const cn_sheet *)body->own)->across, *tri = body->boundary->tri;
    for (int i = 0; i < 3 * body->nelement; i++)
        if (across[i] == -2)
            return cn_fail(
                error, CN_FAULT_NON_MANIFOLD, "", 0,
                "edge %d-%d of triangle %d belongs to more than two triangles: a shell cannot bend "
                "there, take the others away or use a membrane",
                tri[i], tri[next(i)], i / 3);
    for (int t = 0; t < body->nelement; t++)
        rest_element(body, t);
    return CN_OK;
}
