"""Campaign folders for report tests: real types and files, a point mass instead of a simulator."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.report.pages.content import read_content
from conductor.report.pages.page import render
from conductor.report.reading.dossier import open_dossier
from conductor.report.reading.recorded import failures
from schemas.campaign import Campaign
from schemas.case import Case
from schemas.files.kpi import SCALARS
from schemas.files.yaml_file import dump_yaml
from schemas.identity import DIGESTS, campaign_digest
from schemas.plan import expand, parse_campaign
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi

TICK_S = 0.05
_SIGHT = {"heavy_fog": 0.45, "light_fog": 0.8, "heavy_rain": 0.7, "heavy_snow": 0.65}
_GRIP = {"heavy_rain": 0.8, "light_rain": 0.88, "light_snow": 0.75, "heavy_snow": 0.6}

Change = Callable[[Case, CaseOutcome], CaseOutcome]


def campaign_data(**changes: Any) -> dict[str, Any]:
    """A small campaign: 2 models x 2 weathers x 2 times of day."""
    return {
        "schema": 1,
        "campaign": "synthetic",
        "description": "Point masses that brake",
        "seed": 7,
        "scenario": {"ego_start_m": 60, "duration_s": 20},
        "autonomy": {
            "perception": {
                "yolov3": {"type": "ground_truth", "contrast_min": 0.05},
                "yolov2-tiny": {"type": "ground_truth", "contrast_min": 0.16},
            }
        },
        "matrix": {
            "model": ["yolov3", "yolov2-tiny"],
            "weather": ["clear", "heavy_fog"],
            "time_of_day": ["05:00", "13:00"],
        },
        **changes,
    }


def make_campaign(
    folder: Path, data: dict[str, Any] | None = None, change: Change | None = None
) -> tuple[Campaign, Outcomes]:
    """Write a campaign folder as the conductor leaves it; ``change`` edits single outcomes."""
    campaign, mistakes = parse_campaign(data or campaign_data())
    assert campaign is not None, mistakes
    cases = expand(campaign)
    ends = {}
    for case in cases:
        end = drive(folder, case)
        ends[case.id] = change(case, end) if change else end
    outcomes = Outcomes(
        campaign=campaign.campaign,
        digest=campaign_digest(campaign, cases),
        digests=DIGESTS,
        seed=campaign.seed,
        simulator=campaign.simulator,
        clock=campaign.clock,
        software="5" * 64,
        device=campaign.device,
        device_classes=["cpu:avx2"],
        complete=all(end.outcome for end in ends.values()),
        cases=ends,
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.yaml").write_text(dump_yaml(msgspec.to_builtins(campaign)))
    (folder / "outcomes.json").write_bytes(encode_outcomes(outcomes))
    return campaign, outcomes


def drive(folder: Path, case: Case) -> CaseOutcome:
    """One case: accelerate, see the obstacle at some distance, brake, stop or hit it."""
    dark = (
        0.8
        if case.variation.time_of_day_min < 6 * 60 or case.variation.time_of_day_min > 18 * 60
        else 1.0
    )
    contrast_min = getattr(case.variation.perception, "contrast_min", 0.06)
    sight_m = 22 * dark * _SIGHT.get(case.variation.weather, 1.0) * (0.06 / contrast_min) ** 0.3
    scenario = case.variation.scenario
    scalars, file, digest = _driven(
        *(scenario.ego_start_m, scenario.duration_s, sight_m),
        7.0 * _GRIP.get(case.variation.weather, 1.0),
    )
    attempt = f"cases/{case.id}/attempt-1"
    (folder / attempt).mkdir(parents=True, exist_ok=True)
    (folder / attempt / "kpi.parquet").write_bytes(file)
    hit = bool(scalars["collisions"])
    reason = (
        f"collision at {scalars['impact_speed_mps']:.2f} m/s"
        if hit
        else f"came to rest {scalars['dtc_end_m']:.2f} m from the obstacle"
    )
    return CaseOutcome(
        outcome="verdict",
        verdict="collision" if hit else "pass",
        reasons=[reason],
        scalars=dict(scalars),
        attempt_dir=attempt,
        attempt=1,
        attempts=1,
        kpi_sha256=digest,
        manifest_sha256="0" * 64,
        device_class="cpu:avx2",
        worker="w1",
        wall_s=1.5,
    )


def rested(folder: Path, end: CaseOutcome, dtc_m: float) -> CaseOutcome:
    """The case with a second of rest ``dtc_m`` from the obstacle, after which it drove on."""
    path = folder / end.attempt_dir / "kpi.parquet"
    before = read_kpi(path).to_pydict()
    at = next(row for row, distance in enumerate(before["dtc_m"]) if distance < dtc_m)
    order = [*range(at), *[at] * 20, *range(at, len(before["dtc_m"]))]
    columns = {name: [values[row] for row in order] for name, values in before.items()}
    columns["tick"] = list(range(len(order)))
    columns["sim_time_ns"] = [round(tick * TICK_S * 1e9) for tick in columns["tick"]]
    columns["speed_mps"][at : at + 20] = [0.0] * 20
    columns["dtc_m"][at : at + 20] = [dtc_m] * 20
    table = kpi_table(columns)
    write_kpi(table, path)
    reason = f"came to rest {dtc_m:.2f} m from the obstacle; further than 30 m is false braking"
    return msgspec.structs.replace(
        end, verdict="false_braking", reasons=[reason], kpi_sha256=kpi_sha256(table)
    )


@cache
def _driven(
    start_m: float, duration_s: float, sight_m: float, decel_mps2: float
) -> tuple[dict[str, float | int | None], bytes, str]:
    """Scalars of a drive, its KPI file and the digest of that: hundreds of tests ask for few."""
    columns = _rows(start_m, duration_s, sight_m, decel_mps2)
    table = kpi_table(columns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kpi.parquet"
        write_kpi(table, path)
        return _scalars(columns), path.read_bytes(), kpi_sha256(table)


def _rows(
    start_m: float, duration_s: float, sight_m: float, decel_mps2: float
) -> dict[str, list[Any]]:
    rows: list[dict[str, Any]] = []
    distance, speed, rest, aeb = start_m, 0.0, 0, False
    for tick in range(round(duration_s / TICK_S) + 1):
        aeb = aeb or distance < sight_m
        accel = -decel_mps2 if aeb and speed > 0 else (2.0 if speed < 10 and not aeb else 0.0)
        hit = distance <= 0
        rest += speed == 0 and aeb
        last = hit or rest > 2 / TICK_S
        closing = speed > 0.05
        rows.append(
            {
                "tick": tick,
                "sim_time_ns": round(tick * TICK_S * 1e9),
                "x_m": start_m - distance,
                "y_m": 0.0,
                "yaw_rad": 0.0,
                "speed_mps": speed,
                "accel_mps2": accel,
                "dtc_m": max(distance, 0.0),
                "ttc_s": distance / speed if closing else None,
                "collisions": int(hit),
                "lateral_error_m": None,
                "throttle": None if last else (0.0 if aeb else 0.4 + 0.4 * (speed < 10)),
                "brake": None if last else float(aeb),
                "steering_rad": None if last else 0.0,
                "aeb": None if last else aeb,
                "headlights": None if last else 0,
                "indicators": None if last else 0,
                "detections": None if last else [],
            }
        )
        if last:
            break
        speed = max(speed + accel * TICK_S, 0.0)
        distance -= speed * TICK_S
    return {name: [row[name] for row in rows] for name in rows[0]}


def _scalars(columns: dict[str, list[Any]]) -> dict[str, float | int | None]:
    first = next((i for i, aeb in enumerate(columns["aeb"]) if aeb), None)
    hit = columns["collisions"][-1]
    values: dict[str, float | int | None] = {column.name: None for column in SCALARS}
    values |= {
        "sim_time_s": columns["sim_time_ns"][-1] / 1e9,
        "ticks": columns["tick"][-1],
        "dtc_min_m": min(columns["dtc_m"]),
        "dtc_end_m": columns["dtc_m"][-1],
        "impact_speed_mps": columns["speed_mps"][-1] if hit else None,
        "decel_peak_mps2": max(0.0, -min(columns["accel_mps2"])),
        "speed_max_mps": max(columns["speed_mps"]),
        "collisions": hit,
    }
    if first is not None:
        values["aeb_time_s"] = columns["sim_time_ns"][first] / 1e9
        values["aeb_dtc_m"] = columns["dtc_m"][first]
        values["aeb_ttc_s"] = columns["ttc_s"][first]
    return values


def page_of(folder: Path) -> str:
    """The page as a report has it, without the files beside it: plots take longer than the page."""
    dossier = open_dossier(folder)
    return render(read_content(dossier), failures(dossier))
