"""A campaign whose ego a robot drives until the stack brakes, with real processes."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from processes import outcomes

SPEED_MPS = 13.9
"""Of the ego in the shipped scenario, which the robot holds."""
SHORT_S, LONG_S = 3.0, 15.0
"""Ends of the storyboard: before the stack brakes, and long after."""
KPIS = [f"intervention_{name}" for name in ("kind", "time_s", "speed_mps", "dtc_m", "ttc_s")]
DATA = {
    "campaign": "led",
    "scenario": {"type": "storyboard", "storyboard": "braking-lead", "scene": "street"},
    "camera": {"width": 64, "height": 36, "hz": 10, "reflections": False},
    "autonomy": {
        "perception": {"truth": {"type": "ground_truth"}},
        "parameters": {"cruise_speed_mps": 31},
    },
    "matrix": {
        "scenario.driver": ["robot", "stack"],
        "storyboard.end.after_s": [SHORT_S, LONG_S],
    },
}


@pytest.fixture
def runs(marked, tmp_path):
    """Folders of the campaign with one slot and with four, which run the cases side by side."""
    path = tmp_path / "led.yaml"
    path.write_text(yaml.safe_dump(DATA))
    folders = {}
    for slots in ("1", "4"):
        folders[slots] = tmp_path / slots
        done = marked.run(
            *("conductor", "run", str(path), "--workers", "1", "--slots", slots),
            *("--out", str(folders[slots])),
        )
        assert done.returncode in (0, 1), done.stderr
    return folders


def cases_of(folder):
    """Rows of ``outcomes.json`` and tables of KPIs, by driver and end of the storyboard."""
    cases = {}
    for name, row in outcomes(folder).items():
        driver, _, end = name.removeprefix("driver_").partition("-end.after_s_")
        table = pq.read_table(folder / row["attempt_dir"] / "kpi.parquet")
        cases[driver, float(end)] = (
            row,
            {
                column: table.column(column).to_numpy(zero_copy_only=False)
                for column in table.schema.names
            },
        )
    return cases


def test_the_robot_drives_until_the_stack_brakes_whatever_the_slots(marked, runs):
    same = marked.run("conductor", "fingerprint", str(runs["1"]), str(runs["4"]))
    assert same.returncode == 0, same.stdout
    assert same.stdout.startswith("the same: ")
    judged = json.loads((runs["4"] / "judgement.json").read_text())
    assert judged["agree"] == judged["attempts"] == 4
    cases = cases_of(runs["4"])
    assert set(cases) == {(who, end) for who in ("robot", "stack") for end in (SHORT_S, LONG_S)}

    row, columns = cases["robot", LONG_S]
    drives = columns["robot_drives"]
    first = int(np.flatnonzero(drives == 0.0)[0])
    assert first > 2.0 / 0.05, "not before the car ahead brakes"
    assert not drives[first:].any(), "it does not come back"
    time_s = columns["sim_time_ns"] / 1e9
    held = slice(0, first + 1)
    assert columns["speed_mps"][held] == pytest.approx(SPEED_MPS, abs=1e-9)
    gone_m = columns["x_m"][held] - columns["x_m"][0]
    assert gone_m == pytest.approx(SPEED_MPS * time_s[held], abs=1e-6)
    assert np.ptp(columns["y_m"][held]) < 1e-9
    assert columns["speed_mps"][first + 10] < SPEED_MPS - 1.0, "from there on it is the stack's"
    scalars = row["scalars"]
    assert scalars["intervention_kind"] == 1
    assert scalars["intervention_time_s"] == time_s[first]
    assert scalars["intervention_speed_mps"] == columns["speed_mps"][first]
    assert scalars["intervention_dtc_m"] == columns["dtc_m"][first]
    assert scalars["intervention_ttc_s"] == columns["ttc_s"][first]
    words = f"the stack intervened by braking after {time_s[first]:.2f} s, at 13.90 m/s"
    assert row["reasons"][-1] == words
    assert words in (runs["4"] / "report.html").read_text()

    row, columns = cases["robot", SHORT_S]
    assert row["verdict"] == "pass"
    assert columns["robot_drives"].all()
    assert [row["scalars"][name] for name in KPIS] == [None] * 5
    assert row["reasons"][-1] == "the stack did not intervene, the robot drove to the end"

    for end in (SHORT_S, LONG_S):
        row, columns = cases["stack", end]
        assert np.isnan(columns["robot_drives"].astype(np.float64)).all(), "there is no robot"
        assert [row["scalars"][name] for name in KPIS] == [None] * 5
        assert np.ptp(columns["speed_mps"]) > 0.1, "a stack with a cruise control of its own"
