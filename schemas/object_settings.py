"""What people type of objects, ``object.van.speed_mps=4``, as actions on a running case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from schemas.validation import convert_all, suggest
from schemas.wire.interventions import Action, FreeObject, MoveObject, ObjectState, RemoveObject

PREFIX = "object."
_NUMBERS = ("x_m", "y_m", "z_m", "yaw_deg", "speed_mps")
_WHOLE = ("away", "free")
_STANDS = "expected object.NAME.x_m=NUMBER (also y_m, z_m, yaw_deg, speed_mps), or object.NAME=free"


def split_objects(
    settings: Mapping[str, str],
) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Settings of the case, and those of its objects by their names or numbers; the key of
    ``object.NAME=free`` there is empty.

    Raises:
        ValueError: an unknown key of an object; one line.
    """
    rest: dict[str, str] = {}
    objects: dict[str, dict[str, str]] = {}
    for key, value in settings.items():
        if not key.startswith(PREFIX):
            rest[key] = value
            continue
        name, dot, last = key.removeprefix(PREFIX).rpartition(".")
        if dot and last in _NUMBERS:
            objects.setdefault(name, {})[last] = value
        elif value in _WHOLE:
            objects.setdefault(key.removeprefix(PREFIX), {})[""] = value
        else:
            raise ValueError(f"given '{key}={value}', {_STANDS}, object.NAME=away")
    return rest, objects


def object_actions(
    wanted: Mapping[str, Mapping[str, str]], objects: Sequence[ObjectState]
) -> list[Action]:
    """The actions on objects, one for each; where an object is now stays as far as nothing is said
    of it, and so does its heading. Without a speed it stands.

    Args:
        wanted: as :func:`split_objects` gives it.
        objects: all objects of the case, as they are now.

    Raises:
        ValueError: no such object, or a value that is not allowed; one line.
    """
    return [
        _action(name, values, _named(name, objects), objects) for name, values in wanted.items()
    ]


def _named(name: str, objects: Sequence[ObjectState]) -> int:
    """Position in ``objects`` of an object, by its name or number."""
    alike = [k for k, one in enumerate(objects) if name in (one.name, str(one.object))]
    if len(alike) == 1:
        return alike[0]
    if alike:
        numbers = ", ".join(str(objects[k].object) for k in alike)
        raise ValueError(f"object '{name}': several have that name; give a number: {numbers}")
    names = [one.name or str(one.object) for one in objects]
    if not names:
        raise ValueError(f"object '{name}': nothing moves in this case")
    raise ValueError(f"object '{name}': not in this case; {suggest(name, names)}")


def _action(
    name: str, values: Mapping[str, str], position: int, objects: Sequence[ObjectState]
) -> Action:
    now = objects[position]
    if "" in values:
        if len(values) > 1:
            raise ValueError(f"object '{name}': {values['']} takes no numbers")
        return FreeObject(now.object) if values[""] == "free" else RemoveObject(now.object)
    numbers = {"x_m": now.x_m, "y_m": now.y_m, "yaw_deg": math.degrees(now.yaw_rad)}
    for key, text in values.items():
        try:
            numbers[key] = float(text)
        except ValueError:
            raise ValueError(f"{PREFIX}{name}.{key}: given '{text}', expected a number") from None
        if not math.isfinite(numbers[key]):
            raise ValueError(f"{PREFIX}{name}.{key}: given {text}, expected a finite number")
    numbers["yaw_rad"] = math.radians(numbers.pop("yaw_deg"))
    data = {"action": "move", "object": now.object, **numbers}
    action, mistakes = convert_all(data, MoveObject)
    if action is None:
        wrong = mistakes[0]
        raise ValueError(f"{PREFIX}{name}.{wrong.path.rpartition('.')[2]}: {wrong.message}")
    return action
