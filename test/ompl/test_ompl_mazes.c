/* Random mazes: every one that can be solved is, and of those that cannot the answer is NO_PATH. A few by
 * default; CATNAV_MAZES=1000 for the thousand (and a tenth as many without a way). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include "catnav/vec3.h"
#include "plan_cases.h"

enum { SIDE = 6, CELLS = SIDE * SIDE, DOORS = 2 * SIDE * (SIDE - 1) };
static const double cell = 10e-3, half_wall = 0.6e-3, radius = 1.5e-3;

typedef struct {
    bool open[DOORS]; /* between a cell and its neighbour to the right, then to the one above */
    int from, to;
} maze;

static unsigned draw(uint64_t *seed, unsigned below)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(*seed >> 33) % below;
}

/* Cells on both sides of a door. */
static void sides(int door, int cells[2])
{
    const bool right = door < DOORS / 2;
    const int k = right ? door : door - DOORS / 2;
    const int x = right ? k % (SIDE - 1) : k % SIDE, y = right ? k / (SIDE - 1) : k / SIDE;
    cells[0] = y * SIDE + x, cells[1] = right ? cells[0] + 1 : cells[0] + SIDE;
}

/* A label for every cell, equal where doors join them. */
static void join(const maze *m, int label[CELLS])
{
    for (int i = 0; i < CELLS; i++)
        label[i] = i;
    for (bool changed = true; changed;) {
        changed = false;
        for (int d = 0; d < DOORS; d++) {
            int c[2];
            sides(d, c);
            if (!m->open[d] || label[c[0]] == label[c[1]]) continue;
            label[c[0]] = label[c[1]] = label[c[0]] < label[c[1]] ? label[c[0]] : label[c[1]];
            changed = true;
        }
    }
}

/* A tree of doors over all cells; without a way between the ends one door of it is shut again. */
static void make(maze *m, uint64_t seed, bool solvable)
{
    int label[CELLS], order[DOORS], c[2];
    memset(m, 0, sizeof *m);
    for (int d = 0; d < DOORS; d++)
        order[d] = d;
    for (int d = DOORS; d > 1; d--) {
        const int k = (int)draw(&seed, (unsigned)d), kept = order[d - 1];
        order[d - 1] = order[k], order[k] = kept;
    }
    for (int i = 0; i < DOORS; i++) {
        join(m, label);
        sides(order[i], c);
        m->open[order[i]] = label[c[0]] != label[c[1]];
    }
    m->from = 0, m->to = CELLS - 1;
    for (int i = 0; i < DOORS && !solvable; i++) {
        if (!m->open[order[i]]) continue;
        m->open[order[i]] = false;
        join(m, label);
        if (label[m->from] != label[m->to]) return;
        m->open[order[i]] = true;
    }
}

static void middle(int c, double p[3])
{
    p[0] = cell * (c % SIDE + 0.5), p[1] = cell * (c / SIDE + 0.5), p[2] = 0.5 * cell;
}

/* The maze as a scene of boxes; the status of its plan. */
static cn_status solve(const maze *m, unsigned seed, cn_sampling sampling, cn_path **path)
{
    plan_case c;
    cn_surface_spec wall[DOORS];
    cn_roadmap roadmap;
    cn_error error = {0};
    double point[6];
    char name[DOORS][16];
    case_begin(&c, radius);
    c.vessel.shape.kind = CN_SHAPE_BOX;
    memcpy(c.vessel.shape.box.max, (double[3]){SIDE * cell, SIDE * cell, cell}, 3 * sizeof(double));
    c.scene.obstacle = wall;
    for (int d = 0; d < DOORS; d++) {
        int s[2];
        double a[3], b[3];
        if (m->open[d]) continue;
        cn_surface_spec *box = &wall[c.scene.nobstacle];
        sides(d, s);
        middle(s[0], a), middle(s[1], b);
        memset(box, 0, sizeof *box);
        snprintf(name[c.scene.nobstacle], sizeof *name, "wall_%d", d);
        box->name = name[c.scene.nobstacle++];
        box->shape.kind = CN_SHAPE_BOX;
        box->shape.placement.scale = 1;
        for (int k = 0; k < 3; k++) { /* across the door thin, else a cell wide, above and below the room */
            const double at = 0.5 * (a[k] + b[k]), reach = k == 2        ? 0.6 * cell
                                                           : a[k] < b[k] ? half_wall
                                                                         : 0.5 * cell + half_wall;
            box->shape.box.min[k] = at - reach, box->shape.box.max[k] = at + reach;
        }
    }
    assert_int_equal(case_end(&c, 2), 0);
    middle(m->from, point), middle(m->to, point + 3);
    c.spec.sampling = sampling;
    c.spec.max_turn = 3.2;
    cn_plan_query query = case_query(&c, 2, point);
    query.seed = seed;
    const cn_status status = cn_plan_path(path, &query, cn_ompl_planner, &roadmap, &error);
    if (status == CN_OK)
        for (int i = 0; i < (*path)->n; i++)
            assert_true((*path)->clearance[i] >= radius);
    cn_roadmap_clear(&roadmap);
    case_free(&c);
    return status;
}

static int wanted(int few)
{
    const char *asked = getenv("CATNAV_MAZES");
    const int most = asked ? atoi(asked) : 0;
    return most > 0 ? (few > 10 ? most : (most + 9) / 10) : few;
}

static void every_maze_with_a_way_is_solved(void **state)
{
    const int n = wanted(20);
    int solved = 0;
    (void)state;
    for (int i = 0; i < n; i++) {
        maze m;
        cn_path *path = NULL;
        make(&m, (uint64_t)(i + 1), true);
        const cn_status status =
            solve(&m, (unsigned)i, i % 2 ? CN_SAMPLING_UNIFORM : CN_SAMPLING_MEDIAL_AXIS, &path);
        if (status != CN_OK) print_message("maze %d: %s\n", i, cn_status_text(status));
        solved += status == CN_OK;
        cn_path_free(path);
    }
    assert_int_equal(solved, n);
}

static void every_maze_without_a_way_is_answered_no_path(void **state)
{
    const int n = wanted(4);
    (void)state;
    for (int i = 0; i < n; i++) {
        maze m;
        cn_path *path = NULL;
        make(&m, (uint64_t)(i + 1), false);
        assert_int_equal(solve(&m, (unsigned)i, i % 2 ? CN_SAMPLING_UNIFORM : CN_SAMPLING_MEDIAL_AXIS, &path),
                         CN_ERR_NO_PATH);
        assert_null(path);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_maze_with_a_way_is_solved),
        cmocka_unit_test(every_maze_without_a_way_is_answered_no_path),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
