/* status.h - "could it be computed?" (cn_status) with the sentence a user can act on (cn_error),
 * and the one sink that messages go to. The core never prints, exits or asserts on input. */
#ifndef CN_STATUS_H
#define CN_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

#define CN_STATUS_LIST(X)                                                                                    \
    X(CN_OK, "ok")                                                                                           \
    X(CN_ERR_ARG, "argument out of range")                                                                   \
    X(CN_ERR_MEMORY, "out of memory")                                                                        \
    X(CN_ERR_FILE, "file cannot be read or written")                                                         \
    X(CN_ERR_PARSE, "file is malformed")                                                                     \
    X(CN_ERR_SCENE, "scene is contradictory")                                                                \
    X(CN_ERR_MESH, "mesh is unusable")                                                                       \
    X(CN_ERR_MESHER, "tetrahedral mesher failed")                                                            \
    X(CN_ERR_SINGULAR, "stiffness not positive definite")                                                    \
    X(CN_ERR_NOT_FINITE, "non-finite number")                                                                \
    X(CN_ERR_CONVERGENCE, "iteration did not converge")                                                      \
    X(CN_ERR_CONTACT, "contact list is full")                                                                \
    X(CN_ERR_NOT_FREE, "no state free of the walls was found")                                               \
    X(CN_ERR_NO_PATH, "no path")                                                                             \
    X(CN_ERR_TIMEOUT, "time budget used up")                                                                 \
    X(CN_ERR_CANCELLED, "cancelled")
#define CN_STATUS_ENUM(name, text) name,
typedef enum { CN_STATUS_LIST(CN_STATUS_ENUM) CN_STATUS_COUNT } cn_status;
const char *cn_status_text(int status); /* never NULL, defined for every int */

/* What exactly is wrong with an input, for callers that branch on it: status, number below 100, name,
 * meaning. A fault's value is 100 times its status plus its number; a status told no closer is the fault 100
 * times it. Values stay as they are: what is new is put at the end of its status. */
#define CN_FAULT_LIST(X)                                                                                     \
    X(CN_ERR_ARG, 1, VALUE, "a value of a request is out of its range, or not finite")                       \
    X(CN_ERR_ARG, 2, TOO_FEW, "a request with fewer waypoints than a path needs")                            \
    X(CN_ERR_ARG, 3, PLACE, "a point lies outside the free space")                                           \
    X(CN_ERR_ARG, 4, OUTSIDE, "a file lies outside the folders that a request may name")                     \
    X(CN_ERR_ARG, 5, OPTION, "a word of a request that is none of those to choose from")                     \
    X(CN_ERR_FILE, 1, MISSING_FILE, "there is no such file or folder")                                       \
    X(CN_ERR_FILE, 2, NO_FILE, "it is a folder or a device where a file is needed, or the other way round")  \
    X(CN_ERR_FILE, 3, ACCESS, "it may not be read or written, or that broke off")                            \
    X(CN_ERR_FILE, 4, LARGE, "the file is larger than any that is read")                                     \
    X(CN_ERR_FILE, 5, LOCKED, "another run writes there")                                                    \
    X(CN_ERR_PARSE, 1, EMPTY, "the file has no bytes")                                                       \
    X(CN_ERR_PARSE, 2, FORMAT, "the file's format, or its version, is not read")                             \
    X(CN_ERR_PARSE, 3, SYNTAX, "not built as its format asks: a bracket left open, bytes that are no text")  \
    X(CN_ERR_PARSE, 4, CUT_SHORT, "the file ends before what it announces")                                  \
    X(CN_ERR_PARSE, 5, COUNT, "more or fewer values than belong there")                                      \
    X(CN_ERR_PARSE, 6, WORD, "a word that does not belong there")                                            \
    X(CN_ERR_PARSE, 7, KEY, "a key that no scene has")                                                       \
    X(CN_ERR_PARSE, 8, MISSING, "a key, section or value that is needed is not there")                       \
    X(CN_ERR_PARSE, 9, TWICE, "a key, section or number is given twice")                                     \
    X(CN_ERR_PARSE, 10, ORDER, "it stands before what it needs")                                             \
    X(CN_ERR_PARSE, 11, TYPE, "of another type: a word for a number, a fraction for a whole number, a list") \
    X(CN_ERR_PARSE, 12, CHOICE, "a word that is none of those to choose from")                               \
    X(CN_ERR_PARSE, 13, RANGE, "a number out of its range")                                                  \
    X(CN_ERR_PARSE, 14, NUMBER, "nan, inf, or more than a number holds")                                     \
    X(CN_ERR_PARSE, 15, INDEX, "it names a vertex, node or entry that is not there")                         \
    X(CN_ERR_PARSE, 16, UNREAD, "of a kind that is not read: strips, weights, elements of higher order")     \
    X(CN_ERR_PARSE, 17, TOO_MANY, "more than are ever taken: levels, elements, molecules")                   \
    X(CN_ERR_PARSE, 18, NO_MESH, "the file is well formed, and holds nothing of what is needed")             \
    X(CN_ERR_SCENE, 1, EXCLUSIVE, "two keys that exclude each other")                                        \
    X(CN_ERR_SCENE, 2, AT_ODDS, "two values that contradict each other")                                     \
    X(CN_ERR_SCENE, 3, NEEDED, "a key that another one's value needs is not there")                          \
    X(CN_ERR_SCENE, 4, NAME, "a name that is another's, or no line of text")                                 \
    X(CN_ERR_SCENE, 5, UNNAMED, "a name, or a node's number, that the scene does not have")                  \
    X(CN_ERR_SCENE, 6, UNSUITED, "a method or shape that is not made for what it is asked for")              \
    X(CN_ERR_SCENE, 7, NOTHING, "a box or selection that holds nothing")                                     \
    X(CN_ERR_SCENE, 8, TOO_LARGE, "what it describes does not fit into memory")                              \
    X(CN_ERR_MESH, 1, NO_PARTS, "it has no vertices, triangles or tetrahedra")                               \
    X(CN_ERR_MESH, 2, NO_VERTEX, "a triangle or tetrahedron names a vertex that is not there")               \
    X(CN_ERR_MESH, 3, DEGENERATE, "triangles without area, tetrahedra without volume")                       \
    X(CN_ERR_MESH, 4, OPEN, "a surface is open that must be closed")                                         \
    X(CN_ERR_MESH, 5, CROSSING, "a surface crosses itself")                                                  \
    X(CN_ERR_MESH, 6, NON_MANIFOLD, "more than two sheets or tetrahedra meet in an edge, vertex or face")    \
    X(CN_ERR_MESH, 7, TURNED, "parts of a surface face the other way, or it encloses no volume")             \
    X(CN_ERR_MESH, 8, DUPLICATE, "a triangle or tetrahedron stands twice")                                   \
    X(CN_ERR_MESH, 9, UNUSED, "a node belongs to nothing")                                                   \
    X(CN_ERR_MESH, 10, UNIT, "its size does not go with the device's: another unit")                         \
    X(CN_ERR_MESH, 11, APART, "its parts do not hold together")                                              \
    X(CN_ERR_MESH, 12, OVERLAP, "its parts lie in one place")
#define CN_FAULT_ENUM(status, number, name, text) CN_FAULT_##name = 100 * (status) + (number),
typedef enum { CN_FAULT_NONE = 0, CN_FAULT_LIST(CN_FAULT_ENUM) } cn_fault;
/* "CUT_SHORT" ...; "MESH" ... of a status told no closer; "" of 0 and of no fault; never NULL */
const char *cn_fault_name(int fault);
int cn_fault_file(int cause);          /* of an errno that a file was refused with */
int cn_fault_number(const char *text); /* NUMBER of nan, inf and what overflows, TYPE of anything else */

/* What went wrong, where, and what to do. Zero-initialise; the first failure fills it. */
typedef struct {
    cn_status status;
    int fault;         /* a cn_fault, or 100 * status where it is told no closer */
    char file[256];    /* file concerned, "" if none */
    int line;          /* 1-based line, 0 if none (binary files: the sentence names the byte offset) */
    char message[512]; /* one sentence: place, value, what to do */
} cn_error;

/* Fills *error (NULL is fine) printf-like and returns the status, so that a caller can
 * `return cn_fail(error, CN_FAULT_OPEN, file, line, "...")`. code: a cn_fault, or a cn_status that is told no
 * closer. Keeps the first error if already set. */
cn_status cn_fail(cn_error *error, int code, const char *file, int line, const char *format, ...)
#ifdef __GNUC__
    __attribute__((format(printf, 5, 6)))
#endif
    ;

typedef enum { CN_LOG_DEBUG, CN_LOG_INFO, CN_LOG_WARNING, CN_LOG_ERROR } cn_log_level;
typedef void (*cn_log_sink)(void *user, cn_log_level level, const char *file, int line, const char *text);
void cn_log_set_sink(cn_log_sink sink, void *user); /* NULL: messages are dropped (the default) */
void cn_log_write(cn_log_level level, const char *file, int line, const char *format, ...)
#ifdef __GNUC__
    __attribute__((format(printf, 4, 5)))
#endif
    ;
#define CN_LOG(level, ...) cn_log_write(level, __FILE__, __LINE__, __VA_ARGS__)

#ifdef __cplusplus
}
#endif
#endif
