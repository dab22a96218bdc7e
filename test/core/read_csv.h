/* read_csv.h - the reference tables and meshes, for tests: one header line, cells separated by commas. */
#ifndef CN_READ_CSV_H
#define CN_READ_CSV_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    int nrow, ncol;
    char **cell; /* nrow x ncol, into text; row 0 is the first below the header */
    char **name; /* ncol column names */
    char *text;
} csv;

/* Path of a reference file: folder in CATNAV_REFERENCE, else the repo's copy. */
static inline const char *reference_path(char path[1024], const char *file)
{
    const char *folder = getenv("CATNAV_REFERENCE");
    if (folder && *folder)
        snprintf(path, 1024, "%s/%s", folder, file);
    else
        snprintf(path, 1024, "%s/reference/%s", CATNAV_TEST_DATA, file);
    return path;
}

static inline char *read_text(const char *path)
{
    FILE *f = fopen(path, "rb");
    char *text = NULL;
    if (f && !fseek(f, 0, SEEK_END)) {
        const long size = ftell(f);
        rewind(f);
        if (size >= 0 && (text = malloc((size_t)size + 1))) text[fread(text, 1, (size_t)size, f)] = 0;
    }
    if (f) fclose(f);
    return text;
}

static inline void csv_free(csv *table)
{
    free(table->cell), free(table->name), free(table->text);
    memset(table, 0, sizeof *table);
}

/* Reads a reference table, e.g. "data/ccd.csv"; 0 when it is absent. Free with csv_free. */
static inline int csv_read(csv *table, const char *file)
{
    char path[1024];
    memset(table, 0, sizeof *table);
    if (!(table->text = read_text(reference_path(path, file)))) return 0;
    int lines = 0, commas = 0;
    for (const char *c = table->text; *c; c++)
        lines += *c == '\n', commas += *c == ',' && !lines;
    table->ncol = commas + 1;
    table->name = calloc((size_t)table->ncol, sizeof(char *));
    table->cell = calloc((size_t)(lines + 1) * (size_t)table->ncol, sizeof(char *));
    if (!table->name || !table->cell) abort();
    int row = -1;
    for (char *line = table->text, *next; line && *line; line = next, row++) {
        if ((next = strpbrk(line, "\r\n"))) *next++ = 0, next += strspn(next, "\r\n");
        char **out = row < 0 ? table->name : table->cell + (size_t)row * (size_t)table->ncol;
        for (int k = 0; k < table->ncol; k++) { /* a quoted cell may hold commas */
            char *end;
            if (line && *line == '"')
                end = strchr(++line, '"'), end = end ? (*end = 0, end + 1) : NULL;
            else
                end = line;
            out[k] = line ? line : table->text + strlen(table->text);
            line = end ? strchr(end, ',') : NULL;
            if (line) *line++ = 0;
        }
    }
    table->nrow = row < 0 ? 0 : row;
    return 1;
}

/* Column by name; a table without it is no table of ours. */
static inline int csv_column(const csv *table, const char *name)
{
    for (int k = 0; k < table->ncol; k++)
        if (!strcmp(table->name[k], name)) return k;
    fprintf(stderr, "no column %s\n", name);
    abort();
}

static inline const char *csv_text(const csv *table, int row, const char *name)
{
    return table->cell[(size_t)row * (size_t)table->ncol + (size_t)csv_column(table, name)];
}

static inline double csv_number(const csv *table, int row, const char *name)
{
    return strtod(csv_text(table, row, name), NULL);
}

/* n numbers from the named column on. */
static inline void csv_numbers(const csv *table, int row, const char *name, int n, double *out)
{
    const int first = csv_column(table, name);
    for (int k = 0; k < n; k++)
        out[k] = strtod(table->cell[(size_t)row * (size_t)table->ncol + (size_t)(first + k)], NULL);
}

/* A reference mesh: "nodes n", "tets m", "tris k". Absent parts have count 0. */
typedef struct {
    int nnode, ntet, ntri;
    double *node; /* (nnode x 3) */
    int *tet;     /* (ntet x 4) */
    int *tri;     /* (ntri x 3) */
} reference_mesh;

static inline void reference_mesh_free(reference_mesh *mesh)
{
    free(mesh->node), free(mesh->tet), free(mesh->tri);
    memset(mesh, 0, sizeof *mesh);
}

/* Reads meshes/<name>.txt of the reference folder; 0 when it is absent. */
static inline int reference_mesh_read(reference_mesh *mesh, const char *name)
{
    char file[512], path[1024], word[16];
    int n;
    memset(mesh, 0, sizeof *mesh);
    snprintf(file, sizeof file, "meshes/%s.txt", name);
    FILE *f = fopen(reference_path(path, file), "r");
    if (!f) return 0;
    while (fscanf(f, "%15s %d", word, &n) == 2) {
        const int width = !strcmp(word, "tets") ? 4 : 3;
        if (!strcmp(word, "nodes")) {
            mesh->nnode = n, mesh->node = calloc((size_t)n * 3 + 1, sizeof(double));
            for (int i = 0; mesh->node && i < 3 * n; i++)
                if (fscanf(f, "%lf", mesh->node + i) != 1) abort();
        } else {
            int *const list = calloc((size_t)(n * width) + 1, sizeof(int));
            for (int i = 0; list && i < width * n; i++)
                if (fscanf(f, "%d", list + i) != 1) abort();
            if (width == 4)
                mesh->ntet = n, mesh->tet = list;
            else
                mesh->ntri = n, mesh->tri = list;
        }
    }
    fclose(f);
    return 1;
}

#endif
