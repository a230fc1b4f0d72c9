"""KPI files that lay where others may write, read by a process in the sandbox of stacks.

``python -m twin.kpi.foreign``, with pairs of paths as JSON on standard input: each first file is
read by that process alone, which answers plain values; they are checked, and written as a new file
under the second name. Who reads that one reads bytes of our own. A line on standard error says
where there was no sandbox.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa

from schemas.escape import escape
from twin.base.errors import EXIT_USAGE, InfrastructureError, UsageError
from twin.base.process import bind_to_parent
from twin.records.kpi_file import kpi_table, read_kpi, write_kpi
from twin.world.apart.checks import Array, Record
from twin.world.apart.parser import Parser
from twin.world.apart.reading import AskedFile, read_apart, unprotected

FILES_MAX = 256
"""Files that one process reads."""
FILES_BYTES_MAX = 1 << 25
"""Size of those files together, unless it is a single one: processor time and answer of a process
have limits, too [bytes]."""
VALUES_BYTES_MAX = 1 << 28
"""Most that the values of a file may take [bytes]."""
MEMORY_BYTES_MAX = 4 << 30
"""Address space of the process that reads them [bytes]."""
CPU_S = 300
"""Processor time that it may take [s]."""
ROWS_MAX = 10_000_000
"""Most ticks of a case."""

_FAILED = "cannot be read as KPIs"


@dataclass(frozen=True, slots=True)
class KpiValues:
    """Values of one file, as MessagePack: column -> values, None where one is missing."""

    encoded: np.ndarray


KPI = Parser(
    "twin.kpi.foreign:values_of",
    Record(KpiValues, {"encoded": Array("uint8", ("size",), side_max=VALUES_BYTES_MAX)}),
    _FAILED,
)
"""The parser, for the process apart."""


def values_of(path: Path) -> KpiValues:
    """In the process apart: the values of a file.

    Raises:
        ValueError: it is none.
    """
    try:
        table = read_kpi(Path(path))
    except InfrastructureError as error:
        raise ValueError(str(error)) from None
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    return KpiValues(np.frombuffer(msgspec.msgpack.encode(columns), np.uint8))


def table_of(values: KpiValues, path: Path) -> pa.Table:
    """The table of checked values.

    Raises:
        UsageError: they are none of KPIs; one line that names ``path``.
    """
    try:
        columns = msgspec.msgpack.decode(values.encoded.tobytes(), type=dict[str, list[Any]])
        sizes = {len(column) for column in columns.values()}
        if len(sizes) != 1 or sizes.pop() > ROWS_MAX:
            raise ValueError("columns of several lengths, or too many rows")
        return kpi_table(columns).select(list(columns))
    except (
        *(msgspec.MsgspecError, UnicodeDecodeError, ValueError, TypeError, KeyError),
        *(OverflowError, pa.ArrowException),
    ) as error:
        words = escape(" ".join(str(error).split()), 300)
        raise UsageError(f"{path}: {_FAILED}: its reader answered {words}") from None


def tables_apart(paths: Sequence[Path]) -> Iterator[pa.Table]:
    """The tables of files, in order; read in processes apart, some files each.

    Raises:
        UsageError: a file cannot be used; one line that names it.
        InfrastructureError: the process did not start.
    """
    for some in _batches(paths):
        answers = read_apart(
            [AskedFile("twin.kpi.foreign:KPI", path) for path in some],
            cpu_s=CPU_S,
            memory_bytes=MEMORY_BYTES_MAX,
        )
        with closing(answers):
            for path in some:
                try:
                    values = next(answers)
                except ValueError as error:
                    raise UsageError(str(error)) from None
                yield table_of(values, path)


def _batches(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Files that are read by one process each."""
    some: list[Path] = []
    left = FILES_BYTES_MAX
    for path in paths:
        size = path.stat().st_size if path.is_file() else 0
        if some and (size > left or len(some) == FILES_MAX):
            yield some
            some, left = [], FILES_BYTES_MAX
        some.append(path)
        left -= size
    if some:
        yield some


def main() -> int:
    """Write anew what standard input names."""
    pairs = msgspec.json.decode(sys.stdin.buffer.read(), type=list[tuple[str, str]])
    try:
        tables = tables_apart([Path(given) for given, _ in pairs])
        for (_, wanted), table in zip(pairs, tables, strict=True):
            write_kpi(table, Path(wanted))
    except UsageError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    except InfrastructureError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    if line := unprotected("KPI files of a store"):
        print(line, file=sys.stderr)
    return 0


if __name__ == "__main__":
    bind_to_parent()
    sys.exit(main())
