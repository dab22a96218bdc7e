/* Tests of tree.c and tree_query.c: against brute force, after refits, on exact reference tables, in other
 * units. */
#include <jansson.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include "catnav/vec3.h"
#include "fail_alloc.h"
#include "geometry.h"
#include "read_csv.h"
#include "tree.h"

enum { NTRI = 400, NUNIT = 4 };
static const double unit[NUNIT] = {1, 1e-3, 1e6, 1e-9};

static uint64_t seed;
static double uniform(void) /* (-1, 1), the same in every run */
{
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(int64_t)(seed >> 11 << 11) / 9223372036854775808.0;
}

typedef struct { /* loose triangles of all sizes, some on top of each other or without area */
    int tri[3 * NTRI];
    double vert[9 * NTRI], end[9 * NTRI];
    cn_tree *tree;
} soup;

static void soup_make(soup *s, uint64_t from)
{
    seed = from;
    for (int i = 0; i < NTRI; i++) {
        const double c[3] = {uniform(), uniform(), uniform()}, size = pow(10, 2 * uniform() - 2);
        for (int k = 0; k < 9; k++) {
            s->vert[9 * i + k] = c[k % 3] + size * uniform();
            if (i % 10 == 1) s->vert[9 * i + k] = s->vert[9 * (i - 1) + k];
            if (i % 10 == 2) s->vert[9 * i + k] = s->vert[9 * (i - 1) + k % 3];
            s->end[9 * i + k] = s->vert[9 * i + k] + 0.2 * uniform();
        }
        for (int k = 0; k < 3; k++)
            s->tri[3 * i + k] = 3 * i + k;
    }
    assert_int_equal(cn_tree_new(&s->tree, NTRI, s->tri, s->vert), CN_OK);
}

static void triangle_box(const double *a, const double *b, double margin,
                         double box[2][3]) /* of 3 + 3 points */
{
    for (int k = 0; k < 3; k++) {
        box[0][k] = INFINITY, box[1][k] = -INFINITY;
        for (int i = 0; i < 3; i++) {
            box[0][k] = fmin(box[0][k], fmin(a[3 * i + k], b[3 * i + k]) - margin);
            box[1][k] = fmax(box[1][k], fmax(a[3 * i + k], b[3 * i + k]) + margin);
        }
    }
}

static bool meet(double a[2][3], double b[2][3])
{
    for (int k = 0; k < 3; k++)
        if (a[0][k] > b[1][k] || b[0][k] > a[1][k]) return false;
    return true;
}

/* Counts of what is found; a query is right when every count is 1 where boxes meet and 0 elsewhere. */
static unsigned char seen[NTRI][NTRI];
static bool see(void *user, int ia, int ib)
{
    int *left = user;
    seen[ia][ib]++;
    return --*left != 0;
}

static void box_queries_find_what_brute_force_finds(void **state)
{
    static soup s;
    static int found[NTRI];
    (void)state;
    soup_make(&s, 11);
    for (int q = 0; q < 500; q++) {
        const double r = fabs(uniform()) * 0.5;
        double asked[2][3], box[2][3];
        int want = 0;
        for (int k = 0; k < 3; k++)
            asked[0][k] = uniform(), asked[1][k] = asked[0][k] + (q % 10 ? r : 0);
        const int n = cn_tree_query_box(s.tree, asked[0], asked[1], NTRI, found);
        memset(seen[0], 0, sizeof seen[0]);
        for (int i = 0; i < n; i++)
            seen[0][found[i]]++;
        for (int i = 0; i < NTRI; i++) {
            triangle_box(s.vert + 9 * i, s.vert + 9 * i, 0, box);
            assert_int_equal(seen[0][i], meet(box, asked)), want += seen[0][i];
        }
        assert_int_equal(n, want);
        found[0] = -7; /* a list too short is left alone behind its end, and the full number told */
        assert_int_equal(cn_tree_query_box(s.tree, asked[0], asked[1], 0, found), n);
        assert_int_equal(found[0], -7);
    }
    cn_tree_free(s.tree);
}

static void assert_pairs(const double *va, const double *ea, const double *vb, bool self, double grown,
                         double margin)
{
    double a[2][3], b[2][3];
    for (int i = 0; i < NTRI; i++)
        for (int j = self ? i + 1 : 0; j < NTRI; j++) {
            triangle_box(va + 9 * i, ea + 9 * i, grown, a), triangle_box(vb + 9 * j, vb + 9 * j, margin, b);
            assert_int_equal(seen[i][j], meet(a, b));
        }
    memset(seen, 0, sizeof seen);
}

static void loosened_boxes_hold_while_vertices_stay_near_and_are_made_anew_beyond(void **state)
{
    static soup s, t;
    static double near[9 * NTRI], far[9 * NTRI];
    static unsigned char loose[NTRI][NTRI];
    const double slack = 0.02, margin = 0.05;
    int many = -1;
    (void)state;
    soup_make(&s, 21), soup_make(&t, 22);
    for (int i = 0; i < 9 * NTRI; i++) {
        near[i] = s.end[i] + (i % 2 ? 1 : -1) * 0.99 * slack;
        far[i] = s.end[i] + (i == 100 ? 3 : 0.5) * slack;
    }
    cn_tree_refit_loose(s.tree, s.vert, s.end, margin, slack);
    memset(seen, 0, sizeof seen);
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    memcpy(loose, seen, sizeof loose), memset(seen, 0, sizeof seen);
    cn_tree_refit_loose(s.tree, near, near, margin, slack); /* the same boxes: what they find holds all */
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    assert_memory_equal(loose, seen, sizeof loose);
    for (int i = 0; i < NTRI; i++)
        for (int j = 0; j < NTRI; j++) {
            double a[2][3], b[2][3];
            triangle_box(near + 9 * i, near + 9 * i, margin, a),
                triangle_box(t.vert + 9 * j, t.vert + 9 * j, 0, b);
            assert_true(loose[i][j] || !meet(a, b));
        }
    memset(seen, 0, sizeof seen);
    cn_tree_refit_loose(s.tree, far, far, margin, slack);
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    assert_pairs(far, far, t.vert, false, margin + 1.001 * slack, 0);
    cn_tree_free(s.tree), cn_tree_free(t.tree);
}

static void pair_queries_find_what_brute_force_finds_also_after_refits(void **state)
{
    static soup s, t;
    int many = -1, few = 5;
    (void)state;
    soup_make(&s, 12), soup_make(&t, 13);
    memset(seen, 0, sizeof seen);
    for (int q = 0; q < 3; q++) {
        const double margin = (double[]){0, 0.01, 0.3}[q];
        assert_true(cn_tree_query_pairs(s.tree, t.tree, margin, see, &many));
        assert_pairs(s.vert, s.vert, t.vert, false, 0, margin);
    }
    assert_true(cn_tree_query_self(s.tree, 0, see, &many));
    assert_pairs(s.vert, s.vert, s.vert, true, 0, 0);
    cn_tree_refit(s.tree, s.end);
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    assert_pairs(s.end, s.end, t.vert, false, 0, 0);
    cn_tree_refit_swept(s.tree, s.vert, s.end, 0);
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    assert_pairs(s.vert, s.end, t.vert, false, 0, 0);
    cn_tree_refit_swept(s.tree, s.vert, s.end, 0.125);
    assert_true(cn_tree_query_pairs(s.tree, t.tree, 0, see, &many));
    assert_pairs(s.vert, s.end, t.vert, false, 0.125, 0);
    assert_false(cn_tree_query_pairs(s.tree, t.tree, 0, see, &few)); /* stops when told to */
    assert_int_equal(few, 0);
    cn_tree_free(s.tree), cn_tree_free(t.tree);
}

static void the_nearest_triangle_is_the_one_brute_force_finds(void **state)
{
    static soup s;
    (void)state;
    soup_make(&s, 14);
    for (int q = 0; q < 600; q++) {
        const double *vert = q < 300 ? s.vert : s.end;
        double p[3], at[3], best = INFINITY;
        int itri = -2, want = -1;
        if (q == 300) cn_tree_refit(s.tree, s.end);
        for (int k = 0; k < 3; k++)
            p[k] = 2 * uniform();
        for (int i = 0; i < NTRI; i++) {
            const double *x = vert + 9 * i, d = cn_point_triangle(p, x, x + 3, x + 6, NULL);
            if (d < best) best = d, want = i;
        }
        assert_true(cn_tree_nearest(s.tree, p, INFINITY, &itri, at) == best);
        assert_int_equal(itri, want);
        assert_true(fabs(cn_distance(p, at) - best) < 1e-14);
        assert_true(cn_tree_nearest(s.tree, p, best, &itri, NULL) == best && itri == want);
        assert_true(cn_tree_nearest(s.tree, p, 0.99 * best, &itri, NULL) == 0.99 * best && itri == -1);
        assert_true(cn_tree_nearest(s.tree, p, INFINITY, NULL, NULL) == best);
    }
    cn_tree_free(s.tree);
}

static void a_refitted_tree_answers_like_a_new_one(void **state)
{
    static soup s;
    cn_tree *fresh;
    (void)state;
    soup_make(&s, 15);
    cn_tree_refit(s.tree, s.end);
    assert_int_equal(cn_tree_new(&fresh, NTRI, s.tri, s.end), CN_OK);
    for (int q = 0; q < 500; q++) {
        double a[3], b[3], x[3], y[3];
        int i, j;
        for (int k = 0; k < 3; k++)
            a[k] = 1.5 * uniform(), b[k] = 1.5 * uniform();
        assert_int_equal(cn_tree_crossings(s.tree, a, b), cn_tree_crossings(fresh, a, b));
        assert_true(cn_tree_nearest(s.tree, a, 0.2, &i, x) == cn_tree_nearest(fresh, a, 0.2, &j, y) &&
                    i == j);
    }
    cn_tree_box(s.tree, s.vert, s.vert + 3), cn_tree_box(fresh, s.end, s.end + 3);
    assert_memory_equal(s.vert, s.end, 6 * sizeof(double));
    cn_tree_free(s.tree), cn_tree_free(fresh);
}

static void segments_cross_what_their_ends_lie_on_both_sides_of(void **state)
{
    static soup s;
    (void)state;
    soup_make(&s, 16);
    for (int q = 0; q < 2000; q++) {
        double a[3], b[3];
        int want = 0;
        for (int k = 0; k < 3; k++)
            a[k] = 1.5 * uniform(), b[k] = 1.5 * uniform();
        for (int i = 0; i < NTRI; i++) { /* a triangle without thickness: the segment, met as one */
            const double *x = s.vert + 9 * i,
                         segment[3][3] = {{a[0], a[1], a[2]}, {b[0], b[1], b[2]}, {b[0], b[1], b[2]}};
            want += cn_tri_tri(segment, (const double(*)[3])x) == CN_TRI_CROSS;
        }
        assert_int_equal(cn_tree_crossings(s.tree, a, b), want);
        assert_int_equal(cn_tree_crossings(s.tree, b, a), want);
    }
    cn_tree_free(s.tree);
}

static void an_octahedron_is_left_once_through_corner_edge_or_face(void **state)
{
    const double vert[18] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
    int tri[24], n = 0;
    cn_tree *tree;
    (void)state;
    for (int i = 0; i < 8; i++) {
        const int x = i & 1, y = 2 + (i >> 1 & 1), z = 4 + (i >> 2 & 1), odd = (x ^ y ^ z) & 1;
        tri[n++] = x, tri[n++] = odd ? z : y, tri[n++] = odd ? y : z;
    }
    assert_int_equal(cn_tree_new(&tree, 8, tri, vert), CN_OK);
    for (int i = -2; i <= 2; i++)
        for (int j = -2; j <= 2; j++)
            for (int k = -2; k <= 2; k++) {
                const double out[3] = {2 * i, 2 * j, 2 * k}, o[3] = {0, 0, 0},
                             back[3] = {-2 * i, -2 * j, -2 * k};
                const double p[3] = {0.5 * i, 0.5 * j, 0.5 * k}, norm = fabs(p[0]) + fabs(p[1]) + fabs(p[2]);
                if (!(i || j || k)) continue;
                assert_int_equal(cn_tree_crossings(tree, o, out), 1);
                assert_int_equal(cn_tree_crossings(tree, out, o), 1);
                assert_int_equal(cn_tree_crossings(tree, out, back), 2);
                if (norm != 1) assert_int_equal(cn_tree_inside(tree, NULL, p), norm < 1);
            }
    cn_tree_free(tree);
}

static void parity_sees_every_reference_point_on_its_side_in_every_unit(void **state)
{
    csv table;
    (void)state;
    if (!csv_read(&table, "data/inside_points.csv")) skip();
    for (int u = 0; u < NUNIT; u++) {
        reference_mesh mesh = {0};
        cn_tree *tree = NULL, *caps = NULL;
        char name[256] = "";
        double far[3] = {0};
        for (int row = 0; row < table.nrow; row++) {
            char want[256];
            double p[3];
            snprintf(want, sizeof want, "inside_%s", csv_text(&table, row, "mesh"));
            if (strcmp(name, want)) { /* the last two triangles serve as caps once more */
                cn_tree_free(tree), cn_tree_free(caps), reference_mesh_free(&mesh);
                strcpy(name, want);
                if (!reference_mesh_read(&mesh, name)) fail_msg("%s is missing", name);
                for (int k = 0; k < 3 * mesh.nnode; k++)
                    mesh.node[k] *= unit[u], far[k % 3] = fmax(far[k % 3], 2.1 * fabs(mesh.node[k]));
                assert_int_equal(cn_tree_new(&tree, mesh.ntri - 2, mesh.tri, mesh.node), CN_OK);
                assert_int_equal(cn_tree_new(&caps, 2, mesh.tri + 3 * (mesh.ntri - 2), mesh.node), CN_OK);
            }
            csv_numbers(&table, row, "x", 3, p);
            for (int k = 0; k < 3; k++)
                p[k] *= unit[u];
            const char *answer = csv_text(&table, row, "answer");
            if (!strcmp(answer, "on")) continue;
            if (u && fabs(csv_number(&table, row, "signed_distance")) < 4e-16 * cn_norm(p) / unit[u])
                continue; /* other units round such a point to the other side */
            assert_int_equal(cn_tree_inside(tree, caps, p), !strcmp(answer, "in"));
            const int count = cn_tree_crossings(tree, p, far) + cn_tree_crossings(caps, p, far);
            assert_int_equal(count % 2, !strcmp(answer, "in"));
        }
        cn_tree_free(tree), cn_tree_free(caps), reference_mesh_free(&mesh);
    }
    csv_free(&table);
}

typedef struct {
    const reference_mesh *a, *b;
    unsigned char *seen; /* (ntri of a x ntri of b) */
    int nbox, nmeet;
} meeting;

static bool count_meeting(void *user, int ia, int ib)
{
    meeting *m = user;
    double s[3][3], t[3][3];
    for (int k = 0; k < 3; k++) {
        cn_copy3(m->a->node + 3 * m->a->tri[3 * ia + k], s[k]);
        cn_copy3(m->b->node + 3 * m->b->tri[3 * ib + k], t[k]);
    }
    m->nbox++;
    if (cn_tri_tri((const double(*)[3])s, (const double(*)[3])t) == CN_TRI_APART) return true;
    m->nmeet++, m->seen[ia * m->b->ntri + ib]++;
    return true;
}

static void two_surfaces_meet_in_exactly_the_reference_pairs(void **state)
{
    char path[1024];
    json_t *const root = json_load_file(reference_path(path, "data/mesh_pairs.json"), 0, NULL), *item;
    size_t i, j;
    (void)state;
    if (!root) skip();
    json_array_foreach(json_object_get(root, "cases"), i, item)
    {
        json_t *pair;
        reference_mesh a, b;
        cn_tree *s, *t;
        assert_true(reference_mesh_read(&a, json_string_value(json_object_get(item, "mesh_a"))));
        assert_true(reference_mesh_read(&b, json_string_value(json_object_get(item, "mesh_b"))));
        const json_t *const pairs = json_object_get(item, "intersecting_pairs");
        meeting m = {&a, &b, calloc((size_t)a.ntri * (size_t)b.ntri, 1), 0, 0};
        assert_int_equal(cn_tree_new(&s, a.ntri, a.tri, a.node), CN_OK);
        assert_int_equal(cn_tree_new(&t, b.ntri, b.tri, b.node), CN_OK);
        assert_true(cn_tree_query_pairs(s, t, 0, count_meeting, &m));
        assert_int_equal(m.nbox, json_integer_value(json_object_get(item, "box_overlap_pairs")));
        assert_int_equal(m.nmeet, json_array_size(pairs));
        json_array_foreach(pairs, j, pair)
        {
            const json_int_t ia = json_integer_value(json_array_get(pair, 0));
            assert_int_equal(m.seen[ia * b.ntri + json_integer_value(json_array_get(pair, 1))], 1);
        }
        free(m.seen), cn_tree_free(s), cn_tree_free(t), reference_mesh_free(&a), reference_mesh_free(&b);
    }
    json_decref(root);
}

static void a_row_of_ever_smaller_triangles_does_not_overrun_the_stack(void **state)
{
    enum { N = 3000 }; /* sizes and places halve: every cut by cost takes off a few */
    static double vert[9 * N];
    static int tri[3 * N];
    cn_tree *tree;
    (void)state;
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 9; k++)
            vert[9 * i + k] = ldexp(k % 4 == 0 ? 1.25 : 1, -(i % 1000)), tri[3 * i + k / 3] = 3 * i + k / 3;
    assert_int_equal(cn_tree_new(&tree, N, tri, vert), CN_OK);
    int many = -1, itri;
    memset(seen, 0, sizeof seen);
    assert_int_equal(cn_tree_query_box(tree, (double[]){0, 0, 0}, (double[]){2, 2, 2}, 0, NULL), N);
    assert_true(cn_tree_nearest(tree, (double[]){2, 2, 2}, INFINITY, &itri, NULL) > 0 && itri == 0);
    assert_true(cn_tree_query_pairs(tree, tree, -1, see, &many)); /* nothing overlaps by that much */
    cn_tree_free(tree);
}

static void what_cannot_be_a_tree_is_refused(void **state)
{
    double vert[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, box[6];
    int tri[3] = {0, 1, 2}, itri = 5, many = -1;
    cn_tree *tree;
    (void)state;
    assert_int_equal(cn_tree_new(&tree, -1, tri, vert), CN_ERR_ARG), assert_null(tree);
    assert_int_equal(cn_tree_new(&tree, 1, NULL, vert), CN_ERR_ARG);
    assert_int_equal(cn_tree_new(&tree, 1, tri, NULL), CN_ERR_ARG);
    tri[1] = -1;
    assert_int_equal(cn_tree_new(&tree, 1, tri, vert), CN_ERR_ARG), assert_null(tree);
    tri[1] = 1, vert[4] = NAN;
    assert_int_equal(cn_tree_new(&tree, 1, tri, vert), CN_ERR_NOT_FINITE), assert_null(tree);
    vert[4] = INFINITY;
    assert_int_equal(cn_tree_new(&tree, 1, tri, vert), CN_ERR_NOT_FINITE);
    cn_tree_free(NULL);

    assert_int_equal(cn_tree_new(&tree, 0, NULL, NULL), CN_OK); /* an empty one is fine: it has nothing */
    assert_int_equal(cn_tree_query_box(tree, vert, vert + 6, 0, NULL), 0);
    assert_true(cn_tree_query_pairs(tree, tree, 0, see, &many) && cn_tree_query_self(tree, 0, see, &many));
    assert_true(cn_tree_nearest(tree, vert, 3, &itri, NULL) == 3 && itri == -1);
    assert_false(cn_tree_inside(tree, NULL, vert));
    cn_tree_refit(tree, vert);
    cn_tree_box(tree, box, box + 3);
    assert_true(box[0] > box[3]);
    cn_tree_free(tree);
}

static void every_allocation_that_fails_is_told_and_leaves_nothing_behind(void **state)
{
    const double vert[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const int tri[3] = {0, 1, 2};
    int failed = 0;
    bool fired = true;
    (void)state;
    for (long n = 0; fired; n++) {
        cn_tree *tree;
        fail_alloc_at(n);
        const cn_status status = cn_tree_new(&tree, 1, tri, vert);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_true(status == CN_OK ? tree != NULL : status == CN_ERR_MEMORY && !tree);
        failed += status != CN_OK;
        cn_tree_free(tree);
    }
    assert_int_equal(failed, 8); /* all but the one that only gives memory back */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(box_queries_find_what_brute_force_finds),
        cmocka_unit_test(loosened_boxes_hold_while_vertices_stay_near_and_are_made_anew_beyond),
        cmocka_unit_test(pair_queries_find_what_brute_force_finds_also_after_refits),
        cmocka_unit_test(the_nearest_triangle_is_the_one_brute_force_finds),
        cmocka_unit_test(a_refitted_tree_answers_like_a_new_one),
        cmocka_unit_test(segments_cross_what_their_ends_lie_on_both_sides_of),
        cmocka_unit_test(an_octahedron_is_left_once_through_corner_edge_or_face),
        cmocka_unit_test(parity_sees_every_reference_point_on_its_side_in_every_unit),
        cmocka_unit_test(two_surfaces_meet_in_exactly_the_reference_pairs),
        cmocka_unit_test(a_row_of_ever_smaller_triangles_does_not_overrun_the_stack),
        cmocka_unit_test(what_cannot_be_a_tree_is_refused),
        cmocka_unit_test(every_allocation_that_fails_is_told_and_leaves_nothing_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
