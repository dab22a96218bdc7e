/* Hard cases of the step: contrasts of stiffness, any step, Poisson's range, slivers, inverted starts,
 * numbers that are none, units, parts, bodies without mass, long runs, turned bodies. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "shapes.h"
#include "stepper.h"

static bool finite(const stepper *s)
{
    for (int i = 0; i < 3 * s->body->nnode; i++)
        if (!isfinite(s->now->x[i]) || !isfinite(s->now->v[i])) return false;
    return true;
}

/* One step of dt, like a run's: in up to 64 parts where it cannot be computed in one. */
static cn_status advance(stepper *s, int *parts_most)
{
    const double dt = s->scene.step;
    cn_status status = CN_OK;
    int parts = 1;
    for (int left = 1; left > 0;) {
        s->scene.step = dt / parts;
        status = stepper_try(s);
        if (status == CN_OK)
            left--;
        else if (parts < 64)
            parts *= 2, left *= 2;
        else
            break;
    }
    if (parts_most && parts > *parts_most) *parts_most = parts;
    s->scene.step = dt;
    return status;
}

static void hold_below(stepper *s, double x)
{
    const int n = s->body->nnode;
    for (int i = 0; i < n; i++)
        s->held[i] = s->body->rest[3 * i] < x;
    for (int i = n; i < s->body->nblock; i++) /* a rod's frames with their nodes */
        s->held[i] = s->held[i - n];
}

/* |b - A x| / |b| of the tangent's linear system where the body is, as a solver leaves it. */
static double solve_at(stepper *s, cn_linear linear)
{
    const int first = 0, n = 3 * s->body->nnode;
    double *b = calloc((size_t)n, sizeof *b), *x = calloc((size_t)n, sizeof *x), residual = NAN;
    unsigned seed = 9;
    cn_matrix *matrix;
    cn_scatter *scatter;
    cn_solver *solver;
    assert_true(b && x);
    assert_int_equal(cn_matrix_new(&matrix, 1, &s->body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&scatter, s->body, matrix, 0), CN_OK);
    assert_int_equal(cn_solver_new(&solver, matrix, linear, NULL, NULL), CN_OK);
    cn_body_add_elastic(s->body, s->body->nnode, s->now->x, s->now->rotation, b, CN_TANGENT_PROJECTED, 1,
                        scatter, NULL);
    assert_int_equal(cn_solver_factor(solver, matrix, s->body->nnode, s->held, NULL), CN_OK);
    for (int i = 0; i < n; i++)
        b[i] = s->held[i / 3] ? 0 : shape_random(&seed);
    assert_int_equal(cn_solver_solve(solver, b, x, 1e-10, 10, NULL, &residual, NULL), CN_OK);
    cn_solver_free(solver), cn_scatter_free(scatter), cn_matrix_free(matrix);
    free(b), free(x);
    print_message("  linear residual %.1e\n", residual);
    return residual;
}

/* A steel half that is held, a half of 20 kPa pulled at its end: after 1,000 steps both have the strain of
 * springs in series. */
static void seven_powers_of_ten_of_stiffness_in_one_body(void **state)
{
    (void)state;
    const double h = 0.05, pull = 0.1, soft = 2e4, hard = 2e11;
    cn_region steel = {.by_box = true, .box = {{-1, -1, -1}, {4 * h, 1, 1}}, .young = hard};
    cn_tets *mesh = shape_box(8, 1, 1, h);
    for (int k = 0; k < 3; k++) {
        const cn_linear linear[] = {CN_LINEAR_AUTO, CN_LINEAR_CHOLESKY, CN_LINEAR_CHAIN};
        double residual = 0;
        int newton = 0;
        stepper s;
        stepper_set(
            &s, (cn_material){.young = soft, .density = 1000, .damping = 20, .nregion = 1, .region = &steel},
            1e-2);
        s.scene.solver.tolerance = 1e-9, s.scene.solver.linear = linear[k];
        s.load = (cn_load){.box = {{7.9 * h, -1, -1}, {1, 1, 1}}, .force = {pull, 0, 0}, .until = INFINITY};
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_below(&s, 0.1 * h);
        for (int i = 0; i < 1000; i++) {
            stepper_step(&s);
            residual = fmax(residual, s.figure.residual);
            newton = s.figure.newton > newton ? s.figure.newton : newton;
            assert_int_equal(s.figure.unconverged, 0);
        }
        assert_true(finite(&s));
        double moved[2] = {0, 0}, at[2] = {4 * h, 8 * h};
        for (int e = 0; e < 2; e++)
            for (int i = 0; i < mesh->nnode; i++)
                if (fabs(mesh->node[3 * i] - at[e]) < 0.1 * h) moved[e] += s.now->x[3 * i] - at[e];
        const double stiff = 4 * h * pull / (hard * h * h), all = stiff + 4 * h * pull / (soft * h * h);
        print_message(
            "contrast 1e7, solver %d: residual at most %.1e, %d iterations; stiff part's strain off by "
            "%.1e, soft part's by %.1e\n",
            k, residual, newton, fabs(moved[0] / 4 / stiff - 1), fabs(moved[1] / 4 / all - 1));
        assert_true(residual <= 1e-4); /* the steel's round-off of positions: E h eps x over the load */
        assert_true(solve_at(&s, linear[k]) <= 1e-8);
        assert_true(fabs(moved[0] / 4 / stiff - 1) < 0.01 && fabs(moved[1] / 4 / all - 1) < 0.01);
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

static void energy_does_not_grow_at_any_step(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(3, 1, 1, 0.1);
    const double steps[] = {1e-6, 1e-4, 1e-2, 0.1, 1}, young[] = {2e4, 2e11};
    double most = -INFINITY;
    int parts = 1;
    for (int d = 0; d < 5; d++)
        for (int y = 0; y < 2; y++) {
            stepper s;
            stepper_set(&s, (cn_material){.young = young[y], .poisson = 0.3, .density = 1000}, steps[d]);
            s.scene.solver.tolerance = 1e-10;
            s.spec.spin[1] = 3;
            assert_int_equal(stepper_make(&s, mesh), CN_OK);
            for (int i = 0; i < mesh->nnode; i++)
                s.now->x[3 * i] *= 1.3;
            stepper_motion m = stepper_moves(&s);
            const double first = m.kinetic + m.elastic;
            for (int i = 0; i < 40; i++) {
                const double before = m.kinetic + m.elastic;
                if (advance(&s, &parts) != CN_OK)
                    fail_msg("dt %g, Young %g: step %d not computed", steps[d], young[y], i);
                m = stepper_moves(&s);
                most = fmax(most, (m.kinetic + m.elastic - before) / first);
                assert_true(m.kinetic + m.elastic <= before + 1e-10 * first);
            }
            assert_true(finite(&s));
            stepper_free(&s);
        }
    print_message(
        "steps of 1e-6 to 1 s: energy grows by at most %.1e of the first in a step, of at most %d parts\n",
        most, parts);
    cn_tets_free(mesh);
}

static void poissons_ratio_is_taken_inside_its_range_alone(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    const double good[] = {-0.999, -0.5, 0, 0.33, 0.49, 0.4999, 0.4999999},
                 bad[] = {-1, 0.5, 0.6, -2, NAN, INFINITY};
    const char *named[] = {"-1", "0.5", "0.6", "-2", "nan", "inf"};
    for (int i = 0; i < 7; i++) {
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = good[i], .density = 1000}, 0.01);
        s.scene.gravity[2] = -9.81, s.scene.solver.tolerance = 1e-6;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_below(&s, 0.01);
        for (int k = 0; k < 20; k++)
            stepper_step(&s);
        assert_true(finite(&s));
        stepper_free(&s);
    }
    for (int i = 0; i < 6; i++) {
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = bad[i], .density = 1000}, 0.01);
        assert_int_equal(stepper_make(&s, mesh), CN_ERR_ARG);
        assert_non_null(strstr(s.error.message, "Poisson"));
        assert_non_null(strstr(s.error.message, named[i]));
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

/* One tetrahedron in a hundred a sliver of dihedral angle 0.1 degree, or ten thousand times as long as thick.
 */
static void slivers_and_needles_run_a_thousand_steps(void **state)
{
    (void)state;
    for (int run = 0; run < 4; run++) {
        const bool kind = run % 2, second = run > 1;
        cn_tets *box = shape_box(4, 2, 2, 0.1), *mesh;
        const int n = box->nnode;
        /* a further tetrahedron on a boundary face of one at the corner, its apex hardly above the face */
        assert_int_equal(cn_tets_new(&mesh, n + 1, box->ntet + 1), CN_OK);
        memcpy(mesh->node, box->node, 3 * (size_t)n * sizeof(double));
        memcpy(mesh->tet, box->tet, 4 * (size_t)box->ntet * sizeof(int));
        cn_surface *boundary;
        assert_int_equal(cn_tets_boundary(&boundary, box), CN_OK);
        const int *t = boundary->tri;
        double e1[3], e2[3], normal[3];
        cn_sub(box->node + 3 * t[1], box->node + 3 * t[0], e1),
            cn_sub(box->node + 3 * t[2], box->node + 3 * t[0], e2);
        cn_cross(e1, e2, normal), cn_normalise(normal);
        const double height = kind ? 0.1 / 2e4 : 0.033 * tan(0.07 * acos(-1.0) / 180);
        for (int k = 0; k < 3; k++)
            mesh->node[3 * n + k] =
                (box->node[3 * t[0] + k] + box->node[3 * t[1] + k] + box->node[3 * t[2] + k]) / 3 +
                height * normal[k];
        shape_put(mesh, box->ntet, t[0], t[1], t[2], n);
        cn_tets_doctor doctor;
        assert_int_equal(cn_tets_measure(mesh, &doctor, NULL), CN_OK);
        assert_true(doctor.slivers >= 1 && doctor.quality_min_tet == box->ntet); /* the worst is reported */
        assert_true(doctor.dihedral_min <= 0.1 && (!kind || doctor.aspect_max >= 1e4));
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, 0.01);
        if (second) s.spec.model = CN_BODY_TET10;
        s.scene.solver.tolerance = 1e-3, s.scene.gravity[2] = -9.81;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_below(&s, 0.01);
        double residual = 0;
        int newton = 0;
        for (int i = 0; i < 1000; i++) {
            stepper_step(&s);
            residual = fmax(residual, s.figure.residual), newton += s.figure.newton;
        }
        print_message(
            "%s%s: dihedral %.3f degrees, aspect %.0f: residual at most %.1e, %.2f iterations a step\n",
            second ? "second-order " : "", kind ? "flat" : "sliver", doctor.dihedral_min, doctor.aspect_max,
            residual, newton / 1000.);
        assert_true(finite(&s) && residual <= 1.01e-3);
        stepper_free(&s);
        cn_surface_free(boundary), cn_tets_free(box), cn_tets_free(mesh);
    }
}

/* A further tetrahedron on a face of a box without volume: its apex at the place of a corner, on an edge, in
 * the face, or one of its nodes twice; with volume it is taken. Turned, flat is what rounding leaves. */
static void tetrahedra_without_volume_are_refused_with_their_number(void **state)
{
    (void)state;
    static const double at[3][3] = {{1, 0, 0}, {0.5, 0.5, 0}, {0.3, 0.3, 0.4}};
    for (int run = 0; run < 5 * 3 * 2; run++) {
        const int kind = run / 6, unit = run / 2 % 3;
        cn_tets *box = shape_box(2, 1, 1, unit == 0 ? 1e-4 : unit == 1 ? 0.1 : 100), *mesh;
        cn_surface *boundary;
        const int n = box->nnode;
        unsigned seed = 3 + (unsigned)run;
        double r[9];
        stepper s;
        shape_rotation(&seed, r);
        for (int i = 0; i < n; i++) {
            const double x[3] = {box->node[3 * i], box->node[3 * i + 1], box->node[3 * i + 2]};
            cn_mat_vec(r, x, box->node + 3 * i);
        }
        assert_int_equal(cn_tets_boundary(&boundary, box), CN_OK);
        const int *t = boundary->tri;
        assert_int_equal(cn_tets_new(&mesh, n + 1, box->ntet + 1), CN_OK);
        memcpy(mesh->node, box->node, 3 * (size_t)n * sizeof *mesh->node);
        memcpy(mesh->tet, box->tet, 4 * (size_t)box->ntet * sizeof *mesh->tet);
        const int added[4] = {t[0], t[1], kind == 3 ? t[1] : t[2], n};
        double *apex = mesh->node + 3 * n, middle[3] = {0, 0, 0};
        for (int a = 0; a < 3; a++)
            cn_axpy(kind < 3 ? at[kind][a] : 0, mesh->node + 3 * t[a], apex);
        for (int i = 0; i < n; i++)
            cn_axpy(1. / n, mesh->node + 3 * i, middle);
        if (kind >= 3) /* clear of the face */
            for (int k = 0; k < 3; k++)
                apex[k] = 2 * mesh->node[3 * t[0] + k] - middle[k];
        memcpy(mesh->tet + 4 * box->ntet, added, sizeof added);
        if (kind == 4) shape_put(mesh, box->ntet, t[0], t[1], t[2], n);
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, 0.01);
        s.spec.model = run % 2 ? CN_BODY_TET10 : CN_BODY_TET4;
        const cn_status status = stepper_make(&s, mesh);
        if (kind == 4) {
            assert_int_equal(status, CN_OK);
        } else {
            char number[32];
            snprintf(number, sizeof number, "tetrahedron %d", box->ntet);
            assert_int_not_equal(status, CN_OK);
            assert_non_null(strstr(s.error.message, number));
        }
        stepper_free(&s);
        cn_surface_free(boundary), cn_tets_free(box), cn_tets_free(mesh);
    }
}

/* The marked starts of scramble.json come back within 5 s at steps of 10 ms. */
static void scrambled_starts_come_back_within_five_seconds(void **state)
{
    (void)state;
    json_t *json = reference_json("data/scramble.json"), *item;
    if (!json) skip();
    size_t c;
    int marked = 0, back = 0, all = 0, parts = 1, missing = 0;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        cn_tets *mesh = reference_mesh(json_string_value(json_object_get(item, "mesh")));
        const bool recovers = json_is_true(json_object_get(item, "recovered_by_reference_method"));
        unsigned seed = 3;
        stepper s;
        cn_measures m = {0};
        assert_non_null(mesh);
        stepper_set(&s,
                    (cn_material){.young = json_number(item, "E"),
                                  .poisson = json_number(item, "nu"),
                                  .density = 1000,
                                  .damping = 3}, /* none: rings on for longer; 10: some stay in a tangle */
                    0.01);
        s.scene.solver.tolerance = 1e-3; /* as a scene has it */
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        json_numbers(item, "start_positions", s.now->x);
        for (int i = 0; i < 3 * mesh->nnode; i++)
            s.now->x[i] += 1e-9 * shape_random(&seed);
        stepper_motion now = stepper_moves(&s);
        const double first = now.elastic;
        bool done = false;
        for (int i = 0; i < 500 && !done; i++) {
            const double before = now.elastic + now.kinetic;
            if (advance(&s, &parts) != CN_OK) break; /* the last good state is kept */
            now = stepper_moves(&s);
            assert_true(finite(&s));
            assert_true(now.elastic + now.kinetic <=
                        before * (1 + 2e-3)); /* a snap-through, and the residual */
            if (now.elastic < 1e-10 * first) {
                cn_body_measure(s.body, mesh->nnode, s.now->x, s.now->rotation, false, &m, NULL, NULL);
                done = m.inverted == 0;
            }
        }
        all++, marked += recovers, back += done;
        if (recovers && !done) {
            print_message("%s, start %s: energy %.1e of the first after %d steps\n",
                          json_string_value(json_object_get(item, "mesh")),
                          json_string_value(json_object_get(item, "start")), now.elastic / first,
                          s.state->step);
            missing++;
        }
        stepper_free(&s);
        cn_tets_free(mesh);
    }
    print_message("scrambled starts: %d of %d come back within 5 s (%d marked), a step in at most %d parts\n",
                  back, all, marked, parts);
    assert_int_equal(missing, 0);
    json_decref(json);
}

/* Every number a step takes, as NaN or infinite: refused or stopped, and the state is as it was. */
static void what_is_no_number_stops_the_step_and_leaves_the_state(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    const double wrong[] = {NAN, INFINITY, -INFINITY};
    for (int run = 0; run < 3 * 5 * 3; run++) {
        const int scheme = run / 15, what = run / 3 % 5, w = run % 3;
        const size_t size = 3 * (size_t)mesh->nnode * sizeof(double);
        stepper s;
        cn_state *kept;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, 0.01);
        s.scene.gravity[2] = -9.81, s.scene.solver.tolerance = 1e-6;
        s.scene.solver.integrator = (cn_integrator)scheme;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_below(&s, 0.01);
        for (int i = 0; i < 3; i++) /* in mid-run */
            stepper_step(&s);
        if (what == 0) s.now->x[3 * 10 + 1] = wrong[w];
        if (what == 1) s.now->v[3 * 10 + 1] = wrong[w];
        if (what == 2) s.force[3 * 10 + 1] = wrong[w];
        if (what == 3) s.model->gravity[0] = wrong[w];
        if (what == 4) s.scene.step = wrong[w];
        assert_int_equal(cn_state_new(&kept, s.model), CN_OK);
        cn_state_copy(kept, s.state);
        const cn_status status = stepper_try(&s);
        if (status == CN_OK) fail_msg("scheme %d: %d %g was taken", scheme, what, wrong[w]);
        assert_memory_equal(kept->body[0].x, s.now->x, size);
        assert_memory_equal(kept->body[0].v, s.now->v, size);
        cn_state_free(kept);
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

/* Lengths times a, masses times b, times times c; linear and second-order tetrahedra, a rod. */
static void units_change_nothing_but_the_scale(void **state)
{
    (void)state;
    const double unit[][3] = {{1, 1, 1},       {1e3, 1, 1},     {1e6, 1, 1},    {1, 1e3, 1},
                              {1e3, 1e3, 1e3}, {1e-3, 1, 1e-3}, {1e6, 1e-3, 10}};
    static const cn_body_model models[] = {CN_BODY_TET4, CN_BODY_TET10, CN_BODY_ROD};
    static const char *const names[] = {"tet4", "tet10", "rod"};
    for (int run = 0; run < 9; run++) {
        const int kind = run / 3, scheme = run % 3;
        double *first = NULL, worst = 0;
        for (size_t u = 0; u < sizeof unit / sizeof *unit; u++) {
            const double a = unit[u][0], b = unit[u][1], c = unit[u][2];
            cn_tets *scaled = shape_box(4, 1, 1, 0.1);
            stepper s;
            for (int i = 0; i < 3 * scaled->nnode; i++)
                scaled->node[i] *= a;
            stepper_set(&s,
                        (cn_material){.young = 1e5 * b / (a * c * c),
                                      .poisson = 0.4,
                                      .density = 1000 * b / (a * a * a),
                                      .damping = 0.3 / c,
                                      .damping_stiffness = 1e-4 * c},
                        0.01 * c);
            s.scene.solver.integrator = (cn_integrator)scheme;
            s.scene.gravity[2] = -9.81 * a / (c * c);
            s.spec.model = models[kind];
            s.spec.shape.catheter.length = s.spec.shape.catheter.inserted = 0.4 * a;
            s.spec.shape.catheter.diameter = 0.1 * a, s.spec.shape.catheter.stations = 11;
            s.spec.shape.catheter.sides = 6, s.spec.shape.catheter.direction[0] = 1;
            s.spec.shape.catheter.sheath = CN_OFF;
            if (kind == 2) s.spec.shape.kind = CN_SHAPE_CATHETER;
            if (stepper_make(&s, kind == 2 ? NULL : scaled) != CN_OK) fail_msg("%s", s.error.message);
            const int n = 3 * s.body->nnode;
            hold_below(&s, 0.01 * a);
            for (int i = 0; i < 30; i++)
                stepper_step(&s);
            if (!first) {
                first = calloc((size_t)n, sizeof *first);
                assert_non_null(first);
                memcpy(first, s.now->x, (size_t)n * sizeof *first);
                double moved = 0;
                for (int i = 2; i < n; i += 3)
                    moved = fmax(moved, fabs(s.now->x[i] - s.body->rest[i]));
                assert_true(moved > 1e-3);
            }
            for (int i = 0; i < n; i++)
                worst = fmax(worst, fabs(s.now->x[i] / a - first[i]) / 0.4);
            stepper_free(&s);
            cn_tets_free(scaled);
        }
        print_message("units, %s, scheme %d: results differ by at most %.1e of the size\n", names[kind],
                      scheme, worst);
        assert_true(worst <= 1e-9);
        free(first);
    }
}

/* Static or not, a free body without mass has no answer to a load, nor one that may turn about a held node.
 */
static void a_free_body_without_mass_is_refused_under_load(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    const cn_linear linear[] = {CN_LINEAR_CHOLESKY, CN_LINEAR_AUTO};
    for (int k = 0; k < 2; k++)
        for (int held = 0; held < 3; held++) {
            stepper s;
            stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3}, 0.01);
            s.scene.solver.linear = linear[k], s.scene.solver.tolerance = 1e-8;
            assert_int_equal(stepper_make(&s, mesh), CN_OK);
            if (held == 1) s.held[0] = 1;
            if (held == 2) hold_below(&s, 0.01);
            for (int i = 0; i < mesh->nnode; i++)
                s.force[3 * i + 2] = 0.1 * (i + 1);
            const cn_status status = stepper_try(&s);
            print_message("massless, %s: %s\n",
                          held == 2 ? "clamped"
                          : held    ? "held at a node"
                                    : "free",
                          cn_status_text(status));
            assert_int_equal(status, held == 2 ? CN_OK : CN_ERR_SINGULAR);
            assert_true(finite(&s));
            stepper_free(&s);
        }
    cn_tets_free(mesh);
}

/* Of part k, ten a row: multiples of a power of two have no round-off of their own. */
static double place(int k, int axis)
{
    return axis == 1 ? 0.125 * (k % 10) : axis == 2 ? 0.125 * (k / 10) : 0;
}

/* 1, 2 and 100 boxes that do not touch move as one alone. */
static void parts_that_are_apart_move_as_if_alone(void **state)
{
    (void)state;
    cn_tets *one = shape_box(1, 1, 1, 0.1);
    const int copies[] = {1, 2, 100};
    double alone[24], worst = 0;
    for (int c = 0; c < 3; c++) {
        cn_tets *mesh;
        stepper s;
        assert_int_equal(cn_tets_new(&mesh, copies[c] * one->nnode, copies[c] * one->ntet), CN_OK);
        for (int k = 0; k < copies[c]; k++) {
            for (int i = 0; i < 24; i++)
                mesh->node[24 * k + i] = one->node[i] + place(k, i % 3);
            for (int i = 0; i < 4 * one->ntet; i++)
                mesh->tet[4 * k * one->ntet + i] = one->tet[i] + 8 * k;
        }
        stepper_set(&s, (cn_material){.young = 1e4, .poisson = 0.3, .density = 1000}, 0.01);
        s.scene.gravity[2] = -9.81;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        hold_below(&s, 0.01);
        for (int i = 0; i < 20; i++)
            stepper_step(&s);
        if (c == 0) memcpy(alone, s.now->x, sizeof alone);
        for (int i = 0; i < 24 * copies[c]; i++)
            worst = fmax(worst, fabs(s.now->x[i] - alone[i % 24] - place(i / 24, i % 3)) / 0.1);
        stepper_free(&s);
        cn_tets_free(mesh);
    }
    print_message("1, 2 and 100 parts: off by at most %.1e of a part's size\n", worst);
    assert_true(worst <= 1e-12);
    cn_tets_free(one);
}

/* A ringing tetrahedron without loads: its centre stays, its energy does not grow. A million steps by
 * implicit Euler, by the other schemes where CATNAV_LONG is set, else 1e5. */
static void a_free_body_does_not_drift_in_a_long_run(void **state)
{
    (void)state;
    cn_tets *mesh = shape_tet(0.1);
    for (int scheme = 0; scheme < 3; scheme++) {
        const int steps = scheme == CN_INTEGRATOR_EULER || getenv("CATNAV_LONG") ? 1000000 : 100000;
        double most = 0;
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, 1e-4);
        s.scene.solver.tolerance = 1e-8, s.scene.solver.integrator = (cn_integrator)scheme;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        for (int i = 0; i < mesh->nnode; i++)
            s.now->x[3 * i] = (1 + 0.01) * s.now->x[3 * i];
        const stepper_motion first = stepper_moves(&s);
        for (int i = 0; i < steps; i++) {
            stepper_step(&s);
            if (i % 100) continue;
            const stepper_motion now = stepper_moves(&s);
            most = fmax(most, (now.kinetic + now.elastic) / first.elastic);
        }
        const stepper_motion last = stepper_moves(&s);
        const double drift = cn_distance(last.centre, first.centre) / 0.1;
        print_message("scheme %d, %d steps: drift %.1e of the size, energy at most %.6f of the first\n",
                      scheme, steps, drift, most);
        assert_true(drift < 1e-6);
        assert_true(most <= 1 + (scheme == CN_INTEGRATOR_MIDPOINT ? 1e-2 : 1e-8));
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

/* Limits see nothing of a rigid rotation, of linear and of second-order tetrahedra. */
static void a_rotation_by_any_angle_changes_no_measure(void **state)
{
    (void)state;
    cn_tets *linear = shape_box(3, 2, 2, 0.1), *raised;
    assert_int_equal(cn_tets_raise(&raised, linear), CN_OK);
    const double angles[] = {1e-9, 1e-4, 0.1, 1, 1.5707963267948966, 3, 3.141592653589793, 6};
    double worst = 0;
    for (int order = 1; order <= 2; order++)
        for (int turned_start = 0; turned_start < 2; turned_start++) {
            const cn_tets *mesh = order == 2 ? raised : linear;
            const cn_material material = {.young = 1e6, .poisson = 0.45, .density = 1000};
            cn_body *body;
            cn_measures rest, now;
            assert_int_equal(cn_body_new(&body, mesh, &material, NULL, NULL), CN_OK);
            const int n = body->nnode;
            double *bent = calloc(3 * (size_t)n, sizeof *bent), *x = calloc(3 * (size_t)n, sizeof *x);
            double *q = calloc(4 * (size_t)body->nturn, sizeof *q);
            assert_true(bent && x && q);
            for (int i = 0; i < n; i++) { /* bent about y and twisted, by some tenths */
                const double *r = body->rest + 3 * i, a = 2 * r[0];
                bent[3 * i] = (0.5 - r[2]) * sin(a), bent[3 * i + 1] = 1.1 * r[1] + 0.3 * r[0] * r[2];
                bent[3 * i + 2] = 0.5 - (0.5 - r[2]) * cos(a);
            }
            cn_body_rotation_start(body, q);
            cn_body_measure(body, n, bent, q, true, &rest, NULL, NULL);
            for (size_t k = 0; k < sizeof angles / sizeof *angles; k++) {
                double w[3] = {0.6, -0.48, 0.64}, r[9];
                for (int i = 0; i < 3; i++)
                    w[i] *= angles[k];
                cn_rotation(w, r);
                for (int i = 0; i < n; i++)
                    cn_mat_vec(r, bent + 3 * i, x + 3 * i);
                if (turned_start) cn_body_rotation_start(body, q);
                cn_body_measure(body, n, x, q, true, &now, NULL, NULL);
                worst = fmax(worst, fabs(now.stress_max - rest.stress_max) / rest.stress_max);
                worst = fmax(worst, fabs(now.stress_mean - rest.stress_mean) / rest.stress_mean);
                worst = fmax(worst, fabs(now.volume_max - rest.volume_max));
                worst = fmax(worst, fabs(now.volume_mean - rest.volume_mean));
                worst = fmax(worst, fabs(now.energy - rest.energy) / rest.energy);
                worst = fmax(worst, fabs(now.volume - rest.volume) / rest.volume);
            }
            free(bent), free(x), free(q);
            cn_body_free(body);
        }
    print_message("rotations by 1e-9 to 6 rad: stress, volume and energy change by at most %.1e\n", worst);
    assert_true(worst <= 1e-9);
    cn_tets_free(linear), cn_tets_free(raised);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(seven_powers_of_ten_of_stiffness_in_one_body),
        cmocka_unit_test(energy_does_not_grow_at_any_step),
        cmocka_unit_test(poissons_ratio_is_taken_inside_its_range_alone),
        cmocka_unit_test(slivers_and_needles_run_a_thousand_steps),
        cmocka_unit_test(tetrahedra_without_volume_are_refused_with_their_number),
        cmocka_unit_test(scrambled_starts_come_back_within_five_seconds),
        cmocka_unit_test(what_is_no_number_stops_the_step_and_leaves_the_state),
        cmocka_unit_test(units_change_nothing_but_the_scale),
        cmocka_unit_test(a_free_body_without_mass_is_refused_under_load),
        cmocka_unit_test(parts_that_are_apart_move_as_if_alone),
        cmocka_unit_test(a_free_body_does_not_drift_in_a_long_run),
        cmocka_unit_test(a_rotation_by_any_angle_changes_no_measure),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
