/* contact_find.c - memory of the contact search, and the pairs that may come near. */
#include "contact.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "geometry.h"

/* Unit normal n and offset d of each triangle: n . x = d; zero where it has no area. */
static cn_status planes_of(double **out, const cn_surface *surface)
{
    double *plane = *out = malloc((4 * (size_t)surface->ntri + 1) * sizeof *plane);
    if (!plane) return CN_ERR_MEMORY;
    for (int t = 0; t < surface->ntri; t++, plane += 4) {
        const double *p = surface->vert + 3 * surface->tri[3 * t];
        double e1[3], e2[3];
        cn_sub(surface->vert + 3 * surface->tri[3 * t + 1], p, e1);
        cn_sub(surface->vert + 3 * surface->tri[3 * t + 2], p, e2);
        cn_cross(e1, e2, plane);
        cn_normalise(plane);
        plane[3] = cn_dot(plane, p);
    }
    return CN_OK;
}

cn_status cn_contact_model_new(cn_contact_model **out, const cn_body *body, const cn_world *world, double gap,
                               double kappa)
{
    cn_contact_model *model = calloc(1, sizeof *model);
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!model) return CN_ERR_MEMORY;
    model->body = body, model->world = world, model->gap = gap, model->kappa = kappa;
    model->wall_collider = calloc((size_t)world->nwall + 1, sizeof *model->wall_collider);
    model->wall_plane = calloc((size_t)world->nwall + 1, sizeof *model->wall_plane);
    if (!model->wall_collider || !model->wall_plane) goto fail;
    status = cn_collider_new(&model->collider, body->boundary->ntri, body->boundary->tri, body->nnode);
    for (int w = 0; w < world->nwall && status == CN_OK; w++) {
        const cn_surface *wall = world->wall[w].surface;
        status = cn_collider_new(&model->wall_collider[w], wall->ntri, wall->tri, wall->nvert);
        if (status == CN_OK) status = planes_of(&model->wall_plane[w], wall);
    }
    if (status != CN_OK) goto fail;
    *out = model;
    return CN_OK;
fail:
    cn_contact_model_free(model);
    return status;
}

void cn_contact_model_free(cn_contact_model *model)
{
    if (!model) return;
    cn_collider_free(model->collider);
    for (int w = 0; model->wall_collider && w < model->world->nwall; w++)
        cn_collider_free(model->wall_collider[w]);
    for (int w = 0; model->wall_plane && w < model->world->nwall; w++)
        free(model->wall_plane[w]);
    free(model->wall_collider), free(model->wall_plane);
    free(model);
}

static cn_status pair_memory(cn_contact *contact, int capacity)
{
    cn_pair *pair = realloc(contact->pair, (size_t)capacity * sizeof *pair);
    if (pair) contact->pair = pair;
    double *distance = realloc(contact->distance, (size_t)capacity * sizeof *distance);
    if (distance) contact->distance = distance;
    double *limit = realloc(contact->limit, ((size_t)capacity / 64 + 1) * sizeof *limit);
    if (limit) contact->limit = limit;
    if (!pair || !distance || !limit) return CN_ERR_MEMORY;
    contact->capacity = capacity;
    return CN_OK;
}

cn_status cn_contact_new(cn_contact **out, const cn_contact_model *model)
{
    cn_contact *contact = calloc(1, sizeof *contact);
    const cn_body *body = model->body;
    const int nwall = model->world->nwall;
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!contact) return CN_ERR_MEMORY;
    contact->from = malloc(3 * (size_t)body->nnode * sizeof *contact->from);
    contact->end = malloc(3 * (size_t)body->nnode * sizeof *contact->end);
    contact->patch_of = malloc(((size_t)nwall + 1) * sizeof *contact->patch_of);
    if (!contact->from || !contact->end || !contact->patch_of) goto fail;
    contact->patch_of[0] = 0;
    for (int w = 0; w < nwall; w++)
        contact->patch_of[w + 1] = contact->patch_of[w] + model->world->wall[w].surface->nvert;
    contact->patch = malloc(((size_t)contact->patch_of[nwall] + 1) * sizeof *contact->patch);
    contact->patch_force = malloc((6 * (size_t)contact->patch_of[nwall] + 1) * sizeof *contact->patch_force);
    if (!contact->patch || !contact->patch_force) goto fail;
    if ((status = pair_memory(contact, 16384 + 32 * body->boundary->ntri)) != CN_OK) goto fail;
    if ((status = cn_tree_new(&contact->tree, body->boundary->ntri, body->boundary->tri, body->rest)) !=
        CN_OK)
        goto fail;
    *out = contact;
    return CN_OK;
fail:
    cn_contact_free(contact);
    return status;
}

void cn_contact_free(cn_contact *contact)
{
    if (!contact) return;
    cn_tree_free(contact->tree);
    free(contact->pair), free(contact->distance), free(contact->limit), free(contact->from),
        free(contact->end);
    free(contact->patch), free(contact->patch_of), free(contact->patch_force);
    free(contact);
}

cn_status cn_contact_grow(cn_contact *contact)
{
    return pair_memory(contact, 2 * contact->capacity);
}

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const double *x, *dx; /* dx NULL: at rest */
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
    cn_contact *contact = s->contact;
    pair->wall = s->wall;
    if (stays_far(s, pair)) return true;
    if (contact->npair == contact->capacity) return contact->full = true, false;
    contact->distance[contact->npair] = pair->found;
    contact->pair[contact->npair++] = *pair;
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
        cn_pair pair = {.kind = CN_PAIR_NODE_TRIANGLE, .a = {a[k], -1, -1}, .b = {b[0], b[1], b[2]}};
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
            cn_sub(s->x + 3 * ea[1], s->x + 3 * ea[0], da);
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

cn_status cn_contact_find(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                          const double *dx, double reach, double listed)
{
    const double gap = listed > model->gap ? listed : model->gap;
    const size_t n = 3 * (size_t)model->body->nnode;
    search s = {.model = model, .contact = contact, .x = x, .dx = dx, .nfree = nfree, .margin = gap + reach};

    contact->npair = 0, contact->full = false;
    contact->reach = reach, contact->gap_listed = gap, contact->anchored = !dx;
    memcpy(contact->from, x, n * sizeof *x);
    if (nfree == 0) return CN_OK;
    if (dx) {
        memcpy(contact->end, x, n * sizeof *x);
        for (int i = 0; i < 3 * nfree; i++)
            contact->end[i] += dx[i];
    }
    cn_tree_refit_swept(contact->tree, x, dx ? contact->end : x, s.margin);
    for (s.wall = 0; s.wall < model->world->nwall; s.wall++)
        cn_tree_query_pairs(contact->tree, model->world->wall[s.wall].tree, 0, add_triangle_pair, &s);
    return contact->full ? CN_ERR_CONTACT : CN_OK;
}
