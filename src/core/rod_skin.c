/* rod_skin.c - points that ride on a rod's frames: x_p = p_i + R(exp(theta_i) q_i) r_p. */
#include "rod.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "catnav/vec3.h"
#include "polar.h"
#include "rod_spin.h"

static cn_status check_skin(const cn_body *body, const cn_tets *skin, const int *ride, cn_error *error)
{
    const int n = body->nnode, per = skin->nnode / n;
    const cn_status status = cn_body_check_mesh(skin, error);
    if (status != CN_OK) return status;
    if (skin->mid) return cn_fail(error, CN_ERR_ARG, "", 0, "a rod's skin is of linear tetrahedra");
    if (per < 1 || skin->nnode % n != 0)
        return cn_fail(error, CN_FAULT_VALUE, "", 0,
                       "a skin of %d nodes cannot ride on a rod of %d: a multiple is needed", skin->nnode, n);
    for (int p = 0; ride && p < skin->nnode; p++)
        if (ride[p] < 0 || ride[p] >= n)
            return cn_fail(error, CN_ERR_ARG, "", 0, "node %d of the skin rides on node %d of %d", p, ride[p],
                           n);
    return CN_OK;
}

/* place[p]: where node p of the skin goes, so that those of a rod's node stand in a row. */
static cn_status order_skin(const cn_body *body, const cn_tets *skin, const int *ride, int *place,
                            cn_error *error)
{
    const int n = body->nnode, per = skin->nnode / n;
    int *count = calloc((size_t)n, sizeof *count);
    cn_status status = CN_OK;
    if (!count) return CN_ERR_MEMORY;
    for (int p = 0; p < skin->nnode; p++) {
        const int i = ride ? ride[p] : p / per;
        place[p] = i * per + count[i]++;
    }
    for (int i = 0; i < n && status == CN_OK; i++)
        if (count[i] != per)
            status =
                cn_fail(error, CN_ERR_ARG, "", 0,
                        "%d nodes of the skin ride on node %d of a rod: each needs %d", count[i], i, per);
    free(count);
    return status;
}

/* A tetrahedron belongs to the segment that its centre lies in by the numbers of its nodes. */
static int segment_of(const cn_body *body, int tet)
{
    const int per = body->npoint / body->nnode;
    long long stations = 0;
    for (int a = 0; a < 4; a++)
        stations += body->tet[4 * (size_t)tet + (size_t)a] / per;
    return stations / 4 < body->nelement ? (int)(stations / 4) : body->nelement - 1;
}

static void place_fibres(const cn_body *body)
{
    const cn_rod *rod = body->own;
    for (int e = 0; e < body->ntet; e++)
        rod->start[segment_of(body, e) + 1]++;
    for (int s = 0; s < body->nelement; s++)
        rod->start[s + 1] += rod->start[s];
    for (int e = body->ntet - 1; e >= 0; e--) { /* from behind: starts end up at ends, and are moved */
        const int s = segment_of(body, e), k = --rod->start[s + 1];
        double *fibre = rod->fibre + 3 * (size_t)k, shear[2];
        rod->riding[k] = e;
        for (int a = 0; a < 4; a++)
            for (int i = 0; i < 2; i++)
                fibre[i] += rod->offset[3 * (size_t)body->tet[4 * (size_t)e + (size_t)a] + (size_t)i] / 4;
        cn_section_twist_stress(rod->section + s, fibre, shear);
        fibre[2] = hypot(shear[0], shear[1]);
    }
    memmove(rod->start, rod->start + 1, (size_t)body->nelement * sizeof *rod->start);
    rod->start[body->nelement] = body->ntet;
}

/* Without a skin the points are the nodes. */
cn_status cn_rod_skin(cn_body *body, const cn_tets *skin, const int *ride, cn_error *error)
{
    cn_rod *rod = body->own;
    cn_status status = CN_ERR_MEMORY;
    int *place = NULL;
    if (skin && (status = check_skin(body, skin, ride, error)) != CN_OK) return status;
    body->npoint = skin ? skin->nnode : body->nnode, body->ntet = skin ? skin->ntet : 0;
    const size_t n = (size_t)body->npoint, ntet = (size_t)body->ntet;
    status = CN_ERR_MEMORY;
    body->point = calloc(n, 3 * sizeof *body->point);
    body->tet = calloc(ntet + 1, 4 * sizeof *body->tet);
    rod->offset = calloc(n, 3 * sizeof *rod->offset);
    rod->start = calloc((size_t)body->nelement + 1, sizeof *rod->start);
    rod->riding = calloc(ntet + 1, sizeof *rod->riding);
    rod->fibre = calloc(ntet + 1, 3 * sizeof *rod->fibre);
    place = calloc(n, sizeof *place);
    if (!body->point || !body->tet || !rod->offset || !rod->start || !rod->riding || !rod->fibre || !place)
        goto done;
    if (skin && (status = order_skin(body, skin, ride, place, error)) != CN_OK) goto done;
    for (size_t p = 0; skin && p < n; p++)
        cn_copy3(skin->node + 3 * p, body->point + 3 * (size_t)place[p]);
    for (size_t c = 0; skin && c < 4 * ntet; c++)
        body->tet[c] = place[skin->tet[c]];
    if (!skin) memcpy(body->point, body->rest, 3 * n * sizeof *body->point);
    for (size_t p = 0; p < n; p++) {
        const size_t i = p / (n / (size_t)body->nnode);
        double r[9], arm[3];
        cn_quaternion_matrix(rod->frame + 4 * i, r);
        cn_sub(body->point + 3 * p, body->rest + 3 * i, arm);
        for (int k = 0; k < 3; k++)
            rod->offset[3 * p + (size_t)k] = r[k] * arm[0] + r[3 + k] * arm[1] + r[6 + k] * arm[2];
    }
    place_fibres(body);
    const cn_tets riding = {.nnode = body->npoint, .ntet = body->ntet, .node = body->point, .tet = body->tet};
    status = cn_tets_boundary(&body->boundary, &riding);
done:
    free(place);
    return status;
}

/* R and T of node i now. */
static void frame_now(const cn_body *body, int i, const double *x, const double *rotation, cn_spin *spin,
                      double r[9], double t[9])
{
    const double *theta = x + 3 * (size_t)(body->nnode + i);
    double q[4];
    cn_spin_at(cn_norm2(theta), spin);
    cn_spin_frame(spin, theta, rotation + 4 * (size_t)i, q);
    cn_quaternion_matrix(q, r);
    cn_spin_jacobian(spin, theta, t);
}

void cn_rod_frame(const cn_body *body, int i, const double *x, const double *rotation, double r[9],
                  double t[9])
{
    cn_spin spin;
    frame_now(body, i, x, rotation, &spin, r, t);
}

void cn_rod_points(const cn_body *body, int nactive, const double *x, const double *rotation, double *points)
{
    const cn_rod *rod = body->own;
    const int per = body->npoint / body->nnode;
    for (int i = 0; i < nactive; i++) {
        cn_spin spin;
        double r[9], t[9];
        frame_now(body, i, x, rotation, &spin, r, t);
        for (size_t p = (size_t)i * (size_t)per; p < (size_t)(i + 1) * (size_t)per; p++) {
            cn_mat_vec(r, rod->offset + 3 * p, points + 3 * p);
            cn_axpy(1, x + 3 * (size_t)i, points + 3 * p);
        }
    }
}

void cn_rod_carry(const cn_body *body, int nactive, const double *x, const double *rotation, cn_carry *carry)
{
    const cn_rod *rod = body->own;
    const int per = body->npoint / body->nnode;
    for (int i = 0; i < nactive; i++) {
        cn_spin spin;
        double r[9], t[9], arm[3], column[3];
        frame_now(body, i, x, rotation, &spin, r, t);
        for (size_t p = (size_t)i * (size_t)per; p < (size_t)(i + 1) * (size_t)per; p++) {
            double *out = carry->arm + 9 * p;
            cn_mat_vec(r, rod->offset + 3 * p, arm);
            for (int k = 0; k < 3; k++) { /* column k: T's times the arm */
                const double turn[3] = {t[k], t[3 + k], t[6 + k]};
                cn_cross(turn, arm, column);
                out[k] = column[0], out[3 + k] = column[1], out[6 + k] = column[2];
            }
        }
    }
}

/* A force F at the arm r: -F.x has the spin gradient -r x F, and the Hessian -(r F' + F r')/2 + (r.F) I. */
void cn_rod_pull(const cn_body *body, int nactive, const double *x, const double *rotation,
                 const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a)
{
    const cn_rod *rod = body->own;
    const int per = body->npoint / body->nnode;
    for (int i = 0; i < nactive; i++) {
        double *push = f + 3 * (size_t)i, *turn = f + 3 * (size_t)(body->nnode + i), moment[3] = {0},
               h[9] = {0};
        bool loaded = false;
        double r[9], t[9];
        cn_spin spin;
        for (size_t p = (size_t)i * (size_t)per; p < (size_t)(i + 1) * (size_t)per; p++) {
            const double *g = force + 3 * p, *arm = carry->arm + 9 * p;
            if (g[0] == 0 && g[1] == 0 && g[2] == 0) continue;
            cn_axpy(1, g, push);
            for (int k = 0; k < 3; k++)
                turn[k] += arm[k] * g[0] + arm[3 + k] * g[1] + arm[6 + k] * g[2];
            if (!a) continue;
            if (!loaded) frame_now(body, i, x, rotation, &spin, r, t);
            loaded = true;
            double now[3], m[3];
            cn_mat_vec(r, rod->offset + 3 * p, now);
            cn_cross(now, g, m);
            cn_axpy(-1, m, moment);
            const double along = cn_dot(now, g);
            for (int k = 0; k < 3; k++) {
                h[4 * k] += along;
                for (int l = 0; l < 3; l++)
                    h[3 * k + l] -= 0.5 * (now[k] * g[l] + g[k] * now[l]);
            }
        }
        if (!loaded) continue;
        const double transposed[9] = {t[0], t[3], t[6], t[1], t[4], t[7], t[2], t[5], t[8]};
        double ht[9], tht[9];
        cn_mat_mul(h, t, ht);
        cn_mat_mul(transposed, ht, tht);
        cn_spin_add_second(&spin, x + 3 * (size_t)(body->nnode + i), moment, tht);
        double *block = a->value + 9 * (size_t)a->diagonal[body->nnode + i];
        for (int k = 0; k < 9; k++)
            block[k] += scale * 0.5 * (tht[k] + tht[k % 3 * 3 + k / 3]);
    }
}
