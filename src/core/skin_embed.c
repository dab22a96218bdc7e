/* skin_embed.c - vertices of a surface in the tetrahedra they lie in.
 *
 * Of all faces the nearest to a vertex is one of the tetrahedron that holds it, or where none does, of the
 * nearest one: from inside no other face can be reached without a passage through the own ones. So a tree
 * over the faces, each once, leaves two tetrahedra to choose from. */
#include "skin_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "mesh_parts.h"
#include "molecules.h"
#include "pool.h"
#include "tree.h"

/* Faces of tetrahedra with a volume, each once; item = tetrahedron. */
typedef struct {
    const cn_tets *tets;
    int nface;
    int *tri;      /* (nface x 3) */
    int (*tet)[2]; /* of one or two tetrahedra, -1: none */
    cn_tree *tree;
} faces;

static const double *node_of(const cn_tets *tets, int tet, int corner)
{
    return tets->node + 3 * (size_t)tets->tet[4 * (size_t)tet + (size_t)corner];
}

/* Barycentric coordinates of p; false for a tetrahedron without volume. */
static bool barycentric(const cn_tets *tets, int tet, const double p[3], double b[4])
{
    double e[3][3], d[3], normal[3];
    cn_sub(p, node_of(tets, tet, 0), d);
    for (int k = 0; k < 3; k++)
        cn_sub(node_of(tets, tet, k + 1), node_of(tets, tet, 0), e[k]);
    cn_cross(e[0], e[1], normal);
    const double volume = cn_dot(normal, e[2]);
    b[0] = 1;
    for (int k = 0; k < 3; k++) {
        cn_cross(e[(k + 1) % 3], e[(k + 2) % 3], normal);
        b[k + 1] = cn_dot(normal, d) / volume;
        b[0] -= b[k + 1];
    }
    return isfinite(b[0]) && isfinite(b[1]) && isfinite(b[2]) && isfinite(b[3]);
}

static double least(const double b[4])
{
    return fmin(fmin(b[0], b[1]), fmin(b[2], b[3]));
}

/* Shape functions at b, continued linearly from `from`, which lies in the tetrahedron: of second order
 * N_a = b_a (2 b_a - 1), N_ab = 4 b_a b_b. */
static void shape_functions(bool second, const double b[4], const double from[4], double *weight)
{
    static const int edge[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
    if (!second) {
        memcpy(weight, b, 4 * sizeof *b);
        return;
    }
    for (int a = 0; a < 4; a++)
        weight[a] = from[a] * (2 * from[a] - 1) + (4 * from[a] - 1) * (b[a] - from[a]);
    for (int e = 0; e < 6; e++) {
        const int i = edge[e][0], j = edge[e][1];
        weight[4 + e] = 4 * (from[i] * from[j] + from[i] * (b[j] - from[j]) + from[j] * (b[i] - from[i]));
    }
}

static void drop(faces *f)
{
    cn_tree_free(f->tree);
    free(f->tri);
    free(f->tet);
}

static cn_status find_faces(faces *f, cn_error *error)
{
    static const int face_of[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    const cn_tets *tets = f->tets;
    cn_facet *face = cn_array((size_t)tets->ntet * 4, sizeof *face);
    cn_status status = CN_ERR_MEMORY;
    double b[4];
    int n = 0;

    f->tri = cn_array((size_t)tets->ntet * 12, sizeof *f->tri);
    f->tet = cn_array((size_t)tets->ntet * 4, sizeof *f->tet);
    if (!face || !f->tri || !f->tet) goto done;
    for (int t = 0; t < tets->ntet; t++) {
        const int *corner = tets->tet + 4 * (size_t)t;
        if (!barycentric(tets, t, node_of(tets, t, 0), b)) continue;
        for (int i = 0; i < 4; i++)
            face[n++] = cn_facet_face(corner[face_of[i][0]], corner[face_of[i][1]], corner[face_of[i][2]], t);
    }
    if (n == 0) {
        status = cn_fail(error, CN_FAULT_DEGENERATE, "", 0,
                         "none of the %d tetrahedra under the skin has a volume", tets->ntet);
        goto done;
    }
    if ((status = cn_facet_sort(tets->nnode, n, face)) != CN_OK) goto done;
    for (int i = 0, end; i < n; i = end, f->nface++) {
        end = cn_facet_run(n, face, i);
        memcpy(f->tri + 3 * (size_t)f->nface, face[i].key, sizeof face[i].key);
        f->tet[f->nface][0] = face[i].item, f->tet[f->nface][1] = end - i > 1 ? face[i + 1].item : -1;
    }
    status = cn_tree_new(&f->tree, f->nface, f->tri, tets->node);
done:
    free(face);
    return status;
}

/* The tetrahedron of p, p's coordinates in it, and how far outside p lies. */
static int tetrahedron_of(const faces *f, const double p[3], double b[4], double from[4], double *outside)
{
    int face, tet = -1;
    double nearest[3], other[4];
    *outside = cn_tree_nearest(f->tree, p, INFINITY, &face, nearest);
    if (face < 0) return -1;
    for (int i = 0; i < 2 && f->tet[face][i] >= 0; i++) {
        barycentric(f->tets, f->tet[face][i], p, other);
        if (tet >= 0 && least(other) <= least(b)) continue;
        tet = f->tet[face][i];
        memcpy(b, other, sizeof other);
    }
    memcpy(from, b, sizeof other);
    if (least(b) >= 0)
        *outside = 0;
    else
        barycentric(f->tets, tet, nearest, from);
    return tet;
}

static cn_status check_tets(const cn_tets *tets, cn_error *error)
{
    for (size_t i = 0; i < 3 * (size_t)tets->nnode; i++)
        if (!isfinite(tets->node[i]))
            return cn_fail(error, CN_ERR_NOT_FINITE, "", 0, "node %zu under the skin lies at %g: give metres",
                           i / 3, tets->node[i]);
    for (int second = 0; second < 2; second++) {
        const int *list = second ? tets->mid : tets->tet, per = second ? 6 : 4;
        for (size_t i = 0; list && i < (size_t)per * (size_t)tets->ntet; i++)
            if (list[i] < 0 || list[i] >= tets->nnode)
                return cn_fail(error, CN_FAULT_NO_VERTEX, "", 0,
                               "tetrahedron %zu under the skin names node %d, but nodes run from 0 to %d",
                               i / (size_t)per, list[i], tets->nnode - 1);
    }
    return CN_OK;
}

cn_status cn_skin_new_embedded(cn_skin **out, const cn_surface *surface, const cn_tets *tets, cn_error *error)
{
    faces f = {.tets = tets};
    cn_skin *skin = NULL;
    cn_status status;

    *out = NULL;
    if ((status = check_tets(tets, error)) != CN_OK) return status;
    const size_t per = tets->mid ? 10 : 4;
    if ((status = cn_skin_begin(&skin, surface, tets->nnode, (int)per, error)) != CN_OK) return status;
    skin->kind = CN_SKIN_EMBED;
    if ((status = find_faces(&f, error)) != CN_OK) goto done;
    for (size_t v = 0; v < (size_t)skin->nvert; v++) {
        double b[4], from[4], outside;
        const int tet = tetrahedron_of(&f, surface->vert + 3 * v, b, from, &outside);
        if (tet < 0) {
            status = cn_fail(error, CN_ERR_NOT_FINITE, "", 0,
                             "vertex %zu of the skin is too far from the body to tell how far", v);
            goto done;
        }
        skin->reach = fmax(skin->reach, outside);
        memcpy(skin->anchor + per * v, tets->tet + 4 * (size_t)tet, 4 * sizeof *skin->anchor);
        if (tets->mid)
            memcpy(skin->anchor + per * v + 4, tets->mid + 6 * (size_t)tet, 6 * sizeof *skin->anchor);
        shape_functions(tets->mid != NULL, b, from, skin->weight + per * v);
    }
    status = cn_skin_sort(skin);
done:
    drop(&f);
    if (status == CN_OK)
        *out = skin;
    else
        cn_skin_free(skin);
    return status == CN_ERR_MEMORY ? cn_fail(error, status, "", 0, "out of memory for a skin") : status;
}

cn_status cn_skin_new_molecules(cn_skin **out, const cn_surface *surface, const cn_body *body,
                                cn_error *error)
{
    enum { PER = CN_MOLECULE_ANCHORS };
    cn_skin *skin = NULL;
    cn_status status;
    *out = NULL;
    if (body->model != CN_BODY_MOLECULES)
        return cn_fail(error, CN_ERR_ARG, "", 0, "a skin to be embedded in molecules needs a body of them");
    if ((status = cn_skin_begin(&skin, surface, body->nnode, PER, error)) != CN_OK) return status;
    skin->kind = CN_SKIN_EMBED;
    status = cn_molecules_hang(body->nnode, body->rest, cbrt(body->rest_volume / body->nnode), skin->nvert,
                               surface->vert, skin->anchor, skin->weight, error);
    for (size_t v = 0; status == CN_OK && v < (size_t)skin->nvert; v++)
        skin->reach = fmax(
            skin->reach, cn_distance(surface->vert + 3 * v, body->rest + 3 * (size_t)skin->anchor[PER * v]));
    if (status == CN_OK) status = cn_skin_sort(skin);
    if (status == CN_OK) {
        *out = skin;
        return CN_OK;
    }
    cn_skin_free(skin);
    return status == CN_ERR_MEMORY ? cn_fail(error, status, "", 0, "out of memory for a skin") : status;
}

/* --- rotations of a body's nodes, for skins that hang on them --- */
/* Adds q to the sum, with the sign that points the way of what is there. */
static void add_turn(const double q[4], double sum[4])
{
    const double along = q[0] * sum[0] + cn_dot(q + 1, sum + 1), sign = along < 0 ? -1 : 1;
    for (int k = 0; k < 4; k++)
        sum[k] += sign * q[k];
}

void cn_skin_rotations(const cn_body *body, const double *x, const double *rotation, double *turn,
                       cn_pool *pool)
{
    const size_t n = (size_t)body->nnode, per = body->ntet > 0 ? (size_t)(body->nturn / body->ntet) : 0;
    if (body->model == CN_BODY_MOLECULES) {
        cn_molecule_rotations(((const cn_molecules *)body->own)->frames, x, turn, pool);
        return;
    }
    if (body->model == CN_BODY_ROD) {
        memcpy(turn, rotation, 4 * n * sizeof *turn);
        return;
    }
    memset(turn, 0, 4 * n * sizeof *turn);
    for (size_t e = 0; per && e < (size_t)body->ntet; e++)
        for (size_t k = 0; k < per; k++)
            for (size_t a = 0; a < (body->mid ? 10 : 4); a++)
                add_turn(rotation + 4 * (e * per + k),
                         turn + 4 * (size_t)(a < 4 ? body->tet[4 * e + a] : body->mid[6 * e + a - 4]));
    for (size_t i = 0; i < n; i++) {
        double *q = turn + 4 * i;
        const double length = sqrt(q[0] * q[0] + cn_norm2(q + 1));
        for (int k = 0; k < 4; k++)
            q[k] = length > 0 ? q[k] / length : k == 0;
    }
}

void cn_skin_stress(const cn_skin *skin, const cn_body *body, const double *von_mises, double *nodes,
                    double *stress)
{
    const size_t n = (size_t)skin->nper, per = body->mid ? 10 : body->ntet ? 4 : 3;
    memset(nodes, 0, (size_t)body->nnode * sizeof *nodes);
    for (size_t e = 0; von_mises && e < (size_t)cn_body_cells(body); e++)
        for (size_t a = 0; a < per; a++) {
            const int p = !body->ntet ? body->boundary->tri[3 * e + a]
                          : a < 4     ? body->tet[4 * e + a]
                                      : body->mid[6 * e + a - 4];
            double *at = nodes + (body->nanchor ? body->anchor[p * body->nanchor] : cn_body_node_of(body, p));
            if (von_mises[e] > *at) *at = von_mises[e];
        }
    for (size_t r = 0; r < (size_t)skin->nvert; r++) {
        double sum = 0;
        for (size_t i = n * r; i < n * (r + 1); i++)
            sum += skin->weight[i] * nodes[skin->anchor[i]];
        stress[skin->vertex[r]] = sum > 0 ? sum : 0;
    }
}
