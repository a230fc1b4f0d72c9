"""A picture of the wall of running cases, rendered without a window."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from schemas.words import counted
from twin.base.errors import InfrastructureError, UnreachableError
from twin.base.progress import counter
from twin.fabric.discovery import refuse_ended
from viewer.live.command import TURN_S, Live, LiveOptions
from viewer.live.hub import open_hub
from viewer.live.overview import TILES_MAX
from viewer.playback.outputs import write_whole
from viewer.playback.window import asked, window

SETTLE_S = 3.0
"""Time for the latest wall to reach the renderer, which lags without a GPU [s]."""


@dataclass(frozen=True, slots=True)
class WallShot:
    """What the picture shows."""

    cases: int
    running: int

    @property
    def told(self) -> str:
        """``8 cases: 5 running, 3 ended``."""
        ended = self.cases - self.running
        return f"{counted(self.cases, 'case')}: {self.running} running, {ended} ended"


def shoot_wall(
    options: LiveOptions, out: Path, size: tuple[int, int], wait_s: float, watch_s: float = 0.0
) -> WallShot:
    """Render the wall once all cases that run are on it, or after ``wait_s`` those that are.

    Then it looks on for ``watch_s``, so that verdicts come and plots grow.

    Raises:
        InfrastructureError: no Vulkan driver, or the viewer failed.
        UnreachableError: no conductor, or no case runs.
        UsageError: ``out`` cannot be written, another key or another version.
    """
    if options.run is not None:
        refuse_ended(options.run)
    live = Live(options, open_hub(0, bare=True))
    until_s = time.monotonic() + wait_s
    arguments = ["--window-size", f"{size[0]}x{size[1]}", "--connect", live.hub.url]
    more = counter("steps", 3)
    try:
        with window(arguments, headless=True) as shown:
            while not _whole(live) and time.monotonic() < until_s:
                _turn(live)
            if not live.overview.tiles:
                raise UnreachableError(
                    f"{options.where}: no case has shown itself for {wait_s:g} s; is one running?"
                )
            more(1)
            settled_s = time.monotonic() + max(SETTLE_S, watch_s)
            while time.monotonic() < settled_s:
                _turn(live)
            shown.loaded(1)
            more(1)
            picture = asked(shown.client.take_screenshot)
    finally:
        live.close()
    if not picture:
        raise InfrastructureError("viewer: it has rendered nothing")
    write_whole(out, picture)
    more(1)
    return WallShot(len(live.overview.tiles), live.overview.running)


def _turn(live: Live) -> None:
    live.turn(time.time())
    time.sleep(TURN_S)


def _whole(live: Live) -> bool:
    """Every case that the conductor has given to a worker is on the wall."""
    running = live.overview.running
    return running > 0 and running >= min(live.leased, TILES_MAX)
