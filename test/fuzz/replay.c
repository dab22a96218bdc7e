/* replay.c - a fuzzer's main without the fuzzer: hands it files, one after the other, in an ordinary build.
 *
 *     replay_KIND MOST FILE...    MOST: processor time [s] that one input may take; 0: any
 *
 * Memory is not counted here: the sanitizers' allocator does that. Ends with 1 where an input took longer. */
#include <time.h>
#include "fuzz.h"

int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void *, size_t),
                                              void (*on_free)(const volatile void *))
{
    (void)on_malloc, (void)on_free;
    return 1;
}
size_t __sanitizer_get_allocated_size(const volatile void *p)
{
    (void)p;
    return 0;
}

static double worked(void) /* processor time of all threads [s] */
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static uint8_t *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    uint8_t *data = NULL;
    if (!file) return NULL;
    if (!fseek(file, 0, SEEK_END) && (data = malloc((*size = (size_t)ftell(file)) + 1))) {
        rewind(file);
        if (fread(data, 1, *size, file) != *size) free(data), data = NULL;
    }
    fclose(file);
    return data;
}

int main(int argc, char **argv)
{
    const double most = argc > 1 ? strtod(argv[1], NULL) : 0;
    double slowest = 0;
    for (int i = 2; i < argc; i++) {
        size_t size = 0;
        uint8_t *data = read_file(argv[i], &size);
        if (!data) return fprintf(stderr, "%s cannot be read\n", argv[i]), 1;
        const double start = worked();
        LLVMFuzzerTestOneInput(data, size);
        const double took = worked() - start;
        free(data);
        if (took > slowest) slowest = took;
        if (most > 0 && took > most) return fprintf(stderr, "%s took %.2f s\n", argv[i], took), 1;
    }
    printf("%d inputs, the slowest %.3f s of processor time\n", argc > 2 ? argc - 2 : 0, slowest);
    return 0;
}
