"""What is wrong with cases of storyboards, before one of them is leased."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from schemas.case import Case
from schemas.files.assets import file_digest
from schemas.files.yaml_file import YamlError
from schemas.kinds.scenarios.storyboard import KIND
from schemas.sections.trial import Trial
from schemas.validation import suggest
from twin.scenario.storyboard.case.appearance import INIT, appearance_of
from twin.scenario.storyboard.case.files import LoadedStoryboard, load_storyboard
from twin.vehicle.vehicle_file import Vehicle, load_vehicle
from twin.world.roadside.roadside import road_mistake
from twin.world.scene import load_scene
from twin.world.sky.scripted import ScriptedEnvironment
from twin.world.things import NAME_MAX

STEP_NS = 10_000_000
"""Step of storyboards."""


def case_mistakes(cases: Sequence[Case]) -> list[str]:
    """One line for each thing that is wrong, each once."""
    names = dict.fromkeys(case.rig.vehicle for case in cases)
    vehicles = {name: _vehicle(name) for name in names}
    lines = [line for case in cases for line in _mistakes(case, vehicles[case.rig.vehicle])]
    return list(dict.fromkeys(lines)) or list(_weather_mistakes(cases))


def _weather_mistakes(cases: Sequence[Case]) -> Iterator[str]:
    """Scenarios that are run in several weathers, and say the weather themselves."""
    weathers: dict[tuple[str, str], dict[str, Case]] = {}
    for case in cases:
        config = KIND.config_of(case.variation.scenario)
        of_scenario = weathers.setdefault((config.storyboard, config.environment), {})
        of_scenario.setdefault(case.variation.weather, case)
    for (name, environment), by_weather in weathers.items():
        if len(by_weather) < 2 or environment != "file":
            continue
        numbers = KIND.config_of(next(iter(by_weather.values())).variation.scenario).numbers
        if says_weather(load_storyboard(name, numbers)):
            yield (
                f"{name}: the file says the weather, so that {', '.join(by_weather)} are the same: "
                "set scenario.environment: campaign, or leave one weather"
            )


def says_weather(loaded: LoadedStoryboard) -> bool:
    """Whether a scenario says clouds, fog and precipitation from its beginning on."""
    said = ScriptedEnvironment()
    for element, environments in appearance_of(loaded, by_file=True).environments.items():
        event = loaded.program.elements[element].parent
        if element == INIT or loaded.program.elements[event].start is None:
            for environment in environments:
                said = said.then(environment)
    precipitation = said.rain_mm_per_h is not None or said.snow_mm_per_h is not None
    return precipitation and None not in (said.cloud_fraction, said.fog_visual_range_m)


def _vehicle(name: str) -> Vehicle | None:
    """A vehicle; None: its file has mistakes, which are said where vehicles are looked at."""
    try:
        return load_vehicle(name)
    except (ValueError, YamlError):
        return None


def _mistakes(case: Case, vehicle: Vehicle | None) -> Iterator[str]:
    scenario = case.variation.scenario
    config = KIND.config_of(scenario)
    name = config.storyboard
    if case.rig.cosim:
        yield f"{name}: type {KIND.name} and autonomy.cosim cannot be had together"
    if scenario.ego_speed_mps:
        yield f"{name}: it says how fast the ego is at the start; leave ego_speed_mps away"
    if (1_000_000_000 // case.rig.control_hz) % STEP_NS:
        yield (
            f"control_hz: given {case.rig.control_hz}; type {KIND.name} needs control periods of "
            "whole steps of 10 ms, so at most 100 Hz"
        )
    try:
        loaded = load_storyboard(name, config.numbers, vehicle)
    except (ValueError, YamlError) as error:
        yield from (line if name in line else f"{name}: {line}" for line in str(error).splitlines())
        return
    yield from program_mistakes(name, loaded)
    if config.trial is not None:
        try:
            target_row(name, loaded, config.trial)
        except ValueError as error:
            yield str(error)
    yield from _place_mistakes(case, name, loaded)


def program_mistakes(name: str, loaded: LoadedStoryboard) -> Iterator[str]:
    """What of a scenario a case cannot have."""
    program = loaded.program
    if len(loaded.bodies) > KIND.bodies:
        yield f"{name}: {len(loaded.bodies)} actors beside the ego, at most {KIND.bodies}"
    long = [entity.name for entity in program.entities if len(entity.name) > NAME_MAX]
    yield from (f"{name}: name '{other[:30]}...' is too long" for other in long)


def target_row(name: str, loaded: LoadedStoryboard, trial: Trial) -> int:
    """Body of a scenario that a trial is about.

    Args:
        name: of the scenario, for messages.
        loaded: the scenario.
        trial: the trial.

    Raises:
        ValueError: it has no such body; one line.
    """
    names = [loaded.program.entities[index].name for index in loaded.bodies]
    if not names:
        raise ValueError(f"{name}: a trial needs an actor beside the ego, it has none")
    if not trial.target:
        return 0
    if trial.target not in names:
        raise ValueError(f"{name}: trial.target: {suggest(trial.target, names)}")
    return names.index(trial.target)


def _place_mistakes(case: Case, name: str, loaded: LoadedStoryboard) -> Iterator[str]:
    """Whether the rig's scene is where the storyboard takes place."""
    if case.rig.scene == name:
        if not loaded.road:
            yield f"{name}: it has no road; name a scene in scenario.scene"
        elif mistake := road_mistake(load_scene(loaded.road)):
            yield mistake
        return
    try:
        scene = load_scene(case.rig.scene)
    except (ValueError, YamlError):
        return  # said where scenes are looked at
    if mistake := other_road(scene.opendrive, loaded.road):
        yield f"{name}: {mistake}"
    elif scene.objects:
        yield f"{name}: the scene {case.rig.scene} has objects of its own, which it cannot have"


def other_road(scene: str, storyboard: str) -> str:
    """Why roads of a storyboard, a file, are not those of a scene; empty: they are."""
    if not storyboard:
        return ""
    if not scene:
        return "it takes place on a road, and the scene is none"
    try:
        if file_digest(Path(scene)) == file_digest(Path(storyboard)):
            return ""
    except OSError as error:
        return f"{error.filename}: {error.strerror}"
    return f"it takes place on {storyboard}, not on the scene's {scene}"
