/* run_door.c - what a request changes, and what is refused before anything moves. */
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

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

cn_status cn_run_specs(cn_run_data *run)
{
    const cn_scene *scene = run->scene;
    const cn_request *request = run->request;
    run->nbody = scene->nbody;
    run->spec = malloc(((size_t)scene->nbody + 1) * sizeof *run->spec);
    if (!run->spec) return CN_ERR_MEMORY;
    memcpy(run->spec, scene->body, (size_t)scene->nbody * sizeof *run->spec);
    run->seed = scene->seed, run->budget = scene->planner.budget;
    if (!request) return CN_OK;
    if (request->seed) run->seed = *request->seed;
    if (request->budget > 0) run->budget = request->budget;
    if (run->nbody == 0)
        return cn_fail(&run->error, CN_ERR_SCENE, scene->path, 0,
                       "the scene has no body to plan for: add one under `bodies`");
    cn_body_spec *device = &run->spec[0];
    if (request->sampling) device->path.sampling = *request->sampling;
    for (int i = 0; i < request->nlimit; i++)
        if (!(request->limit[i].limit >= 0))
            return cn_fail(&run->error, CN_ERR_ARG, NULL, 0,
                           "limit on %s is %g: give a number that is not negative",
                           cn_quantity_name(request->limit[i].quantity), request->limit[i].limit);
    if (request->waypoint) {
        if (request->nwaypoint < 2)
            return cn_fail(&run->error, CN_ERR_ARG, NULL, 0,
                           "%d waypoint%s given: the first is the entry, so at least two are needed",
                           request->nwaypoint, request->nwaypoint == 1 ? "" : "s");
        for (int i = 0; i < 3 * request->nwaypoint; i++)
            if (!isfinite(request->waypoint[i]))
                return cn_fail(&run->error, CN_ERR_ARG, NULL, 0,
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
    return cn_fail(&run->error, CN_ERR_SCENE, run->scene->path, 0,
                   "%s: %s is not available in this version: %s", who, what, instead);
}

cn_status cn_run_supported(cn_run_data *run)
{
    const cn_scene *scene = run->scene;
    for (int i = 0; i < scene->nvessel + scene->nobstacle; i++) {
        const cn_surface_spec *wall =
            i < scene->nvessel ? &scene->vessel[i] : &scene->obstacle[i - scene->nvessel];
        if (wall->wall.model != CN_WALL_RIGID)
            return unsupported(run, wall->name, "a deformable wall", "use wall: {model: rigid}");
        if (wall->deformable)
            return unsupported(run, wall->name, "a deformable obstacle", "use wall: {model: rigid}");
        if (wall->npath > 0) return unsupported(run, wall->name, "a moving obstacle", "leave out its path");
    }
    for (int b = 0; b < run->nbody; b++) {
        const cn_body_spec *body = &run->spec[b];
        if (body->model != CN_BODY_TET4)
            return unsupported(run, body->name, "this body model", "use model: tet4");
        if (body->drive.mode != CN_DRIVE_FOLLOW)
            return unsupported(run, body->name, "drive mode push", "use mode: follow");
        if (body->skin_file) return unsupported(run, body->name, "a skin", "leave out `skin`");
        if (body->shape.kind == CN_SHAPE_CATHETER && body->shape.catheter.has_core)
            return unsupported(run, body->name, "a guidewire core in a tet4 catheter", "leave out `core`");
    }
    if (run->nbody > 1 && scene->contact.method != CN_CONTACT_NONE)
        return unsupported(run, "bodies", "contact between several bodies",
                           "run one body, or contact.method: none");
    if (scene->contact.method == CN_CONTACT_PENALTY)
        return unsupported(run, "contact.method", "penalty", "use strict or project");
    if (scene->contact.friction > 0)
        return unsupported(run, "contact.friction", "friction", "use friction: 0");
    if (scene->contact.self == CN_ON)
        return unsupported(run, "contact.self", "self-contact", "use self: auto");
    return CN_OK;
}

/* Refuses a point that lies outside by more than `near`. `what` heads the sentence. */
static cn_status must_be_free(cn_run_data *run, const double p[3], double near, const char *what)
{
    if (cn_world_free_at(run->world, p)) return CN_OK;
    const double d = cn_world_distance(run->world, p, NULL, NULL, NULL);
    if (d <= near) return CN_OK;
    return cn_fail(&run->error, CN_ERR_ARG, NULL, 0,
                   "%s [%g %g %g] m lies outside the free space, %g m from the nearest wall: move it inside",
                   what, p[0], p[1], p[2], d);
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
            (status = must_be_free(run, body->shape.catheter.entry, body->shape.catheter.diameter,
                                   "the entry")) != CN_OK)
            return status;
        for (int i = 0; i < body->nwaypoint; i++) {
            char what[96];
            snprintf(what, sizeof what, "waypoint %d of %.60s", run->waypoint ? i + 1 : i, body->name);
            if ((status = must_be_free(run, body->waypoint + 3 * i, near, what)) != CN_OK) return status;
        }
    }
    return CN_OK;
}
