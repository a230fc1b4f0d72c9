"""Signals of a road file: posts, plates and traffic lights.

A signal lies in its own axes: it faces -x, towards the traffic that it is for, with its plate or
the middle of its head at its s and t and the lower edge ``zOffset`` above the road's surface.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from twin.road.beside.bodies import body_axes
from twin.road.beside.paint import lane_height
from twin.road.beside.placing import REACH_MAX_M
from twin.road.opendrive.furniture import RoadSignal
from twin.road.opendrive.records import DRIVEN_TYPES
from twin.road.opendrive.road_frame import RoadFrame
from twin.road.opendrive.road_map import RoadMap
from twin.world.meshes import materials
from twin.world.meshes.mesh import MeshBuilder
from twin.world.roadside.objects import CLEAR_M, RoadsideHulls, check_points
from twin.world.roadside.plates import SignPicture, picture_of
from twin.world.roadside.traffic_light import HEAD_M, WALK_HEAD_M, add_head, head_deep_m
from twin.world.street.signs import GREY

SIGNALS_MAX = 5_000
"""Most signals of a network that are drawn."""
_POST_M = 0.04
"""Radius of a post [m]."""
_MAST_M = 0.08
_ROOT_M = 0.3
"""How far posts reach into the ground [m]."""
_BESIDE_M = 0.5
"""How far a mast stands from the roadway [m]."""
_MAST_BEHIND_M = 0.25
"""How far the axis of a mast stands behind its signal [m]."""
_SHEET_M = 0.006
_BEHIND_M = 0.06
"""How far the axis of a post lies behind a plate or a head [m]."""
_SIZE_MAX_M = 20.0
_PAINTED = frozenset({"293", "294", "295", "296", "297", "298", "299", "340", "341"})
"""Signs of the German catalogue that are marks on the road."""
_LIGHT = re.compile(r"10000\d\d")
_WALK_LIGHT = "1000002"
_PASSED = DRIVEN_TYPES | {"shoulder", "stop", "parking", "biking", "median", "restricted", "border"}
"""Lanes that the arm of a mast reaches over."""


@dataclass(slots=True)
class RoadSignals:
    """What signals bring into a world besides faces."""

    standing: RoadsideHulls = field(default_factory=RoadsideHulls)
    plates: int = 0
    """How many instances of class ``traffic_sign`` there are."""
    lights: dict[str, int] = field(default_factory=dict)
    """Signals with lamps: their numbers by id. Equal ids of several roads are one."""


@dataclass(frozen=True, slots=True)
class _Seat:
    """Where a signal stands."""

    x_m: float
    y_m: float
    z_m: float
    """Of its lower edge."""
    yaw_rad: float
    ground_m: float
    """Height of the surface below it, world."""
    height_m: float
    """Of its plate or head."""
    deep_m: float
    """Half the depth of its head; 0 of a plate."""

    @property
    def post_m(self) -> tuple[float, float]:
        """World x, y of the axis of its post."""
        behind = self.deep_m + _BEHIND_M
        ahead = body_axes(self.yaw_rad, 0.0, 0.0)[0]
        return self.x_m + behind * float(ahead[0]), self.y_m + behind * float(ahead[1])


def add_signals(mesh: MeshBuilder, roads: RoadMap, first_instance: int) -> RoadSignals:
    """Add all signals of a road file that stand beside or above it.

    Args:
        mesh: receives their faces.
        roads: the roads.
        first_instance: number of the first plate.

    Raises:
        ValueError: there are too many; one line.
    """
    result = RoadSignals()
    signals = [
        (frame, signal)
        for frame in roads.frames.values()
        for signal in frame.road.signals
        if not is_paint(signal)
    ]
    if len(signals) > SIGNALS_MAX:
        raise ValueError(
            f"{roads.network.file}: {len(signals)} signals, at most {SIGNALS_MAX} are shown; "
            "use a part of it"
        )
    posts: dict[tuple[str, float, float], tuple[RoadFrame, RoadSignal, _Seat]] = {}
    for frame, signal in signals:
        try:
            seat = _add_signal(mesh, frame, signal, first_instance, result)
        except ValueError as error:
            raise ValueError(f"{roads.network.file}:{signal.line}: <signal>: {error}") from None
        key = frame.road.id, round(signal.s_m, 2), round(signal.t_m, 2)
        if key not in posts or seat.z_m + seat.height_m > _top(posts[key][2]):
            posts[key] = frame, signal, seat
    check_points(mesh, roads.network.file)
    for frame, signal, seat in posts.values():
        _add_post(mesh, frame, signal, seat, result.standing)
    return result


def is_paint(signal: RoadSignal) -> bool:
    """Whether a signal is a mark on the road, which no post carries."""
    return signal.country.upper() in ("DE", "GER", "OPENDRIVE", "") and signal.type in _PAINTED


def is_light(signal: RoadSignal) -> bool:
    """Whether a signal has lamps."""
    return bool(_LIGHT.fullmatch(signal.type)) or signal.dynamic


def _top(seat: _Seat) -> float:
    return seat.z_m + seat.height_m


def _seat(frame: RoadFrame, signal: RoadSignal, height_m: float, deep_m: float = 0.0) -> _Seat:
    s = min(signal.s_m, frame.road.length_m)
    pose = frame.pose(s, signal.t_m)
    yaw = float(pose.heading_rad) + signal.h_offset_rad
    if signal.orientation == "-":
        yaw += np.pi
    lift = float(lane_height(frame, np.array([s]), np.array([signal.t_m]))[0])
    x, y, z = float(pose.x_m), float(pose.y_m), float(pose.z_m)
    if max(abs(x), abs(y), abs(z + signal.z_offset_m)) > REACH_MAX_M:
        raise ValueError(f"it lies more than {REACH_MAX_M} m from the origin")
    return _Seat(x, y, z + signal.z_offset_m, yaw, z + lift, height_m, deep_m)


def _add_signal(
    mesh: MeshBuilder,
    frame: RoadFrame,
    signal: RoadSignal,
    first_instance: int,
    result: RoadSignals,
) -> _Seat:
    if is_light(signal):
        walk = signal.type == _WALK_LIGHT
        usual = WALK_HEAD_M if walk else HEAD_M
        height = min(signal.height_m or usual, _SIZE_MAX_M)
        seat = _seat(frame, signal, height, head_deep_m(height, walk=walk))
        number = result.lights.setdefault(signal.id, len(result.lights))
        seated = mesh.place(seat.x_m, seat.y_m, seat.yaw_rad, z_m=seat.z_m)
        with seated, mesh.label("pole"):
            add_head(mesh, seat.height_m, number, walk=walk)
        return seat
    picture = picture_of(signal)
    width, height = picture.size_m
    size = min(signal.width_m or width, _SIZE_MAX_M), min(signal.height_m or height, _SIZE_MAX_M)
    seat = _seat(frame, signal, size[1])
    instance = first_instance + result.plates
    result.plates += 1
    seated = mesh.place(seat.x_m, seat.y_m, seat.yaw_rad, z_m=seat.z_m)
    with seated, mesh.label("traffic_sign", instance):
        _add_plate(mesh, picture, size)
    return seat


def _add_plate(mesh: MeshBuilder, picture: SignPicture, size_m: tuple[float, float]) -> None:
    """The sheets of a picture, scaled to a size, with its lower edge at z = 0."""
    width, height = picture.size_m
    scale = np.array((size_m[0] / width, size_m[1] / height))
    lift = np.array((0.0, 0.5 * size_m[1] - picture.middle_m * scale[1]))
    x = 0.0
    back = picture.sheets[0].outline * scale * (-1.0, 1.0) + lift
    mesh.polygon(back, x, materials.PLAIN, GREY, front=1.0)
    for sheet in picture.sheets:
        x -= _SHEET_M * sheet.lifted
        mesh.polygon(sheet.outline * scale + lift, x, materials.SIGN, sheet.color)


def _add_post(
    mesh: MeshBuilder,
    frame: RoadFrame,
    signal: RoadSignal,
    seat: _Seat,
    standing: RoadsideHulls,
) -> None:
    """A post below a signal, or a mast beside the roadway with an arm to it."""
    name = signal.name or f"signal {signal.id}"
    s = min(signal.s_m, frame.road.length_m)
    aside = _mast_t(frame, signal, s)
    if seat.z_m - seat.ground_m < CLEAR_M:
        aside = None  # low ones stand on the roadway themselves, such as on an island
    post = seat.post_m
    if aside is None:
        foot, top = (*post, seat.ground_m - _ROOT_M), (*post, max(_top(seat), seat.ground_m + 0.1))
        with mesh.label("pole"):
            mesh.tube(foot, top, (_POST_M, _POST_M), 8, materials.PLAIN, GREY)
        hull = (*post, seat.yaw_rad, _POST_M, _POST_M)
        standing.add(name, "traffic_sign", [hull])
        return
    pose = frame.pose(s, aside)
    lift = float(lane_height(frame, np.array([s]), np.array([aside]))[0])
    # A lower signal beside the roadway hangs before the mast.
    behind = _MAST_BEHIND_M * body_axes(seat.yaw_rad, 0.0, 0.0)[0]
    x, y = float(pose.x_m) + float(behind[0]), float(pose.y_m) + float(behind[1])
    ground = float(pose.z_m) + lift
    level = _top(seat) + 0.12
    with mesh.label("pole"):
        foot, top = (x, y, ground - _ROOT_M), (x, y, level + 0.2)
        mesh.tube(foot, top, (_MAST_M * 1.4, _MAST_M), 8, materials.PLAIN, GREY)
        arm = (*post, level)
        mesh.tube((x, y, level), arm, (0.06, 0.045), 8, materials.PLAIN, GREY)
        hook = (*post, seat.z_m + 0.5 * seat.height_m)
        mesh.tube(arm, hook, (0.03, 0.03), 6, materials.PLAIN, GREY)
    standing.add(name, "traffic_sign", [(x, y, seat.yaw_rad, _MAST_M, _MAST_M)])


def _mast_t(frame: RoadFrame, signal: RoadSignal, s: float) -> float | None:
    """Where the mast of a signal above the roadway stands, t; None: it stands beside it.

    It is the nearer edge of the roadway; if both are as near, that to the right of the traffic.
    """
    at = np.array([s])
    section = frame.sections[int(frame.section_at(at)[0])]
    lane_id = int(frame.lane_at(at, np.array([signal.t_m]))[0])
    lane = section.section.lane(lane_id)
    if lane is None or lane.type not in DRIVEN_TYPES:
        return None
    borders = section.borders(np.clip(at, section.section.start_m, None))
    lanes = list(section.section.lanes)
    index = next(k for k, other in enumerate(lanes) if other.id == lane_id)
    sides = []
    for step in (-1, 1):
        k = index
        while 0 <= k + step < len(lanes) and lanes[k + step].type in _PASSED:
            k += step
        edge = _edge(borders, lanes[k].id, left=step < 0)
        sides.append(edge + (_BESIDE_M if step < 0 else -_BESIDE_M))
    left, right = sides
    apart = abs(left - signal.t_m) - abs(right - signal.t_m)
    to_right = signal.orientation != "-" if abs(apart) < 0.01 else apart > 0.0
    return right if to_right else left


def _edge(borders: dict[int, np.ndarray], lane_id: int, *, left: bool) -> float:
    """t of the left or right border of a lane."""
    if lane_id > 0:
        return float(borders[lane_id if left else lane_id - 1][0])
    return float(borders[lane_id + 1 if left else lane_id][0])
