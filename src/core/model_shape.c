/* model_shape.c - the meshes that bodies are made of, from the shapes of the scene. */
#include "model_shape.h"

#include <string.h>

cn_status cn_model_surface(cn_surface **out, const cn_shape *shape, cn_error *error)
{
    cn_surface *surface = NULL;
    cn_status status;
    cn_doctor doctor;

    switch (shape->kind) {
    case CN_SHAPE_SPHERE:
        status = cn_surface_sphere(&surface, shape->sphere.centre, shape->sphere.radius);
        break;
    case CN_SHAPE_BOX:
        status = cn_surface_box(&surface, shape->box.min, shape->box.max);
        break;
    case CN_SHAPE_BEAM:
        status = cn_surface_box(&surface, (double[3]){0, 0, 0}, shape->beam.size);
        break;
    case CN_SHAPE_FILE:
        status = cn_surface_read(&surface, shape->file, error);
        break;
    default:
        return cn_fail(error, CN_FAULT_UNSUITED, NULL, 0,
                       "a body cannot be a plane or a tube: give a file, catheter, beam, sphere or box");
    }
    if (status == CN_OK) cn_place_points(&shape->placement, surface->nvert, surface->vert);
    if (status == CN_OK) status = cn_surface_check(surface, true, &doctor, error);
    if (status == CN_OK) status = cn_doctor_solid(&doctor, shape->file ? shape->file : "shape", error);
    if (status == CN_OK)
        *out = surface;
    else
        cn_surface_free(surface);
    return status;
}

/* The linear mesh of a body's shape, placed; a catheter's in its own frame. */
static cn_status linear_mesh(cn_tets **out, const cn_shape *shape, cn_error *error)
{
    cn_surface *surface = NULL;
    cn_status status;
    int turned = 0;

    if (shape->kind == CN_SHAPE_CATHETER)
        return cn_tets_catheter(out, shape->catheter.length, shape->catheter.diameter,
                                shape->catheter.inner_diameter, shape->catheter.stations,
                                shape->catheter.sides, error);
    if (shape->kind == CN_SHAPE_BEAM) {
        status = cn_tets_beam(out, shape->beam.size, shape->beam.cells, error);
        if (status == CN_OK) cn_place_points(&shape->placement, (*out)->nnode, (*out)->node);
        return status;
    }
    const char *dot = shape->kind == CN_SHAPE_FILE ? strrchr(shape->file, '.') : NULL;
    if (dot && (!strcmp(dot, ".node") || !strcmp(dot, ".ele") || !strcmp(dot, ".msh"))) {
        if ((status = cn_tets_read(out, shape->file, error)) != CN_OK) return status;
        cn_place_points(&shape->placement, (*out)->nnode, (*out)->node);
        status = cn_tets_check(*out, &turned, error);
        if (turned) CN_LOG(CN_LOG_WARNING, "%s: %d inside-out tetrahedra turned", shape->file, turned);
        return status;
    }
    if ((status = cn_model_surface(&surface, shape, error)) != CN_OK) return status;
    status = cn_tets_fill(out, surface, shape->max_volume, error);
    cn_surface_free(surface);
    return status;
}

cn_status cn_model_mesh(cn_tets **out, const cn_shape *shape, cn_body_model model, cn_error *error)
{
    cn_tets *linear = NULL;
    if (model == CN_BODY_TET10 && shape->kind == CN_SHAPE_CATHETER)
        return cn_tets_catheter10(out, shape->catheter.length, shape->catheter.diameter,
                                  shape->catheter.inner_diameter, shape->catheter.stations,
                                  shape->catheter.sides, error);
    cn_status status = linear_mesh(&linear, shape, error);
    *out = linear;
    if (status != CN_OK || model != CN_BODY_TET10) return status;
    status = cn_tets_raise(out, linear);
    cn_tets_free(linear);
    return status;
}

cn_status cn_model_fill_wall(cn_tets **out, const cn_wall *wall, cn_body_model model, cn_error *error)
{
    cn_tets *linear = NULL;
    cn_status status = cn_doctor_solid(&wall->doctor, wall->name, error);
    if (status == CN_OK) status = cn_tets_fill(&linear, wall->surface, 0, error);
    *out = linear;
    if (status != CN_OK || model != CN_BODY_TET10) return status;
    status = cn_tets_raise(out, linear);
    cn_tets_free(linear);
    return status;
}
