/* tree_node.h - inside of the AABB tree, shared by tree.c and tree_query.c only. */
#ifndef CN_TREE_NODE_H
#define CN_TREE_NODE_H

#include <stdbool.h>

typedef struct {
    double min[3], max[3];
} box;

typedef struct {
    box box;
    int first; /* leaf: first slot; branch: the right child (the left one is the next node) */
    int count; /* triangles of a leaf, 0 for a branch */
    int below; /* triangles of the subtree */
} node;

enum {
    LEAF = 4,    /* triangles of a leaf at most */
    DEPTH = 100, /* 2 * 32 + 4 levels split by cost, then at most 31 by count */
    STACK =
        4 * DEPTH /* open nodes (DEPTH + 1) or pairs (2 for each level of both trees, + 1) of a traversal */
};

struct cn_tree {
    int ntri, nnode;
    node *node;         /* children behind their parent, left subtree first (nnode) */
    int *order;         /* triangle in a slot (ntri) */
    int *corner;        /* its vertices (ntri x 3) */
    box *box;           /* its box (ntri) */
    const double *vert; /* the caller's */
    int nvert, *used;   /* vertices of the triangles, each once (nvert) */
    box *room;          /* where each may be while the boxes hold that were loosened ... */
    double loosened;    /* ... for this margin; -1: they were not (nvert) */
};

/* Boxes, the first inflated by margin, have no common point. The difference is rounded monotonically, so that
 * no pair is lost; NaN counts as meeting. */
static inline bool boxes_apart(const box *a, const box *b, double margin)
{
    return a->min[0] - b->max[0] > margin || b->min[0] - a->max[0] > margin ||
           a->min[1] - b->max[1] > margin || b->min[1] - a->max[1] > margin ||
           a->min[2] - b->max[2] > margin || b->min[2] - a->max[2] > margin;
}

#endif
