#include "fake_ros.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CALLS_MOST = 512 };
typedef struct {
    cn_ros_call call; /* 0: free */
    bool answered, ended;
    fake_answer answer;
} slot;
static struct {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    cn_ros_handlers handlers;
    const cn_setting *parameter;
    const char *scene, *scene_dir;
    volatile sig_atomic_t stop;
    cn_ros_call last;
    slot slots[CALLS_MOST];
    void (*planning)(void *user);
    void *planning_user;
    char wrong[256];
} fake = {.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};

struct cn_ros_message {
    size_t size;
    uint8_t *bytes;
};
struct cn_ros {
    int unused;
};
struct cn_ros_status {
    int nfigure;
};

static void judge(bool good, const char *what)
{
    if (good) return;
    pthread_mutex_lock(&fake.lock);
    if (!fake.wrong[0]) snprintf(fake.wrong, sizeof fake.wrong, "%s", what);
    pthread_mutex_unlock(&fake.lock);
}

static void judge_finite(size_t n, const double *x, const char *what)
{
    for (size_t i = 0; i < n; i++)
        judge(isfinite(x[i]), what);
}

/* --- life --- */
cn_status cn_ros_new(cn_ros **out, int argc, char **argv, const char *name, const volatile sig_atomic_t *stop,
                     cn_error *error)
{
    (void)argc, (void)argv, (void)name, (void)stop;
    *out = calloc(1, sizeof **out);
    return *out ? CN_OK : cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
}
cn_status cn_ros_start(cn_ros *ros, const cn_ros_handlers *handlers, int waiting, cn_error *error)
{
    static const cn_ros_tuning none = {-1, -1, -1,
                                       -1, -1, {{-1, -1}, {-1, -1}, {-1, -1}, {-1, -1}, {-1, -1}}};
    (void)ros, (void)waiting, (void)error;
    fake.handlers = *handlers;
    handlers->tune(handlers->user, &none);
    return CN_OK;
}
bool cn_ros_ok(const cn_ros *ros)
{
    (void)ros;
    return true;
}
bool cn_ros_mesh_senders(const cn_ros *ros)
{
    (void)ros;
    return false;
}
void cn_ros_traffic(cn_ros *ros, unsigned long *came, unsigned long *dropped, unsigned long *missing)
{
    (void)ros;
    *came = *dropped = *missing = 0;
}
void cn_ros_free(cn_ros *ros)
{
    free(ros);
}
void cn_ros_log(cn_log_level level, const char *file, int line, const char *text)
{
    (void)level, (void)file, (void)line;
    judge(text[0], "an empty line in the log");
}

/* --- parameters --- */
void cn_ros_text(const cn_ros *ros, const char *key, const char *otherwise, char *out, size_t size)
{
    (void)ros;
    const char *value = !strcmp(key, "scene")       ? fake.scene
                        : !strcmp(key, "scene_dir") ? fake.scene_dir
                                                    : otherwise;
    for (const cn_setting *p = fake.parameter; p && p->key; p++)
        if (!strcmp(p->key, key)) value = p->value;
    snprintf(out, size, "%s", value);
}
double cn_ros_number(const cn_ros *ros, const char *key, double otherwise)
{
    char text[64];
    cn_ros_text(ros, key, "", text, sizeof text);
    return text[0] ? strtod(text, NULL) : otherwise;
}
cn_status cn_ros_settings(const cn_ros *ros, const char *const *except, int *n, cn_setting **out)
{
    (void)ros;
    *n = 0;
    if (!(*out = calloc(64, sizeof **out))) return CN_ERR_MEMORY;
    for (const cn_setting *p = fake.parameter; p && p->key; p++) {
        bool own = false;
        for (int i = 0; except[i]; i++)
            own |= !strcmp(except[i], p->key);
        if (!own) (*out)[(*n)++] = *p;
    }
    return CN_OK;
}
void cn_ros_settings_free(int n, cn_setting *setting)
{
    (void)n;
    free(setting);
}

/* --- frames --- */
cn_status cn_ros_transform(cn_ros *ros, const char *from, const char *to, uint64_t stamp, double wait,
                           cn_ros_motion *motion, cn_error *error)
{
    (void)ros, (void)stamp, (void)wait;
    const bool there = !strcmp(from, "robot"), back = !strcmp(to, "robot");
    if ((!there && strcmp(from, "map")) || (!back && strcmp(to, "map")))
        return cn_fail(error, CN_ERR_ARG, "", 0, "no transform from frame '%.60s' to '%.60s'", from, to);
    const double turned[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    for (int i = 0; i < 9; i++)
        motion->rotation[i] = there ? turned[i] : turned[3 * (i % 3) + i / 3];
    motion->translation[0] = there ? 1 : 0, motion->translation[1] = there ? 0 : 1;
    motion->translation[2] = 0;
    motion->rest = false;
    return CN_OK;
}

/* --- messages in --- */
const uint8_t *cn_ros_message_bytes(const cn_ros_message *message, size_t *size)
{
    *size = message->size;
    return message->bytes;
}
void cn_ros_message_free(cn_ros_message *message)
{
    if (message) free(message->bytes);
    free(message);
}

/* --- calls --- */
static slot *find(cn_ros_call call) /* the lock is held */
{
    for (int i = 0; i < CALLS_MOST; i++)
        if (fake.slots[i].call == call) return &fake.slots[i];
    return NULL;
}
void cn_ros_begin_call(cn_ros *ros, cn_ros_call call)
{
    (void)ros, (void)call;
}
void cn_ros_send_feedback(cn_ros *ros, cn_ros_call call, const cn_progress *progress, const char *name,
                          double real_time_factor, int nmargin, const cn_ros_margin *margin)
{
    (void)ros, (void)call;
    judge(name[0] && nmargin >= 0 && progress->step >= 0, "feedback without a stage");
    judge_finite(1, &real_time_factor, "a real-time factor that is not finite");
    for (int i = 0; i < nmargin; i++)
        judge(margin[i].body[0], "a margin of no body");
}
void cn_ros_send_answer(cn_ros *ros, cn_ros_call call, cn_ros_answer *answer)
{
    (void)ros;
    if (call != OWN_CALL) {
        pthread_mutex_lock(&fake.lock);
        slot *s = find(call);
        const bool fresh = s && !s->answered && !s->ended;
        if (fresh) {
            s->answer = (fake_answer){answer->report.verdict, answer->report.steps, answer->json};
            answer->json = NULL;
            s->answered = true;
        }
        pthread_cond_broadcast(&fake.changed);
        pthread_mutex_unlock(&fake.lock);
        judge(fresh, "a call was answered twice, or after its end");
    }
    judge(answer->report.verdict.code != CN_VERDICT_UNKNOWN, "a verdict that says nothing");
    judge(answer->report.verdict.message[0], "a verdict without a sentence");
    cn_ros_answer_clear(answer);
}
void cn_ros_answer_clear(cn_ros_answer *answer)
{
    free(answer->json);
    cn_path_free(answer->path);
    cn_report_clear(&answer->report);
    *answer = (cn_ros_answer){0};
}
void cn_ros_end_call(cn_ros *ros, cn_ros_call call)
{
    (void)ros;
    pthread_mutex_lock(&fake.lock);
    slot *s = find(call);
    const bool fresh = s && s->answered && !s->ended;
    if (fresh) s->ended = true;
    pthread_cond_broadcast(&fake.changed);
    pthread_mutex_unlock(&fake.lock);
    judge(fresh, "a call ended twice, or before its answer");
}

/* --- what goes out --- */
static void judge_triangles(int ntri, const int *tri, int nvert)
{
    for (int i = 0; i < 3 * ntri; i++)
        judge(tri[i] >= 0 && tri[i] < nvert, "a triangle of no vertex was sent");
}
void cn_ros_send_topology(cn_ros *ros, const char *frame, const char *name, unsigned id, int ntet,
                          const int *tet, int ntri, const int *tri)
{
    (void)ros, (void)id, (void)ntet, (void)tet;
    judge(frame[0] && name[0], "a body without a name or frame was sent");
    judge_triangles(ntri, tri, INT_MAX);
}
void cn_ros_send_state(cn_ros *ros, const char *frame, unsigned id, int step, double time, int nvert,
                       const double *x, const float *stress)
{
    (void)ros, (void)frame, (void)id, (void)step;
    judge_finite(1, &time, "a time that is not finite was sent");
    judge_finite(3 * (size_t)nvert, x, "a vertex that is not finite was sent");
    for (int i = 0; i < nvert; i++)
        judge(isfinite(stress[i]), "a stress that is not finite was sent");
}
void cn_ros_send_catheter(cn_ros *ros, const char *frame, const char *name, unsigned id, int nactive,
                          int ntri, const int *tri, int stride, const double *x, const float *stress,
                          double full)
{
    (void)ros, (void)frame, (void)name, (void)id, (void)nactive, (void)x, (void)stress, (void)full;
    judge(stride >= 1, "a stride below 1");
    judge_triangles(ntri, tri, INT_MAX);
}
void cn_ros_send_artery(cn_ros *ros, const char *frame, const char *name, unsigned id,
                        const cn_surface *surface, int stride)
{
    (void)ros, (void)frame, (void)name, (void)id;
    judge(stride >= 1, "a stride below 1");
    judge_finite(3 * (size_t)surface->nvert, surface->vert, "a wall that is not finite was sent");
    judge_triangles(surface->ntri, surface->tri, surface->nvert);
}
void cn_ros_send_roadmap(cn_ros *ros, const char *frame, unsigned id, const cn_roadmap *roadmap)
{
    (void)ros, (void)frame, (void)id;
    judge_finite(3 * (size_t)roadmap->nvertex, roadmap->vertex, "a roadmap that is not finite was sent");
}
void cn_ros_send_path(cn_ros *ros, const char *frame, const cn_path *path)
{
    (void)ros, (void)frame;
    judge_finite(3 * (size_t)path->n, path->x, "a path that is not finite was sent");
}
void cn_ros_send_medial_axis(cn_ros *ros, const char *frame, int n, const double *x, const double *clearance)
{
    (void)ros, (void)frame;
    judge_finite(3 * (size_t)n, x, "a medial axis that is not finite was sent");
    judge_finite((size_t)n, clearance, "a clearance that is not finite was sent");
}
void cn_ros_forget_arteries(cn_ros *ros)
{
    (void)ros;
}
void cn_ros_forget_bodies(cn_ros *ros)
{
    (void)ros;
}
void cn_ros_send_marks(cn_ros *ros, const char *frame, int n, const double *x, const char *const *why,
                       double size)
{
    (void)ros, (void)frame;
    judge(n >= 0 && n <= MARKS_MOST && size > 0, "waypoints that are not there");
    judge_finite(3 * (size_t)n, x, "a waypoint that is not finite was shown");
    for (int i = 0; i < n; i++)
        judge(strlen(why[i]) < 200, "a reason that is too long");
}
const cn_ros_version *cn_ros_versions(void)
{
    static const cn_ros_version none[] = {{"ros", "none"}, {NULL, NULL}};
    return none;
}
void cn_ros_summary(cn_ros_status *status, cn_ros_level level, const char *message)
{
    (void)status, (void)level;
    judge(message[0], "a diagnostic without a sentence");
}
void cn_ros_figure(cn_ros_status *status, const char *key, const char *format, ...)
{
    char value[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(value, sizeof value, format, arguments);
    va_end(arguments);
    judge(key[0] && value[0], "a diagnostic without a figure");
    status->nfigure++;
}

/* --- planner and octree --- */
cn_status cn_octree_attach(cn_world *world, cn_error *error)
{
    (void)world, (void)error;
    return CN_OK;
}
cn_status cn_ompl_planner(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    if (fake.planning) fake.planning(fake.planning_user);
    for (int i = 1; i < query->npoint; i++)
        if (!cn_plan_edge_free(query, query->point + 3 * i - 3, query->point + 3 * i,
                               query->radius + query->spec->clearance, 1))
            return cn_fail(error, CN_ERR_NO_PATH, "", 0, "no straight way to point %d", i);
    roadmap->x = malloc(3 * (size_t)query->npoint * sizeof(double));
    roadmap->leg = malloc((size_t)query->npoint * sizeof(int));
    if (!roadmap->x || !roadmap->leg) return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
    memcpy(roadmap->x, query->point, 3 * (size_t)query->npoint * sizeof(double));
    for (int i = 0; i < query->npoint; i++)
        roadmap->leg[i] = i;
    roadmap->npoint = query->npoint;
    roadmap->reproducible = true;
    return CN_OK;
}

/* --- for tests --- */
void fake_planning(void (*call)(void *user), void *user)
{
    fake.planning = call, fake.planning_user = user;
}

cn_status fake_node(cn_node **out, const char *scene, const char *scene_dir, const cn_setting *parameter,
                    cn_error *error)
{
    fake.scene = scene, fake.scene_dir = scene_dir, fake.parameter = parameter;
    fake.stop = 0;
    pthread_mutex_lock(&fake.lock);
    fake.wrong[0] = 0;
    pthread_mutex_unlock(&fake.lock);
    return cn_node_new(out, 0, NULL, &fake.stop, error);
}
void fake_node_free(cn_node *node)
{
    cn_node_free(node);
    for (int i = 0; i < CALLS_MOST; i++) {
        slot *s = &fake.slots[i];
        if (!s->call) continue;
        judge(s->answered && s->ended, "a call was not answered");
        free(s->answer.json);
        *s = (slot){0};
    }
}
const cn_ros_handlers *fake_handlers(void)
{
    return &fake.handlers;
}
volatile sig_atomic_t *fake_stop(void)
{
    return &fake.stop;
}

void fake_mesh(size_t size, const uint8_t *bytes)
{
    cn_ros_message *message = calloc(1, sizeof *message);
    uint8_t *copy = malloc(size + 1);
    if (!message || !copy) { /* it is not sent */
        free(message), free(copy);
        return;
    }
    if (size) memcpy(copy, bytes, size);
    *message = (cn_ros_message){size, copy};
    fake.handlers.mesh(fake.handlers.user, message);
}

static uint8_t *put(uint8_t *at, const void *from, size_t size)
{
    if (size) memcpy(at, from, size);
    return at + size;
}
uint8_t *fake_wire(const char *frame, const char *name, int nvert, const double *vert, int ntri,
                   const int *tri, size_t *size)
{
    const uint32_t counts[] = {(uint32_t)strlen(frame), (uint32_t)strlen(name), (uint32_t)ntri,
                               (uint32_t)nvert};
    const uint32_t head[3] = {7, 0, 0};
    *size = 12 + 16 + counts[0] + counts[1] + 12 * (size_t)ntri + 24 * (size_t)nvert;
    uint8_t *bytes = malloc(*size), *at = bytes;
    if (!bytes) return NULL;
    at = put(put(put(at, head, 12), &counts[0], 4), frame, counts[0]);
    at = put(put(put(at, &counts[1], 4), name, counts[1]), &counts[2], 4);
    put(put(put(at, tri, 12 * (size_t)ntri), &counts[3], 4), vert, 24 * (size_t)nvert);
    return bytes;
}
void fake_tube(double length, double radius)
{
    enum { SIDES = 16, RINGS = 17 };
    double vert[3 * (SIDES * RINGS + 2)];
    int tri[3 * (2 * SIDES * (RINGS - 1) + 2 * SIDES)], ntri = 0;
    size_t size;
    for (int r = 0; r < RINGS; r++)
        for (int s = 0; s < SIDES; s++) {
            const double a = 2 * M_PI * s / SIDES;
            double *v = vert + 3 * (r * SIDES + s);
            v[0] = radius * cos(a), v[1] = radius * sin(a), v[2] = length * r / (RINGS - 1);
        }
    for (int end = 0; end < 2; end++) {
        double *v = vert + 3 * (SIDES * RINGS + end);
        v[0] = v[1] = 0, v[2] = end * length;
    }
    for (int s = 0; s < SIDES; s++) {
        const int t = (s + 1) % SIDES, last = SIDES * (RINGS - 1);
        for (int r = 0; r + 1 < RINGS; r++) {
            const int a = r * SIDES + s, b = r * SIDES + t;
            memcpy(tri + 3 * ntri, (int[]){a, b, b + SIDES, a, b + SIDES, a + SIDES}, 6 * sizeof(int));
            ntri += 2;
        }
        memcpy(tri + 3 * ntri, (int[]){SIDES * RINGS, t, s, SIDES * RINGS + 1, last + s, last + t},
               6 * sizeof(int));
        ntri += 2;
    }
    uint8_t *bytes = fake_wire("map", "", SIDES * RINGS + 2, vert, ntri, tri, &size);
    if (bytes) fake_mesh(size, bytes);
    free(bytes);
}
void fake_settle(cn_node *node)
{
    for (;;) {
        pthread_mutex_lock(&node->lock);
        const bool settled = !node->checking;
        pthread_mutex_unlock(&node->lock);
        if (settled) return;
        nanosleep(&(struct timespec){.tv_nsec = 200000}, NULL);
    }
}

cn_ros_call fake_plan(const cn_ros_request *request)
{
    pthread_mutex_lock(&fake.lock);
    const cn_ros_call call = ++fake.last;
    slot *s;
    while (!(s = find(0)))
        pthread_cond_wait(&fake.changed, &fake.lock);
    *s = (slot){.call = call};
    pthread_mutex_unlock(&fake.lock);
    fake.handlers.plan(fake.handlers.user, call, request);
    return call;
}
fake_answer fake_await(cn_ros_call call)
{
    pthread_mutex_lock(&fake.lock);
    slot *s = find(call);
    while (!s->answered || !s->ended)
        pthread_cond_wait(&fake.changed, &fake.lock);
    const fake_answer answer = s->answer;
    *s = (slot){0};
    pthread_cond_broadcast(&fake.changed);
    pthread_mutex_unlock(&fake.lock);
    return answer;
}
fake_answer fake_ask(const cn_ros_request *request)
{
    return fake_await(fake_plan(request));
}

const char *fake_wrong(void)
{
    pthread_mutex_lock(&fake.lock);
    static _Thread_local char wrong[sizeof fake.wrong];
    memcpy(wrong, fake.wrong, sizeof wrong);
    pthread_mutex_unlock(&fake.lock);
    return wrong;
}
