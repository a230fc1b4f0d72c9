"""A contact sheet: one picture per weather and time of day, as a PNG."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import cv2
import numpy as np
import warp as wp

from schemas.campaign import Camera
from schemas.case import Case
from schemas.files.yaml_file import parse_yaml
from schemas.identity import stream_key
from schemas.kinds.registry import implementation
from schemas.kinds.scenario import scenario_kinds
from schemas.messages import Lights
from schemas.names import WEATHERS, TimeOfDay, minutes
from schemas.plan import parse_plan
from schemas.sections.environment import Environment, environment_mistakes
from schemas.validation import Mistake, convert_all
from twin.base.progress import counter, steps
from twin.render.camera import RayCamera
from twin.render.light.light import begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.trace.geometry import Geometry
from twin.road.opendrive.records import DRIVEN_TYPES
from twin.road.opendrive.road_frame import RoadPose
from twin.scenario import families
from twin.scenario.storyboard.native.document import shipped_scenarios
from twin.scenario.surroundings import place_before
from twin.sensors.drawn import DrawnSensors, check_drawn
from twin.vehicle.columns import COLUMN, TELEMETRY, columns
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.road_scene import road_map
from twin.world.scene import Scene, load_scene
from twin.world.sky.environment import light_of, wind_towards
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.sky.sun import Daylight
from twin.world.sky.weather import WeatherParameters, weather_of
from twin.world.street.build import World, build_world

HOURS = ("00:00", "06:05", "06:50", "09:00", "12:00", "16:00", "18:25", "18:58")
"""Local times of the usual sheet: night, dawn, sunrise, day, sunset and dusk of an equinox."""

ALL = "all"
"""Stands for all shipped scenarios."""

_PLAIN = Environment()
_ENCODING = {".png": [], ".jpg": [cv2.IMWRITE_JPEG_QUALITY, 88]}
_LABEL_PX = 22
_COLUMNS = 3
"""Pictures of scenarios in a row."""
_NIGHT_BELOW_LX = 1000.0
_INTO_ROAD_M = 20.0


def usual_lights(weather: str, illuminance_lx: float) -> Lights:
    """Lamps that a careful driver has on, after the original's rule for night and fog."""
    fog = "fog" in weather
    if illuminance_lx < _NIGHT_BELOW_LX:
        return Lights(low=fog, high=not fog, parking=True, fog=fog)
    return Lights(parking=True, fog=fog)


def contact_sheet(
    path: str | Path,
    weathers: Sequence[str] = WEATHERS,
    times: Sequence[str] = HOURS,
    *,
    environment: Environment = _PLAIN,
    distance_m: float = 25.0,
    at_m: float | None = None,
    camera: Camera | None = None,
    scene: str = "downtown",
    road: str = "",
    scenario: str = "",
    at_s: float = 0.0,
    vehicle: str = "opencav",
    device: str = "cpu",
    lights: Lights | None = None,
    sensors: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> None:
    """Render a sheet of ``weathers`` (columns) x ``times`` (rows) and write it to ``path``.

    Args:
        path: file to write, ``.png`` or, a seventh of its size, ``.jpg``.
        weathers: presets, or custom weathers of ``environment``.
        times: local times ``HH:MM``.
        environment: family, date, sun, exposure and custom weathers.
        distance_m: distance from the ego's front to the obstacle, along the lane [m].
        at_m: the ego stands at this station of its lane instead [m].
        camera: size and field of view of one picture; 320x180 by default.
        road: an OpenDRIVE file instead of a scene; the ego stands on its first road.
        scenario: a scenario file, or the name of a shipped one, instead of a scene: the ego and all
            others are where it has them.
        at_s: at this time [s].
        lights: lamps of the ego; those of :func:`usual_lights` by default.
        sensors: a section ``sensors``; what they see is drawn as points.

    Raises:
        ValueError: unknown weather, scene, vehicle or device; one line.
        OSError: the file cannot be written.
    """
    _suffix(path)
    found = {n: weather_of(n, environment) for n in weathers}
    camera = camera or Camera(width=320, height=180)
    street: _Street
    if scenario:
        street = _Moment(scenario, at_s, vehicle, camera, device, sensors)
    else:
        target = load_scene(road or scene)
        street = (_OpenDrive if target.opendrive else _Street)(
            target, build_world(target), vehicle, camera, device
        )
        street.carry({"scene": road or scene, "vehicle": vehicle}, sensors)
    street.stand(distance_m, at_m)
    rows = []
    more = counter("pictures", len(times) * len(found))
    for time in times:
        pictures = []
        for name, weather in found.items():
            seen = street.conditions(environment, minutes(time), weather)
            lamps = lights or usual_lights(name, seen.light.illuminance_lx)
            key = stream_key(0, f"{time}-{name}", f"camera/{camera.name}")
            picture = street.picture(seen, lamps, key)
            pictures.append(_labelled(picture, f"{time}  {name.replace('_', ' ')}"))
            more(1)
        rows.append(np.hstack(pictures))
    _write(path, rows)


def scenario_sheet(
    path: str | Path,
    environment: Environment,
    request: SheetRequest,
    times: Sequence[str],
    camera: Camera,
) -> None:
    """Render every shipped scenario as its ego sees it at its critical moment
    (:func:`twin.play.critical_moment.critical_moment_s`), three in a row, and write it to ``path``.

    Args:
        path: file to write, ``.png`` or ``.jpg``.
        environment: date, sun, exposure and weathers.
        request: its first weather counts, by default ``clear``; and its vehicle and device.
        times: local times ``HH:MM``; the first counts.
        camera: size and field of view of one picture.

    Raises:
        ValueError: ``at_s`` is set, or something unknown; one line.
        OSError: the file cannot be written.
    """
    from twin.play.critical_moment import critical_moment_s

    if request.at_s is not None:
        raise ValueError(f"snapshot: at-s: --scenario {ALL} shows the critical moment of each")
    _suffix(path)
    name = (request.weathers or ("clear",))[0]
    weather = weather_of(name, environment)
    pictures = []
    for scenario in steps("scenarios", shipped_scenarios(of_rulebooks=False)):
        at_s = critical_moment_s(scenario)
        street = _Moment(scenario, at_s, request.vehicle, camera, request.device)
        street.stand(0.0, None)
        seen = street.conditions(environment, minutes(times[0]), weather)
        lamps = usual_lights(name, seen.light.illuminance_lx)
        key = stream_key(0, scenario, f"camera/{camera.name}")
        picture = street.picture(seen, lamps, key)
        pictures.append(_labelled(picture, f"{scenario}, {at_s:.1f} s"))
    blank = np.zeros_like(pictures[0])
    pictures += [blank] * (-len(pictures) % _COLUMNS)
    _write(path, [np.hstack(pictures[k : k + _COLUMNS]) for k in range(0, len(pictures), _COLUMNS)])


def scenario_film(
    scenario: str, times_s: Iterable[float], *, camera: Camera, time: str = "16:00"
) -> Iterator[np.ndarray]:
    """Pictures of what the ego of a scenario sees over time in clear weather, if nobody drives it.

    Args:
        scenario: a scenario file, or the name of a shipped one.
        times_s: times of the scenario, rising [s].
        camera: size and field of view of a picture.
        time: local time ``HH:MM``.

    Yields:
        RGB, uint8 [H, W, 3].

    Raises:
        ValueError: there is no such scenario, or it has mistakes; one line each.
    """
    weather = weather_of("clear", _PLAIN)
    street: _Moment | None = None
    for at_s in times_s:
        street = street or _Moment(scenario, at_s, "opencav", camera, "cpu")
        street.move(at_s)
        seen = street.conditions(_PLAIN, minutes(time), weather)
        lamps = usual_lights("clear", seen.light.illuminance_lx)
        key = stream_key(0, scenario, f"camera/{camera.name}")
        yield street.picture(seen, lamps, key).copy()


def _suffix(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in _ENCODING:
        raise ValueError(f"snapshot: {path}: give a file that ends in {' or '.join(_ENCODING)}")
    return suffix


def _write(path: str | Path, rows: Sequence[np.ndarray]) -> None:
    suffix = _suffix(path)
    sheet = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(suffix, sheet, _ENCODING[suffix])
    if not done:
        raise OSError(f"{path}: the picture could not be encoded")
    Path(path).write_bytes(data.tobytes())


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRequest:
    """A contact sheet as it is asked for on a command line; empty tuples mean the usual."""

    weathers: tuple[str, ...] = ()
    times: tuple[str, ...] = ()
    custom: tuple[str, ...] = ()
    """``NAME:KEY=NUMBER,...`` each; see :class:`schemas.sections.environment.Conditions`."""
    environment: Mapping[str, Any] = field(default_factory=dict)
    """Further keys of :class:`schemas.sections.environment.Environment`."""
    scene: str = "downtown"
    road: str = ""
    """An OpenDRIVE file instead of a scene."""
    scenario: str = ""
    """A scenario instead of a scene; :data:`ALL`: a sheet of all that are shipped."""
    at_s: float | None = None
    """None: of one scenario its beginning, of all the critical moment of each."""
    vehicle: str = "opencav"
    distance_m: float = 25.0
    at_m: float | None = None
    width_px: int = 320
    device: str = "cpu"
    sensors: tuple[str, ...] = ()
    """Sensors whose rows are drawn as points, ``NAME`` or ``NAME:KEY=VALUE,...`` each."""


def write_sheet(path: str | Path, request: SheetRequest) -> None:
    """Check ``request`` and write its contact sheet.

    Raises:
        ValueError: a mistake in the request; one line.
        OSError: the file cannot be written.
    """
    own = dict(_custom(text) for text in request.custom)
    data = {**request.environment, "custom": own}
    environment, mistakes = convert_all(data, Environment)
    if environment is not None:
        mistakes = environment_mistakes(environment)
    size, wrong = convert_all(
        {"width": request.width_px, "height": request.width_px * 9 // 16}, Camera
    )
    hours = ("12:00",) if request.scenario == ALL else HOURS
    times, late = convert_all(list(request.times or hours), list[TimeOfDay])
    mistakes = [*mistakes, *wrong, *(Mistake(f"time{m.path}", m.message) for m in late)]
    if environment is None or size is None or times is None or mistakes:
        raise ValueError(mistakes[0].line("snapshot"))
    if request.scenario == ALL:
        scenario_sheet(path, environment, request, times, size)
        return
    contact_sheet(
        path,
        request.weathers or environment.weathers(),
        times,
        environment=environment,
        distance_m=request.distance_m,
        at_m=request.at_m,
        camera=size,
        scene=request.scene,
        road=request.road,
        scenario=request.scenario,
        at_s=request.at_s or 0.0,
        vehicle=request.vehicle,
        device=request.device,
        sensors=dict(_sensor(text) for text in request.sensors),
    )


def _sensor(text: str) -> tuple[str, dict[str, Any]]:
    """``radar:profile=corner,noise=false`` -> its name, and its section."""
    name, _, rest = text.partition(":")
    check_drawn([name])
    section: dict[str, Any] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            raise ValueError(f"snapshot: sensor '{text}': given '{part}', allowed: KEY=VALUE")
        section[key.strip()] = parse_yaml(value, f"sensor '{text}'")
    return name, section


def _custom(text: str) -> tuple[str, dict[str, Any]]:
    """``sleet:rain=0.4,snow=0.3`` -> its name, and its intensities as they were given."""
    name, _, rest = text.partition(":")
    values: dict[str, Any] = {}
    for part in filter(None, rest.split(",")):
        key, _, number = part.partition("=")
        try:
            values[key.strip()] = float(number)
        except ValueError:
            raise ValueError(
                f"snapshot: custom '{text}': given '{part}', allowed: KEY=NUMBER as in rain=0.4"
            ) from None
    return name, values


class _Conditions(NamedTuple):
    """What a picture is taken in."""

    light: Daylight
    weather: WeatherParameters
    wind_towards: tuple[float, float]


class _Street:
    """One camera behind a windscreen, in a street."""

    said: ScriptedEnvironment | None = None
    """What a scenario says of weather and light, in place of the sheet's."""

    def __init__(
        self, target: Scene, world: World, vehicle: str, camera: Camera, device: str
    ) -> None:
        prepare_kernels()
        car = load_vehicle(vehicle)
        self._world = world
        for note in world.notes:
            print(note, file=sys.stderr)
        self._scene = target
        self._front_m = car.front_offset_m
        warp_device = wp.get_device(device)
        self.place = target.origin
        self._noise = int(camera.noise)
        self._geometry = Geometry(world, 1, warp_device)
        self._geometry.place(world.motion.at(np.zeros(1)))
        self._eye = RayCamera(
            self._geometry,
            world,
            target.furniture,
            camera,
            car.camera(camera.name),
            tuple(car.headlamps_m),
        )
        self._pose = wp.zeros((1, 3), dtype=wp.float64, device=warp_device)
        self._camera, self._car = camera, car
        self._drawn: DrawnSensors | None = None
        self._speed_mps = 0.0

    def carry(self, scenario: Mapping[str, Any], sensors: Mapping[str, Mapping[str, Any]]) -> None:
        """Draw what ``sensors`` see, if there are any, in the section ``scenario``."""
        if sensors:
            self._carry(_case(scenario, sensors))

    def _carry(self, case: Case) -> None:
        self._drawn = DrawnSensors(case, self._car, self._scene, self._world, self._geometry)

    def stand(self, distance_m: float, at_m: float | None) -> None:
        """Put the ego ``distance_m`` before the obstacle (without one, where the lane begins), or
        with its reference point at the station ``at_m`` of its lane."""
        obstacle = self._world.obstacle
        hull = None if obstacle is None else self._world.colliders[obstacle]
        pose = place_before(self._world.lane, hull, distance_m + self._front_m)
        if at_m is not None:
            length = self._world.lane.length_m
            if not 0.0 <= at_m <= length:
                raise ValueError(
                    f"snapshot: at-m {at_m:g}: not on the lane, which is {length:.1f} m long; "
                    f"give a number from 0 to {length:.1f}"
                )
            x, y, yaw, _ = self._world.lane.at(at_m)
            pose = (float(x), float(y), float(yaw))
        self._pose.assign(np.array([pose]))

    def _stand_at(self, pose: RoadPose) -> None:
        """Put the ego on a surface that may be tilted."""
        state = np.zeros((1, len(TELEMETRY)))
        state[0, [COLUMN[name] for name in ("x_m", "y_m", "z_m")]] = pose[:3]
        state[0, columns("orientation")] = _quaternion(*(float(angle) for angle in pose[3:]))
        self._pose = wp.array(state, dtype=wp.float64, device=self._pose.device)

    def conditions(
        self, environment: Environment, minute: float, weather: WeatherParameters
    ) -> _Conditions:
        """A weather at a local time [minutes after midnight], or what a scenario has said since."""
        said, toward = self.said, None
        if said is not None:
            weather = said.on_road(said.weather(weather, environment.family))
            minute = minute if said.minute is None else said.minute
            toward = said.wind_towards
        light = light_of(environment, self.place, minute, weather, said)
        return _Conditions(light, weather, toward or wind_towards(environment, self.place))

    def picture(self, seen: _Conditions, lamps: Lights, key: int) -> np.ndarray:
        """uint8 [H, W, 3], valid until the next."""
        row = self._eye.lights.host[0]
        fill_light(row, *seen)
        fill_sky(self._eye.sky_table.host[0], seen.light)
        self._eye.sky_stale = True
        switch_lamps(row, lamps)
        row["active"], row["hazard"], row["noise"], row["key"] = 1, 1.0, self._noise, key
        begin_sky(row, key)
        picture = self._eye.render(self._pose)[0]
        if self._drawn is None:
            return picture
        site = self._car.camera(self._camera.name)
        return self._drawn.draw(picture, self._camera, site, self._state(), seen)

    def _state(self) -> wp.array:
        """The vehicle's state on the device [1, T]."""
        pose = self._pose.numpy()
        if pose.shape[1] == len(TELEMETRY):
            state = pose.copy()
        else:
            state = np.zeros((1, len(TELEMETRY)))
            state[0, [COLUMN["x_m"], COLUMN["y_m"]]] = pose[0, :2]
            state[0, columns("orientation")] = _quaternion(float(pose[0, 2]), 0.0, 0.0)
        z, w = state[0, columns("orientation")][2:]
        heading = 2.0 * math.atan2(z, w)
        ahead = (math.cos(heading), math.sin(heading))
        for i, axis in enumerate("xy"):
            state[0, COLUMN[f"com_{axis}_m"]] = state[0, COLUMN[f"{axis}_m"]]
            state[0, COLUMN[f"velocity_{axis}_mps"]] = self._speed_mps * ahead[i]
        return wp.array(state, dtype=wp.float64, device=self._pose.device)


class _OpenDrive(_Street):
    """One camera on the first road of an OpenDRIVE file."""

    def stand(self, distance_m: float, at_m: float | None) -> None:  # noqa: ARG002 - no obstacle
        """Put the ego at the station ``at_m``, else a little behind the beginning, on the innermost
        lane that is driven, along it."""
        frame = next(iter(road_map(self._scene.opendrive).frames.values()))
        length = frame.road.length_m
        s = min(_INTO_ROAD_M, 0.5 * length) if at_m is None else at_m
        if not 0.0 <= s <= length:
            raise ValueError(
                f"snapshot: at-m {s:g}: not on road {frame.road.id[:40]}, which is {length:.1f} m "
                f"long; give a number from 0 to {length:.1f}"
            )
        lanes = frame.sections[int(frame.section_at(s))].section.lanes
        driven = sorted((abs(i.id), i.id) for i in lanes if i.type in DRIVEN_TYPES)
        lane = driven[0][1] if driven else 0
        self._stand_at(frame.lane_pose(lane, s, with_traffic=lane != 0))


class _Moment(_Street):
    """One camera in the ego of a scenario, at a moment."""

    def __init__(
        self,
        scenario: str,
        at_s: float,
        vehicle: str,
        camera: Camera,
        device: str,
        sensors: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    ) -> None:
        prepare_kernels()
        self._at_s = at_s
        kind = next(kind for kind in scenario_kinds().declared if kind.scene_name)
        section = {"type": kind.name, kind.brings_scene: scenario, "vehicle": vehicle}
        self._case = _case(section, sensors)
        lines: list[str] = implementation(kind.checks)([self._case])
        if lines:
            raise ValueError("\n".join(lines))
        target = families.scene_of(self._case)
        world = build_world(target, self._case.rig.bodies)
        self._motion = families.motion_of(
            self._case, load_vehicle(vehicle), world, 1, wp.get_device(device)
        )
        super().__init__(target, world, vehicle, camera, device)
        if sensors:
            self._carry(self._case)

    def move(self, at_s: float) -> None:
        """Put the ego and all others where the scenario has them at another moment [s]."""
        self._at_s = at_s
        self.stand(0.0, None)

    def stand(self, distance_m: float, at_m: float | None) -> None:  # noqa: ARG002 - it says where
        """Put the ego and all others where the scenario has them."""
        assert self._motion is not None
        self._motion.begin(0, self._case)
        ego = self._motion.alone(0, self._at_s)
        self.said = self._motion.environment(0)
        self._geometry.place(self._motion.at(np.array([self._at_s])))
        x, y, z, heading, self._speed_mps = ego
        zero = np.zeros(())
        self._stand_at(RoadPose(*(np.array(v) for v in (x, y, z, heading)), zero, zero))


def _case(scenario: Mapping[str, Any], sensors: Mapping[str, Mapping[str, Any]]) -> Case:
    """A case of the sections ``scenario`` and ``sensors``.

    Raises:
        ValueError: they cannot be used; a line for each mistake.
    """
    data = {"campaign": "snapshot", "scenario": dict(scenario), "matrix": {"weather": ["clear"]}}
    plan, mistakes = parse_plan(data | ({"sensors": dict(sensors)} if sensors else {}))
    if plan is None:
        raise ValueError(mistakes[0].line("snapshot"))
    return plan.cases[0]


def _quaternion(heading: float, pitch: float, roll: float) -> tuple[float, float, float, float]:
    """x, y, z, w of heading about z, then pitch about y, then roll about x [rad]."""
    cy, sy = math.cos(0.5 * heading), math.sin(0.5 * heading)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def _labelled(image: np.ndarray, text: str) -> np.ndarray:
    """The picture below a strip with its label."""
    strip = np.full((_LABEL_PX, image.shape[1], 3), 24, np.uint8)
    white = (235, 235, 235)
    cv2.putText(strip, text, (8, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, white, 1, cv2.LINE_AA)
    return np.vstack([strip, image])
