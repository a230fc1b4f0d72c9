"""`viewer play`: a played scenario in a window, a browser, a picture or a recording."""

from __future__ import annotations

import sys
import tempfile
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from schemas.escape import escape
from schemas.files.played_scenario import PLAY_SUFFIX, PlayFile
from schemas.words import counted
from twin.base.errors import TwinError, UsageError
from twin.base.process import end, spawn
from twin.base.progress import progress
from twin.records.play_file import POSE_BYTES, read_play
from viewer.browser.serve import WebOptions, run_web
from viewer.playback import native
from viewer.playback.folder import RecordedMoment
from viewer.playback.outputs import check_out
from viewer.playback.shot import shoot
from viewer.playback.window import window
from viewer.playing.recording import write_recording

SCENARIO_SUFFIXES = (".xosc", ".yaml", ".yml")
"""Files that are played first."""

END_GRACE_S = 2.0
"""Longest time that a player may take to leave [s]."""

PROGRESS_POSES = 100_000
"""From so many poses on, progress is told."""


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """What the command line says."""

    file: Path
    save: Path | None = None
    shot: Path | None = None
    size: tuple[int, int] = (1280, 720)
    at_s: float | None = None
    """Time at which it waits [s]; None: it plays, and a picture is of the first event."""
    speed: float = 1.0
    web: bool = False
    port: int = 0
    player: tuple[str, ...] = ()
    """Further options of `twin play`."""


class PlayerError(TwinError):
    """`twin play` ended; it has said why."""

    def __init__(self, exit_code: int) -> None:
        super().__init__("")
        self.exit_code = exit_code


def run_play(options: PlayOptions) -> int:
    """Show a played scenario as the options say; the exit code.

    Raises:
        TwinError: the file cannot be read or played, or something cannot be written or shown.
    """
    for out, suffix in ((options.save, ".rrd"), (options.shot, ".png")):
        if out is not None:
            check_out(out, suffix)
    with tempfile.TemporaryDirectory(prefix="viewer-play-", ignore_cleanup_errors=True) as made:
        play = load_play(options.file, Path(made), options.player)
        moment = find_moment(play, options)
        if not _is_shown_here(options):
            raise UsageError(
                "no display here; give --web for a browser, --shot OUT.png for a picture, or "
                "--save OUT.rrd for a recording to take along"
            )
        recording = options.save or Path(made) / "play.rrd"
        _write(play, recording, options)
        if options.save is not None:
            print(f"{options.save}: {_told(play)}")
        if options.shot is not None:
            shoot(recording, moment, options.shot, options.size)
            print(f"{options.shot}: {moment.label}")
        if options.web:
            stops = moment if options.at_s is not None else None
            return run_web(
                WebOptions(options.port, file=recording, case=options.file.stem, moment=stops)
            )
        if options.save is None and options.shot is None:
            _open(play, recording, moment, options)
    return 0


def load_play(file: Path, folder: Path, player: tuple[str, ...] = ()) -> PlayFile:
    """Read a played scenario, or play a scenario file first.

    Args:
        file: a ``.play`` file or a scenario file, or a name that the player knows.
        folder: for what the player writes.
        player: further options of `twin play`.

    Raises:
        UsageError: there is no such file, or it is of another kind or damaged.
        PlayerError: it cannot be played; the player has said why.
    """
    suffix = file.suffix.lower()
    if suffix == PLAY_SUFFIX:
        if player:
            raise UsageError(f"{file}: it was played already; {player[0]} is for a scenario file")
        return read_play(file)
    # A name alone may be one that the player knows.
    if suffix not in SCENARIO_SUFFIXES and (suffix or file.exists()):
        raise UsageError(
            f"{file}: expected a scenario file ({', '.join(SCENARIO_SUFFIXES)}), or what "
            f"`twin play FILE --save OUT{PLAY_SUFFIX}` wrote"
        )
    out = folder / f"scenario{PLAY_SUFFIX}"
    command = [sys.executable, "-m", "twin", "play", "--save", str(out), *player]
    # Files are told apart from options, whatever their names begin with.
    child = spawn([*command, "--", str(file)], log=sys.stderr.buffer, pipe_output=True)
    try:
        assert child.stdout is not None
        while child.stdout.read(1 << 16):  # its table is shown as a log here
            pass
        code = child.wait()
    finally:
        end(child, END_GRACE_S)
    if code:
        raise PlayerError(code)
    return read_play(out)


def find_moment(play: PlayFile, options: PlayOptions) -> RecordedMoment:
    """The moment that was asked for; else of a picture the first event after the beginning, and
    otherwise the beginning.

    Raises:
        UsageError: the scenario ends before.
    """
    at_s = options.at_s
    if at_s is not None:
        # The last state may differ from a round time in its last bit.
        if at_s > play.end_s + 1e-6:
            raise UsageError(f"--at-s {at_s:g}: the scenario ends at {play.end_s:g} s")
        return RecordedMoment(round(at_s * 1e9), f"{at_s:g} s")
    if options.shot is not None:
        for item in play.transitions:
            event = play.elements[item.element]
            if event.level == "event" and item.transition == "start" and item.time_s > 0.0:
                label = f"event {escape(event.name, 80)} begins at {item.time_s:.2f} s"
                return RecordedMoment(round(item.time_s * 1e9), label)
    return RecordedMoment(0, "the beginning")


def _is_shown_here(options: PlayOptions) -> bool:
    elsewhere = options.web or options.save is not None or options.shot is not None
    return elsewhere or native.has_display()


def _write(play: PlayFile, out: Path, options: PlayOptions) -> None:
    poses = sum(len(entity.poses) for entity in play.entities) // POSE_BYTES
    many = poses >= PROGRESS_POSES
    with progress("viewer play", "drawing", "entities") if many else nullcontext() as told:
        paused = options.at_s is not None
        write_recording(play, out, speed=options.speed, paused=paused, told=told)


def _open(play: PlayFile, recording: Path, moment: RecordedMoment, options: PlayOptions) -> None:
    print(f"{options.file}: {_told(play)}; close the window to end")
    with window([str(recording)]) as shown:
        if options.at_s is not None:
            shown.show(moment)
        shown.process.wait()


def _told(play: PlayFile) -> str:
    events = sum(
        item.transition == "start" and play.elements[item.element].level == "event"
        for item in play.transitions
    )
    bodies = counted(len(play.entities), "entity", "entities")
    return f"{play.end_s:.2f} s, {bodies}, {counted(events, 'event')} began"
