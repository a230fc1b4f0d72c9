"""What the process apart does with scenario files, and what it is asked and answers.

Questions and answers are MessagePack. Every answer has the mistakes of the file beside what came of
it, so that all of them are told. :mod:`twin.scenario.storyboard.apart` asks and checks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from twin.road.opendrive.reading.answer import NETWORK_BYTES_MAX
from twin.road.opendrive.records import RoadNetwork
from twin.scenario.storyboard.compile.compiler import RoadCache, compile_with_notes
from twin.scenario.storyboard.openscenario.element import MISTAKES_MAX
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.openscenario.outline import outline
from twin.scenario.storyboard.openscenario.reader import ScenarioReader, load_document
from twin.scenario.storyboard.openscenario.scenario import Permutation, expand, read_scenario
from twin.scenario.storyboard.openscenario.values import value_of
from twin.scenario.storyboard.program.program import Program
from twin.world.apart.checks import Array, ListOf
from twin.world.apart.parser import Parser

NAMES_MAX = 100
"""Files and folders that one scenario may name."""
PROGRAM_BYTES_MAX = 64 << 20
"""Largest answer of a program, without its roads, and of a table of permutations [bytes]."""
NOTES_MAX = 1000
"""Notes of one scenario that are told."""
_NO_NETWORK = -1

FAILED = "cannot be read as a scenario"
"""Words of a line about a file that came to no answer."""
_BYTES = Array("uint8", ("n",), side_max=PROGRAM_BYTES_MAX)
NAMES = Parser(f"{__name__}:names_answer", _BYTES, FAILED)
PERMUTATIONS = Parser(f"{__name__}:permutations_answer", _BYTES, FAILED)
OUTLINE = Parser(f"{__name__}:outline_answer", _BYTES, FAILED)
PROGRAM = Parser(
    f"{__name__}:program_answer",
    ListOf(Array("uint8", ("n",), side_max=NETWORK_BYTES_MAX), 2, least=2),
    FAILED,
)

Assignment = dict[str, Value]


class NamedFile(msgspec.Struct, frozen=True):
    """A file or folder that a scenario names."""

    kind: Literal["road", "catalogs"]
    text: str
    """As it stands in the file, parameters resolved."""
    line: int


class NamesQuestion(msgspec.Struct, frozen=True):
    """Which files a scenario needs, with any of these values of its parameters."""

    assignments: tuple[Assignment, ...]


class NamesAnswer(msgspec.Struct, frozen=True):
    """Files that a scenario names."""

    mistakes: tuple[str, ...]
    files: tuple[NamedFile, ...] = ()


class PermutationsQuestion(msgspec.Struct, frozen=True):
    """Permutations of a distribution file of the scenario."""

    distribution: str


class PermutationsAnswer(msgspec.Struct, frozen=True):
    """Values of all permutations."""

    mistakes: tuple[str, ...]
    assignments: tuple[Assignment, ...] = ()


class OutlineQuestion(msgspec.Struct, frozen=True):
    """A scenario in words."""

    values: Assignment
    permutations: int


class OutlineAnswer(msgspec.Struct, frozen=True):
    """Lines of an outline."""

    mistakes: tuple[str, ...]
    lines: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    """What has no effect when it is played."""


class ProgramQuestion(msgspec.Struct, frozen=True):
    """The program of a scenario with these values of its parameters."""

    values: Assignment


class ProgramAnswer(msgspec.Struct, frozen=True):
    """A program without its roads."""

    mistakes: tuple[str, ...]
    notes: tuple[str, ...] = ()
    program: Program | None = None
    network: int = _NO_NETWORK
    """Number of its roads among those that were answered so far, with this answer; -1: none."""


def names_answer(path: Path, question: bytes) -> np.ndarray:
    """Answer a :class:`NamesQuestion`."""
    asked = msgspec.msgpack.decode(question, type=NamesQuestion)
    files: dict[NamedFile, None] = {}

    def name_all() -> NamesAnswer:
        document = load_document(path)
        logic = document.root.find("RoadNetwork/LogicFile")
        for directory in document.root.iterfind("CatalogLocations/*/Directory"):
            text = str(value_of(directory.get("path", ""), "s", {}, document.minor))
            files[NamedFile("catalogs", text, directory.sourceline)] = None
        if document.kind != "ScenarioFile" or logic is None:
            return NamesAnswer((), tuple(files)[: NAMES_MAX + 1])
        varied = "$" in logic.get("filepath", "")
        for part in list(document.root):
            if part.tag not in ("FileHeader", "ParameterDeclarations", "RoadNetwork"):
                document.root.remove(part)  # names nothing, and takes the time
        for values in asked.assignments if varied else asked.assignments[:1]:
            # What is wrong with it is told with its program, where all its files are there.
            root = ScenarioReader().read(document, values)
            for element in root.walk():
                if element.name == "LogicFile" and "filepath" in element.values:
                    text = str(element.values["filepath"])
                    files[NamedFile("road", text, element.line)] = None
        return NamesAnswer((), tuple(files)[: NAMES_MAX + 1])

    return _answer(NamesAnswer, name_all)


def permutations_answer(path: Path, question: bytes) -> np.ndarray:
    """Answer a :class:`PermutationsQuestion`."""
    asked = msgspec.msgpack.decode(question, type=PermutationsQuestion)

    def expand_all() -> PermutationsAnswer:
        table = expand(path, Path(asked.distribution))
        return PermutationsAnswer((), tuple(dict(row.values) for row in table))

    return _answer(PermutationsAnswer, expand_all)


def outline_answer(path: Path, question: bytes) -> np.ndarray:
    """Answer an :class:`OutlineQuestion`."""
    asked = msgspec.msgpack.decode(question, type=OutlineQuestion)

    def tell() -> OutlineAnswer:
        rows = [Permutation(0, asked.values, path)] * asked.permutations
        effective = read_scenario(path, asked.values)
        lines = tuple(outline(effective, rows))
        if effective.kind != "ScenarioFile":
            return OutlineAnswer((), lines)
        return OutlineAnswer((), lines, compile_with_notes(effective).notes[:NOTES_MAX])

    return _answer(OutlineAnswer, tell)


class ProgramParser:
    """Answers a :class:`ProgramQuestion` after the other; roads are read and answered once."""

    def __init__(self) -> None:
        """Nothing has been read."""
        self._roads: RoadCache = {}
        self._answered: list[RoadNetwork] = []

    def __call__(self, path: Path, question: bytes) -> Sequence[np.ndarray]:
        """The :class:`ProgramAnswer`, and the roads if they are new; uint8 [n] each."""
        asked = msgspec.msgpack.decode(question, type=ProgramQuestion)
        networks: list[RoadNetwork] = []

        def compile_one() -> ProgramAnswer:
            compiled = compile_with_notes(read_scenario(path, asked.values), self._roads)
            network, number = compiled.program.network, _NO_NETWORK
            if network is not None:
                number = self._number(network)
                if number == len(self._answered):
                    networks.append(network)
            program = msgspec.structs.replace(compiled.program, network=None)
            return ProgramAnswer((), compiled.notes[:NOTES_MAX], program, number)

        answer = _answer(ProgramAnswer, compile_one)
        self._answered += networks
        return [answer, answer_bytes(networks[0]) if networks else np.zeros(0, np.uint8)]

    def _number(self, network: RoadNetwork) -> int:
        for number, other in enumerate(self._answered):
            if other is network:
                return number
        return len(self._answered)


program_answer = ProgramParser()
"""The parser of a process; it has one."""


def _answer(kind: Callable[[tuple[str, ...]], Any], make: Callable[[], Any]) -> np.ndarray:
    """An answer as bytes; mistakes of the file if there are any."""
    try:
        answer = make()
    except ValueError as error:
        answer = kind(tuple(str(error).splitlines()[: MISTAKES_MAX + 1]))
    data = answer_bytes(answer)
    if len(data) > PROGRAM_BYTES_MAX:
        words = f"it takes {len(data)} bytes when it is read, at most {PROGRAM_BYTES_MAX} are taken"
        return answer_bytes(kind((words,)))
    return data


def answer_bytes(value: Any) -> np.ndarray:
    """An answer as MessagePack, uint8 [n]."""
    return np.frombuffer(msgspec.msgpack.encode(value, enc_hook=_plain), np.uint8)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not answered")
