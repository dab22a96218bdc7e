/* solve_chain.c - Cholesky of a block-tridiagonal matrix: levels 0, 1, ... couple to their neighbours only.
 *
 * With A_l the diagonal block of level l and B_l its coupling to the next one, elimination from one end is
 *   U_l' U_l = A_l - W_(l-1)' W_(l-1),   W_l = U_l^-T B_l.
 * It runs from the first level up and from the last level down to a meeting level chosen from the pattern and
 * the held nodes alone ("twisted" factorisation: Meurant, SIAM J. Matrix Anal. Appl. 13, 1992); the two sides
 * are two tasks of the pool, with the same arithmetic on one thread. */
#include "solve_parts.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef double v2 __attribute__((vector_size(16), may_alias));

/* One level's rows of the factor: see solve_chain_kernel.h. */
typedef struct {
    int m;           /* unknowns */
    int p;           /* unknowns padded to a multiple of 8 */
    int s;           /* stride */
    double *a;       /* (m x s) */
    double *inverse; /* of the diagonal (m) */
} panel;

/* Fused multiply-add where the target has it. */
#ifdef __clang__
#pragma STDC FP_CONTRACT ON
#else
#pragma GCC optimize("fp-contract=fast")
#endif

/* Keeps a vector in its register: else it is loaded anew for each of its three products. */
#ifdef __x86_64__
#define KEEP(vector) __asm__("" : "+v"(vector))
#else
#define KEEP(vector) (void)(vector)
#endif

#define TARGET
#define VECTOR       vector2
#define LANES        2
#define TILE         4
#define KERNEL(name) name##_plain
#include "solve_chain_kernel.h"
#ifdef __x86_64__
#define TARGET       __attribute__((target("avx2,fma")))
#define VECTOR       vector4
#define LANES        4
#define TILE         4
#define KERNEL(name) name##_avx2
#include "solve_chain_kernel.h"
#define TARGET       __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define VECTOR       vector8
#define LANES        8
#define TILE         8
#define KERNEL(name) name##_avx512
#include "solve_chain_kernel.h"
#endif

typedef struct {
    int width; /* doubles in a vector */
    bool (*factor)(panel *to, int width, int nbefore, panel *const *before);
    void (*forward)(const panel *from, int width, double *t, double *y);
    void (*backward)(const panel *from, int width, const double *y, double *x);
} kernels;

static kernels kernels_pick(int width)
{
#ifdef __x86_64__
    if (width == 0) width = 8;
    if (width >= 8 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return (kernels){8, factor_avx512, forward_avx512, backward_avx512};
    if (width >= 4 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return (kernels){4, factor_avx2, forward_avx2, backward_avx2};
#else
    (void)width;
#endif
    return (kernels){2, factor_plain, forward_plain, backward_plain};
}

/* Where blocks of A go in the panels when elimination runs one way: level l's own blocks are
 * [start[2l], start[2l+1]), those to the next level [start[2l+1], start[2l+2]). */
typedef struct {
    int *start;  /* (2 nlevel + 1) */
    int *source; /* block of A */
    int *target; /* offset in the panel */
    int *stride; /* of the panel (nlevel) */
} layout;

/* Elimination from one end: levels first, first + step, ... up to and without the meeting level. */
typedef struct {
    int first, step, count;
    double *t; /* right-hand side, then solution: level after level in order of elimination, padded, with the
                  meeting level last */
    double *y; /* after the forward solve */
    bool positive;
} side;

struct cn_chain {
    int n, nlevel;
    int *node;     /* nodes level by level, ascending within one (n) */
    int *first;    /* first of a level in node                       (nlevel + 1) */
    panel *panel;  /* (nlevel) */
    layout way[2]; /* up, down */
    double *work;  /* factor and vectors, one allocation */
    double *t[2], *y[2];
    kernels kernels;
    /* the last factor */
    const cn_matrix *matrix;
    const unsigned char *held;
    int meeting;
    side side[2];
    const double *b;
    double *x;
};

static int padded(int m)
{
    return (m + 7) & ~7;
}

static cn_status sort_nodes(cn_chain *chain, const int *level)
{
    const int n = chain->n;

    for (int i = 0; i < n; i++)
        if (level[i] >= chain->nlevel) chain->nlevel = level[i] + 1;
    chain->node = malloc(((size_t)n + 1) * sizeof *chain->node);
    chain->first = calloc((size_t)chain->nlevel + 2, sizeof *chain->first);
    chain->panel = calloc((size_t)chain->nlevel + 1, sizeof *chain->panel);
    if (!chain->node || !chain->first || !chain->panel) return CN_ERR_MEMORY;
    int *next = chain->first + 1; /* while sorting, next[l] is where level l's next node goes */
    for (int i = 0; i < n; i++)
        if (level[i] + 1 < chain->nlevel) next[level[i] + 1]++;
    for (int l = 1; l < chain->nlevel; l++)
        next[l] += next[l - 1];
    for (int i = 0; i < n; i++)
        chain->node[next[level[i]]++] = i;
    return CN_OK;
}

/* Panels and vectors in one block of memory, rows aligned to 64 bytes. */
static cn_status place_panels(cn_chain *chain)
{
    size_t size = 8, vector = 0;

    for (int l = 0; l < chain->nlevel; l++) {
        panel *to = &chain->panel[l];
        const int64_t m = 3 * ((int64_t)chain->first[l + 1] - chain->first[l]);
        if (m > 46000) return CN_ERR_MEMORY; /* offsets within a panel are int */
        to->m = (int)m, to->p = padded(to->m);
        vector += (size_t)to->p;
    }
    for (int l = 0; l < chain->nlevel; l++) {
        panel *to = &chain->panel[l];
        const int up = l + 1 < chain->nlevel ? to[1].p : 0, down = l > 0 ? to[-1].p : 0;
        chain->way[0].stride[l] = to->p + up;
        chain->way[1].stride[l] = to->p + down;
        const int64_t widest = to->p + (up > down ? up : down);
        if (to->m * widest > INT_MAX) return CN_ERR_MEMORY;
        size += (size_t)(to->m * widest) + (size_t)to->p;
    }
    chain->work = calloc(size + 4 * vector, sizeof *chain->work);
    if (!chain->work) return CN_ERR_MEMORY;
    double *at = chain->work;
    while ((uintptr_t)at % 64)
        at++;
    for (int d = 0; d < 2; d++) {
        chain->t[d] = at, at += vector;
        chain->y[d] = at, at += vector;
    }
    for (int l = 0; l < chain->nlevel; l++) {
        panel *to = &chain->panel[l];
        const int up = chain->way[0].stride[l], down = chain->way[1].stride[l];
        to->a = at, at += (size_t)to->m * (size_t)(up > down ? up : down);
        to->inverse = at, at += to->p;
    }
    return CN_OK;
}

/* Lists the upper blocks of level l's rows and, for both ways, where they go. `place` is a node's place in
 * its level. Called first to count (source NULL), then to fill. */
static void list_blocks(cn_chain *chain, const cn_matrix *a, const int *level, const int *place, int d,
                        bool fill)
{
    layout *way = &chain->way[d];
    int count = 0;

    for (int l = 0; l < chain->nlevel; l++)
        for (int part = 0; part < 2; part++) {
            way->start[2 * l + part] = count;
            for (int r = chain->first[l]; r < chain->first[l + 1]; r++) {
                const int i = chain->node[r];
                for (int k = a->row[i]; k < a->row[i + 1]; k++) {
                    const int j = a->col[k];
                    if (part == 0 ? level[j] != l || place[j] < place[i] : level[j] != (d ? l - 1 : l + 1))
                        continue;
                    if (fill) {
                        way->source[count] = k;
                        way->target[count] =
                            3 * place[i] * way->stride[l] + part * chain->panel[l].p + 3 * place[j];
                    }
                    count++;
                }
            }
        }
    way->start[2 * chain->nlevel] = count;
}

cn_status cn_chain_new(cn_chain **out, const cn_matrix *pattern, const int *level, int width)
{
    cn_status status = CN_ERR_MEMORY;
    int *place = malloc(((size_t)pattern->n + 1) * sizeof *place);
    cn_chain *chain = calloc(1, sizeof *chain);

    *out = NULL;
    if (!place || !chain) goto done;
    chain->n = pattern->n;
    chain->kernels = kernels_pick(width);
    if ((status = sort_nodes(chain, level)) != CN_OK) goto done;
    for (int l = 0; l < chain->nlevel; l++)
        for (int r = chain->first[l]; r < chain->first[l + 1]; r++)
            place[chain->node[r]] = r - chain->first[l];
    status = CN_ERR_MEMORY;
    for (int d = 0; d < 2; d++) {
        chain->way[d].start = calloc(2 * (size_t)chain->nlevel + 1, sizeof(int));
        chain->way[d].stride = calloc((size_t)chain->nlevel + 1, sizeof(int));
        if (!chain->way[d].start || !chain->way[d].stride) goto done;
    }
    if ((status = place_panels(chain)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    for (int d = 0; d < 2; d++) {
        list_blocks(chain, pattern, level, place, d, false);
        const size_t count = (size_t)chain->way[d].start[2 * chain->nlevel] + 1;
        chain->way[d].source = malloc(count * sizeof(int));
        chain->way[d].target = malloc(count * sizeof(int));
        if (!chain->way[d].source || !chain->way[d].target) goto done;
        list_blocks(chain, pattern, level, place, d, true);
    }
    status = CN_OK;
done:
    free(place);
    if (status == CN_OK)
        *out = chain;
    else
        cn_chain_free(chain);
    return status;
}

void cn_chain_free(cn_chain *chain)
{
    if (!chain) return;
    for (int d = 0; d < 2; d++) {
        free(chain->way[d].start);
        free(chain->way[d].source);
        free(chain->way[d].target);
        free(chain->way[d].stride);
    }
    free(chain->node);
    free(chain->first);
    free(chain->panel);
    free(chain->work);
    free(chain);
}

static bool any_held(const cn_chain *chain, int l)
{
    if (l < 0 || l >= chain->nlevel) return false;
    for (int r = chain->first[l]; r < chain->first[l + 1]; r++)
        if (chain->held[chain->node[r]]) return true;
    return false;
}

/* Copies A's blocks [begin, end) of the layout to level l's panel; blocks of held nodes are left out. */
static void copy_blocks(const cn_chain *chain, const layout *way, int l, int begin, int end, bool held)
{
    const cn_matrix *a = chain->matrix;
    const panel *to = &chain->panel[l];

    for (int e = begin; e < end; e++) {
        const int k = way->source[e], at = way->target[e];
        if (held && (chain->held[chain->node[chain->first[l] + at / to->s / 3]] || chain->held[a->col[k]]))
            continue;
        const double *v = a->value + 9 * (size_t)k;
        double *r = to->a + at;
        memcpy(r, v, 3 * sizeof *r);
        memcpy(r + to->s, v + 3, 3 * sizeof *r);
        memcpy(r + 2 * to->s, v + 6, 3 * sizeof *r);
    }
}

/* Fills level l's panel from A; `coupled`: with the coupling to the next level. */
static void fill_panel(const cn_chain *chain, int d, int l, bool coupled)
{
    const layout *way = &chain->way[d];
    panel *to = &chain->panel[l];
    const bool own = any_held(chain, l), held = own || (coupled && any_held(chain, d ? l - 1 : l + 1));

    to->s = way->stride[l];
    memset(to->a, 0, (size_t)to->m * (size_t)to->s * sizeof *to->a);
    copy_blocks(chain, way, l, way->start[2 * l], way->start[2 * l + (coupled ? 2 : 1)], held);
    if (!own) return;
    for (int r = chain->first[l]; r < chain->first[l + 1]; r++)
        for (int c = 0; c < 3 && chain->held[chain->node[r]]; c++)
            to->a[(size_t)(3 * (r - chain->first[l]) + c) * (size_t)(to->s + 1)] = 1;
}

static void factor_side(void *user, int d)
{
    cn_chain *chain = user;
    side *go = &chain->side[d];
    panel *before[1] = {NULL};

    go->positive = true;
    for (int e = 0, l = go->first; e < go->count && go->positive; e++, l += go->step) {
        panel *to = &chain->panel[l];
        fill_panel(chain, d, l, true);
        go->positive = chain->kernels.factor(to, to->s, e > 0, before);
        before[0] = to;
    }
}

/* The levels with a node that is not held, and the level where half of their work is done. */
static void plan_sides(cn_chain *chain)
{
    int low = 0, high = chain->nlevel - 1;
    double total = 0, up = 0;

    for (bool all = true; all && low <= high; low += all)
        for (int r = chain->first[low]; r < chain->first[low + 1] && all; r++)
            all = chain->held[chain->node[r]];
    for (bool all = true; all && high > low; high -= all)
        for (int r = chain->first[high]; r < chain->first[high + 1] && all; r++)
            all = chain->held[chain->node[r]];
    for (int l = low; l < high; l++)
        total += cn_level_flops(chain->panel[l].m, chain->panel[l + 1].m);
    int meeting = low;
    while (meeting < high && 2 * up < total) {
        up += cn_level_flops(chain->panel[meeting].m, chain->panel[meeting + 1].m);
        meeting++;
    }
    chain->meeting = meeting;
    chain->side[0] = (side){low, 1, meeting - low, chain->t[0], chain->y[0], true};
    chain->side[1] = (side){high, -1, high > meeting ? high - meeting : 0, chain->t[1], chain->y[1], true};
}

cn_status cn_chain_factor(cn_chain *chain, const cn_matrix *a, const unsigned char *held, cn_pool *pool)
{
    panel *before[2];
    int nbefore = 0;

    chain->matrix = a;
    chain->held = held;
    plan_sides(chain);
    if (chain->meeting >= chain->nlevel) return CN_OK; /* all held */
    cn_pool_run(pool, 2, factor_side, chain);
    for (int d = 0; d < 2; d++) {
        if (!chain->side[d].positive) return CN_ERR_SINGULAR;
        if (chain->side[d].count > 0) before[nbefore++] = &chain->panel[chain->meeting + (d ? 1 : -1)];
    }
    panel *middle = &chain->panel[chain->meeting];
    fill_panel(chain, 0, chain->meeting, false);
    return chain->kernels.factor(middle, middle->p, nbefore, before) ? CN_OK : CN_ERR_SINGULAR;
}

static void gather(const cn_chain *chain, int l, double *t)
{
    for (int r = chain->first[l]; r < chain->first[l + 1]; r++, t += 3) {
        const int i = chain->node[r];
        const bool held = chain->held[i];
        for (int c = 0; c < 3; c++)
            t[c] = held ? 0 : chain->b[3 * (size_t)i + c];
    }
    memset(t, 0, (size_t)(chain->panel[l].p - chain->panel[l].m) * sizeof *t);
}

static void scatter(const cn_chain *chain, int l, const double *t)
{
    for (int r = chain->first[l]; r < chain->first[l + 1]; r++, t += 3)
        if (!chain->held[chain->node[r]]) memcpy(chain->x + 3 * (size_t)chain->node[r], t, 3 * sizeof *t);
}

static void forward_side(void *user, int d)
{
    cn_chain *chain = user;
    const side *go = &chain->side[d];
    double *t = go->t, *y = go->y;

    for (int e = 0, l = go->first; e < go->count; e++, l += go->step) {
        gather(chain, l, t);
        t += chain->panel[l].p;
    }
    memset(t, 0, (size_t)chain->panel[chain->meeting].p * sizeof *t);
    t = go->t;
    for (int e = 0, l = go->first; e < go->count; e++, l += go->step) {
        const panel *from = &chain->panel[l];
        chain->kernels.forward(from, from->s, t, y);
        t += from->p, y += from->p;
    }
}

static void backward_side(void *user, int d)
{
    cn_chain *chain = user;
    const side *go = &chain->side[d];
    double *t = go->t, *y = go->y;

    for (int e = 0, l = go->first; e < go->count; e++, l += go->step)
        t += chain->panel[l].p, y += chain->panel[l].p;
    for (int e = go->count - 1, l = chain->meeting - go->step; e >= 0; e--, l -= go->step) {
        const panel *from = &chain->panel[l];
        t -= from->p, y -= from->p;
        memset(t, 0, (size_t)from->p * sizeof *t);
        chain->kernels.backward(from, from->s, y, t);
        scatter(chain, l, t);
    }
}

void cn_chain_solve(cn_chain *chain, const double *b, double *x, cn_pool *pool)
{
    if (chain->meeting >= chain->nlevel) return;
    const panel *middle = &chain->panel[chain->meeting];
    double *t[2], *y;

    chain->b = b, chain->x = x;
    cn_pool_run(pool, 2, forward_side, chain);
    for (int d = 0; d < 2; d++) { /* the meeting level stands after the last one of each side */
        t[d] = chain->side[d].t;
        for (int e = 0, l = chain->side[d].first; e < chain->side[d].count; e++, l += chain->side[d].step)
            t[d] += chain->panel[l].p;
    }
    y = chain->side[0].y + (t[0] - chain->side[0].t);
    gather(chain, chain->meeting, y); /* y serves as scratch until the forward solve overwrites it */
    for (int c = 0; c < middle->p; c++)
        t[0][c] = y[c] + t[0][c] + t[1][c];
    chain->kernels.forward(middle, middle->p, t[0], y);
    memset(t[0], 0, (size_t)middle->p * sizeof *t[0]);
    chain->kernels.backward(middle, middle->p, y, t[0]);
    memcpy(t[1], t[0], (size_t)middle->p * sizeof *t[0]);
    scatter(chain, chain->meeting, t[0]);
    cn_pool_run(pool, 2, backward_side, chain);
}
