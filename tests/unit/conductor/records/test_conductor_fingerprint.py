"""The fingerprint: equal values, equal fingerprint; any change is seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from conductor.cli import app
from conductor.records.fingerprint import Fingerprinter, fingerprint
from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from schemas.files.kpi import KPI_COLUMNS
from twin.base.errors import InfrastructureError, UnfinishedError, UsageError
from twin.base.files import write_atomic
from twin.records.kpi_file import kpi_sha256, kpi_table, write_kpi

_VALUES = {
    "bool": True,
    "int32": 3,
    "int64": 4,
    "float64": 0.5,
    "name": "car",
    "detections": [],
}


def _kpi(folder: Path, case: str, speed_mps: float) -> CaseOutcome:
    columns: dict[str, list[Any]] = {c.name: [_VALUES[c.type]] * 2 for c in KPI_COLUMNS}
    columns["speed_mps"] = [speed_mps, float("nan")]
    table = kpi_table(columns)
    attempt_dir = f"cases/{case}/attempt-1"
    (folder / attempt_dir).mkdir(parents=True)
    write_kpi(table, folder / attempt_dir / "kpi.parquet")
    return CaseOutcome(
        outcome="verdict",
        verdict="pass",
        attempt_dir=attempt_dir,
        attempt=1,
        attempts=1,
        kpi_sha256=kpi_sha256(table),
        device_class="cpu:avx2",
    )


def _write(folder: Path, cases: dict[str, CaseOutcome], **changes: Any) -> None:
    values: dict[str, Any] = {
        "campaign": "alpha",
        "digest": "d",
        "seed": 0,
        "simulator": "warp",
        "software": "f00d",
        "device": "same",
        "device_classes": ["cpu:avx2"],
        "complete": all(case.outcome for case in cases.values()),
    }
    write_atomic(
        folder / "outcomes.json", encode_outcomes(Outcomes(cases=cases, **(values | changes)))
    )


def _campaign(folder: Path, speed_mps: float = 1.0) -> dict[str, CaseOutcome]:
    folder.mkdir()
    cases = {
        "a": _kpi(folder, "a", speed_mps),
        "b": CaseOutcome(outcome="unresolved", reasons=["3 charged attempts"]),
    }
    _write(folder, cases)
    return cases


def test_equal_values_give_equal_fingerprints(tmp_path: Path) -> None:
    _campaign(tmp_path / "one")
    cases = _campaign(tmp_path / "two")
    _write(tmp_path / "two", dict(reversed(cases.items())), seed=5)
    one, two = (fingerprint(tmp_path / name) for name in ("one", "two"))
    assert one == two
    assert (one.cases, one.mixed) == (2, False)
    assert one.outcomes == {"unresolved": 1, "verdict/pass": 1}


def test_the_last_bit_of_one_value_is_seen(tmp_path: Path) -> None:
    _campaign(tmp_path / "one", 1.0)
    _campaign(tmp_path / "two", 1.0000000000000002)
    assert fingerprint(tmp_path / "one").sha256 != fingerprint(tmp_path / "two").sha256


@pytest.mark.parametrize("changes", [{"verdict": "collision"}, {"outcome": "failed"}])
def test_an_outcome_is_seen(tmp_path: Path, changes: dict[str, str]) -> None:
    cases = _campaign(tmp_path / "one")
    before = fingerprint(tmp_path / "one").sha256
    cases["a"] = msgspec.structs.replace(cases["a"], **changes)
    _write(tmp_path / "one", cases)
    assert fingerprint(tmp_path / "one").sha256 != before


def test_mixed_device_classes_are_told(tmp_path: Path) -> None:
    cases = _campaign(tmp_path / "one")
    _write(tmp_path / "one", cases, device_classes=["cpu:avx2", "cuda:H200"])
    assert fingerprint(tmp_path / "one").mixed


def test_a_kpi_file_that_was_not_committed_is_named(tmp_path: Path) -> None:
    cases = _campaign(tmp_path / "one")
    cases["a"] = msgspec.structs.replace(cases["a"], kpi_sha256="0" * 64)
    _write(tmp_path / "one", cases)
    with pytest.raises(InfrastructureError, match=r"case a: .* not the file that was committed"):
        fingerprint(tmp_path / "one")
    (tmp_path / "one/cases/a/attempt-1/kpi.parquet").unlink()
    with pytest.raises(InfrastructureError, match=r"kpi\.parquet"):
        fingerprint(tmp_path / "one")


def test_a_case_without_kpis_counts_by_its_outcome(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    _write(tmp_path / "one", {"a": CaseOutcome(outcome="verdict", verdict="pass")})
    assert fingerprint(tmp_path / "one").outcomes == {"verdict/pass": 1}


@pytest.mark.parametrize("attempt_dir", ["/etc", "../other", "cases/../../x"])
def test_an_attempt_outside_the_campaign_is_refused(tmp_path: Path, attempt_dir: str) -> None:
    cases = _campaign(tmp_path / "one")
    cases["a"] = msgspec.structs.replace(cases["a"], attempt_dir=attempt_dir)
    _write(tmp_path / "one", cases)
    with pytest.raises(InfrastructureError, match="outside"):
        fingerprint(tmp_path / "one")


def test_an_unfinished_campaign_has_no_fingerprint(tmp_path: Path) -> None:
    cases = _campaign(tmp_path / "one")
    cases["c"] = CaseOutcome(outcome="")
    _write(tmp_path / "one", cases)
    with pytest.raises(UnfinishedError, match="1 of 3 cases has not ended"):
        fingerprint(tmp_path / "one")


def test_no_outcomes(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no outcomes\.json"):
        fingerprint(tmp_path)
    (tmp_path / "conductor.json").write_text("{}")
    with pytest.raises(UsageError, match="has not written"):
        fingerprint(tmp_path)
    (tmp_path / "outcomes.json").write_text("{")
    with pytest.raises(InfrastructureError, match="damaged"):
        fingerprint(tmp_path)


def _command(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["fingerprint", *map(str, arguments)])
    return done.exit_code, done.stdout


def test_one_command_says_that_two_runs_are_the_same(tmp_path: Path) -> None:
    for name in ("one", "two"):
        _campaign(tmp_path / name)
    code, said = _command(tmp_path / "one", tmp_path / "two")
    assert code == 0
    assert said == f"the same: {fingerprint(tmp_path / 'one').sha256}\n"


def test_runs_that_differ_are_told_apart_by_case_and_first_value(tmp_path: Path) -> None:
    first, second = tmp_path / "one", tmp_path / "two"
    cases = _campaign(first, 1.0)
    cases["only"] = CaseOutcome(outcome="cancelled")
    cases["verdict"] = CaseOutcome(outcome="verdict", verdict="pass")
    _write(first, cases)
    cases = _campaign(second, 1.0000000000000002)
    cases["verdict"] = CaseOutcome(outcome="verdict", verdict="collision")
    _write(second, cases, software="beef", seed=3)
    code, said = _command(first, second)
    assert code == 1
    assert said.splitlines() == [
        "not the same: 3 of 4 cases",
        "  a: speed_mps; first speed_mps at tick 0: 1.0 against 1.0000000000000002",
        f"  only: only in {first}",
        "  verdict: verdict/pass against verdict/collision",
        "note: seed: 0 against 3",
        "note: software: f00d against beef",
    ]
    code, said = _command(first, second, "--output", "json")
    assert code == 1
    found = json.loads(said)
    assert (found["same"], list(found["differences"])) == (False, ["a", "only", "verdict"])


def test_names_and_outcomes_do_not_run_together() -> None:
    """Two cases ``a`` and ``b`` against one that is called like all of it."""
    failed, whole = CaseOutcome(outcome="failed"), Fingerprinter()
    outcomes = Outcomes(
        campaign="alpha", digest="d", seed=0, simulator="warp", software="", device="same",
        device_classes=[], complete=True, cases={},
    )  # fmt: skip
    for name in ("a", "b"):
        whole.add(name, failed, b"")
    other = Fingerprinter()
    other.add("afailedb", failed, b"")
    assert whole.result(outcomes).sha256 != other.result(outcomes).sha256
