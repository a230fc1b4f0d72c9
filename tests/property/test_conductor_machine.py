"""The core against a small model: who holds which token until when, and which case has ended.

The bench folds the journal and checks the invariants after every request. A failure prints the
steps that led to it, 40 at most; ``SHRINK=1`` looks for fewer, which takes minutes.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import pytest
from conductor_bench import Bench, S, ended, hello, result, secret, submit
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

import conductor.core.decisions
import conductor.core.settle
from conductor.core.decisions import worker_lost
from conductor.core.facts import CaseEnded, Committed, Retried
from conductor.core.state import Config
from schemas import SCHEMA_VERSION as V
from schemas.wire.codec import encode
from schemas.wire.control import Lease, Next, Reply, Sealed
from twin.fabric.session import seal

CASES = 5
ATTEMPTS_MAX = 2
WORKERS = ("w1", "w2", "w3")


@dataclass(slots=True)
class Model:
    """The rules in their shortest form."""

    live: dict[int, tuple[str, str]] = field(default_factory=dict)
    """Token -> (worker, case)."""
    expiry_ns: dict[int, int] = field(default_factory=dict)
    committed: dict[str, int] = field(default_factory=dict)
    """Case -> token."""
    charges: dict[str, list[str]] = field(default_factory=dict)
    """Case -> workers."""
    unresolved: set[str] = field(default_factory=set)
    granted: dict[int, str] = field(default_factory=dict)
    """Token -> the worker that got it, the only one that has results of it."""
    halves: list[set[str]] = field(default_factory=list)
    """Suspects that may share a rig with nobody else."""
    paused: set[str] = field(default_factory=set)

    def kill(self, token: int, charged: bool = False) -> None:
        worker, case = self.live.pop(token)
        if charged:
            self.charges.setdefault(case, []).append(worker)
        if len(self.charges.get(case, ())) >= ATTEMPTS_MAX and not self.runs(case):
            self.unresolved.add(case)

    def runs(self, case: str) -> int:
        return sum(case == running for _, running in self.live.values())

    def suspect(self, cases: list[str]) -> None:
        middle = (len(cases) + 1) // 2
        for half in (cases[:middle], cases[middle:]):
            self.halves.append(set(half))

    def may_share(self, cases: set[str]) -> bool:
        """Whoever was suspected last with only some of ``cases`` is not in a rig with all."""
        for case in cases:
            latest = next((half for half in reversed(self.halves) if case in half), None)
            if latest is not None and not cases <= latest:
                return False
        return True

    def expire(self, now_ns: int) -> None:
        for token in [t for t in self.live if self.expiry_ns[t] <= now_ns]:
            self.kill(token)

    def held_by(self, worker: str) -> list[int]:
        return [token for token, (owner, _) in self.live.items() if owner == worker]


def _sealed(lease: Lease, worker: str) -> Sealed:
    data = encode(result(lease))
    return Sealed(lease.token, worker, data, seal(secret(worker), data))


class ConductorMachine(RuleBasedStateMachine):
    """Workers that remember every lease they ever got and use old ones too."""

    @initialize()
    def begin(self) -> None:
        # What kills workers is tested with exact numbers.
        self.bench = Bench(Config(folder="/state", losses_min=1000))
        self.bench.ask(submit(cases=CASES, attempts_max=ATTEMPTS_MAX))
        self.model = Model()
        self.leases: list[Lease] = []
        self.last: dict[str, tuple[Next, Reply]] = {}
        for worker in WORKERS:
            self.bench.ask(hello(worker))

    @rule(
        worker=st.sampled_from(WORKERS),
        k=st.integers(0, 3),
        forget=st.booleans(),
        data=st.data(),
    )
    def ask_next(self, worker: str, k: int, forget: bool, data: st.DataObject) -> None:
        model = self.model
        model.expire(self.bench.now_ns)
        # Numbers, because a failure prints what was drawn, and a lease is a page.
        numbers = range(len(self.leases))
        some = st.lists(st.sampled_from(numbers), max_size=2) if numbers else st.just([])
        more = st.lists(st.sampled_from(numbers), max_size=4) if numbers else st.just([])
        finished = [self.leases[n] for n in data.draw(some, label="finished")]
        given_up = [self.leases[n] for n in data.draw(more, label="given up")]
        reason = data.draw(st.sampled_from(["crash", "suspect", "walltime"]), label="reason")
        spooled = data.draw(st.booleans(), label="out of a spool")
        fenced = [x.token for x in finished if not self._commit(x, worker, spooled)]
        tokens = sorted({x.token for x in given_up if x.token in model.held_by(worker)})
        if reason == "suspect" and tokens:
            model.suspect([model.live[token][1] for token in tokens])
        for token in tokens:
            if reason == "crash":
                model.suspect([model.live[token][1]])
            model.kill(token, charged=reason == "crash")
        held = [] if forget else model.held_by(worker)
        for token in model.held_by(worker):
            if token not in held:
                model.kill(token)
        reply = self.bench.next(
            worker,
            k,
            results=[] if spooled else [result(lease) for lease in finished],
            sealed=[_sealed(x, model.granted[x.token]) for x in finished] if spooled else [],
            ended=[ended(lease, reason) for lease in given_up],
            held=held,
        )
        assert reply.fenced == fenced
        assert reply.acks == [lease.token for lease in finished]
        self._granted(worker, k, held, reply)

    def _commit(self, lease: Lease, worker: str, spooled: bool) -> bool:
        model = self.model
        if model.granted[lease.token] != worker and not spooled:
            return False
        if lease.token in model.live:
            for token in [t for t, (_, c) in model.live.items() if c == lease.case.id]:
                del model.live[token]
            model.committed[lease.case.id] = lease.token
            return True
        return model.committed.get(lease.case.id) == lease.token

    def _granted(self, worker: str, k: int, held: list[int], reply: Reply) -> None:
        model = self.model
        assert len(reply.leases) <= k
        for lease in reply.leases:
            case = lease.case.id
            assert lease.token not in model.granted
            assert case not in model.committed
            assert case not in model.unresolved
            assert case not in model.paused
            if model.runs(case):  # a second lease, for who has nothing else to do
                assert model.runs(case) == 1
                assert not held
                assert len(reply.leases) == 1
                assert not model.charges.get(case)
                assert not self._waiting(worker)
            assert not lease.alone or (len(reply.leases) == 1 and not held)
            model.granted[lease.token] = worker
            model.live[lease.token] = (worker, case)
            self.leases.append(lease)
        for token in model.held_by(worker):
            model.expiry_ns[token] = self.bench.now_ns + self.bench.config.ttl_ns
        assert model.may_share({model.live[t][1] for t in model.held_by(worker)})
        assert reply.left == CASES - len(model.committed) - len(model.unresolved)
        if k and not held and not reply.leases:
            assert not self._waiting(worker), "a case waits and an empty worker got none"
        request = Next(v=V, worker=worker, seq=self.bench.seqs[worker], k=k)
        self.last[worker] = (request, reply)

    def _waiting(self, worker: str) -> set[str]:
        """Cases that wait for ``worker`` (another one should confirm a charge of its own)."""
        model = self.model
        done = {*model.committed, *model.unresolved, *model.paused}
        own = {case for case, workers in model.charges.items() if set(workers) == {worker}}
        return (
            {f"repeat_{i}" for i in range(CASES)}
            - done
            - own
            - {case for _, case in model.live.values()}
        )

    @rule(worker=st.sampled_from(WORKERS))
    def repeat_next(self, worker: str) -> None:
        self.model.expire(self.bench.now_ns)
        if worker not in self.last:
            return
        request, reply = self.last[worker]
        assert self.bench.ask(request) == reply
        for token in self.model.held_by(worker):
            self.model.expiry_ns[token] = self.bench.now_ns + self.bench.config.ttl_ns

    @precondition(lambda self: self.leases)
    @rule(worker=st.sampled_from(WORKERS), data=st.data())
    def beat(self, worker: str, data: st.DataObject) -> None:
        model = self.model
        model.expire(self.bench.now_ns)
        named = data.draw(
            st.lists(st.sampled_from([x.token for x in self.leases]), max_size=3, unique=True)
        )
        own = [token for token in named if token in model.held_by(worker)]
        reply = self.bench.beat(worker, *named)
        assert sorted(reply.lost) == sorted(set(named) - set(own))
        for token in own:
            model.expiry_ns[token] = self.bench.now_ns + self.bench.config.ttl_ns

    @rule(number=st.integers(0, CASES - 1), action=st.sampled_from(["pause", "resume"]))
    def pause(self, number: int, action: str) -> None:
        self.model.expire(self.bench.now_ns)
        case = f"repeat_{number}"
        ended_already = case in self.model.committed or case in self.model.unresolved
        reply = self.bench.control(action, case=case)
        assert bool(reply.error) == ended_already
        if not ended_already:
            (self.model.paused.add if action == "pause" else self.model.paused.discard)(case)

    @rule(number=st.integers(0, CASES - 1))
    def retry(self, number: int) -> None:
        model = self.model
        model.expire(self.bench.now_ns)
        case = f"repeat_{number}"
        reply = self.bench.control("retry", case=case)
        assert bool(reply.error) == (case in model.committed)
        if case in model.unresolved:
            model.unresolved.discard(case)
            model.charges.pop(case)
            model.paused.discard(case)
            for half in model.halves:
                half.discard(case)

    @rule(seconds=st.sampled_from([0.001, 1, 3, 7, 15]))
    def wait(self, seconds: float) -> None:
        self.bench.now_ns += int(seconds * S)

    @rule()
    def tick(self) -> None:
        self.model.expire(self.bench.now_ns)
        self.bench.tick()

    @rule(worker=st.sampled_from(WORKERS))
    def vanish(self, worker: str) -> None:
        worker_lost(self.bench.state, worker, self.bench.now_ns)
        until_ns = self.bench.now_ns + self.bench.config.vanished_ns
        for token in self.model.held_by(worker):
            self.model.expiry_ns[token] = min(self.model.expiry_ns[token], until_ns)

    @rule()
    def restart(self) -> None:
        self.bench.restart()
        for token in self.model.live:
            self.model.expiry_ns[token] = self.bench.now_ns + self.bench.config.ttl_ns

    @invariant()
    def one_end_per_case(self) -> None:
        if not hasattr(self, "model"):
            return
        results = [fact.result for fact in self.bench.facts(Committed)]
        assert {r.case: r.token for r in results} == self.model.committed
        assert len(results) == len(self.model.committed)
        retried = [fact.case for fact in self.bench.facts(Retried)]
        quarantined = [fact.case for fact in self.bench.facts(CaseEnded)]
        assert sorted(quarantined) == sorted([*self.model.unresolved, *retried])


_SETTINGS = settings(
    max_examples=200,
    stateful_step_count=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
    phases=list(Phase) if os.environ.get("SHRINK") else [Phase.explicit, Phase.generate],
)
TestConductorMachine = ConductorMachine.TestCase
TestConductorMachine.settings = settings(_SETTINGS, max_examples=30)


@pytest.mark.slow
class TestConductorMachineAtLength(ConductorMachine.TestCase):
    """The same with all examples."""

    settings = _SETTINGS


def test_planted_tokens_are_not_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    commit = conductor.core.settle.commit
    monkeypatch.setattr(
        conductor.core.decisions,
        "commit",
        lambda turn, result, worker: commit(turn, result, worker) or True,
    )
    _must_fail()


def test_planted_leases_never_expire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conductor.core.decisions, "expire", lambda turn: None)
    _must_fail()


def _must_fail() -> None:
    with pytest.raises(AssertionError):
        run_state_machine_as_test(
            ConductorMachine,
            settings=settings(
                _SETTINGS,
                database=None,
                report_multiple_bugs=False,
                print_blob=False,
                phases=[Phase.generate],
            ),
        )
