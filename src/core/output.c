#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void close_all(cn_output *output)
{
    if (output->file) fclose(output->file);
    free(output->path);
    free(output->temporary);
    if (output->locale) {
        const locale_t c_locale = uselocale((locale_t)output->locale);
        freelocale(c_locale);
    }
    memset(output, 0, sizeof *output);
}

cn_status cn_output_open(cn_output *output, const char *path, cn_error *error)
{
    static const char suffix[] = ".000000.tmp";
    struct stat info;
    const bool direct = stat(path, &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
    int descriptor = -1;

    memset(output, 0, sizeof *output);
    if (!(output->path = strdup(path))) goto memory;
    if (direct)
        descriptor = open(path, O_WRONLY);
    else {
        if (!(output->temporary = malloc(strlen(path) + sizeof suffix))) goto memory;
        for (int i = 0; i < 100; i++) {
            snprintf(output->temporary, strlen(path) + sizeof suffix, "%s.%06d.tmp", path,
                     (int)((getpid() + i) % 1000000));
            descriptor = open(output->temporary, O_WRONLY | O_CREAT | O_EXCL, 0666);
            if (descriptor >= 0 || errno != EEXIST) break;
        }
    }
    if (descriptor < 0 || !(output->file = fdopen(descriptor, "wb"))) {
        const int cause = errno;
        if (descriptor >= 0) {
            close(descriptor);
            if (output->temporary) unlink(output->temporary);
        }
        close_all(output);
        return cn_fail(error, cn_fault_file(cause), path, 0, "cannot be written: %s", strerror(cause));
    }
    const locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (c_locale) output->locale = (void *)uselocale(c_locale);
    return CN_OK;
memory:
    close_all(output);
    return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory while it is written");
}

cn_status cn_output_commit(cn_output *output, cn_error *error)
{
    errno = 0;
    int failed = ferror(output->file) | fflush(output->file), cause = errno;
    if (fclose(output->file) && !failed) failed = 1, cause = errno;
    output->file = NULL;
    if (!failed && output->temporary && rename(output->temporary, output->path)) failed = 1, cause = errno;
    cn_status status = CN_OK;
    if (failed) {
        if (output->temporary) unlink(output->temporary);
        status = cn_fail(error, cn_fault_file(cause), output->path, 0, "cannot be written: %s",
                         cause ? strerror(cause) : "the disk may be full");
    }
    close_all(output);
    return status;
}

void cn_output_discard(cn_output *output)
{
    if (output->temporary) unlink(output->temporary);
    close_all(output);
}
