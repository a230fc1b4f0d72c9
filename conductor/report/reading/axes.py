"""The axes of a campaign's matrix: their values per case, their order, and their labels."""

from __future__ import annotations

import re
from typing import Any

from msgspec import UNSET

from conductor.report.reading.dossier import Dossier
from schemas.axes import NUMBER_AXES, OBJECT_AXES, PARAMETER_AXES, number_of
from schemas.campaign import WEATHERS, Campaign
from schemas.case import Case
from schemas.kinds.scenario import trial_of
from schemas.rulebook_rows import ROW_AXIS, axes_of_rows
from schemas.sections.objects import ObjectVariation
from schemas.sections.repeated import DRAWN_AS

PLAIN = ("model", "time_of_day", "weather", "repeat", "batch")
"""Axes that every case has."""
NO_ROW = "no row"
"""Value of the axis of rows for a case of no rulebook."""

_LABELS = {
    "model": "Perception model",
    "time_of_day": "Time of day [HH:MM]",
    "weather": "Weather",
    "repeat": "Repeat",
    "batch": "Batch",
    "row": "Row",
}
_UNITS = {
    "_mps": "m/s",
    "_kmh": "km/h",
    "_deg": "deg",
    "_ms": "ms",
    "_m": "m",
    "_s": "s",
    "camera.width": "px",
    "camera.height": "px",
    "camera.hz": "Hz",
}


def further_axes(campaign: Campaign) -> list[str]:
    """Axes of the matrix and of single cases beyond :data:`PLAIN`, in file order."""
    named = [*campaign.matrix, *(axis for point in campaign.cases for axis in point)]
    if campaign.rulebook is not UNSET:
        named += axes_of_rows(campaign.rulebook, campaign.scenario)
    return [axis for axis in dict.fromkeys(named) if axis not in (*PLAIN, DRAWN_AS)]


LEFT_OUT = ("as the stack has it", "as in the scene", "no such sensor", "as in the file")
"""Values of an axis that a case says nothing of."""


def axis_value(case: Case, axis: str, *, drawn: bool = False) -> Any:
    """Value of ``axis`` for a case; time of day as ``HH:MM``, one of :data:`LEFT_OUT` where it says
    nothing of it. Of a repetition of a row, what the row says; ``drawn``: what it has itself."""
    rig, variation = case.rig, case.variation
    trial = trial_of(variation.scenario)
    if axis == ROW_AXIS:
        return trial.row if trial else NO_ROW
    if trial and axis in trial.written and not drawn:
        return trial.written[axis]
    if axis.startswith(PARAMETER_AXES):
        return rig.parameters.get(axis.removeprefix(PARAMETER_AXES), LEFT_OUT[0])
    if axis.startswith(OBJECT_AXES):
        name, _, field = axis.removeprefix(OBJECT_AXES).rpartition(".")
        value = getattr(variation.objects.get(name, ObjectVariation()), field)
        return LEFT_OUT[1] if value is None else value
    if axis.startswith(tuple(NUMBER_AXES)):
        number = number_of(variation.scenario, axis)
        return LEFT_OUT[3] if number is None else number
    if axis == "time_of_day":
        return f"{variation.time_of_day_min // 60:02}:{variation.time_of_day_min % 60:02}"
    # A case holds what it needs of the section autonomy itself.
    first, *rest = axis.removeprefix("autonomy.").split(".")
    value = getattr(variation if hasattr(variation, first) else rig, first)
    for part in rest:
        value = getattr(value, part) if value is not UNSET else LEFT_OUT[2]
    return value


_ORDER = re.compile(r"^events\.[^.]+\.do\.")
"""What stands before a number of an order that an event of a scenario gives to an actor."""


def axis_label(axis: str) -> str:
    """Title of an axis with its unit: ``scenario.ego_start_m`` -> ``Ego start [m]``."""
    if axis in _LABELS:
        return _LABELS[axis]
    suffix = next((s for s in _UNITS if axis.endswith(s)), "")
    name = axis.removeprefix(PARAMETER_AXES).split(".", 1)[-1]
    name = _ORDER.sub("", name)
    if suffix.startswith("_"):
        name = name.removesuffix(suffix)
    unit = f" [{_UNITS[suffix]}]" if suffix else ""
    return re.sub("[_.]", " ", name).capitalize() + unit


def axis_values(dossier: Dossier, axis: str) -> list[Any]:
    """Distinct values in the order of a reader: weathers from clear to snow, numbers and times
    ascending, anything else as in the file."""
    values = list(dict.fromkeys(axis_value(row.case, axis) for row in dossier.rows))
    if axis == "weather":
        order = {name: index for index, name in enumerate(WEATHERS)}
        return sorted(values, key=lambda name: order.get(name, len(order)))
    if axis == "time_of_day" or all(isinstance(v, int | float) for v in values):
        return sorted(values)
    return values


def varied_axes(dossier: Dossier) -> list[str]:
    """Axes with more than one value, without the batch label."""
    names = [axis for axis in PLAIN if axis != "batch"] + further_axes(dossier.campaign)
    return [axis for axis in names if len(axis_values(dossier, axis)) > 1]


def heat_axes(dossier: Dossier) -> tuple[str, str]:
    """The two axes (x, y) of the heat map: time of day and weather, else the two with most values.

    One map per model is drawn, so the model is an axis only where nothing else is left.
    """
    varied = varied_axes(dossier)
    if "weather" in varied and "time_of_day" in varied:
        return "time_of_day", "weather"
    rest = [axis for axis in varied if axis not in ("model", "repeat")]
    rest.sort(key=lambda axis: -len(axis_values(dossier, axis)))
    filled = [*rest, *(a for a in ("repeat", "model") if a in varied)]
    filled += [axis for axis in ("time_of_day", "weather") if axis not in filled]
    return filled[0], filled[1]
