/* catnav plan: the path alone. */
#include "command.h"
#include "catnav/frames.h"
#include "catnav/run.h"

#include <math.h>
#include <stdio.h>

static int plan_scene(int argc, char **argv)
{
    static settings_t settings;
    const char *scene_file, *out = NULL, *report_file = NULL;
    int threads = command_threads();
    bool quiet = false;
    const option_t options[] = {{"--out", OPTION_TEXT, &out},
                                {"--set", OPTION_SETTING, &settings},
                                {"--report", OPTION_TEXT, &report_file},
                                {"--threads", OPTION_COUNT, &threads},
                                {"--quiet", OPTION_FLAG, &quiet},
                                {0}};
    cn_scene *scene = NULL;
    cn_world *world = NULL;
    cn_path *path = NULL;
    cn_report report = {0};
    cn_error error = {0};
    int status = COMMAND_REFUSED;

    if (!command_options(&command_plan, argc, argv, options, "SCENE.yaml", &scene_file))
        return COMMAND_REFUSED;
    command_catch_signals();
    if (!out) {
        fputs("catnav plan: --out PATH.csv is missing; see catnav plan --help\n", stderr);
        return COMMAND_REFUSED;
    }
    if (cn_scene_read(&scene, scene_file, settings.n, settings.setting, &error) != CN_OK) {
        command_print_error(&error);
        goto done;
    }
    if (!command_can_write(out) || (report_file && !command_can_write(report_file))) goto done;
    cn_status computed = cn_world_new(&world, scene, 0, NULL, &error);
    if (computed == CN_OK && !command_cancel)
        computed = cn_run_plan(world, NULL, cn_ompl_planner, threads, &path, &report, &error);
    else
        cn_report_refused(&report, scene, &error);
    if (command_cancel) {
        fputs("interrupted\n", stderr);
        report.verdict.code = CN_VERDICT_CANCELLED;
        snprintf(report.verdict.message, sizeof report.verdict.message, "interrupted");
        status = command_finish(&report, report_file);
        goto done;
    }
    if (computed == CN_OK && path) computed = cn_path_write_csv(path, out, &error);
    const bool answered = report.verdict.code != CN_VERDICT_UNKNOWN && !path; /* says why there is none */
    if (computed != CN_OK && !answered) command_print_error(&error);
    if (answered)
        fprintf(stderr, "%s: %s\n", cn_verdict_status(report.verdict.code), report.verdict.message);
    else if (!quiet && computed == CN_OK && path)
        printf("path of %.4g m with %d points, sharpest turn %.3g degrees: %s\n", cn_path_length(path),
               path->n, path->turn_max * 180 / acos(-1), out);
    status = command_finish(&report, report_file);
    if (status == COMMAND_OK && (computed != CN_OK || !path)) status = COMMAND_FAILED;
done:
    cn_report_clear(&report);
    cn_path_free(path);
    cn_world_free(world);
    cn_scene_free(scene);
    return status;
}

static const char help[] =
    "NAME\n"
    "    catnav plan - the path alone, without moving anything along it\n\n"
    "SYNOPSIS\n"
    "    catnav plan SCENE.yaml --out PATH.csv [--set KEY=VALUE]... [--report FILE.json]\n"
    "               [--threads N] [--quiet]\n\n"
    "DESCRIPTION\n"
    "    Plans for the first body that has waypoints. PATH.csv has the header s,x,y,z,clearance,waypoint:\n"
    "    arc length, position and distance to the nearest wall in metres, and the index of the waypoint\n"
    "    that lies there or -1.\n\n"
    "OPTIONS\n"
    "    --out PATH.csv      where the path goes\n"
    "    --set KEY=VALUE     changes the scene before it is read, as in catnav run\n"
    "    --report FILE.json  writes the report\n"
    "    --threads N         1 to 64 worker threads (default: one a core); the path does not depend on them\n"
    "    --quiet             prints errors only\n\n"
    "SIGNALS\n"
    "    Ctrl-C (SIGINT) and SIGTERM: the search under way is finished, but no path is written; the\n"
    "    report is. A second one ends the command at once.\n\n"
    "EXIT STATUS\n"
    "    0 a path was found, 1 refused, 2 there is none, 3 the emergency budget was used up, 4 failed,\n"
    "    130 interrupted\n";

const command_t command_plan = {"plan", "find the path alone and write it as CSV", help, plan_scene};
