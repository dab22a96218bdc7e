/* test_skin_embed.c - skins in tetrahedra, and on the nodes of bodies. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "catnav/vec3.h"
#include "polar.h"
#include "shapes.h"
#include "skin_cases.h"

static const double length = 8; /* of the capsule */

static void an_affine_motion_of_the_nodes_is_the_embedded_skins(void **state)
{
    (void)state;
    const double m[9] = {1.3, 0.2, -0.1, 0.4, 0.7, 0.3, -0.2, 0.1, 1.6}, shift[3] = {1, 2, -3};
    for (int second = 0; second < 2; second++)
        for (int shrink = 0; shrink < 2;
             shrink++) { /* inside; and partly outside of what it is embedded in */
            cn_tets *tets = shape_box(4, 4, 11, 1), *raised = NULL;
            cn_surface *surface = skin_capsule(length, shrink ? 1.9 : 1.3, 24);
            cn_skin *skin;
            cn_skin_state *now;
            for (int i = 0; i < tets->nnode; i++)
                for (int k = 0; k < 3; k++)
                    tets->node[3 * i + k] = (tets->node[3 * i + k] - (k < 2 ? 2 : 1.5)) * (shrink ? 0.8 : 1);
            if (second) assert_int_equal(cn_tets_raise(&raised, tets), CN_OK);
            const cn_tets *mesh = second ? raised : tets;
            assert_int_equal(cn_skin_new_embedded(&skin, surface, mesh, NULL), CN_OK);
            assert_int_equal(skin->nper, second ? 10 : 4);
            assert_true(shrink ? skin->reach > 0.1 : skin->reach == 0);
            double *x = malloc(3 * (size_t)mesh->nnode * sizeof *x), worst = 0;
            for (int i = 0; i < mesh->nnode; i++) {
                cn_mat_vec(m, mesh->node + 3 * i, x + 3 * i);
                cn_axpy(1, shift, x + 3 * i);
            }
            assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
            assert_int_equal(cn_skin_update(skin, x, NULL, now, NULL), CN_OK);
            for (int v = 0; v < surface->nvert; v++) {
                double y[3];
                cn_mat_vec(m, surface->vert + 3 * v, y);
                cn_axpy(1, shift, y);
                worst = fmax(worst, cn_distance(y, now->x + 3 * v));
            }
            assert_true(worst < 1e-13 * length);
            for (int r = 0; r < skin->nvert && !second && !shrink; r++)
                for (int a = 0; a < 4; a++)
                    assert_true(skin->weight[4 * r + a] >= 0);
            free(x);
            cn_skin_state_free(now);
            cn_skin_free(skin);
            cn_surface_free(surface);
            cn_tets_free(raised);
            cn_tets_free(tets);
        }
}

/* Quadratic motions are what second-order shape functions have, inside. */
static void a_quadratic_motion_is_the_skins_in_second_order_tetrahedra(void **state)
{
    (void)state;
    cn_tets *linear = shape_box(2, 2, 2, 1), *tets;
    cn_surface *surface;
    cn_skin *skin;
    cn_skin_state *now;
    const double centre[3] = {1, 1, 1};
    assert_int_equal(cn_tets_raise(&tets, linear), CN_OK);
    assert_int_equal(cn_surface_sphere(&surface, centre, 0.7), CN_OK);
    assert_int_equal(cn_skin_new_embedded(&skin, surface, tets, NULL), CN_OK);
    assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
    for (int i = 0; i < tets->nnode; i++) {
        double *p = tets->node + 3 * i;
        p[0] += 0.3 * p[1] * p[1], p[2] -= 0.1 * p[1] * p[2];
    }
    assert_int_equal(cn_skin_update(skin, tets->node, NULL, now, NULL), CN_OK);
    for (int v = 0; v < surface->nvert; v++) {
        double *p = surface->vert + 3 * v;
        p[0] += 0.3 * p[1] * p[1], p[2] -= 0.1 * p[1] * p[2];
        assert_true(cn_distance(p, now->x + 3 * v) < 1e-14);
    }
    cn_skin_state_free(now);
    cn_skin_free(skin);
    cn_surface_free(surface);
    cn_tets_free(tets);
    cn_tets_free(linear);
}

static void nodes_turn_with_their_elements(void **state)
{
    (void)state;
    const cn_material material = {.young = 1e5, .poisson = 0.3, .density = 1000};
    const double w[3] = {0.7, -1.1, 0.4};
    for (int second = 0; second < 2; second++) {
        cn_tets *linear = shape_box(2, 2, 3, 1), *tets = NULL;
        cn_body *body;
        cn_measures measures;
        double r[9], node[9];
        if (second) assert_int_equal(cn_tets_raise(&tets, linear), CN_OK);
        assert_int_equal(cn_body_new(&body, second ? tets : linear, &material, NULL, NULL), CN_OK);
        double *rotation = malloc(4 * (size_t)body->nturn * sizeof *rotation),
               *turn = malloc(4 * (size_t)body->npoint * sizeof *turn),
               *x = malloc(3 * (size_t)body->npoint * sizeof *x);
        cn_rotation(w, r);
        for (int i = 0; i < body->npoint; i++)
            cn_mat_vec(r, body->rest + 3 * i, x + 3 * i);
        cn_body_rotation_start(body, rotation);
        cn_body_measure(body, body->nnode, x, rotation, false, &measures, NULL, NULL);
        for (int i = 0; i < 4 * body->nturn; i++) /* q and -q are one rotation */
            rotation[i] *= i / 4 % 3 ? 1 : -1;
        cn_skin_rotations(body, x, rotation, turn, NULL);
        for (int i = 0; i < body->npoint; i++) {
            cn_quaternion_matrix(turn + 4 * i, node);
            for (int k = 0; k < 9; k++)
                assert_true(fabs(node[k] - r[k]) < 1e-13);
        }
        free(rotation), free(turn), free(x);
        cn_body_free(body);
        cn_tets_free(tets), cn_tets_free(linear);
    }
}

/* A body of molecules in a skin that is made about them, turned and moved: the skin goes along. */
static void a_skin_about_molecules_turns_with_them(void **state)
{
    (void)state;
    const cn_material material = {.young = 1e5, .poisson = 0.25, .density = 1000};
    const cn_molecules_spec packing = {.radius = 0.1};
    const double low[3] = {0}, high[3] = {1, 0.8, 0.6}, w[3] = {0.7, -1.1, 0.4}, shift[3] = {1, 2, 3};
    cn_surface *box, *about;
    cn_body *body;
    cn_skin *skin;
    cn_skin_state *now;
    double r[9];
    assert_int_equal(cn_surface_box(&box, low, high), CN_OK);
    assert_int_equal(cn_body_new_molecules(&body, box, &packing, 1, &material, NULL), CN_OK);
    double *x = malloc(3 * (size_t)body->nnode * sizeof *x),
           *radius = malloc((size_t)body->nnode * sizeof *x),
           *turn = malloc(4 * (size_t)body->nnode * sizeof *x);
    cn_rotation(w, r);
    for (int i = 0; i < body->nnode; i++) {
        radius[i] = packing.radius;
        cn_mat_vec(r, body->rest + 3 * i, x + 3 * i);
        cn_axpy(1, shift, x + 3 * i);
    }
    assert_int_equal(cn_surface_about_spheres(&about, body->nnode, body->rest, radius, 0, NULL), CN_OK);
    assert_int_equal(cn_skin_new(&skin, about, body->nnode, body->rest, NULL, 4, NULL), CN_OK);
    assert_int_equal(cn_skin_state_new(&now, skin, NULL), CN_OK);
    cn_skin_rotations(body, x, NULL, turn, NULL);
    assert_int_equal(cn_skin_update(skin, x, turn, now, NULL), CN_OK);
    for (int v = 0; v < about->nvert; v++) {
        double at[3];
        cn_mat_vec(r, about->vert + 3 * v, at);
        cn_axpy(1, shift, at);
        assert_true(cn_distance(at, now->x + 3 * v) < 1e-13);
    }
    free(x), free(radius), free(turn);
    cn_skin_state_free(now);
    cn_skin_free(skin);
    cn_surface_free(about), cn_surface_free(box);
    cn_body_free(body);
}

/* Each node takes the most of its elements, each vertex its weighted share. */
static void a_skin_shows_the_stress_of_what_it_hangs_on(void **state)
{
    (void)state;
    const cn_material material = {.young = 1e5, .poisson = 0.3, .density = 1000};
    const double centre[3] = {0.5, 0.5, 1}, zero[3] = {0};
    cn_tets *tets = shape_box(1, 1, 2, 1);
    cn_surface *ball;
    cn_body *body;
    cn_skin *skin[2];
    assert_int_equal(cn_body_new(&body, tets, &material, NULL, NULL), CN_OK);
    assert_int_equal(cn_surface_sphere(&ball, centre, 0.3), CN_OK);
    assert_int_equal(cn_skin_new_embedded(&skin[0], ball, tets, NULL), CN_OK);
    assert_int_equal(cn_skin_new(&skin[1], ball, tets->nnode, tets->node, NULL, 4, NULL), CN_OK);
    double *stress = malloc((size_t)ball->nvert * sizeof *stress), nodes[12], von_mises[12];
    assert_int_equal(body->nnode, 12);
    assert_int_equal(body->ntet, 12);
    for (int k = 0; k < 2; k++) {
        for (int e = 0; e < 12; e++)
            von_mises[e] = 7;
        cn_skin_stress(skin[k], body, von_mises, nodes, stress);
        for (int v = 0; v < ball->nvert; v++)
            assert_true(fabs(stress[v] - 7) < 1e-13);
        von_mises[5] = 9;
        cn_skin_stress(skin[k], body, von_mises, nodes, stress);
        for (int i = 0; i < 12; i++) {
            bool corner = false;
            for (int a = 0; a < 4; a++)
                corner = corner || body->tet[20 + a] == i;
            assert_true(nodes[i] == (corner ? 9 : 7));
        }
        for (int r = 0; r < ball->nvert; r++) {
            double sum = 0;
            for (int j = 0; j < 4; j++)
                sum += skin[k]->weight[4 * r + j] * nodes[skin[k]->anchor[4 * r + j]];
            assert_true(fabs(stress[skin[k]->vertex[r]] - sum) < 1e-14);
        }
        cn_skin_stress(skin[k], body, NULL, nodes, stress);
        assert_memory_equal(stress, zero, sizeof zero);
        cn_skin_free(skin[k]);
    }
    free(stress);
    cn_surface_free(ball);
    cn_body_free(body);
    cn_tets_free(tets);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_affine_motion_of_the_nodes_is_the_embedded_skins),
        cmocka_unit_test(a_quadratic_motion_is_the_skins_in_second_order_tetrahedra),
        cmocka_unit_test(nodes_turn_with_their_elements),
        cmocka_unit_test(a_skin_about_molecules_turns_with_them),
        cmocka_unit_test(a_skin_shows_the_stress_of_what_it_hangs_on),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
