"""The heat maps of all models as one picture, for pages that cannot draw."""

from __future__ import annotations

import io

from PIL import Image, ImageDraw, ImageFont

from conductor.report.axes import axis_label
from conductor.report.cells import Cells, cell_number, cells_of, worst
from conductor.report.dossier import Dossier
from conductor.report.losses import page_axes
from conductor.report.palette import status_color
from conductor.report.systems import system_names
from conductor.report.tables import statuses

_CELL_PX = (58, 30)
_MARGIN_PX = (118, 46, 18, 46)
"""Left, above, right and below a map."""
_GAP_PX = 3
_FONT_PX, _TITLE_PX = 13, 16
_INK, _PAPER = "#1F2328", "#FFFFFF"
_MARKS = {
    "collision": "X",
    "false_braking": "!",
    "lane_departure": "<>",
    "time_up": "T",
    "failed": "F",
    "unresolved": "?",
}
"""Before the number, for those who do not tell the colours apart; in the fonts of Pillow."""
_DARK = {"pass", "collision", "failed", "unresolved"}
"""Statuses whose fill asks for white text."""


def heat_picture(dossier: Dossier) -> bytes:
    """The maps as PNG, two beside each other, with a legend."""
    x_axis, y_axis = page_axes(dossier)
    maps = []
    for model, name in system_names(dossier).items():
        own = [row for row in dossier.rows if row.case.model == model]
        maps.append((name, cells_of(dossier, own, x_axis, y_axis)))
    left, above, right, below = _MARGIN_PX
    first = maps[0][1]
    width = left + _CELL_PX[0] * len(first.xs) + right
    height = above + _CELL_PX[1] * len(first.ys) + below
    columns = min(2, len(maps))
    lines = -(-len(maps) // columns)
    size = (max(columns * width, 560), lines * height + 34)
    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    labels = (axis_label(x_axis), axis_label(y_axis))
    for number, (title, cells) in enumerate(maps):
        row, column = divmod(number, columns)
        _map(draw, (column * width + left, row * height + above), title, cells, labels)
    _legend(draw, dossier, (left, lines * height + 6))
    out = io.BytesIO()
    picture.save(out, "PNG", optimize=True)
    return out.getvalue()


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
        draw.text((x0 - 8, middle), str(y).replace("_", " "), _INK, font, anchor="rm")
    for j, x in enumerate(cells.xs):
        place = (x0 + j * wide + wide // 2, y0 + len(cells.ys) * high + 6)
        draw.text(place, str(x).replace("_", " "), _INK, font, anchor="mt")
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
            ink = _PAPER if status in _DARK else _INK
            draw.text(((box[0] + end[0]) / 2, (box[1] + end[1]) / 2), text, ink, font, anchor="mm")


def _legend(draw: ImageDraw.ImageDraw, dossier: Dossier, corner: tuple[int, int]) -> None:
    font = ImageFont.load_default(_FONT_PX)
    x, y = corner
    for status in statuses(dossier):
        draw.rectangle((x, y, x + 14, y + 14), status_color(status))
        text = f"{_MARKS.get(status, '')} {status.replace('_', ' ')}".strip()
        draw.text((x + 20, y + 7), text, _INK, font, anchor="lm")
        x += 20 + round(draw.textlength(text, font)) + 18
