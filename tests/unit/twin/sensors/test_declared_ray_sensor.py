"""A ray sensor of another distribution in an engine: rows of variable length, shared."""

import json
import subprocess
import sys

import numpy as np
import pytest
from plugin_site import ROOT, install_example

CAMPAIGN = """\
campaign: sonar
control_hz: 20
camera: {width: 32, height: 18, hz: 10}
render: false
scenario: {duration_s: 2, ego_speed_mps: 15}
sensors: {sonar: {hz: 10}}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {sensors.sonar.range_m: [1, 500]}
"""

DRIVE = """
import json, sys
from types import SimpleNamespace
import numpy as np
from schemas.kinds.sensor import sensor_kinds
from schemas.files.yaml_file import parse_yaml
from schemas.identity import rig_key
from schemas.messages import Command
from schemas.plan import expand, parse_campaign
from schemas.wire.topics import sensor_topic
from devkit.checking.frames import CheckDrive, sense
from twin.rig.engine import Engine
from twin.sensors.exteroceptive import frame_channels
from twin.sensors.data import SensorData
from twin.sensors.declared import DeclaredRay
campaign, mistakes = parse_campaign(parse_yaml(sys.stdin.read(), "sonar.yaml"))
assert campaign is not None, mistakes
cases = expand(campaign)

def readings(cases):
    channels = {c.name: c for c in frame_channels(cases[0], len(cases))}
    buffers = {name: np.zeros(c.shape, c.dtype) for name, c in channels.items()}
    engine = Engine(cases[0], len(cases), buffers=buffers)
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    found = []
    for _ in range(5):
        sensed = engine.sense()
        if "sonar" in sensed:
            data = sensed["sonar"]
            assert data.values is buffers["sonar"]
            found.append([data.values[s, : data.count[s]].tolist() for s in range(len(cases))])
        engine.step([Command(s, 0, int(engine.tick[s]), 0.0, 0.0, 0.0) for s in range(len(cases))])
    return found

class Says:
    needs_truth = False

    def __init__(self, data):
        self.data = data

    def read(self):
        return self.data

def refusal(**data):
    mount = SimpleNamespace(case=cases[0], geometry=SimpleNamespace(slots=2), buffers={})
    ray = DeclaredRay(sensor_kinds().find("sonar"), mount, 10, Says(data))
    try:
        ray.read()["sonar"].values
    except ValueError as error:
        return str(error)

full, two = np.zeros((2, 32, 2), np.float32), np.array([0, 33], np.int32)
made, count = sense(cases[0], [CheckDrive("a", 1, 60.0, 10.0), None], 0)["sonar"]
print(json.dumps({
    "rigs": len({rig_key(case) for case in cases}),
    "range_m": [case.variation.sensors.sonar.range_m for case in cases],
    "together": readings(cases),
    "alone": [readings([case]) for case in cases],
    "topic": sensor_topic("sonar").type,
    "checked": [list(made.shape), str(made.dtype), count],
    "refused": [
        refusal(echo=SensorData(full, two)),
        refusal(sonar=SensorData(full[:, :3], two)),
        refusal(sonar=SensorData(full, two)),
        refusal(sonar=SensorData(full)),
        refusal(sonar=SensorData(full.astype(float), two * 0)),
    ],
}))
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """What two slots read."""
    _, env = install_example(tmp_path_factory.mktemp("sonar"))
    done = subprocess.run(
        [sys.executable, "-c", DRIVE],
        env=env,
        cwd=ROOT,
        capture_output=True,
        text=True,
        input=CAMPAIGN,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_slots_of_a_rig_read_rows_of_other_lengths(drive):
    assert drive["rigs"] == 1
    assert sorted(drive["range_m"]) == [1.0, 500.0]
    near, far = (drive["range_m"].index(range_m) for range_m in (1.0, 500.0))
    assert len(drive["together"]) == 3, "10 Hz of 20"
    for slots in drive["together"]:
        assert slots[near] == []
        assert slots[far]
    nearest = np.array([slots[far][0][0] for slots in drive["together"]])
    moved_m = np.abs(np.diff(nearest))
    assert (moved_m > 0).all()
    assert (moved_m <= 15.0 * 0.1 + 1e-3).all(), "no faster than the ego, between two readings"


def test_a_reading_does_not_depend_on_the_slot(drive):
    for slot, alone in enumerate(drive["alone"]):
        assert [slots[slot] for slots in drive["together"]] == [slots[0] for slots in alone]


def test_topic_and_made_up_drive_follow_from_the_declaration(drive):
    assert drive["topic"] == "SONAR_COLUMNS [S,32,2] float32"
    assert drive["checked"] == [[2, 32, 2], "float32", [1, 0]]


def test_a_reading_that_is_not_as_declared_is_refused(drive):
    assert drive["refused"] == [
        "sensor 'sonar' reads ['echo']; declared: 'sonar' alone",
        "sensor 'sonar' reads (2, 3, 2); declared: (2, 32, 2)",
        "sensor 'sonar' counts [0, 33] valid rows; allowed: 0 to 32 in each of 2 slots",
        "sensor 'sonar' counts [] valid rows; allowed: 0 to 32 in each of 2 slots",
        "sensor 'sonar' reads float64; declared: float32",
    ]
