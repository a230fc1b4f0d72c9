"""A campaign served by hand, with workers that a test starts, freezes and wakes up."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import yaml
from processes import Marked, complete, wait_for

import conductor
from conductor.core.facts import Committed, LateAttempt, WorkerJoined
from conductor.core.fold import agrees
from conductor.journal.store import Journal
from twin.base.errors import UsageError
from twin.fabric.discovery import find_conductor

CAMPAIGN = "chaos-16"
TTL_S = 2.0
"""Leases expire soon, so that frozen workers are seen."""


@dataclass(slots=True)
class ServedCampaign:
    """``chaos-16`` and its conductor."""

    marked: Marked
    folder: Path

    @property
    def state(self) -> Path:
        """State folder."""
        return self.folder / "state"

    @property
    def campaign(self) -> Path:
        """Campaign folder."""
        return self.state / CAMPAIGN

    def start(self, *options: str) -> None:
        """Start the conductor and wait until it listens."""
        words = ("conductor", "serve", "--state", str(self.state), "--ttl-s", str(TTL_S))
        child = self.marked.start(*words, *options)

        def listens() -> bool:
            try:
                return find_conductor(self.state).pid == child.pid
            except UsageError:
                assert child.poll() is None, child.communicate()
                return False

        wait_for(listens, "the conductor")

    def submit(self) -> None:
        """Submit a copy of the campaign with as many attempts as it takes."""
        source = Path(conductor.__file__).parent / "campaigns" / f"{CAMPAIGN}.yaml"
        data = yaml.safe_load(source.read_text())
        data["matrix"]["time_of_day"] = ["05:00", "13:00"]
        path = self.folder / f"{CAMPAIGN}.yaml"
        dumped = yaml.safe_dump({**data, "attempts_max": 100})
        path.write_text(dumped)
        done = self.marked.run("conductor", "submit", str(path), "--state", str(self.state))
        assert done.returncode == 0, done.stderr

    def worker(self) -> psutil.Process:
        """Start a worker of two slots."""
        child = self.marked.start("twin", "worker", "--state", str(self.state), "--slots", "2")
        return psutil.Process(child.pid)

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
        """End workers and conductor in good order."""
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
