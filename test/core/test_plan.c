/* The path made from a planner's polyline: a hand-drawn polyline stands in for the planner. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include "catnav/vec3.h"
#include "plan_cases.h"

static const double pi = 3.14159265358979323846;

/* The polyline the planner below answers with: guide (nguide x 3), all in leg `guide_leg`. */
static const double *guide;
static const int *guide_leg;
static int nguide;

static cn_status draw(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    (void)query, (void)error;
    roadmap->x = malloc(3 * (size_t)nguide * sizeof *roadmap->x);
    roadmap->leg = malloc((size_t)nguide * sizeof *roadmap->leg);
    if (!roadmap->x || !roadmap->leg) return CN_ERR_MEMORY;
    memcpy(roadmap->x, guide, 3 * (size_t)nguide * sizeof *guide);
    for (int i = 0; i < nguide; i++)
        roadmap->leg[i] = guide_leg ? guide_leg[i] : i > 0;
    roadmap->npoint = nguide;
    roadmap->reproducible = true;
    return CN_OK;
}

static cn_status refuse(const cn_plan_query *query, cn_roadmap *roadmap, cn_error *error)
{
    (void)query;
    roadmap->pinch_radius = 1e-4;
    return cn_fail(error, CN_ERR_NO_PATH, NULL, 0, "pinched");
}

static cn_path *plan(const cn_plan_query *query, int n, const double *x, const int *leg)
{
    cn_roadmap roadmap;
    cn_error error = {0};
    cn_path *path = NULL;
    nguide = n, guide = x, guide_leg = leg;
    const cn_status status = cn_plan_path(&path, query, draw, &roadmap, &error);
    if (status != CN_OK) print_message("%s: %s\n", cn_status_text(status), error.message);
    assert_int_equal(status, CN_OK);
    cn_roadmap_clear(&roadmap);
    return path;
}

static double least_clearance(const cn_path *path)
{
    double least = INFINITY;
    for (int i = 0; i < path->n; i++)
        least = fmin(least, path->clearance[i]);
    return least;
}

/* Integral of the squared curvature [1/m]; *largest curvature [1/m]. */
static double bending(const cn_path *path, double *largest)
{
    double energy = 0;
    *largest = 0;
    for (int i = 1; i + 1 < path->n; i++) {
        double u[3], v[3], d[3];
        cn_sub(path->x + 3 * i, path->x + 3 * i - 3, u);
        cn_sub(path->x + 3 * i + 3, path->x + 3 * i, v);
        const double lu = cn_normalise(u), lv = cn_normalise(v);
        cn_sub(v, u, d);
        energy += cn_norm2(d) * 2 / (lu + lv);
        *largest = fmax(*largest, 2 * cn_norm(d) / (lu + lv));
    }
    return energy;
}

static double straight_axis[6] = {0, 0, 0, 0, 0, 0.08}, straight_radius[2] = {0.004, 0.004};

static void a_zigzag_in_a_straight_tube_becomes_a_straight_line(void **state)
{
    plan_case c;
    const double point[6] = {0, 0, 0.01, 0, 0, 0.07};
    const double zigzag[15] = {0, 0, 0.01, 2e-3, 0, 0.025, -2e-3, 1e-3, 0.04, 0, -2e-3, 0.055, 0, 0, 0.07};
    (void)state;
    assert_int_equal(case_tube(&c, 0.7e-3, 2, straight_axis, straight_radius), 0);
    c.spec.cost = CN_COST_BENDING;
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 5, zigzag, NULL);
    assert_true(fabs(cn_path_length(path) - 0.06) < 1e-6);
    assert_true(path->turn_max < 1e-3);
    assert_int_equal(path->nwaypoint, 1);
    assert_int_equal(path->waypoint[0], path->n - 1);
    cn_path_free(path);
    case_free(&c);
}

static void the_path_in_a_bend_keeps_clearance_and_bends_less_than_the_tube(void **state)
{
    plan_case c;
    double axis[3 * BENT], radius[BENT];
    (void)state;
    bent_axis(axis, radius, 4e-3);
    assert_int_equal(case_tube(&c, 0.7e-3, BENT, axis, radius), 0);
    const double point[6] = {0, 0, 2e-3, 0.03, 0, 0.032};
    double polyline[3 * 39];
    memcpy(polyline, axis + 3, sizeof polyline);
    memcpy(polyline, point, 3 * sizeof *point);
    memcpy(polyline + 3 * 38, point + 3, 3 * sizeof *point);
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 39, polyline, NULL);
    assert_true(least_clearance(path) >= c.radius);
    double largest;
    assert_true(bending(path, &largest) < 0.75 * (pi / 2) / 0.012); /* the axis: angle / radius */
    assert_true(largest < 1.2 / 0.012);
    assert_true(path->turn_max <= c.spec.max_turn);
    assert_true(path->turn_max ==
                cn_path_turn(path, fmax(4 * c.radius, 4 * cn_map_cell(c.world->map)), NULL));
    for (int i = 0; i < path->n; i++) /* stored clearance is the exact one */
        assert_true(path->clearance[i] == cn_world_distance(c.world, path->x + 3 * i, NULL, NULL, NULL));
    cn_path_free(path);
    case_free(&c);
}

static void a_narrow_tube_centres_the_path(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.04}, radius[2] = {1e-3, 1e-3};
    const double point[6] = {0, 0, 0.005, 0, 0, 0.035};
    const double off[12] = {0, 0, 0.005, 2.4e-4, 0, 0.015, 2.4e-4, 0, 0.025, 0, 0, 0.035};
    (void)state;
    assert_int_equal(case_tube(&c, 0.7e-3, 2, axis, radius), 0);
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 4, off, NULL);
    for (int i = 0; i < path->n; i++)
        assert_true(hypot(path->x[3 * i], path->x[3 * i + 1]) < 0.05e-3);
    cn_path_free(path);
    case_free(&c);
}

static void waypoints_lie_on_the_path_and_the_start_keeps_its_direction(void **state)
{
    plan_case c;
    const double point[12] = {0, 0, 0.01, 1e-3, 0, 0.03, -1e-3, 1e-3, 0.05, 0, 0, 0.07},
                 direction[3] = {0.1, 0, 0.99498743710662};
    const int leg[4] = {0, 1, 2, 3};
    (void)state;
    assert_int_equal(case_tube(&c, 0.7e-3, 2, straight_axis, straight_radius), 0);
    cn_plan_query query = case_query(&c, 4, point);
    query.direction = direction;
    cn_path *path = plan(&query, 4, point, leg);
    assert_int_equal(path->nwaypoint, 3);
    for (int i = 0; i < 3; i++)
        assert_memory_equal(path->x + 3 * path->waypoint[i], point + 3 * (i + 1), 3 * sizeof *point);
    double d[3];
    cn_sub(path->x + 3, path->x, d);
    cn_normalise(d);
    assert_true(cn_dot(d, direction) > 1 - 1e-9);
    cn_path_free(path);
    case_free(&c);
}

static void the_turn_limit_widens_a_corner(void **state)
{
    plan_case c;
    const double point[6] = {0.005, 0.005, 0.005, 0.055, 0.025, 0.005};
    const double corner[9] = {0.005, 0.005, 0.005, 0.055, 0.005, 0.005, 0.055, 0.025, 0.005};
    (void)state;
    case_begin(&c, 0.7e-3);
    c.vessel.shape.kind = CN_SHAPE_BOX;
    memcpy(c.vessel.shape.box.max, (double[3]){0.06, 0.03, 0.01}, 3 * sizeof(double));
    case_rock(&c, (double[3]){-0.001, 0.009, -0.001}, (double[3]){0.045, 0.031, 0.011}); /* an L-shaped way */
    assert_int_equal(case_end(&c, 1), 0);
    c.spec.max_turn = 20 * pi / 180;
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 3, corner, NULL);
    assert_true(path->turn_max <= c.spec.max_turn);
    assert_true(least_clearance(path) >= c.radius);
    cn_path_free(path);
    case_free(&c);
}

static void a_refused_ball_stays_out_of_the_path(void **state)
{
    plan_case c;
    const double point[6] = {0, 0, 0.01, 0, 0, 0.07};
    const double round[9] = {0, 0, 0.01, 2.5e-3, 0, 0.04, 0, 0, 0.07};
    const cn_ball ball = {{0, 0, 0.04}, 1.5e-3};
    (void)state;
    assert_int_equal(case_tube(&c, 0.7e-3, 2, straight_axis, straight_radius), 0);
    cn_plan_query query = case_query(&c, 2, point);
    query.nrefused = 1, query.refused = &ball;
    assert_false(cn_plan_edge_free(&query, point, point + 3, c.radius, 1));
    cn_path *path = plan(&query, 3, round, NULL);
    for (int i = 0; i < path->n; i++)
        assert_true(cn_distance(path->x + 3 * i, ball.centre) >= ball.radius);
    assert_true(least_clearance(path) >= c.radius);
    cn_path_free(path);
    case_free(&c);
}

static void a_deviation_is_the_sinusoid_asked_for(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.2}, radius[2] = {0.02, 0.02};
    const double point[6] = {0, 0, 0.01, 0, 0, 0.19};
    cn_deviation wave[2] = {{3e-3, 0.03, 0.5, {0, 1, 0}}, {1e-3, 0.02, 0, {0, 1, 0}}};
    (void)state;
    assert_int_equal(case_tube(&c, 2e-3, 2, axis, radius), 0);
    c.spec.ndeviation = 2, c.spec.deviation = wave;
    c.spec.max_turn = pi; /* it may turn as it likes */
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 2, point, NULL);
    for (int i = 0; i < path->n; i++) {
        const double *x = path->x + 3 * i, s = x[2] - 0.01;
        const double want = 3e-3 * sin(2 * pi * s / 0.03 + 0.5) + 1e-3 * sin(2 * pi * s / 0.02);
        assert_true(fabs(x[1]) < 1e-6);                                    /* in the plane: y is its normal */
        if (s > 0.016 && s < 0.164) assert_true(fabs(x[0] - want) < 1e-5); /* normal x tangent = y x z = x */
    }
    assert_memory_equal(path->x, point, 3 * sizeof *point);
    assert_memory_equal(path->x + 3 * (path->n - 1), point + 3, 3 * sizeof *point);
    cn_path_free(path);
    case_free(&c);
}

static void a_deviation_shrinks_where_room_lacks(void **state)
{
    plan_case c;
    double axis[12] = {0, 0, 0, 0, 0, 0.08, 0, 0, 0.1, 0, 0, 0.2}, radius[4] = {0.02, 0.02, 0.005, 0.005};
    const double point[6] = {0, 0, 0.01, 0, 0, 0.19};
    cn_deviation wave = {8e-3, 0.03, 0, {0, 1, 0}};
    double wide = 0, narrow = 0;
    (void)state;
    assert_int_equal(case_tube(&c, 2e-3, 4, axis, radius), 0);
    c.spec.ndeviation = 1, c.spec.deviation = &wave;
    c.spec.max_turn = pi;
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 2, point, NULL);
    for (int i = 0; i < path->n; i++) {
        const double *x = path->x + 3 * i;
        double *most = x[2] < 0.07 ? &wide : &narrow;
        *most = fmax(*most, fabs(x[0]));
    }
    assert_true(wide > 6e-3);
    assert_true(narrow > 1e-3);
    assert_true(least_clearance(path) >= c.radius);
    cn_path_free(path);
    case_free(&c);
}

/* A wave of amplitude A and length l turns by about A (2 pi / l)^2 times the chord: 82 degrees here. */
static void a_deviation_shrinks_until_it_turns_no_more_than_allowed(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.2}, radius[2] = {0.02, 0.02}, widest = 0;
    const double point[6] = {0, 0, 0.01, 0, 0, 0.19};
    cn_deviation wave = {4e-3, 0.03, 0, {0, 1, 0}};
    (void)state;
    assert_int_equal(case_tube(&c, 2e-3, 2, axis, radius), 0);
    c.spec.ndeviation = 1, c.spec.deviation = &wave;
    c.spec.max_turn = 22.5 * pi / 180;
    const cn_plan_query query = case_query(&c, 2, point);
    cn_path *path = plan(&query, 2, point, NULL);
    assert_true(path->turn_max <= c.spec.max_turn);
    for (int i = 0; i < path->n; i++)
        widest = fmax(widest, fabs(path->x[3 * i]));
    assert_true(widest > 0.5e-3 && widest < 2e-3); /* less than asked for, but it does wave */
    cn_path_free(path);
    case_free(&c);
}

static void a_plane_is_a_region_to_lie_on(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.2}, radius[2] = {0.02, 0.02};
    const double point[6] = {0, 0.008, 0.01, 0, 0.008, 0.19};
    const double sag[9] = {0, 0.008, 0.01, 0, 0, 0.1, 0, 0.008, 0.19};
    (void)state;
    assert_int_equal(case_tube(&c, 2e-3, 2, axis, radius), 0);
    c.spec.region = CN_REGION_PLANE;
    c.spec.plane_point[1] = 0.008;
    c.spec.plane_normal[1] = 2; /* need not be a unit vector */
    const cn_plan_query query = case_query(&c, 2, point);
    double toward[3];
    assert_true(fabs(cn_plan_region(&query, sag + 3, toward) - 0.008) < 1e-12);
    assert_true(toward[1] > 0.999);
    cn_path *path = plan(&query, 3, sag, NULL);
    for (int i = 0; i < path->n; i++)
        assert_true(fabs(path->x[3 * i + 1] - 0.008) < 0.5e-3);
    cn_path_free(path);
    case_free(&c);
}

static void a_band_keeps_its_distance_from_the_surface_named(void **state)
{
    plan_case c;
    double axis[6] = {0, 0, 0, 0, 0, 0.2}, radius[2] = {0.02, 0.02}, least = INFINITY, most = 0;
    const double point[6] = {0.014, 0, 0.01, 0.014, 0, 0.19}; /* 6 mm from the wall */
    const double sag[9] = {0.014, 0, 0.01, 0, 0, 0.1, 0.014, 0, 0.19};
    (void)state;
    assert_int_equal(case_tube(&c, 2e-3, 2, axis, radius), 0);
    c.spec.region = CN_REGION_BAND;
    c.spec.band_surface = (char *)(uintptr_t)case_names[0];
    c.spec.band_min = 5e-3, c.spec.band_max = 7e-3;
    const cn_plan_query query = case_query(&c, 2, point);
    double toward[3];
    assert_true(fabs(cn_plan_region(&query, sag + 3, toward) - 0.013) < 1e-4); /* 20 mm from it, 7 allowed */
    assert_true(cn_plan_region(&query, point, NULL) == 0);
    cn_path *path = plan(&query, 3, sag, NULL);
    for (int i = 0; i < path->n; i++)
        least = fmin(least, path->clearance[i]), most = fmax(most, path->clearance[i]);
    assert_true(least > 4.7e-3 && most < 7.3e-3);
    cn_path_free(path);
    case_free(&c);
}

static void results_do_not_depend_on_the_unit_of_length(void **state)
{
    double length[2];
    (void)state;
    for (int k = 0; k < 2; k++) {
        const double f = k ? 1000 : 1;
        plan_case c;
        double axis[3 * BENT], radius[BENT], point[6] = {0, 0, 2e-3, 0.03, 0, 0.032};
        bent_axis(axis, radius, 4e-3);
        for (int i = 0; i < 3 * BENT; i++)
            axis[i] *= f;
        for (int i = 0; i < BENT; i++)
            radius[i] *= f;
        for (int i = 0; i < 6; i++)
            point[i] *= f;
        assert_int_equal(case_tube(&c, 0.7e-3 * f, BENT, axis, radius), 0);
        double polyline[3 * 39];
        memcpy(polyline, axis + 3, sizeof polyline);
        memcpy(polyline, point, 3 * sizeof *point);
        memcpy(polyline + 3 * 38, point + 3, 3 * sizeof *point);
        const cn_plan_query query = case_query(&c, 2, point);
        cn_path *path = plan(&query, 39, polyline, NULL);
        length[k] = cn_path_length(path) / f;
        cn_path_free(path);
        case_free(&c);
    }
    assert_true(fabs(length[1] - length[0]) < 1e-6 * length[0]);
}

static void the_door_refuses_what_cannot_be_planned(void **state)
{
    plan_case c;
    const double in[6] = {0, 0, 0.01, 0, 0, 0.07}, wall[6] = {0, 0, 0.01, 3.8e-3, 0, 0.07};
    const double outside[6] = {0.01, 0, 0.04, 0, 0, 0.07}, nan[6] = {0, 0, 0.01, NAN, 0, 0.07};
    const cn_ball ball = {{0, 0, 0.07}, 1e-3};
    volatile sig_atomic_t cancel = 1;
    cn_path *path;
    cn_roadmap roadmap;
    (void)state;
    assert_int_equal(case_tube(&c, 0.7e-3, 2, straight_axis, straight_radius), 0);
    struct {
        cn_status want;
        const double *point;
        int npoint;
        double radius;
        const cn_ball *ball;
        cn_planner planner;
    } refused[] = {
        {CN_ERR_NO_PATH, wall, 2, 0.7e-3, NULL, draw}, {CN_ERR_NO_PATH, outside, 2, 0.7e-3, NULL, draw},
        {CN_ERR_NO_PATH, in, 2, 0.7e-3, &ball, draw},  {CN_ERR_ARG, nan, 2, 0.7e-3, NULL, draw},
        {CN_ERR_ARG, in, 1, 0.7e-3, NULL, draw},       {CN_ERR_ARG, in, 2, NAN, NULL, draw},
        {CN_ERR_ARG, in, 2, -1, NULL, draw},           {CN_ERR_NO_PATH, in, 2, 0.7e-3, NULL, refuse},
    };
    nguide = 2, guide = in, guide_leg = NULL;
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        cn_error error = {0};
        cn_plan_query query = case_query(&c, refused[i].npoint, refused[i].point);
        query.radius = refused[i].radius;
        query.nrefused = refused[i].ball != NULL, query.refused = refused[i].ball;
        assert_int_equal(cn_plan_path(&path, &query, refused[i].planner, &roadmap, &error), refused[i].want);
        assert_int_equal(error.status, refused[i].want);
        assert_true(error.message[0] && !path);
        cn_roadmap_clear(&roadmap);
    }
    cn_error error = {0};
    cn_plan_query query = case_query(&c, 2, in);
    query.cancel = &cancel;
    assert_int_equal(cn_plan_path(&path, &query, draw, &roadmap, &error), CN_ERR_CANCELLED);
    cn_roadmap_clear(&roadmap);
    case_free(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_zigzag_in_a_straight_tube_becomes_a_straight_line),
        cmocka_unit_test(the_path_in_a_bend_keeps_clearance_and_bends_less_than_the_tube),
        cmocka_unit_test(a_narrow_tube_centres_the_path),
        cmocka_unit_test(waypoints_lie_on_the_path_and_the_start_keeps_its_direction),
        cmocka_unit_test(the_turn_limit_widens_a_corner),
        cmocka_unit_test(a_refused_ball_stays_out_of_the_path),
        cmocka_unit_test(a_deviation_is_the_sinusoid_asked_for),
        cmocka_unit_test(a_deviation_shrinks_where_room_lacks),
        cmocka_unit_test(a_deviation_shrinks_until_it_turns_no_more_than_allowed),
        cmocka_unit_test(a_plane_is_a_region_to_lie_on),
        cmocka_unit_test(a_band_keeps_its_distance_from_the_surface_named),
        cmocka_unit_test(results_do_not_depend_on_the_unit_of_length),
        cmocka_unit_test(the_door_refuses_what_cannot_be_planned),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
