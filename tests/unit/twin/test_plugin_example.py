"""The example distribution in one engine: sensed, judged, and judged again from its rows."""

import json
import subprocess
import sys

import pytest
from plugin_site import ROOT, install_example

CAMPAIGN = """\
campaign: stop-line
camera: {width: 32, height: 18, hz: 10}
render: false
scenario: {type: stop_line, duration_s: 2, ego_speed_mps: 5, standstill_s: 0.1}
sensors: {thermometer: {hz: 10}}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {scenario.line_m: [1, 4, 12], scenario.air_c: [0, 40]}
"""

DRIVE = """
import json, sys
from pathlib import Path
import numpy as np
from schemas.files.yaml_file import parse_yaml
from schemas.identity import rig_key
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.kinds.scenario import kind_of
from twin.kpi import verdict
from twin.kpi.computed import computed_column
from twin.kpi.judge import TableRows
from twin.kpi.judge_record import hit_of, state_of, surroundings_of
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi
from twin.rig.engine import Engine
from twin.scenario.families import replay
campaign, mistakes = parse_campaign(parse_yaml(sys.stdin.read(), "stop-line.yaml"))
assert campaign is not None, mistakes
cases = expand(campaign)
engine, seen, ended = Engine(cases[0], len(cases)), [], {}
for slot, case in enumerate(cases):
    engine.reset(slot, case)
while engine.active.any():
    sensed = engine.sense()
    if "thermometer" in sensed:
        seen.append(sensed["thermometer"].values[:, 0].tolist())
    commands = [Command(slot, 0, int(engine.tick[slot]), 0.0, 0.5, 0.0) for slot in range(6)]
    for end in engine.step([c if a else None for c, a in zip(commands, engine.active)]):
        ended[end.slot] = end

def judged(end):
    table = kpi_table(end.table.to_lists())
    path = Path(sys.argv[1])
    write_kpi(table, path)
    assert kpi_sha256(read_kpi(path)) == kpi_sha256(table)
    rows = TableRows(table)
    again = replay(end.record.scenario, surroundings_of(end.record), rows)
    state, hit, kind = state_of(end.record), hit_of(end.record), kind_of(end.record.scenario)
    jerk = np.where(rows.valid("jerk_mps3"), rows.column("jerk_mps3"), np.nan)
    return {
        "line_m": end.record.scenario.line_m,
        "verdict": end.verdict,
        "again": verdict.judge(rows, state, again, hit).verdict,
        "scalars": end.scalars,
        "scalars_again": verdict.scalars(rows, state, again, hit, kind.scalars),
        "columns": table.column_names[-2:],
        "to_line_m": table.column("to_line_m").to_pylist(),
        "jerk_mps3": table.column("jerk_mps3").to_pylist(),
        "jerk_again": np.array_equal(jerk, computed_column(kind.columns[1], rows), True),
        "target": bool(end.table.columns["dtc_m"].valid.any()),
    }

print(json.dumps({
    "rigs": len({rig_key(case) for case in cases}),
    "air_c": [case.variation.scenario.air_c for case in cases],
    "seen": seen,
    "ended": [judged(end) for end in ended.values()],
}))
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """What the example's cases came to, six in one engine."""
    folder = tmp_path_factory.mktemp("plugin")
    _, env = install_example(folder)
    command = [sys.executable, "-c", DRIVE, str(folder / "kpi.parquet")]
    done = subprocess.run(
        command, env=env, cwd=ROOT, capture_output=True, text=True, input=CAMPAIGN
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_cases_of_two_temperatures_share_a_rig_and_read_their_own(drive):
    assert drive["rigs"] == 1
    assert drive["seen"][0] == [20.0] * 6
    for now, air_c in zip(drive["seen"][2], drive["air_c"], strict=True):
        assert min(air_c, 20.0) < now < max(air_c, 20.0)


def test_every_verdict_of_the_family_is_reached_and_found_again(drive):
    words = {row["line_m"]: row["verdict"] for row in drive["ended"]}
    assert words == {1.0: "over_the_line", 4.0: "pass", 12.0: "too_short"}
    for row in drive["ended"]:
        assert row["again"] == row["verdict"]
        assert row["scalars_again"] == row["scalars"]
        assert row["scalars"]["distance_m"] is None, "that is another family's"
        assert row["target"]


def test_columns_stand_behind_those_of_every_case(drive):
    for row in drive["ended"]:
        assert row["columns"] == ["to_line_m", "jerk_mps3"]
        assert row["to_line_m"][0] == row["line_m"]
        assert row["to_line_m"][-1] == row["scalars"]["stopped_before_m"]
        assert row["jerk_again"]
        assert row["jerk_mps3"][0] is None, "missing is not 0"
        assert max(map(abs, row["jerk_mps3"][1:])) == row["scalars"]["jerk_peak_mps3"]
