"""twin.road.surface.mark_lines: lines and strokes of road marks."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import WIDTH, lane, road, section, xodr

from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.records import LaneSection
from twin.road.surface.mark_lines import (
    DASH_M,
    STROKES_MAX,
    PaintedLine,
    line_strokes,
    painted_marks,
)


def mark(kind: str, more: str = "", inside: str = "", s: float = 0.0) -> str:
    body = f">{inside}</roadMark>" if inside else "/>"
    return f'<roadMark sOffset="{s}" type="{kind}" color="standard" width="0.2" {more}{body}'


def section_with(left: str = "", right: str = "") -> LaneSection:
    lanes = section(left=lane(1, WIDTH + left), right=lane(-1, WIDTH + right))
    return read_network(xodr(road(lanes=lanes)), "t").roads["0"].sections[0]


def lines_of(left: str = "", right: str = "") -> list[tuple[int, float, float]]:
    """Lane, place beside its border and stroke of every line."""
    return [
        (painted.lane, line.aside_m, line.stroke_m)
        for painted in painted_marks(section_with(left, right))
        for line in painted.lines
    ]


def test_single_lines():
    assert lines_of(right=mark("solid")) == [(-1, 0.0, 0.0)]
    assert lines_of(right=mark("broken")) == [(-1, 0.0, DASH_M[0])]


@pytest.mark.parametrize("kind", ["none", "curb", "grass", "edge"])
def test_what_is_not_painted(kind):
    assert lines_of(right=mark(kind)) == []


def test_double_lines_are_named_from_the_inside_to_the_outside():
    outside = [(-1, 0.2, 0.0), (-1, -0.2, DASH_M[0])]
    assert lines_of(right=mark("solid broken")) == outside
    assert lines_of(left=mark("solid broken")) == [(1, -0.2, 0.0), (1, 0.2, DASH_M[0])]


def test_dots_are_one_line():
    ((_, aside, stroke),) = lines_of(right=mark("botts dots"))
    assert aside == 0.0
    assert 0.0 < stroke < 0.3


def test_bold_marks_are_twice_as_wide():
    (painted,) = painted_marks(section_with(right=mark("solid", 'weight="bold"')))
    assert painted.lines[0].width_m == 0.4


def test_lines_of_the_file_count_instead_of_the_type():
    inside = (
        '<type name="t" width="0.2"><line length="4" space="8" tOffset="0.1" sOffset="1" '
        'width="0.3" color="yellow"/></type>'
    )
    (painted,) = painted_marks(section_with(right=mark("solid solid", inside=inside)))
    assert painted.lines == (PaintedLine(0.1, 4.0, 8.0, 1.0, 0.3, "yellow"),)


def test_a_mark_holds_until_the_next():
    marks = [
        (painted.begin_m, painted.end_m)
        for painted in painted_marks(section_with(right=mark("solid") + mark("broken", s=30.0)))
    ]
    assert marks == [(0.0, 30.0), (30.0, 100.0)]


def test_strokes_are_cut_at_the_end():
    line = PaintedLine(0.0, 3.0, 6.0, 1.0, 0.2, "white")
    assert line_strokes(line, 10.0, 31.0).tolist() == [[11.0, 14.0], [20.0, 23.0], [29.0, 31.0]]
    assert line_strokes(line, 10.0, 10.5).tolist() == []
    solid = PaintedLine(0.0, 0.0, 6.0, 1.0, 0.2, "white")
    assert line_strokes(solid, 10.0, 31.0).tolist() == [[10.0, 31.0]]


def test_a_million_strokes_are_bounded():
    line = PaintedLine(0.0, 1e-6, 1e-6, 0.0, 0.2, "white")
    strokes = line_strokes(line, 0.0, 1000.0)
    assert strokes.shape == (STROKES_MAX, 2)
    assert np.isfinite(strokes).all()
