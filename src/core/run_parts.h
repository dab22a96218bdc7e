/* run_parts.h - the parts of a run: doors, plans, record, limits; private to run*.c. */
#ifndef CN_RUN_PARTS_H
#define CN_RUN_PARTS_H

#include "catnav/run.h"
#include "plan_avoid.h"
#include "sim.h"

enum { CN_CHECKPOINTS = 64, CN_LAST_STEPS = 100 };

typedef struct {
    cn_state *state; /* NULL: unused */
    double s;        /* of the goal node on the path then in force [m] */
} cn_checkpoint;

/* What belongs to one body in a run. */
typedef struct {
    cn_path *path; /* NULL: no waypoints */
    cn_roadmap roadmap;
    double *vertex_s;    /* arc lengths of the roadmap vertices on the path (roadmap.npoint) */
    double *von_mises;   /* (ntet) */
    double *measured;    /* where measures are of (nblock x 3) */
    double *turn;        /* copy of the rotations for frames: looking must not change the run (nturn x 4) */
    double *points;      /* scratch of cn_run_points and cn_run_met (the larger npoint x 3) */
    cn_surface *surface; /* of a skin that is not hung yet */
    cn_skin *skin;       /* that it wears, NULL: none, and */
    cn_skin_state *worn; /* how it was when last looked at */
    double *node_turn;   /* rotations of nodes, NULL: the skin needs none (nnode x 4) */
    cn_measures measures;
    int nlimit, first_limit; /* in report->limit */
    int ncheckpoint, next_vertex;
    cn_checkpoint checkpoint[CN_CHECKPOINTS];
    int nrefused;
    cn_ball *refused;
    int refused_capacity;
    cn_avoid *avoid; /* NULL: no obstacle moves */
    int looked;      /* step at which its way past them was last looked at, -1: not on this path */
} cn_run_body;

/* A step as it was taken, kept to be repeated with what was left out. */
typedef struct {
    cn_state *before, *after; /* NULL: not used yet */
    int kept;                 /* Newton iterations with an earlier factor */
    double fem_s;             /* its time [s] */
} cn_shot;

/* A body against itself, seen at some steps. */
typedef struct {
    struct cn_tree *tree; /* over its surface, NULL: not made yet */
    int tested, needed;   /* from these steps on, 0: never */
    int done;             /* from this step on the step itself sees to it, 0: not so far */
    int a, b;             /* triangles that met */
    double distance;      /* [m] */
} cn_self;

enum { CN_SHOTS = 4 };
typedef struct {
    int every; /* accepted steps between two looks, 0: none */
    int nshot, next, stride;
    bool short_run; /* the shot is from before `every` steps */
    cn_shot shot[CN_SHOTS];
    int kept_steps; /* with an earlier factor */
    cn_self *self;  /* (nbody) */
    int turned;     /* walls turn from this step on, 0: not so far */
} cn_leave;

typedef struct cn_run_data cn_run_data;
/* Called after every accepted step; false ends the run there, without a verdict. */
typedef bool (*cn_run_visit)(void *visitor, cn_run_data *run);

struct cn_run_data {
    cn_world *world;
    const cn_scene *scene;
    const cn_request *request;
    cn_planner planner;
    const cn_run_hooks *hooks;
    cn_report *report;
    cn_error error;
    int threads;
    cn_pool *pool;
    unsigned seed;
    double budget;
    int nbody;
    cn_body_spec *spec; /* the scene's, as the request changed them (arrays below are the run's own) */
    double *waypoint;
    cn_limit *limit;
    cn_model *model;
    cn_state *state, *trial, *spare;
    cn_run_body *body;
    int nwork; /* each of bodies that are solved together */
    cn_work **work;
    const cn_path **path;     /* of the bodies, for a step (nbody) */
    cn_step_figures *figures; /* (2 nbody): of a step, and of one part of it */
    int shown_step;           /* of the last frame handed out, -1: none */
    long newton;              /* Newton iterations in all, and */
    long kept;                /* those that an earlier factor served */
    cn_leave leave;
    int nsample;                                /* steps sampled */
    int nheld, sample_capacity, sample_stride;  /* of them every stride-th is held */
    double *fem_ms, *collision_ms, *step_ms;    /* (nheld) */
    double worst_ms[3], last_ms[CN_LAST_STEPS]; /* largest of all of each; of the last steps, in turn */
    int insertion_stride;                       /* steps between two notes of the bases of push drives */
    cn_run_visit visit;                         /* NULL: nobody */
    void *visitor;
};

/* run.c: cn_run, visited. */
cn_status cn_run_visited(cn_world *world, const cn_request *request, cn_planner planner, int threads,
                         const cn_run_hooks *hooks, cn_run_visit visit, void *visitor, cn_report *report,
                         cn_error *error);
/* Model, states and works of the bodies. */
cn_status cn_run_works(cn_run_data *run, cn_error *error);
void cn_run_works_clear(cn_run_data *run);
/* Paths of the bodies as they are now. */
const cn_path *const *cn_run_paths(const cn_run_data *run);
/* One whole step of a work's bodies from run->state into run->trial: in quarters, sixteenths, ... where it
 * does not converge (counted as rejected steps; run->spare is used). Figures of its bodies in run->figures,
 * at their index. */
cn_status cn_run_advance(cn_run_data *run, int work);

/* A wall or obstacle that deforms (spec NULL: no). */
static inline bool cn_gives_way(const cn_surface_spec *spec)
{
    return spec && (spec->deformable || spec->wall.model != CN_WALL_RIGID);
}

/* run_door.c: what the request asks, and what this build cannot do; refusals in words. */
/* Walls and obstacles that give way are bodies too, behind the scene's own. */
cn_body_spec cn_wall_as_body(const cn_surface_spec *wall);
cn_status cn_run_specs(cn_run_data *run);
cn_status cn_run_supported(cn_run_data *run);
/* Refuses explicit steps that would be cut into too many. */
cn_status cn_run_explicit(cn_run_data *run);
cn_status
cn_run_places(cn_run_data *run); /* entry and waypoints against the walls; device against the lumen */

/* True when a wall lies within a body: the body begins around it. */
bool cn_run_swallowed(cn_run_data *run, int body);
/* The verdict NO_CONTACT_FREE_START with its depth [m], place and what overlaps. */
void cn_run_no_start(cn_run_data *run, int body, double depth, const double where[3], const char *format, ...)
    __attribute__((format(printf, 5, 6)));

/* run_plan.c */
cn_status cn_run_plan_body(cn_run_data *run, int body);
/* Refuses a ball and plans anew; CN_ERR_NO_PATH when nothing else leads on. */
cn_status cn_run_replan(cn_run_data *run, int body, const cn_ball *refused);
/* The ball where a limit broke: at the goal's place on its path, with the clearance there. */
cn_ball cn_run_broken_at(const cn_run_data *run, int body);
/* Before a step, past moving obstacles: whether the body may go on, waits or turns back. False: none of it
 * keeps clear of them on this path; the ball to refuse, and the verdict where nothing else leads on. */
bool cn_run_yield(cn_run_data *run, int body, cn_ball *refused, cn_verdict *broken, cn_status *status);
void cn_run_checkpoint(cn_run_data *run, int body);

/* run_limits.c: measures the trial state; true when a limit is broken, with the verdict filled. */
bool cn_run_limits(cn_run_data *run, int body, cn_state *trial, const cn_step_figures *figures,
                   cn_verdict *broken);
/* Index of the last waypoint reached: in the request's own list, where the entry is number 0, or the scene's.
 */
int cn_run_waypoint(const cn_run_data *run, const cn_state *state, int body);
double cn_run_margin(const cn_run_data *run, const char **of);

/* run_leave.c: after an accepted step: keeps it now and then (whole: it was not cut into parts); looks
 * whether a body meets itself. Neither changes anything of the run. */
void cn_run_shoot(cn_run_data *run, const cn_step_figures *figures, bool whole);
void cn_run_watch(cn_run_data *run);
void cn_run_forget_shots(cn_run_data *run); /* the path they followed is no more */
/* Before a step with `leave_out.refit: off`: no other run may use the world then. */
void cn_run_refit(cn_run_data *run);
/* When the run is over: what was left out, why, the time that saved and the error it made. The state stays as
 * it is; the works, `trial` and `spare` do not. */
void cn_run_left_out(cn_run_data *run);
void cn_leave_clear(cn_leave *leave, int nbody);

/* run_skin.c: a body's skin, where the scene gives one: made, hung on the body, brought to where the state is
 * (false: there is none, or its numbers are not finite); own->turn holds the rotations then. */
cn_status cn_run_skin_read(cn_run_data *run, int body);
cn_status cn_run_skin_hang(cn_run_data *run, int body);
bool cn_run_skin_bring(cn_run_data *run, int body, const cn_body_state *state);
void cn_run_skin_clear(cn_run_body *body);

/* run_record.c */
void cn_run_verdict(cn_run_data *run, cn_verdict_code code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
cn_status cn_run_sample(cn_run_data *run, const cn_step_figures *figures, double step_s);
/* Largest distance of points x from `rest` (n x 3) turned and shifted to lie over them by least squares, over
 * `size`; NAN where it is not finite. */
double cn_shape_error(int n, const double *x, const double *rest, double size);
void cn_run_finish(cn_run_data *run);                                    /* counts, times, bodies */
void cn_run_frame(cn_run_data *run, const cn_state *state, bool wanted); /* wanted: without asking the hook */
/* Least distance of a free node from the walls where no pair is near enough to be listed; INFINITY: no nearer
 * than what the report already holds. */
double cn_run_far_gap(const cn_run_data *run, int body, const cn_state *state);
/* Leading nodes of a body that take part: the free ones, and one held station of a catheter in its sheath. */
int cn_run_active(const cn_model_body *body, const cn_body_state *state);
/* Positions of the points of the first nactive nodes: the state's own, or in the body's scratch. */
const double *cn_run_points(const cn_run_data *run, int body, const cn_state *state, int nactive);
/* The same of what contact meets. */
const double *cn_run_met(const cn_run_data *run, int body, const cn_state *state, int nactive);
double cn_seconds(void);

#endif
