/* Rigid motions that held nodes leave: named for each part of a body. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "body_modes.h"
#include "fail_alloc.h"
#include "shapes.h"

/* `copies` boxes of two cells a side, apart; 27 nodes each, numbered along z, then y, then x. */
static cn_body *boxes(int copies, double h)
{
    cn_tets *one = shape_box(2, 2, 2, h), *mesh;
    const cn_material m = {.young = 1, .poisson = 0.3};
    cn_body *body;
    assert_int_equal(cn_tets_new(&mesh, copies * one->nnode, copies * one->ntet), CN_OK);
    for (int c = 0; c < copies; c++) {
        for (int i = 0; i < 3 * one->nnode; i++)
            mesh->node[3 * c * one->nnode + i] = one->node[i] + (i % 3 ? 0 : 5 * h * c);
        for (int i = 0; i < 4 * one->ntet; i++)
            mesh->tet[4 * c * one->ntet + i] = one->tet[i] + c * one->nnode;
    }
    assert_int_equal(cn_body_new(&body, mesh, &m, NULL, NULL), CN_OK);
    cn_tets_free(one), cn_tets_free(mesh);
    return body;
}

static void what_stays_free_is_named(void **state)
{
    (void)state;
    const struct {
        int nheld, held[4], turn;
        bool shift;
        const char *said;
    } cases[] = {{0, {0}, 3, true, "it is free to shift along x, y and z and to turn about x, y and z"},
                 {1, {26}, 3, false, "turn about x, y and z through the held point"},
                 {2, {0, 2}, 1, false, "turn about the line of held nodes"},
                 {3, {0, 1, 2}, 1, false, "along [0 0 1]"},
                 {3, {0, 2, 6}, 0, false, ""},
                 {4, {0, 1, 2, 13}, 0, false, ""}};
    const double unit[] = {1, 1e-3, 1e-6};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++)
        for (int k = 0; k < 3; k++) {
            cn_body *body = boxes(1, unit[k]);
            unsigned char fixed[27] = {0};
            cn_body_modes m;
            char text[256];
            for (int i = 0; i < cases[c].nheld; i++)
                fixed[cases[c].held[i]] = 1;
            assert_int_equal(cn_body_modes_find(body, fixed, &m), CN_OK);
            cn_body_modes_text(&m, text, sizeof text);
            const bool loose = cases[c].shift || cases[c].turn;
            assert_int_equal(m.npart, 1);
            assert_int_equal(m.nloose, loose);
            if (loose) {
                assert_int_equal(m.turn, cases[c].turn);
                assert_int_equal(m.shift, cases[c].shift);
                assert_int_equal(m.nnode, 27);
                assert_non_null(strstr(text, cases[c].said));
            } else {
                assert_string_equal(text, "");
            }
            cn_body_free(body);
        }
}

static void parts_that_nothing_anchors_are_counted_and_the_first_is_named(void **state)
{
    (void)state;
    cn_body *body = boxes(5, 0.1);
    unsigned char fixed[5 * 27] = {0};
    cn_body_modes m;
    char text[256];
    const int anchored[] = {0, 1, 3};
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 9; i++)
            fixed[27 * anchored[a] + i] = 1;
    assert_int_equal(cn_body_modes_find(body, fixed, &m), CN_OK);
    assert_int_equal(m.npart, 5);
    assert_int_equal(m.nloose, 2);
    assert_int_equal(m.part, 3);
    assert_int_equal(m.node, 54);
    cn_body_modes_text(&m, text, sizeof text);
    assert_string_equal(
        text, "part 3 of 5 (node 54 and 26 more) is free to shift along x, y and z and to turn about "
              "x, y and z");
    for (FAIL_EACH_ALLOC) {
        const cn_status status = cn_body_modes_find(body, fixed, &m);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
    }
    fail_alloc_at(-1);
    cn_body_free(body);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_stays_free_is_named),
        cmocka_unit_test(parts_that_nothing_anchors_are_counted_and_the_first_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
