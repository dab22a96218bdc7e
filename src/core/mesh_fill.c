/* mesh_fill.c - fills a closed surface with tetrahedra by the `tetgen` command, in a temporary folder that is
 * always removed, with limits on time and memory. The command is run, never linked. Its input is scaled by a
 * power of two to about unit size, so that metres and millimetres give the same mesh, and its output is
 * checked: the surface is kept as it is, and what it encloses is filled. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "catnav/vec3.h"
#include "mesh_parts.h"

enum { PATH_SIZE = 512 };

static cn_status fail(cn_error *error, const char *what)
{
    return cn_fail(error, CN_ERR_MESHER, NULL, 0, "the mesher tetgen %s", what);
}

/* --- the folder --- */

static cn_status make_folder(char folder[PATH_SIZE], cn_error *error)
{
    const char *base = getenv("TMPDIR");

    if (!base || !*base || strlen(base) > PATH_SIZE / 2) base = "/tmp";
    snprintf(folder, PATH_SIZE, "%s/catnav_fill_XXXXXX", base);
    if (mkdtemp(folder)) return CN_OK;
    const int reason = errno;
    folder[0] = 0;
    return cn_fail(error, cn_fault_file(reason), base, 0, "no temporary folder can be made in it: %s",
                   strerror(reason));
}

static void remove_folder(const char *folder)
{
    char path[PATH_SIZE + 300];
    DIR *directory = folder[0] ? opendir(folder) : NULL;

    if (!directory) return;
    for (struct dirent *entry; (entry = readdir(directory));) {
        if (!strcmp(entry->d_name, ".") || !strcmp(entry->d_name, "..")) continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        unlink(path);
    }
    closedir(directory);
    rmdir(folder);
}

/* --- its input: used vertices only, numbered from 0 by `number` (-1: unused) --- */

static cn_status write_smesh(const char *folder, const cn_surface *s, double scale, int nused,
                             const int *number, cn_error *error)
{
    char path[PATH_SIZE + 16];
    FILE *file;

    snprintf(path, sizeof path, "%s/x.smesh", folder);
    if (!(file = fopen(path, "w")))
        return cn_fail(error, cn_fault_file(errno), path, 0, "cannot be written: %s", strerror(errno));
    fprintf(file, "%d 3 0 0\n", nused);
    for (int i = 0; i < s->nvert; i++)
        if (number[i] >= 0)
            fprintf(file, "%d %.17g %.17g %.17g\n", number[i], scale * s->vert[3 * (size_t)i],
                    scale * s->vert[3 * (size_t)i + 1], scale * s->vert[3 * (size_t)i + 2]);
    fprintf(file, "%d 0\n", s->ntri);
    for (int i = 0; i < s->ntri; i++)
        fprintf(file, "3 %d %d %d\n", number[s->tri[3 * (size_t)i]], number[s->tri[3 * (size_t)i + 1]],
                number[s->tri[3 * (size_t)i + 2]]);
    fprintf(file, "0\n0\n");
    const int failed = ferror(file);
    if (fclose(file) || failed)
        return cn_fail(error, CN_FAULT_ACCESS, path, 0, "cannot be written: the disk may be full");
    return CN_OK;
}

/* --- the run --- */

static void limit(int resource, double value)
{
    const struct rlimit both = {(rlim_t)value, (rlim_t)value};
    setrlimit(resource, &both);
}

/* In the child: only calls that are safe after a fork of a threaded program. */
static void become_mesher(const char *folder, const char *switches, const cn_fill_limits *limits)
{
    if (chdir(folder)) _exit(126);
    const int in = open("/dev/null", O_RDONLY), out = open("log", O_WRONLY | O_CREAT | O_TRUNC, 0600);
    if (in < 0 || out < 0 || dup2(in, 0) < 0 || dup2(out, 1) < 0 || dup2(out, 2) < 0) _exit(126);
    for (int fd = 3; fd < 1024; fd++)
        close(fd);
    limit(RLIMIT_CPU, ceil(limits->seconds));
    limit(RLIMIT_AS, limits->bytes);
    limit(RLIMIT_FSIZE, limits->bytes);
    limit(RLIMIT_CORE, 0);
    execlp(limits->command, limits->command, switches, "x.smesh", (char *)NULL);
    _exit(127);
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Waits for the child; false when it had to be ended. */
static bool wait_for(pid_t pid, double seconds, int *state)
{
    const double start = now();
    const struct timespec nap = {0, 2000000};

    for (;;) {
        const pid_t ended = waitpid(pid, state, WNOHANG);
        if (ended == pid) return true;
        if (ended < 0 && errno != EINTR) return *state = -1, true;
        if (now() - start > seconds) break;
        nanosleep(&nap, NULL);
    }
    kill(pid, SIGKILL);
    while (waitpid(pid, state, 0) < 0 && errno == EINTR) {}
    return false;
}

static cn_status run(const char *folder, double max_volume, const cn_fill_limits *limits, cn_error *error)
{
    char switches[64], text[200];
    int state = 0;

    snprintf(switches, sizeof switches, "-pYq1.4");
    if (max_volume > 0) snprintf(switches + 7, sizeof switches - 7, "a%.17f", max_volume);
    const pid_t pid = fork();
    if (pid < 0) return fail(error, "could not be started: no process can be made");
    if (pid == 0) become_mesher(folder, switches, limits);
    if (!wait_for(pid, limits->seconds, &state)) {
        snprintf(text, sizeof text,
                 "took more than %g s and was ended: give a coarser surface or a larger volume",
                 limits->seconds);
        return fail(error, text);
    }
    if (WIFSIGNALED(state)) {
        snprintf(text, sizeof text,
                 "was ended by signal %d (its time is limited to %g s, its memory to %.0f MiB): the "
                 "surface may nearly touch itself or be too fine",
                 WTERMSIG(state), limits->seconds, limits->bytes / 1048576);
        return fail(error, text);
    }
    if (WIFEXITED(state) && WEXITSTATUS(state) == 127)
        return fail(error, "cannot be run: install the package tetgen");
    if (!WIFEXITED(state) || WEXITSTATUS(state) != 0) {
        snprintf(text, sizeof text, "failed with exit status %d: the surface may nearly touch itself",
                 WIFEXITED(state) ? WEXITSTATUS(state) : -1);
        return fail(error, text);
    }
    return CN_OK;
}

/* --- its output --- */

/* The surface's own vertices come first and take their exact places again; the rest is scaled back. */
static cn_status place_back(cn_tets *tets, const cn_surface *s, double scale, int nused, const int *number)
{
    if (tets->nnode < nused) return CN_ERR_MESHER;
    for (int i = 0; i < s->nvert; i++) {
        if (number[i] < 0) continue;
        double *x = tets->node + 3 * (size_t)number[i];
        for (int k = 0; k < 3; k++) {
            const double expected = scale * s->vert[3 * (size_t)i + k];
            if (!(fabs(x[k] - expected) <= 1e-12 * (1 + fabs(expected)))) return CN_ERR_MESHER;
            x[k] = expected;
        }
    }
    for (size_t i = 0; i < 3 * (size_t)tets->nnode; i++)
        tets->node[i] /= scale;
    return CN_OK;
}

static cn_status judge(cn_tets *tets, const cn_surface *s, double volume, cn_error *error)
{
    cn_error why = {0};
    cn_surface *boundary = NULL;
    char text[480];
    int turned;
    double sum = 0;
    cn_status status = cn_tets_check(tets, &turned, &why);

    if (status != CN_OK) {
        snprintf(text, sizeof text, "made a mesh that cannot be used: %.400s", why.message);
        return fail(error, text);
    }
    for (int i = 0; i < tets->ntet; i++) {
        const int *t = tets->tet + 4 * (size_t)i;
        const double *x = tets->node;
        sum += cn_tet_volume6(x + 3 * (size_t)t[0], x + 3 * (size_t)t[1], x + 3 * (size_t)t[2],
                              x + 3 * (size_t)t[3]) /
               6;
    }
    if ((status = cn_tets_boundary(&boundary, tets)) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory");
    const int outer = boundary->ntri;
    cn_surface_free(boundary);
    if (fabs(sum - volume) <= 1e-6 * volume && outer == s->ntri) return CN_OK;
    snprintf(text, sizeof text,
             "filled a volume of %g within %d triangles where the surface encloses %g within %d: a "
             "hollow or a part within another cannot be filled; give its tetrahedra as a file",
             sum, outer, volume, s->ntri);
    return fail(error, text);
}

/* --- all of it --- */

static cn_status fill(cn_tets **out, const cn_surface *s, const cn_doctor *doctor, double max_volume,
                      const cn_fill_limits *limits, cn_error *error)
{
    const double scale = ldexp(1, -ilogb(doctor->size)); /* size in [1, 2) */
    int *number = cn_array((size_t)s->nvert, sizeof *number);
    char folder[PATH_SIZE] = "", path[PATH_SIZE + 16];
    cn_tets *tets = NULL;
    cn_error why = {0};
    int nused = 0;
    cn_status status = CN_ERR_MEMORY;

    if (!number) goto done;
    for (size_t i = 0; i < 3 * (size_t)s->ntri; i++)
        number[s->tri[i]] = 1;
    for (int i = 0; i < s->nvert; i++)
        number[i] = number[i] ? nused++ : -1;
    if ((status = make_folder(folder, error)) != CN_OK) goto done;
    if ((status = write_smesh(folder, s, scale, nused, number, error)) != CN_OK) goto done;
    if ((status = run(folder, max_volume * scale * scale * scale, limits, error)) != CN_OK) goto done;
    snprintf(path, sizeof path, "%s/x.1.node", folder);
    if ((status = cn_tets_read(&tets, path, &why)) != CN_OK) {
        if (status != CN_ERR_MEMORY)
            status = fail(error, "left no mesh that can be read: the surface may nearly touch itself");
        goto done;
    }
    if ((status = place_back(tets, s, scale, nused, number)) != CN_OK) {
        fail(error, "moved vertices of the surface");
        goto done;
    }
    if ((status = judge(tets, s, doctor->volume, error)) != CN_OK) goto done;
    *out = tets;
    tets = NULL;
done:
    if (status == CN_ERR_MEMORY)
        cn_fail(error, status, NULL, 0, "out of memory filling %d triangles", s->ntri);
    remove_folder(folder);
    cn_tets_free(tets);
    free(number);
    return status;
}

cn_status cn_tets_fill_by(cn_tets **out, const cn_surface *surface, double max_volume,
                          const cn_fill_limits *limits, cn_error *error)
{
    cn_surface *copy = NULL;
    cn_doctor doctor;
    cn_status status;

    if (!(max_volume >= 0 && max_volume < INFINITY))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                       "the largest volume of a tetrahedron is %g: 0 or more is needed", max_volume);
    if ((status = cn_surface_copy(&copy, surface)) != CN_OK)
        return cn_fail(error, status, NULL, 0, "out of memory copying %d triangles", surface->ntri);
    if ((status = cn_surface_check(copy, true, &doctor, error)) != CN_OK) goto done;
    if ((status = cn_doctor_solid(&doctor, "surface to fill", error)) != CN_OK) goto done;
    status = fill(out, copy, &doctor, max_volume, limits, error);
done:
    cn_surface_free(copy);
    return status;
}

cn_status cn_tets_fill(cn_tets **out, const cn_surface *surface, double max_volume, cn_error *error)
{
    const cn_fill_limits limits = {"tetgen", 120, 4.0 * 1024 * 1048576};
    return cn_tets_fill_by(out, surface, max_volume, &limits, error);
}
