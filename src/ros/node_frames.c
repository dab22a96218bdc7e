/* node_frames.c - frames: what comes in another than the node's is brought into it, answers go back. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "catnav/vec3.h"
#include "node_parts.h"

#define FRAME_WAIT 0.5 /* a transform may still be on its way this long [s] */

/* The name without the slash that it once began with. */
static const char *plain(const char *frame)
{
    return frame[0] == '/' ? frame + 1 : frame;
}

bool frames_same(const char *a, const char *b)
{
    return !strcmp(plain(a), plain(b));
}

cn_status frames_join(cn_node *node, const char *from, const char *to, uint64_t stamp, cn_ros_motion *motion,
                      cn_error *error)
{
    *motion = (cn_ros_motion){.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .rest = true};
    if (!from[0] || frames_same(from, to)) return CN_OK;
    motion->rest = false;
    return cn_ros_transform(node->ros, plain(from), plain(to), stamp, FRAME_WAIT, motion, error);
}

static void turn(const double r[9], double p[3])
{
    double q[3];
    for (int k = 0; k < 3; k++)
        q[k] = r[3 * k] * p[0] + r[3 * k + 1] * p[1] + r[3 * k + 2] * p[2];
    cn_copy3(q, p);
}

void frames_move(const cn_ros_motion *motion, int n, double *points)
{
    if (motion->rest) return; /* bit for bit */
    for (int i = 0; i < n; i++) {
        turn(motion->rotation, points + 3 * i);
        cn_axpy(1, motion->translation, points + 3 * i);
    }
}

void frames_inverse(const cn_ros_motion *motion, cn_ros_motion *inverse)
{
    *inverse = (cn_ros_motion){.rest = motion->rest};
    for (int i = 0; i < 9; i++)
        inverse->rotation[i] = motion->rotation[3 * (i % 3) + i / 3];
    for (int k = 0; k < 3; k++)
        inverse->translation[k] = -motion->translation[k];
    turn(inverse->rotation, inverse->translation);
}

void frames_move_answer(const cn_ros_motion *motion, cn_ros_answer *answer)
{
    if (motion->rest) return;
    frames_move(motion, 1, answer->report.verdict.position); /* NAN stays NAN */
    if (!answer->path) return;
    frames_move(motion, answer->path->n, answer->path->x);
    for (int i = 0; i < answer->path->n; i++) {
        turn(motion->rotation, answer->path->tangent + 3 * i);
        turn(motion->rotation, answer->path->normal + 3 * i);
    }
}
