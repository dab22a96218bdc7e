/* body_face.c - outer faces of a body: integration over linear and quadratic triangles. */
#include "body_face.h"

#include <math.h>
#include <string.h>
#include "catnav/vec3.h"

int cn_body_face(const cn_body *body, int face, int point[CN_FACE_NODES])
{
    const int per = body->mid && body->model == CN_BODY_TET10 ? 4 : 1;
    if (face < 0 || face >= body->boundary->ntri / per) return 0;
    const int *tri = body->boundary->tri + 3 * (size_t)per * (size_t)face;
    if (per == 1) {
        memcpy(point, tri, 3 * sizeof *point);
        return 3;
    }
    const int six[6] = {tri[0], tri[4], tri[8], tri[1], tri[5], tri[2]};
    memcpy(point, six, sizeof six);
    return 6;
}

/* Gauss-Legendre points on [0, 1] in each direction of the square that folds onto the triangle. */
static double square_point(int k, double l[3])
{
    static const double place[4] = {0.069431844202973712388, 0.33000947820757186760, 0.66999052179242813240,
                                    0.93056815579702628761};
    static const double weight[4] = {0.17392742256872692869, 0.32607257743127307131, 0.32607257743127307131,
                                     0.17392742256872692869};
    const double u = place[k / 4], v = place[k % 4];
    l[1] = u * (1 - v), l[2] = u * v, l[0] = 1 - u;
    return u * weight[k / 4] * weight[k % 4];
}

void cn_body_face_at(const cn_body *body, int face, int k, double shape[CN_FACE_NODES], double place[3],
                     double area[3])
{
    int point[CN_FACE_NODES];
    const int n = cn_body_face(body, face, point);
    double l[3], slope[3][3] = {{0}}, side[2][3]; /* slope: dx/dl */
    const double weight = square_point(k, l);
    place[0] = place[1] = place[2] = 0;
    for (int a = 0; a < n; a++) {
        const double *x = body->point + 3 * (size_t)point[a];
        const int i = a % 3, j = a < 3 ? a : (a + 1) % 3;
        shape[a] = n == 3 ? l[a] : a < 3 ? l[a] * (2 * l[a] - 1) : 4 * l[i] * l[j];
        cn_axpy(shape[a], x, place);
        if (a < 3) {
            cn_axpy(n == 3 ? 1 : 4 * l[a] - 1, x, slope[a]);
            continue;
        }
        cn_axpy(4 * l[j], x, slope[i]);
        cn_axpy(4 * l[i], x, slope[j]);
    }
    for (int a = 0; a < 2; a++)
        cn_sub(slope[1 + a], slope[0], side[a]);
    cn_cross(side[0], side[1], area);
    for (int i = 0; i < 3; i++)
        area[i] *= weight;
}

void cn_face_shares(const cn_body *body, const unsigned char *inside, double *share)
{
    int point[CN_FACE_NODES];
    for (int face = 0, n; (n = cn_body_face(body, face, point)) > 0; face++) {
        bool all = true;
        for (int a = 0; a < n; a++)
            all = all && inside[point[a]];
        for (int k = 0; all && k < CN_FACE_POINTS; k++) {
            double shape[CN_FACE_NODES], place[3], area[3];
            cn_body_face_at(body, face, k, shape, place, area);
            for (int a = 0; a < n; a++)
                share[point[a]] += shape[a] * cn_norm(area);
        }
    }
}
