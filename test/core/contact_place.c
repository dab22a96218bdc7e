#include "contact_place.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include "catnav/vec3.h"

void place_world(place *p, const cn_surface *given)
{
    const cn_replacement replacement = {"", given};
    cn_error error = {0};
    p->scene.vessel = &p->vessel, p->scene.obstacle = &p->obstacle;
    p->vessel.shape.placement.scale = p->obstacle.shape.placement.scale = 1;
    if (cn_world_new(&p->world, &p->scene, given ? 1 : 0, &replacement, &error) != CN_OK)
        fail_msg("%s", error.message);
}

void place_bodies(place *p, int nbody, cn_tets *const *mesh)
{
    const cn_material material = {.young = 1e6, .poisson = 0.3, .density = 1000};
    cn_error error = {0};
    for (; p->nbody < nbody; p->nbody++)
        assert_int_equal(cn_body_new(&p->body[p->nbody], mesh[p->nbody], &material, NULL, &error), CN_OK);
}

void place_contact(place *p, int nbody, const cn_contact_body *body, const unsigned char *moving)
{
    assert_int_equal(cn_contact_model_new(&p->model, p->world, nbody, body, moving), CN_OK);
    assert_int_equal(cn_contact_new(&p->contact, p->model), CN_OK);
    p->x = malloc(3 * (size_t)p->model->npoint * sizeof *p->x);
    for (int s = 0; s < p->model->nsurface; s++) {
        const cn_contact_surface *surface = &p->model->surface[s];
        p->nfree[s] = surface->npoint;
        memcpy(p->x + 3 * surface->first, surface->rest, 3 * (size_t)surface->npoint * sizeof *p->x);
    }
}

void place_make(place *p, int nbody, cn_tets *const *mesh, double half, double gap, bool self)
{
    memset(p, 0, sizeof *p);
    p->vessel.shape.kind = CN_SHAPE_BOX;
    for (int k = 0; k < 3; k++)
        p->vessel.shape.box.min[k] = -half, p->vessel.shape.box.max[k] = half;
    p->scene.nvessel = half > 0;
    place_world(p, NULL);
    place_bodies(p, nbody, mesh);
    const cn_contact_body body[2] = {{p->body[0], -1, self, gap, 1e3},
                                     {p->body[1], -1, self, 0.8 * gap, 2e3}};
    place_contact(p, nbody, body, NULL);
}

void place_free(place *p)
{
    free(p->x);
    cn_contact_free(p->contact), cn_contact_model_free(p->model);
    for (int b = 0; b < p->nbody; b++)
        cn_body_free(p->body[b]);
    cn_world_free(p->world);
}

double *place_points(place *p, int surface)
{
    return p->x + 3 * p->model->surface[surface].first;
}

void place_shift(place *p, int surface, double dx, double dy, double dz)
{
    const double d[3] = {dx, dy, dz};
    for (int i = 0; i < p->model->surface[surface].npoint; i++)
        cn_axpy(1, d, place_points(p, surface) + 3 * i);
}

void place_turn(place *p, int surface, const double r[9])
{
    for (int i = 0; i < p->model->surface[surface].npoint; i++) {
        double y[3];
        cn_mat_vec(r, place_points(p, surface) + 3 * i, y);
        cn_copy3(y, place_points(p, surface) + 3 * i);
    }
}

void place_find(place *p, const double *dx, double reach)
{
    cn_status status;
    while ((status = cn_contact_find(p->model, p->contact, p->nfree, p->x, dx, reach, 0, NULL)) ==
           CN_ERR_CONTACT)
        assert_int_equal(cn_contact_grow(p->contact), CN_OK);
    assert_int_equal(status, CN_OK);
}

double place_add(place *p, double *f)
{
    return cn_contact_add(p->model, p->contact, p->x, f, NULL, false, NULL);
}

cn_findings place_check(place *p)
{
    cn_findings found;
    assert_int_equal(cn_contact_check(p->model, p->contact, p->nfree, p->x, 0, NULL, &found, NULL), CN_OK);
    return found;
}

void place_gradient_is_right(place *p, double h, double tolerance)
{
    const int n = 3 * p->model->npoint;
    double *f = calloc((size_t)n, sizeof *f), largest = 0;
    place_find(p, NULL, 10 * h);
    assert_true(p->contact->npair > 0);
    assert_true(place_add(p, f) > 0);
    for (int i = 0; i < n; i++)
        largest = fmax(largest, fabs(f[i]));
    assert_true(largest > 0);
    for (int s = 0; s < p->nbody; s++)
        for (int i = 3 * p->model->surface[s].first; i < 3 * (p->model->surface[s].first + p->nfree[s]);
             i++) {
            const double xi = p->x[i];
            p->x[i] = xi + h;
            const double up = place_add(p, NULL);
            p->x[i] = xi - h;
            const double down = place_add(p, NULL);
            p->x[i] = xi;
            assert_true(fabs(f[i] + (up - down) / (2 * h)) < tolerance * largest);
        }
    free(f);
}
