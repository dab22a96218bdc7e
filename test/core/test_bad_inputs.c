/* Bad inputs by kind, test/data/bad: each is refused with its own fault, line and sentence.
 *
 * KIND.txt holds cases one after the other: `@ what is wrong`, the file's lines, `=> FAULT LINE sentence`.
 * In the lines \xNN is a byte, \zN; are N zero bytes, and \e ends the file there. settings.txt holds settings
 * of a good scene, each followed by what it is answered; solid.txt (OBJ) and mesh.txt (TetGen) hold files
 * that are well formed, and no mesh to fill or to simulate. LINE 0: the file is binary, or there is none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include <stdbool.h>
#include <unistd.h>
#include "catnav/mesh.h"
#include "catnav/scene.h"
#include "molecules.h"

static char folder[64];
static int ncase, nwrong, nfault, faults[99];
enum { OWN_MOST = 999 };
static int nown; /* that differ in fault or sentence by more than a number or a name */
static char own[OWN_MOST + 1][sizeof((cn_error *)0)->message + 64];

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/catnav_bad_XXXXXX");
    return !mkdtemp(folder);
}
static int remove_folder(void **state)
{
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static const char *file_of(const char *extension)
{
    static char path[2][128];
    static int turn;
    snprintf(path[turn ^= 1], sizeof *path, "%s/bad.%s", folder, extension);
    return path[turn];
}

static void write_bytes(const char *path, const char *bytes, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* Appends a line of a case to its file's bytes; *size: so far. False where the file ends with it. */
static bool unescape(const char *line, char *bytes, size_t *size)
{
    for (; *line && *line != '\n'; line++) {
        if (*line != '\\') {
            bytes[(*size)++] = *line;
        } else if (line[1] == 'x') {
            const char hex[] = {line[2], line[3], 0};
            bytes[(*size)++] = (char)strtol(hex, NULL, 16);
            line += 3;
        } else if (line[1] == 'z') {
            char *end;
            const long n = strtol(line + 2, &end, 10);
            memset(bytes + *size, 0, (size_t)n);
            *size += (size_t)n, line = end;
        } else {
            return false;
        }
    }
    bytes[(*size)++] = '\n';
    return true;
}

static cn_status refuse(const char *kind, const char *bytes, size_t size, cn_error *error)
{
    cn_surface *surface = NULL;
    cn_tets *tets = NULL;
    cn_scene *scene = NULL;
    cn_status status;
    if (!strcmp(kind, "scene")) {
        write_bytes(file_of("yaml"), bytes, size);
        status = cn_scene_read(&scene, file_of("yaml"), 0, NULL, error);
    } else if (!strcmp(kind, "tetgen") || !strcmp(kind, "mesh")) {
        const char *const ele = strstr(bytes, "#ele\n") + 5;
        write_bytes(file_of("node"), bytes, (size_t)(ele - bytes) - 5);
        write_bytes(file_of("ele"), ele, size - (size_t)(ele - bytes));
        status = cn_tets_read(&tets, file_of("node"), error);
        if (!strcmp(kind, "mesh")) {
            assert_int_equal(status, CN_OK);
            status = cn_tets_check(tets, NULL, error);
            cn_tets_free(tets), tets = NULL;
        }
    } else if (!strcmp(kind, "molecules")) {
        cn_packing *packing = NULL;
        write_bytes(file_of("txt"), bytes, size);
        status = cn_packing_read(&packing, file_of("txt"), 0.01, NULL, 0, error);
    } else if (!strcmp(kind, "solid")) {
        cn_doctor doctor;
        write_bytes(file_of("obj"), bytes, size);
        assert_int_equal(cn_surface_read(&surface, file_of("obj"), error), CN_OK);
        status = cn_surface_check(surface, false, &doctor, error);
        if (status == CN_OK) status = cn_doctor_solid(&doctor, kind, error);
        cn_surface_free(surface), surface = NULL;
    } else {
        write_bytes(file_of(kind), bytes, size);
        status = cn_surface_read(&surface, file_of(kind), error);
    }
    assert_null(surface), assert_null(tets), assert_null(scene);
    return status;
}

/* What is left of fault and sentence without what depends on the case: files, keys, values, numbers and what
 * is quoted. */
static void take_out_the_case(const char *kind, const cn_error *error, const char *said, char *left)
{
    size_t n = (size_t)sprintf(left, "%s ", cn_fault_name(error->fault));
    for (int i = 0; i < 2 && !strcmp(kind, "settings") && strstr(said, ": "); i++)
        said = strstr(said, ": ") + 2; /* setting KEY=VALUE: KEY: */
    while (*said && strncmp(said, ", found ", 8)) {
        const size_t number = strspn(said, "-+.0123456789"),
                     file = strncmp(said, "bad.", 4) ? 0 : strcspn(said, " ,:");
        const char *const close = *said == '\'' || *said == '"' ? strchr(said + 1, *said) : NULL;
        if (close)
            said = close + 1;
        else if (number)
            said += number;
        else if (file)
            said += file;
        else
            left[n++] = *said++;
    }
    left[n] = 0;
}

/* Compares an answer with `FAULT LINE sentence`; the file's own folder is not part of the sentence. */
static void judge(const char *kind, const char *what, cn_status status, const cn_error *error,
                  const char *expected)
{
    char said[1024], plain[sizeof error->message];
    size_t n = 0;
    for (const char *at = error->message; *at; at++) {
        if (!strncmp(at, folder, strlen(folder))) at += strlen(folder) + 1;
        plain[n++] = *at;
    }
    plain[n] = 0;
    snprintf(said, sizeof said, "%s %d %s", cn_fault_name(error->fault), error->line, plain);
    ncase++;
    take_out_the_case(kind, error, plain, own[nown]);
    for (int i = 0; i <= nown; i++)
        if (!strcmp(own[i], own[nown])) {
            nown += i == nown && nown < OWN_MOST;
            break;
        }
    const bool good = status != CN_OK && error->status == status && error->fault / 100 == (int)status &&
                      error->fault % 100 > 0 && !strcmp(said, expected);
    for (int i = 0; i <= nfault; i++) /* the kinds met so far */
        if (i == nfault && nfault < 99) {
            faults[nfault++] = error->fault;
            break;
        } else if (faults[i] == error->fault) {
            break;
        }
    if (good) return;
    nwrong++;
    print_error("%s: %s\n=> %s\n", kind, what, said);
}

static FILE *open_table(const char *kind)
{
    char path[512];
    snprintf(path, sizeof path, CATNAV_TEST_DATA "/bad/%s.txt", kind);
    FILE *table = fopen(path, "r");
    assert_non_null(table);
    return table;
}

static void run_table(const char *kind)
{
    char line[1024], what[1024] = "", bytes[8192];
    size_t size = 0;
    bool open = true;
    FILE *table = open_table(kind);
    nwrong = 0;
    while (fgets(line, sizeof line, table)) {
        line[strcspn(line, "\n")] = 0;
        if (!strncmp(line, "@ ", 2)) {
            snprintf(what, sizeof what, "%s", line + 2);
            size = 0, open = true;
        } else if (!strncmp(line, "=> ", 3)) {
            cn_error error = {0};
            bytes[size] = 0;
            const cn_status status = refuse(kind, bytes, size, &error);
            /* the file is named; a check is of what was read */
            assert_true(strstr(error.file, "/bad.") || !strcmp(kind, "solid") || !strcmp(kind, "mesh"));
            judge(kind, what, status, &error, line + 3);
        } else if (open) {
            open = unescape(line, bytes, &size);
        }
    }
    fclose(table);
    assert_int_equal(nwrong, 0);
}

static void test_a_bad_obj_file_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("obj");
}
static void test_a_bad_stl_file_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("stl");
}
static void test_a_bad_ply_file_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("ply");
}
static void test_a_bad_msh_file_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("msh");
}
static void test_a_bad_pair_of_tetgen_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("tetgen");
}
static void test_a_bad_scene_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("scene");
}

static void test_a_bad_value_of_a_scene_is_refused_with_its_sentence(void **state)
{
    (void)state;
    static const char scene_text[] =
        "scene: one\nvessels:\n  - name: artery\n    shape: {tube: {axis: [[0, 0, 0], [0, 0, 0.1]], radius: "
        "0.004}}\n"
        "bodies:\n  - name: catheter\n    shape: {catheter: {length: 0.06, diameter: 1.35e-3, entry: [0, 0, "
        "0.01], "
        "direction: [0, 0, 1], stations: 41, inserted: 0.01}}\n"
        "    material: {young: 8.7e6, poisson: 0.33, density: 1100}\n    waypoints: [[0, 0, 0.06]]\n";
    char line[1024], key[256] = "";
    cn_scene *scene;
    cn_error error = {0};
    FILE *table = open_table("settings");
    nwrong = 0;
    write_bytes(file_of("yaml"), scene_text, sizeof scene_text - 1);
    assert_int_equal(cn_scene_read(&scene, file_of("yaml"), 0, NULL, &error), CN_OK);
    cn_scene_free(scene);
    while (fgets(line, sizeof line, table)) {
        line[strcspn(line, "\n")] = 0;
        char *const value = strchr(key, '=');
        if (line[0] == '#') continue;
        if (strncmp(line, "=> ", 3)) {
            snprintf(key, sizeof key, "%.255s", line);
            continue;
        }
        value[-1] = 0;
        const cn_setting setting = {key, value[1] ? value + 2 : ""};
        error = (cn_error){0};
        const cn_status status = cn_scene_read(&scene, file_of("yaml"), 1, &setting, &error);
        value[-1] = ' ';
        judge("settings", key, status, &error, line + 3);
        if (status == CN_OK) cn_scene_free(scene);
    }
    fclose(table);
    assert_int_equal(nwrong, 0);
}

static void test_a_surface_that_is_no_solid_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("solid");
}
static void test_a_bad_file_of_molecules_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("molecules");
}
static void test_a_mesh_that_cannot_be_simulated_is_refused_with_its_sentence(void **state)
{
    (void)state;
    run_table("mesh");
}

static void test_at_least_two_hundred_have_a_fault_and_sentence_of_their_own(void **state)
{
    (void)state;
    print_message("%d bad inputs, %d of them by kind\n", ncase, nown);
    assert_true(nown >= 200);
}

/* Every kind of the file's, scene's and mesh's faults that readers and checks tell apart. */
static void test_every_fault_of_a_file_and_a_mesh_is_among_them(void **state)
{
    (void)state;
#define FAULT(status, number, name, text) CN_FAULT_##name,
    static const int all[] = {CN_FAULT_LIST(FAULT)};
    static const int elsewhere[] = {
        /* of folders, requests and arrays; of sizes that no test writes; of a run's doors */
        CN_FAULT_ACCESS, CN_FAULT_LARGE,    CN_FAULT_LOCKED,   CN_FAULT_NOTHING,
        CN_FAULT_UNIT,   CN_FAULT_NO_PARTS, CN_FAULT_NO_VERTEX};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        bool met = all[i] / 100 == CN_ERR_ARG;
        for (int k = 0; k < nfault; k++)
            met = met || faults[k] == all[i];
        for (size_t k = 0; k < sizeof elsewhere / sizeof *elsewhere; k++)
            met = met || elsewhere[k] == all[i];
        if (!met) print_error("no case of %s\n", cn_fault_name(all[i]));
        assert_true(met);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_bad_obj_file_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_stl_file_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_ply_file_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_msh_file_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_pair_of_tetgen_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_scene_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_value_of_a_scene_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_surface_that_is_no_solid_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_bad_file_of_molecules_is_refused_with_its_sentence),
        cmocka_unit_test(test_a_mesh_that_cannot_be_simulated_is_refused_with_its_sentence),
        cmocka_unit_test(test_every_fault_of_a_file_and_a_mesh_is_among_them),
        cmocka_unit_test(test_at_least_two_hundred_have_a_fault_and_sentence_of_their_own),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
