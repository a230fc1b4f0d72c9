"""Rows of a case, written without pyarrow, are those that pyarrow reads, to the last bit."""

import hashlib
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.files.kpi import DETECTION_FIELDS, KPI_COLUMNS
from schemas.kinds.kpi import columns_by_name
from twin.base.errors import InfrastructureError
from twin.kpi.rows_file import rows_sha256, write_rows
from twin.kpi.table import DetectionColumn, KpiColumn, KpiTable
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi

COMMON = [column for column in KPI_COLUMNS if column.type != "detections"]
OWN = [column for column in columns_by_name().values() if column not in KPI_COLUMNS]
ODD = (0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, 5e-324, 0.1)
LABELS = ("", "car", "Fußgänger", "歩行者", "a\0b", "x" * 300)
SHAPES = {"bool": np.bool_, "int32": np.int32, "int64": np.int64, "float64": np.float64}


def made_up(seed: int, rows: int, own: int = 0, missing: float = 0.3) -> KpiTable:
    """A table of any values that columns may hold."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(0, 4, rows)
    commanded = rng.random(rows) >= missing
    lengths[~commanded] = 0
    entries = int(lengths.sum())
    return KpiTable(
        rows,
        {c.name: _column(rng, c, rows, missing) for c in (*COMMON, *OWN[:own])},
        DetectionColumn(
            np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32),
            commanded,
            rng.choice(LABELS, entries).tolist() if entries else [],
            *(rng.choice(ODD, entries) for _ in DETECTION_FIELDS[1:]),
        ),
    )


def _column(rng, kind, rows, missing):
    valid = rng.random(rows) >= missing if kind.nullable else None
    if kind.type == "name":
        values, nothing = np.array(["", *LABELS])[rng.integers(0, len(LABELS), rows)], ""
    elif kind.type == "float64":
        values, nothing = np.where(rng.random(rows) < 0.5, rng.normal(size=rows), 0.0), 0.0
        values[rng.random(rows) < 0.3] = rng.choice(ODD)
    else:
        bits = 62 if kind.type == "int64" else 1 if kind.type == "bool" else 31
        values, nothing = rng.integers(0, 2**bits, rows).astype(SHAPES[kind.type]), 0
    if valid is not None:
        values = np.where(valid, values, np.array(nothing, values.dtype))
    return KpiColumn(values, valid)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32),
    rows=st.integers(0, 40),
    own=st.integers(0, len(OWN)),
    missing=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_what_is_read_is_what_was_written(tmp_path_factory, seed, rows, own, missing):
    table = made_up(seed, rows, own, missing)
    folder = tmp_path_factory.mktemp("rows")
    write_rows(table, folder / "kpi.parquet")
    wanted = kpi_table(table.to_lists())
    read = read_kpi(folder / "kpi.parquet")
    assert read.schema.equals(wanted.schema)
    assert rows_sha256(table) == kpi_sha256(read) == kpi_sha256(wanted)
    assert repr(read.to_pylist()) == repr(wanted.to_pylist())
    assert [path.name for path in folder.iterdir()] == ["kpi.parquet"]


def test_the_file_says_units_and_types_as_that_of_pyarrow_does(tmp_path):
    table = made_up(1, 20, own=len(OWN))
    write_rows(table, tmp_path / "new.parquet")
    write_kpi(kpi_table(table.to_lists()), tmp_path / "old.parquet")
    new, old = (pq.read_schema(tmp_path / f"{name}.parquet") for name in ("new", "old"))
    assert [dict(field.metadata) for field in new] == [dict(field.metadata) for field in old]
    assert [str(field) for field in new] == [str(field) for field in old]
    assert dict(new.field("speed_mps").metadata)[b"unit"] == b"m/s"
    new, old = (pq.ParquetFile(tmp_path / f"{name}.parquet").schema for name in ("new", "old"))
    # Behind the name of the root: what readers see that know nothing of Arrow.
    assert str(new).partition("schema {")[2] == str(old).partition("schema {")[2]


def test_the_same_rows_give_the_same_file_in_another_process(tmp_path):
    script = (
        "import sys; sys.path[:0] = sys.argv[2:]; from pathlib import Path\n"
        "from test_rows_file import made_up, write_rows\n"
        "write_rows(made_up(3, 200, 2), Path(sys.argv[1]))"
    )
    folders = [str(sys.path[0]), __file__.rpartition("/")[0]]
    path = tmp_path / "theirs.parquet"
    subprocess.run([sys.executable, "-c", script, str(path), *folders], check=True)
    write_rows(made_up(3, 200, 2), tmp_path / "ours.parquet")
    ours, theirs = (hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(tmp_path.iterdir()))
    assert ours == theirs


def test_who_writes_results_loads_no_pyarrow():
    """It takes 39 MB in each simulator, and the workers' distribution is without it."""
    script = "import sys, twin.rig.attempt; print('pyarrow' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)
    assert done.stdout == b"False\n"


@pytest.mark.parametrize("place", ["missing/kpi.parquet", "."])
def test_a_place_that_takes_no_file_is_one_line(tmp_path, place):
    with pytest.raises(InfrastructureError) as refused:
        write_rows(made_up(1, 3), tmp_path / place)
    assert len(str(refused.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
