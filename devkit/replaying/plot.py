"""A picture of a replay: what was commanded, and what the stack commands now."""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from devkit.replaying.replay import Replayed
from schemas.messages import Command

RECORDED, NOW, DIFFERS = "#8C8C8C", "#0072B2", "#F6E3D0"
"""Colours that colour-blind readers tell apart; the lines differ in width as well."""

_STYLE = {
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#E6E9EC",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.parse_math": False,  # names may hold any character
    "figure.dpi": 130,
}


def _confidence(command: Command) -> float:
    return max((d.confidence for d in command.detections), default=math.nan)


_PANELS: Sequence[tuple[str, Callable[[Command], float], tuple[str, ...]]] = (
    ("throttle", lambda c: c.throttle, ("throttle",)),
    ("brake, AEB at 1.1", lambda c: c.brake, ("brake", "aeb")),
    ("steering [deg]", lambda c: math.degrees(c.steering_rad), ("steering_rad",)),
    ("highest confidence", _confidence, ("detections",)),
)


def write_plot(one: Replayed, path: Path) -> None:
    """Draw one case as PNG; times are those of the case.

    Raises:
        OSError: the file cannot be written.
    """
    matplotlib = importlib.import_module("matplotlib")
    figures = importlib.import_module("matplotlib.figure")
    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a name that is too long for the layout
        sheet = figures.Figure(figsize=(7.2, 6.4), layout="constrained")
        axes = sheet.subplots(len(_PANELS), 1, sharex=True)
        for axis, (label, value, fields) in zip(axes, _PANELS, strict=True):
            _panel(axis, one, value, {row.field: row.tolerance for row in one.rows}, fields)
            axis.set_ylabel(label)
        axes[-1].set_ylim(-0.05, 1.05)
        axes[-1].set_xlabel("sim time [s]")
        verdict = "equal" if one.equal else "differs"
        axes[0].set_title(f"{one.head.case.id}, attempt {one.head.attempt}: {verdict}", loc="left")
        handles, labels = axes[0].get_legend_handles_labels()
        sheet.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        sheet.savefig(path, format="png")


def _panel(
    axis: Any,
    one: Replayed,
    value: Callable[[Command], float],
    tolerances: dict[str, float],
    fields: tuple[str, ...],
) -> None:
    from devkit.replaying.compare import difference_of

    period_s = 1.0 / one.head.case.rig.control_hz
    times = [tick * period_s for tick, _, _ in one.pairs]
    for tick, recorded, now in one.pairs:
        if recorded is not None and any(
            difference_of(f, recorded, now) > tolerances.get(f, 0.0) for f in fields
        ):
            axis.axvspan(tick * period_s, (tick + 1) * period_s, color=DIFFERS, lw=0)
    axis.axvspan(0, 0, color=DIFFERS, lw=0, label="differs")
    before = [math.nan if r is None else value(r) for _, r, _ in one.pairs]
    axis.step(times, before, where="post", color=RECORDED, lw=3.2, label="recorded")
    axis.step(times, [value(n) for _, _, n in one.pairs], where="post", color=NOW, label="now")
    if "aeb" in fields:
        was = [1.1 if r is not None and r.aeb else math.nan for _, r, _ in one.pairs]
        axis.step(times, was, where="post", color=RECORDED, lw=3.2)
        now = [1.1 if n.aeb else math.nan for _, _, n in one.pairs]
        axis.step(times, now, where="post", color=NOW)
