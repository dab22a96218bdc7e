/* Filling by the mesher: what comes back, and how every way of failing becomes a sentence. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "catnav/mesh.h"
#include "mesh_files.h"
#include "mesh_parts.h"

static const double zero[3] = {0, 0, 0};

static bool have_mesher(void)
{
    return system("command -v tetgen >/dev/null 2>&1") == 0;
}

static cn_surface *ball(double radius)
{
    cn_surface *s = NULL;
    assert_int_equal(cn_surface_sphere(&s, zero, radius), CN_OK);
    return s;
}

static int entries(const char *name)
{
    int n = 0;
    DIR *directory = opendir(name);
    while (readdir(directory))
        n++;
    closedir(directory);
    return n;
}

static void a_box_is_filled_to_its_volume_with_its_surface_kept(void **state)
{
    cn_surface *s = NULL;
    (void)state;
    if (!have_mesher()) skip();
    for (int e = -10; e <= 20; e += 10) { /* metres, millimetres, micrometres: the same mesh */
        const double h = ldexp(1, e);
        cn_tets *t = NULL;
        cn_error error = {0};
        cn_tets_doctor d;
        assert_int_equal(cn_surface_box(&s, zero, (const double[]){2 * h, h, h}), CN_OK);
        if (cn_tets_fill(&t, s, 0.01 * h * h * h, &error) != CN_OK) fail_msg("%s", error.message);
        assert_memory_equal(t->node, s->vert, 24 * sizeof(double));
        assert_int_equal(cn_tets_measure(t, &d, NULL), CN_OK);
        assert_true(fabs(d.volume - 2 * h * h * h) < 1e-12 * h * h * h);
        assert_int_equal(d.boundary, 12);
        assert_int_equal(d.inverted + d.flat + d.unused, 0);
        assert_true(d.ntet >= 5); /* the twelve triangles are kept: the mesher need not cut any further */
        static int first;
        if (!first) first = d.ntet;
        assert_int_equal(d.ntet, first);
        cn_tets_free(t);
        cn_surface_free(s);
    }
}

static void the_same_surface_gives_the_same_mesh(void **state)
{
    cn_surface *s = ball(1.0 / 3);
    cn_tets *a = NULL, *b = NULL;
    (void)state;
    if (!have_mesher()) skip();
    assert_int_equal(cn_tets_fill(&a, s, 0, NULL), CN_OK);
    assert_int_equal(cn_tets_fill(&b, s, 0, NULL), CN_OK);
    assert_int_equal(a->nnode, b->nnode);
    assert_int_equal(a->ntet, b->ntet);
    assert_memory_equal(a->node, b->node, 3 * (size_t)a->nnode * sizeof(double));
    assert_memory_equal(a->tet, b->tet, 4 * (size_t)a->ntet * sizeof(int));
    assert_memory_equal(a->node, s->vert, 3 * (size_t)s->nvert * sizeof(double));
    cn_tets_free(a);
    cn_tets_free(b);
    cn_surface_free(s);
}

static void a_largest_volume_refines_the_inside(void **state)
{
    cn_surface *s = ball(1);
    (void)state;
    if (!have_mesher()) skip();
    for (int fine = 0, before = 0; fine < 2; fine++) {
        cn_tets *t = NULL;
        cn_tets_doctor d;
        assert_int_equal(cn_tets_fill(&t, s, fine ? 1e-3 : 0, NULL), CN_OK);
        assert_int_equal(cn_tets_measure(t, &d, NULL), CN_OK);
        if (fine) assert_true(d.ntet > before && d.volume_max <= 1.000001e-3);
        if (!fine) assert_true(d.volume_max > 1e-2);
        before = d.ntet;
        cn_tets_free(t);
    }
    cn_surface_free(s);
}

static void what_cannot_be_filled_is_refused_before_the_mesher_runs(void **state)
{
    cn_surface *s = ball(1);
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)state;

    assert_int_equal(cn_tets_fill(&t, s, NAN, &error), CN_ERR_ARG);
    assert_int_equal(cn_tets_fill(&t, s, -1, NULL), CN_ERR_ARG);
    s->ntri--;
    error = (cn_error){0};
    assert_int_equal(cn_tets_fill(&t, s, 0, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "open"));
    s->ntri++;
    s->vert[0] += 1.5; /* a vertex through the other side */
    error = (cn_error){0};
    assert_int_equal(cn_tets_fill(&t, s, 0, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "triangles cross ("));
    assert_null(t);
    cn_surface_free(s);
}

static void a_hollow_is_refused_not_filled(void **state)
{
    cn_surface *out = ball(2), *in = ball(1), *s = NULL;
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)state;
    if (!have_mesher()) skip();
    assert_int_equal(cn_surface_new(&s, 2 * out->nvert, 2 * out->ntri), CN_OK);
    memcpy(s->vert, out->vert, 3 * (size_t)out->nvert * sizeof(double));
    memcpy(s->vert + 3 * out->nvert, in->vert, 3 * (size_t)out->nvert * sizeof(double));
    memcpy(s->tri, out->tri, 3 * (size_t)out->ntri * sizeof(int));
    for (int i = 0; i < 3 * in->ntri; i++)
        s->tri[3 * out->ntri + i] = out->nvert + in->tri[i - i % 3 + 2 - i % 3];
    assert_int_equal(cn_tets_fill(&t, s, 0, &error), CN_ERR_MESHER);
    assert_non_null(strstr(error.message, "hollow"));
    cn_surface_free(out), cn_surface_free(in), cn_surface_free(s);
}

/* A stand-in for the mesher, as a script; its folder must be gone afterwards. */
static void stand_in(folder *f, const char *script, double seconds, const char *says)
{
    cn_surface *s = ball(1);
    cn_tets *t = NULL;
    cn_error error = {0};
    const char *path = folder_write(f, "mesher", script, strlen(script));
    const cn_fill_limits limits = {path, seconds, 4e9};

    chmod(path, 0700);
    setenv("TMPDIR", f->name, 1);
    const int before = entries(f->name);
    assert_int_equal(cn_tets_fill_by(&t, s, 0, &limits, &error), CN_ERR_MESHER);
    unsetenv("TMPDIR");
    if (!strstr(error.message, says)) fail_msg("'%s' does not say '%s'", error.message, says);
    assert_null(t);
    assert_int_equal(entries(f->name), before);
    cn_surface_free(s);
}

static void every_failure_of_the_mesher_becomes_a_sentence(void **state)
{
    folder *f = *state;
    stand_in(f, "#!/bin/sh\nkill -ABRT $$\n", 10, "signal 6");
    stand_in(f, "#!/bin/sh\nexit 3\n", 10, "exit status 3");
    stand_in(f, "#!/bin/sh\nexec sleep 30\n", 0.2, "took more than 0.2 s");
    stand_in(f, "#!/bin/sh\nexit 0\n", 10, "no mesh that can be read");
    stand_in(f, "#!/bin/sh\necho rubbish > x.1.node; echo rubbish > x.1.ele\n", 10,
             "no mesh that can be read");
    stand_in(f,
             "#!/bin/sh\nprintf '4 3 0 0\\n0 0 0 0\\n1 1 0 0\\n2 0 1 0\\n3 0 0 1\\n' > x.1.node\n"
             "printf '1 4 0\\n0 0 1 2 3\\n' > x.1.ele\n",
             10, "moved vertices");
    stand_in(f, "#!/nowhere/sh\n", 10, "cannot be run");
}

static void a_mesher_that_is_not_there_is_named(void **state)
{
    const cn_fill_limits limits = {"no-such-mesher-anywhere", 10, 4e9};
    cn_surface *s = ball(1);
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)state;
    assert_int_equal(cn_tets_fill_by(&t, s, 0, &limits, &error), CN_ERR_MESHER);
    assert_non_null(strstr(error.message, "install the package tetgen"));
    cn_surface_free(s);
}

static void too_little_memory_or_no_folder_is_a_sentence_too(void **state)
{
    const cn_fill_limits limits = {"tetgen", 10, 1 << 20};
    cn_surface *s = ball(1);
    cn_tets *t = NULL;
    cn_error error = {0};
    (void)state;
    assert_int_equal(cn_tets_fill_by(&t, s, 0, &limits, &error), CN_ERR_MESHER);
    assert_true(strlen(error.message) > 20);
    setenv("TMPDIR", "/nowhere/at/all", 1);
    error = (cn_error){0};
    assert_int_equal(cn_tets_fill(&t, s, 0, &error), CN_ERR_FILE);
    unsetenv("TMPDIR");
    cn_surface_free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_box_is_filled_to_its_volume_with_its_surface_kept),
        cmocka_unit_test(the_same_surface_gives_the_same_mesh),
        cmocka_unit_test(a_largest_volume_refines_the_inside),
        cmocka_unit_test(what_cannot_be_filled_is_refused_before_the_mesher_runs),
        cmocka_unit_test(a_hollow_is_refused_not_filled),
        cmocka_unit_test(every_failure_of_the_mesher_becomes_a_sentence),
        cmocka_unit_test(a_mesher_that_is_not_there_is_named),
        cmocka_unit_test(too_little_memory_or_no_folder_is_a_sentence_too),
    };
    return cmocka_run_group_tests_name("mesh_fill", tests, folder_make, folder_remove);
}
