/* mesh_read.h - what the mesh readers share: the whole file in memory, its lines, tokens and numbers.
 * The first failure of a call fills scan->error with file, line (text) or byte offset (binary). */
#ifndef CN_MESH_READ_H
#define CN_MESH_READ_H

#include <locale.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "catnav/mesh.h"

typedef struct {
    const char *path;
    cn_error *error;
    char *data;               /* the file and one NUL */
    size_t size, at;          /* bytes; next unread byte */
    const char *cursor, *end; /* rest of the current line */
    int line;                 /* of cursor, 1-based */
    char comment;             /* rest of a line from this character on is skipped; 0: none */
    bool swap;                /* binary numbers are of the other byte order */
    locale_t c;
} cn_scan;

cn_status cn_scan_open(cn_scan *scan, const char *path, cn_error *error);
void cn_scan_close(cn_scan *scan);
void cn_scan_rewind(cn_scan *scan);

/* A fault of CN_ERR_PARSE at the current line; at the current byte. */
cn_status cn_scan_fail(const cn_scan *scan, int fault, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
cn_status cn_scan_fail_at(const cn_scan *scan, int fault, size_t at, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* A token made fit to print. */
typedef struct {
    char text[44];
} cn_quote;
cn_quote cn_scan_quote(const char *token, size_t length);

/* Next line that is neither empty nor a comment; false at the end of the file. */
bool cn_scan_line(cn_scan *scan);
/* The same, where the end of the file is a failure: `what` was expected. */
cn_status cn_scan_need_line(cn_scan *scan, const char *what);
/* Next token of the current line; false when there is none. */
bool cn_scan_token(cn_scan *scan, const char **token, size_t *length);
bool cn_scan_is(const char *token, size_t length, const char *word); /* case does not matter */
/* Next token must be ... */
cn_status cn_scan_number(cn_scan *scan, const char *what, double *value); /* decimal, finite */
cn_status cn_scan_integer(cn_scan *scan, const char *what, int64_t low, int64_t high, int64_t *value);
cn_status cn_scan_word(cn_scan *scan, const char *word);
cn_status cn_scan_no_more(cn_scan *scan, const char *what); /* the line ends after `what` */
/* Parses all of a token as an integer. */
bool cn_parse_integer(const char *token, size_t length, int64_t *value);

/* Binary: the next n bytes, NULL when the file ends before. */
const unsigned char *cn_scan_bytes(cn_scan *scan, size_t n);
uint64_t cn_scan_unsigned(const cn_scan *scan, const unsigned char *bytes, int size); /* 1, 2, 4, 8 bytes */
double cn_scan_real(const cn_scan *scan, const unsigned char *bytes, int size);       /* 4 or 8 bytes */

/* Refuses arrays of more than 8 x file + 12 MiB (a reader promises 10 x file + 16 MiB in all). */
cn_status cn_scan_room(const cn_scan *scan, double bytes, const char *what);

/* Writes the n - 2 triangles of a flat convex polygon (n >= 3 valid corners), fanned from the first corner
 * that sees all of it; false when there is none. Triangles pass unchecked. */
bool cn_polygon_fan(const double *vert, int n, const int *corner, int *tri);

cn_status cn_read_stl(cn_scan *scan, cn_surface **out);
cn_status cn_read_obj(cn_scan *scan, cn_surface **out);
cn_status cn_read_ply(cn_scan *scan, cn_surface **out);
cn_status cn_read_msh(cn_scan *scan, cn_surface **surface, cn_tets **tets); /* one of them NULL */
cn_status cn_read_tetgen(cn_scan *node, cn_scan *ele, cn_tets **out);

#endif
