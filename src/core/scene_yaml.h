/* scene_yaml.h - a YAML document as a bounded tree with line numbers, made from libyaml's events.
 * Refused: aliases, anchors, tags, more than one document, nesting deeper than CN_YAML_DEPTH. */
#ifndef CN_SCENE_YAML_H
#define CN_SCENE_YAML_H

#include <stdbool.h>
#include <stddef.h>
#include "catnav/scene.h"

#define CN_YAML_DEPTH 32
#define CN_YAML_BYTES (16u << 20)

typedef enum { CN_YAML_SCALAR, CN_YAML_LIST, CN_YAML_MAP } cn_yaml_kind;

typedef struct {
    cn_yaml_kind kind;
    bool plain;       /* a scalar without quotes */
    int line;         /* of its key, or its own in a list; 1-based, 0 in a setting */
    int setting;      /* index of the setting it comes from, -1: the file */
    int key;          /* offset of its key in the tree's text, -1 in a list */
    int text, length; /* a scalar's text */
    int first, last;  /* children, -1: none */
    int next, count;  /* next sibling, -1: none; number of children */
} cn_yaml_node;

typedef struct {
    int nnode, node_capacity;
    cn_yaml_node *node;
    int ntext, text_capacity;
    char *text; /* zero-terminated keys and scalars */
} cn_yaml;

void cn_yaml_clear(cn_yaml *tree); /* frees what it owns, zeroes */

/* Appends the document in `text`; *root is its top node, an empty scalar for an empty document. `setting` >=
 * 0: the text is that setting's value, its nodes have `line`. */
cn_status cn_yaml_read(cn_yaml *tree, size_t length, const char *text, const char *file, int setting,
                       int line, int *root, cn_error *error);
/* Puts a setting's value at its key below `root`: into maps by key, into lists by index or by `name`. Missing
 * map entries are made; whether the schema knows them is for the schema to say. */
cn_status cn_yaml_set(cn_yaml *tree, int root, int isetting, const cn_setting *setting, const char *file,
                      cn_error *error);
/* Child with this key, -1 if there is none. */
int cn_yaml_find(const cn_yaml *tree, int map, const char *key);

static inline const char *cn_yaml_text(const cn_yaml *tree, int node)
{
    return tree->text + tree->node[node].text;
}
static inline const char *cn_yaml_key(const cn_yaml *tree, int node)
{
    return tree->node[node].key < 0 ? "" : tree->text + tree->node[node].key;
}

#endif
