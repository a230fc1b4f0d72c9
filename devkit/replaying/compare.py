"""Commands of a recorded stack beside those of another: what differs, field by field."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from msgspec import structs

from schemas.messages import Command, Detection, Pose
from schemas.validation import suggest
from twin.base.errors import UsageError

NUMBERS = ("throttle", "brake", "steering_rad", "handbrake")
"""Fields whose difference is that of two numbers."""

FIELDS = (*NUMBERS, "reverse", "pose", "aeb", "lights", "detections", "sensors")
"""All fields that are compared; slot, token and tick say which attempt it was, ``trigger`` marks a
box in pictures, and records of earlier versions have no ``warning``."""

TOLERANT = (*NUMBERS, "pose", "detections")
"""Fields that may have a tolerance."""

_BOX = ("confidence", "x_px", "y_px", "width_px", "height_px")


@dataclass(frozen=True, slots=True)
class FieldRow:
    """Differences of one field over a case."""

    field: str
    tolerance: float
    """Largest difference that counts as none, in the field's unit; of detections in pixels, and
    for their confidence; of poses in metres, and for their quaternion."""
    ticks: int
    """Ticks that were compared."""
    differ: int
    """Ticks of them whose difference is above the tolerance."""
    largest: float
    """Largest difference; infinite where it is no number (another label, lamp, NaN)."""
    first_tick: int
    """First case tick that differs; -1: none."""


def parse_tolerances(given: Iterable[str]) -> dict[str, float]:
    """``throttle=0.01`` and so on.

    Raises:
        UsageError: no such field, or no number from 0 on; one line.
    """
    tolerances = {}
    for text in given:
        name, equals, value = text.partition("=")
        if name not in TOLERANT or not equals:
            raise UsageError(
                f"--tolerance {text}: expected FIELD=NUMBER; {suggest(name, list(TOLERANT))}"
            )
        try:
            number = float(value)
        except ValueError:
            number = -1.0
        if not 0 <= number < math.inf:
            raise UsageError(f"--tolerance {text}: given {value!r}, allowed: a number from 0 on")
        tolerances[name] = number
    return tolerances


def compared(
    pairs: Iterable[tuple[int, Command, Command]], tolerances: Mapping[str, float]
) -> list[FieldRow]:
    """A row per field.

    Args:
        pairs: case tick, recorded command, command of the stack.
        tolerances: by field; exact where none is given.
    """
    counts = dict.fromkeys(FIELDS, 0)
    largest = dict.fromkeys(FIELDS, 0.0)
    first = dict.fromkeys(FIELDS, -1)
    ticks = 0
    for tick, one, two in pairs:
        ticks += 1
        for name in FIELDS:
            difference = difference_of(name, one, two)
            largest[name] = max(largest[name], difference)
            if difference > tolerances.get(name, 0.0):
                counts[name] += 1
                if first[name] < 0:
                    first[name] = tick
    return [
        FieldRow(n, tolerances.get(n, 0.0), ticks, counts[n], largest[n], first[n]) for n in FIELDS
    ]


def difference_of(name: str, one: Command, two: Command) -> float:
    """Difference of a field between two commands; 0: not at all."""
    a, b = getattr(one, name), getattr(two, name)
    if name in NUMBERS:
        return _apart(a, b)
    if name == "detections":
        return _boxes_apart(a, b)
    if name == "pose":
        return _poses_apart(a, b)
    return 0.0 if a == b else math.inf


def _boxes_apart(one: list[Detection], two: list[Detection]) -> float:
    if [d.label for d in one] != [d.label for d in two]:
        return math.inf
    return max(
        (
            _apart(getattr(a, name), getattr(b, name))
            for a, b in zip(one, two, strict=True)
            for name in _BOX
        ),
        default=0.0,
    )


def _poses_apart(one: Pose | None, two: Pose | None) -> float:
    if one is None or two is None:
        return 0.0 if one is two else math.inf
    return max(map(_apart, structs.astuple(one), structs.astuple(two)))


def _apart(a: float, b: float) -> float:
    """A NaN equals a NaN, and an infinity itself."""
    if a == b or (math.isnan(a) and math.isnan(b)):
        return 0.0
    difference = abs(a - b)
    return math.inf if math.isnan(difference) else difference
