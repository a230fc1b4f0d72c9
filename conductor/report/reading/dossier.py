"""What a report is about, read from a campaign folder: the campaign, its cases, their ends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, Outcomes, read_outcomes
from conductor.report.autodrive.layout import ImportNote, read_imported
from conductor.serve.folders import CAMPAIGN_FILE
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.identity import campaign_digest
from schemas.kinds.kpi import KpiKind
from schemas.kinds.kpis.formula import KPIS as OF_FORMULA
from schemas.kinds.scenario import ScenarioKind, kind_of
from schemas.verdict import no_collision
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, UsageError
from twin.fabric.discovery import FILE_NAME as CONDUCTOR_FILE
from twin.records.campaign_file import read_plan

NOT_ENDED = "not ended"
"""Status of a case without an outcome."""


@dataclass(frozen=True, slots=True)
class CaseRow:
    """One case and how it ended."""

    case: Case
    end: CaseOutcome
    aeb_logged: bool = True
    """Whether a case without an AEB trigger is known to have had none."""
    collision_free: bool = False
    """Whether the case has no verdict, but its imported log is complete and tells of no
    collision."""

    @property
    def status(self) -> str:
        """The verdict where there is one, else the outcome, else :data:`NOT_ENDED`."""
        if self.end.outcome == "verdict":
            return self.end.verdict
        return self.end.outcome or NOT_ENDED

    @property
    def passed(self) -> bool | None:
        """Whether the case passed; None without a verdict: missing is never a pass."""
        return self.end.passed if self.end.outcome == "verdict" else None

    @property
    def no_collision(self) -> bool | None:
        """The rule of the AutoDRIVE paper; None without a verdict, unless the complete log of an
        imported case tells of no collision."""
        if self.collision_free:
            return True
        return no_collision(self.end.outcome, self.end.verdict, self.end.scalars)

    def scalar(self, name: str) -> float | int | None:
        """A scalar KPI; None where missing."""
        return self.end.scalars.get(name)


@dataclass(frozen=True, slots=True)
class Dossier:
    """A campaign folder as the report sees it; rows in campaign order."""

    folder: Path
    campaign: Campaign
    outcomes: Outcomes
    rows: list[CaseRow]
    running: bool
    """A conductor serves the folder at this moment."""
    digest_now: str
    """Digest of ``campaign.yaml`` as it is; should be the one that was run."""
    written_s: float
    """When the outcomes were written, at the earliest: since 1970 [s]."""
    imported: ImportNote | None = None
    """Where the logs came from that it was made of; None: it was run."""

    @property
    def left(self) -> int:
        """Cases that have not ended."""
        return sum(not row.end.outcome for row in self.rows)

    @property
    def scenario(self) -> ScenarioKind:
        """The declaration of the campaign's scenario family."""
        return kind_of(self.campaign.scenario)

    @property
    def scalars(self) -> list[KpiKind]:
        """Scalars of its cases, in the order of files; without those that are computed and that the
        version that ran them did not have."""
        had = {name for row in self.rows for name in row.end.scalars}
        every = [k for k in self.scenario.scalars if not k.implementation or k.name in had]
        return [*every, *(kind for kind in OF_FORMULA if kind.name in had)]

    def of_scenario(self, text: str) -> str:
        """A text of the scenario's declaration with the values of the scenario's keys."""
        config = self.scenario.config_of(self.campaign.scenario)
        return text.format(**{name: getattr(config, name) for name in config.__struct_fields__})

    @property
    def passed(self) -> int:
        """Cases with the verdict ``pass``."""
        return sum(row.passed is True for row in self.rows)

    @property
    def no_collision(self) -> int:
        """Cases with a verdict in which the ego did not collide."""
        return sum(row.no_collision is True for row in self.rows)

    @property
    def exit_code(self) -> int:
        """What ``conductor report`` exits with, alarms apart. A log that decides nothing is no
        pass; that no infrastructure was lost in it is known."""
        if self.imported is not None:
            return EXIT_PASS if self.passed == len(self.rows) else EXIT_FAILED
        return self.outcomes.exit_code


def open_dossier(folder: Path) -> Dossier:
    """Read the campaign ``folder``.

    Raises:
        UsageError: no campaign was run here, or nothing was simulated in it.
        InfrastructureError: its files are damaged or contradict each other.
    """
    try:  # before they are read: they may be written again at any moment
        written_s = (folder / OUTCOMES_FILE).stat().st_mtime
    except OSError:
        written_s = 0.0  # reading them says why
    outcomes = read_outcomes(folder)
    if outcomes.simulator == "noop":
        raise UsageError(
            f"{folder}: campaign '{outcomes.campaign}' ran with simulator noop, so nothing was "
            "simulated and there is nothing to report; run a campaign with simulator warp"
        )
    plan = read_plan(folder / CAMPAIGN_FILE)
    campaign, cases = plan.campaign, plan.cases
    if {case.id for case in cases} != set(outcomes.cases):
        odd = sorted({case.id for case in cases} ^ set(outcomes.cases))
        raise InfrastructureError(
            f"{folder}: {CAMPAIGN_FILE} and the outcomes list different cases, e.g. '{odd[0]}'; "
            f"restore {CAMPAIGN_FILE} as the conductor wrote it"
        )
    imported = read_imported(folder)
    labelled = cases
    without_aeb: set[str] = set()
    collision_free: set[str] = set()
    if imported is not None:  # only some batches of a configuration may be there
        labels = imported.batches
        labelled = [_with_batch(case, labels.get(case.id, 0)) for case in cases]
        without_aeb = set(imported.without_aeb)
        collision_free = set(imported.no_collision)
    return Dossier(
        folder=folder,
        campaign=campaign,
        outcomes=outcomes,
        rows=[
            CaseRow(c, outcomes.cases[c.id], c.id not in without_aeb, c.id in collision_free)
            for c in labelled
        ],
        running=not outcomes.complete and (folder / CONDUCTOR_FILE).exists(),
        digest_now=campaign_digest(campaign, cases),
        written_s=written_s,
        imported=imported,
    )


def _with_batch(case: Case, batch: int) -> Case:
    """The case with the label of another batch."""
    variation = msgspec.structs.replace(case.variation, batch=batch)
    return msgspec.structs.replace(case, variation=variation)
