"""Interventions in a running case: requests, answers, and the journal of what was done.

A request names a case, or a slot of a rig, and one action. It is applied at the case's next control
tick, before anything is sensed, and the answer says which tick that was. Actions that change what
is simulated (:data:`CHANGING`) are journalled with the attempt and cost the case its verdict; those
that only change when it is simulated (pause, step, resume, pace) leave every byte as it was.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.case import Case
from schemas.messages import Lights, SensorErrors
from schemas.sections.environment import Conditions
from schemas.wire.bounds import STEPS_MAX

Metres = Annotated[float, Meta(ge=-1e5, le=1e5)]
Radians = Annotated[float, Meta(ge=-1e3, le=1e3)]
Share = Annotated[float, Meta(ge=0, le=1)]

OBJECTS_SHOWN_MAX = 256
"""Objects that a :class:`InterventionState` lists, at most."""


class _Action(Struct, frozen=True, forbid_unknown_fields=True, tag_field="action"):
    """Base of all actions: frozen, told apart by the key ``action``."""


class Query(_Action, frozen=True, tag="look"):
    """Change nothing; the answer says how the case stands."""


class SetEnvironment(_Action, frozen=True, tag="environment"):
    """Weather and time of day from now on, whatever the campaign's timeline says."""

    weather: str = ""
    """One of the presets or of the campaign's own; empty: see ``conditions``."""
    conditions: Conditions | None = None
    """Intensities instead of ``weather``; with neither the weather stays."""
    time_of_day_min: Annotated[float, Meta(ge=0, lt=1440)] | None = None
    """Minutes after midnight; None: the time stays."""


class PlaceEgo(_Action, frozen=True, tag="pose"):
    """Put the ego's reference point somewhere, level and settled; its collisions are forgotten."""

    x_m: Metres
    y_m: Metres
    yaw_rad: Radians
    speed_mps: Annotated[float, Meta(ge=0, le=100)] = 0.0


class SetLights(_Action, frozen=True, tag="lights"):
    """The ego's lamps whatever the stack says; None: as the stack says again."""

    lights: Lights | None


class SetSensors(_Action, frozen=True, tag="sensors"):
    """Errors of the car's own sensors: noise, bias (0 compensates it) and dropouts."""

    errors: SensorErrors


class SetPace(_Action, frozen=True, tag="pace"):
    """Sim time per wall time, at most; None: as fast as it goes."""

    factor: Annotated[float, Meta(ge=0.01, le=1000)] | None


class Pause(_Action, frozen=True, tag="pause"):
    """Stand still at the next tick; other cases of the rig go on."""


class Step(_Action, frozen=True, tag="step"):
    """Go on for so many ticks, then stand still."""

    ticks: Annotated[int, Meta(ge=1, le=STEPS_MAX)] = 1


class Resume(_Action, frozen=True, tag="resume"):
    """Go on."""


class MoveObject(_Action, frozen=True, tag="move"):
    """Take an object off its script: from a place straight ahead at a speed.

    A body of a storyboard that is on a road keeps to its height, whatever ``z_m`` says.
    """

    object: Annotated[int, Meta(ge=0)]
    x_m: Metres
    y_m: Metres
    z_m: Metres = 0.0
    yaw_rad: Radians = 0.0
    speed_mps: Annotated[float, Meta(ge=-100, le=100)] = 0.0


class SpawnObject(_Action, frozen=True, tag="spawn"):
    """Bring in an object of a kind that the scene has and that is not there now."""

    kind: str
    x_m: Metres
    y_m: Metres
    z_m: Metres = 0.0
    yaw_rad: Radians = 0.0
    speed_mps: Annotated[float, Meta(ge=-100, le=100)] = 0.0


class RemoveObject(_Action, frozen=True, tag="remove"):
    """Take an object away."""

    object: Annotated[int, Meta(ge=0)]


class FreeObject(_Action, frozen=True, tag="free"):
    """Give an object back to its script; a body of a storyboard goes on from where it is."""

    object: Annotated[int, Meta(ge=0)]


class Takeover(_Action, frozen=True, tag="takeover"):
    """Drive instead of the stack: takes the place of its command until another one or a release.

    Unless a pace is set the case runs in real time meanwhile.
    """

    throttle: Share = 0.0
    brake: Share = 0.0
    steering_rad: Annotated[float, Meta(ge=-1.5, le=1.5)] = 0.0


class GiveBack(_Action, frozen=True, tag="release"):
    """The stack drives again."""


Setting = SetEnvironment | PlaceEgo | SetLights | SetSensors | SetPace
"""What a request may ask for together with others."""

SETTINGS_MAX = 16
"""Most settings of one :class:`Together`."""


class Together(_Action, frozen=True, tag="together"):
    """Several settings at the same tick: all of them, or none if one is refused."""

    settings: Annotated[list[Setting], Meta(min_length=1, max_length=SETTINGS_MAX)]


Action = (
    Query
    | SetEnvironment
    | PlaceEgo
    | SetLights
    | SetSensors
    | SetPace
    | Pause
    | Step
    | Resume
    | MoveObject
    | SpawnObject
    | RemoveObject
    | FreeObject
    | Takeover
    | GiveBack
    | Together
)

CHANGING = (
    SetEnvironment,
    PlaceEgo,
    SetLights,
    SetSensors,
    MoveObject,
    SpawnObject,
    RemoveObject,
    FreeObject,
    Takeover,
    GiveBack,
)
"""Actions that change what is simulated."""


class ControlRequest(Struct, frozen=True):
    """One action on one case."""

    v: int
    id: str
    """Id chosen by the asker; the same one again is answered again and done once."""
    action: Action
    case: str = ""
    """Id of the case, on a rig's own key; empty: ``slot`` names it."""
    slot: int = -1
    """Slot of the case, on a rig's own key."""
    token: int = 0
    """Attempt that is meant; 0: whichever runs."""


class ObjectState(Struct, frozen=True, array_like=True):
    """A movable object of the scene, or a body of the scenario."""

    object: int
    kind: str
    present: bool
    x_m: float
    y_m: float
    yaw_rad: float
    by_hand: bool
    """Whether it is off its script."""
    name: str = ""
    """Name of the object in its scene or scenario."""


class InterventionState(Struct, frozen=True):
    """How a running case stands."""

    campaign: str
    case: str
    attempt: int
    token: int
    rig: str
    slot: int
    tick: int
    """The next control tick: what is asked now is applied there."""
    sim_time_ns: int
    paused: bool
    taken_over: bool
    pace: float | None
    changes: int
    """Actions so far that cost the case its verdict."""
    weather: str
    """Name of the weather; empty: intensities of one's own."""
    time_of_day_min: float
    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    throttle: float
    brake: float
    steering_rad: float
    objects: list[ObjectState] = []


class ControlReply(Struct, frozen=True):
    """Answer to a :class:`ControlRequest`; ``error`` not empty: nothing was changed, and why."""

    v: int
    error: str = ""
    token: int = 0
    tick: int = -1
    """Control tick at which it was applied."""
    object: int = -1
    """The object that was brought in."""
    state: InterventionState | None = None
    """State of the case afterwards."""


# --- the journal of an attempt -------------------------------------------------------------------

JOURNAL_FILE = "interventions.jsonl"
"""File beside ``kpi.parquet``: a line :class:`JournalHead`, a line :class:`RecordedAction` per
action and, if the attempt came to its end, a line :class:`JournalEnd`."""


class JournalHead(Struct, frozen=True, tag_field="line", tag="attempt"):
    """Which attempt this is, with all that is needed to run it again."""

    v: int
    attempt: int
    software: str
    """Software digest."""
    device_class: str
    slots: int
    """Slots of its rig."""
    case: Case


class RecordedAction(Struct, frozen=True, tag_field="line", tag="intervention"):
    """One action, applied before its tick was sensed."""

    tick: int
    sim_time_ns: int
    action: Action


class JournalEnd(Struct, frozen=True, tag_field="line", tag="end"):
    """How the attempt ended."""

    outcome: str
    verdict: str
    """Verdict that it would have been; no verdict of the case."""
    kpi_sha256: str
    ticks: int


JournalLine = JournalHead | RecordedAction | JournalEnd


def changes_simulation(action: Action) -> bool:
    """Whether an action changes what is simulated."""
    return any(isinstance(part, CHANGING) for part in parts_of(action))


def parts_of(action: Action) -> list[Action]:
    """Parts of an action: itself, or its settings."""
    return [*action.settings] if isinstance(action, Together) else [action]
