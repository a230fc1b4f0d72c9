"""All manoeuvres of a vehicle, as a table for people and as JSON for scripts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Table

from twin.base.progress import steps
from twin.validate import cornering, static, straight
from twin.validate.check import ManoeuvreCheck
from twin.vehicle.vehicle_file import Vehicle

MANOEUVRES: tuple[Callable[[Vehicle], list[ManoeuvreCheck]], ...] = (
    static.static_sag,
    static.free_heave,
    straight.braking_60mph,
    straight.braking_fmvss135,
    straight.braking_on,
    straight.zero_to_60mph,
    straight.coast_down,
    cornering.turning_radius,
    cornering.understeer,
    cornering.step_response,
)
"""Each drives one kind of manoeuvre; none for which the file has no reference."""


def validate(vehicle: Vehicle) -> list[ManoeuvreCheck]:
    """Drive all manoeuvres."""
    return [check for manoeuvre in steps("manoeuvres", MANOEUVRES) for check in manoeuvre(vehicle)]


def to_table(vehicle: Vehicle, checks: list[ManoeuvreCheck]) -> Table:
    """The checks, one row each."""
    table = Table(title=f"{vehicle.vehicle}: manoeuvres against references", title_justify="left")
    for name in ("manoeuvre", "value", "reference", "unit", "difference", "allowed", ""):
        right = name in ("value", "reference", "difference", "allowed")
        table.add_column(name, justify="right" if right else "left")
    for check in checks:
        limit = check.kind == "at most"
        table.add_row(
            check.name,
            f"{check.value:.4g}",
            f"{'<= ' if limit else ''}{check.reference:.4g}",
            check.unit,
            "" if limit else f"{100 * check.difference:+.2f} %",
            "" if limit else f"{100 * check.tolerance:g} %",
            "ok" if check.passed else "FAILED",
        )
    return table


def to_json(vehicle: Vehicle, checks: list[ManoeuvreCheck]) -> dict[str, Any]:
    """The checks without their curves."""
    return {
        "vehicle": vehicle.vehicle,
        "passed": all(check.passed for check in checks),
        "checks": [check.to_json() for check in checks],
    }
