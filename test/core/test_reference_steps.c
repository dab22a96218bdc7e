/* Time stepping against the reference folder: golden steps in any order of nodes and elements, with their log
 * of momenta; free fall; modulus and phase of each scheme on one spring, its order, momentum kept. */
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

static const struct {
    cn_integrator integrator;
    const char *name, *golden, *spring; /* here, in golden_steps.json, in integrators.csv */
    double order;
} schemes[] = {
    {CN_INTEGRATOR_EULER, "Euler", "euler", "implicit_euler", 0.95},
    {CN_INTEGRATOR_MIDPOINT, "midpoint", "midpoint", "implicit_midpoint_or_newmark_trapezoid", 1.95},
    {CN_INTEGRATOR_TRBDF2, "TR-BDF2", NULL, "tr_bdf2", 1.95}};
enum { SCHEMES = sizeof schemes / sizeof *schemes };

static double *numbers(int n)
{
    double *a = calloc((size_t)n, sizeof *a);
    assert_non_null(a);
    return a;
}

/* A random order of 0 .. n-1; NULL seed: as they are. */
static int *order_of(int n, unsigned *seed)
{
    int *order = calloc((size_t)n, sizeof *order);
    assert_non_null(order);
    for (int i = 0; i < n; i++)
        order[i] = i;
    for (int i = n - 1; seed && i > 0; i--) {
        const int k = (int)((0.5 + 0.5 * shape_random(seed)) * (i + 1)) % (i + 1), kept = order[i];
        order[i] = order[k], order[k] = kept;
    }
    return order;
}

/* The mesh with node i at place[i], its tetrahedra and their corners in another order. */
static cn_tets *shuffled(const cn_tets *mesh, const int *place, unsigned *seed)
{
    cn_tets *other;
    int *tets = order_of(mesh->ntet, seed);
    assert_int_equal(cn_tets_new(&other, mesh->nnode, mesh->ntet), CN_OK);
    for (int i = 0; i < mesh->nnode; i++)
        cn_copy3(mesh->node + 3 * i, other->node + 3 * place[i]);
    for (int e = 0; e < mesh->ntet; e++) {
        const int *t = mesh->tet + 4 * tets[e], turn = seed ? e % 3 : 0; /* even permutations */
        shape_put(other, e, place[t[0]], place[t[1 + turn]], place[t[1 + (turn + 1) % 3]],
                  place[t[1 + (turn + 2) % 3]]);
    }
    free(tets);
    return other;
}

/* --- golden_steps.json --- */

typedef struct {
    double position, velocity, angular; /* worst differences from the reference, as shares; */
    double momentum, so_far;            /* ... of the run's largest, of the largest up to the step */
} misfit;

/* Runs a golden case; x gets the final positions in the case's own order. */
static misfit golden(const json_t *one, int scheme, unsigned *seed, double *x)
{
    const json_t *want = json_object_get(one, schemes[scheme].golden);
    const int steps = (int)json_number(one, "steps");
    cn_tets *mesh = reference_mesh(json_string_value(json_object_get(one, "mesh"))), *other;
    misfit worst = {0};
    stepper s;
    if (!mesh) fail_msg("no mesh %s", json_string_value(json_object_get(one, "mesh")));
    const int n = mesh->nnode;
    int *place = order_of(n, seed);
    double *v = numbers(3 * n), *list = numbers(n + 1), *final = numbers(3 * n), *speed = numbers(3 * n);
    double *log = numbers(8 * steps), fastest = 0;
    other = shuffled(mesh, place, seed);
    stepper_set(&s,
                (cn_material){.young = json_number(one, "E"),
                              .poisson = json_number(one, "nu"),
                              .density = json_number(one, "density"),
                              .damping = json_number(one, "damping")},
                json_number(one, "dt"));
    s.scene.solver.integrator = schemes[scheme].integrator;
    json_numbers(one, "gravity", s.scene.gravity);
    assert_int_equal(stepper_make(&s, other), CN_OK);
    json_numbers(one, "initial_velocities", v);
    for (int i = 0; i < n; i++)
        cn_copy3(v + 3 * i, s.now->v + 3 * place[i]);
    for (int i = 0, m = json_numbers(one, "fixed_nodes", list); i < m; i++)
        s.held[place[(int)list[i]]] = 1;
    json_numbers(want, "momentum_xyz_angular_xyz_kinetic_elastic_per_step", log);
    const stepper_motion start = stepper_moves(&s);
    const double spin = cn_norm(start.angular) + start.mass * s.model->body[0].size * 1e-3;
    for (int i = 0; i < n; i++)
        fastest = fmax(fastest, cn_norm(v + 3 * i));
    for (int k = 0; k < steps; k++) {
        stepper_step(&s);
        const stepper_motion now = stepper_moves(&s);
        for (int i = 0; i < 3; i++) {
            fastest = fmax(fastest, fabs(log[8 * k + i]) / start.mass);
            const double off = fabs(now.linear[i] - log[8 * k + i]);
            worst.momentum = fmax(worst.momentum, off);
            worst.so_far = fmax(worst.so_far, off / (start.mass * fastest));
            worst.angular = fmax(worst.angular, fabs(now.angular[i] - log[8 * k + 3 + i]) / spin);
        }
    }
    worst.momentum /= start.mass * fastest;
    json_numbers(want, "final_positions", final), json_numbers(want, "final_velocities", speed);
    for (int i = 0; i < n; i++) {
        cn_copy3(s.now->x + 3 * place[i], x + 3 * i);
        worst.position = fmax(worst.position, cn_distance(final + 3 * i, x + 3 * i) / s.model->body[0].size);
        worst.velocity = fmax(worst.velocity, cn_distance(speed + 3 * i, s.now->v + 3 * place[i]) / fastest);
    }
    stepper_free(&s);
    cn_tets_free(mesh), cn_tets_free(other);
    free(place), free(v), free(list), free(final), free(speed), free(log);
    return worst;
}

static void golden_steps_come_out_in_any_order_of_nodes_and_elements(void **state)
{
    (void)state;
    json_t *json = reference_json("data/golden_steps.json"), *one;
    if (!json) skip();
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, one)
    {
        const bool hard = json_number(one, "nu") > 0.499 || json_number(one, "E") > 1e11;
        for (int k = 0; k < SCHEMES; k++) {
            double x[3][600], reorder = 0;
            misfit m = {0};
            unsigned seed = 17;
            if (!schemes[k].golden) continue;
            for (int trial = 0; trial < 3; trial++) {
                const misfit one_m = golden(one, k, trial ? &seed : NULL, x[trial]);
                if (one_m.position > m.position) m.so_far = one_m.so_far;
                m.position = fmax(m.position, one_m.position), m.velocity = fmax(m.velocity, one_m.velocity);
                m.momentum = fmax(m.momentum, one_m.momentum), m.angular = fmax(m.angular, one_m.angular);
            }
            const int n = (int)json_array_size(json_object_get(one, "initial_velocities"));
            for (int i = 0; i < 3 * n; i++)
                for (int trial = 1; trial < 3; trial++)
                    reorder = fmax(reorder, fabs(x[trial][i] - x[0][i]));
            print_message("%-14s %-8s position %.1e, velocity %.1e, momentum %.1e, spin %.1e; reorder %.1e\n",
                          json_string_value(json_object_get(one, "name")), schemes[k].name, m.position,
                          m.velocity, m.momentum, m.angular, reorder);
            const bool midpoint = schemes[k].integrator == CN_INTEGRATOR_MIDPOINT;
            assert_true(m.position < (hard ? 1e-7 : 1e-9) && m.velocity < (hard ? 1e-6 : 1e-9));
            assert_true(m.momentum < 1e-12 && m.so_far < 1e-11);
            assert_true(m.angular < (hard ? 1e-6 : midpoint ? 1e-9 : 1e-8));
            assert_true(reorder < 1e-10);
        }
    }
    json_decref(json);
}

/* --- free_fall.json --- */

static void a_body_falls_as_each_scheme_says(void **state)
{
    (void)state;
    json_t *json = reference_json("data/free_fall.json"), *one;
    if (!json) skip();
    cn_tets *mesh = shape_box(1, 1, 1, 0.1);
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, one) for (int k = 0; k < SCHEMES; k++)
    {
        const double dt = json_number(one, "dt"), g = json_number(one, "g");
        const int steps = (int)json_number(one, "steps");
        const bool euler = schemes[k].integrator == CN_INTEGRATOR_EULER;
        const double drop = json_number(one, euler ? "implicit_euler_drop" : "midpoint_drop");
        const double speed = euler ? json_number(one, "implicit_euler_velocity") : -g * dt * steps;
        double strain = 0, lost = 0;
        stepper s;
        cn_measures m;
        stepper_set(&s, (cn_material){.young = 1e6, .poisson = 0.3, .density = 1000}, dt);
        s.scene.gravity[2] = -g, s.scene.solver.integrator = schemes[k].integrator;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        stepper_motion before = stepper_moves(&s);
        for (int i = 0; i < steps; i++) {
            stepper_step(&s);
            const stepper_motion now = stepper_moves(&s);
            const double given = -before.mass * g * dt;
            lost = fmax(lost,
                        fabs(now.linear[2] - before.linear[2] - given) / fmax(fabs(now.linear[2]), -given));
            for (int j = 0; j < 2; j++)
                lost = fmax(lost, fabs(now.linear[j]) / fmax(fabs(now.linear[2]), -given));
            before = now;
        }
        cn_body_measure(s.body, mesh->nnode, s.now->x, s.now->rotation, true, &m, NULL, NULL);
        strain = m.stress_max / 1e6;
        for (int i = 0; i < mesh->nnode; i++) {
            const double fell = mesh->node[3 * i + 2] - s.now->x[3 * i + 2];
            /* beside the reference's share: positions' own round-off */
            assert_true(fabs(fell - drop) <= 1e-10 * drop + 1e-16 * steps * 0.1);
            assert_true(fabs(s.now->v[3 * i + 2] - speed) <= 1e-10 * fabs(speed));
        }
        if (!(strain <= 1e-10 + 1e-15 * drop / 0.1)) fail_msg("strain %g", strain);
        if (!(lost <= 1e-12))
            fail_msg("%s dt %g: momentum off by %g of m v in a step", schemes[k].name, dt, lost);
        stepper_free(&s);
    }
    cn_tets_free(mesh);
    json_decref(json);
}

/* --- integrators.csv: one spring --- */

/* A corner tetrahedron of side 1 with its apex free to move along z: energy V (mu + la/2) z^2, a linear
 * spring at any amplitude; mass rho V/4. The apex starts `z` up with speed `v`. */
static void spring(stepper *s, const cn_tets *mesh, int scheme, double omega_dt, double z, double v)
{
    const cn_material material = {.young = 1000, .poisson = 0, .density = 4};
    stepper_set(s, material, omega_dt / sqrt(material.young / (material.density / 4)));
    s->scene.solver.integrator = schemes[scheme].integrator;
    assert_int_equal(stepper_make(s, mesh), CN_OK);
    s->held[0] = s->held[1] = s->held[2] = 1;
    s->now->x[11] = 1 + z, s->now->v[11] = v;
}

/* One step's amplification matrix in (z, v / omega): its modulus and phase. */
static void amplification(const cn_tets *mesh, int scheme, double omega_dt, double *modulus, double *phase)
{
    double a[4];
    for (int k = 0; k < 2; k++) {
        const double omega = sqrt(1000), size = 1e-3; /* no stage starts from an inverted element */
        stepper s;
        spring(&s, mesh, scheme, omega_dt, k ? 0 : size, k ? size * omega : 0);
        stepper_step(&s);
        a[k] = (s.now->x[11] - 1) / size, a[2 + k] = s.now->v[11] / (omega * size);
        assert_true(fabs(s.now->x[9]) + fabs(s.now->x[10]) < 1e-14);
        stepper_free(&s);
    }
    const double det = a[0] * a[3] - a[1] * a[2], half = 0.5 * (a[0] + a[3]);
    *modulus = sqrt(det), *phase = atan2(sqrt(fmax(0, det - half * half)), half);
}

static void a_spring_swings_as_each_scheme_says(void **state)
{
    (void)state;
    char line[512], method[128];
    FILE *file = reference_open("data/integrators.csv");
    if (!file) skip();
    cn_tets *mesh = shape_tet(1);
    double worst[SCHEMES][2] = {{0}};
    int rows[SCHEMES] = {0};
    assert_non_null(fgets(line, sizeof line, file));
    while (fgets(line, sizeof line, file)) {
        double omega_dt, want[2], got[2];
        assert_int_equal(sscanf(line, "%lf,%127[^,],%lf,%lf", &omega_dt, method, want, want + 1), 4);
        for (int k = 0; k < SCHEMES; k++) {
            if (strcmp(method, schemes[k].spring) != 0) continue;
            amplification(mesh, k, omega_dt, got, got + 1);
            for (int i = 0; i < 2; i++)
                worst[k][i] = fmax(worst[k][i], fabs(got[i] - want[i]));
            rows[k]++;
        }
    }
    for (int k = 0; k < SCHEMES; k++) {
        print_message("spring, %-8s %d rows: modulus off by %.1e, phase by %.1e\n", schemes[k].name, rows[k],
                      worst[k][0], worst[k][1]);
        assert_true(rows[k] > 0 && worst[k][0] <= 1e-10 && worst[k][1] <= 1e-10);
    }
    cn_tets_free(mesh);
    fclose(file);
}

/* Position after one period, in n steps. */
static double after_a_period(const cn_tets *mesh, int scheme, int n)
{
    stepper s;
    spring(&s, mesh, scheme, 2 * acos(-1.0) / n, 0.1, 0);
    for (int i = 0; i < n; i++)
        stepper_step(&s);
    const double error = fabs(s.now->x[11] - 1.1) + fabs(s.now->v[11]) / sqrt(1000);
    stepper_free(&s);
    return error;
}

/* A spinning, swinging body: from differences between dt, dt/2 and dt/4. */
static double observed_order(const cn_tets *mesh, int scheme, double period)
{
    double *x[3], step[2] = {0, 0};
    for (int k = 0; k < 3; k++) {
        const int steps = 320 << k;
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, period / steps);
        s.scene.solver.integrator = schemes[scheme].integrator;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        for (int i = 0; i < mesh->nnode; i++) /* bent and turned as a whole */
            for (int j = 0; j < 3; j++)
                s.now->v[3 * i + j] = 0.3 * s.body->rest[3 * i + (j + 1) % 3] * (j < 2 ? 1 : -2);
        for (int i = 0; i < steps; i++)
            stepper_step(&s);
        x[k] = numbers(3 * mesh->nnode);
        memcpy(x[k], s.now->x, 3 * (size_t)mesh->nnode * sizeof **x);
        stepper_free(&s);
    }
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < mesh->nnode; i++)
            step[k] = fmax(step[k], cn_distance(x[k] + 3 * i, x[k + 1] + 3 * i));
    for (int k = 0; k < 3; k++)
        free(x[k]);
    return log2(step[0] / step[1]);
}

static void each_scheme_has_its_order(void **state)
{
    (void)state;
    cn_tets *mesh = shape_tet(1), *bar = shape_box(3, 1, 1, 0.1);
    for (int k = 0; k < SCHEMES; k++) {
        const double one = log2(after_a_period(mesh, k, 320) / after_a_period(mesh, k, 640));
        const double body = observed_order(bar, k, 0.0125);
        print_message("%-8s observed order %.3f on a spring, %.3f on a body\n", schemes[k].name, one, body);
        assert_true(one >= schemes[k].order && body >= schemes[k].order);
    }
    cn_tets_free(mesh), cn_tets_free(bar);
}

/* --- momentum of a free body (A12) --- */

static void momentum_is_kept_as_each_scheme_keeps_it(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 1, 1, 0.1);
    static const cn_body_model models[] = {CN_BODY_TET4, CN_BODY_TET10, CN_BODY_ROD};
    static const char *const names[] = {"tet4", "tet10", "rod"};
    for (int run = 0; run < 3 * SCHEMES; run++) {
        const int k = run % SCHEMES, kind = run / SCHEMES;
        /* a rod's undamped second-order steps stop converging: by implicit Euler alone */
        if (kind == 2 && schemes[k].integrator != CN_INTEGRATOR_EULER) continue;
        const int steps = 1000;
        double linear = 0, angular = 0;
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e5, .poisson = 0.3, .density = 1000}, 1e-3);
        s.scene.solver.integrator = schemes[k].integrator;
        s.spec.velocity[0] = 1, s.spec.velocity[1] = -2;
        s.spec.spin[0] = 2, s.spec.spin[2] = 5;
        s.spec.model = models[kind];
        s.spec.shape.catheter.length = 0.2, s.spec.shape.catheter.diameter = 0.002;
        s.spec.shape.catheter.stations = 5, s.spec.shape.catheter.sides = 6;
        s.spec.shape.catheter.direction[0] = 1, s.spec.shape.catheter.sheath = CN_OFF;
        if (kind == 2) s.spec.shape.kind = CN_SHAPE_CATHETER, s.scene.solver.tolerance = 1e-10;
        if (stepper_make(&s, kind == 2 ? NULL : mesh) != CN_OK) fail_msg("%s", s.error.message);
        const stepper_motion start = stepper_moves(&s);
        stepper_motion before = start;
        for (int i = 0; i < steps; i++) {
            double d[3];
            stepper_step(&s);
            const stepper_motion now = stepper_moves(&s);
            cn_sub(now.linear, before.linear, d);
            linear = fmax(linear, cn_norm(d) / cn_norm(start.linear));
            cn_sub(now.angular, start.angular, d);
            angular = fmax(angular, cn_norm(d) / cn_norm(start.angular));
            before = now;
        }
        print_message("%-5s %-8s loses %.1e of its momentum in a step, %.1e of its spin in %d\n", names[kind],
                      schemes[k].name, linear, angular, steps);
        assert_true(linear <= 1e-11);
        if (schemes[k].integrator == CN_INTEGRATOR_MIDPOINT && kind < 2) assert_true(angular <= 1e-9);
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

/* A rigid body about what is nearly a main axis: no torque at the step's end means x1 x (v1 - v0) = 0 with v
 * = (x1 - x0)/dt, so its angle of a step follows 2 sin t1 = sin(t1 + t0), tan t1 = w dt at first, and L = I
 * sin t / dt: about (w dt)^2 of the spin is lost in a step. */
static void implicit_euler_loses_the_spin_that_theory_says(void **state)
{
    (void)state;
    cn_tets *mesh = shape_box(2, 2, 2, 0.05);
    for (double dt = 1e-3; dt < 0.05; dt *= 10) {
        const double spin = 10;
        const int steps = 50;
        double angle = atan(spin * dt), worst = 0;
        stepper s;
        stepper_set(&s, (cn_material){.young = 1e8, .poisson = 0.3, .density = 1000}, dt);
        s.spec.spin[2] = spin;
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        const double start = stepper_moves(&s).angular[2];
        double kept = 1;
        for (int i = 0; i < steps; i++) {
            double before = angle;
            for (int pass = 0; i && pass < 50; pass++)
                angle = asin(0.5 * sin(angle + before));
            stepper_step(&s);
            kept = stepper_moves(&s).angular[2] / start;
            worst = fmax(worst, fabs(kept - sin(angle) / (spin * dt)));
        }
        print_message("Euler, w dt %.2g: %.4f of the spin kept after %d steps, off the theory by %.1e\n",
                      spin * dt, kept, steps, worst);
        assert_true(worst < 0.03 * (1 - kept));
        stepper_free(&s);
    }
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(golden_steps_come_out_in_any_order_of_nodes_and_elements),
        cmocka_unit_test(a_body_falls_as_each_scheme_says),
        cmocka_unit_test(a_spring_swings_as_each_scheme_says),
        cmocka_unit_test(each_scheme_has_its_order),
        cmocka_unit_test(momentum_is_kept_as_each_scheme_keeps_it),
        cmocka_unit_test(implicit_euler_loses_the_spin_that_theory_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
