/* mesh_read_obj.c - Wavefront OBJ: v and f. Texture and normal references are checked for form and left
 * aside, names and materials too; lines and points are counted; curves and surfaces are refused. */
#include "mesh_read.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

static const char *const skipped[] = {
    "vt",     "vn",  "vp",     "g",     "group", "o", "s",        "mg",       "usemtl",     "usemap",
    "mtllib", "lod", "maplib", "bevel", "l",     "p", "c_interp", "d_interp", "shadow_obj", "trace_obj"};

static bool is_skipped(const char *token, size_t length)
{
    for (size_t i = 0; i < sizeof skipped / sizeof *skipped; i++)
        if (cn_scan_is(token, length, skipped[i])) return true;
    return false;
}

static int count_tokens(cn_scan *scan)
{
    const char *token;
    size_t length;
    int n = 0;
    while (cn_scan_token(scan, &token, &length))
        n++;
    return n;
}

/* "i", "i/t", "i//n", "i/t/n"; i counts from 1, or back from -1. */
static cn_status read_corner(cn_scan *scan, const char *token, size_t length, int nvert, int seen,
                             int *corner)
{
    const char *part[3] = {token, NULL, NULL};
    size_t part_length[3] = {0, 0, 0};
    int parts = 1;
    int64_t index, other;

    for (size_t i = 0; i < length; i++) {
        if (token[i] != '/') {
            part_length[parts - 1]++;
        } else {
            if (parts == 3) goto malformed;
            part[parts++] = token + i + 1;
        }
    }
    if (!cn_parse_integer(part[0], part_length[0], &index)) goto malformed;
    for (int k = 1; k < parts; k++) {
        if (part_length[k] == 0 && k == 1 && parts == 3) continue;
        if (!cn_parse_integer(part[k], part_length[k], &other)) goto malformed;
    }
    if (index < 0 ? -index > seen : index < 1 || index > nvert)
        return cn_scan_fail(scan, CN_FAULT_INDEX, "the face names vertex %lld, but %s %d: correct the index",
                            (long long)index,
                            index < 0 ? "the vertices before it number" : "vertices run from 1 to",
                            index < 0 ? seen : nvert);
    *corner = (int)(index < 0 ? seen + index : index - 1);
    return CN_OK;
malformed:
    return cn_scan_fail(scan, CN_FAULT_WORD,
                        "'%s' is no face corner: one of v, v/vt, v//vn, v/vt/vn is needed",
                        cn_scan_quote(token, length).text);
}

static cn_status read_vertex(cn_scan *scan, double *x)
{
    cn_status status;
    const char *cursor = scan->cursor;
    const int n = count_tokens(scan);
    double rest;

    scan->cursor = cursor;
    if (n > 3 && n != 4 && n != 6 && n != 7)
        return cn_scan_fail(scan, CN_FAULT_COUNT,
                            "the vertex has %d numbers: x y z, then at most w or a colour, are needed", n);
    for (int k = 0; k < 3; k++)
        if ((status = cn_scan_number(scan, "a vertex coordinate", x + k)) != CN_OK) return status;
    for (int k = 3; k < n; k++) {
        if ((status = cn_scan_number(scan, "the vertex's weight or colour", &rest)) != CN_OK) return status;
        if (n == 4 && rest != 1)
            return cn_scan_fail(scan, CN_FAULT_UNREAD, "the vertex has weight %g: only 1 is read", rest);
    }
    return CN_OK;
}

static cn_status read_face(cn_scan *scan, cn_surface *surface, int seen, int *corner, int *polygons)
{
    const char *token;
    size_t length;
    int n = 0;
    cn_status status;

    while (cn_scan_token(scan, &token, &length))
        if ((status = read_corner(scan, token, length, surface->nvert, seen, corner + n++)) != CN_OK)
            return status;
    if (n < 3)
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the face has %d corner%s: at least 3 are needed", n,
                            n == 1 ? "" : "s");
    if (!cn_polygon_fan(surface->vert, n, corner, surface->tri + 3 * (size_t)surface->ntri))
        return cn_scan_fail(scan, CN_FAULT_UNREAD,
                            "the face of %d corners is neither flat nor convex: export it as triangles", n);
    surface->ntri += n - 2;
    *polygons += n > 3;
    return CN_OK;
}

cn_status cn_read_obj(cn_scan *scan, cn_surface **out)
{
    cn_surface *surface = NULL;
    int *corner = NULL;
    const char *token;
    size_t length, nvert = 0, ntri = 0;
    int most = 0, seen = 0, aside = 0, polygons = 0;
    cn_status status = CN_OK;

    scan->comment = '#';
    while (cn_scan_line(scan)) { /* counts */
        if (!cn_scan_token(scan, &token, &length)) continue;
        if (cn_scan_is(token, length, "v")) {
            nvert++;
        } else if (cn_scan_is(token, length, "f")) {
            const int n = count_tokens(scan);
            ntri += n > 3 ? (size_t)n - 2 : 1;
            if (n > most) most = n;
        } else if (!is_skipped(token, length)) {
            return cn_scan_fail(scan, CN_FAULT_WORD,
                                "'%s' is not read (only vertices v and faces f make a surface): remove the "
                                "line, or export triangles",
                                cn_scan_quote(token, length).text);
        } else {
            aside += cn_scan_is(token, length, "l") || cn_scan_is(token, length, "p");
        }
    }
    if (nvert > INT_MAX / 3 || ntri > INT_MAX / 3) return CN_ERR_MEMORY;
    if ((status = cn_scan_room(scan, 24.0 * (double)nvert + 12.0 * (double)ntri + 4.0 * most, "its faces")) !=
        CN_OK)
        return status;
    if (!(corner = cn_array((size_t)most, sizeof *corner))) return CN_ERR_MEMORY;
    if ((status = cn_surface_new(&surface, (int)nvert, (int)ntri)) != CN_OK) goto done;
    for (cn_scan_rewind(scan); cn_scan_line(scan);) /* vertices */
        if (cn_scan_token(scan, &token, &length) && cn_scan_is(token, length, "v"))
            if ((status = read_vertex(scan, surface->vert + 3 * (size_t)seen++)) != CN_OK) goto done;
    seen = surface->ntri = 0;
    for (cn_scan_rewind(scan); cn_scan_line(scan);) { /* faces, which may look back */
        if (!cn_scan_token(scan, &token, &length)) continue;
        if (cn_scan_is(token, length, "v"))
            seen++;
        else if (cn_scan_is(token, length, "f"))
            if ((status = read_face(scan, surface, seen, corner, &polygons)) != CN_OK) goto done;
    }
    if (polygons)
        CN_LOG(CN_LOG_INFO, "%s: %d polygons of more than 3 corners became fans", scan->path, polygons);
    if (aside) CN_LOG(CN_LOG_WARNING, "%s: %d lines and points are left aside", scan->path, aside);
    *out = surface;
    surface = NULL;
done:
    cn_surface_free(surface);
    free(corner);
    return status;
}
