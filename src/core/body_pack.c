/* body_pack.c - packs elements into batches and chunks near each other in space, and colours the chunks. */
#include "body_element.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double key;
    int element;
} place;

static int by_key(const void *a, const void *b)
{
    const place *p = a, *q = b;
    if (p->key != q->key) return p->key < q->key ? -1 : 1;
    return (p->element > q->element) - (p->element < q->element);
}

/* Sum over an element's first four nodes: its corners. */
static double centre(const cn_body *body, int element, int axis)
{
    const int *n = body->connect + (size_t)body->nper * (size_t)element;
    const double *x = body->rest + axis;
    return x[3 * (size_t)n[0]] + x[3 * (size_t)n[1]] + x[3 * (size_t)n[2]] + x[3 * (size_t)n[3]];
}

static int top_node(const cn_body *body, int element)
{
    const int *n = body->connect + (size_t)body->nper * (size_t)element;
    int top = n[0];
    for (int a = 1; a < body->nper; a++)
        if (n[a] > top) top = n[a];
    return top;
}

/* Orders n elements so that each run of `chunk` is compact: halves across the longest extent, recursively;
 * within a chunk by the largest node, so that a body cut at nactive leaves whole batches. */
static void order_elements(const cn_body *body, place *list, int n, int chunk)
{
    int axis = 0;
    double longest = -1;
    for (int k = 0; n > chunk && k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < n; i++) {
            const double c = centre(body, list[i].element, k);
            low = fmin(low, c), high = fmax(high, c);
        }
        if (high - low > longest) longest = high - low, axis = k;
    }
    for (int i = 0; i < n; i++)
        list[i].key = n > chunk ? centre(body, list[i].element, axis) : top_node(body, list[i].element);
    qsort(list, (size_t)n, sizeof *list, by_key);
    if (n <= chunk) return;
    const int nchunk = (n + chunk - 1) / chunk, half = nchunk / 2 * chunk;
    order_elements(body, list, half, chunk);
    order_elements(body, list + half, n - half, chunk);
}

static void fill_tet4(cn_batch *batch, const cn_body *body, const int *order, int n)
{
    for (int lane = 0; lane < CN_LANES; lane++) {
        const int element = order[lane < n ? lane : 0], top = top_node(body, element);
        for (int i = 0; i < 9; i++)
            batch->grad[i][lane] = body->shape_grad[12 * (size_t)element + 3 + i];
        batch->volume[lane] = lane < n ? body->volume[element] : 0;
        batch->mu[lane] = body->mu[element], batch->lambda[lane] = body->lambda[element];
        memcpy(batch->node[lane], body->tet + 4 * (size_t)element, sizeof batch->node[lane]);
        batch->element[lane] = lane < n ? element : -1;
        if (lane == 0 || top < batch->top_min) batch->top_min = top;
        if (lane == 0 || top > batch->top_max) batch->top_max = top;
    }
}

static void fill_tet10(cn_batch10 *batch, const cn_body *body, const int *order, int n)
{
    for (int lane = 0; lane < CN_LANES; lane++) {
        const int element = order[lane < n ? lane : 0];
        double grad[CN_TET10_POINTS][9], volume[CN_TET10_POINTS];
        cn_tet10_points(body, element, grad, volume);
        for (int q = 0; q < CN_TET10_POINTS; q++) {
            for (int i = 0; i < 9; i++)
                batch->grad[q][i][lane] = grad[q][i];
            batch->volume[q][lane] = lane < n ? volume[q] : 0;
        }
        batch->mu[lane] = body->mu[element], batch->lambda[lane] = body->lambda[element];
        memcpy(batch->node[lane], body->connect + 10 * (size_t)element, sizeof batch->node[lane]);
        batch->element[lane] = lane < n ? element : -1;
        batch->top[lane] = top_node(body, element);
        if (lane == 0 || batch->top[lane] < batch->top_min) batch->top_min = batch->top[lane];
    }
}

/* Greedy colours of the chunks (data->chunk, colour_start). Where 64 are too few, each chunk has its own. */
static cn_status colour_chunks(struct cn_element_data *data, const cn_body *body)
{
    const int nper = body->nper;
    uint64_t *seen = calloc((size_t)body->nnode, sizeof *seen); /* colours of the chunks at each node */
    int *colour = calloc((size_t)data->nchunk, sizeof *colour);
    data->chunk = calloc((size_t)data->nchunk, sizeof *data->chunk);
    data->colour_start = calloc((size_t)data->nchunk + 1, sizeof *data->colour_start);
    const cn_status status = seen && colour && data->chunk && data->colour_start ? CN_OK : CN_ERR_MEMORY;
    if (status != CN_OK) goto done;

    const int lanes = data->chunk_batches * CN_LANES, all = body->nelement;
    for (int c = 0; c < data->nchunk; c++) {
        const int first = c * lanes, last = first + lanes < all ? first + lanes : all;
        uint64_t near = 0;
        for (int i = first; i < last; i++)
            for (int a = 0; a < nper; a++)
                near |= seen[body->connect[(size_t)nper * (size_t)data->order[i] + (size_t)a]];
        int free_colour = 0;
        while (free_colour < 64 && near >> free_colour & 1)
            free_colour++;
        if (free_colour == 64) {
            data->ncolour = data->nchunk;
            for (int k = 0; k < data->nchunk; k++)
                colour[k] = k;
            break;
        }
        for (int i = first; i < last; i++)
            for (int a = 0; a < nper; a++)
                seen[body->connect[(size_t)nper * (size_t)data->order[i] + (size_t)a]] |= (uint64_t)1
                                                                                          << free_colour;
        colour[c] = free_colour;
        if (free_colour >= data->ncolour) data->ncolour = free_colour + 1;
    }
    for (int k = 0, n = 0; k < data->ncolour; k++) {
        for (int c = 0; c < data->nchunk; c++)
            if (colour[c] == k) data->chunk[n++] = c;
        data->colour_start[k + 1] = n;
    }
done:
    free(seen);
    free(colour);
    return status;
}

cn_status cn_element_data_new(struct cn_element_data **out, const cn_body *body)
{
    cn_status status = CN_ERR_MEMORY;
    place *list = NULL;
    struct cn_element_data *data = calloc(1, sizeof *data);
    *out = NULL;
    if (!data) return CN_ERR_MEMORY;
    data->nbatch = body->ntet / CN_LANES + (body->ntet % CN_LANES != 0);
    data->chunk_batches = CN_CHUNK_BATCHES;
    if (data->nbatch / CN_CHUNKS_MAX >= CN_CHUNK_BATCHES)
        data->chunk_batches = data->nbatch / CN_CHUNKS_MAX + 1;
    data->nchunk = (data->nbatch + data->chunk_batches - 1) / data->chunk_batches;
    const bool second = body->model == CN_BODY_TET10;
    const size_t size = second ? sizeof *data->batch10 : sizeof *data->batch;
    void *batch = aligned_alloc(64, (size_t)data->nbatch * size);
    data->kernels = second ? cn_kernels10_pick(2) : cn_kernels_pick(2);
    data->batch = second ? NULL : batch, data->batch10 = second ? batch : NULL;
    data->order = calloc((size_t)body->ntet, sizeof *data->order);
    list = calloc((size_t)body->ntet, sizeof *list);
    if (!batch || !data->order || !list) goto fail;
    memset(batch, 0, (size_t)data->nbatch * size);
    for (int i = 0; i < body->ntet; i++)
        list[i].element = i;
    order_elements(body, list, body->ntet, data->chunk_batches * CN_LANES);
    for (int i = 0; i < body->ntet; i++)
        data->order[i] = list[i].element;
    for (int k = 0; k < data->nbatch; k++) {
        const int first = k * CN_LANES, left = body->ntet - first, n = left < CN_LANES ? left : CN_LANES;
        if (second)
            fill_tet10(data->batch10 + k, body, data->order + first, n);
        else
            fill_tet4(data->batch + k, body, data->order + first, n);
    }
    if ((status = colour_chunks(data, body)) != CN_OK) goto fail;
    free(list);
    *out = data;
    return CN_OK;
fail:
    free(list);
    cn_element_data_free(data);
    return status;
}

void cn_element_data_free(struct cn_element_data *data)
{
    if (!data) return;
    free(data->batch);
    free(data->batch10);
    free(data->order);
    free(data->colour_start);
    free(data->chunk);
    free(data);
}
