/* scene_schema.h - the table of every key a scene may hold. Reader, writer and memory all walk it: a key
 * stands here once, with type, default, range, unit, meaning and the field it fills. */
#ifndef CN_SCENE_SCHEMA_H
#define CN_SCENE_SCHEMA_H

#include <stddef.h>
#include "catnav/scene.h"

typedef enum {
    CN_KEY_TEXT,    /* char *: one line, not empty                                        */
    CN_KEY_FILE,    /* char *: name of a file that exists, against the scene's folder     */
    CN_KEY_REAL,    /* double                                                             */
    CN_KEY_ANGLE,   /* double [rad], written in degrees                                   */
    CN_KEY_COUNT,   /* int                                                                */
    CN_KEY_SEED,    /* unsigned                                                           */
    CN_KEY_CHOICE,  /* enum: one of `choices`, the first of which has the value `low`     */
    CN_KEY_FLAG,    /* bool: one of two `choices`, false first                            */
    CN_KEY_VECTOR,  /* double[3]                                                          */
    CN_KEY_UNIT,    /* double[3], made a unit vector; zero is refused                     */
    CN_KEY_COUNTS,  /* int[3]                                                             */
    CN_KEY_RANGE,   /* double[2], ascending                                               */
    CN_KEY_BOX,     /* double[2][3]: corners, lower first                                 */
    CN_KEY_REALS,   /* double *, int: one number or a list                                */
    CN_KEY_POINTS,  /* double *, int: list of points                                      */
    CN_KEY_CONTROL, /* of cn_drive_spec: `all`, node indices, or {box: ...}               */
    CN_KEY_MAP,     /* a part of the same struct                                          */
    CN_KEY_LIST     /* struct *, int: list of maps                                        */
} cn_key_type;

enum {
    CN_REQUIRED = 1,  /* must be given                                                        */
    CN_UNSET = 2,     /* may be left out and has no default: `value` is an example            */
    CN_MAY_AUTO = 4,  /* `auto` is NAN, -1 in a count                                         */
    CN_MAY_NULL = 8,  /* `null` is INFINITY                                                   */
    CN_ABOVE = 16,    /* `low` itself is out                                                  */
    CN_BELOW = 32,    /* `high` itself is out                                                 */
    CN_SHORT = 64,    /* a list stands for the map's first key                                */
    CN_NEEDED = 128,  /* one key of its group must be given                                   */
    CN_NUMBERED = 256 /* all_keys.yaml numbers the value: names are unique                   */
};

struct cn_reader;
typedef struct cn_schema {
    const struct cn_key *keys; /* ended by a key without name */
    /* refuses contradictions between keys, after all of them are read; NULL: none */
    cn_status (*check)(struct cn_reader *reader, int node, void *base);
} cn_schema;

typedef struct cn_key {
    const char *name;
    cn_key_type type;
    unsigned flags;
    const char *value; /* the default, as YAML; an example where there is none */
    double low, high;  /* range of a number, of each component, of a list's length; both 0: any */
    const char *unit, *meaning;
    size_t offset;        /* of the field in the map's struct */
    size_t count;         /* of the int that counts a list's entries */
    size_t size;          /* of one entry of a list of maps */
    const cn_schema *map; /* of MAP and LIST */
    const char *choices;  /* words, separated by | */
    char group;           /* keys of one group exclude each other; 0: none */
    size_t mark;          /* where the key, when given, leaves mark_value */
    size_t mark_size;     /* 1: bool, sizeof(int): enum or int, 0: nowhere */
    int mark_value;
} cn_key;

#define CN_BODY_MODELS "auto|tet4|tet10|rod|molecules"

extern const cn_schema cn_scene_schema; /* of cn_scene */

/* What a key takes, in words: "a number > 0 [m]". Writes at most `size` bytes and returns `text`. */
const char *cn_key_expected(const cn_key *key, size_t size, char *text);
/* Value of `word` in the key's choices, or INT_MIN. */
int cn_key_choice(const cn_key *key, const char *word);
void cn_schema_free(const cn_schema *schema, void *base); /* what the fields own */

/* --- scene_check.c: contradictions; `node` is the map, `base` what it has filled --- */
cn_status cn_check_catheter(struct cn_reader *reader, int node, void *base);
cn_status cn_check_beam(struct cn_reader *reader, int node, void *base);
cn_status cn_check_box(struct cn_reader *reader, int node, void *base);
cn_status cn_check_tube(struct cn_reader *reader, int node, void *base);
cn_status cn_check_wall(struct cn_reader *reader, int node, void *base);
cn_status cn_check_obstacle(struct cn_reader *reader, int node, void *base);
cn_status cn_check_limit(struct cn_reader *reader, int node, void *base);
cn_status cn_check_load(struct cn_reader *reader, int node, void *base);
cn_status cn_check_path(struct cn_reader *reader, int node, void *base);
cn_status cn_check_body(struct cn_reader *reader, int node, void *base);
cn_status cn_check_scene(struct cn_reader *reader, int node, void *base);

#endif
