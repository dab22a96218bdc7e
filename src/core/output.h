/* output.h - a file written under a temporary name and renamed when complete: never half-written. */
#ifndef CN_OUTPUT_H
#define CN_OUTPUT_H

#include <stdio.h>
#include "catnav/status.h"

typedef struct {
    FILE *file; /* write here; errors are looked for once, at the commit */
    char *path, *temporary;
    void *locale; /* the caller's, while numbers are written with a point */
} cn_output;

/* On CN_OK exactly one of commit and discard must follow, on the same thread. A path that is there and is no
 * regular file (a pipe, /dev/null) is written directly. */
cn_status cn_output_open(cn_output *output, const char *path, cn_error *error);
cn_status cn_output_commit(cn_output *output, cn_error *error);
void cn_output_discard(cn_output *output);

#endif
