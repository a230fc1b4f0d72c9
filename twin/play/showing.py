"""Shows what was played: the viewer, in a process of its own, as anybody would start it."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from schemas.files.played_scenario import PLAY_SUFFIX
from twin.base.errors import UsageError
from twin.play.report import NamedPlay
from twin.play.saving import save_plays


def show_play(
    file: Path, plays: Sequence[NamedPlay], step_s: float, speed: float, told: TextIO
) -> None:
    """Show the only play of a file by `viewer play`, until its window is closed.

    Args:
        file: what was played.
        plays: the one play.
        step_s: step of the player [s].
        speed: sim time per wall time.
        told: where the viewer says what it shows.

    Raises:
        UsageError: it cannot be shown here; the viewer has said why.
    """
    with tempfile.TemporaryDirectory(prefix="twin-play-", ignore_cleanup_errors=True) as made:
        saved = Path(made) / f"{file.stem}{PLAY_SUFFIX}"
        save_plays(saved, plays, step_s)
        command = [sys.executable, "-m", "viewer", "play", str(saved), "--speed", f"{speed:g}"]
        told.flush()
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=told, check=False)
    if done.returncode:
        raise UsageError(
            f"--speed {speed:g} opens a window, which did not work here; in a browser: "
            f"viewer play {file} --speed {speed:g} --web"
        )
