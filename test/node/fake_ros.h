/* fake_ros.h - ros_node.h without ROS, for tests and fuzzers of the node's C. What would come from a topic is
 * handed in, what would be sent is judged at once - finite numbers, indices in range, one answer a call - and
 * counted. A planner of straight lines stands for OMPL. One node at a time; calls from any thread. */
#ifndef FAKE_ROS_H
#define FAKE_ROS_H

#include "node_parts.h"

/* A node on a scene; further parameters end with key NULL. Frames known to tf: map, and robot, 1 m beside it.
 */
cn_status fake_node(cn_node **out, const char *scene, const char *scene_dir, const cn_setting *parameter,
                    cn_error *error);
void fake_node_free(cn_node *node); /* every call must have been answered */
const cn_ros_handlers *fake_handlers(void);
volatile sig_atomic_t *fake_stop(void);

void fake_mesh(size_t size, const uint8_t *bytes); /* copied */
/* A mesh as it would come over the wire; free() it. NULL without memory, and what has none is not sent. */
uint8_t *fake_wire(const char *frame, const char *name, int nvert, const double *vert, int ntri,
                   const int *tri, size_t *size);
void fake_tube(double length, double radius); /* sends a closed tube along z from the origin, in frame map */
void fake_settle(cn_node *node);              /* waits until no mesh is being checked */

typedef struct {
    cn_verdict verdict;
    int steps;
    char *json; /* free() it */
} fake_answer;
/* Hands a call in. The request must stay until it has ended. */
cn_ros_call fake_plan(const cn_ros_request *request);
fake_answer fake_await(cn_ros_call call); /* answered and ended */
fake_answer fake_ask(const cn_ros_request *request);

/* Called whenever a way is sought, by the thread that does; NULL: no longer. */
void fake_planning(void (*call)(void *user), void *user);

/* What was sent so far that must not be; "" where all was well. */
const char *fake_wrong(void);

#endif
