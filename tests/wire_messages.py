"""One message of every kind, for tests that need bytes of each."""

from __future__ import annotations

import hashlib
import zlib
from typing import Any

import numpy as np
import view_messages

from schemas import SCHEMA_VERSION as V
from schemas.files.recording import RecordingObject
from schemas.messages import (
    CameraSite,
    Command,
    Commands,
    Detection,
    Episode,
    Frame,
    LidarSite,
    Ready,
    Tick,
)
from schemas.plan import expand, parse_campaign
from schemas.sections.lens import Lens
from schemas.wire.control import (
    Beat,
    Bye,
    Control,
    Explain,
    Hello,
    Next,
    Recorded,
    Reply,
    Result,
    StatusRequest,
    Submit,
)
from schemas.wire.delivery import AttemptFiles, Delivered, SeenFolder, files_sha256
from schemas.wire.interventions import ControlReply, ControlRequest, SetLights
from schemas.wire.view import (
    CameraSample,
    FeedEnd,
    PointsSample,
    RecorderBatch,
    RecorderSample,
    SceneMesh,
)

CAMPAIGN = {"campaign": "c", "simulator": "noop", "matrix": {"weather": ["clear", "cloudy"]}}


def case() -> Any:
    campaign, mistakes = parse_campaign(CAMPAIGN)
    assert campaign is not None, mistakes
    return expand(campaign)[0]


def result() -> Result:
    """A committed pass."""
    return Result("c", "clear", 65537, "verdict", "pass", {"dtc_min_m": 12.5}, ["rest"])


def control() -> list[Any]:
    """One of every request, and their answers."""
    kpi, log = b"PAR1", b"said\n"
    return [
        Hello(
            *(V, "w1", "node", 12, "cpu:avx2", "0" * 64, 2, 1.8e9, 1 << 30, ["lidar"]),
            session=bytes(range(32)),
        ),
        Next(V, "w1", 3, 2, "rig", [result()], [], [65537], 100.0),
        Beat(V, "w1", {"65537": 12}),
        Bye(V, "w1", "done"),
        Submit(V, CAMPAIGN, "0" * 64, "", 1),
        Control(V, "pause", "c"),
        Explain(V, "c", "clear"),
        StatusRequest(V),
        Reply(v=V, epoch=1, status={"campaigns": {"c": {"left": 2}}}),
        SeenFolder(V, "c", "0" * 64),
        AttemptFiles(V, "c", "clear", 1, kpi, log, files_sha256(kpi, log)),
        Delivered(V, False, "busy", True),
        Recorded(V, "w1", "c", "clear", 65537, RecordingObject("ab" * 32, 4711, True)),
    ]


def drive_plane() -> list[Any]:
    """One of every message of the drive plane."""
    site = CameraSite("front", "camera", 64, 36, 20, 70.0, [2.0, 0.0, 1.3], [0.0] * 3, Lens())
    lidar = LidarSite(
        "roof", "lidar.roof", 10, 16, 256, ["x", "y", "z"], [1.0, 0.0, 2.0], [0.0] * 3
    )
    perception = next(iter(_campaign().autonomy.perception.values()))
    return [
        Ready(V, "simulator", "r", 1, "/dev/shm/none", 4096, "n", minor=1),
        Tick(V, 1, [True], [65537], [0], [0], ["camera"], 0),
        Episode(
            *(V, 1, 0, 65537, "clear", 7, "ground_truth", perception, "front", 64, 36, 70.0),
            *(50_000_000, [site], [lidar]),
        ),
        Frame(V, "rgb8", 1, [True], ["clear"], [65537], [0], [0], "|u1", [1, 2, 2, 3], "raw"),
        Commands(
            *(V, 1),
            [
                Command(
                    *(0, 65537, 0, 0.2, 0.0, 0.01),
                    detections=[Detection("car", 0.9, 1.0, 2.0, 3.0, 4.0)],
                )
            ],
        ),
    ]


def _campaign() -> Any:
    campaign, _ = parse_campaign(CAMPAIGN)
    assert campaign is not None
    return campaign


def view_plane() -> list[Any]:
    """One of every message of the view plane."""
    mesh = np.zeros((3, 3), "<f4").tobytes() + np.array([0, 1, 2], "<u4").tobytes() + bytes(9)
    return [
        view_messages.start(),
        view_messages.state(1),
        CameraSample(V, 2, 7, 0, 0),
        PointsSample(V, 7, 0, 0, 2),
        SceneMesh(V, digest_of(mesh), 3, 1, zlib.compress(mesh)),
        view_messages.end(3),
        view_messages.thumbnail(),
        FeedEnd(V, "r"),
        recorder_batch(),
    ]


def recorder_batch() -> RecorderBatch:
    """A tiny attempt, as the recorder gets it."""
    return RecorderBatch(
        V,
        [
            RecorderSample(start=view_messages.start()),
            RecorderSample(camera=CameraSample(V, 1, 7, 0, 0), jpeg=b"\xff\xd8\xff\xd9"),
            RecorderSample(state=view_messages.state(2)),
            RecorderSample(end=view_messages.end(3)),
        ],
    )


def digest_of(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def steering() -> list[Any]:
    """A request of a hand and its answer."""
    return [
        ControlRequest(V, "a", SetLights(None), "clear"),
        ControlReply(V, "no such case"),
    ]
