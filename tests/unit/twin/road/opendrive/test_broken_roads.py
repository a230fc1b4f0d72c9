"""Road files that are broken, and those of others that are not: one line, or none."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import LINE, WIDTH, end, geometry, lane, road, section, xodr

from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.reading.reader import FILE_BYTES_MAX
from twin.road.opendrive.road_map import RoadMap

FILES = Path(__file__).parents[6] / "shared" / "data" / "openscenario"

BOMB = b"""<?xml version="1.0"?>
<!DOCTYPE OpenDRIVE [
 <!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;">
]>
<OpenDRIVE><header revMajor="1" revMinor="6" name="&c;"/></OpenDRIVE>
"""

BROKEN = {
    "empty": (b"", ":1: "),
    "no XML": (b"\x00\x01\x02", ":1: "),
    "cut off": (xodr()[:-20], ":16: "),
    "another root": (b"<?xml version='1.0'?>\n<OpenSCENARIO/>", ":2: the root element is"),
    "entities": (BOMB, ":5: a document type (DOCTYPE) is not read"),
    "too deep": (b"<OpenDRIVE>" + b"<a>" * 60, "nest deeper than 32"),
    "no header": (b"<OpenDRIVE/>", "<header> is missing"),
    "an old version": (xodr(version=(1, 3)), "version 1.3; 1.4 to 1.8 are read"),
    "an unknown version": (xodr(version=(1, "x")), ":3: "),
    "NaN": (xodr(road(plan=geometry(LINE, 100.0, at=(float("nan"), 0.0, 0.0)))), "nan"),
    "a negative length": (xodr(road(plan=geometry(LINE, -5.0))), "-5"),
    "a road without end": (xodr(road(plan=geometry(LINE, 60.0))), "100"),
    "an unknown element": (xodr(road(more="<teleport/>")), "<teleport>"),
    "an unknown shape": (xodr(road(plan=geometry("<bezier/>", 100.0))), "<bezier>"),
    "a link to nowhere": (xodr(road(link=end("successor", "road", "7", "start"))), "7"),
    "the same id twice": (xodr(road(), road()), "a second time"),
    "sections out of order": (xodr(road(lanes=section(50.0) + section(0.0))), ":"),
    "a width that is none": (
        xodr(road(lanes=section(right=lane(-1, WIDTH.replace("3.5", "wide"))))),
        "'wide'",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_line_with_file_and_line(name: str, tmp_path: Path) -> None:
    content, reason = BROKEN[name]
    path = tmp_path / "broken.xodr"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"broken\.xodr:\d+: ") as error:
        load_network(path)
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_of_200_mb_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.xodr"
    with path.open("wb") as file:
        file.truncate(200 << 20)
    with pytest.raises(ValueError, match=f"large.xodr.*{FILE_BYTES_MAX}") as error:
        load_network(path)
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")
def test_files_of_others_are_read_and_their_roads_meet() -> None:
    paths = sorted(FILES.rglob("*.xodr"))
    assert len(paths) == 12
    for path in paths:
        network = load_network(path)
        assert network.roads, path
        assert find_gaps(network, RoadMap(network).frames) == [], path
