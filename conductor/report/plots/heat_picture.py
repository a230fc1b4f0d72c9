"""The heat maps of all models as one picture, for pages that cannot draw."""

from __future__ import annotations

import io
import math

from PIL import Image, ImageDraw, ImageFont

from conductor.report.analysis.losses import page_axes
from conductor.report.pages.tables import statuses
from conductor.report.plots.cells import Cells, cell_number, cells_of, worst
from conductor.report.plots.palette import status_color, status_ink
from conductor.report.reading.axes import axis_label
from conductor.report.reading.dossier import Dossier
from conductor.report.reading.systems import system_names
from schemas.kinds.scenario import verdict_kinds

_CELL_PX = (58, 30)
_MARGIN_PX = (12, 46, 18, 46)
"""Left of the labels, above, right and below a map."""
_LEGEND_PX = 22
"""Height of a row of the legend."""
_GAP_PX = 3
_FONT_PX, _TITLE_PX = 13, 16
_INK, _PAPER = "#1F2328", "#FFFFFF"
_MARKS = {
    **{verdict.name: verdict.mark for verdict in verdict_kinds() if verdict.mark},
    "failed": "F",
    "unresolved": "?",
}
"""Marks before the number, for those who do not tell the colours apart; in the fonts of Pillow."""

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


def heat_picture(dossier: Dossier) -> bytes:
    """The maps as PNG, two beside each other, with a legend."""
    x_axis, y_axis = page_axes(dossier)
    maps = []
    for model, name in system_names(dossier).items():
        model_rows = [row for row in dossier.rows if row.case.variation.model == model]
        maps.append((name, cells_of(dossier, model_rows, x_axis, y_axis)))
    labels = (axis_label(x_axis), axis_label(y_axis))
    first = maps[0][1]
    font, large = ImageFont.load_default(_FONT_PX), ImageFont.load_default(_TITLE_PX)
    beside = max(_wide(text, font) for text in [labels[1], *map(_words, first.ys)])
    margin, above, right, below = _MARGIN_PX
    left = margin + beside + 8
    inner = max(_CELL_PX[0] * len(first.xs), *(_wide(name, large) for name, _ in maps))
    width = left + max(inner, _wide(labels[0], font)) + right
    height = above + _CELL_PX[1] * len(first.ys) + below
    columns = min(2, len(maps))
    lines = -(-len(maps) // columns)
    wide = max(columns * width, 560)
    legend = _legend_places(dossier, wide, font)
    high = lines * height + _LEGEND_PX * (1 + max(row for row, _, _ in legend)) + 12
    picture = Image.new("RGB", (wide, high), _PAPER)
    draw = ImageDraw.Draw(picture)
    for number, (title, cells) in enumerate(maps):
        row, column = divmod(number, columns)
        _map(draw, (column * width + left, row * height + above), title, cells, labels)
    _legend(draw, legend, lines * height + 6, font)
    out = io.BytesIO()
    picture.save(out, "PNG", optimize=True)
    return out.getvalue()


def _words(value: object) -> str:
    return str(value).replace("_", " ")


def _wide(text: str, font: Font) -> int:
    return math.ceil(font.getlength(text))


def _map(
    draw: ImageDraw.ImageDraw,
    corner: tuple[int, int],
    title: str,
    cells: Cells,
    labels: tuple[str, str],
) -> None:
    x0, y0 = corner
    wide, high = _CELL_PX
    font, large = ImageFont.load_default(_FONT_PX), ImageFont.load_default(_TITLE_PX)
    draw.text((x0, y0 - 12), title, _INK, large, anchor="ls")
    draw.text((x0 - 8, y0 - 12), labels[1], _INK, font, anchor="rs")
    for i, y in enumerate(cells.ys):
        middle = y0 + i * high + high // 2
        draw.text((x0 - 8, middle), _words(y), _INK, font, anchor="rm")
    for j, x in enumerate(cells.xs):
        place = (x0 + j * wide + wide // 2, y0 + len(cells.ys) * high + 6)
        draw.text(place, _words(x), _INK, font, anchor="mt")
    under = (x0 + len(cells.xs) * wide // 2, y0 + len(cells.ys) * high + 24)
    draw.text(under, labels[0], _INK, font, anchor="mt")
    for i, line in enumerate(cells.rows):
        for j, cell in enumerate(line):
            if not cell:
                continue
            status = worst(cell).status
            box = (x0 + j * wide, y0 + i * high)
            end = (box[0] + wide - _GAP_PX, box[1] + high - _GAP_PX)
            draw.rectangle((*box, *end), status_color(status))
            text = f"{_MARKS.get(status, '')} {cell_number(cell)}".strip()
            ink = status_ink(status)
            draw.text(((box[0] + end[0]) / 2, (box[1] + end[1]) / 2), text, ink, font, anchor="mm")


def _legend_places(dossier: Dossier, wide: int, font: Font) -> list[tuple[int, int, str]]:
    """Row, left edge [px] and status of every entry."""
    places = []
    row, x = 0, _MARGIN_PX[0]
    for status in statuses(dossier):
        width = 20 + _wide(_said(status), font) + 18
        if x + width > wide and x > _MARGIN_PX[0]:
            row, x = row + 1, _MARGIN_PX[0]
        places.append((row, x, status))
        x += width
    return places


def _legend(
    draw: ImageDraw.ImageDraw, places: list[tuple[int, int, str]], top: int, font: Font
) -> None:
    for row, x, status in places:
        y = top + _LEGEND_PX * row
        draw.rectangle((x, y, x + 14, y + 14), status_color(status))
        draw.text((x + 20, y + 7), _said(status), _INK, font, anchor="lm")


def _said(status: str) -> str:
    return f"{_MARKS.get(status, '')} {_words(status)}".strip()
