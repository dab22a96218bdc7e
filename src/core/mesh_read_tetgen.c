/* mesh_read_tetgen.c - TetGen's .node and .ele: a count line, then one line an item, counted from 0 or 1;
 * '#' begins a comment. Attributes and markers are left aside. */
#include "mesh_read.h"

#include <limits.h>

static cn_status read_nodes(cn_scan *scan, cn_tets *tets, int64_t extra, int64_t *base)
{
    cn_status status;
    int64_t index;
    double aside;

    for (int i = 0; i < tets->nnode; i++) {
        if ((status = cn_scan_need_line(scan, "a node")) != CN_OK) return status;
        if ((status = cn_scan_integer(scan, "the node's number", i ? *base + i : 0, i ? *base + i : 1,
                                      &index)) != CN_OK)
            return status;
        if (i == 0) *base = index;
        for (int k = 0; k < 3; k++)
            if ((status = cn_scan_number(scan, "a node coordinate", tets->node + 3 * (size_t)i + k)) != CN_OK)
                return status;
        for (int64_t k = 0; k < extra; k++)
            if ((status = cn_scan_number(scan, "an attribute or marker", &aside)) != CN_OK) return status;
        if ((status = cn_scan_no_more(scan, "the node")) != CN_OK) return status;
    }
    return CN_OK;
}

static cn_status read_elements(cn_scan *scan, cn_tets *tets, int64_t extra, int64_t base)
{
    cn_status status;
    int64_t index;
    double aside;

    for (int i = 0; i < tets->ntet; i++) {
        if ((status = cn_scan_need_line(scan, "a tetrahedron")) != CN_OK) return status;
        if ((status = cn_scan_integer(scan, "the tetrahedron's number", base + i, base + i, &index)) != CN_OK)
            return status;
        for (int k = 0; k < 4; k++) {
            if ((status = cn_scan_integer(scan, "a tetrahedron's node", base, base + tets->nnode - 1,
                                          &index)) != CN_OK)
                return status;
            tets->tet[4 * (size_t)i + k] = (int)(index - base);
        }
        for (int64_t k = 0; k < extra; k++)
            if ((status = cn_scan_number(scan, "an attribute", &aside)) != CN_OK) return status;
        if ((status = cn_scan_no_more(scan, "the tetrahedron")) != CN_OK) return status;
    }
    return CN_OK;
}

/* A file's first line: a count, two or three small numbers; the least bytes of an item are known. */
static cn_status read_counts(cn_scan *scan, const char *what, int n, int64_t count[4], int64_t least)
{
    static const char *const names[] = {"", "the second number of the count line", "the number of attributes",
                                        "the number of markers"};
    cn_status status;

    if ((status = cn_scan_need_line(scan, what)) != CN_OK) return status;
    if ((status = cn_scan_integer(scan, what, 0, INT_MAX / 4, count)) != CN_OK) return status;
    for (int i = 1; i < n; i++)
        if ((status = cn_scan_integer(scan, names[i], 0, 1000, count + i)) != CN_OK) return status;
    if ((status = cn_scan_no_more(scan, "the counts")) != CN_OK) return status;
    if (count[0] <= (int64_t)(scan->size - scan->at) / least + 1) return CN_OK;
    return cn_scan_fail(scan, CN_FAULT_CUT_SHORT,
                        "%s is %lld, but only %zu bytes follow: the file is cut short", what,
                        (long long)count[0], scan->size - scan->at);
}

cn_status cn_read_tetgen(cn_scan *node, cn_scan *ele, cn_tets **out)
{
    int64_t nodes[4] = {0}, tets[4] = {0}, base = 0;
    cn_tets *mesh = NULL;
    cn_status status;

    node->comment = ele->comment = '#';
    if ((status = read_counts(node, "the number of nodes", 4, nodes, 8)) != CN_OK) return status;
    if (nodes[1] != 3)
        return cn_scan_fail(node, CN_FAULT_COUNT, "the dimension is %lld: 3 is needed", (long long)nodes[1]);
    if ((status = read_counts(ele, "the number of tetrahedra", 3, tets, 10)) != CN_OK) return status;
    if (tets[1] != 4)
        return cn_scan_fail(ele, CN_FAULT_COUNT,
                            "the tetrahedra have %lld nodes: 4 are needed (run tetgen without -o2)",
                            (long long)tets[1]);
    if ((status = cn_tets_new(&mesh, (int)nodes[0], (int)tets[0])) != CN_OK) return status;
    if ((status = read_nodes(node, mesh, nodes[2] + nodes[3], &base)) != CN_OK) goto fail;
    if ((status = read_elements(ele, mesh, tets[2], base)) != CN_OK) goto fail;
    if (cn_scan_line(node) && (status = cn_scan_no_more(node, "the last node")) != CN_OK) goto fail;
    if (cn_scan_line(ele) && (status = cn_scan_no_more(ele, "the last tetrahedron")) != CN_OK) goto fail;
    *out = mesh;
    return CN_OK;
fail:
    cn_tets_free(mesh);
    return status;
}
