/* The planner over OMPL and the octree, through their C headers, on small worlds and on the real vessels. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>
#include <cmocka.h>
#include <jansson.h>
#include "../core/plan_cases.h"
#include "catnav/vec3.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static cn_path *plan(const cn_plan_query *query)
{
    cn_roadmap roadmap;
    cn_error error = {0};
    cn_path *path = NULL;
    const cn_status status = cn_plan_path(&path, query, cn_ompl_planner, &roadmap, &error);
    if (status != CN_OK) print_message("%s: %s\n", cn_status_text(status), error.message);
    assert_int_equal(status, CN_OK);
    assert_true(roadmap.reproducible);
    assert_true(roadmap.nvertex >= query->npoint && roadmap.nedge > 0);
    for (int i = 0; i < 2 * roadmap.nedge; i++)
        assert_in_range(roadmap.edge[i], 0, roadmap.nvertex - 1);
    cn_roadmap_clear(&roadmap);
    return path;
}

static void keeps_room(const cn_path *path, const plan_case *c)
{
    for (int i = 0; i < path->n; i++) {
        assert_true(path->clearance[i] >= c->radius + c->spec.clearance);
        assert_true(cn_world_free_at(c->world, path->x + 3 * i));
    }
}

/* y where the path passes the middle of the fork. */
static double middle(const cn_path *path)
{
    for (int i = 0; i < path->n; i++)
        if (path->x[3 * i] >= 0.03) return path->x[3 * i + 1];
    return NAN;
}

static const double fork_ends[6] = {0.005, 0.024, 0.005, 0.055, 0.024, 0.005};

static void a_bent_tube_is_passed_with_every_sampling_and_cost(void **state)
{
    plan_case c;
    double axis[3 * BENT], radius[BENT];
    const double point[6] = {0, 0, 2e-3, 0.03, 0, 0.032}, direction[3] = {0, 0, 1};
    (void)state;
    bent_axis(axis, radius, 3e-3);
    assert_int_equal(case_tube(&c, 0.7e-3, BENT, axis, radius), 0);
    for (int sampling = CN_SAMPLING_UNIFORM; sampling <= CN_SAMPLING_CONTACT; sampling++)
        for (int cost = CN_COST_LENGTH; cost <= CN_COST_BENDING; cost++) {
            c.spec.sampling = (cn_sampling)sampling;
            c.spec.cost = (cn_cost)cost;
            cn_plan_query query = case_query(&c, 2, point);
            query.direction = direction;
            cn_path *path = plan(&query);
            keeps_room(path, &c);
            assert_true(path->turn_max <= c.spec.max_turn);
            assert_true(cn_path_length(path) < 0.065);
            cn_path_free(path);
        }
    case_free(&c);
}

static void the_short_arm_is_taken_where_it_fits_and_the_wide_one_where_it_does_not(void **state)
{
    plan_case c;
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
    cn_plan_query query = case_query(&c, 2, fork_ends);
    cn_path *path = plan(&query);
    keeps_room(path, &c);
    assert_true(middle(path) > 0.027);
    cn_path_free(path);
    c.radius = query.radius = 2e-3; /* the tight arm has a radius of 1.5 mm */
    query.device_diameter = 4e-3;
    path = plan(&query);
    keeps_room(path, &c);
    assert_true(middle(path) < 0.009);
    cn_path_free(path);
    case_free(&c);
}

static void cost_clearance_has_more_room_than_cost_length(void **state)
{
    plan_case c;
    double least[2];
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
    for (int i = 0; i < 2; i++) {
        c.spec.cost = i ? CN_COST_CLEARANCE : CN_COST_LENGTH;
        const cn_plan_query query = case_query(&c, 2, fork_ends);
        cn_path *path = plan(&query);
        least[i] = INFINITY;
        for (int j = 0; j < path->n; j++)
            least[i] = fmin(least[i], path->clearance[j]);
        cn_path_free(path);
    }
    assert_true(least[1] > 1.5 * least[0]);
    case_free(&c);
}

static void a_refused_ball_forces_the_other_arm(void **state)
{
    plan_case c;
    const cn_ball ball = {{0.03, 0.0285, 0.005}, 5e-3};
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
    cn_plan_query query = case_query(&c, 2, fork_ends);
    query.nrefused = 1, query.refused = &ball;
    cn_path *path = plan(&query);
    keeps_room(path, &c);
    assert_true(middle(path) < 0.009);
    cn_path_free(path);
    case_free(&c);
}

static void an_unreachable_waypoint_is_no_path_with_the_pinch_named(void **state)
{
    plan_case c;
    cn_path *path;
    cn_roadmap roadmap;
    const double point[9] = {0.005, 0.024, 0.005, 0.01, 0.015, 0.005, 0.055, 0.024, 0.005};
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 1, 0, 1),
                     0); /* the wide arm is plugged, the tight one has 1.5 mm */
    for (int i = 0; i < 2; i++) {
        cn_error error = {0};
        cn_plan_query query = case_query(&c, 3, point);
        query.radius = i ? 2.5e-3 : 1.6e-3; /* clearly, and barely, too big */
        query.samples = 2000;
        assert_int_equal(cn_plan_path(&path, &query, cn_ompl_planner, &roadmap, &error), CN_ERR_NO_PATH);
        assert_null(path);
        assert_int_equal(roadmap.failed_leg, 1);
        assert_true(fabs(roadmap.pinch_radius - 1.5e-3) < 2 * cn_map_cell(c.world->map));
        assert_true(roadmap.pinch[0] > 0.019 && roadmap.pinch[0] < 0.041 && roadmap.pinch[1] > 0.026);
        assert_non_null(strstr(error.message, "waypoint 1"));
        assert_non_null(strstr(error.message, "mm"));
        cn_roadmap_clear(&roadmap);
    }
    case_free(&c);
}

static void the_same_seed_gives_the_same_path_bit_for_bit_on_any_thread_count(void **state)
{
    cn_path *path[3];
    (void)state;
    for (int sampling = CN_SAMPLING_UNIFORM; sampling <= CN_SAMPLING_CONTACT; sampling++) {
        for (int i = 0; i < 3; i++) {
            plan_case c;
            assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, i == 2 ? 2 : 1), 0);
            c.spec.sampling = (cn_sampling)sampling;
            cn_plan_query query = case_query(&c, 2, fork_ends);
            query.threads = i == 2 ? 2 : 1;
            query.seed = 7;
            path[i] = plan(&query);
            case_free(&c);
        }
        for (int i = 1; i < 3; i++) {
            assert_int_equal(path[i]->n, path[0]->n);
            assert_memory_equal(path[i]->x, path[0]->x, 3 * (size_t)path[0]->n * sizeof(double));
        }
        for (int i = 0; i < 3; i++)
            cn_path_free(path[i]);
    }
}

/* Of five seeds' paths, each also planned alone; by every cost. */
static void of_several_seeds_the_best_path_is_kept_on_any_thread_count(void **state)
{
    enum { SEEDS = 5 };
    (void)state;
    for (int cost = CN_COST_LENGTH; cost <= CN_COST_BENDING; cost++) {
        cn_path *kept[2], *alone[SEEDS];
        unsigned seed[2];
        plan_case c;
        assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
        c.spec.sampling = CN_SAMPLING_UNIFORM, c.spec.cost = (cn_cost)cost;
        for (int i = 0; i < 2; i++) {
            cn_roadmap roadmap;
            cn_error error = {0};
            cn_plan_query query = case_query(&c, 2, fork_ends);
            query.seed = 7, query.seeds = SEEDS, query.threads = 1 + i;
            assert_int_equal(cn_plan_path(&kept[i], &query, cn_ompl_planner, &roadmap, &error), CN_OK);
            assert_true(roadmap.reproducible && roadmap.npoint > 1);
            seed[i] = roadmap.seed;
            cn_roadmap_clear(&roadmap);
        }
        assert_int_equal(kept[0]->n, kept[1]->n);
        assert_memory_equal(kept[0]->x, kept[1]->x, 3 * (size_t)kept[0]->n * sizeof(double));
        assert_int_equal(seed[0], seed[1]);
        bool found = false;
        for (int k = 0; k < SEEDS; k++) {
            cn_plan_query query = case_query(&c, 2, fork_ends);
            query.seed = 7 + 0x9e3779b9u * (unsigned)k;
            alone[k] = plan(&query);
            double room = INFINITY, best = INFINITY;
            for (int i = 0; i < alone[k]->n; i++)
                room = fmin(room, alone[k]->clearance[i]);
            for (int i = 0; i < kept[0]->n; i++)
                best = fmin(best, kept[0]->clearance[i]);
            if (cost == CN_COST_LENGTH) assert_true(cn_path_length(kept[0]) <= cn_path_length(alone[k]));
            if (cost == CN_COST_CLEARANCE) assert_true(best >= room);
            if (query.seed == seed[0]) {
                found = true;
                assert_memory_equal(alone[k]->x, kept[0]->x, 3 * (size_t)kept[0]->n * sizeof(double));
            }
            cn_path_free(alone[k]);
        }
        assert_true(found);
        case_free(&c);
        cn_path_free(kept[0]), cn_path_free(kept[1]);
    }
}

static void waypoints_are_passed_in_order(void **state)
{
    plan_case c;
    const double point[12] = {0.005, 0.024, 0.005, 0.03, 0.0285, 0.005,
                              0.05,  0.015, 0.005, 0.03, 0.0045, 0.005};
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
    const cn_plan_query query = case_query(&c, 4, point);
    cn_path *path = plan(&query);
    keeps_room(path, &c);
    assert_int_equal(path->nwaypoint, 3);
    for (int i = 0; i < 3; i++)
        assert_memory_equal(path->x + 3 * path->waypoint[i], point + 3 * (i + 1), 3 * sizeof *point);
    assert_true(path->waypoint[0] < path->waypoint[1] && path->waypoint[1] < path->waypoint[2]);
    assert_true(path->turn_max <= c.spec.max_turn);
    cn_path_free(path);
    case_free(&c);
}

static void a_region_is_kept(void **state)
{
    plan_case c;
    const double ends[6] = {0.005, 0.0045, 0.003, 0.055, 0.0045, 0.003};
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 1, 1), 0);
    c.spec.region = CN_REGION_PLANE;
    memcpy(c.spec.plane_point, ends, sizeof c.spec.plane_point);
    c.spec.plane_normal[2] = 1;
    cn_plan_query query = case_query(&c, 2, ends);
    cn_path *path = plan(&query);
    for (int i = 0; i < path->n; i++)
        assert_true(fabs(path->x[3 * i + 2] - 0.003) < 0.3e-3);
    cn_path_free(path);
    c.spec.region = CN_REGION_BOX;
    memcpy(c.spec.box, (double[2][3]){{0, 0, 0}, {0.06, 0.03, 0.004}}, sizeof c.spec.box);
    path = plan(&query);
    for (int i = 0; i < path->n; i++)
        assert_true(path->x[3 * i + 2] < 0.0043);
    cn_path_free(path);
    case_free(&c);
}

/* Contact sampling brings the path to the wall, the medial axis keeps it away, uniform lies between. */
static void sampling_by_contact_hugs_the_wall_and_by_the_medial_axis_keeps_off_it(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.1}, radius[2] = {0.01, 0.01}, mean[3];
    const double ends[6] = {0, 0.008, 0.01, 0.0, 0.008, 0.09};
    (void)state;
    assert_int_equal(case_tube(&c, 1e-3, 2, axis, radius), 0);
    for (int sampling = CN_SAMPLING_UNIFORM; sampling <= CN_SAMPLING_CONTACT; sampling++) {
        cn_roadmap roadmap;
        cn_error error = {0};
        cn_path *path;
        c.spec.sampling = (cn_sampling)sampling;
        const cn_plan_query query = case_query(&c, 2, ends);
        assert_int_equal(cn_plan_path(&path, &query, cn_ompl_planner, &roadmap, &error), CN_OK);
        mean[sampling] = 0;
        for (int i = 0; i < roadmap.nvertex; i++) {
            const double d = cn_world_distance(c.world, roadmap.vertex + 3 * i, NULL, NULL, NULL);
            mean[sampling] += d / roadmap.nvertex;
            if (sampling == CN_SAMPLING_CONTACT && i >= 2) assert_true(d >= 1e-3 && d < 1.1e-3);
        }
        for (int i = 0; i < path->n && sampling == CN_SAMPLING_CONTACT; i++)
            assert_true(path->clearance[i] < 2.1e-3); /* that of its ends is 2 mm */
        cn_roadmap_clear(&roadmap);
        cn_path_free(path);
    }
    assert_true(mean[CN_SAMPLING_MEDIAL_AXIS] > 1.2 * mean[CN_SAMPLING_UNIFORM]);
    assert_true(mean[CN_SAMPLING_UNIFORM] > 2 * mean[CN_SAMPLING_CONTACT]);
    case_free(&c);
}

/* The short way passes between two blocks that stand in each other's way, a sharp double bend; the long one
 * runs straight beside them. */
static void the_way_that_turns_too_much_is_left_for_a_gentler_one(void **state)
{
    plan_case c;
    const double ends[6] = {0.005, 0.01, 0.005, 0.115, 0.01, 0.005};
    double length[2], turn[2];
    (void)state;
    case_begin(&c, 0.7e-3);
    c.vessel.shape.kind = CN_SHAPE_BOX;
    memcpy(c.vessel.shape.box.max, (double[3]){0.12, 0.06, 0.01}, 3 * sizeof(double));
    case_rock(&c, (double[3]){0.04, -0.001, -0.001}, (double[3]){0.058, 0.012, 0.011});
    case_rock(&c, (double[3]){0.04, 0.016, -0.001}, (double[3]){0.058, 0.045, 0.011});
    case_rock(&c, (double[3]){0.062, 0.005, -0.001}, (double[3]){0.08, 0.045, 0.011});
    assert_int_equal(case_end(&c, 1), 0);
    for (int i = 0; i < 2; i++) {
        c.spec.max_turn = i ? 20 * 0.0174532925 : 3.1;
        cn_plan_query query = case_query(&c, 2, ends);
        query.device_diameter = 4e-3;
        cn_path *path = plan(&query);
        keeps_room(path, &c);
        length[i] = cn_path_length(path), turn[i] = path->turn_max;
        cn_path_free(path);
    }
    assert_true(turn[0] > 40 * 0.0174532925 && turn[1] <= 20 * 0.0174532925);
    assert_true(length[1] > length[0]);
    case_free(&c);
}

static void in_the_open_a_rock_is_gone_around(void **state)
{
    plan_case c;
    const double ends[6] = {-0.03, 0.001, 0, 0.03, 0.001, 0};
    cn_body_spec body = {.nwaypoint = 2, .waypoint = (double *)ends};
    (void)state;
    for (int sampling = CN_SAMPLING_UNIFORM; sampling <= CN_SAMPLING_MEDIAL_AXIS; sampling++) {
        case_begin(&c, 2e-3);
        c.scene.nvessel = 0;
        body.shape.kind = CN_SHAPE_SPHERE;
        body.shape.sphere.radius = 2e-3;
        body.shape.placement.scale = 1;
        memcpy(body.shape.sphere.centre, ends, 3 * sizeof *ends);
        c.scene.nbody = 1;
        c.scene.body = &body;
        case_rock(&c, (double[3]){-0.01, -0.01, -0.01}, (double[3]){0.01, 0.01, 0.01});
        assert_int_equal(case_end(&c, 1), 0);
        c.spec.sampling = (cn_sampling)sampling;
        const cn_plan_query query = case_query(&c, 2, ends);
        cn_path *path = plan(&query);
        keeps_room(path, &c);
        assert_true(cn_path_length(path) < 0.075); /* straight: 60 mm, tight around: 66 mm */
        assert_true(path->turn_max <= c.spec.max_turn);
        cn_path_free(path);
        case_free(&c);
    }
}

static void a_search_can_be_cancelled_and_the_budget_ends_it(void **state)
{
    plan_case c;
    volatile sig_atomic_t cancel = 1;
    cn_path *path;
    cn_roadmap roadmap;
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 1, 1, 1), 0);
    cn_plan_query query = case_query(&c, 2, fork_ends);
    query.cancel = &cancel;
    cn_error error = {0};
    assert_int_equal(cn_plan_path(&path, &query, cn_ompl_planner, &roadmap, &error), CN_ERR_CANCELLED);
    cn_roadmap_clear(&roadmap);
    cancel = 0;
    query.budget = 0;
    cn_error late = {0};
    assert_int_equal(cn_plan_path(&path, &query, cn_ompl_planner, &roadmap, &late), CN_ERR_TIMEOUT);
    assert_false(roadmap.reproducible);
    cn_roadmap_clear(&roadmap);
    case_free(&c);
}

static void the_octree_is_the_free_space(void **state)
{
    plan_case c;
    cn_octree *octree;
    double origin[3];
    int size[3], wrong = 0;
    const char *path = "test_ompl_planner_octree.bt"; /* in the working folder */
    (void)state;
    assert_int_equal(case_fork(&c, 0.7e-3, 0, 0, 1), 0);
    assert_int_equal(cn_octree_new(&octree, c.world->map, NULL), CN_OK);
    cn_map_frame(c.world->map, origin, size);
    const double cell = cn_map_cell(c.world->map);
    for (int i = 0; i < 20000; i++) { /* points of a fixed lattice, a cell and more from any wall */
        const double p[3] = {0.06 * (i % 47) / 47, 0.03 * (i % 31) / 31, 0.01 * (i % 13) / 13};
        if (cn_world_distance(c.world, p, NULL, NULL, NULL) < 2 * cell) continue;
        wrong += cn_octree_free_at(octree, p) != cn_world_free_at(c.world, p);
    }
    assert_int_equal(wrong, 0);
    long inside = 0; /* each cell of its cubes is found, and no other */
    for (int i = 0; i < size[0] * size[1] * size[2]; i++) {
        const int at[3] = {i % size[0], i / size[0] % size[1], i / size[0] / size[1]};
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = origin[k] + (at[k] + 0.5) * cell;
        inside += cn_octree_free_at(octree, p);
    }
    assert_true(fabs(cn_octree_volume(octree) / (cell * cell * cell) - (double)inside) <
                1e-6 * (double)inside);
    assert_false(cn_octree_free_at(octree, (double[3]){NAN, 0, 0}));
    assert_false(cn_octree_free_at(octree, (double[3]){1e9, 0, 0}));
    const double volume = 0.06 * 0.03 * 0.01 - 0.02 * 0.018 * 0.01;
    assert_true(fabs(cn_octree_volume(octree) / volume - 1) < 0.15);
    for (int i = 0; i < 1000; i++) { /* a sample is free */
        double p[3];
        cn_octree_sample(octree, (double[4]){i % 10 / 10.0, i % 7 / 7.0, i % 3 / 3.0, i / 1000.0}, p);
        assert_true(cn_octree_free_at(octree, p));
    }
    const double *ridge, *clearance;
    const int nridge = cn_map_ridge(c.world->map, &ridge, &clearance);
    assert_int_equal(cn_octree_ridge_leaves(octree), nridge);
    for (int i = 0; i < nridge; i++)
        assert_true(cn_octree_ridge_at(octree, ridge + 3 * i));
    assert_int_equal(cn_octree_write(octree, path, NULL), CN_OK);
    remove(path);
    assert_int_equal(cn_octree_write(octree, "no/such/folder/tree.bt", NULL), CN_ERR_FILE);
    cn_octree_free(octree);
    assert_int_equal(cn_octree_attach(c.world, NULL), CN_OK);
    cn_octree *kept = c.world->octree;
    assert_int_equal(cn_octree_attach(c.world, NULL), CN_OK);
    assert_ptr_equal(kept, c.world->octree);
    case_free(&c);
}

/* One route of a real vessel: prints the figures, checks what the data promise. */
static void route(const char *folder, const json_t *vessel, const json_t *way)
{
    plan_case c;
    char file[4096];
    double point[6], direction[3];
    const double scale = json_number_value(json_object_get(vessel, "scale"));
    for (int k = 0; k < 3; k++) {
        point[k] = scale * json_number_value(json_array_get(json_object_get(way, "entry"), (size_t)k));
        point[3 + k] = scale * json_number_value(json_array_get(json_object_get(way, "target"), (size_t)k));
        direction[k] = json_number_value(json_array_get(json_object_get(way, "direction"), (size_t)k));
    }
    snprintf(file, sizeof file, "%s/%s", folder, json_string_value(json_object_get(vessel, "file")));
    case_begin(&c, 0.675e-3);
    c.vessel.shape.kind = CN_SHAPE_FILE;
    c.vessel.shape.file = file;
    c.vessel.shape.placement.scale = scale;
    const double t0 = now();
    assert_int_equal(case_end(&c, 2), 0);
    const double t1 = now();
    assert_int_equal(cn_octree_attach(c.world, NULL), CN_OK);
    const double t2 = now();
    cn_plan_query query = case_query(&c, 2, point);
    if (json_is_array(json_object_get(way, "direction"))) query.direction = direction;
    cn_roadmap roadmap;
    cn_error error = {0};
    assert_int_equal(cn_ompl_planner(&query, &roadmap, &error), CN_OK);
    const double t3 = now();
    cn_roadmap_clear(&roadmap);
    cn_path *path = plan(&query), *again = plan(&query);
    const double t4 = now();
    keeps_room(path, &c);
    double least = INFINITY, curvature = 0;
    for (int i = 0; i < path->n; i++) {
        cn_place place;
        cn_path_at(path, path->s[i], &place);
        least = fmin(least, path->clearance[i]);
        curvature = fmax(curvature, place.curvature);
    }
    print_message(
        "%s: map %.2f s, octree %.3f s (%zu leaves, %zu ridge, %.1f MB), search %.3f s, whole plan %.3f s; "
        "%d points, length %.1f mm, least clearance %.3f mm, turn %.1f deg, least radius %.2f mm\n",
        file, t1 - t0, t2 - t1, cn_octree_leaves(c.world->octree), cn_octree_ridge_leaves(c.world->octree),
        1e-6 * (double)cn_octree_memory(c.world->octree), t3 - t2, 0.5 * (t4 - t3), path->n,
        1e3 * cn_path_length(path), 1e3 * least, path->turn_max * 57.29577951308232, 1e3 / curvature);
    assert_true(path->turn_max <= c.spec.max_turn);
    assert_int_equal(path->n, again->n);
    assert_memory_equal(path->x, again->x, 3 * (size_t)path->n * sizeof(double));
    const json_t *length = json_object_get(way, "length"); /* of an unsmoothed grid path: an upper bound */
    if (length) assert_true(cn_path_length(path) < 1.02 * scale * json_number_value(length));
    cn_path_free(path);
    cn_path_free(again);
    case_free(&c);
}

static void every_route_of_the_real_vessels_is_found(void **state)
{
    const char *folder = getenv("CATNAV_DATA") ? getenv("CATNAV_DATA") : CATNAV_TEST_DATA;
    char file[4096];
    size_t i, j, routes = 0;
    json_t *vessel, *way;
    (void)state;
    snprintf(file, sizeof file, "%s/index.json", folder);
    json_t *index = json_load_file(file, 0, NULL);
    json_array_foreach(json_object_get(index, "vessels"), i, vessel)
        json_array_foreach(json_object_get(vessel, "routes"), j, way)
    {
        const char *expect = json_string_value(json_object_get(way, "expect"));
        if (!expect || strcmp(expect, "REACHED")) continue;
        route(folder, vessel, way);
        routes++;
    }
    json_decref(index);
    if (!routes) skip();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_bent_tube_is_passed_with_every_sampling_and_cost),
        cmocka_unit_test(the_short_arm_is_taken_where_it_fits_and_the_wide_one_where_it_does_not),
        cmocka_unit_test(cost_clearance_has_more_room_than_cost_length),
        cmocka_unit_test(a_refused_ball_forces_the_other_arm),
        cmocka_unit_test(an_unreachable_waypoint_is_no_path_with_the_pinch_named),
        cmocka_unit_test(the_same_seed_gives_the_same_path_bit_for_bit_on_any_thread_count),
        cmocka_unit_test(of_several_seeds_the_best_path_is_kept_on_any_thread_count),
        cmocka_unit_test(waypoints_are_passed_in_order),
        cmocka_unit_test(a_region_is_kept),
        cmocka_unit_test(sampling_by_contact_hugs_the_wall_and_by_the_medial_axis_keeps_off_it),
        cmocka_unit_test(the_way_that_turns_too_much_is_left_for_a_gentler_one),
        cmocka_unit_test(in_the_open_a_rock_is_gone_around),
        cmocka_unit_test(a_search_can_be_cancelled_and_the_budget_ends_it),
        cmocka_unit_test(the_octree_is_the_free_space),
        cmocka_unit_test(every_route_of_the_real_vessels_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
