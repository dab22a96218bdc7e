/* study_write.c - a study as CSV for a spreadsheet and JSON for a program. */
#include "catnav/study.h"
#include "output.h"

#include <errno.h>
#include <jansson.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#ifndef CATNAV_VERSION
#define CATNAV_VERSION "unknown"
#endif

/* FOLDER/name, with FOLDER and those above it made. */
static cn_status place(char path[PATH_MAX], const char *folder, const char *name, cn_error *error)
{
    const int n = snprintf(path, PATH_MAX, "%s/%s", folder, name);
    if (!*folder || n < 0 || n >= PATH_MAX)
        return cn_fail(error, CN_ERR_ARG, folder, 0, "the study's folder needs a name shorter than %d",
                       PATH_MAX);
    for (char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        const int failed = mkdir(path, 0777) && errno != EEXIST, cause = errno;
        *slash = '/';
        if (failed)
            return cn_fail(error, cn_fault_file(cause), folder, 0, "the folder cannot be made: %s",
                           strerror(cause));
    }
    return CN_OK;
}

/* An undefined figure is an empty cell. */
static void cell(FILE *file, double value)
{
    if (isfinite(value))
        fprintf(file, ",%.9g", value);
    else
        fputc(',', file);
}

static void write_csv(FILE *file, const cn_study *study)
{
    fputs("fraction,step,time_s,free_nodes,method,steps,failure,step_ms_median,step_ms_p95,step_ms_p99,step_"
          "ms_max,ratio,"
          "fem_ms_median,collision_ms_median,residual_median,residual_max,linear_median,linear_max,"
          "unconverged,linear_residual_worst,newton_median,newton_max,rejected,intersections,outside_nodes,"
          "tip_apart_m\n",
          file);
    for (int i = 0; i < study->nstate; i++)
        for (int m = 0; m < CN_STUDY_METHODS; m++) {
            const cn_study_state *s = &study->state[i];
            const cn_study_row *r = &s->row[m];
            fprintf(file, "%g,%d,%.9g,%d,%s,%d,%s", s->fraction, s->step, s->time, s->free_nodes,
                    cn_study_method_name(m), r->steps, r->failure == CN_OK ? "" : cn_status_text(r->failure));
            const double first[] = {r->step_ms.median,
                                    r->step_ms.p95,
                                    r->step_ms.p99,
                                    r->step_ms.max,
                                    r->ratio,
                                    r->fem_ms.median,
                                    r->collision_ms.median,
                                    r->residual.median,
                                    r->residual.max,
                                    r->linear.median,
                                    r->linear.max,
                                    (double)r->unconverged,
                                    r->linear_residual,
                                    r->newton.median,
                                    r->newton.max,
                                    r->rejected,
                                    (double)r->intersections,
                                    (double)r->outside_nodes,
                                    r->tip_apart};
            for (size_t k = 0; k < sizeof first / sizeof *first; k++)
                cell(file, first[k]);
            fputc('\n', file);
        }
}

/* --- JSON: a NULL anywhere means out of memory, and json_pack then gives NULL for the whole --- */
static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *spread(cn_spread s)
{
    return json_pack("{s:o, s:o, s:o, s:o}", "median", number(s.median), "p95", number(s.p95), "p99",
                     number(s.p99), "max", number(s.max));
}

static json_t *row(int method, const cn_study_row *r)
{
    return json_pack("{s:s, s:i, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:I, s:o, s:i, s:I, s:I, s:o}",
                     "method", cn_study_method_name(method), "steps", r->steps, "failure",
                     r->failure == CN_OK ? json_null() : json_string(cn_status_text(r->failure)), "step_ms",
                     spread(r->step_ms), "fem_ms", spread(r->fem_ms), "collision_ms", spread(r->collision_ms),
                     "ratio", number(r->ratio), "residual", spread(r->residual), "linear", spread(r->linear),
                     "newton", spread(r->newton), "unconverged", (json_int_t)r->unconverged,
                     "linear_residual", number(r->linear_residual), "rejected", r->rejected, "intersections",
                     (json_int_t)r->intersections, "outside_nodes", (json_int_t)r->outside_nodes, "tip_apart",
                     number(r->tip_apart));
}

static json_t *state(const cn_study_state *s)
{
    json_t *rows = json_array();
    int failed = !rows;
    for (int m = 0; m < CN_STUDY_METHODS; m++)
        failed |= json_array_append_new(rows, row(m, &s->row[m]));
    json_t *json = failed ? NULL
                          : json_pack("{s:f, s:i, s:f, s:i, s:O}", "fraction", s->fraction, "step", s->step,
                                      "time", s->time, "free_nodes", s->free_nodes, "methods", rows);
    json_decref(rows);
    return json;
}

static char *json_of(const cn_study *study)
{
    const cn_report *r = &study->run;
    json_t *states = json_array(), *root = NULL;
    int failed = !states;
    for (int i = 0; i < study->nstate; i++)
        failed |= json_array_append_new(states, state(&study->state[i]));
    if (!failed)
        root = json_pack("{s:s, s:s, s:s%, s:i, s:i, s:{s:s, s:i, s:o, s:o, s:i, s:i}, s:O}", "catnav",
                         CATNAV_VERSION, "study", "paper", "scene", r->scene, strlen(r->scene), "threads",
                         r->threads, "steps", CN_STUDY_STEPS, "run", "verdict",
                         cn_verdict_name(r->verdict.code), "steps", r->steps, "simulated_s",
                         number(r->time.simulated_s), "step_ms", spread(r->time.step_ms), "nodes",
                         r->counts.nodes, "tets", r->counts.tets, "states", states);
    char *json = root ? json_dumps(root, JSON_INDENT(2)) : NULL;
    json_decref(root);
    json_decref(states);
    return json;
}

cn_status cn_study_write(const cn_study *study, const char *folder, cn_error *error)
{
    char path[PATH_MAX];
    cn_output output;
    cn_status status = place(path, folder, "paper.csv", error);
    if (status == CN_OK) status = cn_output_open(&output, path, error);
    if (status != CN_OK) return status;
    write_csv(output.file, study);
    if ((status = cn_output_commit(&output, error)) != CN_OK) return status;

    char *json = json_of(study);
    if (!json) return cn_fail(error, CN_ERR_MEMORY, folder, 0, "out of memory while the study is written");
    status = place(path, folder, "paper.json", error);
    if (status == CN_OK) status = cn_output_open(&output, path, error);
    if (status == CN_OK) {
        fputs(json, output.file);
        fputc('\n', output.file);
        status = cn_output_commit(&output, error);
    }
    free(json);
    return status;
}
