/* tree.c - AABB tree: build, refit, boxes against boxes.
 *
 * Built top-down: each node is cut across its longest side where a binned surface area estimate is least
 * (Wald, On fast Construction of SAH-based Bounding Volume Hierarchies, 2007). Below 2 log2 n + 4 levels, or
 * where no cut parts the centres, it is halved by count, which bounds depth by 3 log2 n + 4 and the build by
 * O(n log n). */
#include "tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "tree_node.h"

enum { NBIN = 16 };

typedef struct { /* a triangle while the tree is built */
    box box;
    int tri;
} item;

static const box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static inline void grow(box *b, const double min[3], const double max[3])
{
    for (int k = 0; k < 3; k++) {
        b->min[k] = min[k] < b->min[k] ? min[k] : b->min[k];
        b->max[k] = max[k] > b->max[k] ? max[k] : b->max[k];
    }
}

static inline box box_of(const int corner[3], const double *vert)
{
    box b = nothing;
    for (int i = 0; i < 3; i++)
        grow(&b, vert + 3 * (size_t)corner[i], vert + 3 * (size_t)corner[i]);
    return b;
}

static inline double centre(const box *b, int axis)
{
    return 0.5 * b->min[axis] + 0.5 * b->max[axis];
}

static double half_area(const box *b)
{
    const double x = b->max[0] - b->min[0], y = b->max[1] - b->min[1], z = b->max[2] - b->min[2];
    return x * y + y * z + z * x;
}

static inline bool before(const item *a, const item *b, int axis)
{
    const double x = centre(&a->box, axis), y = centre(&b->box, axis);
    return x < y || (x == y && a->tri < b->tri);
}

static inline void exchange(item *a, item *b)
{
    const item swap = *a;
    *a = *b, *b = swap;
}

/* Moves the lower half (by centre, then index) to the front: quickselect, median of three. */
static void halve(item *list, int n, int axis)
{
    int low = 0, high = n - 1;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (before(list + middle, list + low, axis)) exchange(list + middle, list + low);
        if (before(list + high, list + low, axis)) exchange(list + high, list + low);
        if (before(list + high, list + middle, axis)) exchange(list + high, list + middle);
        const item pivot = list[middle];
        int i = low, j = high;
        while (i <= j) {
            while (before(list + i, &pivot, axis))
                i++;
            while (before(&pivot, list + j, axis))
                j--;
            if (i <= j) exchange(list + i++, list + j--);
        }
        if (n / 2 <= j)
            high = j;
        else if (n / 2 >= i)
            low = i;
        else
            return;
    }
}

static inline int bin_of(const item *one, int axis, double low, double scale)
{
    const double x = (centre(&one->box, axis) - low) * scale;
    return !(x > 0) ? 0 : x < NBIN ? (int)x : NBIN - 1;
}

/* Parts the list in two and returns the size of the first part, in [1, n - 1]. */
static int part(item *list, int n, bool by_count)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const double c = centre(&list[i].box, k);
            low[k] = c < low[k] ? c : low[k], high[k] = c > high[k] ? c : high[k];
        }
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    const double scale = NBIN / (high[axis] - low[axis]);
    if (by_count || !(scale > 0 && scale < INFINITY)) {
        halve(list, n, axis);
        return n / 2;
    }

    struct {
        box box;
        int count;
    } bin[NBIN];
    for (int i = 0; i < NBIN; i++)
        bin[i].box = nothing, bin[i].count = 0;
    for (int i = 0; i < n; i++) {
        const int b = bin_of(list + i, axis, low[axis], scale);
        grow(&bin[b].box, list[i].box.min, list[i].box.max), bin[b].count++;
    }

    /* cost of a cut before bin i: area times count on both sides */
    double right[NBIN], least = INFINITY;
    int cut = 0, count = 0;
    box b = nothing;
    for (int i = NBIN - 1; i > 0; i--) {
        grow(&b, bin[i].box.min, bin[i].box.max), count += bin[i].count;
        right[i] = count ? half_area(&b) * count : INFINITY;
    }
    b = nothing, count = 0;
    for (int i = 1; i < NBIN; i++) {
        grow(&b, bin[i - 1].box.min, bin[i - 1].box.max), count += bin[i - 1].count;
        const double cost = count ? half_area(&b) * count + right[i] : INFINITY;
        if (cost < least) least = cost, cut = i;
    }
    if (!cut) { /* sizes overflow */
        halve(list, n, axis);
        return n / 2;
    }
    int i = 0, j = n;
    while (i < j)
        if (bin_of(list + i, axis, low[axis], scale) < cut)
            i++;
        else
            exchange(list + i, list + --j);
    return i;
}

/* Appends the subtree over list[0 .. n), whose first slot is first. */
static void build(cn_tree *tree, item *list, int first, int n, int levels)
{
    node *const here = tree->node + tree->nnode++;
    here->below = n;
    if (n <= LEAF) {
        here->first = first, here->count = n;
        return;
    }
    const int left = part(list, n, levels <= 0);
    here->count = 0;
    build(tree, list, first, left, levels - 1);
    here->first = tree->nnode;
    build(tree, list + left, first + left, n - left, levels - 1);
}

/* Node boxes from those of the slots: children lie behind their parent. */
static void join(cn_tree *tree)
{
    for (int i = tree->nnode - 1; i >= 0; i--) {
        node *const at = tree->node + i;
        const node *const right = tree->node + at->first;
        at->box = at->count ? tree->box[at->first] : at[1].box;
        for (int j = 1; j < at->count; j++)
            grow(&at->box, tree->box[at->first + j].min, tree->box[at->first + j].max);
        if (!at->count) grow(&at->box, right->box.min, right->box.max);
    }
}

static int ascending(const void *a, const void *b)
{
    const int i = *(const int *)a, j = *(const int *)b;
    return (i > j) - (i < j);
}

static cn_status note_vertices(cn_tree *tree)
{
    const int n = 3 * tree->ntri;
    tree->loosened = -1;
    if (!(tree->used = malloc(((size_t)n + 1) * sizeof *tree->used))) return CN_ERR_MEMORY;
    memcpy(tree->used, tree->corner, (size_t)n * sizeof *tree->used);
    qsort(tree->used, (size_t)n, sizeof *tree->used, ascending);
    for (int i = 0; i < n; i++)
        if (i == 0 || tree->used[i] != tree->used[tree->nvert - 1]) tree->used[tree->nvert++] = tree->used[i];
    tree->room = malloc(((size_t)tree->nvert + 1) * sizeof *tree->room);
    return tree->room ? CN_OK : CN_ERR_MEMORY;
}

cn_status cn_tree_new(cn_tree **out, int ntri, const int *tri, const double *vert)
{
    cn_status status = CN_ERR_MEMORY;
    cn_tree *tree = NULL;
    item *list = NULL;
    const size_t n = ntri > 0 ? (size_t)ntri : 1;

    *out = NULL;
    if (ntri < 0 || (ntri > 0 && (!tri || !vert))) return CN_ERR_ARG;
    if (!(tree = calloc(1, sizeof *tree))) return CN_ERR_MEMORY;
    if (!(list = malloc(n * sizeof *list)) || !(tree->node = malloc(2 * n * sizeof *tree->node))) goto done;
    if (!(tree->order = malloc(n * sizeof *tree->order)) || !(tree->box = malloc(n * sizeof *tree->box)))
        goto done;
    if (!(tree->corner = malloc(3 * n * sizeof *tree->corner))) goto done;

    for (int i = 0; i < ntri; i++) {
        const int *const corner = tri + 3 * (size_t)i;
        status = CN_ERR_ARG;
        if (corner[0] < 0 || corner[1] < 0 || corner[2] < 0) goto done;
        double zero = 0; /* stays 0 as long as all coordinates are finite */
        for (int k = 0; k < 9; k++)
            zero += 0 * vert[3 * (size_t)corner[k / 3] + (size_t)(k % 3)];
        status = CN_ERR_NOT_FINITE;
        if (zero != 0) goto done;
        list[i] = (item){box_of(corner, vert), i};
    }
    int levels = 4;
    for (int i = ntri; i > 0; i /= 2)
        levels += 2;
    tree->ntri = ntri, tree->vert = vert;
    if (ntri > 0) build(tree, list, 0, ntri, levels);
    for (int i = 0; i < ntri; i++) {
        tree->order[i] = list[i].tri, tree->box[i] = list[i].box;
        for (int k = 0; k < 3; k++)
            tree->corner[3 * (size_t)i + (size_t)k] = tri[3 * (size_t)list[i].tri + (size_t)k];
    }
    node *const fit = realloc(tree->node, (size_t)(tree->nnode + 1) * sizeof *fit);
    if (fit) tree->node = fit; /* else the longer one stays */
    join(tree);
    status = note_vertices(tree);
done:
    free(list);
    if (status == CN_OK)
        *out = tree;
    else
        cn_tree_free(tree);
    return status;
}

void cn_tree_free(cn_tree *tree)
{
    if (!tree) return;
    free(tree->node), free(tree->order), free(tree->corner), free(tree->box);
    free(tree->used), free(tree->room), free(tree);
}

void cn_tree_refit(cn_tree *tree, const double *vert)
{
    tree->vert = vert, tree->loosened = -1;
    for (int i = 0; i < tree->ntri; i++)
        tree->box[i] = box_of(tree->corner + 3 * (size_t)i, vert);
    join(tree);
}

void cn_tree_refit_swept(cn_tree *tree, const double *vert, const double *vert_end, double margin)
{
    tree->vert = vert, tree->loosened = -1;
    for (int i = 0; i < tree->ntri; i++) {
        const box end = box_of(tree->corner + 3 * (size_t)i, vert_end);
        box b = box_of(tree->corner + 3 * (size_t)i, vert);
        grow(&b, end.min, end.max);
        for (int k = 0; k < 3; k++) { /* outward by more than the rounding of the sum */
            const double min = b.min[k] - margin, max = b.max[k] + margin;
            b.min[k] = min - (margin > 0 ? 0x1p-52 * fabs(min) : 0);
            b.max[k] = max + (margin > 0 ? 0x1p-52 * fabs(max) : 0);
        }
        tree->box[i] = b;
    }
    join(tree);
}

/* A vertex's box over its motion. */
static box swept(const double *vert, const double *vert_end, int v)
{
    box b;
    for (int k = 0; k < 3; k++) {
        const double from = vert[3 * (size_t)v + (size_t)k], to = vert_end[3 * (size_t)v + (size_t)k];
        b.min[k] = from < to ? from : to, b.max[k] = from < to ? to : from;
    }
    return b;
}

void cn_tree_refit_loose(cn_tree *tree, const double *vert, const double *vert_end, double margin,
                         double slack)
{
    bool holds = tree->loosened >= margin;
    for (int i = 0; holds && i < tree->nvert; i++) {
        const box b = swept(vert, vert_end, tree->used[i]), *room = &tree->room[i];
        for (int k = 0; k < 3; k++)
            holds = holds && b.min[k] >= room->min[k] && b.max[k] <= room->max[k];
    }
    tree->vert = vert;
    if (holds) return;
    cn_tree_refit_swept(tree, vert, vert_end, margin + 1.001 * slack);
    for (int i = 0; i < tree->nvert; i++) {
        tree->room[i] = swept(vert, vert_end, tree->used[i]);
        for (int k = 0; k < 3; k++)
            tree->room[i].min[k] -= slack, tree->room[i].max[k] += slack;
    }
    tree->loosened = margin;
}

void cn_tree_box(const cn_tree *tree, double min[3], double max[3])
{
    const box *const b = tree->nnode ? &tree->node->box : &nothing;
    for (int k = 0; k < 3; k++)
        min[k] = b->min[k], max[k] = b->max[k];
}

int cn_tree_query_box(const cn_tree *tree, const double min[3], const double max[3], int capacity, int *out)
{
    const box asked = {{min[0], min[1], min[2]}, {max[0], max[1], max[2]}};
    int stack[STACK], top = 0, found = 0;
    if (tree->nnode) stack[top++] = 0;
    while (top) {
        const int i = stack[--top];
        const node *const at = tree->node + i;
        if (boxes_apart(&at->box, &asked, 0)) continue;
        for (int j = at->first; j < at->first + at->count; j++) {
            if (boxes_apart(&tree->box[j], &asked, 0)) continue;
            if (found < capacity) out[found] = tree->order[j];
            found++;
        }
        if (!at->count) stack[top++] = at->first, stack[top++] = i + 1;
    }
    return found;
}

typedef struct {
    int a, b; /* nodes */
} pair;

/* All pairs below two nodes, both trees being one and the nodes equal where self. */
static bool visit_pairs(const cn_tree *a, const cn_tree *b, bool self, double margin, cn_pair_visit visit,
                        void *user)
{
    pair stack[STACK];
    int top = 0;
    if (a->nnode && b->nnode) stack[top++] = (pair){0, 0};
    while (top) {
        const pair p = stack[--top];
        const node *const u = a->node + p.a, *const v = b->node + p.b;
        const bool same = self && p.a == p.b;
        if (!same && boxes_apart(&u->box, &v->box, margin)) continue;
        if (u->count && v->count) {
            for (int i = u->first; i < u->first + u->count; i++)
                for (int j = same ? i + 1 : v->first; j < v->first + v->count; j++) {
                    const int s = a->order[i], t = b->order[j];
                    if (boxes_apart(&a->box[i], &b->box[j], margin)) continue;
                    if (!visit(user, self && t < s ? t : s, self && t < s ? s : t)) return false;
                }
        } else if (same) {
            stack[top++] = (pair){p.a + 1, u->first};
            stack[top++] = (pair){u->first, u->first};
            stack[top++] = (pair){p.a + 1, p.a + 1};
        } else if (v->count || (!u->count && u->below >= v->below)) {
            stack[top++] = (pair){u->first, p.b}, stack[top++] = (pair){p.a + 1, p.b};
        } else {
            stack[top++] = (pair){p.a, v->first}, stack[top++] = (pair){p.a, p.b + 1};
        }
    }
    return true;
}

bool cn_tree_query_pairs(const cn_tree *a, const cn_tree *b, double margin, cn_pair_visit visit, void *user)
{
    return visit_pairs(a, b, false, margin, visit, user);
}

bool cn_tree_query_self(const cn_tree *tree, double margin, cn_pair_visit visit, void *user)
{
    return visit_pairs(tree, tree, true, margin, visit, user);
}
