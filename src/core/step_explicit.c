/* step_explicit.c - a step of molecules by symplectic Euler in substeps (molecules_explicit.c): springs
 * between them, what the drive holds along its path, and penalty's springs as they were found where the step
 * begins. Loads are those of the step's end, as in an implicit one. */
#include "molecules.h"
#include "step_parts.h"

#include <math.h>

typedef struct {
    const cn_group *g;
    const cn_stage *stage;
} pressing;

static void press(void *user, const double *x, const double *v, double *f)
{
    const pressing *p = user;
    if (p->stage->path) cn_drive_add(&p->stage->part->drive, p->stage->nfree, x, f, 1, NULL);
    if (p->g->pressed) cn_stage_press(p->g, (int)(p->stage - p->g->stage), v, f);
}

/* Largest stiffness over mass of the drive's potential [1/s^2]. */
static double drive_bound(const cn_stage *s)
{
    const cn_drive *drive = &s->part->drive;
    double most = 0;
    for (int i = 0; s->path && i < s->nfree; i++) {
        const double near = drive->weight[i] > 0 ? drive->weight[i] / drive->distance : 0;
        most = fmax(most, (drive->pull[i] + 2 * (near + drive->hold[i])) / s->part->body->body->mass[i]);
    }
    return most;
}

cn_status cn_step_explicit(const cn_group *g, cn_state *trial, double time, double dt)
{
    EACH_STAGE(g, s)
    {
        cn_part *part = s->part;
        pressing user = {g, s};
        cn_press pushes = {.user = &user, .add = press, .square = drive_bound(s)};
        int substeps;
        if (g->pressed) cn_stage_press_bound(g, (int)(s - g->stage), part->gradient, &pushes);
        cn_stage_external(s, time + dt);
        const cn_status status = cn_molecules_explicit(
            part->body->body, dt, part->external, s->path || g->pressed ? &pushes : NULL, part->held, s->x,
            trial->body[part->index].v, part->elastic, &substeps, part->pool);
        if (status != CN_OK) return status;
        for (int i = 0; i < 3 * part->body->body->nnode; i++)
            part->u[i] = s->x[i] - s->from->x[i], part->path[i] = 0;
        if (s->path) cn_drive_add(&part->drive, s->nfree, s->x, part->path, 1, NULL);
    }
    return CN_OK;
}
