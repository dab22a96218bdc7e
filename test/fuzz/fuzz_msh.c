/* Any bytes as a .msh file of Gmsh: read as a surface, and as tetrahedra. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = file_of(".msh", data, size);
    fuzz_tets(path, size);
    unlink(path);
    return fuzz_surface(".msh", data, size);
}
