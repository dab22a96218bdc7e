/* catnav check: the mesh doctor. */
#include "command.h"
#include "catnav/mesh.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool ends_in(const char *path, const char *ending)
{
    const size_t n = strlen(path), m = strlen(ending);
    return n >= m && !strcmp(path + n - m, ending);
}

/* Prints the table and the refusal, if any; takes `table`. */
static int print_table(char *table, bool json, const cn_error *refusal)
{
    if (!table) {
        fputs("catnav check: out of memory\n", stderr);
        return COMMAND_FAILED;
    }
    fputs(table, stdout);
    if (*table && table[strlen(table) - 1] != '\n') putchar('\n');
    free(table);
    if (refusal->status == CN_OK) {
        if (!json) puts("usable");
        return COMMAND_OK;
    }
    command_print_error(refusal);
    return COMMAND_REFUSED;
}

static int check_tets(cn_tets *tets, const char *name, double scale, bool json)
{
    const cn_placement placement = {.scale = scale};
    cn_tets_doctor doctor;
    cn_error refusal = {0};
    int turned = 0;

    cn_place_points(&placement, tets->nnode, tets->node);
    if (cn_tets_measure(tets, &doctor, &refusal) != CN_OK) {
        command_print_error(&refusal);
        return COMMAND_REFUSED;
    }
    cn_tets_check(tets, &turned, &refusal);
    return print_table((json ? cn_tets_doctor_json : cn_tets_doctor_text)(&doctor, name, &refusal), json,
                       &refusal);
}

static int check_surface(cn_surface *surface, const char *name, double scale, bool json)
{
    const cn_placement placement = {.scale = scale};
    cn_doctor doctor;
    cn_error refusal = {0};

    cn_place_points(&placement, surface->nvert, surface->vert);
    if (cn_surface_check(surface, true, &doctor, &refusal) != CN_OK) {
        command_print_error(&refusal);
        return COMMAND_REFUSED;
    }
    cn_doctor_usable(&doctor, name, &refusal);
    return print_table((json ? cn_doctor_json : cn_doctor_text)(&doctor, name), json, &refusal);
}

static int check_mesh(int argc, char **argv)
{
    const char *file;
    double scale = 1;
    bool json = false;
    const option_t options[] = {{"--scale", OPTION_POSITIVE, &scale}, {"--json", OPTION_FLAG, &json}, {0}};
    cn_tets *tets = NULL;
    cn_surface *surface = NULL;
    cn_error as_tets = {0}, as_surface = {0};
    int status = COMMAND_REFUSED;

    if (!command_options(&command_check, argc, argv, options, "MESH", &file)) return COMMAND_REFUSED;
    const bool only_tets = ends_in(file, ".node") || ends_in(file, ".ele"), either = ends_in(file, ".msh");
    if ((only_tets || either) && cn_tets_read(&tets, file, &as_tets) == CN_OK)
        status = check_tets(tets, file, scale, json);
    else if (!only_tets && cn_surface_read(&surface, file, &as_surface) == CN_OK)
        status = check_surface(surface, file, scale, json);
    else
        command_print_error(only_tets || either ? &as_tets : &as_surface);
    cn_tets_free(tets);
    cn_surface_free(surface);
    return status;
}

static const char help[] =
    "NAME\n"
    "    catnav check - the mesh doctor: what a mesh is like, and whether it can be used\n\n"
    "SYNOPSIS\n"
    "    catnav check MESH [--scale S] [--json]\n\n"
    "DESCRIPTION\n"
    "    MESH is a surface (.stl .obj .ply, .msh with triangles) or tetrahedra (.node with .ele beside it,\n"
    "    .msh). Prints a table of counts, defects and sizes. A closed surface is usable when it can be\n"
    "    filled, an open one when it can be a wall, tetrahedra when they can be simulated. Nothing is "
    "repaired.\n\n"
    "OPTIONS\n"
    "    --scale S   metres per unit of the file: 0.001 for millimetres (default 1)\n"
    "    --json      prints one JSON object instead of the table\n\n"
    "EXIT STATUS\n"
    "    0 usable, 1 refused (the sentence says why)\n";

const command_t command_check = {"check", "measure a mesh and say whether it can be used", help, check_mesh};
