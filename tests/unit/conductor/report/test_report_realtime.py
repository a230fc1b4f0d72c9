"""What reports, fingerprints and comparisons say of a campaign that went by the wall clock."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign

from conductor.cli import app
from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import read_outcomes
from conductor.records.realtime import too_slow
from conductor.report import make_report, write_summary
from conductor.report.compare.comparison import compare
from conductor.report.reading.dossier import open_dossier
from schemas.wire.realtime import OVERRUN_SHARE_MAX, Realtime

TICKS = 400
SLOW = "8 of 8 cases ran on a machine that was too slow; in the worst 5 of 400 ticks overran"


def paced(folder: Path, overruns: int) -> Path:
    def change(case, end):
        went = Realtime(TICKS, overruns, 7, 50.0, 100.0, 150.0, 0.999)
        return msgspec.structs.replace(end, realtime=went)

    make_campaign(folder, campaign_data(clock="realtime"), change)
    return folder


@pytest.mark.parametrize("more", [0, 1])
def test_a_machine_that_did_not_keep_up_raises_an_alarm(tmp_path: Path, more: int) -> None:
    overruns = round(OVERRUN_SHARE_MAX * TICKS) + more
    folder = paced(tmp_path / "run", overruns)
    assert (SLOW in too_slow(read_outcomes(folder))) is bool(more)
    make_report(folder, plots=False)
    page = (folder / "report.html").read_text()
    assert (SLOW in page) is bool(more)
    assert "sim time went with the wall clock and waited for no stack" in page
    assert "(clock realtime: of this run alone)" in page


def test_its_fingerprint_is_passed_off_as_nothing_else(tmp_path: Path) -> None:
    folder = paced(tmp_path / "run", 0)
    assert fingerprint(folder).realtime
    said = CliRunner().invoke(app, ["fingerprint", str(folder)]).output
    assert said.split(maxsplit=1)[1] == "realtime: of this run alone, it repeats on no other\n"
    make_campaign(tmp_path / "plain")
    assert not fingerprint(tmp_path / "plain").realtime
    said = CliRunner().invoke(app, ["fingerprint", str(tmp_path / "plain")]).output
    assert len(said.split()) == 1


def test_the_summary_has_ages_of_commands_where_there_are_any(tmp_path: Path) -> None:
    table = write_summary(paced(tmp_path / "run", 3))
    assert table.column("realtime_age_p99_ms").to_pylist() == [100.0] * 8
    assert table.column("realtime_overruns").to_pylist() == [3] * 8
    make_campaign(tmp_path / "plain")
    names = write_summary(tmp_path / "plain").column_names
    assert not [name for name in names if name.startswith("realtime")]


def test_a_comparison_says_that_a_flip_says_little(tmp_path: Path) -> None:
    one, two = paced(tmp_path / "one", 0), tmp_path / "two"
    make_campaign(two)
    found = compare(
        *(open_dossier(one), open_dossier(two)),
        *(fingerprint(one), fingerprint(two)),
    )
    assert "one flip says little" in found.notes[0]
    assert "'clock' differs in 8 of 8 pairs" in found.notes[1]
