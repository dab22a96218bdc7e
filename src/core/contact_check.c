/* contact_check.c - what an accepted state looks like, by tests that share nothing with the response; and the
 * first paper's response, which works on what they find. */
#include "contact.h"

#include <math.h>
#include <stddef.h>
#include "catnav/vec3.h"
#include "geometry.h"

static void corners(const int *tri, const double *x, double out[3][3])
{
    for (int k = 0; k < 3; k++)
        cn_copy3(x + 3 * tri[k], out[k]);
}

typedef struct {
    const cn_contact_model *model;
    const double *x;
    int nfree, wall;
    cn_findings *findings;
} crossing_search;

static bool count_crossing(void *user, int ia, int ib)
{
    crossing_search *s = user;
    const int *a = s->model->collider->tri + 3 * ia;
    const cn_surface *wall = s->model->world->wall[s->wall].surface;
    double ta[3][3], tb[3][3];
    if (a[0] >= s->nfree || a[1] >= s->nfree || a[2] >= s->nfree) return true;
    corners(a, s->x, ta), corners(wall->tri + 3 * ib, wall->vert, tb);
    if (cn_tri_tri((const double(*)[3])ta, (const double(*)[3])tb) == CN_TRI_APART) return true;
    cn_findings *f = s->findings;
    if (!f->intersections++) {
        f->body_triangle = ia, f->wall = s->wall, f->wall_triangle = ib;
        cn_copy3(ta[0], f->where);
    }
    return true;
}

static void count_outside(const cn_world *world, int n, const double *x, cn_findings *findings)
{
    for (int i = 0; i < n; i++) {
        const double *p = x + 3 * i;
        if (cn_world_free_fast(world, p)) continue;
        const double depth = cn_world_distance(world, p, NULL, NULL, NULL);
        if (!findings->outside++ && !findings->intersections) cn_copy3(p, findings->where);
        findings->depth = depth > findings->depth ? depth : findings->depth;
    }
}

cn_status cn_contact_check(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                           int naxis, const double *axis, cn_findings *findings, cn_pool *pool)
{
    crossing_search s = {.model = model, .x = x, .nfree = nfree, .findings = findings};
    (void)pool;
    *findings = (cn_findings){.body_triangle = -1, .wall = -1, .wall_triangle = -1, .where = {NAN, NAN, NAN}};
    if (nfree == 0) return CN_OK;
    cn_tree_refit(contact->tree, x);
    for (s.wall = 0; s.wall < model->world->nwall; s.wall++)
        cn_tree_query_pairs(contact->tree, model->world->wall[s.wall].tree, 0, count_crossing, &s);
    count_outside(model->world, nfree, x, findings);
    count_outside(model->world, naxis, axis, findings);
    return CN_OK;
}

typedef struct {
    const cn_contact_model *model;
    double *x, *v;
    int nfree, wall, left;
    double bounce; /* 0: the normal velocity is lost; e: it reverses times e */
} projection;

/* Moves the corners of the body's triangle that lie behind the wall triangle's plane in front of it. */
static bool push_apart(void *user, int ia, int ib)
{
    projection *p = user;
    const int *a = p->model->collider->tri + 3 * ia;
    const cn_wall *wall = &p->model->world->wall[p->wall];
    double ta[3][3], tb[3][3], e1[3], e2[3], normal[3];
    if (a[0] >= p->nfree || a[1] >= p->nfree || a[2] >= p->nfree) return true;
    corners(a, p->x, ta), corners(wall->surface->tri + 3 * ib, wall->surface->vert, tb);
    if (cn_tri_tri((const double(*)[3])ta, (const double(*)[3])tb) == CN_TRI_APART) return true;
    p->left++;
    cn_sub(tb[1], tb[0], e1), cn_sub(tb[2], tb[0], e2);
    cn_cross(e1, e2, normal);
    if (!(cn_normalise(normal) > 0)) return true;
    if (wall->vessel) /* the free side is inside */
        for (int k = 0; k < 3; k++)
            normal[k] = -normal[k];
    const double clear = 1e-3 * p->model->gap;
    for (int k = 0; k < 3; k++) {
        double from[3];
        cn_sub(ta[k], tb[0], from);
        const double depth = clear - cn_dot(from, normal);
        if (depth <= 0) continue;
        cn_axpy(depth, normal, p->x + 3 * a[k]);
        const double speed = cn_dot(p->v + 3 * a[k], normal);
        if (speed < 0) cn_axpy(-(1 + p->bounce) * speed, normal, p->v + 3 * a[k]);
    }
    return true;
}

int cn_contact_project(const cn_contact_model *model, cn_contact *contact, int nfree, double *x, double *v,
                       cn_response response, double restitution, int passes)
{
    projection p = {.model = model, .x = x, .v = v, .nfree = nfree};
    p.bounce = response == CN_RESPONSE_ELASTIC ? restitution : 0;
    for (int pass = 0; pass < passes; pass++) {
        p.left = 0;
        cn_tree_refit(contact->tree, x);
        for (p.wall = 0; p.wall < model->world->nwall; p.wall++)
            cn_tree_query_pairs(contact->tree, model->world->wall[p.wall].tree, model->gap, push_apart, &p);
        if (p.left == 0) break;
    }
    return p.left;
}
