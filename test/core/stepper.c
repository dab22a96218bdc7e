#include "stepper.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>
#include "catnav/vec3.h"
#include "polar.h"

static void write_mesh(const char *node_file, const cn_tets *mesh)
{
    char name[96];
    FILE *f = fopen(node_file, "w");
    assert_non_null(f);
    fprintf(f, "%d 3 0 0\n", mesh->nnode);
    for (int i = 0; i < mesh->nnode; i++)
        fprintf(f, "%d %.17g %.17g %.17g\n", i, mesh->node[3 * i], mesh->node[3 * i + 1],
                mesh->node[3 * i + 2]);
    fclose(f);
    snprintf(name, sizeof name, "%s", node_file);
    strcpy(strrchr(name, '.'), ".ele");
    f = fopen(name, "w");
    assert_non_null(f);
    fprintf(f, "%d 4 0\n", mesh->ntet);
    for (int e = 0; e < mesh->ntet; e++) {
        const int *t = mesh->tet + 4 * e;
        fprintf(f, "%d %d %d %d %d\n", e, t[0], t[1], t[2], t[3]);
    }
    fclose(f);
}

void stepper_set(stepper *s, cn_material material, double dt)
{
    memset(s, 0, sizeof *s);
    s->scene.step = dt, s->scene.solver.newton = -1, s->scene.solver.linear = CN_LINEAR_AUTO;
    s->scene.solver.tolerance = 1e-13, s->scene.solver.linear_tolerance = 1e-12;
    s->scene.leave_out.inertia = s->scene.leave_out.refactor = CN_AUTO;
    s->scene.contact.gap = s->scene.contact.stiffness = NAN;
    s->spec.name = "body", s->spec.shape.kind = CN_SHAPE_FILE, s->spec.shape.placement.scale = 1;
    s->spec.material = material;
    s->spec.drive.control_all = true, s->spec.drive.goal_node = -1;
    s->spec.drive.speed = s->spec.drive.path_distance = 1;
    for (int k = 0; k < 3; k++)
        s->load.box[0][k] = -1e30, s->load.box[1][k] = 1e30;
    s->load.until = INFINITY;
}

cn_status stepper_make(stepper *s, const cn_tets *mesh)
{
    char ele[80];
    snprintf(s->file, sizeof s->file, "/tmp/catnav_stepper_%ld.node", (long)getpid());
    snprintf(ele, sizeof ele, "%.*s.ele", (int)strlen(s->file) - 5, s->file);
    if (mesh) write_mesh(s->file, mesh), s->spec.shape.file = s->file;
    s->spec.nload = 1, s->spec.load = &s->load;
    s->world.scene = &s->scene;
    cn_status status = cn_model_new(&s->model, &s->scene, &s->world, 1, &s->spec, &s->error);
    if (mesh) remove(s->file), remove(ele);
    if (status != CN_OK) return status;
    assert_int_equal(cn_pool_new(&s->pool, 1), CN_OK);
    assert_int_equal(cn_state_new(&s->state, s->model), CN_OK);
    assert_int_equal(cn_state_new(&s->trial, s->model), CN_OK);
    s->body = s->model->body[0].body, s->now = s->state->body;
    s->force = s->model->body[0].load[0].force, s->held = s->model->body[0].fixed;
    return CN_OK;
}

cn_status stepper_try(stepper *s)
{
    cn_state *old = s->state;
    cn_status status;
    if (!s->work && (status = cn_work_new(&s->work, s->model, 0, 1, s->pool, &s->error)) != CN_OK)
        return status;
    status = cn_step(s->model, s->state, s->trial, NULL, s->scene.step, s->work, &s->figure);
    if (status != CN_OK) return status;
    s->figure.residual = cn_step_residual(s->model, old, s->trial, NULL, s->scene.step, s->work);
    s->trial->time = old->time + s->scene.step, s->trial->step = old->step + 1;
    s->state = s->trial, s->trial = old, s->now = s->state->body;
    return CN_OK;
}

void stepper_step(stepper *s)
{
    const cn_status status = stepper_try(s);
    if (status != CN_OK) fail_msg("step %d: %s", s->state->step, cn_status_text(status));
}

void stepper_free(stepper *s)
{
    cn_work_free(s->work), cn_state_free(s->state), cn_state_free(s->trial);
    cn_model_free(s->model), cn_pool_free(s->pool);
}

stepper_motion stepper_moves(const stepper *s)
{
    const double *x = s->now->x, *v = s->now->v, *m = s->body->mass;
    stepper_motion out = {0};
    for (int i = 0; i < s->body->nnode; i++) {
        cn_axpy(m[i], x + 3 * i, out.centre), cn_axpy(m[i], v + 3 * i, out.linear);
        out.mass += m[i], out.kinetic += 0.5 * m[i] * cn_norm2(v + 3 * i);
    }
    for (int k = 0; k < 3 && out.mass > 0; k++)
        out.centre[k] /= out.mass;
    for (int i = 0; i < s->body->nnode; i++) {
        double from[3], turn[3];
        cn_sub(x + 3 * i, out.centre, from), cn_cross(from, v + 3 * i, turn);
        cn_axpy(m[i], turn, out.angular);
    }
    for (int i = 0; s->body->nblock > s->body->nnode && i < s->body->nnode; i++) { /* a rod's frames */
        const double *w = v + 3 * (s->body->nnode + i), *inertia = s->body->inertia + 3 * i;
        double r[9];
        cn_quaternion_matrix(s->now->rotation + 4 * i, r);
        for (int k = 0; k < 3; k++) {
            const double axis[3] = {r[k], r[3 + k], r[6 + k]}, rate = cn_dot(axis, w);
            cn_axpy(inertia[k] * rate, axis, out.angular);
            out.kinetic += 0.5 * inertia[k] * rate * rate;
        }
    }
    out.elastic = cn_body_energy(s->body, s->body->nnode, x, s->now->rotation, NULL);
    return out;
}

json_t *reference_json(const char *name)
{
    FILE *file = reference_open(name);
    if (!file) return NULL;
    json_t *json = json_loadf(file, 0, NULL);
    fclose(file);
    assert_non_null(json);
    return json;
}

double json_number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_number(value)) fail_msg("no number `%s`", key);
    return json_number_value(value);
}

static int flatten(const json_t *json, double *out)
{
    int n = 0;
    if (!json_is_array(json)) return out[0] = json_number_value(json), 1;
    for (size_t i = 0; i < json_array_size(json); i++)
        n += flatten(json_array_get(json, i), out + n);
    return n;
}

int json_numbers(const json_t *object, const char *key, double *out)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_array(value)) fail_msg("no array `%s`", key);
    return flatten(value, out);
}
