/* step_parts.h - one stage of a step as a minimum: shared by step.c, which makes stages of an integrator, and
 * step_newton.c, which finds the minimum. */
#ifndef CN_STEP_PARTS_H
#define CN_STEP_PARTS_H

#include "catnav/vec3.h"
#include "sim.h"

struct cn_work {
    const cn_model *model;
    const cn_model_body *body;
    cn_pool *pool;
    cn_matrix *matrix, damping; /* damping shares the pattern; its values only with damping_stiffness */
    cn_scatter *scatter;
    cn_solver *solver;
    cn_contact *contact;
    cn_carry *carry; /* NULL: the points are the nodes */
    cn_drive drive;
    double *memory;
    /* by blocks (nblock x 3): */
    double *u; /* the unknown: x - x0, kept apart so that v = (u - lag) / h carries no round-off of x */
    double *ahead, *lag, *constant; /* of the stage */
    double *trial, *trial_u;        /* line search */
    double *gradient, *elastic, *external, *path, *touch, *dx;
    double *moved, *damped; /* of damping_stiffness */
    double *axis;
    double *spin; /* a rod's inertia in world axes at the step's start (nnode x 9) */
    /* by points (npoint x 3), where they are not the nodes: at x, at the trial, between them, forces */
    double *points, *points_trial, *motion, *points_force;
    bool anchored;                      /* a node is held by the scene */
    unsigned char *held;                /* fixed, or a rod's in the sheath (nblock) */
    double residual_scale, energy_size; /* largest force norm [N]; sum of the energies' sizes [J] */
    double collision_s;
    double forcing;        /* what an iterative solver may leave of the residual */
    double added;          /* inertia that last made the exact tangent positive definite, over M/h^2 */
    bool factored;         /* the solver holds a factor of an earlier iteration, made ... */
    int factored_nfree;    /* ... with this many free nodes */
    double factored_h;     /* ... and this step */
    double *factored_turn; /* ... at these element rotations (nturn x 4) */
};

/* What is fixed while one minimum is sought:
 *     |u - ahead|^2_M / (2 h^2) + |u - lag|^2_C / (2 h) + elastic + drive + contact - (external + constant) .
 * u, u = x - x0, so that the velocity is (u - lag) / h. */
typedef struct {
    cn_work *work;
    const cn_body_state *from; /* x0, v0 */
    double h;
    int nfree, nactive;   /* nodes; nactive: one held station more than nfree */
    int last, again;      /* for EACH_FREE */
    int rows;             /* leading matrix rows that take part */
    double *x, *rotation; /* of the trial */
    bool strict;
    bool free_flight; /* nothing holds, drives or can touch it */
} cn_stage;

/* Blocks i of free nodes: their positions, then a rod's rotations. */
#define EACH_FREE(s, i) for (int i = 0; i < (s)->last; i = i + 1 == (s)->nfree ? (s)->again : i + 1)

/* Takes the stage's start: work->u and s->x as they are, moved by dx (NULL: not) as far as contact lets it.
 */
cn_status cn_stage_start(const cn_stage *s, const double *dx);
/* Contact's force at x into work->touch, of the pairs listed. */
void cn_stage_touch(const cn_stage *s, const double *x);
cn_status cn_stage_minimise(const cn_stage *s, cn_step_figures *figures);
/* Below this the gradient is round-off of the elastic forces: strain carries the round-off of positions, over
 * the elements' size. */
double cn_stage_floor(const cn_stage *s);
/* out = M a of block i, without the factor that `leave_out.inertia` takes. */
static inline void cn_stage_mass(const cn_stage *s, int i, const double a[3], double out[3])
{
    const cn_body *b = s->work->body->body;
    if (i < b->nnode)
        for (int k = 0; k < 3; k++)
            out[k] = b->mass[i] * a[k];
    else
        cn_mat_vec(s->work->spin + 9 * (size_t)(i - b->nnode), a, out);
}
double cn_step_seconds(void);

#endif
