/* Any bytes as a pair of TetGen's .node and .ele; the second begins after a line `#ele`. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char mark[] = "#ele\n";
    const uint8_t *cut = memmem(data, size, mark, sizeof mark - 1);
    const size_t first = cut ? (size_t)(cut - data) : size;
    const size_t second = cut ? first + sizeof mark - 1 : size;
    const char *node = file_of(".node", data, first), *ele = file_of(".ele", data + second, size - second);
    fuzz_tets(node, size);
    unlink(node), unlink(ele);
    return 0;
}
