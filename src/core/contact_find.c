/* contact_find.c - the pairs that may come near. */
#include "contact.h"

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"
#include "geometry.h"

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const double *x, *dx; /* dx NULL: at rest */
    cn_contact_part *part;
    int nfree, wall;
    double margin;
} search;

static void grow_box(const double *p, double min[3], double max[3])
{
    for (int k = 0; k < 3; k++)
        min[k] = p[k] < min[k] ? p[k] : min[k], max[k] = p[k] > max[k] ? p[k] : max[k];
}

/* Box of wall vertices, or of body nodes over their motion and the margin. */
static void wall_box(int n, const int *index, const double *y, double min[3], double max[3])
{
    cn_copy3(y + 3 * index[0], min), cn_copy3(min, max);
    for (int i = 1; i < n; i++)
        grow_box(y + 3 * index[i], min, max);
}

static void body_box(const search *s, int n, const int *index, double min[3], double max[3])
{
    wall_box(n, index, s->x, min, max);
    for (int i = 0; s->dx && i < n; i++) {
        double end[3];
        cn_add(s->x + 3 * index[i], s->dx + 3 * index[i], end);
        grow_box(end, min, max);
    }
    for (int k = 0; k < 3; k++)
        min[k] -= s->margin, max[k] += s->margin;
}

static bool boxes_meet(const double amin[3], const double amax[3], const double bmin[3], const double bmax[3])
{
    return amin[0] <= bmax[0] && bmin[0] <= amax[0] && amin[1] <= bmax[1] && bmin[1] <= amax[1] &&
           amin[2] <= bmax[2] && bmin[2] <= amax[2];
}

static double distance_at(const search *s, const cn_pair *pair, double t)
{
    const double *y = s->model->world->wall[s->wall].surface->vert;
    const int n = pair->kind == CN_PAIR_NODE_TRIANGLE ? 1 : pair->kind == CN_PAIR_EDGES ? 2 : 3, *b = pair->b;
    double x[3][3];
    for (int i = 0; i < n; i++) {
        cn_copy3(s->x + 3 * pair->a[i], x[i]);
        if (t > 0) cn_axpy(t, s->dx + 3 * pair->a[i], x[i]);
    }
    switch (pair->kind) {
    case CN_PAIR_NODE_TRIANGLE:
        return cn_point_triangle(x[0], y + 3 * b[0], y + 3 * b[1], y + 3 * b[2], NULL);
    case CN_PAIR_TRIANGLE_VERTEX:
        return cn_point_triangle(y + 3 * b[0], x[0], x[1], x[2], NULL);
    default:
        return cn_edge_edge(x[0], x[1], y + 3 * b[0], y + 3 * b[1], NULL, NULL);
    }
}

/* The distance changes no faster than the nodes move: three looks along the way are each good for a quarter
 * of it. */
static bool stays_far(const search *s, cn_pair *pair)
{
    const int n = pair->kind == CN_PAIR_NODE_TRIANGLE ? 1 : pair->kind == CN_PAIR_EDGES ? 2 : 3;
    double way = 0;
    pair->found = distance_at(s, pair, 0);
    for (int i = 0; s->dx && i < n; i++)
        way = fmax(way, cn_norm(s->dx + 3 * pair->a[i]));
    const double near = s->margin + 0.25 * way;
    if (pair->found <= near) return false;
    return way == 0 || (distance_at(s, pair, 0.5) > near && distance_at(s, pair, 1) > near);
}

static bool add_pair(search *s, cn_pair *pair)
{
    cn_contact_part *part = s->part;
    pair->wall = s->wall;
    if (stays_far(s, pair)) return true;
    if (part->npair == part->capacity) return false;
    part->pair[part->npair++] = *pair;
    return true;
}

/* True when the triangle stays on one side of the wall triangle's plane, farther than the margin, all the
 * way. */
static bool beside_plane(const search *s, const int *a, const double *plane)
{
    double low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double h = cn_dot(plane, s->x + 3 * a[k]) - plane[3];
        const double end = s->dx ? h + cn_dot(plane, s->dx + 3 * a[k]) : h;
        low = fmin(low, fmin(h, end)), high = fmax(high, fmax(h, end));
    }
    return low > s->margin || high < -s->margin;
}

/* What two triangles own of each other's vertices and edges. */
static bool add_triangle_pair(void *user, int ia, int ib)
{
    search *s = user;
    ia += s->part->first;
    if (beside_plane(s, s->model->collider->tri + 3 * ia, s->model->wall_plane[s->wall] + 4 * ib))
        return true;
    const cn_collider *ca = s->model->collider, *cb = s->model->wall_collider[s->wall];
    const double *y = s->model->world->wall[s->wall].surface->vert;
    const int *a = ca->tri + 3 * ia, *b = cb->tri + 3 * ib;
    const int oa = ca->owns[ia], ob = cb->owns[ib];
    double bmin[3], bmax[3], amin[3], amax[3];

    wall_box(3, b, y, bmin, bmax);
    const bool inside = a[0] < s->nfree && a[1] < s->nfree && a[2] < s->nfree;
    for (int k = 0; k < 3; k++) {
        if (!(oa >> k & 1) || a[k] >= s->nfree) continue;
        body_box(s, 1, a + k, amin, amax);
        cn_pair pair = {
            .kind = CN_PAIR_NODE_TRIANGLE, .triangle = ib, .a = {a[k], -1, -1}, .b = {b[0], b[1], b[2]}};
        if (boxes_meet(amin, amax, bmin, bmax) && !add_pair(s, &pair)) return false;
    }
    if (!inside) return true; /* a triangle with a corner in the sheath is not tested against the walls */

    body_box(s, 3, a, amin, amax);
    for (int k = 0; k < 3; k++) {
        if (!(ob >> k & 1)) continue;
        cn_pair pair = {.kind = CN_PAIR_TRIANGLE_VERTEX, .a = {a[0], a[1], a[2]}, .b = {b[k], -1, -1}};
        wall_box(1, b + k, y, bmin, bmax);
        if (boxes_meet(amin, amax, bmin, bmax) && !add_pair(s, &pair)) return false;
    }
    for (int k = 0; k < 3; k++) {
        if (!(oa >> (3 + k) & 1)) continue;
        const int *ea = ca->edge + 2 * ca->tri_edge[3 * ia + k];
        body_box(s, 2, ea, amin, amax);
        for (int l = 0; l < 3; l++) {
            if (!(ob >> (3 + l) & 1)) continue;
            const int *eb = cb->edge + 2 * cb->tri_edge[3 * ib + l];
            wall_box(2, eb, y, bmin, bmax);
            if (!boxes_meet(amin, amax, bmin, bmax)) continue;
            double da[3], db[3];
            cn_sub(s->model->body->point + 3 * ea[1], s->model->body->point + 3 * ea[0], da);
            cn_sub(y + 3 * eb[1], y + 3 * eb[0], db);
            cn_pair pair = {.kind = CN_PAIR_EDGES,
                            .a = {ea[0], ea[1], -1},
                            .b = {eb[0], eb[1], -1},
                            .mollify = 1e-3 * cn_norm2(da) * cn_norm2(db)};
            if (!add_pair(s, &pair)) return false;
        }
    }
    return true;
}

/* The part's share of the inner nodes against the walls. */
static void find_inner(search *s, int p)
{
    enum { NEAR = 256 };
    const long n = s->model->ninner, parts = s->contact->npart;
    int near[NEAR];
    for (long j = n * p / parts; j < n * (p + 1) / parts; j++) {
        const int i = s->model->inner[j];
        double min[3], max[3];
        if (i >= s->nfree) continue;
        body_box(s, 1, &i, min, max);
        for (s->wall = 0; s->wall < s->model->world->nwall; s->wall++) {
            const cn_collider *wall = s->model->wall_collider[s->wall];
            const int found = cn_tree_query_box(s->model->world->wall[s->wall].tree, min, max, NEAR, near);
            for (int k = 0; k < (found <= NEAR ? found : wall->ntri); k++) {
                const int t = found <= NEAR ? near[k] : k; /* too many for the list: all are looked at */
                const int *b = wall->tri + 3 * t;
                cn_pair pair = {
                    .kind = CN_PAIR_NODE_TRIANGLE, .triangle = t, .a = {i, -1, -1}, .b = {b[0], b[1], b[2]}};
                if (!add_pair(s, &pair)) return;
            }
        }
    }
}

static void find_in_part(void *user, int p)
{
    const search *all = user;
    search s = *all;
    s.part = &all->contact->part[p];
    s.part->npair = 0;
    find_inner(&s, p);
    if (s.part->lowest >= s.nfree) return;
    cn_tree_refit_swept(s.part->tree, s.x, s.dx ? s.contact->end : s.x, s.margin);
    for (s.wall = 0; s.wall < s.model->world->nwall; s.wall++)
        cn_tree_query_pairs(s.part->tree, s.model->world->wall[s.wall].tree, 0, add_triangle_pair, &s);
}

cn_status cn_contact_find(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                          const double *dx, double reach, double listed, cn_pool *pool)
{
    const double gap = listed > model->gap ? listed : model->gap;
    const size_t n = 3 * (size_t)model->body->npoint;
    search s = {.model = model, .contact = contact, .x = x, .dx = dx, .nfree = nfree, .margin = gap + reach};
    bool full = false;

    contact->npair = 0;
    contact->reach = reach, contact->gap_listed = gap, contact->anchored = !dx;
    memcpy(contact->from, x, n * sizeof *x);
    if (dx) {
        memcpy(contact->end, x, n * sizeof *x);
        for (int i = 0; i < 3 * nfree; i++)
            contact->end[i] += dx[i];
    }
    cn_pool_run(pool, contact->npart, find_in_part, &s);
    for (int p = 0; p < contact->npart; p++) {
        const cn_contact_part *part = &contact->part[p];
        full |= part->npair == part->capacity;
        for (int i = 0; i < part->npair; i++) {
            if (contact->npair == contact->capacity) return CN_ERR_CONTACT;
            contact->distance[contact->npair] = part->pair[i].found;
            contact->pair[contact->npair++] = part->pair[i];
        }
    }
    return full ? CN_ERR_CONTACT : CN_OK;
}
