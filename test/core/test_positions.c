/* test_positions.c - positions from a file: read to the last bit, refused by line. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "fail_alloc.h"
#include "positions.h"

static char file[] = "test-positions-XXXXXX";

static cn_status read_text(const char *text, int n, double *x, cn_error *error)
{
    FILE *out = fopen(file, "wb");
    assert_non_null(out);
    fputs(text, out);
    fclose(out);
    *error = (cn_error){0};
    return cn_positions_read(file, n, x, error);
}

static void positions_are_read_to_the_last_bit(void **state)
{
    (void)state;
    const double want[6] = {0.1, -2e-300, 1.0 / 3, 0, 5, -7.25};
    double x[6];
    char text[256];
    cn_error error;
    snprintf(text, sizeof text, "# nodes\n\n%.17g %.17g\t%.17g # first\r\n  %.17g %.17g %.17g", want[0],
             want[1], want[2], want[3], want[4], want[5]);
    assert_int_equal(read_text(text, 2, x, &error), CN_OK);
    assert_memory_equal(x, want, sizeof x);
}

static void what_is_no_list_of_positions_is_refused_by_its_line(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        int line;
        const char *words;
    } bad[] = {
        {"0 0 0\n1 1 1\n2 2 2\n", 3, "more than the 2 positions"},
        {"0 0 0\n", 0, "1 positions, and the body has 2 nodes"},
        {"", 0, "is empty"},
        {"# none\n", 0, "0 positions"},
        {"0 0 0\n1 nan 1\n", 2, "nan"},
        {"0 0 0\n1 inf 1\n", 2, "inf"},
        {"0 0 0\n1 1e999 1\n", 2, "1e999"},
        {"0 0 0\n\n1 0,5 1\n", 3, "0,5"},
        {"0 0\n1 1 1\n", 1, "a coordinate [m]"},
        {"0 0 0 0\n1 1 1\n", 1, "x y z"},
        {"here\n", 1, "here"},
    };
    double x[6];
    cn_error error;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        const cn_status status = read_text(bad[i].text, 2, x, &error);
        if (status != CN_ERR_PARSE || !strstr(error.message, bad[i].words) ||
            (bad[i].line && error.line != bad[i].line))
            fail_msg("%s: status %d, line %d: %s", bad[i].text, status, error.line, error.message);
        assert_non_null(strstr(error.file, "test-positions"));
    }
    assert_int_equal(cn_positions_read("/nowhere/x.txt", 2, x, &error), CN_ERR_FILE);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    double x[3];
    cn_error error;
    assert_int_equal(read_text("1 2 3\n", 1, x, &error), CN_OK);
    for (FAIL_EACH_ALLOC) {
        const cn_status status = cn_positions_read(file, 1, x, &error);
        assert_int_equal(status, fail_alloc_fired() ? CN_ERR_MEMORY : CN_OK);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(positions_are_read_to_the_last_bit),
        cmocka_unit_test(what_is_no_list_of_positions_is_refused_by_its_line),
        cmocka_unit_test(every_allocation_may_fail),
    };
    const int made = mkstemp(file);
    if (made < 0) return 1;
    close(made);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    unlink(file);
    return failed;
}
