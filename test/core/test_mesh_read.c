/* What the readers take, and how they refuse what they do not. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <locale.h>
#include <math.h>
#include <sys/stat.h>

#include "catnav/mesh.h"
#include "mesh_files.h"

static cn_surface *read_good(const char *path)
{
    cn_error error = {0};
    cn_surface *surface = NULL;
    if (cn_surface_read(&surface, path, &error) != CN_OK)
        fail_msg("%s:%d: %s", path, error.line, error.message);
    return surface;
}

static void every_format_gives_the_same_tetrahedron(void **state)
{
    (void)state;
    for (int i = 0; i < NTETRA; i++) {
        cn_surface *surface = read_good(good_path(good_surfaces[i]));
        cn_doctor doctor;
        const bool single = !strcmp(good_surfaces[i], "tetra_binary.stl"); /* STL's binary form is float */
        assert_int_equal(cn_surface_check(surface, true, &doctor, NULL), CN_OK);
        assert_int_equal(doctor.nvert, 4);
        assert_int_equal(doctor.ntri, 4);
        assert_true(doctor.closed && doctor.manifold && doctor.oriented && !doctor.turned);
        assert_true(doctor.max[0] == 1 && doctor.max[1] == (single ? (double)0.1f : 0.1));
        assert_true(doctor.min[2] == (single ? (double)-0.7f : -0.7));
        assert_true(fabs(doctor.volume - 0.07 / 6) < 1e-9);
        cn_surface_free(surface);
    }
}

static void every_format_gives_the_same_element(void **state)
{
    (void)state;
    for (int i = 0; i < NGOOD_TETS; i++) {
        cn_tets *tets = NULL;
        cn_error error = {0};
        int turned = -1;
        if (cn_tets_read(&tets, good_path(good_tets[i]), &error) != CN_OK) fail_msg("%s", error.message);
        assert_int_equal(tets->nnode, 4);
        assert_int_equal(tets->ntet, 1);
        assert_int_equal(cn_tets_check(tets, &turned, &error), CN_OK);
        assert_int_equal(turned, 0);
        assert_memory_equal(tets->tet, ((const int[]){0, 2, 1, 3}), 4 * sizeof(int));
        assert_true(tets->node[7] == 0.1 && tets->node[11] == -0.7);
        cn_tets_free(tets);
    }
}

static void the_ele_file_may_be_named_instead_of_the_node_file(void **state)
{
    cn_tets *tets = NULL;
    (void)state;
    assert_int_equal(cn_tets_read(&tets, good_path("tetra.ele"), NULL), CN_OK);
    cn_tets_free(tets);
}

static int messages;
static void count_messages(void *user, cn_log_level level, const char *file, int line, const char *text)
{
    (void)user, (void)level, (void)file, (void)line;
    messages += strstr(text, "6 polygons of more than 3 corners became fans") != NULL;
}

static void polygons_become_fans_and_are_counted(void **state)
{
    (void)state;
    for (int i = NTETRA; i < NGOOD; i++) {
        cn_doctor doctor;
        messages = 0;
        cn_log_set_sink(count_messages, NULL);
        cn_surface *surface = read_good(good_path(good_surfaces[i]));
        cn_log_set_sink(NULL, NULL);
        assert_int_equal(messages, 1);
        assert_int_equal(cn_surface_check(surface, false, &doctor, NULL), CN_OK);
        assert_true(doctor.closed && fabs(doctor.volume - 1) < 1e-15 && doctor.degenerate == 0);
        cn_surface_free(surface);
    }
}

static void numbers_are_read_to_the_last_digit_in_any_locale(void **state)
{
    static const char *const written[] = {"0.1",
                                          "-1.7976931348623157e308",
                                          "4.9406564584124654e-324",
                                          "123456789.123456789",
                                          "1e22",
                                          "1e23",
                                          "9007199254740993",
                                          "0.30000000000000004",
                                          "2.2250738585072011e-308",
                                          "+.5",
                                          "5.",
                                          "1E-5",
                                          "000000000000000000000001.25",
                                          "3.14159265358979323846264338327950288"};
    const bool comma = setlocale(LC_ALL, "de_DE.UTF-8") != NULL;
    char text[256];

    for (size_t i = 0; i < sizeof written / sizeof *written; i++) {
        const int n = snprintf(text, sizeof text, "v %s 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", written[i]);
        cn_surface *surface = read_good(folder_write(*state, "number.obj", text, (size_t)n));
        setlocale(LC_ALL, "C");
        const double expected = strtod(written[i], NULL);
        if (comma) setlocale(LC_ALL, "de_DE.UTF-8");
        assert_memory_equal(surface->vert, &expected, sizeof expected);
        cn_surface_free(surface);
    }
    setlocale(LC_ALL, "C");
}

static void a_written_surface_reads_back_bit_for_bit(void **state)
{
    cn_surface *sphere = NULL, *again;
    cn_doctor doctor;
    char path[128];

    snprintf(path, sizeof path, "%s/sphere.stl", ((folder *)*state)->name);
    assert_int_equal(cn_surface_sphere(&sphere, (const double[]){0.1, 0.2, 0.3}, 1.0 / 3), CN_OK);
    assert_int_equal(cn_surface_write_stl(sphere, path, NULL), CN_OK);
    again = read_good(path);
    assert_int_equal(again->ntri, sphere->ntri);
    for (int i = 0; i < 3 * sphere->ntri; i++)
        assert_memory_equal(again->vert + 3 * again->tri[i], sphere->vert + 3 * sphere->tri[i],
                            3 * sizeof(double));
    assert_int_equal(cn_surface_check(again, true, &doctor, NULL), CN_OK);
    assert_int_equal(doctor.nvert, sphere->nvert);
    assert_int_not_equal(cn_surface_write_stl(sphere, "/nowhere/at/all.stl", NULL), CN_OK);
    cn_surface_free(again);
    cn_surface_free(sphere);
}

/* --- refusals: what, where, and the value --- */

#define FACET "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
#define V3    "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
#define PLY(format, nvert, nface)                                                                            \
    "ply\nformat " format " 1.0\nelement vertex " nvert                                                      \
    "\nproperty float x\nproperty float y\nproperty float z\nelement face " nface                            \
    "\nproperty list uchar int vertex_indices\nend_header\n"
#define P3  "0 0 0\n1 0 0\n0 1 0\n"
#define M22 "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
#define M41 "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
#define N22 "$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
#define N41 "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"

static const struct {
    const char *name, *text;
    int line;         /* 0: the sentence names a byte, or the whole file is meant */
    const char *says; /* part of the sentence: the value or the thing missing */
} bad[] = {
    {"a.stl", "", 0, "empty"},
    {"a.stl", "hello\n", 1, "'hello'"},
    {"a.stl", "solid a\n", 1, "cut short"},
    {"a.stl", "solid a\nendsolid a\n", 0, "no triangles"},
    {"a.stl", FACET "vertex 0 nan 0\nendloop\nendfacet\nendsolid\n", 6, "'nan'"},
    {"a.stl", FACET "vertex 0 inf 0\nendloop\nendfacet\nendsolid\n", 6, "'inf'"},
    {"a.stl", FACET "vertex 0 1e999 0\nendloop\nendfacet\nendsolid\n", 6, "'1e999'"},
    {"a.stl", FACET "vertex 0 0x1 0\nendloop\nendfacet\nendsolid\n", 6, "'0x1'"},
    {"a.stl", FACET "vertex 0 0,1 0\nendloop\nendfacet\nendsolid\n", 6, "'0,1'"},
    {"a.stl", FACET "vertex 0 1\nendloop\nendfacet\nendsolid\n", 6, "ends where"},
    {"a.stl", FACET "vertex 0 1 0 0\nendloop\nendfacet\nendsolid\n", 6, "'0' follows"},
    {"a.stl", FACET "vertex 0 1 0\nvertex 1 1 0\nendloop\nendfacet\nendsolid\n", 7, "'vertex'"},
    {"a.stl", FACET "endloop\nendfacet\nendsolid\n", 6, "'endloop'"},
    {"a.stl", FACET "vertex 0 1 0\nendloop\nendfacet\n", 8, "cut short"},
    {"a.stl", FACET "vertex 0 1 0\nendloop\nendfacet\nendsolid\nrubbish\n", 10, "'rubbish'"},
    {"a.stl", "solid a\nfacet normal 0 0 bad\nouter loop\n", 2, "'bad'"},
    {"a.stl", "solid a\nfacet 0 0 1\n", 2, "'0'"},
    {"a.stl", "ply\nformat ascii 1.0\n", 1, "'ply'"},
    {"a.obj", V3 "f 1 2 4\n", 4, "vertex 4"},
    {"a.obj", V3 "f 1 2 0\n", 4, "vertex 0"},
    {"a.obj", V3 "f 1 2 -4\n", 4, "vertex -4"},
    {"a.obj", "v 0 0 0\nf -1 -2 -3\nv 1 0 0\nv 0 1 0\n", 2, "vertex -2"},
    {"a.obj", V3 "f 1 2\n", 4, "2 corners"},
    {"a.obj", V3 "f\n", 4, "0 corners"},
    {"a.obj", V3 "f 1 2 3.5\n", 4, "'3.5'"},
    {"a.obj", V3 "f 1 2 x\n", 4, "'x'"},
    {"a.obj", V3 "f 1/1/1/1 2 3\n", 4, "'1/1/1/1'"},
    {"a.obj", V3 "f 1/ 2 3\n", 4, "'1/'"},
    {"a.obj", V3 "f 1 2 99999999999999999999\n", 4, "'99999999999999999999'"},
    {"a.obj", "v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 1, "ends where"},
    {"a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 1, "'nan'"},
    {"a.obj", "v 0 0 0 2\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 1, "weight 2"},
    {"a.obj", "v 0 0 0 1 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 1, "5 numbers"},
    {"a.obj", V3, 0, "no triangles"},
    {"a.obj", "f 1 2 3\n", 1, "vertex 1"},
    {"a.obj", V3 "curv 0 1 1 2\nf 1 2 3\n", 4, "'curv'"},
    {"a.obj", V3 "\1\2\3\4 1 2\nf 1 2 3\n", 4,
     "'?"
     "?"
     "?"
     "?'"},
    {"a.obj", "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n", 5, "4 corners"},
    {"a.obj", "v 0 0 0\nv 3 0 0\nv 3 2 0\nv 2 2 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 1 2 3 4 5 6 7 8\n",
     9, "8 corners"},
    {"a.ply", "plyx\n", 1, "'plyx'"},
    {"a.ply", "ply\n", 1, "end_header"},
    {"a.ply", "ply\nformat ascii 2.0\n", 2, "'2.0'"},
    {"a.ply", "ply\nformat text 1.0\n", 2, "'text'"},
    {"a.ply", "ply\nelement vertex 0\nend_header\n", 3, "no format"},
    {"a.ply", "ply\nformat ascii 1.0\nproperty float x\n", 3, "before the first element"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex -1\n", 3, "-1"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex many\n", 3, "'many'"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty real x\n", 4, "'real'"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float x\n", 5, "twice"},
    {"a.ply", "ply\nformat ascii 1.0\nelement tristrips 3\n", 3, "strips"},
    {"a.ply", "ply\nformat ascii 1.0\nwhatever\n", 3, "'whatever'"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n0\n1\n2\n", 5,
     "x, y and z"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1 3\n", 13, "is 3"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1 -1\n", 13, "is -1"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1 1.5\n", 13, "1.5"},
    {"a.ply", PLY("ascii", "3", "1") P3 "2 0 1\n", 13, "is 2"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1\n", 13, "ends before"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1 2 9\n", 13, "'9'"},
    {"a.ply", PLY("ascii", "3", "1") P3 "3 0 1 2\nmore\n", 14, "'more'"},
    {"a.ply", PLY("ascii", "3", "1") P3, 12, "cut short"},
    {"a.ply", PLY("ascii", "3", "1") "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", 11, "'nan'"},
    {"a.ply", PLY("ascii", "2000000", "1") P3 "3 0 1 2\n", 9, "2000000"},
    {"a.ply", PLY("ascii", "3", "0") P3, 0, "no triangles"},
    {"a.ply", PLY("binary_little_endian", "3", "1") "short", 9, "cut short"},
    {"a.ply", PLY("binary_little_endian", "0", "1") "\3zzzzzzzzzzzz", 0, "byte"},
    {"a.ply", PLY("binary_little_endian", "0", "0") "rest", 0, "4 bytes follow"},
    {"a.msh", "Merge \"other.msh\";\n", 1, "$MeshFormat"},
    {"a.msh", "\n\nPhysical Surface(1) = {1};\n", 3, "$MeshFormat"},
    {"a.msh", "$MeshFormat\n", 1, "version"},
    {"a.msh", "$MeshFormat\n4.0 0 8\n$EndMeshFormat\n", 2, "4.0"},
    {"a.msh", "$MeshFormat\n2.2 2 8\n$EndMeshFormat\n", 2, "is 2"},
    {"a.msh", "$MeshFormat\n2.2 0 4\n$EndMeshFormat\n", 2, "is 4"},
    {"a.msh", "$MeshFormat\n2.2 0 8\nEnd\n", 3, "'End'"},
    {"a.msh", M22, 3, "no $Nodes"},
    {"a.msh", M22 N22, 9, "no $Elements"},
    {"a.msh", M22 "$Elements\n0\n$EndElements\n", 4, "before $Nodes"},
    {"a.msh", M22 "$Other\n1 2 3\n", 4, "$EndOther"},
    {"a.msh", M22 "rubbish\n", 4, "'rubbish'"},
    {"a.msh", M22 "$EndNodes\n", 4, "'$EndNodes'"},
    {"a.msh", M22 "$Nodes\n-3\n", 5, "-3"},
    {"a.msh", M22 "$Nodes\n3000000\n1 0 0 0\n", 5, "3000000"},
    {"a.msh", M22 "$Nodes\n3\n1 0 0 0\n1 1 0 0\n3 0 1 0\n$EndNodes\n", 8, "number 1"},
    {"a.msh", M22 "$Nodes\n1\n1 0 0 inf\n$EndNodes\n", 6, "'inf'"},
    {"a.msh", M22 "$Nodes\n1\n1 0 0\n$EndNodes\n", 6, "ends where"},
    {"a.msh", M22 "$Nodes\n1\n1 0 0 0\n2 0 0 0\n$EndNodes\n", 7, "'2'"},
    {"a.msh", M22 N22 N22, 10, "second"},
    {"a.msh", M22 N22 "$Elements\n1\n1 2 2 0 1 1 2 4\n$EndElements\n", 12, "node 4"},
    {"a.msh", M22 N22 "$Elements\n1\n1 3 2 0 1 1 2 3 1\n$EndElements\n", 12, "quadrangle"},
    {"a.msh", M22 N22 "$Elements\n1\n1 9 2 0 1 1 2 3 1 2 3\n$EndElements\n", 12, "6-node triangle"},
    {"a.msh", M22 N22 "$Elements\n1\n1 77 0 1 2 3\n$EndElements\n", 12, "77"},
    {"a.msh", M22 N22 "$Elements\n1\n1 2 0 1 2\n$EndElements\n", 12, "ends where"},
    {"a.msh", M22 N22 "$Elements\n2\n1 2 0 1 2 3\n$EndElements\n", 13, "'$EndElements'"},
    {"a.msh", M22 N22 "$Elements\n1\n1 1 0 1 2\n$EndElements\n", 0, "no triangles"},
    {"a.msh", M22 N22 "$Elements\n1\n1 2 0 1 2 3\n", 12, "$EndElements"},
    {"a.msh", M41 N41 "$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 9\n$EndElements\n", 17, "node 9"},
    {"a.msh", M41 N41 "$Elements\n1 2 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n", 17, "the section says 2"},
    {"a.msh", M41 N41 "$Elements\n1 1 1 1\n2 1 2 5\n1 1 2 3\n$EndElements\n", 16, "is 5"},
    {"a.msh", M41 "$Nodes\n1 3 1 3\n2 1 0 2\n1\n2\n0 0 0\n1 0 0\n$EndNodes\n", 10, "hold 2 nodes"},
    {"a.msh", M41 "$Nodes\n1 3 1 3\n2 1 0 4\n", 6, "is 4"},
    {"a.msh", M41 "$Nodes\n1 3 1 3\n2 1 7 3\n", 6, "is 7"},
    {"a.msh", "$MeshFormat\n4.1 1 8\nxxxx\n$EndMeshFormat\n", 0, "byte order"},
    {"a.off", "OFF\n", 0, "extension"},
    {"a.stl.gz", "\37\213", 0, "extension"},
    {"a", "solid\n", 0, "extension"},
    {"a.node", "4 3 0 0\n", 0, "surface is needed"},
};

static void every_bad_surface_is_refused_with_its_place_and_value(void **state)
{
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        cn_error error = {0};
        cn_surface *surface = NULL;
        const char *path = folder_write(*state, bad[i].name, bad[i].text, strlen(bad[i].text));
        const cn_status status = cn_surface_read(&surface, path, &error);
        if (status != CN_ERR_PARSE || error.status != status || !strstr(error.message, bad[i].says) ||
            error.line != bad[i].line || strcmp(error.file, path))
            fail_msg("case %zu (%s): status %d, line %d instead of %d, says \"%s\" where \"%s\" was expected",
                     i, bad[i].text, status, error.line, bad[i].line, error.message, bad[i].says);
        assert_null(surface);
        assert_null(strchr(error.message, '\n'));
    }
}

static const struct {
    const char *node, *ele;
    int line;
    const char *says;
} bad_pairs[] = {
    {"4 3 0 0\n", "1 4 0\n1 1 2 3 4\n", 1, "cut short"},
    {"4 2 0 0\n1 0 0\n2 1 0\n3 0 1\n4 1 1\n", "0 4 0\n", 1, "dimension is 2"},
    {"x\n", "0 4 0\n", 1, "'x'"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 10 0\n1 1 2 3 4 1 2 3 4 1 2\n", 1, "10 nodes"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 5\n", 2, "is 5"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 0 1 2 3\n", 2, "is 0"},
    {"4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n", "1 4 0\n0 0 1 2 4\n", 2, "is 4"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n4 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n", 4, "is 4"},
    {"4 3 0 0\n5 0 0 0\n6 1 0 0\n7 0 1 0\n8 0 0 1\n", "1 4 0\n1 5 6 7 8\n", 2, "is 5"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 nan\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n", 3, "'nan'"},
    {"4 3 1 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n", 2, "attribute"},
    {"4 3 0 0\n1 0 0 0 7\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n", 2, "'7'"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n", "1 4 0\n1 1 2 3 4\n", 6, "'5'"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n2 1 2 3 4\n", 3, "'2'"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "2 4 0\n1 1 2 3 4\n", 2, "cut short"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3\n", 2, "ends where"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n2 1 2 3 4\n", 2, "is 2"},
    {"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "0 4 0\n", 0, "no tetrahedra"},
    {"4 3 0 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", "1 4 0\n1 1 2 3 4\n", 1, "'0'"},
    {"400000000 3 0 0\n1 0 0 0\n", "1 4 0\n1 1 2 3 4\n", 1, "400000000"},
};

static void every_bad_pair_of_node_and_ele_is_refused(void **state)
{
    for (size_t i = 0; i < sizeof bad_pairs / sizeof *bad_pairs; i++) {
        cn_error error = {0};
        cn_tets *tets = NULL;
        folder_write(*state, "b.ele", bad_pairs[i].ele, strlen(bad_pairs[i].ele));
        const char *path = folder_write(*state, "b.node", bad_pairs[i].node, strlen(bad_pairs[i].node));
        const cn_status status = cn_tets_read(&tets, path, &error);
        if (status != CN_ERR_PARSE || !strstr(error.message, bad_pairs[i].says) ||
            error.line != bad_pairs[i].line)
            fail_msg("case %zu: status %d, line %d, says \"%s\" where line %d, \"%s\" was expected", i,
                     status, error.line, error.message, bad_pairs[i].line, bad_pairs[i].says);
        assert_null(tets);
    }
}

/* Binary files with one value wrong: the sentence names the byte. */
static void bad_values_in_binary_files_are_refused_with_their_byte(void **state)
{
    static const struct {
        const char *name;
        long at; /* from the start, or back from the end */
        const char *bytes;
        int n;
        const char *says;
    } wrong[] = {
        {"tetra_binary.stl", 84 + 12, "\0\0\300\177", 4, "byte 96"},      /* NaN in the first corner */
        {"tetra_binary.stl", 84 + 50 + 4, "\0\0\200\177", 4, "byte 138"}, /* infinite normal */
        {"tetra_binary.stl", 80, "\5", 1, "cut short"},
        {"tetra_binary.stl", 80, "\3", 1, "longer"},
        {"tetra_little.ply", -10, "\11", 1, "is 9"},
        {"tetra_big.ply", -10 + 3, "\11", 1, "is 9"},
        {"tetra_22_binary.msh", -18, "\143", 1, "node 99"},
        {"tetra_41_binary.msh", -22, "\143", 1, "node 99"},
        {"tetra_41_big.msh", -15, "\143", 1, "node 99"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        size_t size;
        char *data = file_load(good_path(wrong[i].name), &size);
        cn_error error = {0};
        cn_surface *surface = NULL;
        cn_tets *tets = NULL;
        memcpy(data + (wrong[i].at < 0 ? (long)size : 0) + wrong[i].at, wrong[i].bytes, (size_t)wrong[i].n);
        const char *path = folder_write(*state, wrong[i].name, data, size);
        const bool msh = strstr(wrong[i].name, ".msh") != NULL;
        const cn_status status =
            msh ? cn_tets_read(&tets, path, &error) : cn_surface_read(&surface, path, &error);
        if (status == CN_OK || !strstr(error.message, wrong[i].says) || !strstr(error.message, "byte"))
            fail_msg("case %zu: status %d says \"%s\"", i, status, error.message);
        cn_surface_free(surface);
        cn_tets_free(tets);
        free(data);
    }
}

static void what_is_no_readable_file_is_refused(void **state)
{
    folder *f = *state;
    char path[128];
    cn_surface *surface = NULL;
    cn_error error = {0};

    assert_int_equal(cn_surface_read(&surface, "/nowhere/at/all.stl", &error), CN_ERR_FILE);
    snprintf(path, sizeof path, "%s/folder.stl", f->name);
    mkdir(path, 0700);
    assert_int_equal(cn_surface_read(&surface, path, NULL), CN_ERR_FILE);
    snprintf(path, sizeof path, "%s/pipe.stl", f->name); /* nobody writes to it: opening must not wait */
    mkfifo(path, 0600);
    assert_int_equal(cn_surface_read(&surface, path, NULL), CN_ERR_FILE);
    assert_int_not_equal(cn_surface_read(&surface, "/dev/zero", NULL), CN_OK);
    assert_null(surface);
}

/* Reads a file as whatever its name allows; refusals carry a sentence. */
static void read_any(const char *path)
{
    cn_surface *surface = NULL;
    cn_tets *tets = NULL;
    cn_error error = {0};

    if (cn_surface_read(&surface, path, &error) == CN_OK) {
        assert_true(surface->ntri > 0);
        for (int i = 0; i < 3 * surface->ntri; i++)
            assert_true(surface->tri[i] >= 0 && surface->tri[i] < surface->nvert);
        for (int i = 0; i < 3 * surface->nvert; i++)
            assert_true(isfinite(surface->vert[i]));
    } else {
        assert_true(error.message[0] && error.file[0]);
    }
    error = (cn_error){0};
    if (cn_tets_read(&tets, path, &error) == CN_OK) {
        for (int i = 0; i < 4 * tets->ntet; i++)
            assert_true(tets->tet[i] >= 0 && tets->tet[i] < tets->nnode);
    } else {
        assert_true(error.message[0]);
    }
    cn_surface_free(surface);
    cn_tets_free(tets);
}

static void every_truncation_of_a_good_file_is_read_or_refused(void **state)
{
    for (int i = 0; i < NGOOD; i++) {
        size_t size;
        char *data = file_load(good_path(good_surfaces[i]), &size);
        for (size_t n = 0; n < size; n++)
            read_any(folder_write(*state, good_surfaces[i], data, n));
        free(data);
    }
    for (int ele = 0; ele < 2; ele++) {
        size_t size, other;
        char *data = file_load(good_path(ele ? "tetra.ele" : "tetra.node"), &size);
        char *rest = file_load(good_path(ele ? "tetra.node" : "tetra.ele"), &other);
        folder_write(*state, ele ? "tetra.node" : "tetra.ele", rest, other);
        for (size_t n = 0; n < size; n++)
            read_any(folder_write(*state, ele ? "tetra.ele" : "tetra.node", data, n));
        free(data);
        free(rest);
    }
}

static void every_byte_may_be_wrong(void **state)
{
    static const char values[] = {0, '\xff', '9', '\n'};
    for (int i = 0; i < NGOOD; i++) {
        size_t size;
        char *data = file_load(good_path(good_surfaces[i]), &size);
        for (size_t n = 0; n < size; n++) {
            const char kept = data[n];
            for (size_t k = 0; k < sizeof values; k++) {
                data[n] = values[k];
                read_any(folder_write(*state, good_surfaces[i], data, size));
            }
            data[n] = kept;
        }
        free(data);
    }
}

static void a_binary_file_cut_short_is_never_read(void **state)
{
    static const char *const names[] = {"tetra_binary.stl", "tetra_little.ply", "tetra_big.ply"};
    for (size_t i = 0; i < 3; i++) {
        size_t size;
        char *data = file_load(good_path(names[i]), &size);
        for (size_t n = 0; n < size; n++) {
            cn_surface *surface = NULL;
            assert_int_equal(cn_surface_read(&surface, folder_write(*state, names[i], data, n), NULL),
                             CN_ERR_PARSE);
        }
        free(data);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    for (int i = 0; i < NGOOD; i++) {
        char path[1024];
        snprintf(path, sizeof path, "%s", good_path(good_surfaces[i]));
        for (long n = 0; allocation_fails(&n);) {
            cn_surface *surface = NULL;
            cn_error error = {0};
            const cn_status status = cn_surface_read(&surface, path, &error);
            assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
            if (status != CN_OK) assert_non_null(strstr(error.message, "memory"));
            cn_surface_free(surface);
        }
    }
    for (int i = 0; i < NGOOD_TETS; i++) {
        char path[1024];
        snprintf(path, sizeof path, "%s", good_path(good_tets[i]));
        for (long n = 0; allocation_fails(&n);) {
            cn_tets *tets = NULL;
            const cn_status status = cn_tets_read(&tets, path, NULL);
            assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
            cn_tets_free(tets);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_format_gives_the_same_tetrahedron),
        cmocka_unit_test(every_format_gives_the_same_element),
        cmocka_unit_test(the_ele_file_may_be_named_instead_of_the_node_file),
        cmocka_unit_test(polygons_become_fans_and_are_counted),
        cmocka_unit_test(numbers_are_read_to_the_last_digit_in_any_locale),
        cmocka_unit_test(a_written_surface_reads_back_bit_for_bit),
        cmocka_unit_test(every_bad_surface_is_refused_with_its_place_and_value),
        cmocka_unit_test(every_bad_pair_of_node_and_ele_is_refused),
        cmocka_unit_test(bad_values_in_binary_files_are_refused_with_their_byte),
        cmocka_unit_test(what_is_no_readable_file_is_refused),
        cmocka_unit_test(every_truncation_of_a_good_file_is_read_or_refused),
        cmocka_unit_test(every_byte_may_be_wrong),
        cmocka_unit_test(a_binary_file_cut_short_is_never_read),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("mesh_read", tests, folder_make, folder_remove);
}
