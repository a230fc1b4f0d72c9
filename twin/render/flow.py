"""Optical flow: the way of every point since the picture before, through any lens.

Points are drawn by the lens's own formulas (those of :mod:`schemas.sections.lens_projection`, Brown
1971 and Kannala and Brandt 2006), not looked up in the table of rays: so a point may have been
outside the picture, and nothing depends on what the table has at its border.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from schemas.sections.lens import Lens
from schemas.sections.lens_curve import intrinsics, reach
from twin.base.portable_math import portable_atan2_f32, portable_cos_f32, portable_sin_f32
from twin.render.shading import ShadedPoint
from twin.render.trace.geometry import ObjectPose, RayScene, into_object, out_of_object
from twin.render.trace.rays import SlotPose
from twin.world.mirror import put_row, row_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FISHEYE = wp.constant(2)
_MODELS = {"pinhole": 0, "frustum": 0, "brown_conrady": 1, "fisheye": int(_FISHEYE)}


@wp.struct
class Projection:
    """A lens on pictures of one size."""

    model: wp.int32
    """0: no distortion, 1: Brown-Conrady, 2: fisheye."""
    fx: wp.float32
    """[px]"""
    fy: wp.float32
    cx: wp.float32
    """Principal point from the upper left corner of the picture [px]."""
    cy: wp.float32
    k: wp.types.vector(6, wp.float32)
    p: wp.vec2
    end: wp.float32
    """Largest tangent (fisheye: angle [rad]) off the axis that the lens draws."""
    width: wp.float32
    """[px]"""
    height: wp.float32


def projection_of(lens: Lens, width: int, height: int, hfov_deg: float) -> Projection:
    """The projection of a lens that fits the picture (:func:`twin.render.lens.ray_table`)."""
    inner = intrinsics(lens, width, height, hfov_deg)
    projection = Projection()
    projection.model = _MODELS[lens.model]
    projection.fx, projection.fy = inner.fx_px, inner.fy_px
    projection.cx, projection.cy = inner.cx_px, inner.cy_px
    projection.k = (lens.k1, lens.k2, lens.k3, lens.k4, lens.k5, lens.k6)
    projection.p = wp.vec2(lens.p1, lens.p2)
    projection.end = reach(lens).argument
    projection.width, projection.height = width, height
    return projection


@wp.func
def drawn_at(lens: Projection, v: wp.vec3) -> wp.vec2:
    """Place in the picture of what lies in direction ``v`` in the camera's axes [px].

    What the lens does not draw is put on the rim of what it does.
    """
    across = wp.sqrt(v[0] * v[0] + v[1] * v[1])
    k = lens.k
    if lens.model == _FISHEYE:
        scale = wp.float32(0.0)
        if across > 0.0:
            angle = wp.min(portable_atan2_f32(across, v[2]), lens.end)
            q = angle * angle
            scale = angle * (1.0 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3])))) / across
        return wp.vec2(lens.fx * scale * v[0] + lens.cx, lens.fy * scale * v[1] + lens.cy)
    shrink = wp.float32(0.0)
    if across > lens.end * v[2]:
        shrink = lens.end / across
    else:
        shrink = 1.0 / v[2]
    x = v[0] * shrink
    y = v[1] * shrink
    if lens.model != 0:
        q = x * x + y * y
        above = 1.0 + q * (k[0] + q * (k[1] + q * k[2]))
        below = 1.0 + q * (k[3] + q * (k[4] + q * k[5]))
        scale = above / below
        bent_x = x * scale + 2.0 * lens.p[0] * x * y + lens.p[1] * (q + 2.0 * x * x)
        bent_y = y * scale + lens.p[0] * (q + 2.0 * y * y) + 2.0 * lens.p[1] * x * y
        x = bent_x
        y = bent_y
    return wp.vec2(lens.fx * x + lens.cx, lens.fy * y + lens.cy)


@wp.struct
class PosesBefore:
    """What :class:`PictureBefore` gives to kernels."""

    cameras: wp.array(dtype=SlotPose)
    """[S]"""
    objects: wp.array2d(dtype=ObjectPose)
    """[S, M]; empty where nobody asks for flow."""
    period_s: wp.float32
    """Time between two pictures [s]."""


@wp.func
def flow_at(
    scene: RayScene,
    slot: wp.int32,
    at: ShadedPoint,
    lens: Projection,
    row: wp.int32,
    column: wp.int32,
    direction: wp.vec3,
    pose: SlotPose,
    poses_before: PosesBefore,
) -> wp.vec2:
    """Place of a point in this picture, minus that in the one before [px]; the sky is infinitely
    far.

    An object that was not there in the picture before comes from where its speed says. Way that is
    longer than the picture is cut. Everything is relative to the eye: coordinates of the world
    would cost a far street its digits.
    """
    before = poses_before.cameras[slot]
    target = direction
    if at.face >= 0:
        target = direction * at.distance + (pose.eye - before.eye)
        if at.object >= 0:
            now = scene.objects[slot, at.object]
            then = poses_before.objects[slot, at.object]
            if then.root <= 0:
                then = now
                then.position = now.position - now.velocity * poses_before.period_s
                angle = -now.yaw_rate * poses_before.period_s
                c = portable_cos_f32(angle)
                s = portable_sin_f32(angle)
                then.cosine = now.cosine * c - now.sine * s
                then.sine = now.sine * c + now.cosine * s
            local = direction * at.distance + (pose.eye - now.position)
            local = into_object(local, now)
            target = out_of_object(local, then) + (then.position - before.eye)
    seen = wp.vec3(
        wp.dot(target, before.right), wp.dot(target, before.down), wp.dot(target, before.ahead)
    )
    then_px = drawn_at(lens, wp.normalize(seen))
    x = wp.float32(column) + 0.5 - then_px[0]
    y = wp.float32(row) + 0.5 - then_px[1]
    return wp.vec2(wp.clamp(x, -lens.width, lens.width), wp.clamp(y, -lens.height, lens.height))


class PictureBefore:
    """Poses of the camera and the objects in the last picture of every slot."""

    def __init__(self, poses: wp.array, objects: wp.array | None, period_s: float) -> None:
        """Arrays of the poses as they are now, and the time between two pictures [s].

        ``poses`` of the camera [S], ``objects`` [S, M]; None: nobody asks for flow.
        """
        self._now = (poses,) if objects is None or not objects.size else (poses, objects)
        self._then = tuple(wp.zeros_like(array) for array in self._now)
        self.handle = PosesBefore()
        self.handle.cameras = self._then[0]
        if len(self._then) > 1:
            self.handle.objects = self._then[1]
        self.handle.period_s = period_s
        self._kept: dict[int, tuple[wp.array, ...]] = {}
        """Rows of slots that are held."""
        self._new = np.ones(poses.shape[0], np.bool_)

    def reset(self, slot: int) -> None:
        """A case begins, or the ego was put elsewhere: no picture is before the next."""
        self._new[slot] = True

    def hold(self, slot: int, *, held: bool) -> None:
        """Pictures are made without a slot for a while; its last one stays the one before."""
        if held:
            self._kept[slot] = tuple(wp.clone(then[slot : slot + 1]) for then in self._then)
        else:
            for then, kept in zip(self._then, self._kept.pop(slot), strict=True):
                _copy_row(then, slot, kept, 0)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Poses of a slot's last picture, and whether there was none."""
        rows = {f"pose {i}": row_of(then, slot) for i, then in enumerate(self._then)}
        return {"new": np.array(self._new[slot]), **rows}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """The last picture of a slot had these poses."""
        self._new[slot] = saved["new"]
        for i, then in enumerate(self._then):
            put_row(then, slot, saved[f"pose {i}"])

    def forget(self, slot: int) -> None:
        """A slot is cleared."""
        self._kept.pop(slot, None)

    def begin(self, active: NDArray[np.bool_]) -> None:
        """Poses are those of the picture that is begun in ``active`` slots [S].

        The first picture of a case has none before it: nothing has moved.
        """
        for slot in np.flatnonzero(self._new & active).tolist():
            for now, then in zip(self._now, self._then, strict=True):
                _copy_row(then, slot, now, slot)
            self._new[slot] = False

    def keep(self) -> None:
        """The picture is made: it is the last one."""
        for now, then in zip(self._now, self._then, strict=True):
            wp.copy(then, now)


def _copy_row(to: wp.array, row: int, source: wp.array, source_row: int) -> None:
    """Copy a row of an array [S, ...]."""
    count = to.size // to.shape[0]
    wp.copy(to, source, row * count, source_row * count, count)
