"""Broken scenario and road files: a line each with file and line number, and nothing is leased."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from broken_files import BROKEN_ROADS, GOOD, LAUGHS, MISTAKES, ROUTE, TELEPORT
from many_commands import run_many
from road_files import xodr

pytestmark = pytest.mark.slow
IMPORTS = ("twin.validate.command",)
LARGE_BYTES = 200 << 20
INIT = "<Init><Actions/></Init>"
ON_ROAD = GOOD.replace(
    "<RoadNetwork/>", '<RoadNetwork><LogicFile filepath="r.xodr"/></RoadNetwork>'
)
LANE = (
    '<Init><Actions><Private entityRef="Ego"><PrivateAction><TeleportAction><Position>'
    '<LanePosition roadId="{}" laneId="{}" s="5"/></Position></TeleportAction></PrivateAction>'
    "</Private></Actions></Init>"
)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Broken scenarios, and good ones on broken roads, each in a folder of its own."""
    folder = tmp_path_factory.mktemp("broken")
    found = [_put(folder, GOOD.replace(old, new, 1)) for old, new, *_ in MISTAKES]
    found += [_put(folder, GOOD.replace(INIT, TELEPORT.format("A"))), _put(folder, LAUGHS)]
    for road, lane in (("0", "-7"), ("7", "-1")):
        found.append(_put(folder, ON_ROAD.replace(INIT, LANE.format(road, lane)), xodr()))
    found += [_put(folder, ON_ROAD, content) for content, _ in BROKEN_ROADS.values()]
    found.append(_put(folder, ""))
    with found[-1].open("wb") as file:
        file.truncate(LARGE_BYTES)
    return found


def _put(folder: Path, text: str, road: bytes | None = None) -> Path:
    """A scenario file with a catalog of routes, and with a road if it names one."""
    own = folder / str(len(list(folder.iterdir())))
    (own / "routes").mkdir(parents=True)
    (own / "routes" / "r.xosc").write_text(ROUTE)
    if road is not None:
        (own / "r.xodr").write_bytes(road)
    (own / "s.xosc").write_text(text)
    return own / "s.xosc"


def test_each_is_a_line_with_file_and_line_number(files: list[Path]) -> None:
    assert len(files) > 40
    commands = [["validate", "scenario", str(path)] for path in files]
    for path, done in zip(files, run_many("twin", commands, IMPORTS), strict=True):
        assert done.returncode == 2, (path.read_text()[:2000], done.stdout, done.stderr)
        (line,) = done.stderr.splitlines()
        assert re.match(rf"twin: {re.escape(str(path.parent))}/\S+:\d+: ", line), line


def test_a_campaign_of_them_leases_nothing(files: list[Path], tmp_path: Path) -> None:
    """Of every fourth, because a campaign's files are checked within a time."""
    chosen = files[::4]
    campaign, out = tmp_path / "c.yaml", tmp_path / "run"
    matrix = {"scenario.storyboard": list(map(str, chosen))}
    scenario = {"type": "storyboard", "storyboard": "cut-in", "scene": "motorway"}
    campaign.write_text(json.dumps({"campaign": "c", "scenario": scenario, "matrix": matrix}))
    commands = [["validate", str(campaign)], ["run", str(campaign), "--out", str(out)]]
    for done in run_many("conductor", commands):
        err = done.stderr
        assert done.returncode == 2, err
        for path in chosen:
            told = [line for line in err.splitlines() if f"{path.parent}/" in line]
            assert len(told) == 1, (path, told)
            assert re.search(rf"{re.escape(str(path.parent))}/\S+:\d+: ", told[0]), told
    assert not out.exists()
