"""The example of docs/kinds.md, installed as a distribution: it runs, is judged again, reported."""

import json
import subprocess
import sys

import pytest
from foreign_distributions import ROOT, of_page

PAGE = (ROOT / "docs/kinds.md").read_text()
CAMPAIGN = """\
campaign: quiet
simulator: warp
camera: {width: 32, height: 18, hz: 10}
render: false
scenario: {type: quiet_ride, rate_max_radps: RATE, duration_s: 1.5, ego_speed_mps: 6}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {weather: [clear]}
"""


@pytest.fixture
def mine(tmp_path):
    """Environment in which the distribution of the page is installed."""
    _, environment = of_page(PAGE, "quiet", tmp_path)
    return environment


def run(command, env, *, codes=(0,)):
    done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in codes, done.stdout + done.stderr
    return done.stdout


DRIVE = """
import sys
from schemas.plan import expand, parse_campaign
from schemas.files.yaml_file import parse_yaml
from schemas.messages import Command
from twin.rig.engine import Engine
campaign, mistakes = parse_campaign(parse_yaml(sys.stdin.read(), "quiet.yaml"))
assert campaign is not None, mistakes
(case,) = expand(campaign)
engine, ended = Engine(case, 1), []
engine.reset(0, case)
while not ended:
    engine.sense()
    ended = engine.step([Command(0, 0, int(engine.tick[0]), 0.1, 0.0, 0.2)])
end = ended[0]
import json
from twin.kpi import verdict
from twin.kpi.judge_record import hit_of, state_of, surroundings_of
from twin.kpi.judge import TableRows
from twin.records.kpi_file import kpi_table
from twin.scenario.families import replay
rows = TableRows(kpi_table(end.table.to_lists()))
again = replay(end.record.scenario, surroundings_of(end.record), rows)
state, hit = state_of(end.record), hit_of(end.record)
print(json.dumps({
    "verdict": end.verdict,
    "again": verdict.judge(rows, state, again, hit).verdict,
    "scalars": end.scalars,
    "scalars_again": verdict.scalars(rows, state, again, hit),
    "dtc": end.table.columns["dtc_m"].valid.any().item(),
}))
"""


@pytest.mark.parametrize(("rate", "verdict"), [("3", "pass"), ("0.01", "sharp_turn")])
def test_the_example_of_the_page_drives_and_is_judged_again(mine, rate, verdict):
    done = subprocess.run(
        [sys.executable, "-c", DRIVE],
        env=mine,
        cwd=ROOT,
        capture_output=True,
        text=True,
        input=CAMPAIGN.replace("RATE", rate),
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["verdict"] == found["again"] == verdict
    assert found["scalars"] == found["scalars_again"]
    assert found["scalars"]["yaw_rate_max_radps"] > 0.1
    assert found["scalars"]["distance_m"] is None
    assert found["dtc"], "its target is the obstacle"


def test_its_keys_are_explained(mine):
    fields = run([sys.executable, "-m", "conductor", "fields", "scenario"], mine)
    assert "rate_max_radps" in fields
    assert "Largest yaw rate that passes" in fields.replace("\n", " ")
