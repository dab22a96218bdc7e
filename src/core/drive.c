/* drive.c - the follow drive: path-following and goal-seeking forces (Moss, Lin, Manocha 2008, section 4.2).
 *
 * All forces are accelerations times nodal mass, so that refining a mesh does not change their sum. Gains
 * come from the scene's own scales. Full weight w: speed / dt, which turns the drive's own speed round in one
 * step, and for a beam the geometric mean of two accelerations: EI kappa / (mass per length d^2), which bends
 * the device (as stiff as its mesh has it) to the path's curvature kappa within a diameter, and lookahead /
 * dt^2, which makes a lookahead in a step. So a stiffer device is driven harder, but not in proportion: it
 * leans on the wall more.
 *
 * Path following: zero up to path_distance, linear to w at twice that.
 *
 * Goal seeking: w (share - v / speed) along the path; share is the spring k (L - L_rest) over its value at
 * the lookahead, v / speed its damping: full force on a body that is stopped, none on one that runs at the
 * drive's speed. Near a waypoint the spring's part across the path counts too. */
#include "sim.h"

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"

double cn_drive_lookahead(const cn_model_body *body)
{
    const cn_drive_spec *drive = &body->spec->drive;
    const double run = 10 * drive->speed * body->tick, near = 4 * drive->path_distance;
    return run > near ? run : near;
}

/* Arc length of the place nearest to x, beyond the path's end along its last tangent. */
static double project(const cn_path *path, const double x[3], double low, double high)
{
    const double end = cn_path_length(path), s = cn_path_project(path, x, low, high);
    double past[3];
    if (s < end) return s;
    cn_sub(x, path->x + 3 * (path->n - 1), past);
    return end + fmax(0, cn_dot(past, path->tangent + 3 * (path->n - 1)));
}

double cn_drive_aim(const cn_model_body *body, const cn_body_state *state, const cn_path *path)
{
    const int next = state->waypoint < path->nwaypoint ? state->waypoint : path->nwaypoint - 1;
    const double s = path->s[path->waypoint[next]], end = cn_path_length(path);
    return fmin(state->until, state->s_goal > s + body->spec->waypoint_tolerance ? s : end);
}

/* Unit vector from the place s on the path to the milestone a lookahead farther, and the share of the full
 * speed to go there with: k (L - L_rest), L the way left along the path, over its value at the lookahead.
 * Backwards when the target lies behind. */
static double goal_seeking(const cn_model_body *body, const cn_path *path, double s, double target,
                           double to[3])
{
    const double far = cn_drive_lookahead(body), left = target - s, rest = body->spec->drive.rest_length;
    cn_place here, ahead;
    cn_path_at(path, s, &here);
    cn_path_at(path, s + far, &ahead);
    cn_sub(ahead.x, here.x, to);
    cn_normalise(to);
    const double stretch = left >= 0 ? fmax(left - rest, 0) : left;
    return stretch > far ? 1 : stretch < -far ? -1 : stretch / far;
}

static double full_weight(const cn_model_body *body, double curvature)
{
    const double bend =
        body->diameter > 0 ? body->bending * curvature / (body->diameter * body->diameter) : 0;
    return body->spec->drive.speed / body->tick + sqrt(bend * cn_drive_lookahead(body)) / body->tick;
}

static void prepare_each(const cn_model_body *body, const cn_body_state *state, const cn_path *path,
                         double dt, cn_drive *drive)
{
    const double target = cn_drive_aim(body, state, path),
                 margin = 2 * body->diameter + 0.5 * cn_drive_lookahead(body);
    const double speed = body->spec->drive.speed;
    const int group = body->catheter ? body->per_section : 1;
    /* near a waypoint the leading end is steered as in a bend of 20 diameters, so that it meets its tolerance
     */
    const bool arriving =
        body->diameter > 0 && state->waypoint < path->nwaypoint &&
        fabs(path->s[path->waypoint[state->waypoint]] - state->s_goal) < 2 * cn_drive_lookahead(body);
    double s = state->s_goal, last = 0;

    for (int first = 0; first < state->nfree; first += group) {
        cn_place place;
        double to[3];
        const double behind = body->behind[first];
        if (body->catheter) { /* each station has its own nearest place, near where the material says */
            s -= first ? behind - last : 0;
            s = project(path, state->x + 3 * first, s - margin, s + margin);
            last = behind;
        } else {
            s = state->s_goal - behind;
        }
        cn_path_at(path, s, &place);
        const bool leads = arriving && behind < 20 * body->diameter;
        const double full =
            full_weight(body, leads ? fmax(place.curvature, 0.05 / body->diameter) : place.curvature);
        const double share = goal_seeking(body, path, s, target - behind, to);
        for (int i = first; i < first + group && i < state->nfree; i++) {
            const double mass = body->body->mass[i];
            for (int k = 0; k < 3; k++) {
                const double beside =
                    body->catheter ? state->x[3 * i + k] - state->x[3 * first + k]
                                   : body->offset[2 * i] * place.n[k] + body->offset[2 * i + 1] * place.b[k];
                drive->centre[3 * i + k] = place.x[k] + beside;
                drive->tangent[3 * i + k] = place.t[k];
                drive->towards[3 * i + k] = to[k];
            }
            drive->weight[i] = mass * full;
            drive->lead[i] = share * speed * dt;
            drive->pull[i] = mass * full / (speed * dt);
            drive->hold[i] = leads ? mass * full / cn_drive_lookahead(body) : 0;
        }
    }
    drive->from = state->x;
}

static void prepare_uniform(const cn_model_body *body, const cn_body_state *state, const cn_path *path,
                            cn_drive *drive)
{
    const double *x = state->x + 3 * body->goal_node, *v = state->v + 3 * body->goal_node;
    cn_place place;
    double a[3], to[3], away[3];
    cn_path_at(path, state->s_goal, &place);
    const double share = goal_seeking(body, path, state->s_goal, cn_drive_aim(body, state, path), to);
    for (int k = 0; k < 3; k++) /* half the difference to the wished speed in a step */
        a[k] = 0.5 / body->tick * (share * body->spec->drive.speed * to[k] - v[k]);
    cn_sub(x, place.x, away);
    cn_axpy(-cn_dot(away, place.t), place.t, away);
    const double r = cn_normalise(away), near = drive->distance;
    const double ramp = r <= near ? 0 : r >= 2 * near ? 1 : (r - near) / near;
    cn_axpy(-ramp * full_weight(body, place.curvature), away, a);
    for (int i = 0; i < body->ncontrol; i++)
        if (body->control[i] < state->nfree)
            for (int k = 0; k < 3; k++)
                drive->force[3 * body->control[i] + k] = body->body->mass[body->control[i]] * a[k];
}

void cn_drive_prepare(const cn_model_body *body, const cn_body_state *state, const cn_path *path, double dt,
                      cn_drive *drive)
{
    const size_t n = (size_t)body->body->nnode;
    memset(drive->force, 0, 3 * n * sizeof *drive->force);
    memset(drive->weight, 0, n * sizeof *drive->weight);
    memset(drive->pull, 0, n * sizeof *drive->pull);
    memset(drive->hold, 0, n * sizeof *drive->hold);
    drive->distance = body->spec->drive.path_distance;
    drive->advance = drive->turn = 0, drive->bend = cn_push_bent(body, state), drive->nfree = state->nfree;
    if (!path) return;
    if (body->spec->drive.mode == CN_DRIVE_PUSH) {
        cn_push_prepare(body, state, path, dt, drive);
        return;
    }
    if (body->spec->drive.nodes == CN_NODES_EACH)
        prepare_each(body, state, path, dt, drive);
    else
        prepare_uniform(body, state, path, drive);
    if (body->sheath) { /* the base runs at the drive's speed, slower over the last stretch */
        const double ahead = cn_drive_aim(body, state, path) - state->s_goal, far = cn_drive_lookahead(body);
        const double left = ahead >= 0 ? fmax(ahead - body->spec->drive.rest_length, 0) : ahead;
        const double share = left > far ? 1 : left < -far ? -1 : left / far;
        drive->advance = share * body->spec->drive.speed * dt;
        if (state->inserted + drive->advance < 0) drive->advance = -state->inserted;
    }
}

/* Towards the milestone: full (share - v / speed) = - pull (d - lead), d the way made in the step. */
static double add_seeking(const cn_drive *drive, int i, const double *x, double *f, double scale,
                          cn_matrix *a)
{
    const double *to = drive->towards + 3 * i;
    double moved[3];
    cn_sub(x + 3 * i, drive->from + 3 * i, moved);
    const double over = cn_dot(moved, to) - drive->lead[i];
    if (f) cn_axpy(-drive->pull[i] * over, to, f + 3 * i);
    for (int k = 0; a && k < 9; k++)
        a->value[9 * (size_t)a->diagonal[i] + (size_t)k] += scale * drive->pull[i] * to[k / 3] * to[k % 3];
    return 0.5 * drive->pull[i] * over * over;
}

static double add_following(const cn_drive *drive, int i, const double *x, double *f, double scale,
                            cn_matrix *a)
{
    const double near = drive->distance, w = drive->weight[i], *t = drive->tangent + 3 * i;
    double away[3];
    cn_sub(x + 3 * i, drive->centre + 3 * i, away);
    cn_axpy(-cn_dot(away, t), t, away);
    const double r = cn_normalise(away), k = drive->hold[i];
    if (r <= near && !(k > 0 && r > 0)) return 0;
    const bool full = r >= 2 * near, none = r <= near;
    const double follow = none ? 0 : full ? w : w * (r - near) / near; /* d energy / d r */
    const double force = follow + k * r;
    if (f) cn_axpy(-force, away, f + 3 * i);
    if (a) {
        const double radial = (full || none ? 0 : w / near) + k, across = force / r;
        double *block = a->value + 9 * (size_t)a->diagonal[i];
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++)
                block[3 * p + q] += scale * (radial * away[p] * away[q] +
                                             across * ((p == q) - t[p] * t[q] - away[p] * away[q]));
    }
    const double way = none ? 0 : full ? w * (r - 1.5 * near) : 0.5 * w * (r - near) * (r - near) / near;
    return way + 0.5 * k * r * r;
}

double cn_drive_add(const cn_drive *drive, int nfree, const double *x, double *f, double scale, cn_matrix *a)
{
    double energy = 0;
    for (int i = 0; i < nfree; i++) {
        if (drive->pull[i] > 0) energy += add_seeking(drive, i, x, f, scale, a);
        if (drive->weight[i] > 0) energy += add_following(drive, i, x, f, scale, a);
    }
    return energy;
}

/* The goal-seeking force left at this distance from the waypoint [N]: what force_threshold bounds. */
static double force_left(const cn_model_body *body, const cn_body_state *state, const cn_path *path,
                         double miss)
{
    cn_place place = {.curvature = 0};
    if (path) cn_path_at(path, state->s_goal, &place);
    return body->body->mass[body->goal_node] * full_weight(body, place.curvature) *
           fmin(1, miss / cn_drive_lookahead(body));
}

void cn_drive_progress(const cn_model_body *body, cn_body_state *state, const cn_path *path)
{
    const cn_drive_spec *drive = &body->spec->drive;
    const double *goal = state->x + 3 * body->goal_node;
    const double near = 4 * cn_drive_lookahead(body);
    if (path) state->s_goal = project(path, goal, state->s_goal - near, state->s_goal + near);
    while (state->waypoint < body->spec->nwaypoint) {
        const double *q = body->spec->waypoint + 3 * state->waypoint;
        const double miss = fabs(cn_distance(goal, q) - drive->rest_length);
        if (!(miss <= body->spec->waypoint_tolerance)) break;
        if (drive->mode == CN_DRIVE_FOLLOW && drive->force_threshold >= 0 &&
            force_left(body, state, path, miss) > drive->force_threshold)
            break;
        if (state->waypoint == body->spec->nwaypoint - 1 &&
            !(cn_norm(state->v + 3 * body->goal_node) <= 0.1 * drive->speed))
            break;
        state->waypoint++;
    }
    if (path && drive->mode == CN_DRIVE_PUSH) cn_push_progress(body, state, path);
}

bool cn_drive_arrived(const cn_model_body *body, const cn_body_state *state)
{
    return body->spec->nwaypoint > 0 && state->waypoint >= body->spec->nwaypoint;
}

void cn_axis_points(const cn_model_body *body, const cn_body_state *state, int *naxis, double *axis)
{
    *naxis = 0;
    if (!body->catheter) return;
    for (int first = 0; first < state->nfree; first += body->per_section) {
        double *p = axis + 3 * (*naxis)++;
        p[0] = p[1] = p[2] = 0;
        for (int i = first; i < first + body->per_section; i++)
            cn_axpy(1.0 / body->per_section, state->x + 3 * i, p);
    }
}
