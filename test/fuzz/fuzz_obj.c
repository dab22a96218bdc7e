/* Any bytes as a .obj file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_surface(".obj", data, size);
}
