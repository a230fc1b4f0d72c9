"""A stand-in for a conductor and its simulators: many live cases without any simulation.

Run as ``python -m viewer.bench.source``; a child of ``viewer bench``. It speaks the view plane as
simulators do, in full for cases that somebody looks at alone, and answers for the status.
"""

from __future__ import annotations

import json
import math
import sys
import time
from functools import partial
from typing import Any

import cv2
import numpy as np

from schemas import SCHEMA_VERSION
from schemas.messages import Detection, Lights
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Explain, Reply, Request, StatusRequest
from schemas.wire.status import RunningCase
from schemas.wire.view import (
    POINTS_MAX,
    UNNUMBERED,
    CameraSample,
    CaseStart,
    ClockReading,
    Controls,
    PointsSample,
    Stage,
    StateSample,
    Thumbnail,
)
from twin.base.process import bind_to_parent, watch_lifeline
from twin.fabric.bus import Bus, Respond
from twin.fabric.zenoh_bus import open_bus

CAMPAIGN = "bench"
THUMBNAIL_HZ, CAMERA_HZ, LIDAR_HZ = 2, 10, 5
"""Rates of the view plane [Hz]."""
WORKERS = 8
"""Workers that have them."""
PICTURES = 20
"""Different pictures that are shown in turn."""


def case_name(index: int) -> str:
    """Name of a case."""
    return f"case-{index:03d}"


def main(cases: int) -> None:
    """Publish until our parent ends."""
    bind_to_parent()
    watch_lifeline()
    bus = open_bus("router", listen=["tcp/127.0.0.1:0"])
    bus.serve(topics.RPC_STATUS.key, lambda data, respond: _answer(data, respond, cases))
    for rig in (f"rig-{number}" for number in range(WORKERS)):
        bus.serve(topics.FEED_CLOCK.key.format(rig=rig), partial(_clock, rig))
    print(json.dumps({"endpoint": bus.endpoints[0]}), flush=True)
    rng = np.random.default_rng(0)
    small = [_picture(rng, 160, 90) for _ in range(PICTURES)]
    large = [_picture(rng, 640, 360) for _ in range(PICTURES)]
    points = rng.integers(-3000, 3000, (POINTS_MAX, 4)).astype("<i2")
    points[:, 3] = np.abs(points[:, 3]) % 256
    cloud = points.tobytes()
    begun_s = time.monotonic()
    turn = 0
    while True:
        for index in range(cases):
            # Spread over the period, as simulators are not in step with each other.
            if turn % (CAMERA_HZ // THUMBNAIL_HZ) == index % (CAMERA_HZ // THUMBNAIL_HZ):
                _thumbnail(bus, index, turn, small[(turn + index) % PICTURES])
            if bus.wanted(topics.live_keys(CAMPAIGN, case_name(index))):
                _in_full(bus, index, turn, large[turn % PICTURES], cloud)
        turn += 1
        time.sleep(max(0.0, begun_s + turn / CAMERA_HZ - time.monotonic()))


def _picture(rng: np.random.Generator, width: int, height: int) -> bytes:
    """A JPEG about as large as a street's."""
    coarse = rng.integers(0, 255, (max(1, height // 12), max(1, width // 12), 3)).astype(np.uint8)
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    noise = rng.integers(0, 12, image.shape).astype(np.uint8)
    _, data = cv2.imencode(".jpg", cv2.add(image, noise), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return bytes(data)


def _answer(data: bytes, respond: Respond, cases: int) -> None:
    campaigns = {CAMPAIGN: {"cases": cases, "left": cases, "leased": cases}}
    workers = [{"id": f"w{i}", "present": True, "held": cases // WORKERS} for i in range(WORKERS)]
    status: dict[str, Any] = {"campaigns": campaigns, "workers": workers}
    request = decode(data, Request)
    if isinstance(request, Explain):
        status = {"explain": ["is shown for a measurement"]}
    elif isinstance(request, StatusRequest) and request.running:
        status["running"] = [_lease(index) for index in range(cases)]
    respond(encode(Reply(v=SCHEMA_VERSION, epoch=1, status=status)))


def _clock(rig: str, _data: bytes, respond: Respond) -> None:
    respond(encode(ClockReading(v=SCHEMA_VERSION, rig=rig, clock_s=time.monotonic())))


def _lease(index: int) -> RunningCase:
    return {
        "campaign": CAMPAIGN,
        "case": case_name(index),
        "worker": f"w{index % WORKERS}",
        "host": "bench",
        "attempt": 1,
        "tick": 1,
        "for_s": 1.0,
        "by_hand": "",
    }


def _publish(bus: Bus, topic: topics.Topic, index: int, payload: bytes, more: bytes = b"") -> None:
    sensor = "camera" if topic is topics.VIEW_LIVE_CAMERA else "lidar.roof"
    key = topic.key.format(campaign=CAMPAIGN, case=case_name(index), sensor=sensor)
    bus.publish(key, payload, more)


def _thumbnail(bus: Bus, index: int, turn: int, picture: bytes) -> None:
    thumbnail = Thumbnail(
        v=SCHEMA_VERSION,
        seq=turn,
        token=index + 1,
        campaign=CAMPAIGN,
        case=case_name(index),
        attempt=1,
        model="none",
        weather="clear",
        time_of_day_min=780,
        sim_time_ns=_time_ns(turn),
        speed_mps=8.0,
        dtc_m=40.0,
        aeb=False,
        rig=f"rig-{index % WORKERS}",
        at_s=time.monotonic(),
    )
    _publish(bus, topics.VIEW_THUMBNAIL, index, picture, encode(thumbnail))


def _in_full(bus: Bus, index: int, turn: int, picture: bytes, cloud: bytes) -> None:
    token, time_ns = index + 1, _time_ns(turn)
    if turn % CAMERA_HZ == 0:
        _publish(bus, topics.VIEW_LIVE_START, index, encode(_start(index)))
    camera = CameraSample(
        v=SCHEMA_VERSION, seq=UNNUMBERED, token=token, tick=turn, sim_time_ns=time_ns
    )
    _publish(bus, topics.VIEW_LIVE_CAMERA, index, picture, encode(camera))
    if turn % (CAMERA_HZ // LIDAR_HZ) == 0:
        sweep = PointsSample(
            v=SCHEMA_VERSION, token=token, tick=turn, sim_time_ns=time_ns, stride=1
        )
        _publish(bus, topics.VIEW_LIVE_LIDAR, index, cloud, encode(sweep))
    _publish(bus, topics.VIEW_LIVE_STATE, index, encode(_state(token, turn)))


def _start(index: int) -> CaseStart:
    stage = Stage(
        lane=[[0.0, 0.0, 0.0], [300.0, 0.0, 0.0]],
        lane_width_m=3.5,
        parking_width_m=2.3,
        sidewalk_width_m=4.0,
        obstacle_center_m=[240.0, 0.0, 0.7],
        obstacle_yaw_rad=0.0,
        obstacle_size_m=[4.5, 1.8, 1.46],
        ego_center_m=[1.5, 0.0, 0.75],
        ego_size_m=[5.0, 1.9, 1.5],
        camera_m=[2.0, 0.0, 1.3],
    )
    return CaseStart(
        v=SCHEMA_VERSION,
        seq=UNNUMBERED,
        token=index + 1,
        campaign=CAMPAIGN,
        case=case_name(index),
        attempt=1,
        folder="",
        model="none",
        weather="clear",
        time_of_day_min=780,
        scene="bench",
        vehicle="bench",
        seed=0,
        control_hz=20,
        camera="front_right",
        width=640,
        height=360,
        hfov_deg=70.0,
        stage=stage,
    )


def _state(token: int, turn: int) -> StateSample:
    detections = [Detection("car", 0.9, 100.0 + 8 * i, 150.0, 40.0, 30.0) for i in range(8)]
    return StateSample(
        v=SCHEMA_VERSION,
        seq=UNNUMBERED,
        token=token,
        tick=turn,
        sim_time_ns=_time_ns(turn),
        x_m=turn * 0.1,
        y_m=0.0,
        yaw_rad=0.0,
        speed_mps=8.0 + math.sin(turn / 10),
        accel_mps2=0.0,
        dtc_m=40.0,
        ttc_s=5.0,
        collisions=0,
        controls=Controls(0.3, 0.0, 0.0, False, Lights(), detections),
        boxes=[],
    )


def _time_ns(turn: int) -> int:
    return turn * 1_000_000_000 // CAMERA_HZ


if __name__ == "__main__":
    main(int(sys.argv[1]))
