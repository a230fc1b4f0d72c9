"""Controllers of traffic signals: their phases, and what puts them into one."""

from __future__ import annotations

from twin.scenario.storyboard.compile.conditions import signal_named, signal_variable, signal_word
from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.actions import SignalPhaseAction
from twin.scenario.storyboard.program.conditions import TrafficSignalCondition
from twin.scenario.storyboard.program.signals import SignalController, SignalPhase, SignalState


def compile_signals(roads: ScenarioElement, context: Compilation) -> None:
    """Make the controllers of a road network known."""
    signals = roads.first("TrafficSignals")
    elements = {item.label: item for item in signals.children} if signals is not None else {}
    for name, element in elements.items():
        with context.collecting(element):
            delay_s = _delay(element, elements)
            phases = tuple(_phase(phase, name, context) for phase in element.all("Phase"))
            if not phases:
                context.note(element, "it has no phases and switches nothing")
                continue
            if not sum(phase.duration_s for phase in phases) > 0.0:
                raise RefusalError(element, "all its phases take no time")
            variable = context.declare("controller", name, context.word(""), text=True)
            context.controllers[name] = SignalController(name, variable, delay_s, phases)


def _delay(element: ScenarioElement, elements: dict[str, ScenarioElement]) -> float:
    """How long after time 0 a controller begins: delays add up along its references."""
    delay_s, known, at = 0.0, [element.label], element
    while True:
        own_s = number_of(at, "delay", 0.0)
        if not 0.0 <= own_s < float("inf"):
            raise RefusalError(at, f"delay is {own_s:g} s, it must be 0 or more and finite")
        delay_s += own_s
        reference = at.values.get("reference")
        if reference is None:
            if own_s > 0.0:
                raise RefusalError(at, "a delay needs a reference, the controller it is behind")
            return delay_s
        if str(reference) not in elements:
            raise RefusalError(at, f"reference: no controller is named '{reference}'")
        if str(reference) in known:
            raise RefusalError(at, f"controllers {', '.join(known)} refer to one another")
        known.append(str(reference))
        at = elements[str(reference)]


def _phase(element: ScenarioElement, controller: str, context: Compilation) -> SignalPhase:
    duration = float(element.values["duration"])
    if not duration >= 0.0:
        raise RefusalError(element, f"duration is {duration:g} s, it must be 0 or more")
    states = [
        SignalState(
            signal_variable(state, context, "trafficSignalId"),
            signal_word(state, context),
        )
        for state in element.all("TrafficSignalState")
    ]
    for group in element.all("TrafficSignalGroupState", "TrafficeSignalGroupState"):
        states = [*_group(group, controller, context), *states]
    return SignalPhase(context.word(element.label), duration, tuple(states))


def _group(element: ScenarioElement, controller: str, context: Compilation) -> list[SignalState]:
    """The state of all signals of the controller of the same id in the road file."""
    signals = context.road_map(element).network.controllers.get(controller, ())
    if not signals:
        words = f"the road network has no controller '{controller}' with signals"
        raise RefusalError(element, words)
    state = context.word(str(element.values["state"]))
    return [SignalState(signal_named(element, context, name), state) for name in signals]


def _controller(element: ScenarioElement, context: Compilation) -> tuple[int, SignalController]:
    """Number of the controller that an attribute names, and the controller."""
    name = str(element.values["trafficSignalControllerRef"])
    return list(context.controllers).index(name), context.controllers[name]


def _action(element: ScenarioElement, context: Compilation) -> SignalPhaseAction:
    number, controller = _controller(element, context)
    word = context.word(str(element.values["phase"]))
    names = [phase.name for phase in controller.phases]
    return SignalPhaseAction(number, names.index(word))


def _condition(element: ScenarioElement, context: Compilation) -> TrafficSignalCondition:
    _, controller = _controller(element, context)
    word = context.word(str(element.values["phase"]))
    return TrafficSignalCondition(controller.variable, word)


SIGNALS: dict[str, Handler] = {
    "TrafficSignalControllerAction": _action,
    "TrafficSignalControllerCondition": _condition,
}
"""Handlers of controllers of traffic signals by element type."""
