/* Waypoints put into a scene file's text: they are what is read back, and nothing else changes. LINK: wrap */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>
#include "catnav/scene.h"
#include "fail_alloc.h"

static const double route[] = {0.1, 0.2, 0.3, 1. / 3, -2e-3, 1e9, 4, 5, 6};
static char folder[] = "/tmp/catnav_edit_XXXXXX", from[64], to[64];

static void put(const char *path, const char *text)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static void get(const char *path, char *text, size_t size)
{
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    text[fread(text, 1, size - 1, file)] = 0;
    fclose(file);
}

#define BODY     "material: {young: 1e6, poisson: 0.3, density: 1000}"
#define CATHETER "catheter: {length: 0.1, diameter: 1e-3, entry: [0, 0, 0], direction: [0, 0, 1]}"

static void holds_the_route(const char *path)
{
    cn_scene *scene;
    cn_error error = {0};
    if (cn_scene_read(&scene, path, 0, NULL, &error) != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(scene->body[0].nwaypoint, 2);
    assert_memory_equal(scene->body[0].waypoint, route + 3, 6 * sizeof(double));
    assert_memory_equal(scene->body[0].shape.catheter.entry, route, 3 * sizeof(double));
    cn_scene_free(scene);
}

static void waypoints_are_put_where_they_stood_in_every_style(void **state)
{
    static const char *const texts[] = {
        "# a\nscene: s\nbodies:\n  - name: c  # one\n    shape: {" CATHETER "}\n    " BODY
        "\n    waypoints: [[1, 2, 3]] # two\n# three\n",
        "bodies:\n- name: c\n  shape:\n    catheter:\n      length: 0.1\n      diameter: 1e-3\n      "
        "entry:\n      "
        "- 1\n      - 2\n      - 3\n      direction: [0, 0, 1]\n  " BODY
        "\n  waypoints:\n  - [0, 0, 0]\n  - - 1\n    - 2\n    - 3\n  waypoint_tolerance: 1e-3\nscene: s\n",
        "{scene: s, bodies: [{name: c, shape: {" CATHETER "}, waypoints: [[0,0,1],[0,0,2]], " BODY "}]}",
        /* missing keys are put in; characters of several bytes before them do not shift the place */
        "# \xc3\xa4\xe2\x82\xac\nscene: s\nbodies:\n  - name: c # \xc3\xbc\n    shape: {catheter: {length: "
        "0.1, "
        "diameter: 1e-3, direction: [0, 0, 1]}}\n    " BODY "\n",
        "\xef\xbb\xbf{scene: s, bodies: [{name: c, " BODY
        ", shape: {catheter: {length: 0.1, diameter: 1e-3}}}]}",
        "scene: s\nbodies:\n  - name: c\n    shape:\n      catheter:\n        length: 0.1\n        diameter: "
        "1e-3\n    " BODY "\n    limits: []\n"};
    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        cn_error error = {0};
        put(from, texts[i]);
        if (cn_scene_write_waypoints(from, to, 3, route, &error) != CN_OK)
            fail_msg("text %zu: %s", i, error.message);
        holds_the_route(to);
        assert_int_equal(cn_scene_write_waypoints(to, to, 3, route, &error), CN_OK); /* again, in place */
        holds_the_route(to);
    }
}

static void all_else_stays_as_it_stands(void **state)
{
    char text[1024];
    cn_error error = {0};
    (void)state;
    put(from, "scene: s # name\nbodies: # list\n  - name: c\n    waypoints: [[1, 2, 3]] # way\n    shape: "
              "{" CATHETER "} # shape\n    " BODY " # m\n# end");
    assert_int_equal(cn_scene_write_waypoints(from, to, 2, (double[]){0, 0, 0, 1, 1, 1}, &error), CN_OK);
    get(to, text, sizeof text);
    assert_string_equal(text, "scene: s # name\nbodies: # list\n  - name: c\n    waypoints: [[1, 1, 1]] # "
                              "way\n    shape: {" CATHETER "} # shape\n    " BODY " # m\n# end");
}

static void what_cannot_be_written_leaves_the_file_as_it_was(void **state)
{
    char text[1024];
    cn_error error = {0};
    (void)state;
    put(to, "old");
    put(from, "scene: s\nbodies: []\n");
    assert_int_not_equal(cn_scene_write_waypoints(from, to, 3, route, &error), CN_OK);
    put(from, "scene: s\nbodies: [\n");
    assert_int_equal(cn_scene_write_waypoints(from, to, 3, route, NULL), CN_ERR_PARSE);
    assert_int_equal(cn_scene_write_waypoints("missing", to, 3, route, NULL), CN_ERR_FILE);
    put(from, "scene: s\nbodies:\n  - name: c\n    shape: {" CATHETER "}\n    " BODY "\n");
    assert_int_equal(cn_scene_write_waypoints(from, to, 1, route, NULL), CN_ERR_ARG);
    const double bad[] = {0, 0, 0, 0.0 / 0.0, 0, 0};
    assert_int_not_equal(cn_scene_write_waypoints(from, to, 2, bad, NULL), CN_OK);
    get(to, text, sizeof text);
    assert_string_equal(text, "old");
    assert_int_equal(cn_scene_write_waypoints(from, "/nowhere/at/all.yaml", 3, route, NULL), CN_ERR_FILE);
}

static void a_failing_allocation_is_a_status_and_leaves_the_file(void **state)
{
    char text[1024];
    (void)state;
    put(from, "scene: s\nbodies:\n  - name: c\n    shape: {" CATHETER "}\n    " BODY "\n");
    for (long fail_n = 0;; fail_n++) {
        cn_error error = {0};
        fail_alloc_at(-1);
        put(to, "old");
        fail_alloc_at(fail_n);
        const cn_status status = cn_scene_write_waypoints(from, to, 3, route, &error);
        const bool fired = fail_alloc_fired();
        fail_alloc_at(-1);
        get(to, text, sizeof text);
        if (status == CN_OK)
            holds_the_route(to);
        else
            assert_string_equal(text, "old");
        assert_true(fired || status == CN_OK);
        if (!fired) break;
    }
}

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(from, sizeof from, "%s/from.yaml", folder);
    snprintf(to, sizeof to, "%s/to.yaml", folder);
    return 0;
}
static int remove_folder(void **state)
{
    (void)state;
    unlink(from), unlink(to);
    return rmdir(folder); /* fails where something was left beside them */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(waypoints_are_put_where_they_stood_in_every_style),
        cmocka_unit_test(all_else_stays_as_it_stands),
        cmocka_unit_test(what_cannot_be_written_leaves_the_file_as_it_was),
        cmocka_unit_test(a_failing_allocation_is_a_status_and_leaves_the_file),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
