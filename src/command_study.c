/* catnav study: methods compared on a scene, as a table on the screen and as CSV and JSON. */
#include "command.h"
#include "catnav/study.h"
#include "catnav/world.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static void show_progress(void *user, const char *what)
{
    (void)user;
    fprintf(stderr, "\r\033[K%s", what);
    fflush(stderr);
}

static void print_row(const cn_study_state *state, int method)
{
    const cn_study_row *r = &state->row[method];
    char place[16] = "", unconverged[32] = "0", tip[32] = "-";
    if (method == 0) snprintf(place, sizeof place, "%.0f %%", 100 * state->fraction);
    if (r->unconverged)
        snprintf(unconverged, sizeof unconverged, "%ld (%.1e)", r->unconverged, r->linear_residual);
    if (isfinite(r->tip_apart)) snprintf(tip, sizeof tip, "%.3g", 1e3 * r->tip_apart);
    printf("%-6s %-6s %5d %6d  %8.2f %8.2f %7.2f   %8.1e %8.1e  %5.0f %5.0f  %14s  %4.0f %4.0f  %9ld %8ld  "
           "%8s\n",
           place, cn_study_method_name(method), r->steps, r->failure != CN_OK, r->step_ms.median,
           r->step_ms.p95, r->ratio, r->residual.median, r->residual.max, r->linear.median, r->linear.max,
           unconverged, r->newton.median, r->newton.max, r->intersections, r->outside_nodes, tip);
}

static void print_study(const cn_study *study)
{
    printf("%-6s %-6s %5s %6s  %17s %7s   %17s  %11s  %14s  %9s  %9s %8s  %8s\n", "", "", "", "", "step [ms]",
           "ratio", "residual", "linear it.", "not converged", "newton", "crossings", "outside", "tip apart");
    printf("%-6s %-6s %5s %6s  %8s %8s %7s   %8s %8s  %5s %5s  %14s  %4s %4s  %9s %8s  %8s\n", "state",
           "method", "steps", "failed", "median", "p95", "to own", "median", "max", "med.", "max",
           "(worst resid.)", "med.", "max", "sum", "sum", "[mm]");
    for (int i = 0; i < study->nstate; i++)
        for (int m = 0; m < CN_STUDY_METHODS; m++)
            print_row(&study->state[i], m);
    for (int i = 0; i < study->nstate; i++)
        for (int m = 0; m < CN_STUDY_METHODS; m++) {
            const cn_study_row *r = &study->state[i].row[m];
            if (r->failure != CN_OK)
                printf("%.0f %%, %s: step %d of %d cannot be computed (%s)\n", 100 * study->state[i].fraction,
                       cn_study_method_name(m), r->steps + 1, CN_STUDY_STEPS, cn_status_text(r->failure));
        }
}

static int study_paper(int argc, char **argv)
{
    static settings_t settings;
    const char *scene_file, *folder = "build/study";
    int threads = command_threads();
    bool quiet = false;
    const option_t options[] = {{"--out", OPTION_TEXT, &folder},
                                {"--set", OPTION_SETTING, &settings},
                                {"--threads", OPTION_COUNT, &threads},
                                {"--quiet", OPTION_FLAG, &quiet},
                                {0}};
    cn_scene *scene = NULL;
    cn_world *world = NULL;
    static cn_study study;
    cn_error error = {0};
    int status = COMMAND_REFUSED;

    if (!command_options(&command_study, argc, argv, options, "SCENE.yaml", &scene_file))
        return COMMAND_REFUSED;
    command_catch_signals();
    const bool bar = !quiet && isatty(STDERR_FILENO);
    const cn_study_hooks hooks = {.progress = bar ? show_progress : NULL, .cancel = &command_cancel};
    if (cn_scene_read(&scene, scene_file, settings.n, settings.setting, &error) != CN_OK ||
        cn_study_write(&study, folder, &error) != CN_OK || /* told before the run, not after it */
        cn_world_new(&world, scene, 0, NULL, &error) != CN_OK) {
        command_print_error(&error);
        goto done;
    }
    const cn_status computed = cn_study_paper(world, cn_ompl_planner, threads, &hooks, &study, &error);
    if (bar) fputs("\r\033[K", stderr);
    const cn_verdict *verdict = &study.run.verdict;
    status = computed == CN_OK              ? COMMAND_OK
             : computed == CN_ERR_CANCELLED ? cn_verdict_exit(CN_VERDICT_CANCELLED)
                                            : COMMAND_FAILED;
    if (computed != CN_OK) command_print_error(&error);
    if (!quiet && study.run.steps > 0)
        printf("%s: %d steps, %.4g s simulated, %d tetrahedra, %d threads; %s: %s\n\n", study.run.scene,
               study.run.steps, study.run.time.simulated_s, study.run.counts.tets, threads,
               cn_verdict_status(verdict->code), verdict->message);
    if (computed == CN_OK && study.nstate == 0) {
        fprintf(stderr, "%s: %s\n", cn_verdict_status(verdict->code), verdict->message);
        status = cn_verdict_exit(verdict->code);
    }
    if (!quiet && study.nstate > 0) print_study(&study);
    if (cn_study_write(&study, folder, &error) != CN_OK) {
        command_print_error(&error);
        if (status == COMMAND_OK) status = COMMAND_FAILED;
    } else if (!quiet)
        printf("\n%s/paper.csv, %s/paper.json\n", folder, folder);
done:
    cn_study_clear(&study);
    cn_world_free(world);
    cn_scene_free(scene);
    return status;
}

static const struct {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
} studies[] = {
    {"paper", "the first paper's method against the scene's own, from three states of a run", study_paper}};
#define NSTUDY (sizeof studies / sizeof *studies)

static int study_one(int argc, char **argv)
{
    for (size_t i = 0; argc > 0 && i < NSTUDY; i++)
        if (!strcmp(argv[0], studies[i].name)) return studies[i].run(argc - 1, argv + 1);
    if (argc > 0) fprintf(stderr, "catnav study: unknown study \"%s\"\n", argv[0]);
    fputs("usage: catnav study STUDY SCENE.yaml [options]; see catnav study --help\nstudies:\n", stderr);
    for (size_t i = 0; i < NSTUDY; i++)
        fprintf(stderr, "    %-8s %s\n", studies[i].name, studies[i].summary);
    return COMMAND_REFUSED;
}

static const char help[] =
    "NAME\n"
    "    catnav study - methods compared on a scene, by measurement\n\n"
    "SYNOPSIS\n"
    "    catnav study paper SCENE.yaml [--out DIR] [--set KEY=VALUE]... [--threads N] [--quiet]\n\n"
    "DESCRIPTION\n"
    "    paper   Runs the scene by its own method to its end, then again; at 25, 50 and 90 % of its steps "
    "both\n"
    "            its own method and the first paper's go on for 200 steps from the same state, in turns.\n"
    "            The paper's: contact.method project, solver.newton 1, solver.linear cg (to 1e-4, at most\n"
    "            1000 iterations), on the same mesh, assembly and threads.\n\n"
    "    The table, DIR/paper.csv and DIR/paper.json give for each state and method: steps taken, whether "
    "the\n"
    "    next one could not be computed; wall time of a step (solve, contact, recomputed residual) and its\n"
    "    ratio to the own method's; residual of the step's equation, recomputed, over the largest force "
    "norm;\n"
    "    iterations of the linear solver, solves that did not converge and the worst |b - A x| / |b| among\n"
    "    them; Newton iterations; crossing triangle pairs and points outside the free space, summed over "
    "the\n"
    "    steps; how far the tip is from the own method's at the end.\n\n"
    "OPTIONS\n"
    "    --out DIR        where CSV and JSON go (default: build/study)\n"
    "    --set KEY=VALUE  changes the scene before it is read, as in catnav run\n"
    "    --threads N      worker threads (default: one a core)\n"
    "    --quiet          prints errors only\n\n"
    "EXIT STATUS\n"
    "    0 measured (a method that fails is a result), 1 refused, 2 infeasible, 4 failed, 130 interrupted\n";

const command_t command_study = {"study", "compare methods on a scene by measurement", help, study_one};
