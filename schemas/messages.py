"""Messages of the drive plane (simulator - stack).

All are frozen; on the wire they are MessagePack maps (see :mod:`schemas.wire.codec`).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas import SCHEMA_VERSION
from schemas.case import Case
from schemas.identity import stack_name, stack_seed
from schemas.kinds.sensors import encoders, gnss, imu, pose
from schemas.sections.lens import Lens
from schemas.sections.perception import Perception
from schemas.wire.bounds import Ticks


class Pose(Struct, frozen=True):
    """Where the ego's reference point is to be: the middle of the rear axle on the ground; the
    rotation takes vehicle axes (x forward, y left, z up) to world axes."""

    x_m: float
    y_m: float
    z_m: float
    qx: float
    qy: float
    qz: float
    qw: float


POSE_LIMIT_M = 1e5
"""Largest coordinate of a :class:`Pose` [m]."""

POSE_NORM_TOLERANCE = 0.01
"""How far a quaternion's length may be from 1: some print few digits. It is made 1."""


def pose_mistake(pose: Pose) -> str:
    """What is wrong with a pose, or an empty string."""
    for name in ("x_m", "y_m", "z_m"):
        value = getattr(pose, name)
        if not abs(value) <= POSE_LIMIT_M:
            return f"command pose.{name} is {value}, allowed: +-{POSE_LIMIT_M:g}"
    norm = math.hypot(pose.qx, pose.qy, pose.qz, pose.qw)
    if not abs(norm - 1.0) <= POSE_NORM_TOLERANCE:
        return f"command pose: the quaternion's length is {norm:g}, allowed: 1"
    return ""


# --- drive plane --------------------------------------------------------------------------------

OBJECT_CLASSES = ("car", "truck", "bus", "pedestrian", "bicycle", "traffic_sign")
"""Class ids of the box sensor are indices into this tuple."""

SEMANTIC_CLASSES = (
    "unlabelled",
    "road",
    "marking",
    "sidewalk",
    "building",
    "wall",
    "vegetation",
    "terrain",
    "pole",
    "lamp",
    "traffic_sign",
    "car",
    "truck",
    "bus",
    "pedestrian",
    "bicycle",
    "sky",
)
"""Values of semantic images are indices into this tuple."""

BOX_COLUMNS = ("class_id", "x_px", "y_px", "width_px", "height_px", "visible_px", "distance_m")
"""Columns of a box message, float32 [S, B, 7]; x and y are the box's upper left corner.

A box goes around whole pixels, from the left edge of its first to the right edge of its last: what
goes on beyond the picture ends at 0 or at the picture's width or height.
"""

BOXES_MAX = 32
"""Largest number of boxes per camera [B]; the ones with most visible pixels are kept."""

VEHICLE_COLUMNS = (
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "steering_rad",
    "throttle",
    "brake",
    "handbrake",
)
"""Columns of the by-wire feedback, float64 [S, 7]: actuator positions lag behind commands."""

ENVIRONMENT_COLUMNS = ("illuminance_lx", "extinction_per_m")
"""Columns of the ambient light and visibility sensor, float64 [S, 2]."""


ENCODER_COLUMNS = encoders.COLUMNS
GNSS_COLUMNS = gnss.COLUMNS
IMU_COLUMNS = imu.COLUMNS
POSE_COLUMNS = pose.COLUMNS


class Frame(Struct, frozen=True):
    """Attachment of a raw sensor array; lists are indexed by slot, inactive slots hold zeros."""

    v: int
    type: str
    seq: int
    """Rig tick: counts every exchange of the rig, whatever the cases do."""
    active: list[bool]
    case: list[str]
    token: list[int]
    tick: list[int]
    """Case tick: 0 at reset."""
    sim_time_ns: list[int]
    dtype: str
    shape: list[int]
    encoding: str
    count: list[int] = []
    """Valid rows per slot where data is ragged; empty otherwise."""
    offset: int = -1
    """Position in the shared frame buffer; -1: the bytes are the payload [bytes]."""
    handle: bytes = b""
    """Handle of the GPU memory in which the array lies (CUDA IPC), written before the tick is
    published; empty: it lies elsewhere."""


class Tick(Struct, frozen=True):
    """Closes the sensor messages of one ``seq`` and names them."""

    v: int
    seq: int
    active: list[bool]
    token: list[int]
    tick: list[int]
    sim_time_ns: list[int]
    sensors: list[str]
    """Names of the sensor messages of this seq."""
    episodes: int
    """Number of episodes that start with this seq (published on the episode key before it)."""


class CameraSite(Struct, frozen=True):
    """A camera of the ego: where it sits, and how its pictures come about."""

    name: str
    message: str
    """Name of its pictures; its other messages have another kind before the dot."""
    width: int
    height: int
    hz: int
    hfov_deg: float
    position_m: list[float]
    """x forward of the vehicle's reference point, y left, z up [m]."""
    rotation_deg: list[float]
    """See :class:`schemas.sections.lens.CameraMount`."""
    lens: Lens


class LidarSite(Struct, frozen=True):
    """A lidar of the ego: where it sits, and how its points are ordered."""

    name: str
    message: str
    """Name of its messages."""
    hz: int
    channels: int
    columns: int
    """A message has channels x columns rows, see :data:`schemas.sections.lidar.POINT_COLUMNS`."""
    fields: list[str]
    """Names of a row's values."""
    position_m: list[float]
    """x forward of the vehicle's reference point, y left, z up [m]."""
    rotation_deg: list[float]
    """See :class:`schemas.sections.lidar.LidarMount`."""


class Episode(Struct, frozen=True):
    """A slot begins a case: everything the stack may know about it."""

    v: int
    seq: int
    slot: int
    token: int
    case: str
    """Name of the case, opaque and the same in every attempt; its own name if ``autonomy.tell``
    says so."""
    seed: int
    """Seed of the stack; the campaign's if ``autonomy.tell`` says so."""
    model: str
    perception: Perception
    camera: str
    width: int
    height: int
    hfov_deg: float
    control_period_ns: int
    cameras: list[CameraSite] = []
    """All cameras, the main one first."""
    lidars: list[LidarSite] = []
    device: str = "cpu"
    """Where the worker computes, ``cpu`` or ``cuda:N``: there a network may run, too."""
    files: dict[str, str] = {}
    """SHA-256 of the files that ``perception`` names, as they were at submission."""
    cosim: bool = False
    """Commands may hold poses; since 1.2."""
    ticks_per_rev: float = 0.0
    """Encoder ticks per revolution of a wheel; since 1.3."""

    @classmethod
    def of(
        cls,
        case: Case,
        *,
        seq: int,
        slot: int,
        token: int,
        cameras: list[CameraSite],
        lidars: list[LidarSite],
        device: str = "cpu",
    ) -> Episode:
        """``case`` begins; the stack knows it by another name and seed, unless it is told them."""
        return cls(
            v=SCHEMA_VERSION,
            seq=seq,
            slot=slot,
            token=token,
            case=stack_name(case),
            seed=stack_seed(case),
            model=case.variation.model,
            perception=case.variation.perception,
            camera=case.rig.camera.name,
            width=case.rig.camera.width,
            height=case.rig.camera.height,
            hfov_deg=case.rig.camera.hfov_deg,
            control_period_ns=1_000_000_000 // case.rig.control_hz,
            cameras=cameras,
            lidars=lidars,
            device=device,
            files=case.variation.files,
            cosim=case.rig.cosim,
            ticks_per_rev=case.variation.sensors.encoders.ppr * case.variation.sensors.encoders.cgr,
        )


class Detection(Struct, frozen=True):
    """One detected object; the box in pixels, x and y its upper left corner."""

    label: str
    confidence: float
    """Confidence, 0 to 1."""
    x_px: float
    y_px: float
    width_px: float
    height_px: float


class Lights(Struct, frozen=True):
    """Lamps that are on; ``indicators``: 0 off, 1 left, 2 right, 3 hazard."""

    low: bool = False
    high: bool = False
    parking: bool = False
    fog: bool = False
    indicators: Annotated[int, Meta(ge=0, le=3)] = 0


class SensorErrors(Struct, frozen=True):
    """Changes the errors of a slot's sensors from the next tick on, until changed again.

    Factors, 0 to 1000, of the amplitudes in the campaign file: 1 leaves them, 0 switches them off.
    """

    gnss_noise: float = 1.0
    gnss_bias: float = 1.0
    gnss_dropout: bool = False
    """No fix at all."""
    imu_noise: float = 1.0
    imu_bias: float = 1.0


COST_NAMES_MAX = 16
"""Most names in each map of a :class:`PerceptionCost`; what a stack names beyond is left out."""
COST_NAME_CHARS_MAX = 80
"""Longest of these names."""


class PerceptionCost(Struct, frozen=True):
    """What perception took: wall-clock time, so it never reaches a KPI."""

    runtime: str
    """What ran it, e.g. ``opencv cpu``."""
    frames: Ticks
    wall_s: float
    """Share of these frames in the time of the calls that they were part of [s]."""
    stages: dict[str, float] = {}
    """Wall time of what the stack does beside perception, by its own names for it [s]. Since
    1.4."""
    limited: dict[str, float] = {}
    """Sim time during which something limited its sensors, in its words [s]. Since 1.4."""


class Command(Struct, frozen=True):
    """What the stack asks of one slot's vehicle for the coming control period."""

    slot: int
    token: int
    tick: int
    throttle: float
    """Throttle, 0 to 1. Ranges are checked slot by slot (:func:`command_mistake`): a NaN in one
    slot must not take the message of the others with it."""
    brake: float
    """Brake, 0 to 1."""
    steering_rad: float
    """Road-wheel angle, left positive, -1.5 to 1.5 [rad]."""
    aeb: bool = False
    """Emergency braking is triggered."""
    lights: Lights = Lights()
    detections: list[Detection] = []
    sensors: SensorErrors | None = None
    """Errors of the sensors from now on; None: they stay as they are."""
    handbrake: float = 0.0
    """Handbrake, 0 to 1; since 1.1."""
    pose: Pose | None = None
    """Where the car is at the next tick, in a case of ``autonomy.cosim``; the pedals then do
    nothing. None: the simulator moves it. Since 1.2."""
    trigger: int | None = None
    """Place in ``detections`` of the one that this command begins to brake for; pictures mark it.
    None: no trigger in this tick, or the stack does not say. Since 1.3."""
    reverse: bool = False
    """The selector is in reverse: the throttle drives backwards once the car is as slow as a walk;
    a faster one coasts. Since 1.3."""
    warning: bool = False
    """The driver is warned of a collision; only noted. Since 1.4."""


class Commands(Struct, frozen=True):
    """One answer of the stack: commands of all active slots for ``seq``."""

    v: int
    seq: int
    commands: list[Command]
    error: str = ""
    """Why the stack cannot go on, which is its own doing; the case ends as ``failed`` with this
    reason."""
    refused: bool = False
    """Whether the error is that a file is not what the campaign was submitted with, so no case is
    charged. Since 1.3."""
    costs: list[PerceptionCost | None] = []
    """Costs of perception, one per command, None where no frame was looked at; empty: the stack
    does not measure it."""
    wall_s: float = 0.0
    """Time from the last sensor message to this answer; for benches, never a KPI [s]."""
    infrastructure: bool = False
    """The ``error`` is the machine's doing (no memory, a full disk, a lost connection): the attempt
    is repeated. Since 1.3."""


_COMMAND_RANGES = (
    *(("throttle", 0, 1), ("brake", 0, 1), ("steering_rad", -1.5, 1.5)),
    *(("handbrake", 0, 1),),
)


def command_mistake(command: Command) -> str:
    """What is wrong with a command's values, or an empty string."""
    for name, low, high in _COMMAND_RANGES:
        value = getattr(command, name)
        if not low <= value <= high:
            return f"command {name} is {value}, allowed: {low} to {high}"
    for detection in command.detections:
        for name in ("confidence", "x_px", "y_px", "width_px", "height_px"):
            if not math.isfinite(getattr(detection, name)):
                return f"detection {name} is {getattr(detection, name)}, allowed: finite numbers"
    if command.trigger is not None and not 0 <= command.trigger < len(command.detections):
        return (
            f"command trigger is {command.trigger}, allowed: the place of one of its "
            f"{len(command.detections)} detections, from 0"
        )
    if command.pose is not None and (mistake := pose_mistake(command.pose)):
        return mistake
    if command.sensors is not None:
        for name in command.sensors.__struct_fields__:
            value = getattr(command.sensors, name)
            if not isinstance(value, bool) and not 0 <= value <= 1000:
                return f"command sensors.{name} is {value}, allowed: 0 to 1000"
    return ""


class Ready(Struct, frozen=True):
    """Handshake, repeated by each side every 50 ms until answered."""

    v: int
    role: Literal["simulator", "stack"]
    rig: str
    slots: int
    frames: str = ""
    """Path of a Unix socket that hands out the descriptor of the shared frame buffer (offered by
    the simulator), or empty. Before 1.4: the path of the buffer."""
    frames_bytes: int = 0
    nonce: str = ""
    """Text in the buffer's first bytes; it proves that both sides mapped the same memory."""
    shared: bool = False
    """The stack mapped the buffer; otherwise frames travel as payload."""
    gpu: str = ""
    """GPU on which the simulator's frames lie, ``cuda:N``, if it can share them (offered)."""
    gpu_handle: bytes = b""
    """Handle of a few bytes there that begin with :attr:`gpu_nonce`."""
    gpu_nonce: str = ""
    on_gpu: bool = False
    """The stack opened the handle and takes frames in the GPU's memory."""
    seen: bool = False
    """The other side's ``ready`` has arrived."""
    minor: int = 0
    """Minor version of the drive plane that this side speaks, see :data:`schemas.DRIVE_MINOR`."""
    refused: str = ""
    """Why the stack is refused: it is not what the campaign was submitted with; the rig ends with
    this reason, and no case is charged. Since 1.3."""
    reads: list[str] | None = None
    """Sensor messages that the stack looks at, by name; it gets no others, and what nobody looks at
    is not made. None: all. Since 1.5."""
