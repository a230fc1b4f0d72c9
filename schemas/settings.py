"""What people type, ``weather=heavy_rain hour=22.5``, as actions on a running case."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

import msgspec

from schemas.messages import Lights, SensorErrors
from schemas.sections.environment import Conditions
from schemas.validation import convert_all, suggest
from schemas.wire.interventions import (
    Action,
    PlaceEgo,
    SetEnvironment,
    SetLights,
    SetPace,
    SetSensors,
)

T = TypeVar("T")
Value = str | float | bool

_INTENSITIES = Conditions.__struct_fields__
_ERRORS = SensorErrors.__struct_fields__
_POSE = ("x_m", "y_m", "yaw_deg", "speed_mps")
_LAMPS = ("low", "high", "parking", "fog")
_INDICATORS = {"left": 1, "right": 2, "hazard": 3}
SETTINGS = ("weather", *_INTENSITIES, "hour", *_POSE, "lights", *_ERRORS, "pace")
"""Every key that is known."""


def parse_words(words: list[str]) -> dict[str, str]:
    """``KEY=VALUE`` words as a mapping.

    Raises:
        ValueError: a word is none, or a key comes twice; one line.
    """
    settings: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not value:
            raise ValueError(f"given '{word}', expected KEY=VALUE such as weather=heavy_rain")
        if key in settings:
            raise ValueError(f"{key} is given twice; give it once")
        settings[key] = value
    return settings


def actions_of(settings: Mapping[str, Value]) -> list[Action]:
    """The actions that ``settings`` ask for, at most one of a kind.

    Raises:
        ValueError: an unknown key, or a value that is not allowed; one line.
    """
    for key in settings:
        if key not in SETTINGS:
            raise ValueError(f"unknown setting '{key}'; {suggest(key, list(SETTINGS))}")
    if not settings:
        raise ValueError(f"nothing to set; allowed: {', '.join(SETTINGS)}")
    actions: list[Action] = []
    if environment := _environment(settings):
        actions.append(environment)
    if any(key in settings for key in _POSE):
        actions.append(_pose(settings))
    if "lights" in settings:
        actions.append(SetLights(_lights(str(settings["lights"]))))
    if errors := {key: settings[key] for key in _ERRORS if key in settings}:
        actions.append(SetSensors(_errors(errors)))
    if "pace" in settings:
        actions.append(_pace(settings["pace"]))
    return actions


def _environment(settings: Mapping[str, Value]) -> SetEnvironment | None:
    weather = settings.get("weather")
    if weather is not None and (not weather or not isinstance(weather, str)):
        raise ValueError(f"weather: given {weather!r}, expected a name such as heavy_rain")
    intensities = {key: _number(settings, key) for key in _INTENSITIES if key in settings}
    if weather and intensities:
        raise ValueError(
            f"weather and {', '.join(intensities)} exclude each other; give one of them"
        )
    hour = _number(settings, "hour") if "hour" in settings else None
    if hour is not None and not 0 <= hour < 24:
        raise ValueError(f"hour: given {hour:g}, allowed: 0 to below 24")
    if not weather and not intensities and hour is None:
        return None
    return _checked(
        SetEnvironment,
        {
            "action": "environment",
            "weather": weather or "",
            "conditions": intensities or None,
            "time_of_day_min": None if hour is None else 60.0 * hour,
        },
    )


def _pose(settings: Mapping[str, Value]) -> PlaceEgo:
    missing = [key for key in ("x_m", "y_m") if key not in settings]
    if missing:
        raise ValueError(f"a pose needs x_m and y_m; {' and '.join(missing)} missing")
    values = {key: _number(settings, key) for key in _POSE if key in settings}
    values["yaw_rad"] = math.radians(values.pop("yaw_deg", 0.0))
    return _checked(PlaceEgo, {"action": "pose", **values})


def _lights(text: str) -> Lights | None:
    """``low+fog+left``, ``off``, or ``stack``: as the stack says."""
    if text == "stack":
        return None
    allowed = [*_LAMPS, *_INDICATORS]
    names = [] if text == "off" else text.split("+")
    for name in names:
        if name not in allowed:
            raise ValueError(f"lights: given '{name}'; off, stack, or a sum of {'+'.join(allowed)}")
    turns = [_INDICATORS[name] for name in names if name in _INDICATORS]
    if len(turns) > 1:
        raise ValueError(f"lights: given '{text}', allowed: one of {', '.join(_INDICATORS)}")
    return Lights(
        **{name: True for name in names if name in _LAMPS}, indicators=turns[0] if turns else 0
    )


_AS_IS = SensorErrors()
"""Sensor errors whose values say which settings are switches."""


def _errors(settings: Mapping[str, Value]) -> SensorErrors:
    values: dict[str, object] = {}
    for key, value in settings.items():
        if isinstance(getattr(_AS_IS, key), bool):
            if str(value).lower() not in ("true", "false", "1", "0"):
                raise ValueError(f"{key}: given {value}, allowed: true, false")
            values[key] = str(value).lower() in ("true", "1")
            continue
        number = _number(settings, key)
        if not 0 <= number <= 1000:
            raise ValueError(f"{key}: given {number:g}, allowed: 0 to 1000")
        values[key] = number
    return msgspec.convert(values, SensorErrors)


def _pace(value: Value) -> SetPace:
    if value == "max":
        return SetPace(None)
    return _checked(SetPace, {"action": "pace", "factor": _number({"pace": value}, "pace")})


def _number(settings: Mapping[str, Value], key: str) -> float:
    value = settings[key]
    if isinstance(value, bool):
        raise ValueError(f"{key}: given {str(value).lower()}, expected a number")
    try:
        number = float(value)
    except ValueError:
        raise ValueError(f"{key}: given '{value}', expected a number") from None
    if not math.isfinite(number):
        raise ValueError(f"{key}: given {value}, expected a finite number")
    return number


def _checked(type_: type[T], values: Mapping[str, object]) -> T:
    value, mistakes = convert_all(dict(values), type_)
    if value is None:
        raise ValueError(
            f"{mistakes[0].path.rpartition('.')[2] or 'setting'}: {mistakes[0].message}"
        )
    return value
