/* mesh_report.c - the doctor's words: refusals, the table, the JSON object. */
#include <jansson.h>
#include <stdarg.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

void cn_guess_unit(double size, char text[64])
{
    const char *guess = "metres";
    if (size > 10) guess = "looks like millimetres: try scale 0.001";
    if (size > 10000) guess = "looks like micrometres: try scale 1e-6";
    if (size < 0.002) guess = "very small for metres: is the scale applied twice?";
    snprintf(text, 64, "%s", guess);
}

/* --- refusals --- */

/* What no use of a surface can bear: its orientation or its triangles mean nothing. */
static cn_status refuse_broken(const cn_doctor *d, const char *name, cn_error *error)
{
    if (d->degenerate)
        return cn_fail(error, CN_FAULT_DEGENERATE, NULL, 0,
                       "%s: %d triangle%s without area, the first is triangle %d: collapse its shortest edge",
                       name, d->degenerate, d->degenerate == 1 ? "" : "s", d->first_degenerate);
    if (d->duplicate)
        return cn_fail(error, CN_FAULT_DUPLICATE, NULL, 0,
                       "%s: %d triangle%s twice, the first pair is %d and %d: remove one", name, d->duplicate,
                       d->duplicate == 1 ? " stands" : "s stand", d->first_duplicate[0],
                       d->first_duplicate[1]);
    if (d->nonmanifold_edges)
        return cn_fail(
            error, CN_FAULT_NON_MANIFOLD, NULL, 0,
            "%s: %d edge%s of more than two triangles, the first joins vertices %d and %d: inside and "
            "outside are not defined there; remove the inner sheets",
            name, d->nonmanifold_edges, d->nonmanifold_edges == 1 ? "" : "s", d->first_nonmanifold[0],
            d->first_nonmanifold[1]);
    if (d->mixed_edges)
        return cn_fail(
            error, CN_FAULT_TURNED, NULL, 0,
            "%s: mixed orientation over %d edge%s, the first between triangles %d and %d: make the normals "
            "consistent",
            name, d->mixed_edges, d->mixed_edges == 1 ? "" : "s", d->first_mixed[0], d->first_mixed[1]);
    if (d->mixed_components)
        return cn_fail(error, CN_FAULT_TURNED, NULL, 0,
                       "%s: mixed orientation, %d of its %d parts the other way round than the rest, one of "
                       "them that of "
                       "triangle %d: turn its normals",
                       name, d->mixed_components, d->components, d->first_mixed_component);
    return CN_OK;
}

static void list_pairs(const cn_doctor *d, char *text, size_t size)
{
    const int n = d->crossing_pairs < 6 ? d->crossing_pairs : 6;
    size_t used = 0;

    text[0] = 0;
    for (int i = 0; i < n && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%d-%d", i ? ", " : "", d->crossing[i][0],
                                 d->crossing[i][1]);
    if (d->crossing_pairs > n && used < size) snprintf(text + used, size - used, " ...");
}

cn_status cn_doctor_wall(const cn_doctor *d, const char *name, cn_error *error)
{
    char pairs[160];
    const cn_status status = refuse_broken(d, name, error);

    if (status != CN_OK) return status;
    list_pairs(d, pairs, sizeof pairs);
    if (d->crossing_pairs)
        CN_LOG(CN_LOG_WARNING, "%s: %d pair%s of triangles cross (%s): all are kept as walls", name,
               d->crossing_pairs, d->crossing_pairs == 1 ? "" : "s", pairs);
    return CN_OK;
}

cn_status cn_doctor_solid(const cn_doctor *d, const char *name, cn_error *error)
{
    char pairs[160];
    const cn_status status = refuse_broken(d, name, error);

    if (status != CN_OK) return status;
    if (!d->closed)
        return cn_fail(error, CN_FAULT_OPEN, NULL, 0,
                       "%s: open, with %d boundary loop%s, the first %.3g across at (%.4g, %.4g, %.4g): "
                       "close it, only a "
                       "closed surface can be filled",
                       name, d->loops, d->loops == 1 ? "" : "s", d->loop_diameter[0], d->loop_centre[0][0],
                       d->loop_centre[0][1], d->loop_centre[0][2]);
    if (d->crossing_pairs) {
        list_pairs(d, pairs, sizeof pairs);
        return cn_fail(
            error, CN_FAULT_CROSSING, NULL, 0,
            "%s: %d pair%s of triangles cross (%s): move their vertices apart, a surface that crosses itself "
            "cannot be filled",
            name, d->crossing_pairs, d->crossing_pairs == 1 ? "" : "s", pairs);
    }
    if (d->nonmanifold_vertices)
        return cn_fail(
            error, CN_FAULT_NON_MANIFOLD, NULL, 0,
            "%s: %d vert%s where several sheets meet in a point, the first is vertex %d: part them", name,
            d->nonmanifold_vertices, d->nonmanifold_vertices == 1 ? "ex" : "ices",
            d->first_nonmanifold_vertex);
    if (!(d->volume > 0))
        return cn_fail(error, CN_FAULT_TURNED, NULL, 0,
                       "%s: encloses a volume of %g: turn its normals outward", name, d->volume);
    return CN_OK;
}

cn_status cn_doctor_usable(const cn_doctor *d, const char *name, cn_error *error)
{
    return d->closed ? cn_doctor_solid(d, name, error) : refuse_broken(d, name, error);
}

static const char *orientation(const cn_doctor *d)
{
    if (d->mixed_edges || d->mixed_components) return "mixed";
    if (d->turned) return "inward, turned outward";
    return d->volume > 0 ? "outward" : d->volume < 0 ? "inward" : "undefined";
}

/* --- text --- */

/* A stream into memory; finish() closes it and hands the string over. */
typedef struct {
    FILE *file;
    char *text;
    size_t size;
} page;

static char *finish(page *p)
{
    if (!p->file) return NULL;
    const bool failed = ferror(p->file) != 0;
    if (fclose(p->file) || failed) {
        free(p->text);
        return NULL;
    }
    return p->text;
}

static void row(page *p, const char *name, const char *format, ...) __attribute__((format(printf, 3, 4)));
static void row(page *p, const char *name, const char *format, ...)
{
    va_list arguments;
    fprintf(p->file, "  %-22s ", name);
    va_start(arguments, format);
    vfprintf(p->file, format, arguments);
    va_end(arguments);
    fputc('\n', p->file);
}

static void verdict(page *p, const char *use, cn_status status, const cn_error *error)
{
    if (status == CN_OK)
        row(p, use, "usable");
    else
        row(p, use, "refused: %s", error->message);
}

char *cn_doctor_text(const cn_doctor *d, const char *name)
{
    page p = {0};
    cn_error wall = {0}, solid = {0};
    char pairs[160];

    if (!(p.file = open_memstream(&p.text, &p.size))) return NULL;
    fprintf(p.file, "%s\n", name);
    row(&p, "vertices", "%d (%d duplicates merged, %d unused)", d->nvert, d->merged, d->unused);
    row(&p, "triangles", "%d (%d degenerate, %d duplicate, %d slivers)", d->ntri, d->degenerate, d->duplicate,
        d->slivers);
    row(&p, "box [m]", "%.6g %.6g %.6g .. %.6g %.6g %.6g", d->min[0], d->min[1], d->min[2], d->max[0],
        d->max[1], d->max[2]);
    row(&p, "size [m]", "%.6g (%s)", d->size, d->unit_guess);
    row(&p, "closed", "%s", d->closed ? "yes" : "no");
    if (d->loops) row(&p, "boundary loops", "%d", d->loops);
    for (int i = 0; i < d->loops && i < CN_DOCTOR_LISTED; i++)
        row(&p, "", "loop %d: %.4g across, %d edges, at (%.4g, %.4g, %.4g)", i, d->loop_diameter[i],
            d->loop_edges[i], d->loop_centre[i][0], d->loop_centre[i][1], d->loop_centre[i][2]);
    row(&p, "components", "%d", d->components);
    if (d->genus >= 0) row(&p, "genus", "%d", d->genus);
    row(&p, "manifold", "%s (%d edges of more than two triangles, %d pinched vertices)",
        d->manifold ? "yes" : "no", d->nonmanifold_edges, d->nonmanifold_vertices);
    row(&p, "orientation", "%s", orientation(d));
    row(&p, "volume [m^3]", "%.6g%s", d->volume, d->closed ? "" : " (loops closed by fans)");
    list_pairs(d, pairs, sizeof pairs);
    row(&p, "crossing pairs", "%d%s%s", d->crossing_pairs, d->crossing_pairs ? ": " : "", pairs);
    verdict(&p, "as a wall", refuse_broken(d, name, &wall), &wall);
    verdict(&p, "as a body to fill", cn_doctor_solid(d, name, &solid), &solid);
    return finish(&p);
}

char *cn_tets_doctor_text(const cn_tets_doctor *d, const char *name, const cn_error *refusal)
{
    page p = {0};

    if (!(p.file = open_memstream(&p.text, &p.size))) return NULL;
    fprintf(p.file, "%s\n", name);
    row(&p, "nodes", "%d (%d unused)", d->nnode, d->unused);
    row(&p, "tetrahedra", "%d (%d inverted, %d flat, %d slivers)", d->ntet, d->inverted, d->flat, d->slivers);
    row(&p, "box [m]", "%.6g %.6g %.6g .. %.6g %.6g %.6g", d->min[0], d->min[1], d->min[2], d->max[0],
        d->max[1], d->max[2]);
    row(&p, "size [m]", "%.6g (%s)", d->size, d->unit_guess);
    row(&p, "components", "%d", d->components);
    row(&p, "boundary triangles", "%d (%d faces of more than two tetrahedra)", d->boundary,
        d->nonmanifold_faces);
    row(&p, "volume [m^3]", "%.6g (one: %.4g .. %.4g)", d->volume, d->volume_min, d->volume_max);
    row(&p, "dihedral angle [deg]", "%.4g (tetrahedron %d) .. %.4g (tetrahedron %d)", d->dihedral_min,
        d->dihedral_min_tet, d->dihedral_max, d->dihedral_max_tet);
    row(&p, "quality, 1 is regular", "worst %.4g (tetrahedron %d), mean %.4g", d->quality_min,
        d->quality_min_tet, d->quality_mean);
    row(&p, "aspect, 1 is regular", "worst %.4g (tetrahedron %d)", d->aspect_max, d->aspect_max_tet);
    verdict(&p, "as a body", refusal ? refusal->status : CN_OK, refusal);
    return finish(&p);
}

/* --- JSON: undefined and infinite figures are null --- */

static json_t *real(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}
static json_t *vector(const double v[3])
{
    return json_pack("[ooo]", real(v[0]), real(v[1]), real(v[2]));
}
static json_t *sentence(cn_status status, const cn_error *error)
{
    return status == CN_OK ? json_string("usable") : json_sprintf("refused: %s", error->message);
}

static char *dump(json_t *object)
{
    char *text = object ? json_dumps(object, JSON_INDENT(2) | JSON_PRESERVE_ORDER) : NULL;
    json_decref(object);
    return text;
}

static json_t *loop_list(const cn_doctor *d)
{
    json_t *list = json_array();
    for (int i = 0; list && i < d->loops && i < CN_DOCTOR_LISTED; i++)
        json_array_append_new(list, json_pack("{so si so}", "diameter", real(d->loop_diameter[i]), "edges",
                                              d->loop_edges[i], "centre", vector(d->loop_centre[i])));
    return list;
}

static json_t *pair_list(const cn_doctor *d)
{
    json_t *list = json_array();
    for (int i = 0; list && i < d->crossing_pairs && i < CN_DOCTOR_LISTED; i++)
        json_array_append_new(list, json_pack("[ii]", d->crossing[i][0], d->crossing[i][1]));
    return list;
}

char *cn_doctor_json(const cn_doctor *d, const char *name)
{
    cn_error wall = {0}, solid = {0}, use = {0};
    const cn_status as_wall = refuse_broken(d, name, &wall), as_solid = cn_doctor_solid(d, name, &solid);
    const cn_status usable = cn_doctor_usable(d, name, &use);
    const bool mixed = d->mixed_edges || d->mixed_components;

    return dump(json_pack(
        "{ss ss ss si si si si si si si so si so sb sb sb ss sb so si so si si si so so so ss so so}", "mesh",
        name, "kind", "surface", "check", usable == CN_OK ? "usable" : "refused", "vertices", d->nvert,
        "triangles", d->ntri, "merged", d->merged, "unused", d->unused, "degenerate", d->degenerate,
        "duplicate", d->duplicate, "loops", d->loops, "loop", loop_list(d), "components", d->components,
        "genus", d->genus < 0 ? json_null() : json_integer(d->genus), "closed", d->closed, "manifold",
        d->manifold, "oriented", d->oriented && !d->mixed_components, "orientation",
        mixed                        ? "mixed"
        : d->turned || d->volume < 0 ? "inward"
        : d->volume > 0              ? "outward"
                                     : "undefined",
        "turned", d->turned, "volume", real(d->volume), "crossing_pairs", d->crossing_pairs, "crossing",
        pair_list(d), "nonmanifold_edges", d->nonmanifold_edges, "nonmanifold_vertices",
        d->nonmanifold_vertices, "slivers", d->slivers, "min", vector(d->min), "max", vector(d->max), "size",
        real(d->size), "unit_guess", d->unit_guess, "wall", sentence(as_wall, &wall), "solid",
        sentence(as_solid, &solid)));
}

char *cn_tets_doctor_json(const cn_tets_doctor *d, const char *name, const cn_error *refusal)
{
    const cn_status status = refusal ? refusal->status : CN_OK;

    return dump(json_pack(
        "{ss ss ss si si si si si si si si si so so so so so so so so so si so so so ss so}", "mesh", name,
        "kind", "tetrahedra", "check", status == CN_OK ? "usable" : "refused", "nodes", d->nnode,
        "tetrahedra", d->ntet, "unused", d->unused, "inverted", d->inverted, "flat", d->flat, "slivers",
        d->slivers, "nonmanifold_faces", d->nonmanifold_faces, "components", d->components,
        "boundary_triangles", d->boundary, "volume", real(d->volume), "volume_min", real(d->volume_min),
        "volume_max", real(d->volume_max), "dihedral_min", real(d->dihedral_min), "dihedral_max",
        real(d->dihedral_max), "quality_min", real(d->quality_min), "quality_mean", real(d->quality_mean),
        "aspect_max", real(d->aspect_max), "size", real(d->size), "worst_tetrahedron", d->quality_min_tet,
        "min", vector(d->min), "max", vector(d->max), "dihedral_of",
        json_pack("[ii]", d->dihedral_min_tet, d->dihedral_max_tet), "unit_guess", d->unit_guess, "body",
        sentence(status, refusal)));
}
