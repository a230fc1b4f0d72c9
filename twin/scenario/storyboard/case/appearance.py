"""What the actions of a scenario do to lamps and weather, by the elements that do it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from twin.scenario.storyboard.case.files import LoadedStoryboard
from twin.scenario.storyboard.player.instances import ActionInstance, program_instances
from twin.scenario.storyboard.program.actions import EnvironmentAction, LightAction
from twin.scenario.storyboard.program.program import Program, StoryboardEnvironment
from twin.world.sky.scripted import ScriptedEnvironment

INIT = -1
"""Stands for the element of actions that are done at the beginning."""
_NONE_ELSEWHERE = ("name", "time_of_day_s", "temperature_k")
"""Of an environment, what has no effect on light, air and road."""


@dataclass(frozen=True, slots=True)
class Appearance:
    """Make it with :func:`appearance_of`."""

    switches: dict[int, list[tuple[int, LightAction]]]
    """Bodies, by their rows, and what may be done to a lamp of theirs, by elements."""
    environments: dict[int, list[ScriptedEnvironment]]
    """Weather, light and road, by elements."""

    @property
    def elements(self) -> set[int]:
        """Elements that do anything of it."""
        return {*self.switches, *self.environments}


def appearance_of(loaded: LoadedStoryboard, *, by_file: bool) -> Appearance:
    """What the actions of a scenario do.

    Args:
        by_file: its environment actions count.
    """
    program = loaded.program
    switches: defaultdict[int, list[tuple[int, LightAction]]] = defaultdict(list)
    environments: defaultdict[int, list[ScriptedEnvironment]] = defaultdict(list)
    rows = {entity: row for row, entity in enumerate(loaded.bodies)}
    for instance in _instances(program):
        action = instance.action
        if isinstance(action, LightAction) and instance.actor in rows:
            switches[instance.element].append((rows[instance.actor], action))
        elif isinstance(action, EnvironmentAction) and by_file:
            environment = scripted_environment(program.environments[action.environment])
            environments[instance.element].append(environment)
    return Appearance(dict(switches), dict(environments))


def scripted_environment(environment: StoryboardEnvironment) -> ScriptedEnvironment:
    """An environment of a program as the sky takes it."""
    names = (n for n in environment.__struct_fields__ if n not in _NONE_ELSEWHERE)
    return ScriptedEnvironment(**{name: getattr(environment, name) for name in names})


def _instances(program: Program) -> Iterator[ActionInstance]:
    """Instances of actions on lamps and weather; none is looked for where there are none."""
    actions = [element.action for element in program.elements]
    actions += [init.action for init in program.init]
    if any(isinstance(action, LightAction | EnvironmentAction) for action in actions):
        yield from program_instances(program).rows
