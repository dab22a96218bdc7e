/* model.c - from the scene to what stays fixed in a run: meshes, bodies, held nodes, drive geometry. */
#include "body_methods.h"
#include "body_wall.h"
#include "model_load.h"
#include "model_shape.h"
#include "positions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

/* Nodes of a beam's +x face, of a rod its end, of molecules points of their surface. */
static cn_status find_tip(cn_model_body *out)
{
    const cn_body *body = out->body;
    const cn_placement *place = &out->spec->shape.placement;
    const double length = out->spec->shape.beam.size[0] * place->scale;
    double end[2][3] = {{0, 0, 0}, {out->spec->shape.beam.size[0], 0, 0}}, along[3];
    const bool points = body->nanchor > 0;
    const double *at = points ? body->point : body->rest;
    const int n = points ? body->npoint : body->nnode;
    if (!(out->tip = malloc(((size_t)n + 1) * sizeof *out->tip))) return CN_ERR_MEMORY;
    if (out->spec->shape.kind != CN_SHAPE_BEAM) return CN_OK;
    cn_place_points(place, 2, end[0]);
    cn_sub(end[1], end[0], along);
    cn_normalise(along);
    for (int i = 0; i < n; i++) {
        double from[3];
        cn_sub(at + 3 * i, end[1], from);
        if (cn_dot(from, along) >= -1e-9 * length) out->tip[out->ntip++] = i;
    }
    return CN_OK;
}

/* Lays the chain into the scene: the tip `inserted` past the entry, the rest behind it along -direction. */
static cn_status lay_catheter(cn_model_body *body, cn_tets *mesh, double **along)
{
    const cn_shape *shape = &body->spec->shape;
    const double *t = shape->catheter.direction;
    body->catheter = true;
    body->nstation = shape->catheter.stations;
    const int nsection = mesh->mid ? 2 * body->nstation - 1 : body->nstation;
    body->per_section = mesh->nnode / nsection;
    body->per_station = mesh->mid ? 2 * body->per_section : body->per_section;
    body->diameter = shape->catheter.diameter;
    cn_copy3(shape->catheter.entry, body->entry);
    cn_copy3(t, body->direction);
    cn_any_normal(t, body->normal);
    cn_cross(t, body->normal, body->binormal);
    if (!(*along = malloc(((size_t)mesh->ntet + 1) * sizeof **along))) return CN_ERR_MEMORY;
    for (int e = 0; e < mesh->ntet; e++) {
        (*along)[e] = 0;
        for (int a = 0; a < 4; a++)
            (*along)[e] -= 0.25 * mesh->node[3 * mesh->tet[4 * e + a] + 2];
    }
    body->behind = malloc((size_t)mesh->nnode * sizeof *body->behind);
    body->offset = malloc(2 * (size_t)mesh->nnode * sizeof *body->offset);
    if (!body->behind || !body->offset) return CN_ERR_MEMORY;
    for (int i = 0; i < mesh->nnode; i++) {
        double *x = mesh->node + 3 * i;
        body->behind[i] = -x[2], body->offset[2 * i] = x[0], body->offset[2 * i + 1] = x[1];
        for (int k = 0; k < 3; k++)
            x[k] = body->entry[k] + (shape->catheter.inserted - body->behind[i]) * body->direction[k] +
                   body->offset[2 * i] * body->normal[k] + body->offset[2 * i + 1] * body->binormal[k];
    }
    return CN_OK;
}

static bool is_bent(const cn_body_spec *spec)
{
    return spec->shape.kind == CN_SHAPE_CATHETER && spec->drive.mode == CN_DRIVE_PUSH &&
           spec->drive.bend_curvature > 0 && spec->drive.bend_length > 0;
}

/* Bends the mesh of a laid catheter, its rest shape, towards the normal over its end; it starts as it was. */
static cn_status bend_mesh(cn_model_body *body, cn_tets *mesh)
{
    const double length = body->spec->drive.bend_length, k = body->spec->drive.bend_curvature;
    const size_t size = 3 * (size_t)mesh->nnode * sizeof(double);
    if (!(body->start = malloc(size))) return CN_ERR_MEMORY;
    memcpy(body->start, mesh->node, size);
    for (int i = 0; i < mesh->nnode; i++) {
        const double arc = length - body->behind[i], c = cos(k * arc), s = sin(k * arc);
        const double *o = body->offset + 2 * i;
        if (!(arc > 0)) continue;
        cn_axpy(s / k - o[0] * s - arc, body->direction, mesh->node + 3 * i);
        cn_axpy((1 - c) / k + o[0] * c - o[0], body->normal, mesh->node + 3 * i);
    }
    return CN_OK;
}

/* EI over mass per length [m^4/s^2] of the device as its model has it. */
static double bending_of(const cn_body_spec *spec)
{
    cn_section section;
    cn_beam_error error;
    if (cn_section_of(&section, &spec->shape, &spec->material, spec->material.young, NULL) != CN_OK) return 0;
    double ei = section.bending[0];
    /* the drive must bend a mesh as it is, with the stiffness that its elements add */
    if (spec->model != CN_BODY_ROD &&
        cn_beam_error_catheter(&spec->shape, &spec->material, spec->model, &error) == CN_OK &&
        error.bending > -1)
        ei *= 1 + error.bending;
    return section.line_mass > 0 ? ei / section.line_mass : 0;
}

/* A rod under the mesh of its shape, whose nodes lie section after section along it, and ride on it. */
static cn_status build_rod(cn_model_body *out, const cn_tets *skin, cn_error *error)
{
    const cn_shape *shape = &out->spec->shape;
    const cn_material *material = &out->spec->material;
    const bool catheter = shape->kind == CN_SHAPE_CATHETER;
    const int n = catheter ? shape->catheter.stations : shape->beam.cells[0] + 1;
    const double length = catheter ? shape->catheter.length : shape->beam.size[0];
    double *axis = malloc(3 * (size_t)n * sizeof *axis), normal[3];
    cn_section *section = malloc((size_t)n * sizeof *section);
    cn_status status = axis && section ? CN_OK : CN_ERR_MEMORY;
    for (int i = 0; status == CN_OK && i < n; i++) {
        const double s = length * ((double)i / (n - 1)), size[2] = {shape->beam.size[1], shape->beam.size[2]};
        const double in_beam[3] = {s, 0.5 * size[0], 0.5 * size[1]};
        for (int k = 0; k < 3; k++)
            axis[3 * i + k] =
                catheter ? out->entry[k] + (shape->catheter.inserted - s) * out->direction[k] : in_beam[k];
    }
    if (status == CN_OK && !catheter) {
        double origin[3] = {0, 0, 0}, across[3] = {0, 1, 0};
        cn_place_points(&shape->placement, n, axis);
        cn_place_points(&shape->placement, 1, origin), cn_place_points(&shape->placement, 1, across);
        cn_sub(across, origin, normal);
    }
    for (int i = 0; status == CN_OK && i + 1 < n; i++) {
        double centre[3];
        for (int k = 0; k < 3; k++)
            centre[k] = 0.5 * (axis[3 * i + k] + axis[3 * i + 3 + k]);
        const double along = catheter ? length * ((i + 0.5) / (n - 1)) : NAN;
        status =
            cn_section_of(&section[i], shape, material, cn_material_young(material, centre, along), error);
        const double bent = out->spec->drive.bend_length * (n - 1) / length - i; /* of this segment */
        if (is_bent(out->spec)) section[i].bend = out->spec->drive.bend_curvature * fmin(fmax(bent, 0), 1);
    }
    if (status == CN_OK)
        status = cn_body_new_rod(&out->body, n, axis, catheter ? out->normal : normal, section, skin, NULL,
                                 material, error);
    if (status == CN_OK) out->per_station = out->per_section = 1;
    for (int i = 0; status == CN_OK && catheter && i < n; i++)
        out->behind[i] = length * ((double)i / (n - 1)), out->offset[2 * i] = out->offset[2 * i + 1] = 0;
    free(axis), free(section);
    return status;
}

static int nearest_node(const cn_body *body, const double p[3])
{
    int best = 0;
    for (int i = 1; i < body->nnode; i++)
        if (cn_distance(body->rest + 3 * i, p) < cn_distance(body->rest + 3 * best, p)) best = i;
    return best;
}

static cn_status drive_geometry(cn_model_body *out, cn_error *error)
{
    const cn_body *body = out->body;
    const cn_drive_spec *drive = &out->spec->drive;
    double centre[3] = {0, 0, 0}, mass = 0;

    out->ncontrol = 0;
    for (int i = 0; i < body->nnode; i++)
        if (drive->control_all || (drive->ncontrol < 0 && cn_in_box(drive->control_box, body->rest + 3 * i)))
            out->control[out->ncontrol++] = i;
    for (int i = 0; !drive->control_all && i < drive->ncontrol; i++) {
        if (drive->control[i] < 0 || drive->control[i] >= body->nnode)
            return cn_fail(error, CN_FAULT_UNNAMED, NULL, 0,
                           "body %s: control node %d: the mesh has nodes 0 to %d", out->spec->name,
                           drive->control[i], body->nnode - 1);
        out->control[out->ncontrol++] = drive->control[i];
    }
    if (out->ncontrol == 0)
        return cn_fail(error, CN_FAULT_NOTHING, NULL, 0,
                       "body %s: drive.control selects no node: widen its box", out->spec->name);
    for (int i = 0; i < out->ncontrol; i++) {
        cn_axpy(body->mass[out->control[i]], body->rest + 3 * out->control[i], centre);
        mass += body->mass[out->control[i]];
    }
    for (int k = 0; k < 3; k++)
        centre[k] = mass > 0 ? centre[k] / mass : body->rest[3 * out->control[0] + k];
    if (drive->goal_node >= body->nnode)
        return cn_fail(error, CN_FAULT_UNNAMED, NULL, 0, "body %s: goal_node %d: the mesh has nodes 0 to %d",
                       out->spec->name, drive->goal_node, body->nnode - 1);
    out->goal_node = drive->goal_node >= 0 ? drive->goal_node
                     : out->catheter       ? 0
                                           : nearest_node(body, centre);

    const double *goal = body->rest + 3 * out->goal_node;
    for (int i = 0; !out->catheter && i < body->nnode; i++) {
        double from[3];
        cn_sub(body->rest + 3 * i, goal, from);
        out->behind[i] = -cn_dot(from, out->direction);
        out->offset[2 * i] = cn_dot(from, out->normal);
        out->offset[2 * i + 1] = cn_dot(from, out->binormal);
    }
    return CN_OK;
}

/* The barrier of a body that something can touch. */
static void contact_of(cn_model_body *out, const cn_scene *scene)
{
    const cn_body *body = cn_touch_body(out);
    double edges = 0;
    for (int t = 0; t < body->boundary->ntri; t++)
        for (int k = 0; k < 3; k++)
            edges += cn_distance(body->point + 3 * body->boundary->tri[3 * t + k],
                                 body->point + 3 * body->boundary->tri[3 * t + (k + 1) % 3]);
    const double edge = edges / (3.0 * body->boundary->ntri);
    const double length = out->diameter > 0 && out->diameter < edge ? out->diameter : edge;
    out->gap = isnan(scene->contact.gap) ? 0.075 * length : scene->contact.gap;
    /* the barrier is about as stiff as the body's own surface over a gap */
    out->kappa = isnan(scene->contact.stiffness) ? 0.35 * out->spec->material.young * out->gap
                                                 : scene->contact.stiffness;
}

/* A body that could come to touch itself: eight times as long as it is thick, as a round bar of its volume
 * and surface is. */
static bool can_fold(const cn_model_body *body)
{
    const cn_body *b = cn_touch_body(body);
    double area = 0;
    for (int t = 0; t < b->boundary->ntri; t++) {
        const int *tri = b->boundary->tri + 3 * t;
        double e1[3], e2[3], n[3];
        cn_sub(b->point + 3 * tri[1], b->point + 3 * tri[0], e1);
        cn_sub(b->point + 3 * tri[2], b->point + 3 * tri[0], e2);
        cn_cross(e1, e2, n);
        area += 0.5 * cn_norm(n);
    }
    return area > 0 && body->size > 8 * 4 * body->body->rest_volume / area;
}

/* Molecules in the body's shape, or as the file gives them. Its surface is cut to their spacing: each part of
 * it hangs on what lies behind it. */
static cn_status build_molecules(cn_model_body *out, const cn_world *world, unsigned seed, cn_error *error)
{
    const cn_body_spec *spec = out->spec;
    const cn_molecules_spec molecules = {.radius = spec->molecule_radius > 0 ? spec->molecule_radius : 0.01,
                                         .jittered = spec->molecule_jittered,
                                         .file = spec->molecule_file};
    cn_surface *whole = NULL, *surface = NULL;
    cn_status status = CN_OK;
    if (!spec->wall) status = cn_model_surface(&whole, &spec->shape, error);
    if (whole && (status = cn_surface_cut(&surface, whole, 2 * molecules.radius)) == CN_ERR_ARG)
        surface = whole, whole = NULL, status = CN_OK; /* too many: that is for the filling to refuse */
    cn_surface_free(whole);
    if (status == CN_OK)
        status = cn_body_new_molecules(&out->body, spec->wall ? world->wall[out->wall].surface : surface,
                                       &molecules, seed, &spec->material, error);
    cn_surface_free(surface);
    return status;
}

/* What a mesh makes of the answer is said before the run. */
static void warn_of_mesh(const cn_body_spec *spec, const cn_tets *mesh)
{
    const cn_material *material = &spec->material;
    cn_tets_doctor doctor;
    if (spec->model == CN_BODY_TET4 && material->poisson >= 0.45)
        CN_LOG(
            CN_LOG_WARNING,
            "body %s: linear tetrahedra lock at a Poisson's ratio of %g, and bend and shear far too stiffly: "
            "`model: tet10` does not",
            spec->name, material->poisson);
    if (spec->shape.kind != CN_SHAPE_FILE || cn_tets_measure(mesh, &doctor, NULL) != CN_OK) return;
    if (doctor.slivers > 0 || doctor.aspect_max > 100)
        CN_LOG(
            CN_LOG_WARNING,
            "body %s: tetrahedron %d of %d has a dihedral angle of %.3g degrees, %d is %.3g times as long as "
            "thick (%d are slivers, below 1 degree): stress beside them means little, mesh the shape anew",
            spec->name, doctor.dihedral_min_tet, doctor.ntet, doctor.dihedral_min, doctor.aspect_max_tet,
            doctor.aspect_max, doctor.slivers);
}

static cn_status build_body(cn_model_body *out, const cn_world *world, unsigned seed, cn_error *error)
{
    const cn_body_spec *spec = out->spec;
    cn_tets *mesh = NULL;
    double *along = NULL;
    const cn_body *body;
    cn_status status = CN_ERR_MEMORY;
    for (int w = 0; w < world->nwall; w++)
        if (spec->wall && world->wall[w].spec == spec->wall) out->wall = w;
    const bool sheet = cn_is_sheet(spec->model);
    status = sheet || spec->model == CN_BODY_MOLECULES ? CN_OK
             : spec->wall ? cn_model_fill_wall(&mesh, &world->wall[out->wall], spec->model, error)
                          : cn_model_mesh(&mesh, &spec->shape, spec->model, error);
    if (status != CN_OK) goto done;
    if (mesh) warn_of_mesh(spec, mesh);
    if (spec->shape.kind == CN_SHAPE_CATHETER) {
        if ((status = lay_catheter(out, mesh, &along)) != CN_OK) goto done;
        out->sheath = spec->shape.catheter.sheath == CN_ON ||
                      (spec->shape.catheter.sheath == CN_AUTO && world->nvessel > 0);
        out->bending = bending_of(spec);
        if (is_bent(spec) && spec->model != CN_BODY_ROD && (status = bend_mesh(out, mesh)) != CN_OK)
            goto done;
    }
    if ((status = cn_push_check(spec, out->sheath, error)) != CN_OK) goto done;
    status = sheet ? cn_body_new_wall(&out->body, world->wall[out->wall].surface, &spec->wall->wall, error)
             : spec->model == CN_BODY_MOLECULES ? build_molecules(out, world, seed, error)
             : spec->model == CN_BODY_ROD       ? build_rod(out, mesh, error)
                                          : cn_body_new(&out->body, mesh, &spec->material, along, error);
    if (status != CN_OK) goto done;
    body = out->body;
    if ((status = find_tip(out)) != CN_OK) goto done;
    if (!out->catheter) { /* the drive's axis: from the goal node towards the first waypoint */
        double box[2][3] = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
        for (int i = 0; i < 3 * body->npoint; i++) {
            box[0][i % 3] = fmin(box[0][i % 3], body->point[i]);
            box[1][i % 3] = fmax(box[1][i % 3], body->point[i]);
        }
        out->size = cn_distance(box[0], box[1]);
        for (int k = 0; k < 3; k++)
            out->direction[k] = (spec->nwaypoint > 0 ? spec->waypoint[k] : 1) - 0.5 * (box[0][k] + box[1][k]);
        if (!(cn_normalise(out->direction) > 0))
            out->direction[0] = 1, out->direction[1] = out->direction[2] = 0;
        cn_any_normal(out->direction, out->normal);
        cn_cross(out->direction, out->normal, out->binormal);
    } else {
        out->size = spec->shape.catheter.length;
    }
    const size_t n = (size_t)body->nnode;
    out->fixed = calloc((size_t)body->nblock, 1);
    if (!out->catheter) out->behind = malloc(n * sizeof *out->behind);
    if (!out->catheter) out->offset = malloc(2 * n * sizeof *out->offset);
    out->control = malloc(n * sizeof *out->control);
    out->load = calloc((size_t)spec->nload + 1, sizeof *out->load);
    status = CN_ERR_MEMORY;
    if (!out->fixed || !out->behind || !out->offset || !out->control || !out->load) goto done;
    if ((status = drive_geometry(out, error)) != CN_OK) goto done;
    if (spec->start_file) {
        status = CN_ERR_MEMORY;
        free(out->start);
        if (!(out->start = malloc(3 * n * sizeof *out->start))) goto done;
        if ((status = cn_positions_read(spec->start_file, body->nnode, out->start, error)) != CN_OK)
            goto done;
    }
    for (int i = 0; spec->fixed.set && i < body->nblock; i++)
        out->fixed[i] = cn_in_box(spec->fixed.box, body->rest + 3 * (i % body->nnode));
    if (sheet && spec->wall->wall.rims_held) cn_body_wall_rims(body, out->fixed);
    int nfixed = 0;
    for (int i = 0; i < body->nnode; i++)
        nfixed += out->fixed[i];
    if (spec->fixed.set && nfixed == 0) {
        status = cn_fail(error, CN_FAULT_NOTHING, NULL, 0,
                         "body %s: `fixed` box [%g %g %g] to [%g %g %g] holds no node: move or widen it",
                         spec->name, spec->fixed.box[0][0], spec->fixed.box[0][1], spec->fixed.box[0][2],
                         spec->fixed.box[1][0], spec->fixed.box[1][1], spec->fixed.box[1][2]);
        goto done;
    }
    for (int l = 0; l < spec->nload; l++, out->nload++)
        if ((status = cn_model_load(out, &spec->load[l], &out->load[l], error)) != CN_OK) goto done;
    status = CN_OK;
done:
    free(along);
    cn_tets_free(mesh);
    return status;
}

/* Whether a body can touch itself, and its barrier. */
static void what_touches(const cn_model *model, cn_model_body *body)
{
    const cn_scene *scene = model->scene;
    const bool done = scene->leave_out.self_contact == CN_OFF || scene->contact.self == CN_ON;
    body->self = scene->contact.method != CN_CONTACT_NONE && scene->leave_out.self_contact != CN_ON &&
                 scene->contact.self != CN_OFF && !body->spec->wall && (done || can_fold(body));
    body->self_always = body->self && done;
    if (model->world->nwall > 0 || model->coupled || body->self) contact_of(body, scene);
}

cn_status cn_model_new(cn_model **out, const cn_scene *scene, const cn_world *world, int nbody,
                       const cn_body_spec *spec, cn_error *error)
{
    cn_model *model = calloc(1, sizeof *model);
    cn_status status = CN_OK;
    *out = NULL;
    if (!model) return CN_ERR_MEMORY;
    model->scene = scene, model->world = world, model->dt = scene->step;
    cn_copy3(scene->gravity, model->gravity);
    model->single = scene->solver.newton == 1;
    model->inertia = scene->leave_out.inertia != CN_ON;
    model->integrator = model->inertia && !model->single ? scene->solver.integrator : CN_INTEGRATOR_EULER;
    model->newton = scene->solver.newton > 0 ? scene->solver.newton : 60;
    model->body = calloc((size_t)nbody + 1, sizeof *model->body);
    if (!model->body) status = CN_ERR_MEMORY;
    for (int b = 0; status == CN_OK && b < nbody; b++) {
        model->body[model->nbody].tick = scene->step, model->body[model->nbody].wall = -1;
        model->body[model->nbody++].spec = &spec[b];
        status = build_body(&model->body[b], world, scene->seed, error);
    }
    if (status != CN_OK) {
        cn_model_free(model);
        return cn_fail(error, status, NULL, 0, "%s", cn_status_text(status));
    }
    model->touches = true;
    model->coupled = scene->contact.method != CN_CONTACT_NONE && nbody > 1;
    for (int b = 0; b < nbody; b++)
        what_touches(model, &model->body[b]);
    *out = model;
    return CN_OK;
}

cn_status cn_model_wear(cn_model *model, int b, const cn_skin *skin)
{
    const cn_status status = cn_skin_touch(&model->body[b].worn, skin, model->body[b].body);
    if (status == CN_OK) what_touches(model, &model->body[b]);
    return status;
}

void cn_model_free(cn_model *model)
{
    if (!model) return;
    for (int b = 0; b < model->nbody; b++) {
        cn_model_body *body = &model->body[b];
        for (int l = 0; body->load && l < body->spec->nload; l++)
            free(body->load[l].force);
        free(body->load), free(body->fixed), free(body->start), free(body->tip), free(body->behind),
            free(body->offset), free(body->control);
        cn_body_free(body->worn);
        cn_body_free(body->body);
    }
    free(model->body);
    free(model);
}
