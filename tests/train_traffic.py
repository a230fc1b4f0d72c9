"""Programs for tests of equal bytes: trains on the ring, free lanes and traffic signals."""

from __future__ import annotations

from itertools import count

import msgspec

from twin.bench.storyboard_traffic import reacting_traffic
from twin.scenario.storyboard.program.actions import (
    ConnectTrailerAction,
    DisconnectTrailerAction,
    LaneChangeAction,
    SignalPhaseAction,
)
from twin.scenario.storyboard.program.conditions import (
    Condition,
    ConditionEdge,
    LaneRange,
    RelativeClearanceCondition,
    TrafficSignalCondition,
    Trigger,
)
from twin.scenario.storyboard.program.program import (
    ElementKind,
    Program,
    ProgramVariable,
    StoryElement,
)
from twin.scenario.storyboard.program.signals import SignalController, SignalPhase, SignalState


def train_traffic(cars: int) -> Program:
    """Reacting traffic in which every fourth car tows the next one.

    Cars change lanes where those are free; phases of a controller couple a trailer and let it go.
    """
    program = reacting_traffic(cars)
    entities = [
        msgspec.structs.replace(
            entity,
            hitch_x_m=-1.2,
            coupler_x_m=4.0,
            tractor=number - 1 if number % 4 == 2 else -1,
        )
        for number, entity in enumerate(program.entities)
    ]
    phases = [
        SignalPhase(float(name), duration_s, (SignalState(1, 10.0 * name),))
        for name, duration_s in ((1, 0.37), (2, 0.52), (3, 0.23))
    ]
    controller = SignalController("ring", 0, 0.2, tuple(phases))
    return msgspec.structs.replace(
        program,
        name=f"trains-{cars}",
        entities=tuple(entities),
        elements=_elements(program),
        variables=(
            ProgramVariable("controller ring", 0.0),
            ProgramVariable("signal light", 0.0),
        ),
        controllers=(controller,),
    )


def _elements(program: Program) -> tuple[StoryElement, ...]:
    """Lane changes wait for free lanes; the first car's events are about its trailer."""
    number = count()
    elements = list(program.elements)
    for index, element in enumerate(elements):
        action = elements[index + 1].action if index + 1 < len(elements) else None
        if element.kind is not ElementKind.EVENT:
            continue
        if isinstance(action, LaneChangeAction):
            actor = elements[elements[element.parent].parent].actors[0]
            steps = 1 if next(number) % 2 else -1
            free = RelativeClearanceCondition(
                15.0, 10.0, bool(index % 2), False, (), (LaneRange(steps, steps),)
            )
            condition = Condition("free", free, ConditionEdge.RISING, 0.0, (actor,))
            elements[index] = msgspec.structs.replace(element, start=Trigger(((condition,),)))
        elif elements[elements[element.parent].parent].actors == (0,):
            phase, also = (2.0, ConnectTrailerAction(1)), SignalPhaseAction(0, 0)
            if index % 2:
                phase, also = (3.0, DisconnectTrailerAction()), ConnectTrailerAction(1)
            shown = TrafficSignalCondition(0, phase[0])
            condition = Condition("phase", shown, ConditionEdge.RISING, 0.0)
            elements[index] = msgspec.structs.replace(
                element, start=Trigger(((condition,),)), executions_max=3
            )
            elements[index + 1] = msgspec.structs.replace(
                elements[index + 1], action=phase[1] if index % 3 else also
            )
    return tuple(elements)
