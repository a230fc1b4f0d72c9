"""Scenario files in words, so that a person sees what one does."""

from __future__ import annotations

import math

from twin.scenario.storyboard.native.document import NativeDocument
from twin.scenario.storyboard.program.conditions import Trigger
from twin.scenario.storyboard.program.entities import StoryboardEntity
from twin.scenario.storyboard.program.program import ElementKind, Program


def native_outline(document: NativeDocument, program: Program) -> list[str]:
    """Lines: who starts where, what happens when, and when it ends."""
    scenario = document.scenario
    lines = [f"scenario {scenario.scenario} on road {scenario.road}"]
    speeds = {"ego": scenario.ego.speed_mps}
    speeds |= {name: start.speed_mps for name, start in scenario.actors.items()}
    lines += [_entity(entity, speeds[entity.name], program) for entity in program.entities]
    for index, element in enumerate(program.elements):
        if element.kind is not ElementKind.EVENT:
            continue
        actor = program.elements[program.elements[element.parent].parent].name
        actions = [one.name for one in program.elements if one.parent == index]
        when = "at once" if element.start is None else f"when {trigger_line(element.start)}"
        lines.append(f"event {element.name}: {actor}: {', '.join(actions)}; {when}")
    stop = program.elements[0].stop
    if stop is not None:
        lines.append(f"ends when {trigger_line(stop)}")
    return lines


def _entity(entity: StoryboardEntity, speed_mps: float, program: Program) -> str:
    start = entity.start
    assert start is not None
    x = start.x_m + entity.box.centre_x_m * math.cos(start.heading_rad)
    y = start.y_m + entity.box.centre_x_m * math.sin(start.heading_rad)
    where = f"x {x:.1f} m, y {y:.1f} m"
    if program.network is not None and start.road >= 0:
        road = list(program.network.roads.values())[start.road]
        lane = f"OpenDRIVE lane {start.lane}" if start.lane else "beside the lanes"
        where += f", road {road.name or road.id}, {lane}"
    goes = f"{speed_mps:g} m/s"
    if entity.tractor >= 0:
        goes = f"towed by {program.entities[entity.tractor].name}"
    return f"{entity.name}: {entity.catalog_entry} at {where}, {goes}"


def trigger_line(trigger: Trigger) -> str:
    """A trigger as one line: groups joined by ``or``, conditions by ``and``."""
    groups = [
        " and ".join(
            f"{one.name} (+{one.delay_s:g} s)" if one.delay_s else one.name for one in group
        )
        for group in trigger.groups
    ]
    return " or ".join(dict.fromkeys(groups))
