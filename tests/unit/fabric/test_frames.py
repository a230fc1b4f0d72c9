"""Shared frame buffers: same memory or nothing, and no trace in the file system."""

import os
import resource
from pathlib import Path

import numpy as np

from twin.fabric.frames import (
    HEADER_BYTES,
    Channel,
    FrameBuffer,
    lay_out,
    offer_frames,
    open_frames,
)


def test_both_sides_see_the_same_memory():
    buffer = FrameBuffer(24)
    array = buffer.array(Channel("camera", (2, 12), "|u1"), 0)
    mapped = open_frames(buffer.path, 24, buffer.nonce)
    assert mapped is not None
    array[1, 3] = 7
    assert mapped[HEADER_BYTES + 15] == 7
    mapped.close()
    buffer.close()


def test_refused_when_it_is_not_the_same_memory(tmp_path: Path):
    buffer = FrameBuffer(24)
    assert open_frames(buffer.path, 24, "another nonce") is None
    for size in (23, 25):
        assert open_frames(buffer.path, size, buffer.nonce) is None
    assert open_frames("/proc/1/fd/does-not-exist", 24, buffer.nonce) is None
    plain = tmp_path / "file"
    plain.write_bytes(bytes(HEADER_BYTES + 24))
    assert open_frames(str(plain), 24, buffer.nonce) is None
    buffer.close()


def test_nothing_appears_in_shared_memory():
    before = set(os.listdir("/dev/shm"))
    buffer = FrameBuffer(1 << 20)
    np.testing.assert_array_equal(buffer.array(Channel("camera", (4,), "|u1"), 0), 0)
    assert set(os.listdir("/dev/shm")) == before
    buffer.close()


def test_channels_lie_side_by_side_and_aligned():
    channels = [
        Channel("camera", (2, 3, 5, 3), "|u1"),
        Channel("depth", (2, 3, 5), "<f4"),
        Channel("lidar.roof", (2, 7, 8), "<f4"),
    ]
    offsets, size = lay_out(channels)
    assert offsets == {"camera": 0, "depth": 128, "lidar.roof": 256}
    assert size == 256 + 448
    buffer = FrameBuffer(size)
    arrays = {c.name: buffer.array(c, offsets[c.name]) for c in channels}
    for number, array in enumerate(arrays.values()):
        array[...] = number + 1
    for number, (channel, array) in enumerate(zip(channels, arrays.values(), strict=True)):
        assert (array == number + 1).all()
        assert array.shape == channel.shape
    buffer.close()


def test_no_buffer_where_the_system_grants_none():
    """And no descriptor stays behind."""
    before = os.listdir("/proc/self/fd")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (HEADER_BYTES, hard))
    try:
        assert offer_frames(4096) is None
        assert os.listdir("/proc/self/fd") == before
        buffer = offer_frames(0)
        assert buffer is not None
        buffer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
