"""The file of a played scenario: what was written is read, and what is broken is one line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from played_files import entity, line, played, straight

from schemas.files.played_scenario import (
    ELEMENTS_MAX,
    ENTITIES_MAX,
    FILE_BYTES_MAX,
    LANES_MAX,
    MARKS_MAX,
    NOTES_MAX,
    PATHS_MAX,
    POINTS_MAX,
    POSES_MAX,
    STEP_S_MIN,
    TEXT_CHARS_MAX,
    TIME_S_MAX,
    TRANSITIONS_MAX,
    PlayElement,
    PlayLane,
    PlayMark,
    PlayTransition,
)
from twin.base.errors import UsageError
from twin.records.play_file import packed_rows, parse_play, poses_of, read_play, write_play


def encoded(play: object) -> bytes:
    return msgspec.msgpack.encode(play)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "s.play"
    write_play(path, played())
    assert read_play(path) == played()
    assert np.array_equal(poses_of(read_play(path).entities[0].poses), straight(10.0))


def test_keys_of_a_later_program_are_skipped() -> None:
    plain = msgspec.msgpack.decode(encoded(played()))
    assert parse_play(encoded({**plain, "weather": "fog"})) == played()


def late(**changes: object) -> np.ndarray:
    rows = straight(1.0)
    for column, value in changes.items():
        rows[3, int(column[1:])] = value
    return rows


def lane(left: bytes, right: bytes) -> PlayLane:
    return PlayLane(type="driving", left=left, right=right)


def mark(**changes: object) -> PlayMark:
    values = {"color": "white", "width_m": 0.1, "stroke_m": 3.0, "gap_m": 6.0, "from_m": 0.0}
    whole: dict[str, Any] = {**values, **changes}
    return PlayMark(points=line((0, 0), (9, 0)), **whole)


def at(*steps: tuple[float, int]) -> list[PlayTransition]:
    return [PlayTransition(time_s=t, element=e, transition="start") for t, e in steps]


def body(rows: np.ndarray, **changes: Any) -> dict[str, Any]:
    return {"entities": [entity("a", rows, **changes)], "elements": [], "transitions": []}


def cut(data: bytes) -> dict[str, Any]:
    return {"entities": [msgspec.structs.replace(entity("a", straight(1.0)), poses=data)]}


NOBODY = PlayElement(level="event", name="e", path="e", actors=[3])
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "another version": ({"version": 2}, "version 2, this program reads 1; play it"),
    "no step": ({"step_s": 0.0}, "step_s 0 is no time"),
    "too short a step": ({"step_s": 0.99 * STEP_S_MIN}, "step_s 9.9e-07 is no time from 1e-06"),
    "a period that is no number": ({"period_s": math.nan}, "period_s nan"),
    "an endless scenario": ({"end_s": math.inf}, "end_s inf"),
    "half a pose": (cut(b"x" * 50), "poses of entity 0: 50 bytes are no rows of 6 numbers"),
    "a pose that is no number": (body(late(c2=math.nan)), "not finite"),
    "a pose beyond the world": (body(late(c1=2e9)), "beyond 1e+09"),
    "time that goes back": (body(late(c0=0.0)), "order of time"),
    "time before the beginning": (body(straight(1.0) - 1.0), "not within the times"),
    "a body without size": (body(straight(1.0), length_m=-1.0), "entity 0 has no box"),
    "a body at no place": (
        body(straight(1.0), centre_m=(0.0, math.inf, 0.0)),
        "entity 0 has no box of finite size",
    ),
    "borders that differ": (
        {"lanes": [lane(line((0, 1), (9, 1)), line((0, 0)))]},
        "lane 0 has borders of 2 and 1 points",
    ),
    "half a point": ({"lanes": [lane(b"x" * 25, b"")]}, "left border of lane 0: 25 bytes"),
    "a stroke of no number": ({"marks": [mark(stroke_m=math.nan)]}, "mark 0 has no strokes"),
    "a gap below zero": ({"marks": [mark(gap_m=-1.0)]}, "mark 0 has no strokes"),
    "a transition of nothing": ({"transitions": at((0.0, 9))}, "transition 0 is of no element"),
    "transitions out of order": (
        {"transitions": at((1.0, 0), (0.5, 0))},
        "transition 1 is not in the order of time",
    ),
    "a transition at no time": ({"transitions": at((math.nan, 0))}, "transition 0 is not in"),
    "an actor that is nobody": (
        {"elements": [NOBODY], "transitions": []},
        "element 0 has an actor that is no entity",
    ),
}
NONE = "no played scenario, or a damaged one; `twin play FILE --save OUT.play` makes one"
BROKEN: dict[str, tuple[bytes, str]] = {
    "empty": (b"", NONE),
    "another format": (b"PAR1" * 20, NONE),
    "cut off": (encoded(played())[:-9], NONE),
    "no version": (encoded({"name": "x"}), NONE),
    "a missing key": (encoded({"version": 1, "name": "x"}), "missing required field `step_s`"),
    "a category that is none": (
        encoded(played()).replace(b"\xa8category\xa3van", b"\xa8category\xa3vat"),
        "Invalid enum value 'vat'",
    ),
    **{name: (encoded(played(**changes)), reason) for name, (changes, reason) in WRONG.items()},
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_line_that_names_it(name: str, tmp_path: Path) -> None:
    data, reason = BROKEN[name]
    path = tmp_path / "s.play"
    path.write_bytes(data)
    with pytest.raises(UsageError) as error:
        read_play(path)
    assert str(error.value).startswith(f"{path}: ")
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_what_stands_in_a_broken_file_is_escaped() -> None:
    category = encoded(played()).replace(b"\xa8category\xa3van", b"\xa8category\xa3\x1b[m")
    assert category != encoded(played())
    with pytest.raises(ValueError, match="damaged played scenario") as error:
        parse_play(category)
    assert str(error.value).isprintable()


def few(count: int, value: object) -> list[object]:
    return [value] * count


ELEMENT = PlayElement(level="event", name="", path="")
BODY = entity("", np.empty((0, 6)))
NOTHING = lane(b"", b"")


@pytest.mark.parametrize(
    ("key", "most", "value"),
    [
        ("entities", ENTITIES_MAX, BODY),
        ("lanes", LANES_MAX, NOTHING),
        ("marks", MARKS_MAX, msgspec.structs.replace(mark(), points=b"")),
        ("paths", PATHS_MAX, msgspec.structs.replace(played().paths[0], points=b"")),
        ("elements", ELEMENTS_MAX, ELEMENT),
        ("transitions", TRANSITIONS_MAX, at((0.0, 0))[0]),
        ("notes", NOTES_MAX, ""),
    ],
)
def test_a_list_at_its_limit_is_read_and_one_more_is_refused(
    key: str, most: int, value: object
) -> None:
    bare = {"entities": [], "elements": [ELEMENT], "transitions": []}
    assert parse_play(encoded(played(**{**bare, key: few(most, value)})))
    with pytest.raises(ValueError, match=str(most)):
        parse_play(encoded(played(**{**bare, key: few(most + 1, value)})))


def test_texts_poses_points_and_times_have_limits(tmp_path: Path) -> None:
    assert parse_play(encoded(played(name="x" * TEXT_CHARS_MAX)))
    with pytest.raises(ValueError, match=str(TEXT_CHARS_MAX)):
        parse_play(encoded(played(name="x" * (TEXT_CHARS_MAX + 1))))
    rows = np.zeros((POSES_MAX, 6))
    rows[:, 0] = np.arange(POSES_MAX) * 0.1
    assert parse_play(encoded(played(entities=[entity("a", rows)], elements=[], transitions=[])))
    more = [entity("a", rows), entity("b", rows[:1])]
    with pytest.raises(ValueError, match=f"{POSES_MAX + 1} poses, at most {POSES_MAX}"):
        parse_play(encoded(played(entities=more, elements=[], transitions=[])))
    points = packed_rows(np.zeros((POINTS_MAX, 3)))
    many = [msgspec.structs.replace(played().paths[0], points=points)]
    assert parse_play(encoded(played(paths=many, lanes=[], marks=[])))
    with pytest.raises(ValueError, match=f"at most {POINTS_MAX}"):
        parse_play(encoded(played(paths=many, lanes=[], marks=[mark()])))
    assert parse_play(encoded(played(end_s=TIME_S_MAX)))
    with pytest.raises(ValueError, match="end_s"):
        parse_play(encoded(played(end_s=TIME_S_MAX * 1.01)))


def test_a_file_beyond_its_size_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.play"
    with path.open("wb") as file:
        file.truncate(FILE_BYTES_MAX + 1)
    with pytest.raises(UsageError, match=f"at most {FILE_BYTES_MAX} are read"):
        read_play(path)


def test_what_is_no_file_is_a_line(tmp_path: Path) -> None:
    for path, reason in ((tmp_path, "directory"), (tmp_path / "none.play", "No such file")):
        with pytest.raises(UsageError, match=reason):
            read_play(path)
    with pytest.raises(UsageError, match="No such file"):
        write_play(tmp_path / "none" / "s.play", played())


def test_what_cannot_be_read_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "s.play"
    with pytest.raises(UsageError, match="cannot be saved: end_s"):
        write_play(path, played(end_s=-1.0))
    assert not path.exists()
