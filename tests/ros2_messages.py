"""A made-up car with every kind of sensor, for tests of ROS 2 messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from schemas.kinds.perceptions.ground_truth import GroundTruthPerception
from schemas.messages import CameraSite, Episode, LidarSite
from schemas.sections.lens import Lens
from schemas.sections.lidar import POINT_COLUMNS
from twin.ros2.motion import TrueObject
from twin.ros2.sending import CarTick
from twin.ros2.store import TypeStore

FISHEYE = Lens(model="fisheye", k1=0.01, k2=0.002, k3=0.0, k4=0.0)
BROWN = Lens(model="brown_conrady", k1=0.1, k2=0.01, p1=0.001, p2=0.002, k3=0.003)


def episode() -> Episode:
    """A case with two cameras and a LiDAR."""
    front = CameraSite(
        *("front", "camera", 64, 36, 10, 70.0, [1.5, 0.0, 1.4], [0.0, 10.0, 0.0]), lens=BROWN
    )
    rear = CameraSite(
        *("rear", "camera.rear", 32, 32, 10, 90.0, [-1.0, 0.5, 1.0], [0.0, 0.0, 180.0]),
        lens=FISHEYE,
    )
    roof = LidarSite(
        "roof", "lidar.roof", 10, 4, 8, list(POINT_COLUMNS), [0.9, 0.0, 1.8], [0.0, 0.0, 90.0]
    )
    return Episode(
        v=1,
        seq=7,
        slot=3,
        token=11,
        case="clear",
        seed=2**63 + 5,
        model="default",
        perception=GroundTruthPerception(),
        camera="front",
        width=64,
        height=36,
        hfov_deg=70.0,
        control_period_ns=50_000_000,
        cameras=[front, rear],
        lidars=[roof],
    )


def objects() -> list[TrueObject]:
    """A car and somebody on foot."""
    return [
        TrueObject("lead", "car", (30.0, 1.5, 0.75), (0.0, 0.0, 0.6, 0.8), (4.5, 1.8, 1.5), 7.5),
        TrueObject("child", "pedestrian", (12.0, -3.0, 0.6), (0.0, 0.0, 0.0, 1.0), (0.4, 0.4, 1.2)),
    ]


def car_tick(tick: int = 3) -> CarTick:
    """What its sensors saw at a tick; the same for the same number."""
    random = np.random.default_rng(tick)
    sweep = random.normal(size=(32, len(POINT_COLUMNS))).astype("<f4")
    sweep[:, 4] = random.integers(0, 256, 32)
    sweep[5] = [np.nan, np.nan, np.nan, np.nan, 0.0, 0.0, 0.0]
    boxes = np.zeros((32, 7), "<f4")
    boxes[0] = [3, 30.0, 14.0, 5.0, 4.0, 17.0, 21.5]
    radar = np.zeros((128, 6), "<f4")
    radar[0] = [25.0, 0.1, -0.01, -7.5, 12.0, 30.0]
    radar[1] = [60.0, -0.2, 0.0, 3.0, -5.0, 14.0]
    sensors: dict[str, Any] = {
        "camera": random.integers(0, 256, (36, 64, 3)).astype(np.uint8),
        "camera.rear": random.integers(0, 256, (32, 32, 3)).astype(np.uint8),
        "boxes": boxes,
        "depth": random.uniform(1.0, 90.0, (36, 64)).astype("<f4"),
        "lidar.roof": sweep,
        "radar": radar,
        "vehicle": np.array([6.5, 0.125, 0.03125, 0.25, 0.25, 0.0, 0.0]),
        "environment": np.array([12000.0, 0.0004]),
        "encoders": np.array([10, 11, 12, 13]),
        "gnss": np.array([48.5, 9.25, 412.0, 1.0]),
        "imu": np.array([0.1, 0.2, 9.80665, 0.01, 0.02, 0.03]),
        "pose": np.array([10.0, -2.0, 0.5, 0.0, 0.0, 0.6, 0.8]),
    }
    counts = {"boxes": 1, "radar": 2, "lidar.roof": 31}
    return CarTick(tick, 50_000_000 * tick + 7, sensors, counts, objects())


def read_independently(store: TypeStore, type_name: str, data: bytes) -> Any:
    """A message as mcap-ros2-support reads it, by the definition that a recording holds."""
    name = type_name.replace("/msg/", "/")
    return generate_dynamic(name, store.definition(type_name))[name](data)


def write_independently(store: TypeStore, type_name: str, message: Any) -> bytes:
    """Bytes of a message as mcap-ros2-support writes it."""
    name = type_name.replace("/msg/", "/")
    return serialize_dynamic(name, store.definition(type_name))[name](message)


def plain(value: Any) -> Any:
    """A message of either library as dicts, lists and numbers; NaN as a word."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, bytes | bytearray | memoryview):
        value = list(value)
    if hasattr(value, "__dict__") or hasattr(value, "__slots__"):
        names = getattr(value, "__slots__", ()) or vars(value)
        return {key: plain(getattr(value, key)) for key in names if key.islower() and key[0] != "_"}
    if isinstance(value, list | tuple) or type(value).__name__ == "array":
        return [plain(each) for each in value]
    return "nan" if isinstance(value, float) and value != value else value
