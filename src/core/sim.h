/* sim.h - what is fixed in a run (cn_model), what changes (cn_state), and the step between.
 *
 * A step solves the implicit Euler equation
 *     M (v' - v)/dt + C v' = f_elastic(x') + f_drive(x') + f_contact(x') + f_external,  x' = x + dt v'
 * as the minimum of its incremental potential, by Newton with line search; with `solver.newton: 1` by the one
 * frozen-rotation solve of the first paper. The other integrators are one or two such minima (step.c). A step
 * allocates nothing of its own. Positions, velocities and forces are by blocks of three unknowns (body.h): a
 * rod's rotation vectors, angular velocities and moments stand behind those of its nodes. */
#ifndef CN_SIM_H
#define CN_SIM_H

#include <stdbool.h>
#include <stddef.h>
#include <signal.h>
#include "catnav/body.h"
#include "catnav/path.h"
#include "catnav/skin.h"
#include "catnav/world.h"
#include "contact.h"
#include "pool.h"
#include "solve.h"

/* Total nodal force of one load, on from `from` until `until` [s]. */
typedef struct {
    double from, until;
    double *force; /* [N], moments [N m] (nblock x 3) */
} cn_nodal_load;

/* One body as it enters the run. */
typedef struct {
    const cn_body_spec *spec;
    cn_body *body;
    cn_body *worn;          /* what contact meets where it is a skin (skin.h), else NULL */
    unsigned char *fixed;   /* held by the scene (nblock) */
    double *start;          /* positions at t = 0 [m], NULL: at rest (nnode x 3) */
    double gap, kappa;      /* contact's barrier begins at [m], 0: nothing to touch; [N/m] */
    bool self, self_always; /* can touch itself; tested even while it cannot fold */
    int wall;               /* of the world, for which it stands; -1: none */
    int nload;
    cn_nodal_load *load;
    int ntip, *tip; /* nodes of a beam's +x face; points of molecules */
    int goal_node;
    int ncontrol; /* nodes of a uniform drive */
    int *control;
    double *behind; /* rest distance behind the goal node [m]      (nnode)     */
    double *offset; /* rest offset in the section, n and b [m]     (nnode x 2) */
    /* a catheter: nodes in stations from the tip, its axis through entry along direction. A station is what
     * leaves the sheath at once; of tet10 two sections, the corner nodes' and the one behind it. */
    bool catheter, sheath;
    int nstation, per_station, per_section;
    double entry[3], direction[3], normal[3], binormal[3];
    double bending;  /* EI over mass per length [m^4/s^2], 0: no beam */
    double diameter; /* of the device [m], 0: no beam */
    double size;     /* diagonal of the rest box [m] */
    double tick;     /* the scene's step [s]: gains come from it, also in a shorter step */
} cn_model_body;

typedef struct {
    const cn_scene *scene;
    const cn_world *world;
    double dt, gravity[3];
    int newton;   /* most iterations of a step */
    bool single;  /* the paper's one frozen-rotation solve */
    bool coupled; /* all bodies are solved together, since they can touch */
    bool touches; /* contact takes part */
    bool inertia; /* false: each step is a static equilibrium */
    cn_integrator integrator;
    int nbody;
    cn_model_body *body;
} cn_model;

/* What a push drive is about (drive_push.c). */
typedef enum { CN_PUSH_ADVANCE, CN_PUSH_TURN, CN_PUSH_BACK } cn_push_phase;
typedef struct {
    cn_push_phase phase;
    int tries;            /* drawn back and turned since `mark` */
    double mark;          /* s_goal from which tries count anew [m] */
    double best, best_at; /* farthest s_goal since the last try, base advance there [m] */
    double until;         /* BACK: base advance to go back to [m] */
    double turned;        /* by the base since `mark` or the last try, either way [rad] */
    double sense;         /* in which it turns while the angle is more than a right one: 1, -1 */
    double margin;        /* to the nearest limit, as a share of it; 1: none near */
    double strayed[3];    /* unit vector from the path to where it was before the last try, */
    double strayed_at;    /* ... and s_goal there [m] */
    bool hidden;          /* a wall lies between the goal node and its place on the path */
} cn_push;

typedef struct {
    double *x, *v;    /* positions [m], velocities [m/s] (nblock x 3) */
    double *rotation; /* of the body (nturn x 4) */
    int nfree;        /* nodes out of the sheath: the leading ones */
    double inserted;  /* base advance: tip past the entry, along the material [m] */
    double s_goal;    /* arc length of the goal node on the path [m] */
    int waypoint;     /* next one to reach */
    double until;     /* arc length beyond which it is not to go now: a moving obstacle; INFINITY: none [m] */
    double progress;  /* farthest s_goal at `progress_time` [m], [s] */
    double progress_time;
    double twist; /* base turn about `direction` [rad] */
    cn_push push;
    /* With a work's first body, by iterates of the last minimum: which were asked for their matrix, and from
     * which the matrix of the one before led badly. */
    unsigned needed, stale;
} cn_body_state;

typedef struct {
    int step;
    double time;
    int nbody;
    cn_body_state *body;
    size_t size; /* of the one block that holds it all */
} cn_state;

/* Scratch of bodies that are solved together: matrices and factors, lists, trial states. */
typedef struct cn_work cn_work;

/* What one step did to one body; what holds for all that were solved together stands with the first. */
typedef struct {
    int newton, linear;               /* iterations */
    int kept;                         /* Newton iterations with an earlier one's factor */
    int unconverged;                  /* linear solves that stopped at their last iteration, and */
    double linear_residual;           /* the largest |b - A x| / |b| among them */
    double residual;                  /* recomputed, over the largest force norm */
    double force, work;               /* of the drive: sum of nodal magnitudes and the base's push [N]; [J] */
    double wall_force, wall_where[3]; /* most loaded patch [N] */
    double momentum_error; /* of penalty: momentum made by forces that are not equal and opposite [kg m/s] */
    double gap;            /* least listed distance [m], INFINITY: none near */
    double fem_s, collision_s; /* wall time */
    cn_findings findings;
} cn_step_figures;

/* spec (nbody): the scene's bodies as the request changed them; it, scene and world must outlive the model.
 */
cn_status cn_model_new(cn_model **out, const cn_scene *scene, const cn_world *world, int nbody,
                       const cn_body_spec *spec, cn_error *error);
void cn_model_free(cn_model *model);
/* Body b's skin is what contact meets from now on; before any work. The skin must outlive the model. */
cn_status cn_model_wear(cn_model *model, int b, const cn_skin *skin);
static inline const cn_body *cn_touch_body(const cn_model_body *body)
{
    return body->worn ? body->worn : body->body;
}
cn_status cn_state_new(cn_state **out, const cn_model *model);
void cn_state_free(cn_state *state);
void cn_state_copy(cn_state *to, const cn_state *from); /* bit for bit */
void cn_state_copy_body(cn_body_state *to, const cn_body_state *from, const cn_model_body *body);
/* Sheathed nodes (from `nfree` on, which may be fewer than the state has free: those are drawn in) move with
 * the base along the axis and turn about it; a rod's frames that take part get it as rotation vectors.
 * Stations past the entry become free. */
void cn_sheath_advance(const cn_model_body *body, cn_body_state *state, double advance, double turn,
                       int nfree, double dt);
void cn_sheath_release(const cn_model_body *body, cn_body_state *state);
/* Nodes out of the sheath with the base at `inserted` [m]. */
int cn_sheath_out(const cn_model_body *body, double inserted);
/* The free nodes and those past the entry that the sheath still guides: of tet10 a leading section. */
int cn_sheath_past(const cn_model_body *body, const cn_body_state *state);
/* For bodies [first, first + nbody). */
cn_status cn_work_new(cn_work **out, const cn_model *model, int first, int nbody, cn_pool *pool,
                      cn_error *error);
void cn_work_free(cn_work *work);
/* A step is left within an iteration of this being set: CN_ERR_CANCELLED. */
void cn_work_watch(cn_work *work, const volatile sig_atomic_t *cancel);
void cn_work_bodies(const cn_work *work, int *first, int *nbody);
/* Wall of the world for which its surface s stands (the bodies' come first); -1: none. */
int cn_work_wall(const cn_work *work, int surface);

/* One step of the work's bodies from `state` into `trial` (copied first): drive along path (nbody of the
 * model; NULL, or an entry NULL: none), solve, contact. CN_OK: trial holds the new state, figures (of the
 * work's bodies) are filled. Any failure leaves `state` untouched; trial is void. CN_ERR_CONVERGENCE:
 * residual above the tolerance after all iterations; CN_ERR_SINGULAR; CN_ERR_NOT_FINITE; CN_ERR_CONTACT: a
 * list is full (cn_work_grow, then again). */
cn_status cn_step(const cn_model *model, const cn_state *state, cn_state *trial, const cn_path *const *path,
                  double dt, cn_work *work, cn_step_figures *figures);
cn_status cn_work_grow(cn_work *work);
/* `state` against the walls, each other and themselves: exact crossings, outside points, least distance. */
cn_status cn_work_check(const cn_state *state, cn_work *work, cn_findings *findings);
/* How much two places of a body can near each other before it meets itself [m]. INFINITY: its axis turns by
 * so little that it cannot come back to itself at all: a closed loop, even with a corner where it meets,
 * turns by more than half a circle (Fenchel). Else the least distance of places between which it turns by
 * nearly that, less two diameters and the longest of its segments. 0: it may meet itself, or turns about less
 * than its own diameter, where its sections would lie in one another. axis: scratch (nnode x 3). */
double cn_fold_room(const cn_model_body *body, const cn_body_state *state, double *axis);
/* Recomputes the residual of the step from `state` to `trial` from inertia, elastic, external, drive and
 * contact forces, apart from the solver (relative to the largest of their norms): of the worst body. */
double cn_step_residual(const cn_model *model, const cn_state *state, const cn_state *trial,
                        const cn_path *const *path, double dt, cn_work *work);

/* --- drive.c: forces that lead a body along its path (Moss et al. 2008, 4.2; design of the follow drive) ---
 */
typedef struct {
    double *force;      /* held through the step: the uniform drive [N] (nnode x 3) */
    double *centre;     /* place on the path each node belongs to [m]                      (nnode x 3) */
    double *tangent;    /* of the path there                                               (nnode x 3) */
    double *weight;     /* full path-following force [N], 0: none                          (nnode)     */
    double *towards;    /* unit vector to the milestone                                    (nnode x 3) */
    double *lead;       /* way to make along it in this step [m]                           (nnode)     */
    double *pull;       /* force per way missed [N/m], 0: none                             (nnode)     */
    double *hold;       /* towards the path near a waypoint [N/m], 0: none                 (nnode)     */
    const double *from; /* positions at the start of the step: the state's (nnode x 3) */
    double distance;    /* path_distance [m] */
    double advance;     /* base advance in this step [m] */
    double turn;        /* and turn [rad] */
    double bend;        /* of a steered end, as cn_push_bent says it */
    int nfree;          /* nodes free in this step: fewer than before where the base draws them in */
} cn_drive;
void cn_drive_prepare(const cn_model_body *body, const cn_body_state *state, const cn_path *path, double dt,
                      cn_drive *drive);
/* Path-following potential of free nodes at x: returns energy, adds force and scale * stiffness (NULL: not).
 */
double cn_drive_add(const cn_drive *drive, int nfree, const double *x, double *f, double scale, cn_matrix *a);
/* Where the goal node is on the path, and waypoints it counts as reached. */
void cn_drive_progress(const cn_model_body *body, cn_body_state *state, const cn_path *path);
bool cn_drive_arrived(const cn_model_body *body, const cn_body_state *state);
/* Over which distance a drive slows down; the arc length at which it aims: the last waypoint, but no farther
 * past the next one than its tolerance allows while that is not reached, nor than a moving obstacle lets. */
double cn_drive_lookahead(const cn_model_body *body);
double cn_drive_aim(const cn_model_body *body, const cn_body_state *state, const cn_path *path);

/* --- drive_push.c: the clinician's drive: forces come from the base alone --- */
/* Refuses in words what it cannot drive: no catheter, no sheath, an end that cannot be bent so. */
cn_status cn_push_check(const cn_body_spec *spec, bool sheath, cn_error *error);
void cn_push_prepare(const cn_model_body *body, const cn_body_state *state, const cn_path *path, double dt,
                     cn_drive *drive);
/* After a step, with s_goal known: whether to go on, to turn, or to draw back and try again. */
void cn_push_progress(const cn_model_body *body, cn_body_state *state, const cn_path *path);
/* Curvature of a steered end as a share of its full one, below 0 away from n; it stands with the rod's
 * rotations (body.h). Others: 0, and nothing is set. */
double cn_push_bent(const cn_model_body *body, const cn_body_state *state);
void cn_push_bend(const cn_model_body *body, cn_body_state *state, double bend);
/* Draws the base back to `inserted` before it goes on, along whatever path it is then given. */
void cn_push_back(cn_body_state *state, double inserted);
/* True while it turns or draws back: no progress is asked of it. */
bool cn_push_busy(const cn_model_body *body, const cn_body_state *state);
void cn_axis_points(const cn_model_body *body, const cn_body_state *state, int *naxis, double *axis);

#endif
