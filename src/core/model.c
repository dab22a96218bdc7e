/* model.c - from the scene to what stays fixed in a run: meshes, bodies, held nodes, loads, drive geometry.
 */
#include "sim.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

/* Boxes of a scene are closed, with a tolerance of 1e-9 of their size. */
static bool in_box(const double box[2][3], const double p[3])
{
    const double slack = 1e-9 * cn_distance(box[0], box[1]);
    for (int k = 0; k < 3; k++)
        if (!(p[k] >= box[0][k] - slack && p[k] <= box[1][k] + slack)) return false;
    return true;
}

/* The mesh of a body's shape in its own frame, placed; a catheter's is laid along its entry axis. tip gets
 * the nodes of a beam's +x face. */
static cn_status shape_mesh(cn_tets **out, const cn_shape *shape, int *tip, int *ntip, cn_error *error)
{
    cn_status status = CN_ERR_ARG;
    cn_surface *surface = NULL;
    const char *dot;
    int turned = 0;

    switch (shape->kind) {
    case CN_SHAPE_CATHETER:
        status = cn_tets_catheter(out, shape->catheter.length, shape->catheter.diameter,
                                  shape->catheter.inner_diameter, shape->catheter.stations,
                                  shape->catheter.sides, error);
        return status;
    case CN_SHAPE_BEAM:
        status = cn_tets_beam(out, shape->beam.size, shape->beam.cells, error);
        for (int i = 0; status == CN_OK && i < (*out)->nnode; i++)
            if ((*out)->node[3 * i] >= shape->beam.size[0] * (1 - 1e-9)) tip[(*ntip)++] = i;
        if (status == CN_OK) cn_place_points(&shape->placement, (*out)->nnode, (*out)->node);
        return status;
    case CN_SHAPE_SPHERE:
        status = cn_surface_sphere(&surface, shape->sphere.centre, shape->sphere.radius);
        break;
    case CN_SHAPE_BOX:
        status = cn_surface_box(&surface, shape->box.min, shape->box.max);
        break;
    case CN_SHAPE_FILE:
        dot = strrchr(shape->file, '.');
        if (dot && (!strcmp(dot, ".node") || !strcmp(dot, ".ele") || !strcmp(dot, ".msh"))) {
            if ((status = cn_tets_read(out, shape->file, error)) != CN_OK) return status;
            cn_place_points(&shape->placement, (*out)->nnode, (*out)->node);
            status = cn_tets_check(*out, &turned, error);
            if (turned) CN_LOG(CN_LOG_WARNING, "%s: %d inside-out tetrahedra turned", shape->file, turned);
            return status;
        }
        status = cn_surface_read(&surface, shape->file, error);
        break;
    default:
        return cn_fail(error, CN_ERR_SCENE, NULL, 0,
                       "a body cannot be a plane or a tube: give a file, catheter, beam, sphere or box");
    }
    if (status == CN_OK) cn_place_points(&shape->placement, surface->nvert, surface->vert);
    cn_doctor doctor;
    if (status == CN_OK) status = cn_surface_check(surface, true, &doctor, error);
    if (status == CN_OK) status = cn_doctor_solid(&doctor, shape->file ? shape->file : "shape", error);
    if (status == CN_OK) status = cn_tets_fill(out, surface, 0, error);
    cn_surface_free(surface);
    return status;
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

/* EI over mass per length [m^4/s^2]. */
static double bending_of(const cn_body_spec *spec)
{
    const double d = spec->shape.catheter.diameter, di = spec->shape.catheter.inner_diameter, pi = acos(-1.0);
    double ei = spec->material.young * pi * (pow(d, 4) - pow(di, 4)) / 64;
    double line = spec->material.density * pi * (d * d - di * di) / 4;
    if (spec->shape.catheter.has_core) {
        const double dc = spec->shape.catheter.core_diameter;
        ei += spec->shape.catheter.core_young * pi * pow(dc, 4) / 64;
        line += spec->shape.catheter.core_density * pi * dc * dc / 4;
    }
    /* the drive must bend the mesh as it is, with the stiffness that its elements add */
    cn_beam_error error;
    if (cn_beam_error_catheter(&spec->shape, &spec->material, &error) == CN_OK && error.bending > -1)
        ei *= 1 + error.bending;
    return line > 0 ? ei / line : 0;
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
        if (drive->control_all || (drive->ncontrol < 0 && in_box(drive->control_box, body->rest + 3 * i)))
            out->control[out->ncontrol++] = i;
    for (int i = 0; !drive->control_all && i < drive->ncontrol; i++) {
        if (drive->control[i] < 0 || drive->control[i] >= body->nnode)
            return cn_fail(error, CN_ERR_SCENE, NULL, 0,
                           "body %s: control node %d: the mesh has nodes 0 to %d", out->spec->name,
                           drive->control[i], body->nnode - 1);
        out->control[out->ncontrol++] = drive->control[i];
    }
    if (out->ncontrol == 0)
        return cn_fail(error, CN_ERR_SCENE, NULL, 0, "body %s: drive.control selects no node: widen its box",
                       out->spec->name);
    for (int i = 0; i < out->ncontrol; i++) {
        cn_axpy(body->mass[out->control[i]], body->rest + 3 * out->control[i], centre);
        mass += body->mass[out->control[i]];
    }
    for (int k = 0; k < 3; k++)
        centre[k] = mass > 0 ? centre[k] / mass : body->rest[3 * out->control[0] + k];
    if (drive->goal_node >= body->nnode)
        return cn_fail(error, CN_ERR_SCENE, NULL, 0, "body %s: goal_node %d: the mesh has nodes 0 to %d",
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

/* Uniform traction on the surface triangles wholly in the box, by their lumped area; without any, by mass
 * over the nodes in it. */
static cn_status nodal_load(cn_model_body *out, const cn_load *load, cn_nodal_load *nodal, cn_error *error)
{
    const cn_body *body = out->body;
    double *share = calloc((size_t)body->nnode, sizeof *share), total = 0;
    nodal->from = load->from, nodal->until = load->until;
    nodal->force = calloc(3 * (size_t)body->nnode, sizeof *nodal->force);
    if (!share || !nodal->force) {
        free(share);
        return CN_ERR_MEMORY;
    }
    for (int t = 0; t < body->boundary->ntri; t++) {
        const int *c = body->boundary->tri + 3 * t;
        double e1[3], e2[3], n[3];
        if (!in_box(load->box, body->rest + 3 * c[0]) || !in_box(load->box, body->rest + 3 * c[1]) ||
            !in_box(load->box, body->rest + 3 * c[2]))
            continue;
        cn_sub(body->rest + 3 * c[1], body->rest + 3 * c[0], e1);
        cn_sub(body->rest + 3 * c[2], body->rest + 3 * c[0], e2);
        cn_cross(e1, e2, n);
        for (int k = 0; k < 3; k++)
            share[c[k]] += cn_norm(n) / 6;
        total += cn_norm(n) / 2;
    }
    for (int i = 0; total == 0 && i < body->nnode; i++)
        if (in_box(load->box, body->rest + 3 * i)) share[i] = body->mass[i] > 0 ? body->mass[i] : 1;
    if (total == 0)
        for (int i = 0; i < body->nnode; i++)
            total += share[i];
    for (int i = 0; total > 0 && i < body->nnode; i++)
        cn_axpy(share[i] / total, load->force, nodal->force + 3 * i);
    free(share);
    if (total > 0) return CN_OK;
    return cn_fail(error, CN_ERR_SCENE, NULL, 0,
                   "body %s: the load's box [%g %g %g] to [%g %g %g] holds no node: move or widen it",
                   out->spec->name, load->box[0][0], load->box[0][1], load->box[0][2], load->box[1][0],
                   load->box[1][1], load->box[1][2]);
}

static cn_status contact_of(cn_model_body *out, const cn_scene *scene, const cn_world *world)
{
    const cn_body *body = out->body;
    double edges = 0;
    if (world->nwall == 0) return CN_OK;
    for (int t = 0; t < body->boundary->ntri; t++)
        for (int k = 0; k < 3; k++)
            edges += cn_distance(body->point + 3 * body->boundary->tri[3 * t + k],
                                 body->point + 3 * body->boundary->tri[3 * t + (k + 1) % 3]);
    const double edge = edges / (3.0 * body->boundary->ntri);
    const double length = out->diameter > 0 && out->diameter < edge ? out->diameter : edge;
    const double gap = isnan(scene->contact.gap) ? 0.075 * length : scene->contact.gap;
    /* the barrier is about as stiff as the body's own surface over a gap */
    const double kappa =
        isnan(scene->contact.stiffness) ? 0.35 * out->spec->material.young * gap : scene->contact.stiffness;
    return cn_contact_model_new(&out->contact, body, world, gap, kappa);
}

static cn_status build_body(cn_model_body *out, const cn_scene *scene, const cn_world *world, cn_error *error)
{
    const cn_body_spec *spec = out->spec;
    cn_tets *mesh = NULL;
    double *along = NULL;
    const cn_body *body;
    cn_status status = CN_ERR_MEMORY;
    const size_t face = spec->shape.kind == CN_SHAPE_BEAM ? ((size_t)spec->shape.beam.cells[1] + 1) *
                                                                ((size_t)spec->shape.beam.cells[2] + 1)
                                                          : 0;
    if (!(out->tip = malloc((face + 1) * sizeof *out->tip))) goto done;
    status = shape_mesh(&mesh, &spec->shape, out->tip, &out->ntip, error);
    if (status != CN_OK) goto done;

    if (spec->shape.kind == CN_SHAPE_CATHETER) {
        if ((status = lay_catheter(out, mesh, &along)) != CN_OK) goto done;
        out->sheath = spec->shape.catheter.sheath == CN_ON ||
                      (spec->shape.catheter.sheath == CN_AUTO && world->nvessel > 0);
        out->bending = bending_of(spec);
    }
    if ((status = cn_body_new(&out->body, mesh, &spec->material, along, error)) != CN_OK) goto done;
    body = out->body;
    if (!out->catheter) { /* the drive's axis: from the goal node towards the first waypoint */
        double box[2][3] = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
        for (int i = 0; i < 3 * body->nnode; i++) {
            box[0][i % 3] = fmin(box[0][i % 3], body->rest[i]);
            box[1][i % 3] = fmax(box[1][i % 3], body->rest[i]);
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
    for (int i = 0; spec->fixed.set && i < body->nblock; i++)
        out->fixed[i] = in_box(spec->fixed.box, body->rest + 3 * (i % body->nnode));
    int nfixed = 0;
    for (int i = 0; i < body->nnode; i++)
        nfixed += out->fixed[i];
    if (spec->fixed.set && nfixed == 0) {
        status = cn_fail(error, CN_ERR_SCENE, NULL, 0,
                         "body %s: `fixed` box [%g %g %g] to [%g %g %g] holds no node: move or widen it",
                         spec->name, spec->fixed.box[0][0], spec->fixed.box[0][1], spec->fixed.box[0][2],
                         spec->fixed.box[1][0], spec->fixed.box[1][1], spec->fixed.box[1][2]);
        goto done;
    }
    for (int l = 0; l < spec->nload; l++, out->nload++)
        if ((status = nodal_load(out, &spec->load[l], &out->load[l], error)) != CN_OK) goto done;
    status =
        scene->contact.method == CN_CONTACT_NONE && world->nwall == 0 ? CN_OK : contact_of(out, scene, world);
done:
    free(along);
    cn_tets_free(mesh);
    return status;
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
        model->body[model->nbody].tick = scene->step;
        model->body[model->nbody++].spec = &spec[b];
        status = build_body(&model->body[b], scene, world, error);
    }
    if (status != CN_OK) {
        cn_model_free(model);
        return cn_fail(error, status, NULL, 0, "%s", cn_status_text(status));
    }
    *out = model;
    return CN_OK;
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
        cn_contact_model_free(body->contact);
        cn_body_free(body->body);
    }
    free(model->body);
    free(model);
}
