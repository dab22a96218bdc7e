#include "matrix.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

/* Largest node index + 1 over the bodies, -1 if a body is out of range. */
static int count_rows(int nbody, const cn_body *const *body, const int *first)
{
    int n = 0;

    for (int b = 0; b < nbody; b++) {
        const int nblock = body[b]->nblock;
        if (nblock < 0 || body[b]->nelement < 0 || body[b]->nelement > INT_MAX / body[b]->nper ||
            first[b] < 0 || first[b] > INT_MAX - nblock)
            return -1;
        if (first[b] + nblock > n) n = first[b] + nblock;
        for (int c = 0; c < body[b]->nper * body[b]->nelement; c++)
            if (body[b]->connect[c] < 0 || body[b]->connect[c] >= nblock) return -1;
    }
    return n;
}

/* Elements at each block: those of block i are packed[start[i] .. start[i+1]), as pointers to their local
 * blocks with the body's first one beside. */
typedef struct {
    const int *node;
    int nper, first;
} incidence;

static void collect_incidences(int nbody, const cn_body *const *body, const int *first, int n, int *start,
                               incidence *packed)
{
    for (int b = 0; b < nbody; b++)
        for (int c = 0; c < body[b]->nper * body[b]->nelement; c++)
            start[first[b] + body[b]->connect[c] + 1]++;
    for (int i = 0; i < n; i++)
        start[i + 1] += start[i];
    for (int b = 0; b < nbody; b++)
        for (int c = 0; c < body[b]->nper * body[b]->nelement; c++)
            packed[start[first[b] + body[b]->connect[c]]++] =
                (incidence){body[b]->connect + c / body[b]->nper * body[b]->nper, body[b]->nper, first[b]};
    for (int i = n; i > 0; i--)
        start[i] = start[i - 1];
    start[0] = 0;
}

static int compare_int(const void *a, const void *b)
{
    return *(const int *)a - *(const int *)b; /* both >= 0 */
}

/* Neighbours of node i and i itself, ascending, into col (NULL: only counted). `mark` holds i where seen. */
static int collect_row(int i, const int *start, const incidence *packed, int *mark, int *col)
{
    int count = 0;

    mark[i] = i;
    if (col) col[count] = i;
    count++;
    for (int e = start[i]; e < start[i + 1]; e++)
        for (int c = 0; c < packed[e].nper; c++) {
            const int j = packed[e].first + packed[e].node[c];
            if (mark[j] == i) continue;
            mark[j] = i;
            if (col) col[count] = j;
            count++;
        }
    if (col) qsort(col, (size_t)count, sizeof *col, compare_int);
    return count;
}

cn_status cn_matrix_new(cn_matrix **out, int nbody, const cn_body *const *body, const int *first)
{
    *out = NULL;
    const int n = count_rows(nbody, body, first);
    if (n < 0) return CN_ERR_ARG;

    cn_status status = CN_ERR_MEMORY;
    cn_matrix *matrix = calloc(1, sizeof *matrix);
    size_t corners = 0;
    for (int b = 0; b < nbody; b++)
        corners += (size_t)body[b]->nper * (size_t)body[b]->nelement;
    int *start = calloc((size_t)n + 1, sizeof *start);
    int *mark = malloc(((size_t)n + 1) * sizeof *mark);
    incidence *packed = malloc((corners + 1) * sizeof *packed);
    if (!matrix || !start || !mark || !packed) goto done;
    if (corners > INT_MAX) {
        status = CN_ERR_ARG;
        goto done;
    }

    matrix->n = n;
    matrix->row = calloc((size_t)n + 1, sizeof *matrix->row);
    matrix->diagonal = calloc((size_t)n + 1, sizeof *matrix->diagonal);
    if (!matrix->row || !matrix->diagonal) goto done;
    collect_incidences(nbody, body, first, n, start, packed);
    for (int i = 0; i < n; i++)
        mark[i] = -1;
    long long nblock = 0;
    for (int i = 0; i < n; i++) {
        nblock += collect_row(i, start, packed, mark, NULL);
        if (nblock > INT_MAX / 9) {
            status = CN_ERR_ARG;
            goto done;
        }
        matrix->row[i + 1] = (int)nblock;
    }

    matrix->nblock = (int)nblock;
    matrix->col = malloc(((size_t)nblock + 1) * sizeof *matrix->col);
    matrix->value = calloc((size_t)nblock * 9 + 1, sizeof *matrix->value);
    if (!matrix->col || !matrix->value) goto done;
    for (int i = 0; i < n; i++)
        mark[i] = -1;
    for (int i = 0; i < n; i++)
        collect_row(i, start, packed, mark, matrix->col + matrix->row[i]);
    for (int i = 0; i < n; i++)
        matrix->diagonal[i] = cn_matrix_find(matrix, i, i);
    status = CN_OK;
done:
    free(start);
    free(mark);
    free(packed);
    if (status == CN_OK)
        *out = matrix;
    else
        cn_matrix_free(matrix);
    return status;
}

void cn_matrix_free(cn_matrix *matrix)
{
    if (!matrix) return;
    free(matrix->row);
    free(matrix->col);
    free(matrix->diagonal);
    free(matrix->value);
    free(matrix);
}

void cn_matrix_clear(cn_matrix *matrix, int nactive)
{
    memset(matrix->value, 0, (size_t)matrix->row[nactive] * 9 * sizeof *matrix->value);
}

int cn_matrix_find(const cn_matrix *matrix, int i, int j)
{
    int low = matrix->row[i], high = matrix->row[i + 1];

    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (matrix->col[middle] < j)
            low = middle + 1;
        else
            high = middle;
    }
    return low < matrix->row[i + 1] && matrix->col[low] == j ? low : -1;
}

/* End of row i with columns >= nactive left out. */
static int row_end(const cn_matrix *a, int i, int nactive)
{
    int end = a->row[i + 1];

    while (end > a->row[i] && a->col[end - 1] >= nactive)
        end--;
    return end;
}

static void multiply_rows(const cn_matrix *a, int nactive, int begin, int stop, const double *x, double *y)
{
    for (int i = begin; i < stop; i++) {
        const int end = row_end(a, i, nactive);
        double y0 = 0, y1 = 0, y2 = 0;
        for (int k = a->row[i]; k < end; k++) {
            const double *v = a->value + 9 * (size_t)k, *xj = x + 3 * (size_t)a->col[k];
            y0 += v[0] * xj[0] + v[1] * xj[1] + v[2] * xj[2];
            y1 += v[3] * xj[0] + v[4] * xj[1] + v[5] * xj[2];
            y2 += v[6] * xj[0] + v[7] * xj[1] + v[8] * xj[2];
        }
        y[3 * i] = y0, y[3 * i + 1] = y1, y[3 * i + 2] = y2;
    }
}

#ifdef __x86_64__
/* The same with one 4-vector per block row; the fourth lane is multiplied by x = 0. */
__attribute__((target("avx2,fma"))) static void multiply_rows_avx2(const cn_matrix *a, int nactive, int begin,
                                                                   int stop, const double *x, double *y)
{
    const __m256i three = _mm256_setr_epi64x(-1, -1, -1, 0);

    for (int i = begin; i < stop; i++) {
        const int end = row_end(a, i, nactive);
        __m256d s0 = _mm256_setzero_pd(), s1 = s0, s2 = s0;
        for (int k = a->row[i]; k < end; k++) {
            const double *v = a->value + 9 * (size_t)k;
            const __m256d xj = _mm256_maskload_pd(x + 3 * (size_t)a->col[k], three);
            s0 = _mm256_fmadd_pd(_mm256_loadu_pd(v), xj, s0);
            s1 = _mm256_fmadd_pd(_mm256_loadu_pd(v + 3), xj, s1);
            s2 = _mm256_fmadd_pd(_mm256_maskload_pd(v + 6, three), xj, s2);
        }
        const __m256d s01 = _mm256_hadd_pd(s0, s1), s22 = _mm256_hadd_pd(s2, s2);
        const __m128d y01 = _mm_add_pd(_mm256_castpd256_pd128(s01), _mm256_extractf128_pd(s01, 1));
        const __m128d y2 = _mm_add_pd(_mm256_castpd256_pd128(s22), _mm256_extractf128_pd(s22, 1));
        _mm_storeu_pd(y + 3 * (size_t)i, y01);
        _mm_store_sd(y + 3 * (size_t)i + 2, y2);
    }
}
#endif

void cn_matrix_multiply_rows(const cn_matrix *matrix, int nactive, int begin, int end, const double *x,
                             double *y)
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        multiply_rows_avx2(matrix, nactive, begin, end, x, y);
        return;
    }
#endif
    multiply_rows(matrix, nactive, begin, end, x, y);
}

typedef struct {
    const cn_matrix *matrix;
    int nactive;
    const double *x;
    double *y;
} product;

static void multiply_slice(void *user, int slice)
{
    const product *p = user;
    const int begin = slice * CN_MATRIX_SLICE;
    const int end = begin + CN_MATRIX_SLICE < p->nactive ? begin + CN_MATRIX_SLICE : p->nactive;

    cn_matrix_multiply_rows(p->matrix, p->nactive, begin, end, p->x, p->y);
}

void cn_matrix_multiply(const cn_matrix *matrix, int nactive, const double *x, double *y, cn_pool *pool)
{
    product p = {matrix, nactive, x, y};

    cn_pool_run(pool, (nactive + CN_MATRIX_SLICE - 1) / CN_MATRIX_SLICE, multiply_slice, &p);
}
