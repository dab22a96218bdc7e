#include "catnav/path.h"

#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

enum { PER_POINT = 3 + 1 + 1 + 3 + 3 }; /* doubles: x, s, clearance, tangent, normal */

static cn_path *path_alloc(int n, int nwaypoint)
{
    cn_path *path = calloc(1, sizeof *path);
    double *block = path ? calloc((size_t)n * PER_POINT, sizeof *block) : NULL;
    int *waypoint = block ? calloc((size_t)nwaypoint + 1, sizeof *waypoint) : NULL;
    if (!waypoint) {
        free(block), free(path);
        return NULL;
    }
    *path = (cn_path){.n = n, .x = block, .nwaypoint = nwaypoint, .waypoint = waypoint};
    path->tangent = block + 3 * (size_t)n;
    path->normal = block + 6 * (size_t)n;
    path->s = block + 9 * (size_t)n;
    path->clearance = block + 10 * (size_t)n;
    return path;
}

void cn_path_free(cn_path *path)
{
    if (!path) return;
    free(path->x), free(path->waypoint), free(path);
}

cn_status cn_path_copy(cn_path **out, const cn_path *path)
{
    cn_path *copy = *out = path_alloc(path->n, path->nwaypoint);
    if (!copy) return CN_ERR_MEMORY;
    memcpy(copy->x, path->x, (size_t)path->n * PER_POINT * sizeof *path->x);
    memcpy(copy->waypoint, path->waypoint, (size_t)path->nwaypoint * sizeof *path->waypoint);
    copy->turn_max = path->turn_max;
    return CN_OK;
}

/* Direction of segment i; of a repeated point, that of the next segment with a length, else of the last. */
static void direction(const cn_path *path, int i, double u[3])
{
    int k = i;
    while (k < path->n - 1 && !(path->s[k + 1] > path->s[k]))
        k++;
    if (k == path->n - 1)
        for (k = i; k > 0 && !(path->s[k + 1] > path->s[k]); k--) {}
    cn_sub(path->x + 3 * k + 3, path->x + 3 * k, u);
    cn_normalise(u);
}

/* Tangents: those of the parabola through three neighbours, a chord's at the ends. */
static void tangents(cn_path *path)
{
    const double *s = path->s;
    double u[3], w[3];
    direction(path, 0, u);
    cn_copy3(u, path->tangent);
    for (int i = 1; i < path->n; i++) {
        double *t = path->tangent + 3 * i;
        if (i == path->n - 1) {
            cn_copy3(u, t);
            break;
        }
        direction(path, i, w);
        const double a = s[i] - s[i - 1], b = s[i + 1] - s[i];
        for (int k = 0; k < 3; k++)
            t[k] = a + b > 0 ? (b * u[k] + a * w[k]) / (a + b) : w[k];
        if (!(cn_normalise(t) > 1e-9)) cn_copy3(w, t); /* a full turn back */
        cn_copy3(w, u);
    }
}

static void square_to(const double t[3], double r[3]) /* r made a unit vector normal to t */
{
    cn_axpy(-cn_dot(t, r), t, r);
    if (!(cn_normalise(r) > 1e-9)) cn_any_normal(t, r);
}

static void reflect(const double v[3], double a[3]) /* in the plane normal to v */
{
    const double c = cn_norm2(v);
    if (c > 0) cn_axpy(-2 * cn_dot(v, a) / c, v, a);
}

/* Rotation-minimising frame by double reflection (Wang, Juettler, Zheng, Liu, ACM TOG 27, 2008). */
static void frames(cn_path *path, const double *normal)
{
    double r[3] = {0, 0, 0}, left[3], v[3];
    if (normal) cn_copy3(normal, r), cn_normalise(r);
    square_to(path->tangent, r);
    cn_copy3(r, path->normal);
    for (int i = 0; i + 1 < path->n; i++) {
        const double *t = path->tangent + 3 * i;
        cn_sub(path->x + 3 * i + 3, path->x + 3 * i, v);
        if (!(cn_norm2(v) > 0)) cn_copy3(t, v); /* repeated point: any vector along the tangent does */
        cn_copy3(t, left);
        reflect(v, left), reflect(v, r);
        cn_sub(t + 3, left, v);
        reflect(v, r);
        square_to(t + 3, r);
        cn_copy3(r, path->normal + 3 * i + 3);
    }
}

cn_status cn_path_new(cn_path **out, int n, const double *x, int nwaypoint, const int *waypoint,
                      const double *normal)
{
    *out = NULL;
    if (n < 2 || nwaypoint < 0) return CN_ERR_ARG;
    for (int i = 0; i < 3 * n; i++)
        if (!isfinite(x[i])) return CN_ERR_NOT_FINITE;
    for (int i = 0; i < nwaypoint; i++)
        if (waypoint[i] < 0 || waypoint[i] >= n) return CN_ERR_ARG;
    if (normal && !isfinite(cn_norm2(normal))) return CN_ERR_NOT_FINITE;

    cn_path *path = path_alloc(n, nwaypoint);
    if (!path) return CN_ERR_MEMORY;
    memcpy(path->x, x, 3 * (size_t)n * sizeof *x);
    if (nwaypoint) memcpy(path->waypoint, waypoint, (size_t)nwaypoint * sizeof *waypoint);
    for (int i = 1; i < n; i++)
        path->s[i] = path->s[i - 1] + cn_distance(x + 3 * i - 3, x + 3 * i);
    if (!(path->s[n - 1] > 0 && isfinite(path->s[n - 1]))) {
        cn_path_free(path);
        return CN_ERR_ARG;
    }
    tangents(path);
    frames(path, normal);
    *out = path;
    return CN_OK;
}

double cn_path_length(const cn_path *path)
{
    return path->s[path->n - 1];
}

/* Segment i with s[i] <= s < s[i + 1] (the first or last one outside). */
static int segment(const cn_path *path, double s)
{
    int low = 0, high = path->n - 1;
    while (high - low > 1) {
        const int mid = (low + high) / 2;
        if (path->s[mid] <= s)
            low = mid;
        else
            high = mid;
    }
    return low;
}

static void point_at(const cn_path *path, double s, double x[3])
{
    const int i = segment(path, s), last = path->n - 1;
    const double length = path->s[i + 1] - path->s[i];
    if (s <= 0 || s >= path->s[last]) {
        const int end = s <= 0 ? 0 : last;
        cn_copy3(path->x + 3 * end, x);
        cn_axpy(s - path->s[end], path->tangent + 3 * end, x);
        return;
    }
    const double f = length > 0 ? (s - path->s[i]) / length : 0;
    for (int k = 0; k < 3; k++)
        x[k] = (1 - f) * path->x[3 * i + k] + f * path->x[3 * i + 3 + k];
}

/* Curvature at point i: 2 |u' - u| / (l + l'), exact for equal chords of a circle. */
static double curvature(const cn_path *path, int i)
{
    double u[3], w[3];
    i = i < 1 ? 1 : i > path->n - 2 ? path->n - 2 : i;
    if (path->n < 3) return 0;
    direction(path, i - 1, u), direction(path, i, w);
    const double length = path->s[i + 1] - path->s[i - 1];
    return length > 0 ? 2 * cn_distance(u, w) / length : 0;
}

void cn_path_at(const cn_path *path, double s, cn_place *place)
{
    const int i = segment(path, s), last = path->n - 1;
    const double *t = path->tangent + 3 * i, *n = path->normal + 3 * i;
    const double length = path->s[i + 1] - path->s[i];
    double f = length > 0 ? (s - path->s[i]) / length : 0;
    f = f > 0 ? f < 1 ? f : 1 : 0;

    point_at(path, s, place->x);
    for (int k = 0; k < 3; k++) {
        place->t[k] = (1 - f) * t[k] + f * t[k + 3];
        place->n[k] = (1 - f) * n[k] + f * n[k + 3];
    }
    if (!(cn_normalise(place->t) > 1e-9)) direction(path, i, place->t);
    square_to(place->t, place->n);
    cn_cross(place->t, place->n, place->b);
    place->curvature =
        s < 0 || s > path->s[last] ? 0 : (1 - f) * curvature(path, i) + f * curvature(path, i + 1);
}

double cn_path_project(const cn_path *path, const double x[3], double s_low, double s_high)
{
    const double length = cn_path_length(path);
    double best = s_low, best_distance = INFINITY, a[3], b[3], d[3], e[3];
    if (!(s_low < s_high)) return s_low;

    /* one piece after the other: before the start, the segments, beyond the end */
    for (double s = s_low; s < s_high;) {
        double next = s_high;
        if (s < 0)
            next = fmin(next, 0);
        else if (s < length)
            next = fmin(next, path->s[segment(path, s) + 1]);
        if (!(next > s)) break;
        point_at(path, s, a), point_at(path, next, b);
        cn_sub(b, a, d), cn_sub(x, a, e);
        const double c = cn_norm2(d);
        double f = c > 0 ? cn_dot(d, e) / c : 0;
        f = f > 0 ? f < 1 ? f : 1 : 0;
        cn_axpy(-f, d, e);
        if (cn_norm2(e) < best_distance) best_distance = cn_norm2(e), best = s + f * (next - s);
        s = next;
    }
    return best;
}

/* Turn [rad] between the chords that end and start at s. */
static double turn_at(const cn_path *path, double chord, double s)
{
    double a[3], b[3], c[3], u[3], w[3], x[3];
    point_at(path, s - chord, a), point_at(path, s, b), point_at(path, s + chord, c);
    cn_sub(b, a, u), cn_sub(c, b, w);
    cn_cross(u, w, x);
    return atan2(cn_norm(x), cn_dot(u, w));
}

static void turn_scan(const cn_path *path, double chord, double from, double to, double step, double best[2])
{
    const int n = (int)fmin(ceil((to - from) / step), 1e7);
    for (int i = 0; i <= n; i++) {
        const double s = i < n ? from + (to - from) * i / n : to, turn = turn_at(path, chord, s);
        if (turn > best[1]) best[0] = s, best[1] = turn;
    }
}

double cn_path_turn(const cn_path *path, double chord, double *where)
{
    const double length = cn_path_length(path);
    if (!(chord > 0 && chord <= length / 2)) chord = length / 2;
    const double low = chord, high = fmax(length - chord, chord), step = chord / 16;
    double best[2] = {low, -1}; /* place, turn */

    turn_scan(path, chord, low, high, step, best);
    for (int i = 1; i + 1 < path->n; i++) { /* a lone corner shows its full turn at itself */
        const double s = path->s[i];
        if (!(s >= low && s <= high)) continue;
        const double turn = turn_at(path, chord, s);
        if (turn > best[1]) best[0] = s, best[1] = turn;
    }
    for (double fine = step; fine > 1e-3 * step; fine /= 8)
        turn_scan(path, chord, fmax(low, best[0] - fine), fmin(high, best[0] + fine), fine / 8, best);
    if (where) *where = best[0];
    return best[1];
}
