/* node_request.c - what a request may ask: sampling, limits on what exists, a scene in its folder; and what
 * the run-time settings say. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "node_parts.h"

/* True when a resolved path lies below a folder or (`itself`) is it. */
static bool is_below(const char *given, const char *path, bool itself)
{
    char folder[PATH_MAX];
    if (!realpath(given, folder)) return false;
    const size_t length = strcmp(folder, "/") ? strlen(folder) : 0;
    return !strncmp(path, folder, length) && (path[length] == '/' || (itself && !path[length]));
}

static cn_status join(const cn_node *node, const char *scene, char joined[PATH_MAX], cn_error *error)
{
    if (!node->scene_dir[0])
        return cn_fail(error, CN_FAULT_OUTSIDE, "", 0,
                       "scene '%.200s': the node has no ~scene_dir to look in", scene);
    if (snprintf(joined, PATH_MAX, "%s/%s", node->scene_dir, scene) >= PATH_MAX)
        return cn_fail(error, CN_FAULT_MISSING_FILE, "", 0, "scene '%.60s...': the path is too long", scene);
    return CN_OK;
}

cn_status scene_inside(const cn_node *node, const char *scene, char path[PATH_MAX], cn_error *error)
{
    struct stat info;
    char joined[PATH_MAX];
    const cn_status status = join(node, scene, joined, error);
    if (status != CN_OK) return status;
    if (!realpath(joined, path))
        return cn_fail(error, CN_FAULT_MISSING_FILE, scene, 0, "scene '%.200s' is not in %.200s", scene,
                       node->scene_dir);
    if (!is_below(node->scene_dir, path, false))
        return cn_fail(error, CN_FAULT_OUTSIDE, scene, 0, "scene '%.200s' lies outside %.200s", scene,
                       node->scene_dir);
    if (stat(path, &info) || !S_ISREG(info.st_mode)) /* a pipe would be waited for */
        return cn_fail(error, CN_FAULT_NO_FILE, scene, 0, "scene '%.200s' is not a file", scene);
    return CN_OK;
}

cn_status folder_inside(const cn_node *node, const char *scene, char folder[PATH_MAX], cn_error *error)
{
    char joined[PATH_MAX];
    const cn_status status = join(node, scene, joined, error);
    if (status != CN_OK) return status;
    *strrchr(joined, '/') = 0; /* join has put one there */
    if (!realpath(joined, folder))
        return cn_fail(error, CN_FAULT_MISSING_FILE, scene, 0, "scene '%.200s': its folder is not in %.200s",
                       scene, node->scene_dir);
    if (!is_below(node->scene_dir, folder, true))
        return cn_fail(error, CN_FAULT_OUTSIDE, scene, 0, "scene '%.200s' lies outside %.200s", scene,
                       node->scene_dir);
    return CN_OK;
}

/* True when what is there lies in ~scene_dir or one of ~data_dirs. */
static bool may_read(const cn_node *node, const char *path)
{
    char folders[sizeof node->data_dirs], *rest = folders, *folder;
    if (is_below(node->scene_dir, path, false)) return true;
    memcpy(folders, node->data_dirs, sizeof folders);
    while ((folder = strsep(&rest, ":")))
        if (folder[0] && is_below(folder, path, false)) return true;
    return false;
}

static cn_status file_inside(const cn_node *node, const char *scene, const char *file, cn_error *error)
{
    char path[PATH_MAX], other[PATH_MAX];
    if (!file) return CN_OK;
    if (!realpath(file, path))
        return cn_fail(error, CN_FAULT_MISSING_FILE, scene, 0, "the scene names '%.300s', which is not there",
                       file);
    /* TetGen's files are two: the other lies beside the one that is named */
    const char *const dot = strrchr(file, '.');
    const bool node_file = dot && !strcmp(dot, ".node"), pair = node_file || (dot && !strcmp(dot, ".ele"));
    if (pair && snprintf(other, sizeof other, "%.*s%s", (int)(dot - file), file,
                         node_file ? ".ele" : ".node") < (int)sizeof other) {
        char beside[PATH_MAX];
        if (realpath(other, beside) && !may_read(node, beside)) path[0] = 0;
    }
    if (may_read(node, path)) return CN_OK;
    return cn_fail(
        error, CN_FAULT_OUTSIDE, scene, 0,
        "the scene names '%.200s', outside the folders a requested scene may read from (~scene_dir and "
        "~data_dirs)",
        file);
}

static cn_status surfaces_inside(const cn_node *node, const char *scene, int n, const cn_surface_spec *spec,
                                 cn_error *error)
{
    cn_status status = CN_OK;
    for (int i = 0; i < n && status == CN_OK; i++)
        status = file_inside(node, scene, spec[i].shape.file, error);
    return status;
}

cn_status files_inside(const cn_node *node, const cn_scene *scene, cn_error *error)
{
    cn_status status = surfaces_inside(node, scene->path, scene->nvessel, scene->vessel, error);
    if (status == CN_OK)
        status = surfaces_inside(node, scene->path, scene->nobstacle, scene->obstacle, error);
    for (int i = 0; i < scene->nshown && status == CN_OK; i++)
        status = file_inside(node, scene->path, scene->shown[i].file, error);
    for (int i = 0; i < scene->nbody && status == CN_OK; i++) {
        const cn_body_spec *body = &scene->body[i];
        const char *const files[] = {body->shape.file, body->molecule_file, body->start_file,
                                     body->skin_file};
        for (int k = 0; k < 4 && status == CN_OK; k++)
            status = file_inside(node, scene->path, files[k], error);
    }
    return status;
}

cn_status sampling_of(const char *text, cn_sampling *sampling, cn_error *error)
{
    static const char *const names[] = {"uniform", "medial_axis", "contact"};
    for (int i = 0; i < 3; i++)
        if (!strcmp(text, names[i])) {
            *sampling = (cn_sampling)i;
            return CN_OK;
        }
    return cn_fail(error, CN_FAULT_OPTION, "", 0, "sampling '%s': expected uniform, medial_axis or contact",
                   text);
}

static cn_status limit_of(const cn_ros_limit *in, cn_limit *out, cn_error *error)
{
    const char *const reduce = in->reduce[0] ? in->reduce : "max";
    int q = CN_QUANTITY_VOLUME;
    while (q < CN_QUANTITY_PROGRESS && strcmp(in->quantity, cn_quantity_name((cn_quantity)q)))
        q++;
    if (q == CN_QUANTITY_PROGRESS)
        return cn_fail(error, CN_FAULT_OPTION, "", 0,
                       "limit on '%s': expected volume, stress, energy, wall_force or clearance",
                       in->quantity);
    out->quantity = (cn_quantity)q;
    if (strcmp(reduce, "max") && strcmp(reduce, "mean"))
        return cn_fail(error, CN_FAULT_OPTION, "", 0, "limit on %s: reduce '%s': expected max or mean",
                       in->quantity, reduce);
    out->reduce = strcmp(reduce, "mean") ? CN_REDUCE_MAX : CN_REDUCE_MEAN;
    if (out->reduce == CN_REDUCE_MEAN && q != CN_QUANTITY_VOLUME && q != CN_QUANTITY_STRESS)
        return cn_fail(error, CN_FAULT_OPTION, "", 0, "limit on %s: only max is defined", in->quantity);
    if (!(in->limit >= 0 && in->limit < INFINITY))
        return cn_fail(error, CN_FAULT_VALUE, "", 0, "limit on %s is %g: expected a finite number, 0 or more",
                       in->quantity, in->limit);
    out->limit = in->limit;
    return CN_OK;
}

/* Adds a limit to a list of the scene's, in place of one on the same quantity and reduce. */
static cn_status put_limit(int *n, cn_limit **list, const cn_limit *limit)
{
    for (int i = 0; i < *n; i++)
        if ((*list)[i].quantity == limit->quantity && (*list)[i].reduce == limit->reduce) {
            (*list)[i] = *limit;
            return CN_OK;
        }
    cn_limit *longer = realloc(*list, (size_t)(*n + 1) * sizeof *longer);
    if (!longer) return CN_ERR_MEMORY;
    *list = longer;
    longer[(*n)++] = *limit;
    return CN_OK;
}

/* The list of limits of the body, vessel or obstacle of that name; NULL: there is none. */
static cn_limit **limits_of(cn_scene *scene, const char *name, int **n)
{
    for (int i = 0; i < scene->nbody; i++)
        if (!strcmp(scene->body[i].name, name)) return *n = &scene->body[i].nlimit, &scene->body[i].limit;
    for (int i = 0; i < scene->nvessel; i++)
        if (!strcmp(scene->vessel[i].name, name))
            return *n = &scene->vessel[i].nlimit, &scene->vessel[i].limit;
    for (int i = 0; i < scene->nobstacle; i++)
        if (!strcmp(scene->obstacle[i].name, name))
            return *n = &scene->obstacle[i].nlimit, &scene->obstacle[i].limit;
    return NULL;
}

static cn_status lend(overlay *o, int *n, cn_limit **list)
{
    for (int i = 0; i < o->nlent; i++)
        if (o->lent[i].list == list) return CN_OK;
    cn_limit *copy = malloc((size_t)(*n + 1) * sizeof *copy);
    void *lent = copy ? realloc(o->lent, (size_t)(o->nlent + 1) * sizeof *o->lent) : NULL;
    if (!lent) {
        free(copy);
        return CN_ERR_MEMORY;
    }
    if (*n > 0) memcpy(copy, *list, (size_t)*n * sizeof *copy);
    o->lent = lent;
    o->lent[o->nlent].n = n, o->lent[o->nlent].old_n = *n;
    o->lent[o->nlent].list = list, o->lent[o->nlent].old = *list;
    o->nlent++;
    *list = copy;
    return CN_OK;
}

cn_status overlay_new(overlay *o, cn_scene *scene, const cn_ros_tuning *tuning, const cn_ros_request *request,
                      cn_error *error)
{
    *o = (overlay){.scene = scene,
                   .step = scene->step,
                   .time_limit = scene->time_limit,
                   .budget = scene->planner.budget,
                   .replans = scene->planner.replans};
    if (tuning->step > 0) scene->step = tuning->step;
    if (tuning->time_limit > 0) scene->time_limit = tuning->time_limit;
    if (tuning->budget > 0) scene->planner.budget = tuning->budget;
    if (tuning->replans >= 0) scene->planner.replans = tuning->replans;
    for (int q = 0; q < CN_QUANTITY_PROGRESS; q++)
        for (int r = CN_REDUCE_MAX; r <= CN_REDUCE_MEAN; r++) {
            const cn_limit limit = {(cn_quantity)q, (cn_reduce)r, tuning->limit[q][r]};
            if (limit.limit >= 0 && put_limit(&o->ndevice, &o->device, &limit) != CN_OK)
                return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
        }
    for (int i = 0; i < request->nlimit; i++) {
        const cn_ros_limit *in = &request->limit[i];
        cn_limit limit, **list = &o->device;
        int *n = &o->ndevice;
        cn_status status = limit_of(in, &limit, error);
        if (status != CN_OK) return status;
        if (in->body[0] && (scene->nbody == 0 || strcmp(in->body, scene->body[0].name))) {
            if (!(list = limits_of(scene, in->body, &n)))
                return cn_fail(error, CN_FAULT_OPTION, "", 0,
                               "limit on '%s': the scene has no body or wall of that name", in->body);
            if (lend(o, n, list) != CN_OK) return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
        }
        if (put_limit(n, list, &limit) != CN_OK) return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
    }
    return CN_OK;
}

void overlay_end(overlay *o)
{
    if (o->scene) {
        o->scene->step = o->step, o->scene->time_limit = o->time_limit;
        o->scene->planner.budget = o->budget, o->scene->planner.replans = o->replans;
    }
    for (int i = 0; i < o->nlent; i++) {
        free(*o->lent[i].list);
        *o->lent[i].list = o->lent[i].old;
        *o->lent[i].n = o->lent[i].old_n;
    }
    free(o->lent);
    free(o->device);
}
