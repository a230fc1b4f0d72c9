"""The topic table: every key of the fabric, once. Keys are below the session's namespace."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from schemas.kinds.picture import MAIN, OUTPUTS
from schemas.kinds.sensor import sensor_kinds

_WORDS = {"<f8": "float64", "<i8": "int64", "<f4": "float32", "<i4": "int32", "|u1": "uint8"}
Payload = Literal["array", "msgpack", "jpeg"]


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table. ``key`` may hold ``{rig}``, ``{worker}``, ``{sensor}`` and so on."""

    key: str
    payload: Payload
    type: str
    """Name of the Struct or array layout in :mod:`schemas.messages`, :mod:`schemas.wire.view`,
    :mod:`schemas.wire.delivery` or :mod:`schemas.wire.interventions`."""
    block: bool
    """BLOCK on congestion (one known peer); otherwise DROP."""


PICTURES = tuple(
    Topic(
        f"drive/{{rig}}/sensor/{kind.name}",
        "array",
        f"{kind.meaning} [S,H,W{f',{kind.values}' if kind.values > 1 else ''}] "
        f"{_WORDS[kind.dtype]}",
        True,
    )
    for kind in (MAIN, *OUTPUTS)
)
"""What a camera gives per pixel, as the table of pictures has it."""
LIDAR = Topic("drive/{rig}/sensor/lidar", "array", "POINT_COLUMNS [S,N,K] float32", True)
BOXES = Topic("drive/{rig}/sensor/boxes", "array", "BOX_COLUMNS [S,B,7] float32", True)
VEHICLE = Topic("drive/{rig}/sensor/vehicle", "array", "VEHICLE_COLUMNS [S,7] float64", True)
ENVIRONMENT = Topic(
    "drive/{rig}/sensor/environment", "array", "ENVIRONMENT_COLUMNS [S,2] float64", True
)
OWN_SENSORS = tuple(
    Topic(
        f"drive/{{rig}}/sensor/{kind.name}",
        "array",
        f"{kind.columns_name} [S,{','.join(map(str, kind.shape))}] {_WORDS[kind.dtype]}",
        True,
    )
    for kind in sensor_kinds().declared
)
"""The vehicle's own sensors, as the table of kinds has them."""
EPISODE = Topic("drive/{rig}/episode", "msgpack", "Episode", True)
TICK = Topic("drive/{rig}/tick", "msgpack", "Tick", True)
COMMAND = Topic("drive/{rig}/command", "msgpack", "Commands", True)
READY = Topic("drive/{rig}/control/{side}", "msgpack", "Ready", True)
CONTROL = Topic("drive/{rig}/control", "msgpack", "ControlRequest -> ControlReply", True)
SIMULATOR_ALIVE = Topic("drive/{rig}/alive", "msgpack", "liveliness token", False)

# Requests to the conductor come on a key for each role that may make them:
# schemas.wire.rpc_routes.
RPC_WORKER = Topic("conductor/rpc/worker", "msgpack", "Request -> Reply", True)
RPC_STATUS = Topic("conductor/rpc/status", "msgpack", "Request -> Reply", True)
RPC_ADMIN = Topic("conductor/rpc/admin", "msgpack", "Request -> Reply", True)
RPC_SUBMIT = Topic("conductor/rpc/submit", "msgpack", "Request -> Reply", True)
FILES = Topic("conductor/files", "msgpack", "Delivery -> Delivered", True)
CASE_FILES = Topic("conductor/case-files", "msgpack", "CaseFileRequest -> CaseFilePiece", True)
EVENT = Topic("conductor/event", "msgpack", "fact", False)
WORKER_ALIVE = Topic("worker/{worker}", "msgpack", "liveliness token", False)

VIEW_THUMBNAIL = Topic("view/{campaign}/{case}/thumbnail", "jpeg", "Thumbnail", False)
# What a viewer is shown of a single case: at the pace of the wall clock, dropped rather than waited
# for, and apart from the recorder's topic, which is complete.
VIEW_LIVE_START = Topic("view/{campaign}/{case}/live/start", "msgpack", "CaseStart", False)
VIEW_LIVE_STATE = Topic("view/{campaign}/{case}/live/state", "msgpack", "StateSample", False)
VIEW_LIVE_END = Topic("view/{campaign}/{case}/live/end", "msgpack", "CaseEnd", False)
VIEW_LIVE_CAMERA = Topic("view/{campaign}/{case}/live/{sensor}", "jpeg", "CameraSample", False)
VIEW_LIVE_LIDAR = Topic(
    "view/{campaign}/{case}/live/{sensor}", "array", "PointsSample [N,4] int16", False
)
VIEW_CONTROL = Topic(
    "view/{campaign}/{case}/control", "msgpack", "ControlRequest -> ControlReply", True
)
# BLOCK holds up the feed's thread, never the simulator: what waits behind it has its own limit.
FEED_RECORDED = Topic("feed/{rig}/recorded", "msgpack", "RecorderBatch", True)
FEED_SCENE = Topic("feed/{rig}/scene", "msgpack", "nothing -> SceneMesh", True)
FEED_CLOCK = Topic("feed/{rig}/clock", "msgpack", "nothing -> ClockReading", True)
FEED_END = Topic("feed/{rig}/end", "msgpack", "FeedEnd", True)
RECORDER_ALIVE = Topic("feed/{rig}/recorder", "msgpack", "liveliness token", False)

TOPICS: tuple[Topic, ...] = (
    *PICTURES,
    LIDAR,
    BOXES,
    VEHICLE,
    ENVIRONMENT,
    *OWN_SENSORS,
    EPISODE,
    TICK,
    COMMAND,
    READY,
    CONTROL,
    SIMULATOR_ALIVE,
    RPC_WORKER,
    RPC_STATUS,
    RPC_ADMIN,
    RPC_SUBMIT,
    FILES,
    CASE_FILES,
    EVENT,
    WORKER_ALIVE,
    VIEW_THUMBNAIL,
    VIEW_LIVE_START,
    VIEW_LIVE_STATE,
    VIEW_LIVE_END,
    VIEW_LIVE_CAMERA,
    VIEW_LIVE_LIDAR,
    VIEW_CONTROL,
    FEED_RECORDED,
    FEED_SCENE,
    FEED_CLOCK,
    FEED_END,
    RECORDER_ALIVE,
)

SENSORS: dict[str, Topic] = {
    topic.key.rsplit("/", 1)[1]: topic for topic in TOPICS if "/sensor/" in topic.key
}
"""Kind of sensor -> topic. A car may have several of a kind: the main camera's messages are called
``camera``, ``boxes``, ``depth``; those of another camera or a lidar add its name,
``camera.front_left``, ``lidar.roof``."""


def live_keys(campaign: str, case: str) -> str:
    """Key of everything a viewer is shown of a single case; ``*`` stands for any."""
    return f"view/{campaign}/{case}/live/*"


def sensor_topic(name: str) -> Topic:
    """Topic of the sensor message called ``name``."""
    return SENSORS[name.partition(".")[0]]


def reads_mistake(names: Iterable[str]) -> str:
    """What is wrong with the sensor messages that a stack says it looks at; empty: nothing."""
    for name in names:
        if not isinstance(name, str) or name.partition(".")[0] not in SENSORS:
            return (
                f"reads {name!r}; allowed: messages of sensors ({', '.join(sorted(SENSORS))},"
                " also with the name of a camera or lidar behind a dot), or leave it out to get all"
            )
    return ""


def sensor_key(rig: str, name: str) -> str:
    """Key of the sensor message called ``name``; ``*``: of all."""
    return f"drive/{rig}/sensor/{name}"
