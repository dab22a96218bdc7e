/* state.c - what changes in a run, in one block: a copy restores it bit for bit. */
#include "sim.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

/* The block: header, body states, then each body's x, v, rotation. */
static void lay_out(cn_state *state, const cn_model *model)
{
    double *next = (double *)(state->body + model->nbody);
    for (int b = 0; b < model->nbody; b++) {
        const size_t n = 3 * (size_t)model->body[b].body->nblock;
        state->body[b].x = next, next += n;
        state->body[b].v = next, next += n;
        state->body[b].rotation = next, next += 4 * (size_t)model->body[b].body->nturn;
    }
}

/* Nodes of the stations whose last node is past the entry. */
static int nodes_out(const cn_model_body *body, double inserted)
{
    const int nnode = body->body->nnode;
    int out = 0;
    while (out < nnode) {
        const int next = out + body->per_station < nnode ? out + body->per_station : nnode;
        if (!(inserted - body->behind[next - 1] > 0)) break;
        out = next;
    }
    return out;
}

static void start_body(const cn_model_body *body, cn_body_state *state)
{
    const cn_body *b = body->body;
    const cn_body_spec *spec = body->spec;
    double centre[3] = {0, 0, 0}, mass = 0;
    memcpy(state->x, body->start ? body->start : b->rest, 3 * (size_t)b->nnode * sizeof *state->x);
    cn_body_rotation_start(b, state->rotation);
    state->nfree = b->nnode;
    if (body->catheter) state->inserted = spec->shape.catheter.inserted;
    if (body->sheath) state->nfree = nodes_out(body, state->inserted);
    for (int i = 0; i < b->nnode; i++)
        cn_axpy(b->mass[i], state->x + 3 * i, centre), mass += b->mass[i];
    for (int i = 0; i < state->nfree; i++) {
        double from[3], turn[3];
        for (int k = 0; k < 3; k++)
            from[k] = state->x[3 * i + k] - (mass > 0 ? centre[k] / mass : 0);
        cn_cross(spec->spin, from, turn);
        if (body->fixed[i]) continue;
        for (int k = 0; k < 3; k++)
            state->v[3 * i + k] = spec->velocity[k] + turn[k];
        if (b->nblock > b->nnode) cn_copy3(spec->spin, state->v + 3 * (size_t)(b->nnode + i));
    }
}

cn_status cn_state_new(cn_state **out, const cn_model *model)
{
    size_t size = sizeof(cn_state) + (size_t)model->nbody * sizeof(cn_body_state);
    for (int b = 0; b < model->nbody; b++)
        size += (6 * (size_t)model->body[b].body->nblock + 4 * (size_t)model->body[b].body->nturn) *
                sizeof(double);
    cn_state *state = calloc(1, size);
    *out = state;
    if (!state) return CN_ERR_MEMORY;
    state->nbody = model->nbody, state->size = size;
    state->body = (cn_body_state *)(state + 1);
    lay_out(state, model);
    for (int b = 0; b < model->nbody; b++)
        start_body(&model->body[b], &state->body[b]);
    return CN_OK;
}

void cn_state_free(cn_state *state)
{
    free(state);
}

void cn_state_copy_body(cn_body_state *to, const cn_body_state *from, const cn_model_body *body)
{
    cn_body_state kept = *to;
    *to = *from;
    to->x = kept.x, to->v = kept.v, to->rotation = kept.rotation;
    memcpy(to->x, from->x, 3 * (size_t)body->body->nblock * sizeof *to->x);
    memcpy(to->v, from->v, 3 * (size_t)body->body->nblock * sizeof *to->v);
    memcpy(to->rotation, from->rotation, 4 * (size_t)body->body->nturn * sizeof *to->rotation);
}

void cn_state_copy(cn_state *to, const cn_state *from)
{
    memcpy(to, from, from->size);
#define CN_MOVED(pointer) (void *)((char *)to + ((const char *)(pointer) - (const char *)from))
    to->body = CN_MOVED(from->body);
    for (int b = 0; b < to->nbody; b++) {
        to->body[b].x = CN_MOVED(from->body[b].x);
        to->body[b].v = CN_MOVED(from->body[b].v);
        to->body[b].rotation = CN_MOVED(from->body[b].rotation);
    }
#undef CN_MOVED
}

void cn_sheath_advance(const cn_model_body *body, cn_body_state *state, double advance, double dt)
{
    state->inserted += advance;
    for (int i = state->nfree; i < body->body->nnode; i++)
        for (int k = 0; k < 3; k++) {
            state->x[3 * i + k] = body->entry[k] + (state->inserted - body->behind[i]) * body->direction[k] +
                                  body->offset[2 * i] * body->normal[k] +
                                  body->offset[2 * i + 1] * body->binormal[k];
            state->v[3 * i + k] = advance / dt * body->direction[k];
        }
}

void cn_sheath_release(const cn_model_body *body, cn_body_state *state)
{
    if (!body->sheath) return; /* all is free, and only a catheter has stations */
    const int out = nodes_out(body, state->inserted);
    if (out > state->nfree) state->nfree = out;
}
