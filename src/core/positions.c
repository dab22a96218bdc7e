#include "positions.h"
#include "mesh_read.h"

cn_status cn_positions_read(const char *path, int n, double *x, cn_error *error)
{
    cn_scan scan;
    int read = 0;
    cn_status status = cn_scan_open(&scan, path, error);
    if (status != CN_OK) return status;
    scan.comment = '#';
    while (status == CN_OK && cn_scan_line(&scan)) {
        if (read == n) {
            status = cn_scan_fail(&scan, CN_FAULT_COUNT, "more than the %d positions of the body's nodes", n);
            break;
        }
        for (int k = 0; k < 3 && status == CN_OK; k++)
            status = cn_scan_number(&scan, "a coordinate [m]", x + 3 * read + k);
        if (status == CN_OK) status = cn_scan_no_more(&scan, "x y z");
        read++;
    }
    if (status == CN_OK && read < n)
        status = cn_scan_fail(&scan, CN_FAULT_COUNT, "%d positions, and the body has %d nodes", read, n);
    cn_scan_close(&scan);
    return status;
}
