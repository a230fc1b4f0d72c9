"""The live overview: which cases are shown, and how they become one recording. No I/O, no clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
import rerun as rr

from schemas.wire.view import Thumbnail
from viewer.live import mosaic
from viewer.recording import naming
from viewer.recording.scenery import BLUE, VIOLET, Color, Logged, verdict_color

TILES_MAX = mosaic.COLUMNS_MAX**2
"""Cases on the wall, at most; ended ones make room first."""

ROWS_MAX = 24
"""Lines of the table beside it."""


@dataclass(frozen=True, slots=True)
class CaseTile:
    """The latest of one case."""

    thumbnail: Thumbnail
    picture: np.ndarray | None


@dataclass(frozen=True, slots=True)
class End:
    """What the conductor said of a case's end."""

    token: int
    """Attempts up to this one run no more."""
    outcome: str
    verdict: str = ""
    final: bool = True
    """Whether the case has ended for good; False: it waits for another attempt."""


COMMITTED = 2**63
"""Token of an end after which no attempt counts."""

Key = tuple[str, str]
"""Campaign and case."""


@dataclass(slots=True)
class Overview:
    """Latest tiles, oldest first, and the verdicts seen so far.

    A case may have two attempts at once, whose thumbnails come in any order: the later one is
    shown, and what the conductor says of the end counts.
    """

    tiles: dict[Key, CaseTile] = field(default_factory=dict)
    verdicts: dict[Key, str] = field(default_factory=dict)
    _latest: dict[Key, tuple[int, bool]] = field(default_factory=dict)
    """Largest token seen, and whether that attempt has ended."""
    _ends: dict[Key, End] = field(default_factory=dict)

    @property
    def running(self) -> int:
        """Cases on the wall that have not ended."""
        return sum(not tile.thumbnail.outcome for tile in self.tiles.values())

    def take(self, thumbnail: Thumbnail, jpeg: bytes) -> bool:
        """A thumbnail arrived; False: it is of an attempt that is over, and changes nothing."""
        key = (thumbnail.campaign, thumbnail.case)
        token, ended = self._latest.get(key, (0, False))
        now_ended = bool(thumbnail.outcome)
        if (thumbnail.token, now_ended) < (token, ended):
            return False
        self._latest[key] = (thumbnail.token, now_ended)
        end = self._ends.get(key)
        if not now_ended and end is not None and thumbnail.token <= end.token:
            thumbnail = _ended(thumbnail, end)
        elif not now_ended:
            self.verdicts.pop(key, None)  # it runs again
        self.tiles[key] = CaseTile(thumbnail, mosaic.decoded(jpeg))
        if now_ended or (thumbnail.outcome and end is not None and end.final):
            self.verdicts[key] = thumbnail.verdict or thumbnail.outcome
        self._make_room()
        return True

    def event(self, fact: Mapping[str, Any]) -> bool:
        """A fact of the conductor; whether the wall has changed."""
        keyed_end = self._end_of(fact)
        if keyed_end is None:
            return False
        key, end = keyed_end
        known = self._ends.get(key)
        if known is not None and known.token > end.token:
            return False
        self._ends[key] = end
        tile = self.tiles.get(key)
        if tile is None or tile.thumbnail.token > end.token:
            return False
        if tile.thumbnail.outcome and not end.final:
            return False
        self.tiles[key] = replace(tile, thumbnail=_ended(tile.thumbnail, end))
        if end.final:
            self.verdicts[key] = end.verdict or end.outcome
        return True

    def forget(self, campaign: str) -> None:
        """Forget a campaign that was begun anew: its tokens start again."""
        for known in (self._latest, self._ends):
            for key in [key for key in known if key[0] == campaign]:
                del known[key]

    def _end_of(self, fact: Mapping[str, Any]) -> tuple[Key, End] | None:
        match fact.get("fact"):
            case "committed":
                result = fact["result"]
                end = End(COMMITTED, result["outcome"], result["verdict"])
                return (result["campaign"], result["case"]), end
            case "case_ended":
                key = (fact["campaign"], fact["case"])
                known = self._ends.get(key)
                # All attempts until now; a retry gets a later token.
                token = max(self._latest.get(key, (0, False))[0], known.token if known else 0)
                return key, End(token, fact["outcome"])
            case "attempt_ended":
                key = (fact["campaign"], fact["case"])
                return key, End(fact["token"], fact["reason"], final=False)
        return None

    def _make_room(self) -> None:
        while len(self.tiles) > TILES_MAX:
            ended = (k for k, tile in self.tiles.items() if tile.thumbnail.outcome)
            del self.tiles[next(ended, next(iter(self.tiles)))]

    def logged(self) -> list[Logged]:
        """The wall and the table as they stand."""
        tiles = list(self.tiles.values())
        wall = [
            mosaic.MosaicTile(
                tile.picture,
                _label(tile.thumbnail),
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
            labels=[_label(tile.thumbnail) for tile in tiles],
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
        ended = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items())) or "none ended"
        lines = [f"**{len(running)} running**, {ended}", ""]
        lines += ["| case | | t [s] | v [m/s] | DTC [m] |", "|---|---|---|---|---|"]
        lines += [_row(t) for t in (running + latest)[:ROWS_MAX]]
        return "\n".join(lines) + "\n"


def _ended(thumbnail: Thumbnail, end: End) -> Thumbnail:
    return msgspec.structs.replace(thumbnail, outcome=end.outcome, verdict=end.verdict)


def _row(t: Thumbnail) -> str:
    state = t.verdict or t.outcome or t.hand or ("AEB" if t.aeb else "running")
    return (
        f"| {t.case} | {state.replace('_', ' ')} | {t.sim_time_ns / 1e9:.1f} "
        f"| {t.speed_mps:.1f} | {'-' if t.dtc_m is None else f'{t.dtc_m:.1f}'} |"
    )


def _label(t: Thumbnail) -> str:
    """Below a tile; what somebody does to the case comes first, so that it is never cut."""
    return f"[{t.hand}] {t.case}" if t.hand and not t.outcome else t.case


def _color(t: Thumbnail) -> Color:
    if t.outcome:
        return verdict_color(t.verdict)
    return VIOLET if t.hand else BLUE
