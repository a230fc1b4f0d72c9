"""A large campaign: how long submission, restart and status take, and how much memory they need."""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import psutil

from conductor.bench.children import serving
from conductor.bench.own import K_MANY, work
from conductor.commands.client import ConductorClient
from schemas.campaign import WEATHERS, Campaign
from twin.base.errors import UsageError

TARGETS = {"submit_s": 5.0, "restart_s": 5.0, "rss_mb": 300.0, "status_ms": 100.0}
"""Most that a campaign of 100,000 cases may take."""

POINTS = 32
"""Cases per repetition: eight weathers at four times of day."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What a campaign of ``cases`` cases took."""

    cases: int
    submit_s: float
    """Time from the request to the reply: accepted and on disk [s]."""
    wall_s: float
    """Time in which two clients commit all of it, eight cases per request, with full results
    [s]."""
    restart_s: float
    """Time from the start of a new process on the full journal until it answers [s]."""
    rss_mb: float
    """Most resident memory of a conductor: submitted, run to the end, restarted [MB]."""
    rss_each_mb: tuple[float, float, float]
    """Memory after the submission, after the last commit and after the restart [MB]."""
    status_ms: float
    """Median round trip of a status request, all cases ended [ms]."""

    def misses(self) -> list[str]:
        """Targets that were missed, one line each."""
        return [
            f"{name} is {getattr(self, name):.1f} with {self.cases} cases, the target is {most:g}"
            for name, most in TARGETS.items()
            if getattr(self, name) > most
        ]

    def to_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return asdict(self)


def large_campaign(cases: int) -> Campaign:
    """``cases`` cases that simulate nothing; a multiple of ``POINTS``."""
    if cases % POINTS:
        raise UsageError(f"--cases {cases}: give a multiple of {POINTS}")
    matrix = {
        "time_of_day": ["05:00", "09:00", "13:00", "19:00"],
        "weather": list(WEATHERS),
        "repeat": list(range(cases // POINTS)),
    }
    data = {"campaign": "bench-large", "simulator": "noop", "matrix": matrix}
    return msgspec.convert(data, Campaign)


def measure_scale(cases: int, folder: Path) -> Scale:
    """Submit, run to the end, restart, ask; in a new state folder below ``folder``."""
    campaign = large_campaign(cases)
    state = Path(tempfile.mkdtemp(prefix="bench-", dir=folder))
    try:
        with serving(state) as (endpoint, pid), ConductorClient(endpoint, None, "bench") as client:
            started_s = time.perf_counter()
            client.submit(campaign, "")
            submit_s = time.perf_counter() - started_s
            submitted_mb = _rss_mb(pid)
            wall_s = work(endpoint, cases, K_MANY, "full")
            ended_mb = _rss_mb(pid)
        started_s = time.perf_counter()
        with serving(state) as (endpoint, pid), ConductorClient(endpoint, None, "bench") as client:
            left = client.status()["left"]
            restart_s = time.perf_counter() - started_s
            if left:
                raise AssertionError(f"{left} cases are left after the restart")
            status_ms = median(_status_ms(client) for _ in range(20))
            each_mb = (submitted_mb, ended_mb, _rss_mb(pid))
        return Scale(cases, submit_s, wall_s, restart_s, max(each_mb), each_mb, status_ms)
    finally:
        shutil.rmtree(state)


def _status_ms(client: ConductorClient) -> float:
    started_s = time.perf_counter()
    client.status()
    return (time.perf_counter() - started_s) * 1e3


def _rss_mb(pid: int) -> float:
    return float(psutil.Process(pid).memory_info().rss) / 1e6
