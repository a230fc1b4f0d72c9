"""In which line of a YAML file a key stands."""

import pytest

from schemas.files.yaml_file import line_of

TEXT = """\
# a comment
campaign: x
camera:
  width: 3
  "a.b": {c: 1}
cases:
  - weather: clear
  -
    weather: fog
    list: [1,
      2]
matrix: {scenario.line_m: [1, 2], scenario: {line_m: 3}}
base: &base {hz: 1}
other: *base
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("campaign", 2),
        ("camera", 3),
        ("camera.width", 4),
        ("camera.a.b", 5),
        ("camera.a.b.c", 5),
        ("cases[0].weather", 7),
        ("cases[1].weather", 9),
        ("cases[1].list[1]", 11),
        ("cases[1].list[0]", 10),
        ("matrix.scenario.line_m", 12),
        ("matrix.scenario.line_m[1]", 12),
        ("other.hz", 13),
        ("", None),
        ("nothing", None),
        ("camera.nothing", None),
        ("camera.width.deeper", None),
        ("cases[7]", None),
        ("cases[-1]", None),
        ("campaign[0]", None),
    ],
)
def test_a_key_and_its_line(path, line):
    assert line_of(TEXT, path) == line


@pytest.mark.parametrize("text", ["", "a: [", "- 1\n- 2", "a", "a: !!set {}", "[" * 5000])
def test_other_documents_have_no_line(text):
    assert line_of(text, "a.b") is None
