"""The bodies of storyboards in all slots of a rig, moved by one player."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from schemas.case import Case
from schemas.kinds.scenarios.storyboard import KIND
from schemas.sections.free_driving import FreeDriving
from twin.actors.motion import ObjectKind, Placement
from twin.actors.palette import nobody
from twin.road.tables.road_tables import road_tables
from twin.scenario.case_files import check_scenario_files
from twin.scenario.case_motion import CaseTarget, StartPose
from twin.scenario.driver import LedPose, RobotLimits
from twin.scenario.storyboard.case.appearance import INIT, Appearance, appearance_of
from twin.scenario.storyboard.case.bodies import SlotBodies
from twin.scenario.storyboard.case.checks import (
    STEP_NS,
    other_road,
    program_mistakes,
    target_row,
)
from twin.scenario.storyboard.case.files import (
    LoadedStoryboard,
    load_storyboard,
    scene_name,
)
from twin.scenario.storyboard.case.lamps import SlotLamps
from twin.scenario.storyboard.case.moved_bodies import BodyAction, MovedBodies
from twin.scenario.storyboard.case.rig_player import RigPlayer
from twin.scenario.storyboard.case.signals import ProgramSignals
from twin.scenario.storyboard.case.stands import BodyStands
from twin.scenario.storyboard.case.trial import TARGET_COLUMNS
from twin.scenario.storyboard.case.way_ahead import nearest_collision_s
from twin.scenario.storyboard.player.columns import Real, Whole
from twin.scenario.storyboard.program.entities import BodyBox
from twin.scenario.storyboard.program.program import ElementKind, Program
from twin.vehicle.columns import COLUMN, PHYSICS_STEP_NS
from twin.vehicle.vehicle_file import Vehicle
from twin.world.road_scene import road_map
from twin.world.scene import load_scene
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.things import Thing

_BRAKING_MPS2 = 0.3
"""Brake lamps light up when a body slows down more than this [m/s^2]."""
_STILL_MPS = 0.02
"""Slower than this a body stands [m/s]."""
_RATE_MAX = 20.0
"""Faster a body does not turn [rad/s]."""
_PROGRAMS_MAX = 256
_POSE = [
    COLUMN[name] for name in ("x_m", "y_m", "z_m", "yaw_rad", "pitch_rad", "roll_rad", "speed_mps")
]

_LED = (Real.X, Real.Y, Real.Z, Real.HEADING, Real.PITCH, Real.ROLL, Real.SPEED)


_ROWS = ("_way_m", "_yaw_rate", "_steps", "_signal_lamps", "_running", "_full")
"""Arrays of :class:`StoryboardMotion` [S, ...]."""
_REMEMBERED = (
    *("seen", "events_started", "event_last", "event_last_s"),
    *("limits", "led_pose", "intervention", "intervention_step", "environment"),
)
"""What :class:`_SlotCase` remembers from step to step; none of it is changed in place."""


class StoryboardMotion:
    """Bodies of all slots, see :class:`twin.scenario.case_motion.CaseMotion`."""

    actors: Sequence[Any] = ()
    steps = STEP_NS // PHYSICS_STEP_NS

    def __init__(
        self,
        case: Case,
        vehicle: Vehicle,
        kinds: Sequence[ObjectKind],
        slots: int,
        device: Any,  # noqa: ARG002 - see below
        signals: Sequence[str] = (),
    ) -> None:
        """See :class:`twin.scenario.case_motion.CaseMotionMaker`."""
        self.count = case.rig.bodies
        self._kinds = len(kinds)
        self._vehicle = vehicle
        period_ns = 1_000_000_000 // case.rig.control_hz
        if period_ns % STEP_NS:
            raise ValueError(f"control_hz {case.rig.control_hz}: no whole steps of 10 ms")
        loaded = _load(case, vehicle)
        self._scene = scene_file(case)
        roads = road_map(self._scene) if self._scene else None
        tables = road_tables(roads.network) if roads else None
        self._step_s = STEP_NS / 1e9
        self._programs: dict[int, tuple[LoadedStoryboard, Program]] = {}
        # On the CPU whatever the rig's device: what the player says is needed on the host after
        # every step, and a GPU is faster only with a hundred actors or more (record 0028).
        self._player = RigPlayer(self._program(loaded), tables, slots, self._step_s, "cpu")
        self._player.prepare(loaded.ego)
        self._cases: list[_SlotCase | None] = [None] * slots
        self._bodies = SlotBodies(slots, self.count)
        self._moved = MovedBodies(self._player, self._bodies, roads, self._step_s)
        self._all = np.arange(slots)[:, None]
        self._way_m = np.zeros((slots, self.count))
        self._yaw_rate = np.zeros((slots, self.count))
        self._lamps = SlotLamps(slots, self.count, self._step_s)
        self._steps = np.zeros(slots, np.int64)
        self._signals = tuple(signals)
        self._signal_lamps = np.zeros((slots, len(signals)), np.int32)
        self._weathered: list[int] = []
        self._placement = nobody(slots, self.count)
        self._running = np.zeros(slots, np.bool_)
        self._full = np.zeros(slots, np.bool_)
        self._stale = False
        self._ways_s: np.ndarray | None = None

    def _changed(self) -> None:
        """Bodies are elsewhere, or others."""
        self._stale, self._ways_s = True, None

    @property
    def standing(self) -> np.ndarray:
        """See :class:`twin.actors.motion.Motion`; nobody stands where a scene says."""
        return np.zeros(self.count, np.int32)

    def begin(self, slot: int, case: Case) -> StartPose:
        """A case begins: bodies and ego are where they are at time 0 of its storyboard."""
        check_scenario_files(case)
        loaded = _load(case, self._vehicle)
        config = KIND.config_of(case.variation.scenario)
        name = config.storyboard
        wrong = [*program_mistakes(name, loaded)]
        wrong += [f"{name}: {line}" for line in [other_road(self._scene, loaded.road)] if line]
        if wrong:
            raise ValueError(wrong[0])
        self._moved.clear(slot)
        self._player.begin(slot, self._program(loaded), loaded.ego)
        self._cases[slot] = run = _SlotCase(loaded, self._bodies.begin(slot, loaded))
        run.signals = ProgramSignals(loaded.program, self._signals)
        self._begin_appearance(slot, run, by_file=config.environment == "file")
        self._way_m[slot] = self._yaw_rate[slot] = 0.0
        self._changed()
        self._watch([slot])
        if config.trial is not None:
            run.target = target_row(name, loaded, config.trial)
        if config.driver == "robot":
            run.limits = RobotLimits(config.robot_brake, math.radians(config.robot_steering_deg))
            run.free = config.free_driving
            run.led_pose = self._led(slot, run, self._player.bodies.reals.numpy())
        return self._ego(slot)

    def alone(self, slot: int, time_s: float) -> StartPose:
        """Let a slot that has just begun go on by itself, ego and all; where the ego is then."""
        active = np.zeros(len(self._cases), np.bool_)
        active[slot] = True
        for _ in range(round(time_s / self._step_s)):
            self._go_on(active)
        return self._ego(slot)

    def _ego(self, slot: int) -> StartPose:
        row = self._player.bodies.reals.numpy()[slot, self._run(slot).loaded.ego]
        return StartPose(
            float(row[Real.X]),
            float(row[Real.Y]),
            float(row[Real.Z]),
            float(row[Real.HEADING]),
            float(row[Real.SPEED]),
        )

    def clear(self, slot: int) -> None:
        """Nobody is in a slot any more."""
        self._player.end(slot)
        self._moved.clear(slot)
        self._bodies.clear(slot)
        self._cases[slot] = None
        self._signal_lamps[slot] = 0
        self._running[slot] = False
        self._changed()

    def hold(self, slot: int, *, held: bool) -> None:
        """A slot stands still, or goes on as it was."""
        self._player.hold(slot, held=held)

    def save(self, slot: int) -> dict[str, Any]:
        """The storyboard of a slot, its bodies, and what was seen of them.

        Raises:
            ValueError: an intervention has moved a body; one line.
        """
        if self._moved.rows(slot):
            raise ValueError("bodies that an intervention has moved cannot be saved")
        run = self._run(slot)
        return {
            "player": self._player.save(slot),
            "lamps": self._lamps.save(slot),
            "rows": {name: getattr(self, name)[slot].copy() for name in _ROWS},
            "case": {name: getattr(run, name) for name in _REMEMBERED},
        }

    def restore(self, slot: int, saved: dict[str, Any]) -> None:
        """Go on with a storyboard that has just begun in a slot."""
        self._player.restore(slot, saved["player"])
        self._lamps.restore(slot, saved["lamps"])
        for name, values in saved["rows"].items():
            getattr(self, name)[slot] = values
        for name, value in saved["case"].items():
            setattr(self._run(slot), name, value)
        self._changed()

    def step(self, state: np.ndarray, active: np.ndarray) -> None:
        """One step: the storyboards see the egos at its beginning."""
        led = np.array([run is not None and run.limits is not None for run in self._cases])
        self._player.impose_egos(np.ascontiguousarray(state[:, _POSE]), led)
        self._go_on(active)
        rows = self._player.bodies.reals.numpy()
        for slot in np.flatnonzero(active & led).tolist():
            run = self._run(slot)
            run.led_pose = self._led(slot, run, rows)

    def _led(self, slot: int, run: _SlotCase, rows: np.ndarray) -> LedPose:
        """Where the robot has the ego: where the storyboard has it, and straight on at the same
        speed for what is left of a control period when that has ended."""
        row = rows[slot, run.loaded.ego].tolist()
        if self._running[slot]:
            return LedPose(*(row[column] for column in _LED))
        last, step_s = run.led_pose, self._step_s
        return last._replace(
            x_m=last.x_m + row[Real.VX] * step_s,
            y_m=last.y_m + row[Real.VY] * step_s,
            z_m=last.z_m + row[Real.VZ] * step_s,
        )

    def robot(self, slot: int) -> RobotLimits | None:
        """When the robot that drives the ego of a slot lets go; None: the stack drives it."""
        run = self._cases[slot]
        return None if run is None else run.limits

    def led_pose(self, slot: int) -> LedPose:
        """Where the robot of a slot has its ego now."""
        return self._run(slot).led_pose

    def intervene(self, slot: int, kind: int) -> None:
        """The robot of a slot is gone: from the next step on the ego is where the vehicle is."""
        run = self._run(slot)
        run.limits, run.intervention = None, kind
        run.intervention_step = int(self._steps[slot])

    def _go_on(self, active: np.ndarray) -> None:
        entity = self._bodies.entity
        before = self._player.bodies.reals.numpy()[self._all, entity, Real.HEADING]
        self._player.step()
        reals = self._player.bodies.reals.numpy()
        turned = reals[self._all, entity, Real.HEADING] - before
        turned -= 2.0 * np.pi * np.rint(turned / (2.0 * np.pi))
        rate = turned / self._step_s
        # Who is put somewhere else does not turn on the way.
        rate = np.where(np.abs(rate) < _RATE_MAX, rate, 0.0)
        ahead = np.abs(reals[self._all, entity, Real.SPEED]) * self._step_s
        goes_on = active[:, None] & self._bodies.there
        self._yaw_rate = np.where(goes_on, rate, self._yaw_rate)
        self._way_m = np.where(goes_on, self._way_m + ahead, self._way_m)
        self._changed()
        going = np.flatnonzero(active).tolist()
        self._moved.step(going)
        self._watch(going)

    def act(self, slot: int, action: BodyAction) -> int:
        """Carry out an intervention on a body; the body it was done to.

        Raises:
            ValueError: no such body, or it cannot be done; one line.
        """
        body = self._moved.act(slot, action)
        self._yaw_rate[slot, body] = 0.0
        self._changed()
        return body

    def moved(self, slot: int) -> frozenset[int]:
        """Bodies of a slot that an intervention has taken off its storyboard."""
        return self._moved.rows(slot)

    def at(self, time_s: np.ndarray, varied: Any = None) -> Placement:  # noqa: ARG002 - now
        """Where all bodies are now."""
        if self._stale:
            self._placement = self._placed()
            self._stale = False
        return self._placement

    def columns(self, slot: int) -> Mapping[str, float]:
        """Whether the storyboard runs, and its events so far."""
        run = self._run(slot)
        values = {
            "storyboard_running": float(self._running[slot]),
            "events_started": float(run.events_started),
        }
        if run.event_last:
            values |= {"event_last": float(run.event_last), "event_last_s": run.event_last_s}
        if run.limits is not None or run.intervention:
            values["robot_drives"] = float(run.limits is not None)
        if run.intervention:
            values["intervention_kind"] = float(run.intervention)
        if run.target is not None:
            now, at = self.at(np.zeros(0)), (slot, run.target)
            place, velocity = now.position_m[at], now.velocity_mps[at]
            moved = (place[0], place[1], now.yaw_rad[at], velocity[0], velocity[1])
            values |= {name: float(v) for name, v in zip(TARGET_COLUMNS, moved, strict=True)}
        if run.free is not None:
            ttc_s = float(self._way_ttc_s()[slot])
            values |= {"way_ttc_s": ttc_s} if math.isfinite(ttc_s) else {}
        return values

    def _way_ttc_s(self) -> np.ndarray:
        """Truth of what is in the way of the egos [S], of all slots at once; it counts only for
        those of free driving."""
        if self._ways_s is None:
            bodies, car, players = self._bodies, self._vehicle, self._player.bodies
            egos, margins_m = np.zeros((len(self._cases), 1), np.int64), np.zeros(len(self._cases))
            for slot, run in enumerate(self._cases):
                if run is not None and run.free is not None:
                    egos[slot], margins_m[slot] = run.loaded.ego, run.free.margin_m
            at = self._all, np.concatenate([egos, bodies.entity], axis=1)
            # Flat, so that they are left out: rooms without a body.
            half_m = np.where(bodies.there[..., None], bodies.half_m, 0.0)
            own_m = np.broadcast_to([car.length_m / 2, car.width_m / 2], (len(egos), 1, 2))
            middle_m = np.broadcast_to([car.centre_offset_m, 0.0], (len(egos), 1, 2))
            self._ways_s = nearest_collision_s(
                players.reals.numpy()[at],
                players.wholes.numpy()[at],
                np.concatenate([own_m, half_m], axis=1),
                np.concatenate([middle_m, bodies.centre_m], axis=1),
                margins_m[:, None],
            )
        return self._ways_s

    def ended(self, slot: int) -> bool:
        """Whether the storyboard of a slot has ended, or what free driving looks at after a full
        braking."""
        run = self._run(slot)
        if run.free is not None and run.intervention:
            since_s = (int(self._steps[slot]) - run.intervention_step) * self._step_s
            return not self._running[slot] or since_s >= run.free.after_s
        return not self._running[slot]

    def fault(self, slot: int) -> str:
        """The limit of the player that a slot has met, in words."""
        limits = self._player.overflows(slot) if self._full[slot] else ()
        return f"limit of the storyboard met: {limits[0]}" if limits else ""

    def environment(self, slot: int) -> ScriptedEnvironment | None:
        """What the storyboard of a slot has said of weather, light and road so far."""
        run = self._cases[slot]
        return None if run is None else run.environment

    def weathered(self) -> Sequence[int]:
        """Slots in which that has changed since this was asked last."""
        slots, self._weathered = self._weathered, []
        return slots

    def things(self, slot: int) -> Sequence[Thing]:
        """What the bodies of a slot are [M]."""
        return self._run(slot).things

    def target(self, slot: int) -> CaseTarget | None:
        """What the trial of a slot is about, and where it is now; None: the case is no trial."""
        run = self._run(slot)
        if run.target is None:
            return None
        now, at = self.at(np.zeros(0)), (slot, run.target)
        place, half_m = now.position_m[at][:2].tolist(), now.half_m[at].tolist()
        hull = np.array([*place, float(now.yaw_rad[at]), *half_m])
        return CaseTarget(run.things[run.target].name, hull)

    def events(self, slot: int) -> tuple[str, ...]:
        """Names of the events of a slot's storyboard, in the order of its file."""
        return self._run(slot).names

    def _run(self, slot: int) -> _SlotCase:
        run = self._cases[slot]
        assert run is not None, f"slot {slot} has no case"
        return run

    def _program(self, loaded: LoadedStoryboard) -> Program:
        """The program with the rig's vehicle as its ego; the same object each time."""
        if id(loaded) not in self._programs:
            if len(self._programs) >= _PROGRAMS_MAX:
                self._programs.clear()
            program = _with_vehicle(loaded, self._vehicle)
            self._programs[id(loaded)] = (loaded, program)
        return self._programs[id(loaded)][1]

    def _watch(self, slots: Sequence[int]) -> None:
        """What has begun in slots since it was looked at last."""
        now = self._player.now()
        self._steps[slots] = now.steps[slots]
        self._running[slots] = now.running[slots]
        self._full[slots] = now.full[slots]
        for slot in slots:
            run = self._cases[slot]
            if run is None or now.transitions[slot] == run.seen:
                continue
            for step, element in self._player.begun(slot, run.seen):
                number = run.numbers.get(element)
                if number is not None:
                    run.events_started += 1
                    run.event_last, run.event_last_s = number, step * self._step_s
                elif element in run.changes:
                    self._appear(slot, run, element, step)
            run.seen = int(now.transitions[slot])

    def _begin_appearance(self, slot: int, run: _SlotCase, *, by_file: bool) -> None:
        """Lamps and weather of a case that begins are those of its storyboard's Init."""
        self._lamps.begin(slot)
        self._signal_lamps[slot] = 0
        run.appearance = appearance_of(run.loaded, by_file=by_file)
        run.changes = run.appearance.elements
        run.environment = None
        self._appear(slot, run, INIT, 0)

    def _appear(self, slot: int, run: _SlotCase, element: int, step: int) -> None:
        """An action on lamps or weather has begun."""
        for row, action in run.appearance.switches.get(element, ()):
            entity = self._bodies.entity[slot, row]
            modes = int(self._player.bodies.wholes.numpy()[slot, entity, Whole.LIGHTS])
            if modes >> 2 * action.light & 3 == action.mode:  # else others triggered the event
                self._lamps.switch(slot, row, action, step)
        for later in run.appearance.environments.get(element, ()):
            run.environment = later if run.environment is None else run.environment.then(later)
            if element != INIT:
                self._weathered.append(slot)

    def _signals_now(self) -> np.ndarray | None:
        """Lamps of the traffic lights [S, K]; None: there are none."""
        if not self._signals:
            return None
        for slot, run in enumerate(self._cases):
            if run is not None and len(run.signals.columns):
                lamps = run.signals.lamps(self._player.values_of(slot))
                self._signal_lamps[slot, run.signals.columns] = lamps
        return self._signal_lamps.copy()

    def hulls(self) -> np.ndarray:
        """See :class:`twin.scenario.case_motion.CaseMotion`."""
        return self._stands().hulls(self._bodies, self._yaw_rate)

    def _stands(self) -> BodyStands:
        """Where all bodies are, as the player has them."""
        entity, players = self._bodies.entity, self._player.bodies
        return BodyStands.of(
            self._bodies,
            players.reals.numpy()[self._all, entity],
            players.wholes.numpy()[self._all, entity, Whole.VISIBLE],
            self._yaw_rate,
            self._moved.away(),
        )

    def _placed(self) -> Placement:
        """All bodies as the player has them, and how they look."""
        bodies, there, stand = self._bodies, self._bodies.there, self._stands()
        real, velocity, (up_x, up_y, up_z) = stand.real, stand.velocity_mps, stand.up
        modes = self._player.bodies.wholes.numpy()[self._all, bodies.entity, Whole.LIGHTS]
        phase = np.floor(self._way_m / bodies.way_m * bodies.phases).astype(np.int64)
        moving = (np.abs(real[..., Real.SPEED]) > _STILL_MPS) & (bodies.phases > 0)
        kind = bodies.kind + np.where(moving, 1 + phase % np.maximum(bodies.phases, 1), 0)
        climb = np.where(up_z < 1.0, -(velocity[0] * up_x + velocity[1] * up_y) / up_z, 0.0)
        pitch, roll = bodies.lean(real[..., Real.PITCH], real[..., Real.ROLL])
        shown = self._lamps.shown(
            np.where(there, modes, 0),
            bodies.lit,
            real[..., Real.ACCELERATION] < -_BRAKING_MPS2,
            real[..., Real.SPEED] < -_STILL_MPS,
            self._steps,
        )
        return Placement(
            kind=np.where(stand.seen, kind, -1).astype(np.int32),
            position_m=_vectors(there, *stand.place_m, stand.height_m),
            yaw_rad=np.where(there, real[..., Real.HEADING], 0.0),
            velocity_mps=_vectors(there, *velocity, climb),
            yaw_rate_radps=np.where(there, self._yaw_rate, 0.0),
            brake=shown.brake.astype(np.float32),
            lamps=shown.lamps.astype(np.float32),
            half_m=bodies.half_m.copy(),
            class_index=bodies.class_index.copy(),
            lights=shown.lights,
            pitch_rad=pitch,
            roll_rad=roll,
            signals=self._signals_now(),
        )


def _vectors(there: np.ndarray, *parts: np.ndarray) -> np.ndarray:
    """Vectors [S, M, 3]; 0 where nobody is."""
    return np.stack([np.where(there, part, 0.0) for part in parts], axis=-1)


class _SlotCase:
    """What a slot remembers of its case."""

    __slots__ = (
        *("loaded", "things", "names", "numbers", "seen"),
        *("events_started", "event_last", "event_last_s"),
        *("limits", "led_pose", "intervention", "appearance"),
        *("changes", "environment", "signals", "target", "free", "intervention_step"),
    )

    def __init__(self, loaded: LoadedStoryboard, things: tuple[Thing, ...]) -> None:
        elements = loaded.program.elements
        events = [k for k, element in enumerate(elements) if element.kind == ElementKind.EVENT]
        self.loaded = loaded
        self.things = things
        self.names = tuple(elements[k].name for k in events)
        self.numbers = {element: number for number, element in enumerate(events, start=1)}
        """Number of each event by its element."""
        self.seen = 0
        """Transitions that have been looked at."""
        self.events_started = 0
        self.event_last = 0
        """0: none has begun."""
        self.event_last_s = 0.0
        self.limits: RobotLimits | None = None
        """Of the robot that drives the ego; None: the stack does."""
        self.led_pose = LedPose(*[0.0] * len(LedPose._fields))
        self.target: int | None = None
        """Body that the trial is about; None: the case is no trial."""
        self.intervention = 0
        """How the stack intervened; 0: it has not."""
        self.intervention_step = 0
        """The step of the storyboard then."""
        self.free: FreeDriving | None = None
        """Which full brakings are false; None: the case is no free driving."""
        self.appearance: Appearance
        """What its actions do to lamps and weather."""
        self.changes: set[int]
        """Elements of these."""
        self.environment: ScriptedEnvironment | None = None
        """What it has said of the weather so far."""
        self.signals: ProgramSignals


def scene_file(case: Case) -> str:
    """OpenDRIVE file of the scene of a case; empty: its scene has none."""
    config = KIND.config_of(case.variation.scenario)
    if case.rig.scene == config.storyboard:
        return scene_name(config)
    scene: str = load_scene(case.rig.scene).opendrive
    return scene


def _load(case: Case, vehicle: Vehicle) -> LoadedStoryboard:
    config = KIND.config_of(case.variation.scenario)
    return load_storyboard(config.storyboard, config.numbers, vehicle)


def _with_vehicle(loaded: LoadedStoryboard, vehicle: Vehicle) -> Program:
    """The program with the vehicle's bounding box in place of the ego's."""
    box = BodyBox(
        vehicle.centre_offset_m,
        0.0,
        vehicle.height_m / 2,
        vehicle.length_m,
        vehicle.width_m,
        vehicle.height_m,
    )
    entities = list(loaded.program.entities)
    entities[loaded.ego] = msgspec.structs.replace(entities[loaded.ego], box=box)
    return msgspec.structs.replace(loaded.program, entities=tuple(entities))
