/* node.h - the node: one world, one plan at a time, meshes replaced atomically, everything shown while it is
 * computed. Logic only: ROS is behind ros_node.h. */
#ifndef CN_NODE_H
#define CN_NODE_H

#include <signal.h>
#include "catnav/status.h"

typedef struct cn_node cn_node;

/* Waits for the ROS master, reads the parameters, opens topics and service. *stop is set by the caller's
 * signal handler: it cancels the plan under way and ends cn_node_run. CN_ERR_CANCELLED: stopped before the
 * master came. */
cn_status cn_node_new(cn_node **out, int argc, char **argv, const volatile sig_atomic_t *stop,
                      cn_error *error);
/* Returns once stopped, or shut down by the master. */
void cn_node_run(cn_node *node);
void cn_node_free(cn_node *node); /* NULL is fine */

#endif
