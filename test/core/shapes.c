#include "shapes.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include "catnav/vec3.h"

double shape_random(unsigned *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (*seed >> 8) / 8388608.0 - 1;
}

void shape_rotation(unsigned *seed, double r[9])
{
    double w[3];
    for (int i = 0; i < 3; i++)
        w[i] = 3 * shape_random(seed);
    cn_rotation(w, r);
}

static cn_tets *make(int nnode, int ntet)
{
    cn_tets *tets;
    assert_int_equal(cn_tets_new(&tets, nnode, ntet), CN_OK);
    return tets;
}

void shape_put(cn_tets *tets, int i, int a, int b, int c, int d)
{
    int *t = tets->tet + 4 * i;
    double e[9];
    t[0] = a, t[1] = b, t[2] = c, t[3] = d;
    for (int k = 0; k < 3; k++)
        cn_sub(tets->node + 3 * t[1 + k], tets->node + 3 * a, e + 3 * k);
    if (cn_det(e) < 0) t[2] = d, t[3] = c;
}

cn_tets *shape_tet(double size)
{
    cn_tets *tets = make(4, 1);
    for (int i = 0; i < 3; i++)
        tets->node[3 * (i + 1) + i] = size;
    shape_put(tets, 0, 0, 1, 2, 3);
    return tets;
}

cn_tets *shape_box(int nx, int ny, int nz, double h)
{
    static const int kuhn[6][4] = {{0, 1, 3, 7}, {0, 1, 7, 5}, {0, 5, 7, 4},
                                   {0, 3, 2, 7}, {0, 6, 4, 7}, {0, 2, 6, 7}};
    cn_tets *tets = make((nx + 1) * (ny + 1) * (nz + 1), 6 * nx * ny * nz);
    unsigned seed = 7;
    int n = 0, e = 0;
    for (int i = 0; i <= nx; i++)
        for (int j = 0; j <= ny; j++)
            for (int k = 0; k <= nz; k++, n++) {
                const bool inside = i > 0 && i < nx && j > 0 && j < ny && k > 0 && k < nz;
                const int at[3] = {i, j, k};
                for (int d = 0; d < 3; d++)
                    tets->node[3 * n + d] = h * (at[d] + (inside ? 0.2 * shape_random(&seed) : 0));
            }
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++)
            for (int k = 0; k < nz; k++) {
                int c[8];
                for (int b = 0; b < 8; b++)
                    c[b] = ((i + (b & 1)) * (ny + 1) + j + (b >> 1 & 1)) * (nz + 1) + k + (b >> 2 & 1);
                for (int t = 0; t < 6; t++)
                    shape_put(tets, e++, c[kuhn[t][0]], c[kuhn[t][1]], c[kuhn[t][2]], c[kuhn[t][3]]);
            }
    return tets;
}

cn_tets *shape_chain(int stations, int sides, double spacing, double radius)
{
    const int m = sides + 1;
    cn_tets *tets = make(stations * m, 3 * sides * (stations - 1));
    int e = 0;
    for (int s = 0; s < stations; s++)
        for (int k = 0; k < m; k++) {
            const double angle = 2 * 3.14159265358979323846 * (k - 1) / sides;
            double *p = tets->node + 3 * (s * m + k);
            p[0] = k ? radius * cos(angle) : 0, p[1] = k ? radius * sin(angle) : 0, p[2] = -spacing * s;
        }
    for (int s = 0; s + 1 < stations; s++)
        for (int k = 1; k <= sides; k++) {
            const int next = k % sides + 1, a = s * m, b = a + (k < next ? k : next),
                      c = a + (k < next ? next : k);
            shape_put(tets, e++, a, b, c, c + m);
            shape_put(tets, e++, a, b, b + m, c + m);
            shape_put(tets, e++, a, a + m, b + m, c + m);
        }
    return tets;
}

FILE *reference_open(const char *name)
{
    char path[4096];
    const char *folder = getenv("CATNAV_REFERENCE");
    snprintf(path, sizeof path, "%s/%s", folder && *folder ? folder : CATNAV_TEST_DATA "/reference", name);
    return fopen(path, "r");
}

cn_tets *reference_mesh(const char *name)
{
    char path[256];
    int nnode, ntet;
    snprintf(path, sizeof path, "meshes/%s.txt", name);
    FILE *file = reference_open(path);
    if (!file) return NULL;
    assert_int_equal(fscanf(file, "nodes %d", &nnode), 1);
    double *node = calloc(3 * (size_t)nnode, sizeof *node);
    assert_non_null(node);
    for (int i = 0; i < 3 * nnode; i++)
        assert_int_equal(fscanf(file, "%lf", node + i), 1);
    assert_int_equal(fscanf(file, " tets %d", &ntet), 1);
    cn_tets *tets = make(nnode, ntet);
    memcpy(tets->node, node, 3 * (size_t)nnode * sizeof *node);
    free(node);
    for (int i = 0; i < 4 * ntet; i++)
        assert_int_equal(fscanf(file, "%d", tets->tet + i), 1);
    fclose(file);
    return tets;
}
