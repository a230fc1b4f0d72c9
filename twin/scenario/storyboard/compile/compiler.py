"""The compiler: an effective scenario becomes a storyboard program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from twin.road.opendrive.lane_graph import LaneGraph, lane_graph
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.records import RoadNetwork
from twin.road.opendrive.road_map import RoadMap
from twin.scenario.storyboard.compile.context import Compilation, as_number
from twin.scenario.storyboard.compile.entities import compile_entities
from twin.scenario.storyboard.compile.fates import (
    HANDLERS,
    NO_EFFECT,
    NO_EFFECT_ATTRIBUTES,
    NO_EFFECT_NAMES,
    REFUSED_TYPES,
)
from twin.scenario.storyboard.compile.signals import compile_signals
from twin.scenario.storyboard.compile.storyboards import compile_init, compile_storyboard
from twin.scenario.storyboard.compile.trailers import check_connections
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.openscenario.references import named_path
from twin.scenario.storyboard.openscenario.scenario import EffectiveScenario
from twin.scenario.storyboard.program.program import Program

ENTITIES_MAX = 64
"""Entities of a program."""


@dataclass(frozen=True, slots=True)
class CompiledScenario:
    """A program, and what of its file has knowingly no effect."""

    program: Program
    notes: tuple[str, ...]


class LoadedRoads(NamedTuple):
    """A road network with its coordinates and its lane graph."""

    network: RoadNetwork
    roads: RoadMap
    graph: LaneGraph


RoadCache = dict[Path, LoadedRoads]
"""Road networks that were read before, for scenarios that share one."""


def compile_scenario(effective: EffectiveScenario, cache: RoadCache | None = None) -> Program:
    """The program of a scenario.

    Args:
        effective: the scenario.
        cache: read networks are kept there, and are not read again.

    Raises:
        ValueError: a line with file and line number per mistake, at most 100.
    """
    return compile_with_notes(effective, cache).program


def compile_with_notes(
    effective: EffectiveScenario, cache: RoadCache | None = None
) -> CompiledScenario:
    """The program of a scenario and its notes; as :func:`compile_scenario`."""
    root = effective.root
    if effective.kind != "ScenarioFile":
        raise ValueError(f"{root.file}:1: a {effective.kind} is no scenario to play")
    parts = {child.type_name: child for child in root.children}
    context = Compilation(HANDLERS, int(parts["FileHeader"].values["revMinor"]))
    _refuse(root, context)
    network = _roads(parts["RoadNetwork"], context, {} if cache is None else cache)
    _variables(effective, context)
    compile_signals(parts["RoadNetwork"], context)
    entities = compile_entities(parts["Entities"], context)
    if len(entities) > ENTITIES_MAX:
        words = f"{len(entities)} entities, at most {ENTITIES_MAX} are played"
        context.mistakes.add(root.file, parts["Entities"].line, words)
    context.mistakes.check()
    storyboard = parts["Storyboard"]
    init = storyboard.first("Init")
    assert init is not None
    actions = compile_init(init, context)
    elements = compile_storyboard(storyboard, context)
    check_connections(root, entities, elements, context)
    context.mistakes.check()
    program = Program(
        root.file.stem,
        entities,
        elements,
        actions,
        tuple(context.trajectories),
        tuple(context.routes),
        tuple(context.variable_list),
        tuple(context.words),
        tuple(context.environments),
        (),
        network,
        tuple(context.controllers.values()),
    )
    return CompiledScenario(program, tuple(context.notes))


def _refuse(element: ScenarioElement, context: Compilation) -> None:
    """Refuse what no program can express, and note what has no effect; both at the outermost."""
    reason = REFUSED_TYPES.get(element.type_name)
    if reason is not None:
        words = f"{element.name} is refused: {reason}"
        context.mistakes.add(element.file, element.line, words)
        return
    reason = NO_EFFECT.get(element.type_name) or NO_EFFECT_NAMES.get(element.name)
    if reason is not None:
        context.note(element, f"no effect: {reason}")
        return
    for key, value in element.values.items():
        reason = NO_EFFECT_ATTRIBUTES.get((element.type_name, key))
        if reason is not None and value:
            context.note(element, f"{key} has no effect: {reason}")
    for child in (*element.children, *([element.target] if element.target else [])):
        _refuse(child, context)


def _roads(element: ScenarioElement, context: Compilation, cache: RoadCache) -> RoadNetwork | None:
    logic = element.first("LogicFile")
    if logic is None:
        return None
    path = named_path(logic.file, str(logic.values["filepath"]))
    if path not in cache:
        try:
            network = load_network(path)
            cache[path] = LoadedRoads(network, RoadMap(network), lane_graph(network))
        except ValueError as error:
            context.mistakes.lines += str(error).splitlines()
            return None
    loaded = cache[path]
    context.roads, context.graph = loaded.roads, loaded.graph
    context.road_numbers = {road: number for number, road in enumerate(loaded.network.roads)}
    return loaded.network


_TEXTS = ("string",)


def _variables(effective: EffectiveScenario, context: Compilation) -> None:
    """Parameters, variables and monitors; those of words hold their numbers."""
    root = effective.root
    for name, value in effective.parameters.items():
        _declare(root, context, "parameter", name, value, isinstance(value, str))
    declarations = root.first("VariableDeclarations")
    for item in declarations.children if declarations else ():
        text = item.values["variableType"] in _TEXTS
        with context.collecting(item):
            _declare(item, context, "variable", item.label, item.values["value"], text)
    monitors = root.first("MonitorDeclarations")
    for item in monitors.children if monitors else ():
        _declare(item, context, "monitor", item.label, item.values["value"], False)


def _declare(
    element: ScenarioElement, context: Compilation, kind: str, name: str, value: Value, text: bool
) -> None:
    number = context.word(str(value)) if text else as_number(element, value)
    context.declare(kind, name, number, text=text)
