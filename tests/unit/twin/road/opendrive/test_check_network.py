"""twin.road.opendrive.check_network: what the types of a road network cannot say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from road_files import crossing
from road_furniture import furniture_file, repeat, road_object, with_furniture
from road_networks import junction_file, shapes_file, turned_file

from twin.road.opendrive.apart import decode_network, network_apart
from twin.road.opendrive.check_network import MISTAKES_MAX, network_mistakes
from twin.road.opendrive.furniture import ObjectOutline, OutlineCorner
from twin.road.opendrive.reading import answer
from twin.road.opendrive.reading.answer import network_bytes
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.reading.read_furniture import CORNERS_MAX
from twin.road.opendrive.reading.reader import read_network
from twin.road.opendrive.records import (
    Cubic,
    Lane,
    LaneMaterial,
    RoadLink,
    RoadNetwork,
    RoadRecord,
)

NETWORK = read_network(crossing(), "r.xodr")
FIRST = NETWORK.roads["0"]
PIECE = FIRST.geometry[0]
SECTION = FIRST.sections[0]


def road(**changes: object) -> RoadNetwork:
    """The network with its first road changed."""
    changed: RoadRecord = replace(FIRST, **changes)  # type: ignore[arg-type]
    return replace(NETWORK, roads={**NETWORK.roads, "0": changed})


def piece(**changes: object) -> RoadNetwork:
    """The network with the first piece of its first road changed."""
    return road(geometry=(replace(PIECE, **changes),))  # type: ignore[arg-type]


def lane(**changes: object) -> RoadNetwork:
    """The network with a lane of its first road changed."""
    changed: Lane = replace(SECTION.left[0], **changes)  # type: ignore[arg-type]
    return road(sections=(replace(SECTION, left=(changed,)),))


def connection(**changes: object) -> RoadNetwork:
    """The network with a connection of its junction changed."""
    junction = NETWORK.junctions["9"]
    changed = replace(junction.connections[0], **changes)  # type: ignore[arg-type]
    return replace(NETWORK, junctions={"9": replace(junction, connections=(changed,))})


BESIDE = read_network(
    with_furniture(road_object("pole", 5, 5, repeat(5, 20, 4)), length=FIRST.length_m), "r.xodr"
).roads["0"]
CORNER = OutlineCorner("local", (0.0, 0.0, 0.0), 1.0)


def thing(**changes: object) -> RoadNetwork:
    """The network with an object beside its first road."""
    return road(objects=(replace(BESIDE.objects[0], **changes),))  # type: ignore[arg-type]


def row(**changes: object) -> RoadNetwork:
    """The same with a row of objects."""
    changed = replace(BESIDE.objects[0].repeats[0], **changes)  # type: ignore[arg-type]
    return thing(repeats=(changed,))


CUBIC = Cubic(0.0, 3.5, 0.0, 0.0, 0.0)
WRONG: dict[str, tuple[Callable[[], RoadNetwork], str]] = {
    "no roads": (lambda: replace(NETWORK, roads={}), "0 roads"),
    "called": (lambda: road(id="7"), "road 0 is called 7 elsewhere"),
    "length": (lambda: road(length_m=-1.0), "a length that no road has"),
    "long": (lambda: road(length_m=2e6), "a length that no road has"),
    "nan": (lambda: piece(x_m=math.nan), "road 0: a number is not between"),
    "far": (lambda: piece(y_m=1e10), "road 0: a number is not between"),
    "deep nan": (lambda: lane(widths=(replace(CUBIC, d=math.inf),)), "a number is not between"),
    "large id": (lambda: lane(successors=(10**12,)), "a number is not between"),
    "no geometry": (lambda: road(geometry=()), "it has no geometry"),
    "no lanes": (lambda: road(sections=()), "it has no geometry, no lanes"),
    "late": (lambda: piece(start_m=5.0), "do not follow one another"),
    "twice": (lambda: road(geometry=(PIECE, PIECE)), "do not follow one another"),
    "flat": (lambda: piece(length_m=0.0), "has no length"),
    "short": (lambda: piece(length_m=20.0), "its reference line is not as long as it"),
    "range": (lambda: piece(p_max=0.0), "has no length"),
    "tight": (lambda: piece(curvature=(0.0, 101.0)), "turns more than can be read"),
    "turns": (lambda: piece(curvature=(0.0, -21.0)), "turns more than can be read"),
    "tilted": (
        lambda: road(superelevation=(Cubic(0.0, 0.0, 0.1, 0.0, 0.0),)),
        "it tilts more than can be read",
    ),
    "profile": (
        lambda: road(elevation=(replace(CUBIC, start_m=5.0), CUBIC)),
        "its elevation do not ascend",
    ),
    "section": (
        lambda: road(sections=(replace(SECTION, start_m=1.0),)),
        "its lane sections do not follow one another",
    ),
    "sections": (lambda: road(sections=(SECTION, SECTION)), "do not follow one another"),
    "lane id": (lambda: lane(id=2), "lane 2 stands where lane 1 belongs"),
    "no width": (lambda: lane(widths=(), borders=()), "lane 1 has neither width nor border"),
    "late width": (lambda: lane(widths=(replace(CUBIC, start_m=1.0),)), "does not begin with it"),
    "narrow": (lambda: lane(widths=(replace(CUBIC, a=-1.0),)), "less than 0 m wide"),
    "lane leads": (
        lambda: road(
            sections=lane(successors=(7,)).roads["0"].sections,
            successor=RoadLink("road", "2", "start", 1),
        ),
        "lane 1 leads to lane 7, which does not exist there",
    ),
    "link": (
        lambda: road(successor=RoadLink("road", "8", "start", 1)),
        "it is linked to road 8, which does not exist",
    ),
    "no end": (
        lambda: road(successor=RoadLink("road", "1", None, 1)),
        "it is linked to no end of road 1",
    ),
    "object": (lambda: thing(s_m=900.0), "an object or signal does not stand along it"),
    "row": (lambda: row(s_m=90.0), "an object or signal does not stand along it"),
    "row size": (lambda: row(size_m=((0.0, 1.0), (0.0, -1.0), (1.0, 1.0))), "smaller than nothing"),
    "radius": (lambda: thing(radius_m=-0.1), "smaller than nothing"),
    "row nan": (lambda: row(t_m=(0.0, math.nan)), "a number is not between"),
    "many": (lambda: row(distance_m=1e-5), "a row has more objects than are read"),
    "one more": (lambda: row(distance_m=0.002), "a row has more objects than are read"),
    "endless": (lambda: row(distance_m=5e-324), "a row has more objects than are read"),
    "backwards": (lambda: row(distance_m=-1.0), "smaller than nothing"),
    "corners": (
        lambda: thing(outlines=(ObjectOutline((CORNER,) * (CORNERS_MAX + 1), True),)),
        "an outline has more corners than are read",
    ),
    "friction": (
        lambda: lane(materials=(LaneMaterial(0.0, 5.0, "", 0.0),)),
        "lane 1 has a friction that no road has",
    ),
    "junction": (lambda: road(junction="8"), "a junction that does not exist"),
    "connection": (
        lambda: connection(incoming_road="8"),
        "junction 9: it connects road 8, which does not exist",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_found(name: str) -> None:
    make, words = WRONG[name]
    lines = network_mistakes(make())
    assert any(words in line for line in lines), lines
    assert all(line.isprintable() for line in lines)


def test_mistakes_have_a_limit() -> None:
    many = {str(number): replace(FIRST, id="x") for number in range(2 * MISTAKES_MAX)}
    assert len(network_mistakes(replace(NETWORK, roads=many))) == MISTAKES_MAX


@pytest.mark.parametrize(
    "make", [crossing, junction_file, shapes_file, turned_file, furniture_file]
)
def test_what_is_read_has_none(make: Callable[[], bytes], tmp_path: Path) -> None:
    path = tmp_path / "r.xodr"
    path.write_bytes(make())
    network = load_network(path)
    assert network_mistakes(network) == []
    assert decode_network(network_bytes(path), path) == network
    assert network_apart(path) == network


def test_an_answer_that_is_none_is_one_line() -> None:
    for data in (b"", b"\xc1", b"\x91" * 100_000, msgspec.msgpack.encode({"file": "x"})):
        with pytest.raises(ValueError, match=r"^r\.xodr: cannot be read as roads") as caught:
            decode_network(np.frombuffer(data, np.uint8), Path("r.xodr"))
        assert str(caught.value).isprintable()


def test_an_answer_that_is_too_large_is_refused(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "r.xodr"
    path.write_bytes(crossing())
    monkeypatch.setattr(answer, "NETWORK_BYTES_MAX", 1000)
    with pytest.raises(ValueError, match=r"at most 1000 are taken; use a part"):
        network_bytes(path)
