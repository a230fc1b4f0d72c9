"""What the plots of a report share: matplotlib, labels that stay apart, the legend."""

from __future__ import annotations

import importlib
import textwrap
from typing import Any

Figure = Any
"""A figure of matplotlib, or a part of one; it has no stubs that name what is used here."""

RASTER_LINES = 64
"""Number of curves above which they are pixels in the SVG file too: a hundred thousand paths open
nowhere."""
LEGEND_ROW_IN = 0.25
"""Height of a row of a legend [inches]."""
_CHAR_IN = 0.075
"""Width of a character of labels [inches]."""
_TURNED_IN = 0.17
"""Width of a label that runs upwards [inches]."""


def library(module: str) -> Any:
    """A module of matplotlib, loaded when it is needed: an installation may do without."""
    return importlib.import_module(f"matplotlib.{module}".rstrip("."))


def words(value: object) -> str:
    """A name for people."""
    return str(value).replace("_", " ")


def wrapped(text: str, wide_in: float) -> str:
    """``text`` in lines of at most ``wide_in`` inches."""
    return "\n".join(textwrap.wrap(text, max(8, int(wide_in / _CHAR_IN)))) or text


def label_x(panel: Figure, labels: list[str], wide_in: float) -> None:
    """Labels at 0, 1, ... of an x axis that is ``wide_in`` inches wide: upwards where they would
    touch, and not all of them where even that is too many."""
    room_in = wide_in / max(len(labels), 1)
    fits = max(map(len, labels), default=0) + 1 <= room_in / _CHAR_IN
    step = 1 if fits else max(1, -int(-_TURNED_IN // room_in))
    panel.set_xticks(
        range(0, len(labels), step), labels[::step], rotation="horizontal" if fits else "vertical"
    )


def legend(sheet: Figure, colors: dict[str, str]) -> None:
    """A legend below the figure: colour by name."""
    patch = library("patches").Patch
    handles = [patch(color=color, label=label) for label, color in colors.items()]
    longest = max(map(len, colors), default=1)
    columns = max(1, int(sheet.get_size_inches()[0] / (0.75 + _CHAR_IN * longest)))
    sheet.legend(handles=handles, loc="outside lower left", ncols=columns, frameon=False)
