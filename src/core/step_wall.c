/* step_wall.c - one wall that deforms, its unknowns condensed where it is touched.
 *
 * The wall's matrix A_w is constant but for when its triangles are turned anew. With links k j j', j = (j_r,
 * j_w) over the other bodies and the wall, and their forces y, A_w dw = b_w - j_w' y; hence with its
 * compliance C = j_w A_w^-1 j_w' (wall_compliance.h) S y = j_r dr + j_w A_w^-1 b_w ,  S = 1/k + C , and the
 * other bodies are left with (A_r
 * + j_r' S^-1 j_r) dr = b_r - j_r' S^-1 j_w A_w^-1 b_w. S is small and dense. Of the other bodies' matrices
 * the links' own part k j_r j_r' is taken off again. */
#include "step_parts.h"
#include "wall_compliance.h"

#include <stdlib.h>
#include <string.h>

enum { LINKS = 900, VERTICES = 450, SIZES = 5, Q = 3, P = 2, R = 0 };

static const int sizes[SIZES] = {48, 120, 240, 480, LINKS};

struct cn_wall_solve {
    int part;
    double h;
    double *turn; /* rotations of the wall whose matrix the compliance is of (nturn x 4) */
    cn_compliance *compliance;
    int nlink, *link;         /* contact's (LINKS) */
    int nvertex, *vertex;     /* touched (VERTICES) */
    int *slot;                /* of each of the wall's nodes: in vertex, -1: not touched (nnode) */
    double *give;             /* C at the vertices (3 VERTICES)^2 */
    double *column;           /* of one link: 3 VERTICES */
    int size;                 /* which of these S fits */
    cn_matrix *matrix[SIZES]; /* S, by blocks of three links */
    cn_solver *solver[SIZES];
    double *y, *along; /* (LINKS + 3) */
    double *ahead;     /* A_w^-1 b_w (nnode x 3) */
};

static cn_status dense_matrix(cn_matrix **out, int n)
{
    cn_matrix *a = *out = calloc(1, sizeof *a);
    if (!a) return CN_ERR_MEMORY;
    a->n = n, a->nblock = n * n;
    a->row = malloc(((size_t)n + 1) * sizeof *a->row);
    a->col = malloc((size_t)n * (size_t)n * sizeof *a->col);
    a->diagonal = malloc((size_t)n * sizeof *a->diagonal);
    a->value = calloc(9 * (size_t)n * (size_t)n, sizeof *a->value);
    if (!a->row || !a->col || !a->diagonal || !a->value) return CN_ERR_MEMORY;
    for (int i = 0; i <= n; i++)
        a->row[i] = i * n;
    for (int i = 0; i < n; i++) {
        a->diagonal[i] = i * n + i;
        for (int j = 0; j < n; j++)
            a->col[i * n + j] = j;
    }
    return CN_OK;
}

cn_status cn_wall_factor(const cn_stage *s)
{
    cn_part *part = s->part;
    const cn_body *b = part->body->body;
    const double over = (part->model->inertia ? 1 / (s->h * s->h) : 0) + b->damping / s->h;
    const size_t turns = 4 * (size_t)b->nturn * sizeof(double);
    if (part->sheet_h == s->h && !memcmp(part->factored_turn, s->rotation, turns)) return CN_OK;
    part->sheet_h = 0, memcpy(part->factored_turn, s->rotation, turns);
    cn_matrix_clear(part->matrix, b->nblock);
    memset(part->cg[0], 0, 3 * (size_t)b->nblock * sizeof *part->cg[0]);
    cn_body_add_elastic(b, b->nnode, b->rest, s->rotation, part->cg[0], CN_TANGENT_EXACT, 1, part->scatter,
                        part->pool);
    for (int i = 0; i < b->nnode; i++)
        for (int k = 0; k < 3; k++)
            part->matrix->value[9 * (size_t)part->matrix->diagonal[i] + 4 * (size_t)k] += over * b->mass[i];
    const cn_status status =
        cn_solver_factor(part->solver, part->matrix, b->nblock, part->body->fixed, part->pool);
    if (status == CN_OK) part->sheet_h = s->h;
    return status;
}

cn_status cn_wall_solve_new(cn_wall_solve **out, cn_work *work, double h, cn_error *error)
{
    int sheet = -1, sheets = 0;
    cn_status status;
    *out = NULL;
    for (int p = 0; p < work->npart; p++)
        if (work->part[p].sheet) sheet = p, sheets++;
    if (sheets != 1 || work->npart < 2) return CN_OK;
    cn_part *part = &work->part[sheet];
    const cn_body *body = part->body->body;
    const size_t n = (size_t)body->nnode;
    cn_wall_solve *wall = calloc(1, sizeof *wall);
    if (!wall || !(wall->turn = calloc(4 * (size_t)body->nturn, sizeof *wall->turn))) {
        free(wall);
        return CN_ERR_MEMORY;
    }
    cn_body_rotation_start(body, wall->turn);
    const cn_stage stage = {.part = part, .h = h, .rotation = wall->turn};
    if (cn_wall_factor(&stage) != CN_OK) { /* the step says so */
        cn_wall_solve_free(wall);
        return CN_OK;
    }
    wall->part = sheet, wall->h = h;
    wall->link = malloc(LINKS * sizeof *wall->link);
    wall->vertex = malloc(VERTICES * sizeof *wall->vertex);
    wall->slot = malloc(n * sizeof *wall->slot);
    wall->give = malloc(9 * (size_t)VERTICES * VERTICES * sizeof *wall->give);
    wall->column = calloc(3 * VERTICES, sizeof *wall->column);
    wall->y = calloc(LINKS + 3, sizeof *wall->y);
    wall->along = calloc(LINKS + 3, sizeof *wall->along);
    wall->ahead = calloc(3 * n, sizeof *wall->ahead);
    int *level = calloc(LINKS / 3, sizeof *level);
    status = CN_ERR_MEMORY;
    if (wall->link && wall->vertex && wall->slot && wall->give && wall->column && wall->y && wall->along &&
        wall->ahead && level)
        status = CN_OK;
    for (int i = 0; status == CN_OK && i < SIZES; i++)
        if ((status = dense_matrix(&wall->matrix[i], sizes[i] / 3)) == CN_OK)
            status = cn_solver_new(&wall->solver[i], wall->matrix[i], CN_LINEAR_CHAIN, level, error);
    if (status == CN_OK)
        status =
            cn_compliance_new(&wall->compliance, part->matrix, part->body->fixed, (size_t)256 << 20, error);
    free(level);
    for (size_t i = 0; status == CN_OK && i < n; i++)
        wall->slot[i] = -1;
    if (status == CN_OK)
        *out = wall;
    else
        cn_wall_solve_free(wall);
    return status;
}

void cn_wall_solve_free(cn_wall_solve *wall)
{
    if (!wall) return;
    cn_compliance_free(wall->compliance);
    for (int i = 0; i < SIZES; i++)
        cn_solver_free(wall->solver[i]), cn_matrix_free(wall->matrix[i]);
    free(wall->link), free(wall->vertex), free(wall->slot), free(wall->give), free(wall->column);
    free(wall->turn), free(wall->y), free(wall->along), free(wall->ahead);
    free(wall);
}

int cn_wall_part(const cn_wall_solve *wall)
{
    return wall->part;
}

/* Side of the link that is the wall's, -1: none. */
static int wall_side(const cn_wall_solve *wall, const cn_link *link)
{
    return link->surface[0] == wall->part ? 0 : link->surface[1] == wall->part ? 1 : -1;
}

static bool note_links(cn_wall_solve *wall, const cn_work *work)
{
    const int first = work->surfaces->surface[wall->part].first;
    for (int v = 0; v < wall->nvertex; v++)
        wall->slot[wall->vertex[v]] = -1;
    wall->nlink = wall->nvertex = 0;
    for (int l = 0; l < work->contact->nlink; l++) {
        const cn_link *link = &work->contact->link[l];
        const int side = wall_side(wall, link);
        int begin, end;
        if (side < 0 || !(link->k > 0)) continue;
        if (link->surface[1 - side] == wall->part || wall->nlink == LINKS) return false;
        wall->link[wall->nlink++] = l;
        cn_link_points(link, side, &begin, &end);
        for (int i = begin; i < end; i++) {
            const int v = link->p[i] - first;
            if (wall->slot[v] >= 0) continue;
            if (wall->nvertex == VERTICES) return false;
            wall->slot[v] = wall->nvertex, wall->vertex[wall->nvertex++] = v;
        }
    }
    return wall->nlink > 0;
}

/* The compliance is of the wall as its matrix is turned now. */
static bool turn_with(cn_wall_solve *wall, const cn_stage *s)
{
    const size_t turns = 4 * (size_t)s->part->body->body->nturn * sizeof *wall->turn;
    if (!memcmp(wall->turn, s->rotation, turns)) return true;
    memset(wall->turn, 0, turns); /* of no wall, should it fail */
    if (cn_compliance_refactor(wall->compliance, s->part->matrix) != CN_OK) return false;
    memcpy(wall->turn, s->rotation, turns);
    return true;
}

bool cn_wall_take(const cn_group *g)
{
    const cn_work *work = g->work;
    cn_wall_solve *wall = work->wall;
    if (!wall || g->stage[wall->part].h != wall->h || !note_links(wall, work)) return false;
    if (cn_wall_factor(&g->stage[wall->part]) != CN_OK || !turn_with(wall, &g->stage[wall->part]))
        return false;
    if (cn_compliance_ensure(wall->compliance, wall->nvertex, wall->vertex) != CN_OK) return false;
    cn_compliance_gather(wall->compliance, wall->nvertex, wall->vertex, wall->give);
    wall->size = 0;
    while (sizes[wall->size] < wall->nlink)
        wall->size++;
    cn_matrix *dense = wall->matrix[wall->size];
    const int m = wall->nlink, n3 = 3 * wall->nvertex, n = dense->n,
              first = work->surfaces->surface[wall->part].first;
    for (int d = 0; d < m; d++) { /* column d of S */
        const cn_link *link = &work->contact->link[wall->link[d]];
        int begin, end;
        memset(wall->column, 0, (size_t)n3 * sizeof *wall->column);
        cn_link_points(link, wall_side(wall, link), &begin, &end);
        for (int i = begin; i < end; i++) {
            const double *give = wall->give + 3 * (size_t)wall->slot[link->p[i] - first] * (size_t)n3;
            for (int k = 0; k < 3; k++) { /* symmetric: rows serve as columns */
                const double share = link->w[i] * link->n[k];
                for (int j = 0; j < n3; j++)
                    wall->column[j] += share * give[(size_t)k * (size_t)n3 + (size_t)j];
            }
        }
        for (int c = 0; c < m; c++) {
            const cn_link *other = &work->contact->link[wall->link[c]];
            double sum = c == d ? 1 / link->k : 0;
            cn_link_points(other, wall_side(wall, other), &begin, &end);
            for (int i = begin; i < end; i++)
                sum += other->w[i] * cn_dot(other->n, wall->column + 3 * wall->slot[other->p[i] - first]);
            dense
                ->value[9 * ((size_t)(c / 3) * (size_t)n + (size_t)(d / 3)) + (size_t)(3 * (c % 3) + d % 3)] =
                sum;
        }
    }
    const int blocks = (m + 2) / 3;
    for (int c = m; c < 3 * blocks; c++) /* the rest of the last block */
        for (int d = 0; d < 3 * blocks; d++) {
            const double one = c == d;
            dense
                ->value[9 * ((size_t)(c / 3) * (size_t)n + (size_t)(d / 3)) + (size_t)(3 * (c % 3) + d % 3)] =
                one;
            dense
                ->value[9 * ((size_t)(d / 3) * (size_t)n + (size_t)(c / 3)) + (size_t)(3 * (d % 3) + c % 3)] =
                one;
        }
    return cn_solver_factor(wall->solver[wall->size], dense, blocks, NULL, NULL) == CN_OK;
}

/* y = S^-1 along */
static void forces_of(cn_wall_solve *wall)
{
    for (int c = wall->nlink; c < wall->nlink + 3; c++)
        wall->along[c] = 0;
    cn_solver_apply(wall->solver[wall->size], wall->along, wall->y, NULL);
}

void cn_wall_add(const cn_group *g)
{
    const cn_work *work = g->work;
    cn_wall_solve *wall = work->wall;
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        const int other = 1 - wall_side(wall, link), surface = link->surface[other];
        wall->along[c] =
            surface < work->npart ? cn_link_along(work, link, other, work->part[surface].cg[P]) : 0;
    }
    forces_of(wall);
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        const int other = 1 - wall_side(wall, link), surface = link->surface[other];
        if (surface >= work->npart) continue;
        cn_link_push(work, link, other, wall->y[c] - (link->own[other] ? link->k * wall->along[c] : 0),
                     work->part[surface].cg[Q]);
    }
}

cn_status cn_wall_begin(const cn_group *g)
{
    const cn_work *work = g->work;
    cn_wall_solve *wall = work->wall;
    cn_part *part = &work->part[wall->part];
    cn_status status = cn_solver_apply(part->solver, part->cg[R], wall->ahead, work->pool);
    if (status != CN_OK) return status;
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        wall->along[c] = cn_link_along(work, link, wall_side(wall, link), wall->ahead);
    }
    forces_of(wall);
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        const int other = 1 - wall_side(wall, link), surface = link->surface[other];
        if (surface < work->npart) cn_link_push(work, link, other, -wall->y[c], work->part[surface].cg[R]);
    }
    return CN_OK;
}

void cn_wall_end(const cn_group *g)
{
    const cn_work *work = g->work;
    cn_wall_solve *wall = work->wall;
    cn_part *part = &work->part[wall->part];
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        const int side = wall_side(wall, link), surface = link->surface[1 - side];
        wall->along[c] = cn_link_along(work, link, side, wall->ahead);
        if (surface < work->npart)
            wall->along[c] += cn_link_along(work, link, 1 - side, work->part[surface].dx);
    }
    forces_of(wall);
    memset(wall->column, 0, 3 * (size_t)wall->nvertex * sizeof *wall->column);
    for (int c = 0; c < wall->nlink; c++) {
        const cn_link *link = &work->contact->link[wall->link[c]];
        int begin, end;
        cn_link_points(link, wall_side(wall, link), &begin, &end);
        for (int i = begin; i < end; i++)
            cn_axpy(-wall->y[c] * link->w[i], link->n,
                    wall->column + 3 * wall->slot[link->p[i] - work->surfaces->surface[wall->part].first]);
    }
    memcpy(part->dx, wall->ahead, 3 * (size_t)part->body->body->nnode * sizeof *part->dx);
    cn_compliance_spread(wall->compliance, wall->nvertex, wall->vertex, wall->column, part->dx);
}
