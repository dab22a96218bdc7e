/* test_run_alloc.c - every allocation of a world, its map, a plan and a whole run fails in turn: an answer,
 * no leak (LeakSanitizer judges), and what was there before goes on as if nothing had been. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/run.h"
#include "fail_alloc.h"

/* Straight through all points. */
static cn_status straight(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const size_t n = (size_t)query->npoint;
    roadmap->reproducible = true;
    roadmap->x = malloc(3 * n * sizeof(double));
    roadmap->leg = malloc(n * sizeof(int));
    if (!roadmap->x || !roadmap->leg) return cn_fail(error, CN_ERR_MEMORY, NULL, 0, "out of memory");
    roadmap->npoint = query->npoint;
    memcpy(roadmap->x, query->point, 3 * n * sizeof(double));
    for (int i = 0; i < query->npoint; i++)
        roadmap->leg[i] = i;
    return CN_OK;
}

static const cn_setting small[] = {{"time_limit", "0.06"},
                                   {"planner.resolution", "1e-3"},
                                   {"bodies.0.shape.catheter.stations", "7"},
                                   {"bodies.0.model", "tet4"}},
                        rod[] = {{"time_limit", "0.06"},
                                 {"planner.resolution", "1e-3"},
                                 {"bodies.0.shape.catheter.stations", "9"},
                                 {"bodies.0.model", "rod"}};

static cn_scene *read_scene(const cn_setting setting[4])
{
    cn_scene *scene;
    cn_error error = {0};
    if (cn_scene_read(&scene, CATNAV_TEST_DATA "/scenes/control_run.yaml", 4, setting, &error) != CN_OK)
        fail_msg("%s", error.message);
    return scene;
}

static cn_status new_world(cn_world **world, const cn_scene *scene, cn_error *error)
{
    cn_status status = cn_world_new(world, scene, 0, NULL, error);
    if (status == CN_OK) status = cn_world_map(*world, 1e-3, 2, error);
    return status;
}

static void a_world_and_its_map_are_made_or_refused(void **state)
{
    (void)state;
    cn_scene *scene = read_scene(small);
    cn_status status = CN_OK;
    for (FAIL_EACH_ALLOC) {
        cn_world *world = NULL;
        cn_error error = {0};
        status = new_world(&world, scene, &error);
        assert_true(status == CN_OK || status == CN_ERR_MEMORY);
        assert_int_equal(error.status, status);
        assert_true(status == CN_OK || error.message[0]);
        cn_world_free(world);
    }
    assert_int_equal(status, CN_OK);
    cn_scene_free(scene);
}

static void same_run(const cn_report *a, const cn_report *b)
{
    assert_int_equal(a->verdict.code, b->verdict.code);
    assert_int_equal(a->steps, b->steps);
    assert_memory_equal(a->body[0].tip, b->body[0].tip, sizeof a->body[0].tip);
    assert_memory_equal(&a->body[0].energy, &b->body[0].energy, sizeof(double));
}

static void runs_answer_and_leave_their_world_as_it_was(const cn_setting setting[4],
                                                        const cn_request *request)
{
    cn_scene *scene = read_scene(setting);
    cn_world *world;
    cn_report whole, report;
    cn_error error = {0};
    assert_int_equal(new_world(&world, scene, &error), CN_OK);
    assert_int_equal(cn_run(world, request, straight, 2, NULL, &whole, &error), CN_OK);
    for (FAIL_EACH_ALLOC) {
        error = (cn_error){0};
        const cn_status status = cn_run(world, request, straight, 2, NULL, &report, &error);
        if (status == CN_OK && report.verdict.code != CN_VERDICT_NUMERICS) /* it did without */
            same_run(&report, &whole);
        else
            assert_true(status == CN_OK || status == CN_ERR_MEMORY);
        assert_int_not_equal(report.verdict.code, CN_VERDICT_UNKNOWN);
        assert_true(report.verdict.message[0]);
        cn_report_clear(&report);
    }
    assert_int_equal(cn_run(world, request, straight, 2, NULL, &report, &error), CN_OK);
    same_run(&report, &whole);
    cn_report_clear(&whole), cn_report_clear(&report);
    cn_world_free(world);
    cn_scene_free(scene);
}

static void a_run_of_tetrahedra_answers(void **state)
{
    (void)state;
    runs_answer_and_leave_their_world_as_it_was(small, NULL);
}

/* A limit that breaks: the last valid state comes back, other ways are looked for. */
static void a_run_of_a_rod_that_plans_again_answers(void **state)
{
    (void)state;
    const cn_limit least = {.quantity = CN_QUANTITY_STRESS, .limit = 1};
    const cn_request request = {.nlimit = 1, .limit = &least};
    runs_answer_and_leave_their_world_as_it_was(rod, &request);
}

static void a_plan_answers(void **state)
{
    (void)state;
    cn_scene *scene = read_scene(small);
    cn_world *world;
    cn_error error = {0};
    cn_status status = CN_OK;
    assert_int_equal(new_world(&world, scene, &error), CN_OK);
    for (FAIL_EACH_ALLOC) {
        cn_path *path = NULL;
        cn_report report;
        error = (cn_error){0};
        status = cn_run_plan(world, NULL, straight, 2, &path, &report, &error);
        assert_true(path || status != CN_OK || report.verdict.code == CN_VERDICT_NUMERICS);
        cn_path_free(path);
        cn_report_clear(&report);
    }
    assert_int_equal(status, CN_OK);
    cn_world_free(world);
    cn_scene_free(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_world_and_its_map_are_made_or_refused),
        cmocka_unit_test(a_plan_answers),
        cmocka_unit_test(a_run_of_tetrahedra_answers),
        cmocka_unit_test(a_run_of_a_rod_that_plans_again_answers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
