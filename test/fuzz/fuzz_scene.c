/* Any bytes as a scene; what is read is also written again with other waypoints. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const double route[] = {0, 0, 0, 1, 2, 3};
    cn_scene *scene = NULL;
    cn_error error = {0};
    const char *path = file_of(".yaml", data, size);
    count_begin(size);
    cn_status status = cn_scene_read(&scene, path, 0, NULL, &error);
    check_answer(status, &error);
    cn_scene_free(scene);
    count_end();
    if (status == CN_OK) {
        cn_error refusal = {0};
        check_answer(cn_scene_write_waypoints(path, path, 2, route, &refusal), &refusal);
    }
    unlink(path);
    return 0;
}
