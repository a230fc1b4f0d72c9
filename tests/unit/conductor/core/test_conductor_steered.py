"""What the conductor makes of hands on running cases."""

from __future__ import annotations

from pathlib import Path

from conductor_bench import S, ended, result, started

from conductor.core.facts import AttemptEnded, CaseEnded, Intervention, Snapshot
from conductor.core.fold import fold
from conductor.core.settle import STEERED_MAX
from conductor.core.snapshot import take
from conductor.records.outcomes import outcomes_of
from conductor.serve.folders import Folders
from schemas import SCHEMA_VERSION
from schemas.wire.control import Beat, Touch

PAUSE = Touch(40, "pause", 0)
FOG = Touch(41, "environment weather=heavy_fog", 1)


def test_a_touch_is_a_fact_once_and_the_case_is_run_again_uncharged(tmp_path: Path) -> None:
    bench = started(cases=1)
    (lease,) = bench.lease()

    def beat(touch: Touch, token: int = lease.token) -> None:
        touched = {str(token): touch}
        bench.ask(Beat(v=SCHEMA_VERSION, worker="w1", held={str(lease.token): 41}, touched=touched))

    beat(PAUSE)
    assert bench.explain("repeat_0")[1] == (
        "steered by hand: pause at tick 40; it keeps its verdict"
    )
    beat(FOG)
    beat(FOG)  # a reply was lost
    beat(FOG, token=lease.token + 1)  # not its own
    beat(Touch(41, "x" * 5000, 2))
    beat(Touch(41, "x" * 5000, 2))
    assert [fact.what[:5] for fact in bench.facts(Intervention)] == ["pause", "envir", "xxxxx"]
    assert len(bench.explain("repeat_0")[1]) < 400
    detail = "steered by hand, 2 changes"
    (again,) = bench.lease(ended=[ended(lease, "intervened", detail)])
    assert (again.case, again.attempt, again.alone) == (lease.case, 2, False)
    assert not bench.facts(AttemptEnded)[0].charged
    assert "no verdict of attempt 1: steered by hand, 2 changes" in bench.explain("repeat_0")
    # A restart knows it, also from a snapshot.
    images: Snapshot = take(bench.state)
    assert fold([images], bench.config).campaigns == bench.state.campaigns
    bench.next(results=[result(again, attempt_dir="cases/repeat_0/attempt-2")], k=0)
    campaign = bench.state.campaigns["alpha"]
    row = outcomes_of(campaign).cases["repeat_0"]
    assert (row.attempts, row.charges, row.steered) == (2, [], [f"attempt 1: {detail}"])
    # What was done by hand is evidence; what a killed rig left is not, but for the stack's words.
    campaign.out = str(tmp_path)
    for number in (1, 2, 3, 4):
        (tmp_path / f"cases/repeat_0/attempt-{number}").mkdir(parents=True)
        (tmp_path / f"cases/repeat_0/attempt-{number}/drive.record").touch()
    (tmp_path / "cases/repeat_0/attempt-4/log.txt").touch()
    campaign.cases["repeat_0"].attempts += 2
    Folders(tmp_path).sweep(campaign)
    left = sorted("/".join(path.parts[-2:]) for path in tmp_path.glob("cases/repeat_0/*/*"))
    assert left == ["attempt-1/drive.record", "attempt-2/drive.record", "attempt-4/log.txt"]
    assert not (tmp_path / "cases/repeat_0/attempt-3").exists()


def test_a_script_that_steers_every_attempt_does_not_keep_a_case_for_ever() -> None:
    bench = started(cases=1, attempts_max=1)
    for _ in range(2):
        before = len(bench.facts(CaseEnded))
        for _ in range(STEERED_MAX):
            assert len(bench.facts(CaseEnded)) == before
            (lease,) = bench.lease()
            bench.next(k=0, ended=[ended(lease, "intervened", "steered by hand, 1 changes")])
        end = bench.facts(CaseEnded)[-1]
        assert end.outcome == "unresolved"
        assert end.reason.endswith(
            f"attempts were steered by hand, the last one: attempt {lease.attempt}: "
            "steered by hand, 1 changes"
        )
        assert bench.lease() == []
        assert not bench.control("retry", "alpha").error


def test_a_case_that_somebody_looks_at_gets_no_second_lease() -> None:
    bench = started(cases=1, workers=2)
    (lease,) = bench.lease("w1")
    held = {str(lease.token): 40}
    bench.ask(Beat(v=SCHEMA_VERSION, worker="w1", held=held, touched={str(lease.token): PAUSE}))
    bench.now_ns += bench.config.ttl_ns // 2 + 1
    assert not bench.lease("w2")
    bench.now_ns += S
    bench.ask(Beat(v=SCHEMA_VERSION, worker="w1", held=held))
    assert lease.token in bench.state.leases, "a pause ends no lease"


def test_a_touch_says_what_it_means_and_of_which_case() -> None:
    bench = started(cases=2)
    first, second = bench.lease(k=2)
    held = {str(lease.token): 41 for lease in (first, second)}
    for touch in (PAUSE, FOG):
        touched = {str(second.token): touch}
        bench.ask(Beat(v=SCHEMA_VERSION, worker="w1", held=held, touched=touched))
    assert [(fact.campaign, fact.case) for fact in bench.facts(Intervention)] == [
        ("alpha", second.case.id),
        ("alpha", second.case.id),
    ]
    assert bench.state.leases[second.token].touched == (
        "environment weather=heavy_fog at tick 41; no verdict, changes: 1"
    )
    assert bench.state.leases[first.token].touched == ""
    assert bench.state.leases[first.token].progress == 41
