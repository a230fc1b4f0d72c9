"""The process that parses files of others: ``python -m twin.world.apart.child``.

Its standard input names parsers and files; its standard output is the pipe of answers.
"""

from __future__ import annotations

import os
import resource
import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec

from twin.base.process import bind_to_parent
from twin.world.apart.checks import pack
from twin.world.apart.frames import write_error, write_frame
from twin.world.apart.limits import LIMITS
from twin.world.apart.parser import ReadRequest, parser_of


def main() -> None:
    """Answer the request on standard input, file by file, until one cannot be read."""
    bind_to_parent()
    request = msgspec.json.decode(sys.stdin.buffer.read(), type=ReadRequest)
    answers = os.dup(1)
    parsers = {name: parser_of(name) for name, _, _ in request.asks}
    reads = {name: parser.function() for name, parser in parsers.items()}
    _limit({resource.RLIMIT_CPU: request.cpu_s, resource.RLIMIT_AS: request.memory_bytes})
    _silence()

    def write(data: memoryview) -> None:
        while data:
            data = data[os.write(answers, data) :]

    write(memoryview(b"\0"))
    for name, path, argument in request.asks:
        rest = (argument,) if argument else ()
        parser = parsers[name]
        try:
            tree, arrays = pack(reads[name](Path(path), *rest), parser.check)
            write_frame(write, tree, arrays)
        except MemoryError:
            write_error(write, f"{path}: not enough memory to load it")
            return
        except Exception as error:
            line = " ".join(str(error).split())
            if path not in line or not isinstance(error, ValueError):
                line = f"{path}: {parser.failed}: {type(error).__name__}: {line[:160]}"
            write_error(write, line)
            return


def _limit(own: Mapping[int, int]) -> None:
    for limit, most in {**LIMITS, **own}.items():
        _, hard = resource.getrlimit(limit)
        value = most if hard == resource.RLIM_INFINITY else min(most, hard)
        # Nobody can raise it again. A second later, since the kernel kills at the hard limit of the
        # processor's time, which looks like a lack of memory.
        later = limit == resource.RLIMIT_CPU and value != hard
        resource.setrlimit(limit, (value, value + later))


def _silence() -> None:
    """What parsers print is no answer, and nobody reads it."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(nowhere, number)
    os.close(nowhere)


if __name__ == "__main__":
    main()
