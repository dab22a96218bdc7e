#include "frames_vtk.h"
#include "output.h"

#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Arrays of one file, in order: announced in the header by offset, written after it, each behind its size. */
#define MOST_ARRAYS 8
typedef struct {
    const char *type; /* Float64, Int32, UInt8 */
    const void *data;
    uint64_t bytes;
} array_t;
typedef struct {
    FILE *file;
    int n;
    array_t array[MOST_ARRAYS];
    uint64_t offset;
} appended;

static const char *byte_order(void)
{
    const uint16_t one = 1;
    return *(const unsigned char *)&one ? "LittleEndian" : "BigEndian";
}

static void begin(appended *a, FILE *file, const char *kind)
{
    memset(a, 0, sizeof *a);
    a->file = file;
    fprintf(file,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"%s\" version=\"1.0\" byte_order=\"%s\" "
            "header_type=\"UInt64\">\n"
            "<%s>\n",
            kind, byte_order(), kind);
}

static void announce(appended *a, const char *name, const char *type, int components, const void *data,
                     size_t bytes)
{
    fprintf(a->file,
            "<DataArray type=\"%s\" Name=\"%s\" NumberOfComponents=\"%d\" format=\"appended\" "
            "offset=\"%llu\"/>\n",
            type, name, components, (unsigned long long)a->offset);
    a->array[a->n++] = (array_t){type, data, bytes};
    a->offset += sizeof(uint64_t) + bytes;
}

static void finish(appended *a, const char *kind)
{
    fprintf(a->file, "</Piece>\n</%s>\n<AppendedData encoding=\"raw\">\n_", kind);
    for (int i = 0; i < a->n; i++) {
        fwrite(&a->array[i].bytes, sizeof a->array[i].bytes, 1, a->file);
        if (a->array[i].bytes) fwrite(a->array[i].data, 1, a->array[i].bytes, a->file);
    }
    fputs("\n</AppendedData>\n</VTKFile>\n", a->file);
}

void cn_vtk_number(double value, size_t size, char *text)
{
    const locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    const locale_t old = c_locale ? uselocale(c_locale) : (locale_t)0;
    snprintf(text, size, "%.15g", value);
    if (strtod(text, NULL) != value) snprintf(text, size, "%.17g", value);
    if (c_locale) {
        uselocale(old);
        freelocale(c_locale);
    }
}

static bool all_finite(size_t n, const double *values)
{
    for (size_t i = 0; i < n; i++)
        if (!isfinite(values[i])) return false;
    return true;
}

cn_status cn_vtu_write(const cn_frame_body *body, const char *path, cn_error *error)
{
    const cn_body *b = body->body;
    const bool flat = b->ntet == 0; /* triangles */
    const size_t npoint = (size_t)b->npoint, ncell = (size_t)cn_body_cells(b),
                 width = b->mid ? 10
                         : flat ? 3
                                : 4;
    cn_output output;
    appended a;
    cn_status status = CN_ERR_MEMORY;
    double *displacement = malloc((3 * npoint + 1) * sizeof *displacement);
    int32_t *offset = malloc((ncell + 1) * sizeof *offset),
            *corner = malloc((width * ncell + 1) * sizeof *corner);
    unsigned char *type = malloc(ncell + 1);

    if (!displacement || !offset || !corner || !type) {
        cn_fail(error, status, path, 0, "out of memory while a frame is written");
        goto done;
    }
    if (!all_finite(3 * npoint, body->x) || (body->von_mises && !all_finite(ncell, body->von_mises))) {
        status = cn_fail(error, CN_ERR_NOT_FINITE, path, 0, "%s has a position or stress that is not finite",
                         body->name);
        goto done;
    }
    for (size_t i = 0; i < 3 * npoint; i++)
        displacement[i] = body->x[i] - b->point[i];
    for (size_t i = 0; i < ncell; i++) {
        offset[i] = (int32_t)(width * (i + 1));
        type[i] = b->mid ? 24 : flat ? 5 : 10; /* VTK_QUADRATIC_TETRA, VTK_TRIANGLE, VTK_TETRA */
        for (size_t k = 0; k < width; k++)
            corner[width * i + k] = flat    ? b->boundary->tri[3 * i + k]
                                    : k < 4 ? b->tet[4 * i + k]
                                            : b->mid[6 * i + k - 4];
    }
    if ((status = cn_output_open(&output, path, error)) != CN_OK) goto done;
    begin(&a, output.file, "UnstructuredGrid");
    fprintf(output.file, "<Piece NumberOfPoints=\"%d\" NumberOfCells=\"%zu\">\n", b->npoint, ncell);
    fputs("<PointData Vectors=\"displacement\">\n", output.file);
    announce(&a, "displacement", "Float64", 3, displacement, 3 * npoint * sizeof(double));
    fputs("</PointData>\n<CellData Scalars=\"stress\">\n", output.file);
    if (body->von_mises) announce(&a, "stress", "Float64", 1, body->von_mises, ncell * sizeof(double));
    fputs("</CellData>\n<Points>\n", output.file);
    announce(&a, "Points", "Float64", 3, body->x, 3 * npoint * sizeof(double));
    fputs("</Points>\n<Cells>\n", output.file);
    announce(&a, "connectivity", "Int32", 1, corner, width * ncell * sizeof *corner);
    announce(&a, "offsets", "Int32", 1, offset, ncell * sizeof *offset);
    announce(&a, "types", "UInt8", 1, type, ncell);
    fputs("</Cells>\n", output.file);
    finish(&a, "UnstructuredGrid");
    status = cn_output_commit(&output, error);
done:
    free(displacement);
    free(offset);
    free(corner);
    free(type);
    return status;
}

/* Points (npoint x 3), figures of theirs, and cells of one kind with `width` corners each. */
typedef struct {
    const char *name; /* NULL: ends the list */
    int components;
    const double *data;
} figures;

static cn_status write_vtp(const char *path, int npoint, const double *x, const figures *with,
                           const char *kind, int ncell, const int *corner, int width, cn_error *error)
{
    cn_output output;
    appended a;
    cn_status status;
    int32_t *offset = malloc(((size_t)ncell + 1) * sizeof *offset);

    if (!offset) return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory while it is written");
    for (int i = 0; i < ncell; i++)
        offset[i] = width * (i + 1);
    if ((status = cn_output_open(&output, path, error)) == CN_OK) {
        const bool lines = !strcmp(kind, "Lines");
        begin(&a, output.file, "PolyData");
        fprintf(output.file,
                "<Piece NumberOfPoints=\"%d\" NumberOfVerts=\"0\" NumberOfLines=\"%d\" NumberOfStrips=\"0\" "
                "NumberOfPolys=\"%d\">\n<PointData>\n",
                npoint, lines ? ncell : 0, lines ? 0 : ncell);
        for (; with && with->name; with++)
            announce(&a, with->name, "Float64", with->components, with->data,
                     (size_t)with->components * (size_t)npoint * sizeof(double));
        fputs("</PointData>\n<Points>\n", output.file);
        announce(&a, "Points", "Float64", 3, x, 3 * (size_t)npoint * sizeof(double));
        fprintf(output.file, "</Points>\n<%s>\n", kind);
        announce(&a, "connectivity", "Int32", 1, corner, (size_t)width * (size_t)ncell * sizeof *corner);
        announce(&a, "offsets", "Int32", 1, offset, (size_t)ncell * sizeof *offset);
        fprintf(output.file, "</%s>\n", kind);
        finish(&a, "PolyData");
        status = cn_output_commit(&output, error);
    }
    free(offset);
    return status;
}

cn_status cn_skin_write_vtp(const cn_frame_body *body, const char *path, cn_error *error)
{
    const cn_skin *skin = body->skin;
    const size_t n = 3 * (size_t)skin->nvert;
    const size_t nnode = (size_t)body->body->nnode;
    double *displacement = malloc((n + n / 3 + nnode + 1) * sizeof *displacement);
    cn_status status;
    if (!displacement)
        return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory while a frame is written");
    double *const stress = displacement + n;
    for (size_t i = 0; i < n; i++) { /* rows are in another order than vertices */
        const size_t to = 3 * (size_t)skin->vertex[i / 3] + i % 3;
        displacement[to] = body->worn->x[to] - (skin->centre[i % 3] + skin->rest[i]);
    }
    cn_skin_stress(skin, body->body, body->von_mises, stress + n / 3, stress);
    const figures with[] = {{"normal", 3, body->worn->normal},
                            {"displacement", 3, displacement},
                            {body->von_mises ? "stress" : NULL, 1, stress},
                            {NULL, 0, NULL}};
    if (!all_finite(n + n / 3, displacement) || !all_finite(n, body->worn->normal))
        status = cn_fail(error, CN_ERR_NOT_FINITE, path, 0,
                         "the skin of %s has a position that is not finite", body->name);
    else
        status = write_vtp(path, skin->nvert, body->worn->x, with, "Polys", skin->ntri, skin->tri, 3, error);
    free(displacement);
    return status;
}

cn_status cn_surface_write_vtp(const cn_surface *surface, const char *path, cn_error *error)
{
    if (!all_finite(3 * (size_t)surface->nvert, surface->vert))
        return cn_fail(error, CN_ERR_NOT_FINITE, path, 0, "the surface has a vertex that is not finite");
    return write_vtp(path, surface->nvert, surface->vert, NULL, "Polys", surface->ntri, surface->tri, 3,
                     error);
}

cn_status cn_path_write_vtp(const cn_path *path, const char *file, cn_error *error)
{
    int *corner = malloc(((size_t)path->n + 1) * sizeof *corner);
    if (!corner) return cn_fail(error, CN_ERR_MEMORY, file, 0, "out of memory while it is written");
    for (int i = 0; i < path->n; i++)
        corner[i] = i;
    cn_status status = CN_OK;
    if (!all_finite(3 * (size_t)path->n, path->x))
        status = cn_fail(error, CN_ERR_NOT_FINITE, file, 0, "the path has a point that is not finite");
    const figures with[] = {{"clearance", 1, path->clearance}, {NULL, 0, NULL}};
    const bool clear = status == CN_OK && all_finite((size_t)path->n, path->clearance);
    if (status == CN_OK)
        status = write_vtp(file, path->n, path->x, clear ? with : NULL, "Lines", 1, corner, path->n, error);
    free(corner);
    return status;
}

cn_status cn_path_write_csv(const cn_path *path, const char *file, cn_error *error)
{
    cn_output output;
    const cn_status status = cn_output_open(&output, file, error);
    if (status != CN_OK) return status;
    fputs("s,x,y,z,clearance,waypoint\n", output.file);
    for (int i = 0; i < path->n; i++) {
        int waypoint = -1;
        for (int k = 0; k < path->nwaypoint; k++)
            if (path->waypoint[k] == i) waypoint = k;
        fprintf(output.file, "%.17g,%.17g,%.17g,%.17g,%.17g,%d\n", path->s[i], path->x[3 * i],
                path->x[3 * i + 1], path->x[3 * i + 2], path->clearance[i], waypoint);
    }
    return cn_output_commit(&output, error);
}
