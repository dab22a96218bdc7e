/* skin_parts.h - what the two kinds of skin share. */
#ifndef CN_SKIN_PARTS_H
#define CN_SKIN_PARTS_H

#include "catnav/skin.h"

/* A skin of a checked copy of the surface, with room for nper anchors a vertex: rows are in the order of
 * vertices, rest is filled, anchors and weights are zero. */
cn_status cn_skin_begin(cn_skin **out, const cn_surface *surface, int nanchor, int nper, cn_error *error);
/* Rows into the order of their first anchors. */
cn_status cn_skin_sort(cn_skin *skin);
/* skin_face.c: faces and vertex normals from state->x. */
void cn_skin_normals(const cn_skin *skin, cn_skin_state *state, struct cn_pool *pool);

enum { CN_SKIN_CHUNK = 1024 }; /* rows, faces or vertices of a task */

#endif
