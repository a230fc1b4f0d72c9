"""Logs of the AutoDRIVE study -> a campaign folder that the other commands read like any other."""

from __future__ import annotations

import hashlib
import math
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from conductor.folders import CAMPAIGN_FILE
from conductor.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.report.autodrive_kpi import judge, kpi_columns, scalars
from conductor.report.autodrive_layout import (
    IMPORT_FILE,
    Config,
    Imported,
    Instance,
    read_config,
    read_imported,
)
from conductor.report.autodrive_logs import Log, find_logs, read_log
from schemas.autodrive_log import CONFIG_FILE, log_name
from schemas.campaign import Campaign, Case, expand, parse_campaign
from schemas.identity import DIGESTS, campaign_digest, digest
from schemas.yaml_file import dump_yaml
from twin.fabric.errors import UsageError, storage_error
from twin.fabric.files import write_atomic
from twin.fabric.kpi_file import kpi_sha256, kpi_table, write_kpi

SIMULATOR = "autodrive"
"""Stands in the outcomes of an imported campaign; no case can be run with it."""

BEGUN_FILE = ".importing"
"""In the folder while it is made: what a kill leaves behind may be replaced."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A case of the configuration."""

    batch: int
    instance: int
    described: Instance

    @property
    def file(self) -> str:
        """Its log."""
        return log_name(self.batch, self.instance)


def import_autodrive(source: Path, out: Path) -> Imported:
    """Make the campaign folder ``out`` from the logs in ``source``.

    Cases of a batch of which there is any log are part of the campaign, ``unresolved`` if their
    own log is missing or cannot be read; cases of other batches are not.

    Raises:
        UsageError: ``source`` holds no such logs, or ``out`` is something else; one line.
        InfrastructureError: the disk lets us down.
    """
    config, config_bytes = read_config(source)
    notes: list[str] = []
    logs, sha256 = _read_logs(source, config, config_bytes, notes)
    places = [
        _Place(n // config.batch_size + 1, n % config.batch_size + 1, instance)
        for n, instance in enumerate(config.simulation_instances)
    ]
    present = {batch for batch, _ in logs}
    kept = [place for place in places if place.batch in present]
    if not kept:
        found = f"; {notes[0]}" if notes else ""
        raise UsageError(
            f"{source}: no log batch_N/aeb_metrics_sim_inst_M.csv of a case in its "
            f"configuration{found}"
        )
    campaign = _campaign(source, kept, logs, notes)
    cases = expand(campaign)
    _prepare(out)
    ends = {}
    without_aeb = []
    for case, place in zip(cases, kept, strict=True):
        log = logs.get((place.batch, place.instance)) or Log(place.file, foreign="no such file")
        notes += log.notes
        if log.foreign:
            notes.append(f"{log.name}: {log.foreign}")
        ends[case.id] = _write_case(out, case, log)
        if not log.foreign and all(row.aeb is None for row in log.rows):
            without_aeb.append(case.id)
    imported = Imported(
        source=source.absolute().name,
        sha256=sha256,
        files=len(logs),
        rows=sum(len(log.rows) for log in logs.values() if not log.foreign),
        left_out=["".join(c if c.isprintable() else "?" for c in note) for note in notes],
        absent_batches=sorted({place.batch for place in places} - present),
        sources={
            case.id: place.file
            for case, place in zip(cases, kept, strict=True)
            if (place.batch, place.instance) in logs
        },
        batches={case.id: place.batch for case, place in zip(cases, kept, strict=True)},
        without_aeb=without_aeb,
    )
    _write_campaign(out, campaign, cases, ends, imported)
    return imported


def _read_logs(
    source: Path, config: Config, config_bytes: bytes, notes: list[str]
) -> tuple[dict[tuple[int, int], Log], str]:
    """Logs by batch and instance, and the digest of everything that was read."""
    logs: dict[tuple[int, int], Log] = {}
    digests: dict[str, str] = {}
    for (batch, instance), name, data in find_logs(source, notes):
        number = (batch - 1) * config.batch_size + instance - 1
        if instance > config.batch_size or number >= len(config.simulation_instances):
            notes.append(f"{name}: the configuration has no case for it")
        elif (batch, instance) in logs:
            notes.append(f"{name}: is there a second time; the first one counts")
        else:
            described = config.simulation_instances[number]
            logs[batch, instance] = read_log(name, data, described)
            digests[name] = hashlib.sha256(data).hexdigest()
    parts = [config_bytes, *(f"{name}={sha}".encode() for name, sha in sorted(digests.items()))]
    return logs, digest(parts)


def _campaign(
    source: Path, kept: list[_Place], logs: dict[tuple[int, int], Log], notes: list[str]
) -> Campaign:
    names = _names({place.described.model for place in kept}, notes)
    ends_s = [log.rows[-1].time_us / 1e6 for log in logs.values() if log.rows]
    points: list[dict[str, Any]] = []
    seen: dict[tuple[Any, ...], int] = {}
    for place in kept:
        minutes = place.described.time_of_day
        point: dict[str, Any] = {
            "model": names[place.described.model],
            "weather": place.described.weather,
            "time_of_day": f"{minutes // 60:02}:{minutes % 60:02}",
        }
        key = tuple(point.values())
        repeat = seen[key] = seen.get(key, -1) + 1
        points.append({**point, "repeat": repeat} if repeat else point)
    data = {
        "campaign": _name(source.absolute().name) or "autodrive",
        "description": "Imported from logs of the AutoDRIVE study",
        "scenario": {"duration_s": min(3600.0, max(0.1, math.ceil(max(ends_s, default=0.0))))},
        "autonomy": {
            "perception": {
                name: {"type": "network", "model": f"named {name} in the logs"}
                for name in dict.fromkeys(names.values())
            }
        },
        "cases": points,
    }
    campaign, mistakes = parse_campaign(data)
    if campaign is None:
        raise UsageError(f"{source}: {mistakes[0].line('its cases')}")
    return campaign


def _names(models: set[str], notes: list[str]) -> dict[str, str]:
    """Names that may be file names and keys, of the models as they are called."""
    found: dict[str, str] = {}
    for model in sorted(models):
        name = base = _name(model) or "model"
        number = 2
        while name in found.values():
            name, number = f"{base[:56]}-{number}", number + 1
        found[model] = name
        if name != model:
            notes.append(f"model '{model}' is called '{name}' here")
    return found


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


def _write_case(out: Path, case: Case, log: Log) -> CaseOutcome:
    if log.foreign:
        reason = f"{log.name}: {log.foreign}"
        return CaseOutcome(outcome="unresolved", reasons=[reason], attempts=1)
    attempt = f"cases/{case.id}/attempt-1"
    table = kpi_table(kpi_columns(log.rows))
    try:
        (out / attempt).mkdir(parents=True)
    except OSError as error:
        raise storage_error(error, str(out / attempt)) from None
    write_kpi(table, out / attempt / "kpi.parquet")
    verdict, reason = judge(log.rows, case.scenario.false_braking_m)
    return CaseOutcome(
        outcome="verdict",
        verdict=verdict,
        reasons=[reason],
        scalars=scalars(log.rows),
        attempt_dir=attempt,
        attempt=1,
        attempts=1,
        kpi_sha256=kpi_sha256(table),
        wall_s=log.rows[-1].time_us / 1e6,
    )


def _write_campaign(
    out: Path, campaign: Campaign, cases: list[Case], ends: dict[str, CaseOutcome], found: Imported
) -> None:
    """The files that make the folder a campaign; the outcomes last, so that it is one only when it
    is complete."""
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, cases),
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
        IMPORT_FILE: msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n",
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
