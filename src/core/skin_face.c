/* skin_face.c - normals of faces and vertices, and how sharp the edges between faces are. */
#include "skin_parts.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "pool.h"

typedef struct {
    const cn_skin *skin;
    cn_skin_state *state;
} measure;

/* Makes a unit vector and returns the old length; zero, or next to it, becomes zero. One division. */
static inline double unit(double a[3])
{
    const double length = cn_norm(a), by = length >= DBL_MIN ? 1 / length : 0;
    a[0] *= by, a[1] *= by, a[2] *= by;
    return length;
}

static void faces(void *user, int chunk)
{
    const measure *job = user;
    const int last =
        (chunk + 1) * CN_SKIN_CHUNK < job->skin->ntri ? (chunk + 1) * CN_SKIN_CHUNK : job->skin->ntri;
    for (size_t t = (size_t)chunk * CN_SKIN_CHUNK; t < (size_t)last; t++) {
        const int *corner = job->skin->tri + 3 * t;
        const double *a = job->state->x + 3 * (size_t)corner[0], *b = job->state->x + 3 * (size_t)corner[1],
                     *c = job->state->x + 3 * (size_t)corner[2];
        double u[3], v[3], n[3], *out = job->state->face + 4 * t;
        cn_sub(b, a, u), cn_sub(c, a, v);
        cn_cross(u, v, n);
        out[3] = 0.5 * unit(n);
        cn_copy3(n, out);
    }
}

static void vertices(void *user, int chunk)
{
    const measure *job = user;
    const cn_skin *skin = job->skin;
    const int last = (chunk + 1) * CN_SKIN_CHUNK < skin->nvert ? (chunk + 1) * CN_SKIN_CHUNK : skin->nvert;
    for (int v = chunk * CN_SKIN_CHUNK; v < last; v++) {
        double sum[3] = {0};
        for (int i = skin->first[v]; i < skin->first[v + 1]; i++) {
            const double *face = job->state->face + 4 * (size_t)skin->around[i];
            cn_axpy(face[3], face, sum);
        }
        unit(sum);
        cn_copy3(sum, job->state->normal + 3 * (size_t)v);
    }
}

void cn_skin_normals(const cn_skin *skin, cn_skin_state *state, cn_pool *pool)
{
    measure job = {skin, state};
    cn_pool_run(pool, (skin->ntri + CN_SKIN_CHUNK - 1) / CN_SKIN_CHUNK, faces, &job);
    cn_pool_run(pool, (skin->nvert + CN_SKIN_CHUNK - 1) / CN_SKIN_CHUNK, vertices, &job);
}

cn_status cn_skin_sharpest(const cn_skin *skin, const cn_skin_state *state, double *angle)
{
    const int n = 3 * skin->ntri;
    cn_facet *edge = cn_array((size_t)n, sizeof *edge);
    cn_status status = CN_ERR_MEMORY;
    *angle = 0;
    if (!edge) return status;
    for (int c = 0; c < n; c++)
        edge[c] = cn_facet_edge(skin->tri[c], skin->tri[c % 3 == 2 ? c - 2 : c + 1], c / 3);
    if ((status = cn_facet_sort(skin->nvert, n, edge)) != CN_OK) goto done;
    for (int i = 0, end; i < n; i = end) {
        end = cn_facet_run(n, edge, i);
        for (int j = i + 1; j < end; j++) {
            const double *a = state->face + 4 * (size_t)edge[j - 1].item,
                         *b = state->face + 4 * (size_t)edge[j].item;
            double across[3];
            if (!(a[3] > 0 && b[3] > 0)) continue;
            cn_cross(a, b, across);
            *angle = fmax(*angle, atan2(cn_norm(across), cn_dot(a, b)));
        }
    }
done:
    free(edge);
    return status;
}
