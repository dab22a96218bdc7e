/* test_run_skin.c - skins from the scene file: made, hung, brought along, written beside the body. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "catnav/frames.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"

static char folder[] = "/tmp/test-run-skin-XXXXXX";

static int set_up(void **state)
{
    const double centre[3] = {0.05, 0.05, 0.05};
    char path[64];
    cn_surface *ball;
    (void)state;
    assert_non_null(mkdtemp(folder));
    assert_int_equal(cn_surface_sphere(&ball, centre, 0.04), CN_OK);
    snprintf(path, sizeof path, "%s/ball.stl", folder);
    assert_int_equal(cn_surface_write_stl(ball, path, NULL), CN_OK);
    for (int i = 0; i < 3 * ball->nvert; i++)
        ball->vert[i] *= 1000;
    snprintf(path, sizeof path, "%s/mm.stl", folder);
    assert_int_equal(cn_surface_write_stl(ball, path, NULL), CN_OK);
    cn_surface_free(ball);
    cn_surface *box;
    assert_int_equal(cn_surface_box(&box, (double[]){0.01, 0.01, 0.01}, centre), CN_OK);
    snprintf(path, sizeof path, "%s/box.stl", folder);
    assert_int_equal(cn_surface_write_stl(box, path, NULL), CN_OK);
    cn_surface_free(box);
    return 0;
}

static int tear_down(void **state)
{
    char command[96];
    (void)state;
    snprintf(command, sizeof command, "rm -r %s", folder);
    return system(command);
}

/* What the last frame had. */
typedef struct {
    cn_frames *frames;
    int nframe, nvert, step;
    double *x, *rest, mean_normal, moved[3];
} seen;

static void look(void *user, const cn_frame *frame)
{
    seen *s = user;
    const cn_frame_body *b = frame->body;
    if (s->frames) assert_int_equal(cn_frames_write(s->frames, frame, NULL), CN_OK);
    assert_non_null(b->skin);
    s->nframe++, s->nvert = b->skin->nvert, s->step = frame->step;
    s->x = realloc(s->x, 3 * (size_t)s->nvert * sizeof *s->x);
    s->rest = realloc(s->rest, 3 * (size_t)s->nvert * sizeof *s->rest);
    memcpy(s->x, b->worn->x, 3 * (size_t)s->nvert * sizeof *s->x);
    for (int r = 0; r < s->nvert; r++)
        cn_add(b->skin->centre, b->skin->rest + 3 * r, s->rest + 3 * b->skin->vertex[r]);
    for (int v = 0; v < s->nvert; v++)
        assert_true(fabs(cn_norm(b->worn->normal + 3 * v) - 1) < 1e-12);
    cn_sub(b->x, b->body->point, s->moved);
}

static void glance(void *user, const cn_frame *frame) /* memory for the skin's frame may be short */
{
    (void)user;
    for (int i = 0; i < frame->nbody; i++)
        assert_true((frame->body[i].skin == NULL) == (frame->body[i].worn == NULL));
}

/* With memory short now and then: s is NULL, and what comes of it is only not to crash. */
static cn_status run(const char *text, seen *s, cn_report *report)
{
    char path[64];
    cn_scene *scene;
    cn_world *world;
    cn_error error = {0};
    snprintf(path, sizeof path, "%s/scene.yaml", folder);
    FILE *file = fopen(path, "w");
    fputs(text, file);
    fclose(file);
    const bool catheter = strstr(text, "catheter") != NULL;
    const cn_setting small[] = {{"time_limit", "0.01"},
                                {catheter ? "bodies.0.shape.catheter.stations" : "bodies.0.shape.beam.cells",
                                 catheter ? "6" : "[1, 1, 1]"}};
    if (cn_scene_read(&scene, path, s ? 0 : 2, small, &error) != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    const cn_run_hooks hooks = {.user = s, .frame = s ? look : glance};
    cn_status status = CN_OK;
    if (s)
        status = cn_run(world, NULL, NULL, 2, &hooks, report, &error);
    else
        for (FAIL_EACH_ALLOC) {
            memset(&error, 0, sizeof error);
            status = cn_run(world, NULL, NULL, 1, &hooks, report, &error);
            assert_true(status == CN_OK || (fail_alloc_fired() && status == CN_ERR_MEMORY));
            cn_report_clear(report);
        }
    cn_world_free(world);
    cn_scene_free(scene);
    return status;
}

static void drop(seen *s, cn_report *report)
{
    free(s->x), free(s->rest);
    cn_report_clear(report);
}

#define CATHETER                                                                                             \
    "step: 0.01\ntime_limit: 0.05\ngravity: [0, -9.81, 0]\nbodies:\n- name: tube\n  model: rod\n"            \
    "  shape: {catheter: {length: 0.1, diameter: 0.002, entry: [1, 2, 3], direction: [1, 1, 0], "            \
    "inserted: 0.03, stations: 51, sides: 6}}\n"                                                             \
    "  material: {young: 1.0e+7, poisson: 0.3, density: 1000}\n"                                             \
    "  fixed: {box: [[0.9, 1.9, 2.9], [0.96, 1.96, 3.1]]}\n"

/* At rest on the circle about the axis, the tip where it is; bent it stays as far from its frames. */
static void a_catheter_wears_a_round_tube(void **state)
{
    (void)state;
    const double t[3] = {sqrt(0.5), sqrt(0.5), 0}, entry[3] = {1, 2, 3};
    seen s = {0};
    cn_report report;
    assert_int_equal(run(CATHETER "  skin: {sides: 24}\n", &s, &report), CN_OK);
    assert_int_equal(report.verdict.code, CN_VERDICT_RAN);
    assert_int_equal(s.step, 5);
    assert_int_equal(s.nframe, 6);
    double tip = -1, base = 1, low = 0, spread[2] = {INFINITY, 0};
    for (int v = 0; v < s.nvert; v++) {
        double from[3], across[3];
        cn_sub(s.rest + 3 * v, entry, from);
        const double along = cn_dot(from, t);
        cn_cross(from, t, across);
        tip = fmax(tip, along), base = fmin(base, along);
        assert_true(cn_norm(across) < 0.001 + 1e-12);
        if (along < 0.029 - 1e-12) assert_true(fabs(cn_norm(across) - 0.001) < 1e-12);
        low = fmin(low, s.x[3 * v + 1] - s.rest[3 * v + 1]);
    }
    assert_true(tip > 0.03 - 2e-5 && tip <= 0.03 + 1e-12 && fabs(base + 0.07) < 1e-12);
    assert_true(low < -1e-3);                       /* it has sagged */
    for (int v = 240; v + 24 <= s.nvert; v += 24) { /* rings are about as wide as they were */
        double mean[3] = {0};
        for (int i = 0; i < 24; i++)
            cn_axpy(1 / 24.0, s.x + 3 * (v + i), mean);
        for (int i = 0; i < 24; i++) {
            const double r = cn_distance(s.x + 3 * (v + i), mean);
            spread[0] = fmin(spread[0], r), spread[1] = fmax(spread[1], r);
        }
    }
    assert_true(spread[0] > 0.00099 && spread[1] < 0.00101);
    drop(&s, &report);
}

#define FALLING                                                                                              \
    "step: 0.01\ntime_limit: 0.1\ngravity: [0, 0, -9.81]\nbodies:\n- name: block\n"                          \
    "  shape: {beam: {size: [0.1, 0.1, 0.1], cells: [3, 3, 3]}}\n"                                           \
    "  material: {young: 1.0e+5, poisson: 0.3, density: 1000}\n"

static void a_falling_blocks_skin_falls_along_however_it_hangs(void **state)
{
    (void)state;
    static const char *const methods[] = {"auto", "embed", "blend"}, *const models[] = {"tet4", "tet10"};
    for (int m = 0; m < 6; m++) {
        char text[1024];
        seen s = {0};
        cn_report report;
        snprintf(text, sizeof text, FALLING "  model: %s\n  skin: {file: ball.stl, anchors: 8, method: %s}\n",
                 models[m % 2], methods[m / 2]);
        assert_int_equal(run(text, &s, &report), CN_OK);
        assert_int_equal(report.verdict.code, CN_VERDICT_RAN);
        assert_int_equal(s.nvert, 2562); /* corners of facets are merged */
        assert_true(s.moved[2] < -0.04);
        for (int v = 0; v < s.nvert; v++) {
            double d[3];
            cn_sub(s.x + 3 * v, s.rest + 3 * v, d);
            assert_true(cn_distance(d, s.moved) < 1e-7);
        }
        drop(&s, &report);
    }
}

/* About half a radius at most outside of the block that its molecules fill, and falling with it. */
static void molecules_wear_a_surface_made_about_them(void **state)
{
    (void)state;
    static const char *const skins[] = {"cell: 0", "cell: 0.004, anchors: 2", "file: ball.stl"};
    for (int i = 0; i < 3; i++) {
        char text[1024];
        seen s = {0};
        cn_report report;
        snprintf(text, sizeof text, FALLING "  model: molecules\n  molecules: {radius: 0.01}\n  skin: {%s}\n",
                 skins[i]);
        assert_int_equal(run(text, &s, &report), CN_OK);
        if (report.verdict.code != CN_VERDICT_RAN) fail_msg("%s", report.verdict.message);
        assert_true(s.moved[2] < -0.04);
        for (int v = 0; v < s.nvert; v++) {
            double d[3];
            cn_sub(s.x + 3 * v, s.rest + 3 * v, d);
            assert_true(cn_distance(d, s.moved) < 1e-7);
            for (int k = 0; k < 3; k++)
                assert_true(s.rest[3 * v + k] > -0.012 && s.rest[3 * v + k] < 0.112);
        }
        drop(&s, &report);
    }
}

static void frames_hold_the_skin_as_a_piece_of_its_own(void **state)
{
    (void)state;
    char path[96], text[4096] = "";
    struct stat info;
    seen s = {0};
    cn_report report;
    snprintf(path, sizeof path, "%s/frames", folder);
    assert_int_equal(cn_frames_open(&s.frames, path, NULL), CN_OK);
    assert_int_equal(run(FALLING "  skin: {file: ball.stl}\n", &s, &report), CN_OK);
    assert_int_equal(cn_frames_close(s.frames, NULL), CN_OK);
    snprintf(path, sizeof path, "%s/frames/frames.pvd", folder);
    FILE *file = fopen(path, "r");
    assert_true(fread(text, 1, sizeof text - 1, file) > 0);
    fclose(file);
    assert_non_null(strstr(text, "part=\"0\" file=\"block_10.vtu\""));
    assert_non_null(strstr(text, "part=\"1\" file=\"block_skin_10.vtp\""));
    snprintf(path, sizeof path, "%s/frames/block_skin_10.vtp", folder);
    file = fopen(path, "r");
    assert_non_null(file);
    memset(text, 0, sizeof text);
    assert_true(fread(text, 1, sizeof text - 1, file) > 0);
    fclose(file);
    assert_non_null(strstr(text, "NumberOfPoints=\"2562\""));
    assert_non_null(strstr(text, "Name=\"normal\" NumberOfComponents=\"3\""));
    assert_non_null(strstr(text, "Name=\"displacement\" NumberOfComponents=\"3\""));
    assert_non_null(strstr(text, "Name=\"stress\" NumberOfComponents=\"1\""));
    assert_int_equal(stat(path, &info), 0); /* points, normals, displacements, stress, corners, ends, sizes */
    assert_true(info.st_size > 2562 * 80 + 5120 * 16 + 48 &&
                info.st_size < 2562 * 80 + 5120 * 16 + 48 + 2048);
    char of_frames[96];
    snprintf(of_frames, sizeof of_frames, "%s/frames", folder);
    assert_int_equal(cn_frames_open(&s.frames, of_frames, NULL), CN_OK); /* another run: pieces go */
    assert_int_equal(cn_frames_close(s.frames, NULL), CN_OK);
    assert_int_not_equal(stat(path, &info), 0);
    drop(&s, &report);
}

static void skins_that_cannot_be_worn_are_refused(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        {FALLING "  skin: {sides: 12}\n", "a tube about a catheter"},
        {FALLING "  skin: {cell: 0}\n", "made about molecules"},
        {FALLING "  skin: {file: mm.stl}\n", "one place and unit"},
        {FALLING "  skin: {file: scene.yaml}\n", "scene.yaml"},
        {FALLING "  model: rod\n  skin: {file: ball.stl, method: embed}\n", "use method: blend"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        seen s = {0};
        cn_report report;
        run(cases[i][0], &s, &report);
        assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
        if (!strstr(report.verdict.message, cases[i][1])) fail_msg("%s", report.verdict.message);
        assert_int_equal(s.nframe, 0);
        drop(&s, &report);
    }
}

static void every_allocation_of_a_run_with_a_skin_may_fail(void **state)
{
    (void)state;
    static const char *const skins[] = {"file: box.stl", "file: box.stl, method: blend"};
    for (int i = 0; i < 3; i++) {
        char text[1024];
        cn_report report;
        if (i < 2)
            snprintf(text, sizeof text, FALLING "  skin: {%s}\n", skins[i]);
        else
            snprintf(text, sizeof text, CATHETER "  skin: {sides: 4}\n");
        assert_int_equal(run(text, NULL, &report), CN_OK);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_catheter_wears_a_round_tube),
        cmocka_unit_test(a_falling_blocks_skin_falls_along_however_it_hangs),
        cmocka_unit_test(molecules_wear_a_surface_made_about_them),
        cmocka_unit_test(frames_hold_the_skin_as_a_piece_of_its_own),
        cmocka_unit_test(skins_that_cannot_be_worn_are_refused),
        cmocka_unit_test(every_allocation_of_a_run_with_a_skin_may_fail),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
