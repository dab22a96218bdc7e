/* The scene reader: file -> tree (scene_yaml.c) -> settings put in -> schema walked over the tree. Defaults
 * are read by the same functions as the user's values. */
#include "scene_schema.h"
#include "scene_yaml.h"
#include "catnav/vec3.h"

#include <errno.h>
#include <limits.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MOST_KEYS 32 /* in one map of the schema; a test holds the table to it */

struct cn_reader {
    const char *file;
    const cn_setting *setting;
    cn_error *error;
    cn_yaml tree;
    char where[256]; /* key path of what is being read */
};
typedef struct cn_reader reader_t;

/* --- refusals --- */
static cn_status refuse_at(reader_t *r, cn_status status, int node, const char *sentence)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->setting < 0) return cn_fail(r->error, status, r->file, n->line, "%s", sentence);
    const cn_setting *setting = &r->setting[n->setting];
    return cn_fail(r->error, status, r->file, 0, "setting %.80s=%.80s: %s", setting->key, setting->value,
                   sentence);
}

static cn_status refuse(reader_t *r, cn_status status, int node, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
static cn_status refuse(reader_t *r, cn_status status, int node, const char *format, ...)
{
    char sentence[400];
    int length = snprintf(sentence, sizeof sentence, "%.120s: ", *r->where ? r->where : "the scene");
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(sentence + length, sizeof sentence - (size_t)length, format, arguments);
    va_end(arguments);
    return refuse_at(r, status, node, sentence);
}

/* "expected X, found Y" */
static cn_status refuse_value(reader_t *r, const cn_key *key, int node)
{
    static const char *const kinds[] = {"", "a list", "a map"};
    const cn_yaml_node *n = &r->tree.node[node];
    char expected[160];
    cn_key_expected(key, sizeof expected, expected);
    if (n->kind != CN_YAML_SCALAR)
        return refuse(r, CN_ERR_PARSE, node, "expected %s, found %s", expected, kinds[n->kind]);
    if (n->length == 0) return refuse(r, CN_ERR_PARSE, node, "expected %s, found nothing", expected);
    return refuse(r, CN_ERR_PARSE, node, "expected %s, found %s%.60s%s", expected,
                  n->plain ? "" : "the text \"", cn_yaml_text(&r->tree, node), n->plain ? "" : "\"");
}

static size_t enter(reader_t *r, const char *name) /* returns what `leave` takes */
{
    const size_t length = strlen(r->where);
    snprintf(r->where + length, sizeof r->where - length, "%s%s", length ? "." : "", name);
    return length;
}

static void leave(reader_t *r, size_t length)
{
    r->where[length] = 0;
}

cn_status cn_reader_refuse(reader_t *r, int node, const char *key, const char *format, ...)
{
    char sentence[300];
    const int child = key ? cn_yaml_find(&r->tree, node, key) : -1;
    const size_t outer = key ? enter(r, key) : strlen(r->where);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(sentence, sizeof sentence, format, arguments);
    va_end(arguments);
    const cn_status status = refuse(r, CN_ERR_SCENE, child < 0 ? node : child, "%s", sentence);
    leave(r, outer);
    return status;
}

int cn_reader_child(const reader_t *r, int node, const char *key)
{
    return cn_yaml_find(&r->tree, node, key);
}
int cn_reader_first(const reader_t *r, int node)
{
    return r->tree.node[node].first;
}
int cn_reader_next(const reader_t *r, int node)
{
    return r->tree.node[node].next;
}

/* --- plain values --- */
static bool is_word(const reader_t *r, int node, const char *word)
{
    return r->tree.node[node].kind == CN_YAML_SCALAR && !strcmp(cn_yaml_text(&r->tree, node), word);
}

static bool is_null(const reader_t *r, int node) /* in quotes it is text */
{
    return r->tree.node[node].plain && (is_word(r, node, "null") || is_word(r, node, "~"));
}

static const char *skip_digits(const char *c)
{
    while (*c >= '0' && *c <= '9')
        c++;
    return c;
}

/* The whole of a plain scalar as a decimal number: no rest, comma, nan, inf, hexadecimal or leading zero
 * (octal). */
static bool parse_number(const reader_t *r, int node, bool whole, double *out)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const char *text = cn_yaml_text(&r->tree, node), *c = text;
    if (n->kind != CN_YAML_SCALAR || !n->plain) return false;
    if (*c == '-' || *c == '+') c++;
    const char *digits = c;
    c = skip_digits(c);
    bool some = c > digits;
    if (c > digits + 1 && *digits == '0') return false;
    if (!whole) {
        if (*c == '.') {
            const char *fraction = c + 1;
            c = skip_digits(fraction);
            some = some || c > fraction;
        }
        if (some && (*c == 'e' || *c == 'E')) {
            c++;
            if (*c == '-' || *c == '+') c++;
            const char *exponent = c;
            c = skip_digits(c);
            some = c > exponent;
        }
    }
    if (!some || c != text + n->length) return false; /* length: a zero byte is a rest too */
    *out = strtod(text, NULL);                        /* in the C locale: cn_scene_read sets it */
    return isfinite(*out);
}

static bool in_range(const cn_key *key, double value)
{
    if (key->low == 0 && key->high == 0) return isfinite(value);
    return (key->flags & CN_ABOVE ? value > key->low : value >= key->low) &&
           (key->flags & CN_BELOW ? value < key->high : value <= key->high);
}

static cn_status read_real(reader_t *r, const cn_key *key, int node, double *out)
{
    if (key->flags & CN_MAY_AUTO && is_word(r, node, "auto")) return *out = NAN, CN_OK;
    if (key->flags & CN_MAY_NULL && is_null(r, node)) return *out = INFINITY, CN_OK;
    if (!parse_number(r, node, false, out) || !in_range(key, *out)) return refuse_value(r, key, node);
    return CN_OK;
}

static cn_status read_count(reader_t *r, const cn_key *key, int node, int *out)
{
    double value;
    if (key->flags & CN_MAY_AUTO && is_word(r, node, "auto")) return *out = -1, CN_OK;
    if (!parse_number(r, node, true, &value) || !in_range(key, value)) return refuse_value(r, key, node);
    *out = (int)value;
    return CN_OK;
}

/* `true` and `false` are what other YAML tools make of on and off. */
static cn_status read_choice(reader_t *r, const cn_key *key, int node, int *out)
{
    if (r->tree.node[node].kind != CN_YAML_SCALAR) return refuse_value(r, key, node);
    *out = cn_key_choice(key, is_word(r, node, "true")    ? "on"
                              : is_word(r, node, "false") ? "off"
                                                          : cn_yaml_text(&r->tree, node));
    return *out == INT_MIN ? refuse_value(r, key, node) : CN_OK;
}

static cn_status read_text(reader_t *r, const cn_key *key, int node, char **out)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const char *text = cn_yaml_text(&r->tree, node);
    if (n->kind != CN_YAML_SCALAR || n->length == 0 || is_null(r, node) ||
        (key->high > 0 && n->length > key->high))
        return refuse_value(r, key, node);
    for (int i = 0; i < n->length; i++)
        if ((unsigned char)text[i] < ' ' || text[i] == 127)
            return refuse(r, CN_ERR_PARSE, node, "a control character (byte %d) stands in it", i);
    return (*out = strdup(text)) ? CN_OK : CN_ERR_MEMORY;
}

/* A file's name, taken against the scene's folder; the file must be there. */
static cn_status read_file(reader_t *r, const cn_key *key, int node, char **out)
{
    char *name = NULL;
    cn_status status = read_text(r, key, node, &name);
    if (status != CN_OK) return status;
    const char *slash = strrchr(r->file, '/');
    const size_t folder = *name == '/' || !slash ? 0 : (size_t)(slash - r->file) + 1;
    char *path = malloc(folder + strlen(name) + 1);
    if (path) {
        memcpy(path, r->file, folder);
        strcpy(path + folder, name);
    }
    free(name);
    if (!(*out = path)) return CN_ERR_MEMORY;
    struct stat info;
    if (stat(path, &info) || access(path, R_OK))
        return refuse(r, CN_ERR_FILE, node, "expected a file, but %.180s: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode))
        return refuse(r, CN_ERR_FILE, node, "expected a file, but %.180s is none", path);
    return CN_OK;
}

/* --- lists of numbers --- */
static cn_status read_reals(reader_t *r, const cn_key *key, int node, int n, double *out)
{
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != n)
        return refuse_value(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++)
        if (!parse_number(r, child, false, &out[i]) || !in_range(key, out[i]))
            return refuse_value(r, key, child);
    return CN_OK;
}

static cn_status read_counts(reader_t *r, const cn_key *key, int node, int *out)
{
    double value[3];
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != 3)
        return refuse_value(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++) {
        if (!parse_number(r, child, true, &value[i]) || !in_range(key, value[i]))
            return refuse_value(r, key, child);
        out[i] = (int)value[i];
    }
    return CN_OK;
}

static cn_status read_unit(reader_t *r, const cn_key *key, int node, double out[3])
{
    cn_status status = read_reals(r, key, node, 3, out);
    if (status != CN_OK) return status;
    const double largest = fmax(fabs(out[0]), fmax(fabs(out[1]), fabs(out[2])));
    if (!(largest > 0)) return refuse(r, CN_ERR_PARSE, node, "a direction must not be zero");
    for (int i = 0; i < 3; i++)
        out[i] /= largest; /* so that no square over- or underflows */
    cn_normalise(out);
    return CN_OK;
}

static cn_status read_box(reader_t *r, const cn_key *key, int node, double (*out)[3])
{
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != 2)
        return refuse_value(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++) {
        const cn_status status = read_reals(r, key, child, 3, out[i]);
        if (status != CN_OK) return status;
    }
    for (i = 0; i < 3; i++)
        if (out[0][i] > out[1][i])
            return refuse(r, CN_ERR_SCENE, node,
                          "the lower corner's %c, %.10g, is above the upper one's, %.10g", "xyz"[i],
                          out[0][i], out[1][i]);
    return CN_OK;
}

static cn_status read_many(reader_t *r, const cn_key *key, int node, double **out, int *count)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const bool points = key->type == CN_KEY_POINTS, one = !points && n->kind == CN_YAML_SCALAR;
    if (n->kind != CN_YAML_LIST && !one) return refuse_value(r, key, node);
    const int number = one ? 1 : n->count, width = points ? 3 : 1;
    if (number < (points ? key->low : 1)) return refuse(r, CN_ERR_PARSE, node, "the list is too short");
    if (number == 0) return CN_OK;
    if (!(*out = calloc((size_t)number * (size_t)width, sizeof **out))) return CN_ERR_MEMORY;
    *count = number;
    if (one) return read_real(r, key, node, *out);
    if (!points) return read_reals(r, key, node, number, *out);
    const cn_key coordinate = {
        .name = key->name, .type = CN_KEY_VECTOR, .low = -INFINITY, .high = INFINITY, .unit = key->unit};
    int i = 0;
    for (int child = n->first; child >= 0; child = r->tree.node[child].next, i++) {
        const cn_status status = read_reals(r, &coordinate, child, 3, *out + 3 * (size_t)i);
        if (status != CN_OK) return status;
    }
    return CN_OK;
}

/* --- maps and lists of maps --- */
static cn_status read_map(reader_t *r, const cn_schema *schema, int node, void *base);

static cn_status read_control(reader_t *r, const cn_key *key, int node, cn_drive_spec *drive)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->kind == CN_YAML_MAP) return read_map(r, key->map, node, drive);
    if (n->kind == CN_YAML_SCALAR) {
        drive->control_all = !strcmp(cn_yaml_text(&r->tree, node), "all");
        return drive->control_all ? CN_OK : refuse_value(r, key, node);
    }
    if (n->count == 0) return refuse(r, CN_ERR_PARSE, node, "the list of driven nodes is empty");
    if (!(drive->control = calloc((size_t)n->count, sizeof *drive->control))) return CN_ERR_MEMORY;
    drive->ncontrol = n->count;
    int i = 0;
    for (int child = n->first; child >= 0; child = r->tree.node[child].next, i++) {
        double value;
        if (!parse_number(r, child, true, &value) || !(value >= 0 && value <= INT_MAX))
            return refuse(r, CN_ERR_PARSE, child, "expected a node index >= 0");
        drive->control[i] = (int)value;
    }
    return CN_OK;
}

static cn_status read_list(reader_t *r, const cn_key *key, int node, void *base)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->kind != CN_YAML_LIST || n->count < key->low) return refuse_value(r, key, node);
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
        const size_t outer = enter(r, number);
        status = read_map(r, key->map, child, entry + (size_t)index * key->size);
        leave(r, outer);
    }
    return status;
}

static cn_status read_value(reader_t *r, const cn_key *key, int node, void *base)
{
    void *field = (char *)base + key->offset;
    double value;
    int number;
    cn_status status;

    switch (key->type) {
    case CN_KEY_TEXT:
        return read_text(r, key, node, field);
    case CN_KEY_FILE:
        return read_file(r, key, node, field);
    case CN_KEY_REAL:
        return read_real(r, key, node, field);
    case CN_KEY_ANGLE:
        status = read_real(r, key, node, field);
        *(double *)field *= acos(-1) / 180;
        return status;
    case CN_KEY_COUNT:
        return read_count(r, key, node, field);
    case CN_KEY_SEED:
        if (!parse_number(r, node, true, &value) || !in_range(key, value)) return refuse_value(r, key, node);
        *(unsigned *)field = (unsigned)value;
        return CN_OK;
    case CN_KEY_CHOICE:
    case CN_KEY_FLAG:
        if ((status = read_choice(r, key, node, &number)) != CN_OK) return status;
        if (key->type == CN_KEY_FLAG)
            *(bool *)field = number != 0;
        else
            memcpy(field, &number, sizeof number);
        return CN_OK;
    case CN_KEY_VECTOR:
        return read_reals(r, key, node, 3, field);
    case CN_KEY_UNIT:
        return read_unit(r, key, node, field);
    case CN_KEY_COUNTS:
        return read_counts(r, key, node, field);
    case CN_KEY_RANGE:
        if ((status = read_reals(r, key, node, 2, field)) != CN_OK) return status;
        return ((double *)field)[0] < ((double *)field)[1] ? CN_OK : refuse_value(r, key, node);
    case CN_KEY_BOX:
        return read_box(r, key, node, field);
    case CN_KEY_REALS:
    case CN_KEY_POINTS:
        return read_many(r, key, node, field, (int *)((char *)base + key->count));
    case CN_KEY_CONTROL:
        return read_control(r, key, node, field);
    case CN_KEY_MAP:
        if (key->flags & CN_SHORT && r->tree.node[node].kind == CN_YAML_LIST) {
            status = read_value(r, &key->map->keys[0], node, field);
            for (const cn_key *k = key->map->keys + 1; k->name && status == CN_OK; k++) {
                int standard;
                status =
                    cn_yaml_read(&r->tree, strlen(k->value), k->value, r->file, -1, 0, &standard, r->error);
                if (status == CN_OK) status = read_value(r, k, standard, field);
            }
            return status;
        }
        return read_map(r, key->map, node, field);
    case CN_KEY_LIST:
        return read_list(r, key, node, base);
    }
    return CN_ERR_ARG;
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
    return refuse(r, CN_ERR_PARSE, child, "unknown key \"%.60s\"; the nearest known key is \"%s\"", word,
                  nearest->name);
}

/* What was not given: its default, or the refusal of what has none. */
static cn_status read_missing(reader_t *r, const cn_schema *schema, const int *given, int node, int ikey,
                              void *base)
{
    const cn_key *key = &schema->keys[ikey];
    char expected[160];
    int standard;

    if (key->flags & CN_REQUIRED)
        return refuse(r, CN_ERR_PARSE, node, "the key \"%s\" is missing: expected %s", key->name,
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
            return refuse(r, CN_ERR_PARSE, node, "expected one of the keys %s", names);
    }
    if (key->flags & CN_UNSET) return CN_OK;
    const char *text = key->type == CN_KEY_MAP ? "{}" : key->type == CN_KEY_LIST ? "[]" : key->value;
    const int line = r->tree.node[node].line, setting = r->tree.node[node].setting;
    cn_status status =
        cn_yaml_read(&r->tree, strlen(text), text, r->file, setting, line, &standard, r->error);
    if (status != CN_OK) return status;
    r->tree.node[standard].line = line;
    const size_t outer = enter(r, key->name);
    status = read_value(r, key, standard, base);
    leave(r, outer);
    return status;
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
        return refuse(r, CN_ERR_PARSE, node, "expected a map with keys such as %s", names);
    }
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next) {
        int ikey = 0;
        while (schema->keys[ikey].name && strcmp(schema->keys[ikey].name, cn_yaml_key(&r->tree, child)))
            ikey++;
        const cn_key *key = &schema->keys[ikey];
        if (!key->name) return refuse_unknown(r, schema, child);
        if (given[ikey] >= 0)
            return refuse(r, CN_ERR_PARSE, child, "the key \"%s\" was already given in line %d", key->name,
                          r->tree.node[given[ikey]].line);
        for (int i = 0; key->group && schema->keys[i].name; i++)
            if (given[i] >= 0 && schema->keys[i].group == key->group)
                return refuse(r, CN_ERR_SCENE, child, "\"%s\" and \"%s\" exclude each other: give one",
                              key->name, schema->keys[i].name);
        given[ikey] = child;
        const size_t outer = enter(r, key->name);
        status = read_value(r, key, child, base);
        leave(r, outer);
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
        return cn_fail(error, CN_ERR_FILE, path, 0, "the scene cannot be opened: %s", strerror(cause));
    }
    cn_status status = CN_OK;
    if (!S_ISREG(info.st_mode))
        status = cn_fail(error, CN_ERR_FILE, path, 0, "the scene is not a file");
    else if (info.st_size > CN_YAML_BYTES)
        status = cn_fail(error, CN_ERR_FILE, path, 0, "the scene is larger than 16 MiB");
    else if (!(bytes = malloc((size_t)info.st_size + 1)))
        status = CN_ERR_MEMORY;
    else if ((*length = fread(bytes, 1, (size_t)info.st_size, file)) < (size_t)info.st_size && ferror(file))
        status = cn_fail(error, CN_ERR_FILE, path, 0, "the scene cannot be read: %s", strerror(errno));
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
