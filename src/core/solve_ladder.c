/* solve_ladder.c - Cholesky of a block-tridiagonal matrix with blocks of 6x6: a rod, whose stations have a
 * position and a rotation and couple to their neighbours only.
 *
 * With A_l the diagonal block of rung l, S_l = L D L' what is left of it and B_l its coupling to the next,
 *   W_l = D^-1 L^-1 B_l,   S_(l+1) = A_(l+1) - W_l' D W_l,
 * from both ends to the rung in the middle (Meurant, SIAM J. Matrix Anal. Appl. 13, 1992): on one thread, as
 * two chains of dependent operations that fill each other's waits. The unit triangles L are kept inverted, so
 * that a solve is made of products alone. */
#include "solve_parts.h"

#include <float.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

/* One rung of the factor; rows of six padded with zeros. */
typedef struct {
    double e[6][8]; /* L^-1 */
    double w[6][8]; /* D^-1 L^-1 B */
    double q[8];    /* D^-1 */
    double y[8];    /* D^-1 L^-1 b of the solve under way */
} rung;

enum { BLOCKS = 7 }; /* of a rung: its own 00 01 11, to the next 00 01 10 11 */
static const int half[BLOCKS][2] = {{0, 0}, {0, 1}, {1, 1}, {0, 0}, {0, 1}, {1, 0}, {1, 1}};

typedef struct {
    bool (*factor)(cn_ladder *);
    void (*solve)(cn_ladder *, const double *, double *);
} kernels;

struct cn_ladder {
    int n;                   /* rungs */
    int (*row)[2];           /* block rows of each, ascending (n) */
    int (*block[2])[BLOCKS]; /* of the matrix, going up and down; -1: not there (n) */
    bool *loose;             /* nothing of it is held (n) */
    rung *rung;              /* (n) */
    void *work;              /* holds them, unaligned */
    kernels kernels;
    /* the last factor */
    const cn_matrix *matrix;
    const unsigned char *held;
    int low, high, middle; /* first and last rung that is not held altogether, and where the ends meet */
};

/* What stands in for blocks of held rows. */
static const double nothing[12], identity[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};

/* Blocks of rung l going up (d 0) or down; the middle one couples to none. */
static inline __attribute__((always_inline)) void blocks_of(const cn_ladder *ladder, int l, int d,
                                                            const double **block)
{
    const int *at = ladder->block[d][l], *row = ladder->row[l];
    const double *value = ladder->matrix->value;
    const bool last = l == ladder->middle;
    const int beside = last ? l : d ? l - 1 : l + 1;

    for (int k = 0; k < BLOCKS; k++)
        block[k] = at[k] < 0 ? nothing + 3 : value + 9 * (size_t)at[k];
    if (ladder->loose[l] && ladder->loose[beside] && !last) return;
    for (int k = 0; k < BLOCKS; k++)
        if (k >= 3 && last)
            block[k] = nothing + 3;
        else if (ladder->held[row[half[k][0]]] || ladder->held[ladder->row[k < 3 ? l : beside][half[k][1]]])
            block[k] = k == 0 || k == 2 ? identity + 3 : nothing + 3;
}

static inline __attribute__((always_inline)) void right_of(const cn_ladder *ladder, int l, const double *b,
                                                           const double **at)
{
    for (int k = 0; k < 2; k++) {
        const int i = ladder->row[l][k];
        at[k] = !ladder->loose[l] && ladder->held[i] ? nothing + 3 : b + 3 * (size_t)i;
    }
}

static inline __attribute__((always_inline)) void solution_of(const cn_ladder *ladder, int l, double *x,
                                                              double **at)
{
    for (int k = 0; k < 2; k++) {
        const int i = ladder->row[l][k];
        at[k] = !ladder->loose[l] && ladder->held[i] ? NULL : x + 3 * (size_t)i;
    }
}

/* Fused multiply-add where the target has it. */
#ifdef __clang__
#pragma STDC FP_CONTRACT ON
#else
#pragma GCC optimize("fp-contract=fast")
#endif

#define TARGET
#define VECTOR       vector2
#define LANES        2
#define KERNEL(name) name##_plain
#include "solve_ladder_kernel.h"
#ifdef __x86_64__
#define TARGET       __attribute__((target("avx2,fma")))
#define VECTOR       vector4
#define LANES        4
#define KERNEL(name) name##_avx2
#include "solve_ladder_kernel.h"
#define TARGET       __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))
#define VECTOR       vector8
#define LANES        8
#define KERNEL(name) name##_avx512
#include "solve_ladder_kernel.h"
#endif

static kernels kernels_pick(int width)
{
#ifdef __x86_64__
    if (width == 0) width = 8;
    if (width >= 8 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return (kernels){factor_avx512, solve_avx512};
    if (width >= 4 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return (kernels){factor_avx2, solve_avx2};
#else
    (void)width;
#endif
    return (kernels){factor_plain, solve_plain};
}

/* Whether every level has two block rows; they are listed then. */
static bool list_rows(cn_ladder *ladder, const cn_matrix *pattern, const int *level)
{
    for (int l = 0; l < ladder->n; l++)
        ladder->row[l][0] = ladder->row[l][1] = -1;
    for (int i = 0; i < pattern->n; i++) {
        if (level[i] >= ladder->n) return false;
        int *row = ladder->row[level[i]];
        if (row[1] >= 0) return false;
        row[row[0] >= 0] = i;
    }
    return true; /* 2 n rows in n levels of two at most */
}

cn_status cn_ladder_new(cn_ladder **out, const cn_matrix *pattern, const int *level, int width)
{
    const size_t n = (size_t)pattern->n / 2;

    *out = NULL;
    if (pattern->n % 2 || n == 0) return CN_OK;
    cn_ladder *ladder = calloc(1, sizeof *ladder);
    if (!ladder) return CN_ERR_MEMORY;
    ladder->n = (int)n;
    ladder->kernels = kernels_pick(width);
    ladder->row = malloc(n * sizeof *ladder->row);
    ladder->block[0] = malloc(n * sizeof *ladder->block[0]);
    ladder->block[1] = malloc(n * sizeof *ladder->block[1]);
    ladder->loose = malloc(n * sizeof *ladder->loose);
    ladder->work = calloc(n + 1, sizeof *ladder->rung);
    if (!ladder->row || !ladder->block[0] || !ladder->block[1] || !ladder->loose || !ladder->work) {
        cn_ladder_free(ladder);
        return CN_ERR_MEMORY;
    }
    if (!list_rows(ladder, pattern, level)) {
        cn_ladder_free(ladder);
        return CN_OK;
    }
    ladder->rung = (rung *)(((uintptr_t)ladder->work + 63) / 64 * 64);
    for (int d = 0; d < 2; d++)
        for (int l = 0; l < ladder->n; l++)
            for (int k = 0; k < BLOCKS; k++) {
                const int other = k < 3 ? l : d ? l - 1 : l + 1;
                ladder->block[d][l][k] =
                    other < 0 || other >= ladder->n
                        ? -1
                        : cn_matrix_find(pattern, ladder->row[l][half[k][0]], ladder->row[other][half[k][1]]);
            }
    *out = ladder;
    return CN_OK;
}

void cn_ladder_free(cn_ladder *ladder)
{
    if (!ladder) return;
    free(ladder->row);
    free(ladder->block[0]);
    free(ladder->block[1]);
    free(ladder->loose);
    free(ladder->work);
    free(ladder);
}

cn_status cn_ladder_factor(cn_ladder *ladder, const cn_matrix *a, const unsigned char *held)
{
    const int(*row)[2] = (const int(*)[2])ladder->row;
    int low = 0, high = ladder->n - 1;

    ladder->matrix = a;
    ladder->held = held;
    while (low <= high && held[row[low][0]] && held[row[low][1]])
        low++;
    while (high > low && held[row[high][0]] && held[row[high][1]])
        high--;
    ladder->low = low, ladder->high = high;
    ladder->middle = low + (high - low + 1) / 2;
    for (int l = low > 0 ? low - 1 : 0; l <= high + 1 && l < ladder->n; l++)
        ladder->loose[l] = !held[row[l][0]] && !held[row[l][1]];
    if (low > high) return CN_OK; /* all held */
    return ladder->kernels.factor(ladder) ? CN_OK : CN_ERR_SINGULAR;
}

void cn_ladder_solve(cn_ladder *ladder, const double *b, double *x)
{
    if (ladder->low <= ladder->high) ladder->kernels.solve(ladder, b, x);
}
