"""twin.scenario.storyboard.apart: files that others wrote are a program or lines, never harm."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

import hostile_scenarios
import lying_parsers
import road_files
from hostile_scenarios import ENTITY, HEADER, HOSTILE, acting, catalogs_in, parameter, scenario
from road_files import xodr
from typer.testing import CliRunner

from twin.base.errors import UsageError
from twin.play.permutations import play_file
from twin.road.opendrive.apart import network_apart, notes_of_reading
from twin.road.opendrive.reading.load import load_network
from twin.scenario.storyboard import apart
from twin.scenario.storyboard.apart import (
    outline_apart,
    permutations_apart,
    program_apart,
    programs_apart,
)
from twin.scenario.storyboard.compile.compiler import compile_with_notes
from twin.scenario.storyboard.openscenario.element import MISTAKES_MAX
from twin.scenario.storyboard.openscenario.outline import outline
from twin.scenario.storyboard.openscenario.scenario import expand, read_scenario
from twin.validate.command import app
from twin.world.apart import reading

LARGE = ("large", "many_entities", "catalog_circle")
QUICK = (
    "outside",
    "power",
    "nurbs",
    "road_link",
    "road_pipe",
    "catalog_pipe",
    "catalogs_of_system",
)
QUICK_LIES = ("bytes", "road number", "other file", "infinite", "crash")
"""Each takes a process or two; the others are not in the quick lane."""


def _lanes(names: Iterable[str], quick: Sequence[str]) -> list[Any]:
    marks = {name: () if name in quick else pytest.mark.slow for name in names}
    return [pytest.param(name, marks=mark, id=name) for name, mark in marks.items()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario with a catalog and a road in folders beside its own."""
    for name in ("scenarios", "catalogs", "roads", "empty"):
        (tmp_path / name).mkdir()
    (tmp_path / "roads" / "r.xodr").write_bytes(xodr())
    lane = '<LanePosition roadId="0" laneId="-1" s="{}"/>'
    points = "".join(
        f'<Waypoint routeStrategy="shortest"><Position>{lane.format(s)}</Position></Waypoint>'
        for s in (10, 90)
    )
    text = f'<Catalog name="Routes"><Route name="R" closed="false">{points}</Route></Catalog>'
    route = f"<OpenSCENARIO>\n{HEADER}\n{text}</OpenSCENARIO>"
    (tmp_path / "catalogs" / "r.xosc").write_text(route)
    reference = '<CatalogReference catalogName="Routes" entryName="R"/>'
    action = f"<RoutingAction><AssignRouteAction>{reference}</AssignRouteAction></RoutingAction>"
    places = catalogs_in("../catalogs") + (
        '<ControllerCatalog><Directory path="../gone/../empty"/></ControllerCatalog>'
    )
    road = '<ParameterDeclaration name="r" parameterType="string" value="../roads/r.xodr"/>'
    content = scenario(
        parameters=parameter("1") + road, catalogs=places, road="$r", init=acting(action)
    )
    (tmp_path / "scenarios" / "s.xosc").write_text(content)
    return tmp_path


def refused(path: Path, values: Mapping[str, object] | None = None) -> list[str]:
    """The lines about a file."""
    with pytest.raises(ValueError) as caught:
        program_apart(path, values)  # type: ignore[arg-type]
    lines = str(caught.value).split("\n")
    assert all(line.isprintable() and 0 < len(line) <= 4000 for line in lines)
    return lines


@pytest.mark.parametrize("name", _lanes([n for n in HOSTILE if n not in LARGE], QUICK))
def test_a_hostile_file_is_one_line(tmp_path: Path, name: str) -> None:
    (line, *more) = refused(HOSTILE[name](tmp_path))
    assert line.startswith(f"{tmp_path}/")
    assert "its reader ended" not in line
    assert "not done" not in line
    assert "secret" not in line
    assert len(more) <= 1, "a mistake is told as a parameter, and where it stands"


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_a_large_hostile_file_is_one_line(tmp_path: Path, name: str) -> None:
    (line,) = refused(HOSTILE[name](tmp_path))
    assert "not done" not in line
    assert "at most" in line or "more than" in line


def test_the_command_says_it_too(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["scenario", str(HOSTILE["road_link"](tmp_path))])
    assert isinstance(result.exception, UsageError)
    assert result.exception.exit_code == 2
    with pytest.raises(ValueError, match="links included"):
        play_file(tmp_path / "s.xosc", None, None, step_s=0.01, every=1, until_s=1.0)


def test_what_comes_back_is_what_is_read_here(folder: Path) -> None:
    path = folder / "scenarios" / "s.xosc"
    here = compile_with_notes(read_scenario(path))
    assert here.program.network is not None
    assert here.program.routes
    (there,) = programs_apart(path, [{}])
    assert there == here
    (row,) = expand(path)
    lines, notes = outline_apart(path, {}, 1)
    assert lines == outline(row.scenario(), [row])
    assert tuple(notes) == here.notes
    road = folder / "roads" / "r.xodr"
    assert network_apart(road) == load_network(road)


def test_files_are_named_as_the_user_named_them(folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder / "scenarios")
    (folder / "link").symlink_to("scenarios")
    network = program_apart(folder / "link" / "s.xosc").network
    assert network is not None
    (folder / "roads" / "r.xodr").unlink()
    (line, *_) = refused(Path("s.xosc"))
    assert line.startswith(f"s.xosc:5: the road file {folder}/roads/r.xodr is missing")
    (line, *_) = refused(folder / "link" / "s.xosc")
    assert line.startswith(f"{folder}/link/s.xosc:5: ")


def test_programs_of_one_file_share_roads_and_processes(folder: Path, monkeypatch) -> None:
    path = folder / "scenarios" / "s.xosc"
    (folder / "roads" / "other.xodr").write_bytes(xodr(road_files.road(120.0)))
    rows = [{"r": "../roads/r.xodr"}, {"r": "../roads/other.xodr"}, {"x": 3.0}]
    monkeypatch.setattr(apart, "PROGRAMS_MAX", 2)
    first, second, third = (compiled.program for compiled in programs_apart(path, rows))
    assert first.network is third.network, "also of two processes"
    assert second.network is not None
    assert second.network.file == f"{folder}/roads/other.xodr"
    assert third.variables != first.variables


def _distribution(folder: Path, inner: str) -> Path:
    path = folder / "d.xosc"
    head = f"<OpenSCENARIO>\n{HEADER}\n<ParameterValueDistribution>"
    path.write_text(
        f'{head}<ScenarioFile filepath="scenarios/s.xosc"/>\n<Deterministic>{inner}</Deterministic>'
        "</ParameterValueDistribution></OpenSCENARIO>"
    )
    return path


def _values(name: str, values: str) -> str:
    return (
        f'<DeterministicSingleParameterDistribution parameterName="{name}">{values}'
        "</DeterministicSingleParameterDistribution>"
    )


def test_permutations_come_back(folder: Path) -> None:
    path = folder / "scenarios" / "s.xosc"
    ten = "".join(f'<Element value="{number}"/>' for number in range(3))
    file = _distribution(folder, _values("x", f"<DistributionSet>{ten}</DistributionSet>"))
    assert permutations_apart(path, file) == [dict(row.values) for row in expand(path, file)]
    assert permutations_apart(path) == [{}]


def test_a_distribution_of_a_billion_is_one_line(folder: Path) -> None:
    path = folder / "scenarios" / "s.xosc"
    ten = "".join(f'<Element value="{number}"/>' for number in range(10))
    sets = [_values(f"p{n}", f"<DistributionSet>{ten}</DistributionSet>") for n in range(9)]
    with pytest.raises(ValueError, match=r"d\.xosc:4: .*more than 100000 permutations"):
        permutations_apart(path, _distribution(folder, "".join(sets)))
    steps = '<DistributionRange stepWidth="1e-9"><Range lowerLimit="0" upperLimit="1"/>'
    file = _distribution(folder, _values("x", f"{steps}</DistributionRange>"))
    with pytest.raises(ValueError, match=r"d\.xosc:4: .*more than 100000 steps"):
        permutations_apart(path, file)


def test_a_distribution_is_a_regular_file(folder: Path) -> None:
    path = folder / "scenarios" / "s.xosc"
    for other, words in (("/dev/zero", "a device"), (str(folder), "Is a directory")):
        with pytest.raises(ValueError, match=words):
            permutations_apart(path, Path(other))


def test_all_mistakes_come_back_up_to_a_limit(tmp_path: Path) -> None:
    path = tmp_path / "s.xosc"
    path.write_text(scenario(entities=ENTITY + "<Rood/>\n" * 200))
    lines = refused(path)
    assert len(lines) == MISTAKES_MAX + 1
    assert lines[-1] == "and more; correct these first"
    assert lines[0].startswith(f"{path}:6: ")


def test_values_of_parameters_that_are_none(folder: Path) -> None:
    lines = refused(folder / "scenarios" / "s.xosc", {"y": 1.0})
    assert "parameter y is assigned but not declared" in lines[0]


def test_a_road_file_with_a_bomb_is_one_line(tmp_path: Path) -> None:
    HOSTILE["road_bomb"](tmp_path)
    with pytest.raises(ValueError, match=r"r\.xodr:1: ") as caught:
        network_apart(tmp_path / "r.xodr")
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(ValueError, match="a device"):
        network_apart(Path("/dev/zero"))


LIES = {
    "bytes": "its reader answered ",
    "deep": "its reader answered ",
    "type": "its reader answered ",
    "no program": "its reader answered no program",
    "own roads": "its reader answered no program",
    "road number": "its reader answered roads that are not there",
    "other file": "its reader answered roads of a file that is not its",
    "not finite": "a number is not between",
    "junction": "a junction that does not exist",
    "no roads": "0 roads",
    "infinite": "entity 0: length_m is inf",
    "parent": "element 1: it does not stand behind its parent 5",
    "large": "209715200 bytes",
    "flood": "more bytes than may be",
    "one": "is no list of 2 to 2",
    "crash": "its reader ended (killed by SIGSEGV)",
    "leave": "its reader ended (exit code 0)",
    "spin": "not done after 1 s of processor time",
    "sleep": "not done in time",
    "recursion": "RecursionError",
    "names": "its reader answered ",
    "name": "it lies in a folder of the system",
    "no name": "null byte",
    "many names": "it names more than 100 files",
}


@pytest.fixture
def taken_over(tmp_path: Path, monkeypatch):
    """Lets a file say what its parsers answer."""
    tests = [Path(module.__file__) for module in (lying_parsers, road_files, hostile_scenarios)]
    monkeypatch.setattr(apart, "_PARSING", "lying_parsers")
    seeing = functools.partial(reading.read_apart, readable=tests)
    monkeypatch.setattr(apart, "read_apart", seeing)
    (tmp_path / "r.xodr").write_bytes(xodr())

    def write(order: str) -> Path:
        path = tmp_path / "s.xosc"
        path.write_text(order)
        return path

    return write


@pytest.mark.parametrize("lie", _lanes(LIES, QUICK_LIES))
def test_a_lie_is_one_line(taken_over, monkeypatch, lie: str) -> None:
    if lie == "spin":
        monkeypatch.setattr(apart, "CPU_S", 1)
    if lie == "sleep":
        monkeypatch.setattr(apart, "WALL_S", 8.0)
    (line,) = refused(taken_over(lie))
    assert LIES[lie] in line


def test_mistakes_and_notes_of_a_liar_are_escaped(taken_over) -> None:
    lines = refused(taken_over("lines"))
    assert lines[0].startswith("\\x1b[2Jxxx")
    assert lines[1] == "second"
    assert len(lines) <= MISTAKES_MAX + 1
    (compiled,) = programs_apart(taken_over("notes"), [{}])
    assert compiled.notes[0].startswith("\\x1b[2J\\nxxx")
    assert len(compiled.notes[0]) <= 4000


def test_without_a_sandbox_it_is_the_same(folder: Path, monkeypatch) -> None:
    path = folder / "scenarios" / "s.xosc"
    with_sandbox = program_apart(path)
    monkeypatch.setattr(reading, "why_not", lambda: "none here")
    assert program_apart(path) == with_sandbox
    (line,) = refused(HOSTILE["road_link"](folder))
    assert "links included" in line
    words = "scenario and road files are read without a sandbox: none here"
    assert notes_of_reading() == (words,)


def test_a_true_answer_is_taken(taken_over) -> None:
    """Lies are refused for what is in them, not for their form."""
    assert program_apart(taken_over("true")) == lying_parsers.TRUE
    network = program_apart(taken_over("true roads")).network
    assert network is not None
    assert network.roads == lying_parsers.ROADS.roads
