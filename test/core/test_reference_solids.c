/* Linear tetrahedra against the reference folder and closed forms, found by the step's static equilibrium
 * (density 0): one block under simple loads, the patch test, what the plain element reaches in bending, the
 * condensed membrane, thick tubes, two materials, own weight. */
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

static double *numbers(int n)
{
    double *a = calloc((size_t)n, sizeof *a);
    assert_non_null(a);
    return a;
}

static double largest(const double *a, int n)
{
    double max = 0;
    for (int i = 0; i < n; i++)
        max = fmax(max, fabs(a[i]));
    return max;
}

static cn_material solid(double young, double poisson)
{
    return (cn_material){.young = young, .poisson = poisson};
}

/* Nodal forces of a traction given by what it is times the outward normal (P, row-major) on the boundary
 * triangles that `on` picks by their centre; NULL: all. */
static void pull(stepper *s, const double p[9], bool (*on)(const double centre[3]))
{
    const cn_surface *b = s->body->boundary;
    for (int t = 0; t < b->ntri; t++) {
        const double *x[3];
        double e1[3], e2[3], area[3], force[3], centre[3] = {0, 0, 0};
        for (int k = 0; k < 3; k++)
            x[k] = s->body->rest + 3 * b->tri[3 * t + k], cn_axpy(1. / 3, x[k], centre);
        if (on && !on(centre)) continue;
        cn_sub(x[1], x[0], e1), cn_sub(x[2], x[0], e2), cn_cross(e1, e2, area);
        cn_mat_vec(p, area, force);
        for (int k = 0; k < 3; k++)
            cn_axpy(1. / 6, force, s->force + 3 * b->tri[3 * t + k]);
    }
}

/* --- one homogeneous block (material_responses.json) --- */

typedef struct {
    double f[9], p[9], rotation;              /* gradient, first Piola stress [Pa], turn [rad] */
    double strain, energy, volume, von_mises; /* volume: V/V0 - 1, NAN: not given */
} response;

static void response_of(const json_t *item, response *r)
{
    const char *kind = json_string_value(json_object_get(item, "kind"));
    *r = (response){
        .f = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .volume = NAN, .energy = json_number(item, "energy_density")};
    if (strstr(kind, "shear")) {
        r->strain = r->f[1] = json_number(item, "shear");
        json_numbers(item, "corotational_first_piola", r->p);
        r->rotation = json_number(item, "rotation_angle");
        return;
    }
    r->strain = json_number(item, "strain");
    r->f[0] += r->strain, r->p[0] = json_number(item, "force_over_rest_area");
    if (strstr(kind, "free sides")) {
        const double lateral = json_number(item, "lateral_strain");
        r->f[4] += lateral, r->f[8] += lateral;
        r->volume = json_number(item, "finite_volume_change");
        assert_true(fabs(json_number(item, "seed_volume_change") - (r->strain + 2 * lateral)) <=
                    1e-10 * fabs(r->strain));
    } else if (strstr(kind, "confined")) {
        r->p[4] = r->p[8] = json_number(item, "lateral_stress");
    } else {
        r->f[4] = r->f[8] = r->f[0], r->p[4] = r->p[8] = r->p[0];
    }
}

/* -(sum of f X') / V is the mean first Piola stress, for any mesh and element. */
static void mean_stress(const cn_body *body, const double *x, double *rotation, double p[9])
{
    double *f = numbers(3 * body->nnode);
    cn_body_add_elastic(body, body->nnode, x, rotation, f, CN_TANGENT_WARPED, 1, NULL, NULL);
    memset(p, 0, 9 * sizeof *p);
    for (int n = 0; n < body->nnode; n++)
        for (int i = 0; i < 9; i++)
            p[i] -= f[3 * n + i / 3] * body->rest[3 * n + i % 3] / body->rest_volume;
    free(f);
}

/* Whether the exact tangent is positive definite over the nodes that are not held. */
static bool is_stable(stepper *s)
{
    const int first = 0;
    cn_matrix *matrix;
    cn_scatter *scatter;
    cn_solver *solver;
    double *f = numbers(3 * s->body->nnode);
    assert_int_equal(cn_matrix_new(&matrix, 1, &s->body, &first), CN_OK);
    assert_int_equal(cn_body_bind(&scatter, s->body, matrix, 0), CN_OK);
    assert_int_equal(cn_solver_new(&solver, matrix, CN_LINEAR_CHOLESKY, NULL, NULL), CN_OK);
    cn_body_add_elastic(s->body, s->body->nnode, s->now->x, s->now->rotation, f, CN_TANGENT_EXACT, 1, scatter,
                        NULL);
    const cn_status status = cn_solver_factor(solver, matrix, s->body->nnode, s->held, NULL);
    cn_solver_free(solver), cn_scatter_free(scatter), cn_matrix_free(matrix);
    free(f);
    return status == CN_OK;
}

static void a_block_responds_as_its_law_says(void **state)
{
    (void)state;
    json_t *json = reference_json("data/material_responses.json"), *item;
    if (!json) skip();
    cn_tets *mesh = shape_box(2, 2, 2, 0.5);
    double direct = 0, solved = 0;
    size_t c, nsolved = 0;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        response r;
        stepper s;
        cn_measures m;
        double p[9];
        response_of(item, &r);
        stepper_set(&s, solid(json_number(item, "E"), json_number(item, "nu")), 1);
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        double *want = numbers(3 * mesh->nnode);
        for (int i = 0; i < mesh->nnode; i++)
            cn_mat_vec(r.f, mesh->node + 3 * i, want + 3 * i);

        /* put there */
        memcpy(s.now->x, want, 3 * (size_t)mesh->nnode * sizeof *want);
        const double scale = largest(r.p, 9), e = fabs(r.strain);
        const double modulus = s.body->lambda[0] + 2 * s.body->mu[0];
        const double share = 1e-10 + 8 * DBL_EPSILON * modulus / scale; /* round-off of positions */
        mean_stress(s.body, s.now->x, s.now->rotation, p);
        for (int i = 0; i < 9; i++) {
            direct = fmax(direct, (fabs(p[i] - r.p[i]) / scale) / share);
            assert_true(fabs(p[i] - r.p[i]) <= share * scale);
        }
        cn_body_measure(s.body, mesh->nnode, s.now->x, s.now->rotation, true, &m, NULL, NULL);
        assert_true(fabs(m.energy / m.volume * (m.volume / s.body->rest_volume) - r.energy) <=
                    2 * share * r.energy);
        if (!isnan(r.volume)) {
            assert_true(fabs(m.volume / s.body->rest_volume - 1 - r.volume) <= share * fabs(r.volume));
            assert_true(fabs(m.stress_max - fabs(r.p[0])) <= share * scale);
        }
        const double *q = s.now->rotation; /* turned about -z */
        assert_true(fabs(2 * atan2(q[3], q[0]) - r.rotation) <= 1e-12 + 1e-10 * fabs(r.rotation));

        /* found by the solver: three faces where they belong, tractions on the others; where that
         * is stable, which strong compression is not */
        for (int i = 0; i < mesh->nnode; i++)
            s.held[i] = mesh->node[3 * i] == 0 || mesh->node[3 * i + 1] == 0 || mesh->node[3 * i + 2] == 0;
        if (is_stable(&s)) {
            cn_body_rotation_start(s.body, s.now->rotation);
            for (int i = 0; i < mesh->nnode; i++)
                if (!s.held[i]) cn_copy3(mesh->node + 3 * i, s.now->x + 3 * i);
            pull(&s, r.p, NULL);
            stepper_step(&s);
            double far = 0;
            for (int i = 0; i < mesh->nnode; i++)
                far = fmax(far, cn_distance(want + 3 * i, s.now->x + 3 * i));
            if (!(far <= 1e-6 * e)) fail_msg("case %zu: off by %g of strain %g", c, far / e, r.strain);
            solved = fmax(solved, far / e), nsolved++;
        }
        free(want);
        stepper_free(&s);
    }
    print_message("block: stress off by at most %.2f of the tolerance where put; %zu of %zu found by the "
                  "solver to %.1e "
                  "of the strain\n",
                  direct, nsolved, c, solved);
    cn_tets_free(mesh);
    json_decref(json);
}

/* --- patch test (patch_test.json) through the step --- */

static void inner_nodes_find_the_affine_field(void **state)
{
    (void)state;
    json_t *json = reference_json("data/patch_test.json"), *item;
    cn_tets *mesh = reference_mesh("patch");
    if (!json || !mesh) {
        json_decref(json), cn_tets_free(mesh);
        skip();
    }
    double *list = numbers(mesh->nnode), *von_mises = numbers(mesh->ntet), position = 0, worst = 0;
    const double size = largest(mesh->node, 3 * mesh->nnode);
    const int nlist = json_numbers(json, "boundary_nodes", list);
    size_t c, nstable = 0;
    unsigned seed = 5;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        const double young = json_number(item, "E"), nu = json_number(item, "nu");
        double f[9], p[9], pf[9], strain = 0;
        stepper s;
        cn_measures m;
        json_numbers(item, "F", f), json_numbers(item, "corotational_first_piola", p);
        for (int i = 0; i < 9; i++)
            strain = fmax(strain, fabs(f[i] - (i % 4 == 0)));
        stepper_set(&s, solid(young, nu), 1);
        assert_int_equal(stepper_make(&s, mesh), CN_OK);
        for (int i = 0; i < nlist; i++)
            s.held[(int)list[i]] = 1;
        for (int i = 0; i < mesh->nnode; i++)
            cn_mat_vec(f, mesh->node + 3 * i, s.now->x + 3 * i);
        const bool stable = is_stable(&s);
        nstable += stable;
        for (int i = 0; i < mesh->nnode; i++) /* small strain: from rest; large: near by */
            for (int k = 0; k < 3 && stable && !s.held[i]; k++)
                s.now->x[3 * i + k] = strain < 0.1 ? mesh->node[3 * i + k]
                                                   : s.now->x[3 * i + k] + 0.01 * size * shape_random(&seed);
        stepper_step(&s);
        for (int i = 0; i < mesh->nnode; i++) {
            double want[3];
            cn_mat_vec(f, mesh->node + 3 * i, want);
            position = fmax(position, cn_distance(want, s.now->x + 3 * i) / size);
        }
        if (!(position <= 1e-10)) fail_msg("case %zu: off by %g of the size", c, position);
        /* P F' / det F is Cauchy's stress: its deviator's size is von Mises only where F is small, so the
         * stress is compared with that of the exact field */
        cn_body_measure(s.body, mesh->nnode, s.now->x, s.now->rotation, true, &m, von_mises, NULL);
        for (int i = 0; i < 9; i++)
            pf[i] = p[i];
        const double tolerance =
            (nu > 0.499 ? 1e-7 : 1e-9) * largest(pf, 9) + 64 * DBL_EPSILON / strain * largest(pf, 9);
        double least = INFINITY;
        for (int e = 0; e < mesh->ntet; e++)
            least = fmin(least, von_mises[e]);
        assert_true(m.stress_max - least <=
                    tolerance); /* the same everywhere; its value: test_body_reference */
        worst = fmax(worst, (m.stress_max - least) / tolerance);
        mean_stress(s.body, s.now->x, s.now->rotation, pf);
        for (int i = 0; i < 9; i++)
            assert_true(fabs(pf[i] - p[i]) <= tolerance);
        assert_true(fabs(m.energy - json_number(item, "corotational_energy")) <=
                    (1e-10 + 64 * DBL_EPSILON / strain) * m.energy);
        stepper_free(&s);
    }
    print_message(
        "patch: positions off by at most %.1e of the size, stress by %.2f of its tolerance; %zu of %zu "
        "stable\n",
        position, worst, nstable, c);
    free(list), free(von_mises);
    cn_tets_free(mesh);
    json_decref(json);
}

/* --- a tetrahedron on a triangle, its apex free, is a membrane (artery_single_tet_layer.json) --- */

static void a_free_apex_leaves_a_membrane(void **state)
{
    (void)state;
    json_t *json = reference_json("data/artery_single_tet_layer.json"), *item;
    if (!json) skip();
    double worst = 0;
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        cn_tets *mesh = shape_tet(1);
        double x[12], want[81], k[144], inverse[9];
        const int first = 0;
        cn_body *body;
        cn_matrix *matrix;
        cn_scatter *scatter;
        const cn_material material = solid(json_number(item, "E"), json_number(item, "nu"));
        json_numbers(item, "X", x), json_numbers(item, "condensed_stiffness_9x9", want);
        memcpy(mesh->node, x, sizeof x);
        shape_put(mesh, 0, 0, 1, 2, 3);
        assert_int_equal(cn_body_new(&body, mesh, &material, NULL, NULL), CN_OK);
        assert_int_equal(cn_matrix_new(&matrix, 1, (const cn_body *const *)&body, &first), CN_OK);
        assert_int_equal(cn_body_bind(&scatter, body, matrix, 0), CN_OK);
        double f[12] = {0}, q[4] = {1, 0, 0, 0};
        cn_body_add_elastic(body, 4, x, q, f, CN_TANGENT_EXACT, 1, scatter, NULL);
        for (int i = 0; i < 12; i++)
            for (int j = 0; j < 12; j++)
                k[12 * i + j] = matrix->value[9 * cn_matrix_find(matrix, i / 3, j / 3) + 3 * (i % 3) + j % 3];
        /* K_bb - K_ba K_aa^-1 K_ab, a the apex */
        const double *d = k + 117;
        const double aa[9] = {d[0], d[1], d[2], d[12], d[13], d[14], d[24], d[25], d[26]}, det = cn_det(aa);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int r = (j + 1) % 3, t = (j + 2) % 3, u = (i + 1) % 3, v = (i + 2) % 3;
                inverse[3 * i + j] = (aa[3 * r + u] * aa[3 * t + v] - aa[3 * r + v] * aa[3 * t + u]) / det;
            }
        const double scale = largest(want, 81);
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) {
                double left = k[12 * i + j];
                for (int p = 0; p < 9; p++)
                    left -= k[12 * i + 9 + p / 3] * inverse[p] * k[12 * (9 + p % 3) + j];
                worst = fmax(worst, fabs(left - want[9 * i + j]) / scale);
            }
        cn_scatter_free(scatter), cn_matrix_free(matrix), cn_body_free(body), cn_tets_free(mesh);
    }
    print_message("free apex: the membrane's stiffness to %.1e\n", worst);
    assert_true(worst <= 1e-8);
    json_decref(json);
}

/* --- thick tubes (thick_cylinder.json) --- */

enum { SIDES = 64, LAYERS = 4, SLICES = 2 };

static cn_tets *tube(double a, double b)
{
    static const int kuhn[6][4] = {{0, 1, 3, 7}, {0, 1, 7, 5}, {0, 5, 7, 4},
                                   {0, 3, 2, 7}, {0, 6, 4, 7}, {0, 2, 6, 7}};
    cn_tets *mesh;
    int e = 0;
    assert_int_equal(cn_tets_new(&mesh, SIDES * (LAYERS + 1) * (SLICES + 1), 6 * SIDES * LAYERS * SLICES),
                     CN_OK);
    for (int i = 0; i < mesh->nnode; i++) {
        const int slice = i / (SIDES * (LAYERS + 1)), layer = i / SIDES % (LAYERS + 1);
        const double r = a + (b - a) * layer / LAYERS, angle = 2 * acos(-1.0) * (i % SIDES) / SIDES;
        mesh->node[3 * i] = r * cos(angle), mesh->node[3 * i + 1] = r * sin(angle);
        mesh->node[3 * i + 2] = slice * (b - a) / LAYERS;
    }
    for (int s = 0; s < SLICES; s++)
        for (int l = 0; l < LAYERS; l++)
            for (int i = 0; i < SIDES; i++) {
                int c[8];
                for (int n = 0; n < 8; n++)
                    c[n] = ((s + (n >> 2)) * (LAYERS + 1) + l + (n >> 1 & 1)) * SIDES + (i + (n & 1)) % SIDES;
                for (int t = 0; t < 6; t++, e++)
                    shape_put(mesh, e, c[kuhn[t][0]], c[kuhn[t][1]], c[kuhn[t][2]], c[kuhn[t][3]]);
            }
    return mesh;
}

static double tube_inner, tube_end;
static bool on_inner(const double x[3])
{
    return hypot(x[0], x[1]) < tube_inner;
}
static bool on_ends(const double x[3])
{
    return x[2] < 1e-9 * tube_end || x[2] > (1 - 1e-9) * tube_end;
}

/* The tube is free; a step so long that inertia is 1e-8 of the stiffness takes out its rigid motions, which
 * balanced loads do not ask for. */
static void a_thick_tube_widens_as_lame_says(void **state)
{
    (void)state;
    json_t *json = reference_json("data/thick_cylinder.json"), *item, *end;
    const char *name;
    if (!json) skip();
    size_t c;
    json_array_foreach(json_object_get(json, "cases"), c, item)
    {
        const double a = json_number(item, "a"), b = json_number(item, "b"), young = json_number(item, "E");
        const double nu = json_number(item, "nu"), p = json_number(item, "p"), small = 1e-4 * young / p;
        cn_tets *mesh = tube(a, b);
        double worst = 0, hoop = 0;
        if (nu > 0.45) { /* plain linear tetrahedra lock: no tolerance is stated for them */
            cn_tets_free(mesh);
            continue;
        }
        json_object_foreach(json_object_get(item, "ends"), name, end)
        {
            const double axial = json_number(end, "axial_stress");
            const double press[9] = {-p * small, 0, 0, 0, -p * small, 0, 0, 0, -p * small};
            const double draw[9] = {0, 0, 0, 0, 0, 0, 0, 0, axial * small};
            double u[9];
            stepper s;
            stepper_set(&s, (cn_material){young, nu, 1000, 0, 0, 0, NULL},
                        1e4 * (b - a) * sqrt(1000 / young));
            s.scene.solver.tolerance = 1e-7;
            assert_int_equal(stepper_make(&s, mesh), CN_OK);
            tube_inner = a * (1 + 1e-9), tube_end = mesh->node[3 * mesh->nnode - 1];
            pull(&s, press, on_inner), pull(&s, draw, on_ends);
            stepper_step(&s);
            assert_int_equal(json_numbers(end, "u", u), 9);
            for (int l = 0; l <= LAYERS; l++) {
                double moved = 0;
                int n = 0;
                for (int i = 0; i < mesh->nnode; i++)
                    if (i / SIDES % (LAYERS + 1) == l)
                        moved += hypot(s.now->x[3 * i], s.now->x[3 * i + 1]) - (a + (b - a) * l / LAYERS),
                            n++;
                worst = fmax(worst, fabs(moved / n / (small * u[8 / LAYERS * l]) - 1));
            }
            /* von Mises stress in the mean over each layer, against Lame's at its middle */
            double *stress = numbers(mesh->ntet);
            cn_measures m;
            cn_body_measure(s.body, mesh->nnode, s.now->x, s.now->rotation, true, &m, stress, NULL);
            for (int l = 0; l < LAYERS; l++) {
                const double r = a + (b - a) * (l + 0.5) / LAYERS, k = p * small * a * a / (b * b - a * a);
                const double sr = k * (1 - b * b / (r * r)), st = k * (1 + b * b / (r * r)),
                             sz = axial * small;
                const double want =
                    sqrt(0.5 * ((sr - st) * (sr - st) + (st - sz) * (st - sz) + (sz - sr) * (sz - sr)));
                double mean = 0;
                int n = 0;
                for (int e = 0; e < mesh->ntet; e++)
                    if (e / (6 * SIDES) % LAYERS == l) mean += stress[e], n++;
                hoop = fmax(hoop, fabs(mean / n / want - 1));
            }
            free(stress);
            stepper_free(&s);
        }
        print_message(
            "tube b/a %.2f nu %g: displacement off by at most %.2f %%, stress of layers by %.2f %%\n", b / a,
            nu, 100 * worst, 100 * hoop);
        assert_true(worst <= 0.03);
        assert_true(hoop <= 0.05);
        cn_tets_free(mesh);
    }
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_block_responds_as_its_law_says),
        cmocka_unit_test(inner_nodes_find_the_affine_field),
        cmocka_unit_test(a_free_apex_leaves_a_membrane),
        cmocka_unit_test(a_thick_tube_widens_as_lame_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
