"""A storm: signals at random moments to random processes of a campaign, all drawn from one seed.

The seed decides which kind of process is hit by which signal after which pause; which cases are
running at that moment is up to the machine. Whatever dies is started again.
"""

from __future__ import annotations

import json
import random
import signal
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import yaml
from processes import PATIENCE_S, Marked, complete, wait_for

import conductor
from conductor.facts import Committed, LateAttempt, WorkerJoined
from conductor.fold import agrees
from conductor.journal import Journal
from twin.fabric.discovery import find_conductor
from twin.fabric.errors import UsageError

CAMPAIGN = "chaos-16"
TTL_S = 2.0
"""Leases expire soon, so that frozen workers are seen within a storm."""
WORKERS = 2
FAULTS = 8
"""Signals per storm; afterwards everything must come to its end."""
VICTIMS = {"worker": 3, "sim": 3, "host": 2, "serve": 2}
"""Word of the command line -> weight."""


@dataclass(slots=True)
class Storm:
    """One campaign under faults."""

    marked: Marked
    folder: Path
    seed: int
    deadline_s: float = 8.0
    faults: Counter[str] = field(default_factory=Counter)
    """What was done: ``SIGKILL sim`` and so on."""
    _frozen: list[tuple[float, psutil.Process]] = field(default_factory=list)

    @property
    def state(self) -> Path:
        """State folder."""
        return self.folder / "state"

    @property
    def campaign(self) -> Path:
        """Campaign folder."""
        return self.state / CAMPAIGN

    def run(self) -> None:
        """Serve, work, hurt, and wait until every case has ended; then end everything."""
        dice = random.Random(self.seed)
        self.start()
        self.submit()
        self.keep_alive()
        wait_for(lambda: self.marked.processes("sim"), "a simulator")
        due_s = time.monotonic() + dice.uniform(0.2, 1.5)
        left = FAULTS
        until_s = time.monotonic() + PATIENCE_S
        while not self.complete():
            assert time.monotonic() < until_s, f"seed {self.seed}: no end, {dict(self.faults)}"
            now_s = time.monotonic()
            self.thaw(now_s)
            self.keep_alive()
            if left and now_s >= due_s:
                left -= self.hurt(dice)
                due_s = now_s + dice.uniform(0.1, 1.0)
            time.sleep(0.02)
        self.finish()

    def start(self) -> None:
        """Start the conductor and wait until it listens."""
        child = self.marked.start(
            *("conductor", "serve", "--state", str(self.state), "--ttl-s", str(TTL_S))
        )

        def listens() -> bool:
            try:
                return find_conductor(self.state).pid == child.pid
            except UsageError:
                assert child.poll() is None, child.communicate()
                return False

        wait_for(listens, "the conductor")

    def submit(self) -> None:
        """Submit a copy of the campaign with a short deadline and as many attempts as it takes."""
        source = Path(conductor.__file__).parent / "campaigns" / f"{CAMPAIGN}.yaml"
        data = yaml.safe_load(source.read_text())
        data["matrix"]["time_of_day"] = ["05:00", "13:00"]
        path = self.folder / f"{CAMPAIGN}.yaml"
        dumped = yaml.safe_dump({**data, "deadline_s": self.deadline_s, "attempts_max": 100})
        path.write_text(dumped)
        done = self.marked.run("conductor", "submit", str(path), "--state", str(self.state))
        assert done.returncode == 0, done.stderr

    def worker(self) -> psutil.Process:
        """Start a worker of two slots."""
        child = self.marked.start("twin", "worker", "--state", str(self.state), "--slots", "2")
        return psutil.Process(child.pid)

    def keep_alive(self) -> None:
        """Start again what has died: the conductor first, workers need it to start."""
        if not self.marked.processes("serve"):
            self.start()
        for _ in range(WORKERS - len(self.marked.processes("worker"))):
            self.worker()

    def hurt(self, dice: random.Random) -> bool:
        """One fault; False if there was nobody to hurt."""
        kind = dice.choices(list(VICTIMS), list(VICTIMS.values()))[0]
        number = dice.choice((signal.SIGKILL, signal.SIGSTOP))
        which, pause_s = dice.random(), dice.uniform(0.2, 2 * TTL_S)
        victims = sorted(self.marked.processes(kind), key=lambda process: process.pid)
        frozen = {process.pid for _, process in self._frozen}
        victims = [process for process in victims if process.pid not in frozen]
        if not victims:
            return False
        victim = victims[int(which * len(victims))]
        try:
            victim.send_signal(number)
        except psutil.NoSuchProcess:
            return False
        self.faults[f"{number.name} {kind}"] += 1
        if number == signal.SIGSTOP:
            self._frozen.append((time.monotonic() + pause_s, victim))
        return True

    def thaw(self, now_s: float) -> None:
        """SIGCONT to those whose pause is over."""
        for entry in [entry for entry in self._frozen if entry[0] <= now_s]:
            self._frozen.remove(entry)
            try:
                entry[1].send_signal(signal.SIGCONT)
            except psutil.NoSuchProcess:
                pass

    def status(self) -> dict[str, Any]:
        """The conductor's status."""
        asked = ("conductor", "status", "--state", str(self.state), "--output", "json")
        done = self.marked.run(*asked)
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(done.stdout)
        return found

    def row(self) -> dict[str, Any]:
        """The campaign's row of the status."""
        found: dict[str, Any] = self.status()["campaigns"][CAMPAIGN]
        return found

    def complete(self) -> bool:
        """Every case has an outcome, as the conductor's file says."""
        return complete(self.campaign)

    def finish(self) -> None:
        """Thaw everything, then end workers and conductor in good order."""
        self.thaw(float("inf"))
        self.end("worker")
        self.end("serve")

    def end(self, word: str) -> None:
        """SIGTERM, and wait."""
        for process in self.marked.processes(word):
            try:
                process.terminate()
            except psutil.NoSuchProcess:
                pass
        wait_for(lambda: not self.marked.processes(word), f"the end of every {word}")


@dataclass(frozen=True, slots=True)
class Ledger:
    """What the journal of an ended conductor says."""

    commits: Counter[str]
    """Case -> commits."""
    late: list[LateAttempt]
    disagreeing: list[str]
    """Cases whose late attempts came to another result."""
    pids: dict[str, int]
    """Worker id -> process id."""


def read_ledger(state: Path) -> Ledger:
    """Read the journal; its conductor must have ended."""
    journal = Journal(state)
    try:
        facts = list(journal.fold())
    finally:
        journal.close()
    commits = [fact for fact in facts if isinstance(fact, Committed)]
    late = [fact for fact in facts if isinstance(fact, LateAttempt)]
    results = {fact.result.case: fact.result for fact in commits}
    return Ledger(
        Counter(fact.result.case for fact in commits),
        late,
        [f.result.case for f in late if not agrees(results[f.result.case], f.result)],
        {fact.worker: fact.pid for fact in facts if isinstance(fact, WorkerJoined)},
    )
