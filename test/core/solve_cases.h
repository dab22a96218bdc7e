/* solve_cases.h - swept meshes and their linear elastic matrices, for the tests and the benchmark of the
 * solvers. Bodies are filled by hand: nnode, ntet, tet and rest alone. */
#ifndef SOLVE_CASES_H
#define SOLVE_CASES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "matrix.h"

#define PI 3.14159265358979323846

typedef struct {
    int nnode, ntri;
    double (*xy)[2]; /* (nnode) */
    int (*tri)[3];   /* (ntri)  */
} section;

static inline section section_new(int nnode, int ntri)
{
    return (section){nnode, ntri, malloc(sizeof(double[2]) * (size_t)nnode),
                     malloc(sizeof(int[3]) * (size_t)ntri)};
}

static inline section section_disc(int sides, double radius)
{
    section s = section_new(sides + 1, sides);
    s.xy[0][0] = s.xy[0][1] = 0;
    for (int i = 0; i < sides; i++) {
        s.xy[i + 1][0] = radius * cos(2 * PI * i / sides);
        s.xy[i + 1][1] = radius * sin(2 * PI * i / sides);
        s.tri[i][0] = 0, s.tri[i][1] = 1 + i, s.tri[i][2] = 1 + (i + 1) % sides;
    }
    return s;
}

static inline section section_ring(int sides, double inner, double outer)
{
    section s = section_new(2 * sides, 2 * sides);
    for (int i = 0; i < sides; i++) {
        const int next = (i + 1) % sides;
        for (int k = 0; k < 2; k++) {
            s.xy[2 * i + k][0] = (k ? outer : inner) * cos(2 * PI * i / sides);
            s.xy[2 * i + k][1] = (k ? outer : inner) * sin(2 * PI * i / sides);
        }
        memcpy(s.tri[2 * i], (int[3]){2 * i, 2 * i + 1, 2 * next + 1}, sizeof(int[3]));
        memcpy(s.tri[2 * i + 1], (int[3]){2 * i, 2 * next + 1, 2 * next}, sizeof(int[3]));
    }
    return s;
}

static inline section section_square(int cells, double size)
{
    section s = section_new((cells + 1) * (cells + 1), 2 * cells * cells);
    int t = 0;
    for (int i = 0; i <= cells; i++)
        for (int j = 0; j <= cells; j++) {
            const int a = i * (cells + 1) + j;
            s.xy[a][0] = size * i / cells, s.xy[a][1] = size * j / cells;
            if (i == cells || j == cells) continue;
            memcpy(s.tri[t++], (int[3]){a, a + cells + 1, a + cells + 2}, sizeof(int[3]));
            memcpy(s.tri[t++], (int[3]){a, a + cells + 2, a + 1}, sizeof(int[3]));
        }
    return s;
}

/* Sweeps a section along z (freed): station i's nodes are i * nnode ..; each prism is cut into three
 * tetrahedra along diagonals from its lower to its higher node, so that neighbours agree. */
static inline cn_body body_sweep(section s, int stations, double length)
{
    cn_body body = {.nnode = s.nnode * stations, .ntet = 3 * s.ntri * (stations - 1), .nper = 4};
    body.nblock = body.nnode, body.nelement = body.ntet;
    int t = 0;
    body.tet = malloc(sizeof(int[4]) * (size_t)body.ntet);
    body.connect = body.tet;
    body.rest = malloc(sizeof(double[3]) * (size_t)body.nnode);
    for (int i = 0; i < body.nnode; i++) {
        memcpy(body.rest + 3 * i, s.xy[i % s.nnode], sizeof(double[2]));
        body.rest[3 * i + 2] = length * (i / s.nnode) / (stations - 1);
    }
    for (int k = 0; k + 1 < stations; k++)
        for (int e = 0; e < s.ntri; e++) {
            int v[3], top[3];
            memcpy(v, s.tri[e], sizeof v);
            for (int a = 0; a < 2; a++)
                for (int b = 0; b < 2 - a; b++)
                    if (v[b] > v[b + 1]) {
                        const int swap = v[b];
                        v[b] = v[b + 1], v[b + 1] = swap;
                    }
            for (int a = 0; a < 3; a++) {
                v[a] += k * s.nnode;
                top[a] = v[a] + s.nnode;
            }
            memcpy(body.tet + 4 * t++, (int[4]){v[0], v[1], v[2], top[2]}, sizeof(int[4]));
            memcpy(body.tet + 4 * t++, (int[4]){v[0], v[1], top[1], top[2]}, sizeof(int[4]));
            memcpy(body.tet + 4 * t++, (int[4]){v[0], top[0], top[1], top[2]}, sizeof(int[4]));
        }
    free(s.xy);
    free(s.tri);
    return body;
}

static inline void body_drop(cn_body *body)
{
    free(body->tet);
    free(body->rest);
}

/* Adds linear elastic stiffness [N/m] (Lame constants of young(e), poisson) and lumped mass times `inertia`
 * [1/s^2] to A: K_ab = V (la g_a g_b' + mu g_b g_a' + mu (g_a . g_b) I), g the gradients of the shape
 * functions. */
static inline void add_elastic(cn_matrix *a, const cn_body *body, double (*young)(const cn_body *, int),
                               double poisson, double density, double inertia)
{
    for (int e = 0; e < body->ntet; e++) {
        const int *node = body->tet + 4 * e;
        double d[3][3], g[4][3], c[3][3];
        for (int k = 0; k < 3; k++)
            for (int r = 0; r < 3; r++)
                d[k][r] = body->rest[3 * node[k + 1] + r] - body->rest[3 * node[0] + r];
        for (int k = 0; k < 3; k++)
            for (int r = 0; r < 3; r++)
                c[k][r] = d[(k + 1) % 3][(r + 1) % 3] * d[(k + 2) % 3][(r + 2) % 3] -
                          d[(k + 1) % 3][(r + 2) % 3] * d[(k + 2) % 3][(r + 1) % 3];
        const double det = d[0][0] * c[0][0] + d[0][1] * c[0][1] + d[0][2] * c[0][2], volume = fabs(det) / 6;
        for (int r = 0; r < 3; r++) {
            g[0][r] = 0;
            for (int k = 0; k < 3; k++)
                g[0][r] -= g[k + 1][r] = c[k][r] / det;
        }
        const double stiff = young(body, e), mu = stiff / (2 * (1 + poisson));
        const double la = stiff * poisson / ((1 + poisson) * (1 - 2 * poisson));
        for (int p = 0; p < 4; p++)
            for (int q = 0; q < 4; q++) {
                double *v = a->value + 9 * (size_t)cn_matrix_find(a, node[p], node[q]);
                const double dot = g[p][0] * g[q][0] + g[p][1] * g[q][1] + g[p][2] * g[q][2];
                for (int r = 0; r < 3; r++)
                    for (int s = 0; s < 3; s++)
                        v[3 * r + s] += volume * (la * g[p][r] * g[q][s] + mu * g[q][r] * g[p][s] +
                                                  (r == s) * (mu * dot + (p == q) * density * inertia / 4));
            }
    }
}

#endif
