/* The report as JSON, key for key the contract's. */
#include "catnav/report.h"
#include "output.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#ifndef CATNAV_VERSION
#define CATNAV_VERSION "unknown"
#endif

#define VERDICT_NAME(name, status, exit)   #name,
#define VERDICT_STATUS(name, status, exit) status,
#define VERDICT_EXIT(name, status, exit)   exit,
static const char *const names[] = {CN_VERDICT_LIST(VERDICT_NAME)};
static const char *const statuses[] = {CN_VERDICT_LIST(VERDICT_STATUS)};
static const int exits[] = {CN_VERDICT_LIST(VERDICT_EXIT)};

static int known(int code)
{
    return code >= 0 && code < CN_VERDICT_COUNT ? code : CN_VERDICT_UNKNOWN;
}
const char *cn_verdict_name(int code)
{
    return names[known(code)];
}
const char *cn_verdict_status(int code)
{
    return statuses[known(code)];
}
int cn_verdict_exit(int code)
{
    return exits[known(code)];
}

void cn_report_clear(cn_report *report)
{
    free(report->limit);
    free(report->drive.insertion);
    free(report->body);
    memset(report, 0, sizeof *report);
}

/* --- JSON: a NULL anywhere means out of memory, and json_pack then gives NULL for the whole --- */
static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}
static json_t *index_or_null(int value)
{
    return value >= 0 ? json_integer(value) : json_null();
}
static json_t *point(const double x[3])
{
    return json_pack("[ooo]", number(x[0]), number(x[1]), number(x[2]));
}

static json_t *place(const double x[3]) /* undefined as a whole */
{
    return isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]) ? point(x) : json_null();
}

static json_t *
text(const char *string) /* text cut within a character, or not UTF-8 at all, is made printable */
{
    json_t *json = json_string(string);
    if (json) return json;
    char *copy = strdup(string);
    for (char *c = copy; c && *c; c++)
        if (*c & 0x80) *c = '?';
    json = copy ? json_string(copy) : NULL;
    free(copy);
    return json;
}

static json_t *spread(cn_spread s)
{
    return json_pack("{s:o, s:o, s:o, s:o}", "median", number(s.median), "p95", number(s.p95), "p99",
                     number(s.p99), "max", number(s.max));
}

static const char *model_name(cn_body_model model)
{
    static const char *const models[] = {"tet4", "tet10", "rod", "molecules"};
    return (unsigned)model < sizeof models / sizeof *models ? models[model] : "unknown";
}

static const char *reduce_name(cn_reduce reduce)
{
    return reduce == CN_REDUCE_MEAN ? "mean" : "max";
}

static json_t *verdict(const cn_verdict *v)
{
    return json_pack(
        "{s:s, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "code", cn_verdict_name(v->code),
        "fault", v->fault ? json_string(cn_fault_name(v->fault)) : json_null(), "message", text(v->message),
        "quantity", v->has_quantity ? text(cn_quantity_name(v->quantity)) : json_null(), "value",
        v->has_quantity ? number(v->value) : json_null(), "limit",
        v->has_quantity ? number(v->limit) : json_null(), "body", *v->body ? text(v->body) : json_null(),
        "element", index_or_null(v->element), "position", place(v->position), "step", index_or_null(v->step),
        "time", number(v->time), "waypoint", index_or_null(v->waypoint));
}

static json_t *times(const cn_report *r)
{
    return json_pack("{s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "map_s",
                     number(r->time.map_s), "planning_s", number(r->time.planning_s), "simulation_s",
                     number(r->time.simulation_s), "collision_s", number(r->time.collision_s), "wall_s",
                     number(r->time.wall_s), "simulated_s", number(r->time.simulated_s), "real_time_factor",
                     number(r->time.real_time_factor), "fem_ms", spread(r->time.fem_ms), "collision_ms",
                     spread(r->time.collision_ms), "step_ms", spread(r->time.step_ms), "step_ms_last100",
                     spread(r->time.step_ms_last100));
}

static json_t *limit(const cn_limit_report *l)
{
    return json_pack("{s:o, s:s, s:s, s:o, s:o, s:{s:o, s:o, s:o, s:o}}", "body", text(l->body), "quantity",
                     cn_quantity_name(l->limit.quantity), "reduce", reduce_name(l->limit.reduce), "limit",
                     number(l->limit.limit), "worst", number(l->worst), "at", "step", index_or_null(l->step),
                     "time", number(l->time), "element", index_or_null(l->element), "position",
                     place(l->position));
}

static json_t *stiffness_error(const cn_body_report *b)
{
    if (!isfinite(b->error_bending) && !isfinite(b->error_torsion) && !isfinite(b->error_axial))
        return json_null();
#define BESIDES(way) number((1 + b->error_##way) / (1 + b->polygon_##way) - 1)
    return json_pack("{s:o, s:o, s:o, s:{s:o, s:o, s:o}, s:{s:o, s:o, s:o}}", "bending",
                     number(b->error_bending), "torsion", number(b->error_torsion), "axial",
                     number(b->error_axial), "polygon", "bending", number(b->polygon_bending), "torsion",
                     number(b->polygon_torsion), "axial", number(b->polygon_axial), "element", "bending",
                     BESIDES(bending), "torsion", BESIDES(torsion), "axial", BESIDES(axial));
#undef BESIDES
}

static json_t *body(const cn_body_report *b)
{
    return json_pack("{s:o, s:s, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}", "name",
                     text(b->name), "model", model_name(b->model), "tip", point(b->tip), "goal",
                     point(b->goal), "goal_distance", number(b->goal_distance), "com", point(b->com),
                     "rest_volume", number(b->rest_volume), "volume", number(b->volume), "energy",
                     number(b->energy), "kinetic", number(b->kinetic), "momentum", point(b->momentum),
                     "angular_momentum", point(b->angular_momentum), "shape_error", number(b->shape_error),
                     "stiffness_error", stiffness_error(b));
}

static json_t *left_out(const cn_left_out *l)
{
    return json_pack("{s:s, s:o, s:o, s:o}", "what", l->what ? l->what : "", "why", text(l->why),
                     "time_saved_s", number(l->time_saved_s), "error", number(l->error));
}

static json_t *insertion(const cn_report *r, const cn_insertion *i)
{
    return json_pack("{s:o, s:o, s:o, s:o, s:o}", "body", text(r->body[i->body].name), "time",
                     number(i->time), "advance", number(i->advance), "twist", number(i->twist), "curvature",
                     number(i->curvature));
}

/* Appends to a list; both may be NULL. */
static int append(json_t *list, json_t *entry)
{
    return json_array_append_new(list, entry);
}

char *cn_report_json(const cn_report *r)
{
    json_t *limits = json_array(), *bodies = json_array(), *out = json_array(), *base = json_array(),
           *root = NULL;
    char *json = NULL;
    int failed = !limits || !bodies || !out || !base;

    for (int i = 0; i < r->nlimit; i++)
        failed |= append(limits, limit(&r->limit[i]));
    for (int i = 0; i < r->nbody; i++)
        failed |= append(bodies, body(&r->body[i]));
    for (int i = 0; i < r->nleft_out; i++)
        failed |= append(out, left_out(&r->left_out[i]));
    for (int i = 0; i < r->drive.ninsertion; i++)
        failed |= append(base, insertion(r, &r->drive.insertion[i]));
    if (!failed)
        root = json_pack(
            "{s:s, s:o, s:I, s:i, s:b, s:s, s:o," /* what ran, and the answer */
            " s:{s:i, s:i, s:i, s:i, s:i, s:i}, s:o, s:i, s:i, s:i,"
            " s:{s:o, s:I, s:I, s:o, s:o}, s:{s:o, s:o, s:O}, s:O, s:{s:i, s:i, s:o, s:i}, s:O, s:O,"
            " s:{s:o, s:o, s:o, s:I}, s:I}",
            "catnav", CATNAV_VERSION, "scene", text(r->scene), "seed", (json_int_t)r->seed, "threads",
            r->threads, "reproducible", (int)r->reproducible, "status", cn_verdict_status(r->verdict.code),
            "verdict", verdict(&r->verdict), "counts", "nodes", r->counts.nodes, "dof", r->counts.dof, "tets",
            r->counts.tets, "rigid_nodes", r->counts.rigid_nodes, "deformable_nodes",
            r->counts.deformable_nodes, "wall_triangles", r->counts.wall_triangles, "time", times(r), "steps",
            r->steps, "rejected_steps", r->rejected_steps, "replans", r->replans, "contact", "gap_min",
            number(r->contact.gap_min), "intersections", (json_int_t)r->contact.intersections,
            "outside_nodes", (json_int_t)r->contact.outside_nodes, "force_max", number(r->contact.force_max),
            "momentum_error", number(r->contact.momentum_error), "drive", "force_max",
            number(r->drive.force_max), "work", number(r->drive.work), "insertion", base, "limits", limits,
            "solver", "newton_max", r->solver.newton_max, "linear_max", r->solver.linear_max, "residual_max",
            number(r->solver.residual_max), "inverted_max", r->solver.inverted_max, "bodies", bodies,
            "left_out", out, "path", "length", number(r->path.length), "clearance_min",
            number(r->path.clearance_min), "turn_max", number(r->path.turn_max), "seed",
            (json_int_t)r->path.seed, "memory_peak_bytes", (json_int_t)r->memory_peak_bytes);
    if (root) json = json_dumps(root, JSON_INDENT(2));
    json_decref(root);
    json_decref(limits);
    json_decref(bodies);
    json_decref(out);
    json_decref(base);
    return json;
}

cn_status cn_report_write(const cn_report *report, const char *path, cn_error *error)
{
    cn_output output;
    char *json = cn_report_json(report);
    if (!json) return cn_fail(error, CN_ERR_MEMORY, path, 0, "out of memory while the report is written");
    cn_status status = cn_output_open(&output, path, error);
    if (status == CN_OK) {
        fputs(json, output.file);
        fputc('\n', output.file);
        status = cn_output_commit(&output, error);
    }
    free(json);
    return status;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The smallest sample that at least `percent` of them do not exceed. */
static double quantile(long long n, const double *ascending_samples, int percent)
{
    return ascending_samples[(n * percent + 99) / 100 - 1];
}

cn_spread cn_spread_of(int n, double *samples)
{
    if (n <= 0) return (cn_spread){NAN, NAN, NAN, NAN};
    qsort(samples, (size_t)n, sizeof *samples, ascending);
    return (cn_spread){.median = 0.5 * (samples[(n - 1) / 2] + samples[n / 2]),
                       .p95 = quantile(n, samples, 95),
                       .p99 = quantile(n, samples, 99),
                       .max = samples[n - 1]};
}

size_t cn_memory_peak(void)
{
    char line[128];
    unsigned long kib = 0;
    FILE *file = fopen("/proc/self/status", "r");
    while (file && fgets(line, sizeof line, file))
        if (sscanf(line, "VmHWM: %lu", &kib) == 1) break;
    if (file) fclose(file);
    struct rusage usage;
    if (kib == 0 && getrusage(RUSAGE_SELF, &usage) == 0) kib = (unsigned long)usage.ru_maxrss;
    return (size_t)kib * 1024;
}
