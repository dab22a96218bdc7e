/* run_door.c - what a request changes, and what is refused before anything moves. */
#include "run_parts.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "molecules.h"
#include "tree.h"

static cn_status add_limits(cn_run_data *run, cn_body_spec *device)
{
    const cn_request *request = run->request;
    run->limit = malloc(((size_t)device->nlimit + (size_t)request->nlimit + 1) * sizeof *run->limit);
    if (!run->limit) return CN_ERR_MEMORY;
    int n = 0;
    for (int i = 0; i < device->nlimit; i++)
        run->limit[n++] = device->limit[i];
    for (int i = 0; i < request->nlimit; i++) {
        int at = 0;
        while (at < n && (run->limit[at].quantity != request->limit[i].quantity ||
                          run->limit[at].reduce != request->limit[i].reduce))
            at++;
        run->limit[at] = request->limit[i];
        n += at == n;
    }
    device->limit = run->limit, device->nlimit = n;
    return CN_OK;
}

cn_body_spec cn_wall_as_body(const cn_surface_spec *wall)
{
    cn_body_spec spec = {.name = wall->name,
                         .shape = wall->shape,
                         .model = wall->deformable && wall->model == CN_BODY_AUTO ? CN_BODY_TET4
                                  : wall->deformable                              ? wall->model
                                  : wall->wall.model == CN_WALL_SHELL             ? CN_BODY_SHELL
                                                                                  : CN_BODY_MEMBRANE,
                         .material = wall->material,
                         .fixed = wall->fixed,
                         .nlimit = wall->nlimit,
                         .limit = wall->limit,
                         .deadline = INFINITY,
                         .wall = wall};
    spec.drive = (cn_drive_spec){.control_all = true, .goal_node = -1, .force_threshold = NAN};
    if (!wall->deformable)
        spec.material = (cn_material){
            .young = wall->wall.young, .poisson = wall->wall.poisson, .density = wall->wall.density};
    return spec;
}

static void add_walls(cn_run_data *run)
{
    for (int w = 0; w < run->world->nwall; w++) {
        const cn_surface_spec *wall = run->world->wall[w].spec;
        if (run->scene->leave_out.wall_solve != CN_ON && cn_gives_way(wall))
            run->spec[run->nbody++] = cn_wall_as_body(wall);
    }
}

cn_status cn_run_specs(cn_run_data *run)
{
    const cn_scene *scene = run->scene;
    const cn_request *request = run->request;
    run->nbody = scene->nbody;
    run->spec = malloc(((size_t)scene->nbody + (size_t)run->world->nwall + 1) * sizeof *run->spec);
    if (!run->spec) return CN_ERR_MEMORY;
    memcpy(run->spec, scene->body, (size_t)scene->nbody * sizeof *run->spec);
    add_walls(run);
    run->seed = scene->seed, run->budget = scene->planner.budget;
    if (!request) return CN_OK;
    if (request->seed) run->seed = *request->seed;
    if (request->budget > 0) run->budget = request->budget;
    if (scene->nbody == 0)
        return cn_fail(&run->error, CN_FAULT_NEEDED, scene->path, 0,
                       "the scene has no body to plan for: add one under `bodies`");
    cn_body_spec *device = &run->spec[0];
    if (request->sampling) device->path.sampling = *request->sampling;
    for (int i = 0; i < request->nlimit; i++)
        if (!(request->limit[i].limit >= 0))
            return cn_fail(&run->error, CN_FAULT_VALUE, NULL, 0,
                           "limit on %s is %g: give a number that is not negative",
                           cn_quantity_name(request->limit[i].quantity), request->limit[i].limit);
    if (request->waypoint) {
        if (request->nwaypoint < 2)
            return cn_fail(&run->error, CN_FAULT_TOO_FEW, NULL, 0,
                           "%d waypoint%s given: the first is the entry, so at least two are needed",
                           request->nwaypoint, request->nwaypoint == 1 ? "" : "s");
        for (int i = 0; i < 3 * request->nwaypoint; i++)
            if (!isfinite(request->waypoint[i]))
                return cn_fail(&run->error, CN_FAULT_VALUE, NULL, 0,
                               "waypoint %d has coordinate %c = %g: give finite metres", i / 3, 'x' + i % 3,
                               request->waypoint[i]);
        const size_t n = 3 * (size_t)(request->nwaypoint - 1);
        if (!(run->waypoint = malloc(n * sizeof *run->waypoint))) return CN_ERR_MEMORY;
        memcpy(run->waypoint, request->waypoint + 3, n * sizeof *run->waypoint);
        device->waypoint = run->waypoint, device->nwaypoint = request->nwaypoint - 1;
        if (device->shape.kind == CN_SHAPE_CATHETER) {
            cn_copy3(request->waypoint, device->shape.catheter.entry);
            memset(device->shape.catheter.direction, 0,
                   sizeof device->shape.catheter.direction); /* the path's */
            device->shape.catheter.inserted = 0;
        }
    }
    return add_limits(run, device);
}

static cn_status unsupported(cn_run_data *run, const char *who, const char *what, const char *instead)
{
    return cn_fail(&run->error, CN_FAULT_UNSUITED, run->scene->path, 0,
                   "%s: %s is not available in this version: %s", who, what, instead);
}

cn_status cn_run_supported(cn_run_data *run)
{
    const cn_scene *scene = run->scene;
    for (int b = 0; b < run->nbody; b++) {
        const cn_body_spec *body = &run->spec[b];
        if ((body->model == CN_BODY_ROD || body->model == CN_BODY_MOLECULES) &&
            scene->contact.method == CN_CONTACT_PROJECT)
            return unsupported(run, body->name,
                               "contact.method project, which moves nodes, for a rod or molecules",
                               "use strict, or model: tet4");
        if (scene->solver.integrator == CN_INTEGRATOR_EXPLICIT && body->model != CN_BODY_MOLECULES)
            return unsupported(run, body->name, "integrator: explicit for another model than molecules",
                               "use integrator: euler, or model: molecules");
        const bool sheath = body->shape.catheter.sheath == CN_ON ||
                            (body->shape.catheter.sheath == CN_AUTO && scene->nvessel > 0);
        const cn_status status = cn_push_check(body, sheath, &run->error);
        if (status != CN_OK) return status;
        if (body->shape.kind == CN_SHAPE_CATHETER && body->shape.catheter.has_core &&
            body->model != CN_BODY_ROD)
            return unsupported(run, body->name, "a guidewire core in tetrahedra", "use model: rod");
    }
    if (scene->contact.method == CN_CONTACT_PENALTY && scene->solver.integrator != CN_INTEGRATOR_EULER &&
        scene->solver.integrator != CN_INTEGRATOR_EXPLICIT)
        return unsupported(run, "contact.method", "penalty with midpoint or trbdf2",
                           "use integrator: euler, or method: strict");
    if (scene->contact.friction > 0 && scene->contact.method != CN_CONTACT_STRICT)
        return unsupported(run, "contact.friction", "friction without strict contact",
                           "use method: strict, or friction: 0");
    if (scene->contact.friction > 0 && scene->solver.integrator != CN_INTEGRATOR_EULER)
        return unsupported(run, "contact.friction", "friction with another integrator than euler",
                           "use integrator: euler, or friction: 0");
    if (scene->contact.response == CN_RESPONSE_ELASTIC && scene->contact.method == CN_CONTACT_STRICT &&
        scene->solver.integrator != CN_INTEGRATOR_EULER)
        return unsupported(run, "contact.response", "an elastic response with another integrator than euler",
                           "use integrator: euler, or response: inelastic");
    return CN_OK;
}

cn_status cn_run_explicit(cn_run_data *run)
{
    if (run->model->integrator != CN_INTEGRATOR_EXPLICIT) return CN_OK;
    for (int b = 0; b < run->nbody; b++) {
        const cn_body *body = run->model->body[b].body;
        const double stable = 0.9 * cn_molecules_stable_step(body, body->rest, run->pool),
                     n = run->model->dt / stable;
        if (!(n <= CN_SUBSTEPS_MAX))
            return cn_fail(&run->error, CN_FAULT_UNSUITED, run->scene->path, 0,
                           "%s: explicit steps of its springs are stable up to %.3g s, and one of %g s would "
                           "take %.3g of them: use integrator: euler",
                           run->spec[b].name, stable, run->model->dt, n);
        CN_LOG(CN_LOG_INFO, "%s: %.0f explicit steps of at most %.3g s in each of %g s", run->spec[b].name,
               fmax(1, ceil(n)), stable, run->model->dt);
    }
    return CN_OK;
}

/* Refuses a point that lies outside by more than `near`. `what` heads the sentence. */
static cn_status must_be_free(cn_run_data *run, const double p[3], double near, const char *what)
{
    if (cn_world_free_at(run->world, p)) return CN_OK;
    const double d = cn_world_distance(run->world, p, NULL, NULL, NULL);
    if (d <= near) return CN_OK;
    return cn_fail(&run->error, CN_FAULT_PLACE, NULL, 0,
                   "%s [%g %g %g] m lies outside the free space, %g m from the nearest wall: move it inside",
                   what, p[0], p[1], p[2], d);
}

void cn_run_no_start(cn_run_data *run, int b, double depth, const double where[3], const char *format, ...)
{
    char what[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    cn_verdict *verdict = &run->report->verdict;
    cn_run_verdict(run, CN_VERDICT_NO_CONTACT_FREE_START,
                   "%s starts in contact: %s, %.3g m deep, near [%.4f %.4f %.4f] m: move its start",
                   run->spec[b].name, what, depth, where[0], where[1], where[2]);
    snprintf(verdict->body, sizeof verdict->body, "%s", run->spec[b].name);
    verdict->has_quantity = true, verdict->quantity = CN_QUANTITY_CLEARANCE;
    verdict->value = -depth, verdict->limit = 0;
    cn_copy3(where, verdict->position);
}

bool cn_run_swallowed(cn_run_data *run, int b)
{
    const cn_body *body = cn_touch_body(&run->model->body[b]);
    double min[3], max[3], nearest[3];
    cn_tree *tree;
    bool found = false;
    int tri;
    /* a chain this thin holds nothing; a wall's neighbours are the scene's own affair */
    if (run->model->body[b].sheath || run->spec[b].wall) return false;
    if (cn_tree_new(&tree, body->boundary->ntri, body->boundary->tri,
                    cn_run_met(run, b, run->state, body->nnode)) != CN_OK)
        return false;
    cn_tree_box(tree, min, max);
    for (int w = 0; w < run->world->nwall && !found; w++)
        for (int i = 0; i < run->world->wall[w].surface->nvert && !found; i++) {
            const double *p = run->world->wall[w].surface->vert + 3 * i;
            if (p[0] < min[0] || p[1] < min[1] || p[2] < min[2] || p[0] > max[0] || p[1] > max[1] ||
                p[2] > max[2])
                continue;
            if (!cn_tree_inside(tree, NULL, p)) continue;
            const double depth = cn_tree_nearest(tree, p, INFINITY, &tri, nearest);
            cn_run_no_start(run, b, depth, p, "it holds vertex %d of %.60s", i, run->world->wall[w].name);
            found = true;
        }
    cn_tree_free(tree);
    return found;
}

/* A catheter laid along a given direction: the ring of its tip at the entry must lie in the free space. */
static cn_status ring_is_free(cn_run_data *run, int b)
{
    const cn_body_spec *body = &run->spec[b];
    const double r = 0.5 * body->shape.catheter.diameter, *t = body->shape.catheter.direction;
    double n[3], m[3], deepest = 0, where[3] = {NAN, NAN, NAN};
    int wall = 0, triangle = 0;
    if (run->world->nvessel == 0 || run->scene->contact.method != CN_CONTACT_STRICT || !(cn_norm(t) > 0))
        return CN_OK;
    cn_any_normal(t, n);
    cn_cross(t, n, m);
    for (int k = 0; k < 16; k++) {
        double p[3];
        const double angle = k * acos(-1.0) / 8;
        cn_copy3(body->shape.catheter.entry, p);
        cn_axpy(1e-3 * r, t, p);
        cn_axpy(r * cos(angle), n, p), cn_axpy(r * sin(angle), m, p);
        if (cn_world_free_at(run->world, p)) continue;
        int iwall, itri;
        const double depth = cn_world_distance(run->world, p, &iwall, &itri, NULL);
        if (depth > deepest) deepest = depth, wall = iwall, triangle = itri, cn_copy3(p, where);
    }
    if (deepest == 0) return CN_OK;
    cn_run_no_start(run, b, deepest, where, "the ring of its tip at the entry cuts %.60s (wall triangle %d)",
                    run->world->wall[wall].name, triangle);
    return CN_ERR_ARG;
}

cn_status cn_run_places(cn_run_data *run)
{
    cn_status status;
    if (run->world->nwall == 0) return CN_OK;
    for (int b = 0; b < run->nbody; b++) {
        const cn_body_spec *body = &run->spec[b];
        const double near = body->shape.kind == CN_SHAPE_CATHETER ? 0.005 * body->shape.catheter.diameter : 0;
        if (body->shape.kind == CN_SHAPE_CATHETER &&
            (status = cn_world_fits(run->world, body->shape.catheter.diameter, &run->error)) != CN_OK)
            return status;
        if (body->shape.kind == CN_SHAPE_CATHETER && run->world->nvessel > 0 &&
            (status = must_be_free(run, body->shape.catheter.entry, 0.01 * body->shape.catheter.diameter,
                                   "the entry")) != CN_OK)
            return status;
        if (body->shape.kind == CN_SHAPE_CATHETER && (status = ring_is_free(run, b)) != CN_OK) return status;
        for (int i = 0; i < body->nwaypoint; i++) {
            char what[96];
            snprintf(what, sizeof what, "waypoint %d of %.60s", run->waypoint ? i + 1 : i, body->name);
            if ((status = must_be_free(run, body->waypoint + 3 * i, near, what)) != CN_OK) return status;
        }
    }
    return CN_OK;
}
