"""Scenario files for tests, made from a few words."""

from __future__ import annotations

from pathlib import Path

from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native
from twin.scenario.storyboard.program.program import ElementKind, Program, StoryElement

EGO = "{lane: 2, s_m: 100, speed_mps: 20}"


def scenario_text(
    actors: str = "", events: str = "", *, ego: str = EGO, road: str = "motorway", end: str = ""
) -> str:
    """A scenario file; ``actors`` and ``events`` are lines of these sections, not indented."""
    text = f"scenario: test\nroad: {road}\nego: {ego}\n"
    for name, lines in (("actors", actors), ("events", events)):
        if lines:
            text += f"{name}:\n" + "".join(f"  {line}\n" for line in lines.strip().splitlines())
    return text + (f"end: {end}\n" if end else "")


def program_of(folder: Path, text: str) -> Program:
    """The program of a scenario file with this text."""
    path = folder / "scenario.yaml"
    path.write_text(text)
    return compile_native(load_native(path))


def mistakes_of(folder: Path, text: str) -> list[str]:
    """What is wrong with a scenario file, without the file's name."""
    try:
        program_of(folder, text)
    except ValueError as error:
        start = f"{folder / 'scenario.yaml'}: "
        lines = str(error).splitlines()
        assert all(line.startswith(start) for line in lines)
        return [line.removeprefix(start) for line in lines]
    return []


def event_elements(program: Program) -> dict[str, StoryElement]:
    """Events by the actor and name."""
    events = {}
    for element in program.elements:
        if element.kind is ElementKind.EVENT:
            group = program.elements[program.elements[element.parent].parent]
            events[f"{group.name} {element.name}"] = element
    return events


def actions_of(program: Program, event: str) -> list[object]:
    """Actions of an event, by ``actor name``."""
    index = program.elements.index(event_elements(program)[event])
    return [one.action for one in program.elements if one.parent == index]
