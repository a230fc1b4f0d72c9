"""Files of others, parsed by a process in the sandbox of stacks; what it answers is checked here.

Parsers of meshes and pictures are large, and partly C: a file may be made to take one over. The
process sees the files that it is asked about, the system's libraries and Python, nothing else; it
has no network, writes no file, and ends with the call.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec

from schemas.escape import escape
from twin.base.errors import InfrastructureError
from twin.base.process import PARENT_VARIABLE, how_it_ended, last_lines
from twin.sandbox.possible import why_not
from twin.sandbox.reads import python_reads
from twin.sandbox.start import Inside, Sandboxed, own_code
from twin.sandbox.view import SCRATCH, SandboxView
from twin.world.apart.checks import AnswerError, unpack
from twin.world.apart.frames import FrameReader
from twin.world.apart.limits import ANSWER_BYTES_MAX, CPU_S, MEMORY_BYTES_MAX, WALL_S
from twin.world.apart.parser import ReadRequest, parser_of

# Without the dots of a path as it was typed: their folders are not in the sandbox.
_COMMAND = (os.path.normpath(sys.executable), "-m", "twin.world.apart.child")
_ONE_THREAD = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"),
)


class _CutOffError(Exception):
    """The process has had its processor time."""


@dataclass(frozen=True, slots=True)
class AskedFile:
    """A file that is to be parsed."""

    parser: str
    """:class:`twin.world.apart.parser.Parser`, as ``module:ATTRIBUTE``."""
    path: Path
    files: Sequence[Path] = ()
    """Regular files that it names and the parser may see."""
    argument: bytes = b""
    """What the parser is asked beside it; empty: nothing."""


def read_apart(
    asks: Sequence[AskedFile],
    *,
    readable: Sequence[Path] = (),
    folders: Sequence[Path] = (),
    cpu_s: int = CPU_S,
    wall_s: float = WALL_S,
    memory_bytes: int = MEMORY_BYTES_MAX,
    answer_bytes: int = ANSWER_BYTES_MAX,
) -> Generator[Any, None, None]:
    """The answers of parsers, in order; one process parses all files.

    Args:
        asks: the files. What they name must be regular files, or not be there.
        readable: further files and folders that the parsers may see.
        folders: folders that are there for the parsers, but empty.
        cpu_s: processor time that the process may take [s].
        wall_s: time until the process is given up [s].
        memory_bytes: address space that it may take [bytes].
        answer_bytes: what it may answer, for all files together [bytes].

    Raises:
        ValueError: a file cannot be used; one line that names it. No further one is read.
        InfrastructureError: the process did not start.
    """
    if not asks:
        return
    seen = [path_apart(ask.path) for ask in asks]
    files = [file for ask, path in zip(asks, seen, strict=True) for file in (path, *ask.files)]
    named = [(ask.parser, str(path), ask.argument) for ask, path in zip(asks, seen, strict=True)]
    request = msgspec.json.encode(ReadRequest(named, cpu_s, memory_bytes))
    with _started(request, [*files, *readable], folders) as (child, log):
        assert child.stdout is not None
        until_s = time.monotonic() + wall_s
        reader = FrameReader(child.stdout.fileno(), until_s, answer_bytes)
        try:
            reader.ready()
        except (EOFError, TimeoutError):
            child.kill()
            how = how_it_ended(own_code(child, child.wait()))
            words = f"{how}: {escape(last_lines(log, 1)) or 'it said nothing'}"
            words = f"{asks[0].path}: its reader did not start ({words})"
            raise InfrastructureError(words) from None
        for ask, path in zip(asks, seen, strict=True):
            try:
                yield _answer(ask, path, reader, child)
            except _CutOffError:
                words = f"not done after {cpu_s} s of processor time, simplify it first"
                raise ValueError(f"{ask.path}: {parser_of(ask.parser).failed}: {words}") from None


def unprotected(files: str = "meshes and heightmaps") -> str:
    """A line about files that are parsed without a sandbox; empty: they have one."""
    reason = why_not()
    return f"{files} are read without a sandbox: {reason}" if reason else ""


def _answer(ask: AskedFile, path: Path, reader: FrameReader, child: subprocess.Popen[bytes]) -> Any:
    parser = parser_of(ask.parser)
    try:
        head, arrays = reader.frame()
        if not head.error:
            return unpack(head.tree, parser.check, arrays)
        line = head.error
    except AnswerError as error:
        line = f"{path}: {parser.failed}: its reader answered {error}"
    except TimeoutError:
        line = f"{path}: {parser.failed}: not done in time"
    except EOFError:
        code = own_code(child, child.wait())
        if code == -signal.SIGXCPU:
            raise _CutOffError from None
        line = f"{path}: {parser.failed}: its reader ended ({how_it_ended(code)})"
    # The process knows the file by a name without links on its way.
    line = line.replace(str(path), str(ask.path)).replace(f"{path.parent}/", f"{ask.path.parent}/")
    raise ValueError(escape(line) or f"{ask.path}: {parser.failed}")


def path_apart(path: Path) -> Path:
    """The file as the process sees it: absolute, its folder without links."""
    return Path(os.path.realpath(path.parent)) / path.name


@contextmanager
def _started(
    request: bytes, readable: Sequence[Path], folders: Sequence[Path]
) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes]]]:
    """The process, which ends with the block, and what it says on standard error."""
    with tempfile.TemporaryFile() as log, tempfile.TemporaryFile() as given:
        given.write(request)
        given.seek(0)
        child = _spawn(given, log, readable, folders)
        try:
            yield child, log
        finally:
            child.kill()
            child.wait()
            assert child.stdout is not None
            child.stdout.close()


def _spawn(
    given: IO[bytes], log: IO[bytes], readable: Sequence[Path], folders: Sequence[Path]
) -> subprocess.Popen[bytes]:
    # Modules are found where this process finds them.
    places = [entry for entry in sys.path if entry.startswith("/")]
    variables = {
        **dict.fromkeys(_ONE_THREAD, "1"),
        "PYTHONPATH": os.pathsep.join(places),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    if why_not():
        own = {**os.environ, **variables, PARENT_VARIABLE: str(os.getpid())}
        return _popen(subprocess.Popen, _COMMAND, own, (), given, log)
    view = SandboxView(
        readable=[*python_reads(), *dict.fromkeys(readable)],
        empty=list(dict.fromkeys(folders)),
        folder=SCRATCH,
        variables=variables,
    )
    with Sandboxed(_COMMAND, view) as box:
        return _popen(Inside, box.words, box.environment, box.descriptors, given, log)


def _popen(
    kind: type[subprocess.Popen[bytes]],
    words: Sequence[str],
    environment: Mapping[str, str],
    descriptors: Sequence[int],
    given: IO[bytes],
    log: IO[bytes],
) -> subprocess.Popen[bytes]:
    return kind(
        list(words),
        stdin=given,
        stdout=subprocess.PIPE,
        stderr=log,
        env=environment,
        # Its own session: Ctrl-C reaches this process, which ends it.
        start_new_session=True,
        pass_fds=tuple(descriptors),
        bufsize=0,
    )
