"""Road files that are broken, and those of others that are not: one line, or none."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from broken_files import BROKEN_ROADS

from twin.road.opendrive.gaps import find_gaps
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.reading.reader import FILE_BYTES_MAX
from twin.road.opendrive.road_map import RoadMap

FILES = Path(__file__).parents[6] / "shared" / "data" / "openscenario"


@pytest.mark.parametrize("name", BROKEN_ROADS)
def test_a_broken_file_is_one_line_with_file_and_line(name: str, tmp_path: Path) -> None:
    content, reason = BROKEN_ROADS[name]
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
