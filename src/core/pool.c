/* pool.c - a run is open between its announcement and the caller's running out of work; a worker joins only
 * while it is open, so a worker that wakes late costs nothing, and the caller waits only for those that
 * joined. */
#include "pool.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

enum { YIELDS = 64 }; /* polite polls before sleeping: runs follow each other within microseconds in a step */

struct cn_pool {
    int threads, started; /* the caller's included; workers that run */
    pthread_t *worker;
    pthread_mutex_t lock; /* guards open, quit, active and the job */
    pthread_cond_t work, done;
    bool open, quit;
    int active; /* workers in the open run */
    int ntask;
    cn_task task;
    void *user;
    atomic_uint run; /* number of the newest run */
    atomic_int next; /* next task of it */
};

static void take_tasks(cn_pool *pool)
{
    for (int i; (i = atomic_fetch_add(&pool->next, 1)) < pool->ntask;)
        pool->task(pool->user, i);
}

static void *work(void *user)
{
    cn_pool *pool = user;
    unsigned seen = 0;
    for (;;) {
        for (int k = 0; k < YIELDS && atomic_load(&pool->run) == seen; k++)
            sched_yield();
        pthread_mutex_lock(&pool->lock);
        while (!pool->quit && atomic_load(&pool->run) == seen)
            pthread_cond_wait(&pool->work, &pool->lock);
        seen = atomic_load(&pool->run);
        const bool quit = pool->quit, join = pool->open;
        if (join) pool->active++;
        pthread_mutex_unlock(&pool->lock);
        if (quit) return NULL;
        if (!join) continue;
        take_tasks(pool);
        pthread_mutex_lock(&pool->lock);
        if (--pool->active == 0) pthread_cond_signal(&pool->done);
        pthread_mutex_unlock(&pool->lock);
    }
}

/* Workers block every signal: those are for the thread that owns the program's loop. */
static cn_status start_workers(cn_pool *pool)
{
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    while (pool->started < pool->threads - 1 &&
           pthread_create(&pool->worker[pool->started], NULL, work, pool) == 0)
        pool->started++;
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return pool->started == pool->threads - 1 ? CN_OK : CN_ERR_MEMORY;
}

cn_status cn_pool_new(cn_pool **out, int threads)
{
    *out = NULL;
    if (threads < 1) return CN_ERR_ARG;
    cn_pool *pool = calloc(1, sizeof *pool);
    if (!pool) return CN_ERR_MEMORY;
    pool->threads = threads;
    pthread_mutex_init(&pool->lock, NULL); /* these three cannot fail with default attributes on Linux */
    pthread_cond_init(&pool->work, NULL);
    pthread_cond_init(&pool->done, NULL);
    cn_status status = CN_ERR_MEMORY;
    if (!(pool->worker = calloc((size_t)threads, sizeof *pool->worker))) goto fail;
    if ((status = start_workers(pool)) != CN_OK) goto fail;
    *out = pool;
    return CN_OK;
fail:
    cn_pool_free(pool);
    return status;
}

void cn_pool_free(cn_pool *pool)
{
    if (!pool) return;
    pthread_mutex_lock(&pool->lock);
    pool->quit = true;
    pthread_cond_broadcast(&pool->work);
    pthread_mutex_unlock(&pool->lock);
    for (int i = 0; i < pool->started; i++)
        pthread_join(pool->worker[i], NULL);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->work);
    pthread_mutex_destroy(&pool->lock);
    free(pool->worker);
    free(pool);
}

int cn_pool_threads(const cn_pool *pool)
{
    return pool ? pool->threads : 1;
}

void cn_pool_run(cn_pool *pool, int ntask, cn_task task, void *user)
{
    if (!pool || pool->threads == 1 || ntask <= 1) {
        for (int i = 0; i < ntask; i++)
            task(user, i);
        return;
    }
    pthread_mutex_lock(&pool->lock);
    pool->ntask = ntask, pool->task = task, pool->user = user;
    atomic_store(&pool->next, 0);
    pool->open = true;
    atomic_fetch_add(&pool->run, 1);
    pthread_cond_broadcast(&pool->work);
    pthread_mutex_unlock(&pool->lock);
    take_tasks(pool);
    pthread_mutex_lock(&pool->lock);
    pool->open = false;
    while (pool->active > 0)
        pthread_cond_wait(&pool->done, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}
