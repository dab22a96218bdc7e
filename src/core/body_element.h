/* body_element.h - elements as the kernels see them: batches of 8, one element a lane, packed in chunks.
 *
 * A chunk is a fixed range of batches, near each other in space; chunks of one colour share no node and run
 * at once, colours follow each other. So every sum has one order, whatever the number of threads. */
#ifndef CN_BODY_ELEMENT_H
#define CN_BODY_ELEMENT_H

#include "body_methods.h"
#include "matrix.h"
#include "pool.h"

enum { CN_LANES = 8, CN_CHUNK_BATCHES = 16, CN_CHUNKS_MAX = 1024 };

typedef struct {
    double grad[9][CN_LANES]; /* gradients of the shape functions of nodes 1..3 [1/m] */
    double volume[CN_LANES];  /* rest volume [m^3], 0 in an empty lane */
    double mu[CN_LANES], lambda[CN_LANES];
    int node[CN_LANES][4];
    int element[CN_LANES]; /* index in the body, -1: an empty lane, a copy of a full one */
    int top_min, top_max;  /* least and largest of the lanes' largest node indices */
    int unused[6];         /* to a multiple of 64 bytes */
} cn_batch;

/* The same of second-order ones, whose constants belong to their points of integration. */
enum { CN_TET10_POINTS = 4 };
typedef struct {
    double grad[CN_TET10_POINTS][9][CN_LANES]; /* of barycentric coordinates 1..3 [1/m] */
    double volume[CN_TET10_POINTS][CN_LANES];  /* that a point stands for [m^3], 0 in an empty lane */
    double mu[CN_LANES], lambda[CN_LANES];
    int node[CN_LANES][10]; /* corners, then amid 01 12 20 03 13 23 */
    int element[CN_LANES], top[CN_LANES];
    int top_min;
    int unused[15]; /* to a multiple of 64 bytes */
} cn_batch10;

typedef struct cn_kernels cn_kernels;
struct cn_element_data {
    int nbatch, nchunk, ncolour;
    int chunk_batches;         /* batches a chunk, the last one may have less */
    cn_batch *batch;           /* (nbatch), aligned to 64 bytes: tet4 */
    cn_batch10 *batch10;       /* the same: tet10 */
    int *order;                /* elements, lane after lane (ntet) */
    int *colour_start;         /* into chunk (ncolour + 1) */
    int *chunk;                /* chunk numbers by colour (nchunk) */
    const cn_kernels *kernels; /* for this processor */
};

/* A scatter's block: row-major over the node pairs of each lane (nbatch * 8 x nper x nper). */

cn_status cn_element_data_new(struct cn_element_data **out, const cn_body *body);
void cn_element_data_free(struct cn_element_data *data); /* NULL is fine */

/* One call of cn_body_add_elastic or cn_body_energy: the same for all chunks. */
typedef struct {
    const cn_body *body;
    int nactive;
    const double *x;
    double *rotation;
    double *f; /* NULL: energy alone */
    cn_tangent tangent;
    double scale;
    const cn_scatter *stiffness; /* NULL: none */
    double *energy;              /* of each chunk */
} cn_elastic_job;

typedef struct {
    double volume_max, stress_max, volume_sum, stress_sum, energy, growth;
    int volume_element, stress_element, inverted;
} cn_chunk_measures;

typedef struct {
    const cn_body *body;
    int nactive;
    const double *x;
    double *rotation;
    bool with_stress;
    double *von_mises; /* NULL: not wanted */
    cn_chunk_measures *chunk;
} cn_measure_job;

/* The kernels for one instruction set; `user` is the job, `i` the chunk. */
struct cn_kernels {
    void (*elastic)(void *user, int i);
    void (*measure)(void *user, int i);
};
/* For instruction sets up to `most` (0: any x86-64 or other, 1: AVX2, 2: AVX-512) that this processor has. */
const cn_kernels *cn_kernels_pick(int most);
const cn_kernels *cn_kernels10_pick(int most); /* of second-order tetrahedra */

/* What tetrahedra of both orders do alike: the methods of body_methods.h (body_element.c). */
cn_status cn_element_bind(cn_scatter *scatter, int first_block);
double cn_element_add_elastic(const cn_body *body, int nactive, const double *x, double *rotation, double *f,
                              cn_tangent tangent, double scale, const cn_scatter *stiffness, cn_pool *pool);
double cn_element_energy(const cn_body *body, int nactive, const double *x, double *rotation, cn_pool *pool);
void cn_element_measure(const cn_body *body, int nactive, const double *x, double *rotation, bool with_stress,
                        cn_measures *measures, double *von_mises, cn_pool *pool);
void cn_element_centre(const cn_body *body, const double *x, int element,
                       double centre[3]); /* of its corners */
void cn_element_free(cn_body *body);

/* What cn_body_new leaves to a model, given tet, mid and rest: connectivity, rest volumes, with the refusal
 * of elements without volume; then lumped masses [kg]. */
cn_status cn_tet4_rest(cn_body *body, cn_error *error);
cn_status cn_tet10_rest(cn_body *body, cn_error *error);
void cn_tet4_mass(cn_body *body, double density);
void cn_tet10_mass(cn_body *body, double density);

/* An element at rest: gradients (3 x 3) of barycentric coordinates 1..3 [1/m] and the volume [m^3] that each
 * of its points of integration stands for. */
void cn_tet10_points(const cn_body *body, int element, double grad[CN_TET10_POINTS][9],
                     double volume[CN_TET10_POINTS]);

#endif
