/* fuzz_node.h - what the fuzzers of the node's message handlers share: a node over fake_ros.h, and bytes made
 * into what a message may hold. */
#ifndef FUZZ_NODE_H
#define FUZZ_NODE_H

#include "fuzz.h"
#include "fake_ros.h"
#include <sys/stat.h>

typedef struct {
    const uint8_t *at;
    size_t left;
} tape;

static inline unsigned take(tape *t)
{
    if (!t->left) return 0;
    t->left--;
    return *t->at++;
}

/* A number worth trying, one of millimetres, or any eight bytes. */
static inline double take_number(tape *t)
{
    static const double tried[] = {0,      -0.0, 1e-3,     0.01,      0.02,        0.03,       0.0041,
                                   1,      -1,   2,        1e6,       1e30,        1e300,      5e-324,
                                   -1e308, NAN,  INFINITY, -INFINITY, 2147483648., 4294967296.};
    const unsigned what = take(t);
    double any = 0;
    if (what < sizeof tried / sizeof *tried) return tried[what];
    if (what < 128) return 1e-3 * ((int)take(t) - 64);
    for (unsigned i = 0; i < sizeof any; i++)
        ((uint8_t *)&any)[i] = (uint8_t)take(t);
    return any;
}

/* One of the words that mean something, or up to 255 bytes of any; good until the tape's owner reuses `out`.
 */
static inline const char *take_text(tape *t, char out[256])
{
    static const char *const words[] = {
        "",          "map",      "/map",          "robot",       "moon",       "catheter",
        "artery",    "volume",   "stress",        "energy",      "wall_force", "clearance",
        "max",       "mean",     "medial_axis",   "contact",     "uniform",    "tube.yaml",
        "../x.yaml", "new.yaml", "deep/new.yaml", "/etc/passwd", "tube.yaml/", "."};
    const unsigned what = take(t);
    if (what < 128) return words[what % (sizeof words / sizeof *words)];
    const unsigned length = take(t);
    for (unsigned i = 0; i < length; i++)
        out[i] = (char)take(t);
    out[length] = 0;
    return out;
}

static char fuzz_folder[64];
static inline void fuzz_clean(void)
{
    char command[96];
    snprintf(command, sizeof command, "rm -rf %s", fuzz_folder);
    if (system(command)) fprintf(stderr, "%s is left\n", fuzz_folder);
}

/* The node with a scene of a few steps, in a folder of this process; made once, with a tube in force. */
static inline cn_node *fuzz_node(bool tube)
{
    static const char scene[] =
        "scene: tube\nstep: 0.02\nvessels:\n  - name: artery\n    surface: {file: tube.obj}\n"
        "bodies:\n  - name: catheter\n    model: rod\n    shape: {catheter: {length: 0.04, "
        "diameter: 1.35e-3, entry: [0, 0, 0.01], direction: [0, 0, 1], stations: 9, inserted: "
        "0.01}}\n    material: {young: 8.7e6, poisson: 0.33, density: 1100}\n"
        "    waypoints: [[0, 0, 0.03]]\n";
    static const cn_setting parameter[] = {
        {"time_limit", "0.06"}, {"planner.replans", "1"}, {"planner.resolution", "1e-3"}, {NULL, NULL}};
    static char path[3][128];
    char *const folder = fuzz_folder;
    static const char *const names[] = {"tube.yaml", "tube.obj"};
    const char *const texts[] = {scene, "# sent\n"};
    cn_node *node;
    cn_error error = {0};
    if (!folder[0]) {
        snprintf(folder, sizeof fuzz_folder, "/dev/shm/catnav_fuzz_%d", (int)getpid());
        require(!mkdir(folder, 0700), "no folder can be made");
        atexit(fuzz_clean);
        for (int i = 0; i < 2; i++) {
            snprintf(path[i], sizeof path[i], "%s/%s", folder, names[i]);
            FILE *file = fopen(path[i], "w");
            require(file && fputs(texts[i], file) >= 0 && !fclose(file), "no file can be written");
        }
    }
    require(fake_node(&node, path[0], folder, parameter, &error) == CN_OK, error.message);
    if (tube) {
        fake_tube(0.05, 0.004);
        fake_settle(node);
        require(node->stage != NULL, node->refusal);
    }
    return node;
}

static inline void fuzz_judge(void)
{
    require(!fake_wrong()[0], fake_wrong());
}

#endif
