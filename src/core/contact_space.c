/* contact_space.c - where the free space is while walls bend and move.
 *
 * A wall that deforms is asked by its own triangles as they lie now, its caps' rims with them; one that
 * moves, which it does without turning, in its own frame; one that rests, as the world does. Where the map's
 * clearance is more than any wall has moved, what was free at the start still is. */
#include "contact_parts.h"

#include <stdlib.h>
#include "world.h"

/* A wall of the world. */
typedef struct {
    int surface;
    double shift[3]; /* of one that moves [m] */
    bool deforms;
    int *point;   /* its point at each vertex of the caps that is on a rim, else -1 (caps->nvert) */
    double *vert; /* caps as they lie now (caps->nvert x 3) */
    double (*cap)[7];
    cn_tree *caps;
} wall_now;

struct cn_contact_space {
    const cn_tree **tree; /* of all parts, those of a surface in a row (npart) */
    int *first;           /* its first one (nsurface + 1) */
    int nwall;
    wall_now *wall;
    bool rests;  /* all of them */
    double most; /* the farthest any of their points has moved [m] */
};

static int nearest_point(const cn_contact_surface *surface, const double p[3])
{
    int best = -1;
    double least = INFINITY;
    for (int i = 0; i < surface->npoint; i++) {
        const double d = cn_distance(surface->rest + 3 * i, p);
        if (d < least) least = d, best = i;
    }
    return best;
}

static cn_status deforming(wall_now *out, const cn_wall *wall, const cn_contact_surface *surface)
{
    const cn_surface *caps = wall->caps;
    const size_t nvert = caps ? (size_t)caps->nvert : 0;
    out->deforms = true;
    if (!caps) return CN_OK;
    out->point = malloc(nvert * sizeof *out->point);
    out->vert = malloc(3 * nvert * sizeof *out->vert);
    out->cap = malloc((size_t)wall->ncap * sizeof *out->cap);
    if (!out->point || !out->vert || !out->cap) return CN_ERR_MEMORY;
    memcpy(out->vert, caps->vert, 3 * nvert * sizeof *out->vert);
    for (size_t v = 0; v < nvert; v++)
        out->point[v] = -1;
    for (int c = 0; c < 3 * caps->ntri; c++) {
        const int v = caps->tri[c];
        if (c % 3 && out->point[v] < 0) out->point[v] = nearest_point(surface, caps->vert + 3 * (size_t)v);
    }
    return cn_tree_new(&out->caps, caps->ntri, caps->tri, out->vert);
}

cn_status cn_contact_space_new(struct cn_contact_space **out, const cn_contact_model *model,
                               const cn_contact *contact)
{
    const cn_world *world = model->world;
    struct cn_contact_space *space = calloc(1, sizeof *space);
    cn_status status = CN_OK;
    *out = NULL;
    if (!space) return CN_ERR_MEMORY;
    space->rests = true, space->nwall = world->nwall;
    space->wall = calloc((size_t)world->nwall + 1, sizeof *space->wall);
    space->tree = malloc(((size_t)contact->npart + 1) * sizeof *space->tree);
    space->first = calloc((size_t)model->nsurface + 1, sizeof *space->first);
    if (!space->wall || !space->tree || !space->first) status = CN_ERR_MEMORY;
    for (int p = 0; p < contact->npart && status == CN_OK; p++) {
        space->tree[p] = contact->part[p].tree;
        for (int s = contact->part[p].surface; s < model->nsurface; s++)
            space->first[s + 1]++;
    }
    for (int s = 0; s < model->nsurface && status == CN_OK; s++) {
        const cn_contact_surface *surface = &model->surface[s];
        if (surface->wall < 0) continue;
        wall_now *wall = &space->wall[surface->wall];
        wall->surface = s;
        space->rests = space->rests && cn_contact_rests(surface);
        if (surface->body) status = deforming(wall, &world->wall[surface->wall], surface);
    }
    if (status == CN_OK)
        *out = space;
    else
        cn_contact_space_free(space);
    return status;
}

void cn_contact_space_free(struct cn_contact_space *space)
{
    if (!space) return;
    for (int w = 0; space->wall && w < space->nwall; w++) {
        wall_now *wall = &space->wall[w];
        cn_tree_free(wall->caps);
        free(wall->point), free(wall->vert), free(wall->cap);
    }
    free(space->wall), free(space->tree), free(space->first);
    free(space);
}

void cn_contact_space_at(const cn_contact_model *model, cn_contact *contact, const double *x)
{
    struct cn_contact_space *space = contact->space;
    double most = 0;
    for (int w = 0; w < space->nwall && !space->rests; w++) {
        wall_now *wall = &space->wall[w];
        const cn_contact_surface *surface = &model->surface[wall->surface];
        const double *now = x + 3 * (size_t)surface->first;
        if (surface->moving) cn_sub(now, surface->rest, wall->shift);
        for (int i = 0; wall->deforms && i < surface->npoint; i++)
            most = fmax(most, cn_distance(now + 3 * i, surface->rest + 3 * i));
        if (!wall->caps) continue;
        const cn_wall *given = &model->world->wall[w];
        for (int v = 0; v < given->caps->nvert; v++)
            if (wall->point[v] >= 0) cn_copy3(now + 3 * wall->point[v], wall->vert + 3 * v);
        cn_wall_measure_caps(given, wall->vert, wall->cap);
        cn_tree_refit(wall->caps, wall->vert);
    }
    space->most = most;
}

static bool inside_surface(const struct cn_contact_space *space, int surface, const cn_tree *caps,
                           const double p[3])
{
    const int first = space->first[surface];
    return cn_tree_inside_all(space->first[surface + 1] - first, space->tree + first, caps, p);
}

/* Inside a vessel or its corridors, or inside a closed obstacle. */
static bool inside(const struct cn_contact_space *space, const cn_world *world, int w, const double p[3])
{
    const cn_wall *given = &world->wall[w];
    const wall_now *wall = &space->wall[w];
    double q[3];
    if (wall->deforms)
        return (given->vessel && cn_cap_corridor(given->ncap, wall->cap, p)) ||
               inside_surface(space, wall->surface, wall->caps, p);
    cn_sub(p, wall->shift, q);
    return (given->vessel && cn_cap_corridor(given->ncap, given->cap, q)) ||
           cn_tree_inside(given->tree, given->cap_tree, q);
}

static bool behind(const cn_wall *given, const wall_now *wall, const double p[3])
{
    double d[3];
    if (!given->half_space || wall->deforms) return false;
    cn_sub(p, given->plane, d), cn_sub(d, wall->shift, d);
    return !(cn_dot(d, given->plane + 3) > 0);
}

bool cn_contact_is_free(const cn_contact_model *model, const cn_contact *contact, const double p[3])
{
    const cn_world *world = model->world;
    const struct cn_contact_space *space = contact->space;
    if (space->rests) return cn_world_free_fast(world, p);
    if (!isfinite(cn_norm2(p))) return false;
    for (int w = 0; w < world->nwall; w++)
        if (behind(&world->wall[w], &space->wall[w], p)) return false;
    for (int w = world->nvessel; w < world->nwall; w++) /* the map knows nothing of what goes along a path */
        if (model->surface[space->wall[w].surface].moving && world->wall[w].closed &&
            inside(space, world, w, p))
            return false;
    if (world->map && cn_map_clearance(world->map, p) > space->most) return true;
    bool in = world->nvessel == 0;
    for (int w = 0; w < world->nvessel && !in; w++)
        in = inside(space, world, w, p);
    for (int w = world->nvessel; w < world->nwall && in; w++)
        in = !world->wall[w].closed || !inside(space, world, w, p);
    return in;
}

static double nearest_on(const struct cn_contact_space *space, int surface, const double p[3], double limit)
{
    for (int t = space->first[surface]; t < space->first[surface + 1]; t++)
        limit = cn_tree_nearest(space->tree[t], p, limit, NULL, NULL);
    return limit;
}

bool cn_contact_behind(const cn_contact_model *model, const cn_contact *contact, int surface,
                       const double p[3])
{
    const cn_world *world = model->world;
    const struct cn_contact_space *space = contact->space;
    const int wall = model->surface[surface].wall;
    if (wall < 0) return inside_surface(space, surface, NULL, p);
    if (world->wall[wall].half_space && !space->wall[wall].deforms)
        return behind(&world->wall[wall], &space->wall[wall], p);
    if (!world->wall[wall].vessel) return inside(space, world, wall, p);
    for (int w = 0; w < world->nvessel; w++)
        if (inside(space, world, w, p)) return false;
    return true;
}

double cn_contact_wall_distance(const cn_contact_model *model, const cn_contact *contact, const double p[3])
{
    const struct cn_contact_space *space = contact->space;
    double best = INFINITY;
    for (int w = 0; w < space->nwall; w++) {
        const wall_now *wall = &space->wall[w];
        double q[3];
        cn_sub(p, wall->shift, q);
        best = wall->deforms ? nearest_on(space, wall->surface, p, best)
                             : cn_tree_nearest(model->world->wall[w].tree, q, best, NULL, NULL);
    }
    return best;
}

double cn_contact_depth_in(const cn_contact_model *model, const cn_contact *contact, int surface,
                           const double p[3])
{
    const cn_contact_surface *of = &model->surface[surface];
    if (!of->body || of->wall >= 0 || !(of->body->rest_volume > 0)) return 0;
    if (!inside_surface(contact->space, surface, NULL, p)) return 0;
    return nearest_on(contact->space, surface, p, INFINITY);
}
