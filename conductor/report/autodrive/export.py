"""A campaign's cases in the layout of the AutoDRIVE study, for the notebooks that read it.

Values are written in full, so that an import gives the same numbers, and how each case ended stands
in the configuration, so that it gives the same verdicts. What the layout has no place
for (speed, acceleration, time to collision, lamps, further boxes, further axes) is not in it.
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import io
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import msgspec

from conductor.records.fingerprint import committed_rows
from conductor.report.autodrive.layout import (
    BATCH_SIZE,
    LOG_S_MIN,
    PICTURE_PX,
    STEERING_MAX_RAD,
    EndedOutcome,
    ExportedEnd,
    Instance,
    StudyConfig,
)
from conductor.report.pages.summary import inert
from conductor.report.reading.axes import varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier, open_dossier
from conductor.trust.sign_run import require_fit
from schemas.case import Case
from schemas.files.autodrive_log import (
    AEB,
    BRAKE,
    COLLISIONS,
    COLUMNS,
    CONFIDENCE,
    CONFIG_FILE,
    DTC,
    HANDBRAKE,
    LABEL,
    MODEL,
    POS_X,
    POS_Y,
    ROT_Z,
    SIZE,
    STEERING,
    THROTTLE,
    TIME_OF_DAY,
    TIMESTAMP,
    WEATHER,
    log_name,
)
from schemas.kinds.scenario import scenario_kinds
from schemas.names import WEATHERS
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.base.progress import steps

CONFIDENCE_MIN = 0.5
"""The study's script looks at the last box of at least this confidence [-]."""

_START = datetime.datetime(2000, 1, 1)
"""Sim time 0 in the column of timestamps: a run has no date, and the same run gives the same
bytes."""


@dataclass(frozen=True, slots=True)
class Exported:
    """Files that were written, and notes."""

    files: list[Path]
    notes: list[str]
    """What the layout does not hold, a line each."""


def export_autodrive(folder: Path, out: Path) -> Exported:
    """Write ``config.json`` and a log per case with KPI rows of the campaign ``folder`` to ``out``.

    Raises:
        UsageError: no campaign was run in ``folder``, it does not fit into the layout, or ``out``
            holds something; one line.
        InfrastructureError: files are damaged, or the disk lets us down.
    """
    require_fit(folder)
    dossier = open_dossier(folder)
    _check(dossier, out)
    size = dossier.campaign.batch.size if dossier.campaign.batch else BATCH_SIZE
    notes = _notes(dossier, size)
    files = []
    instances = []
    try:
        for number, row in enumerate(steps("cases", dossier.rows)):
            path = out / log_name(number // size + 1, number % size + 1)
            path.parent.mkdir(parents=True, exist_ok=True)
            if row.end.kpi_sha256:
                log = _log(dossier, row).encode()
                write_atomic(path, log, sync=False)
                files.append(path)
                instances.append(_instance(row, hashlib.sha256(log).hexdigest()))
            else:
                notes.append(f"case {row.case.id}: {row.status}, no log")
                instances.append(_instance(row, ""))
        config = StudyConfig(
            simulation_instances=instances,
            batch_size=size,
            campaign=dossier.campaign.campaign,
            log_s_min=dossier.imported.log_s_min if dossier.imported else LOG_S_MIN,
            false_braking_m=dossier.campaign.scenario.false_braking_m,
        )
        path = out / CONFIG_FILE
        write_atomic(path, msgspec.json.format(msgspec.json.encode(config), indent=2) + b"\n")
    except OSError as error:
        raise storage_error(error, str(error.filename or out)) from None
    return Exported([*files, path], notes)


def _instance(row: CaseRow, log_sha256: str) -> Instance:
    """A case of the configuration, with its end: of that a log holds only a part."""
    end, exported = row.end, None
    if end.outcome in get_args(EndedOutcome):
        exported = ExportedEnd(
            outcome=cast(EndedOutcome, end.outcome),
            verdict=end.verdict,
            reasons=end.reasons,
            log_sha256=log_sha256,
        )
    return Instance(
        time_of_day=row.case.variation.time_of_day_min,
        weather_id=WEATHERS.index(row.case.variation.weather) + 1,
        model=row.case.variation.model,
        exported=exported,
    )


def _check(dossier: Dossier, out: Path) -> None:
    if not dossier.scenario.as_autodrive:
        known = " or ".join(k.name for k in scenario_kinds().declared if k.as_autodrive)
        raise UsageError(
            f"{dossier.folder}: in its cases {dossier.scenario.doc}, and the logs of the AutoDRIVE "
            f"study are about braking for an obstacle; export a campaign of type {known}"
        )
    strange = sorted({row.case.variation.weather for row in dossier.rows} - set(WEATHERS))
    if strange:
        raise UsageError(
            f"{dossier.folder}: weather '{strange[0]}' has no id in the layout, which knows "
            f"{', '.join(WEATHERS)}; run the campaign without it to export it"
        )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"{out}: exists and is not an empty folder; give another one with --out")


def _notes(dossier: Dossier, size: int) -> list[str]:
    notes = []
    cases = [row.case for row in dossier.rows]
    same = Counter(
        (case.variation.model, case.variation.weather, case.variation.time_of_day_min)
        for case in cases
    )
    if max(same.values()) > 1:
        axes = [a for a in varied_axes(dossier) if a not in ("model", "weather", "time_of_day")]
        notes.append(
            f"the layout has no column for {', '.join(axes)}: cases that differ in nothing else "
            "stand in it as repeats"
        )
    places = [number // size + 1 for number in range(len(cases))]
    labels = [case.variation.batch for case in cases]
    if any(labels) and labels != places:
        notes.append("batches are numbered anew, from 1, in the order of the cases")
    return notes


def _log(dossier: Dossier, row: CaseRow) -> str:
    table, _ = committed_rows(dossier.folder, row.case.id, row.end)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for values in table.to_pylist():
        cells = _cells(row.case, values)
        writer.writerow([cells.get(column, "0.0") for column in COLUMNS])
    return text.getvalue()


def _cells(case: Case, row: dict[str, Any]) -> dict[str, str]:
    """A row by column. The layout has height, roll and pitch, which are no KPIs, always."""
    moment = _START + datetime.timedelta(microseconds=row["sim_time_ns"] // 1000)
    aeb, steering = row["aeb"], row["steering_rad"]
    label, percent, area_px2 = _box(case, row["detections"] or [])
    return {
        TIMESTAMP: moment.isoformat(" ", "microseconds"),
        TIME_OF_DAY: str(case.variation.time_of_day_min),
        WEATHER: str(WEATHERS.index(case.variation.weather) + 1),
        MODEL: case.variation.model,
        LABEL: inert(label) or "",
        CONFIDENCE: _number(percent),
        SIZE: "" if area_px2 is None else str(area_px2),
        AEB: "" if aeb is None else str(int(aeb)),
        DTC: _number(row["dtc_m"]),
        THROTTLE: _number(row["throttle"]),
        STEERING: _number(None if steering is None else steering / STEERING_MAX_RAD),
        BRAKE: _number(row["brake"]),
        HANDBRAKE: "0.0",
        POS_X: _number(row["x_m"]),
        POS_Y: _number(row["y_m"]),
        ROT_Z: _number(row["yaw_rad"]),
        COLLISIONS: str(row["collisions"]),
    }


def _box(case: Case, detections: list[dict[str, Any]]) -> tuple[str, float, int | None]:
    """Label, confidence [%] and area of the box that the study's script would look at: the last one
    of those it is confident of, in whole pixels of its image."""
    confident = [box for box in detections if box["confidence"] >= CONFIDENCE_MIN]
    if not confident:
        return "", 0.0, None
    box = confident[-1]
    width, height = PICTURE_PX
    sides = (box["width_px"] * width / case.rig.camera.width, box["height_px"] * height)
    area_px2 = math.floor(sides[0]) * math.floor(sides[1] / case.rig.camera.height)
    label = " ".join("".join(c if c.isprintable() else " " for c in box["label"]).split())
    return label, 100.0 * box["confidence"], area_px2


def _number(value: float | None) -> str:
    """Number in full; empty where missing."""
    return "" if value is None or not math.isfinite(value) else repr(float(value))
