"""Actions of a storyboard program; what each does to an actor (ASAM OpenSCENARIO XML 1.3)."""

from __future__ import annotations

from enum import IntEnum

from twin.scenario.storyboard.program.conditions import DistanceFrame
from twin.scenario.storyboard.program.places import Position
from twin.scenario.storyboard.program.record import ProgramRecord


class DynamicsShape(IntEnum):
    """Curve of a transition from one value to another."""

    LINEAR = 0
    CUBIC = 1
    SINUSOIDAL = 2
    STEP = 3


class DynamicsDimension(IntEnum):
    """What the value of a transition means."""

    TIME = 0
    """Its duration [s]."""
    RATE = 1
    """Change per second; the peak one of a cubic or sinusoidal transition."""
    DISTANCE = 2
    """The way during which it takes place [m]."""


class TransitionDynamics(ProgramRecord, frozen=True):
    """How a value changes."""

    shape: DynamicsShape
    dimension: DynamicsDimension
    value: float


class MotionLimits(ProgramRecord, frozen=True):
    """Limits of a controlled motion; infinite where none are given."""

    acceleration_max_mps2: float = float("inf")
    deceleration_max_mps2: float = float("inf")
    speed_max_mps: float = float("inf")
    acceleration_rate_max_mps3: float = float("inf")
    deceleration_rate_max_mps3: float = float("inf")


class Displacement(IntEnum):
    """On which side of the referenced entity the actor keeps its distance."""

    ANY = 0
    AHEAD = 1
    """Leading, or to the left."""
    BEHIND = 2
    """Trailing, or to the right."""


class SpeedAction(ProgramRecord, frozen=True):
    """Change speed; relative to another entity where ``entity`` is not -1."""

    dynamics: TransitionDynamics
    entity: int
    value: float
    """[m/s], or a factor."""
    factor: bool = False
    continuous: bool = False


class SpeedProfileEntry(ProgramRecord, frozen=True):
    """One speed of a profile and the time since the one before; negative: as fast as allowed."""

    speed_mps: float
    duration_s: float


class SpeedProfileAction(ProgramRecord, frozen=True):
    """Pass through a row of speeds."""

    entity: int
    """Speeds are relative to it; -1: absolute."""
    entries: tuple[SpeedProfileEntry, ...]
    follow: bool
    """Within the limits; else exactly."""
    limits: MotionLimits


class LongitudinalDistanceAction(ProgramRecord, frozen=True):
    """Keep a distance or, where ``time_gap``, a time gap to another entity."""

    entity: int
    value: float
    """[m] or [s]."""
    time_gap: bool
    freespace: bool
    continuous: bool
    frame: DistanceFrame
    displacement: Displacement
    limits: MotionLimits


class LaneChangeAction(ProgramRecord, frozen=True):
    """Change to a lane: by id or, where ``entity`` is not -1, counted from that entity's lane."""

    dynamics: TransitionDynamics
    entity: int
    lane: int
    target_offset_m: float


class LaneOffsetAction(ProgramRecord, frozen=True):
    """Move to an offset from the centre of the lane, relative to another entity's if given."""

    shape: DynamicsShape
    lateral_acceleration_max_mps2: float
    """Infinite: not given."""
    entity: int
    offset_m: float
    continuous: bool


class LateralDistanceAction(ProgramRecord, frozen=True):
    """Keep a lateral distance to another entity."""

    entity: int
    distance_m: float
    freespace: bool
    continuous: bool
    frame: DistanceFrame
    displacement: Displacement
    limits: MotionLimits


class FinalSpeedKind(IntEnum):
    """How an actor's speed at the end of a synchronisation is given."""

    NONE = 0
    ABSOLUTE = 1
    RELATIVE_TO_MASTER = 2


class SteadyStateKind(IntEnum):
    """When the final speed is reached, before the end of a synchronisation."""

    NONE = 0
    DISTANCE = 1
    TIME = 2


NEARLY_STEADY = 0.001
"""So little of a way [m] or a time [s] is none where a speed follows from their quotient."""


class SynchronizeAction(ProgramRecord, frozen=True):
    """Arrive at a position when a master arrives at its own."""

    master: int
    master_position: Position
    position: Position
    final_speed: FinalSpeedKind
    final_speed_mps: float
    steady_state: SteadyStateKind
    steady_state_value: float
    tolerance_master_m: float
    tolerance_m: float
    trajectory: int = -1
    """Along which the actor's position lies at :attr:`trajectory_s_m`; -1: none."""
    trajectory_s_m: float = 0.0
    master_trajectory: int = -1
    master_trajectory_s_m: float = 0.0
    steady_slack: float = 1e-6
    """The steady part begins where less than this is left before it, of its way [m] or its time
    [s]. With less than :data:`NEARLY_STEADY` an actor may stand still for a step before it, as in
    esmini."""


class TeleportAction(ProgramRecord, frozen=True):
    """Be somewhere else at once."""

    position: Position


class AssignRouteAction(ProgramRecord, frozen=True):
    """Follow a route (index) from now on."""

    route: int


class AcquirePositionAction(ProgramRecord, frozen=True):
    """Go to a position along the shortest way."""

    position: Position
    routes: tuple[int, ...]
    """Shortest ways to a fixed position from each road and direction, made with the program:
    route (index, -1: none) by ``2 * road + (0 along s, 1 against it)``."""


class FollowTrajectoryAction(ProgramRecord, frozen=True):
    """Follow a trajectory (index)."""

    trajectory: int
    timed: bool
    absolute_time: bool
    """Times count from the beginning of the scenario; else of the action."""
    time_scale: float
    time_offset_s: float
    follow: bool
    """Following mode ``follow``, else ``position``; both put the default controller on the line."""
    initial_distance_m: float


class ControllerAction(ProgramRecord, frozen=True):
    """Who moves the actor: True: its controller, False: the default one, None: as before."""

    lateral: bool | None
    longitudinal: bool | None
    model: int = -1
    """Driver model (index of :attr:`Program.models`) that becomes its controller; -1: as before."""


class VisibilityAction(ProgramRecord, frozen=True):
    """Who sees the actor."""

    graphics: bool
    sensors: bool
    traffic: bool


class LampMode(IntEnum):
    """What a lamp of an entity does."""

    UNSAID = 0
    """The scenario has said nothing of it."""
    ON = 1
    FLASHING = 2
    OFF = 3


class LightAction(ProgramRecord, frozen=True):
    """A lamp of the actor."""

    light: int
    """Index of :data:`LIGHTS`."""
    mode: int
    """A :class:`LampMode`."""
    on_s: float
    off_s: float


LIGHTS = (
    "daytimeRunningLights",
    "lowBeam",
    "highBeam",
    "fogLights",
    "fogLightsFront",
    "fogLightsRear",
    "brakeLights",
    "warningLights",
    "indicatorLeft",
    "indicatorRight",
    "reversingLights",
    "licensePlateIllumination",
    "specialPurposeLights",
)
"""Lamps of vehicles, spelled as in OpenSCENARIO."""
UNSEEN = ("licensePlateIllumination", "specialPurposeLights")
"""Of these the ones that no body has."""


class ConnectTrailerAction(ProgramRecord, frozen=True):
    """Couple a trailer (index) to the actor's hitch."""

    trailer: int


class DisconnectTrailerAction(ProgramRecord, frozen=True):
    """Let go of the trailer at the actor's hitch, if there is one."""


class EnvironmentAction(ProgramRecord, frozen=True):
    """Weather, light and time of day (index of :attr:`Program.environments`)."""

    environment: int


class AddEntityAction(ProgramRecord, frozen=True):
    """Put an entity into the world."""

    entity: int
    position: Position


class DeleteEntityAction(ProgramRecord, frozen=True):
    """Take an entity out of the world."""

    entity: int


class SetVariableAction(ProgramRecord, frozen=True):
    """Set a variable, parameter or signal; words are numbered (:attr:`Program.words`)."""

    variable: int
    value: float


class ModifyVariableAction(ProgramRecord, frozen=True):
    """Multiply a variable, then add to it."""

    variable: int
    factor: float
    addend: float


class SignalPhaseAction(ProgramRecord, frozen=True):
    """Put a controller of traffic signals (index) into a phase (index), from which it goes on."""

    controller: int
    phase: int


class CommandAction(ProgramRecord, frozen=True):
    """A command of the user; only noted as an event."""

    words: str


PrivateAction = (
    SpeedAction
    | SpeedProfileAction
    | LongitudinalDistanceAction
    | LaneChangeAction
    | LaneOffsetAction
    | LateralDistanceAction
    | SynchronizeAction
    | TeleportAction
    | AssignRouteAction
    | AcquirePositionAction
    | FollowTrajectoryAction
    | ControllerAction
    | VisibilityAction
    | LightAction
    | ConnectTrailerAction
    | DisconnectTrailerAction
)
GlobalAction = (
    EnvironmentAction
    | AddEntityAction
    | DeleteEntityAction
    | SetVariableAction
    | ModifyVariableAction
    | CommandAction
    | SignalPhaseAction
)
Action = PrivateAction | GlobalAction
