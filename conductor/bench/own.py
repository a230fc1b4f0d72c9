"""Our side of the comparison: durable lease and commit of cases that simulate nothing.

One conductor process (SQLite, ``synchronous=FULL``, on a real disk) and two client processes that
speak the worker's protocol over Zenoh on loopback. Counted is the time from the start of both
clients until every case is committed on disk; the submission is timed by itself. With files, cases
come with those of an attempt, as from a simulator, and the conductor's judge reads them.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from conductor.bench.children import child, serving
from conductor.commands.client import ConductorClient
from conductor.trust.judge_feed import read_judged
from schemas.campaign import Campaign
from twin.base.errors import InfrastructureError, UsageError, storage_error

CLIENTS = 2
"""Worker processes, as many as the peers get."""

K_MANY = 8
"""Cases per request of the comparison in batches."""


@dataclass(frozen=True, slots=True)
class SchedulerRun:
    """One run of one scheduler."""

    cases: int
    wall_s: float
    submit_s: float = 0.0
    judged_s: float = 0.0
    """Time from the start until all is judged and the conductor has ended; 0: no files."""

    @property
    def rate(self) -> float:
        """Cases per second."""
        return self.cases / self.wall_s


def noop_campaign(cases: int, name: str = "bench") -> Campaign:
    """``cases`` cases that simulate nothing."""
    data = {
        "campaign": name,
        "simulator": "noop",
        "matrix": {"repeat": list(range(cases))},
    }
    return msgspec.convert(data, Campaign)


def measure(cases: int, k: int, folder: Path, *, files: bool = False) -> SchedulerRun:
    """Commit ``cases`` cases with ``k`` per request, in a new state folder below ``folder``.

    ``files``: each has an attempt's files.
    """
    state = Path(tempfile.mkdtemp(prefix="bench-", dir=folder))
    try:
        template = _template(state) if files else None
        with ExitStack() as stack:
            endpoint, _ = stack.enter_context(serving(state, judged=files))
            client = stack.enter_context(ConductorClient(endpoint, None, "bench"))
            before_s = time.perf_counter()
            campaign = noop_campaign(cases)
            if files:  # a judge looks at what was simulated
                campaign = msgspec.structs.replace(campaign, simulator="warp")
            client.submit(campaign, "")
            submit_s = time.perf_counter() - before_s
            started_s = time.perf_counter()
            wall_s = work(endpoint, cases, k, "files" if files else "noop", template)
            left = client.status()["left"]
        if left:
            raise InfrastructureError(f"{left} of {cases} cases are left")
        if not files:
            return SchedulerRun(cases, wall_s, submit_s)
        judged_s = time.perf_counter() - started_s
        _check_judged(state / "bench", cases)
        return SchedulerRun(cases, wall_s, submit_s, judged_s)
    finally:
        shutil.rmtree(state)


def _template(folder: Path) -> Path:
    """A file with a made-up attempt."""
    path = folder / "attempt.json"
    with child("twin.bench.attempt") as made:
        path.write_text(made.line())
    return path


def _check_judged(run: Path, cases: int) -> None:
    judged = read_judged(run)
    if judged is None or judged.agree != cases:
        agreement = "nothing was judged" if judged is None else f"{judged.agree} agree"
        raise InfrastructureError(f"of {cases} attempts {agreement}: {run}")


def work(
    endpoint: str,
    cases: int,
    k: int,
    kind: Literal["noop", "full", "files", "stored"] = "noop",
    template: Path | str | None = None,
    names: str = "w",
) -> float:
    """Two clients commit the ``cases`` cases of the conductor at ``endpoint``; how long it took.

    Args:
        endpoint: where the conductor listens.
        cases: all of its cases.
        k: cases per request.
        kind: ``full``: results are as large as a simulator's; ``files``: and come with its files;
            ``stored``: and are put into a result store first.
        template: a made-up attempt, for files; URL of the store.
        names: beginning of the clients' ids.
    """
    options = (kind, str(template)) if template else (kind,)
    with ExitStack() as stack:
        clients = [
            stack.enter_context(
                child("conductor.bench.client", endpoint, f"{names}{i}", str(k), *options)
            )
            for i in range(CLIENTS)
        ]
        for client in clients:
            client.line()
        started_s = time.perf_counter()
        for client in clients:
            client.tell("go")
        answers = [json.loads(process.line()) for process in clients]
        wall_s = time.perf_counter() - started_s
    done = sum(answer["cases"] for answer in answers)
    if done != cases:
        raise InfrastructureError(f"{done} of {cases} cases were committed by the clients")
    return wall_s


def check_disk(folder: Path) -> None:
    """Make a folder for journals; one in memory is refused: nothing is durable there.

    Raises:
        UsageError: ``folder`` lies on a tmpfs or ramfs.
        TwinError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    where = folder.resolve()
    best, kind = "", ""
    for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines():
        _, mount, filesystem, *_ = line.split()
        if where.is_relative_to(mount) and len(mount) >= len(best):
            best, kind = mount, filesystem
    if kind in ("tmpfs", "ramfs"):
        raise UsageError(
            f"{folder}: {kind}, nothing is durable there; choose a folder on a disk with --folder"
        )
