/* contact_penalty.c - penetration springs of colliding and immersed faces (Egger 2004, 3.3), surface against
 * surface.
 *
 * Faces of one surface that cross the other, by the exact test, are the first ring; neighbours that lie
 * inside the other join it, and theirs, until none is left. Each such face pushes its corners that are
 * inside, by their depth along the normal of the other's face it met: a crossing face each face it crosses,
 * an immersed one the face nearest to its centre. Corners go to their anchor, the nearest node; an anchor is
 * pushed along the sum of its faces' pushes, as deep as the deepest of them, which is where the spring acts:
 * what hangs on several nodes gives each its share back. A face that crosses without a
 * corner inside, pierced by the other's corner or edge, pushes its lowest corner out by the shorter of the
 * two ways apart. */
#include "contact_parts.h"

#include <stdlib.h>
#include "geometry.h"

typedef struct {
    cn_place a, b;
} hit;

/* Of a node, while two surfaces are looked at. */
typedef struct {
    int round; /* the rest is of this one */
    int point; /* the deepest */
    double sum[3], deepest;
} anchor;

struct cn_penalty_scratch {
    const cn_contact_model *model;
    cn_contact *contact;
    const int *nfree;
    const double *x;
    int **neighbour; /* triangles beyond the edges of each surface, -1: none (ntri x 3) */
    int **seen;      /* by triangles: round in which each was asked (ntri) */
    int round;
    int nhit, hit_capacity;
    bool full;
    hit *hit;
    int *face;      /* the ring and what lies within (most triangles of a surface) */
    anchor *anchor; /* (most nodes of a body) */
    int *node;      /* anchors of this round, in the order met (most nodes of a body) */
};

/* --- the search --- */

static bool note_crossing(void *user, cn_place a, cn_place b)
{
    struct cn_penalty_scratch *s = user;
    int p[3], q[3];
    double ta[3][3], tb[3][3];
    if (a.surface == b.surface) return true;
    if (!cn_triangle_points(&s->model->surface[a.surface], s->nfree[a.surface], a.triangle, p)) return true;
    if (!cn_triangle_points(&s->model->surface[b.surface], s->nfree[b.surface], b.triangle, q)) return true;
    cn_corners(p, s->x, ta), cn_corners(q, s->x, tb);
    if (cn_tri_tri((const double(*)[3])ta, (const double(*)[3])tb) == CN_TRI_APART) return true;
    s->full |= s->nhit == s->hit_capacity;
    if (!s->full) s->hit[s->nhit++] = (hit){a, b};
    return !s->full;
}

/* True where p lies inside surface b: on the side where a body's surface must not be. Behind an open wall
 * that is the side where `from` is not. */
static bool is_inside(const struct cn_penalty_scratch *s, int b, const double from[3], const double p[3])
{
    const cn_contact_surface *other = &s->model->surface[b];
    const cn_wall *wall = other->wall < 0 ? NULL : &s->model->world->wall[other->wall];
    if (other->body && s->nfree[b] < other->npoint) return false; /* part of it is in a sheath */
    if (!wall || wall->vessel || wall->closed || wall->half_space)
        return cn_contact_behind(s->model, s->contact, b, p);
    int crossings = cn_contact_rests(other) ? cn_tree_crossings(wall->tree, from, p) : 0;
    for (int t = 0; t < s->contact->npart; t++)
        if (s->contact->part[t].surface == b)
            crossings += cn_tree_crossings(s->contact->part[t].tree, from, p);
    return crossings % 2;
}

/* Nearest triangle of surface b to p. */
static double nearest_face(const struct cn_penalty_scratch *s, int b, const double p[3], int *triangle)
{
    double least = INFINITY, point[3];
    *triangle = -1;
    if (cn_contact_rests(&s->model->surface[b]))
        return cn_tree_nearest(s->model->world->wall[s->model->surface[b].wall].tree, p, INFINITY, triangle,
                               point);
    for (int i = 0; i < s->contact->npart; i++) {
        const cn_contact_part *part = &s->contact->part[i];
        int t;
        if (part->surface != b) continue;
        const double d = cn_tree_nearest(part->tree, p, least, &t, point);
        if (t >= 0 && d < least) least = d, *triangle = part->first + t;
    }
    return least;
}

static void centre_of(const int p[3], const double *x, double c[3])
{
    for (int k = 0; k < 3; k++)
        c[k] = (x[3 * (size_t)p[0] + k] + x[3 * (size_t)p[1] + k] + x[3 * (size_t)p[2] + k]) / 3;
}

/* Mean of the points that take part. */
static void middle_of(const struct cn_penalty_scratch *s, int a, double c[3])
{
    const cn_contact_surface *own = &s->model->surface[a];
    c[0] = c[1] = c[2] = 0;
    for (int i = 0; i < s->nfree[a]; i++)
        cn_axpy(1.0 / s->nfree[a], s->x + 3 * (size_t)(own->first + i), c);
}

/* Faces of a that cross b, ncross of them, and behind them in s->face those immersed; how many in all. */
static int faces_of(struct cn_penalty_scratch *s, int a, int b, const double middle[3], int *ncross)
{
    const cn_contact_surface *own = &s->model->surface[a];
    int n = 0, *seen = s->seen[a];
    s->round++;
    for (int i = 0; i < s->nhit; i++)
        for (int k = 0; k < 2; k++) {
            const cn_place mine = k ? s->hit[i].b : s->hit[i].a, other = k ? s->hit[i].a : s->hit[i].b;
            if (mine.surface != a || other.surface != b || seen[mine.triangle] == s->round) continue;
            seen[mine.triangle] = s->round, s->face[n++] = mine.triangle;
        }
    *ncross = n;
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const int t = s->neighbour[a][3 * s->face[i] + k];
            int p[3];
            double c[3];
            if (t < 0 || seen[t] == s->round) continue;
            seen[t] = s->round;
            if (!cn_triangle_points(own, s->nfree[a], t, p)) continue;
            centre_of(p, s->x, c);
            if (is_inside(s, b, middle, c)) s->face[n++] = t;
        }
    return n;
}

/* --- pushes --- */

/* Unit normal of a face of b towards its free side: of an open wall, where `middle` is. */
static bool free_normal(const struct cn_penalty_scratch *s, int b, int triangle, const double middle[3],
                        double n[3])
{
    const cn_contact_surface *other = &s->model->surface[b];
    double q[3][3], e1[3], e2[3], sign = 1;
    int p[3];
    cn_triangle_points(other, s->nfree[b], triangle, p);
    cn_corners(p, s->x, q);
    cn_sub(q[1], q[0], e1), cn_sub(q[2], q[0], e2), cn_cross(e1, e2, n);
    if (!(cn_normalise(n) > 0)) return false;
    if (other->wall >= 0) {
        const cn_wall *wall = &s->model->world->wall[other->wall];
        cn_sub(middle, q[0], e1);
        sign = wall->vessel ? -1 : wall->closed || wall->half_space || cn_dot(n, e1) > 0 ? 1 : -1;
    }
    for (int k = 0; k < 3; k++)
        n[k] *= sign;
    return true;
}

static void push(struct cn_penalty_scratch *s, int a, int point, double depth, const double n[3], int *nnode)
{
    const cn_contact_surface *own = &s->model->surface[a];
    const int node = cn_body_node_of(own->body, point - own->first);
    anchor *at = &s->anchor[node];
    if (!(depth > 0)) return;
    if (at->round != s->round) {
        *at = (anchor){.round = s->round};
        s->node[(*nnode)++] = node;
    }
    cn_axpy(depth, n, at->sum);
    if (depth > at->deepest) at->deepest = depth, at->point = point - own->first;
}

/* The corners p of a face that are inside, along the normal of the other's face; -1: of that nearest to each.
 */
static bool push_corners(struct cn_penalty_scratch *s, int a, const int p[3], int b, int other,
                         const double middle[3], int *nnode)
{
    int nearest;
    double n[3];
    bool any = false;
    for (int k = 0; k < 3; k++) {
        const double *corner = s->x + 3 * (size_t)p[k];
        if (!is_inside(s, b, middle, corner)) continue;
        any = true;
        const double depth = nearest_face(s, b, corner, &nearest);
        if (free_normal(s, b, other < 0 ? nearest : other, middle, n)) push(s, a, p[k], depth, n, nnode);
    }
    return any;
}

/* How far the lowest corner of triangle p lies below `on` along n, and which one it is. */
static double lowest(const double *x, const int p[3], const double n[3], const double *on, int *which)
{
    double most = -INFINITY;
    for (int k = 0; k < 3; k++) {
        double up[3];
        cn_sub(on, x + 3 * (size_t)p[k], up);
        if (cn_dot(n, up) > most) most = cn_dot(n, up), *which = p[k];
    }
    return most;
}

/* A face that crosses without a corner inside. */
static void push_pierced(struct cn_penalty_scratch *s, cn_place a, cn_place b, const double middle[3],
                         int *nnode)
{
    int p[3], q[3], low, high;
    double n[3], m[3];
    cn_triangle_points(&s->model->surface[a.surface], s->nfree[a.surface], a.triangle, p);
    cn_triangle_points(&s->model->surface[b.surface], s->nfree[b.surface], b.triangle, q);
    if (!free_normal(s, b.surface, b.triangle, middle, n)) return;
    if (!free_normal(s, a.surface, a.triangle, s->x + 3 * (size_t)q[0], m)) return;
    const double down = lowest(s->x, p, n, s->x + 3 * (size_t)q[0], &low);
    const double in = lowest(s->x, q, m, s->x + 3 * (size_t)p[0], &high);
    if (down <= in) {
        push(s, a.surface, low, down, n, nnode);
        return;
    }
    for (int k = 0; k < 3; k++)
        m[k] = -m[k];
    for (int k = 0; k < 3; k++)
        push(s, a.surface, p[k], in, m, nnode);
}

static bool meet(const struct cn_penalty_scratch *s, int a, int b)
{
    for (int i = 0; i < s->nhit; i++)
        if ((s->hit[i].a.surface == a && s->hit[i].b.surface == b) ||
            (s->hit[i].a.surface == b && s->hit[i].b.surface == a))
            return true;
    return false;
}

/* What surface b does to the nodes of a; false: the list is full. */
static bool push_away(cn_penalty *penalty, int a, int b)
{
    struct cn_penalty_scratch *s = penalty->scratch;
    double middle[3];
    int nnode = 0, ncross, nearest, p[3];
    middle_of(s, a, middle);
    const int nface = faces_of(s, a, b, middle, &ncross);
    for (int i = 0; i < nface; i++) {
        const int t = s->face[i];
        double c[3];
        cn_triangle_points(&s->model->surface[a], s->nfree[a], t, p);
        centre_of(p, s->x, c);
        if (i >= ncross) nearest_face(s, b, c, &nearest);
        if (push_corners(s, a, p, b, i < ncross ? -1 : nearest, middle, &nnode) || i >= ncross) continue;
        for (int h = 0; h < s->nhit; h++)
            for (int k = 0; k < 2; k++) {
                const cn_place mine = k ? s->hit[h].b : s->hit[h].a, other = k ? s->hit[h].a : s->hit[h].b;
                if (mine.surface == a && mine.triangle == t && other.surface == b)
                    push_pierced(s, mine, other, middle, &nnode);
            }
    }
    for (int i = 0; i < nnode; i++) {
        const anchor *at = &s->anchor[s->node[i]];
        cn_penalty_spring out = {
            .surface = a, .other = b, .node = s->node[i], .point = at->point, .depth = at->deepest};
        cn_copy3(at->sum, out.n);
        if (!(cn_normalise(out.n) > 0)) continue; /* pushed both ways alike */
        if (penalty->nspring == penalty->capacity) return false;
        penalty->spring[penalty->nspring++] = out;
    }
    return true;
}

static cn_status search(cn_penalty *penalty, const int *nfree, const double *x, cn_pool *pool)
{
    struct cn_penalty_scratch *s = penalty->scratch;
    s->nfree = nfree, s->x = x, s->nhit = 0, s->full = false;
    penalty->nspring = 0;
    cn_contact_refit(s->model, s->contact, nfree, x, NULL, 0, pool);
    cn_contact_space_at(s->model, s->contact, x);
    for (int p = 0; p < s->contact->npart; p++)
        cn_contact_visit(s->model, s->contact, nfree, p, 0, 0, note_crossing, s);
    return s->full ? CN_ERR_CONTACT : CN_OK;
}

cn_status cn_penalty_find(cn_penalty *penalty, const int *nfree, const double *x, cn_pool *pool)
{
    struct cn_penalty_scratch *s = penalty->scratch;
    const int n = s->model->nsurface;
    const cn_status status = search(penalty, nfree, x, pool);
    for (int a = 0; status == CN_OK && a < n; a++)
        for (int b = 0; b < n; b++)
            if (s->model->surface[a].body && nfree[a] > 0 && meet(s, a, b) && !push_away(penalty, a, b))
                return CN_ERR_CONTACT;
    return status;
}

cn_status cn_penalty_faces(cn_penalty *penalty, const int *nfree, const double *x, int a, int b, int *ncross,
                           int *nface, const int **face)
{
    double middle[3];
    const cn_status status = search(penalty, nfree, x, NULL);
    if (status != CN_OK) return status;
    penalty->scratch->nfree = nfree;
    middle_of(penalty->scratch, a, middle);
    *nface = faces_of(penalty->scratch, a, b, middle, ncross), *face = penalty->scratch->face;
    return CN_OK;
}

/* --- memory --- */

/* Triangles beyond each edge: of several at one edge each has the next. */
static cn_status neighbours_of(int **out, const cn_contact_surface *surface)
{
    const cn_collider *c = surface->collider;
    int *beyond = *out = malloc((3 * (size_t)c->ntri + 1) * sizeof *beyond);
    int *first = malloc(((size_t)c->nedge + 1) * sizeof *first);
    int *last = malloc(((size_t)c->nedge + 1) * sizeof *last);
    const bool ok = beyond && first && last;
    for (int e = 0; ok && e < c->nedge; e++)
        first[e] = -1;
    for (int i = 0; ok && i < 3 * c->ntri; i++) {
        const int e = c->tri_edge[i];
        beyond[i] = first[e] < 0 ? -1 : last[e];
        if (first[e] < 0) first[e] = i;
        last[e] = i / 3;
    }
    for (int e = 0; ok && e < c->nedge; e++)
        if (first[e] >= 0 && last[e] != first[e] / 3) beyond[first[e]] = last[e];
    free(first), free(last);
    return ok ? CN_OK : CN_ERR_MEMORY;
}

static cn_status scratch_memory(struct cn_penalty_scratch *s)
{
    const cn_contact_model *model = s->model;
    size_t ntri = 1, nnode = 1;
    cn_status status;
    s->neighbour = calloc((size_t)model->nsurface + 1, sizeof *s->neighbour);
    s->seen = calloc((size_t)model->nsurface + 1, sizeof *s->seen);
    s->hit = malloc((size_t)s->hit_capacity * sizeof *s->hit);
    if (!s->neighbour || !s->seen || !s->hit) return CN_ERR_MEMORY;
    for (int i = 0; i < model->nsurface; i++) {
        const cn_contact_surface *surface = &model->surface[i];
        ntri = (size_t)surface->ntri > ntri ? (size_t)surface->ntri : ntri;
        if (surface->body && (size_t)surface->body->nnode > nnode) nnode = (size_t)surface->body->nnode;
        if (!(s->seen[i] = calloc((size_t)surface->ntri + 1, sizeof **s->seen))) return CN_ERR_MEMORY;
        if ((status = neighbours_of(&s->neighbour[i], surface)) != CN_OK) return status;
    }
    s->face = malloc(ntri * sizeof *s->face);
    s->node = malloc(nnode * sizeof *s->node);
    s->anchor = calloc(nnode, sizeof *s->anchor);
    return s->face && s->node && s->anchor ? CN_OK : CN_ERR_MEMORY;
}

cn_status cn_penalty_new(cn_penalty **out, const cn_contact_model *model, cn_contact *contact)
{
    cn_penalty *penalty = calloc(1, sizeof *penalty);
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!penalty) return CN_ERR_MEMORY;
    penalty->capacity = 1024;
    penalty->spring = malloc((size_t)penalty->capacity * sizeof *penalty->spring);
    penalty->link = malloc((size_t)penalty->capacity * sizeof *penalty->link);
    if ((penalty->scratch = calloc(1, sizeof *penalty->scratch))) {
        penalty->scratch->model = model, penalty->scratch->contact = contact;
        penalty->scratch->hit_capacity = 4096;
        status = scratch_memory(penalty->scratch);
    }
    if (penalty->spring && penalty->link && status == CN_OK) {
        *out = penalty;
        return CN_OK;
    }
    cn_penalty_free(penalty);
    return CN_ERR_MEMORY;
}

void cn_penalty_free(cn_penalty *penalty)
{
    if (!penalty) return;
    struct cn_penalty_scratch *s = penalty->scratch;
    for (int i = 0; s && i < s->model->nsurface; i++) {
        if (s->neighbour) free(s->neighbour[i]);
        if (s->seen) free(s->seen[i]);
    }
    if (s) {
        free(s->neighbour), free(s->seen), free(s->hit);
        free(s->face), free(s->node), free(s->anchor), free(s);
    }
    free(penalty->spring), free(penalty->link);
    free(penalty);
}

cn_status cn_penalty_grow(cn_penalty *penalty)
{
    struct cn_penalty_scratch *s = penalty->scratch;
    cn_penalty_spring *spring = realloc(penalty->spring, 4 * (size_t)penalty->capacity * sizeof *spring);
    if (spring) penalty->spring = spring;
    cn_link *link = realloc(penalty->link, 4 * (size_t)penalty->capacity * sizeof *link);
    if (link) penalty->link = link;
    if (!spring || !link) return CN_ERR_MEMORY;
    penalty->capacity *= 4;
    hit *more = realloc(s->hit, 4 * (size_t)s->hit_capacity * sizeof *more);
    if (!more) return CN_ERR_MEMORY;
    s->hit = more, s->hit_capacity *= 4;
    return CN_OK;
}
