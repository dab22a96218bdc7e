/* collider.c - edges of a triangulated surface and who owns each vertex and edge. */
#include "contact.h"

#include <stdlib.h>

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

cn_status cn_collider_new(cn_collider **out, int ntri, const int *tri, int nnode)
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
    free(collider);
}
