/* run_skin.c - skins that bodies wear: made at the door, hung once the bodies stand, brought along for
 * frames. With `contact` they are what contact meets (skin_touch.c), else they are seen alone. */
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

enum { RINGS = 3 }; /* of a tube for each station of the catheter */

/* A round tube about a catheter, in its own frame: tip at the origin, rounded, then along -z; open behind. */
static cn_status make_tube(cn_surface **out, const cn_body_spec *spec)
{
    const double r = 0.5 * spec->shape.catheter.diameter, length = spec->shape.catheter.length;
    const int cap = length > r ? 1 + spec->skin_sides / 4 : 0,
              n = cap + RINGS * (spec->shape.catheter.stations - 1) + 1;
    double *axis = calloc((size_t)n, 3 * sizeof *axis), *radius = malloc((size_t)n * sizeof *radius);
    cn_status status = CN_ERR_MEMORY;
    if (!axis || !radius) goto done;
    for (int i = 0; i < n; i++) {
        const double turn = 0.5 * acos(-1.0) * (i + 0.1) / cap, begin = cap ? r : 0;
        axis[3 * i + 2] =
            i < cap ? -r * (1 - cos(turn)) : -begin - (length - begin) * (i - cap) / (n - 1 - cap);
        radius[i] = i < cap ? r * sin(turn) : r;
    }
    status = cn_surface_tube(out, n, axis, radius, 0, spec->skin_sides);
done:
    free(axis);
    free(radius);
    return status;
}

static cn_status refuse(cn_run_data *run, int b, const char *what)
{
    return cn_fail(&run->error, CN_FAULT_UNSUITED, run->scene->path, 0, "%s: %s", run->spec[b].name, what);
}

cn_status cn_run_skin_read(cn_run_data *run, int b)
{
    const cn_body_spec *spec = &run->spec[b];
    const bool catheter = spec->shape.kind == CN_SHAPE_CATHETER, molecules = spec->model == CN_BODY_MOLECULES;
    cn_surface **surface = &run->body[b].surface;
    cn_doctor doctor;
    cn_status status = CN_OK;
    if (spec->skin_source == CN_SKIN_NONE) return CN_OK;
    if (spec->skin_source == CN_SKIN_TUBE && !catheter)
        return refuse(run, b,
                      "a skin of `sides` is a tube about a catheter, which this is not: give its file");
    if (spec->skin_source == CN_SKIN_SPHERES && !molecules)
        return refuse(run, b,
                      "a skin of `cell` is made about molecules, which this body is not of: give its file");
    if (spec->skin_kind == CN_SKIN_EMBED && spec->model == CN_BODY_ROD)
        return refuse(run, b,
                      "a skin is embedded in tetrahedra or molecules, which a rod has none of: use method: "
                      "blend");
    if (spec->skin_contact && run->scene->contact.method == CN_CONTACT_PROJECT)
        return refuse(run, b,
                      "contact.method project moves the nodes of a body's own surface, not a skin's: use "
                      "strict or penalty, or skin.contact: off");
    if (spec->skin_contact && run->scene->contact.method == CN_CONTACT_STRICT &&
        spec->skin_kind == CN_SKIN_BLEND && spec->model != CN_BODY_ROD)
        return refuse(run, b,
                      "strict contact needs a skin that moves by its nodes' motion alone, and between "
                      "frames that turn it does not: use method: embed, or contact.method penalty");
    if (spec->skin_source == CN_SKIN_SPHERES) return CN_OK; /* about where they will be */
    if (spec->skin_source == CN_SKIN_TUBE)
        status = make_tube(surface, spec);
    else
        status = cn_surface_read(surface, spec->skin_file, &run->error);
    if (status == CN_OK && !catheter)
        cn_place_points(&spec->shape.placement, (*surface)->nvert, (*surface)->vert);
    if (status == CN_OK) status = cn_surface_check(*surface, true, &doctor, &run->error);
    return status;
}

static cn_status about_molecules(cn_run_data *run, int b)
{
    const cn_body *body = run->model->body[b].body;
    double *radius = malloc((size_t)body->nnode * sizeof *radius);
    if (!radius) return CN_ERR_MEMORY;
    for (int i = 0; i < body->nnode; i++)
        radius[i] = run->spec[b].molecule_radius;
    const cn_status status = cn_surface_about_spheres(&run->body[b].surface, body->nnode, body->rest, radius,
                                                      run->spec[b].skin_cell, &run->error);
    free(radius);
    return status;
}

/* From the catheter's own frame to where it lies at rest. */
static void lay(const cn_model_body *body, cn_surface *surface)
{
    const double inserted = body->spec->shape.catheter.inserted;
    for (int v = 0; v < surface->nvert; v++) {
        double *p = surface->vert + 3 * (size_t)v, x[3];
        for (int k = 0; k < 3; k++)
            x[k] = body->entry[k] + (inserted + p[2]) * body->direction[k] + p[0] * body->normal[k] +
                   p[1] * body->binormal[k];
        cn_copy3(x, p);
    }
}

cn_status cn_run_skin_hang(cn_run_data *run, int b)
{
    const cn_body_spec *spec = &run->spec[b];
    const cn_model_body *model = &run->model->body[b];
    const cn_body *body = model->body;
    cn_run_body *own = &run->body[b];
    cn_status status;
    if (spec->skin_source == CN_SKIN_NONE) return CN_OK;
    if (spec->skin_source == CN_SKIN_SPHERES && (status = about_molecules(run, b)) != CN_OK) return status;
    if (model->catheter) lay(model, own->surface);
    const bool tetrahedra = body->model == CN_BODY_TET4 || body->model == CN_BODY_TET10;
    const bool strict = spec->skin_contact && run->scene->contact.method == CN_CONTACT_STRICT;
    if (body->model == CN_BODY_MOLECULES &&
        (spec->skin_kind == CN_SKIN_EMBED || (spec->skin_kind == CN_SKIN_AUTO && strict))) {
        status = cn_skin_new_molecules(&own->skin, own->surface, body, &run->error);
    } else if (tetrahedra && spec->skin_kind != CN_SKIN_BLEND) {
        const cn_tets tets = {body->npoint, body->ntet, body->point, body->tet, body->mid};
        status = cn_skin_new_embedded(&own->skin, own->surface, &tets, &run->error);
    } else {
        if (!(own->node_turn = malloc(4 * ((size_t)body->nnode + 1) * sizeof *own->node_turn)))
            return CN_ERR_MEMORY;
        const bool rod = body->model == CN_BODY_ROD;
        if (rod) cn_body_rotation_start(body, own->node_turn); /* its frames at rest */
        status = cn_skin_new(&own->skin, own->surface, body->nnode, body->rest, rod ? own->node_turn : NULL,
                             spec->skin_anchors, &run->error);
    }
    if (status == CN_OK && !(own->skin->reach <= model->size))
        return cn_fail(
            &run->error, CN_FAULT_AT_ODDS, spec->skin_file ? spec->skin_file : run->scene->path, 0,
            "the skin of %s reaches %.3g m away from it, and it is %.3g m large: both must be in one "
            "place and unit",
            spec->name, own->skin->reach, model->size);
    if (status == CN_OK && spec->skin_contact) status = cn_model_wear(run->model, b, own->skin);
    if (status == CN_OK) status = cn_skin_state_new(&own->worn, own->skin, &run->error);
    cn_surface_free(own->surface);
    own->surface = NULL;
    return status;
}

bool cn_run_skin_bring(cn_run_data *run, int b, const cn_body_state *state)
{
    cn_run_body *own = &run->body[b];
    if (!own->worn) return false;
    if (own->node_turn)
        cn_skin_rotations(run->model->body[b].body, state->x, own->turn, own->node_turn, run->pool);
    return cn_skin_update(own->skin, state->x, own->node_turn, own->worn, run->pool) == CN_OK;
}

void cn_run_skin_clear(cn_run_body *body)
{
    cn_surface_free(body->surface);
    cn_skin_state_free(body->worn);
    cn_skin_free(body->skin);
    free(body->node_turn);
}
