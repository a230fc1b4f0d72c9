"""Where cases fail, in the two parameters that matter most."""

from __future__ import annotations

import json
from typing import Any

import plotly.graph_objects as go

from conductor.report.reading.axes import axis_label
from conductor.report.searching.looks import FAILED, HELD
from schemas.files.search_result import SearchFile

_SCALE = [[0.0, "rgba(58,110,165,0.10)"], [0.5, "rgba(190,160,160,0.25)"], [1.0, "#e9a79f"]]
_HEIGHT_PX = 480


def map_figure(file: SearchFile) -> dict[str, Any] | None:
    """The cases of a search over its map of failures; None: there is none."""
    found = file.failure_map
    if found is None:
        return None
    places = [file.parameters.index(name) for name in found.parameters]
    figure = go.Figure()
    figure.add_contour(
        x=found.x,
        y=found.y,
        z=found.share,
        zmin=0,
        zmax=1,
        colorscale=_SCALE,
        contours={"start": 0.1, "end": 0.9, "size": 0.4, "showlabels": True},
        line={"width": 1.5, "color": "#666666"},
        showscale=False,
        hoverinfo="skip",
        connectgaps=False,
    )
    for failed, color, name in ((False, HELD, "held"), (True, FAILED, "failed")):
        points = [
            (case, values[places[0]], values[places[1]])
            for case, values, result in file.closed()
            if result is not None and file.fails(result) is failed
        ]
        figure.add_scatter(
            x=[x for _, x, _ in points],
            y=[y for _, _, y in points],
            text=[f"<b>{case}</b>" for case, _, _ in points],
            name=name,
            mode="markers",
            marker={"size": 6, "color": color, "symbol": "x" if failed else "circle"},
            hovertemplate="%{text}<br>%{x:.4g}, %{y:.4g}<extra></extra>",
        )
    figure.update_layout(
        template=go.layout.Template(),
        height=_HEIGHT_PX,
        margin={"l": 64, "r": 12, "t": 16, "b": 48},
        hovermode="closest",
        xaxis={"title": {"text": axis_label(found.parameters[0])}},
        yaxis={"title": {"text": axis_label(found.parameters[1])}},
    )
    plain: dict[str, Any] = json.loads(figure.to_json())
    return plain
