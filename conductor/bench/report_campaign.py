"""A large campaign folder of real files, without a simulator: for measuring reports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from conductor.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.timeline import COMMITTED, LEASED, Event
from conductor.timeline import FILE_NAME as TIMELINE_FILE
from schemas.campaign import WEATHERS, Campaign, Case, expand, parse_campaign
from schemas.identity import campaign_digest
from schemas.kpi import SCALARS
from schemas.yaml_file import dump_yaml
from twin.fabric.kpi_file import KPI_SCHEMA, kpi_sha256, kpi_table

TICKS = 400
"""Rows of a case: 20 s at 20 Hz."""
SLOTS = 16
WALL_S = 30.0
"""Of a case, in the timeline [s]."""
_MODELS = {"yolov2": 0.04, "yolov2-tiny": 0.16, "yolov3": 0.03, "yolov3-tiny": 0.11}
_TICK_S = 0.05


def campaign_of(cases: int) -> Campaign:
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
    campaign, mistakes = parse_campaign(data)
    if campaign is None:
        raise AssertionError(mistakes[0].message)
    return campaign


def write_files(folder: Path, campaign: Campaign) -> list[tuple[Case, CaseOutcome]]:
    """Write campaign, KPI files and timeline; returns every case with its outcome."""
    cases = expand(campaign)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.yaml").write_text(dump_yaml(msgspec.to_builtins(campaign)))
    detections = _template()
    rng = np.random.default_rng(campaign.seed)
    ends = [(case, _write_case(folder, case, detections, rng)) for case in cases]
    with (folder / TIMELINE_FILE).open("wb") as file:
        for number, (case, end) in enumerate(ends):
            start_s = (number // SLOTS) * WALL_S
            for name, at_s in ((LEASED, start_s), (COMMITTED, start_s + WALL_S)):
                event = Event(
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
    found = {
        case.id: end if number < ended else CaseOutcome(outcome="")
        for number, (case, end) in enumerate(ends)
    }
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, [case for case, _ in ends]),
        seed=campaign.seed,
        simulator=campaign.simulator,
        software="5" * 64,
        device=campaign.device,
        device_classes=["cpu:bench"],
        complete=left == 0,
        cases=found,
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
    """A car that drives at 8 m/s, sees the obstacle at some distance and brakes."""
    sight_m = float(rng.uniform(2.0, 25.0))
    time_s = np.arange(TICKS) * _TICK_S
    free_m = np.maximum(62.0 - 8.0 * time_s, 0.0)
    trigger = int(np.argmax(free_m < sight_m))
    rest_m = max(sight_m - 5.0, 0.0)
    dtc_m = np.where(np.arange(TICKS) < trigger, free_m, np.maximum(free_m, rest_m))
    dtc_m += rng.normal(0.0, 1e-3, TICKS)
    hit = rest_m == 0.0
    aeb = np.arange(TICKS) >= trigger
    speed = np.where(aeb, np.maximum(8.0 - 7.0 * (time_s - time_s[trigger]), 0.0), 8.0)
    float_ = {
        "x_m": 62.0 - dtc_m,
        "y_m": rng.normal(0.0, 0.02, TICKS),
        "yaw_rad": rng.normal(0.0, 1e-3, TICKS),
        "speed_mps": speed,
        "accel_mps2": np.gradient(speed, _TICK_S),
        "dtc_m": dtc_m,
        "ttc_s": dtc_m / np.maximum(speed, 0.1),
        "throttle": np.where(aeb, 0.0, 0.3),
        "brake": aeb.astype(float),
        "steering_rad": rng.normal(0.0, 1e-3, TICKS),
    }
    whole = {
        "tick": np.arange(TICKS),
        "sim_time_ns": np.arange(TICKS) * int(_TICK_S * 1e9),
        "collisions": np.where(hit & (dtc_m < 0.05), 1, 0),
        "headlights": np.zeros(TICKS),
        "indicators": np.zeros(TICKS),
        "aeb": aeb,
    }
    empty = pa.nulls(TICKS, pa.float64())
    arrays = [
        detections
        if field.name == "detections"
        else pa.array(({**float_, **whole})[field.name].astype(field.type.to_pandas_dtype()))
        if field.name in float_ or field.name in whole
        else empty
        for field in KPI_SCHEMA
    ]
    table = pa.table(arrays, schema=KPI_SCHEMA)
    attempt = f"cases/{case.id}/attempt-1"
    (folder / attempt).mkdir(parents=True, exist_ok=True)
    pq.write_table(table, folder / attempt / "kpi.parquet", compression="zstd")
    scalars: dict[str, float | int | None] = {column.name: None for column in SCALARS}
    scalars |= {
        "sim_time_s": float(time_s[-1]),
        "ticks": TICKS - 1,
        "dtc_min_m": float(dtc_m.min()),
        "dtc_end_m": float(dtc_m[-1]),
        "aeb_time_s": float(time_s[trigger]),
        "aeb_dtc_m": float(dtc_m[trigger]),
        "impact_speed_mps": 3.0 if hit else None,
        "speed_max_mps": 8.0,
        "collisions": int(hit),
    }
    return CaseOutcome(
        outcome="verdict",
        verdict="collision" if hit else "pass",
        passed=not hit,
        reasons=["collision at 3.00 m/s" if hit else f"came to rest {rest_m:.2f} m before it"],
        scalars=scalars,
        attempt_dir=attempt,
        attempt=1,
        attempts=1,
        kpi_sha256=kpi_sha256(table),
        manifest_sha256="0" * 64,
        device_class="cpu:bench",
        worker=f"bench-{hash_of(case.id) % SLOTS:02}",
        wall_s=WALL_S,
    )


def hash_of(text: str) -> int:
    """The same number in every process."""
    return sum(ord(char) * (place + 1) for place, char in enumerate(text))
