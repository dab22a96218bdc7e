/* collider.c - edges of a triangulated surface and who owns each vertex and edge. */
#include "contact.h"

#include <stdlib.h>
#include "catnav/vec3.h"
#include "geometry.h"

typedef struct {
    int low, high, corner;
} half_edge;

static int by_ends(const void *p, const void *q)
{
    const half_edge *a = p, *b = q;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return (a->corner > b->corner) - (a->corner < b->corner);
}

static int highest_node(const int *tri)
{
    const int m = tri[0] > tri[1] ? tri[0] : tri[1];
    return m > tri[2] ? m : tri[2];
}

/* The owner is the triangle whose highest node is lowest: of a catheter, the one nearest the tip, so that a
 * free vertex is never owned by a triangle that is still in the sheath. */
static bool better_owner(const int *tri, int candidate, int owner)
{
    return owner < 0 || highest_node(tri + 3 * candidate) < highest_node(tri + 3 * owner);
}

/* Two triangles that share the edge and lie in one plane on opposite sides of it. */
static bool coplanar(const int *tri, const double *vert, int corner1, int corner2)
{
    const int *a = tri + 3 * (corner1 / 3), *b = tri + 3 * (corner2 / 3);
    const double *d = vert + 3 * b[(corner2 + 2 - 3 * (corner2 / 3)) % 3];
    double e[3], f[3], n[3], m[3];
    if (cn_orient3d(vert + 3 * a[0], vert + 3 * a[1], vert + 3 * a[2], d) != 0) return false;
    cn_sub(vert + 3 * a[1], vert + 3 * a[0], e), cn_sub(vert + 3 * a[2], vert + 3 * a[0], f),
        cn_cross(e, f, n);
    cn_sub(vert + 3 * b[1], vert + 3 * b[0], e), cn_sub(vert + 3 * b[2], vert + 3 * b[0], f),
        cn_cross(e, f, m);
    return cn_dot(n, m) > 0;
}

/* Moves flat edges and corners from `owns` to `flat`; `bent` counts the other edges at each node. */
static void mark_flat(cn_collider *c, const half_edge *half, const double *vert, int *bent)
{
    for (int h = 0, end; h < 3 * c->ntri; h = end) {
        for (end = h; end < 3 * c->ntri && half[end].low == half[h].low && half[end].high == half[h].high;)
            end++;
        if (end - h != 2 || !coplanar(c->tri, vert, half[h].corner, half[h + 1].corner)) {
            bent[half[h].low]++, bent[half[h].high]++;
            continue;
        }
        for (int k = h; k < end; k++) {
            const int t = half[k].corner / 3, bit = 8 << half[k].corner % 3;
            c->flat[t] |= (unsigned char)bit;
            c->above[t] |= (unsigned char)(c->owns[t] & bit);
            c->owns[t] &= (unsigned char)~bit;
        }
    }
    for (int i = 0; i < 3 * c->ntri; i++)
        if (bent[c->tri[i]] == 0) {
            const int t = i / 3, bit = 1 << i % 3;
            c->flat[t] |= (unsigned char)bit;
            c->above[t] |= (unsigned char)(c->owns[t] & bit);
            c->owns[t] &= (unsigned char)~bit;
        }
}

cn_status cn_collider_new(cn_collider **out, int ntri, const int *tri, int nnode, const double *vert)
{
    cn_collider *collider = calloc(1, sizeof *collider);
    half_edge *half = NULL;
    int *owner = NULL;
    *out = NULL;
    if (!collider) return CN_ERR_MEMORY;
    collider->ntri = ntri, collider->nnode = nnode, collider->tri = tri;
    collider->edge = malloc((6 * (size_t)ntri + 1) * sizeof *collider->edge);
    collider->tri_edge = malloc((3 * (size_t)ntri + 1) * sizeof *collider->tri_edge);
    collider->owns = calloc((size_t)ntri + 1, 1);
    half = malloc((3 * (size_t)ntri + 1) * sizeof *half);
    owner = malloc(((size_t)nnode + 1) * sizeof *owner);
    if (!collider->edge || !collider->tri_edge || !collider->owns || !half || !owner) goto fail;

    for (int c = 0; c < 3 * ntri; c++) {
        const int i = tri[c], j = tri[c - c % 3 + (c + 1) % 3];
        half[c] = (half_edge){i < j ? i : j, i < j ? j : i, c};
    }
    qsort(half, 3 * (size_t)ntri, sizeof *half, by_ends);
    for (int h = 0; h < 3 * ntri;) {
        int best = -1, end = h;
        for (; end < 3 * ntri && half[end].low == half[h].low && half[end].high == half[h].high; end++) {
            collider->tri_edge[half[end].corner] = collider->nedge;
            if (better_owner(tri, half[end].corner / 3, best < 0 ? -1 : best / 3)) best = half[end].corner;
        }
        collider->owns[best / 3] |= (unsigned char)(8 << best % 3);
        collider->edge[2 * collider->nedge] = half[h].low;
        collider->edge[2 * collider->nedge + 1] = half[h].high;
        collider->nedge++;
        h = end;
    }
    for (int i = 0; i < nnode; i++)
        owner[i] = -1;
    for (int c = 0; c < 3 * ntri; c++)
        if (better_owner(tri, c / 3, owner[tri[c]] < 0 ? -1 : owner[tri[c]] / 3)) owner[tri[c]] = c;
    for (int i = 0; i < nnode; i++)
        if (owner[i] >= 0) collider->owns[owner[i] / 3] |= (unsigned char)(1 << owner[i] % 3);

    if (vert) {
        collider->flat = calloc((size_t)ntri + 1, 1), collider->above = calloc((size_t)ntri + 1, 1);
        if (!collider->flat || !collider->above) goto fail;
        for (int i = 0; i < nnode; i++)
            owner[i] = 0;
        mark_flat(collider, half, vert, owner);
    }
    free(half), free(owner);
    *out = collider;
    return CN_OK;
fail:
    free(half), free(owner);
    cn_collider_free(collider);
    return CN_ERR_MEMORY;
}

void cn_collider_free(cn_collider *collider)
{
    if (!collider) return;
    free(collider->edge), free(collider->tri_edge), free(collider->owns);
    free(collider->flat), free(collider->above);
    free(collider);
}
