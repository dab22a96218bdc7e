/* contact_project.c - the first paper's response (Moss et al. 2008, 4.4), which works on what the exact test
 * of triangle pairs finds. */
#include "contact_parts.h"

#include <math.h>
#include <stddef.h>
#include "geometry.h"

typedef struct {
    const cn_contact_model *model;
    const int *nfree;
    const double *mass;
    double *x, *v;
    int left;
    double bounce; /* 0: the normal velocity is lost; e: it reverses times e */
} projection;

/* Unit normal of a triangle into its free side: a vessel's is inside. */
static bool free_normal(const projection *p, const cn_contact_surface *surface, const int t[3],
                        double normal[3])
{
    double q[3][3], e1[3], e2[3];
    cn_corners(t, p->x, q);
    cn_sub(q[1], q[0], e1), cn_sub(q[2], q[0], e2);
    cn_cross(e1, e2, normal);
    if (!(cn_normalise(normal) > 0)) return false;
    const double sign = surface->wall >= 0 && p->model->world->wall[surface->wall].vessel ? -1 : 1;
    for (int k = 0; k < 3; k++)
        normal[k] *= sign;
    return true;
}

static double depth_below(const projection *p, int node, const int t[3], const double normal[3], double clear)
{
    double from[3];
    cn_sub(p->x + 3 * (size_t)node, p->x + 3 * (size_t)t[0], from);
    return clear - cn_dot(from, normal);
}

/* Moves a node and the triangle below which it lies apart along the normal, in the ratio of what resists:
 * dx_i = share w_i / m_i, w = (1, -bary), keeps the centre of mass. */
static void part(projection *p, int node, const int t[3], const double normal[3], double clear)
{
    const double depth = depth_below(p, node, t, normal, clear);
    const int point[4] = {node, t[0], t[1], t[2]};
    double q[3][3], bary[3], w[4] = {1, 0, 0, 0}, give[4], sum = 0, speed = 0;
    if (!(depth > 0)) return;
    cn_corners(t, p->x, q);
    cn_point_triangle(p->x + 3 * (size_t)node, q[0], q[1], q[2], bary);
    for (int i = 0; i < 4; i++) {
        if (i) w[i] = -bary[i - 1];
        give[i] = w[i] / p->mass[point[i]];
        sum += w[i] * give[i];
        speed += w[i] * cn_dot(p->v + 3 * (size_t)point[i], normal);
    }
    if (!(sum > 0)) return;
    for (int i = 0; i < 4; i++) {
        cn_axpy(depth / sum * give[i], normal, p->x + 3 * (size_t)point[i]);
        if (speed < 0) cn_axpy(-(1 + p->bounce) * speed / sum * give[i], normal, p->v + 3 * (size_t)point[i]);
    }
}

/* Deepest corner of triangle a below the plane of b. */
static double deepest(const projection *p, const int a[3], const int b[3], const double normal[3],
                      double clear)
{
    double most = 0;
    for (int k = 0; k < 3; k++)
        most = fmax(most, depth_below(p, a[k], b, normal, clear));
    return most;
}

/* Parts two triangles that cross: corners go before the plane of a rigid one, else of that which asks for the
 * shorter way. */
static bool push_apart(void *user, cn_place place_a, cn_place place_b)
{
    projection *p = user;
    const cn_contact_surface *sa = &p->model->surface[place_a.surface];
    const cn_contact_surface *sb = &p->model->surface[place_b.surface];
    int a[3], b[3];
    double ta[3][3], tb[3][3], na[3], nb[3];
    if (!cn_triangle_points(sa, p->nfree[place_a.surface], place_a.triangle, a)) return true;
    if (!cn_triangle_points(sb, p->nfree[place_b.surface], place_b.triangle, b)) return true;
    if (sa == sb && cn_share_a_point(a, b)) return true;
    cn_corners(a, p->x, ta), cn_corners(b, p->x, tb);
    if (cn_tri_tri((const double(*)[3])ta, (const double(*)[3])tb) == CN_TRI_APART) return true;
    p->left++;
    const double clear = 1e-3 * p->model->gap;
    const bool by_b = free_normal(p, sb, b, nb), by_a = free_normal(p, sa, a, na);
    bool choose_b = sb->body == NULL;
    if (sa->body && sb->body)
        choose_b = by_b && (!by_a || deepest(p, a, b, nb, clear) <= deepest(p, b, a, na, clear));
    if (!(choose_b ? by_b : by_a)) return true;
    for (int k = 0; k < 3; k++)
        part(p, choose_b ? a[k] : b[k], choose_b ? b : a, choose_b ? nb : na, clear);
    return true;
}

int cn_contact_project(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                       const double *mass, double *x, double *v, cn_response response, double restitution,
                       int passes)
{
    projection p = {.model = model, .nfree = nfree, .mass = mass, .x = x, .v = v};
    p.bounce = response == CN_RESPONSE_ELASTIC ? restitution : 0;
    for (int pass = 0; pass < passes; pass++) {
        p.left = 0;
        cn_contact_refit(model, contact, nfree, x, NULL, 0, NULL);
        for (int i = 0; i < contact->npart; i++)
            cn_contact_visit(model, contact, nfree, i, model->gap, model->gap, push_apart, &p);
        if (p.left == 0) break;
    }
    return p.left;
}
