"""The README's film: scenarios that ship, as the ego sees them, side by side: ``make film``.

Nobody drives the ego: it keeps its speed, and the film ends shortly before it would touch somebody.
Pictures are those of ``twin snapshot``; the same code gives the same film.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from schemas.campaign import Camera
from twin.play.critical_moment import critical_moment_s
from twin.snapshot import scenario_film

SCENARIOS = (
    *("crossing-cyclist", "pedestrian-between-parked-cars", "child-behind-bus"),
    *("cut-in", "oncoming-turner", "animal-on-rural-road"),
)
COLUMNS = 3
FRAME_MS = 125
BYTES_MAX = 1_000_000


def frames(count: int, width_px: int) -> list[Image.Image]:
    """Pictures of all scenarios in a grid, ``count`` of them over the seconds before the moment."""
    camera = Camera(width=width_px, height=width_px * 9 // 16)
    films = []
    for name in SCENARIOS:
        moment_s = critical_moment_s(name)
        times_s = [max(0.0, moment_s - k * FRAME_MS / 1000) for k in range(count)][::-1]
        films.append(list(scenario_film(name, times_s, camera=camera)))
        print(name, file=sys.stderr)
    made = []
    for pictures in zip(*films, strict=True):
        rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
        made.append(Image.fromarray(np.vstack(rows)))
    return made


def main() -> int:
    """Make the film."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="file to write, .webp")
    parser.add_argument("--count", type=int, default=24, help="pictures, 8 a second")
    parser.add_argument("--width", type=int, default=272, help="width of one scenario [px]")
    given = parser.parse_args()
    made = frames(given.count, given.width)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    durations = [FRAME_MS] * (len(made) - 1) + [1500]
    quality = 70
    while True:
        made[0].save(
            given.out,
            save_all=True,
            append_images=made[1:],
            duration=durations,
            loop=0,
            quality=quality,
            method=6,
        )
        size = given.out.stat().st_size
        if size < BYTES_MAX or quality <= 20:
            break
        quality -= 10
    print(f"{given.out}: {size:,} bytes, quality {quality}")
    return 0 if size < BYTES_MAX else 1


if __name__ == "__main__":
    sys.exit(main())
