"""Messages of the view plane (simulator -> recorders and viewers), one case each.

The view plane only looks: it is produced while somebody subscribes, dropped when nobody keeps up,
and never read by anything that decides. Within an attempt every recorded sample carries a running
number ``seq``, so that the recorder knows what it has missed; samples for live viewers, which are
meant to have gaps, carry :data:`UNNUMBERED`.
"""

from __future__ import annotations

from msgspec import Struct

from schemas.kinds.sensor import PointsLook
from schemas.messages import CameraSite, Detection, LidarSite, Lights
from schemas.sections.view_mode import Keep
from schemas.sections.view_mode import ViewMode as ViewMode
from schemas.verdict import Judged

UNNUMBERED = -1
"""``seq`` of a sample for live viewers."""

POINTS_MAX = 10_000
"""Most points of a lidar that a live viewer is shown of one sweep."""

POINT_CM = 0.01
"""Unit of the coordinates in a :class:`PointsSample`, which reach to 327 m [m]."""


class ImageBox(Struct, frozen=True):
    """A ground-truth box, in pixels; x and y are its upper left corner."""

    label: str
    x_px: float
    y_px: float
    width_px: float
    height_px: float
    distance_m: float


class Controls(Struct, frozen=True):
    """The stack's command of a tick."""

    throttle: float
    brake: float
    steering_rad: float
    aeb: bool
    lights: Lights
    detections: list[Detection]
    trigger: int | None = None
    """Place in ``detections`` of the one that emergency braking begins for; None: no trigger in
    this tick, or the stack does not say."""


class Stage(Struct, frozen=True):
    """What stands still, for 3D views; lengths in metres."""

    lane: list[list[float]]
    """Centre line of the ego's lane, from its start on: world x, y and heading [rad]; at least two
    places, straight between them. A closed road ends where it begins."""
    lane_width_m: float
    parking_width_m: float
    sidewalk_width_m: float
    obstacle_center_m: list[float]
    """Centre of the obstacle's hull, world x, y, z; empty: there is none."""
    obstacle_yaw_rad: float
    obstacle_size_m: list[float]
    """Length, width and height."""
    ego_center_m: list[float]
    """Centre of the ego's hull, from its rear axle on the ground."""
    ego_size_m: list[float]
    camera_m: list[float]
    """Camera, from the ego's rear axle on the ground."""
    hulls: list[list[float]] = []
    """Everything else one can hit: world x, y, yaw [rad], half length, half width; cars first."""
    cars: int = 0
    """How many of the hulls are parked cars."""
    lane_z_m: list[float] = []
    """Height of each place of the lane; empty: all are at 0."""


class RowsSite(Struct, frozen=True):
    """A sensor whose rows are drawn as points: their columns, and where it sits on the ego."""

    columns: list[str]
    look: PointsLook
    position_m: list[float]
    """x forward of the vehicle's reference point, y left, z up [m]."""
    rotation_deg: list[float]
    """Roll, pitch and yaw; see :class:`schemas.sections.lidar.LidarMount`."""


class CaseStart(Struct, frozen=True):
    """An attempt begins."""

    v: int
    seq: int
    token: int
    campaign: str
    case: str
    attempt: int
    folder: str
    """Attempt folder, as the worker sees it."""
    model: str
    weather: str
    time_of_day_min: int
    scene: str
    vehicle: str
    seed: int
    control_hz: int
    camera: str
    width: int
    height: int
    hfov_deg: float
    stage: Stage
    cameras: list[CameraSite] = []
    """All cameras of the ego that see, the main one first; live only."""
    lidars: list[LidarSite] = []
    grids: list[str] = []
    """Sensors whose grids are drawn as pictures; live only."""
    rig: str = ""
    """Rig whose feed it comes from; live only."""
    scene_sha256: str = ""
    """SHA-256 of the :class:`SceneMesh` that the rig's feed hands out; live only."""
    sensors: dict[str, list[str]] = {}
    """Sensors with a row of numbers -> names of their columns."""
    rows: dict[str, RowsSite] = {}
    """Sensors whose rows are drawn as points."""
    keep: Keep = "all"
    """Whether a recorder keeps its file, which is decided at the end."""


class StateSample(Struct, frozen=True):
    """One control tick: a KPI row, and what camera and stack saw. Missing is None, never 0."""

    v: int
    seq: int
    token: int
    tick: int
    sim_time_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    accel_mps2: float
    dtc_m: float | None
    """Distance to collision; None: nothing stands in the lane."""
    ttc_s: float | None
    collisions: int
    controls: Controls | None
    """Command of the tick; None in the last row: the case has ended, nothing was asked."""
    boxes: list[ImageBox] | None
    """Boxes of the tick's frame; None: no frame was due."""
    movers: list[list[float]] = []
    """Objects that move by script: world x, y, z of the ground below, yaw [rad], half length, half
    width, height [m]."""
    z_m: float | None = None
    """Height of the ego's reference point; None: not known, as in messages of earlier releases."""
    pitch_rad: float = 0.0
    """Of the ego, nose down positive."""
    roll_rad: float = 0.0
    """Of the ego, to the right positive."""
    mover_tilts: list[list[float]] = []
    """Pitch (nose down positive) and roll (to the right positive) of each of :attr:`movers`, about
    its own axes [rad]; empty: all stand level, as in messages of earlier releases."""
    hand: str = ""
    """Intervention in the case: ``by hand``, ``paused``, ``steered``; empty: nothing."""
    sensors: dict[str, list[float]] = {}
    """Readings of the sensors that were due, columns as :attr:`CaseStart.sensors` says."""
    rows: dict[str, list[list[float]]] = {}
    """Rows of the sensors that were due, columns as :attr:`CaseStart.rows` says."""


class CameraSample(Struct, frozen=True):
    """Attachment of a camera picture; the payload is a JPEG."""

    v: int
    seq: int
    token: int
    tick: int
    sim_time_ns: int


class PointsSample(Struct, frozen=True):
    """Attachment of a lidar's points, thinned for live viewers.

    The payload is little-endian int16 [N, 4]: x, y, z in sensor axes in units of
    :data:`POINT_CM`, intensity 0 to 255. Rays without a return and points farther away than the
    unit reaches are left out.
    """

    v: int
    token: int
    tick: int
    sim_time_ns: int
    stride: int
    """Step between the rays that were looked at."""


class SceneMesh(Struct, frozen=True):
    """The standing world as triangles, coloured for the eye; every rig of a scene has the same.

    ``data`` is zlib over: little-endian float32 [V, 3] world positions [m], uint32 [F, 3] faces,
    uint8 [V, 3] sRGB colours.
    """

    v: int
    sha256: str
    """SHA-256 of the uncompressed data, hexadecimal."""
    vertices: int
    faces: int
    data: bytes


class CaseEnd(Judged, frozen=True):
    """An attempt ended with a result, or (``outcome`` empty) without one."""

    v: int
    seq: int
    token: int
    sim_time_ns: int
    outcome: str
    verdict: str
    reasons: list[str]
    scalars: dict[str, float | int | None]
    samples: int
    """Samples of this attempt, this one included: ``seq`` ran from 0 to ``samples`` - 1."""


class RecorderSample(Struct, frozen=True, omit_defaults=True):
    """What a recorder gets of an attempt, one thing at a time: the others are None."""

    start: CaseStart | None = None
    camera: CameraSample | None = None
    jpeg: bytes = b""
    """The picture of ``camera``."""
    state: StateSample | None = None
    end: CaseEnd | None = None


class RecorderBatch(Struct, frozen=True):
    """Samples of a rig's attempts in the order in which they arose, many in one message: a message
    costs both sides more than what is in it."""

    v: int
    samples: list[RecorderSample]


class Thumbnail(Judged, frozen=True):
    """Attachment of a small picture of a running or just ended case; the payload is a JPEG.

    Complete in itself: who comes late knows the case from its next thumbnail.
    """

    v: int
    seq: int
    token: int
    campaign: str
    case: str
    attempt: int
    model: str
    weather: str
    time_of_day_min: int
    sim_time_ns: int
    speed_mps: float
    dtc_m: float | None
    """Distance to collision; None: nothing stands in the lane."""
    aeb: bool
    outcome: str = ""
    """Outcome of the case; empty: it is running."""
    verdict: str = ""
    hand: str = ""
    """Intervention in the case: ``by hand``, ``paused``, ``steered``; empty: nothing."""
    rig: str = ""
    """Rig whose feed it comes from; empty: of an earlier release."""
    at_s: float | None = None
    """When the simulator was at :attr:`sim_time_ns`, by its rig's clock, see :class:`ClockReading`
    [s]; None: of an earlier release."""


class ClockReading(Struct, frozen=True):
    """A rig's own clock, for viewers that want to know how old a picture is. No result has it."""

    v: int
    rig: str
    clock_s: float
    """Seconds since some moment; it neither jumps nor is set."""


class FeedEnd(Struct, frozen=True):
    """A rig's view feed ends; nothing comes after it."""

    v: int
    rig: str


def clock(time_of_day_min: int) -> str:
    """Minutes after midnight -> ``HH:MM``."""
    return f"{time_of_day_min // 60:02d}:{time_of_day_min % 60:02d}"
