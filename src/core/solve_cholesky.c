/* solve_cholesky.c - CHOLMOD on the 3n x 3n matrix, its order found once on the n x n graph of nodes.
 *
 * The matrix is handed over already permuted, one triangle in natural order, through a map made once: a
 * refactor then copies values and allocates nothing but two blocks of CHOLMOD's supernodal module. */
#include "solve_parts.h"

#include <float.h>
#include <stdlib.h>
#include <suitesparse/cholmod.h>

struct cn_sparse {
    cholmod_common common;
    bool started;
    cholmod_sparse *matrix; /* permuted, one triangle */
    cholmod_factor *factor;
    cholmod_dense *x, *e; /* right-hand side and solution, workspace of the supernodal solves */
    int n;
    int *node;   /* node at a place in the order (n) */
    int *source; /* where an entry of the matrix stands in the blocks' values (nnz) */
    double flops, size;
};

/* Two BLAS threads on small supernodes are slower than one, and their sums vary. */
extern void openblas_set_num_threads(int threads) __attribute__((weak));
extern void omp_set_max_active_levels(int levels) __attribute__((weak));
extern int omp_get_max_active_levels(void) __attribute__((weak));

/* The supernodal module's OpenMP loops, which ask for four threads, made slower on two busy cores by 1.5
 * to 3. */
static int factorize(cn_sparse *sparse)
{
    const int levels = omp_get_max_active_levels ? omp_get_max_active_levels() : 0;

    if (omp_set_max_active_levels) omp_set_max_active_levels(0); /* of the calling thread alone */
    const int done = cholmod_factorize(sparse->matrix, sparse->factor, &sparse->common);
    if (omp_set_max_active_levels) omp_set_max_active_levels(levels);
    return done;
}

/* Order of the nodes with least fill: AMD or METIS. */
static cn_status order_nodes(cn_sparse *sparse, const cn_matrix *a)
{
    cholmod_common *common = &sparse->common;
    const size_t n = (size_t)a->n;
    cholmod_sparse *graph =
        cholmod_allocate_sparse(n, n, (size_t)a->nblock, 1, 1, -1, CHOLMOD_PATTERN, common);
    cholmod_factor *order = NULL;

    if (graph) {
        int *p = graph->p, *entry = graph->i, count = 0;
        for (int i = 0; i < a->n; i++) { /* symmetric: row i's part from the diagonal on is column i's */
            p[i] = count;
            for (int k = a->diagonal[i]; k < a->row[i + 1]; k++)
                entry[count++] = a->col[k];
        }
        p[a->n] = count;
        common->nmethods = 2;
        common->method[0].ordering = CHOLMOD_AMD;
        common->method[1].ordering = CHOLMOD_METIS;
        common->supernodal = CHOLMOD_SIMPLICIAL;
        order = cholmod_analyze(graph, common);
    }
    for (int i = 0; order && i < a->n; i++)
        sparse->node[i] = ((int *)order->Perm)[i];
    const bool found = order;
    cholmod_free_sparse(&graph, common);
    cholmod_free_factor(&order, common);
    return found ? CN_OK : CN_ERR_MEMORY;
}

static int compare_int(const void *a, const void *b)
{
    return *(const int *)a - *(const int *)b;
}

/* One triangle by columns: the lower one for the supernodal module, the upper one for the simplicial; each
 * then takes the matrix as it is. Column 3q + c is column c of the blocks (o, q): A's blocks (q, o)
 * transposed. */
static cn_status map_entries(cn_sparse *sparse, const cn_matrix *a, bool upper)
{
    const size_t nnz = (size_t)(a->nblock - a->n) / 2 * 9 + (size_t)a->n * 6, n3 = 3 * (size_t)a->n;
    int *place = malloc(((size_t)a->n + 1) * sizeof *place),
        *other = malloc(((size_t)a->n + 1) * sizeof *other);
    cn_status status = CN_ERR_MEMORY;
    int count = 0;

    cholmod_free_sparse(&sparse->matrix, &sparse->common);
    free(sparse->source);
    sparse->matrix =
        cholmod_allocate_sparse(n3, n3, nnz, 1, 1, upper ? 1 : -1, CHOLMOD_REAL, &sparse->common);
    sparse->source = malloc((nnz + 1) * sizeof *sparse->source);
    if (!place || !other || !sparse->matrix || !sparse->source) goto done;
    int *p = sparse->matrix->p, *entry = sparse->matrix->i;
    for (int q = 0; q < a->n; q++)
        place[sparse->node[q]] = q;
    for (int q = 0; q < a->n; q++) {
        const int i = sparse->node[q];
        int nother = 0;
        for (int k = a->row[i]; k < a->row[i + 1]; k++)
            if (upper ? place[a->col[k]] <= q : place[a->col[k]] >= q) other[nother++] = place[a->col[k]];
        qsort(other, (size_t)nother, sizeof *other, compare_int);
        for (int c = 0; c < 3; c++) {
            p[3 * q + c] = count;
            for (int e = 0; e < nother; e++) {
                const int block = cn_matrix_find(a, i, sparse->node[other[e]]);
                const int low = other[e] == q && !upper ? c : 0, high = other[e] == q && upper ? c : 2;
                for (int r = low; r <= high; r++) {
                    entry[count] = 3 * other[e] + r;
                    sparse->source[count++] = 9 * block + 3 * c + r;
                }
            }
        }
    }
    p[3 * a->n] = count;
    status = CN_OK;
done:
    free(place);
    free(other);
    return status;
}

static void fill(cn_sparse *sparse, const cn_matrix *a, const unsigned char *held)
{
    const int *p = sparse->matrix->p, *entry = sparse->matrix->i;
    double *x = sparse->matrix->x;

    for (int j = 0; j < 3 * sparse->n; j++) {
        const bool column_held = held[sparse->node[j / 3]];
        for (int k = p[j]; k < p[j + 1]; k++)
            x[k] =
                column_held || held[sparse->node[entry[k] / 3]] ? entry[k] == j : a->value[sparse->source[k]];
    }
}

cn_status cn_sparse_new(cn_sparse **out, const cn_matrix *pattern)
{
    const size_t n = (size_t)pattern->n;
    cn_status status = CN_ERR_MEMORY;
    cn_sparse *sparse = calloc(1, sizeof *sparse);
    unsigned char *all = malloc(n + 1);

    *out = NULL;
    if (!sparse || !all) goto done;
    if (openblas_set_num_threads) openblas_set_num_threads(1);
    cholmod_common *common = &sparse->common;
    if (!(sparse->started = cholmod_start(common))) goto done;
    common->print = 0;
    common->error_handler = NULL;
    common->final_ll = 1; /* square roots: a simplicial LDL' would pass an indefinite matrix */
    common->quick_return_if_not_posdef = 1;
    sparse->n = pattern->n;
    if (!(sparse->node = malloc((n + 1) * sizeof *sparse->node))) goto done;
    if ((status = order_nodes(sparse, pattern)) != CN_OK) goto done;
    if ((status = map_entries(sparse, pattern, false)) != CN_OK) goto done;

    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_NATURAL;
    common->postorder = 0; /* the nodes are in postorder already */
    common->supernodal = CHOLMOD_AUTO;
    sparse->factor = cholmod_analyze(sparse->matrix, common);
    status = CN_ERR_MEMORY;
    if (!sparse->factor) goto done;
    sparse->flops = common->fl, sparse->size = common->lnz;
    if (!sparse->factor->is_super && (status = map_entries(sparse, pattern, true)) != CN_OK) goto done;
    status = CN_ERR_MEMORY;
    sparse->x = cholmod_zeros(3 * n, 1, CHOLMOD_REAL, common);
    sparse->e = cholmod_zeros(sparse->factor->maxesize, 1, CHOLMOD_REAL, common);
    if (!sparse->x || !sparse->e) goto done;
    for (size_t i = 0; i < n; i++) /* a first factor, of the identity, takes the memory of all later ones */
        all[i] = 1;
    fill(sparse, pattern, all);
    if (!factorize(sparse)) goto done;
    status = CN_OK;
done:
    free(all);
    if (status == CN_OK)
        *out = sparse;
    else
        cn_sparse_free(sparse);
    return status;
}

void cn_sparse_free(cn_sparse *sparse)
{
    if (!sparse) return;
    if (sparse->started) {
        cholmod_free_sparse(&sparse->matrix, &sparse->common);
        cholmod_free_factor(&sparse->factor, &sparse->common);
        cholmod_free_dense(&sparse->x, &sparse->common);
        cholmod_free_dense(&sparse->e, &sparse->common);
        cholmod_finish(&sparse->common);
    }
    free(sparse->node);
    free(sparse->source);
    free(sparse);
}

void cn_sparse_cost(const cn_sparse *sparse, double *flops, double *size, bool *supernodal)
{
    *flops = sparse->flops;
    *size = sparse->size;
    *supernodal = sparse->factor->is_super;
}

/* Whether every pivot is above rounding: CN_PIVOT_MIN of the matrix's own diagonal. */
static bool pivots_positive(const cn_sparse *sparse)
{
    const cholmod_factor *factor = sparse->factor;
    const double *value = factor->x, *diagonal = sparse->matrix->x;
    const int *column = sparse->matrix->p;

    if (factor->is_super) {
        const int *first = factor->super, *rows = factor->pi, *at = factor->px;
        for (size_t s = 0; s < factor->nsuper; s++)
            for (int j = first[s], k = 0; j < first[s + 1]; j++, k++) {
                const double u = value[at[s] + (size_t)k * (size_t)(rows[s + 1] - rows[s] + 1)];
                if (!(u * u > CN_PIVOT_MIN * diagonal[column[j]] && u <= DBL_MAX)) return false;
            }
        return true;
    }
    for (int j = 0; j < 3 * sparse->n; j++) {
        const double u = value[((int *)factor->p)[j]];
        if (!(u * u > CN_PIVOT_MIN * diagonal[column[j + 1] - 1] && u <= DBL_MAX)) return false;
    }
    return true;
}

cn_status cn_sparse_factor(cn_sparse *sparse, const cn_matrix *a, const unsigned char *held)
{
    cholmod_common *common = &sparse->common;

    fill(sparse, a, held);
    if (!factorize(sparse)) return common->status == CHOLMOD_NOT_POSDEF ? CN_ERR_SINGULAR : CN_ERR_MEMORY;
    if (common->status == CHOLMOD_NOT_POSDEF || sparse->factor->minor < sparse->factor->n)
        return CN_ERR_SINGULAR;
    return pivots_positive(sparse) ? CN_OK : CN_ERR_SINGULAR;
}

/* x = L'^-1 L^-1 x of a simplicial LL': column j of L is its diagonal, then the rows below. */
static void solve_columns(const cholmod_factor *factor, double *x)
{
    const int *p = factor->p, *row = factor->i, *count = factor->nz;
    const double *value = factor->x;

    for (int j = 0; j < (int)factor->n; j++) {
        const double xj = x[j] /= value[p[j]];
        for (int k = p[j] + 1; k < p[j] + count[j]; k++)
            x[row[k]] -= value[k] * xj;
    }
    for (int j = (int)factor->n - 1; j >= 0; j--) {
        double xj = x[j];
        for (int k = p[j] + 1; k < p[j] + count[j]; k++)
            xj -= value[k] * x[row[k]];
        x[j] = xj / value[p[j]];
    }
}

cn_status cn_sparse_solve(cn_sparse *sparse, const unsigned char *held, const double *b, double *x)
{
    double *y = sparse->x->x;
    int good = 1;

    for (int q = 0; q < sparse->n; q++)
        for (int c = 0; c < 3; c++)
            y[3 * q + c] = held[sparse->node[q]] ? 0 : b[3 * (size_t)sparse->node[q] + c];
    if (sparse->factor->is_super)
        good = cholmod_super_lsolve(sparse->factor, sparse->x, sparse->e, &sparse->common) &&
               cholmod_super_ltsolve(sparse->factor, sparse->x, sparse->e, &sparse->common);
    else
        solve_columns(sparse->factor, y);
    if (!good) return CN_ERR_MEMORY;
    for (int q = 0; q < sparse->n; q++)
        for (int c = 0; c < 3 && !held[sparse->node[q]]; c++)
            x[3 * (size_t)sparse->node[q] + c] = y[3 * q + c];
    return CN_OK;
}

cn_factor_view cn_sparse_view(const cn_sparse *sparse)
{
    const cholmod_factor *l = sparse->factor;
    cn_factor_view view = {.n = sparse->n, .node = sparse->node, .value = l->x};

    if (l->is_super) {
        view.nblock = (int)l->nsuper, view.first = l->super;
        view.row_at = l->pi, view.value_at = l->px, view.row = l->s;
    } else {
        view.nblock = 3 * sparse->n;
        view.row_at = view.value_at = l->p, view.nrow = l->nz, view.row = l->i;
    }
    return view;
}
