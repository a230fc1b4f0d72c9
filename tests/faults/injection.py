"""One run of the table: faults on a fabric, one after the other or as a storm.

Every injection is a line of the fault journal before the next one comes.
"""

from __future__ import annotations

import json
import random
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO

from fabric import Fabric
from kinds import Fault

PATIENCE_S = 180.0
"""Longest wait for a commit, or for the end of all cases."""
POLL_S = 0.03


@dataclass(frozen=True, slots=True)
class Plan:
    """What is done to one fabric."""

    faults: tuple[Fault, ...]
    times: int
    """Injections."""
    seed: int
    pause_s: tuple[float, float] | None = None
    """A storm: drawn from ``faults``, so long from one injection to the next, whatever has healed;
    None: in turn, one at a time, and each after the commit that ends the one before."""


@dataclass(slots=True)
class _Active:
    fault: Fault
    healing: Iterator[str]
    until_s: float
    entry: dict[str, object]


@dataclass(slots=True)
class Injector:
    """Carries a plan out on a fabric that :meth:`Fabric.tend` keeps alive."""

    fabric: Fabric
    plan: Plan
    journal: IO[str]
    injected: Counter[str] = field(default_factory=Counter)
    heals: list[tuple[str, float]] = field(default_factory=list)
    """Fault and when it was healed."""
    commits_s: list[float] = field(default_factory=list)
    """When a commit was seen."""
    _active: list[_Active] = field(default_factory=list)

    def run(self) -> bool:
        """Inject everything, heal everything, wait for every case; False: there was no end."""
        dice = random.Random(self.plan.seed)
        due_s = 0.0
        moved_s = hurt_s = time.monotonic()
        while (left := self.plan.times - sum(self.injected.values())) or self._active:
            now_s = time.monotonic()
            if self.fabric.tend(feeding=True):
                self.commits_s.append(now_s)
                moved_s = now_s
            elif now_s - moved_s > PATIENCE_S or now_s - hurt_s > 2 * PATIENCE_S:
                self._heal(float("inf"))
                return False
            self._heal(now_s)
            if left and now_s >= due_s and self._may_inject() and self._inject(dice):
                hurt_s = now_s
                due_s = now_s + dice.uniform(*(self.plan.pause_s or (0.0, 0.0)))
            time.sleep(POLL_S)
        return self._settle()

    def recoveries_s(self) -> list[tuple[str, float]]:
        """Fault, and from its heal to the next commit [s]."""
        found = []
        for name, healed_s in self.heals:
            later = [commit_s for commit_s in self.commits_s if commit_s >= healed_s]
            if later:
                found.append((name, later[0] - healed_s))
        return found

    def _may_inject(self) -> bool:
        if not self.commits_s:
            return False  # nothing runs yet
        if self.plan.pause_s is not None:
            return True
        healed_s = self.heals[-1][1] if self.heals else 0.0
        return not self._active and self.commits_s[-1] >= healed_s

    def _inject(self, dice: random.Random) -> bool:
        if self.plan.pause_s is None:
            fault = self.plan.faults[sum(self.injected.values()) % len(self.plan.faults)]
        else:
            fault = dice.choice(self._possible())
        hold_s = dice.uniform(*fault.hold_s)
        healing = fault.body(self.fabric, dice)
        words = next(healing, None)
        if words is None:
            return False
        now_s = time.monotonic()
        self.injected[fault.name] += 1
        entry: dict[str, object] = {"fault": fault.name, "what": words, "at_s": round(now_s, 3)}
        self._write(entry)
        self._active.append(_Active(fault, healing, now_s + hold_s, entry))
        return True

    def _possible(self) -> Sequence[Fault]:
        taken = {active.fault.group for active in self._active} - {""}
        return [fault for fault in self.plan.faults if fault.group not in taken]

    def _heal(self, now_s: float) -> None:
        for active in [active for active in self._active if active.until_s <= now_s]:
            self._active.remove(active)
            next(active.healing, None)
            healed_s = time.monotonic()
            self.heals.append((active.fault.name, healed_s))
            self._write({**active.entry, "healed_s": round(healed_s, 3)})

    def _settle(self) -> bool:
        until_s = time.monotonic() + PATIENCE_S
        while not self.fabric.settle():
            if time.monotonic() > until_s:
                return False
            if self.fabric.tend(feeding=False):
                self.commits_s.append(time.monotonic())
                until_s = self.commits_s[-1] + PATIENCE_S
            time.sleep(POLL_S)
        return True

    def _write(self, entry: dict[str, object]) -> None:
        self.journal.write(json.dumps(entry) + "\n")
        self.journal.flush()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a run."""

    row: str
    seed: int
    injected: dict[str, int]
    recoveries_s: list[float]
    ended: bool
    """Every case came to its end in time."""
    cases: int
    lost: int
    doubled: int
    wrong: int
    wall_s: float

    def write(self, path: Path) -> None:
        """As JSON, in one piece."""
        fresh = path.with_suffix(".new")
        fresh.write_text(json.dumps(asdict(self), indent=1) + "\n")
        fresh.replace(path)
