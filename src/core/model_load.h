/* model_load.h - a load of the scene as nodal forces. */
#ifndef CN_MODEL_LOAD_H
#define CN_MODEL_LOAD_H

#include "sim.h"

/* Fills nodal (force is allocated, the caller's). CN_ERR_SCENE: the box holds nothing, or nothing that a
 * moment could act on. */
cn_status cn_model_load(const cn_model_body *body, const cn_load *load, cn_nodal_load *nodal,
                        cn_error *error);

#endif
