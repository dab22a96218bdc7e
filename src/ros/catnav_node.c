/* catnav_node.c - the process around the node: SIGINT and SIGTERM cancel the plan and end it with 0, within a
 * second also where something that cannot be cut short (a map of the lumen) is under way: files are written
 * elsewhere and renamed, so that none is left half-written. */
#include <malloc.h>
#include <stdio.h>
#include <sys/time.h>
#include <unistd.h>
#include "node.h"

#ifdef __SANITIZE_ADDRESS__
#define PATIENCE 60 /* [s]: leaks are looked for at an end by the front door alone, and slowly */
#else
#define PATIENCE 0.7
#endif

static volatile sig_atomic_t stop;

static void on_signal(int number)
{
    (void)number;
    stop = 1;
}

static void on_late(int number)
{
    (void)number;
    _exit(0);
}

int main(int argc, char **argv)
{
    struct sigaction action = {.sa_handler = on_signal}, late = {.sa_handler = on_late};
    const struct itimerval patience = {
        .it_value = {(time_t)PATIENCE, (suseconds_t)(1e6 * (PATIENCE - (time_t)PATIENCE))}};
    cn_error error = {0};
    cn_node *node;

    /* meshes and maps of many sizes come and go on several threads: what they held goes back */
    mallopt(M_ARENA_MAX, 2), mallopt(M_MMAP_THRESHOLD, 1 << 17), mallopt(M_TRIM_THRESHOLD, 1 << 20);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (cn_node_new(&node, argc, argv, &stop, &error) != CN_OK) {
        if (error.status == CN_ERR_CANCELLED) return 0;
        fprintf(stderr, "catnav_node: %s\n", error.message);
        return 1;
    }
    cn_node_run(node);
    sigaction(SIGALRM, &late, NULL);
    setitimer(ITIMER_REAL, &patience, NULL);
    cn_node_free(node);
    return 0;
}
