/* Any bytes as a .ply file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_surface(".ply", data, size);
}
