/* Any bytes as a catnav/SurfaceMesh from the wire, in a node that has none, and again: its twin drops it or
 * follows. */
#include "fuzz_node.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_node *node = fuzz_node(false);
    count_begin(size +
                (3u << 20)); /* a mesh that may be a lumen is mapped, in memory of the map's own bound */
    fake_mesh(size, data);
    fake_settle(node);
    count_end();
    if (node->stage) fake_mesh(size, data), fake_settle(node);
    require(node->stage || node->refusal[0] || node->foreign, "a mesh neither taken nor refused");
    fake_node_free(node);
    fuzz_judge();
    return 0;
}
