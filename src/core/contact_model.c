/* contact_model.c - what contact needs of bodies and walls, and the memory of the search. */
#include "contact_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

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

typedef struct {
    double key;
    int tri;
} sort_key;

static int by_key(const void *p, const void *q)
{
    const sort_key *a = p, *b = q;
    if (a->key != b->key) return a->key < b->key ? -1 : 1;
    return (a->tri > b->tri) - (a->tri < b->tri);
}

/* Triangles (over npoint points) in order along the longest side of the rest shape's box. */
static cn_status sorted_triangles(int **out, int ntri, const int *given, int npoint, const double *rest)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    sort_key *key = malloc(((size_t)ntri + 1) * sizeof *key);
    int *tri = *out = malloc((3 * (size_t)ntri + 1) * sizeof *tri), axis = 0;
    if (!key || !tri) {
        free(key);
        return CN_ERR_MEMORY;
    }
    for (int i = 0; i < 3 * npoint; i++)
        low[i % 3] = fmin(low[i % 3], rest[i]), high[i % 3] = fmax(high[i % 3], rest[i]);
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    for (int t = 0; t < ntri; t++) {
        key[t] = (sort_key){0, t};
        for (int k = 0; k < 3; k++)
            key[t].key += rest[3 * given[3 * t + k] + axis];
    }
    qsort(key, (size_t)ntri, sizeof *key, by_key);
    for (int t = 0; t < 3 * ntri; t++)
        tri[t] = given[3 * key[t / 3].tri + t % 3];
    free(key);
    return CN_OK;
}

static cn_status inner_nodes(cn_contact_surface *surface)
{
    unsigned char *outer = calloc((size_t)surface->npoint + 1, 1);
    surface->inner = malloc(((size_t)surface->npoint + 1) * sizeof *surface->inner);
    if (!outer || !surface->inner) {
        free(outer);
        return CN_ERR_MEMORY;
    }
    for (int c = 0; c < 3 * surface->ntri; c++)
        outer[surface->tri[c]] = 1;
    for (int i = 0; i < surface->npoint; i++)
        if (!outer[i]) surface->inner[surface->ninner++] = i;
    free(outer);
    return CN_OK;
}

static cn_status body_surface(cn_contact_surface *out, const cn_contact_body *given)
{
    const cn_body *body = out->body = given->body;
    cn_status status;
    out->wall = given->wall, out->self = given->self, out->gap = given->gap, out->kappa = given->kappa;
    out->npoint = body->npoint, out->ntri = body->boundary->ntri, out->rest = body->point;
    if ((status = sorted_triangles(&out->tri, out->ntri, body->boundary->tri, out->npoint, out->rest)) !=
        CN_OK)
        return status;
    status = cn_collider_new(&out->collider, out->ntri, out->tri, out->npoint, NULL);
    return status == CN_OK ? inner_nodes(out) : status;
}

static cn_status wall_surface(cn_contact_surface *out, const cn_world *world, int wall, bool moving)
{
    const cn_surface *surface = world->wall[wall].surface;
    cn_status status = CN_OK;
    out->wall = wall, out->moving = moving, out->gap = out->kappa = INFINITY;
    out->npoint = surface->nvert, out->ntri = surface->ntri, out->rest = surface->vert;
    if (moving) {
        status = sorted_triangles(&out->tri, out->ntri, surface->tri, out->npoint, out->rest);
    } else { /* in the order of the world's tree */
        if (!(out->tri = malloc((3 * (size_t)out->ntri + 1) * sizeof *out->tri))) return CN_ERR_MEMORY;
        memcpy(out->tri, surface->tri, 3 * (size_t)out->ntri * sizeof *out->tri);
        status = planes_of(&out->plane, surface);
    }
    return status == CN_OK ? cn_collider_new(&out->collider, out->ntri, out->tri, out->npoint, out->rest)
                           : status;
}

/* A wall is stood for once, and then rigid no more. */
static bool in_order(const cn_world *world, int nbody, const cn_contact_body *body,
                     const unsigned char *moving)
{
    for (int b = 0; b < nbody; b++) {
        const int wall = body[b].wall;
        if (!(body[b].gap > 0 && body[b].kappa > 0)) return false;
        if (!(wall >= -1 && wall < world->nwall)) return false;
        if (wall >= 0 && moving && moving[wall]) return false;
        for (int c = 0; c < b && wall >= 0; c++)
            if (wall == body[c].wall) return false;
    }
    return true;
}

/* Every two surfaces that may meet have a gap and a stiffness. */
static bool all_barriers(const cn_contact_model *model)
{
    for (int s = 0; s < model->nsurface; s++)
        for (int t = 0; t <= s; t++) {
            const cn_contact_surface *a = &model->surface[s], *b = &model->surface[t];
            if (!cn_contact_meet(model, s, t)) continue;
            if (!(fmin(a->gap, b->gap) < INFINITY && fmin(a->kappa, b->kappa) < INFINITY)) return false;
        }
    return true;
}

cn_status cn_contact_model_new(cn_contact_model **out, const cn_world *world, int nbody,
                               const cn_contact_body *body, const unsigned char *moving)
{
    cn_contact_model *model;
    cn_status status = CN_OK;
    *out = NULL;
    if (!in_order(world, nbody, body, moving)) return CN_ERR_ARG;
    if (!(model = calloc(1, sizeof *model))) return CN_ERR_MEMORY;
    model->world = world;
    model->surface = calloc((size_t)nbody + (size_t)world->nwall + 1, sizeof *model->surface);
    if (!model->surface) status = CN_ERR_MEMORY;
    for (int s = 0; s < nbody + world->nwall && status == CN_OK; s++) {
        cn_contact_surface *surface = &model->surface[model->nsurface];
        bool taken = false;
        for (int b = 0; b < nbody; b++)
            taken |= s >= nbody && body[b].wall == s - nbody;
        if (taken) continue;
        model->nsurface++; /* a half-built one can be cleared */
        status = s < nbody ? body_surface(surface, body + s)
                           : wall_surface(surface, world, s - nbody, moving && moving[s - nbody]);
        surface->first = model->npoint, model->npoint += surface->npoint;
    }
    for (int a = 0; status == CN_OK && a < nbody; a++)
        for (int b = a; b < model->nsurface; b++) {
            const double gap = fmin(model->surface[a].gap, model->surface[b].gap);
            if ((a != b || model->surface[a].self) && gap < INFINITY) model->gap = fmax(model->gap, gap);
        }
    if (status == CN_OK && !all_barriers(model)) status = CN_ERR_ARG;
    if (status == CN_OK)
        *out = model;
    else
        cn_contact_model_free(model);
    return status;
}

void cn_contact_model_free(cn_contact_model *model)
{
    if (!model) return;
    for (int s = 0; s < model->nsurface; s++) {
        cn_contact_surface *surface = &model->surface[s];
        cn_collider_free(surface->collider);
        free(surface->tri), free(surface->inner), free(surface->plane);
    }
    free(model->surface);
    free(model);
}

enum { PARTS = 64, PART_TRIANGLES = 96 };

static cn_status pair_memory(cn_contact *contact, int capacity)
{
    cn_pair *pair = realloc(contact->pair, (size_t)capacity * sizeof *pair);
    if (pair) contact->pair = pair;
    double *distance = realloc(contact->distance, (size_t)capacity * sizeof *distance);
    if (distance) contact->distance = distance;
    double *limit = realloc(contact->limit, ((size_t)capacity / 64 + 1) * sizeof *limit);
    if (limit) contact->limit = limit;
    cn_link *link = realloc(contact->link, 5 * (size_t)capacity * sizeof *link);
    if (link) contact->link = link;
    cn_rub *rub = realloc(contact->rub, (size_t)capacity * sizeof *rub);
    if (rub) contact->rub = rub;
    if (!pair || !distance || !limit || !link || !rub) return CN_ERR_MEMORY;
    contact->capacity = capacity;
    return CN_OK;
}

static int parts_of(const cn_contact_surface *surface)
{
    const int npart = surface->ntri / PART_TRIANGLES;
    if (cn_contact_rests(surface)) return 0;
    return npart < 1 ? 1 : npart > PARTS ? PARTS : npart;
}

/* Parts in the order of the surfaces. */
static cn_status part_memory(cn_contact *contact, const cn_contact_model *model)
{
    size_t all = 1;
    cn_status status;
    for (int s = 0; s < model->nsurface; s++)
        all += (size_t)parts_of(&model->surface[s]);
    contact->part = calloc(all, sizeof *contact->part);
    contact->found = calloc(all, sizeof *contact->found);
    if (!contact->part || !contact->found) return CN_ERR_MEMORY;
    for (int s = 0; s < model->nsurface; s++) {
        const cn_contact_surface *surface = &model->surface[s];
        const int npart = parts_of(surface);
        for (int p = 0; p < npart; p++) {
            cn_contact_part *part = &contact->part[contact->npart++];
            part->surface = s;
            part->first = (int)((long)surface->ntri * p / npart);
            part->ntri = (int)((long)surface->ntri * (p + 1) / npart) - part->first;
            part->capacity = 1024, part->lowest = surface->npoint;
            for (int c = 3 * part->first; c < 3 * (part->first + part->ntri); c++)
                part->lowest = surface->tri[c] < part->lowest ? surface->tri[c] : part->lowest;
            if (!(part->pair = malloc((size_t)part->capacity * sizeof *part->pair))) return CN_ERR_MEMORY;
            if ((status = cn_tree_new(&part->tree, part->ntri, surface->tri + 3 * part->first,
                                      surface->rest)) != CN_OK)
                return status;
        }
    }
    return CN_OK;
}

cn_status cn_contact_new(cn_contact **out, const cn_contact_model *model)
{
    cn_contact *contact = calloc(1, sizeof *contact);
    const size_t n = (size_t)model->npoint + 1;
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!contact) return CN_ERR_MEMORY;
    contact->from = malloc(3 * n * sizeof *contact->from);
    contact->end = malloc(3 * n * sizeof *contact->end);
    contact->patch = malloc(n * sizeof *contact->patch);
    contact->patch_force = malloc(6 * n * sizeof *contact->patch_force);
    if (!contact->from || !contact->end || !contact->patch || !contact->patch_force) goto fail;
    if ((status = pair_memory(contact, 16384)) != CN_OK) goto fail;
    if ((status = part_memory(contact, model)) != CN_OK) goto fail;
    if ((status = cn_contact_space_new(&contact->space, model, contact)) != CN_OK) goto fail;
    *out = contact;
    return CN_OK;
fail:
    cn_contact_free(contact);
    return status;
}

void cn_contact_free(cn_contact *contact)
{
    if (!contact) return;
    for (int p = 0; p < contact->npart; p++)
        cn_tree_free(contact->part[p].tree), free(contact->part[p].pair);
    free(contact->part), free(contact->found);
    free(contact->pair), free(contact->distance), free(contact->limit), free(contact->link);
    free(contact->rub);
    free(contact->from), free(contact->end), free(contact->patch), free(contact->patch_force);
    cn_contact_space_free(contact->space);
    free(contact);
}

cn_status cn_contact_grow(cn_contact *contact)
{
    for (int p = 0; p < contact->npart; p++) {
        cn_contact_part *part = &contact->part[p];
        if (part->npair < part->capacity) continue;
        cn_pair *more = realloc(part->pair, 4 * (size_t)part->capacity * sizeof *more);
        if (!more) return CN_ERR_MEMORY;
        part->pair = more, part->capacity *= 4;
    }
    return contact->npair < contact->capacity ? CN_OK : pair_memory(contact, 4 * contact->capacity);
}
