/* world_fit.c - is the lumen of a size that goes with the device? A mesh in the wrong unit shows here. */
#include "catnav/world.h"

#include <stdlib.h>
#include <string.h>

static int by_value(const void *p, const void *q)
{
    const double a = *(const double *)p, b = *(const double *)q;
    return (a > b) - (a < b);
}

cn_status cn_world_fits(const cn_world *world, double diameter, cn_error *error)
{
    const double *x, *clearance;
    const int n = world->map ? cn_map_ridge(world->map, &x, &clearance) : 0;
    if (n == 0 || world->nvessel == 0) return CN_OK;
    double *sorted = malloc((size_t)n * sizeof *sorted);
    if (!sorted) return CN_ERR_MEMORY;
    memcpy(sorted, clearance, (size_t)n * sizeof *sorted);
    qsort(sorted, (size_t)n, sizeof *sorted, by_value);
    const double lumen = 2 * sorted[n / 2], ratio = lumen / diameter;
    free(sorted);
    if (ratio >= 0.5 && ratio <= 200) return CN_OK;
    return cn_fail(
        error, CN_FAULT_UNIT, NULL, 0,
        "the lumen's median diameter is %.4g m, %.3g times the device's %.4g m: expected 0.5 to 200 times; "
        "check the unit of the mesh (`scale`; a message is in metres)",
        lumen, ratio, diameter);
}
