"""``conductor verify``: whether a finished run is what it was when it was signed. Needs no network.

Every check adds lines about what differs; nothing is mended.
"""

from __future__ import annotations

import contextlib
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from conductor.core.fold import fold
from conductor.core.state import Config
from conductor.journal.store import read_journal
from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import Outcomes, outcomes_of, read_outcomes
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.trust.judge_feed import Judge, read_judged
from conductor.trust.manifest import (
    DERIVED_FILE,
    RUN_FILE,
    Manifest,
    entries,
    file_sums,
    is_derived,
    odd_entry,
    read_manifest,
)
from conductor.trust.signing import TRUSTED_FOLDER
from schemas.escape import escape
from schemas.files.judging import CLAIMED, Claim, Judgement
from twin.base.errors import TwinError, storage_error
from twin.base.own_folder import own_folder
from twin.base.progress import Told
from twin.records.campaign_file import read_plan


@dataclass(slots=True)
class Verified:
    """Findings about a run."""

    differences: list[str] = field(default_factory=list)
    """Differences from what was signed, one line each."""
    notes: list[str] = field(default_factory=list)
    """What could not be checked, or need not fit."""
    manifest: Manifest | None = None
    files: int = 0
    """Number of files whose sums were computed."""
    wall_s: float = 0.0
    attempts: int = 0
    """Number of attempts whose KPI digests and verdicts were computed again."""
    deep_s: float = 0.0

    @property
    def rate(self) -> float:
        """Attempts per second."""
        return self.attempts / self.deep_s if self.deep_s else 0.0


def verify_run(
    folder: Path,
    trusted: frozenset[str],
    *,
    deep: bool = False,
    told: Told = lambda _what, _done, _total: None,
) -> Verified:
    """Check a run folder.

    Args:
        folder: run folder.
        trusted: public keys, hexadecimal, that may have signed it.
        deep: also compute KPI digests, fingerprint and verdicts again.
        told: hears of progress.
    """
    started_s = time.perf_counter()
    verified = Verified()
    try:
        _check(folder, trusted, verified, deep=deep, progress=told)
    except TwinError as error:
        verified.differences.append(str(error))
    verified.wall_s = time.perf_counter() - started_s
    return verified


def _check(
    folder: Path, trusted: frozenset[str], verified: Verified, *, deep: bool, progress: Told
) -> None:
    manifest = verified.manifest = read_manifest(folder)
    if manifest is None:
        verified.differences.append(
            f"{folder} is not signed: there is no {RUN_FILE}; it has not ended, a conductor serves "
            "it, or an earlier version has run it"
        )
        return
    if manifest.key not in trusted:
        verified.differences.append(
            f"signed by key {manifest.key}, which is not trusted here; if you know whose it is, "
            f"give it as --public-key, or write it into {own_folder() / TRUSTED_FOLDER}/NAME.pub"
        )
        return  # whatever it lists, he may have written it who changed the files
    derived = _derived(folder, manifest, trusted, verified)
    _check_files(folder, manifest, derived, verified, progress)
    outcomes = read_outcomes(folder)
    _check_outcomes(folder, manifest, outcomes, verified)
    _check_journal(folder, manifest, outcomes, verified)
    if deep:
        _check_deep(folder, manifest, outcomes, verified, progress)


def _derived(
    folder: Path, manifest: Manifest, trusted: frozenset[str], verified: Verified
) -> dict[str, str]:
    """What reports have made and signed."""
    derived = read_manifest(folder, "derived")
    if derived is None:
        return {}
    if derived.key not in trusted:
        verified.differences.append(
            f"{DERIVED_FILE}: signed by key {derived.key}, not trusted here"
        )
        return {}
    if derived.of != manifest.signature:
        verified.differences.append(f"{DERIVED_FILE} belongs to another run; make the report again")
        return {}
    return derived.files


def _check_files(
    folder: Path, manifest: Manifest, derived: dict[str, str], verified: Verified, progress: Told
) -> None:
    try:
        there = dict(entries(folder))
    except OSError as error:
        raise storage_error(error, str(folder)) from None
    signed = {**derived, **manifest.files}
    odd = sorted(name for name, entry in there.items() if odd_entry(entry))
    for name in odd:
        kind = "a symbolic link" if there[name].is_symlink() else "no plain file"
        verified.differences.append(f"{_shown(name)}: {kind}")
    for name in sorted(there.keys() - signed.keys() - set(odd)):
        verified.differences.append(f"{_shown(name)}: is not in the manifest")
    for name in sorted(signed.keys() - there.keys()):
        if is_derived(name):  # may be removed, and made again
            verified.notes.append(
                f"{_shown(name)}: is not there any more; `conductor report` makes it"
            )
        else:
            verified.differences.append(f"{_shown(name)}: is missing")
    names = sorted((there.keys() & signed.keys()) - set(odd))
    done = 0

    def more(count: int) -> None:
        nonlocal done
        done += count
        progress("files", done, len(names))

    progress("files", 0, len(names))
    sums = file_sums(folder, names, more)
    verified.files = len(sums)
    for name in names:
        if sums[name] != signed[name]:
            verified.differences.append(_difference(name, sums[name], signed[name]))


def _difference(name: str, now: str, signed: str) -> str:
    sha, _, size = signed.partition(" ")
    sha_now, _, size_now = now.partition(" ")
    if len(sha_now) != len(sha) or not size_now.isdigit():
        return f"{_shown(name)}: cannot be read: {escape(now, 80)}"
    if size != size_now:
        return f"{_shown(name)}: {size_now} bytes, signed {size}"
    return f"{_shown(name)}: SHA-256 {sha_now[:12]}, signed {sha[:12]}"


def _check_outcomes(
    folder: Path, manifest: Manifest, outcomes: Outcomes, verified: Verified
) -> None:
    claimed = (outcomes.campaign, outcomes.digest, outcomes.complete)
    if claimed != (manifest.campaign, manifest.digest, True):
        verified.differences.append("outcomes.json and the manifest name different campaigns")
    judged = read_judged(folder)
    for name, lines in (judged.differences if judged else {}).items():
        verified.differences += [f"case {_shown(name)}: {escape(line, 300)}" for line in lines]


def _check_journal(
    folder: Path, manifest: Manifest, outcomes: Outcomes, verified: Verified
) -> None:
    """The journal is whole, and tells what the outcomes tell."""
    signed = manifest.journal
    if signed is None:
        verified.notes.append("no journal was signed with it")
        return
    path = folder / signed.file
    is_own = signed.file not in ("../conductor.db",)
    if not is_own and not path.exists():
        verified.notes.append("its journal is not here: it lies beside the run where it was made")
        return
    if not is_own and path.with_name(f"{path.name}-wal").exists():
        verified.notes.append("its journal is in use, and was not checked")
        return
    chain, facts = read_journal(path)
    state = fold(facts, Config())
    here = (chain.head.hex(), chain.count)
    if here != (signed.head, signed.count) and (is_own or chain.count <= signed.count):
        verified.differences.append(
            f"{signed.file}: its chain ends with link {here[1]}, {here[0][:12]}; signed: link "
            f"{signed.count}, {signed.head[:12]}"
        )
    campaign = state.campaigns.get(manifest.campaign)
    if campaign is None:
        verified.differences.append(f"{signed.file}: knows no campaign '{manifest.campaign}'")
        return
    journalled = outcomes_of(campaign)
    if journalled == outcomes:
        return
    names = [
        n
        for n in (journalled.cases | outcomes.cases)
        if journalled.cases.get(n) != outcomes.cases.get(n)
    ]
    for name in names:
        verified.differences.append(
            f"case {_shown(name)}: outcomes.json is not what the journal says"
        )
    if not names:
        verified.differences.append("outcomes.json is not what the journal says")


def _check_deep(
    folder: Path, manifest: Manifest, outcomes: Outcomes, verified: Verified, progress: Told
) -> None:
    """KPI digests, fingerprint and verdicts, from the rows."""
    started_s = time.perf_counter()
    cases = read_plan(folder / CAMPAIGN_FILE).cases
    scenarios = {case.id: case.variation.scenario for case in cases}
    claims = [
        Claim(
            folder=str(folder.absolute()),
            case=name,
            scenario=scenarios.get(name),
            **{field: getattr(case, field) for field in CLAIMED},
        )
        for name, case in outcomes.cases.items()
        if case.kpi_sha256
    ]
    judges = max(1, len(os.sched_getaffinity(0)))
    parts = [claims[at::judges] for at in range(judges)]
    done = 0

    def judged(part: list[Claim]) -> list[Judgement]:
        nonlocal done
        with contextlib.closing(Judge()) as judge:
            answers = []
            for claim in part:
                answers.append(judge.ask(claim))
                done += 1  # of several threads: for people, it need not be exact
                progress("attempts", done, len(claims))
        return answers

    progress("attempts", 0, len(claims))
    with ThreadPoolExecutor(judges) as pool:
        running = [pool.submit(judged, part) for part in parts if part]
        try:
            values = fingerprint(folder).sha256
        except TwinError as error:
            verified.differences.append(str(error))
        else:
            if values != manifest.fingerprint:
                verified.differences.append(
                    f"the fingerprint is {values[:12]}, signed {manifest.fingerprint[:12]}"
                )
        for future in running:
            for answer in future.result():
                verified.differences += [f"case {answer.case}: {x}" for x in answer.differences]
    verified.attempts, verified.deep_s = len(claims), time.perf_counter() - started_s


def _shown(name: str) -> str:
    return escape(name, 200)
