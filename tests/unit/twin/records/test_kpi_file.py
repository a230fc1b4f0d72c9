"""KPI files: canonical values, not bytes."""

import math
import struct
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.files.kpi import KPI_COLUMNS
from twin.base.errors import InfrastructureError
from twin.records.kpi_file import (
    COLUMNS_MIN,
    KPI_SCHEMA,
    kpi_sha256,
    kpi_table,
    read_kpi,
    write_kpi,
)

DETECTION = {
    "label": "car",
    "confidence": 0.75,
    "x_px": 1.0,
    "y_px": 2.0,
    "width_px": 3.0,
    "height_px": 4.0,
}


def columns(rows=3):
    plain = {"bool": True, "int32": 5, "int64": 6, "float64": 0.1, "detections": [DETECTION]}
    plain["name"] = "obstacle"
    return {
        c.name: [None if c.nullable and i == rows - 1 else plain[c.type] for i in range(rows)]
        for c in KPI_COLUMNS
    }


def test_round_trip_and_chunking_keep_the_digest(tmp_path):
    table = kpi_table(columns())
    write_kpi(table, tmp_path / "kpi.parquet")
    assert kpi_sha256(read_kpi(tmp_path / "kpi.parquet")) == kpi_sha256(table)
    pq.write_table(table, tmp_path / "chunked.parquet", row_group_size=1, compression="none")
    assert kpi_sha256(read_kpi(tmp_path / "chunked.parquet")) == kpi_sha256(table)
    assert not list(tmp_path.glob("*.tmp"))


def test_a_file_of_the_first_version_keeps_its_digest():
    """Written by 05e2fd0, of a case of chaos-16; its outcomes have this digest."""
    old = Path(__file__).with_name("data") / "kpi-18-columns.parquet"
    table = read_kpi(old)
    assert table.column_names == [column.name for column in KPI_COLUMNS[:COLUMNS_MIN]]
    committed = "94d56f6031f56b4e0286f6ddea8dda63aa691eb10dbf96b6580704bbd7438b2b"
    assert kpi_sha256(table) == committed


@pytest.mark.parametrize("count", [COLUMNS_MIN - 1, COLUMNS_MIN + 1])
def test_columns_may_only_be_added_behind(tmp_path, count):
    table = kpi_table(columns())
    kept = table.select(KPI_SCHEMA.names[:count])
    write_kpi(kept, tmp_path / "kpi.parquet")
    if count > COLUMNS_MIN:
        assert read_kpi(tmp_path / "kpi.parquet").num_columns == count
        return
    with pytest.raises(InfrastructureError, match="not the KPI columns"):
        read_kpi(tmp_path / "kpi.parquet")


def test_a_column_of_another_name_in_between_is_refused(tmp_path):
    table = kpi_table(columns()).rename_columns(
        ["other" if name == "nearest_object" else name for name in KPI_SCHEMA.names]
    )
    write_kpi(table, tmp_path / "kpi.parquet")
    with pytest.raises(InfrastructureError, match="not the KPI columns"):
        read_kpi(tmp_path / "kpi.parquet")


def flipped(value):
    """``value`` with its last bit flipped."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return struct.unpack("<d", struct.pack("<q", bits ^ 1))[0]


@pytest.mark.parametrize("column", KPI_COLUMNS, ids=lambda c: c.name)
def test_one_bit_in_any_column_changes_the_digest(column):
    changed = columns()
    first = changed[column.name][0]
    if column.type == "detections":
        for field, value in DETECTION.items():
            other = columns()
            new = {**DETECTION, field: "cas" if field == "label" else flipped(value)}
            other[column.name][0] = [new]
            assert kpi_sha256(kpi_table(other)) != kpi_sha256(kpi_table(columns())), field
        return
    if column.type == "float64":
        changed[column.name][0] = flipped(first)
    elif column.type == "name":
        changed[column.name][0] = first[:-1] + "f"
    else:
        changed[column.name][0] = not first if column.type == "bool" else first ^ 1
    assert kpi_sha256(kpi_table(changed)) != kpi_sha256(kpi_table(columns()))


def test_missing_differs_from_zero_and_nan_from_missing():
    seen = set()
    for value in (None, 0.0, math.nan):
        changed = columns()
        changed["ttc_s"][0] = value
        seen.add(kpi_sha256(kpi_table(changed)))
    assert len(seen) == 3


def test_nan_has_one_pattern():
    other_nan = struct.unpack("<d", struct.pack("<Q", 0x7FF8000000000001))[0]
    digests = set()
    for value in (math.nan, other_nan, -math.nan):
        changed = columns()
        changed["x_m"][0] = value
        digests.add(kpi_sha256(kpi_table(changed)))
    assert len(digests) == 1


def test_moving_a_detection_to_the_next_row_changes_the_digest():
    one, other = columns(), columns()
    one["detections"] = [[DETECTION, DETECTION], [], None]
    other["detections"] = [[DETECTION], [DETECTION], None]
    assert kpi_sha256(kpi_table(one)) != kpi_sha256(kpi_table(other))


def test_no_rows():
    assert kpi_sha256(kpi_table(columns(0))) == kpi_sha256(KPI_SCHEMA.empty_table())


def test_damaged_or_foreign_files_are_one_line(tmp_path):
    path = tmp_path / "kpi.parquet"
    with pytest.raises(InfrastructureError) as missing:
        read_kpi(path)
    path.write_bytes(b"PAR1 not really")
    with pytest.raises(InfrastructureError) as damaged:
        read_kpi(path)
    pq.write_table(pa.table({"a": [1]}), path)
    with pytest.raises(InfrastructureError, match="not the KPI columns") as foreign:
        read_kpi(path)
    for error in (missing, damaged, foreign):
        assert len(str(error.value).splitlines()) == 1
        assert str(path) in str(error.value)


def test_a_file_of_a_version_in_which_a_column_was_never_missing_is_read(tmp_path):
    """The distance to collision may be missing since there are scenes without an obstacle."""
    given = columns()
    given["dtc_m"] = [3.0, 2.0, 1.0]
    table = kpi_table(given)
    place = table.schema.get_field_index("dtc_m")
    before = table.schema.set(place, table.schema.field(place).with_nullable(False))
    pq.write_table(table.cast(before), tmp_path / "kpi.parquet")
    read = read_kpi(tmp_path / "kpi.parquet")
    assert read.schema.equals(KPI_SCHEMA)
    assert kpi_sha256(read) == kpi_sha256(table)


def test_labels_do_not_run_together():
    """Two boxes ``ab`` and ``c`` are not two boxes ``a`` and ``bc``."""
    digests = set()
    for labels in (("ab", "c"), ("a", "bc")):
        made = columns(1)
        made["detections"] = [[{**DETECTION, "label": label} for label in labels]]
        digests.add(kpi_sha256(kpi_table(made)))
    assert len(digests) == 2


def test_times_beyond_32_bits_count_whole():
    """Sim time passes 2^32 ns after four seconds."""
    digests = set()
    for time_ns in (1_000, 1_000 + 2**32, 1_000 + 2**33):
        made = columns(1)
        made["sim_time_ns"] = [time_ns]
        digests.add(kpi_sha256(kpi_table(made)))
    assert len(digests) == 3
