/* contact.h - strict unilateral contact between a body's surface and rigid walls: barrier forces that keep
 * the gap positive, a continuous test along each motion that disposes of what the solver proposes, and a
 * check of the accepted state that shares neither with them.
 *
 * Barrier: -kappa (d - gap)^2 ln(d / gap) for distances d < gap between node and triangle, triangle and wall
 * vertex, edge and edge; near-parallel edges mollified (Li et al., Incremental Potential Contact, 2020). */
#ifndef CN_CONTACT_H
#define CN_CONTACT_H

#include <stdbool.h>
#include "catnav/body.h"
#include "catnav/world.h"
#include "matrix.h"
#include "tree.h"

/* A triangulated surface prepared for contact: every vertex and edge is owned by one of its triangles, so
 * that triangle pairs give each pair of primitives once (Curtis et al., I3D 2008). */
typedef struct {
    int ntri, nnode;
    const int *tri; /* node indices (ntri x 3), not owned */
    int nedge;
    int *edge;           /* node indices, ascending (nedge x 2) */
    int *tri_edge;       /* edge k joins corners k and k+1 (ntri x 3) */
    unsigned char *owns; /* bit k: corner k, bit 3+k: edge k (ntri) */
    /* of a wall: edges between coplanar triangles, and corners amid such edges, touch nothing of their own */
    unsigned char *flat;  /* same bits (ntri), NULL: none */
    unsigned char *above; /* same bits: the one triangle that counts for a node right above such a place */
} cn_collider;
/* vert (nnode x 3): of a wall at rest; NULL: a body's, which bends. */
cn_status cn_collider_new(cn_collider **out, int ntri, const int *tri, int nnode, const double *vert);
void cn_collider_free(cn_collider *collider);

typedef enum { CN_PAIR_NODE_TRIANGLE, CN_PAIR_TRIANGLE_VERTEX, CN_PAIR_EDGES } cn_pair_kind;
typedef struct {
    cn_pair_kind kind;
    int wall, triangle; /* of the wall: nodes against triangles only */
    int a[3];           /* body nodes: 1, 3, 2 of them by kind */
    int b[3];           /* wall vertices: 3, 1, 2 by kind */
    double found;       /* distance at `from` [m] */
    double mollify;     /* edges: threshold on |ea x eb|^2 [m^4] */
} cn_pair;

/* What contact needs to know of one body and all walls; fixed in a run. */
typedef struct {
    const cn_body *body;
    const cn_world *world;
    int *tri;              /* of the body's surface, neighbours near each other (ntri x 3) */
    cn_collider *collider; /* over them */
    int ninner, *inner;    /* nodes inside the body: they too must not pass a wall, however it is squeezed */
    cn_collider **wall_collider; /* per wall */
    double **wall_plane;         /* per wall: unit normal and offset of each triangle (ntri x 4) */
    double gap;                  /* distance at which the barrier begins [m] */
    double kappa;                /* barrier stiffness [N/m] */
} cn_contact_model;
cn_status cn_contact_model_new(cn_contact_model **out, const cn_body *body, const cn_world *world, double gap,
                               double kappa);
void cn_contact_model_free(cn_contact_model *model);

/* Seen by tests that share nothing with the response: exact crossings of triangle pairs, and nodes or axis
 * points outside the free space with their depth. */
typedef struct {
    int intersections;                      /* crossing triangle pairs */
    int outside;                            /* nodes and axis points outside */
    double depth;                           /* deepest outside point [m], 0: none */
    int body_triangle, wall, wall_triangle; /* first crossing pair, -1 */
    double where[3];                        /* of the first finding */
} cn_findings;

/* Some hundred triangles that lie together. */
typedef struct {
    int first, ntri; /* of the model's triangles */
    int lowest;      /* node index: a part is left out while this node is in the sheath */
    cn_tree *tree;
    int npair, capacity;
    cn_pair *pair;
} cn_contact_part;

/* Scratch and result of the contact search of one body. Lists have a fixed capacity: a full list is
 * CN_ERR_CONTACT, after which cn_contact_grow makes room between steps. */
typedef struct cn_contact {
    int npair, capacity;
    cn_pair *pair;
    double *distance; /* last evaluated (npair) */
    double *limit;    /* of a motion, per chunk of pairs */
    int npart;        /* parts of the body's surface, each with a tree of its own: searched side by side */
    cn_contact_part *part;
    cn_findings *found; /* per part */
    double *from;       /* positions at which `found` was measured (npoint x 3) */
    double *end;        /* of the motion searched (npoint x 3) */
    bool anchored;      /* the list holds within reach of `from` */
    double reach;       /* [m] */
    double gap_listed;  /* pairs that can come nearer than this are listed [m] */
    int *patch;         /* union-find over wall vertices */
    int *patch_of;      /* first wall vertex of each wall (nwall + 1) */
    double *patch_force;
} cn_contact;
cn_status cn_contact_new(cn_contact **out, const cn_contact_model *model);
void cn_contact_free(cn_contact *contact);
cn_status cn_contact_grow(cn_contact *contact);

/* Here the body's nodes are its points (body.h), and x, dx, f are theirs.
 *
 * Lists every pair that can come nearer than max(gap, listed) while the nodes are within reach of the motion
 * from x to x + dx (NULL: they stay at x). Nodes [0, nfree) take part. */
cn_status cn_contact_find(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                          const double *dx, double reach, double listed, cn_pool *pool);
/* Once the motion has been taken to x: from here on the list holds while no node is farther than reach from
 * x. */
void cn_contact_anchor(const cn_contact_model *model, cn_contact *contact, const double *x, cn_pool *pool);
/* Barrier energy [J] at x; adds the force on the nodes to f (may be NULL) and its stiffness to A (may be
 * NULL): the whole second derivative when exact (mollifier aside), else its positive Gauss-Newton part. Where
 * the points hang on blocks (carry not NULL) A is over those; what comes of the arms' turning is
 * cn_body_pull's. INFINITY when a distance is not positive. */
double cn_contact_add(const cn_contact_model *model, cn_contact *contact, const double *x, double *f,
                      const cn_carry *carry, cn_matrix *a, bool exact, cn_pool *pool);
/* Largest fraction in [0, 1] of the motion dx from x that keeps every pair at least `keep` of its distance
 * apart all along: conservative. The motion must stay within the reach. */
double cn_contact_motion(const cn_contact_model *model, cn_contact *contact, const double *x,
                         const double *dx, double keep, cn_pool *pool);
/* Least distance of the listed pairs as last evaluated [m], INFINITY without pairs. */
double cn_contact_least(const cn_contact *contact);
/* Resultant normal force on the most loaded connected patch of wall [N], where it acts, and its wall. */
double cn_contact_patch_force(const cn_contact_model *model, cn_contact *contact, const double *x,
                              double where[3], int *wall);

/* axis (naxis x 3): further points to be inside. Uses and refits the contact's tree. */
cn_status cn_contact_check(const cn_contact_model *model, cn_contact *contact, int nfree, const double *x,
                           int naxis, const double *axis, cn_findings *findings, cn_pool *pool);

/* The first paper's response (Moss et al. 2008, 4.4): vertices of crossing triangle pairs are moved apart
 * until they no longer cross, at most `passes` times; velocities lose (inelastic) or reverse times
 * `restitution` (elastic) their normal part. Returns the crossing pairs left. */
int cn_contact_project(const cn_contact_model *model, cn_contact *contact, int nfree, double *x, double *v,
                       cn_response response, double restitution, int passes);

#endif
