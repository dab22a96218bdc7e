/* pool.h - worker threads with a fixed split of the work, so that results do not depend on their number. */
#ifndef CN_POOL_H
#define CN_POOL_H

#include "catnav/status.h"

typedef struct cn_pool cn_pool;

cn_status cn_pool_new(cn_pool **out, int threads); /* threads >= 1, the caller's included */
void cn_pool_free(cn_pool *pool);                  /* NULL is fine */
int cn_pool_threads(const cn_pool *pool);          /* 1 for NULL */

/* Runs task(user, i) for i in [0, ntask), each once, on the pool's threads and the caller's; returns when all
 * are done. Which thread runs which i is not fixed: a task writes only what is its own, and sums are made
 * over i in order by the caller. Pool NULL: in order, on the caller's thread. Not reentrant. */
typedef void (*cn_task)(void *user, int i);
void cn_pool_run(cn_pool *pool, int ntask, cn_task task, void *user);

#endif
