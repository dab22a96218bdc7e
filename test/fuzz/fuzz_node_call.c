/* Bytes as calls, cancels and run-time settings, one after the other, to a node with a tube in force. */
#include "fuzz_node.h"

static void call(cn_node *node, tape *t)
{
    enum { MOST = 8 };
    static double point[3 * MOST];
    static cn_ros_limit limit[MOST];
    static char text[3 * MOST + 3][256];
    const unsigned how = take(t);
    cn_ros_request r = {.waypoint = point, .limit = limit, .seed = how, .scene_seed = how & 1};
    r.nwaypoint = (int)(take(t) % (MOST + 1)), r.nlimit = (int)(take(t) % (MOST + 1));
    r.frame = take_text(t, text[0]), r.sampling = take_text(t, text[1]), r.scene = take_text(t, text[2]);
    if (how & 2) r.frame = "map", r.sampling = "", r.scene = "";
    r.budget = take_number(t);
    for (int i = 0; i < 3 * r.nwaypoint; i++)
        point[i] = take_number(t);
    for (int i = 0; i < r.nlimit; i++)
        limit[i] = (cn_ros_limit){take_text(t, text[3 + 3 * i]), take_text(t, text[4 + 3 * i]),
                                  take_text(t, text[5 + 3 * i]), take_number(t)};
    const cn_ros_call number = fake_plan(&r);
    if (how & 4) fake_handlers()->cancel(node, number);
    if (how & 8) fake_handlers()->cancel(node, take(t));
    fake_handlers()->feedback(node);
    free(fake_await(number).json);
}

static void tune(cn_node *node, tape *t)
{
    cn_ros_tuning tuning = {.step = -1, .time_limit = 0.06, .budget = -1, .replans = (int)take(t) - 8};
    const unsigned what = take(t);
    if (what & 1) tuning.step = take_number(t);
    if (what & 2) tuning.frame_rate = take_number(t);
    if (what & 4) tuning.budget = take_number(t);
    for (int q = 0; q < CN_QUANTITY_PROGRESS; q++)
        for (int r = 0; r < 2; r++)
            tuning.limit[q][r] = what & 8 ? take_number(t) : -1;
    fake_handlers()->tune(node, &tuning);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static cn_node *node;
    static const uint8_t untuned[] = {7, 0};
    tape t = {data, size}, none = {untuned, 2};
    if (!node) node = fuzz_node(true);
    tune(node, &none);
    count_begin(size + (3u << 20)); /* plans take memory of their own, whatever is asked */
    for (int i = 0; i < 4 && t.left; i++) {
        if (take(&t) % 4 == 0)
            tune(node, &t);
        else
            call(node, &t);
    }
    count_end();
    fuzz_judge();
    return 0;
}
