/* frames_vtk.h - single pieces in VTK's XML formats: header in text, arrays appended raw. */
#ifndef CN_FRAMES_VTK_H
#define CN_FRAMES_VTK_H

#include "catnav/frames.h"

/* One body as .vtu: Float64 points [m], point data `displacement` [m], cell data `stress` [Pa] (left out
 * where von_mises is NULL). CN_ERR_NOT_FINITE where a figure is not finite: nothing is written then. */
cn_status cn_vtu_write(const cn_frame_body *body, const char *path, cn_error *error);
/* The skin that the body wears as .vtp: Float64 points [m], point data `normal`, `displacement` [m] and
 * `stress` [Pa]. CN_ERR_NOT_FINITE as above. */
cn_status cn_skin_write_vtp(const cn_frame_body *body, const char *path, cn_error *error);
/* A number with the digits that bring it back, with a point in every locale. */
void cn_vtk_number(double value, size_t size, char *text);

#endif
