/* Statuses and faults: names and values from one list. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <string.h>
#include "catnav/status.h"

#define VALUE(status, number, name, text) CN_FAULT_##name,
static const int all[] = {CN_FAULT_LIST(VALUE)};
#define NAME(status, number, name, text) #name,
static const char *const names[] = {CN_FAULT_LIST(NAME)};
enum { N = sizeof all / sizeof *all };

static void test_each_fault_has_a_name_and_a_value_of_its_own_below_its_status(void **state)
{
    (void)state;
    for (int i = 0; i < N; i++) {
        assert_string_equal(cn_fault_name(all[i]), names[i]);
        assert_true(all[i] / 100 > CN_OK && all[i] / 100 < CN_STATUS_COUNT && all[i] % 100 > 0);
        for (int k = 0; k < i; k++)
            assert_true(all[k] != all[i] && strcmp(names[k], names[i]));
    }
}

static void test_every_number_has_a_name_if_an_empty_one(void **state)
{
    (void)state;
    for (int i = -200; i < 100 * CN_STATUS_COUNT + 200; i++) {
        assert_non_null(cn_fault_name(i)), assert_non_null(cn_status_text(i));
        if (i > 0 && i < 100 * CN_STATUS_COUNT && i % 100 == 0) assert_true(*cn_fault_name(i));
    }
    assert_string_equal(cn_fault_name(0), "");
    assert_string_equal(cn_fault_name(100 * CN_ERR_MESH), "MESH");
    assert_string_equal(cn_fault_name(100 * CN_STATUS_COUNT), "");
}

static void test_a_failure_returns_its_fault_s_status_and_keeps_the_first(void **state)
{
    (void)state;
    for (int i = 0; i < N; i++) {
        cn_error error = {0};
        assert_int_equal(cn_fail(&error, all[i], "a.stl", 3, "%d", i), all[i] / 100);
        assert_int_equal(cn_fail(&error, CN_ERR_MEMORY, "", 0, "later"), CN_ERR_MEMORY);
        assert_true((int)error.status == all[i] / 100 && error.fault == all[i] && error.line == 3);
        assert_int_equal(cn_fail(NULL, all[i], "", 0, "x"), all[i] / 100);
    }
    for (int status = CN_ERR_ARG; status < CN_STATUS_COUNT; status++) {
        cn_error error = {0};
        assert_int_equal(cn_fail(&error, status, NULL, 0, "x"), status);
        assert_true((int)error.status == status && error.fault == 100 * status);
    }
}

static void test_what_the_system_refuses_and_what_is_no_number_are_told_apart(void **state)
{
    (void)state;
    assert_int_equal(cn_fault_file(ENOENT), CN_FAULT_MISSING_FILE);
    assert_int_equal(cn_fault_file(EISDIR), CN_FAULT_NO_FILE);
    assert_int_equal(cn_fault_file(EACCES), CN_FAULT_ACCESS);
    static const char *const numbers[] = {"nan", "-inf", "1e999", "Infinity"}, *const words[] = {
                                                                                   "", "one", "1,5", "nano"};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(cn_fault_number(numbers[i]), CN_FAULT_NUMBER);
        assert_int_equal(cn_fault_number(words[i]), CN_FAULT_TYPE);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_fault_has_a_name_and_a_value_of_its_own_below_its_status),
        cmocka_unit_test(test_every_number_has_a_name_if_an_empty_one),
        cmocka_unit_test(test_a_failure_returns_its_fault_s_status_and_keeps_the_first),
        cmocka_unit_test(test_what_the_system_refuses_and_what_is_no_number_are_told_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
