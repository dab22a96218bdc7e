/* body_tet10.c - second-order tetrahedra: Jacobians, volumes and masses at rest.
 *
 * Nodes are corners 0..3 and those amid edges 01 12 20 03 13 23; with barycentric coordinates l the shape
 * functions are l_i (2 l_i - 1) and 4 l_i l_j. Points of integration: four, at l_q = (5 + 3 sqrt 5)/20, the
 * others (5 - sqrt 5)/20, each a quarter of the volume (exact to degree 2: for straight edges all that the
 * constant-strain and the linear-strain field need). Masses by diagonal scaling (Hinton, Rock, Zienkiewicz
 * 1976) with a rule of 14 points exact to degree 5 (Walkington 2000): straight elements have 1/36 of theirs
 * at a corner, 4/27 amid an edge. */
#include "body_element.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "body_face.h"
#include "catnav/vec3.h"

static const int edge_of[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

static const int *nodes_of(const cn_body *body, int element)
{
    return body->connect + 10 * (size_t)element;
}

/* dx/dl_k - dx/dl_0, k = 1..3, as rows, at barycentric coordinates l; from node 0, to round less. */
static void jacobian(const cn_body *body, const int *n, const double l[4], double rows[9])
{
    double slope[4][3] = {{0}}, x[10][3];
    for (int a = 0; a < 10; a++)
        cn_sub(body->rest + 3 * (size_t)n[a], body->rest + 3 * (size_t)n[0], x[a]);
    for (int i = 0; i < 4; i++)
        cn_axpy(4 * l[i] - 1, x[i], slope[i]);
    for (int e = 0; e < 6; e++) {
        const int i = edge_of[e][0], j = edge_of[e][1];
        cn_axpy(4 * l[j], x[4 + e], slope[i]);
        cn_axpy(4 * l[i], x[4 + e], slope[j]);
    }
    for (int k = 0; k < 3; k++)
        cn_sub(slope[1 + k], slope[0], rows + 3 * k);
}

static void point_of(int q, double l[4])
{
    for (int i = 0; i < 4; i++)
        l[i] = (5 + (i == q ? 3 : -1) * sqrt(5)) / 20;
}

void cn_tet10_points(const cn_body *body, int element, double grad[CN_TET10_POINTS][9],
                     double volume[CN_TET10_POINTS])
{
    for (int q = 0; q < CN_TET10_POINTS; q++) {
        double l[4], rows[9], *g = grad[q];
        point_of(q, l);
        jacobian(body, nodes_of(body, element), l, rows);
        cn_cross(rows + 3, rows + 6, g);
        cn_cross(rows + 6, rows, g + 3);
        cn_cross(rows, rows + 3, g + 6);
        const double six = cn_dot(rows, g);
        for (int i = 0; i < 9; i++)
            g[i] /= six;
        volume[q] = six / 24;
    }
}

/* Six times the volume per unit of the element's, at its points of integration, then at its nodes; returns
 * the least. */
static double least_jacobian(const cn_body *body, int element, int *at)
{
    double least = INFINITY;
    for (int p = 0; p < CN_TET10_POINTS + 10; p++) {
        double l[4] = {0}, rows[9];
        const int a = p - CN_TET10_POINTS;
        if (a < 0)
            point_of(p, l);
        else if (a < 4)
            l[a] = 1;
        else
            l[edge_of[a - 4][0]] = l[edge_of[a - 4][1]] = 0.5;
        jacobian(body, nodes_of(body, element), l, rows);
        const double det = cn_det(rows);
        if (!(det >= least)) least = det, *at = a;
        if (det != det) break;
    }
    return least;
}

static cn_status connect(cn_body *body, cn_error *error)
{
    body->nper = 10, body->nturn = CN_TET10_POINTS * body->ntet;
    if (!(body->connect = calloc((size_t)body->ntet, 10 * sizeof *body->connect))) return CN_ERR_MEMORY;
    for (int e = 0; e < body->ntet; e++) {
        int *n = body->connect + 10 * (size_t)e;
        memcpy(n, body->tet + 4 * (size_t)e, 4 * sizeof *n);
        memcpy(n + 4, body->mid + 6 * (size_t)e, 6 * sizeof *n);
        for (int a = 4; a < 10; a++)
            if (n[a] < 0 || n[a] >= body->nnode)
                return cn_fail(error, CN_FAULT_NO_VERTEX, "", 0,
                               "tetrahedron %d names node %d of %d amid an edge", e, n[a], body->nnode);
    }
    return CN_OK;
}

cn_status cn_tet10_rest(cn_body *body, cn_error *error)
{
    double sum = 0;
    const cn_status status = connect(body, error);
    if (status != CN_OK) return status;
    for (int e = 0; e < body->ntet; e++) {
        double grad[CN_TET10_POINTS][9], volume[CN_TET10_POINTS];
        cn_tet10_points(body, e, grad, volume);
        for (int q = 0; q < CN_TET10_POINTS; q++)
            body->volume[e] += volume[q];
        sum += fabs(body->volume[e]);
        body->rest_volume += body->volume[e];
    }
    for (int e = 0; e < body->ntet; e++) {
        int at = 0;
        const double mean = sum / body->ntet, least = least_jacobian(body, e, &at) / 6;
        if (!(least > 1e-14 * mean) && at < 0)
            return cn_fail(
                error, CN_FAULT_DEGENERATE, "", 0,
                "second-order tetrahedron %d folds over at its point of integration %d: its volume "
                "there is %g m^3 where the mean is %g m^3",
                e, at + CN_TET10_POINTS, least, mean);
        if (!(least > 1e-14 * mean))
            return cn_fail(
                error, CN_FAULT_DEGENERATE, "", 0,
                "second-order tetrahedron %d folds over at its node %d: its volume there is %g m^3 where "
                "the mean is %g m^3",
                e, nodes_of(body, e)[at], least, mean);
    }
    return CN_OK;
}

/* Points of the rule of 14: two orbits of four (three equal coordinates), one of six (two pairs). */
static double mass_point(int k, double l[4])
{
    static const double place[3] = {0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492};
    static const double weight[3] = {0.11268792571801585080, 0.073493043116361949544,
                                     0.042546020777081466438};
    const int orbit = k < 4 ? 0 : k < 8 ? 1 : 2;
    const double a = place[orbit];
    for (int i = 0; i < 4; i++)
        if (orbit < 2)
            l[i] = i == k % 4 ? 1 - 3 * a : a;
        else
            l[i] = i == edge_of[k - 8][0] || i == edge_of[k - 8][1] ? 0.5 - a : a;
    return weight[orbit];
}

void cn_tet10_mass(cn_body *body, double density)
{
    enum { MASS_POINTS = 14 };
    for (int e = 0; e < body->ntet; e++) {
        const int *n = nodes_of(body, e);
        double square[10] = {0}, sum = 0;
        for (int k = 0; k < MASS_POINTS; k++) {
            double l[4], rows[9];
            const double weight = mass_point(k, l);
            jacobian(body, n, l, rows);
            for (int a = 0; a < 10; a++) {
                const int i = a < 4 ? a : edge_of[a - 4][0], j = a < 4 ? a : edge_of[a - 4][1];
                const double shape = a < 4 ? l[i] * (2 * l[i] - 1) : 4 * l[i] * l[j];
                square[a] += weight * fabs(cn_det(rows)) * shape * shape;
            }
        }
        for (int a = 0; a < 10; a++)
            sum += square[a];
        for (int a = 0; a < 10; a++)
            body->mass[n[a]] += density * body->volume[e] * square[a] / sum;
    }
}

const cn_body_methods cn_body_tet10 = {.bind = cn_element_bind,
                                       .add_elastic = cn_element_add_elastic,
                                       .energy = cn_element_energy,
                                       .measure = cn_element_measure,
                                       .element_centre = cn_element_centre,
                                       .face_shares = cn_face_shares,
                                       .free_own = cn_element_free};
