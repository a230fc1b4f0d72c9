"""Many small pictures as one image: a wall of N cases is one entity, not N."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image

from twin.base.picture_file import DAMAGED

TILE_WIDTH_PX, TILE_HEIGHT_PX = 160, 90
"""Smallest tile, that of a thumbnail; pictures keep their proportions inside."""
GAP_PX = 6
"""Between tiles of a row, where the frames are drawn [px]."""
LABEL_PX, LABEL_MAX_PX = 18, 36
"""Between rows of the smallest tiles and of large ones, where the names stand [px]."""
COLUMNS_MAX = 8
"""Tiles in a row, at most, and rows [-]."""

WIDTH_PX = COLUMNS_MAX * (TILE_WIDTH_PX + GAP_PX) + GAP_PX
HEIGHT_PX = COLUMNS_MAX * (TILE_HEIGHT_PX + LABEL_PX) + GAP_PX
"""Size of the mosaic, however many tiles it has: a stream of pictures may not change its size."""

TEXT_SCALE = 0.33
"""Scale of the names; 26 letters fit below a thumbnail."""

BACKGROUND = 24
"""Grey of what is no picture."""

PICTURE_SIDE_MAX_PX = 4096
"""Widest and highest picture that is decoded [px]; cameras have at most 3840."""

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class MosaicTile:
    """One place on the wall."""

    picture: np.ndarray | None
    """Camera picture, BGR; None: not readable."""
    name: str
    color: Color
    """RGB of the frame and of the strip that holds the name."""
    ended: bool = False
    """The strip is filled."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Places of ``count`` tiles: rows from the left upper corner, as large as they fit."""

    count: int

    @property
    def columns(self) -> int:
        """Tiles in a row, at least 1."""
        return max(1, math.ceil(math.sqrt(self.count)))

    @property
    def tile_px(self) -> tuple[int, int]:
        """Width and height of a tile."""
        width = (WIDTH_PX - GAP_PX) // self.columns - GAP_PX
        return width, width * TILE_HEIGHT_PX // TILE_WIDTH_PX

    @property
    def label_px(self) -> int:
        """Room for the name below a tile."""
        return min(LABEL_MAX_PX, (HEIGHT_PX - GAP_PX) // self.columns - self.tile_px[1])

    def corner_px(self, index: int) -> tuple[int, int]:
        """Left upper corner of a tile."""
        row, column = divmod(index, self.columns)
        width, height = self.tile_px
        return GAP_PX + column * (width + GAP_PX), GAP_PX + row * (height + self.label_px)

    def boxes_px(self) -> list[tuple[int, int, int, int]]:
        """Frames of all tiles: x, y, width, height."""
        return [(*self.corner_px(i), *self.tile_px) for i in range(self.count)]


def compose(tiles: list[MosaicTile]) -> np.ndarray:
    """Tiles -> BGR mosaic, uint8 [:data:`HEIGHT_PX`, :data:`WIDTH_PX`, 3]."""
    grid = Grid(len(tiles))
    mosaic = np.full((HEIGHT_PX, WIDTH_PX, 3), BACKGROUND, np.uint8)
    width, height = grid.tile_px
    room = grid.label_px - 4
    for index, tile in enumerate(tiles):
        x, y = grid.corner_px(index)
        if tile.picture is not None:
            picture = _fitted(tile.picture, width, height)
            left, top = x + (width - picture.shape[1]) // 2, y + (height - picture.shape[0]) // 2
            mosaic[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        _name(mosaic[y + height : y + height + room, x : x + width], tile)
    return mosaic


def _name(strip: np.ndarray, tile: MosaicTile) -> None:
    """The name, on the strip below its tile; what does not fit is cut."""
    if tile.ended:
        strip[:] = tile.color[::-1]
    ink = (255, 255, 255) if tile.ended else tile.color[::-1]
    scale = TEXT_SCALE * strip.shape[0] / (LABEL_PX - 4)
    at = (3, round(0.7 * strip.shape[0]))
    cv2.putText(strip, tile.name, at, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, 1, cv2.LINE_AA)


def decoded(jpeg: bytes) -> np.ndarray | None:
    """JPEG -> BGR uint8 [H, W, 3]; None if it is none, or larger than any camera's."""
    try:
        # A head of a few bytes may claim four gigabytes.
        with Image.open(io.BytesIO(jpeg), formats=["JPEG"]) as head:
            if max(head.size) > PICTURE_SIDE_MAX_PX:
                return None
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    except (*DAMAGED, ValueError, cv2.error):
        return None
    return picture


def encoded(mosaic: np.ndarray) -> bytes:
    """BGR image -> JPEG."""
    _, data = cv2.imencode(".jpg", mosaic, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return bytes(data)


def _fitted(picture: np.ndarray, width_px: int, height_px: int) -> np.ndarray:
    height, width = picture.shape[:2]
    scale = min(width_px / width, height_px / height)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    if size == (width, height):
        return picture
    smaller = scale < 1
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
