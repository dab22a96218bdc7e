#include "scene_steps.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>
#include "catnav/vec3.h"
#include "run_parts.h"

void scene_steps_new(scene_steps *s, const char *text, int nsetting, const cn_setting *setting)
{
    char file[] = "/tmp/catnav-scene-XXXXXX";
    cn_error error = {0};
    memset(s, 0, sizeof *s);
    const int descriptor = mkstemp(file);
    assert_true(descriptor >= 0);
    assert_int_equal(write(descriptor, text, strlen(text)), strlen(text));
    close(descriptor);
    const cn_status status = cn_scene_read(&s->scene, file, nsetting, setting, &error);
    remove(file);
    if (status != CN_OK || cn_world_new(&s->world, s->scene, 0, NULL, &error) != CN_OK)
        fail_msg("%s", error.message);
    int n = s->scene->nbody;
    s->spec = calloc((size_t)(n + s->world->nwall), sizeof *s->spec);
    assert_non_null(s->spec);
    memcpy(s->spec, s->scene->body, (size_t)n * sizeof *s->spec);
    for (int w = 0; w < s->world->nwall; w++)
        if (cn_gives_way(s->world->wall[w].spec)) s->spec[n++] = cn_wall_as_body(s->world->wall[w].spec);
    if (cn_model_new(&s->model, s->scene, s->world, n, s->spec, &error) != CN_OK)
        fail_msg("%s", error.message);
    assert_int_equal(cn_pool_new(&s->pool, 1), CN_OK);
    assert_int_equal(cn_state_new(&s->state, s->model), CN_OK);
    assert_int_equal(cn_state_new(&s->trial, s->model), CN_OK);
    if (cn_work_new(&s->work, s->model, 0, n, s->pool, &error) != CN_OK) fail_msg("%s", error.message);
}

cn_status scene_steps_try(scene_steps *s)
{
    cn_state *old = s->state;
    cn_status status = cn_step(s->model, old, s->trial, NULL, s->scene->step, s->work, s->figures);
    while (status == CN_ERR_CONTACT && cn_work_grow(s->work) == CN_OK)
        status = cn_step(s->model, old, s->trial, NULL, s->scene->step, s->work, s->figures);
    if (status != CN_OK) return status;
    s->figures->residual = cn_step_residual(s->model, old, s->trial, NULL, s->scene->step, s->work);
    s->trial->time = old->time + s->scene->step, s->trial->step = old->step + 1;
    s->state = s->trial, s->trial = old;
    return CN_OK;
}

void scene_steps_go(scene_steps *s, int n)
{
    for (int i = 0; i < n; i++) {
        const cn_status status = scene_steps_try(s);
        if (status != CN_OK) fail_msg("step %d: %s", s->state->step, cn_status_text(status));
    }
}

void scene_steps_free(scene_steps *s)
{
    cn_work_free(s->work), cn_state_free(s->state), cn_state_free(s->trial);
    cn_model_free(s->model), cn_pool_free(s->pool), cn_world_free(s->world), cn_scene_free(s->scene);
    free(s->spec);
}

scene_motion scene_steps_motion(const scene_steps *s, int b)
{
    const cn_body *body = s->model->body[b].body;
    const cn_body_state *now = &s->state->body[b];
    scene_motion m = {0};
    for (int i = 0; i < body->nnode; i++) {
        m.mass += body->mass[i];
        cn_axpy(body->mass[i], now->x + 3 * i, m.centre);
        cn_axpy(body->mass[i], now->v + 3 * i, m.velocity);
        m.kinetic += 0.5 * body->mass[i] * cn_norm2(now->v + 3 * i);
    }
    for (int k = 0; k < 3; k++)
        m.centre[k] /= m.mass, m.velocity[k] /= m.mass;
    return m;
}
