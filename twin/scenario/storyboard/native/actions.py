"""Actions of a storyboard from what actors are told to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from schemas.validation import suggest
from twin.scenario.storyboard.native.bodies import WALKERS
from twin.scenario.storyboard.native.curves import curve_trajectory, curve_way, place_after
from twin.scenario.storyboard.native.footing import footed
from twin.scenario.storyboard.native.ground import NativeMistakes, ScenarioGround, SpotError
from twin.scenario.storyboard.native.orders import ActorOrders, ArriveOrder, KeepOrder, LampOrders
from twin.scenario.storyboard.native.recorded import recorded_trajectory, start_speed_mps
from twin.scenario.storyboard.native.sections import (
    ActorStart,
    EgoStart,
    IdmSettings,
    NativeScenario,
)
from twin.scenario.storyboard.native.starts import StartPlace, origin_at, spot_position
from twin.scenario.storyboard.native.watches import ScenarioSpot
from twin.scenario.storyboard.native.ways import (
    ActorWay,
    crossing,
    followed_lanes,
    lane_way,
    line_trajectory,
    line_way,
    nearest,
    position_on,
    route_of,
)
from twin.scenario.storyboard.program import actions as records
from twin.scenario.storyboard.program.actions import (
    LIGHTS,
    Displacement,
    DynamicsDimension,
    DynamicsShape,
    FinalSpeedKind,
    MotionLimits,
    PrivateAction,
    SteadyStateKind,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import DistanceFrame
from twin.scenario.storyboard.program.places import (
    FixedPosition,
    RoadRoute,
    RouteLeg,
    Trajectory,
)
from twin.scenario.storyboard.program.program import DriverModel

SPEED_RATE_MPS2 = 3.0
"""Change of speed where a file says none: brisk, but nobody would call it an emergency."""
LANE_CHANGE_S = 4.0
"""Duration of a lane change where a file says none; 3 to 6 s are common on motorways."""
BEYOND_M = 1.0
"""So far beyond the outermost lane somebody goes who crosses a road without footways."""
_FLASH_S = 1.0 / 3.0
"""Time on and off of a flashing lamp: 90 flashes per minute (UN Regulation 48, 6.5.9.1)."""
_LAMP_MODES = {
    "off": records.LampMode.OFF,
    "on": records.LampMode.ON,
    "flash": records.LampMode.FLASHING,
}
_LAMPS = {
    "brake": "brakeLights",
    "indicator_left": "indicatorLeft",
    "indicator_right": "indicatorRight",
    "warning": "warningLights",
    "low_beam": "lowBeam",
    "high_beam": "highBeam",
    "reversing": "reversingLights",
    "fog_front": "fogLightsFront",
    "fog_rear": "fogLightsRear",
    "daytime": "daytimeRunningLights",
}
AT_ONCE = TransitionDynamics(DynamicsShape.STEP, DynamicsDimension.TIME, 0.0)
"""A change in no time."""
SPEED, ARRIVE = "speed", "arrive"
"""Names of actions that cannot begin together: both steer the speed."""

_End = tuple[FixedPosition, int, float]
"""Where somebody arrives: position, trajectory (-1: none) and way along it."""


@dataclass(slots=True)
class ActorCourse:
    """What the events that stand before in the file make of an actor."""

    lane: int
    legs: list[RouteLeg]
    path: ActorWay | None = None
    """The line that it follows."""
    at: FixedPosition | None = None
    """Where that line ends."""
    moves: bool = False
    """It leaves its start before it follows a line."""


@dataclass(slots=True)
class ActionCompiler:
    """Makes actions; trajectories, routes and models come together here.

    Events count in the order of the file: a lane change to the left is one from the lane into which
    the event before it changed.
    """

    scenario: NativeScenario
    ground: ScenarioGround
    places: dict[str, StartPlace]
    numbers: dict[str, int]
    mistakes: NativeMistakes
    trajectories: list[Trajectory] = field(default_factory=list)
    routes: list[RoadRoute] = field(default_factory=list)
    models: list[DriverModel] = field(default_factory=list)
    courses: dict[str, ActorCourse] = field(default_factory=dict)

    def begin(self) -> dict[str, list[PrivateAction]]:
        """Actions of the start, by name."""
        first: dict[str, list[PrivateAction]] = {}
        for name, place in self.places.items():
            start = self._start(name)
            path = "ego" if name == "ego" else f"actors.{name}"
            legs = self.mistakes.attempt(path, partial(self._legs, place, start.turns))
            self.courses[name] = ActorCourse(place.lane, legs or [])
            actions: list[PrivateAction] = [
                records.TeleportAction(place.origin),
                records.SpeedAction(AT_ONCE, -1, start.speed_mps),
            ]
            if start.turns and legs:
                actions.append(self._route(f"{name} turns", legs))
            if start.curve is not None:
                follow = self.mistakes.attempt(path, partial(self._curve, name, start.curve))
                actions += [follow] if follow else []
            if start.poses is not None:
                actions[1:] = self._recorded(name, start.poses, place)
            if start.behaviour == "idm":
                self._check_driver(f"{path}.behaviour", start)
                actions.append(self._model(path, start))
            if isinstance(start, ActorStart) and not start.visible:
                actions.append(records.VisibilityAction(False, False, False))
            self.courses[name].moves = start.speed_mps > 0.0
            first[name] = actions
        return first

    def orders(self, path: str, name: str, orders: ActorOrders) -> list[tuple[str, PrivateAction]]:
        """Named actions of one actor in an event; what cannot be is noted."""
        if name not in self.numbers:
            self.mistakes.add(path, f"no actor '{name}'; {suggest(name, list(self.numbers))}")
            return []
        if name not in self.places:
            return []  # what its place lacks is told
        actions: list[tuple[str, PrivateAction]] = []
        self._steer(path, name, orders, actions)
        if orders.speed_mps is not None or orders.stop:
            actions.append((SPEED, self._speed(path, name, orders)))
        if orders.arrive is not None:
            arrive = orders.arrive
            action = self.mistakes.attempt(
                f"{path}.arrive", lambda: self._arrive(f"{path}.arrive", name, arrive)
            )
            actions += [(ARRIVE, action)] if action else []
        if orders.keep is not None:
            actions += self._keep(f"{path}.keep", name, orders.keep)
        actions += self._rest(path, name, orders)
        if not actions and not self.mistakes.mistakes:
            self.mistakes.add(path, f"'{name}' is told to do nothing")
        if orders.speed_mps or orders.arrive or orders.keep or orders.behaviour == "idm":
            self.courses[name].moves = True
        return actions

    def _recorded(
        self, name: str, poses: list[list[float]], place: StartPlace
    ) -> list[PrivateAction]:
        """Goes as it was recorded, by the scenario's time."""
        places = list(place.recorded)
        speed_mps = start_speed_mps(poses, places)
        self.trajectories.append(recorded_trajectory(f"{name} poses", poses, places))
        follow = records.FollowTrajectoryAction(
            trajectory=len(self.trajectories) - 1,
            timed=True,
            absolute_time=True,
            time_scale=1.0,
            time_offset_s=0.0,
            follow=False,
            initial_distance_m=0.0,
        )
        return [records.SpeedAction(AT_ONCE, -1, speed_mps), follow]

    def _start(self, name: str) -> EgoStart | ActorStart:
        return self.scenario.ego if name == "ego" else self.scenario.actors[name]

    def _legs(self, place: StartPlace, turns: Sequence[str]) -> list[RouteLeg]:
        if place.lane == 0 or (place.s_m == 0.0 and not turns):
            return []
        return followed_lanes(place, self.ground, list(turns))

    def _route(self, name: str, legs: list[RouteLeg]) -> records.AssignRouteAction:
        self.routes.append(route_of(name, legs))
        return records.AssignRouteAction(len(self.routes) - 1)

    def _model(self, path: str, start: EgoStart | ActorStart) -> records.ControllerAction:
        settings = start.idm or IdmSettings()
        speed = settings.desired_speed_mps or start.speed_mps
        if speed <= 0.0:
            where = f"{path}.idm.desired_speed_mps"
            self.mistakes.add(where, "needed of an actor that stands at the start")
        self.models.append(
            DriverModel(
                desired_speed_mps=speed,
                time_gap_s=settings.time_gap_s,
                gap_min_m=settings.gap_min_m,
                acceleration_mps2=settings.acceleration_mps2,
                deceleration_mps2=settings.deceleration_mps2,
                politeness=settings.politeness if settings.changes_lanes else -1.0,
            )
        )
        return records.ControllerAction(settings.changes_lanes, True, len(self.models) - 1)

    def _check_driver(self, path: str, start: EgoStart | ActorStart) -> None:
        if isinstance(start, EgoStart):
            return
        if start.kind in WALKERS or start.lane is None:
            words = f"of kind {start.kind}" if start.kind in WALKERS else "without a lane"
            self.mistakes.add(path, f"no driver model moves an actor {words}")

    def _speed(self, path: str, name: str, orders: ActorOrders) -> records.SpeedAction:
        speed = 0.0 if orders.stop else orders.speed_mps or 0.0
        most = self.places[name].body.speed_max_mps
        if speed > most:
            words = f"given {speed:g}, '{name}' goes at most {most:g} m/s"
            self.mistakes.add(f"{path}.speed_mps", words)
        sets_off = orders.arrive is not None
        dynamics = AT_ONCE if sets_off else _dynamics(orders, DynamicsShape.LINEAR)
        return records.SpeedAction(dynamics, -1, speed)

    def _steer(
        self,
        path: str,
        name: str,
        orders: ActorOrders,
        actions: list[tuple[str, PrivateAction]],
    ) -> None:
        place, course = self.places[name], self.courses[name]
        if orders.change_lane is not None:
            change = orders.change_lane
            action = self.mistakes.attempt(
                path,
                lambda: self._change(name, change, _dynamics(orders, DynamicsShape.SINUSOIDAL)),
            )
            actions += [("change lane", action)] if action else []
        if orders.offset_m is not None:
            dynamics = _dynamics(orders, DynamicsShape.SINUSOIDAL)
            offset = orders.offset_m * place.sign
            number = self.numbers[name]
            action = records.LaneChangeAction(dynamics, number, 0, offset)
            actions.append(("offset", action))
        if orders.cross_to is not None or orders.path:
            key = "cross_to" if orders.cross_to is not None else "path"
            follow = self.mistakes.attempt(
                f"{path}.{key}", lambda: self._path(name, orders, f"{path}.{key}")
            )
            actions += [("path", follow)] if follow else []
        if orders.turns:
            legs = self.mistakes.attempt(path, partial(self._legs, place, orders.turns))
            if legs:
                course.legs = legs
                actions.append(("turns", self._route(f"{name} turns", legs)))

    def _change(
        self, name: str, change: int | str, dynamics: TransitionDynamics
    ) -> records.LaneChangeAction:
        place, course = self.places[name], self.courses[name]
        if course.lane == 0 or place.lane == 0:
            raise SpotError("change_lane", f"'{name}' starts on no lane")
        if isinstance(change, int):
            if any(leg.road != place.road for leg in course.legs[1:]):
                names = "the lanes of the next road are others: give left or right"
                raise SpotError("change_lane", f"'{name}' goes through a junction; {names}")
            key = "change_lane"
            target = self.ground.lane(place.road, place.s_m, place.sign, change, key)
            course.lane = target
            return records.LaneChangeAction(dynamics, -1, target, 0.0)
        # To the left of the one who drives along s ids rise.
        left = 1 if change == "left" else -1
        step = left * place.sign
        target = course.lane + step
        target += step if target == 0 else 0
        section = self.ground.section(place.road, place.s_m)
        lane = section.lane(target)
        if lane is None:
            label = self.ground.label(place.road)
            raise SpotError("change_lane", f"no lane is {change} of '{name}' on road {label}")
        if lane.type in ("median", "none", "curb"):
            raise SpotError("change_lane", f"{change} of '{name}' is a lane of type {lane.type}")
        course.lane = target
        return records.LaneChangeAction(dynamics, self.numbers[name], left, 0.0)

    def _path(self, name: str, orders: ActorOrders, path: str) -> records.FollowTrajectoryAction:
        place, course = self.places[name], self.courses[name]
        if self._start(name).curve is not None:
            raise SpotError("", f"'{name}' follows the curve of its start: give one of both")
        if course.at is None and course.moves:
            words = "is on its way before: a line begins where an actor stands"
            raise SpotError("", f"'{name}' {words}; leave its speed at 0 until then")
        points = line_points(place, orders, self.ground, course.at)
        self.trajectories.append(line_trajectory(path, footed(points, self.ground)))
        number = len(self.trajectories) - 1
        course.path, course.at = line_way(points, number), points[-1]
        return _follow(number)

    def _curve(self, name: str, curve: list[list[float]]) -> records.FollowTrajectoryAction:
        origin = self.places[name].origin
        self.trajectories.append(curve_trajectory(f"{name} curve", curve, origin))
        number = len(self.trajectories) - 1
        self.courses[name].path = curve_way(self.trajectories[number], number)
        return _follow(number)

    def _way(self, name: str) -> ActorWay:
        course = self.courses[name]
        if course.path is not None:
            return course.path
        if not course.legs:
            raise SpotError("", f"'{name}' follows no lane and no path before: give at and meet_at")
        return lane_way(self.places[name], self.ground, course.legs)

    def _arrive(self, path: str, name: str, arrive: ArriveOrder) -> records.SynchronizeAction:
        others = [other for other in self.places if other != name]
        if arrive.meet not in others:
            raise SpotError(
                "meet", f"no other actor '{arrive.meet}'; {suggest(arrive.meet, others)}"
            )
        place, master = self.places[name], self.places[arrive.meet]
        ends: list[_End] = [(place.origin, -1, 0.0), (master.origin, -1, 0.0)]
        if arrive.at is not None:
            wanted = ("at", arrive.at, place), ("meet_at", arrive.meet_at, master)
            for index, (key, spot, who) in enumerate(wanted):
                end = self.mistakes.attempt(
                    path if spot is None else f"{path}.{key}",
                    partial(self._end, spot, who, arrive.meet_after_m or 0.0),
                )
                ends[index] = end or ends[index]
        else:
            ways = self._way(name), self._way(arrive.meet)
            meeting = crossing(*ways)
            if meeting is None:
                words = f"the ways of '{name}' and '{arrive.meet}' do not cross"
                raise SpotError("", f"{words}; give at and meet_at, or another path or lane")
            for index, (way, who) in enumerate(zip(ways, (place, master), strict=True)):
                at = meeting[index] - who.body.centre_x_m
                if way.trajectory >= 0:
                    ends[index] = (who.origin, way.trajectory, at)
                else:
                    ends[index] = (position_on(way, at, self.ground), -1, 0.0)
        return synchronisation(arrive, self.numbers[arrive.meet], ends)

    def _end(self, spot: ScenarioSpot | None, who: StartPlace, after_m: float) -> _End:
        """Where an actor arrives: at a spot, without one so far along its curve."""
        line = self.courses[who.name].path
        if spot is None:
            if line is None or self._start(who.name).curve is None:
                raise SpotError("meet_after_m", f"'{who.name}' has no curve: give meet_at")
            place = place_after(self.trajectories[line.trajectory], after_m)
            return place, line.trajectory, after_m
        if line is None:
            return origin_at(spot, self.ground, who), -1, 0.0
        # It heads along its line there.
        position = spot_position(spot, self.ground, who)[0]
        return position, line.trajectory, max(0.0, nearest(line, position) - who.body.centre_x_m)

    def _keep(self, path: str, name: str, keep: KeepOrder) -> list[tuple[str, PrivateAction]]:
        others = [other for other in self.numbers if other != name]
        if keep.to not in others:
            words = f"no other actor '{keep.to}'; {suggest(keep.to, others)}"
            self.mistakes.add(f"{path}.to", words)
            return []
        timed = keep.gap_s is not None
        action = records.LongitudinalDistanceAction(
            entity=self.numbers[keep.to],
            value=keep.gap_s if keep.gap_s is not None else keep.gap_m or 0.0,
            time_gap=timed,
            freespace=True,
            continuous=True,
            frame=DistanceFrame.ROAD,
            displacement=Displacement.AHEAD if keep.side == "ahead" else Displacement.BEHIND,
            limits=MotionLimits(
                keep.acceleration_mps2,
                keep.deceleration_mps2,
                self.places[name].body.speed_max_mps,
            ),
        )
        return [("keep", action)]

    def _rest(self, path: str, name: str, orders: ActorOrders) -> list[tuple[str, PrivateAction]]:
        """Driver models, lamps, visibility."""
        actions: list[tuple[str, PrivateAction]] = []
        start = self.scenario.actors.get(name)
        if orders.behaviour is not None and start is None:
            self.mistakes.add(
                f"{path}.behaviour", "an event leaves the ego its driver model: give ego.behaviour"
            )
        elif orders.behaviour == "none":
            actions.append(("behaviour", records.ControllerAction(False, False)))
        elif orders.behaviour == "idm" and start is not None:
            self._check_driver(f"{path}.behaviour", start)
            actions.append(("behaviour", self._model(f"actors.{name}", start)))
        if orders.lamps is not None:
            if start is not None and start.kind in WALKERS:
                self.mistakes.add(f"{path}.lamps", f"an actor of kind {start.kind} has no lamps")
            actions += [("lamp", action) for action in lamp_actions(orders.lamps)]
        if orders.visible is not None:
            shown = orders.visible
            actions.append(("visible", records.VisibilityAction(shown, shown, shown)))
        return actions


def line_points(
    place: StartPlace, orders: ActorOrders, ground: ScenarioGround, start: FixedPosition | None
) -> list[FixedPosition]:
    """The points of `cross_to` or `path`, from where an actor stands.

    Raises:
        SpotError: a point lies beyond the road.
    """
    begin = place.origin if start is None else start
    if orders.cross_to is not None:
        side = orders.cross_to
        s = begin.s_m
        try:
            lane, offset = ground.beside(begin.road, s, "footway", side), 0.0
        except SpotError:
            lane = 0
            beyond = BEYOND_M if side == "left" else -BEYOND_M
            offset = ground.edge(begin.road, s, side) + beyond - ground.middle(begin.road, 0, s)
        return [begin, ground.fixed(begin.road, lane, s, offset, 1)]
    points = [begin]
    for index, (s, aside) in enumerate(orders.path):
        try:
            lane, offset = ground.lateral(begin.road, s, aside)
        except SpotError as error:
            raise SpotError(str(index), str(error)) from None
        points.append(ground.fixed(begin.road, lane, s, offset, 1))
    return points


def _follow(trajectory: int) -> records.FollowTrajectoryAction:
    return records.FollowTrajectoryAction(
        trajectory=trajectory,
        timed=False,
        absolute_time=False,
        time_scale=1.0,
        time_offset_s=0.0,
        follow=True,
        initial_distance_m=0.0,
    )


def synchronisation(
    arrive: ArriveOrder, master: int, ends: list[_End]
) -> records.SynchronizeAction:
    """The action; ``ends``: position, trajectory and way along it of the actor and the master."""
    (position, trajectory, along), (master_position, master_trajectory, master_along) = ends
    final = FinalSpeedKind.NONE if arrive.speed_mps is None else FinalSpeedKind.ABSOLUTE
    return records.SynchronizeAction(
        master=master,
        master_position=master_position,
        position=position,
        final_speed=final,
        final_speed_mps=arrive.speed_mps or 0.0,
        steady_state=SteadyStateKind.DISTANCE if arrive.steady_m else SteadyStateKind.NONE,
        steady_state_value=arrive.steady_m,
        tolerance_master_m=0.0,
        tolerance_m=0.0,
        trajectory=trajectory,
        trajectory_s_m=along,
        master_trajectory=master_trajectory,
        master_trajectory_s_m=master_along,
        steady_slack=records.NEARLY_STEADY,
    )


def lamp_actions(lamps: LampOrders) -> list[PrivateAction]:
    """An action per lamp."""
    return [
        records.LightAction(LIGHTS.index(light), _LAMP_MODES[mode], _FLASH_S, _FLASH_S)
        for name, light in _LAMPS.items()
        if (mode := getattr(lamps, name)) is not None
    ]


def _dynamics(orders: ActorOrders, usual: DynamicsShape) -> TransitionDynamics:
    shape = DynamicsShape[orders.shape.upper()] if orders.shape else usual
    if shape is DynamicsShape.STEP:
        return AT_ONCE
    if orders.in_s is not None:
        return TransitionDynamics(shape, DynamicsDimension.TIME, orders.in_s)
    if orders.over_m is not None:
        return TransitionDynamics(shape, DynamicsDimension.DISTANCE, orders.over_m)
    if usual is DynamicsShape.SINUSOIDAL:
        return TransitionDynamics(shape, DynamicsDimension.TIME, LANE_CHANGE_S)
    rate = orders.at_mps2 if orders.at_mps2 is not None else SPEED_RATE_MPS2
    return TransitionDynamics(shape, DynamicsDimension.RATE, rate)


def path_heading(points: list[FixedPosition]) -> float:
    """Heading of a line's beginning [rad]."""
    return math.atan2(points[1].y_m - points[0].y_m, points[1].x_m - points[0].x_m)
