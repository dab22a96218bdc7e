/* The doctor on real meshes: every figure that the index of the data folder states. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "catnav/mesh.h"
#include "mesh_files.h"

static const char *data_path(const char *name)
{
    static char path[1024];
    const char *base = getenv("CATNAV_DATA");
    snprintf(path, sizeof path, "%s/%s", base && *base ? base : CATNAV_TEST_DATA, name);
    return path;
}

/* Calls visit for each entry of a list of the index whose file is there (packed ones are unpacked); returns
 * how many. */
static int each_mesh(folder *f, const char *list, void (*visit)(folder *, const json_t *, const char *))
{
    json_t *index = json_load_file(data_path("index.json"), 0, NULL), *entry;
    size_t i;
    int n = 0;

    json_array_foreach(json_object_get(index, list), i, entry)
    {
        const char *name = json_string_value(json_object_get(entry, "file"));
        char path[1024], command[2400];
        snprintf(path, sizeof path, "%s", data_path(name));
        if (access(path, R_OK)) continue;
        if (strlen(path) > 3 && !strcmp(path + strlen(path) - 3, ".gz")) {
            snprintf(command, sizeof command, "gzip -dc '%s' > '%s/unpacked.stl'", path, f->name);
            assert_int_equal(system(command), 0);
            snprintf(path, sizeof path, "%s/unpacked.stl", f->name);
        }
        visit(f, entry, path);
        n++;
    }
    json_decref(index);
    return n;
}

static void same(const json_t *entry, const char *key, int value, const char *path)
{
    const json_t *stated = json_object_get(entry, key);
    if (json_is_integer(stated) && json_integer_value(stated) != value)
        fail_msg("%s: %s is %d, stated %d", path, key, value, (int)json_integer_value(stated));
    if (json_is_boolean(stated) && json_is_true(stated) != value)
        fail_msg("%s: %s is %d, stated %d", path, key, value, json_is_true(stated));
}

/* Pairs that the mesher's own test reports: different ones, and all reports (it repeats some). */
static bool mesher_pairs(folder *f, const cn_surface *s, int *different, int *reports)
{
    char path[128], command[512], line[256];
    snprintf(path, sizeof path, "%s/pairs.smesh", f->name);
    FILE *file = fopen(path, "w");
    fprintf(file, "%d 3 0 0\n", s->nvert);
    for (int i = 0; i < s->nvert; i++)
        fprintf(file, "%d %.17g %.17g %.17g\n", i, s->vert[3 * i], s->vert[3 * i + 1], s->vert[3 * i + 2]);
    fprintf(file, "%d 0\n", s->ntri);
    for (int i = 0; i < s->ntri; i++)
        fprintf(file, "3 %d %d %d\n", s->tri[3 * i], s->tri[3 * i + 1], s->tri[3 * i + 2]);
    fprintf(file, "0\n0\n");
    fclose(file);
    snprintf(
        command, sizeof command,
        "cd %s && command -v tetgen >/dev/null && tetgen -d pairs.smesh | grep 'intersects facet' > all; "
        "test -f all && wc -l < all && sort -u all | wc -l",
        f->name);
    FILE *pipe = popen(command, "r");
    const bool done = fgets(line, sizeof line, pipe) &&
                      (*reports = atoi(line), fgets(line, sizeof line, pipe)) &&
                      (*different = atoi(line), true);
    pclose(pipe);
    return done;
}

/* The index counts the reports of the mesher's test, which repeats some pairs; the doctor counts different
 * pairs. Where the two agree there is nothing to tell apart, else the mesher must confirm both figures. */
static void same_crossings(folder *f, const json_t *entry, const cn_surface *s, const cn_doctor *d,
                           const char *path)
{
    const json_t *stated = json_object_get(entry, "crossing_pairs");
    int different = -1, reports = -1;

    if (!stated || json_integer_value(stated) == d->crossing_pairs) return;
    if (!d->crossing_pairs || !json_integer_value(stated))
        fail_msg("%s: %d crossing pairs, stated %d", path, d->crossing_pairs,
                 (int)json_integer_value(stated));
    if (!mesher_pairs(f, s, &different, &reports))
        fail_msg("%s: %d crossing pairs, stated %d, and no mesher to ask", path, d->crossing_pairs,
                 (int)json_integer_value(stated));
    if (different != d->crossing_pairs || reports != json_integer_value(stated))
        fail_msg("%s: %d crossing pairs, stated %d; the mesher finds %d in %d reports", path,
                 d->crossing_pairs, (int)json_integer_value(stated), different, reports);
}

static void check_surface(folder *f, const json_t *entry, const char *path)
{
    cn_surface *s = NULL;
    cn_doctor d;
    cn_error error = {0}, refusal = {0};

    if (cn_surface_read(&s, path, &error) != CN_OK) fail_msg("%s:%d: %s", path, error.line, error.message);
    assert_int_equal(cn_surface_check(s, true, &d, &error), CN_OK);
    same(entry, "closed", d.closed, path);
    same(entry, "loops", d.loops, path);
    same(entry, "components", d.components, path);
    same(entry, "nonmanifold_edges", d.nonmanifold_edges, path);
    same(entry, "degenerate", d.degenerate, path);
    same_crossings(f, entry, s, &d, path);
    const char *orientation = json_string_value(json_object_get(entry, "orientation"));
    if (orientation) {
        const bool inward = d.turned || d.volume < 0;
        if (inward != !strcmp(orientation, "inward")) fail_msg("%s: not %s", path, orientation);
    }
    const char *verdict = json_string_value(json_object_get(entry, "check"));
    const cn_status usable = cn_doctor_usable(&d, path, &refusal);
    if (verdict && !strncmp(verdict, "usable", 6) && !strstr(verdict, "refused") && usable != CN_OK)
        fail_msg("refused: %s", refusal.message);
    if (verdict && !strcmp(verdict, "refused")) assert_int_equal(usable, CN_ERR_MESH);
    if (usable != CN_OK) assert_true(strlen(refusal.message) > strlen(path) + 20); /* in words */
    cn_surface_free(s);
}

static void check_tets(folder *f, const json_t *entry, const char *path)
{
    cn_tets *t = NULL;
    cn_error error = {0};
    int turned = -1;
    (void)f;

    if (cn_tets_read(&t, path, &error) != CN_OK) fail_msg("%s:%d: %s", path, error.line, error.message);
    const cn_status status = cn_tets_check(t, &turned, &error);
    if (!strcmp(json_string_value(json_object_get(entry, "check")), "usable")) {
        if (status != CN_OK) fail_msg("%s: %s", path, error.message);
        assert_int_equal(turned, 0);
    }
    cn_tets_free(t);
}

static void fill_usable(folder *f, const json_t *entry, const char *path)
{
    cn_surface *s = NULL;
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)f;

    if (!json_is_true(json_object_get(entry, "closed"))) return;
    const bool usable = !strcmp(json_string_value(json_object_get(entry, "check")), "usable");
    assert_int_equal(cn_surface_read(&s, path, NULL), CN_OK);
    const cn_status status = cn_tets_fill(&t, s, 0, &error);
    if (usable != (status == CN_OK)) fail_msg("%s: %s", path, error.message);
    if (!usable) assert_non_null(strstr(error.message, "triangles cross ("));
    cn_surface_free(s);
    cn_tets_free(t);
}

static void vessels_have_the_figures_the_index_states(void **state)
{
    if (!each_mesh(*state, "vessels", check_surface)) skip();
}

static void bodies_have_the_figures_the_index_states(void **state)
{
    if (!each_mesh(*state, "bodies", check_surface)) skip();
}

static void tetrahedra_are_usable_as_the_index_states(void **state)
{
    if (!each_mesh(*state, "tets", check_tets)) skip();
}

static void usable_bodies_are_filled_and_the_others_refused(void **state)
{
    if (system("command -v tetgen >/dev/null 2>&1") || !each_mesh(*state, "bodies", fill_usable)) skip();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vessels_have_the_figures_the_index_states),
        cmocka_unit_test(bodies_have_the_figures_the_index_states),
        cmocka_unit_test(tetrahedra_are_usable_as_the_index_states),
        cmocka_unit_test(usable_bodies_are_filled_and_the_others_refused),
    };
    return cmocka_run_group_tests_name("mesh_real", tests, folder_make, folder_remove);
}
