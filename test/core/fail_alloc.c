#include "fail_alloc.h"

#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>

static atomic_long count, fail_at = -1;
static atomic_bool fired;

void *__real_malloc(size_t size);
void *__real_calloc(size_t n, size_t size);
void *__real_realloc(void *old, size_t size);
char *__real_strdup(const char *text);
FILE *__real_open_memstream(char **text, size_t *size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t n, size_t size);
void *__wrap_realloc(void *old, size_t size);
char *__wrap_strdup(const char *text);
FILE *__wrap_open_memstream(char **text, size_t *size);

void fail_alloc_at(long n)
{
    fail_at = n;
    count = 0;
    fired = false;
}

long fail_alloc_count(void)
{
    return count;
}

bool fail_alloc_fired(void)
{
    return fired;
}

bool fail_alloc_next(long *n)
{
    if (*n >= 0 && !fired) {
        fail_alloc_at(-1);
        return false;
    }
    fail_alloc_at(++*n);
    return true;
}

static bool fails_now(void)
{
    const bool now = atomic_fetch_add(&count, 1) == fail_at;
    if (now) fired = true;
    return now;
}

void *__wrap_malloc(size_t size)
{
    return fails_now() ? NULL : __real_malloc(size);
}

void *__wrap_calloc(size_t n, size_t size)
{
    return fails_now() ? NULL : __real_calloc(n, size);
}

void *__wrap_realloc(void *old, size_t size)
{
    return fails_now() ? NULL : __real_realloc(old, size);
}

char *__wrap_strdup(const char *text)
{
    return fails_now() ? NULL : __real_strdup(text);
}

FILE *__wrap_open_memstream(char **text, size_t *size)
{
    return fails_now() ? NULL : __real_open_memstream(text, size);
}
