/* molecules_share.c - what each molecule has of the body's volume, and the link constants fitted to it.
 *
 * The fit: for each molecule the tensor sum_j k_ij L^2 nnnn of its links is to be 12 E V_i / 15 (dd + dd +
 * dd), 15 numbers, their scaling such that products are those of tensors. Sweeps of a weighted projection:
 * each molecule asks of its links the least relative change that gives its tensor (regularised: a corner's
 * few links cannot have it), each link takes the mean of what its two ends ask. Two sweeps: a stretched bar's
 * stiffness, by the strain of its middle half, any direction against the lattice, bars 8 (12) radii wide, is
 * within 5 (3) % of EA, jittered within 8 (6) %; without sweeps up to 36 (28) % too stiff, with many, which
 * bend constants for the corners' sake, up to 9 (10) % too soft. */
#include "molecules.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

enum { SWEEPS = 2, TENSOR = 15 };
static const double FLOOR = 0.1;           /* least share, of the mean */
static const double REGULAR = 1e-3;        /* of the normal equations, relative to the mean of the diagonal */
static const double DONE = 1e-9;           /* relative to the tensor wanted */
static const double LEAST = 0.2, MOST = 4; /* of a constant, relative to the start */

/* Volume samples along x: inside flips with each crossing. */
cn_status cn_packing_share(cn_packing *p, const cn_tree *walls, double volume, const double origin[3],
                           double cell, int whole, cn_nearest nearest, const void *user)
{
    double min[3], max[3], total = 0;
    cn_tree *tree = NULL;
    int *corner = NULL, low[3], high[3];
    cn_status status = cn_point_tree_new(&tree, &corner, p->n, p->place);
    if (status != CN_OK) goto done;
    cn_tree_box(walls, min, max);
    for (int k = 0; k < 3; k++) {
        low[k] = (int)fmax(-1e5, floor((min[k] - origin[k]) / cell) - 1); /* the first lies outside */
        high[k] = (int)fmin(1e5, ceil((max[k] - origin[k]) / cell));
    }
    memset(p->share, 0, (size_t)p->n * sizeof *p->share);
    for (int k = low[2]; k < high[2]; k++)
        for (int j = low[1]; j < high[1]; j++) {
            double at[3], before[3];
            bool inside = false;
            for (int i = low[0]; i < high[0]; i++) {
                const int index[3] = {i, j, k};
                for (int c = 0; c < 3; c++)
                    at[c] = origin[c] + cell * (index[c] + 0.5);
                if (i > low[0] && cn_tree_crossings(walls, before, at) % 2) inside = !inside;
                cn_copy3(at, before);
                if (!inside) continue;
                int owner = nearest ? nearest(user, at) : -1;
                if (owner < 0) cn_tree_nearest(tree, at, INFINITY, &owner, NULL);
                if (owner >= 0) p->share[owner]++, total++;
            }
        }
    const double cube = cell * cell * cell;
    double left = volume, sum = 0;
    for (int i = 0; i < p->n; i++)
        if (p->share[i] == whole)
            left -= p->share[i] = whole * cube;
        else
            sum += p->share[i] = fmax(p->share[i], fmax(1, FLOOR * total / p->n)) * cube;
    /* what the samples miss at the surface belongs to those that lie there */
    const bool apart = left > 0 && sum > 0;
    const double scale = apart ? left / sum : volume / (volume - left + sum);
    for (int i = 0; i < p->n; i++)
        if (!apart || p->share[i] != whole * cube) p->share[i] *= scale;
done:
    cn_tree_free(tree);
    free(corner);
    return status;
}

/* nnnn of a unit vector: component over x^a y^b z^c times the root of 4! / (a! b! c!). */
static void tensor_of(const double n[3], double t[TENSOR])
{
    int at = 0;
    for (int a = 0; a <= 4; a++)
        for (int b = 0; a + b <= 4; b++, at++) {
            static const double factorial[5] = {1, 1, 2, 6, 24};
            const int c = 4 - a - b;
            double value = sqrt(24 / (factorial[a] * factorial[b] * factorial[c]));
            for (int i = 0; i < 4; i++)
                value *= n[i < a ? 0 : i < a + b ? 1 : 2];
            t[at] = value;
        }
}

/* The mean of nnnn over all directions, (dd + dd + dd) / 15, as above. */
static void isotropic(double t[TENSOR])
{
    int at = 0;
    for (int a = 0; a <= 4; a++)
        for (int b = 0; a + b <= 4; b++, at++) {
            const int c = 4 - a - b;
            t[at] = (a | b | c) & 1 ? 0 : a == 4 || b == 4 || c == 4 ? 3.0 / 15 : sqrt(6) / 15;
        }
}

/* Solves A y = b, A positive definite, in place. */
static void solve(double a[TENSOR][TENSOR], double b[TENSOR])
{
    for (int i = 0; i < TENSOR; i++)
        for (int j = 0; j <= i; j++) {
            double s = a[i][j];
            for (int k = 0; k < j; k++)
                s -= a[i][k] * a[j][k];
            a[i][j] = i == j ? sqrt(s) : s / a[j][j];
        }
    for (int i = 0; i < TENSOR; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = TENSOR - 1; i >= 0; i--) {
        for (int k = i + 1; k < TENSOR; k++)
            b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

typedef struct {
    const cn_packing *packing;
    int *start, *mine; /* links of each molecule (n + 1), (2 nlink) */
    double *square;    /* L^2 [m^2]          (nlink)      */
    double *tensor;    /* of directions      (nlink x 15) */
    double *first, *k, *change;
} fit;

/* One molecule's wish: added to the changes of its links; returns the relative error it saw. */
static double wish(fit *f, int i, const double target[TENSOR])
{
    const double whole = 12 * f->packing->share[i];
    double a[TENSOR][TENSOR] = {{0}}, rest[TENSOR], trace = 0, error = 0;
    for (int e = 0; e < TENSOR; e++)
        rest[e] = target[e];
    for (int s = f->start[i]; s < f->start[i + 1]; s++) {
        const int b = f->mine[s];
        for (int e = 0; e < TENSOR; e++)
            rest[e] -= f->k[b] * f->square[b] / whole * f->tensor[TENSOR * (size_t)b + (size_t)e];
    }
    for (int e = 0; e < TENSOR; e++)
        error += rest[e] * rest[e];
    if (!(error > DONE * DONE)) return 0;
    for (int s = f->start[i]; s < f->start[i + 1]; s++) {
        const double *t = f->tensor + TENSOR * (size_t)f->mine[s];
        const double size = f->first[f->mine[s]] * f->square[f->mine[s]] / whole;
        for (int e = 0; e < TENSOR; e++)
            for (int g = 0; g <= e; g++)
                a[e][g] += size * size * t[e] * t[g];
    }
    for (int e = 0; e < TENSOR; e++)
        trace += a[e][e];
    for (int e = 0; e < TENSOR; e++)
        a[e][e] += REGULAR * trace;
    solve(a, rest);
    for (int s = f->start[i]; s < f->start[i + 1]; s++) {
        const int b = f->mine[s];
        const double *t = f->tensor + TENSOR * (size_t)b, size = f->first[b] * f->square[b] / whole;
        double along = 0;
        for (int e = 0; e < TENSOR; e++)
            along += t[e] * rest[e];
        f->change[b] += 0.5 * f->first[b] * size * along;
    }
    return sqrt(error);
}

static cn_status allocate(fit *f)
{
    const size_t n = (size_t)f->packing->n, nlink = (size_t)f->packing->nlink + 1;
    f->start = calloc(n + 2, sizeof *f->start), f->mine = calloc(2 * nlink, sizeof *f->mine);
    f->square = calloc(nlink, sizeof *f->square), f->tensor = calloc(nlink, TENSOR * sizeof *f->tensor);
    f->first = calloc(nlink, sizeof *f->first), f->change = calloc(nlink, sizeof *f->change);
    return f->start && f->mine && f->square && f->tensor && f->first && f->change ? CN_OK : CN_ERR_MEMORY;
}

/* Links by molecule; constants to begin with, which give the trace on the average: shares over L^2. */
static void begin(fit *f)
{
    const cn_packing *p = f->packing;
    for (int c = 0; c < 2 * p->nlink; c++)
        f->start[p->link[c] + 2]++;
    for (int i = 0; i < p->n; i++)
        f->start[i + 2] += f->start[i + 1];
    for (int c = 0; c < 2 * p->nlink; c++)
        f->mine[f->start[p->link[c] + 1]++] = c / 2;
    for (int b = 0; b < p->nlink; b++) {
        const int i = p->link[2 * (size_t)b], j = p->link[2 * (size_t)b + 1];
        const int ni = f->start[i + 1] - f->start[i], nj = f->start[j + 1] - f->start[j];
        double d[3];
        cn_sub(p->place + 3 * (size_t)j, p->place + 3 * (size_t)i, d);
        f->square[b] = cn_norm2(d);
        cn_normalise(d);
        tensor_of(d, f->tensor + TENSOR * (size_t)b);
        f->k[b] = f->first[b] = 6 * (p->share[i] / ni + p->share[j] / nj) / f->square[b];
    }
}

cn_status cn_molecules_fit(const cn_packing *p, double *constant)
{
    fit f = {.packing = p, .k = constant};
    double target[TENSOR], worst = 1, volume = 0, now = 0;
    const cn_status status = allocate(&f);
    if (status != CN_OK) goto done;
    begin(&f);
    isotropic(target);
    for (int sweep = 0; sweep < SWEEPS && worst > 0; sweep++) {
        worst = 0;
        memset(f.change, 0, (size_t)p->nlink * sizeof *f.change);
        for (int i = 0; i < p->n; i++)
            worst = fmax(worst, wish(&f, i, target));
        for (int b = 0; b < p->nlink; b++)
            f.k[b] = fmin(MOST * f.first[b], fmax(LEAST * f.first[b], f.k[b] + f.change[b]));
    }
    for (int i = 0; i < p->n; i++)
        volume += p->share[i];
    for (int b = 0; b < p->nlink; b++)
        now += f.k[b] * f.square[b];
    for (int b = 0; b < p->nlink; b++)
        f.k[b] *= 6 * volume / now;
done:
    free(f.start), free(f.mine), free(f.square), free(f.tensor), free(f.first), free(f.change);
    return status;
}
