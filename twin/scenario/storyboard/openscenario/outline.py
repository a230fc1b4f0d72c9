"""Scenarios in words, so that a person understands what one does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.openscenario.references import STORYBOARD_TYPES
from twin.scenario.storyboard.openscenario.scenario import EffectiveScenario, Permutation
from twin.scenario.storyboard.openscenario.values import written


def outline(scenario: EffectiveScenario, permutations: Sequence[Permutation]) -> list[str]:
    """Lines: entities, stories down to events with their triggers, parameters, catalogs."""
    lines = [f"{scenario.kind} {scenario.root.file}"]
    entities = scenario.root.first("Entities")
    for entity in entities.all("ScenarioObject", "EntitySelection") if entities else []:
        lines += _entity(entity, "")
    lines += _controllers(scenario.root)
    storyboard = scenario.root.first("Storyboard")
    if storyboard is not None:
        lines += _storyboard(storyboard, 0)
        stop = storyboard.first("StopTrigger")
        if stop is not None:
            lines.append(f"ends when {trigger_words(stop)}")
    lines += [f"parameter {name} = {written(v)}" for name, v in scenario.parameters.items()]
    lines += [f"uses {entry}" for entry in scenario.catalogs_used]
    lines.append(f"permutations: {len(permutations)}")
    return lines


def _entity(entity: ScenarioElement, tractor: str) -> Iterator[str]:
    """An entity, and the trailers in it; ``tractor``: what tows it."""
    kind = entity.children[0].target or entity.children[0] if entity.children else entity
    words = f"entity {entity.label}: {kind.type_name} {kind.label}".rstrip()
    yield words + (f", towed by {tractor}" if tractor else "")
    for holder in kind.all("Trailer"):
        for trailer in holder.all("Trailer"):
            yield from _entity(trailer, entity.label)
        for reference in holder.all("TrailerRef"):
            yield f"entity {entity.label} tows {reference.values.get('entityRef', '')}"


def _controllers(root: ScenarioElement) -> Iterator[str]:
    """Controllers of traffic signals with their phases."""
    roads = root.first("RoadNetwork")
    signals = roads.first("TrafficSignals") if roads is not None else None
    for controller in signals.children if signals is not None else ():
        phases = [
            f"{phase.label} {written(phase.values['duration'])} s"
            for phase in controller.all("Phase")
        ]
        yield f"traffic signal controller {controller.label}: {', '.join(phases) or 'no phases'}"


def trigger_words(trigger: ScenarioElement) -> str:
    """A trigger as one line: groups joined by ``or``, conditions by ``and``."""
    groups = [" and ".join(map(_condition, group.children)) for group in trigger.children]
    return " or ".join(f"({group})" if len(groups) > 1 else group for group in groups) or "never"


def _storyboard(element: ScenarioElement, depth: int) -> Iterator[str]:
    for child in (*element.children, *([element.target] if element.target else [])):
        word = STORYBOARD_TYPES.get(child.type_name)
        if word is None:
            yield from _storyboard(child, depth)
            continue
        words = f"{'  ' * depth}{word} {child.label}"
        if word == "action":
            leaf = child
            while len(leaf.children) == 1 and not leaf.values.keys() - {"name"}:
                leaf = leaf.children[0]
            words += f": {leaf.name}"
        start = child.first("StartTrigger")
        if start is not None:
            words += f", when {trigger_words(start)}"
        yield words
        yield from _storyboard(child, depth + 1)


def _condition(condition: ScenarioElement) -> str:
    by_entity = condition.first("ByEntityCondition")
    leaf, who = condition, ""
    if by_entity is not None:
        triggering = by_entity.first("TriggeringEntities")
        leaf = by_entity.first("EntityCondition") or by_entity
        if triggering is not None:
            names = [str(ref.values["entityRef"]) for ref in triggering.children]
            who = f"{triggering.values['triggeringEntitiesRule']} of {', '.join(names)}: "
    else:
        leaf = condition.first("ByValueCondition") or condition
    leaf = leaf.children[0] if leaf.children else leaf
    facts = " ".join(f"{key}={written(value)}" for key, value in leaf.values.items())
    words = f"{who}{leaf.name.removesuffix('Condition')} {facts}".strip()
    edge, delay = condition.values["conditionEdge"], condition.values["delay"]
    words += f" [{edge}]" if edge != "none" else ""
    return words + (f" after {written(delay)} s" if delay else "")
