/* Any bytes as a .stl file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_surface(".stl", data, size);
}
