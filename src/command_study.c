/* catnav study: accuracy, stability and speed into a folder (by scripts/study), and methods compared on a
 * scene. */
#include "command.h"
#include "catnav/study.h"
#include "catnav/world.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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
                printf("%.0f %%, %s: step %d cannot be computed (%s)\n", 100 * study->state[i].fraction,
                       cn_study_method_name(m), r->steps + 1, cn_status_text(r->failure));
        }
}

static int study_paper(int argc, char **argv)
{
    static settings_t settings;
    const char *scene_file, *folder = "build/study";
    int threads = command_threads(), steps = 0, total = 0;
    bool quiet = false;
    const option_t options[] = {{"--out", OPTION_TEXT, &folder},
                                {"--steps", OPTION_COUNT, &steps},
                                {"--total", OPTION_COUNT, &total},
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
    const cn_study_hooks hooks = {
        .progress = bar ? show_progress : NULL, .cancel = &command_cancel, .steps = steps, .total = total};
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

/* Where the Python program lies, seen from the folder of this executable: installed, or in a build folder of
 * the sources; at last where the sources were when it was built. */
static bool find_program(const char *name, char *program, size_t size, char *self, size_t self_size)
{
    static const char *const places[] = {"../../share/catnav/scripts", "../../../../scripts"};
    const ssize_t length = readlink("/proc/self/exe", self, self_size - 1);
    if (length <= 0) return false;
    self[length] = 0;
    const int folder = (int)(strrchr(self, '/') - self);
    for (size_t i = 0; i < sizeof places / sizeof *places; i++)
        if (snprintf(program, size, "%.*s/%s/study/%s", folder, self, places[i], name) < (int)size &&
            !access(program, R_OK))
            return true;
#ifdef CATNAV_SCRIPTS
    if (snprintf(program, size, "%s/study/%s", CATNAV_SCRIPTS, name) < (int)size && !access(program, R_OK))
        return true;
#endif
    fprintf(stderr, "catnav study: scripts/study/%s is not where this command was built or installed\n",
            name);
    return false;
}

/* The program takes this process's place, so that signals and status are its own. words: room for a NULL. */
static int become(const char **words, int n)
{
    words[n] = NULL;
    execv("/usr/bin/python3", (char *const *)words);
    fprintf(stderr, "catnav study: /usr/bin/python3: %s\n", strerror(errno));
    return COMMAND_FAILED;
}

/* Everything into a folder. */
static int study_all(int argc, char **argv)
{
    static char program[PATH_MAX], self[PATH_MAX], count[16];
    const char *folder, *only = NULL;
    int threads = command_threads(), n = 0;
    bool quick = false, every_cell = false;
    const option_t options[] = {{"--quick", OPTION_FLAG, &quick},
                                {"--every-cell", OPTION_FLAG, &every_cell},
                                {"--only", OPTION_TEXT, &only},
                                {"--threads", OPTION_COUNT, &threads},
                                {0}};
    const char *words[16];

    if (!command_options(&command_study, argc, argv, options, "DIR", &folder)) return COMMAND_REFUSED;
    if (!find_program("study.py", program, sizeof program, self, sizeof self)) return COMMAND_FAILED;
    snprintf(count, sizeof count, "%d", threads);
    words[n++] = "python3", words[n++] = program;
    words[n++] = "--catnav", words[n++] = self;
    words[n++] = "--threads", words[n++] = count;
    if (quick) words[n++] = "--quick";
    if (every_cell) words[n++] = "--every-cell";
    if (only) words[n++] = "--only", words[n++] = only;
    words[n++] = "--", words[n++] = folder;
    return become(words, n);
}

/* A program of its own, whose options are its own. */
static int study_program(const char *file, int argc, char **argv)
{
    static char program[PATH_MAX], self[PATH_MAX];
    const char *words[32];
    int n = 0;
    for (int i = 0; i < argc; i++)
        if (!strcmp(argv[i], "--help"))
            return fputs(command_study.help, stdout) < 0 ? COMMAND_FAILED : COMMAND_OK;
    if (argc > 24) {
        fprintf(stderr, "catnav study: too many options for %s\n", file);
        return COMMAND_REFUSED;
    }
    if (!find_program(file, program, sizeof program, self, sizeof self)) return COMMAND_FAILED;
    words[n++] = "python3", words[n++] = program;
    words[n++] = "--catnav", words[n++] = self;
    for (int i = 0; i < argc; i++)
        words[n++] = argv[i];
    return become(words, n);
}

/* Collision detection against the number of triangles, as CSV. */
static int study_detection(int argc, char **argv)
{
    const option_t options[] = {{0}};
    const char *word;
    char *end;
    if (!command_options(&command_study, argc, argv, options, "TRIANGLES", &word)) return COMMAND_REFUSED;
    const double most = strtod(word, &end);
    if (*end || !(most >= 1000 && most <= 1e8)) {
        fprintf(stderr, "catnav study detection: TRIANGLES is a number from 1000 to 1e8, not %s\n", word);
        return COMMAND_REFUSED;
    }
    puts("triangles,pairs,build_ms,refit_ms,query_ms");
    for (double ntri = 1000; ntri <= most * (1 + 1e-9); ntri *= 3.1622776601683795) {
        cn_detection_cost cost;
        const cn_status status = cn_study_detection((int)ntri, &cost);
        if (status != CN_OK) {
            fprintf(stderr, "catnav study: %.0f triangles: %s\n", ntri, cn_status_text(status));
            return COMMAND_FAILED;
        }
        printf("%d,%ld,%.6g,%.6g,%.6g\n", cost.ntri, cost.pairs, cost.build_ms, cost.refit_ms, cost.query_ms);
    }
    return COMMAND_OK;
}

/* Cook's membrane against its mesh, as CSV. */
static int study_cook(int argc, char **argv)
{
    int cells = 32;
    bool stress = false;
    const option_t options[] = {{"--cells", OPTION_COUNT, &cells}, {"--stress", OPTION_FLAG, &stress}, {0}};
    const char *word;
    char *end;
    if (!command_options(&command_study, argc, argv, options, "POISSON", &word)) return COMMAND_REFUSED;
    const double poisson = strtod(word, &end);
    if (*end || !(poisson >= 0 && poisson < 0.5) || cells < 2 || cells > 256) {
        fprintf(stderr,
                "catnav study cook: POISSON is a number from 0 to below 0.5, --cells one from 2 to 256\n");
        return COMMAND_REFUSED;
    }
    puts("model,cells,nodes,dof,corner,middle,seconds");
    for (int quadratic = 0; quadratic <= 1; quadratic++)
        for (int n = 2; n <= (quadratic ? cells / 2 : cells); n *= 2) {
            cn_cook cook;
            const cn_status status = cn_study_cook(n, quadratic, !stress, poisson, &cook);
            if (status != CN_OK) {
                fprintf(stderr, "catnav study: %d cells: %s\n", n, cn_status_text(status));
                return COMMAND_FAILED;
            }
            printf("%s,%d,%d,%d,%.9g,%.9g,%.6g\n", quadratic ? "tet10" : "tet4", n, cook.nodes, cook.dof,
                   cook.corner, cook.middle, cook.seconds);
        }
    return COMMAND_OK;
}

static int study_one(int argc, char **argv)
{
    if (argc > 0 && !strcmp(argv[0], "table1")) return study_program("table1.py", argc - 1, argv + 1);
    if (argc > 0 && !strcmp(argv[0], "soak")) return study_program("soak.py", argc - 1, argv + 1);
    if (argc > 0 && !strcmp(argv[0], "device")) return study_program("device.py", argc - 1, argv + 1);
    if (argc > 0 && !strcmp(argv[0], "skin")) {
        for (int i = 1; i < argc; i++)
            if (!strcmp(argv[i], "--help"))
                return fputs(command_study.help, stdout) < 0 ? COMMAND_FAILED : COMMAND_OK;
        return command_study_skin(argc - 1, argv + 1);
    }
    if (argc > 0 && !strcmp(argv[0], "detection")) return study_detection(argc - 1, argv + 1);
    if (argc > 0 && !strcmp(argv[0], "cook")) return study_cook(argc - 1, argv + 1);
    if (argc > 0) return strcmp(argv[0], "paper") ? study_all(argc, argv) : study_paper(argc - 1, argv + 1);
    fputs("usage: catnav study DIR [options], or catnav study paper SCENE.yaml [options];\n"
          "see catnav study --help\n",
          stderr);
    return COMMAND_REFUSED;
}

static const char help[] =
    "NAME\n"
    "    catnav study - accuracy, stability and speed, measured\n\n"
    "SYNOPSIS\n"
    "    catnav study DIR [--quick] [--only PART] [--every-cell] [--threads N]\n"
    "    catnav study paper SCENE.yaml [--out DIR] [--set KEY=VALUE]... [--steps N] [--total N]\n"
    "        [--threads N] [--quiet]\n"
    "    catnav study device SCENE.yaml [--closeness E] [--seconds S] [--out DIR] [--threads N]\n"
    "    catnav study detection TRIANGLES\n"
    "    catnav study cook POISSON [--cells N] [--stress]\n"
    "    catnav study table1 [--scenes NAME,...] [--seconds S] [--steps N] [--states N] [--whole]\n"
    "        [--out DIR] [--threads N]\n"
    "    catnav study skin speed|bezier|smooth [REPEATS]\n"
    "    catnav study skin shape ANCHORS\n"
    "    catnav study soak LOG.csv [--out DIR]\n\n"
    "DESCRIPTION\n"
    "    DIR     Error against run time for every body model, solver, integrator and the first paper's\n"
    "            method on problems with known answers; contact beside theory (wall forces in a bend, push,\n"
    "            friction, buckling in a tube, pressed and bouncing bodies); strict, project and penalty\n"
    "            side by side, and in hard cases; what happens under extreme stiffness, steps,\n"
    "            elements, start states and units; step times beside the paper's, cost against size; what\n"
    "            was left out and what that changed. Pictures as SVG and PNG, with CSV and JSON beside\n"
    "            them, in every row the command that repeats it, and DIR/index.md to read it all.\n"
    "            Takes up to half an hour. (A folder named paper is given as ./paper.)\n\n"
    "    paper   Runs the scene by its own method to its end, then again; at 25, 50 and 90 % of its\n"
    "            steps both its own method and the first paper's go on for 200 steps from the same state,\n"
    "            in turns. The paper's: contact.method project, solver.newton 1, solver.linear cg (to\n"
    "            1e-4, at most 1000 iterations), on the same mesh, assembly and threads.\n"
    "            The table, DIR/paper.csv and DIR/paper.json give for each state and method: steps taken,\n"
    "            whether the next one could not be computed; wall time of a step (solve, contact,\n"
    "            recomputed residual) and its ratio to the own method's; residual of the step's equation,\n"
    "            recomputed, over the largest force norm; iterations of the linear solver, solves that did\n"
    "            not converge and the worst |b - A x| / |b| among them; Newton iterations; crossing\n"
    "            triangle pairs and points outside the free space, summed over the steps; how far the tip\n"
    "            is from the own method's at the end.\n\n"
    "    device  Runs the scene with thicker and stiffer devices than its own, as many at a time as there "
    "are\n"
    "            threads, until the largest diameter and the largest Young's modulus that reach the target\n"
    "            within the limits are known to E, and says what stops the next one. Every run with its\n"
    "            verdict in DIR/device.csv and DIR/device.json; picture DIR/device.svg and .png.\n\n"
    "    detection\n"
    "            Prints as CSV what building, refitting and querying the AABB tree of surfaces costs, from\n"
    "            1,000 to TRIANGLES triangles.\n\n"
    "    cook    Prints as CSV the deflection of Cook's membrane by tet4 with 2 to N cells a side (32) and "
    "by\n"
    "            tet10 with half as many, in plane strain or --stress, E and force 1, and the time it "
    "took.\n\n"
    "    table1  Runs the first paper's scenes (bear, snake, fish, artery) whole by their own method; the\n"
    "            paper's goes on from three states of that run (--whole: from its start to its end). Prints\n"
    "            its Table 1 with our columns beside it, what is reckoned from those steps marked by ~:\n"
    "            nodes, planning, simulation, collision, milliseconds a step; DIR/table1.csv and\n"
    "            DIR/table1.json. A scene that is not there is left out and said. Takes some minutes a\n"
    "            scene.\n\n"
    "    skin    Skins alone, as CSV: the time of an update with normals against vertices, anchors a\n"
    "            vertex and threads; frames a second of Bezier skins against control points and\n"
    "            intervals, beside a skin of as many vertices; the sharpest edge of bent capsules\n"
    "            against anchors a vertex; and the shape of one of them.\n\n"
    "    soak    Memory, handles and time of a step against time, of the log that a soak of the node left\n"
    "            (python3 scripts/ros/hammer.py soak --out DIR): DIR/soak.svg, .png and .csv.\n\n"
    "OPTIONS\n"
    "    --quick          the same on fewer and smaller cases, in a minute\n"
    "    --every-cell     the whole stability grid with every solver, not a part of it: an hour\n"
    "    --only PART      accuracy, theory, contact, stability, speed, detection, left_out, skin or soak\n"
    "                     alone\n"
    "    --scenes NAME,.. of table1: these alone\n"
    "    --seconds S      of table1 and device: wall time that one run may take (default: 900)\n"
    "    --closeness E    of device: largest that passes and least that does not, relative (default: 0.05)\n"
    "    --steps N        of table1: of every run the first N steps alone; of paper: from each state, at\n"
    "                     most 200 (default)\n"
    "    --states N       of table1: steps of the paper's method from each state (default: 50)\n"
    "    --total N        of paper: accepted steps of the run, where they are known: it runs once then\n"
    "    --out DIR        of paper, table1, device and soak: where tables go (default: build/study)\n"
    "    --set KEY=VALUE  of paper: changes the scene before it is read, as in catnav run\n"
    "    --threads N      worker threads (default: one a core)\n"
    "    --quiet          of paper: prints errors only\n\n"
    "EXIT STATUS\n"
    "    0 measured (a method that fails is a result), 1 refused, 2 infeasible, 4 failed (also where a\n"
    "    cell of the stability table is not finite, hangs or crashes), 130 interrupted\n";

const command_t command_study = {
    "study", "measure accuracy, stability and speed, or compare methods on a scene", help, study_one};
