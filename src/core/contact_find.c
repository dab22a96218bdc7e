/* contact_find.c - the pairs that may come near. */
#include "contact_parts.h"

#include <math.h>
#include <string.h>
#include "geometry.h"

/* --- pairs of triangles whose boxes meet --- */

typedef struct {
    cn_place a, b; /* first triangles of the two trees */
    cn_triangle_visit visit;
    void *user;
} walk;

static bool next_pair(void *user, int ia, int ib)
{
    const walk *w = user;
    return w->visit(w->user, (cn_place){w->a.surface, w->a.triangle + ia},
                    (cn_place){w->b.surface, w->b.triangle + ib});
}

static bool takes_part(const cn_contact_model *model, const cn_contact_part *part, const int *nfree)
{
    return part->lowest < cn_contact_nfree(&model->surface[part->surface], nfree[part->surface]);
}

void cn_contact_visit(const cn_contact_model *model, const cn_contact *contact, const int *nfree, int p,
                      double wall_margin, double margin, cn_triangle_visit visit, void *user)
{
    const cn_contact_part *part = &contact->part[p];
    walk w = {.a = {part->surface, part->first}, .visit = visit, .user = user};
    if (!takes_part(model, part, nfree)) return;
    for (int s = 0; s < model->nsurface; s++) {
        if (!cn_contact_rests(&model->surface[s]) || !cn_contact_meet(model, part->surface, s)) continue;
        const cn_tree *tree = model->world->wall[model->surface[s].wall].tree;
        w.b = (cn_place){s, 0};
        if (!cn_tree_query_pairs(part->tree, tree, wall_margin, next_pair, &w)) return;
    }
    for (int q = p; q < contact->npart; q++) {
        const cn_contact_part *other = &contact->part[q];
        if (!cn_contact_meet(model, part->surface, other->surface)) continue;
        if (!takes_part(model, other, nfree)) continue;
        w.b = (cn_place){other->surface, other->first};
        if (!(q == p ? cn_tree_query_self(part->tree, margin, next_pair, &w)
                     : cn_tree_query_pairs(part->tree, other->tree, margin, next_pair, &w)))
            return;
    }
}

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const int *nfree;
    const double *x, *end;
    double margin;
} fit;

static void refit_part(void *user, int p)
{
    const fit *f = user;
    cn_contact_part *part = &f->contact->part[p];
    const size_t first = 3 * (size_t)f->model->surface[part->surface].first;
    if (!takes_part(f->model, part, f->nfree)) return;
    if (f->end)
        cn_tree_refit_swept(part->tree, f->x + first, f->end + first, f->margin);
    else
        cn_tree_refit(part->tree, f->x + first);
}

void cn_contact_refit(const cn_contact_model *model, cn_contact *contact, const int *nfree, const double *x,
                      const double *end, double margin, cn_pool *pool)
{
    fit f = {model, contact, nfree, x, end, margin};
    cn_pool_run(pool, contact->npart, refit_part, &f);
}

/* --- what two triangles own of each other's vertices and edges --- */

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const int *nfree;
    const double *x, *dx; /* dx NULL: at rest */
    double gap, reach;
    cn_contact_part *part;
    double margin; /* of the two surfaces at hand: their points are each within reach */
} search;

static void grow_box(const double *p, double min[3], double max[3])
{
    for (int k = 0; k < 3; k++)
        min[k] = p[k] < min[k] ? p[k] : min[k], max[k] = p[k] > max[k] ? p[k] : max[k];
}

/* Box of points over their motion, inflated by margin. */
static void box_of(const search *s, int surface, int n, const int *p, double margin, double min[3],
                   double max[3])
{
    const bool moves = s->dx && !cn_contact_rests(&s->model->surface[surface]);
    cn_copy3(s->x + 3 * p[0], min), cn_copy3(min, max);
    for (int i = 0; i < n; i++) {
        double end[3];
        grow_box(s->x + 3 * p[i], min, max);
        if (!moves) continue;
        cn_add(s->x + 3 * p[i], s->dx + 3 * p[i], end);
        grow_box(end, min, max);
    }
    for (int k = 0; k < 3; k++)
        min[k] -= margin, max[k] += margin;
}

static bool boxes_meet(const double amin[3], const double amax[3], const double bmin[3], const double bmax[3])
{
    return amin[0] <= bmax[0] && bmin[0] <= amax[0] && amin[1] <= bmax[1] && bmin[1] <= amax[1] &&
           amin[2] <= bmax[2] && bmin[2] <= amax[2];
}

static double distance_of(const cn_pair *pair, const double q[4][3])
{
    return pair->kind == CN_PAIR_EDGES ? cn_edge_edge(q[0], q[1], q[2], q[3], NULL, NULL)
                                       : cn_point_triangle(q[0], q[1], q[2], q[3], NULL);
}

static double distance_at(const double q[4][3], const double dq[4][3], const cn_pair *pair, double t)
{
    double at[4][3];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            at[i][k] = q[i][k] + t * dq[i][k];
    return distance_of(pair, (const double(*)[3])at);
}

/* The distance changes no faster than points of the two sides move against each other: three looks along the
 * way are each good for a quarter of it. */
static bool stays_far(const search *s, cn_pair *pair)
{
    double q[4][3], dq[4][3];
    for (int i = 0; i < 4; i++)
        cn_copy3(s->x + 3 * pair->p[i], q[i]);
    pair->found = distance_of(pair, (const double(*)[3])q);
    if (!(pair->found > s->margin)) return false;
    if (!s->dx) return true;
    const double way = cn_pair_motion(s->model, pair, s->dx, NULL, dq), near = s->margin + 0.25 * way;
    if (pair->found <= near) return false;
    const double(*const from)[3] = (const double(*)[3])q, (*const ways)[3] = (const double(*)[3])dq;
    return way == 0 || (distance_at(from, ways, pair, 0.5) > near && distance_at(from, ways, pair, 1) > near);
}

/* Of a surface with itself: neighbours lie near each other without touching. */
static double rest_distance(const cn_contact_surface *surface, const cn_pair *pair)
{
    double q[4][3];
    for (int i = 0; i < 4; i++)
        cn_copy3(surface->rest + 3 * (pair->p[i] - surface->first), q[i]);
    return distance_of(pair, (const double(*)[3])q);
}

static bool add_pair(search *s, cn_pair *pair)
{
    cn_contact_part *part = s->part;
    const cn_contact_surface *a = &s->model->surface[pair->surface[0]];
    const cn_contact_surface *b = &s->model->surface[pair->surface[1]];
    if (stays_far(s, pair)) return true;
    if (part->npair == part->capacity) return false;
    pair->gap = fmin(a->gap, b->gap), pair->kappa = fmin(a->kappa, b->kappa);
    if (a == b) pair->gap = fmin(pair->gap, 0.5 * rest_distance(a, pair));
    part->pair[part->npair++] = *pair;
    return true;
}

/* True when the triangle stays on one side of the wall triangle's plane, farther than the margin, all the
 * way. */
static bool beside_plane(const search *s, const int *p, const double *plane)
{
    double low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double h = cn_dot(plane, s->x + 3 * p[k]) - plane[3];
        const double end = s->dx ? h + cn_dot(plane, s->dx + 3 * p[k]) : h;
        low = fmin(low, fmin(h, end)), high = fmax(high, fmax(h, end));
    }
    return low > s->margin || high < -s->margin;
}

/* One of two triangles that may come near. */
typedef struct {
    cn_place place;
    const cn_contact_surface *surface;
    int p[3], owns;
    bool whole; /* no corner in the sheath */
    double min[3], max[3];
} side;

static side side_of(const search *s, cn_place place)
{
    side out = {.place = place, .surface = &s->model->surface[place.surface]};
    out.owns = out.surface->collider->owns[place.triangle];
    out.whole = cn_triangle_points(out.surface, s->nfree[place.surface], place.triangle, out.p);
    return out;
}

static bool add_nodes(search *s, const side *a, const side *b)
{
    const int nfree = a->surface->first + cn_contact_nfree(a->surface, s->nfree[a->place.surface]);
    if (!b->whole) return true;
    for (int k = 0; k < 3; k++) {
        double min[3], max[3];
        const int p = a->p[k];
        if (!(a->owns >> k & 1) || p >= nfree || p == b->p[0] || p == b->p[1] || p == b->p[2]) continue;
        box_of(s, a->place.surface, 1, &p, s->margin, min, max);
        cn_pair pair = {.kind = CN_PAIR_NODE_TRIANGLE,
                        .surface = {a->place.surface, b->place.surface},
                        .triangle = b->place.triangle,
                        .p = {p, b->p[0], b->p[1], b->p[2]}};
        if (boxes_meet(min, max, b->min, b->max) && !add_pair(s, &pair)) return false;
    }
    return true;
}

/* Edge k of the triangle: its points. */
static void edge_of(const side *a, int k, int p[2])
{
    const cn_collider *c = a->surface->collider;
    for (int i = 0; i < 2; i++)
        p[i] = a->surface->first + c->edge[2 * c->tri_edge[3 * a->place.triangle + k] + i];
}

static double rest_square(const cn_contact_surface *surface, const int p[2])
{
    double d[3];
    cn_sub(surface->rest + 3 * (p[1] - surface->first), surface->rest + 3 * (p[0] - surface->first), d);
    return cn_norm2(d);
}

static bool add_edges(search *s, const side *a, const side *b)
{
    for (int k = 0; k < 3; k++) {
        double amin[3], amax[3], bmin[3], bmax[3];
        int p[2], q[2];
        if (!(a->owns >> (3 + k) & 1)) continue;
        edge_of(a, k, p);
        box_of(s, a->place.surface, 2, p, s->margin, amin, amax);
        for (int l = 0; l < 3; l++) {
            if (!(b->owns >> (3 + l) & 1)) continue;
            edge_of(b, l, q);
            if (p[0] == q[0] || p[0] == q[1] || p[1] == q[0] || p[1] == q[1]) continue;
            box_of(s, b->place.surface, 2, q, 0, bmin, bmax);
            if (!boxes_meet(amin, amax, bmin, bmax)) continue;
            cn_pair pair = {.kind = CN_PAIR_EDGES,
                            .surface = {a->place.surface, b->place.surface},
                            .triangle = -1,
                            .p = {p[0], p[1], q[0], q[1]},
                            .mollify = 1e-3 * rest_square(a->surface, p) * rest_square(b->surface, q)};
            if (!add_pair(s, &pair)) return false;
        }
    }
    return true;
}

/* Margin between two surfaces: the points of each that moves may be anywhere within reach. */
static double margin_of(const search *s, int a, int b)
{
    const bool both = !cn_contact_rests(&s->model->surface[a]) && !cn_contact_rests(&s->model->surface[b]);
    return s->gap + (both ? 2 : 1) * s->reach;
}

static bool add_triangle_pair(void *user, cn_place place_a, cn_place place_b)
{
    search *s = user;
    const double *plane = s->model->surface[place_b.surface].plane;
    side a = side_of(s, place_a), b;
    s->margin = margin_of(s, place_a.surface, place_b.surface);
    if (plane && beside_plane(s, a.p, plane + 4 * (size_t)place_b.triangle)) return true;
    b = side_of(s, place_b);
    if (a.whole) box_of(s, place_a.surface, 3, a.p, 0, a.min, a.max);
    if (b.whole) box_of(s, place_b.surface, 3, b.p, 0, b.min, b.max);
    if (!add_nodes(s, &a, &b) || !add_nodes(s, &b, &a)) return false;
    return !a.whole || !b.whole || add_edges(s, &a, &b);
}

/* --- nodes inside the body --- */

/* Node i against the triangles of a tree, whose first is the surface's triangle `first`; grow: by how much
 * its box over its motion is to be inflated for this tree. */
static bool add_inner(search *s, int own, int i, int surface, const cn_tree *tree, int first, int ntri,
                      double grow)
{
    enum { NEAR = 256 };
    int near[NEAR], p[3];
    double min[3], max[3];
    box_of(s, own, 1, &i, grow, min, max);
    const int found = cn_tree_query_box(tree, min, max, NEAR, near);
    s->margin = margin_of(s, own, surface);
    for (int k = 0; k < (found <= NEAR ? found : ntri); k++) {
        const int t = first + (found <= NEAR ? near[k] : k); /* too many for the list: all are looked at */
        if (!cn_triangle_points(&s->model->surface[surface], s->nfree[surface], t, p)) continue;
        cn_pair pair = {.kind = CN_PAIR_NODE_TRIANGLE,
                        .surface = {own, surface},
                        .triangle = t,
                        .p = {i, p[0], p[1], p[2]}};
        if (!add_pair(s, &pair)) return false;
    }
    return true;
}

/* The part's share of its surface's inner nodes against all other surfaces. */
static void find_inner(search *s, int p)
{
    const int own = s->part->surface;
    const cn_contact_surface *surface = &s->model->surface[own];
    int before = 0, parts = 0;
    for (int q = 0; q < s->contact->npart; q++)
        if (s->contact->part[q].surface == own) before += q < p, parts++;
    const int begin = (int)((long)surface->ninner * before / parts);
    const int end = (int)((long)surface->ninner * (before + 1) / parts);
    for (int j = begin; j < end; j++) {
        const int i = surface->first + surface->inner[j];
        if (surface->inner[j] >= s->nfree[own]) continue;
        for (int w = 0; w < s->model->nsurface; w++) {
            const cn_contact_surface *wall = &s->model->surface[w];
            if (cn_contact_rests(wall) && cn_contact_meet(s->model, own, w) &&
                !add_inner(s, own, i, w, s->model->world->wall[wall->wall].tree, 0, wall->ntri,
                           s->gap + s->reach))
                return;
        }
        for (int q = 0; q < s->contact->npart; q++) {
            const cn_contact_part *other = &s->contact->part[q];
            if (other->surface != own && cn_contact_meet(s->model, own, other->surface) &&
                takes_part(s->model, other, s->nfree) &&
                !add_inner(s, own, i, other->surface, other->tree, other->first, other->ntri,
                           0.5 * s->gap + s->reach))
                return;
        }
    }
}

/* Boxes of parts are inflated by half the gap and the reach. */
static void find_in_part(void *user, int p)
{
    search s = *(const search *)user;
    s.part = &s.contact->part[p];
    s.part->npair = 0;
    find_inner(&s, p);
    cn_contact_visit(s.model, s.contact, s.nfree, p, 0.5 * s.gap, 0, add_triangle_pair, &s);
}

cn_status cn_contact_find(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                          const double *x, const double *dx, double reach, double listed, cn_pool *pool)
{
    const double gap = listed > model->gap ? listed : model->gap;
    search s = {
        .model = model, .contact = contact, .nfree = nfree, .x = x, .dx = dx, .gap = gap, .reach = reach};
    bool full = false;

    contact->npair = 0;
    contact->reach = reach, contact->gap_listed = gap, contact->anchored = !dx;
    cn_contact_note(model, contact->from, x);
    for (int i = 0; dx && i < model->nsurface; i++) {
        const cn_contact_surface *surface = &model->surface[i];
        const int nmoved = cn_contact_nfree(surface, nfree[i]);
        if (cn_contact_rests(surface)) continue;
        for (int k = 3 * surface->first; k < 3 * (surface->first + surface->npoint); k++)
            contact->end[k] = k < 3 * (surface->first + nmoved) ? x[k] + dx[k] : x[k];
    }
    cn_contact_refit(model, contact, nfree, x, dx ? contact->end : x, 0.5 * gap + reach, pool);
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
