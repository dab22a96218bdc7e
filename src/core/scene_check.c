/* Contradictions between keys of one map, and between parts of a scene. Each is called after all keys of its
 * map have been read and are in range. */
#include "scene_reader.h"
#include "catnav/vec3.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_NODES 2000000 /* of one generated mesh: a run takes about 10 kB a node */

static cn_status check_nodes(struct cn_reader *reader, int node, const char *key, double nodes)
{
    if (nodes <= MOST_NODES) return CN_OK;
    return cn_reader_refuse(reader, CN_FAULT_TOO_LARGE, node, key,
                            "they make a mesh of %.0f nodes, and at most %d fit into memory (about 10 kB "
                            "each): make it coarser",
                            nodes, MOST_NODES);
}

cn_status cn_check_catheter(struct cn_reader *reader, int node, void *base)
{
    const cn_shape *shape = base;
    if (!(shape->catheter.inner_diameter < shape->catheter.diameter))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "inner_diameter",
                                "%.10g m is not below the diameter, %.10g m", shape->catheter.inner_diameter,
                                shape->catheter.diameter);
    if (!(shape->catheter.inserted <= shape->catheter.length))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "inserted",
                                "%.10g m is more than the length, %.10g m", shape->catheter.inserted,
                                shape->catheter.length);
    if (shape->catheter.has_core && !(shape->catheter.core_diameter <= shape->catheter.diameter))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "core",
                                "its diameter, %.10g m, is above the catheter's, %.10g m",
                                shape->catheter.core_diameter, shape->catheter.diameter);
    const double per = shape->catheter.inner_diameter > 0 ? 2.0 * shape->catheter.sides /* two rings */
                                                          : shape->catheter.sides + 1.0;
    return check_nodes(reader, node, "stations", shape->catheter.stations * per);
}

cn_status cn_check_beam(struct cn_reader *reader, int node, void *base)
{
    const int *cells = ((const cn_shape *)base)->beam.cells;
    return check_nodes(reader, node, "cells", (cells[0] + 1.0) * (cells[1] + 1.0) * (cells[2] + 1.0));
}

cn_status cn_check_box(struct cn_reader *reader, int node, void *base)
{
    const cn_shape *shape = base;
    for (int i = 0; i < 3; i++)
        if (!(shape->box.min[i] < shape->box.max[i]))
            return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "max",
                                    "its %c, %.10g, is not above the one of min, %.10g", "xyz"[i],
                                    shape -> box.max[i], shape->box.min[i]);
    return CN_OK;
}

cn_status cn_check_tube(struct cn_reader *reader, int node, void *base)
{
    const cn_shape *shape = base;
    if (shape->tube.nradius != 1 && shape->tube.nradius != shape->tube.naxis)
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "radius",
                                "%d of them for %d points: give one, or one a point", shape->tube.nradius,
                                shape->tube.naxis);
    for (int i = 1; i < shape->tube.naxis; i++)
        if (!memcmp(&shape->tube.axis[3 * i], &shape->tube.axis[3 * i - 3], 3 * sizeof(double)))
            return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "axis", "points %d and %d are the same",
                                    i - 1, i);
    for (int i = 0; i < shape->tube.nradius; i++)
        if (!(shape->tube.thickness < shape->tube.radius[i]))
            return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "thickness",
                                    "%.10g m is not below the radius, %.10g m", shape->tube.thickness,
                                    shape->tube.radius[i]);
    return CN_OK;
}

cn_status cn_check_wall(struct cn_reader *reader, int node, void *base)
{
    const cn_wall_spec *wall = base;
    static const char *const needed[] = {"thickness", "young", "poisson", "density", "foundation"};
    if (wall->model == CN_WALL_RIGID) return CN_OK;
    const bool membrane = wall->model == CN_WALL_MEMBRANE;
    for (int i = 0; i < (membrane ? 5 : 4); i++)
        if (cn_yaml_find(&reader->tree, node, needed[i]) < 0)
            return cn_reader_refuse(reader, CN_FAULT_NEEDED, node, NULL, "a %s wall needs the key \"%s\"",
                                    membrane ? "membrane" : "shell", needed[i]);
    if (membrane && !(wall->foundation > 0))
        return cn_reader_refuse(reader, CN_FAULT_NEEDED, node, "foundation",
                                "a membrane needs one above 0 Pa/m");
    return CN_OK;
}

cn_status cn_check_obstacle(struct cn_reader *reader, int node, void *base)
{
    cn_surface_spec *obstacle = base;
    const bool moves = obstacle->npath > 0,
               soft = obstacle->deformable || obstacle->wall.model != CN_WALL_RIGID;
    if (moves && soft)
        return cn_reader_refuse(reader, CN_FAULT_UNSUITED, node, "path",
                                "only a rigid obstacle moves along a path");
    if (soft && obstacle->shape.kind == CN_SHAPE_PLANE)
        return cn_reader_refuse(reader, CN_FAULT_UNSUITED, node, NULL, "a plane is rigid: it has no end");
    if (obstacle->model == CN_BODY_AUTO) obstacle->model = CN_BODY_TET4;
    return CN_OK;
}

cn_status cn_check_limit(struct cn_reader *reader, int node, void *base)
{
    const cn_limit *limit = base;
    if (limit->reduce == CN_REDUCE_MEAN && limit->quantity != CN_QUANTITY_VOLUME &&
        limit->quantity != CN_QUANTITY_STRESS)
        return cn_reader_refuse(reader, CN_FAULT_UNSUITED, node, "reduce", "%s has no mean, only a max",
                                cn_quantity_name(limit->quantity));
    return CN_OK;
}

cn_status cn_check_load(struct cn_reader *reader, int node, void *base)
{
    const cn_load *load = base;
    if (cn_yaml_find(&reader->tree, node, "force") < 0 && cn_yaml_find(&reader->tree, node, "moment") < 0)
        return cn_reader_refuse(reader, CN_FAULT_NEEDED, node, NULL, "a load needs a force or a moment");
    if (!(load->until > load->from))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "until", "%.10g s is not after from, %.10g s",
                                load->until, load->from);
    return CN_OK;
}

cn_status cn_check_path(struct cn_reader *reader, int node, void *base)
{
    const cn_path_spec *path = base;
    if (path->region == CN_REGION_BAND && !(path->band_min < path->band_max))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "region",
                                "the band's max, %.10g m, is not above its min, %.10g m", path->band_max,
                                path->band_min);
    for (int i = 0; i < 3; i++)
        if (path->region == CN_REGION_BOX && !(path->box[0][i] <= path->box[1][i]))
            return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "region",
                                    "the box's max %c, %.10g, is below its min, %.10g", "xyz"[i],
                                    path -> box[1][i], path -> box[0][i]);
    return CN_OK;
}

cn_status cn_check_body(struct cn_reader *reader, int node, void *base)
{
    cn_body_spec *body = base;
    const bool catheter = body->shape.kind == CN_SHAPE_CATHETER;
    if (body->model == CN_BODY_AUTO && !catheter) body->model = CN_BODY_TET4;
    if (body->model == CN_BODY_ROD && !catheter && body->shape.kind != CN_SHAPE_BEAM)
        return cn_reader_refuse(reader, CN_FAULT_UNSUITED, node, "model",
                                "a rod needs an axis: the shape must be a catheter or a beam");
    for (int i = 0; i < body->material.nregion; i++)
        if (!body->material.region[i].by_box && !catheter)
            return cn_reader_refuse(reader, CN_FAULT_UNSUITED, node, "material",
                                    "region %d is given along the axis, but only a catheter has one", i);
    if (body->deadline < INFINITY && body->nwaypoint == 0)
        return cn_reader_refuse(reader, CN_FAULT_NEEDED, node, "deadline",
                                "there are no waypoints to reach by it");
    return CN_OK;
}

typedef struct {
    const char *name;
    int node, order;
} named_t;

static int by_name(const void *a, const void *b)
{
    const named_t *x = a, *y = b;
    const int c = strcmp(x->name, y->name);
    return c ? c : x->order - y->order;
}

/* Where a character that ends a line or steers a terminal stands in UTF-8 text, -1: nowhere. */
static int control_character(const char *text)
{
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        const bool c1 = c[0] == 0xc2 && c[1] >= 0x80 && c[1] <= 0x9f,                   /* U+0080 to U+009F */
            separator = c[0] == 0xe2 && c[1] == 0x80 && (c[2] == 0xa8 || c[2] == 0xa9); /* U+2028, U+2029 */
        if (*c < ' ' || *c == 127 || c1 || separator) return (int)(c - (const unsigned char *)text);
    }
    return -1;
}

/* What the other integrators than euler are not made for. */
static cn_status check_integrator(struct cn_reader *reader, int node, const cn_scene *scene)
{
    static const char *const names[] = {"euler", "midpoint", "trbdf2", "explicit"};
    const int solver = cn_yaml_find(&reader->tree, node, "solver");
    const char *const name = names[scene->solver.integrator];
    if (scene->solver.integrator == CN_INTEGRATOR_EULER) return CN_OK;
    cn_reader_enter(reader, "solver");
#define REFUSE(...) cn_reader_refuse(reader, CN_FAULT_UNSUITED, solver, "integrator", __VA_ARGS__)
    if (scene->solver.newton == 1)
        return REFUSE("the paper's single solve (newton: 1) is Euler's, not one of %s", name);
    if (scene->leave_out.inertia == CN_ON)
        return REFUSE("with inertia left out each step is an equilibrium, which %s does not find: use euler",
                      name);
    for (int b = 0; b < scene->nbody; b++)
        if (!(scene->body[b].material.density > 0))
            return REFUSE("the density of \"%s\" is 0, so that each step is an equilibrium, which %s does "
                          "not find: use euler",
                          scene->body[b].name, name);
    if (scene->solver.integrator == CN_INTEGRATOR_MIDPOINT && scene->contact.method == CN_CONTACT_STRICT &&
        scene->nvessel + scene->nobstacle > 0)
        return REFUSE("strict contact is solved for where a step is evaluated, and midpoint ends elsewhere: "
                      "use euler or trbdf2");
    if (scene->solver.integrator != CN_INTEGRATOR_EXPLICIT) return CN_OK;
    if ((scene->contact.method == CN_CONTACT_STRICT || scene->contact.method == CN_CONTACT_PROJECT) &&
        (scene->nvessel + scene->nobstacle > 0 || scene->nbody > 1 || scene->contact.self == CN_ON))
        return REFUSE("explicit steps are pushed out of what they meet, by contact.method: penalty, or meet "
                      "nothing (none); for strict contact, which is solved for, use euler");
    for (int b = 0; b < scene->nbody; b++)
        if (scene->body[b].model != CN_BODY_MOLECULES)
            return REFUSE("explicit steps are for springs between molecules, and \"%s\" is of another "
                          "model: use euler, or model: molecules",
                          scene->body[b].name);
#undef REFUSE
    return CN_OK;
}

/* Names of vessels, obstacles and bodies are one line of text and unique: limits, frames and reports speak of
 * them by name. */
static cn_status check_names(struct cn_reader *reader, int node, const cn_scene *scene)
{
    static const char *const lists[] = {"vessels", "obstacles", "bodies"};
    const int count[] = {scene->nvessel, scene->nobstacle, scene->nbody};
    const int n = count[0] + count[1] + count[2];
    named_t *named = calloc((size_t)n + 1, sizeof *named);
    cn_status status = CN_OK;
    int k = 0;

    if (!named) return CN_ERR_MEMORY;
    for (int i = 0; i < 3; i++) {
        const int list = cn_yaml_find(&reader->tree, node, lists[i]);
        int entry = list < 0 ? -1 : reader->tree.node[list].first;
        for (int j = 0; j < count[i] && entry >= 0; j++, k++, entry = reader->tree.node[entry].next)
            named[k] = (named_t){i == 0   ? scene->vessel[j].name
                                 : i == 1 ? scene->obstacle[j].name
                                          : scene->body[j].name,
                                 entry, k};
    }
    for (int i = 0; i < k && status == CN_OK; i++) {
        const int at = control_character(named[i].name);
        if (at >= 0)
            status = cn_reader_refuse(reader, CN_FAULT_NAME, named[i].node, "name",
                                      "a control character or line end (byte %d) stands in it", at);
    }
    qsort(named, (size_t)k, sizeof *named, by_name);
    for (int i = 1; i < k && status == CN_OK; i++)
        if (!strcmp(named[i].name, named[i - 1].name))
            status = cn_reader_refuse(reader, CN_FAULT_NAME, named[i].node, "name",
                                      "\"%s\" is already another's name", named[i].name);
    free(named);
    return status;
}

static bool has_surface(const cn_scene *scene, const char *name)
{
    for (int i = 0; i < scene->nvessel; i++)
        if (!strcmp(scene->vessel[i].name, name)) return true;
    for (int i = 0; i < scene->nobstacle; i++)
        if (!strcmp(scene->obstacle[i].name, name)) return true;
    return false;
}

cn_status cn_check_scene(struct cn_reader *reader, int node, void *base)
{
    cn_scene *scene = base;
    const int bodies = cn_yaml_find(&reader->tree, node, "bodies");
    int entry = reader->tree.node[bodies].first;
    cn_status status;

    if (!(scene->step <= scene->time_limit))
        return cn_reader_refuse(reader, CN_FAULT_AT_ODDS, node, "step",
                                "%.10g s is longer than the time limit, %.10g s", scene->step,
                                scene->time_limit);
    if ((status = check_names(reader, node, scene)) != CN_OK) return status;
    if ((status = check_integrator(reader, node, scene)) != CN_OK) return status;
    for (int i = 0; i < scene->nbody; i++, entry = reader->tree.node[entry].next) {
        cn_path_spec *path = &scene->body[i].path;
        /* a rod has no nodes on its surface that these could move or push */
        if (scene->body[i].model == CN_BODY_AUTO)
            scene->body[i].model =
                scene->contact.method == CN_CONTACT_PROJECT || scene->contact.method == CN_CONTACT_PENALTY
                    ? CN_BODY_TET4
                    : CN_BODY_ROD;
        if ((int)path->sampling == CN_AUTO)
            path->sampling = scene->nvessel ? CN_SAMPLING_MEDIAL_AXIS : CN_SAMPLING_UNIFORM;
        if (path->region == CN_REGION_BAND && !has_surface(scene, path->band_surface))
            return cn_reader_refuse(reader, CN_FAULT_UNNAMED, entry, "path",
                                    "the band's surface \"%s\" is no vessel or obstacle", path->band_surface);
    }
    return CN_OK;
}
