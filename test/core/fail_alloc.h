/* fail_alloc.h - lets the n-th allocation of the code under test fail. Link the test with
 * -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=strdup,--wrap=open_memstream (and this file): calls
 * from libraries are not touched. */
#ifndef FAIL_ALLOC_H
#define FAIL_ALLOC_H

#include <stdbool.h>

/* From now on allocation number n (0: the next one) returns NULL, once; n < 0: none does. Starts the count.
 */
void fail_alloc_at(long n);
long fail_alloc_count(void); /* allocations asked for since fail_alloc_at */
bool fail_alloc_fired(void); /* whether the failure has happened since */

/* for (FAIL_EACH_ALLOC) { status = make(&thing); ... } : allocation 0, 1, 2, ... fails, until none did. */
#define FAIL_EACH_ALLOC                                                                                      \
    long fail_n = -1;                                                                                        \
    fail_alloc_next(&fail_n);

/* True while a further failure is to be tried; arms it. */
bool fail_alloc_next(long *n);

#endif
