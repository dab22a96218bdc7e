/* state.c - what changes in a run, in one block: a copy restores it bit for bit. */
#include "sim.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "body_wall.h"
#include "catnav/vec3.h"
#include "polar.h"
#include "rod.h"
#include "rod_spin.h"

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

/* Those of the stations whose last node is past the entry. */
int cn_sheath_out(const cn_model_body *body, double inserted)
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

int cn_sheath_past(const cn_model_body *body, const cn_body_state *state)
{
    int past = state->nfree;
    while (body->sheath && past < body->body->nnode && state->inserted - body->behind[past] > 0)
        past += body->per_section;
    return past;
}

static void start_body(const cn_model_body *body, cn_body_state *state)
{
    const cn_body *b = body->body;
    const cn_body_spec *spec = body->spec;
    double centre[3] = {0, 0, 0}, mass = 0;
    memcpy(state->x, body->start ? body->start : b->rest, 3 * (size_t)b->nnode * sizeof *state->x);
    cn_body_rotation_start(b, state->rotation);
    if (body->start && spec->model == CN_BODY_ROD) cn_rod_follow(b, state->x, state->rotation);
    state->nfree = b->nnode, state->until = INFINITY;
    state->push = (cn_push){.mark = -INFINITY, .best = -INFINITY, .margin = 1};
    cn_push_bend(body, state, 0);
    if (body->catheter) state->inserted = spec->shape.catheter.inserted;
    if (body->sheath) state->nfree = cn_sheath_out(body, state->inserted);
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
    for (int b = 0; b < model->nbody; b++) {
        const cn_body *body = model->body[b].body;
        start_body(&model->body[b], &state->body[b]);
        if (model->scene->leave_out.wall_solve == CN_OFF && cn_is_sheet(body->model))
            cn_sheet_follow(body, state->body[b].x, state->body[b].rotation, -1, NULL);
    }
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

/* A rod's frames in the sheath: n turned with the base, t from the tip to it. Those that take part in the
 * step keep the frame they had and get the rotation vector from there. */
static void turn_frames(const cn_model_body *body, cn_body_state *state, const double n[3])
{
    const int nnode = body->body->nnode;
    double t[3], b[3], q[4];
    for (int k = 0; k < 3; k++)
        t[k] = -body->direction[k];
    cn_cross(t, n, b);
    const double r[9] = {n[0], b[0], t[0], n[1], b[1], t[1], n[2], b[2], t[2]};
    cn_polar(r, q);
    for (int i = state->nfree; i < nnode; i++)
        if (i < state->nfree + body->per_station)
            cn_spin_between(state->rotation + 4 * (size_t)i, q, state->x + 3 * (size_t)(nnode + i));
        else
            memcpy(state->rotation + 4 * (size_t)i, q, sizeof q);
}

void cn_sheath_advance(const cn_model_body *body, cn_body_state *state, double advance, double turn,
                       int nfree, double dt)
{
    const int nnode = body->body->nnode;
    double n[3] = {0}, b[3];
    if (!body->catheter) return;
    state->inserted += advance, state->twist += turn, state->nfree = nfree;
    state->push.turned += fabs(turn);
    cn_axpy(cos(state->twist), body->normal, n), cn_axpy(sin(state->twist), body->binormal, n);
    cn_cross(body->direction, n, b);
    for (int i = nfree; i < nnode; i++) {
        const double *o = body->offset + 2 * i;
        for (int k = 0; k < 3; k++) {
            state->x[3 * i + k] = body->entry[k] + (state->inserted - body->behind[i]) * body->direction[k] +
                                  o[0] * n[k] + o[1] * b[k];
            state->v[3 * i + k] = advance / dt * body->direction[k] + turn / dt * (o[0] * b[k] - o[1] * n[k]);
        }
        for (int k = 0; body->body->nblock > nnode && k < 3; k++)
            state->v[3 * (nnode + i) + k] = turn / dt * body->direction[k];
    }
    if (body->body->nblock > nnode && body->spec->drive.mode == CN_DRIVE_PUSH) turn_frames(body, state, n);
}

void cn_sheath_release(const cn_model_body *body, cn_body_state *state)
{
    if (!body->sheath) return; /* all is free, and only a catheter has stations */
    const int out = cn_sheath_out(body, state->inserted);
    if (out > state->nfree) state->nfree = out;
}
