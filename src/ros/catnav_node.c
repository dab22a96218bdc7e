/* catnav_node.c - the process around the node: SIGINT and SIGTERM cancel the plan and end it with 0. */
#include <stdio.h>
#include "node.h"

static volatile sig_atomic_t stop;

static void on_signal(int number)
{
    (void)number;
    stop = 1;
}

int main(int argc, char **argv)
{
    struct sigaction action = {.sa_handler = on_signal};
    cn_error error = {0};
    cn_node *node;

    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (cn_node_new(&node, argc, argv, &stop, &error) != CN_OK) {
        if (error.status == CN_ERR_CANCELLED) return 0;
        fprintf(stderr, "catnav_node: %s\n", error.message);
        return 1;
    }
    cn_node_run(node);
    cn_node_free(node);
    return 0;
}
