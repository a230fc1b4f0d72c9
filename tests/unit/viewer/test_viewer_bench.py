"""The bench: what counts as missed, and that its synthetic cases are what it says."""

import json

import pytest

from twin.fabric.errors import UsageError
from viewer.bench import BenchOptions, bench, misses


def viewer(**changes):
    return {"viewer": {"cpu_share": 0.25, "memory_last_mb": 600.0, **changes}}


def simulation(**changes):
    return {"simulation": {"live": 0.95, "frozen": 0.99, "same_results": True, **changes}}


def test_exactly_at_the_targets_nothing_is_missed():
    assert misses({**viewer(), **simulation()}) == []


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (viewer(cpu_share=0.26), "26% of a core"),
        (viewer(memory_last_mb=600.1), "600.1 MB"),
        (simulation(live=0.949), "(live): 94.9%"),
        (simulation(frozen=0.989), "(frozen): 98.9%"),
        (simulation(same_results=False), "differ"),
    ],
)
def test_each_target_can_be_missed(found, words):
    [line] = misses(found)
    assert words in line


def test_too_many_in_full_is_a_mistake():
    with pytest.raises(UsageError, match="at most 8"):
        bench(BenchOptions(cases=4, focus=5), as_json=True, check=False)


def test_synthetic_cases_are_measured(capsys, monkeypatch):
    monkeypatch.setattr("viewer.bench.WARM_UP_S", 3.0)
    options = BenchOptions(cases=4, focus=1, seconds=1.0, rounds=0)
    assert bench(options, as_json=True, check=False) == 0
    found = json.loads(capsys.readouterr().out)["viewer"]
    assert found["received"] > 4
    assert found["cpu_share"] > 0
    assert found["memory_last_mb"] > 20
