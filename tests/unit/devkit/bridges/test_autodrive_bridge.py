"""The AutoDRIVE bridge with real scripts: every way in which one may fail has its reason."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from free_ports import reserved_port
from msgspec import structs
from waiting import PATIENCE_S

from devkit.bridges.autodrive import AutodriveBridge
from devkit.bridges.autodrive.bridge import POINT
from devkit.bridges.autodrive.fields import (
    FieldError,
    acceleration,
    command,
    euler,
    telemetry,
)
from devkit.hosting.foreign import ForeignProcess
from devkit.hosting.foreign_place import placed
from devkit.stack import Observation
from schemas.kinds.bridge import lacking_bridges
from schemas.messages import CameraSite, Episode, Pose
from schemas.plan import expand, parse_campaign
from schemas.sections.foreign import Foreign
from schemas.sections.perception import GroundTruthPerception
from twin.base.errors import InfrastructureError, UnfinishedError
from twin.fabric.port_turn import TURN_VARIABLE, await_turn, take_turn, turn_at

sys.path.insert(0, str(Path(__file__).parents[3] / "e2e"))

from autodrive_environments import SCRIPT, missing_today

needs_scripts = pytest.mark.skipif(bool(missing_today()), reason=missing_today() or "there")


def site(name, message):
    lens = {"width": 8, "height": 6, "hz": 10, "hfov_deg": 70.0}
    return CameraSite(name, message, **lens, position_m=[], rotation_deg=[], lens=None)


EPISODE = Episode(
    v=1,
    seq=0,
    slot=0,
    token=7,
    case="c",
    seed=1,
    model="m",
    perception=GroundTruthPerception(),
    camera="front_right",
    width=8,
    height=6,
    hfov_deg=70.0,
    control_period_ns=50_000_000,
    cameras=[site("front_right", "camera"), site("front_left", "camera.front_left")],
)


def observation(tick, *, pictures=True):
    sensors = {
        "vehicle": np.array([[3.0, 0.0, 0.0, 0.1, 0.2, 0.0, 0.0]]),
        "encoders": np.array([[1, 2, 44, -44]]),
        "imu": np.array([[0.1, 0.0, 9.8, 0.0, 0.0, 0.01]]),
        "pose": np.array([[1.0 * tick, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]]),
    }
    if pictures:
        image = np.full((1, 6, 8, 3), 90, np.uint8)
        sensors |= {"camera": image, "camera.front_left": image}
    each = {"token": np.array([7]), "tick": np.array([tick]), "sim_time_ns": np.array([0])}
    return Observation(seq=tick, active=np.array([True]), sensors=sensors, counts={}, **each)


@pytest.fixture
def port():
    """One that no other test of this machine is given."""
    with reserved_port() as found:
        yield found


def drive(mode, ticks, **parameters):
    """Commands of a script, or the reason why there are none; and it is gone afterwards."""
    with reserved_port() as port:
        script = ForeignProcess([sys.executable, str(SCRIPT), mode, str(port)], {})
        bridge = AutodriveBridge(1, port=port, **{"answer_s": PATIENCE_S, **parameters})
        try:
            bridge.attach(script)
            bridge.reset(0, EPISODE)
            return [bridge.step(observation(t, pictures=t % 2 == 0))[0] for t in range(ticks)]
        finally:
            script.end()
            bridge.close()


@needs_scripts
def test_one_exchange_per_tick_and_pictures_between_their_frames():
    commands = drive("drive", 9)
    assert [c.tick for c in commands] == list(range(9))
    assert [c.throttle for c in commands] == [0.3] * 7 + [0.0] * 2  # stops after six metres
    assert commands[-1].brake == 1.0
    assert commands[-1].aeb
    assert commands[-1].lights.indicators == 3
    assert commands[0].lights.parking


@needs_scripts
@pytest.mark.parametrize(
    ("mode", "reason"),
    [
        ("absent", "nobody listens after 3 s"),
        ("http", "what listens there is no Socket.IO"),
        ("slow", "no answer to 'Bridge' within 2 s, at tick 3"),
        ("exit", "ended: exit code 5"),
        ("garbage", "answered str instead of the fields of 'Bridge', at tick 3"),
        ("missing", "answered without the field 'V1 Throttle', at tick 3"),
        ("word", "V1 Steering is 'left', a number is needed, at tick 3"),
        ("disconnect", "the script closed the connection|connection lost"),
    ],
)
def test_every_failure_of_a_script_has_its_reason(mode, reason):
    short = {"absent": {"start_s": 3.0}, "slow": {"answer_s": 2.0}}.get(mode, {})
    with pytest.raises(InfrastructureError, match=reason) as raised:
        drive(mode, 6, **short)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("packets", "reason"),
    [
        (['0{"pingInterval": 25000, "maxPayload": 1}', "425"], "no event of Socket.IO"),
        (['0{"pingInterval": 25000}'], "connection lost"),
    ],
)
def test_a_server_that_says_nonsense_or_leaves_has_its_reason(packets, reason):
    server = pytest.importorskip("websockets.sync.server")
    from devkit.bridges.autodrive.socketio import SocketError, connect

    def receive_all(client):
        while True:
            client.receive(0.1)

    def talk(connection):
        for packet in packets:
            connection.send(packet)
        if "425" in packets:
            connection.recv()

    with server.serve(talk, "127.0.0.1", 0) as serving:
        threading.Thread(target=serving.serve_forever, daemon=True).start()
        port = serving.socket.getsockname()[1]
        with pytest.raises(SocketError, match=reason):
            receive_all(connect("127.0.0.1", port, 5.0, lambda: None))
        serving.shutdown()


def test_a_script_does_not_ignore_the_signals_that_we_ignore(tmp_path):
    said = tmp_path / "said"
    ignored = f"grep SigIgn /proc/self/status > {said}"
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        script = ForeignProcess(["sh", "-c", ignored], {})
        script.start()
        assert script.wait() == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert not int(said.read_text().split()[1], 16) & 1 << (signal.SIGTERM - 1)


@needs_scripts
def test_a_script_that_answers_at_once_is_counted_as_well(monkeypatch, port):
    script = ForeignProcess([sys.executable, str(SCRIPT), "drive", str(port)], {})
    bridge = AutodriveBridge(1, port=port)
    try:
        bridge.attach(script)
        bridge.reset(0, EPISODE)
        monkeypatch.setattr("devkit.hosting.foreign.PROCESSES_MAX", 0)

        def drive_on():
            for tick in range(10_000):
                bridge.step(observation(tick, pictures=tick == 0))

        with pytest.raises(InfrastructureError, match="runs more than 0 processes"):
            drive_on()
    finally:
        script.end()
        bridge.close()


def test_a_script_ends_with_what_left_its_session(tmp_path):
    """Or it would hold the port when the script is started for the next case."""
    told, holder = tmp_path / "told", tmp_path / "holder.py"
    os.mkfifo(told)
    holder.write_text(
        "import socket\nserver = socket.create_server(('127.0.0.1', 0))\n"
        "print(server.getsockname()[1], flush=True)\nserver.accept()\n"
    )
    other = subprocess.Popen(["sleep", "600"])
    try:
        words = f"setsid {sys.executable} {holder} > {told} & exec sleep 600"
        script = ForeignProcess(["sh", "-c", words], {})
        script.start()
        with told.open() as lines:
            port = int(lines.readline())
        script.end()
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port))
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()


def test_a_command_that_does_not_exist_is_named():
    with pytest.raises(InfrastructureError, match="'/no/such/script': No such file"):
        ForeignProcess(["/no/such/script"], {}).start()


def test_two_rigs_of_a_host_do_not_meet_at_a_port(port):
    pytest.importorskip("websockets")
    first, second = AutodriveBridge(1, port=port), AutodriveBridge(1, port=port)
    first.attach(None)
    with pytest.raises(UnfinishedError, match=f"port {port} is used by another rig"):
        second.attach(None)
    first.close()
    second.attach(None)
    second.close()


def test_parameters_that_cannot_be_used_are_named():
    pytest.importorskip("websockets")
    with pytest.raises(ValueError, match="prot"):
        AutodriveBridge(1, prot=4567)
    with pytest.raises(ValueError, match="given 2 slots: the bridge drives one car"):
        AutodriveBridge(2)


def test_fields_hold_what_the_published_simulator_sends():
    rows = {name: rows[0] for name, rows in observation(3).sensors.items() if "cam" not in name}
    points = np.zeros(2, POINT).tobytes()
    fields = telemetry(rows, {"front_left": b"a", "front_right": b"b"}, points, 44.0)
    assert fields["V1 Encoder Ticks"] == "44 -44"
    assert fields["V1 Encoder Angles"] == "6.283185307179586 -6.283185307179586"
    assert fields["V1 Position"] == "3.0 2.0 0.0"
    assert fields["V1 Orientation Quaternion"] == "0.0 0.0 0.0 1.0"
    assert fields["V1 Steering"] == "0.1"
    assert len(points) == 48
    assert all(isinstance(value, str) for value in fields.values())


def test_linear_acceleration_is_zero_at_rest_however_the_car_stands():
    """An IMU at rest measures what holds it up; a velocity that does not change has no rate."""
    pitch = 0.1  # nose down, about the axis to the left
    level, tilted = [0.0, 0.0, 0.0, 1.0], [0.0, np.sin(pitch / 2), 0.0, np.cos(pitch / 2)]
    g = 9.80665
    at_rest = {"accel_x_mps2": 0.0, "accel_y_mps2": 0.0, "accel_z_mps2": g}
    assert acceleration(at_rest, level) == [0.0, 0.0, 0.0]
    downhill = {
        "accel_x_mps2": -g * np.sin(pitch),
        "accel_y_mps2": 0.0,
        "accel_z_mps2": g * np.cos(pitch),
    }
    assert acceleration(downhill, tilted) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    braking = {**at_rest, "accel_x_mps2": -6.0}
    assert acceleration(braking, level) == pytest.approx([-6.0, 0.0, 0.0])


def test_euler_angles_go_from_zero_to_a_full_turn():
    def about(axis, angle):
        quaternion = [0.0, 0.0, 0.0, np.cos(angle / 2)]
        quaternion[axis] = np.sin(angle / 2)
        return euler(quaternion)[axis]

    turn = 2 * np.pi
    for axis in range(3):
        assert about(axis, -0.1) == pytest.approx(turn - 0.1)
        assert about(axis, 0.1) == pytest.approx(0.1)
        assert 0.0 <= about(axis, -1e-17) < turn
    assert about(2, -3.0) == pytest.approx(turn - 3.0)
    assert about(2, np.radians(-0.004)) == 0.0
    assert about(2, np.radians(-0.006)) == pytest.approx(turn - np.radians(0.006))


def test_a_negative_throttle_is_the_reverse_gear():
    found = command({"V1 Throttle": "-0.4", "V1 Steering": "0"}, 0, 7, 3, 0.6, 1.0)
    assert (found.throttle, found.reverse) == (0.4, True)
    rows = {name: rows[0] for name, rows in observation(3).sensors.items() if "cam" not in name}
    pictures = {"front_left": b"a", "front_right": b"b"}
    assert telemetry(rows, pictures, b"", 44.0, reverse=True)["V1 Throttle"] == "-0.2"


def test_encoder_angles_follow_the_encoders_of_the_case():
    campaign, mistakes = parse_campaign(
        {
            "campaign": "c",
            "sensors": {"encoders": {"ppr": 100, "cgr": 2.5}},
            "matrix": {"weather": ["clear"]},
        }
    )
    assert not mistakes
    given = {"seq": 0, "slot": 0, "token": 1, "cameras": [], "lidars": []}
    assert Episode.of(expand(campaign)[0], **given).ticks_per_rev == 250.0


def test_a_published_script_runs_in_the_folder_in_which_it_lies(tmp_path):
    script = tmp_path / "devkit" / "opencav_aeb.py"
    script.parent.mkdir()
    script.write_text("")
    python = ["env", "-u", "PYTHONPATH", sys.executable]
    bridged = Foreign(command=[*python, str(script), "1"], bridge="autodrive")
    assert placed(bridged, "rig") == ([*python, str(script), "1"], str(script.parent))
    assert placed(structs.replace(bridged, bridge="none"), "rig")[1] is None
    assert placed(structs.replace(bridged, command=["python", "here.py"]), "rig")[1] is None


def test_a_missing_package_of_the_bridge_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "websockets", None)
    line = "no package websockets: pip install 'drivetwin[autodrive]'"
    assert lacking_bridges() == {"autodrive": line}
    with pytest.raises(InfrastructureError, match="no package websockets: pip install"):
        AutodriveBridge(1)


def test_who_waits_for_a_port_hears_of_its_end(port):
    turn = turn_at(port)
    assert turn is not None
    assert turn_at(port) is None
    over = threading.Event()
    waiting = threading.Thread(target=lambda: (await_turn(port), over.set()))
    waiting.start()
    assert not over.wait(0.05)
    turn.close()
    assert over.wait(PATIENCE_S)
    waiting.join()
    await_turn(port)  # nobody has it
    again = turn_at(port)
    assert again is not None
    again.close()


def test_a_host_takes_no_turn_that_its_worker_has_taken(monkeypatch, port):
    monkeypatch.setenv(TURN_VARIABLE, str(port))
    with turn_at(port):
        assert take_turn(port) is None
        with pytest.raises(UnfinishedError, match=f"port {port}"):
            take_turn(port)


def test_euler_angles_turn_left_about_the_vertical():
    half = 0.5**0.5
    assert euler([0.0, 0.0, half, half]) == pytest.approx([0.0, 0.0, np.pi / 2])
    assert euler([half, 0.0, 0.0, half]) == pytest.approx([np.pi / 2, 0.0, 0.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"V1 Steering": "1.2"}, "V1 Steering is 1.2, allowed: -1 to 1"),
        ({"V1 Throttle": "-1.2"}, "V1 Throttle is -1.2, allowed: -1 to 1"),
        ({"V1 Headlights": "12"}, "V1 Headlights is 12, allowed: 0 to 11"),
        ({"V1 Indicators": "1.5"}, "V1 Indicators is 1.5, allowed: 0 to 3"),
        ({"V1 CoSim": "1"}, "V1 CoSim is set"),
        ({"V1 Brake": None}, "V1 Brake is 'None', a number is needed"),
        ({"V1 Throttle": 10**400}, "V1 Throttle is '1000"),
    ],
)
def test_fields_out_of_range_are_refused(change, words):
    answer = {"V1 Throttle": "0.2", "V1 Steering": "0.5", **change}
    with pytest.raises(FieldError, match=re.escape(words)):
        command(answer, 0, 7, 3, 0.6, 1.0)


def test_steering_is_a_share_of_the_largest_angle():
    found = command({"V1 Throttle": "0.2", "V1 Steering": "-0.5"}, 0, 7, 3, 0.6, 1.0)
    assert found.steering_rad == -0.3
    assert (found.slot, found.token, found.tick, found.handbrake) == (0, 7, 3, 0.0)


def test_a_pose_needs_no_pedals_and_all_of_its_numbers():
    names = ("PosX", "PosY", "PosZ", "RotX", "RotY", "RotZ", "RotW")
    answer = {f"V1 {name}": str(number) for number, name in enumerate(names)}
    found = command({"V1 CoSim": "1", **answer}, 0, 7, 3, 0.6, 1.0, cosim=True)
    assert found.pose == Pose(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert (found.throttle, found.steering_rad) == (0.0, 0.0)
    pedals = {"V1 Throttle": "0.2", "V1 Steering": "0.5"}
    assert (
        command({"V1 CoSim": "0", **answer, **pedals}, 0, 7, 3, 0.6, 1.0, cosim=True).pose is None
    )
    del answer["V1 RotY"]
    with pytest.raises(FieldError, match="without the field 'V1 RotY'"):
        command({"V1 CoSim": "1", **answer}, 0, 7, 3, 0.6, 1.0, cosim=True)
