"""Weather, hour, road and traffic lights of an event become global actions of the program."""

from __future__ import annotations

from dataclasses import dataclass, field

from schemas.names import minutes
from schemas.validation import suggest
from twin.scenario.storyboard.native.ground import NativeMistakes, ScenarioGround
from twin.scenario.storyboard.native.sections import StoryEvent
from twin.scenario.storyboard.program.actions import EnvironmentAction, SetVariableAction
from twin.scenario.storyboard.program.program import ProgramVariable, StoryboardEnvironment
from twin.world.sky.weather import (
    AIR_PER_M,
    MOR_PER_EXTINCTION,
    WEATHER,
    fog_extinction_per_m,
)

SurroundingsAction = EnvironmentAction | SetVariableAction
_SIGNALS_TOLD = 20
"""Most ids that a mistake names."""


def environment_of(name: str, event: StoryEvent) -> StoryboardEnvironment | None:
    """What an event changes of weather, hour and road; None: nothing.

    Args:
        name: of the event.
    """
    if not event.changes_sky:
        return None
    minute = None if event.time_of_day is None else float(minutes(event.time_of_day))
    values: dict[str, float] = {}
    if event.weather is not None:
        weather = WEATHER[event.weather]
        values = {
            "cloud_fraction": weather.cloud_cover,
            "fog_visual_range_m": MOR_PER_EXTINCTION / (fog_extinction_per_m(weather) + AIR_PER_M),
            "rain_mm_per_h": weather.rain_mm_per_h,
            "snow_mm_per_h": weather.snow_mm_per_h,
            "wind_speed_mps": weather.wind_mps,
        }
    return StoryboardEnvironment(
        name, minute_of_day=minute, friction_factor=event.friction_factor, **values
    )


@dataclass(slots=True)
class SurroundingsCompiler:
    """Makes actions on weather, hour, road and traffic lights; environments, variables and words of
    the program come together here."""

    ground: ScenarioGround
    mistakes: NativeMistakes
    environments: list[StoryboardEnvironment] = field(default_factory=list)
    variables: list[ProgramVariable] = field(default_factory=list)
    words: list[str] = field(default_factory=lambda: [""])

    def actions(self, name: str, event: StoryEvent) -> list[tuple[str, SurroundingsAction]]:
        """What an event does, with a name for each."""
        actions: list[tuple[str, SurroundingsAction]] = []
        environment = environment_of(name, event)
        if environment is not None:
            self.environments.append(environment)
            actions.append(("weather", EnvironmentAction(len(self.environments) - 1)))
        for signal, state in event.signals.items():
            number = self._variable(f"events.{name}.signals.{signal}", signal)
            actions.append((f"signal {signal}", SetVariableAction(number, self._word(state))))
        return actions

    def _variable(self, path: str, signal: str) -> int:
        frames = self.ground.roads.frames.values()
        known = [one.id for frame in frames for one in frame.road.signals]
        if signal not in known:
            shown = list(dict.fromkeys(known))[:_SIGNALS_TOLD]
            self.mistakes.add(path, f"no signal '{signal}'; {suggest(signal, shown or ['none'])}")
        names = [variable.name for variable in self.variables]
        if f"signal {signal}" not in names:
            self.variables.append(ProgramVariable(f"signal {signal}", 0.0, text=True))
            return len(names)
        return names.index(f"signal {signal}")

    def _word(self, state: str) -> float:
        if state not in self.words:
            self.words.append(state)
        return float(self.words.index(state))
