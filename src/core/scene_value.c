/* Plain values of a scene: numbers, words, points, files; and the sentences that refuse them. */
#include "scene_reader.h"
#include "catnav/vec3.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

typedef struct cn_reader reader_t;

/* --- refusals --- */
static cn_status refuse_at(reader_t *r, int fault, int node, const char *sentence)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->setting < 0) return cn_fail(r->error, fault, r->file, n->line, "%s", sentence);
    const cn_setting *setting = &r->setting[n->setting];
    return cn_fail(r->error, fault, r->file, 0, "setting %.80s=%.80s: %s", setting->key, setting->value,
                   sentence);
}

cn_status cn_reader_fail(reader_t *r, int fault, int node, const char *format, ...)
{
    char sentence[400];
    int length = snprintf(sentence, sizeof sentence, "%.120s: ", *r->where ? r->where : "the scene");
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(sentence + length, sizeof sentence - (size_t)length, format, arguments);
    va_end(arguments);
    return refuse_at(r, fault, node, sentence);
}

size_t cn_reader_enter(reader_t *r, const char *name)
{
    const size_t length = strlen(r->where);
    snprintf(r->where + length, sizeof r->where - length, "%s%s", length ? "." : "", name);
    return length;
}

void cn_reader_leave(reader_t *r, size_t length)
{
    r->where[length] = 0;
}

cn_status cn_reader_refuse(reader_t *r, int fault, int node, const char *key, const char *format, ...)
{
    char sentence[300];
    const int child = key ? cn_yaml_find(&r->tree, node, key) : -1;
    const size_t outer = key ? cn_reader_enter(r, key) : strlen(r->where);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(sentence, sizeof sentence, format, arguments);
    va_end(arguments);
    const cn_status status = cn_reader_fail(r, fault, child < 0 ? node : child, "%s", sentence);
    cn_reader_leave(r, outer);
    return status;
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

/* What is wrong with a value that its key does not take. */
static int unexpected(const reader_t *r, const cn_key *key, int node)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const bool list = key->type == CN_KEY_LIST || (key->type >= CN_KEY_VECTOR && key->type <= CN_KEY_CONTROL);
    double value;
    if (n->kind == CN_YAML_LIST && list)
        return key->type == CN_KEY_RANGE && n->count == 2 ? CN_FAULT_RANGE : CN_FAULT_COUNT;
    if (n->kind != CN_YAML_SCALAR) return CN_FAULT_TYPE;
    if (n->length == 0) return CN_FAULT_MISSING;
    if (key->type == CN_KEY_CHOICE || key->type == CN_KEY_FLAG) return CN_FAULT_CHOICE;
    if (key->type == CN_KEY_TEXT || key->type == CN_KEY_FILE) return CN_FAULT_RANGE; /* its length */
    if (!parse_number(r, node, false, &value))
        return n->plain ? cn_fault_number(cn_yaml_text(&r->tree, node)) : CN_FAULT_TYPE;
    if ((list && n->key >= 0 && key->type != CN_KEY_REALS) || key->type == CN_KEY_MAP)
        return CN_FAULT_TYPE;                                     /* a number, for a list or map */
    return in_range(key, value) ? CN_FAULT_TYPE : CN_FAULT_RANGE; /* a fraction, for a whole number */
}

/* "expected X, found Y" */
cn_status cn_reader_expected(reader_t *r, const cn_key *key, int node)
{
    static const char *const kinds[] = {"", "a list", "a map"}, *const empty[] = {"", "an empty list",
                                                                                  "an empty map"};
    const cn_yaml_node *n = &r->tree.node[node];
    const int fault = unexpected(r, key, node);
    char expected[160], found[61];
    cn_key_expected(key, sizeof expected, expected);
    if (n->kind != CN_YAML_SCALAR)
        return cn_reader_fail(r, fault, node, "expected %s, found %s", expected,
                              n->count == 0 ? empty[n->kind] : kinds[n->kind]);
    if (n->length == 0) return cn_reader_fail(r, fault, node, "expected %s, found nothing", expected);
    snprintf(found, sizeof found, "%s", cn_yaml_text(&r->tree, node));
    for (char *c = found; *c; c++)
        if ((unsigned char)*c < ' ') *c = '?'; /* one line */
    return cn_reader_fail(r, fault, node, "expected %s, found %s%s%s", expected,
                          n->plain ? "" : "the text \"", found, n->plain ? "" : "\"");
}

static cn_status read_real(reader_t *r, const cn_key *key, int node, double *out)
{
    if (key->flags & CN_MAY_AUTO && is_word(r, node, "auto")) return *out = NAN, CN_OK;
    if (key->flags & CN_MAY_NULL && is_null(r, node)) return *out = INFINITY, CN_OK;
    if (!parse_number(r, node, false, out) || !in_range(key, *out)) return cn_reader_expected(r, key, node);
    return CN_OK;
}

static cn_status read_count(reader_t *r, const cn_key *key, int node, int *out)
{
    double value;
    if (key->flags & CN_MAY_AUTO && is_word(r, node, "auto")) return *out = -1, CN_OK;
    if (!parse_number(r, node, true, &value) || !in_range(key, value))
        return cn_reader_expected(r, key, node);
    *out = (int)value;
    return CN_OK;
}

/* `true` and `false` are what other YAML tools make of on and off. */
static cn_status read_choice(reader_t *r, const cn_key *key, int node, int *out)
{
    if (r->tree.node[node].kind != CN_YAML_SCALAR) return cn_reader_expected(r, key, node);
    *out = cn_key_choice(key, is_word(r, node, "true")    ? "on"
                              : is_word(r, node, "false") ? "off"
                                                          : cn_yaml_text(&r->tree, node));
    return *out == INT_MIN ? cn_reader_expected(r, key, node) : CN_OK;
}

static cn_status read_text(reader_t *r, const cn_key *key, int node, char **out)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const char *text = cn_yaml_text(&r->tree, node);
    if (n->kind != CN_YAML_SCALAR || n->length == 0 || is_null(r, node) ||
        (key->high > 0 && n->length > key->high))
        return cn_reader_expected(r, key, node);
    for (int i = 0; i < n->length; i++)
        if ((unsigned char)text[i] < ' ' || text[i] == 127)
            return cn_reader_fail(r, CN_FAULT_SYNTAX, node, "a control character (byte %d) stands in it", i);
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
        return cn_reader_fail(r, cn_fault_file(errno), node, "expected a file, but %.180s: %s", path,
                              strerror(errno));
    if (!S_ISREG(info.st_mode))
        return cn_reader_fail(r, CN_FAULT_NO_FILE, node, "expected a file, but %.180s is none", path);
    return CN_OK;
}

/* --- lists of numbers --- */
static cn_status read_reals(reader_t *r, const cn_key *key, int node, int n, double *out)
{
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != n)
        return cn_reader_expected(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++)
        if (!parse_number(r, child, false, &out[i]) || !in_range(key, out[i]))
            return cn_reader_expected(r, key, child);
    return CN_OK;
}

static cn_status read_counts(reader_t *r, const cn_key *key, int node, int *out)
{
    double value[3];
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != 3)
        return cn_reader_expected(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++) {
        if (!parse_number(r, child, true, &value[i]) || !in_range(key, value[i]))
            return cn_reader_expected(r, key, child);
        out[i] = (int)value[i];
    }
    return CN_OK;
}

static cn_status read_unit(reader_t *r, const cn_key *key, int node, double out[3])
{
    cn_status status = read_reals(r, key, node, 3, out);
    if (status != CN_OK) return status;
    const double largest = fmax(fabs(out[0]), fmax(fabs(out[1]), fabs(out[2])));
    if (!(largest > 0)) return cn_reader_fail(r, CN_FAULT_RANGE, node, "a direction must not be zero");
    for (int i = 0; i < 3; i++)
        out[i] /= largest; /* so that no square over- or underflows */
    cn_normalise(out);
    return CN_OK;
}

static cn_status read_box(reader_t *r, const cn_key *key, int node, double (*out)[3])
{
    if (r->tree.node[node].kind != CN_YAML_LIST || r->tree.node[node].count != 2)
        return cn_reader_expected(r, key, node);
    int i = 0;
    for (int child = r->tree.node[node].first; child >= 0; child = r->tree.node[child].next, i++) {
        const cn_status status = read_reals(r, key, child, 3, out[i]);
        if (status != CN_OK) return status;
    }
    for (i = 0; i < 3; i++)
        if (out[0][i] > out[1][i])
            return cn_reader_fail(r, CN_FAULT_AT_ODDS, node,
                                  "the lower corner's %c, %.10g, is above the upper one's, %.10g", "xyz"[i],
                                  out[0][i], out[1][i]);
    return CN_OK;
}

static cn_status read_many(reader_t *r, const cn_key *key, int node, double **out, int *count)
{
    const cn_yaml_node *n = &r->tree.node[node];
    const bool points = key->type == CN_KEY_POINTS, one = !points && n->kind == CN_YAML_SCALAR;
    if (n->kind != CN_YAML_LIST && !one) return cn_reader_expected(r, key, node);
    const int number = one ? 1 : n->count, width = points ? 3 : 1;
    if (number < (points ? key->low : 1))
        return cn_reader_fail(r, CN_FAULT_COUNT, node, "the list is too short");
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

static cn_status read_control(reader_t *r, const cn_key *key, int node, cn_drive_spec *drive)
{
    const cn_yaml_node *n = &r->tree.node[node];
    if (n->kind == CN_YAML_SCALAR) {
        drive->control_all = !strcmp(cn_yaml_text(&r->tree, node), "all");
        return drive->control_all ? CN_OK : cn_reader_expected(r, key, node);
    }
    if (n->count == 0) return cn_reader_fail(r, CN_FAULT_COUNT, node, "the list of driven nodes is empty");
    if (!(drive->control = calloc((size_t)n->count, sizeof *drive->control))) return CN_ERR_MEMORY;
    drive->ncontrol = n->count;
    int i = 0;
    for (int child = n->first; child >= 0; child = r->tree.node[child].next, i++) {
        double value;
        if (!parse_number(r, child, true, &value) || !(value >= 0 && value <= INT_MAX))
            return cn_reader_fail(r, CN_FAULT_RANGE, child, "expected a node index >= 0");
        drive->control[i] = (int)value;
    }
    return CN_OK;
}

cn_status cn_reader_value(reader_t *r, const cn_key *key, int node, void *base)
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
        if (!parse_number(r, node, true, &value) || !in_range(key, value))
            return cn_reader_expected(r, key, node);
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
        return ((double *)field)[0] < ((double *)field)[1] ? CN_OK : cn_reader_expected(r, key, node);
    case CN_KEY_BOX:
        return read_box(r, key, node, field);
    case CN_KEY_REALS:
    case CN_KEY_POINTS:
        return read_many(r, key, node, field, (int *)((char *)base + key->count));
    case CN_KEY_CONTROL:
        return read_control(r, key, node, field);
    default:
        return CN_ERR_ARG;
    }
}
