/* contact_model.c - what contact needs of a body and the walls, and the memory of the search. */
#include "contact.h"

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

/* The surface's triangles in order along the longest side of the rest shape's box. */
static cn_status sorted_triangles(int **out, const cn_body *body)
{
    const cn_surface *surface = body->boundary;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    sort_key *key = malloc(((size_t)surface->ntri + 1) * sizeof *key);
    int *tri = *out = malloc((3 * (size_t)surface->ntri + 1) * sizeof *tri), axis = 0;
    if (!key || !tri) {
        free(key);
        return CN_ERR_MEMORY;
    }
    for (int i = 0; i < 3 * body->npoint; i++)
        low[i % 3] = fmin(low[i % 3], body->point[i]), high[i % 3] = fmax(high[i % 3], body->point[i]);
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    for (int t = 0; t < surface->ntri; t++) {
        key[t] = (sort_key){0, t};
        for (int k = 0; k < 3; k++)
            key[t].key += body->point[3 * surface->tri[3 * t + k] + axis];
    }
    qsort(key, (size_t)surface->ntri, sizeof *key, by_key);
    for (int t = 0; t < 3 * surface->ntri; t++)
        tri[t] = surface->tri[3 * key[t / 3].tri + t % 3];
    free(key);
    return CN_OK;
}

static cn_status inner_nodes(cn_contact_model *model)
{
    const cn_body *body = model->body;
    unsigned char *outer = calloc((size_t)body->npoint + 1, 1);
    model->inner = malloc(((size_t)body->npoint + 1) * sizeof *model->inner);
    if (!outer || !model->inner) {
        free(outer);
        return CN_ERR_MEMORY;
    }
    for (int c = 0; c < 3 * body->boundary->ntri; c++)
        outer[model->tri[c]] = 1;
    for (int i = 0; i < body->npoint; i++)
        if (!outer[i]) model->inner[model->ninner++] = i;
    free(outer);
    return CN_OK;
}

cn_status cn_contact_model_new(cn_contact_model **out, const cn_body *body, const cn_world *world, double gap,
                               double kappa)
{
    cn_contact_model *model = calloc(1, sizeof *model);
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!model) return CN_ERR_MEMORY;
    model->body = body, model->world = world, model->gap = gap, model->kappa = kappa;
    model->wall_collider = calloc((size_t)world->nwall + 1, sizeof *model->wall_collider);
    model->wall_plane = calloc((size_t)world->nwall + 1, sizeof *model->wall_plane);
    if (!model->wall_collider || !model->wall_plane) goto fail;
    if ((status = sorted_triangles(&model->tri, body)) != CN_OK) goto fail;
    status = cn_collider_new(&model->collider, body->boundary->ntri, model->tri, body->npoint, NULL);
    for (int w = 0; w < world->nwall && status == CN_OK; w++) {
        const cn_surface *wall = world->wall[w].surface;
        status = cn_collider_new(&model->wall_collider[w], wall->ntri, wall->tri, wall->nvert, wall->vert);
        if (status == CN_OK) status = planes_of(&model->wall_plane[w], wall);
    }
    if (status == CN_OK) status = inner_nodes(model);
    if (status != CN_OK) goto fail;
    *out = model;
    return CN_OK;
fail:
    cn_contact_model_free(model);
    return status;
}

void cn_contact_model_free(cn_contact_model *model)
{
    if (!model) return;
    cn_collider_free(model->collider);
    for (int w = 0; model->wall_collider && w < model->world->nwall; w++)
        cn_collider_free(model->wall_collider[w]);
    for (int w = 0; model->wall_plane && w < model->world->nwall; w++)
        free(model->wall_plane[w]);
    free(model->wall_collider), free(model->wall_plane), free(model->tri), free(model->inner);
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
    if (!pair || !distance || !limit) return CN_ERR_MEMORY;
    contact->capacity = capacity;
    return CN_OK;
}

static cn_status part_memory(cn_contact *contact, const cn_contact_model *model)
{
    const int ntri = model->collider->ntri;
    int npart = ntri / PART_TRIANGLES;
    cn_status status;
    npart = npart < 1 ? 1 : npart > PARTS ? PARTS : npart;
    contact->part = calloc((size_t)npart, sizeof *contact->part);
    contact->found = calloc((size_t)npart, sizeof *contact->found);
    if (!contact->part || !contact->found) return CN_ERR_MEMORY;
    for (int p = 0; p < npart; p++) {
        cn_contact_part *part = &contact->part[contact->npart++];
        part->first = (int)((long)ntri * p / npart);
        part->ntri = (int)((long)ntri * (p + 1) / npart) - part->first;
        part->capacity = 1024, part->lowest = model->body->npoint;
        for (int c = 3 * part->first; c < 3 * (part->first + part->ntri); c++)
            part->lowest = model->tri[c] < part->lowest ? model->tri[c] : part->lowest;
        if (!(part->pair = malloc((size_t)part->capacity * sizeof *part->pair))) return CN_ERR_MEMORY;
        if ((status = cn_tree_new(&part->tree, part->ntri, model->tri + 3 * part->first,
                                  model->body->point)) != CN_OK)
            return status;
    }
    return CN_OK;
}

cn_status cn_contact_new(cn_contact **out, const cn_contact_model *model)
{
    cn_contact *contact = calloc(1, sizeof *contact);
    const cn_body *body = model->body;
    const int nwall = model->world->nwall;
    cn_status status = CN_ERR_MEMORY;
    *out = NULL;
    if (!contact) return CN_ERR_MEMORY;
    contact->from = malloc(3 * (size_t)body->npoint * sizeof *contact->from);
    contact->end = malloc(3 * (size_t)body->npoint * sizeof *contact->end);
    contact->patch_of = malloc(((size_t)nwall + 1) * sizeof *contact->patch_of);
    if (!contact->from || !contact->end || !contact->patch_of) goto fail;
    contact->patch_of[0] = 0;
    for (int w = 0; w < nwall; w++)
        contact->patch_of[w + 1] = contact->patch_of[w] + model->world->wall[w].surface->nvert;
    contact->patch = malloc(((size_t)contact->patch_of[nwall] + 1) * sizeof *contact->patch);
    contact->patch_force = malloc((6 * (size_t)contact->patch_of[nwall] + 1) * sizeof *contact->patch_force);
    if (!contact->patch || !contact->patch_force) goto fail;
    if ((status = pair_memory(contact, 16384)) != CN_OK) goto fail;
    if ((status = part_memory(contact, model)) != CN_OK) goto fail;
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
    free(contact->pair), free(contact->distance), free(contact->limit), free(contact->from),
        free(contact->end);
    free(contact->patch), free(contact->patch_of), free(contact->patch_force);
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
