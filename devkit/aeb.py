"""The reference stack: the paper's detect, plan and brake; it keeps its lane, and has lights on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from devkit.images import on_host
from devkit.lane.lateral import LateralParameters, Wheel, steer
from devkit.lane.track import CarMotion, LaneTrack
from devkit.lane.view import LaneView
from devkit.reference import control, lights, planning
from devkit.reference.control import Controller
from devkit.reference.eyes import Eyes
from devkit.reference.lights import LightsSwitch
from devkit.reference.planning import Planner
from devkit.reference.view import CameraView
from devkit.stack import Observation, Stack, parameter_parts
from schemas.messages import (
    ENVIRONMENT_COLUMNS,
    VEHICLE_COLUMNS,
    CameraSite,
    Command,
    Detection,
    Episode,
    PerceptionCost,
)
from schemas.wire.expected import Expected
from twin.base.errors import UsageError

_SPEED = VEHICLE_COLUMNS.index("speed_mps")
_YAW_RATE = VEHICLE_COLUMNS.index("yaw_rate_radps")
_ILLUMINANCE = ENVIRONMENT_COLUMNS.index("illuminance_lx")
_EXTINCTION = ENVIRONMENT_COLUMNS.index("extinction_per_m")


@dataclass(slots=True)
class _Car:
    """Everything remembered about one slot's case.

    Detections are not kept between camera frames: what the planner needs of them is the number of
    frames that agreed, which its state carries.
    """

    token: int
    period_s: float
    view: CameraView
    lane: LaneTrack | None
    """Tracker of the lane; None: the wheel is held straight."""
    state: planning.State = field(default_factory=planning.Cruise)
    throttle_integral: float = 0.0
    wheel: Wheel = field(default_factory=Wheel)
    surroundings: lights.LightSurroundings = field(default_factory=lights.LightSurroundings)


class AebStack(Stack):
    """Drives its lane and brakes for a vehicle that stands in it.

    Works with each slot's own state and nothing else, and what is seen in a frame does not depend
    on frames beside it, so its commands do not depend on the number of slots or on the neighbours.
    """

    takes_device_frames = True
    drives_by_camera = True
    reads = ("vehicle", "environment", "camera", "boxes")
    portable = True  # sums, products, roots and whole numbers; its arc tangent is rounded

    PARAMETERS = (Planner, Controller, LateralParameters, LightsSwitch)

    def __init__(self, slots: int, **parameters: Any) -> None:
        """Build the stack for ``slots`` cars.

        ``parameters`` are fields of :attr:`PARAMETERS`, which state unit and range of each.

        Raises:
            TypeError: there is no such parameter.
            ValueError: a parameter is out of its range, not a number, or would be ignored.
        """
        parts = parameter_parts(self.PARAMETERS, parameters)
        self.planner: Planner = parts[0]
        self.controller: Controller = parts[1]
        self.steering: LateralParameters = parts[2]
        self.switch: LightsSwitch = parts[3]
        sped = self.planner.cruise_speed_mps != Planner().cruise_speed_mps
        if self.controller.cruise == "throttle" and sped:
            raise ValueError("cruise_speed_mps is set, but cruise: throttle does not look at it")
        self._cars: list[_Car | None] = [None] * slots
        self._eyes = Eyes(slots)
        self._drove: list[int] = []

    def expect(self, expected: Sequence[Expected]) -> None:
        """See :meth:`devkit.stack.Stack.expect`."""
        self._eyes.expect(expected)

    def reset(self, slot: int, episode: Episode) -> None:
        """Put a fresh car into ``slot``.

        Raises:
            UsageError: the case has no camera.
        """
        if not episode.cameras:
            raise UsageError("this stack drives by its camera; it cannot run with render: false")
        self._eyes.reset(slot, episode)
        self._cars[slot] = _Car(
            token=episode.token,
            period_s=episode.control_period_ns * 1e-9,
            view=CameraView.of_site(episode.cameras[0]),
            lane=self._lane(episode.cameras[0]),
        )

    def _lane(self, site: CameraSite) -> LaneTrack | None:
        if self.steering.steering == "straight":
            return None
        return LaneTrack(LaneView.of_site(site), self.steering.lines_m, self.steering.chassis)

    def step(self, observation: Observation) -> list[Command]:
        """One command per active slot, ascending."""
        self._drove = slots = observation.active_slots()
        now = _Instant.of(observation)
        cars = [self._car(slot, now) for slot in slots]
        detections = self._eyes.look(slots, observation)
        return [
            self._drive(car, slot, now, detections.get(slot))
            for car, slot in zip(cars, slots, strict=True)
        ]

    def costs(self) -> list[PerceptionCost | None]:
        """See :meth:`devkit.stack.Stack.costs`."""
        return self._eyes.costs(self._drove)

    def _drive(
        self, car: _Car, slot: int, now: _Instant, detections: list[Detection] | None
    ) -> Command:
        speed_mps = now.vehicle[slot][_SPEED]

        self._keep_lane(car, slot, now, detections or [])
        car.state, plan = planning.plan(
            car.state, detections, speed_mps, car.view, self.planner, car.wheel.bend_per_m
        )
        car.throttle_integral, actuation = control.control(
            car.throttle_integral, plan, speed_mps, car.period_s, self.controller
        )
        environment = now.environment[slot]
        car.surroundings = lights.sense(
            car.surroundings, environment[_ILLUMINANCE], environment[_EXTINCTION], self.switch
        )

        return Command(
            slot=slot,
            token=now.token[slot],
            tick=now.tick[slot],
            throttle=actuation.throttle,
            brake=actuation.brake,
            steering_rad=car.wheel.angle_rad,
            aeb=plan.aeb,
            lights=lights.choose(car.surroundings, plan.aeb),
            detections=detections or [],
            trigger=plan.trigger,
            warning=plan.warning,
        )

    def _car(self, slot: int, now: _Instant) -> _Car:
        car = self._cars[slot]
        token = now.token[slot]
        if car is None or car.token != token:
            # Going on with another case's state would be a wrong verdict that nobody notices.
            held = "none" if car is None else str(car.token)
            raise ValueError(f"slot {slot}: observation of token {token}, but reset for {held}")
        return car

    def _keep_lane(self, car: _Car, slot: int, now: _Instant, detections: list[Detection]) -> None:
        """Turn the wheel towards the lane in the camera image."""
        if car.lane is None:
            return
        vehicle, camera = now.vehicle[slot], now.camera
        motion = CarMotion(vehicle[_SPEED], vehicle[_YAW_RATE])
        curve = car.lane.update(
            motion, None if camera is None else on_host(camera)[slot], car.period_s, detections
        )
        car.wheel = steer(
            car.wheel, curve, car.lane.bend, motion.speed_mps, car.period_s, self.steering
        )


@dataclass(frozen=True, slots=True)
class _Instant:
    """Small sensors of all slots as plain numbers: one by one out of arrays costs more."""

    token: list[int]
    tick: list[int]
    vehicle: list[list[float]]
    environment: list[list[float]]
    camera: Any

    @classmethod
    def of(cls, observation: Observation) -> _Instant:
        sensors = observation.sensors
        return cls(
            observation.token.tolist(),
            observation.tick.tolist(),
            sensors["vehicle"].tolist(),
            sensors["environment"].tolist(),
            sensors.get("camera"),
        )
