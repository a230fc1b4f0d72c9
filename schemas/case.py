"""One test case: the rig that it needs, and what makes it differ from others on that rig.

Everything a case needs is inside its :class:`Case`; nothing about it depends on where it stands in
the file, so cases may be reordered, added and removed without changing the verdict of another.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from schemas.names import Name
from schemas.sections.autonomy import Sandbox, Told
from schemas.sections.camera import Camera
from schemas.sections.environment import Environment
from schemas.sections.foreign import Foreign
from schemas.sections.fork import FORKS_MAX, Fork
from schemas.sections.lidar import Lidar
from schemas.sections.objects import ObjectVariation
from schemas.sections.perception import Perception
from schemas.sections.repeated import CaseOrigin
from schemas.sections.scenario import Scenario
from schemas.sections.sensors import Sensors
from schemas.sections.stack_identity import StackSource
from schemas.sections.view_mode import Keep, View

CASE_VERSION = 2
"""Version of the shape of a case in leases, drive records and journals; 1: release 0.1, one mapping
of all its fields (:mod:`schemas.first_stage`)."""

Clock = Literal["lockstep", "realtime"]
"""What sim time waits for: the stack, or the wall clock."""


class _Part(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of what a case consists of: frozen, unknown keys are errors."""


class RigSpec(_Part, frozen=True, kw_only=True):
    """What a rig is built for: the simulator with its world, vehicle and sensors, and the stack.

    Cases of equal specifications share a rig, whatever their variations. All of it is in the rig's
    key (:func:`schemas.identity.rig_key`), files by their contents.
    """

    simulator: Literal["warp", "noop"]
    control_hz: int
    clock: Clock = "lockstep"
    """What sim time waits for."""
    scene: str
    """Name of a shipped scene, or the path of a scene file; or of the file of its scenario that
    says where the case takes place."""
    vehicle: str
    """Name of a shipped vehicle, or the path of a vehicle file."""
    files: dict[str, str] = {}
    """SHA-256 of the files that scene, vehicle and networks name, by path."""
    camera: Camera
    cameras: list[Camera] = []
    lidars: list[Lidar] = []
    sensor_hz: dict[str, int] = {}
    """Rates of the vehicle's own sensors that are there, by name [Hz]."""
    render: bool = True
    """Whether its cameras see."""
    view: View = "live"
    """What its simulator shows: a rig has a recorder beside it or has none."""
    keep: Keep = "all"
    """Which of its recordings are kept."""
    stack: str
    """Entry point; empty for a command that speaks the drive plane itself."""
    foreign: Foreign | None = None
    """The stack's own process; None: a class alone."""
    source: StackSource = StackSource()
    """What the stack consists of, beside what its entry point or command says."""
    parameters: dict[str, bool | int | float | str]
    """Keyword arguments of the stack class."""
    slots: int = 0
    """Most cases at once; 0: as many as the worker has slots."""
    placement: Literal["worker", "inline", "node"]
    models: list[str] = []
    """Paths of all networks of the campaign: what a stack's process may read lies open from its
    start."""
    sandbox: Sandbox = "default"
    """What its stack is kept from; no result depends on it."""
    cosim: bool = False
    """The stack may command the car's poses."""
    bodies: int = 0
    """Room for so many bodies that scenarios bring."""

    @property
    def seeing(self) -> list[Camera]:
        """The cameras that see, the main one first."""
        return [self.camera, *self.cameras] if self.render else []

    def slots_of(self, offered: int) -> int:
        """Slots of the rig on a worker that offers so many; a clock is that of one case."""
        if self.clock == "realtime":
            return 1
        return min(self.slots, offered) if self.slots else offered


class Variation(_Part, frozen=True, kw_only=True):
    """What a slot is given for one case; no rig is built anew for any of it."""

    id: str
    """``yolov3-0500-heavy_fog``: stable, unique in its campaign."""
    campaign: str
    seed: int
    deadline_s: float
    scenario: Scenario
    """Scenario as the campaign has it; what is built of its scene and vehicle is the rig's."""
    formula: str = ""
    """Formula of a search, whose margin is among its scalars; empty: there is none."""
    sensors: Sensors = Sensors()
    """Errors of the vehicle's own sensors; which there are, and how often they speak, is the
    rig's."""
    environment: Environment = Environment()
    latency_ms: int
    latency_jitter_ms: int = 0
    rate_hz: int = 0
    drop: float = 0.0
    model: str
    """Name of the perception variant."""
    perception: Perception
    files: dict[str, str] = {}
    """SHA-256 of the files that the perception variant and the scenario name, by path."""
    time_of_day_min: Annotated[int, Meta(ge=0, lt=1440)]
    """Local time [minutes after midnight]."""
    weather: Name
    """One of :data:`schemas.names.WEATHERS`, or a custom one of its environment."""
    objects: dict[str, ObjectVariation] = {}
    """Scripted objects that differ from the scene."""
    repeat: int
    batch: int
    """Number of its batch, a label only, from 1; 0 without batches."""
    drive: Keep = "none"
    """Whether the record of its drive plane is kept."""
    tell: list[Told] = []
    """What its stack is told beyond what it needs, sorted."""
    origin: CaseOrigin | UnsetType = UNSET
    """The case that it repeats in another campaign; unset: none."""
    forks: Annotated[list[Fork], Meta(min_length=1, max_length=FORKS_MAX)] | UnsetType = UNSET
    """Whose random numbers it has, from its start on by the first of them; unset: its own."""


class Case(_Part, frozen=True, kw_only=True):
    """One test case, complete in itself; this is what a lease carries."""

    rig: RigSpec
    variation: Variation

    @property
    def id(self) -> str:
        """The case's name in its campaign, which everything about it goes by."""
        return self.variation.id
