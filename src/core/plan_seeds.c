/* plan_seeds.c - the path that is driven: planned with several seeds side by side, the best kept. */
#include "plan_smooth.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "pool.h"

static const double pi = 3.14159265358979323846;

/* What one seed came to. */
typedef struct {
    cn_plan_query query;
    cn_planner planner;
    cn_path *path;
    cn_roadmap roadmap;
    cn_error error;
    cn_status status;
} attempt;

static void plan_one(void *user, int i)
{
    attempt *a = (attempt *)user + i;
    a->status = cn_plan_once(&a->path, &a->query, a->planner, &a->roadmap, &a->error);
}

/* What the spec wants little of: length, bending (angles squared over length), or lack of room. */
static double cost_of(const cn_path *path, cn_cost cost)
{
    double least = INFINITY, bending = 0;
    if (cost == CN_COST_LENGTH) return cn_path_length(path);
    for (int i = 0; i < path->n; i++) {
        double u[3], v[3];
        least = fmin(least, path->clearance[i]);
        if (i == 0 || i + 1 == path->n) continue;
        cn_sub(path->x + 3 * i, path->x + 3 * (i - 1), u);
        cn_sub(path->x + 3 * (i + 1), path->x + 3 * i, v);
        const double lu = cn_normalise(u), lv = cn_normalise(v);
        const double theta = acos(fmin(1, fmax(-1, cn_dot(u, v))));
        if (lu > 0 && lv > 0) bending += 2 * theta * theta / (lu + lv);
    }
    return cost == CN_COST_CLEARANCE ? -least : bending;
}

/* True where a is to be kept rather than b, which comes before it: gentle enough, or gentler; then by cost.
 */
static bool better(const attempt *a, const attempt *b)
{
    if (a->status != CN_OK || b->status != CN_OK) return a->status == CN_OK && b->status != CN_OK;
    const cn_path_spec *spec = a->query.spec;
    const double turn = fmax(a->path->turn_max, spec->max_turn),
                 least = fmax(b->path->turn_max, spec->max_turn);
    if (turn != least) return turn < least;
    return cost_of(a->path, spec->cost) < cost_of(b->path, spec->cost);
}

static void warn_of_turn(const cn_plan_query *query, const cn_path *path)
{
    cn_place place;
    double where;
    if (!(cn_path_turn(path, cn_plan_chord(query), &where) > query->spec->max_turn)) return;
    cn_path_at(path, where, &place);
    CN_LOG(CN_LOG_WARNING,
           "the path turns %.1f degrees at (%.4g, %.4g, %.4g) mm, more than the %.1f asked for: "
           "no gentler way was found",
           path->turn_max * 180 / pi, 1e3 * place.x[0], 1e3 * place.x[1], 1e3 * place.x[2],
           query->spec->max_turn * 180 / pi);
}

cn_status cn_plan_path(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error)
{
    const int n = query->seeds > 1 ? query->seeds : 1, threads = query->threads < n ? query->threads : n;
    attempt *all = calloc((size_t)n, sizeof *all), *best = all;
    cn_pool *pool = NULL;
    bool cut = false;
    cn_status status = CN_ERR_MEMORY;

    *out = NULL;
    memset(roadmap, 0, sizeof *roadmap);
    if (!all || (threads > 1 && (status = cn_pool_new(&pool, threads)) != CN_OK)) {
        cn_fail(error, status, NULL, 0, "%s while a path was planned", cn_status_text(status));
        goto done;
    }
    for (int i = 0; i < n; i++) { /* the first is the query's own seed */
        all[i].query = *query, all[i].planner = planner;
        all[i].query.seed = query->seed + 0x9e3779b9u * (unsigned)i;
    }
    cn_pool_run(pool, n, plan_one, all);
    for (int i = 0; i < n; i++) {
        cut = cut || all[i].status == CN_ERR_TIMEOUT ||
              (all[i].status == CN_OK && !all[i].roadmap.reproducible);
        if (i > 0 && better(&all[i], best)) best = &all[i];
    }
    *out = best->path, *roadmap = best->roadmap, status = best->status;
    roadmap->seed = best->query.seed;
    if (status == CN_OK)
        roadmap->reproducible = !cut, warn_of_turn(query, *out);
    else if (error)
        *error = best->error;
    for (attempt *a = all; a < all + n; a++)
        if (a != best) cn_path_free(a->path), cn_roadmap_clear(&a->roadmap);
done:
    cn_pool_free(pool);
    free(all);
    return status;
}
