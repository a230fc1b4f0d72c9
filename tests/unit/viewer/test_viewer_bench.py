"""The bench: what counts as missed, and that its synthetic cases are what it says."""

import json
import threading

import pytest

from schemas import topics
from schemas.view import Thumbnail
from schemas.wire import ATTACHMENT_BYTES_MAX, decode
from twin.fabric.errors import UsageError
from twin.fabric.zenoh_bus import open_bus
from viewer.bench import BenchOptions, _source, bench, misses


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


def test_every_synthetic_case_is_sent():
    seen, all_seen = set(), threading.Event()

    def receive(sample):
        seen.add(decode(sample.attachment, Thumbnail, ATTACHMENT_BYTES_MAX).case)
        if len(seen) == 4:
            all_seen.set()

    with _source(4) as endpoint:
        bus = open_bus("client", connect=[endpoint])
        bus.subscribe(topics.VIEW_THUMBNAIL.key.format(campaign="*", case="*"), receive)
        assert all_seen.wait(60)
        bus.close()
    assert seen == {f"case-{index:03d}" for index in range(4)}


def test_synthetic_cases_are_measured(capsys, monkeypatch):
    monkeypatch.setattr("viewer.bench.WARM_UP_S", 0.5)
    options = BenchOptions(cases=4, focus=1, seconds=0.5, rounds=0)
    assert bench(options, as_json=True, check=False) == 0
    found = json.loads(capsys.readouterr().out)["viewer"]
    assert found["cases"] == 4
    assert found["in_full"] == 1
    assert found["cpu_share"] >= 0
    assert found["memory_last_mb"] > 20
    assert {"received", "overwritten", "logged", "skipped"} <= found.keys()
