/* body_modes.c - rigid motions that nothing prevents, by parts that elements join. */
#include "body_modes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "catnav/vec3.h"

static int root_of(int *parent, int i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

/* What the held nodes of the part with this root leave free. */
static void free_of(const cn_body *body, const unsigned char *fixed, int *parent, int root, cn_body_modes *m)
{
    const int n = body->nnode;
    const double *first = NULL, *far = NULL;
    double size = 0, length = 0, aside = 0;
    bool frame = false;
    m->shift = true, m->turn = 3, m->nnode = 0, m->node = root;
    for (int i = 0; i < n; i++) {
        const double *x = body->rest + 3 * (size_t)i;
        if (root_of(parent, i) != root) continue;
        m->nnode++;
        size = fmax(size, cn_distance(x, body->rest + 3 * (size_t)root));
        frame = frame || (body->nblock > n && fixed[n + i]);
        if (fixed[i] && !first) first = x;
        if (fixed[i] && cn_distance(x, first) > length) far = x, length = cn_distance(x, first);
    }
    const double slack = 1e-9 * size;
    if (first) m->shift = false, cn_copy3(first, m->at);
    if (length > slack) {
        cn_sub(far, first, m->axis), cn_normalise(m->axis);
        for (int i = 0; i < n; i++) {
            double from[3];
            if (!fixed[i] || root_of(parent, i) != root) continue;
            cn_sub(body->rest + 3 * (size_t)i, first, from);
            cn_axpy(-cn_dot(from, m->axis), m->axis, from);
            aside = fmax(aside, cn_norm(from));
        }
        m->turn = aside > slack ? 0 : 1;
    }
    if (!first) cn_copy3(body->rest + 3 * (size_t)root, m->at);
    if (frame || m->nnode == 1) m->turn = 0;
}

cn_status cn_body_modes_find(const cn_body *body, const unsigned char *fixed, cn_body_modes *modes)
{
    const int n = body->nnode;
    int *parent = malloc(((size_t)n + 1) * sizeof *parent);
    *modes = (cn_body_modes){.node = -1};
    if (!parent) return CN_ERR_MEMORY;
    for (int i = 0; i < n; i++)
        parent[i] = i;
    for (int e = 0; e < body->nelement; e++) {
        const int *block = body->connect + (size_t)e * (size_t)body->nper;
        for (int a = 1; a < body->nper; a++) { /* the lower node leads: a part's root is its first node */
            const int p = root_of(parent, block[0] % n), q = root_of(parent, block[a] % n);
            parent[p > q ? p : q] = p > q ? q : p;
        }
    }
    for (int i = 0; i < n; i++) {
        cn_body_modes part;
        if (parent[i] != i) continue;
        modes->npart++;
        free_of(body, fixed, parent, i, &part);
        if (!part.shift && part.turn == 0) continue;
        if (modes->nloose++ == 0) {
            part.npart = modes->npart, part.nloose = 1, part.part = modes->npart;
            *modes = part;
        }
    }
    free(parent);
    return CN_OK;
}

void cn_body_modes_text(const cn_body_modes *m, char *text, size_t size)
{
    char part[96] = "it", turn[160] = "";
    if (size > 0) text[0] = 0;
    if (m->nloose == 0) return;
    if (m->npart > 1)
        snprintf(part, sizeof part, "part %d of %d (node %d and %d more)", m->part, m->npart, m->node,
                 m->nnode - 1);
    if (m->turn == 1)
        snprintf(turn, sizeof turn,
                 "turn about the line of held nodes through [%g %g %g] along [%.3g %.3g %.3g]", m->at[0],
                 m->at[1], m->at[2], m->axis[0], m->axis[1], m->axis[2]);
    else if (m->turn == 3 && !m->shift)
        snprintf(turn, sizeof turn, "turn about x, y and z through the held point [%g %g %g]", m->at[0],
                 m->at[1], m->at[2]);
    else if (m->turn == 3)
        snprintf(turn, sizeof turn, "turn about x, y and z");
    snprintf(text, size, "%s is free to %s%s%s", part, m->shift ? "shift along x, y and z" : "",
             m->shift && turn[0] ? " and to " : "", turn);
}
