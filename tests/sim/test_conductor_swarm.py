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

import conductor.core
import conductor.fold
import conductor.settle
from conductor.engine import Engine, Turn
from conductor.facts import Committed, Fact
from conductor.journal import JournalError
from conductor.turn import Turn as CoreTurn
from schemas.messages import Result

SEEDS = int(os.environ.get("SWARM_SEEDS", "200"))
BUG_SEEDS = 60
"""A planted bug must show within this many seeds."""


def _run(seed: int) -> Swarm:
    try:
        return Swarm(seed).run()
    except Exception as error:
        raise AssertionError(f"seed {seed}: {error} (SWARM_SEED={seed} runs it alone)") from error


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
    for name in (*Swarm(0).rates.__dataclass_fields__, "requests", "conductor_deaths", "byes"):
        assert counts[name] > 0, f"no {name} in {SEEDS} seeds: {counts}"
    kinds = {"EpochRaised", "Submitted", "Pinned", "WorkerJoined", "WorkerLeft", "Leased"}
    kinds |= {"Committed", "AttemptEnded", "CaseEnded", "LateAttempt"}
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
    commit = conductor.settle.commit

    def forgiving(turn: CoreTurn, result: Result, worker: str) -> bool:
        case = turn.state.case((result.campaign, result.case))
        if case is not None and case.end is None and result.token in case.issued:
            turn.emit(Committed(result=result, worker=worker, device_class="cpu:avx2", attempt=1))
            return True
        return commit(turn, result, worker)

    def committed(state: Any, fact: Committed) -> None:
        campaign = state.campaigns[fact.result.campaign]
        case = campaign.cases[fact.result.case]
        if not case.live:
            campaign.backlog.remove(case.rig, case.order, case.alone)
        for token in list(case.live):
            conductor.fold._drop(state, campaign, case, token)
        conductor.fold._end(campaign, case, fact)

    monkeypatch.setattr(conductor.core, "commit", forgiving)
    monkeypatch.setattr(conductor.fold, "_committed", committed)
    assert "committed with a dead token" in _caught()


def test_planted_leases_never_expire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.core, "expire", lambda turn: None)
    assert "never ended" in _caught()


def test_planted_memory_runs_ahead_of_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Engine, "_refold", lambda self: None)
    assert "memory is not the disk" in _caught()


def test_planted_replies_before_the_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(self: Engine, decided: Sequence[tuple[list[Fact], bytes | None]]) -> Turn:
        facts = [fact for made, _ in decided for fact in made]
        try:
            self._journal.append(facts)
        except JournalError as error:
            self._storage_failed(error)
        return Turn([reply for _, reply in decided], facts)

    monkeypatch.setattr(Engine, "_commit", hasty)
    assert "not on disk" in _caught()


def test_planted_a_repeated_request_is_decided_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def forget(state: Any, fact: Any) -> None:
        apply(state, fact)
        for worker in state.workers.values():
            worker.replied = None

    apply = conductor.fold.apply
    monkeypatch.setattr("conductor.turn.apply", forget)
    monkeypatch.setattr("conductor_swarm.Swarm._compare", lambda self: None)
    assert "two answers" in _caught()
