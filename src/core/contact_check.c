/* contact_check.c - what an accepted state looks like, by tests that share nothing with the response. */
#include "contact_parts.h"

#include <math.h>
#include <stddef.h>
#include "geometry.h"

static const cn_findings NOTHING = {.surface = {-1, -1}, .triangle = {-1, -1}, .where = {NAN, NAN, NAN}};

typedef struct {
    const cn_contact_model *model;
    cn_contact *contact;
    const double *x, *axis;
    const int *nfree;
    int naxis;
    cn_findings *found; /* of the task */
} check;

/* True where one of the axes square to a plane or, in it, to an edge parts the triangles by far more than
 * rounding: what lies in one plane costs the exact test most. */
static bool clearly_apart(const double a[3][3], const double b[3][3])
{
    double axis[4][3], e[3], size = 0;
    for (int k = 0; k < 9; k++) {
        size = fmax(size, fabs(a[k / 3][k % 3] - a[0][k % 3]));
        size = fmax(size, fabs(b[k / 3][k % 3] - a[0][k % 3]));
    }
    cn_sub(a[1], a[0], axis[1]), cn_sub(a[2], a[0], e);
    cn_cross(axis[1], e, axis[0]);
    for (int k = 0; k < 3; k++) {
        cn_sub(a[(k + 1) % 3], a[k], e);
        cn_cross(axis[0], e, axis[1 + k]);
    }
    for (int i = 0; i < 4; i++) {
        double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
        for (int k = 0; k < 6; k++) {
            cn_sub(k < 3 ? a[k] : b[k - 3], a[0], e);
            const double h = cn_dot(axis[i], e);
            low[k / 3] = fmin(low[k / 3], h), high[k / 3] = fmax(high[k / 3], h);
        }
        const double gap = fmax(low[1] - high[0], low[0] - high[1]);
        if (gap > 1e-12 * size * cn_norm(axis[i])) return true;
    }
    return false;
}

static bool count_crossing(void *user, cn_place a, cn_place b)
{
    check *s = user;
    int p[3], q[3];
    double ta[3][3], tb[3][3];
    if (!cn_triangle_points(&s->model->surface[a.surface], s->nfree[a.surface], a.triangle, p)) return true;
    if (!cn_triangle_points(&s->model->surface[b.surface], s->nfree[b.surface], b.triangle, q)) return true;
    if (a.surface == b.surface && cn_share_a_point(p, q)) return true;
    cn_corners(p, s->x, ta), cn_corners(q, s->x, tb);
    const double(*const ca)[3] = (const double(*)[3])ta, (*const cb)[3] = (const double(*)[3])tb;
    if (clearly_apart(ca, cb) || clearly_apart(cb, ca)) return true;
    if (cn_tri_tri(ca, cb) == CN_TRI_APART) return true;
    cn_findings *f = s->found;
    if (!f->intersections++) {
        f->surface[0] = a.surface, f->surface[1] = b.surface;
        f->triangle[0] = a.triangle, f->triangle[1] = b.triangle;
        cn_copy3(ta[0], f->where);
    }
    return true;
}

static void count_outside(const check *s, int begin, int end, const double *x)
{
    cn_findings *f = s->found;
    for (int i = begin; i < end; i++) {
        const double *p = x + 3 * (size_t)i;
        if (cn_contact_is_free(s->model, s->contact, p)) continue;
        const double depth = cn_contact_wall_distance(s->model, s->contact, p);
        if (!f->outside++ && !f->intersections) cn_copy3(p, f->where);
        f->depth = depth > f->depth ? depth : f->depth;
    }
}

/* Of a body wholly inside another no triangles cross: its first point tells. */
static void count_swallowed(const cn_contact_model *model, const cn_contact *contact, const int *nfree,
                            const double *x, cn_findings *f)
{
    for (int s = 0; s < model->nsurface; s++)
        for (int t = 0; t < model->nsurface; t++) {
            const cn_contact_surface *surface = &model->surface[s];
            const double *p = x + 3 * (size_t)surface->first;
            if (s == t || !surface->body || nfree[s] == 0 || nfree[t] < model->surface[t].npoint) continue;
            const double depth = cn_contact_depth_in(model, contact, t, p);
            if (!(depth > 0)) continue;
            if (!f->outside++ && !f->intersections) cn_copy3(p, f->where);
            f->depth = fmax(f->depth, depth);
        }
}

static int share(int n, int part, int parts)
{
    return (int)((long)n * part / parts);
}

/* Task p: the crossings of part p and its share of the points. */
static void check_part(void *user, int p)
{
    check s = *(const check *)user;
    const int parts = s.contact->npart;
    s.found = &s.contact->found[p];
    *s.found = NOTHING;
    cn_contact_visit(s.model, s.contact, s.nfree, p, 0, 0, count_crossing, &s);
    for (int i = 0; i < s.model->nsurface; i++) {
        const cn_contact_surface *surface = &s.model->surface[i];
        if (!surface->body || surface->wall >= 0) continue;
        const double *x = s.x + 3 * (size_t)surface->first;
        count_outside(&s, share(s.nfree[i], p, parts), share(s.nfree[i], p + 1, parts), x);
    }
    count_outside(&s, share(s.naxis, p, parts), share(s.naxis, p + 1, parts), s.axis);
}

cn_status cn_contact_check(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                           const double *x, int naxis, const double *axis, cn_findings *findings,
                           cn_pool *pool)
{
    check s = {.model = model, .contact = contact, .x = x, .axis = axis, .nfree = nfree, .naxis = naxis};
    bool any = false;
    *findings = NOTHING;
    for (int i = 0; i < model->nsurface; i++)
        any = any || (model->surface[i].body && nfree[i] > 0);
    if (!any) return CN_OK;
    cn_contact_refit(model, contact, nfree, x, NULL, 0, pool);
    cn_contact_space_at(model, contact, x);
    cn_pool_run(pool, contact->npart, check_part, &s);
    for (int p = 0; p < contact->npart; p++) {
        const cn_findings *f = &contact->found[p];
        if ((f->intersections && !findings->intersections) ||
            (f->outside && !findings->outside && !findings->intersections)) {
            for (int k = 0; k < 2; k++)
                findings->surface[k] = f->surface[k], findings->triangle[k] = f->triangle[k];
            cn_copy3(f->where, findings->where);
        }
        findings->intersections += f->intersections, findings->outside += f->outside;
        findings->depth = fmax(findings->depth, f->depth);
    }
    count_swallowed(model, contact, nfree, x, findings);
    return CN_OK;
}
