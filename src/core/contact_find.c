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
    if (f->model->surface[part->surface].wall >= 0) /* hardly moves */
        cn_tree_refit_loose(part->tree, f->x + first, (f->end ? f->end : f->x) + first, f->margin,
                            f->model->gap);
    else if (f->end)
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
    double margin;    /* of the two surfaces at hand: their points are each within reach */
    double shared[3]; /* motion that both have: only what they move against each other counts */
} search;

typedef struct {
    double min[3], max[3];
} box;

static void join(box *b, const box *other)
{
    for (int k = 0; k < 3; k++) {
        b->min[k] = other->min[k] < b->min[k] ? other->min[k] : b->min[k];
        b->max[k] = other->max[k] > b->max[k] ? other->max[k] : b->max[k];
    }
}

/* Of a point over its motion, less what is shared. */
static box box_of(const search *s, bool moves, int p)
{
    const double *x = s->x + 3 * (size_t)p, *dx = moves ? s->dx + 3 * (size_t)p : NULL;
    box b;
    for (int k = 0; k < 3; k++) {
        const double end = dx ? x[k] + (dx[k] - s->shared[k]) : x[k];
        b.min[k] = x[k] < end ? x[k] : end, b.max[k] = x[k] > end ? x[k] : end;
    }
    return b;
}

/* True where boxes come nearer than margin along each axis. */
static bool boxes_meet(const box *a, const box *b, double margin)
{
    return a->min[0] - margin <= b->max[0] && b->min[0] <= a->max[0] + margin &&
           a->min[1] - margin <= b->max[1] && b->min[1] <= a->max[1] + margin &&
           a->min[2] - margin <= b->max[2] && b->min[2] <= a->max[2] + margin;
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
    pair->gap = fmin(a->gap, b->gap);
    pair->kappa = fmax(a->kappa, b->kappa) < INFINITY ? sqrt(a->kappa * b->kappa) : fmin(a->kappa, b->kappa);
    if (a == b) pair->gap = fmin(pair->gap, 0.5 * rest_distance(a, pair));
    part->pair[part->npair++] = *pair;
    return true;
}

/* One of two triangles that may come near. */
typedef struct {
    cn_place place;
    const cn_contact_surface *surface;
    int p[3], owns;
    bool whole, moves;  /* no corner in the sheath; it moves in this search */
    box corner[3], all; /* over the motion; edge k joins corners k and k + 1 */
} side;

static side side_of(const search *s, cn_place place)
{
    side out = {.place = place, .surface = &s->model->surface[place.surface]};
    out.owns = out.surface->collider->owns[place.triangle];
    out.whole = cn_triangle_points(out.surface, s->nfree[place.surface], place.triangle, out.p);
    out.moves = s->dx && !cn_contact_rests(out.surface);
    return out;
}

static void add_boxes(const search *s, side *a)
{
    for (int k = 0; k < 3; k++)
        a->corner[k] = box_of(s, a->moves, a->p[k]);
    a->all = a->corner[0];
    join(&a->all, &a->corner[1]), join(&a->all, &a->corner[2]);
}

/* What a triangle spans along n over its motion, less what is shared. */
static void span(const search *s, const side *a, const double n[3], double *low, double *high)
{
    const double less = cn_dot(n, s->shared);
    *low = INFINITY, *high = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double h = cn_dot(n, s->x + 3 * (size_t)a->p[k]);
        const double end = a->moves ? h + (cn_dot(n, s->dx + 3 * (size_t)a->p[k]) - less) : h;
        const double least = h < end ? h : end, most = h > end ? h : end;
        *low = least < *low ? least : *low, *high = most > *high ? most : *high;
    }
}

/* True when triangle a stays on one side of the plane in which the other lies at first (and that goes along
 * with what is shared), farther than the margin all the way. */
static bool beside_plane(const search *s, const side *a, const side *b)
{
    double low, high, below, above, n[3], e[2][3];
    const double *corner = s->x + 3 * (size_t)b->p[0];
    cn_sub(s->x + 3 * (size_t)b->p[1], corner, e[0]), cn_sub(s->x + 3 * (size_t)b->p[2], corner, e[1]);
    cn_cross(e[0], e[1], n);
    if (!(cn_normalise(n) > 0)) return false;
    span(s, b, n, &below, &above);
    span(s, a, n, &low, &high);
    return low - above > s->margin || below - high > s->margin;
}

/* The same of a plane that is known. */
static bool beside_known(const search *s, const side *a, const double plane[4])
{
    double low, high;
    span(s, a, plane, &low, &high);
    return low - plane[3] > s->margin || plane[3] - high > s->margin;
}

static bool add_nodes(search *s, const side *a, const side *b)
{
    const int nfree = a->surface->first + cn_contact_nfree(a->surface, s->nfree[a->place.surface]);
    for (int k = 0; k < 3 && b->whole; k++) {
        const int p = a->p[k];
        if (!(a->owns >> k & 1) || p >= nfree || p == b->p[0] || p == b->p[1] || p == b->p[2]) continue;
        if (!boxes_meet(&a->corner[k], &b->all, s->margin)) continue;
        cn_pair pair = {.kind = CN_PAIR_NODE_TRIANGLE,
                        .surface = {a->place.surface, b->place.surface},
                        .triangle = b->place.triangle,
                        .p = {p, b->p[0], b->p[1], b->p[2]}};
        if (!add_pair(s, &pair)) return false;
    }
    return true;
}

/* Edge k of the triangle: its points in the collider's order, and its box. */
static box edge_of(const side *a, int k, int p[2])
{
    const cn_collider *c = a->surface->collider;
    box b = a->corner[k];
    join(&b, &a->corner[(k + 1) % 3]);
    for (int i = 0; i < 2; i++)
        p[i] = a->surface->first + c->edge[2 * c->tri_edge[3 * a->place.triangle + k] + i];
    return b;
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
        int p[2], q[2];
        if (!(a->owns >> (3 + k) & 1)) continue;
        const box here = edge_of(a, k, p);
        if (!boxes_meet(&here, &b->all, s->margin)) continue;
        for (int l = 0; l < 3; l++) {
            if (!(b->owns >> (3 + l) & 1)) continue;
            const box there = edge_of(b, l, q);
            if (p[0] == q[0] || p[0] == q[1] || p[1] == q[0] || p[1] == q[1]) continue;
            if (!boxes_meet(&here, &there, s->margin)) continue;
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
    const double *plane = s->model->surface[place_b.surface].plane; /* of what rests, and most are of that */
    side a = side_of(s, place_a), b;
    s->margin = margin_of(s, place_a.surface, place_b.surface);
    memset(s->shared, 0, sizeof s->shared);
    if (plane && beside_known(s, &a, plane + 4 * (size_t)place_b.triangle)) return true;
    b = side_of(s, place_b);
    if (a.moves && b.moves) cn_copy3(s->dx + 3 * (size_t)b.p[0], s->shared);
    if ((!plane && beside_plane(s, &a, &b)) || beside_plane(s, &b, &a)) return true;
    add_boxes(s, &a), add_boxes(s, &b);
    if (!boxes_meet(&a.all, &b.all, s->margin)) return true;
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
    const box node = box_of(s, s->dx, i);
    box b = node;
    for (int k = 0; k < 3; k++)
        b.min[k] -= grow, b.max[k] += grow;
    const int found = cn_tree_query_box(tree, b.min, b.max, NEAR, near);
    s->margin = margin_of(s, own, surface);
    for (int k = 0; k < (found <= NEAR ? found : ntri); k++) {
        const int t = first + (found <= NEAR ? near[k] : k); /* too many for the list: all are looked at */
        if (!cn_triangle_points(&s->model->surface[surface], s->nfree[surface], t, p)) continue;
        side there = side_of(s, (cn_place){surface, t});
        add_boxes(s, &there);
        if (!boxes_meet(&node, &there.all, s->margin)) continue;
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
