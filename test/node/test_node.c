/* The node's C without ROS: calls, cancels and hostile requests from many threads, every call answered once;
 * the same where an allocation fails. CATNAV_EVERY_ALLOCATION: each of them in turn, not one in 61. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include <math.h>
#include <sys/stat.h>
#include <unistd.h>
#include "fail_alloc.h"
#include "fake_ros.h"

static char folder[64], scene_file[128];
static const double route[] = {0, 0, 0.01, 0, 0, 0.03};
static const cn_setting small[] = {{"bodies.catheter.model", "rod"},
                                   {"bodies.catheter.shape.catheter.stations", "13"},
                                   {"time_limit", "0.1"},
                                   {NULL, NULL}};

static void write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}
static const char *in_folder(const char *name)
{
    static char path[2][256];
    static int turn;
    snprintf(path[turn ^= 1], sizeof *path, "%s/%s", folder, name);
    return path[turn];
}

static const char scene_text[] =
    "scene: tube\nstep: 0.02\ntime_limit: 60\nvessels:\n  - name: artery\n    surface: {file: %s}\nbodies:\n"
    "  - name: catheter\n    shape: {catheter: {length: 0.04, diameter: 1.35e-3, entry: [0, 0, 0.01], "
    "direction: [0, 0, "
    "1], stations: 13, inserted: 0.01}}\n    material: {young: 8.7e6, poisson: 0.33, density: 1100}\n"
    "    waypoints: [[0, 0, 0.03]]\n";
static void write_scene(const char *name, const char *mesh)
{
    char text[2048];
    snprintf(text, sizeof text, scene_text, mesh);
    write_text(in_folder(name), text);
}

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/catnav_node_XXXXXX");
    if (!mkdtemp(folder)) return 1;
    snprintf(scene_file, sizeof scene_file, "%s/tube.yaml", folder);
    write_scene("tube.yaml", "tube.obj");
    write_text(in_folder("tube.obj"), "# the tests send it\n");
    return 0;
}
static int remove_folder(void **state)
{
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static cn_node *new_node(const cn_setting *parameter)
{
    cn_node *node;
    cn_error error = {0};
    if (fake_node(&node, scene_file, folder, parameter, &error) != CN_OK) fail_msg("%s", error.message);
    fake_tube(0.05, 0.004);
    fake_settle(node);
    return node;
}

static cn_ros_request request(void)
{
    return (cn_ros_request){
        .frame = "map", .nwaypoint = 2, .waypoint = route, .sampling = "", .scene = "", .seed = 1};
}

static void expect(cn_ros_request r, cn_verdict_code code, const char *words)
{
    fake_answer answer = fake_ask(&r);
    if (answer.verdict.code != code || !strstr(answer.verdict.message, words))
        fail_msg("expected %s '%s', got %s: %s", cn_verdict_name(code), words,
                 cn_verdict_name(answer.verdict.code), answer.verdict.message);
    assert_non_null(answer.json);
    free(answer.json);
}

static void test_a_bad_request_is_refused_in_words_and_the_next_one_served(void **state)
{
    (void)state;
    static const double nan_route[] = {0, 0, 0.01, 0, NAN, 0.02}, inf_route[] = {0, 0, INFINITY, 0, 0, 0.02};
    static const double far_route[] = {0, 0, 0.01, 1e300, 0, 0.02},
                        wall_route[] = {0, 0, 0.01, 0.0041, 0, 0.02};
    static const struct {
        const double *route;
        int n;
        const char *words;
    } routes[] = {{route, 0, "0 waypoints"},    {route, 1, "1 waypoints"},    {nan_route, 2, "waypoint 1"},
                  {inf_route, 2, "waypoint 0"}, {far_route, 2, "waypoint 1"}, {wall_route, 2, "waypoint 1"}};
    static const struct {
        cn_ros_limit limit;
        const char *words;
    } limits[] = {{{"", "speed", "", 1}, "limit on 'speed'"},
                  {{"", "", "", 1}, "limit on ''"},
                  {{"", "progress", "", 1}, "limit on 'progress'"},
                  {{"", "stress", "min", 1}, "reduce 'min'"},
                  {{"", "energy", "mean", 1}, "only max"},
                  {{"", "clearance", "mean", 1}, "only max"},
                  {{"", "stress", "max", -1}, "limit on stress is -1"},
                  {{"", "stress", "max", NAN}, "limit on stress is nan"},
                  {{"", "volume", "max", INFINITY}, "limit on volume is inf"},
                  {{"nobody", "stress", "max", 1}, "'nobody'"}};
    static const char *const samplings[] = {"grid", "Uniform", " uniform", "medial_axis\n", "contact2"};
    static const double budgets[] = {-1, NAN, INFINITY, -INFINITY};
    cn_node *node = new_node(small);
    for (size_t i = 0; i < sizeof routes / sizeof *routes; i++) {
        cn_ros_request r = request();
        r.waypoint = routes[i].route, r.nwaypoint = routes[i].n;
        expect(r, CN_VERDICT_BAD_INPUT, routes[i].words);
    }
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
        cn_ros_request r = request();
        r.limit = &limits[i].limit, r.nlimit = 1;
        expect(r, CN_VERDICT_BAD_INPUT, limits[i].words);
    }
    for (size_t i = 0; i < sizeof samplings / sizeof *samplings; i++) {
        cn_ros_request r = request();
        r.sampling = samplings[i];
        expect(r, CN_VERDICT_BAD_INPUT, "expected uniform, medial_axis or contact");
    }
    for (size_t i = 0; i < sizeof budgets / sizeof *budgets; i++) {
        cn_ros_request r = request();
        r.budget = budgets[i];
        expect(r, CN_VERDICT_BAD_INPUT, "budget is");
    }
    cn_ros_request r = request();
    r.frame = "moon";
    expect(r, CN_VERDICT_BAD_INPUT, "no transform");
    expect(request(), CN_VERDICT_TIMEOUT, "");
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}

static void test_a_bad_parameter_of_the_nodes_own_is_refused_in_words(void **state)
{
    (void)state;
    static const cn_setting bad[] = {{"on_busy", "maybe"},     {"on_busy", "Queue"},    {"queue_size", "0"},
                                     {"queue_size", "65"},     {"queue_size", "nan"},   {"frame_rate", "0"},
                                     {"frame_rate", "-1"},     {"frame_rate", "inf"},   {"frame_rate", "nan"},
                                     {"triangles_max", "0.5"}, {"triangles_max", "nan"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        const cn_setting parameter[] = {small[0], small[1], bad[i], {NULL, NULL}};
        cn_node *node = NULL;
        cn_error error = {0};
        char words[64];
        assert_int_equal(fake_node(&node, scene_file, folder, parameter, &error), CN_ERR_ARG);
        assert_null(node);
        snprintf(words, sizeof words, "~%s is ", bad[i].key);
        assert_non_null(strstr(error.message, words));
        assert_non_null(strstr(error.message, "expected"));
    }
}

/* Every key of a scene that names a file: none is read outside the folders. */
static void test_no_key_of_a_requested_scene_leads_out_of_its_folders(void **state)
{
    (void)state;
    static const char body[] =
        "bodies:\n  - name: cube\n    model: tet4\n    material: {young: 1.0e4, poisson: 0.3, "
        "density: 1000}\n    shape: {beam: {size: [.01, .01, .01], cells: [1, 1, 1]}}\n";
    static const char of_file[] =
        "bodies:\n  - name: cube\n    material: {young: 1.0e4, poisson: 0.3, density: 1000}\n";
    static const struct {
        const char *head, *key, *extension;
    } cases[] = {{body, "    skin: {file: %s}\n", "obj"},
                 {body, "    start: {positions: %s}\n", "txt"},
                 {of_file,
                  "    model: molecules\n    molecules: {file: %s}\n    shape: {beam: {size: [.01, .01, "
                  ".01], cells: [1, 1, 1]}}\n",
                  "txt"},
                 {of_file, "    model: tet4\n    shape: {file: %s}\n", "ele"},
                 {of_file, "    model: tet4\n    shape: {file: %s}\n", "node"},
                 {of_file, "    model: tet4\n    shape: {file: %s}\n", "msh"},
                 {body, "obstacles:\n  - {name: rock, shape: {file: %s}}\n", "obj"},
                 {body, "obstacles:\n  - {name: rock, surface: {file: %s}}\n", "obj"},
                 {body, "vessels:\n  - {name: artery, surface: {file: %s}}\n", "stl"},
                 {body, "shown:\n  - {file: %s}\n", "obj"}};
    char other[] = "/tmp/catnav_data_XXXXXX";
    cn_node *node = new_node((const cn_setting[]){{NULL, NULL}});
    assert_non_null(mkdtemp(other));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char file[96], key[512], text[2048];
        cn_ros_request r = request();
        snprintf(file, sizeof file, "%s/secret.%s", other, cases[i].extension);
        write_text(file, "0 0 0\n");
        snprintf(key, sizeof key, cases[i].key, file);
        snprintf(text, sizeof text, "scene: asks\nstep: 0.01\ntime_limit: 0.02\n%s%s", cases[i].head, key);
        write_text(in_folder("asks.yaml"), text);
        r.scene = "asks.yaml";
        expect(r, CN_VERDICT_BAD_INPUT, "outside the folders");
        unlink(file);
    }
    rmdir(other);
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}

static void test_a_requested_scene_follows_no_path_out_of_its_folders(void **state)
{
    (void)state;
    static const char *const outside[] = {"../etc/passwd", "/etc/passwd",      "..", "",
                                          "link.yaml",     "deep/../../x.yaml"};
    char other[] = "/tmp/catnav_data_XXXXXX", wall[64], up[64], folders[64];
    cn_ros_file_reply reply;
    cn_node *node = new_node(small);
    assert_non_null(mkdtemp(other));
    snprintf(wall, sizeof wall, "%s/wall.obj", other);
    snprintf(up, sizeof up, "../%s/wall.obj", strrchr(other, '/') + 1);
    snprintf(folders, sizeof folders, "/nonexistent:%s", other);
    write_text(wall, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_int_equal(symlink("/etc/passwd", in_folder("link.yaml")), 0);
    assert_int_equal(symlink(wall, in_folder("link.obj")), 0);
    assert_int_equal(symlink(other, in_folder("beside")), 0);
    for (size_t i = 0; i < sizeof outside / sizeof *outside; i++) {
        cn_ros_request r = request();
        if (outside[i][0]) {
            r.scene = outside[i];
            expect(r, CN_VERDICT_BAD_INPUT, "scene '");
        }
        fake_handlers()->load(node, outside[i], &reply);
        assert_false(reply.success);
        fake_handlers()->save(node, outside[i], &reply);
        assert_false(reply.success);
    }
    const char *const meshes[] = {wall, up, "link.obj", "beside/wall.obj", "./beside/../link.obj"};
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++) {
        cn_ros_request r = request();
        r.scene = "asks.yaml";
        write_scene("asks.yaml", meshes[i]);
        expect(r, CN_VERDICT_BAD_INPUT, i < 4 ? "outside the folders" : "expected a file");
    }
    assert_int_equal(mkfifo(in_folder("pipe.yaml"), 0600), 0);
    assert_int_equal(mkfifo(in_folder("pipe.obj"), 0600), 0);
    cn_ros_request r = request();
    r.scene = "pipe.yaml"; /* answered, not waited for */
    expect(r, CN_VERDICT_BAD_INPUT, "not a file");
    write_scene("asks.yaml", "pipe.obj");
    r.scene = "asks.yaml";
    expect(r, CN_VERDICT_BAD_INPUT, "expected a file");
    fake_node_free(node);

    const cn_setting with[] = {small[0], small[1], {"data_dirs", folders}, {NULL, NULL}};
    node = new_node(with);
    for (size_t i = 0; i < 4; i++) {
        write_scene("asks.yaml", meshes[i]);
        expect(r, CN_VERDICT_BAD_INPUT, "encloses no volume"); /* read, and found to be no vessel */
    }
    fake_node_free(node);
    unlink(wall), rmdir(other);
    assert_string_equal(fake_wrong(), "");
}

/* What a mesh message may say, from the wire. */
static void test_a_bad_mesh_message_is_refused_and_the_mesh_before_it_stays(void **state)
{
    (void)state;
    static const double vert[] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, bad_vert[] = {0, 0, 0, 1, NAN, 0, 0, 1, 0};
    static const int tri[] = {0, 1, 2}, bad_tri[] = {0, 1, 3}, low_tri[] = {0, -1, 2};
    char longer[300];
    memset(longer, 'x', sizeof longer - 1), longer[sizeof longer - 1] = 0;
    const struct {
        const char *name;
        int nvert;
        const double *vert;
        int ntri;
        const int *tri;
        int cut; /* bytes more (zero) or less than there should be */
        const char *words;
    } cases[] = {{"", 3, vert, 1, tri, -1, "not a catnav/SurfaceMesh"},
                 {"", 3, vert, 1, tri, -24, "not a catnav/SurfaceMesh"},
                 {"", 3, vert, 1, tri, 1, "not a catnav/SurfaceMesh"},
                 {"", 0, vert, 1, tri, 0, "empty: 0 vertices"},
                 {"", 3, vert, 0, tri, 0, "0 triangles"},
                 {"", 3, bad_vert, 1, tri, 0, "vertex 1 has the coordinate nan"},
                 {"", 3, vert, 1, bad_tri, 0, "triangle 0 names vertex 3 of 3"},
                 {"", 3, vert, 1, low_tri, 0, "triangle 0 names vertex 4294967295"},
                 {longer, 3, vert, 1, tri, 0, "too long"},
                 {"", 3, vert, 1, tri, 0, "encloses no volume"}};
    cn_node *node = new_node(small);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        size_t size;
        uint8_t *wire = fake_wire("map", cases[i].name, cases[i].nvert, cases[i].vert, cases[i].ntri,
                                  cases[i].tri, &size);
        wire = realloc(wire, size + 1);
        wire[size] = 0;
        fake_mesh(size + (size_t)cases[i].cut, wire);
        free(wire);
        fake_settle(node);
        expect(request(), CN_VERDICT_TIMEOUT, cases[i].words);
    }
    /* counts far beyond the message: nothing is made of them */
    for (int at = 0; at < 4; at++) {
        size_t size;
        uint8_t *wire = fake_wire("map", "", 3, vert, 1, tri, &size);
        const size_t places[] = {12, 19, 23, 39};
        memset(wire + places[at], 0xff, 4);
        fake_mesh(size, wire);
        free(wire);
        fake_settle(node);
        expect(request(), CN_VERDICT_TIMEOUT, "not a catnav/SurfaceMesh");
    }
    fake_mesh(0, NULL);
    fake_settle(node);
    fake_tube(0.05, 0.004);
    fake_settle(node);
    expect(request(), CN_VERDICT_TIMEOUT, "");
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}

static void test_a_cancel_while_a_map_is_made_is_answered_and_the_next_call_served(void **state)
{
    (void)state;
    static const char box[] =
        "v -.005 -.005 0\nv .005 -.005 0\nv .005 .005 0\nv -.005 .005 0\nv -.005 -.005 .05\nv .005 -.005 "
        ".05\n"
        "v .005 .005 .05\nv -.005 .005 .05\nf 3 2 1\nf 4 3 1\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\n"
        "f 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n";
    const cn_setting fine[] = {
        small[0], small[1], small[2], {"planner.resolution", "1.2e-4"}, {NULL, NULL}}; /* millions of cells */
    cn_ros_request r = request();
    cn_node *node = new_node(fine);
    write_text(in_folder("box.obj"), box);
    write_scene("boxed.yaml", "box.obj");
    r.scene = "boxed.yaml";
    const cn_ros_call call = fake_plan(&r);
    for (bool mapped = false; !mapped;) {
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
        pthread_mutex_lock(&node->lock);
        mapped = node->progress.stage == CN_STAGE_MAP;
        assert_true(mapped || node->open || node->nqueue > 0); /* that stage is told */
        pthread_mutex_unlock(&node->lock);
    }
    fake_handlers()->cancel(node, call);
    pthread_mutex_lock(&node->lock);
    const bool open = node->open, preparing = node->preparing;
    pthread_mutex_unlock(&node->lock);
    assert_true(preparing && !open); /* answered, and the map still in the making */
    fake_answer answer = fake_await(call);
    assert_int_equal(answer.verdict.code, CN_VERDICT_CANCELLED);
    assert_non_null(strstr(answer.verdict.message, "before the first step"));
    assert_non_null(strstr(answer.json, "boxed.yaml")); /* what it asked */
    free(answer.json);
    expect(request(), CN_VERDICT_TIMEOUT, "");
    expect(r, CN_VERDICT_TIMEOUT, "");
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}

typedef struct {
    cn_node *node;
    bool answered, waited; /* before the way was there */
} canceller;

static void cancel_now(void *user)
{
    canceller *c = user;
    pthread_mutex_lock(&c->node->lock);
    const cn_ros_call call = c->node->now.call;
    pthread_mutex_unlock(&c->node->lock);
    fake_handlers()->cancel(c->node, call);
    pthread_mutex_lock(&c->node->lock);
    c->answered = !c->node->open, c->waited = c->node->preparing;
    pthread_mutex_unlock(&c->node->lock);
}

static void test_a_cancel_while_a_way_is_sought_does_not_wait_for_it(void **state)
{
    (void)state;
    cn_node *node = new_node(small);
    canceller c = {.node = node};
    cn_ros_request r = request();
    fake_planning(cancel_now, &c);
    expect(r, CN_VERDICT_CANCELLED, "before the first step");
    fake_planning(NULL, NULL);
    assert_true(c.answered && c.waited);
    expect(r, CN_VERDICT_TIMEOUT, "");
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}

/* --- without memory --- */

/* One of everything. What is not answered, or ended twice, fake_wrong says. */
static void use(cn_node *node)
{
    static cn_ros_file_reply reply;
    const cn_ros_handlers *h = fake_handlers();
    const double point[] = {0.001, 0, 0.02};
    const cn_ros_limit limit = {"artery", "stress", "max", 1e9};
    cn_ros_request asked = request(), named = request();
    fake_tube(0.05, 0.004);
    fake_settle(node);
    asked.limit = &limit, asked.nlimit = 1;
    named.scene = "tube.yaml";
    const cn_ros_call first = fake_plan(&asked), second = fake_plan(&named);
    free(fake_await(first).json), free(fake_await(second).json);
    h->click(node, "map", point);
    h->load(node, "tube.yaml", &reply), h->save(node, "saved.yaml", &reply);
    h->mark(node, CN_ROS_MARK_PLAN, 0, "map", NULL);
    h->feedback(node);
}

static void test_where_memory_ends_a_call_is_answered_and_the_next_one_served(void **state)
{
    (void)state;
    static const cn_setting least[] = {{"bodies.catheter.model", "rod"},
                                       {"bodies.catheter.shape.catheter.stations", "7"},
                                       {"planner.resolution", "1e-3"},
                                       {"time_limit", "0.02"},
                                       {"on_busy", "queue"},
                                       {NULL, NULL}};
    const long stride = getenv("CATNAV_EVERY_ALLOCATION") ? 1 : 61;
    bool fired = true;
    for (long n = 0; fired; n += stride) {
        cn_node *node = NULL;
        cn_error error = {0};
        fail_alloc_at(n);
        const cn_status status = fake_node(&node, scene_file, folder, least, &error);
        if (status == CN_OK) use(node);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_true(status == CN_OK || (status == CN_ERR_MEMORY && error.message[0]));
        if (status == CN_OK) { /* once more, with memory */
            fake_tube(0.05, 0.004);
            fake_settle(node);
            expect(request(), CN_VERDICT_TIMEOUT, "");
        }
        fake_node_free(node);
        if (fake_wrong()[0]) fail_msg("allocation %ld: %s", n, fake_wrong());
    }
}

/* --- many at once --- */
enum { CLIENTS = 64, CALLS = 12 };
typedef struct {
    pthread_t thread;
    cn_node *node;
    unsigned dice;
    int answers;
} client;

static unsigned roll(client *c)
{
    return (c->dice = c->dice * 1103515245u + 12345u) >> 16;
}
static void *call_mixed(void *user)
{
    client *c = user;
    const cn_ros_handlers *h = fake_handlers();
    const double point[] = {1e-3 * (roll(c) % 5), 0, 1e-3 * (roll(c) % 50)};
    cn_ros_file_reply *reply = malloc(sizeof *reply);
    for (int i = 0; i < CALLS && reply; i++) {
        cn_ros_request r = request();
        cn_ros_tuning tuning = {0.01 + 1e-3 * (roll(c) % 5), -1, -1, -1, 30, {{-1, -1}}};
        switch (roll(c) % 10) {
        case 0:
            fake_tube(0.05, 0.004);
            break;
        case 1:
            h->click(c->node, roll(c) % 2 ? "map" : "robot", point);
            h->mark(c->node, (cn_ros_mark_event)(roll(c) % 7), (int)(roll(c) % 4), "map", point);
            break;
        case 2:
            h->load(c->node, "tube.yaml", reply);
            h->save(c->node, "saved.yaml", reply);
            break;
        case 3:
            for (int q = 0; q < CN_QUANTITY_PROGRESS; q++)
                tuning.limit[q][0] = tuning.limit[q][1] = -1;
            h->tune(c->node, &tuning);
            h->feedback(c->node);
            break;
        default:
            if (roll(c) % 4 == 0) r.nwaypoint = 1;
            if (roll(c) % 8 == 0) r.scene = "../x";
            const cn_ros_call call = fake_plan(&r);
            if (roll(c) % 2) {
                nanosleep(&(struct timespec){.tv_nsec = 1000 * (long)(roll(c) % 5000)}, NULL);
                h->cancel(c->node, call);
            }
            free(fake_await(call).json);
            c->answers++;
        }
    }
    free(reply);
    return NULL;
}

static void mixed(const char *on_busy)
{
    client *clients = calloc(CLIENTS, sizeof *clients);
    const cn_setting parameter[] = {
        small[0], small[1], {"time_limit", "0.2"}, {"on_busy", on_busy}, {NULL, NULL}};
    cn_node *node = new_node(parameter);
    int answers = 0;
    for (int i = 0; i < CLIENTS; i++) {
        clients[i] = (client){.node = node, .dice = (unsigned)i + 1};
        assert_int_equal(pthread_create(&clients[i].thread, NULL, call_mixed, &clients[i]), 0);
    }
    for (int i = 0; i < CLIENTS; i++)
        pthread_join(clients[i].thread, NULL), answers += clients[i].answers;
    free(clients);
    assert_true(answers > CLIENTS);
    fake_settle(node);
    *fake_stop() = 1;
    fake_node_free(node);
    assert_string_equal(fake_wrong(), "");
}
static void test_64_clients_that_are_refused_while_a_plan_runs_get_one_answer_a_call(void **state)
{
    (void)state;
    mixed("refuse");
}
static void test_64_clients_that_wait_in_a_queue_get_one_answer_a_call(void **state)
{
    (void)state;
    mixed("queue");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_bad_request_is_refused_in_words_and_the_next_one_served),
        cmocka_unit_test(test_a_bad_parameter_of_the_nodes_own_is_refused_in_words),
        cmocka_unit_test(test_no_key_of_a_requested_scene_leads_out_of_its_folders),
        cmocka_unit_test(test_a_requested_scene_follows_no_path_out_of_its_folders),
        cmocka_unit_test(test_a_bad_mesh_message_is_refused_and_the_mesh_before_it_stays),
        cmocka_unit_test(test_a_cancel_while_a_map_is_made_is_answered_and_the_next_call_served),
        cmocka_unit_test(test_a_cancel_while_a_way_is_sought_does_not_wait_for_it),
        cmocka_unit_test(test_where_memory_ends_a_call_is_answered_and_the_next_one_served),
        cmocka_unit_test(test_64_clients_that_are_refused_while_a_plan_runs_get_one_answer_a_call),
        cmocka_unit_test(test_64_clients_that_wait_in_a_queue_get_one_answer_a_call),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
