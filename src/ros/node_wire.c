/* node_wire.c - a catnav/SurfaceMesh as it comes over the wire, looked at without a copy.
 *
 * Little-endian, one after the other: header (seq uint32, stamp 2 uint32, frame_id), name, triangles (count,
 * 3 uint32 each), vertices (count, 3 float64 each); a text is its length (uint32) and its bytes. No length is
 * believed beyond the bytes that are there: what is made of a message is never larger than the message. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "node_parts.h"

typedef struct {
    const uint8_t *at;
    size_t left;
    bool over; /* something was asked for that is not there */
} wire;

/* The next n times `size` bytes; NULL where they are not there. */
static const uint8_t *take(wire *w, size_t n, size_t size)
{
    if (w->over || n > w->left / size) {
        w->over = true;
        return NULL;
    }
    const uint8_t *const at = w->at;
    w->at += n * size, w->left -= n * size;
    return at;
}

static uint32_t take_count(wire *w)
{
    uint32_t count = 0;
    const uint8_t *at = take(w, 1, sizeof count);
    if (at) memcpy(&count, at, sizeof count);
    return count;
}

/* False where the text does not fit or holds a zero byte. */
static bool take_text(wire *w, size_t size, char *text)
{
    const uint32_t length = take_count(w);
    const uint8_t *at = take(w, length, 1);
    if (!at || length >= size || memchr(at, 0, length)) return false;
    memcpy(text, at, length);
    text[length] = 0;
    return true;
}

cn_status mesh_look(came_mesh *mesh, size_t size, const uint8_t *bytes, cn_error *error)
{
    wire w = {bytes, size, false};
    take_count(&w); /* seq */
    const uint32_t seconds = take_count(&w), nanoseconds = take_count(&w);
    const bool framed = take_text(&w, sizeof mesh->frame, mesh->frame);
    const bool named = take_text(&w, sizeof mesh->name, mesh->name);

    mesh->stamp = seconds * UINT64_C(1000000000) + nanoseconds;
    mesh->ntri = take_count(&w);
    mesh->tri = take(&w, mesh->ntri, 3 * sizeof(uint32_t));
    mesh->nvert = take_count(&w);
    mesh->vert = take(&w, mesh->nvert, 3 * sizeof(double));
    if (w.over || w.left)
        return cn_fail(
            error, CN_FAULT_NO_PARTS, "", 0,
            "a message of %zu bytes is not a catnav/SurfaceMesh: what it counts is not what it holds; send "
            "one as catnav/SurfaceMesh.msg says",
            size);
    if (!framed || !named)
        return cn_fail(
            error, CN_ERR_MESH, "", 0,
            "the mesh's frame_id or name holds a zero byte or is too long: at most %zu and %zu bytes",
            sizeof mesh->frame - 1, sizeof mesh->name - 1);
    return CN_OK;
}

cn_status mesh_unpack(const came_mesh *mesh, cn_surface **out, cn_error *error)
{
    const char *const name = mesh->name[0] ? mesh->name : "artery mesh";
    cn_status status;

    *out = NULL;
    if (mesh->nvert == 0 || mesh->ntri == 0)
        return cn_fail(error, CN_FAULT_NO_PARTS, "", 0, "%s: empty: %zu vertices, %zu triangles", name,
                       mesh->nvert, mesh->ntri);
    if (mesh->nvert > INT_MAX / 3 || mesh->ntri > INT_MAX / 3)
        return cn_fail(error, CN_ERR_MESH, "", 0, "%s: more than %d vertices or triangles", name,
                       INT_MAX / 3);
    if ((status = cn_surface_new(out, (int)mesh->nvert, (int)mesh->ntri)) != CN_OK)
        return cn_fail(error, status, "", 0, "%s: out of memory", name);
    memcpy((*out)->vert, mesh->vert, 3 * mesh->nvert * sizeof(double));
    for (size_t i = 0; i < 3 * mesh->nvert && status == CN_OK; i++)
        if (!isfinite((*out)->vert[i]))
            status = cn_fail(error, CN_ERR_NOT_FINITE, "", 0, "%s: vertex %zu has the coordinate %g", name,
                             i / 3, (*out)->vert[i]);
    for (size_t i = 0; i < 3 * mesh->ntri && status == CN_OK; i++) {
        uint32_t corner;
        memcpy(&corner, mesh->tri + i * sizeof corner, sizeof corner);
        (*out)->tri[i] = (int)corner;
        if (corner >= mesh->nvert)
            status = cn_fail(error, CN_FAULT_NO_VERTEX, "", 0, "%s: triangle %zu names vertex %u of %zu",
                             name, i / 3, (unsigned)corner, mesh->nvert);
    }
    if (status == CN_OK) return CN_OK;
    cn_surface_free(*out);
    *out = NULL;
    return status;
}
