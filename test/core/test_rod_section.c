#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "rod.h"

static void twist_of_a_square_and_a_strip_shears_as_the_tables_say(void **state)
{
    (void)state;
    /* Timoshenko and Goodier, table of section 109: k = max shear / (G twist rate 2a), k1 = J / ((2a)^3 2b)
     */
    static const double table[4][3] = {
        {1, 0.675, 0.1406}, {2, 0.930, 0.229}, {3, 0.985, 0.263}, {10, 1, 0.312}};
    const cn_material m = {.young = 2.6, .poisson = 0.3};
    for (int i = 0; i < 4; i++)
        for (int turned = 0; turned < 2; turned++) {
            cn_shape shape = {.kind = CN_SHAPE_BEAM};
            cn_section s;
            shape.beam.size[0] = 1, shape.beam.size[1 + turned] = 0.1,
            shape.beam.size[2 - turned] = 0.1 * table[i][0];
            assert_int_equal(cn_section_of(&s, &shape, &m, 2.6, NULL), CN_OK);
            assert_true(fabs(s.twist_stress / 0.1 - table[i][1]) < 6e-4);
            assert_true(fabs(s.torsion / (1e-4 * table[i][0]) - table[i][2]) < 6e-4);
            double corner[2] = {s.half[0], s.half[1]}, middle[2] = {0, 0}, shear[2];
            cn_section_twist_stress(&s, middle, shear);
            assert_true(fabs(shear[0]) + fabs(shear[1]) < 1e-15);
            cn_section_twist_stress(&s, corner, shear); /* the rim is free: no shear at a corner */
            assert_true(fabs(shear[0]) + fabs(shear[1]) < 0.01 * s.twist_stress);
        }
}

static void a_rectangle_stands_with_its_width_along_n(void **state)
{
    (void)state;
    const cn_material m = {.young = 2, .poisson = 0, .density = 5};
    cn_shape shape = {.kind = CN_SHAPE_BEAM};
    cn_section s;
    shape.beam.size[0] = 1, shape.beam.size[1] = 0.2, shape.beam.size[2] = 0.1;
    assert_int_equal(cn_section_of(&s, &shape, &m, 2, NULL), CN_OK);
    assert_true(fabs(s.bending[0] - 2 * 0.2 * 1e-3 / 12) < 1e-17); /* about n: the height along b counts */
    assert_true(fabs(s.bending[1] - 2 * 0.1 * 8e-3 / 12) < 1e-17);
    assert_true(fabs(s.line_inertia[2] - s.line_inertia[0] - s.line_inertia[1]) < 1e-17);
    assert_true(fabs(s.line_mass - 0.1) < 1e-16 && s.half[0] == 0.1 && s.half[1] == 0.05);
    shape.kind = CN_SHAPE_SPHERE;
    assert_int_equal(cn_section_of(&s, &shape, &m, 2, NULL), CN_ERR_ARG);
    shape.kind = CN_SHAPE_BEAM;
    assert_int_equal(cn_section_of(&s, &shape, &m, NAN, NULL), CN_ERR_ARG);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(twist_of_a_square_and_a_strip_shears_as_the_tables_say),
        cmocka_unit_test(a_rectangle_stands_with_its_width_along_n),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
