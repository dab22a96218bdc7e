/* catnav run: a scene to its verdict, with progress, frames and report. */
#include "command.h"
#include "catnav/frames.h"
#include "catnav/run.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

typedef struct {
    cn_frames *frames; /* NULL: none are wanted, or the disk refused one */
    const char *folder;
    int every;
    bool bar; /* a progress bar is on the terminal */
    int written;
    cn_error error; /* the first failed frame */
} run_t;

static bool wants_frame(void *user, int step)
{
    const run_t *run = user;
    return run->frames && step % run->every == 0;
}

static void clear_line(const run_t *run)
{
    if (run->bar) fputs("\r\033[K", stderr);
}

static void take_frame(void *user, const cn_frame *frame)
{
    run_t *run = user;
    if (!run->frames) return;
    if (cn_frames_write(run->frames, frame, &run->error) == CN_OK) {
        run->written++;
        return;
    }
    clear_line(run);
    command_print_error(&run->error);
    fputs("no more frames are written; the run goes on\n", stderr);
    cn_frames_close(run->frames, NULL);
    run->frames = NULL;
}

static void take_path(void *user, int body, const cn_path *path, const cn_roadmap *roadmap)
{
    run_t *run = user;
    char file[PATH_MAX];
    (void)roadmap;
    if (!run->frames) return;
    snprintf(file, sizeof file, "%s/path_%d.vtp", run->folder, body);
    if (cn_path_write_vtp(path, file, &run->error) != CN_OK) command_print_error(&run->error);
}

static void show_progress(void *user, const cn_progress *p)
{
    static const char *const stages[] = {"meshing", "mapping the lumen", "planning"};
    const run_t *run = user;
    char bar[21] = "                    ";
    if (!run->bar) return;
    clear_line(run);
    if (p->stage != CN_STAGE_MOTION) {
        fprintf(stderr, "%s ...", (unsigned)p->stage < 3 ? stages[p->stage] : "working");
    } else {
        const double done = p->time_limit > 0 ? p->time / p->time_limit : 0;
        for (int i = 0; i < 20 && i < 20 * done; i++)
            bar[i] = '#';
        fprintf(stderr, "[%s] %.2f of %.4g s  waypoint %d of %d  %.3g steps/s", bar, p->time, p->time_limit,
                p->waypoint, p->nwaypoint, p->steps_per_s);
        if (isfinite(p->margin)) fprintf(stderr, "  %s %.0f %% to its limit", p->margin_of, 100 * p->margin);
        if (p->replans) fprintf(stderr, "  %d replans", p->replans);
    }
    fflush(stderr);
}

/* Rigid walls do not move: once, beside the frames. Walls that give way are in these. */
static void write_walls(run_t *run, const cn_scene *scene, const cn_world *world)
{
    for (int i = 0; i < world->nwall && run->frames; i++) {
        const cn_surface_spec *spec = world->wall[i].spec;
        const bool gives_way = spec && (spec->deformable || spec->wall.model != CN_WALL_RIGID);
        char file[PATH_MAX];
        if (gives_way && scene->leave_out.wall_solve != CN_ON) continue;
        snprintf(file, sizeof file, "%s/wall_%d.vtp", run->folder, i);
        if (cn_surface_write_vtp(world->wall[i].surface, file, &run->error) != CN_OK) {
            command_print_error(&run->error);
            return;
        }
    }
}

static void print_verdict(const run_t *run, const cn_report *report, const char *report_file)
{
    const cn_verdict *v = &report->verdict;
    printf("%s: %s\n", cn_verdict_status(v->code), *v->message ? v->message : cn_verdict_name(v->code));
    if (report->steps > 0) {
        printf("  %d steps, %.4g s simulated in %.4g s", report->steps, report->time.simulated_s,
               report->time.wall_s);
        if (report->replans) printf(", %d replans", report->replans);
        if (isfinite(report->contact.gap_min)) printf(", least gap %.3g mm", 1e3 * report->contact.gap_min);
        putchar('\n');
    }
    if (report_file) printf("  report: %s\n", report_file);
    if (run->folder) printf("  frames: %s/frames.pvd (%d)\n", run->folder, run->written);
}

static int run_scene(int argc, char **argv)
{
    static settings_t settings;
    const char *scene_file, *report_file = NULL;
    run_t run = {.every = 1};
    int threads = command_threads();
    bool quiet = false;
    const option_t options[] = {{"--set", OPTION_SETTING, &settings},
                                {"--report", OPTION_TEXT, &report_file},
                                {"--frames", OPTION_TEXT, &run.folder},
                                {"--every", OPTION_COUNT, &run.every},
                                {"--threads", OPTION_COUNT, &threads},
                                {"--quiet", OPTION_FLAG, &quiet},
                                {0}};
    cn_scene *scene = NULL;
    cn_world *world = NULL;
    cn_report report = {0};
    cn_error error = {0};
    int status = COMMAND_REFUSED;

    if (!command_options(&command_run, argc, argv, options, "SCENE.yaml", &scene_file))
        return COMMAND_REFUSED;
    command_catch_signals();
    run.bar = !quiet && isatty(STDERR_FILENO);
    if (!quiet) command_print_warnings();
    if (cn_scene_read(&scene, scene_file, settings.n, settings.setting, &error) != CN_OK ||
        (run.folder && cn_frames_open(&run.frames, run.folder, &error) != CN_OK)) {
        command_print_error(&error);
        goto done;
    }
    if (report_file && !command_can_write(report_file)) goto done;
    const cn_run_hooks hooks = {&run, wants_frame, take_frame, show_progress, take_path, &command_cancel};
    cn_status computed = cn_world_new(&world, scene, 0, NULL, &error);
    if (computed == CN_OK) {
        write_walls(&run, scene, world);
        computed = cn_run(world, NULL, cn_ompl_planner, threads, &hooks, &report, &error);
    } else
        cn_report_refused(&report, scene, &error);
    clear_line(&run);
    const bool refused = cn_verdict_exit(report.verdict.code) == COMMAND_REFUSED;
    if (computed != CN_OK)
        command_print_error(&error);
    else if (refused)
        fprintf(stderr, "%s\n", report.verdict.message);
    if (!quiet && !refused) print_verdict(&run, &report, report_file);
    status = command_finish(&report, report_file);
    if (cn_frames_close(run.frames, &run.error) != CN_OK) command_print_error(&run.error);
    run.frames = NULL;
    if (status == COMMAND_OK && (computed != CN_OK || run.error.status != CN_OK)) status = COMMAND_FAILED;
done:
    cn_frames_close(run.frames, NULL);
    cn_report_clear(&report);
    cn_world_free(world);
    cn_scene_free(scene);
    return status;
}

static const char help[] =
    "NAME\n"
    "    catnav run - run a scene to its verdict\n\n"
    "SYNOPSIS\n"
    "    catnav run SCENE.yaml [--set KEY=VALUE]... [--report FILE.json] [--frames DIR] [--every N]\n"
    "               [--threads N] [--quiet]\n\n"
    "OPTIONS\n"
    "    --set KEY=VALUE     changes the scene before it is read; KEY reaches into lists by index or name:\n"
    "                        bodies.0.model=rod, bodies.catheter.limits=[{quantity: volume, limit: 0.1}]\n"
    "    --report FILE.json  writes the report, in every case in which the scene can be read\n"
    "    --frames DIR        writes DIR/frames.pvd with one .vtu a body and step, for ParaView; the walls\n"
    "                        (wall_N.vtp) and the last path (path_N.vtp) stand beside it\n"
    "    --every N           only every N-th step and the last one become frames\n"
    "    --threads N         1 to 64 worker threads (default: one a core); the results do not depend on "
    "them\n"
    "    --quiet             prints errors only\n\n"
    "SIGNALS\n"
    "    Ctrl-C (SIGINT) and SIGTERM stop the run within a step; the report is still written. A second\n"
    "    one ends it at once, without a report.\n\n"
    "EXIT STATUS\n"
    "    0 reached or ran to the end, 1 refused, 2 infeasible, 3 time used up, 4 failed (also where\n"
    "    a report or frames could not be written), 130 interrupted\n";

const command_t command_run = {"run", "run a scene: plan, drive, check limits, report", help, run_scene};
