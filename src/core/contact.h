/* contact.h - strict unilateral contact between surfaces: of bodies that deform, and of rigid walls. Barrier
 * forces keep the gap positive, a continuous test along each motion disposes of what the solver proposes, and
 * a check of the accepted state shares nothing with them.
 *
 * Barrier: -kappa (d - gap)^2 ln(d / gap) for distances d < gap between vertex and triangle, edge and edge;
 * near-parallel edges mollified (Li et al., Incremental Potential Contact, 2020).
 *
 * Points: those of all surfaces in a row, surface s from surface[s].first on; x, dx and f are over them. */
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

/* One surface, fixed in a run. */
typedef struct {
    const cn_body *body; /* NULL: rigid */
    int wall;            /* of the world; -1: of a body that is no wall */
    bool moving;         /* a rigid wall that goes along a path */
    bool self;           /* is tested against itself */
    int first, npoint;
    int ntri, *tri; /* over its own points, neighbours near each other (ntri x 3), owned */
    cn_collider *collider;
    int ninner, *inner; /* points inside the body: they too must not pass a surface, however it is squeezed */
    double *plane;      /* of a rigid wall that rests: unit normal and offset of each triangle (ntri x 4) */
    double *rest;       /* positions at the start of all things [m] (npoint x 3), not owned */
    double gap;         /* distance at which its barrier begins [m]; INFINITY: the other's counts */
    double kappa;       /* barrier stiffness [N/m]; INFINITY: the other's counts */
} cn_contact_surface;

/* What contact needs to know of bodies that are solved together, and all walls; fixed in a run. */
typedef struct {
    const cn_world *world;
    int nsurface;
    cn_contact_surface *surface;
    int npoint;
    double gap; /* the largest at which two of them, or one with itself, meet [m] */
} cn_contact_model;
/* Of a body that deforms; wall >= 0: it stands for that wall of the world, which is no rigid surface then. */
typedef struct {
    const cn_body *body;
    int wall;
    bool self;
    double gap, kappa;
} cn_contact_body;
/* Surfaces: the bodies in their order, then the world's rigid walls. What does not give way is not tested
 * against its like, nor vessels against vessels: their union is free. moving (nwall, NULL: none): walls that
 * go along a path. CN_ERR_ARG: two that may meet have no finite gap or stiffness between them; a wall that is
 * not there, stood for twice, or stood for and moving. */
cn_status cn_contact_model_new(cn_contact_model **out, const cn_world *world, int nbody,
                               const cn_contact_body *body, const unsigned char *moving);
void cn_contact_model_free(cn_contact_model *model);

typedef enum { CN_PAIR_NODE_TRIANGLE, CN_PAIR_EDGES } cn_pair_kind;
/* Two primitives of surface[0] and surface[1]: a node against a triangle, an edge against an edge. */
typedef struct {
    cn_pair_kind kind;
    int surface[2];
    int triangle;   /* node against triangle: of surface[1] */
    int p[4];       /* points: 1 + 3, or 2 + 2 */
    double found;   /* distance at `from` [m] */
    double mollify; /* edges: threshold on |ea x eb|^2 [m^4] */
    double gap;     /* the lesser of the two surfaces'; of a surface with itself at most half the distance
                       at rest */
    double kappa;   /* geometric mean of the two surfaces': what is soft is pressed as hard as what is
                       stiff presses */
} cn_pair;

/* Seen by tests that share nothing with the response: exact crossings of triangle pairs, and nodes or axis
 * points outside the free space with their depth. */
typedef struct {
    int intersections;           /* crossing triangle pairs */
    int outside;                 /* nodes and axis points outside */
    double depth;                /* deepest outside point [m], 0: none */
    int surface[2], triangle[2]; /* first crossing pair, -1 */
    double where[3];             /* of the first finding */
} cn_findings;

/* Some hundred triangles that lie together, of a surface that moves. */
typedef struct {
    int surface;
    int first, ntri; /* of the surface's triangles */
    int lowest;      /* its own point index: the part is left out while this point is in the sheath */
    cn_tree *tree;   /* over the surface's points */
    int npair, capacity;
    cn_pair *pair;
} cn_contact_part;

/* Scratch and result of the search. Lists have a fixed capacity: a full list is CN_ERR_CONTACT, after which
 * cn_contact_grow makes room between steps. */
typedef struct cn_contact {
    int npair, capacity;
    cn_pair *pair;
    double *distance; /* last evaluated (npair) */
    double *limit;    /* of a motion, per chunk of pairs */
    int npart;        /* searched side by side */
    cn_contact_part *part;
    cn_findings *found; /* per part */
    double *from;       /* positions at which `found` was measured (npoint x 3) */
    double *end;        /* of the motion searched (npoint x 3) */
    bool anchored;      /* the list holds within reach of `from` */
    double reach;       /* [m] */
    double gap_listed;  /* pairs that can come nearer than this are listed [m] */
    int *patch;         /* union-find over points */
    double *patch_force;
    struct cn_link
        *link; /* of the last cn_contact_add with stiffness (5 capacity: mollifier's and friction's two) */
    int nlink;
    struct cn_rub *rub; /* where friction acts as last noted (capacity) */
    int nrub;
    double lead;                    /* how hard those that stop are led there: contact_friction.c */
    struct cn_contact_space *space; /* where the free space is while walls bend and move (contact_space.c) */
} cn_contact;
cn_status cn_contact_new(cn_contact **out, const cn_contact_model *model);
void cn_contact_free(cn_contact *contact);
cn_status cn_contact_grow(cn_contact *contact);

/* Lists every pair that can come nearer than max(gap, listed) while the points are within reach of the motion
 * from x to x + dx (NULL: they stay at x). nfree (nsurface): leading points of each surface that take part.
 */
cn_status cn_contact_find(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                          const double *x, const double *dx, double reach, double listed, cn_pool *pool);
/* Once the motion has been taken to x: from here on the list holds while no point is farther than reach from
 * x. */
void cn_contact_anchor(const cn_contact_model *model, cn_contact *contact, const double *x, cn_pool *pool);

/* Where the stiffness of a surface's points goes: point p of the surface is block p, or hangs on the blocks
 * that carry tells (body.h). matrix NULL: it does not give way. */
typedef struct {
    cn_matrix *matrix;
    const cn_carry *carry;
    bool linked; /* the pattern does not join what a triangle's points hang on: all stiffness goes by links */
    int rank;    /* of two that give way the one of the higher rank has none of their links in its matrix */
} cn_hang;
/* Where the nearest points of two primitives are free to slide, and the distance stays least: a parameter
 * each, how it changes r = sum w_i x_i, and how the weights. */
typedef struct {
    int n;
    double along[2][3], weight[2][4];
    double inverse[2][2]; /* of the products of `along` */
} cn_slide;
/* Stiffness that joins two matrices, or two places of one that its pattern does not join: k j j' with
 * j = (w_i n) over the points, and bend times what of the second derivative of d^2/2 is not along n. */
typedef struct cn_link {
    int surface[2];
    int nside;   /* points of the first side: 1 or 2 of the 4 */
    bool own[2]; /* the part of k j j' within this side is in its matrix already */
    int p[4];    /* points */
    double w[4]; /* sum 0 */
    double n[3]; /* unit */
    double k;    /* >= 0 [N/m] */
    double bend; /* <= 0 [N/m] */
    double distance;
    cn_slide slide; /* where bend is not 0 */
} cn_link;
/* f (of the four points) = stiffness times their motions v. */
void cn_link_multiply(const cn_link *link, const double v[4][3], double f[4][3]);
/* A pair that rubs; its link has the normal as n, and as k the bound of the friction, mu N [N]. */
typedef struct cn_rub {
    cn_link link;
    bool stops; /* a motion took its sliding past nothing and back: it is to stick, or slide from there */
    double scratch[4]; /* of who works over the pairs */
} cn_rub;
/* Barrier energy [J] at x; adds the force on the points to f (may be NULL) and its stiffness to the matrices
 * of hang (nsurface; NULL: none). Pairs with something that does not give way: the whole second derivative
 * when exact (of the mollifier the positive part), else its positive Gauss-Newton part. Pairs of which both
 * sides give way: each side's own blocks of the Gauss-Newton part into its matrix (not of a linked one, nor
 * of the higher rank), the rest as a link. What comes of arms' turning is cn_body_pull's. INFINITY when a
 * distance is not positive. */
double cn_contact_add(const cn_contact_model *model, cn_contact *contact, const double *x, double *f,
                      const cn_hang *hang, bool exact, cn_pool *pool);
/* Coulomb's friction (contact_friction.c): notes where and how hard pairs press at x, ... */
void cn_contact_note_friction(const cn_contact_model *model, cn_contact *contact, const double *x,
                              double friction, cn_pool *pool);
/* ... and as noted then, the potential [J] of sliding between `start` and x: added to force, stiffness (all
 * of it positive) and links after cn_contact_add. Sliding by less than `slip` [m] counts as sticking. */
double cn_contact_add_friction(const cn_contact_model *model, cn_contact *contact, const double *x,
                               const double *start, double slip, double *f, const cn_hang *hang);
/* After a motion from x to `to` that was too long: notes which pairs it made slide back, and leads them to a
 * stop from then on; more gently where that does not serve (true where it can be); and once one served. */
void cn_contact_friction_overshot(cn_contact *contact, const double *x, const double *to, const double *start,
                                  double slip);
bool cn_contact_friction_gently(cn_contact *contact);
void cn_contact_friction_served(cn_contact *contact);
/* Largest fraction in [0, 1] of the motion dx from x that keeps every pair at least `keep` of its distance
 * apart all along: conservative. The motion must stay within the reach. */
double cn_contact_motion(const cn_contact_model *model, cn_contact *contact, const double *x,
                         const double *dx, double keep, cn_pool *pool);
/* Least distance of the listed pairs as last evaluated [m], INFINITY without pairs; of a surface with itself
 * where it is nearer than the gap. surface >= 0: of its pairs alone. */
double cn_contact_least(const cn_contact *contact, int surface);
/* True where a listed pair is nearer than its gap. */
bool cn_contact_touches(const cn_contact *contact);
/* Resultant of the barrier on the most loaded connected patch that touches this surface [N], where it acts,
 * and the other surface. */
double cn_contact_patch_force(const cn_contact_model *model, cn_contact *contact, int surface,
                              const double *x, double where[3], int *other);

/* axis (naxis x 3): further points to be inside the free space. nfree as above; x (npoint x 3). Counts
 * crossings of all surfaces that move with each other, with walls and with themselves; points of bodies and
 * the axis outside the free space, and bodies inside others. Uses and refits the contact's trees. */
cn_status cn_contact_check(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                           const double *x, int naxis, const double *axis, cn_findings *findings,
                           cn_pool *pool);

/* The first paper's response (Moss et al. 2008, 4.4): vertices of crossing triangle pairs are moved apart
 * until they no longer cross, at most `passes` times; velocities lose (inelastic) or reverse times
 * `restitution` (elastic) their normal part. mass (npoint) [kg]: INFINITY: the point does not give way.
 * Returns the crossing pairs left. */
int cn_contact_project(const cn_contact_model *model, cn_contact *contact, const int *nfree,
                       const double *mass, double *x, double *v, cn_response response, double restitution,
                       int passes);

/* Egger's response (contact_penalty.c): `point` of surface, the deepest of those next to `node` of its body,
 * is to be pushed by surface `other` out along n, from `depth` inside. */
typedef struct {
    int surface, other, node, point;
    double n[3];  /* unit */
    double depth; /* > 0 [m] */
} cn_penalty_spring;
typedef struct {
    int nspring, capacity;
    cn_penalty_spring *spring;
    int nlink; /* of springs on what hangs on nodes that no matrix joins */
    cn_link *link;
    struct cn_penalty_scratch *scratch;
} cn_penalty;
/* Model and contact must outlive it. */
cn_status cn_penalty_new(cn_penalty **out, const cn_contact_model *model, cn_contact *contact);
void cn_penalty_free(cn_penalty *penalty);
cn_status cn_penalty_grow(cn_penalty *penalty); /* after CN_ERR_CONTACT */
/* The pushes at x (npoint x 3), every body against every other surface; none of a body on itself. nfree as
 * above. Refits the contact's trees. CN_ERR_CONTACT: a list is full. */
cn_status cn_penalty_find(cn_penalty *penalty, const int *nfree, const double *x, cn_pool *pool);
/* Faces of surface a (a body's) that cross surface b, ncross of them, then those immersed in it: nface in
 * all, valid until the next call. */
cn_status cn_penalty_faces(cn_penalty *penalty, const int *nfree, const double *x, int a, int b, int *ncross,
                           int *nface, const int **face);

#endif
