"""References within a scenario: entities, storyboard elements, parameters, variables, signals."""

from __future__ import annotations

import os
from pathlib import Path

from schemas.validation import suggest
from twin.scenario.storyboard.openscenario.element import ScenarioElement, ScenarioMistakes
from twin.scenario.storyboard.openscenario.expression import Value

STORYBOARD_TYPES = {
    "Story": "story",
    "Act": "act",
    "ManeuverGroup": "maneuverGroup",
    "Maneuver": "maneuver",
    "Event": "event",
    "Action": "action",
}
"""Elements of a storyboard with the words of ``storyboardElementType``."""
_ENTITY_REFERENCES = ("entityRef", "masterEntityRef", "trailerRef")
_NAMED_ONCE = (
    *("ScenarioObject", "EntitySelection", "Story", "Act", "ManeuverGroup", "Maneuver"),
    *("Event", "Action", "VariableDeclaration", "MonitorDeclaration", "TrafficSignalController"),
    "Phase",
)
_CONTROLLED = ("TrafficSignalControllerAction", "TrafficSignalControllerCondition")


def check_references(
    scenario: ScenarioElement, parameters: dict[str, Value], mistakes: ScenarioMistakes
) -> None:
    """Note every name that a scenario refers to and that does not exist, and names given twice."""
    names = _Names(scenario, parameters)
    for element in scenario.walk():
        _names_once(element, mistakes)
        for words in names.faults(element):
            mistakes.add(element.file, element.line, words)
    for element in scenario.walk():
        if element.name == "LogicFile":
            _road_file(element, scenario.file, mistakes)


def named_path(file: Path, name: str) -> Path:
    """The file or folder that another file names, as seen from there.

    ``..`` takes the folder before it away, so nothing has to be there that is only passed.
    """
    return Path(os.path.normpath(file.parent / name))


def _names_once(element: ScenarioElement, mistakes: ScenarioMistakes) -> None:
    known: set[tuple[str, str]] = set()
    for child in element.children:
        key = child.type_name, child.label
        if element.name == "Entities":
            key = "", child.label
        if child.type_name in _NAMED_ONCE and key in known:
            words = f"the name '{child.label}' is given to a second {child.name} of {element.name}"
            mistakes.add(child.file, child.line, words)
        known.add(key)


def _road_file(element: ScenarioElement, scenario: Path, mistakes: ScenarioMistakes) -> None:
    path = named_path(scenario, str(element.values.get("filepath", "")))
    if not path.is_file():
        mistakes.add(element.file, element.line, f"the road file {path} is missing")


class _Names:
    """Everything in a scenario that something may refer to."""

    def __init__(self, scenario: ScenarioElement, parameters: dict[str, Value]) -> None:
        self.parameters = list(parameters)
        self.entities: list[str] = []
        self.variables: list[str] = []
        self.monitors: list[str] = []
        self.phases: dict[str, list[str]] = {}
        self.parts: dict[str, list[str]] = {word: [] for word in STORYBOARD_TYPES.values()}
        """Names by type, with those of their parents: ``story::act``."""
        for element in scenario.walk():
            match element.type_name:
                case "ScenarioObject" | "EntitySelection":
                    self.entities.append(element.label)
                case "VariableDeclaration":
                    self.variables.append(element.label)
                case "MonitorDeclaration":
                    self.monitors.append(element.label)
                case "TrafficSignalController":
                    phases = [phase.label for phase in element.all("Phase")]
                    self.phases[element.label] = phases
        storyboard = scenario.first("Storyboard")
        if storyboard is not None:
            self._parts(storyboard, "")

    def _parts(self, element: ScenarioElement, path: str) -> None:
        for child in (*element.children, *([element.target] if element.target else [])):
            below = path
            if word := STORYBOARD_TYPES.get(child.type_name):
                below = f"{path}::{child.label}" if path else child.label
                self.parts[word].append(below)
            self._parts(child, below)

    def faults(self, element: ScenarioElement) -> list[str]:
        """What an element refers to in vain."""
        values, faults = element.values, list[str]()
        for key in _ENTITY_REFERENCES:
            if key in values:
                faults += _missing(key, str(values[key]), "entity", self.entities)
        if "variableRef" in values:
            faults += _missing(
                "variableRef", str(values["variableRef"]), "variable", self.variables
            )
        if "monitorRef" in values:
            faults += _missing("monitorRef", str(values["monitorRef"]), "monitor", self.monitors)
        if element.type_name in ("ParameterCondition", "ParameterAction"):
            name = str(values.get("parameterRef", ""))
            faults += _missing("parameterRef", name, "parameter", self.parameters)
        if element.type_name == "StoryboardElementStateCondition":
            faults += self._part(values)
        if element.type_name in _CONTROLLED:
            name = str(values.get("trafficSignalControllerRef", ""))
            faults += _missing("controller", name, "traffic signal controller", list(self.phases))
            if name in self.phases and "phase" in values:
                faults += _missing("phase", str(values["phase"]), "phase", self.phases[name])
        return faults

    def _part(self, values: object) -> list[str]:
        assert isinstance(values, dict)
        word = str(values.get("storyboardElementType", ""))
        name = str(values.get("storyboardElementRef", "")).replace("/", "::")
        paths = self.parts.get(word)
        if paths is None or any(path == name or path.endswith(f"::{name}") for path in paths):
            return []
        last = [path.rpartition("::")[2] for path in paths]
        return _missing("storyboardElementRef", name, word, last)


def _missing(key: str, name: str, kind: str, known: list[str]) -> list[str]:
    if name in known:
        return []
    return [f"{key}: no {kind} is named '{name}'; {suggest(name, known[:50])}"]
