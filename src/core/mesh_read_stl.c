/* mesh_read_stl.c - STL. Binary: 80 bytes, a 32-bit count, 50 bytes a facet (normal, three corners, two bytes
 * of attribute), little-endian; it is known by its size, for binary files may begin with "solid" too. */
#include "mesh_read.h"

#include <limits.h>
#include <math.h>
#include <string.h>

enum { HEADER = 84, FACET = 50 };

static cn_status new_facets(cn_surface **out, size_t n)
{
    if (n > INT_MAX / 3) return CN_ERR_MEMORY;
    const cn_status status = cn_surface_new(out, 3 * (int)n, (int)n);
    for (int i = 0; status == CN_OK && i < 3 * (int)n; i++)
        (*out)->tri[i] = i;
    return status;
}

static cn_status read_binary(cn_scan *scan, cn_surface **out, size_t n)
{
    cn_surface *surface = NULL;
    cn_status status = new_facets(&surface, n);

    if (status != CN_OK) return status;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 12; k++) {
            const size_t at = HEADER + FACET * i + 4 * k;
            const double value = cn_scan_real(scan, (const unsigned char *)scan->data + at, 4);
            if (!isfinite(value)) {
                cn_surface_free(surface);
                return cn_scan_fail_at(scan, CN_FAULT_NUMBER, at,
                                       "%s %c of facet %zu is %g: a finite number is needed",
                                       k < 3 ? "normal" : "corner", "xyz"[k % 3], i, value);
            }
            if (k >= 3) surface->vert[9 * i + k - 3] = value;
        }
    *out = surface;
    return CN_OK;
}

/* One facet after its "facet" keyword. */
static cn_status read_facet(cn_scan *scan, double *vert)
{
    cn_status status;
    double normal;

    if ((status = cn_scan_word(scan, "normal")) != CN_OK) return status;
    for (int k = 0; k < 3; k++)
        if ((status = cn_scan_number(scan, "the facet's normal", &normal)) != CN_OK) return status;
    if ((status = cn_scan_no_more(scan, "the facet's normal")) != CN_OK) return status;
    if ((status = cn_scan_need_line(scan, "'outer loop'")) != CN_OK) return status;
    if ((status = cn_scan_word(scan, "outer")) != CN_OK) return status;
    if ((status = cn_scan_word(scan, "loop")) != CN_OK) return status;
    if ((status = cn_scan_no_more(scan, "'outer loop'")) != CN_OK) return status;
    for (int i = 0; i < 3; i++) {
        if ((status = cn_scan_need_line(scan, "a 'vertex' line")) != CN_OK) return status;
        if ((status = cn_scan_word(scan, "vertex")) != CN_OK) return status;
        for (int k = 0; k < 3; k++)
            if ((status = cn_scan_number(scan, "a vertex coordinate", vert + 3 * i + k)) != CN_OK)
                return status;
        if ((status = cn_scan_no_more(scan, "the vertex")) != CN_OK) return status;
    }
    if ((status = cn_scan_need_line(scan, "'endloop'")) != CN_OK) return status;
    if ((status = cn_scan_word(scan, "endloop")) != CN_OK) return status;
    if ((status = cn_scan_no_more(scan, "'endloop'")) != CN_OK) return status;
    if ((status = cn_scan_need_line(scan, "'endfacet'")) != CN_OK) return status;
    if ((status = cn_scan_word(scan, "endfacet")) != CN_OK) return status;
    return cn_scan_no_more(scan, "'endfacet'");
}

static cn_status read_ascii(cn_scan *scan, cn_surface **out)
{
    cn_surface *surface = NULL;
    const char *token;
    size_t length, n = 0, solids = 0;
    bool inside = false;
    cn_status status;

    while (cn_scan_line(scan)) /* how many facets at most */
        n += cn_scan_token(scan, &token, &length) && cn_scan_is(token, length, "facet");
    cn_scan_rewind(scan);
    if ((status = cn_scan_room(scan, 84.0 * (double)n, "its facets")) != CN_OK) return status;
    if ((status = new_facets(&surface, n)) != CN_OK) return status;
    for (n = 0; cn_scan_line(scan);) {
        if (!cn_scan_token(scan, &token, &length)) continue;
        if (inside && cn_scan_is(token, length, "facet")) {
            if ((status = read_facet(scan, surface->vert + 9 * n++)) != CN_OK) goto fail;
        } else if (cn_scan_is(token, length, inside ? "endsolid" : "solid")) {
            solids += !inside; /* the rest of the line is the solid's name */
            inside = !inside;
        } else {
            status =
                cn_scan_fail(scan, CN_FAULT_WORD, "'%s' stands where '%s' should",
                             cn_scan_quote(token, length).text, inside ? "facet' or 'endsolid" : "solid");
            goto fail;
        }
    }
    if (inside) {
        status = cn_scan_fail(scan, CN_FAULT_CUT_SHORT,
                              "the file ends before 'endsolid': it is cut short after %zu facets", n);
        goto fail;
    }
    if (solids > 1) CN_LOG(CN_LOG_INFO, "%s: %zu solids are read as one surface", scan->path, solids);
    *out = surface;
    return CN_OK;
fail:
    cn_surface_free(surface);
    return status;
}

cn_status cn_read_stl(cn_scan *scan, cn_surface **out)
{
    const unsigned char *bytes = (const unsigned char *)scan->data;
    const size_t n = scan->size >= HEADER ? (size_t)cn_scan_unsigned(scan, bytes + 80, 4) : 0;
    const char *token;
    size_t length;

    if (scan->size >= HEADER && scan->size == HEADER + FACET * n) return read_binary(scan, out, n);
    if (!memchr(scan->data, 0, scan->size) && cn_scan_line(scan) && cn_scan_token(scan, &token, &length)) {
        const bool ascii = cn_scan_is(token, length, "solid");
        if (ascii || scan->size < HEADER) {
            if (!ascii)
                return cn_scan_fail(scan, CN_FAULT_FORMAT,
                                    "'%s' stands where 'solid' should: the file is no STL",
                                    cn_scan_quote(token, length).text);
            cn_scan_rewind(scan);
            return read_ascii(scan, out);
        }
    }
    if (scan->size < HEADER)
        return cn_scan_fail_at(scan, CN_FAULT_CUT_SHORT, scan->size,
                               "the file ends within its header of %d bytes", HEADER);
    return cn_scan_fail_at(scan, scan->size < HEADER + FACET * n ? CN_FAULT_CUT_SHORT : CN_FAULT_COUNT, 80,
                           "binary STL says %zu facets, that is %zu bytes, but the file has %zu: it is %s", n,
                           HEADER + FACET * n, scan->size,
                           scan->size < HEADER + FACET * n ? "cut short" : "longer than it says");
}
