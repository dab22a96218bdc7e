/* frames.pvd with its pieces. The index is opened once; each frame is put before its tail by one write, so
 * that the file is whole at any time. */
#include "catnav/frames.h"
#include "frames_vtk.h"
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

struct cn_frames {
    char *folder;
    int pvd;   /* descriptor of frames.pvd */
    off_t end; /* where its tail begins */
};

static const char head[] = "<?xml version=\"1.0\"?>\n"
                           "<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>\n";
static const char tail[] = "</Collection>\n</VTKFile>\n";

static char *join(const char *folder, const char *name)
{
    const size_t n = strlen(folder), m = strlen(name);
    char *path = malloc(n + m + 2);
    if (path) {
        memcpy(path, folder, n);
        path[n] = '/';
        memcpy(path + n + 1, name, m + 1);
    }
    return path;
}

static cn_status out_of_memory(cn_error *error, const char *file)
{
    return cn_fail(error, CN_ERR_MEMORY, file, 0, "out of memory while frames are written");
}

/* Makes the folder and those above it. */
static cn_status make_folder(char *path, cn_error *error)
{
    struct stat info;
    for (char *c = path + 1;; c++) {
        const char here = *c;
        if (here && here != '/') continue;
        *c = 0;
        const int failed = mkdir(path, 0777) && errno != EEXIST, cause = errno;
        *c = here;
        if (failed && !here)
            return cn_fail(error, CN_ERR_FILE, path, 0, "the folder cannot be made: %s", strerror(cause));
        if (!here) break;
    }
    if (stat(path, &info) || !S_ISDIR(info.st_mode))
        return cn_fail(error, CN_ERR_FILE, path, 0, "frames go into a folder, and this is none");
    return CN_OK;
}

static cn_status write_all(int descriptor, const char *text, size_t length, off_t at)
{
    while (length > 0) {
        const ssize_t n = pwrite(descriptor, text, length, at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return CN_ERR_FILE;
        text += n, length -= (size_t)n, at += n;
    }
    return CN_OK;
}

cn_status cn_frames_open(cn_frames **out, const char *folder, cn_error *error)
{
    char *path = NULL;
    cn_output index;
    cn_status status;
    cn_frames *frames = calloc(1, sizeof *frames);

    *out = NULL;
    if (!frames) return out_of_memory(error, folder);
    frames->pvd = -1;
    if (!*folder) {
        status = cn_fail(error, CN_ERR_FILE, "", 0, "the frames' folder has no name");
        goto fail;
    }
    if (!(frames->folder = strdup(folder)) || !(path = join(folder, "frames.pvd"))) {
        status = out_of_memory(error, folder);
        goto fail;
    }
    if ((status = make_folder(frames->folder, error)) != CN_OK) goto fail;
    if ((status = cn_output_open(&index, path, error)) != CN_OK) goto fail;
    fprintf(index.file, "%s%s", head, tail);
    if ((status = cn_output_commit(&index, error)) != CN_OK) goto fail;
    if ((frames->pvd = open(path, O_WRONLY | O_CLOEXEC)) < 0) {
        status = cn_fail(error, CN_ERR_FILE, path, 0, "cannot be written: %s", strerror(errno));
        goto fail;
    }
    frames->end = (off_t)strlen(head);
    free(path);
    *out = frames;
    return CN_OK;
fail:
    free(path);
    cn_frames_close(frames, NULL);
    return status;
}

cn_status cn_frames_close(cn_frames *frames, cn_error *error)
{
    cn_status status = CN_OK;
    if (!frames) return CN_OK;
    if (frames->pvd >= 0 && close(frames->pvd))
        status = cn_fail(error, CN_ERR_FILE, frames->folder, 0, "frames.pvd cannot be closed: %s",
                         strerror(errno));
    free(frames->folder);
    free(frames);
    return status;
}

/* A name as part of a file's: letters, digits, - and _ (and . inside) stay. */
static void sanitise(const char *name, size_t size, char *out)
{
    size_t n = 0;
    for (; name[n] && n + 1 < size; n++) {
        const char c = name[n];
        const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                           c == '-' || c == '_' || (c == '.' && n > 0);
        out[n] = plain ? c : '_';
    }
    if (n == 0) out[n++] = '_';
    out[n] = 0;
}

/* NAME_STEP.vtu; where another piece of the frame has the same plain name: NAME-INDEX_STEP.vtu. */
static void piece_name(const cn_frame *frame, int ibody, size_t size, char *out)
{
    char own[64], other[64];
    bool taken = false;
    sanitise(frame->body[ibody].name, sizeof own, own);
    for (int j = 0; j < ibody && !taken; j++) {
        sanitise(frame->body[j].name, sizeof other, other);
        taken = !strcmp(own, other);
    }
    if (taken)
        snprintf(out, size, "%s-%d_%d.vtu", own, ibody, frame->step);
    else
        snprintf(out, size, "%s_%d.vtu", own, frame->step);
}

cn_status cn_frames_write(cn_frames *frames, const cn_frame *frame, cn_error *error)
{
    const size_t most = 256 * (size_t)frame->nbody + sizeof tail;
    char *entries = malloc(most), *path = NULL;
    cn_status status = CN_OK;
    size_t length = 0;

    if (!entries) return out_of_memory(error, frames->folder);
    if (!isfinite(frame->time))
        status =
            cn_fail(error, CN_ERR_NOT_FINITE, frames->folder, 0, "frame %d has no finite time", frame->step);
    for (int i = 0; i < frame->nbody && status == CN_OK; i++) {
        char name[96], time[32];
        piece_name(frame, i, sizeof name, name);
        if (!(path = join(frames->folder, name))) {
            status = out_of_memory(error, frames->folder);
            break;
        }
        status = cn_vtu_write(&frame->body[i], path, error);
        free(path);
        cn_vtk_number(frame->time, sizeof time, time);
        length += (size_t)snprintf(entries + length, most - length,
                                   "<DataSet timestep=\"%s\" part=\"%d\" file=\"%s\"/>\n", time, i, name);
    }
    if (status ==
        CN_OK) { /* entries, then the tail over where it was and beyond: never shorter than before */
        memcpy(entries + length, tail, sizeof tail);
        if (write_all(frames->pvd, entries, length + strlen(tail), frames->end) == CN_OK)
            frames->end += (off_t)length;
        else {
            const int cause = errno;
            if (ftruncate(frames->pvd, frames->end + (off_t)strlen(tail)) == 0)
                write_all(frames->pvd, tail, strlen(tail), frames->end);
            status = cn_fail(error, CN_ERR_FILE, frames->folder, 0, "frames.pvd cannot be written: %s",
                             strerror(cause));
        }
    }
    free(entries);
    return status;
}
