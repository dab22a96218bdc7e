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
    cn_contact *contact;
    const double *x, *axis;
    int nfree, naxis, part, wall;
    cn_findings *found; /* per task */
} check;

static bool count_crossing(void *user, int ia, int ib)
{
    check *s = user;
    ia += s->contact->part[s->part].first;
    const int *a = s->model->collider->tri + 3 * ia;
    const cn_surface *wall = s->model->world->wall[s->wall].surface;
    double ta[3][3], tb[3][3];
    if (a[0] >= s->nfree || a[1] >= s->nfree || a[2] >= s->nfree) return true;
    corners(a, s->x, ta), corners(wall->tri + 3 * ib, wall->vert, tb);
    if (cn_tri_tri((const double(*)[3])ta, (const double(*)[3])tb) == CN_TRI_APART) return true;
    cn_findings *f = s->found;
    if (!f->intersections++) {
        f->body_triangle = ia, f->wall = s->wall, f->wall_triangle = ib;
        cn_copy3(ta[0], f->where);
    }
    return true;
}

static void count_outside(const cn_world *world, int begin, int end, const double *x, cn_findings *findings)
{
    for (int i = begin; i < end; i++) {
        const double *p = x + 3 * i;
        if (cn_world_free_fast(world, p)) continue;
        const double depth = cn_world_distance(world, p, NULL, NULL, NULL);
        if (!findings->outside++ && !findings->intersections) cn_copy3(p, findings->where);
        findings->depth = depth > findings->depth ? depth : findings->depth;
    }
}

/* Task p: the crossings of part p and its share of the points. */
static void check_part(void *user, int p)
{
    const check *all = user;
    check s = *all;
    const long parts = s.contact->npart;
    s.part = p, s.found = all->found + p;
    *s.found = (cn_findings){.body_triangle = -1, .wall = -1, .wall_triangle = -1, .where = {NAN, NAN, NAN}};
    if (s.contact->part[p].lowest < s.nfree) {
        cn_tree_refit(s.contact->part[p].tree, s.x);
        for (s.wall = 0; s.wall < s.model->world->nwall; s.wall++)
            cn_tree_query_pairs(s.contact->part[p].tree, s.model->world->wall[s.wall].tree, 0, count_crossing,
                                &s);
    }
    count_outside(s.model->world, (int)(s.nfree * p / parts), (int)(s.nfree * (p + 1) / parts), s.x, s.found);
    count_outside(s.model->world, (int)(s.naxis * p / parts), (int)(s.naxis * (p + 1) / parts), s.axis,
                  s.found);
}

cn_status cn_contact_check(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                           int naxis, const double *axis, cn_findings *findings, cn_pool *pool)
{
    check s = {.model = model, .contact = contact, .x = x, .axis = axis, .nfree = nfree, .naxis = naxis};
    *findings = (cn_findings){.body_triangle = -1, .wall = -1, .wall_triangle = -1, .where = {NAN, NAN, NAN}};
    if (nfree == 0) return CN_OK;
    s.found = contact->found;
    cn_pool_run(pool, contact->npart, check_part, &s);
    for (int p = 0; p < contact->npart; p++) {
        const cn_findings *f = &contact->found[p];
        if ((f->intersections && !findings->intersections) ||
            (f->outside && !findings->outside && !findings->intersections)) {
            findings->body_triangle = f->body_triangle, findings->wall = f->wall;
            findings->wall_triangle = f->wall_triangle;
            cn_copy3(f->where, findings->where);
        }
        findings->intersections += f->intersections, findings->outside += f->outside;
        findings->depth = fmax(findings->depth, f->depth);
    }
    return CN_OK;
}

typedef struct {
    const cn_contact_model *model;
    double *x, *v;
    int nfree, first, wall, left;
    double bounce; /* 0: the normal velocity is lost; e: it reverses times e */
} projection;

/* Moves the corners of the body's triangle that lie behind the wall triangle's plane in front of it. */
static bool push_apart(void *user, int ia, int ib)
{
    projection *p = user;
    ia += p->first;
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
        for (int i = 0; i < contact->npart; i++) {
            cn_contact_part *part = &contact->part[i];
            if (part->lowest >= nfree) continue;
            p.first = part->first;
            cn_tree_refit(part->tree, x);
            for (p.wall = 0; p.wall < model->world->nwall; p.wall++)
                cn_tree_query_pairs(part->tree, model->world->wall[p.wall].tree, model->gap, push_apart, &p);
        }
        if (p.left == 0) break;
    }
    return p.left;
}
