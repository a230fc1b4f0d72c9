"""The page: a template, filled; its figures are drawn by its own script from data inside it."""

from __future__ import annotations

import base64
import datetime
import json
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from conductor.report.analysis.effects import effects_figure
from conductor.report.analysis.highlights import highlights
from conductor.report.analysis.perception_cost import perception_costs
from conductor.report.pages.case_data import case_data, map_axes
from conductor.report.pages.content import Content, first_screen
from conductor.report.pages.tables import (
    case_axes,
    case_columns,
    statuses,
    verdict_table,
    without_verdict,
)
from conductor.report.pages.templates import ASSETS, environment
from conductor.report.plots.figures import GRID_ROWS_MAX, curve_frame, grid_frame
from conductor.report.plots.leases_figure import SPANS_MAX, leases_figure
from conductor.report.plots.palette import line_styles, status_color, status_symbol
from conductor.report.plots.resources_figure import resource_figure
from conductor.report.plots.spread import LINES_MAX, spread_of
from conductor.report.reading.axes import (
    axis_label,
    axis_value,
    axis_values,
    heat_axes,
    varied_axes,
)
from conductor.report.reading.curves import LOOKS, Floats, drawn, overview, time_label
from conductor.report.reading.dossier import Dossier
from conductor.report.reading.evidence import commands, found_where, versions
from conductor.report.reading.films import film_addresses
from conductor.report.reading.provenance import built_of, file_digests
from conductor.report.reading.recorded import Failure
from conductor.report.reading.systems import system_names
from conductor.report.rulebook.figure import residual_figure
from conductor.report.rulebook.shown import RULE, rulebook_shown
from conductor.report.searching.section import covered_lines, mildest, search_figures, search_shown
from schemas.kinds.kpi import scalars_by_name
from twin.records.repeating import again_folder, campaign_of, repeat_command, run_name

_SCRIPTS = ("shared.js", "maps.js", "curves.js", "figures.js", "cases.js", "print.js")
"""Parts of one script, in this order."""
FINDINGS_MAX = 40
"""Most sentences on the page."""


def render(content: Content, failures: list[Failure]) -> str:
    """The page; ``failures`` are the cases that it shows with pictures."""
    dossier, names = content.dossier, system_names(content.dossier)
    data = _page_data(content)
    book = rulebook_shown(dossier, content.rulebook)
    films = film_addresses(dossier)
    script = "\n".join((ASSETS / name).read_text(encoding="utf-8") for name in _SCRIPTS)
    return _template().render(
        dossier=dossier,
        outcomes=dossier.outcomes,
        content=content,
        FINDINGS_MAX=FINDINGS_MAX,
        evidence=content.evidence,
        resources=content.resources,
        pace=content.speed_up,
        leases=content.leases,
        leases_left_out=max(0, len(content.leases.spans) - SPANS_MAX),
        failures=failures,
        films=films,
        unfilmed=book is not None and any(case not in films for case in book.worst_lost),
        replay=lambda failure: "\n".join(_replay(failure, dossier.folder)),
        keep=_kept(content, dossier.folder),
        run_name=run_name(dossier.folder),
        run_word=shlex.quote(run_name(dossier.folder)),
        found_there=found_where(dossier),
        notices=first_screen(content.dossier),
        time_label=time_label(dossier),
        highlights=highlights(dossier, content.rests_m),
        perception=perception_costs(dossier),
        names=names,
        book=book,
        RULE=RULE,
        systems=verdict_table(dossier),
        report=dossier.scenario.report,
        digits={kind.name: kind.digits for kind in scalars_by_name().values()},
        lead_unit=scalars_by_name()[dossier.scenario.report.lead.scalar].unit,
        statuses=[
            (s, status_color(s), status_symbol(s))
            for s in statuses(dossier)
            if book is None or s in book.told
        ],
        residual=data["residual"] is not None,
        found=search_shown(content.search),
        covered=covered_lines(content.coverage),
        declared=bool(dossier.campaign.search and dossier.campaign.search.domain),
        drawn={name for name, figure in data["search"].items() if figure},
        trouble=without_verdict(dossier),
        lines_max=LINES_MAX,
        shown=content.shown,
        columns=_columns(content),
        repeated=any(row.end.attempts > 1 for row in content.shown),
        spread=bool(data["spread"]),
        case_axes=case_axes(dossier),
        reasoned=any(row.end.reasons for row in content.shown),
        axis_value=axis_value,
        color=status_color,
        symbol=status_symbol,
        commands=commands(dossier),
        files=file_digests(dossier),
        built_of=built_of(dossier),
        versions=versions(),
        made=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        data=Markup(_script_json(data)),
        plotly=Markup(get_plotlyjs()),
        style=Markup((ASSETS / "page.css").read_text(encoding="utf-8")),
        script=Markup(f'"use strict";\n(() => {{\n{script}\n}})();'),
    )


def _columns(content: Content) -> list[tuple[str, str]]:
    """Numbers of the case table; a column of dashes alone would look like cases without a value."""
    columns, rows = case_columns(content.dossier), content.shown
    return [(title, n) for title, n in columns if any(row.scalar(n) is not None for row in rows)]


def prepare() -> None:
    """Preparation of the first page: the template is compiled, and Plotly loads its parts when they
    are first used."""
    _template()
    curve_frame(("dtc_m", "aeb"), "")
    for trace in (go.Scatter(x=[0], y=[0], marker={"size": 1}), go.Bar(x=[0], y=[0])):
        go.Figure(trace).to_json()


@cache
def _template() -> jinja2.Template:
    return environment(autoescape=True).get_template("page.html.j2")


def _page_data(content: Content) -> dict[str, Any]:
    """What the page's script draws from."""
    dossier = content.dossier
    curves = _known(content)
    grid = overview(dossier, curves)
    names = system_names(dossier)
    models = list(names)
    rows = [names[model] for model in models[:GRID_ROWS_MAX]]
    axes = [axis for axis in varied_axes(dossier) if axis != "model"]
    groups = [*(axes or ["weather"]), "model", "status"]
    if "weather" in groups:
        groups = ["weather", *(axis for axis in groups if axis != "weather")]
    spreads = dict(_spreads(content, models))
    many, ranges = bool(spreads), _ranges(content, grid)
    time = time_label(dossier)
    x_axis, y_axis = heat_axes(dossier)
    per = "" if "model" in (x_axis, y_axis) else "model"
    return {
        "all": case_data(dossier),
        "heat": {"x": x_axis, "y": y_axis, "per": per if per in map_axes(dossier) else ""},
        "effects": effects_figure(content.effects),
        "effects_stacked": effects_figure(content.effects, columns_max=1),
        "curves": curves,
        "frame": curve_frame(curves, time, spread=many)["layout"],
        "grid_curves": grid,
        "grid_models": models[:GRID_ROWS_MAX],
        "grid": grid_frame(grid, rows, ranges, time, spread=many)["layout"],
        "grid_stacked": grid_frame(grid, rows, ranges, time, spread=many, stacked=True)["layout"],
        "spread": spreads,
        "collision_color": status_color("collision"),
        "models": models,
        "names": names,
        "groups": [_group(dossier, axis) for axis in groups],
        "cases": list(_drawn_cases(content, groups, curves)),
        "resources": resource_figure(content.resources),
        "leases": leases_figure(dossier, content.leases),
        **_residuals(content),
        "search": search_figures(content.search, content.coverage),
    }


def _residuals(content: Content) -> dict[str, Any]:
    """Residual speeds of a rulebook's runs, for wide and for narrow screens."""
    if content.rulebook is None:
        return {"residual": None}
    stacked = residual_figure(content.rulebook, columns=1)
    return {"residual": residual_figure(content.rulebook), "residual_stacked": stacked}


def _spreads(content: Content, models: list[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Distributions of the systems under test that have many cases."""
    for model in models:
        rows = [row for row in content.shown if row.case.variation.model == model]
        spread = spread_of([content.curves[r.case.id] for r in rows if r.case.id in content.curves])
        if spread is not None:
            values = {name: [_packed(row) for row in part] for name, part in spread.values.items()}
            yield model, {"cases": spread.cases, "time_s": _packed(spread.time_s), "values": values}


def _ranges(content: Content, names: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Least and most value of each curve over all cases; curves without a number are left out."""
    ranges = {}
    for name in names:
        values = [curve.values[name] for curve in content.curves.values()]
        known = [part[np.isfinite(part)] for part in values]
        joined = np.concatenate(known) if known else np.zeros(0)
        if len(joined):
            low, high = float(joined.min()), float(joined.max())
            ranges[name] = (low, max(high, low + 1.0) if LOOKS[name].scale != "signed" else high)
    return ranges


def _replay(failure: Failure, folder: Path) -> list[str]:
    """Commands that show a case, from the folder that holds the run's."""
    case = failure.row.case.id
    if failure.recorded:
        return [shlex.join(["viewer", "replay", run_name(folder), case])]
    return [
        repeat_command(campaign_of(folder), case, case=case, record=True),
        shlex.join(["viewer", "replay", again_folder(case), case]),
    ]


def _kept(content: Content, folder: Path) -> list[str]:
    """Commands that run the mildest failure of a search again and keep one of each cluster, from
    the folder that holds the run's."""
    if not (case := next(iter(mildest(content.search)), "")):
        return []
    return [
        repeat_command(campaign_of(folder), case, case=case),
        shlex.join(["conductor", "regress", run_name(folder), "--into", "kept.yaml"]),
    ]


def _group(dossier: Dossier, axis: str) -> dict[str, Any]:
    values = statuses(dossier) if axis == "status" else axis_values(dossier, axis)
    label = "Outcome" if axis == "status" else axis_label(axis)
    return {"axis": axis, "label": label, "styles": line_styles(axis, values)}


def _known(content: Content) -> tuple[str, ...]:
    """The curves of the page; without those that imported logs do not hold."""
    names = drawn(content.dossier)
    if content.dossier.imported is None:
        return names
    always = ("dtc_m", "collisions")
    curves = content.curves.values()
    return tuple(n for n in names if n in always or any(_any_known(c.values[n]) for c in curves))


def _any_known(values: Floats) -> bool:
    return bool(np.isfinite(values).any())


def _drawn_cases(
    content: Content, groups: list[str], curves: tuple[str, ...]
) -> Iterator[dict[str, Any]]:
    for row in content.shown:
        curve = content.curves.get(row.case.id)
        yield {
            "id": row.case.id,
            "model": row.case.variation.model,
            "status": row.status,
            "groups": {
                axis: row.status if axis == "status" else str(axis_value(row.case, axis))
                for axis in groups
            },
            "time_s": _packed(curve.time_s) if curve else None,
            "values": [_packed(curve.values[name]) for name in curves] if curve else [],
        }


def _packed(values: Floats) -> str:
    """Base64 of little-endian float32: half the size of decimal text, NaN for missing."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode()


def _script_json(data: Any) -> str:
    """JSON that is inert inside a ``<script>`` element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    return text
