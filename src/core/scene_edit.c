/* scene_edit.c - a scene file with other waypoints: all else, comments too, stays as it stands. The places
 * are found by libyaml's events; where a key is missing it is put before the first of its map. */
#include "output.h"
#include "scene_yaml.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <yaml.h>

/* A place in the text, in characters; and how to write there. */
typedef struct {
    const char *map, *key; /* path of the map, "/bodies/0"; key in it */
    bool map_found, found, flow;
    size_t from, to; /* of the key with its value, or of the map's first key */
    size_t column;   /* of the map's first key */
} place;

typedef struct {
    bool map, flow, key_next, any;
    int index;        /* of the next entry of a list */
    size_t from;      /* of the last key */
    size_t path_long; /* length of the path of this map or list */
} level;

typedef struct {
    int depth;
    level level[CN_YAML_DEPTH];
    char path[256]; /* of the value that is read: "/bodies/0/shape" */
    size_t last;    /* end of the last scalar or flow list */
    int nplace;
    place *place;
} walk;

/* Appends to the path; what does not fit is no path that is looked for. */
static void extend(walk *w, size_t at, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    if (at < sizeof w->path) vsnprintf(w->path + at, sizeof w->path - at, format, arguments);
    va_end(arguments);
}

static void on_key(walk *w, const yaml_event_t *event)
{
    level *l = &w->level[w->depth - 1];
    l->from = event->start_mark.index;
    w->path[l->path_long] = 0;
    for (int i = 0; !l->any && i < w->nplace; i++) {
        place *p = &w->place[i];
        if (strcmp(w->path, p->map)) continue;
        p->map_found = true, p->flow = l->flow;
        p->from = p->to = event->start_mark.index, p->column = event->start_mark.column;
    }
    extend(w, l->path_long, "/%.100s", (const char *)event->data.scalar.value);
    l->any = true, l->key_next = false;
}

/* A value that ends at `to`: the path is its own. */
static void on_value_end(walk *w, size_t to)
{
    level *l = w->depth ? &w->level[w->depth - 1] : NULL;
    if (!l || !l->map) return;
    for (int i = 0; i < w->nplace; i++) {
        place *p = &w->place[i];
        const size_t length = strlen(p->map);
        if (strncmp(w->path, p->map, length) || w->path[length] != '/' ||
            strcmp(w->path + length + 1, p->key))
            continue;
        p->found = true, p->from = l->from, p->to = to;
    }
    l->key_next = true;
}

static void on_event(walk *w, const yaml_event_t *event)
{
    level *l = w->depth ? &w->level[w->depth - 1] : NULL;
    const bool begins = event->type == YAML_SCALAR_EVENT || event->type == YAML_SEQUENCE_START_EVENT ||
                        event->type == YAML_MAPPING_START_EVENT;
    if (begins && l && l->map && l->key_next) {
        if (event->type == YAML_SCALAR_EVENT) on_key(w, event);
        return;
    }
    if (begins && l && !l->map) extend(w, l->path_long, "/%d", l->index++);
    if (event->type == YAML_SCALAR_EVENT) {
        w->last = event->end_mark.index;
        on_value_end(w, w->last);
    } else if (begins && w->depth < CN_YAML_DEPTH) {
        const bool map = event->type == YAML_MAPPING_START_EVENT;
        const bool flow = map ? event->data.mapping_start.style == YAML_FLOW_MAPPING_STYLE
                              : event->data.sequence_start.style == YAML_FLOW_SEQUENCE_STYLE;
        w->level[w->depth++] =
            (level){.map = map, .flow = flow, .key_next = map, .path_long = strlen(w->path)};
    } else if (event->type == YAML_SEQUENCE_END_EVENT || event->type == YAML_MAPPING_END_EVENT) {
        if (l->flow) w->last = event->end_mark.index;
        w->path[l->path_long] = 0;
        w->depth--;
        on_value_end(w, w->last);
    }
}

/* The text has been read as a scene: it holds no errors, and is not deeper than CN_YAML_DEPTH. */
static cn_status find_places(const char *text, size_t length, int n, place *places)
{
    walk w = {.nplace = n, .place = places};
    yaml_parser_t parser;
    cn_status status = CN_OK;
    bool end = false;

    if (!yaml_parser_initialize(&parser)) return CN_ERR_MEMORY;
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, length);
    while (!end && status == CN_OK) {
        yaml_event_t event;
        if (!yaml_parser_parse(&parser, &event)) {
            status = CN_ERR_PARSE;
            break;
        }
        end = event.type == YAML_STREAM_END_EVENT;
        on_event(&w, &event);
        yaml_event_delete(&event);
    }
    yaml_parser_delete(&parser);
    return status;
}

/* Byte at which character `index` of UTF-8 text begins; a byte order mark is no character. */
static size_t byte_of(const char *text, size_t length, size_t index)
{
    size_t at = length >= 3 && !memcmp(text, "\xef\xbb\xbf", 3) ? 3 : 0;
    for (; index > 0 && at < length; index--)
        do
            at++;
        while (at < length && (text[at] & 0xc0) == 0x80);
    return at;
}

static void write_points(FILE *file, int n, const double *x)
{
    for (int i = 0; i < n; i++)
        fprintf(file, "%s[%.17g, %.17g, %.17g]", i ? ", " : "", x[3 * i], x[3 * i + 1], x[3 * i + 2]);
}

/* The text with the first body's waypoints from the second on, and its entry (a catheter's) the first. */
static void write_text(FILE *file, const char *text, size_t length, int n, const place *places, int nwaypoint,
                       const double *waypoint)
{
    size_t at = 0;
    for (int done = 0; done < n; done++) {
        const place *p = places; /* the first in the text that is not behind us */
        if (n > 1 && (places[0].from > places[1].from) == (done == 0)) p = places + 1;
        const size_t from = byte_of(text, length, p->from);
        fwrite(text + at, 1, from - at, file);
        fprintf(file, "%s: ", p->key);
        if (p == places) fputc('[', file);
        write_points(file, p == places ? nwaypoint - 1 : 1, p == places ? waypoint + 3 : waypoint);
        if (p == places) fputc(']', file);
        if (!p->found && p->flow) fputs(", ", file);
        if (!p->found && !p->flow) fprintf(file, "\n%*s", (int)p->column, "");
        at = byte_of(text, length, p->to);
    }
    fwrite(text + at, 1, length - at, file);
}

/* What was written is a scene, with just these waypoints. */
static cn_status verify(const char *path, const char *name, int nwaypoint, const double *waypoint,
                        cn_error *error)
{
    cn_scene *scene = NULL;
    cn_status status = cn_scene_read(&scene, path, 0, NULL, error);
    if (status == CN_OK) {
        const cn_body_spec *body = &scene->body[0];
        const size_t rest = 3 * (size_t)(nwaypoint - 1) * sizeof(double);
        const bool same = scene->nbody > 0 && body->nwaypoint == nwaypoint - 1 &&
                          !memcmp(body->waypoint, waypoint + 3, rest) &&
                          (body->shape.kind != CN_SHAPE_CATHETER ||
                           !memcmp(body->shape.catheter.entry, waypoint, 3 * sizeof(double)));
        if (!same)
            status = cn_fail(error, CN_FAULT_UNSUITED, name, 0,
                             "the waypoints cannot be put into this scene's text");
    }
    cn_scene_free(scene);
    return status;
}

static cn_status whole_file(const char *path, char **out, size_t *length, cn_error *error)
{
    struct stat info;
    FILE *file = fopen(path, "rb");
    *out = NULL;
    if (!file || fstat(fileno(file), &info) || !S_ISREG(info.st_mode) || info.st_size > CN_YAML_BYTES) {
        if (file) fclose(file);
        return cn_fail(error, CN_FAULT_ACCESS, path, 0, "the scene cannot be read");
    }
    if ((*out = malloc((size_t)info.st_size + 1))) *length = fread(*out, 1, (size_t)info.st_size, file);
    fclose(file);
    return *out ? CN_OK : cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory");
}

cn_status cn_scene_write_waypoints(const char *from, const char *to, int nwaypoint, const double *waypoint,
                                   cn_error *error)
{
    place places[2] = {{.map = "/bodies/0", .key = "waypoints"},
                       {.map = "/bodies/0/shape/catheter", .key = "entry"}};
    cn_scene *scene = NULL;
    cn_output output;
    char *text = NULL;
    size_t length = 0;
    cn_status status;

    if (nwaypoint < 2) return cn_fail(error, CN_FAULT_TOO_FEW, to, 0, "at least two waypoints are needed");
    if ((status = cn_scene_read(&scene, from, 0, NULL, error)) != CN_OK) return status;
    const int n = scene->nbody > 0 && scene->body[0].shape.kind == CN_SHAPE_CATHETER ? 2 : 1;
    cn_scene_free(scene);
    if ((status = whole_file(from, &text, &length, error)) != CN_OK) return status;
    if (length >= 2 && (!memcmp(text, "\xff\xfe", 2) || !memcmp(text, "\xfe\xff", 2)))
        status = cn_fail(error, CN_FAULT_SYNTAX, from, 0, "the scene is not UTF-8: save it as UTF-8 first");
    else if ((status = find_places(text, length, n, places)) != CN_OK)
        cn_fail(error, status, from, 0, "the scene cannot be read again");
    for (int i = 0; i < n && status == CN_OK; i++)
        if (!places[i].map_found)
            status = cn_fail(error, CN_FAULT_NEEDED, from, 0, "the scene has no body to take waypoints");
    if (status == CN_OK && (status = cn_output_open(&output, to, error)) == CN_OK) {
        write_text(output.file, text, length, n, places, nwaypoint, waypoint);
        if (!output.temporary)
            status = cn_fail(error, CN_FAULT_NO_FILE, to, 0, "is there and is no file");
        else if (fflush(output.file))
            status = cn_fail(error, CN_FAULT_ACCESS, to, 0, "cannot be written: the disk may be full");
        else
            status = verify(output.temporary, to, nwaypoint, waypoint, error);
        if (status == CN_OK)
            status = cn_output_commit(&output, error);
        else
            cn_output_discard(&output);
    }
    free(text);
    return status;
}
