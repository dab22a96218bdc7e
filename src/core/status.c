#include "catnav/status.h"

#include <stdarg.h>
#include <stdio.h>

const char *cn_status_text(int status)
{
#define CN_STATUS_TEXT(name, text) text,
    static const char *const texts[] = {CN_STATUS_LIST(CN_STATUS_TEXT)};
    return status >= 0 && status < CN_STATUS_COUNT ? texts[status] : "unknown status";
}

cn_status cn_fail(cn_error *error, cn_status status, const char *file, int line, const char *format, ...)
{
    if (!error || error->status != CN_OK) return status;
    error->status = status;
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
