/* scene.h - one case as the user wrote it: surfaces, bodies, waypoints, limits, options.
 * Read event by event against one schema table (src/core/scene_schema.c), the only place where a key's
 * name, type, default, range, unit and meaning stand. SI units; lengths [m].
 *
 * "auto" is CN_AUTO for switches and enums, NAN for numbers, -1 for counts. */
#ifndef CN_SCENE_H
#define CN_SCENE_H

#include <stdbool.h>
#include "catnav/mesh.h"
#include "catnav/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { CN_AUTO = -1, CN_OFF = 0, CN_ON = 1 } cn_switch;

typedef enum {
    CN_SHAPE_FILE,
    CN_SHAPE_CATHETER,
    CN_SHAPE_BEAM,
    CN_SHAPE_SPHERE,
    CN_SHAPE_BOX,
    CN_SHAPE_PLANE,
    CN_SHAPE_TUBE
} cn_shape_kind;

typedef struct {
    cn_shape_kind kind;
    char *file;             /* resolved against the scene file's folder */
    cn_placement placement; /* any shape or file takes it */
    double max_volume;      /* of a tetrahedron where a surface is filled [m^3], 0: the mesher's choice */
    struct {
        double length, diameter, inner_diameter;
        double entry[3], direction[3];
        int stations, sides;
        double inserted; /* tip past the entry at t = 0 */
        cn_switch sheath;
        bool has_core;
        double core_diameter, core_young, core_poisson, core_density;
    } catheter;
    struct {
        double size[3];
        int cells[3];
    } beam;
    struct {
        double centre[3], radius;
    } sphere;
    struct {
        double min[3], max[3];
    } box;
    struct {
        double point[3], normal[3];
    } plane; /* normal into the free side */
    struct {
        int naxis;
        double *axis;
        int nradius;
        double *radius;
        double thickness;
    } tube;
} cn_shape;

typedef enum { CN_WALL_RIGID, CN_WALL_MEMBRANE, CN_WALL_SHELL } cn_wall_model;
/* AUTO: rod for a catheter, tet4 for anything else; the last two come from a wall's `model:` alone */
typedef enum {
    CN_BODY_AUTO = -1,
    CN_BODY_TET4,
    CN_BODY_TET10,
    CN_BODY_ROD,
    CN_BODY_MOLECULES,
    CN_BODY_MEMBRANE,
    CN_BODY_SHELL
} cn_body_model;

typedef enum {
    CN_QUANTITY_VOLUME,
    CN_QUANTITY_STRESS,
    CN_QUANTITY_ENERGY,
    CN_QUANTITY_WALL_FORCE,
    CN_QUANTITY_CLEARANCE,
    CN_QUANTITY_PROGRESS
} cn_quantity;
const char *cn_quantity_name(cn_quantity quantity); /* "volume", "stress", ... "progress" */
typedef enum { CN_REDUCE_MAX, CN_REDUCE_MEAN } cn_reduce;
typedef struct {
    cn_quantity quantity;
    cn_reduce reduce;
    double limit;
} cn_limit;

typedef struct {
    bool by_box; /* else along the axis, from the tip */
    double box[2][3];
    double along[2];
    double young;
} cn_region;

typedef struct {
    double young, poisson, density;
    double damping;           /* mass-proportional [1/s] */
    double damping_stiffness; /* stiffness-proportional [s] */
    int nregion;
    cn_region *region;
} cn_material;

typedef struct {
    bool set;
    double box[2][3];
} cn_fixed;

typedef struct {
    cn_wall_model model;
    double thickness, young, poisson, density, foundation;
    bool rims_held;
} cn_wall_spec;

/* A vessel (free space inside) or an obstacle (free space outside). */
typedef struct {
    char *name;
    cn_shape shape;
    cn_wall_spec wall;
    bool deformable; /* obstacle with `body:` */
    cn_body_model model;
    cn_material material;
    cn_fixed fixed;
    int nlimit;
    cn_limit *limit;
    int npath;    /* waypoints of a moving rigid obstacle */
    double *path; /* (npath x 3) */
    double path_speed;
} cn_surface_spec;

typedef struct {
    double box[2][3];
    double force[3];
    double moment[3];   /* [N m] about the centre of the loaded nodes */
    double from, until; /* [s]; until = INFINITY for null */
} cn_load;

typedef enum { CN_DRIVE_FOLLOW, CN_DRIVE_PUSH } cn_drive_mode;
typedef enum { CN_NODES_EACH, CN_NODES_UNIFORM } cn_drive_nodes;
typedef struct {
    cn_drive_mode mode;
    cn_drive_nodes nodes;
    bool control_all;
    int ncontrol; /* node list when not all; -1: by box */
    int *control;
    double control_box[2][3];
    int goal_node; /* -1: auto */
    double path_distance, speed, rest_length;
    double force_threshold; /* NAN: auto */
    double advance_max, twist_max;
    double bend_length, bend_curvature;
    bool bend_steered; /* the end is straight at rest, and bent by up to that as the path asks */
} cn_drive_spec;

typedef enum { CN_SAMPLING_UNIFORM, CN_SAMPLING_MEDIAL_AXIS, CN_SAMPLING_CONTACT } cn_sampling;
typedef enum { CN_COST_LENGTH, CN_COST_CLEARANCE, CN_COST_BENDING } cn_cost;
typedef enum { CN_REGION_NONE, CN_REGION_PLANE, CN_REGION_BOX, CN_REGION_BAND } cn_region_kind;
typedef struct {
    double amplitude, wavelength, phase; /* [m, m, rad] */
    double normal[3];
} cn_deviation;
typedef struct {
    cn_sampling sampling;
    double max_turn;  /* [rad] */
    double clearance; /* besides the device's radius */
    cn_cost cost;
    cn_region_kind region;
    double plane_point[3], plane_normal[3];
    double box[2][3];
    char *band_surface;
    double band_min, band_max;
    int ndeviation;
    cn_deviation *deviation;
} cn_path_spec;

/* A surface that a body carries: what it is made from, and how it hangs (skin.h). */
typedef enum { CN_SKIN_NONE, CN_SKIN_TUBE, CN_SKIN_FILE, CN_SKIN_SPHERES } cn_skin_source;
typedef enum { CN_SKIN_AUTO = -1, CN_SKIN_BLEND, CN_SKIN_EMBED } cn_skin_kind;

typedef struct {
    char *name;
    cn_shape shape;
    cn_body_model model;
    double molecule_radius;
    bool molecule_jittered;
    char *molecule_file;
    cn_material material;
    double velocity[3], spin[3];
    char *start_file; /* positions of its nodes, x y z a line [m], NULL: at rest */
    cn_fixed fixed;
    int nload;
    cn_load *load;
    cn_drive_spec drive;
    int nwaypoint;
    double *waypoint; /* (nwaypoint x 3) */
    double waypoint_tolerance;
    double deadline; /* INFINITY: none */
    cn_path_spec path;
    int nlimit;
    cn_limit *limit;
    cn_skin_source skin_source;
    cn_skin_kind skin_kind; /* CN_SKIN_AUTO: by the model */
    bool skin_contact;      /* contact acts on the skin, else on the body's own surface */
    int skin_sides, skin_anchors;
    double skin_cell; /* [m], 0: half the radius of molecules */
    char *skin_file;
    const cn_surface_spec *wall; /* a wall that gives way, for which it stands: set by a run, else NULL */
} cn_body_spec;

typedef enum { CN_CONTACT_STRICT, CN_CONTACT_PROJECT, CN_CONTACT_PENALTY, CN_CONTACT_NONE } cn_contact_method;
typedef enum { CN_RESPONSE_INELASTIC, CN_RESPONSE_ELASTIC } cn_response;
typedef enum {
    CN_LINEAR_AUTO = -1,
    CN_LINEAR_CHOLESKY,
    CN_LINEAR_CG,
    CN_LINEAR_CHAIN,
    CN_LINEAR_PCG
} cn_linear;
typedef enum {
    CN_INTEGRATOR_EULER,
    CN_INTEGRATOR_MIDPOINT,
    CN_INTEGRATOR_TRBDF2,
    CN_INTEGRATOR_EXPLICIT
} cn_integrator;

typedef struct {
    char *path; /* the file it came from, "" if none */
    char *name;
    unsigned seed;
    double step, time_limit;
    double gravity[3];
    int nvessel, nobstacle, nshown, nbody;
    cn_surface_spec *vessel, *obstacle;
    cn_shape *shown;
    cn_body_spec *body;
    struct {
        cn_contact_method method;
        cn_response response;
        double restitution;
        cn_switch self;
        double friction, stiffness, gap;
    } contact;
    struct {
        int newton; /* most Newton iterations a step; -1: auto */
        cn_linear linear;
        cn_integrator integrator;
        double tolerance, linear_tolerance;
    } solver;
    struct {
        int samples;   /* -1: auto */
        double budget; /* [s] */
        int replans;
        int seeds;         /* plans side by side, the best kept */
        double resolution; /* map cell; NAN: auto */
    } planner;
    struct {
        cn_switch self_contact, refit, refactor, wall_solve, inertia, stress;
    } leave_out;
} cn_scene;

/* One `--set key.path=value`. */
typedef struct {
    const char *key, *value;
} cn_setting;

/* Reads a scene file and applies the settings (same schema, same refusals, named after the setting).
 * CN_ERR_FILE, CN_ERR_PARSE, CN_ERR_SCENE with file, line, key and what was expected. */
cn_status cn_scene_read(cn_scene **out, const char *path, int nsetting, const cn_setting *setting,
                        cn_error *error);
void cn_scene_free(cn_scene *scene);
/* Writes scene file `from` to `to` (may be the same) with other waypoints of the first body: the first
 * replaces a catheter's entry, the others its waypoints; all else stays as it stands, comments too. Written
 * elsewhere, read back, then renamed: `to` is either as before or whole. Files named in it are looked for
 * from `to`. */
cn_status cn_scene_write_waypoints(const char *from, const char *to, int nwaypoint, const double *waypoint,
                                   cn_error *error);
/* Every key of the schema as YAML with comment, default, range, unit (what all_keys.yaml holds). */
cn_status cn_scene_write_keys(const char *path, cn_error *error);

#ifdef __cplusplus
}
#endif
#endif
