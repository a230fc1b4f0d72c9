"""Actions of entities and of the whole scenario."""

from __future__ import annotations

import math

from twin.scenario.storyboard.compile.conditions import signal_variable, signal_word
from twin.scenario.storyboard.compile.context import (
    Compilation,
    Handler,
    RefusalError,
    number_of,
    only_child,
)
from twin.scenario.storyboard.openscenario.element import ScenarioElement
from twin.scenario.storyboard.program.actions import (
    LIGHTS,
    UNSEEN,
    AddEntityAction,
    CommandAction,
    ControllerAction,
    DeleteEntityAction,
    EnvironmentAction,
    FinalSpeedKind,
    FollowTrajectoryAction,
    LampMode,
    LightAction,
    ModifyVariableAction,
    SetVariableAction,
    SteadyStateKind,
    SynchronizeAction,
    TeleportAction,
    VisibilityAction,
)
from twin.scenario.storyboard.program.places import Position, Trajectory

_LIGHT_MODES = {"off": LampMode.OFF, "on": LampMode.ON, "flashing": LampMode.FLASHING}
FLASH_S = 0.5
"""Of a lamp that flashes without given durations, on and off alike."""


def _inner(element: ScenarioElement, context: Compilation) -> object:
    return context.compile(only_child(element))


def _synchronize(element: ScenarioElement, context: Compilation) -> SynchronizeAction:
    values = element.values
    master_element, own_element = (
        element.first("TargetPositionMaster"),
        element.first("TargetPosition"),
    )
    assert master_element is not None
    assert own_element is not None
    kind, speed, steady, steady_value = _final_speed(element)
    master_position, own_position = (
        context.position(master_element),
        context.position(own_element),
    )
    trajectory, s_m = _along(own_element, context)
    master_trajectory, master_s_m = _along(master_element, context)
    return SynchronizeAction(
        context.entity(element, "masterEntityRef"),
        master_position,
        own_position,
        kind,
        speed,
        steady,
        steady_value,
        float(values.get("targetToleranceMaster", 0.0)),
        float(values.get("targetTolerance", 0.0)),
        trajectory,
        s_m,
        master_trajectory,
        master_s_m,
    )


def _along(element: ScenarioElement, context: Compilation) -> tuple[int, float]:
    """Trajectory and distance along it of a position on one; -1 of others."""
    leaf = only_child(element)
    if leaf.type_name != "TrajectoryPosition":
        return -1, 0.0
    reference = leaf.first("TrajectoryRef")
    assert reference is not None
    trajectory: Trajectory = context.compile(only_child(reference))
    return context.trajectory(trajectory), float(leaf.values["s"])


def _final_speed(
    element: ScenarioElement,
) -> tuple[FinalSpeedKind, float, SteadyStateKind, float]:
    final = element.first("FinalSpeed")
    if final is None:
        return FinalSpeedKind.NONE, 0.0, SteadyStateKind.NONE, 0.0
    leaf = only_child(final)
    speed = float(leaf.values["value"])
    kind = FinalSpeedKind.ABSOLUTE
    if leaf.type_name == "RelativeSpeedToMaster":
        if leaf.values["speedTargetValueType"] != "delta":
            raise RefusalError(leaf, "speedTargetValueType factor is not played; use delta")
        kind = FinalSpeedKind.RELATIVE_TO_MASTER
    for state in leaf.children:
        if state.type_name == "TargetDistanceSteadyState":
            return kind, speed, SteadyStateKind.DISTANCE, float(state.values["distance"])
        return kind, speed, SteadyStateKind.TIME, float(state.values["time"])
    return kind, speed, SteadyStateKind.NONE, 0.0


def _teleport(element: ScenarioElement, context: Compilation) -> TeleportAction:
    return TeleportAction(_position(element, context))


def _position(element: ScenarioElement, context: Compilation) -> Position:
    position = element.first("Position")
    assert position is not None
    return context.position(position)


def _follow_trajectory(element: ScenarioElement, context: Compilation) -> FollowTrajectoryAction:
    holders = element.all("Trajectory", "CatalogReference", "TrajectoryRef")
    if len(holders) != 1:
        raise RefusalError(element, "give exactly one trajectory")
    holder = holders[0]
    if holder.type_name == "TrajectoryRef":
        holder = only_child(holder)
    elif holder.target is not None:
        holder = holder.target
    trajectory: Trajectory = context.compile(holder)
    reference, mode = element.first("TimeReference"), element.first("TrajectoryFollowingMode")
    assert reference is not None
    assert mode is not None
    timing = only_child(reference)
    timed = timing.type_name == "Timing"
    if timed and not trajectory.timed:
        raise RefusalError(timing, f"trajectory '{trajectory.name}' has no times; use None")
    scale, offset = number_of(timing, "scale", 1.0), number_of(timing, "offset", 0.0)
    if timed and not 0.0 < scale < math.inf:
        raise RefusalError(timing, f"scale is {scale:g}, it must be above 0")
    distance = number_of(element, "initialDistanceOffset", 0.0)
    length = trajectory.pieces[-1].start_s_m + trajectory.pieces[-1].length_m
    if not 0.0 <= distance <= length:
        raise RefusalError(
            element, f"initialDistanceOffset is {distance:g} m on a trajectory of {length:g} m"
        )
    return FollowTrajectoryAction(
        context.trajectory(trajectory),
        timed,
        timing.values.get("domainAbsoluteRelative") == "absolute",
        scale,
        offset,
        mode.values["followingMode"] == "follow",
        distance,
    )


def _activate(element: ScenarioElement, _context: Compilation) -> ControllerAction:
    values = element.values
    return ControllerAction(_flag(values.get("lateral")), _flag(values.get("longitudinal")))


def _assign_controller(element: ScenarioElement, context: Compilation) -> ControllerAction:
    values = element.values
    context.note(element, "which controller it is has no effect; it is what drives the entity")
    return ControllerAction(
        bool(values.get("activateLateral", False)), bool(values.get("activateLongitudinal", False))
    )


def _flag(value: object) -> bool | None:
    return None if value is None else bool(value)


def _visibility(element: ScenarioElement, _context: Compilation) -> VisibilityAction:
    if element.first("SensorReferenceSet") is not None:
        raise RefusalError(element, "visibility for single sensors is not played")
    return VisibilityAction(
        *(bool(element.values[key]) for key in ("graphics", "sensors", "traffic"))
    )


def _light(element: ScenarioElement, context: Compilation) -> LightAction:
    kind, state = element.first("LightType"), element.first("LightState")
    assert kind is not None
    assert state is not None
    lamp = only_child(kind)
    if lamp.type_name == "UserDefinedLight":
        raise RefusalError(lamp, "only lamps of the standard are known")
    name = str(lamp.values["vehicleLightType"])
    if name in UNSEEN:
        context.note(lamp, f"bodies have no {name}, so pictures do not show them")
    return LightAction(
        LIGHTS.index(name),
        _LIGHT_MODES[str(state.values["mode"])],
        number_of(state, "flashingOnDuration", FLASH_S),
        number_of(state, "flashingOffDuration", FLASH_S),
    )


def _environment(element: ScenarioElement, context: Compilation) -> EnvironmentAction:
    return EnvironmentAction(context.environment(context.compile(only_child(element))))


def _entity_action(
    element: ScenarioElement, context: Compilation
) -> AddEntityAction | DeleteEntityAction:
    child = only_child(element)
    number = context.entity(element)
    if child.type_name == "DeleteEntityAction":
        return DeleteEntityAction(number)
    return AddEntityAction(number, _position(child, context))


def _variable_action(kind: str, key: str) -> Handler:
    def handler(
        element: ScenarioElement, context: Compilation
    ) -> SetVariableAction | ModifyVariableAction:
        number = context.variable(element, kind, str(element.values[key]))
        child = only_child(element)
        if child.name == "SetAction":
            value = context.number(element, number, child.values["value"])
            return SetVariableAction(number, value)
        if context.variable_list[number].text:
            raise RefusalError(element, "only numbers can be modified")
        rule = only_child(only_child(child))
        amount = float(rule.values["value"])
        if rule.name == "AddValue":
            return ModifyVariableAction(number, 1.0, amount)
        return ModifyVariableAction(number, amount, 0.0)

    return handler


def _signal_state(element: ScenarioElement, context: Compilation) -> SetVariableAction:
    return SetVariableAction(signal_variable(element, context), signal_word(element, context))


def _monitor(element: ScenarioElement, context: Compilation) -> SetVariableAction:
    number = context.variable(element, "monitor", str(element.values["monitorRef"]))
    return SetVariableAction(number, float(bool(element.values["value"])))


def _animation(element: ScenarioElement, _context: Compilation) -> CommandAction:
    """An event and nothing else; that it has no effect is noted with all elements of its kind."""
    return CommandAction(only_child(only_child(element)).name)


def _command(element: ScenarioElement, context: Compilation) -> CommandAction:
    context.note(element, "the command is noted as an event and does nothing else")
    return CommandAction(f"{element.values['type']} {element.text}".strip())


ACTIONS: dict[str, Handler] = {
    "PrivateAction": _inner,
    "GlobalAction": _inner,
    "UserDefinedAction": _inner,
    "LongitudinalAction": _inner,
    "LateralAction": _inner,
    "RoutingAction": _inner,
    "ControllerAction": _inner,
    "AppearanceAction": _inner,
    "InfrastructureAction": _inner,
    "TrafficSignalAction": _inner,
    "TrailerAction": _inner,
    "SynchronizeAction": _synchronize,
    "TeleportAction": _teleport,
    "FollowTrajectoryAction": _follow_trajectory,
    "ActivateControllerAction": _activate,
    "AssignControllerAction": _assign_controller,
    "VisibilityAction": _visibility,
    "AnimationAction": _animation,
    "LightStateAction": _light,
    "EnvironmentAction": _environment,
    "EntityAction": _entity_action,
    "VariableAction": _variable_action("variable", "variableRef"),
    "ParameterAction": _variable_action("parameter", "parameterRef"),
    "TrafficSignalStateAction": _signal_state,
    "SetMonitorAction": _monitor,
    "CustomCommandAction": _command,
}
"""Handlers of actions by element type; those of motion and routes stand in modules of their own."""
