"""Which case is meant by what was typed."""

from viewer.live.prompt import NAMES_MAX, choose

NAMES = ["yolov3-1300-clear", "yolov3-1300-heavy_fog", "yolov3-tiny-1300-clear"]


def test_a_name_or_a_part_that_no_other_has():
    assert choose("yolov3-1300-clear", NAMES) == ("yolov3-1300-clear", "")
    assert choose("fog", NAMES) == ("yolov3-1300-heavy_fog", "")
    assert choose("clear", [*NAMES, "clear"]) == ("clear", ""), "a whole name counts as such"


def test_otherwise_a_line_says_why():
    case, line = choose("clear", NAMES)
    assert case == ""
    assert line == "'clear' is in 2 names: yolov3-1300-clear, yolov3-tiny-1300-clear"
    assert "in no name on the wall; there are e.g. yolov3" in choose("snow", NAMES)[1]
    assert choose("", [])[1] == "no case runs yet"
    many = [f"c{i:02}" for i in range(50)]
    assert choose("", many)[1].count(", c") == NAMES_MAX - 1
