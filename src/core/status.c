#include "catnav/status.h"

#include <stdarg.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *cn_status_text(int status)
{
#define CN_STATUS_TEXT(name, text) text,
    static const char *const texts[] = {CN_STATUS_LIST(CN_STATUS_TEXT)};
    return status >= 0 && status < CN_STATUS_COUNT ? texts[status] : "unknown status";
}

const char *cn_fault_name(int fault)
{
#define CN_FAULT_CASE(status, number, name, text)                                                            \
    case CN_FAULT_##name:                                                                                    \
        return #name;
#define CN_STATUS_CASE(name, text)                                                                           \
    case 100 * name:                                                                                         \
        return #name + (name == CN_OK ? strlen(#name) : strlen("CN_ERR_"));
    switch (fault) {
        CN_FAULT_LIST(CN_FAULT_CASE)
        CN_STATUS_LIST(CN_STATUS_CASE)
    }
    return "";
}

int cn_fault_file(int cause)
{
    return cause == ENOENT                       ? CN_FAULT_MISSING_FILE
           : cause == EISDIR || cause == ENOTDIR ? CN_FAULT_NO_FILE
                                                 : CN_FAULT_ACCESS;
}

int cn_fault_number(const char *text)
{
    char *end;
    const double value = strtod(text, &end);
    return end > text && !*end && !isfinite(value) ? CN_FAULT_NUMBER : CN_FAULT_TYPE;
}

cn_status cn_fail(cn_error *error, int code, const char *file, int line, const char *format, ...)
{
    const int fault = code < CN_STATUS_COUNT ? 100 * code : code;
    const cn_status status = (cn_status)(fault / 100);
    if (!error || error->status != CN_OK) return status;
    error->status = status;
    error->fault = fault;
    snprintf(error->file, sizeof error->file, "%s", file ? file : "");
    error->line = line;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->message, sizeof error->message, format, arguments);
    va_end(arguments);
    return status;
}

static cn_log_sink log_sink;
static void *log_user;

void cn_log_set_sink(cn_log_sink sink, void *user)
{
    log_sink = sink;
    log_user = user;
}

void cn_log_write(cn_log_level level, const char *file, int line, const char *format, ...)
{
    if (!log_sink) return;
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    log_sink(log_user, level, file, line, text);
}
