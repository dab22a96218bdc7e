/* frames.pvd with its pieces. The index is opened once; each frame is put before its tail by one write, so
 * that the file is whole at any time. A frame whose step is not beyond the last one (a run that went back, or
 * its last frame again) replaces the index by a shorter one. The folder is locked while it is open. */
#include "catnav/frames.h"
#include "frames_vtk.h"
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

struct cn_frames {
    char *folder, *index;
    int lock;  /* descriptor of the folder; its lock goes with it, also when the process dies */
    int pvd;   /* descriptor of frames.pvd */
    off_t end; /* where its tail begins */
    int last;  /* largest step in the index, -1: none */
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
            return cn_fail(error, cn_fault_file(cause), path, 0, "the folder cannot be made: %s",
                           strerror(cause));
        if (!here) break;
    }
    if (stat(path, &info) || !S_ISDIR(info.st_mode))
        return cn_fail(error, CN_FAULT_NO_FILE, path, 0, "frames go into a folder, and this is none");
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

/* Two runs in one folder would mix their pieces. Where the file system has no locks none is taken. */
static cn_status lock_folder(cn_frames *frames, cn_error *error)
{
    if ((frames->lock = open(frames->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC)) < 0)
        return cn_fail(error, cn_fault_file(errno), frames->folder, 0, "the folder cannot be opened: %s",
                       strerror(errno));
    if (flock(frames->lock, LOCK_EX | LOCK_NB) && errno == EWOULDBLOCK)
        return cn_fail(error, CN_FAULT_LOCKED, frames->folder, 0,
                       "another run is writing its frames here: give another folder or wait for its end");
    return CN_OK;
}

/* --- the index as text --- */
/* The file's text; *text is NULL where there is no file, or none with the head of ours. */
static cn_status read_index(const char *path, char **text, cn_error *error)
{
    struct stat info;
    cn_status status = CN_OK;
    FILE *file = fopen(path, "rb");
    *text = NULL;
    if (!file) return CN_OK;
    if (fstat(fileno(file), &info) == 0 && S_ISREG(info.st_mode)) {
        if ((*text = malloc((size_t)info.st_size + 1)))
            (*text)[fread(*text, 1, (size_t)info.st_size, file)] = 0;
        else
            status = out_of_memory(error, path);
    }
    fclose(file);
    if (*text && strncmp(*text, head, strlen(head))) {
        free(*text);
        *text = NULL;
    }
    return status;
}

/* The piece that the line names, and its step; false where it is not as we write them: a plain name without
 * folders, NAME_STEP.vtu or NAME_skin_STEP.vtp. */
static bool parse_line(const char *line, size_t size, char *name, int *step)
{
    const char *end = strchr(line, '\n'), *from = strstr(line, " file=\"");
    if (strncmp(line, "<DataSet timestep=\"", 19) || !end || !from || from > end) return false;
    from += strlen(" file=\"");
    const size_t n = strspn(from, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.");
    if (n + 1 > size || *from == '.' || strncmp(from + n, "\"/>\n", 4)) return false;
    memcpy(name, from, n);
    name[n] = 0;
    const char *number = strrchr(name, '_');
    if (!number) return false;
    const size_t digits = strspn(++number, "0123456789");
    const bool skin = number - name > 6 && !strncmp(number - 6, "_skin_", 6);
    if (digits < 1 || digits > 10) return false;
    if (strcmp(number + digits, ".vtu") && !(skin && !strcmp(number + digits, ".vtp"))) return false;
    const long long value = strtoll(number, NULL, 10);
    *step = value > INT_MAX ? INT_MAX : (int)value;
    return true;
}

/* Where the first piece with this step or a later one is named, or the tail begins. */
static char *first_from(char *text, int step)
{
    char name[96], *line = text + strlen(head);
    int found;
    while (parse_line(line, sizeof name, name, &found) && found < step)
        line = strchr(line, '\n') + 1;
    return line;
}

/* Deletes the pieces named from `line` on, but those that `kept` names too. */
static void remove_pieces(const cn_frames *frames, const char *line, const char *kept)
{
    char name[96], words[112];
    int step;
    struct stat info;
    for (; parse_line(line, sizeof name, name, &step); line = strchr(line, '\n') + 1) {
        snprintf(words, sizeof words, "file=\"%s\"", name);
        if (!strstr(kept, words) && !fstatat(frames->lock, name, &info, AT_SYMLINK_NOFOLLOW) &&
            S_ISREG(info.st_mode))
            unlinkat(frames->lock, name, 0);
    }
}

/* The index anew, by temporary name and rename: `length` bytes of `text`, `entries`, the tail. */
static cn_status replace_index(cn_frames *frames, const char *text, size_t length, const char *entries,
                               cn_error *error)
{
    cn_output index;
    cn_status status = cn_output_open(&index, frames->index, error);
    if (status != CN_OK) return status;
    fwrite(text, 1, length, index.file);
    fprintf(index.file, "%s%s", entries, tail);
    if ((status = cn_output_commit(&index, error)) != CN_OK) return status;
    if (frames->pvd >= 0) close(frames->pvd);
    if ((frames->pvd = open(frames->index, O_WRONLY | O_CLOEXEC)) < 0)
        return cn_fail(error, cn_fault_file(errno), frames->index, 0, "cannot be written: %s",
                       strerror(errno));
    frames->end = (off_t)(length + strlen(entries));
    return CN_OK;
}

cn_status cn_frames_open(cn_frames **out, const char *folder, cn_error *error)
{
    char *old = NULL;
    cn_status status;
    cn_frames *frames = calloc(1, sizeof *frames);

    *out = NULL;
    if (!frames) return out_of_memory(error, folder);
    frames->pvd = frames->lock = frames->last = -1;
    if (!*folder) {
        status = cn_fail(error, CN_FAULT_MISSING_FILE, "", 0, "the frames' folder has no name");
        goto fail;
    }
    if (!(frames->folder = strdup(folder)) || !(frames->index = join(folder, "frames.pvd"))) {
        status = out_of_memory(error, folder);
        goto fail;
    }
    if ((status = make_folder(frames->folder, error)) != CN_OK) goto fail;
    if ((status = lock_folder(frames, error)) != CN_OK) goto fail;
    if ((status = read_index(frames->index, &old, error)) != CN_OK) goto fail;
    if ((status = replace_index(frames, head, strlen(head), "", error)) != CN_OK) goto fail;
    if (old) remove_pieces(frames, old + strlen(head), "");
    free(old);
    *out = frames;
    return CN_OK;
fail:
    free(old);
    cn_frames_close(frames, NULL);
    return status;
}

cn_status cn_frames_close(cn_frames *frames, cn_error *error)
{
    cn_status status = CN_OK;
    if (!frames) return CN_OK;
    if (frames->pvd >= 0 && close(frames->pvd))
        status = cn_fail(error, cn_fault_file(errno), frames->folder, 0, "frames.pvd cannot be closed: %s",
                         strerror(errno));
    if (frames->lock >= 0) close(frames->lock);
    free(frames->folder);
    free(frames->index);
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

/* NAME_STEP.vtu, of its skin NAME_skin_STEP.vtp; where another body of the frame has the same plain name:
 * NAME-INDEX. */
static void piece_name(const cn_frame *frame, int ibody, bool skin, size_t size, char *out)
{
    char own[64], other[64], index[16] = "";
    bool taken = false;
    sanitise(frame->body[ibody].name, sizeof own, own);
    for (int j = 0; j < ibody && !taken; j++) {
        sanitise(frame->body[j].name, sizeof other, other);
        taken = !strcmp(own, other);
    }
    if (taken) snprintf(index, sizeof index, "-%d", ibody);
    snprintf(out, size, "%s%s%s_%d.%s", own, index, skin ? "_skin" : "", frame->step, skin ? "vtp" : "vtu");
}

/* Writes piece i: bodies first, then their skins; its entry of the index is added where there is one. */
static cn_status write_piece(const cn_frames *frames, const cn_frame *frame, int i, size_t most,
                             char *entries, cn_error *error)
{
    const bool skin = i >= frame->nbody;
    const cn_frame_body *body = &frame->body[i % frame->nbody];
    char name[112], time[32];
    if (skin && !body->skin) return CN_OK;
    piece_name(frame, i % frame->nbody, skin, sizeof name, name);
    char *path = join(frames->folder, name);
    if (!path) return out_of_memory(error, frames->folder);
    const cn_status status = skin ? cn_skin_write_vtp(body, path, error) : cn_vtu_write(body, path, error);
    free(path);
    cn_vtk_number(frame->time, sizeof time, time);
    const size_t length = strlen(entries);
    snprintf(entries + length, most - length, "<DataSet timestep=\"%s\" part=\"%d\" file=\"%s\"/>\n", time, i,
             name);
    return status;
}

/* The frame of `step` is written, its entries are not: they take the place of those of this step and later
 * ones, whose pieces belong to a branch that was not taken. */
static cn_status go_back(cn_frames *frames, int step, const char *entries, cn_error *error)
{
    char *text;
    cn_status status = read_index(frames->index, &text, error);
    if (status != CN_OK) return status;
    if (!text)
        return cn_fail(error, CN_FAULT_ACCESS, frames->index, 0,
                       "cannot be read back, or is no index of frames");
    const char *from = first_from(text, step);
    status = replace_index(frames, text, (size_t)(from - text), entries, error);
    if (status == CN_OK) remove_pieces(frames, from, entries);
    free(text);
    return status;
}

cn_status cn_frames_write(cn_frames *frames, const cn_frame *frame, cn_error *error)
{
    const size_t most = 512 * (size_t)frame->nbody + sizeof tail;
    char *entries = malloc(most);
    cn_status status = CN_OK;

    if (!entries) return out_of_memory(error, frames->folder);
    *entries = 0;
    if (!isfinite(frame->time))
        status =
            cn_fail(error, CN_ERR_NOT_FINITE, frames->folder, 0, "frame %d has no finite time", frame->step);
    for (int i = 0; i < 2 * frame->nbody && status == CN_OK; i++)
        status = write_piece(frames, frame, i, most, entries, error);
    const size_t length = strlen(entries);
    if (status == CN_OK && frame->step <= frames->last)
        status = go_back(frames, frame->step, entries, error);
    else if (status == CN_OK) { /* the tail over where it was and beyond: never shorter than before */
        memcpy(entries + length, tail, sizeof tail);
        if (write_all(frames->pvd, entries, length + strlen(tail), frames->end) == CN_OK)
            frames->end += (off_t)length;
        else {
            const int cause = errno;
            if (ftruncate(frames->pvd, frames->end + (off_t)strlen(tail)) == 0)
                write_all(frames->pvd, tail, strlen(tail), frames->end);
            status = cn_fail(error, cn_fault_file(cause), frames->folder, 0,
                             "frames.pvd cannot be written: %s", strerror(cause));
        }
    }
    if (status == CN_OK) frames->last = frame->step;
    free(entries);
    return status;
}
