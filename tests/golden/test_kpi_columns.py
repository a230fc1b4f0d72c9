"""KPI columns and scalars keep their bytes: only verdict labels and new columns may change.

The golden file was made by ``python tests/kpi_columns.py`` at the commit before verdicts became
strict (05e2fd0). It is not to be made again when this test fails: a column has changed its meaning.
"""

import hashlib
import json
from pathlib import Path

import pytest
from kpi_columns import DRIVES, described, drive

from twin.base.software import device_class
from twin.records.kpi_file import canonical, kpi_table

GOLDEN = json.loads(Path(__file__).with_name("kpi_columns.json").read_text())
OTHER_PROCESSOR = 1e-6
"""Relative tolerance where another instruction set rounds differently."""


@pytest.fixture(scope="module")
def drives():
    return {name: finished for scene in DRIVES for name, finished in drive(scene).items()}


@pytest.mark.parametrize("name", GOLDEN["cases"])
def test_columns_of_the_commit_before_keep_their_bytes(drives, name):
    before, now = GOLDEN["cases"][name], described(drives[name])
    assert list(now["columns"])[: len(before["columns"])] == list(before["columns"])
    same_processor = device_class("cpu") == GOLDEN["device_class"]
    for column, expected in before["columns"].items():
        got = now["columns"][column]
        if same_processor:
            assert got == expected, column
        else:
            assert (got["type"], got["nulls"]) == (expected["type"], expected["nulls"]), column
            assert got.get("of") == pytest.approx(expected.get("of"), rel=OTHER_PROCESSOR), column
    for scalar, value in before["scalars"].items():
        wanted = value
        if value is not None and not same_processor:
            wanted = pytest.approx(value, rel=OTHER_PROCESSOR)
        assert now["scalars"][scalar] == wanted, scalar


@pytest.mark.parametrize("name", GOLDEN["cases"])
def test_new_columns_stand_behind_the_old_bytes_of_the_fingerprint(drives, name):
    if device_class("cpu") != GOLDEN["device_class"]:
        pytest.skip(f"the golden bytes are of {GOLDEN['device_class']}")
    before = GOLDEN["cases"][name]["stream"]
    stream = b"".join(canonical(kpi_table(drives[name].table.to_lists())))
    assert hashlib.sha256(stream[: before["bytes"]]).hexdigest() == before["sha256"]
