/* plan_avoid.c - past moving obstacles by time: the path stays, when to be where on it is sought (Kant and
 * Zucker, Toward efficient trajectory planning: the path-velocity decomposition, 1986).
 *
 * Places on the path, `pace` apart, against times, `tick` = pace / speed apart: from one time to the next the
 * body goes on by a place, waits, or goes back by one. A place is closed at a time when the body, as it would
 * lie there, were nearer to an obstacle than `least`: what is to be kept between the surfaces, how far off
 * its path the drive lets a node go, and how much body and obstacle near each other in half a tick; so what
 * is open at two times is open between them. The body is a cover of balls. The earliest arrival is found
 * place by place, time after time, until the obstacles rest: a bounded search. Of the ways to it the one
 * taken goes on while it can and waits where it must. */
#include "plan_avoid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "tree.h"

enum { BALLS = 96, MOST_CELLS = 4000000 };

typedef struct {
    const cn_wall *wall;
    int index;        /* of the world */
    double radius;    /* about the middle [m] */
    double middle[3]; /* now [m] */
    double shift[3];
} mover;

struct cn_avoid {
    const cn_model_body *body;
    double keep, speed, tick;
    double least;    /* between cover and obstacle [m] */
    double rests;    /* when the last obstacle does [s] */
    double quickest; /* of the obstacles [m/s] */
    int nmover;
    mover *mover;
    int nball, node[BALLS]; /* at whose places the balls lie */
    double cover;           /* their radius [m] */
    double reach;           /* of the body from its goal node [m] */
    double wide;            /* half, across its path [m] */
    double from[BALLS][3];  /* as the body is, from the goal node [m] */
    unsigned char *open;    /* scratch: places reached, by times */
    size_t room;
};

static void remember_walls(cn_avoid *a, const cn_world *world)
{
    for (int w = 0; w < world->nwall; w++) {
        const cn_wall *wall = &world->wall[w];
        if (!cn_wall_moves(wall)) continue;
        mover *m = &a->mover[a->nmover++];
        m->wall = wall, m->index = w;
        for (int v = 0; v < wall->surface->nvert; v++)
            m->radius = fmax(m->radius, cn_distance(wall->middle, wall->surface->vert + 3 * (size_t)v));
        a->rests = fmax(a->rests, cn_wall_arrives(wall));
        a->quickest = fmax(a->quickest, wall->spec->path_speed);
    }
}

/* Nodes as far from each other as may be; the cover holds the triangles between nodes too. */
static cn_status cover_body(cn_avoid *a)
{
    const cn_body *b = a->body->body;
    double *away = malloc((size_t)b->nnode * sizeof *away), edge = 0;
    int farthest = a->body->goal_node;
    if (!away) return CN_ERR_MEMORY;
    for (int i = 0; i < b->nnode; i++)
        away[i] = INFINITY;
    for (a->cover = INFINITY; a->nball < BALLS && a->cover > 0;) {
        const double *x = b->rest + 3 * farthest;
        a->node[a->nball++] = farthest, a->cover = 0;
        for (int i = 0; i < b->nnode; i++) {
            away[i] = fmin(away[i], cn_distance(x, b->rest + 3 * i));
            if (away[i] > a->cover) a->cover = away[i], farthest = i;
        }
    }
    free(away);
    for (int t = 0; t < b->boundary->ntri; t++)
        for (int k = 0; k < 3; k++)
            edge = fmax(edge, cn_distance(b->point + 3 * b->boundary->tri[3 * t + k],
                                          b->point + 3 * b->boundary->tri[3 * t + (k + 1) % 3]));
    a->cover += fmax(edge / sqrt(3), 0.5 * a->body->diameter);
    for (int i = 0; i < b->nnode; i++) {
        const double across = hypot(a->body->offset[2 * i], a->body->offset[2 * i + 1]);
        a->wide = fmax(a->wide, across);
        a->reach = fmax(a->reach, hypot(across, a->body->behind[i]));
    }
    if (a->body->spec->drive.nodes == CN_NODES_UNIFORM) a->wide = a->reach;
    a->wide = fmax(a->wide, 0.5 * a->body->diameter), a->reach += a->cover;
    return CN_OK;
}

cn_status cn_avoid_new(cn_avoid **out, const cn_world *world, const cn_model_body *body, double keep)
{
    int n = 0;
    *out = NULL;
    for (int w = 0; w < world->nwall; w++)
        n += cn_wall_moves(&world->wall[w]);
    if (n == 0) return CN_OK;
    cn_avoid *a = calloc(1, sizeof *a);
    if (!a || !(a->mover = calloc((size_t)n, sizeof *a->mover))) goto fail;
    a->body = body, a->speed = body->spec->drive.speed;
    remember_walls(a, world);
    if (cover_body(a) != CN_OK) goto fail;
    const double room = body->spec->path.clearance + (body->catheter ? 0.5 * body->diameter : 0);
    a->keep = fmax(keep, room - a->wide); /* a path's clearance is its middle's */
    const double beside = 2 * body->spec->drive.path_distance, both = a->speed + a->quickest;
    a->tick = fmax(0.5 * (a->keep + beside + a->cover) / both, body->tick);
    a->least = a->keep + beside + 0.5 * both * a->tick;
    *out = a;
    return CN_OK;
fail:
    cn_avoid_free(a);
    return CN_ERR_MEMORY;
}

void cn_avoid_free(cn_avoid *a)
{
    if (!a) return;
    free(a->mover), free(a->open);
    free(a);
}

double cn_avoid_tick(const cn_avoid *a)
{
    return a->tick;
}

static void move_walls(cn_avoid *a, double time)
{
    for (int i = 0; i < a->nmover; i++) {
        mover *m = &a->mover[i];
        cn_wall_shift(m->wall, time, m->shift);
        for (int k = 0; k < 3; k++)
            m->middle[k] = m->wall->middle[k] + m->shift[k];
    }
}

/* Centre of a ball with the goal node at s; false: it is in the sheath. */
static bool ball_at(const cn_avoid *a, const cn_path *path, const cn_place *goal, double s, int ball,
                    double x[3])
{
    const cn_model_body *body = a->body;
    const int i = a->node[ball];
    cn_place place;
    if (body->spec->drive.nodes == CN_NODES_UNIFORM) {
        cn_add(goal->x, a->from[ball], x);
        return true;
    }
    if (body->sheath && s < body->behind[i]) return false;
    cn_path_at(path, s - body->behind[i], &place);
    cn_copy3(place.x, x);
    cn_axpy(body->offset[2 * i], place.n, x);
    cn_axpy(body->offset[2 * i + 1], place.b, x);
    return true;
}

/* Distance from the cover to the nearest obstacle with the goal node at s [m], or anything from `enough` on.
 */
static double distance_at(const cn_avoid *a, const cn_path *path, double s, double enough, const mover **by)
{
    double best = enough, x[3];
    cn_place goal;
    cn_path_at(path, s, &goal);
    for (const mover *m = a->mover; m < a->mover + a->nmover; m++) {
        if (cn_distance(goal.x, m->middle) - m->radius - a->reach >= best) continue;
        for (int i = 0; i < a->nball; i++) {
            if (!ball_at(a, path, &goal, s, i, x)) continue;
            if (cn_distance(x, m->middle) - m->radius - a->cover >= best) continue;
            cn_sub(x, m->shift, x);
            const double d = cn_tree_nearest(m->wall->tree, x, best + a->cover, NULL, NULL) - a->cover;
            if (d < best) best = d, *by = m;
        }
    }
    return best;
}

/* The search: from place 0, `back` places behind it to `ahead` before it, over `nlayer` ticks. */
typedef struct {
    cn_avoid *avoid;
    const cn_path *path;
    double s, end, time; /* of the goal node now; of the last waypoint; now */
    double tick, pace, least;
    int back, ahead, nplace, nlayer;
} search;

static double place_of(const search *q, int j)
{
    return fmin(q->s + q->pace * j, fmax(q->end, q->s));
}

static bool is_open(const search *q, int j)
{
    const mover *by = NULL;
    return distance_at(q->avoid, q->path, place_of(q, j), q->least, &by) >= q->least;
}

/* Straight on: where that comes too near, and how near while it does. */
static bool straight_on(const search *q, int settle, cn_meeting *meeting)
{
    cn_avoid *a = q->avoid;
    const int last = q->nlayer > q->ahead + settle ? q->ahead + settle : q->nlayer;
    meeting->wall = -1, meeting->distance = INFINITY, meeting->least = q->least;
    for (int k = 0; k < last || k <= q->ahead; k++) {
        const double s = place_of(q, k < q->ahead ? k : q->ahead);
        const mover *by = NULL;
        move_walls(a, q->time + k * q->tick);
        const double d = distance_at(a, q->path, s, q->least, &by);
        if (d >= q->least && meeting->wall < 0) continue;
        if (d >= q->least) break;
        if (!(d < meeting->distance)) continue;
        cn_place here;
        cn_path_at(q->path, s, &here);
        meeting->wall = by->index, meeting->time = q->time + k * q->tick, meeting->distance = d;
        cn_copy3(here.x, meeting->x), cn_copy3(by->middle, meeting->ball.centre);
        meeting->ball.radius = by->radius + q->least + a->wide;
    }
    return meeting->wall < 0;
}

static unsigned char *layer(const search *q, int k)
{
    return q->avoid->open + (size_t)k * (size_t)q->nplace + q->back;
}

/* Places of layer k from those of the one before. */
static void spread(const search *q, int k)
{
    const unsigned char *from = layer(q, k - 1);
    unsigned char *to = layer(q, k);
    move_walls(q->avoid, q->time + k * q->tick);
    for (int j = -q->back; j <= q->ahead; j++) {
        const bool met = from[j] || (j > -q->back && from[j - 1]) || (j < q->ahead && from[j + 1]);
        to[j] = met && is_open(q, j);
    }
}

/* The layer and place from which on the body goes straight to its end; false: there is none. */
static bool arrive(const search *q, int settle, int *layer_at, int *place_at)
{
    int stays = 0;
    memset(layer(q, 0) - q->back, 0, (size_t)q->nplace);
    layer(q, 0)[0] = 1;
    for (int k = 1; k <= q->nlayer; k++) {
        spread(q, k);
        stays = layer(q, k)[q->ahead] ? stays + 1 : 0;
        if (stays <= settle) continue;
        *layer_at = k - settle, *place_at = q->ahead;
        return true;
    }
    move_walls(q->avoid, q->time + q->nlayer * q->tick); /* now they rest */
    for (int j = q->ahead; j >= -q->back && is_open(q, j); j--)
        if (layer(q, q->nlayer)[j]) {
            *layer_at = q->nlayer, *place_at = j;
            return true;
        }
    return false;
}

/* First move of the way there, and how many of its like follow: waits as late as it may. */
static int first_move(const search *q, int k, int j, int *like)
{
    int move = 1;
    *like = 1 << 20; /* from here on straight to the end */
    for (; k > 0; k--) {
        const unsigned char *from = layer(q, k - 1);
        const int before = from[j] ? j : j > -q->back && from[j - 1] ? j - 1 : j + 1;
        *like = j - before == move ? *like + 1 : 1;
        move = j - before, j = before;
    }
    return move;
}

static cn_status lay_out(search *q, double far)
{
    cn_avoid *a = q->avoid;
    const double ahead = fmax(0, q->end - q->s), back = fmax(0, q->s), left = fmax(0, a->rests - q->time);
    double cells;
    for (q->tick = a->tick;; q->tick *= 1.25) {
        q->pace = a->speed * q->tick;
        cells = ((ahead + back) / q->pace + 3) * (left / q->tick + far / q->pace + 3);
        if (cells < MOST_CELLS) break;
    }
    q->ahead = (int)ceil(ahead / q->pace), q->back = (int)floor(back / q->pace);
    q->nplace = q->ahead + q->back + 1, q->nlayer = (int)ceil(left / q->tick) + 1;
    q->least = a->least + 0.5 * (a->speed + a->quickest) * (q->tick - a->tick);
    const size_t room = (size_t)q->nplace * ((size_t)q->nlayer + 1);
    if (room <= a->room) return CN_OK;
    free(a->open);
    a->room = 0;
    if (!(a->open = malloc(room))) return CN_ERR_MEMORY;
    a->room = room;
    return CN_OK;
}

cn_status cn_avoid_look(cn_avoid *a, const cn_body_state *state, const cn_path *path, double time,
                        double *until, cn_meeting *meeting)
{
    const double far = cn_drive_lookahead(a->body), *goal = state->x + 3 * a->body->goal_node;
    search q = {.avoid = a, .path = path, .s = state->s_goal, .time = time};
    const mover *by = NULL;
    int layer_at, place_at, like;
    *until = INFINITY;
    meeting->wall = -1;
    q.end = path->s[path->waypoint[path->nwaypoint - 1]];
    for (int i = 0; i < a->nball; i++)
        cn_sub(state->x + 3 * a->node[i], goal, a->from[i]);
    const cn_status status = lay_out(&q, far);
    if (status != CN_OK) return status;
    /* nearer already than it should be: no nearer */
    move_walls(a, time);
    q.least = fmin(q.least, 0.999 * distance_at(a, path, q.s, q.least, &by));
    if (!(q.least > 0)) return CN_OK;               /* they touch: contact's business */
    const int settle = (int)ceil(3 * far / q.pace); /* slowing down at the end */
    if (straight_on(&q, settle, meeting)) return CN_OK;
    if (!arrive(&q, settle, &layer_at, &place_at)) return CN_ERR_NO_PATH;
    const int move = first_move(&q, layer_at, place_at, &like);
    if (move < 0) *until = q.s - far;
    if (move == 0) *until = q.s;
    if (move > 0 && like == 1) *until = q.s + q.pace;
    return CN_OK;
}
