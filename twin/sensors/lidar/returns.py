"""From hits to points: signal, weather, noise, detection. One thread per beam.

Signals are in units of a white matt surface that fills the beam and faces the sensor at 1 m (see
:mod:`twin.sensors.lidar.scatter`), so signal x max(R, focus)^2 is reflectivity.
"""

from __future__ import annotations

import warp as wp

from twin.base.portable.exact import not_a_number_f32
from twin.base.portable.whole import whole_within_f32
from twin.base.portable_math import portable_exp_f32, portable_log_f32
from twin.render.noise import draw, normal, uniform
from twin.render.trace.geometry import DECAL_TAG, RayScene
from twin.sensors.lidar.air import LidarAir
from twin.sensors.lidar.sweep import BeamHit, BeamTable, SweepPose, direction_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_NONE, _SURFACE, _FOG, _DROP = (wp.constant(n) for n in range(4))
_DRAWS = wp.constant(3)
"""Random numbers of 64 bits per beam: (survival, range), (detection), (place in the air)."""
_S16 = wp.constant(wp.uint64(16))
_LOW24 = wp.constant(wp.uint64(0xFFFFFF))


@wp.struct
class Receiver:
    """Receiver of one profile, and what is written."""

    threshold: wp.float32
    """Signal detected in half of the pulses."""
    sigma: wp.float32
    """Standard deviation of the signal's noise."""
    focus: wp.float32
    """Nearer than this, signals fall no more with range [m]."""
    noise: wp.float32
    """Standard deviation of a strong return's range [m]."""
    step: wp.float32
    """Ranges are multiples of it [m]; 0: any."""
    pulse: wp.float32
    """Length of the pulse in range [m]."""
    dropout: wp.float32
    by_signal: wp.float32
    by_range: wp.float32
    """The return with the largest by_signal x signal + by_range x range is kept."""
    weakens: wp.int32
    """1: extinction weakens every pulse; 0: it takes whole pulses."""
    retro_scale: wp.float32
    """Intensity above 100 per natural logarithm of reflectivity."""
    snow: wp.float32
    """Reflectance of snow."""
    deskew: wp.int32


@wp.struct
class Echo:
    """The best return so far."""

    score: wp.float32
    range: wp.float32
    signal: wp.float32
    kind: wp.int32
    sub: wp.int32


@wp.func
def _reflectivity(surface: wp.vec4, hit: BeamHit, air: LidarAir, snow: wp.float32) -> wp.float32:
    """What a surface sends back, relative to a white matt one that faces the sensor.

    Lambert's cosine, and for retro-reflectors a part that falls with its square.
    """
    matt = surface[0] * (1.0 - air.wetness * (1.0 - surface[2]))
    retro = surface[1] * hit.cosine * (1.0 - 0.5 * air.wetness)
    if air.snow_cover > 0.0 and (hit.owner & 1) != 0:
        cover = air.snow_cover * surface[3]
        matt += (snow - matt) * cover
        retro = retro * (1.0 - cover)
    return (matt + retro) * hit.cosine


@wp.func
def _offer(
    best: Echo,
    detector: Receiver,
    signal: wp.float32,
    noise: wp.float32,
    distance: wp.float32,
    kind: wp.int32,
    sub: wp.int32,
) -> Echo:
    """``best``, or this return if it is detected and preferred."""
    if signal > 0.0 and signal + noise > detector.threshold:
        score = detector.by_signal * signal + detector.by_range * distance
        if best.kind == _NONE or score > best.score:
            best.score = score
            best.range = distance
            best.signal = signal
            best.kind = kind
            best.sub = sub
    return best


@wp.func
def _place(table: wp.array2d(dtype=wp.vec2), row: wp.int32, at: wp.float32) -> wp.vec2:
    """Range [m] and signal of a table's row at the quantile ``at``."""
    last = table.shape[1] - 1
    x = at * wp.float32(last)
    i = whole_within_f32(x, 0, last - 1)
    f = x - wp.float32(i)
    return table[row, i] * (1.0 - f) + table[row, i + 1] * f


@wp.func
def _melted(
    beams: BeamTable,
    detector: Receiver,
    surfaces: wp.array(dtype=wp.vec4),
    air: LidarAir,
    hits: wp.array2d(dtype=BeamHit),
    slot: wp.int32,
    first: wp.int32,
    sub: wp.int32,
) -> wp.vec2:
    """Range [m] and reflectivity of the target that sub-ray ``sub`` meets.

    Sub-rays whose targets lie within half a pulse melt into one return at their mean range,
    weighted by signal.
    """
    hit = hits[slot, first + sub]
    if beams.sub_rays == 1:
        return wp.vec2(hit.t, _reflectivity(surfaces[hit.face], hit, air, detector.snow))
    power = wp.float32(0.0)
    moment = wp.float32(0.0)
    for k in range(beams.sub_rays):
        other = hits[slot, first + k]
        if other.face >= 0 and wp.abs(other.t - hit.t) < 0.5 * detector.pulse:
            own = beams.weight[k] * _reflectivity(surfaces[other.face], other, air, detector.snow)
            power += own
            moment += own * other.t
    if power <= 0.0:
        return wp.vec2(hit.t, 0.0)
    return wp.vec2(moment / power, power)


@wp.func
def _best_echo(
    beams: BeamTable,
    detector: Receiver,
    surfaces: wp.array(dtype=wp.vec4),
    fog: wp.array2d(dtype=wp.vec2),
    drops: wp.array2d(dtype=wp.vec2),
    air: LidarAir,
    hits: wp.array2d(dtype=BeamHit),
    slot: wp.int32,
    beam: wp.int32,
    lucky: wp.float32,
    noise: wp.float32,
) -> Echo:
    """The return that a beam keeps, of surfaces, fog and drops."""
    best = Echo()
    nearest = beams.range_max
    first = beam * beams.sub_rays
    for sub in range(beams.sub_rays):
        if hits[slot, first + sub].face >= 0:
            nearest = wp.min(nearest, hits[slot, first + sub].t)
            target = _melted(beams, detector, surfaces, air, hits, slot, first, sub)
            if target[0] >= beams.range_min:
                caught = wp.max(target[0], detector.focus)
                signal = target[1] / (caught * caught)
                if air.extinction > 0.0:
                    passes = portable_exp_f32(-2.0 * air.extinction * target[0])
                    if detector.weakens != 0:
                        signal = signal * passes
                    elif lucky >= passes:
                        signal = 0.0
                best = _offer(best, detector, signal, noise, target[0], _SURFACE, sub)
    if air.fog_row >= 0 or air.drop_row >= 0:
        bits = draw(air.key, air.tick, _DRAWS * beam + 2)
        if air.fog_row >= 0:
            soft = _place(fog, air.fog_row, uniform(bits))
            if soft[0] < nearest:
                best = _offer(best, detector, soft[1] * air.fog_gain, noise, soft[0], _FOG, 0)
        if air.drop_row >= 0:
            # Bits 16 to 39: not those of the fog.
            other = wp.float32((bits >> _S16) & _LOW24) * 5.9604645e-8
            if other < air.drop_share:
                drop = _place(drops, air.drop_row, other / air.drop_share)
                if drop[0] < nearest:
                    best = _offer(best, detector, drop[1], noise, drop[0], _DROP, 0)
    return best


@wp.func
def _intensity(detector: Receiver, reflectivity: wp.float32) -> wp.float32:
    """0..255 of a measured reflectivity; whole numbers, 1 at least for what is detected."""
    value = 100.0 * reflectivity
    if reflectivity > 1.0:
        value = 100.0 + detector.retro_scale * portable_log_f32(reflectivity)
    return wp.clamp(wp.floor(value + 0.5), 1.0, 255.0)


@wp.func
def _write_point(
    scene: RayScene,
    beams: BeamTable,
    detector: Receiver,
    surfaces: wp.array(dtype=wp.vec4),
    fog: wp.array2d(dtype=wp.vec2),
    drops: wp.array2d(dtype=wp.vec2),
    own: LidarAir,
    poses: wp.array2d(dtype=SweepPose),
    hits: wp.array2d(dtype=BeamHit),
    slot: wp.int32,
    beam: wp.int32,
    points_out: wp.array3d(dtype=wp.float32),
) -> wp.int32:
    """Write one point; returns 1 if there is a return."""
    column = beam % beams.columns
    lucky = wp.float32(0.0)
    jitter = wp.float32(0.0)
    noise = wp.float32(0.0)
    lost = wp.bool(False)
    if own.noise != 0 or own.extinction > 0.0:
        bits = draw(own.key, own.tick, _DRAWS * beam)
        lucky = uniform(bits)
        if own.noise != 0:
            jitter = normal(bits)
            more = draw(own.key, own.tick, _DRAWS * beam + 1)
            noise = detector.sigma * normal(more)
            lost = uniform(more) < detector.dropout
    echo = Echo()
    if not lost:
        echo = _best_echo(
            beams, detector, surfaces, fog, drops, own, hits, slot, beam, lucky, noise
        )
    distance = not_a_number_f32()
    point = wp.vec3(distance, distance, distance)
    intensity = wp.float32(0.0)
    if echo.kind != _NONE:
        # Timing errors grow as the signal nears the noise.
        weak = detector.threshold / wp.max(echo.signal, 0.2 * detector.threshold)
        distance = echo.range + jitter * detector.noise * wp.sqrt(1.0 + weak * weak)
        if detector.step > 0.0:
            distance = detector.step * wp.floor(distance / detector.step + 0.5)
        caught = wp.max(echo.range, detector.focus)
        measured = wp.max(echo.signal + noise, 0.0) * caught * caught
        intensity = _intensity(detector, measured)
        point = direction_of(beams, beam / beams.columns, column, 0) * distance
        if detector.deskew != 0:
            then = poses[slot, column]
            now = poses[slot, beams.columns - 1]
            point = (then.origin - now.origin + then.rotation * point) @ now.rotation
    for axis in range(3):
        points_out[slot, beam, axis] = point[axis]
    points_out[slot, beam, 3] = distance
    points_out[slot, beam, 4] = intensity
    points_out[slot, beam, 5] = poses[slot, column].time
    points_out[slot, beam, 6] = wp.float32(echo.kind)
    if points_out.shape[2] > 7:
        instance = wp.int32(-1)
        semantic = wp.int32(-1)
        if echo.kind == _SURFACE:
            hit = hits[slot, beam * beams.sub_rays + echo.sub]
            semantic = scene.faces[hit.face].semantic
            instance = scene.faces[hit.face].instance
            thing = hit.owner / 2 - 1
            if thing >= 0 and scene.faces[hit.face].tag != DECAL_TAG:
                instance = scene.objects[slot, thing].instance
        points_out[slot, beam, 7] = wp.float32(instance)
        points_out[slot, beam, 8] = wp.float32(semantic)
    return wp.where(echo.kind != _NONE, 1, 0)


# A GPU's warp counts its returns of one slot first: all rays of a sweep add to one number, and
# would wait for each other.
_COUNT = """
    #if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 700
    const unsigned mates = __match_any_sync(__activemask(), slot);
    unsigned lane;
    asm("mov.u32 %0, %%laneid;" : "=r"(lane));
    if (lane == __ffs(mates) - 1) atomicAdd(counts.data + slot, __popc(mates));
    #elif defined(__CUDA_ARCH__)
    atomicAdd(counts.data + slot, 1);
    #else
    counts.data[slot] += 1;
    #endif
"""


@wp.func_native(_COUNT)
def _count(counts: wp.array(dtype=wp.int32), slot: wp.int32):
    """Add 1 to ``counts[slot]``."""


@wp.kernel(grid_stride=False)
def return_kernel(
    # model
    scene: RayScene,
    beams: BeamTable,
    detector: Receiver,
    surfaces: wp.array(dtype=wp.vec4),
    fog: wp.array2d(dtype=wp.vec2),
    drops: wp.array2d(dtype=wp.vec2),
    # state in
    air: wp.array(dtype=LidarAir),
    poses: wp.array2d(dtype=SweepPose),
    hits: wp.array2d(dtype=BeamHit),
    # out
    points_out: wp.array3d(dtype=wp.float32),
    count_out: wp.array(dtype=wp.int32),
):
    """Points [S, channels x columns, K] and number of returns [S]; a thread per point."""
    slot, beam = wp.tid()
    own = air[slot]
    if own.active == 0:
        return
    found = _write_point(
        scene, beams, detector, surfaces, fog, drops, own, poses, hits, slot, beam, points_out
    )
    if found > 0:
        _count(count_out, slot)


@wp.kernel
def row_kernel(
    # model
    scene: RayScene,
    beams: BeamTable,
    detector: Receiver,
    surfaces: wp.array(dtype=wp.vec4),
    fog: wp.array2d(dtype=wp.vec2),
    drops: wp.array2d(dtype=wp.vec2),
    # state in
    air: wp.array(dtype=LidarAir),
    poses: wp.array2d(dtype=SweepPose),
    hits: wp.array2d(dtype=BeamHit),
    # out
    points_out: wp.array3d(dtype=wp.float32),
    count_out: wp.array(dtype=wp.int32),
):
    """As :func:`return_kernel`, a thread per row of the range image: on the CPU a thread's start
    costs as much as a point."""
    slot, channel = wp.tid()
    own = air[slot]
    if own.active == 0:
        return
    found = wp.int32(0)
    for beam in range(channel * beams.columns, (channel + 1) * beams.columns):
        found += _write_point(
            scene, beams, detector, surfaces, fog, drops, own, poses, hits, slot, beam, points_out
        )
    wp.atomic_add(count_out, slot, found)
