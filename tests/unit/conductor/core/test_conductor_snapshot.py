"""Snapshots: when they are taken, what they hold, and journals of version 1."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from conductor_bench import Bench, ended, hello, next_of, result, started, submit

from conductor.core.decisions import close, decide, start
from conductor.core.facts import EpochRaised, Fact, Image, Snapshot
from conductor.core.fold import fold, revive
from conductor.core.invariants import check
from conductor.core.snapshot import take
from conductor.core.state import IMAGE_CASES, Config, State
from conductor.journal.store import Journal
from conductor.records.outcomes import Outcomes, encode_campaign, outcomes_of
from twin.base.errors import UsageError

DATA = Path(__file__).parents[1] / "data"


def _eventful() -> Bench:
    """Two campaigns with something of everything."""
    bench = started(cases=12, workers=3, attempts_max=2, batch={"size": 5})
    bench.ask(submit("beta", cases=2))
    leases = bench.lease("w1", k=6)
    bench.next(
        "w1",
        k=0,
        results=[result(leases[0]), result(leases[1], passed=False, wall_s=3.0)],
        ended=[ended(lease, "suspect", "signal 9") for lease in leases[2:]],
    )
    (crashed,) = bench.lease("w2")
    bench.next("w2", k=0, ended=[ended(crashed, "crash")])
    bench.next("w2", k=1, results=[result(leases[0], kpi="other")])
    bench.control("pause", case="repeat_7")
    bench.control("cancel", case="repeat_9")
    bench.control("pause", campaign="beta")
    bench.control("drain", worker="w3")
    bench.bye("w1")
    return bench


def _restored(facts: list[Fact]) -> State:
    """What a restart would make of the snapshot alone."""
    images = {
        image.key: image for fact in facts if isinstance(fact, Snapshot) for image in fact.images
    }
    state = fold([Snapshot(images=list(images.values()))], Config(folder="/state"))
    check(state)
    return state


def _no_replies(state: State) -> State:
    for worker in state.workers.values():
        worker.replied = None  # they are kept beside the facts
    return state


def test_a_snapshot_is_the_state() -> None:
    bench = _eventful()
    taken = take(bench.state)
    assert _restored([taken]) == _no_replies(bench.state)


def test_a_later_snapshot_holds_what_changed_only() -> None:
    bench = started(cases=2 * IMAGE_CASES + 1)
    bench.config = bench.state.config
    facts: list[Fact] = [take(bench.state)]
    assert [image.key for image in facts[0].images] == ["0", "1/000000"]  # type: ignore[union-attr]
    bench._keep(close_at(bench, 0))
    bench.control("cancel", case=f"repeat_{IMAGE_CASES}")
    later = close_at(bench, 0)
    assert [image.key for image in later[0].images] == ["0", "2/alpha/000001"]  # type: ignore[union-attr]
    assert _restored([*facts, *later]) == _no_replies(bench.state)


def close_at(bench: Bench, facts: int) -> list[Fact]:
    """The facts of a clean end if ``facts`` are worth a snapshot."""
    bench.state.config = replace(bench.state.config, snapshot_close_facts=facts)
    return close(bench.state)


@pytest.mark.parametrize(("limit", "taken"), [(4, True), (5, False)])
def test_the_number_of_facts_is_exact(limit: int, taken: bool) -> None:
    bench = Bench(Config(folder="/state", snapshot_facts=limit))  # 1: the epoch
    bench.ask(submit(cases=2))
    bench.ask(hello())
    assert not bench.facts(Snapshot)
    bench.control("pause")
    assert bool(bench.facts(Snapshot)) == taken
    assert bench.state.tail == (0 if taken else 4)


@pytest.mark.parametrize(("facts", "taken"), [(3, True), (4, False)])
def test_a_clean_end_takes_one_if_it_is_worth_it(facts: int, taken: bool) -> None:
    bench = started(cases=2)
    assert bench.state.tail == 3
    assert bool(close_at(bench, facts)) == taken


def test_the_journal_keeps_the_snapshot_and_what_came_after(tmp_path: Path) -> None:
    config = Config(folder="/state", snapshot_facts=10)
    bench = Bench(config)
    journal = Journal(tmp_path)
    mark = 0

    def keep() -> None:
        nonlocal mark
        journal.append(bench.journal[mark:])
        mark = len(bench.journal)

    bench.ask(submit(cases=9))
    bench.ask(hello())
    keep()
    leases = bench.lease(k=5)
    keep()
    bench.next(k=3, results=[result(lease) for lease in leases])
    keep()
    bench.next(k=0, held=[9])
    keep()
    assert len(bench.facts(Snapshot)) == 1
    journal.close()
    journal = Journal(tmp_path)
    found = list(journal.fold())
    assert isinstance(found[0], Snapshot)
    assert len(found) < 10
    state = fold(found, config)
    assert state == bench.state
    assert state.tail == bench.state.tail
    # The same answer to the same request, though its leases are references now.
    journal.append(start(state))
    revive(state, bench.now_ns)
    journal.close()
    again = next_of("w1", bench.seqs["w1"], 0, held=[9])
    _, reply = decide(state, again, bench.now_ns)
    assert (reply.error, reply.seq) == ("", again.seq)


def test_a_damaged_image_is_an_error(tmp_path: Path) -> None:
    state = started().state
    taken = take(state)
    bad = Snapshot(images=[Image(image.key, image.data[:-3]) for image in taken.images])
    with pytest.raises(msgspec.MsgspecError):
        fold([bad])
    with pytest.raises(AssertionError, match="without its head"):
        fold([Snapshot(images=[])])


def test_what_the_first_stage_has_begun_is_left_to_it(tmp_path: Path) -> None:
    shutil.copy(DATA / "journal-v1.db", tmp_path / "conductor.db")
    with pytest.raises(UsageError, match=r"begun by drivetwin 0\.1 \(version 1 of the journal"):
        Journal(tmp_path)


@pytest.mark.parametrize("cases", [1, 12])
def test_outcomes_are_written_line_by_line(cases: int) -> None:
    alpha = (_eventful() if cases > 1 else started(cases=1)).state.campaigns["alpha"]
    text = bytes(encode_campaign(alpha))
    assert msgspec.json.decode(text, type=Outcomes) == outcomes_of(alpha)
    assert len([line for line in text.splitlines() if b'"outcome":' in line]) == cases


def test_a_moved_state_folder_takes_its_campaigns_along_also_through_a_snapshot() -> None:
    config = Config(folder="/one", snapshot_close_facts=0)
    bench = Bench(config)
    for name, out in (("alpha", "/one"), ("beta", "/one/beta"), ("gamma", "/one-more/gamma")):
        assert not bench.ask(submit(name, out=out)).error
    facts = [*bench.journal, *close(bench.state)]
    there = replace(config, folder="/two")
    state = fold(facts[-1:], there)
    facts = [*facts[-1:], *start(state)]
    outs = ["/two", "/two/beta", "/one-more/gamma"]
    assert [c.out for c in state.campaigns.values()] == outs
    images = {
        image.key: image for fact in facts if isinstance(fact, Snapshot) for image in fact.images
    }
    images |= {image.key: image for image in take(state).images}
    again = fold([Snapshot(images=list(images.values()))], there)
    assert again == state
    assert [c.out for c in again.campaigns.values()] == outs
    assert not any(isinstance(f, EpochRaised) and f.before for f in start(again))
