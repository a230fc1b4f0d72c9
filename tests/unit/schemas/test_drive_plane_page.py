"""The bytes in docs/drive-plane.md are those of real messages."""

import os
import queue
from pathlib import Path

import msgpack
import numpy as np
import zenoh
from waiting import PATIENCE_S

from schemas import DRIVE_MINOR, SCHEMA_VERSION
from schemas.messages import Command, Commands, Episode, Frame, Ready, Tick
from schemas.sections.perception import GroundTruthPerception
from schemas.wire.codec import decode, encode
from twin.fabric.rig_folder import RigFolder
from twin.fabric.zenoh_bus import open_bus

PAGE = Path(__file__).parents[3] / "docs/drive-plane.md"
HEADING = "## Bytes\n"
ROW = 16


def dump(data):
    """Offset, bytes, and what of them is text."""
    lines = []
    for start in range(0, len(data), ROW):
        row = data[start : start + ROW]
        text = "".join(chr(b) if 32 <= b < 127 else "." for b in row)
        lines.append(f"{start:04x}  {row.hex(' '):<{3 * ROW - 1}}  {text}")
    return "\n".join(lines)


def ready(role, **fields):
    given = {"rig": "7f3a0c", "slots": 1, "minor": DRIVE_MINOR, **fields}
    return Ready(v=SCHEMA_VERSION, role=role, **given)


def frame(values, name="vehicle", encoding="VEHICLE_COLUMNS [S,7] float64", count=()):
    return Frame(
        v=SCHEMA_VERSION,
        type=name,
        seq=7,
        active=[True],
        case=["clear"],
        token=[4294967297],
        tick=[7],
        sim_time_ns=[350_000_000],
        dtype=values.dtype.str,
        shape=list(values.shape),
        encoding=encoding,
        count=list(count),
    )


def episode():
    return Episode(
        v=SCHEMA_VERSION,
        seq=0,
        slot=0,
        token=4294967297,
        case="clear",
        seed=42,
        model="default",
        perception=GroundTruthPerception(),
        camera="front_right",
        width=64,
        height=36,
        hfov_deg=70.0,
        control_period_ns=50_000_000,
    )


def examples():
    """Heading, key, bytes and the Struct of every example."""
    vehicle = np.array([[6.5, 0.1, 0.0, 0.0, 0.3, 0.0, 0.0]], "<f8")
    boxes = np.zeros((1, 32, 7), "<f4")
    box = np.array([[0, 30, 14, 5, 4, 17, 21.5]], "<f4")  # BOX_COLUMNS
    seen = "BOX_COLUMNS [S,B,7] float32"
    picture = np.zeros((1, 36, 64, 3), "|u1")
    tick = Tick(
        v=SCHEMA_VERSION,
        seq=7,
        active=[True],
        token=[4294967297],
        tick=[7],
        sim_time_ns=[350_000_000],
        sensors=["vehicle"],
        episodes=0,
    )
    least = {"v": 1, "role": "stack", "rig": "7f3a0c", "slots": 1, "seen": True}
    command = {"slot": 0, "token": 4294967297, "tick": 7, "throttle": 0.3, "brake": 0.0}
    answer = {"v": 1, "seq": 7, "commands": [command | {"steering_rad": -0.05}]}
    return [
        ("The simulator is ready", "control/simulator", encode(ready("simulator")), Ready),
        ("So is the stack, in as few words as are allowed", "control/stack", pack(least), Ready),
        ("A case begins", "episode", encode(episode()), Episode),
        ("Attachment of a sensor", "sensor/vehicle", encode(frame(vehicle)), Frame),
        ("Its payload, seven float64", "sensor/vehicle", vehicle.tobytes(), None),
        (
            "Attachment of a picture; its payload is 36 rows of 64 pixels, red, green, blue",
            *("sensor/camera", encode(frame(picture, "camera", "rgb8 [S,H,W,3] uint8")), Frame),
        ),
        (
            "Attachment of the boxes, of which one of 32 rows is valid",
            *("sensor/boxes", encode(frame(boxes, "boxes", seen, [1])), Frame),
        ),
        ("The first row of their payload, seven float32", "sensor/boxes", box.tobytes(), None),
        ("The tick", "tick", encode(tick), Tick),
        ("The answer, in as few words as are allowed", "command", pack(answer), Commands),
    ]


def pack(plain):
    return msgpack.packb(plain)


def section():
    text = ""
    for title, key, data, _ in examples():
        text += f"\n### {title}\n\n`drive/7f3a0c/{key}`, {len(data)} bytes\n\n"
        text += f"```\n{dump(data)}\n```\n"
    return text


def test_the_page_shows_the_bytes_of_real_messages():
    head, _, below = PAGE.read_text().partition(HEADING)
    intro, _, _ = below.partition("\n### ")
    wanted = head + HEADING + intro.rstrip("\n") + "\n" + section()
    if os.environ.get("UPDATE_GOLDEN"):
        PAGE.write_text(wanted)
    assert PAGE.read_text() == wanted, "run this test with UPDATE_GOLDEN=1"
    assert f"Version {SCHEMA_VERSION}.{DRIVE_MINOR}." in head


def test_the_configuration_opens_a_session():
    text = PAGE.read_text().partition("```json5\n")[2].partition("```")[0]
    namespace, folder = "twin/7f3a0c", RigFolder()
    simulator = open_bus("peer", listen=[folder.drive], namespace=namespace)
    arrived = queue.SimpleQueue()
    simulator.subscribe("drive/7f3a0c/command", arrived.put)
    example = "unixsock-stream//run/user/1000/twin-5d0c1f2a/drive"
    assert example in text
    config = zenoh.Config.from_json5(text.replace(example, folder.drive))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(
            "drive/7f3a0c/command", congestion_control=zenoh.CongestionControl.BLOCK
        )
        while not publisher.matching_status.matching:
            pass  # it has just connected
        publisher.put(b"hello")
        assert arrived.get(timeout=PATIENCE_S).payload == b"hello"
    simulator.close()
    folder.close()


def test_the_examples_are_valid_messages():
    for _, _, data, type_ in examples():
        if type_ is not None:
            assert decode(data, type_).v == SCHEMA_VERSION


def test_what_later_minor_versions_add_is_ignored():
    plain = msgpack.unpackb(encode(Commands(1, 7, [Command(0, 1, 7, 0.0, 0.0, 0.0)])))
    plain["mood"] = "new"
    plain["commands"][0]["horn"] = True
    assert decode(pack(plain), Commands).commands[0].tick == 7
    assert decode(pack(msgpack.unpackb(encode(episode())) | {"moon": 1}), Episode).slot == 0
