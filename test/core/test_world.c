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

#ifndef CATNAV_TEST_DATA
#define CATNAV_TEST_DATA "test/data"
#endif

static cn_surface_spec sphere(char *name, double x, double y, double z, double radius)
{
    cn_surface_spec spec = {.name = name, .shape = {.kind = CN_SHAPE_SPHERE, .placement.scale = 1}};
    const double centre[3] = {x, y, z};
    cn_copy3(centre, spec.shape.sphere.centre);
    spec.shape.sphere.radius = radius;
    return spec;
}

static cn_surface_spec box(char *name, const double min[3], const double max[3])
{
    cn_surface_spec spec = {.name = name, .shape = {.kind = CN_SHAPE_BOX, .placement.scale = 1}};
    cn_copy3(min, spec.shape.box.min), cn_copy3(max, spec.shape.box.max);
    return spec;
}

static cn_surface_spec tube(char *name, double *axis, double *radius, double thickness)
{
    cn_surface_spec spec = {.name = name, .shape = {.kind = CN_SHAPE_TUBE, .placement.scale = 1}};
    spec.shape.tube.naxis = 2, spec.shape.tube.axis = axis;
    spec.shape.tube.nradius = 1, spec.shape.tube.radius = radius, spec.shape.tube.thickness = thickness;
    return spec;
}

static cn_world *world_of(const cn_scene *scene)
{
    cn_world *world;
    cn_error error = {0};
    assert_int_equal(cn_world_new(&world, scene, 0, NULL, &error), CN_OK);
    return world;
}

static double random_in(unsigned *seed, double low, double high)
{
    *seed = 1664525u * *seed + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

/* --- closed forms --- */

static void inside_a_sphere_is_free_and_the_distance_is_to_its_wall(void **state)
{
    (void)state;
    cn_surface_spec vessel = sphere("ball", 1, 2, 3, 0.5);
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    cn_world *world = world_of(&scene);
    unsigned seed = 1;
    assert_true(world->wall[0].closed && world->wall[0].ncap == 0);
    for (int i = 0; i < 300; i++) {
        const double p[3] = {random_in(&seed, 0.3, 1.7), random_in(&seed, 1.3, 2.7),
                             random_in(&seed, 2.3, 3.7)};
        const double r = cn_distance(p, (double[3]){1, 2, 3});
        double nearest[3];
        int wall, tri;
        const double d = cn_world_distance(world, p, &wall, &tri, nearest);
        assert_true(fabs(d - fabs(r - 0.5)) < 0.002 && wall == 0 && tri >= 0);
        assert_true(fabs(cn_distance(p, nearest) - d) < 1e-12);
        if (fabs(r - 0.5) > 0.002) assert_int_equal(cn_world_free_at(world, p), r < 0.5);
    }
    assert_false(cn_world_free_at(world, (double[3]){NAN, 2, 3}));
    cn_world_free(world), cn_world_free(NULL);
}

static void outside_closed_obstacles_is_free_and_a_plane_frees_one_side(void **state)
{
    (void)state;
    cn_surface_spec obstacle[2] = {
        box("crate", (double[3]){0, 0, 0}, (double[3]){1, 1, 1}),
        {.name = "floor", .shape = {.kind = CN_SHAPE_PLANE, .placement.scale = 1}}};
    cn_copy3((double[3]){0, 0, -1}, obstacle[1].shape.plane.point);
    cn_copy3((double[3]){0, 0, 2}, obstacle[1].shape.plane.normal);
    cn_scene scene = {.nobstacle = 2, .obstacle = obstacle};
    cn_world *world = world_of(&scene);
    assert_false(cn_world_free_at(world, (double[3]){0.5, 0.5, 0.5}));
    assert_true(cn_world_free_at(world, (double[3]){0.5, 0.5, 1.5}));
    assert_true(cn_world_free_at(world, (double[3]){3, 0.5, -0.99}));
    assert_false(cn_world_free_at(world, (double[3]){0.5, 0.5, -1.01}));
    assert_true(fabs(cn_world_distance(world, (double[3]){2, 0.5, 0}, NULL, NULL, NULL) - 1) < 1e-12);
    assert_true(fabs(cn_world_distance(world, (double[3]){4, 0.5, 0}, NULL, NULL, NULL) - 1) <
                1e-12); /* floor */
    cn_world_free(world);
}

static void an_empty_scene_is_all_free(void **state)
{
    (void)state;
    cn_scene scene = {0};
    cn_world *world = world_of(&scene);
    assert_true(cn_world_free_at(world, (double[3]){1, 2, 3}));
    assert_true(isinf(cn_world_distance(world, (double[3]){1, 2, 3}, NULL, NULL, NULL)));
    cn_world_free(world);
}

static void an_open_tube_has_caps_and_corridors_beyond_them(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0, 0, 0.1}, radius = 0.01;
    cn_surface_spec vessel = tube("tube", axis, &radius, 0);
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    cn_world *world = world_of(&scene);
    const cn_wall *wall = world->wall;
    assert_int_equal(wall->ncap, 2);
    assert_false(wall->closed);
    assert_int_equal(wall->surface->ntri + wall->caps->ntri, wall->surface->ntri + 2 * 48);
    for (int c = 0; c < 2; c++) {
        const double side = wall->cap[c][2] < 0.05 ? -1 : 1; /* outward along the axis */
        assert_true(fabs(wall->cap[c][5] - side) < 1e-12 && fabs(wall->cap[c][6] - radius) < 1e-12);
    }
    for (double z = -0.2; z < 0.3; z += 0.013) {
        assert_true(cn_world_free_at(world, (double[3]){0.006, 0.007, z}));
        assert_false(cn_world_free_at(world, (double[3]){0.008, 0.007, z}));
    }
    cn_world_free(world);
}

static void a_slanted_or_wavy_rim_is_capped_without_a_leak(void **state)
{
    (void)state;
    /* a tube of 24 sides whose upper rim waves by a tenth of the radius */
    enum { N = 24 };
    cn_surface *s;
    assert_int_equal(cn_surface_new(&s, 2 * N, 2 * N), CN_OK);
    for (int i = 0; i < N; i++) {
        const double a = 2 * 3.14159265358979 * i / N;
        cn_copy3((double[3]){cos(a), sin(a), 0}, s->vert + 3 * i);
        cn_copy3((double[3]){cos(a), sin(a), 5 + 0.5 * cos(a) + 0.1 * sin(3 * a)}, s->vert + 3 * (N + i));
        const int j = (i + 1) % N, quad[6] = {i, j, N + j, i, N + j, N + i};
        memcpy(s->tri + 6 * i, quad, sizeof quad);
    }
    cn_surface_spec vessel = sphere("tube", 0, 0, 0, 1);
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    const cn_replacement given = {"", s};
    cn_world *world;
    assert_int_equal(cn_world_new(&world, &scene, 1, &given, NULL), CN_OK);
    assert_int_equal(world->wall[0].ncap, 2);
    unsigned seed = 7;
    for (int i = 0; i < 1000; i++) { /* below the rim: parity; on the axis: free all the way */
        const double x = random_in(&seed, -1.2, 1.2), y = random_in(&seed, -1.2, 1.2),
                     z = random_in(&seed, 0, 4.3);
        const double r = sqrt(x * x + y * y);
        if (r < 0.99) assert_true(cn_world_free_at(world, (double[3]){x, y, z}));
        if (r > 1.001) assert_false(cn_world_free_at(world, (double[3]){x, y, z}));
        assert_true(cn_world_free_at(world, (double[3]){0, 0, 4 + 0.002 * i}));
    }
    cn_world_free(world), cn_surface_free(s);
}

static void vessels_add_up_and_obstacles_take_away(void **state)
{
    (void)state;
    double across[6] = {-0.1, 0, 0, 0.1, 0, 0}, along[6] = {0, -0.1, 0, 0, 0.1, 0}, radius = 0.01;
    cn_surface_spec vessel[2] = {tube("a", across, &radius, 0), tube("b", along, &radius, 0)};
    cn_surface_spec rock = sphere("rock", 0, 0, 0, 0.004);
    cn_scene scene = {.nvessel = 2, .vessel = vessel, .nobstacle = 1, .obstacle = &rock};
    cn_world *world = world_of(&scene);
    assert_true(cn_world_free_at(world, (double[3]){0.05, 0, 0}));
    assert_true(cn_world_free_at(world, (double[3]){0, 0.05, 0}));
    assert_true(cn_world_free_at(world, (double[3]){0.005, 0.005, 0}));
    assert_false(cn_world_free_at(world, (double[3]){0.05, 0.05, 0}));
    assert_false(cn_world_free_at(world, (double[3]){0.001, 0, 0}));
    assert_true(world->wall[0].vessel && world->wall[1].vessel && !world->wall[2].vessel);
    cn_world_free(world);
}

static void an_open_obstacle_takes_nothing_away(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0, 0, 1}, radius = 0.1;
    cn_surface_spec obstacle = tube("sleeve", axis, &radius, 0);
    cn_scene scene = {.nobstacle = 1, .obstacle = &obstacle};
    cn_world *world = world_of(&scene);
    assert_false(world->wall[0].closed);
    assert_true(cn_world_free_at(world, (double[3]){0, 0, 0.5}));
    assert_true(fabs(cn_world_distance(world, (double[3]){0, 0, 0.5}, NULL, NULL, NULL) - 0.1) < 3e-4);
    cn_world_free(world);
    obstacle.shape.tube.thickness = 0.01; /* a solid wall with a bore */
    world = world_of(&scene);
    assert_true(world->wall[0].closed);
    assert_true(cn_world_free_at(world, (double[3]){0, 0, 0.5}));
    assert_false(cn_world_free_at(world, (double[3]){0.105, 0, 0.5}));
    cn_world_free(world);
}

/* --- orientation, placement, replacement --- */

static void an_inward_lumen_is_turned_and_answers_the_same(void **state)
{
    (void)state;
    cn_surface *s;
    assert_int_equal(cn_surface_sphere(&s, (double[3]){0, 0, 0}, 1), CN_OK);
    for (int t = 0; t < s->ntri; t++) {
        const int swap = s->tri[3 * t];
        s->tri[3 * t] = s->tri[3 * t + 1], s->tri[3 * t + 1] = swap;
    }
    cn_surface_spec vessel = sphere("v", 9, 9, 9, 1);
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    const cn_replacement given = {"v", s};
    cn_world *world;
    assert_int_equal(cn_world_new(&world, &scene, 1, &given, NULL), CN_OK);
    assert_true(world->wall[0].doctor.turned && world->wall[0].doctor.volume > 0);
    assert_ptr_not_equal(world->wall[0].surface, s); /* copied */
    assert_true(cn_world_free_at(world, (double[3]){0.5, 0.5, 0.5}));
    assert_false(cn_world_free_at(world, (double[3]){9, 9, 9}));
    cn_world_free(world), cn_surface_free(s);
}

static void a_placement_moves_a_shape_with_all_it_holds(void **state)
{
    (void)state;
    cn_surface_spec vessel = box("v", (double[3]){0, 0, 0}, (double[3]){1000, 100, 100});
    vessel.shape.placement = (cn_placement){0.001, {0, 0, 1.5707963267948966}, {5, 0, 0}};
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    cn_world *world = world_of(&scene);
    assert_true(cn_world_free_at(world, (double[3]){4.95, 0.9, 0.05})); /* along y now */
    assert_false(cn_world_free_at(world, (double[3]){5.5, 0.05, 0.05}));
    assert_true(fabs(world->max[1] - 1) < 1e-12);
    cn_world_free(world);
}

static void what_cannot_be_a_wall_is_refused_by_name(void **state)
{
    (void)state;
    cn_world *world;
    cn_error error = {0};
    cn_surface_spec vessel = sphere("aorta", 0, 0, 0, 1);
    cn_scene scene = {.nvessel = 1, .vessel = &vessel};
    const cn_replacement other = {"vein", NULL};
    assert_int_equal(cn_world_new(&world, &scene, 1, &other, &error), CN_ERR_SCENE);
    assert_non_null(strstr(error.message, "vein"));

    error = (cn_error){0}, vessel.shape.sphere.radius = NAN;
    assert_int_equal(cn_world_new(&world, &scene, 0, NULL, &error), CN_ERR_SCENE);
    assert_non_null(strstr(error.message, "aorta"));

    error = (cn_error){0}, vessel.shape.kind = CN_SHAPE_PLANE, vessel.shape.plane.normal[2] = 1;
    assert_int_equal(cn_world_new(&world, &scene, 0, NULL, &error), CN_ERR_SCENE);

    error = (cn_error){0}, vessel.shape.kind = CN_SHAPE_BEAM;
    assert_int_equal(cn_world_new(&world, &scene, 0, NULL, &error), CN_ERR_SCENE);

    error = (cn_error){0}, vessel.shape.kind = CN_SHAPE_FILE, vessel.shape.file = "no/such/file.stl";
    assert_int_not_equal(cn_world_new(&world, &scene, 0, NULL, &error), CN_OK);
    assert_null(world);
    assert_int_not_equal(error.status, CN_OK);
}

static void answers_do_not_depend_on_the_unit(void **state)
{
    (void)state;
    double axis[6] = {0, 0, 0, 0.03, 0.01, 0.1}, radius = 0.01, axis_um[6], radius_um = 1e4;
    for (int k = 0; k < 6; k++)
        axis_um[k] = 1e6 * axis[k];
    cn_surface_spec v[2] = {tube("m", axis, &radius, 0), tube("um", axis_um, &radius_um, 0)};
    cn_scene scene[2] = {{.nvessel = 1, .vessel = v}, {.nvessel = 1, .vessel = v + 1}};
    cn_world *m = world_of(scene), *um = world_of(scene + 1);
    unsigned seed = 3;
    for (int i = 0; i < 300; i++) {
        const double p[3] = {random_in(&seed, -0.02, 0.05), random_in(&seed, -0.02, 0.03),
                             random_in(&seed, -0.02, 0.12)};
        const double q[3] = {1e6 * p[0], 1e6 * p[1], 1e6 * p[2]};
        const double a = cn_world_distance(m, p, NULL, NULL, NULL),
                     b = cn_world_distance(um, q, NULL, NULL, NULL);
        assert_true(fabs(1e6 * a - b) < 1e-9 * b + 1e-6);
        assert_int_equal(cn_world_free_at(m, p), cn_world_free_at(um, q));
    }
    cn_world_free(m), cn_world_free(um);
}

/* --- the answer with the map is the answer without it --- */

static void same_with_and_without_map(const cn_scene *scene, double radius)
{
    cn_world *world = world_of(scene);
    cn_error error = {0};
    assert_int_equal(cn_world_map(world, radius, 1, &error), CN_OK);
    unsigned seed = 11;
    double size[3];
    cn_sub(world->max, world->min, size);
    int nfree = 0;
    for (int i = 0; i < 20000; i++) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = random_in(&seed, world->min[k] - 0.2 * size[k], world->max[k] + 0.2 * size[k]);
        const bool exact = cn_world_free_at(world, p);
        assert_int_equal(cn_world_free_fast(world, p), exact);
        nfree += exact;
        const double clearance = cn_map_clearance(world->map, p);
        assert_true(clearance <= (exact ? cn_world_distance(world, p, NULL, NULL, NULL) : 0));
    }
    assert_true(nfree > 100);
    cn_world_free(world);
}

static void the_quick_test_agrees_with_the_exact_one(void **state)
{
    (void)state;
    double across[6] = {-0.1, 0, 0, 0.1, 0, 0}, along[6] = {0, -0.1, 0, 0, 0.1, 0.02}, radius = 0.01;
    cn_surface_spec vessel[2] = {tube("a", across, &radius, 0), tube("b", along, &radius, 0)};
    cn_surface_spec obstacle[2] = {
        sphere("rock", 0.005, 0, 0, 0.004),
        {.name = "floor", .shape = {.kind = CN_SHAPE_PLANE, .placement.scale = 1}}};
    cn_copy3((double[3]){0, 0, -0.003}, obstacle[1].shape.plane.point);
    cn_copy3((double[3]){0.1, 0, 1}, obstacle[1].shape.plane.normal);
    cn_scene tubes = {.nvessel = 2, .vessel = vessel, .nobstacle = 2, .obstacle = obstacle};
    cn_scene rocks = {.nobstacle = 2, .obstacle = obstacle};
    same_with_and_without_map(&tubes, 0.002);
    same_with_and_without_map(&rocks, 0.001);
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

static void entries_and_targets_of_real_vessels_lie_inside(void **state)
{
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/index.json", data_folder());
    json_t *index = json_load_file(path, 0, NULL), *vessel;
    size_t i, r;
    int seen = 0;
    if (!index) skip();
    json_array_foreach(json_object_get(index, "vessels"), i, vessel)
    {
        const char *file = json_string_value(json_object_get(vessel, "file"));
        const char *check = json_string_value(json_object_get(vessel, "check"));
        const double scale = json_number_value(json_object_get(vessel, "scale"));
        snprintf(path, sizeof path, "%s/%s", data_folder(), file);
        FILE *there = fopen(path, "rb");
        if (!there || !(scale > 0) || !check) {
            if (there) fclose(there);
            continue;
        }
        fclose(there);
        cn_surface_spec spec = {.name = "vessel", .shape = {.kind = CN_SHAPE_FILE, .file = path}};
        spec.shape.placement.scale = scale;
        cn_scene scene = {.nvessel = 1, .vessel = &spec};
        cn_world *world;
        cn_error error = {0};
        const cn_status status = cn_world_new(&world, &scene, 0, NULL, &error);
        if (status != CN_OK) {
            assert_string_not_equal(check, "usable");
            assert_true(strlen(error.message) > 10);
            continue;
        }
        const json_t *loops = json_object_get(vessel, "loops");
        if (loops && !strcmp(check, "usable"))
            assert_int_equal(world->wall[0].ncap, json_integer_value(loops));
        json_t *route;
        json_array_foreach(json_object_get(vessel, "routes"), r, route)
        {
            double entry[3], target[3];
            point_of(json_object_get(route, "entry"), scale, entry);
            point_of(json_object_get(route, "target"), scale, target);
            assert_true(cn_world_free_at(world, entry) && cn_world_free_at(world, target));
            const json_t *clearance = json_object_get(route, "clearance");
            if (clearance) {
                const double least = scale * json_number_value(clearance);
                assert_true(cn_world_distance(world, entry, NULL, NULL, NULL) > 0.99 * least);
                assert_true(cn_world_distance(world, target, NULL, NULL, NULL) > 0.99 * least);
            }
            seen++;
        }
        cn_world_free(world);
    }
    json_decref(index);
    if (!seen) skip();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(inside_a_sphere_is_free_and_the_distance_is_to_its_wall),
        cmocka_unit_test(outside_closed_obstacles_is_free_and_a_plane_frees_one_side),
        cmocka_unit_test(an_empty_scene_is_all_free),
        cmocka_unit_test(an_open_tube_has_caps_and_corridors_beyond_them),
        cmocka_unit_test(a_slanted_or_wavy_rim_is_capped_without_a_leak),
        cmocka_unit_test(vessels_add_up_and_obstacles_take_away),
        cmocka_unit_test(an_open_obstacle_takes_nothing_away),
        cmocka_unit_test(an_inward_lumen_is_turned_and_answers_the_same),
        cmocka_unit_test(a_placement_moves_a_shape_with_all_it_holds),
        cmocka_unit_test(what_cannot_be_a_wall_is_refused_by_name),
        cmocka_unit_test(answers_do_not_depend_on_the_unit),
        cmocka_unit_test(the_quick_test_agrees_with_the_exact_one),
        cmocka_unit_test(entries_and_targets_of_real_vessels_lie_inside),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
