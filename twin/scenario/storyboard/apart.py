"""Scenario files of others, read and compiled by processes apart (:mod:`twin.world.apart`).

A scenario names further files: catalog folders and a road file. Who may name what is decided here,
not in the process that parses:

1. A first process sees the scenario alone and answers the names in it.
2. Named are seen then: of a catalog folder the files that end in ``.xosc``, and a road file that
   ends in ``.xodr``, each by itself, if it is a regular file. A link counts as what it leads to. A
   folder itself is empty for the process but for them, and what lies in ``/etc``, ``/proc``,
   ``/sys`` or ``/dev`` is refused.
3. A second process sees the scenario and these files, and answers programs and road networks.

So a file may make another scenario or road file be read that the user may read, and nothing else;
what comes back is a program, or lines about mistakes. Answers are checked by their types, then by
:mod:`twin.scenario.storyboard.check_program` and :mod:`twin.road.opendrive.check_network`.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from schemas.escape import ESCAPED_CHARS_MAX, escape
from schemas.files.regular_file import open_regular
from twin.road.opendrive.apart import decode_network
from twin.road.opendrive.reading.answer import NETWORK_BYTES_MAX
from twin.road.opendrive.records import RoadNetwork
from twin.scenario.storyboard.check_program import program_mistakes
from twin.scenario.storyboard.compile.compiler import CompiledScenario
from twin.scenario.storyboard.openscenario.catalogs import CATALOG_FILES_MAX
from twin.scenario.storyboard.openscenario.element import MISTAKES_MAX
from twin.scenario.storyboard.openscenario.expression import Value
from twin.scenario.storyboard.openscenario.reader import FILE_BYTES_MAX
from twin.scenario.storyboard.openscenario.references import named_path
from twin.scenario.storyboard.parsing import (
    FAILED,
    NAMES_MAX,
    NOTES_MAX,
    PROGRAM_BYTES_MAX,
    Assignment,
    NamedFile,
    NamesAnswer,
    NamesQuestion,
    OutlineAnswer,
    OutlineQuestion,
    PermutationsAnswer,
    PermutationsQuestion,
    ProgramAnswer,
    ProgramQuestion,
)
from twin.scenario.storyboard.program.program import Program
from twin.world.apart.reading import AskedFile, path_apart, read_apart

MEMORY_BYTES_MAX = 8 << 30
"""Address space of a process that parses scenarios [bytes]."""
CPU_S = 60
"""Processor time that it may take for one scenario [s]."""
PROGRAM_CPU_S = 10
"""The same for each further permutation [s]."""
WALL_S = 1200
"""Time until it is given up, however busy the machine is [s]."""
PROGRAMS_MAX = 256
"""Permutations that one process compiles; then the next begins."""
NAMED_FILES_MAX = 2000
"""Files that the process sees because a scenario names them, or the folder they are in."""
OUTLINE_CHARS_MAX = 10_000
"""Longest line of an outline [characters]."""
FOLDER_ENTRIES_MAX = 100_000
"""Entries of a catalog folder that are looked through."""

_PARSING = "twin.scenario.storyboard.parsing"
_CLOSED = tuple(map(Path, ("/etc", "/proc", "/sys", "/dev")))
_ENDINGS = {"road": ".xodr", "catalogs": ".xosc"}

Answer = TypeVar("Answer", NamesAnswer, PermutationsAnswer, OutlineAnswer, ProgramAnswer)


def permutations_apart(path: Path, distribution: Path | None = None) -> list[Assignment]:
    """Parameter values of all permutations of a distribution file; None: one without values.

    Raises:
        ValueError: a line with file and line number per mistake, escaped.
        InfrastructureError: the process did not start.
    """
    if distribution is None:
        return [{}]
    _check_regular(distribution)
    place = path_apart(distribution)
    question = PermutationsQuestion(str(place))
    data = _ask("PERMUTATIONS", path, question, readable=[place])
    answer = _decoded(data, PermutationsAnswer, path, distribution)
    return list(answer.assignments)


def outline_apart(
    path: Path, values: Mapping[str, Value], permutations: int
) -> tuple[list[str], list[str]]:
    """What a file does in words, and notes on what of it has no effect when it is played; escaped.

    Both as :mod:`twin.scenario.storyboard.openscenario.outline` and the compiler give them.

    Args:
        path: a scenario, catalog or distribution file.
        values: of its parameters.
        permutations: how many there are.

    Raises:
        ValueError, InfrastructureError: as :func:`permutations_apart`.
    """
    files, folders = _named_files(path, [values])
    question = OutlineQuestion(dict(values), permutations)
    data = _ask("OUTLINE", path, question, readable=files, folders=folders)
    answer = _decoded(data, OutlineAnswer, path)
    lines = [_as_given(line, path, chars_max=OUTLINE_CHARS_MAX) for line in answer.lines]
    return lines, [_as_given(line, path) for line in answer.notes[:NOTES_MAX]]


def program_apart(path: Path, values: Mapping[str, Value] | None = None) -> Program:
    """The program of a scenario file; raises as :func:`permutations_apart`."""
    (compiled,) = programs_apart(path, [values or {}])
    return compiled.program


def programs_apart(
    path: Path, assignments: Sequence[Mapping[str, Value]]
) -> Iterator[CompiledScenario]:
    """Programs of a scenario file, one for each assignment of values to its parameters, in order.

    A process compiles up to :data:`PROGRAMS_MAX` of them. Programs on the same roads share them.

    Raises:
        ValueError, InfrastructureError: as :func:`permutations_apart`.
    """
    roads: dict[str, RoadNetwork] = {}
    for first in range(0, len(assignments), PROGRAMS_MAX):
        yield from _compiled(path, assignments[first : first + PROGRAMS_MAX], roads)


def _compiled(
    path: Path, assignments: Sequence[Mapping[str, Value]], roads: dict[str, RoadNetwork]
) -> list[CompiledScenario]:
    """What one process compiles; ``roads`` are those of all processes, by file."""
    files, folders = _named_files(path, assignments)
    asks = [
        AskedFile(
            f"{_PARSING}:PROGRAM",
            path,
            files if number == 0 else (),
            msgspec.msgpack.encode(ProgramQuestion(dict(values))),
        )
        for number, values in enumerate(assignments)
    ]
    answers = read_apart(
        asks,
        folders=folders,
        cpu_s=CPU_S + PROGRAM_CPU_S * (len(asks) - 1),
        wall_s=WALL_S,
        memory_bytes=MEMORY_BYTES_MAX,
        answer_bytes=(PROGRAM_BYTES_MAX + NETWORK_BYTES_MAX) * len(asks),
    )
    networks: list[RoadNetwork] = []
    compiled = []
    with closing(answers):
        for program_data, network_data in answers:
            if len(program_data) > PROGRAM_BYTES_MAX:
                raise _wrong(path, f"{len(program_data)} bytes")
            if len(network_data):
                network = decode_network(network_data, path)
                if Path(network.file) not in files or len(networks) > len(files):
                    raise _wrong(path, "roads of a file that is not its")
                networks.append(_shared(network, path, roads))
            compiled.append(answered_program(program_data, networks, path))
    return compiled


def _shared(network: RoadNetwork, path: Path, roads: dict[str, RoadNetwork]) -> RoadNetwork:
    """The roads of a file: the same for all programs, or who keeps them by file would mix them."""
    notes = tuple(_as_given(note, path) for note in network.notes)
    network = replace(network, file=_as_given(network.file, path), notes=notes)
    known = roads.setdefault(network.file, network)
    if known != network:
        raise _wrong(path, f"two different networks of {network.file}")
    return known


def answered_program(
    data: np.ndarray, networks: Sequence[RoadNetwork], path: Path
) -> CompiledScenario:
    """The program that a process has answered.

    Args:
        data: its answer, uint8 [n].
        networks: those that were answered so far.
        path: the scenario, for messages.

    Raises:
        ValueError: mistakes of the scenario, or the answer is no program.
    """
    answer = _decoded(data, ProgramAnswer, path)
    if answer.program is None or answer.program.network is not None:
        raise _wrong(path, "no program")
    if not -1 <= answer.network < len(networks):
        raise _wrong(path, "roads that are not there")
    network = networks[answer.network] if answer.network >= 0 else None
    program = msgspec.structs.replace(answer.program, network=network)
    mistakes = program_mistakes(program)
    if mistakes:
        raise _wrong(path, f"a program that is none: {mistakes[0]}")
    notes = answer.notes[:NOTES_MAX]
    return CompiledScenario(program, tuple(_as_given(note, path) for note in notes))


def _ask(
    parser: str,
    path: Path,
    question: msgspec.Struct,
    *,
    readable: Sequence[Path] = (),
    folders: Sequence[Path] = (),
) -> np.ndarray:
    """The answer of one process to one question, uint8 [n]."""
    ask = AskedFile(f"{_PARSING}:{parser}", path, readable, msgspec.msgpack.encode(question))
    answers = read_apart(
        [ask],
        folders=folders,
        cpu_s=CPU_S,
        wall_s=WALL_S,
        memory_bytes=MEMORY_BYTES_MAX,
        answer_bytes=PROGRAM_BYTES_MAX + (1 << 20),
    )
    with closing(answers):
        data: np.ndarray = next(answers)
        return data


def _decoded(data: np.ndarray, kind: type[Answer], *paths: Path) -> Answer:
    """An answer; its mistakes are raised."""
    try:
        answer = msgspec.msgpack.decode(data.data, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise _wrong(paths[0], str(error)[:200]) from None
    if answer.mistakes:
        lines = answer.mistakes[: MISTAKES_MAX + 1]
        raise ValueError("\n".join(_as_given(line, *paths) for line in lines))
    return answer


def _wrong(path: Path, words: str) -> ValueError:
    return ValueError(escape(f"{path}: {FAILED}: its reader answered {words}"))


def _as_given(line: str, *paths: Path, chars_max: int = ESCAPED_CHARS_MAX) -> str:
    """A line of the process, escaped, its files named as the user named them."""
    for path in paths:
        place = path_apart(path)
        folder = "" if path.parent == Path() else f"{path.parent}/"
        line = line.replace(str(place), str(path)).replace(f"{place.parent}/", folder)
    return escape(line, chars_max)


def _named_files(
    path: Path, assignments: Sequence[Mapping[str, Value]]
) -> tuple[list[Path], list[Path]]:
    """Files that the process sees beside the scenario, and folders that are there for it."""
    _check_regular(path)
    question = NamesQuestion(tuple(dict(values) for values in assignments))
    answer = _decoded(_ask("NAMES", path, question), NamesAnswer, path)
    if len(answer.files) > NAMES_MAX:
        raise ValueError(escape(f"{path}:1: it names more than {NAMES_MAX} files and folders"))
    view = _View(path)
    for named in answer.files:
        view.add(named)
    if len(view.files) > NAMED_FILES_MAX:
        words = f"its catalog folders have more than {NAMED_FILES_MAX} files together"
        view.mistakes.append(escape(f"{path}:1: {words}"))
    if view.mistakes:
        raise ValueError("\n".join(dict.fromkeys(view.mistakes)))
    return list(view.files), list(view.folders)


def _check_regular(path: Path) -> None:
    """Refuse what no process has to look at; a folder would be seen by it as a whole."""
    try:
        open_regular(path, FILE_BYTES_MAX).close()
    except OSError as error:
        raise ValueError(escape(f"{path}:1: {error.strerror or error}")) from None
    except ValueError as error:  # a path with a NUL
        raise ValueError(f"{str(path)!r}:1: {error}") from None


class _View:
    """What a scenario makes visible by its names."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._place = path_apart(path)
        self.files: dict[Path, None] = {}
        self.folders: dict[Path, None] = {}
        self.mistakes: list[str] = []

    def add(self, named: NamedFile) -> None:
        """Look at a file or folder that is named; what is missing is told by who reads."""
        try:
            place = named_path(self._place, named.text)
            if any(_lies_in(place, folder) for folder in _CLOSED):
                self._refuse(named, place, "it lies in a folder of the system")
            elif named.kind == "road":
                self._add_file(named, place)
            elif place.is_dir():
                self._add_folder(named, place)
        except (OSError, ValueError) as error:
            words = error.strerror if isinstance(error, OSError) else str(error)
            self._refuse(named, named.text, f"{words}")

    def _add_folder(self, named: NamedFile, folder: Path) -> None:
        self.folders[folder] = None
        with os.scandir(folder) as entries:
            names = [item.name for item in islice(entries, FOLDER_ENTRIES_MAX + 1)]
        if len(names) > FOLDER_ENTRIES_MAX:
            self._refuse(named, folder, f"it has more than {FOLDER_ENTRIES_MAX} entries")
            return
        files = sorted(name for name in names if name.endswith(_ENDINGS["catalogs"]))
        if len(files) > CATALOG_FILES_MAX:
            self._refuse(named, folder, f"it has more than {CATALOG_FILES_MAX} catalog files")
            return
        for name in files:
            self._add_file(named, folder / name)

    def _add_file(self, named: NamedFile, place: Path) -> None:
        ending = _ENDINGS[named.kind]
        try:
            real = Path(os.path.realpath(place, strict=True))
        except FileNotFoundError:
            return
        if any(_lies_in(real, folder) for folder in _CLOSED):
            self._refuse(named, place, "it lies in a folder of the system")
        elif not stat.S_ISREG(real.stat().st_mode):
            self._refuse(named, place, "it is no regular file")
        elif real.suffix.lower() != ending or place.suffix.lower() != ending:
            self._refuse(named, place, f"a file that ends in {ending} is needed, links included")
        else:
            self.files[place] = None

    def _refuse(self, named: NamedFile, place: Any, words: str) -> None:
        what = "road file" if named.kind == "road" else "catalogs"
        line = f"{self._place}:{named.line}: {what} {escape(str(place), 300)}: {words}"
        self.mistakes.append(_as_given(line, self._path))


def _lies_in(path: Path, folder: Path) -> bool:
    return path == folder or folder in path.parents
