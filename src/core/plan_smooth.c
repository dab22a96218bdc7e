/* plan_smooth.c - the path as an elastic band inside the lumen.
 *
 * Stations x_i with rest spacings h_i minimise
 *     sum B_i |D_i|^2 / h  +  T |x' |^2  +  w (t - |x_i - q|)_+^2 h  over the wall points q near station i,
 * D_i = (x_{i+1} - x_i)/h_i - (x_i - x_{i-1})/h_{i-1} the turn at i: an elastic rod that is pushed from the
 * wall hard within the device's radius + clearance and softly within one more radius ("comfort"). Wall points
 * are true points of the wall, gathered as the nearest ones of past iterations, so that both sides of a
 * narrow lumen push and the band comes to rest in its middle. Each iteration solves the banded Gauss-Newton
 * system (half bandwidth 6), damped, with the pushes that its own step would meet (a few solves until they
 * stay the same), and moves no station farther than half its clearance: no wall is ever crossed. Lengths
 * inside are in units of the device's radius: results do not depend on the scene's unit. */
#include "plan_smooth.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

enum { NEAR = 8, BAND = 7, ITERATIONS = 80, INNER = 6, ROUNDS = 16, STATIONS_MOST = 20000 };

typedef struct {
    const cn_plan_query *query;
    double unit;                /* [m] */
    double hard, comfort, wide; /* kept distances, in units */
    double hard_weight, comfort_weight, wide_weight, tension;
    bool touch; /* contact sampling: stay at `hard` from the wall */
    int n;
    double *x;            /* stations, in units                        (n x 3) */
    double *h;            /* rest spacing of the segment after i       (n)     */
    double *bend;         /* bending weight                            (n)     */
    double *ease;         /* share of the comfort weight                 (n)     */
    double *clearance;    /* lower bound, kept up to date as i moves   (n)     */
    double *near;         /* wall points                               (n x NEAR x 3) */
    int *nnear;           /* filled of them; the oldest is replaced    (n)     */
    int *newest;          /*                                           (n)     */
    bool *held;           /*                                           (n)     */
    unsigned *active;     /* which pushes were on in the last solve */
    int npoint, *station; /* station of each point of the query        (npoint) */
    double *matrix;       /* lower band, row major                     (3 n x BAND) */
    double *move;         /* right-hand side, then the step            (3 n)   */
    double *step;         /* the step foreseen (3 n) */
} band;

#define AHEAD 3.0 /* wall points are gathered this much beyond comfort [units] */

static void band_clear(band *b)
{
    free(b->x), free(b->h), free(b->bend), free(b->ease), free(b->clearance), free(b->near), free(b->nnear),
        free(b->newest);
    free(b->held), free(b->active), free(b->step), free(b->station), free(b->matrix), free(b->move);
}

static cn_status band_alloc(band *b, int n, int npoint)
{
    const size_t m = (size_t)n;
    b->n = n;
    b->npoint = npoint;
    b->x = calloc(3 * m, sizeof(double));
    b->h = calloc(m, sizeof(double));
    b->bend = calloc(m, sizeof(double));
    b->ease = calloc(m, sizeof(double));
    b->clearance = calloc(m, sizeof(double));
    b->near = calloc(3 * NEAR * m, sizeof(double));
    b->nnear = calloc(m, sizeof(int));
    b->newest = calloc(m, sizeof(int));
    b->held = calloc(m, sizeof(bool));
    b->active = calloc(m, sizeof(unsigned));
    b->step = calloc(3 * m, sizeof(double));
    b->station = calloc((size_t)npoint, sizeof(int));
    b->matrix = calloc(3 * BAND * m, sizeof(double));
    b->move = calloc(3 * m, sizeof(double));
    return b->x && b->h && b->bend && b->ease && b->clearance && b->near && b->nnear && b->newest &&
                   b->held && b->active && b->step && b->station && b->matrix && b->move
               ? CN_OK
               : CN_ERR_MEMORY;
}

/* A point at arc length s along the polyline x (n x 3), searching on from *i with arc length *at. */
static void along(const double *x, int n, double s, int *i, double *at, double p[3])
{
    double l = cn_distance(x + 3 * *i, x + 3 * *i + 3);
    while (*i + 2 < n && *at + l < s) {
        *at += l;
        ++*i;
        l = cn_distance(x + 3 * *i, x + 3 * *i + 3);
    }
    const double t = l > 0 ? fmin(1, (s - *at) / l) : 0;
    for (int k = 0; k < 3; k++)
        p[k] = x[3 * *i + k] + t * (x[3 * *i + 3 + k] - x[3 * *i + k]);
}

static double length_of(const double *x, int n)
{
    double length = 0;
    for (int i = 0; i + 1 < n; i++)
        length += cn_distance(x + 3 * i, x + 3 * i + 3);
    return length;
}

/* Segments for a leg of this length [m]: half a device diameter each, at least 64 in all, bounded in number.
 */
static int segments_of(const cn_plan_query *query, double leg, double total)
{
    const double cell = cn_map_cell(query->world->map);
    double h = query->device_diameter > 0 ? 0.5 * query->device_diameter : cell;
    h = fmax(fmin(h, total / 64), total / STATIONS_MOST);
    return leg > h ? (int)ceil(leg / h) : 1;
}

static cn_status band_new(band *b, const cn_plan_query *query, const cn_roadmap *roadmap)
{
    const cn_path_spec *spec = query->spec;
    const double need = query->radius + spec->clearance, total = length_of(roadmap->x, roadmap->npoint);
    cn_status status;
    int n = 1;

    memset(b, 0, sizeof *b);
    b->query = query;
    b->unit = query->radius > 0 ? query->radius : need > 0 ? need : cn_map_cell(query->world->map);
    b->hard = 1.03 * need / b->unit;
    b->comfort = b->hard + 1.0;
    b->hard_weight = 1e3;
    b->comfort_weight = 0.1;
    b->tension = spec->cost == CN_COST_LENGTH ? 1e-4 : 1e-6;
    b->touch = spec->sampling == CN_SAMPLING_CONTACT;
    if (b->touch) b->comfort = b->hard;
    b->wide = b->comfort;
    if (spec->cost == CN_COST_CLEARANCE)
        for (int i = 0; i < roadmap->npoint; i++)
            b->wide = fmax(b->wide, 1.5 * cn_map_clearance(query->world->map, roadmap->x + 3 * i) / b->unit);
    b->wide_weight = 0.03 / fmax(1, (b->wide - b->hard) * (b->wide - b->hard));

    for (int pass = 0; pass < 2; pass++) { /* count, then fill */
        n = 1;
        for (int first = 0, leg = 1; leg < query->npoint; leg++) {
            int last = first;
            while (last + 1 < roadmap->npoint && roadmap->leg[last + 1] <= leg)
                last++;
            const double length = last > first ? length_of(roadmap->x + 3 * first, last - first + 1) : 0;
            const int m = length > 0 ? segments_of(query, length, total) : 0;
            if (pass == 1) {
                double at = 0;
                for (int i = 1, seg = 0; i <= m; i++) {
                    double *p = b->x + 3 * (n - 1 + i);
                    along(roadmap->x + 3 * first, last - first + 1, length * i / m, &seg, &at, p);
                    if (i == m) cn_copy3(query->point + 3 * leg, p);
                    for (int k = 0; k < 3; k++)
                        p[k] /= b->unit;
                }
                b->station[leg] = n - 1 + m;
            }
            n += m;
            first = last;
        }
        if (n < 2) return CN_ERR_ARG;
        if (pass == 0 && (status = band_alloc(b, n, query->npoint)) != CN_OK) return status;
        if (pass == 0)
            for (int k = 0; k < 3; k++)
                b->x[k] = query->point[k] / b->unit;
    }
    for (int i = 0; i < b->n; i++)
        b->bend[i] = b->ease[i] = 1;
    for (int i = 0; i < b->npoint; i++)
        b->held[b->station[i]] = true;
    return CN_OK;
}

/* Rest spacings: even within each leg. */
static void measure(band *b)
{
    for (int leg = 1; leg < b->npoint; leg++) {
        const int first = b->station[leg - 1], last = b->station[leg];
        const double h = last > first ? length_of(b->x + 3 * first, last - first + 1) / (last - first) : 0;
        for (int i = first; i < last; i++)
            b->h[i] = h;
    }
}

/* The second station lies along the start's direction where there is room for it. */
static void aim(band *b)
{
    const double *d = b->query->direction;
    if (!d || b->held[1]) return;
    double p[3], q[3];
    for (int k = 0; k < 3; k++)
        q[k] = (p[k] = b->x[k] + b->h[0] * d[k]) * b->unit;
    if (!(cn_plan_clearance(b->query, q, b->hard * b->unit) >= b->hard * b->unit)) return;
    cn_copy3(p, b->x + 3);
    b->held[1] = true;
    b->clearance[1] = -1;
}

/* Stations spread evenly over each leg again. */
static cn_status spread(band *b)
{
    double *old = malloc(3 * (size_t)b->n * sizeof *old);
    if (!old) return CN_ERR_MEMORY;
    memcpy(old, b->x, 3 * (size_t)b->n * sizeof *old);
    for (int leg = 1; leg < b->npoint; leg++) {
        const int first = b->station[leg - 1], m = b->station[leg] - first;
        const double length = length_of(old + 3 * first, m + 1);
        double at = 0;
        for (int i = 1, seg = 0; i < m; i++) {
            if (b->held[first + i]) continue;
            along(old + 3 * first, m + 1, length * i / m, &seg, &at, b->x + 3 * (first + i));
            b->clearance[first + i] = -1; /* look again: its wall points are others' now */
            b->nnear[first + i] = 0;
        }
    }
    free(old);
    return CN_OK;
}

/* Keeps wall point q [units] of station i: in the place of one on the same side, else of the oldest. */
static void keep(band *b, int i, const double q[3])
{
    double *near = b->near + 3 * NEAR * i;
    int slot = -1;
    for (int j = 0; j < b->nnear[i] && slot < 0; j++)
        if (cn_distance(near + 3 * j, q) < 0.3 * b->hard) slot = j;
    if (slot < 0) slot = b->nnear[i] < NEAR ? b->nnear[i]++ : (b->newest[i] + 1) % NEAR;
    b->newest[i] = slot;
    cn_copy3(q, near + 3 * slot);
}

/* Distance from p to the walls and the nearest point q, all in units. */
static double nearest(const band *b, const double p[3], double q[3])
{
    const double metres[3] = {p[0] * b->unit, p[1] * b->unit, p[2] * b->unit};
    cn_copy3(metres, q);
    const double d = cn_world_distance(b->query->world, metres, NULL, NULL, q) / b->unit;
    for (int k = 0; k < 3; k++)
        q[k] /= b->unit;
    return d;
}

/* The other sides of a narrow place: nearest wall points from beyond station i, away from q and to both
 * hands. */
static void probe(band *b, int i, const double q[3])
{
    const int before = i > 0 ? i - 1 : i, after = i + 1 < b->n ? i + 1 : i;
    double away[3], tangent[3], side[3], p[3], other[3];
    cn_sub(b->x + 3 * after, b->x + 3 * before, tangent);
    cn_sub(b->x + 3 * i, q, away);
    const double c = cn_normalise(away);
    cn_cross(tangent, away, side);
    cn_normalise(side);
    for (int k = 0; k < 3; k++) {
        cn_copy3(b->x + 3 * i, p);
        cn_axpy(k == 2 ? -0.7 * c : 0.7 * c, k == 0 ? away : side, p);
        if (nearest(b, p, other) < b->wide + AHEAD) keep(b, i, other);
    }
}

/* Nearest wall point of every station that may have come within comfort since it was last asked. */
static void look(band *b, bool probing)
{
    const double enough = b->wide + AHEAD;
    for (int i = 0; i < b->n; i++) {
        double q[3];
        if (b->clearance[i] > enough) continue;
        const double p[3] = {b->x[3 * i] * b->unit, b->x[3 * i + 1] * b->unit, b->x[3 * i + 2] * b->unit};
        const double bound = b->touch ? 0 : cn_map_clearance(b->query->world->map, p) / b->unit;
        if (bound > enough) {
            b->clearance[i] = bound;
            continue;
        }
        b->clearance[i] = nearest(b, b->x + 3 * i, q);
        if (!(b->clearance[i] <= enough || b->touch) || !isfinite(b->clearance[i])) continue;
        keep(b, i, q);
        if (probing && !b->touch) probe(b, i, q);
    }
}

/* Adds w (n . dx - gap)^2 at station i. */
static void add_push(band *b, int i, double w, const double n[3], double gap)
{
    for (int r = 0; r < 3; r++) {
        b->move[3 * i + r] += w * gap * n[r];
        for (int c = 0; c <= r; c++)
            b->matrix[(3 * i + r) * BAND + BAND - 1 - (r - c)] += w * n[r] * n[c];
    }
}

static void add_damping(band *b, int i, double w)
{
    for (int r = 3 * i; r < 3 * i + 3; r++)
        b->matrix[r * BAND + BAND - 1] += w;
}

/* Adds w |sum_j a_j x_{i+j}|^2 over m consecutive stations. */
static void add_stencil(band *b, int i, int m, const double *a, double w)
{
    for (int k = 0; k < 3; k++) {
        double sum = 0;
        for (int j = 0; j < m; j++)
            sum += a[j] * b->x[3 * (i + j) + k];
        for (int r = 0; r < m; r++) {
            b->move[3 * (i + r) + k] -= w * a[r] * sum;
            for (int c = 0; c <= r; c++)
                b->matrix[(3 * (i + r) + k) * BAND + BAND - 1 - 3 * (r - c)] += w * a[r] * a[c];
        }
    }
}

/* The system whose solution is the step. A push counts where the step foreseen (b->step) would come too near;
 * `damping` holds every station to its place. False when the same pushes are on as in the last call. */
static bool assemble(band *b, double damping)
{
    const cn_plan_query *query = b->query;
    const double *x = b->x;
    const int n = b->n;
    bool changed = false;

    memset(b->matrix, 0, 3 * BAND * (size_t)n * sizeof(double));
    memset(b->move, 0, 3 * (size_t)n * sizeof(double));
    for (int i = 0; i + 1 < n; i++)
        add_stencil(b, i, 2, (const double[2]){-1, 1}, b->tension / b->h[i]);
    for (int i = 1; i + 1 < n; i++) {
        const double f = 1 / b->h[i - 1], g = 1 / b->h[i];
        add_stencil(b, i - 1, 3, (const double[3]){f, -f - g, g}, b->bend[i] * 2 / (b->h[i - 1] + b->h[i]));
    }
    for (int i = 0; i < n; i++) {
        const double h = i + 1 < n ? b->h[i] : b->h[n - 2], *near = b->near + 3 * NEAR * i;
        double t[3], p[3], d[3];
        unsigned active = 0;
        cn_sub(x + 3 * (i + 1 < n ? i + 1 : i), x + 3 * (i > 0 ? i - 1 : i), t);
        cn_normalise(t);
        for (int j = 0; j < b->nnear[i]; j++) { /* across the path only: walls do not push along it */
            cn_sub(x + 3 * i, near + 3 * j, d);
            const double c = cn_norm(d), slid = cn_dot(d, t);
            if (fabs(slid) > 0.5 * c) continue; /* left behind */
            cn_axpy(-slid, t, d);
            cn_normalise(d);
            const double foreseen = c + cn_dot(d, b->step + 3 * i);
            if (foreseen < b->hard) {
                add_push(b, i, h * b->hard_weight, d, b->hard - c);
                active |= 1u << j;
            }
            if (foreseen < b->comfort || (b->touch && j == b->newest[i])) {
                add_push(b, i, h * b->ease[i] * b->comfort_weight, d, fmax(-1, b->comfort - c));
                active |= 1u << (NEAR + j);
            }
            if (foreseen < b->wide && b->wide > b->comfort) {
                add_push(b, i, h * b->ease[i] * b->wide_weight, d, b->wide - c);
                active |= 1u << (2 * NEAR + j);
            }
        }
        add_damping(b, i, h * damping);
        changed = changed || active != b->active[i];
        b->active[i] = active;
        for (int j = 0; j < query->nrefused; j++) {
            const double radius = 1.03 * query->refused[j].radius / b->unit + 0.1;
            for (int k = 0; k < 3; k++)
                d[k] = x[3 * i + k] - query->refused[j].centre[k] / b->unit;
            const double c = cn_normalise(d);
            if (c < radius) add_push(b, i, h * b->hard_weight, d, radius - c);
        }
        if (query->spec->region != CN_REGION_NONE) {
            for (int k = 0; k < 3; k++)
                p[k] = x[3 * i + k] * b->unit;
            const double outside = cn_plan_region(query, p, d) / b->unit;
            if (outside > 0 && isfinite(outside)) add_push(b, i, h, d, outside);
        }
    }
    for (int i = 0; i < n; i++) {
        if (!b->held[i]) continue;
        for (int r = 3 * i; r < 3 * i + 3; r++) {
            for (int c = 0; c < BAND; c++)
                b->matrix[r * BAND + c] = c == BAND - 1;
            for (int below = r + 1; below < r + BAND && below < 3 * n; below++)
                b->matrix[below * BAND + BAND - 1 - (below - r)] = 0;
            b->move[r] = 0;
        }
    }
    return changed;
}

/* Cholesky of the band in place, then both triangular solves. False where it is not positive definite. */
static bool solve(band *b)
{
    const int n = 3 * b->n;
    for (int i = 0; i < n; i++) {
        double *row = b->matrix + i * BAND; /* row[BAND - 1 - k] is entry (i, i - k) */
        for (int j = i - BAND + 1 > 0 ? i - BAND + 1 : 0; j <= i; j++) {
            const double *other = b->matrix + j * BAND;
            double sum = row[BAND - 1 - (i - j)];
            for (int k = i - BAND + 1 > 0 ? i - BAND + 1 : 0; k < j; k++)
                if (j - k < BAND) sum -= row[BAND - 1 - (i - k)] * other[BAND - 1 - (j - k)];
            if (j < i) {
                row[BAND - 1 - (i - j)] = sum / other[BAND - 1];
            } else {
                if (!(sum > 0)) return false;
                row[BAND - 1] = sqrt(sum);
            }
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 1; k < BAND && k <= i; k++)
            b->move[i] -= b->matrix[i * BAND + BAND - 1 - k] * b->move[i - k];
        b->move[i] /= b->matrix[i * BAND + BAND - 1];
    }
    for (int i = n; i-- > 0;) {
        for (int k = 1; k < BAND && i + k < n; k++)
            b->move[i] -= b->matrix[(i + k) * BAND + BAND - 1 - k] * b->move[i + k];
        b->move[i] /= b->matrix[i * BAND + BAND - 1];
    }
    return true;
}

/* Up to `most` iterations; `even` spreads the stations now and then while the band is still far from rest. */
static cn_status relax(band *b, int most, bool even)
{
    double damping = even ? 0.3 : 0.01;
    cn_status status;
    for (int iteration = 0; iteration < most; iteration++) {
        double farthest = 0, beyond = 0;
        if (cn_cancelled(b->query->cancel)) return CN_ERR_CANCELLED;
        if (even && iteration > 0 && iteration + 10 < most && iteration % 6 == 0) {
            if ((status = spread(b)) != CN_OK) return status;
            measure(b);
        }
        look(b, iteration % 6 == 0);
        memset(b->step, 0, 3 * (size_t)b->n * sizeof *b->step);
        for (int inner = 0; inner < INNER && (assemble(b, damping) || inner == 0); inner++) {
            if (!solve(b)) return CN_OK; /* the band stays as it is: checked by the caller */
            memcpy(b->step, b->move, 3 * (size_t)b->n * sizeof *b->step);
        }
        /* trust half the clearance, at most two units: beyond it the whole step is shortened and damped more
         */
        for (int i = 0; i < b->n; i++)
            beyond =
                fmax(beyond, cn_norm(b->step + 3 * i) / fmin(2, 0.5 * fmax(b->clearance[i], 0.05 * b->hard)));
        for (int i = 0; i < b->n; i++) {
            const double d = cn_norm(b->step + 3 * i) / fmax(1, beyond);
            cn_axpy(1 / fmax(1, beyond), b->step + 3 * i, b->x + 3 * i);
            b->clearance[i] -= d;
            farthest = fmax(farthest, d);
        }
        damping = beyond > 1 ? 4 * damping : beyond < 0.5 ? fmax(0.6 * damping, 1e-6) : damping;
        if (farthest < 1e-4 * b->hard) break;
    }
    return CN_OK;
}

/* The band as a path [m]. */
static cn_status to_path(cn_path **out, const band *b, double *metres)
{
    const cn_plan_query *query = b->query;
    for (int i = 0; i < 3 * b->n; i++)
        metres[i] = b->x[i] * b->unit;
    for (int i = 0; i < b->npoint; i++)
        cn_copy3(query->point + 3 * i, metres + 3 * b->station[i]);
    return cn_path_new(out, b->n, metres, b->npoint - 1, b->station + 1, NULL);
}

cn_status cn_plan_smooth(cn_path **out, const cn_plan_query *query, const cn_roadmap *roadmap,
                         cn_error *error)
{
    const double limit = 0.97 * query->spec->max_turn, chord = cn_plan_chord(query);
    double *metres = NULL, *clearance = NULL, best_turn = INFINITY;
    cn_path *best = NULL, *path = NULL;
    bool *broken = NULL;
    cn_status status;
    band b;

    if ((status = band_new(&b, query, roadmap)) != CN_OK) goto done;
    metres = malloc(3 * (size_t)b.n * sizeof *metres);
    clearance = malloc((size_t)b.n * sizeof *clearance);
    broken = malloc((size_t)b.n * sizeof *broken);
    if (!metres || !clearance || !broken) {
        status = CN_ERR_MEMORY;
        goto done;
    }
    measure(&b);
    if ((status = to_path(&best, &b, metres)) != CN_OK)
        goto done; /* the polyline itself: safe, but with kinks */
    aim(&b);

    /* relax; where the band still breaks the clearance push harder, where it turns too much bend less */
    for (int round = 0; round < ROUNDS; round++) {
        double where = 0;
        if ((status = relax(&b, round == 0 ? ITERATIONS : ITERATIONS / 4, round == 0)) != CN_OK) goto done;
        if ((status = to_path(&path, &b, metres)) != CN_OK) goto done;
        if (!cn_plan_keeps(query, b.n, metres, clearance, broken)) {
            b.hard_weight *= 2;
            for (int i = 0; i + 1 < b.n; i++)
                for (int j = i > 3 ? i - 3 : 0; broken[i] && j < b.n && j < i + 5; j++)
                    b.clearance[j] = -1, b.ease[j] *= 0.7; /* look again; what the device likes yields */
            cn_path_free(path);
            path = NULL;
            continue;
        }
        const double turn = cn_path_turn(path, chord, &where);
        if (turn < best_turn) {
            cn_path_free(best);
            best = path;
            best_turn = turn;
        } else {
            cn_path_free(path);
        }
        path = NULL;
        if (turn <= limit) break;
        const double reach = 2 * chord / b.unit;
        double s = 0;
        for (int i = 0; i < b.n; s += b.h[i++])
            if (fabs(s - where / b.unit) <= reach) b.bend[i] *= 2, b.ease[i] *= 0.25;
    }
    if (best_turn == INFINITY)
        CN_LOG(CN_LOG_WARNING,
               "no smooth path keeps the clearance: the roadmap's polyline is followed as it is");
    *out = best;
    best = NULL;
done:
    if (status == CN_ERR_CANCELLED) cn_fail(error, status, NULL, 0, "cancelled while the path was smoothed");
    if (status == CN_ERR_MEMORY) cn_fail(error, status, NULL, 0, "out of memory while the path was smoothed");
    if (status == CN_ERR_ARG) cn_fail(error, status, NULL, 0, "all waypoints coincide with the start");
    cn_path_free(path);
    cn_path_free(best);
    free(metres);
    free(clearance);
    free(broken);
    band_clear(&b);
    return status;
}
