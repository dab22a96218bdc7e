/* study.h - measured comparisons of methods on a scene; `catnav study` prints them. */
#ifndef CN_STUDY_H
#define CN_STUDY_H

#include "catnav/plan.h"
#include "catnav/report.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    void *user;
    void (*progress)(void *user, const char *what); /* several times a second: a line for the user */
    const volatile sig_atomic_t *cancel;            /* non-zero: stop within a step */
    int steps; /* from each state by each method, at most CN_STUDY_STEPS; 0: so many */
    int total; /* accepted steps of the scene's run where they are known: no first run then; 0: they are not
                */
} cn_study_hooks; /* any of them may be NULL or 0 */

/* --- the paper's method against the scene's own: CSV and JSON `paper` ---
 * The paper's method: same mesh (of a rod: linear tetrahedra, those that ride on it), assembly, threads;
 * contact.method project, solver.newton 1 (frozen rotations, one solve a step), solver.linear cg
 * (block-Jacobi) to 1e-4 in at most 1000 iterations. */
enum { CN_STUDY_STATES = 3, CN_STUDY_STEPS = 200 };
typedef enum { CN_STUDY_OWN, CN_STUDY_PAPER, CN_STUDY_METHODS } cn_study_method;
const char *cn_study_method_name(int method); /* "own", "paper" */

/* What the steps of one method from one state came to; spreads are over the steps taken. */
typedef struct {
    int steps;         /* taken, of CN_STUDY_STEPS */
    cn_status failure; /* why the next one could not be computed: the method ends there; CN_OK: all were */
    cn_spread step_ms; /* wall time as a run takes a step: solve, contact, recomputed residual; no limits */
    cn_spread fem_ms, collision_ms;
    double ratio;                      /* of median step_ms to the own method's */
    cn_spread residual;                /* recomputed, over the largest force norm */
    cn_spread linear, newton;          /* iterations: the most of a solve, and of the step */
    long unconverged;                  /* linear solves that stopped at their last iteration */
    double linear_residual;            /* the worst of theirs, relative; 0: none */
    int rejected;                      /* steps cut into shorter ones */
    long intersections, outside_nodes; /* sums over the steps, by the check that is the same for all */
    double tip_apart; /* after all steps, from the own method's tip [m]; NAN: one of them failed */
} cn_study_row;

typedef struct {
    double fraction; /* of the run's accepted steps */
    int step;        /* accepted steps before it */
    double time;     /* simulated [s] */
    int free_nodes;  /* out of the sheath */
    cn_study_row row[CN_STUDY_METHODS];
} cn_study_state;

typedef struct {
    cn_report run; /* of the scene by its own method */
    int nstate;    /* fewer than CN_STUDY_STATES where the run was refused or cancelled */
    cn_study_state state[CN_STUDY_STATES];
} cn_study;

/* Runs the scene to its end, then again, and at 25, 50 and 90 % of its accepted steps goes CN_STUDY_STEPS on
 * by either method, in turns of ten so that the machine's load falls on both. *study is always filled and the
 * caller's to clear; CN_OK also where the run came to nothing (its verdict says why). */
cn_status cn_study_paper(cn_world *world, cn_planner planner, int threads, const cn_study_hooks *hooks,
                         cn_study *study, cn_error *error);
void cn_study_clear(cn_study *study);
/* Writes FOLDER/paper.csv and FOLDER/paper.json; makes the folder and those above it. */
cn_status cn_study_write(const cn_study *study, const char *folder, cn_error *error);

/* Cost of collision detection, the least of five timings each: a wall of `ntri` triangles, and a tube of as
 * many that lies on its bottom all along. */
typedef struct {
    int ntri;                            /* of either, as made */
    long pairs;                          /* of boxes within the gap, that the query finds */
    double build_ms, refit_ms, query_ms; /* one tree; one tree; all pairs */
} cn_detection_cost;
cn_status cn_study_detection(int ntri, cn_detection_cost *cost);

/* Cook's membrane (Cook, J. Struct. Div. ASCE 100, 1974): corners (0,0) (48,44) (48,60) (0,44), held on the
 * left, sheared by 1 per thickness on the right; E = 1; small strains. */
typedef struct {
    int nodes, dof;
    double corner, middle; /* vertical displacement of (48,60) and (48,52) */
    double seconds;        /* of this process: body, matrix, analysis, factor, solve */
} cn_cook;
/* `cells` (even, 2 to 256) a side, one through the thickness, of linear or second-order tetrahedra, in plane
 * strain or plane stress. CN_ERR_ARG, CN_ERR_MEMORY. */
cn_status cn_study_cook(int cells, bool quadratic, bool strain, double poisson, cn_cook *cook);

#ifdef __cplusplus
}
#endif
#endif
