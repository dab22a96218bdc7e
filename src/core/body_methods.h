/* body_methods.h - what a body model brings along; body.c hands on to them. */
#ifndef CN_BODY_METHODS_H
#define CN_BODY_METHODS_H

#include "catnav/body.h"
#include "matrix.h"
#include "pool.h"

struct cn_scatter {
    cn_matrix *matrix;
    const cn_body *body;
    int *block; /* indices of matrix blocks in the model's own order */
};

/* Semantics as of the calls in body.h that bear their names; NULL where the model has nothing to do (points,
 * carry, pull, turn of bodies whose points are their nodes). */
typedef struct cn_body_methods {
    cn_status (*bind)(cn_scatter *scatter, int first_block); /* fills scatter->block */
    double (*add_elastic)(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                          cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool);
    double (*energy)(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool);
    void (*measure)(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                    cn_measures *measures, double *von_mises, cn_pool *pool);
    void (*element_centre)(const cn_body *body, const double *x, int element, double centre[3]);
    void (*rotation_start)(const cn_body *body, double *rotation);
    void (*points)(const cn_body *body, int nactive, const double *x, const double *rotation, double *points);
    void (*carry)(const cn_body *body, int nactive, const double *x, const double *rotation, cn_carry *carry);
    void (*pull)(const cn_body *body, int nactive, const double *x, const double *rotation,
                 const cn_carry *carry, const double *force, double *f, double scale, cn_matrix *a);
    void (*turn)(const cn_body *body, int nactive, double *x, double *rotation);
    void (*face_shares)(const cn_body *body, const unsigned char *inside, double *share); /* NULL: linear */
    void (*free_own)(cn_body *body); /* body->own and what the model alone has */
} cn_body_methods;

/* The models; each is set by its constructor. */
extern const cn_body_methods cn_body_tet4, cn_body_tet10, cn_body_rod, cn_body_molecules, cn_body_wall;

/* body.c, for the constructors: refuses what no model takes, values named. */
cn_status cn_body_check_material(const cn_material *material, bool has_along, cn_error *error);
cn_status cn_body_check_mesh(const cn_tets *mesh, cn_error *error);
/* Young's modulus of an element with this centre, `along` [m] from the tip (NAN: shapes without an axis). */
double cn_material_young(const cn_material *material, const double centre[3], double along);
/* A maximum once not a number stays so; of equal ones the element with the least index counts. */
void cn_keep_largest(double value, int element, double *max, int *at);

#endif
