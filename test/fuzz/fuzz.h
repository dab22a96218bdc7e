/* fuzz.h - what the fuzzers of the file readers share. A reader takes any bytes: it answers with a status and
 * a sentence, in memory of at most 10 times the file and 16 MiB, and what it accepts is sound. */
#ifndef CN_FUZZ_H
#define CN_FUZZ_H

#include <math.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "catnav/mesh.h"
#include "catnav/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
/* The sanitizers' allocator; replay.c has its own in an ordinary build. */
int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void *, size_t),
                                              void (*on_free)(const volatile void *));
size_t __sanitizer_get_allocated_size(const volatile void *p);

static atomic_size_t held, most; /* bytes allocated, at most: -1 while not counted */

static inline void on_malloc(const volatile void *p, size_t size)
{
    (void)p;
    const size_t now = atomic_fetch_add(&held, size) + size;
    if (now > most) {
        fprintf(stderr, "%zu bytes held, %zu allowed\n", now, (size_t)most);
        abort();
    }
}
static inline void on_free(const volatile void *p)
{
    const size_t size = p ? __sanitizer_get_allocated_size(p) : 0;
    const size_t now = held;
    held -= size < now ? size : now;
}

static void require(int sound, const char *what)
{
    if (sound) return;
    fprintf(stderr, "%s\n", what);
    abort();
}

/* Writes the bytes to a file of this process with that extension; its name is good until the next call. */
static inline const char *file_of(const char *extension, const uint8_t *data, size_t size)
{
    static char name[2][64];
    static int turn;
    char *const path = name[turn ^= 1];
    snprintf(path, sizeof *name, "/dev/shm/catnav_fuzz_%d%s", (int)getpid(), extension);
    FILE *file = fopen(path, "wb");
    require(file && fwrite(data, 1, size, file) == size && !fclose(file), "no file can be written");
    return path;
}

/* Counts memory from here until _end. */
static inline void count_begin(size_t size)
{
    static int installed;
    if (!installed) __sanitizer_install_malloc_and_free_hooks(on_malloc, on_free);
    installed = 1;
    held = 0;
    most = 10 * size + (16u << 20);
}
static inline void count_end(void)
{
    most = (size_t)-1;
}

static inline void check_answer(cn_status status, const cn_error *error)
{
    require(status >= CN_OK && status < CN_STATUS_COUNT, "a status that does not exist");
    require(status == CN_OK || (error->status == status && error->message[0]),
            "a refusal without a sentence");
}

static inline void check_points(int n, const double *x)
{
    for (int i = 0; i < 3 * n; i++)
        require(isfinite(x[i]), "a coordinate that is not finite was accepted");
}

static inline int fuzz_surface(const char *extension, const uint8_t *data, size_t size)
{
    cn_surface *surface = NULL;
    cn_error error = {0};
    const char *path = file_of(extension, data, size);
    count_begin(size);
    const cn_status status = cn_surface_read(&surface, path, &error);
    check_answer(status, &error);
    if (status == CN_OK) {
        require(surface->ntri > 0, "a surface without triangles was accepted");
        check_points(surface->nvert, surface->vert);
        for (int i = 0; i < 3 * surface->ntri; i++)
            require(surface->tri[i] >= 0 && surface->tri[i] < surface->nvert, "an index out of range");
        cn_surface_free(surface);
    }
    count_end();
    unlink(path);
    return 0;
}

static inline void fuzz_tets(const char *path, size_t size)
{
    cn_tets *tets = NULL;
    cn_error error = {0};
    count_begin(size);
    const cn_status status = cn_tets_read(&tets, path, &error);
    check_answer(status, &error);
    if (status == CN_OK) {
        check_points(tets->nnode, tets->node);
        for (int i = 0; i < 4 * tets->ntet; i++)
            require(tets->tet[i] >= 0 && tets->tet[i] < tets->nnode, "an index out of range");
        for (int i = 0; tets->mid && i < 6 * tets->ntet; i++)
            require(tets->mid[i] >= 0 && tets->mid[i] < tets->nnode, "an index out of range");
        cn_tets_free(tets);
    }
    count_end();
}

#endif
