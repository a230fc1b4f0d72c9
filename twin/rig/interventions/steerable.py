"""What a hand from outside can do to the slots of an engine, between two ticks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from schemas.messages import SensorErrors
from schemas.wire.interventions import ObjectState, PlaceEgo, SetEnvironment
from twin.actors.intervention_motion import HandMotion, ObjectAction
from twin.scenario import families

if TYPE_CHECKING:
    from twin.sensors.exteroceptive import ExteroceptiveSuite
    from twin.sensors.suite import SensorSuite
    from twin.vehicle.fleet import Fleet
    from twin.world.sky.environment import CaseEnvironment
    from twin.world.sky.wind import Winds
    from twin.world.street.build import World


class Steerable:
    """Part of :class:`twin.rig.engine.Engine`; to be called before :meth:`sense` of a tick.

    A slot that is held keeps its case and stands still in sim time, inactive, while others go on;
    its bytes are those of a case that was never held.
    """

    active: np.ndarray
    tick: np.ndarray
    sim_time_ns: np.ndarray
    _runs: list[Any]
    _vehicles: Fleet
    _winds: Winds
    _eyes: ExteroceptiveSuite
    _suite: SensorSuite
    _motion: HandMotion
    _world: World
    _apply: Any

    def __init__(self) -> None:
        self._held: dict[int, tuple[Any, np.ndarray]] = {}

    def hold(self, slot: int) -> None:
        """An active slot stands still."""
        self._held[slot] = self._runs[slot], self._winds.gust(slot)
        self._runs[slot] = None
        self._switch(slot, on=False)

    def go_on(self, slot: int) -> None:
        """A slot that is held goes on. All active slots must be due together: see
        :attr:`Engine.refill_every`."""
        self._runs[slot], gust = self._held.pop(slot)
        self._winds.restore(slot, gust)
        self._switch(slot, on=True)

    def clock_min(self, slot: int) -> float:
        """Local time of a slot [minutes after midnight]."""
        return self._environment(slot).clock_min(int(self.sim_time_ns[slot]))

    def weather(self, slot: int) -> str:
        """Name of a slot's weather; empty: intensities set by hand."""
        return self._environment(slot).shown

    def check_environment(self, slot: int, change: SetEnvironment) -> None:
        """Whether :meth:`set_environment` would take it.

        Raises:
            ValueError: no such weather; one line.
        """
        self._environment(slot).check(change)

    def set_environment(self, slot: int, change: SetEnvironment) -> None:
        """Weather and time of day of a slot from now on.

        Raises:
            ValueError: no such weather; one line.
        """
        environment = self._environment(slot)
        environment.override(change)
        self._apply(slot, environment, int(self.sim_time_ns[slot]))

    def place_ego(self, slot: int, place: PlaceEgo) -> None:
        """Put the ego elsewhere; the scenario begins anew from there."""
        friction = float(self._vehicles.friction[slot])
        self._vehicles.place(
            slot, place.x_m, place.speed_mps, friction, y_m=place.y_m, yaw_rad=place.yaw_rad
        )
        run = self._run_of(slot)
        run.scenario = families.begin(run.case.scenario, run.ground, place.x_m, place.y_m)
        self._eyes.moved(slot)

    def move_object(self, slot: int, action: ObjectAction) -> int:
        """Move, bring in, take away or give back an object of a slot; which one it was.

        Raises:
            ValueError: no such object or kind, or none to spare; one line.
        """
        return self._motion.act(slot, action, self.sim_time_ns / 1e9)

    def objects(self, slot: int) -> list[ObjectState]:
        """The movable objects of a slot."""
        return self._motion.states(slot, self.sim_time_ns / 1e9)

    def sensors_mistake(self, errors: SensorErrors) -> str:
        """What is wrong with changed errors, or an empty string."""
        return self._suite.mistake(errors)

    def _switch(self, slot: int, *, on: bool) -> None:
        self.active[slot] = on
        self._vehicles.active[slot] = int(on)
        self._eyes.hold(slot, held=not on)
        self._suite.hold(slot, held=not on)

    def _run_of(self, slot: int) -> Any:
        return self._held[slot][0] if slot in self._held else self._runs[slot]

    def _environment(self, slot: int) -> CaseEnvironment:
        environment: CaseEnvironment = self._run_of(slot).environment
        return environment
