"""The example of docs/add-a-sensor.md, installed as a distribution: it is checked, sensed, sent."""

import json
import subprocess
import sys

import pytest
from foreign_distributions import ROOT, of_page

PAGE = (ROOT / "docs/add-a-sensor.md").read_text()
CAMPAIGN = """\
campaign: warm
camera: {width: 32, height: 18, hz: 10}
render: false
scenario: {duration_s: 1.5, ego_speed_mps: 6}
sensors: {thermometer: {hz: 10}}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {sensors.thermometer.air_c: [0, 40]}
"""
STACK = """\
from devkit.idle import IdleStack

class Reads(IdleStack):
    def step(self, observation):
        if "thermometer" in observation.sensors:
            print("READS", observation.sensors["thermometer"].tolist(), flush=True)
        return super().step(observation)
"""


@pytest.fixture
def mine(tmp_path):
    """Environment in which the distribution of the page is installed."""
    site, environment = of_page(PAGE, "thermometer", tmp_path)
    (site / "reading_stack.py").write_text(STACK)
    return environment


def run(env, *words, codes=(0,)):
    command = [sys.executable, "-m", *words]
    done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in codes, done.stdout + done.stderr
    return done.stdout


DRIVE = """
import json, sys
from schemas.files.yaml_file import parse_yaml
from schemas.identity import rig_key
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from twin.rig.engine import Engine
campaign, mistakes = parse_campaign(parse_yaml(sys.stdin.read(), "warm.yaml"))
assert campaign is not None, mistakes
cases = expand(campaign)
assert len({rig_key(case) for case in cases}) == 1
engine, seen = Engine(cases[0], 2), []
for slot, case in enumerate(cases):
    engine.reset(slot, case)
for tick in range(20):
    sensed = engine.sense()
    if "thermometer" in sensed:
        seen.append(sensed["thermometer"].values[:, 0].tolist())
    engine.step([Command(slot, 0, tick, 0.0, 0.0, 0.0) for slot in range(2)])
print(json.dumps(seen))
"""


def test_cases_of_two_temperatures_share_a_rig_and_read_their_own(mine):
    done = subprocess.run(
        [sys.executable, "-c", DRIVE],
        env=mine,
        cwd=ROOT,
        capture_output=True,
        text=True,
        input=CAMPAIGN,
    )
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout.splitlines()[-1])
    assert len(seen) == 10, "every other tick"
    assert seen[0] == [20.0, 20.0]
    cold, warm = zip(*seen, strict=True)
    assert list(cold) == sorted(cold, reverse=True)
    assert list(warm) == sorted(warm)
    assert cold[-1] < 19.0 < 21.0 < warm[-1]


def test_a_run_hands_it_to_the_stack_and_without_it_the_campaign_is_refused(mine, tmp_path):
    path = tmp_path / "warm.yaml"
    path.write_text(CAMPAIGN.replace("devkit.idle:IdleStack", "reading_stack:Reads"))
    out = tmp_path / "run"
    words = ("conductor", "run", str(path), "--workers", "1", "--slots", "2", "--out", str(out))
    run(mine, *words, codes=(1,))  # a stack that stands still passes nothing
    logs = [log.read_text() for log in sorted(out.glob("cases/*/attempt-1/log.txt"))]
    assert len(logs) == 2
    assert all("READS [[20.0], [20.0]]" in log for log in logs), logs
    lines = run(mine, "conductor", "fields", "sensors.thermometer")
    assert "Temperature of the air" in lines.replace("\n", " ")
    bare = {**mine, "PYTHONPATH": str(ROOT)}
    assert run(bare, "conductor", "validate", str(path), codes=(2,)) == ""


def test_devkit_check_shows_it_to_a_stack(mine, tmp_path):
    path = tmp_path / "warm.yaml"
    path.write_text(CAMPAIGN)
    assert run(mine, "devkit", "check", str(path), "--ticks", "20")
