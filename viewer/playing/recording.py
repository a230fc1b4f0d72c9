"""Writes a played scenario as a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import rerun as rr

from schemas.escape import escape
from schemas.files.played_scenario import PlayFile
from twin.base.errors import InfrastructureError
from twin.records.play_file import poses_of
from viewer.playing import paths
from viewer.playing.bodies import bodies, styles
from viewer.playing.eyes import top_eyes
from viewer.playing.ground import ground
from viewer.playing.layout import play_blueprint
from viewer.playing.names import body_names
from viewer.playing.story import fired, log_rows, summary
from viewer.recording import naming
from viewer.recording.rows import EntityRows, send

FAR_M = 8_192.0
"""Rerun draws in single precision: places farther from zero are moved near to it [m]."""
_GRID_M = 1_000.0

Told = Callable[[int, int], None]
"""Told how many of how many parts are written."""


def write_recording(
    play: PlayFile,
    out: Path,
    *,
    speed: float = 1.0,
    paused: bool = False,
    told: Told | None = None,
) -> None:
    """Write ``play`` as ``out``.

    Args:
        play: what was played.
        out: the recording, which is replaced.
        speed: at which it plays in a viewer, 1: as in sim time.
        paused: it waits when it is opened.
        told: told of the progress.

    Raises:
        InfrastructureError: it cannot be written.
    """
    origin_m = origin(play)
    stream = rr.RecordingStream(paths.APP, recording_id=naming.safe_id(play.name)[-100:] or "play")
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    layout = play_blueprint(play, origin_m, speed=speed, paused=paused)
    try:
        stream.set_sinks(rr.FileSink(out), default_blueprint=layout)
        stream.send_recording_name(escape(play.name, 80))
        stream.send_property("play", _about(play, origin_m))
        stream.log(paths.ROOT, rr.ViewCoordinates.FLU, static=True)
        stream.log(paths.SUMMARY, summary(play), static=True)
        for path, archetype in (*ground(play, origin_m), *styles(play)):
            stream.log(path, archetype, static=True)
        total = len(play.entities)
        done = 0
        for rows in _rows(play, origin_m):
            send(stream, rows)
            if told is not None and rows.path.startswith(paths.SPEEDS):
                done += 1
                told(done, total)
        stream.flush()
    except (RuntimeError, OSError, ValueError) as error:
        raise InfrastructureError(f"{out}: the recording cannot be written: {error}") from None
    finally:
        stream.disconnect()


def _rows(play: PlayFile, origin_m: np.ndarray) -> Iterator[EntityRows]:
    if play.transitions:
        yield log_rows(play)
    yield from fired(play, origin_m)
    for eye in top_eyes(play, origin_m):
        yield from body_names(play, origin_m, eye)
    yield from bodies(play, origin_m)


def origin(play: PlayFile) -> np.ndarray:
    """What is taken off all places [3] [m]; zero, unless the scenario is far from it."""
    number = paths.followed(play)
    if number < 0:
        return np.zeros(3)
    first = poses_of(play.entities[number].poses)[0, 1:4]
    if np.abs(first).max() <= FAR_M:
        return np.zeros(3)
    moved: np.ndarray = np.round(first / _GRID_M) * _GRID_M
    return moved


def _about(play: PlayFile, origin_m: np.ndarray) -> rr.AnyValues:
    return rr.AnyValues(
        name=escape(play.name),
        end_s=play.end_s,
        step_s=play.step_s,
        finished=play.finished,
        entities=[escape(entity.name) for entity in play.entities],
        origin_m=origin_m,
    )
