/* mesh_measure.c - the doctor of tetrahedra: volumes, angles, quality, topology. Changes nothing. */
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

static const double *node(const cn_tets *tets, int i, int k)
{
    return tets->node + 3 * (size_t)tets->tet[4 * (size_t)i + k];
}

static double volume(const cn_tets *tets, int i)
{
    return cn_tet_volume6(node(tets, i, 0), node(tets, i, 1), node(tets, i, 2), node(tets, i, 3)) / 6;
}

static cn_status check_numbers(const cn_tets *tets, cn_error *error)
{
    if (tets->ntet < 1 || tets->nnode < 4 || tets->ntet > INT_MAX / 4)
        return cn_fail(error, CN_FAULT_NO_PARTS, NULL, 0,
                       "the mesh has %d nodes and %d tetrahedra: nothing to measure", tets->nnode,
                       tets->ntet);
    for (int i = 0; i < tets->nnode; i++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(tets->node[3 * (size_t)i + k]))
                return cn_fail(error, CN_ERR_NOT_FINITE, NULL, 0, "node %d has %c = %g: give a finite number",
                               i, "xyz"[k], tets -> node[3 * (size_t)i + k]);
    for (int i = 0; i < 4 * tets->ntet; i++)
        if (tets->tet[i] < 0 || tets->tet[i] >= tets->nnode)
            return cn_fail(error, CN_FAULT_NO_VERTEX, NULL, 0,
                           "tetrahedron %d names node %d, but nodes run from 0 to %d", i / 4, tets->tet[i],
                           tets->nnode - 1);
    return CN_OK;
}

/* Least and largest angle [degrees] between two faces of one tetrahedron. */
static void dihedrals(const cn_tets *tets, int i, double *least, double *largest)
{
    *least = 180, *largest = 0;
    for (int k = 0; k < 6; k++) { /* the edge a b lies between the faces a b c and a b d */
        static const int edge[6][4] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2},
                                       {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};
        double e[3], c[3], d[3], nc[3], nd[3], cross[3];
        cn_sub(node(tets, i, edge[k][1]), node(tets, i, edge[k][0]), e);
        cn_sub(node(tets, i, edge[k][2]), node(tets, i, edge[k][0]), c);
        cn_sub(node(tets, i, edge[k][3]), node(tets, i, edge[k][0]), d);
        cn_cross(e, c, nc);
        cn_cross(e, d, nd);
        cn_cross(nc, nd, cross);
        const double angle = atan2(cn_norm(cross), cn_dot(nc, nd)) * (180 / 3.14159265358979323846);
        *least = fmin(*least, angle), *largest = fmax(*largest, angle);
    }
}

/* Volume over that of the regular tetrahedron with the same root mean square edge; longest edge over
 * inscribed radius, made 1 for the regular one. */
static void shape(const cn_tets *tets, int i, double v, double *quality, double *aspect)
{
    double square = 0, longest = 0, area = 0;

    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++) {
            const double length = cn_distance(node(tets, i, a), node(tets, i, b));
            square += length * length;
            longest = fmax(longest, length);
        }
    for (int a = 0; a < 4; a++) {
        double u[3], w[3], n[3];
        cn_sub(node(tets, i, (a + 1) % 4), node(tets, i, a), u);
        cn_sub(node(tets, i, (a + 2) % 4), node(tets, i, a), w);
        cn_cross(u, w, n);
        area += cn_norm(n) / 2;
    }
    const double inscribed = 3 * fabs(v) / area, root = cbrt(3 * v);
    *quality = square > 0 ? copysign(12 * root * root / square, v) : 0;
    *aspect = inscribed > 0 ? longest / (4.898979485566356 * inscribed) : INFINITY; /* 2 sqrt 6 */
}

static void measure_shapes(const cn_tets *tets, cn_tets_doctor *d)
{
    double sum = 0, quality_sum = 0;

    d->dihedral_min = 180, d->quality_min = INFINITY, d->volume_min = INFINITY, d->volume_max = -INFINITY;
    for (int i = 0; i < tets->ntet; i++)
        sum += fabs(volume(tets, i));
    for (int i = 0; i < tets->ntet; i++) {
        const double v = volume(tets, i);
        double least, largest, quality, aspect;
        dihedrals(tets, i, &least, &largest);
        shape(tets, i, v, &quality, &aspect);
        d->volume += v;
        quality_sum += quality;
        d->inverted += v < 0;
        d->flat += !(fabs(v) > 1e-14 * sum / tets->ntet);
        d->slivers += least < 1;
        d->volume_min = fmin(d->volume_min, v), d->volume_max = fmax(d->volume_max, v);
        if (least < d->dihedral_min) d->dihedral_min = least, d->dihedral_min_tet = i;
        if (largest > d->dihedral_max) d->dihedral_max = largest, d->dihedral_max_tet = i;
        if (quality < d->quality_min) d->quality_min = quality, d->quality_min_tet = i;
        if (aspect > d->aspect_max) d->aspect_max = aspect, d->aspect_max_tet = i;
    }
    d->quality_mean = quality_sum / tets->ntet;
}

static cn_status measure_topology(const cn_tets *tets, cn_tets_doctor *d)
{
    const int n = 4 * tets->ntet;
    char *used = cn_array((size_t)tets->nnode, 1);
    int *component = cn_array((size_t)tets->ntet, sizeof *component);
    cn_facet *face = cn_array((size_t)n, sizeof *face);
    cn_status status = CN_ERR_MEMORY;

    if (!used || !component || !face) goto done;
    for (int i = 0; i < n; i++) {
        const int *t = tets->tet + (i & ~3);
        face[i] = cn_facet_face(t[(i + 1) % 4], t[(i + 2) % 4], t[(i + 3) % 4], i);
        used[tets->tet[i]] = 1;
    }
    for (int i = 0; i < tets->ntet; i++)
        component[i] = i;
    if ((status = cn_facet_sort(tets->nnode, n, face)) != CN_OK) goto done;
    for (int i = 0, j; i < n; i = j) {
        j = cn_facet_run(n, face, i);
        d->boundary += j - i == 1;
        d->nonmanifold_faces += j - i > 2;
        for (int k = i + 1; k < j; k++)
            cn_set_join(component, face[i].item / 4, face[k].item / 4);
    }
    for (int i = 0; i < tets->ntet; i++)
        d->components += cn_set_find(component, i) == i;
    for (int i = 0; i < tets->nnode; i++)
        d->unused += !used[i];
done:
    free(used);
    free(component);
    free(face);
    return status;
}

cn_status cn_tets_measure(const cn_tets *tets, cn_tets_doctor *doctor, cn_error *error)
{
    double diagonal[3];
    cn_status status;

    *doctor = (cn_tets_doctor){.nnode = tets->nnode, .ntet = tets->ntet};
    if ((status = check_numbers(tets, error)) != CN_OK) return status;
    if ((status = measure_topology(tets, doctor)) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory measuring %d tetrahedra", tets->ntet);
    measure_shapes(tets, doctor);
    cn_copy3(tets->node, doctor->min);
    cn_copy3(tets->node, doctor->max);
    for (size_t i = 0; i < 3 * (size_t)tets->nnode; i++) {
        doctor->min[i % 3] = fmin(doctor->min[i % 3], tets->node[i]);
        doctor->max[i % 3] = fmax(doctor->max[i % 3], tets->node[i]);
    }
    cn_sub(doctor->max, doctor->min, diagonal);
    doctor->size = cn_norm(diagonal);
    cn_guess_unit(doctor->size, doctor->unit_guess);
    return CN_OK;
}
