"""A rig or a worker that dies with several cases: halves, charges, quarantine."""

from __future__ import annotations

from dataclasses import replace

import pytest
from conductor_bench import Bench, S, ended, hello, result, started, submit

from conductor.core.decisions import worker_lost
from conductor.core.facts import AttemptEnded, CaseEnded, Committed
from conductor.core.settle import LOSSES_ANYWAY
from conductor.core.state import Config
from schemas.wire.control import Lease


def _die(bench: Bench, leases: list[Lease], worker: str = "w1", reason: str = "crash") -> None:
    """The rig dies with all of ``leases``, as the worker tells it."""
    why = reason if len(leases) == 1 else "suspect"
    bench.next(worker, k=0, ended=[ended(lease, why, "signal 9") for lease in leases])


def _names(leases: list[Lease]) -> list[str]:
    return [lease.case.id for lease in leases]


@pytest.mark.parametrize("spread", [False, True])
def test_suspects_are_leased_again_in_halves_that_share_with_nobody(spread: bool) -> None:
    bench = started(cases=9)
    _die(bench, bench.lease(k=5))
    bench.state.config = replace(bench.config, spread=spread)
    first = bench.lease(k=8)
    assert _names(first) == ["repeat_0", "repeat_1", "repeat_2"]
    assert not any(lease.alone for lease in first)
    # One of them ends: its slot stays empty, neither the other half nor new cases get it.
    held = [lease.token for lease in first[1:]]
    assert bench.lease(k=8, results=[result(first[0])], held=held) == []
    second = bench.lease(k=8, results=[result(lease) for lease in first[1:]])
    assert _names(second) == ["repeat_3", "repeat_4"]
    rest = bench.lease(k=8, results=[result(lease) for lease in second])
    assert _names(rest) == ["repeat_5", "repeat_6", "repeat_7", "repeat_8"]
    assert not any(end.charged for end in bench.facts(AttemptEnded))


def test_a_slot_of_a_half_is_refilled_from_the_same_half() -> None:
    bench = started(cases=8)
    _die(bench, bench.lease(k=6))
    (one,) = bench.lease(k=1)
    (two,) = bench.lease(k=1, held=[one.token])
    assert _names([one, two]) == ["repeat_0", "repeat_1"]
    assert _names(bench.lease(k=4, held=[one.token, two.token])) == ["repeat_2"]


@pytest.mark.parametrize(("count", "halves"), [(2, [1, 1]), (3, [2, 1]), (4, [2, 2]), (5, [3, 2])])
def test_the_size_of_halves(count: int, halves: list[int]) -> None:
    bench = started(cases=count)
    _die(bench, bench.lease(k=count))
    for half in halves:
        leases = bench.lease(k=9)
        assert len(leases) == half
        assert all(lease.alone for lease in leases) == (half == 1)
        bench.next(k=0, results=[result(lease) for lease in leases])


@pytest.mark.parametrize("guilty", range(8))
def test_only_the_guilty_case_is_charged(guilty: int) -> None:
    bench = started(cases=8, attempts_max=2)
    name = f"repeat_{guilty}"
    deaths = 0
    while leases := bench.lease(k=8):
        if name in _names(leases):
            deaths += 1
            _die(bench, leases)
        else:
            bench.next(k=0, results=[result(lease) for lease in leases])
    assert deaths == 5  # 8, 4, 2, 1, and 1 again
    (end,) = bench.facts(CaseEnded)
    assert (end.case, end.outcome, len(end.evidence)) == (name, "unresolved", 2)
    assert {e.case for e in bench.facts(AttemptEnded) if e.charged} == {name}
    assert len(bench.facts(Committed)) == 7


def test_two_guilty_cases_are_both_found() -> None:
    bench = started(cases=8, attempts_max=1)
    guilty = {"repeat_1", "repeat_2"}
    while leases := bench.lease(k=8):
        if guilty & set(_names(leases)):
            _die(bench, leases)
        else:
            bench.next(k=0, results=[result(lease) for lease in leases])
    assert {end.case for end in bench.facts(CaseEnded)} == guilty
    assert len(bench.facts(Committed)) == 6


def test_a_half_given_back_stays_a_half() -> None:
    bench = started(cases=4, workers=2)
    _die(bench, bench.lease(k=4))
    leases = bench.lease(k=4)
    bench.next(k=0, ended=[ended(lease, "walltime") for lease in leases])
    assert _names(bench.lease("w2", k=4)) == ["repeat_0", "repeat_1"]


def test_halves_survive_a_restart() -> None:
    bench = started(cases=4)
    _die(bench, bench.lease(k=4))
    bench.restart()
    assert _names(bench.lease(k=4)) == ["repeat_0", "repeat_1"]


def test_the_same_token_twice_and_by_two_reasons() -> None:
    bench = started(cases=2)
    a, b = bench.lease(k=2)
    ends = [ended(a, "suspect"), ended(a, "suspect"), ended(b, "suspect"), ended(b, "crash")]
    bench.next(k=0, ended=ends)
    assert [(e.case, e.reason) for e in bench.facts(AttemptEnded)] == [
        ("repeat_1", "crash"),
        ("repeat_0", "suspect"),
    ]


def test_the_last_charge_comes_from_a_second_worker_if_there_is_one() -> None:
    bench = started(cases=1, workers=2, attempts_max=3)
    for _ in range(2):
        _die(bench, bench.lease("w1"))
        bench.beat("w2")
    assert bench.lease("w1") == []
    assert "not again on w1: another worker should confirm its charges" in bench.explain("repeat_0")
    _die(bench, bench.lease("w2"), worker="w2")
    (end,) = bench.facts(CaseEnded)
    assert end.reason.startswith("quarantined: 3 charged attempts on 2 workers, the last one: ")
    assert [charge.worker for charge in end.evidence] == ["w1", "w1", "w2"]


@pytest.mark.parametrize(("silent_ns", "granted"), [(0, True), (1, False)])
def test_a_second_worker_that_is_silent_is_not_waited_for(silent_ns: int, granted: bool) -> None:
    bench = started(cases=1, workers=2, attempts_max=2)
    bench.now_ns += 1
    bench.beat("w1")
    _die(bench, bench.lease("w1"))
    bench.now_ns += bench.config.ttl_ns - 1 - silent_ns
    assert bool(bench.lease("w1")) == granted


def test_a_second_worker_of_another_kind_is_not_waited_for() -> None:
    bench = started(cases=1, attempts_max=2)
    _die(bench, bench.lease("w1"))
    bench.ask(hello("w2", software="beef"))
    assert len(bench.lease("w1")) == 1


def _vanish(bench: Bench, worker: str, silently: bool = False, quiet: str = "") -> None:
    """The worker dies; everybody else goes on speaking."""
    if not silently:
        worker_lost(bench.state, worker, bench.now_ns)
    for _ in range(5):
        bench.now_ns += (bench.config.ttl_ns if silently else bench.config.vanished_ns) // 5
        for name, other in list(bench.state.workers.items()):
            if name not in (worker, quiet) and not other.vanished:
                bench.beat(name, *other.tokens)
    bench.tick()


@pytest.mark.parametrize("pause_ns", [0, 60 * S])
@pytest.mark.parametrize("silently", [False, True])
def test_a_case_that_takes_its_worker_down_three_times_is_quarantined(
    silently: bool, pause_ns: int
) -> None:
    bench = started(cases=1)
    bench.ask(hello("watcher", software="beef"))
    for number in range(1, 4):
        assert not bench.facts(CaseEnded)
        bench.ask(hello(f"v{number}"))
        (lease,) = bench.lease(f"v{number}")
        assert lease.alone == (number > 1)
        _vanish(bench, f"v{number}", silently)
        bench.now_ns += pause_ns
        bench.beat("watcher")
        bench.beat("w1")
    (end,) = bench.facts(CaseEnded)
    assert end.outcome == "unresolved"
    assert end.reason.startswith("quarantined: 3 losses on 3 workers, the last one: lost: ")
    assert all(not end.charged for end in bench.facts(AttemptEnded))
    assert [loss.worker for loss in end.evidence] == ["v1", "v2", "v3"]


def test_the_cases_of_a_lost_worker_are_halved_too() -> None:
    bench = started(cases=4, workers=2)
    bench.lease("w1", k=4)
    _vanish(bench, "w1")
    assert _names(bench.lease("w2", k=4)) == ["repeat_0", "repeat_1"]


def test_in_a_storm_nobody_is_to_blame() -> None:
    bench = started(cases=2, workers=3)
    bench.lease("w1", k=1)
    worker_lost(bench.state, "w2", bench.now_ns)
    _vanish(bench, "w1")
    (end,) = bench.facts(AttemptEnded)
    assert (end.reason, end.evidence, end.alone) == ("lost", False, False)
    assert len(bench.lease("w3", k=2)) == 2


@pytest.mark.parametrize(("ago_ns", "blamed"), [(0, False), (1, True)])
def test_a_death_long_ago_is_no_storm(ago_ns: int, blamed: bool) -> None:
    bench = started(cases=1, workers=2)  # w2 is never heard of again
    bench.now_ns += 3 * bench.config.ttl_ns - bench.config.vanished_ns + ago_ns
    bench.lease("w1")
    _vanish(bench, "w1", quiet="w2")
    assert bench.facts(AttemptEnded)[0].evidence == blamed


def test_losses_without_evidence_end_some_day_too() -> None:
    bench = started(cases=1)
    for number in range(3 * LOSSES_ANYWAY):
        assert not bench.facts(CaseEnded)
        bench.ask(hello(f"v{number}"))
        bench.ask(hello(f"x{number}"))
        assert len(bench.lease(f"v{number}")) == 1
        worker_lost(bench.state, f"x{number}", bench.now_ns)
        _vanish(bench, f"v{number}")
    (end,) = bench.facts(CaseEnded)
    assert end.reason == "quarantined: lost with its worker 12 times"


def test_attempts_max_is_the_limit_of_losses_as_well() -> None:
    bench = Bench(Config(folder="/state", losses_min=1))
    bench.ask(submit(cases=1, attempts_max=2))
    for number in range(2):
        assert not bench.facts(CaseEnded)
        bench.ask(hello(f"v{number}"))
        bench.lease(f"v{number}")
        _vanish(bench, f"v{number}")
        bench.now_ns += 4 * bench.config.ttl_ns + S
    assert len(bench.facts(CaseEnded)) == 1


def test_new_suspects_never_join_a_group_that_still_waits() -> None:
    """A half that is given back and dies later gets numbers that no other half has."""
    bench = started(cases=8)
    _die(bench, bench.lease(k=8))
    first = bench.lease(k=8)
    assert _names(first) == ["repeat_0", "repeat_1", "repeat_2", "repeat_3"]
    bench.next(k=0, ended=[ended(lease, "walltime") for lease in first])
    _die(bench, bench.lease(k=8))
    sets = []
    while leases := bench.lease(k=8):
        sets.append([int(name[-1]) for name in _names(leases)])
        bench.next(k=0, results=[result(lease) for lease in leases])
    assert sorted(sets) == [[0, 1], [2, 3], [4, 5, 6, 7]]


def test_a_flaky_worker_that_comes_back_is_one_witness_however_often() -> None:
    """The same worker falls silent three times with a case while all others live."""
    bench = started(cases=1, workers=1)
    bench.ask(hello("watcher", software="beef"))
    for number in range(1, 5):
        (lease,) = bench.lease("w1")
        _vanish(bench, "w1")
        bench.beat("w1")  # it was only slow
        assert [end.evidence for end in bench.facts(AttemptEnded)] == [True] * number
    assert not bench.facts(CaseEnded)
    (lease,) = bench.lease("w1")
    assert bench.next("w1", k=0, results=[result(lease)]).fenced == []
