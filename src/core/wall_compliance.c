#include "wall_compliance.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "solve_parts.h"

/* Columns lie in chains of pages, a block (the node's rows of the vertex's three columns) for each node. */
enum { PAGE = 16, NONE = -1, GROUP = CN_COLUMN_NODES };

/* Solves pass over what is this much smaller again: what is below stays so. */
#define PASSED_OVER (CN_COMPLIANCE_DROP / 4)

typedef struct {
    int next, count;
    int node[PAGE];
    double block[PAGE][9];
} page;

/* A vertex: its pages, and who was used just before and after it. */
typedef struct {
    int first, npage, older, newer;
} entry;

struct cn_compliance {
    int n, npage, nfree, free_page;
    page *page;
    entry *entry; /* (n + 1): the last one joins newest and oldest; a vertex without pages joins itself */
    int *group, *member; /* group of a vertex (n); vertices by groups, GROUP each, NONE where it has fewer */
    int *slot;           /* place of a node in the list at hand; NONE between calls (n) */
    cn_columns *columns; /* of a group */
    unsigned char *held; /* (n) */
    cn_sparse *sparse;
    long solves, dropped;
};

/* --- memory --- */

/* Groups of neighbours: each vertex not in one yet begins one, breadth first. */
static void make_groups(cn_compliance *c, const cn_matrix *a)
{
    int ngroup = 0;
    for (int i = 0; i < c->n; i++)
        c->group[i] = NONE;
    for (int i = 0; i < c->n; i++) {
        int *member = c->member + (size_t)GROUP * (size_t)ngroup, count = 0;
        if (c->group[i] != NONE) continue;
        c->group[i] = ngroup, member[count++] = i;
        for (int m = 0; m < count; m++)
            for (int k = a->row[member[m]]; k < a->row[member[m] + 1] && count < GROUP; k++)
                if (c->group[a->col[k]] == NONE) c->group[a->col[k]] = ngroup, member[count++] = a->col[k];
        while (count < GROUP)
            member[count++] = NONE;
        ngroup++;
    }
}

cn_status cn_compliance_new(cn_compliance **out, const cn_matrix *a, const unsigned char *held, size_t bytes,
                            cn_error *error)
{
    const size_t n = (size_t)a->n, least = (n + PAGE - 1) / PAGE;
    cn_compliance *c = NULL;
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (bytes / sizeof(page) < least)
        return cn_fail(error, CN_ERR_ARG, NULL, 0,
                       "%zu bytes do not hold the columns of a single vertex of %d: give at least %zu", bytes,
                       a->n, least * sizeof(page));
    if (!(c = calloc(1, sizeof *c))) goto fail;
    c->n = a->n, c->npage = c->nfree = bytes / sizeof(page) < INT_MAX ? (int)(bytes / sizeof(page)) : INT_MAX;
    c->page = malloc((size_t)c->npage * sizeof *c->page);
    c->entry = malloc((n + 1) * sizeof *c->entry);
    c->group = malloc((n + 1) * sizeof *c->group);
    c->member = malloc((GROUP * n + 1) * sizeof *c->member);
    c->slot = malloc((n + 1) * sizeof *c->slot);
    c->held = calloc(n + 1, 1);
    if (!c->page || !c->entry || !c->group || !c->member || !c->slot || !c->held) goto fail;
    for (int i = 0; i < c->npage; i++)
        c->page[i].next = i + 1 < c->npage ? i + 1 : NONE;
    for (int i = 0; i <= c->n; i++)
        c->entry[i] = (entry){NONE, 0, i, i}, c->slot[i] = NONE;
    for (int i = 0; held && i < c->n; i++)
        c->held[i] = held[i];
    make_groups(c, a);
    if ((status = cn_sparse_new(&c->sparse, a)) != CN_OK) goto fail;
    if ((status = cn_columns_new(&c->columns, c->sparse, 2)) != CN_OK) goto fail;
    if ((status = cn_sparse_factor(c->sparse, a, c->held)) != CN_OK) goto fail;
    *out = c;
    return CN_OK;
fail:
    cn_compliance_free(c);
    return cn_fail(error, status, NULL, 0, "no compliance of a wall of %d vertices: %s", a->n,
                   cn_status_text(status));
}

void cn_compliance_free(cn_compliance *c)
{
    if (!c) return;
    cn_sparse_free(c->sparse);
    free(c->page);
    free(c->entry);
    free(c->group);
    free(c->member);
    free(c->slot);
    cn_columns_free(c->columns);
    free(c->held);
    free(c);
}

/* --- who makes room --- */

static void leave_ring(cn_compliance *c, int v)
{
    c->entry[c->entry[v].older].newer = c->entry[v].newer;
    c->entry[c->entry[v].newer].older = c->entry[v].older;
}

static void make_newest(cn_compliance *c, int v)
{
    leave_ring(c, v);
    const int last = c->entry[c->n].older;
    c->entry[v].older = last, c->entry[v].newer = c->n;
    c->entry[last].newer = c->entry[c->n].older = v;
}

static void drop(cn_compliance *c, int v)
{
    int last = c->entry[v].first;
    while (c->page[last].next != NONE)
        last = c->page[last].next;
    c->page[last].next = c->free_page, c->free_page = c->entry[v].first;
    c->nfree += c->entry[v].npage;
    c->dropped++;
    leave_ring(c, v);
    c->entry[v] = (entry){NONE, 0, v, v};
}

/* Drops those unused for longest, but none of the list at hand, until npage are free. */
static bool make_room(cn_compliance *c, int npage)
{
    for (int v = c->entry[c->n].newer; c->nfree < npage && v != c->n;) {
        const int next = c->entry[v].newer;
        if (c->slot[v] == NONE) drop(c, v);
        v = next;
    }
    return c->nfree >= npage;
}

cn_status cn_compliance_refactor(cn_compliance *c, const cn_matrix *a)
{
    while (c->entry[c->n].newer != c->n)
        drop(c, c->entry[c->n].newer);
    return cn_sparse_factor(c->sparse, a, c->held);
}

/* --- columns --- */

/* Whether the node at place q stays in the columns of the group's vertex k. */
static bool stays(const cn_columns *columns, int k, const double largest[3], int q)
{
    const double *x = columns->x + 3 * CN_COLUMNS * (size_t)q + 3 * (size_t)k;
    for (int r = 0; r < 3; r++, x += CN_COLUMNS)
        for (int i = 0; i < 3; i++)
            if (fabs(x[i]) > CN_COMPLIANCE_DROP * largest[i]) return true;
    return false;
}

static int add_page(cn_compliance *c, int *link)
{
    const int fresh = c->free_page;
    c->free_page = c->page[fresh].next;
    c->page[fresh].next = NONE, c->page[fresh].count = 0;
    return *link = fresh;
}

/* Keeps the columns of the group's vertex k, which is v; for these others make room if `must`. */
static cn_status keep(cn_compliance *c, int v, int k, bool must)
{
    const cn_columns *columns = c->columns;
    double largest[3] = {0};
    int count = 0;
    for (int p = 0; p < columns->nplace; p++)
        for (int r = 0; r < 9; r++)
            largest[r % 3] = fmax(
                largest[r % 3], fabs(columns->x[(3 * (size_t)columns->place[p] + (size_t)r / 3) * CN_COLUMNS +
                                                3 * (size_t)k + (size_t)r % 3]));
    for (int p = 0; p < columns->nplace; p++)
        count += columns->node[columns->place[p]] == v || stays(columns, k, largest, columns->place[p]);
    const int npage = count > 0 ? (count + PAGE - 1) / PAGE : 1; /* none of a held vertex: an empty page */
    if (c->nfree < npage && (!must || !make_room(c, npage))) return CN_ERR_MEMORY;
    int last = add_page(c, &c->entry[v].first);
    for (int p = 0; p < columns->nplace; p++) {
        const int q = columns->place[p], node = columns->node[q];
        const double *x = columns->x + 3 * CN_COLUMNS * (size_t)q + 3 * (size_t)k;
        if (node != v && !stays(columns, k, largest, q)) continue;
        if (c->page[last].count == PAGE) last = add_page(c, &c->page[last].next);
        double *block = c->page[last].block[c->page[last].count];
        c->page[last].node[c->page[last].count++] = node;
        for (int r = 0; r < 3; r++)
            for (int i = 0; i < 3; i++)
                block[3 * r + i] = x[r * CN_COLUMNS + i];
        for (int r = 0; node == v && r < 3; r++) /* its own is symmetric but for rounding */
            for (int i = 0; i < r; i++)
                block[3 * r + i] = block[3 * i + r];
    }
    c->nfree -= npage, c->entry[v].npage = npage;
    make_newest(c, v);
    return CN_OK;
}

/* Solves for v's group; those of it in the list at hand are kept, the others where there is room. */
static cn_status solve_group(cn_compliance *c, int v)
{
    const int *member = c->member + (size_t)GROUP * (size_t)c->group[v];
    int count = 0;
    while (count < GROUP && member[count] != NONE)
        count++;
    cn_status status = CN_OK;
    cn_columns_solve(c->columns, c->sparse, c->held, count, member, PASSED_OVER);
    c->solves++;
    for (int asked = 1; asked >= 0; asked--)
        for (int k = 0; k < count && status == CN_OK; k++) {
            const int m = member[k];
            if (c->entry[m].npage > 0 || (c->slot[m] != NONE) != asked) continue;
            status = keep(c, m, k, asked);
            if (!asked) status = CN_OK;
        }
    return status;
}

cn_status cn_compliance_ensure(cn_compliance *c, int n, const int *vertex)
{
    cn_status status = CN_OK;
    int seen = 0;
    for (; seen < n; seen++) {
        const int v = vertex[seen];
        if (v < 0 || v >= c->n || c->slot[v] != NONE) {
            status = CN_ERR_ARG;
            break;
        }
        c->slot[v] = seen;
    }
    for (int k = 0; k < n && status == CN_OK; k++)
        if (c->entry[vertex[k]].npage > 0) make_newest(c, vertex[k]);
    for (int k = 0; k < n && status == CN_OK; k++)
        if (c->entry[vertex[k]].npage == 0) status = solve_group(c, vertex[k]);
    for (int k = 0; k < seen; k++)
        c->slot[vertex[k]] = NONE;
    return status;
}

/* --- what they give --- */

/* Calls give(i, j, block) for every block of C_TT on and above the diagonal, in the order of vertices: of two
 * vertices the column of the one with the higher index counts, for both triangles. */
typedef void (*giving)(void *user, int i, int j, const double block[9]);
static void each_block(cn_compliance *c, int n, const int *vertex, giving give, void *user)
{
    for (int k = 0; k < n; k++)
        c->slot[vertex[k]] = k;
    for (int k = 0; k < n; k++)
        for (int p = c->entry[vertex[k]].first; p != NONE; p = c->page[p].next)
            for (int b = 0; b < c->page[p].count; b++) {
                const int node = c->page[p].node[b];
                if (node <= vertex[k] && c->slot[node] != NONE)
                    give(user, c->slot[node], k, c->page[p].block[b]);
            }
    for (int k = 0; k < n; k++)
        c->slot[vertex[k]] = NONE;
}

typedef struct {
    const double *f;
    double *y; /* the dense matrix in put_block */
    size_t n3;
} giving_job;

static void apply_block(void *user, int i, int j, const double block[9])
{
    const giving_job *job = user;
    const double *fi = job->f + 3 * (size_t)i, *fj = job->f + 3 * (size_t)j;
    double *yi = job->y + 3 * (size_t)i, *yj = job->y + 3 * (size_t)j;
    for (int r = 0; r < 3; r++)
        yi[r] += block[3 * r] * fj[0] + block[3 * r + 1] * fj[1] + block[3 * r + 2] * fj[2];
    for (int r = 0; r < 3 && i != j; r++)
        yj[r] += block[r] * fi[0] + block[3 + r] * fi[1] + block[6 + r] * fi[2];
}

static void put_block(void *user, int i, int j, const double block[9])
{
    const giving_job *job = user;
    for (size_t r = 0; r < 3; r++)
        for (size_t k = 0; k < 3; k++) {
            const size_t row = 3 * (size_t)i + r, col = 3 * (size_t)j + k;
            job->y[row * job->n3 + col] = job->y[col * job->n3 + row] = block[3 * r + k];
        }
}

void cn_compliance_apply(cn_compliance *c, int n, const int *vertex, const double *f, double *y)
{
    giving_job job = {f, y, 3 * (size_t)n};
    memset(y, 0, job.n3 * sizeof *y);
    each_block(c, n, vertex, apply_block, &job);
}

void cn_compliance_gather(cn_compliance *c, int n, const int *vertex, double *dense)
{
    giving_job job = {NULL, dense, 3 * (size_t)n};
    memset(dense, 0, job.n3 * job.n3 * sizeof *dense);
    each_block(c, n, vertex, put_block, &job);
}

void cn_compliance_spread(const cn_compliance *c, int n, const int *vertex, const double *f, double *u)
{
    for (int k = 0; k < n; k++, f += 3)
        for (int p = c->entry[vertex[k]].first; p != NONE; p = c->page[p].next)
            for (int b = 0; b < c->page[p].count; b++) {
                const double *block = c->page[p].block[b];
                double *to = u + 3 * (size_t)c->page[p].node[b];
                for (int r = 0; r < 3; r++)
                    to[r] += block[3 * r] * f[0] + block[3 * r + 1] * f[1] + block[3 * r + 2] * f[2];
            }
}

cn_compliance_counts cn_compliance_count(const cn_compliance *c)
{
    cn_compliance_counts counts = {.solves = c->solves, .dropped = c->dropped};
    for (int v = c->entry[c->n].newer; v != c->n; v = c->entry[v].newer) {
        counts.kept++, counts.bytes += (size_t)c->entry[v].npage * sizeof(page);
        for (int p = c->entry[v].first; p != NONE; p = c->page[p].next)
            counts.nodes += c->page[p].count;
    }
    return counts;
}
