#include "command.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

_Static_assert(MOST_THREADS == 64, "the refusal of --threads names it");
volatile sig_atomic_t command_cancel;

/* A second signal of either kind then ends the process at once. */
static void cancel(int signal_number)
{
    (void)signal_number;
    command_cancel = 1;
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
}

void command_catch_signals(void)
{
    struct sigaction action = {.sa_handler = cancel};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

int command_threads(void)
{
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    return cores < 1 ? 1 : cores > MOST_THREADS ? MOST_THREADS : (int)cores;
}

/* One line, whatever stands in a name or setting that it quotes. */
static void print_line(const char *text)
{
    for (; *text; text++)
        fputc((unsigned char)*text < ' ' || *text == 127 ? '?' : *text, stderr);
}

void command_print_error(const cn_error *error)
{
    if (*error->file) {
        print_line(error->file);
        fputc(':', stderr);
        if (error->line > 0) fprintf(stderr, "%d:", error->line);
        fputc(' ', stderr);
    }
    print_line(*error->message ? error->message : cn_status_text(error->status));
    fputc('\n', stderr);
}

static void print_warning(void *user, cn_log_level level, const char *file, int line, const char *text)
{
    (void)user, (void)file, (void)line;
    if (level < CN_LOG_WARNING) return;
    fputs("warning: ", stderr);
    print_line(text);
    fputc('\n', stderr);
}

void command_print_warnings(void)
{
    cn_log_set_sink(print_warning, NULL);
}

static bool refuse(const command_t *command, const char *sentence, const char *word)
{
    fprintf(stderr, "catnav %s: %s \"%s\"; see catnav %s --help\n", command->name, sentence, word,
            command->name);
    return false;
}

static bool take_value(const command_t *command, const option_t *option, char *text)
{
    char *end = text;
    switch (option->type) {
    case OPTION_FLAG:
        break;
    case OPTION_TEXT:
        if (!*text) return refuse(command, "nothing is given for", option->name);
        *(const char **)option->value = text;
        break;
    case OPTION_COUNT: {
        const bool threads = !strcmp(option->name, "--threads");
        errno = 0;
        const long value = strtol(text, &end, 10);
        if (end == text || *end || errno || value < 1 || value > (threads ? MOST_THREADS : 1000000000))
            return refuse(command,
                          threads ? "--threads takes a whole number from 1 to 64, not"
                                  : "a whole number >= 1 is needed, not",
                          text);
        *(int *)option->value = (int)value;
        break;
    }
    case OPTION_POSITIVE: {
        const double value = strtod(text, &end);
        if (end == text || *end || !(value > 0 && value < HUGE_VAL))
            return refuse(command, "a number > 0 is needed, not", text);
        *(double *)option->value = value;
        break;
    }
    case OPTION_SETTING: {
        settings_t *settings = option->value;
        char *equals = strchr(text, '=');
        if (!equals || equals == text) return refuse(command, "a setting is key.path=value, not", text);
        if (settings->n == MOST_SETTINGS) return refuse(command, "too many settings, at", text);
        *equals = 0;
        settings->setting[settings->n++] = (cn_setting){text, equals + 1};
        break;
    }
    }
    return true;
}

bool command_options(const command_t *command, int argc, char **argv, const option_t *options,
                     const char *what, const char **operand)
{
    bool only_words = false; /* after -- */
    *operand = NULL;
    for (int i = 0; i < argc; i++) {
        char *word = argv[i];
        if (only_words || word[0] != '-' || !word[1]) {
            if (*operand) return refuse(command, "one word too many:", word);
            *operand = word;
            continue;
        }
        if ((only_words = !strcmp(word, "--"))) continue;
        const option_t *option = options;
        const size_t length = strcspn(word, "=");
        while (option->name && (strlen(option->name) != length || memcmp(option->name, word, length)))
            option++;
        if (!option->name) return refuse(command, "unknown option", word);
        char *value = word[length] ? word + length + 1 : NULL;
        if (option->type == OPTION_FLAG) {
            if (value) return refuse(command, "no value is taken by", option->name);
            *(bool *)option->value = true;
            continue;
        }
        if (!value && ++i == argc) return refuse(command, "nothing is given for", option->name);
        if (!take_value(command, option, value ? value : argv[i])) return false;
    }
    return *operand ? true : refuse(command, "what is missing is", what);
}

bool command_can_write(const char *path)
{
    const bool there = access(path, F_OK) == 0;
    FILE *file = fopen(path, "ab");
    if (!file) {
        fprintf(stderr, "%s: cannot be written: %s\n", path, strerror(errno));
        return false;
    }
    fclose(file);
    if (!there) unlink(path);
    return true;
}

int command_finish(const cn_report *report, const char *path)
{
    cn_error error = {0};
    if (path && cn_report_write(report, path, &error) != CN_OK) {
        command_print_error(&error);
        return COMMAND_FAILED;
    }
    return cn_verdict_exit(report->verdict.code);
}
