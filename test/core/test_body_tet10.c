#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_face.h"
#include "body_fixture.h"
#include "catnav/vec3.h"
#include "fail_alloc.h"

static const cn_material rubber = {.young = 1e5, .poisson = 0.3, .density = 1000};

static fixture setup(cn_tets *mesh, const cn_material *material)
{
    const fixture s = fixture_of(mesh, material);
    cn_tets_free(mesh);
    return s;
}

/* Cells of 0.1 m; curved: by a third of a cell over the body. */
static cn_tets *box(int n, bool curved)
{
    return shape_raised(shape_box(n, n, n, 0.1), curved ? 0.15 : 0, 0.1 * n);
}

static void a_turned_body_stores_nothing_and_pulls_at_nothing(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(2, curved), &rubber);
        for (unsigned seed = 1; seed < 30; seed++) {
            fixture_shake(&s, seed, 0);
            assert_true(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) < 1e-28 * 1e5);
            assert_true(largest(s.f, 3 * s.body->nnode) <
                        1e5 * 0.1 * 0.3 * 100 * DBL_EPSILON); /* E h |x| eps */
        }
        fixture_free(&s);
    }
}

static void force_is_minus_the_energy_gradient(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(1, curved), &rubber);
        const double h = 1e-7; /* [m] */
        fixture_shake(&s, 3, 0.015);
        fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
        const double scale = largest(s.f, 3 * s.body->nnode);
        for (int i = 0; i < 3 * s.body->nnode; i++) {
            const double xi = s.x[i];
            s.x[i] = xi + h;
            const double up = cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL);
            s.x[i] = xi - h;
            const double down = cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL);
            s.x[i] = xi;
            assert_true(fabs(s.f[i] + (up - down) / (2 * h)) < 1e-7 * scale);
        }
        fixture_free(&s);
    }
}

/* Columns of K against sixth-order differences of the force, for a shake that leaves some points inverted
 * too: there the rotation turns fast, so the step is short. */
static void exact_stiffness_is_minus_the_force_gradient(void **state)
{
    (void)state;
    static const double weight[7] = {-1, 9, -45, 0, 45, -9, 1};
    for (int hard = 0; hard < 2; hard++) {
        fixture s = setup(box(1, hard), &rubber);
        const int n = 3 * s.body->nnode;
        double *slope = numbers(n), *unit = numbers(n), *column = numbers(n);
        const double h = 1e-6; /* [m] */
        double scale = 0, worst = 0;
        fixture_shake(&s, 5, hard ? 0.03 : 0.01);
        fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL);
        scale = largest(s.matrix->value, 9 * s.matrix->nblock);
        for (int i = 0; i < n; i++) {
            const double xi = s.x[i];
            unit[i] = 1;
            cn_matrix_multiply(s.matrix, s.matrix->n, unit, column, NULL);
            unit[i] = 0;
            memset(slope, 0, (size_t)n * sizeof *slope);
            for (int l = 0; l < 7; l++) {
                s.x[i] = xi + (l - 3) * h;
                fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
                for (int k = 0; k < n; k++)
                    slope[k] += weight[l] / (60 * h) * s.f[k];
            }
            s.x[i] = xi;
            for (int k = 0; k < n; k++)
                worst = fmax(worst, fabs(column[k] + slope[k]));
        }
        print_message("tangent%s: off by %.1e of the largest entry\n", hard ? ", some inverted" : "",
                      worst / scale);
        assert_true(worst < 1e-6 * scale);
        free(slope), free(unit), free(column);
        fixture_free(&s);
    }
}

/* With the nodes amid edges half way, each point of integration is in the linear tetrahedron's state. */
static void with_straight_edges_kept_straight_it_is_the_linear_tetrahedron(void **state)
{
    (void)state;
    cn_tets *linear = shape_box(3, 2, 2, 0.1), *raised;
    assert_int_equal(cn_tets_raise(&raised, linear), CN_OK);
    fixture a = setup(linear, &rubber), b = setup(raised, &rubber);
    cn_measures m, n;
    const int nnode = a.body->nnode;
    double *pulled = numbers(3 * nnode);
    assert_true(fabs(a.body->rest_volume / b.body->rest_volume - 1) < 1e-13);
    for (unsigned seed = 1; seed < 20; seed++) {
        fixture_shake(&a, seed, 0.03);
        memcpy(b.x, a.x, 3 * (size_t)nnode * sizeof *a.x);
        for (int i = 0; i < 6 * b.body->ntet; i++) {
            static const int edge[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
            const int *c = b.body->tet + 4 * (i / 6), *e = edge[i % 6];
            for (int k = 0; k < 3; k++)
                b.x[3 * b.body->mid[i] + k] = 0.5 * (a.x[3 * c[e[0]] + k] + a.x[3 * c[e[1]] + k]);
        }
        const double energy = fixture_force(&a, CN_TANGENT_EXACT, NULL, NULL);
        assert_true(fabs(fixture_force(&b, CN_TANGENT_EXACT, NULL, NULL) / energy - 1) < 1e-12);
        memcpy(pulled, b.f, 3 * (size_t)nnode * sizeof *pulled);
        unsigned char *seen = calloc((size_t)b.body->nnode, 1);
        assert_non_null(seen);
        for (int i = 0; i < 6 * b.body->ntet; i++) { /* a node amid an edge pulls half at either end */
            static const int edge[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
            const int *c = b.body->tet + 4 * (i / 6), mid = b.body->mid[i];
            if (seen[mid]++) continue;
            for (int end = 0; end < 2; end++)
                cn_axpy(0.5, b.f + 3 * mid, pulled + 3 * c[edge[i % 6][end]]);
        }
        free(seen);
        for (int i = 0; i < 3 * nnode; i++)
            assert_true(fabs(pulled[i] - a.f[i]) < 1e-12 * largest(a.f, 3 * nnode));
        cn_body_measure(a.body, nnode, a.x, a.rotation, true, &m, NULL, NULL);
        cn_body_measure(b.body, b.body->nnode, b.x, b.rotation, true, &n, NULL, NULL);
        assert_true(fabs(m.volume_max / n.volume_max - 1) < 1e-11 &&
                    fabs(m.stress_max / n.stress_max - 1) < 1e-11);
        assert_true(fabs(m.stress_mean / n.stress_mean - 1) < 1e-11 && fabs(m.volume / n.volume - 1) < 1e-11);
        assert_true(m.inverted == n.inverted && m.stress_element == n.stress_element);
    }
    free(pulled);
    fixture_free(&a);
    fixture_free(&b);
}

static double quadratic_form(fixture *s, const double *v, double *kv)
{
    double sum = 0;
    cn_matrix_multiply(s->matrix, s->matrix->n, v, kv, NULL);
    for (int i = 0; i < 3 * s->body->nnode; i++)
        sum += v[i] * kv[i];
    return sum;
}

/* One element, so that nothing can be hidden by a neighbour: v'Kv over many v, and the translations. */
static void projected_and_warped_stiffness_never_pull_back(void **state)
{
    (void)state;
    for (unsigned seed = 1; seed < 60; seed++)
        for (int tangent = CN_TANGENT_WARPED; tangent <= CN_TANGENT_PROJECTED; tangent++) {
            fixture s = setup(shape_raised(shape_tet(0.1), seed % 2 ? 0.2 : 0, 0.1), &rubber);
            unsigned draw = seed;
            double v[30], kv[30];
            fixture_shake(&s, seed, 0.03 * (seed % 4));
            fixture_force(&s, (cn_tangent)tangent, s.scatter, NULL);
            const double scale = largest(s.matrix->value, 9 * s.matrix->nblock);
            for (int trial = 0; trial < 100 && tangent != CN_TANGENT_EXACT; trial++) {
                for (int i = 0; i < 30; i++)
                    v[i] = shape_random(&draw);
                assert_true(quadratic_form(&s, v, kv) > -1e-12 * scale);
            }
            for (int i = 0; i < 30; i++)
                v[i] = 1 + i % 3;
            quadratic_form(&s, v, kv);
            assert_true(largest(kv, 30) < 1e-12 * scale);
            fixture_free(&s);
        }
}

/* Also symmetric: block ij is the transpose of block ji. */
static void at_rest_all_three_tangents_are_linear_elasticity(void **state)
{
    (void)state;
    fixture s = setup(box(2, true), &rubber);
    const int n = 9 * s.matrix->nblock;
    double *warped = numbers(n);
    fixture_force(&s, CN_TANGENT_WARPED, s.scatter, NULL);
    memcpy(warped, s.matrix->value, (size_t)n * sizeof *warped);
    const double scale = largest(warped, n);
    for (int tangent = CN_TANGENT_EXACT; tangent <= CN_TANGENT_PROJECTED; tangent++) {
        fixture_force(&s, (cn_tangent)tangent, s.scatter, NULL);
        for (int i = 0; i < n; i++)
            assert_true(fabs(warped[i] - s.matrix->value[i]) < 1e-13 * scale);
    }
    for (int i = 0; i < s.matrix->n; i++)
        for (int k = s.matrix->row[i]; k < s.matrix->row[i + 1]; k++) {
            const double *to = s.matrix->value + 9 * cn_matrix_find(s.matrix, s.matrix->col[k], i);
            for (int c = 0; c < 9; c++)
                assert_true(fabs(s.matrix->value[9 * k + c] - to[3 * (c % 3) + c / 3]) < 1e-13 * scale);
        }
    free(warped);
    fixture_free(&s);
}

static void a_collapsed_or_reflected_element_has_finite_forces_and_stiffness(void **state)
{
    (void)state;
    const double squash[] = {0, 1e-300, 1e-12, -1e-12, -1, -2, 1};
    fixture s = setup(shape_raised(shape_tet(0.1), 0, 0.1), &rubber);
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            for (int k = 0; k < 7; k++)
                for (int tangent = CN_TANGENT_WARPED; tangent <= CN_TANGENT_PROJECTED; tangent++) {
                    cn_measures m;
                    for (int a = 0; a < 10; a++) {
                        s.x[3 * a] = squash[i] * s.body->rest[3 * a];
                        s.x[3 * a + 1] = squash[j] * s.body->rest[3 * a + 1];
                        s.x[3 * a + 2] = squash[k] * s.body->rest[3 * a + 2];
                    }
                    assert_true(isfinite(fixture_force(&s, (cn_tangent)tangent, s.scatter, NULL)));
                    for (int c = 0; c < 30; c++)
                        assert_true(isfinite(s.f[c]));
                    for (int c = 0; c < 9 * s.matrix->nblock; c++)
                        assert_true(isfinite(s.matrix->value[c]));
                    cn_body_measure(s.body, 10, s.x, s.rotation, true, &m, NULL, NULL);
                    const double volume = squash[i] * squash[j] * squash[k]; /* 1e-24 may round either way */
                    if (fabs(volume) > 1e-10 || volume == 0) assert_int_equal(m.inverted, !(volume > 0));
                }
    fixture_free(&s);
}

/* Lengths times 1000^k: energy scales with volume, force with area, stiffness with length; the rest is the
 * same. */
static void metres_millimetres_and_micrometres_give_the_same(void **state)
{
    (void)state;
    double energy = 0, top = 0, stiff = 0, stress = 0;
    for (int k = 0; k < 3; k++) {
        const double unit = pow(1000, k);
        fixture s = setup(shape_raised(shape_box(2, 2, 2, 1e-3 * unit), 0.1, 2e-3 * unit), &rubber);
        cn_measures m;
        fixture_shake(&s, 8, 1e-4 * unit);
        const double e = fixture_force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL) / (unit * unit * unit);
        const double f = largest(s.f, 3 * s.body->nnode) / (unit * unit);
        const double v = largest(s.matrix->value, 9 * s.matrix->nblock) / unit;
        cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
        if (k > 0) {
            assert_true(fabs(e / energy - 1) < 1e-12 && fabs(f / top - 1) < 1e-12);
            assert_true(fabs(v / stiff - 1) < 1e-12 && fabs(m.stress_max / stress - 1) < 1e-12);
        }
        energy = e, top = f, stiff = v, stress = m.stress_max;
        fixture_free(&s);
    }
}

/* Enough elements for many chunks; energies, forces, blocks, rotations and measures bit for bit. */
static void threads_change_no_bit(void **state)
{
    (void)state;
    fixture a = setup(box(7, true), &rubber), b = setup(box(7, true), &rubber);
    cn_pool *pool;
    cn_measures m, n;
    const size_t ndof = 3 * (size_t)a.body->nnode, ntet = (size_t)a.body->ntet;
    double *stress = numbers(2 * a.body->ntet);
    assert_int_equal(cn_pool_new(&pool, 3), CN_OK);
    assert_true(a.body->element->ncolour > 1 && a.body->element->nchunk > 8);
    for (unsigned seed = 1; seed < 4; seed++) {
        fixture_shake(&a, seed, 0.015);
        fixture_shake(&b, seed, 0.015);
        const double e = fixture_force(&a, CN_TANGENT_EXACT, a.scatter, NULL);
        assert_true(e == fixture_force(&b, CN_TANGENT_EXACT, b.scatter, pool));
        assert_memory_equal(a.f, b.f, ndof * sizeof *a.f);
        assert_memory_equal(a.rotation, b.rotation, 16 * ntet * sizeof *a.rotation);
        assert_memory_equal(a.matrix->value, b.matrix->value, 9 * (size_t)a.matrix->nblock * sizeof *a.x);
        cn_body_measure(a.body, a.body->nnode, a.x, a.rotation, true, &m, stress, NULL);
        cn_body_measure(b.body, b.body->nnode, b.x, b.rotation, true, &n, stress + ntet, pool);
        assert_memory_equal(stress, stress + ntet, ntet * sizeof *stress);
        assert_true(m.stress_max == n.stress_max && m.stress_element == n.stress_element &&
                    m.volume == n.volume);
        assert_true(m.energy == n.energy && m.volume_mean == n.volume_mean && m.inverted == n.inverted);
    }
    cn_pool_free(pool);
    free(stress);
    fixture_free(&a);
    fixture_free(&b);
}

static void instruction_sets_agree_to_rounding(void **state)
{
    (void)state;
    fixture a = setup(box(3, true), &rubber), b = setup(box(3, true), &rubber);
    for (int set = 0; set < 3; set++) {
        b.body->element->kernels = cn_kernels10_pick(set);
        fixture_shake(&a, 4, 0.02);
        fixture_shake(&b, 4, 0.02);
        const double e = fixture_force(&a, CN_TANGENT_PROJECTED, a.scatter, NULL);
        assert_true(fabs(fixture_force(&b, CN_TANGENT_PROJECTED, b.scatter, NULL) - e) < 1e-13 * e);
        const double scale = largest(a.matrix->value, 9 * a.matrix->nblock);
        for (int i = 0; i < 9 * a.matrix->nblock; i++)
            assert_true(fabs(a.matrix->value[i] - b.matrix->value[i]) < 1e-11 * scale);
    }
    fixture_free(&a);
    fixture_free(&b);
}

/* Whatever rotations the iteration starts from, half turns and nonsense among them. */
static void the_warm_start_does_not_show(void **state)
{
    (void)state;
    fixture s = setup(box(1, true), &rubber);
    const int n = 3 * s.body->nnode;
    double *want = numbers(n);
    unsigned seed = 12;
    fixture_shake(&s, 6, 0.015);
    const double energy = fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL);
    memcpy(want, s.f, (size_t)n * sizeof *want);
    for (int trial = 0; trial < 50; trial++) {
        for (int i = 0; i < 4 * s.body->nturn; i++)
            s.rotation[i] = trial == 0 ? 0 : trial == 1 ? NAN : shape_random(&seed);
        assert_true(fabs(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) - energy) < 1e-13 * energy);
        for (int i = 0; i < n; i++)
            assert_true(fabs(s.f[i] - want[i]) < 1e-12 * largest(want, n));
    }
    free(want);
    fixture_free(&s);
}

static fixture chain(int stations)
{
    cn_tets *mesh;
    assert_int_equal(cn_tets_catheter10(&mesh, 0.1 * (stations - 1), 0.4, 0, stations, 6, NULL), CN_OK);
    return setup(mesh, &rubber);
}

/* The active part acts as a body of its own: same forces, and the rest is not read or written. */
static void inactive_elements_take_no_part(void **state)
{
    (void)state;
    fixture s = chain(40), part = chain(15);
    const int nactive = part.body->nnode;
    cn_measures m;
    double *stress = numbers(s.body->ntet);
    fixture_shake(&s, 2, 0.01);
    memcpy(part.x, s.x, 3 * (size_t)nactive * sizeof *s.x);
    for (int i = 3 * nactive; i < 3 * s.body->nnode; i++)
        s.x[i] = NAN;
    const double want = fixture_force(&part, CN_TANGENT_EXACT, part.scatter, NULL);
    memset(s.f, 0, 3 * (size_t)s.body->nnode * sizeof *s.f);
    cn_matrix_clear(s.matrix, s.matrix->n);
    const double got =
        cn_body_add_elastic(s.body, nactive, s.x, s.rotation, s.f, CN_TANGENT_EXACT, 1, s.scatter, NULL);
    assert_true(fabs(got - want) < 1e-13 * want);
    assert_true(fabs(cn_body_energy(s.body, nactive, s.x, s.rotation, NULL) - want) < 1e-13 * want);
    for (int i = 0; i < 3 * s.body->nnode; i++)
        assert_true(fabs(s.f[i] - (i < 3 * nactive ? part.f[i] : 0)) < 1e-13 * largest(part.f, 3 * nactive));
    for (int k = 0; k < s.matrix->row[s.matrix->n]; k++)
        if (s.matrix->col[k] >= nactive) assert_true(largest(s.matrix->value + 9 * k, 9) == 0);
    cn_body_measure(s.body, nactive, s.x, s.rotation, true, &m, stress, NULL);
    assert_true(fabs(m.energy - want) < 1e-13 * want);
    assert_true(isfinite(m.volume) && m.volume > 0 && isfinite(m.stress_max));
    assert_true(stress[s.body->ntet - 1] == 0);
    assert_true(cn_body_energy(s.body, 0, s.x, s.rotation, NULL) == 0);
    cn_body_measure(s.body, 0, s.x, s.rotation, true, &m, NULL, NULL);
    assert_true(m.volume_max == 0 && m.stress_max == 0 && m.volume == s.body->rest_volume);
    free(stress);
    fixture_free(&s);
    fixture_free(&part);
}

static void what_is_not_a_number_comes_out_as_such(void **state)
{
    (void)state;
    fixture s = setup(box(1, false), &rubber);
    const double bad[] = {NAN, INFINITY, -INFINITY, 1e300};
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3 * s.body->nnode; i++) {
            cn_measures m;
            const double xi = s.x[i];
            s.x[i] = bad[k];
            assert_false(isfinite(fixture_force(&s, CN_TANGENT_EXACT, s.scatter, NULL)));
            assert_false(isfinite(cn_body_energy(s.body, s.body->nnode, s.x, s.rotation, NULL)));
            cn_body_measure(s.body, s.body->nnode, s.x, s.rotation, true, &m, NULL, NULL);
            assert_false(isfinite(m.energy) && isfinite(m.volume_max) && isfinite(m.stress_max));
            assert_true(k == 3 || m.inverted > 0);
            s.x[i] = xi;
        }
    assert_true(fixture_force(&s, CN_TANGENT_EXACT, NULL, NULL) < 1e-20); /* nothing is kept */
    fixture_free(&s);
}

/* Corners of a straight element have 1/36 of its mass, nodes amid edges 4/27; curved ones all some. */
static void masses_are_positive_and_sum_to_density_times_volume(void **state)
{
    (void)state;
    fixture one = setup(shape_raised(shape_tet(0.1), 0, 0.1), &rubber);
    const double mass = 1000 * 0.1 * 0.1 * 0.1 / 6;
    for (int i = 0; i < 10; i++)
        assert_true(fabs(one.body->mass[i] - (i < 4 ? mass / 36 : mass * 4 / 27)) < 1e-14 * mass);
    fixture_free(&one);
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(3, curved), &rubber);
        double sum = 0;
        for (int i = 0; i < s.body->nnode; i++) {
            assert_true(s.body->mass[i] > 0);
            sum += s.body->mass[i];
        }
        assert_true(fabs(sum / (1000 * s.body->rest_volume) - 1) < 1e-13);
        if (!curved) assert_true(fabs(s.body->rest_volume / 0.027 - 1) < 1e-13);
        fixture_free(&s);
    }
}

/* The four triangles a face: closed, outward, round the volume; for curved faces nearly. */
static void the_boundary_encloses_the_body(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(2, curved), &rubber);
        const cn_surface *skin = s.body->boundary;
        double volume = 0, area = 0;
        int point[CN_FACE_NODES], nface = 0;
        double sum[3] = {0};
        assert_int_equal(skin->ntri, 4 * 6 * 8);
        for (int t = 0; t < skin->ntri; t++) {
            double n[3];
            const double *a = s.body->rest + 3 * skin->tri[3 * t],
                         *b = s.body->rest + 3 * skin->tri[3 * t + 1];
            cn_cross(a, b, n);
            volume += cn_dot(n, s.body->rest + 3 * skin->tri[3 * t + 2]) / 6;
        }
        assert_true(fabs(volume / s.body->rest_volume - 1) < (curved ? 0.02 : 1e-13));
        volume = 0;
        for (; cn_body_face(s.body, nface, point) > 0; nface++)
            for (int k = 0; k < CN_FACE_POINTS; k++) { /* the divergence theorem on the faces themselves */
                double shape[CN_FACE_NODES], place[3], normal[3];
                cn_body_face_at(s.body, nface, k, shape, place, normal);
                volume += cn_dot(place, normal) / 3;
                area += cn_norm(normal);
                cn_add(sum, normal, sum);
            }
        assert_int_equal(nface, 48);
        assert_true(fabs(volume / s.body->rest_volume - 1) < (curved ? 1e-3 : 1e-13));
        assert_true(cn_norm(sum) < 1e-13 * area);
        fixture_free(&s);
    }
}

/* A third of a plane face's area for each node amid an edge, nothing for corners; faces not wholly inside
 * have no load; a curved face's shares sum to its area. */
static void face_shares_are_consistent_loads(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        fixture s = setup(box(2, curved), &rubber);
        const int n = s.body->nnode, ncorner = 27;
        unsigned char *inside = calloc((size_t)n, 1);
        double *share = numbers(n), sum = 0, area = 0, corners = 0;
        assert_non_null(inside);
        for (int i = 0; i < n; i++) /* the face at x = 0, whole, and half a cell of those beside it */
            inside[i] = curved || s.body->rest[3 * i] < 0.06;
        cn_body_face_shares(s.body, inside, share);
        for (int i = 0; i < n; i++)
            sum += share[i], corners += i < ncorner ? fabs(share[i]) : 0;
        if (!curved) {
            assert_true(fabs(sum / 0.04 - 1) < 1e-14 && corners < 1e-17);
            for (int i = ncorner; i < n; i++) /* amid edges: one face or two */
                assert_true(share[i] < 1e-17 || fabs(share[i] - 0.005 / 3) < 1e-16 ||
                            fabs(share[i] - 0.01 / 3) < 1e-16);
        } else {
            for (int face = 0; face < 48; face++)
                for (int k = 0; k < CN_FACE_POINTS; k++) {
                    double shape[CN_FACE_NODES], place[3], normal[3];
                    cn_body_face_at(s.body, face, k, shape, place, normal);
                    area += cn_norm(normal);
                }
            assert_true(fabs(sum / area - 1) < 1e-13);
        }
        free(inside), free(share);
        fixture_free(&s);
    }
}

static void folded_elements_and_nodes_out_of_range_are_refused(void **state)
{
    (void)state;
    cn_error error = {0};
    cn_body *body;
    cn_tets *mesh = box(1, false);
    const int kept = mesh->mid[13];
    mesh->mid[13] = mesh->nnode;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, &error), CN_ERR_MESH);
    assert_non_null(strstr(error.message, "tetrahedron 2"));
    mesh->mid[13] = -1;
    assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, NULL), CN_ERR_MESH);
    mesh->mid[13] = kept;
    /* a node amid an edge is taken up to its quarter point, where the end's Jacobian vanishes */
    const int a = mesh->tet[0], b = mesh->tet[1], mid = mesh->mid[0];
    for (int k = 0; k < 3; k++) {
        const double share[3] = {0.24, 0.26, NAN};
        for (int c = 0; c < 3; c++)
            mesh->node[3 * mid + c] =
                mesh->node[3 * a + c] * (1 - share[k]) + mesh->node[3 * b + c] * share[k];
        memset(&error, 0, sizeof error);
        assert_int_equal(cn_body_new(&body, mesh, &rubber, NULL, &error), k == 1 ? CN_OK : CN_ERR_MESH);
        if (k == 0) assert_non_null(strstr(error.message, "folds over at its node"));
        cn_body_free(body);
    }
    cn_tets_free(mesh);
}

static void every_failing_allocation_is_reported(void **state)
{
    (void)state;
    cn_tets *mesh = box(1, false);
    fixture s = fixture_of(mesh, &rubber);
    for (FAIL_EACH_ALLOC) {
        cn_error error = {0};
        cn_body *body;
        const cn_status status = cn_body_new(&body, mesh, &rubber, NULL, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        assert_int_equal(error.status, status);
        assert_true((body != NULL) == (status == CN_OK));
        cn_body_free(body);
    }
    for (FAIL_EACH_ALLOC) {
        cn_scatter *scatter;
        const cn_status status = cn_body_bind(&scatter, s.body, s.matrix, 0);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
        cn_scatter_free(scatter);
    }
    fail_alloc_at(-1);
    fixture_force(&s, CN_TANGENT_PROJECTED, s.scatter, NULL);
    assert_int_equal(fail_alloc_count(), 0); /* assembly allocates nothing */
    fixture_free(&s);
    cn_tets_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_turned_body_stores_nothing_and_pulls_at_nothing),
        cmocka_unit_test(force_is_minus_the_energy_gradient),
        cmocka_unit_test(exact_stiffness_is_minus_the_force_gradient),
        cmocka_unit_test(with_straight_edges_kept_straight_it_is_the_linear_tetrahedron),
        cmocka_unit_test(projected_and_warped_stiffness_never_pull_back),
        cmocka_unit_test(at_rest_all_three_tangents_are_linear_elasticity),
        cmocka_unit_test(a_collapsed_or_reflected_element_has_finite_forces_and_stiffness),
        cmocka_unit_test(metres_millimetres_and_micrometres_give_the_same),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(instruction_sets_agree_to_rounding),
        cmocka_unit_test(the_warm_start_does_not_show),
        cmocka_unit_test(inactive_elements_take_no_part),
        cmocka_unit_test(what_is_not_a_number_comes_out_as_such),
        cmocka_unit_test(masses_are_positive_and_sum_to_density_times_volume),
        cmocka_unit_test(the_boundary_encloses_the_body),
        cmocka_unit_test(face_shares_are_consistent_loads),
        cmocka_unit_test(folded_elements_and_nodes_out_of_range_are_refused),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
