/* node.c - the node's life: parameters, doors, threads. */
#include "node.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>
#include "node_parts.h"

/* Parameters that are the node's, not the scene's; what ends with a dot stands for all that is below it. */
static const char *const own_params[] = {"scene",     "scene_dir",         "data_dirs",    "frame_rate",
                                         "frame_id",  "on_busy",           "queue_size",   "triangles_max",
                                         "settings.", "diagnostic_period", "plan_action.", NULL};

/* --- life --- */

static void log_to_ros(void *user, cn_log_level level, const char *file, int line, const char *text)
{
    (void)user;
    cn_ros_log(level, file, line, text);
}

void on_tune(void *user, const cn_ros_tuning *tuning)
{
    cn_node *node = user;
    const double rate = tuning->frame_rate > 0 ? tuning->frame_rate : node->own_rate;
    pthread_mutex_lock(&node->lock);
    node->tuning = *tuning;
    node->frame_period = 1 / rate;
    pthread_mutex_unlock(&node->lock);
}

void step_back(int steps)
{
    const id_t self = (id_t)gettid(); /* of a thread, under Linux */
    setpriority(PRIO_PROCESS, self, getpriority(PRIO_PROCESS, self) + steps);
}

/* ~on_busy and ~queue_size: what becomes of a call while another is open. */
static cn_status read_queue(cn_node *node, cn_error *error)
{
    char on_busy[32];
    cn_ros_text(node->ros, "on_busy", "refuse", on_busy, sizeof on_busy);
    const double size = cn_ros_number(node->ros, "queue_size", 8);
    if (strcmp(on_busy, "refuse") && strcmp(on_busy, "queue"))
        return cn_fail(error, CN_FAULT_OPTION, "", 0, "~on_busy is '%s': expected refuse or queue", on_busy);
    if (!(size >= 1 && size <= QUEUE_MOST))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "~queue_size is %g: expected 1 to %d calls", size,
                       QUEUE_MOST);
    node->queue = strcmp(on_busy, "queue") ? 0 : (int)size;
    return CN_OK;
}

cn_status cn_node_new(cn_node **out, int argc, char **argv, const volatile sig_atomic_t *stop,
                      cn_error *error)
{
    const cn_ros_handlers handlers = {.mesh = on_mesh,
                                      .plan = on_plan,
                                      .cancel = on_cancel,
                                      .status = on_status,
                                      .feedback = on_feedback,
                                      .click = on_click,
                                      .mark = on_mark,
                                      .save = on_save,
                                      .load = on_load,
                                      .tune = on_tune};
    cn_ros_handlers bound = handlers;
    cn_node *node;
    cn_status status;

    *out = NULL;
    if (!(node = calloc(1, sizeof *node))) return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
    pthread_mutex_init(&node->lock, NULL);
    pthread_cond_init(&node->called, NULL);
    pthread_cond_init(&node->mesh_came, NULL);
    node->stop = stop;
    node->tuning = (cn_ros_tuning){-1, -1, -1, -1, -1, {{-1, -1}, {-1, -1}, {-1, -1}, {-1, -1}, {-1, -1}}};
    const long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    node->threads = cpus > 1 ? (int)cpus : 1;
    if ((status = queue_start(node)) != CN_OK) goto fail;
    step_back(5); /* roscpp's threads: messages by the thousand do not slow a plan */
    if ((status = cn_ros_new(&node->ros, argc, argv, "catnav", stop, error)) != CN_OK) goto fail;
    cn_log_set_sink(log_to_ros, NULL);

    cn_ros_text(node->ros, "scene", "", node->scene_file, sizeof node->scene_file);
    cn_ros_text(node->ros, "scene_dir", "", node->scene_dir, sizeof node->scene_dir);
    cn_ros_text(node->ros, "data_dirs", "", node->data_dirs, sizeof node->data_dirs);
    cn_ros_text(node->ros, "frame_id", "map", node->frame, sizeof node->frame);
    const double rate = cn_ros_number(node->ros, "frame_rate", 20);
    if (!(rate > 0 && rate < INFINITY)) {
        status = cn_fail(error, CN_FAULT_VALUE, "", 0, "~frame_rate is %g: expected frames a second above 0",
                         rate);
        goto fail;
    }
    node->own_rate = rate, node->frame_period = 1 / rate;
    const double triangles = cn_ros_number(node->ros, "triangles_max", 200000);
    if (!(triangles >= 1 && triangles <= INT_MAX)) {
        status = cn_fail(error, CN_FAULT_VALUE, "", 0, "~triangles_max is %g: expected a count above 0",
                         triangles);
        goto fail;
    }
    node->triangles = (int)triangles;
    if ((status = read_queue(node, error)) != CN_OK) goto fail;
    if ((status = cn_ros_settings(node->ros, own_params, &node->nsetting, &node->setting)) != CN_OK)
        goto fail;

    bound.user = node;
    node->checking = 1; /* the scene itself, by stage_first */
    if ((status = meshes_start(node)) != CN_OK) goto fail;
    if ((status = cn_ros_start(node->ros, &bound, node->queue, error)) != CN_OK) goto fail;
    stage_first(node);
    *out = node;
    return CN_OK;
fail:
    cn_node_free(node);
    return error->status == status ? status : cn_fail(error, status, "", 0, "%s", cn_status_text(status));
}

void cn_node_run(cn_node *node)
{
    const struct timespec nap = {.tv_nsec = 20000000};
    while (!*node->stop && cn_ros_ok(node->ros))
        nanosleep(&nap, NULL);
}

void cn_node_free(cn_node *node)
{
    if (!node) return;
    queue_stop(node); /* waits for the plan under way, which ends at its next step */
    meshes_stop(node);
    cn_ros_free(node->ros);
    for (int i = 0; i < node->ncame; i++)
        came_free(node->came[i]);
    cn_log_set_sink(NULL, NULL);
    stage_free(node->stage);
    stage_free(node->foreign);
    meshes_free(node->nmesh, node->mesh);
    cn_ros_settings_free(node->nsetting, node->setting);
    pthread_cond_destroy(&node->called);
    pthread_cond_destroy(&node->mesh_came);
    pthread_mutex_destroy(&node->lock);
    free(node);
}
