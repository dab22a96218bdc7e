/* node_repeat.c - what it takes to get the same plan again: under `repeat` in every answer's report. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "node_parts.h"

unsigned long long checksum(int nvert, const double *vert, int nindex, const int *index)
{
    unsigned long long hash = 0xcbf29ce484222325ULL;
    const unsigned char *part[2] = {(const unsigned char *)vert, (const unsigned char *)index};
    const size_t size[2] = {3 * (size_t)nvert * sizeof(double), (size_t)nindex * sizeof(int)};
    for (int p = 0; p < 2; p++)
        for (size_t i = 0; i < size[p]; i++)
            hash = (hash ^ part[p][i]) * 0x100000001b3ULL;
    return hash;
}

/* Text that may not be UTF-8, which JSON must be. */
static json_t *text(const char *s)
{
    json_t *t = json_string(s);
    return t ? t : json_string("?");
}

static json_t *number(double v) /* what is not finite is null */
{
    json_t *n = json_real(v);
    return n ? n : json_null();
}

static void append_mesh(json_t *list, const char *name, int nvert, const char *cells, int ncell,
                        unsigned long long sum)
{
    char digits[32];
    snprintf(digits, sizeof digits, "%016llx", sum);
    json_array_append_new(list, json_pack("{s:o, s:i, s:i, s:s}", "name", text(name), "vertices", nvert,
                                          cells, ncell, "fnv1a", digits));
}

static json_t *walls(const stage *s) /* as they were in force */
{
    json_t *list = json_array();
    for (int i = 0; s && i < s->world->nwall; i++) {
        const cn_surface *w = s->world->wall[i].surface;
        append_mesh(list, s->world->wall[i].name, w->nvert, "triangles", w->ntri,
                    checksum(w->nvert, w->vert, 3 * w->ntri, w->tri));
    }
    return list;
}

static json_t *bodies(const cn_node *node, const stage *s) /* as they were at rest */
{
    json_t *list = json_array();
    for (int i = 0; s && i < node->nshown; i++)
        append_mesh(list, node->shown[i].name, node->shown[i].npoint, "tetrahedra", node->shown[i].ntet,
                    node->shown[i].sum);
    return list;
}

static json_t *options(const cn_node *node)
{
    json_t *list = json_object();
    for (int i = 0; i < node->nsetting; i++)
        json_object_set_new(list, node->setting[i].key, text(node->setting[i].value));
    return list;
}

/* The run-time settings that are not the scene's. */
static json_t *tuned(const cn_ros_tuning *t)
{
    json_t *list = json_object();
    if (t->step > 0) json_object_set_new(list, "step", number(t->step));
    if (t->time_limit > 0) json_object_set_new(list, "time_limit", number(t->time_limit));
    if (t->budget > 0) json_object_set_new(list, "planner_budget", number(t->budget));
    if (t->replans >= 0) json_object_set_new(list, "planner_replans", json_integer(t->replans));
    for (int q = 0; q < CN_QUANTITY_PROGRESS; q++)
        for (int r = 0; r < 2; r++) {
            char key[64];
            if (!(t->limit[q][r] >= 0)) continue;
            snprintf(key, sizeof key, "limit_%s_%s", cn_quantity_name((cn_quantity)q), r ? "mean" : "max");
            json_object_set_new(list, key, number(t->limit[q][r]));
        }
    return list;
}

static json_t *asked(const cn_ros_request *r)
{
    json_t *points = json_array(), *limits = json_array();
    for (int i = 0; i < r->nwaypoint; i++)
        json_array_append_new(points,
                              json_pack("[o, o, o]", number(r->waypoint[3 * i]),
                                        number(r->waypoint[3 * i + 1]), number(r->waypoint[3 * i + 2])));
    for (int i = 0; i < r->nlimit; i++)
        json_array_append_new(limits,
                              json_pack("{s:o, s:o, s:o, s:o}", "body", text(r->limit[i].body), "quantity",
                                        text(r->limit[i].quantity), "reduce", text(r->limit[i].reduce),
                                        "limit", number(r->limit[i].limit)));
    return json_pack("{s:o, s:o, s:o, s:o, s:o, s:I, s:o}", "frame", text(r->frame), "waypoints", points,
                     "limits", limits, "sampling", text(r->sampling), "budget", number(r->budget), "seed",
                     (json_int_t)r->seed, "scene", text(r->scene));
}

char *answer_json(const cn_node *node, const stage *s, const cn_ros_request *request, const char *frame,
                  const cn_ros_tuning *tuning, const cn_report *report)
{
    json_t *versions = json_object(), *root = NULL, *repeat;
    char *plain = cn_report_json(report), *json = NULL;

    if (plain) root = json_loads(plain, 0, NULL);
    for (const cn_ros_version *v = cn_ros_versions(); v->what; v++)
        json_object_set_new(versions, v->what, text(v->version));
    json_object_set_new(versions, "catnav", text(CATNAV_VERSION));
    repeat = json_pack("{s:I, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "seed", (json_int_t)report->seed,
                       "versions", versions, "scene", text(s ? s->scene->path : node->scene_file), "frame",
                       text(frame), "request", asked(request), "options", options(node), "settings",
                       tuned(tuning), "walls", walls(s), "bodies", bodies(node, s));
    if (root && repeat && !json_object_set(root, "repeat", repeat)) json = json_dumps(root, JSON_INDENT(2));
    json_decref(repeat);
    json_decref(root);
    if (!json) return plain;
    free(plain);
    return json;
}
