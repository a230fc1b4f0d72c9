"""The engine the simulator process drives: slots of cases, sensed and stepped in lockstep."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from schemas.case import Case
from schemas.identity import case_stream
from schemas.kinds.scenario import kind_of
from schemas.messages import Command, Lights, Pose, SensorErrors, command_mistake
from schemas.wire.interventions import PlaceEgo
from twin.actors.intervention_motion import InterventionMotion
from twin.actors.motion import Placement
from twin.base.stopwatch import Stopwatch
from twin.kpi import verdict as judging
from twin.kpi.judge_record import judge_record
from twin.kpi.recorder import KpiRecorder
from twin.render.light.ground_light import GroundLight
from twin.rig.command_delay import put_in_force
from twin.rig.running.case_run import CaseRun
from twin.rig.running.forking import Forking
from twin.rig.running.saving import Keeps, SlotSaver
from twin.rig.slot import Finished
from twin.scenario import families
from twin.scenario.case_files import check_files
from twin.scenario.case_motion import StartPose
from twin.scenario.driving_robot import DrivingRobots
from twin.scenario.surroundings import Surroundings
from twin.sensors.camera.cameras import camera_sites
from twin.sensors.data import SensorData
from twin.sensors.exteroceptive import ExteroceptiveSuite
from twin.sensors.feedback import by_wire, environment
from twin.sensors.lidar.lidars import lidar_sites
from twin.sensors.ray_sensor import Moment
from twin.sensors.suite import SensorSuite
from twin.sensors.vehicle_truth import VehicleTruth
from twin.sensors.wanted import Wanted
from twin.vehicle.carry import Carrier
from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import drivable, height_near
from twin.vehicle.masses import load_of
from twin.vehicle.model import PHYSICS_STEP_NS
from twin.vehicle.nearest import NEAREST
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import known_device, prepare_kernels
from twin.world.sky.environment import CaseEnvironment
from twin.world.sky.wind import Winds
from twin.world.street.build import World, build_world
from twin.world.things import Thing

_HEIGHT = COLUMN["z_m"]
_PLACE = [COLUMN["x_m"], COLUMN["y_m"]]

CARRIED = "co-simulated: the stack commanded the car's poses"
"""Reason beside the verdict of a case whose car the simulator's own model did not move."""


class Engine:
    """Simulates up to ``slots`` cases of one rig at a time.

    Call :meth:`reset` for every new case, then alternate :meth:`sense` and :meth:`step`. Nothing of
    a case depends on its slot or on what else runs.
    """

    rows: KpiRecorder
    """KPI rows of all slots, for those who only look."""

    def __init__(
        self,
        case: Case,
        slots: int,
        device: str = "cpu",
        buffers: Mapping[str, np.ndarray] | None = None,
        watch: Stopwatch | None = None,
    ) -> None:
        """Build for the rig of ``case``: scene, vehicle, camera and rates are those of the case.

        Args:
            slots: number of slots S, at least 1.
            device: ``cpu`` or ``cuda:N``.
            buffers: host arrays that receive images, by the name of the channel
                (:func:`twin.sensors.exteroceptive.frame_channels`).
            watch: told where the time goes: ``sense``, ``render``, ``step``, ``physics``.

        Raises:
            ValueError: scene or vehicle file not usable, or no such device; one line.
        """
        prepare_kernels()
        self._device = known_device(device)
        check_files(case)
        scene = families.scene_of(case)
        vehicle = load_vehicle(case.rig.vehicle)
        self.slots = slots
        self._watch = watch or Stopwatch()
        self.control_period_ns = 1_000_000_000 // case.rig.control_hz
        self.active = np.zeros(slots, np.bool_)
        self.tick = np.zeros(slots, np.int32)
        self.sim_time_ns = np.zeros(slots, np.int64)
        self._steps = self.control_period_ns // PHYSICS_STEP_NS
        self._world = build_world(scene, case.rig.bodies)
        self._motion = families.motion_of(case, vehicle, self._world, slots, self._device)
        script = self._motion or self._world.motion
        self.objects = InterventionMotion(script, self._world.kinds, slots, self._motion)
        """Movable objects of all slots."""
        self._origin = scene.origin
        self._street = self._world.lane_known
        self._winds = Winds(slots, self.control_period_ns / 1e9)
        self._vehicle = vehicle
        self._exteroceptive = ExteroceptiveSuite(
            case, vehicle, scene, self._world, slots, self._device, buffers or {}
        )
        kinds = self._world.kinds
        self._hull_sizes = np.array([(k.half_length_m, k.half_width_m) for k in kinds] or [(0, 0)])
        self._vehicles = self._build_fleet()
        self._carrier = Carrier(self._vehicles, self._steps)
        if case.rig.cosim:
            self._carrier.prepare()
        self._robots = DrivingRobots.of(self._motion, self._vehicles, self._device)
        self.camera_sites = camera_sites(case, vehicle)
        self.lidar_sites = lidar_sites(case, vehicle)
        self._suite = SensorSuite(case, scene.origin, slots, self._device)
        looked_at = self._suite.needs_truth or self._exteroceptive.needs_truth
        self._truth = VehicleTruth(slots, self._device) if looked_at else None
        self.refill_every = math.lcm(self._exteroceptive.period, self._suite.period)
        """New cases begin only at ticks of this period: all sensors are due together then."""
        self._ground_light = GroundLight(self._world, scene.furniture, slots)
        self._extinction_per_m = np.zeros(slots)
        self._runs: list[CaseRun | None] = [None] * slots
        self.rows = KpiRecorder(slots, [thing.name for thing in self._world.things])
        self._forking = Forking(self.rows)
        self._limits = judging.Limits.of(slots)
        self._nearest = np.zeros((slots, len(NEAREST)))
        self._surveyed = False
        """What egos are nearest to is being measured at the current ticks."""
        self._placed_ns = np.full(slots, -1, np.int64)
        """Sim times at which the scripted objects stand in the fleet."""
        self._unmeasured = False  # no vehicle was placed since the state was measured last

    def _build_fleet(self) -> Fleet:
        return Fleet(
            [self._vehicle],
            self.slots,
            self._device,
            colliders=self._world.colliders,
            ground=drivable(self._world, self._device),
            movers=self._world.motion.count,
            stop_at_impact=True,
        )

    @property
    def state(self) -> np.ndarray:
        """Vehicle state [S, T] at the current ticks, columns :data:`twin.vehicle.state.COLUMN`;
        a view, for those who only look."""
        self._refresh()
        return self._vehicles.state[:, 0]

    def _refresh(self) -> None:
        """Measure the vehicles that were placed; once for all that begin together."""
        if self._unmeasured:
            self._vehicles.refresh()
            self._unmeasured = False

    @property
    def world(self) -> World:
        """The world all slots share, for those who only look."""
        return self._world

    @property
    def placement(self) -> Placement:
        """Scripted objects as they were when last sensed, for those who only look."""
        return self._placement

    @property
    def colliders(self) -> np.ndarray:
        """Hulls one can hit [N, 5]: x, y, yaw, half length, half width; first ``cars`` cars."""
        return self._world.colliders

    @property
    def cars(self) -> int:
        """How many of the colliders are cars."""
        return self._world.cars

    def target(self, slot: int) -> int | None:
        """Collider that the scenario of a slot's case is about; None: there is none."""
        index = int(self._vehicles.targets[slot])
        return index if index >= 0 else None

    def closest(self, slot: int) -> tuple[float | None, float | None] | None:
        """Distance [m] and time [s] to collision with what is nearest, at the current tick; None:
        the case of the slot is about its target."""
        run = self._runs[slot]
        if run is None or not kind_of(run.case.variation.scenario).nearest:
            return None
        row = (self._vehicles.nearest() if self._surveyed else self._nearest)[slot].tolist()
        return (row[0] if row[1] >= 0.0 else None, row[2] if row[3] >= 0.0 else None)

    def reset(self, slot: int, case: Case) -> None:
        """Begin ``case`` in ``slot``, at case tick 0."""
        environment = CaseEnvironment(case, self._origin)
        self.objects.begin(slot, case.variation.objects)
        ground = self._ground(slot, case)
        start, ground = self._start(slot, case, ground)
        x_m, y_m, z_m, yaw_rad, speed_mps = start
        self._vehicles.load(slot, load_of(case.variation.scenario))
        self._vehicles.place(
            slot, x_m, speed_mps, 1.0, y_m=y_m, z_m=z_m, yaw_rad=yaw_rad, refresh=False
        )
        if self._robots is not None:
            self._robots.begin(slot)
        self._unmeasured = True  # once for all that begin together
        self._surveyed = False
        self._vehicles.active[slot] = 1
        self._exteroceptive.reset(slot, case)
        self._winds.reset(slot, case_stream(case, "wind"), environment.wind_towards)
        self._suite.reset(slot, case)
        run = families.begin(case.variation.scenario, ground, x_m, y_m)
        self._runs[slot] = CaseRun(case, environment, run, ground)
        kind = kind_of(case.variation.scenario)
        self.rows.begin(
            slot,
            kind.columns,
            target=ground.target is not None,
            nearest=kind.nearest,
            names=[thing.name for thing in self.things(slot)] if self._motion else None,
        )
        self._forking.begin(slot, case)
        self._limits.begin(slot, case.variation.scenario)
        self.active[slot] = True
        self.tick[slot] = 0
        self.sim_time_ns[slot] = 0
        self.apply_environment(slot)

    def _ground(self, slot: int, case: Case) -> Surroundings:
        """What the scenario of a case looks at; distances of its slot are to its target."""
        scenario = case.variation.scenario
        kind = kind_of(scenario)
        target = self._world.collider_of(kind.target)
        self._vehicles.targets[slot] = -1 if target is None else target
        return Surroundings.of(
            self._world, self._vehicle, kind, scenario.scene, street=self._street
        )

    def _start(self, slot: int, case: Case, ground: Surroundings) -> tuple[StartPose, Surroundings]:
        """Where the ego begins, and what the scenario looks at then."""
        if self._motion is None:
            scenario = case.variation.scenario
            x_m, y_m, yaw_rad = families.start_of(scenario, ground)
            z_m = self._world.lane_start_z_m
            return StartPose(x_m, y_m, z_m, yaw_rad, scenario.ego_speed_mps), ground
        start = self._motion.begin(slot, case)
        ground = replace(ground, events=self._motion.events(slot))
        if target := self._motion.target(slot):
            ground = replace(ground, target=target.hull, target_name=target.name)
        return start, ground

    def things(self, slot: int) -> Sequence[Thing]:
        """What the hulls of a slot belong to."""
        things = self._world.things
        if self._motion is None:
            return things
        return [*things[: len(self._world.colliders)], *self._motion.things(slot)]

    def clear(self, slot: int) -> None:
        """Make ``slot`` inactive; its case is forgotten."""
        self._runs[slot] = None
        self._forking.clear(slot)
        if self._motion is not None:
            self._motion.clear(slot)
        self.objects.clear(slot)
        self.active[slot] = False
        self.tick[slot] = self.sim_time_ns[slot] = 0
        self._vehicles.active[slot] = 0
        self._vehicles.targets[slot] = -1
        self._winds.clear(slot)
        self._vehicles.state[slot] = 0.0
        self._exteroceptive.clear(slot)
        self._suite.clear(slot)

    def sense(self, wanted: Wanted = None) -> dict[str, SensorData]:
        """Sensors at the current ticks, those that are due; once per tick. Of those that look at
        the world only what is ``wanted``, messages by name; None: all.

        All active slots are due together: a rig refills slots only every ``refill_every`` ticks.
        """
        for slot, name in self._forking.due(self.tick, self.active):
            self._redraw(slot, name)
        for slot, run in self._running():
            if run.environment.changes:
                self.apply_environment(slot)
        state = self.state
        sensors = {
            "vehicle": SensorData(by_wire(state, self.active)),
            "environment": SensorData(
                environment(self._ground_light.open_lx, self._extinction_per_m, self.active)
            ),
        }
        truth = self._truth.update(self._vehicles.rows_device) if self._truth else None
        own = self._suite.read(truth, self.tick, self.active)
        sensors.update((name, SensorData(values)) for name, values in own.items())
        now = Moment(self.tick, self.sim_time_ns, self.active)
        self._place_objects()
        # It is done long before the stack has answered: no tick waits for it.
        self._survey()
        lamps = self._lamps()
        self._watch.lap("sense")
        images = self._exteroceptive.read(
            now, lamps, self._placement, self._vehicles.ego_device, truth, wanted
        )
        self._watch.lap("render")
        sensors.update(images)
        return sensors

    def _redraw(self, slot: int, name: str) -> None:
        """From now on the random numbers of a slot are those of another name."""
        run = self._run(slot)

        def key(stream: str) -> int:
            return case_stream(run.case, stream, name)

        self._winds.redraw(slot, key("wind"))
        run.delays.redraw(key)
        self._suite.redraw(slot, key)
        self._exteroceptive.redraw(slot, key)

    # --- what interventions need ------------------------------------------------------------

    def hold(self, slot: int) -> None:
        """An active slot stands still in sim time, with its case, while others go on; its bytes
        are those of a case that was never held."""
        self._switch(slot, on=False)

    def go_on(self, slot: int) -> None:
        """A slot that is held goes on. All active slots must be due together: see
        :attr:`refill_every`."""
        self._switch(slot, on=True)

    def environment(self, slot: int) -> CaseEnvironment:
        """Weather, clock and light of the case in a slot."""
        return self._run(slot).environment

    def apply_environment(self, slot: int) -> None:
        """Weather and light of a slot as they are at its sim time."""
        environment = self.environment(slot)
        if self._motion is not None:
            environment.script(self._motion.environment(slot))
        weather, light = environment.at(int(self.sim_time_ns[slot]))
        self._vehicles.friction[slot] = weather.friction
        self._winds.set(slot, weather.wind_mps, weather.gust_mps)
        self._winds.turn(slot, environment.wind_towards)
        self._exteroceptive.light(slot, light, weather, environment.wind_towards)
        self._ground_light.set(slot, light)
        self._extinction_per_m[slot] = weather.extinction_per_m

    def place_ego(self, slot: int, place: PlaceEgo) -> None:
        """Put the ego elsewhere; the scenario begins anew from there. Raises :class:`ValueError`
        where a robot drives it."""
        if self._robots is not None:
            self._robots.refuse(slot)
        friction, x_m, y_m = float(self._vehicles.friction[slot]), place.x_m, place.y_m
        at = {"y_m": y_m, "z_m": height_near(self._world, x_m, y_m, self.state[slot, _HEIGHT])}
        self._vehicles.place(slot, x_m, place.speed_mps, friction, yaw_rad=place.yaw_rad, **at)
        run = self._run(slot)
        run.scenario = families.begin(run.case.variation.scenario, run.ground, x_m, y_m)
        self._exteroceptive.moved(slot)

    def saver(self) -> SlotSaver:
        """Saves slots between two ticks, and goes on with them in others."""
        parts: dict[str, Keeps] = {"vehicles": self._vehicles, "winds": self._winds}
        parts |= {"own": self._suite, "rays": self._exteroceptive}
        parts |= {"rows": self.rows, "forks": self._forking}
        if self._motion is not None and self._robots is not None:
            parts |= {"bodies": self._motion, "robots": self._robots}
        return SlotSaver(self, self._runs, parts)

    def sensors_mistake(self, errors: SensorErrors) -> str:
        """What is wrong with changed errors, or an empty string."""
        return self._suite.mistake(errors)

    def _switch(self, slot: int, *, on: bool) -> None:
        self.active[slot] = on
        self._vehicles.active[slot] = int(on)
        self._winds.hold(slot, held=not on)
        self._exteroceptive.hold(slot, held=not on)
        self._suite.hold(slot, held=not on)
        if self._motion is not None:
            self._motion.hold(slot, held=not on)

    # --- a tick -----------------------------------------------------------------------------

    def _run(self, slot: int) -> CaseRun:
        run = self._runs[slot]
        assert run is not None, f"slot {slot} has no case"
        return run

    def _running(self) -> Iterator[tuple[int, CaseRun]]:
        """Active slots with their cases; those that are held are left out."""
        for slot in np.flatnonzero(self.active).tolist():
            yield slot, self._run(slot)

    def _place_objects(self) -> None:
        """Scripted objects as they are at the current ticks, for cameras, lidars and contacts."""
        self._placement = self.objects.at(self.sim_time_ns / 1e9)
        self._placed_ns[...] = self.sim_time_ns
        self._vehicles.movers[...] = self._placement.hulls(self._hull_sizes)

    def _lamps(self) -> list[Lights | None]:
        """The lamps in force at the current ticks; a command that is due now counts already."""
        lamps: list[Lights | None] = [None] * self.slots
        first_steps = (self.sim_time_ns // PHYSICS_STEP_NS).tolist()
        for slot, run in self._running():
            lamps[slot] = run.lights
            for step, command in run.pending:
                if step <= first_steps[slot]:
                    lamps[slot] = command.lights
        return lamps

    def step(self, commands: list[Command | None]) -> list[Finished]:
        """Record the current tick with its commands, then advance one control period.

        Args:
            commands: one per slot, None for inactive slots.

        Returns:
            The cases that ended, at their last tick or, for commands that are no numbers or out
            of range, at the current one.
        """
        mistakes = {}
        good: list[tuple[int, CaseRun, Command]] = []
        for slot, run in self._running():
            command = commands[slot]
            assert command is not None, f"slot {slot} is active and has no command"
            mistake = command_mistake(command) or self._suite.mistake(command.sensors)
            mistake = mistake or self._carrier.mistake(
                slot, command.pose, allowed=run.case.rig.cosim, first=not run.carried
            )
            if mistake:
                mistakes[slot] = f"{mistake}, at tick {self.tick[slot]}"
            else:
                good.append((slot, run, command))
        if not self._surveyed:
            self._survey()
        self._nearest = self._vehicles.nearest()
        put_in_force(self._vehicles, good, self.tick, self.sim_time_ns, self._steps)
        slots = [slot for slot, _, _ in good]
        if self._robots is not None:
            self._robots.watch(slots)
        self._record(slots, [command for _, _, command in good])
        self._record(list(mistakes), [None] * len(mistakes))
        finished = [self._fail(slot, reason) for slot, reason in mistakes.items()]
        for slot, _, command in good:
            if command.sensors is not None:
                self._suite.modulate(slot, command.sensors)
        self._vehicles.wind[...] = self._winds.advance(self.tick)
        poses = {slot: command.pose for slot, _, command in good if command.pose is not None}
        self._watch.lap("step")
        if poses:
            self._carry(poses)
        else:
            self._advance()
        self._watch.lap("physics")
        self._surveyed = False
        self.tick[self.active] += 1
        self.sim_time_ns[self.active] += self.control_period_ns
        finished += self._ended()
        self._watch.lap("step")
        return finished

    def _advance(self) -> None:
        """One control period of vehicles and of bodies that a scenario moves."""
        if self._robots is None:
            self._vehicles.advance(self._steps)
            return
        moved = self._robots.advance(self.active, self._steps, self._hulls, self.apply_environment)
        for slot in moved:
            self._exteroceptive.moved(slot)

    def _hulls(self) -> np.ndarray:
        """Hulls of what moves at the current ticks, or at the current step of a scenario."""
        return self.objects.hulls(self.sim_time_ns / 1e9, self._hull_sizes)

    def _carry(self, poses: Mapping[int, Pose]) -> None:
        """One control period of which the stack says how it ends in some slots."""
        for slot in poses:
            self._vehicles.active[slot] = 0
        self._vehicles.advance(self._steps)
        for slot in self._carrier.carry(poses):
            self._exteroceptive.moved(slot)
        for slot in poses:
            self._vehicles.active[slot] = 1
            self._run(slot).carried = True

    def wait(self) -> None:
        """Until what was sensed is written: another process may read it then."""
        wp.synchronize_device(self._device)

    def close(self) -> None:
        """Make all slots inactive; the engine is not used afterwards."""
        for slot in range(self.slots):
            self.clear(slot)

    def _record(self, slots: list[int], commands: Sequence[Command | None]) -> None:
        if not slots:
            return
        given = [self._columns(slot, each) for slot, each in zip(slots, commands, strict=True)]
        now = self.tick, self.sim_time_ns, self.state
        self.rows.add(slots, *now, commands, given, self._nearest)
        self._forking.watch(slots)

    def _columns(self, slot: int, command: Command | None) -> Mapping[str, float]:
        """KPI columns that only some families have."""
        columns = self._run(slot).scenario.columns()
        if self._motion is None:
            return columns
        moving = self._motion.columns(slot)
        x_m, y_m, z_m = self.state[slot, [*_PLACE, _HEIGHT]].tolist()
        place_m = moving.get("target_x_m", x_m), moving.get("target_y_m", y_m)
        around = {
            "light_lx": self._ground_light.at(slot, place_m, z_m),
            "road_friction": float(self._vehicles.friction[slot]),
        }
        warning = {} if command is None else {"warning": float(command.warning)}
        return {**columns, **around, **moving, **warning}

    def _survey(self) -> None:
        """Begin to measure what every ego is nearest to at the current ticks, see
        :meth:`Fleet.survey`."""
        self._refresh()
        movers = self._vehicles.movers
        if movers.size and not np.array_equal(self._placed_ns, self.sim_time_ns):
            movers = self._hulls()
        self._vehicles.survey(movers)
        self._surveyed = True

    def _ended(self) -> list[Finished]:
        """The cases that end at the tick just reached."""
        state = self.state
        over = judging.have_ended(self._limits, self.sim_time_ns, state)
        faulty, stuck = self._vehicles.faulty(), dict[int, str]()
        watched = {slot: run.scenario for slot, run in self._running() if not faulty[slot]}
        families.observe_all([*watched.values()], *state[[*watched]][:, _PLACE].T)
        for slot, scenario in watched.items():
            over[slot] |= scenario.ended()
            if self._motion is not None:
                over[slot] |= self._motion.ended(slot)
                if fault := self._motion.fault(slot):
                    stuck[slot], faulty[slot] = fault, True
        finished = []
        ending = np.flatnonzero((over | faulty) & self.active).tolist()
        if ending:
            self._survey()
            self._nearest = self._vehicles.nearest()
            self._surveyed = False
        for slot in ending:
            if faulty[slot]:
                fault = stuck.get(slot) or self._vehicles.fault(slot)
                time_s = self.sim_time_ns[slot] / 1e9
                finished.append(self._fail(slot, f"{fault}, at {time_s:.3f} s"))
            else:
                finished.append(self._judge(slot))
        return finished

    def _judge(self, slot: int) -> Finished:
        run, state = self._run(slot), self.state[slot]
        self._record([slot], [None])
        rows = self.rows.of(slot)
        hit = self._hit(slot)
        result = judging.judge(rows, state, run.scenario, hit)
        reasons = [*result.reasons, *([CARRIED] if run.carried else [])]
        scalars = judging.case_scalars(run.case.variation, rows, state, run.scenario, hit)
        names = judging.names(rows, state, hit)
        table = rows.table()
        record = judge_record(run.case, state, run.ground, hit)
        self.clear(slot)
        return Finished(slot, "verdict", result.verdict, reasons, scalars, table, names, record)

    def _hit(self, slot: int) -> Thing | None:
        """What the ego of a slot hit first."""
        index, things = self._vehicles.first_hit(slot), self.things(slot)
        return things[index] if 0 <= index < len(things) else None

    def fail(self, slot: int, reason: str) -> Finished:
        """End the case of a slot whose stack cannot go on, at the current tick."""
        self._record([slot], [None])
        return self._fail(slot, f"{reason}, at tick {self.tick[slot]}")

    def _fail(self, slot: int, reason: str) -> Finished:
        run, rows = self._run(slot), self.rows.of(slot)
        case, state = run.case.variation, self.state[slot]
        scalars = judging.case_scalars(case, rows, state, run.scenario)
        table = rows.table()
        record = judge_record(run.case, state, run.ground, None)
        self.clear(slot)
        return Finished(slot, "failed", "", [reason], scalars, table, record=record)
