#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include <jansson.h>
#include <math.h>
#include <unistd.h>

#include "catnav/report.h"
#include "fail_alloc.h"

static cn_report filled(void)
{
    cn_report r = {
        .scene = "aorta", .seed = 4294967295u, .threads = 2, .reproducible = true, .steps = 12, .replans = 3};
    r.verdict = (cn_verdict){.code = CN_VERDICT_LIMIT_BROKEN,
                             .message = "stress broken",
                             .has_quantity = true,
                             .quantity = CN_QUANTITY_STRESS,
                             .value = 3e6,
                             .limit = 2e6,
                             .body = "catheter",
                             .element = 17,
                             .position = {1, 2, 3},
                             .step = 9,
                             .time = 0.09,
                             .waypoint = 0};
    r.time.simulation_s = 2.5;
    r.time.step_ms = (cn_spread){1, 2, 3, 4};
    r.time.step_ms_last100 = (cn_spread){NAN, NAN, NAN, NAN};
    r.contact.gap_min = NAN;
    r.drive.work = INFINITY;
    r.nlimit = 1;
    r.limit = calloc(1, sizeof *r.limit);
    *r.limit = (cn_limit_report){.body = "catheter",
                                 .limit = {CN_QUANTITY_VOLUME, CN_REDUCE_MEAN, 0.2},
                                 .worst = 0.1,
                                 .step = -1,
                                 .element = -1};
    r.nbody = 2;
    r.body = calloc(2, sizeof *r.body);
    strcpy(r.body[0].name, "catheter");
    strcpy(r.body[1].name, "bear");
    r.body[0].error_bending = 4, r.body[0].polygon_bending = -0.5;
    r.body[0].shape_error = 0.25, r.body[1].shape_error = NAN;
    r.body[0].tip[2] = 0.5;
    r.body[1].error_bending = r.body[1].error_torsion = r.body[1].error_axial = NAN;
    r.body[1].goal_distance = NAN;
    r.nleft_out = 1;
    r.left_out[0] = (cn_left_out){"refit", "nothing moves", 0.5, NAN};
    r.memory_peak_bytes = 123456789;
    return r;
}

static json_t *as_json(const cn_report *report)
{
    char *text = cn_report_json(report);
    assert_non_null(text);
    json_t *json = json_loads(text, 0, NULL);
    assert_non_null(json);
    free(text);
    return json;
}

/* Value at a path of keys and indices such as "bodies.0.tip.2"; it must be there. */
static const json_t *at(const json_t *json, const char *path)
{
    char word[64];
    for (const char *rest = path; *rest;) {
        const size_t n = strcspn(rest, ".");
        memcpy(word, rest, n);
        word[n] = 0;
        json = json_is_array(json) ? json_array_get(json, (size_t)atoi(word)) : json_object_get(json, word);
        if (!json) fail_msg("%s is absent", path);
        rest += n + (rest[n] == '.');
    }
    return json;
}

/* The contract's keys, section 7. */
static const char *const keys[] = {"catnav",
                                   "scene",
                                   "seed",
                                   "threads",
                                   "reproducible",
                                   "status",
                                   "verdict.code",
                                   "verdict.fault",
                                   "verdict.message",
                                   "verdict.quantity",
                                   "verdict.value",
                                   "verdict.limit",
                                   "verdict.body",
                                   "verdict.element",
                                   "verdict.position",
                                   "verdict.step",
                                   "verdict.time",
                                   "verdict.waypoint",
                                   "counts.nodes",
                                   "counts.dof",
                                   "counts.tets",
                                   "counts.rigid_nodes",
                                   "counts.deformable_nodes",
                                   "counts.wall_triangles",
                                   "time.map_s",
                                   "time.planning_s",
                                   "time.simulation_s",
                                   "time.collision_s",
                                   "time.wall_s",
                                   "time.simulated_s",
                                   "time.real_time_factor",
                                   "time.fem_ms.median",
                                   "time.fem_ms.p95",
                                   "time.fem_ms.max",
                                   "time.collision_ms.median",
                                   "time.collision_ms.p95",
                                   "time.collision_ms.max",
                                   "time.step_ms.median",
                                   "time.step_ms.p95",
                                   "time.step_ms.p99",
                                   "time.step_ms.max",
                                   "time.step_ms_last100.median",
                                   "time.step_ms_last100.p95",
                                   "time.step_ms_last100.max",
                                   "steps",
                                   "rejected_steps",
                                   "replans",
                                   "contact.gap_min",
                                   "contact.intersections",
                                   "contact.outside_nodes",
                                   "contact.force_max",
                                   "drive.force_max",
                                   "drive.work",
                                   "limits",
                                   "solver.newton_max",
                                   "solver.linear_max",
                                   "solver.residual_max",
                                   "solver.inverted_max",
                                   "bodies",
                                   "left_out",
                                   "memory_peak_bytes"};
static const char *const entry_keys[] = {"limits.0.body",
                                         "limits.0.quantity",
                                         "limits.0.reduce",
                                         "limits.0.limit",
                                         "limits.0.worst",
                                         "limits.0.at.step",
                                         "limits.0.at.time",
                                         "limits.0.at.element",
                                         "limits.0.at.position",
                                         "bodies.0.name",
                                         "bodies.0.model",
                                         "bodies.0.tip.2",
                                         "bodies.0.goal.2",
                                         "bodies.0.goal_distance",
                                         "bodies.0.com.2",
                                         "bodies.0.rest_volume",
                                         "bodies.0.volume",
                                         "bodies.0.energy",
                                         "bodies.0.kinetic",
                                         "bodies.0.momentum.2",
                                         "bodies.0.angular_momentum.2",
                                         "bodies.0.shape_error",
                                         "bodies.0.stiffness_error.polygon.bending",
                                         "bodies.0.stiffness_error.element.axial",
                                         "bodies.0.stiffness_error.bending",
                                         "bodies.0.stiffness_error.torsion",
                                         "bodies.0.stiffness_error.axial",
                                         "left_out.0.what",
                                         "left_out.0.why",
                                         "left_out.0.time_saved_s",
                                         "left_out.0.error"};

static void every_key_of_the_contract_is_there_even_in_an_empty_report(void **state)
{
    (void)state;
    cn_report empty = {0}, full = filled();
    json_t *a = as_json(&empty), *b = as_json(&full);
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        at(a, keys[i]), at(b, keys[i]);
    for (size_t i = 0; i < sizeof entry_keys / sizeof *entry_keys; i++)
        at(b, entry_keys[i]);
    assert_string_equal(json_string_value(at(a, "verdict.code")),
                        "UNKNOWN"); /* a zeroed verdict is no success */
    assert_string_equal(json_string_value(at(a, "status")), "failed");
    json_decref(a);
    json_decref(b);
    cn_report_clear(&full);
    assert_true(full.nbody == 0 && !full.body && !full.limit);
}

static void figures_come_back_and_what_is_undefined_is_null(void **state)
{
    (void)state;
    cn_report r = filled();
    json_t *j = as_json(&r);
    assert_true(strlen(json_string_value(at(j, "catnav"))) > 0);
    assert_true(json_integer_value(at(j, "seed")) == 4294967295LL && json_is_true(at(j, "reproducible")));
    assert_string_equal(json_string_value(at(j, "status")), "infeasible");
    assert_string_equal(json_string_value(at(j, "verdict.code")), "LIMIT_BROKEN");
    assert_string_equal(json_string_value(at(j, "verdict.quantity")), "stress");
    assert_true(json_real_value(at(j, "verdict.value")) == 3e6 &&
                json_real_value(at(j, "verdict.position.2")) == 3);
    assert_true(json_integer_value(at(j, "verdict.element")) == 17 &&
                json_integer_value(at(j, "verdict.waypoint")) == 0);
    assert_true(json_is_null(at(j, "time.step_ms_last100.max")) &&
                json_real_value(at(j, "time.step_ms.p95")) == 2);
    assert_true(json_is_null(at(j, "contact.gap_min")) && json_is_null(at(j, "drive.work")));
    assert_true(json_is_null(at(j, "limits.0.at.step")) && json_is_null(at(j, "limits.0.at.element")));
    assert_string_equal(json_string_value(at(j, "limits.0.reduce")), "mean");
    assert_true(json_real_value(at(j, "bodies.0.tip.2")) == 0.5);
    assert_true(json_real_value(at(j, "bodies.0.stiffness_error.bending")) == 4);
    assert_true(json_real_value(at(j, "bodies.0.stiffness_error.element.bending")) == 9);
    assert_true(json_real_value(at(j, "bodies.0.shape_error")) == 0.25);
    assert_true(json_is_null(at(j, "bodies.1.shape_error")));
    assert_true(json_is_null(at(j, "bodies.1.stiffness_error")) &&
                json_is_null(at(j, "bodies.1.goal_distance")));
    assert_true(json_is_null(at(j, "left_out.0.error")) &&
                json_integer_value(at(j, "memory_peak_bytes")) == 123456789);
    json_decref(j);
    cn_report_clear(&r);
}

static void a_message_cut_within_a_character_still_makes_json(void **state)
{
    (void)state;
    cn_report r = {0};
    strcpy(r.verdict.message, "3 \xc2\xb5m at \xc3");
    json_t *j = as_json(&r);
    assert_string_equal(json_string_value(at(j, "verdict.message")), "3 ??m at ?");
    json_decref(j);
}

static void every_verdict_has_the_contracts_status_and_exit(void **state)
{
    (void)state;
    static const struct {
        const char *name, *status;
        int exit;
    } table[] = {{"UNKNOWN", NULL, 4},
                 {"REACHED", "reached", 0},
                 {"RAN", "ran", 0},
                 {"BAD_INPUT", "bad_input", 1},
                 {"NO_ARTERY", "bad_input", 1},
                 {"NO_CONTACT_FREE_START", "infeasible", 2},
                 {"NO_PATH", "infeasible", 2},
                 {"LIMIT_BROKEN", "infeasible", 2},
                 {"TIMEOUT", "time_limit", 3},
                 {"NUMERICS", "failed", 4},
                 {"CANCELLED", "interrupted", 130},
                 {"BUSY", NULL, 4}};
    assert_int_equal(CN_VERDICT_COUNT, 12);
    for (int i = 0; i < 12; i++) {
        assert_string_equal(cn_verdict_name(i), table[i].name);
        if (table[i].status) assert_string_equal(cn_verdict_status(i), table[i].status);
        assert_int_equal(cn_verdict_exit(i), table[i].exit);
    }
    assert_string_equal(cn_verdict_name(-1), "UNKNOWN");
    assert_int_equal(cn_verdict_exit(99), 4);
}

static void the_spread_of_known_samples_is_known(void **state)
{
    (void)state;
    double hundred[100], two[2] = {3, 1}, one[1] = {7};
    for (int i = 0; i < 100; i++)
        hundred[i] = 100 - i;
    cn_spread s = cn_spread_of(100, hundred);
    assert_true(s.median == 50.5 && s.p95 == 95 && s.p99 == 99 && s.max == 100);
    s = cn_spread_of(2, two);
    assert_true(s.median == 2 && s.p95 == 3 && s.p99 == 3 && s.max == 3);
    s = cn_spread_of(1, one);
    assert_true(s.median == 7 && s.p95 == 7 && s.p99 == 7 && s.max == 7);
    s = cn_spread_of(0, NULL);
    assert_true(isnan(s.median) && isnan(s.p95) && isnan(s.p99) && isnan(s.max));
}

static void the_memory_peak_grows_with_memory(void **state)
{
    (void)state;
    const size_t before = cn_memory_peak(), size = 64u << 20;
    assert_true(before > 100000);
    char *block = malloc(size);
    assert_non_null(block);
    memset(block, 1, size);
    assert_true(cn_memory_peak() > before + size / 2);
    free(block);
}

static void a_report_is_written_whole_or_not_at_all(void **state)
{
    (void)state;
    cn_report r = filled();
    cn_error error = {0};
    assert_int_equal(cn_report_write(&r, "test-report.json", &error), CN_OK);
    json_t *j = json_load_file("test-report.json", 0, NULL);
    assert_string_equal(json_string_value(at(j, "scene")), "aorta");
    json_decref(j);
    unlink("test-report.json");
    assert_int_equal(cn_report_write(&r, "no-such-folder/r.json", &error), CN_ERR_FILE);
    assert_string_equal(error.file, "no-such-folder/r.json");
    memset(&error, 0, sizeof error);
    if (access("/dev/full", W_OK) == 0) { /* a full disk */
        assert_int_equal(cn_report_write(&r, "/dev/full", &error), CN_ERR_FILE);
        assert_non_null(strstr(error.message, "No space left"));
    }
    assert_int_equal(cn_report_write(&r, "/dev/null", NULL), CN_OK); /* stays what it is */
    assert_int_not_equal(access("/dev/null", W_OK), -1);
    cn_report_clear(&r);
}

static void writing_survives_every_failed_allocation(void **state)
{
    (void)state;
    cn_report r = filled();
    strcpy(r.verdict.message, "cut \xc3");
    bool fired = true;
    for (long i = 0; fired; i++) {
        fail_alloc_at(i);
        const cn_status status = cn_report_write(&r, "test-report.json", NULL);
        fired = fail_alloc_fired();
        fail_alloc_at(-1);
        assert_true(fired || status == CN_OK);
        unlink("test-report.json");
    }
    cn_report_clear(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_key_of_the_contract_is_there_even_in_an_empty_report),
        cmocka_unit_test(figures_come_back_and_what_is_undefined_is_null),
        cmocka_unit_test(a_message_cut_within_a_character_still_makes_json),
        cmocka_unit_test(every_verdict_has_the_contracts_status_and_exit),
        cmocka_unit_test(the_spread_of_known_samples_is_known),
        cmocka_unit_test(the_memory_peak_grows_with_memory),
        cmocka_unit_test(a_report_is_written_whole_or_not_at_all),
        cmocka_unit_test(writing_survives_every_failed_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
