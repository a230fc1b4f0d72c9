"""Logs of the AutoDRIVE study -> a campaign folder that the other commands read like any other."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.report.autodrive.kpi import judge, kpi_columns, scalars
from conductor.report.autodrive.layout import IMPORT_FILE, ExportedEnd, ImportNote, read_imported
from conductor.report.autodrive.logs import Log
from conductor.report.autodrive.source import LogFolder, StudyCase, read_source, short_logs, title
from conductor.serve.folders import CAMPAIGN_FILE
from schemas.case import Case
from schemas.escape import escape
from schemas.files.autodrive_log import CONFIG_FILE
from schemas.files.yaml_file import dump_yaml
from schemas.identity import DIGESTS, campaign_digest
from schemas.plan import Plan, parse_plan
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.progress import steps
from twin.records.kpi_file import kpi_sha256, kpi_table, write_kpi

SIMULATOR = "autodrive"
"""Simulator in the outcomes of an imported campaign; no case can be run with it."""

BEGUN_FILE = ".importing"
"""File in the folder while that is made: what a kill leaves behind may be replaced."""


@dataclass(frozen=True, slots=True)
class _Imported:
    """A case that was imported."""

    case: Case
    place: StudyCase
    log: Log
    end: CaseOutcome
    no_collision: bool
    """The log is complete and tells of no collision."""

    @property
    def read(self) -> bool:
        """Whether its log was read, and is that of the case."""
        return bool(self.log.rows) and not self.log.foreign

    @property
    def unexplained(self) -> bool:
        """Whether it has no log that can be read, and no export says that it has none."""
        exported = self.place.described.exported
        return bool(self.log.foreign) and (exported is None or bool(exported.log_sha256))


def import_autodrive(folder: Path, out: Path) -> ImportNote:
    """Make the campaign folder ``out`` from the logs in ``folder``.

    Cases of a batch of which there is anything are part of the campaign, ``unresolved`` if their
    own log is missing, cannot be read or does not decide them; cases of other batches are not.

    Raises:
        UsageError: ``folder`` holds no such logs, or ``out`` is something else; one line.
        InfrastructureError: the disk lets us down.
    """
    source = read_source(folder)
    notes = list(source.notes)
    plan = _plan(folder, source, notes)
    _prepare(out)
    cases = [
        _import_case(out, case, place, source)
        for case, place in steps("logs", [*zip(plan.cases, source.kept, strict=True)])
    ]
    for one in cases:
        notes += one.log.notes
        if one.unexplained:
            notes.append(f"{one.log.name}: {one.log.foreign}")
    read = [one for one in cases if one.read]
    imported = ImportNote(
        source=escape(folder.resolve().name),
        sha256=source.sha256,
        files=sum(bool(one.log.sha256) for one in cases),
        rows=sum(len(one.log.rows) for one in read),
        left_out=[escape(note) for note in notes],
        absent_batches=sorted({x.batch for x in source.places} - {x.batch for x in source.kept}),
        sources={one.case.id: one.log.name for one in cases if one.log.sha256},
        batches={one.case.id: one.place.batch for one in cases},
        without_aeb=[x.case.id for x in read if all(row.aeb is None for row in x.log.rows)],
        warnings=short_logs([x.log for x in read if x.place.described.exported is None]),
        log_s_min=source.config.log_s_min,
        no_collision=[x.case.id for x in cases if x.no_collision and x.end.outcome == "unresolved"],
    )
    _write_campaign(out, plan, {one.case.id: one.end for one in cases}, imported)
    return imported


def _plan(folder: Path, source: LogFolder, notes: list[str]) -> Plan:
    kept = source.kept
    names = _names({place.described.model for place in kept}, notes)
    ends_s = [log.rows[-1].time_us / 1e6 for log in source.logs.values() if log.rows]
    points: list[dict[str, Any]] = []
    repeats: dict[tuple[Any, ...], int] = {}
    for place in kept:
        minutes = place.described.time_of_day
        point: dict[str, Any] = {
            "model": names[place.described.model],
            "weather": place.described.weather,
            "time_of_day": f"{minutes // 60:02}:{minutes % 60:02}",
        }
        key = tuple(point.values())
        repeat = repeats[key] = repeats.get(key, -1) + 1
        points.append({**point, "repeat": repeat} if repeat else point)
    data = {
        "campaign": _name(source.config.campaign) or _name(title(folder)) or "autodrive",
        "description": "Imported from logs of the AutoDRIVE study",
        "scenario": {
            "duration_s": min(3600.0, max(0.1, math.ceil(max(ends_s, default=0.0)))),
            "false_braking_m": source.config.false_braking_m,
        },
        "autonomy": {
            "perception": {
                name: {"type": "network", "model": f"named {name} in the logs"}
                for name in dict.fromkeys(names.values())
            }
        },
        "cases": points,
    }
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise UsageError(f"{folder}: {mistakes[0].line('its cases')}")
    return plan


def _names(models: set[str], notes: list[str]) -> dict[str, str]:
    """Names that may be file names and keys, of the models as they are called."""
    names: dict[str, str] = {}
    for model in sorted(models):
        name = base = _name(model) or "model"
        number = 2
        while name in names.values():
            name, number = f"{base[:56]}-{number}", number + 1
        names[model] = name
        if name != model:
            notes.append(f"model '{model}' is called '{name}' here")
    return names


def _name(text: str) -> str:
    return re.sub(r"[^a-z0-9._-]+", "-", text.lower())[:60].strip("._-")


def _prepare(out: Path) -> None:
    """Make ``out`` empty of an earlier import; anything else in it is not ours to replace."""
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: not a folder; give another one with --out")
    # An import that was killed has said that the folder is its own.
    if not (out / BEGUN_FILE).exists() and read_imported(out) is None:
        for name in (CAMPAIGN_FILE, OUTCOMES_FILE, CONFIG_FILE, "cases"):
            if (out / name).exists():
                raise UsageError(
                    f"{out}: holds {name} and no import; give another folder with --out"
                )
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / BEGUN_FILE).touch()
        (out / OUTCOMES_FILE).unlink(missing_ok=True)
        shutil.rmtree(out / "cases", ignore_errors=True)
        (out / "cases").mkdir(parents=True)
    except OSError as error:
        raise storage_error(error, str(out)) from None


def _import_case(out: Path, case: Case, place: StudyCase, source: LogFolder) -> _Imported:
    log = source.log_of(place)
    exported = place.described.exported
    if log.foreign:
        end = CaseOutcome(outcome="unresolved", reasons=[f"{log.name}: {log.foreign}"])
        if exported is not None and not exported.log_sha256 and exported.outcome != "verdict":
            end = _as_exported(exported)
        return _Imported(case, place, log, end, no_collision=False)
    attempt = f"cases/{case.id}/attempt-1"
    table = kpi_table(kpi_columns(log.rows))
    try:
        (out / attempt).mkdir(parents=True)
    except OSError as error:
        raise storage_error(error, str(out / attempt)) from None
    write_kpi(table, out / attempt / "kpi.parquet")
    judged = judge(
        log.rows, table, case.variation.scenario.false_braking_m, source.config.log_s_min
    )
    end = CaseOutcome(
        outcome=judged.outcome,
        verdict=judged.verdict,
        reasons=[judged.reason],
    )
    hits = [which.verdict == "collision" for which in (judged, exported or judged)]
    if exported is not None and exported.log_sha256 == log.sha256 and hits[0] == hits[1]:
        end = _as_exported(exported)
    end = msgspec.structs.replace(
        end,
        scalars=scalars(log.rows),
        attempt_dir=attempt,
        kpi_sha256=kpi_sha256(table),
    )
    return _Imported(case, place, log, end, no_collision=judged.no_collision is True)


def _as_exported(exported: ExportedEnd) -> CaseOutcome:
    return CaseOutcome(
        outcome=exported.outcome,
        verdict=escape(exported.verdict),
        reasons=[escape(reason) for reason in exported.reasons],
    )


def _write_campaign(
    out: Path, plan: Plan, ends: dict[str, CaseOutcome], imported: ImportNote
) -> None:
    """The files that make the folder a campaign; the outcomes last, so that it is one only when it
    is complete."""
    campaign = plan.campaign
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, plan.cases),
        digests=DIGESTS,
        seed=campaign.seed,
        simulator=SIMULATOR,
        software="",
        device=campaign.device,
        device_classes=[],
        complete=True,
        cases=ends,
    )
    files = {
        IMPORT_FILE: msgspec.json.format(msgspec.json.encode(imported), indent=1) + b"\n",
        CAMPAIGN_FILE: dump_yaml(msgspec.to_builtins(campaign)).encode(),
        OUTCOMES_FILE: encode_outcomes(outcomes),
    }
    for name, data in files.items():
        try:
            write_atomic(out / name, data)
        except OSError as error:
            raise storage_error(error, str(out / name)) from None
    try:
        (out / BEGUN_FILE).unlink(missing_ok=True)
    except OSError as error:
        raise storage_error(error, str(out / BEGUN_FILE)) from None
