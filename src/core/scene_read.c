/* The scene reader: file -> tree (scene_yaml.c) -> settings put in -> schema walked over the tree, plain
 * values by scene_value.c. Defaults are read by the same functions as the user's values. */
#include "scene_reader.h"

#include <errno.h>
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define MOST_KEYS 32 /* in one map of the schema; a test holds the table to it */

typedef struct cn_reader reader_t;

static cn_status read_map(reader_t *r, const cn_schema *schema, int node, void *base);
static cn_status read_default(reader_t *r, const cn_key *key, int node, void *base);

static cn_status read_list(reader_t *r, const cn_key *key, int node, void *base)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->kind != CN_YAML_LIST || n->count < key->low) return cn_reader_expected(r, key, node);
    if (n->count == 0) return CN_OK;
    char *entry = calloc((size_t)n->count, key->size);
    if (!entry) return CN_ERR_MEMORY;
    memcpy((char *)base + key->offset, &entry, sizeof entry);
    memcpy((char *)base + key->count, &n->count, sizeof n->count);
    cn_status status = CN_OK;
    int index = 0;
    for (int child = n->first; child >= 0 && status == CN_OK; child = r->tree.node[child].next, index++) {
        char number[16];
        snprintf(number, sizeof number, "%d", index);
        const size_t outer = cn_reader_enter(r, number);
        status = read_map(r, key->map, child, entry + (size_t)index * key->size);
        cn_reader_leave(r, outer);
    }
    return status;
}

static cn_status read_value(reader_t *r, const cn_key *key, int node, void *base)
{
    void *field = (char *)base + key->offset;
    const cn_yaml_kind kind = r->tree.node[node].kind;

    if (key->type == CN_KEY_LIST) return read_list(r, key, node, base);
    if (key->type == CN_KEY_MAP && key->flags & CN_SHORT && kind == CN_YAML_LIST) {
        cn_status status = read_value(r, &key->map->keys[0], node, field);
        for (const cn_key *k = key->map->keys + 1; k->name && status == CN_OK; k++)
            status = read_default(r, k, node, field);
        return status;
    }
    if (key->type == CN_KEY_MAP || (key->type == CN_KEY_CONTROL && kind == CN_YAML_MAP))
        return read_map(r, key->map, node, field);
    return cn_reader_value(r, key, node, base);
}

/* The key's default, as if it stood in the map or list `node`. */
static cn_status read_default(reader_t *r, const cn_key *key, int node, void *base)
{
    const char *text = key->type == CN_KEY_MAP ? "{}" : key->type == CN_KEY_LIST ? "[]" : key->value;
    const int line = r->tree.node[node].line, setting = r->tree.node[node].setting;
    int standard;
    cn_status status =
        cn_yaml_read(&r->tree, strlen(text), text, r->file, setting, line, &standard, r->error);
    if (status != CN_OK) return status;
    r->tree.node[standard].line = line;
    const size_t outer = cn_reader_enter(r, key->name);
    status = read_value(r, key, standard, base);
    cn_reader_leave(r, outer);
    return status;
}

/* Edits (insertions, deletions, changes of a letter) from one word to another, words cut at 31 letters. */
static int edits(const char *a, const char *b)
{
    int row[32];
    const int na = (int)strnlen(a, 31), nb = (int)strnlen(b, 31);
    for (int j = 0; j <= nb; j++)
        row[j] = j;
    for (int i = 1; i <= na; i++) {
        int diagonal = row[0];
        row[0] = i;
        for (int j = 1; j <= nb; j++) {
            const int change = diagonal + (a[i - 1] != b[j - 1]);
            diagonal = row[j];
            row[j] = 1 + (row[j] < row[j - 1] ? row[j] : row[j - 1]);
            if (change < row[j]) row[j] = change;
        }
    }
    return row[nb];
}

static cn_status refuse_unknown(reader_t *r, const cn_schema *schema, int child)
{
    const char *word = cn_yaml_key(&r->tree, child);
    const cn_key *nearest = schema->keys;
    for (const cn_key *key = schema->keys; key->name; key++)
        if (edits(word, key->name) < edits(word, nearest->name)) nearest = key;
    return cn_reader_fail(r, CN_FAULT_KEY, child, "unknown key \"%.60s\"; the nearest known key is \"%s\"",
                          word, nearest->name);
}

/* What was not given: its default, or the refusal of what has none. */
static cn_status read_missing(reader_t *r, const cn_schema *schema, const int *given, int node, int ikey,
                              void *base)
{
    const cn_key *key = &schema->keys[ikey];
    char expected[160];

    if (key->flags & CN_REQUIRED)
        return cn_reader_fail(r, CN_FAULT_MISSING, node, "the key \"%s\" is missing: expected %s", key->name,
                              cn_key_expected(key, sizeof expected, expected));
    if (key->group) {
        char names[128] = "";
        for (int i = 0; schema->keys[i].name; i++) {
            if (schema->keys[i].group != key->group) continue;
            if (given[i] >= 0) return CN_OK; /* another of its group stands */
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", *names ? ", " : "",
                     schema->keys[i].name);
        }
        if (key->flags & CN_NEEDED)
            return cn_reader_fail(r, CN_FAULT_MISSING, node, "expected one of the keys %s", names);
    }
    if (key->flags & CN_UNSET) return CN_OK;
    return read_default(r, key, node, base);
}

static cn_status read_map(reader_t *r, const cn_schema *schema, int node, void *base)
{
    int given[MOST_KEYS];
    cn_status status = CN_OK;

    for (int i = 0; i < MOST_KEYS; i++)
        given[i] = -1;
    if (r->tree.node[node].kind != CN_YAML_MAP) {
        char names[200] = "";
        for (const cn_key *key = schema->keys; key->name && strlen(names) < 160; key++)
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", *names ? ", " : "",
                     key->name);
        return cn_reader_fail(r, CN_FAULT_TYPE, node, "expected a map with keys such as %s", names);
    }
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next) {
        int ikey = 0;
        while (schema->keys[ikey].name && strcmp(schema->keys[ikey].name, cn_yaml_key(&r->tree, child)))
            ikey++;
        const cn_key *key = &schema->keys[ikey];
        if (!key->name) return refuse_unknown(r, schema, child);
        if (given[ikey] >= 0)
            return cn_reader_fail(r, CN_FAULT_TWICE, child, "the key \"%s\" was already given in line %d",
                                  key->name, r->tree.node[given[ikey]].line);
        for (int i = 0; key->group && schema->keys[i].name; i++)
            if (given[i] >= 0 && schema->keys[i].group == key->group)
                return cn_reader_fail(r, CN_FAULT_EXCLUSIVE, child,
                                      "\"%s\" and \"%s\" exclude each other: give one", key->name,
                                      schema->keys[i].name);
        given[ikey] = child;
        const size_t outer = cn_reader_enter(r, key->name);
        status = read_value(r, key, child, base);
        cn_reader_leave(r, outer);
        if (status != CN_OK) return status;
        char *mark = (char *)base + key->mark;
        if (key->mark_size == 1)
            *(bool *)mark = key->mark_value != 0;
        else if (key->mark_size)
            memcpy(mark, &key->mark_value, sizeof key->mark_value);
    }
    for (int ikey = 0; schema->keys[ikey].name; ikey++)
        if (given[ikey] < 0 && (status = read_missing(r, schema, given, node, ikey, base)) != CN_OK)
            return status;
    return schema->check ? schema->check(r, node, base) : CN_OK;
}

/* --- the file --- */
static cn_status read_bytes(const char *path, char **out, size_t *length, cn_error *error)
{
    struct stat info;
    char *bytes = NULL;
    FILE *file = fopen(path, "rb");
    if (!file || fstat(fileno(file), &info)) {
        const int cause = errno;
        if (file) fclose(file);
        return cn_fail(error, cn_fault_file(cause), path, 0, "the scene cannot be opened: %s",
                       strerror(cause));
    }
    cn_status status = CN_OK;
    if (!S_ISREG(info.st_mode))
        status = cn_fail(error, CN_FAULT_NO_FILE, path, 0, "the scene is not a file");
    else if (info.st_size > CN_YAML_BYTES)
        status = cn_fail(error, CN_FAULT_LARGE, path, 0, "the scene is larger than 16 MiB");
    else if (!(bytes = malloc((size_t)info.st_size + 1)))
        status = CN_ERR_MEMORY;
    else if ((*length = fread(bytes, 1, (size_t)info.st_size, file)) < (size_t)info.st_size && ferror(file))
        status =
            cn_fail(error, cn_fault_file(errno), path, 0, "the scene cannot be read: %s", strerror(errno));
    fclose(file);
    if (status == CN_OK)
        *out = bytes;
    else
        free(bytes);
    return status;
}

cn_status cn_scene_read(cn_scene **out, const char *path, int nsetting, const cn_setting *setting,
                        cn_error *error)
{
    reader_t reader = {.file = path, .setting = setting, .error = error};
    cn_scene *scene = NULL;
    char *bytes = NULL;
    size_t length = 0;
    int root = -1;
    const locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0); /* numbers have a point everywhere */
    const locale_t old = c_locale ? uselocale(c_locale) : (locale_t)0;
    cn_status status = c_locale ? CN_OK : CN_ERR_MEMORY;

    *out = NULL;
    if (status == CN_OK) status = read_bytes(path, &bytes, &length, error);
    if (status == CN_OK) status = cn_yaml_read(&reader.tree, length, bytes, path, -1, 0, &root, error);
    for (int i = 0; i < nsetting && status == CN_OK; i++)
        status = cn_yaml_set(&reader.tree, root, i, &setting[i], path, error);
    if (status == CN_OK && !(scene = calloc(1, sizeof *scene))) status = CN_ERR_MEMORY;
    if (status == CN_OK && !(scene->path = strdup(path))) status = CN_ERR_MEMORY;
    if (status == CN_OK) status = read_map(&reader, &cn_scene_schema, root, scene);
    if (status == CN_OK)
        *out = scene;
    else
        cn_scene_free(scene);
    if (status == CN_ERR_MEMORY) cn_fail(error, status, path, 0, "out of memory while the scene is read");
    free(bytes);
    cn_yaml_clear(&reader.tree);
    if (c_locale) {
        uselocale(old);
        freelocale(c_locale);
    }
    return status;
}

void cn_scene_free(cn_scene *scene)
{
    if (!scene) return;
    cn_schema_free(&cn_scene_schema, scene);
    free(scene->path);
    free(scene);
}
