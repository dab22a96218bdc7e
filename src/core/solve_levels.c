/* solve_levels.c - level structures of a pattern: found, checked, and what elimination by them costs. */
#include "solve_parts.h"

#include <stdlib.h>
#include <string.h>

cn_status cn_levels_cost(const cn_matrix *pattern, const int *level, double *flops, double *size)
{
    int nlevel = 0;

    *flops = *size = 0;
    for (int i = 0; i < pattern->n; i++)
        if (level[i] >= nlevel) nlevel = level[i] + 1;
    double *m = calloc((size_t)nlevel + 1, sizeof *m);
    if (!m) return CN_ERR_MEMORY;
    for (int i = 0; i < pattern->n; i++)
        m[level[i]] += 3;
    for (int l = 0; l < nlevel; l++) {
        *flops += cn_level_flops(m[l], m[l + 1]);
        *size += m[l] * (m[l] + m[l + 1]);
    }
    free(m);
    return CN_OK;
}

bool cn_levels_check(const cn_matrix *pattern, const int *level)
{
    for (int i = 0; i < pattern->n; i++) {
        if (level[i] < 0 || level[i] >= pattern->n) return false;
        for (int k = pattern->row[i]; k < pattern->row[i + 1]; k++)
            if (abs(level[i] - level[pattern->col[k]]) > 1) return false;
    }
    return true;
}

/* Whether rows i and j have their blocks in the same columns: position and rotation of a rod's station. */
static bool alike(const cn_matrix *a, int i, int j)
{
    const int count = a->row[i + 1] - a->row[i];

    return a->row[j + 1] - a->row[j] == count &&
           memcmp(a->col + a->row[i], a->col + a->row[j], (size_t)count * sizeof *a->col) == 0;
}

/* Levels of i's component by breadth-first search, counted from `base`: first i and those alike. Nodes in
 * queue order. Returns their number; the last in the queue is one of the farthest. `level` entries below
 * `base` are nodes not to be entered. */
static int breadth_first(const cn_matrix *a, int i, int base, int *level, int *queue)
{
    int count = 0;

    for (int k = a->row[i]; k < a->row[i + 1]; k++)
        if (alike(a, i, a->col[k])) {
            queue[count++] = a->col[k];
            level[a->col[k]] = base;
        }
    for (int head = 0; head < count; head++)
        for (int k = a->row[queue[head]]; k < a->row[queue[head] + 1]; k++) {
            const int j = a->col[k];
            if (level[j] >= 0) continue;
            level[j] = level[queue[head]] + 1;
            queue[count++] = j;
        }
    return count;
}

cn_status cn_levels_find(const cn_matrix *pattern, int *level)
{
    int *queue = malloc(((size_t)pattern->n + 1) * sizeof *queue);
    int base = 0;

    if (!queue) return CN_ERR_MEMORY;
    for (int i = 0; i < pattern->n; i++)
        level[i] = -1;
    for (int i = 0; i < pattern->n; i++) {
        if (level[i] >= 0) continue;
        int start = i, depth = -1;
        for (;;) { /* George and Liu's pseudo-peripheral node: farther as long as the depth grows */
            const int count = breadth_first(pattern, start, base, level, queue);
            const int last = queue[count - 1], grown = level[last] - base;
            if (grown <= depth) {
                base = level[last] + 1;
                break;
            }
            depth = grown;
            start = last;
            for (int k = 0; k < count; k++)
                level[queue[k]] = -1;
        }
    }
    free(queue);
    return CN_OK;
}
