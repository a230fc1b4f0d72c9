"""Many small pictures as one image: a wall of N cases is one entity, not N."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

TILE_WIDTH_PX, TILE_HEIGHT_PX = 160, 90
"""Size of a tile; pictures keep their proportions inside."""
GAP_PX = 6
"""Between tiles of a row, where the frames are drawn [px]."""
LABEL_PX = 18
"""Between rows, where the labels stand [px]."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Where ``count`` tiles stand: rows from the left upper corner, about 16:9 altogether."""

    count: int

    @property
    def columns(self) -> int:
        """Tiles in a row, at least 1."""
        return max(1, math.ceil(math.sqrt(self.count)))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the mosaic."""
        rows = max(1, -(-self.count // self.columns))
        return (
            self.columns * (TILE_WIDTH_PX + GAP_PX) + GAP_PX,
            rows * (TILE_HEIGHT_PX + LABEL_PX) + GAP_PX,
        )

    def corner_px(self, index: int) -> tuple[int, int]:
        """Left upper corner of a tile."""
        row, column = divmod(index, self.columns)
        return (
            GAP_PX + column * (TILE_WIDTH_PX + GAP_PX),
            GAP_PX + row * (TILE_HEIGHT_PX + LABEL_PX),
        )

    def boxes_px(self) -> list[tuple[int, int, int, int]]:
        """Frames of all tiles: x, y, width, height."""
        return [(*self.corner_px(i), TILE_WIDTH_PX, TILE_HEIGHT_PX) for i in range(self.count)]


def compose(pictures: list[np.ndarray | None]) -> np.ndarray:
    """BGR pictures (None: not readable) -> BGR mosaic, uint8 [H, W, 3]."""
    grid = Grid(len(pictures))
    width, height = grid.size_px
    mosaic = np.full((height, width, 3), 24, np.uint8)
    for index, picture in enumerate(pictures):
        if picture is None:
            continue
        tile = _fitted(picture)
        x, y = grid.corner_px(index)
        x += (TILE_WIDTH_PX - tile.shape[1]) // 2
        y += (TILE_HEIGHT_PX - tile.shape[0]) // 2
        mosaic[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    return mosaic


def decoded(jpeg: bytes) -> np.ndarray | None:
    """JPEG -> BGR uint8 [H, W, 3]; None if it is none."""
    try:
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return picture


def encoded(mosaic: np.ndarray) -> bytes:
    """BGR image -> JPEG."""
    _, data = cv2.imencode(".jpg", mosaic, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return bytes(data)


def _fitted(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    scale = min(TILE_WIDTH_PX / width, TILE_HEIGHT_PX / height)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    if size == (width, height):
        return picture
    smaller = scale < 1
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
