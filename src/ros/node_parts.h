/* node_parts.h - what the node's files share.
 *
 * Threads: meshes come one at a time, calls several at once, both on threads of roscpp's; one thread of the
 * node's own works the calls off, one after the other: it alone runs plans. `lock` guards what they share and
 * is never held while ROS is called; a stage (scene and world) is const once it is in force and lives as long
 * as somebody uses it, so a new mesh never disturbs a running plan. */
#ifndef CN_NODE_PARTS_H
#define CN_NODE_PARTS_H

#include <limits.h>
#include <pthread.h>
#include "catnav/run.h"
#include "node.h"
#include "ros_node.h"

/* A scene and its world. */
typedef struct {
    int refs;
    cn_scene *scene;
    cn_world *world;
    char frame[64]; /* of its coordinates, "" where the sender of the mesh named none */
} stage;

/* A deforming body in the plan under way. */
typedef struct {
    const cn_body *body; /* gone when its run has ended */
    unsigned id;
    char name[64];
    int npoint, ntet;
    unsigned long long sum; /* of the mesh it began with: see checksum */
    float *stress;          /* per vertex [Pa] (nnode) */
    double highest;         /* so far [Pa]: the colour scale where there is no limit */
    /* of the skin it wears; NULL: none */
    unsigned skin_id;
    float *skin_stress; /* per vertex [Pa] */
    double *scratch;    /* stress of nodes and vertices [Pa] (nnode + nvert) */
    int *hangs_on;      /* the first anchor of each vertex */
    int *skin_tri;      /* triangles out of the sheath (ntri x 3) */
} shown;

/* A call on its way to its answer. */
typedef struct {
    cn_ros_call call;
    const cn_ros_request *request;
} ticket;

/* A mesh as it came: what its message says, which it lies in. */
typedef struct {
    cn_ros_message *message;
    cn_error error; /* the message is no mesh */
    char frame[128], name[128];
    uint64_t stamp; /* of the header [ns]; 0: none */
    size_t nvert, ntri;
    const uint8_t *vert, *tri; /* float64 [m] (nvert x 3), uint32 (ntri x 3): any value, anywhere in memory */
} came_mesh;

#define OWN_CALL ULONG_MAX /* the node's own call: ROS does not know it */
enum { QUEUE_MOST = 64, MARGINS_MOST = 32, MESHES_MOST = 8 };

struct cn_node {
    cn_ros *ros;
    const volatile sig_atomic_t *stop;
    volatile sig_atomic_t cancel; /* the plan under way must end */
    int threads;
    char scene_file[PATH_MAX], scene_dir[PATH_MAX], frame[64];
    char data_dirs[PATH_MAX]; /* further folders that requested scenes may read from, between colons */
    double own_rate;          /* ~frame_rate [1/s] */
    int triangles;            /* most of a marker */
    int nsetting;
    cn_setting *setting;

    pthread_t worker;
    bool working; /* the thread is there */
    pthread_mutex_t lock;
    stage *stage; /* in force for plans without a scene of their own; NULL: none yet */
    int checking; /* meshes and scenes being checked */
    pthread_cond_t called;
    bool leaving;      /* no call is taken any more */
    int nqueue, queue; /* calls that wait; most of them: 0 where a call is refused while another is open */
    ticket waiting[QUEUE_MOST];
    ticket now;          /* worked on */
    bool open;           /* and not yet answered */
    bool answering;      /* a cancel is answering it */
    bool preparing;      /* nothing moves yet: scene, map, path; a cancel does not wait for them */
    int fault;           /* of that refusal */
    char refusal[1024];  /* why the last mesh or the scene was refused, "" when it was not */
    double frame_period; /* [s] */
    int frames_sent, frames_dropped; /* dropped on purpose: more often than ~frame_rate */
    int frames_told;                 /* sent when diagnostics were last filled, */
    double told;                     /* at this time [s] */
    long triangles_left_out;
    int meshes_dropped, calls_refused;
    cn_ros_tuning tuning;
    stage *foreign; /* of the last mesh in a frame that tf cannot bring into the node's; NULL: none */
    int nmark;      /* waypoints set by mouse, in the node's frame */
    double mark[3 * MARKS_MOST];
    bool marks_changed;
    bool own_open; /* a call of the node's own, through them, is not yet answered */
    cn_ros_request own;
    double own_point[3 * MARKS_MOST];
    cn_progress progress; /* of the call worked on */
    double progress_at, real_time_factor;
    int nmargin;
    cn_ros_margin margin[MARGINS_MOST];
    char verdict[32];

    pthread_t checker; /* of meshes */
    bool is_checking;  /* the thread is there */
    pthread_cond_t mesh_came;
    int ncame;
    came_mesh *came[MESHES_MOST]; /* waiting to be checked: one of a name, the newest */

    /* of the checker alone */
    int nmesh;
    cn_replacement *mesh; /* in force, the node's own */

    /* of the plan under way alone */
    char run_frame[64];
    int nshown;
    shown *shown;
    unsigned last_id;
    double last_frame; /* [s] */
};

/* The calling thread, and those that it starts from now on, leave the processor to plans: nicer by so many
 * steps. */
void step_back(int steps);

/* --- node_mesh.c: stages and the meshes they are made of --- */
/* Reads a scene (`requested`: one that stays in its folders) with the node's settings, checks its walls with
 * the meshes in their place, makes the map. */
cn_status stage_new(stage **out, cn_node *node, const char *file, int nmesh, const cn_replacement *mesh,
                    const char *frame, bool requested, cn_error *error);
void stage_free(stage *s);
stage *stage_take(cn_node *node);         /* the one in force, kept until dropped; NULL: none */
void stage_drop(cn_node *node, stage *s); /* NULL is fine */
void stage_show(cn_node *node, const stage *s, const char *frame);
/* A scene without vessels has no artery to wait for; any other waits for its mesh. A scene that cannot be
 * read is refused now and at every mesh. */
void stage_first(cn_node *node);
cn_status meshes_start(cn_node *node);
void meshes_stop(cn_node *node);
void on_mesh(void *node, cn_ros_message *message);
void meshes_free(int n, cn_replacement *mesh);

void came_free(came_mesh *mesh); /* NULL is fine */

/* --- node_wire.c --- */
cn_status mesh_look(came_mesh *mesh, size_t size, const uint8_t *bytes, cn_error *error);
/* Makes a surface whose numbers are finite and whose triangles name vertices. */
cn_status mesh_unpack(const came_mesh *mesh, cn_surface **out, cn_error *error);

/* --- node_frames.c --- */
bool frames_same(const char *a, const char *b);
/* What brings points from one frame into another; rests where `from` is empty or the same. */
cn_status frames_join(cn_node *node, const char *from, const char *to, uint64_t stamp, cn_ros_motion *motion,
                      cn_error *error);
void frames_move(const cn_ros_motion *motion, int n, double *points);
void frames_inverse(const cn_ros_motion *motion, cn_ros_motion *inverse);
void frames_move_answer(const cn_ros_motion *motion, cn_ros_answer *answer);

/* --- node_marks.c: waypoints set by mouse --- */
void on_click(void *node, const char *frame, const double point[3]);
void on_mark(void *node, cn_ros_mark_event event, int at, const char *frame, const double point[3]);
void on_save(void *node, const char *scene, cn_ros_file_reply *reply);
void on_load(void *node, const char *scene, cn_ros_file_reply *reply);
void marks_show(cn_node *node); /* if they, or the lumen, have changed since */

/* --- node_request.c: what a request may ask --- */
/* The scene a request names: inside ~scene_dir, whatever links and dots say. */
cn_status scene_inside(const cn_node *node, const char *scene, char path[PATH_MAX], cn_error *error);
/* CN_ERR_ARG: a file that a requested scene names lies outside ~scene_dir and ~data_dirs, whatever links say.
 */
cn_status files_inside(const cn_node *node, const cn_scene *scene, cn_error *error);
/* The folder a scene that is not there yet would lie in: it exists, inside ~scene_dir. */
cn_status folder_inside(const cn_node *node, const char *scene, char folder[PATH_MAX], cn_error *error);
cn_status sampling_of(const char *text, cn_sampling *sampling, cn_error *error);

/* What the run-time settings and a request lay over the scene for one plan: the device's limits go with the
 * request, all else stands in the scene meanwhile. The scene is this plan's alone: one plan runs at a time.
 */
typedef struct {
    cn_scene *scene;
    double step, time_limit, budget; /* the scene's own */
    int replans;
    int ndevice;
    cn_limit *device;
    int nlent;
    struct {
        int *n, old_n;
        cn_limit **list, *old;
    } * lent;
} overlay;
cn_status overlay_new(overlay *o, cn_scene *scene, const cn_ros_tuning *tuning, const cn_ros_request *request,
                      cn_error *error);
void overlay_end(overlay *o); /* the scene is as it was */

/* --- node_queue.c: calls, one after the other --- */
cn_status queue_start(cn_node *node);
void queue_stop(cn_node *node); /* every call is answered; waits for the one worked on */
void on_plan(void *node, cn_ros_call call, const cn_ros_request *request);
void on_cancel(void *node, cn_ros_call call);
void on_feedback(void *node);

/* --- node_plan.c: one call, from its request to its answer --- */
void plan_call(cn_node *node, const cn_ros_request *request, cn_ros_answer *answer);
void answer_with(cn_ros_answer *answer, const cn_scene *scene, cn_verdict_code code, const cn_error *error);
/* FNV-1a of 64 bits over the bytes of a mesh: vertices [m] (nvert x 3), then the indices of its cells. */
unsigned long long checksum(int nvert, const double *vert, int nindex, const int *index);
/* The report as JSON; under `repeat` what the same plan takes: seed, options, versions, checksums of the
 * walls of its stage and the bodies that moved in it (NULL: none, and from any thread). `frame`: of those
 * walls. */
char *answer_json(const cn_node *node, const stage *s, const cn_ros_request *request, const char *frame,
                  const cn_ros_tuning *tuning, const cn_report *report);

/* --- node_show.c: frames and diagnostics --- */
/* Every how manieth triangle of a surface is shown so that they are at most ~triangles_max; counts the rest.
 */
int marker_stride(cn_node *node, int ntri);
bool wants_frame(cn_node *node, int step);
void show_frame(cn_node *node, const cn_frame *frame);
void forget_shown(cn_node *node);
void on_status(void *node, cn_ros_status *status);
void on_tune(void *node, const cn_ros_tuning *tuning);
double wall_clock(void); /* [s], never goes back */

#endif
