"""Messages of the drive plane (simulator - stack) and of the control plane (worker - conductor).

All are frozen; on the wire they are MessagePack maps (see :mod:`schemas.wire.codec`).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from schemas import SCHEMA_VERSION
from schemas.case import Case
from schemas.identity import stack_name, stack_seed
from schemas.kinds.sensors import encoders, gnss, imu, pose
from schemas.sections.lens import Lens
from schemas.sections.perception import Perception
from schemas.verdict import Judged
from schemas.wire.bounds import (
    ENTRIES_MAX,
    SEALED_MAX,
    Count,
    Int64,
    Priority,
    Progress,
    Session,
    Ticks,
    Token,
    TokenText,
    Whole,
)
from schemas.wire.pose import Pose as Pose
from schemas.wire.pose import pose_mistake
from schemas.wire.realtime import Realtime

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
"""Columns of a box message, float32 [S, B, 7]; x and y are the box's upper left corner."""

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
    """Of the GPU memory in which the array lies (CUDA IPC), written before the tick is published;
    empty: it lies elsewhere."""


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
    """Opaque, the same in every attempt; the case's name if ``autonomy.tell`` says so."""
    seed: int
    """The stack's own; the campaign's if ``autonomy.tell`` says so."""
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
    """0 to 1."""
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


class PerceptionCost(Struct, frozen=True):
    """What perception took: wall-clock time, so it never reaches a KPI."""

    runtime: str
    """What ran it, e.g. ``opencv cpu``."""
    frames: Ticks
    wall_s: float
    """Share of these frames in the time of the calls that they were part of [s]."""


class Command(Struct, frozen=True):
    """What the stack asks of one slot's vehicle for the coming control period."""

    slot: int
    token: int
    tick: int
    throttle: float
    """0 to 1. Ranges are checked slot by slot (:func:`command_mistake`): a NaN in one slot must
    not take the message of the others with it."""
    brake: float
    """0 to 1."""
    steering_rad: float
    """Road-wheel angle, left positive, -1.5 to 1.5 [rad]."""
    aeb: bool = False
    """Emergency braking is triggered."""
    lights: Lights = Lights()
    detections: list[Detection] = []
    sensors: SensorErrors | None = None
    """None: the errors of the sensors stay as they are."""
    handbrake: float = 0.0
    """0 to 1; since 1.1."""
    pose: Pose | None = None
    """Where the car is at the next tick, in a case of ``autonomy.cosim``; the pedals then do
    nothing. None: the simulator moves it. Since 1.2."""
    trigger: int | None = None
    """Place in ``detections`` of the one that this command begins to brake for; pictures mark it.
    None: no trigger in this tick, or the stack does not say. Since 1.3."""
    reverse: bool = False
    """The selector is in reverse: the throttle drives backwards once the car is as slow as a walk;
    a faster one coasts. Since 1.3."""


class Commands(Struct, frozen=True):
    """One answer of the stack: commands of all active slots for ``seq``."""

    v: int
    seq: int
    commands: list[Command]
    error: str = ""
    """Not empty: the stack cannot go on, which is its own doing; the case ends as ``failed`` with
    this reason."""
    refused: bool = False
    """With an error: because a file is not what the campaign was submitted with, so no case is
    charged. Since 1.3."""
    costs: list[PerceptionCost | None] = []
    """One per command, None where no frame was looked at; empty: the stack does not measure it."""
    wall_s: float = 0.0
    """From the last sensor message to this answer; for benches, never a KPI [s]."""
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
    """Stands in the buffer's first bytes; proves that both sides mapped the same memory."""
    shared: bool = False
    """The stack mapped the buffer; otherwise frames travel as payload."""
    gpu: str = ""
    """GPU on which the simulator's frames lie, ``cuda:N``, if it can share them (offered)."""
    gpu_handle: bytes = b""
    """Of a few bytes there that begin with :attr:`gpu_nonce`."""
    gpu_nonce: str = ""
    on_gpu: bool = False
    """The stack opened the handle and takes frames in the GPU's memory."""
    seen: bool = False
    """The other side's ``ready`` has arrived."""
    minor: int = 0
    """Minor version of the drive plane that this side speaks, see :data:`schemas.DRIVE_MINOR`."""
    refused: str = ""
    """Not empty: the stack is not what the campaign was submitted with; the rig ends with this
    reason, and no case is charged. Since 1.3."""


# --- control plane ------------------------------------------------------------------------------

Outcome = Literal["verdict", "failed", "unresolved", "cancelled"]
"""Terminal outcomes of a case; exactly one each."""

Release = Literal[
    "released",
    "walltime",
    "crash",
    "deadline",
    "out_of_memory",
    "suspect",
    "lost",
    "intervened",
    "refused",
]
"""Why an attempt ended without a result; ``intervened``: an intervention has changed it;
``refused``: a file that it needs is not what the campaign was submitted with."""


ATTEMPT_DIR = r"^(cases/[A-Za-z0-9_][A-Za-z0-9_.-]{0,254}/attempt-[0-9]{1,9})?\Z"
"""The one form of an attempt folder's name: nobody can commit a path that leads elsewhere."""


class Touch(Struct, frozen=True):
    """Last intervention in an attempt."""

    tick: Ticks
    what: str
    """In a few words."""
    changes: Count
    """Actions so far that cost the case its verdict; 0: it keeps it."""


class Result(Judged, Struct, frozen=True):
    """A finished attempt, ready to be committed."""

    campaign: str
    case: str
    token: Token
    outcome: Literal["verdict", "failed"]
    verdict: str
    """``pass``, ``collision``, ``false_braking``, ``lane_departure``, ``time_up``; the reason for
    ``failed``."""
    scalars: dict[str, float | Int64 | None] = {}
    reasons: list[str] = []
    names: dict[str, str] = {}
    """Scalars that are names, :data:`schemas.files.kpi.NAMES`."""
    attempt_dir: Annotated[str, Meta(pattern=ATTEMPT_DIR)] = ""
    """Attempt folder, relative to the campaign folder."""
    kpi_sha256: str = ""
    """Of the values in its KPI file; empty: it has none."""
    manifest_sha256: str = ""
    wall_s: float = 0.0
    perception: PerceptionCost | None = None
    """Sum over the case; None: the stack reported none."""
    rig_wall_s: float = 0.0
    """The rig's wall time, each tick divided evenly among the cases in its slots [s]."""
    realtime: Realtime | None = None
    """How it went by the wall clock; None: in lockstep."""
    protection: str = ""
    """What kept the stack from the machine, as :mod:`twin.worker.protection` says it; empty: there
    was no stack."""


class Ended(Struct, frozen=True):
    """A lease given back without a result."""

    campaign: str
    case: str
    token: Token
    reason: Release
    detail: str = ""


class Lease(Struct, frozen=True):
    """The right to run one case, until the token is committed, released or expires."""

    token: Token
    attempt: Count
    out: str
    """Campaign folder."""
    case: Case
    alone: bool = False
    """Run it alone in a fresh rig (its last rig died)."""


def noop_result(lease: Lease) -> Result:
    """What ``simulator: noop`` says of a case: a test of the scheduling, which reports refuse."""
    return Result(
        campaign=lease.case.variation.campaign,
        case=lease.case.id,
        token=lease.token,
        outcome="verdict",
        verdict="pass",
    )


class Sealed(Struct, frozen=True):
    """A result that has outlived its worker, for whoever delivers it; nobody can change it."""

    token: Token
    worker: str
    """Whose result it is."""
    result: bytes
    """A :class:`Result`, encoded."""
    seal: bytes
    """Over :attr:`result`, with the secret of that worker's session."""


class Share(Struct, frozen=True):
    """Which cases of a campaign a worker prefers, among several that work side by side.

    Campaigns are cut into as many stretches as there are workers on a device: neighbours in a
    matrix are alike, and networks like many pictures of one case each. Every stretch is dealt out
    to the devices case by case, so that all have the same to do.
    """

    stretch: Count
    stretches: Count
    device: Count
    devices: Count

    def __post_init__(self) -> None:
        if not (0 <= self.stretch < self.stretches and 0 <= self.device < self.devices):
            raise ValueError(
                f"stretch {self.stretch} of {self.stretches}, device {self.device} of "
                f"{self.devices}: both count from 0"
            )


class Hello(Struct, frozen=True, tag_field="verb", tag="hello"):
    """A worker introduces itself: one incarnation, never reused."""

    v: int
    worker: str
    host: str
    pid: Count
    device_class: str
    software: str
    """Software digest."""
    slots: Count
    walltime_end_s: float | None = None
    """When the worker's allocation ends [s since 1970]; information only."""
    memory_bytes: Whole | None = None
    """Most that its rig may use [bytes]; None: no limit."""
    tags: list[str] = []
    """What campaigns may ask for, see :class:`schemas.campaign.Requirements`."""
    share: Share | None = None
    """None: it prefers none."""
    lacks: dict[str, str] = {}
    """Bridges that cannot run there, and the word ``sandbox`` if stacks have none there, with what
    to do, in a line."""
    session: Session = b""
    """Secret of 32 bytes that this process alone knows; every later request shows it again."""


class Next(Struct, frozen=True, tag_field="verb", tag="next"):
    """Commit what is finished and ask for up to ``k`` cases, in one round trip."""

    v: int
    worker: str
    seq: Whole
    k: Count
    rig: str = ""
    """Rig key of the running rig; its cases are preferred."""
    results: Annotated[list[Result], Meta(max_length=ENTRIES_MAX)] = []
    ended: Annotated[list[Ended], Meta(max_length=ENTRIES_MAX)] = []
    held: Annotated[list[Token], Meta(max_length=ENTRIES_MAX)] = []
    """Tokens that the worker holds; a lease of this worker that is not listed was lost on the
    way."""
    remaining_s: float | None = None
    """Walltime left for cases [s]; None: no end is known."""
    session: Session = b""
    sealed: Annotated[list[Sealed], Meta(max_length=SEALED_MAX)] = []
    """Results of earlier workers, which the conductor has not got."""


class Beat(Struct, frozen=True, tag_field="verb", tag="beat"):
    """Heartbeat: tokens held and the progress counter of each."""

    v: int
    worker: str
    held: Annotated[dict[TokenText, Progress], Meta(max_length=ENTRIES_MAX)]
    """Token (decimal) -> progress (case ticks)."""
    touched: Annotated[dict[TokenText, Touch], Meta(max_length=ENTRIES_MAX)] = {}
    """Token (decimal) -> last intervention in it since the last beat that was answered."""
    session: Session = b""


class Bye(Struct, frozen=True, tag_field="verb", tag="bye"):
    """The worker leaves; every lease it holds is given back."""

    v: int
    worker: str
    detail: str = ""
    session: Session = b""


class Submit(Struct, frozen=True, tag_field="verb", tag="submit"):
    """Submit a campaign; the same campaign again is a resume."""

    v: int
    campaign: dict[str, Any]
    """The campaign file's content."""
    software: str = ""
    out: str = ""
    """Campaign folder, absolute; empty: a folder of the campaign's name in the state folder."""
    priority: Priority = 0
    """Campaigns of a higher one are served first; equals share the workers."""


class Control(Struct, frozen=True, tag_field="verb", tag="control"):
    """Act on a campaign, one case of it (``case`` not empty), or a worker (``drain``)."""

    v: int
    action: Literal["pause", "resume", "cancel", "retry", "drain"]
    campaign: str = ""
    case: str = ""
    worker: str = ""


class Explain(Struct, frozen=True, tag_field="verb", tag="explain"):
    """Ask why a case waits, runs or ended; the answer is ``Reply.status["explain"]``, a list."""

    v: int
    campaign: str
    case: str


class StatusRequest(Struct, frozen=True, tag_field="verb", tag="status", omit_defaults=True):
    """Ask for the conductor's state."""

    v: int
    running: bool = False
    """Also for the cases that run now, which may be thousands."""


class Stop(Struct, frozen=True, tag_field="verb", tag="stop"):
    """Ask the conductor to stop serving; workers are told to drain."""

    v: int


Request = Hello | Next | Beat | Bye | Submit | Control | Explain | StatusRequest | Stop


class Reply(Struct, frozen=True):
    """Answer to any request; ``error`` not empty: refused, with the reason."""

    v: int
    epoch: Count
    error: str = ""
    ttl_s: float = 0.0
    seq: Whole = 0
    acks: list[Token] = []
    """Tokens whose result is settled (committed, already committed, or fenced)."""
    fenced: list[Token] = []
    leases: list[Lease] = []
    left: Count = 0
    """Cases not yet ended."""
    drain: bool = False
    retry_after_s: float = 0.0
    lost: list[Token] = []
    """Tokens that are no longer valid: stop working on them."""
    status: dict[str, Any] = {}
