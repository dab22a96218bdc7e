/* body_wall_turn.c - walls whose triangles turn: strain from U of F = R U in the triangle's plane (3 x 2),
 * its curvature of displacements rotated back by R. Force is minus the gradient of that energy: an isotropic
 * stress s(U) commutes with U, hence dE/dF = R s; the turning of R adds the moment of the curvature's forces.
 */
#include "body_wall.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include "catnav/vec3.h"

/* U = (C + sqrt(det C)) / sqrt(tr C + 2 sqrt(det C)), C = F'F (Hoger and Carlson 1984). */
void cn_sheet_polar(const cn_body *body, int t, const double *x, cn_sheet_frame *out)
{
    const double *plane = ((const cn_sheet *)body->own)->plane + 12 * (size_t)t, *grad = plane + 6;
    const int *c = body->boundary->tri + 3 * (size_t)t;
    double f[2][3] = {{0}}, *r = out->now;
    for (int a = 1; a < 3; a++) {
        double side[3];
        cn_sub(x + 3 * (size_t)c[a], x + 3 * (size_t)c[0], side);
        for (int j = 0; j < 2; j++)
            cn_axpy(grad[2 * a + j], side, f[j]);
    }
    const double c00 = cn_norm2(f[0]), c11 = cn_norm2(f[1]), c01 = cn_dot(f[0], f[1]);
    /* a triangle without an area has no plane: as if it had a millionth of what it could have */
    const double det = fmax(c00 * c11 - c01 * c01, 1e-12 * (c00 + c11) * (c00 + c11) + DBL_MIN);
    const double root = sqrt(det), trace = sqrt(c00 + c11 + 2 * root);
    out->u[0] = (c00 + root) / trace, out->u[1] = (c11 + root) / trace, out->u[2] = c01 / trace;
    const double size = out->u[0] * out->u[1] - out->u[2] * out->u[2];
    out->inverse[0] = out->u[1] / size, out->inverse[1] = out->u[0] / size,
    out->inverse[2] = -out->u[2] / size;
    for (int k = 0; k < 3; k++) {
        r[k] = f[0][k] * out->inverse[0] + f[1][k] * out->inverse[2];
        r[3 + k] = f[0][k] * out->inverse[2] + f[1][k] * out->inverse[1];
    }
    cn_cross(r, r + 3, r + 6);
    memcpy(out->rest, plane, 6 * sizeof(double));
    cn_cross(out->rest, out->rest + 3, out->rest + 6);
}

/* out = sum_k to_k (from_k . v), rows of from and to: axes. */
static void turned(const double from[9], const double to[9], const double v[3], double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int k = 0; k < 3; k++)
        cn_axpy(cn_dot(from + 3 * k, v), to + 3 * k, out);
}

void cn_sheet_strain(const cn_body *body, int t, const double *x, const cn_sheet_frame *frame,
                     double strain[3], double curvature[3])
{
    const cn_sheet *sheet = body->own;
    const int *node = body->connect + (size_t)body->nper * (size_t)t;
    strain[0] = frame->u[0] - 1, strain[1] = frame->u[1] - 1, strain[2] = 2 * frame->u[2];
    curvature[0] = curvature[1] = curvature[2] = 0;
    if (!sheet->curvature) return;
    const double *b = sheet->curvature + 9 * CN_SHELL_NODES * (size_t)t;
    for (int a = 1; a < CN_SHELL_NODES; a++) {
        double side[3], before[3], back[3];
        cn_sub(x + 3 * (size_t)node[a], x + 3 * (size_t)node[0], side);
        cn_sub(body->rest + 3 * (size_t)node[a], body->rest + 3 * (size_t)node[0], before);
        turned(frame->now, frame->rest, side, back);
        cn_sub(back, before, back);
        for (int r = 0; r < 3; r++)
            curvature[r] += cn_dot(b + 3 * CN_SHELL_NODES * r + 3 * a, back);
    }
}

/* Energy of a triangle's curvature; the forces of its moments m, on the nodes and by the turning of R. */
static double bend(const cn_body *body, int t, const double *x, double *f)
{
    const cn_sheet *sheet = body->own;
    const int *node = body->connect + (size_t)body->nper * (size_t)t;
    const double *b = sheet->curvature + 9 * CN_SHELL_NODES * (size_t)t,
                 *grad = sheet->plane + 12 * (size_t)t + 6;
    const double nu = sheet->poisson, h = sheet->thickness;
    const double plate = sheet->young / (1 - nu * nu) * sheet->area[t] * h * h * h / 12;
    cn_sheet_frame at, *frame = &at;
    double strain[3], k[3], moment[3] = {0}, local[3];
    cn_sheet_polar(body, t, x, frame);
    cn_sheet_strain(body, t, x, frame, strain, k);
    const double m[3] = {plate * (k[0] + nu * k[1]), plate * (k[1] + nu * k[0]), plate * (1 - nu) / 2 * k[2]};
    const double energy = 0.5 * cn_dot(m, k);
    if (!f) return energy;
    for (int a = 1; a < CN_SHELL_NODES; a++) {
        double pull[3] = {0}, force[3], side[3], back[3], arm[3];
        for (int r = 0; r < 3; r++)
            cn_axpy(m[r], b + 3 * CN_SHELL_NODES * r + 3 * a, pull);
        cn_sub(x + 3 * (size_t)node[a], x + 3 * (size_t)node[0], side);
        turned(frame->now, frame->rest, side, back);
        cn_cross(back, pull, arm);
        cn_add(moment, arm, moment);
        turned(frame->rest, frame->now, pull, force);
        cn_axpy(-1, force, f + 3 * (size_t)node[a]);
        cn_add(f + 3 * (size_t)node[0], force, f + 3 * (size_t)node[0]);
    }
    for (int i = 0; i < 3; i++)
        local[i] = cn_dot(frame->rest + 3 * i, moment);
    /* dE = - w . moment, w by the corners' motion: across the plane (-w1, w0) U = n . dF, in it w2 tr U */
    const double *i = frame->inverse, spin = local[2] / (frame->u[0] + frame->u[1]);
    const double across[2] = {-i[0] * local[1] + i[2] * local[0], -i[2] * local[1] + i[1] * local[0]};
    for (int a = 0; a < 3; a++) {
        double *to = f + 3 * (size_t)body->boundary->tri[3 * (size_t)t + (size_t)a];
        const double *g = grad + 2 * a;
        cn_axpy(across[0] * g[0] + across[1] * g[1], frame->now + 6, to);
        cn_axpy(spin * g[0], frame->now + 3, to);
        cn_axpy(-spin * g[1], frame->now, to);
    }
    return energy;
}

typedef struct {
    const cn_body *body;
    const double *x;
    double *f; /* NULL: energy alone */
    int begin, end;
    double energy[CN_SHEET_TASKS];
} turned_job;

/* Batches of triangles that share no node; of the last colour, which may, they follow each other. */
static void turned_task(void *user, int task)
{
    turned_job *job = user;
    const cn_sheet *sheet = job->body->own;
    const long long n = job->end - job->begin;
    const int begin = job->begin + (int)(n * task / CN_SHEET_TASKS),
              end = job->begin + (int)(n * (task + 1) / CN_SHEET_TASKS);
    job->energy[task] += sheet->kernel(job->body, job->x, job->f, begin, end);
    for (int k = begin; sheet->curvature && k < end; k++)
        for (int lane = 0; lane < sheet->batch[k].n; lane++)
            job->energy[task] += bend(job->body, sheet->batch[k].triangle[lane], job->x, job->f);
}

double cn_sheet_add_turned(const cn_body *body, const double *x, double *f, cn_pool *pool)
{
    const cn_sheet *sheet = body->own;
    turned_job job = {.body = body, .x = x, .f = f};
    double energy = 0;
    for (int c = 0; c < CN_SHEET_COLOURS; c++) {
        job.begin = sheet->colour[c], job.end = sheet->colour[c + 1];
        if (job.end > job.begin)
            cn_pool_run(c + 1 < CN_SHEET_COLOURS ? pool : NULL, CN_SHEET_TASKS, turned_task, &job);
    }
    for (int i = 0; i < CN_SHEET_TASKS; i++)
        energy += job.energy[i];
    for (int i = 0; i < body->nnode; i++) {
        double u[3];
        cn_sub(x + 3 * (size_t)i, body->rest + 3 * (size_t)i, u);
        energy += 0.5 * sheet->foundation[i] * cn_norm2(u);
        if (f) cn_axpy(-sheet->foundation[i], u, f + 3 * (size_t)i);
    }
    return energy;
}

/* Quaternion of the turn from rest axes to those of now. */
static void quaternion_of(const cn_sheet_frame *frame, double q[4])
{
    double r[3][3] = {{0}}, best = -1;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                r[i][j] += frame->now[3 * k + i] * frame->rest[3 * k + j];
    const double trace = r[0][0] + r[1][1] + r[2][2];
    int k = 0;
    for (int i = 0; i < 4; i++) { /* 4 q_i^2, the largest of them */
        const double four = i ? 1 + 2 * r[i - 1][i - 1] - trace : 1 + trace;
        if (four > best) best = four, k = i;
    }
    const double twice = sqrt(best);
    q[k] = 0.5 * twice;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        const double odd = r[l][j] - r[j][l]; /* 4 w q_i */
        if (k == 0) q[i + 1] = 0.5 * odd / twice;
        if (k == i + 1) q[0] = 0.5 * odd / twice;
        if (k == j + 1) q[l + 1] = 0.5 * (r[j][l] + r[l][j]) / twice;
        if (k == l + 1) q[j + 1] = 0.5 * (r[j][l] + r[l][j]) / twice;
    }
}

typedef struct {
    const cn_body *body;
    const double *x;
    double *rotation;
    double least[CN_SHEET_TASKS], most[CN_SHEET_TASKS]; /* cosine of half an angle; change of strain */
    bool take;
} follow_job;

static void follow_task(void *user, int task)
{
    follow_job *job = user;
    const int n = job->body->nelement;
    job->least[task] = 1;
    for (int t = (int)((long long)n * task / CN_SHEET_TASKS);
         t < (int)((long long)n * (task + 1) / CN_SHEET_TASKS); t++) {
        double q[4], *p = job->rotation + 4 * (size_t)t, *e = p + 4 * (size_t)n;
        cn_sheet_frame frame;
        cn_sheet_polar(job->body, t, job->x, &frame);
        quaternion_of(&frame, q);
        const double strain[3] = {frame.u[0] - 1, frame.u[1] - 1, frame.u[2]};
        job->least[task] =
            fmin(job->least[task], fabs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]));
        for (int k = 0; k < 3; k++)
            job->most[task] = fmax(job->most[task], fabs(strain[k] - e[k]));
        if (job->take) memcpy(p, q, sizeof q), memcpy(e, strain, sizeof strain);
    }
}

/* How far the triangles have changed, and with `take` their rotations as they are now. */
static void follow(follow_job *job, double *turn, double *strain, cn_pool *pool)
{
    double least = 1;
    cn_pool_run(pool, CN_SHEET_TASKS, follow_task, job);
    *strain = 0;
    for (int i = 0; i < CN_SHEET_TASKS; i++)
        least = fmin(least, job->least[i]), *strain = fmax(*strain, job->most[i]);
    *turn = 2 * acos(fmin(1, least));
}

double cn_sheet_turn(const cn_body *body, const double *x, const double *rotation, cn_pool *pool)
{
    follow_job job = {.body = body, .x = x, .rotation = (double *)rotation}; /* not written: take is false */
    double turn, strain;
    follow(&job, &turn, &strain, pool);
    return turn;
}

void cn_sheet_follow(const cn_body *body, const double *x, double *rotation, double change, cn_pool *pool)
{
    follow_job job = {.body = body, .x = x, .rotation = rotation};
    double turn, strain, *way = rotation + 8 * (size_t)body->nelement;
    if (change >= 0) {
        follow(&job, &turn, &strain, pool);
        if (!(turn > change || (cn_sheet_turns(body, rotation) && strain > change))) return;
    }
    job.take = true;
    follow(&job, &turn, &strain, pool);
    way[0] = 0, way[1] = 1;
}

void cn_sheet_tension(const cn_sheet *sheet, const double strain[3], double tension[3])
{
    const double nu = sheet->poisson, plate = sheet->young / (1 - nu * nu) * sheet->thickness;
    const double mean = (strain[0] + strain[1]) / 2, half = (strain[0] - strain[1]) / 2,
                 radius = hypot(half, strain[2]);
    double s[2];
    for (int k = 0; k < 2; k++) { /* of principal strains, greater first */
        const double e = mean + (k ? -radius : radius), other = mean + (k ? radius : -radius);
        s[k] = fmax(0, plate * (e + nu * other) / fmax(1 + e, 1e-6));
    }
    const double centre = (s[0] + s[1]) / 2, apart = radius > 0 ? (s[0] - s[1]) / (2 * radius) : 0;
    tension[0] = centre + apart * half, tension[1] = centre - apart * half, tension[2] = apart * strain[2];
}
