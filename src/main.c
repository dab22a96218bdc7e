/* The command `catnav`: words to subcommands. */
#include "command.h"

#include <stdio.h>
#include <string.h>

#ifndef CATNAV_VERSION
#define CATNAV_VERSION "unknown"
#endif

static const command_t *const commands[] = {&command_run, &command_plan, &command_check, &command_study};
#define NCOMMAND (sizeof commands / sizeof *commands)

static const char page[] =
    "NAME\n"
    "    catnav - plan and simulate a deformable device on its way through a patient's vessels\n\n"
    "SYNOPSIS\n"
    "    catnav run SCENE.yaml [options]\n"
    "    catnav plan SCENE.yaml --out PATH.csv [options]\n"
    "    catnav check MESH [options]\n"
    "    catnav study DIR [options]\n"
    "    catnav --version | --help | help COMMAND\n\n"
    "DESCRIPTION\n"
    "    A scene file names the vessels, the device and the target; launch/scenes/all_keys.yaml explains "
    "every\n"
    "    key. The device is simulated as finite elements, never passes a wall, and every limit is checked "
    "after\n"
    "    each step; when one is broken, the run rolls back and plans anew.\n\n"
    "COMMANDS\n";

static const char page_end[] =
    "\nEXIT STATUS\n"
    "    0  every waypoint was reached, or there were none and the run is complete; the mesh is usable\n"
    "    1  the input or the command line was refused\n"
    "    2  infeasible: no path, no contact-free start, or a limit stayed broken\n"
    "    3  the time limit or the emergency budget was used up\n"
    "    4  the computation failed\n"
    "    130  interrupted\n\n"
    "EXAMPLE\n"
    "    catnav run launch/scenes/liver.yaml --report liver.json --frames frames\n";

static int print_page(void)
{
    fputs(page, stdout);
    for (size_t i = 0; i < NCOMMAND; i++)
        printf("    %-8s %s\n", commands[i]->name, commands[i]->summary);
    fputs(page_end, stdout);
    return COMMAND_OK;
}

static const command_t *find(const char *name)
{
    for (size_t i = 0; i < NCOMMAND; i++)
        if (!strcmp(commands[i]->name, name)) return commands[i];
    return NULL;
}

static bool is_help(const char *word)
{
    return !strcmp(word, "--help") || !strcmp(word, "-h");
}

int main(int argc, char **argv)
{
    if (argc < 2) {
        fputs("catnav: a command is needed: run, plan, check or study; see catnav --help\n", stderr);
        return COMMAND_REFUSED;
    }
    if (!strcmp(argv[1], "--version")) {
        puts("catnav " CATNAV_VERSION);
        return COMMAND_OK;
    }
    const bool asks_help = is_help(argv[1]) || !strcmp(argv[1], "help");
    if (asks_help && argc == 2) return print_page();
    const char *name = asks_help ? argv[2] : argv[1];
    const command_t *command = find(name);
    if (!command) {
        fprintf(stderr, "catnav: unknown %s \"%s\"; see catnav --help\n", *name == '-' ? "option" : "command",
                name);
        return COMMAND_REFUSED;
    }
    bool help = asks_help;
    for (int i = 2; i < argc && strcmp(argv[i], "--"); i++)
        help = help || is_help(argv[i]);
    if (help) {
        fputs(command->help, stdout);
        return COMMAND_OK;
    }
    return command->run(argc - 2, argv + 2);
}
