/* fail_alloc.h - lets the n-th allocation of the code under test fail. Link the test with
 * -Wl,--wrap=malloc,--wrap=calloc,--wrap=realloc (and this file): calls from libraries are not touched. */
#ifndef FAIL_ALLOC_H
#define FAIL_ALLOC_H

#include <stdbool.h>

/* From now on allocation number n (0: the next one) returns NULL, once; n < 0: none does. Starts the count.
 */
void fail_alloc_at(long n);
long fail_alloc_count(void); /* allocations asked for since fail_alloc_at */
bool fail_alloc_fired(void); /* whether the failure has happened since */

/* for (FAIL_EACH_ALLOC) { status = make(&thing); fail_alloc_at(-1) ... } : ends when the call needed fewer.
 */
#define FAIL_EACH_ALLOC                                                                                      \
    long fail_n = (fail_alloc_at(0), 0);                                                                     \
    fail_n == 0 || fail_alloc_fired();                                                                       \
    fail_alloc_at(++fail_n)

#endif
