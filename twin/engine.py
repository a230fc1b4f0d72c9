"""The engine the simulator process drives: slots of cases, sensed and stepped in lockstep."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from schemas.campaign import Case
from schemas.identity import stream_key
from schemas.messages import Command, Lights, command_mistake
from twin.kpi import verdict as judging
from twin.kpi.recorder import Recorder
from twin.kpi.table import KpiTable
from twin.render.camera import RayCamera
from twin.render.geometry import Geometry
from twin.render.light import fill_light, switch_lamps
from twin.sensors.boxes import BoxSensor
from twin.sensors.feedback import by_wire, environment
from twin.sensors.suite import SensorSuite
from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import drivable
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.scene import load_scene
from twin.world.street import build_world
from twin.world.sun import daylight
from twin.world.weather import WEATHER

HAZARD_PERIOD_NS = 666_000_000
"""Blink period of hazard lamps: 90 per minute (UN R48 asks for 60 to 120) [ns]."""

_NO_LIGHTS = Lights()


@dataclass(frozen=True, slots=True)
class SensorData:
    """One sensor's values for all slots; inactive slots hold zeros."""

    values: np.ndarray
    """[S, ...]; valid until the next call of the engine."""
    count: np.ndarray | None = None
    """int32 [S]: valid rows of ragged data."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A case that has ended; its slot is inactive already."""

    slot: int
    outcome: str
    """``verdict``, or ``failed``: the case cannot be simulated, deterministically."""
    verdict: str
    """Empty when failed."""
    passed: bool
    reasons: list[str]
    scalars: dict[str, float | int | None]
    table: KpiTable


@dataclass(slots=True)
class _Run:
    """What a slot remembers of its case."""

    case: Case
    recorder: Recorder = field(default_factory=Recorder)
    pending: deque[tuple[int, Command]] = field(default_factory=deque)
    """Commands with the physics step from which they are in force."""
    lights: Lights = _NO_LIGHTS
    """Lamps in force."""


class Engine:
    """Simulates up to ``slots`` cases of one rig at a time.

    Call :meth:`reset` for every new case, then alternate :meth:`sense` and :meth:`step`. Nothing of
    a case depends on its slot or on what else runs.
    """

    def __init__(
        self, case: Case, slots: int, device: str = "cpu", image_out: np.ndarray | None = None
    ) -> None:
        """Build for the rig of ``case``: scene, vehicle, camera and rates are those of the case.

        Args:
            slots: number of slots S, at least 1.
            device: ``cpu`` or ``cuda:N``.
            image_out: uint8 [S, H, W, 3] host buffer that receives the images.

        Raises:
            ValueError: scene or vehicle file not usable, or no such device; one line.
        """
        prepare_kernels()
        try:
            warp_device = wp.get_device(device)
        except Exception as error:
            known = ", ".join(str(d) for d in wp.get_devices())
            raise ValueError(f"device '{device}': not here; allowed: {known}") from error
        scene = load_scene(case.scenario.scene)
        vehicle = load_vehicle(case.scenario.vehicle)
        self.slots = slots
        self.control_period_ns = 1_000_000_000 // case.control_hz
        self.camera_every = case.control_hz // case.camera.hz
        self.active = np.zeros(slots, np.bool_)
        self.tick = np.zeros(slots, np.int32)
        self.sim_time_ns = np.zeros(slots, np.int64)
        self._steps = self.control_period_ns // PHYSICS_STEP_NS
        self._world = build_world(scene)
        self._vehicle = vehicle
        self._geometry = Geometry(self._world, slots, warp_device)
        self._camera = RayCamera(
            self._geometry,
            self._world,
            scene.furniture,
            case.camera,
            tuple(vehicle.camera_m),
            tuple(vehicle.headlamps_m),
            image_out,
        )
        self._boxes = BoxSensor(self._geometry.classes, slots, warp_device)
        self._vehicles = Fleet(
            [vehicle],
            slots,
            warp_device,
            colliders=self._world.colliders,
            ground=drivable(self._world, warp_device),
            stop_at_impact=True,
        )
        self._suite = SensorSuite(case, scene.origin, slots, warp_device)
        self.refill_every = math.lcm(self.camera_every, self._suite.period)
        """New cases begin only at ticks of this period: all sensors are due together then."""
        self._illuminance_lx = np.zeros(slots)
        self._extinction_per_m = np.zeros(slots)
        self._runs: list[_Run | None] = [None] * slots

    @property
    def state(self) -> np.ndarray:
        """Vehicle state [S, T] at the current ticks, columns :data:`twin.vehicle.state.COLUMN`;
        a view, for those who only look."""
        return self._vehicles.state[:, 0]

    @property
    def colliders(self) -> np.ndarray:
        """Hulls one can hit [N, 5]: x, y, yaw, half length, half width; the obstacle comes first,
        then ``cars`` - 1 parked cars."""
        return self._world.colliders

    @property
    def cars(self) -> int:
        """How many of the colliders are cars."""
        return self._world.cars

    def reset(self, slot: int, case: Case) -> None:
        """Begin ``case`` in ``slot``, at case tick 0."""
        weather = WEATHER[case.weather]
        light = daylight(case.time_of_day_min, weather)
        scenario = case.scenario
        rear = self._world.obstacle_rear_m
        x_m = rear - scenario.ego_start_m - self._vehicle.front_offset_m
        self._vehicles.place(slot, x_m, scenario.ego_speed_mps, weather.friction)
        self._vehicles.active[slot] = 1
        row = self._camera.lights.host[slot]
        fill_light(row, light, weather)
        row["noise"] = int(case.camera.noise)
        row["key"] = stream_key(case.seed, case.id, f"camera/{case.camera.name}")
        row["active"] = 1
        self._illuminance_lx[slot] = light.illuminance_lx
        self._extinction_per_m[slot] = weather.extinction_per_m
        self._suite.reset(slot, case)
        self._runs[slot] = _Run(case)
        self.active[slot] = True
        self.tick[slot] = 0
        self.sim_time_ns[slot] = 0

    def clear(self, slot: int) -> None:
        """Make ``slot`` inactive; its case is forgotten."""
        self._runs[slot] = None
        self.active[slot] = False
        self.tick[slot] = 0
        self.sim_time_ns[slot] = 0
        self._vehicles.active[slot] = 0
        self._vehicles.state[slot] = 0.0
        self._camera.lights.host[slot]["active"] = 0
        self._camera.clear(slot)
        self._suite.clear(slot)

    def sense(self) -> dict[str, SensorData]:
        """Sensors at the current ticks, those that are due; once per tick.

        All active slots are due together: a rig refills slots only every ``refill_every`` ticks.
        """
        state = self.state
        sensors = {
            "vehicle": SensorData(by_wire(state, self.active)),
            "environment": SensorData(
                environment(self._illuminance_lx, self._extinction_per_m, self.active)
            ),
        }
        own = self._suite.read(self._vehicles.rows_device, self.tick, self.active)
        sensors.update((name, SensorData(values)) for name, values in own.items())
        due = self.tick[self.active] % self.camera_every == 0
        assert due.all() or not due.any(), "active slots are not due for a frame together"
        if due.any():
            self._write_lights()
            self._geometry.place(self._world.motion.at(self.sim_time_ns / 1e9))
            image = self._camera.render(self._vehicles.ego_device)
            boxes, count = self._boxes.read(self._camera.boxes)
            sensors["camera"] = SensorData(image)
            sensors["boxes"] = SensorData(boxes, count)
        return sensors

    def _write_lights(self) -> None:
        rows = self._camera.lights.host
        for slot, run in enumerate(self._runs):
            if run is None:
                continue
            # A command that is in force from this very step on lights the frame already.
            first_step = int(self.sim_time_ns[slot]) // PHYSICS_STEP_NS
            lights = run.lights
            for step, command in run.pending:
                if step <= first_step:
                    lights = command.lights
            row = rows[slot]
            row["tick"] = self.tick[slot]
            switch_lamps(row, lights)
            phase = int(self.sim_time_ns[slot]) % HAZARD_PERIOD_NS
            row["hazard"] = float(2 * phase < HAZARD_PERIOD_NS)

    def step(self, commands: list[Command | None]) -> list[Finished]:
        """Record the current tick with its commands, then advance one control period.

        Args:
            commands: one per slot, None for inactive slots.

        Returns:
            The cases that ended, at their last tick or, for commands that are no numbers or out
            of range, at the current one.
        """
        finished = []
        for slot, run in enumerate(self._runs):
            if run is None:
                continue
            command = commands[slot]
            assert command is not None, f"slot {slot} is active and has no command"
            mistake = command_mistake(command) or self._suite.mistake(command.sensors)
            if mistake:
                self._record(slot, run, None)
                reason = f"{mistake}, at tick {self.tick[slot]}"
                finished.append(self._fail(slot, run, reason))
                continue
            self._record(slot, run, command)
            self._schedule(slot, run, command)
            if command.sensors is not None:
                self._suite.modulate(slot, command.sensors)
        self._vehicles.advance(self._steps)
        for slot, run in enumerate(self._runs):
            if run is None:
                continue
            self.tick[slot] += 1
            self.sim_time_ns[slot] += self.control_period_ns
            ended = self._end(slot, run)
            if ended is not None:
                finished.append(ended)
        return finished

    def close(self) -> None:
        """Make all slots inactive; the engine is not used afterwards."""
        for slot in range(self.slots):
            self.clear(slot)

    def _schedule(self, slot: int, run: _Run, command: Command) -> None:
        """Work out which commands are in force in the coming period, and from which step.

        Commands come once per period and all wait equally long, so at most one takes over inside a
        period.
        """
        first_step = int(self.sim_time_ns[slot]) // PHYSICS_STEP_NS
        delay = -(-run.case.latency_ms * 1_000_000 // PHYSICS_STEP_NS)
        run.pending.append((first_step + delay, command))
        vehicles = self._vehicles
        vehicles.first_step[slot] = first_step
        vehicles.commands[slot, 0, 0] = vehicles.commands[slot, 0, 1]
        vehicles.switch_step[slot] = self._steps
        while run.pending and run.pending[0][0] < first_step + self._steps:
            step, current = run.pending.popleft()
            asked = (current.throttle, current.brake, current.steering_rad)
            vehicles.commands[slot, 0, 1, : len(asked)] = asked
            vehicles.switch_step[slot] = step - first_step
            run.lights = current.lights

    def _record(self, slot: int, run: _Run, command: Command | None) -> None:
        state = self.state[slot]
        run.recorder.add(int(self.tick[slot]), int(self.sim_time_ns[slot]), state, command)

    def _end(self, slot: int, run: _Run) -> Finished | None:
        """The finished case if it ends at the tick just reached."""
        state = self.state[slot]
        fault = self._vehicles.fault(slot)
        if fault:
            return self._fail(slot, run, f"{fault}, at {self.sim_time_ns[slot] / 1e9:.3f} s")
        if not judging.has_ended(run.case.scenario, int(self.sim_time_ns[slot]), state):
            return None
        self._record(slot, run, None)
        result = judging.judge(run.case.scenario, run.recorder, state)
        scalars = judging.scalars(run.recorder, state)
        table = run.recorder.table()
        self.clear(slot)
        return Finished(
            slot, "verdict", result.verdict, result.passed, result.reasons, scalars, table
        )

    def _fail(self, slot: int, run: _Run, reason: str) -> Finished:
        scalars = judging.scalars(run.recorder, self.state[slot])
        table = run.recorder.table()
        self.clear(slot)
        return Finished(slot, "failed", "", False, [reason], scalars, table)
