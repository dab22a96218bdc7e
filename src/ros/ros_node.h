/* ros_node.h - roscpp behind C: all that the node's logic (node.c) needs of ROS, and nothing that decides.
 *
 * Names, topics and messages are those of the contract. No exception crosses this border: a call that cannot
 * reach ROS logs and returns. Calls may come from any thread. Nothing handed over is kept: messages are
 * copies. `frame` is the message's frame_id. SI units. */
#ifndef CN_ROS_NODE_H
#define CN_ROS_NODE_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "catnav/plan.h"
#include "catnav/report.h"
#include "catnav/run.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_ros cn_ros;
typedef struct cn_ros_status cn_ros_status; /* a diagnostic message that is being filled */

/* --- what comes in --- */
typedef struct cn_ros_message cn_ros_message; /* bytes as they came over the wire */
const uint8_t *cn_ros_message_bytes(const cn_ros_message *message, size_t *size);
void cn_ros_message_free(cn_ros_message *message); /* NULL is fine */

typedef struct {
    const char *body, *quantity, *reduce;
    double limit;
} cn_ros_limit;

typedef struct {
    const char *frame;
    int nwaypoint;
    const double *waypoint; /* [m] (nwaypoint x 3) */
    int nlimit;
    const cn_ros_limit *limit;
    const char *sampling, *scene;
    double budget; /* [s] */
    unsigned seed;
    bool scene_seed; /* the scene's seed instead */
    uint64_t stamp;  /* of the header [ns]; 0: none */
} cn_ros_request;

/* What is sent in answer to a call; cn_ros_send_answer frees what it holds. */
typedef struct {
    char frame[64];
    cn_report report;
    cn_path *path; /* NULL: none */
    char *json;    /* the report as text, malloc'd; NULL: none */
} cn_ros_answer;

/* A call of ~plan or a goal of ~plan_action, by number; never 0, never used twice. */
typedef unsigned long cn_ros_call;

/* What the hand does to a waypoint in rviz; DRAGGED: on the way, DROPPED: let go. */
typedef enum {
    CN_ROS_MARK_DRAGGED,
    CN_ROS_MARK_DROPPED,
    CN_ROS_MARK_INSERT,
    CN_ROS_MARK_DELETE,
    CN_ROS_MARK_SNAP,
    CN_ROS_MARK_PLAN,
    CN_ROS_MARK_CLEAR
} cn_ros_mark_event;

enum { MARKS_MOST = 128 };
typedef struct {
    bool success;
    char message[1024];
    int nwaypoint;
    double waypoint[3 * MARKS_MOST]; /* [m] */
} cn_ros_file_reply;

/* What may change between two plans (dynamic_reconfigure); below 0: as the scene says, or ~frame_rate. */
typedef struct {
    double step, time_limit, budget; /* [s] */
    int replans;
    double frame_rate;                     /* [1/s] */
    double limit[CN_QUANTITY_PROGRESS][2]; /* the device's, by quantity and reduce */
} cn_ros_tuning;

typedef struct {
    void *user;
    void (*mesh)(void *user, cn_ros_message *message); /* one at a time; theirs to free */
    /* Several at once; returns soon. The request stays valid until cn_ros_end_call, which must follow once,
     * as must cn_ros_send_answer. */
    void (*plan)(void *user, cn_ros_call call, const cn_ros_request *request);
    void (*cancel)(void *user, cn_ros_call call);      /* it may have been answered meanwhile */
    void (*status)(void *user, cn_ros_status *status); /* diagnostics, once a second */
    void (*feedback)(void *user);                      /* ten times a second */
    void (*click)(void *user, const char *frame, const double point[3]);
    /* On waypoint `at`; point NULL: the event has none. */
    void (*mark)(void *user, cn_ros_mark_event event, int at, const char *frame, const double point[3]);
    void (*save)(void *user, const char *scene, cn_ros_file_reply *reply);
    void (*load)(void *user, const char *scene, cn_ros_file_reply *reply);
    void (*tune)(void *user, const cn_ros_tuning *tuning); /* also once at the start */
} cn_ros_handlers;

/* --- life --- */
/* Starts roscpp without its signal handlers and waits for the master until *stop. CN_ERR_CANCELLED: stopped.
 */
cn_status cn_ros_new(cn_ros **out, int argc, char **argv, const char *name, const volatile sig_atomic_t *stop,
                     cn_error *error);
/* Opens topics, service and action; callbacks come from threads of roscpp's from here on. At most `waiting`
 * calls of the service are kept waiting for their answer beside the one that is worked on. */
cn_status cn_ros_start(cn_ros *ros, const cn_ros_handlers *handlers, int waiting, cn_error *error);
bool cn_ros_ok(const cn_ros *ros);           /* false once the master or rosnode has shut the node down */
bool cn_ros_mesh_senders(const cn_ros *ros); /* does anyone publish on ~artery_mesh? */
/* Messages that have come on all topics; those that roscpp has dropped unread, for its queue was full;
 * meshes, goals and clicked points that were sent and never looked at, by the gaps in their numbers: dropped
 * here or by their senders' queues. Cancels carry no number. */
void cn_ros_traffic(cn_ros *ros, unsigned long *came, unsigned long *dropped, unsigned long *missing);
void cn_ros_free(cn_ros *ros); /* every call is answered; waits for callbacks, shuts down; NULL is fine */
void cn_ros_log(cn_log_level level, const char *file, int line, const char *text); /* to rosconsole */

/* --- frames --- */
/* p in the other frame = rotation p + translation. */
typedef struct {
    double rotation[9], translation[3]; /* [1], [m] */
    bool rest;                          /* the frames are the same: nothing moves */
} cn_ros_motion;
/* From frame `from` to `to` by tf2 at a stamp [ns] (0: the latest), waited for at most `wait` [s]; CN_ERR_ARG
 * with the reason in words. */
cn_status cn_ros_transform(cn_ros *ros, const char *from, const char *to, uint64_t stamp, double wait,
                           cn_ros_motion *motion, cn_error *error);

/* --- private parameters --- */
void cn_ros_text(const cn_ros *ros, const char *key, const char *otherwise, char *out, size_t size);
double cn_ros_number(const cn_ros *ros, const char *key, double otherwise);
/* All private parameters but `except` (ends with NULL) as settings of a scene: ~planner/samples is
 * planner.samples; lists become YAML. Freed by cn_ros_settings_free. */
cn_status cn_ros_settings(const cn_ros *ros, const char *const *except, int *n, cn_setting **out);
void cn_ros_settings_free(int n, cn_setting *setting);

/* --- calls --- */
void cn_ros_begin_call(cn_ros *ros, cn_ros_call call); /* work on it begins: a goal becomes active */
/* One limit in the feedback; `worst` NAN: not measured yet. */
typedef struct {
    char body[64];
    cn_limit limit;
    double worst;
} cn_ros_margin;
void cn_ros_send_feedback(cn_ros *ros, cn_ros_call call, const cn_progress *progress, const char *stage,
                          double real_time_factor, int nmargin, const cn_ros_margin *margin);
void cn_ros_send_answer(cn_ros *ros, cn_ros_call call, cn_ros_answer *answer); /* and clears it */
void cn_ros_answer_clear(cn_ros_answer *answer);                               /* frees what it holds */
void cn_ros_end_call(cn_ros *ros, cn_ros_call call); /* its request is no longer needed */

/* --- what goes out; `id` tells several bodies or walls apart, and late subscribers get the last of each ---
 */
void cn_ros_send_topology(cn_ros *ros, const char *frame, const char *name, unsigned id, int ntet,
                          const int *tet, int ntri, const int *tri);
void cn_ros_send_state(cn_ros *ros, const char *frame, unsigned id, int step, double time, int nvert,
                       const double *x, const float *stress);
/* Triangles whose vertices are all below nactive, coloured by stress from blue (0) to red (`full` [Pa]); of
 * the triangles of a body or wall every `stride`-th (1: all). */
void cn_ros_send_catheter(cn_ros *ros, const char *frame, const char *name, unsigned id, int nactive,
                          int ntri, const int *tri, int stride, const double *x, const float *stress,
                          double full);
void cn_ros_send_artery(cn_ros *ros, const char *frame, const char *name, unsigned id,
                        const cn_surface *surface, int stride);
void cn_ros_send_roadmap(cn_ros *ros, const char *frame, unsigned id, const cn_roadmap *roadmap);
void cn_ros_send_path(cn_ros *ros, const char *frame, const cn_path *path);
void cn_ros_send_medial_axis(cn_ros *ros, const char *frame, int n, const double *x, const double *clearance);
void cn_ros_forget_arteries(cn_ros *ros); /* takes the walls off every screen */
void cn_ros_forget_bodies(cn_ros *ros);   /* takes bodies, roadmaps and path off every screen */

/* Waypoints as interactive markers; why[i] "": it may stand there, else it is red and says why. */
void cn_ros_send_marks(cn_ros *ros, const char *frame, int n, const double *x, const char *const *why,
                       double size);

/* What the node is built with, ended by an entry without `what`. */
typedef struct {
    const char *what, *version;
} cn_ros_version;
const cn_ros_version *cn_ros_versions(void);

/* --- diagnostics: the handler fills figures when asked, by cn_ros_figure --- */
typedef enum { CN_ROS_OK, CN_ROS_WARN, CN_ROS_ERROR } cn_ros_level;
void cn_ros_summary(cn_ros_status *status, cn_ros_level level, const char *message);
void cn_ros_figure(cn_ros_status *status, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#ifdef __cplusplus
}
#endif
#endif
