/* molecules_frame.c - local frames of molecules from their most orthogonal neighbours (Egger 2004, 3.2.1, who
 * picks the first at random: here the choice is a function of the body alone). */
#include "molecules.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "polar.h"

/* Neighbours looked at; least volume, area of unit directions that count as spanning space, a plane. */
enum { CANDIDATES = 16 };
static const double SPAN_MIN = 0.05;

typedef struct {
    int neighbour;
    double distance, direction[3];
} near;

static int by_index(const void *a, const void *b)
{
    return ((const near *)a)->neighbour - ((const near *)b)->neighbour;
}

/* Puts a neighbour among the nearest so far; of equally near ones the least index stays. */
static int keep_near(near *list, int n, const near *item)
{
    int at = n;
    while (at > 0 && (item->distance < list[at - 1].distance ||
                      (item->distance == list[at - 1].distance && item->neighbour < list[at - 1].neighbour)))
        at--;
    if (at == CANDIDATES) return n;
    if (n < CANDIDATES) n++;
    memmove(list + at + 1, list + at, (size_t)(n - 1 - at) * sizeof *list);
    list[at] = *item;
    return n;
}

/* A set is better than another of the same size if it spans more than rounding more. */
static bool better(double span, double best)
{
    return span > best * (1 + 1e-9);
}

/* Indices into list of those that span most, in order; returns how many. */
static int most_orthogonal(const near *list, int n, int out[3])
{
    double best[3] = {0, SPAN_MIN, SPAN_MIN}, normal[3];
    int count = 0;
    if (n > 0) out[0] = 0, count = 1;
    for (int a = 0; a < n; a++)
        for (int b = a + 1; b < n; b++) {
            cn_cross(list[a].direction, list[b].direction, normal);
            const double area = cn_norm(normal);
            if (count < 3 && better(area, best[1])) out[0] = a, out[1] = b, best[1] = area, count = 2;
            for (int c = b + 1; c < n; c++) {
                const double volume = fabs(cn_dot(normal, list[c].direction));
                if (better(volume, best[2])) {
                    out[0] = a, out[1] = b, out[2] = c;
                    best[2] = volume, count = 3;
                }
            }
        }
    return count;
}

cn_status cn_molecule_frames_new(cn_molecule_frames **out, const cn_body *body)
{
    const size_t n = (size_t)body->nnode;
    cn_molecule_frames *frames = calloc(1, sizeof *frames);
    near *list = calloc(n * CANDIDATES, sizeof *list);
    int *count = calloc(n, sizeof *count);
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!frames || !list || !count) goto done;
    frames->n = body->nnode;
    frames->neighbour = calloc(n, 3 * sizeof *frames->neighbour);
    frames->rest = calloc(n, 9 * sizeof *frames->rest);
    frames->over = calloc(n, 3 * sizeof *frames->over);
    if (!frames->neighbour || !frames->rest || !frames->over) goto done;
    for (int b = 0; b < body->nelement; b++)
        for (int end = 0; end < 2; end++) {
            const int i = body->connect[2 * b + end];
            near item = {.neighbour = body->connect[2 * b + 1 - end]};
            cn_sub(body->rest + 3 * (size_t)item.neighbour, body->rest + 3 * (size_t)i, item.direction);
            item.distance = cn_normalise(item.direction);
            count[i] = keep_near(list + CANDIDATES * (size_t)i, count[i], &item);
        }
    for (size_t i = 0; i < n; i++) {
        near *mine = list + CANDIDATES * i;
        int chosen[3];
        qsort(mine, (size_t)count[i], sizeof *mine, by_index);
        const int rank = most_orthogonal(mine, count[i], chosen);
        for (int k = 0; k < 3; k++) {
            frames->neighbour[3 * i + (size_t)k] = k < rank ? mine[chosen[k]].neighbour : -1;
            if (k >= rank) continue;
            cn_copy3(mine[chosen[k]].direction, frames->rest + 9 * i + 3 * k);
            frames->over[3 * i + (size_t)k] = 1 / mine[chosen[k]].distance;
        }
    }
    status = CN_OK;
done:
    free(list), free(count);
    if (status == CN_OK)
        *out = frames;
    else
        cn_molecule_frames_free(frames);
    return status;
}

void cn_molecule_frames_free(cn_molecule_frames *frames)
{
    if (!frames) return;
    free(frames->neighbour), free(frames->rest), free(frames->over);
    free(frames);
}

/* The least rotation that takes the unit vector a along b: half-way quaternion; of opposite ones half a turn
 * about some normal. */
static void least_rotation(const double a[3], const double b[3], double q[4])
{
    double to[3], axis[3];
    cn_copy3(b, to);
    q[0] = 1, q[1] = q[2] = q[3] = 0;
    if (!(cn_normalise(to) > 0)) return;
    const double along = cn_dot(a, to);
    if (along > -1 + 1e-14) {
        cn_cross(a, to, axis);
        const double w = sqrt(0.5 * (1 + along));
        q[0] = w;
        for (int k = 0; k < 3; k++)
            q[1 + k] = axis[k] / (2 * w);
    } else {
        cn_any_normal(a, axis);
        q[0] = 0, cn_copy3(axis, q + 1);
    }
    const double size = sqrt(q[0] * q[0] + cn_norm2(q + 1));
    for (int k = 0; k < 4; k++)
        q[k] /= size;
}

typedef struct {
    const cn_molecule_frames *frames;
    const double *x;
    double *rotation;
} job;

enum { CHUNK = 256 };

static void add_outer(const double a[3], const double b[3], double m[9])
{
    for (int i = 0; i < 9; i++)
        m[i] += a[i / 3] * b[i % 3];
}

static void rotate_chunk(void *user, int chunk)
{
    const job *j = user;
    const cn_molecule_frames *f = j->frames;
    for (int i = chunk * CHUNK; i < f->n && i < (chunk + 1) * CHUNK; i++) {
        const int *neighbour = f->neighbour + 3 * (size_t)i;
        const double *rest = f->rest + 9 * (size_t)i, *over = f->over + 3 * (size_t)i;
        double *q = j->rotation + 4 * (size_t)i, m[9] = {0}, now[3][3];
        int rank = 0;
        for (; rank < 3 && neighbour[rank] >= 0; rank++) {
            cn_sub(j->x + 3 * (size_t)neighbour[rank], j->x + 3 * (size_t)i, now[rank]);
            for (int k = 0; k < 3; k++)
                now[rank][k] *= over[rank];
            add_outer(now[rank], rest + 3 * rank, m);
        }
        if (rank < 2) {
            least_rotation(rest, rank ? now[0] : rest, q);
            continue;
        }
        if (rank == 2) {
            double before[3], after[3];
            cn_cross(rest, rest + 3, before), cn_cross(now[0], now[1], after);
            cn_normalise(before), cn_normalise(after);
            add_outer(after, before, m);
        }
        cn_polar(m, q);
    }
}

void cn_molecule_rotations(const cn_molecule_frames *frames, const double *x, double *rotation, cn_pool *pool)
{
    job j = {frames, x, rotation};
    cn_pool_run(frames->n > CHUNK ? pool : NULL, (frames->n + CHUNK - 1) / CHUNK, rotate_chunk, &j);
}
