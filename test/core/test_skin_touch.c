/* test_skin_touch.c - contact on a skin: the map to its points, its transpose, and what rests on what. LINK:
 * wrap
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "catnav/run.h"
#include "catnav/skin.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "scene_steps.h"
#include "shapes.h"

#define MATERIAL "  material: {young: 1.0e+5, poisson: 0.25, density: 1000, damping: 5}\n"
#define BLOCK    "bodies:\n- name: block\n  shape: {beam: {size: [0.1, 0.1, 0.1], cells: [3, 3, 3]}}\n" MATERIAL
#define BAR      "bodies:\n- name: bar\n  shape: {beam: {size: [0.4, 0.04, 0.04], cells: [8, 1, 1]}}\n" MATERIAL

/* What a skin can hang on, as contact meets it. */
typedef struct {
    const char *text;
    cn_skin_kind kind;
    int anchors;
} hanging;
static const hanging all[] = {
    {BLOCK "  model: tet4\n", CN_SKIN_EMBED, 0},
    {BLOCK "  model: tet10\n", CN_SKIN_EMBED, 0},
    {BLOCK "  model: molecules\n  molecules: {radius: 0.01}\n", CN_SKIN_EMBED, 0},
    {BAR "  model: rod\n", CN_SKIN_BLEND, 1},
    {BAR "  model: rod\n", CN_SKIN_BLEND, 4},
    {BLOCK "  model: tet4\n", CN_SKIN_BLEND, 4},
    {BLOCK "  model: molecules\n  molecules: {radius: 0.01}\n", CN_SKIN_BLEND, 4},
};
enum { ALL = sizeof all / sizeof *all, LINEAR = 5 };

typedef struct {
    scene_steps scene;
    cn_body *body, *met;
    cn_skin *skin;
    cn_skin_state *worn;
    cn_carry *carry;
    double *x, *rotation, *turn, *p;
} hung;

/* The skin of a hanging: a ball about the block, inside and out of it, or about the bar. */
static hung hang(const hanging *how)
{
    hung h = {0};
    cn_surface *ball;
    const bool bar = strstr(how->text, "bar") != NULL;
    const double centre[3] = {bar ? 0.2 : 0.05, bar ? 0.02 : 0.05, bar ? 0.02 : 0.05};
    scene_steps_new(&h.scene, how->text, 0, NULL);
    cn_body *b = h.body = h.scene.model->body[0].body;
    assert_int_equal(cn_surface_sphere(&ball, centre, bar ? 0.05 : 0.06), CN_OK);
    const cn_tets tets = {b->npoint, b->ntet, b->point, b->tet, b->mid};
    h.x = malloc(3 * (size_t)b->nblock * sizeof *h.x), h.turn = malloc(4 * (size_t)b->nnode * sizeof *h.turn);
    h.rotation = malloc((4 * (size_t)b->nturn + 1) * sizeof *h.rotation);
    memset(h.x, 0, 3 * (size_t)b->nblock * sizeof *h.x);
    memcpy(h.x, b->rest, 3 * (size_t)b->nnode * sizeof *h.x);
    cn_body_rotation_start(b, h.rotation);
    cn_skin_rotations(b, h.x, h.rotation, h.turn, NULL);
    const cn_status made = how->kind == CN_SKIN_BLEND
                               ? cn_skin_new(&h.skin, ball, b->nnode, b->rest, h.turn, how->anchors, NULL)
                           : b->model == CN_BODY_MOLECULES ? cn_skin_new_molecules(&h.skin, ball, b, NULL)
                                                           : cn_skin_new_embedded(&h.skin, ball, &tets, NULL);
    assert_int_equal(made, CN_OK);
    assert_int_equal(cn_skin_touch(&h.met, h.skin, b), CN_OK);
    assert_int_equal(cn_skin_state_new(&h.worn, h.skin, NULL), CN_OK);
    assert_int_equal(cn_carry_new(&h.carry, h.met), CN_OK);
    h.p = malloc(3 * (size_t)h.met->npoint * sizeof *h.p);
    cn_surface_free(ball);
    return h;
}

static void take_off(hung *h)
{
    cn_carry_free(h->carry);
    cn_body_free(h->met);
    cn_skin_state_free(h->worn);
    cn_skin_free(h->skin);
    free(h->x), free(h->rotation), free(h->turn), free(h->p);
    scene_steps_free(&h->scene);
}

/* Squeezed and bent; a rod's rotation vectors besides. */
static void shake(hung *h, unsigned *seed)
{
    for (int i = 0; i < h->body->nblock; i++)
        for (int k = 0; k < 3; k++)
            h->x[3 * i + k] += (i < h->body->nnode ? 0.004 : 0.4) * shape_random(seed);
}

/* Vertex of the skin at each point: by where both lie at rest. */
static void points_lie_where_the_skin_is_shown(void **state)
{
    (void)state;
    for (int c = 0; c < ALL; c++) {
        hung h = hang(&all[c]);
        unsigned seed = 7;
        if (h.body->model != CN_BODY_ROD) shake(&h, &seed);
        cn_skin_rotations(h.body, h.x, h.rotation, h.turn, NULL);
        assert_int_equal(cn_skin_update(h.skin, h.x, h.turn, h.worn, NULL), CN_OK);
        cn_body_points(h.met, h.met->nnode, h.x, h.rotation, h.p);
        assert_int_equal(h.met->npoint, h.skin->nvert);
        for (int t = 0; t < 3 * h.skin->ntri; t++) /* triangles keep their order */
            assert_true(cn_distance(h.p + 3 * h.met->boundary->tri[t], h.worn->x + 3 * h.skin->tri[t]) <
                        1e-13);
        for (int t = 0; t < 3 * h.skin->ntri; t++)
            assert_true(h.met->boundary->tri[t] >= 0 && h.met->boundary->tri[t] < h.met->npoint);
        const double ball = 4 / 3.0 * acos(-1.0) * pow(h.body->model == CN_BODY_ROD ? 0.05 : 0.06, 3);
        assert_true(h.met->rest_volume > 0.97 * ball && h.met->rest_volume < ball);
        take_off(&h);
    }
}

/* f . d p(x) = (J' f) . dx by differences, for random motions; sums of force are kept. */
static void forces_return_by_the_transposed_derivative_of_the_map(void **state)
{
    (void)state;
    for (int c = 0; c < LINEAR; c++) {
        hung h = hang(&all[c]);
        unsigned seed = 3;
        const int np = 3 * h.met->npoint, nx = 3 * h.body->nblock;
        double *force = malloc((size_t)np * sizeof *force), *back = calloc((size_t)nx, sizeof *back);
        double *dx = malloc((size_t)nx * sizeof *dx), *p[2], sum[2][3] = {{0}}, size = 0;
        shake(&h, &seed);
        assert_true(cn_skin_moves_by_weights(h.skin, h.body));
        for (int i = 0; i < np; i++)
            force[i] = shape_random(&seed), sum[0][i % 3] += force[i];
        cn_body_carry(h.met, h.met->nnode, h.x, h.rotation, h.carry);
        cn_body_pull(h.met, h.met->nnode, h.x, h.rotation, h.carry, force, back, 1, NULL);
        for (int i = 0; i < 3 * h.body->nnode; i++)
            sum[1][i % 3] += back[i];
        assert_true(cn_distance(sum[0], sum[1]) < 1e-9);
        for (int k = 0; k < 2; k++)
            p[k] = malloc((size_t)np * sizeof **p);
        for (int way = 0; way < 5; way++) {
            const double e = 1e-5;
            double felt = 0, given = 0;
            for (int i = 0; i < nx; i++)
                dx[i] = (i < 3 * h.body->nnode ? 0.01 : 1) * shape_random(&seed);
            for (int k = 0; k < 2; k++) {
                for (int i = 0; i < nx; i++)
                    h.x[i] += (k ? -2 * e : e) * dx[i];
                cn_body_points(h.met, h.met->nnode, h.x, h.rotation, p[k]);
            }
            for (int i = 0; i < nx; i++)
                h.x[i] += e * dx[i], felt += back[i] * dx[i];
            for (int i = 0; i < np; i++)
                given += force[i] * (p[0][i] - p[1][i]) / (2 * e), size += fabs(p[0][i] - p[1][i]) / (2 * e);
            assert_true(fabs(felt - given) < 1e-9 * size);
        }
        free(force), free(back), free(dx), free(p[0]), free(p[1]);
        take_off(&h);
    }
}

/* What hangs on leading nodes alone leads, and does not feel the others. */
static void points_of_leading_nodes_lead(void **state)
{
    (void)state;
    for (int c = 0; c < LINEAR; c++) {
        hung h = hang(&all[c]);
        int last = 0;
        assert_int_equal(cn_body_points_of(h.met, 0), 0);
        assert_int_equal(cn_body_points_of(h.met, h.met->nnode), h.met->npoint);
        for (int n = 0; n <= h.met->nnode; n++) {
            const int here = cn_body_points_of(h.met, n);
            assert_true(here >= last);
            for (int i = last * h.met->nanchor; i < here * h.met->nanchor; i++)
                assert_true(h.met->anchor[i] < n);
            last = here;
        }
        take_off(&h);
    }
}

static void every_allocation_of_it_may_fail(void **state)
{
    (void)state;
    for (int c = 0; c < ALL; c++) {
        hung h = hang(&all[c]);
        for (FAIL_EACH_ALLOC) {
            cn_body *met;
            const cn_status status = cn_skin_touch(&met, h.skin, h.body);
            assert_true(status == (fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK));
            assert_true((met == NULL) == (status != CN_OK));
            cn_body_free(met);
        }
        take_off(&h);
    }
}

/* A load on points goes to what they hang on: the resultant and the moment about the face are those asked. */
static void a_load_on_the_surface_of_molecules_is_all_there(void **state)
{
    (void)state;
    scene_steps s;
    const double force[3] = {1, -2, 3}, moment[3] = {0.3, 0.2, -0.1}, middle[3] = {0.4, 0.02, 0.02};
    double sum[3] = {0}, turn[3] = {0};
    scene_steps_new(&s,
                    BAR
                    "  model: molecules\n  molecules: {radius: 0.0051}\n  load: [{box: [[0.3999, -1, -1], "
                    "[0.4001, 1, 1]], force: [1, -2, 3], moment: [0.3, 0.2, -0.1]}]\n",
                    0, NULL);
    const cn_body *b = s.model->body[0].body;
    for (int i = 0; i < b->nnode; i++) {
        const double *f = s.model->body[0].load[0].force + 3 * i;
        double arm[3], m[3];
        cn_sub(b->rest + 3 * i, middle, arm);
        cn_cross(arm, f, m);
        cn_axpy(1, f, sum), cn_axpy(1, m, turn);
    }
    assert_true(cn_distance(sum, force) < 1e-12 && cn_distance(turn, moment) < 1e-12);
    assert_true(s.model->body[0].ntip > 0); /* its end is of points, all on the face */
    for (int i = 0; i < s.model->body[0].ntip; i++)
        assert_true(fabs(b->point[3 * s.model->body[0].tip[i]] - 0.4) < 1e-9);
    scene_steps_free(&s);
}

/* --- runs --- */
static char folder[] = "/tmp/test-skin-touch-XXXXXX", ball_file[sizeof folder + 16];

static int write_ball(void **state)
{
    cn_surface *ball;
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(ball_file, sizeof ball_file, "%s/ball.stl", folder);
    assert_int_equal(cn_surface_sphere(&ball, (double[]){0.05, 0.05, 0.05}, 0.09), CN_OK);
    assert_int_equal(cn_surface_write_stl(ball, ball_file, NULL), CN_OK);
    cn_surface_free(ball);
    return 0;
}

static int remove_ball(void **state)
{
    (void)state;
    return remove(ball_file) || rmdir(folder);
}

/* Of the last frame: the lowest vertex of the skin and the lowest point of the body. */
typedef struct {
    double skin, body;
} lowest;

static void look(void *user, const cn_frame *frame)
{
    lowest *low = user;
    *low = (lowest){INFINITY, INFINITY};
    for (int v = 0; v < frame->body->skin->nvert; v++)
        low->skin = fmin(low->skin, frame->body->worn->x[3 * v + 2]);
    for (int p = 0; p < frame->body->body->npoint; p++)
        low->body = fmin(low->body, frame->body->x[3 * p + 2]);
}

static lowest run_text(const char *text, cn_report *report)
{
    char file[] = "/tmp/test-skin-touch-XXXXXX";
    cn_scene *scene;
    cn_world *world;
    cn_error error = {0};
    lowest low = {NAN, NAN};
    const int made = mkstemp(file);
    assert_int_equal(write(made, text, strlen(text)), strlen(text));
    close(made);
    const cn_status status = cn_scene_read(&scene, file, 0, NULL, &error);
    remove(file);
    if (status != CN_OK) fail_msg("%s", error.message);
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    const cn_run_hooks hooks = {.user = &low, .frame = look};
    assert_int_equal(cn_run(world, NULL, NULL, 1, &hooks, report, &error), CN_OK);
    cn_world_free(world);
    cn_scene_free(scene);
    return low;
}

#define FLOOR                                                                                                \
    "gravity: [0, 0, -9.81]\nobstacles:\n- {name: floor, shape: {plane: {point: [0, 0, -0.05], normal: "     \
    "[0, 0, 1]}}}\n"

static lowest run(const char *model, const char *more, cn_report *report)
{
    char text[2048];
    const bool contact = strstr(more, "contact: {") != NULL;
    snprintf(text, sizeof text,
             "step: 0.004\ntime_limit: 0.6\n" FLOOR BLOCK
             "  model: %s\n  molecules: {radius: 0.012}\n  skin: {file: \"%s\"%s}\n%s",
             model, ball_file, contact ? ", contact: on" : more, contact ? more : "");
    return run_text(text, report);
}

/* A rod of three-sided sections falls on its round skin. */
static void a_catheter_lies_on_its_round_skin(void **state)
{
    (void)state;
    cn_report report;
    const lowest low = run_text(
        "step: 0.002\ntime_limit: 0.1\n" FLOOR "bodies:\n- name: wire\n  model: rod\n  shape: {catheter: "
        "{length: 0.1, diameter: 0.004, entry: [0, 0, "
        "-0.047], direction: [1, 0, 0], inserted: 0.1, stations: 11, sides: 3, sheath: off}}\n"
        "  material: {young: 1.0e+7, poisson: 0.3, density: 1000, damping: 5}\n"
        "  skin: {sides: 16, contact: on}\n",
        &report);
    if (report.verdict.code != CN_VERDICT_RAN) fail_msg("%s", report.verdict.message);
    assert_int_equal(report.contact.intersections + report.contact.outside_nodes, 0);
    assert_true(report.contact.force_max > 0);
    assert_true(low.skin > -0.05 && low.skin < -0.0495);
    cn_report_clear(&report);
}

/* A ball worn by a block within it touches the floor at -5 cm, the block does not; without contact on the
 * skin it is the block that lies on the floor, the skin deep in it. */
static void strict_contact_holds_the_skin_out_of_the_floor(void **state)
{
    (void)state;
    static const char *const models[] = {"tet4", "tet10", "molecules"};
    for (int m = 0; m < 3; m++) {
        cn_report report;
        lowest low = run(models[m], ", contact: on", &report);
        if (report.verdict.code != CN_VERDICT_RAN) fail_msg("%s", report.verdict.message);
        assert_int_equal(report.contact.intersections, 0);
        assert_int_equal(report.contact.outside_nodes, 0);
        assert_true(report.contact.gap_min > 0);
        if (!(low.skin > -0.05 && low.skin < -0.045 && low.body > -0.05 + 0.012))
            fail_msg("%s: skin %g, body %g", models[m], low.skin, low.body);
        assert_true(fabs(report.contact.force_max) > 0.5 * 9.81);
        cn_report_clear(&report);
    }
    cn_report report;
    const lowest low = run("tet4", "", &report);
    assert_true(low.body > -0.05 && low.body < -0.04 && low.skin < -0.07);
    cn_report_clear(&report);
}

/* Springs at the skin's faces carry what it weighs, some depth in the floor, however it hangs. */
static void penalty_on_the_skin_carries_the_body(void **state)
{
    (void)state;
    static const char *const models[] = {"tet4", "tet10", "molecules"};
    for (int m = 0; m < 3; m++) {
        cn_report report;
        const lowest low = run(models[m], "contact: {method: penalty}\n", &report);
        if (report.verdict.code != CN_VERDICT_RAN) fail_msg("%s", report.verdict.message);
        assert_true(report.contact.intersections > 0);
        if (!(low.skin < -0.05 && low.skin > -0.1 && low.body > low.skin + 0.005))
            fail_msg("%s: skin %g, body %g", models[m], low.skin, low.body);
        assert_true(report.solver.residual_max < 1.1e-3);
        cn_report_clear(&report);
    }
}

static void what_contact_cannot_meet_is_refused(void **state)
{
    (void)state;
    cn_report report;
    run("tet4", ", contact: on, method: blend", &report);
    assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
    assert_non_null(strstr(report.verdict.message, "use method: embed"));
    cn_report_clear(&report);
    run("tet4", "contact: {method: project}\n", &report);
    assert_int_equal(report.verdict.code, CN_VERDICT_BAD_INPUT);
    assert_non_null(strstr(report.verdict.message, "skin.contact: off"));
    cn_report_clear(&report);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_lie_where_the_skin_is_shown),
        cmocka_unit_test(forces_return_by_the_transposed_derivative_of_the_map),
        cmocka_unit_test(points_of_leading_nodes_lead),
        cmocka_unit_test(every_allocation_of_it_may_fail),
        cmocka_unit_test(a_load_on_the_surface_of_molecules_is_all_there),
        cmocka_unit_test(strict_contact_holds_the_skin_out_of_the_floor),
        cmocka_unit_test(a_catheter_lies_on_its_round_skin),
        cmocka_unit_test(penalty_on_the_skin_carries_the_body),
        cmocka_unit_test(what_contact_cannot_meet_is_refused),
    };
    return cmocka_run_group_tests(tests, write_ball, remove_ball);
}
