"""What the journal of an ended conductor says about cases, compared with a quiet run."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import yaml
from fault_campaign import CAMPAIGN

from conductor.core.facts import Committed, LateAttempt, Snapshot, Submitted
from conductor.core.fold import agrees
from conductor.journal.store import Journal
from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import read_outcomes


@dataclass(frozen=True, slots=True)
class Quiet:
    """The campaign run once in peace."""

    fingerprint: str
    kpi_sha256: dict[str, str]
    """Of every case."""


@dataclass(frozen=True, slots=True)
class Count:
    """Of all campaigns of a state folder; everything but ``cases`` is to be 0."""

    cases: int
    lost: int
    """Cases without a commit."""
    doubled: int
    """Cases with more than one."""
    wrong: int
    """Attempts, committed or late, whose KPIs are not those of the quiet run; and campaigns whose
    fingerprint is another though each case agrees."""


def run_in_peace(folder: Path) -> Quiet:
    """Run the campaign, or read it if it was run."""
    if not (folder / "outcomes.json").exists() or not read_outcomes(folder).complete:
        folder.parent.mkdir(parents=True, exist_ok=True)
        path = folder.with_suffix(".yaml")
        path.write_text(yaml.safe_dump(CAMPAIGN))
        command = [sys.executable, "-m", "conductor", "run", str(path), "--out", str(folder)]
        asked = [*command, "--workers", "1", "--slots", "1"]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        if done.returncode > 1:
            raise SystemExit(f"the quiet run failed: {done.stderr}")
    cases = read_outcomes(folder).cases
    return Quiet(
        fingerprint(folder).sha256, {name: case.kpi_sha256 for name, case in cases.items()}
    )


def count(state: Path, campaigns: int, quiet: Quiet) -> Count:
    """Read the journal; its conductor must have ended.

    Args:
        state: state folder.
        campaigns: how many were submitted.
        quiet: what every case must have come to.
    """
    journal = Journal(state)
    try:
        facts = list(journal.fold())
    finally:
        journal.close()
    assert not any(isinstance(fact, Snapshot) for fact in facts), "facts were forgotten"
    submitted = [fact for fact in facts if isinstance(fact, Submitted)]
    assert len(submitted) == campaigns, "a campaign was lost, or came twice"
    commits = [fact for fact in facts if isinstance(fact, Committed)]
    times = Counter((fact.result.campaign, fact.result.case) for fact in commits)
    first = {(fact.result.campaign, fact.result.case): fact.result for fact in commits}
    late = [fact.result for fact in facts if isinstance(fact, LateAttempt)]
    wrong = sum(fact.result.kpi_sha256 != quiet.kpi_sha256[fact.result.case] for fact in commits)
    wrong += sum(
        not agrees(first[key], result)
        for result in late
        if (key := (result.campaign, result.case)) in first
    )
    cases = len(quiet.kpi_sha256) * campaigns
    lost = cases - len(times)
    if not wrong and not lost:
        prints = [fingerprint(Path(fact.out)).sha256 for fact in submitted]
        wrong = sum(found != quiet.fingerprint for found in prints)
    return Count(cases, lost, sum(n > 1 for n in times.values()), wrong)
