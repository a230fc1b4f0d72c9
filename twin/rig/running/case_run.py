"""What an engine's slot remembers of its case."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from schemas.case import Case
from schemas.messages import Command, Lights
from twin.rig.command_delay import Delays
from twin.scenario.protocol import ScenarioRun
from twin.scenario.surroundings import Surroundings
from twin.world.sky.environment import CaseEnvironment

_NO_LIGHTS = Lights()


@dataclass(slots=True)
class CaseRun:
    """The case of a slot, from its start to its end."""

    case: Case
    environment: CaseEnvironment
    scenario: ScenarioRun
    ground: Surroundings
    pending: deque[tuple[int, Command]] = field(default_factory=deque)
    """Commands with the physics step from which they are in force."""
    delays: Delays = field(init=False)
    """Between command and effect."""
    lights: Lights = _NO_LIGHTS
    """Lamps in force."""
    carried: bool = False
    """The stack has commanded a pose."""

    def __post_init__(self) -> None:
        self.delays = Delays(self.case)
