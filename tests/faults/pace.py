"""Cases per minute without a viewer, with one, and with one that is frozen.

All three on one fabric, in turn, because what else the machine does changes from minute to minute.
"""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from pathlib import Path

from fabric import Fabric, fabric
from injection import PATIENCE_S, POLL_S

STATES = ("none", "looking", "frozen")
ROUNDS = 4
SECONDS = 8.0
"""Of one state in one round."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Cases per minute."""

    none: float
    looking: float
    frozen: float

    def words(self) -> str:
        """A line for the page."""
        return (
            f"Cases per minute: {self.none:.0f} without a viewer, {self.looking:.0f} with one "
            f"({self.looking / self.none:.2f}), {self.frozen:.0f} with one that is frozen "
            f"({self.frozen / self.none:.2f})."
        )


def measure(folder: Path, seconds: float = SECONDS, rounds: int = ROUNDS) -> Pace:
    """Run a fabric in ``folder``, which is new.

    Args:
        folder: of the fabric.
        seconds: of one state in one round [s].
        rounds: how often each state comes.
    """
    commits = dict.fromkeys(STATES, 0)
    spent_s = dict.fromkeys(STATES, 0.0)
    with fabric(folder, frozenset({"viewer"})) as made:
        viewer = made.roles["viewer"]
        viewer.held = 1
        _commits(made, until=1)
        for _ in range(rounds):
            for state in STATES:
                _enter(made, state)
                began_s, before = time.monotonic(), _count(made)
                while time.monotonic() - began_s < seconds:
                    made.tend(feeding=True)
                    time.sleep(POLL_S)
                commits[state] += _count(made) - before
                spent_s[state] += time.monotonic() - began_s
            assert viewer.child is not None
            viewer.child.send_signal(signal.SIGCONT)
    return Pace(*(60.0 * commits[state] / spent_s[state] for state in STATES))


def _enter(made: Fabric, state: str) -> None:
    """Bring the viewer into a state, and wait until it looks if it is to look."""
    viewer = made.roles["viewer"]
    viewer.held = int(state == "none")
    if state == "none" and viewer.child is not None:
        viewer.child.kill()
        viewer.child.wait()
    if state == "looking":
        log = made.folder / "viewer.log"
        size = log.stat().st_size if log.exists() else 0
        until_s = time.monotonic() + PATIENCE_S
        while not (log.exists() and b"Ctrl-C ends" in log.read_bytes()[size:]):
            assert time.monotonic() < until_s, "the viewer does not connect"
            made.tend(feeding=True)
            time.sleep(POLL_S)
    if state == "frozen":
        assert viewer.child is not None
        viewer.child.send_signal(signal.SIGSTOP)


def _count(made: Fabric) -> int:
    return sum(len(campaign.committed) for campaign in made.campaigns)


def _commits(made: Fabric, until: int) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while _count(made) < until:
        assert time.monotonic() < until_s, "no case was committed"
        made.tend(feeding=True)
        time.sleep(POLL_S)
