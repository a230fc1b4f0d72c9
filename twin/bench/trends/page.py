"""The page of trends: a table of targets and a plot of each, in one file without a network."""

from __future__ import annotations

import importlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from schemas.escape import escape
from twin.base.errors import storage_error
from twin.base.files import write_atomic
from twin.bench.trends.history import FALL_MIN, Trend

_TEMPLATE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<title>Benches: {{ machine }}</title>
<style>
body { font: 15px/1.4 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; color: #1c2430; }
table { border-collapse: collapse; width: 100%; }
th, td { border-bottom: 1px solid #d9dee6; padding: .3rem .6rem; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.fell { background: #fde8e6; }
.plots { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 1rem; }
.plots svg { width: 100%; height: auto; }
@media (max-width: 60rem) { .plots { grid-template-columns: minmax(0, 1fr); } }
</style></head><body>
<h1>Benches over time</h1>
<p>{{ machine }}. {{ fallen }} of {{ trends | length }} targets fell by {{ limit }} or more below
the median of earlier runs.</p>
<table><thead><tr><th>target</th><th>last</th><th>median before</th><th>unit</th><th>change</th>
<th>runs before</th><th>measured</th><th></th></tr></thead><tbody>
{% for t in trends %}<tr{% if t.fell %} class="fell"{% endif %}><td>{{ t.row.target }}</td>
<td class="number">{{ "%.4g" | format(t.row.value) }}</td>
<td class="number">{{ "%.4g" | format(t.median) if t.median is not none else "-" }}</td>
<td>{{ t.row.unit }}</td>
<td class="number">{{ "%+.1f %%" | format(100 * t.change) if t.change is not none else "-" }}</td>
<td class="number">{{ t.earlier | length }}</td>
<td>{{ t.row.at }}{% if t.row.label %}, {{ t.row.label }}{% endif %}</td>
<td>{{ "FELL" if t.fell else "" }}</td></tr>
{% endfor %}</tbody></table>
<div class="plots">{% for plot in plots %}
<div>{{ plot }}</div>{% endfor %}</div></body></html>
"""
_LINE, _FELL, _MEDIAN = "#2b6cb0", "#c53030", "#8a94a3"


def write_page(path: Path, machine: str, found: Sequence[Trend]) -> None:
    """Write the page of a class of machines; the same trends give the same bytes.

    Raises:
        TwinError: it cannot be written.
    """
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    page = environment.from_string(_TEMPLATE).render(
        machine=machine,
        trends=found,
        fallen=sum(trend.fell for trend in found),
        limit=f"{FALL_MIN:.0%}",
        plots=[plot(trend) for trend in found],
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, page.encode())
    except OSError as error:
        raise storage_error(error, str(path)) from None


def plot(trend: Trend) -> Markup:
    """The values of a target by run as SVG, the median of the earlier ones as a line."""
    matplotlib = importlib.import_module("matplotlib")
    figures = importlib.import_module("matplotlib.figure")
    rows = [*trend.earlier, trend.row]
    with matplotlib.rc_context({"svg.hashsalt": "trends", "svg.fonttype": "none"}):
        figure = figures.Figure(figsize=(6.0, 2.4), layout="constrained")
        axes = figure.subplots()
        axes.plot(range(len(rows)), [row.value for row in rows], "o-", color=_LINE, markersize=4)
        if trend.median is not None:
            axes.axhline(trend.median, color=_MEDIAN, linestyle="--", linewidth=1)
        if trend.fell:
            axes.plot([len(rows) - 1], [trend.row.value], "o", color=_FELL, markersize=8)
        _label(axes, trend, [row.at[:10] for row in rows])
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return Markup(text[text.index("<svg") :])


def _label(axes: Any, trend: Trend, days: list[str]) -> None:
    title = f"{trend.row.target} [{trend.row.unit}], {trend.row.better} is better"
    axes.set_title(escape(title, 120).replace("$", r"\$"), loc="left", fontsize=10)
    axes.set_ylim(bottom=0.0)
    step = max(1, -(-len(days) // 6))
    axes.set_xticks(range(0, len(days), step), days[::step], fontsize=8)
    axes.grid(visible=True, axis="y", alpha=0.3)
    axes.margins(x=0.05)
