"""The page of a validation: the table and a plot per manoeuvre, in one file without a network."""

from __future__ import annotations

import json
from pathlib import Path

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from twin.validate.check import CheckCurve, ManoeuvreCheck
from twin.vehicle.vehicle_file import Vehicle

_TEMPLATE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<title>{{ vehicle.vehicle }}: validation</title>
<style>
body { font: 15px/1.4 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; color: #1c2430; }
table { border-collapse: collapse; width: 100%; }
th, td { border-bottom: 1px solid #d9dee6; padding: .3rem .6rem; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.failed { background: #fde8e6; }
.plots { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 1rem; }
@media (max-width: 60rem) { .plots { grid-template-columns: minmax(0, 1fr); } }
</style><script>{{ plotly }}</script></head><body>
<h1>{{ vehicle.vehicle }}: manoeuvres against references</h1>
<p>{{ checks | selectattr("passed") | list | length }} of {{ checks | length }} within tolerance.
Total mass {{ "%.0f" | format(vehicle.mass_kg) }} kg, wheelbase {{ vehicle.wheelbase_m }} m.</p>
<table><thead><tr><th>manoeuvre</th><th>value</th><th>reference</th><th>unit</th>
<th>difference</th><th>allowed</th><th>source</th><th></th></tr></thead><tbody>
{% for c in checks %}<tr{% if not c.passed %} class="failed"{% endif %}><td>{{ c.name }}</td>
<td class="number">{{ "%.4g" | format(c.value) }}</td>
<td class="number">{{ "%.4g" | format(c.reference) }}</td><td>{{ c.unit }}</td>
{% if c.kind == "at most" %}<td></td><td>at most</td>{% else %}
<td class="number">{{ "%+.2f" | format(100 * c.difference) }} %</td>
<td class="number">{{ "%g" | format(100 * c.tolerance) }} %</td>{% endif %}
<td>{{ c.source }}</td><td>{{ "ok" if c.passed else "FAILED" }}</td></tr>
{% endfor %}</tbody></table>
<div class="plots">{% for id, title, figure in figures %}
<div id="{{ id }}"></div><script>Plotly.newPlot("{{ id }}", {{ figure }});</script>
{% endfor %}</div></body></html>
"""


def _figure(title: str, series: CheckCurve) -> Markup:
    figure = go.Figure(go.Scatter(x=series.x.tolist(), y=series.y.tolist(), mode="lines"))
    figure.update_layout(
        title={"text": title, "font": {"size": 14}},
        height=300,
        margin={"l": 60, "r": 20, "t": 40, "b": 45},
        xaxis_title=series.x_title,
        yaxis_title=series.y_title,
        template="plotly_white",
    )
    found = json.loads(figure.to_json())
    text = json.dumps(
        [found["data"], found["layout"], {"displayModeBar": False, "responsive": True}]
    )
    # Newlines and tags inside a script would end it.
    return Markup(text[1:-1].replace("<", "\\u003c"))


def render(vehicle: Vehicle, checks: list[ManoeuvreCheck]) -> str:
    """The page."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    figures = [
        (f"plot-{number}-{part}", check.name, _figure(check.name, series))
        for number, check in enumerate(checks)
        for part, series in enumerate(check.series)
    ]
    return environment.from_string(_TEMPLATE).render(
        vehicle=vehicle, checks=checks, figures=figures, plotly=Markup(get_plotlyjs())
    )


def write(folder: Path, vehicle: Vehicle, checks: list[ManoeuvreCheck]) -> Path:
    """Write ``FOLDER/NAME.html`` and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{vehicle.vehicle}.html"
    path.write_text(render(vehicle, checks), encoding="utf-8")
    return path
