"""Colours that colour-blind readers tell apart (Okabe and Ito's set); never colour alone."""

from __future__ import annotations

from collections.abc import Iterable

from conductor.report.reading.dossier import NOT_ENDED
from schemas.kinds.scenario import verdict_kinds

_STATUS = {
    **{verdict.name: verdict.color for verdict in verdict_kinds()},
    "failed": "#8E4585",
    "unresolved": "#565B62",
    "cancelled": "#A9AEB5",
    NOT_ENDED: "#D9DCE0",
}
_SYMBOLS = {
    **{verdict.name: verdict.symbol for verdict in verdict_kinds()},
    "failed": "!",
    "unresolved": "?",
    "cancelled": "–",
    NOT_ENDED: "…",
}
_OTHER = "#009E73"
_CONTRAST_MIN = 3.6
"""Least contrast of white text, as WCAG 2 counts it."""

# Two weathers of a family share a hue and differ in their dash.
_WEATHER = {
    "clear": ("#E69F00", "solid"),
    "cloudy": ("#8C8C8C", "solid"),
    "light_fog": ("#CC79A7", "dash"),
    "heavy_fog": ("#B0418A", "solid"),
    "light_rain": ("#56B4E9", "dash"),
    "heavy_rain": ("#0072B2", "solid"),
    "light_snow": ("#3DB58F", "dash"),
    "heavy_snow": ("#009E73", "solid"),
}
_CYCLE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C8C8C", "#8E4585")
_DASHES = ("solid", "dash", "dot", "dashdot")


def status_color(status: str) -> str:
    """Fill of a status."""
    return _STATUS.get(status, _OTHER)


def status_ink(status: str) -> str:
    """Colour of text on the fill of a status: white where that can be read, else nearly black."""
    color = status_color(status)
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#FFFFFF" if 1.05 / (luminance + 0.05) >= _CONTRAST_MIN else "#16191D"


def status_symbol(status: str) -> str:
    """One character that says the status without colour."""
    return _SYMBOLS.get(status, "•")


def line_styles(axis: str, values: Iterable[object]) -> dict[str, tuple[str, str]]:
    """Value (as text) -> (colour, dash) of the curves grouped by ``axis``."""
    if axis == "weather":
        return {str(value): _WEATHER.get(str(value), (_OTHER, "dot")) for value in values}
    if axis == "status":
        return {str(value): (status_color(str(value)), "solid") for value in values}
    count = len(_CYCLE)
    return {
        str(value): (_CYCLE[index % count], _DASHES[index // count % len(_DASHES)])
        for index, value in enumerate(values)
    }
