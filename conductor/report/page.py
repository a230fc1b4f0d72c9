"""The page: a template, filled; its figures are drawn by its own script from data inside it."""

from __future__ import annotations

import base64
import datetime
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from conductor.report.axes import axis_label, axis_value, axis_values, further_axes, varied_axes
from conductor.report.content import Content
from conductor.report.curves import Floats, drawn
from conductor.report.dossier import Dossier
from conductor.report.evidence import commands, versions
from conductor.report.figures import curve_frame, heat_maps
from conductor.report.palette import line_styles, status_color, status_symbol
from conductor.report.perception_cost import perception_costs
from conductor.report.resources_figure import resource_figure
from conductor.report.tables import case_columns, statuses, verdict_table, without_verdict
from conductor.report.templates import ASSETS, environment


def render(content: Content) -> str:
    """The page."""
    dossier = content.dossier
    template = environment(autoescape=True).get_template("page.html.j2")
    return template.render(
        dossier=dossier,
        outcomes=dossier.outcomes,
        evidence=content.evidence,
        resources=content.resources,
        perception=perception_costs(dossier),
        systems=verdict_table(dossier),
        statuses=[(s, status_color(s), status_symbol(s)) for s in statuses(dossier)],
        trouble=without_verdict(dossier),
        shown=content.shown,
        columns=case_columns(dossier),
        further=[(axis, axis_label(axis)) for axis in further_axes(dossier.campaign)],
        axis_value=axis_value,
        color=status_color,
        symbol=status_symbol,
        commands=commands(dossier),
        versions=versions(),
        made=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        data=Markup(_script_json(_page_data(content))),
        plotly=Markup(get_plotlyjs()),
        style=Markup((ASSETS / "page.css").read_text(encoding="utf-8")),
        script=Markup((ASSETS / "page.js").read_text(encoding="utf-8")),
    )


def _page_data(content: Content) -> dict[str, Any]:
    """What the page's script draws from."""
    dossier = content.dossier
    curves = drawn(dossier)
    axes = [axis for axis in varied_axes(dossier) if axis != "model"]
    groups = [*(axes or ["weather"]), "model", "status"]
    if "weather" in groups:
        groups = ["weather", *(axis for axis in groups if axis != "weather")]
    return {
        "curves": curves,
        "frame": curve_frame(curves)["layout"],
        "heat": heat_maps(dossier),
        "collision_color": status_color("collision"),
        "models": axis_values(dossier, "model"),
        "groups": [_group(dossier, axis) for axis in groups],
        "cases": list(_case_data(content, groups)),
        "resources": resource_figure(content.resources),
    }


def _group(dossier: Dossier, axis: str) -> dict[str, Any]:
    values = statuses(dossier) if axis == "status" else axis_values(dossier, axis)
    label = "Outcome" if axis == "status" else axis_label(axis)
    return {"axis": axis, "label": label, "styles": line_styles(axis, values)}


def _case_data(content: Content, groups: list[str]) -> Iterator[dict[str, Any]]:
    for row in content.shown:
        curve = content.curves.get(row.case.id)
        yield {
            "id": row.case.id,
            "model": row.case.model,
            "status": row.status,
            "groups": {
                axis: row.status if axis == "status" else str(axis_value(row.case, axis))
                for axis in groups
            },
            "time_s": _packed(curve.time_s) if curve else None,
            "values": [_packed(curve.values[name]) for name in drawn(content.dossier)]
            if curve
            else [],
        }


def _packed(values: Floats) -> str:
    """Base64 of little-endian float32: half the size of decimal text, NaN for missing."""
    with np.errstate(over="ignore"):  # a failed case may hold numbers beyond float32
        return base64.b64encode(values.astype("<f4").tobytes()).decode()


def _script_json(data: Any) -> str:
    """JSON that is inert inside a ``<script>`` element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    return text
