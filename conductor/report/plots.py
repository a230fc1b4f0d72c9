"""The figures of the report as files, PNG and SVG, for papers and slides: ``plots/``.

Drawn by matplotlib, of the same tables and curves as the page.
"""

from __future__ import annotations

import importlib
import io
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from conductor.report.axes import axis_label, axis_values, varied_axes
from conductor.report.cells import cell_number, cells_of, worst
from conductor.report.content import Content
from conductor.report.curves import drawn
from conductor.report.figures import GRID_ROWS_MAX, SAFETY_M, TITLES
from conductor.report.leases_figure import SPANS_MAX, lanes_of
from conductor.report.losses import page_axes
from conductor.report.palette import line_styles, status_color, status_symbol
from conductor.report.tables import statuses, verdict_table
from twin.fabric.files import write_atomic

PLOTS_FOLDER = "plots"
LINES_MAX = 400
"""Most cases with curves, of all systems under test together: of each the first ones."""
HEAT_MAX = 64
"""Most values of an axis of the maps."""
_RASTER_LINES = 64
"""Above this, curves are pixels in the SVG file too: a hundred thousand paths open nowhere."""
_STYLE = {
    "font.size": 9,
    "axes.grid": True,
    "grid.color": "#E6E9EC",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.parse_math": False,  # names may hold any character
    "svg.hashsalt": "drivetwin",
    "svg.fonttype": "none",
    "figure.dpi": 130,
}

_BAR = (-0.4, 0.4, 0.4, -0.4)
"""Height of a lease's corners above the middle of its lane."""

Figure = Any
"""A figure of matplotlib, which has no stubs that name what is used here."""


def write_plots(content: Content) -> tuple[list[Path], str]:
    """Write the plots; returns their paths, and what was left out.

    Raises:
        OSError: the disk lets us down.
    """
    try:
        matplotlib = _matplotlib("")
    except ImportError:
        return [], "plots are left out: matplotlib is not installed; pip install matplotlib"
    folder = content.dossier.folder / PLOTS_FOLDER
    folder.mkdir(exist_ok=True)
    written = []
    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that are too long for a layout, or for a font
        for name, draw in _PLOTS.items():
            sheet = _matplotlib("figure").Figure(layout="constrained")
            if not draw(content, sheet):
                for suffix in ("png", "svg"):
                    (folder / f"{name}.{suffix}").unlink(missing_ok=True)
                continue
            for suffix, data in _drawn_once(sheet):
                path = folder / f"{name}.{suffix}"
                write_atomic(path, data.getbuffer(), sync=False)
                written.append(path)
    return written, _too_wide(content)


def _drawn_once(sheet: Figure) -> Iterator[tuple[str, io.BytesIO]]:
    """Endings and bytes of a figure's files.

    ``savefig`` draws everything twice, the first time for the layout alone, which takes longest.
    """
    png, svg = io.BytesIO(), io.BytesIO()
    _matplotlib("backends.backend_agg").FigureCanvasAgg(sheet).print_png(png)
    yield "png", png
    sheet.set_layout_engine("none")  # the second file has the layout of the first
    canvas = _matplotlib("backends.backend_svg").FigureCanvasSVG(sheet)
    canvas.print_svg(svg, metadata={"Date": None})
    yield "svg", svg


def _matplotlib(module: str) -> Any:
    """A module of the library, loaded when it is needed: an installation may do without."""
    return importlib.import_module(f"matplotlib.{module}".rstrip("."))


def _words(value: object) -> str:
    return str(value).replace("_", " ")


def _outcomes(content: Content, sheet: Figure) -> bool:
    """Outcomes by system under test, stacked."""
    lines = verdict_table(content.dossier)[:-1]
    sheet.set_size_inches(7, 1.8 + 0.36 * len(lines))
    axes = sheet.subplots()
    names = [line.model for line in lines]
    left = np.zeros(len(lines))
    for status in statuses(content.dossier):
        counts = np.array([line.counts[status] for line in lines], float)
        if counts.any():
            axes.barh(names, counts, left=left, color=status_color(status), label=_words(status))
        left += counts
    for line, total in zip(lines, left, strict=True):
        told = f" {line.passed}/{line.total} passed"
        if line.interval:
            told += f" ({100 * line.interval[0]:.0f} to {100 * line.interval[1]:.0f} %)"
        axes.text(total, line.model, told, va="center", fontsize=8)
    axes.set_xlim(0, max(left) * 1.45)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.set_xlabel("Cases")
    sheet.legend(loc="outside upper left", ncols=4, frameon=False)
    return True


def _too_wide(content: Content) -> str:
    """Why the maps are not drawn; empty: they are."""
    for axis in page_axes(content.dossier):
        many = len(axis_values(content.dossier, axis))
        if many > HEAT_MAX:
            return (
                f"plots: the maps are left out, {axis} has {many} values and a map at most "
                f"{HEAT_MAX}; the page has them"
            )
    return ""


def _heat(content: Content, sheet: Figure) -> bool:
    """A map of verdicts per system under test."""
    dossier = content.dossier
    if _too_wide(content):
        return False
    x_axis, y_axis = page_axes(dossier)
    models = axis_values(dossier, "model")[:GRID_ROWS_MAX]
    known = statuses(dossier)
    colors = _matplotlib("colors").ListedColormap([status_color(status) for status in known])
    columns = min(2, len(models))
    rows = -(-len(models) // columns)
    first = cells_of(dossier, dossier.rows, x_axis, y_axis)
    wide = 1.6 + 0.62 * len(first.xs)
    high = 1.5 + 0.34 * len(first.ys)
    sheet.set_size_inches(max(wide * columns, 6), high * rows)
    panels = sheet.subplots(rows, columns, squeeze=False).flat
    for panel, model in zip(panels, models, strict=False):
        own = [row for row in dossier.rows if row.case.model == model]
        cells = cells_of(dossier, own, x_axis, y_axis)
        shown = np.full((len(cells.ys), len(cells.xs)), np.nan)
        for y, line in enumerate(cells.rows):
            for x, cell in enumerate(line):
                if cell:
                    shown[y, x] = known.index(worst(cell).status)
                    text = f"{status_symbol(worst(cell).status)} {cell_number(cell)}"
                    panel.text(
                        x, y, text.rstrip(), ha="center", va="center", fontsize=7, color="white"
                    )
        panel.imshow(shown, cmap=colors, vmin=-0.5, vmax=len(known) - 0.5, aspect="auto")
        panel.set_xticks(range(len(cells.xs)), [_words(x) for x in cells.xs], rotation=45)
        panel.set_yticks(range(len(cells.ys)), [_words(y) for y in cells.ys])
        panel.set_title(str(model), fontsize=10)
        panel.set_xlabel(axis_label(x_axis))
        panel.set_ylabel(axis_label(y_axis))
        panel.grid(visible=False)
    for panel in panels:
        panel.set_axis_off()
    _legend(sheet, {_words(status): status_color(status) for status in known})
    return True


def _legend(sheet: Figure, colors: dict[str, str]) -> None:
    patch = _matplotlib("patches").Patch
    handles = [patch(color=color, label=label) for label, color in colors.items()]
    sheet.legend(handles=handles, loc="outside lower left", ncols=8, frameon=False)


def _kpis(content: Content, sheet: Figure) -> bool:
    """The paper's Fig. 5: a row per system under test, a column per KPI, a line per case."""
    dossier = content.dossier
    names = [n for n in drawn(dossier) if n != "speed_mps" or dossier.lane_keeping]
    models = axis_values(dossier, "model")[:GRID_ROWS_MAX]
    with_curve = [row for row in content.shown if row.case.id in content.curves]
    share = LINES_MAX // len(models)
    by_model = {m: [row for row in with_curve if row.case.model == m][:share] for m in models}
    rows = [row for own in by_model.values() for row in own]
    if not rows:
        return False
    axis = "weather" if "weather" in varied_axes(dossier) else "model"
    styles = line_styles(axis, axis_values(dossier, axis))
    sheet.set_size_inches(2.9 * len(names), 0.8 + 1.7 * len(models))
    panels = sheet.subplots(len(models), len(names), squeeze=False, sharex=True, sharey="col")
    for line, model in enumerate(models):
        own = by_model[model]
        total = sum(row.case.model == model for row in dossier.rows)
        for column, name in enumerate(names):
            panel = panels[line][column]
            lines, colors = [], []
            for row in own:
                curve = content.curves[row.case.id]
                lines.append(np.column_stack([curve.time_s, curve.values[name]]))
                colors.append(styles[str(getattr(row.case, axis))][0])
            panel.add_collection(
                _matplotlib("collections").LineCollection(
                    lines, colors=colors, linewidths=0.7, rasterized=len(rows) > _RASTER_LINES
                )
            )
            panel.autoscale_view()
            if name == "dtc_m":
                panel.axhline(SAFETY_M, color="#B3261E", lw=0.8, ls="--")
            if line == 0:
                unit = TITLES[name][1].rpartition("[")[2]
                panel.set_title(f"{TITLES[name][0]} [{unit}", fontsize=9)
            if line == len(models) - 1:
                panel.set_xlabel("Sim time [s]")
        cut = f"\n{len(own)} of {total} cases" if len(own) == share < total else ""
        panels[line][0].set_ylabel(f"{model}{cut}")
    _legend(sheet, {_words(value): style[0] for value, style in styles.items()})
    return True


def _effects(content: Content, sheet: Figure) -> bool:
    """Main effects of the axes with 95 % intervals."""
    shown = [e for e in content.effects if any(level.total for level in e.levels)]
    if not shown:
        return False
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    sheet.set_size_inches(3.4 * columns, 2.9 * rows)
    panels = sheet.subplots(rows, columns, squeeze=False, sharey=True).flat
    for panel, effect in zip(panels, shown, strict=False):
        levels = [level for level in effect.levels if level.share is not None]
        shares = np.array([100 * (level.share or 0.0) for level in levels])
        low = np.array([100 * (level.low or 0.0) for level in levels])
        high = np.array([100 * (level.high or 0.0) for level in levels])
        names = [_words(level.value) for level in levels]
        panel.errorbar(names, shares, [shares - low, high - shares], fmt="o:", lw=1, capsize=3)
        panel.set_title(effect.label, fontsize=10)
        panel.set_ylim(-4, 104)
        panel.tick_params("x", rotation=45)
    for panel in panels:
        panel.set_axis_off()
    sheet.supylabel("passed [%]", fontsize=9)
    return True


def _leases(content: Content, sheet: Figure) -> bool:
    """Leases by worker over wall time."""
    spans = content.leases.spans[:SPANS_MAX]
    if not spans:
        return False
    lanes, places = lanes_of(spans)
    status = {row.case.id: row.status for row in content.dossier.rows}
    sheet.set_size_inches(8, min(9.0, 1.8 + 0.16 * len(lanes)))
    axes = sheet.subplots()
    colors = [
        status_color(status.get(span.case, "")) if span.how == "committed" else "#111111"
        for span in spans
    ]
    corners = [
        [
            (x, place + y)
            for x, y in zip((s.start_s, s.start_s, s.end_s, s.end_s), _BAR, strict=True)
        ]
        for s, place in zip(spans, places, strict=True)
    ]
    axes.add_collection(
        _matplotlib("collections").PolyCollection(
            corners,
            facecolors=colors,
            edgecolors="white",
            linewidths=0.2,
            rasterized=len(spans) > _RASTER_LINES,
        )
    )
    axes.autoscale_view()
    axes.set_ylim(len(lanes) - 0.4, -0.6)
    firsts = [number for number, (_, slot) in enumerate(lanes) if slot == 0]
    step = max(1, len(firsts) // 40)
    axes.set_yticks(firsts[::step], [lanes[number][0] for number in firsts[::step]])
    axes.set_xlabel("Wall time [s]")
    return True


_PLOTS: dict[str, Callable[[Content, Figure], bool]] = {
    "outcomes": _outcomes,
    "heat": _heat,
    "kpis": _kpis,
    "effects": _effects,
    "leases": _leases,
}
"""File name -> who draws it; False: there is nothing to draw."""
