/* mesh_read.c - which reader a file goes to, and the line and number scanner they share. */
#define _GNU_SOURCE /* strtod_l */
#include "mesh_read.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "catnav/vec3.h"

/* --- the file --- */

static cn_status load(cn_scan *scan, int fd)
{
    struct stat info;

    if (fstat(fd, &info))
        return cn_fail(scan->error, cn_fault_file(errno), scan->path, 0, "cannot be read: %s",
                       strerror(errno));
    if (!S_ISREG(info.st_mode))
        return cn_fail(scan->error, CN_FAULT_NO_FILE, scan->path, 0,
                       "is not a regular file: name a mesh file");
    if (info.st_size == 0) return cn_fail(scan->error, CN_FAULT_EMPTY, scan->path, 0, "is empty (0 bytes)");
    if (info.st_size > INT_MAX)
        return cn_fail(scan->error, CN_FAULT_LARGE, scan->path, 0, "has %lld bytes: at most %d are read",
                       (long long)info.st_size, INT_MAX);
    if (!(scan->data = malloc((size_t)info.st_size + 1)))
        return cn_fail(scan->error, CN_ERR_MEMORY, scan->path, 0, "out of memory: the file has %lld bytes",
                       (long long)info.st_size);
    while (scan->size < (size_t)info.st_size) {
        const ssize_t n = read(fd, scan->data + scan->size, (size_t)info.st_size - scan->size);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0)
            return cn_fail(scan->error, cn_fault_file(errno), scan->path, 0, "cannot be read: %s",
                           strerror(errno));
        if (n == 0) break; /* it shrank meanwhile: judged by what is there */
        scan->size += (size_t)n;
    }
    scan->data[scan->size] = 0;
    cn_scan_rewind(scan);
    return CN_OK;
}

cn_status cn_scan_open(cn_scan *scan, const char *path, cn_error *error)
{
    memset(scan, 0, sizeof *scan);
    scan->path = path;
    scan->error = error;
    if (!(scan->c = newlocale(LC_ALL_MASK, "C", (locale_t)0)))
        return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory");
    const int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) return cn_fail(error, cn_fault_file(errno), path, 0, "cannot be opened: %s", strerror(errno));
    const cn_status status = load(scan, fd);
    close(fd);
    return status;
}

void cn_scan_close(cn_scan *scan)
{
    free(scan->data);
    scan->data = NULL;
    if (scan->c) freelocale(scan->c);
    scan->c = (locale_t)0;
}

void cn_scan_rewind(cn_scan *scan)
{
    scan->at = 0;
    scan->line = 0;
    scan->cursor = scan->end = scan->data;
}

cn_status cn_scan_fail(const cn_scan *scan, int fault, const char *format, ...)
{
    char text[sizeof((cn_error *)0)->message];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return cn_fail(scan->error, fault, scan->path, scan->line, "%s", text);
}

cn_status cn_scan_fail_at(const cn_scan *scan, int fault, size_t at, const char *format, ...)
{
    char text[sizeof((cn_error *)0)->message - 32];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return cn_fail(scan->error, fault, scan->path, 0, "byte %zu: %s", at, text);
}

cn_quote cn_scan_quote(const char *token, size_t length)
{
    cn_quote quote;
    size_t n = 0;
    for (; n < length && n < 40; n++)
        quote.text[n] = token[n] >= 32 && token[n] < 127 ? token[n] : '?';
    memcpy(quote.text + n, length > 40 ? "..." : "", length > 40 ? 4 : 1);
    return quote;
}

cn_status cn_scan_room(const cn_scan *scan, double bytes, const char *what)
{
    if (bytes <= 8.0 * (double)scan->size + 12.0 * 1048576) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_COUNT,
                        "%s would need %.0f bytes, but the file has only %zu: its counts are wrong, or it "
                        "repeats itself",
                        what, bytes, scan->size);
}

/* --- lines and tokens --- */

static bool blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

bool cn_scan_line(cn_scan *scan)
{
    while (scan->at < scan->size) {
        const char *start = scan->data + scan->at;
        const char *stop = memchr(start, '\n', scan->size - scan->at);
        if (!stop) stop = scan->data + scan->size;
        scan->at = (size_t)(stop - scan->data) + (stop < scan->data + scan->size);
        scan->line++;
        if (scan->comment) {
            const char *mark = memchr(start, scan->comment, (size_t)(stop - start));
            if (mark) stop = mark;
        }
        while (start < stop && blank(*start))
            start++;
        scan->cursor = start;
        scan->end = stop;
        if (start < stop) return true;
    }
    scan->cursor = scan->end = scan->data + scan->size;
    return false;
}

cn_status cn_scan_need_line(cn_scan *scan, const char *what)
{
    if (cn_scan_line(scan)) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_CUT_SHORT, "the file ends where %s should follow: it is cut short",
                        what);
}

bool cn_scan_token(cn_scan *scan, const char **token, size_t *length)
{
    const char *p = scan->cursor;
    while (p < scan->end && blank(*p))
        p++;
    *token = p;
    while (p < scan->end && !blank(*p))
        p++;
    *length = (size_t)(p - *token);
    scan->cursor = p;
    return *length > 0;
}

bool cn_scan_is(const char *token, size_t length, const char *word)
{
    return strlen(word) == length && !strncasecmp(token, word, length);
}

cn_status cn_scan_word(cn_scan *scan, const char *word)
{
    const char *token;
    size_t length;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the line ends where '%s' should stand", word);
    if (cn_scan_is(token, length, word)) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_WORD, "'%s' stands where '%s' should",
                        cn_scan_quote(token, length).text, word);
}

cn_status cn_scan_no_more(cn_scan *scan, const char *what)
{
    const char *token;
    size_t length;
    if (!cn_scan_token(scan, &token, &length)) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_COUNT, "'%s' follows %s: remove it, or check the counts before",
                        cn_scan_quote(token, length).text, what);
}

/* --- numbers --- */

static bool digit(char c)
{
    return c >= '0' && c <= '9';
}

/* [+-] digits [. digits] [e [+-] digits], all of it: no nan, inf, hex, comma or rest. Exact for up to 15
 * digits and small exponents (both are doubles, one rounding), else strtod in the C locale. */
static bool parse_number(const char *token, size_t length, locale_t c, double *value)
{
    static const double power[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                   1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const char *p = token, *const end = token + length;
    const bool negative = p < end && *p == '-';
    uint64_t mantissa = 0;
    int digits = 0, significant = 0, exponent = 0, written = 0;

    if (p < end && (*p == '+' || *p == '-')) p++;
    for (bool fraction = false; p < end && (digit(*p) || (*p == '.' && !fraction)); p++) {
        if (*p == '.') {
            fraction = true;
            continue;
        }
        digits++;
        if (significant || *p != '0') significant++;
        if (significant <= 18) mantissa = 10 * mantissa + (uint64_t)(*p - '0');
        exponent -= fraction;
    }
    if (!digits) return false;
    if (p < end && (*p == 'e' || *p == 'E')) {
        p++;
        const bool minus = p < end && *p == '-';
        if (p < end && (*p == '+' || *p == '-')) p++;
        if (p == end) return false;
        for (; p < end && digit(*p); p++)
            if (written < 100000) written = 10 * written + (*p - '0');
        exponent += minus ? -written : written;
    }
    if (p != end) return false;
    if (significant <= 15 && exponent >= -22 && exponent <= 22) {
        const double m = (double)mantissa;
        const double magnitude = exponent < 0 ? m / power[-exponent] : m * power[exponent];
        *value = negative ? -magnitude : magnitude;
        return true;
    }
    *value = strtod_l(token, NULL, c); /* the token ends at a blank, a line's end or the file's NUL */
    return isfinite(*value);
}

cn_status cn_scan_number(cn_scan *scan, const char *what, double *value)
{
    const char *token;
    size_t length;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the line ends where %s should stand", what);
    if (parse_number(token, length, scan->c, value)) return CN_OK;
    const cn_quote quote = cn_scan_quote(token, length);
    return cn_scan_fail(scan, cn_fault_number(quote.text), "%s is '%s': a finite decimal number is needed",
                        what, quote.text);
}

bool cn_parse_integer(const char *token, size_t length, int64_t *value)
{
    const bool negative = length > 0 && token[0] == '-';
    size_t i = length > 0 && (token[0] == '-' || token[0] == '+');
    int64_t sum = 0;

    if (i == length) return false;
    for (; i < length; i++) {
        if (!digit(token[i]) || sum > (INT64_MAX - 9) / 10) return false;
        sum = 10 * sum + (token[i] - '0');
    }
    *value = negative ? -sum : sum;
    return true;
}

cn_status cn_scan_integer(cn_scan *scan, const char *what, int64_t low, int64_t high, int64_t *value)
{
    const char *token;
    size_t length;
    if (!cn_scan_token(scan, &token, &length))
        return cn_scan_fail(scan, CN_FAULT_COUNT, "the line ends where %s should stand", what);
    if (!cn_parse_integer(token, length, value))
        return cn_scan_fail(scan, CN_FAULT_TYPE, "%s is '%s': a whole number is needed", what,
                            cn_scan_quote(token, length).text);
    if (*value >= low && *value <= high) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_RANGE, "%s is %lld: it must lie between %lld and %lld", what,
                        (long long)*value, (long long)low, (long long)high);
}

/* --- binary --- */

const unsigned char *cn_scan_bytes(cn_scan *scan, size_t n)
{
    if (n > scan->size - scan->at) return NULL;
    scan->at += n;
    return (const unsigned char *)scan->data + scan->at - n;
}

uint64_t cn_scan_unsigned(const cn_scan *scan, const unsigned char *bytes, int size)
{
    uint64_t value = 0;
    for (int i = 0; i < size; i++) /* least significant byte first unless swapped */
        value |= (uint64_t)bytes[scan->swap ? size - 1 - i : i] << 8 * i;
    return value;
}

double cn_scan_real(const cn_scan *scan, const unsigned char *bytes, int size)
{
    const uint64_t bits = cn_scan_unsigned(scan, bytes, size);
    const uint32_t half = (uint32_t)bits;
    double value;
    float single;
    memcpy(&value, &bits, sizeof value);
    memcpy(&single, &half, sizeof single);
    return size == 4 ? (double)single : value;
}

/* --- polygons --- */

bool cn_polygon_fan(const double *vert, int n, const int *corner, int *tri)
{
    double area[3] = {0, 0, 0};
    int apex = 0;

    for (int i = 1; i + 1 < n; i++) { /* the polygon's area vector, twice */
        double u[3], v[3], w[3];
        cn_sub(vert + 3 * (size_t)corner[i], vert + 3 * (size_t)corner[0], u);
        cn_sub(vert + 3 * (size_t)corner[i + 1], vert + 3 * (size_t)corner[0], v);
        cn_cross(u, v, w);
        cn_add(area, w, area);
    }
    for (; apex < n && n > 3; apex++) { /* a few corners decide: a hostile polygon must not take O(n^2) */
        if (apex == 64) return false;
        int seen = 0;
        for (int i = 1; i + 1 < n; i++) {
            double u[3], v[3], w[3];
            cn_sub(vert + 3 * (size_t)corner[(apex + i) % n], vert + 3 * (size_t)corner[apex], u);
            cn_sub(vert + 3 * (size_t)corner[(apex + i + 1) % n], vert + 3 * (size_t)corner[apex], v);
            cn_cross(u, v, w);
            seen += cn_dot(w, area) > 0;
        }
        if (seen == n - 2) break;
    }
    if (apex == n) return false;
    for (int i = 1; i + 1 < n; i++) {
        tri[3 * (i - 1)] = corner[apex];
        tri[3 * (i - 1) + 1] = corner[(apex + i) % n];
        tri[3 * (i - 1) + 2] = corner[(apex + i + 1) % n];
    }
    return true;
}

/* --- which reader --- */

static bool extension_is(const char *path, const char *extension)
{
    const size_t n = strlen(path), m = strlen(extension);
    return n > m && !strcasecmp(path + n - m, extension);
}

cn_status cn_surface_read(cn_surface **out, const char *path, cn_error *error)
{
    cn_scan scan = {0};
    cn_surface *surface = NULL;
    cn_status status;

    if (extension_is(path, ".node") || extension_is(path, ".ele"))
        return cn_fail(error, CN_FAULT_FORMAT, path, 0,
                       "holds tetrahedra where a surface is needed: "
                       "give a .stl, .obj, .ply or .msh file");
    if (!extension_is(path, ".stl") && !extension_is(path, ".obj") && !extension_is(path, ".ply") &&
        !extension_is(path, ".msh"))
        return cn_fail(error, CN_FAULT_FORMAT, path, 0,
                       "has no extension that is read as a surface: .stl, .obj, .ply and .msh are (unpack "
                       "compressed files first)");
    if ((status = cn_scan_open(&scan, path, error)) != CN_OK) goto done;
    if (extension_is(path, ".stl")) status = cn_read_stl(&scan, &surface);
    if (extension_is(path, ".obj")) status = cn_read_obj(&scan, &surface);
    if (extension_is(path, ".ply")) status = cn_read_ply(&scan, &surface);
    if (extension_is(path, ".msh")) status = cn_read_msh(&scan, &surface, NULL);
    if (status == CN_OK && surface->ntri == 0) {
        scan.line = 0;
        status =
            cn_scan_fail(&scan, CN_FAULT_NO_MESH,
                         "holds no triangles (%d vertices): export the surface as triangles", surface->nvert);
    }
    if (status == CN_OK) {
        *out = surface;
        surface = NULL;
    }
    if (status == CN_ERR_MEMORY)
        cn_fail(error, status, path, 0, "out of memory reading %zu bytes", scan.size);
done:
    cn_surface_free(surface);
    cn_scan_close(&scan);
    return status;
}

/* x.node beside x.ele and the reverse; the caller frees. */
static char *beside(const char *path, const char *extension)
{
    const size_t stem = (size_t)(strrchr(path, '.') - path);
    char *other = malloc(stem + strlen(extension) + 1);
    if (!other) return NULL;
    memcpy(other, path, stem);
    strcpy(other + stem, extension);
    return other;
}

static cn_status read_pair(cn_tets **out, const char *path, cn_error *error)
{
    cn_scan node = {0}, ele = {0};
    const bool given_node = extension_is(path, ".node");
    const bool upper = path[strlen(path) - 1] == 'E';
    char *other = beside(path, given_node ? (upper ? ".ELE" : ".ele") : (upper ? ".NODE" : ".node"));
    cn_status status;

    if (!other) return CN_ERR_MEMORY;
    if ((status = cn_scan_open(&node, given_node ? path : other, error)) != CN_OK) goto done;
    if ((status = cn_scan_open(&ele, given_node ? other : path, error)) != CN_OK) goto done;
    status = cn_read_tetgen(&node, &ele, out);
done:
    cn_scan_close(&node);
    cn_scan_close(&ele);
    free(other);
    return status;
}

cn_status cn_tets_read(cn_tets **out, const char *path, cn_error *error)
{
    cn_tets *tets = NULL;
    cn_status status;

    if (extension_is(path, ".node") || extension_is(path, ".ele")) {
        status = read_pair(&tets, path, error);
    } else if (extension_is(path, ".msh")) {
        cn_scan scan;
        if ((status = cn_scan_open(&scan, path, error)) == CN_OK) status = cn_read_msh(&scan, NULL, &tets);
        cn_scan_close(&scan);
    } else {
        return cn_fail(
            error, CN_FAULT_FORMAT, path, 0,
            "has no extension that is read as tetrahedra: .node (with .ele beside it) and .msh are");
    }
    if (status == CN_OK && tets->ntet == 0) {
        status = cn_fail(error, CN_FAULT_NO_MESH, path, 0,
                         "holds no tetrahedra (%d nodes): fill the surface first", tets->nnode);
        cn_tets_free(tets);
    } else if (status == CN_OK) {
        *out = tets;
    }
    if (status == CN_ERR_MEMORY) cn_fail(error, status, path, 0, "out of memory reading it");
    return status;
}

cn_status cn_surface_write_stl(const cn_surface *surface, const char *path, cn_error *error)
{
    FILE *file = fopen(path, "w");

    if (!file) return cn_fail(error, cn_fault_file(errno), path, 0, "cannot be written: %s", strerror(errno));
    fprintf(file, "solid catnav\n");
    for (int i = 0; i < surface->ntri; i++) {
        const double *x[3];
        double u[3], v[3], n[3];
        for (int k = 0; k < 3; k++)
            x[k] = surface->vert + 3 * (size_t)surface->tri[3 * i + k];
        cn_sub(x[1], x[0], u);
        cn_sub(x[2], x[0], v);
        cn_cross(u, v, n);
        cn_normalise(n);
        fprintf(file, "facet normal %.9g %.9g %.9g\nouter loop\n", n[0], n[1], n[2]);
        for (int k = 0; k < 3; k++)
            fprintf(file, "vertex %.17g %.17g %.17g\n", x[k][0], x[k][1], x[k][2]);
        fprintf(file, "endloop\nendfacet\n");
    }
    fprintf(file, "endsolid catnav\n");
    const int failed = ferror(file);
    if (fclose(file) || failed)
        return cn_fail(error, cn_fault_file(errno), path, 0, "cannot be written: %s", strerror(errno));
    return CN_OK;
}
