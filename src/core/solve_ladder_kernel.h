/* solve_ladder_kernel.h - elimination and solves by 6x6 blocks, included once for each vector width (no
 * guard): KERNEL(name) names them, TARGET sets the instruction set. A row of six lies in PARTS vectors, in
 * memory in eight doubles, the last two zeros. */

typedef double VECTOR __attribute__((vector_size(8 * LANES), may_alias));
typedef long long KERNEL(mask) __attribute__((vector_size(8 * LANES), may_alias));
#define PARTS ((6 + LANES - 1) / LANES)
#define ROW   KERNEL(row)
#define INNER TARGET static inline __attribute__((always_inline))
#define EACH  _Pragma("GCC unroll 8") for

typedef struct {
    VECTOR v[PARTS];
} ROW;

/* Three doubles from each of two places. */
INNER ROW KERNEL(join)(const double *low, const double *high)
{
    ROW r;
#if LANES == 8
    r.v[0] = (VECTOR)_mm512_mask_loadu_pd(_mm512_maskz_loadu_pd(0x07, low), 0x38, high - 3);
#else
    const double both[8] = {low[0], low[1], low[2], high[0], high[1], high[2]};
    memcpy(&r, both, sizeof r);
#endif
    return r;
}

/* And back to them; NULL: that half is left out. */
INNER void KERNEL(part)(ROW r, double *low, double *high)
{
#if LANES == 8
    if (low) _mm512_mask_storeu_pd(low, 0x07, (__m512d)r.v[0]);
    if (high) _mm512_mask_storeu_pd(high - 3, 0x38, (__m512d)r.v[0]);
#else
    double both[LANES * PARTS];
    memcpy(both, &r, sizeof both);
    if (low) memcpy(low, both, 3 * sizeof *low);
    if (high) memcpy(high, both + 3, 3 * sizeof *high);
#endif
}

INNER ROW KERNEL(load)(const double *from)
{
    ROW r;
    EACH(int p = 0; p < PARTS; p++) r.v[p] = *(const VECTOR *)(from + LANES * p);
    return r;
}

INNER void KERNEL(store)(double *to, ROW r)
{
    EACH(int p = 0; p < PARTS; p++) * (VECTOR *)(to + LANES * p) = r.v[p];
}

/* Entry i of r in every lane. */
INNER VECTOR KERNEL(spread)(ROW r, int i)
{
    return __builtin_shuffle(r.v[i / LANES], (KERNEL(mask)){0} + i % LANES);
}

INNER ROW KERNEL(times)(ROW a, ROW b)
{
    EACH(int p = 0; p < PARTS; p++) a.v[p] *= b.v[p];
    return a;
}

INNER ROW KERNEL(sum)(ROW a, ROW b)
{
    EACH(int p = 0; p < PARTS; p++) a.v[p] += b.v[p];
    return a;
}

/* r - f a */
INNER ROW KERNEL(less)(ROW r, VECTOR f, ROW a)
{
    EACH(int p = 0; p < PARTS; p++) r.v[p] -= f * a.v[p];
    return r;
}

/* M' x */
INNER ROW KERNEL(across)(double (*m)[8], ROW x)
{
    ROW even, odd;
    EACH(int p = 0; p < PARTS; p++)
    {
        even.v[p] = KERNEL(spread)(x, 0) * KERNEL(load)(m[0]).v[p];
        odd.v[p] = KERNEL(spread)(x, 1) * KERNEL(load)(m[1]).v[p];
        EACH(int i = 2; i < 6; i += 2)
        {
            even.v[p] += KERNEL(spread)(x, i) * KERNEL(load)(m[i]).v[p];
            odd.v[p] += KERNEL(spread)(x, i + 1) * KERNEL(load)(m[i + 1]).v[p];
        }
    }
    return KERNEL(sum)(even, odd);
}

/* M x */
INNER ROW KERNEL(along)(double (*m)[8], ROW x)
{
    ROW t[6], r;
    EACH(int i = 0; i < 6; i++) t[i] = KERNEL(times)(KERNEL(load)(m[i]), x);
#if LANES == 8
    /* neighbours first: pair[k] holds of rows 2k and 2k + 1 the sums of columns 01, 23 and 45 */
    VECTOR pair[3];
    EACH(int k = 0; k < 3; k++)
    {
        const VECTOR a = t[2 * k].v[0], b = t[2 * k + 1].v[0];
        pair[k] = __builtin_shuffle(a, b, (KERNEL(mask)){0, 8, 2, 10, 4, 12, 6, 14}) +
                  __builtin_shuffle(a, b, (KERNEL(mask)){1, 9, 3, 11, 5, 13, 7, 15});
    }
    const VECTOR four = __builtin_shuffle(pair[0], pair[1], (KERNEL(mask)){0, 1, 8, 9, 2, 3, 10, 11}) +
                        __builtin_shuffle(pair[0], pair[1], (KERNEL(mask)){4, 5, 12, 13, 6, 7, 14, 15});
    const VECTOR two = pair[2] + __builtin_shuffle(pair[2], (KERNEL(mask)){4, 5, 6, 7, 4, 5, 6, 7});
    r.v[0] = __builtin_shuffle(four, two, (KERNEL(mask)){0, 1, 2, 3, 8, 9, 6, 7}) +
             __builtin_shuffle(four, two, (KERNEL(mask)){4, 5, 6, 7, 10, 11, 6, 7});
#else
    EACH(int p = 0; p < PARTS; p++)
    EACH(int c = 0; c < LANES; c++)
    {
        r.v[p][c] = 0;
        if (LANES * p + c < 6) {
            VECTOR s = t[LANES * p + c].v[0];
            EACH(int k = 1; k < PARTS; k++) s += t[LANES * p + c].v[k];
            r.v[p][c] = LANES == 4 ? (s[0] + s[1]) + (s[LANES - 2] + s[LANES - 1]) : s[0] + s[1];
        }
    }
#endif
    return r;
}

/* A rung from its blocks (three of its own, four to the next rung) less what earlier ones took, s, which
 * then is what it takes from the next. Lanes of `bad` are set where a pivot is refused. */
INNER void KERNEL(eliminate)(rung *to, const double *const *own, ROW *s, KERNEL(mask) * bad)
{
    const double *const *next = own + 3;
    double least[8] __attribute__((aligned(64))) = {0};
    ROW r[6], b[6], e[6], pivot = {{{0}}};
    KERNEL(mask) lane = {0};

    for (int c = 0; c < LANES; c++)
        lane[c] = c;
    EACH(int i = 0; i < 6; i++)
    {
        const int k = 3 * (i % 3);
        r[i] = KERNEL(join)(own[i < 3 ? 0 : 1] + k, own[i < 3 ? 1 : 2] + k); /* no use below the diagonal */
        r[i] = KERNEL(sum)(r[i], s[i]);
        b[i] = KERNEL(join)(next[i < 3 ? 0 : 2] + k, next[i < 3 ? 1 : 3] + k);
        least[i] = CN_PIVOT_MIN * own[i < 3 ? 0 : 2][4 * (i % 3)];
        EACH(int p = 0; p < PARTS; p++)
        {
            e[i].v[p] = (VECTOR)((KERNEL(mask))((VECTOR){0} + 1) & (lane + LANES * p == i));
            s[i].v[p] = (VECTOR){0};
        }
    }
    EACH(int i = 0; i < 6; i++)
    {
        const VECTOR d = KERNEL(spread)(r[i], i), q = 1 / d;
        const KERNEL(mask) here = lane == i % LANES;
        pivot.v[i / LANES] = (VECTOR)(((KERNEL(mask))d & here) | (KERNEL(mask))pivot.v[i / LANES]);
        EACH(int j = i + 1; j < 6; j++)
        {
            const VECTOR f = q * KERNEL(spread)(r[i], j);
            r[j] = KERNEL(less)(r[j], f, r[i]);
            b[j] = KERNEL(less)(b[j], f, b[i]);
            e[j] = KERNEL(less)(e[j], f, e[i]);
        }
        ROW w;
        EACH(int p = 0; p < PARTS; p++) w.v[p] = q * b[i].v[p];
        KERNEL(store)(to->w[i], w);
        KERNEL(store)(to->e[i], e[i]);
        to->q[i] = q[0];
        EACH(int j = 0; j < 6; j++) s[j] = KERNEL(less)(s[j], KERNEL(spread)(w, j), b[i]);
    }
    EACH(int p = 0; p < PARTS; p++)
    *bad |= (LANES * p + lane < 6) &
            ~((pivot.v[p] > *(VECTOR *)(least + LANES * p)) & (pivot.v[p] > 0) & (pivot.v[p] <= DBL_MAX));
}

/* y = D^-1 L^-1 (b - s); s becomes what is to be taken from the next rung's b. */
INNER void KERNEL(descend)(rung *at, const double *const *b, ROW *s)
{
    ROW t = KERNEL(join)(b[0], b[1]);
    EACH(int p = 0; p < PARTS; p++) t.v[p] -= s->v[p];
    t = KERNEL(along)(at->e, t);
    KERNEL(store)(at->y, KERNEL(times)(t, KERNEL(load)(at->q)));
    *s = KERNEL(across)(at->w, t);
}

/* x = L^-T (y - W x): x of the next rung becomes its own. */
INNER void KERNEL(ascend)(rung *at, ROW *x, double *const *to)
{
    ROW t = KERNEL(load)(at->y), wx = KERNEL(along)(at->w, *x);
    EACH(int p = 0; p < PARTS; p++) t.v[p] -= wx.v[p];
    *x = KERNEL(across)(at->e, t);
    KERNEL(part)(*x, to[0], to[1]);
}

TARGET static bool KERNEL(factor)(cn_ladder *ladder)
{
    const double *block[BLOCKS];
    ROW up[6] = {{{{0}}}}, down[6] = {{{{0}}}};
    KERNEL(mask) bad = {0};
    rung *const at = ladder->rung;
    int l = ladder->low, h = ladder->high;

    for (; l < ladder->middle; l++, h--) {
        blocks_of(ladder, l, 0, block);
        KERNEL(eliminate)(&at[l], block, up, &bad);
        if (h == ladder->middle) break;
        blocks_of(ladder, h, 1, block);
        KERNEL(eliminate)(&at[h], block, down, &bad);
    }
    for (int i = 0; i < 6; i++)
        up[i] = KERNEL(sum)(up[i], down[i]);
    blocks_of(ladder, ladder->middle, 0, block);
    KERNEL(eliminate)(&at[ladder->middle], block, up, &bad);
    for (int c = 0; c < LANES; c++)
        if (bad[c]) return false;
    return true;
}

TARGET static void KERNEL(solve)(cn_ladder *ladder, const double *b, double *x)
{
    const double *right[2];
    double *to[2];
    ROW up = {{{0}}}, down = {{{0}}};
    rung *const at = ladder->rung;
    const int middle = ladder->middle;

    for (int l = ladder->low, h = ladder->high; l < middle; l++, h--) {
        right_of(ladder, l, b, right);
        KERNEL(descend)(&at[l], right, &up);
        if (h == middle) break;
        right_of(ladder, h, b, right);
        KERNEL(descend)(&at[h], right, &down);
    }
    right_of(ladder, middle, b, right);
    up = KERNEL(sum)(up, down);
    KERNEL(descend)(&at[middle], right, &up); /* it couples to none: up is 0 */
    solution_of(ladder, middle, x, to);
    KERNEL(ascend)(&at[middle], &up, to);
    down = up;
    for (int l = middle - 1, h = middle + 1; l >= ladder->low; l--, h++) {
        solution_of(ladder, l, x, to);
        KERNEL(ascend)(&at[l], &up, to);
        if (h > ladder->high) break;
        solution_of(ladder, h, x, to);
        KERNEL(ascend)(&at[h], &down, to);
    }
}

#undef EACH
#undef INNER
#undef ROW
#undef PARTS
#undef KERNEL
#undef TARGET
#undef LANES
#undef VECTOR
