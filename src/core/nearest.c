/* nearest.c - points in the order of the tree: the middle of a range is its root, split along the axis where
 * the range is widest; ranges up to LEAF points are searched one by one. */
#include "nearest.h"

#include <math.h>
#include <stdlib.h>

enum { LEAF = 8 };

typedef struct {
    double x[3];
    int index, axis;
} point;

struct cn_nearest_tree {
    int n;
    point *point;
};

static int before(const point *a, const point *b, int axis)
{
    return a->x[axis] < b->x[axis] || (a->x[axis] == b->x[axis] && a->index < b->index);
}

static void swap(point *a, point *b)
{
    const point kept = *a;
    *a = *b, *b = kept;
}

/* Puts the one that belongs there at `middle` of [from, to), smaller ones before it (quickselect; no two
 * points are equal). */
static void split(point *p, int from, int to, int middle, int axis)
{
    while (to - from > 1) {
        const int half = from + (to - from) / 2;
        if (before(p + to - 1, p + from, axis)) swap(p + to - 1, p + from);
        if (before(p + half, p + from, axis)) swap(p + half, p + from);
        if (before(p + to - 1, p + half, axis)) swap(p + to - 1, p + half); /* median of three at half */
        const point pivot = p[half];
        int i = from, j = to - 1;
        while (i <= j) {
            while (before(p + i, &pivot, axis))
                i++;
            while (before(&pivot, p + j, axis))
                j--;
            if (i <= j) swap(p + i++, p + j--);
        }
        if (middle <= j)
            to = j + 1;
        else if (middle >= i)
            from = i;
        else
            return;
    }
}

static void build(point *p, int from, int to)
{
    while (to - from > LEAF) {
        double min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY};
        const int middle = from + (to - from) / 2;
        int axis = 0;
        for (int i = from; i < to; i++)
            for (int k = 0; k < 3; k++)
                min[k] = fmin(min[k], p[i].x[k]), max[k] = fmax(max[k], p[i].x[k]);
        for (int k = 1; k < 3; k++)
            if (max[k] - min[k] > max[axis] - min[axis]) axis = k;
        split(p, from, to, middle, axis);
        p[middle].axis = axis;
        build(p, from, middle);
        from = middle + 1;
    }
}

cn_status cn_nearest_new(cn_nearest_tree **out, int n, const double *place)
{
    cn_nearest_tree *tree = malloc(sizeof *tree);
    *out = NULL;
    if (!tree) return CN_ERR_MEMORY;
    tree->n = n;
    if (!(tree->point = malloc(((size_t)n + 1) * sizeof *tree->point))) {
        free(tree);
        return CN_ERR_MEMORY;
    }
    for (int i = 0; i < n; i++) {
        const double *x = place + 3 * (size_t)i;
        tree->point[i] = (point){{x[0], x[1], x[2]}, i, 0};
    }
    build(tree->point, 0, n);
    *out = tree;
    return CN_OK;
}

void cn_nearest_free(cn_nearest_tree *tree)
{
    if (!tree) return;
    free(tree->point);
    free(tree);
}

typedef struct {
    const double *p;
    int k, found, *index;
    double *square;
} search;

static void offer(search *s, const point *at)
{
    const double d[3] = {at->x[0] - s->p[0], at->x[1] - s->p[1], at->x[2] - s->p[2]};
    const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    int i = s->found;
    if (i == s->k) {
        if (square > s->square[i - 1] || (square == s->square[i - 1] && at->index > s->index[i - 1])) return;
        i--;
    } else
        s->found++;
    for (;
         i > 0 && (square < s->square[i - 1] || (square == s->square[i - 1] && at->index < s->index[i - 1]));
         i--)
        s->square[i] = s->square[i - 1], s->index[i] = s->index[i - 1];
    s->square[i] = square, s->index[i] = at->index;
}

static void look(search *s, const point *p, int from, int to)
{
    while (to - from > LEAF) {
        const int middle = from + (to - from) / 2;
        const double d = s->p[p[middle].axis] - p[middle].x[p[middle].axis];
        offer(s, p + middle);
        if (d < 0)
            look(s, p, from, middle);
        else
            look(s, p, middle + 1, to);
        if (s->found == s->k && d * d > s->square[s->k - 1]) return;
        if (d < 0)
            from = middle + 1;
        else
            to = middle;
    }
    for (int i = from; i < to; i++)
        offer(s, p + i);
}

int cn_nearest_find(const cn_nearest_tree *tree, const double p[3], int k, int *index, double *square)
{
    search s = {p, k < tree->n ? k : tree->n, 0, index, square};
    if (s.k > 0) look(&s, tree->point, 0, tree->n);
    return s.found;
}
