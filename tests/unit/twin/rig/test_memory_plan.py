"""The memory plan: sums, what fits, and the sentence when it does not."""

from __future__ import annotations

import msgspec
import pytest
import warp as wp

from schemas.sections.camera import Camera, ImageOutput
from twin.render.build import NONE, Features
from twin.render.memory import LidarLoad, plan
from twin.render.trace.second_hits import (
    DETAIL_HIT_BYTES_PER_PIXEL,
    HIT_BYTES_PER_PIXEL,
    allocate_hits,
)
from twin.render.trace.visibility import BYTES_PER_PIXEL, DETAIL_BYTES_PER_PIXEL, allocate_seen

PAIR = [Camera(name=f"front_{side}", width=640, height=360) for side in ("left", "right")]
EYE = Camera(name="eye", width=640, height=360)
BLURRED = msgspec.structs.replace(EYE, effects=["motion_blur"])
LIDAR = [LidarLoad("roof", 32 * 1024)]


def test_a_full_rig_of_256_slots_stays_below_12_gb():
    full = [
        Camera(
            name=c.name, width=640, height=360, effects=["all"], outputs=list(ImageOutput.__args__)
        )
        for c in PAIR
    ]
    for cameras in (PAIR, full):
        found = plan(cameras, LIDAR, 256, triangles=100_000, instances=64, objects=32)
        assert 0.3e9 < found.bytes_total < 12e9
    assert found.bytes_total > 4e9


def test_the_sum_is_that_of_the_buffers():
    bare = plan([], [], 8, triangles=0).bytes_total
    one = plan([EYE], [], 8, triangles=0, sky_bytes=0)
    pixels = 640 * 360
    light = next(r.per_slot for r in one.rows if r.name == "eye: light, sky and boxes")
    under_way = 8 * pixels * (BYTES_PER_PIXEL + HIT_BYTES_PER_PIXEL)
    assert one.bytes_total - bare == pixels * (12 + 8 * 3) + 8 * light + under_way
    blurred = plan([BLURRED], [], 8, triangles=0, sky_bytes=0)
    # The linear picture, flow, one more linear picture; twice 12 x 20 tiles, a row of each and the
    # gain.
    ways = (360 * 20 + 2 * 240) * 8
    assert blurred.bytes_total - one.bytes_total == 8 * (pixels * (6 + 8 + 6) + ways + 4)
    flow = msgspec.structs.replace(BLURRED, outputs=["flow"])
    shared = plan([flow], [], 8, triangles=0, sky_bytes=0)
    assert shared.bytes_total == blurred.bytes_total
    lidar = plan([], [LidarLoad("roof", 1000, 40)], 8, triangles=0)
    assert lidar.bytes_total - bare == 8 * 1000 * 40


def test_the_largest_number_of_slots_fits_and_one_more_does_not():
    free = 10_000_000_000
    found = plan(PAIR, LIDAR, 1, triangles=50_000)
    most = found.slots_max(free)
    plan(PAIR, LIDAR, most, triangles=50_000).check(free)
    with pytest.raises(
        ValueError, match=rf"and 10\.00 GB are free: at most {most} fit; ask for"
    ) as e:
        plan(PAIR, LIDAR, most + 1, triangles=50_000).check(free)
    assert "\n" not in str(e.value)
    with pytest.raises(ValueError, match="not even one fits"):
        found.check(100_000_000)
    lines = plan(PAIR, LIDAR, 64, triangles=50_000).lines()
    assert lines[-1].endswith("for 64 slots")
    assert any("front_left: pictures" in line for line in lines)


def test_pixels_under_way_stop_growing():
    one, many = (plan([EYE], [], n, triangles=0) for n in (72, 720))
    rows = [next(r for r in p.rows if "under way" in r.name) for p in (one, many)]
    each = BYTES_PER_PIXEL + HIT_BYTES_PER_PIXEL
    assert rows[0].total(72) == rows[1].total(720) == 72 * 640 * 360 * each


@pytest.mark.parametrize("details", [False, True])
def test_pixels_under_way_are_those_of_the_buffers(details):
    features = Features(looks=True) if details else NONE
    seen = allocate_seen(2, 36, 64, wp.get_device("cpu"), features=features)
    arrays = [seen.t, seen.face, seen.flags, seen.bary, seen.listed, seen.second]
    arrays += [seen.detailed, seen.look] if details else []
    taken = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    each = BYTES_PER_PIXEL + details * DETAIL_BYTES_PER_PIXEL
    assert taken == 2 * 36 * 64 * each
    eye = msgspec.structs.replace(EYE, width=64, height=36, reflections=False)
    rows = plan([eye], [], 2, triangles=0, details=details).rows
    assert next(row for row in rows if "under way" in row.name).total(2) == taken
    hits = allocate_hits(2, 36, 64, wp.get_device("cpu"), features)
    arrays = [hits.t, hits.u, hits.v, hits.face, hits.flags, hits.left]
    arrays += [hits.plain, hits.detailed] if details else []
    met = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays)
    assert met == 2 * 36 * 64 * (HIT_BYTES_PER_PIXEL + details * DETAIL_HIT_BYTES_PER_PIXEL)
    mirrors = msgspec.structs.replace(eye, reflections=True)
    rows = plan([mirrors], [], 2, triangles=0, details=details).rows
    assert next(row for row in rows if "under way" in row.name).total(2) == taken + met
