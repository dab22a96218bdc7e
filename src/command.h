/* command.h - what the subcommands of `catnav` share: options, sentences, cancelling. */
#ifndef CN_COMMAND_H
#define CN_COMMAND_H

#include <signal.h>
#include <stdbool.h>
#include "catnav/report.h"
#include "catnav/scene.h"

enum { COMMAND_OK = 0, COMMAND_REFUSED = 1, COMMAND_FAILED = 4 };

/* A subcommand: its words follow its own name in argv. `help` is its page. */
typedef struct {
    const char *name, *summary, *help;
    int (*run)(int argc, char **argv);
} command_t;
int command_study_skin(int argc, char **argv); /* a part of `study` */
extern const command_t command_run, command_plan, command_check, command_study;

typedef enum { OPTION_FLAG, OPTION_TEXT, OPTION_COUNT, OPTION_POSITIVE, OPTION_SETTING } option_type;
typedef struct {
    const char *name; /* with its dashes; NULL ends the list */
    option_type type;
    void *value; /* bool, const char *, int >= 1, double > 0, settings_t */
} option_t;

#define MOST_SETTINGS 256
typedef struct {
    int n;
    cn_setting setting[MOST_SETTINGS];
} settings_t;

/* Fills the options' values and *operand (its one word, named `what` in sentences). Both --name value and
 * --name=value are read; settings are cut in place at their first =. False: the sentence is printed. */
bool command_options(const command_t *command, int argc, char **argv, const option_t *options,
                     const char *what, const char **operand);
void command_print_error(const cn_error *error); /* FILE:LINE: sentence, on stderr */
void command_print_warnings(void);               /* the library's, on stderr, from now on */
enum { MOST_THREADS = 64 };                      /* what --threads takes in every subcommand */
int command_threads(void);                       /* as many as there are cores */

/* SIGINT and SIGTERM set this flag, which a run looks at in every step and a plan at its end; a second signal
 * ends the process at once. */
extern volatile sig_atomic_t command_cancel;
void command_catch_signals(void);

/* True when PATH can be written: asked before a long run, not after it. */
bool command_can_write(const char *path);
/* Writes the report where `path` is not NULL; returns the exit status of its verdict, or FAILED where the
 * report cannot be written. */
int command_finish(const cn_report *report, const char *path);

#endif
