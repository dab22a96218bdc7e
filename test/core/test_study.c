/* test_study.c - the study of methods on a short catheter in a straight tube; a straight line is its plan. */
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
#include "catnav/run.h"
#include "catnav/study.h"

static cn_status straight(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const size_t n = (size_t)query->npoint;
    (void)error;
    *roadmap = (cn_roadmap){.npoint = query->npoint, .reproducible = true};
    roadmap->x = malloc(3 * n * sizeof *roadmap->x);
    roadmap->leg = malloc(n * sizeof *roadmap->leg);
    if (!roadmap->x || !roadmap->leg) return CN_ERR_MEMORY;
    memcpy(roadmap->x, query->point, 3 * n * sizeof *roadmap->x);
    for (int i = 0; i < query->npoint; i++)
        roadmap->leg[i] = i;
    return CN_OK;
}

/* A wire of 2 mm in a pipe, its entry on the axis. */
static const char text[] =
    "scene: pipe\n"
    "step: 0.02\n"
    "planner: {resolution: 1.0e-3}\n"
    "vessels: [{name: artery, surface: {file: " CATNAV_TEST_DATA "/scenes/pipe.stl}}]\n"
    "bodies:\n"
    "- name: wire\n"
    "  shape: {catheter: {length: 0.06, diameter: 2.0e-3, stations: 13}}\n"
    "  material: {young: 1.0e+7, poisson: 0.3, density: 1100}\n"
    "  waypoints: [[0.002, 0, 0.03]]\n";

typedef struct {
    char folder[64], file[96];
    cn_scene *scene;
    cn_world *world;
} bench;

static void set_up(bench *b, int nsetting, const cn_setting *setting)
{
    cn_error error = {0};
    snprintf(b->folder, sizeof b->folder, "/tmp/catnav_study_%ld", (long)getpid());
    snprintf(b->file, sizeof b->file, "%s.yaml", b->folder);
    FILE *file = fopen(b->file, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
    if (cn_scene_read(&b->scene, b->file, nsetting, setting, &error) != CN_OK) fail_msg("%s", error.message);
    if (cn_world_new(&b->world, b->scene, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
}

static void put_away(bench *b)
{
    char name[128];
    cn_world_free(b->world), cn_scene_free(b->scene);
    remove(b->file);
    snprintf(name, sizeof name, "%s/a/paper.csv", b->folder), remove(name);
    snprintf(name, sizeof name, "%s/a/paper.json", b->folder), remove(name);
    snprintf(name, sizeof name, "%s/a", b->folder), rmdir(name);
    rmdir(b->folder);
}

static void study_it(bench *b, int threads, const cn_study_hooks *hooks, cn_study *study)
{
    cn_error error = {0};
    const cn_status status = cn_study_paper(b->world, straight, threads, hooks, study, &error);
    if (status != CN_OK) fail_msg("%s", error.message);
}

static void both_methods_go_on_from_three_states(void **unused)
{
    static const double fraction[] = {0.25, 0.5, 0.9};
    bench b;
    cn_study study;
    (void)unused;
    set_up(&b, 0, NULL);
    study_it(&b, 1, NULL, &study);
    assert_int_equal(study.run.verdict.code, CN_VERDICT_REACHED);
    assert_int_equal(study.nstate, CN_STUDY_STATES);
    for (int i = 0; i < study.nstate; i++) {
        const cn_study_state *s = &study.state[i];
        const cn_study_row *own = &s->row[CN_STUDY_OWN], *paper = &s->row[CN_STUDY_PAPER];
        assert_int_equal(s->step, (int)round(fraction[i] * study.run.steps));
        assert_true(fabs(s->time - s->step * b.scene->step) < 1e-9);
        assert_true(i == 0 || s->free_nodes >= study.state[i - 1].free_nodes);
        for (int m = 0; m < CN_STUDY_METHODS; m++) {
            assert_int_equal(s->row[m].steps, CN_STUDY_STEPS);
            assert_int_equal(s->row[m].failure, CN_OK);
            assert_true(s->row[m].step_ms.median > 0 && s->row[m].step_ms.p95 >= s->row[m].step_ms.median);
        }
        /* one solve by many iterations against a step solved to its tolerance */
        assert_true(paper->newton.max == 1 && paper->newton.median == 1);
        assert_true(paper->linear.median > 10 && paper->linear.max <= 1000);
        assert_true(paper->unconverged == 0 && paper->linear_residual == 0);
        assert_true(own->linear.max == 1 && own->residual.max <= 2 * b.scene->solver.tolerance);
        assert_true(paper->residual.max > own->residual.max);
        assert_true(own->intersections == 0 && own->outside_nodes == 0);
        assert_true(own->ratio == 1 &&
                    fabs(paper->ratio * own->step_ms.median / paper->step_ms.median - 1) < 1e-12);
        /* both hold the tip where it was to go */
        assert_true(own->tip_apart == 0);
        assert_true(paper->tip_apart < b.scene->body[0].waypoint_tolerance);
    }
    cn_study_clear(&study);
    put_away(&b);
}

static void the_study_leaves_the_run_as_it_is(void **unused)
{
    bench b;
    cn_study study;
    cn_report plain;
    (void)unused;
    set_up(&b, 0, NULL);
    study_it(&b, 2, NULL, &study);
    assert_int_equal(cn_run(b.world, NULL, straight, 1, NULL, &plain, NULL), CN_OK);
    assert_int_equal(plain.steps, study.run.steps);
    assert_memory_equal(plain.body[0].tip, study.run.body[0].tip, sizeof plain.body[0].tip);
    assert_memory_equal(&plain.drive, &study.run.drive, sizeof plain.drive);
    cn_report_clear(&plain);
    cn_study_clear(&study);
    put_away(&b);
}

static void figures_do_not_depend_on_threads(void **unused)
{
    bench b;
    cn_study one, three;
    (void)unused;
    set_up(&b, 0, NULL);
    study_it(&b, 1, NULL, &one), study_it(&b, 3, NULL, &three);
    for (int i = 0; i < CN_STUDY_STATES; i++)
        for (int m = 0; m < CN_STUDY_METHODS; m++) {
            const cn_study_row *p = &one.state[i].row[m], *q = &three.state[i].row[m];
            assert_memory_equal(&p->residual, &q->residual, sizeof p->residual);
            assert_memory_equal(&p->linear, &q->linear, sizeof p->linear);
            assert_true(p->tip_apart == q->tip_apart);
        }
    cn_study_clear(&one), cn_study_clear(&three);
    put_away(&b);
}

/* A clamped wire of many thin sections falls: block-Jacobi does not get there in 1000 iterations. */
static void solves_that_do_not_converge_are_counted_with_their_residual(void **unused)
{
    static const cn_setting hard[] = {{"vessels", "[]"},
                                      {"bodies.wire.waypoints", "[]"},
                                      {"bodies.wire.model", "tet4"},
                                      {"bodies.wire.shape",
                                       "{catheter: {length: 0.134, diameter: 1.35e-3, entry: [0.134, 0, 0], "
                                       "direction: [1, 0, 0], stations: 61}}"},
                                      {"bodies.wire.fixed", "{box: [[-1e-4, -1, -1], [1e-4, 1, 1]]}"},
                                      {"gravity", "[0, 0, -9.81]"},
                                      {"time_limit", "0.4"}};
    bench b;
    cn_study study;
    long unconverged = 0;
    (void)unused;
    set_up(&b, (int)(sizeof hard / sizeof *hard), hard);
    study_it(&b, 2, NULL, &study);
    assert_int_equal(study.nstate, CN_STUDY_STATES);
    for (int i = 0; i < study.nstate; i++) {
        const cn_study_row *own = &study.state[i].row[CN_STUDY_OWN];
        const cn_study_row *paper = &study.state[i].row[CN_STUDY_PAPER];
        assert_true(own->unconverged == 0 && own->linear_residual == 0);
        assert_true(paper->unconverged <= CN_STUDY_STEPS);
        assert_int_equal(paper->unconverged > 0, paper->linear.max >= 1000);
        assert_int_equal(paper->unconverged > 0, paper->linear_residual > 1e-4);
        unconverged += paper->unconverged;
    }
    assert_true(unconverged > 0);
    cn_study_clear(&study);
    put_away(&b);
}

static void a_run_that_comes_to_nothing_says_why_and_has_no_states(void **unused)
{
    static const cn_setting outside = {"bodies.wire.waypoints", "[[1, 1, 1]]"};
    bench b;
    cn_study study;
    (void)unused;
    set_up(&b, 1, &outside);
    study_it(&b, 1, NULL, &study);
    assert_int_equal(study.nstate, 0);
    assert_int_equal(study.run.verdict.code, CN_VERDICT_BAD_INPUT);
    assert_non_null(strstr(study.run.verdict.message, "outside the free space"));
    cn_study_clear(&study);
    assert_int_equal(cn_study_paper(NULL, straight, 1, NULL, &study, NULL), CN_ERR_ARG);
    put_away(&b);
}

typedef struct {
    const char *until;
    volatile sig_atomic_t cancel;
} stopping;

static void stop_at(void *user, const char *what)
{
    stopping *s = user;
    if (strstr(what, s->until)) s->cancel = 1;
}

static void a_study_can_be_cancelled_in_the_run_and_between_steps(void **unused)
{
    bench b;
    cn_study study;
    (void)unused;
    set_up(&b, 0, NULL);
    stopping run = {.until = "the run: preparing"}, steps = {.until = "from 50 %"};
    const cn_study_hooks in_run = {.user = &run, .progress = stop_at, .cancel = &run.cancel},
                         in_steps = {.user = &steps, .progress = stop_at, .cancel = &steps.cancel};
    study_it(&b, 1, &in_run, &study);
    assert_int_equal(study.run.verdict.code, CN_VERDICT_CANCELLED);
    assert_int_equal(study.nstate, 0);
    cn_study_clear(&study);
    assert_int_equal(cn_study_paper(b.world, straight, 1, &in_steps, &study, NULL), CN_ERR_CANCELLED);
    assert_int_equal(study.nstate, 1);
    cn_study_clear(&study);
    put_away(&b);
}

static void csv_and_json_hold_the_same_figures_and_undefined_ones_as_nothing(void **unused)
{
    bench b;
    cn_study study;
    char folder[96], name[128], line[1024];
    double ratio, apart;
    (void)unused;
    set_up(&b, 0, NULL);
    study_it(&b, 1, NULL, &study);
    cn_study_row *failed = &study.state[1].row[CN_STUDY_PAPER];
    failed->steps = 7, failed->failure = CN_ERR_SINGULAR, failed->tip_apart = NAN;
    snprintf(folder, sizeof folder, "%s/a", b.folder);
    assert_int_equal(cn_study_write(&study, folder, NULL), CN_OK);
    snprintf(name, sizeof name, "%s/paper.json", folder);
    json_t *root = json_load_file(name, 0, NULL);
    assert_non_null(root);
    json_t *states = json_object_get(root, "states");
    assert_int_equal(json_array_size(states), CN_STUDY_STATES);
    snprintf(name, sizeof name, "%s/paper.csv", folder);
    FILE *file = fopen(name, "r");
    assert_non_null(file);
    assert_non_null(fgets(line, sizeof line, file));
    int columns = 1, at = 0; /* the column of the ratio */
    for (const char *c = line; *c; c++) {
        columns += *c == ',';
        if (!strncmp(c, ",ratio,", 7)) at = columns;
    }
    assert_true(at > 0);
    for (int i = 0; i < CN_STUDY_STATES * CN_STUDY_METHODS; i++) {
        const json_t *row =
            json_array_get(json_object_get(json_array_get(states, (size_t)i / 2), "methods"), (size_t)i % 2);
        const char *cell = line;
        int found = 1;
        assert_non_null(fgets(line, sizeof line, file));
        for (char *c = line; *c; c++) {
            found += *c == ',';
            if (*c == ',' && found == at) cell = c + 1;
        }
        assert_int_equal(found, columns);
        assert_int_equal(sscanf(cell, "%lf", &ratio), 1);
        assert_true(fabs(ratio / json_number_value(json_object_get(row, "ratio")) - 1) < 1e-8);
        const bool is_failed = i == 3;
        assert_true(json_is_null(json_object_get(row, "failure")) != is_failed);
        assert_true(json_is_null(json_object_get(row, "tip_apart")) == is_failed);
        assert_true((strstr(line, ",7,stiffness not positive definite,") != NULL) == is_failed);
        assert_int_equal(sscanf(strrchr(line, ',') + 1, "%lf", &apart) == 1, !is_failed);
    }
    fclose(file);
    json_decref(root);
    cn_study_clear(&study);

    cn_error error = {0};
    assert_int_equal(cn_study_write(&study, b.file, &error), CN_ERR_FILE);
    assert_non_null(strstr(error.message, "cannot be"));
    put_away(&b);
}

/* Plane stress: the published 23.96; plane strain at 0.499: the reference's computation in two dimensions. */
static void cook_s_membrane_bends_as_published(void **state)
{
    (void)state;
    cn_cook linear, quadratic;
    assert_int_equal(cn_study_cook(16, false, false, 1.0 / 3, &linear), CN_OK);
    assert_int_equal(cn_study_cook(8, true, false, 1.0 / 3, &quadratic), CN_OK);
    assert_true(fabs(quadratic.middle / 23.96 - 1) < 0.005 && linear.middle < quadratic.middle);
    assert_true(linear.nodes == 17 * 17 * 2 && quadratic.dof < 3 * quadratic.nodes);
    assert_int_equal(cn_study_cook(16, false, true, 0.499, &linear), CN_OK);
    assert_int_equal(cn_study_cook(16, true, true, 0.499, &quadratic), CN_OK);
    assert_true(fabs(quadratic.corner / (2.5 * 7.7771833) - 1) < 0.02);
    assert_true(linear.corner < 0.96 * quadratic.corner); /* far stiffer, on the same mesh */
    assert_int_equal(cn_study_cook(3, true, true, 0.3, &linear), CN_ERR_ARG);
    assert_int_equal(cn_study_cook(0, true, true, 0.3, &linear), CN_ERR_ARG);
    assert_int_equal(cn_study_cook(4, true, true, 0.5, &linear), CN_ERR_ARG);
    assert_int_equal(cn_study_cook(4, true, true, NAN, &linear), CN_ERR_ARG);
    assert_true(isnan(linear.corner));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_methods_go_on_from_three_states),
        cmocka_unit_test(the_study_leaves_the_run_as_it_is),
        cmocka_unit_test(figures_do_not_depend_on_threads),
        cmocka_unit_test(solves_that_do_not_converge_are_counted_with_their_residual),
        cmocka_unit_test(a_run_that_comes_to_nothing_says_why_and_has_no_states),
        cmocka_unit_test(a_study_can_be_cancelled_in_the_run_and_between_steps),
        cmocka_unit_test(csv_and_json_hold_the_same_figures_and_undefined_ones_as_nothing),
        cmocka_unit_test(cook_s_membrane_bends_as_published),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
