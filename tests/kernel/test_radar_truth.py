"""``twin validate radar``: figures with known answers, printed, and what is off is said."""

import json

import pytest
from radar_rigs import small_profile
from typer.testing import CliRunner

from twin.base.errors import UsageError
from twin.cli import app
from twin.validate import radar_truth
from twin.validate.radar_truth import TruthRow, to_json, to_table, truth_rows


def test_every_figure_holds(monkeypatch):
    monkeypatch.setattr(radar_truth, "CELLS", 200_000)
    rows = truth_rows(small_profile())
    assert [row.what for row in rows if not row.passed] == []
    assert len(rows) == 12
    off = {row.what: row.value for row in rows}
    assert 1e-6 < off["its radial speed, largest mean bias"] < 0.1, "there is noise"


def test_a_target_that_is_missed_is_no_pass(monkeypatch):
    """With a transmitter of a microwatt nothing is seen."""
    monkeypatch.setattr(radar_truth, "CELLS", 1000)
    rows = truth_rows(small_profile(transmit_dbm=-60.0))
    missed = [row for row in rows if row.what.startswith("cross section")]
    assert len(missed) == 4
    assert not any(row.passed for row in missed)
    told = to_json(small_profile(), missed)
    assert [row["value"] for row in told["figures"]] == [None] * 4
    json.dumps(told, allow_nan=False)


def test_what_is_off_ends_with_one(monkeypatch):
    rows = [TruthRow("a", 0.1, 0.5, "dB"), TruthRow("b", 0.6, 0.5, "dB")]
    monkeypatch.setattr(radar_truth, "truth_rows", lambda _: rows)
    done = CliRunner().invoke(app, ["validate", "radar", "corner", "--output", "json"])
    assert done.exit_code == 1
    assert [row["passed"] for row in json.loads(done.stdout)["figures"]] == [True, False]
    assert to_table(small_profile(), rows).row_count == 2


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nope", "radar profile 'nope': not shipped; give one of corner, long_range, mid_range"),
        ("/nowhere/at/all.yaml", "/nowhere/at/all.yaml: No such file or directory"),
    ],
)
def test_an_unknown_profile_is_bad_input(name, told):
    done = CliRunner().invoke(app, ["validate", "radar", name])
    assert isinstance(done.exception, UsageError)
    assert str(done.exception).startswith(told)
