/* report.h - the verdict ("is it allowed?") and the figures of a run; design contract sections 7 and 10. */
#ifndef CN_REPORT_H
#define CN_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include "catnav/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* name, report status, exit code of the command. A zeroed verdict is unknown: it cannot pass for success. */
#define CN_VERDICT_LIST(X)                                                                                   \
    X(UNKNOWN, "failed", 4)                                                                                  \
    X(REACHED, "reached", 0)                                                                                 \
    X(RAN, "ran", 0)                                                                                         \
    X(BAD_INPUT, "bad_input", 1)                                                                             \
    X(NO_ARTERY, "bad_input", 1)                                                                             \
    X(NO_CONTACT_FREE_START, "infeasible", 2)                                                                \
    X(NO_PATH, "infeasible", 2)                                                                              \
    X(LIMIT_BROKEN, "infeasible", 2)                                                                         \
    X(TIMEOUT, "time_limit", 3)                                                                              \
    X(NUMERICS, "failed", 4)                                                                                 \
    X(CANCELLED, "interrupted", 130)                                                                         \
    X(BUSY, "failed", 4)
#define CN_VERDICT_ENUM(name, status, exit) CN_VERDICT_##name,
typedef enum { CN_VERDICT_LIST(CN_VERDICT_ENUM) CN_VERDICT_COUNT } cn_verdict_code;
const char *cn_verdict_name(int code);   /* "REACHED" ...; never NULL */
const char *cn_verdict_status(int code); /* "reached" ... */
int cn_verdict_exit(int code);

typedef struct {
    cn_verdict_code code;
    int fault; /* what was wrong with the input: cn_error's, 0: nothing */
    char message[1024];
    bool has_quantity;
    cn_quantity quantity; /* what was broken */
    double value, limit;  /* NAN: undefined */
    char body[64];
    int element;        /* -1: none */
    double position[3]; /* [m]; NAN: none */
    int step;           /* -1: before the first */
    double time;        /* simulated [s] */
    int waypoint;       /* last one reached, -1: none */
} cn_verdict;

typedef struct {
    double median, p95, p99, max; /* p95: the least sample that at least 95 % do not exceed */
} cn_spread;                      /* NAN when empty */

typedef struct {
    char body[64];
    cn_limit limit;
    double worst;
    int step, element;
    double time, position[3];
} cn_limit_report;

typedef struct {
    char name[64];
    cn_body_model model;
    double tip[3], goal[3], goal_distance, com[3];
    double rest_volume, volume, energy, kinetic, momentum[3], angular_momentum[3];
    double shape_error; /* largest distance of a point from the rest shape laid over it, over the size */
    /* stiffness of mesh over theory minus one (NAN: no beam), and the part of it that the section's polygon
     * alone makes: what its elements add is (1 + error) / (1 + polygon) - 1 */
    double error_bending, error_torsion, error_axial;
    double polygon_bending, polygon_torsion, polygon_axial;
} cn_body_report;

/* Work that was left out. Measured at up to four steps of the run, repeated with that work when the run is
 * over, and taken for all: the wall time it would have taken [s] (less than zero where leaving it out cost
 * more), and the largest difference of a node's position after such a step, over the body's size. */
typedef struct {
    const char *what; /* the leave_out key, or `sheath` */
    char why[160];
    double time_saved_s, error; /* NAN: not measured */
} cn_left_out;

/* Where the base of a push drive was: what a robot would run. */
typedef struct {
    int body, step;
    double time, advance, twist; /* [s]; of the tip past the entry along the device [m]; of the base [rad] */
    double curvature;            /* to which its end is bent: pre-bent, or as steered [1/m] */
} cn_insertion;

typedef struct {
    char scene[128];
    unsigned seed;
    int threads;
    bool reproducible;
    cn_verdict verdict;
    struct {
        int nodes, dof, tets, rigid_nodes, deformable_nodes, wall_triangles;
    } counts;
    struct {
        double map_s, planning_s, simulation_s, collision_s, wall_s, simulated_s, real_time_factor;
        cn_spread fem_ms, collision_ms, step_ms, step_ms_last100;
    } time;
    int steps, rejected_steps, replans;
    struct {
        double gap_min;
        long intersections, outside_nodes;
        double force_max;
        double momentum_error; /* of penalty, else NAN: made by forces not equal and opposite [kg m/s] */
    } contact;                 /* gap NAN: no walls */
    struct {
        double force_max, work;
        int ninsertion; /* at most 1,000 for each body with a push drive, in equal steps and the last one */
        cn_insertion *insertion;
    } drive;
    int nlimit;
    cn_limit_report *limit;
    struct {
        int newton_max, linear_max;
        double residual_max;
        int inverted_max;
    } solver;
    int nbody;
    cn_body_report *body;
    int nleft_out;
    cn_left_out left_out[8];
    struct {
        double length, clearance_min, turn_max;
        unsigned seed; /* from which it was planned */
    } path;            /* of the last plan; NAN: none */
    size_t memory_peak_bytes;
} cn_report;

void cn_report_clear(cn_report *report); /* frees what it owns, zeroes */
/* The report as JSON text (malloc'd), NULL when out of memory. Non-finite figures are null, never absent. */
char *cn_report_json(const cn_report *report);
/* Writes it to PATH by way of a temporary file and rename: never half-written. */
cn_status cn_report_write(const cn_report *report, const char *path, cn_error *error);
cn_spread cn_spread_of(int n, double *samples); /* sorts samples in place */
size_t cn_memory_peak(void);                    /* VmHWM of this process */

#ifdef __cplusplus
}
#endif
#endif
