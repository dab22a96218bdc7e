/* body_face.h - outer faces of a body: what a traction on them gives their points.
 *
 * A face is a triangle of the boundary, of second-order tetrahedra four of them in a row: its corners and the
 * nodes amid its edges, plane or curved. */
#ifndef CN_BODY_FACE_H
#define CN_BODY_FACE_H

#include "catnav/body.h"

enum { CN_FACE_NODES = 6, CN_FACE_POINTS = 16 };

/* Points of outer face number `face`, corners first, then those amid edges 01 12 20; returns their number, 3
 * or 6, or 0 behind the last face. */
int cn_body_face(const cn_body *body, int face, int point[CN_FACE_NODES]);
/* Point k < CN_FACE_POINTS of a rule exact to degree 6: the values there of the face's shape functions, the
 * place at rest [m], and the outward normal times the area it stands for [m^2]. */
void cn_body_face_at(const cn_body *body, int face, int k, double shape[CN_FACE_NODES], double place[3],
                     double area[3]);

/* cn_body_face_shares for faces of six points: a plane one has a third of its area on each of those amid
 * edges. */
void cn_face_shares(const cn_body *body, const unsigned char *inside, double *share);

#endif
