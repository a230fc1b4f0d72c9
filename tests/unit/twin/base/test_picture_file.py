"""A user's pictures: the values that OpenCV gave, and one line for whatever is none."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from twin.base import picture_file
from twin.base.errors import UsageError
from twin.base.picture_file import jpeg_of, read_picture

SEEDS = Path(__file__).parents[3] / "fuzz/seeds/picture"
NOISE = np.random.default_rng(3).integers(0, 256, (5, 7, 4), np.uint8)


def _png(mode: str) -> bytes:
    if mode == "gray16":
        values = NOISE[:, :, 0].astype(np.uint16) * 257 + 3
        return cv2.imencode(".png", values)[1].tobytes()
    if mode == "color16":
        return cv2.imencode(".png", NOISE[:, :, :3].astype(np.uint16) * 256)[1].tobytes()
    data = io.BytesIO()
    picture = Image.fromarray(NOISE).convert("RGB" if mode == "P" else mode)
    picture.quantize(8).save(data, "PNG") if mode == "P" else picture.save(data, "PNG")
    return data.getvalue()


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "LA", "P", "1", "gray16", "color16"])
def test_a_png_has_the_values_that_opencv_reads(mode: str, tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    path.write_bytes(_png(mode))
    expected = cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1]
    found = read_picture(path)
    assert (found.dtype, found.flags.c_contiguous) == (np.uint8, True)
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("kind", ["jpg", "bmp", "webp"])
def test_other_formats_too(kind: str) -> None:
    expected = cv2.imread(str(SEEDS / kind), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(read_picture(SEEDS / kind), expected)


def _claiming(width: int, height: int) -> bytes:
    """A PNG whose head says so, with hardly anything in it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + crc

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no picture that can be read; allowed: PNG, JPEG, BMP, WEBP"),
        (b"GIF89a" + bytes(99), "no picture that can be read"),
        (_claiming(3, 3)[:40], "no picture"),
        (_claiming(3, 3), "no picture"),
        (_claiming(8193, 8192), "8193x8192 pixels, at most 67108864 are read"),
        (_claiming(10_000, 10_000), "no picture|pixels"),
        (_claiming(2**31 - 1, 2**31 - 1), "no picture|pixels"),
    ],
)
def test_what_is_no_picture_is_one_line(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    path.write_bytes(data)
    with pytest.raises(UsageError, match=words) as refused:
        read_picture(path)
    assert str(refused.value).startswith(str(path))
    assert len(str(refused.value).splitlines()) == 1


def test_files_that_are_missing_or_too_large(tmp_path: Path, monkeypatch) -> None:
    for path, words in ((tmp_path / "none", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(UsageError, match=words):
            read_picture(path)
    monkeypatch.setattr(picture_file, "FILE_BYTES_MAX", 10)
    with pytest.raises(UsageError, match="645 bytes, at most 10 are read"):
        read_picture(SEEDS / "jpg")


@pytest.mark.parametrize("quality", [1, 50, 75, 80, 90, 95, 100])
@pytest.mark.parametrize("shape", [(1, 1), (36, 64), (75, 133), (180, 320)])
def test_a_jpeg_has_the_bytes_that_opencv_writes(shape, quality):
    noise = np.random.default_rng(quality).normal(0.0, 9.0, (*shape, 3))
    shade = np.linspace(0.0, 255.0, shape[1])[None, :, None]
    pixels = np.clip(shade + noise, 0, 255).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, theirs = cv2.imencode(".jpg", np.ascontiguousarray(pixels[..., ::-1]), options)
    assert jpeg_of(pixels, quality) == theirs.tobytes()
    wide = np.repeat(pixels, 2, axis=1)
    assert jpeg_of(wide[:, ::2], quality) == theirs.tobytes(), "wherever its rows lie"
