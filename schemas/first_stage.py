"""Cases as release 0.1 wrote them: one mapping of all their fields, without rig and variation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from schemas.case import Case, RigSpec
from schemas.sections.sensors import Sensors


def is_flat(plain: Mapping[str, Any]) -> bool:
    """Whether release 0.1 wrote the case."""
    return "rig" not in plain


def head_of(plain: Any) -> Any:
    """The head of a drive record or of a journal of interventions, as plain data, with its case in
    today's shape; anything else as it is.

    Raises:
        msgspec.ValidationError: it has a case that is none.
    """
    case = plain.get("case") if isinstance(plain, dict) else None
    if not isinstance(case, dict) or not is_flat(case):
        return plain
    return {**plain, "case": msgspec.to_builtins(case_of(case))}


def case_of(plain: Mapping[str, Any]) -> Case:
    """A case from what release 0.1 wrote of it, as plain data.

    Raises:
        msgspec.ValidationError: it is none.
    """
    scenario = msgspec.convert(plain.get("scenario"), dict[str, Any])
    places = {"scene": scenario.get("scene", ""), "vehicle": scenario.get("vehicle", "")}
    files = msgspec.convert(plain.get("files", {}), dict[str, str])
    sensors = msgspec.convert(plain.get("sensors", {}), Sensors)
    control_hz = msgspec.convert(plain.get("control_hz"), int)
    built = {*RigSpec.__struct_fields__} & {*plain}
    rig = {name: plain[name] for name in built}
    rig |= {
        **places,
        "sensor_hz": sensors.rates(control_hz),
        "files": {path: sha for path, sha in files.items() if path in places.values()},
    }
    variation = {name: value for name, value in plain.items() if name not in built}
    variation["files"] = {path: sha for path, sha in files.items() if path not in places.values()}
    return msgspec.convert({"rig": rig, "variation": variation}, Case)
