"""Nodes that a stranger's package puts on rmw_zenoh's wire drive cases, through the bridge."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as parquet
import pytest
from foreign_campaigns import campaign
from processes import outcomes, wait_for
from ros2_interfaces import write_interfaces
from waiting import PATIENCE_S

from twin.sandbox.possible import why_not

NODE = Path(__file__).with_name("ros2_node.py")
TABLE = """
table: drive
sensors:
  - {topic: /clock, source: clock}
commands:
  - {topic: /drive, type: TYPE}
"""

DRIVE_PLANE = '''
"""What the node ros2_node.py asks for, behind the drive plane."""

from devkit.bridges.ros2.controllers import MotionControl
from devkit.bridges.ros2.driving import AskedTick, RosDriver
from devkit.stack import Stack
from schemas.messages import VEHICLE_COLUMNS
from twin.ros2.commands import AckermannDemand

SPEED = VEHICLE_COLUMNS.index("speed_mps")


class Ackermann(Stack):
    def reset(self, slot, episode):
        period_s = episode.control_period_ns * 1e-9
        self.driver = RosDriver(MotionControl(), period_s, 1.0)

    def step(self, observation):
        time_ns = int(observation.sim_time_ns[0])
        speed = 5.0 if time_ns < 10**9 else 0.0
        asked = AckermannDemand(time_ns, 0.0, None, speed, None, None)
        token, tick = int(observation.token[0]), int(observation.tick[0])
        now = AskedTick(0, token, tick, float(observation.sensors["vehicle"][0, SPEED]))
        return [self.driver.command("/drive", {"/drive": asked}, now)]
'''


@pytest.fixture(scope="module")
def interfaces(tmp_path_factory):
    return write_interfaces(tmp_path_factory.mktemp("interfaces"))


def driven(interfaces, *words, **autonomy):
    """The section ``autonomy`` of a campaign whose node is run with ``words``."""
    command = [sys.executable, str(NODE), str(interfaces), *words]
    return {"bridge": "ros2", "command": command, "files": [str(interfaces)], **autonomy}


def run(marked, folder, name, autonomy, codes=(0, 1), **sections):
    path = campaign(folder, name, autonomy, **sections)
    out = folder / f"run-{name}"
    words = ("conductor", "run", str(path), "--workers", "1", "--out", str(out))
    done = marked.run(*words, "--output", "json")
    assert done.returncode in codes, done.stderr
    return out, json.loads(done.stdout)["fingerprint"], done.stderr


def test_a_stack_behind_ros_has_the_bytes_that_it_has_on_the_drive_plane(
    marked, interfaces, tmp_path
):
    """With true boxes, and with a network that looks at pictures which came as sensor_msgs/Image:
    nothing is lost on the way."""
    sections = {
        "camera": {"width": 160, "height": 96, "hz": 10},
        "scenario": {"ego_start_m": 20, "ego_speed_mps": 6, "duration_s": 3, "standstill_s": 0.5},
        "matrix": {"model": ["truth", "network"]},
    }
    perception = {
        "truth": {"type": "ground_truth"},
        "network": {"type": "network", "model": "yolov2-tiny-w25", "confidence_min": 0.2},
    }
    stack = "devkit.aeb:AebStack"
    plane = {"stack": stack, "slots": 1, "perception": perception}
    _, expected, _ = run(marked, tmp_path, "plane", plane, **sections)
    ros = driven(interfaces, stack, perception=perception)
    out, found, _ = run(marked, tmp_path, "ros", ros, **sections)
    assert all(each["outcome"] == "verdict" for each in outcomes(out).values())
    assert found == expected


def test_a_controller_behind_ros_has_the_bytes_that_it_has_on_the_drive_plane(
    marked, interfaces, tmp_path, monkeypatch
):
    """Ackermann by stamp without a sandbox, where the node comes by TLS; Twist by steps."""
    (tmp_path / "plane_stack.py").write_text(DRIVE_PLANE)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    plane = {"stack": "plane_stack:Ackermann", "slots": 1}
    _, expected, _ = run(marked, tmp_path, "plane", plane)
    for kind, name, more in (
        ("ackermann", "ackermann_msgs/msg/AckermannDriveStamped", {"sandbox": "off"}),
        ("twist", "geometry_msgs/msg/Twist", {}),
    ):
        table = tmp_path / f"{kind}.yaml"
        table.write_text(TABLE.replace("TYPE", name))
        parameters = {"table": str(table), "answer": "step" if kind == "twist" else "stamp"}
        autonomy = driven(interfaces, kind, parameters=parameters, **more)
        run_name = f"{kind}-{more.get('sandbox', 'default')}"
        out, found, _ = run(marked, tmp_path, run_name, autonomy)
        assert found == expected, run_name
        (case,) = outcomes(out).values()
        assert case["outcome"] == "verdict"


def test_the_node_of_the_page_drives(marked, interfaces, tmp_path):
    """Its own lines, over a stand-in for rclpy: it holds 5 m/s until a picture's middle is dark."""
    example = Path(__file__).parents[2] / "docs/examples/ros2_node.py"
    assert len(example.read_text().splitlines()) <= 60
    table = tmp_path / "table.yaml"
    camera = '  - {topic: "/camera/{name}", source: camera}\n'
    text = TABLE.replace("TYPE", "ackermann_msgs/msg/AckermannDriveStamped")
    table.write_text(text.replace("commands:", f"{camera}commands:"))
    names = Path(__file__).with_name("rclpy_names")
    command = ["env", f"PYTHONPATH={names}", sys.executable, str(example), str(interfaces)]
    out, _, _ = run(
        *(marked, tmp_path, "page"),
        {
            "bridge": "ros2",
            "command": command,
            "files": [str(interfaces), str(names)],
            "parameters": {"table": str(table)},
        },
        matrix={"time_of_day": ["12:00", "23:30"]},
    )
    speeds = {}
    for kpi in out.glob("cases/*/attempt-1/kpi.parquet"):
        speeds[kpi.parents[1].name] = parquet.read_table(kpi)["speed_mps"].to_pylist()
    day, night = (next(v for k, v in speeds.items() if t in k) for t in ("1200", "2330"))
    assert day[-1] == pytest.approx(5.0, abs=0.3)
    assert night[-1] < 1.0


FAULTS = {
    "nan": "command throttle is nan, allowed: 0 to 1, at tick 3",
    "future": "has the stamp 5.150000000 s, but /clock is 0.150000000 s",
    "second": "2 publishers command on /drivetwin/command: /driver, /other; one may",
    "garbage": "drivetwin_msgs/msg/DriveCommand: no message of this type",
    "huge": "a message of 2097152 bytes on /drivetwin/command, allowed: 1048576",
    "lengths": "drivetwin_msgs/msg/DriveCommand: no message of this type",
    "names": "its attachment has the names of rmw_zenoh before 0.2.4",
    "bare": "its attachment has 0 bytes, expected 33",
    "die": "ended: exit code 7",
    "twice": "",
}
"""What a node does at tick 3 -> the reason of its case; none: the case has its verdict."""


def test_what_a_node_does_wrong_is_said_in_one_line(marked, interfaces, tmp_path):
    autonomy = driven(interfaces, "gap", ",".join(FAULTS))
    matrix = {"repeat": list(range(len(FAULTS)))}
    out, _, said = run(marked, tmp_path, "faults", autonomy, matrix=matrix)
    found = outcomes(out)
    for number, (mode, reason) in enumerate(FAULTS.items()):
        case = found[f"repeat_{number}"]
        if not reason:
            assert case["outcome"] == "verdict", case
            (log,) = (out / f"cases/repeat_{number}").glob("attempt-*/log.txt")
            assert (
                "left out: a command on /drivetwin/command with the stamp 0.15" in log.read_text()
            )
            continue
        assert (case["outcome"], case["attempts"]) == ("failed", 1), (mode, case)
        assert reason in case["reasons"][0], mode
        assert "\n" not in case["reasons"][0]
    assert "Traceback" not in said


def test_a_command_of_another_type_is_told_by_name(marked, interfaces, tmp_path):
    autonomy = driven(interfaces, "gap", "type", parameters={"start_s": PATIENCE_S})
    out, _, _ = run(marked, tmp_path, "type", autonomy)
    (case,) = outcomes(out).values()
    assert (case["outcome"], case["attempts"]) == ("failed", 1)
    assert (
        "node /driver publishes /drivetwin/command as std_msgs/msg/String, but it is "
        "drivetwin_msgs/msg/DriveCommand: no message passes"
    ) in case["reasons"][0]


def test_a_node_that_somebody_else_starts_drives_with_the_rigs_key(
    marked, interfaces, tmp_path, monkeypatch
):
    """In real time, too: the newest command counts, and the results say that they do not repeat."""
    home = tmp_path / "home"
    home.mkdir(mode=0o700)
    monkeypatch.setenv("DRIVETWIN_HOME", str(home))
    parameters = {"keys": "mine", "answer": "newest"}
    autonomy = {"bridge": "ros2", "sandbox": "off", "parameters": parameters}
    path = campaign(tmp_path, "outside", autonomy, clock="realtime")
    out, settings = tmp_path / "run", home / "ros2/mine/node.env"
    child = marked.start("conductor", "run", str(path), "--out", str(out))
    try:
        wait_for(lambda: settings.exists() or child.poll() is not None, "settings for nodes")
        words = f"source {settings} && exec {sys.executable} {NODE} {interfaces} gap"
        with (tmp_path / "node.log").open("w") as log:
            node = subprocess.Popen(["bash", "-c", words], stdout=log, stderr=log)
        try:
            _, said = child.communicate(timeout=PATIENCE_S)
        finally:
            node.kill()
            node.wait()
    finally:
        child.kill()
        child.wait()
    assert child.returncode in (0, 1), said
    (case,) = outcomes(out).values()
    assert case["outcome"] == "verdict"
    assert "realtime" in case["reasons"][-1]


@pytest.mark.skipif(bool(why_not()), reason=why_not() or "there is a sandbox")
def test_a_rig_in_a_sandbox_meets_its_nodes_where_nobody_else_can(marked, interfaces, tmp_path):
    """The port of rmw_zenoh's router, in a network of the rig's own: two rigs have it at once."""
    words = (
        "print(open('/proc/net/tcp').read()); import os; print(os.environ['ZENOH_CONFIG_OVERRIDE'])"
    )
    node = tmp_path / "node.py"
    node.write_text(f"{words}\nimport runpy, sys\nrunpy.run_path({str(NODE)!r})\n")
    command = [sys.executable, str(node), str(interfaces), "gap"]
    files = [str(interfaces), str(NODE)]
    autonomy = {"bridge": "ros2", "command": command, "files": files}
    path = campaign(tmp_path, "own", autonomy, matrix={"repeat": [0, 1]})
    out = tmp_path / "run"
    done = marked.run("conductor", "run", str(path), "--workers", "2", "--out", str(out))
    assert done.returncode == 0, done.stderr
    told = [log.read_text() for log in out.glob("cases/*/attempt-*/log.txt")]
    told = [text for text in told if "\nverdict:" in text]  # a second attempt may be called off
    assert len(told) == 2
    for text in told:
        assert 'connect/endpoints=["tcp/127.0.0.1:7447"]' in text
        assert ":1D17 00000000:0000 0A" in text, "it listens on port 7447 there"
    assert ":1D17 " not in Path("/proc/net/tcp").read_text(), "and not here"
