/* drive_push.c - the push drive, the clinician's: the base is advanced and turned through the sheath, nothing
 * pulls the free part.
 *
 * Advance: at the drive's speed, slower over the last stretch, where the steered end points elsewhere, and
 * near a limit. Turn: the pre-bent end deflects towards n of its root's frame, as that is now, whatever of
 * the base's turn has arrived there; seen from the root, along its heading u, the path ahead lies towards d.
 * The base turns at a rate in proportion to the angle from n to d (a tenth of it in a tick), held back where
 * the shaft is wound up by half a turn. An end that points elsewhere is turned before it goes on. One that
 * has strayed (a wall hides its place on the path from it), no longer follows its base, or is about to break
 * a limit is drawn back, turned, and tried again, a bounded number of times on a stretch of its own length;
 * the tries aim more and more to the sides of d. Then the limits decide, `progress` among them.
 *
 * A steered end begins straight; the curvature that it has at rest is what changes, as if wires in it did it,
 * to either side of n. It is that of the arc from the root, along u, to the path ahead: 2 sin(a) / r, a
 * between u and the chord, r the chord's length (pure pursuit, Coulter 1992), or what turns the tip into the
 * path's direction, whichever is more, as far as it lies in the plane of n; the base turns the plane. Drawn
 * back past a mouth that it missed it is bent fully: so it hooks into it, and goes on from there. */
#include "sim.h"

#include <math.h>
#include "catnav/vec3.h"
#include "polar.h"

enum { TRIES = 8 }; /* on one stretch */
static const double pi = 3.14159265358979323846, most_turning = 4 * 3.14159265358979323846; /* for one try */
static const double time_to_bend = 0.5; /* of a steered end, from straight to its full curvature [s] */

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* A section of the catheter: its centre, n and heading towards the tip. */
typedef struct {
    double x[3], n[3], u[3];
} section;

/* What the end is to do. */
typedef struct {
    double angle;  /* by which it has to turn [rad] */
    double weight; /* 0: that does not matter, up to 1 */
    double bend;   /* of a steered end, wanted (cn_push_bent) */
} aim;

static void section_at(const cn_model_body *body, const cn_body_state *state, int first, section *out)
{
    const int per = body->per_section;
    *out = (section){0};
    for (int i = first; i < first + per; i++)
        cn_axpy(1.0 / per, state->x + 3 * i, out->x);
    if (body->body->nblock > body->body->nnode) {
        double r[9];
        cn_quaternion_matrix(state->rotation + 4 * (size_t)first, r);
        for (int k = 0; k < 3; k++)
            out->n[k] = r[3 * k], out->u[k] = -r[3 * k + 2];
        return;
    }
    double b[3] = {0};
    for (int i = first; i < first + per; i++) {
        double arm[3];
        cn_sub(state->x + 3 * i, out->x, arm);
        cn_axpy(body->offset[2 * i], arm, out->n), cn_axpy(body->offset[2 * i + 1], arm, b);
    }
    cn_normalise(out->n), cn_normalise(b);
    cn_cross(out->n, b, out->u);
    cn_normalise(out->u);
}

/* Angle from a to b about u. */
static double angle_about(const double u[3], const double a[3], const double b[3])
{
    double c[3];
    cn_cross(a, b, c);
    return atan2(cn_dot(c, u), cn_dot(a, b) - cn_dot(a, u) * cn_dot(b, u));
}

/* First node of the section `behind` the tip, but of none deeper in the sheath than the first one there. */
static int section_behind(const cn_model_body *body, const cn_body_state *state, double behind)
{
    const int last = body->body->nnode - body->per_section;
    int first = 0;
    while (first < last && first < state->nfree && body->behind[first] < behind)
        first += body->per_section;
    return first;
}

/* By how much the base is turned ahead of the end. */
static double wound(const cn_model_body *body, const cn_body_state *state)
{
    section a, b;
    double angle = 0;
    section_at(body, state, 0, &a);
    for (int i = body->per_section; i <= state->nfree && i < body->body->nnode;
         i += body->per_section, a = b) {
        section_at(body, state, i, &b);
        angle += angle_about(b.u, a.n, b.n);
    }
    return angle;
}

static double bend_length(const cn_model_body *body)
{
    return body->spec->drive.bend_curvature > 0 ? body->spec->drive.bend_length : 0;
}

/* A stretch on which tries are counted, and by which it draws back. */
static double stretch_of(const cn_model_body *body)
{
    return fmax(bend_length(body), 4 * body->diameter);
}

/* Where the way leads from, seen by the end, and to, over its length and as much again: along the path; close
 * to a waypoint, and for a steered end, from the root. */
static void way_ahead(const cn_model_body *body, const cn_body_state *state, const cn_path *path,
                      const section *root, double from[3], double to[3])
{
    const double look = bend_length(body);
    const int next = state->waypoint < path->nwaypoint ? state->waypoint : path->nwaypoint - 1;
    const bool near = fabs(path->s[path->waypoint[next]] - state->s_goal) < look;
    cn_place place;
    cn_path_at(path, state->s_goal - look, &place);
    cn_copy3(near || body->spec->drive.bend_steered ? root->x : place.x, from);
    cn_path_at(path, state->s_goal + look, &place);
    cn_copy3(near ? body->spec->waypoint + 3 * next : place.x, to);
}

/* Side of d that a try aims at: d itself, then more and more to either side. */
static double side_of(int tries, bool steered)
{
    const int k = tries > 1 ? tries - 1 : 0;
    return (k % 2 ? 1 : -1) * (steered ? 0.08 : 0.25) * pi * ((k + 1) / 2);
}

/* A steered end bends away from n as well as towards it: whichever it does now, unless the other is nearer by
 * far. */
static void aim_steered(const cn_model_body *body, const cn_body_state *state, const cn_path *path,
                        const section *root, double chord, double side, aim *a)
{
    const double length = bend_length(body), full = body->spec->drive.bend_curvature;
    cn_place ahead;
    cn_path_at(path, state->s_goal + 0.5 * length, &ahead);
    const double turn = acos(clamp(cn_dot(ahead.t, root->u), -1, 1));
    const double bend = fmax(2 * side / chord, turn / length) / full;
    double sense = cn_push_bent(body, state) < 0 ? -1 : 1;
    if (sense * cos(a->angle) < -0.3) sense = -sense;
    if (sense < 0) a->angle = remainder(a->angle + pi, 2 * pi);
    a->weight = fmin(1, 4 * bend);
    const bool hooks = state->push.phase == CN_PUSH_BACK; /* falls into the mouth that it is drawn past */
    a->bend = sense * (hooks ? 1 : fmin(bend, 1)) * fmax(cos(a->angle), 0);
}

static aim steering(const cn_model_body *body, const cn_body_state *state, const cn_path *path)
{
    section root;
    double from[3], to[3], d[3];
    aim a = {0};
    if (!(bend_length(body) > 0)) return a;
    section_at(body, state, section_behind(body, state, bend_length(body)), &root);
    way_ahead(body, state, path, &root, from, to);
    cn_sub(to, from, d);
    const double chord = cn_normalise(d);
    if (state->push.tries > 0) cn_axpy(-0.3, state->push.strayed, d);
    const double ahead = cn_dot(d, root.u);
    cn_axpy(-ahead, root.u, d);
    a.weight = fmin(1, 10 * cn_norm(d));
    a.angle = remainder(
        angle_about(root.u, root.n, d) + side_of(state->push.tries, body->spec->drive.bend_steered), 2 * pi);
    if (body->spec->drive.bend_steered)
        aim_steered(body, state, path, &root, chord, ahead > 0 ? cn_norm(d) : 1, &a);
    else if (fabs(a.angle) > pi / 2 && a.angle * state->push.sense < 0)
        a.angle += 2 * pi * state->push.sense;
    return a;
}

cn_status cn_push_check(const cn_body_spec *spec, bool sheath, cn_error *error)
{
    const cn_drive_spec *drive = &spec->drive;
    const double length = drive->bend_length, curvature = drive->bend_curvature;
    if (drive->mode != CN_DRIVE_PUSH) return CN_OK;
    if (spec->shape.kind != CN_SHAPE_CATHETER || !sheath)
        return cn_fail(
            error, CN_FAULT_UNSUITED, NULL, 0,
            "%s: drive mode push moves the base of a catheter through its sheath: give it a catheter's "
            "shape with `sheath: on`, or use mode: follow",
            spec->name);
    const double device = spec->shape.catheter.length, spacing = device / (spec->shape.catheter.stations - 1);
    if ((length > 0) != (curvature > 0))
        return cn_fail(error, CN_FAULT_NEEDED, NULL, 0,
                       "%s: drive.tip_bend has length %g m and curvature %g 1/m: give both, or neither",
                       spec->name, length, curvature);
    if (drive->bend_steered && spec->model != CN_BODY_ROD)
        return cn_fail(error, CN_FAULT_UNSUITED, NULL, 0,
                       "%s: drive.tip_bend is steered: that takes the model rod; `steered: off` gives "
                       "tetrahedra a pre-bent end",
                       spec->name);
    if (!(length < device))
        return cn_fail(error, CN_FAULT_AT_ODDS, NULL, 0,
                       "%s: drive.tip_bend is %g m long, the catheter itself %g m: bend less of it",
                       spec->name, length, device);
    if (!(length * curvature <= pi))
        return cn_fail(
            error, CN_FAULT_AT_ODDS, NULL, 0,
            "%s: drive.tip_bend turns by %g rad (length %g m, curvature %g 1/m): at most %g, half a "
            "circle",
            spec->name, length * curvature, length, curvature, pi);
    if (!(curvature * spacing <= 0.5))
        return cn_fail(
            error, CN_FAULT_AT_ODDS, NULL, 0,
            "%s: drive.tip_bend turns by %g rad from one station to the next: at most 0.5; give the "
            "catheter more stations",
            spec->name, curvature * spacing);
    if (!(curvature * spec->shape.catheter.diameter <= 1))
        return cn_fail(error, CN_FAULT_AT_ODDS, NULL, 0,
                       "%s: drive.tip_bend has a radius of %g m, less than the catheter's diameter, %g m",
                       spec->name, 1 / curvature, spec->shape.catheter.diameter);
    return CN_OK;
}

void cn_push_prepare(const cn_model_body *body, const cn_body_state *state, const cn_path *path, double dt,
                     cn_drive *drive)
{
    const cn_drive_spec *spec = &body->spec->drive;
    const cn_push *push = &state->push;
    const double most = spec->advance_max * dt, ahead = cn_drive_aim(body, state, path) - state->s_goal;
    const double left = ahead >= 0 ? fmax(ahead - spec->rest_length, 0) : ahead;
    const double last = body->behind[body->body->nnode - 1]; /* its end stays in the sheath */
    const aim to = steering(body, state, path);
    const double lacks = to.bend - drive->bend;
    const double slower = (1 - 0.5 * to.weight * (1 - cos(to.angle))) *
                          clamp(1.2 - 2 * fabs(lacks), 0.05, 1) * clamp(5 * (push->margin - 0.05), 0.1, 1);
    double advance = clamp(left / cn_drive_lookahead(body), -1, slower) * spec->speed * dt;

    if (push->phase == CN_PUSH_TURN) advance = 0;
    if (push->phase == CN_PUSH_BACK) advance = spec->bend_steered ? -0.4 * most : -most;
    advance = clamp(advance, -most, most);
    drive->advance = clamp(state->inserted + advance, 0, fmax(last, state->inserted)) - state->inserted;
    drive->advance = clamp(drive->advance, -most, most); /* also after rounding */
    if (drive->advance < 0) {
        const int out = cn_sheath_out(body, state->inserted + drive->advance);
        drive->nfree = out < state->nfree ? out : state->nfree;
    }
    drive->bend += clamp(lacks, -dt / time_to_bend, dt / time_to_bend);
    if (push->phase == CN_PUSH_BACK && !spec->bend_steered) return;
    drive->turn =
        clamp(to.weight * to.angle * dt / (10 * body->tick), -spec->twist_max * dt, spec->twist_max * dt);
    if (drive->turn == 0) return;
    const double wind = wound(body, state);
    if (fabs(wind) > pi && wind * drive->turn > 0) drive->turn = 0;
}

static bool is_steered(const cn_model_body *body)
{
    return body->spec->drive.mode == CN_DRIVE_PUSH && body->spec->drive.bend_steered;
}

double cn_push_bent(const cn_model_body *body, const cn_body_state *state)
{
    return is_steered(body) ? state->rotation[4 * (size_t)body->body->nnode] : 0;
}

void cn_push_bend(const cn_model_body *body, cn_body_state *state, double bend)
{
    if (is_steered(body)) state->rotation[4 * (size_t)body->body->nnode] = bend;
}

void cn_push_back(cn_body_state *state, double inserted)
{
    state->push.phase = CN_PUSH_BACK, state->push.until = inserted;
    state->push.best = state->push.mark = -INFINITY, state->push.tries = 0;
    state->push.turned = 0;
}

/* Draws back by `way` or more, as far as it takes; it will shun the side it is on now. */
static void try_again(const cn_model_body *body, cn_body_state *state, const cn_path *path, double way)
{
    cn_push *push = &state->push;
    cn_place here;
    cn_path_at(path, state->s_goal, &here);
    cn_sub(state->x + 3 * body->goal_node, here.x, push->strayed);
    cn_normalise(push->strayed);
    push->strayed_at = state->s_goal;
    push->phase = CN_PUSH_BACK, push->tries++;
    push->mark = fmax(push->mark, push->best);
    push->until = fmax(0, state->inserted - way);
}

/* A steered end that is drawn back has slid into the way: it is on the path, and points along it. */
static bool caught(const cn_model_body *body, const cn_body_state *state, const cn_path *path)
{
    section tip;
    cn_place here;
    section_at(body, state, 0, &tip);
    cn_path_at(path, state->s_goal, &here);
    return !state->push.hidden && state->s_goal > state->push.strayed_at + 2 * body->diameter &&
           cn_distance(tip.x, here.x) < 1.5 * body->diameter && cn_dot(tip.u, here.t) > 0.7;
}

void cn_push_progress(const cn_model_body *body, cn_body_state *state, const cn_path *path)
{
    const double stretch = stretch_of(body);
    cn_push *push = &state->push;
    const aim to = steering(body, state, path);
    const double angle = to.angle;
    const bool turns = to.weight > 0.5 && push->turned < most_turning;

    if (state->s_goal > push->best + 0.1 * body->spec->waypoint_tolerance)
        push->best = state->s_goal, push->best_at = state->inserted;
    if (push->best > push->mark + stretch && !push->hidden)
        push->mark = push->best, push->tries = 0, push->turned = 0;
    if (fabs(angle) < pi / 2 || push->sense == 0) push->sense = angle < 0 ? -1 : 1;
    const int next = state->waypoint < path->nwaypoint ? state->waypoint : path->nwaypoint - 1;
    const double past = state->s_goal - path->s[path->waypoint[next]], near = body->spec->waypoint_tolerance;
    const bool missed =
        state->waypoint < path->nwaypoint &&
        (past > near || (next == path->nwaypoint - 1 && fabs(past) < 0.1 * near &&
                         cn_norm(state->v + 3 * body->goal_node) < 0.1 * body->spec->drive.speed));
    switch (push->phase) {
    case CN_PUSH_ADVANCE:
        if (push->tries < TRIES &&
            (missed || push->hidden || push->margin < 0.05 || state->inserted - push->best_at > stretch))
            try_again(body, state, path, stretch * (1 + push->tries / 2));
        else if (turns && fabs(angle) > pi / 3)
            push->phase = CN_PUSH_TURN;
        break;
    case CN_PUSH_TURN:
        if (!turns || fabs(angle) < pi / 9)
            push->phase = CN_PUSH_ADVANCE, push->best_at = state->inserted;
        else if (fabs(wound(body, state)) > pi && push->tries < TRIES)
            try_again(body, state, path, stretch);
        else if (fabs(wound(body, state)) > pi)
            push->phase = CN_PUSH_ADVANCE, push->turned = most_turning;
        break;
    case CN_PUSH_BACK:
        if (body->spec->drive.bend_steered && caught(body, state, path)) {
            push->phase = CN_PUSH_ADVANCE, push->best = state->s_goal, push->best_at = state->inserted;
            break;
        }
        if (state->inserted > 0 && (state->inserted > push->until || push->hidden)) break;
        push->phase = CN_PUSH_TURN, push->turned = 0;
        push->best = state->s_goal, push->best_at = state->inserted;
    }
}

bool cn_push_busy(const cn_model_body *body, const cn_body_state *state)
{
    return body->spec->drive.mode == CN_DRIVE_PUSH && state->push.phase != CN_PUSH_ADVANCE;
}
