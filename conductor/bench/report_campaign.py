"""A large campaign folder of real files, without a simulator: for measuring reports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.records.timeline import COMMITTED, LEASED, TimelineEvent
from conductor.records.timeline import FILE_NAME as TIMELINE_FILE
from schemas.campaign import WEATHERS, Campaign
from schemas.case import Case
from schemas.files.kpi import SCALARS
from schemas.files.yaml_file import dump_yaml
from schemas.identity import DIGESTS, campaign_digest
from schemas.plan import Plan, parse_plan
from twin.records.kpi_file import KPI_SCHEMA, kpi_sha256, kpi_table

TICKS = 400
"""Rows of a case: 20 s at 20 Hz."""
SLOTS = 16
WALL_S = 30.0
"""Wall time of a case, in the timeline [s]."""
_MODELS = {"yolov2": 0.04, "yolov2-tiny": 0.16, "yolov3": 0.03, "yolov3-tiny": 0.11}
_TICK_S = 0.05


def plan_of(cases: int) -> Plan:
    """The paper's matrix of 256 cells, repeated until there are at least ``cases``."""
    data = {
        "schema": 1,
        "campaign": "bench-report",
        "description": "Synthetic rows, to measure reports",
        "seed": 1,
        "autonomy": {
            "perception": {
                name: {"type": "ground_truth", "contrast_min": least}
                for name, least in _MODELS.items()
            }
        },
        "matrix": {
            "model": list(_MODELS),
            "weather": list(WEATHERS),
            "time_of_day": [f"{hour:02}:00" for hour in range(5, 20, 2)],
            "repeat": list(range(-(-cases // 256))),
        },
    }
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise AssertionError(mistakes[0].message)
    return plan


def write_files(folder: Path, plan: Plan) -> list[tuple[Case, CaseOutcome]]:
    """Write campaign, KPI files and timeline; returns every case with its outcome."""
    campaign, cases = plan.campaign, plan.cases
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.yaml").write_text(dump_yaml(msgspec.to_builtins(campaign)))
    detections = _template()
    rng = np.random.default_rng(campaign.seed)
    ends = [(case, _write_case(folder, case, detections, rng)) for case in cases]
    with (folder / TIMELINE_FILE).open("wb") as file:
        for number, (case, end) in enumerate(ends):
            start_s = (number // SLOTS) * WALL_S
            for name, at_s in ((LEASED, start_s), (COMMITTED, start_s + WALL_S)):
                event = TimelineEvent(
                    at_s=at_s,
                    event=name,
                    case=case.id,
                    token=number + 1,
                    worker=end.worker,
                    attempt=1,
                )
                file.write(msgspec.json.encode(event) + b"\n")
    return ends


def write_outcomes(
    folder: Path, campaign: Campaign, ends: list[tuple[Case, CaseOutcome]], left: int
) -> None:
    """Write the outcomes as they stand when the last ``left`` cases have not ended."""
    ended = len(ends) - left
    by_case = {
        case.id: end if number < ended else CaseOutcome(outcome="")
        for number, (case, end) in enumerate(ends)
    }
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, [case for case, _ in ends]),
        digests=DIGESTS,
        seed=campaign.seed,
        simulator=campaign.simulator,
        software="5" * 64,
        device=campaign.device,
        device_classes=["cpu:bench"],
        complete=left == 0,
        cases=by_case,
    )
    (folder / OUTCOMES_FILE).write_bytes(encode_outcomes(outcomes))


def _template() -> pa.Array:
    """Two detections per tick, as a stack reports them."""
    car = {"x_px": 301.5, "y_px": 170.25, "width_px": 60.0, "height_px": 41.0}
    rows = [
        [{"label": "car", "confidence": 0.5 + tick / 1000, **car}] * (1 + tick % 2)
        for tick in range(TICKS)
    ]
    columns: dict[str, list[Any]] = {name: [None] * TICKS for name in KPI_SCHEMA.names}
    for name in ("tick", "sim_time_ns", "collisions"):
        columns[name] = [0] * TICKS
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "accel_mps2", "dtc_m"):
        columns[name] = [0.0] * TICKS
    return kpi_table({**columns, "detections": rows}).column("detections").combine_chunks()


def _write_case(
    folder: Path, case: Case, detections: pa.Array, rng: np.random.Generator
) -> CaseOutcome:
    columns = _drive(rng)
    table = _table(columns, detections)
    attempt = f"cases/{case.id}/attempt-1"
    (folder / attempt).mkdir(parents=True, exist_ok=True)
    pq.write_table(table, folder / attempt / "kpi.parquet", compression="zstd")
    scalars = _scalars(columns)
    hit = bool(scalars["collisions"])
    rest = f"came to rest {scalars['dtc_end_m']:.2f} m before it"
    return CaseOutcome(
        outcome="verdict",
        verdict="collision" if hit else "pass",
        reasons=["collision at 3.00 m/s" if hit else rest],
        scalars=scalars,
        attempt_dir=attempt,
        attempt=1,
        attempts=1,
        kpi_sha256=kpi_sha256(table),
        manifest_sha256="0" * 64,
        device_class="cpu:bench",
        worker=f"bench-{rng.integers(SLOTS):02}",
        wall_s=WALL_S,
    )


def _drive(rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    """A car that drives at 8 m/s, sees the obstacle at some distance and brakes."""
    tick = np.arange(TICKS)
    time_s = tick * _TICK_S
    sight_m = float(rng.uniform(2.0, 25.0))
    rest_m = max(sight_m - 5.0, 0.0)
    free_m = np.maximum(62.0 - 8.0 * time_s, 0.0)
    trigger = int(np.argmax(free_m < sight_m))
    aeb = tick >= trigger
    dtc_m = np.where(aeb, np.maximum(free_m, rest_m), free_m)
    speed_mps = np.where(aeb, np.maximum(8.0 - 7.0 * (time_s - time_s[trigger]), 0.0), 8.0)
    return {
        "tick": tick,
        "sim_time_ns": tick * int(_TICK_S * 1e9),
        "x_m": 62.0 - dtc_m,
        "y_m": rng.normal(0.0, 0.02, TICKS),
        "yaw_rad": rng.normal(0.0, 1e-3, TICKS),
        "speed_mps": speed_mps,
        "accel_mps2": np.gradient(speed_mps, _TICK_S),
        "dtc_m": dtc_m,
        "ttc_s": dtc_m / np.maximum(speed_mps, 0.1),
        "collisions": (dtc_m == 0.0).astype(int),
        "throttle": np.where(aeb, 0.0, 0.3),
        "brake": aeb.astype(float),
        "steering_rad": rng.normal(0.0, 1e-3, TICKS),
        "aeb": aeb,
        "headlights": np.zeros(TICKS),
        "indicators": np.zeros(TICKS),
    }


def _table(columns: dict[str, NDArray[Any]], detections: pa.Array) -> pa.Table:
    def column(field: pa.Field) -> pa.Array:
        if field.name == "detections":
            return detections
        if field.name not in columns:
            return pa.nulls(TICKS, field.type)
        return pa.array(columns[field.name].astype(field.type.to_pandas_dtype()))

    return pa.table([column(field) for field in KPI_SCHEMA], schema=KPI_SCHEMA)


def _scalars(columns: dict[str, NDArray[Any]]) -> dict[str, float | int | None]:
    trigger = int(np.argmax(columns["aeb"]))
    hit = bool(columns["collisions"].any())
    scalars: dict[str, float | int | None] = {column.name: None for column in SCALARS}
    return scalars | {
        "sim_time_s": (TICKS - 1) * _TICK_S,
        "ticks": TICKS - 1,
        "dtc_min_m": float(columns["dtc_m"].min()),
        "dtc_end_m": float(columns["dtc_m"][-1]),
        "aeb_time_s": trigger * _TICK_S,
        "aeb_dtc_m": float(columns["dtc_m"][trigger]),
        "impact_speed_mps": 3.0 if hit else None,
        "speed_max_mps": 8.0,
        "collisions": int(hit),
    }
