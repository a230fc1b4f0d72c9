"""Axes of a matrix: which there are, what their values make of a section, and a case's name."""

from __future__ import annotations

import functools
import re
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from schemas.kinds.scenario import scenario_kinds
from schemas.kinds.sensor import sensor_kinds
from schemas.names import Name, TimeOfDay
from schemas.sections.autonomy import DELAYS, Autonomy
from schemas.sections.camera import Camera
from schemas.sections.environment import Environment
from schemas.sections.objects import PARAMETERS, ObjectVariation
from schemas.sections.scenario import Scenario
from schemas.sections.sensors import Sensors
from schemas.validation import Mistake, convert_all

PARAMETER_AXES = "autonomy.parameters."
"""How an axis begins that is a parameter of the stack, by its name."""
NUMBER_AXES = {f"{kind.name}.": kind for kind in scenario_kinds().declared if kind.numbers}
"""How axes begin that are numbers of a scenario's file, by their names there; its family."""
OBJECT_AXES = "objects."
"""How an axis begins that is a field of :class:`ObjectVariation`, by the object's name."""

# Axes that are not fields of a section; sections are reached by ``section.field``.
_PLAIN_AXES = ("model", "time_of_day", "weather", "repeat")
_SECTIONS: dict[str, type[Struct]] = {
    "scenario": Scenario,
    "camera": Camera,
    "environment": Environment,
    "autonomy": Autonomy,
    **{f"sensors.{kind.name}": kind.config for kind in sensor_kinds().declared},
}
_NO_AXES = (
    *("scenario.type", "camera.name"),
    *(f"scenario.{kind.numbers}" for kind in scenario_kinds().declared if kind.numbers),
    *(f"scenario.{kind.trial}" for kind in scenario_kinds().declared if kind.trial),
    *(f"sensors.{kind.name}.{key}" for kind in sensor_kinds().declared for key in kind.no_axes),
    *("environment.custom", "environment.timeline", "camera.effects", "camera.outputs"),
    # Which stack it is decides which cases may share a rig.
    *(f"autonomy.{name}" for name in Autonomy.__struct_fields__ if name not in DELAYS),
)


def axes_allowed() -> list[str]:
    """Every axis a matrix may name."""
    fields = [f"{s}.{f}" for s, type_ in _SECTIONS.items() for f in type_.__struct_fields__]
    named = [f"{prefix}NAME" for prefix in NUMBER_AXES]
    named += [PARAMETER_AXES + "NAME", *(f"{OBJECT_AXES}NAME.{name}" for name in PARAMETERS)]
    return [*_PLAIN_AXES, *(f for f in fields if f not in _NO_AXES), *named]


def is_axis(axis: str, allowed: list[str]) -> bool:
    """Whether a matrix may name ``axis``; ``allowed`` is :func:`axes_allowed`.

    The ``NAME`` of a parameter, an object or a number is checked where the stack, the scene and
    the file are known.
    """
    for prefix in NUMBER_AXES:
        if axis.startswith(prefix):
            return all(axis.removeprefix(prefix).split("."))
    for prefix in (PARAMETER_AXES, OBJECT_AXES):
        if axis.startswith(prefix):
            name, dot, parameter = axis.removeprefix(prefix).rpartition(".")
            if prefix == PARAMETER_AXES:
                return parameter.isidentifier() and not dot
            return bool(name) and parameter in PARAMETERS
    return axis in allowed


_POINTS_MAX = 512
"""Lists of axes whose names are remembered as they were taken apart: all points of a matrix have
one, single cases may have others."""

Memo = dict[tuple[Any, ...], tuple[Any, list[Mistake]]]
"""What a value of an axis was checked to be: a hundred thousand cases hold few different ones."""

_AXES: dict[str, tuple[Any, Any]] = {
    "time_of_day": (dict[str, TimeOfDay], "12:00"),
    "weather": (dict[str, Name], "clear"),
    "repeat": (dict[str, Annotated[int, Meta(ge=0, le=2**63 - 1)]], 0),
}
"""Axis -> type of a mapping with its value, and default."""


def value_of(point: dict[str, Any], axis: str, where: str, memo: Memo) -> tuple[Any, list[Mistake]]:
    """The value of an axis that is no field of a section, or its default; None: a mistake."""
    type_, default = _AXES[axis]
    setting = point.get(axis, default)
    if axis == "repeat" and type(setting) is int and 0 <= setting < 2**63:
        return setting, []  # the one axis that may have a hundred thousand values
    key = (axis, type(setting), setting)  # 1, 1.0 and True are equal
    if key not in memo:
        memo[key] = convert_all({axis: setting}, type_)
    value, mistakes = memo[key]
    if value is None:
        return None, [Mistake(f"{where}.{axis}", m.message) for m in mistakes]
    return value[axis], []


def section_of(
    section: Any, name: str, point: dict[str, Any], where: str, memo: Memo
) -> tuple[Any, list[Mistake]]:
    """The section ``name`` with the fields that a point of the matrix sets."""
    changes = {field: point[axis] for axis, field in _below(f"{name}.", tuple(point))}
    changes = {field: value for field, value in changes.items() if "." not in field}
    if not changes:
        return section, []
    key = (name, *((k, type(v), v) for k, v in changes.items()))
    if key not in memo:
        memo[key] = convert_all({**msgspec.to_builtins(section), **changes}, type(section))
    value, mistakes = memo[key]
    return value, [Mistake(f"{where}.{name}.{m.path}".rstrip("."), m.message) for m in mistakes]


@functools.lru_cache(maxsize=_POINTS_MAX)
def _below(prefix: str, axes: tuple[str, ...]) -> list[tuple[str, str]]:
    """Axes of a point that begin so, each with the rest of its name."""
    return [(axis, axis.removeprefix(prefix)) for axis in axes if axis.startswith(prefix)]


def scenario_of(
    scenario: Scenario, point: dict[str, Any], where: str, memo: Memo
) -> tuple[Any, list[Mistake]]:
    """The scenario with the fields, and the numbers of its file, that a point of the matrix
    sets."""
    changed, mistakes = section_of(scenario, "scenario", point, where, memo)
    for prefix, kind in NUMBER_AXES.items():
        axes = _below(prefix, tuple(point))
        if not axes or changed is None:
            continue
        if kind.name != changed.type:
            problem = f"belongs to scenario type {kind.name}, and this is {changed.type}"
            mistakes.append(Mistake(f"{where}.{axes[0][0]}", problem))
            continue
        numbers, wrong = convert_all({name: point[axis] for axis, name in axes}, dict[str, float])
        mistakes += [Mistake(f"{where}.{prefix}{m.path}", m.message) for m in wrong]
        before = getattr(changed, kind.numbers)
        known = {} if before is msgspec.UNSET else before
        changed = msgspec.structs.replace(changed, **{kind.numbers: {**known, **(numbers or {})}})
    return changed, mistakes


def number_of(scenario: Scenario, axis: str) -> float | None:
    """The number that an axis of :data:`NUMBER_AXES` sets in a scenario; None: it is as in the
    scenario's file."""
    prefix = next(prefix for prefix in NUMBER_AXES if axis.startswith(prefix))
    numbers: dict[str, float] | msgspec.UnsetType = getattr(scenario, NUMBER_AXES[prefix].numbers)
    return None if numbers is msgspec.UNSET else numbers.get(axis.removeprefix(prefix))


def parameters_of(point: dict[str, Any]) -> dict[str, Any]:
    """The stack's parameters that a point of the matrix sets."""
    return {name: point[axis] for axis, name in _below(PARAMETER_AXES, tuple(point))}


def objects_of(
    objects: dict[str, ObjectVariation], point: dict[str, Any], where: str, memo: Memo
) -> tuple[dict[str, ObjectVariation], list[Mistake]]:
    """Variations of objects by name, with what a point of the matrix sets."""
    varied = {rest.rpartition(".")[0] for _, rest in _below(OBJECT_AXES, tuple(point))}
    if not varied:
        return objects, []
    changed = dict(objects)
    mistakes: list[Mistake] = []
    for name in sorted(varied):
        variation = objects.get(name, ObjectVariation())
        changed[name], section_mistakes = section_of(
            variation, f"{OBJECT_AXES}{name}", point, where, memo
        )
        mistakes += section_mistakes
    return changed, mistakes


def sensors_of(
    sensors: Sensors, point: dict[str, Any], where: str, memo: Memo
) -> tuple[Sensors, list[Mistake]]:
    """The sensors with the fields that a point of the matrix sets."""
    if not _below("sensors.", tuple(point)):
        return sensors, []
    changed: dict[str, Any] = {}
    mistakes = []
    sections = sensors.sections()
    for kind in sensor_kinds().declared:
        name, prefix = kind.name, f"sensors.{kind.name}"
        before = sections[name] if name in sections else kind.config(on=False)
        section, section_mistakes = section_of(before, prefix, point, where, memo)
        mistakes += section_mistakes
        if section is before:
            continue
        changed[name] = section
        if section is not None and not section.on and f"{prefix}.on" not in point:
            mistakes.append(
                Mistake(f"{where}.{prefix}", f"{name} is off; add '{name}: {{}}' to sensors")
            )
    return (msgspec.structs.replace(sensors, **changed) if changed else sensors), mistakes


def case_id(
    model: str, time_of_day: str, weather: str, point: dict[str, Any], row: str = ""
) -> str:
    """The row of a rulebook first, then known axes in a fixed order; the rest by name: the file's
    order does not matter."""
    parts = [row] if row else []
    if "model" in point:
        parts.append(model)
    if "time_of_day" in point:
        parts.append(time_of_day.replace(":", ""))
    if "weather" in point:
        parts.append(weather)
    for axis, label in _labels(tuple(point)):
        parts.append(f"{label}_{_plain(axis, point[axis])}")
    return "-".join(parts) or "case"


@functools.lru_cache(maxsize=_POINTS_MAX)
def _labels(axes: tuple[str, ...]) -> list[tuple[str, str]]:
    """What a case's name calls its other axes."""
    rest = sorted(set(axes) - {"model", "time_of_day", "weather"})
    return [(axis, re.sub(r"[^A-Za-z0-9_.]+", "_", axis.split(".", 1)[-1])) for axis in rest]


def _plain(axis: str, value: bool | int | float | str) -> str:
    """A value in characters that may stand in the name of a folder."""
    if type(value) is int and value >= 0:
        return str(value)  # most of what a hundred thousand cases differ in
    text = str(value).lower() if isinstance(value, bool) else f"{value}"
    if (
        axis.startswith((PARAMETER_AXES, OBJECT_AXES, *NUMBER_AXES))
        and isinstance(value, int | float)
        and value < 0
    ):
        text = f"minus{text}"  # -1 and 1 are two cases
    return re.sub(r"[^A-Za-z0-9_.]+", "_", text).strip("_.") or "x"
