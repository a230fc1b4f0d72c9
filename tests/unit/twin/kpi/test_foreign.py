"""KPI files that lay where others may write: only what is declared comes out of their reader."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.files.kpi import KPI_COLUMNS
from twin.base.errors import EXIT_USAGE, UsageError
from twin.kpi import foreign
from twin.kpi.foreign import KpiValues, table_of, tables_apart, values_of
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi
from twin.world.apart import reading
from twin.world.apart.reading import AskedFile, read_apart

VALUES = {
    "bool": [True, False],
    "int32": [1, 2],
    "int64": [1, 2],
    "float64": [0.5, float("nan")],
    "name": ["one", "two"],
    "detections": [[], [{"label": "car", "x_px": 1.0}]],
}


def kpi_file(path: Path, columns: int = len(KPI_COLUMNS)) -> str:
    """A file of the first columns; digest of its values."""
    data = {column.name: VALUES[column.type] for column in KPI_COLUMNS}
    table = kpi_table(data).select([column.name for column in KPI_COLUMNS[:columns]])
    write_kpi(table, path)
    return kpi_sha256(table)


def answer(columns: object) -> KpiValues:
    return KpiValues(np.frombuffer(msgspec.msgpack.encode(columns), np.uint8))


def test_values_are_written_anew_and_keep_their_digest(tmp_path: Path) -> None:
    paths = [tmp_path / "one", tmp_path / "two"]
    digests = [kpi_file(path) for path in paths]
    asked = json.dumps([(str(path), f"{path}.new") for path in paths]).encode()
    command = [sys.executable, "-m", "twin.kpi.foreign"]
    done = subprocess.run(command, input=asked, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert [kpi_sha256(read_kpi(Path(f"{path}.new"))) for path in paths] == digests


@pytest.mark.parametrize(("limit", "most"), [("FILES_MAX", 2), ("FILES_BYTES_MAX", 1)])
def test_many_files_are_read_by_several_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, most: int
) -> None:
    paths = [tmp_path / name for name in ("one", "two", "three")]
    digests = [kpi_file(path, len(KPI_COLUMNS) - number) for number, path in enumerate(paths)]
    asked: list[int] = []

    def read(files: Sequence[AskedFile], **limits: int) -> Generator[object, None, None]:
        asked.append(len(files))
        return read_apart(files, **limits)

    monkeypatch.setattr(foreign, limit, most)
    monkeypatch.setattr(foreign, "read_apart", read)
    assert [kpi_sha256(table) for table in tables_apart(paths)] == digests
    assert asked == ([2, 1] if limit == "FILES_MAX" else [1, 1, 1])


def test_a_file_of_an_earlier_version_keeps_its_columns(tmp_path: Path) -> None:
    count = [column.name for column in KPI_COLUMNS].index("detections") + 1
    digest = kpi_file(tmp_path / "old", count)
    table = table_of(values_of(tmp_path / "old"), tmp_path / "old")
    assert (table.num_columns, kpi_sha256(table)) == (count, digest)


@pytest.mark.parametrize("content", [b"", b"PAR1 and no more", b"PAR1" * 1000])
def test_what_is_no_kpi_file_is_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "noise"
    path.write_bytes(content)
    asked = json.dumps([(str(path), f"{path}.new")]).encode()
    command = [sys.executable, "-m", "twin.kpi.foreign"]
    done = subprocess.run(command, input=asked, capture_output=True, text=False, check=False)
    assert done.returncode == EXIT_USAGE
    assert done.stderr.decode().count("\n") == 1
    assert str(path) in done.stderr.decode()
    assert not Path(f"{path}.new").exists()


def test_where_there_is_no_sandbox_a_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kpi_file(tmp_path / "one")
    asked = json.dumps([(str(tmp_path / "one"), str(tmp_path / "new"))]).encode()
    monkeypatch.setattr(reading, "why_not", lambda: "no bwrap on this machine")
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(asked)))
    assert foreign.main() == 0
    said = "KPI files of a store are read without a sandbox: no bwrap on this machine\n"
    assert capsys.readouterr().err == said


def test_a_pipe_is_no_kpi_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="regular file"):
        list(tables_apart([tmp_path / "pipe"]))


@pytest.mark.parametrize(
    "columns",
    [
        {},
        {"tick": [1]},
        {"tick": 1},
        [1, 2],
        {column.name: VALUES[column.type] for column in KPI_COLUMNS} | {"unknown": [1, 2]},
        {column.name: VALUES[column.type] for column in KPI_COLUMNS} | {"tick": [1, 2, 3]},
        {column.name: VALUES[column.type] for column in KPI_COLUMNS} | {"tick": ["a", "b"]},
        {column.name: VALUES[column.type] for column in KPI_COLUMNS} | {"tick": [1, 1 << 62]},
    ],
)
def test_an_answer_that_is_none_of_kpis_is_one_line(columns: object) -> None:
    with pytest.raises(UsageError, match=r"^a: cannot be read as KPIs: its reader answered .+"):
        table_of(answer(columns), Path("a"))
