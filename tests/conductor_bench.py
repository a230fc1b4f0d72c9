"""Builders of campaigns and requests, and a conductor core under test with its facts kept."""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec

from conductor.core.decisions import decide, start, tick
from conductor.core.facts import Fact, is_durable
from conductor.core.fold import fold, revive
from conductor.core.invariants import check
from conductor.core.state import Config, State
from schemas import SCHEMA_VERSION as V
from schemas.wire.control import (
    Beat,
    Bye,
    Control,
    Ended,
    Explain,
    Hello,
    Lease,
    Next,
    Recorded,
    Reply,
    Request,
    Result,
    StatusRequest,
    Stop,
    Submit,
)

S = 1_000_000_000
"""One second [ns]."""

CONFIG = Config(folder="/state")


def campaign(name: str = "alpha", cases: int = 4, **fields: Any) -> dict[str, Any]:
    """A campaign of ``cases`` cases ``repeat_0`` and so on."""
    return {"campaign": name, "matrix": {"repeat": list(range(cases))}, **fields}


def submit(name: str = "alpha", cases: int = 4, out: str = "", **fields: Any) -> Submit:
    return Submit(v=V, campaign=campaign(name, cases, **fields), out=out)


def secret(worker: str) -> bytes:
    """Of the session of the worker called so."""
    return hashlib.sha256(worker.encode()).digest()


def shown(request: Request) -> Request:
    """The request of a worker with its session's secret, unless it shows one already."""
    if isinstance(request, Next | Beat | Bye | Recorded) and not request.session:
        return msgspec.structs.replace(request, session=secret(request.worker))
    return request


def next_of(worker: str, seq: int, k: int, **fields: Any) -> Next:
    return Next(v=V, worker=worker, seq=seq, k=k, session=secret(worker), **fields)


def beat_of(worker: str, held: dict[str, int], **fields: Any) -> Beat:
    return Beat(v=V, worker=worker, held=held, session=secret(worker), **fields)


def hello(worker: str = "w1", **fields: Any) -> Hello:
    values: dict[str, Any] = {
        "host": "node",
        "pid": 1,
        "device_class": "cpu:avx2",
        "software": "f00d",
        "slots": 4,
        "session": secret(worker),
    }
    return Hello(v=V, worker=worker, **(values | fields))


def result(lease: Lease, kpi: str = "", passed: bool = True, **fields: Any) -> Result:
    """A verdict; ``kpi`` defaults to what a deterministic simulator would give for the case."""
    values: dict[str, Any] = {
        "campaign": lease.case.variation.campaign,
        "case": lease.case.id,
        "token": lease.token,
        "outcome": "verdict",
        "verdict": "pass" if passed else "collision",
        "attempt_dir": f"cases/{lease.case.id}/attempt-{lease.attempt}",
        "kpi_sha256": kpi or f"kpi-{lease.case.id}",
    }
    return Result(**(values | fields))


def ended(lease: Lease, reason: Any, detail: str = "") -> Ended:
    return Ended(
        campaign=lease.case.variation.campaign,
        case=lease.case.id,
        token=lease.token,
        reason=reason,
        detail=detail,
    )


class Bench:
    """A core, its journal as a list, and the invariants after every request."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.config = config
        self.journal: list[Fact] = []
        self.now_ns = 100 * S
        self.state = State(config=config)
        self.seqs: dict[str, int] = {}
        self._keep(start(self.state))

    def ask(self, request: Request) -> Reply:
        """Decide at the present time; fold and memory must agree. Workers show their secret."""
        facts, reply = decide(self.state, shown(request), self.now_ns)
        self._keep(facts)
        return reply

    def tick(self) -> list[Fact]:
        facts = tick(self.state, self.now_ns)
        self._keep(facts)
        return facts

    def restart(self) -> None:
        """The process dies and comes back with what is in the journal."""
        self.state = fold(self.journal, self.config)
        self._keep(start(self.state))
        revive(self.state, self.now_ns)

    def next(self, worker: str = "w1", k: int = 1, **fields: Any) -> Reply:
        self.seqs[worker] = self.seqs.get(worker, 0) + 1
        return self.ask(Next(v=V, worker=worker, seq=self.seqs[worker], k=k, **fields))

    def lease(self, worker: str = "w1", k: int = 1, **fields: Any) -> list[Lease]:
        reply = self.next(worker, k, **fields)
        assert not reply.error
        return reply.leases

    def beat(self, worker: str, *held: int) -> Reply:
        return self.ask(Beat(v=V, worker=worker, held={str(token): 7 for token in held}))

    def bye(self, worker: str = "w1") -> Reply:
        return self.ask(Bye(v=V, worker=worker))

    def control(self, action: Any, campaign: str = "alpha", **fields: str) -> Reply:
        return self.ask(Control(v=V, action=action, campaign=campaign, **fields))

    def explain(self, case: str, campaign: str = "alpha") -> list[str]:
        lines: list[str] = self.ask_explain(case, campaign).status["explain"]
        return lines

    def ask_explain(self, case: str, campaign: str = "alpha") -> Reply:
        return self.ask(Explain(v=V, campaign=campaign, case=case))

    def status(self) -> dict[str, Any]:
        return self.ask(StatusRequest(v=V)).status

    def stop(self) -> Reply:
        return self.ask(Stop(v=V))

    def facts(self, kind: type[Any]) -> list[Any]:
        return [fact for fact in self.journal if isinstance(fact, kind)]

    def _keep(self, facts: list[Fact]) -> None:
        self.journal += [fact for fact in facts if is_durable(fact)]
        check(self.state)
        assert fold(self.journal, self.config) == self.state


def started(cases: int = 4, workers: int = 1, **fields: Any) -> Bench:
    """A bench with one campaign and workers w1, w2, ... that said hello."""
    bench = Bench()
    assert not bench.ask(submit(cases=cases, **fields)).error
    for number in range(1, workers + 1):
        assert not bench.ask(hello(f"w{number}")).error
    return bench
