/* contact_parts.h - what the files of the contact's room share. */
#ifndef CN_CONTACT_PARTS_H
#define CN_CONTACT_PARTS_H

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"
#include "contact.h"

static inline bool cn_contact_rests(const cn_contact_surface *surface)
{
    return !surface->body && !surface->moving;
}

/* Whether two surfaces are tested against each other: neither two that do not give way, nor two vessels,
 * whose union is what is free. */
static inline bool cn_contact_meet(const cn_contact_model *model, int s, int t)
{
    const cn_contact_surface *a = &model->surface[s], *b = &model->surface[t];
    if (s == t) return a->self;
    if (!a->body && !b->body) return false;
    return a->wall < 0 || b->wall < 0 || a->wall >= model->world->nvessel || b->wall >= model->world->nvessel;
}

/* Leading points of the surface that take part: all of a wall's. */
static inline int cn_contact_nfree(const cn_contact_surface *surface, int nfree)
{
    return surface->body ? nfree : surface->npoint;
}

/* Points of the pair's first side. */
static inline int cn_pair_nside(const cn_pair *pair)
{
    return pair->kind == CN_PAIR_NODE_TRIANGLE ? 1 : 2;
}

/* True where the triangle's corners all take part; its points in p. */
static inline bool cn_triangle_points(const cn_contact_surface *surface, int nfree, int triangle, int p[3])
{
    const int *tri = surface->tri + 3 * triangle, n = cn_contact_nfree(surface, nfree);
    for (int k = 0; k < 3; k++)
        p[k] = surface->first + tri[k];
    return tri[0] < n && tri[1] < n && tri[2] < n;
}

static inline void cn_corners(const int p[3], const double *x, double out[3][3])
{
    for (int k = 0; k < 3; k++)
        cn_copy3(x + 3 * (size_t)p[k], out[k]);
}

static inline bool cn_share_a_point(const int a[3], const int b[3])
{
    for (int k = 0; k < 9; k++)
        if (a[k / 3] == b[k % 3]) return true;
    return false;
}

/* How the pair's points have moved: u - from (from NULL: u itself), nothing at surfaces that rest; and the
 * most that points of the two sides have moved against each other. */
static inline double cn_pair_motion(const cn_contact_model *model, const cn_pair *pair, const double *u,
                                    const double *from, double d[4][3])
{
    const int n = cn_pair_nside(pair);
    bool rests[2];
    double most = 0;
    for (int k = 0; k < 2; k++)
        rests[k] = cn_contact_rests(&model->surface[pair->surface[k]]);
    for (int i = 0; i < 4; i++) {
        d[i][0] = d[i][1] = d[i][2] = 0;
        if (rests[i >= n]) continue;
        cn_copy3(u + 3 * (size_t)pair->p[i], d[i]);
        if (from) cn_sub(d[i], from + 3 * (size_t)pair->p[i], d[i]);
    }
    for (int i = 0; i < (rests[0] ? 1 : n); i++)
        for (int j = n; j < (rests[1] ? n + 1 : 4); j++) {
            double against[3];
            cn_sub(d[i], d[j], against);
            const double square = cn_norm2(against);
            if (!(square <= most)) most = square; /* keeps a NaN */
        }
    return sqrt(most);
}

/* Copies the positions of all surfaces that move. */
static inline void cn_contact_note(const cn_contact_model *model, double *out, const double *x)
{
    for (int s = 0; s < model->nsurface; s++) {
        const cn_contact_surface *surface = &model->surface[s];
        const size_t first = 3 * (size_t)surface->first;
        if (!cn_contact_rests(surface))
            memcpy(out + first, x + first, 3 * (size_t)surface->npoint * sizeof *x);
    }
}

/* A surface's triangle. */
typedef struct {
    int surface, triangle;
} cn_place;

/* Two triangles whose boxes meet; false stops the walk. */
typedef bool (*cn_triangle_visit)(void *user, cn_place a, cn_place b);
/* All triangle pairs of part p with the resting walls, with the parts of later surfaces and, of a surface
 * that is tested against itself, with its later parts and its own: each pair of triangles once, over all
 * parts. The trees are as they were last refitted; the part's boxes are inflated by margin, against walls by
 * wall_margin. */
void cn_contact_visit(const cn_contact_model *model, const cn_contact *contact, const int *nfree, int p,
                      double wall_margin, double margin, cn_triangle_visit visit, void *user);
/* Refits the trees of all parts that take part: to x, or swept from x to end and inflated by margin. */
void cn_contact_refit(const cn_contact_model *model, cn_contact *contact, const int *nfree, const double *x,
                      const double *end, double margin, cn_pool *pool);

/* Distances of all pairs at x; unless `all`, lower bounds where they are beyond gap_listed. */
void cn_contact_measure(const cn_contact_model *model, cn_contact *contact, const double *x, bool all,
                        cn_pool *pool);

/* Where and how hard the barrier pushes a pair: weights and normal as in contact_barrier.c, force >= 0 [N];
 * false where it does not, or where neighbours in a flat wall do it. */
bool cn_pair_press(const cn_contact_model *model, const cn_pair *pair, const double *x, double w[4],
                   double n[3], double *force);
/* Adds the stiffness h between a surface's points i and j: J' h J by the blocks they hang on, J = (I, arm).
 */
void cn_contact_stiffen(const cn_hang *hang, int i, int j, const double h[9]);
/* Adds a link's stiffness: all of it to the matrix of the one side that gives way, where its pattern takes
 * it; else each side's own blocks of k j j' to their matrices, and the link to the list. */
void cn_contact_join(const cn_contact_model *model, cn_contact *contact, const cn_link *link,
                     const cn_hang *hang);

/* The free space as the walls lie at x. Where all rest it is the world's. */
cn_status cn_contact_space_new(struct cn_contact_space **out, const cn_contact_model *model,
                               const cn_contact *contact);
void cn_contact_space_free(struct cn_contact_space *space);
/* Takes the walls to x (npoint x 3), which the parts' trees are fitted to; what follows asks about there. */
void cn_contact_space_at(const cn_contact_model *model, cn_contact *contact, const double *x);
bool cn_contact_is_free(const cn_contact_model *model, const cn_contact *contact, const double p[3]);
/* True where p is on the wrong side of a surface that has one: inside a body or a closed obstacle, behind a
 * plane, outside all vessels. */
bool cn_contact_behind(const cn_contact_model *model, const cn_contact *contact, int surface,
                       const double p[3]);
/* Distance to the nearest wall [m]. */
double cn_contact_wall_distance(const cn_contact_model *model, const cn_contact *contact, const double p[3]);
/* How deep p is inside a body that is no wall [m]; 0: it is not. */
double cn_contact_depth_in(const cn_contact_model *model, const cn_contact *contact, int surface,
                           const double p[3]);

#endif
