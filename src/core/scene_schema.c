#include "scene_schema.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ANY               0, 0, ""
#define AT(s, f)          .offset = offsetof(s, f)
#define N(s, f)           .count = offsetof(s, f)
#define OF(t)             .size = sizeof(t)
#define MARK(s, f, value) .mark = offsetof(s, f), .mark_size = sizeof(((s *)0)->f), .mark_value = (value)
#define SWITCH            .choices = "auto|off|on" /* low: CN_AUTO */
#define MAP(schema)       .map = &(schema)
#define INF               HUGE_VAL

/* clang-format off */
/*   name                type            flags                    default or example   low high unit    meaning */
/* --- shapes: x = R(rotate) (scale X) + translate --- */
#define PLACEMENT \
    {"scale",     CN_KEY_REAL,   CN_ABOVE, "1",         0, INF, "m/unit", "metres per unit of the file or shape: 0.001 for millimetres", AT(cn_shape, placement.scale)}, \
    {"rotate",    CN_KEY_VECTOR, 0,        "[0, 0, 0]", -INF, INF, "rad", "rotation vector, applied after scale", AT(cn_shape, placement.rotate)}, \
    {"translate", CN_KEY_VECTOR, 0,        "[0, 0, 0]", -INF, INF, "m",   "shift, applied last", AT(cn_shape, placement.translate)}

static const cn_key surface_keys[] = {
    {"file", CN_KEY_FILE, CN_REQUIRED, "../../test/data/scenes/pipe.stl", ANY, "triangle mesh (.stl .obj .ply .msh), closed, or open at its ends", AT(cn_shape, file), MARK(cn_shape, kind, CN_SHAPE_FILE)},
    PLACEMENT, {0}};
static const cn_schema surface_schema = {surface_keys, NULL};

static const cn_key core_keys[] = {
    {"diameter", CN_KEY_REAL, CN_REQUIRED | CN_ABOVE,            "4.0e-4",   0, INF, "m",      "of the guidewire", AT(cn_shape, catheter.core_diameter)},
    {"young",    CN_KEY_REAL, CN_REQUIRED | CN_ABOVE,            "6.0e+10",  0, INF, "Pa",     "Young's modulus of the guidewire", AT(cn_shape, catheter.core_young)},
    {"poisson",  CN_KEY_REAL, CN_REQUIRED | CN_ABOVE | CN_BELOW, "0.3",     -1, 0.5, "",       "Poisson's ratio of the guidewire", AT(cn_shape, catheter.core_poisson)},
    {"density",  CN_KEY_REAL, CN_REQUIRED,                       "6450",     0, INF, "kg/m^3", "of the guidewire", AT(cn_shape, catheter.core_density)},
    {0}};
static const cn_schema core_schema = {core_keys, NULL};
static const cn_key catheter_keys[] = {
    {"length",         CN_KEY_REAL,   CN_REQUIRED | CN_ABOVE, "0.2",       0, INF, "m", "of the device", AT(cn_shape, catheter.length)},
    {"diameter",       CN_KEY_REAL,   CN_REQUIRED | CN_ABOVE, "1.35e-3",   0, INF, "m", "outer diameter", AT(cn_shape, catheter.diameter)},
    {"inner_diameter", CN_KEY_REAL,   0,                      "0",         0, INF, "m", "of the bore; 0: solid", AT(cn_shape, catheter.inner_diameter)},
    {"entry",          CN_KEY_VECTOR, 0,                      "[0, 0, 0]", -INF, INF, "m", "where it enters: in the lumen or on an open end", AT(cn_shape, catheter.entry)},
    {"direction",      CN_KEY_UNIT,   0,                      "[0, 0, 1]", -INF, INF, "", "into the vessel; any length but zero", AT(cn_shape, catheter.direction)},
    {"stations",       CN_KEY_COUNT,  0,                      "455",       2, 1e6, "", "cross-sections of the mesh along the axis", AT(cn_shape, catheter.stations)},
    {"sides",          CN_KEY_COUNT,  0,                      "6",         3, 1000, "", "corners of a cross-section", AT(cn_shape, catheter.sides)},
    {"inserted",       CN_KEY_REAL,   0,                      "0",         0, INF, "m", "how far the tip is past the entry at t = 0; the rest lies behind it along -direction", AT(cn_shape, catheter.inserted)},
    {"sheath",         CN_KEY_CHOICE, 0,                      "auto",     -1, 0, "", "introducer sheath behind the entry; auto: on where there are vessels", AT(cn_shape, catheter.sheath), SWITCH},
    {"core",           CN_KEY_MAP,    CN_UNSET,               "",          ANY, "guidewire inside, its stiffness added", MAP(core_schema), MARK(cn_shape, catheter.has_core, 1)},
    {0}};
static const cn_schema catheter_schema = {catheter_keys, cn_check_catheter};
static const cn_key beam_keys[] = {
    {"size",  CN_KEY_VECTOR, CN_REQUIRED | CN_ABOVE, "[0.1, 0.01, 0.01]", 0, INF, "m", "edges, from one corner at the origin along +x +y +z", AT(cn_shape, beam.size)},
    {"cells", CN_KEY_COUNTS, CN_REQUIRED,            "[10, 1, 1]",        1, 1e6, "", "cells along each edge", AT(cn_shape, beam.cells)},
    {0}};
static const cn_schema beam_schema = {beam_keys, cn_check_beam};
static const cn_key sphere_keys[] = {
    {"centre", CN_KEY_VECTOR, CN_REQUIRED,            "[0, 0, 0.5]", -INF, INF, "m", "of the ball", AT(cn_shape, sphere.centre)},
    {"radius", CN_KEY_REAL,   CN_REQUIRED | CN_ABOVE, "0.01",        0, INF, "m", "of the ball", AT(cn_shape, sphere.radius)},
    {0}};
static const cn_schema sphere_schema = {sphere_keys, NULL};
static const cn_key box_keys[] = {
    {"min", CN_KEY_VECTOR, CN_REQUIRED, "[0.1, 0.1, 0.1]", -INF, INF, "m", "lower corner", AT(cn_shape, box.min)},
    {"max", CN_KEY_VECTOR, CN_REQUIRED, "[0.2, 0.2, 0.2]", -INF, INF, "m", "upper corner", AT(cn_shape, box.max)},
    {0}};
static const cn_schema box_schema = {box_keys, cn_check_box};
static const cn_key body_shape_keys[] = {
    {"catheter", CN_KEY_MAP,  CN_UNSET | CN_NEEDED, "", ANY, "a straight device made of cross-sections", MAP(catheter_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_CATHETER)},
    {"file",     CN_KEY_FILE, CN_UNSET, "../../test/data/scenes/ball.obj", ANY, "tetrahedra (.node with .ele, .msh) or a closed surface, which is filled", AT(cn_shape, file), .group = 's', MARK(cn_shape, kind, CN_SHAPE_FILE)},
    {"beam",     CN_KEY_MAP,  CN_UNSET, "", ANY, "a box of tetrahedra", MAP(beam_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_BEAM)},
    {"sphere",   CN_KEY_MAP,  CN_UNSET, "", ANY, "a ball, which is filled", MAP(sphere_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_SPHERE)},
    {"box",      CN_KEY_MAP,  CN_UNSET, "", ANY, "a box along the axes, which is filled", MAP(box_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_BOX)},
    PLACEMENT,
    {"max_volume", CN_KEY_REAL, 0, "0", 0, INF, "m^3", "of a tetrahedron where a surface is filled; 0: the mesher's choice", AT(cn_shape, max_volume)},
    {0}};
static const cn_schema body_shape_schema = {body_shape_keys, NULL};

static const cn_key plane_keys[] = {
    {"point",  CN_KEY_VECTOR, CN_REQUIRED, "[0, 0, -1]", -INF, INF, "m", "on the plane", AT(cn_shape, plane.point)},
    {"normal", CN_KEY_UNIT,   CN_REQUIRED, "[0, 0, 1]",  -INF, INF, "",  "into the free side; any length but zero", AT(cn_shape, plane.normal)},
    {0}};
static const cn_schema plane_schema = {plane_keys, NULL};
static const cn_key tube_keys[] = {
    {"axis",      CN_KEY_POINTS, CN_REQUIRED,            "[[0.3, 0, 0], [0.3, 0, 0.1]]", 2, INF, "m", "points along the middle", AT(cn_shape, tube.axis), N(cn_shape, tube.naxis)},
    {"radius",    CN_KEY_REALS,  CN_REQUIRED | CN_ABOVE, "[0.01, 0.008]",                0, INF, "m", "one for all points, or one a point", AT(cn_shape, tube.radius), N(cn_shape, tube.nradius)},
    {"thickness", CN_KEY_REAL,   0,                      "0",                            0, INF, "m", "of the wall; 0: a surface", AT(cn_shape, tube.thickness)},
    {0}};
static const cn_schema tube_schema = {tube_keys, cn_check_tube};
#define SOLIDS \
    {"sphere", CN_KEY_MAP, CN_UNSET | CN_NEEDED, "", ANY, "a ball", MAP(sphere_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_SPHERE)}, \
    {"box",    CN_KEY_MAP, CN_UNSET, "", ANY, "a box along the axes", MAP(box_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_BOX)}, \
    {"tube",   CN_KEY_MAP, CN_UNSET, "", ANY, "a tube along a line of points", MAP(tube_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_TUBE)}
static const cn_key vessel_shape_keys[] = {SOLIDS, PLACEMENT, {0}};
static const cn_schema vessel_shape_schema = {vessel_shape_keys, NULL};
static const cn_key obstacle_shape_keys[] = {
    SOLIDS,
    {"plane", CN_KEY_MAP,  CN_UNSET, "", ANY, "everything behind a plane", MAP(plane_schema), .group = 's', MARK(cn_shape, kind, CN_SHAPE_PLANE)},
    {"file",  CN_KEY_FILE, CN_UNSET, "../../test/data/scenes/ball.obj", ANY, "a triangle mesh, as in `surface`", AT(cn_shape, file), .group = 's', MARK(cn_shape, kind, CN_SHAPE_FILE)},
    PLACEMENT, {0}};
static const cn_schema obstacle_shape_schema = {obstacle_shape_keys, NULL};

/* --- material, limits, held nodes: of bodies and of deformable obstacles --- */
#define BODY_MODEL .choices = CN_BODY_MODELS /* low: CN_BODY_AUTO */
static const cn_key region_keys[] = {
    {"box",   CN_KEY_BOX,   CN_UNSET | CN_NEEDED,   "[[-1, -1, -0.01], [1, 1, 0]]", -INF, INF, "m", "elements whose centre lies in it", AT(cn_region, box), .group = 'r', MARK(cn_region, by_box, 1)},
    {"along", CN_KEY_RANGE, CN_UNSET,               "[0, 0.01]", 0, INF, "m", "of a catheter, from the tip", AT(cn_region, along), .group = 'r'},
    {"young", CN_KEY_REAL,  CN_REQUIRED | CN_ABOVE, "2.0e+6", 0, INF, "Pa", "Young's modulus there", AT(cn_region, young)},
    {0}};
static const cn_schema region_schema = {region_keys, NULL};
static const cn_key material_keys[] = {
    {"young",             CN_KEY_REAL, CN_REQUIRED | CN_ABOVE,            "8.7e+6", 0, INF, "Pa", "Young's modulus", AT(cn_material, young)},
    {"poisson",           CN_KEY_REAL, CN_REQUIRED | CN_ABOVE | CN_BELOW, "0.33",  -1, 0.5, "", "Poisson's ratio", AT(cn_material, poisson)},
    {"density",           CN_KEY_REAL, CN_REQUIRED,                       "1100",   0, INF, "kg/m^3", "0: each step is a static equilibrium", AT(cn_material, density)},
    {"damping",           CN_KEY_REAL, 0,                                 "0",      0, INF, "1/s", "proportional to mass", AT(cn_material, damping)},
    {"damping_stiffness", CN_KEY_REAL, 0,                                 "0",      0, INF, "s", "proportional to stiffness", AT(cn_material, damping_stiffness)},
    {"regions",           CN_KEY_LIST, 0,                                 "[]",     ANY, "parts of another stiffness", AT(cn_material, region), N(cn_material, nregion), OF(cn_region), MAP(region_schema)},
    {0}};
static const cn_schema material_schema = {material_keys, NULL};
static const cn_key limit_keys[] = {
    {"quantity", CN_KEY_CHOICE, CN_REQUIRED, "volume", 0, 0, "", "what is limited: volume max |1 - V/V0|, stress von Mises [Pa], energy elastic [J], wall_force on one contact patch [N], clearance least gap [m]", AT(cn_limit, quantity), .choices = "volume|stress|energy|wall_force|clearance"},
    {"reduce",   CN_KEY_CHOICE, 0,           "max",    0, 0, "", "over elements; mean is for volume and stress", AT(cn_limit, reduce), .choices = "max|mean"},
    {"limit",    CN_KEY_REAL,   CN_REQUIRED, "0.2",    0, INF, "", "in the quantity's unit; clearance must stay above it, all others below", AT(cn_limit, limit)},
    {0}};
static const cn_schema limit_schema = {limit_keys, cn_check_limit};
static const cn_key fixed_keys[] = {
    {"box", CN_KEY_BOX, CN_UNSET, "[[-1, -1, -0.21], [1, 1, -0.19]]", -INF, INF, "m", "nodes in it are held", AT(cn_fixed, box), MARK(cn_fixed, set, 1)},
    {0}};
static const cn_schema fixed_schema = {fixed_keys, NULL};

/* --- vessels and obstacles --- */
static const cn_key wall_keys[] = {
    {"model",      CN_KEY_CHOICE, 0,                              "rigid",  0, 0, "", "rigid, or an elastic wall, which needs the keys below", AT(cn_wall_spec, model), .choices = "rigid|membrane|shell"},
    {"thickness",  CN_KEY_REAL,   CN_UNSET | CN_ABOVE,            "1.0e-3", 0, INF, "m", "of an elastic wall", AT(cn_wall_spec, thickness)},
    {"young",      CN_KEY_REAL,   CN_UNSET | CN_ABOVE,            "4.0e+5", 0, INF, "Pa", "Young's modulus of an elastic wall", AT(cn_wall_spec, young)},
    {"poisson",    CN_KEY_REAL,   CN_UNSET | CN_ABOVE | CN_BELOW, "0.45",  -1, 0.5, "", "Poisson's ratio of an elastic wall", AT(cn_wall_spec, poisson)},
    {"density",    CN_KEY_REAL,   CN_UNSET,                       "1060",   0, INF, "kg/m^3", "of an elastic wall", AT(cn_wall_spec, density)},
    {"foundation", CN_KEY_REAL,   CN_UNSET,                       "1.0e+7", 0, INF, "Pa/m", "stiffness of what lies behind it; > 0 for membrane", AT(cn_wall_spec, foundation)},
    {"rims",       CN_KEY_FLAG,   0,                              "free",   0, 0, "", "whether an elastic wall's open ends are held", AT(cn_wall_spec, rims_held), .choices = "free|held"},
    {0}};
static const cn_schema wall_schema = {wall_keys, cn_check_wall};
static const cn_key obstacle_body_keys[] = {
    {"model",    CN_KEY_CHOICE, 0,           "auto", -1, 0, "", "how it deforms; auto: tet4", AT(cn_surface_spec, model), BODY_MODEL},
    {"material", CN_KEY_MAP,    CN_REQUIRED, "", ANY, "elastic constants and mass", AT(cn_surface_spec, material), MAP(material_schema)},
    {"fixed",    CN_KEY_MAP,    0,           "", ANY, "held nodes", AT(cn_surface_spec, fixed), MAP(fixed_schema)},
    {0}};
static const cn_schema obstacle_body_schema = {obstacle_body_keys, NULL};
static const cn_key obstacle_path_keys[] = {
    {"waypoints", CN_KEY_POINTS, 0,        "[]",   0, INF, "m", "where a moving rigid obstacle goes", AT(cn_surface_spec, path), N(cn_surface_spec, npath)},
    {"speed",     CN_KEY_REAL,   CN_ABOVE, "0.05", 0, INF, "m/s", "along them", AT(cn_surface_spec, path_speed)},
    {0}};
static const cn_schema obstacle_path_schema = {obstacle_path_keys, NULL};
static const cn_key vessel_keys[] = {
    {"name",    CN_KEY_TEXT, CN_REQUIRED | CN_NUMBERED, "artery", 1, 63, "", "unique among vessels, obstacles and bodies", AT(cn_surface_spec, name)},
    {"surface", CN_KEY_MAP,  CN_UNSET | CN_NEEDED, "", ANY, "its wall, from a file", AT(cn_surface_spec, shape), MAP(surface_schema), .group = 'a'},
    {"shape",   CN_KEY_MAP,  CN_UNSET, "", ANY, "its wall, from a formula", AT(cn_surface_spec, shape), MAP(vessel_shape_schema), .group = 'a'},
    {"wall",    CN_KEY_MAP,  0, "", ANY, "how the wall responds", AT(cn_surface_spec, wall), MAP(wall_schema)},
    {"limits",  CN_KEY_LIST, 0, "[]", ANY, "what an elastic wall must not exceed", AT(cn_surface_spec, limit), N(cn_surface_spec, nlimit), OF(cn_limit), MAP(limit_schema)},
    {0}};
static const cn_schema vessel_schema = {vessel_keys, NULL};
static const cn_key obstacle_keys[] = {
    {"name",    CN_KEY_TEXT, CN_REQUIRED | CN_NUMBERED, "rock", 1, 63, "", "unique among vessels, obstacles and bodies", AT(cn_surface_spec, name)},
    {"surface", CN_KEY_MAP,  CN_UNSET | CN_NEEDED, "", ANY, "its surface, from a file; an open one is a two-sided wall", AT(cn_surface_spec, shape), MAP(surface_schema), .group = 'a'},
    {"shape",   CN_KEY_MAP,  CN_UNSET, "", ANY, "its surface, from a formula", AT(cn_surface_spec, shape), MAP(obstacle_shape_schema), .group = 'a'},
    {"wall",    CN_KEY_MAP,  0, "", ANY, "how the surface responds", AT(cn_surface_spec, wall), MAP(wall_schema), .group = 'w'},
    {"body",    CN_KEY_MAP,  CN_UNSET, "", ANY, "instead of `wall`: it deforms as a whole", MAP(obstacle_body_schema), .group = 'w', MARK(cn_surface_spec, deformable, 1)},
    {"limits",  CN_KEY_LIST, 0, "[]", ANY, "what a deformable obstacle must not exceed", AT(cn_surface_spec, limit), N(cn_surface_spec, nlimit), OF(cn_limit), MAP(limit_schema)},
    {"path",    CN_KEY_MAP,  CN_SHORT, "", ANY, "motion of a rigid obstacle; a bare list is its waypoints", MAP(obstacle_path_schema)},
    {0}};
static const cn_schema obstacle_schema = {obstacle_keys, cn_check_obstacle};

/* --- bodies --- */
static const cn_key molecule_keys[] = {
    {"radius",  CN_KEY_REAL, CN_ABOVE, "0.01",    0, INF, "m", "of a molecule", AT(cn_body_spec, molecule_radius)},
    {"packing", CN_KEY_FLAG, 0,        "regular", 0, 0, "", "how the shape is filled", AT(cn_body_spec, molecule_jittered), .choices = "regular|jittered", .group = 'p'},
    {"file",    CN_KEY_FILE, CN_UNSET, "../../test/data/scenes/molecules.txt", ANY, "or their centres, from a file", AT(cn_body_spec, molecule_file), .group = 'p'},
    {0}};
static const cn_schema molecule_schema = {molecule_keys, NULL};
static const cn_key start_keys[] = {
    {"velocity", CN_KEY_VECTOR, 0, "[0, 0, 0]", -INF, INF, "m/s", "of all nodes", AT(cn_body_spec, velocity)},
    {"spin",     CN_KEY_VECTOR, 0, "[0, 0, 0]", -INF, INF, "rad/s", "about the centre of mass", AT(cn_body_spec, spin)},
    {"positions", CN_KEY_FILE, CN_UNSET, "../../test/data/scenes/positions.txt", ANY, "of its nodes in their order, one x y z [m] a line, instead of its rest shape", AT(cn_body_spec, start_file)},
    {0}};
static const cn_schema start_schema = {start_keys, NULL};
static const cn_key load_keys[] = {
    {"box",   CN_KEY_BOX,    CN_REQUIRED, "[[-1, -1, -0.01], [1, 1, 0.01]]", -INF, INF, "m", "surface triangles wholly in it carry the load, else the nodes in it by mass", AT(cn_load, box)},
    {"force",  CN_KEY_VECTOR, 0,          "[0, 0, 0]", -INF, INF, "N", "total; may be left out where a moment is given", AT(cn_load, force)},
    {"moment", CN_KEY_VECTOR, 0,          "[0, 0, 0]", -INF, INF, "N m", "total, about the centre of the loaded nodes", AT(cn_load, moment)},
    {"from",  CN_KEY_REAL,   0,           "0",    0, INF, "s", "begins", AT(cn_load, from)},
    {"until", CN_KEY_REAL,   CN_MAY_NULL, "null", 0, INF, "s", "ends; null: never", AT(cn_load, until)},
    {0}};
static const cn_schema load_schema = {load_keys, cn_check_load};
static const cn_key bend_keys[] = {
    {"length",    CN_KEY_REAL, 0, "0", 0, INF, "m", "of the bent end, from the tip", AT(cn_drive_spec, bend_length)},
    {"curvature", CN_KEY_REAL, 0, "0", 0, INF, "1/m", "of the end at rest; where it is steered the most to either side", AT(cn_drive_spec, bend_curvature)},
    {"steered",   CN_KEY_FLAG, 0, "off", 0, 0, "", "whether the end, straight at rest, is bent as the path asks; off: it is pre-bent", AT(cn_drive_spec, bend_steered), .choices = "off|on"},
    {0}};
static const cn_schema bend_schema = {bend_keys, NULL};
static const cn_key control_keys[] = {
    {"box", CN_KEY_BOX, CN_REQUIRED, "[[-1, -1, -0.05], [1, 1, 0]]", -INF, INF, "m", "nodes in it are driven", AT(cn_drive_spec, control_box), MARK(cn_drive_spec, ncontrol, -1)},
    {0}};
static const cn_schema control_schema = {control_keys, NULL};
static const cn_key drive_keys[] = {
    {"mode",            CN_KEY_CHOICE,  0,                      "follow", 0, 0, "", "follow: forces draw the nodes along the path; push: from the base", AT(cn_drive_spec, mode), .choices = "follow|push"},
    {"nodes",           CN_KEY_CHOICE,  0,                      "each",   0, 0, "", "each: every node its own place on the path; uniform: one force on the control nodes", AT(cn_drive_spec, nodes), .choices = "each|uniform"},
    {"control",         CN_KEY_CONTROL, 0,                      "all",    ANY, "driven nodes", .map = &control_schema},
    {"goal_node",       CN_KEY_COUNT,   CN_MAY_AUTO,            "auto",   0, INT_MAX, "", "node that must reach the waypoints; auto: a catheter's tip, else the one nearest the control nodes' centre of mass", AT(cn_drive_spec, goal_node)},
    {"path_distance",   CN_KEY_REAL,    CN_ABOVE,               "1.0e-3", 0, INF, "m", "the path-following force starts here and has full weight at twice that", AT(cn_drive_spec, path_distance)},
    {"speed",           CN_KEY_REAL,    CN_ABOVE,               "0.05",   0, INF, "m/s", "along the path", AT(cn_drive_spec, speed)},
    {"rest_length",     CN_KEY_REAL,    0,                      "0",      0, INF, "m", "of the goal-seeking spring", AT(cn_drive_spec, rest_length)},
    {"force_threshold", CN_KEY_REAL,    CN_MAY_AUTO | CN_ABOVE, "auto",   0, INF, "N", "a waypoint also needs the goal force below this", AT(cn_drive_spec, force_threshold)},
    {"advance_max",     CN_KEY_REAL,    CN_ABOVE,               "0.05",   0, INF, "m/s", "push: fastest advance of the base", AT(cn_drive_spec, advance_max)},
    {"twist_max",       CN_KEY_REAL,    CN_ABOVE,               "3.14",   0, INF, "rad/s", "push: fastest turn of the base", AT(cn_drive_spec, twist_max)},
    {"tip_bend",        CN_KEY_MAP,     0,                      "", ANY, "push: the end that finds the way: pre-bent and steered by turning the base, or bent besides", MAP(bend_schema)},
    {0}};
static const cn_schema drive_schema = {drive_keys, NULL};
static const cn_key region_plane_keys[] = {
    {"point",  CN_KEY_VECTOR, CN_REQUIRED, "[0, 0, 0]", -INF, INF, "m", "on the plane", AT(cn_path_spec, plane_point)},
    {"normal", CN_KEY_UNIT,   CN_REQUIRED, "[0, 1, 0]", -INF, INF, "", "of the plane; any length but zero", AT(cn_path_spec, plane_normal)},
    {0}};
static const cn_schema region_plane_schema = {region_plane_keys, NULL};
static const cn_key region_box_keys[] = {
    {"min", CN_KEY_VECTOR, CN_REQUIRED, "[-1, -1, -1]", -INF, INF, "m", "lower corner", AT(cn_path_spec, box[0])},
    {"max", CN_KEY_VECTOR, CN_REQUIRED, "[1, 1, 1]",    -INF, INF, "m", "upper corner", AT(cn_path_spec, box[1])},
    {0}};
static const cn_schema region_box_schema = {region_box_keys, NULL};
static const cn_key region_band_keys[] = {
    {"surface", CN_KEY_TEXT, CN_REQUIRED, "artery", 1, 63, "", "name of a vessel or obstacle", AT(cn_path_spec, band_surface)},
    {"min",     CN_KEY_REAL, 0,           "0",      0, INF, "m", "least distance to it", AT(cn_path_spec, band_min)},
    {"max",     CN_KEY_REAL, CN_REQUIRED, "0.01",   0, INF, "m", "largest distance to it", AT(cn_path_spec, band_max)},
    {0}};
static const cn_schema region_band_schema = {region_band_keys, NULL};
static const cn_key path_region_keys[] = {
    {"plane", CN_KEY_MAP, CN_UNSET, "", ANY, "the path stays on a plane", MAP(region_plane_schema), .group = 'r', MARK(cn_path_spec, region, CN_REGION_PLANE)},
    {"box",   CN_KEY_MAP, CN_UNSET, "", ANY, "the path stays in a box", MAP(region_box_schema), .group = 'r', MARK(cn_path_spec, region, CN_REGION_BOX)},
    {"band",  CN_KEY_MAP, CN_UNSET, "", ANY, "the path keeps a distance from a surface", MAP(region_band_schema), .group = 'r', MARK(cn_path_spec, region, CN_REGION_BAND)},
    {0}};
static const cn_schema path_region_schema = {path_region_keys, NULL};
static const cn_key deviation_keys[] = {
    {"amplitude",  CN_KEY_REAL,  CN_REQUIRED,            "1.0e-3",    0, INF, "m", "of a sinusoid added to the path", AT(cn_deviation, amplitude)},
    {"wavelength", CN_KEY_REAL,  CN_REQUIRED | CN_ABOVE, "0.05",      0, INF, "m", "of that sinusoid", AT(cn_deviation, wavelength)},
    {"phase_deg",  CN_KEY_ANGLE, 0,                      "0",         -INF, INF, "deg", "of that sinusoid", AT(cn_deviation, phase)},
    {"normal",     CN_KEY_UNIT,  CN_REQUIRED,            "[0, 1, 0]", -INF, INF, "", "of its plane; any length but zero", AT(cn_deviation, normal)},
    {0}};
static const cn_schema deviation_schema = {deviation_keys, NULL};
static const cn_key path_keys[] = {
    {"sampling",     CN_KEY_CHOICE, 0,        "auto",   -1, 0, "", "where the planner looks; auto: medial_axis where there are vessels, else uniform", AT(cn_path_spec, sampling), .choices = "auto|uniform|medial_axis|contact"},
    {"max_turn_deg", CN_KEY_ANGLE,  CN_ABOVE, "45",     0, 180, "deg", "largest turn between chords sliding along the path", AT(cn_path_spec, max_turn)},
    {"clearance",    CN_KEY_REAL,   0,        "0",      0, INF, "m", "kept from walls besides the device's radius", AT(cn_path_spec, clearance)},
    {"cost",         CN_KEY_CHOICE, 0,        "length", 0, 0, "", "what the path is to have little of (clearance: much)", AT(cn_path_spec, cost), .choices = "length|clearance|bending"},
    {"region",       CN_KEY_MAP,    0,        "", ANY, "where the path must stay", MAP(path_region_schema)},
    {"deviation",    CN_KEY_LIST,   0,        "[]", ANY, "sinusoids the path swings by, summed", AT(cn_path_spec, deviation), N(cn_path_spec, ndeviation), OF(cn_deviation), MAP(deviation_schema)},
    {0}};
static const cn_schema path_schema = {path_keys, cn_check_path};
static const cn_key skin_keys[] = {
    {"sides",   CN_KEY_COUNT,  CN_UNSET | CN_NEEDED, "24", 3, 256, "", "of a round tube about a catheter", AT(cn_body_spec, skin_sides), .group = 's', MARK(cn_body_spec, skin_source, CN_SKIN_TUBE)},
    {"file",    CN_KEY_FILE,   CN_UNSET, "../../test/data/scenes/ball.obj", ANY, "a fine surface; it is placed as the shape is, of a catheter tip at the origin and along -z", AT(cn_body_spec, skin_file), .group = 's', MARK(cn_body_spec, skin_source, CN_SKIN_FILE)},
    {"cell",    CN_KEY_REAL,   CN_UNSET, "0", 0, INF, "m", "of the grid for a surface about molecules; 0: half their radius", AT(cn_body_spec, skin_cell), .group = 's', MARK(cn_body_spec, skin_source, CN_SKIN_SPHERES)},
    {"anchors", CN_KEY_COUNT,  0,        "4", 1, 8, "", "nodes a point of the skin hangs on where it is blended", AT(cn_body_spec, skin_anchors)},
    {"method",  CN_KEY_CHOICE, 0,        "auto", -1, 0, "", "blend: between the frames of the nearest nodes, embed: with the tetrahedron, or the four molecules, around; auto: embed in tetrahedra, else blend, and of molecules what contact needs", AT(cn_body_spec, skin_kind), .choices = "auto|blend|embed"},
    {"contact", CN_KEY_FLAG,   0,        "off", 0, 0, "", "whether contact meets the skin, whose forces go back to what it hangs on, instead of the body's own surface", AT(cn_body_spec, skin_contact), .choices = "off|on"},
    {0}};
static const cn_schema skin_schema = {skin_keys, NULL};
static const cn_key body_keys[] = {
    {"name",       CN_KEY_TEXT,   CN_REQUIRED | CN_NUMBERED, "device", 1, 63, "", "unique among vessels, obstacles and bodies", AT(cn_body_spec, name)},
    {"shape",      CN_KEY_MAP,    CN_REQUIRED, "", ANY, "its form at rest", AT(cn_body_spec, shape), MAP(body_shape_schema)},
    {"model",      CN_KEY_CHOICE, 0,           "auto", -1, 0, "", "how it deforms: tetrahedra of first or second order, a rod of frames, molecules; auto: rod for a catheter (tet4 with contact that moves nodes: project, penalty), else tet4", AT(cn_body_spec, model), BODY_MODEL},
    {"molecules",  CN_KEY_MAP,    0,           "", ANY, "for model: molecules", MAP(molecule_schema)},
    {"material",   CN_KEY_MAP,    CN_REQUIRED, "", ANY, "elastic constants and mass", AT(cn_body_spec, material), MAP(material_schema)},
    {"start",      CN_KEY_MAP,    0,           "", ANY, "motion at t = 0", MAP(start_schema)},
    {"fixed",      CN_KEY_MAP,    0,           "", ANY, "held nodes; boxes are closed", AT(cn_body_spec, fixed), MAP(fixed_schema)},
    {"load",       CN_KEY_LIST,   0,           "[]", ANY, "forces from outside", AT(cn_body_spec, load), N(cn_body_spec, nload), OF(cn_load), MAP(load_schema)},
    {"drive",      CN_KEY_MAP,    0,           "", ANY, "how it is moved along its waypoints", AT(cn_body_spec, drive), MAP(drive_schema)},
    {"waypoints",  CN_KEY_POINTS, 0,           "[]", 0, INF, "m", "to be reached in order; none: it just moves under its loads", AT(cn_body_spec, waypoint), N(cn_body_spec, nwaypoint)},
    {"waypoint_tolerance", CN_KEY_REAL, CN_ABOVE, "2.0e-3", 0, INF, "m", "a waypoint counts as reached within this distance", AT(cn_body_spec, waypoint_tolerance)},
    {"deadline",   CN_KEY_REAL,   CN_MAY_NULL | CN_ABOVE, "null", 0, INF, "s", "simulated time by which the last waypoint must be reached; null: none", AT(cn_body_spec, deadline)},
    {"path",       CN_KEY_MAP,    0,           "", ANY, "what the planner is asked for", AT(cn_body_spec, path), MAP(path_schema)},
    {"limits",     CN_KEY_LIST,   0,           "[]", ANY, "what must hold after every step", AT(cn_body_spec, limit), N(cn_body_spec, nlimit), OF(cn_limit), MAP(limit_schema)},
    {"skin",       CN_KEY_MAP,    CN_UNSET,    "", ANY, "a surface that it carries, shown in its place", MAP(skin_schema)},
    {0}};
static const cn_schema body_schema = {body_keys, cn_check_body};

/* --- options --- */
static const cn_key contact_keys[] = {
    {"method",      CN_KEY_CHOICE, 0, "strict",    0, 0, "", "strict: never through a wall; project, penalty: the papers'; none: control runs", AT(cn_scene, contact.method), .choices = "strict|project|penalty|none"},
    {"response",    CN_KEY_CHOICE, 0, "inelastic", 0, 0, "", "what is left of the speed into a wall", AT(cn_scene, contact.response), .choices = "inelastic|elastic"},
    {"restitution", CN_KEY_REAL,   0, "1.0",  0, 1, "", "for response: elastic", AT(cn_scene, contact.restitution)},
    {"self",        CN_KEY_CHOICE, 0, "auto", -1, 0, "", "contact of a body with itself", AT(cn_scene, contact.self), SWITCH},
    {"friction",    CN_KEY_REAL,   0, "0",    0, INF, "", "Coulomb's coefficient", AT(cn_scene, contact.friction)},
    {"stiffness",   CN_KEY_REAL,   CN_MAY_AUTO | CN_ABOVE, "auto", 0, INF, "N/m", "for method: penalty", AT(cn_scene, contact.stiffness)},
    {"gap",         CN_KEY_REAL,   CN_MAY_AUTO | CN_ABOVE, "auto", 0, INF, "m", "least distance kept from walls", AT(cn_scene, contact.gap)},
    {0}};
static const cn_schema contact_schema = {contact_keys, NULL};
static const cn_key solver_keys[] = {
    {"newton",           CN_KEY_COUNT,  CN_MAY_AUTO, "auto", 1, 1000, "", "most Newton iterations a step; 1: one linear solve a step", AT(cn_scene, solver.newton)},
    {"linear",           CN_KEY_CHOICE, 0,        "auto", -1, 0, "", "linear solver; auto: by the matrix", AT(cn_scene, solver.linear), .choices = "auto|cholesky|cg|chain|pcg"},
    {"integrator",       CN_KEY_CHOICE, 0,        "euler", 0, 0, "", "in time, implicit: euler of first order; midpoint (keeps energy) and trbdf2 (damps what the step does not resolve) of second; explicit: molecules alone, each step cut into stable ones", AT(cn_scene, solver.integrator), .choices = "euler|midpoint|trbdf2|explicit"},
    {"tolerance",        CN_KEY_REAL,   CN_ABOVE | CN_BELOW, "1.0e-3", 0, 1, "", "of the nonlinear residual over the largest of the external, internal and inertial forces", AT(cn_scene, solver.tolerance)},
    {"linear_tolerance", CN_KEY_REAL,   CN_ABOVE | CN_BELOW, "1.0e-4", 0, 1, "", "of an iterative linear solve's residual over its right-hand side", AT(cn_scene, solver.linear_tolerance)},
    {0}};
static const cn_schema solver_schema = {solver_keys, NULL};
static const cn_key planner_keys[] = {
    {"samples",    CN_KEY_COUNT, CN_MAY_AUTO, "auto", 1, INT_MAX, "", "states drawn for the roadmap", AT(cn_scene, planner.samples)},
    {"budget",     CN_KEY_REAL,  CN_ABOVE,    "60",   0, INF, "s", "emergency stop of a search (wall time)", AT(cn_scene, planner.budget)},
    {"replans",    CN_KEY_COUNT, 0,           "20",   0, INT_MAX, "", "new paths at most, after limits were broken", AT(cn_scene, planner.replans)},
    {"seeds",      CN_KEY_COUNT, 0,           "1",    1, 64, "", "plans made side by side from as many seeds, the best of which is kept", AT(cn_scene, planner.seeds)},
    {"resolution", CN_KEY_REAL,  CN_MAY_AUTO | CN_ABOVE, "auto", 0, INF, "m", "cell of the lumen's map", AT(cn_scene, planner.resolution)},
    {0}};
static const cn_schema planner_schema = {planner_keys, NULL};
#define LEAVE(what, meaning) {#what, CN_KEY_CHOICE, 0, "auto", -1, 0, "", meaning, AT(cn_scene, leave_out.what), SWITCH}
static const cn_key leave_out_keys[] = {
    LEAVE(self_contact, "tests of a body against itself"), LEAVE(refit, "refits of trees over what does not move"),
    LEAVE(refactor, "new factors of a matrix that hardly changed"), LEAVE(wall_solve, "the turning of walls that give way; on: they do not give way"),
    LEAVE(inertia, "accelerations in slow motion"), LEAVE(stress, "stress nobody asks for"), {0}};
static const cn_schema leave_out_schema = {leave_out_keys, NULL};

static const cn_key scene_keys[] = {
    {"scene",      CN_KEY_TEXT,   0,           "untitled",  1, 127, "", "its name", AT(cn_scene, name)},
    {"seed",       CN_KEY_SEED,   0,           "1",         0, UINT_MAX, "", "every random choice follows from it", AT(cn_scene, seed)},
    {"step",       CN_KEY_REAL,   CN_ABOVE,    "0.01",      0, INF, "s", "time step", AT(cn_scene, step)},
    {"time_limit", CN_KEY_REAL,   CN_ABOVE,    "120",       0, INF, "s", "simulated time at most", AT(cn_scene, time_limit)},
    {"gravity",    CN_KEY_VECTOR, 0,           "[0, 0, 0]", -INF, INF, "m/s^2", "on all bodies", AT(cn_scene, gravity)},
    {"vessels",    CN_KEY_LIST,   0,           "[]", ANY, "the free space is inside these surfaces (their union)", AT(cn_scene, vessel), N(cn_scene, nvessel), OF(cn_surface_spec), MAP(vessel_schema)},
    {"obstacles",  CN_KEY_LIST,   0,           "[]", ANY, "the free space is outside these", AT(cn_scene, obstacle), N(cn_scene, nobstacle), OF(cn_surface_spec), MAP(obstacle_schema)},
    {"shown",      CN_KEY_LIST,   0,           "[]", ANY, "drawn, never simulated", AT(cn_scene, shown), N(cn_scene, nshown), OF(cn_shape), MAP(surface_schema)},
    {"bodies",     CN_KEY_LIST,   CN_REQUIRED, "[]", 1, INF, "", "what moves and deforms; the first is the device", AT(cn_scene, body), N(cn_scene, nbody), OF(cn_body_spec), MAP(body_schema)},
    {"contact",    CN_KEY_MAP,    0,           "", ANY, "what happens at walls", MAP(contact_schema)},
    {"solver",     CN_KEY_MAP,    0,           "", ANY, "how a step is solved", MAP(solver_schema)},
    {"planner",    CN_KEY_MAP,    0,           "", ANY, "how a path is looked for", MAP(planner_schema)},
    {"leave_out",  CN_KEY_MAP,    0,           "", ANY, "work left out where the scene does not need it: auto, on (left out) or off (done)", MAP(leave_out_schema)},
    {0}};
const cn_schema cn_scene_schema = {scene_keys, cn_check_scene};
/* clang-format on */

const char *cn_quantity_name(cn_quantity quantity)
{
    static const char *const names[] = {"volume", "stress", "energy", "wall_force", "clearance", "progress"};
    const int i = (int)quantity;
    return i >= 0 && i < (int)(sizeof names / sizeof *names) ? names[i] : "unknown";
}

int cn_key_choice(const cn_key *key, const char *word)
{
    const size_t length = strlen(word);
    int value = (int)key->low;
    for (const char *c = key->choices; c; value++) {
        const size_t n = strcspn(c, "|");
        if (n == length && !memcmp(c, word, n)) return value;
        c = c[n] ? c + n + 1 : NULL;
    }
    return INT_MIN;
}

static const char *range_text(const cn_key *key, size_t size, char *text)
{
    const char *above = key->flags & CN_ABOVE ? ">" : ">=", *below = key->flags & CN_BELOW ? "<" : "<=";
    const bool low = key->low > -INF && !(key->low == 0 && key->high == 0);
    const bool high = key->high < INF && !(key->low == 0 && key->high == 0);
    text[0] = 0;
    if (low && high)
        snprintf(text, size, " %s %.10g and %s %.10g", above, key->low, below, key->high);
    else if (low)
        snprintf(text, size, " %s %.10g", above, key->low);
    else if (high)
        snprintf(text, size, " %s %.10g", below, key->high);
    return text;
}

const char *cn_key_expected(const cn_key *key, size_t size, char *text)
{
    char range[64];
    const char *what = "a map";
    range_text(key, sizeof range, range);
    switch (key->type) {
    case CN_KEY_TEXT:
        what = "a name";
        snprintf(range, sizeof range, " of at most %.0f bytes", key->high);
        break;
    case CN_KEY_FILE:
        what = "the name of a file";
        break;
    case CN_KEY_REAL:
        what = "a number";
        break;
    case CN_KEY_ANGLE:
        what = "an angle";
        break;
    case CN_KEY_SEED:
    case CN_KEY_COUNT:
        what = "a whole number";
        if (key->high >= INT_MAX) snprintf(range, sizeof range, " >= %.0f", key->low);
        break;
    case CN_KEY_CHOICE:
    case CN_KEY_FLAG:
        what = "one of ";
        snprintf(range, sizeof range, "%s", key->choices);
        break;
    case CN_KEY_VECTOR:
        what = "three numbers";
        break;
    case CN_KEY_UNIT:
        what = "three numbers, not all zero";
        break;
    case CN_KEY_COUNTS:
        what = "three whole numbers";
        break;
    case CN_KEY_RANGE:
        what = "two ascending numbers";
        break;
    case CN_KEY_BOX:
        what = "two corners [[x, y, z], [x, y, z]], the lower one first";
        break;
    case CN_KEY_REALS:
        what = "a number, or a list of numbers,";
        break;
    case CN_KEY_POINTS:
        what = "a list of points [x, y, z]";
        range[0] = 0;
        if (key->low > 0) snprintf(range, sizeof range, ", at least %.0f", key->low);
        break;
    case CN_KEY_CONTROL:
        what = "all, a list of node indices, or {box: ...}";
        break;
    case CN_KEY_MAP:
        what = key->flags & CN_SHORT ? "a map or a list" : "a map";
        break;
    case CN_KEY_LIST:
        what = key->low > 0 ? "a list of at least one map" : "a list of maps";
        range[0] = 0;
        break;
    }
    snprintf(text, size, "%s%s%s%s%s%s%s", what, range, *key->unit ? " [" : "", key->unit,
             *key->unit ? "]" : "", key->flags & CN_MAY_AUTO ? ", or auto" : "",
             key->flags & CN_MAY_NULL ? ", or null" : "");
    return text;
}

static void free_at(void *field)
{
    void *owned;
    memcpy(&owned, field, sizeof owned);
    free(owned);
    owned = NULL;
    memcpy(field, &owned, sizeof owned);
}

void cn_schema_free(const cn_schema *schema, void *base)
{
    for (const cn_key *key = schema->keys; key->name; key++) {
        char *field = (char *)base + key->offset;
        switch (key->type) {
        case CN_KEY_TEXT:
        case CN_KEY_FILE:
        case CN_KEY_REALS:
        case CN_KEY_POINTS:
            free_at(field);
            break;
        case CN_KEY_CONTROL:
            free_at(&((cn_drive_spec *)field)->control);
            break;
        case CN_KEY_MAP:
            cn_schema_free(key->map, field);
            break;
        case CN_KEY_LIST: {
            int *count = (int *)((char *)base + key->count);
            char *entry;
            memcpy(&entry, field, sizeof entry);
            for (int i = 0; i < *count; i++)
                cn_schema_free(key->map, entry + (size_t)i * key->size);
            free_at(field);
            *count = 0;
            break;
        }
        default:
            break;
        }
    }
}
