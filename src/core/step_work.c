/* step_work.c - what a step needs beside the state, all of it allocated here: of each body its matrix, solver
 * and vectors, and of all bodies that are solved together the surfaces that can touch. */
#include "step_parts.h"

#include <stdlib.h>
#include <string.h>
#include "body_wall.h"

/* Vectors out of the one block of memory. */
static void hand_out(cn_part *part, size_t blocks, size_t nodes)
{
    double *next = part->memory,
           **const of_blocks[] = {&part->u,        &part->ahead,   &part->lag,      &part->constant,
                                  &part->trial,    &part->trial_u, &part->gradient, &part->elastic,
                                  &part->external, &part->path,    &part->touch,    &part->dx,
                                  &part->moved,    &part->damped,  &part->axis,     &part->cg[0],
                                  &part->cg[1],    &part->cg[2],   &part->cg[3]};
    double **const of_nodes[] = {&part->drive.force, &part->drive.centre, &part->drive.tangent,
                                 &part->drive.towards};
    for (size_t i = 0; i < sizeof of_blocks / sizeof *of_blocks; i++, next += 3 * blocks)
        *of_blocks[i] = next;
    for (size_t i = 0; i < sizeof of_nodes / sizeof *of_nodes; i++, next += 3 * nodes)
        *of_nodes[i] = next;
    part->drive.weight = next, part->drive.lead = next + nodes, part->drive.pull = next + 2 * nodes;
    part->drive.hold = next + 3 * nodes;
    part->spin = next + 4 * nodes;
    part->factored_turn = part->spin + (blocks > nodes ? 9 * nodes : 0);
    part->bent = part->factored_turn + 4 * part->body->body->nturn;
}

/* Levels of the pattern, a catheter's by station. */
static cn_status levels_of(const cn_part *part, int *level)
{
    const cn_model_body *body = part->body;
    const cn_body *b = body->body;
    if (!body->catheter && b->model != CN_BODY_ROD) return cn_levels_find(part->matrix, level);
    for (int i = 0; i < b->nblock; i++)
        level[i] = i % b->nnode / body->per_station;
    return CN_OK;
}

/* Nodes level by level where the body is slender, with fewer nodes in a level than levels; else all in one.
 * Levels of less than half as many as in the mean, at a pointed end, go with the next. */
static cn_status slices_of(cn_part *part, const int *level)
{
    const int n = part->body->body->nnode;
    int nlevel = 1;
    for (int i = 0; i < n; i++)
        if (level[i] >= nlevel) nlevel = level[i] + 1;
    part->node = malloc(((size_t)n + 1) * sizeof *part->node);
    part->slice = calloc((size_t)nlevel + 2, sizeof *part->slice);
    if (!part->node || !part->slice) return CN_ERR_MEMORY;
    int *next = part->slice + 1; /* while sorting, next[l] is where level l's next node goes */
    for (int i = 0; i < n; i++)
        next[level[i] + 1]++;
    for (int l = 1; l <= nlevel; l++)
        next[l] += next[l - 1];
    for (int i = 0; i < n; i++)
        part->node[next[level[i]]++] = i;
    const double least = (double)nlevel * nlevel > n ? 0.5 * n / nlevel : n;
    for (int l = 0; l < nlevel; l++)
        if (part->slice[l + 1] - part->slice[part->nslice] >= least)
            part->slice[++part->nslice] = part->slice[l + 1];
    if (part->nslice == 0) part->nslice = 1;
    part->slice[part->nslice] = n;
    if (!(part->led = malloc((size_t)part->nslice * sizeof *part->led))) return CN_ERR_MEMORY;
    return CN_OK;
}

static cn_status part_new(cn_part *part, const cn_model *model, int index, cn_pool *pool, cn_error *error)
{
    const cn_model_body *body = &model->body[index];
    const cn_body *b = body->body;
    const size_t blocks = (size_t)b->nblock, nodes = (size_t)b->nnode;
    const cn_body *const bodies[1] = {b};
    const int first[1] = {0};
    int *level = NULL;
    cn_status status;
    *part =
        (cn_part){.sheet = cn_is_sheet(b->model), .model = model, .body = body, .index = index, .pool = pool};
    if (!(part->held = calloc(blocks, 1))) return CN_ERR_MEMORY;
    if (!(part->memory = calloc(57 * blocks + 25 * nodes + 8 * (size_t)b->nturn, sizeof(double))))
        return CN_ERR_MEMORY;
    hand_out(part, blocks, nodes);
    part->anchored = memchr(body->fixed, 1, blocks) != NULL;
    if ((status = cn_matrix_new(&part->matrix, 1, bodies, first)) != CN_OK) return status;
    part->damping = *part->matrix;
    part->damping.value = NULL;
    if (b->damping_stiffness > 0 &&
        !(part->damping.value = calloc(9 * (size_t)part->matrix->nblock, sizeof(double))))
        return CN_ERR_MEMORY;
    if ((status = cn_body_bind(&part->scatter, b, part->matrix, 0)) != CN_OK) return status;
    if ((status = cn_carry_new(&part->carry, cn_touch_body(body))) != CN_OK) return status;
    if (!(level = malloc((blocks + 1) * sizeof *level))) return CN_ERR_MEMORY;
    if ((status = levels_of(part, level)) == CN_OK && (status = slices_of(part, level)) == CN_OK)
        status = cn_solver_new(&part->solver, part->matrix, model->scene->solver.linear, level, error);
    free(level);
    return status;
}

static void part_clear(cn_part *part)
{
    cn_carry_free(part->carry);
    cn_solver_free(part->solver);
    cn_scatter_free(part->scatter);
    free(part->damping.value);
    cn_matrix_free(part->matrix);
    free(part->held);
    free(part->node);
    free(part->slice);
    free(part->led);
    free(part->memory);
}

/* Softer bodies first, those whose stiffness goes all by links last. */
static bool before(const cn_work *work, int p, int q)
{
    const bool linked[2] = {work->hang[p].linked, work->hang[q].linked};
    const double spring[2] = {work->part[p].body->body->spring, work->part[q].body->body->spring};
    return linked[0] != linked[1] ? linked[1] : spring[0] != spring[1] ? spring[0] < spring[1] : p < q;
}

/* What has no inertia may be held by its links alone: all matrices have them then. */
static cn_status order_parts(cn_work *work)
{
    if (!(work->order = malloc((size_t)work->npart * sizeof *work->order))) return CN_ERR_MEMORY;
    for (int p = 0; p < work->npart; p++) {
        for (int q = 0; q < work->npart; q++)
            work->part[p].rank += before(work, q, p);
        work->order[work->part[p].rank] = p;
        if (work->model->inertia) work->hang[p].rank = work->part[p].rank;
    }
    return CN_OK;
}

/* Surfaces of the bodies and the walls, and where everything is at rest. */
static cn_status surfaces_new(cn_work *work)
{
    const cn_model *model = work->model;
    const cn_world *world = model->world;
    cn_contact_body *body = calloc((size_t)work->npart, sizeof *body);
    unsigned char *moving = calloc((size_t)world->nwall + 1, 1);
    cn_status status = body && moving ? CN_OK : CN_ERR_MEMORY;
    for (int p = 0; status == CN_OK && p < work->npart; p++) {
        const cn_model_body *b = work->part[p].body;
        body[p] = (cn_contact_body){
            .body = cn_touch_body(b), .wall = b->wall, .self = b->self, .gap = b->gap, .kappa = b->kappa};
    }
    for (int w = 0; status == CN_OK && w < world->nwall; w++) {
        moving[w] = cn_wall_moves(&world->wall[w]);
        work->moving |= moving[w];
    }
    if (status == CN_OK) status = cn_contact_model_new(&work->surfaces, world, work->npart, body, moving);
    free(body), free(moving);
    if (status != CN_OK) return status;
    const size_t n = 3 * (size_t)work->surfaces->npoint, surfaces = (size_t)work->surfaces->nsurface;
    size_t naxis = 0;
    for (int p = 0; p < work->npart; p++)
        naxis += 3 * (size_t)work->part[p].body->body->nnode;
    if (!(work->memory = calloc(7 * n + naxis + 1, sizeof *work->memory))) return CN_ERR_MEMORY;
    if (!(work->hang = calloc(surfaces, sizeof *work->hang))) return CN_ERR_MEMORY;
    if (!(work->nfree = calloc(surfaces, sizeof *work->nfree))) return CN_ERR_MEMORY;
    work->points = work->memory, work->trial = work->points + n, work->motion = work->trial + n;
    work->goal = work->motion + n, work->force = work->goal + n, work->mass = work->force + n;
    work->begin = work->mass + n, work->axis = work->begin + n;
    for (int s = 0; s < work->surfaces->nsurface; s++) {
        const cn_contact_surface *surface = &work->surfaces->surface[s];
        memcpy(work->points + 3 * (size_t)surface->first, surface->rest,
               3 * (size_t)surface->npoint * sizeof *work->points);
        work->nfree[s] = surface->npoint;
        if (s >= work->npart) continue;
        const cn_part *part = &work->part[s];
        work->hang[s] = (cn_hang){.matrix = part->matrix,
                                  .carry = part->carry,
                                  .linked = part->sheet || (part->carry && part->carry->nper > 0)};
    }
    if ((status = order_parts(work)) != CN_OK) return status;
    memcpy(work->trial, work->points, n * sizeof *work->points);
    memcpy(work->goal, work->points, n * sizeof *work->points);
    memcpy(work->begin, work->points, n * sizeof *work->points);
    const cn_status made = cn_contact_new(&work->contact, work->surfaces);
    return made == CN_OK && model->scene->contact.method == CN_CONTACT_PENALTY
               ? cn_penalty_new(&work->penalty, work->surfaces, work->contact)
               : made;
}

cn_status cn_work_new(cn_work **out, const cn_model *model, int first, int nbody, cn_pool *pool,
                      cn_error *error)
{
    cn_work *work = calloc(1, sizeof *work);
    cn_status status = CN_OK;
    bool touches = false;
    *out = NULL;
    if (!work) return CN_ERR_MEMORY;
    work->model = model, work->pool = pool, work->first = first;
    work->part = calloc((size_t)nbody, sizeof *work->part);
    work->stage = calloc((size_t)nbody, sizeof *work->stage);
    if (!work->part || !work->stage) status = CN_ERR_MEMORY;
    for (int p = 0; status == CN_OK && p < nbody; p++) {
        status = part_new(&work->part[work->npart++], model, first + p, pool, error);
        touches |= model->body[first + p].gap > 0;
    }
    if (status == CN_OK && touches) status = surfaces_new(work);
    if (status == CN_OK && touches && model->integrator == CN_INTEGRATOR_EULER && !model->single)
        status = cn_wall_solve_new(&work->wall, work, model->dt, error);
    if (status == CN_OK) {
        *out = work;
        return CN_OK;
    }
    cn_work_free(work);
    return cn_fail(error, status, NULL, 0, "%s", cn_status_text(status));
}

void cn_work_free(cn_work *work)
{
    if (!work) return;
    for (int p = 0; p < work->npart; p++)
        part_clear(&work->part[p]);
    cn_penalty_free(work->penalty);
    cn_wall_solve_free(work->wall);
    cn_contact_free(work->contact);
    cn_contact_model_free(work->surfaces);
    free(work->order), free(work->hang), free(work->nfree), free(work->memory), free(work->part),
        free(work->stage);
    free(work);
}

cn_status cn_work_grow(cn_work *work)
{
    const cn_status status = work->penalty ? cn_penalty_grow(work->penalty) : CN_OK;
    return status == CN_OK && work->contact ? cn_contact_grow(work->contact) : status;
}

void cn_work_watch(cn_work *work, const volatile sig_atomic_t *cancel)
{
    work->cancel = cancel;
}

void cn_work_bodies(const cn_work *work, int *first, int *nbody)
{
    *first = work->first, *nbody = work->npart;
}

int cn_work_wall(const cn_work *work, int surface)
{
    return work->surfaces->surface[surface].wall;
}
