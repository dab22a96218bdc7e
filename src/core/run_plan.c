/* run_plan.c - plans of a run: the first one, checkpoints along it, and a new one when a limit broke. */
#include "run_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"

/* A waypoint closer to a wall than the device's radius cannot be planned to: its stand-in lies as far off the
 * wall as the device needs, if that is within reach of the wish. */
static void stand_in(const cn_run_data *run, double need, const double *wish, double *point)
{
    cn_copy3(wish, point);
    for (int k = 0; k < 8; k++) {
        double nearest[3], away[3];
        const double d = cn_world_distance(run->world, point, NULL, NULL, nearest);
        if (d >= need || !isfinite(d)) return;
        cn_sub(point, nearest, away);
        if (!cn_world_free_at(run->world, point) ||
            d < 1e-3 * need) { /* on the wall: towards the map's inside */
            double best = -1, probe[3];
            for (int axis = 0; axis < 6; axis++) {
                cn_copy3(point, probe);
                probe[axis / 2] += axis % 2 ? need : -need;
                const double c = cn_map_clearance(run->world->map, probe);
                if (c > best) best = c, cn_sub(probe, point, away);
            }
        }
        cn_normalise(away);
        cn_axpy(1.05 * need - (cn_world_free_at(run->world, point) ? d : -d), away, point);
    }
}

/* Bends the path near each stand-in so that it meets the waypoint the user asked for. */
static void meet_wishes(cn_path *path, const cn_body_spec *body, const double *point, double width)
{
    for (int w = 0; w < path->nwaypoint; w++) {
        double shift[3];
        const double s = path->s[path->waypoint[w]];
        cn_sub(body->waypoint + 3 * w, point + 3 * (w + 1), shift);
        if (cn_norm(shift) == 0) continue;
        for (int i = 0; i < path->n; i++) {
            const double u = fabs(path->s[i] - s) / width;
            const double share = u < 1 ? 0.5 * (1 + cos(acos(-1.0) * u)) : 0;
            cn_axpy(share, shift, path->x + 3 * i);
        }
    }
}

static double body_radius(const cn_body_spec *body)
{
    return body->shape.kind == CN_SHAPE_CATHETER ? 0.5 * body->shape.catheter.diameter : 0;
}

static void start_point(const cn_run_data *run, int b, double start[3])
{
    const cn_body_spec *body = &run->spec[b];
    if (body->shape.kind == CN_SHAPE_CATHETER) {
        cn_copy3(body->shape.catheter.entry, start);
        cn_axpy(body->shape.catheter.inserted, body->shape.catheter.direction, start);
    } else {
        cn_copy3(run->model->body[b].body->rest + 3 * run->model->body[b].goal_node, start);
    }
}

static cn_status roadmap_lengths(cn_run_body *body)
{
    free(body->vertex_s);
    body->vertex_s = malloc(((size_t)body->roadmap.npoint + 1) * sizeof(double));
    if (!body->vertex_s) return CN_ERR_MEMORY;
    double s = 0;
    const double end = cn_path_length(body->path);
    for (int i = 0; i < body->roadmap.npoint; i++)
        body->vertex_s[i] = s = cn_path_project(body->path, body->roadmap.x + 3 * i, s, end);
    body->next_vertex = 0;
    return CN_OK;
}

static bool nothing_rests(const cn_world *world)
{
    for (int w = 0; w < world->nwall; w++)
        if (!cn_wall_moves(&world->wall[w])) return false;
    return true;
}

/* Without walls that rest nothing is in the way: straight from point to point. */
static cn_status straight_path(cn_path **out, int npoint, const double *point)
{
    enum { PIECES = 32 };
    const int n = PIECES * (npoint - 1) + 1;
    double *x = malloc(3 * (size_t)n * sizeof *x);
    int *waypoint = malloc((size_t)npoint * sizeof *waypoint);
    cn_status status = x && waypoint ? CN_OK : CN_ERR_MEMORY;
    for (int i = 0; status == CN_OK && i < n; i++) {
        const int leg = i / PIECES < npoint - 1 ? i / PIECES : npoint - 2;
        const double t = (double)(i - PIECES * leg) / PIECES;
        for (int k = 0; k < 3; k++)
            x[3 * i + k] = (1 - t) * point[3 * leg + k] + t * point[3 * leg + 3 + k];
    }
    for (int w = 1; status == CN_OK && w < npoint; w++)
        waypoint[w - 1] = PIECES * w;
    if (status == CN_OK) status = cn_path_new(out, n, x, npoint - 1, waypoint, NULL);
    for (int i = 0; status == CN_OK && i < n; i++)
        (*out)->clearance[i] = INFINITY;
    free(x), free(waypoint);
    return status;
}

/* True when every waypoint lies within its tolerance of the start: there is nothing to plan. */
static bool at_the_goal(const cn_body_spec *spec, const double *start)
{
    for (int i = 0; i < spec->nwaypoint; i++)
        if (!(cn_distance(start, spec->waypoint + 3 * i) <= spec->waypoint_tolerance)) return false;
    return true;
}

static cn_status long_enough(cn_run_data *run, const cn_body_spec *spec, const cn_path *path)
{
    const bool sheath = spec->shape.catheter.sheath == CN_ON ||
                        (spec->shape.catheter.sheath == CN_AUTO && run->world->nvessel > 0);
    const double length = spec->shape.catheter.length,
                 way = cn_path_length(path) + spec->shape.catheter.inserted;
    if (!sheath || way <= length) return CN_OK;
    return cn_fail(
        &run->error, CN_FAULT_AT_ODDS, run->scene->path, 0,
        "%s is %.4g m long and its way to the last waypoint %.4g m: it would leave its sheath; give it more "
        "length",
        spec->name, length, way);
}

cn_status cn_run_plan_body(cn_run_data *run, int b)
{
    cn_body_spec *spec = &run->spec[b];
    cn_run_body *body = &run->body[b];
    const bool catheter = spec->shape.kind == CN_SHAPE_CATHETER;
    const bool directed = catheter && cn_norm(spec->shape.catheter.direction) > 0;
    cn_plan_query query = {.world = run->world, .spec = &spec->path, .radius = body_radius(spec)};
    cn_roadmap roadmap = {0};
    cn_path *path = NULL;
    double *point;
    cn_status status;

    if (spec->nwaypoint == 0) return CN_OK;
    if (!(point = malloc(3 * ((size_t)spec->nwaypoint + 1) * sizeof *point))) return CN_ERR_MEMORY;
    start_point(run, b, point);
    if (at_the_goal(spec, point)) {
        free(point);
        return CN_OK;
    }
    for (int i = 0; i < spec->nwaypoint; i++)
        stand_in(run, query.radius + spec->path.clearance, spec->waypoint + 3 * i, point + 3 * (i + 1));
    /* of a compact body the path knows only the room it asks for */
    query.device_diameter = catheter ? spec->shape.catheter.diameter : 2 * spec->path.clearance;
    query.npoint = spec->nwaypoint + 1, query.point = point;
    if (directed) query.direction = spec->shape.catheter.direction;
    if (!catheter && spec->drive.nodes == CN_NODES_EACH) query.direction = run->model->body[b].direction;
    query.nrefused = body->nrefused, query.refused = body->refused;
    query.seed = run->seed, query.seeds = run->scene->planner.seeds,
    query.samples = run->scene->planner.samples, query.budget = run->budget;
    query.threads = run->threads, query.cancel = run->hooks ? run->hooks->cancel : NULL;

    const double start = cn_seconds();
    roadmap.reproducible = true;
    const bool open = nothing_rests(run->world) && query.nrefused == 0;
    status = open ? straight_path(&path, query.npoint, point)
                  : cn_plan_path(&path, &query, run->planner, &roadmap, &run->error);
    if (status == CN_OK && !open && catheter &&
        !directed) { /* a straight start: along the chord of the first stretch */
        double *direction = spec->shape.catheter.direction;
        cn_place ahead;
        cn_path_at(path, fmin(10 * query.device_diameter, cn_path_length(path)), &ahead);
        cn_sub(ahead.x, path->x, direction);
        cn_normalise(direction);
        query.direction = direction;
        cn_path_free(path);
        path = NULL;
        cn_roadmap_clear(&roadmap);
        status = cn_plan_path(&path, &query, run->planner, &roadmap, &run->error);
    }
    run->report->time.planning_s += cn_seconds() - start;
    if (status == CN_OK && catheter) status = long_enough(run, spec, path);
    if (status == CN_OK) {
        if (!roadmap.reproducible) run->report->reproducible = false;
        meet_wishes(path, spec, point,
                    10 * (catheter ? spec->shape.catheter.diameter : 1e-2 * cn_path_length(path)));
        cn_path *bent = NULL; /* frames and lengths anew */
        status = cn_path_new(&bent, path->n, path->x, path->nwaypoint, path->waypoint, path->normal);
        if (status == CN_OK) {
            memcpy(bent->clearance, path->clearance, (size_t)path->n * sizeof(double));
            bent->turn_max = path->turn_max;
            cn_path_free(body->path);
            body->path = bent;
        }
    }
    cn_path_free(path);
    free(point);
    if (status != CN_OK) {
        if (status == CN_ERR_NO_PATH)
            for (int k = 0; k < 3; k++)
                run->report->verdict.position[k] = roadmap.pinch[k];
        cn_roadmap_clear(&roadmap);
        return status;
    }
    cn_roadmap_clear(&body->roadmap);
    body->roadmap = roadmap;
    run->report->path.length = cn_path_length(body->path);
    run->report->path.turn_max = body->path->turn_max;
    run->report->path.seed = roadmap.seed;
    run->report->path.clearance_min = INFINITY;
    for (int i = 0; i < body->path->n; i++)
        run->report->path.clearance_min = fmin(run->report->path.clearance_min, body->path->clearance[i]);
    if (run->hooks && run->hooks->path) run->hooks->path(run->hooks->user, b, body->path, &body->roadmap);
    return roadmap_lengths(body);
}

/* A copy of the state at each roadmap vertex passed; when all places are taken every second one is let go. */
void cn_run_checkpoint(cn_run_data *run, int b)
{
    cn_run_body *body = &run->body[b];
    const double s = run->state->body[b].s_goal;
    bool passed = body->ncheckpoint == 0;
    while (body->next_vertex < body->roadmap.npoint && s >= body->vertex_s[body->next_vertex])
        body->next_vertex++, passed = true;
    if (!passed) return;
    if (body->ncheckpoint == CN_CHECKPOINTS) {
        for (int i = 1; i < CN_CHECKPOINTS / 2; i++) {
            const cn_checkpoint kept = body->checkpoint[2 * i];
            body->checkpoint[2 * i] = body->checkpoint[i];
            body->checkpoint[i] = kept;
        }
        body->ncheckpoint = CN_CHECKPOINTS / 2;
    }
    cn_checkpoint *place = &body->checkpoint[body->ncheckpoint];
    if (!place->state && cn_state_new(&place->state, run->model) != CN_OK) return; /* fewer checkpoints */
    cn_state_copy(place->state, run->state);
    place->s = s;
    body->ncheckpoint++;
}

/* Arc length on the old path up to which the new one runs beside it. */
static double parting(const cn_path *old, const cn_path *new, double near)
{
    const double end = cn_path_length(new);
    double t = 0;
    for (int i = 0; i < old->n; i++) {
        cn_place place;
        t = cn_path_project(new, old->x + 3 * i, t,
                            fmin(t + 4 * near + 2 * (i ? old->s[i] - old->s[i - 1] : 0), end));
        cn_path_at(new, t, &place);
        if (cn_distance(place.x, old->x + 3 * i) > near) return old->s[i];
    }
    return cn_path_length(old);
}

cn_ball cn_run_broken_at(const cn_run_data *run, int b)
{
    const cn_path *path = run->body[b].path;
    const cn_model_body *model = &run->model->body[b];
    const double *goal = run->state->body[b].x + 3 * model->goal_node;
    cn_ball ball = {.radius = 0};
    cn_place here;
    if (!path) return ball;
    cn_path_at(path, cn_path_project(path, goal, 0, cn_path_length(path)), &here);
    cn_copy3(here.x, ball.centre);
    ball.radius = fmax(cn_world_distance(run->world, here.x, NULL, NULL, NULL), 0.5 * model->diameter);
    return ball;
}

/* How often the way to a waypoint may break just beside it: its ball can't grow over the waypoint. */
enum { TRIES_BESIDE = 2 };
static const double BESIDE = 0.9; /* of the distance to it that a ball takes */

static bool stops_at(const cn_ball *ball, const double *waypoint)
{
    return ball->radius >= (1 - 1e-9) * BESIDE * cn_distance(ball->centre, waypoint);
}

/* A break beside an earlier one doubles its ball: near-copies of a bad edge are not tried one by one. Start
 * and waypoints stay out of it, so that ways elsewhere remain. False where a waypoint itself is out of reach.
 */
static bool add_refused(cn_run_data *run, int b, const cn_ball *refused)
{
    cn_run_body *body = &run->body[b];
    const cn_body_spec *spec = &run->spec[b];
    double start[3];
    cn_ball ball = *refused;
    start_point(run, b, start);
    for (int i = 0; i < body->nrefused; i++)
        if (cn_distance(body->refused[i].centre, ball.centre) < 2 * body->refused[i].radius)
            ball.radius = fmax(ball.radius, 2 * body->refused[i].radius);
    for (int i = -1; i < spec->nwaypoint; i++) {
        const double away = cn_distance(i < 0 ? start : spec->waypoint + 3 * i, ball.centre);
        if (away > 0) ball.radius = fmin(ball.radius, BESIDE * away);
    }
    int beside = 0;
    for (int i = 0; i < spec->nwaypoint && beside <= TRIES_BESIDE; i++) {
        const double *waypoint = spec->waypoint + 3 * i;
        beside = stops_at(&ball, waypoint);
        for (int k = 0; beside && k < body->nrefused; k++)
            beside += stops_at(&body->refused[k], waypoint);
    }
    body->refused[body->nrefused++] = ball;
    return beside <= TRIES_BESIDE;
}

bool cn_run_yield(cn_run_data *run, int b, cn_ball *refused, cn_verdict *broken, cn_status *status)
{
    cn_run_body *body = &run->body[b];
    cn_body_state *state = &run->state->body[b];
    cn_meeting meeting;
    *status = CN_OK;
    if (!body->avoid || !body->path) return true;
    const int every = (int)fmax(1, floor(cn_avoid_tick(body->avoid) / run->model->dt));
    if (body->looked >= 0 && run->state->step >= body->looked && run->state->step < body->looked + every)
        return true;
    body->looked = run->state->step;
    *status = cn_avoid_look(body->avoid, state, body->path, run->state->time, &state->until, &meeting);
    if (*status != CN_ERR_NO_PATH) return *status == CN_OK;
    *status = CN_OK;
    if (cn_drive_arrived(&run->model->body[b], state)) return true;
    *refused = meeting.ball;
    *broken = (cn_verdict){.code = CN_VERDICT_LIMIT_BROKEN,
                           .has_quantity = true,
                           .quantity = CN_QUANTITY_CLEARANCE,
                           .value = meeting.distance,
                           .limit = meeting.least,
                           .element = -1,
                           .step = run->state->step,
                           .time = run->state->time,
                           .waypoint = cn_run_waypoint(run, run->state, b)};
    cn_copy3(meeting.x, broken->position);
    snprintf(broken->body, sizeof broken->body, "%s", run->spec[b].name);
    snprintf(broken->message, sizeof broken->message,
             "%s comes as near to %s as %.4g m, limit %.4g m, at [%.4f %.4f %.4f] m, t = %.3f s, whether it "
             "goes on, waits or turns back on its path at t = %.3f s",
             run->world->wall[meeting.wall].name, broken->body, meeting.distance, meeting.least, meeting.x[0],
             meeting.x[1], meeting.x[2], meeting.time, run->state->time);
    return false;
}

cn_status cn_run_replan(cn_run_data *run, int b, const cn_ball *refused)
{
    cn_run_body *body = &run->body[b];
    const cn_model_body *model = &run->model->body[b];
    cn_path *old = NULL;
    cn_status status;

    if (!run->world->map) return CN_ERR_NO_PATH; /* nothing to go around */

    if (body->nrefused == body->refused_capacity) {
        const int capacity = 2 * body->refused_capacity + 8;
        cn_ball *more = realloc(body->refused, (size_t)capacity * sizeof *more);
        if (!more) return CN_ERR_MEMORY;
        body->refused = more, body->refused_capacity = capacity;
    }
    if (!add_refused(run, b, refused)) return CN_ERR_NO_PATH;
    body->looked = -1;
    if ((status = cn_path_copy(&old, body->path)) != CN_OK) return status;
    if ((status = cn_run_plan_body(run, b)) == CN_OK) {
        const double s = parting(old, body->path, fmax(model->diameter, 4 * cn_map_cell(run->world->map)));
        int at = body->ncheckpoint - 1;
        while (at > 0 && body->checkpoint[at].s > s)
            at--;
        body->ncheckpoint = at + 1;
        cn_body_state *state = &run->state->body[b];
        const cn_body_state *there = &body->checkpoint[at].state->body[b];
        if (run->spec[b].drive.mode == CN_DRIVE_PUSH)
            cn_push_back(state, there->inserted);
        else
            cn_state_copy(run->state, body->checkpoint[at].state);
        state->progress = -INFINITY, state->progress_time = run->state->time;
        state->s_goal =
            cn_path_project(body->path, there->x + 3 * model->goal_node, 0, cn_path_length(body->path));
        while (body->next_vertex < body->roadmap.npoint && body->vertex_s[body->next_vertex] <= state->s_goal)
            body->next_vertex++;
    }
    cn_path_free(old);
    return status;
}
