"""Small pictures of cases: one each of the decisive moment, and sheets of sixty-four.

They are made when first asked for, and kept in a folder beside the run, never inside it: a signed
run stays as it was signed.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.files.regular_file import open_below
from twin.base.errors import UsageError
from viewer.live.mosaic import decoded
from viewer.playback.frames import PlayedTick, RecordedCase

SIZES = ((80, 45), (160, 90))
"""Width and height of the pictures of a sheet [px]."""
PER_ROW, PER_SHEET = 8, 64
MOMENT_SIZE = (320, 180)
"""Largest width and height of a single picture [px]."""
FILM_FRAMES = 16
"""Frames of one strip of a film, side by side."""

QUALITY = 75
"""Of WebP, 0 to 100."""

CACHE_BYTES_MAX = 512 << 20
"""Largest size of the folder of pictures; the files that were not asked for longest go first."""
MEMORY_BYTES_MAX = 32 << 20
"""What is kept in memory where no folder can be written."""
_BACKGROUND = (24, 24, 24)

Picture = NDArray[np.uint8]


class PictureCache:
    """Pictures by name; in a folder of ours beside the run, or in memory. Any thread may ask."""

    def __init__(
        self,
        folder: Path | None,
        bytes_max: int = CACHE_BYTES_MAX,
        memory_max: int = MEMORY_BYTES_MAX,
    ) -> None:
        self._folder = folder
        self._bytes_max = bytes_max if folder is not None else memory_max
        self._sizes: OrderedDict[str, int] = OrderedDict()
        self._memory: dict[str, bytes] = {}
        self._lock = threading.Lock()
        self._making: dict[str, threading.Lock] = {}
        if folder is not None:
            self._adopt(folder)

    def get(self, key: str, make: Callable[[], bytes]) -> bytes:
        """The picture of that key; made once, whoever asks meanwhile waits.

        Raises:
            UsageError: as ``make`` does.
        """
        name = hashlib.sha256(key.encode()).hexdigest()[:40]
        with self._lock:
            making = self._making.setdefault(name, threading.Lock())
        try:
            with making:
                if (data := self._read(name)) is None:
                    data = make()
                    self._keep(name, data)
                return data
        finally:
            with self._lock:
                self._making.pop(name, None)

    @property
    def size(self) -> int:
        """Bytes that are kept."""
        with self._lock:
            return sum(self._sizes.values())

    def _adopt(self, folder: Path) -> None:
        """What an earlier console left, the oldest first."""
        left = []
        for path in folder.iterdir() if folder.is_dir() else []:
            try:
                status = path.lstat()
            except OSError:
                continue
            if path.suffix == ".tmp":  # of one that was killed
                path.unlink(missing_ok=True)
            elif len(path.name) == 40:
                left.append((status.st_mtime_ns, path.name, status.st_size))
        self._sizes.update((name, size) for _, name, size in sorted(left))
        with self._lock:
            self._shrink()

    def _read(self, name: str) -> bytes | None:
        with self._lock:
            if name not in self._sizes:
                return None
            self._sizes.move_to_end(name)
            if self._folder is None:
                return self._memory[name]
        try:
            with open_below(self._folder, name) as file:
                return file.read()
        except OSError:
            return None

    def _keep(self, name: str, data: bytes) -> None:
        if self._folder is not None:
            temporary = self._folder / f".{secrets.token_hex(8)}.tmp"
            try:
                self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                temporary.write_bytes(data)
                temporary.replace(self._folder / name)
            except OSError:
                temporary.unlink(missing_ok=True)
                return  # a full disk costs time, no picture
        with self._lock:
            if self._folder is None:
                self._memory[name] = data
            self._sizes[name] = len(data)
            self._sizes.move_to_end(name)
            self._shrink()

    def _shrink(self) -> None:
        total = sum(self._sizes.values())
        while total > self._bytes_max and len(self._sizes) > 1:
            name, size = self._sizes.popitem(last=False)
            total -= size
            self._memory.pop(name, None)
            if self._folder is not None:
                (self._folder / name).unlink(missing_ok=True)


def cache_folder(run: Path) -> Path | None:
    """Folder of the pictures of a run, ``.console/NAME`` beside it; None: not ours to write."""
    run = run.resolve()
    beside = run.parent / ".console"
    try:
        beside.mkdir(mode=0o700, exist_ok=True)
        status = beside.lstat()
    except OSError:
        return None
    ours = status.st_uid == os.geteuid() and not beside.is_symlink()
    return beside / run.name if ours and os.access(beside, os.W_OK) else None


def moment_picture(case: RecordedCase, sim_time_ns: int) -> bytes:
    """The picture that stood at a time, as recorded but no larger than :data:`MOMENT_SIZE`, WebP.

    Raises:
        UsageError: there is none, or it is damaged.
    """
    return webp(fitted(pixels_of(case.picture_at(sim_time_ns)), *MOMENT_SIZE, enlarge=False))


def sheet(tiles: list[Picture | None], width: int, height: int) -> bytes:
    """Up to sixty-four pictures in eight rows of eight, WebP; None: the place stays dark."""
    canvas = np.full((PER_ROW * height, PER_ROW * width, 3), _BACKGROUND, np.uint8)
    for place, tile in enumerate(tiles[:PER_SHEET]):
        if tile is None:
            continue
        row, column = divmod(place, PER_ROW)
        picture = fitted(tile, width, height)
        top = row * height + (height - picture.shape[0]) // 2
        left = column * width + (width - picture.shape[1]) // 2
        canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return webp(canvas)


def strip(frames: list[PlayedTick], width: int, height: int) -> bytes:
    """Frames of a film side by side, WebP.

    Raises:
        UsageError: one is damaged.
    """
    canvas = np.full((height, width * len(frames), 3), _BACKGROUND, np.uint8)
    for place, frame in enumerate(frames):
        picture = fitted(pixels_of(frame), width, height)
        canvas[: picture.shape[0], place * width : place * width + picture.shape[1]] = picture
    return webp(canvas)


def film_size(case: RecordedCase) -> tuple[int, int]:
    """Width and height of the frames of a case's film: as recorded, at most :data:`MOMENT_SIZE`.

    Raises:
        UsageError: the recording holds no picture, or the first is damaged.
    """
    first = fitted(pixels_of(case.picture_at(0)), *MOMENT_SIZE, enlarge=False)
    return first.shape[1], first.shape[0]


def pixels_of(frame: PlayedTick) -> Picture:
    """Pixels of a recorded picture, BGR uint8 [H, W, 3].

    Raises:
        UsageError: it is damaged.
    """
    pixels = decoded(frame.jpeg or b"")
    if pixels is None:
        raise UsageError(f"the picture at {frame.sim_time_ns / 1e9:g} s is damaged")
    return pixels


def picture_from(data: bytes) -> Picture | None:
    """Pixels of a WebP or JPEG file; None: it is none."""
    if not data:
        return None
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return None if picture is None else np.asarray(picture, np.uint8)


def fitted(picture: Picture, width: int, height: int, *, enlarge: bool = True) -> Picture:
    """The picture at the largest size that fits, in its own proportions."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    if not enlarge:
        scale = min(1.0, scale)
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    if size == (picture.shape[1], picture.shape[0]):
        return picture
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=way), np.uint8)


def webp(picture: Picture) -> bytes:
    """A picture as WebP."""
    good, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    assert good
    return bytes(data)
