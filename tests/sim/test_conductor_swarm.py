"""Seeded fault swarm around the conductor's engine, and proof that it catches planted bugs.

``SWARM_SEED=17`` runs one seed; ``SWARM_SEEDS=5000`` runs that many.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest
from conductor_swarm import Swarm

import conductor.core.control
import conductor.core.decisions
import conductor.core.fold
import conductor.core.grant
import conductor.core.settle
from conductor.core.facts import SHARED, Committed, Fact, Retried, Snapshot, WorkerLeft
from conductor.core.lease import Policy
from conductor.core.session import issued_to
from conductor.core.state import CaseState, LiveLease, State, WorkerState
from conductor.core.turn import RequestTurn as CoreTurn
from conductor.journal.store import JournalError
from conductor.serve.engine import ConductorEngine, TurnResult
from schemas.wire.control import Result

SEEDS = int(os.environ.get("SWARM_SEEDS", "300"))
BUG_SEEDS = 60
"""A planted bug must show within this many seeds."""


def _run(seed: int) -> Swarm:
    try:
        return Swarm(seed).run()
    except Exception as error:
        raise AssertionError(f"seed {seed}: {error} (SWARM_SEED={seed} runs it alone)") from error


def test_every_case_ends_exactly_once_in_the_first_seeds() -> None:
    assert sum(_run(seed).counts["requests"] for seed in range(20)) > 200


@pytest.mark.slow
def test_every_case_ends_exactly_once_whatever_fails() -> None:
    counts: Counter[str] = Counter()
    facts: Counter[str] = Counter()
    only = os.environ.get("SWARM_SEED")
    for seed in [int(only)] if only else range(SEEDS):
        swarm = _run(seed)
        counts += swarm.counts
        facts += swarm.oracle.kinds
    if only:
        return
    # A swarm that never drove a path proves nothing about it.
    driven = ["requests", "conductor_deaths", "byes", "drained"]
    driven += [
        "avoided_hosts",
        "spooled",
        "snapshots",
        "poisoned_workers",
        "rigs_died_with_several",
    ]
    for name in (*Swarm(0).rates.__dataclass_fields__, *driven):
        assert counts[name] > 0, f"no {name} in {SEEDS} seeds: {counts}"
    kinds = {"EpochRaised", "Submitted", "Pinned", "WorkerJoined", "WorkerLeft", "Leased"}
    kinds |= {"Committed", "AttemptEnded", "CaseEnded", "LateAttempt"}
    kinds |= {"WorkerDraining", "Paused", "Retried", "speculative", "in_halves", "evidence"}
    kinds |= {"cancelled", "unresolved", "quarantined_by_losses", "forgotten"}
    assert set(facts) == kinds, f"facts never made: {kinds - set(facts)}"


def test_the_same_seed_is_the_same_run() -> None:
    first, second = Swarm(7).run(), Swarm(7).run()
    assert first.disk.facts == second.disk.facts
    assert first.counts == second.counts


def _caught() -> str:
    for seed in range(BUG_SEEDS):
        try:
            Swarm(seed).run()
        except AssertionError as error:
            return str(error)
    return ""


def test_planted_a_stale_token_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    commit = conductor.core.settle.commit

    def forgiving(turn: CoreTurn, result: Result, worker: WorkerState) -> bool:
        case = turn.state.case((result.campaign, result.case))
        if case is not None and case.end is None and issued_to(case, worker, result.token):
            name = worker.joined.worker
            turn.emit(Committed(result=result, worker=name, device_class="cpu:avx2", attempt=1))
            return True
        return commit(turn, result, worker)

    def committed(state: Any, fact: Committed) -> None:
        campaign, case = conductor.core.fold._find(state, fact.result.campaign, fact.result.case)
        conductor.core.fold._end(state, campaign, case, fact)
        campaign.durations.add(fact.result.wall_s)

    monkeypatch.setattr(conductor.core.decisions, "commit", forgiving)
    monkeypatch.setitem(conductor.core.fold._FOLDS, Committed, committed)
    assert "committed with a dead token" in _caught()


def test_planted_leases_never_expire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.core.decisions, "expire", lambda turn: None)
    assert "never ended" in _caught()


def test_planted_suspects_are_charged(monkeypatch: pytest.MonkeyPatch) -> None:
    charged = Policy(charged=True, alone=True)
    monkeypatch.setitem(conductor.core.settle.POLICIES, "suspect", charged)
    assert "a suspect is charged" in _caught()


@pytest.mark.slow
def test_planted_suspects_are_not_separated(monkeypatch: pytest.MonkeyPatch) -> None:
    def together(turn: CoreTurn, leases: Sequence[LiveLease], reason: Any, detail: str) -> None:
        for lease in leases:
            conductor.core.settle._emit_end(turn, lease, reason, detail, SHARED)

    monkeypatch.setattr(conductor.core.decisions, "end_suspects", together)
    monkeypatch.setattr(conductor.core.settle, "end_suspects", together)
    assert "never ended" in _caught()


def test_planted_halves_share_a_rig_with_others(monkeypatch: pytest.MonkeyPatch) -> None:
    fill = conductor.core.grant._fill

    def generous(asker: Any, ranked: Any, rig: str, group: int, count: int) -> list[CaseState]:
        cases = fill(asker, ranked, rig, group, count)
        return cases + fill(asker, ranked, rig, SHARED, count - len(cases)) if group else cases

    monkeypatch.setattr(conductor.core.grant, "_fill", generous)
    assert "mixes groups" in _caught()


def test_planted_a_case_that_kills_workers_is_never_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.core.settle, "_judge_loss", lambda turn, lease: None)
    assert "never ended" in _caught()


def test_planted_the_loser_of_a_race_stays_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    def committed(state: Any, fact: Committed) -> None:
        campaign, case = conductor.core.fold._find(state, fact.result.campaign, fact.result.case)
        others = tuple(token for token in case.live if token != fact.result.token)
        case.live = (fact.result.token,)
        conductor.core.fold._end(state, campaign, case, fact)
        case.live = others
        campaign.durations.add(fact.result.wall_s)

    monkeypatch.setitem(conductor.core.fold._FOLDS, Committed, committed)
    found = _caught()
    assert "ended and leased" in found or "contradicted itself" in found


def test_planted_a_race_has_no_end_of_runners(monkeypatch: pytest.MonkeyPatch) -> None:
    def anyone(state: State, request: Any, worker: Any, now_ns: int) -> CaseState | None:
        if request.held or request.k < 1:
            return None
        leases = [x for x in state.leases.values() if x.worker != worker.joined.worker]
        every = [state.campaigns[x.key[0]].cases[x.key[1]] for x in leases]
        cases = [case for case in every if case.group == SHARED]
        return next((case for case in cases if len(case.live) == 2), None) or next(
            iter(cases), None
        )

    monkeypatch.setattr(conductor.core.decisions, "straggler", anyone)
    assert "the core contradicted itself" in _caught()


def test_planted_a_snapshot_forgets_what_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    def short(state: State) -> Snapshot:
        images = take(state).images
        return Snapshot(images=[image for image in images if not image.key.startswith("2/")])

    take = conductor.core.decisions.take
    monkeypatch.setattr(conductor.core.decisions, "take", short)
    assert _caught()  # by whatever finds the contradiction first


def test_planted_a_result_is_retried(monkeypatch: pytest.MonkeyPatch) -> None:
    def retry(turn: CoreTurn, campaign: Any, case: Any) -> tuple[str, int]:
        if case is not None and case.end is not None:
            turn.emit(Retried(campaign="alpha", case=case.case.id))
        return "", 1

    monkeypatch.setattr(conductor.core.control, "_retry", retry)
    assert "the core contradicted itself" in _caught()


def test_planted_memory_runs_ahead_of_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ConductorEngine, "_refold", lambda self: None)
    assert "memory is not the disk" in _caught()


def test_planted_replies_before_the_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(
        self: ConductorEngine, decided: Sequence[tuple[list[Fact], bytes | None]]
    ) -> TurnResult:
        facts = [fact for made, _ in decided for fact in made]
        try:
            self._journal.append(facts)
        except JournalError as error:
            self._storage_failed(error)
        return TurnResult([reply for _, reply in decided], facts)

    monkeypatch.setattr(ConductorEngine, "_commit", hasty)
    assert "not on disk" in _caught()


def test_planted_a_repeated_request_is_decided_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def forget(state: Any, fact: Any) -> None:
        apply(state, fact)
        for worker in state.workers.values():
            worker.replied = None

    apply = conductor.core.fold.apply
    monkeypatch.setattr("conductor.core.turn.apply", forget)
    monkeypatch.setattr("conductor_swarm.Swarm._compare", lambda self: None)
    assert "two answers" in _caught()


def test_planted_a_broken_host_is_never_forgiven(monkeypatch: pytest.MonkeyPatch) -> None:
    def strict(state: State, campaign: Any, worker: Any, now_ns: int) -> bool:
        return conductor.core.grant.broken(state, worker.joined.host)

    monkeypatch.setattr(conductor.core.grant, "shunned", strict)
    # Deaths that a commit does not clear: sooner or later every host is broken.
    monkeypatch.setattr(conductor.core.fold, "_host", lambda state, token: "everywhere")
    monkeypatch.setattr(conductor.core.grant, "broken", lambda state, host: len(state.deaths) > 0)
    assert "never ended" in _caught()


def test_planted_a_worker_with_leases_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(turn: CoreTurn) -> None:
        for name, worker in list(turn.state.workers.items()):
            if turn.now_ns - worker.seen_ns >= turn.state.config.ttl_ns // 4:
                turn.emit(WorkerLeft(worker=name))

    monkeypatch.setattr(conductor.core.decisions, "_forget", hasty)
    assert "contradict" in _caught()
