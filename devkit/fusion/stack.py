"""The fusion stack: sees with several sensors, tracks, and brakes in stages."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.health import SensorHealth, drives_in_view
from devkit.fusion.parameters import FusionSensors, StagingParameters, TrackingParameters
from devkit.fusion.sensing import Sensing
from devkit.fusion.staging import StagePlan, Stages
from devkit.fusion.threats import find_threats
from devkit.fusion.tracks import TrackStore
from devkit.images import on_host
from devkit.lane.lateral import LateralParameters, Wheel, steer
from devkit.lane.track import CarMotion, LaneTrack
from devkit.lane.view import LaneView
from devkit.reference import control, lights
from devkit.reference.control import Controller
from devkit.reference.eyes import Eyes
from devkit.reference.lights import LightsSwitch
from devkit.reference.planning import DrivePlan
from devkit.stack import Observation, Stack, parameter_parts
from schemas.messages import (
    ENVIRONMENT_COLUMNS,
    CameraSite,
    Command,
    Detection,
    Episode,
    PerceptionCost,
)
from schemas.wire.expected import Expected

_ILLUMINANCE = ENVIRONMENT_COLUMNS.index("illuminance_lx")
_EXTINCTION = ENVIRONMENT_COLUMNS.index("extinction_per_m")


@dataclass(slots=True)
class _FusedCar:
    """What is remembered of one slot's case beside the arrays."""

    token: int
    lane: LaneTrack | None
    throttle_integral: float = 0.0
    wheel: Wheel = field(default_factory=Wheel)
    surroundings: lights.LightSurroundings = field(default_factory=lights.LightSurroundings)


class FusionStack(Stack):
    """Keeps its lane and speed, and brakes for what its sensors agree on.

    All that is fused lies in arrays with the slot first, and no number of a slot depends on
    another's, so its commands do not depend on the number of slots or on the neighbours.
    """

    takes_device_frames = True
    drives_by_camera = True
    portable = True  # sums, products, roots and functions of our own; what is rounded stays so

    PARAMETERS = (
        *(FusionSensors, TrackingParameters, StagingParameters),
        *(Controller, LateralParameters, LightsSwitch),
    )

    def __init__(self, slots: int, **parameters: Any) -> None:
        """Build the stack for ``slots`` cars.

        ``parameters`` are fields of :attr:`PARAMETERS`, which state unit and range of each.

        Raises:
            TypeError: there is no such parameter.
            ValueError: a parameter is out of its range, not a number, or would be ignored.
        """
        super().__init__(slots)
        parts = parameter_parts(self.PARAMETERS, parameters)
        self.sensors: FusionSensors = parts[0]
        self.staging: StagingParameters = parts[2]
        self.controller: Controller = parts[3]
        self.steering: LateralParameters = parts[4]
        self.switch: LightsSwitch = parts[5]
        sped = self.staging.cruise_speed_mps != StagingParameters().cruise_speed_mps
        if self.controller.cruise == "throttle" and sped:
            raise ValueError("cruise_speed_mps is set, but cruise: throttle does not look at it")
        self.ego = EgoMotion(slots, self.sensors.dive_rad_per_mps2)
        self.health = SensorHealth(slots)
        self.tracks = TrackStore(slots, parts[1])
        self.stages = Stages(slots, self.staging)
        self.sensing = Sensing(slots, self.sensors, parts[1], self.staging.corridor_half_m)
        self._cars: list[_FusedCar | None] = [None] * slots
        self._period_s = np.zeros(slots)
        self._eyes = Eyes(slots)
        self._drove: list[int] = []
        self._latency = StageLatency(slots)

    def expect(self, expected: Sequence[Expected]) -> None:
        """See :meth:`devkit.stack.Stack.expect`."""
        self._eyes.expect(expected)

    def reset(self, slot: int, episode: Episode) -> None:
        """Put a fresh car into ``slot``.

        Raises:
            UsageError: the case lacks a sensor that ``sensors_used`` names, or has no camera.
        """
        self.sensing.reset(slot, episode)
        self._eyes.reset(slot, episode)
        self.ego.reset(slot, episode.ticks_per_rev, self.sensors.wheel_radius_m)
        self.health.reset(slot)
        self.tracks.reset(slot)
        self.stages.reset(slot)
        self._period_s[slot] = episode.control_period_ns * 1e-9
        self._cars[slot] = _FusedCar(episode.token, self._lane(episode.cameras[0]))

    def _lane(self, site: CameraSite) -> LaneTrack | None:
        if self.steering.steering == "straight":
            return None
        return LaneTrack(LaneView.of_site(site), self.steering.lines_m, self.steering.chassis)

    def step(self, observation: Observation) -> list[Command]:
        """One command per active slot, ascending."""
        self._drove = slots = observation.active_slots()
        sensors = observation.sensors
        cars = [self._car(slot, observation) for slot in slots]
        self._latency.begin(slots)
        detections = self._eyes.look(slots, observation)
        with self._latency.of("ego"):
            self.ego.update(
                *(sensors["vehicle"], sensors.get("encoders"), sensors.get("imu")), self._period_s
            )
            self.tracks.predict(self._period_s, self.ego.speed_mps, self.ego.yaw_rate_radps)
        with self._latency.of("sensing"):
            self.sensing.look(slots, observation, detections, self.ego, self.health)
        with self._latency.of("tracks"):
            self.sensing.track(self.tracks, self.ego)
        with self._latency.of("stages"):
            self.health.update(
                sensors["environment"], self._period_s, self.sensing.has_lidar,
                self.sensing.has_radar, drives_in_view(self.tracks),
            )  # fmt: skip
            threats = find_threats(self.tracks, self.ego, self.health, self.staging)
            plan = self.stages.update(threats, self.ego, self._period_s)
        with self._latency.of("control"):
            return [
                self._drive(car, slot, observation, detections.get(slot), plan)
                for car, slot in zip(cars, slots, strict=True)
            ]

    def costs(self) -> list[PerceptionCost | None]:
        """See :meth:`devkit.stack.Stack.costs`."""
        return [
            None
            if cost is None
            else msgspec.structs.replace(
                cost, stages=self._latency.taken(slot), limited=self.health.limited(slot)
            )
            for slot, cost in zip(self._drove, self._eyes.costs(self._drove), strict=True)
        ]

    def _car(self, slot: int, observation: Observation) -> _FusedCar:
        car = self._cars[slot]
        token = int(observation.token[slot])
        if car is None or car.token != token:
            # Going on with another case's state would be a wrong verdict that nobody notices.
            held = "none" if car is None else str(car.token)
            raise ValueError(f"slot {slot}: observation of token {token}, but reset for {held}")
        return car

    def _drive(
        self,
        car: _FusedCar,
        slot: int,
        observation: Observation,
        detections: list[Detection] | None,
        plan: StagePlan,
    ) -> Command:
        self._say(slot, observation)
        speed_mps = float(self.ego.speed_mps[slot])
        period_s = float(self._period_s[slot])
        self._keep_lane(car, slot, observation, detections or [], speed_mps, period_s)
        aeb = bool(plan.aeb[slot])
        wanted = DrivePlan(0.0 if aeb else self.staging.cruise_speed_mps, aeb=aeb)
        car.throttle_integral, actuation = control.control(
            car.throttle_integral, wanted, speed_mps, period_s, self.controller
        )
        environment = observation.sensors["environment"][slot].tolist()
        car.surroundings = lights.sense(
            car.surroundings, environment[_ILLUMINANCE], environment[_EXTINCTION], self.switch
        )
        cause = int(plan.cause[slot])
        place = int(self.tracks.place[slot, cause]) if cause >= 0 else -1
        began = bool(plan.began[slot]) and 0 <= place < len(detections or [])
        return Command(
            slot=slot,
            token=car.token,
            tick=int(observation.tick[slot]),
            throttle=actuation.throttle,
            brake=float(plan.brake[slot]) if aeb else actuation.brake,
            steering_rad=car.wheel.angle_rad,
            aeb=aeb,
            lights=lights.choose(car.surroundings, aeb),
            detections=detections or [],
            trigger=place if began else None,
            warning=bool(plan.warning[slot]),
        )

    def _say(self, slot: int, observation: Observation) -> None:
        """Print what limits the sensors of a slot, when it changes; it ends in the case's log."""
        words = self.health.words(
            slot,
            float(self._period_s[slot]),
            has_lidar=bool(self.sensing.has_lidar[slot]),
            has_radar=bool(self.sensing.has_radar[slot]),
        )
        if words is not None:
            at_s = int(observation.sim_time_ns[slot]) / 1e9
            print(f"slot {slot}, {at_s:.2f} s: {', '.join(words) or 'sensors fine'}", flush=True)

    def _keep_lane(
        self,
        car: _FusedCar,
        slot: int,
        observation: Observation,
        detections: list[Detection],
        speed_mps: float,
        period_s: float,
    ) -> None:
        """Turn the wheel towards the lane in the camera image."""
        if car.lane is None:
            return
        camera = observation.sensors.get("camera")
        picture = None if camera is None else on_host(camera)[slot]
        motion = CarMotion(speed_mps, float(self.ego.yaw_rate_radps[slot]))
        curve = car.lane.update(motion, picture, period_s, detections)
        car.wheel = steer(car.wheel, curve, car.lane.bend, speed_mps, period_s, self.steering)


class StageLatency:
    """Wall time that each stage of the stack takes; told in the report, decides nothing."""

    def __init__(self, slots: int) -> None:
        """Begin with nothing taken."""
        self._slots = slots
        self._together: list[int] = []
        self._taken_s: dict[str, np.ndarray] = {}

    def begin(self, together: list[int]) -> None:
        """A tick of the slots ``together``, which share its time evenly."""
        self._together = together

    @contextmanager
    def of(self, stage: str) -> Iterator[None]:
        """Time of one run of a stage."""
        started_s = time.perf_counter()
        yield
        took_s = time.perf_counter() - started_s
        taken = self._taken_s.setdefault(stage, np.zeros(self._slots))
        if self._together:
            taken[self._together] += took_s / len(self._together)

    def taken(self, slot: int) -> dict[str, float]:
        """What each stage took for a slot since this was asked last [s]."""
        taken = {stage: float(values[slot]) for stage, values in self._taken_s.items()}
        for values in self._taken_s.values():
            values[slot] = 0.0
        return taken
