/* mesh_read_msh.c - Gmsh's .msh, versions 2.2 and 4.1, ASCII and binary: $Nodes and $Elements, every other
 * section skipped to its $End. Triangles make a surface, tetrahedra a body. */
#include "mesh_read.h"

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

typedef struct {
    int64_t tag;
    int index;
} tagged;

typedef struct {
    cn_scan *scan;
    bool binary, v4;
    int kept, corners; /* element type kept: 2 triangles, 4 tetrahedra; its corners */
    bool has_nodes, has_elements;
    int nnode;
    double *node;   /* (nnode x 3)                                             */
    tagged *by_tag; /* ascending tags (nnode)                                  */
    int nelement;   /* kept so far                                             */
    int *element;   /* node tags' indices (nelement x corners)                 */
    int64_t aside;  /* elements of other dimensions                            */
} msh;

static const struct {
    int type, dimension, nodes;
    const char *name;
} kinds[] = {{15, 0, 1, "point"},
             {1, 1, 2, "line"},
             {8, 1, 3, "line"},
             {26, 1, 4, "line"},
             {27, 1, 5, "line"},
             {28, 1, 6, "line"},
             {2, 2, 3, "triangle"},
             {3, 2, 4, "quadrangle"},
             {9, 2, 6, "6-node triangle"},
             {10, 2, 9, "quadrangle"},
             {16, 2, 8, "quadrangle"},
             {20, 2, 9, "9-node triangle"},
             {21, 2, 10, "10-node triangle"},
             {22, 2, 12, "12-node triangle"},
             {23, 2, 15, "15-node triangle"},
             {24, 2, 15, "15-node triangle"},
             {25, 2, 21, "21-node triangle"},
             {4, 3, 4, "tetrahedron"},
             {5, 3, 8, "hexahedron"},
             {6, 3, 6, "prism"},
             {7, 3, 5, "pyramid"},
             {11, 3, 10, "10-node tetrahedron"},
             {12, 3, 27, "hexahedron"},
             {13, 3, 18, "prism"},
             {14, 3, 14, "pyramid"},
             {17, 3, 20, "hexahedron"},
             {18, 3, 15, "prism"},
             {19, 3, 13, "pyramid"},
             {29, 3, 20, "20-node tetrahedron"},
             {30, 3, 35, "35-node tetrahedron"},
             {31, 3, 56, "56-node tetrahedron"},
             {92, 3, 64, "hexahedron"},
             {93, 3, 125, "hexahedron"}};

/* --- numbers, alike for text and binary --- */

static cn_status fail(const msh *file, int fault, size_t at, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
static cn_status fail(const msh *file, int fault, size_t at, const char *format, ...)
{
    char text[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return file->binary ? cn_scan_fail_at(file->scan, fault, at, "%s", text)
                        : cn_scan_fail(file->scan, fault, "%s", text);
}

/* A record is a line of text; in binary nothing marks it. */
static cn_status begin(msh *file, const char *what)
{
    return file->binary ? CN_OK : cn_scan_need_line(file->scan, what);
}
static cn_status end(msh *file, const char *what)
{
    return file->binary ? CN_OK : cn_scan_no_more(file->scan, what);
}

static cn_status get_integer(msh *file, int size, const char *what, int64_t low, int64_t high, int64_t *value)
{
    if (!file->binary) return cn_scan_integer(file->scan, what, low, high, value);
    const size_t at = file->scan->at;
    const unsigned char *bytes = cn_scan_bytes(file->scan, (size_t)size);
    if (!bytes)
        return cn_scan_fail_at(file->scan, CN_FAULT_CUT_SHORT, at, "the file ends within %s: it is cut short",
                               what);
    const uint64_t bits = cn_scan_unsigned(file->scan, bytes, size);
    *value = size == 4 ? (int64_t)(int32_t)bits : (int64_t)bits;
    if (*value >= low && *value <= high) return CN_OK;
    return cn_scan_fail_at(file->scan, CN_FAULT_RANGE, at, "%s is %lld: it must lie between %lld and %lld",
                           what, (long long)*value, (long long)low, (long long)high);
}

static cn_status get_number(msh *file, const char *what, double *value)
{
    if (!file->binary) return cn_scan_number(file->scan, what, value);
    const size_t at = file->scan->at;
    const unsigned char *bytes = cn_scan_bytes(file->scan, 8);
    if (!bytes)
        return cn_scan_fail_at(file->scan, CN_FAULT_CUT_SHORT, at, "the file ends within %s: it is cut short",
                               what);
    *value = cn_scan_real(file->scan, bytes, 8);
    if (isfinite(*value)) return CN_OK;
    return cn_scan_fail_at(file->scan, CN_FAULT_NUMBER, at, "%s is %g: a finite number is needed", what,
                           *value);
}

/* --- sections --- */

static cn_status read_format(msh *file)
{
    cn_scan *scan = file->scan;
    const char *token;
    size_t length;
    int64_t binary, size, one;
    cn_status status;

    if (!cn_scan_line(scan) || !cn_scan_token(scan, &token, &length) ||
        !cn_scan_is(token, length, "$MeshFormat"))
        return cn_scan_fail(scan, CN_FAULT_FORMAT,
                            "the file does not begin with $MeshFormat: it is no Gmsh .msh file");
    if ((status = cn_scan_need_line(scan, "the version")) != CN_OK) return status;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_FORMAT, "the version is missing");
    file->v4 = cn_scan_is(token, length, "4.1");
    if (!file->v4 && !cn_scan_is(token, length, "2.2"))
        return cn_scan_fail(scan, CN_FAULT_FORMAT, "version %s is not read: save as 4.1 or 2.2",
                            cn_scan_quote(token, length).text);
    if ((status = cn_scan_integer(scan, "the file type", 0, 1, &binary)) != CN_OK) return status;
    if ((status = cn_scan_integer(scan, "the data size", 8, 8, &size)) != CN_OK) return status;
    if ((status = cn_scan_no_more(scan, "the format")) != CN_OK) return status;
    if (binary) {
        file->binary = true;
        const size_t at = scan->at;
        if ((status = get_integer(file, 4, "the byte order's mark", INT32_MIN, INT32_MAX, &one)) != CN_OK)
            return status;
        scan->swap = one == 0x01000000;
        if (one != 1 && !scan->swap)
            return cn_scan_fail_at(scan, CN_FAULT_FORMAT, at, "the byte order's mark is %lld: 1 is needed",
                                   (long long)one);
    }
    if ((status = cn_scan_need_line(scan, "$EndMeshFormat")) != CN_OK) return status;
    return cn_scan_word(scan, "$EndMeshFormat");
}

/* Skips the section whose "$Name" stands at name (length with the $). */
static cn_status skip_section(msh *file, const char *name, size_t length)
{
    cn_scan *scan = file->scan;
    const char *p = scan->data + scan->at, *const stop = scan->data + scan->size;
    const int line = scan->line;

    for (; (p = memchr(p, '$', (size_t)(stop - p))); p++) {
        const char *after = p + length + 3;
        if (after > stop || memcmp(p, "$End", 4) || memcmp(p + 4, name + 1, length - 1)) continue;
        if (after < stop && !strchr(" \t\r\n", *after)) continue;
        break;
    }
    if (!p)
        return fail(file, CN_FAULT_CUT_SHORT, (size_t)(name - scan->data),
                    "the section %s that begins in line %d has no $End%s: the file "
                    "is cut short",
                    cn_scan_quote(name, length).text, line, cn_scan_quote(name + 1, length - 1).text);
    for (const char *q = scan->data + scan->at; q < p; q++)
        scan->line += *q == '\n';
    scan->at = (size_t)(p + length + 3 - scan->data);
    scan->cursor = scan->end = scan->data + scan->at;
    while (scan->at < scan->size && scan->data[scan->at] != '\n')
        scan->at++;
    if (scan->at < scan->size) scan->at++;
    scan->line++;
    return CN_OK;
}

static int by_tag(const void *a, const void *b)
{
    const int64_t ta = ((const tagged *)a)->tag, tb = ((const tagged *)b)->tag;
    return (ta > tb) - (ta < tb);
}

static cn_status read_coordinates(msh *file, int i, int parameters)
{
    double aside;
    cn_status status;

    for (int k = 0; k < 3; k++)
        if ((status = get_number(file, "a node coordinate", file->node + 3 * (size_t)i + k)) != CN_OK)
            return status;
    for (int k = 0; k < parameters; k++)
        if ((status = get_number(file, "a node's parameter", &aside)) != CN_OK) return status;
    return end(file, "the node");
}

static cn_status read_node_blocks(msh *file, int64_t blocks)
{
    cn_status status;
    int done = 0;

    for (int64_t b = 0; b < blocks; b++) {
        int64_t dimension, entity, parametric, n, tag;
        if ((status = begin(file, "a block of nodes")) != CN_OK) return status;
        if ((status = get_integer(file, 4, "the block's dimension", 0, 3, &dimension)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the block's entity", INT32_MIN, INT32_MAX, &entity)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the block's parametric flag", 0, 1, &parametric)) != CN_OK)
            return status;
        if ((status = get_integer(file, 8, "the block's number of nodes", 0, file->nnode - done, &n)) !=
            CN_OK)
            return status;
        if ((status = end(file, "the block's counts")) != CN_OK) return status;
        for (int i = 0; i < (int)n; i++) {
            if ((status = begin(file, "a node's number")) != CN_OK) return status;
            if ((status = get_integer(file, 8, "a node's number", 0, INT64_MAX, &tag)) != CN_OK)
                return status;
            if ((status = end(file, "the node's number")) != CN_OK) return status;
            file->by_tag[done + i] = (tagged){tag, done + i};
        }
        for (int i = 0; i < (int)n; i++) {
            if ((status = begin(file, "a node's coordinates")) != CN_OK) return status;
            if ((status = read_coordinates(file, done + i, parametric ? (int)dimension : 0)) != CN_OK)
                return status;
        }
        done += (int)n;
    }
    if (done == file->nnode) return CN_OK;
    return fail(file, CN_FAULT_COUNT, file->scan->at, "the blocks hold %d nodes, the section says %d", done,
                file->nnode);
}

static cn_status read_node_lines(msh *file)
{
    cn_status status;
    int64_t tag;

    for (int i = 0; i < file->nnode; i++) {
        if ((status = begin(file, "a node")) != CN_OK) return status;
        if ((status = get_integer(file, 4, "a node's number", 0, INT32_MAX, &tag)) != CN_OK) return status;
        file->by_tag[i] = (tagged){tag, i};
        if ((status = read_coordinates(file, i, 0)) != CN_OK) return status;
    }
    return CN_OK;
}

/* Version 2.2: one number, always text. Version 4.1: blocks, count, least and greatest tag. An item takes at
 * least `least` bytes. */
static cn_status read_counts(msh *file, const char *what, size_t least, int64_t *blocks, int64_t *n)
{
    cn_scan *scan = file->scan;
    const int64_t most = (int64_t)((scan->size - scan->at) / least + 1);
    int64_t tag;
    cn_status status;

    if (!file->v4) {
        if ((status = cn_scan_need_line(scan, what)) != CN_OK) return status;
        if ((status = cn_scan_integer(scan, what, 0, INT_MAX / 4, n)) != CN_OK) return status;
        if ((status = cn_scan_no_more(scan, what)) != CN_OK) return status;
    } else {
        if ((status = begin(file, what)) != CN_OK) return status;
        if ((status = get_integer(file, 8, "the number of blocks", 0, INT64_MAX, blocks)) != CN_OK)
            return status;
        if ((status = get_integer(file, 8, what, 0, INT_MAX / 4, n)) != CN_OK) return status;
        for (int i = 0; i < 2; i++)
            if ((status = get_integer(file, 8, "the least or greatest number", 0, INT64_MAX, &tag)) != CN_OK)
                return status;
        if ((status = end(file, "the section's counts")) != CN_OK) return status;
    }
    if (*n <= most) return CN_OK;
    return fail(file, CN_FAULT_CUT_SHORT, scan->at,
                "%s is %lld, but only %zu bytes follow: the file is cut short", what, (long long)*n,
                scan->size - scan->at);
}

static cn_status read_nodes(msh *file)
{
    int64_t blocks = 0, n = 0;
    cn_status status;

    if (file->has_nodes)
        return fail(file, CN_FAULT_TWICE, file->scan->at, "a second $Nodes section follows: keep one");
    file->has_nodes = true;
    if ((status = read_counts(file, "the number of nodes", 8, &blocks, &n)) != CN_OK) return status;
    file->nnode = (int)n;
    file->node = cn_array((size_t)n, 3 * sizeof *file->node);
    file->by_tag = cn_array((size_t)n, sizeof *file->by_tag);
    if (!file->node || !file->by_tag) return CN_ERR_MEMORY;
    if ((status = file->v4 ? read_node_blocks(file, blocks) : read_node_lines(file)) != CN_OK) return status;
    bool ascending = true;
    for (int i = 1; i < file->nnode; i++)
        ascending = ascending && file->by_tag[i - 1].tag < file->by_tag[i].tag;
    if (!ascending) qsort(file->by_tag, (size_t)n, sizeof *file->by_tag, by_tag);
    for (int i = 1; i < file->nnode; i++)
        if (file->by_tag[i - 1].tag == file->by_tag[i].tag)
            return fail(file, CN_FAULT_TWICE, file->scan->at, "two nodes have the number %lld: renumber them",
                        (long long)file->by_tag[i].tag);
    return CN_OK;
}

static int find_node(const msh *file, int64_t tag)
{
    int low = 0, high = file->nnode;
    if (file->nnode > 0 && tag >= file->by_tag[0].tag && tag - file->by_tag[0].tag < file->nnode) {
        const tagged *guess =
            file->by_tag + (tag - file->by_tag[0].tag); /* numbered without gaps: found at once */
        if (guess->tag == tag) return guess->index;
    }
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (file->by_tag[middle].tag < tag)
            low = middle + 1;
        else
            high = middle;
    }
    return low < file->nnode && file->by_tag[low].tag == tag ? file->by_tag[low].index : -1;
}

/* Looks an element type up; *nodes of one, *keep whether it is kept. */
static cn_status judge_type(const msh *file, int64_t type, int *nodes, bool *keep)
{
    const int dimension = file->kept == 2 ? 2 : 3;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        if (kinds[i].type != type) continue;
        *nodes = kinds[i].nodes;
        *keep = type == file->kept;
        if (*keep || kinds[i].dimension != dimension) return CN_OK;
        return fail(file, CN_FAULT_UNREAD, file->scan->at,
                    "an element is a %s (type %lld): only 3-node triangles and 4-node "
                    "tetrahedra are read; remesh or save first order",
                    kinds[i].name, (long long)type);
    }
    return fail(file, CN_FAULT_UNREAD, file->scan->at, "an element has the unknown type %lld",
                (long long)type);
}

static cn_status read_corners(msh *file, int nodes, bool keep)
{
    const int tag_size = file->v4 ? 8 : 4;
    cn_status status;

    for (int k = 0; k < nodes; k++) {
        const size_t at = file->scan->at;
        int64_t tag;
        if ((status = get_integer(file, tag_size, "an element's node", 0, INT64_MAX, &tag)) != CN_OK)
            return status;
        if (!keep) continue;
        const int index = find_node(file, tag);
        if (index < 0)
            return fail(file, CN_FAULT_INDEX, at, "the element names node %lld, which $Nodes does not have",
                        (long long)tag);
        file->element[(size_t)file->nelement * file->corners + k] = index;
    }
    file->nelement += keep;
    file->aside += !keep;
    return end(file, "the element's nodes");
}

static cn_status read_element_blocks(msh *file, int64_t blocks, int64_t total)
{
    cn_status status;
    int64_t done = 0;

    for (int64_t b = 0; b < blocks; b++) {
        int64_t dimension, entity, type, n, tag;
        int nodes = 0;
        bool keep = false;
        if ((status = begin(file, "a block of elements")) != CN_OK) return status;
        if ((status = get_integer(file, 4, "the block's dimension", 0, 3, &dimension)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the block's entity", INT32_MIN, INT32_MAX, &entity)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the element type", 1, INT32_MAX, &type)) != CN_OK) return status;
        if ((status = get_integer(file, 8, "the block's number of elements", 0, total - done, &n)) != CN_OK)
            return status;
        if ((status = end(file, "the block's counts")) != CN_OK) return status;
        if ((status = judge_type(file, type, &nodes, &keep)) != CN_OK) return status;
        for (int64_t i = 0; i < n; i++) {
            if ((status = begin(file, "an element")) != CN_OK) return status;
            if ((status = get_integer(file, 8, "an element's number", 0, INT64_MAX, &tag)) != CN_OK)
                return status;
            if ((status = read_corners(file, nodes, keep)) != CN_OK) return status;
        }
        done += n;
    }
    if (done == total) return CN_OK;
    return fail(file, CN_FAULT_COUNT, file->scan->at, "the blocks hold %lld elements, the section says %lld",
                (long long)done, (long long)total);
}

/* Version 2.2. Text: number type tags. Binary: type, how many follow, tags; then number, tags, nodes of each.
 */
static cn_status read_element_lines(msh *file, int64_t total)
{
    cn_status status;

    for (int64_t done = 0; done < total;) {
        int64_t type, n = 1, ntag, value;
        int nodes = 0;
        bool keep = false;
        if ((status = begin(file, "an element")) != CN_OK) return status;
        if (!file->binary &&
            (status = get_integer(file, 4, "an element's number", 0, INT32_MAX, &value)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the element type", 1, INT32_MAX, &type)) != CN_OK) return status;
        if (file->binary && (status = get_integer(file, 4, "the number of elements that follow", 1,
                                                  total - done, &n)) != CN_OK)
            return status;
        if ((status = get_integer(file, 4, "the number of tags", 0, 1000, &ntag)) != CN_OK) return status;
        if ((status = judge_type(file, type, &nodes, &keep)) != CN_OK) return status;
        for (int64_t i = 0; i < n; i++) {
            for (int64_t k = file->binary ? -1 : 0; k < ntag; k++)
                if ((status = get_integer(file, 4, "an element's number or tag", INT32_MIN, INT32_MAX,
                                          &value)) != CN_OK)
                    return status;
            if ((status = read_corners(file, nodes, keep)) != CN_OK) return status;
        }
        done += n;
    }
    return CN_OK;
}

static cn_status read_elements(msh *file)
{
    int64_t blocks = 0, n = 0;
    cn_status status;

    if (file->has_elements)
        return fail(file, CN_FAULT_TWICE, file->scan->at, "a second $Elements section follows: keep one");
    if (!file->has_nodes) return fail(file, CN_FAULT_ORDER, file->scan->at, "$Elements stands before $Nodes");
    file->has_elements = true;
    if ((status = read_counts(file, "the number of elements", 4, &blocks, &n)) != CN_OK) return status;
    if (!(file->element = cn_array((size_t)n, (size_t)file->corners * sizeof *file->element)))
        return CN_ERR_MEMORY;
    return file->v4 ? read_element_blocks(file, blocks, n) : read_element_lines(file, n);
}

static cn_status read_sections(msh *file)
{
    cn_scan *scan = file->scan;
    const char *token;
    size_t length;
    cn_status status = read_format(file);

    while (status == CN_OK && cn_scan_line(scan)) {
        if (!cn_scan_token(scan, &token, &length)) continue;
        const bool nodes = cn_scan_is(token, length, "$Nodes"),
                   elements = cn_scan_is(token, length, "$Elements");
        if (length < 2 || *token != '$' || !strncmp(token, "$End", 4))
            return fail(file, CN_FAULT_WORD, (size_t)(token - scan->data),
                        "'%s' stands where a section should begin with $Name",
                        cn_scan_quote(token, length).text);
        if (!nodes && !elements) {
            status = skip_section(file, token, length);
            continue;
        }
        if ((status = nodes ? read_nodes(file) : read_elements(file)) != CN_OK) return status;
        if ((status = cn_scan_need_line(scan, nodes ? "$EndNodes" : "$EndElements")) != CN_OK) return status;
        status = cn_scan_word(scan, nodes ? "$EndNodes" : "$EndElements");
    }
    if (status != CN_OK) return status;
    if (!file->has_nodes || !file->has_elements)
        return fail(file, CN_FAULT_MISSING, scan->size, "the file has no $%s section",
                    file->has_nodes ? "Elements" : "Nodes");
    return CN_OK;
}

cn_status cn_read_msh(cn_scan *scan, cn_surface **surface, cn_tets **tets)
{
    msh file = {.scan = scan, .kept = surface ? 2 : 4, .corners = surface ? 3 : 4};
    cn_surface *triangles = NULL;
    cn_tets *body = NULL;
    cn_status status;

    if ((status = read_sections(&file)) != CN_OK) goto done;
    if (file.nelement == 0) {
        scan->line = 0;
        status = cn_scan_fail(scan, CN_FAULT_NO_MESH,
                              "holds no %s (%lld elements of other kinds): a %s is needed here",
                              surface ? "triangles" : "tetrahedra", (long long)file.aside,
                              surface ? "surface mesh" : "volume mesh");
        goto done;
    }
    if ((status = surface ? cn_surface_new(&triangles, 0, 0) : cn_tets_new(&body, 0, 0)) != CN_OK) goto done;
    if (file.aside)
        CN_LOG(CN_LOG_INFO, "%s: %lld elements of other kinds than %s are left aside", scan->path,
               (long long)file.aside, surface ? "triangles" : "tetrahedra");
    if (surface) {
        free(triangles->vert), free(triangles->tri);
        *triangles = (cn_surface){file.nnode, file.nelement, file.node, file.element};
        *surface = triangles;
    } else {
        free(body->node), free(body->tet);
        *body = (cn_tets){file.nnode, file.nelement, file.node, file.element, NULL};
        *tets = body;
    }
    file.node = NULL;
    file.element = NULL;
done:
    free(file.node);
    free(file.by_tag);
    free(file.element);
    return status;
}
