/* test_step.c - time steps against converged references, free fall, energy, and what a failed step leaves. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "catnav/vec3.h"
#include "shapes.h"
#include "sim.h"

/* A scene of one body from a mesh, without walls; everything is freed by `put_away`. */
typedef struct {
    cn_scene scene;
    cn_body_spec spec;
    cn_world world;
    cn_model *model;
    cn_state *state, *trial;
    cn_work *work;
    cn_pool *pool;
    char path[64];
} bench;

static void write_mesh(const char *stem, const cn_tets *mesh)
{
    char name[96];
    snprintf(name, sizeof name, "%s.node", stem);
    FILE *f = fopen(name, "w");
    fprintf(f, "%d 3 0 0\n", mesh->nnode);
    for (int i = 0; i < mesh->nnode; i++)
        fprintf(f, "%d %.17g %.17g %.17g\n", i, mesh->node[3 * i], mesh->node[3 * i + 1],
                mesh->node[3 * i + 2]);
    fclose(f);
    snprintf(name, sizeof name, "%s.ele", stem);
    f = fopen(name, "w");
    fprintf(f, "%d 4 0\n", mesh->ntet);
    for (int e = 0; e < mesh->ntet; e++)
        fprintf(f, "%d %d %d %d %d\n", e, mesh->tet[4 * e], mesh->tet[4 * e + 1], mesh->tet[4 * e + 2],
                mesh->tet[4 * e + 3]);
    fclose(f);
}

static void set_up(bench *b, const cn_tets *mesh, double young, double poisson, double density, double dt,
                   int threads)
{
    cn_error error = {0};
    memset(b, 0, sizeof *b);
    snprintf(b->path, sizeof b->path, "/tmp/catnav_step_%ld", (long)getpid());
    write_mesh(b->path, mesh);
    static char file[80];
    snprintf(file, sizeof file, "%s.node", b->path);
    b->scene.step = dt, b->scene.solver.newton = -1, b->scene.solver.linear = CN_LINEAR_AUTO;
    b->scene.solver.tolerance = 1e-13, b->scene.solver.linear_tolerance = 1e-12;
    b->scene.leave_out.inertia = CN_AUTO;
    b->scene.contact.gap = b->scene.contact.stiffness = NAN;
    b->spec.name = "body";
    b->spec.shape.kind = CN_SHAPE_FILE, b->spec.shape.file = file, b->spec.shape.placement.scale = 1;
    b->spec.material = (cn_material){.young = young, .poisson = poisson, .density = density};
    b->spec.drive.control_all = true, b->spec.drive.goal_node = -1, b->spec.drive.speed = 1,
    b->spec.drive.path_distance = 1;
    b->world.scene = &b->scene;
    assert_int_equal(cn_pool_new(&b->pool, threads), CN_OK);
    const cn_status status = cn_model_new(&b->model, &b->scene, &b->world, 1, &b->spec, &error);
    if (status != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(cn_state_new(&b->state, b->model), CN_OK);
    assert_int_equal(cn_state_new(&b->trial, b->model), CN_OK);
}

static void start(bench *b)
{
    cn_error error = {0};
    assert_int_equal(cn_work_new(&b->work, b->model, 0, 1, b->pool, &error), CN_OK);
}

static void put_away(bench *b)
{
    char name[96];
    cn_work_free(b->work), cn_state_free(b->state), cn_state_free(b->trial), cn_model_free(b->model),
        cn_pool_free(b->pool);
    snprintf(name, sizeof name, "%s.node", b->path), remove(name);
    snprintf(name, sizeof name, "%s.ele", b->path), remove(name);
}

static cn_step_figures step(bench *b)
{
    cn_step_figures figures;
    const cn_status status = cn_step(b->model, b->state, b->trial, NULL, b->scene.step, b->work, &figures);
    if (status != CN_OK) fail_msg("step %d: %s", b->state->step, cn_status_text(status));
    figures.residual = cn_step_residual(b->model, b->state, b->trial, NULL, b->scene.step, b->work);
    b->trial->time = b->state->time + b->scene.step, b->trial->step = b->state->step + 1;
    cn_state *old = b->state;
    b->state = b->trial, b->trial = old;
    return figures;
}

static void vector_of(const json_t *array, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = json_number_value(json_array_get(array, (size_t)k));
}

static double number(const json_t *object, const char *key)
{
    return json_number_value(json_object_get(object, key));
}

/* Runs a golden case and returns the largest distance from its final positions, over the body's size. */
static double golden(const json_t *one, const char *scheme, int newton)
{
    cn_tets *mesh = reference_mesh(json_string_value(json_object_get(one, "mesh")));
    const json_t *speeds = json_object_get(one, "initial_velocities");
    const json_t *final = json_object_get(json_object_get(one, scheme), "final_positions");
    bench b;
    double worst = 0, p[3];
    if (!mesh) return 0;
    set_up(&b, mesh, number(one, "E"), number(one, "nu"), number(one, "density"), number(one, "dt"), 1);
    b.model->body[0].body->damping = number(one, "damping");
    vector_of(json_object_get(one, "gravity"), b.model->gravity);
    b.model->single = newton == 1;
    if (newton == 1) b.model->newton = 1;
    for (size_t i = 0; i < json_array_size(speeds); i++)
        vector_of(json_array_get(speeds, i), b.state->body[0].v + 3 * i);
    for (size_t i = 0; i < json_array_size(json_object_get(one, "fixed_nodes")); i++) {
        const size_t n = (size_t)json_integer_value(json_array_get(json_object_get(one, "fixed_nodes"), i));
        b.model->body[0].fixed[n] = 1;
    }
    start(&b);
    for (int i = 0; i < (int)number(one, "steps"); i++)
        step(&b);
    for (size_t i = 0; i < json_array_size(final); i++) {
        vector_of(json_array_get(final, i), p);
        worst = fmax(worst, cn_distance(p, b.state->body[0].x + 3 * i));
    }
    worst /= b.model->body[0].size;
    put_away(&b);
    cn_tets_free(mesh);
    return worst;
}

static void golden_cases(const char *scheme, int newton)
{
    FILE *file = reference_open("data/golden_steps.json");
    if (!file) skip();
    json_t *root = json_loadf(file, 0, NULL);
    fclose(file);
    assert_non_null(root);
    size_t i;
    json_t *one;
    json_array_foreach(json_object_get(root, "cases"), i, one)
    {
        const bool hard = number(one, "nu") > 0.499 || number(one, "E") > 1e11;
        const double worst = golden(one, scheme, newton);
        print_message("%-15s %-10s %.2e\n", json_string_value(json_object_get(one, "name")), scheme, worst);
        assert_true(worst < (hard ? 1e-7 : 1e-9));
    }
    json_decref(root);
}

static void converged_steps_equal_the_reference(void **state)
{
    (void)state, golden_cases("euler", -1);
}
static void one_frozen_solve_equals_the_papers_step(void **state)
{
    (void)state, golden_cases("seed_warp", 1);
}

static void a_body_falls_as_implicit_euler_says(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.1);
    const double dts[] = {1e-6, 1e-3, 1e-2, 1};
    for (int d = 0; d < 4; d++) {
        bench b;
        set_up(&b, mesh, 1e6, 0.3, 1000, dts[d], 1);
        b.model->gravity[2] = -9.81;
        start(&b);
        const int n = 20;
        for (int i = 0; i < n; i++)
            step(&b);
        const double drop = 0.5 * 9.81 * dts[d] * dts[d] * n * (n + 1);
        for (int i = 0; i < mesh->nnode; i++) {
            const double fell = b.model->body[0].body->rest[3 * i + 2] - b.state->body[0].x[3 * i + 2];
            assert_true(fabs(fell - drop) <= 1e-10 * drop + 1e-15);
        }
        put_away(&b);
    }
    cn_tets_free(mesh);
}

static void the_residual_is_small_when_recomputed_apart(void **state)
{
    (void)state;
    cn_tets *mesh = shape_chain(12, 6, 2.2e-3, 0.675e-3);
    bench b;
    set_up(&b, mesh, 8.7e6, 0.33, 1100, 0.01, 1);
    b.scene.solver.tolerance = 1e-3;
    b.model->gravity[0] = -9.81;
    for (int i = 0; i < 7; i++)
        b.model->body[0].fixed[i] = 1;
    start(&b);
    for (int i = 0; i < 30; i++)
        assert_true(step(&b).residual <= 1.01e-3);
    put_away(&b);
    cn_tets_free(mesh);
}

static void threads_do_not_change_a_bit(void **state)
{
    (void)state;
    cn_tets *mesh = shape_chain(40, 6, 2.2e-3, 0.675e-3);
    double *seen = NULL;
    for (int threads = 1; threads <= 2; threads++) {
        bench b;
        set_up(&b, mesh, 8.7e6, 0.33, 1100, 0.01, threads);
        b.model->gravity[0] = -9.81;
        for (int i = 0; i < 7; i++)
            b.model->body[0].fixed[i] = 1;
        start(&b);
        for (int i = 0; i < 20; i++)
            step(&b);
        const size_t size = 3 * (size_t)mesh->nnode * sizeof(double);
        if (threads == 1) {
            seen = malloc(size);
            memcpy(seen, b.state->body[0].x, size);
        } else {
            assert_memory_equal(seen, b.state->body[0].x, size);
        }
        put_away(&b);
    }
    free(seen);
    cn_tets_free(mesh);
}

/* A stiff bar that hardly turns: one factor serves many steps and the answer is that of fresh factors. */
static void a_frozen_factor_changes_the_work_not_the_answer(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(4, 2, 2, 0.1);
    double *fresh = NULL;
    for (int frozen = 0; frozen < 2; frozen++) {
        bench b;
        int kept = 0, made = 0;
        set_up(&b, mesh, 1e8, 0.3, 1000, 0.01, 1);
        b.scene.solver.linear = CN_LINEAR_CHOLESKY, b.scene.solver.tolerance = 1e-10;
        b.scene.leave_out.refactor = frozen ? CN_AUTO : CN_OFF;
        b.model->gravity[2] = -9.81;
        for (int i = 0; i < mesh->nnode; i++)
            b.model->body[0].fixed[i] = mesh->node[3 * i] < 0.03;
        start(&b);
        for (int i = 0; i < 50; i++) {
            const cn_step_figures figures = step(&b);
            kept += figures.kept, made += figures.newton;
        }
        const size_t n = 3 * (size_t)mesh->nnode;
        if (!frozen) {
            assert_int_equal(kept, 0);
            fresh = malloc(n * sizeof *fresh);
            memcpy(fresh, b.state->body[0].x, n * sizeof *fresh);
        } else {
            print_message("%d of %d iterations used an earlier factor\n", kept, made);
            assert_true(kept > 0.8 * made); /* most of the work, however few iterations it takes */
            for (size_t i = 0; i < n; i++)
                assert_true(fabs(fresh[i] - b.state->body[0].x[i]) < 1e-10);
        }
        put_away(&b);
    }
    free(fresh);
    cn_tets_free(mesh);
}

/* Distance of places between which a line of points turns by half a circle or more, pair by pair. */
static double half_turn_distance(int n, const double *x)
{
    double least = INFINITY;
    for (int i = 0; i < n; i++) {
        double turn = 0;
        for (int k = i + 1; k < n; k++) {
            double before[3], ahead[3];
            if (turn >= acos(-1.0)) least = fmin(least, cn_distance(x + 3 * i, x + 3 * k));
            if (k + 1 == n) break;
            cn_sub(x + 3 * k, x + 3 * k - 3, before), cn_sub(x + 3 * k + 3, x + 3 * k, ahead);
            cn_normalise(before), cn_normalise(ahead);
            turn += acos(fmax(-1, fmin(1, cn_dot(before, ahead))));
        }
    }
    return least;
}

static void a_slender_body_has_no_more_room_to_fold_than_its_half_turns_leave(void **state)
{
    enum { N = 200 };
    const double side = 2e-3, diameter = 1e-3;
    double x[3 * N] = {0};
    cn_body body = {.model = CN_BODY_ROD};
    const cn_model_body model = {.body = &body, .diameter = diameter};
    const cn_body_state at = {.x = x, .nfree = N};
    int apart = 0, near = 0;
    (void)state;
    for (int shape = 0; shape < 60; shape++) {
        /* a wave in a plane that bends further one way: from nearly straight to wound up */
        const double wave = 0.02 * (shape % 10), drift = 0.008 * (shape / 10);
        double angle = 0;
        for (int i = 1; i < N; i++) {
            angle += wave * sin(0.1 * i) + drift;
            x[3 * i] = x[3 * i - 3] + side * cos(angle), x[3 * i + 1] = x[3 * i - 2] + side * sin(angle);
        }
        const double room = cn_fold_room(&model, &at, NULL), least = half_turn_distance(N, x);
        assert_true(room <= fmax(0, least - 2 * diameter));
        assert_true(shape > 0 || room == INFINITY);
        apart += room > 0 && room < INFINITY, near += room == 0;
    }
    assert_true(apart > 10 && near > 10); /* both are seen */
}

static void a_failed_step_leaves_the_state_as_it_was(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    bench b;
    cn_step_figures figures;
    set_up(&b, mesh, 1e6, 0.3, 1000, 0.01, 1);
    start(&b);
    b.model->gravity[1] = NAN;
    cn_state *before;
    assert_int_equal(cn_state_new(&before, b.model), CN_OK);
    cn_state_copy(before, b.state);
    assert_int_not_equal(cn_step(b.model, b.state, b.trial, NULL, 0.01, b.work, &figures), CN_OK);
    assert_memory_equal(before->body[0].x, b.state->body[0].x, 3 * (size_t)mesh->nnode * sizeof(double));
    assert_memory_equal(before->body[0].v, b.state->body[0].v, 3 * (size_t)mesh->nnode * sizeof(double));
    cn_state_free(before);
    put_away(&b);
    cn_tets_free(mesh);
}

/* Its weight is none; under a load it is refused (test_stability_steps). */
static void an_unheld_massless_body_without_load_stays_as_it_is(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    bench b;
    cn_step_figures figures;
    set_up(&b, mesh, 1e6, 0.3, 0, 0.01, 1);
    b.model->gravity[1] = -1;
    b.scene.solver.linear = CN_LINEAR_CHOLESKY;
    start(&b);
    assert_int_equal(cn_step(b.model, b.state, b.trial, NULL, 0.01, b.work, &figures), CN_OK);
    assert_memory_equal(b.trial->body[0].x, b.state->body[0].x, 3 * (size_t)mesh->nnode * sizeof(double));
    put_away(&b);
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(converged_steps_equal_the_reference),
        cmocka_unit_test(one_frozen_solve_equals_the_papers_step),
        cmocka_unit_test(a_body_falls_as_implicit_euler_says),
        cmocka_unit_test(the_residual_is_small_when_recomputed_apart),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(a_frozen_factor_changes_the_work_not_the_answer),
        cmocka_unit_test(a_slender_body_has_no_more_room_to_fold_than_its_half_turns_leave),
        cmocka_unit_test(a_failed_step_leaves_the_state_as_it_was),
        cmocka_unit_test(an_unheld_massless_body_without_load_stays_as_it_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
