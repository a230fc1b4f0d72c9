"""Picture files: those that a user has are read within bounds, whatever their bytes claim.

OpenCV takes a damaged PNG chunk at its word: 59 bytes made it fill 4 GB. So PNG is read by Pillow,
which gives the same values; other formats by OpenCV, once Pillow has told their size.
"""

from __future__ import annotations

import io
import warnings
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

from schemas.files.regular_file import read_regular
from twin.base.errors import UsageError

FILE_BYTES_MAX = 256 << 20
"""Largest file [bytes]."""
PIXELS_MAX = 64 << 20
"""Largest picture [px]."""
FORMATS = ("PNG", "JPEG", "BMP", "WEBP")

DAMAGED = (
    *(OSError, SyntaxError, EOFError, zlib.error),
    *(Image.DecompressionBombError, Image.DecompressionBombWarning),
)
"""Errors that Pillow raises for bytes that are no picture."""

# Refused like every other picture that is too large, not told beside it.
warnings.simplefilter("error", Image.DecompressionBombWarning)


def read_picture(path: Path) -> np.ndarray:
    """The picture, uint8 [H, W, 3], RGB; gray ones become that, transparency is left out.

    Raises:
        UsageError: no such file, no picture of a format that is read, or too large; one line.
    """
    import cv2  # workers may be without it, and read no such files

    try:
        data = read_regular(path, FILE_BYTES_MAX)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    picture = None
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as head:
            width, height = head.size
            if width * height > PIXELS_MAX:
                raise UsageError(f"{path}: {width}x{height} pixels, at most {PIXELS_MAX} are read")
            if head.format == "PNG":
                return _rgb(head)
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except (*DAMAGED, ValueError, cv2.error):
        pass
    if picture is None:
        raise UsageError(f"{path}: no picture that can be read; allowed: {', '.join(FORMATS)}")
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def jpeg_of(pixels: np.ndarray, quality: int) -> bytes:
    """A picture as a baseline JPEG, its colours at half the resolution.

    Pillow's and OpenCV's are the same bytes; workers may be without OpenCV.

    Args:
        pixels: uint8 [H, W, 3], RGB.
        quality: 1 to 100.
    """
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality)
    return file.getvalue()


def _rgb(picture: Image.Image) -> np.ndarray:
    if picture.mode.startswith("I"):  # gray of 16 bits, which Pillow would cut off instead of scale
        gray = (np.asarray(picture) >> 8).astype(np.uint8)
        return np.repeat(gray[:, :, None], 3, axis=2)
    return np.array(picture.convert("RGB"))
