/* all_keys.yaml from the schema: a readable scene that holds every key with its comment. Where keys exclude
 * each other, a list has one entry for each of them: entry v shows alternative v, and from the second on only
 * what is required or differs. */
#include "output.h"
#include "scene_schema.h"

#include <stdlib.h>
#include <string.h>

#define COMMENT_COLUMN 48

static int alternatives(const cn_schema *schema);

static int key_alternatives(const cn_key *key)
{
    if (key->type == CN_KEY_MAP) return alternatives(key->map);
    return key->type == CN_KEY_CONTROL ? 3 : 1;
}

static int group_alternatives(const cn_schema *schema, char group)
{
    int n = 0;
    for (const cn_key *key = schema->keys; key->name; key++)
        if (key->group == group) n += key_alternatives(key);
    return n;
}

static int alternatives(const cn_schema *schema)
{
    int most = 1;
    for (const cn_key *key = schema->keys; key->name; key++) {
        const int n = key->group ? group_alternatives(schema, key->group) : key_alternatives(key);
        if (n > most) most = n;
    }
    return most;
}

/* Which alternative of this key entry v shows, -1: the key is not in it. */
static int shown_as(const cn_schema *schema, const cn_key *key, int v)
{
    const int own = key_alternatives(key);
    if (key->group) {
        int before = 0;
        for (const cn_key *other = schema->keys; other != key; other++)
            if (other->group == key->group) before += key_alternatives(other);
        return v >= before && v < before + own ? v - before : -1;
    }
    return v < own ? v : key->flags & CN_REQUIRED ? 0 : -1;
}

static void write_comment(FILE *file, int column, const cn_key *key)
{
    char expected[160];
    const bool value = key->type != CN_KEY_MAP && key->type != CN_KEY_LIST;
    fprintf(file, "%*s# %s", column < COMMENT_COLUMN ? COMMENT_COLUMN - column : 1, "", key->meaning);
    if (value) fprintf(file, "; %s", cn_key_expected(key, sizeof expected, expected));
    if (key->flags & CN_REQUIRED)
        fprintf(file, "; required");
    else if (value && !(key->flags & CN_UNSET))
        fprintf(file, "; default %s", key->value);
    else if (key->group && key->flags & CN_UNSET)
        fprintf(file, "; one of its alternatives");
    else if (key->flags & CN_UNSET || key->type == CN_KEY_LIST)
        fprintf(file, "; may be left out");
    fputc('\n', file);
}

static void write_map(FILE *file, const cn_schema *schema, int v, int indent, bool in_list, bool brief);

static void write_value(FILE *file, const cn_key *key, int v, int indent, int column, int copy, bool brief)
{
    switch (key->type) {
    case CN_KEY_MAP:
        write_comment(file, column, key);
        write_map(file, key->map, v, indent + 2, false, brief);
        break;
    case CN_KEY_LIST:
        write_comment(file, column, key);
        for (int i = 0; i < alternatives(key->map); i++)
            write_map(file, key->map, i, indent + 2, true, i > 0);
        break;
    case CN_KEY_CONTROL:
        if (v == 1) column += fprintf(file, " [0, 1, 2]");
        if (v == 0) column += fprintf(file, " %s", key->value);
        write_comment(file, column, key);
        if (v == 2) write_map(file, key->map, 0, indent + 2, false, brief);
        break;
    default:
        column += fprintf(file, " %s", key->value);
        if (key->flags & CN_NUMBERED && copy > 0) column += fprintf(file, "_%d", copy + 1);
        write_comment(file, column, key);
    }
}

/* The keys of alternative v; `brief`: only those that are required or differ from the first entry. */
static void write_map(FILE *file, const cn_schema *schema, int v, int indent, bool in_list, bool brief)
{
    bool first = in_list;
    for (const cn_key *key = schema->keys; key->name; key++) {
        const int as = shown_as(schema, key, v);
        const bool plain = !key->group && key_alternatives(key) == 1;
        if (as < 0 || (brief && plain && !(key->flags & CN_REQUIRED))) continue;
        if (brief && key->group && v == 0 && !(key->flags & (CN_REQUIRED | CN_NEEDED))) continue;
        const int column =
            fprintf(file, "%*s%s%s:", first ? indent - 2 : indent, "", first ? "- " : "", key->name);
        first = false;
        /* what a chosen alternative holds is new, so shown in full */
        write_value(file, key, as, indent, column, v, brief && !(key->group && as == 0 && v > 0));
    }
}

cn_status cn_scene_write_keys(const char *path, cn_error *error)
{
    cn_output output;
    const cn_status status = cn_output_open(&output, path, error);
    if (status != CN_OK) return status;
    fputs("# Every key of a scene, each with its meaning, what it takes, and its default or an example.\n"
          "# SI units; angles in radians unless the key ends in _deg. Files are looked for from this file's "
          "folder.\n"
          "# Keys with a default may be left out. Where keys exclude each other, a list shows one entry for "
          "each.\n"
          "# This file is generated from the reader's own table, and is itself a scene that can be read.\n",
          output.file);
    write_map(output.file, &cn_scene_schema, 0, 0, false, false);
    return cn_output_commit(&output, error);
}
