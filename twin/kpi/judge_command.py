"""``twin judge``: are the committed verdicts those of the KPI rows? Reads, and writes nothing."""

from __future__ import annotations

import ctypes
import json
import resource
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from schemas.files.json_text import JsonError, decode_json
from schemas.files.judging import CLAIMED, Claim, Judgement
from schemas.words import counted
from twin.base.errors import EXIT_INFRASTRUCTURE, EXIT_PASS, InfrastructureError, UsageError
from twin.base.progress import bars, steps
from twin.fabric.discovery import OUTCOMES_NAME
from twin.kpi.judge import examine
from twin.records.campaign_file import read_plan

_PR_SET_NO_NEW_PRIVS = 38
SHOWN_MAX = 50
"""Most attempts whose differences are told to people."""


class _End(msgspec.Struct, frozen=True):
    """What ``outcomes.json`` says of a case, as far as a judge needs it."""

    outcome: str
    verdict: str = ""
    reasons: list[str] = []
    scalars: dict[str, float | int | None] = {}
    names: dict[str, str] = {}
    attempt_dir: str = ""
    kpi_sha256: str = ""
    manifest_sha256: str = ""


class _Ends(msgspec.Struct, frozen=True):
    cases: dict[str, _End]


def judge_folder(folder: Path, attempts: Sequence[str], *, as_json: bool) -> int:
    """Judge the committed attempts of a campaign folder, or some of them; the exit code.

    Raises:
        UsageError: no campaign, or no such attempt.
        InfrastructureError: campaign or outcomes are damaged.
    """
    claims = claims_of(folder)
    if attempts:
        chosen = {name.strip("/") for name in attempts}
        if unknown := sorted(chosen - {claim.attempt_dir for claim in claims}):
            raise UsageError(
                f"{folder}: no committed attempt '{unknown[0]}'; give e.g. "
                + (claims[0].attempt_dir if claims else "none: nothing was committed")
            )
        claims = [claim for claim in claims if claim.attempt_dir in chosen]
    with bars():
        judgements = [examine(claim) for claim in steps("attempts", claims)]
    counts = Counter(judgement.found for judgement in judgements)
    if as_json:
        print(json.dumps([msgspec.to_builtins(judgement) for judgement in judgements]))
    else:
        for line in [line for judgement in judgements for line in told(judgement)][:SHOWN_MAX]:
            print(line)
        print(
            f"{counted(len(judgements), 'attempt')}: {counts['agrees']} agree, {counts['differs']} "
            f"differ, {counts['no record']} without a record"
        )
    return EXIT_INFRASTRUCTURE if counts["differs"] else EXIT_PASS


def follow() -> int:
    """Judge what stands on standard input, a claim per line; a judgement per line is the answer."""
    resign_rights()
    for line in sys.stdin.buffer:
        claim = msgspec.json.decode(line, type=Claim)
        sys.stdout.buffer.write(msgspec.json.encode(examine(claim)) + b"\n")
        sys.stdout.buffer.flush()
    return EXIT_PASS


def told(judgement: Judgement) -> Iterable[str]:
    """Differences of a judgement for people, a line each."""
    return [f"case {judgement.case}: {line}" for line in judgement.differences]


def claims_of(folder: Path) -> list[Claim]:
    """Claims of a campaign folder: the committed attempts that have KPI rows."""
    try:
        ends = decode_json((folder / OUTCOMES_NAME).read_bytes(), _Ends)
    except OSError as error:
        raise UsageError(
            f"{folder / OUTCOMES_NAME}: {error.strerror}; give the folder of a campaign that a "
            "conductor has run"
        ) from None
    except JsonError as error:
        raise InfrastructureError(f"{folder / OUTCOMES_NAME}: damaged: {error}") from None
    cases = read_plan(folder / "campaign.yaml").cases
    scenarios = {case.id: case.variation.scenario for case in cases}
    return [
        Claim(
            folder=str(folder),
            case=name,
            scenario=scenarios.get(name),
            **{key: getattr(end, key) for key in CLAIMED},
        )
        for name, end in ends.cases.items()
        if end.kpi_sha256
    ]


def resign_rights() -> None:
    """Keep this process from writing files and gaining rights: what it reads was written by
    programs under test. Its standard output must be a pipe."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    ctypes.CDLL(None).prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
