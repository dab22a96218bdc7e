/* mesh_files.h - files of the mesh tests: the good ones in the repo, temporary ones made by a test. */
#ifndef MESH_FILES_H
#define MESH_FILES_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fail_alloc.h"

static const char *const good_surfaces[] = {
    "tetra.stl",        "tetra_binary.stl", "tetra.obj",           "tetra.ply",    "tetra_little.ply",
    "tetra_big.ply",    "tetra_22.msh",     "tetra_22_binary.msh", "tetra_41.msh", "tetra_41_binary.msh",
    "tetra_41_big.msh", "cube_quads.obj",   "cube_quads.ply"};
enum { NGOOD = sizeof good_surfaces / sizeof *good_surfaces, NTETRA = NGOOD - 2 };
static const char *const good_tets[] = {"tetra_22.msh",        "tetra_22_binary.msh", "tetra_41.msh",
                                        "tetra_41_binary.msh", "tetra_41_big.msh",    "tetra.node"};
enum { NGOOD_TETS = sizeof good_tets / sizeof *good_tets };

static inline const char *good_path(const char *name)
{
    static char path[1024];
    snprintf(path, sizeof path, "%s/meshes/%s", CATNAV_TEST_DATA, name);
    return path;
}

/* for (long n = 0; allocation_fails(&n);) ... : one after the other, until a call needs fewer. */
static inline bool allocation_fails(long *n)
{
    const bool more = *n == 0 || fail_alloc_fired();
    fail_alloc_at(more ? (*n)++ : -1);
    return more;
}

/* A folder of the test's own; removed with all its files at the end. */
typedef struct {
    char name[64];
    char path[256]; /* of the file made last */
} folder;

static inline int folder_make(void **state)
{
    folder *f = calloc(1, sizeof *f);
    if (!f) return -1;
    *state = f;
    strcpy(f->name, "/dev/shm/catnav_test_XXXXXX"); /* memory, where there is such a folder */
    if (mkdtemp(f->name)) return 0;
    strcpy(f->name, "/tmp/catnav_test_XXXXXX");
    return mkdtemp(f->name) ? 0 : -1;
}

static inline int folder_remove(void **state)
{
    folder *f = *state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", f->name);
    free(f);
    return system(command);
}

static inline const char *folder_write(folder *f, const char *name, const void *data, size_t size)
{
    snprintf(f->path, sizeof f->path, "%s/%s", f->name, name);
    FILE *file = fopen(f->path, "wb");
    if (!file) abort();
    if (fwrite(data, 1, size, file) != size) abort();
    fclose(file);
    return f->path;
}

static inline char *file_load(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    char *data = malloc(1 << 16);
    if (!file || !data) abort();
    *size = fread(data, 1, 1 << 16, file);
    fclose(file);
    return data;
}

#endif
