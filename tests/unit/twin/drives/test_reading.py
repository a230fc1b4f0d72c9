"""Recordings as others make them become arrays in one frame."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest
from ros2_recordings import (
    MAKE,
    PERIOD_NS,
    START_NS,
    STORE,
    ahead,
    circle_rows,
    odometry,
    tracked,
    transform,
    turning_place,
    write_bag,
)
from rosbags.rosbag2 import StoragePlugin

from twin.base.errors import UsageError
from twin.drives.apart import drive_apart
from twin.drives.drive import DriveQuestion, drive_mistake
from twin.drives.reading import read_drive
from twin.world.apart.checks import pack, unpack


def read(folder, **question):
    import msgspec

    drive = read_drive(folder / "metadata.yaml", msgspec.json.encode(DriveQuestion(**question)))
    assert drive_mistake(drive) == ""
    return drive


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_objects_in_the_egos_axes_are_placed_by_its_odometry(tmp_path, storage):
    drive = read(write_bag(tmp_path / "bag", circle_rows(), storage))
    assert (drive.ego_source, drive.objects_source, drive.frame) == ("/odom", "/tracks", "map")
    assert len(drive.ego) == 40
    for time_s, x, y, z, heading in drive.ego:
        assert (x, y, heading) == pytest.approx(turning_place(time_s), abs=1e-9)
        assert z == 12.5
    (lead,) = drive.objects
    assert lead.kind == "car"
    assert lead.size_m.tolist() == pytest.approx([4.4, 1.8, 1.4])
    for time_s, x, y, z, heading in lead.poses:
        ex, ey, turn = turning_place(time_s)
        assert x == pytest.approx(ex + 20.0 * math.cos(turn) - math.sin(turn), abs=1e-9)
        assert y == pytest.approx(ey + 20.0 * math.sin(turn) + math.cos(turn), abs=1e-9)
        assert z == pytest.approx(13.2)
        assert heading == pytest.approx(turn + 0.2, abs=1e-9)


def test_single_mcap_file_is_read_as_its_folder(tmp_path):
    folder = write_bag(tmp_path / "bag", circle_rows())
    whole = read(folder)
    alone = read_drive(folder / "bag.mcap")
    assert np.array_equal(alone.ego, whole.ego)
    assert np.array_equal(alone.objects[0].poses, whole.objects[0].poses)


def test_drive_of_transforms_alone(tmp_path):
    """The ego below a frame that jumps, and others as frames of the map."""
    rows = [("/tf_static", START_NS, transform(0, "base_link", "lidar", (1.0, 0.0, 2.0)))]
    for tick in range(20):
        time_ns = START_NS + tick * PERIOD_NS
        jump = 0.5 if tick >= 10 else 0.0
        rows += [
            ("/tf", time_ns, transform(time_ns, "map", "odom", (100.0 + jump, 0.0, 0.0), 0.5)),
            ("/tf", time_ns, transform(time_ns, "odom", "base_link", (0.8 * tick, 0.0, 0.0))),
            ("/tf", time_ns, transform(time_ns, "map", "npc_bus", (110.0, 0.1 * tick, 0.0), 1.0)),
            ("/tf", time_ns, transform(time_ns, "lidar", "npc_person", (5.0, 0.0, -2.0))),
        ]
    drive = read(write_bag(tmp_path / "bag", rows), objects="npc_*")
    assert (drive.ego_source, drive.objects_source) == ("base_link", "npc_*")
    for index, (_, x, y, _, heading) in enumerate(drive.ego):
        jump = 0.5 if index >= 10 else 0.0
        assert x == pytest.approx(100.0 + jump + 0.8 * index * math.cos(0.5))
        assert y == pytest.approx(0.8 * index * math.sin(0.5))
        assert heading == pytest.approx(0.5)
    bus, person = drive.objects
    assert (bus.name, bus.kind, person.kind) == ("npc_bus", "bus", "pedestrian")
    assert bus.poses[:, 2] == pytest.approx(0.1 * np.arange(20))
    # The lidar is 1 m ahead of the ego: 6 m in all.
    ego = drive.ego[7]
    assert person.poses[7, 1] == pytest.approx(ego[1] + 6.0 * math.cos(0.5))


def live(ticks: int = 20):
    """Messages of a simulation that begins at 0, as a clock on the wall records them."""
    rows = [("/tf_static", START_NS, transform(0, "base_link", "lidar", (1.0, 0.0, 2.0)))]
    rows.append(("/tf_static", START_NS, transform(0, "world", "map", (0.0, 0.0, 0.0))))
    for tick in range(ticks):
        time_ns, now_ns = tick * PERIOD_NS, START_NS + 5 + 3 * tick * PERIOD_NS
        rows.append(("/tf", now_ns, transform(time_ns, "map", "base_link", (0.8 * tick, 0.0, 0.0))))
        rows.append(("/odom", now_ns, odometry(time_ns, (0.8 * tick, 0.0, 0.0))))
        seen = [ahead("lead", "car", 20.0 + tick, 2.0)]
        rows.append(("/tracks", now_ns, tracked(time_ns, "map", seen)))
    return rows


@pytest.mark.parametrize("ego", ["/odom", "base_link"])
def test_first_tick_of_a_live_recording_is_at_0_and_not_on_the_wall(tmp_path, ego):
    drive = read(write_bag(tmp_path / "bag", live()), ego=ego)
    assert drive.ego[:, 0] == pytest.approx(0.1 * np.arange(20))
    assert drive.ego[:, 1] == pytest.approx(0.8 * np.arange(20))
    (lead,) = drive.objects
    assert lead.poses[:, 0] == pytest.approx(0.1 * np.arange(20))
    assert drive.notes == []


def test_ego_below_a_frame_that_moves_has_its_times(tmp_path):
    rows = [row for row in live() if row[0] == "/tf"]
    below = transform(0, "base_link", "base_footprint", (0.0, 0.0, -0.3))
    rows.append(("/tf_static", START_NS, below))
    drive = read(write_bag(tmp_path / "bag", rows), ego="base_footprint")
    assert drive.ego[:, 0] == pytest.approx(0.1 * np.arange(20))


def test_messages_without_stamps_have_the_times_of_their_recording(tmp_path):
    rows = [
        ("/odom", START_NS + tick * PERIOD_NS, odometry(0, (0.8 * tick, 0.0, 0.0)))
        for tick in range(10)
    ]
    drive = read(write_bag(tmp_path / "bag", rows))
    assert drive.ego[:, 0] == pytest.approx(0.1 * np.arange(10))


def test_choice_of_topics(tmp_path):
    rows = circle_rows(10)
    for tick in range(10):
        time_ns = START_NS + tick * PERIOD_NS
        rows.append(("/truth/odometry", time_ns, odometry(time_ns, (5.0 + tick, 0.0, 0.0))))
        rows.append(("/others", time_ns, tracked(time_ns, "map", [ahead("x", "truck", 30.0, 2.0)])))
    folder = write_bag(tmp_path / "bag", rows)
    assert read(folder).ego_source == "/truth/odometry"
    chosen = read(folder, ego="/odom", objects="/others")
    assert chosen.ego[0, 1] == pytest.approx(500.0)
    assert [each.kind for each in chosen.objects] == ["truck"]
    with pytest.raises(ValueError, match=r"no topic /tracks of type nav_msgs.*there: /odom"):
        read(folder, ego="/tracks")
    with pytest.raises(ValueError, match="no topic /odom of objects with identities"):
        read(folder, objects="/odom")
    with pytest.raises(ValueError, match="no poses of the ego there"):
        read(folder, ego="velodyne")


def test_what_cannot_be_used_is_counted(tmp_path):
    rows = circle_rows(5)
    time_ns = START_NS
    nameless = MAKE.detections(time_ns, "map", [ahead("", "car", 1.0, 2.0)])
    rows.append(("/d", time_ns, nameless))
    broken = MAKE.detections(time_ns, "map", [ahead("nan", "car", math.nan, 2.0)])
    rows.append(("/d", time_ns, broken))
    whole = MAKE.detections(time_ns, "elsewhere", [ahead("far", "person", 1.0, 2.0)])
    rows.append(("/d", time_ns, whole))
    rows.append(("/tf", time_ns, transform(time_ns, "map", "odom", (0.0, 0.0, 0.0))))
    drive = read(write_bag(tmp_path / "bag", rows))
    assert drive.objects_source == ""
    assert drive.notes == [
        "1 messages, transforms or objects with numbers that are none",
        "1 objects without an id, of which nobody knows which is which",
        "1 poses of objects beside the ego's time or no frame of 'map'",
    ]


def test_frames_in_a_circle_end(tmp_path):
    rows = circle_rows(5)
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("a", "map")):
        rows.append(("/tf", START_NS, transform(START_NS, parent, child, (1.0, 0.0, 0.0))))
    with pytest.raises(ValueError, match="go in a circle"):
        read(write_bag(tmp_path / "bag", rows))


def test_recordings_without_an_ego_say_what_is_there(tmp_path):
    rows = [("/chatter", START_NS, STORE.make("std_msgs/msg/String", data="x"))]
    with pytest.raises(ValueError, match=r"neither nav_msgs.*there: /chatter \(std_msgs/msg/Str"):
        read(write_bag(tmp_path / "bag", rows))


def test_answer_passes_the_check_of_its_reader(tmp_path):
    from twin.drives.reading import RECORDED_DRIVE

    drive = read(write_bag(tmp_path / "bag", circle_rows()))
    tree, arrays = pack(drive, RECORDED_DRIVE.check)
    again = unpack(tree, RECORDED_DRIVE.check, arrays)
    assert np.array_equal(again.ego, drive.ego)
    assert drive_mistake(again) == ""


def test_read_apart_gives_the_same(tmp_path):
    folder = write_bag(tmp_path / "bag", circle_rows())
    apart = drive_apart(folder, DriveQuestion())
    assert np.array_equal(apart.ego, read(folder).ego)
    assert apart.topics[0].startswith("/odom (nav_msgs/msg/Odometry, 40)")


def test_files_that_are_no_recordings_are_one_line(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("x")
    with pytest.raises(UsageError, match=r"expected a file that ends in \.mcap"):
        drive_apart(text, DriveQuestion())
    with pytest.raises(UsageError, match=r"no metadata\.yaml in it"):
        drive_apart(tmp_path, DriveQuestion())
    with pytest.raises(UsageError, match="No such file"):
        drive_apart(tmp_path / "nowhere.mcap", DriveQuestion())
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"\x89MCAP0\r\n" + zlib.compress(b"x" * 1000) + b"\x89MCAP0\r\n")
    with pytest.raises(UsageError, match="damaged, or no recording of ROS 2") as caught:
        drive_apart(noise, DriveQuestion())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_recording_that_was_cut_off_says_what_to_do(tmp_path, share):
    whole = next(write_bag(tmp_path / "bag", circle_rows()).glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(UsageError, match=r"its end is missing.*`mcap recover`") as caught:
        drive_apart(cut, DriveQuestion())
    assert "\n" not in str(caught.value)


def test_objects_that_no_frame_is_called_like_are_refused(tmp_path):
    rows = circle_rows()
    rows += [
        (
            "/tf",
            START_NS + tick * PERIOD_NS,
            transform(START_NS + tick * PERIOD_NS, "map", "npc_a", (1.0, 0.0, 0.0)),
        )
        for tick in range(20)
    ]
    folder = write_bag(tmp_path / "bag", rows)
    with pytest.raises(ValueError, match=r"--objects car_: no frame's name begins so; .*npc_a"):
        read_drive(folder / "metadata.yaml", b'{"objects": "car_"}')


def test_lies_of_a_reader_are_seen(tmp_path):
    from dataclasses import replace

    drive = read(write_bag(tmp_path / "bag", circle_rows()))
    still = drive.ego.copy()
    still[3, 0] = still[2, 0]
    far = drive.ego.copy()
    far[2, 1] = 1e12
    big = replace(drive.objects[0], size_m=np.array([1e3, 1.0, 1.0]))
    for wrong, words in (
        (replace(drive, ego=still), "times do not rise"),
        (replace(drive, ego=far), "a coordinate beyond"),
        (replace(drive, ego=drive.ego[:0]), "no poses"),
        (replace(drive, objects=[big]), "a size out of range"),
    ):
        assert words in drive_mistake(wrong)
