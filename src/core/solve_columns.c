/* solve_columns.c - columns of A^-1 from its Cholesky factor, eight nodes' at once, as far as they reach.
 *
 * L y = e: y lives on the way from the nodes up the elimination tree alone, and y.y is the column's diagonal
 * entry. L' x = y, from the top down: where a block's y is nothing and the x further up that it reads are all
 * negligible, so is its own x, and that of all below it. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "solve_parts.h"

#define INLINE static inline __attribute__((always_inline))

INLINE int rows_of(const cn_factor_view *l, int b)
{
    return l->nrow ? l->nrow[b] : l->row_at[b + 1] - l->row_at[b];
}

INLINE int first_of(const cn_factor_view *l, int b)
{
    return l->first ? l->first[b] : b;
}

/* A block of L's columns. */
typedef struct {
    int first, ncol, nrow;
    const int *row;
    const double *value;
} block;

INLINE block block_at(const cn_factor_view *l, int b)
{
    const int first = first_of(l, b);
    return (block){first, first_of(l, b + 1) - first, rows_of(l, b), l->row + l->row_at[b],
                   l->value + l->value_at[b]};
}

#define TARGET
#define VECTOR       vector2
#define LANES        2
#define KERNEL(name) name##_plain
#include "solve_columns_kernel.h"
#ifdef __x86_64__
#define TARGET       __attribute__((target("avx2")))
#define VECTOR       vector4
#define LANES        4
#define KERNEL(name) name##_avx2
#include "solve_columns_kernel.h"
#define TARGET       __attribute__((target("avx512f,avx512dq,avx512vl,avx2")))
#define VECTOR       vector8
#define LANES        8
#define KERNEL(name) name##_avx512
#include "solve_columns_kernel.h"
#endif

cn_status cn_columns_new(cn_columns **out, const cn_sparse *sparse, int most)
{
    const cn_factor_view l = cn_sparse_view(sparse);
    const size_t n = (size_t)l.n, width = CN_COLUMNS * sizeof(double);
    cn_columns *c = calloc(1, sizeof *c);
    *out = NULL;
    if (!c) return CN_ERR_MEMORY;
    c->n = l.n, c->node = l.node;
    c->memory = calloc(3 * n * width + 64, 1);
    c->place = malloc((n + 1) * sizeof *c->place);
    c->place_of = malloc((n + 1) * sizeof *c->place_of);
    c->block_of = malloc((3 * n + 1) * sizeof *c->block_of);
    c->seen = calloc(n + 1, 1);
    c->active = malloc((size_t)l.nblock + 1);
    if (!c->memory || !c->place || !c->place_of || !c->block_of || !c->seen || !c->active) {
        cn_columns_free(c);
        return CN_ERR_MEMORY;
    }
    c->x = (double *)(((uintptr_t)c->memory + 63) / 64 * 64);
    for (int q = 0; q < l.n; q++)
        c->place_of[l.node[q]] = q;
    for (int b = 0; b < l.nblock; b++)
        for (int j = first_of(&l, b); j < first_of(&l, b + 1); j++)
            c->block_of[j] = b;
    c->solve = solve_plain;
#ifdef __x86_64__
    __builtin_cpu_init();
    if (most >= 1 && __builtin_cpu_supports("avx2")) c->solve = solve_avx2;
    if (most >= 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        c->solve = solve_avx512;
#else
    (void)most;
#endif
    *out = c;
    return CN_OK;
}

void cn_columns_free(cn_columns *c)
{
    if (!c) return;
    free(c->memory);
    free(c->place);
    free(c->place_of);
    free(c->block_of);
    free(c->seen);
    free(c->active);
    free(c);
}

void cn_columns_solve(cn_columns *c, const cn_sparse *sparse, const unsigned char *held, int count,
                      const int *node, double drop)
{
    const cn_factor_view l = cn_sparse_view(sparse);
    for (int k = 0; k < c->nplace; k++) { /* of the last call */
        memset(c->x + 3 * CN_COLUMNS * (size_t)c->place[k], 0, 3 * CN_COLUMNS * sizeof *c->x);
        c->seen[c->place[k]] = 0;
    }
    c->nplace = 0;
    memset(c->active, 0, (size_t)l.nblock);
    for (int k = 0; k < 3 * count; k++) {
        const int row = 3 * c->place_of[node[k / 3]] + k % 3;
        if (held[node[k / 3]]) continue;
        c->x[(size_t)row * CN_COLUMNS + (size_t)k] = 1;
        c->active[c->block_of[row]] = 1;
    }
    c->solve(&l, c->block_of, drop, c->active, c->x);
    for (int b = 0; b < l.nblock; b++)
        for (int j = first_of(&l, b); c->active[b] && j < first_of(&l, b + 1); j++)
            if (!c->seen[j / 3]) c->seen[j / 3] = 1, c->place[c->nplace++] = j / 3;
}
