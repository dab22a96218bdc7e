/* step_parts.h - one stage of a step as a minimum over all bodies that are solved together: shared by step.c,
 * which makes stages of an integrator, step_newton.c, which finds the minimum, step_touch.c, which asks
 * contact, and step_solve.c, which solves for a direction. */
#ifndef CN_STEP_PARTS_H
#define CN_STEP_PARTS_H

#include "catnav/vec3.h"
#include "sim.h"

/* A slice of a body, which turns as one: how it goes on (step_ahead.c). */
typedef struct {
    const int *node, *end;
    double way[3], turn[3]; /* by dx: of its centre; a rotation vector */
    double mass;
} cn_slice;

/* What belongs to one body. */
typedef struct {
    const cn_model *model;
    const cn_model_body *body;
    int index; /* of the model's bodies */
    cn_pool *pool;
    cn_matrix *matrix, damping; /* damping shares the pattern; its values only with damping_stiffness */
    cn_scatter *scatter;
    cn_solver *solver;
    cn_carry *carry; /* NULL: the points are the nodes */
    cn_drive drive;
    int *node, *slice, nslice; /* nodes slice by slice, which couple to their neighbours only; one: all */
    cn_slice *led;             /* scratch (nslice) */
    double *memory;
    /* by blocks (nblock x 3): */
    double *u; /* the unknown: x - x0, kept apart so that v = (u - lag) / h carries no round-off of x */
    double *ahead, *lag, *constant; /* of the stage */
    double *trial, *trial_u;        /* line search */
    double *gradient, *elastic, *external, *path, *touch, *dx;
    double *moved, *damped; /* of damping_stiffness */
    double *axis;
    double *cg[4];                      /* of conjugate gradients over all bodies */
    double *spin;                       /* a rod's inertia in world axes at the step's start (nnode x 9) */
    bool anchored;                      /* a node is held by the scene */
    unsigned char *held;                /* fixed, or a rod's in the sheath (nblock) */
    double residual_scale, energy_size; /* largest force norm [N]; sum of the energies' sizes [J] */
    double energy;                      /* as last evaluated [J] */
    bool linked;                        /* contact joins it to others, or to itself */
    int rank;                           /* in the work's order */
    double room;                        /* cn_fold_room at the step's start [m] */
    bool settled;                       /* in balance, and nothing touches it: left out of the iteration */
    bool sheet;                         /* a wall that deforms: its matrix is constant through a step, ... */
    double sheet_h;                     /* ... factored for this one, at factored_turn; 0: not yet */
    bool factored;                      /* the solver holds a factor of an earlier iteration, made ... */
    int factored_nfree;                 /* ... with this many free nodes */
    double factored_h;                  /* ... and this step */
    double *factored_turn;              /* ... at these element rotations (nturn x 4) */
    double *bent; /* frames at the step's start with the end bent as in it (nturn x 4) */
} cn_part;

/* What is fixed while one minimum is sought, for one body:
 *     |u - ahead|^2_M / (2 h^2) + |u - lag|^2_C / (2 h) + elastic + drive + contact - (external + constant) .
 * u, u = x - x0, so that the velocity is (u - lag) / h. */
typedef struct {
    cn_part *part;
    const cn_body_state *from; /* x0, v0 */
    double h;
    int nfree, nactive;   /* nodes; nactive: one held station more than nfree */
    int last, again;      /* for EACH_FREE */
    int rows;             /* leading matrix rows that take part */
    double *x, *rotation; /* of the trial */
    const cn_path *path;  /* NULL: none */
    bool free_flight;     /* nothing holds, drives or can touch it */
} cn_stage;

typedef struct cn_wall_solve cn_wall_solve; /* step_wall.c */
struct cn_press;                            /* molecules.h */

struct cn_work {
    const cn_model *model;
    cn_pool *pool;
    int first, npart; /* of the model's bodies */
    cn_part *part;
    cn_stage *stage; /* (npart) */
    int *order;      /* of parts in which links between them are eliminated: the softest first (npart) */
    /* contact of all of them; surface s < npart is part s's. NULL: nothing to touch */
    cn_contact_model *surfaces;
    cn_contact *contact;
    cn_wall_solve *wall; /* NULL: no wall deforms, or more than one */
    cn_penalty *penalty; /* NULL: another response */
    cn_hang *hang;       /* (nsurface) */
    int *nfree;          /* leading points that take part (nsurface) */
    double *memory;      /* by points of all surfaces (npoint x 3): */
    double *points;      /* where they are, ... */
    double *trial;       /* ... at a trial, ... */
    double *motion;      /* ... between */
    double *goal;        /* where walls that move go to */
    double *begin;       /* where everything was at the step's start */
    double *force, *mass;
    double *axis;    /* points of axes to be inside (all nodes x 3) */
    bool moving;     /* a wall goes along a path, ... */
    double way_left; /* ... this part of its way in the step is still to go */
    double slip;     /* sliding in a step that still counts as sticking [m], 0: no friction */
    bool touched;    /* the surfaces of bodies take part in this step */
    double collision_s;
    double energy_size;     /* of all energies [J] */
    double added;           /* inertia that last made the exact tangent positive definite, over M/h^2 */
    bool straight;          /* directions are taken as they are, not along circles */
    unsigned needed, stale; /* the state's, as this step goes on */
    double forcing;         /* what an iterative solver may leave of the residual */
    const volatile sig_atomic_t *cancel; /* NULL: nothing ends a step early */
};

/* All bodies of a work in one stage. */
typedef struct {
    cn_work *work;
    int n;
    cn_stage *stage;
    bool strict;
    bool pressed; /* penalty's springs act */
} cn_group;

/* Blocks i of free nodes: their positions, then a rod's rotations. */
#define EACH_FREE(s, i)  for (int i = 0; i < (s)->last; i = i + 1 == (s)->nfree ? (s)->again : i + 1)
#define EACH_STAGE(g, s) for (cn_stage *s = (g)->stage; s < (g)->stage + (g)->n; s++)

typedef enum { CN_AT_STATE, CN_AT_TRIAL } cn_where; /* stage->x, or part->trial */

/* --- step.c --- */
/* Gravity, loads that are on, and the drive's held part, into part->external. */
void cn_stage_external(const cn_stage *s, double time);

/* --- step_check.c --- */
/* What the contact's response makes of the new state, and the check. CN_ERR_NOT_FREE: strict contact does not
 * accept it. */
cn_status cn_stage_meet(const cn_group *g, cn_state *trial, double dt, cn_step_figures *figures);
/* The check alone, which shares nothing with the response. */
cn_status cn_stage_check(cn_work *work, const cn_state *state, cn_findings *findings);

/* --- step_ahead.c --- */
/* Bends every part's dx, straight motions from x, along with what turns by them: a compact body as a whole, a
 * slender one joint by joint; to second order the stretch of a straight motion is gone. chord: dx is the
 * motion that led to x, to go on as it was; else a tangent there. */
void cn_stage_lead(const cn_group *g, bool chord);

/* --- step_explicit.c --- */
/* Takes every body through the step, x and v of `trial` with it. CN_ERR_ARG: more substeps than are taken;
 * CN_ERR_NOT_FINITE. */
cn_status cn_step_explicit(const cn_group *g, cn_state *trial, double time, double dt);

/* --- step_newton.c --- */
/* Takes the stage's start: every u and x as they are, moved by its part's dx (moved false: not) as far as
 * contact lets them. */
cn_status cn_stage_start(const cn_group *g, bool moved);
cn_status cn_stage_minimise(const cn_group *g, cn_step_figures *figures);
/* Below this the gradient is round-off of the elastic forces: strain carries the round-off of positions, over
 * the elements' size. */
double cn_stage_floor(const cn_stage *s);

bool cn_stage_touched(const cn_stage *s); /* contact pushed on it when last asked */

/* Matrices of the bodies as they are, without contact. */
void cn_stage_assemble(const cn_group *g);

/* --- step_bounce.c --- */
/* What restitution adds to velocities, into every part->ahead. */
cn_status cn_stage_bounce(const cn_group *g);

/* --- step_penalty.c --- */
/* Finds what penetrates where the stages are. */
cn_status cn_stage_penetrations(const cn_group *g);
/* Energy of the springs; their force into every part->touch; stiff: also into the matrices. */
double cn_stage_add_penalty(const cn_group *g, cn_where at, bool stiff);
/* Of the springs on part p alone, which explicit steps damp critically: the force at the stage's x and at v
 * added to f; their share of a press's bounds, by scratch of blocks. */
void cn_stage_press(const cn_group *g, int p, const double *v, double *f);
void cn_stage_press_bound(const cn_group *g, int p, double *scratch, struct cn_press *press);
/* wall_force, and the momentum that forces which are not equal and opposite make up. */
void cn_stage_penalty_figures(const cn_group *g, double dt, cn_step_figures *figures);

/* --- step_touch.c --- */
/* Points of all surfaces into `points` (work's), of the bodies at that place. */
void cn_touch_points(const cn_group *g, cn_where at, double *points);
/* Contact's energy, its force into every part->touch; stiff: also the matrices (cleared before) and links. */
double cn_touch(const cn_group *g, cn_where at, bool stiff, bool exact);
/* Notes where pairs press now; friction is like that from here on. */
void cn_touch_note(const cn_group *g, double friction);
/* The trial, a motion as long as it was to be, did not serve. */
void cn_touch_overshot(const cn_group *g);
/* Lists pairs around where things are, with `moves` for a motion to come. */
cn_status cn_touch_find(const cn_group *g, bool moves);
/* Largest part of *fraction of every part's dx that strict contact allows; pairs are listed anew when the
 * motion leaves their reach, or at once (`anew`). */
cn_status cn_touch_allowed(const cn_group *g, bool anew, double *fraction);
/* Walls that move, at the trial: this part of the way they have left; and when that is taken. */
void cn_touch_walls(cn_work *work, double fraction);
void cn_touch_walls_taken(cn_work *work, double fraction);

/* --- step_solve.c --- */
/* An earlier factor of every body serves: see there. */
bool cn_stage_keeps(const cn_group *g);
cn_status cn_stage_factor(const cn_group *g);
/* dx = - H^-1 g with the factors at hand and contact's links, and its slope g . dx. */
cn_status cn_stage_solve(const cn_group *g, double *slope, cn_step_figures *figures);
/* Motion of a surface's point when its body's blocks move by v; a force on a point, added to those on them.
 */
void cn_point_motion(const cn_part *part, int point, const double *v, double out[3]);
void cn_point_force(const cn_part *part, int point, const double force[3], double *f);
/* Which of a link's four points are a side's: from begin up to end. */
static inline void cn_link_points(const cn_link *link, int side, int *begin, int *end)
{
    *begin = side ? link->nside : 0, *end = side ? 4 : link->nside;
}
/* Of the points of a link's side, a part's: sum w_i n . v_i when its blocks move by v; f += y w_i n on them.
 */
double cn_link_along(const cn_work *work, const cn_link *link, int side, const double *v);
void cn_link_push(const cn_work *work, const cn_link *link, int side, double y, double *f);
bool cn_stage_iterative(const cn_group *g); /* some solver is */

/* --- step_wall.c: one wall that deforms, its unknowns condensed --- */
/* For steps of h; *out NULL where it could not help. */
cn_status cn_wall_solve_new(cn_wall_solve **out, cn_work *work, double h, cn_error *error);
void cn_wall_solve_free(cn_wall_solve *wall);
int cn_wall_part(const cn_wall_solve *wall); /* which of the work's */
/* The matrix of a wall for this step, as its rotations turn it, and its factor, unless they are there. */
cn_status cn_wall_factor(const cn_stage *s);
/* Notes the links on the wall and what it gives way under each; false where they are too many, or of another
 * kind: they are solved as all links are then. */
bool cn_wall_take(const cn_group *g);
/* Right sides cg[R] of the other bodies, as the wall's own changes them; then cg[Q] += what the links with
 * the wall add to their product with cg[P]; at the end the wall's dx from theirs. */
cn_status cn_wall_begin(const cn_group *g);
void cn_wall_add(const cn_group *g);
void cn_wall_end(const cn_group *g);

/* out = M a of block i, without the factor that `leave_out.inertia` takes. */
static inline void cn_stage_mass(const cn_stage *s, int i, const double a[3], double out[3])
{
    const cn_body *b = s->part->body->body;
    if (i < b->nnode)
        for (int k = 0; k < 3; k++)
            out[k] = b->mass[i] * a[k];
    else
        cn_mat_vec(s->part->spin + 9 * (size_t)(i - b->nnode), a, out);
}
double cn_step_seconds(void);

#endif
