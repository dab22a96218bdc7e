/* LINK: assimp */
/* A second opinion on the good files: assimp and the gmsh command read the same triangles and tetrahedra.
 * Neither ever opens a user's file. assimp stores float, and triangulates polygons its own way. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <math.h>
#include <string.h>

#include "catnav/mesh.h"
#include "catnav/vec3.h"
#include "mesh_files.h"
#include "mesh_parts.h"

static void area_and_volume(const double a[3], const double b[3], const double c[3], double sum[2])
{
    double u[3], v[3], n[3];
    cn_sub(b, a, u);
    cn_sub(c, a, v);
    cn_cross(u, v, n);
    sum[0] += cn_norm(n) / 2;
    sum[1] += cn_dot(a, n) / 6;
}

static void compare_with_assimp(const char *path)
{
    const struct aiScene *scene = aiImportFile(path, aiProcess_Triangulate);
    cn_surface *s = NULL;
    int triangles = 0;
    double theirs[2] = {0, 0}, ours[2] = {0, 0};

    if (!scene) fail_msg("%s: %s", path, aiGetErrorString());
    for (unsigned m = 0; m < scene->mNumMeshes; m++) {
        const struct aiMesh *mesh = scene->mMeshes[m];
        for (unsigned i = 0; i < mesh->mNumFaces; i++) {
            double x[3][3];
            if (mesh->mFaces[i].mNumIndices != 3) continue;
            for (int k = 0; k < 3; k++) {
                const struct aiVector3D *v = mesh->mVertices + mesh->mFaces[i].mIndices[k];
                x[k][0] = v->x, x[k][1] = v->y, x[k][2] = v->z;
            }
            area_and_volume(x[0], x[1], x[2], theirs);
            triangles++;
        }
    }
    aiReleaseImport(scene);
    assert_int_equal(cn_surface_read(&s, path, NULL), CN_OK);
    for (int i = 0; i < s->ntri; i++)
        area_and_volume(s->vert + 3 * s->tri[3 * i], s->vert + 3 * s->tri[3 * i + 1],
                        s->vert + 3 * s->tri[3 * i + 2], ours);
    if (triangles != s->ntri || fabs(theirs[0] - ours[0]) > 1e-6 * ours[0] ||
        fabs(theirs[1] - ours[1]) > 1e-6 * pow(ours[0], 1.5))
        fail_msg("%s: %d triangles, area %g, volume %g; assimp %d, %g, %g", path, s->ntri, ours[0], ours[1],
                 triangles, theirs[0], theirs[1]);
    cn_surface_free(s);
}

static void assimp_reads_the_same_triangles(void **state)
{
    (void)state;
    for (int i = 0; i < NGOOD; i++)
        if (!strstr(good_surfaces[i], ".msh")) compare_with_assimp(good_path(good_surfaces[i]));
}

static void assimp_reads_the_same_sphere_in_thousands_of_triangles(void **state)
{
    cn_surface *s = NULL;
    char path[128];

    snprintf(path, sizeof path, "%s/sphere.stl", ((folder *)*state)->name);
    assert_int_equal(cn_surface_sphere(&s, (const double[]){1, 2, 3}, 0.7), CN_OK);
    assert_int_equal(cn_surface_write_stl(s, path, NULL), CN_OK);
    cn_surface_free(s);
    compare_with_assimp(path);
}

/* gmsh meshes a box and writes it in each form of .msh; all must hold the same 6 cubic units. */
static void gmsh_writes_what_we_read_in_every_form(void **state)
{
    static const char *const forms[] = {"-format msh41", "-format msh41 -bin", "-format msh22",
                                        "-format msh22 -bin"};
    folder *f = *state;
    static const char model[] = "SetFactory(\"OpenCASCADE\"); Box(1) = {0, 0, 0, 1, 2, 3};\n"
                                "Mesh.CharacteristicLengthMax = 1.5;\n";
    cn_tets *first = NULL;

    if (system("command -v gmsh >/dev/null 2>&1")) skip();
    folder_write(f, "box.geo", model, strlen(model));
    for (int i = 0; i < 4; i++) {
        char command[512], path[128];
        cn_tets *t = NULL;
        cn_surface *s = NULL;
        cn_doctor d;
        cn_error error = {0};
        cn_tets_doctor measured;
        int turned;
        snprintf(command, sizeof command, "cd %s && gmsh -3 -nt 1 box.geo %s -o box%d.msh >/dev/null 2>&1",
                 f->name, forms[i], i);
        assert_int_equal(system(command), 0);
        snprintf(path, sizeof path, "%s/box%d.msh", f->name, i);
        if (cn_tets_read(&t, path, &error) != CN_OK)
            fail_msg("%s:%d: %s", forms[i], error.line, error.message);
        assert_int_equal(cn_tets_check(t, &turned, NULL), CN_OK);
        assert_int_equal(cn_tets_measure(t, &measured, NULL), CN_OK);
        assert_true(fabs(measured.volume - 6) < 1e-9);
        assert_int_equal(cn_surface_read(&s, path, NULL), CN_OK);
        assert_int_equal(cn_surface_check(s, true, &d, NULL), CN_OK);
        assert_true(d.closed && d.manifold && d.oriented && fabs(d.volume - 6) < 1e-9);
        assert_int_equal(d.ntri, measured.boundary);
        if (!first) first = t;
        assert_int_equal(t->ntet, first->ntet);
        assert_memory_equal(t->tet, first->tet, 4 * (size_t)t->ntet * sizeof(int));
        if (t != first) cn_tets_free(t);
        cn_surface_free(s);
    }
    cn_tets_free(first);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(assimp_reads_the_same_triangles),
        cmocka_unit_test(assimp_reads_the_same_sphere_in_thousands_of_triangles),
        cmocka_unit_test(gmsh_writes_what_we_read_in_every_form),
    };
    return cmocka_run_group_tests_name("mesh_opinion", tests, folder_make, folder_remove);
}
