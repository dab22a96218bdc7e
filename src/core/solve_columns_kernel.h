/* solve_columns_kernel.h - solves with L and L' for CN_COLUMNS right-hand sides, LANES of them in a vector,
 * included once for each width (no guard): KERNEL(name) names them, TARGET sets the instruction set. A
 * column's sums are the same in all of them. */

typedef double VECTOR __attribute__((vector_size(8 * LANES)));
typedef long long KERNEL(mask) __attribute__((vector_size(8 * LANES)));

/* Row i of the columns that x points to. Sums are made four at a time: each x is read once for them. */
#define STRIDE (CN_COLUMNS / LANES)
#define X(i)   x[(size_t)(i)*STRIDE]

/* y of a block, and what it gives to the rows further on; adds y^2 to `square`. */
TARGET INLINE void KERNEL(go_up)(const block *b, VECTOR *x, VECTOR *square)
{
    const size_t n = (size_t)b->nrow;
    VECTOR sum = *square;
    int i = b->ncol;
    for (int j = 0; j < b->ncol; j++) {
        const double *at = b->value + (size_t)j * n;
        const VECTOR xj = X(b->first + j) / at[j];
        X(b->first + j) = xj;
        sum += xj * xj;
        for (int k = j + 1; k < b->ncol; k++)
            X(b->first + k) -= at[k] * xj;
    }
    *square = sum;
    for (; i + 3 < b->nrow; i += 4) {
        const int *r = b->row + i;
        VECTOR s0 = X(r[0]), s1 = X(r[1]), s2 = X(r[2]), s3 = X(r[3]);
        for (int j = 0; j < b->ncol; j++) {
            const double *at = b->value + (size_t)j * n + i;
            const VECTOR xj = X(b->first + j);
            s0 -= at[0] * xj, s1 -= at[1] * xj, s2 -= at[2] * xj, s3 -= at[3] * xj;
        }
        X(r[0]) = s0, X(r[1]) = s1, X(r[2]) = s2, X(r[3]) = s3;
    }
    for (; i < b->nrow; i++)
        for (int j = 0; j < b->ncol; j++)
            X(b->row[i]) -= b->value[(size_t)j * n + (size_t)i] * X(b->first + j);
}

TARGET INLINE void KERNEL(go_down)(const block *b, VECTOR *x)
{
    const size_t n = (size_t)b->nrow;
    int j = 0;
    for (; j + 3 < b->ncol; j += 4) {
        const double *at = b->value + (size_t)j * n;
        VECTOR *to = &X(b->first + j), s0 = to[0], s1 = to[STRIDE], s2 = to[2 * STRIDE], s3 = to[3 * STRIDE];
        for (int i = b->ncol; i < b->nrow; i++) {
            const VECTOR xi = X(b->row[i]);
            s0 -= at[i] * xi, s1 -= at[n + i] * xi, s2 -= at[2 * n + i] * xi, s3 -= at[3 * n + i] * xi;
        }
        to[0] = s0, to[STRIDE] = s1, to[2 * STRIDE] = s2, to[3 * STRIDE] = s3;
    }
    for (; j < b->ncol; j++)
        for (int i = b->ncol; i < b->nrow; i++)
            X(b->first + j) -= b->value[(size_t)j * n + (size_t)i] * X(b->row[i]);
    for (j = b->ncol - 1; j >= 0; j--) {
        const double *at = b->value + (size_t)j * n;
        VECTOR sum = X(b->first + j);
        for (int i = j + 1; i < b->ncol; i++)
            sum -= at[i] * X(b->first + i);
        X(b->first + j) = sum / at[j];
    }
}

/* Whether any row that a block reads is above the squares in `least`. */
TARGET INLINE int KERNEL(reads_something)(const block *b, const VECTOR *x, const VECTOR *least)
{
    KERNEL(mask) above = {0};
    for (int i = b->ncol; i < b->nrow; i++)
        above |= X(b->row[i]) * X(b->row[i]) > *least;
    for (int k = 0; k < LANES; k++)
        if (above[k]) return 1;
    return 0;
}

/* active: blocks to begin with; becomes those of which x holds something. */
TARGET static void KERNEL(solve)(const cn_factor_view *l, const int *block_of, double drop,
                                 unsigned char *active, double *numbers)
{
    VECTOR *x = (VECTOR *)numbers, least[STRIDE] = {{0}};
    for (int k = 0; k < l->nblock; k++) {
        const block b = block_at(l, k);
        if (!active[k]) continue;
        for (int lane = 0; lane < STRIDE; lane++)
            KERNEL(go_up)(&b, x + lane, least + lane);
        if (b.ncol < b.nrow) active[block_of[b.row[b.ncol]]] = 1; /* the way up */
    }
    for (int lane = 0; lane < STRIDE; lane++)
        least[lane] = least[lane] * least[lane] * (drop * drop);
    for (int k = l->nblock - 1; k >= 0; k--) {
        const block b = block_at(l, k);
        for (int lane = 0; lane < STRIDE && !active[k]; lane++)
            active[k] = (unsigned char)KERNEL(reads_something)(&b, x + lane, least + lane);
        for (int lane = 0; lane < STRIDE && active[k]; lane++)
            KERNEL(go_down)(&b, x + lane);
    }
}

#undef STRIDE
#undef X
#undef TARGET
#undef VECTOR
#undef LANES
#undef KERNEL
