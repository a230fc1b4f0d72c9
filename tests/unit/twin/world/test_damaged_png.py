"""What claims to be gigabytes in a few bytes is refused, and not believed first."""

import resource
import struct
import zlib

import cv2
import numpy as np
import pytest

from schemas.files.drive_record import RecordArray
from twin.base.errors import UsageError
from twin.base.picture_file import read_picture
from twin.records.drive_record import decoded
from twin.world.meshes.terrain import read_samples

BELIEVED_KB = 500_000
"""More than any of this takes, and far less than what the chunk claims [kB]."""


def damaged(picture):
    """The chunk of the picture, which is cut off, says that it is 0xf9ff0014 bytes long."""
    data = bytearray(cv2.imencode(".png", picture)[1].tobytes())
    data[33:37] = struct.pack(">I", 0xF9FF0014)
    del data[44:]
    return bytes(data)


def peak_kb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def test_a_chunk_is_not_taken_at_its_word(tmp_path):
    before_kb = peak_kb()
    path = tmp_path / "hill.png"
    path.write_bytes(damaged(np.zeros((3, 3), np.uint8)))
    with pytest.raises(ValueError, match="not a PNG file"):
        read_samples(path)
    shape = [3, 3, 3]
    array = RecordArray("uint8", shape, "png", damaged(np.zeros(shape, np.uint8)), -1)
    with pytest.raises(ValueError, match="cannot be decoded"):
        decoded(array)
    path.write_bytes(array.data)
    with pytest.raises(UsageError, match=r"hill\.png: no picture that can be read"):
        read_picture(path)
    assert peak_kb() - before_kb < BELIEVED_KB


def test_an_array_larger_than_a_block_is_not_unpacked():
    before_kb = peak_kb()
    zeros = zlib.compress(bytes(64 << 20), 9)
    for shape in ([(1 << 30) + 1], [1 << 40, 1 << 40], [-1, 1 << 20]):
        with pytest.raises(ValueError, match=r"an array of -?\d+ bytes, at most 1073741824"):
            decoded(RecordArray("uint8", shape, "zlib", zeros, -1))
    assert peak_kb() - before_kb < BELIEVED_KB
