"""The moment of a scenario that is worth a picture: shortly before somebody comes nearest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.play.permutations import play_file
from twin.play.playing import PlayedScenario

LEAD_S = 0.7
"""So long before the ego is nearest to somebody [s]."""
TOUCH_M = 0.2
"""Nearer than this counts as touching: what comes after is nothing that a stack would see [m]."""
_EVERY = 5
_STEP_S = 0.01


def critical_moment_s(scenario: str) -> float:
    """Time of a scenario shortly before the ego touches somebody, or is nearest to somebody, if
    nobody drives it otherwise [s]; 0 if it is alone.

    Args:
        scenario: name of a shipped scenario, or path of a file.

    Raises:
        ValueError: it cannot be played; a line for each mistake.
    """
    (play,) = play_file(
        Path(scenario), None, None, step_s=_STEP_S, every=_EVERY, until_s=600.0, device="cpu"
    )
    gaps = _gaps_m(play.played)
    if not len(gaps):
        return 0.0
    touching = np.flatnonzero(gaps < TOUCH_M)
    nearest = int(touching[0]) if len(touching) else int(np.argmin(gaps))
    return max(0.0, round(nearest * _EVERY * _STEP_S - LEAD_S, 2))


def _gaps_m(played: PlayedScenario) -> np.ndarray:
    """Distance from the middle of the ego's front to the nearest box, by kept state."""
    program = played.program
    poses: dict[str, dict[float, tuple[float, float, float]]] = {}
    for row in played.rows:
        poses.setdefault(row.entity, {})[row.time_s] = (row.x_m, row.y_m, row.heading_rad)
    own = next((entity for entity in program.entities if entity.ego), program.entities[0])
    front_m = own.box.centre_x_m + 0.5 * own.box.length_m
    track = poses.get(own.name, {})
    gaps = np.full(len(track), np.inf)
    for entity in program.entities:
        if entity is own:
            continue
        box, others = entity.box, poses.get(entity.name, {})
        for index, (time_s, (x, y, heading)) in enumerate(track.items()):
            if time_s not in others:
                continue
            at_x, at_y, turn = others[time_s]
            dx = x + front_m * np.cos(heading) - at_x
            dy = y + front_m * np.sin(heading) - at_y
            ahead = dx * np.cos(turn) + dy * np.sin(turn) - box.centre_x_m
            left = dy * np.cos(turn) - dx * np.sin(turn) - box.centre_y_m
            off_x = max(abs(ahead) - 0.5 * box.length_m, 0.0)
            # The front is as wide as the ego: what is within its width lies ahead of it.
            off_y = max(abs(left) - 0.5 * (box.width_m + own.box.width_m), 0.0)
            gaps[index] = min(gaps[index], float(np.hypot(off_x, off_y)))
    return gaps if np.isfinite(gaps).any() else np.zeros(0)
