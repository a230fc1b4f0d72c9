"""Interventions in one running case, and when it may go on because of them. No clock, no I/O.

Times of the wall clock come in as arguments; what they decide is when a tick is simulated, never
what is in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from msgspec import structs

from schemas.messages import Command, Lights, SensorErrors
from schemas.wire.control import Lease, Touch
from schemas.wire.interventions import (
    Action,
    GiveBack,
    Pause,
    Query,
    RecordedAction,
    Resume,
    SetLights,
    SetPace,
    SetSensors,
    Step,
    Takeover,
    Together,
    changes_simulation,
)

DRIVE_SILENCE_S = 2.0
"""A takeover without a word for so long is given back to the stack [s]."""
PAUSE_SILENCE_S = 600.0
"""A pause without a word for so long ends: nobody is there any more [s]."""
ANSWERS_MAX = 64
"""Answers that are kept for requests that come again."""
LATE_S = 0.25
"""A case that fell behind its pace by more goes on from now, and does not catch up [s]."""


@dataclass(slots=True)
class AttemptInterventions:
    """State of an attempt as interventions have left it."""

    lease: Lease
    paused: bool = False
    until_tick: int = 0
    """Ticks before this one still run while the case is paused."""
    pace: float | None = None
    drive: Takeover | None = None
    lights: Lights | None = None
    errors: SensorErrors | None = None
    """Errors for the next command only."""
    changes: int = 0
    note: Touch | None = None
    answers: dict[str, bytes] = field(default_factory=dict)
    replay: list[RecordedAction] = field(default_factory=list)
    """Actions of a journal that are still to come; nothing else is taken then."""
    replayed: bool = False
    """Whether the case runs from a journal."""
    clocked: bool = False
    """Whether its rig goes with the wall clock, whatever is asked."""
    heard_s: float = 0.0
    drive_s: float = 0.0
    paced_tick: int = -1
    paced_s: float = 0.0

    @property
    def timed(self) -> bool:
        """The wall clock has a say in when it goes on, or a journal has something to come."""
        return self.paused or self.pace is not None or self.drive is not None or bool(self.replay)

    @property
    def commands(self) -> bool:
        """The stack's commands are changed."""
        return self.drive is not None or self.lights is not None or self.errors is not None

    def take(self, action: Action, tick: int, now_s: float) -> None:
        """An action that was accepted, at the next control tick of its case."""
        if not isinstance(action, Query):  # a page that somebody left open looks for ever
            self.heard_s = now_s
        match action:
            case Pause():
                self.paused, self.until_tick = True, tick
            case Step(ticks):
                self.paused, self.until_tick, self.drive_s = True, tick + ticks, now_s
            case Resume():
                self.paused, self.drive_s = False, now_s
            case SetPace(factor):
                self.pace, self.paced_tick = factor, -1
            case Takeover():
                self.drive, self.drive_s = action, now_s
            case GiveBack():
                self.drive = None
            case SetLights(lights):
                self.lights = lights
            case SetSensors(errors):
                self.errors = errors
        if changes_simulation(action):
            self.changes += 1

    def overdue(self, now_s: float) -> Action | None:
        """Action that follows because nobody has said a word for too long; None: none yet."""
        if self.replayed:
            return None
        if self.drive is not None and now_s - self.drive_s >= DRIVE_SILENCE_S and not self.paused:
            return GiveBack()
        if self.paused and now_s - self.heard_s >= PAUSE_SILENCE_S:
            return Resume()
        return None

    def wait_s(self, tick: int, period_s: float, now_s: float) -> float:
        """Time that ``tick`` is to wait: for its pace, or without an end while paused [s]."""
        if self.paused and tick >= self.until_tick:
            self.paced_tick = -1
            return math.inf
        pace = self.pace
        paced = self.replayed or self.clocked
        if pace is None and self.drive is not None and not paced:
            pace = 1.0
        if pace is None:
            return 0.0
        if self.paced_tick < 0 or tick < self.paced_tick:
            self.paced_tick, self.paced_s = tick, now_s
        due_s = self.paced_s + (tick - self.paced_tick) * period_s / pace
        if now_s - due_s > LATE_S:
            self.paced_tick, self.paced_s = tick, now_s
        return due_s - now_s

    def changed(self, command: Command) -> Command:
        """The stack's command with what interventions have put in its place."""
        if self.drive is not None:
            command = structs.replace(
                command,
                throttle=self.drive.throttle,
                brake=self.drive.brake,
                steering_rad=self.drive.steering_rad,
                handbrake=0.0,
                reverse=False,
                aeb=False,
                pose=None,
            )
        if self.lights is not None:
            command = structs.replace(command, lights=self.lights)
        if self.errors is not None:
            command = structs.replace(command, sensors=self.errors)
            self.errors = None
        return command

    def remember(self, id_: str, answer: bytes) -> None:
        """Keep an answer for a request that comes again."""
        while len(self.answers) >= ANSWERS_MAX:
            del self.answers[next(iter(self.answers))]
        self.answers[id_] = answer

    def label(self) -> str:
        """Label for views; empty: nobody has intervened."""
        now = "by hand" if self.drive is not None else "paused" if self.paused else ""
        return now or ("steered" if self.changes else "")


def told(action: Action) -> str:
    """An action in a few words."""
    if isinstance(action, Together):
        return ", ".join(told(part) for part in action.settings)
    values = structs.asdict(action)
    words = [f"{k}={_shown(v)}" for k, v in values.items() if v not in (None, "")]
    name = str(type(action).__struct_config__.tag)
    if isinstance(action, Takeover):
        return name  # twenty a second, each with other values
    return " ".join([name, *words])


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if hasattr(value, "__struct_fields__"):
        default = type(value)()
        changed = {
            name: getattr(value, name)
            for name in value.__struct_fields__
            if getattr(value, name) != getattr(default, name)
        }
        return "(" + " ".join(f"{k}={_shown(v)}" for k, v in changed.items()) + ")"
    return str(value)
