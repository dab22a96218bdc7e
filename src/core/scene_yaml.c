#include "scene_yaml.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

void cn_yaml_clear(cn_yaml *tree)
{
    free(tree->node);
    free(tree->text);
    memset(tree, 0, sizeof *tree);
}

static int add_text(cn_yaml *tree, size_t length, const char *text) /* offset, -1: out of memory */
{
    if (length >= (size_t)(INT_MAX - tree->ntext) / 2) return -1;
    const int need = tree->ntext + (int)length + 1;
    if (need > tree->text_capacity) {
        char *grown = realloc(tree->text, 2 * (size_t)need);
        if (!grown) return -1;
        tree->text = grown;
        tree->text_capacity = 2 * need;
    }
    char *end = tree->text + tree->ntext;
    if (length) memcpy(end, text, length);
    end[length] = 0;
    tree->ntext = need;
    return need - (int)length - 1;
}

static int add_node(cn_yaml *tree, cn_yaml_kind kind, int line, int setting) /* index, -1: out of memory */
{
    if (tree->nnode == tree->node_capacity) {
        const int capacity = tree->node_capacity ? 2 * tree->node_capacity : 256;
        cn_yaml_node *grown = realloc(tree->node, (size_t)capacity * sizeof *grown);
        if (!grown) return -1;
        tree->node = grown;
        tree->node_capacity = capacity;
    }
    tree->node[tree->nnode] = (cn_yaml_node){.kind = kind, .line = line, .setting = setting, .key = -1};
    cn_yaml_node *node = &tree->node[tree->nnode];
    node->first = node->last = node->next = -1;
    return tree->nnode++;
}

static void add_child(cn_yaml *tree, int parent, int child)
{
    cn_yaml_node *p = &tree->node[parent];
    if (p->first < 0)
        p->first = child;
    else
        tree->node[p->last].next = child;
    p->last = child;
    p->count++;
}

int cn_yaml_find(const cn_yaml *tree, int map, const char *key)
{
    if (tree->node[map].kind != CN_YAML_MAP) return -1;
    for (int i = tree->node[map].first; i >= 0; i = tree->node[i].next)
        if (!strcmp(cn_yaml_key(tree, i), key)) return i;
    return -1;
}

/* What is being built: the open maps and lists, and the key that waits for its value. */
typedef struct {
    cn_yaml *tree;
    const char *file;
    int setting, line; /* line of a setting's nodes */
    int depth, open[CN_YAML_DEPTH];
    int key, key_line; /* -1: none waits */
    int root;
    cn_error *error;
} builder;

static cn_status refuse(const builder *b, int fault, int line, const char *what)
{
    return cn_fail(b->error, fault, b->file, b->setting < 0 ? line : 0, "%s", what);
}

/* Takes a scalar, or opens a map or list. */
static cn_status take(builder *b, cn_yaml_kind kind, int line, size_t length, const char *text, bool plain)
{
    cn_yaml *tree = b->tree;
    const int parent = b->depth ? b->open[b->depth - 1] : -1;
    const bool in_map = parent >= 0 && tree->node[parent].kind == CN_YAML_MAP;

    if (in_map && b->key < 0) { /* a key comes first */
        if (kind != CN_YAML_SCALAR)
            return refuse(b, CN_FAULT_SYNTAX, line, "a key must be a word, not a list or a map");
        if (memchr(text, 0, length)) return refuse(b, CN_FAULT_SYNTAX, line, "a key holds a zero byte");
        if ((b->key = add_text(tree, length, text)) < 0) return CN_ERR_MEMORY;
        b->key_line = line;
        return CN_OK;
    }
    if (kind != CN_YAML_SCALAR && b->depth == CN_YAML_DEPTH)
        return refuse(b, CN_FAULT_TOO_MANY, line, "lists and maps are nested deeper than 32 levels");
    const int at = b->setting >= 0 ? b->line : in_map ? b->key_line : line;
    const int node = add_node(tree, kind, at, b->setting);
    if (node < 0) return CN_ERR_MEMORY;
    if (kind == CN_YAML_SCALAR) {
        const int offset = add_text(tree, length, text);
        if (offset < 0) return CN_ERR_MEMORY;
        tree->node[node].text = offset;
        tree->node[node].length = (int)length;
        tree->node[node].plain = plain;
    } else
        b->open[b->depth++] = node;
    if (in_map) {
        tree->node[node].key = b->key;
        b->key = -1;
    }
    if (parent >= 0)
        add_child(tree, parent, node);
    else
        b->root = node;
    return CN_OK;
}

static cn_status take_event(builder *b, const yaml_event_t *event, bool *end)
{
    const int line = (int)event->start_mark.line + 1;
    switch (event->type) {
    case YAML_STREAM_END_EVENT:
        *end = true;
        return CN_OK;
    case YAML_DOCUMENT_START_EVENT:
        return b->root >= 0 ? refuse(b, CN_FAULT_UNREAD, line,
                                     "a second document begins here; a scene is one document")
                            : CN_OK;
    case YAML_ALIAS_EVENT:
        return refuse(b, CN_FAULT_UNREAD, line, "aliases are not used here: write the value out");
    case YAML_SCALAR_EVENT:
        if (event->data.scalar.anchor) return refuse(b, CN_FAULT_UNREAD, line, "anchors are not used here");
        if (event->data.scalar.tag) return refuse(b, CN_FAULT_UNREAD, line, "tags are not used here");
        return take(b, CN_YAML_SCALAR, line, event->data.scalar.length,
                    (const char *)event->data.scalar.value,
                    event->data.scalar.style == YAML_PLAIN_SCALAR_STYLE);
    case YAML_SEQUENCE_START_EVENT:
        if (event->data.sequence_start.anchor)
            return refuse(b, CN_FAULT_UNREAD, line, "anchors are not used here");
        if (event->data.sequence_start.tag) return refuse(b, CN_FAULT_UNREAD, line, "tags are not used here");
        return take(b, CN_YAML_LIST, line, 0, "", false);
    case YAML_MAPPING_START_EVENT:
        if (event->data.mapping_start.anchor)
            return refuse(b, CN_FAULT_UNREAD, line, "anchors are not used here");
        if (event->data.mapping_start.tag) return refuse(b, CN_FAULT_UNREAD, line, "tags are not used here");
        return take(b, CN_YAML_MAP, line, 0, "", false);
    case YAML_SEQUENCE_END_EVENT:
    case YAML_MAPPING_END_EVENT:
        b->depth--;
        return CN_OK;
    default:
        return CN_OK;
    }
}

/* libyaml's own refusal; where it read no token yet, the line is counted up to the offset of the bad byte. */
static cn_status refuse_syntax(const builder *b, const yaml_parser_t *parser, size_t length, const char *text)
{
    if (parser->error == YAML_MEMORY_ERROR) return CN_ERR_MEMORY;
    size_t line = parser->problem_mark.line + 1;
    if (parser->error == YAML_READER_ERROR) {
        line = 1;
        for (size_t i = 0; i < length && i < parser->problem_offset; i++)
            line += text[i] == '\n';
    }
    return cn_fail(b->error, CN_FAULT_SYNTAX, b->file, b->setting < 0 ? (int)line : 0,
                   "not readable as YAML: %s%s%s", parser->problem ? parser->problem : "malformed",
                   parser->context ? ", " : "", parser->context ? parser->context : "");
}

cn_status cn_yaml_read(cn_yaml *tree, size_t length, const char *text, const char *file, int setting,
                       int line, int *root, cn_error *error)
{
    builder b = {
        .tree = tree, .file = file, .setting = setting, .line = line, .key = -1, .root = -1, .error = error};
    yaml_parser_t parser;
    cn_status status = CN_OK;
    bool end = false;

    *root = -1;
    if (!yaml_parser_initialize(&parser)) return CN_ERR_MEMORY;
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, length);
    while (status == CN_OK && !end) {
        yaml_event_t event;
        if (!yaml_parser_parse(&parser, &event)) {
            status = refuse_syntax(&b, &parser, length, text);
            break;
        }
        status = take_event(&b, &event, &end);
        yaml_event_delete(&event);
    }
    yaml_parser_delete(&parser);
    if (status == CN_OK && b.root < 0) status = take(&b, CN_YAML_SCALAR, 1, 0, "", true);
    *root = b.root;
    return status;
}

/* The entry a word of a setting's key names in a list: by index, else by its `name`. */
static int list_entry(const cn_yaml *tree, int list, const char *word)
{
    const int count = tree->node[list].count;
    int index = 0, digits = 0;
    for (; word[digits] >= '0' && word[digits] <= '9' && digits < 9; digits++)
        index = 10 * index + word[digits] - '0';
    const bool by_index = digits > 0 && !word[digits];
    if (by_index && index >= count) return -1;
    int i = tree->node[list].first;
    if (by_index) {
        while (index--)
            i = tree->node[i].next;
        return i;
    }
    for (; i >= 0; i = tree->node[i].next) {
        const int name = cn_yaml_find(tree, i, "name");
        if (name >= 0 && tree->node[name].kind == CN_YAML_SCALAR && !strcmp(cn_yaml_text(tree, name), word))
            return i;
    }
    return -1;
}

/* Overwrites what node `at` holds by what node `from` holds; key and place stay. */
static void replace(cn_yaml *tree, int at, int from)
{
    const cn_yaml_node old = tree->node[at];
    tree->node[at] = tree->node[from];
    tree->node[at].key = old.key;
    tree->node[at].next = old.next;
    tree->node[at].line = old.line;
}

static int depth_below(const cn_yaml *tree, int node) /* at most CN_YAML_DEPTH: bounded where it was read */
{
    int deepest = 0;
    for (int i = tree->node[node].first; i >= 0; i = tree->node[i].next) {
        const int d = tree->node[i].kind == CN_YAML_SCALAR ? 0 : depth_below(tree, i);
        if (d > deepest) deepest = d;
    }
    return tree->node[node].kind == CN_YAML_SCALAR ? 0 : deepest + 1;
}

cn_status cn_yaml_set(cn_yaml *tree, int root, int isetting, const cn_setting *setting, const char *file,
                      cn_error *error)
{
    int value, at = root, depth = 1;
    char word[128];
    const char *rest = setting->key;
    cn_error inner = {0};
    cn_status status =
        cn_yaml_read(tree, strlen(setting->value), setting->value, file, isetting, 0, &value, &inner);

    if (status == CN_ERR_MEMORY) return status;
    if (status != CN_OK)
        return cn_fail(error, inner.fault, file, 0, "setting %.100s=%.100s: %.280s", setting->key,
                       setting->value, inner.message);
    for (;; depth++) {
        const size_t length = strcspn(rest, ".");
        if (length == 0 || length >= sizeof word || depth > CN_YAML_DEPTH)
            return cn_fail(error, CN_FAULT_SYNTAX, file, 0,
                           "setting %.200s: expected a key path such as bodies.0.model", setting->key);
        memcpy(word, rest, length);
        word[length] = 0;
        int child;
        if (tree->node[at].kind == CN_YAML_LIST) {
            if ((child = list_entry(tree, at, word)) < 0)
                return cn_fail(
                    error, CN_FAULT_INDEX, file, 0,
                    "setting %.200s: no entry \"%s\" in a list of %d; name one by index (from 0) or by "
                    "its name",
                    setting->key, word, tree->node[at].count);
        } else if (tree->node[at].kind == CN_YAML_MAP) {
            if ((child = cn_yaml_find(tree, at, word)) < 0) {
                const int key = add_text(tree, length, word);
                if (key < 0 || (child = add_node(tree, CN_YAML_MAP, 0, isetting)) < 0) return CN_ERR_MEMORY;
                tree->node[child].key = key;
                add_child(tree, at, child);
            }
        } else
            return cn_fail(error, CN_FAULT_TYPE, file, 0,
                           "setting %.200s: what stands before \"%s\" is a plain value", setting->key, word);
        at = child;
        if (!rest[length]) break;
        rest += length + 1;
    }
    if (depth + depth_below(tree, value) > CN_YAML_DEPTH)
        return cn_fail(error, CN_FAULT_TOO_MANY, file, 0, "setting %.200s: nested deeper than 32 levels",
                       setting->key);
    replace(tree, at, value);
    return CN_OK;
}
