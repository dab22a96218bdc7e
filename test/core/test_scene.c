#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include <locale.h>
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

#include "catnav/scene.h"
#include "fail_alloc.h"
#include "scene_schema.h"

static char folder[64], scene_file[96];

static void write_bytes(const char *path, size_t length, const char *bytes)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, length, file), length);
    assert_int_equal(fclose(file), 0);
}

static int make_folder(void **state)
{
    char path[128];
    (void)state;
    strcpy(folder, "test-scene-XXXXXX"); /* where the test runs */
    if (!mkdtemp(folder)) return 1;
    snprintf(scene_file, sizeof scene_file, "%s/scene.yaml", folder);
    snprintf(path, sizeof path, "%s/wall.stl", folder);
    write_bytes(path, 5, "wall\n");
    snprintf(path, sizeof path, "%s/deep", folder);
    return mkdir(path, 0700);
}

static int remove_folder(void **state)
{
    static const char *const names[] = {"scene.yaml", "wall.stl", "keys.yaml"};
    char path[128];
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    snprintf(path, sizeof path, "%s/deep", folder);
    rmdir(path);
    return rmdir(folder);
}

static cn_status read_text(const char *text, int nsetting, const cn_setting *setting, cn_scene **scene,
                           cn_error *error)
{
    memset(error, 0, sizeof *error);
    write_bytes(scene_file, strlen(text), text);
    return cn_scene_read(scene, scene_file, nsetting, setting, error);
}

static cn_scene *good(const char *text)
{
    cn_scene *scene;
    cn_error error;
    if (read_text(text, 0, NULL, &scene, &error) != CN_OK) fail_msg("line %d: %s", error.line, error.message);
    return scene;
}

/* What the bad scenes are variations of. */
static const char base[] = "scene: base\n"                                              /* 1 */
                           "step: 0.01\n"                                               /* 2 */
                           "gravity: [0, 0, 0]\n"                                       /* 3 */
                           "vessels:\n"                                                 /* 4 */
                           "- name: artery\n"                                           /* 5 */
                           "  surface: {file: wall.stl, scale: 0.001}\n"                /* 6 */
                           "  wall: {model: rigid}\n"                                   /* 7 */
                           "obstacles:\n"                                               /* 8 */
                           "- name: rock\n"                                             /* 9 */
                           "  shape: {sphere: {centre: [0, 0, 0], radius: 0.1}}\n"      /* 10 */
                           "bodies:\n"                                                  /* 11 */
                           "- name: device\n"                                           /* 12 */
                           "  shape:\n"                                                 /* 13 */
                           "    catheter: {length: 0.1, diameter: 1.0e-3}\n"            /* 14 */
                           "  material: {young: 1.0e+6, poisson: 0.3, density: 1000}\n" /* 15 */
                           "  waypoints: [[0, 0, 0.1]]\n"                               /* 16 */
                           "  limits:\n"                                                /* 17 */
                           "  - {quantity: volume, limit: 0.2}\n"                       /* 18 */
                           "contact: {method: strict}\n"                                /* 19 */
                           "solver: {newton: auto}\n";                                  /* 20 */

/* `from` in the base scene becomes `to`; the refusal is in `line` and speaks of `words`. */
static const struct {
    const char *from, *to;
    int line;
    const char *words;
} refusals[] = {
    /* keys */
    {"step:", "stpe:", 2, "unknown key \"stpe\"; the nearest known key is \"step\""},
    {"limits:", "limit:", 17, "the nearest known key is \"limits\""},
    {"catheter:", "katheter:", 14, "nearest known key is \"catheter\""},
    {"young:", "Young:", 15, "nearest known key is \"young\""},
    {"scale: 0.001", "scael: 0.001", 6, "nearest known key is \"scale\""},
    {"{newton: auto}", "{newtons: 1}", 20, "nearest known key is \"newton\""},
    {"scene: base\n", "scene: base\nstep: 0.02\n", 3, "\"step\" was already given in line 2"},
    {"radius: 0.1", "radius: 0.1, radius: 0.2", 10, "already given"},
    {"young: 1.0e+6, ", "", 15, "\"young\" is missing: expected a number > 0 [Pa]"},
    {", poisson: 0.3", "", 15, "\"poisson\" is missing"},
    {", density: 1000", "", 15, "\"density\" is missing"},
    {"length: 0.1, ", "", 14, "\"length\" is missing"},
    {", diameter: 1.0e-3", "", 14, "\"diameter\" is missing"},
    {"- name: device\n  shape", "- shape", 12, "\"name\" is missing"},
    {"file: wall.stl, ", "", 6, "\"file\" is missing"},
    {"centre: [0, 0, 0], ", "", 10, "\"centre\" is missing"},
    {"{quantity: volume, ", "{", 18, "\"quantity\" is missing"},
    {", limit: 0.2", "", 18, "\"limit\" is missing"},
    {"  surface: {file: wall.stl, scale: 0.001}\n", "", 5, "expected one of the keys surface, shape"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}", "{scale: 2}", 10,
     "expected one of the keys sphere, box, tube"},
    /* two at once */
    {"  wall: {model: rigid}", "  shape: {sphere: {centre: [0, 0, 0], radius: 1}}", 7, "exclude each other"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}",
     "{sphere: {centre: [0, 0, 0], radius: 1}, box: {min: [0, 0, 0], max: [1, 1, 1]}}", 10,
     "\"box\" and \"sphere\" exclude"},
    {"diameter: 1.0e-3}", "diameter: 1.0e-3}\n    file: wall.stl", 15, "\"file\" and \"catheter\" exclude"},
    {"shape: {sphere",
     "wall: {model: rigid}\n  body: {material: {young: 1, poisson: 0, density: 0}}\n  shape: {sphere", 11,
     "\"body\" and \"wall\" exclude"},
    /* types */
    {"step: 0.01", "step: [0.01]", 2, "expected a number > 0 [s], found a list"},
    {"step: 0.01", "step: fast", 2, "step: expected a number > 0 [s], found fast"},
    {"step: 0.01", "step:", 2, "found nothing"},
    {"step: 0.01", "step: \"0.01\"", 2, "found the text \"0.01\""},
    {"step: 0.01", "step: null", 2, "found null"},
    {"step: 0.01", "step: {a: 1}", 2, "found a map"},
    {"[0, 0, 0]\nvessels", "0\nvessels", 3, "expected three numbers [m/s^2]"},
    {"[0, 0, 0]\nvessels", "[0, 0]\nvessels", 3, "expected three numbers"},
    {"[0, 0, 0]\nvessels", "[0, 0, 0, 0]\nvessels", 3, "expected three numbers"},
    {"[0, 0, 0]\nvessels", "[0, 0, x]\nvessels", 3, "gravity"},
    {"{model: rigid}", "rigid", 7, "expected a map with keys such as model"},
    {"{model: rigid}", "{model: [rigid]}", 7, "one of rigid|membrane|shell"},
    {"{model: rigid}", "{model: elastic}", 7, "one of rigid|membrane|shell, found elastic"},
    {"[[0, 0, 0.1]]", "[0, 0, 0.1]", 16, "expected three numbers [m]"},
    {"[[0, 0, 0.1]]", "here", 16, "expected a list of points"},
    {"scene: base", "scene: [a]", 1, "expected a name"},
    {"scene: base", "scene: null", 1, "expected a name"},
    {"scene: base", "scene: \"a\\nb\"", 1, "control character"},
    {"  - {quantity: volume, limit: 0.2}", "    quantity: volume", 17, "expected a list of maps"},
    {"{quantity: volume, limit: 0.2}", "volume", 18, "expected a map with keys such as quantity"},
    {"method: strict", "method: [strict]", 19, "contact.method"},
    {"newton: auto", "newton: 1.5", 20, "expected a whole number"},
    {"newton: auto", "newton: 0", 20, ">= 1"},
    {"newton: auto", "newton: off", 20, "or auto"},
    {"name: rock", "name: \"\"", 9, "found nothing"},
    /* numbers */
    {"0.01\n", "0,01\n", 2, "found 0,01"},
    {"0.01\n", "0.01s\n", 2, "found 0.01s"},
    {"0.01\n", "0.01 s\n", 2, "found 0.01 s"},
    {"0.01\n", "nan\n", 2, "found nan"},
    {"0.01\n", ".nan\n", 2, "found .nan"},
    {"0.01\n", "inf\n", 2, "found inf"},
    {"0.01\n", ".inf\n", 2, "found .inf"},
    {"0.01\n", "1e999\n", 2, "found 1e999"},
    {"0.01\n", "0x1p-3\n", 2, "found 0x1p-3"},
    {"0.01\n", "010\n", 2, "found 010"},
    {"0.01\n", "0o10\n", 2, "found 0o10"},
    {"0.01\n", "1_000\n", 2, "found 1_000"},
    {"0.01\n", "1e\n", 2, "found 1e"},
    {"0.01\n", "--1\n", 2, "found --1"},
    {"0.01\n", ".\n", 2, "found ."},
    {"0.01\n", "1.2.3\n", 2, "found 1.2.3"},
    {"0.01\n", "0\n", 2, "step: expected a number > 0"},
    {"0.01\n", "-0.01\n", 2, "> 0"},
    {"0.01\n", "1000\n", 2, "longer than the time limit"},
    /* ranges */
    {"poisson: 0.3", "poisson: 0.5", 15, "> -1 and < 0.5, found 0.5"},
    {"poisson: 0.3", "poisson: -1", 15, "> -1 and < 0.5"},
    {"young: 1.0e+6", "young: 0", 15, "bodies.0.material.young"},
    {"density: 1000", "density: -1", 15, ">= 0 [kg/m^3]"},
    {"density: 1000", "density: 1000, damping: -1", 15, "damping: expected a number >= 0"},
    {"scale: 0.001", "scale: 0", 6, "> 0"},
    {"scale: 0.001", "scale: -1", 6, "> 0"},
    {"radius: 0.1", "radius: 0", 10, "> 0"},
    {"length: 0.1", "length: 0", 14, "> 0"},
    {"1.0e-3}", "1.0e-3, stations: 1}", 14, ">= 2"},
    {"1.0e-3}", "1.0e-3, stations: 2000000}", 14, "<= 1000000"},
    {"1.0e-3}", "1.0e-3, sides: 2}", 14, ">= 3"},
    {"1.0e-3}", "1.0e-3, inserted: -0.1}", 14, ">= 0"},
    {"1.0e-3}", "1.0e-3, direction: [0, 0, 0]}", 14, "direction must not be zero"},
    {"limit: 0.2", "limit: -1", 18, ">= 0"},
    {"scene: base", "seed: -1", 1, "expected a whole number"},
    {"scene: base", "seed: 4294967296", 1, "expected a whole number"},
    {"waypoints:", "waypoint_tolerance: 0\n  waypoints:", 16, "> 0"},
    {"waypoints:", "deadline: 0\n  waypoints:", 16, "> 0 [s], or null"},
    {"waypoints:", "path: {max_turn_deg: 0}\n  waypoints:", 16, "an angle > 0"},
    {"waypoints:", "path: {max_turn_deg: 181}\n  waypoints:", 16, "<= 180"},
    {"waypoints:", "drive: {speed: 0}\n  waypoints:", 16, "> 0 [m/s]"},
    {"waypoints:", "drive: {goal_node: -1}\n  waypoints:", 16, ">= 0"},
    {"waypoints:", "drive: {control: some}\n  waypoints:", 16, "expected all, a list"},
    {"waypoints:", "drive: {control: []}\n  waypoints:", 16, "empty"},
    {"waypoints:", "drive: {control: [0, -1]}\n  waypoints:", 16, "node index"},
    {"waypoints:", "drive: {control: {bax: 1}}\n  waypoints:", 16, "nearest known key is \"box\""},
    {"waypoints:", "fixed: {box: [[0, 0, 0], [1, 1, -1]]}\n  waypoints:", 16, "lower corner's z"},
    {"waypoints:", "fixed: {box: [[0, 0, 0]]}\n  waypoints:", 16, "two corners"},
    {"method: strict", "restitution: 1.1", 19, "<= 1"},
    {"method: strict", "friction: -0.1", 19, ">= 0"},
    {"method: strict", "gap: 0", 19, "> 0 [m], or auto"},
    {"newton: auto", "tolerance: 0", 20, "> 0"},
    {"newton: auto", "linear: magic", 20, "auto|cholesky|cg|chain"},
    /* contradictions */
    {"1.0e-3}", "1.0e-3, inner_diameter: 1.0e-3}", 14, "not below the diameter"},
    {"1.0e-3}", "1.0e-3, inserted: 0.2}", 14, "more than the length"},
    {"1.0e-3}", "1.0e-3, core: {diameter: 2.0e-3, young: 1, poisson: 0, density: 1}}", 14,
     "above the catheter's"},
    {"1.0e-3}", "1.0e-3, stations: 1000000, sides: 256}", 14,
     "a mesh of 257000000 nodes, and at most 2000000"},
    {"1.0e-3}", "1.0e-3, stations: 285715}", 14, "stations: they make a mesh of 2000005 nodes"},
    {"1.0e-3}", "1.0e-3, stations: 166667, inner_diameter: 5.0e-4}", 14, "a mesh of 2000004 nodes"},
    {"model: rigid", "model: membrane", 7, "needs the key \"thickness\""},
    {"model: rigid", "model: shell, thickness: 1.0e-3", 7, "needs the key \"young\""},
    {"model: rigid", "model: membrane, thickness: 1, young: 1, poisson: 0, density: 1", 7,
     "needs the key \"foundation\""},
    {"model: rigid", "model: membrane, thickness: 1, young: 1, poisson: 0, density: 1, foundation: 0", 7,
     "above 0 Pa/m"},
    {"quantity: volume", "quantity: energy, reduce: mean", 18, "energy has no mean"},
    {"quantity: volume", "quantity: progress", 18, "expected one of"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}", "{box: {min: [0, 0, 0], max: [1, 0, 1]}}", 10,
     "not above"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}",
     "{tube: {axis: [[0, 0, 0], [0, 0, 1]], radius: [1, 1, 1]}}", 10, "3 of them for 2 points"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}", "{tube: {axis: [[0, 0, 0]], radius: 1}}", 10, "too short"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}", "{tube: {axis: [[0, 0, 0], [0, 0, 0]], radius: 1}}", 10,
     "are the same"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}",
     "{tube: {axis: [[0, 0, 0], [0, 0, 1]], radius: 1, thickness: 1}}", 10, "not below the radius"},
    {"{sphere: {centre: [0, 0, 0], radius: 0.1}}", "{plane: {point: [0, 0, 0], normal: [0, 0, 0]}}", 10,
     "must not be zero"},
    {"name: rock", "name: artery", 9, "\"artery\" is already another's name"},
    {"name: device", "name: rock", 12, "already another's name"},
    {"waypoints:", "load: [{box: [[0, 0, 0], [1, 1, 1]], force: [0, 0, 0], from: 2, until: 1}]\n  waypoints:",
     16, "not after from"},
    {"waypoints:", "load: [{box: [[0, 0, 0], [1, 1, 1]]}]\n  waypoints:", 16, "needs a force or a moment"},
    {"waypoints:", "load: [{box: [[0, 0, 0], [1, 1, 1]], moment: [0, 1]}]\n  waypoints:", 16, "[N m]"},
    {"{newton: auto}", "{integrator: leapfrog}", 20, "euler|midpoint|trbdf2|explicit, found leapfrog"},
    {"{newton: auto}", "{integrator: midpoint}", 20, "solver.integrator: strict contact is solved for where"},
    {"{newton: auto}", "{integrator: midpoint, newton: 1}", 20, "single solve (newton: 1) is Euler's"},
    {"{newton: auto}", "{integrator: trbdf2, newton: 1}", 20, "is Euler's, not one of trbdf2"},
    {"{newton: auto}", "{integrator: trbdf2}\nleave_out: {inertia: on}", 20, "with inertia left out"},
    {"density: 1000}\n  waypoints: [[0, 0, 0.1]]\n  limits:\n  - {quantity: volume, limit: 0.2}\ncontact: "
     "{method: strict}\nsolver: {newton: auto}",
     "density: 0}\nsolver: {integrator: trbdf2}", 16, "density of \"device\" is 0"},
    {"waypoints:", "path: {region: {band: {surface: moon, max: 1}}}\n  waypoints:", 16,
     "\"moon\" is no vessel or obstacle"},
    {"waypoints:", "path: {region: {band: {surface: rock, min: 2, max: 1}}}\n  waypoints:", 16,
     "not above its min"},
    {"waypoints:", "path: {region: {box: {min: [0, 0, 0], max: [-1, 0, 0]}}}\n  waypoints:", 16,
     "below its min"},
    {"waypoints:", "path: {region: {box: {min: [0, 0, 0], max: [1, 1, 1]}, plane: {}}}\n  waypoints:", 16,
     "exclude"},
    {"catheter: {length: 0.1, diameter: 1.0e-3}", "beam: {size: [1, 1, 0], cells: [1, 1, 1]}", 14, "> 0"},
    {"catheter: {length: 0.1, diameter: 1.0e-3}", "beam: {size: [1, 1, 1], cells: [1, 0, 1]}", 14, ">= 1"},
    {"catheter: {length: 0.1, diameter: 1.0e-3}", "beam: {size: [1, 1, 1], cells: [1000, 1000, 1000]}", 14,
     "cells: they make a mesh of 1003003001 nodes, and at most 2000000"},
    {"catheter: {length: 0.1, diameter: 1.0e-3}", "beam: {size: [1, 1, 1], cells: [125, 125, 125]}", 14,
     "a mesh of 2000376 nodes"},
    {"catheter: {length: 0.1, diameter: 1.0e-3}", "file: wall.stl\n  model: rod", 15, "a rod needs an axis"},
    {"density: 1000}", "density: 1000, regions: [{along: [1, 0], young: 1}]}", 15, "ascending"},
    {"density: 1000}", "density: 1000, regions: [{along: [0, 1], box: [[0, 0, 0], [1, 1, 1]], young: 1}]}",
     15, "exclude"},
    {"density: 1000}", "density: 1000, regions: [{young: 1}]}", 15, "one of the keys box, along"},
    {"waypoints: [[0, 0, 0.1]]", "deadline: 3", 16, "no waypoints to reach"},
    {"shape: {sphere",
     "path: [[0, 0, 0], [1, 0, 0]]\n  body: {material: {young: 1, poisson: 0, density: 0}}\n  shape: {sphere",
     10, "only a rigid obstacle moves"},
    /* files */
    {"wall.stl", "gone.stl", 6, "gone.stl: No such file"},
    {"wall.stl", "deep", 6, "is none"},
    {"waypoints:", "skin: {file: gone.obj}\n  waypoints:", 16, "skin.file"},
    {"waypoints:", "start: {positions: gone.txt}\n  waypoints:", 16, "start.positions"},
    /* YAML */
    {"gravity: [0, 0, 0]", "gravity: [0, 0, 0", 4, "not readable as YAML"},
    {"gravity: [0, 0, 0]", "gravity: &g [0, 0, 0]", 3, "anchors are not used"},
    {"gravity: [0, 0, 0]", "gravity: *g", 3, "aliases are not used"},
    {"gravity: [0, 0, 0]", "gravity: !!seq [0, 0, 0]", 3, "tags are not used"},
    {"step: 0.01", "step: !!float 0.01", 2, "tags are not used"},
    {"vessels:", "---\nvessels:", 4, "one document"},
    {"gravity:", "[a, b]:", 3, "a key must be a word"},
    {"step:", "\tstep:", 2, "not readable as YAML"},
    {"gravity: [0, 0, 0]", "gravity: [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[0]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]",
     3, "nested deeper than 32"},
    {"scene: base", "scene: \"a\\0b\"", 1, "control character"},
    {"name: artery", "name: \"a\\nb\"", 5, "control character (byte 1)"},
    {"name: rock", "name: \"a\\tb\"", 9, "control character (byte 1)"},
    {"name: device", "name: \"a\\e[2J\"", 12, "control character (byte 1)"},
    {"name: device", "name: \"ab\\x7f\"", 12, "control character (byte 2)"},
    {"name: artery", "name: \"a\\u0085b\"", 5, "name: a control character or line end (byte 1)"},
    {"name: rock", "name: \"\\u2028b\"", 9, "name: a control character or line end (byte 0)"},
    {"name: device", "name: \"\\u00e9\\u009b\"", 12, "name: a control character or line end (byte 2)"},
};

static char *varied(const char *from, const char *to)
{
    const char *at = strstr(base, from);
    if (!at) fail_msg("the base scene has no \"%s\"", from);
    char *text = malloc(sizeof base + strlen(to));
    sprintf(text, "%.*s%s%s", (int)(at - base), base, to, at + strlen(from));
    return text;
}

static void the_scene_that_bad_ones_vary_is_good(void **state)
{
    (void)state;
    cn_scene_free(good(base));
}

static void every_bad_scene_is_refused_by_line_and_key(void **state)
{
    (void)state;
    int n = 0;
    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        if (!refusals[i].words) continue;
        cn_scene *scene;
        cn_error error;
        char *text = varied(refusals[i].from, refusals[i].to);
        const cn_status status = read_text(text, 0, NULL, &scene, &error);
        free(text);
        if (status == CN_OK || scene) fail_msg("%s was read", refusals[i].to);
        if (error.line != refusals[i].line || !strstr(error.message, refusals[i].words))
            fail_msg("\"%s\": expected line %d and \"%s\", got line %d: %s", refusals[i].to, refusals[i].line,
                     refusals[i].words, error.line, error.message);
        assert_string_equal(error.file, scene_file);
        assert_int_equal(error.status, status);
        n++;
    }
    assert_true(n >= 80);
}

static void a_file_that_is_no_scene_is_refused(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "",          "# nothing\n", "a",          "- a\n- b\n",   "[]",
        "{}",        "...",         "scene: a\n", "bodies: []\n", "\xff\xfe\xff",
        "a: \x80\n", "{{{{",        "- - - - -",  "bodies: *a"};
    cn_scene *scene;
    cn_error error;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        assert_int_not_equal(read_text(texts[i], 0, NULL, &scene, &error), CN_OK);
        assert_null(scene);
        assert_true(strlen(error.message) > 10);
    }
    memset(&error, 0, sizeof error);
    assert_int_equal(cn_scene_read(&scene, "/nowhere/scene.yaml", 0, NULL, &error), CN_ERR_FILE);
    memset(&error, 0, sizeof error);
    assert_int_equal(cn_scene_read(&scene, folder, 0, NULL, &error), CN_ERR_FILE);
    read_text("a: 1\nb: \"\xff\"\n", 0, NULL, &scene, &error);
    assert_int_equal(error.line, 2); /* bytes that are no UTF-8 have a line too */
}

static void deep_brackets_are_refused_at_once(void **state)
{
    (void)state;
    const size_t n = 4u << 20;
    char *text = malloc(n + 1);
    memset(text, '[', n);
    text[n] = 0;
    cn_scene *scene;
    cn_error error;
    assert_int_equal(read_text(text, 0, NULL, &scene, &error), CN_ERR_PARSE);
    assert_non_null(strstr(error.message, "nested deeper"));
    free(text);
}

static void a_file_beyond_16_mib_is_refused(void **state)
{
    (void)state;
    write_bytes(scene_file, 1, " ");
    assert_int_equal(truncate(scene_file, (16 << 20) + 1), 0);
    cn_scene *scene;
    cn_error error = {0};
    assert_int_equal(cn_scene_read(&scene, scene_file, 0, NULL, &error), CN_ERR_FILE);
    assert_non_null(strstr(error.message, "16 MiB"));
}

static const char full[] =
    "scene: every key\nseed: 4294967295\nstep: 0.02\ntime_limit: 30\ngravity: [1, -2, .5]\n"
    "vessels:\n"
    "- name: v0\n"
    "  surface: {file: wall.stl, scale: 0.001, rotate: [0.1, 0.2, 0.3], translate: [1, 2, 3]}\n"
    "  wall: {model: membrane, thickness: 0.001, young: 4e5, poisson: 0.45, density: 1060, foundation: 1e7, "
    "rims: held}\n"
    "  limits: [{quantity: wall_force, reduce: max, limit: 0.1}, {quantity: stress, reduce: mean, limit: "
    "5}]\n"
    "- name: v1\n"
    "  shape: {tube: {axis: [[0, 0, 0], [0, 0, 1]], radius: 0.1, thickness: 0.01}, scale: 2}\n"
    "obstacles:\n"
    "- {name: o0, shape: {sphere: {centre: [1, 2, 3], radius: 4}}, path: [[0, 0, 0], [1, 1, 1]]}\n"
    "- {name: o1, shape: {box: {min: [1, 2, 3], max: [4, 5, 6]}}, path: {waypoints: [[7, 8, 9]], speed: 2}}\n"
    "- {name: o2, shape: {plane: {point: [1, 2, 3], normal: [0, 0, 2]}}}\n"
    "- name: o3\n"
    "  shape: {tube: {axis: [[0, 0, 0], [0, 0, 1]], radius: [0.1, 0.2]}}\n"
    "  body: {model: tet10, material: {young: 1, poisson: 0.1, density: 2}, fixed: {box: [[0, 0, 0], [1, 1, "
    "1]]}}\n"
    "- {name: o4, shape: {file: wall.stl, translate: [0, 0, 1]}}\n"
    "shown: [{file: wall.stl, scale: 3}]\n"
    "bodies:\n"
    "- name: b0\n"
    "  shape:\n"
    "    catheter: {length: 1.5, diameter: 0.002, inner_diameter: 0.001, entry: [1, 2, 3], direction: [0, 3, "
    "4],\n"
    "      stations: 100, sides: 8, inserted: 0.5, sheath: on,\n"
    "      core: {diameter: 0.0005, young: 6e10, poisson: 0.3, density: 6450}}\n"
    "    scale: 1.5\n"
    "  model: rod\n"
    "  material: {young: 8.7e6, poisson: 0.33, density: 1100, damping: 0.1, damping_stiffness: 0.2,\n"
    "    regions: [{box: [[0, 0, 0], [1, 2, 3]], young: 5}, {along: [0.1, 0.2], young: 6}]}\n"
    "  start: {velocity: [1, 2, 3], spin: [4, 5, 6], positions: wall.stl}\n"
    "  fixed: {box: [[-1, -2, -3], [1, 2, 3]]}\n"
    "  load: [{box: [[0, 0, 0], [1, 1, 1]], force: [7, 8, 9], from: 0.5, until: 1.5}, {box: [[0, 0, 0], [0, "
    "0, 0]], moment: [1, 2, 3]}]\n"
    "  drive: {mode: push, nodes: uniform, control: [3, 1, 2], goal_node: 7, path_distance: 0.002, speed: "
    "0.1,\n"
    "    rest_length: 0.01, force_threshold: 0.3, advance_max: 0.4, twist_max: 0.5, tip_bend: {length: 0.6, "
    "curvature: 0.7}}\n"
    "  waypoints: [[0, 0, 0.1], [0, 0.02, 0.2]]\n"
    "  waypoint_tolerance: 0.003\n"
    "  deadline: 25\n"
    "  path: {sampling: contact, max_turn_deg: 90, clearance: 0.004, cost: bending,\n"
    "    region: {plane: {point: [1, 2, 3], normal: [2, 0, 0]}},\n"
    "    deviation: [{amplitude: 0.1, wavelength: 0.2, phase_deg: 180, normal: [0, 0, 9]}]}\n"
    "  limits: [{quantity: volume, limit: 0.2}, {quantity: clearance, limit: 0.001}, {quantity: energy, "
    "limit: 2}]\n"
    "  skin: {file: wall.stl, anchors: 5}\n"
    "- {name: b1, shape: {beam: {size: [1, 2, 3], cells: [4, 5, 6]}, rotate: [0, 0, 1]}, model: molecules,\n"
    "   molecules: {radius: 0.05, packing: jittered}, material: {young: 1, poisson: -0.5, density: 0},\n"
    "   drive: {control: {box: [[0, 0, 0], [1, 1, 2]]}}, path: {region: {box: {min: [0, 0, 0], max: [1, 1, "
    "1]}}}}\n"
    "- {name: b2, shape: {file: wall.stl}, molecules: {file: wall.stl}, material: {young: 1, poisson: 0, "
    "density: 1},\n"
    "   path: {region: {band: {surface: v0, min: 0.1, max: 0.2}}}}\n"
    "contact: {method: penalty, response: elastic, restitution: 0.5, self: off, friction: 0.2, stiffness: "
    "100, gap: 1e-5}\n"
    "solver: {newton: 7, linear: chain, integrator: euler, tolerance: 1e-5, linear_tolerance: 1e-6}\n"
    "planner: {samples: 1000, budget: 5, replans: 3, resolution: 1e-4}\n"
    "leave_out: {self_contact: on, refit: off, refactor: auto, wall_solve: true, inertia: false, stress: "
    "on}\n";

static void same3(const double *a, double x, double y, double z)
{
    assert_true(a[0] == x && a[1] == y && a[2] == z);
}

static void every_key_reads_into_its_field(void **state)
{
    (void)state;
    cn_scene *s = good(full);
    assert_string_equal(s->path, scene_file);
    assert_string_equal(s->name, "every key");
    assert_true(s->seed == 4294967295u && s->step == 0.02 && s->time_limit == 30);
    same3(s->gravity, 1, -2, 0.5);
    assert_true(s->nvessel == 2 && s->nobstacle == 5 && s->nshown == 1 && s->nbody == 3);

    const cn_surface_spec *v = s->vessel, *o = s->obstacle;
    char wall[128];
    snprintf(wall, sizeof wall, "%s/wall.stl", folder);
    assert_true(v->shape.kind == CN_SHAPE_FILE && !strcmp(v->shape.file, wall));
    assert_true(v->shape.placement.scale == 0.001);
    same3(v->shape.placement.rotate, 0.1, 0.2, 0.3);
    same3(v->shape.placement.translate, 1, 2, 3);
    assert_true(v->wall.model == CN_WALL_MEMBRANE && v->wall.thickness == 0.001 && v->wall.young == 4e5);
    assert_true(v->wall.poisson == 0.45 && v->wall.density == 1060 && v->wall.foundation == 1e7 &&
                v->wall.rims_held);
    assert_true(v->nlimit == 2 && v->limit[0].quantity == CN_QUANTITY_WALL_FORCE && v->limit[0].limit == 0.1);
    assert_true(v->limit[1].quantity == CN_QUANTITY_STRESS && v->limit[1].reduce == CN_REDUCE_MEAN);
    assert_true(v[1].shape.kind == CN_SHAPE_TUBE && v[1].shape.tube.naxis == 2 &&
                v[1].shape.tube.nradius == 1);
    assert_true(v[1].shape.tube.thickness == 0.01 && v[1].shape.placement.scale == 2);
    assert_true(o[0].shape.kind == CN_SHAPE_SPHERE && o[0].shape.sphere.radius == 4 && o[0].npath == 2);
    assert_true(o[0].path_speed == 0.05 && o[0].path[5] == 1 && !o[0].deformable);
    same3(o[0].shape.sphere.centre, 1, 2, 3);
    assert_true(o[1].shape.kind == CN_SHAPE_BOX && o[1].npath == 1 && o[1].path_speed == 2);
    same3(o[1].shape.box.min, 1, 2, 3);
    same3(o[1].shape.box.max, 4, 5, 6);
    assert_true(o[2].shape.kind == CN_SHAPE_PLANE);
    same3(o[2].shape.plane.point, 1, 2, 3);
    same3(o[2].shape.plane.normal, 0, 0, 1);
    assert_true(o[3].shape.tube.nradius == 2 && o[3].shape.tube.radius[1] == 0.2 &&
                o[3].shape.tube.thickness == 0);
    assert_true(o[3].deformable && o[3].model == CN_BODY_TET10 && o[3].material.density == 2 &&
                o[3].fixed.set);
    assert_true(o[4].shape.kind == CN_SHAPE_FILE && o[4].shape.placement.translate[2] == 1);
    assert_true(s->shown[0].placement.scale == 3 && !strcmp(s->shown[0].file, wall));

    const cn_body_spec *b = s->body;
    assert_true(b->shape.kind == CN_SHAPE_CATHETER && b->shape.catheter.length == 1.5 &&
                b->shape.placement.scale == 1.5);
    assert_true(b->shape.catheter.diameter == 0.002 && b->shape.catheter.inner_diameter == 0.001);
    same3(b->shape.catheter.entry, 1, 2, 3);
    assert_true(fabs(b->shape.catheter.direction[1] - 0.6) < 1e-15 &&
                fabs(b->shape.catheter.direction[2] - 0.8) < 1e-15);
    assert_true(b->shape.catheter.stations == 100 && b->shape.catheter.sides == 8 &&
                b->shape.catheter.inserted == 0.5);
    assert_true(b->shape.catheter.sheath == CN_ON && b->shape.catheter.has_core);
    assert_true(b->shape.catheter.core_diameter == 0.0005 && b->shape.catheter.core_young == 6e10);
    assert_true(b->shape.catheter.core_poisson == 0.3 && b->shape.catheter.core_density == 6450);
    assert_true(b->model == CN_BODY_ROD && b->material.young == 8.7e6 && b->material.poisson == 0.33);
    assert_true(b->material.density == 1100 && b->material.damping == 0.1 &&
                b->material.damping_stiffness == 0.2);
    assert_true(b->material.nregion == 2 && b->material.region[0].by_box && b->material.region[0].young == 5);
    same3(b->material.region[0].box[1], 1, 2, 3);
    assert_true(!b->material.region[1].by_box && b->material.region[1].along[1] == 0.2);
    same3(b->velocity, 1, 2, 3);
    same3(b->spin, 4, 5, 6);
    assert_true(b->fixed.set);
    same3(b->fixed.box[0], -1, -2, -3);
    assert_true(b->nload == 2 && b->load[0].from == 0.5 && b->load[0].until == 1.5);
    same3(b->load[0].force, 7, 8, 9);
    same3(b->load[0].moment, 0, 0, 0);
    assert_true(isinf(b->load[1].until) && b->load[1].from == 0);
    same3(b->load[1].force, 0, 0, 0);
    same3(b->load[1].moment, 1, 2, 3);
    assert_string_equal(b->start_file, wall);
    const cn_drive_spec *d = &b->drive;
    assert_true(d->mode == CN_DRIVE_PUSH && d->nodes == CN_NODES_UNIFORM && !d->control_all &&
                d->ncontrol == 3);
    assert_true(d->control[0] == 3 && d->control[2] == 2 && d->goal_node == 7 && d->path_distance == 0.002);
    assert_true(d->speed == 0.1 && d->rest_length == 0.01 && d->force_threshold == 0.3 &&
                d->advance_max == 0.4);
    assert_true(d->twist_max == 0.5 && d->bend_length == 0.6 && d->bend_curvature == 0.7);
    assert_true(b->nwaypoint == 2 && b->waypoint[4] == 0.02 && b->waypoint_tolerance == 0.003 &&
                b->deadline == 25);
    const cn_path_spec *p = &b->path;
    assert_true(p->sampling == CN_SAMPLING_CONTACT && fabs(p->max_turn - acos(-1) / 2) < 1e-15);
    assert_true(p->clearance == 0.004 && p->cost == CN_COST_BENDING && p->region == CN_REGION_PLANE);
    same3(p->plane_point, 1, 2, 3);
    same3(p->plane_normal, 1, 0, 0);
    assert_true(p->ndeviation == 1 && p->deviation[0].amplitude == 0.1 && p->deviation[0].wavelength == 0.2);
    assert_true(fabs(p->deviation[0].phase - acos(-1)) < 1e-15);
    same3(p->deviation[0].normal, 0, 0, 1);
    assert_true(b->nlimit == 3 && b->limit[1].quantity == CN_QUANTITY_CLEARANCE && b->limit[2].limit == 2);
    assert_true(!strcmp(b->skin_file, wall) && b->skin_anchors == 5);
    assert_true(b[1].shape.kind == CN_SHAPE_BEAM && b[1].shape.beam.cells[2] == 6 &&
                b[1].shape.placement.rotate[2] == 1);
    same3(b[1].shape.beam.size, 1, 2, 3);
    assert_true(b[1].model == CN_BODY_MOLECULES && b[1].molecule_radius == 0.05 && b[1].molecule_jittered);
    assert_true(b[1].drive.ncontrol == -1 && !b[1].drive.control_all && b[1].drive.control_box[1][2] == 2);
    assert_true(b[1].path.region == CN_REGION_BOX && b[1].path.box[1][0] == 1);
    assert_string_equal(b[2].molecule_file, wall);
    assert_true(b[2].path.region == CN_REGION_BAND && b[2].path.band_min == 0.1 && b[2].path.band_max == 0.2);
    assert_string_equal(b[2].path.band_surface, "v0");

    assert_true(s->contact.method == CN_CONTACT_PENALTY && s->contact.response == CN_RESPONSE_ELASTIC);
    assert_true(s->contact.restitution == 0.5 && s->contact.self == CN_OFF && s->contact.friction == 0.2);
    assert_true(s->contact.stiffness == 100 && s->contact.gap == 1e-5);
    assert_true(s->solver.newton == 7 && s->solver.linear == CN_LINEAR_CHAIN &&
                s->solver.integrator == CN_INTEGRATOR_EULER);
    assert_true(s->solver.tolerance == 1e-5 && s->solver.linear_tolerance == 1e-6);
    assert_true(s->planner.samples == 1000 && s->planner.budget == 5 && s->planner.replans == 3);
    assert_true(s->planner.resolution == 1e-4);
    assert_true(s->leave_out.self_contact == CN_ON && s->leave_out.refit == CN_OFF &&
                s->leave_out.refactor == CN_AUTO);
    assert_true(s->leave_out.wall_solve == CN_ON && s->leave_out.inertia == CN_OFF &&
                s->leave_out.stress == CN_ON);
    cn_scene_free(s);
}

static void what_is_left_out_has_the_contracts_default(void **state)
{
    (void)state;
    cn_scene *s = good("bodies:\n- name: a\n  shape: {beam: {size: [1, 1, 1], cells: [1, 1, 1]}}\n"
                       "  material: {young: 1, poisson: 0, density: 1}\n");
    const cn_body_spec *b = s->body;
    assert_true(s->seed == 1 && s->step == 0.01 && s->time_limit == 120 && s->nvessel == 0);
    same3(s->gravity, 0, 0, 0);
    assert_true(s->contact.method == CN_CONTACT_STRICT && s->contact.response == CN_RESPONSE_INELASTIC);
    assert_true(s->contact.restitution == 1 && s->contact.self == CN_AUTO && s->contact.friction == 0);
    assert_true(isnan(s->contact.stiffness) && isnan(s->contact.gap));
    assert_true(s->solver.newton == -1 && s->solver.linear == CN_LINEAR_AUTO && s->solver.tolerance == 1e-3);
    assert_true(s->solver.linear_tolerance == 1e-4 && s->planner.samples == -1 && s->planner.budget == 60);
    assert_true(s->planner.replans == 20 && isnan(s->planner.resolution) && s->leave_out.stress == CN_AUTO);
    assert_true(b->model == CN_BODY_TET4 && b->shape.placement.scale == 1 && b->material.damping == 0 &&
                !b->fixed.set && !b->start_file);
    assert_true(s->solver.integrator == CN_INTEGRATOR_EULER);
    assert_true(b->drive.mode == CN_DRIVE_FOLLOW && b->drive.nodes == CN_NODES_EACH && b->drive.control_all);
    assert_true(b->drive.goal_node == -1 && b->drive.path_distance == 1e-3 && b->drive.speed == 0.05);
    assert_true(b->drive.rest_length == 0 && isnan(b->drive.force_threshold) && b->drive.advance_max == 0.05);
    assert_true(b->drive.twist_max == 3.14 && b->nwaypoint == 0 && b->waypoint_tolerance == 2e-3 &&
                isinf(b->deadline));
    assert_true(b->path.sampling == CN_SAMPLING_UNIFORM && fabs(b->path.max_turn - acos(-1) / 4) < 1e-15);
    assert_true(b->path.clearance == 0 && b->path.region == CN_REGION_NONE && b->path.cost == CN_COST_LENGTH);
    assert_true(!b->skin_file && b->molecule_radius == 0.01 && !b->molecule_jittered);
    cn_scene_free(s);
    s = good(base);
    assert_true(s->body->path.sampling == CN_SAMPLING_MEDIAL_AXIS); /* there are vessels */
    assert_true(s->body->shape.catheter.stations == 455 && s->body->shape.catheter.sides == 6);
    assert_true(s->body->shape.catheter.sheath == CN_AUTO && !s->body->shape.catheter.has_core);
    assert_true(s->vessel->wall.model == CN_WALL_RIGID && s->body->limit->reduce == CN_REDUCE_MAX);
    cn_scene_free(s);
}

static void every_integrator_is_read_where_it_is_made_for(void **state)
{
    (void)state;
    static const char *const settings[][2] = {
        {"euler", "strict"}, {"trbdf2", "strict"}, {"midpoint", "project"}, {"midpoint", "none"}};
    static const cn_integrator expected[] = {CN_INTEGRATOR_EULER, CN_INTEGRATOR_TRBDF2,
                                             CN_INTEGRATOR_MIDPOINT, CN_INTEGRATOR_MIDPOINT};
    cn_scene *s;
    cn_error error;
    for (int i = 0; i < 4; i++) {
        const cn_setting setting[] = {{"solver.integrator", settings[i][0]},
                                      {"contact.method", settings[i][1]}};
        assert_int_equal(read_text(base, 2, setting, &s, &error), CN_OK);
        assert_int_equal(s->solver.integrator, expected[i]);
        cn_scene_free(s);
    }
    /* without walls there is nothing to touch */
    s = good("bodies:\n- name: a\n  shape: {beam: {size: [1, 1, 1], cells: [1, 1, 1]}}\n"
             "  material: {young: 1, poisson: 0, density: 1}\nsolver: {integrator: midpoint}\n");
    assert_int_equal(s->solver.integrator, CN_INTEGRATOR_MIDPOINT);
    cn_scene_free(s);
}

static void an_automatic_model_follows_from_the_shape(void **state)
{
    (void)state;
    static const char *const models[] = {"auto", "tet4", "tet10", "rod", "molecules"};
    for (int i = 0; i < 5; i++) {
        char to[64];
        snprintf(to, sizeof to, "waypoints: [[0, 0, 0.1]]\n  model: %s", models[i]);
        char *text = varied("waypoints: [[0, 0, 0.1]]", to);
        cn_scene *s = good(text);
        assert_int_equal(s->body->model, i ? i - 1 : CN_BODY_ROD);
        cn_scene_free(s);
        free(text);
    }
    const cn_setting project = {"contact.method", "project"};
    cn_scene *projected;
    cn_error error;
    char *plain = varied("waypoints: [[0, 0, 0.1]]", "waypoints: [[0, 0, 0.1]]");
    assert_int_equal(read_text(plain, 1, &project, &projected, &error), CN_OK);
    assert_int_equal(projected->body->model, CN_BODY_TET4); /* a rod has no nodes there to be moved */
    cn_scene_free(projected);
    free(plain);
    char *text =
        varied("shape: {sphere", "body: {material: {young: 1, poisson: 0, density: 1}}\n  shape: {sphere");
    cn_scene *s = good(text);
    assert_int_equal(s->obstacle->model, CN_BODY_TET4);
    cn_scene_free(s);
    free(text);
}

static void a_direction_of_any_length_becomes_a_unit_vector(void **state)
{
    (void)state;
    static const char *const directions[] = {"[0, 3e-300, 4e-300]", "[0, 3e300, 4e300]", "[0, 3, 4]"};
    for (int i = 0; i < 3; i++) {
        char to[96];
        snprintf(to, sizeof to, "1.0e-3, direction: %s}", directions[i]);
        char *text = varied("1.0e-3}", to);
        cn_scene *s = good(text);
        const double *d = s->body->shape.catheter.direction;
        assert_true(d[0] == 0 && fabs(d[1] - 0.6) < 1e-15 && fabs(d[2] - 0.8) < 1e-15);
        cn_scene_free(s);
        free(text);
    }
}

static void a_mesh_of_just_under_two_million_nodes_is_read(void **state)
{
    (void)state;
    static const char *const fine[][2] = {
        {"1.0e-3}", "1.0e-3, stations: 285714}"},
        {"1.0e-3}", "1.0e-3, stations: 166666, inner_diameter: 5.0e-4}"},
        {"catheter: {length: 0.1, diameter: 1.0e-3}", "beam: {size: [1, 1, 1], cells: [124, 125, 125]}"}};
    for (int i = 0; i < 3; i++) {
        char *text = varied(fine[i][0], fine[i][1]);
        cn_scene_free(good(text));
        free(text);
    }
}

static void a_scene_written_as_json_is_read(void **state)
{
    (void)state;
    cn_scene *s =
        good("{\"scene\": \"j\", \"leave_out\": {\"refit\": \"on\"}, \"solver\": {\"newton\": \"auto\"},"
             " \"bodies\": [{\"name\": \"a\", \"shape\": {\"file\": \"wall.stl\"}, \"deadline\": null,\n"
             " \"material\": {\"young\": 1.5e6, \"poisson\": 0.25, \"density\": 1000}}]}");
    assert_true(s->leave_out.refit == CN_ON && s->body->material.young == 1.5e6);
    cn_scene_free(s);
}

static void settings_reach_into_maps_and_lists(void **state)
{
    (void)state;
    static const cn_setting settings[] = {
        {"step", "0.005"},
        {"bodies.0.model", "rod"},
        {"bodies.device.material.young", "2e6"},
        {"bodies.device.limits", "[{quantity: stress, limit: 3}, {quantity: energy, limit: 4}]"},
        {"bodies.device.limits.1.limit", "5"},
        {"bodies.0.path.region", "{band: {surface: rock, max: 1}}"},
        {"bodies.0.drive.tip_bend.length", "0.25"},
        {"vessels.artery.wall.model", "rigid"},
        {"planner.budget", "7"},
        {"obstacles", "[{name: rock, shape: {box: {min: [0, 0, 0], max: [1, 1, 1]}}}]"},
    };
    const int n = sizeof settings / sizeof *settings;
    cn_scene *s;
    cn_error error;
    if (read_text(base, n, settings, &s, &error) != CN_OK) fail_msg("%s", error.message);
    const cn_body_spec *b = s->body;
    assert_true(s->step == 0.005 && b->model == CN_BODY_ROD && b->material.young == 2e6 && b->nlimit == 2);
    assert_true(b->limit[0].quantity == CN_QUANTITY_STRESS && b->limit[1].limit == 5);
    assert_true(b->path.region == CN_REGION_BAND && b->drive.bend_length == 0.25 && s->planner.budget == 7);
    assert_true(s->nobstacle == 1 && s->obstacle->shape.kind == CN_SHAPE_BOX);
    cn_scene_free(s);
}

static void a_bad_setting_is_refused_by_its_name(void **state)
{
    (void)state;
    static const struct {
        cn_setting setting;
        const char *words;
    } bad[] = {
        {{"step", "fast"}, "setting step=fast: step: expected a number > 0"},
        {{"stpe", "1"}, "setting stpe=1: the scene: unknown key \"stpe\""},
        {{"bodies.0.modle", "rod"}, "nearest known key is \"model\""},
        {{"bodies.1.model", "rod"}, "no entry \"1\" in a list of 1"},
        {{"bodies.wire.model", "rod"}, "no entry \"wire\""},
        {{"bodies.-1.model", "rod"}, "no entry \"-1\""},
        {{"bodies.99999999999.model", "rod"}, "no entry"},
        {{"step.a", "1"}, "what stands before \"a\" is a plain value"},
        {{"", "1"}, "expected a key path"},
        {{"a..b", "1"}, "expected a key path"},
        {{"solver.newton.", "1"}, "expected a key path"},
        {{"step", ""}, "found nothing"},
        {{"step", "[1"}, "not readable as YAML"},
        {{"gravity", "*a"}, "aliases are not used"},
        {{"bodies.0.shape.file", "wall.stl"}, "exclude each other"},
        {{"bodies.0.shape.catheter.inner_diameter", "1"}, "not below the diameter"},
        {{"vessels.0.surface.file", "gone.stl"}, "setting vessels.0.surface.file=gone.stl"},
        {{"bodies.0.name", "\"a\\nb\""}, "bodies.0.name: a control character"},
        {{"bodies.0.name", "|\n  a\n  b"}, "bodies.0.name: a control character"},
        {{"vessels.0.name", "\"a\\u2029b\""}, "name: a control character or line end"},
        {{"bodies", "[]"}, "expected a list of at least one map, found an empty list"},
        {{"gravity", "[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[0]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]"}, "nested deeper"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        cn_scene *s;
        cn_error error;
        assert_int_not_equal(read_text(base, 1, &bad[i].setting, &s, &error), CN_OK);
        assert_null(s);
        if (!strstr(error.message, bad[i].words))
            fail_msg("\"%s\" is not in: %s", bad[i].words, error.message);
        assert_int_equal(error.line, 0);
    }
}

static char *whole_file(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    char *bytes = calloc(1, 1 << 20);
    *length = fread(bytes, 1, (1 << 20) - 1, file);
    fclose(file);
    return bytes;
}

static void all_keys_yaml_is_what_the_table_writes_and_is_a_scene(void **state)
{
    (void)state;
    const char committed[] = CATNAV_TEST_DATA "/../../launch/scenes/all_keys.yaml";
    char made[128];
    size_t n, m;
    cn_error error = {0};
    snprintf(made, sizeof made, "%s/keys.yaml", folder);
    assert_int_equal(cn_scene_write_keys(made, &error), CN_OK);
    char *a = whole_file(made, &n), *b = whole_file(committed, &m);
    assert_true(a && b && n == m && !memcmp(a, b, n));
    free(a);
    free(b);
    cn_scene *s;
    if (cn_scene_read(&s, committed, 0, NULL, &error) != CN_OK)
        fail_msg("line %d: %s", error.line, error.message);
    cn_scene_free(s);
    assert_int_equal(cn_scene_write_keys("/nowhere/keys.yaml", &error), CN_ERR_FILE);
}

/* Every key with its own line in all_keys.yaml; no map outgrows the reader's list of given keys. */
static void check_shown(const cn_schema *schema, const char *text)
{
    int n = 0;
    for (const cn_key *key = schema->keys; key->name; key++, n++) {
        char words[64];
        snprintf(words, sizeof words, " %s:", key->name);
        const bool shown =
            strstr(text, words) || (snprintf(words, sizeof words, "\n%s:", key->name), strstr(text, words));
        if (!shown) fail_msg("%s is not shown", key->name);
        assert_true(*key->meaning);
        if (key->map) check_shown(key->map, text);
    }
    assert_true(n <= 32);
}

static void all_keys_yaml_shows_every_key(void **state)
{
    (void)state;
    size_t n;
    char *text = whole_file(CATNAV_TEST_DATA "/../../launch/scenes/all_keys.yaml", &n);
    assert_non_null(text);
    check_shown(&cn_scene_schema, text);
    free(text);
}

static void a_scene_cut_anywhere_is_refused_or_read_but_never_crashes(void **state)
{
    (void)state;
    cn_scene *s;
    cn_error error;
    for (size_t n = 0; n < sizeof full; n++) {
        memset(&error, 0, sizeof error);
        write_bytes(scene_file, n, full);
        if (cn_scene_read(&s, scene_file, 0, NULL, &error) != CN_OK) assert_true(!s && *error.message);
        cn_scene_free(s);
    }
}

static void a_scene_with_one_wrong_byte_is_refused_or_read_but_never_crashes(void **state)
{
    (void)state;
    static const char bytes[] = {0, '\n', ' ', '{', ']', ':', '\'', '"', '*', '&', '!', '-', '9', (char)0xff};
    char text[sizeof full];
    unsigned random = 1;
    for (int i = 0; i < 4000; i++) {
        cn_scene *s;
        cn_error error = {0};
        memcpy(text, full, sizeof full);
        random = random * 1103515245u + 12345u;
        text[(random >> 8) % (sizeof full - 1)] = bytes[(random >> 4) % sizeof bytes];
        write_bytes(scene_file, sizeof full - 1, text);
        if (cn_scene_read(&s, scene_file, 0, NULL, &error) != CN_OK) assert_true(!s && *error.message);
        cn_scene_free(s);
    }
}

static void a_comma_locale_changes_nothing(void **state)
{
    (void)state;
    static const char *const locales[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "fr_FR"};
    const char *found = NULL;
    for (size_t i = 0; i < sizeof locales / sizeof *locales && !found; i++)
        found = setlocale(LC_ALL, locales[i]);
    if (!found) skip(); /* only the C locale is installed */
    char one[8];
    snprintf(one, sizeof one, "%.1f", 1.5);
    assert_string_equal(one, "1,5");
    cn_scene *s = good(base);
    assert_true(s->step == 0.01 && s->body->shape.catheter.diameter == 1e-3);
    cn_scene_free(s);
    cn_error error;
    assert_int_equal(read_text("step: 0,01\n", 0, NULL, &s, &error), CN_ERR_PARSE);
    all_keys_yaml_is_what_the_table_writes_and_is_a_scene(state);
    setlocale(LC_ALL, "C");
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    static const cn_setting setting = {"bodies.0.start.velocity", "[1, 2, 3]"};
    write_bytes(scene_file, strlen(full), full);
    int failures = 0;
    bool fired = true;
    for (long i = 0; fired; i++) {
        cn_scene *s = NULL;
        cn_error error = {0};
        fail_alloc_at(i);
        const cn_status status = cn_scene_read(&s, scene_file, 1, &setting, &error);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_int_equal(status, fired ? CN_ERR_MEMORY : CN_OK);
        assert_true(fired ? !s && error.status == CN_ERR_MEMORY && *error.message : s != NULL);
        failures += fired;
        cn_scene_free(s);
    }
    assert_true(failures > 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_scene_that_bad_ones_vary_is_good),
        cmocka_unit_test(every_bad_scene_is_refused_by_line_and_key),
        cmocka_unit_test(a_file_that_is_no_scene_is_refused),
        cmocka_unit_test(deep_brackets_are_refused_at_once),
        cmocka_unit_test(a_file_beyond_16_mib_is_refused),
        cmocka_unit_test(every_key_reads_into_its_field),
        cmocka_unit_test(what_is_left_out_has_the_contracts_default),
        cmocka_unit_test(every_integrator_is_read_where_it_is_made_for),
        cmocka_unit_test(an_automatic_model_follows_from_the_shape),
        cmocka_unit_test(a_direction_of_any_length_becomes_a_unit_vector),
        cmocka_unit_test(a_mesh_of_just_under_two_million_nodes_is_read),
        cmocka_unit_test(a_scene_written_as_json_is_read),
        cmocka_unit_test(settings_reach_into_maps_and_lists),
        cmocka_unit_test(a_bad_setting_is_refused_by_its_name),
        cmocka_unit_test(all_keys_yaml_is_what_the_table_writes_and_is_a_scene),
        cmocka_unit_test(all_keys_yaml_shows_every_key),
        cmocka_unit_test(a_scene_cut_anywhere_is_refused_or_read_but_never_crashes),
        cmocka_unit_test(a_scene_with_one_wrong_byte_is_refused_or_read_but_never_crashes),
        cmocka_unit_test(a_comma_locale_changes_nothing),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
