"""Campaign folders for tests of the console: small ones with recordings, and large ones."""

import json
from pathlib import Path

import yaml
from unit.viewer.recorded_case import write

from schemas.kinds.kpi import shipped
from twin.records.kpi_file import kpi_table, write_kpi
from viewer.recording.naming import KPI_FILE

CAMPAIGN = {
    "schema": 1,
    "campaign": "demo",
    "autonomy": {"perception": {"a": {"type": "ground_truth"}, "b": {"type": "ground_truth"}}},
    "matrix": {"model": ["a", "b"], "weather": ["clear", "heavy_fog"], "time_of_day": ["13:00"]},
}
"""Four cases: ``a-1300-clear``, ``a-1300-heavy_fog`` and the same of ``b``."""

CASES = ("a-1300-clear", "a-1300-heavy_fog", "b-1300-clear", "b-1300-heavy_fog")


def ended(verdict="pass", **changes):
    """A case of ``outcomes.json``."""
    row = {
        "outcome": "verdict",
        "verdict": verdict,
        "reasons": ["came to rest 5 m from the obstacle"],
        "scalars": {"dtc_min_m": 5.0, "impact_speed_mps": None, "sim_time_s": 0.25},
        "names": {"nearest_object": "obstacle"},
        "attempt": 1,
        "attempts": 1,
        "worker": "w1",
        "wall_s": 2.0,
        "rig_wall_s": 1.8,
    }
    return row | changes


def a_run(folder: Path, *, recorded=CASES[:2], campaign=None, **rows) -> Path:
    """A finished campaign of four cases; ``rows``: cases with other ends."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign or CAMPAIGN))
    cases = {}
    for case in CASES:
        cases[case] = ended(attempt_dir=f"cases/{case}/attempt-1")
        attempt = folder / "cases" / case / "attempt-1"
        if case in recorded:
            write(attempt, case=case)
        else:
            attempt.mkdir(parents=True)
        kpi(attempt)
        (attempt / "log.txt").write_text(f"case {case}\nall is well\n")
    for name, row in rows.items():
        cases[name.replace("__", "-")] |= row
    outcomes(folder, cases)
    return folder


def outcomes(folder: Path, cases, complete=True):
    """Write ``outcomes.json``."""
    text = json.dumps({"campaign": "demo", "complete": complete, "cases": cases})
    (folder / "outcomes.json").write_text(text)


def kpi(attempt: Path, collisions=(0, 0, 0), dtc_m=(9.0, 5.0, 6.0), aeb=(False, True, True)):
    """Rows of three ticks of 50 ms, as a worker writes them."""
    told = {"collisions": collisions, "dtc_m": dtc_m, "aeb": aeb, "speed_mps": (8.0, 7.0, 5.0)}
    told |= {"tick": (0, 1, 2), "sim_time_ns": (0, 50_000_000, 100_000_000)}
    needed = {kind.name: [0] * 3 for kind in shipped("column") if not kind.nullable}
    write_kpi(kpi_table(needed | {name: list(v) for name, v in told.items()}), attempt / KPI_FILE)
