"""A case with other values, wherever in its rig or variation they stand."""

from __future__ import annotations

from typing import Any

from msgspec import structs

from schemas.case import Case, RigSpec


def changed(case: Case, **values: Any) -> Case:
    """``case`` with other values of fields of its rig and its variation.

    Other sensors and another scenario change the rig as in a campaign. ``files`` are those of the
    variation.
    """
    in_rig = {*RigSpec.__struct_fields__} - {"files"}
    rig = {name: value for name, value in values.items() if name in in_rig}
    if "sensors" in values:
        rig["sensor_hz"] = values["sensors"].rates(rig.get("control_hz", case.rig.control_hz))
    if "scenario" in values:
        scenario = values["scenario"]
        rig |= {"scene": scenario.scene, "vehicle": scenario.vehicle}
    varying = {name: value for name, value in values.items() if name not in in_rig}
    return Case(
        rig=structs.replace(case.rig, **rig),
        variation=structs.replace(case.variation, **varying),
    )
