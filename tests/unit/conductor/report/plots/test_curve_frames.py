"""Frames are edited as plain values; Plotly itself, asked panel by panel, makes the same."""

import json

import plotly.graph_objects as go
import pytest
from plotly.subplots import make_subplots

from conductor.report.plots.figures import AXES, column_title, curve_frame, grid_frame, titles
from conductor.report.reading.curves import LOOKS

CURVES = tuple(LOOKS)
SAFE = [name for name in CURVES if LOOKS[name].safety_m]
RANGES = {name: (-1.5, 10.0 + i) for i, name in enumerate(CURVES) if i % 3}


def plain(figure):
    return json.loads(figure.to_json())


def bordered(figure, name, row, col, spread):
    """The axis of a panel as Plotly's own calls make it."""
    look = LOOKS[name]
    share = spread and look.share
    axis = {"range": [0, 1.04], "tickvals": [0, 0.5, 1]} if share else AXES[look.scale]
    figure.update_yaxes(**axis, row=row, col=col)
    if look.scale not in ("switch", "0 to 1") and not share:
        low, high = RANGES.get(name, (0.0, 1.0))
        span = [min(low, 0.0), high + 0.04 * (high - low)]
        figure.update_yaxes(range=span, row=row, col=col)


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize("curves", [CURVES, CURVES[:1], CURVES[::2]])
@pytest.mark.parametrize("models", [["a"], ["a<b", "c", "d"]])
def test_a_grid_is_what_plotly_makes_panel_by_panel(models, curves, spread):
    frame = grid_frame(curves, models, RANGES, "t [s]", spread=spread)
    headings = [column_title(name, spread=spread) for name in curves]
    wanted = make_subplots(
        rows=len(models),
        cols=len(curves),
        shared_xaxes="all",
        shared_yaxes="columns",
        horizontal_spacing=0.03,
        vertical_spacing=0.14 / len(models),
        column_titles=headings,
        row_titles=[model.replace("<", "&lt;") for model in models],
    )
    for row in range(1, len(models) + 1):
        for col, name in enumerate(curves, 1):
            bordered(wanted, name, row, col, spread)
    wanted.update_xaxes(title={"text": "t [s]"}, row=len(models))
    made, asked = frame["layout"], plain(wanted)["layout"]
    axes = [key for key in asked if key.startswith(("xaxis", "yaxis"))]
    assert len(axes) == 2 * len(models) * len(curves)
    assert {key: made[key] for key in axes} == {key: asked[key] for key in axes}
    texts = [note["text"] for note in made["annotations"]]
    assert texts[: len(headings) + len(models)] == [note["text"] for note in asked["annotations"]]
    go.Figure(frame)  # refuses what is no figure


@pytest.mark.parametrize("stacked", [False, True])
def test_safety_lines_stand_in_their_panels(stacked):
    models = ["a", "b"]
    layout = grid_frame(CURVES, models, RANGES, "t", stacked=stacked)["layout"]
    numbers = [CURVES.index(name) + 1 + row * len(CURVES) for row in (0, 1) for name in SAFE]
    assert SAFE
    assert [shape["yref"] for shape in layout["shapes"]] == [
        "y" if number == 1 else f"y{number}" for number in numbers
    ]
    labels = [note for note in layout["annotations"] if note["text"].startswith("factor of safety")]
    assert [note["yref"] for note in labels] == [s["yref"] for s in layout["shapes"][: len(SAFE)]]
    assert all(shape["xref"].endswith(" domain") for shape in layout["shapes"])


@pytest.mark.parametrize("spread", [False, True])
def test_the_curves_of_one_case(spread):
    frame = curve_frame(CURVES, "t [s]", spread=spread)
    layout = frame["layout"]
    assert layout["height"] == 180 * len(CURVES)
    assert len(layout["shapes"]) == len(SAFE)
    headings = titles(spread=spread)
    keys = ["yaxis", *(f"yaxis{n}" for n in range(2, len(CURVES) + 1))]
    assert [layout[key]["title"]["text"] for key in keys] == [headings[n][1] for n in CURVES]
    assert layout[f"xaxis{len(CURVES)}"]["title"] == {"text": "t [s]"}
    assert all(note["xanchor"] == "left" for note in layout["annotations"])
    go.Figure(frame)


def test_a_frame_is_the_callers_own():
    first = grid_frame(CURVES[:2], ["a"], {}, "t")
    first["layout"]["yaxis"]["range"] = "mine"
    assert grid_frame(CURVES[:2], ["a"], {}, "t")["layout"]["yaxis"]["range"] != "mine"
