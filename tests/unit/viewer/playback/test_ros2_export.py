"""ROS 2 recordings, read back by rosbags and by mcap-ros2-support."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from ros2_drives import PERIOD_NS, TICKS, command, ego_pose, mover, write_attempt
from ros2_messages import car_tick, episode, plain
from rosbags.rosbag2 import Reader
from typer.testing import CliRunner

from schemas.messages import Command
from twin.base.errors import UsageError
from twin.ros2.commands import read_command, write_plain
from twin.ros2.frames import yaw_of
from twin.ros2.sending import CarTick, TableSender
from twin.ros2.store import type_store
from twin.ros2.tables import load_table
from viewer.cli import app
from viewer.playback.ros2_export import export_ros2

STORE = type_store()


def sent_live(table: str) -> list[tuple[str, int, str, bytes]]:
    """What a bridge sends of the same drive: topic, time, type and bytes."""
    sender = TableSender(load_table(table), episode(), STORE)
    messages = sender.start()
    for tick in range(TICKS):
        car = car_tick(tick)
        messages += sender.tick(CarTick(tick, PERIOD_NS * tick, car.sensors, car.counts))
    return [(e.topic, e.time_ns, e.type_name, STORE.encode(e.message)) for e in messages]


def read_bag(folder) -> list[tuple[str, int, str, bytes]]:
    with Reader(folder) as reader:
        return [(c.topic, time, c.msgtype, bytes(data)) for c, time, data in reader.messages()]


@pytest.mark.parametrize("table", ["plain", "nav2", "autoware"])
def test_a_bag_has_the_bytes_that_a_bridge_sends(tmp_path, table):
    write_attempt(tmp_path, recording=False)
    export_ros2(tmp_path, "clear", None, tmp_path / "bag", table, None)
    read = read_bag(tmp_path / "bag")
    topic = load_table(table).driving().topic
    assert sorted(row for row in read if row[0] != topic) == sorted(sent_live(table))
    answers = [data for name, _, _, data in read if name == topic]
    if table == "plain":
        said = [read_command(STORE, "drivetwin_msgs/msg/DriveCommand", data) for data in answers]
        assert [each.command for each in said] == [as_told(command(tick)) for tick in range(TICKS)]
    else:
        assert answers == []


def as_told(given: Command) -> Command:
    """A command without the bridge's own numbers."""
    return read_command(
        STORE,
        "drivetwin_msgs/msg/DriveCommand",
        STORE.encode(write_plain(STORE, 0, given)),
    ).command


def test_another_library_reads_every_message_by_its_own_schema(tmp_path):
    write_attempt(tmp_path)
    out = tmp_path / "drive.mcap"
    export_ros2(tmp_path, "clear", out, None, "plain", print)
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = list(reader.iter_decoded_messages())
    assert len(found) > 50
    for schema, channel, message, decoded in found:
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        ours = STORE.decode(schema.name, message.data)
        assert plain(decoded) == plain(ours), channel.topic
    qos = {c.topic: yaml.safe_load(c.metadata["offered_qos_profiles"]) for _, c, _, _ in found}
    assert qos["/tf_static"][0]["durability"] == "transient_local"
    assert qos["/clock"][0]["reliability"] == "reliable"


def test_metadata_names_every_topic_with_type_hash_and_count(tmp_path):
    write_attempt(tmp_path, recording=False)
    export_ros2(tmp_path, "clear", None, tmp_path / "bag", "autoware", None)
    told = yaml.safe_load((tmp_path / "bag/metadata.yaml").read_text())
    information = told["rosbag2_bagfile_information"]
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["bag.mcap"]
    assert information["duration"]["nanoseconds"] == PERIOD_NS * (TICKS - 1)
    for row in information["topics_with_message_count"]:
        topic = row["topic_metadata"]
        assert topic["type_description_hash"] == STORE.type_hash(topic["type"])
        assert row["message_count"] == (1 if topic["name"] == "/tf_static" else TICKS)


def test_truth_follows_every_object_by_one_name(tmp_path):
    write_attempt(tmp_path)
    export_ros2(tmp_path, "clear", None, tmp_path / "bag", "plain", print)
    places: dict[str, dict[int, tuple[float, ...]]] = {}
    kinds = {}
    for topic, time, name, data in read_bag(tmp_path / "bag"):
        if topic == "/truth/objects":
            for each in STORE.decode(name, data).detections:
                at, turn = each.bbox.center.position, each.bbox.center.orientation
                yaw = yaw_of((turn.x, turn.y, turn.z, turn.w))
                places.setdefault(each.id, {})[time // PERIOD_NS] = (at.x, at.y, at.z, yaw)
                kinds[each.id] = each.results[0].hypothesis.class_id
    assert kinds == {"object_1": "car", "object_2": "pedestrian"}
    assert list(places["object_1"]) == [0, 1, 2, 3, 4]
    assert list(places["object_2"]) == [2, 3, 4, 5]
    for number, name in enumerate(("object_1", "object_2")):
        for tick, (x, y, z, yaw) in places[name].items():
            row = mover(tick, number)
            assert (x, y, z) == pytest.approx((row[0], row[1], 0.5 * row[6]), abs=1e-4)
            assert abs(yaw) == pytest.approx(row[3], abs=1e-5)


def test_truth_has_the_ego_where_it_was(tmp_path):
    write_attempt(tmp_path)
    export_ros2(tmp_path, "clear", None, tmp_path / "bag", "nav2", print)
    odometry = [
        (time // PERIOD_NS, STORE.decode(name, data))
        for topic, time, name, data in read_bag(tmp_path / "bag")
        if topic == "/truth/odometry"
    ]
    assert [tick for tick, _ in odometry] == list(range(TICKS))
    for tick, message in odometry:
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        x_m, y_m, yaw_rad = ego_pose(tick)
        assert (at.x, at.y, at.z) == pytest.approx((x_m, y_m, 0.25), abs=1e-4)
        assert yaw_of((turn.x, turn.y, turn.z, turn.w)) == pytest.approx(yaw_rad, abs=1e-6)
        assert message.twist.twist.linear.x == 10.0
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")


def test_same_attempt_gives_the_same_bytes(tmp_path):
    write_attempt(tmp_path)
    for name in ("a.mcap", "b.mcap"):
        export_ros2(tmp_path, "clear", tmp_path / name, None, "plain", print)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "b.mcap", "cases"]


def test_what_is_missing_is_said_in_one_line(tmp_path):
    write_attempt(tmp_path, record=False)
    with pytest.raises(UsageError, match=r"no drive\.record.*--record-drive"):
        export_ros2(tmp_path, "clear", None, tmp_path / "bag", "plain", None)
    assert not (tmp_path / "bag").exists()
    whole = tmp_path / "whole"
    attempt = write_attempt(whole)
    with pytest.raises(UsageError, match="it exists; give a folder that does not"):
        export_ros2(whole, "clear", None, whole / "cases", "plain", None)
    record = attempt / "drive.record"
    data = bytearray(record.read_bytes())
    at = data.index(b"vehicle", len(data) // 2)
    data[at : at + 7] = b"\xff" * 7
    record.write_bytes(data)
    with pytest.raises(UsageError, match="damaged"):
        export_ros2(whole, "clear", None, whole / "bag", "plain", None)
    assert not (whole / "bag").exists()


@contextmanager
def files_within(size: int) -> Iterator[None]:
    """No file grows further, as on a full disk [bytes]."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_nothing_stays_of_what_does_not_fit_on_the_disk(tmp_path):
    write_attempt(tmp_path)
    for outs in ((None, tmp_path / "bag"), (tmp_path / "a.mcap", None)):
        with files_within(4096), pytest.raises(UsageError) as caught:
            export_ros2(tmp_path, "clear", *outs, "plain", None)
        assert str(caught.value) == f"{outs[0] or outs[1]}: File too large"
        assert [path.name for path in tmp_path.iterdir()] == ["cases"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "say what to write: --mp4 FILE, --mcap FILE, --rosbag2 FOLDER"),
        (["--mp4", "a.mp4", "--ros2"], "give --mcap FILE as well"),
        (["--mcap", "a.mcap", "--truth"], "give --ros2 or --rosbag2"),
        (["--mcap", "a.mcap", "--ros2", "--table", "ros"], "allowed: autoware, nav2, plain"),
    ],
)
def test_options_that_do_not_fit(tmp_path, words, line):
    write_attempt(tmp_path)
    done = CliRunner().invoke(app, ["export", str(tmp_path), "clear", *words])
    assert isinstance(done.exception, UsageError)
    assert line in str(done.exception)


def test_command_writes_both(tmp_path):
    write_attempt(tmp_path)
    words = ["--mcap", str(tmp_path / "d.mcap"), "--ros2", "--rosbag2", str(tmp_path / "bag")]
    done = CliRunner().invoke(app, ["export", str(tmp_path), "clear", *words, "--truth"])
    assert done.exit_code == 0, done.output
    assert f"{tmp_path / 'bag'}: " in done.output
    assert "messages on" in done.output
    assert len(read_bag(tmp_path / "bag")) > 50
