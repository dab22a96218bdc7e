/* plan.c - from a planner's polyline to the path that is driven: checks at the door, what planners ask about
 * free space, shortcuts, and the measures of the finished path. Smoothing: plan_smooth.c; sinusoids:
 * plan_deviate.c. */
#include "plan_smooth.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "tree.h"

void cn_roadmap_clear(cn_roadmap *roadmap)
{
    if (!roadmap) return;
    free(roadmap->x);
    free(roadmap->leg);
    free(roadmap->vertex);
    free(roadmap->edge);
    memset(roadmap, 0, sizeof *roadmap);
}

double cn_plan_clearance(const cn_plan_query *query, const double p[3], double enough)
{
    const double bound = cn_map_clearance(query->world->map, p);
    if (bound >= enough) return bound;
    if (!(bound > 0) && !cn_world_free_at(query->world, p)) return 0;
    return cn_world_distance(query->world, p, NULL, NULL, NULL);
}

/* Distance from c to the segment a b. */
static double segment_distance(const double a[3], const double b[3], const double c[3])
{
    double ab[3], ac[3], p[3];
    cn_sub(b, a, ab);
    cn_sub(c, a, ac);
    const double l2 = cn_norm2(ab), t = l2 > 0 ? fmin(1, fmax(0, cn_dot(ab, ac) / l2)) : 0;
    for (int k = 0; k < 3; k++)
        p[k] = a[k] + t * ab[k];
    return cn_distance(p, c);
}

bool cn_plan_edge_free(const cn_plan_query *query, const double a[3], const double b[3], double need,
                       double slack)
{
    const double length = cn_distance(a, b), cell = cn_map_cell(query->world->map);
    const double finest = need > 0 ? need / 100 : cell / 4;

    for (int i = 0; i < query->nrefused; i++)
        if (!(segment_distance(a, b, query->refused[i].centre) >= query->refused[i].radius)) return false;
    for (double s = 0;;) {
        const double t = length > 0 ? s / length : 0;
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = a[k] + t * (b[k] - a[k]);
        const double clearance = cn_plan_clearance(query, p, need + cell);
        if (!(clearance >= need)) return false;
        double outside = cn_plan_region(query, p, NULL);
        if (!(outside <= slack)) return false;
        if (s >= length) return true;
        double step = clearance - need;
        if (query->spec->region != CN_REGION_NONE) step = fmin(step, slack - outside); /* 1-Lipschitz too */
        s = fmin(length, s + fmax(step, finest));
    }
}

static const cn_wall *wall_named(const cn_world *world, const char *name)
{
    for (int i = 0; name && i < world->nwall; i++)
        if (world->wall[i].name && !strcmp(world->wall[i].name, name)) return &world->wall[i];
    return NULL;
}

double cn_plan_region(const cn_plan_query *query, const double p[3], double toward[3])
{
    const cn_path_spec *spec = query->spec;
    double back[3] = {0, 0, 0}, outside = 0;

    if (spec->region == CN_REGION_PLANE) {
        double normal[3], d[3];
        cn_copy3(spec->plane_normal, normal);
        cn_normalise(normal);
        cn_sub(spec->plane_point, p, d);
        const double height = cn_dot(d, normal);
        cn_axpy(height, normal, back);
    } else if (spec->region == CN_REGION_BOX) {
        for (int k = 0; k < 3; k++)
            back[k] = fmin(fmax(p[k], spec->box[0][k]), spec->box[1][k]) - p[k];
    } else if (spec->region == CN_REGION_BAND) {
        const cn_wall *wall = wall_named(query->world, spec->band_surface);
        double nearest[3];
        if (!wall) return INFINITY;
        const double d = cn_tree_nearest(wall->tree, p, INFINITY, NULL, nearest);
        cn_sub(p, nearest, back);
        cn_normalise(back);
        const double move = fmin(fmax(d, spec->band_min), spec->band_max) - d;
        for (int k = 0; k < 3; k++)
            back[k] *= move;
    }
    outside = cn_normalise(back);
    if (toward) cn_copy3(back, toward);
    return outside;
}

double cn_plan_region_slack(const cn_plan_query *query)
{
    double slack = cn_map_cell(query->world->map);
    for (int i = 0; i < query->npoint; i++)
        slack = fmax(slack, 1.001 * cn_plan_region(query, query->point + 3 * i, NULL));
    return slack;
}

static const char *point_name(int i, char text[32])
{
    if (i == 0) return "the start";
    snprintf(text, 32, "waypoint %d", i - 1);
    return text;
}

/* Refuses what no planner can answer: numbers out of range, points without room for the device. */
static cn_status check(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    const cn_path_spec *spec = query->spec;
    const double need = query->radius + spec->clearance;
    char text[32];

    if (!query->world->map) return cn_fail(error, CN_ERR_ARG, NULL, 0, "planning needs the world's map");
    if (!(query->radius >= 0 && query->radius < INFINITY && spec->clearance >= 0 &&
          spec->clearance < INFINITY))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                       "radius and clearance must be finite and not negative");
    if (!(spec->max_turn > 0)) return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "max_turn must be above 0");
    if (query->npoint < 2)
        return cn_fail(error, CN_FAULT_TOO_FEW, NULL, 0, "a path needs a start and a waypoint");
    if (spec->region == CN_REGION_BAND && !wall_named(query->world, spec->band_surface))
        return cn_fail(error, CN_FAULT_OPTION, NULL, 0, "path.region.band: no surface is named \"%s\"",
                       spec->band_surface ? spec->band_surface : "");
    for (int i = 0; i < 3 * query->npoint; i++)
        if (!isfinite(query->point[i]))
            return cn_fail(error, CN_FAULT_VALUE, NULL, 0, "%s is not finite", point_name(i / 3, text));
    for (int i = 0; i < query->npoint; i++) {
        const double *p = query->point + 3 * i, room = cn_plan_clearance(query, p, need);
        const char *why = NULL;
        if (!(room >= need)) why = room > 0 ? "has too little room" : "is outside the free space";
        for (int j = 0; j < query->nrefused && !why; j++)
            if (!(cn_distance(p, query->refused[j].centre) >= query->refused[j].radius))
                why = "lies where a limit was broken";
        if (!why) continue;
        cn_copy3(p, roadmap->pinch);
        roadmap->pinch_radius = room;
        roadmap->failed_leg = i > 0 ? i - 1 : 0;
        return cn_fail(error, CN_ERR_NO_PATH, NULL, 0,
                       "%s at (%.4g, %.4g, %.4g) mm %s: %.4g mm to the wall, the device needs %.4g mm",
                       point_name(i, text), 1e3 * p[0], 1e3 * p[1], 1e3 * p[2], why, 1e3 * room, 1e3 * need);
    }
    return CN_OK;
}

/* Leaves out polyline vertices wherever the straight way has as much room as the way around, up to what the
 * device likes. The reach is doubled from each vertex kept: not the farthest is sought, only a far one. */
static void shortcut(const cn_plan_query *query, cn_roadmap *roadmap)
{
    const double need = query->radius + query->spec->clearance;
    double *x = roadmap->x;
    int *leg = roadmap->leg, kept = 1;

    for (int i = 0, end; i + 1 < roadmap->npoint; i = end) {
        double room = need + query->radius;
        int last = i + 1, seen = i + 1;
        while (last + 1 < roadmap->npoint && leg[last + 1] == leg[i + 1])
            last++;
        end = i + 1;
        for (int reach = 2; end < last; reach *= 2) {
            const int j = i + reach < last ? i + reach : last;
            for (; seen < j; seen++)
                room = fmin(room, cn_map_clearance(query->world->map, x + 3 * seen));
            if (!cn_plan_edge_free(query, x + 3 * i, x + 3 * j, fmax(need * 1.05, room), INFINITY)) break;
            end = j;
        }
        leg[kept] = leg[end];
        memmove(x + 3 * kept++, x + 3 * end, 3 * sizeof *x);
    }
    roadmap->npoint = kept;
}

/* Exact clearance of the points; least clearance between them no less than `need` (1-Lipschitz bisection). */
static bool segment_keeps(const cn_world *world, const double a[3], double ca, const double b[3], double cb,
                          double need, int depth)
{
    if (0.5 * (ca + cb - cn_distance(a, b)) >= need) return true;
    if (!(ca >= need && cb >= need)) return false;
    if (depth == 0) return true; /* at most length / 2^8 of the segment undecided, both its ends free */
    const double m[3] = {0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])};
    const double cm = cn_world_distance(world, m, NULL, NULL, NULL);
    return segment_keeps(world, a, ca, m, cm, need, depth - 1) &&
           segment_keeps(world, m, cm, b, cb, need, depth - 1);
}

bool cn_plan_keeps(const cn_plan_query *query, int n, const double *x, double *clearance, bool *broken)
{
    const double need = query->radius + query->spec->clearance;
    bool all = true;

    for (int i = 0; i < n; i++)
        clearance[i] = cn_world_distance(query->world, x + 3 * i, NULL, NULL, NULL);
    for (int i = 0; i + 1 < n; i++) {
        const double *a = x + 3 * i, *b = a + 3;
        bool keeps = segment_keeps(query->world, a, clearance[i], b, clearance[i + 1], need, 8);
        for (int j = 0; j < query->nrefused && keeps; j++)
            keeps = segment_distance(a, b, query->refused[j].centre) >= query->refused[j].radius;
        if (broken) broken[i] = !keeps;
        all = all && keeps;
    }
    return all;
}

double cn_plan_chord(const cn_plan_query *query)
{
    return fmax(2 * query->device_diameter, 4 * cn_map_cell(query->world->map));
}

/* Polyline and smooth path of one search. */
static cn_status route(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error)
{
    cn_status status = planner(query, roadmap, error);
    if (status != CN_OK) return status;
    if (query->spec->region == CN_REGION_NONE && query->spec->sampling != CN_SAMPLING_CONTACT)
        shortcut(query, roadmap);
    status = cn_plan_smooth(out, query, roadmap, error);
    if (status == CN_OK) (*out)->turn_max = cn_path_turn(*out, cn_plan_chord(query), NULL);
    return status;
}

/* The ball that closes the place where the path turns most; false where that would close a point of the
 * query. */
static bool sharpest(const cn_plan_query *query, const cn_path *path, cn_ball *ball)
{
    const double need = query->radius + query->spec->clearance;
    cn_place place;
    double where;
    cn_path_turn(path, cn_plan_chord(query), &where);
    cn_path_at(path, where, &place);
    cn_copy3(place.x, ball->centre);
    ball->radius = fmax(cn_plan_clearance(query, place.x, INFINITY), 2 * need);
    for (int i = 0; i < query->npoint; i++)
        if (!(cn_distance(query->point + 3 * i, ball->centre) > 1.1 * ball->radius)) return false;
    return true;
}

/* Where the path turns too much, other ways around: the sharpest places are closed one after the other. The
 * gentlest path is kept, with its roadmap; finding none is no failure. */
static cn_status gentler(cn_path **path, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap)
{
    enum { TRIES = 8 };
    cn_plan_query other = *query;
    cn_path *tried = NULL;
    cn_ball *ball = malloc(((size_t)query->nrefused + TRIES) * sizeof *ball);
    cn_status status = ball ? cn_path_copy(&tried, *path) : CN_ERR_MEMORY;
    if (status == CN_OK && query->nrefused)
        memcpy(ball, query->refused, (size_t)query->nrefused * sizeof *ball);
    other.refused = ball;
    if (query->samples < 0) other.samples = roadmap->nvertex < 2000 ? 4000 : 2 * roadmap->nvertex;
    for (int i = 0; i < TRIES && status == CN_OK && (*path)->turn_max > query->spec->max_turn; i++) {
        cn_roadmap another = {.reproducible = true};
        cn_error ignored = {0};
        if (!sharpest(query, tried, &ball[other.nrefused])) break;
        other.nrefused++;
        cn_path_free(tried);
        tried = NULL;
        status = route(&tried, &other, planner, &another, &ignored);
        if (status == CN_OK && tried->turn_max < (*path)->turn_max) {
            cn_path_free(*path);
            status = cn_path_copy(path, tried);
            cn_roadmap_clear(roadmap);
            *roadmap = another;
        } else {
            cn_roadmap_clear(&another);
        }
    }
    cn_path_free(tried);
    free(ball);
    return status == CN_ERR_MEMORY || status == CN_ERR_CANCELLED ? status : CN_OK;
}

cn_status cn_plan_once(cn_path **out, const cn_plan_query *query, cn_planner planner, cn_roadmap *roadmap,
                       cn_error *error)
{
    cn_path *path = NULL;
    cn_status status;

    *out = NULL;
    memset(roadmap, 0, sizeof *roadmap);
    if ((status = check(query, roadmap, error)) != CN_OK) return status;
    if ((status = route(&path, query, planner, roadmap, error)) != CN_OK) return status;
    if (path->turn_max > query->spec->max_turn &&
        (status = gentler(&path, query, planner, roadmap)) != CN_OK) {
        cn_fail(error, status, NULL, 0, "%s while a gentler path was sought", cn_status_text(status));
        goto fail;
    }
    if (query->spec->ndeviation > 0 && (status = cn_plan_deviate(&path, query, error)) != CN_OK) goto fail;

    cn_plan_keeps(query, path->n, path->x, path->clearance, NULL);
    path->turn_max = cn_path_turn(path, cn_plan_chord(query), NULL);
    *out = path;
    return CN_OK;
fail:
    cn_path_free(path);
    return status;
}
