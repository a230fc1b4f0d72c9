"""Files of others (Euro NCAP, ALKS), unchanged: all are read, and vary as another player counts."""

from __future__ import annotations

import csv
import gzip
import math
from pathlib import Path

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.scenario.storyboard.openscenario.scenario import Permutation, expand, read_scenario

FILES = Path(__file__).parents[7] / "shared" / "data" / "openscenario"
pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"{FILES} is missing")

STANDARD = FILES / "ncap/OpenSCENARIO/NCAP/CA-FC_2026/Variations/StandardRange"


def _expanded(distribution: Path) -> list[Permutation]:
    element = read_scenario(distribution).root.first("ParameterValueDistribution")
    assert element is not None
    named = element.first("ScenarioFile")
    assert named is not None
    return expand(distribution.parent / str(named.values["filepath"]), distribution)


def test_every_file_is_read() -> None:
    kinds = [read_scenario(path).kind for path in sorted(FILES.rglob("*.xosc"))]
    assert len(kinds) == 172
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {
        "DistributionFile": 124,
        "ScenarioFile": 38,
        "CatalogFile": 10,
    }


def test_there_are_428_standard_permutations_and_each_is_a_scenario() -> None:
    names = set()
    for path in sorted(STANDARD.glob("*.xosc")):
        permutations = _expanded(path)
        names |= {f"{path.stem}-{p.number:03d}" for p in permutations}
        assert permutations[-1].scenario().kind == "ScenarioFile"
    assert len(names) == 428
    traces = {p.name.removesuffix(".csv.gz") for p in FILES.rglob("ncap-2026-standard/*.csv.gz")}
    assert traces
    assert traces <= names


def test_ego_starts_at_the_speed_of_the_reference_trace() -> None:
    compared = 0
    for path in sorted(STANDARD.glob("CC*.xosc")):
        for permutation in _expanded(path):
            trace = (
                FILES / f"reference/ncap-2026-standard/{path.stem}-{permutation.number:03d}.csv.gz"
            )
            if "Ego_speed_kph" not in permutation.values or not trace.exists():
                continue
            with gzip.open(trace, "rt") as file:
                row = next(row for row in csv.DictReader(file) if row["entity"] == "Ego")
            speed_mps = float(permutation.values["Ego_speed_kph"]) / 3.6
            assert math.isclose(float(row["speed_mps"]), speed_mps, abs_tol=1e-3), trace.name
            compared += 1
    assert compared > 50
