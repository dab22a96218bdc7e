/* node_queue.c - who is served when: one call at a time, others refused or kept waiting, cancels at any time.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "node_parts.h"

/* A plan reads it without the lock. */
static void set_cancel(cn_node *node, bool cancel)
{
    __atomic_store_n(&node->cancel, cancel, __ATOMIC_RELAXED);
}

static void answer_at_once(cn_node *node, cn_ros_call call, const cn_ros_request *request,
                           cn_verdict_code code, const char *why)
{
    cn_ros_answer answer = {0};
    cn_error error = {0};
    cn_fail(&error, CN_ERR_CANCELLED, "", 0, "%s", why);
    pthread_mutex_lock(&node->lock);
    const cn_ros_tuning tuning = node->tuning;
    pthread_mutex_unlock(&node->lock);
    snprintf(answer.frame, sizeof answer.frame, "%s", request->frame[0] ? request->frame : node->frame);
    answer_with(&answer, NULL, code, &error);
    answer.json = answer_json(node, NULL, request, answer.frame, &tuning, &answer.report);
    cn_ros_send_answer(node->ros, call, &answer);
}

/* The request of a call is no longer needed. */
static void end_call(cn_node *node, cn_ros_call call)
{
    if (call != OWN_CALL) {
        cn_ros_end_call(node->ros, call);
        return;
    }
    pthread_mutex_lock(&node->lock);
    node->own_open = false;
    pthread_mutex_unlock(&node->lock);
}

void on_plan(void *user, cn_ros_call call, const cn_ros_request *request)
{
    cn_node *node = user;
    char why[256];

    pthread_mutex_lock(&node->lock);
    const bool leaving = node->leaving;
    const bool taken = !leaving && node->nqueue < (node->open || node->nqueue ? node->queue : 1);
    if (taken) {
        node->waiting[node->nqueue++] = (ticket){call, request};
        pthread_cond_broadcast(&node->called);
    } else if (leaving) {
        snprintf(why, sizeof why, "the node is shutting down");
    } else if (node->queue == 0) {
        snprintf(why, sizeof why,
                 "another plan is running: one runs at a time, ask again when it has ended (with ~on_busy: "
                 "queue it would wait)");
    } else {
        snprintf(why, sizeof why,
                 "another plan is running and %d wait, as many as ~queue_size allows: ask again later",
                 node->nqueue);
    }
    node->calls_refused += !taken && !leaving;
    pthread_mutex_unlock(&node->lock);
    if (taken) return;
    if (call == OWN_CALL) CN_LOG(CN_LOG_WARNING, "%s", why);
    answer_at_once(node, call, request, leaving ? CN_VERDICT_CANCELLED : CN_VERDICT_BUSY, why);
    end_call(node, call);
}

void on_cancel(void *user, cn_ros_call call)
{
    cn_node *node = user;
    ticket found = {0};
    bool ended = false;

    pthread_mutex_lock(&node->lock);
    for (int i = 0; i < node->nqueue && !ended; i++) {
        if (node->waiting[i].call != call) continue;
        found = node->waiting[i], ended = true;
        node->nqueue--;
        memmove(node->waiting + i, node->waiting + i + 1, (size_t)(node->nqueue - i) * sizeof(ticket));
    }
    if (node->open && node->now.call == call) {
        set_cancel(node,
                   true); /* a plan under way ends within a step, and is answered with what it reached */
        if (node->preparing) node->open = false, node->answering = true, found = node->now;
    }
    pthread_mutex_unlock(&node->lock);
    if (!found.call) return;
    answer_at_once(node, call, found.request, CN_VERDICT_CANCELLED,
                   ended ? "cancelled while it waited for its turn" : "cancelled before the first step");
    if (ended) {
        end_call(node, call);
        return;
    }
    pthread_mutex_lock(&node->lock);
    node->answering = false;
    pthread_cond_broadcast(&node->called);
    pthread_mutex_unlock(&node->lock);
}

static void *work(void *user)
{
    cn_node *node = user;
    pthread_setname_np(pthread_self(), "plan");
    pthread_mutex_lock(&node->lock);
    for (;;) {
        while (node->nqueue == 0 && !node->leaving)
            pthread_cond_wait(&node->called, &node->lock);
        if (node->nqueue == 0) break;
        const ticket now = node->waiting[0];
        memmove(node->waiting, node->waiting + 1, (size_t)--node->nqueue * sizeof(ticket));
        node->now = now, node->open = true;
        set_cancel(node, node->leaving);
        node->progress = (cn_progress){.margin = INFINITY, .margin_of = ""};
        node->progress_at = wall_clock(), node->real_time_factor = 0, node->nmargin = 0;
        pthread_mutex_unlock(&node->lock);

        cn_ros_answer answer = {0};
        cn_ros_begin_call(node->ros, now.call);
        plan_call(node, now.request, &answer);

        pthread_mutex_lock(&node->lock);
        const bool open = node->open; /* a cancel may have answered it */
        node->open = false;
        while (node->answering) /* it is doing so, and needs the request */
            pthread_cond_wait(&node->called, &node->lock);
        pthread_mutex_unlock(&node->lock);
        if (open)
            cn_ros_send_answer(node->ros, now.call, &answer);
        else
            cn_ros_answer_clear(&answer);
        end_call(node, now.call);
        pthread_mutex_lock(&node->lock);
    }
    pthread_mutex_unlock(&node->lock);
    return NULL;
}

void on_feedback(void *user)
{
    static const char *const stages[] = {"mesh check", "map", "roadmap", "motion"};
    cn_node *node = user;
    cn_ros_margin margin[MARGINS_MOST];

    pthread_mutex_lock(&node->lock);
    const bool open = node->open;
    const cn_ros_call call = node->now.call;
    const cn_progress progress = node->progress;
    const double factor = node->real_time_factor;
    const int n = node->nmargin;
    memcpy(margin, node->margin, (size_t)n * sizeof *margin);
    pthread_mutex_unlock(&node->lock);
    marks_show(node);
    if (open) cn_ros_send_feedback(node->ros, call, &progress, stages[progress.stage], factor, n, margin);
}

cn_status queue_start(cn_node *node)
{
    if (pthread_create(&node->worker, NULL, work, node)) return CN_ERR_MEMORY;
    node->working = true;
    return CN_OK;
}

void queue_stop(cn_node *node)
{
    pthread_mutex_lock(&node->lock);
    node->leaving = true;
    set_cancel(node, true);
    pthread_cond_broadcast(&node->called);
    pthread_mutex_unlock(&node->lock);
    if (node->working) pthread_join(node->worker, NULL); /* those that wait are answered: cancelled */
    node->working = false;
}
