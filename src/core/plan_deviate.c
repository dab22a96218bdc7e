/* plan_deviate.c - functional deviations: sinusoids A sin(2 pi s / wavelength + phase) in the plane with the
 * given normal, across the path, any number summed. They fade to nothing at the query's points and shrink,
 * smoothly, where the free space has no room for them, or the path would turn too much. */
#include "plan_smooth.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

static const double pi = 3.14159265358979323846;

/* 0 to 1 with zero slope at both ends. */
static double fade(double t)
{
    return t <= 0 ? 0 : t >= 1 ? 1 : t * t * (3 - 2 * t);
}

/* Sum of the sinusoids at a place, unfaded [m]. The direction across is normal x tangent: in the plane. */
static void offset_at(const cn_path_spec *spec, const cn_place *place, double s, double offset[3])
{
    offset[0] = offset[1] = offset[2] = 0;
    for (int i = 0; i < spec->ndeviation; i++) {
        const cn_deviation *d = &spec->deviation[i];
        double across[3];
        cn_cross(d->normal, place->t, across);
        if (!(cn_norm(across) > 1e-6 * cn_norm(d->normal))) cn_copy3(place->n, across);
        cn_normalise(across);
        cn_axpy(d->amplitude * sin(2 * pi * s / d->wavelength + d->phase), across, offset);
    }
}

/* Largest share of the offset, up to 1, that a straight move from x can take with `need` of clearance left.
 */
static double share(const cn_plan_query *query, const double x[3], const double offset[3], double need)
{
    const double length = cn_norm(offset), finest = need / 20;
    double s = 0;
    while (s < length) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = x[k] + s / length * offset[k];
        double room = cn_plan_clearance(query, p, need + length) - need;
        for (int i = 0; i < query->nrefused; i++)
            room = fmin(room, cn_distance(p, query->refused[i].centre) - 1.03 * query->refused[i].radius);
        if (!(room > finest)) return s / length;
        s += room;
    }
    return 1;
}

/* In place: each share lowered until none differs from its neighbours by more than `slope` a point, then the
 * corners rounded by averaging below. */
static void soften(int n, double *g, double *scratch, int reach)
{
    const double slope = 1.0 / (reach > 0 ? reach : 1);
    for (int i = 1; i < n; i++)
        g[i] = fmin(g[i], g[i - 1] + slope);
    for (int i = n - 1; i-- > 0;)
        g[i] = fmin(g[i], g[i + 1] + slope);
    for (int pass = 0; pass < 4 * reach; pass++) {
        memcpy(scratch, g, (size_t)n * sizeof *g);
        for (int i = 1; i + 1 < n; i++)
            g[i] = fmin(scratch[i], 0.5 * scratch[i] + 0.25 * (scratch[i - 1] + scratch[i + 1]));
    }
}

/* Lowers the shares within `reach` of every broken segment. */
static void shrink(int n, double *g, const bool *broken, int reach)
{
    for (int i = 0, since = INT_MAX; i < n - 1; i++) {
        if (broken[i]) since = 0;
        if (since <= reach) g[i] *= 0.8;
        if (since < INT_MAX) since++;
    }
    for (int i = n - 2, since = INT_MAX; i >= 0; i--) {
        if (since <= reach) g[i] *= 0.8;
        if (broken[i]) since = 0;
        if (since < INT_MAX) since++;
    }
}

/* Marks the segments around the place where the path turns more than the limit; false when none does. */
static bool turns(const cn_path *path, const cn_plan_query *query, double limit, bool *broken)
{
    const double chord = cn_plan_chord(query);
    double where;
    if (cn_path_turn(path, chord, &where) <= limit) return false;
    for (int i = 0; i + 1 < path->n; i++)
        broken[i] = fabs(path->s[i] - where) <= chord;
    return true;
}

static cn_status check(const cn_path_spec *spec, cn_error *error)
{
    for (int i = 0; i < spec->ndeviation; i++) {
        const cn_deviation *d = &spec->deviation[i];
        if (!(isfinite(d->amplitude) && d->wavelength > 0 && d->wavelength < INFINITY && isfinite(d->phase) &&
              isfinite(cn_norm(d->normal))))
            return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                           "path.deviation %d: wavelength must be above 0 and every number finite", i);
    }
    return CN_OK;
}

cn_status cn_plan_deviate(cn_path **path, const cn_plan_query *query, cn_error *error)
{
    const cn_path_spec *spec = query->spec;
    const cn_path *old = *path;
    const double need = 1.03 * (query->radius + spec->clearance), length = cn_path_length(old);
    double shortest = INFINITY, longest = 0, *x = NULL, *g = NULL, *scratch = NULL, *offset = NULL,
           *moved = NULL;
    int *waypoint = NULL, n = 1;
    bool *broken = NULL;
    cn_path *made = NULL;
    cn_status status = check(spec, error);

    if (status != CN_OK) return status;
    for (int i = 0; i < spec->ndeviation; i++) {
        shortest = fmin(shortest, spec->deviation[i].wavelength);
        longest = fmax(longest, spec->deviation[i].wavelength);
    }
    /* points: 32 a wavelength, at least the old path's number, the same ends of legs */
    const double h = fmin(shortest / 32, length / old->n);
    if (!(length / h < 1e6))
        return cn_fail(error, CN_FAULT_VALUE, NULL, 0,
                       "path.deviation: the wavelength is too short for the path");
    if (!(waypoint = malloc((size_t)old->nwaypoint * sizeof *waypoint))) goto memory;
    for (int leg = 0, from = 0; leg < old->nwaypoint; from = old->waypoint[leg++]) {
        n += (int)ceil((old->s[old->waypoint[leg]] - old->s[from]) / h);
        waypoint[leg] = n - 1;
    }
    x = malloc(3 * (size_t)n * sizeof *x);
    offset = malloc(3 * (size_t)n * sizeof *offset);
    moved = malloc(3 * (size_t)n * sizeof *moved);
    g = malloc((size_t)n * sizeof *g);
    scratch = malloc((size_t)n * sizeof *scratch);
    broken = malloc((size_t)n * sizeof *broken);
    if (!x || !offset || !moved || !g || !scratch || !broken) goto memory;

    for (int leg = 0, first = 0; leg < old->nwaypoint; first = waypoint[leg++]) {
        const double s0 = leg ? old->s[old->waypoint[leg - 1]] : 0, s1 = old->s[old->waypoint[leg]];
        const double ramp = fmin(longest / 2, (s1 - s0) / 4);
        for (int i = first; i <= waypoint[leg]; i++) {
            const double s =
                waypoint[leg] > first ? s0 + (s1 - s0) * (i - first) / (waypoint[leg] - first) : s0;
            cn_place place;
            cn_path_at(old, s, &place);
            cn_copy3(place.x, x + 3 * i);
            offset_at(spec, &place, s, offset + 3 * i);
            const double ends = fade((s - s0) / ramp) * fade((s1 - s) / ramp);
            for (int k = 0; k < 3; k++)
                offset[3 * i + k] *= ends;
            g[i] = share(query, x + 3 * i, offset + 3 * i, need);
        }
    }
    const int reach = (int)(shortest / (4 * h));
    soften(n, g, scratch, reach);
    for (int attempt = 0; attempt < 32 && status == CN_OK;
         attempt++) { /* shrink where room lacks between points */
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 3; k++)
                moved[3 * i + k] = x[3 * i + k] + g[i] * offset[3 * i + k];
        for (int leg = 0; leg < old->nwaypoint; leg++)
            cn_copy3(query->point + 3 * (leg + 1), moved + 3 * waypoint[leg]);
        cn_copy3(query->point, moved);
        if (cn_plan_keeps(query, n, moved, scratch, broken)) {
            cn_path_free(made);
            made = NULL;
            status = cn_path_new(&made, n, moved, old->nwaypoint, waypoint, NULL);
            if (status != CN_OK || !turns(made, query, fmax(query->spec->max_turn, old->turn_max), broken))
                break;
        }
        shrink(n, g, broken, reach);
        soften(n, g, scratch, reach);
    }
    if (made) {
        cn_path_free(*path);
        *path = made;
    } else if (status == CN_OK) {
        CN_LOG(CN_LOG_WARNING, "the path's deviation finds no room anywhere and is left out");
    }
    goto done;
memory:
    status = cn_fail(error, CN_ERR_MEMORY, NULL, 0, "out of memory while deviations were added");
done:
    free(x);
    free(offset);
    free(moved);
    free(g);
    free(scratch);
    free(broken);
    free(waypoint);
    return status;
}
