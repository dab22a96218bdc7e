/* frames.h - frames.pvd with .vtu pieces that ParaView opens: NAME_STEP.vtu, Float64 points [m], point data
 * `displacement` [m], cell data `stress` (von Mises, Pa); of a body's skin NAME_skin_STEP.vtp with point data
 * `normal`, `displacement` [m] and `stress` [Pa]. */
#ifndef CN_FRAMES_H
#define CN_FRAMES_H

#include "catnav/run.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_frames cn_frames;
/* Makes the folder if need be and deletes the pieces that an index of ours there names, so that it holds one
 * run. It stays locked until the close (or the end of the process): CN_ERR_FILE while another run writes
 * there. Pieces are written by temporary name and rename; frames.pvd is valid after every frame. */
cn_status cn_frames_open(cn_frames **out, const char *folder, cn_error *error);
/* A step that is not beyond the last one written replaces the frames of that step and all later ones: the
 * index lists increasing steps of the branch that was taken. */
cn_status cn_frames_write(cn_frames *frames, const cn_frame *frame, cn_error *error);
cn_status cn_frames_close(cn_frames *frames, cn_error *error); /* frees */
/* A surface as .vtp (walls, shown organs), a path as .vtp polyline with its clearance [m]. */
cn_status cn_surface_write_vtp(const cn_surface *surface, const char *path, cn_error *error);
cn_status cn_path_write_vtp(const cn_path *path, const char *file, cn_error *error);
/* header s,x,y,z,clearance,waypoint; metres */
cn_status cn_path_write_csv(const cn_path *path, const char *file, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
