"""``outcomes.json``: the outcome of every case of a campaign, for reports and fingerprints.

The journal is locked by its conductor; this file is written every few seconds while a campaign
runs, when it is complete and when the conductor shuts down, and can be read by anyone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec import UNSET, UnsetType

from conductor.core.facts import Committed
from conductor.core.fold import agrees
from conductor.core.state import CampaignState, CaseState
from schemas import SCHEMA_VERSION
from schemas.case import Clock
from schemas.device_class import is_portable, result_class
from schemas.files.json_text import JsonError, decode_json
from schemas.files.recording import RecordingObject
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.messages import PerceptionCost
from schemas.sections.autonomy import Told
from schemas.verdict import Judged, no_collision
from schemas.wire.realtime import Realtime
from twin.base.errors import (
    EXIT_FAILED,
    EXIT_INFRASTRUCTURE,
    EXIT_PASS,
    EXIT_UNFINISHED,
    InfrastructureError,
    UsageError,
)
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.fabric.discovery import OUTCOMES_NAME

FILE_NAME = OUTCOMES_NAME


class Late(msgspec.Struct, frozen=True):
    """A result that came with a dead token: evidence about determinism."""

    token: int
    worker: str
    outcome: str
    verdict: str
    kpi_sha256: str
    attempt_dir: str
    agrees: bool | None
    """Whether it agrees with the committed result; None: nothing was committed, or it ran by the
    wall clock."""


class CaseOutcome(Judged, msgspec.Struct, frozen=True, kw_only=True):
    """Ending of one case."""

    outcome: str
    """``verdict``, ``failed``, ``unresolved``, ``cancelled``; empty: not ended yet."""
    verdict: str = ""
    reasons: list[str] = []
    scalars: dict[str, float | int | None] = {}
    names: dict[str, str] = {}
    """Scalars that are names, such as what was hit: :data:`schemas.files.kpi.NAMES`."""
    attempt_dir: str = ""
    """Folder of the committed attempt, relative to the campaign folder."""
    attempt: int = 0
    """Number of the committed attempt."""
    attempts: int = 0
    charges: list[str] = []
    """Why attempts were charged to the case, and on which worker."""
    kpi_sha256: str = ""
    manifest_sha256: str = ""
    device_class: str = ""
    """Class of devices that the result depends on: ``portable``, or that of its machine."""
    worker: str = ""
    wall_s: float = 0.0
    perception: PerceptionCost | None = None
    """Wall time that perception took; None: the stack did not measure it."""
    rig_wall_s: float = 0.0
    """Wall time of the rig, each tick divided evenly among its cases [s]."""
    late: list[Late] = []
    realtime: Realtime | None = None
    """How it went by the wall clock; None: in lockstep."""
    steered: list[str] = []
    """Attempts without a verdict, because of interventions."""
    recording: RecordingObject | UnsetType = UNSET
    """Recording of the committed attempt in the run's result store; unset: there is none."""


class Outcomes(msgspec.Struct, frozen=True, kw_only=True):
    """Content of ``outcomes.json``; cases in submission order."""

    schema: int = SCHEMA_VERSION
    campaign: str
    digest: str
    digests: int = 0
    """Version of ``digest``, see :data:`schemas.identity.DIGESTS`."""
    seed: int
    simulator: str
    software: str
    """Software digest of the campaign's workers; empty: no case has been leased."""
    device: str
    """``same`` or ``any``, as the campaign asked."""
    device_classes: list[str]
    """Device classes that the committed results depend on, sorted."""
    machines: list[str] = []
    """Device classes of the machines that computed them, sorted; empty: the same, as in files of
    earlier versions."""
    complete: bool
    """Whether every case has an outcome."""
    protection: list[str] = []
    """What kept the stack from the machine in the committed attempts, sorted: ``default``,
    ``strict`` and what they shared, or ``unprotected`` and why."""
    clock: Clock = "lockstep"
    """``realtime``: its results do not repeat."""
    tell: list[Told] = []
    """What stacks were told beyond what they need, ``autonomy.tell``."""
    cases: dict[str, CaseOutcome]

    @property
    def ran_on(self) -> list[str]:
        """Device classes of the machines that computed the results, sorted."""
        return self.machines or self.device_classes

    @property
    def exit_code(self) -> int:
        """What a command that concludes this campaign exits with."""
        rows = self.cases.values()
        return exit_code(
            cases=len(rows),
            passed=sum(row.passed for row in rows),
            unresolved=sum(row.outcome == "unresolved" for row in rows),
            left=sum(not row.outcome for row in rows),
        )


def exit_code(*, cases: int, passed: int, unresolved: int, left: int) -> int:
    """The exit code of commands that conclude campaigns, by numbers of cases: 75 if some have not
    ended, 3 if some could not be decided, 1 if some did not pass, else 0."""
    if left:
        return EXIT_UNFINISHED
    if unresolved:
        return EXIT_INFRASTRUCTURE
    return EXIT_PASS if passed == cases else EXIT_FAILED


def count_outcomes(outcomes: Outcomes) -> dict[str, int]:
    """Cases, committed, passed, without a collision, failed, unresolved and cancelled."""
    rows = outcomes.cases.values()
    return {
        "cases": len(outcomes.cases),
        "committed": sum(row.outcome in ("verdict", "failed") for row in rows),
        "passed": sum(row.passed for row in rows),
        "no_collision": sum(
            no_collision(row.outcome, row.verdict, row.scalars) is True for row in rows
        ),
        "failed": sum(row.outcome in ("verdict", "failed") and not row.passed for row in rows),
        "unresolved": sum(row.outcome == "unresolved" for row in rows),
        "cancelled": sum(row.outcome == "cancelled" for row in rows),
    }


def count_verdicts(outcomes: Outcomes) -> dict[str, int]:
    """Cases by verdict, or by outcome where there is none."""
    counts: dict[str, int] = {}
    for row in outcomes.cases.values():
        name = row.verdict or row.outcome
        counts[name] = counts.get(name, 0) + 1
    return counts


def encode_campaign(campaign: CampaignState) -> bytearray:
    """The outcomes as they stand as JSON, a line per case; never all cases in memory at once."""
    ends = (case.end for case in campaign.ordered)
    committed = [end for end in ends if isinstance(end, Committed)]
    head = _with_committed(campaign, committed)
    text = bytearray(msgspec.json.format(msgspec.json.encode(head), indent=1))
    start = text.rindex(b"{") + 1  # of the cases, which come last
    after = bytes(text[start:])
    del text[start:]
    portable = is_portable(campaign.campaign)
    for number, (name, case) in enumerate(campaign.cases.items()):
        text += b",\n  " if number else b"\n  "
        text += msgspec.json.encode(name) + b": " + msgspec.json.encode(_case(case, portable))
    text += b"\n " + after.lstrip() + b"\n"
    return text


def outcomes_of(campaign: CampaignState) -> Outcomes:
    """The outcomes as they stand."""
    portable = is_portable(campaign.campaign)
    cases = {name: _case(case, portable) for name, case in campaign.cases.items()}
    ends = (case.end for case in campaign.ordered)
    committed = [end for end in ends if isinstance(end, Committed)]
    return msgspec.structs.replace(_with_committed(campaign, committed), cases=cases)


def _with_committed(campaign: CampaignState, committed: Sequence[Committed]) -> Outcomes:
    """The outcomes without their cases."""
    portable = is_portable(campaign.campaign)
    machines = sorted({end.device_class for end in committed} - {""})
    classes = sorted({result_class(portable, machine) for machine in machines})
    return msgspec.structs.replace(
        _head(campaign),
        device_classes=classes,
        machines=machines if machines != classes else [],
        protection=sorted({end.result.protection for end in committed} - {""}),
        complete=not campaign.left,
    )


def _head(campaign: CampaignState) -> Outcomes:
    return Outcomes(
        campaign=campaign.campaign.campaign,
        digest=campaign.digest,
        digests=campaign.digests,
        seed=campaign.campaign.seed,
        simulator=campaign.campaign.simulator,
        clock=campaign.campaign.clock,
        tell=sorted(campaign.campaign.autonomy.tell),
        software=campaign.software,
        device=campaign.campaign.device,
        device_classes=[],
        complete=False,
        cases={},
    )


def encode_outcomes(outcomes: Outcomes) -> bytes:
    """Outcomes as JSON for people and programs."""
    return msgspec.json.format(msgspec.json.encode(outcomes), indent=1) + b"\n"


def read_outcomes(folder: Path) -> Outcomes:
    """Read ``outcomes.json`` of the campaign ``folder``.

    Raises:
        UsageError: there is none (yet).
        InfrastructureError: it is damaged.
    """
    path = folder / FILE_NAME
    try:
        return decode_json(read_regular(path, RUN_FILE_BYTES_MAX), Outcomes)
    except FileNotFoundError:
        if (folder / CONDUCTOR_FILE).exists():
            raise UsageError(
                f"{folder}: its conductor has not written {FILE_NAME} yet; try again in a moment"
            ) from None
        raise UsageError(
            f"{folder}: no {FILE_NAME}; give the folder of a campaign that a conductor has run"
        ) from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}") from None


def _case(case: CaseState, portable: bool) -> CaseOutcome:
    end = case.end
    common = CaseOutcome(
        outcome="",
        attempts=case.attempts,
        charges=[str(charge) for charge in case.charges],
        steered=[str(touch) for touch in case.steered],
    )
    if end is None:
        return common
    result = end.result if isinstance(end, Committed) else None
    late = [
        Late(
            token=fact.result.token,
            worker=fact.worker,
            outcome=fact.result.outcome,
            verdict=fact.result.verdict,
            kpi_sha256=fact.result.kpi_sha256,
            attempt_dir=fact.result.attempt_dir,
            agrees=agrees(result, fact.result) if result else None,
        )
        for fact in case.late
    ]
    replace = msgspec.structs.replace
    if not isinstance(end, Committed):
        return replace(common, outcome=end.outcome, reasons=[end.reason], late=late)
    return replace(
        common,
        outcome=end.result.outcome,
        verdict=end.result.verdict,
        reasons=end.result.reasons,
        scalars=end.result.scalars,
        names=end.result.names,
        attempt_dir=end.result.attempt_dir,
        attempt=end.attempt,
        kpi_sha256=end.result.kpi_sha256,
        manifest_sha256=end.result.manifest_sha256,
        device_class=result_class(portable, end.device_class),
        worker=end.worker,
        wall_s=end.result.wall_s,
        perception=end.result.perception,
        rig_wall_s=end.result.rig_wall_s,
        realtime=end.result.realtime,
        late=late,
        recording=UNSET if case.recording is None else case.recording,
    )
