/* Any bytes as a file of positions of a body's nodes: of as many as its first byte says. */
#include "fuzz.h"
#include "positions.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    double x[3 * 255];
    const int n = size ? data[0] : 0;
    cn_error error = {0};
    const char *path = file_of(".txt", data + (size > 0), size - (size > 0));
    count_begin(size);
    const cn_status status = cn_positions_read(path, n, x, &error);
    check_answer(status, &error);
    if (status == CN_OK) check_points(n, x);
    count_end();
    unlink(path);
    return 0;
}
