"""The comparison: every scheduler in turn, several times over, in one run.

The machine's load changes from minute to minute; what is interleaved suffers alike. Rates are
medians, and a ratio is the median of the ratios of each round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from conductor.bench.own import K_MANY, SchedulerRun, measure
from conductor.bench.peers import PACKAGES, measure_peer, missing
from twin.base.progress import counter

TARGETS = {"ratio_dask_k8": 15.0, "ratio_hyperqueue_k8": 5.0, "ratio_dask_k1": 3.0}
"""Least ratio of our rate to a peer's."""

FILES_SHARE = 10
"""One in so many cases has files: each is brought to the disk, and judged."""

AIMS = {"k8": 10_000.0, "k1": 2_000.0}
"""Rates to aim for on two idle cores [cases/s]; reported, not checked: machines differ."""


@dataclass(slots=True)
class SchedulerComparison:
    """Runs of each scheduler, one per round: ``k8``, ``k1``, ``files`` (eight per request, with the
    files of an attempt), and the peers."""

    runs: dict[str, list[SchedulerRun]] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    """One line per peer that cannot run."""

    def rate(self, name: str) -> float | None:
        """Median rate of a scheduler; None if it did not run [cases/s]."""
        runs = self.runs.get(name)
        return median(run.rate for run in runs) if runs else None

    def ratio(self, ours: str, peer: str) -> float | None:
        """Median over the rounds of our rate to the peer's."""
        if not (self.runs.get(ours) and self.runs.get(peer)):
            return None
        pairs = zip(self.runs[ours], self.runs[peer], strict=True)
        return median(run.rate / other.rate for run, other in pairs)

    def ratios(self) -> dict[str, float | None]:
        """The ratios that have targets."""
        return {
            "ratio_dask_k8": self.ratio("k8", "dask"),
            "ratio_hyperqueue_k8": self.ratio("k8", "hyperqueue"),
            "ratio_dask_k1": self.ratio("k1", "dask"),
        }

    def judged_rate(self) -> float | None:
        """Median rate with files until all is judged; None if it did not run [cases/s]."""
        runs = self.runs.get("files")
        return median(run.cases / run.judged_s for run in runs) if runs else None

    def misses(self) -> list[str]:
        """Targets that were missed, one line each; a missing peer misses its targets."""
        lines = list(self.missing)
        for name, ratio in self.ratios().items():
            if ratio is not None and ratio < TARGETS[name]:
                lines.append(f"{name} is {ratio:.1f}, the target is {TARGETS[name]:g}")
        return lines

    def to_json(self) -> dict[str, Any]:
        """Ratios, medians and every single rate."""
        return {
            **{name: _rounded(ratio) for name, ratio in self.ratios().items()},
            **{f"{name}_cases_per_s": _rounded(self.rate(name)) for name in SCHEDULERS},
            "ratio_files_k8": _rounded(self.ratio("files", "k8")),
            "files_judged_per_s": _rounded(self.judged_rate()),
            "rates": {
                name: [_rounded(run.rate) for run in runs] for name, runs in self.runs.items()
            },
            "cases": {name: runs[0].cases for name, runs in self.runs.items() if runs},
            "submit_s": {name: [_rounded(run.submit_s) for run in self.runs[name]] for name in OWN},
            "missing": self.missing,
        }


OWN = ("k8", "k1", "files")
SCHEDULERS = (*OWN, *PACKAGES)
"""Names of the rows."""


def compare(
    cases: int, rounds: int, folder: Path, say: Callable[[str], None]
) -> SchedulerComparison:
    """Run all schedulers ``rounds`` times with ``cases`` cases or tasks each.

    Args:
        cases: cases per run, the same for everyone.
        rounds: how often.
        folder: on a real disk.
        say: told about every run, one line each.
    """
    comparison = SchedulerComparison({name: [] for name in SCHEDULERS})
    few = max(1, cases // FILES_SHARE)
    peers = []
    for peer in PACKAGES:
        reason = missing(peer)
        if reason:
            comparison.missing.append(reason)
        else:
            peers.append(peer)
    ran = counter("runs", rounds * (len(OWN) + len(peers)))
    for number in range(1, rounds + 1):
        steps: list[tuple[str, Callable[[], SchedulerRun]]] = [
            ("k8", lambda: measure(cases, K_MANY, folder)),
            ("k1", lambda: measure(cases, 1, folder)),
            ("files", lambda: measure(few, K_MANY, folder, files=True)),
            *((peer, lambda p=peer: measure_peer(p, cases, folder)) for peer in peers),
        ]
        for name, step in steps:
            run = step()
            comparison.runs[name].append(run)
            ran(1)
            say(f"round {number} of {rounds}: {name} {run.rate:.0f}/s")
    return comparison


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
