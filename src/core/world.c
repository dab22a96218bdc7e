#include "catnav/world.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "tree.h"
#include "world.h"

enum { TUBE_SIDES = 48 };

static void grow(double min[3], double max[3], const double p[3], double reach)
{
    for (int k = 0; k < 3; k++)
        min[k] = fmin(min[k], p[k] - reach), max[k] = fmax(max[k], p[k] + reach);
}

/* --- one surface of the scene --- */

static cn_status tube_new(cn_surface **out, const cn_shape *shape, bool vessel, const char *name,
                          cn_error *error)
{
    const int n = shape->tube.naxis, nradius = shape->tube.nradius;
    if (n < 2 || (nradius != 1 && nradius != n))
        return cn_fail(error, CN_FAULT_AT_ODDS, NULL, 0,
                       "%s: a tube of %d axis points takes 1 or %d radii, not %d", name, n, n, nradius);
    double *radius = malloc((size_t)n * sizeof *radius);
    if (!radius) return CN_ERR_MEMORY;
    for (int i = 0; i < n; i++)
        radius[i] = shape->tube.radius[nradius == 1 ? 0 : i];
    /* the free space of a vessel is inside its inner surface */
    const cn_status status =
        cn_surface_tube(out, n, shape->tube.axis, radius, vessel ? 0 : shape->tube.thickness, TUBE_SIDES);
    free(radius);
    return status;
}

static cn_status shape_new(cn_surface **out, const cn_shape *shape, bool vessel, double extent,
                           const char *name, cn_error *error)
{
    switch (shape->kind) {
    case CN_SHAPE_FILE:
        return cn_surface_read(out, shape->file, error);
    case CN_SHAPE_SPHERE:
        return cn_surface_sphere(out, shape->sphere.centre, shape->sphere.radius);
    case CN_SHAPE_BOX:
        return cn_surface_box(out, shape->box.min, shape->box.max);
    case CN_SHAPE_PLANE:
        return cn_surface_plane(out, shape->plane.point, shape->plane.normal, extent);
    case CN_SHAPE_TUBE:
        return tube_new(out, shape, vessel, name, error);
    default:
        return cn_fail(error, CN_FAULT_UNSUITED, NULL, 0,
                       "%s: a wall is a file, sphere, box, plane or tube, not a catheter or beam", name);
    }
}

static double scale_of(const cn_placement *placement)
{
    return placement->scale > 0 ? placement->scale : 1;
}

/* Reads and places the wall's surface, or copies the one given in its stead. */
static cn_status surface_new(cn_wall *wall, const cn_shape *shape, const cn_surface *given, double extent,
                             cn_error *error)
{
    if (given) return cn_surface_copy(&wall->surface, given);
    cn_placement placement = shape->placement;
    placement.scale = scale_of(&placement);
    cn_status status =
        shape_new(&wall->surface, shape, wall->vessel, extent / placement.scale, wall->name, error);
    if (status == CN_ERR_ARG)
        return cn_fail(error, CN_FAULT_AT_ODDS, NULL, 0,
                       "%s: the shape has no size, or a number that is not finite", wall->name);
    if (status != CN_OK) return status;
    cn_place_points(&placement, wall->surface->nvert, wall->surface->vert);
    if (shape->kind == CN_SHAPE_PLANE) {
        double ends[6];
        cn_copy3(shape->plane.point, ends);
        cn_add(shape->plane.point, shape->plane.normal, ends + 3);
        cn_place_points(&placement, 2, ends);
        wall->half_space = true;
        cn_copy3(ends, wall->plane);
        cn_sub(ends + 3, ends, wall->plane + 3);
        cn_normalise(wall->plane + 3);
    }
    return CN_OK;
}

static cn_status wall_make(cn_wall *wall, const cn_surface_spec *spec, bool vessel, const cn_surface *given,
                           double extent, cn_error *error)
{
    cn_status status;
    const char *name = spec->name && *spec->name ? spec->name : vessel ? "vessel" : "obstacle";
    if (!(wall->name = malloc(strlen(name) + 1))) return CN_ERR_MEMORY;
    strcpy(wall->name, name);
    wall->vessel = vessel, wall->spec = spec;
    if (vessel && spec->shape.kind == CN_SHAPE_PLANE && !given)
        return cn_fail(error, CN_FAULT_UNSUITED, NULL, 0, "%s: a plane has no inside, make it an obstacle",
                       wall->name);
    if ((status = surface_new(wall, &spec->shape, given, extent, error)) != CN_OK) return status;
    if ((status = cn_surface_check(wall->surface, !wall->half_space, &wall->doctor, error)) != CN_OK)
        return status;
    if ((status = cn_doctor_wall(&wall->doctor, wall->name, error)) != CN_OK) return status;
    wall->closed = wall->doctor.closed;
    if (vessel && !(wall->doctor.volume > 0))
        return cn_fail(error, CN_FAULT_TURNED, NULL, 0,
                       "%s: encloses no volume (%g m^3), nothing can move inside it", wall->name,
                       wall->doctor.volume);
    if (vessel && !wall->closed && (status = cn_wall_cap(wall)) != CN_OK) return status;
    const cn_surface *surface = wall->surface;
    double min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int v = 0; v < surface->nvert; v++)
        grow(min, max, surface->vert + 3 * (size_t)v, 0);
    for (int k = 0; k < 3; k++)
        wall->middle[k] = 0.5 * (min[k] + max[k]);
    return cn_tree_new(&wall->tree, surface->ntri, surface->tri, surface->vert);
}

static void wall_clear(cn_wall *wall)
{
    free(wall->name);
    cn_surface_free(wall->surface), cn_surface_free(wall->caps);
    cn_tree_free(wall->tree), cn_tree_free(wall->cap_tree);
    free(wall->cap_of), free(wall->cap);
}

/* --- the world --- */

static bool is_plane(const cn_surface_spec *spec)
{
    return spec->shape.kind == CN_SHAPE_PLANE;
}

/* Which vessel each replacement stands for. */
static cn_status match(const cn_scene *scene, int n, const cn_replacement *replacement,
                       const cn_surface **given, cn_error *error)
{
    for (int i = 0; i < n; i++) {
        const char *name = replacement[i].name ? replacement[i].name : "";
        int found = *name || scene->nvessel != 1 ? -1 : 0;
        for (int v = 0; v < scene->nvessel && *name; v++)
            if (scene->vessel[v].name && !strcmp(scene->vessel[v].name, name)) found = v;
        if (found < 0 && !*name)
            return cn_fail(
                error, CN_FAULT_UNNAMED, NULL, 0,
                "a surface without a name takes the place of the only vessel, but the scene has %d",
                scene->nvessel);
        if (found < 0)
            return cn_fail(error, CN_FAULT_UNNAMED, NULL, 0, "no vessel of the scene is named %s", name);
        given[found] = replacement[i].surface;
    }
    return CN_OK;
}

static void grow_by_bodies(cn_world *world)
{
    const cn_scene *scene = world->scene;
    for (int b = 0; b < scene->nbody; b++) {
        const cn_body_spec *body = scene->body + b;
        if (body->shape.kind == CN_SHAPE_CATHETER)
            grow(world->min, world->max, body->shape.catheter.entry, 0);
        for (int i = 0; i < body->nwaypoint; i++)
            grow(world->min, world->max, body->waypoint + 3 * i, 0);
    }
}

/* Where bodies begin, and how far their start velocity may take them: what a plane must lie under. */
static double bodies_reach(const cn_scene *scene, double min[3], double max[3])
{
    double run = 0;
    for (int b = 0; b < scene->nbody; b++) {
        const cn_body_spec *body = scene->body + b;
        cn_placement placement = body->shape.placement;
        double corner[6] = {0, 0, 0, 0, 0, 0};
        placement.scale = scale_of(&placement);
        for (int k = 0; k < 3; k++) {
            if (body->shape.kind == CN_SHAPE_BEAM) corner[3 + k] = body->shape.beam.size[k];
            if (body->shape.kind == CN_SHAPE_BOX)
                corner[k] = body->shape.box.min[k], corner[3 + k] = body->shape.box.max[k];
            if (body->shape.kind == CN_SHAPE_SPHERE) corner[k] = corner[3 + k] = body->shape.sphere.centre[k];
        }
        cn_place_points(&placement, 2, corner);
        const double reach = cn_distance(corner, corner + 3) + placement.scale * body->shape.sphere.radius;
        grow(min, max, corner, reach), grow(min, max, corner + 3, reach);
        run = fmax(run, cn_norm(body->velocity) * scene->time_limit);
    }
    return run;
}

cn_status cn_world_new(cn_world **out, const cn_scene *scene, int nreplacement,
                       const cn_replacement *replacement, cn_error *error)
{
    cn_status status = CN_ERR_MEMORY;
    cn_world *world = calloc(1, sizeof *world);
    const cn_surface **given = calloc((size_t)scene->nvessel + 1, sizeof *given);
    *out = NULL;
    if (!world || !given) goto done;
    world->scene = scene;
    world->nvessel = scene->nvessel;
    if (!(world->wall = calloc((size_t)scene->nvessel + (size_t)scene->nobstacle + 1, sizeof *world->wall)))
        goto done;
    for (int k = 0; k < 3; k++)
        world->min[k] = INFINITY, world->max[k] = -INFINITY;
    if ((status = match(scene, nreplacement, replacement, given, error)) != CN_OK) goto done;

    world->nwall = scene->nvessel + scene->nobstacle; /* half-built walls can be cleared */
    grow_by_bodies(world);
    for (int planes = 0; planes < 2; planes++) { /* planes last: they are as large as the rest asks for */
        double low[3], high[3];
        cn_copy3(world->min, low), cn_copy3(world->max, high);
        const double run = bodies_reach(scene, low, high), size = cn_distance(low, high) + run;
        for (int i = 0; i < world->nwall; i++) {
            const bool vessel = i < scene->nvessel;
            const cn_surface_spec *spec = vessel ? scene->vessel + i : scene->obstacle + (i - scene->nvessel);
            if (is_plane(spec) != planes) continue;
            double extent = 1e4;
            if (size > 0 && size < INFINITY && planes) {
                double centre[3], point[3];
                for (int k = 0; k < 3; k++)
                    centre[k] = 0.5 * (low[k] + high[k]), point[k] = spec->shape.plane.point[k];
                cn_placement placement = spec->shape.placement;
                placement.scale = scale_of(&placement);
                cn_place_points(&placement, 1, point);
                extent = 100 * (size + cn_distance(centre, point));
            }
            if ((status = wall_make(world->wall + i, spec, vessel, vessel ? given[i] : NULL, extent,
                                    error)) != CN_OK)
                goto done;
            const cn_surface *surface = world->wall[i].surface;
            double radius = 0;
            for (int v = 0; v < surface->nvert && !planes; v++) {
                const double *p = surface->vert + 3 * (size_t)v;
                grow(world->min, world->max, p, 0);
                radius = fmax(radius, cn_distance(p, world->wall[i].middle));
            }
            for (int p = 0; p < spec->npath && !planes; p++)
                grow(world->min, world->max, spec->path + 3 * p, radius);
        }
    }
    for (int k = 0; k < 3; k++)
        if (!(world->min[k] <= world->max[k])) world->min[k] = world->max[k] = 0;
    status = CN_OK;
done:
    free(given);
    if (status == CN_OK) {
        *out = world;
        return CN_OK;
    }
    cn_world_free(world);
    return cn_fail(error, status, NULL, 0, "the walls cannot be prepared: %s", cn_status_text(status));
}

void cn_world_free(cn_world *world)
{
    if (!world) return;
    if (world->octree && world->octree_free) world->octree_free(world->octree);
    for (int i = 0; i < world->nwall && world->wall; i++)
        wall_clear(world->wall + i);
    free(world->wall);
    cn_map_free(world->map);
    free(world);
}
