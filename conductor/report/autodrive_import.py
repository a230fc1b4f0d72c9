"""Logs of the AutoDRIVE study -> a campaign folder, which the other commands read like any other.

KPIs that the logs do not hold (speed, acceleration, time to collision, lamps) are missing. Time is
the wall clock of the log. The verdict follows the rule of this simulator from what is there.
"""

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
from conductor.report.autodrive_layout import (
    BRAKE,
    CONFIDENCE,
    CONFIG_FILE,
    DTC,
    IMPORT_FILE,
    POS_X,
    POS_Y,
    ROT_Z,
    SIZE,
    STEERING,
    STEERING_MAX_RAD,
    THROTTLE,
    Config,
    Imported,
    Instance,
    log_name,
    read_config,
    read_imported,
)
from conductor.report.autodrive_logs import Log, LogRow, find_logs, read_log
from schemas.campaign import Campaign, Case, expand, parse_campaign
from schemas.identity import campaign_digest, digest
from schemas.kpi import DETECTION_FIELDS, SCALARS
from schemas.yaml_file import dump_yaml
from twin.fabric.errors import UsageError, storage_error
from twin.fabric.files import write_atomic
from twin.fabric.kpi_file import kpi_sha256, kpi_table, write_kpi

SIMULATOR = "autodrive"
"""Stands in the outcomes of an imported campaign; no case can be run with it."""
REST_MPS = 0.02
"""Slower than this between two rows is at rest; positions are logged in millimetres [m/s]."""
MOVED_M = 0.1
"""Further than this from its first place the ego has moved [m]."""


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
    for case, place in zip(cases, kept, strict=True):
        log = logs.get((place.batch, place.instance)) or Log(place.file, foreign="no such file")
        notes += log.notes
        if log.foreign:
            notes.append(f"{log.name}: {log.foreign}")
        ends[case.id] = _write_case(out, case, log)
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
    if read_imported(out) is None:
        for name in (CAMPAIGN_FILE, OUTCOMES_FILE, CONFIG_FILE, "cases"):
            if (out / name).exists():
                raise UsageError(
                    f"{out}: holds {name} and no import; give another folder with --out"
                )
    try:
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
        passed=verdict != "collision",
        reasons=[reason],
        scalars=_scalars(log.rows),
        attempt_dir=attempt,
        attempt=1,
        attempts=1,
        kpi_sha256=kpi_sha256(table),
        wall_s=log.rows[-1].time_us / 1e6,
    )


def kpi_columns(rows: list[LogRow]) -> dict[str, list[Any]]:
    """Columns of a KPI table; what a log does not hold is missing in every row."""

    def number(column: str) -> list[float]:
        return [row.numbers[column] for row in rows]

    def command(column: str, scale: float = 1.0) -> list[float | None]:
        return [None if math.isnan(v) else scale * v for v in number(column)]

    missing, unknown = [None] * len(rows), [math.nan] * len(rows)
    return {
        "tick": list(range(len(rows))),
        "sim_time_ns": [1000 * row.time_us for row in rows],
        "x_m": number(POS_X),
        "y_m": number(POS_Y),
        "yaw_rad": number(ROT_Z),
        "speed_mps": unknown,
        "accel_mps2": unknown,
        "dtc_m": number(DTC),
        "ttc_s": missing,
        "collisions": [row.collisions for row in rows],
        "lateral_error_m": missing,
        "throttle": command(THROTTLE),
        "brake": command(BRAKE),
        "steering_rad": command(STEERING, STEERING_MAX_RAD),
        "aeb": [row.aeb for row in rows],
        "headlights": missing,
        "indicators": missing,
        "detections": [_detections(row) for row in rows],
    }


def _detections(row: LogRow) -> list[dict[str, Any]]:
    """The box that the script looked at: of its place nothing is known, and only its area is
    logged, so it is one pixel high. Without a label the confidence means nothing."""
    size, percent = row.numbers[SIZE], row.numbers[CONFIDENCE]
    if not row.label or math.isnan(size):
        return []
    values = (row.label, percent / 100.0, math.nan, math.nan, size, 1.0)
    return [dict(zip(DETECTION_FIELDS, values, strict=True))]


def _scalars(rows: list[LogRow]) -> dict[str, float | int | None]:
    values: dict[str, float | int | None] = {column.name: None for column in SCALARS}
    distances = [row.numbers[DTC] for row in rows]
    known = [distance for distance in distances if not math.isnan(distance)]
    first = next((row for row in rows if row.aeb), None)
    values |= {
        "sim_time_s": rows[-1].time_us / 1e6,
        "ticks": len(rows) - 1,
        "dtc_min_m": min(known, default=None),
        "dtc_end_m": _present(distances[-1]),
        "collisions": rows[-1].collisions,
    }
    if first is not None:
        values["aeb_time_s"] = first.time_us / 1e6
        values["aeb_dtc_m"] = _present(first.numbers[DTC])
    return values


def _present(value: float) -> float | None:
    return None if math.isnan(value) else value


def judge(rows: list[LogRow], false_braking_m: float) -> tuple[str, str]:
    """Verdict and reason by the rule of this simulator: a collision, else any rest further than
    ``false_braking_m`` from the obstacle after the ego has moved, or never having moved there, is
    false braking, else it passes."""
    hit = next((row for row in rows if row.collisions), None)
    if hit is not None:
        return "collision", f"collision {hit.time_us / 1e6:.3f} s into the log"
    end_m = rows[-1].numbers[DTC]
    end = "at an unknown distance" if math.isnan(end_m) else f"{end_m:.2f} m from the obstacle"
    start = rows[0]
    moving = next((i for i, row in enumerate(rows) if _way_m(start, row) > MOVED_M), None)
    if moving is None:
        verdict = "false_braking" if end_m > false_braking_m else "pass"
        return verdict, f"the ego never moved, {end}"
    resting = False
    for before, row in zip(rows[moving:], rows[moving + 1 :], strict=False):
        resting = _way_m(before, row) <= REST_MPS * (row.time_us - before.time_us) / 1e6
        if resting and row.numbers[DTC] > false_braking_m:
            return "false_braking", (
                f"came to rest {row.numbers[DTC]:.2f} m from the obstacle; further than "
                f"{false_braking_m:g} m is false braking"
            )
    return "pass", f"came to rest {end}" if resting else f"the log ends {end}, the ego moving"


def _way_m(one: LogRow, two: LogRow) -> float:
    """Distance between the ego's places; by distance to the obstacle where a place is missing."""
    way = math.hypot(
        two.numbers[POS_X] - one.numbers[POS_X], two.numbers[POS_Y] - one.numbers[POS_Y]
    )
    return abs(two.numbers[DTC] - one.numbers[DTC]) if math.isnan(way) else way


def _write_campaign(
    out: Path, campaign: Campaign, cases: list[Case], ends: dict[str, CaseOutcome], found: Imported
) -> None:
    """The files that make the folder a campaign; the outcomes last, so that it is one only when it
    is complete."""
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, cases),
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
