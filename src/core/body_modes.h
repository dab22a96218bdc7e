/* body_modes.h - rigid motions that nothing prevents: what leaves a static problem without an answer. */
#ifndef CN_BODY_MODES_H
#define CN_BODY_MODES_H

#include <stddef.h>
#include "catnav/body.h"

typedef struct {
    int npart, nloose;     /* parts that elements join; those that can still move as a whole */
    int part, node, nnode; /* the first loose one: its number from 1, first node, nodes */
    bool shift;            /* it can shift along x, y and z */
    int turn; /* and turn: 3 about any axis through `at`, 1 about the line through it along `axis`, 0 */
    double at[3], axis[3]; /* [m], unit */
} cn_body_modes;

/* Which rigid motions the held blocks (`fixed`, nblock) leave each part. A held rod's frame holds its turn
 * too. Held nodes within 1e-9 of the part's size of one point, or of one line, count as such. */
cn_status cn_body_modes_find(const cn_body *body, const unsigned char *fixed, cn_body_modes *modes);
/* A sentence about the first loose part, such as "part 2 of 3 (node 8 and 7 more) is free to shift along x, y
 * and z and to turn about x, y and z"; "" where nothing is loose. */
void cn_body_modes_text(const cn_body_modes *modes, char *text, size_t size);

#endif
