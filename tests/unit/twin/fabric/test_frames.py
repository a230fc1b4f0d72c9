"""Shared frame buffers: same memory or nothing, and no trace in the file system."""

import contextlib
import fcntl
import mmap
import os
import resource
import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from twin.fabric import frames
from twin.fabric.frames import (
    HEADER_BYTES,
    FrameBuffer,
    FrameChannel,
    lay_out,
    offer_frames,
    open_frames,
)
from twin.fabric.rig_folder import RigFolder, frames_socket


@pytest.fixture
def door():
    folder = RigFolder()
    yield frames_socket(folder.drive)
    folder.close()


def handed_out(path):
    """The descriptor as a stack of somebody else would take it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
        peer.connect(str(path))
        return socket.recv_fds(peer, 16, 1)[1]


def test_who_has_the_descriptor_can_read_and_nothing_else(door):
    buffer = FrameBuffer(24, door)
    array = buffer.array(FrameChannel("camera", (24,), "|u1"), 0)
    (fd,) = handed_out(door)
    size = HEADER_BYTES + 24
    with pytest.raises(PermissionError):
        mmap.mmap(fd, size)
    for write in (
        lambda: os.pwrite(fd, b"forged", 0),
        lambda: os.ftruncate(fd, 0),
        lambda: os.ftruncate(fd, 2 * size),
        lambda: fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE),
        lambda: mmap.mmap(os.open(f"/proc/self/fd/{fd}", os.O_RDWR), size),
    ):
        with pytest.raises(PermissionError):
            write()
    array[3] = 9  # the simulator still may
    assert os.pread(fd, 1, HEADER_BYTES + 3) == b"\x09"
    os.close(fd)
    buffer.close()


def test_it_is_had_by_a_few_and_only_until_the_door_is_shut(door):
    buffer = FrameBuffer(24, door)
    for _ in range(frames.PEERS_MAX):
        (fd,) = handed_out(door)
        os.close(fd)
    buffer.shut()
    assert not door.exists()
    buffer.close()


def test_another_user_gets_nothing(door, monkeypatch):
    monkeypatch.setattr(frames, "_user_of", lambda peer: os.geteuid() + 1)
    buffer = FrameBuffer(24, door)
    assert handed_out(door) == []
    assert open_frames(buffer.path, 24, buffer.nonce) is None
    buffer.close()


def test_memory_that_may_shrink_is_not_mapped(door):
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listening.bind(str(door))
    listening.listen()
    fd = os.memfd_create("unsealed", os.MFD_ALLOW_SEALING)
    os.ftruncate(fd, HEADER_BYTES + 24)
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    with listening, client:

        def serve():
            peer, _ = listening.accept()
            with peer:
                socket.send_fds(peer, [b"frames"], [fd])

        thread = threading.Thread(target=serve)
        thread.start()
        assert open_frames(str(door), 24, "") is None
        thread.join()
    os.close(fd)


def test_both_sides_see_the_same_memory(door):
    buffer = FrameBuffer(24, door)
    array = buffer.array(FrameChannel("camera", (2, 12), "|u1"), 0)
    mapped = open_frames(buffer.path, 24, buffer.nonce)
    assert mapped is not None
    array[1, 3] = 7
    assert mapped[HEADER_BYTES + 15] == 7
    mapped.close()
    buffer.close()


def test_refused_when_it_is_not_the_same_memory(door, tmp_path: Path):
    buffer = FrameBuffer(24, door)
    assert open_frames(buffer.path, 24, "another nonce") is None
    for size in (23, 25):
        assert open_frames(buffer.path, size, buffer.nonce) is None
    assert open_frames("/proc/1/fd/does-not-exist", 24, buffer.nonce) is None
    plain = tmp_path / "file"
    plain.write_bytes(bytes(HEADER_BYTES + 24))
    assert open_frames(str(plain), 24, buffer.nonce) is None
    buffer.close()


def test_nothing_appears_in_shared_memory(door):
    before = shared_memory_of_this_process()
    buffer = FrameBuffer(1 << 20, door)
    np.testing.assert_array_equal(buffer.array(FrameChannel("camera", (4,), "|u1"), 0), 0)
    assert "/memfd:" in Path("/proc/self/maps").read_text(), "so that files would be seen"
    assert shared_memory_of_this_process() <= before
    buffer.close()


def shared_memory_of_this_process():
    """Its files in ``/dev/shm``; tests that run beside this one have some there, too."""
    words = Path("/proc/self/maps").read_text().split()
    return {word for word in words if word.startswith("/dev/shm/")}


def test_channels_lie_side_by_side_and_aligned(door):
    channels = [
        FrameChannel("camera", (2, 3, 5, 3), "|u1"),
        FrameChannel("depth", (2, 3, 5), "<f4"),
        FrameChannel("lidar.roof", (2, 7, 8), "<f4"),
    ]
    offsets, size = lay_out(channels)
    assert offsets == {"camera": 0, "depth": 128, "lidar.roof": 256}
    assert size == 256 + 448
    buffer = FrameBuffer(size, door)
    arrays = {c.name: buffer.array(c, offsets[c.name]) for c in channels}
    for number, array in enumerate(arrays.values()):
        array[...] = number + 1
    for number, (channel, array) in enumerate(zip(channels, arrays.values(), strict=True)):
        assert (array == number + 1).all()
        assert array.shape == channel.shape
    buffer.close()


def test_no_buffer_where_the_system_grants_none(door):
    """And no descriptor stays behind."""
    before = frame_descriptors()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (HEADER_BYTES, hard))
    try:
        assert offer_frames(4096, door) is None
        assert frame_descriptors() == before
        buffer = offer_frames(0, door)
        assert buffer is not None
        buffer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def frame_descriptors():
    """Descriptors of anonymous memory that this process has open."""
    found = []
    for path in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # the folder's own
            if path.readlink().name.startswith("memfd:"):
                found.append(path.name)
    return found
