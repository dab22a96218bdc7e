/* mesh_shapes.c - tetrahedra of catheters and beams; closed surfaces of spheres, boxes and tubes; planes. */
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

static const double two_pi = 6.28318530717958647692;

static void set3(double *x, double a, double b, double c)
{
    x[0] = a, x[1] = b, x[2] = c;
}

/* Appends a tetrahedron with positive volume, whichever way round it is named. */
static void add_tet(cn_tets *tets, int *n, int a, int b, int c, int d)
{
    const double *x = tets->node;
    int *t = tets->tet + 4 * (size_t)(*n)++;
    const bool positive =
        cn_tet_volume6(x + 3 * (size_t)a, x + 3 * (size_t)b, x + 3 * (size_t)c, x + 3 * (size_t)d) > 0;
    t[0] = a, t[1] = b, t[2] = positive ? c : d, t[3] = positive ? d : c;
}

/* Six tetrahedra around the diagonal from corner m to corner 7 - m (Kuhn); bits of a corner's index are its
 * place along the three axes. Faces of neighbours agree where m is mirrored across them, and where it is not.
 */
static void add_kuhn(cn_tets *tets, int *n, const int corner[8], int m)
{
    static const int path[6][2] = {{1, 3}, {1, 5}, {2, 3}, {2, 6}, {4, 5}, {4, 6}};
    for (int i = 0; i < 6; i++)
        add_tet(tets, n, corner[m], corner[path[i][0] ^ m], corner[path[i][1] ^ m], corner[7 ^ m]);
}

/* --- catheter --- */

/* One slab of the full section: six (sides) prisms between the axis and the outer quads. The diagonals of the
 * inner quads all leave the axis node of one end, in turn the upper and the lower: no direction of the
 * section is different. Those of the outer quads alternate around and along it. */
static void add_prisms(cn_tets *tets, int *n, int j, int sides)
{
    const int per = sides + 1, low = j * per, high = low + per;

    for (int k = 0; k < sides; k++) {
        const int l = (k + 1) % sides;
        const int a = j % 2 ? high : low; /* the apex, and the prism as seen from it */
        const int A = j % 2 ? low : high;
        const int b = a + 1 + k, c = a + 1 + l, B = A + 1 + k, C = A + 1 + l;
        add_tet(tets, n, a, A, B, C);
        if ((k + j / 2) % 2)
            add_tet(tets, n, a, b, c, C), add_tet(tets, n, a, b, B, C);
        else
            add_tet(tets, n, a, b, c, B), add_tet(tets, n, a, c, B, C);
    }
}

/* One slab of the hollow section: cells between the inner and the outer ring. */
static void add_cells(cn_tets *tets, int *n, int j, int sides)
{
    const int per = 2 * sides;

    for (int k = 0; k < sides; k++) {
        int corner[8];
        for (int i = 0; i < 8; i++) /* bits: outward, around, along */
            corner[i] = (j + (i >> 2)) * per + (i & 1) * sides + (k + (i >> 1 & 1)) % sides;
        add_kuhn(tets, n, corner, (sides % 2 ? 0 : k % 2) << 1 | (j % 2) << 2);
    }
}

cn_status cn_tets_catheter(cn_tets **out, double length, double diameter, double inner_diameter, int stations,
                           int sides, cn_error *error)
{
    cn_tets *tets = NULL;
    int n = 0;
    cn_status status;

    if (!(length > 0 && length < INFINITY))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "the catheter's length is %g: more than 0 is needed",
                       length);
    if (!(diameter > 0 && diameter < INFINITY))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "the catheter's diameter is %g: more than 0 is needed",
                       diameter);
    if (!(inner_diameter >= 0 && inner_diameter < diameter))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                       "the catheter's inner diameter is %g: from 0 to below %g is needed", inner_diameter,
                       diameter);
    if (!(stations >= 2 && stations <= 1000000))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                       "the catheter has %d stations: 2 to 1000000 are needed", stations);
    if (!(sides >= 3 && sides <= 256))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "the catheter has %d sides: 3 to 256 are needed",
                       sides);
    const bool hollow = inner_diameter > 0;
    const int per = hollow ? 2 * sides : sides + 1, rings = hollow ? 2 : 1;
    if ((double)stations * sides * (hollow ? 6 : 3) > INT_MAX / 4)
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "%d stations of %d sides are too many", stations,
                       sides);
    if ((status = cn_tets_new(&tets, stations * per, (stations - 1) * sides * (hollow ? 6 : 3))) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory for a catheter of %d stations", stations);
    for (int j = 0; j < stations; j++) {
        const double z = -length * ((double)j / (stations - 1)); /* the ends are exact */
        double *x = tets->node + 3 * (size_t)j * per;
        if (!hollow) set3(x, 0, 0, z), x += 3;
        for (int ring = 0; ring < rings; ring++)
            for (int k = 0; k < sides; k++, x += 3) {
                const double r = 0.5 * (hollow && ring == 0 ? inner_diameter : diameter);
                set3(x, r * cos(two_pi * k / sides), r * sin(two_pi * k / sides), z);
            }
    }
    for (int j = 0; j + 1 < stations; j++) {
        if (hollow)
            add_cells(tets, &n, j, sides);
        else
            add_prisms(tets, &n, j, sides);
    }
    *out = tets;
    return CN_OK;
}

/* --- beam --- */

cn_status cn_tets_beam(cn_tets **out, const double size[3], const int cells[3], cn_error *error)
{
    cn_tets *tets = NULL;
    int n = 0;
    cn_status status;

    for (int k = 0; k < 3; k++) {
        if (!(size[k] > 0 && size[k] < INFINITY))
            return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                           "the beam's size along %c is %g: more than 0 is needed", "xyz"[k], size[k]);
        if (!(cells[k] >= 1 && cells[k] <= 100000))
            return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                           "the beam has %d cells along %c: 1 to 100000 are needed", cells[k], "xyz"[k]);
    }
    const int ny = cells[1] + 1, nz = cells[2] + 1;
    if ((cells[0] + 1.0) * ny * nz * 6 > INT_MAX / 4)
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "a beam of %d x %d x %d cells is too large", cells[0],
                       cells[1], cells[2]);
    if ((status = cn_tets_new(&tets, (cells[0] + 1) * ny * nz, 6 * cells[0] * cells[1] * cells[2])) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory for a beam of %d x %d x %d cells", cells[0],
                       cells[1], cells[2]);
    double *x = tets->node;
    for (int i = 0; i <= cells[0]; i++) /* x slowest: a long beam is a chain of its sections */
        for (int j = 0; j <= cells[1]; j++)
            for (int k = 0; k <= cells[2]; k++, x += 3)
                set3(x, size[0] * ((double)i / cells[0]), size[1] * ((double)j / cells[1]),
                     size[2] * ((double)k / cells[2]));
    for (int i = 0; i < cells[0]; i++)
        for (int j = 0; j < cells[1]; j++)
            for (int k = 0; k < cells[2]; k++) {
                int corner[8];
                for (int c = 0; c < 8; c++)
                    corner[c] = ((i + (c & 1)) * ny + j + (c >> 1 & 1)) * nz + k + (c >> 2);
                add_kuhn(tets, &n, corner, i % 2 | (j % 2) << 1 | (k % 2) << 2);
            }
    *out = tets;
    return CN_OK;
}

/* --- surfaces --- */

/* Node of the middle of an edge: made at its first use; `key` is a table of edges by hash. */
static int middle(cn_surface *s, int *nvert, int (*key)[3], int size, int a, int b)
{
    const int low = a < b ? a : b, high = a < b ? b : a;
    int slot = (int)(((unsigned)low * 2654435761u ^ (unsigned)high * 40503u) & (unsigned)(size - 1));

    for (; key[slot][2]; slot = (slot + 1) & (size - 1))
        if (key[slot][0] == low && key[slot][1] == high) return key[slot][2] - 1;
    double *x = s->vert + 3 * (size_t)*nvert;
    cn_add(s->vert + 3 * (size_t)low, s->vert + 3 * (size_t)high, x);
    cn_normalise(x);
    key[slot][0] = low, key[slot][1] = high, key[slot][2] = ++*nvert;
    return *nvert - 1;
}

cn_status cn_surface_sphere(cn_surface **out, const double centre[3], double radius)
{
    enum { LEVELS = 4, NTRI = 20 << 2 * LEVELS, NVERT = NTRI / 2 + 2, TABLE = 16384 };
    static const double g = 1.6180339887498948482; /* golden ratio: corners of the icosahedron */
    static const int face[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    const double corner[12][3] = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                  {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    cn_surface *s = NULL;
    int(*key)[3] = NULL, nvert = 12, ntri = 20;
    cn_status status;

    if (!(radius > 0 && radius < INFINITY) || !isfinite(cn_norm2(centre))) return CN_ERR_ARG;
    if ((status = cn_surface_new(&s, NVERT, NTRI)) != CN_OK) return status;
    if (!(key = cn_array(TABLE, sizeof *key))) goto fail;
    memcpy(s->vert, corner, sizeof corner);
    memcpy(s->tri, face, sizeof face);
    for (int i = 0; i < 12; i++)
        cn_normalise(s->vert + 3 * i);
    for (int level = 0; level < LEVELS; level++) { /* each triangle becomes four; the first takes its place */
        memset(key, 0, TABLE * sizeof *key);
        const int before = ntri;
        for (int i = 0; i < before; i++) {
            int *t = s->tri + 3 * i;
            const int a = t[0], b = t[1], c = t[2], ab = middle(s, &nvert, key, TABLE, a, b),
                      bc = middle(s, &nvert, key, TABLE, b, c), ca = middle(s, &nvert, key, TABLE, c, a);
            const int part[3][3] = {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}};
            memcpy(s->tri + 3 * ntri, part, sizeof part);
            t[0] = ab, t[1] = bc, t[2] = ca;
            ntri += 3;
        }
    }
    for (int i = 0; i < 3 * nvert; i++)
        s->vert[i] = centre[i % 3] + radius * s->vert[i];
    free(key);
    *out = s;
    return CN_OK;
fail:
    cn_surface_free(s);
    return CN_ERR_MEMORY;
}

cn_status cn_surface_box(cn_surface **out, const double min[3], const double max[3])
{
    static const int face[12][3] = {{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}, {0, 1, 5}, {0, 5, 4},
                                    {2, 6, 7}, {2, 7, 3}, {0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}};
    cn_surface *s = NULL;
    cn_status status;

    for (int k = 0; k < 3; k++)
        if (!(min[k] < max[k] && isfinite(max[k] - min[k]))) return CN_ERR_ARG;
    if ((status = cn_surface_new(&s, 8, 12)) != CN_OK) return status;
    for (int i = 0; i < 8; i++)
        for (int k = 0; k < 3; k++)
            s->vert[3 * i + k] = i >> k & 1 ? max[k] : min[k];
    memcpy(s->tri, face, sizeof face);
    *out = s;
    return CN_OK;
}

cn_status cn_surface_plane(cn_surface **out, const double point[3], const double normal[3], double extent)
{
    double n[3], u[3], v[3];
    cn_surface *s = NULL;
    cn_status status;

    cn_copy3(normal, n);
    const double length = cn_normalise(n);
    if (!(length > 0 && length < INFINITY) || !(extent > 0 && extent < INFINITY) ||
        !isfinite(cn_norm2(point)))
        return CN_ERR_ARG;
    if ((status = cn_surface_new(&s, 3, 1)) != CN_OK) return status;
    cn_any_normal(n, u);
    cn_cross(n, u, v);
    for (int i = 0; i < 3; i++) { /* counter-clockwise seen from the side the normal points to */
        const double angle = 2 * acos(-1.0) * i / 3;
        cn_copy3(point, s->vert + 3 * i);
        cn_axpy(2 * extent * cos(angle), u, s->vert + 3 * i);
        cn_axpy(2 * extent * sin(angle), v, s->vert + 3 * i);
        s->tri[i] = i;
    }
    *out = s;
    return CN_OK;
}

/* Unit tangent of the axis at point i: the mean of the directions before and after it. */
static void axis_tangent(int n, const double *axis, int i, double t[3])
{
    double before[3] = {0, 0, 0}, after[3] = {0, 0, 0};
    if (i > 0) cn_sub(axis + 3 * (size_t)i, axis + 3 * (size_t)(i - 1), before);
    if (i + 1 < n) cn_sub(axis + 3 * (size_t)(i + 1), axis + 3 * (size_t)i, after);
    cn_normalise(before);
    cn_normalise(after);
    cn_add(before, after, t);
    cn_normalise(t);
}

/* Carries the normal r from (x, t) to (y, u) without twist: double reflection (Wang et al. 2008). */
static void carry_frame(const double x[3], const double t[3], const double y[3], const double u[3],
                        double r[3])
{
    double v[3], w[3], tl[3];
    cn_sub(y, x, v);
    const double c1 = cn_norm2(v);
    cn_copy3(t, tl);
    cn_axpy(-2 / c1 * cn_dot(v, t), v, tl);
    cn_axpy(-2 / c1 * cn_dot(v, r), v, r);
    cn_sub(u, tl, w);
    const double c2 = cn_norm2(w);
    if (c2 > 0) cn_axpy(-2 / c2 * cn_dot(w, r), w, r);
    cn_axpy(-cn_dot(r, u), u, r); /* rounding */
    cn_normalise(r);
}

/* Two triangles of the quad a b d c (a b on one ring, c d above them). */
static void add_quad(cn_surface *s, int *n, int a, int b, int c, int d)
{
    const int quad[6] = {a, b, d, a, d, c};
    memcpy(s->tri + 3 * (size_t)*n, quad, sizeof quad);
    *n += 2;
}

cn_status cn_surface_tube(cn_surface **out, int naxis, const double *axis, const double *radius,
                          double thickness, int sides)
{
    cn_surface *s = NULL;
    double t[3], u[3], r[3];
    int n = 0;
    cn_status status;

    if (naxis < 2 || sides < 3 || (double)naxis * sides > INT_MAX / 16 ||
        !(thickness >= 0 && thickness < INFINITY))
        return CN_ERR_ARG;
    for (int i = 0; i < naxis; i++) {
        if (!(radius[i] > 0 && radius[i] < INFINITY) || !isfinite(cn_norm2(axis + 3 * (size_t)i)))
            return CN_ERR_ARG;
        if (i && !(cn_distance(axis + 3 * (size_t)i, axis + 3 * (size_t)(i - 1)) > 0)) return CN_ERR_ARG;
        axis_tangent(naxis, axis, i, t);
        if (!(cn_norm2(t) > 0.5)) return CN_ERR_ARG; /* the axis turns back on itself */
    }
    const bool solid = thickness > 0;
    const int ring = naxis * sides; /* vertices of one wall; the outer one follows the inner */
    if ((status = cn_surface_new(&s, solid ? 2 * ring : ring,
                                 2 * (naxis - 1) * sides * (solid ? 2 : 1) + (solid ? 4 * sides : 0))) !=
        CN_OK)
        return status;
    axis_tangent(naxis, axis, 0, t);
    cn_any_normal(t, r);
    for (int i = 0; i < naxis; i++) {
        double b[3];
        axis_tangent(naxis, axis, i, u);
        if (i) carry_frame(axis + 3 * (size_t)(i - 1), t, axis + 3 * (size_t)i, u, r);
        cn_copy3(u, t);
        cn_cross(t, r, b);
        for (int wall = 0; wall < (solid ? 2 : 1); wall++)
            for (int k = 0; k < sides; k++) {
                double *x = s->vert + 3 * ((size_t)wall * ring + (size_t)i * sides + k);
                const double rho = radius[i] + wall * thickness;
                cn_copy3(axis + 3 * (size_t)i, x);
                cn_axpy(rho * cos(two_pi * k / sides), r, x);
                cn_axpy(rho * sin(two_pi * k / sides), b, x);
            }
    }
    for (int i = 0; i + 1 < naxis; i++)
        for (int k = 0; k < sides; k++) {
            const int a = i * sides + k, b = i * sides + (k + 1) % sides, c = a + sides, d = b + sides;
            if (!solid) add_quad(s, &n, a, b, c, d);
            if (solid) add_quad(s, &n, b, a, d, c), add_quad(s, &n, ring + a, ring + b, ring + c, ring + d);
        }
    for (int k = 0; solid && k < sides; k++) { /* end faces */
        const int l = (k + 1) % sides, last = (naxis - 1) * sides;
        add_quad(s, &n, k, l, ring + k, ring + l);
        add_quad(s, &n, last + l, last + k, ring + last + l, ring + last + k);
    }
    *out = s;
    return CN_OK;
}
