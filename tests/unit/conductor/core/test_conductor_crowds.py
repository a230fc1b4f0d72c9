"""Members that come and go: what is known of them has a limit, and leases are never forgotten."""

from __future__ import annotations

import pytest
from conductor_bench import Bench, S, hello, result, started

from conductor.core import decisions as core
from conductor.core import fold as folding
from conductor.core.facts import WorkerJoined, WorkerLeft
from conductor.core.fold import fold
from conductor.core.snapshot import take

LIMIT = 5


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core, "WORKERS_MAX", LIMIT)
    monkeypatch.setattr(folding, "DEPARTED_MAX", LIMIT)


def _leave(bench: Bench, worker: str) -> None:
    assert not bench.ask(hello(worker)).error
    bench.bye(worker)


def test_who_left_is_known_up_to_a_limit_and_the_fold_says_who() -> None:
    bench = started(workers=1)
    for number in range(3 * LIMIT):
        _leave(bench, f"gone{number}")
    kept = [f"gone{number}" for number in range(2 * LIMIT, 3 * LIMIT)]
    assert list(bench.state.departed) == kept
    assert list(fold(bench.journal, bench.config).departed) == kept
    assert "has left; a new start needs a new id" in bench.ask(hello(kept[0])).error
    _leave(bench, "gone0")
    assert list(bench.state.departed) == [*kept[1:], "gone0"]
    facts = [*bench.journal]
    bench.journal = [take(bench.state)]
    bench.restart()
    assert list(bench.state.departed) == [*kept[1:], "gone0"], "in this order, or fold and snapshot"
    _leave(bench, "another")  # forget different ones
    assert list(bench.state.departed) == [*kept[2:], "gone0", "another"]
    # With a larger limit than its writer had, a journal is read all the same.
    with pytest.MonkeyPatch.context() as larger:
        larger.setattr(folding, "DEPARTED_MAX", 100)
        assert set(fold(facts).departed) == {f"gone{number}" for number in range(3 * LIMIT)}


def test_at_the_limit_silent_workers_make_room_but_none_with_a_lease() -> None:
    bench = started(cases=4, workers=LIMIT)
    (lease,) = bench.lease("w2")
    bench.now_ns += bench.config.ttl_ns // 2
    bench.beat("w1")
    bench.beat("w2", lease.token)
    refused = bench.ask(hello("new"))
    assert "5 workers are here and none of them is silent without a lease, at most 5" in (
        refused.error
    )
    assert "new" not in bench.state.workers
    bench.now_ns += bench.config.ttl_ns // 2
    assert not bench.ask(hello("new")).error, "those that said nothing for a time to live went"
    assert list(bench.state.workers) == ["w1", "w2", "new"]
    assert bench.state.departed == {}
    assert list(bench.state.leases) == [lease.token]
    assert not bench.ask(hello("w3")).error, "and is welcome when it is back"
    reply = bench.next("w2", k=0, results=[result(lease)])
    assert reply.acks == [lease.token], "its result counts"
    assert not reply.fenced


def test_a_crowd_that_only_comes_leaves_a_bounded_state() -> None:
    """And a worker that holds a lease for all this time is there to the end."""
    bench = started(cases=1, workers=1)
    (lease,) = bench.lease("w1")
    for number in range(40):
        bench.now_ns += bench.config.ttl_ns // 3 + S
        assert not bench.beat("w1", lease.token).error
        assert not bench.ask(hello(f"brief{number}")).error
        assert len(bench.state.workers) <= LIMIT
    assert len(bench.facts(WorkerJoined)) == 41
    assert len(bench.facts(WorkerLeft)) >= 40 - LIMIT
    assert list(bench.state.leases) == [lease.token]
    assert fold(bench.journal, bench.config) == bench.state


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"host": "h" * 201}, "a host of 201 characters, allowed: 200"),
        ({"device_class": "d" * 5000}, "a device class of 5000 characters"),
        ({"software": "s" * 300}, "a software digest of 300 characters"),
        ({"tags": ["t" * 201]}, "a tag of 201 characters"),
        ({"tags": ["t"] * 101}, "101 tags, at most 100"),
    ],
)
def test_a_workers_words_are_kept_so_they_are_short(given: dict[str, object], said: str) -> None:
    bench = Bench()
    reply = bench.ask(hello(**given))
    assert said in reply.error
    assert len(reply.error) < 300
    assert bench.state.workers == {}


def test_what_a_worker_says_of_itself_is_kept() -> None:
    bench = started(cases=1)
    assert not bench.ask(hello("w2", walltime_end_s=77.5, tags=["t"] * 100)).error
    joined = bench.state.workers["w2"].joined
    assert (joined.walltime_end_s, len(joined.tags)) == (77.5, 100)
    assert "101 tags, at most 100" in bench.ask(hello("w3", tags=["t"] * 101)).error


def test_a_worker_that_is_forgotten_was_silent_for_too_long() -> None:
    bench = started(cases=1)
    bench.now_ns += bench.config.forget_ns
    bench.tick()
    (left,) = bench.facts(WorkerLeft)
    assert (left.worker, left.reason, left.forgotten) == ("w1", "silent for too long", True)
