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

/* What went wrong, where, and what to do. Zero-initialise; the first failure fills it. */
typedef struct {
    cn_status status;
    char file[256];    /* file concerned, "" if none */
    int line;          /* 1-based line, 0 if none (binary files: the sentence names the byte offset) */
    char message[512]; /* one sentence: place, value, what to do */
} cn_error;

/* Fills *error (NULL is fine) printf-like and returns status, so that a caller can
 * `return cn_fail(error, CN_ERR_MESH, file, line, "...")`. Keeps the first error if already set. */
cn_status cn_fail(cn_error *error, cn_status status, const char *file, int line, const char *format, ...)
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
