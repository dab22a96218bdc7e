/* node_mesh.c - artery meshes: checked at the door, put in force in one stroke. */
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/octree.h"
#include "node_parts.h"

void stage_free(stage *s)
{
    if (!s) return;
    cn_world_free(s->world);
    cn_scene_free(s->scene);
    free(s);
}

stage *stage_take(cn_node *node)
{
    pthread_mutex_lock(&node->lock);
    stage *s = node->stage;
    if (s) s->refs++;
    pthread_mutex_unlock(&node->lock);
    return s;
}

void stage_drop(cn_node *node, stage *s)
{
    if (!s) return;
    pthread_mutex_lock(&node->lock);
    const bool last = --s->refs == 0;
    pthread_mutex_unlock(&node->lock);
    if (last) stage_free(s);
}

/* Those who follow a call hear that the lumen is mapped: its own scene's, or that of the mesh it waits for.
 */
static void tell_mapping(cn_node *node, bool requested)
{
    pthread_mutex_lock(&node->lock);
    if (node->preparing && node->progress.stage == CN_STAGE_MESH &&
        requested == (node->now.request->scene[0] != 0))
        node->progress.stage = CN_STAGE_MAP;
    pthread_mutex_unlock(&node->lock);
}

cn_status stage_new(stage **out, cn_node *node, const char *file, int nmesh, const cn_replacement *mesh,
                    const char *frame, bool requested, cn_error *error)
{
    cn_status status = CN_ERR_MEMORY;
    stage *s;

    *out = NULL;
    if (!(s = calloc(1, sizeof *s))) return cn_fail(error, CN_ERR_MEMORY, "", 0, "out of memory");
    s->refs = 1;
    snprintf(s->frame, sizeof s->frame, "%s", frame);
    if ((status = cn_scene_read(&s->scene, file, node->nsetting, node->setting, error)) != CN_OK) goto fail;
    if (requested && (status = files_inside(node, s->scene, error)) != CN_OK) goto fail;
    if ((status = cn_world_new(&s->world, s->scene, nmesh, mesh, error)) != CN_OK) goto fail;
    if (s->scene->nbody > 0 && s->scene->body[0].shape.kind == CN_SHAPE_CATHETER) {
        const double diameter = s->scene->body[0].shape.catheter.diameter;
        tell_mapping(node, requested);
        if ((status = cn_world_map(s->world, diameter / 2, node->threads, error)) != CN_OK) goto fail;
        if ((status = cn_world_fits(s->world, diameter, error)) != CN_OK) goto fail;
        if ((status = cn_octree_attach(s->world, error)) != CN_OK) goto fail;
    }
    *out = s;
    return CN_OK;
fail:
    stage_free(s);
    return status;
}

void stage_show(cn_node *node, const stage *s, const char *frame)
{
    const double *x, *clearance;
    cn_ros_forget_arteries(node->ros);
    for (int i = 0; i < s->world->nwall; i++)
        cn_ros_send_artery(node->ros, frame, s->world->wall[i].name, (unsigned)i, s->world->wall[i].surface,
                           marker_stride(node, s->world->wall[i].surface->ntri));
    if (s->world->map) {
        const int n = cn_map_ridge(s->world->map, &x, &clearance);
        cn_ros_send_medial_axis(node->ros, frame, n, x, clearance);
    }
}

void meshes_free(int n, cn_replacement *mesh)
{
    for (int i = 0; i < n; i++) {
        free((char *)mesh[i].name);
        cn_surface_free((cn_surface *)mesh[i].surface);
    }
    free(mesh);
}

/* The meshes in force without one of that name, and the new one last: the last counts where two mean the same
 * vessel. The list is the caller's, the surfaces but the new one are shared with the old list. */
static cn_status meshes_with(const cn_node *node, const char *name, const cn_surface *surface,
                             cn_replacement **out, int *n)
{
    if (!(*out = malloc((size_t)(node->nmesh + 1) * sizeof **out))) return CN_ERR_MEMORY;
    *n = 0;
    for (int i = 0; i < node->nmesh; i++)
        if (strcmp(node->mesh[i].name, name)) (*out)[(*n)++] = node->mesh[i];
    (*out)[(*n)++] = (cn_replacement){name, surface};
    return CN_OK;
}

/* Takes over a list of meshes_with; what it leaves out, or an only vessel's new mesh shadows, is freed. */
static void meshes_keep(cn_node *node, cn_replacement *mesh, int n, bool only_vessel)
{
    for (int i = 0; i < node->nmesh; i++)
        if (only_vessel || !strcmp(node->mesh[i].name, mesh[n - 1].name)) {
            free((char *)node->mesh[i].name);
            cn_surface_free((cn_surface *)node->mesh[i].surface);
        }
    if (only_vessel) mesh[0] = mesh[n - 1], n = 1;
    free(node->mesh);
    node->mesh = mesh, node->nmesh = n;
}

/* Ends a check: a stage takes the place of the old one; an error is remembered and the old one stays. */
static void put_in_force(cn_node *node, stage *fresh, const char *what, const cn_error *error)
{
    char refusal[sizeof node->refusal] = "";
    stage *old = NULL;

    if (error->status != CN_OK && error->file[0])
        snprintf(refusal, sizeof refusal, "%s refused: %s:%d: %s", what, error->file, error->line,
                 error->message);
    else if (error->status != CN_OK)
        snprintf(refusal, sizeof refusal, "%s refused: %s", what, error->message);
    if (refusal[0]) CN_LOG(CN_LOG_ERROR, "%s", refusal);
    pthread_mutex_lock(&node->lock);
    if (fresh) old = node->stage, node->stage = fresh, node->marks_changed = true;
    memcpy(node->refusal, refusal, sizeof refusal);
    node->fault = error->fault;
    node->checking--;
    pthread_mutex_unlock(&node->lock);
    stage_drop(node, old);
}

/* A mesh in a frame that tf cannot bring into the node's: refused, but kept for calls in that very frame. */
static void keep_foreign(cn_node *node, const came_mesh *mesh, const char *name, const cn_surface *surface,
                         cn_error *error)
{
    const cn_replacement one = {name, surface};
    cn_error inner = {0};
    stage *fresh, *old;

    if (stage_new(&fresh, node, node->scene_file, 1, &one, mesh->frame, false, &inner) != CN_OK) return;
    if (fresh->scene->nvessel > 1) { /* the other vessels are in the node's frame */
        stage_free(fresh);
        return;
    }
    const size_t used = strlen(error->message);
    snprintf(error->message + used, sizeof error->message - used, "; calls in frame '%.60s' can use it",
             mesh->frame);
    pthread_mutex_lock(&node->lock);
    old = node->foreign, node->foreign = fresh, fresh->refs++;
    const bool alone = !node->stage;
    pthread_mutex_unlock(&node->lock);
    if (alone) stage_show(node, fresh, mesh->frame);
    stage_drop(node, fresh);
    stage_drop(node, old);
}

static void forget_foreign(cn_node *node)
{
    pthread_mutex_lock(&node->lock);
    stage *old = node->foreign;
    node->foreign = NULL;
    pthread_mutex_unlock(&node->lock);
    stage_drop(node, old);
}

/* Checks a mesh at the door and, if it is good, puts it in force in one stroke; else all stays as it was. */
static void check_mesh(cn_node *node, const came_mesh *mesh)
{
    cn_error error = {0};
    cn_surface *surface = NULL;
    cn_replacement *meshes = NULL;
    cn_ros_motion motion;
    stage *fresh = NULL;
    char *name = NULL;
    int n = 0;

    if (mesh->error.status != CN_OK) {
        error = mesh->error;
        goto done;
    }
    if (mesh_unpack(mesh, &surface, &error) != CN_OK) goto done;
    if (frames_join(node, mesh->frame, node->frame, mesh->stamp, &motion, &error) != CN_OK) {
        keep_foreign(node, mesh, mesh->name, surface, &error);
        goto done;
    }
    frames_move(&motion, surface->nvert, surface->vert);
    if (!(name = strdup(mesh->name)) || meshes_with(node, name, surface, &meshes, &n) != CN_OK) {
        cn_fail(&error, CN_ERR_MEMORY, "", 0, "out of memory");
        goto done;
    }
    if (stage_new(&fresh, node, node->scene_file, n, meshes, mesh->frame[0] ? node->frame : "", false,
                  &error) != CN_OK)
        goto done;

    meshes_keep(node, meshes, n, fresh->scene->nvessel == 1);
    name = NULL, surface = NULL, meshes = NULL;
    forget_foreign(node);
    stage_show(node, fresh, node->frame);
    CN_LOG(CN_LOG_INFO, "artery mesh accepted: %zu vertices, %zu triangles", mesh->nvert, mesh->ntri);
done:
    put_in_force(node, fresh, "artery mesh", &error);
    free(name);
    free(meshes);
    cn_surface_free(surface);
}

void came_free(came_mesh *mesh)
{
    if (mesh) cn_ros_message_free(mesh->message);
    free(mesh);
}

/* Takes a mesh; one of the same name that still waits makes room for it, or the oldest does: counted. */
void on_mesh(void *user, cn_ros_message *message)
{
    cn_node *node = user;
    came_mesh *const mesh = calloc(1, sizeof *mesh), *dropped = NULL;
    size_t size;
    int at = 0;

    if (!mesh) {
        CN_LOG(CN_LOG_ERROR, "an artery mesh is lost: out of memory");
        cn_ros_message_free(message);
        return;
    }
    mesh->message = message;
    const uint8_t *const bytes = cn_ros_message_bytes(message, &size);
    mesh_look(mesh, size, bytes, &mesh->error);
    pthread_mutex_lock(&node->lock);
    while (at < node->ncame && strcmp(node->came[at]->name, mesh->name))
        at++;
    if (at == MESHES_MOST) at = 0;
    if (at < node->ncame) {
        dropped = node->came[at];
        node->ncame--, node->checking--, node->meshes_dropped++;
        memmove(node->came + at, node->came + at + 1, (size_t)(node->ncame - at) * sizeof *node->came);
    }
    node->came[node->ncame++] = mesh, node->checking++;
    pthread_cond_signal(&node->mesh_came);
    pthread_mutex_unlock(&node->lock);
    came_free(dropped);
}

static void *check_meshes(void *user)
{
    cn_node *node = user;
    pthread_setname_np(pthread_self(), "mesh");
    step_back(5); /* behind roscpp's threads, which started it */
    pthread_mutex_lock(&node->lock);
    for (;;) {
        while (node->ncame == 0 && !node->leaving)
            pthread_cond_wait(&node->mesh_came, &node->lock);
        if (node->leaving) break;
        came_mesh *mesh = node->came[0];
        memmove(node->came, node->came + 1, (size_t)--node->ncame * sizeof *node->came);
        pthread_mutex_unlock(&node->lock);
        check_mesh(node, mesh);
        came_free(mesh);
        malloc_trim(0); /* maps come and go: what lies between them goes back */
        pthread_mutex_lock(&node->lock);
    }
    pthread_mutex_unlock(&node->lock);
    return NULL;
}

cn_status meshes_start(cn_node *node)
{
    if (pthread_create(&node->checker, NULL, check_meshes, node)) return CN_ERR_MEMORY;
    node->is_checking = true;
    return CN_OK;
}

void meshes_stop(cn_node *node)
{
    pthread_mutex_lock(&node->lock);
    node->leaving = true;
    pthread_cond_broadcast(&node->mesh_came);
    pthread_mutex_unlock(&node->lock);
    if (node->is_checking) pthread_join(node->checker, NULL);
    node->is_checking = false;
}

void stage_first(cn_node *node)
{
    cn_error error = {0};
    cn_scene *scene = NULL;
    stage *first = NULL;

    if (cn_scene_read(&scene, node->scene_file, node->nsetting, node->setting, &error) == CN_OK &&
        scene->nvessel == 0 && stage_new(&first, node, node->scene_file, 0, NULL, "", false, &error) == CN_OK)
        stage_show(node, first, node->frame);
    cn_scene_free(scene);
    put_in_force(node, first, "scene", &error);
}
