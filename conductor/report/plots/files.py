"""The figures of the report as files, PNG and SVG, for papers and slides: ``plots/``.

Drawn by matplotlib, of the same tables and curves as the page.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from conductor.report.analysis.losses import page_axes
from conductor.report.pages.content import Content
from conductor.report.pages.tables import statuses, verdict_table
from conductor.report.plots.cells import Cells, cell_number, cells_of, worst
from conductor.report.plots.figures import GRID_ROWS_MAX
from conductor.report.plots.kpis import kpis_plot
from conductor.report.plots.leases_figure import SPANS_MAX, lanes_of
from conductor.report.plots.palette import status_color, status_ink, status_symbol
from conductor.report.plots.parts import (
    LEGEND_ROW_IN,
    RASTER_LINES,
    Figure,
    label_x,
    legend,
    library,
    words,
    wrapped,
)
from conductor.report.plots.search_plot import search_plot
from conductor.report.reading.axes import axis_label, axis_values
from conductor.report.reading.systems import system_names
from twin.base.files import write_atomic
from twin.base.progress import steps

PLOTS_FOLDER = "plots"
HEAT_MAX = 64
"""Most values of an axis of the maps."""
STYLE = {
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
"""How every plot looks."""

_EFFECT_IN, _NAME_IN = 2.8, 1.7
"""Width of a panel of effects, and of a system's name [inches]."""
_BAR = (-0.4, 0.4, 0.4, -0.4)
"""Height of a lease's corners above the middle of its lane."""


def write_plots(content: Content) -> tuple[list[Path], str]:
    """Write the plots; returns their paths, and what was left out.

    Raises:
        OSError: the disk lets us down.
    """
    try:
        library("")
    except ImportError:
        return [], "plots are left out: matplotlib is not installed; pip install matplotlib"
    folder = content.dossier.folder / PLOTS_FOLDER
    folder.mkdir(exist_ok=True)
    written = []
    with _styled():
        for name in steps("plots", PLOTS):
            sheet = _sheet(content, name)
            if sheet is None:
                for suffix in ("png", "svg"):
                    (folder / f"{name}.{suffix}").unlink(missing_ok=True)
                continue
            for suffix, data in _drawn_once(sheet):
                path = folder / f"{name}.{suffix}"
                write_atomic(path, data.getbuffer(), sync=False)
                written.append(path)
    return written, _too_wide(content)


def plot_picture(content: Content, name: str) -> bytes | None:
    """One of :data:`PLOTS` as PNG; None: there is nothing to draw, or matplotlib is missing."""
    try:
        library("")
    except ImportError:
        return None
    with _styled():
        sheet = _sheet(content, name)
        return None if sheet is None else next(_drawn_once(sheet))[1].getvalue()


@contextlib.contextmanager
def _styled() -> Iterator[None]:
    """Figures that are drawn meanwhile look like all others."""
    with library("").rc_context(STYLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that are too long for a layout, or for a font
        yield


def _sheet(content: Content, name: str) -> Figure | None:
    """One of :data:`PLOTS`; None: there is nothing to draw."""
    sheet = library("figure").Figure(layout="constrained")
    return sheet if PLOTS[name](content, sheet) else None


def _drawn_once(sheet: Figure) -> Iterator[tuple[str, io.BytesIO]]:
    """Endings and bytes of a figure's files.

    ``savefig`` draws everything twice, the first time for the layout alone, which takes longest.
    """
    png, svg = io.BytesIO(), io.BytesIO()
    library("backends.backend_agg").FigureCanvasAgg(sheet).print_png(png)
    yield "png", png
    sheet.set_layout_engine("none")  # the second file has the layout of the first
    canvas = library("backends.backend_svg").FigureCanvasSVG(sheet)
    canvas.print_svg(svg, metadata={"Date": None})
    yield "svg", svg


def _outcomes(content: Content, sheet: Figure) -> bool:
    """Outcomes by system under test, stacked."""
    lines = verdict_table(content.dossier)[:-1]
    known = statuses(content.dossier)
    sheet.set_size_inches(7, 1.4 + 0.4 * len(lines) + LEGEND_ROW_IN * -(-len(known) // 4))
    axes = sheet.subplots()
    places = np.arange(len(lines))
    left = np.zeros(len(lines))
    for status in known:
        counts = np.array([line.counts[status] for line in lines], float)
        if counts.any():
            axes.barh(places, counts, left=left, color=status_color(status), label=words(status))
        left += counts
    for place, line, total in zip(places, lines, left, strict=True):
        label = f" {line.passed}/{line.total} passed"
        if line.interval:
            label += f" ({100 * line.interval[0]:.0f} to {100 * line.interval[1]:.0f} %)"
        axes.text(total, place, label, va="center", fontsize=8)
    axes.set_yticks(places, [wrapped(line.name, _NAME_IN) for line in lines])
    axes.set_xlim(0, max(left) * 1.6)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.xaxis.get_major_locator().set_params(integer=True)
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
    names = dict(list(system_names(dossier).items())[:GRID_ROWS_MAX])
    known = statuses(dossier)
    columns = min(2, len(names))
    rows = -(-len(names) // columns)
    first = cells_of(dossier, dossier.rows, x_axis, y_axis)
    wide_in = max(0.62 * len(first.xs), 4.0 / columns)
    high_in = max(0.34 * len(first.ys), 1.1)
    sheet.set_size_inches((1.6 + wide_in) * columns, (1.5 + high_in) * rows + LEGEND_ROW_IN)
    panels = sheet.subplots(rows, columns, squeeze=False).flat
    for panel, (model, name) in zip(panels, names.items(), strict=False):
        model_rows = [row for row in dossier.rows if row.case.variation.model == model]
        cells = cells_of(dossier, model_rows, x_axis, y_axis)
        _fill(panel, cells, known)
        label_x(panel, [words(x) for x in cells.xs], wide_in)
        panel.set_yticks(range(len(cells.ys)), [words(y) for y in cells.ys])
        panel.set_title(wrapped(name, wide_in), fontsize=10)
        panel.set_xlabel(axis_label(x_axis))
        panel.set_ylabel(wrapped(axis_label(y_axis), high_in))
    for panel in panels:
        panel.set_axis_off()
    legend(sheet, {words(status): status_color(status) for status in known})
    return True


def _fill(panel: Figure, cells: Cells, known: list[str]) -> None:
    """The cells of one map, each with a border, its symbol and number."""
    shown = np.full((len(cells.ys), len(cells.xs)), np.nan)
    for y, line in enumerate(cells.rows):
        for x, cell in enumerate(line):
            if cell:
                status = worst(cell).status
                shown[y, x] = known.index(status)
                text = f"{status_symbol(status)} {cell_number(cell)}".rstrip()
                ink = status_ink(status)
                panel.text(x, y, text, ha="center", va="center", fontsize=7, color=ink)
    panel.pcolormesh(
        *(np.arange(len(values) + 1) - 0.5 for values in (cells.xs, cells.ys)),
        np.ma.masked_invalid(shown),
        cmap=library("colors").ListedColormap([status_color(status) for status in known]),
        vmin=-0.5,
        vmax=len(known) - 0.5,
        edgecolors="white",
        linewidth=1.5,
    )
    panel.invert_yaxis()
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    panel.grid(visible=False)


def _effects(content: Content, sheet: Figure) -> bool:
    """Main effects of the axes with 95 % intervals."""
    shown = [e for e in content.effects if any(level.total for level in e.levels)]
    if not shown:
        return False
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    sheet.set_size_inches((_EFFECT_IN + 0.6) * columns, 2.9 * rows)
    panels = sheet.subplots(rows, columns, squeeze=False, sharey=True).flat
    for panel, effect in zip(panels, shown, strict=False):
        levels = [level for level in effect.levels if level.share is not None]
        shares = np.array([100 * (level.share or 0.0) for level in levels])
        low = np.array([100 * (level.low or 0.0) for level in levels])
        high = np.array([100 * (level.high or 0.0) for level in levels])
        places = range(len(levels))
        panel.errorbar(places, shares, [shares - low, high - shares], fmt="o:", lw=1, capsize=3)
        panel.set_title(effect.label, fontsize=10)
        panel.set_ylim(-4, 104)
        label_x(panel, [words(level.value) for level in levels], _EFFECT_IN)
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
        library("collections").PolyCollection(
            corners,
            facecolors=colors,
            edgecolors="white",
            linewidths=0.2,
            rasterized=len(spans) > RASTER_LINES,
        )
    )
    axes.autoscale_view()
    axes.set_ylim(len(lanes) - 0.4, -0.6)
    firsts = [number for number, (_, slot) in enumerate(lanes) if slot == 0]
    step = max(1, len(firsts) // 40)
    axes.set_yticks(firsts[::step], [lanes[number][0] for number in firsts[::step]])
    axes.set_xlabel("Wall time [s]")
    return True


PLOTS: dict[str, Callable[[Content, Figure], bool]] = {
    "outcomes": _outcomes,
    "heat": _heat,
    "kpis": kpis_plot,
    "effects": _effects,
    "leases": _leases,
    "search": search_plot,
}
"""File name -> who draws it; False: there is nothing to draw."""
