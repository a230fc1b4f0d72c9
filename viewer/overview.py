"""The live overview: which cases are shown, and how they become one recording. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from schemas.view import Thumbnail
from viewer import mosaic, naming
from viewer.scenery import BLUE, Color, Logged, verdict_color

TILES_MAX = mosaic.COLUMNS_MAX**2
"""Cases on the wall, at most; ended ones make room first."""

ROWS_MAX = 24
"""Lines of the table beside it."""


@dataclass(frozen=True, slots=True)
class Tile:
    """The latest of one case."""

    thumbnail: Thumbnail
    picture: np.ndarray | None


@dataclass(slots=True)
class Overview:
    """Latest tiles, oldest first, and the verdicts seen so far."""

    tiles: dict[tuple[str, str], Tile] = field(default_factory=dict)
    verdicts: dict[tuple[str, str], str] = field(default_factory=dict)

    def take(self, thumbnail: Thumbnail, jpeg: bytes) -> None:
        """A thumbnail arrived."""
        key = (thumbnail.campaign, thumbnail.case)
        self.tiles[key] = Tile(thumbnail, mosaic.decoded(jpeg))
        if thumbnail.outcome:
            self.verdicts[key] = thumbnail.verdict or thumbnail.outcome
        while len(self.tiles) > TILES_MAX:
            ended = (k for k, tile in self.tiles.items() if tile.thumbnail.outcome)
            del self.tiles[next(ended, next(iter(self.tiles)))]

    def logged(self) -> list[Logged]:
        """The wall and the table as they stand."""
        tiles = list(self.tiles.values())
        wall = [
            mosaic.Tile(
                tile.picture,
                tile.thumbnail.case,
                _color(tile.thumbnail),
                ended=bool(tile.thumbnail.outcome),
            )
            for tile in tiles
        ]
        picture = mosaic.encoded(mosaic.compose(wall))
        frames = rr.Boxes2D(
            array=mosaic.Grid(len(tiles)).boxes_px(),
            array_format=rr.Box2DFormat.XYWH,
            colors=[_color(tile.thumbnail) for tile in tiles],
            labels=[tile.thumbnail.case for tile in tiles],
            radii=rr.Radius.ui_points(2.0),
            show_labels=False,
        )
        return [
            (naming.MOSAIC, rr.EncodedImage(contents=picture, media_type="image/jpeg")),
            (naming.TILES, frames),
            (naming.CASES, rr.TextDocument(self.table(), media_type="text/markdown")),
        ]

    def table(self) -> str:
        """Running cases first, then the latest that ended; Markdown."""
        thumbnails = [tile.thumbnail for tile in self.tiles.values()]
        running = [t for t in thumbnails if not t.outcome]
        latest = [t for t in thumbnails if t.outcome][::-1]
        counts: dict[str, int] = {}
        for verdict in self.verdicts.values():
            counts[verdict] = counts.get(verdict, 0) + 1
        told = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items())) or "none ended"
        lines = [f"**{len(running)} running**, {told}", ""]
        lines += ["| case | | t [s] | v [m/s] | DTC [m] |", "|---|---|---|---|---|"]
        lines += [_row(t) for t in (running + latest)[:ROWS_MAX]]
        return "\n".join(lines) + "\n"


def _row(t: Thumbnail) -> str:
    state = t.verdict or t.outcome or ("AEB" if t.aeb else "running")
    return (
        f"| {t.case} | {state.replace('_', ' ')} | {t.sim_time_ns / 1e9:.1f} "
        f"| {t.speed_mps:.1f} | {t.dtc_m:.1f} |"
    )


def _color(t: Thumbnail) -> Color:
    return verdict_color(t.verdict) if t.outcome else BLUE
