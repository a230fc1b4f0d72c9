"""Parsers of scenarios that a file has taken over: it says what they answer."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from road_files import xodr

from twin.road.opendrive.reading.answer import NETWORK_BYTES_MAX
from twin.road.opendrive.reading.reader import read_network
from twin.scenario.storyboard.parsing import (
    FAILED,
    NamedFile,
    NamesAnswer,
    ProgramAnswer,
    answer_bytes,
)
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.program import ElementKind, Program, StoryElement
from twin.world.apart.checks import Array, ListOf
from twin.world.apart.parser import Parser

BOX = BodyBox(1.0, 0.0, 0.5, 4.0, 2.0, 1.0)
EGO = StoryboardEntity("Ego", EntityCategory.CAR, BOX, 50.0, 5.0, 9.0, 2.5, 1000.0, True)
TRUE = Program("lie", (EGO,), (StoryElement(ElementKind.STORYBOARD, "", -1),), ())
"""A program that can be played."""
ROADS = read_network(xodr(), "r.xodr")


def order(path: Path) -> str:
    """What the file tells its parser to do."""
    return path.read_text()


def names_answer(path: Path, _question: bytes) -> np.ndarray:
    """Names of files."""
    names = {
        "many names": [NamedFile("road", f"{number}.xodr", 1) for number in range(101)],
        "name": [NamedFile("road", "/etc/passwd\x1b[2J", 1)],
        "no name": [NamedFile("road", "nul\0.xodr", 1)],
        "roads": [NamedFile("road", "r.xodr", 1)],
    }
    if order(path) == "names":
        return np.frombuffer(b"\xc1", np.uint8)
    key = order(path) if "name" in order(path) else "roads"
    return answer_bytes(NamesAnswer((), tuple(names[key])))


def program_answer(path: Path, _question: bytes) -> Sequence[np.ndarray]:
    """A program, and roads."""
    place = str(path.parent / "r.xodr")
    named = replace(ROADS, file=place)
    road = next(iter(named.roads.values()))
    bad = replace(road, geometry=(replace(road.geometry[0], x_m=math.nan),))
    unlinked = replace(road, junction="7")
    box = msgspec.structs.replace(BOX, length_m=math.inf)
    wide = msgspec.structs.replace(EGO, box=box)
    element = StoryElement(ElementKind.STORY, "", 5)
    answers: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "true": lambda: _two(ProgramAnswer((), (), TRUE)),
        "true roads": lambda: _two(ProgramAnswer((), (), TRUE, 0), named),
        "bytes": lambda: [np.frombuffer(b"\xdf\xff\xff\xff\xff", np.uint8), _none()],
        "deep": lambda: [np.frombuffer(b"\x91" * 100_000, np.uint8), _none()],
        "type": lambda: [answer_bytes([[], [], ["Program", 7, [], [], []]]), _none()],
        "no program": lambda: _two(ProgramAnswer((), (), None)),
        "own roads": lambda: _two(
            ProgramAnswer((), (), msgspec.structs.replace(TRUE, network=named))
        ),
        "road number": lambda: _two(ProgramAnswer((), (), TRUE, 3)),
        "other file": lambda: _two(ProgramAnswer((), (), TRUE, 0), ROADS),
        "not finite": lambda: _two(
            ProgramAnswer((), (), TRUE, 0), replace(named, roads={"0": bad})
        ),
        "junction": lambda: _two(
            ProgramAnswer((), (), TRUE, 0), replace(named, roads={"0": unlinked})
        ),
        "no roads": lambda: _two(ProgramAnswer((), (), TRUE, 0), replace(named, roads={})),
        "infinite": lambda: _two(
            ProgramAnswer((), (), msgspec.structs.replace(TRUE, entities=(wide,)))
        ),
        "parent": lambda: _two(
            ProgramAnswer((), (), msgspec.structs.replace(TRUE, elements=(*TRUE.elements, element)))
        ),
        "lines": lambda: _two(ProgramAnswer(("\x1b[2J" + "x" * 5000, "second", *"y" * 5000))),
        "notes": lambda: _two(ProgramAnswer((), ("\x1b[2J\n" + "x" * 5000,), TRUE)),
        "large": lambda: [np.zeros(200 << 20, np.uint8), _none()],
        "flood": lambda: [np.zeros(1 << 30, np.uint8), _none()],
        "one": lambda: [_none()],
        "crash": _crash,
        "leave": lambda: os._exit(0),
        "spin": _spin,
        "sleep": lambda: time.sleep(100_000) or [],
        "recursion": lambda: _recur(0),
    }
    return answers[order(path)]()


def _two(answer: ProgramAnswer, roads: object = None) -> Sequence[np.ndarray]:
    return [answer_bytes(answer), _none() if roads is None else answer_bytes(roads)]


def _none() -> np.ndarray:
    return np.zeros(0, np.uint8)


def _crash() -> Sequence[np.ndarray]:
    os.kill(os.getpid(), signal.SIGSEGV)
    return []


def _spin() -> Sequence[np.ndarray]:
    while True:
        pass


def _recur(depth: int) -> Sequence[np.ndarray]:
    return [*_recur(depth + 1)]


_BYTES = Array("uint8", ("n",))
NAMES = Parser(f"{__name__}:names_answer", _BYTES, FAILED)
PROGRAM = Parser(
    f"{__name__}:program_answer",
    ListOf(Array("uint8", ("n",), side_max=NETWORK_BYTES_MAX), 2, least=2),
    FAILED,
)
