"""What the pixels of an undistorted camera see, face by face instead of ray by ray; CPU only.

All rays of a picture begin at one point, so a face's Pluecker coordinates are computed once, and
eight neighbouring pixels meet it with one vector instruction. The test is that of
:mod:`twin.render.trace.traverse`, operation by operation, in the same axes: the world's, or those
of a movable object. So both find the same faces, distances and weights to the last bit. Nodes of
the hierarchy that are outside the picture are skipped, by bounds that are a pixel wider. The
nearest face wins; of equally near ones the lowest of one mesh, and the mesh that came first.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import warp as wp

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import intrinsics
from twin.render.build import NONE, Features
from twin.render.light.light import SlotLight
from twin.render.looks import SMOOTH
from twin.render.trace.cutouts import HOLE
from twin.render.trace.eight import FUSED8, LESSER
from twin.render.trace.geometry import RayScene, into_object
from twin.render.trace.rays import Optics, SlotPose
from twin.render.trace.visibility import (
    CURVED,
    DETAILED,
    NOTHING,
    OBJECT_MASK,
    TILE_COLUMNS,
    TILE_ROWS,
    PixelsSeen,
    reach_of,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Raster:
    """An undistorted picture."""

    fx: wp.float32
    """[px]"""
    fy: wp.float32
    cx: wp.float32
    """Place at which the optical axis meets the picture, from its upper left corner [px]."""
    cy: wp.float32
    tiles_x: wp.int32
    tiles_y: wp.int32
    rays: wp.array(dtype=wp.float32)
    """Right [8], down [8], ahead [8] of every row of every tile."""
    reach: wp.array(dtype=wp.float32)
    """Nearest [8] and farthest [8] distance that is shown along the same rays [m]."""
    directions: wp.array(dtype=wp.float32)
    """Of the picture that is being drawn: the same rays in the world's axes, x [8], y [8], z [8],
    and the nearest distance [8] that is shown along them [m]."""


def raster_of(
    lens: Lens, optics: Optics, table: np.ndarray, hfov_deg: float, device: wp.Device
) -> Raster | None:
    """Rasters for the pictures of a table of rays [H, W, 3]; None: the lens distorts, or it is a
    GPU."""
    if not device.is_cpu or lens.model not in ("pinhole", "frustum"):
        return None
    height, width = table.shape[:2]
    inner = intrinsics(lens, width, height, hfov_deg)
    raster = Raster()
    raster.fx, raster.fy, raster.cx, raster.cy = inner.fx_px, inner.fy_px, inner.cx_px, inner.cy_px
    raster.tiles_x, raster.tiles_y = -(-width // TILE_COLUMNS), -(-height // TILE_ROWS)
    padded = np.zeros((raster.tiles_y * TILE_ROWS, raster.tiles_x * TILE_COLUMNS, 3), np.float32)
    padded[:height, :width] = table
    tiles = padded.reshape(raster.tiles_y, TILE_ROWS, raster.tiles_x, TILE_COLUMNS, 3)
    rows = tiles.transpose(0, 2, 1, 4, 3)  # tile row, tile column, row, axis, column
    raster.rays = wp.array(rows.ravel(), dtype=wp.float32, device=device)
    raster.directions = wp.empty(rows.size // 24 * 32, dtype=wp.float32, device=device)
    pixels = rows.size // 3
    raster.reach = wp.empty(2 * pixels, dtype=wp.float32, device=device)
    wp.launch(_reach_kernel, pixels, [optics, raster.rays], [raster.reach], device=device)
    return raster


_DRAW = f"""
    {FUSED8}
    {LESSER}
    #define LESS(a, b, c, d) __builtin_fmaf(a, b, -((c) * (d)))
    #define SUM(a, b, c, d, e, f) __builtin_fmaf(a, b, __builtin_fmaf(c, d, (e) * (f)))
"""
_DRAW += """
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef int i8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef int j8 __attribute__((ext_vector_type(8), aligned(4)));
    // PUNCH
    const float width = optics.width, height = optics.height;
    // Rays are turned into a movable object's axes; the world's are as they are.
    const auto* pose = thing < 0 ? nullptr : wp::address(scene.objects, slot, thing);
    const float cosine = pose ? pose->cosine : 1.0f, sine = pose ? pose->sine : 0.0f;
    const wp::vec4 tilt = pose ? pose->tilt : wp::vec4(0.0f, 1.0f, 0.0f, 1.0f);
    const bool tilted = tilt[0] != 0.0f || tilt[2] != 0.0f;
    // Borders of the picture as planes through the eye, their normals inwards.
    float plane[4][3];
    const float border[4][3] = {
        {raster.fx, 0.0f, raster.cx + 1.0f}, {-raster.fx, 0.0f, width + 1.0f - raster.cx},
        {0.0f, raster.fy, raster.cy + 1.0f}, {0.0f, -raster.fy, height + 1.0f - raster.cy}};
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 3; ++k)
            plane[i][k] = border[i][0] * right[k] + border[i][1] * down[k]
                + border[i][2] * ahead[k];
    int stack[320];
    int top = 0;
    stack[top++] = root;
    while (top > 0) {
        const int node = stack[--top];
        if (node >= 0) {
            const float* base = scene.nodes.data + (size_t)node * 56;
            const u8* box = (const u8*)base;
            i8 in = box[0] <= box[3];
            for (int i = 0; i < 4; ++i) {
                f8 most = 0.0f;
                for (int k = 0; k < 3; ++k)
                    most += plane[i][k] * ((plane[i][k] > 0.0f ? box[3 + k] : box[k]) - eye[k]);
                in &= most >= 0.0f;
            }
            unsigned mask = __builtin_bit_cast(unsigned char, __builtin_convertvector(in, b8));
            while (mask) {
                stack[top++] = ((const int*)(base + 48))[__builtin_ctz(mask)];
                mask &= mask - 1;
            }
            continue;
        }
        const u8* c = (const u8*)(scene.leaves.data + (size_t)(-1 - node) * 80);
        const int* faces = (const int*)(c + 9);
        f8 corner[3][3], place[3][3];
        for (int v = 0; v < 3; ++v) {
            const f8 x = c[3 * v] - eye[0], y = c[3 * v + 1] - eye[1], z = c[3 * v + 2] - eye[2];
            place[v][0] = x;
            place[v][1] = y;
            place[v][2] = z;
            corner[v][0] = x * right[0] + y * right[1] + z * right[2];
            corner[v][1] = x * down[0] + y * down[1] + z * down[2];
            corner[v][2] = x * ahead[0] + y * ahead[1] + z * ahead[2];
        }
        // Where the part before the eye is in the picture; edges are cut just before the eye.
        const float cut = 1.0e-3f;
        f8 x0 = 1.0e9f, x1 = -1.0e9f, y0 = 1.0e9f, y1 = -1.0e9f;
        for (int v = 0; v < 3; ++v) {
            const f8 *a = corner[v], *b = corner[v == 2 ? 0 : v + 1];
            const i8 front = a[2] >= cut;
            const f8 share = (cut - a[2]) / (b[2] - a[2]);
            const i8 crosses = front ^ (b[2] >= cut);
            const f8 z = greater(a[2], (f8)cut);
            f8 px = raster.fx * a[0] / z, py = raster.fy * a[1] / z;
            x0 = front ? lesser(x0, px) : x0;
            x1 = front ? greater(x1, px) : x1;
            y0 = front ? lesser(y0, py) : y0;
            y1 = front ? greater(y1, py) : y1;
            px = raster.fx * (a[0] + share * (b[0] - a[0])) / cut;
            py = raster.fy * (a[1] + share * (b[1] - a[1])) / cut;
            x0 = crosses ? lesser(x0, px) : x0;
            x1 = crosses ? greater(x1, px) : x1;
            y0 = crosses ? lesser(y0, py) : y0;
            y1 = crosses ? greater(y1, py) : y1;
        }
        const f8 zero = 0.0f;
        x0 = greater(x0 + (raster.cx - 1.0f), zero);
        x1 = lesser(x1 + raster.cx, (f8)(width - 1.0f));
        y0 = greater(y0 + (raster.cy - 1.0f), zero);
        y1 = lesser(y1 + raster.cy, (f8)(height - 1.0f));
        const i8 visible = (x0 <= x1) & (y0 <= y1);
        unsigned mask = __builtin_bit_cast(unsigned char, __builtin_convertvector(visible, b8));
        while (mask) {
            const int k = __builtin_ctz(mask);
            mask &= mask - 1;
            if (faces[k] < 0) continue;
            const float px = place[0][0][k], py = place[0][1][k], pz = place[0][2][k];
            const float qx = place[1][0][k], qy = place[1][1][k], qz = place[1][2][k];
            const float sx = place[2][0][k], sy = place[2][1][k], sz = place[2][2][k];
            const float ex = sx - px, ey = sy - py, ez = sz - pz;
            const float gx = px - qx, gy = py - qy, gz = pz - qz;
            const float hx = qx - sx, hy = qy - sy, hz = qz - sz;
            const float ax = sx + px, ay = sy + py, az = sz + pz;
            const float bx = px + qx, by = py + qy, bz = pz + qz;
            const float kx = qx + sx, ky = qy + sy, kz = qz + sz;
            const float Ux = LESS(ey, az, ez, ay), Uy = LESS(ez, ax, ex, az);
            const float Uz = LESS(ex, ay, ey, ax);
            const float Vx = LESS(gy, bz, gz, by), Vy = LESS(gz, bx, gx, bz);
            const float Vz = LESS(gx, by, gy, bx);
            const float Wx = LESS(hy, kz, hz, ky), Wy = LESS(hz, kx, hx, kz);
            const float Wz = LESS(hx, ky, hy, kx);
            const float mx = LESS(ey, gz, ez, gy), my = LESS(ez, gx, ex, gz);
            const float mz = LESS(ex, gy, ey, gx);
            const float depth = SUM(px, mx, py, my, pz, mz);
            const int face = first_face + faces[k];
            const int c0 = (int)x0[k] >> 3, c1 = (int)x1[k] >> 3;
            const int r1 = (int)y1[k];
            for (int row = (int)y0[k]; row <= r1; ++row) {
                for (int block = c0; block <= c1; ++block) {
                    const int line = ((row >> 2) * raster.tiles_x + block) * 4 + (row & 3);
                    const u8* ray = (const u8*)(raster.directions.data + (size_t)line * 32);
                    f8 dx = ray[0], dy = ray[1], dz = ray[2];
                    if (pose) {  // the steps of twin.render.trace.geometry.into_object
                        const f8 x = cosine * dx + sine * dy;
                        dy = cosine * dy - sine * dx;
                        dx = x;
                        if (tilted) {
                            dx = tilt[1] * x - tilt[0] * dz;
                            const f8 z = tilt[0] * x + tilt[1] * dz, y = dy;
                            dy = tilt[3] * y + tilt[2] * z;
                            dz = tilt[3] * z - tilt[2] * y;
                        }
                    }
                    const f8 U = TWIN_DOT(Ux, dx, Uy, dy, Uz, dz);
                    const f8 V = TWIN_DOT(Vx, dx, Vy, dy, Vz, dz);
                    const f8 W = TWIN_DOT(Wx, dx, Wy, dy, Wz, dz);
                    const f8 least = lesser(U, lesser(V, W));
                    const f8 most = greater(U, greater(V, W));
                    const i8 inside = (least >= 0.0f) | (most <= 0.0f);
                    if (!__builtin_bit_cast(unsigned char, __builtin_convertvector(inside, b8)))
                        continue;
                    const f8 slope = TWIN_SUM(mx, dx, my, dy, mz, dz);
                    const f8 t = depth / slope;
                    const size_t at = (size_t)first_pixel + (size_t)line * 8;
                    u8* nearest = (u8*)(seen.t.data + at);
                    const f8 sum = U + V + W;
                    i8 wins = inside & (sum != 0.0f) & (t >= ray[3]) & (t <= *nearest);
                    const i8 equal = wins & (t == *nearest);
                    if (__builtin_bit_cast(unsigned char, __builtin_convertvector(equal, b8))) {
                        const i8 lower = (face < *(const j8*)(seen.face.data + at))
                            & ((*(const j8*)(seen.flags.data + at) & OBJECTS) == thing + 1);
                        wins &= ~equal | lower;
                    }
                    // HOLES
                    const b8 some = __builtin_convertvector(wins, b8);
                    if (!__builtin_bit_cast(unsigned char, some)) continue;
                    *nearest = wins ? t : (f8)*nearest;
                    j8* kept = (j8*)(seen.face.data + at);
                    *kept = wins ? (i8)face : (i8)*kept;
                    kept = (j8*)(seen.flags.data + at);
                    *kept = wins ? (i8)(thing + 1 /* MARK */) : (i8)*kept;
                    const f8 share = 1.0f / sum, one = 1.0f;
                    const f8 su = lesser(W * share, one);
                    const f8 sv = lesser(U * share, one);
                    const i8 u = __builtin_convertvector(su * 65535.0f + 0.5f, i8);
                    const i8 v = __builtin_convertvector(sv * 65535.0f + 0.5f, i8);
                    kept = (j8*)(seen.bary.data + at);
                    *kept = wins ? ((u << 16) | v) : (i8)*kept;
                }
            }
        }
    }
"""


# Pixels that look through a hole of the face do not see it. Apart from the loop, which would be
# slower for all faces otherwise.
_PUNCH = """
    auto punch = [&](int face, f8 U, f8 sum, f8 W, i8 wins) __attribute__((noinline)) -> i8 {
        const f8 share = 1.0f / sum;
        const f8 su = W * share, sv = U * share;
        for (int i = 0; i < 8; ++i)
            if (wins[i] && hole(face, su[i], sv[i])) wins[i] = 0;
        return wins;
    };
"""
_HOLES = """
                    const b8 nearer = __builtin_convertvector(wins, b8);
                    if (!__builtin_bit_cast(unsigned char, nearer)) continue;
                    if (cuts.of_face.data && __builtin_expect(cuts.of_face.data[face] >= 0, 0))
                        wins = punch(face, U, sum, W, wins);"""
# Pixels that see a face with details are marked as it is drawn.
_MARK = f"""+ (!rows || rows[face] < 0 ? 0
                        : {int(DETAILED)} + (rows[face] < {SMOOTH} ? 0 : {int(CURVED)}))"""


def _for_cpu(text: str) -> str:
    text = text.replace("OBJECTS", str(int(OBJECT_MASK)))
    return f"#if !defined(__CUDA_ARCH__)\n{text}\n#endif\n"


def _drawn_with_details() -> str:
    names = "const auto& cuts = scene.cuts;\nconst auto& corners = scene.uv;\n"
    names += "const int* rows = scene.looks.row.data;\n"
    text = _DRAW.replace("    // PUNCH\n", _PUNCH).replace("// HOLES", _HOLES)
    text = text.replace("/* MARK */", _MARK)
    return names + HOLE + text


# Eight neighbours at a time; rays are turned as everywhere else.
_BEGIN = f"""
    typedef float f8 __attribute__((ext_vector_type(8)));
    typedef float u8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef int j8 __attribute__((ext_vector_type(8), aligned(4)));
    const int lines = raster.tiles_x * raster.tiles_y * {TILE_ROWS};
    for (int line = 0; line < lines; ++line) {{
        const u8* ray = (const u8*)(raster.rays.data + (size_t)line * 24);
        const u8* reach = (const u8*)(raster.reach.data + (size_t)line * 16);
        u8* direction = (u8*)(raster.directions.data + (size_t)line * 32);
        for (int k = 0; k < 3; ++k)
            direction[k] = __builtin_elementwise_fma((f8)ahead[k], (f8)ray[2],
                __builtin_elementwise_fma((f8)down[k], (f8)ray[1], right[k] * ray[0]));
        direction[3] = reach[0];
        const size_t at = (size_t)first_pixel + (size_t)line * 8;
        *(u8*)(seen.t.data + at) = reach[1];
        *(j8*)(seen.face.data + at) = {int(NOTHING)};
    }}
"""


@wp.func_native(_for_cpu(_BEGIN))
def begin_picture(
    raster: Raster,
    right: wp.vec3,
    down: wp.vec3,
    ahead: wp.vec3,
    first_pixel: wp.int32,
    seen: PixelsSeen,
):
    """Point the rays of a picture where the camera looks; its pixels from ``first_pixel`` on see
    nothing yet."""


@wp.kernel(enable_backward=False)
def _reach_kernel(
    optics: Optics, rays: wp.array(dtype=wp.float32), out: wp.array(dtype=wp.float32)
):
    """Nearest [8] and farthest [8] distance of every row of every tile."""
    i = wp.tid()
    line = i / 8
    own = 24 * line + i % 8
    reach = reach_of(optics, wp.vec3(rays[own], rays[own + 8], rays[own + 16]))
    out[16 * line + i % 8] = reach[0]
    out[16 * line + 8 + i % 8] = reach[1]


@wp.func_native(_for_cpu(_DRAW))
def draw_faces(
    scene: RayScene,
    raster: Raster,
    optics: Optics,
    root: wp.int32,
    first_face: wp.int32,
    slot: wp.int32,
    thing: wp.int32,
    eye: wp.vec3,
    right: wp.vec3,
    down: wp.vec3,
    ahead: wp.vec3,
    first_pixel: wp.int32,
    seen: PixelsSeen,
):
    """Draw the faces below ``root``, of the object ``thing`` of ``slot`` (-1: static), into the
    pixels from ``first_pixel`` on; the camera is given in the axes of the hierarchy."""


@wp.func_native(_for_cpu(_drawn_with_details()))
def draw_detailed_faces(
    scene: RayScene,
    raster: Raster,
    optics: Optics,
    root: wp.int32,
    first_face: wp.int32,
    slot: wp.int32,
    thing: wp.int32,
    eye: wp.vec3,
    right: wp.vec3,
    down: wp.vec3,
    ahead: wp.vec3,
    first_pixel: wp.int32,
    seen: PixelsSeen,
):
    """Draw faces as :func:`draw_faces` does, but not where they have holes, and mark pixels that
    see faces with details."""


# Eight neighbours at a time, most of which see nothing with details.
_DETAILED = f"""
    typedef int i8 __attribute__((ext_vector_type(8)));
    typedef bool b8 __attribute__((ext_vector_type(8)));
    typedef int j8 __attribute__((ext_vector_type(8), aligned(4)));
    const int width = optics.width, height = optics.height;
    int* places = seen.detailed.data;
    int count = seen.detailed_count.data[0], pixel = first_pixel;
    for (int line = 0; line < raster.tiles_y; ++line)
        for (int block = 0; block < raster.tiles_x; ++block)
            for (int row = 0; row < {TILE_ROWS}; ++row, pixel += {TILE_COLUMNS}) {{
                const i8 face = *(const j8*)(seen.face.data + pixel);
                const i8 flags = *(const j8*)(seen.flags.data + pixel);
                const i8 there = (face >= 0) & ((flags & {int(DETAILED)}) != 0);
                unsigned mask = __builtin_bit_cast(
                    unsigned char, __builtin_convertvector(there, b8));
                const int inside = width - block * {TILE_COLUMNS};
                if (line * {TILE_ROWS} + row >= height) mask = 0;
                if (inside < {TILE_COLUMNS}) mask &= (1u << inside) - 1u;
                while (mask) {{
                    places[count++] = pixel + __builtin_ctz(mask);
                    mask &= mask - 1;
                }}
            }}
    seen.detailed_count.data[0] = count;
"""


@wp.func_native(_for_cpu(_DETAILED))
def list_detailed(raster: Raster, optics: Optics, first_pixel: wp.int32, seen: PixelsSeen):
    """Put the pixels of a picture that see faces with details on their list, in their order."""


@cache
def raster_kernel(features: Features = NONE) -> wp.Kernel:
    """The kernel for worlds with such ``features``."""
    looks = features.looks
    draw = draw_detailed_faces if looks or features.holes else draw_faces

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def draw_kernel(
        # model
        scene: RayScene,
        optics: Optics,
        raster: Raster,
        # state in
        lights: wp.array(dtype=SlotLight),
        poses: wp.array(dtype=SlotPose),
        # args
        first_slot: wp.int32,
        # out
        seen: PixelsSeen,
    ):
        """Draw the slots from ``first_slot`` on, one per thread, and list what has details."""
        place = wp.tid()
        slot = first_slot + place
        if lights[slot].active == 0:
            return
        count = raster.tiles_x * raster.tiles_y * wp.static(TILE_COLUMNS * TILE_ROWS)
        first = place * count
        pose = poses[slot]
        begin_picture(raster, pose.right, pose.down, pose.ahead, first, seen)
        draw(
            scene,
            raster,
            optics,
            0,
            0,
            slot,
            -1,
            pose.eye,
            pose.right,
            pose.down,
            pose.ahead,
            first,
            seen,
        )
        for m in range(scene.objects.shape[1]):
            thing = scene.objects[slot, m]
            if thing.root > 0:
                draw(
                    scene,
                    raster,
                    optics,
                    thing.root,
                    thing.first_face,
                    slot,
                    m,
                    into_object(pose.eye - thing.position, thing),
                    into_object(pose.right, thing),
                    into_object(pose.down, thing),
                    into_object(pose.ahead, thing),
                    first,
                    seen,
                )
        if wp.static(looks):
            list_detailed(raster, optics, first, seen)

    return draw_kernel
