"""The judge comes to the committed verdict from the files alone, and tells what was changed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pytest
from kpi_columns import cases, drive

from schemas.files.judging import Claim, Judgement
from schemas.wire.control import Lease, Result
from twin.kpi.judge import examine
from twin.records.kpi_file import read_kpi, write_kpi
from twin.rig.attempt import write_attempt


@pytest.fixture(scope="module")
def attempts(tmp_path_factory: pytest.TempPathFactory) -> list[Claim]:
    """Attempts of all kinds of ends, as a worker commits them."""
    out = tmp_path_factory.mktemp("judged")
    claims = []
    given = {case.id: case for case, _ in cases("downtown")}
    for name, finished in drive("downtown").items():
        result = write_attempt(Lease(1, 1, str(out), given[name]), finished, 1.0)
        claims.append(_claim(out, result, given[name].variation.scenario))
    return claims


def _claim(out: Path, result: Result, scenario: Any) -> Claim:
    names = ("case", "attempt_dir", "outcome", "verdict", "scalars", "names", "reasons")
    said = {name: getattr(result, name) for name in (*names, "kpi_sha256", "manifest_sha256")}
    return Claim(folder=str(out), scenario=scenario, **said)


def _named(attempts: list[Claim], end: str) -> Claim:
    return next(claim for claim in attempts if claim.case.endswith(end))


def test_every_verdict_follows_from_its_files(attempts: list[Claim]) -> None:
    found = {claim.case: examine(claim) for claim in attempts}
    assert {each.found for each in found.values()} == {"agrees"}, found
    verdicts = {claim.verdict for claim in attempts}
    assert verdicts >= {"pass", "collision", "false_braking", "time_up"}
    assert {claim.scenario.type for claim in attempts if claim.scenario} == {
        *("jump_scare", "lane_keeping")
    }


@pytest.mark.parametrize(
    ("end", "change", "line"),
    [
        ("hits", {"verdict": "pass"}, "the rows come to 'collision'"),
        ("rests-far", {"verdict": "pass"}, "the rows come to 'false_braking'"),
        ("leaves-its-lane", {"verdict": "pass"}, "the rows come to"),
        ("stops", {"reasons": ["well driven"]}, "the reason is"),
        ("stops", {"kpi_sha256": "0" * 64}, "KPI rows give"),
        ("stops", {"manifest_sha256": "0" * 64}, "is not what was committed"),
        ("stops", {"case": "another"}, "is that of case"),
        ("stops", {"attempt_dir": "../elsewhere/attempt-1"}, "is outside"),
        ("stops", {"attempt_dir": "cases/none/attempt-1"}, "is missing"),
    ],
)
def test_a_false_claim_is_told(
    attempts: list[Claim], end: str, change: dict[str, Any], line: str
) -> None:
    judged = examine(msgspec.structs.replace(_named(attempts, end), **change))
    assert judged.found == "differs"
    assert line in judged.differences[0]


def test_a_changed_scalar_and_another_scenario_are_told(attempts: list[Claim]) -> None:
    claim = _named(attempts, "hits")
    scalars = {**claim.scalars, "impact_speed_mps": 0.1, "dtc_min_m": None}
    found = examine(msgspec.structs.replace(claim, scalars=scalars, names={}))
    assert [line.split()[1] for line in found.differences[:2]] == ["dtc_min_m", "impact_speed_mps"]
    assert any(line.startswith("name hit_object") for line in found.differences)
    assert claim.scenario is not None
    lax = msgspec.structs.replace(claim.scenario, false_braking_m=999.0)
    found = examine(msgspec.structs.replace(claim, scenario=lax))
    assert found.differences == ["the scenario in judge.json is not that of the campaign"]


def test_the_margin_of_a_formula_is_computed_again(attempts: list[Claim]) -> None:
    claim = _named(attempts, "hits")
    assert claim.scalars["robustness"] == pytest.approx(-1.0, abs=0.1)
    scalars = {**claim.scalars, "robustness": 0.5}
    found = examine(msgspec.structs.replace(claim, scalars=scalars))
    assert found.differences[0].startswith("scalar robustness is -")


def test_the_last_bits_of_another_processor_are_no_difference(attempts: list[Claim]) -> None:
    claim = _named(attempts, "stops")
    near = {k: v * (1 + 1e-13) if isinstance(v, float) else v for k, v in claim.scalars.items()}
    assert examine(msgspec.structs.replace(claim, scalars=near)).found == "agrees"


def test_changed_rows_record_or_log_are_told(attempts: list[Claim], tmp_path: Path) -> None:
    claim = _named(attempts, "stops")
    source = Path(claim.folder) / claim.attempt_dir
    folder = tmp_path / claim.attempt_dir
    here = msgspec.structs.replace(claim, folder=str(tmp_path))

    def changed(name: str, data: bytes) -> Judgement:
        folder.mkdir(parents=True, exist_ok=True)
        for path in source.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())
        (folder / name).write_bytes(data)
        return examine(here)

    log = (source / "log.txt").read_bytes()
    assert changed("log.txt", log).found == "agrees"
    assert changed("log.txt", log + b"x").found == "differs"
    record = json.loads((source / "judge.json").read_bytes())
    assert changed("judge.json", json.dumps({**record, "moved": False}).encode()).differences == [
        "log.txt or judge.json is not what was committed"
    ]
    assert changed("kpi.parquet", b"PAR1").found == "differs"
    table = read_kpi(source / "kpi.parquet")
    place = table.schema.get_field_index("x_m")
    moved = table.set_column(place, table.schema.field(place), pa.array([0.0] * table.num_rows))
    changed("log.txt", log)
    write_kpi(moved, folder / "kpi.parquet")
    assert "KPI rows give" in examine(here).differences[0]
    changed("log.txt", log)
    (folder / "judge.json").unlink()
    assert examine(here).found == "differs"
    (folder / "judge.json").symlink_to(source / "judge.json")
    assert "no plain file" in examine(here).differences[0]


def test_the_judge_is_a_process_that_loads_no_simulator(
    attempts: list[Claim], tmp_path: Path
) -> None:
    program = (
        "import os, sys, twin.cli\n"
        "from twin.kpi.judge_command import follow\n"
        "follow()\n"
        "loaded = {'warp', 'zenoh'} & set(sys.modules)\n"
        "file = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)\n"
        "try:\n    os.write(file, b'x')\n"
        "except OSError as error:\n    print(loaded, error.strerror)\n"
    )
    lines = b"".join(msgspec.json.encode(claim) + b"\n" for claim in attempts)
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "new"],
        input=lines,
        capture_output=True,
        check=True,
    )
    *judged, last = done.stdout.splitlines()
    assert [msgspec.json.decode(line, type=Judgement).found for line in judged] == ["agrees"] * 8
    assert last == b"set() File too large"
