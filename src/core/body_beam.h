/* body_beam.h - stiffness of a chain of sections by linear static solves. */
#ifndef CN_BODY_BEAM_H
#define CN_BODY_BEAM_H

#include "catnav/body.h"

enum { CN_BEAM_AXIAL, CN_BEAM_BENDING_U, CN_BEAM_BENDING_V, CN_BEAM_TORSION, CN_BEAM_LOADS };

/* EA [N], EI and GJ [N m^2] of a straight chain of nsection plane sections with as many nodes each, in order
 * along `axis` (0 x, 1 y, 2 z); u and v are the two axes after it. `section`: of the meshed section by exact
 * elements, but with the polar moment for J. Regions of the material do not count. */
cn_status cn_beam_stiffness(const cn_tets *mesh, int nsection, int axis, const cn_material *material,
                            double mesh_stiffness[CN_BEAM_LOADS], double section[CN_BEAM_LOADS]);

#endif
