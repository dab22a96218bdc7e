/* scene_reader.h - what is being read, and how it is refused: shared by scene_read.c, scene_value.c,
 * scene_check.c. `node` is always an index into the reader's tree; a refusal names its line, or its setting,
 * and the key path. */
#ifndef CN_SCENE_READER_H
#define CN_SCENE_READER_H

#include "scene_schema.h"
#include "scene_yaml.h"

struct cn_reader {
    const char *file;
    const cn_setting *setting;
    cn_error *error;
    cn_yaml tree;
    char where[256]; /* key path of what is being read */
};

/* Into a key and out of it again: _enter returns what _leave takes. */
size_t cn_reader_enter(struct cn_reader *reader, const char *name);
void cn_reader_leave(struct cn_reader *reader, size_t length);

cn_status cn_reader_fail(struct cn_reader *reader, int fault, int node, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
cn_status cn_reader_expected(struct cn_reader *reader, const cn_key *key,
                             int node); /* "expected X, found Y" */
/* A fault of CN_ERR_SCENE at `key` of the map (or at the map itself where it is not given). */
cn_status cn_reader_refuse(struct cn_reader *reader, int fault, int node, const char *key, const char *format,
                           ...) __attribute__((format(printf, 5, 6)));

/* A value that is neither map nor list of maps, into its field of the struct at `base`. */
cn_status cn_reader_value(struct cn_reader *reader, const cn_key *key, int node, void *base);

#endif
