"""A campaign that runs elsewhere: known from what the conductor and the simulators say."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Any

import msgspec

from schemas.points import Point
from schemas.wire.view import Thumbnail, clock
from viewer.console.run_folder import CampaignEnding, CaseEnding, RunFolder, RunTimes, Version

NOWHERE = Path(os.devnull)
"""No file lies below it."""

CASES_MAX = 100_000
"""Most cases of a campaign without a folder; further ones are not shown."""

ASK_AGAIN_S = 10.0
"""Shortest time between two questions for all cases of a campaign within a session [s]."""


class HeardCases:
    """Endings, axes and pictures of cases as they are heard, by case in the order of their first
    word. Any thread may ask."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._endings: dict[str, CaseEnding] = {}
        self._axes: dict[str, dict[str, Any]] = {}
        self._changes = 0
        self._ended = 0
        self._newer: set[str] = set()
        """Cases of which a fact has come since the conductor was asked for all."""

    @property
    def count_ended(self) -> int:
        """Cases that have ended."""
        return self._ended

    @property
    def full(self) -> bool:
        """Whether there may be cases that are not shown, so that counts do not fit."""
        return len(self._endings) >= CASES_MAX

    @property
    def version(self) -> int:
        """Changes with every word that counts."""
        return self._changes

    def committed(self, result: dict[str, Any], worker: str, attempt: int) -> None:
        """A case has a result.

        Raises:
            msgspec.ValidationError: it is of another version.
        """
        ending = msgspec.convert(result, CaseEnding, strict=False)
        ending = msgspec.structs.replace(ending, worker=worker, attempt=attempt, attempts=attempt)
        with self._lock:
            self._put_newer(str(result["case"]), ending)

    def ended(self, case: str, outcome: str, reason: str) -> None:
        """A case has ended without a result."""
        with self._lock:
            self._put_newer(case, CaseEnding(outcome=outcome, reasons=[reason]))

    def asked(self) -> None:
        """The conductor is about to be asked for all cases as they stand."""
        with self._lock:
            self._newer = set()

    def known(self, case: str, ending: CaseEnding) -> None:
        """A case as its conductor had it when it answered, ended or not; a fact that came since it
        was asked may be newer, and stands."""
        with self._lock:
            if case not in self._newer and self._endings.get(case) != ending:
                self._put(case, ending)

    def waits_again(self, case: str) -> None:
        """What was known of its end does not hold any more."""
        with self._lock:
            if case in self._endings:
                self._put_newer(case, CaseEnding())

    def seen(self, thumbnail: Thumbnail) -> None:
        """A picture of a case has come. Its outcome is one attempt's, which may be run again, so
        it ends no case."""
        case = thumbnail.case
        with self._lock:
            if case not in self._axes and len(self._axes) < CASES_MAX:
                self._axes[case] = {
                    "model": thumbnail.model,
                    "time_of_day": clock(thumbnail.time_of_day_min),
                    "weather": thumbnail.weather,
                }
                self._endings.setdefault(case, CaseEnding())
                self._changes += 1  # its axes are new

    def leased(self, case: str) -> None:
        """A worker has it: it is a case, if nothing else said so."""
        with self._lock:
            if case not in self._endings:
                self._put(case, CaseEnding())

    def forget(self) -> None:
        """All that was heard is of another campaign of the same name."""
        with self._lock:
            self._endings, self._axes, self._ended, self._newer = {}, {}, 0, set()
            self._changes += 1

    def endings(self) -> dict[str, CaseEnding]:
        """Ending of each case, as far as it has come."""
        with self._lock:
            return dict(self._endings)

    def axes(self) -> dict[str, dict[str, Any]]:
        """Values of axes by case, as pictures said them."""
        with self._lock:
            return dict(self._axes)

    def _put_newer(self, case: str, ending: CaseEnding) -> None:
        self._put(case, ending)
        if case in self._endings:
            self._newer.add(case)

    def _put(self, case: str, ending: CaseEnding) -> None:
        before = self._endings.get(case)
        if before is None and len(self._endings) >= CASES_MAX:
            return
        self._ended += bool(ending.outcome) - bool(before is not None and before.outcome)
        self._endings[case] = ending
        self._changes += 1


class MissedEndings:
    """Decides when something was missed of a campaign. No clock.

    Status and facts come by different ways, so a difference counts when it outlasts a status.
    """

    def __init__(self) -> None:
        self._before: tuple[int, int] | None = None
        """Ended cases in the status before: as it said, and as was heard by then."""
        self._asked_s = -ASK_AGAIN_S

    def status(self, said: int, heard: int, now_s: float, *, anew: bool) -> bool:
        """Whether the conductor has to be asked for the cases as they stand.

        Args:
            said: cases that have ended, as the status says.
            heard: the same, as is known here.
            now_s: the time of a monotonic clock [s].
            anew: nothing tells what came before this status.
        """
        before, self._before = self._before, (said, heard)
        missed = extra = False
        if before is not None:
            missed, extra = before[0] > heard, min(before[1], heard) > said
        if not anew and not ((missed or extra) and now_s - self._asked_s >= ASK_AGAIN_S):
            return False
        self._asked_s = now_s
        return True


class RemoteRun(RunFolder):
    """A campaign of which no folder is at hand: everything about it is heard."""

    def __init__(self, name: str) -> None:
        super().__init__(NOWHERE / name)
        self.complete = False
        """Whether the conductor says that all cases have ended."""

    @property
    def version(self) -> Version:
        """Version of what is known here: nothing but that it has ended."""
        return (int(self.complete),)

    @property
    def served(self) -> bool:
        """A conductor has told of it."""
        return True

    def ending(self) -> CampaignEnding:
        """No case is known from here."""
        return CampaignEnding(campaign=self.id, complete=self.complete)

    def points(self) -> dict[str, Point]:
        """None are known from here."""
        return {}

    def times(self) -> RunTimes:
        """Nothing says when it began."""
        return RunTimes()
