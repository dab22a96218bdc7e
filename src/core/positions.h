/* positions.h - where the nodes of a body are at t = 0, from a file. */
#ifndef CN_POSITIONS_H
#define CN_POSITIONS_H

#include "catnav/status.h"

/* Reads n points (n x 3) [m]: one "x y z" a line, empty lines and what follows a # skipped. CN_ERR_PARSE with
 * the line: a point too few or too many, what is not a finite decimal number; CN_ERR_FILE; CN_ERR_MEMORY.
 * x is void on failure. */
cn_status cn_positions_read(const char *path, int n, double *x, cn_error *error);

#endif
