/* test_restitution.c - elastic and inelastic response in strict contact: bounces shorter than a step. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "catnav/vec3.h"
#include "scene_steps.h"

#define STIFF "  model: tet4\n  material: {young: 1.0e+11, poisson: 0.3, density: 1000}\n"
#define FLOOR "obstacles:\n- {name: floor, shape: {plane: {point: [0, 0, 0], normal: [0, 0, 1]}}}\n"

static char ball_file[64];

/* Radius 1: an octahedron's faces cut twice, each with the centre a tetrahedron; heavy nodes point up and
 * down. */
static int write_ball(void **state)
{
    static const double corner[6][3] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
    enum { N = 4 }; /* cuts of an edge */
    double node[8 * (N + 1) * (N + 2) / 2 + 1][3];
    int nnode = 1, ntet = 0, tet[8 * N * N][3];
    char name[80];
    (void)state;
    node[0][0] = node[0][1] = node[0][2] = 0;
    for (int face = 0; face < 8; face++) {
        const int side = face % 4;
        const double *a = corner[face < 4 ? 0 : 5], *b = corner[1 + side], *c = corner[1 + (side + 1) % 4];
        int at[N + 1][N + 1];
        for (int i = 0; i <= N; i++)
            for (int j = 0; i + j <= N; j++) {
                double p[3];
                for (int k = 0; k < 3; k++)
                    p[k] = (N - i - j) * a[k] + i * b[k] + j * c[k];
                cn_normalise(p);
                for (at[i][j] = 1; at[i][j] < nnode; at[i][j]++)
                    if (cn_distance(node[at[i][j]], p) < 1e-9) break;
                if (at[i][j] == nnode) cn_copy3(p, node[nnode++]);
            }
        for (int i = 0; i < N; i++)
            for (int j = 0; i + j < N; j++)
                for (int down = 0; down < (i + j + 1 < N ? 2 : 1); down++, ntet++) {
                    tet[ntet][0] = down ? at[i + 1][j + 1] : at[i][j];
                    tet[ntet][1] = at[i + 1][j], tet[ntet][2] = at[i][j + 1];
                }
    }
    snprintf(ball_file, sizeof ball_file, "/tmp/catnav_ball_%ld.node", (long)getpid());
    FILE *f = fopen(ball_file, "w");
    if (!f) return 1;
    fprintf(f, "%d 3 0 0\n", nnode);
    for (int i = 0; i < nnode; i++)
        fprintf(f, "%d %.17g %.17g %.17g\n", i, node[i][0], node[i][1], node[i][2]);
    fclose(f);
    snprintf(name, sizeof name, "%.*s.ele", (int)strlen(ball_file) - 5, ball_file);
    if (!(f = fopen(name, "w"))) return 1;
    fprintf(f, "%d 4 0\n", ntet);
    for (int e = 0; e < ntet; e++)
        fprintf(f, "%d 0 %d %d %d\n", e, tet[e][0], tet[e][1], tet[e][2]);
    fclose(f);
    return 0;
}

static int remove_ball(void **state)
{
    char name[80];
    (void)state;
    snprintf(name, sizeof name, "%.*s.ele", (int)strlen(ball_file) - 5, ball_file);
    return remove(ball_file) | remove(name);
}

static void ball(char *out, size_t size, const char *name, double radius, double z, double speed)
{
    const size_t n = strlen(out);
    snprintf(out + n, size - n,
             "- name: %s\n  shape: {file: %s, scale: %g, translate: [0, 0, %g]}\n" STIFF
             "  start: {velocity: [0, 0, %g]}\n",
             name, ball_file, radius, z, speed);
}

static void a_ball_leaves_a_floor_at_e_times_the_speed_it_came_with(void **state)
{
    static const double e[] = {0, 0.5, 1};
    (void)state;
    for (int i = 0; i < 3; i++) {
        for (int place = 0; place < 3; place++) { /* where in a step it meets the floor */
            char text[1024] = "step: 0.001\n" FLOOR "bodies:\n";
            scene_steps s;
            ball(text, sizeof text, "ball", 0.05, 0.055 + 0.0003 * place, -1);
            sprintf(text + strlen(text), "contact: {response: elastic, restitution: %g, gap: 1.0e-4}\n",
                    e[i]);
            scene_steps_new(&s, text, 0, NULL);
            const scene_motion before = scene_steps_motion(&s, 0);
            scene_steps_go(&s, 12);
            const scene_motion after = scene_steps_motion(&s, 0);
            /* what stays is pushed out of the barrier, at no more than its gap in a step */
            if (!(fabs(after.velocity[2] - e[i]) < (e[i] > 0 ? 2e-3 : 0.1)))
                fail_msg("e %g: leaves at %g", e[i], after.velocity[2]);
            if (e[i] == 1 && !(fabs(after.kinetic / before.kinetic - 1) < 0.005))
                fail_msg("energy %g", after.kinetic / before.kinetic);
            assert_true(s.figures->gap > 0 && s.figures->findings.outside == 0);
            assert_true(s.figures->residual < 2e-3); /* the solve's, whatever the velocities became */
            scene_steps_free(&s);
        }
    }
}

static void each_bounce_is_e_squared_as_high_as_the_one_before(void **state)
{
    const double e = 0.8;
    char text[1024] = "step: 5.0e-4\ngravity: [0, 0, -9.81]\n" FLOOR "bodies:\n";
    scene_steps s;
    double height = 0.1, peak = 0, z[3] = {0, 0, 0};
    int bounce = 0;
    (void)state;
    ball(text, sizeof text, "ball", 0.05, 0.05 + height, 0);
    sprintf(text + strlen(text), "contact: {response: elastic, restitution: %g, gap: 1.0e-4}\n", e);
    scene_steps_new(&s, text, 0, NULL);
    for (int step = 0; step < 1500 && bounce < 3; step++) {
        scene_steps_go(&s, 1);
        z[0] = z[1], z[1] = z[2], z[2] = scene_steps_motion(&s, 0).centre[2] - 0.05;
        if (!(step > 1 && z[1] > z[0] && z[1] >= z[2])) continue;
        height *= e * e, peak = z[1], bounce++;
        if (!(fabs(peak / height - 1) < 0.04 * bounce))
            fail_msg("bounce %d: %g, not %g", bounce, peak, height);
    }
    assert_int_equal(bounce, 3);
    scene_steps_free(&s);
}

/* A ball on a block's flat face: pole on pole two balls slip off each other. */
static void two_bodies_share_the_impulse_by_their_masses(void **state)
{
    static const double e[] = {0, 0.7, 1};
    (void)state;
    for (int i = 0; i < 3; i++) {
        char text[1024] = "step: 0.001\nbodies:\n";
        scene_steps s;
        strcat(
            text,
            "- name: low\n  shape: {box: {min: [-0.045, -0.045, -0.05], max: [0.045, 0.045, 0.05]}}\n" STIFF
            "  start: {velocity: [0, 0, 0.5]}\n");
        ball(text, sizeof text, "high", 0.03, 0.084, -1);
        sprintf(text + strlen(text),
                "contact: {response: elastic, restitution: %g, gap: 1.0e-4}\n"
                "solver: {tolerance: 1.0e-8, linear_tolerance: 1.0e-12}\n",
                e[i]);
        scene_steps_new(&s, text, 0, NULL);
        const double m0 = scene_steps_motion(&s, 0).mass, m1 = scene_steps_motion(&s, 1).mass;
        const double common = (m0 * 0.5 - m1) / (m0 + m1);
        scene_steps_go(&s, 8);
        const double v0 = scene_steps_motion(&s, 0).velocity[2], v1 = scene_steps_motion(&s, 1).velocity[2];
        /* what stays is pushed out of the barrier, at no more than its gap in a step */
        if (!(fabs(v1 - v0 - 1.5 * e[i]) < (e[i] > 0 ? 5e-3 : 0.1)))
            fail_msg("e %g: part at %g", e[i], v1 - v0);
        if (!(fabs((m0 * v0 + m1 * v1) / (m0 + m1) - common) < 1e-7)) fail_msg("momentum %g %g", v0, v1);
        scene_steps_free(&s);
    }
}

static void a_rod_that_falls_flat_bounces_and_a_wall_that_moves_strikes(void **state)
{
    (void)state;
    for (int k = 0; k < 2; k++) {
        char text[1024];
        scene_steps s;
        snprintf(text, sizeof text,
                 "step: 0.001\nobstacles:\n"
                 "- {name: block, shape: {box: {min: [-0.1, -0.1, -0.05], max: [0.3, 0.3, -0.0003]}}%s}\n"
                 "bodies:\n- name: bar\n  shape: {beam: {size: [0.2, 0.01, 0.01], cells: [10, 1, 1]}, "
                 "translate: [0, 0, %g]}\n"
                 "  model: %s\n  material: {young: 1.0e+9, poisson: 0.3, density: 1000}\n"
                 "  start: {velocity: [0, 0, %g]}\n"
                 "contact: {response: elastic, restitution: %g, gap: 1.0e-4}\n",
                 k ? ", path: {waypoints: [[0.1, 0.1, 0]], speed: 0.09}" : "", k ? 0 : 0.0044,
                 k ? "tet4" : "rod", k ? 0.0 : -1.0, k ? 1.0 : 0.6);
        scene_steps_new(&s, text, 0, NULL);
        scene_steps_go(&s, 9);
        const double v = scene_steps_motion(&s, 0).velocity[2], due = k ? 0.18 : 0.6;
        if (!(fabs(v - due) < 1e-3 * due)) fail_msg("%d: leaves at %g, not %g", k, v, due);
        scene_steps_free(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_leaves_a_floor_at_e_times_the_speed_it_came_with),
        cmocka_unit_test(each_bounce_is_e_squared_as_high_as_the_one_before),
        cmocka_unit_test(two_bodies_share_the_impulse_by_their_masses),
        cmocka_unit_test(a_rod_that_falls_flat_bounces_and_a_wall_that_moves_strikes),
    };
    return cmocka_run_group_tests(tests, write_ball, remove_ball);
}
