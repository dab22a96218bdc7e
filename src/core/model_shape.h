/* model_shape.h - the meshes that bodies are made of, from the shapes of the scene; the caller's to free.
 * What is refused says so in one sentence. */
#ifndef CN_MODEL_SHAPE_H
#define CN_MODEL_SHAPE_H

#include "catnav/mesh.h"
#include "catnav/world.h"

/* The closed surface of a shape, placed and checked. */
cn_status cn_model_surface(cn_surface **out, const cn_shape *shape, cn_error *error);
/* Tetrahedra of a shape, of second order for tet10; placed, but a catheter's are in its own frame. */
cn_status cn_model_mesh(cn_tets **out, const cn_shape *shape, cn_body_model model, cn_error *error);
/* An obstacle that deforms, filled. */
cn_status cn_model_fill_wall(cn_tets **out, const cn_wall *wall, cn_body_model model, cn_error *error);

#endif
