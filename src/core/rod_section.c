/* rod_section.c - sections of catheters and beams: stiffness, mass, and where twist shears them. */
#include "rod.h"

#include <math.h>
#include "catnav/vec3.h"

static const double pi = 3.14159265358979323846;

double cn_rectangle_torsion(double a, double b)
{
    if (a < b) return cn_rectangle_torsion(b, a);
    double sum = 1.00452376279513962; /* of 1/k^5 over odd k; tanh falls short of 1 by little */
    for (int k = 1; k < 20; k += 2)
        sum -= 2 / (1 + exp(k * pi * a / b)) / pow(k, 5);
    return a * b * b * b * (1.0 / 3 - 64 * b / (pow(pi, 5) * a) * sum);
}

/* Shear strain along x and y per twist rate of the rectangle |x| <= a, |y| <= b, a <= b: Saint-Venant's
 * series (Timoshenko and Goodier, section 109). At y = b its terms fall with n^2 alone:
 * 100 of them leave half a percent. */
static void rectangle_shear(double a, double b, double x, double y, double shear[2])
{
    double sx = 0, sy = 0;
    for (int n = 1, sign = 1; n < 200; n += 2, sign = -sign) {
        const double w = n * pi / (2 * a), up = exp(w * (fabs(y) - b)), down = exp(-w * (fabs(y) + b));
        const double whole = 1 + exp(-2 * w * b); /* cosh and sinh over cosh(w b), free of overflow */
        const double c = (up + down) / whole, s = copysign((up - down) / whole, y),
                     weight = sign / (double)(n * n);
        sx -= weight * s * cos(w * x);
        sy -= weight * c * sin(w * x);
    }
    const double factor = 16 * a / (pi * pi);
    shear[0] = factor * sx;
    shear[1] = 2 * x + factor * sy;
}

void cn_section_twist_stress(const cn_section *s, const double place[2], double shear[2])
{
    if (s->round) {
        shear[0] = -s->twist_stress * place[1] / s->half[0];
        shear[1] = s->twist_stress * place[0] / s->half[0];
        return;
    }
    const double g = s->young / (2 * (1 + s->poisson));
    if (s->half[0] <= s->half[1]) {
        rectangle_shear(s->half[0], s->half[1], place[0], place[1], shear);
        shear[0] *= g, shear[1] *= g;
    } else { /* turned by a quarter: x = place[1], y = -place[0] */
        double turned[2];
        rectangle_shear(s->half[1], s->half[0], place[1], -place[0], turned);
        shear[0] = -g * turned[1], shear[1] = g * turned[0];
    }
}

/* A tube (inner 0: a solid) added to the section. Cowper, J. Appl. Mech. 33 (1966). */
static void add_tube(cn_section *s, double outer, double inner, double young, double poisson, double density)
{
    const double area = pi / 4 * (outer - inner) * (outer + inner);
    const double moment = area / 16 * (outer * outer + inner * inner), m = inner / outer, m2 = m * m;
    const double square = (1 + m2) * (1 + m2), shear = young / (2 * (1 + poisson));
    const double k = 6 * (1 + poisson) * square / ((7 + 6 * poisson) * square + (20 + 12 * poisson) * m2);
    s->axial += young * area;
    s->torsion += shear * 2 * moment;
    s->line_mass += density * area;
    s->line_inertia[2] += density * 2 * moment;
    for (int i = 0; i < 2; i++) {
        s->shear[i] += k * shear * area;
        s->bending[i] += young * moment;
        s->line_inertia[i] += density * moment;
    }
}

static void catheter_section(cn_section *s, const cn_shape *shape, const cn_material *m, double young)
{
    const double d = shape->catheter.diameter, inner = shape->catheter.inner_diameter;
    add_tube(s, d, inner, young, m->poisson, m->density);
    if (shape->catheter.has_core)
        add_tube(s, shape->catheter.core_diameter, 0, shape->catheter.core_young,
                 shape->catheter.core_poisson, shape->catheter.core_density);
    s->area = pi / 4 * (d - inner) * (d + inner), s->round = true, s->half[0] = s->half[1] = d / 2;
    s->twist_stress = young / (2 * (1 + m->poisson)) * d / 2;
}

static void beam_section(cn_section *s, const cn_shape *shape, const cn_material *m, double young)
{
    const double a = shape->beam.size[1], b = shape->beam.size[2], area = a * b;
    const double shear = young / (2 * (1 + m->poisson)), k = 10 * (1 + m->poisson) / (12 + 11 * m->poisson);
    const double moment[3] = {area * b * b / 12, area * a * a / 12, area * (a * a + b * b) / 12};
    s->axial = young * area, s->torsion = shear * cn_rectangle_torsion(a, b);
    s->line_mass = m->density * area, s->area = area, s->half[0] = a / 2, s->half[1] = b / 2;
    for (int i = 0; i < 2; i++)
        s->shear[i] = k * shear * area, s->bending[i] = young * moment[i];
    for (int i = 0; i < 3; i++)
        s->line_inertia[i] = m->density * moment[i];
    const double edge[2] = {a <= b ? a / 2 : 0, a <= b ? 0 : b / 2}; /* amid the longer side */
    double worst[2];
    cn_section_twist_stress(s, edge, worst);
    s->twist_stress = hypot(worst[0], worst[1]);
}

cn_status cn_section_of(cn_section *out, const cn_shape *shape, const cn_material *material, double young,
                        cn_error *error)
{
    cn_section s = {.young = young, .poisson = material->poisson};
    cn_material checked = *material;
    checked.young = young, checked.nregion = 0;
    const cn_status status = cn_body_check_material(&checked, true, error);
    if (status != CN_OK) return status;
    if (shape->kind == CN_SHAPE_CATHETER)
        catheter_section(&s, shape, material, young);
    else if (shape->kind == CN_SHAPE_BEAM)
        beam_section(&s, shape, material, young);
    else
        return cn_fail(error, CN_ERR_ARG, "", 0, "only a catheter or a beam has a section");
    *out = s;
    return CN_OK;
}
