"""What interventions change in the slots of an engine, between two ticks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from schemas.wire.interventions import (
    OBJECTS_SHOWN_MAX,
    Action,
    FreeObject,
    InterventionState,
    MoveObject,
    ObjectState,
    PlaceEgo,
    RemoveObject,
    SetEnvironment,
    SetSensors,
    SpawnObject,
)
from twin.rig.interventions.case import AttemptInterventions
from twin.vehicle.state import COLUMN

if TYPE_CHECKING:
    from twin.rig.engine import Engine


class SlotChanges:
    """Applies actions to an engine and says how its slots stand; to be used before
    :meth:`Engine.sense` of a tick."""

    def __init__(self, engine: Engine, rig: str) -> None:
        self.engine = engine
        self._rig = rig

    def check(self, slot: int, action: Action) -> None:
        """Refuse what cannot be done before any of it is.

        Raises:
            ValueError: no such weather, or errors out of range; one line.
        """
        match action:
            case SetEnvironment():
                self.engine.environment(slot).check(action)
            case SetSensors(errors):
                if mistake := self.engine.sensors_mistake(errors):
                    raise ValueError(mistake)

    def apply(self, slot: int, action: Action) -> int:
        """Carry out an action on what is simulated; the object that it was done to, or -1.

        Raises:
            ValueError: it cannot be done; one line, and nothing has changed.
        """
        match action:
            case SetEnvironment():
                self.engine.environment(slot).override(action)
                self.engine.apply_environment(slot)
            case PlaceEgo():
                self.engine.place_ego(slot, action)
            case MoveObject() | SpawnObject() | RemoveObject() | FreeObject():
                engine = self.engine
                return engine.objects.act(slot, action, engine.sim_time_ns / 1e9)
        return -1

    def objects(self, slot: int) -> list[ObjectState]:
        """Movable objects of a slot."""
        states = self.engine.objects.states(slot, self.engine.sim_time_ns / 1e9)
        things = self.engine.things(slot)[len(self.engine.colliders) :]
        return [replace(state, name=things[state.object].name) for state in states]

    def clock_min(self, slot: int) -> float:
        """Local time of a slot [minutes after midnight]."""
        return self.engine.environment(slot).clock_min(int(self.engine.sim_time_ns[slot]))

    def weather(self, slot: int) -> str:
        """Name of a slot's weather; empty: intensities of somebody's own."""
        return self.engine.environment(slot).shown

    def state(self, slot: int, attempt: AttemptInterventions, *, whole: bool) -> InterventionState:
        """State of the case in a slot; ``whole``: with its objects."""
        engine, lease = self.engine, attempt.lease
        row = engine.state[slot]

        def value(name: str) -> float:
            return float(row[COLUMN[name]])

        return InterventionState(
            campaign=lease.case.variation.campaign,
            case=lease.case.id,
            attempt=lease.attempt,
            token=lease.token,
            rig=self._rig,
            slot=slot,
            tick=int(engine.tick[slot]),
            sim_time_ns=int(engine.sim_time_ns[slot]),
            paused=attempt.paused,
            taken_over=attempt.drive is not None,
            pace=attempt.pace,
            changes=attempt.changes,
            weather=self.weather(slot),
            time_of_day_min=self.clock_min(slot),
            x_m=value("x_m"),
            y_m=value("y_m"),
            yaw_rad=value("yaw_rad"),
            speed_mps=value("speed_mps"),
            throttle=value("throttle"),
            brake=value("brake"),
            steering_rad=value("steering_rad"),
            objects=self.objects(slot)[:OBJECTS_SHOWN_MAX] if whole else [],
        )

    def is_in_phase(self, slot: int) -> bool:
        """Whether a held slot may go on: active slots are due for their sensors together."""
        engine = self.engine
        active = engine.tick[engine.active]
        return not len(active) or bool((active[0] - engine.tick[slot]) % engine.refill_every == 0)
