"""Who gets which case: priority, fair share, walltime, and what people ask for."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import pytest
from conductor_bench import Bench, S, ended, hello, result, started, submit

from conductor.core.backlog import SPREAD_MAX, Backlog
from conductor.core.facts import (
    CaseEnded,
    Committed,
    LateAttempt,
    Leased,
    Replied,
    WorkerDraining,
)
from conductor.core.grant import _preferred
from conductor.core.lease import token_of
from conductor.core.state import Config
from schemas import SCHEMA_VERSION as V
from schemas.wire.control import Lease, Share, Submit


def _prioritised(name: str, priority: int, cases: int = 4, width: int = 640) -> Submit:
    camera = {"width": width}
    return Submit(
        v=V,
        campaign={"campaign": name, "camera": camera, "matrix": {"repeat": list(range(cases))}},
        priority=priority,
    )


def _two_models(config: Config) -> Bench:
    """64 cases, 32 of each model."""
    matrix = {"model": ["slow", "quick"], "repeat": list(range(32))}
    perception = {name: {"type": "ground_truth"} for name in matrix["model"]}
    data = {"campaign": "alpha", "autonomy": {"perception": perception}, "matrix": matrix}
    bench = Bench(config)
    bench.ask(Submit(v=V, campaign=data))
    return bench


def _models(leases: Sequence[Lease]) -> dict[str, int]:
    return dict(Counter(lease.case.id.partition("-")[0] for lease in leases))


def _campaigns(leases: list[Lease]) -> list[str]:
    return [lease.case.variation.campaign for lease in leases]


def test_a_higher_priority_comes_first() -> None:
    bench = Bench()
    for name, priority in (("low", -1), ("first", 0), ("second", 0), ("high", 7)):
        bench.ask(_prioritised(name, priority, cases=2))
    bench.ask(hello())
    names = _campaigns(bench.lease(k=8))
    assert names == ["high", "high", "first", "second", "first", "second", "low", "low"]


def test_a_rig_runs_dry_for_a_higher_priority_that_it_does_not_fit() -> None:
    bench = Bench()
    bench.ask(_prioritised("low", 0))
    bench.ask(hello())
    leases = bench.lease(k=2)
    held = [lease.token for lease in leases]
    bench.ask(_prioritised("high", 1, width=320))
    assert bench.lease(k=2, held=held) == []
    assert bench.lease(k=3, held=held[:1], results=[result(leases[1])]) == []
    assert _campaigns(bench.lease(k=4, results=[result(leases[0])], rig="any")) == ["high"] * 4


def test_equals_share_the_workers_without_restarting_rigs_for_it() -> None:
    bench = Bench()
    bench.ask(_prioritised("one", 0, cases=99))
    held: dict[str, list[Lease]] = {}
    for number in range(4):
        bench.ask(hello(f"w{number}", slots=1))
        held[f"w{number}"] = bench.lease(f"w{number}")
    bench.ask(_prioritised("two", 0, cases=99, width=320))
    for _ in range(5):
        for worker, leases in held.items():
            rig = bench.state.campaigns[leases[0].case.variation.campaign].ordered[0].rig
            held[worker] = bench.lease(worker, results=[result(leases[0])], rig=rig)
    now = [leases[0].case.variation.campaign for leases in held.values()]
    assert sorted(now) == ["one", "one", "two", "two"]
    attempts = bench.facts(Leased)
    switches = sum(
        a.campaign != b.campaign
        for worker in held
        for mine in [[fact for fact in attempts if fact.worker == worker]]
        for a, b in itertools.pairwise(mine)
    )
    assert switches == 2


def test_one_worker_ends_a_campaign_before_it_restarts_for_the_next() -> None:
    bench = Bench()
    bench.ask(_prioritised("one", 0, cases=3))
    bench.ask(_prioritised("two", 0, cases=3, width=320))
    bench.ask(hello(slots=1))
    order = []
    leases = bench.lease()
    while leases:
        order += _campaigns(leases)
        rig = bench.state.campaigns[order[-1]].ordered[0].rig
        leases = bench.lease(results=[result(leases[0])], rig=rig)
    assert order == ["one"] * 3 + ["two"] * 3


@pytest.mark.parametrize(("remaining_s", "granted"), [(20.0, False), (20.001, True), (None, True)])
def test_a_case_must_fit_into_the_walltime(remaining_s: float | None, granted: bool) -> None:
    bench = started(cases=2)
    (lease,) = bench.lease()
    # 0.001 s * 2^(n/4) is 10 s for no whole n: a limit that is met exactly needs a power.
    wall_s = 0.001 * 2.0**13
    bench.next(k=0, results=[result(lease, wall_s=wall_s)])
    assert bench.state.campaigns["alpha"].durations.p95_s() == wall_s
    margin_s = 20.0 - wall_s
    bench.state.config = Config(folder="/state", walltime_margin_s=margin_s)
    assert bool(bench.lease(remaining_s=remaining_s)) == granted
    if not granted:
        assert "walltime left" in bench.explain("repeat_1")[0]


@pytest.mark.parametrize(("remaining_s", "granted"), [(10.0, False), (10.001, True)])
def test_without_an_estimate_only_the_margin_counts(remaining_s: float, granted: bool) -> None:
    assert bool(started().lease(remaining_s=remaining_s)) == granted


def test_a_paused_campaign_grants_nothing_and_goes_on_later() -> None:
    bench = started(cases=2)
    (lease,) = bench.lease()
    for changed in (2, 0):
        assert bench.control("pause").status == {"changed": changed}
    reply = bench.next(results=[result(lease)])
    assert (reply.leases, reply.acks, reply.fenced) == ([], [lease.token], [])
    bench.restart()
    assert bench.lease() == []
    assert bench.explain("repeat_1")[0] == "waits: the campaign is paused"
    assert bench.status()["campaigns"]["alpha"]["paused"] is True
    bench.control("resume")
    assert len(bench.lease()) == 1


def test_a_paused_case_is_passed_over() -> None:
    bench = started(cases=3, workers=2)
    (lease,) = bench.lease("w2")
    bench.control("pause", case="repeat_0")
    bench.control("pause", case="repeat_1")
    assert [x.case.id for x in bench.lease(k=4)] == ["repeat_2"]
    bench.next("w2", k=0, ended=[ended(lease, "released")])
    assert bench.state.campaigns["alpha"].waiting == 2
    assert bench.lease("w2", k=4) == []
    bench.restart()
    bench.control("resume", case="repeat_0")
    assert [x.case.id for x in bench.lease("w2", k=4)] == ["repeat_0"]


def test_cancel_ends_what_has_not_ended_and_fences_what_runs() -> None:
    bench = started(cases=4)
    done, running = bench.lease(k=2)
    bench.next(k=0, results=[result(done)], held=[running.token])
    assert bench.control("cancel").status == {"changed": 3}
    assert bench.control("cancel").status == {"changed": 0}
    assert {end.outcome for end in bench.facts(CaseEnded)} == {"cancelled"}
    assert bench.beat("w1", running.token).lost == [running.token]
    assert bench.next(k=0, results=[result(running)]).fenced == [running.token]
    assert len(bench.facts(Committed)) == 1
    assert len(bench.facts(LateAttempt)) == 1
    counts = bench.status()["campaigns"]["alpha"]
    assert (counts["cancelled"], counts["left"], counts["waiting"]) == (3, 0, 0)


def test_retry_brings_back_what_has_no_result() -> None:
    bench = started(cases=3, attempts_max=1)
    a, b = bench.lease(k=2)
    bench.next(k=0, results=[result(a)], ended=[ended(b, "crash")])
    bench.control("cancel", case="repeat_2")
    assert bench.state.left == 0
    assert "committed result, which stays" in bench.control("retry", case="repeat_0").error
    assert bench.control("retry").status == {"changed": 2}
    assert bench.state.left == 2
    bench.restart()
    leases = bench.lease(k=3)
    assert [(x.case.id, x.attempt, x.alone) for x in leases] == [
        ("repeat_1", 2, False),
        ("repeat_2", 1, False),
    ]
    assert bench.next(k=0, results=[result(x) for x in leases]).left == 0
    # A late result of the attempt before the retry stays evidence.
    assert bench.next(k=0, results=[result(b)]).fenced == [b.token]


def test_retry_of_what_has_not_ended_changes_nothing() -> None:
    bench = started(cases=1)
    assert bench.control("retry", case="repeat_0").status == {"changed": 0}


def test_a_retried_batch_is_open_again() -> None:
    bench = Bench(Config(folder="/state", by_batch=True))
    bench.ask(submit(cases=4, batch={"size": 2}))
    bench.ask(hello())
    bench.control("cancel", case="repeat_0")
    bench.control("cancel", case="repeat_1")
    (later,) = bench.lease(k=1)
    assert later.case.variation.batch == 2
    bench.control("retry", case="repeat_1")
    assert [x.case.id for x in bench.lease(k=4, held=[later.token])] == ["repeat_1"]
    assert "waits: batch 2 is not open" in bench.explain("repeat_3")[0]


def test_a_drained_worker_is_told_and_gets_nothing_more() -> None:
    bench = started(workers=2)
    (lease,) = bench.lease("w1")
    assert bench.control("drain", worker="w1").status == {"changed": 1}
    assert bench.control("drain", worker="w1").status == {"changed": 0}
    assert bench.beat("w1", lease.token).drain
    assert not bench.beat("w2").drain
    bench.restart()
    reply = bench.next("w1", k=3, held=[lease.token])
    assert (reply.drain, reply.leases) == (True, [])
    assert len(bench.lease("w2", k=9)) == 3
    assert len(bench.facts(WorkerDraining)) == 1
    assert bench.next("w1", k=0, results=[result(lease)]).fenced == []


@pytest.mark.parametrize(
    ("action", "fields", "error"),
    [
        ("pause", {"campaign": "omega"}, "no campaign 'omega' here; campaigns: alpha"),
        ("cancel", {"case": "x"}, "alpha: no case 'x' here; cases: repeat_0, repeat_1"),
        ("drain", {"worker": "w9"}, "no worker 'w9' here; workers: w1"),
    ],
)
def test_names_that_do_not_exist(action: str, fields: dict[str, str], error: str) -> None:
    assert started(cases=2).control(action, **fields).error == error


@pytest.mark.parametrize("action", ["pause", "resume", "cancel"])
def test_what_has_ended_stays(action: str) -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()
    bench.next(k=0, results=[result(lease)])
    assert "has ended" in bench.control(action, case="repeat_0").error


def test_time_is_no_argument_for_cancelled_and_unknown_cases() -> None:
    bench = started(cases=1)
    bench.now_ns += 10 * S
    assert "no case 'x' of a campaign 'alpha'" in bench.ask_explain("x").error


def test_workers_that_begin_get_mixtures_where_that_is_wished() -> None:
    bench = _two_models(Config(folder="/state", spread=True))
    seen: list[str] = []
    for number in range(4):
        worker = f"w{number}"
        bench.ask(hello(worker, slots=16))
        leases = bench.lease(worker, k=16)
        seen += [lease.case.id for lease in leases]
        models = _models(leases)
        assert len(models) == 2
        assert min(models.values()) >= 6
    assert len(set(seen)) == 64


def test_a_running_rig_is_refilled_in_order() -> None:
    bench = Bench(Config(folder="/state", spread=True))
    bench.ask(submit(cases=40))
    bench.ask(hello(slots=8))
    leases = bench.lease(k=8)
    ids = [lease.case.id for lease in leases]
    assert ids != [f"repeat_{i}" for i in range(8)]
    waiting = [f"repeat_{i}" for i in range(40) if f"repeat_{i}" not in ids]
    held = [lease.token for lease in leases[2:]]
    more = bench.lease(k=2, held=held, results=[result(lease) for lease in leases[:2]])
    assert [lease.case.id for lease in more] == waiting[:2]


@pytest.mark.parametrize("config", [Config(), Config(spread=True, by_batch=True)])
def test_neighbours_stay_together_otherwise(config: Config) -> None:
    bench = Bench(replace(config, folder="/state"))
    bench.ask(submit(cases=40))
    bench.ask(hello(slots=8))
    ids = [lease.case.id for lease in bench.lease(k=8)]
    assert ids == [bench.state.campaigns["alpha"].ordered[i].case.id for i in range(8)]


def test_mixtures_keep_priority_and_fair_share() -> None:
    bench = Bench(Config(folder="/state", spread=True))
    for name, priority in (("one", 0), ("two", 0), ("high", 1)):
        bench.ask(_prioritised(name, priority, cases=30 if priority == 0 else 2))
    bench.ask(hello(slots=12))
    names = _campaigns(bench.lease(k=12))
    assert names == ["high", "high", *["one", "two"] * 5]


def test_workers_of_a_device_get_stretches_and_devices_get_the_same() -> None:
    """Whoever comes first."""
    bench = _two_models(Config(folder="/state", spread=True))
    shares = [Share(stretch, 2, device, 2) for device in range(2) for stretch in range(2)]
    seen: dict[str, set[str]] = {}
    for number in (2, 0, 3, 1):
        worker = f"w{number}"
        bench.ask(hello(worker, slots=16, share=shares[number]))
        leases = bench.lease(worker, k=16)
        model = "slow" if shares[number].stretch == 0 else "quick"
        assert _models(leases)[model] >= 15  # dealt out by a sequence that is even, not exact
        seen[worker] = {lease.case.id for lease in leases}
    assert len(set.union(*seen.values())) == 64
    repeats = sorted(int(name.rpartition("_")[2]) for name in seen["w0"])
    assert min(repeats) < 4
    assert max(repeats) > 27


def test_a_rig_is_refilled_from_its_share_and_then_from_others() -> None:
    bench = _two_models(Config(folder="/state"))
    bench.ask(hello(slots=4, share=Share(1, 2, 1, 2)))
    leases = bench.lease(k=4)
    names = [lease.case.id for lease in leases]
    while leases:
        ended = leases.pop()
        held = [lease.token for lease in leases]
        more = bench.lease(k=1, held=held, results=[result(ended)])
        names += [lease.case.id for lease in more]
        leases += more
    assert len(set(names)) == 64
    assert [name.partition("-")[0] for name in names] == ["quick"] * 32 + ["slow"] * 32


def test_shares_leave_batches_in_order() -> None:
    bench = Bench(Config(folder="/state", by_batch=True))
    bench.ask(submit(cases=40))
    bench.ask(hello(slots=8, share=Share(1, 2, 0, 1)))
    ids = [lease.case.id for lease in bench.lease(k=8)]
    assert ids == [f"repeat_{i}" for i in range(8)]


@pytest.mark.parametrize("huge", [2, 10**18])
def test_a_share_looks_at_so_many_cases_and_no_more(huge: int) -> None:
    """A conductor has one thread; what a worker says of itself must not hold it up."""
    bench = Bench(Config(folder="/state"))
    bench.ask(submit(cases=40))
    bench.ask(hello(slots=8, share=Share(huge - 1, huge, huge - 1, huge)))
    campaign = bench.state.campaigns["alpha"]
    share = bench.state.workers["w1"].joined.share
    assert share is not None
    seen: list[int] = []

    class Endless(Backlog):
        def take(self, rig: str, group: int, begin: int = 0) -> Iterator[int]:
            return (seen.append(order) or order for order in itertools.count(begin))

    lane = _preferred(replace(campaign, backlog=Endless()), share, "rig", 8)
    assert len(list(lane)) == 8
    assert len(seen) <= SPREAD_MAX
    assert len(bench.lease(k=8)) == 8


@pytest.mark.parametrize("share", [(0, 0, 0, 1), (2, 2, 0, 1), (-1, 2, 0, 1), (0, 1, 1, 1)])
def test_a_share_that_cannot_be_is_refused(share: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="both count from 0"):
        Share(*share)


def _two_rigs(own: int, others: int, priority: int = 0) -> Bench:
    """w1 holds ``own`` cases of ``here`` and w2 ``others``; ``there`` has another rig and waits."""
    bench = Bench()
    bench.ask(_prioritised("here", 0, cases=20))
    bench.ask(hello("w1"))
    bench.ask(hello("w2"))
    bench.lease("w1", k=own)
    if others:
        bench.lease("w2", k=others)
    bench.ask(_prioritised("there", priority, cases=4, width=320))
    return bench


@pytest.mark.parametrize(
    ("others", "priority", "refilled"), [(0, 0, True), (8, 0, False), (8, -1, True)]
)
def test_a_rig_is_given_up_only_for_who_has_too_little_of_the_others(
    others: int, priority: int, refilled: bool
) -> None:
    """What this rig itself runs does not count against its campaign, and nobody gives way to a
    lower priority."""
    bench = _two_rigs(4, others, priority)
    own = list(bench.state.workers["w1"].tokens)
    names = _campaigns(bench.lease("w1", k=1, held=own))
    assert names == (["here"] if refilled else [])


def test_a_case_that_was_paused_when_it_was_cancelled_waits_after_a_retry() -> None:
    bench = started(cases=1)
    bench.control("pause", case="repeat_0")
    bench.control("cancel", case="repeat_0")
    assert bench.control("retry", case="repeat_0").status["changed"] == 1
    assert [lease.case.id for lease in bench.lease("w1")] == ["repeat_0"]


def test_the_cases_of_all_campaigns_count_against_the_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("conductor.core.admit.CASES_HELD_MAX", 6)
    bench = started(cases=4)
    assert not bench.ask(submit("beta", cases=2)).error
    error = bench.ask(submit("gamma", cases=1)).error
    assert "gamma: 6 cases are here, 1 more given, at most 6; start another conductor" in error


def test_a_rig_is_shared_by_campaigns_that_fit_it() -> None:
    """Nobody has to give it up: the one with fewer cases under way is served."""
    bench = Bench()
    bench.ask(_prioritised("here", 0, cases=20))
    bench.ask(hello("w1"))
    bench.ask(hello("w2"))
    (held,) = bench.lease("w1", k=1)
    bench.lease("w2", k=8)
    bench.ask(_prioritised("there", 0, cases=4))
    assert _campaigns(bench.lease("w1", k=2, held=[held.token])) == ["there", "there"]


@pytest.mark.parametrize("stretch", [0, 1, 2])
def test_a_share_is_followed_by_the_next_stretch(stretch: int) -> None:
    bench = Bench()
    bench.ask(submit(cases=9))
    bench.ask(hello(share=Share(stretch, 3, 0, 1)))
    numbers = [int(lease.case.id[-1]) for lease in bench.lease(k=9)]
    assert sorted(numbers) == list(range(9))
    first = [number // 3 for number in numbers]
    assert first == [s % 3 for s in range(stretch, stretch + 3) for _ in range(3)]


def test_why_a_worker_gets_nothing_is_told_to_the_word() -> None:
    bench = started(cases=2)
    bench.lease("w1")
    bench.ask(hello("w2", software="beef" * 10))
    bench.ask(hello("w3", device_class="cuda:H100"))
    for worker, said in (
        (
            "w2",
            "w2: software beefbeefbeef is not the f00d that campaign 'alpha' began with; "
            "it gets no case of it, install the same version",
        ),
        (
            "w3",
            "w3: device class cuda:H100 is not the cpu:avx2 that campaign 'alpha' began with; "
            "it gets no case of it, submit with 'device: any' to mix device classes",
        ),
    ):
        assert bench.next(worker).status == {"notes": [said]}


def test_a_retry_forgets_losses_and_a_refusal_says_nothing_else() -> None:
    bench = started(cases=1)
    bench.lease("w1")
    bench.now_ns += bench.config.ttl_ns
    bench.tick()
    case = bench.state.campaigns["alpha"].cases["repeat_0"]
    assert (case.lost_times, case.lost) == (1, ("w1",))
    bench.control("cancel", case="repeat_0")
    bench.control("retry", case="repeat_0")
    assert (case.lost_times, case.lost, case.losses) == (0, (), ())
    refused = bench.control("pause", case="repeat_9")
    assert refused.error
    assert refused.status == {}


def test_a_reply_with_cases_asks_for_no_patience_and_notes_nothing() -> None:
    bench = started(cases=2)
    bench.ask(hello("w2", software="beef"))
    bench.lease("w1")
    bench.ask(submit("beta", cases=2))
    reply = bench.next("w2")
    assert [lease.case.variation.campaign for lease in reply.leases] == ["beta"]
    assert (reply.retry_after_s, reply.status) == (0.0, {})
    (stored,) = [fact for fact in bench.facts(Replied) if fact.worker == "w2"]
    assert stored.reply.leases == [], "cases are in the journal already"
    assert [granted.campaign for granted in stored.granted] == ["beta"]


def test_a_case_counts_once_for_the_campaign_that_is_due() -> None:
    """``first`` has none under way and ``second`` one: with one more each they are equal."""
    bench = Bench()
    bench.ask(_prioritised("second", 0, cases=4))
    bench.ask(hello("w1"))
    bench.ask(hello("w2"))
    bench.lease("w2")
    bench.ask(_prioritised("third", 0, cases=4))
    assert _campaigns(bench.lease("w1", k=3)) == ["third", "second", "third"]


def test_a_submission_is_answered_with_its_digest() -> None:
    bench = started(cases=1)
    assert bench.ask(submit(cases=1)).status["digest"] == bench.state.campaigns["alpha"].digest


@pytest.mark.parametrize("count", [0, 2**32])
def test_an_epoch_has_so_many_tokens(count: int) -> None:
    with pytest.raises(AssertionError, match=f"lease {count} of one epoch"):
        token_of(1, count)
    assert token_of(1, 2**32 - 1) < token_of(2, 1)
