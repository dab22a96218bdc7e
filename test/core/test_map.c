#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <jansson.h>

#include "catnav/vec3.h"
#include "catnav/world.h"
#include "fail_alloc.h"

#ifndef CATNAV_TEST_DATA
#define CATNAV_TEST_DATA "test/data"
#endif

static const double pi = 3.14159265358979323846;

static cn_surface_spec sphere(double x, double y, double z, double radius)
{
    cn_surface_spec spec = {.name = "sphere", .shape = {.kind = CN_SHAPE_SPHERE, .placement.scale = 1}};
    cn_copy3((double[3]){x, y, z}, spec.shape.sphere.centre);
    spec.shape.sphere.radius = radius;
    return spec;
}

static cn_surface_spec box(double size)
{
    cn_surface_spec spec = {.name = "box", .shape = {.kind = CN_SHAPE_BOX, .placement.scale = 1}};
    for (int k = 0; k < 3; k++)
        spec.shape.box.max[k] = size;
    return spec;
}

static cn_surface_spec tube(int n, double *axis, int nradius, double *radius)
{
    cn_surface_spec spec = {.name = "tube", .shape = {.kind = CN_SHAPE_TUBE, .placement.scale = 1}};
    spec.shape.tube.naxis = n, spec.shape.tube.axis = axis;
    spec.shape.tube.nradius = nradius, spec.shape.tube.radius = radius;
    return spec;
}

/* A world with its map of the given cell. */
static cn_world *mapped(cn_scene *scene, double cell, double radius, int threads)
{
    cn_world *world;
    cn_error error = {0};
    scene->planner.resolution = cell;
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    assert_int_equal(cn_world_map(world, radius, threads, &error), CN_OK);
    return world;
}

static double random_in(unsigned *seed, double low, double high)
{
    *seed = 1664525u * *seed + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

typedef struct {
    double volume; /* [cells] */
    long cubes;
    int largest;
    uint64_t hash;
    bool aligned;
} cubes;

static void count_cube(void *user, const int corner[3], int level)
{
    cubes *c = user;
    const int side = 1 << level;
    c->volume += (double)side * side * side, c->cubes++;
    c->largest = level > c->largest ? level : c->largest;
    for (int k = 0; k < 3; k++) {
        c->aligned = c->aligned && corner[k] % side == 0;
        c->hash = c->hash * 1099511628211u + (uint64_t)corner[k];
    }
    c->hash = c->hash * 1099511628211u + (uint64_t)level;
}

static cubes visit(const cn_map *map)
{
    cubes c = {.aligned = true, .hash = 14695981039346656037u};
    cn_map_visit_cubes(map, count_cube, &c);
    return c;
}

/* --- closed forms --- */

static void free_cells_have_the_volume_of_what_they_fill(void **state)
{
    (void)state;
    cn_surface_spec ball = sphere(0.3, -0.2, 0.1, 1), crate = box(1);
    double axis[6] = {0, 0, 0, 0.5, 0.7, 1}, radius = 0.3;
    cn_surface_spec pipe = tube(2, axis, 1, &radius);
    cn_surface_spec *spec[3] = {&ball, &crate, &pipe};
    for (int i = 0; i < 3; i++) {
        cn_scene scene = {.nvessel = 1, .vessel = spec[i]};
        cn_world *world = mapped(&scene, 0.0213, 0, 1);
        const cubes c = visit(world->map);
        const double cell = cn_map_cell(world->map), volume = c.volume * cell * cell * cell;
        const double corridors = i < 2 ? 0 : 2 * pi * radius * radius * 4 * cell;
        assert_true(cell == 0.0213 && c.aligned && c.largest >= 3);
        if (i == 1) /* cells whose centres lie in the box, centred on it */
            assert_true(c.volume == 46 * 46 * 46);
        else
            assert_true(fabs(volume / (world->wall[0].doctor.volume + corridors) - 1) < 0.01);
        cn_world_free(world);
    }
}

static void clearance_is_never_above_the_true_one_and_about_a_cell_below(void **state)
{
    (void)state;
    for (int rock = 0; rock < 2; rock++) { /* small faces; large ones, with edges and corners nearest */
        cn_surface_spec ball = sphere(0, 0, 0, 1), obstacle = rock ? box(0.4) : sphere(0.4, 0, 0, 0.1);
        cn_scene scene = {.nvessel = 1, .vessel = &ball, .nobstacle = 1, .obstacle = &obstacle};
        cn_world *world = mapped(&scene, 0.02, 0, 1);
        unsigned seed = 5;
        double sum = 0, worst = 0;
        int n = 0;
        for (int i = 0; i < 20000; i++) {
            const double p[3] = {random_in(&seed, -1.1, 1.1), random_in(&seed, -1.1, 1.1),
                                 random_in(&seed, -1.1, 1.1)};
            const double map = cn_map_clearance(world->map, p),
                         d = cn_world_distance(world, p, NULL, NULL, NULL);
            const bool is_free = cn_world_free_at(world, p);
            assert_true(map <= (is_free ? d : 0));
            if (!is_free) continue;
            const double below = (d - map) / 0.02;
            sum += below, n++;
            if (d < 0.12) worst = fmax(worst, below); /* within six cells of a wall */
        }
        assert_true(n > 5000 && sum / n < 0.35 && worst < 2);
        assert_true(cn_map_clearance(world->map, (double[3]){NAN, 0, 0}) == 0);
        assert_true(cn_map_clearance(world->map, (double[3]){1e30, 0, 0}) == 0);
        cn_world_free(world);
    }
}

static void the_ridge_of_a_tube_is_its_axis(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0.03, 0.02, 0.1};
    const double direction[3] = {0.03 / sqrt(0.0113), 0.02 / sqrt(0.0113), 0.1 / sqrt(0.0113)};
    for (double radius = 0.003; radius < 0.02; radius *= 2) { /* 6, 12, 24 cells */
        cn_surface_spec pipe = tube(2, axis, 1, &radius);
        cn_scene scene = {.nvessel = 1, .vessel = &pipe};
        cn_world *world = mapped(&scene, 0.0005, 0, 1);
        const double *x, *clearance;
        const int n = cn_map_ridge(world->map, &x, &clearance);
        double low = 1, high = 0;
        assert_true(n > 100 && n < 400);
        for (int i = 0; i < n; i++) {
            const double s = cn_dot(x + 3 * i, direction);
            double off[3];
            cn_copy3(x + 3 * i, off), cn_axpy(-s, direction, off);
            assert_true(cn_norm(off) < fmax(2 * 0.0005, 0.1 * radius));
            assert_true(fabs(clearance[i] - cn_world_distance(world, x + 3 * i, NULL, NULL, NULL)) < 1e-15);
            low = fmin(low, s), high = fmax(high, s);
        }
        assert_true(low < radius && high > cn_norm(axis + 3) - radius);
        cn_world_free(world);
    }
}

/* Every cell of the ridge is reached from the first by steps to touching cells. */
static bool connected(const cn_map *map)
{
    const double *x, *clearance, near = 1.8 * cn_map_cell(map);
    const int n = cn_map_ridge(map, &x, &clearance);
    int *stack = calloc(2 * (size_t)n + 1, sizeof *stack), *seen = stack + n, top = 0, count = 1;
    stack[top++] = 0, seen[0] = 1;
    while (top) {
        const int i = stack[--top];
        for (int j = 0; j < n; j++)
            if (!seen[j] && cn_distance(x + 3 * i, x + 3 * j) < near) seen[j] = 1, stack[top++] = j, count++;
    }
    free(stack);
    return n > 0 && count == n;
}

static void the_ridge_goes_on_where_a_wide_vessel_becomes_narrow(void **state)
{
    (void)state;
    double radius[4] = {0.006, 0.006, 0.0015, 0.0015};
    double axis[12] = {0, 0, 0, 0.02, 0, 0, 0.023, 0, 0, 0.05, 0.01, 0}; /* by a cone of 56 degrees */
    cn_surface_spec pipe = tube(4, axis, 4, radius);
    cn_scene scene = {.nvessel = 1, .vessel = &pipe};
    cn_world *world = mapped(&scene, 0.0003, 0, 1);
    assert_true(connected(world->map));
    cn_world_free(world);
}

static void a_neck_is_found_where_it_is(void **state)
{
    (void)state;
    double axis[15] = {0}, radius[5] = {0.01, 0.01, 0.004, 0.01, 0.01}, where[3];
    for (int i = 0; i < 5; i++)
        axis[3 * i] = 0.03 * i, axis[3 * i + 1] = 0.01 * i;
    cn_surface_spec pipe = tube(5, axis, 5, radius);
    cn_scene scene = {.nvessel = 1, .vessel = &pipe};
    cn_world *world = mapped(&scene, 0.0005, 0, 1);
    const double a[3] = {0.01, 0.004, 0}, b[3] = {0.11, 0.036, 0.002};
    const double width = cn_map_pinch(world->map, a, b, where);
    assert_true(width <= 0.004 && width > 0.004 - 0.0005);
    assert_true(cn_distance(where, axis + 6) < 0.002);
    /* the other way round it is the same neck */
    assert_true(fabs(cn_map_pinch(world->map, b, a, where) - width) < 0.0002);
    cn_world_free(world);
}

static void what_is_not_joined_ends_where_it_comes_nearest(void **state)
{
    (void)state;
    cn_surface_spec ball[2] = {sphere(0, 0, 0, 1), sphere(3, 0, 0, 1)};
    cn_scene scene = {.nvessel = 2, .vessel = ball};
    cn_world *world = mapped(&scene, 0.05, 0, 1);
    double where[3];
    assert_true(cn_map_pinch(world->map, (double[3]){-0.5, 0, 0}, (double[3]){3, 0, 0}, where) == 0);
    assert_true(cn_distance(where, (double[3]){1, 0, 0}) < 0.15);
    assert_true(cn_map_pinch(world->map, (double[3]){9, 9, 9}, (double[3]){3, 0, 0}, where) == 0);
    cn_world_free(world);
}

static void an_entry_on_a_cap_has_its_clearance(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0, 0, 0.1}, radius = 0.005;
    cn_surface_spec pipe = tube(2, axis, 1, &radius);
    cn_scene scene = {.nvessel = 1, .vessel = &pipe};
    cn_world *world = mapped(&scene, NAN, 0.000675, 1);
    assert_true(fabs(cn_map_cell(world->map) - 0.00025) < 1e-12); /* a 1.35 mm device */
    const double at = cn_map_clearance(world->map, (double[3]){0, 0, 0});
    assert_true(at > 0.004 && at <= 0.005);
    assert_true(cn_map_clearance(world->map, (double[3]){0, 0, -0.001}) > 0.004);
    assert_true(cn_map_clearance(world->map, (double[3]){0.0051, 0, 0.05}) == 0);
    cn_world_free(world);
}

static void around_obstacles_all_is_free_that_is_not_inside_them(void **state)
{
    (void)state;
    cn_surface_spec rock[2] = {sphere(0, 0, 0, 1), sphere(4, 0, 0, 1)};
    double waypoint[6] = {-3, 0, 0, 7, 1, 0};
    cn_body_spec body = {.name = "fish", .nwaypoint = 2, .waypoint = waypoint};
    cn_scene scene = {.nobstacle = 2, .obstacle = rock, .nbody = 1, .body = &body};
    cn_world *world = mapped(&scene, NAN, 0.2, 2);
    unsigned seed = 9;
    const double cell = cn_map_cell(world->map);
    for (int i = 0; i < 5000; i++) {
        const double p[3] = {random_in(&seed, -3, 7), random_in(&seed, -1.4, 1.4),
                             random_in(&seed, -1.4, 1.4)};
        const double d = fmin(cn_norm(p), cn_distance(p, (double[3]){4, 0, 0})) - 1;
        const double map = cn_map_clearance(world->map, p);
        assert_true(map <= fmax(0, d) + 0.002);
        assert_true(map >= d - 0.15 * fmax(0, d) - 2 * cell);
    }
    for (int i = 0; i < 2; i++)
        assert_true(cn_map_clearance(world->map, waypoint + 3 * i) > 1);
    cn_world_free(world);
}

static void a_scene_without_walls_has_a_map_without_limits(void **state)
{
    (void)state;
    double waypoint[3] = {1, 2, 3};
    cn_body_spec body = {.name = "fish", .nwaypoint = 1, .waypoint = waypoint};
    cn_scene scene = {.nbody = 1, .body = &body};
    cn_world *world = mapped(&scene, NAN, 0.1, 1);
    const double *x, *clearance;
    assert_true(isinf(cn_map_clearance(world->map, waypoint)));
    assert_int_equal(cn_map_ridge(world->map, &x, &clearance), 0);
    cn_world_free(world);
}

/* --- invariances --- */

static void the_map_is_the_same_for_any_number_of_threads(void **state)
{
    (void)state;
    double axis[9] = {0, 0, 0, 0.03, 0.01, 0.05, 0, 0.05, 0.1}, radius[3] = {0.004, 0.009, 0.006};
    cn_surface_spec pipe = tube(3, axis, 3, radius);
    cn_scene scene = {.nvessel = 1, .vessel = &pipe};
    cn_world *one = mapped(&scene, 0.0005, 0, 1);
    for (int threads = 2; threads <= 5; threads += 3) {
        cn_world *many = mapped(&scene, 0.0005, 0, threads);
        const double *x[2], *c[2];
        const int n = cn_map_ridge(one->map, x, c);
        assert_int_equal(cn_map_ridge(many->map, x + 1, c + 1), n);
        assert_memory_equal(x[0], x[1], 3 * (size_t)n * sizeof *x[0]);
        assert_memory_equal(c[0], c[1], (size_t)n * sizeof *c[0]);
        assert_true(visit(one->map).hash == visit(many->map).hash);
        unsigned seed = 2;
        for (int i = 0; i < 3000; i++) {
            const double p[3] = {random_in(&seed, -0.01, 0.04), random_in(&seed, -0.01, 0.06),
                                 random_in(&seed, 0, 0.1)};
            assert_true(cn_map_clearance(one->map, p) == cn_map_clearance(many->map, p));
        }
        cn_world_free(many);
    }
    cn_world_free(one);
}

static void the_map_does_not_depend_on_the_unit(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0.03, 0.01, 0.05}, radius = 0.005, big[6], big_radius = 0.005 * 1048576;
    for (int k = 0; k < 6; k++)
        big[k] = axis[k] * 1048576; /* a power of two: the very same digits */
    cn_surface_spec pipe[2] = {tube(2, axis, 1, &radius), tube(2, big, 1, &big_radius)};
    cn_scene scene[2] = {{.nvessel = 1, .vessel = pipe}, {.nvessel = 1, .vessel = pipe + 1}};
    cn_world *m = mapped(scene, NAN, 0.0013, 1), *mm = mapped(scene + 1, NAN, 0.0013 * 1048576, 1);
    const double *x[2], *c[2];
    const int n = cn_map_ridge(m->map, x, c);
    assert_true(n > 0 && visit(m->map).hash == visit(mm->map).hash);
    assert_int_equal(cn_map_ridge(mm->map, x + 1, c + 1), n);
    for (int i = 0; i < n; i++)
        assert_true(c[0][i] * 1048576 == c[1][i]);
    cn_world_free(m), cn_world_free(mm);
}

/* --- refusals --- */

static void a_map_without_a_radius_or_a_thread_is_refused(void **state)
{
    (void)state;
    cn_surface_spec ball = sphere(0, 0, 0, 1);
    cn_scene scene = {.nvessel = 1, .vessel = &ball};
    cn_world *world = mapped(&scene, 0.1, 0, 1);
    cn_error error = {0};
    assert_int_equal(cn_world_map(world, NAN, 1, &error), CN_ERR_ARG);
    assert_int_equal(cn_world_map(world, -1, 1, NULL), CN_ERR_ARG);
    assert_int_equal(cn_world_map(world, 0.1, 0, NULL), CN_ERR_ARG);
    cn_world_free(world);
}

static void too_fine_a_cell_is_made_coarser(void **state)
{
    (void)state;
    cn_surface_spec rock = sphere(0, 0, 0, 0.1);
    double waypoint[6] = {-1e5, 0, 0, 1e5, 0, 0}; /* a needle of a scene: its bricks would be too many */
    cn_body_spec body = {.name = "fish", .nwaypoint = 2, .waypoint = waypoint};
    cn_scene scene = {.nobstacle = 1, .obstacle = &rock, .nbody = 1, .body = &body};
    cn_world *world = mapped(&scene, 1, 0.01, 2);
    assert_true(cn_map_cell(world->map) > 100);
    cn_world_free(world);
}

static void every_failing_allocation_is_survived(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0.001, 0.002, 0.02}, radius = 0.002;
    cn_surface_spec spec[2] = {tube(2, axis, 1, &radius), sphere(0, 0, 0.01, 0.0005)};
    cn_scene scene = {.nvessel = 1, .vessel = spec, .nobstacle = 1, .obstacle = spec + 1};
    scene.planner.resolution = 0.0004;
    int failed = 0;
    bool fired = true;
    for (long n = 0; fired; n++) {
        cn_world *world = NULL;
        cn_error error = {0};
        fail_alloc_at(n);
        cn_status status = cn_world_new(&world, &scene, 0, NULL, &error);
        if (status == CN_OK) status = cn_world_map(world, 0, 1, &error);
        if (status == CN_OK) { /* a failing search finds nothing, and breaks nothing */
            double where[3];
            cn_map_pinch(world->map, (double[3]){0.0001, 0.0002, 0.002}, axis + 3, where);
        } else {
            assert_int_equal(status, CN_ERR_MEMORY);
            failed++;
        }
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        cn_world_free(world);
    }
    assert_true(failed > 20);
}

/* --- the real meshes --- */

static const char *data_folder(void)
{
    return getenv("CATNAV_DATA") ? getenv("CATNAV_DATA") : CATNAV_TEST_DATA;
}

static void point_of(const json_t *array, double scale, double p[3])
{
    for (size_t k = 0; k < 3; k++)
        p[k] = scale * json_number_value(json_array_get(array, k));
}

static void routes_of_real_vessels_are_wide_enough(void **state)
{
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/index.json", data_folder());
    json_t *index = json_load_file(path, 0, NULL), *vessel, *route;
    size_t i, r;
    int seen = 0;
    if (!index) skip();
    json_array_foreach(json_object_get(index, "vessels"), i, vessel)
    {
        const json_t *routes = json_object_get(vessel, "routes");
        const double scale = json_number_value(json_object_get(vessel, "scale"));
        snprintf(path, sizeof path, "%s/%s", data_folder(),
                 json_string_value(json_object_get(vessel, "file")));
        FILE *there = json_array_size(routes) ? fopen(path, "rb") : NULL;
        if (!there) continue;
        fclose(there);
        cn_surface_spec spec = {.name = "vessel", .shape = {.kind = CN_SHAPE_FILE, .file = path}};
        spec.shape.placement.scale = scale;
        cn_scene scene = {.nvessel = 1, .vessel = &spec};
        cn_world *world = mapped(&scene, NAN, 0.000675, 2);
        const double cell = cn_map_cell(world->map), *x, *clearance;
        assert_true(fabs(visit(world->map).volume * cell * cell * cell / world->wall[0].doctor.volume - 1) <
                    0.005);
        const int n = cn_map_ridge(world->map, &x, &clearance);
        assert_true(n > 1000 && n < 40000);
        json_array_foreach(routes, r, route)
        {
            double entry[3], target[3], where[3];
            point_of(json_object_get(route, "entry"), scale, entry);
            point_of(json_object_get(route, "target"), scale, target);
            const double d = cn_world_distance(world, entry, NULL, NULL, NULL);
            assert_true(cn_map_clearance(world->map, entry) <= d &&
                        cn_map_clearance(world->map, entry) > 0.85 * d);
            const double known = scale * json_number_value(json_object_get(route, "clearance"));
            assert_true(cn_map_pinch(world->map, entry, target, where) > 0.9 * known);
            seen++;
        }
        cn_world_free(world);
    }
    json_decref(index);
    if (!seen) skip();
}

int main(void)
{
    fail_alloc_at(-1);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(free_cells_have_the_volume_of_what_they_fill),
        cmocka_unit_test(clearance_is_never_above_the_true_one_and_about_a_cell_below),
        cmocka_unit_test(the_ridge_of_a_tube_is_its_axis),
        cmocka_unit_test(the_ridge_goes_on_where_a_wide_vessel_becomes_narrow),
        cmocka_unit_test(a_neck_is_found_where_it_is),
        cmocka_unit_test(what_is_not_joined_ends_where_it_comes_nearest),
        cmocka_unit_test(an_entry_on_a_cap_has_its_clearance),
        cmocka_unit_test(around_obstacles_all_is_free_that_is_not_inside_them),
        cmocka_unit_test(a_scene_without_walls_has_a_map_without_limits),
        cmocka_unit_test(the_map_is_the_same_for_any_number_of_threads),
        cmocka_unit_test(the_map_does_not_depend_on_the_unit),
        cmocka_unit_test(a_map_without_a_radius_or_a_thread_is_refused),
        cmocka_unit_test(too_fine_a_cell_is_made_coarser),
        cmocka_unit_test(every_failing_allocation_is_survived),
        cmocka_unit_test(routes_of_real_vessels_are_wide_enough),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
