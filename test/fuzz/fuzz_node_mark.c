/* Bytes as clicks, what the hand does to waypoints, and files of them, to a node with a tube in force. */
#include "fuzz_node.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static cn_node *node;
    static cn_ros_file_reply reply;
    char frame[256];
    tape t = {data, size};
    if (!node) node = fuzz_node(true);
    count_begin(size);
    while (t.left) {
        const unsigned what = take(&t);
        const char *text = take_text(&t, frame);
        const double point[] = {take_number(&t), take_number(&t), take_number(&t)};
        switch (what % 8) {
        case 0:
        case 1:
            fake_handlers()->click(node, text, point);
            break;
        case 2:
            fake_handlers()->save(node, text, &reply);
            break;
        case 3:
            fake_handlers()->load(node, text, &reply);
            break;
        case 4:
            fake_handlers()->feedback(node); /* shows them */
            break;
        default:
            fake_handlers()->mark(node, (cn_ros_mark_event)(take(&t) % 7), (int)take(&t) - 4, text,
                                  what & 8 ? point : NULL);
        }
        require(reply.nwaypoint >= 0 && reply.nwaypoint <= MARKS_MOST, "more waypoints than there may be");
    }
    for (bool open = true; open;) { /* a plan that the menu began */
        pthread_mutex_lock(&node->lock);
        open = node->own_open;
        pthread_mutex_unlock(&node->lock);
        if (open)
            __atomic_store_n(&node->cancel, 1, __ATOMIC_RELAXED),
                nanosleep(&(struct timespec){.tv_nsec = 200000}, NULL);
    }
    fake_handlers()->mark(node, CN_ROS_MARK_CLEAR, -1, "map", NULL);
    count_end();
    fuzz_judge();
    return 0;
}
