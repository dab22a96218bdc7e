/* catnav study skin: figures of skins, as CSV on standard output; `catnav study DIR` makes pictures of them.
 */
#include "command.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../test/core/skin_cases.h"
#include "catnav/bezier.h"
#include "catnav/vec3.h"
#include "core/pool.h"

static const double bend = 2; /* [rad] */
static int repeats = 50;

static double now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

typedef struct {
    cn_surface *surface;
    skin_bar bar;
    cn_skin *skin;
    cn_skin_state *state;
    cn_pool *pool;
} worn;

static void check(cn_status status)
{
    if (status == CN_OK) return;
    fprintf(stderr, "%s\n", cn_status_text(status));
    exit(1);
}

/* A capsule 8 long, of radius 1.1 and `around` edges about it, on an n bar of anchors; n anchors a vertex, 0:
 * embedded in a box of tetrahedra. */
static worn wear(int around, const int bar[3], int n, int threads)
{
    worn w = {.surface = skin_capsule(8, 1.1, around), .bar = skin_bar_new(bar, 8.0 / (bar[2] - 1), 8, bend)};
    if (n > 0)
        check(cn_skin_new(&w.skin, w.surface, w.bar.n, w.bar.rest, NULL, n, NULL));
    else {
        cn_tets *tets;
        check(cn_tets_beam(&tets, (double[]){3, 3, 11}, (int[]){6, 6, 22}, NULL));
        for (int i = 0; i < tets->nnode; i++)
            for (int k = 0; k < 3; k++)
                tets->node[3 * i + k] -= 1.5;
        check(cn_skin_new_embedded(&w.skin, w.surface, tets, NULL));
        w.bar.place = realloc(w.bar.place, 3 * (size_t)tets->nnode * sizeof(double));
        if (!w.bar.place) exit(1);
        for (int i = 0; i < tets->nnode; i++)
            skin_bend(8, bend, tets->node + 3 * i, w.bar.place + 3 * i, NULL);
        cn_tets_free(tets);
    }
    check(cn_skin_state_new(&w.state, w.skin, NULL));
    check(cn_pool_new(&w.pool, threads));
    return w;
}

static void undress(worn *w)
{
    cn_pool_free(w->pool);
    cn_skin_state_free(w->state);
    cn_skin_free(w->skin);
    skin_bar_free(&w->bar);
    cn_surface_free(w->surface);
}

/* Median time of an update; *best: the least. */
static double update_ms(worn *w, double *best)
{
    double took[1000];
    for (int i = -2; i < repeats; i++) {
        const double begin = now_ms();
        check(cn_skin_update(w->skin, w->bar.place, w->bar.rotation, w->state, w->pool));
        if (i >= 0) took[i] = now_ms() - begin;
    }
    qsort(took, (size_t)repeats, sizeof *took, compare);
    if (best) *best = took[0];
    return took[repeats / 2];
}

static void speed(void)
{
    static const int bar[3] = {12, 12, 48},
                     around[] = {62, 88, 124, 175, 247, 350, 494}; /* x 2 in vertices */
    puts("kind,vertices,triangles,anchors,per_vertex,threads,build_ms,update_ms,best_ms,ns_per_vertex");
    const int sizes = repeats < 10 ? 5 : 7; /* a quick look: up to 100,000 vertices */
    for (int i = 0; i < sizes; i++)
        for (int n = 0; n <= CN_SKIN_ANCHORS; n++)
            for (int threads = 1; threads <= 2; threads++) {
                double best;
                const double begin = now_ms();
                if (n != 4 && n != 0 && i != 4) continue;
                worn w = wear(around[i], bar, n, threads);
                const double build = now_ms() - begin, ms = update_ms(&w, &best);
                printf("%s,%d,%d,%d,%d,%d,%.2f,%.4f,%.4f,%.2f\n", n ? "blend" : "embed", w.surface->nvert,
                       w.surface->ntri, w.skin->nanchor, w.skin->nper, threads, build, ms, best,
                       1e6 * ms / w.surface->nvert);
                undress(&w);
            }
}

/* A wave runs over the net. */
static void wave(int nu, int nv, double time, double *control)
{
    for (int i = 0; i < nu; i++)
        for (int j = 0; j < nv; j++, control += 3)
            control[0] = i, control[1] = j, control[2] = sin(0.5 * (i + j) + time);
}

static void bezier_row(const char *against, int points, int intervals)
{
    static const int bar[3] = {3, 3, 13};
    cn_bezier *z;
    double rate[2];
    check(cn_bezier_new(&z, points, points, intervals, intervals, NULL));
    double *control = malloc(3 * (size_t)(points * points) * sizeof *control);
    double *x = malloc(6 * (size_t)z->nvert * sizeof *x), *normal = x + 3 * (size_t)z->nvert;
    if (!control || !x) exit(1);
    for (int paper = 0; paper < 2; paper++) {
        int frames = 0;
        const double begin = now_ms();
        double spent = 0;
        for (; frames < 1000 && (frames < 2 || spent < 4 * repeats); frames++, spent = now_ms() - begin) {
            wave(points, points, 0.1 * frames, control);
            if (!paper) cn_bezier_update(z, control, x, normal);
            for (int v = 0; paper && v < z->nvert; v++)
                cn_bezier_point(points, points, control, (double)(v / (intervals + 1)) / intervals,
                                (double)(v % (intervals + 1)) / intervals, x + 3 * v, normal + 3 * v);
        }
        rate[paper] = 1e3 * frames / spent;
    }
    worn w = wear((int)fmax(6, sqrt(z->nvert / 1.656)), bar, 4, 1); /* about as many vertices */
    const double skin = 1e3 / update_ms(&w, NULL);
    printf("%s,%d,%d,%d,%.2f,%.2f,%d,%.2f\n", against, points * points, intervals * intervals, z->nvert,
           rate[1], rate[0], w.surface->nvert, skin * w.surface->nvert / z->nvert);
    undress(&w);
    free(control), free(x);
    cn_bezier_free(z);
}

static void bezier(void)
{
    puts("against,control_points,intervals,vertices,double_sum_fps,grid_fps,skin_vertices,skin_fps");
    for (int intervals = 10; intervals <= 160; intervals *= 2)
        bezier_row("intervals", 10, intervals);
    for (int points = 4; points <= 32; points = points * 3 / 2)
        bezier_row("control_points", points, 40);
}

static void smooth(void)
{
    static const int bars[3][3] = {{2, 2, 9}, {3, 3, 13}, {1, 1, 9}};
    puts("bar,edges_around,per_vertex,degrees");
    for (int b = 0; b < 3; b++)
        for (int around = 32; around <= 128; around *= 2) {
            const double degrees = 45 / atan(1);
            double angle;
            for (int n = 0; n <= CN_SKIN_ANCHORS; n++) {
                worn w = wear(around, bars[b], n, 1);
                update_ms(&w, NULL);
                check(cn_skin_sharpest(w.skin, w.state, &angle));
                printf("%dx%dx%d,%d,%s%.0d,%.3f\n", bars[b][0], bars[b][1], bars[b][2], around,
                       n ? "" : "embedded", n, angle * degrees);
                undress(&w);
            }
            cn_surface *exact = skin_capsule(8, 1.1, around);
            worn w = {.bar = {0}};
            for (int v = 0; v < exact->nvert; v++) {
                double x[3];
                skin_bend(8, bend, exact->vert + 3 * v, x, NULL);
                cn_copy3(x, exact->vert + 3 * v);
            }
            const double origin[3] = {0};
            check(cn_skin_new(&w.skin, exact, 1, origin, NULL, 1, NULL));
            check(cn_skin_state_new(&w.state, w.skin, NULL));
            check(cn_skin_update(w.skin, origin, NULL, w.state, NULL));
            check(cn_skin_sharpest(w.skin, w.state, &angle));
            printf("%dx%dx%d,%d,exact,%.3f\n", bars[b][0], bars[b][1], bars[b][2], around, angle * degrees);
            w.surface = exact;
            undress(&w);
        }
}

static void shape(int n)
{
    static const int bar[3] = {2, 2, 9};
    worn w = wear(96, bar, n, 1);
    update_ms(&w, NULL);
    puts("kind,a,b,c,nx,ny,nz");
    for (int r = 0; r < w.skin->nvert; r++) {
        const int v = w.skin->vertex[r];
        const double *x = w.state->x + 3 * v, *m = w.state->normal + 3 * v;
        printf("vertex %d,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", v, x[0], x[1], x[2], m[0], m[1], m[2]);
        for (int j = 0; r % 29 == 0 && j < w.skin->nper; j++) {
            const double *a = w.bar.place + 3 * w.skin->anchor[w.skin->nper * r + j];
            printf("link %d,%.6f,%.6f,%.6f,,,\n", v, a[0], a[1], a[2]);
        }
    }
    for (int t = 0; t < w.skin->ntri; t++)
        printf("face %d,%d,%d,%d,%.6f,%.6f,%.6f\n", t, w.skin->tri[3 * t], w.skin->tri[3 * t + 1],
               w.skin->tri[3 * t + 2], w.state->face[4 * t], w.state->face[4 * t + 1],
               w.state->face[4 * t + 2]);
    undress(&w);
}

int command_study_skin(int argc, char **argv)
{
    const char *const part = argc > 0 ? argv[0] : "";
    char *end = NULL;
    const long number = argc > 1 ? strtol(argv[1], &end, 10) : 0;
    const bool is_shape = !strcmp(part, "shape");
    if (argc > 2 || (end && (*end || number < 1 || number > (is_shape ? CN_SKIN_ANCHORS : 1000))) ||
        (strcmp(part, "speed") && strcmp(part, "bezier") && strcmp(part, "smooth") && !is_shape)) {
        fputs("usage: catnav study skin speed|bezier|smooth [REPEATS, to 1000], or catnav study skin shape "
              "ANCHORS, 1 to 8\n",
              stderr);
        return COMMAND_REFUSED;
    }
    repeats = is_shape || !strcmp(part, "smooth") ? 1 : number > 0 ? (int)number : 50;
    if (is_shape)
        shape(number > 0 ? (int)number : 4);
    else if (!strcmp(part, "smooth"))
        smooth();
    else if (!strcmp(part, "bezier"))
        bezier();
    else
        speed();
    return fflush(stdout) || ferror(stdout) ? COMMAND_FAILED : COMMAND_OK;
}
