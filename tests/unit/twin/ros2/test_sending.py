"""Messages of a table: read by others, and equal to the arrays that they were made of."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from ros2_messages import (
    BROWN,
    car_tick,
    episode,
    plain,
    read_independently,
    write_independently,
)

from schemas.messages import Episode
from schemas.sections.lens_projection import project, vehicle_from_camera
from twin.base.errors import UsageError
from twin.ros2.frames import OPTICAL, of_mount, product, yaw_of
from twin.ros2.sending import TableSender, TopicMessage
from twin.ros2.store import type_store
from twin.ros2.tables import SensorTopic, TopicTable, load_table, shipped_tables

STORE = type_store()


def sent(table: str | TopicTable) -> list[TopicMessage]:
    chosen = load_table(table) if isinstance(table, str) else table
    sender = TableSender(chosen, episode(), STORE)
    return [*sender.start(), *sender.tick(car_tick())]


def with_truth() -> TopicTable:
    table = load_table("autoware")
    more = [
        SensorTopic("/truth/objects", "objects", "vision_msgs/msg/Detection3DArray"),
        SensorTopic("/truth/tracks", "objects", "autoware_perception_msgs/msg/TrackedObjects"),
        SensorTopic("/truth/{name}/boxes", "boxes"),
        SensorTopic("/depth/{name}", "depth"),
        SensorTopic("/small/{name}", "camera", "sensor_msgs/msg/CompressedImage"),
    ]
    return msgspec.structs.replace(table, sensors=[*table.sensors, *more])


def of_topic(messages: list[TopicMessage], topic: str) -> list:
    return [each.message for each in messages if each.topic == topic]


@pytest.mark.parametrize("table", [*shipped_tables(), "truth"])
def test_every_message_is_read_and_written_alike_by_another_library(table):
    messages = sent(with_truth() if table == "truth" else table)
    assert len(messages) > 8
    for each in messages:
        data = STORE.encode(each.message)
        other = read_independently(STORE, each.type_name, data)
        assert plain(other) == plain(each.message), each.topic
        assert plain(STORE.decode(each.type_name, data)) == plain(each.message), each.topic
        assert write_independently(STORE, each.type_name, other) == data, each.topic


def test_same_tick_gives_the_same_bytes():
    first, again = sent("plain"), sent("plain")
    assert [STORE.encode(a.message) for a in first] == [STORE.encode(b.message) for b in again]


def test_plain_table_sends_every_array_exactly():
    messages, car = sent("plain"), car_tick()
    by_topic = {each.topic: each.message for each in messages}
    arrays = {
        each.name: np.frombuffer(bytes(each.data), each.dtype).reshape(each.shape)
        for topic, each in by_topic.items()
        if topic.startswith("/drivetwin/sensor/")
    }
    front = by_topic["/drivetwin/front/image_raw"]
    arrays["camera"] = front.data.reshape(front.height, front.width, 3)
    rear = by_topic["/drivetwin/rear/image_raw"]
    arrays["camera.rear"] = rear.data.reshape(rear.height, rear.width, 3)
    cloud = by_topic["/drivetwin/roof/points"]
    arrays["lidar.roof"] = np.frombuffer(cloud.data, "<f4").reshape(car.sensors["lidar.roof"].shape)
    assert set(arrays) == set(car.sensors)
    for name, values in car.sensors.items():
        assert arrays[name].tobytes() == np.ascontiguousarray(values).tobytes(), name
    assert by_topic["/drivetwin/sensor/boxes"].count == 1
    assert messages[-1].topic == "/drivetwin/tick"
    assert messages[-1].message.sensors == list(car.sensors)


def test_episode_travels_whole_but_for_the_bridges_own_numbers():
    (message,) = of_topic(sent("plain"), "/drivetwin/episode")
    told = msgspec.msgpack.decode(bytes(message.msgpack), type=Episode)
    assert told == msgspec.structs.replace(episode(), seq=0, slot=0, token=0)
    assert (message.case_name, message.seed) == ("clear", 2**63 + 5)
    assert message.control_period_s == 0.05


def test_xyzirc_has_the_returns_alone_with_their_channels():
    (cloud,) = of_topic(sent("autoware"), "/sensing/lidar/roof/pointcloud_before_sync")
    sweep = car_tick().sensors["lidar.roof"]
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
        ("intensity", 12, 2),
        ("return_type", 13, 2),
        ("channel", 14, 4),
    ]
    assert (cloud.height, cloud.width, cloud.point_step, cloud.is_dense) == (1, 31, 16, True)
    rows = cloud.data.reshape(31, 16)
    kept = np.delete(sweep, 5, axis=0)
    assert np.array_equal(rows[:, :12].copy().view("<f4"), kept[:, :3])
    assert np.array_equal(rows[:, 12], kept[:, 4])
    # Row 5 has no return; it would be of channel 0, eight columns each.
    expected = np.delete(np.arange(32) // 8, 5)
    assert np.array_equal(rows[:, 14:].copy().view("<u2")[:, 0], expected)


def test_camera_info_projects_points_where_the_simulator_draws_them():
    (info,) = of_topic(sent("autoware"), "/sensing/camera/front/camera_info")
    point = np.array([[1.0, -0.5, 6.0]])
    (pixel,), visible = project(BROWN, 64, 36, 70.0, point)
    assert visible.all()
    x, y = point[0, 0] / 6.0, point[0, 1] / 6.0
    k1, k2, p1, p2, k3, *_ = info.d
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    # OpenCV's pixel centres are whole numbers, ours are halves.
    assert info.k[0] * u + info.k[2] + 0.5 == pytest.approx(pixel[0], abs=1e-9)
    assert info.k[4] * v + info.k[5] + 0.5 == pytest.approx(pixel[1], abs=1e-9)
    assert info.distortion_model == "rational_polynomial"


def test_static_frames_lead_from_the_car_to_optical_axes():
    (message,) = of_topic(sent("autoware"), "/tf_static")
    found = {each.child_frame_id: each for each in message.transforms}
    assert list(found) == [
        *("odom", "front/camera_link", "front/camera_optical_link"),
        *("rear/camera_link", "rear/camera_optical_link", "roof_base_link"),
    ]
    turned = product(_turn(found["front/camera_link"]), _turn(found["front/camera_optical_link"]))
    assert np.allclose(_matrix(turned), vehicle_from_camera([0.0, 10.0, 0.0]), atol=1e-12)
    assert math.degrees(yaw_of(_turn(found["roof_base_link"]))) == pytest.approx(90.0)
    at = found["roof_base_link"].transform.translation
    assert (at.x, at.y, at.z) == (0.9, 0.0, 1.8)


def _turn(message):
    rotation = message.transform.rotation
    return rotation.x, rotation.y, rotation.z, rotation.w


def _matrix(turn):
    x, y, z, w = turn
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_no_minus_zero_in_turns():
    assert all(math.copysign(1.0, part) == 1.0 for part in of_mount([0.0, 0.0, 0.0]))
    level = _matrix(product(of_mount([0.0, 0.0, 0.0]), OPTICAL))
    assert np.allclose(level, vehicle_from_camera([0.0, 0.0, 0.0]))


def test_sensors_that_are_not_due_are_not_sent():
    sender = TableSender(load_table("autoware"), episode(), STORE)
    car = car_tick()
    few = {"vehicle": car.sensors["vehicle"]}
    topics = [each.topic for each in sender.tick(type(car)(1, 50_000_000, few))]
    assert topics == [
        "/clock",
        "/vehicle/status/velocity_status",
        "/vehicle/status/steering_status",
        "/vehicle/status/control_mode",
    ]


def test_no_fix_and_no_orientation_are_said():
    car = car_tick()
    lost = {**car.sensors, "gnss": np.array([np.nan, np.nan, np.nan, 0.0])}
    sender = TableSender(load_table("nav2"), episode(), STORE)
    by_topic = {e.topic: e.message for e in sender.tick(type(car)(1, 0, lost, car.counts))}
    assert by_topic["/gps/fix"].status.status == -1
    assert math.isnan(by_topic["/gps/fix"].latitude)
    assert by_topic["/imu/data_raw"].orientation_covariance[0] == -1.0
    assert by_topic["/imu/data_raw"].linear_acceleration.z == 9.80665
    assert [r.range for r in by_topic["/radar/scan"].returns] == [25.0, 60.0]


@pytest.mark.parametrize(
    ("table", "name", "said"),
    [
        ("plain", "front-left", "camera front-left makes the topic /drivetwin/front-left/"),
        ("nav2", "2front", "camera 2front makes the topic"),
        ("autoware", "a__b", "camera a__b makes the topic"),
    ],
)
def test_a_camera_whose_name_makes_no_topic_is_refused(table, name, said):
    case = episode()
    case.cameras[0] = msgspec.structs.replace(case.cameras[0], name=name)
    with pytest.raises(UsageError, match=f"topic table '{table}': the name of {said}") as found:
        TableSender(load_table(table), case, STORE)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("row", ["lidar", "array"])
def test_a_lidar_whose_name_makes_no_topic_is_refused(row):
    case = episode()
    named = {"name": "roof-top", "message": "lidar.roof-top"}
    case.lidars[0] = msgspec.structs.replace(case.lidars[0], **named)
    table = load_table("plain")
    kept = [each for each in table.sensors if each.source in ("clock", row)]
    with pytest.raises(UsageError, match="roof-top makes the topic /drivetwin/"):
        TableSender(msgspec.structs.replace(table, sensors=kept), case, STORE)
    # A table of one's own may name the topic itself.
    points = SensorTopic("/points", "lidar")
    TableSender(msgspec.structs.replace(table, sensors=[points]), case, STORE)


def test_two_cameras_on_one_topic_are_refused():
    table = load_table("plain")
    rows = [
        msgspec.structs.replace(r, topic="/image") if r.source == "camera" else r
        for r in table.sensors
    ]
    with pytest.raises(Exception, match=r"/image would carry front, rear; its name must hold"):
        TableSender(msgspec.structs.replace(table, sensors=rows), episode(), STORE)
