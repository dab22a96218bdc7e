#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "catnav/frames.h"
#include "fail_alloc.h"

/* Two tetrahedra with a face in common. */
static double rest[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1};
static int tet[8] = {0, 1, 2, 3, 1, 2, 3, 4};
static cn_body body = {.nnode = 5, .npoint = 5, .ntet = 2, .tet = tet, .rest = rest, .point = rest};

static char folder[64];

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "test-frames-XXXXXX");
    return mkdtemp(folder) ? 0 : 1;
}

static int remove_folder(void **state)
{
    (void)state;
    DIR *list = opendir(folder);
    for (struct dirent *entry; list && (entry = readdir(list));) {
        char path[512];
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        unlink(path);
    }
    if (list) closedir(list);
    return rmdir(folder);
}

static char *read_all(const char *name, size_t *length)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    char *bytes = calloc(1, 1 << 16);
    *length = fread(bytes, 1, (1 << 16) - 1, file);
    fclose(file);
    return bytes;
}

static cn_frame one_frame(int step, const cn_frame_body *bodies, int nbody)
{
    return (cn_frame){step, 0.01 * step, nbody, bodies};
}

static int occurrences(const char *text, const char *words)
{
    int n = 0;
    for (const char *at = text; (at = strstr(at, words)); at++)
        n++;
    return n;
}

static void the_index_is_whole_after_every_frame_and_names_every_piece(void **state)
{
    (void)state;
    double x[15], stress[2] = {1, 2};
    const cn_frame_body bodies[] = {{"catheter", &body, 5, x, stress, INFINITY, NULL, NULL},
                                    {"a/b c", &body, 5, x, NULL, INFINITY, NULL, NULL},
                                    {"a_b_c", &body, 5, x, stress, INFINITY, NULL, NULL},
                                    {"..", &body, 5, x, stress, INFINITY, NULL, NULL}};
    cn_frames *frames;
    cn_error error = {0};
    size_t n;
    memcpy(x, rest, sizeof x);
    assert_int_equal(cn_frames_open(&frames, folder, &error), CN_OK);
    for (int step = 0; step < 25; step += 5) {
        const cn_frame frame = one_frame(step, bodies, 4);
        assert_int_equal(cn_frames_write(frames, &frame, &error), CN_OK);
        char *pvd = read_all("frames.pvd", &n);
        assert_int_equal(occurrences(pvd, "<DataSet "), 4 * (step / 5 + 1));
        assert_int_equal(occurrences(pvd, "</Collection>\n</VTKFile>\n"), 1);
        assert_string_equal(pvd + n - strlen("</Collection>\n</VTKFile>\n"), "</Collection>\n</VTKFile>\n");
        free(pvd);
    }
    assert_int_equal(cn_frames_close(frames, &error), CN_OK);
    static const char *const pieces[] = {"catheter_20.vtu", "a_b_c_20.vtu", "a_b_c-2_20.vtu", "_._20.vtu"};
    char *pvd = read_all("frames.pvd", &n);
    assert_non_null(strstr(pvd, "timestep=\"0.2\" part=\"0\" file=\"catheter_20.vtu\""));
    for (int i = 0; i < 4; i++) {
        char *piece = read_all(pieces[i], &n), words[64];
        if (!piece) fail_msg("%s is not there", pieces[i]);
        snprintf(words, sizeof words, "file=\"%s\"", pieces[i]);
        assert_non_null(strstr(pvd, words));
        free(piece);
    }
    free(pvd);
}

/* Doubles of the array with this name, by its offset in the appended block. */
static const double *values(const char *bytes, const char *name, uint64_t *size)
{
    char words[64];
    snprintf(words, sizeof words, "Name=\"%s\"", name);
    const char *header = strstr(bytes, words);
    if (!header) return NULL;
    const unsigned long offset = strtoul(strstr(header, "offset=\"") + 8, NULL, 10);
    const char *data = strstr(bytes, "encoding=\"raw\">\n_") + strlen("encoding=\"raw\">\n_") + offset;
    static double copy[16];
    memcpy(size, data, sizeof *size);
    assert_true(*size <= sizeof copy);
    memcpy(copy, data + sizeof *size, *size);
    return copy;
}

static void a_piece_holds_positions_displacements_and_stresses_to_the_last_bit(void **state)
{
    (void)state;
    double x[15], stress[2] = {1.0 / 3, 1e300};
    for (int i = 0; i < 15; i++)
        x[i] = rest[i] + 1e-3 * sin(i);
    const cn_frame_body moved = {"bits", &body, 5, x, stress, INFINITY, NULL, NULL};
    const cn_frame frame = one_frame(7, &moved, 1);
    cn_frames *frames;
    size_t n;
    uint64_t size;
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    assert_int_equal(cn_frames_write(frames, &frame, NULL), CN_OK);
    cn_frames_close(frames, NULL);
    char *bytes = read_all("bits_7.vtu", &n);
    assert_memory_equal(values(bytes, "Points", &size), x, sizeof x);
    assert_int_equal(size, sizeof x);
    const double *u = values(bytes, "displacement", &size);
    for (int i = 0; i < 15; i++)
        assert_true(u[i] == x[i] - rest[i]);
    assert_memory_equal(values(bytes, "stress", &size), stress, sizeof stress);
    assert_int_equal(size, sizeof stress);
    free(bytes);
}

/* The steps that frames.pvd lists, each with its piece beside it; -1 ends them. */
static void listed_steps(const char *name, int *steps)
{
    char words[64];
    size_t n, m;
    char *pvd = read_all("frames.pvd", &n);
    snprintf(words, sizeof words, "file=\"%s_", name);
    for (const char *at = pvd; (at = strstr(at, words)); at++, steps++) {
        char piece[64], own[64];
        *steps = atoi(at + strlen(words));
        snprintf(piece, sizeof piece, "%s_%d.vtu", name, *steps);
        char *bytes = read_all(piece, &m);
        if (!bytes) fail_msg("%s is listed and not there", piece);
        free(bytes);
        snprintf(own, sizeof own, "timestep=\"%.15g\"", 0.01 * *steps);
        assert_non_null(strstr(pvd, own));
    }
    *steps = -1;
    assert_int_equal(occurrences(pvd, "</Collection>\n</VTKFile>\n"), 1);
    assert_string_equal(pvd + n - strlen("</Collection>\n</VTKFile>\n"), "</Collection>\n</VTKFile>\n");
    free(pvd);
}

static bool is_there(const char *name)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return access(path, F_OK) == 0;
}

static void write_steps(cn_frames *frames, const cn_frame_body *pieces, int n, const int *steps)
{
    for (int i = 0; i < n; i++) {
        cn_error error = {0};
        const cn_frame frame = one_frame(steps[i], pieces, 2);
        if (cn_frames_write(frames, &frame, &error) != CN_OK) fail_msg("%s", error.message);
    }
}

static void a_run_that_goes_back_leaves_the_branch_it_took(void **state)
{
    (void)state;
    const double stress[2] = {1, 2};
    double x[15];
    const cn_frame_body pieces[] = {{"back", &body, 5, x, stress, INFINITY, NULL, NULL},
                                    {"wire", &body, 5, rest, stress, INFINITY, NULL, NULL}};
    static const int first[] = {0, 4, 8, 12, 13}, again[] = {8, 12, 12}, expected[] = {0, 4, 8, 12, -1};
    int steps[8];
    size_t n;
    cn_frames *frames;
    memcpy(x, rest, sizeof x);
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    write_steps(frames, pieces, 5, first);
    assert_true(is_there("back_13.vtu") && is_there("wire_13.vtu"));
    x[0] = 0.5; /* the new branch is told from the old by its place */
    for (int i = 0; i < 3; i++) {
        write_steps(frames, pieces, 1, again + i);
        listed_steps("back", steps);
        assert_memory_equal(steps, expected, (i == 0 ? 3 : 4) * sizeof *steps);
        assert_int_equal(steps[i == 0 ? 3 : 4], -1);
        listed_steps("wire", steps);
        assert_int_equal(steps[i == 0 ? 3 : 4], -1);
        assert_false(is_there("back_13.vtu") || is_there("wire_13.vtu"));
        assert_int_equal(is_there("back_12.vtu"), i > 0);
        uint64_t size;
        char *piece = read_all(i ? "back_12.vtu" : "back_8.vtu", &n);
        assert_true(values(piece, "Points", &size)[0] == 0.5);
        free(piece);
    }
    const int start = 0; /* back to the very beginning */
    write_steps(frames, pieces, 1, &start);
    listed_steps("wire", steps);
    assert_true(steps[0] == 0 && steps[1] == -1 && !is_there("wire_4.vtu"));
    x[3] = NAN; /* a frame that is refused takes nothing away */
    const cn_frame bad = one_frame(0, pieces, 2);
    assert_int_equal(cn_frames_write(frames, &bad, NULL), CN_ERR_NOT_FINITE);
    listed_steps("back", steps);
    assert_true(steps[0] == 0 && steps[1] == -1);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
}

static void write_text(const char *name, const char *text)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static void a_folder_holds_one_run_and_files_of_others_stay(void **state)
{
    (void)state;
    static const char begin[] = "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" "
                                "version=\"0.1\">\n<Collection>\n",
                      line[] = "<DataSet timestep=\"0\" part=\"0\" file=\"%s\"/>\n";
    static const char *const foreign[] = {"../keep_1.vtu", "keep.vtu", "keep_1.vtp", "keep_x.vtu",
                                          ".keep_1.vtu"};
    const double stress[2] = {1, 2};
    const cn_frame_body pieces[] = {{"old", &body, 5, rest, stress, INFINITY, NULL, NULL},
                                    {"gone", &body, 5, rest, stress, INFINITY, NULL, NULL}};
    static const int first[] = {0, 7, 90};
    int steps[8];
    cn_frames *frames;
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    write_steps(frames, pieces, 3, first);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
    write_text("old_8.vtu", "named by no index");
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    assert_false(is_there("old_0.vtu") || is_there("old_90.vtu") || is_there("gone_7.vtu"));
    assert_true(is_there("old_8.vtu"));
    write_steps(frames, pieces, 2, first);
    listed_steps("old", steps);
    assert_true(steps[0] == 0 && steps[1] == 7 && steps[2] == -1);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);

    for (int i = 0; i < 5; i++) { /* names that are none of ours */
        char text[512];
        int n = snprintf(text, sizeof text, "%s", begin);
        n += snprintf(text + n, sizeof text - (size_t)n, line, foreign[i]);
        snprintf(text + n, sizeof text - (size_t)n, "</Collection>\n</VTKFile>\n");
        write_text("frames.pvd", text);
        if (i > 0) write_text(foreign[i], "someone's");
        assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
        assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
        if (i > 0) assert_true(is_there(foreign[i]));
    }
    write_text("frames.pvd", "<VTKFile type=\"Collection\">\n<DataSet timestep=\"0\" part=\"0\" "
                             "file=\"old_8.vtu\"/>\n"); /* another program's index */
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
    assert_true(is_there("old_8.vtu"));
}

static void a_second_run_in_the_same_folder_is_refused_and_harms_nothing(void **state)
{
    (void)state;
    const double stress[2] = {1, 2};
    const cn_frame_body pieces[] = {{"one", &body, 5, rest, stress, INFINITY, NULL, NULL},
                                    {"two", &body, 5, rest, stress, INFINITY, NULL, NULL}};
    static const int steps[] = {0, 1};
    int listed[8];
    cn_frames *frames, *second;
    cn_error error = {0};
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    write_steps(frames, pieces, 1, steps);
    assert_int_equal(cn_frames_open(&second, folder, &error), CN_ERR_FILE);
    assert_null(second);
    assert_non_null(strstr(error.message, "another run is writing its frames here"));
    write_steps(frames, pieces, 1, steps + 1);
    listed_steps("two", listed);
    assert_true(listed[0] == 0 && listed[1] == 1 && listed[2] == -1);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
    assert_int_equal(cn_frames_open(&second, folder, NULL), CN_OK);
    assert_int_equal(cn_frames_close(second, NULL), CN_OK);
}

/* ParaView's own library as the judge; one line of numbers comes back. */
static int vtk(const char *program, const char *argument, char *line, int size)
{
    char command[2048];
    snprintf(command, sizeof command, "/usr/bin/python3 -c '%s' %s 2>/dev/null", program, argument);
    FILE *pipe = popen(command, "r");
    if (!pipe || !fgets(line, size, pipe)) line[0] = 0;
    return pipe ? pclose(pipe) : -1;
}

static void vtk_reads_back_what_was_written(void **state)
{
    (void)state;
    static const char ugrid[] =
        "import sys, vtk\n"
        "r = vtk.vtkXMLUnstructuredGridReader(); r.SetFileName(sys.argv[1]); r.Update(); g = r.GetOutput()\n"
        "p = g.GetPoint(4); u = g.GetPointData().GetArray(\"displacement\").GetTuple(4)\n"
        "s = g.GetCellData().GetArray(\"stress\"); c = g.GetCell(1)\n"
        "print(g.GetNumberOfPoints(), g.GetNumberOfCells(), g.GetCellType(1), *[c.GetPointId(i) for i in "
        "range(4)],\n"
        "      repr(p[0]), repr(p[2]), repr(u[1]), repr(s.GetValue(1)))\n";
    static const char poly[] =
        "import sys, vtk\n"
        "r = vtk.vtkXMLPolyDataReader(); r.SetFileName(sys.argv[1]); r.Update(); g = r.GetOutput()\n"
        "print(g.GetNumberOfPoints(), g.GetNumberOfPolys(), g.GetNumberOfLines(), repr(g.GetPoint(1)[0]))\n";
    char line[256], path[128];
    if (vtk("import vtk\nprint(1)", "", line, sizeof line) != 0) skip();

    double x[15], stress[2] = {5, 1.0 / 3};
    for (int i = 0; i < 15; i++)
        x[i] = rest[i] + 0.1 * i;
    const cn_frame_body moved = {"vtk", &body, 5, x, stress, INFINITY, NULL, NULL};
    const cn_frame frame = one_frame(3, &moved, 1);
    cn_frames *frames;
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    assert_int_equal(cn_frames_write(frames, &frame, NULL), CN_OK);
    cn_frames_close(frames, NULL);
    snprintf(path, sizeof path, "%s/vtk_3.vtu", folder);
    assert_int_equal(vtk(ugrid, path, line, sizeof line), 0);
    int n, m, type, c[4];
    double px, pz, uy, s;
    assert_int_equal(sscanf(line, "%d %d %d %d %d %d %d %lf %lf %lf %lf", &n, &m, &type, c, c + 1, c + 2,
                            c + 3, &px, &pz, &uy, &s),
                     11);
    assert_true(n == 5 && m == 2 && type == 10 && c[0] == 1 && c[3] == 4);
    assert_true(px == x[12] && pz == x[14] && uy == x[13] - rest[13] && s == stress[1]);

    int triangles[6] = {0, 1, 2, 0, 2, 3};
    const cn_surface surface = {4, 2, x, triangles};
    snprintf(path, sizeof path, "%s/surface.vtp", folder);
    assert_int_equal(cn_surface_write_vtp(&surface, path, NULL), CN_OK);
    assert_int_equal(vtk(poly, path, line, sizeof line), 0);
    int lines;
    assert_int_equal(sscanf(line, "%d %d %d %lf", &n, &m, &lines, &px), 4);
    assert_true(n == 4 && m == 2 && lines == 0 && px == x[3]);

    cn_path *route;
    assert_int_equal(cn_path_new(&route, 5, x, 0, NULL, NULL), CN_OK);
    snprintf(path, sizeof path, "%s/path.vtp", folder);
    assert_int_equal(cn_path_write_vtp(route, path, NULL), CN_OK);
    assert_int_equal(vtk(poly, path, line, sizeof line), 0);
    assert_int_equal(sscanf(line, "%d %d %d %lf", &n, &m, &lines, &px), 4);
    assert_true(n == 5 && m == 0 && lines == 1 && px == x[3]);
    cn_path_free(route);
}

static void vtk_sees_second_order_tetrahedra_with_their_mid_nodes_in_place(void **state)
{
    (void)state;
    static const char script[] =
        "import sys, vtk\n"
        "r = vtk.vtkXMLUnstructuredGridReader(); r.SetFileName(sys.argv[1]); r.Update()\n"
        "g = r.GetOutput(); c = g.GetCell(0); p = g.GetPoint(4)\n"
        "e = [[c.GetEdge(k).GetPointId(i) for i in range(3)] for k in range(6)]\n"
        "print(g.GetNumberOfPoints(), g.GetCellType(0), c.GetNumberOfPoints(), repr(p[0]), *sum(e, []))\n";
    static const int edge[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
    static int corner[4] = {0, 1, 2, 3}, mid[6] = {4, 5, 6, 7, 8, 9};
    double x[30];
    memcpy(x, rest, 12 * sizeof *x);
    for (int k = 0; k < 18; k++)
        x[12 + k] = 0.5 * (rest[3 * edge[k / 3][0] + k % 3] + rest[3 * edge[k / 3][1] + k % 3]);
    const cn_body second = {
        .nnode = 10, .npoint = 10, .ntet = 1, .tet = corner, .mid = mid, .rest = x, .point = x};
    const cn_frame_body piece = {"second", &second, 10, x, NULL, INFINITY, NULL, NULL};
    const cn_frame frame = one_frame(0, &piece, 1);
    cn_frames *frames;
    char line[256], path[128];
    if (vtk("import vtk\nprint(1)", "", line, sizeof line) != 0) skip();
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    assert_int_equal(cn_frames_write(frames, &frame, NULL), CN_OK);
    cn_frames_close(frames, NULL);
    snprintf(path, sizeof path, "%s/second_0.vtu", folder);
    assert_int_equal(vtk(script, path, line, sizeof line), 0);
    int npoint, type, corners, got[18], used = 0;
    double px;
    assert_int_equal(sscanf(line, "%d %d %d %lf%n", &npoint, &type, &corners, &px, &used), 4);
    assert_true(npoint == 10 && type == 24 && corners == 10 && px == x[12]);
    const char *at = line + used;
    for (int i = 0; i < 18; i++)
        got[i] = (int)strtol(at, (char **)&at, 10);
    for (int k = 0; k < 6; k++) /* VTK's edge: its ends, then the node amid */
        for (int m = 0; m < 6; m++)
            if ((got[3 * k] == edge[m][0] && got[3 * k + 1] == edge[m][1]) ||
                (got[3 * k] == edge[m][1] && got[3 * k + 1] == edge[m][0]))
                assert_int_equal(got[3 * k + 2], mid[m]);
}

static void a_path_as_csv_reads_back_exactly(void **state)
{
    (void)state;
    const double x[9] = {0, 0, 0, 0.1, 0, 1.0 / 3, 0, 0, 1};
    const int waypoint[2] = {0, 2};
    cn_path *route;
    char file[128], line[256];
    assert_int_equal(cn_path_new(&route, 3, x, 2, waypoint, NULL), CN_OK);
    route->clearance[1] = 0.1;
    snprintf(file, sizeof file, "%s/path.csv", folder);
    assert_int_equal(cn_path_write_csv(route, file, NULL), CN_OK);
    FILE *csv = fopen(file, "r");
    assert_non_null(fgets(line, sizeof line, csv));
    assert_string_equal(line, "s,x,y,z,clearance,waypoint\n");
    for (int i = 0; i < 3; i++) {
        double s, p[3], clearance;
        int w;
        assert_int_equal(fscanf(csv, "%lf,%lf,%lf,%lf,%lf,%d\n", &s, p, p + 1, p + 2, &clearance, &w), 6);
        assert_true(s == route->s[i] && p[0] == x[3 * i] && p[2] == x[3 * i + 2] &&
                    clearance == route->clearance[i]);
        assert_int_equal(w, i == 0 ? 0 : i == 2 ? 1 : -1);
    }
    fclose(csv);
    cn_path_free(route);
}

static void nothing_that_is_not_finite_is_written(void **state)
{
    (void)state;
    double x[15], stress[2] = {1, NAN};
    size_t n;
    cn_error error = {0};
    cn_frames *frames;
    memcpy(x, rest, sizeof x);
    assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
    const cn_frame_body bad = {"bad", &body, 5, x, stress, INFINITY, NULL, NULL};
    cn_frame frame = one_frame(1, &bad, 1);
    assert_int_equal(cn_frames_write(frames, &frame, &error), CN_ERR_NOT_FINITE);
    stress[1] = 0;
    x[7] = INFINITY;
    assert_int_equal(cn_frames_write(frames, &frame, NULL), CN_ERR_NOT_FINITE);
    cn_frames_close(frames, NULL);
    assert_null(read_all("bad_1.vtu", &n));
    char *pvd = read_all("frames.pvd", &n);
    assert_int_equal(occurrences(pvd, "<DataSet "), 0);
    free(pvd);
}

static void a_folder_that_cannot_be_made_is_one_sentence(void **state)
{
    (void)state;
    static const char *const bad[] = {"", "/dev/null/frames", "/proc/frames/deep"};
    cn_frames *frames;
    for (int i = 0; i < 3; i++) {
        cn_error error = {0};
        assert_int_equal(cn_frames_open(&frames, bad[i], &error), CN_ERR_FILE);
        assert_true(!frames && *error.message);
    }
}

static void a_full_disk_leaves_the_index_whole(void **state)
{
    (void)state;
    static const char tail[] = "</Collection>\n</VTKFile>\n";
    const double stress[2] = {1, 2};
    const cn_frame_body piece = {"full", &body, 5, rest, stress, INFINITY, NULL, NULL};
    struct rlimit old, small;
    size_t n;
    cn_frames *frames;
    cn_error error = {0};
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    signal(SIGXFSZ,
           SIG_IGN); /* a write beyond the limit then fails as on a full disk, perhaps in its middle */
    for (rlim_t most = 1000; most < 4400; most += 3350) { /* too little for a piece; for a long index */
        int step = 0;
        memset(&error, 0, sizeof error);
        assert_int_equal(cn_frames_open(&frames, folder, NULL), CN_OK);
        small = old;
        small.rlim_cur = most;
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
        cn_status status = CN_OK;
        for (; status == CN_OK && step < 1000; step++) {
            const cn_frame frame = one_frame(step, &piece, 1);
            status = cn_frames_write(frames, &frame, &error);
        }
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
        assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
        assert_true(status == CN_ERR_FILE && strstr(error.message, "cannot be written"));
        char *pvd = read_all("frames.pvd", &n);
        assert_int_equal(occurrences(pvd, "<DataSet "), step - 1);
        assert_string_equal(pvd + n - strlen(tail), tail);
        free(pvd);
        DIR *list = opendir(folder);
        for (struct dirent *entry; (entry = readdir(list));)
            assert_null(strstr(entry->d_name, ".tmp"));
        closedir(list);
    }
    signal(SIGXFSZ, SIG_DFL);
}

static void folders_above_are_made_too(void **state)
{
    (void)state;
    char deep[128];
    cn_frames *frames;
    snprintf(deep, sizeof deep, "%s/a/b", folder);
    assert_int_equal(cn_frames_open(&frames, deep, NULL), CN_OK);
    assert_int_equal(cn_frames_close(frames, NULL), CN_OK);
    strcat(deep, "/frames.pvd");
    assert_int_equal(unlink(deep), 0);
    *strrchr(deep, '/') = 0;
    assert_int_equal(rmdir(deep), 0);
    *strrchr(deep, '/') = 0;
    assert_int_equal(rmdir(deep), 0);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    const double stress[2] = {1, 2};
    const cn_frame_body bodies[] = {{"a", &body, 5, rest, stress, INFINITY, NULL, NULL},
                                    {"b", &body, 5, rest, stress, INFINITY, NULL, NULL}};
    const cn_frame frame = one_frame(2, bodies, 2);
    bool fired = true;
    for (long i = 0; fired; i++) {
        cn_frames *frames;
        fail_alloc_at(i);
        cn_status status = cn_frames_open(&frames, folder, NULL);
        for (int k = 0; k < 2 && status == CN_OK; k++) /* the second time in place of the first */
            status = cn_frames_write(frames, &frame, NULL);
        cn_frames_close(frames, NULL);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_int_equal(status, fired ? CN_ERR_MEMORY : CN_OK);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_index_is_whole_after_every_frame_and_names_every_piece),
        cmocka_unit_test(a_piece_holds_positions_displacements_and_stresses_to_the_last_bit),
        cmocka_unit_test(a_run_that_goes_back_leaves_the_branch_it_took),
        cmocka_unit_test(a_folder_holds_one_run_and_files_of_others_stay),
        cmocka_unit_test(a_second_run_in_the_same_folder_is_refused_and_harms_nothing),
        cmocka_unit_test(vtk_reads_back_what_was_written),
        cmocka_unit_test(vtk_sees_second_order_tetrahedra_with_their_mid_nodes_in_place),
        cmocka_unit_test(a_path_as_csv_reads_back_exactly),
        cmocka_unit_test(nothing_that_is_not_finite_is_written),
        cmocka_unit_test(a_folder_that_cannot_be_made_is_one_sentence),
        cmocka_unit_test(a_full_disk_leaves_the_index_whole),
        cmocka_unit_test(folders_above_are_made_too),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
