/* mesh_read_ply.c - PLY: ascii, binary_little_endian, binary_big_endian; vertices with x, y, z of any number
 * type, faces as lists; further properties and elements are passed over by their declared sizes. */
#include "mesh_read.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

enum { MOST_ELEMENTS = 32, MOST_PROPERTIES = 64, MOST_CORNERS = 65535 };
typedef enum { NONE, CHAR, UCHAR, SHORT, USHORT, INT, UINT, FLOAT, DOUBLE } ply_type;
typedef enum { OTHER, X, Y, Z, CORNERS } ply_role;

static const struct {
    const char *name;
    ply_type type;
} type_names[] = {{"char", CHAR},   {"int8", CHAR},     {"uchar", UCHAR},   {"uint8", UCHAR},
                  {"short", SHORT}, {"int16", SHORT},   {"ushort", USHORT}, {"uint16", USHORT},
                  {"int", INT},     {"int32", INT},     {"uint", UINT},     {"uint32", UINT},
                  {"float", FLOAT}, {"float32", FLOAT}, {"double", DOUBLE}, {"float64", DOUBLE}};
static const int type_size[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};

typedef struct {
    ply_type count, type; /* count NONE: a single value */
    ply_role role;
} ply_property;

typedef struct {
    enum { ELSE, VERTEX, FACE, STRIP } kind;
    int64_t n;
    int nproperty;
    ply_property property[MOST_PROPERTIES];
} ply_element;

typedef struct {
    cn_scan *scan;
    bool ascii;
    int nelement;
    ply_element element[MOST_ELEMENTS];
} ply;

static cn_status read_type(cn_scan *scan, ply_type *type)
{
    const char *token;
    size_t length;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the line ends where a type should stand");
    for (size_t i = 0; i < sizeof type_names / sizeof *type_names; i++)
        if (cn_scan_is(token, length, type_names[i].name)) {
            *type = type_names[i].type;
            return CN_OK;
        }
    return cn_scan_fail(scan, CN_FAULT_WORD, "'%s' is no type of PLY (char ... double)",
                        cn_scan_quote(token, length).text);
}

static cn_status read_property(ply *file)
{
    cn_scan *scan = file->scan;
    ply_element *element = file->element + file->nelement - 1;
    const char *token, *cursor = scan->cursor;
    size_t length;
    cn_status status;

    if (!file->nelement)
        return cn_scan_fail(scan, CN_FAULT_ORDER, "a property stands before the first element");
    if (element->nproperty == MOST_PROPERTIES)
        return cn_scan_fail(scan, CN_FAULT_TOO_MANY, "the element has more than %d properties",
                            MOST_PROPERTIES);
    ply_property *property = element->property + element->nproperty++;
    *property = (ply_property){NONE, NONE, OTHER};
    if (cn_scan_token(scan, &token, &length) && cn_scan_is(token, length, "list")) {
        if ((status = read_type(scan, &property->count)) != CN_OK) return status;
        if (property->count >= FLOAT)
            return cn_scan_fail(scan, CN_FAULT_TYPE, "a list's count must be of a whole-number type");
    } else {
        scan->cursor = cursor;
    }
    if ((status = read_type(scan, &property->type)) != CN_OK) return status;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the property has no name");
    if (element->kind == VERTEX && !property->count && length == 1)
        property->role = *token == 'x' ? X : *token == 'y' ? Y : *token == 'z' ? Z : OTHER;
    if (element->kind == FACE && property->count &&
        (cn_scan_is(token, length, "vertex_indices") || cn_scan_is(token, length, "vertex_index")))
        property->role = CORNERS;
    if (property->role == CORNERS && property->type >= FLOAT)
        return cn_scan_fail(scan, CN_FAULT_TYPE, "the faces' corners must be of a whole-number type");
    for (int i = 0; property->role && i < element->nproperty - 1; i++)
        if (element->property[i].role == property->role)
            return cn_scan_fail(scan, CN_FAULT_TWICE, "the property '%s' is declared twice",
                                cn_scan_quote(token, length).text);
    return cn_scan_no_more(scan, "the property");
}

static cn_status read_element(ply *file)
{
    cn_scan *scan = file->scan;
    const char *token;
    size_t length;
    cn_status status;

    if (file->nelement == MOST_ELEMENTS)
        return cn_scan_fail(scan, CN_FAULT_TOO_MANY, "the file has more than %d elements", MOST_ELEMENTS);
    ply_element *element = file->element + file->nelement++;
    *element = (ply_element){.kind = ELSE};
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the element has no name");
    if (cn_scan_is(token, length, "vertex")) element->kind = VERTEX;
    if (cn_scan_is(token, length, "face")) element->kind = FACE;
    if (cn_scan_is(token, length, "tristrips")) element->kind = STRIP;
    for (int i = 0; element->kind && i < file->nelement - 1; i++)
        if (file->element[i].kind == element->kind)
            return cn_scan_fail(scan, CN_FAULT_TWICE, "the element '%s' is declared twice",
                                cn_scan_quote(token, length).text);
    if (element->kind == STRIP)
        return cn_scan_fail(scan, CN_FAULT_UNREAD, "triangle strips are not read: export a list of faces");
    if ((status = cn_scan_integer(scan, "the element's count", 0, INT_MAX / 3, &element->n)) != CN_OK)
        return status;
    return cn_scan_no_more(scan, "the element's count");
}

static cn_status read_header(ply *file)
{
    cn_scan *scan = file->scan;
    const char *token;
    size_t length;
    bool format = false;
    cn_status status;

    if ((status = cn_scan_need_line(scan, "'ply'")) != CN_OK) return status;
    if ((status = cn_scan_word(scan, "ply")) != CN_OK) return status;
    for (;;) {
        if ((status = cn_scan_need_line(scan, "'end_header'")) != CN_OK) return status;
        if (!cn_scan_token(scan, &token, &length)) continue;
        if (cn_scan_is(token, length, "comment") || cn_scan_is(token, length, "obj_info")) continue;
        if (cn_scan_is(token, length, "end_header")) break;
        if (cn_scan_is(token, length, "format") && !format) {
            format = true;
            if (!cn_scan_token(scan, &token, &length)) length = 0;
            file->ascii = cn_scan_is(token, length, "ascii");
            scan->swap = cn_scan_is(token, length, "binary_big_endian");
            if (!file->ascii && !scan->swap && !cn_scan_is(token, length, "binary_little_endian"))
                return cn_scan_fail(
                    scan, CN_FAULT_FORMAT,
                    "format '%s' is unknown: ascii, binary_little_endian or binary_big_endian",
                    cn_scan_quote(token, length).text);
            if ((status = cn_scan_word(scan, "1.0")) != CN_OK) return status;
        } else if (cn_scan_is(token, length, "element")) {
            if ((status = read_element(file)) != CN_OK) return status;
        } else if (cn_scan_is(token, length, "property")) {
            if ((status = read_property(file)) != CN_OK) return status;
        } else {
            return cn_scan_fail(scan, CN_FAULT_WORD,
                                "'%s' does not belong here: format, element, property, comment or end_header "
                                "does",
                                cn_scan_quote(token, length).text);
        }
    }
    return format ? CN_OK : cn_scan_fail(scan, CN_FAULT_FORMAT, "the header names no format");
}

/* One value; ASCII: the next token. `plain` false: it is passed over, only its presence counts. */
static cn_status read_value(const ply *file, ply_type type, bool plain, const char *what, double *value)
{
    cn_scan *scan = file->scan;
    const char *token;
    size_t length;
    cn_status status;

    if (file->ascii && !plain)
        return cn_scan_token(scan, &token, &length)
                   ? CN_OK
                   : cn_scan_fail(scan, CN_FAULT_COUNT,
                                  "the line ends before all properties the header declares");
    if (file->ascii) {
        if ((status = cn_scan_number(scan, what, value)) != CN_OK) return status;
        if (type < FLOAT && *value != floor(*value))
            return cn_scan_fail(scan, CN_FAULT_TYPE, "%s is %.9g: a whole number is needed", what, *value);
        return CN_OK;
    }
    const size_t at = scan->at;
    const unsigned char *bytes = cn_scan_bytes(scan, (size_t)type_size[type]);
    if (!bytes)
        return cn_scan_fail_at(scan, CN_FAULT_CUT_SHORT, at, "the file ends within %s: it is cut short",
                               what);
    const uint64_t bits = cn_scan_unsigned(scan, bytes, type_size[type]);
    switch (type) {
    case CHAR:
        *value = (double)(int8_t)bits;
        break;
    case SHORT:
        *value = (double)(int16_t)bits;
        break;
    case INT:
        *value = (double)(int32_t)bits;
        break;
    case FLOAT:
    case DOUBLE:
        *value = cn_scan_real(scan, bytes, type_size[type]);
        break;
    default:
        *value = (double)bits;
    }
    if (plain && !isfinite(*value))
        return cn_scan_fail_at(scan, CN_FAULT_NUMBER, at, "%s is %g: a finite number is needed", what,
                               *value);
    return CN_OK;
}

static cn_status fail(const ply *file, int fault, size_t at, const char *what, double value,
                      const char *needed)
{
    if (file->ascii) return cn_scan_fail(file->scan, fault, "%s is %.9g: %s", what, value, needed);
    return cn_scan_fail_at(file->scan, fault, at, "%s is %.9g: %s", what, value, needed);
}

/* One face's corners, into `corner` where it is not NULL. */
static cn_status read_corners(const ply *file, const ply_property *property, int nvert, int *corner, int *n)
{
    double value;
    size_t at = file->scan->at;
    cn_status status = read_value(file, property->count, true, "the face's count of corners", &value);

    if (status != CN_OK) return status;
    if (!(value >= 3 && value <= MOST_CORNERS))
        return fail(file, CN_FAULT_COUNT, at, "the face's count of corners", value,
                    "between 3 and 65535 are needed");
    *n = (int)value;
    for (int i = 0; i < *n; i++) {
        at = file->scan->at;
        if ((status = read_value(file, property->type, corner != NULL, "a face's vertex", &value)) != CN_OK)
            return status;
        if (!corner) continue;
        if (!(value >= 0 && value < nvert))
            return fail(file, CN_FAULT_INDEX, at, "a face's vertex", value,
                        "it must be at least 0 and below the count of vertices");
        corner[i] = (int)value;
    }
    return CN_OK;
}

static cn_status pass_over(const ply *file, const ply_property *property)
{
    double count = 1, value;
    cn_status status;

    if (property->count) {
        const size_t at = file->scan->at;
        if ((status = read_value(file, property->count, true, "a list's count", &count)) != CN_OK)
            return status;
        if (!(count >= 0))
            return fail(file, CN_FAULT_RANGE, at, "a list's count", count, "it cannot be negative");
    }
    for (double i = 0; i < count; i++)
        if ((status = read_value(file, property->type, false, "a property", &value)) != CN_OK) return status;
    return CN_OK;
}

typedef struct {
    cn_surface *surface; /* NULL: faces are only counted */
    int nvert;
    int64_t ntri;
    int most, polygons;
    int *corner;
} ply_mesh;

static cn_status read_row(const ply *file, const ply_element *element, int64_t row, ply_mesh *mesh)
{
    static const char *const names[] = {"", "vertex coordinate x", "vertex coordinate y",
                                        "vertex coordinate z"};
    cn_surface *surface = mesh->surface;
    cn_status status;

    if (file->ascii && (status = cn_scan_need_line(file->scan, "a row of an element")) != CN_OK)
        return status;
    for (int i = 0; i < element->nproperty; i++) {
        const ply_property *property = element->property + i;
        if (property->role == OTHER) {
            status = pass_over(file, property);
        } else if (property->role == CORNERS) {
            int n = 0;
            const size_t at = file->scan->at;
            status = read_corners(file, property, mesh->nvert, mesh->corner, &n);
            if (status == CN_OK && surface &&
                !cn_polygon_fan(surface->vert, n, mesh->corner, surface->tri + 3 * mesh->ntri))
                status = fail(file, CN_FAULT_UNREAD, at, "a face's count of corners", n,
                              "the polygon is neither flat nor convex; export triangles");
            mesh->ntri += n - 2;
            mesh->polygons += n > 3;
            if (n > mesh->most) mesh->most = n;
        } else {
            status = read_value(file, property->type, true, names[property->role],
                                surface->vert + 3 * row + property->role - X);
        }
        if (status != CN_OK) return status;
    }
    return file->ascii ? cn_scan_no_more(file->scan, "the row's properties") : CN_OK;
}

static cn_status read_rows(const ply *file, const ply_element *element, ply_mesh *mesh)
{
    cn_status status;
    for (int64_t row = 0; row < element->n; row++)
        if ((status = read_row(file, element, row, mesh)) != CN_OK) return status;
    return CN_OK;
}

/* A row's least bytes times their number must fit into what is left. */
static cn_status check_count(const ply *file, const ply_element *element)
{
    const cn_scan *scan = file->scan;
    double least = 0;

    for (int i = 0; i < element->nproperty; i++)
        least += file->ascii ? 2
                             : type_size[element->property[i].count ? element->property[i].count
                                                                    : element->property[i].type];
    if (element->nproperty == 0 && element->n > 0)
        return cn_scan_fail(scan, CN_FAULT_COUNT, "an element has no properties");
    if (least * (double)element->n <= (double)(scan->size - scan->at) + 1) return CN_OK;
    return cn_scan_fail(
        scan, CN_FAULT_CUT_SHORT,
        "the header declares %lld rows of at least %g bytes, but %zu bytes are left: the file is "
        "cut short",
        (long long)element->n, least, scan->size - scan->at);
}

/* Faces: counted in a first pass, then read. */
static cn_status read_faces(const ply *file, const ply_element *element, ply_mesh *mesh)
{
    cn_scan *scan = file->scan;
    const cn_scan start = *scan;
    cn_surface *surface = mesh->surface;
    cn_status status;

    mesh->surface = NULL;
    status = read_rows(file, element, mesh);
    mesh->surface = surface;
    if (status != CN_OK) return status;
    if (mesh->ntri > INT_MAX / 3) return CN_ERR_MEMORY;
    if ((status = cn_scan_room(scan, 24.0 * mesh->nvert + 12.0 * (double)mesh->ntri + 4.0 * mesh->most,
                               "the mesh")) != CN_OK)
        return status;
    free(surface->tri);
    surface->tri = cn_array((size_t)mesh->ntri, 3 * sizeof *surface->tri);
    mesh->corner = cn_array((size_t)mesh->most, sizeof *mesh->corner);
    if (!surface->tri || !mesh->corner) return CN_ERR_MEMORY;
    surface->ntri = (int)mesh->ntri;
    mesh->ntri = mesh->polygons = 0;
    *scan = start;
    return read_rows(file, element, mesh);
}

static cn_status check_roles(const ply *file)
{
    int vertices = 0, corners = 0;
    for (int e = 0; e < file->nelement; e++)
        for (int i = 0; i < file->element[e].nproperty; i++) {
            const ply_role role = file->element[e].property[i].role;
            vertices += role == X || role == Y || role == Z;
            corners += role == CORNERS;
            if (role == CORNERS && vertices < 3)
                return cn_scan_fail(file->scan, CN_FAULT_ORDER,
                                    "faces are declared before vertices: write the vertices first");
        }
    if (vertices != 3)
        return cn_scan_fail(file->scan, CN_FAULT_MISSING, "the header declares no vertices with x, y and z");
    if (corners != 1)
        return cn_scan_fail(file->scan, CN_FAULT_MISSING,
                            "the header declares no faces with a list vertex_indices");
    return CN_OK;
}

static cn_status read_body(const ply *file, ply_mesh *mesh)
{
    cn_scan *scan = file->scan;
    cn_status status;

    if ((status = check_roles(file)) != CN_OK) return status;
    for (int e = 0; e < file->nelement; e++) {
        const ply_element *element = file->element + e;
        if ((status = check_count(file, element)) != CN_OK) return status;
        if (element->kind == VERTEX) {
            if ((status = cn_scan_room(scan, 24.0 * (double)element->n, "the vertices")) != CN_OK)
                return status;
            mesh->nvert = (int)element->n;
            if ((status = cn_surface_new(&mesh->surface, mesh->nvert, 0)) != CN_OK) return status;
        }
        status = element->kind == FACE ? read_faces(file, element, mesh) : read_rows(file, element, mesh);
        if (status != CN_OK) return status;
    }
    if (file->ascii && cn_scan_line(scan)) return cn_scan_no_more(scan, "the last element");
    if (!file->ascii && scan->at < scan->size)
        return cn_scan_fail_at(scan, CN_FAULT_COUNT, scan->at,
                               "%zu bytes follow the last element: the header's counts are wrong",
                               scan->size - scan->at);
    return CN_OK;
}

cn_status cn_read_ply(cn_scan *scan, cn_surface **out)
{
    ply *file = calloc(1, sizeof *file);
    ply_mesh mesh = {0};
    cn_status status;

    if (!file) return CN_ERR_MEMORY;
    file->scan = scan;
    if ((status = read_header(file)) != CN_OK) goto done;
    if ((status = read_body(file, &mesh)) != CN_OK) goto done;
    if (mesh.polygons)
        CN_LOG(CN_LOG_INFO, "%s: %d polygons of more than 3 corners became fans", scan->path, mesh.polygons);
    *out = mesh.surface;
    mesh.surface = NULL;
done:
    cn_surface_free(mesh.surface);
    free(mesh.corner);
    free(file);
    return status;
}
