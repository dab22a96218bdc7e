/* Any bytes as a file of molecules, with and without a radius for those that name none. */
#include "fuzz.h"
#include "molecules.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = file_of(".txt", data, size);
    for (int with = 0; with < 2; with++) {
        cn_packing *packing = NULL;
        cn_error error = {0};
        count_begin(size);
        const cn_status status = cn_packing_read(&packing, path, with ? 0.01 : 0, NULL, 0, &error);
        check_answer(status, &error);
        if (status == CN_OK) {
            require(packing->n > 0, "a packing without molecules was accepted");
            check_points(packing->n, packing->place);
        }
        cn_packing_free(packing);
        count_end();
    }
    unlink(path);
    return 0;
}
